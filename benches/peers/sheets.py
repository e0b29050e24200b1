"""Contact sheets: the same view by adj, VTK and VolPack, a strip a set.

In: the pictures of a run. Out: one PNG a set, 64 colours so that they stay small.
"""

from PIL import Image

SIDE = 200
# The second view of the turn: oblique to all axes.
VIEW = "001"
COLUMNS = (("adj-parallel-512-{}.png", "adj"), ("vtk-parallel-512-{}.ppm", "VTK"), ("volpack-colour-512-{}.ppm", "VolPack"))


def write(pictures, names, folder):
    """A strip of each set whose three pictures are there."""
    for name in names:
        parts = [pictures / f"{name}-{column.format(VIEW)}" for column, _ in COLUMNS]
        if not all(part.exists() for part in parts):
            continue
        strip = Image.new("RGB", (SIDE * len(parts), SIDE))
        for place, part in enumerate(parts):
            shown = Image.open(part).convert("RGB").resize((SIDE, SIDE), Image.Resampling.LANCZOS)
            strip.paste(shown, (place * SIDE, 0))
        strip.quantize(64).save(folder / f"peers-{name}.png", optimize=True)
