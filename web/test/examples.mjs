// The custom element with the app that `cargo xtask web` has built, on a plain page and in React, in headless
// Chromium; and what the package of it holds.
//
//   node --test web/test/examples.mjs        PICTURES=FOLDER keeps the pictures

import assert from "node:assert/strict";
import { execFileSync } from "node:child_process";
import { existsSync, mkdirSync, mkdtempSync, readFileSync, writeFileSync } from "node:fs";
import { tmpdir } from "node:os";
import { join } from "node:path";
import { after, before, test } from "node:test";
import { errorsOf, launch, serve } from "./browser.mjs";

// A frame of SwiftShader takes up to seconds on few cores, and paint a minute.
const timeout = 300_000;
const folder = process.env.PICTURES ?? mkdtempSync(join(tmpdir(), "stylegaussian-web-"));
mkdirSync(folder, { recursive: true });
let browser, server;

before(async () => {
  browser = await launch();
  server = await serve(["web/dist"]);
});
after(async () => {
  await browser?.close();
  server?.close();
});

// Mean and deviation of the element's picture, 0..255.
async function drawn(page, name) {
  const picture = await page.locator("styled-splats").screenshot({ timeout });
  writeFileSync(join(folder, `${name}.png`), picture);
  return page.evaluate(async (base64) => {
    const bitmap = await createImageBitmap(await (await fetch(`data:image/png;base64,${base64}`)).blob());
    const context = new OffscreenCanvas(bitmap.width, bitmap.height).getContext("2d");
    context.drawImage(bitmap, 0, 0);
    const { data } = context.getImageData(0, 0, bitmap.width, bitmap.height);
    const values = data.filter((_, i) => i % 4 < 3);
    const mean = values.reduce((sum, value) => sum + value, 0) / values.length;
    const squares = values.reduce((sum, value) => sum + (value - mean) ** 2, 0);
    return { mean, deviation: Math.sqrt(squares / values.length) };
  }, picture.toString("base64"));
}

for (const [name, press] of [["html", 'button[data-painting$="dots.jpg"]'], ["react", "#dots"]]) {
  const missing = name === "react" && !existsSync("web/dist/examples/react/main.js");
  const options = { timeout: 900_000, skip: missing && "esbuild is not installed" };
  test(`a painting and another one: ${name}`, options, async () => {
    const page = await browser.newPage({ viewport: { width: 500, height: 600 } });
    page.setDefaultTimeout(timeout);
    const errors = errorsOf(page);
    await page.addInitScript(() => {
      globalThis.applied = 0;
      addEventListener("applied", () => { applied += 1; }, true);
    });
    await page.goto(`${server.url}examples/${name}/index.html`);
    await page.waitForFunction(() => applied > 0);
    const first = await drawn(page, `${name}_ink`);
    assert.ok(first.deviation > 20, `blank: ${JSON.stringify(first)}`);
    const before = await page.evaluate(() => applied);
    await page.click(press);
    await page.waitForFunction((before) => applied > before, before);
    // The style arrives in a second.
    await page.waitForTimeout(5_000);
    const second = await drawn(page, `${name}_dots`);
    assert.ok(second.deviation > 20, `blank: ${JSON.stringify(second)}`);
    assert.ok(Math.abs(second.mean - first.mean) > 2, `the same picture: ${JSON.stringify([first, second])}`);
    assert.deepEqual(errors, []);
    await page.close();
  });
}

test("the package holds all that it loads, its types and its licenses", () => {
  const quiet = { cwd: "web/dist/package", stdio: ["ignore", "pipe", "ignore"] };
  const [pack] = JSON.parse(execFileSync("npm", ["pack", "--dry-run", "--json"], quiet));
  const found = new Set(pack.files.map(({ path }) => path));
  // In `app.js`, such a name may be that of a module's imports, which is no file.
  const scripts = [...found].filter((path) => path.endsWith(".js") && path !== "app.js");
  const loaded = scripts.flatMap((path) => {
    const text = readFileSync(join("web/dist/package", path), "utf8");
    return [...text.matchAll(/["']\.\/([\w.-]+)["']/g)].map(([, file]) => file);
  });
  const { exports, types } = JSON.parse(readFileSync("web/dist/package/package.json"));
  const entriesOf = (entry) => Object.values(typeof entry === "string" ? { entry } : entry);
  const entries = [types, ...Object.values(exports).flatMap(entriesOf)];
  const expected = [
    ...loaded, ...entries.map((path) => path.replace("./", "")),
    "README.md", "LICENSE-APACHE", "LICENSE-MIT", "NOTICE", "app_bg.wasm",
  ];
  for (const path of expected) assert.ok(found.has(path), `${path} is not among ${[...found]}`);
  assert.ok(loaded.includes("worker.js") && loaded.includes("app.js"), loaded.join());
  console.log(`npm pack: ${(pack.size / 1e6).toFixed(1)} MB, ${found.size} files`);
});
