"""`pyrt.RayMeshIntersector` beside trimesh's own engines: time, and hits that get lost."""

from __future__ import annotations

import statistics
import sys
from collections.abc import Callable
from importlib.util import find_spec
from typing import Any

import numpy as np
from numpy.typing import NDArray

import pyrt
from bench.measure import interleaved, paired_ratio
from bench.report import Table, number
from pyrt.procedural import icosphere

PYRT, EMBREE, TRIANGLE = "pyrt", "trimesh with embreex", "trimesh's triangles"
SLOW_RAYS = 20  # for the triangle engine, whose time on a large mesh is 30 ms a ray

Rays = tuple[NDArray[np.float64], NDArray[np.float64]]
QUERIES: dict[str, Callable[[Any, Rays], Any]] = {
    "intersects_first": lambda engine, rays: engine.intersects_first(*rays),
    "intersects_any": lambda engine, rays: engine.intersects_any(*rays),
    "intersects_id, all hits": lambda engine, rays: engine.intersects_id(*rays),
    "intersects_location": lambda engine, rays: engine.intersects_location(*rays),
}


def engines(mesh: Any) -> dict[str, Any]:
    """Those whose packages are installed, by name."""
    from trimesh.ray import ray_triangle

    found = {PYRT: pyrt.RayMeshIntersector(mesh)}
    if find_spec("embreex"):
        from trimesh.ray import ray_pyembree

        found[EMBREE] = ray_pyembree.RayMeshIntersector(mesh)
    if find_spec("rtree"):
        found[TRIANGLE] = ray_triangle.RayMeshIntersector(mesh)
    return found


def speed(meshes: dict[str, tuple[Any, Rays]], repeats: int) -> tuple[Table, dict[str, float]]:
    """Thousands of rays per second, and how many times faster than with embreex."""
    import trimesh

    rows, figures = [], {}
    for label, (soup, rays) in meshes.items():
        print(f"rays: drop-in for trimesh, {label}", file=sys.stderr)
        mesh = trimesh.Trimesh(*soup, process=False)
        for query, ask in QUERIES.items():
            seconds, counts = _measure(engines(mesh), ask, rays, repeats)
            rates = {who: counts[who] / statistics.median(times) / 1e3 for who, times in seconds.items()}
            key = f"{label} ({len(soup[1])} triangles), {query}"
            if EMBREE in seconds:
                figures[f"{key}, times faster"] = paired_ratio(seconds[PYRT], seconds[EMBREE])
            figures |= {f"{key}, {who} krays/s": rate for who, rate in rates.items()}
            faster = number(figures.get(f"{key}, times faster"))
            rows.append((key, *(number(rates.get(who)) for who in (PYRT, EMBREE, TRIANGLE)), faster))
    count = max(len(rays[0]) for _, rays in meshes.values())
    notes = (
        f"{count:,} incoherent rays, for trimesh's triangles {SLOW_RAYS}; {repeats} interleaved repetitions, medians.",
    )
    return Table(
        "Drop-in for trimesh", ("krays/s", PYRT, EMBREE, TRIANGLE, "times faster"), tuple(rows), notes
    ), figures


def _measure(
    found: dict[str, Any], ask: Callable[[Any, Rays], Any], rays: Rays, repeats: int
) -> tuple[dict[str, list[float]], dict[str, int]]:
    """Seconds and number of rays by engine."""
    few = rays[0][:SLOW_RAYS], rays[1][:SLOW_RAYS]
    given = {who: few if who == TRIANGLE else rays for who in found}

    def job(who: str) -> Callable[[int], Any]:
        return lambda _: ask(found[who], given[who])

    seconds = interleaved({who: job(who) for who in found}, repeats, lambda name, result: None)
    return seconds, {who: len(given[who][0]) for who in found}


def lost_hits() -> tuple[Table, dict[str, float]]:
    """Rays of which each must hit so many times."""
    import trimesh

    rows, figures = [], {}
    for label, (soup, (origins, directions), expected) in _known_hits().items():
        for who, engine in engines(trimesh.Trimesh(*soup, process=False)).items():
            rays = slice(100 * SLOW_RAYS if who == TRIANGLE else None)
            o, d = origins[rays], directions[rays]
            hits = np.bincount(engine.intersects_location(o, d)[1], minlength=len(o))
            shares = {"too few": float((hits < expected).mean()), "too many": float((hits > expected).mean())}
            figures |= {f"{label}, {who}, {what}": share for what, share in shares.items()}
            rows.append((f"{label}, {who}", f"{len(o):,}", *(f"{share:.2%}" for share in shares.values())))
    columns = ("intersects_location", "rays", "with too few hits", "with too many")
    return Table("Lost and doubled hits", columns, tuple(rows), ()), figures


def _known_hits() -> dict[str, tuple[Any, Rays, int]]:
    """Mesh, rays and the number of hits of each ray, by name."""
    random = np.random.default_rng(0)
    sphere = icosphere(4)
    corners = np.tile(sphere[0], (8, 1))
    inside = random.uniform(-0.3, 0.3, corners.shape)
    line = np.linspace(0, 1, 65)
    grid = np.stack(np.meshgrid(line, line, [1.0]), axis=-1).reshape(-1, 3)
    above = np.column_stack([random.uniform(0.05, 0.45, (1000, 2)), np.ones(1000)])
    layers = [[[0, 0, z], [1, 0, z], [0, 1, z]] for z in np.linspace(0, 1e-5, 11)]
    return {
        "corners of a sphere from inside": (sphere, (inside, corners - inside), 1),
        "a grid over an open square, borders too": (_square(8), (grid, np.tile([0.0, 0, -1], (len(grid), 1))), 1),
        "11 layers 1e-6 apart": (
            (np.reshape(layers, (-1, 3)), np.arange(33).reshape(-1, 3)),
            (above, np.tile([0.0, 0, -1], (1000, 1))),
            11,
        ),
    }


def _square(side: int) -> tuple[NDArray[np.float64], NDArray[np.int64]]:
    """The unit square as 2·side² triangles."""
    y, x = np.divmod(np.arange((side + 1) ** 2), side + 1)
    first = (np.arange(side)[:, None] * (side + 1) + np.arange(side)).ravel()
    squares = np.stack([first, first + 1, first + side + 2, first + side + 1], axis=1)
    return np.stack([x / side, y / side, 0 * x], axis=1), squares[:, [[0, 1, 2], [0, 2, 3]]].reshape(-1, 3)
