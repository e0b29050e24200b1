"""Reading models: facts, lanes, positions, values, normals and dense blocks, judged by the dense array."""

import numpy as np
import pytest
from conftest import blob

import adjsplat as adj
from adjsplat.lanes import TILE


def kept(volume):
    return np.where(volume >= 60, volume, 0)


def test_facts_are_those_of_the_build(model, volume):
    assert model.shape == volume.shape and model.ndim == 3 and model.size == volume.size
    assert model.count == (volume >= 60).sum()
    assert model.spacing == (1, 1.5, 2.5) and model.origin == (10, -20, 30)
    assert model.direction == (1, 0, 0, 0, 1, 0, 0, 0, 1)
    assert (model.affine == [[1, 0, 0, 10], [0, 1.5, 0, -20], [0, 0, 2.5, 30], [0, 0, 0, 1]]).all()
    assert model.dtype == np.uint8 and model.path is None and model.nbytes > 1000
    assert model.attrs["values"]["highest"] == volume.max() and model.attrs["source"]["format"] == "array"
    with pytest.raises(TypeError):
        model.attrs["mine"] = 1
    model.attrs["values"]["highest"] = -7
    assert model.attrs["values"]["highest"] == volume.max()


def test_bounds_are_the_smallest_box(model, volume):
    want = tuple(slice(at.min(), at.max() + 1) for at in np.nonzero(volume >= 60))
    assert model.bounds == want
    assert (model[model.bounds] == kept(volume)[want]).all()


def test_positions_values_and_nonzero_follow_numpy(model, volume):
    dense = kept(volume)
    assert (model.to_numpy() == dense).all() and model.to_numpy().dtype == np.uint8
    assert (np.asarray(model) == dense).all()
    assert (model.coordinates() == np.argwhere(dense)).all() and model.coordinates().dtype == np.uint16
    assert all((a == b).all() for a, b in zip(model.nonzero(), np.nonzero(dense), strict=True))
    assert (model.values() == dense[np.nonzero(dense)]).all()
    assert (model.to_numpy(dtype=np.float32, fill=-5) == np.where(dense, dense.astype(int), -5)).all()
    for dtype in ("i1", ">i2", "f4", "f8"):
        assert (np.asarray(model, dtype=dtype) == model.to_numpy(dtype=dtype)).all()
    assert np.asarray(model, dtype="i1").max() == 127 and np.asarray(model, dtype="i8").max() == dense.max()
    assert np.isnan(model.to_numpy(dtype=np.float32, fill=np.nan)).sum() == (dense == 0).sum()


def test_normals_point_against_the_gradient(volume):
    smooth = blob(dtype=np.float32)
    model = adj.build(smooth, visible=(60, None), spacing=(1, 1.5, 2.5), normal_bits=16)
    gz, gy, gx = np.gradient(smooth, 2.5, 1.5, 1.0)
    gradient = np.stack([gx, gy, gz], axis=-1)[model.nonzero()]
    inner = np.abs(gradient).sum(axis=1) > 0
    want = -gradient[inner] / np.linalg.norm(gradient[inner], axis=1, keepdims=True)
    assert inner.sum() > 1000
    assert np.abs(model.normals()[inner] - want).max() < 2e-3
    # Along axes that are turned, the same gradient points elsewhere in the world.
    turn = (0.0, -1.0, 0.0, 0.0, 0.0, -1.0, 1.0, 0.0, 0.0)
    turned = adj.build(smooth, visible=(60, None), spacing=(1, 1.5, 2.5), normal_bits=16, direction=turn)
    assert np.abs(turned.normals()[inner] - want @ np.reshape(turn, (3, 3)).T).max() < 2e-3
    with pytest.raises(ValueError, match="no normals"):
        adj.build(volume, visible=(60, None), normal_bits=0).normals()
    with pytest.raises(ValueError, match="no magnitudes"):
        model.magnitudes()
    assert (adj.build(smooth, transfer=adj.TransferFunction.contour(80)).magnitudes() > 0).all()


@pytest.mark.parametrize(
    "key",
    [
        np.s_[3],
        np.s_[-1],
        np.s_[5:9],
        np.s_[5:9, :, 4],
        np.s_[..., 7],
        np.s_[:, ..., :],
        np.s_[4, 5, 6],
        np.s_[::3, ::-2, 20:3:-4],
        np.s_[9:2],
        np.s_[100:200, :, 2:3],
        np.s_[()],
        np.s_[np.int64(4), 1:2],
    ],
    ids=str,
)
def test_indices_are_those_of_numpy(model, volume, key):
    got, want = model[key], kept(volume)[key]
    assert got.shape == want.shape and (got == want).all() and got.dtype == want.dtype


@pytest.mark.parametrize(
    ("key", "error"),
    [
        (20, IndexError),
        (-21, IndexError),
        ((0, 0, 28), IndexError),
        ((0, 0, 0, 0), IndexError),
        ((Ellipsis, Ellipsis), IndexError),
        (1.5, TypeError),
        ("x", TypeError),
        (None, TypeError),
        ([1, 2], TypeError),
        (np.s_[::0], ValueError),
    ],
    ids=str,
)
def test_other_indices_raise(model, key, error):
    with pytest.raises(error):
        model[key]


def test_a_lane_says_the_same_as_the_array(file, volume):
    """Decodes each lane by the rules of formats/adj-1.md with nothing but numpy."""
    with adj.open(file) as f:
        assert list(f.lanes) == ["x", "y", "z"]
        low, step = f._native.value_scale
        for axis, lane in f.lanes.items():
            assert lane.tiles.dtype == TILE and lane.line_ends.dtype == np.uint16
            assert lane.normals.dtype == np.uint16 and lane.magnitudes.size == 0
            dense = np.zeros(volume.shape[::-1])
            u_axis, v_axis = (a for a in range(3) if a != "xyz".index(axis))
            line = 0
            for tile in lane.tiles:
                first = int(tile["first_record"])
                start = 0
                for bit in range(64):
                    if not int(tile["occupancy"]) >> bit & 1:
                        continue
                    end = int(lane.line_ends[line])
                    steps = lane.steps[first + start : first + end]
                    at = [0, 0, 0]
                    at[u_axis], at[v_axis] = 8 * int(tile["tile_u"]) + bit % 8, 8 * int(tile["tile_v"]) + bit // 8
                    places = np.cumsum(np.where(steps == 0, 255, steps.astype(int))) - 1
                    for place, code, is_voxel in zip(places, lane.values[first + start : first + end], steps > 0):
                        at["xyz".index(axis)] = place
                        if is_voxel:
                            dense[tuple(at)] = low + step * int(code)
                    start, line = end, line + 1
            assert (dense.T == kept(volume)).all(), axis


def test_wide_lanes_have_wide_types():
    wide = np.zeros((2, 2, 1500), np.uint16)
    wide[:, :, ::7] = np.arange(215, dtype=np.uint16) * 300
    f = adj.build(wide, visible=(1, None), value_bits=16, normal_bits=16)
    lane = f.lanes["x"]
    assert (lane.line_ends.dtype, lane.values.dtype, lane.normals.dtype) == (np.uint32, np.uint16, np.uint32)
    assert f.lanes["y"].line_ends.dtype == np.uint16
    assert f.dtype == np.uint16 and (f.to_numpy() == wide).all()
    assert list(adj.build(wide, visible=(1, None), lanes="x").lanes) == ["x"]


def test_arrays_outlive_the_model_and_stay_read_only(file):
    f = adj.open(file)
    lane = f.lanes["y"]
    arrays = [lane.steps, lane.values, lane.tiles, lane.line_ends, lane.normals]
    sums = [array.view(np.uint8).sum() for array in arrays]
    f.close()
    del f, lane
    assert [array.view(np.uint8).sum() for array in arrays] == sums
    for array in arrays:
        with pytest.raises(ValueError):
            array[0] = array[0]
        with pytest.raises(ValueError):
            array.flags.writeable = True


def test_a_replaced_file_stays_what_it_was(file, volume):
    f = adj.open(file)
    adj.build(volume, file, visible=(150, None))
    assert f.count == (volume >= 60).sum()
    with adj.open(file) as g:
        assert g.count == (volume >= 150).sum()


def test_a_file_in_memory_may_be_cut(file, model):
    f = adj.open(file, mapped=False)
    want = model.to_numpy()
    file.write_bytes(b"")
    assert f.path == str(file) and (f.to_numpy() == want).all()
    with pytest.raises(adj.FormatError):
        adj.open(file, mapped=False)


def test_a_closed_model_raises_value_error_from_everything(file):
    f = adj.open(file)
    with f:
        pass
    assert f.closed and "closed" in repr(f)
    uses = [
        name for name in dir(adj.Model) if not name.startswith("_") and name not in ("close", "closed", "path", "ndim")
    ]
    arguments = {
        "save": ("x.adj",),
        "export": ("x.npz",),
        "with_transfer": ("ct-bone",),
        "missing_values": ("ct-bone",),
        "block": ((0, 0, 0), (1, 1, 1)),
    }
    for name in uses:
        with pytest.raises(ValueError, match="closed"):
            used = getattr(f, name)
            used = used(*arguments.get(name, ()))
            used.remove(np.zeros((0, 3), int)).save("x.adj")
    for use in (lambda: f[0], lambda: f.__enter__(), lambda: adj.render(f), lambda: np.asarray(f), lambda: list(f)):
        with pytest.raises(ValueError, match="closed"):
            use()


def test_verify_and_save(file, tmp_path, model):
    with adj.open(file) as f:
        f.verify()
    saved = model.save(tmp_path / "saved.adj")
    assert saved.path == str(tmp_path / "saved.adj") and (saved.to_numpy() == model.to_numpy()).all()
    content = bytearray(file.read_bytes())
    content[-300] ^= 1
    file.write_bytes(content)
    with adj.open(file) as f, pytest.raises(adj.FormatError) as caught:
        f.verify()
    assert caught.value.rule.startswith("R") and caught.value.offset > 0 and caught.value.path == str(file)


def test_dtypes_hold_every_value(volume):
    for dtype, scale, want in [
        (np.uint8, 1, "uint8"),
        (np.int16, -7, "int16"),
        (np.uint16, 300, "uint16"),
        (np.int32, 3000, "int32"),
        (np.float32, 0.37, "float32"),
        (np.float64, 1e200, "float64"),
    ]:
        scaled = (volume.astype(np.float64) * scale).astype(dtype)
        low, high = sorted([60 * scale, 1000 * scale])
        f = adj.build(scaled, visible=(low, high), value_bits=16)
        assert f.dtype == want, dtype
        seen = (scaled >= low) & (scaled <= high)
        error = np.abs(f.to_numpy()[seen].astype(np.float64) - scaled[seen]).max()
        assert error <= f.attrs["values"]["rounding"] * 1.01 + abs(scale) * 1e-4, dtype
