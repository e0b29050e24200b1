"""Processes and signals: pickles, forks, workers, Ctrl-C."""

import copy
import multiprocessing
import os
import pickle
import signal
import subprocess
import sys
import threading
import time

import numpy as np
import pytest

import adjsplat as adj


def test_models_are_pickled(file, model):
    for f in (adj.open(file), model, model.with_transfer(adj.TransferFunction.range(100))):
        g = pickle.loads(pickle.dumps(f))
        assert g.path == f.path and g.transfer == f.transfer and (g.to_numpy() == f.to_numpy()).all()
    f = adj.open(file)
    f.close()
    with pytest.raises(ValueError, match="closed"):
        pickle.dumps(f)
    kept = pickle.dumps(adj.open(file))
    file.unlink()
    with pytest.raises(FileNotFoundError):
        pickle.loads(kept)


def test_a_copied_model_is_the_model_also_when_its_file_is_gone(file):
    f = adj.open(file)
    file.unlink()
    assert copy.copy(f) is f and copy.deepcopy([f])[0] is f


def test_a_model_that_was_read_into_memory_is_read_into_memory_by_its_pickle(file):
    f = adj.open(file, mapped=False)
    for g in (f, f.with_transfer(adj.TransferFunction.range(100))):
        copied = pickle.loads(pickle.dumps(g))
        file.with_name("kept").write_bytes(file.read_bytes())
        with open(file, "r+b") as changed:
            changed.seek(file.stat().st_size // 2)
            changed.write(bytes(1000))
        assert (copied.to_numpy() == f.to_numpy()).all() and copied.transfer == g.transfer
        file.with_name("kept").replace(file)


def test_renderers_are_not_pickled(model):
    with pytest.raises(TypeError, match="pickle the model"):
        pickle.dumps(adj.Renderer(model, device="cpu"))


def test_errors_are_pickled(tmp_path):
    (tmp_path / "a.adj").write_bytes(b"nothing")
    with pytest.raises(adj.FormatError) as caught:
        adj.open(tmp_path / "a.adj")
    again = pickle.loads(pickle.dumps(caught.value))
    assert (again.rule, again.offset, str(again)) == (caught.value.rule, 0, str(caught.value))


def draw(f):
    return adj.render(f, size=(40, 30), azimuth=20).tobytes()


@pytest.mark.skipif(not hasattr(os, "fork"), reason="this system does not fork")
@pytest.mark.filterwarnings("ignore:.*fork.*:DeprecationWarning")
def test_a_forked_child_draws_the_same(file):
    f = adj.open(file)
    want = draw(f)
    with multiprocessing.get_context("fork").Pool(2) as pool:
        assert pool.map(draw, [f] * 4) == [want] * 4
    read, write = os.pipe()
    child = os.fork()
    if child == 0:
        # The child uses the map that its parent opened.
        os.write(write, b"same" if draw(f) == want else b"other")
        os._exit(0)
    assert os.read(read, 10) == b"same" and os.waitpid(child, 0)[1] == 0


def test_a_spawned_worker_draws_the_same(file):
    with multiprocessing.get_context("spawn").Pool(1) as pool:
        assert pool.apply(draw, (adj.open(file),)) == draw(file)


SLOW = """
import signal, sys, time
import numpy as np
import adjsplat as adj

# What a shell starts in the background inherits that Ctrl-C is ignored.
signal.signal(signal.SIGINT, signal.default_int_handler)

class Endless:
    shape, dtype = (60_000, 64, 64), np.dtype("u1")
    def __getitem__(self, key):
        time.sleep(0.002)
        return np.full((len(range(*key.indices(60_000))), 64, 64), 200, np.uint8)

print("ready", flush=True)
try:
    adj.build(Endless(), sys.argv[1], visible=(60, None))
except KeyboardInterrupt:
    print("stopped", flush=True)
"""


def check_ctrl_c_stops(within, code, *arguments):
    """Runs a program, sends it a Ctrl-C once it is ready and works, and checks that it stops within so many seconds."""
    child = subprocess.Popen([sys.executable, "-c", code, *arguments], stdout=subprocess.PIPE, text=True)
    assert child.stdout.readline() == "ready\n"
    time.sleep(0.7)
    start = time.monotonic()
    child.send_signal(signal.SIGINT)
    assert child.stdout.readline() == "stopped\n"
    assert time.monotonic() - start < within
    assert child.wait() == 0


def test_ctrl_c_stops_a_build_and_leaves_nothing(tmp_path):
    check_ctrl_c_stops(3, SLOW, tmp_path / "a.adj")
    assert list(tmp_path.iterdir()) == []


DRAWN = """
import signal
import numpy as np
import adjsplat as adj

signal.signal(signal.SIGINT, signal.default_int_handler)
f = adj.build(np.random.default_rng(1).integers(1, 255, (128, 128, 128)).astype("u1"), visible=(1, None))
print("ready", flush=True)
try:
    adj.render(f, (6000, 6000), quality="reference", mode="xray")
except KeyboardInterrupt:
    print("stopped", flush=True)
"""


def test_ctrl_c_stops_a_picture():
    check_ctrl_c_stops(5, DRAWN)


BRICKS = """
import signal, sys
import numpy as np
import adjsplat as adj

signal.signal(signal.SIGINT, signal.default_int_handler)
bricks = adj.Collection(sys.argv[1])
print("ready", flush=True)
try:
    bricks.render((6000, 6000), quality="reference")
except KeyboardInterrupt:
    print("stopped", flush=True)
"""


def test_ctrl_c_stops_the_first_picture_of_bricks(tmp_path):
    f = adj.build(np.random.default_rng(1).integers(1, 255, (128, 128, 128)).astype("u1"), visible=(1, None))
    adj.split(f, tmp_path / "a.adjs", slab=64)
    check_ctrl_c_stops(5, BRICKS, tmp_path / "a.adjs")


def test_other_threads_run_meanwhile(volume):
    """While a build works and a picture is drawn, another thread of Python counts."""
    big = np.repeat(np.repeat(np.repeat(volume, 8, 0), 8, 1), 8, 2)
    ticks, done = [], threading.Event()

    def count():
        while not done.is_set():
            ticks.append(time.monotonic())
            time.sleep(0.001)

    counter = threading.Thread(target=count)
    counter.start()
    start = time.monotonic()
    adj.render(adj.build(big, visible=(60, None)), size=(600, 600), quality="high")
    took = time.monotonic() - start
    done.set()
    counter.join()
    longest = max(b - a for a, b in zip(ticks, ticks[1:]))
    assert took > 0.1 and longest < took / 2, (took, longest)
