// The page with the app, watched, and what a visitor does there.

import assert from "node:assert/strict";
import { errorsOf } from "./browser.mjs";

// A frame of SwiftShader takes up to seconds on few cores.
export const timeout = 240_000;

// Keeps the device, the worker, the colors' buffers and the times of frames and of the start at hand, without a
// part in the app for it.
function watch({ hasUsualLimits }) {
  globalThis.watched = { colors: [], frames: [], start: {} };
  const requestDevice = GPUAdapter.prototype.requestDevice;
  GPUAdapter.prototype.requestDevice = async function (description) {
    watched.start.adapter ??= performance.now();
    // Whoever names no limits gets WebGPU's default ones.
    const usual = hasUsualLimits ? { ...description, requiredLimits: {} } : description;
    const device = await requestDevice.call(this, usual);
    watched.device = device;
    const createBuffer = device.createBuffer;
    device.createBuffer = (description) => {
      const buffer = createBuffer.call(device, description);
      if (description.label === "gaussian_colors") watched.colors.push(buffer);
      return buffer;
    };
    return device;
  };
  globalThis.Worker = class extends Worker {
    constructor(...given) {
      super(...given);
      watched.worker = this;
    }
  };
  const instantiate = WebAssembly.instantiateStreaming;
  WebAssembly.instantiateStreaming = async (...given) => {
    watched.start.begun = performance.now();
    const done = await instantiate.apply(WebAssembly, given);
    watched.start.compiled = performance.now();
    return done;
  };
  new MutationObserver(() => {
    for (const [name, is] of Object.entries({ ready: "state", loaded: "scene", shown: "shown" })) {
      if (document.body?.dataset[is]) watched.start[name] ??= performance.now();
    }
  }).observe(document, { attributes: true, subtree: true });
  // As browsers do with a tab in the background, which a headless one lacks: no frames while it is hidden.
  const [request, cancel] = [requestAnimationFrame.bind(globalThis), cancelAnimationFrame.bind(globalThis)];
  // By their handles, which are below those of the browser.
  const held = new Map();
  let last = 0;
  globalThis.requestAnimationFrame = (draw) => {
    if (!watched.isHidden) return request(draw);
    held.set((last -= 1), draw);
    return last;
  };
  globalThis.cancelAnimationFrame = (handle) => held.delete(handle) || cancel(handle);
  watched.hide = (isHidden) => {
    watched.isHidden = isHidden;
    const get = () => (isHidden ? "hidden" : "visible");
    Object.defineProperty(document, "visibilityState", { configurable: true, get });
    document.dispatchEvent(new Event("visibilitychange"));
    if (!isHidden) held.forEach((draw) => request(draw));
    held.clear();
  };
  const tick = (time) => {
    watched.frames.push(time);
    requestAnimationFrame(tick);
  };
  requestAnimationFrame(tick);
}

// Seconds of CPU time that the browser's processes have taken, by their kind.
async function cpuTimes(browser) {
  const session = await browser.newBrowserCDPSession();
  const { processInfo } = await session.send("SystemInfo.getProcessInfo");
  await session.detach();
  const times = { renderer: 0, GPU: 0 };
  for (const { type, cpuTime } of processInfo) times[type] = (times[type] ?? 0) + cpuTime;
  return times;
}

// The page once its scene is drawn, and the errors on its console.
export async function openedIn(browser, url, viewport, { hasUsualLimits = false } = {}) {
  const page = await browser.newPage({ viewport });
  page.setDefaultTimeout(timeout);
  const errors = errorsOf(page);
  await page.addInitScript(watch, { hasUsualLimits });
  const before = await cpuTimes(browser);
  await page.goto(url);
  await page.waitForSelector("body[data-shown]", { state: "attached" });
  const [after, start] = [await cpuTimes(browser), await page.evaluate(() => watched.start)];
  const told = Object.entries(start).map(([name, time]) => `${name} ${(time / 1000).toFixed(2)}`).join(", ");
  const spent = (kind) => `${kind} ${(after[kind] - before[kind]).toFixed(2)}`;
  const size = `${viewport.width}x${viewport.height}`;
  const took = ["renderer", "GPU"].map(spent).join(", ");
  console.log(`${size}: start in s since the page was opened: ${told}; CPU time in s: ${took}`);
  return { page, errors };
}

// Drops a file on the page.
export const drop = (page, name, bytes) => page.evaluate(([name, text]) => {
  const bytes = Uint8Array.from(atob(text), (letter) => letter.charCodeAt(0));
  const dataTransfer = new DataTransfer();
  dataTransfer.items.add(new File([bytes], name));
  document.dispatchEvent(new DragEvent("drop", { dataTransfer, cancelable: true, bubbles: true }));
}, [name, bytes.toString("base64")]);

// Drops a `.splat` of n tiny Gaussians, which fill a cube.
export const dropCube = (page, name, n) => page.evaluate(([name, n]) => {
  const view = new DataView(new ArrayBuffer(32 * n));
  const side = Math.ceil(Math.cbrt(n));
  for (let i = 0; i < n; i += 1) {
    const place = [i % side, Math.floor(i / side) % side, Math.floor(i / side ** 2)];
    place.forEach((index, axis) => {
      view.setFloat32(32 * i + 4 * axis, index / side, true);
      view.setFloat32(32 * i + 12 + 4 * axis, 1e-4, true);
      view.setUint8(32 * i + 24 + axis, (256 * index) / side);
    });
    view.setUint8(32 * i + 27, 255);
    // The rotation is none: 1, 0, 0, 0.
    [255, 128, 128, 128].forEach((part, axis) => view.setUint8(32 * i + 28 + axis, part));
  }
  const dataTransfer = new DataTransfer();
  dataTransfer.items.add(new File([view], name));
  document.dispatchEvent(new DragEvent("drop", { dataTransfer, cancelable: true, bubbles: true }));
}, [name, n]);

// Until the page says something like this.
export const told = (page, pattern) => page.waitForFunction(
  (source) => new RegExp(source).test(document.getElementById("notice").textContent), pattern.source,
);

// Until the style of this name is on the scene.
export async function applied(page, style) {
  await page.waitForSelector(`[data-style="${style}"][aria-pressed="true"]`);
  await page.waitForSelector('body:is([data-state="applied"], [data-state="failed"])');
  assert.equal(await page.getAttribute("body", "data-state"), "applied", await page.textContent("#notice"));
}

export async function clicked(page, style) {
  await page.click(`[data-style="${style}"]`);
  await applied(page, style);
}

// Until a scene of n Gaussians is drawn.
export const shown = (page, n) => page.waitForSelector(`body[data-shown="${n}"]`, { state: "attached" });

// Drops a scene of n Gaussians, until it is drawn. The one before may have as many.
export async function dropScene(page, name, bytes, n) {
  await page.evaluate(() => delete document.body.dataset.shown);
  await drop(page, name, bytes);
  await shown(page, n);
}
