// Why a module of the app has stopped: the browser's words, which are the same for all reasons, and the memory
// that the module had, of the 4 GB that it can have.
export function why(error, memory) {
  const used = memory ? `, with ${(memory.buffer.byteLength / 2 ** 30).toFixed(1)} of 4 GB in use` : "";
  return `${error.message}${used}`;
}
