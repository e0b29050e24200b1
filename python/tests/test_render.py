"""Pictures: their shapes and colours, that they are the program's, and that threads do not change them."""

import concurrent.futures
import json

import numpy as np
import pytest

import adjsplat as adj
from adjsplat.pictures import to_srgb8


def test_shapes_types_and_light(model):
    linear = adj.render(model, size=(80, 60), azimuth=30, elevation=20)
    assert (adj.render(model, (80, 60), 30, 20) == linear).all()
    assert linear.shape == (60, 80, 4) and linear.dtype == np.float32
    assert 0 <= linear.min() and 0.5 < linear[..., 3].max() <= 1
    # Premultiplied: no colour is brighter than the light allows, and where nothing is, nothing shines.
    assert (linear[linear[..., 3] == 0] == 0).all()
    shown = adj.render(model, size=(80, 60), azimuth=30, elevation=20, dtype=np.uint8)
    assert shown.dtype == np.uint8 and (shown == to_srgb8(linear)).all()
    white = adj.render(model, size=(80, 60), azimuth=30, elevation=20, background="white", dtype="uint8")
    assert (white[..., 3] == 255).all() and (white[0, 0] == 255).all()


def test_a_picture_shows_what_is_where(volume):
    """From above, the body's silhouette is that of the array's projection, the right way round."""
    f = adj.build(volume, visible=(60, None))
    camera = {"position": [13.5, 11.5, 100], "target": [13.5, 11.5, 10], "up": [0, 1, 0], "height": 24}
    picture = adj.render(f, size=(28, 24), camera=camera, quality="high")
    silhouette = (volume >= 60).any(axis=0)[::-1]
    opacity = picture[..., 3]
    assert (opacity[silhouette] > 0.3).mean() > 0.97
    grown = silhouette.copy()
    for axis in (0, 1):
        for step in (-1, 1):
            grown |= np.roll(grown, step, axis)
    assert (opacity[~grown] < 0.3).mean() > 0.97
    # Mirrored either way it would agree less.
    agreement = lambda shape: np.corrcoef(opacity.ravel(), shape.ravel())[0, 1]
    assert agreement(silhouette) > agreement(silhouette[::-1]) + 0.02
    assert agreement(silhouette) > agreement(silhouette[:, ::-1]) + 0.02


def test_the_view_changes_the_picture(model):
    pictures = {
        name: adj.render(model, size=(48, 48), **view).tobytes()
        for name, view in {
            "front": {},
            "azimuth": {"azimuth": 40},
            "elevation": {"elevation": 40},
            "zoom": {"zoom": 2},
            "perspective": {"perspective": 40},
            "up": {"up": "-y"},
            "crop": {"crop": np.s_[5:10]},
            "maximum": {"mode": "maximum"},
            "grey": {"mode": "maximum-grey"},
            "xray": {"mode": "xray"},
            "bright": {"mode": "xray", "exposure": 3},
            "unlit": {"lighting": False},
            "sharp": {"sharpness": 1},
            "high": {"quality": "high"},
            "every": {"sampling": "every"},
            "transfer": {"transfer": adj.TransferFunction.range(60, 150, opacity=0.1)},
        }.items()
    }
    assert len(set(pictures.values())) == len(pictures)


def test_a_camera_is_the_view_that_it_came_from(model):
    renderer = adj.Renderer(model, device="cpu")
    view = dict(azimuth=30, elevation=-20, zoom=1.5, perspective=35)
    camera = renderer.camera(**view, size=(60, 40))
    assert set(camera) == {"position", "target", "up", "fov"}
    assert json.loads(json.dumps(camera)) == camera
    a = renderer.render(size=(60, 40), **view)
    assert (renderer.render(size=(60, 40), camera=camera) == a).all()
    assert (renderer.render(size=(60, 40), camera={name: np.array(part) for name, part in camera.items()}) == a).all()


def test_a_turn_has_one_scale(model):
    frames = list(adj.Renderer(model, device="cpu").turn(3, size=(40, 40), zoom=0.9))
    assert len(frames) == 3 and all(frame.shape == (40, 40, 4) for frame in frames)
    assert len({frame.tobytes() for frame in frames}) == 3


def test_another_transfer_function_warns_of_what_is_missing(model):
    with pytest.warns(UserWarning, match="does not store all of them"):
        adj.render(model, size=(16, 16), transfer=adj.TransferFunction.range(20))


def test_max_error_is_kept(model):
    exact = adj.render(model, size=(120, 120), quality="reference")
    for bound in (0.1, 0.01):
        assert np.abs(adj.render(model, size=(120, 120), max_error=bound) - exact).max() <= bound


def test_eight_threads_give_equal_pictures(file):
    with adj.open(file) as f, concurrent.futures.ThreadPoolExecutor(8) as pool:
        jobs = [pool.submit(adj.render, f, size=(200, 150), azimuth=33, threads=1 + at % 3) for at in range(24)]
        pictures = {job.result().tobytes() for job in jobs}
    assert pictures == {adj.render(file, size=(200, 150), azimuth=33).tobytes()}


def test_compare(model, tmp_path):
    a = adj.render(model, size=(64, 64), quality="reference")
    same = adj.compare(a, a)
    assert same.psnr == np.inf and same.max_abs == 0 and same.ssim == 1 and same.flip == 0 and same.energy == 0
    b = a.copy()
    row, column = np.argwhere(a[..., 3] > 0.5)[0]
    b[row, column, 1] += 0.25
    found = adj.compare(a, b)
    assert found.max_abs == pytest.approx(0.25) and found.max_at == (column, row)
    lit = (a != 0).any(axis=-1).sum()
    assert found.rmse == pytest.approx(0.25 / np.sqrt(4 * lit)) and found.psnr == pytest.approx(
        -20 * np.log10(found.rmse)
    )
    adj.save(tmp_path / "a.exr", a)
    assert adj.compare(tmp_path / "a.exr", a).max_abs == 0
    adj.save(tmp_path / "a.png", a)
    assert adj.compare(a, tmp_path / "a.png").display_psnr > 50
    assert (
        adj.compare(
            adj.render(model, size=(64, 64), quality="reference", dtype=np.uint8), tmp_path / "a.png"
        ).display_max_abs
        < 1e-6
    )


def test_pictures_are_saved_as_they_are_shown(model, tmp_path):
    pytest.importorskip("matplotlib")
    from matplotlib.image import imread

    shown = adj.render(model, size=(50, 40), background="#336699", dtype=np.uint8)
    adj.save(tmp_path / "a.png", shown)
    assert (np.round(imread(tmp_path / "a.png") * 255) == shown).all()
    frames = list(adj.Renderer(model, device="cpu").turn(3, size=(20, 10)))
    adj.save(tmp_path / "turn.apng", frames)
    content = (tmp_path / "turn.apng").read_bytes()
    assert content.startswith(b"\x89PNG") and content.count(b"fcTL") == 3


@pytest.mark.parametrize(
    ("options", "error"),
    [
        ({"size": (0, 5)}, ValueError),
        ({"size": (20000, 5)}, ValueError),
        ({"size": (1.5, 5)}, (TypeError, AttributeError)),
        ({"size": (5,)}, ValueError),
        ({"azimuth": float("nan")}, ValueError),
        ({"elevation": float("inf")}, ValueError),
        ({"zoom": 0}, ValueError),
        ({"perspective": 180}, ValueError),
        ({"up": "w"}, ValueError),
        ({"quality": "best"}, ValueError),
        ({"mode": "mip"}, ValueError),
        ({"sampling": "some"}, ValueError),
        ({"exposure": -1, "mode": "xray"}, ValueError),
        ({"sharpness": 2}, ValueError),
        ({"threads": 0}, ValueError),
        ({"threads": -1}, ValueError),
        ({"crop": np.s_[30:40]}, ValueError),
        ({"crop": np.s_[::2]}, ValueError),
        ({"max_error": -1}, ValueError),
        ({"max_error": 0.1, "quality": "high"}, ValueError),
        ({"background": "blue-ish"}, ValueError),
        ({"background": (1, 2, 3)}, ValueError),
        ({"dtype": np.int16}, ValueError),
        ({"device": "no such device"}, adj.DeviceError),
        ({"camera": {}}, ValueError),
        ({"camera": {"position": [0, 0, 0], "target": [0, 0, 0], "up": [0, 0, 1], "fov": 30}}, ValueError),
        ({"camera": {"position": [0, 0, float("nan")], "target": [0, 0, 0], "up": [0, 0, 1], "fov": 30}}, ValueError),
        (
            {"camera": {"position": [0, 9, 0], "target": [0, 0, 0], "up": [0, 0, 1], "fov": 30}, "azimuth": 5},
            ValueError,
        ),
    ],
    ids=str,
)
def test_wrong_options_raise(model, options, error):
    with pytest.raises(error):
        adj.render(model, **{"size": (16, 16), **options})


@pytest.mark.parametrize(
    "picture",
    [
        np.zeros((4, 4, 3), np.float32),
        np.zeros((4, 4), np.float32),
        np.zeros((0, 4, 4), np.float32),
        np.full((2, 2, 4), np.nan),
    ],
    ids=["three channels", "grey", "empty", "nan"],
)
def test_what_is_no_picture_raises(picture):
    with pytest.raises(ValueError):
        adj.compare(picture, picture)


def test_files_that_are_no_pictures_raise(tmp_path, model):
    picture = adj.render(model, size=(8, 8))
    with pytest.raises(ValueError):
        adj.save(tmp_path / "a.gif", picture)
    with pytest.raises(ValueError):
        adj.save(tmp_path / "a.png", [picture, picture])
    with pytest.raises(ValueError):
        adj.save(tmp_path / "a.apng", [picture, picture[:4]])
    with pytest.raises(ValueError):
        adj.save(tmp_path / "a.png", [])
    with pytest.raises(TypeError):
        adj.save(tmp_path / "a.png", picture.astype(int))
    (tmp_path / "b.png").write_bytes(b"nothing")
    with pytest.raises(ValueError):
        adj.compare(tmp_path / "b.png", picture)
    with pytest.raises(FileNotFoundError):
        adj.compare(tmp_path / "c.png", picture)
    assert sorted(path.name for path in tmp_path.iterdir()) == ["b.png"]
