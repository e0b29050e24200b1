#!/usr/bin/env python3
"""Reads .adj files, version 1, with numpy alone. Written from adj-1.md, not from the library.

As a module:
    arena = Arena(open("head.adj", "rb").read())
    voxels = arena.voxels("x")        # arrays x, y, z, value, normal, magnitude, coverage: codes
    arena.values(voxels.value)        # in the sample's unit
    arena.normals(voxels.normal)      # unit vectors along the grid's axes, n x 3; zeros for "no normal"
    arena.magnitudes(voxels.magnitude)
    arena.shares(voxels.coverage)     # how much of each voxel is visible, 0 to 1; coverage is None where all are whole
    arena.offsets(voxels.coverage)    # where: from the point, along x, y, z in spacings, n x 3
    arena.coherences(voxels.normal)   # how alike the normals of a level's voxel are, and the share without one, n x 2
    arena.levels                      # coarser levels of detail, level 1 first: arenas too
    arena.limits                      # where they may be drawn: pixels at standard and draft, a pair a level; or None

As a program:
    read_adj.py FILE...                 what each lane holds
    read_adj.py --list FILE...          a line a voxel, by z, y, x: x y z value normal magnitude, and the coverage if
                                        the file stores any
    read_adj.py --decoded FILE...       the same with what codes mean: x y z value nx ny nz magnitude, and the share and
                                        the offset along x, y, z if the file stores coverages, the
                                        coherence if it has one
    read_adj.py --csv OUT FILE          the voxels of the x lane as text; --npz OUT as numpy arrays
    --lane x|y|z                        that lane only
    --level N                           that level of detail instead of the file's own voxels

It checks what rules R1, R2, R4 to R7, R10, R11, R23 and R27 ask of header and section table, the same of each level and that
it fits the level below (R24), that tiles lie in their order (R13) and line ends in the channels (R16), and the description
(R22). It reads no checksum and judges nothing else: a damaged file gives a message or wrong voxels. Exit code 2 if a file
is refused.
"""

import argparse
import json
import re
import struct
import sys
from collections import namedtuple

import numpy as np

Voxels = namedtuple("Voxels", "x y z value normal magnitude coverage")
Section = namedtuple("Section", "kind axis element_bytes offset bytes xxh3")

MAGIC = b"\x89ADJ\r\n\x1a\n"
DESCRIPTION, TILES, LINE_ENDS, STEPS, VALUES, NORMALS, MAGNITUDES = range(1, 8)
COVERAGES, LIMITS = 0x8010, 0x8011
LEVELS = range(0x8001, 0x8010)
NAMES = {
    DESCRIPTION: "description", TILES: "tiles", LINE_ENDS: "line ends", STEPS: "steps", VALUES: "values",
    NORMALS: "normals", MAGNITUDES: "magnitudes", COVERAGES: "coverages", LIMITS: "limits of levels",
}
ORDERS = ["morton", "hilbert", "rows"]
TILE = np.dtype([
    ("tile_u", "<u2"), ("tile_v", "<u2"), ("first_line", "<u4"), ("first_record", "<u8"),
    ("occupancy", "<u8"), ("low", "<u2"), ("high", "<u2"),
])


class Refused(Exception):
    """The file breaks a rule of the format."""


def require(holds, rule, what):
    if not holds:
        raise Refused(f"{rule}: {what}")


class Arena:
    """An opened file: `dims`, `spacing`, `origin`, `direction`, `description`, `lanes`, `levels` and what methods give."""

    def __init__(self, content):
        self.content = content
        require(content[:8] == MAGIC, "R1", "not an .adj file")
        require(len(content) >= 256, "R4", "the file was cut: its header takes 256 bytes")
        self.major, self.minor, count, file_bytes, self.fingerprint = struct.unpack_from("<HHIQQ", content, 8)
        require(self.major == 1, "R2", f"version {self.major}, this reader knows 1")
        require(file_bytes == len(content), "R4", f"{len(content)} bytes, the header says {file_bytes}")
        self.dims = struct.unpack_from("<3H", content, 32)
        bits = struct.unpack_from("<4B", content, 38)
        self.value_bits, self.normal_bits, self.magnitude_bits, order = bits
        (self.visible_voxels,) = struct.unpack_from("<Q", content, 48)
        self.spacing = np.frombuffer(content, "<f8", 3, 56)
        self.origin = np.frombuffer(content, "<f8", 3, 80)
        self.direction = np.frombuffer(content, "<f8", 9, 104).reshape(3, 3)
        self.value_low, self.value_step, self.magnitude_scale = struct.unpack_from("<3d", content, 176)
        require(self.value_bits in (8, 16), "R7", f"values of {self.value_bits} bits")
        require(self.normal_bits in (0, 8, 16), "R7", f"normals of {self.normal_bits} bits")
        require(self.magnitude_bits in (0, 8), "R7", f"magnitudes of {self.magnitude_bits} bits")
        require(order < 3, "R7", f"tile order {order}")
        self.tile_order = ORDERS[order]
        self._check_grid()
        self._read_table(count)
        self._open_levels()

    def _check_grid(self):
        require(min(self.dims) > 0, "R6", f"dimensions {self.dims}")
        require(np.isfinite(self.spacing).all() and (self.spacing > 0).all(), "R6", f"spacing {self.spacing}")
        require(np.isfinite(self.origin).all(), "R6", f"origin {self.origin}")
        x, y, z = self.direction.T
        with np.errstate(over="ignore", invalid="ignore"):
            require((np.abs(x * x + y * y + z * z - 1) <= 0.002).all(), "R6", "directions that are not unit vectors")
        require(abs(np.linalg.det(self.direction)) > 1e-6, "R6", "directions in one plane")

    def _read_table(self, count):
        require(count <= 1024 and 256 + 32 * count <= len(self.content), "R5", f"a table of {count} sections")
        self.sections, self._parts, end = [], {}, 256 + 32 * count
        entries = [struct.unpack_from("<HBB", self.content, 256 + 32 * index) for index in range(count)]
        widths = [element for kind, _, element in entries if kind == COVERAGES]
        self.coverage_bits = 0 if not widths else 16 if widths[0] == 2 else 8
        self.has_coherence = self.minor >= 2 and self.coverage_bits > 0 and self.normal_bits > 0
        for index in range(count):
            kind, axis, element, _, offset, length, xxh3 = struct.unpack_from("<HBBIQQQ", self.content, 256 + 32 * index)
            require(0 < kind < 8 or kind >= 0x8000, "R10", f"section kind {kind} is unknown")
            require(offset == -(-end // 256) * 256, "R5", f"section {index} starts at byte {offset}")
            end = offset + length
            require(end <= len(self.content), "R5", f"section {index} ends at byte {end}")
            self.sections.append(Section(kind, axis, element, offset, length, xxh3))
            if kind in LEVELS:
                require(axis == 255, "R10", f"a level on axis {axis}")
                require(element == 1, "R11", f"a level in elements of {element} bytes")
                lanes_before = any(section.axis < 3 for section in self.sections[:-1])
                require(not lanes_before, "R23", "a level after a lane")
                continue
            if kind >= 0x8000 and kind not in (COVERAGES, LIMITS):
                continue
            wanted = self._element_bytes(kind, axis)
            require(element == wanted, "R11", f"{NAMES[kind]} in elements of {element} bytes")
            require(length % wanted == 0, "R11", f"{length} bytes of {NAMES[kind]}")
            require((kind, axis) not in self._parts, "R10", f"{NAMES[kind]} twice")
            self._parts[kind, axis] = self.content[offset:offset + length]
        require(-(-end // 256) * 256 == len(self.content), "R5", "the file does not end after its last section")
        text = self._parts.get((DESCRIPTION, 255))
        self.description = None if text is None else description_of(text)
        self.lanes = "".join(name for axis, name in enumerate("xyz") if (TILES, axis) in self._parts)
        require(self.lanes in ("x", "xy", "xyz"), "R10", f"lanes '{self.lanes}'")
        numbers = [section.kind for section in self.sections if section.kind in LEVELS]
        require(numbers == list(reversed(LEVELS[:len(numbers)])), "R23", "levels that are not N to 1")
        self.limits = None
        if (LIMITS, 255) in self._parts:
            limits = np.frombuffer(self._parts[LIMITS, 255], "<f4").reshape(-1, 2)
            require(len(limits) == len(numbers), "R27", f"limits of {len(limits)} levels")
            require(np.isfinite(limits).all() and (limits >= 0).all(), "R27", "limits that are no sizes")
            self.limits = limits.tolist()
        for axis in range(len(self.lanes)):
            for kind in (LINE_ENDS, STEPS, VALUES, NORMALS, MAGNITUDES, COVERAGES):
                width = self._element_bytes(kind, axis, or_zero=True)
                require(width == 0 or (kind, axis) in self._parts, "R10", f"no {NAMES[kind]} in lane {'xyz'[axis]}")
                if width and kind > STEPS:
                    records = len(self._parts[kind, axis]) // width
                    require(records == len(self._parts[STEPS, axis]), "R11", f"{records} {NAMES[kind]}")

    def _open_levels(self):
        self.levels, below = [], self
        for section in reversed([section for section in self.sections if section.kind in LEVELS]):
            level = Arena(self.content[section.offset:section.offset + section.bytes])
            coarser = below.coarser_grid()
            require(coarser is not None, "R24", "a level of a grid that has no coarser one")
            require(level.dims == coarser[0], "R24", f"dimensions {level.dims} of a level")
            same = all((a == b).all() for a, b in zip((level.spacing, level.origin), coarser[1:]))
            same = same and (level.direction == below.direction).all()
            require(same, "R24", "a level whose points lie elsewhere")
            for name in ("value_bits", "normal_bits", "magnitude_bits", "tile_order", "value_low", "value_step",
                         "magnitude_scale", "lanes"):
                require(getattr(level, name) == getattr(below, name), "R24", f"another {name} in a level")
            require(level.coverage_bits == (16 if below.coverage_bits else 8), "R24", "other coverages than a level's")
            is_plain = level._parts.get((DESCRIPTION, 255)) == b"{}" and not level.levels
            require(is_plain, "R24", "a level with a description or with levels")
            self.levels.append(level)
            below = level

    def coarser_grid(self):
        """Points, spacing and origin of the level above; None if there is none."""
        long = [axis for axis in range(3) if self.dims[axis] > 1]
        if not long:
            return None
        smallest = min(self.spacing[axis] for axis in long)
        dims, spacing, origin = list(self.dims), self.spacing.copy(), self.origin.copy()
        for axis in long:
            if self.spacing[axis] < np.sqrt(2.0) * smallest:
                dims[axis] = -(-dims[axis] // 2)
                spacing[axis] *= 2
                origin += 0.5 * self.spacing[axis] * self.direction[axis]
        return tuple(dims), spacing, origin

    def _element_bytes(self, kind, axis, or_zero=False):
        require((axis == 255) if kind in (DESCRIPTION, LIMITS) else axis < 3, "R10", f"{NAMES[kind]} on axis {axis}")
        if kind == LIMITS:
            return 8
        if kind in (DESCRIPTION, STEPS):
            return 1
        if kind == TILES:
            return 28
        if kind == LINE_ENDS:
            return 2 if self.dims[axis] <= 1023 else 4
        width = {
            VALUES: self.value_bits // 8, NORMALS: self.normal_bits // 4, MAGNITUDES: self.magnitude_bits // 8,
            COVERAGES: self.coverage_bits // 8,
        }[kind]
        require(or_zero or width > 0, "R10", f"{NAMES[kind]}, which the header says there are none of")
        return width

    def tiles(self, lane="x"):
        """The lane's tile records as a structured array."""
        return np.frombuffer(self._parts[TILES, "xyz".index(lane)], TILE)

    def records(self, lane="x"):
        """How many records the lane has, and how many of them are stepping voxels."""
        steps = np.frombuffer(self._parts[STEPS, "xyz".index(lane)], "u1")
        return len(steps), int(np.count_nonzero(steps == 0))

    def voxels(self, lane="x"):
        """The voxels of a lane in the order in which they are stored."""
        axis = "xyz".index(lane)
        u_axis, v_axis = [other for other in range(3) if other != axis]
        tiles = self.tiles(lane)
        steps = np.frombuffer(self._parts[STEPS, axis], "u1")
        ends = np.frombuffer(self._parts[LINE_ENDS, axis], f"<u{self._element_bytes(LINE_ENDS, axis)}").astype(np.int64)

        keys = tile_keys(self.tile_order, tiles["tile_u"].astype(np.int64), tiles["tile_v"].astype(np.int64))
        require((np.diff(keys) > 0).all(), "R13", f"tiles of lane {lane} that do not lie in {self.tile_order} order")

        # Lines, tile after tile, bit after bit: bit (v % 8) * 8 + u % 8 of the mask.
        bits = np.unpackbits(tiles["occupancy"].copy().view("u1").reshape(-1, 8), axis=1, bitorder="little")
        tile_of_line, bit = np.nonzero(bits)
        require(len(ends) == len(tile_of_line), "R16", f"{len(ends)} line ends for {len(tile_of_line)} lines")
        line_u = tiles["tile_u"][tile_of_line].astype(np.int64) * 8 + bit % 8
        line_v = tiles["tile_v"][tile_of_line].astype(np.int64) * 8 + bit // 8
        line_end = tiles["first_record"][tile_of_line].astype(np.int64) + ends
        line_start = np.concatenate([[0], line_end[:-1]]).astype(np.int64)
        counts = line_end - line_start
        require((counts > 0).all() and counts.sum() == len(steps), "R16", "line ends that do not rise to the last record")

        # A line's coordinates are running sums of its steps, the first counted from -1; 0 advances 255.
        advance = np.where(steps == 0, 255, steps).astype(np.int64)
        total = np.concatenate([[0], np.cumsum(advance)])
        line_of_record = np.repeat(np.arange(len(counts)), counts)
        along = total[1:] - total[line_start][line_of_record] - 1
        kept = steps != 0
        place = [None, None, None]
        place[axis] = along[kept]
        place[u_axis] = line_u[line_of_record][kept]
        place[v_axis] = line_v[line_of_record][kept]
        codes = [self._codes(kind, axis, len(steps))[kept] for kind in (VALUES, NORMALS, MAGNITUDES)]
        coverage = self._codes(COVERAGES, axis, len(steps))[kept] if self.coverage_bits else None
        return Voxels(*place, *codes, coverage)

    def _codes(self, kind, axis, records):
        width = self._element_bytes(kind, axis, or_zero=True)
        if width == 0:
            return np.zeros(records, np.int64)
        return np.frombuffer(self._parts[kind, axis], f"<u{width}").astype(np.int64)

    def values(self, codes):
        """Value codes as values in the sample's unit."""
        return self.value_low + codes * self.value_step

    def magnitudes(self, codes):
        """Magnitude codes as gradient magnitudes, per world length."""
        return np.where(codes == 0, 0.0, self.magnitude_scale * 2.0 ** ((codes - 255) / 16))

    def shares(self, codes):
        """Coverage codes as the shares of voxels that are visible."""
        if self.coverage_bits == 8:
            return points_of(codes).sum(axis=(-3, -2, -1)) / 8
        return ((codes & 127) / 127) ** 2

    def offsets(self, codes):
        """Coverage codes as the mean places of what is visible, along x, y, z from the point, in spacings."""
        if self.coverage_bits == 8:
            points = points_of(codes)  # by z, y, x
            count = np.maximum(points.sum(axis=(-3, -2, -1)), 1)
            ends = [points.take(1, axis) - points.take(0, axis) for axis in (-1, -2, -3)]
            return np.stack([end.sum(axis=(-2, -1)) / (4 * count) for end in ends], axis=-1)
        return np.stack([(np.minimum(codes >> low & 7, 6) - 3) / 8 for low in (7, 10, 13)], axis=-1)

    def coherences(self, codes):
        """Normal codes as how alike the normals are that a voxel stands for, and the share of it that has none, n x 2."""
        v = codes >> self.normal_bits
        alike = np.array([1, 0.85, 0.6, 0.25])[codes & 1 | (v & 1) << 1]
        return np.stack([alike, np.where(v & 2, 0.2, 0)], axis=-1)

    def normals(self, codes):
        """Normal codes as unit vectors along the grid's axes (times `direction`: world); zeros where there is none."""
        bits = self.normal_bits
        scale = (1 << (bits - 1)) - 1
        halves = np.stack([codes & ((1 << bits) - 1), codes >> bits])
        u, v = np.maximum(np.where(halves > scale, halves - (1 << bits), halves), -scale).astype(float)
        z = scale - np.abs(u) - np.abs(v)
        fold = np.maximum(-z, 0)
        normal = np.stack([u - np.copysign(fold, u), v - np.copysign(fold, v), z], axis=-1)
        none = codes == (1 << (bits - 1)) * (1 + (1 << bits))
        normal = normal / np.linalg.norm(normal, axis=-1, keepdims=True)
        return np.where(none[..., None], 0.0, normal)


def points_of(masks):
    """The bits of masks of 8 points, by z, y, x along the last three axes."""
    return (masks[..., None] >> np.arange(8) & 1).reshape(*masks.shape, 2, 2, 2)


def description_of(section):
    """The JSON object in the bytes of a description."""
    try:
        text = section.decode("utf-8")
        outside_strings = re.sub(r'"(\\.|[^"\\])*"', "", text, flags=re.DOTALL)
        levels = np.cumsum([(c in "[{") - (c in "]}") for c in outside_strings])
        require(levels.max(initial=0) <= 127, "R22", "a description more than 127 levels deep")
        # The last of members with one name counts. Python reads numbers beyond a double as infinite.
        found = json.loads(text, parse_constant=not_json, parse_float=finite, parse_int=finite)
        json.dumps(found, ensure_ascii=False).encode("utf-8")  # fails for half of a surrogate pair
    except ValueError as problem:
        raise Refused(f"R22: a description that is not JSON: {problem}") from None
    require(isinstance(found, dict), "R22", "a description that is not a JSON object")
    return found


def not_json(word):
    raise ValueError(f"{word} is no number of JSON")


def finite(digits):
    number = float(digits)
    if np.isinf(number):
        raise ValueError("a number beyond the range of a double")
    return int(digits) if digits.lstrip("-").isdigit() and len(digits) < 20 else number


def tile_keys(order, u, v):
    """Where tiles stand in the tile order."""
    if order == "rows":
        return 65536 * v + u
    key = np.zeros_like(u)
    if order == "morton":
        for bit in range(13):
            key |= (u >> bit & 1) << 2 * bit | (v >> bit & 1) << 2 * bit + 1
        return key
    for bit in reversed(range(13)):
        half = 1 << bit
        right, upper = u >= half, v >= half
        key = 4 * key + np.where(right, np.where(upper, 2, 3), np.where(upper, 1, 0))
        u, v = u % half, v % half
        turned = right & ~upper
        u, v = np.where(turned, half - 1 - u, u), np.where(turned, half - 1 - v, v)
        u, v = np.where(upper, u, v), np.where(upper, v, u)
    return key


def stored(voxels):
    """The arrays by name, without those that the file does not store."""
    return {name: codes for name, codes in voxels._asdict().items() if codes is not None}


def sorted_rows(voxels):
    """Voxels as rows by z, then y, then x."""
    order = np.lexsort((voxels.x, voxels.y, voxels.z))
    return np.stack(list(stored(voxels).values()), axis=-1)[order]


def decoded_rows(arena, rows):
    """Rows of x, y, z, value, the normal's three components, magnitude; of share and offset if there are coverages; and of the
    two numbers of the coherence."""
    place, (value, normal, magnitude, *coverage) = rows[:, :3], rows[:, 3:].T
    coherence = [arena.coherences(normal)] if arena.has_coherence else []
    normals = arena.normals(normal) if arena.normal_bits else np.zeros((len(rows), 3))
    covered = [part(codes) for codes in coverage for part in (arena.shares, arena.offsets)]
    return np.column_stack([place, arena.values(value), normals, arena.magnitudes(magnitude), *covered, *coherence])


def main():
    parser = argparse.ArgumentParser(description="Read .adj files.")
    parser.add_argument("files", nargs="+", metavar="FILE")
    parser.add_argument("--lane", choices=list("xyz"))
    parser.add_argument("--level", type=int, default=0)
    parser.add_argument("--list", action="store_true", help="a line a voxel")
    parser.add_argument("--decoded", action="store_true", help="a line a voxel, with what codes mean")
    parser.add_argument("--csv", metavar="OUT")
    parser.add_argument("--npz", metavar="OUT")
    arguments = parser.parse_args()
    status = 0
    for name in arguments.files:
        try:
            with open(name, "rb") as file:
                arena = Arena(file.read())
            if arguments.level:
                require(0 < arguments.level <= len(arena.levels), "R23", f"no level {arguments.level}")
                arena = arena.levels[arguments.level - 1]
            for lane in arguments.lane or arena.lanes:
                require(lane in arena.lanes, "R10", f"no lane {lane}")
                show(arena, name, lane, arguments)
        except (OSError, ValueError, Refused) as problem:
            print(f"read_adj: {name}: {problem}", file=sys.stderr)
            status = 2
    return status


def show(arena, name, lane, arguments):
    voxels = arena.voxels(lane)
    if arguments.list:
        print(f"# {name} lane {lane}")
        for row in sorted_rows(voxels).tolist():
            print(*row)
    elif arguments.decoded:
        print(f"# {name} lane {lane}")
        for row in decoded_rows(arena, sorted_rows(voxels)).tolist():
            print(*row)
    elif arguments.csv:
        np.savetxt(arguments.csv, sorted_rows(voxels), "%d", ",", header=",".join(stored(voxels)), comments="")
    elif arguments.npz:
        np.savez_compressed(arguments.npz, **stored(voxels))
    else:
        records, stepping = arena.records(lane)
        dims = "x".join(map(str, arena.dims))
        print(f"{name} lane {lane}: {dims}, {len(voxels.x)} voxels, {len(arena.tiles(lane))} tiles, "
              f"{records} records, {stepping} stepping voxels, {arena.tile_order} order")


if __name__ == "__main__":
    sys.exit(main())
