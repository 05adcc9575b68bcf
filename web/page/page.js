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
const wish = { style: "", second: "", share: 0.5, strength: 1, kind: "look" };
const dropped = new Set();
// What was asked for before a capture that is being read; it is asked for again if the capture cannot be shown.
let before = null;
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
    // On phones, the styles are a strip.
    if (button.dataset.style === wish.style) button.scrollIntoView({ block: "nearest", inline: "nearest" });
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
    return hear("failed", `${file.name}: found ${(file.size / 1e9).toFixed(1)} GB, expected at most ${LARGEST_FILE / 1e9} GB`);
  }
  const buffer = await file.arrayBuffer().catch((error) => hear("failed", `${file.name}: ${error.message}`));
  if (!buffer) return;
  const bytes = new Uint8Array(buffer);
  if (IMAGE.test(file.name)) {
    // Before it gets a thumbnail.
    if (!(await createImageBitmap(file).catch(() => null))) return hear("failed", `${file.name}: found no image that can be read`);
    if (!dropped.has(file.name)) addStyle(file.name, URL.createObjectURL(file));
    dropped.add(file.name);
    app.add_painting(file.name, bytes);
    wish.style = file.name;
    apply();
  } else {
    before = { ...wish };
    // A look belongs to the demo scene.
    wish.kind = wish.kind === "look" ? "paint" : wish.kind;
    wish.style = "";
    apply();
    notice(`Reading ${file.name} …`);
    app.open_file(file.name, bytes);
  }
}

// Offers to embed the scene (false), to end that (true), or neither (null).
function offer(isEmbedding) {
  $("embed").hidden = isEmbedding === null;
  $("embed").textContent = isEmbedding ? "Cancel embedding" : "Embed it";
  $("embed").onclick = () => {
    if (isEmbedding) app.cancel_embedding();
    else app.embed_soon();
    $("progress").hidden = true;
    notice("");
    offer(!isEmbedding);
  };
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
    if (before) Object.assign(wish, before);
    if (before) apply();
    before = null;
    offer(null);
    document.body.dataset.state = "failed";
    $("progress").hidden = true;
    notice(text);
  }
  if (kind === "loaded") {
    const [count, canBeStyled] = text.split(" ");
    document.body.dataset.scene = count;
    delete document.body.dataset.shown;
    before = null;
    const isPlain = canBeStyled !== "true";
    offer(isPlain ? false : null);
    notice(isPlain ? "This capture holds no features, so it is shown as it was captured. Embedding it here takes minutes." : "");
  }
  if (kind === "shown") {
    document.body.dataset.shown = document.body.dataset.scene;
    $("progress").hidden = true;
  }
  if (kind === "applied") {
    // A failure is to be read, even if the style before it is back.
    if (document.body.dataset.state !== "failed") notice("");
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
  app.open_asset("demo.sgs");
  if (wish.style) apply();
}

for (const key of ["kind", "second"]) $(key).onchange = (event) => { wish[key] = event.target.value; apply(); };
for (const key of ["share", "strength"]) $(key).oninput = (event) => { wish[key] = Number(event.target.value); apply(); };
$("file").onchange = (event) => { if (event.target.files[0]) open(event.target.files[0]); };
$("arrives").onchange = (event) => app?.set_transition(event.target.value, ARRIVES_SECONDS);
$("save_glb").onclick = () => app?.save_glb_soon();
$("save").onclick = () => app?.save_picture_soon();
$("link").onclick = () => navigator.clipboard.writeText(location.href).then(() => notice("The link is copied."), () => notice(location.href));
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
