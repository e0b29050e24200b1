"""A picture in a notebook that follows the mouse."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

from . import _native
from ._optional import needed
from .render import Renderer

#: The page's part: drags turn, the wheel zooms; a picture comes back as a PNG.
SCRIPT = """
function render({ model, el }) {
  const image = document.createElement("img");
  image.style.cssText = "touch-action: none; cursor: grab; user-select: none";
  image.draggable = false;
  el.appendChild(image);
  const show = () => {
    const url = URL.createObjectURL(new Blob([model.get("png")], { type: "image/png" }));
    image.onload = () => URL.revokeObjectURL(url);
    image.src = url;
  };
  model.on("change:png", show);
  show();
  // One view at a time is under way, so that a slow picture does not pile up others.
  let wanted = null, busy = false;
  const send = () => {
    if (busy || !wanted) return;
    busy = true;
    model.set("view", wanted);
    wanted = null;
    model.save_changes();
  };
  model.on("change:drawn", () => { busy = false; send(); });
  const move = (azimuth, elevation, zoom, moving) => {
    const [a, e, z] = wanted ?? model.get("view");
    wanted = [a + azimuth, Math.max(-90, Math.min(90, e + elevation)), z * zoom, moving ? 1 : 0, Math.random()];
    send();
  };
  let last = null;
  image.addEventListener("pointerdown", (event) => {
    last = [event.clientX, event.clientY];
    image.setPointerCapture(event.pointerId);
  });
  image.addEventListener("pointermove", (event) => {
    if (!last) return;
    move((event.clientX - last[0]) * -0.5, (event.clientY - last[1]) * 0.5, 1, true);
    last = [event.clientX, event.clientY];
  });
  image.addEventListener("pointerup", () => { last = null; move(0, 0, 1, false); });
  image.addEventListener("wheel", (event) => {
    event.preventDefault();
    move(0, 0, Math.exp(-event.deltaY / 500), false);
  }, { passive: false });
}
export default { render };
"""


def show(
    f: Any,
    *,
    size: Sequence[int] = (500, 500),
    azimuth: float = 0.0,
    elevation: float = 0.0,
    zoom: float = 1.0,
    transfer: Any = None,
    device: str = "auto",
    background: Any = "white",
    **options: Any,
) -> Any:
    """Shows a model in a notebook: dragging turns it, the wheel zooms.

    Returns a widget (it needs the package anywidget) whose `view` is [azimuth, elevation, zoom, moving, any number];
    setting it draws another picture. While the mouse moves, the quality is "draft". `options` are those of `render`.
    """
    anywidget, traitlets = needed("anywidget", "show"), needed("traitlets", "show")
    renderer = Renderer(f, transfer=transfer, device=device)
    if "dtype" in options:
        raise TypeError("show takes no dtype: its pictures are PNGs of 8 bits; leave it out")
    still = options.pop("quality", "standard")

    class View(anywidget.AnyWidget):  # type: ignore[name-defined]
        _esm = SCRIPT
        png = traitlets.Bytes().tag(sync=True)
        #: The last number of the view that was drawn.
        drawn = traitlets.Float().tag(sync=True)
        view = traitlets.List(traitlets.Float()).tag(sync=True)

        @traitlets.observe("view")
        def _draw(self, change: Any) -> None:
            angle, height, magnification, moving, number = change["new"]
            quality = "draft" if moving else still
            view = {"azimuth": angle, "elevation": height, "zoom": magnification, "quality": quality}
            try:
                picture = renderer.render(size=size, background=background, **view, **options)
                self.png = _native.encode_png(picture)
            finally:
                self.drawn = number

    return View(view=[azimuth, elevation, zoom, 0.0, 0.0])
