// Loads the viewer into the page, or says why it cannot run.
const canvas = document.getElementById("view");
const message = document.getElementById("message");

function say(text) {
  message.textContent = text;
  message.hidden = text === "";
  canvas.hidden = text !== "";
}

// The viewer calls this before it stops for good.
globalThis.adjsplatStopped = (text) => say(`The viewer has stopped (${text}). Load the page again.`);

// The viewer calls this with what it says on the canvas, which screen readers do not see.
globalThis.adjsplatSays = (text) => {
  const said = document.getElementById("said");
  if (said.textContent !== text) said.textContent = text;
};

// The first device draws the window. If it is lost, nothing is shown any more.
function watchFirstDevice() {
  const request = GPUAdapter.prototype.requestDevice;
  GPUAdapter.prototype.requestDevice = async function (...options) {
    GPUAdapter.prototype.requestDevice = request;
    const device = await request.apply(this, options);
    device.lost.then(({ message }) => globalThis.adjsplatStopped(`the graphics device was lost: ${message}`));
    return device;
  };
}

// A device draws no larger pictures than this, in pixels of the screen.
const MOST_PIXELS = 8192;

function limitSize() {
  const most = `${Math.floor(MOST_PIXELS / devicePixelRatio)}px`;
  Object.assign(canvas.style, { maxWidth: most, maxHeight: most });
}

async function begin() {
  if (!globalThis.isSecureContext) {
    return say("Browsers allow WebGPU only to pages from https or from this machine. Open this page so, or use adj view.");
  }
  if (!navigator.gpu || !(await navigator.gpu.requestAdapter())) {
    return say("This browser has no WebGPU, by which the viewer draws. Use a newer browser, allow its graphics acceleration, or use adj view.");
  }
  watchFirstDevice();
  const viewer = await import("./adjsplat_viewer.js");
  await viewer.default({ module_or_path: new URL("adjsplat_viewer_bg.wasm", import.meta.url) });
  say("");
  limitSize();
  addEventListener("resize", limitSize);
  await viewer.start(canvas);
  // For tests and for pages that hold this one: what is shown.
  globalThis.adjsplat = { state: () => JSON.parse(viewer.state() || "{}"), pixels: () => viewer.pixels() };
}

begin().catch((fault) => say(`The viewer cannot begin (${fault?.message ?? fault}). Load the page again. If this stays, its server may lack a file that the page was built with.`));
