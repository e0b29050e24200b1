"""Collections with MPI: any number of ranks builds the same bytes and draws the same picture."""

import os
import pathlib
import shutil
import subprocess
import sys

import numpy as np
import pytest
from conftest import REPOSITORY, blob

import adjsplat as adj

pytest.importorskip("mpi4py")
if shutil.which("mpirun") is None:
    pytest.skip("mpirun is absent", allow_module_level=True)

ALLOWED = {"OMPI_ALLOW_RUN_AS_ROOT": "1", "OMPI_ALLOW_RUN_AS_ROOT_CONFIRM": "1"}


def run(ranks, *words, folder):
    command = ["mpirun", "--oversubscribe", "-n", str(ranks), sys.executable, "-m", "adjsplat.mpi", *words]
    return subprocess.run(command, cwd=folder, capture_output=True, text=True, env=os.environ | ALLOWED, timeout=120)


@pytest.mark.parametrize("ranks", [1, 2, 3, 4])
def test_ranks_build_the_bytes_and_draw_the_picture_of_one(ranks, tmp_path):
    array = blob((24, 24, 28), np.int16) * 5
    np.save(tmp_path / "a.npy", array)
    whole = adj.build(array, tmp_path / "whole.adj", visible=(300, None))
    built = run(ranks, "build", "a.npy", "-o", "a.adjs", "--visible", "300..", "--slab", "5", folder=tmp_path)
    assert built.returncode == 0 and "5 bricks" in built.stdout, built.stderr
    adj.Collection(tmp_path / "a.adjs").join(tmp_path / "a.adj")
    assert pathlib.Path(tmp_path / "a.adj").read_bytes() == pathlib.Path(tmp_path / "whole.adj").read_bytes()
    view = ["--size", "50x41", "--azimuth", "20", "--elevation", "75", "--quality", "reference"]
    drawn = run(ranks, "render", "a.adjs", "-o", "a.exr", *view, folder=tmp_path)
    assert drawn.returncode == 0, drawn.stderr
    one = adj.render(whole, (50, 41), 20, 75, quality="reference")
    adj.save(tmp_path / "one.exr", one)
    assert adj.compare(tmp_path / "one.exr", tmp_path / "a.exr").psnr > 100
    assert {path.name for path in tmp_path.iterdir()} == {"a.npy", "whole.adj", "a.adjs", "a.adj", "a.exr", "one.exr"}


def test_ranks_build_and_draw_levels(tmp_path):
    array = blob((24, 24, 28), np.int16) * 5
    np.save(tmp_path / "a.npy", array)
    whole = adj.build(array, tmp_path / "whole.adj", visible=(300, None), levels=2)
    words = ["--visible", "300..", "--slab", "8", "--levels", "2"]
    built = run(2, "build", "a.npy", "-o", "a.adjs", *words, folder=tmp_path)
    assert built.returncode == 0, built.stderr
    adj.Collection(tmp_path / "a.adjs").join(tmp_path / "a.adj")
    assert pathlib.Path(tmp_path / "a.adj").read_bytes() == pathlib.Path(tmp_path / "whole.adj").read_bytes()
    view = ["--size", "50x41", "--elevation", "75", "--quality", "reference", "--level", "1"]
    drawn = run(2, "render", "a.adjs", "-o", "a.exr", *view, folder=tmp_path)
    assert drawn.returncode == 0, drawn.stderr
    adj.save(tmp_path / "one.exr", adj.render(whole, (50, 41), 0, 75, quality="reference", level=1))
    assert adj.compare(tmp_path / "one.exr", tmp_path / "a.exr").psnr > 100


def test_a_rank_that_fails_ends_all_with_its_message(tmp_path):
    np.save(tmp_path / "a.npy", blob())
    refused = [
        (["build", "no.npy", "-o", "a.adjs", "--visible", "60..", "--slab", "5"], "no.npy"),
        (["build", "a.npy", "-o", "a.adjs", "--visible", "250..", "--slab", "5"], "nothing is visible"),
        (["build", "a.npy", "-o", "a.adjs", "--transfer", "no.json", "--slab", "5"], "no.json"),
        (["render", "no.adjs", "-o", "a.png"], "no.adjs"),
    ]
    for words, part in refused:
        ran = run(3, *words, folder=tmp_path)
        lines = [line for line in ran.stderr.splitlines() if line.startswith("adjsplat.mpi:")]
        assert ran.returncode == 2 and len(lines) == 1 and part in lines[0], ran.stderr
    assert [path.name for path in tmp_path.iterdir()] == ["a.npy"]
    run(2, "build", "a.npy", "-o", "a.adjs", "--visible", "60..", "--slab", "5", folder=tmp_path)
    brick = adj.Collection(tmp_path / "a.adjs").bricks[2].file
    os.remove(tmp_path / "a.adjs" / brick)
    ran = run(2, "render", "a.adjs", "-o", "a.png", folder=tmp_path)
    assert ran.returncode == 2 and brick in ran.stderr and not (tmp_path / "a.png").exists()
    ran = run(2, "render", "a.adjs", "-o", "a.png", "--size", "20x20", "--partial", folder=tmp_path)
    assert ran.returncode == 0 and brick in ran.stderr and (tmp_path / "a.png").exists()


def test_a_picture_that_cannot_be_written_or_has_two_views_is_not_drawn(tmp_path):
    adj.split(adj.build(blob(), visible=(60, None)), tmp_path / "a.adjs", slab=8)
    camera = '{"position": [0, 90, 0], "target": [0, 0, 0], "up": [0, 0, 1], "fov": 60}'
    (tmp_path / "cam.json").write_text(camera)
    (tmp_path / "broken.json").write_text("{")
    refused = [
        (["-o", "a.jpg", "--camera", "none.json"], "must end in .png"),
        (["-o", "no/a.png", "--camera", "none.json"], "no such folder"),
        (["-o", "a.png", "--camera", "none.json"], "none.json"),
        (["-o", "a.png", "--camera", "broken.json"], "broken.json is no JSON"),
        (["-o", "a.png", "--camera", camera, "--azimuth", "0", "--zoom", "2"], "leave out --azimuth and --zoom"),
    ]
    for words, part in refused:
        ran = run(2, "render", "a.adjs", *words, folder=tmp_path)
        lines = [line for line in ran.stderr.splitlines() if line.startswith("adjsplat.mpi:")]
        assert ran.returncode == 2 and len(lines) == 1 and part in lines[0], ran.stderr
    for name, given in (("a.png", camera), ("b.png", "cam.json")):
        ran = run(2, "render", "a.adjs", "-o", name, "--size", "30x20", "--camera", given, folder=tmp_path)
        assert ran.returncode == 0, ran.stderr
    assert (tmp_path / "a.png").read_bytes() == (tmp_path / "b.png").read_bytes()


def test_ranks_build_no_collection_with_the_name_of_a_file(tmp_path):
    np.save(tmp_path / "a.npy", blob())
    ran = run(2, "build", "a.npy", "-o", "a.adj", "--visible", "60..", "--slab", "5", folder=tmp_path)
    assert ran.returncode == 2 and "end it in .adjs" in ran.stderr and len(list(tmp_path.iterdir())) == 1


def test_a_warning_about_the_volume_comes_from_one_rank(tmp_path):
    zarr = pytest.importorskip("zarr")
    stored = zarr.create_array(str(tmp_path / "v.zarr"), shape=(20, 24, 28), chunks=(6, 8, 28), dtype="u1")
    stored[:] = blob()
    ran = run(3, "build", "v.zarr", "-o", "a.adjs", "--visible", "60..", "--slab", "5", folder=tmp_path)
    assert ran.returncode == 0 and ran.stderr.count("3 of 12 chunks are absent") == 1, ran.stderr


OPEN_RANGE = """
import numpy as np
import adjsplat as adj
import adjsplat.mpi
from mpi4py import MPI

picture = adjsplat.mpi.render("a.adjs", size=(40, 30), quality="reference", transfer=adj.TransferFunction.range(10))
if MPI.COMM_WORLD.rank == 0:
    np.save("picture.npy", picture)
"""


def test_ranks_draw_an_open_range_as_one_process_does_and_warn_once(tmp_path):
    bricks = adj.split(adj.build(blob(), tmp_path / "a.adj", visible=(60, None)), tmp_path / "a.adjs", slab=5)
    command = ["mpirun", "--oversubscribe", "-n", "3", sys.executable, "-c", OPEN_RANGE]
    ran = subprocess.run(command, cwd=tmp_path, capture_output=True, text=True, env=os.environ | ALLOWED, timeout=60)
    assert ran.returncode == 0 and ran.stderr.count("are visible, but") == 1, ran.stderr
    with pytest.warns(UserWarning, match="are visible"):
        alone = bricks.render((40, 30), quality="reference", transfer=adj.TransferFunction.range(10))
    assert np.abs(np.load(tmp_path / "picture.npy") - alone).max() < 1e-5


IN_PIECES = """
import numpy as np
import adjsplat.mpi
from mpi4py import MPI

adjsplat.mpi.MOST_NUMBERS = 7
comm = MPI.COMM_WORLD
pictures = np.random.default_rng(1).random((comm.size, 11, 5, 4), np.float32)
found = adjsplat.mpi.composited(comm, pictures[comm.rank].copy(), "composite")
if comm.rank == 0:
    assert np.allclose(found, adjsplat.composite(pictures), atol=1e-6)
else:
    assert found is None
"""


@pytest.mark.parametrize("ranks", [1, 2, 3, 4])
def test_pictures_beyond_the_largest_message_are_put_together_in_pieces(ranks, tmp_path):
    command = ["mpirun", "--oversubscribe", "-n", str(ranks), sys.executable, "-c", IN_PIECES]
    ran = subprocess.run(command, cwd=tmp_path, capture_output=True, text=True, env=os.environ | ALLOWED, timeout=60)
    assert ran.returncode == 0, ran.stderr


@pytest.mark.parametrize(
    ("flag", "text", "example"),
    [("--visible", "abc", "300..3000"), ("--visible", "a..", "300.."), ("--levels", "x", "auto")],
)
def test_an_argument_that_cannot_be_read_is_refused_with_an_example(flag, text, example, capsys):
    from adjsplat.mpi import main

    with pytest.raises(SystemExit):
        main(["build", "a.npy", "-o", "a.adjs", "--slab", "5", flag, text])
    said = capsys.readouterr().err
    assert repr(text) in said and example in said and "value" not in said


INTERRUPTED = """
import sys
import numpy as np
import adjsplat.mpi
from mpi4py import MPI

rank = MPI.COMM_WORLD.rank

class Array:
    shape, dtype, reads = (24, 20, 20), np.dtype("u1"), 0

    def __getitem__(self, key):
        self.reads += 1
        if rank == 1 and self.reads == int(sys.argv[2]):
            raise {"exit": SystemExit(3), "interrupt": KeyboardInterrupt()}[sys.argv[1]]
        return np.full(self.shape, 100, np.uint8)[key]

try:
    adjsplat.mpi.build(Array(), "a.adjs", slab=4, visible=(60, None))
except BaseException as error:
    with open(f"rank-{rank}", "w") as file:
        file.write(f"{type(error).__name__}: {error}")
"""


@pytest.mark.parametrize(("how", "name"), [("exit", "SystemExit"), ("interrupt", "KeyboardInterrupt")])
@pytest.mark.parametrize("read", [1, 4])
def test_an_interrupted_rank_ends_all(how, name, read, tmp_path):
    command = ["mpirun", "--oversubscribe", "-n", "3", sys.executable, "-c", INTERRUPTED, how, str(read)]
    ran = subprocess.run(command, cwd=tmp_path, capture_output=True, text=True, env=os.environ | ALLOWED, timeout=60)
    told = {path.name: path.read_text().split(":", 1) for path in tmp_path.iterdir()}
    assert told["rank-1"][0] == name and sorted(told) == ["rank-0", "rank-1", "rank-2"], ran.stderr
    assert told["rank-0"] == told["rank-2"] == ["RuntimeError", f" rank 1: {name}"]


def test_the_commands_of_the_page_on_clusters_run(tmp_path):
    np.save(tmp_path / "volume.npy", blob((100, 90, 80), np.int16) * 5)
    page = (REPOSITORY / "docs/clusters.md").read_text()
    lines = [line.strip() for line in page.splitlines() if line.startswith("    mpirun")]
    assert len(lines) == 2
    path = os.pathsep.join([os.path.dirname(sys.executable), os.environ["PATH"]])
    environment = os.environ | ALLOWED | {"OMPI_MCA_rmaps_base_oversubscribe": "1", "PATH": path}
    for line in lines:
        subprocess.run(line, shell=True, cwd=tmp_path, env=environment, check=True, timeout=120)
    assert {path.name for path in tmp_path.iterdir()} == {"volume.npy", "volume.adjs", "volume.png"}
    whole = adj.build(np.load(tmp_path / "volume.npy"), tmp_path / "whole.adj", visible=(600, None))
    assert adj.Collection(tmp_path / "volume.adjs").join(tmp_path / "joined.adj").count == whole.count
    assert (tmp_path / "joined.adj").read_bytes() == (tmp_path / "whole.adj").read_bytes()


@pytest.mark.parametrize("partition", ["z", "xyz"])
def test_a_volume_in_files_is_built_by_ranks_too(partition, tmp_path):
    array = blob((24, 24, 28), np.int16) * 5
    (tmp_path / "slices").mkdir()
    for z, plane in enumerate(array):
        plane.tofile(tmp_path / "slices" / f"{z}.raw")
    header = ["NRRD0004", "type: short", "dimension: 3", "sizes: 28 24 24", "encoding: raw", "endian: little"]
    header.append("data file: %d.raw 0 23 1 2")
    (tmp_path / "slices" / "a.nhdr").write_text("\n".join(header) + "\n")
    words = ["build", "slices/a.nhdr", "-o", "a.adjs", "--visible", "300..", "--slab", "5", "--preview", "3"]
    built = run(3, *words, "--partition", partition, folder=tmp_path)
    assert built.returncode == 0, built.stderr
    bricks = adj.Collection(tmp_path / "a.adjs")
    assert bricks.preview.shape == (8, 8, 10)
    bricks.join(tmp_path / "a.adj")
    adj.build(tmp_path / "slices" / "a.nhdr", tmp_path / "whole.adj", visible=(300, None))
    assert (tmp_path / "a.adj").read_bytes() == (tmp_path / "whole.adj").read_bytes()
