"""Model files as scenes: GLB and glTF with what they hold, bare meshes in a neutral material."""

from __future__ import annotations

import os
from pathlib import Path

from pyrt.gltf_scene import load_gltf
from pyrt.mesh_io import load_mesh
from pyrt.model import Model, add_material
from pyrt.smooth import smoothed

_NEUTRAL = {"type": "diffuse", "color": [0.72, 0.7, 0.67]}
_Z_UP = {".stl"}  # what CAD programs and printers use; +y is up in the other formats


def load_model(path: str | os.PathLike[str]) -> Model:
    """Reads a model file; its extension tells the format. Raises SceneError as `load_mesh` and `load_gltf`."""
    suffix = Path(path).suffix.lower()
    if suffix in (".glb", ".gltf"):
        return load_gltf(path)
    mesh = load_mesh(path)
    model = Model(warnings=list(mesh.warnings))
    model.raw["camera"]["ref_up"] = [0, 0, 1] if suffix in _Z_UP else [0, 1, 0]
    model.meshes["mesh"] = smoothed(mesh)
    name = add_material(model, "neutral", _NEUTRAL)
    model.raw["objects"].append({"type": "mesh", "path": "mesh", "material_name": name})
    return model
