"""Ray rates: closest hit and any hit, coherent and incoherent, for a small and a large scene."""

from __future__ import annotations

import statistics
import sys
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

import pyrt
from bench import dropin, peers_embree, peers_mitsuba
from bench.measure import interleaved, paired_ratio
from bench.report import Outcome, Table, number
from bench.scenes import shipped, soup
from pyrt.scene import Camera

SCENES = {"Cornell": "cornell", "mesh room": "mesh_room"}
QUERIES = ("closest", "any")
TILE = 8
KERNEL, WHOLE, MITSUBA, EMBREE = "pyrt kernel", "pyrt whole", "Mitsuba", "embreex"

Rays = tuple[NDArray[np.float64], NDArray[np.float64]]


def run(quick: bool, repeats: int, files: Sequence[Path] = ()) -> Outcome:
    """Millions of rays per second of every tracer that is installed; against the meshes of files, too."""
    side = 512 if quick else 1024
    rows: list[tuple[str, ...]] = []
    figures: dict[str, float] = {}
    data = {}
    incoherent = {}
    scenes = {label: shipped(name) for label, name in SCENES.items()}
    for label, scene in (scenes | {file.name: pyrt.load_scene(file) for file in files}).items():
        print(f"rays: {label}", file=sys.stderr)
        mesh = soup(scene)
        beams = {"coherent": camera_rays(scene.camera, side), "incoherent": random_rays(mesh[0], side**2)}
        incoherent[label] = mesh, beams["incoherent"]
        for kind, rays in beams.items():
            seconds = _measure(mesh, rays, kind == "coherent", repeats)
            for query in QUERIES:
                of = {who: seconds[who, query] for who in (KERNEL, WHOLE, MITSUBA, EMBREE) if (who, query) in seconds}
                row, key = _row(of, side**2), f"{label} ({len(mesh[1])} triangles), {kind} {query}"
                data[key] = of
                figures |= {f"{key}, {who} Mrays/s": row[who] for who in of}
                if MITSUBA in of:
                    figures[f"{key}, kernel / Mitsuba"] = paired_ratio(of[KERNEL], of[MITSUBA])
                rows.append(
                    (
                        key,
                        *(number(row.get(who)) for who in (KERNEL, WHOLE, MITSUBA, EMBREE)),
                        number(figures.get(f"{key}, kernel / Mitsuba")),
                    )
                )
    notes = (
        f"{side**2:,} rays, {repeats} interleaved repetitions, medians. Coherent: camera rays in {TILE}×{TILE} tiles; "
        "incoherent: uniform origins in the room, uniform directions. Files as `pyrt render` shows them, on a floor.",
        "Kernel: float64 rays in arrays, hits into arrays that exist. Whole: with new arrays and the checks. Mitsuba's "
        "rays are float32 and stay, like its hits, on the device. "
        "Embree through embreex traces one ray at a time on one core, with float32 numpy in and out.",
    )
    columns = ("Mrays/s", KERNEL, WHOLE, MITSUBA, EMBREE, "kernel / Mitsuba")
    speed, rates = dropin.speed(incoherent, repeats)
    lost, misses = dropin.lost_hits()
    return Outcome((Table("Ray rates", columns, tuple(rows), notes), speed, lost), figures | rates | misses, data)


def _row(seconds: dict[str, list[float]], count: int) -> dict[str, float]:
    return {who: count / statistics.median(times) / 1e6 for who, times in seconds.items()}


def _measure(mesh: Any, rays: Rays, coherent: bool, repeats: int) -> dict[Any, list[float]]:
    """Seconds by (tracer, query)."""
    tracer = pyrt.RayTracer(*mesh)
    jobs: dict[Any, Callable[[int], Any]] = _kernel_jobs(tracer, rays)
    jobs[WHOLE, "closest"] = lambda _: tracer.closest(*rays)
    jobs[WHOLE, "any"] = lambda _: tracer.occluded(*rays)
    if peers_mitsuba.is_vectorised():
        scene, beams = peers_mitsuba.ray_scene(*mesh), peers_mitsuba.rays(*rays)
        jobs[MITSUBA, "closest"] = lambda _: peers_mitsuba.closest(scene, beams, coherent)
        jobs[MITSUBA, "any"] = lambda _: peers_mitsuba.occluded(scene, beams, coherent)
    if peers_embree.version():
        embree = peers_embree.ray_scene(*mesh)
        single = rays[0].astype(np.float32), rays[1].astype(np.float32)
        jobs[EMBREE, "closest"] = lambda _: peers_embree.closest(embree)(*single)
        jobs[EMBREE, "any"] = lambda _: peers_embree.occluded(embree, *single)
    return interleaved(jobs, repeats, lambda name, result: None)


def _kernel_jobs(tracer: pyrt.RayTracer, rays: Rays) -> dict[Any, Callable[[int], Any]]:
    """The tracer's kernels alone, into arrays that exist already. No public interface has them."""
    from pyrt.rays import make_rays

    beams, count = make_rays(*rays, np.inf), len(rays[0])
    t, u, v = np.zeros((3, count))
    outputs = {"closest": (t, np.zeros(count, np.int32), u, v), "any": (np.zeros(count, np.uint8),)}

    def job(query: str) -> Callable[[int], Any]:
        return lambda _: tracer._trace(f"trace_{query}", beams, *outputs[query])

    return {(KERNEL, query): job(query) for query in QUERIES}


def camera_rays(camera: Camera, side: int) -> Rays:
    """(side², 3) origins and directions through the centres of a square film's pixels, tile by tile."""
    y, x = np.mgrid[0:side, 0:side]
    order = np.argsort(((y // TILE) * side + x // TILE).ravel(), kind="stable")
    forward = np.subtract(camera.look_at, camera.position)
    forward = forward / np.linalg.norm(forward)
    right = np.cross(forward, camera.up)
    right /= np.linalg.norm(right)
    half = np.tan(np.radians(camera.fov) / 2)
    u, v = ((2 * (axis.ravel()[order] + 0.5) / side - 1) * half for axis in (x, y))
    directions = forward + u[:, None] * right - v[:, None] * np.cross(right, forward)
    return np.tile(np.asarray(camera.position, float), (side**2, 1)), directions


def random_rays(vertices: NDArray[np.float64], count: int) -> Rays:
    """Origins uniform in the middle of the mesh's box, directions uniform on the sphere."""
    random = np.random.default_rng(1)
    low, high = vertices.min(axis=0), vertices.max(axis=0)
    origins = random.uniform(low + 0.05 * (high - low), high - 0.05 * (high - low), (count, 3))
    directions = random.normal(size=(count, 3))
    return origins, directions / np.linalg.norm(directions, axis=1, keepdims=True)
