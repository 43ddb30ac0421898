"""Time to make a mesh ready for rays."""

from __future__ import annotations

import statistics
import sys
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

import pyrt
from bench import peers_embree, peers_mitsuba
from bench.measure import interleaved, paired_ratio
from bench.report import Outcome, Table, number
from bench.scenes import bumpy_ball
from pyrt.mesh_io import load_mesh

SIZES = (327_680, 1_000_000)
QUICK_SIZES = (81_920,)
TRACER, MITSUBA, EMBREE = "pyrt.RayTracer", "Mitsuba", "embreex"

Mesh = tuple[NDArray[np.float64], NDArray[np.int32]]


def run(quick: bool, repeats: int, files: Sequence[Path] = ()) -> Outcome:
    """Seconds from numpy arrays to a tracer that can be asked; of the meshes of files, too."""
    rows: list[tuple[str, ...]] = []
    figures: dict[str, float] = {}
    data = {}
    meshes: dict[str, Mesh] = {f"{n:,} triangles": bumpy_ball(n) for n in (QUICK_SIZES if quick else SIZES)}
    for file in files:
        vertices, triangles, *_ = load_mesh(file)
        meshes[f"{file.name} ({len(triangles):,} triangles)"] = vertices, triangles
    for label, mesh in meshes.items():
        print(f"build: {label}", file=sys.stderr)
        seconds = interleaved(_jobs(mesh), repeats, lambda name, result: None)
        data[label] = seconds
        median = {name: statistics.median(times) for name, times in seconds.items()}
        figures |= {f"{label}, {name} s": value for name, value in median.items()}
        peers = [name for name in (EMBREE, MITSUBA) if name in seconds]
        ratios = {name: 1 / paired_ratio(seconds[TRACER], seconds[name]) for name in peers}
        figures |= {f"{label}, pyrt / {name}": ratio for name, ratio in ratios.items()}
        rows.append(
            (
                label,
                *(number(median.get(name)) for name in (TRACER, EMBREE, MITSUBA)),
                *(number(ratios.get(name)) for name in (EMBREE, MITSUBA)),
            )
        )
    columns = ("seconds", TRACER, EMBREE, MITSUBA, "pyrt / embreex", "pyrt / Mitsuba")
    notes = (f"From numpy arrays in memory to a tracer that can be asked; {repeats} interleaved repetitions, medians.",)
    return Outcome((Table("Build", columns, tuple(rows), notes),), figures, data)


def _jobs(mesh: Mesh) -> dict[str, Callable[[int], Any]]:
    jobs: dict[str, Callable[[int], Any]] = {TRACER: lambda _: pyrt.RayTracer(*mesh)}
    if peers_embree.version():
        jobs[EMBREE] = lambda _: peers_embree.ray_scene(*mesh)
    if peers_mitsuba.version():
        jobs[MITSUBA] = lambda _: peers_mitsuba.ray_scene(*mesh)
    return jobs
