"""Cameras that every program gets: a turn around the vertical, as `adj render --frames` makes it.

In: a set's bounds and spacing. Out: for each frame the picture's right, up and forward, the eye, what it looks at and
the height of a parallel picture, all in world units with the first voxel at the origin.
"""

import math

FRAMES = 9
AZIMUTH, ELEVATION = 10.0, 20.0
FOV = 30.0
MARGIN = 1.04


def turn(described):
    """The cameras of a turn; the first frame warms up and is not counted."""
    spacing, bounds = described["spacing"], described["bounds"]
    centre = [(low + high) / 2 * step for (low, high), step in zip(bounds, spacing)]
    radius = MARGIN * math.hypot(*((high - low + 1) / 2 * step for (low, high), step in zip(bounds, spacing)))
    views = []
    for frame in range(FRAMES):
        a, e = math.radians(AZIMUTH + 360 * frame / FRAMES), math.radians(ELEVATION)
        outward = [-math.sin(a) * math.cos(e), math.cos(a) * math.cos(e), math.sin(e)]
        up = [math.sin(a) * math.sin(e), -math.cos(a) * math.sin(e), math.cos(e)]
        forward = [-c for c in outward]
        right = cross(forward, up)
        distance = radius / math.sin(math.radians(FOV) / 2)
        eye = [c + o * distance for c, o in zip(centre, outward)]
        views.append({"right": right, "up": up, "forward": forward, "centre": centre, "eye": eye, "height": 2 * radius})
    return views


def cross(a, b):
    """The cross product."""
    return [a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]]


def as_text(views):
    """A line a view: right, up, forward, centre, height."""
    rows = [[*v["right"], *v["up"], *v["forward"], *v["centre"], v["height"]] for v in views]
    return "".join(" ".join(f"{c:.9f}" for c in row) + "\n" for row in rows)
