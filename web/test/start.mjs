// What the start of the built page takes, by Chromium's own trace: CPU time of the page's thread, of its other
// threads, and of the GPU's process, which compiles shaders and, with SwiftShader, also draws. It is no test.
//
//   node web/test/start.mjs

import { launch, serve } from "./browser.mjs";
import { openedIn } from "./watched.mjs";

const CATEGORIES = ["toplevel", "gpu", "gpu.dawn", "disabled-by-default-gpu.dawn", "v8", "v8.wasm"];
// Rows: which process, whether the page's thread alone (`CrRendererMain`), and the name of the event.
const ROWS = [
  ["the page's thread, all", "Renderer", true, /RunTask$/],
  ["the page's thread, calls of scripts and of the module", "Renderer", true, /^v8\.callFunction$/],
  ["the module's functions, compiled at their first call", "Renderer", true, /^wasm\.CompileLazy$/],
  ["the module, optimized by other threads", "Renderer", false, /^wasm\.TopTierCompilation$/],
  ["WebGPU's commands, all", "GPU Process", false, /HandleDawnCommands$/],
  ["compute pipelines", "GPU Process", false, /APICreateComputePipeline/],
  ["render pipelines", "GPU Process", false, /APICreateRenderPipeline/],
  ["shader modules, read", "GPU Process", false, /APICreateShaderModule/],
  ["shaders, written for the driver", "GPU Process", false, /spirv::writer::Generate/],
];

const server = await serve(["web/page", "web", "web/dist"]);
const browser = await launch();
const session = await browser.newBrowserCDPSession();
const events = [];
session.on("Tracing.dataCollected", ({ value }) => events.push(...value));
await session.send("Tracing.start", {
  transferMode: "ReportEvents", traceConfig: { includedCategories: CATEGORIES },
});
await openedIn(browser, server.url, { width: 600, height: 400 });
const complete = new Promise((done) => { session.on("Tracing.tracingComplete", done); });
await session.send("Tracing.end");
await complete;
await browser.close();
server.close();

const named = (kind) => {
  const key = ({ pid, tid }) => (kind === "thread_name" ? `${pid} ${tid}` : pid);
  const entries = events.filter(({ name }) => name === kind).map((event) => [key(event), event.args.name]);
  return new Map(entries);
};
const [processes, threads] = [named("process_name"), named("thread_name")];
for (const [label, process, isMain, pattern] of ROWS) {
  // The CPU time of an event holds that of the events in it; only the outermost ones of a kind count.
  const ends = new Map();
  let [n, milliseconds] = [0, 0];
  for (const { ph, pid, tid, name, ts, dur, tdur } of events.sort((a, b) => a.ts - b.ts)) {
    const thread = `${pid} ${tid}`;
    if (ph !== "X" || processes.get(pid) !== process || !pattern.test(name)) continue;
    if ((isMain && threads.get(thread) !== "CrRendererMain") || ts < (ends.get(thread) ?? 0)) continue;
    ends.set(thread, ts + dur);
    n += 1;
    milliseconds += (tdur ?? 0) / 1000;
  }
  console.log(`${milliseconds.toFixed(0).padStart(6)} ms  ${label} (${n})`);
}
