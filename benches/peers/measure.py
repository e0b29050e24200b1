"""Runs each program over a set and says what it took.

In: a set's folder. Out: rows of two kinds. `draw`: milliseconds of each view, by size, projection, threads and form.
`hold`: bytes, build time and, where it can be asked, the time to visit all visible voxels once.

A view's time is the best of REPEATS renders: other work on the machine only adds. The turn's first view warms up and
does not count. Each row has the machine's load before it ran, so that disturbed ones can be told.
"""

import importlib.util
import json
import os
import statistics
import subprocess
import sys
from pathlib import Path

import sets
import views

HERE = Path(__file__).resolve().parent
REPEATS = 3
THREADS = (1, 2)
PROJECTIONS = ("parallel", "perspective")
# Grey is VolPack's fastest; three channels of three materials do what the others do. Opacity at which a ray ends: what
# its manual suggests, and what our standard quality and VTK come near.
VOLPACK_FORMS = (("grey", 0.95), ("grey", 0.999), ("colour", 0.95), ("colour", 0.999))
NATIVE = {
    "volpack": ("volpack_render.c", ["gcc", "-O2"], ["-lvolpack", "-lm"], "apt-get install gcc libvolpack1-dev"),
    "openvdb": ("openvdb_hold.cpp", ["g++", "-O2", "-std=c++17"], ["-lopenvdb", "-ltbb", "-lImath"],
                "apt-get install g++ libopenvdb-dev libboost-dev"),
}


def lacks(program, out):
    """What a program needs and this machine has not, or nothing; compiles the native ones into `out`."""
    if program == "vtk":
        return None if importlib.util.find_spec("vtk") else "pip install vtk"
    if program not in NATIVE:
        return None
    source, compiler, libraries, needs = NATIVE[program]
    binary = native(program, out)
    if binary.exists() and binary.stat().st_mtime > (HERE / source).stat().st_mtime:
        return None
    try:
        words = [*compiler, "-o", binary, HERE / source, *libraries]
        ran = subprocess.run([*map(str, words)], stderr=subprocess.DEVNULL)
    except FileNotFoundError:
        return needs
    return None if ran.returncode == 0 else needs


def sizes(described):
    """Sides of the pictures: the larger for phantoms, whose voxels are small enough for it."""
    return (512, 1024) if described["place"].startswith("phantom:") else (512,)


def native(program, out):
    """Where a compiled program lies."""
    return out / Path(NATIVE[program][0]).stem


def rows(program, adj, described, folder, out):
    """All rows of a program and a set."""
    ask = {"adj": adj_rows, "volpack": volpack_rows, "vtk": vtk_rows, "openvdb": openvdb_rows}[program]
    return list(ask(adj, described, folder, out))


def json_of(*words):
    """What a program prints as JSON."""
    # VTK would first try a window system, and complain.
    environment = os.environ | {"VTK_DEFAULT_OPENGL_WINDOW": "vtkEGLRenderWindow", "PYTHONDONTWRITEBYTECODE": "1"}
    ran = subprocess.run([*map(str, words)], check=True, stdout=subprocess.PIPE, env=environment)
    return json.loads(ran.stdout)


def draw(described, program, size, threads, projection, frame_ms, **more):
    """A row of one turn, said aloud."""
    counted = frame_ms[1:]
    row = {"kind": "draw", "set": described["name"], "program": program, "form": "", "size": size, "threads": threads,
           "projection": projection, "visible": described["visible"], "median_ms": statistics.median(counted),
           "best_ms": min(counted), "worst_ms": max(counted), "frame_ms": frame_ms, "load": os.getloadavg()[0], **more}
    print(f"{row['set']}: {program} {row['form']} {size} {projection} {threads}: {row['median_ms']:.2f} ms",
          file=sys.stderr)
    return row


def hold(described, program, form, size_bytes, build_ms, **more):
    """A row of what holding the visible voxels takes."""
    return {"kind": "hold", "set": described["name"], "program": program, "form": form, "visible": described["visible"],
            "bytes": size_bytes, "build_ms": build_ms, "load": os.getloadavg()[0], **more}


def adj_rows(adj, described, folder, out):
    """Ours: three lanes with normals, which pictures are drawn from; one lane with, and without."""
    forms = [("xyz, normals", 1, []), ("xyz, normals", 2, []), ("x, normals", 2, ["--lanes", "x"]),
             ("x", 2, ["--lanes", "x", "--normals", "none"])]
    drawn = folder / "set.adj"
    for form, threads, flags in forms:
        file = drawn if form.startswith("xyz") else folder / "other.adj"
        look = ["--labels" if described["labels"] else "--tf", folder / "look.json"]
        shape = ["--dims", "x".join(map(str, described["dims"])), "--type", "u8",
                 "--spacing", "x".join(map(str, described["spacing"]))]
        words = ["build", folder / "codes.raw", *shape, *look, *flags, "--threads", threads, "-o", file]
        built = [sets.ask(adj, *words) for _ in range(REPEATS)]
        assert built[0]["visible_voxels"] == described["visible"], "codes and look give the same visible voxels"
        yield hold(described, "adj", form, built[0]["bytes_total"], 1e3 * min(b["seconds"] for b in built),
                   threads=threads)
    for size in sizes(described):
        for projection in PROJECTIONS:
            for threads in THREADS:
                picture = out / "pictures" / f"{described['name']}-adj-{projection}-{size}.png"
                stats = [adj_turn(adj, folder, size, threads, projection, picture) for _ in range(REPEATS)]
                best = [min(times) for times in zip(*(s["frame_ms"] for s in stats))]
                frames = stats[0]["frames"]
                more = {k: stats[0][k] // frames for k in ("splats_drawn", "splats_skipped")}
                walks = [statistics.median(s["walk_ms"][1:]) for s in stats if "walk_ms" in s]
                more |= {"walk_ms": min(walks)} if walks else {}
                yield draw(described, "adj", size, threads, projection, best, **more)


def adj_turn(adj, folder, size, threads, projection, picture):
    """Statistics of one turn of ours."""
    words = [adj, "render", folder / "set.adj", "-o", picture, "--renderer", "cpu", "--quality", "standard", "--quiet"]
    words += ["--size", f"{size}x{size}", "--threads", threads, "--frames", views.FRAMES, "--background", "black"]
    words += ["--azimuth", views.AZIMUTH, "--elevation", views.ELEVATION, "--stats", folder / "stats.json"]
    words += ["--perspective", views.FOV] if projection == "perspective" else []
    subprocess.run([*map(str, words)], check=True, stdout=subprocess.DEVNULL)
    return json.loads((folder / "stats.json").read_text())


def volpack_rows(_, described, folder, out):
    """VolPack: parallel views, one thread."""
    build_ms, size_bytes = [], 0
    for size in sizes(described):
        for form, opacity in VOLPACK_FORMS if size == 512 else VOLPACK_FORMS[::3]:
            picture = out / "pictures" / f"{described['name']}-volpack-{form}-{size}"
            said = json_of(native("volpack", out), folder, *described["dims"], *described["spacing"], size, opacity,
                           form, REPEATS, picture)
            build_ms.append(said["build_ms"])
            size_bytes = said["bytes"]
            yield draw(described, "volpack", size, 1, "parallel", said["frame_ms"], form=f"{form} {opacity}",
                       table_ms=statistics.median(said["table_ms"]))
    yield hold(described, "volpack", "", size_bytes, min(build_ms), threads=1)


def vtk_rows(_, described, folder, out):
    """VTK: two threads."""
    build_ms, size_bytes = [], 0
    for size in sizes(described):
        for projection in PROJECTIONS:
            picture = out / "pictures" / f"{described['name']}-vtk-{projection}-{size}"
            said = json_of(sys.executable, HERE / "vtk_cast.py", folder, size, 2, projection, REPEATS, picture)
            build_ms.append(said["build_ms"])
            size_bytes = said["bytes"]
            yield draw(described, "vtk", size, 2, projection, said["frame_ms"], version=said["version"])
    yield hold(described, "vtk", "", size_bytes, min(build_ms), threads=2)


def openvdb_rows(_, described, folder, out):
    """OpenVDB: what it holds; it draws nothing here."""
    said = json_of(native("openvdb", out), folder, *described["dims"], folder / "set.vdb")
    for form, one in said.items():
        assert one["visible"] == described["visible"], "the same voxels are active"
        yield hold(described, "openvdb", form, one["bytes"], one["build_ms"], threads=1,
                   file_bytes=one["file_bytes"], write_ms=one["write_ms"], visit_ms=one["visit_ms"])
