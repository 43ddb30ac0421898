"""Write the meshes of the example scenes: `python scenes/make_meshes.py [DIRECTORY]`, by default into scenes/meshes.

The Cornell box is measured data (Cornell University Program of Computer Graphics), in metres. Everything else is a
body of revolution made up for the showcase. Faces are counterclockwise seen from the front.
"""

from __future__ import annotations

import math
import sys
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass
from itertools import pairwise
from pathlib import Path

Vec2 = tuple[float, float]
Vec3 = tuple[float, float, float]

# Corners for the texture coordinates (0,0), (1,0), (1,1), (0,1).
WALLS: dict[str, tuple[Vec3, Vec3, Vec3, Vec3]] = {
    "left": ((-1, 0, -1), (-1, 2, -1), (-1, 2, 1), (-1, 0, 1)),
    "right": ((1, 0, 1), (1, 2, 1), (1, 2, -1), (1, 0, -1)),
    "floor": ((-1, 0, 1), (-1, 0, -1), (1, 0, -1), (1, 0, 1)),
    "back": ((-1, 0, -1), (-1, 2, -1), (1, 2, -1), (1, 0, -1)),
    "ceiling": ((1, 2, -1), (-1, 2, -1), (-1, 2, 1), (1, 2, 1)),
}
CLOCKWISE = ("floor", "back", "ceiling")  # so run their corners, seen from the room
UNIT_SQUARE: tuple[Vec2, ...] = ((0, 0), (1, 0), (1, 1), (0, 1))

BOX_BOTTOM = 1e-4  # a hair above the floor, so that no two surfaces coincide
# Height, and the base's corners (x, z), before the translation that the scene file gives.
BOXES: dict[str, tuple[float, tuple[Vec2, Vec2, Vec2, Vec2]]] = {
    "short_box": (0.6, ((-0.04607, -0.573007), (0.124253, -0.003104), (0.703337, -0.176177), (0.533009, -0.746079))),
    "tall_box": (1.2, ((0.0495656, 0.108948), (-0.523986, -0.0906493), (-0.720444, 0.473882), (-0.146892, 0.673479))),
}

# Outlines (radius, height) of the showcase's bodies, from the axis at the bottom to the axis at the top.
OUTLINES: dict[str, list[Vec2]] = {
    "vase": [
        (0, 0.001), (0.13, 0.001), (0.155, 0.008), (0.165, 0.04), (0.24, 0.22), (0.33, 0.45), (0.335, 0.66),
        (0.25, 0.86), (0.13, 1.0), (0.105, 1.08), (0.125, 1.16), (0.16, 1.2), (0.173, 1.213), (0.177, 1.219),
        (0.1755, 1.2235), (0.17, 1.2225), (0.155, 1.205), (0.11, 1.15), (0.085, 1.08), (0.11, 0.98), (0.2, 0.86),
        (0.26, 0.6), (0, 0.3),
    ],
    "goblet": [
        (0, 0.0005), (0.16, 0.0005), (0.205, 0.001), (0.218, 0.004), (0.221, 0.008), (0.218, 0.012), (0.205, 0.016),
        (0.16, 0.023), (0.09, 0.037), (0.04, 0.075), (0.026, 0.16), (0.026, 0.32), (0.04, 0.385), (0.12, 0.43),
        (0.21, 0.52), (0.245, 0.64), (0.235, 0.78), (0.208, 0.92), (0.203, 0.947), (0.201, 0.956), (0.1978, 0.9595),
        (0.1946, 0.956), (0.193, 0.947), (0.197, 0.92), (0.222, 0.78), (0.231, 0.64), (0.198, 0.53), (0.11, 0.447),
        (0, 0.425),
    ],
    "pear": [
        (0, 0.03), (0.05, 0.012), (0.12, 0.004), (0.2, 0.04), (0.262, 0.13), (0.27, 0.24), (0.225, 0.36),
        (0.16, 0.47), (0.125, 0.56), (0.095, 0.625), (0.045, 0.65), (0, 0.635),
    ],
    "stem": [(0, 0.6), (0.016, 0.61), (0.014, 0.7), (0.019, 0.79), (0.017, 0.8), (0, 0.802)],
}  # fmt: skip


@dataclass(frozen=True)
class Polygons:
    """Triangles that index vertices; texture coordinates and normals, where there are any, belong to vertices."""

    vertices: Sequence[Vec3]
    triangles: Sequence[tuple[int, int, int]]
    uvs: Sequence[Vec2] = ()
    normals: Sequence[Vec3] = ()


def quad(a: int, b: int, c: int, d: int) -> list[tuple[int, int, int]]:
    """Two triangles that start at opposite corners.

    So the (0,0), (1,0), (1,1) of meshes without texture coordinates continue a checkerboard across the diagonal.
    """
    return [(a, b, c), (c, d, a)]


def wall(name: str) -> Polygons:
    """A wall that faces the room."""
    return Polygons(WALLS[name], quad(3, 2, 1, 0) if name in CLOCKWISE else quad(0, 1, 2, 3), UNIT_SQUARE)


def box(height: float, base: Sequence[Vec2]) -> Polygons:
    """A closed prism that faces outward."""
    vertices = [(x, y, z) for y in (BOX_BOTTOM, height) for x, z in base]
    sides = [quad(i, (i + 1) % 4, (i + 1) % 4 + 4, i + 4) for i in range(4)]
    return Polygons(vertices, [t for face in [quad(3, 2, 1, 0), quad(4, 5, 6, 7), *sides] for t in face])


def disc(center: Vec3, radius: float, corners: int) -> Polygons:
    """A flat fan that faces +z."""
    x, y, z = center
    angles = [2 * math.pi * i / corners for i in range(corners)]
    # Twelve decimals, because the last bit of a cosine differs between maths libraries.
    vertices = [(round(x + radius * math.cos(a), 12), round(y + radius * math.sin(a), 12), z) for a in angles]
    return Polygons(vertices, [(0, i, i + 1) for i in range(1, corners - 1)])


def mirrored(points: Sequence[Vec2]) -> list[Vec2]:
    """`points` with one more at either end, reflected in the axis, so that the outline crosses the axis level."""
    return [(-points[1][0], points[1][1]), *points, (-points[-2][0], points[-2][1])]


def spline(points: Sequence[Vec2], steps: int) -> list[Vec2]:
    """The uniform Catmull-Rom spline through `points`, in `steps` pieces from each to the next."""
    outline = []
    padded = mirrored(points)
    for knots in zip(padded, padded[1:], padded[2:], padded[3:], strict=False):
        for t in (i / steps for i in range(steps)):
            weights = (-t + 2 * t**2 - t**3, 2 - 5 * t**2 + 3 * t**3, t + 4 * t**2 - 3 * t**3, t**3 - t**2)
            r, y = (sum(w * p[axis] for w, p in zip(weights, knots, strict=True)) / 2 for axis in (0, 1))
            outline.append((r, y))
    return [*outline, points[-1]]


def lathe(outline: Sequence[Vec2], segments: int) -> Polygons:
    """The smooth body of revolution around +y; u runs around it, v from its top down to its bottom."""
    low, high = min(y for _, y in outline), max(y for _, y in outline)
    padded = mirrored(outline)
    vertices, uvs, normals = [], [], []
    for (r0, y0), (r, y), (r1, y1) in zip(padded, padded[1:], padded[2:], strict=False):
        length = math.hypot(r1 - r0, y1 - y0)
        for i in range(segments + 1):
            angle = 2 * math.pi * (i % segments) / segments
            c, s = math.cos(angle), -math.sin(angle)
            vertices.append((r * c, y, r * s))
            normals.append(((y1 - y0) / length * c, (r0 - r1) / length, (y1 - y0) / length * s))
            uvs.append((i / segments, (high - y) / (high - low)))
    triangles = []
    for ring, ((r0, _), (r1, _)) in enumerate(pairwise(outline)):
        for a in range(ring * (segments + 1), ring * (segments + 1) + segments):
            lower, upper = quad(a, a + 1, a + segments + 2, a + segments + 1)
            triangles += [lower] * (r0 > 0) + [upper] * (r1 > 0)
    return Polygons(vertices, triangles, uvs, normals)


def obj(mesh: Polygons, decimals: int = 17) -> str:
    """The text of a Wavefront OBJ file. Python prints the shortest decimal that reads back as the same number."""

    def lines(key: str, rows: Iterable[Sequence[float]]) -> Iterator[str]:
        return (" ".join([key, *(repr(round(float(x), decimals) + 0.0) for x in row)]) for row in rows)

    corner = "{0}" + ("/{0}" if mesh.uvs else "") + ("/{0}" if mesh.normals else "")
    faces = (" ".join(["f", *(corner.format(i + 1) for i in face)]) for face in mesh.triangles)
    parts = [lines("v", mesh.vertices), lines("vt", mesh.uvs), lines("vn", mesh.normals), faces]
    return "".join(f"{line}\n" for part in parts for line in part)


def main(directory: Path) -> None:
    directory.mkdir(parents=True, exist_ok=True)
    files = {name: obj(wall(name)) for name in WALLS}
    files |= {name: obj(box(height, base)) for name, (height, base) in BOXES.items()}
    files["disc"] = obj(disc((0, 1, 1), 0.5, 32))
    files |= {name: obj(lathe(spline(points, 3), 48), decimals=5) for name, points in OUTLINES.items()}
    for name, text in files.items():
        (directory / f"{name}.obj").write_text(text, encoding="ascii", newline="\n")


if __name__ == "__main__":
    main(Path(sys.argv[1]) if len(sys.argv) > 1 else Path(__file__).parent / "meshes")
