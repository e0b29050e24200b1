#!/usr/bin/env python3
"""The same sets drawn and held by adj, VTK, VolPack and OpenVDB, timed: docs/studies/0004-peers.md.

    cargo build --release -p adj && benches/peers/run.py --out FOLDER [--study]

Writes FOLDER/peers.json, FOLDER/peers.md (the tables) and FOLDER/pictures; --study also puts the tables into the study
and contact sheets into docs/pictures. What is missing is named in one line and left out. --sets and --programs measure
some again and leave the other rows as they are.
"""

import argparse
import importlib.util
import json
import os
import platform
import subprocess
import sys
import time
from pathlib import Path

HERE = Path(__file__).resolve().parent
ROOT = HERE.parent.parent
if importlib.util.find_spec("numpy") is None:
    sys.exit("peers: numpy is missing: pip install numpy vtk pillow")
sys.dont_write_bytecode = True

import measure  # noqa: E402
import sets  # noqa: E402
import tables  # noqa: E402
import views  # noqa: E402

PROGRAMS = ("adj", "volpack", "vtk", "openvdb")
ORDER = [source.name for source in sets.SETS]


def arguments():
    """What the command line says."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--out", type=Path, required=True, help="folder of results; sets are made in it once")
    parser.add_argument("--adj", type=Path, default=ROOT / "target/release/adj", help="our program")
    parser.add_argument("--volumes", type=Path, default=ROOT.parent / "shared/data", help="folder of real volumes")
    parser.add_argument("--sets", help="only these, separated by commas: " + ",".join(ORDER))
    parser.add_argument("--programs", help="only these: " + ",".join(PROGRAMS))
    parser.add_argument("--study", action="store_true", help="renew the tables of the study and its pictures")
    given = parser.parse_args()
    given.sets = among(given.sets, ORDER, "--sets")
    given.programs = among(given.programs, PROGRAMS, "--programs")
    if not given.adj.exists():
        sys.exit(f"peers: {given.adj} is missing: cargo build --release -p adj")
    return given


def among(text, known, flag):
    """The names that a flag gives, or all."""
    names = text.split(",") if text else list(known)
    for name in names:
        if name not in known:
            sys.exit(f"peers: {flag} {name} is none of {', '.join(known)}")
    return names


def available(programs, out):
    """The programs that can run here; the others are named with what they need."""
    usable = []
    for program in programs:
        lack = measure.lacks(program, out)
        if lack:
            print(f"peers: {program} is left out: {lack}", file=sys.stderr)
        else:
            usable.append(program)
    return usable


def machine(adj):
    """What it ran on."""
    lines = Path("/proc/cpuinfo").read_text().splitlines() if Path("/proc/cpuinfo").exists() else []
    names = [line.split(":")[1].strip() for line in lines if line.startswith("model name")]
    version = subprocess.run([adj, "--version"], stdout=subprocess.PIPE, text=True).stdout.strip()
    commit = subprocess.run(["git", "rev-parse", "--short", "HEAD"], cwd=ROOT, stdout=subprocess.PIPE, text=True)
    return {"processor": names[0] if names else platform.processor(), "processors": os.cpu_count(),
            "adj": version, "commit": commit.stdout.strip(), "date": time.strftime("%Y-%m-%d")}


def main():
    """Every set, every program; results are written after each set."""
    given = arguments()
    (given.out / "pictures").mkdir(parents=True, exist_ok=True)
    programs = available(given.programs, given.out)
    written = given.out / "peers.json"
    rows = json.loads(written.read_text())["rows"] if written.exists() else []
    began = time.monotonic()
    for source in sets.SETS:
        if source.name not in given.sets:
            continue
        if source.volume and not (given.volumes / source.place).exists():
            print(f"peers: {source.name} is left out: no {given.volumes / source.place}", file=sys.stderr)
            continue
        folder = given.out / "sets" / source.name
        described = sets.prepare(given.adj, source, given.volumes, folder)
        (folder / "views.txt").write_text(views.as_text(views.turn(described)))
        for program in programs:
            renewed = measure.rows(program, given.adj, described, folder, given.out)
            rows = [r for r in rows if (r["set"], r["program"]) != (source.name, program)] + renewed
        rows.sort(key=lambda row: (ORDER.index(row["set"]), PROGRAMS.index(row["program"])))
        written.write_text(json.dumps({"machine": machine(given.adj), "rows": rows}, indent=1))
    if not rows:
        sys.exit("peers: nothing was measured")
    document = json.loads(written.read_text())
    text = tables.all_tables(document)
    (given.out / "peers.md").write_text(text)
    print(text)
    print(f"{time.monotonic() - began:.0f} s", file=sys.stderr)
    if given.study:
        tables.renew(ROOT / "docs/studies/0004-peers.md", document)
        if importlib.util.find_spec("PIL") is None:
            print("peers: contact sheets are left out: pip install pillow", file=sys.stderr)
        else:
            import sheets

            sheets.write(given.out / "pictures", ORDER, ROOT / "docs/pictures")


if __name__ == "__main__":
    main()
