// The page's script with a stand-in for the app, which notes what is asked of it: clicks, keys, drops, links,
// narrow screens, and browsers without WebGPU.
//
//   node --test web/test/page.mjs

import assert from "node:assert/strict";
import { after, before, test } from "node:test";
import { errorsOf, launch, serve } from "./browser.mjs";

const STAND_IN = `
  const noted = (v) => (v?.byteLength > 99 ? v.byteLength : ArrayBuffer.isView(v) ? [...v] : v);
  const note = (name) => (...given) => calls.push([name, ...given.map(noted)]);
  globalThis.calls = [];
  let tell;
  export default async () => ({ memory: new WebAssembly.Memory({ initial: 2 ** 15 }) });
  export const listen = (listener) => { tell = globalThis.tell = listener; tell("ready", ""); };
  export const open_asset = (path) => { calls.push(["open_asset", path]); tell("loaded", "5 true"); };
  export const [
    open_file, open_world, add_painting, turn, fly, zoom, save_picture_soon, save_glb_soon,
    embed_soon, cancel_embedding, set_transition, set_strokes, set_motion, set_relief, set_screen_stable,
  ] = [
    "open_file", "open_world", "add_painting", "turn", "fly", "zoom", "save", "save_glb_soon",
    "embed_soon", "cancel_embedding", "set_transition", "set_strokes", "set_motion", "set_relief",
    "set_screen_stable",
  ].map(note);
  export const use_worker = () => {};
  export const set_style = (...given) => { note("set_style")(...given); tell("applied", "1"); };
`;
// What the page asks for at first.
const BEGINNING = [
  ["open_asset", "demo.sgs"], ["set_strokes", 1, 1, 1], ["set_motion", "still", 8, 0.5], ["set_relief", 0, 0],
  ["set_screen_stable", false],
];
let browser, server;
before(async () => {
  browser = await launch();
  server = await serve(["web/page", "web", "."], { "/package/app.js": STAND_IN, "/package/app_bg.wasm": "-" });
});
after(async () => {
  await browser?.close();
  server?.close();
});

// Without a scene that is shown at once, until the app is asked for `last`.
async function opened(link = "", viewport = { width: 1000, height: 640 }, last = undefined) {
  const page = await browser.newPage({ viewport });
  const errors = errorsOf(page);
  await page.goto(server.url + link);
  if (last) await page.waitForFunction((last) => globalThis.calls?.some(([name]) => name === last), last);
  else await page.waitForSelector("body[data-scene]");
  const taken = () => page.evaluate(() => calls.splice(0));
  return { page, errors, taken };
}

test("a click puts a style on, a second one mixes, and the link carries both", async () => {
  const { page, errors, taken } = await opened();
  assert.deepEqual(await taken(), BEGINNING);
  await page.click('[data-style="ink"]');
  await page.selectOption("#second", "dots");
  assert.deepEqual(await taken(), [
    ["set_style", ["look:ink"], [1], 0, 1, false],
    ["set_style", ["look:ink", "look:dots"], [0.5, 0.5], 0, 1, false],
  ]);
  assert.equal(await page.getAttribute('[data-style="ink"]', "aria-pressed"), "true");
  const link = new URL(page.url()).hash;
  const again = await opened(link);
  const mixed = ["set_style", ["look:ink", "look:dots"], [0.5, 0.5], 0, 1, false];
  assert.deepEqual((await again.taken()).at(-1), mixed);
  await page.click('[data-style=""]');
  assert.deepEqual((await taken())[0][1], []);
  assert.deepEqual([...errors, ...again.errors], []);
});

test("a link may hold anything", async () => {
  const { errors, taken } = await opened("#style=../../x&second=ink&strength=7&kind=<b>");
  assert.deepEqual(await taken(), BEGINNING);
  assert.deepEqual(errors, []);
});

test("images become styles, other files scenes", async () => {
  const { page, errors, taken } = await opened();
  await page.setInputFiles("#file", "assets/styles/ink.jpg");
  await page.waitForSelector('[data-style="ink.jpg"][aria-pressed="true"]');
  const [painting, style] = (await taken()).slice(BEGINNING.length);
  assert.deepEqual([painting[0], painting[1], style[1]], ["add_painting", "ink.jpg", ["image:ink.jpg"]]);
  // Nobody has baked it; what comes with the page is still shown baked.
  assert.equal(await page.inputValue("#kind"), "paint");
  assert.ok(await page.isDisabled('#kind [value="look"]'));
  await page.click('[data-style="dots"]');
  assert.equal(await page.inputValue("#kind"), "look");
  assert.deepEqual((await taken())[0][1], ["look:dots"]);
  await page.click('[data-style="ink.jpg"]');
  await taken();
  await page.setInputFiles("#file", { name: "a.spz", mimeType: "", buffer: Buffer.alloc(100) });
  await page.waitForFunction(() => calls.length === 2);
  assert.deepEqual(await taken(), [["set_style", [], [], 0, 1, false], ["open_file", "a.spz", 100]]);
  assert.equal(await page.inputValue("#kind"), "paint");
  // The scene before it stays, and so does its style.
  await page.evaluate(() => tell("failed", "a.spz: found no scene"));
  assert.equal(await page.textContent("#notice"), "a.spz: found no scene");
  assert.deepEqual(await taken(), [["set_style", ["image:ink.jpg"], [1], 0, 1, false]]);
  await page.click('[data-style="ink"]');
  assert.deepEqual((await taken())[0][1], ["look:ink"]);
  // One that can be shown keeps the kind that it can have.
  await page.setInputFiles("#file", { name: "b.spz", mimeType: "", buffer: Buffer.alloc(100) });
  await page.waitForFunction(() => calls.length === 2);
  await page.evaluate(() => { tell("loaded", "7 false"); tell("failed", "no such style"); });
  assert.equal(await page.inputValue("#kind"), "paint");
  assert.deepEqual(errors, []);
});

test("a file that is too large is refused before it is read, and one that cannot be read is told", async () => {
  const { page, errors, taken } = await opened();
  await taken();
  const file = { name: "large.ply", mimeType: "", buffer: Buffer.alloc(1) };
  const until = (text) => page.waitForFunction(
    (text) => document.getElementById("notice").textContent === text, text,
  );
  await page.evaluate(() => {
    globalThis.size = 3e9;
    Object.defineProperty(Blob.prototype, "size", { get: () => size });
    Blob.prototype.arrayBuffer = async () => { throw new DOMException("the disk is gone"); };
  });
  await page.setInputFiles("#file", file);
  await until("large.ply: found 3.0 GB, expected at most 1.5 GB");
  await page.evaluate(() => { size = 1e9; });
  await page.setInputFiles("#file", []);
  await page.setInputFiles("#file", file);
  await until("large.ply: the disk is gone");
  // The scene stays, in its style.
  assert.deepEqual(await taken(), []);
  assert.equal(await page.inputValue("#kind"), "look");
  assert.deepEqual(errors, []);
});

test("a link names a world beside the page, and no other host's", async () => {
  const { page, errors, taken } = await opened("#world=city/lod-meta.json", undefined, "set_screen_stable");
  assert.deepEqual(await taken(), [["open_world", `${server.url}city/lod-meta.json`], ...BEGINNING.slice(1)]);
  await page.evaluate(() => tell("loaded", "9 false"));
  assert.equal(await page.getAttribute("body", "data-scene"), "9");
  // It is painted: looks are of the demo scene.
  await page.click('[data-style="ink"]');
  assert.deepEqual(await taken(), [["set_style", ["paint:ink.jpg"], [1], 0, 1, false]]);
  const link = new URLSearchParams(new URL(page.url()).hash.slice(1));
  assert.deepEqual([link.get("world"), link.get("style")], ["city/lod-meta.json", "ink"]);
  const elsewhere = await opened("#world=https://b.org/city/lod-meta.json");
  assert.deepEqual(await elsewhere.taken(), BEGINNING);
  assert.deepEqual([...errors, ...elsewhere.errors], []);
});

test("an app that stops is told, with the memory that it had", async () => {
  const { page, errors } = await opened();
  await page.evaluate(() => { setTimeout(() => { throw new WebAssembly.RuntimeError("unreachable"); }); });
  await page.waitForSelector('body[data-state="failed"]');
  const stopped = /has stopped \(unreachable, with 2\.0 of 4 GB in use\)\. Reload the page/;
  assert.match(await page.textContent("#notice"), stopped);
  // Errors of the page's own script are no end of the app.
  await page.evaluate(() => {
    document.getElementById("notice").textContent = "";
    setTimeout(() => { throw new Error("another"); });
  });
  await page.waitForTimeout(100);
  assert.equal(await page.textContent("#notice"), "");
  assert.equal(errors.length, 2, errors.join());
});

test("strokes are drawn as sliders say, which are in the link and restyle nothing", async () => {
  const { page, errors, taken } = await opened();
  await page.click('[data-style="ink"]');
  await taken();
  await page.fill("#paint", "0.5");
  await page.focus("#protection");
  await page.keyboard.press("ArrowRight");
  await page.fill("#stroke_scale", "2");
  assert.deepEqual(await taken(), [
    ["set_strokes", 0.5, 1, 1], ["set_strokes", 0.5, 1.05, 1], ["set_strokes", 0.5, 1.05, 2],
  ]);
  for (const name of ["Strokes", "Kept clear", "Stroke size"]) {
    assert.equal(await page.getByRole("slider", { name }).count(), 1, name);
  }
  const again = await opened(new URL(page.url()).hash);
  assert.deepEqual((await again.taken())[1], ["set_strokes", 0.5, 1.05, 2]);
  assert.equal(await again.page.inputValue("#stroke_scale"), "2");
  const beyond = await opened("#style=ink&paint=9&protection=-1&stroke_scale=NaN");
  assert.deepEqual((await beyond.taken())[1], ["set_strokes", 1, 1, 1]);
  assert.deepEqual([...errors, ...again.errors, ...beyond.errors], []);
});

test("strokes move, have a thickness and keep their size as controls say, which are in the link", async () => {
  const { page, errors, taken } = await opened();
  await page.click('[data-style="ink"]');
  await taken();
  // What would do nothing is not shown.
  for (const id of ["rate", "distance", "light_from"]) assert.ok(await page.isHidden(`#${id}`), id);
  await page.selectOption("#motion", "flow");
  await page.focus("#rate");
  await page.keyboard.press("ArrowRight");
  await page.fill("#distance", "3");
  await page.fill("#relief", "1.5");
  await page.fill("#light_from", "90");
  await page.focus("#screen_stable");
  await page.keyboard.press("Space");
  assert.deepEqual(await taken(), [
    ["set_motion", "flow", 0.5, 2], ["set_motion", "flow", 0.6, 2], ["set_motion", "flow", 0.6, 3],
    ["set_relief", 1.5, 0], ["set_relief", 1.5, 90], ["set_screen_stable", true],
  ]);
  for (const name of ["Times a second", "How far", "Thickness", "Light from"]) {
    assert.equal(await page.getByRole("slider", { name }).count(), 1, name);
  }
  assert.equal(await page.getByRole("checkbox", { name: "Of one size" }).count(), 1);
  assert.equal(await page.getByRole("combobox", { name: "Strokes are" }).count(), 1);
  const asked = [
    ["set_strokes", 1, 1, 1], ["set_motion", "flow", 0.6, 3], ["set_relief", 1.5, 90],
    ["set_screen_stable", true],
  ];
  const again = await opened(new URL(page.url()).hash);
  assert.deepEqual((await again.taken()).slice(1, 5), asked);
  const values = [await again.page.inputValue("#motion"), await again.page.inputValue("#rate")];
  assert.deepEqual(values, ["flow", "0.6"]);
  assert.ok(await again.page.isVisible("#light_from") && await again.page.isChecked("#screen_stable"));
  // Another motion has rates of its own.
  await page.selectOption("#motion", "boil");
  assert.deepEqual(await taken(), [["set_motion", "boil", 8, 0.5]]);
  const wrong = "motion=toString&rate=-1&distance=99&relief=NaN&light_from=361&screen_stable=1";
  const beyond = await opened(`#style=ink&${wrong}`);
  assert.deepEqual((await beyond.taken()).slice(0, 5), BEGINNING);
  const fast = await opened("#style=ink&motion=flow&rate=20");
  assert.deepEqual((await fast.taken())[2], ["set_motion", "flow", 0.5, 2]);
  assert.deepEqual([...errors, ...again.errors, ...beyond.errors, ...fast.errors], []);
});

test("a capture without features is painted, and embedded only for the decoder", async () => {
  const { page, errors, taken } = await opened();
  await taken();
  await page.evaluate(() => tell("loaded", "7 false"));
  assert.ok(await page.isHidden("#embed"));
  assert.equal(await page.textContent("#notice"), "");
  await page.selectOption("#kind", "paint");
  await page.click('[data-style="ink"]');
  assert.deepEqual((await taken()).at(-1), ["set_style", ["paint:ink.jpg"], [1], 0, 1, false]);
  assert.ok(await page.isHidden("#embed"));
  // The decoder waits for features, and nothing else does.
  await page.selectOption("#kind", "decode");
  assert.match(await page.textContent("#notice"), /no features/);
  await page.click("#embed");
  await page.selectOption("#kind", "paint");
  assert.ok(await page.isHidden("#embed"));
  await page.selectOption("#kind", "decode");
  assert.equal(await page.textContent("#embed"), "Embed it");
  assert.deepEqual(await taken(), [
    ["set_style", [], [], 0, 1, true], ["embed_soon"], ["cancel_embedding"],
    ["set_style", ["paint:ink.jpg"], [1], 0, 1, false], ["set_style", [], [], 0, 1, true],
  ]);
  await page.evaluate(() => tell("loaded", "7 true"));
  assert.deepEqual(await taken(), [["set_style", ["decode:ink"], [1], 0, 1, true]]);
  assert.ok(await page.isHidden("#embed"));
  assert.equal(await page.textContent("#notice"), "");
  assert.deepEqual(errors, []);
});

test("a capture without features is embedded on request, with progress and an end", async () => {
  const { page, errors, taken } = await opened();
  await page.selectOption("#kind", "decode");
  await taken();
  assert.ok(await page.isHidden("#embed"));
  await page.evaluate(() => tell("loaded", "7 false"));
  await page.click("#embed");
  await page.evaluate(() => tell("progress", "embedding 0.420"));
  assert.equal(await page.evaluate(() => document.getElementById("progress").value), 0.42);
  assert.match(await page.textContent("#notice"), /Embedding/);
  await page.click("#embed");
  assert.deepEqual(await taken(), [["embed_soon"], ["cancel_embedding"]]);
  await page.click("#embed");
  await page.evaluate(() => tell("failed", "the capture has no colors to learn features from"));
  assert.equal(await page.textContent("#embed"), "Embed it");
  await page.click("#embed");
  await page.evaluate(() => tell("loaded", "7 true"));
  assert.ok(await page.isHidden("#embed"));
  assert.deepEqual(errors, []);
});

test("a .glb is saved, and styles arrive in shapes", async () => {
  const { page, errors, taken } = await opened();
  await taken();
  await page.selectOption("#arrives", "noise");
  await page.click("#save_glb");
  assert.deepEqual(await taken(), [["set_transition", "noise", 1.5], ["save_glb_soon"]]);
  assert.deepEqual(errors, []);
});

test("keys and drags steer the camera", async () => {
  const { page, errors, taken } = await opened();
  await taken();
  await page.focus("#stage");
  for (const key of ["ArrowLeft", "+", "w"]) await page.keyboard.press(key);
  await page.mouse.move(100, 100);
  await page.mouse.down();
  await page.mouse.move(150, 100);
  await page.mouse.up();
  await page.mouse.move(200, 200);
  const [turned, zoomed, flown, ...dragged] = await taken();
  assert.deepEqual([turned, zoomed, flown], [["turn", -0.1, 0], ["zoom", 0.9], ["fly", 0, 0, -0.05]]);
  assert.equal(dragged.length, 1);
  assert.ok(Math.abs(dragged[0][1] + 50 * 0.006) < 1e-9);
  assert.deepEqual(errors, []);
});

test("a keyboard alone reaches everything", async () => {
  const { page } = await opened("#motion=boil&relief=1");
  const reached = new Set();
  for (let presses = 0; presses < 50; presses += 1) {
    await page.keyboard.press("Tab");
    reached.add(await page.evaluate(() => document.activeElement.id || document.activeElement.dataset.style));
  }
  const all = [
    "stage", "ink", "kind", "second", "share", "strength", "paint", "protection", "stroke_scale", "motion",
    "rate", "distance", "relief", "light_from", "screen_stable", "arrives", "file", "save", "save_glb", "link",
  ];
  for (const name of all) {
    assert.ok(reached.has(name), `${name} is not among ${[...reached]}`);
  }
});

test("the page fits a phone of 360 px", async () => {
  const { page } = await opened("", { width: 360, height: 740 });
  assert.equal(await page.evaluate(() => document.documentElement.scrollWidth), 360);
  const stage = await page.locator("#stage").boundingBox();
  assert.ok(stage.width === 360 && stage.height > 300, JSON.stringify(stage));
});

test("without WebGPU, a sentence says so", async () => {
  const plain = await launch(["--disable-features=WebGPU"]);
  const page = await plain.newPage();
  await page.addInitScript(() => Object.defineProperty(navigator, "gpu", { value: undefined }));
  await page.goto(server.url);
  await page.waitForSelector('body[data-state="failed"]');
  assert.match(await page.textContent("#notice"), /no WebGPU/);
  await plain.close();
});
