"""The scenes of the benchmark: those that come with pyrt, variants of them, and generated ones."""

from __future__ import annotations

import json
import math
from collections.abc import Callable
from functools import partial
from typing import Any

import numpy as np
from numpy.typing import NDArray

from bench.generated import FOLDER, clutter, generated
from pyrt import load_scene, procedural
from pyrt.geometry import gather_triangles
from pyrt.scene import Scene

MILLION = {"objects.5.subdivisions": 8}  # of the mesh room: 1,310,720 triangles


def shipped(name: str, **overrides: Any) -> Scene:
    return load_scene(FOLDER / f"{name}.json", overrides=overrides)


def without_disc(name: str) -> Scene:
    """A Cornell scene without its refracting disc, which no other renderer has the material for."""
    raw = json.loads((FOLDER / f"{name}.json").read_text(encoding="utf-8"))
    raw["objects"] = [item for item in raw["objects"] if item.get("material_name") != "glass"]
    del raw["materials"]["glass"]
    return load_scene(raw, base_dir=FOLDER)


ERROR_SCENES: dict[str, Callable[[], Scene]] = {
    "cornell": partial(shipped, "cornell"),
    "area light room": partial(without_disc, "cornell_area_light"),
    "two lights room": partial(without_disc, "cornell_two_lights"),
    "textured room": partial(without_disc, "cornell_textured"),
    "mesh room": partial(shipped, "mesh_room"),
    "million room": partial(shipped, "mesh_room", **MILLION),
    "clutter": partial(clutter, 1),
    "cornell refraction": partial(shipped, "cornell_refraction"),
    "cornell textured": partial(shipped, "cornell_textured"),
    "cornell area light": partial(shipped, "cornell_area_light"),
    "cornell two lights": partial(shipped, "cornell_two_lights"),
}
QUICK_SCENES = ("cornell", "area light room", "mesh room")


def error_scene(name: str) -> Scene:
    """One of `ERROR_SCENES`, or a generated one with its seed ("garden 1234").

    Raises:
        ValueError: there is none of that name.
    """
    return ERROR_SCENES[name]() if name in ERROR_SCENES else generated(name)


def soup(scene: Scene) -> tuple[NDArray[np.float64], NDArray[np.int32]]:
    """All triangles of a scene as vertices (3m, 3) and indices (m, 3)."""
    corners = gather_triangles(scene).corners
    return corners.reshape(-1, 3), np.arange(3 * len(corners), dtype=np.int32).reshape(-1, 3)


def bumpy_ball(triangles: int) -> tuple[NDArray[np.float64], NDArray[np.int32]]:
    """The first so many triangles of a displaced icosphere, with shared vertices."""
    subdivisions = max(0, math.ceil(math.log(triangles / 20, 4)))
    vertices, faces = procedural.icosphere(subdivisions)
    return vertices * (1 + 0.3 * procedural.noise(vertices, 1.1, 5, 3)[:, None]), faces[:triangles]
