"""Model files and trimesh objects as scenes: GLB and glTF with what they hold, meshes with their colours."""

from __future__ import annotations

import os
from collections import Counter
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from pyrt.errors import SceneError, UsageError
from pyrt.files import read_bytes
from pyrt.image_io import read_texture, srgb_to_linear
from pyrt.mesh_data import MeshData
from pyrt.mesh_io import FORMATS, Surfaces, load_surfaces, part_of
from pyrt.model import Model, add_colors, add_image, add_light, add_material, unique_name
from pyrt.mtl import MtlMaterial, read_mtl
from pyrt.smooth import smoothed

NEUTRAL = {"type": "diffuse", "color": [0.72, 0.7, 0.67]}
_FOREIGN = {".3ds", ".abc", ".blend", ".dae", ".fbx", ".pbrt", ".usd", ".usda", ".usdc", ".usdz", ".xml"}
_PICTURES = {".exr", ".hdr", ".jpeg", ".jpg", ".npy", ".png", ".tif", ".tiff"}
_Z_UP = {".stl"}  # what CAD programs and printers use; +y is up in the other formats


def is_model(path: str | os.PathLike[str]) -> bool:
    """Whether the extension tells of a model that pyrt reads. Raises SceneError for formats that one should convert,
    and for pictures."""
    suffix = Path(path).suffix.lower()
    if suffix in _FOREIGN:
        formats = ", ".join(f".{name}" for name in FORMATS)
        raise SceneError(
            f"{path}: expected a scene (.json) or a model ({formats}); Blender, for instance, converts others"
        )
    if suffix in _PICTURES:
        raise SceneError(f"{path}: expected a scene (.json) or a model; pictures are for: pyrt view")
    return suffix.removeprefix(".") in FORMATS


def load_model(path: str | os.PathLike[str]) -> Model:
    """Reads a model file; its extension tells the format. Raises SceneError as `load_surfaces` and `load_gltf`."""
    suffix = Path(path).suffix.lower()
    if suffix in (".glb", ".gltf"):
        from pyrt.gltf_scene import load_gltf  # whose models of glTF take long to import

        return load_gltf(path)
    surfaces = load_surfaces(path)
    model = Model(warnings=list(surfaces.mesh.warnings))
    model.raw["camera"]["ref_up"] = [0, 0, 1] if suffix in _Z_UP else [0, 1, 0]
    surfaces = surfaces._replace(mesh=smoothed(surfaces.mesh))
    if surfaces.colors is not None or not any(surfaces.materials or ()):
        add_surfaces(model, "mesh", surfaces)
    else:
        _add_by_material(model, Path(path).parent, surfaces)
    return model


def model_of_trimesh(geometry: Any) -> Model:
    """A trimesh.Trimesh or trimesh.Scene: places, colours, base-colour images, and of a scene its camera and lights.

    Raises UsageError for anything else.
    """
    model = Model()
    if hasattr(geometry, "faces"):
        _add_trimesh(model, "mesh", geometry, np.eye(4))
    elif hasattr(geometry, "geometry") and hasattr(geometry, "graph"):
        for node in geometry.graph.nodes_geometry:
            matrix, name = geometry.graph[node]
            part = geometry.geometry[name]
            if hasattr(part, "faces"):
                _add_trimesh(model, str(node), part, np.asarray(matrix, np.float64))
            else:
                model.warnings.append(f"{str(node)[:60]!a}: it is no mesh, and left out")
        _add_trimesh_view(model, geometry)
    else:
        raise UsageError(f"from_trimesh: expected a trimesh.Trimesh or trimesh.Scene, got {type(geometry).__name__}")
    if not model.raw["objects"]:
        raise SceneError("from_trimesh: it holds no triangle")
    return model


def _add_trimesh(model: Model, name: str, geometry: Any, matrix: NDArray[np.float64]) -> None:
    surfaces = part_of(geometry)
    if not len(surfaces.mesh.triangles):
        return
    name = unique_name(name, model.meshes, "mesh")
    # vertex normals are computed when they are looked at, so their presence says nothing about what is wanted
    mesh = smoothed(surfaces.mesh._replace(normals=None))
    material = getattr(geometry.visual, "material", None)
    if material is None:
        used = add_surfaces(model, name, surfaces._replace(mesh=mesh))
    else:
        used = add_object(model, name, mesh, add_material(model, name, _of_trimesh_material(model, name, material)))
    if not np.array_equal(matrix, np.eye(4)):
        used["transform"] = matrix.ravel().tolist()


def _of_trimesh_material(model: Model, name: str, material: Any) -> dict[str, Any]:
    """A SimpleMaterial's image or diffuse colour, a PBRMaterial's base colour."""
    factor = np.asarray(material.main_color, np.float64)[:3] / 255
    image = getattr(material, "baseColorTexture", None)
    if image is None:
        image, factor = (
            getattr(material, "image", None),
            factor if getattr(material, "image", None) is None else np.ones(3),
        )
    elif material.baseColorFactor is None:
        factor = np.ones(3)
    if image is None:
        return {"type": "diffuse", "color": factor.tolist()}
    stored = np.asarray(image.convert("RGB") if hasattr(image, "convert") else image)
    pixels = srgb_to_linear(stored.reshape(*stored.shape[:2], -1)[..., :3] / 255) * np.ones(3) * factor
    return {"type": "diffuse", "texture_name": add_image(model, name, pixels.astype(np.float32), flip=True)}


def _add_trimesh_view(model: Model, geometry: Any) -> None:
    """The camera and the lights, where the scene has some: asking for them would make some."""
    if getattr(geometry, "has_camera", False):
        camera = geometry.camera
        model.raw["film"] = {"resolution": [int(n) for n in camera.resolution]}
        (fx, _, cx), (_, fy, cy), _ = camera.K.tolist()
        pose = {"matrix": np.asarray(geometry.camera_transform).tolist(), "convention": "opengl"}
        model.raw["camera"] = {**pose, "intrinsics": {"fx": fx, "fy": fy, "cx": cx, "cy": cy}}
    for light in getattr(geometry, "_lights", None) or ():
        kind, matrix = type(light).__name__, np.asarray(geometry.graph[light.name][0])
        if kind not in ("PointLight", "SpotLight"):
            model.warnings.append(f"its light of type {kind} is not used")
            continue
        cone = (-matrix[:3, 2], light.innerConeAngle, light.outerConeAngle) if kind == "SpotLight" else None
        add_light(model, matrix[:3, 3], light.intensity * np.asarray(light.color[:3]) / 255, cone)


def add_surfaces(model: Model, name: str, surfaces: Surfaces) -> dict[str, Any]:
    """Adds a mesh as one object: in its colours, or else neutral. Returns the scene's object."""
    mesh = surfaces.mesh
    if surfaces.colors is not None:
        material, mesh = add_colors(model, name, mesh, surfaces.colors)
    else:
        material = add_material(model, "neutral", NEUTRAL)
    return add_object(model, name, mesh, material)


def add_object(model: Model, name: str, mesh: MeshData, material: str, **more: Any) -> dict[str, Any]:
    """Adds a mesh under a name that is not taken. Returns the scene's object."""
    model.meshes[name] = mesh
    model.raw["objects"].append({"type": "mesh", "path": name, "material_name": material, **more})
    result: dict[str, Any] = model.raw["objects"][-1]
    return result


def _add_by_material(model: Model, folder: Path, surfaces: Surfaces) -> None:
    """An object for each material of an OBJ file."""
    defined: dict[str, MtlMaterial] = {}
    for library in surfaces.libraries:
        try:
            defined |= read_mtl(read_bytes(folder / library))
        except SceneError as error:
            model.warnings.append(f"{error}; its materials are grey")
    unused: Counter[str] = Counter()
    for name, rows in (surfaces.materials or {}).items():
        mesh = _rows(surfaces.mesh, rows)
        material = defined.get(name)
        if material is None:
            add_object(model, name or "mesh", mesh, add_material(model, name or "neutral", NEUTRAL))
            continue
        unused.update(material.unused)
        light = {"light": {"radiance": list(material.emission)}} if any(material.emission) else {}
        add_object(model, name, mesh, add_material(model, name, _definition(model, folder, name, material)), **light)
    if unused:
        features = ", ".join(f"{what} ({count} times)" for what, count in sorted(unused.items()))
        model.warnings.append(f"its materials' {features} are not rendered")


def _definition(model: Model, folder: Path, name: str, material: MtlMaterial) -> dict[str, Any]:
    if material.glass:
        return {"type": "dielectric", "int_ior": material.ior}
    if material.image is not None:
        try:
            pixels = read_texture(folder / material.image.replace("\\", "/")).pixels
        except SceneError as error:
            model.warnings.append(f"{error}; the colour of the material is used")
        else:
            # most programs write black or grey beside an image, and mean the image alone
            texture = add_image(model, name, np.clip(pixels, 0, 1), flip=True)
            return {"type": "diffuse", "texture_name": texture}
    return {"type": "diffuse", "color": list(material.color)}


def _rows(mesh: MeshData, rows: NDArray[np.int64]) -> MeshData:
    """Some triangles of a mesh, and the vertices that they use."""
    used, triangles = np.unique(mesh.triangles[rows], return_inverse=True)
    return MeshData(
        mesh.vertices[used],
        triangles.reshape(-1, 3).astype(np.int32),
        None if mesh.uvs is None else mesh.uvs[rows],
        None if mesh.normals is None else mesh.normals[rows],
    )
