"""Memory: what opening, summing and building take, measured in processes of their own."""

import json
import subprocess
import sys

import numpy as np
import pytest

import adjsplat as adj

pytestmark = pytest.mark.skipif(sys.platform != "linux", reason="reads Linux's /proc")

MEASURE = """
import json, sys
import numpy as np
import adjsplat as adj

def kept(name):
    for line in open("/proc/self/status"):
        if line.startswith(name + ":"):
            return int(line.split()[1]) * 1024

def peak():
    return kept("VmHWM")
"""


def measured(code, *arguments):
    done = subprocess.run([sys.executable, "-c", MEASURE + code, *map(str, arguments)], capture_output=True, text=True)
    assert done.returncode == 0, done.stderr
    return json.loads(done.stdout)


def test_lanes_are_summed_without_a_copy(tmp_path):
    """Of a file of 300 MB: its own pages aside, the process grows by less than 20 MB."""
    path = tmp_path / "noise.adj"
    noise = np.random.default_rng(1).integers(0, 256, (128, 512, 512), np.uint8)
    adj.build(noise, path, visible=(60, None)).close()
    size, grown, total = measured(
        """
np.arange(1000).sum()
before = kept("RssAnon")
f = adj.open(sys.argv[1])
total = sum(int(a.sum(dtype=np.uint64)) for l in f.lanes.values() for a in (l.steps, l.values, l.normals))
print(json.dumps([f.nbytes, kept("RssAnon") - before, total]))
""",
        path,
    )
    assert size > 100e6 and total > 0
    assert grown < 20e6, f"{grown / 1e6:.1f} MB beside {size / 1e6:.0f} MB"


@pytest.mark.parametrize("where", ["memory", "file"])
def test_a_contiguous_array_is_not_copied(where, tmp_path):
    """A build of an array of 128 MiB, with little that is visible, takes less than a quarter of that beside it."""
    grown = measured(
        """
array = np.full((512, 512, 512), 7, np.uint8)
array[::64, ::8, ::8] = 200
before = kept("VmRSS")
f = adj.build(array, sys.argv[1] if len(sys.argv) > 1 else None, visible=(60, None))
print(json.dumps(peak() - before))
""",
        *([tmp_path / "a.adj"] if where == "file" else []),
    )
    assert grown < 512**3 / 4, f"{grown / 1e6:.0f} MB for an array of {512**3 / 1e6:.0f} MB"


def test_a_large_array_is_built_in_bounded_memory(tmp_path):
    """A lazy array of 1 GiB, of which no slab is kept, with 256 MiB."""
    used = measured(
        """
class Lazy:
    shape, dtype, chunks = (1024, 1024, 1024), np.dtype("u1"), (16, 1024, 1024)
    def __getitem__(self, key):
        planes = np.zeros((len(range(*key.indices(1024))), 1024, 1024), np.uint8)
        planes[:, ::16, ::16] = 200
        return planes
before = kept("VmRSS")
f = adj.build(Lazy(), sys.argv[1], visible=(60, None), memory="256MiB")
assert f.count == 1024 * 64 * 64
print(json.dumps(peak() - before))
""",
        tmp_path / "a.adj",
    )
    assert used < 256 * 2**20
