"""Rays and meshes that break tracers, and what may be said of a tracer that was given them.

Vertices and rays are multiples of a power of two wherever peers would otherwise see others than pyrt does, for they
take float32. Every measure is a count of failures unless its row says otherwise.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from itertools import product
from time import perf_counter
from typing import Any

import numpy as np
from numpy.typing import NDArray

from pyrt.procedural import icosphere
from tests import meshes
from tests.reference.rays import closest_hit, farthest_hit

Array = NDArray[np.float64]
Mesh = tuple[Array, NDArray[Any]]
Trace = Callable[[Array, Array], tuple[Array, NDArray[np.int32]]]  # rays -> t, inf for a miss, and triangle, −1
MakeTrace = Callable[[Array, NDArray[np.int32]], Trace]

ULPS4 = 4 * 2.0**-23  # relative
LATTICE = 2.0**-23  # coordinates in [−1, 1] that every tracer represents exactly


@dataclass(frozen=True)
class Case:
    """One row: `measure` takes a tracer and how many rays to spend."""

    name: str
    measures: str
    threshold: float
    measure: Callable[[MakeTrace, int], float]


def _float32(values: Any) -> Array:
    """Rounded to float32, as float64."""
    return np.asarray(np.asarray(values, np.float32), np.float64)


def _ball() -> Mesh:
    vertices, triangles = icosphere(4)
    return _float32(vertices), triangles


def _inside(random: np.random.Generator, count: int) -> Array:
    return _float32(meshes.points_inside(random, count, 0.9))


def _misses(make: MakeTrace, mesh: Mesh, origins: Array, targets: Array) -> float:
    return float((make(*mesh)(origins, targets - origins)[1] < 0).sum())


def _vertices(make: MakeTrace, count: int) -> float:
    random, mesh = np.random.default_rng(1), _ball()
    return _misses(make, mesh, _inside(random, count), mesh[0][random.integers(len(mesh[0]), size=count)])


def _midpoints(make: MakeTrace, count: int) -> float:
    random, mesh = np.random.default_rng(2), _ball()
    return _misses(make, mesh, _inside(random, count), meshes.points_on_edges(random, mesh, np.full(count, 0.5)))


def _edges(make: MakeTrace, count: int) -> float:
    random, mesh = np.random.default_rng(3), _ball()
    return _misses(make, mesh, _inside(random, count), meshes.points_on_edges(random, mesh, random.random(count)))


def _moved(make: MakeTrace, count: int) -> float:
    """Misses of vertex rays in a ball of radius 1 at six places up to 1e12."""
    places = [(148376.0, 1234.0, -223423.0), *((d, -d, d) for d in (1e4, 1e6, 1e8, 1e10, 1e12))]
    return _placed(make, count, [(np.array(place), 1.0) for place in places])


def _scaled(make: MakeTrace, count: int) -> float:
    return _placed(make, count, [(np.zeros(3), 10.0**j) for j in range(-6, 7)])


def _placed(make: MakeTrace, count: int, placements: list[tuple[Array, float]]) -> float:
    random, (vertices, triangles) = np.random.default_rng(4), _ball()
    share, total = count // len(placements), 0.0
    for place, scale in placements:
        moved = vertices * scale + place
        targets = moved[random.integers(len(moved), size=share)]
        total += _misses(make, (moved, triangles), _inside(random, share) * scale + place, targets)
    return total


def _powers_of_two(make: MakeTrace, count: int) -> float:
    """Hits that are not the same bits when mesh and origins are multiplied by 2^k."""
    random, (vertices, triangles) = np.random.default_rng(5), _ball()
    count //= 6
    origins, directions = _inside(random, count), _float32(random.normal(size=(count, 3)))
    t, triangle = make(vertices, triangles)(origins, directions)
    total = 0
    for k in (-60, -40, -20, 20, 40, 60):
        scaled_t, scaled = make(vertices * 2.0**k, triangles)(origins * 2.0**k, directions)
        total += int(((np.asarray(scaled_t, float) * 2.0**-k != t) | (scaled != triangle)).sum())
    return float(total)


def _grid(make: MakeTrace, count: int) -> float:
    """Misses of axis-parallel rays on the inner lines and nodes of a 64×64 grid, six directions, ±0 elsewhere."""
    random, lines = np.random.default_rng(6), np.arange(-32, 33) / 32
    total, count = 0, count // 24
    vertices, triangles = meshes.grid(lines, lines)
    for axis, sign, zeros in product(range(3), (-1.0, 1.0), product((0.0, -0.0), repeat=2)):
        targets = np.zeros((count, 3))
        targets[:, :2] = random.integers(-31, 32, (count, 2)) / 32
        targets[: count // 2, 0] = random.integers(-(1 << 20), 1 << 20, count // 2) / (1 << 20)
        direction = np.roll([*zeros, sign], axis)
        origins = np.roll(targets, axis, axis=1) - direction
        trace = make(np.roll(vertices, axis, axis=1), triangles.astype(np.int32))
        total += int((trace(origins, np.tile(direction, (count, 1)))[1] < 0).sum())
    return float(total)


def _slabs(make: MakeTrace, count: int) -> float:
    """Rays that start in the planes of boxes' sides and may run along others: hits that are not as brute force."""
    random, count = np.random.default_rng(13), min(count, 60_000)
    vertices, triangles = meshes.boxes(random, 40)
    origins = random.integers(-8, 9, (count, 3)) / 8
    origins[:, 2] = np.where(random.random(count) < 0.5, origins[:, 2], _float32(random.uniform(-1, 1, count)))
    directions = _float32(random.normal(size=(count, 3))) * (random.random((count, 3)) < 0.7)
    directions[~directions.any(axis=1)] = (0.0, 0.0, 1.0)
    corners = vertices[triangles]
    generous, strict = (closest_hit(corners, origins, directions, hair) for hair in (1e-9, -1e-9))
    starts_outside = closest_hit(corners, origins - 1e-5 * directions, directions, 1e-9) > 2e-5
    clear = (generous == strict) & starts_outside
    origins, directions, expected = origins[clear], directions[clear], strict[clear]
    t = np.asarray(make(vertices, triangles.astype(np.int32))(origins, directions)[0], np.float64)
    with np.errstate(invalid="ignore"):
        off = np.abs(t - expected) * np.linalg.norm(directions, axis=1)
    return float((~((t == expected) | (off <= ULPS4))).sum())


def _contaminated(make: MakeTrace, count: int) -> float:
    """Rays for which triangles without area (half of a mesh) or of NaN, infinity and 3e38 (1 %) change the hit."""
    random, (vertices, triangles) = np.random.default_rng(14), _ball()
    count, bad = min(count, 200_000), np.repeat([np.nan, np.inf, -np.inf, 3e38], 12)[:, None] * np.ones(3)
    a, b = random.integers(len(vertices), size=(2, len(triangles)))
    flat = np.stack([a, np.where(random.random(len(a)) < 0.5, a, b), b], axis=1)
    infinite = np.stack([a[: len(bad)], b[: len(bad)], len(vertices) + np.arange(len(bad))], axis=1)
    origins, directions = _inside(random, count), _float32(random.normal(size=(count, 3)))
    clean = make(vertices, triangles)(origins, directions)[0]
    dirty_mesh = np.concatenate([vertices, bad]), np.concatenate([flat, triangles, infinite]).astype(np.int32)
    return float((~(make(*dirty_mesh)(origins, directions)[0] == clean)).sum())


def _duplicates(make: MakeTrace, count: int) -> float:
    """Rays for which, of triangles that are there up to eight times, another than the first is hit."""
    random = np.random.default_rng(15)
    order = random.permutation(np.repeat(np.arange(300), random.integers(1, 9, 300)))
    corners = _float32(meshes.random_triangles(random, 300))[order]
    targets = meshes.points_on_triangles(random, corners[random.integers(len(corners), size=min(count, 200_000))])
    origins = _float32(random.uniform(-1, 1, targets.shape))
    vertices, triangles = meshes.soup(corners)
    triangle = make(vertices, triangles.astype(np.int32))(origins, _float32(targets - origins))[1]
    found = triangle[triangle >= 0]
    first = np.unique(order, return_index=True)[1]
    return float((found != first[order[found]]).sum())


def _odd_components(make: MakeTrace, count: int) -> float:
    return _odd_directions(make, count, [1.0])


def _odd_lengths(make: MakeTrace, count: int) -> float:
    return _odd_directions(make, count, [1e-30, 1e-10, 1e10, 1e30])


def _odd_directions(make: MakeTrace, count: int, lengths: list[float]) -> float:
    """Hits that differ from float64 brute force, for zero, denormal and tiny components, and for these lengths."""
    random, (vertices, triangles) = np.random.default_rng(7), icosphere(2)
    vertices, count = _float32(vertices), min(count, 60_000)
    odd = np.array([0.0, -0.0, 1e-40, 1e-38, 1e-20, 1e-8])
    directions = random.normal(size=(count, 3))
    chosen = random.random((count, 3)) < 0.5
    chosen[:, 0] &= ~chosen.all(axis=1)
    directions = np.where(chosen, random.choice(odd, (count, 3)), directions)
    directions = _float32(directions * random.choice(lengths, (count, 1)))
    origins = _inside(random, count)
    t = np.asarray(make(vertices, triangles)(origins, directions)[0], np.float64)
    expected = closest_hit(vertices[triangles], origins, directions)
    with np.errstate(invalid="ignore"):
        return float((~(np.abs(t / expected - 1) <= ULPS4)).sum())


def _needles(make: MakeTrace, count: int) -> tuple[float, float]:
    """Needles of aspect 1e2 … 1e7: inner points that are missed, and the worst error of t where they are hit."""
    random, missed, worst = np.random.default_rng(8), 0, 0.0
    for exponent in np.arange(2, 7.5, 0.5):
        for _ in range(4):
            angle = random.uniform(0, 2 * np.pi)
            along, across = np.array([np.cos(angle), np.sin(angle)]), np.array([-np.sin(angle), np.cos(angle)])
            flat = np.stack([-0.9 * along, 0.9 * along, 1.8 * 10.0**-exponent * across])
            corners = np.round(np.column_stack([flat, flat @ (0.3, 0.2)]) / LATTICE) * LATTICE
            points, depth = _inner_points(corners, random, count // 44)
            down = np.tile((0.0, 0.0, -1.0), (len(points), 1))
            t, triangle = make(corners, np.array([[0, 1, 2]], np.int32))(points, down)
            missed += int((triangle < 0).sum())
            worst = max(worst, float(np.abs(t - depth)[triangle == 0].max(initial=0.0)))
    return float(missed), worst


def _inner_points(corners: Array, random: np.random.Generator, count: int) -> tuple[Array, Array]:
    """Lattice points at z = 1 that lie strictly inside the triangle, seen from above, and how far below them it is."""
    points = np.round((random.dirichlet((1, 1, 1), count) @ corners)[:, :2] / LATTICE) * LATTICE
    edges = np.roll(corners, -1, 0)[:, :2] - corners[:, :2]
    offsets = points[:, None] - corners[:, :2]
    areas = edges[:, 0] * offsets[..., 1] - edges[:, 1] * offsets[..., 0]  # exact: 25 bits times 25 bits
    inside = (areas > 0).all(axis=1)
    points, areas = points[inside], areas[inside]
    depth = 1.0 - (areas[:, [1, 2, 0]] @ corners[:, 2]) / areas.sum(axis=1)
    return np.column_stack([points, np.ones(len(points))]), depth


def _tiny(make: MakeTrace, count: int) -> float:
    """Inner points of triangles with edges 2^-7 … 2^-40 before a triangle of size 1 that are missed."""
    random, total = np.random.default_rng(9), 0.0
    back = np.array([(-1.0, -1.0, -1.0), (1.0, -1.0, -1.0), (0.0, 1.0, -1.0)])
    for k in range(7, 41):
        tiny = np.array([(-1.0, -1.0, 0.0), (1.0, -1.0, 0.0), (0.0, 1.0, 0.0)]) * 2.0**-k
        weights = random.dirichlet((1, 1, 1), count // 34) * 0.98 + 0.02 / 3
        points = _float32(weights @ tiny) + (0.0, 0.0, 0.5)
        trace = make(np.concatenate([tiny, back]), np.arange(6, dtype=np.int32).reshape(2, 3))
        total += float((trace(points, np.tile((0.0, 0.0, -1.0), (len(points), 1)))[1] != 0).sum())
    return total


def _soup(make: MakeTrace, count: int) -> float:
    """Rays that pass through the inside of a triangle of a nasty mixture, and are reported to go farther."""
    random, count = np.random.default_rng(10), min(count // 4, 40_000)
    corners = _float32(meshes.nasty_soup(random, 600))
    origins, directions = _inside(random, count), _float32(random.normal(size=(count, 3)))
    vertices, triangles = meshes.soup(corners)
    t = make(vertices, triangles.astype(np.int32))(origins, directions)[0]
    with np.errstate(invalid="ignore"):
        return float((t > farthest_hit(corners, origins, directions)).sum())


def _build_ratio(make: MakeTrace, count: int) -> float:
    """Build time of coincident triangles, in build times of random ones (the least of three each)."""
    random, count = np.random.default_rng(11), min(count, 100_000)
    scattered = random.uniform(-1, 1, (count, 1, 3)) + random.normal(size=(count, 3, 3)) * 0.01
    seconds = []
    for corners in (scattered, np.repeat(scattered[:1], count, axis=0)):
        times = []
        for _ in range(3):
            start = perf_counter()
            make(corners.reshape(-1, 3), np.arange(3 * count, dtype=np.int32).reshape(-1, 3))
            times.append(perf_counter() - start)
        seconds.append(min(times))
    return seconds[1] / seconds[0]


def _invalid_rays(make: MakeTrace, count: int) -> float:
    """Hits of rays with NaN or infinity in origin or direction, or with no direction."""
    random, count = np.random.default_rng(12), min(count, 10_000)
    rays = np.concatenate([_inside(random, count), random.normal(size=(count, 3))], axis=1)
    rays[np.arange(count), random.integers(6, size=count)] = random.choice([np.nan, np.inf, -np.inf], count)
    rays[: count // 4, :] = np.concatenate([_inside(random, count // 4), np.zeros((count // 4, 3))], axis=1)
    t, triangle = make(*_ball())(rays[:, :3], rays[:, 3:])
    return float(((triangle >= 0) & np.isfinite(t)).sum())


CASES = (
    Case("N1", "ball, rays at vertices: missed", 0, _vertices),
    Case("N1", "rays at edge midpoints: missed", 0, _midpoints),
    Case("N1", "rays at random edge points: missed", 0, _edges),
    Case("N2", "ball at 1.5e5 … 1e12: missed", 0, _moved),
    Case("N2", "ball of size 1e-6 … 1e6: missed", 0, _scaled),
    Case("N2", "ball times 2^k: other bits", 0, _powers_of_two),
    Case("N3", "on the lines of a grid: missed", 0, _grid),
    Case("N4", "from and along the sides of boxes: not as brute force", 0, _slabs),
    Case("N5", "components 0 … 1e-8: not as brute force", 0, _odd_components),
    Case("N5", "and lengths 1e-30 … 1e30", 0, _odd_lengths),
    Case("N6", "needles 1e2 … 1e7: missed", 0, lambda make, count: _needles(make, count)[0]),
    Case("N6", "needles 1e2 … 1e7: worst error of t", 1e-6, lambda make, count: _needles(make, count)[1]),
    Case("N6", "edges 2^-7 … 2^-40: missed", 0, _tiny),
    Case("N7", "triangles without area or with NaN: other hits", 0, _contaminated),
    Case("N8", "build, coincident / random", 3, _build_ratio),
    Case("N9", "nasty soup: inner hits missed", 0, _soup),
    Case("N10", "coincident triangles: not the first is hit", 0, _duplicates),
    Case("N11", "invalid rays: hits", 0, _invalid_rays),
)
