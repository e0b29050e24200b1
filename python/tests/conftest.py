"""Volumes and models that several tests use."""

import os
import pathlib

import numpy as np
import pytest

import adjsplat as adj

REPOSITORY = pathlib.Path(__file__).resolve().parents[2]


def blob(shape=(20, 24, 28), dtype=np.uint8):
    """A bright body off the middle of a dark volume, with a different profile along each axis."""
    z, y, x = np.meshgrid(*(np.linspace(-1, 1, points) for points in shape), indexing="ij")
    distance = np.sqrt((z / 0.7) ** 2 + ((y - 0.1) / 0.8) ** 2 + ((x + 0.2) / 0.6) ** 2)
    return (200 * np.clip(1.2 - distance, 0, 1)).astype(dtype)


@pytest.fixture(scope="session")
def volume():
    array = blob()
    array.flags.writeable = False
    return array


@pytest.fixture
def model(volume):
    return adj.build(volume, visible=(60, None), spacing=(1, 1.5, 2.5), origin=(10, -20, 30))


@pytest.fixture
def file(volume, tmp_path):
    """The path of the same model as a file."""
    path = tmp_path / "blob.adj"
    adj.build(volume, path, visible=(60, None), spacing=(1, 1.5, 2.5), origin=(10, -20, 30)).close()
    return path


@pytest.fixture(scope="session")
def real_data():
    """The folder of public volumes beside the repository; ADJ_DATA=require makes its absence a failure."""
    folder = pathlib.Path(os.environ.get("ADJ_DATA_FOLDER", REPOSITORY.parent / "shared" / "data"))
    if not folder.is_dir():
        if os.environ.get("ADJ_DATA") == "require":
            pytest.fail(f"{folder} is absent")
        pytest.skip(f"{folder} is absent")
    return folder
