#!/usr/bin/env python3
"""How sharp a kernel may be, as Markdown tables: docs/studies/sharpness.md.

    cargo build --release -p adj && python3 benches/sharpness.py ripple|gratings|noise|times|sheet [--data ../shared/data]

`ripple` and `gratings` print closed forms and what pictures of computed volumes have; `noise` draws volumes with and
without noise; `times` draws sets with one thread, each view with every kernel in turn; `sheet` writes sharpness.png, sets
side by side. `--adj` takes another program. Needs numpy and OpenEXR (Python packages), `sheet` also pillow.
"""

import argparse
import gzip
import json
import subprocess
import tempfile
from pathlib import Path

import numpy
import OpenEXR

SIGMAS = [0.45, 0.5, 0.55, 0.6, 0.65, 0.7]
# Radius of standard quality over its sigma.
CUT_OFF = 2.5 / 0.7
# Radius of the kernel (1 - r^2 / BLOB^2)^3.5, whose spectrum is 0 at one cycle a voxel; its footprint has the power 4.
BLOB = 1.396
PERIODS = [2.5, 3, 4, 6]
# Name, file in the folder or a computed volume, what is visible.
SETS = [
    ("engine", "scivis-engine/engine.nii.gz", ["--range", "60.."]),
    ("CT head", "headsq-quarter/quarter.nhdr", ["--range", "1150.."]),
    ("vessels", "phantom:vessels", []),
    ("carotid", "carotid/carotid.vtk", ["--range", "150.."]),
]
VISIBLE = {"kind": "points", "points": [
    {"value": -1, "colour": "#ffffff", "opacity": 0.001},
    {"value": 1, "colour": "#ffffff", "opacity": 0.041}]}


class Bench:
    """A folder for files, and the program."""

    def __init__(self, adj, data, folder):
        self.program, self.data, self.folder = adj, data, Path(folder)

    def adj(self, *words):
        done = subprocess.run([self.program, *map(str, words)], stdout=subprocess.DEVNULL, stderr=subprocess.PIPE, text=True)
        if done.returncode:
            raise SystemExit(f"adj {' '.join(map(str, words))}: {done.stderr}")

    def file(self, samples, transfer):
        """Builds a file of samples, in the order z, y, x."""
        raw, function, out = (self.folder / name for name in ("v.raw", "tf.json", "v.adj"))
        samples.astype("<f4").tofile(raw)
        function.write_text(json.dumps(transfer))
        z, y, x = samples.shape
        self.adj("build", raw, "--dims", f"{x}x{y}x{z}", "--type", "f32", "--tf", function, "--value-bits", 16, "-o", out, "-q")
        return out

    def set(self, path, visible):
        out = self.folder / f"{abs(hash(path))}.adj"
        if not out.exists():
            source = path if path.startswith("phantom:") else self.data / path
            self.adj("build", source, "-o", out, "-q", *visible)
        return out

    def picture(self, file, sigma, *flags):
        out = self.folder / "p.exr"
        self.adj("render", file, "-o", out, "--kernel", kernel(sigma), "--renderer", "cpu", "-q", "--background", "transparent", *flags)
        channels = OpenEXR.File(str(out)).channels()
        if "RGBA" in channels:
            return channels["RGBA"].pixels.astype(numpy.float64)
        return numpy.stack([channels[name].pixels for name in "RGBA"], -1).astype(numpy.float64)

    def depth(self, file, sigma, toward, height, size, sampling):
        """Returns optical depths around a volume's middle: `size` pixels for `height` voxels, seen from `toward`."""
        z, y, x = self.shape
        middle = numpy.array([x - 1, y - 1, z - 1]) / 2
        camera = self.folder / "camera.json"
        up = [0, 0, 1] if abs(toward[2]) < 0.9 else [0, 1, 0]
        position = middle + 500 * numpy.array(toward) / numpy.linalg.norm(toward)
        camera.write_text(json.dumps({"position": list(position), "target": list(middle), "up": up, "height": height}))
        flags = ["--camera", camera, "--size", f"{size}x{size}", "--unlit", "--sampling", sampling, "--termination", 0]
        return -numpy.log1p(-self.picture(file, sigma, *flags)[..., 3])


def kernel(sigma):
    return f"{sigma},{sigma * CUT_OFF:.6f}"


def row(*cells):
    print("| " + " | ".join(cells) + " |", flush=True)


def head(*cells):
    row(*cells)
    row(*["---"] * len(cells))


def footprint_ripple(footprint):
    """Returns the largest over the smallest sum, less 1, of the footprints of a slice of voxels, seen along an axis."""
    at = numpy.linspace(0, 1, 65)
    x, y = numpy.meshgrid(at, at)
    total = sum(footprint((x - i) ** 2 + (y - j) ** 2) for i in range(-4, 6) for j in range(-4, 6))
    return total.max() / total.min() - 1


def blob_footprint(square):
    return numpy.maximum(1 - square / BLOB**2, 0) ** 4


def blob_response(period):
    """Returns the contrast of a grating through the blob: the Fourier transform of its integral over planes."""
    t = numpy.linspace(-BLOB, BLOB, 4001)
    plane = (1 - (t / BLOB) ** 2) ** 4.5
    return (plane * numpy.cos(2 * numpy.pi * t / period)).sum() / plane.sum()


def ripple(bench):
    """Largest over smallest depth of a slab of constant voxels, less 1."""
    bench.shape = (80, 12, 80)
    file = bench.file(numpy.ones(bench.shape), VISIBLE)
    axis, views = [0, -1, 0], [[0, -1, 1], [0.46985, -0.81380, 0.34202]]
    head("sigma", "along an axis", "with the cut-off", "picture, every pixel", "picture, standard", "between two axes", "picture", "azimuth 30, elevation 20, picture")
    for sigma in SIGMAS:
        # Slices that are shifted by one voxel each add the same: harmonics 1 across the shift, sqrt 2 along it.
        q, r = (numpy.exp(-2 * numpy.pi**2 * sigma**2 * square) for square in (1, 2))
        gaussian = lambda square: numpy.exp(-square / (2 * sigma**2))
        cut = lambda square: numpy.where(square <= (CUT_OFF * sigma) ** 2, gaussian(square), 0)
        oblique = (1 + 2 * q) / (1 - 2 * q) * (1 + 2 * r) / (1 - 2 * r) - 1
        pictures = []
        for toward, sampling in ((axis, "every"), (axis, "enough"), (views[0], "every"), (views[1], "every")):
            depth = bench.depth(file, sigma, toward, 4.0, 96, sampling)
            pictures.append(depth.max() / depth.min() - 1)
        found = [footprint_ripple(gaussian), footprint_ripple(cut), *pictures[:2], oblique, *pictures[2:]]
        row(f"{sigma}", *[f"{100 * value:.2f} %" for value in found])
    row("blob", f"{100 * footprint_ripple(blob_footprint):.2f} %", "the same", *[""] * 5)


def gratings(bench):
    """Contrast of a picture over that of the volume."""
    head("kernel", *[f"{period} voxels{what}" for period in PERIODS for what in ("", ", picture")], "width of a leaf")
    bench.shape = (60, 12, 120)
    files = []
    x = numpy.arange(bench.shape[2])
    for period in PERIODS:
        wave = numpy.cos(2 * numpy.pi * (x - (bench.shape[2] - 1) / 2) / period)
        # Depth, not opacity, should be a cosine.
        opacity = 1 - numpy.exp(-0.02 * (1 + 0.9 * wave))
        values = 2 * (opacity - 0.001) / 0.04 - 1
        out = bench.file(numpy.broadcast_to(values, bench.shape), VISIBLE)
        files.append(out.rename(out.with_name(f"grating{period}.adj")))
    for sigma in SIGMAS:
        cells = []
        for period, file in zip(PERIODS, files):
            size, height = 960, 60.0
            depth = bench.depth(file, sigma, [0, -1, 0], height, size, "every")[size // 2 - 200 : size // 2 + 200].mean(0)
            at = (numpy.arange(size) + 0.5 - size / 2) * height / size
            basis = numpy.stack([numpy.ones(size), numpy.cos(2 * numpy.pi * at / period), numpy.sin(2 * numpy.pi * at / period)], -1)
            constant, *wave = numpy.linalg.lstsq(basis, depth, rcond=None)[0]
            cells += [f"{numpy.exp(-2 * numpy.pi**2 * sigma**2 / period**2):.3f}", f"{numpy.hypot(*wave) / constant / 0.9:.3f}"]
        row(f"{sigma}", *cells, f"{2.3548 * sigma:.2f}")
    row("blob", *[cell for period in PERIODS for cell in (f"{blob_response(period):.3f}", "")], f"{2 * BLOB * numpy.sqrt(1 - 0.5 ** (1 / 4.5)):.2f}")
    row("trilinear", *[cell for period in PERIODS for cell in (f"{numpy.sinc(1 / period) ** 2:.3f}", "")], "1.00")


def noise(bench):
    """Error of pictures of noisy volumes beside those without noise."""
    at = numpy.arange(96) * 2 * numpy.pi / 32
    z, y, x = numpy.meshgrid(at, at, at, indexing="ij")
    gyroid = numpy.sin(x) * numpy.cos(y) + numpy.sin(y) * numpy.cos(z) + numpy.sin(z) * numpy.cos(x)
    engine = numpy.frombuffer(gzip.open(bench.data / "scivis-engine/engine.nii.gz").read()[352:], "u1").reshape(128, 256, 256)
    volumes = [("gyroid", gyroid, [0.2, 0.6], 0.15), ("engine", engine[30:100, 60:180, 60:180], [60, 130], 10)]
    views = [("azimuth 30, elevation 20", ["--azimuth", 30, "--elevation", 20]), ("along an axis", [])]
    random = numpy.random.default_rng(1)
    found = {}
    for name, samples, (low, high), sigma_noise in volumes:
        transfer = {"kind": "points", "points": [
            {"value": low, "colour": "#804020", "opacity": 0}, {"value": high, "colour": "#ffe0c0", "opacity": 0.3}]}
        clean = bench.file(samples, transfer).rename(bench.folder / "clean.adj")
        noisy = bench.file(samples + sigma_noise * random.standard_normal(samples.shape), transfer)
        for label, view in views:
            for lit in ([], ["--unlit"]):
                for sigma in SIGMAS:
                    flags = [*view, *lit, "--size", "512x512"]
                    a, b = (bench.picture(file, sigma, *flags) for file in (clean, noisy))
                    there = a[..., 3] > 0.01
                    found[name, label, not lit, sigma] = numpy.sqrt(((a - b)[there] ** 2).mean())
    keys = list(dict.fromkeys(key[:3] for key in found))
    head("sigma", *[f"{name}, {label}, {'lit' if lit else 'unlit'}" for name, label, lit in keys])
    for sigma in SIGMAS:
        row(f"{sigma}", *[f"{found[*key, sigma]:.4f}" for key in keys])


def times(bench):
    """Milliseconds and splats of a frame at 512 x 512, one thread, best of five, kernels in turn."""
    head("sigma", *[f"{name}, {unit}" for name, *_ in SETS for unit in ("ms", "thousand splats")])
    results = {}
    for name, path, visible in SETS:
        file, stats = bench.set(path, visible), bench.folder / "stats.json"
        for _ in range(5):
            for sigma in SIGMAS:
                bench.picture(file, sigma, "--size", "512x512", "--threads", 1, "--azimuth", 30, "--elevation", 20, "--stats", stats)
                found = json.loads(stats.read_text())
                ms = min(results.get((name, sigma), [1e9])[0], *found["frame_ms"])
                results[name, sigma] = (ms, found["splats_drawn"])
    for sigma in SIGMAS:
        row(f"{sigma}", *[cell for name, *_ in SETS for cell in (f"{results[name, sigma][0]:.1f}", f"{results[name, sigma][1] / 1000:.0f}")])


def sheet(bench):
    """Writes a sheet of pictures: a row a set, a column a kernel."""
    from PIL import Image

    rows = []
    for (_, path, visible), zoom in zip(SETS, (2.5, 1.5, 3, 2)):
        file = bench.set(path, visible)
        pictures = []
        for sigma in SIGMAS[1:]:
            out = bench.folder / "p.png"
            bench.adj("render", file, "-o", out, "--kernel", kernel(sigma), "--renderer", "cpu", "-q", "--size", "380x380", "--azimuth", 30, "--elevation", 20, "--zoom", zoom)
            pictures.append(numpy.asarray(Image.open(out).convert("RGB")))
        rows.append(numpy.hstack(pictures))
    Image.fromarray(numpy.vstack(rows)).save("sharpness.png")


def main():
    root = Path(__file__).parent.parent
    parser = argparse.ArgumentParser()
    parser.add_argument("table", choices=["ripple", "gratings", "noise", "times", "sheet"])
    parser.add_argument("--data", type=Path, default=root / "../shared/data")
    parser.add_argument("--adj", type=Path, default=root / "target/release/adj")
    given = parser.parse_args()
    with tempfile.TemporaryDirectory() as folder:
        globals()[given.table](Bench(given.adj, given.data, folder))


if __name__ == "__main__":
    main()
