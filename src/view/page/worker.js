// Builds a volume beside the page, which answers meanwhile. In: files, of which the first `count` are the volume. Out: progress, then
// an .adj file, or why there is none.
import init, { build } from "./adjsplat_worker.js";

onmessage = async ({ data: { files, count } }) => {
  try {
    await init({ module_or_path: new URL("adjsplat_worker_bg.wasm", import.meta.url) });
    const bytes = build(files, count, (stage, share) => postMessage({ stage, share }));
    postMessage({ file: new File([bytes], files[0].name) });
  } catch (fault) {
    const stopped = "the build stopped, perhaps for lack of memory; make a file by adj build";
    postMessage({ fault: fault instanceof WebAssembly.RuntimeError ? stopped : (fault?.message ?? String(fault)) });
  }
};
