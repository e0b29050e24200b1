"""Edits, judged by the same edits of a dense array."""

import warnings

import numpy as np
import pytest

import adjsplat as adj


def test_added_and_removed_voxels(model, volume, tmp_path):
    dense = model.to_numpy()
    mask = np.zeros(volume.shape, bool)
    mask[:, 10:14, :] = True
    places = np.array([[0, 0, 0], [19, 23, 27], [10, 12, 10], [3, 2, 1]])
    g = model.edit().remove(mask).add(places, [70, 80, 90, 100]).save(tmp_path / "g.adj")
    dense[mask] = 0
    dense[tuple(places.T)] = [70, 80, 90, 100]
    assert (g.to_numpy() == dense).all() and g.count == (dense > 0).sum()
    g.verify()
    assert model.count == (volume >= 60).sum()
    entry = g.attrs["edited"][0]
    assert entry["added"] == 4 and entry["removed"] == (model.to_numpy()[mask] > 0).sum()
    assert g.spacing == model.spacing and g.transfer == model.transfer and list(g.lanes) == ["x", "y", "z"]


def test_steps_follow_each_other(model, tmp_path):
    a = model.edit().add([[0, 0, 0]], 100).remove(np.array([[0, 0, 0]])).save(tmp_path / "a.adj")
    b = model.edit().remove(np.array([[0, 0, 0]])).add([[0, 0, 0]], 100).save(tmp_path / "b.adj")
    assert a.count == model.count and b.count == model.count + 1 and b[0, 0, 0] == 100


def test_a_dense_mask_removes_what_the_edit_has_added(model, tmp_path):
    mask = np.ones(model.shape, bool)
    mask[10] = False
    g = model.edit().add([[0, 0, 0], [10, 0, 0]], 100).remove(mask).save(tmp_path / "g.adj")
    assert (g.coordinates()[:, 0] == 10).all() and g[10, 0, 0] == 100
    assert g.count == 1 + (model.coordinates()[:, 0] == 10).sum()


def test_an_edit_without_effect_gives_the_same_voxels(model, tmp_path):
    for number, edit in enumerate(
        [model.edit(), model.edit().remove(np.zeros(model.count, bool)), model.edit().add([], [])]
    ):
        same = edit.save(tmp_path / f"{number}.adj")
        assert (same.coordinates() == model.coordinates()).all() and (same.normals() == model.normals()).all()


def test_a_dense_mask_is_looked_up_at_the_visible_voxels(model, tmp_path, monkeypatch):
    monkeypatch.setattr(adj.edit, "LOOKED_UP", 100)
    mask = np.zeros(model.shape, bool)
    mask[:, ::2] = True
    g = model.edit().remove(mask).save(tmp_path / "g.adj")
    assert g.count == (model.coordinates()[:, 1] % 2 == 1).sum() > 0


def test_another_transfer_function_stays_with_what_an_edit_or_a_copy_returns(model, tmp_path):
    shown = model.with_transfer(adj.TransferFunction.range(150, opacity=0.3))
    assert shown.save(tmp_path / "a.adj").transfer == shown.transfer
    assert shown.edit().remove(model.coordinates()[:1]).save(tmp_path / "b.adj").transfer == shown.transfer
    # The files keep that of the build, which says what is stored.
    assert adj.open(tmp_path / "a.adj").transfer == adj.open(tmp_path / "b.adj").transfer == model.transfer


def test_the_callers_array_may_change_before_the_edit_is_saved(model, tmp_path):
    positions = model.coordinates()[:5].astype(np.uint32)
    edit = model.edit().remove(positions)
    positions[:] = model.coordinates()[100:105]
    assert (edit.save(tmp_path / "g.adj").coordinates() == model.coordinates()[5:]).all()


def test_a_mask_of_voxels(model, tmp_path):
    bright = model.values() >= 120
    g = model.edit().remove(~bright).save(tmp_path / "g.adj")
    assert (g.coordinates() == model.coordinates()[bright]).all()


def test_a_model_may_be_closed_while_its_edit_is_saved(file, tmp_path):
    f = adj.open(file).with_transfer(adj.TransferFunction.range(150))
    look = f.transfer
    g = f.edit().remove([[0, 0, 0]]).save(tmp_path / "g.adj", progress=lambda *_: f.close())
    assert f.closed and g.transfer == look and g.count > 0


def test_normals_are_stored(model, tmp_path):
    normal = np.array([[3.0, 0, 4.0], [0, -2.0, 0]])
    g = model.edit().add([[0, 0, 0], [0, 0, 5]], 100, normals=normal).add([[0, 0, 9]], 100).save(tmp_path / "g.adj")
    got = g.normals()[:3]
    assert np.abs(got - [[0.6, 0, 0.8], [0, -1, 0], [0, 0, 0]]).max() < 0.02
    turned = adj.build(model.to_numpy(), visible=(60, None), direction=(0, -1, 0, 0, 0, -1, 1, 0, 0))
    h = turned.edit().add([[0, 0, 0], [0, 0, 5]], 100, normals=normal).save(tmp_path / "h.adj")
    assert np.abs(h.normals()[:2] - [[0.6, 0, 0.8], [0, -1, 0]]).max() < 0.02


def test_normals_of_a_level_are_lit_in_full(tmp_path):
    """Their lowest bits say how alike a block's normals are: they were those of the direction, and light was mottled."""
    z, y, x = np.mgrid[:32, :32, :32] - 16
    whole = adj.build((8 * np.sqrt(x * x + y * y + z * z)).astype(np.uint8), visible=(90, 110), levels=2)
    level = adj.split(whole, tmp_path / "a.adjs", slab=16, preview=2).preview
    bits = level.lanes["x"].bits[1]
    normals = np.random.default_rng(1).normal(size=(level.count, 3))
    g = level.edit().add(level.coordinates(), level.values(), normals=normals).save(tmp_path / "g.adj")
    lane = g.lanes["x"]
    codes = lane.normals[lane.steps > 0]
    assert (codes & 1 == 0).all() and (codes >> bits & 3 == 0).all() and np.unique(codes).size > 100


def test_magnitudes_are_stored(volume, tmp_path):
    f = adj.build(volume, transfer=adj.TransferFunction.contour(100))
    with pytest.raises(ValueError, match="magnitudes"):
        f.edit().add([[0, 0, 0]], 100).save(tmp_path / "g.adj")
    magnitude = float(f.magnitudes().mean())
    g = f.edit().add([[0, 0, 0]], 100, magnitudes=magnitude).save(tmp_path / "g.adj")
    assert g.magnitudes()[0] == pytest.approx(magnitude, rel=0.03)


def test_values_above_all_others_keep_their_type(tmp_path):
    f = adj.build(
        np.full((4, 4, 4), 100, np.uint16) + np.arange(4, dtype=np.uint16), visible=(100, None), value_bits=16
    )
    high = f._native.value_scale[0] + f._native.value_scale[1] * 65535
    if high > 103:
        g = f.edit().add([[0, 0, 0]], high).save(tmp_path / "g.adj")
        assert g[0, 0, 0] == high


@pytest.mark.parametrize(
    ("edit", "error"),
    [
        (lambda e: e.add([[0, 0, 28]], 100), ValueError),
        (lambda e: e.add([[-1, 0, 0]], 100), ValueError),
        (lambda e: e.add([[2**40, 0, 0]], 100), ValueError),
        (lambda e: e.add([[0, 0]], 100), ValueError),
        (lambda e: e.add([0, 0, 0], 100), ValueError),
        (lambda e: e.add([[0.5, 0, 0]], 100), TypeError),
        (lambda e: e.add([["a", "b", "c"]], 100), TypeError),
        (lambda e: e.add([[0, 0, 0]], [1, 2]), ValueError),
        (lambda e: e.add([[0, 0, 0]], "bright"), TypeError),
        (lambda e: e.add([[0, 0, 0]], np.nan), ValueError),
        (lambda e: e.add([[0, 0, 0]], 1e9), ValueError),
        (lambda e: e.add([[0, 0, 0]], -1), ValueError),
        (lambda e: e.add([[0, 0, 0]], 100, normals=[1, 0]), ValueError),
        (lambda e: e.add([[0, 0, 0]], 100, magnitudes=1), ValueError),
        (lambda e: e.add(np.ma.masked_less([[0, 0, 0]], 1), 100), TypeError),
        (lambda e: e.add([[0, 0, 0]], np.ma.masked_less([100], 200)), TypeError),
        (lambda e: e.remove(np.ma.masked_less([[0, 0, 0]], 1)), TypeError),
        (lambda e: e.remove(np.ma.masked_array(np.ones((20, 24, 28), bool), True)), TypeError),
        (lambda e: e.remove(np.ones((2, 2, 2), bool)), ValueError),
        (lambda e: e.remove(np.ones(7, bool)), ValueError),
        (lambda e: e.remove(np.ones((20, 24, 28), bool)), ValueError),
    ],
)
def test_wrong_edits_raise_and_leave_nothing(model, tmp_path, edit, error):
    with pytest.raises(error):
        edit(model.edit()).save(tmp_path / "g.adj")
    assert list(tmp_path.iterdir()) == []


def test_levels_of_detail_are_made_and_those_of_before_an_edit_are_left_out(tmp_path):
    def levels(model):
        return sum(kind.startswith("level") for kind in _section_kinds(model.path))

    data = np.full((16, 16, 16), 200, np.uint8)
    f = adj.build(data, tmp_path / "a.adj", visible=(100, None), levels=3)
    assert levels(f) == 3
    with pytest.warns(adj.BuildWarning, match="3 levels of detail"):
        g = f.edit().remove([[0, 0, 0]]).save(tmp_path / "b.adj")
    assert levels(g) == 0
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        assert levels(f.edit().remove([[0, 0, 0]]).save(tmp_path / "c.adj", levels=2)) == 2
        assert levels(f.edit().remove([[0, 0, 0]]).save(tmp_path / "d.adj", levels=0)) == 0
        assert levels(adj.build(data, tmp_path / "e.adj", visible=(100, None), levels="auto")) == 0
    for wrong in (16, -1, "many"):
        with pytest.raises(ValueError, match="levels"):
            adj.build(data, visible=(100, None), levels=wrong)


def _section_kinds(path):
    """What the sections of a file hold: "level 2", else a number."""
    with open(path, "rb") as file:
        head = file.read(256 + 32 * 64)
    count = int.from_bytes(head[12:16], "little")
    kinds = [int.from_bytes(head[256 + 32 * at :][:2], "little") for at in range(count)]
    return [f"level {kind - 0x8000}" if 0x8000 < kind < 0x8010 else str(kind) for kind in kinds]
