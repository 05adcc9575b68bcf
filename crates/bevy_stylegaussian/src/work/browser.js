// A worker that runs the page's module without the app. See browser.rs.
let app, isReady = false;

// The page's script starts a module with `main`, which is the app. Here, what comes before it is done alone.
const instantiate = WebAssembly.instantiate;
WebAssembly.instantiate = async (module, imports) => {
  const { exports } = await instantiate(module, imports);
  const start = () => {
    for (const [name, call] of Object.values(imports).flatMap(Object.entries)) {
      if (name.includes("init_externref_table")) call();
    }
  };
  return { module, instance: { exports: { ...exports, __wbindgen_start: start } } };
};

onmessage = async ({ data: { script, module, call } }) => {
  try {
    if (call) {
      const answer = app.stylegaussian_apart(call);
      return postMessage({ answer }, [answer.buffer]);
    }
    app = await import(script);
    await app.default({ module_or_path: module });
    isReady = true;
    postMessage({ ready: true });
  } catch (error) {
    const said = error?.message ?? String(error);
    // After a panic, the module's memory is of no use.
    postMessage(isReady && !(error instanceof WebAssembly.RuntimeError) ? { error: said } : { stopped: said });
  }
};
