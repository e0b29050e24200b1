"""Pictures of a graphics device, judged by the processor's. ADJ_GPU=require makes the absence of a device a failure."""

import os

import numpy as np
import pytest

import adjsplat as adj


@pytest.fixture(scope="module")
def device():
    found = adj.devices()
    if not found:
        if os.environ.get("ADJ_GPU") == "require":
            pytest.fail("there is no graphics device")
        pytest.skip("there is no graphics device")
    return found[0]


def test_devices_are_described(device):
    assert set(device) == {"name", "kind", "interface", "driver"} and device["name"]


def test_a_device_draws_the_processors_pictures(device, model):
    renderer = adj.Renderer(model, device="gpu")
    assert renderer.device == device["name"]
    for view in ({"azimuth": 30}, {"azimuth": 60, "perspective": 40}, {"mode": "maximum"}, {"crop": np.s_[5:12]}):
        want = adj.render(model, size=(90, 70), quality="high", **view)
        got = renderer.render(size=(90, 70), quality="high", **view)
        assert adj.compare(want, got).psnr > 50, view
    part = device["name"].split()[0].lower()
    assert adj.Renderer(model, device=part).device == device["name"]


def test_a_transfer_function_of_the_renderer(device, model):
    dark = adj.TransferFunction.points([(60, "#200000", 0), (60, "#200000", 0.1), (200, "#400000", 0.9)])
    got = adj.Renderer(model, transfer=dark, device="gpu").render(size=(40, 40), quality="high")
    assert adj.compare(adj.render(model, transfer=dark, size=(40, 40), quality="high"), got).psnr > 50


def test_the_device_keeps_the_model_alive(device, file):
    f = adj.open(file)
    renderer = adj.Renderer(f, device="gpu")
    want = renderer.render(size=(40, 30))
    del f
    assert (renderer.render(size=(40, 30)) == want).all()


@pytest.mark.skipif(not hasattr(os, "fork"), reason="this system does not fork")
@pytest.mark.filterwarnings("ignore:.*fork.*:DeprecationWarning")
def test_a_forked_child_must_open_its_own(device, model):
    renderer = adj.Renderer(model, device="gpu")
    read, write = os.pipe()
    child = os.fork()
    if child == 0:
        try:
            renderer.render(size=(8, 8))
            os.write(write, b"drawn")
        except RuntimeError:
            os.write(write, b"raised")
        os._exit(0)
    assert os.read(read, 10) == b"raised" and os.waitpid(child, 0)[1] == 0


def test_too_little_video_memory_raises(device, model):
    with pytest.raises(ValueError):
        adj.Renderer(model, device="gpu", vram=1000).render(size=(800, 800))


def test_auto_is_never_software(model):
    renderer = adj.Renderer(model, device="auto")
    kinds = {entry["name"]: entry["kind"] for entry in adj.devices()}
    assert renderer.device == "cpu" or kinds[renderer.device] != "software"
