"""Hostile input: whatever Python hands over, an exception of the right kind comes back, and the process lives."""

import pickle

import numpy as np
import pytest
from conftest import REPOSITORY, blob

import adjsplat as adj

ONES = np.ones((4, 5, 6), np.uint8)
NAN = np.full((4, 4, 4), np.nan, np.float32)


class Shaped:
    """Claims a shape and a type, and gives what it is told to."""

    def __init__(self, shape, dtype, slices):
        self.shape, self.dtype, self.slices = shape, dtype, slices

    def __getitem__(self, key):
        return self.slices(key)


class Shrinking(np.ndarray):
    """Gives slices of another shape than its own."""

    def __getitem__(self, key):
        return np.asarray(self)[key][:2]


ARRAYS = {
    "no dimensions": (np.float64(3), ValueError),
    "one dimension": (np.ones(5), ValueError),
    "two dimensions": (np.ones((5, 5)), ValueError),
    "four dimensions": (np.ones((2, 2, 2, 2)), ValueError),
    "zero size": (np.ones((0, 5, 5)), ValueError),
    "zero width": (np.ones((5, 5, 0)), ValueError),
    "too long": (np.lib.stride_tricks.as_strided(np.ones(1, np.uint8), (1, 1, 65_536), (0, 0, 0)), ValueError),
    "complex": (np.ones((2, 2, 2), complex), TypeError),
    "text": (np.full((2, 2, 2), "a"), TypeError),
    "objects": (np.full((2, 2, 2), None), TypeError),
    "dates": (np.zeros((2, 2, 2), "M8[s]"), TypeError),
    "records": (np.zeros((2, 2, 2), [("a", "u1")]), TypeError),
    "long double": (np.ones((2, 2, 2), np.longdouble), TypeError),
    "masked": (np.ma.masked_less(ONES, 2), TypeError),
    "whole numbers beyond 32 bits": (np.full((2, 2, 2), 2**40), ValueError),
    "natural numbers beyond 32 bits": (np.full((2, 2, 2), 2**40, np.uint64), ValueError),
    "all NaN": (np.full((2, 2, 2), np.nan), ValueError),
    "nothing visible": (np.zeros((2, 2, 2)), ValueError),
    "a list": ([[[1, 2], [3, 4]]], TypeError),
    "None": (None, TypeError),
    "a number": (5, TypeError),
    "an empty list": ([], TypeError),
    "a shape of text": (Shaped(("a", 2, 2), np.uint8, lambda key: ONES), (TypeError, ValueError)),
    "a negative shape": (Shaped((-2, 2, 2), np.uint8, lambda key: ONES), (TypeError, ValueError, OverflowError)),
    "a type that is none": (Shaped((2, 2, 2), "no type", lambda key: ONES), TypeError),
    "slices of another shape": (Shaped((4, 5, 6), np.uint8, lambda key: ONES[:, :2]), ValueError),
    "slices that are None": (Shaped((4, 5, 6), np.uint8, lambda key: None), (TypeError, ValueError, IndexError)),
    "slices of another type": (Shaped((4, 5, 6), np.uint8, lambda key: ONES[key] * 300.0), ValueError),
    "slices of text": (Shaped((4, 5, 6), np.uint8, lambda key: np.full((1, 5, 6), "a")), ValueError),
    "slices that end early": (Shaped((4, 5, 6), np.uint8, lambda key: ONES[:0]), (IndexError, ValueError)),
    "an array whose slices are smaller": (ONES.view(Shrinking), ValueError),
    "a view of memory": (memoryview(ONES), TypeError),
    "slices that raise": (Shaped((4, 5, 6), np.uint8, lambda key: 1 // 0), ZeroDivisionError),
}


@pytest.mark.parametrize("name", ARRAYS)
@pytest.mark.parametrize("where", ["memory", "file"])
def test_arrays(name, where, tmp_path):
    array, error = ARRAYS[name]
    with pytest.raises(error):
        adj.build(array, tmp_path / "out.adj" if where == "file" else None, visible=(1, None))
    assert list(tmp_path.iterdir()) == []


OPTIONS = {
    "NaN spacing": ({"spacing": (1, np.nan, 1)}, ValueError),
    "negative spacing": ({"spacing": (1, -1, 1)}, ValueError),
    "zero spacing": ({"spacing": (1, 0, 1)}, ValueError),
    "two spacings": ({"spacing": (1, 1)}, ValueError),
    "spacing of text": ({"spacing": "abc"}, ValueError),
    "infinite origin": ({"origin": (0, 0, np.inf)}, ValueError),
    "flat direction": ({"direction": (1, 0, 0, 1, 0, 0, 0, 0, 1)}, ValueError),
    "long direction": ({"direction": (2, 0, 0, 0, 1, 0, 0, 0, 1)}, ValueError),
    "NaN direction": ({"direction": (np.nan,) * 9}, ValueError),
    "short direction": ({"direction": (1, 0, 0)}, ValueError),
    "frame": ({"frame": "XYZ"}, ValueError),
    "two ways": ({"visible": (1, 2), "labels": "distinct"}, ValueError),
    "visible NaN": ({"visible": (np.nan, None)}, ValueError),
    "visible backwards": ({"visible": (3, 1)}, ValueError),
    "visible of three": ({"visible": (1, 2, 3)}, ValueError),
    "palette that is none": ({"labels": "ct-bone"}, ValueError),
    "labels of the file": ({"labels": "file"}, ValueError),
    "unknown preset": ({"transfer": "bones"}, ValueError),
    "lanes": ({"lanes": "y"}, ValueError),
    "value bits": ({"value_bits": 12}, ValueError),
    "value bits of text": ({"value_bits": "8"}, TypeError),
    "negative value bits": ({"value_bits": -8}, ValueError),
    "normal bits": ({"normal_bits": 4}, ValueError),
    "little memory": ({"memory": 1000}, ValueError),
    "memory": ({"memory": "much"}, ValueError),
    "negative memory": ({"memory": -1}, ValueError),
    "no threads": ({"threads": 0}, ValueError),
    "too many threads": ({"threads": 10**9}, ValueError),
    "progress": ({"progress": 5}, TypeError),
    "unit": ({"unit": 5}, TypeError),
    "options of files": ({"level": 1}, ValueError),
}


@pytest.mark.parametrize("name", OPTIONS)
def test_options(name, tmp_path):
    options, error = OPTIONS[name]
    if not {"visible", "transfer", "labels"} & options.keys():
        options = {**options, "visible": (1, None)}
    with pytest.raises(error):
        adj.build(ONES, tmp_path / "out.adj", **options)
    assert list(tmp_path.iterdir()) == []


def test_every_truncation_of_a_file_raises(file, tmp_path):
    content = file.read_bytes()
    cut = tmp_path / "cut.adj"
    for length in [0, 1, 7, 8, 100, 255, 256, 257, *range(300, len(content), 977), len(content) - 1]:
        cut.write_bytes(content[:length])
        with pytest.raises((adj.FormatError, OSError)) as caught:
            adj.open(cut)
        if length:
            assert caught.value.offset <= length and caught.value.rule[0] == "R"


def test_damaged_files_raise_or_give_something(file, tmp_path):
    """A byte is changed, the checksum of the header put right by reading it as damaged data: nothing crashes."""
    content = file.read_bytes()
    damaged = tmp_path / "damaged.adj"
    chance = np.random.default_rng(1)
    opened = 0
    for _ in range(300):
        bytes_ = bytearray(content)
        for at in chance.integers(0, len(content), 3):
            bytes_[at] = chance.integers(0, 256)
        damaged.write_bytes(bytes_)
        try:
            f = adj.open(damaged)
        except (adj.FormatError, ValueError):
            continue
        opened += 1
        assert f.to_numpy().shape == f.shape and len(f.values()) <= f.count
        assert f.coordinates().max(initial=0) < max(f.shape)
        f.normals(), f.bounds, f.attrs, f.nonzero()
        adj.render(f, size=(16, 16))
    assert opened > 100


def flip_a_bit(path):
    """Changes a bit of a value's code in an .adj file; its header stays."""
    content = bytearray(path.read_bytes())
    content[content.find(adj.open(path).lanes["x"].values.tobytes())] ^= 1
    path.write_bytes(content)


WRITERS = {
    "split": lambda f, folder, **options: adj.split(f, folder / "a.adjs", slab=8, **options),
    "save": lambda f, folder, **options: f.save(folder / "a.adj", **options),
    "edit": lambda f, folder, **options: f.edit().remove([[0, 0, 0]]).save(folder / "a.adj", **options),
    "export": lambda f, folder, **options: f.export(folder / "a.nii", **options),
}


@pytest.mark.parametrize("name", WRITERS)
def test_a_damaged_file_is_not_written_on_as_a_sound_one(name, file, tmp_path):
    flip_a_bit(file)
    with pytest.raises(adj.FormatError, match="blob.adj.*R12"):
        WRITERS[name](adj.open(file), tmp_path)
    assert [path.name for path in tmp_path.iterdir()] == ["blob.adj"]
    assert WRITERS[name](adj.open(file), tmp_path, verify=False)


def test_damaged_bricks_are_not_joined(file, tmp_path):
    bricks = adj.split(adj.open(file), tmp_path / "a.adjs", slab=8)
    flip_a_bit(tmp_path / "a.adjs" / bricks.bricks[1].file)
    damaged = adj.Collection(tmp_path / "a.adjs")
    assert damaged.faults == [] and len(damaged.verify()) == 1
    for join in (lambda: damaged.join(tmp_path / "b.adj"), lambda: adj.open(tmp_path / "a.adjs")):
        with pytest.raises(adj.FormatError) as caught:
            join()
        assert caught.value.path.endswith(bricks.bricks[1].file)
    with pytest.warns(adj.BuildWarning, match="left out: .*brick.*R12"):
        rest = pickle.loads(pickle.dumps(adj.Collection(tmp_path / "a.adjs", partial=True))).join(tmp_path / "b.adj")
    assert 0 < rest.count < bricks.count
    rest.verify()
    assert damaged.join(tmp_path / "b.adj", verify=False).count == bricks.count


def test_frozen_files_that_must_be_refused_are():
    refused = sorted((REPOSITORY / "formats" / "examples").glob("x-*.adj"))
    assert refused
    for path in refused:
        with pytest.raises((adj.FormatError, ValueError)):
            adj.open(path).verify()


def test_paths_that_are_no_files_raise(tmp_path):
    for path, error in [
        (tmp_path, ValueError),
        (tmp_path / "nothing", FileNotFoundError),
        (tmp_path / "a" / "b", FileNotFoundError),
        ("", (OSError, ValueError)),
        ("a\0b", (OSError, ValueError)),
        (5, TypeError),
        (None, TypeError),
    ]:
        with pytest.raises(error):
            adj.open(path)


def test_a_block_beyond_the_volume_takes_no_memory(tmp_path):
    class Sparse:
        shape, dtype, chunks = (3000, 10, 60_000), np.dtype("u1"), (1, 10, 60_000)

        def __getitem__(self, key):
            plane = np.zeros((len(range(*key.indices(3000))), 10, 60_000), np.uint8)
            plane[:, 0, 0] = 1
            return plane

    f = adj.build(Sparse(), visible=(1, None), lanes="x")
    with pytest.raises(ValueError, match="beyond the volume"):
        f.block((0, 0, 0), (2**30, 2**20, 2**10), fill=1)
    with pytest.raises(ValueError, match="beyond the volume"):
        f.block((0, 0, 0), (1, 11, 1))
    with pytest.raises(ValueError, match="beyond the volume"):
        f.block((-1, 0, 0), (1, 1, 1))
    with pytest.raises(ValueError, match="beyond the volume"):
        f.block((2**70, 0, 0), (1, 1, 1))
    assert f[2999, 0, :5].tolist() == [1, 0, 0, 0, 0]


@pytest.mark.parametrize(
    ("dtype", "fill"),
    [("u1", -1), ("u1", 300), ("u1", 0.5), ("c8", 0), ("S1", 0), ("i8", 0), ("u1", np.nan), ("f4", 1e300)],
)
def test_blocks_of_other_types_raise(model, dtype, fill):
    with pytest.raises((ValueError, TypeError, OverflowError)):
        model.to_numpy(dtype=dtype, fill=fill)


def test_big_endian_blocks_are_native(model):
    assert (model.to_numpy(dtype=">u2") == model.to_numpy()).all()


def test_an_array_that_changes_meanwhile_gives_some_model():
    array = blob()

    def grow(phase, done, total):
        array[:] = 255 - array

    assert adj.build(array, visible=(1, None), progress=grow).count > 0


ARGUMENTS = {
    "threads with a fraction": (
        lambda f: adj.render(f, threads=1.5),
        TypeError,
        "threads must be a whole number, not 1.5",
    ),
    "true threads": (lambda f: adj.render(f, threads=True), TypeError, "threads must be a whole number, not True"),
    "no quality": (lambda f: adj.render(f, quality=None), TypeError, "quality must be a string, not None"),
    "no device": (lambda f: adj.render(f, device=None), TypeError, "device must be a string, not None"),
    "negative vram": (lambda f: adj.Renderer(f, device="gpu", vram=-1), ValueError, "vram is -1"),
    "a NaN in a camera": (
        lambda f: adj.render(f, camera=f_camera(f) | {"position": (np.nan, 0, 0)}),
        ValueError,
        "the numbers of a camera must be finite",
    ),
    "complex numbers in a camera": (
        lambda f: adj.render(f, camera=f_camera(f) | {"up": 1j}),
        TypeError,
        "a camera has real numbers, not 1j",
    ),
    "an object in a camera": (
        lambda f: adj.render(f, camera=f_camera(f) | {"up": object}),
        TypeError,
        "a camera has real numbers, not <class 'object'>",
    ),
    "a plane without a direction": (
        lambda f: adj.render(f, clip=((0, 0, 0), (0, 0, 0))),
        ValueError,
        "clip plane: must have a finite point and a finite normal that is not 0",
    ),
    "a plane of four numbers": (lambda f: adj.render(f, clip=(0, 0, 1, 5)), ValueError, "clip must be a point and a"),
    "a truth value as an index": (lambda f: f[True], TypeError, "indexed by whole numbers and slices, not bool"),
    "a value in a model": (lambda f: 150 in f, TypeError, ""),
    "a huge fill value": (lambda f: f.to_numpy(fill=10**400), ValueError, "fill is beyond uint8"),
    "a huge fill value of an export": (
        lambda f: f.export("a.nii", fill=10**400),
        ValueError,
        "beyond all sample types",
    ),
    "a negative skip": (lambda f: raw(skip=-1), ValueError, "skip is -1, but must be 0 to 18446744073709551615"),
    "a skip with a point": (lambda f: raw(skip=1e3), TypeError, "skip must be a whole number, not 1000.0"),
    "a skip of text": (lambda f: raw(skip="198"), TypeError, "skip must be a whole number, not '198'"),
    "a negative volume": (
        lambda f: raw(volume_index=-1),
        ValueError,
        "volume_index is -1, but must be 0 to 4294967295",
    ),
    "a level of text": (lambda f: raw(level="1"), TypeError, "level must be a whole number, not '1'"),
    "a series with a fraction": (lambda f: raw(series=1.5), TypeError, "series must be a whole number, not 1.5"),
    "outside files in words": (
        lambda f: raw(outside_files="no"),
        TypeError,
        "outside_files must be True or False, not 'no'",
    ),
    "unscaled by a number": (lambda f: raw(unscaled=1), TypeError, "unscaled must be True or False, not 1"),
    "a shape beyond all": (lambda f: raw(shape=(10**30, 1, 1)), ValueError, "a side of shape is 1000000000000"),
    "a shape of one number": (lambda f: raw(shape=5), TypeError, "shape must be three whole numbers (z, y, x), not 5"),
    "a level beyond all": (lambda f: adj.render(f, level=10**30), ValueError, "level is 1000000000000"),
    "half a character": (
        lambda f: adj.build(ONES, visible=(1, 2), unit="\ud800"),
        ValueError,
        "unit is '\\ud800', but must be text without lone surrogates",
    ),
    "a NUL in a path": (
        lambda f: adj.open("a\0b"),
        ValueError,
        "a path cannot have the character NUL: 'a\\x00b'",
    ),
    "a folder as an output": (
        lambda f: adj.build(ONES, "no/../", visible=(1, None)),
        ValueError,
        "no/../ names a folder; give a file name",
    ),
    "a level to draw": (
        lambda f: adj.render(adj.build(ONES, visible=(1, None), levels=1).levels[1]),
        TypeError,
        "a level of detail is drawn from its model; give the model, and level=1",
    ),
    "a function that holds itself": (
        lambda f: adj.TransferFunction(circular()),
        ValueError,
        "a transfer function cannot hold itself",
    ),
    "a document with lines in its words": (
        lambda f: adj.TransferFunction.from_json('{"kind": "a\\nb"}'),
        ValueError,
        "unknown variant `a b`",
    ),
    "levels in an array": (
        lambda f: adj.build(ONES, visible=(1, None), levels=np.array([1, 2])),
        TypeError,
        "levels must be a whole number",
    ),
    "lanes in an array": (
        lambda f: adj.build(ONES, visible=(1, None), lanes=np.array([1, 2])),
        TypeError,
        "lanes must be a string",
    ),
    "a label without a colour": (
        lambda f: adj.build(ONES, labels={50: None}),
        TypeError,
        'a colour must be "#rrggbb" or three numbers from 0 to 1, not None',
    ),
    "an azimuth of a turn": (
        lambda f: list(adj.Renderer(f, device="cpu").turn(2, azimuth="a")),
        TypeError,
        "azimuth must be a number, not 'a'",
    ),
    "a camera of a turn": (
        lambda f: list(adj.Renderer(f, device="cpu").turn(2, camera={})),
        TypeError,
        "camera is not for turn, which makes its own",
    ),
    "retries of text": (lambda f: dask_build(retries="a"), TypeError, "retries must be a whole number, not 'a'"),
    "negative retries": (lambda f: dask_build(retries=-1), ValueError, "retries is -1, but must be 0 to"),
    "a text as an end": (lambda f: adj.build(ONES, visible=("1", None)), TypeError, "low must be a number, not '1'"),
    "one end": (lambda f: adj.build(ONES, visible=1), TypeError, "visible must be two values"),
    "a unit that is a number": (lambda f: adj.build(ONES, visible=(1, 2), unit=3), TypeError, "unit must be a string"),
    "bits with a fraction": (
        lambda f: adj.build(ONES, visible=(1, 2), value_bits=8.0),
        TypeError,
        "value_bits must be",
    ),
    "a label with a fraction": (
        lambda f: adj.TransferFunction.labels({1.5: "red"}),
        TypeError,
        "a label must be a whole",
    ),
    "a contour at NaN": (lambda f: adj.TransferFunction.contour(np.nan), ValueError, "must be finite"),
    "a size of one number": (lambda f: adj.render(f, 5), TypeError, "size must be (columns, rows), not 5"),
    "a size of three": (lambda f: adj.render(f, (5, 5, 5)), ValueError, "size must be (columns, rows), not (5, 5, 5)"),
    "half a frame": (lambda f: list(adj.Renderer(f, device="cpu").turn(2.5)), TypeError, "frames must be a whole"),
    "a list of labels": (lambda f: adj.TransferFunction.labels([1]), TypeError, "labels must be a dict of label to"),
    "a number as a function": (lambda f: adj.TransferFunction(5), TypeError, "a transfer function is made of a dict"),
    "progress of a build": (
        lambda f: adj.build(ONES, visible=(1, 2), progress=3),
        TypeError,
        "progress must be a function, not 3",
    ),
    "progress of an export": (lambda f: f.export("a.nii", progress=3), TypeError, "progress must be a function"),
    "progress of an edit": (lambda f: f.edit().save("a.adj", progress=3), TypeError, "progress must be a function"),
    "a camera in four dimensions": (
        lambda f: adj.render(f, camera=f_camera(f) | {"position": (1, 2, 3, 4)}),
        ValueError,
        "camera position must be three numbers (x, y, z), not (1, 2, 3, 4)",
    ),
    "a camera without height": (
        lambda f: adj.render(f, camera={"position": (0, 9, 0), "target": (0, 0, 0), "up": (0, 0, 1)}),
        ValueError,
        "camera: needs one of two: `fov` in degrees",
    ),
    "a camera of height 0": (
        lambda f: adj.render(f, camera=f_camera(f) | {"height": 0}),
        ValueError,
        "camera: height: is 0, but must be finite and above 0",
    ),
    "brick -1": (lambda f: plan().scan(-1, ONES), ValueError, "brick: -1 does not exist; there are 2"),
    "a huge brick": (lambda f: plan().samples_of(2**70), ValueError, "does not exist; there are 2"),
    "a folder that is no collection": (
        lambda f: adj.open(REPOSITORY),
        ValueError,
        "is no finished collection: it has no collection.json",
    ),
    "lighting in words": (lambda f: adj.render(f, lighting="no"), TypeError, "lighting must be True or False"),
    "exposure of a composite": (
        lambda f: adj.render(f, exposure=1),
        ValueError,
        'exposure is the brightness of mode "xray"',
    ),
    "a device without a name": (lambda f: adj.Renderer(f, device=""), ValueError, "device is empty"),
    "vram of the processor": (
        lambda f: adj.Renderer(f, device="cpu", vram=10**9),
        ValueError,
        "vram is the memory of a graphics device",
    ),
    "NaN in a picture to save": (lambda f: adj.save("a.png", NAN), ValueError, "samples that are NaN or infinite"),
    "NaN in pictures to put together": (lambda f: adj.composite([NAN]), ValueError, "samples that are NaN"),
    "NaN in a picture to compare": (lambda f: adj.compare(NAN, NAN), ValueError, "samples that are NaN"),
    "a point at infinity": (
        lambda f: adj.TransferFunction.points([(np.inf, "#fff", 1)]),
        ValueError,
        "the numbers of a transfer function must be finite",
    ),
}


def raw(**options):
    return adj.build("v.raw", visible=(1, None), **{"shape": (4, 5, 6), "dtype": "u1"} | options)


def dask_build(**options):
    return adj.dask.build(ONES, "a.adjs", slab=2, visible=(1, None), **options)


def circular():
    document = {"kind": "points"}
    document["points"] = document
    return document


def plan():
    return adj.BrickPlan(ONES, visible=(1, None), slab=2)


def f_camera(f):
    return adj.Renderer(f, device="cpu").camera(size=(8, 8))


@pytest.mark.parametrize("name", ARGUMENTS)
def test_arguments_raise_with_their_own_names(model, name):
    call, error, message = ARGUMENTS[name]
    with pytest.raises(error) as raised:
        call(model)
    assert message in str(raised.value) and raised.type is error and "\n" not in str(raised.value)


def test_a_file_of_a_transfer_function_that_is_no_text(tmp_path):
    (tmp_path / "a.json").write_bytes(b"\xff\xfe\x00")
    with pytest.raises(ValueError, match=r"a\.json"):
        adj.TransferFunction.read(tmp_path / "a.json")


def test_colour_maps_that_matplotlib_does_not_have():
    pytest.importorskip("matplotlib")
    with pytest.raises(ValueError, match='no colour map "nope"'):
        adj.TransferFunction.from_matplotlib("nope", (0, 1))


def test_dask_arrays_that_are_masked_or_of_unknown_shape():
    dask = pytest.importorskip("dask.array")
    masked = dask.ma.masked_less(dask.from_array(ONES), 2)
    with pytest.raises(TypeError, match="is masked"):
        adj.build(masked, visible=(1, None))
    unknown = dask.from_array(ONES)[dask.from_array(ONES[:, 0, 0]) > 0]
    with pytest.raises(ValueError, match="compute_chunk_sizes"):
        adj.build(unknown, visible=(1, None))


HUGE = 10**400
NUMBERS = {
    "a range's end": (lambda f: adj.TransferFunction.range(HUGE), ValueError, "low"),
    "a visible value": (lambda f: adj.build(ONES, visible=(1j, None)), TypeError, "low"),
    "a point's value": (lambda f: adj.TransferFunction.points([(HUGE, "#ffffff", 1)]), ValueError, "value"),
    "a point's opacity": (lambda f: adj.TransferFunction.points([(1, "#ffffff", None)]), TypeError, "opacity"),
    "a colour": (lambda f: adj.TransferFunction.points([(1, ("a", 0, 0), 1)]), TypeError, "colour"),
    "an azimuth": (lambda f: adj.render(f, (8, 8), azimuth=None), TypeError, "azimuth"),
    "a zoom": (lambda f: adj.render(f, (8, 8), zoom=HUGE), ValueError, "zoom"),
    "an error": (lambda f: adj.render(f, (8, 8), max_error="a"), TypeError, "max_error"),
    "a camera": (lambda f: adj.render(f, (8, 8), camera=1j), TypeError, "camera"),
    "an index": (lambda f: f[HUGE], IndexError, "out of bounds"),
}


@pytest.mark.parametrize("name", NUMBERS)
def test_a_number_that_is_none_is_named(name):
    use, error, word = NUMBERS[name]
    with pytest.raises(error, match=word) as raised:
        use(adj.build(blob(), visible=(60, None)))
    assert len(str(raised.value)) < 200


def test_paths_may_be_bytes(tmp_path):
    path = tmp_path / "blob.adj"
    adj.build(ONES, visible=(1, None), out=bytes(path))
    assert adj.open(bytes(path)).count == ONES.size
    ONES.tofile(tmp_path / "v.raw")
    for volume in (bytes(tmp_path / "v.raw"), [bytes(tmp_path / "v.raw")]):
        assert adj.build(volume, visible=(1, None), shape=ONES.shape, dtype="u1").count == ONES.size
