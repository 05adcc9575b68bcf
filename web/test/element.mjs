// The custom element with a stand-in for the app, which notes what is asked of it: attributes, events,
// failures, coming and going.
//
//   node --test web/test/element.mjs

import assert from "node:assert/strict";
import { after, before, test } from "node:test";
import { errorsOf, launch, serve } from "./browser.mjs";

const STAND_IN = `
  const noted = (v) => (v?.byteLength > 99 ? v.byteLength : ArrayBuffer.isView(v) ? [...v] : v);
  const note = (name) => (...given) => calls.push([name, ...given.map(noted)]);
  globalThis.calls = [];
  export default async () => {};
  export const listen = (listener) => { globalThis.tell = listener; listener("ready", ""); };
  export const use_worker = () => {};
  export const [
    open_file, open_world, add_painting, set_style, set_strokes, set_transition,
    embed_soon, cancel_embedding, turn, save_picture_soon, save_glb_soon,
  ] = [
    "open_file", "open_world", "add_painting", "set_style", "set_strokes", "set_transition",
    "embed_soon", "cancel_embedding", "turn", "save_picture_soon", "save_glb_soon",
  ].map(note);
`;
const page = (body) => `<!doctype html><meta charset="utf-8"><link rel="icon" href="data:,">
  <script>
    globalThis.heard = [];
    for (const kind of ["ready", "loaded", "shown", "applied", "progress", "failed"]) {
      addEventListener(kind, (event) => heard.push([kind, event.detail]), true);
    }
  </script>
  <script type="module" src="package/styled-splats.js"></script>${body}`;
const element = (id) => `<styled-splats id="${id}" src="a.spz"></styled-splats>`;
const INK = 'painting="assets/styles/ink.jpg"';
const PAGES = {
  "/usual.html": page(`<styled-splats src="a.spz" ${INK} strength="0.5">a garden</styled-splats>`),
  "/wrong.html": page('<styled-splats src="none.spz" method="oil" seconds="-1" paint="4"></styled-splats>'),
  "/two.html": page(`${element("one")}${element("two")}`),
  "/world.html": page(`<styled-splats src="city/lod-meta.json" ${INK}></styled-splats>`),
  "/a.spz": "x".repeat(100),
  "/package/app.js": STAND_IN,
  "/package/app_bg.wasm": "-",
};
let browser, server;
before(async () => {
  browser = await launch();
  server = await serve(["web", "."], PAGES);
});
after(async () => {
  await browser?.close();
  server?.close();
});

async function opened(path) {
  const page = await browser.newPage();
  const errors = errorsOf(page);
  await page.goto(server.url + path);
  const until = (n) => page.waitForFunction((n) => globalThis.calls?.length >= n, n);
  const taken = () => page.evaluate(() => calls.splice(0));
  return { page, errors, until, taken };
}

const visibility = (page) => page.evaluate(() => getComputedStyle(document.querySelector("canvas")).visibility);

// Sets properties of the page's element.
const assign = (page, given) => page.evaluate((given) => {
  Object.assign(document.querySelector("styled-splats"), given);
}, given);

test("attributes become a scene and a style, and changes of them restyle", async () => {
  const { page, errors, until, taken } = await opened("usual.html");
  await until(4);
  const first = Object.fromEntries((await taken()).map(([name, ...given]) => [name, given]));
  assert.deepEqual(first.set_transition, ["fade", 1]);
  assert.deepEqual(first.set_strokes, [1, 1, 1]);
  assert.deepEqual(first.open_file, ["a.spz", 100]);
  assert.equal(first.add_painting[0], "ink.jpg");
  assert.equal(first.set_style, undefined, "before there is a scene");
  // What is in the element is seen until the scene is.
  assert.equal(await visibility(page), "hidden");
  await page.evaluate(() => { tell("loaded", "7 true"); tell("shown", ""); tell("applied", "12"); });
  assert.deepEqual(await taken(), [["set_style", ["image:ink.jpg"], [1], 0, 0.5, false]]);
  assert.equal(await visibility(page), "visible");
  const heard = await page.evaluate(() => heard);
  assert.deepEqual(heard.filter(([kind]) => kind !== "progress"), [
    ["ready", {}], ["loaded", { gaussians: 7, hasFeatures: true }], ["shown", {}],
    ["applied", { milliseconds: 12 }],
  ]);

  assert.deepEqual(await page.evaluate(() => {
    const element = document.querySelector("styled-splats");
    const { src, painting, strength, method, paint, protection, strokeScale, transition, seconds } = element;
    return { src, painting, strength, method, paint, protection, strokeScale, transition, seconds };
  }), {
    src: "a.spz", painting: "assets/styles/ink.jpg", strength: 0.5, method: "strokes",
    paint: 1, protection: 1, strokeScale: 1, transition: "fade", seconds: 1,
  });
  await assign(page, { paint: 0.5, strokeScale: 2 });
  assert.deepEqual(await taken(), [["set_strokes", 0.5, 1, 1], ["set_strokes", 0.5, 1, 2]], "and no style");
  await assign(page, { strength: 1, method: "decoder" });
  await assign(page, { painting: "" });
  await assign(page, { transition: "noise" });
  assert.deepEqual(await taken(), [
    ["set_style", ["image:ink.jpg"], [1], 0, 1, false],
    ["set_style", ["image:ink.jpg"], [1], 0, 1, true],
    ["set_style", [], [], 0, 1, true],
    ["set_transition", "noise", 1],
  ]);
  await page.focus("styled-splats");
  await page.keyboard.press("ArrowLeft");
  await page.evaluate(() => document.querySelector("styled-splats").saveGlb());
  assert.deepEqual(await taken(), [["turn", -0.1, 0], ["save_glb_soon"]]);
  assert.deepEqual(errors, []);
});

test("a scene without features is painted, and embedded if the decoder is asked for", async () => {
  const { page, until, taken } = await opened("usual.html");
  await until(4);
  await taken();
  await page.evaluate(() => tell("loaded", "7 false"));
  assert.deepEqual(await taken(), [["set_style", ["image:ink.jpg"], [1], 0, 0.5, false]]);
  const use = (method) => assign(page, { method });
  await use("decoder");
  assert.deepEqual(await taken(), [["embed_soon"]]);
  // Strokes wait for no features.
  await use("strokes");
  assert.deepEqual((await taken()).map(([name]) => name), ["cancel_embedding", "set_style"]);
  await use("decoder");
  await page.evaluate(() => { tell("progress", "embedding 0.5"); tell("loaded", "7 true"); });
  assert.deepEqual(await taken(), [["embed_soon"], ["set_style", ["image:ink.jpg"], [1], 0, 0.5, true]]);
  // So is one whose painting comes later.
  await page.evaluate(() => {
    document.querySelector("styled-splats").painting = "";
    tell("loaded", "8 false");
  });
  const asked = (await taken()).map(([name, names]) => [name, names]);
  assert.deepEqual(asked, [["set_style", []], ["set_style", []]]);
  await assign(page, { painting: "assets/styles/dots.jpg" });
  await until(2);
  assert.deepEqual((await taken()).map(([name]) => name), ["add_painting", "embed_soon"]);
  const progress = await page.evaluate(() => heard.filter(([kind]) => kind === "progress").at(-1));
  assert.deepEqual(progress, ["progress", { task: "embedding", share: 0.5 }]);
});

test("a world is the app's to fetch", async () => {
  const { page, errors, until, taken } = await opened("world.html");
  await until(4);
  const first = Object.fromEntries((await taken()).map(([name, ...given]) => [name, given]));
  assert.deepEqual(first.open_world, [`${server.url}city/lod-meta.json`]);
  assert.equal(first.open_file, undefined);
  await page.evaluate(() => tell("loaded", "9 false"));
  assert.deepEqual(await taken(), [["set_style", ["image:ink.jpg"], [1], 0, 1, false]]);
  // It stays, with its style, if the next address is none.
  await assign(page, { src: "http://[/lod-meta.json", strength: 0.5 });
  assert.deepEqual(await taken(), [["set_style", ["image:ink.jpg"], [1], 0, 0.5, false]]);
  assert.match((await page.evaluate(() => heard.at(-1)))[1].message, /found no address/);
  // A file takes its place, and a world that of the file.
  await assign(page, { src: "a.spz" });
  await until(1);
  assert.deepEqual(await taken(), [["open_file", "a.spz", 100]]);
  await page.evaluate(() => {
    const element = document.querySelector("styled-splats");
    element.src = "a.spz";
    element.src = "town/lod-meta.json?v=2";
  });
  await until(1);
  // What was fetched for the address before comes too late.
  await page.waitForTimeout(300);
  assert.deepEqual(await taken(), [["open_world", `${server.url}town/lod-meta.json?v=2`]]);
  assert.deepEqual(errors, []);
});

test("what is wrong is told in a sentence", async () => {
  const { page, until } = await opened("wrong.html");
  await until(1);
  await page.waitForFunction(() => heard.some(([, detail]) => detail.message?.includes("none.spz")));
  const heard = await page.evaluate(() => heard);
  const failed = heard.filter(([kind]) => kind === "failed").map(([, { message }]) => message);
  assert.ok(failed.some((message) => message.includes('seconds="-1"')), failed.join());
  const wrong = 'paint="4", expected a number from 0 to 3';
  assert.ok(failed.some((message) => message.includes(wrong)), failed.join());
  assert.ok(failed.some((message) => message.includes("404")), failed.join());
  await page.evaluate(() => tell("loaded", "7 true"));
  const last = await page.evaluate(() => heard.at(-1));
  assert.match(last[1].message, /method="oil", expected strokes, decoder/);
});

test("a page has one; another takes its place, and it may come back", async () => {
  const { page, until, taken } = await opened("two.html");
  await until(3);
  await taken();
  const [, failed] = await page.evaluate(() => heard.find(([kind]) => kind === "failed"));
  assert.match(failed.message, /second <styled-splats>/);
  await page.evaluate(() => {
    tell("loaded", "7 true");
    globalThis.one = document.getElementById("one");
    one.remove();
  });
  await page.evaluate(() => document.body.append(document.getElementById("two")));
  await until(3);
  const names = (await taken()).map(([name]) => name).sort();
  assert.deepEqual(names, ["open_file", "set_strokes", "set_style", "set_transition"]);
  assert.equal(await page.evaluate(() => document.querySelector("canvas").parentElement.id), "two");
  await page.evaluate(() => { document.getElementById("two").remove(); document.body.append(one); });
  await until(3);
  assert.equal(await page.evaluate(() => document.querySelector("canvas").parentElement.id), "one");
});

test("without WebGPU, a sentence says so and the page's own content stays", async () => {
  const plain = await launch(["--disable-features=WebGPU"]);
  const page = await plain.newPage();
  await page.addInitScript(() => Object.defineProperty(navigator, "gpu", { value: undefined }));
  await page.goto(`${server.url}usual.html`);
  await page.waitForFunction(() => heard.length > 0);
  assert.match((await page.evaluate(() => heard[0]))[1].message, /no WebGPU/);
  assert.equal((await page.textContent("styled-splats")).trim(), "a garden");
  assert.equal(await visibility(page), "hidden");
  await plain.close();
});
