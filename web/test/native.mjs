// What the page is compared with: the native program's pictures and colors.

import { execFileSync } from "node:child_process";
import { existsSync, mkdirSync, readFileSync, writeFileSync } from "node:fs";
import { join } from "node:path";

// The program by its path in STYLEGAUSSIAN, or where cargo puts it; undefined if it is not built.
export function program() {
  const target = process.env.CARGO_TARGET_DIR ?? "target";
  const built = ["release", "debug"].map((profile) => join(target, profile, "stylegaussian"));
  const places = [process.env.STYLEGAUSSIAN, ...built];
  return places.find((path) => path && existsSync(path));
}

export const run = (...given) => execFileSync(program(), given, { stdio: ["ignore", "ignore", "inherit"] });

// The picture of a scene with the page's cameras, as PNG with transparency.
export function render(folder, scene, cameras, ...given) {
  mkdirSync(folder, { recursive: true });
  const path = join(folder, "transforms.json");
  writeFileSync(path, cameras);
  run("render", scene, "--backend", "cpu", "--cameras", path, "--output", folder, ...given);
  return readFileSync(join(folder, "000000.png"));
}

// A tensor of a safetensors file, as a typed array. Half floats come as 16-bit integers.
export function tensor(path, name) {
  const bytes = readFileSync(path);
  const length = Number(bytes.readBigUInt64LE(0));
  const { dtype, data_offsets: [begin, end] } = JSON.parse(bytes.subarray(8, 8 + length))[name];
  const data = bytes.subarray(8 + length + begin, 8 + length + end);
  const [kind, size] = { F32: [Float32Array, 4], U32: [Uint32Array, 4], F16: [Uint16Array, 2] }[dtype];
  // A copy, since typed arrays begin at multiples of their elements.
  const copy = data.buffer.slice(data.byteOffset, data.byteOffset + data.byteLength);
  return new kind(copy, 0, data.byteLength / size);
}

// Peak signal-to-noise ratio in dB of a screenshot to a native picture, over the pixels that the scene covers,
// and their share. `page` decodes the two PNG files.
export function compare(page, screenshot, picture) {
  return page.evaluate(async (files) => {
    const [seen, expected] = await Promise.all(files.map(async (file) => {
      const bytes = Uint8Array.from(atob(file), (letter) => letter.charCodeAt(0));
      const image = await createImageBitmap(new Blob([bytes]), { premultiplyAlpha: "none" });
      const context = new OffscreenCanvas(image.width, image.height).getContext("2d");
      context.drawImage(image, 0, 0);
      return context.getImageData(0, 0, image.width, image.height);
    }));
    if (seen.width !== expected.width || seen.height !== expected.height) {
      throw new Error(`found ${seen.width}x${seen.height}, expected ${expected.width}x${expected.height}`);
    }
    let [sum, covered] = [0, 0];
    for (let i = 0; i < expected.data.length; i += 4) {
      if (expected.data[i + 3] < 253) continue;
      covered += 1;
      for (const c of [0, 1, 2]) sum += (seen.data[i + c] - expected.data[i + c]) ** 2;
    }
    const psnr = 10 * Math.log10(255 ** 2 / (sum / (3 * covered)));
    return { psnr, covered: covered / (seen.width * seen.height) };
  }, [screenshot, picture].map((file) => file.toString("base64")));
}
