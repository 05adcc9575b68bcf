// The page around the app: its buttons, drops, keys and touch, and the link that carries a style.

const $ = (id) => document.getElementById(id);
const STYLES = [
  ["cubist", "jpg"], ["dots", "jpg"], ["halftone", "png"], ["ink", "jpg"],
  ["mosaic", "jpg"], ["print", "jpg"], ["strokes", "jpg"], ["watercolor", "jpg"],
];
const IMAGE = /\.(jpe?g|png)$/i;
// Radians per pixel of a drag, and per press of a key.
const TURN = 0.006, KEY_TURN = 0.1;

// What is asked for. `style` and `second` are names of `STYLES`, or of images that were dropped.
const wish = { style: "", second: "", share: 0.5, strength: 1, kind: "look" };
const dropped = new Set();
let app;

const notice = (text) => { $("notice").textContent = text; };

// Names of the app: see style.rs.
function appName(name) {
  if (dropped.has(name)) return `image:${name}`;
  const [, extension] = STYLES.find(([known]) => known === name) ?? [];
  return wish.kind === "paint" ? `paint:${name}.${extension}` : `${wish.kind}:${name}`;
}

function apply() {
  for (const button of $("styles").children) {
    button.setAttribute("aria-pressed", String(button.dataset.style === wish.style));
  }
  Object.assign($("kind"), { value: wish.kind });
  Object.assign($("second"), { value: wish.second });
  Object.assign($("share"), { value: wish.share });
  Object.assign($("strength"), { value: wish.strength });
  const mix = wish.style ? [[wish.style, 1 - (wish.second ? wish.share : 0)]] : [];
  if (wish.style && wish.second) mix.push([wish.second, wish.share]);
  const kept = mix.filter(([, weight]) => weight > 0);
  document.body.dataset.state = "styling";
  app?.set_style(kept.map(([name]) => appName(name)), new Float32Array(kept.map(([, weight]) => weight)), 0, wish.strength, wish.kind === "decode");
  // A dropped image is not in the link: nobody else has it.
  const shared = Object.entries(wish).filter(([, value]) => !dropped.has(value));
  history.replaceState(null, "", wish.style ? `#${new URLSearchParams(shared)}` : "#");
}

function readLink() {
  const link = new URLSearchParams(location.hash.slice(1));
  const known = (name) => STYLES.some(([style]) => style === name);
  for (const key of ["style", "second"]) if (known(link.get(key))) wish[key] = link.get(key);
  for (const key of ["share", "strength"]) {
    const value = Number.parseFloat(link.get(key));
    if (value >= 0 && value <= 1) wish[key] = value;
  }
  if (["look", "paint", "decode"].includes(link.get("kind"))) wish.kind = link.get("kind");
}

function addStyle(name, picture, label = name) {
  const button = document.createElement("button");
  button.dataset.style = name;
  if (picture) button.append(Object.assign(new Image(), { src: picture, alt: "" }));
  button.append(label);
  button.onclick = () => { wish.style = name; apply(); };
  $("styles").append(button);
  if (name) $("second").append(new Option(label, name));
}

// A page has 4 GB of memory, and reading a scene takes about twice its file.
const LARGEST_FILE = 1.5e9;

async function open(file) {
  if (file.size > LARGEST_FILE) {
    return hear("failed", `${file.name}: found ${(file.size / 1e9).toFixed(1)} GB, expected at most ${LARGEST_FILE / 1e9}`);
  }
  const bytes = new Uint8Array(await file.arrayBuffer());
  if (IMAGE.test(file.name)) {
    // Before it gets a thumbnail.
    if (!(await createImageBitmap(file).catch(() => null))) return hear("failed", `${file.name}: found no image that can be read`);
    if (!dropped.has(file.name)) addStyle(file.name, URL.createObjectURL(file));
    dropped.add(file.name);
    app.add_painting(file.name, bytes);
    wish.style = file.name;
    apply();
  } else {
    notice(`Reading ${file.name} …`);
    // A look belongs to the demo scene.
    wish.kind = wish.kind === "look" ? "paint" : wish.kind;
    wish.style = "";
    apply();
    app.open_file(file.name, bytes);
  }
}

function hear(kind, text) {
  if (kind === "ready") document.body.dataset.state = "ready";
  if (kind === "failed") {
    document.body.dataset.state = "failed";
    $("progress").hidden = true;
    notice(text);
  }
  if (kind === "loaded") {
    const [count, canBeStyled] = text.split(" ");
    document.body.dataset.scene = count;
    delete document.body.dataset.shown;
    notice(canBeStyled === "true" ? "" :
      "This capture holds no features, so it is shown as it was captured. `stylegaussian embed` adds them.");
  }
  if (kind === "shown") {
    document.body.dataset.shown = document.body.dataset.scene;
    $("progress").hidden = true;
  }
  if (kind === "applied") {
    document.body.dataset.state = "applied";
    notice("");
  }
}

// One finger or button turns, two fingers zoom and move. Pointer events are those of mouse, touch and pen alike.
function steer(stage) {
  const pointers = new Map();
  const spread = () => {
    const [a, b] = [...pointers.values()];
    return { size: Math.hypot(a.x - b.x, a.y - b.y), x: (a.x + b.x) / 2, y: (a.y + b.y) / 2 };
  };
  stage.addEventListener("pointerdown", (event) => {
    stage.setPointerCapture(event.pointerId);
    pointers.set(event.pointerId, { x: event.clientX, y: event.clientY });
  });
  stage.addEventListener("pointermove", (event) => {
    const last = pointers.get(event.pointerId);
    if (!last || !app) return;
    const before = pointers.size === 2 ? spread() : null;
    pointers.set(event.pointerId, { x: event.clientX, y: event.clientY });
    const [dx, dy] = [event.clientX - last.x, event.clientY - last.y];
    if (before) {
      const after = spread();
      app.zoom(before.size / Math.max(after.size, 1));
      app.fly((before.x - after.x) / 1000, (after.y - before.y) / 1000, 0);
    } else if (event.buttons & 4 || event.shiftKey) app.fly(-dx / 1000, dy / 1000, 0);
    else app.turn(-dx * TURN, dy * TURN);
  });
  for (const end of ["pointerup", "pointercancel"]) stage.addEventListener(end, (event) => pointers.delete(event.pointerId));
  stage.addEventListener("wheel", (event) => {
    event.preventDefault();
    app?.zoom(Math.exp(event.deltaY / 800));
  }, { passive: false });
  const keys = {
    ArrowLeft: () => app.turn(-KEY_TURN, 0), ArrowRight: () => app.turn(KEY_TURN, 0),
    ArrowUp: () => app.turn(0, KEY_TURN), ArrowDown: () => app.turn(0, -KEY_TURN),
    "+": () => app.zoom(0.9), "=": () => app.zoom(0.9), "-": () => app.zoom(1.1),
    w: () => app.fly(0, 0, -0.05), s: () => app.fly(0, 0, 0.05), a: () => app.fly(-0.05, 0, 0),
    d: () => app.fly(0.05, 0, 0), e: () => app.fly(0, 0.05, 0), q: () => app.fly(0, -0.05, 0),
  };
  stage.addEventListener("keydown", (event) => {
    const act = keys[event.key];
    if (!act || !app || event.ctrlKey || event.metaKey) return;
    event.preventDefault();
    act();
  });
}

// The module, with progress: it is the largest part of the page.
async function fetchModule() {
  const response = await fetch("app_bg.wasm");
  if (!response.ok) throw new Error(`app_bg.wasm: the server answered ${response.status}`);
  const total = Number(response.headers.get("content-length"));
  // Behind compression, the length is that of the compressed module, and says nothing about what arrives.
  const isTold = total > 0 && !response.headers.get("content-encoding");
  let got = 0;
  const counted = new TransformStream({
    transform(chunk, controller) {
      got += chunk.byteLength;
      if (isTold) $("progress").value = got / total;
      controller.enqueue(chunk);
    },
  });
  return new Response(response.body.pipeThrough(counted), { headers: { "content-type": "application/wasm" } });
}

async function start() {
  addStyle("", null, "as captured");
  for (const [name, extension] of STYLES) addStyle(name, `assets/styles/${name}.${extension}`);
  readLink();
  if (!navigator.gpu || !(await navigator.gpu.requestAdapter())) {
    document.body.dataset.state = "failed";
    notice("This browser has no WebGPU, which the scene is drawn with. Chrome, Edge, Safari 26 and Firefox 141 or later have it.");
    return;
  }
  $("progress").hidden = false;
  notice("Loading …");
  const module = await import("./app.js");
  // A panic of the app, memory that runs out included, is an error of the script that called it. The page stays.
  const stopped = (reason) => hear("failed", `The app has stopped (${reason}). Reload the page to go on.`);
  window.addEventListener("error", (event) => stopped(event.message));
  window.addEventListener("unhandledrejection", (event) => stopped(event.reason));
  await module.default({ module_or_path: fetchModule() });
  app = module;
  app.listen(hear);
  app.use_worker(() => new Worker(new URL("worker.js", import.meta.url), { type: "module" }));
  app.open_asset("demo.sgs");
  if (wish.style) apply();
}

for (const key of ["kind", "second"]) $(key).onchange = (event) => { wish[key] = event.target.value; apply(); };
for (const key of ["share", "strength"]) $(key).oninput = (event) => { wish[key] = Number(event.target.value); apply(); };
$("file").onchange = (event) => { if (event.target.files[0]) open(event.target.files[0]); };
$("save").onclick = () => app?.save_picture_soon();
$("link").onclick = () => navigator.clipboard.writeText(location.href).then(() => notice("The link is copied."), () => notice(location.href));
document.addEventListener("dragover", (event) => event.preventDefault());
document.addEventListener("drop", async (event) => {
  event.preventDefault();
  if (!app) return notice("The page is still loading.");
  for (const file of event.dataTransfer.files) await open(file);
});
steer($("stage"));
start().catch((error) => {
  document.body.dataset.state = "failed";
  notice(`The page cannot start: ${error.message ?? error}`);
});
