// Builds a volume beside the page, which answers meanwhile. In: files, their paths, and which paths are the volume. Out: progress, then
// an .adj file, or why there is none.
import init, { build } from "./adjsplat_worker.js";

onmessage = async ({ data: { files, paths, opened } }) => {
  try {
    await init({ module_or_path: new URL("adjsplat_worker_bg.wasm", import.meta.url) });
    const bytes = build(files, paths, opened, (stage, share) => postMessage({ stage, share }));
    postMessage({ file: new File([bytes], opened[0]) });
  } catch (fault) {
    const stopped = "the build stopped, perhaps for lack of memory; make a file by adj build";
    postMessage({ fault: fault instanceof WebAssembly.RuntimeError ? stopped : (fault?.message ?? String(fault)) });
  }
};
