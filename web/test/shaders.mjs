// Every shader through a browser's own compiler, which differs from the one that native apps use; and the needs
// of every shader beside the limits that each browser with WebGPU grants.
//
//   cargo run -p stylegaussian_shaders --example write_sources FOLDER && node web/test/shaders.mjs FOLDER

import { readdirSync, readFileSync } from "node:fs";
import { join } from "node:path";
import { launch, serve } from "./browser.mjs";

// Of https://www.w3.org/TR/webgpu/#limits.
const STORAGE_BUFFERS = 8;
// Two eyes of a masked scene are projected at once only where a device grants one more (`binds_masks` in the
// crate of the GPU).
const isMaskedPair = (code) => code.includes("other_geometry_halves") && /var<storage, read> mask\b/.test(code);
const mostBuffers = (code) => STORAGE_BUFFERS + (isMaskedPair(code) ? 1 : 0);
const folder = process.argv[2];
const browser = await launch();
const server = await serve([], { "/index.html": "<title>shaders</title>" });
const page = await browser.newPage();
await page.goto(server.url);
const hasDevice = await page.evaluate(async () => {
  globalThis.device = await (await navigator.gpu?.requestAdapter())?.requestDevice();
  return device !== undefined;
});
if (!hasDevice) throw new Error("this browser has no WebGPU");
const compile = async (code) => {
  device.pushErrorScope("validation");
  const module = device.createShaderModule({ code });
  const { messages } = await module.getCompilationInfo();
  const error = await device.popErrorScope();
  return error && [error.message, ...messages.map((m) => `${m.lineNum}:${m.linePos} ${m.message}`)].join("\n");
};
// A test that finds no error in broken text would find none in ours.
if ((await page.evaluate(compile, "fn broken(")) === null) throw new Error("the browser takes a broken shader");
const names = readdirSync(folder).filter((name) => name.endsWith(".wgsl"));
if (names.length === 0) throw new Error(`${folder} holds no .wgsl files`);
let failures = 0;
for (const name of names) {
  const code = readFileSync(join(folder, name), "utf8");
  const error = await page.evaluate(compile, code);
  const buffers = code.match(/var<storage/g)?.length ?? 0;
  if (error) console.error(`${name}: ${error}`);
  const most = mostBuffers(code);
  if (buffers > most) console.error(`${name}: found ${buffers} storage buffers, expected at most ${most}`);
  failures += error !== null || buffers > most ? 1 : 0;
}
await browser.close();
server.close();
console.log(`${names.length} shaders, ${failures} refused`);
process.exit(failures ? 1 : 0);
