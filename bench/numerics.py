"""The numeric stress suite as a table, pyrt beside its peers, and the bias floor of every scene."""

from __future__ import annotations

import sys
import warnings

import numpy as np
from numpy.typing import NDArray

import pyrt
from bench import leaving, peers_embree, peers_mitsuba, pictures, stress
from bench.report import Outcome, Table, number
from bench.stress import Array, MakeTrace, Trace


def run(quick: bool) -> Outcome:
    """Every case with every tracer, then the cases that need whole pictures."""
    rays = 20_000 if quick else 2_000_000
    makers = tracers()
    rows, data = [], {}
    for case in stress.CASES:
        print(f"numerics: {case.name}, {case.measures}", file=sys.stderr)
        values = {name: case.measure(make, rays) for name, make in makers.items()}
        data[f"{case.name}, {case.measures}"] = values
        rows.append(_row(case.name, case.measures, case.threshold, values))
    notes = (f"Failures among {rays:,} rays a case, or what the row says; an asterisk: misses the threshold.",)
    columns = ("case", "measured", "threshold")
    tables = [Table("Numerics: rays", (*columns, *makers), tuple(rows), notes)]
    walkers = leaving.walkers()
    rows = []
    for leave in leaving.CASES:
        print(f"numerics: {leave.name}, {leave.measures}", file=sys.stderr)
        values = {name: leave.measure(walker, rays // 20) for name, walker in walkers.items()}
        data[f"{leave.name}, {leave.measures}"] = values
        rows.append(_row(leave.name, leave.measures, 0, values))
    notes = (
        f"Share of, or failures among, about {rays // 20:,} paths. Mitsuba by spawn_ray, spawn_ray_to and ray_test.",
    )
    tables.append(Table("Numerics: rays that leave surfaces", (*columns, *walkers), tuple(rows), notes))
    painters = pictures.painters()
    rows = []
    for test in pictures.CASES:
        print(f"numerics: {test.name}, {test.measures}", file=sys.stderr)
        values = {name: test.measure(paint, quick) for name, paint in painters.items()}
        data[f"{test.name}, {test.measures}"] = values
        rows.append(_row(test.name, test.measures, test.threshold, values))
    notes = ("An asterisk: misses the threshold.",)
    tables.append(Table("Numerics: pictures", (*columns, *painters), tuple(rows), notes))
    figures = {f"{case}, pyrt": values["pyrt"] for case, values in data.items()}
    return Outcome(tuple(tables), figures, data)


def _row(name: str, measures: str, threshold: float, values: dict[str, float]) -> tuple[str, ...]:
    cells = [number(value) + ("" if value <= threshold else " *") for value in values.values()]
    return (name, measures, number(threshold), *cells)


def tracers() -> dict[str, MakeTrace]:
    """pyrt and the peers that are installed, each in its default and its robust mode."""
    found: dict[str, MakeTrace] = {"pyrt": _pyrt}
    if peers_embree.version():
        found |= {"embreex": lambda v, t: _embree(v, t, False), "embreex robust": lambda v, t: _embree(v, t, True)}
    if peers_mitsuba.is_vectorised():
        found |= {"Mitsuba": lambda v, t: _mitsuba(v, t, False), "Mitsuba robust": lambda v, t: _mitsuba(v, t, True)}
    return found


def _pyrt(vertices: Array, triangles: NDArray[np.int32]) -> Trace:
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        tracer = pyrt.RayTracer(vertices, triangles)

    def trace(origins: Array, directions: Array) -> tuple[Array, NDArray[np.int32]]:
        hits = tracer.closest(origins, directions)
        return hits.t, hits.triangle

    return trace


def _embree(vertices: Array, triangles: NDArray[np.int32], robust: bool) -> Trace:
    trace = peers_embree.closest(peers_embree.ray_scene(vertices, triangles, robust))
    return lambda origins, directions: trace(origins.astype(np.float32), directions.astype(np.float32))


def _mitsuba(vertices: Array, triangles: NDArray[np.int32], robust: bool) -> Trace:
    scene = peers_mitsuba.ray_scene(vertices, triangles, robust)

    def trace(origins: Array, directions: Array) -> tuple[Array, NDArray[np.int32]]:
        found = peers_mitsuba.closest(scene, peers_mitsuba.rays(origins, directions))
        t = np.asarray(found.t, np.float64)
        return t, np.where(np.isfinite(t), np.asarray(found.prim_index).astype(np.int64), -1).astype(np.int32)

    return trace
