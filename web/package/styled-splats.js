// <styled-splats src="garden.sgs" painting="wave.jpg">: a captured scene in a painting's style. See README.md.

import { start } from "./start.js";
import { steer } from "./steer.js";

// The app draws into the canvas `#scene` of its page, and cannot be started twice. So the elements of a page
// share one app and one canvas, and the first one in the document has them.
const canvas = Object.assign(document.createElement("canvas"), { id: "scene" });
// Over what the page has in the element, which is seen until the first picture is there. It has a size from the
// beginning: the app's first frame asks for it.
canvas.style.cssText = "position: absolute; inset: 0; width: 100%; height: 100%; visibility: hidden";
let app, starting, owner;

const METHODS = ["strokes", "decoder"];
const TRANSITIONS = ["fade", "sphere", "front", "noise"];
const SECONDS = 1;
// Factors of how strokes are drawn, and their ranges.
const STROKES = new Map([["paint", [0, 3]], ["protection", [0, 10]], ["stroke-scale", [0.1, 10]]]);

// The addresses of worlds.
const WORLD = /(^|\/)lod-meta\.json([?#]|$)/;

// Events of the app as those of the element that has it.
function hear(kind, text) {
  owner?.hear(kind, text);
}

class StyledSplats extends HTMLElement {
  static observedAttributes = [
    "src", "painting", "strength", "method", ...STROKES.keys(), "transition", "seconds",
  ];

  // Numbers of the changes of `src` and of `painting`: an answer to an older one is dropped.
  #asked = { src: 0, painting: 0 };
  #painting = null;
  #isLoaded = false;
  #hasFeatures = false;
  #isEmbedding = false;

  connectedCallback() {
    if (owner && owner !== this) return this.#fail("found a second <styled-splats>, expected one on a page");
    owner = this;
    if (getComputedStyle(this).display === "inline") this.style.display = "block";
    if (!this.hasAttribute("tabindex")) this.tabIndex = 0;
    if (getComputedStyle(this).position === "static") this.style.position = "relative";
    this.append(canvas);
    if (!this.#isSteered) steer(this, () => (owner === this ? app : undefined));
    this.#isSteered = true;
    this.#begin().catch((error) => this.#fail(error.message ?? String(error)));
  }

  disconnectedCallback() {
    if (owner === this) owner = undefined;
  }

  attributeChangedCallback(name) {
    if (app && owner === this) this.#apply(name);
  }

  #isSteered = false;

  async #begin() {
    starting ??= start((share) => owner?.dispatch("progress", { task: "loading", share }), hear);
    app = await starting;
    if (owner !== this) return;
    for (const name of ["transition", "paint", "src", "painting"]) this.#apply(name);
  }

  #apply(name) {
    if (name === "src") this.#open();
    else if (name === "painting") this.#paint();
    else if (name === "strength" || name === "method") this.#restyle();
    else if (STROKES.has(name)) {
      app.set_strokes(...[...STROKES].map(([name, range]) => this.#number(name, 1, ...range)));
    } else {
      app.set_transition(this.#choice("transition", TRANSITIONS), this.#number("seconds", SECONDS, 0, 3600));
    }
  }

  async #open() {
    const src = this.getAttribute("src");
    if (src && WORLD.test(src)) return this.#openWorld(src);
    const bytes = src && (await this.#fetched("src", src));
    if (!bytes) return;
    this.#isLoaded = false;
    app.open_file(nameOf(src), bytes);
  }

  // A world is fetched by the app, chunk by chunk.
  #openWorld(src) {
    // What is fetched for an older one comes too late.
    this.#asked.src += 1;
    const base = this.ownerDocument.baseURI;
    if (!URL.canParse(src, base)) {
      return this.#fail(`${src}: found no address, expected that of a lod-meta.json`);
    }
    this.#isLoaded = false;
    app.open_world(new URL(src, base).href);
  }

  async #paint() {
    const painting = this.getAttribute("painting");
    const bytes = painting && (await this.#fetched("painting", painting));
    if (painting && !bytes) return;
    if (!painting) this.#asked.painting += 1;
    this.#painting = painting ? nameOf(painting) : null;
    if (bytes) app.add_painting(this.#painting, bytes);
    this.#restyle();
  }

  #restyle() {
    // The scene that comes would be asked for a style of the one before it.
    if (!this.#isLoaded) return;
    const names = this.#painting ? [`image:${this.#painting}`] : [];
    const byDecoder = this.#choice("method", METHODS) === "decoder";
    const needsFeatures = byDecoder && names.length > 0 && !this.#hasFeatures;
    if (needsFeatures) app.embed_soon();
    else if (this.#isEmbedding) app.cancel_embedding();
    this.#isEmbedding = needsFeatures;
    if (needsFeatures) return;
    app.set_style(names, new Float32Array(names.map(() => 1)), 0, this.#number("strength", 1, 0, 1), byDecoder);
  }

  // The bytes at an address, or nothing if they cannot be had or another address was asked for meanwhile.
  async #fetched(attribute, address) {
    const number = (this.#asked[attribute] += 1);
    try {
      const response = await fetch(new URL(address, this.ownerDocument.baseURI));
      if (!response.ok) throw new Error(`the server answered ${response.status}`);
      const bytes = new Uint8Array(await response.arrayBuffer());
      return number === this.#asked[attribute] && owner === this ? bytes : undefined;
    } catch (error) {
      if (number === this.#asked[attribute]) this.#fail(`${address}: ${error.message}`);
    }
  }

  #choice(attribute, choices) {
    const found = this.getAttribute(attribute) ?? choices[0];
    if (choices.includes(found)) return found;
    this.#fail(`${attribute}="${found}", expected ${choices.join(", ")}`);
    return choices[0];
  }

  #number(attribute, usual, least, most) {
    const text = this.getAttribute(attribute);
    const value = text === null ? usual : Number(text || Number.NaN);
    if (value >= least && value <= most) return value;
    this.#fail(`${attribute}="${text}", expected a number from ${least} to ${most}`);
    return usual;
  }

  // Called by the app alone.
  hear(kind, text) {
    if (kind === "ready") this.dispatch("ready", {});
    if (kind === "failed") this.#fail(text);
    if (kind === "shown") {
      canvas.style.visibility = "visible";
      this.dispatch("shown", {});
    }
    if (kind === "applied") this.dispatch("applied", { milliseconds: Number(text) });
    if (kind === "progress") {
      const [task, share] = text.split(" ");
      this.dispatch("progress", { task, share: share === undefined ? null : Number(share) });
    }
    if (kind === "loaded") {
      const [gaussians, hasFeatures] = text.split(" ");
      [this.#isLoaded, this.#hasFeatures, this.#isEmbedding] = [true, hasFeatures === "true", false];
      this.dispatch("loaded", { gaussians: Number(gaussians), hasFeatures: this.#hasFeatures });
      this.#restyle();
    }
  }

  dispatch(kind, detail) {
    this.dispatchEvent(new CustomEvent(kind, { detail }));
  }

  #fail(message) {
    this.dispatch("failed", { message });
  }

  // Downloads.
  savePicture() {
    app?.save_picture_soon();
  }

  saveGlb() {
    app?.save_glb_soon();
  }
}

for (const [name, choices] of [["src"], ["painting"], ["method", METHODS], ["transition", TRANSITIONS]]) {
  Object.defineProperty(StyledSplats.prototype, name, {
    get() {
      const found = this.getAttribute(name) ?? "";
      return !choices || choices.includes(found) ? found : choices[0];
    },
    set(value) {
      if (value === null || value === undefined || value === "") this.removeAttribute(name);
      else this.setAttribute(name, value);
    },
  });
}
const NUMBERS = [["strength", 1], ["seconds", SECONDS], ...[...STROKES.keys()].map((name) => [name, 1])];
for (const [name, usual] of NUMBERS) {
  Object.defineProperty(StyledSplats.prototype, name === "stroke-scale" ? "strokeScale" : name, {
    get() { return Number(this.getAttribute(name) ?? usual); },
    set(value) { this.setAttribute(name, String(value)); },
  });
}

// The file's name, by whose ending formats without a mark are told.
function nameOf(address) {
  return new URL(address, document.baseURI).pathname.split("/").pop() || address;
}

customElements.define("styled-splats", StyledSplats);
export { StyledSplats };
