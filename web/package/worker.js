// The worker: the app's module without an app, for what would stop the page's frames. See worker.rs.

import start, * as app from "./app.js";
import { why } from "./why.js";

// The last call: one begins when the one before has ended.
let turn;
let memory;

onmessage = ({ data }) => {
  if (data.module) {
    turn = start({ module_or_path: data.module });
    turn.then(
      (loaded) => { memory = loaded.memory; postMessage({ ready: true }); },
      (error) => postMessage({ stopped: String(error) }),
    );
  } else turn = turn.then(() => answer(data));
};

async function answer({ id, call, given }) {
  const tell = (progress) => postMessage({ id, progress });
  try {
    const bytes = app[call](...(await Promise.all(given.map(loaded))), tell);
    postMessage({ id, bytes }, [bytes.buffer]);
  } catch (error) {
    // After a panic, the module's memory is of no use.
    if (error instanceof WebAssembly.RuntimeError) postMessage({ stopped: why(error, memory) });
    else postMessage({ id, error: error?.message ?? String(error) });
  }
}

// A file beside the page is given by its address.
async function loaded(given) {
  if (Array.isArray(given)) return Promise.all(given.map(loaded));
  if (!given?.url) return given;
  const response = await fetch(given.url);
  if (!response.ok) throw new Error(`${given.url}: the server answered ${response.status}`);
  return new Uint8Array(await response.arrayBuffer());
}
