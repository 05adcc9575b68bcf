// An example that `cargo xtask web --example NAME` has built, whose first style is painted, in headless
// Chromium: frames while the browser's worker lays paint on, and without a worker.
//
//   node --test web/test/game.mjs

import assert from "node:assert/strict";
import { after, before, test } from "node:test";
import { errorsOf, launch, serve } from "./browser.mjs";

const options = { timeout: 600_000 };
let browser, server;

before(async () => {
  browser = await launch();
  server = await serve(["web/dist"]);
});
after(async () => {
  await browser?.close();
  server?.close();
});

// Notes what the worker is asked and answers, and the script's long tasks.
function watch({ isForbidden }) {
  globalThis.watched = { calls: [], answers: [], tasks: [], frames: 0 };
  const observer = new PerformanceObserver((list) => {
    watched.tasks.push(...list.getEntries().map(({ startTime, duration }) => [startTime, duration]));
  });
  observer.observe({ type: "longtask" });
  const tick = () => {
    watched.frames += 1;
    requestAnimationFrame(tick);
  };
  requestAnimationFrame(tick);
  globalThis.Worker = class extends Worker {
    constructor(...given) {
      if (isForbidden) throw new Error("forbidden by a test");
      super(...given);
      this.addEventListener("message", ({ data }) => {
        const [size, text] = [data.answer?.byteLength ?? 0, data.error ?? data.stopped];
        watched.answers.push({ at: performance.now(), size, text });
      });
    }
    postMessage(message, ...given) {
      const { call } = message;
      if (call) watched.calls.push({ at: performance.now(), frames: watched.frames, size: call.byteLength });
      super.postMessage(message, ...given);
    }
  };
}

async function opened(isForbidden) {
  const page = await browser.newPage({ viewport: { width: 320, height: 240 } });
  page.setDefaultTimeout(options.timeout);
  const errors = errorsOf(page);
  await page.addInitScript(watch, { isForbidden });
  await page.goto(server.url);
  return { page, errors };
}

test("frames keep coming while the first style is painted", options, async () => {
  const { page, errors } = await opened(false);
  // The answer with colors, strokes and textures.
  await page.waitForFunction(() => watched.answers.some(({ text, size }) => text || size > 1e6));
  const painting = await page.evaluate(() => ({ ...watched }));
  // What comes of the answer takes a few frames.
  await page.waitForFunction((frames) => watched.frames >= frames + 4, painting.frames);
  const { calls, answers, tasks } = await page.evaluate(() => watched);
  assert.deepEqual(answers.filter(({ text }) => text), []);
  const [begun, ended] = [calls[0].at, answers.find(({ size }) => size > 1e6).at];
  const during = tasks.filter(([at, duration]) => at + duration > begun);
  const longest = Math.max(0, ...during.map(([, duration]) => duration));
  const n_frames = painting.frames - calls[0].frames;
  const took = `painted in ${(ended - begun).toFixed(0)} ms, in which ${n_frames} frames came`;
  console.log(`${took}; the script's longest task takes ${longest} ms`);
  assert.ok(n_frames >= 4, `found ${n_frames} frames while it was painted`);
  assert.ok(longest <= 0.1 * (ended - begun) + 100, `found a task of ${longest} ms`);
  assert.deepEqual(errors, []);
  await page.close();
});

test("without a worker, the first style is painted between frames", options, async () => {
  const { page, errors } = await opened(true);
  let warned = false;
  page.on("console", (message) => { warned ||= message.text().includes("no worker"); });
  // Nothing is seen before. An empty page is a small file.
  const empty = (await page.screenshot()).length;
  while ((await page.screenshot()).length < 4 * empty) await page.waitForTimeout(500);
  const frames = await page.evaluate(() => watched.frames);
  await page.waitForFunction((frames) => watched.frames >= frames + 4, frames);
  assert.ok(warned, "nobody said that there is no worker");
  assert.deepEqual(errors, []);
  await page.close();
});
