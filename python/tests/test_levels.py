"""Levels of detail: judged by means over blocks of the dense array, in numpy."""

import pickle

import numpy as np
import pytest
from conftest import blob

import adjsplat as adj

#: The grid of the volume: z is so far apart that levels 1 and 2 halve x and y alone, and the third all axes.
SPACING, ORIGIN = (1.0, 1.0, 4.0), (10.0, -20.0, 30.0)


def solid():
    """A volume with an odd number of points along two axes."""
    return blob((21, 37, 50))


@pytest.fixture
def pyramid(tmp_path):
    return adj.build(solid(), tmp_path / "p.adj", visible=(60, None), spacing=SPACING, origin=ORIGIN, levels=3)


def blocks(dense, factors):
    """Returns a dense array as one of blocks (z, y, x, points of a block), with 0 beyond its end."""
    ends = [(0, -points % factor) for points, factor in zip(dense.shape, factors)]
    dense = np.pad(dense, ends)
    sides = [side for points, factor in zip(dense.shape, factors) for side in (points // factor, factor)]
    return np.moveaxis(dense.reshape(sides), (1, 3, 5), (3, 4, 5)).reshape(*sides[::2], -1)


def test_levels_have_the_grids_of_blocks(pyramid):
    assert pyramid.levels[0] is pyramid and [type(level) for level in pyramid.levels[1:]] == [adj.Level] * 3
    assert [level.level for level in pyramid.levels[1:]] == [1, 2, 3]
    assert [level.shape for level in pyramid.levels] == [(21, 37, 50), (21, 19, 25), (21, 10, 13), (11, 5, 7)]
    assert [level.spacing for level in pyramid.levels] == [SPACING, (2, 2, 4), (4, 4, 4), (8, 8, 8)]
    # A point of a level is the middle of its first block.
    assert [level.origin for level in pyramid.levels] == [
        ORIGIN,
        (10.5, -19.5, 30),
        (11.5, -18.5, 30),
        (13.5, -16.5, 32),
    ]
    assert all(level.direction == pyramid.direction for level in pyramid.levels)
    counts, sizes = [level.count for level in pyramid.levels], [level.nbytes for level in pyramid.levels]
    assert counts == sorted(counts, reverse=True) and sizes == sorted(sizes, reverse=True)
    assert sum(sizes[1:]) < sizes[0]
    assert adj.build(solid(), visible=(60, None)).levels[1:] == ()


def test_coverages_are_means_of_blocks(pyramid):
    visible = (solid() >= 60).astype(float)
    for number, factors in ((1, (1, 2, 2)), (2, (1, 4, 4)), (3, (2, 8, 8))):
        level = pyramid.levels[number]
        share = blocks(visible, factors).mean(axis=-1)
        assert (level.coordinates() == np.argwhere(share > 0)).all()
        want = share[level.nonzero()]
        # Level 1 is exact; coarser ones store a root in 7 bits, of what the level before has stored.
        assert np.abs(np.sqrt(level.coverage()) - np.sqrt(want)).max() <= (
            1e-7 if number == 1 else 0.51 / 127 * (number - 1)
        )
        places = np.indices(visible.shape).astype(float)
        weights = blocks(visible, factors)[level.nonzero()]
        for axis in range(3):
            # Coordinates of level 0 to those of the level, whose points are the middles of blocks.
            inside = (blocks(places[axis], factors) - (factors[axis] - 1) / 2) / factors[axis]
            mean = (inside[level.nonzero()] * weights).sum(axis=1) / weights.sum(axis=1)
            assert np.abs(level.centres()[:, axis] - mean).max() <= (1e-6 if number == 1 else 0.13)
        assert np.abs(level.centres() - level.coordinates()).max() <= 0.375


def test_values_are_means_of_what_is_seen(pyramid):
    """A block's value lies between the values of its voxels; where all are alike, it is their value."""
    dense = np.where(solid() >= 60, solid(), 0).astype(float)
    level = pyramid.levels[1]
    parts = blocks(dense, (1, 2, 2))[level.nonzero()]
    high = parts.max(axis=1)
    low = np.where(parts > 0, parts, np.inf).min(axis=1)
    values = level.values()
    assert level.dtype == pyramid.dtype == values.dtype == np.uint8
    assert (values >= low).all() and (values <= high).all() and (low < high).any()
    assert (level.to_numpy()[level.nonzero()] == values).all() and (level.to_numpy() > 0).sum() == level.count
    assert level.normals().shape == (level.count, 3)
    flat = adj.build(np.full((8, 8, 8), 77, np.uint8), visible=(60, None), levels=2)
    assert [set(level.values()) for level in flat.levels] == [{77}] * 3
    labels = np.ones((4, 4, 4), np.uint8)
    labels[:, :, 3] = 3
    mixed = adj.build(labels, labels="distinct", levels=1).levels[1]
    assert set(mixed.values()) == {1, 3} and mixed.values().dtype == np.uint8


def test_a_level_is_handed_out_as_a_model_is(pyramid):
    level = pyramid.levels[2]
    dense = np.asarray(level)
    assert (level[3:5, :, 2] == dense[3:5, :, 2]).all() and (level[level.bounds] > 0).any()
    assert level.ndim == 3 and level.size == dense.size and len(level) == 21 and level.unit == pyramid.unit
    assert level.attrs == pyramid.attrs
    lane = level.lanes["x"]
    assert list(level.lanes) == list(pyramid.lanes) and not lane.steps.flags.writeable
    # Coarser levels than the first have words, as formats/adj-1.md says; the voxels themselves have none.
    words, masks = lane.coverages, pyramid.levels[1].lanes["x"].coverages
    assert words.dtype == np.uint16 and masks.dtype == np.uint8 and pyramid.lanes["x"].coverages.size == 0
    stored = np.sort(((words[lane.steps > 0] & 127) / 127.0) ** 2)
    assert np.allclose(stored, np.sort(level.coverage()), atol=1e-6)
    shares = [bin(mask).count("1") / 8 for mask in masks[pyramid.levels[1].lanes["x"].steps > 0]]
    assert (np.sort(shares) == np.sort(pyramid.levels[1].coverage())).all()


def test_a_level_lies_in_the_world_where_its_blocks_do(pyramid):
    xarray = pytest.importorskip("xarray")
    assert xarray
    array = pyramid.levels[1].to_xarray()
    assert array.sizes == {"z": 21, "y": 19, "x": 25}
    assert (array.x == 10.5 + 2 * np.arange(25)).all() and (array.z == 30 + 4 * np.arange(21)).all()
    whole = pyramid.to_xarray()
    # The mean place of two neighbours is that of their block.
    assert (array.y[:18] == whole.y[:36].coarsen(y=2).mean()).all()


def test_other_packages_take_levels(pyramid):
    pytest.importorskip("dask")
    level = pyramid.levels[1]
    lazy = level.to_dask((8, 8, 8))
    assert (lazy.compute() == level.to_numpy()).all() and lazy.name != pyramid.to_dask((8, 8, 8)).name
    pytest.importorskip("SimpleITK")
    assert level.to_sitk().GetSpacing() == (2, 2, 4)


def test_levels_travel_and_end_with_their_model(pyramid):
    level = pyramid.levels[1]
    again = pickle.loads(pickle.dumps(level))
    assert again.level == 1 and (again.values() == level.values()).all()
    other = pyramid.with_transfer(adj.TransferFunction.range(150))
    assert (other.levels[1].values() == level.values()).all()
    array = level.lanes["x"].steps
    total = int(array.sum())
    pyramid.close()
    for use in (
        level.coverage,
        level.centres,
        level.values,
        lambda: level.shape,
        lambda: level[0],
        lambda: level.attrs,
    ):
        with pytest.raises(ValueError, match="closed"):
            use()
    assert int(array.sum()) == total and "closed" in repr(level) and "Level 1" in repr(again)


def test_a_level_is_drawn_when_it_is_asked_for(pyramid):
    def picture(f=pyramid, **look):
        return adj.render(f, (60, 50), 30, 20, **look)

    whole, plain = picture(level=0), adj.build(solid(), visible=(60, None), spacing=SPACING, origin=ORIGIN)
    assert (whole == picture(plain)).all()
    drawn = [picture(level=level) for level in range(4)]
    distances = [np.abs(picture - whole).mean() for picture in drawn]
    assert distances == sorted(distances) and distances[0] == 0 and distances[1] > 0
    # Voxels of a small picture are so small that a draft takes a level by itself.
    small = adj.render(pyramid, (16, 14), 30, 20, quality="draft")
    assert any((small == adj.render(pyramid, (16, 14), 30, 20, quality="draft", level=n)).all() for n in (1, 2, 3))
    assert (adj.Renderer(pyramid, device="cpu").render((60, 50), 30, 20, level=2) == drawn[2]).all()
    for level in (4, -1):
        with pytest.raises(ValueError, match="level"):
            picture(level=level)
    with pytest.raises(ValueError, match="level"):
        picture(plain, level=1)
    with pytest.raises(ValueError, match="max_error"):
        picture(level=1, max_error=0.1)
    with pytest.raises(TypeError):
        picture(level=0.5)


def test_napari_gets_a_multiscale_layer(pyramid):
    from adjsplat.napari import layer

    data, properties, kind = layer(pyramid, "blob", most_points=8)
    assert kind == "image" and properties["multiscale"] and properties["metadata"]["level"] == 0
    # Down to the first level with at most 8 points along each axis, which napari shows in 3-D.
    assert len(data) == 4 and max(data[2].shape) > 8 >= max(data[3].shape)
    # napari takes the quotients of shapes as the sizes of voxels.
    quotients = [np.divide(data[0].shape, level.shape).tolist() for level in data]
    assert quotients == [[1, 1, 1], [1, 2, 2], [1, 4, 4], [2, 8, 8]]
    assert sum(part.sum() for part in data[0]) == pyramid.values().sum()
    for number, part in enumerate(data):
        level = pyramid.levels[number]
        assert (np.sort(part[part > 0]) == np.sort(level.values())).all() and part.dtype == level.dtype
    # The affine is that of the finest: a bright voxel lies where the model has it.
    at = np.argwhere(data[0])[0]
    world = (properties["affine"] @ [*at, 1])[:3][::-1]
    assert np.allclose(world, (pyramid.affine @ [*pyramid.coordinates()[0][::-1], 1])[:3])


def test_napari_gets_coarser_levels_where_the_finest_do_not_fit(pyramid):
    from adjsplat.napari import layer

    whole = layer(pyramid, "blob", most_points=8)[0]
    less = sum(part.nbytes for part in whole[1:])
    data, properties, _ = layer(pyramid, "blob", less, 8)
    assert [part.shape for part in data] == [part.shape for part in whole[1:]]
    assert properties["metadata"]["level"] == 1
    at = np.argwhere(data[0])[0]
    world = (properties["affine"] @ [*at, 1])[:3][::-1]
    level = pyramid.levels[1]
    assert np.allclose(world, (level.affine @ [*level.coordinates()[0][::-1], 1])[:3])
    # One level alone is a plain layer, and a thinned one if even that does not fit.
    data, properties, _ = layer(pyramid, "blob", whole[3].nbytes, 8)
    assert data.shape == whole[3].shape and not properties["multiscale"] and properties["metadata"]["step"] == 1
    data, properties, _ = layer(pyramid, "blob", whole[3].nbytes - 1, 8)
    assert data.nbytes < whole[3].nbytes and properties["metadata"] == {
        "attrs": dict(pyramid.attrs),
        "step": 2,
        "level": 3,
    }
    # A small file stays one layer: napari's 3-D view shows the coarsest.
    data, properties, _ = layer(pyramid, "blob")
    assert isinstance(data, np.ndarray) and not properties["multiscale"] and properties["metadata"]["level"] == 0
