"""Results as Markdown tables, and into the study between its markers.

In: the document that `run.py` writes. Out: text. A table stands in the study between `<!-- table NAME -->` and
`<!-- end -->`; all else there is written by people.
"""

import re


class Rows:
    """The rows of a document, by what they say."""

    def __init__(self, document):
        self.rows = document["rows"]
        self.sets = list(dict.fromkeys(row["set"] for row in self.rows))

    def drawn_by(self, program, size):
        """The sets that a program drew at a size."""
        return [name for name in self.sets if self.one(kind="draw", set=name, size=size, program=program)]

    def one(self, **wanted):
        """The row that says all this, or nothing."""
        return next((row for row in self.rows if all(row.get(k) == v for k, v in wanted.items())), None)

    def draw(self, name, program, size, projection, threads, form=""):
        """A turn's row."""
        return self.one(kind="draw", set=name, program=program, size=size, projection=projection, threads=threads,
                        form=form)

    def hold(self, name, program, form="", **more):
        """What holding a set takes."""
        return self.one(kind="hold", set=name, program=program, form=form, **more)


def cell(row, key, form="{:.1f}", unit=1):
    """A number of a row in a unit, or a dash where there is none."""
    if not row or key not in row:
        return "-"
    return form.format(row[key] if unit == 1 else row[key] / unit)


def ratio(over, under):
    """How many times slower the first is; below 1 it is faster."""
    return f"{over['median_ms'] / under['median_ms']:.2f}" if over and under else "-"


def table(head, lines):
    """Markdown."""
    rule = "| --- " * len(head) + "|"
    return "\n".join(["| " + " | ".join(head) + " |", rule, *("| " + " | ".join(line) + " |" for line in lines)]) + "\n"


def volpack(rows, size):
    """Beside VolPack, parallel views."""
    head = ["set", "visible", "drawn", "adj, 1 thread", "adj, 2", "adj, 2, perspective", "VolPack grey 0.95",
            "colour 0.999", "adj, 2 / grey", "adj, 2 / colour", "adj, 1 / colour"]
    lines = []
    for name in rows.drawn_by("volpack", size):
        one, two = (rows.draw(name, "adj", size, "parallel", threads) for threads in (1, 2))
        perspective = rows.draw(name, "adj", size, "perspective", 2)
        grey, colour = (rows.draw(name, "volpack", size, "parallel", 1, form) for form in ("grey 0.95", "colour 0.999"))
        lines.append([name, cell(one, "visible", "{:,}"), cell(one, "splats_drawn", "{:,}"), cell(one, "median_ms"),
                      cell(two, "median_ms"), cell(perspective, "median_ms"), cell(grey, "median_ms", "{:.2f}"),
                      cell(colour, "median_ms", "{:.2f}"), ratio(two, grey), ratio(two, colour), ratio(one, colour)])
    return table(head, lines)


def vtk(rows, size):
    """Beside VTK's ray caster, two threads each."""
    head = ["set", "adj, parallel", "VTK, parallel", "VTK / adj", "adj, perspective", "VTK, perspective", "VTK / adj"]
    lines = []
    for name in rows.drawn_by("vtk", size):
        line = [name]
        for projection in ("parallel", "perspective"):
            ours, theirs = (rows.draw(name, program, size, projection, 2) for program in ("adj", "vtk"))
            line += [cell(ours, "median_ms"), cell(theirs, "median_ms", "{:.0f}"), ratio(theirs, ours)]
        lines.append(line)
    return table(head, lines)


def projections(rows, size):
    """What perspective costs us, two threads."""
    head = ["set", "parallel: median (best to worst)", "perspective: median (best to worst)", "perspective / parallel"]
    lines = []
    for name in rows.drawn_by("adj", size):
        pair = [rows.draw(name, "adj", size, projection, 2) for projection in ("parallel", "perspective")]
        spans = [f"{r['median_ms']:.1f} ({r['best_ms']:.1f} to {r['worst_ms']:.1f})" if r else "-" for r in pair]
        lines.append([name, *spans, ratio(pair[1], pair[0])])
    return table(head, lines)


MEGABYTE = 1_000_000


def held(rows):
    """Bytes of what each holds the visible voxels in."""
    head = ["set", "visible", "adj xyz, normals", "adj x, normals", "adj x", "VolPack", "VTK", "OpenVDB byte, memory",
            "OpenVDB byte, file", "OpenVDB float, memory", "OpenVDB half float, file"]
    lines = []
    for name in rows.sets:
        ours = [rows.hold(name, "adj", form) for form in ("xyz, normals", "x, normals", "x")]
        byte, single = (rows.hold(name, "openvdb", form) for form in ("byte", "float"))
        parts = [(row, "bytes") for row in (*ours, rows.hold(name, "volpack"), rows.hold(name, "vtk"))]
        parts += [(byte, "bytes"), (byte, "file_bytes"), (single, "bytes"), (single, "file_bytes")]
        lines.append([name, cell(ours[0], "visible", "{:,}"),
                      *(cell(row, key, "{:.2f}", MEGABYTE) for row, key in parts)])
    return table(head, lines)


def built(rows):
    """Build times, and a visit of all visible voxels."""
    head = ["set", "adj, 1 thread", "adj, 2", "VolPack, 1", "VTK, 2", "OpenVDB byte, 1", "adj walk in visibility order",
            "OpenVDB visit in its own order"]
    lines = []
    for name in rows.sets:
        ours = [rows.hold(name, "adj", "xyz, normals", threads=threads) for threads in (1, 2)]
        holds = [*ours, rows.hold(name, "volpack"), rows.hold(name, "vtk"), rows.hold(name, "openvdb", "byte")]
        walk = rows.draw(name, "adj", 512, "parallel", 1)
        lines.append([name, *(cell(row, "build_ms", "{:.0f}") for row in holds), cell(walk, "walk_ms", "{:.2f}"),
                      cell(holds[-1], "visit_ms", "{:.2f}")])
    return table(head, lines)


def load(rows):
    """How busy the machine was."""
    loads = [row["load"] for row in rows.rows if row["kind"] == "draw"]
    return f"The machine's load before a turn: {min(loads):.1f} to {max(loads):.1f}.\n" if loads else ""


def machine(document):
    """What it ran on."""
    about = document["machine"]
    vtk_version = next((row["version"] for row in document["rows"] if "version" in row), "none")
    return (f"{about['date']}, {about['adj']} at {about['commit']}, VTK {vtk_version}; {about['processor']}, "
            f"{about['processors']} virtual cores.\n")


TABLES = {
    "machine": (lambda document: machine(document) + load(Rows(document))),
    "volpack-512": lambda document: volpack(Rows(document), 512),
    "volpack-1024": lambda document: volpack(Rows(document), 1024),
    "vtk-1024": lambda document: vtk(Rows(document), 1024),
    "vtk-512": lambda document: vtk(Rows(document), 512),
    "perspective-512": lambda document: projections(Rows(document), 512),
    "held": lambda document: held(Rows(document)),
    "built": lambda document: built(Rows(document)),
}


def all_tables(document):
    """All of them."""
    return "\n".join(f"## {name}\n\n{text(document)}" for name, text in TABLES.items())


def renew(study, document):
    """Puts the tables between their markers in the study."""
    text = study.read_text()
    for name, made in TABLES.items():
        between = re.compile(rf"(<!-- table {name} -->\n).*?(<!-- end -->)", re.DOTALL)
        text = between.sub(lambda found: f"{found[1]}{made(document)}{found[2]}", text)
    study.write_text(text)
