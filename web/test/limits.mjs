// The page that `cargo xtask web` has built at its limits, in headless Chromium: memory that runs out, a GPU
// that is lost, large scenes, a page in the background. Each time the page says a sentence, and goes on.
//
//   node --test web/test/limits.mjs

import assert from "node:assert/strict";
import { mkdtempSync, readFileSync } from "node:fs";
import { tmpdir } from "node:os";
import { join } from "node:path";
import { after, afterEach, before, test } from "node:test";
import { launch, serve } from "./browser.mjs";
import { program, run } from "./native.mjs";
import { applied, clicked, drop, dropCube, dropScene, openedIn, shown, told } from "./watched.mjs";

const options = { timeout: 900_000 };
// Few pixels: pictures are not the subject.
const SIZE = { width: 360, height: 480 };
const N_DEMO = 69_714;
let browser, server, capture;

before(async () => {
  assert.ok(program(), "the native program is not built. Run: cargo build -p stylegaussian_cli");
  const file = join(mkdtempSync(join(tmpdir(), "stylegaussian-web-")), "capture.spz");
  run("convert", "assets/demo.sgs", file);
  capture = readFileSync(file);
  browser = await launch();
  server = await serve(["web/page", "web", "web/dist"]);
});
// One that has failed would draw beside the next one.
afterEach(() => Promise.all(browser.contexts().map((context) => context.close())));
after(async () => {
  await browser?.close();
  server?.close();
});

const opened = (given) => openedIn(browser, server.url, SIZE, given);
const isShown = (page) => page.getAttribute("body", "data-shown");

test("a GPU that is lost, or has no memory left", options, async () => {
  const { page, errors } = await opened();
  await page.evaluate(() => watched.device.destroy());
  await told(page, /took the GPU away/);
  // A click is answered by the new device.
  await clicked(page, "ink");
  await page.evaluate(() => {
    const error = new GPUOutOfMemoryError("a test");
    watched.device.dispatchEvent(new GPUUncapturedErrorEvent("uncapturederror", { error }));
  });
  await told(page, /GPU has no memory left/);
  await dropScene(page, "capture.spz", capture, N_DEMO);
  assert.deepEqual(errors, []);
});

test("a worker whose memory ends is replaced", options, async () => {
  const { page } = await opened();
  const worker = await page.evaluateHandle(() => watched.worker);
  // Before the capture, it is asked for more than a module can have.
  await page.evaluate(() => {
    const { worker } = watched;
    worker.postMessage = (message) => {
      const hold = { id: 0, call: "work_hold", given: [{ length: 2 ** 32 - 1 }] };
      if (message.call === "work_read") Worker.prototype.postMessage.call(worker, hold);
      Worker.prototype.postMessage.call(worker, message);
    };
  });
  await drop(page, "capture.spz", capture);
  await told(page, /worker has stopped \(unreachable, with [0-9.]+ of 4 GB in use\)/);
  assert.equal(await isShown(page), String(N_DEMO));
  assert.ok(await page.evaluate((worker) => watched.worker !== worker, worker));
  await clicked(page, "ink");
  await dropScene(page, "capture.spz", capture, N_DEMO);
});

test("a scene for which the page has no memory is refused", options, async () => {
  const { page, errors } = await opened();
  await page.evaluate(async () => {
    const { memory } = await (await import("./package/app.js")).default();
    const PAGE = 65_536;
    // All but 32 MB of what a module can have.
    memory.grow(2 ** 32 / PAGE - memory.buffer.byteLength / PAGE - 2 ** 25 / PAGE);
  });
  await dropCube(page, "cube.splat", 1_000_000);
  await told(page, /found no room for \d+ MB in the page's memory/);
  assert.equal(await isShown(page), String(N_DEMO));
  await clicked(page, "ink");
  assert.deepEqual(errors, []);
});

test("a page in the background ends its change of style when it is back", options, async () => {
  const { page, errors } = await opened();
  await page.selectOption("#kind", "paint");
  await page.click('[data-style="ink"]');
  await page.evaluate(() => {
    watched.frames.splice(0, watched.frames.length - 1);
    watched.hide(true);
  });
  await page.waitForTimeout(10_000);
  // The one that was kept, and the one that was under way.
  const frames = await page.evaluate(() => watched.frames.length);
  assert.ok(frames <= 2, `found ${frames - 1} frames while the page was hidden`);
  assert.equal(await page.getAttribute("body", "data-state"), "styling");
  await page.evaluate(() => watched.hide(false));
  await applied(page, "ink");
  assert.deepEqual(errors, []);
});

test("3 million Gaussians on WebGPU's default limits", options, async () => {
  const { page, errors } = await opened({ hasUsualLimits: true });
  assert.equal(await page.evaluate(() => watched.device.limits.maxStorageBufferBindingSize), 2 ** 27);
  const begun = performance.now();
  await dropCube(page, "cube.splat", 3_000_000);
  await shown(page, 3_000_000);
  const used = await page.evaluate(async () => {
    const app = await import("./package/app.js");
    return (await app.default()).memory.buffer.byteLength;
  });
  const [seconds, gigabytes] = [((performance.now() - begun) / 1000).toFixed(1), (used / 1e9).toFixed(2)];
  console.log(`3 million Gaussians are drawn ${seconds} s after the drop, with ${gigabytes} GB in use`);
  // SwiftShader takes minutes for a few of its frames, so the camera leaves it behind.
  const camera = () => page.evaluate(async () => (await import("./package/app.js")).cameras());
  const before = await camera();
  await page.evaluate(async () => (await import("./package/app.js")).fly(0, 0, -10));
  await page.waitForFunction(async (before) => (await import("./package/app.js")).cameras() !== before, before);
  await dropScene(page, "capture.spz", capture, N_DEMO);
  assert.deepEqual(errors, []);
});
