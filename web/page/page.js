// The page around the app: its buttons, drops, keys and touch, and the link that carries a style.

import { NoWebGpu, start as startApp } from "./package/start.js";
import { steer } from "./package/steer.js";

const $ = (id) => document.getElementById(id);
const STYLES = [
  ["cubist", "jpg"], ["dots", "jpg"], ["halftone", "png"], ["ink", "jpg"],
  ["mosaic", "jpg"], ["print", "jpg"], ["strokes", "jpg"], ["watercolor", "jpg"],
];
// Seconds in which a style arrives.
const ARRIVES_SECONDS = 1.5;
const IMAGE = /\.(jpe?g|png)$/i;

// What is asked for. `style` and `second` are names of `STYLES`, or of images that were dropped.
const wish = {
  style: "", second: "", share: 0.5, strength: 1, kind: "look", paint: 1, protection: 1, stroke_scale: 1,
  motion: "still", rate: 8, distance: 0.5, relief: 0, light_from: 0, screen_stable: false,
};
// What sliders set: the style, and how its strokes are drawn, which computes nothing. Functions of the app take
// the latter.
const SHARES = ["share", "strength"];
const STROKES = {
  set_strokes: ["paint", "protection", "stroke_scale"], set_motion: ["motion", "rate", "distance"],
  set_relief: ["relief", "light_from"], set_screen_stable: ["screen_stable"],
};
const SLIDERS = [...SHARES, ...Object.values(STROKES).flat().filter((key) => typeof wish[key] === "number")];
// The usual rate and distance of each motion, and its largest rate.
const MOTIONS = { still: [8, 0.5, 24], boil: [8, 0.5, 24], flow: [0.5, 2, 4] };
const dropped = new Set();
// What was asked for before a capture that is being read; it is asked for again if the capture cannot be shown.
let before = null;
// Whether the scene has no features, which the decoder needs, and whether it is getting them.
let isPlain = false, isEmbedding = false;
// The address of the world that the link names, relative to the page.
let world = "";
let app;

const notice = (text) => { $("notice").textContent = text; };

// Names of the app: see style.rs.
function appName(name) {
  if (dropped.has(name)) return `image:${name}`;
  const [, extension] = STYLES.find(([known]) => known === name) ?? [];
  return wish.kind === "paint" ? `paint:${name}.${extension}` : `${wish.kind}:${name}`;
}

// Sets the controls, but for the styles' buttons, and the link to what is asked for.
function show() {
  // Nobody has baked what was dropped.
  const isDropped = dropped.has(wish.style);
  $("kind").options[0].disabled = isDropped;
  $("kind").value = isDropped && wish.kind === "look" ? "paint" : wish.kind;
  $("second").value = wish.second;
  $("motion").value = wish.motion;
  for (const key of SLIDERS) $(key).value = wish[key];
  $("screen_stable").checked = wish.screen_stable;
  for (const key of ["rate", "distance"]) $(key).parentElement.hidden = wish.motion === "still";
  $("light_from").parentElement.hidden = wish.relief === 0;
  $("embed").hidden = !needsFeatures();
  $("embed").textContent = isEmbedding ? "Cancel embedding" : "Embed it";
  // A dropped image is not in the link: nobody else has it.
  const shared = Object.entries(wish).filter(([, value]) => !dropped.has(value));
  const carried = [...(wish.style ? shared : []), ...(world ? [["world", world]] : [])];
  history.replaceState(null, "", carried.length ? `#${new URLSearchParams(carried)}` : "#");
}

const needsFeatures = () => isPlain && wish.kind === "decode";

// The sentence while nothing goes on.
const rest = () => notice(
  needsFeatures() && !isEmbedding
    ? "This capture holds no features, which the decoder needs. Embedding it here takes minutes."
    : "",
);

function apply() {
  // Paint would wait for minutes behind features that it does not need.
  if (isEmbedding && wish.kind !== "decode") app.cancel_embedding();
  isEmbedding &&= wish.kind === "decode";
  for (const button of $("styles").children) {
    button.setAttribute("aria-pressed", String(button.dataset.style === wish.style));
    // On phones, the styles are a strip.
    if (button.dataset.style === wish.style) button.scrollIntoView({ block: "nearest", inline: "nearest" });
  }
  show();
  rest();
  const mix = wish.style && !needsFeatures() ? [[wish.style, 1 - (wish.second ? wish.share : 0)]] : [];
  if (mix.length && wish.second) mix.push([wish.second, wish.share]);
  const kept = mix.filter(([, weight]) => weight > 0);
  document.body.dataset.state = "styling";
  const [names, weights] = [kept.map(([name]) => appName(name)), kept.map(([, weight]) => weight)];
  app?.set_style(names, new Float32Array(weights), 0, wish.strength, wish.kind === "decode");
}

const setStrokes = (name) => app?.[name](...STROKES[name].map((key) => wish[key]));

function readLink() {
  const link = new URLSearchParams(location.hash.slice(1));
  const known = (name) => STYLES.some(([style]) => style === name);
  for (const key of ["style", "second"]) if (known(link.get(key))) wish[key] = link.get(key);
  const motion = link.get("motion");
  if (Object.hasOwn(MOTIONS, motion)) setMotion(motion);
  for (const key of SLIDERS) {
    const value = Number.parseFloat(link.get(key));
    if (value >= $(key).min && value <= $(key).max) wish[key] = value;
  }
  wish.screen_stable = link.get("screen_stable") === "true";
  if (["look", "paint", "decode"].includes(link.get("kind"))) wish.kind = link.get("kind");
  // Nothing is loaded from other hosts, whoever made the link.
  const address = link.get("world");
  if (address && URL.canParse(address, document.baseURI)) {
    if (new URL(address, document.baseURI).origin === location.origin) world = address;
  }
  // A look belongs to the demo scene.
  if (world && wish.kind === "look") wish.kind = "paint";
}

// The distances of motions are as different as their rates.
function setMotion(motion) {
  wish.motion = motion;
  [wish.rate, wish.distance, $("rate").max] = MOTIONS[motion];
}

function addStyle(name, picture, label = name) {
  const button = document.createElement("button");
  button.dataset.style = name;
  button.setAttribute("aria-pressed", String(name === wish.style));
  if (picture) button.append(Object.assign(new Image(), { src: picture, alt: "" }));
  button.append(Object.assign(document.createElement("span"), { textContent: label }));
  button.title = label;
  button.onclick = () => { wish.style = name; apply(); };
  $("styles").append(button);
  if (name) $("second").append(new Option(label, name));
}

// The worker has 4 GB of memory, and holds a file and its scene. Browsers refuse buffers of 2 GB themselves.
const LARGEST_FILE = 1.5e9;

async function open(file) {
  if (file.size > LARGEST_FILE) {
    const [found, most] = [(file.size / 1e9).toFixed(1), LARGEST_FILE / 1e9];
    return hear("failed", `${file.name}: found ${found} GB, expected at most ${most} GB`);
  }
  const buffer = await file.arrayBuffer().catch((error) => hear("failed", `${file.name}: ${error.message}`));
  if (!buffer) return;
  const bytes = new Uint8Array(buffer);
  if (IMAGE.test(file.name)) {
    // Before it gets a thumbnail.
    if (!(await createImageBitmap(file).catch(() => null))) {
      return hear("failed", `${file.name}: found no image that can be read`);
    }
    if (!dropped.has(file.name)) addStyle(file.name, URL.createObjectURL(file));
    dropped.add(file.name);
    app.add_painting(file.name, bytes);
    wish.style = file.name;
    apply();
  } else {
    before = { style: wish.style, kind: wish.kind };
    // A look belongs to the demo scene.
    wish.kind = wish.kind === "look" ? "paint" : wish.kind;
    wish.style = "";
    apply();
    notice(`Reading ${file.name} …`);
    app.open_file(file.name, bytes);
  }
}

function hear(kind, text) {
  if (kind === "ready") document.body.dataset.state = "ready";
  if (kind === "progress") {
    const [task, share] = text.split(" ");
    $("progress").hidden = share === undefined;
    $("progress").value = share ?? 0;
    notice(`${task[0].toUpperCase()}${task.slice(1)} …`);
  }
  if (kind === "failed") {
    isEmbedding = false;
    if (before) Object.assign(wish, before);
    if (before) apply();
    before = null;
    show();
    document.body.dataset.state = "failed";
    $("progress").hidden = true;
    notice(text);
  }
  if (kind === "loaded") {
    const [count, hasFeatures] = text.split(" ");
    document.body.dataset.scene = count;
    delete document.body.dataset.shown;
    // A capture takes the world's place.
    if (before) world = "";
    before = null;
    const didNeed = needsFeatures();
    [isPlain, isEmbedding] = [hasFeatures !== "true", false];
    show();
    rest();
    if (didNeed && !isPlain) apply();
  }
  if (kind === "shown") {
    document.body.dataset.shown = document.body.dataset.scene;
    $("progress").hidden = true;
  }
  if (kind === "applied") {
    // A failure is to be read, even if the style before it is back.
    if (document.body.dataset.state !== "failed") rest();
    document.body.dataset.state = "applied";
  }
}

async function start() {
  addStyle("", null, "as captured");
  for (const [name, extension] of STYLES) addStyle(name, `assets/styles/${name}.${extension}`);
  readLink();
  $("progress").hidden = false;
  notice("Loading …");
  app = await startApp((share) => { $("progress").value = share; }, hear);
  if (world) app.open_world(new URL(world, document.baseURI).href);
  else app.open_asset("demo.sgs");
  Object.keys(STROKES).forEach(setStrokes);
  if (wish.style) apply();
}

for (const key of ["kind", "second"]) $(key).onchange = (event) => { wish[key] = event.target.value; apply(); };
for (const key of SHARES) $(key).oninput = (event) => { wish[key] = Number(event.target.value); apply(); };
for (const [name, keys] of Object.entries(STROKES)) {
  for (const key of keys) {
    $(key).oninput = ({ target }) => {
      if (key === "motion") setMotion(target.value);
      else wish[key] = target.type === "checkbox" ? target.checked : Number(target.value);
      show();
      setStrokes(name);
    };
  }
}
$("file").onchange = (event) => { if (event.target.files[0]) open(event.target.files[0]); };
$("arrives").onchange = (event) => app?.set_transition(event.target.value, ARRIVES_SECONDS);
$("embed").onclick = () => {
  if (isEmbedding) app.cancel_embedding();
  else app.embed_soon();
  isEmbedding = !isEmbedding;
  $("progress").hidden = true;
  notice("");
  show();
};
$("save_glb").onclick = () => app?.save_glb_soon();
$("save").onclick = () => app?.save_picture_soon();
$("link").onclick = () => {
  const copied = navigator.clipboard.writeText(location.href);
  copied.then(() => notice("The link is copied."), () => notice(location.href));
};
document.addEventListener("dragover", (event) => {
  event.preventDefault();
  $("stage").classList.add("awaits");
});
document.addEventListener("dragleave", () => $("stage").classList.remove("awaits"));
document.addEventListener("drop", async (event) => {
  event.preventDefault();
  $("stage").classList.remove("awaits");
  if (!app) return notice("The page is still loading.");
  for (const file of event.dataTransfer.files) await open(file);
});
steer($("stage"), () => app);
start().catch((error) => {
  document.body.dataset.state = "failed";
  $("progress").hidden = true;
  notice(error instanceof NoWebGpu ? error.message : `The page cannot start: ${error.message ?? error}`);
});
