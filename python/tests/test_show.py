"""The notebook's widget and napari's reader, without a browser and without napari."""

import pathlib

import numpy as np
import pytest

import adjsplat as adj


def test_the_widget_draws_what_its_view_says(model, tmp_path):
    pytest.importorskip("anywidget")
    widget = adj.show(model, size=(40, 30), azimuth=20, device="cpu", mode="xray")

    def shown():
        (tmp_path / "shown.png").write_bytes(widget.png)
        return tmp_path / "shown.png"

    def drawn(**view):
        return adj.render(model, size=(40, 30), mode="xray", background="white", dtype=np.uint8, **view)

    assert adj.compare(drawn(azimuth=20), shown()).display_max_abs == 0
    widget.view = [50.0, 10.0, 2.0, 0.0, 0.25]
    assert adj.compare(drawn(azimuth=50, elevation=10, zoom=2), shown()).display_max_abs == 0 and widget.drawn == 0.25
    widget.view = [50.0, 10.0, 2.0, 1.0, 0.5]
    assert adj.compare(drawn(azimuth=50, elevation=10, zoom=2, quality="draft"), shown()).display_max_abs == 0
    with pytest.raises(TypeError, match="show takes no dtype"):
        adj.show(model, device="cpu", dtype="uint8")
    # The page waits for `drawn`, which comes also where a picture cannot be drawn.
    with pytest.raises(ValueError):
        widget.view = [50.0, 10.0, -2.0, 0.0, 0.75]
    assert widget.drawn == 0.75


def test_napari_finds_the_reader(file):
    npe2 = pytest.importorskip("npe2")
    manifest = npe2.PluginManifest.from_file(pathlib.Path(adj.__file__).parent / "napari.yaml")
    (reader,) = manifest.contributions.readers
    (command,) = manifest.contributions.commands
    assert reader.command == command.id and reader.filename_patterns == ["*.adj"]
    module, name = command.python_name.split(":")
    read = getattr(__import__(module, fromlist=[name]), name)(str(file))
    assert len(read(str(file))) == 1
    from adjsplat.napari import get_reader

    assert get_reader("a.tif") is None and get_reader([str(file)]) is None and get_reader("absent.adj") is None


def test_a_layer_lies_where_the_model_does(volume):
    from adjsplat.napari import layer

    turn = (0.0, -1.0, 0.0, 1.0, 0.0, 0.0, 0.0, 0.0, 1.0)
    f = adj.build(volume, visible=(60, None), spacing=(1, 1.5, 2.5), origin=(10, -20, 30), direction=turn)
    for most_bytes, step in ((10**9, 1), (2000, 2)):
        data, properties, kind = layer(f, "blob", most_bytes)
        assert kind == "image" and data.nbytes <= most_bytes and properties["metadata"]["step"] == step
        for index in ((0, 0, 0), (1, 2, 3)):
            at = [part.start + step * i for part, i in zip(f.bounds, index)]
            assert data[index] == f[tuple(at)]
            world = f.affine @ [*at[::-1], 1]
            assert np.allclose((properties["affine"] @ [*index, 1])[:3], world[2::-1])
    labels = adj.build((volume // 60).astype(np.uint8), labels="distinct")
    assert layer(labels, "labels")[2] == "labels"
