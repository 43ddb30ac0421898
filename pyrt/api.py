"""The public interface in Python: see `load_scene`, `render`, `Renderer` and `RayTracer`."""

from __future__ import annotations

import os
from collections.abc import Iterable, Mapping
from typing import Any

from pyrt.farm import merge, render_parallel
from pyrt.hit_lists import AllHits
from pyrt.intersector import RayMeshIntersector
from pyrt.renderer import Renderer
from pyrt.result import Result
from pyrt.scene import Scene
from pyrt.scene_io import load_scene
from pyrt.tracer import Hits, RayTracer
from pyrt.watch import Progress


def render(
    scene: Scene | Mapping[str, Any] | str | os.PathLike[str],
    *,
    spp: int | None = None,
    seed: int = 0,
    size: tuple[int, int] | None = None,
    noise: float | None = None,
    time_limit: float | None = None,
    crop: tuple[int, int, int, int] | None = None,
    aovs: Iterable[str] = (),
    denoise: bool = False,
    device: str | int | None = None,
    progress: Progress | None = None,
) -> Result:
    """Renders a scene, a dict in the scene format, or a scene file. Arguments as for `Renderer` and its `render`."""
    if not isinstance(scene, Scene):
        scene = load_scene(scene)
    return Renderer(scene, device, progress=progress).render(
        spp, seed, size, noise=noise, time_limit=time_limit, crop=crop, aovs=aovs, denoise=denoise
    )


__all__ = [
    "AllHits",
    "Hits",
    "RayMeshIntersector",
    "RayTracer",
    "Renderer",
    "Result",
    "load_scene",
    "merge",
    "render",
    "render_parallel",
]
