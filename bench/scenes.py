"""The scenes of the benchmark: those that come with pyrt, variants of them, and generated ones."""

from __future__ import annotations

import json
import math
from collections.abc import Callable
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from pyrt import load_scene, procedural
from pyrt.geometry import gather_triangles
from pyrt.scene import Scene

FOLDER = Path(__file__).parent.parent / "scenes"
MILLION = {"objects.5.subdivisions": 8}  # of the mesh room: 1,310,720 triangles


def shipped(name: str, **overrides: Any) -> Scene:
    return load_scene(FOLDER / f"{name}.json", overrides=overrides)


def without_disc(name: str) -> Scene:
    """A Cornell scene without its refracting disc, which no other renderer has the material for."""
    raw = json.loads((FOLDER / f"{name}.json").read_text(encoding="utf-8"))
    raw["objects"] = [item for item in raw["objects"] if item.get("material_name") != "glass"]
    del raw["materials"]["glass"]
    return load_scene(raw, base_dir=FOLDER)


def clutter(seed: int) -> Scene:
    """The Cornell room with things in it that nobody chose: boards and balls, and lamps of three kinds."""
    random = np.random.default_rng(seed)
    raw = json.loads((FOLDER / "cornell.json").read_text(encoding="utf-8"))
    raw["integrator"] = {"type": "direct", "spp": 32}
    colors = ["red_diffuse", "green_diffuse", "grey_diffuse"]
    for _ in range(24):
        center = random.uniform((-0.9, 0.1, -0.9), (0.9, 1.5, 0.7)).tolist()
        edges = random.normal(size=(2, 3)) * 0.2
        board = {"type": "rectangle", "edge1": edges[0].tolist(), "edge2": edges[1].tolist()}
        ball = {"type": "icosphere", "radius": float(random.uniform(0.03, 0.2)), "subdivisions": 3, "smooth": True}
        raw["objects"].append(
            {
                **(board if random.random() < 0.5 else ball),
                "center": center,
                "material_name": colors[random.integers(3)],
            }
        )
    lamps = [([-0.5, 1.95, 0.2], 0.5, [20, 16, 12]), ([0.6, 1.9, -0.4], 0.2, [20, 30, 60])]
    for center, side, radiance in lamps:
        raw["objects"].append(
            {
                "type": "rectangle",
                "center": center,
                "edge1": [side, 0, 0],
                "edge2": [0, 0, side],
                "light": {"radiance": radiance},
            }
        )
    raw["lights"] = [{"type": "point", "position": [0.1, 1.7, 0.9], "flux": [9, 9, 9]}]
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


def soup(scene: Scene) -> tuple[NDArray[np.float64], NDArray[np.int32]]:
    """All triangles of a scene as vertices (3m, 3) and indices (m, 3)."""
    corners = gather_triangles(scene).corners
    return corners.reshape(-1, 3), np.arange(3 * len(corners), dtype=np.int32).reshape(-1, 3)


def bumpy_ball(triangles: int) -> tuple[NDArray[np.float64], NDArray[np.int32]]:
    """The first so many triangles of a displaced icosphere, with shared vertices."""
    subdivisions = max(0, math.ceil(math.log(triangles / 20, 4)))
    vertices, faces = procedural.icosphere(subdivisions)
    return vertices * (1 + 0.3 * procedural.noise(vertices, 1.1, 5, 3)[:, None]), faces[:triangles]
