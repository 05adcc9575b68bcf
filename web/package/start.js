// The app's start: a check for WebGPU, the module with its progress, and the worker.

import { why } from "./why.js";

export class NoWebGpu extends Error {}

// Starts the app on the page's canvas `#scene`, and returns its module. `progress` hears of the share that is
// loaded, 0..1; `hear` of the app's events, and of its end.
export async function start(progress, hear) {
  if (!navigator.gpu || !(await navigator.gpu.requestAdapter())) {
    throw new NoWebGpu(
      "This browser has no WebGPU, which the scene is drawn with. " +
        "Chrome, Edge, Safari 26 and Firefox 141 or later have it.",
    );
  }
  const app = await import("./app.js");
  // A panic of the app, also if memory runs out, is an error of the script that called it. The page stays.
  let memory;
  const stopped = (error) => {
    if (!(error instanceof WebAssembly.RuntimeError)) return;
    hear("failed", `The app has stopped (${why(error, memory)}). Reload the page to go on.`);
  };
  window.addEventListener("error", (event) => stopped(event.error));
  window.addEventListener("unhandledrejection", (event) => stopped(event.reason));
  const loaded = await app.default({ module_or_path: fetchModule(progress) });
  memory = loaded?.memory;
  app.listen(hear);
  app.use_worker(() => new Worker(new URL("./worker.js", import.meta.url), { type: "module" }));
  return app;
}

// The module, with progress: it is the largest part of a page.
async function fetchModule(progress) {
  const response = await fetch(new URL("./app_bg.wasm", import.meta.url));
  if (!response.ok) throw new Error(`app_bg.wasm: the server answered ${response.status}`);
  const total = Number(response.headers.get("content-length"));
  // Behind compression, the length is that of the compressed module, and says nothing about what arrives.
  const isTold = total > 0 && !response.headers.get("content-encoding");
  let got = 0;
  const counted = new TransformStream({
    transform(chunk, controller) {
      got += chunk.byteLength;
      if (isTold) progress(got / total);
      controller.enqueue(chunk);
    },
  });
  return new Response(response.body.pipeThrough(counted), { headers: { "content-type": "application/wasm" } });
}
