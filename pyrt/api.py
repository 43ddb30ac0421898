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
    """Renders a `Scene`, or what `load_scene` takes. The other arguments are those of `Renderer` and its `render`.

    Raises:
        SceneError, UsageError, DeviceError: as for `load_scene`, `Renderer` and its `render`.
    """
    if not isinstance(scene, Scene):
        scene = load_scene(scene, size=size)
    return Renderer(scene, device, progress=progress).render(
        spp, seed, size, noise=noise, time_limit=time_limit, crop=crop, aovs=aovs, denoise=denoise
    )


def from_trimesh(geometry: Any, *, overrides: Mapping[str, Any] | None = None) -> Scene:
    """The scene of a trimesh.Trimesh or trimesh.Scene, with a camera, a floor and lamps as far as it has none.

    It takes places, colours and base-colour images; of a trimesh.Scene also the camera and the point lights that it has
    been given. Vertices where faces meet at less than 40 degrees are shaded smoothly.

    Args:
        geometry: the mesh or scene, which stays as it is.
        overrides: as for `load_scene`, such as {"film.resolution": [640, 480], "camera.ref_up": [0, 0, 1]}; the second
            makes the floor, the lamps and the picture stand on the xy plane.

    Raises:
        UsageError: `geometry` is something else.
        SceneError: it holds no triangle, or an override makes no sense.
    """
    from pyrt.model_io import model_of_trimesh

    return load_scene(model_of_trimesh(geometry), overrides=overrides)


__all__ = [
    "AllHits",
    "Hits",
    "RayMeshIntersector",
    "RayTracer",
    "Renderer",
    "Result",
    "from_trimesh",
    "load_scene",
    "merge",
    "render",
    "render_parallel",
]
