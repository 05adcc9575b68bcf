// The page that `cargo xtask web` has built with a world: levels of detail on a host of static files, of which
// it fetches what the budget has room for, in headless Chromium beside the native program.
//
//   node --test web/test/world.mjs        PICTURES=FOLDER keeps the pictures

import assert from "node:assert/strict";
import { mkdirSync, mkdtempSync, readFileSync, rmSync, writeFileSync } from "node:fs";
import { tmpdir } from "node:os";
import { join } from "node:path";
import { after, afterEach, before, test } from "node:test";
import { errorsOf, launch, serve } from "./browser.mjs";
import { compare, program, render, run } from "./native.mjs";
import { drop, dropScene, timeout, told } from "./watched.mjs";

const options = { timeout: 2_400_000 };
const folder = process.env.PICTURES ?? mkdtempSync(join(tmpdir(), "stylegaussian-web-"));
mkdirSync(folder, { recursive: true });
const SIZE = { width: 360, height: 480 };
const N_DEMO = 69_714;
// The demo scene at three levels. At the coarsest, each node of 2048 Gaussians has 128.
const WORLD = join(folder, "host", "world");
let browser, server, levels;

before(async () => {
  assert.ok(program(), "the native program is not built. Run: cargo build -p stylegaussian_cli");
  // That of an earlier run, in a folder that is kept.
  rmSync(WORLD, { recursive: true, force: true });
  run("tile", "assets/demo.sgs", "--levels", "3", "--chunk", "8192", "--output", WORLD);
  levels = JSON.parse(readFileSync(join(WORLD, "lod-meta.json")));
  browser = await launch();
  server = await serve(["web/page", "web", "web/dist", join(folder, "host")]);
});
// One that has failed would draw beside the next one.
afterEach(() => Promise.all(browser.contexts().map((context) => context.close())));
after(async () => {
  await browser?.close();
  server?.close();
});

// The page with the world under a budget, and the chunks that it fetches.
async function opened(budget) {
  const page = await browser.newPage({ viewport: SIZE });
  page.setDefaultTimeout(timeout);
  const errors = errorsOf(page);
  const fetched = new Set();
  page.on("request", (request) => {
    const [, chunk] = /\/world\/(.+\/meta\.json)$/.exec(new URL(request.url()).pathname) ?? [];
    if (chunk) fetched.add(chunk);
  });
  await page.goto(server.url);
  await page.waitForSelector("body[data-shown]", { state: "attached" });
  await page.evaluate(async (budget) => {
    const app = await import("./package/app.js");
    delete document.body.dataset.shown;
    app.set_world_budget(budget);
    app.open_world(new URL("world/lod-meta.json", document.baseURI).href);
  }, budget);
  await page.waitForSelector("body[data-shown]", { state: "attached" });
  return { page, errors, fetched };
}

// The counts of the world.
const countsOf = (page) => page.evaluate(async () => JSON.parse((await import("./package/app.js")).world()));

// The counts of the world once all is as the camera and the budget ask for, for two seconds.
async function settled(page) {
  const isSettled = async () => {
    const { world } = await import("./package/app.js");
    const { parts, loading, waiting, arriving, unstyled } = JSON.parse(world());
    return parts > 0 && loading + waiting + arriving + unstyled === 0;
  };
  for (const begun = performance.now(); performance.now() - begun < timeout;) {
    await page.waitForTimeout(2_000);
    if (await page.evaluate(isSettled)) return countsOf(page);
  }
  throw new Error("the world does not come to rest");
}

async function expectNative(page, name, ...given) {
  const picture = await page.locator("#scene").screenshot({ timeout });
  writeFileSync(join(folder, `${name}.png`), picture);
  const cameras = await page.evaluate(async () => (await import("./package/app.js")).cameras());
  const native = render(join(folder, `${name}_native`), WORLD, cameras, ...given);
  const { psnr, covered } = await compare(page, picture, native);
  console.log(`${name}: ${psnr.toFixed(1)} dB to the native picture over ${(100 * covered).toFixed(0)}% of it`);
  assert.ok(covered > 0.1, `the world covers ${covered} of the picture`);
  assert.ok(psnr >= 30, `${name}: found ${psnr} dB, expected at least 30`);
}

test("a world is the native one, and is painted", options, async () => {
  const { page, errors } = await opened(1_000_000);
  assert.equal(await page.getAttribute("body", "data-shown"), String(N_DEMO));
  const { shown, shown_parts: parts } = await settled(page);
  assert.ok(shown > levels.counts[1] && shown <= N_DEMO, `${shown} Gaussians`);
  assert.ok(parts >= N_DEMO / 2048, `${parts} parts`);
  await expectNative(page, "world", "--cut", "--budget", "1000000");
  // A dropped painting reaches all parts before the page says so, and leaves the picture another.
  const before = await page.locator("#scene").screenshot({ timeout });
  await drop(page, "dropped.jpg", readFileSync("assets/styles/dots.jpg"));
  await page.waitForSelector('[data-style="dropped.jpg"][aria-pressed="true"]');
  await page.waitForSelector('body:is([data-state="applied"], [data-state="failed"])');
  assert.equal(await page.getAttribute("body", "data-state"), "applied", await page.textContent("#notice"));
  await settled(page);
  const painted = await page.locator("#scene").screenshot({ timeout });
  writeFileSync(join(folder, "world_painted.png"), painted);
  const { psnr } = await compare(page, painted, before);
  assert.ok(psnr < 30, `found ${psnr} dB between captured and painted, expected less than 30`);
  // What is of single scenes is told, and a single scene takes the world's place.
  await page.click("#save_glb");
  await told(page, /world is not saved/);
  await dropScene(page, "one.sgs", readFileSync("assets/demo.sgs"), N_DEMO);
  assert.equal(await page.evaluate(async () => (await import("./package/app.js")).world()), "");
  assert.deepEqual(errors, []);
});

test("chunks that the budget has no room for are not fetched", options, async () => {
  // All of the coarsest level, and some of the next one.
  const budget = Math.round(1.3 * levels.counts[2]);
  const { page, errors, fetched } = await opened(budget);
  const { shown, parts, shown_parts: shownParts } = await settled(page);
  assert.ok(shown <= budget && shown >= levels.counts[2], `${shown} Gaussians of ${budget}`);
  assert.equal(shownParts, parts);
  const few = fetched.size;
  assert.ok(few > 0 && few < levels.filenames.length, `${few} of ${levels.filenames.length} chunks`);
  assert.ok([...fetched].every((chunk) => levels.filenames.includes(chunk)), [...fetched].join());
  // More room lets more in.
  await page.evaluate(async () => (await import("./package/app.js")).set_world_budget(1_000_000));
  const counts = () => countsOf(page);
  while ((await counts()).shown <= levels.counts[1]) await page.waitForTimeout(500);
  assert.ok(fetched.size > few, `${fetched.size} chunks`);
  assert.deepEqual(errors, []);
});

test("an address without a world is told, and the scene stays", options, async () => {
  const { page } = await opened(100_000);
  await page.evaluate(async () => {
    const { open_world } = await import("./package/app.js");
    open_world(new URL("none/lod-meta.json", document.baseURI).href);
  });
  await told(page, /none\/lod-meta\.json/);
  assert.ok((await countsOf(page)).shown > 0);
});
