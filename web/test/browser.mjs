// What the tests of the page share: a headless browser with WebGPU on the CPU, and a server of folders.

import { existsSync, readFileSync } from "node:fs";
import { createServer } from "node:http";
import { extname, join } from "node:path";
import { chromium } from "playwright-core";

const KINDS = {
  ".html": "text/html", ".js": "text/javascript", ".css": "text/css",
  ".wasm": "application/wasm", ".jpg": "image/jpeg", ".png": "image/png",
};

// SwiftShader is WebGPU without a GPU. A canvas needs it as the Vulkan of Chromium's own drawing too: what is
// drawn with the one must be readable by the other, or the device is lost at the first frame.
const SWIFTSHADER = [
  "--enable-unsafe-webgpu", "--use-webgpu-adapter=swiftshader",
  "--enable-features=Vulkan", "--use-vulkan=swiftshader", "--use-angle=swiftshader",
];

// Chromium by its path in CHROMIUM, or where Debian puts it.
export function launch(gpu = SWIFTSHADER) {
  const executablePath = process.env.CHROMIUM ?? "/usr/bin/chromium";
  return chromium.launch({ executablePath, headless: true, args: ["--no-sandbox", ...gpu] });
}

// Serves files of the first folder that has them. `files` are texts by path, which come before the folders.
export async function serve(folders, files = {}) {
  const server = createServer((request, response) => {
    const path = new URL(request.url, "http://localhost").pathname.replace(/\/$/, "/index.html");
    const found = folders.map((folder) => join(folder, path)).find((file) => existsSync(file));
    const body = files[path] ?? (found && readFileSync(found));
    const kind = KINDS[extname(path)] ?? "application/octet-stream";
    response.writeHead(body === undefined ? 404 : 200, { "content-type": kind });
    response.end(body);
  });
  await new Promise((listening) => server.listen(0, "127.0.0.1", listening));
  return { url: `http://127.0.0.1:${server.address().port}/`, close: () => server.close() };
}

// The errors of a page, from now on: those in its console, and those that nobody has caught.
export function errorsOf(page) {
  const errors = [];
  page.on("pageerror", (error) => errors.push(String(error)));
  page.on("console", (message) => {
    if (process.env.VERBOSE) console.log(`${message.type()}: ${message.text()}`);
    // Bevy asks for a settings file beside every asset of an app that does not say that there are none.
    const isAsked = message.location().url.endsWith(".meta");
    if (message.type() === "error" && !isAsked) errors.push(`${message.text()} (${message.location().url})`);
  });
  return errors;
}
