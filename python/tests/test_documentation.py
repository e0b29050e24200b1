"""Every example in the documentation runs: those of the docstrings, those of docs/python.md, those of the README."""

import doctest
import importlib
import pkgutil
import re

import numpy as np
import pytest
from conftest import REPOSITORY

import adjsplat as adj

MODULES = [adj.__name__] + [
    f"adjsplat.{module.name}" for module in pkgutil.iter_modules(adj.__path__) if module.name != "_native"
]


@pytest.mark.parametrize("name", MODULES)
def test_docstrings(name, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    if name.endswith("transfer"):
        pytest.importorskip("matplotlib")
    module = importlib.import_module(name)
    f = adj.build("phantom:gyroid", "engine.adj", shape=(64, 64, 64), dtype="u1", visible=(100, None))
    g = adj.build("phantom:gyroid", "pyramid.adj", shape=(64, 64, 64), dtype="u1", visible=(100, None), levels=2)
    known = {"adj": adj, "np": np, "f": f, "g": g}
    failed, _ = doctest.testmod(module, extraglobs=known, optionflags=doctest.ELLIPSIS | doctest.NORMALIZE_WHITESPACE)
    assert failed == 0


def test_the_docstrings_have_examples():
    finder = doctest.DocTestFinder()
    tests = [test for name in MODULES for test in finder.find(importlib.import_module(name))]
    assert sum(len(test.examples) for test in tests) > 30


def test_every_public_name_says_what_it_is():
    for name in adj.__all__:
        thing = getattr(adj, name)
        if name != "__version__":
            assert thing.__doc__ and len(thing.__doc__) > 30, name
        if isinstance(thing, type):
            for member, value in vars(thing).items():
                if not member.startswith("_") and (callable(value) or isinstance(value, (property, classmethod))):
                    assert value.__doc__, f"{name}.{member}"


def test_the_page_on_clusters_runs(tmp_path, monkeypatch):
    """The block of docs/clusters.md for one machine, in an empty folder."""
    for package in ("zarr", "dask"):
        pytest.importorskip(package)
    monkeypatch.chdir(tmp_path)
    page = (REPOSITORY / "docs" / "clusters.md").read_text(encoding="utf-8")
    (block,) = re.findall(r"```python\n(.*?)```", page, re.DOTALL)
    known = {}
    exec(compile(block, "docs/clusters.md", "exec"), known)
    assert (known["picture"][..., :3] < 0.99).any() and known["whole"].count == known["bricks"].count
    assert {path.name for path in tmp_path.iterdir()} == {"shell.zarr", "shell.adjs", "shell.png", "shell.adj"}


def test_the_page_runs_from_top_to_bottom(tmp_path, monkeypatch, capsys):
    """Each block of docs/python.md, in one namespace, in an empty folder."""
    for package in ("nibabel", "zarr", "dask", "xarray", "SimpleITK", "pyvista", "matplotlib", "anywidget"):
        pytest.importorskip(package)
    monkeypatch.chdir(tmp_path)
    monkeypatch.setenv("MPLBACKEND", "Agg")
    page = REPOSITORY / "docs" / "python.md"
    blocks = list(re.finditer(r"```python\n(.*?)```", page.read_text(encoding="utf-8"), re.DOTALL))
    assert len(blocks) >= 15
    known = {}
    for block in blocks:
        first_line = page.read_text(encoding="utf-8")[: block.start()].count("\n") + 2
        # Python counts lines from the top of the page, so that a failure names the line.
        exec(compile("\n" * (first_line - 1) + block[1], str(page), "exec"), known)
    made = {path.name for path in tmp_path.iterdir()}
    assert {
        "shell.adj",
        "shell.png",
        "half.png",
        "copper.png",
        "magma.png",
        "turn.apng",
        "bowl.adj",
        "bowl.png",
    } <= made
    assert "R4" in capsys.readouterr().out


def test_the_readme_runs(tmp_path, monkeypatch, volume):
    nibabel = pytest.importorskip("nibabel")
    monkeypatch.chdir(tmp_path)
    nibabel.save(nibabel.Nifti1Image(volume.T, np.eye(4)), "engine.nii.gz")
    text = (REPOSITORY / "python" / "README.md").read_text(encoding="utf-8")
    blocks = re.findall(r"```python\n(.*?)```", text, re.DOTALL)
    assert len(blocks) == 1
    exec(blocks[0], {})
    assert (tmp_path / "engine.png").exists()
