#!/usr/bin/env python3
"""Checks what `adj export` writes with other programs' readers: every visible voxel, every hidden one, and the geometry.

    tests/export_readers.py PROGRAM [FOLDER]    FOLDER: real volumes, ../shared/data by default; `none` leaves them out

The right answers are those of formats/read_adj.py, which was written from the specification of .adj files. Readers:
numpy, nibabel, pynrrd, SimpleITK, vtk, zarr (Python packages), and pyopenvdb of /usr/bin/python3 where it is installed;
ADJ_PYTHON=require: it must be. Exit code 1 if anything differs. Cannot catch: an error that the library and read_adj.py share.
"""

import gzip
import json
import os
import shutil
import struct
import subprocess
import sys
import tempfile
from pathlib import Path

import numpy as np

ROOT = Path(__file__).resolve().parent.parent
sys.path.insert(0, str(ROOT / "formats"))
import read_adj  # noqa: E402

TYPES = {"u8": "u1", "i8": "i1", "u16": "u2", "i16": "i2", "u32": "u4", "i32": "i4", "f32": "f4", "f64": "f8"}
NRRD_TYPES = {"u8": "uint8", "i8": "int8", "u16": "uint16", "i16": "int16", "u32": "uint32", "i32": "int32",
              "f32": "float", "f64": "double"}
# Real sets with the flags that build them; label maps, scanners, simulations, integers and floating point.
REAL = [
    ("frogtissue/frogtissue.mhd", "--labels frog"),
    ("headsq-quarter/quarter.nhdr", "--range 500.."),
    ("SAG-anon", "--range 300.. --value-bits 16"),
    ("scivis-engine/engine.nii.gz", "--range 60.."),
    ("carotid/carotid.vtk", "--range 150.. --value-bits 16"),
    ("hydrogen/hydrogen.vti", "--range 0.05.."),
    ("nifti-zarr/tests/data/example4d.nii.gz", "--iso 400"),
]
LPS = np.array([-1.0, -1.0, 1.0])


def run(program, *arguments):
    ran = subprocess.run([program, *map(str, arguments)], capture_output=True, text=True)
    if ran.returncode != 0:
        sys.exit(f"{' '.join(map(str, arguments))}: {ran.stderr}")
    return ran.stdout


def nrrd(path, samples, name, steps, origin):
    """Writes an array (z, y, x) as NRRD, in a frame of R, A, S."""
    vectors = " ".join("(" + ",".join(repr(float(c)) for c in step) + ")" for step in steps)
    place = ",".join(repr(float(c)) for c in origin)
    header = (f"NRRD0004\ntype: {NRRD_TYPES[name]}\ndimension: 3\nspace: RAS\nsizes: "
              f"{samples.shape[2]} {samples.shape[1]} {samples.shape[0]}\nspace directions: {vectors}\n"
              f"endian: little\nencoding: raw\nspace origin: ({place})\n\n")
    path.write_bytes(header.encode() + samples.astype("<" + TYPES[name]).tobytes())


def synthetic(folder):
    """Yields a name, a volume and flags for each sample type and for odd geometry."""
    random = np.random.default_rng(7)
    turn = np.array([[0.36, 0.48, -0.8], [-0.8, 0.6, 0.0], [0.48, 0.64, 0.6]])
    frames = {
        "plain": (np.eye(3), [0, 0, 0]),
        "oblique": (turn * [[0.7], [1.3], [2.9]], [12.5, -80.25, 1e3]),
        "mirrored": (np.diag([-1.5, 2.0, 0.25]), [-3, 4, 5.5]),
    }
    for name in TYPES:
        dtype = np.dtype(TYPES[name])
        if dtype.kind == "f":
            samples = random.normal(10, 40, (70, 9, 130))
            flags = "--range 20.. --value-bits 16"
        else:
            low, high = (0, 250) if dtype.itemsize == 1 and dtype.kind == "u" else (-120, 120)
            low, high = (low * 100, high * 100) if dtype.itemsize > 1 else (low, high)
            samples = random.integers(max(low, np.iinfo(dtype).min), high, (70, 9, 130))
            flags = f"--range {high // 3}.. --value-bits 16"
        # Many slices, and whole chunks of a Zarr array, are empty.
        samples[3:40] = np.minimum(samples.min(), 0)
        samples[:, :, 50:] = np.minimum(samples.min(), 0)
        for frame, (steps, origin) in frames.items() if name in ("u8", "f32") else [("oblique", frames["oblique"])]:
            path = folder / f"{name}-{frame}.nrrd"
            nrrd(path, samples, name, steps, origin)
            yield path.stem, path, flags
    visible = np.zeros((3, 2, 5), "<i2")
    visible[1, 1, 4] = 1
    nrrd(folder / "one.nrrd", visible, "i16", np.eye(3), [0, 0, 0])
    yield "one", folder / "one.nrrd", "--range 1.."
    nrrd(folder / "negative.nrrd", np.arange(-40, 40).reshape(4, 4, 5), "i16", np.eye(3), [0, 0, 0])
    yield "negative", folder / "negative.nrrd", "--range -20..20"


class Truth:
    """The voxels and the grid of an .adj file."""

    def __init__(self, path, told):
        arena = read_adj.Arena(path.read_bytes())
        self.voxels = arena.voxels("x")
        self.values = np.asarray(arena.values(self.voxels.value), "f8")
        self.arena = arena
        self.dims, self.spacing = np.array(told["dims"]), np.array(told["spacing"])
        self.origin, self.direction = np.array(told["origin"]), np.array(told["direction"])

    def index(self):
        """Returns the indices of the voxels along x, y, z, a row each."""
        return np.stack([np.asarray(axis, "i8") for axis in (self.voxels.x, self.voxels.y, self.voxels.z)], 1)

    def world(self, index):
        return self.origin + (index * self.spacing) @ self.direction

    def check(self, what, samples, fill, spacing, origin, direction, single=False):
        """Compares samples (z, y, x) and a place in R, A, S whose rows of `direction` are the grid's axes."""
        assert samples.shape == tuple(self.dims[::-1]), f"{what}: shape {samples.shape}"
        at = (self.voxels.z, self.voxels.y, self.voxels.x)
        expected = self.values.astype(samples.dtype) if samples.dtype.kind == "f" else self.values
        assert np.array_equal(samples[at], expected), f"{what}: values differ"
        hidden = np.ones(samples.shape, bool)
        hidden[at] = False
        assert (samples[hidden] == fill).all(), f"{what}: hidden points are not {fill}"
        near = dict(rtol=1e-6, atol=1e-6) if single else dict(rtol=1e-12, atol=1e-12)
        for name, found, right in [("spacing", spacing, self.spacing), ("origin", origin, self.origin),
                                   ("direction", direction, self.direction)]:
            scale = max(1.0, np.abs(right).max())
            assert np.allclose(np.asarray(found) / scale, right / scale, **near), f"{what}: {name} {found} {right}"


def by_nibabel(path, truth, fill):
    import nibabel
    image = nibabel.load(path)
    steps = image.affine[:3, :3].T
    lengths = np.linalg.norm(steps, axis=1)
    samples = np.asarray(image.dataobj).T
    truth.check(f"nibabel {path.name}", samples, fill, lengths, image.affine[:3, 3], steps / lengths[:, None], True)
    # The quaternion says the same as the matrix.
    if image.header["qform_code"] > 0:
        assert np.allclose(image.get_qform(), image.affine, rtol=1e-4, atol=1e-3), f"{path.name}: qform"
    return samples.dtype


def by_pynrrd(path, truth, fill):
    import nrrd as pynrrd
    samples, header = pynrrd.read(str(path))
    steps = header["space directions"]
    lengths = np.linalg.norm(steps, axis=1)
    assert header["space"] == "right-anterior-superior"
    truth.check("pynrrd", samples.T, fill, lengths, header["space origin"], steps / lengths[:, None])
    return samples.dtype


def by_simpleitk(path, truth, fill):
    import SimpleITK
    image = SimpleITK.ReadImage(str(path))
    direction = np.array(image.GetDirection()).reshape(3, 3).T
    samples = SimpleITK.GetArrayFromImage(image)
    single = ".nii" in path.name
    truth.check(f"SimpleITK {path.name}", samples, fill, image.GetSpacing(), np.array(image.GetOrigin()) * LPS,
                direction * LPS, single)
    return samples.dtype


def by_vtk(path, truth, fill):
    from vtkmodules.util.numpy_support import vtk_to_numpy
    from vtkmodules.vtkIOXML import vtkXMLImageDataReader
    reader = vtkXMLImageDataReader()
    reader.SetFileName(str(path))
    reader.Update()
    image = reader.GetOutput()
    matrix = image.GetDirectionMatrix()
    direction = np.array([[matrix.GetElement(w, a) for w in range(3)] for a in range(3)])
    samples = vtk_to_numpy(image.GetPointData().GetScalars()).reshape(truth.dims[::-1])
    truth.check("vtk", samples, fill, image.GetSpacing(), image.GetOrigin(), direction)
    return samples.dtype


def by_zarr(path, truth, fill):
    import zarr
    group = zarr.open_group(str(path), mode="r")
    image = group.attrs["multiscales"][0]
    assert [axis["name"] for axis in image["axes"]] == ["z", "y", "x"] and image["version"] == "0.4"
    scale, translation = [step[step["type"]][::-1] for step in image["datasets"][0]["coordinateTransformations"]]
    samples = group["0"][:]
    if np.array_equal(truth.direction, np.eye(3)):
        assert "nifti" not in group
        truth.check("zarr", samples, fill, scale, translation, np.eye(3))
    else:
        header = bytes(group["nifti"][:])
        rows = np.array(struct.unpack("<12d", header[400:496])).reshape(3, 4)
        lengths = np.linalg.norm(rows[:, :3], axis=0)
        truth.check("zarr", samples, fill, lengths, rows[:, 3], (rows[:, :3] / lengths).T)
        assert np.allclose(scale, truth.spacing)
        assert np.allclose(translation, truth.direction @ truth.origin)
    return samples.dtype


def by_numpy(path, truth, fill):
    with np.load(path) as found:
        samples = found["values"]
        truth.check("npz", samples, fill, found["spacing"], found["origin"], found["direction"])
    return samples.dtype


def check_raw(path, truth, fill, told):
    samples = np.fromfile(path, "<" + TYPES[told["sample_type"]]).reshape(truth.dims[::-1])
    truth.check("raw", samples, fill, truth.spacing, truth.origin, truth.direction)
    return samples.dtype


def check_table(path, truth):
    with open(path) as file:
        names = file.readline().strip().split(",")
        table = np.atleast_2d(np.loadtxt(file, delimiter=","))
    column = lambda wanted: table[:, [names.index(name) for name in wanted]]  # noqa: E731
    order = np.lexsort((truth.voxels.x, truth.voxels.y, truth.voxels.z))
    index = truth.index()[order]
    assert np.array_equal(column("ijk"), index), "csv: indices"
    assert np.array_equal(column(["value"])[:, 0], truth.values[order]), "csv: values"
    assert np.allclose(column("xyz"), truth.world(index), rtol=1e-12, atol=1e-9), "csv: places"
    if "nx" in names:
        normals = truth.arena.normals(truth.voxels.normal)[order] @ truth.direction
        found = column(["nx", "ny", "nz"])
        assert np.allclose(found, normals, atol=1e-5), "csv: normals"


def check_ply(path, truth, count):
    content = path.read_bytes()
    header, _, body = content.partition(b"end_header\n")
    lines = header.decode().split("\n")
    names = [line.split()[2] for line in lines if line.startswith("property float ")]
    splats = np.frombuffer(body, [(name, "<f4") for name in names])
    assert f"element vertex {count}" in lines and len(splats) == count <= len(truth.values), "ply: count"
    place = np.stack([splats[name] for name in "xyz"], 1).astype("f8")
    index = (place - truth.origin) @ np.linalg.inv(truth.direction) / truth.spacing
    assert np.abs(index - index.round()).max() < 1e-2, "ply: places"
    # Voxels whose stored codes are transparent are left out.
    one_number = lambda at: (at[:, 2] * 65536 + at[:, 1]) * 65536 + at[:, 0]  # noqa: E731
    found = np.unique(one_number(index.round().astype("i8")))
    assert len(found) == count and np.isin(found, one_number(truth.index())).all(), "ply: voxels"
    # Each ellipsoid is 0.7 steps along each axis.
    w, x, y, z = [splats[f"rot_{i}"][0].astype("f8") for i in range(4)]
    turn = np.array([
        [1 - 2 * (y * y + z * z), 2 * (x * y - w * z), 2 * (x * z + w * y)],
        [2 * (x * y + w * z), 1 - 2 * (x * x + z * z), 2 * (y * z - w * x)],
        [2 * (x * z - w * y), 2 * (y * z + w * x), 1 - 2 * (x * x + y * y)]])
    half = np.exp([splats[f"scale_{i}"][0].astype("f8") for i in range(3)])
    steps = truth.direction * truth.spacing[:, None] * 0.7
    right = steps.T @ steps
    assert np.allclose(turn @ np.diag(half**2) @ turn.T, right, atol=1e-5 * np.abs(right).max()), "ply: shape"
    assert all(np.isfinite(splats[name]).all() for name in names), "ply: numbers"
    return splats


def check_spz(path, splats):
    content = gzip.decompress(path.read_bytes())
    magic, version, count, degree, fractional, flags, reserved = struct.unpack("<3I4B", content[:16])
    assert (magic, version, count, degree, flags, reserved) == (0x5053474E, 2, len(splats), 1, 0, 0), "spz: header"
    parts, at = {}, 16
    for name, width in [("place", 9), ("alpha", 1), ("colour", 3), ("scale", 3), ("turn", 3), ("sh", 9)]:
        parts[name] = np.frombuffer(content, "u1", count * width, at).reshape(count, width)
        at += count * width
    assert at == len(content), "spz: length"
    wide = parts["place"].reshape(count, 3, 3).astype("i4")
    fixed = wide[..., 0] | wide[..., 1] << 8 | wide[..., 2] << 16
    fixed = np.where(fixed >= 1 << 23, fixed - (1 << 24), fixed) / (1 << fractional)
    place = np.stack([splats["x"], -splats["y"], -splats["z"]], 1)
    assert np.abs(fixed - place).max() <= 0.51 / (1 << fractional) + 1e-6 * np.abs(place).max(), "spz: places"
    alpha = 1 / (1 + np.exp(-splats["opacity"].astype("f8")))
    assert np.abs(parts["alpha"][:, 0] / 255 - alpha).max() < 0.0021, "spz: opacity"
    for c in range(3):
        colour = (parts["colour"][:, c] / 255 - 0.5) / 0.15
        assert np.abs(colour - splats[f"f_dc_{c}"]).max() < 0.0135, "spz: colour"
        for h, sign in enumerate([-1, -1, 1]):
            harmonic = (parts["sh"][:, 3 * h + c] - 128.0) / 128 * sign
            assert np.abs(harmonic - splats[f"f_rest_{3 * c + h}"].clip(-1, 127 / 128)).max() < 0.009, "spz: harmonics"
    scale = np.stack([splats[f"scale_{a}"] for a in range(3)], 1)
    assert np.abs(parts["scale"] / 16 - 10 - scale).max() < 0.032, "spz: sizes"


OPENVDB = """
import sys, numpy as np, pyopenvdb
path, expected = sys.argv[1:]
grid = pyopenvdb.read(path, "values")
right = np.load(expected)
index, values, steps, origin = [right[name] for name in ("index", "values", "steps", "origin")]
assert grid.activeVoxelCount() == len(values), grid.activeVoxelCount()
high = index.max(0) + 1
dense = np.zeros(high, "f4")
grid.copyToArray(dense)
assert np.array_equal(dense[tuple(index.T)], values), "values"
# As many voxels are active as are visible. Those that are not 0 are in their places; the others are asked one by one.
assert np.count_nonzero(dense) == np.count_nonzero(values), "active voxels"
accessor = grid.getConstAccessor()
assert all(accessor.isValueOn(tuple(map(int, at))) for at in index[values == 0]), "active voxels that are 0"
for at in (index[0], index[-1]):
    world = grid.transform.indexToWorld(tuple(map(float, at)))
    assert np.allclose(world, origin + at @ steps, rtol=1e-12, atol=1e-9), (world, at)
"""


def check_vdb(path, truth, folder):
    system = "/usr/bin/python3"
    probe = subprocess.run([system, "-c", "import pyopenvdb, numpy"], capture_output=True)
    if probe.returncode != 0:
        assert os.environ.get("ADJ_PYTHON") != "require", "ADJ_PYTHON=require, but pyopenvdb is not installed"
        return False
    expected = folder / "expected.npz"
    np.savez(expected, index=truth.index(), values=truth.values.astype("f4"), origin=truth.origin,
             steps=truth.direction * truth.spacing[:, None])
    ran = subprocess.run([system, "-c", OPENVDB, path, expected], capture_output=True, text=True)
    assert ran.returncode == 0, f"vdb: {ran.stderr}"
    return True


def rebuilt_is_equal(program, adj, dense, flags, truth):
    """Builds the exported volume again, with the same flags: the same voxels with the same values are visible."""
    again = adj.with_name("again.adj")
    run(program, "build", dense, *flags.split(), "-o", again, "-q")
    arena = read_adj.Arena(again.read_bytes())
    voxels = arena.voxels("x")
    key = lambda v: np.lexsort((v.x, v.y, v.z))  # noqa: E731
    one, two = key(truth.voxels), key(voxels)
    for axis in "xyz":
        assert np.array_equal(getattr(truth.voxels, axis)[one], getattr(voxels, axis)[two]), "rebuilt: voxels"
    values = np.asarray(arena.values(voxels.value), "f8")[two]
    assert np.allclose(values, truth.values[one], rtol=2e-7, atol=0), "rebuilt: values"


def check(program, name, volume, flags, folder):
    adj = folder / "a.adj"
    run(program, "build", volume, *flags.split(), "-o", adj, "-q")
    truth = Truth(adj, json.loads(run(program, "info", adj, "--json")))
    dtypes, judged = set(), []
    for ending, readers in [
        (".nrrd", [by_pynrrd, by_simpleitk]), (".nii", [by_nibabel, by_simpleitk]), (".nii.gz", [by_nibabel]),
        (".mha", [by_simpleitk]), (".vti", [by_vtk]), (".zarr", [by_zarr]), (".npz", [by_numpy]), (".raw", [None]),
    ]:
        out = folder / f"out{ending}"
        told = json.loads(run(program, "export", adj, "-o", out, "--json", "-q"))
        for reader in readers:
            dtype = reader(out, truth, told["fill"]) if reader else check_raw(out, truth, told["fill"], told)
            dtypes.add(dtype.newbyteorder("="))
        judged.append(ending)
    assert len(dtypes) == 1, f"types differ: {dtypes}"
    # Opacity that depends on gradients depends on the voxels that were left out.
    if "--iso" not in flags:
        rebuilt_is_equal(program, adj, folder / "out.nrrd", flags, truth)
    count = {}
    for ending in (".csv", ".ply", ".spz", ".vdb"):
        count[ending] = json.loads(run(program, "export", adj, "-o", folder / f"out{ending}", "--json", "-q"))["voxels"]
    assert count[".csv"] == count[".vdb"] == len(truth.values) and count[".ply"] == count[".spz"], count
    check_table(folder / "out.csv", truth)
    check_spz(folder / "out.spz", check_ply(folder / "out.ply", truth, count[".ply"]))
    vdb = "vdb" if check_vdb(folder / "out.vdb", truth, folder) else "(SKIPPED: vdb, as pyopenvdb is not installed)"
    print(f"{name}: {len(truth.values)} voxels of {dtypes.pop()}, equal in {' '.join(judged)} csv ply spz {vdb}")
    shutil.rmtree(folder / "out.zarr")


def main():
    program = str(Path(sys.argv[1]).resolve())
    data = sys.argv[2] if len(sys.argv) > 2 else os.environ.get("ADJ_DATA_FOLDER", str(ROOT.parent / "shared/data"))
    with tempfile.TemporaryDirectory() as folder:
        folder = Path(folder)
        for name, volume, flags in synthetic(folder):
            check(program, name, volume, flags, folder)
        if data == "none":
            return
        for volume, flags in REAL:
            assert (Path(data) / volume).exists(), f"there is no {data}/{volume}; `none` leaves real volumes out"
            check(program, volume, Path(data) / volume, flags, folder)


main()
