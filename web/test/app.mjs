// The app that `cargo xtask web` has built: pictures of it, and no error in the console.
//
//   node web/test/app.mjs FOLDER [--example]      pictures go to FOLDER

import { mkdirSync } from "node:fs";
import { errorsOf, launch, serve } from "./browser.mjs";

const [folder, mode] = process.argv.slice(2);
// SwiftShader on few cores compiles and draws for minutes.
const timeout = 240_000;
mkdirSync(folder, { recursive: true });
const browser = await launch();
const server = await serve(["web/dist"]);
const page = await browser.newPage({ viewport: { width: 1000, height: 640 } });
const errors = errorsOf(page);
const begun = Date.now();
const picture = async (name) => {
  await page.screenshot({ path: `${folder}/${name}.png`, timeout });
  console.log(`${((Date.now() - begun) / 1000).toFixed(1)} s: ${folder}/${name}.png`);
};
const state = (selector) => page.waitForSelector(`body${selector}`, { state: "attached", timeout });
try {
  await page.goto(server.url, { timeout });
  if (mode === "--example") {
    await page.waitForSelector("canvas", { timeout });
    await page.waitForTimeout(20_000);
    await picture("early");
    await page.waitForTimeout(40_000);
    await picture("late");
  } else {
    await state("[data-scene]");
    await page.waitForTimeout(5_000);
    await picture("captured");
    await page.click('[data-style="ink"]');
    await state('[data-state="applied"]');
    await page.waitForTimeout(5_000);
    await picture("ink");
    await page.setViewportSize({ width: 360, height: 740 });
    await page.waitForTimeout(5_000);
    await picture("narrow");
  }
} finally {
  await browser.close();
  server.close();
}
for (const error of errors) console.error(`console: ${error}`);
process.exit(errors.length ? 1 : 0);
