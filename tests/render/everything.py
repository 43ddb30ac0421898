"""One small scene that needs every feature of the kernels."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np

import pyrt
from pyrt.scene import ImageTexture, Mesh, Scene, SpotLight

SIZE = (40, 24)

_SCENE: dict[str, Any] = {
    "integrator": {"type": "intersection_test", "point_light_position": [1, 3, 2], "point_light_flux": [40, 40, 50]},
    "film": {"resolution": [40, 24]},
    "camera": {"position": [0, 2, 7], "look_at": [0, 1, 0], "fov": 40},
    "textures": {"board": {"type": "checkerboard", "tex_coordinate_generator": {"scale": [4, 4]}}},
    "materials": {
        "board": {"type": "diffuse", "texture_name": "board"},
        "grey": {"type": "diffuse", "color": [0.7, 0.6, 0.5]},
        "glass": {"type": "dielectric"},
        "pane": {"type": "refraction", "eta": 0.8},
    },
    "objects": [
      {"type": "rectangle", "center": [0, 0, 0], "edge1": [9, 0, 0], "edge2": [0, 0, -9], "material_name": "board"},
      {"type": "rectangle", "center": [0, 2, -3], "edge1": [9, 0, 0], "edge2": [0, 5, 0], "material_name": "board"},
      {"type": "icosphere", "center": [-1.6, 0.9, 0], "radius": 0.8, "subdivisions": 2, "material_name": "grey",
       "displacement": {"amplitude": 0.2}},
      {"type": "sphere", "center": [0.2, 0.8, 1], "radius": 0.7, "material_name": "glass"},
      {"type": "sphere", "center": [1.9, 0.5, -0.5], "radius": 0.5, "material_name": "grey"},
      {"type": "rectangle", "center": [1.5, 1, 1.5], "edge1": [1, 0, 0], "edge2": [0, 2, 0], "material_name": "pane"},
      {"type": "rectangle", "center": [0, 4, 0], "edge1": [1, 0, 0], "edge2": [0, 0, 1],
       "light": {"radiance": [9, 9, 8]}},
      {"type": "icosphere", "center": [-2.5, 3, 1], "radius": 0.4, "subdivisions": 1, "light": {"radiance": [5, 2, 1]}},
      {"type": "sphere", "center": [2.5, 2.5, 0.5], "radius": 0.2, "light": {"radiance": [9, 9, 20]}},
    ],
}  # fmt: skip


def everything() -> Scene:
    """The board's second use becomes an image, which a dict could only name by a file."""
    scene = pyrt.load_scene(_SCENE)
    image = ImageTexture(np.random.default_rng(0).random((5, 3, 3), np.float32), scale=(2, -3), delta=(0.1, 0.2))
    wall = replace(scene.shapes[1], material=len(scene.materials))
    material = replace(scene.materials[0], texture=len(scene.textures))
    shapes = (scene.shapes[0], wall, *scene.shapes[2:])
    spot = SpotLight((-1.0, 4.0, 3.0), (0.0, -0.8, -0.6), (9.0, 9.0, 2.0), inner=5.0, outer=20.0)
    return replace(
        scene,
        shapes=shapes,
        textures=(*scene.textures, image),
        materials=(*scene.materials, material),
        lights=(*scene.lights, spot),
    )


def shuffled(scene: Scene, seed: int) -> Scene:
    """The same scene with the triangles of each mesh in another order."""
    rng = np.random.default_rng(seed)

    def shuffle(mesh: Mesh) -> Mesh:
        order = rng.permutation(len(mesh.triangles))
        uvs, normals = (None if x is None else x[order] for x in (mesh.uvs, mesh.normals))
        return replace(mesh, triangles=mesh.triangles[order], uvs=uvs, normals=normals)

    return replace(scene, shapes=tuple(shuffle(s) if isinstance(s, Mesh) else s for s in scene.shapes))
