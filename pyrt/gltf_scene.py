"""A glTF file as a scene: geometry, base colours, glass, emission, the camera and lights.

Units of light: a candela of a lamp is taken for a watt per steradian, and a nit of a surface for a radiance of 1.
"""

from __future__ import annotations

import math
import os
from collections import Counter
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import NDArray

from pyrt.errors import SceneError
from pyrt.files import read_bytes
from pyrt.geometry import valid_triangles
from pyrt.gltf import Document, at, image_bytes, open_gltf
from pyrt.gltf_mesh import PlacedNode, PlacedPrimitive, placed_nodes, placed_primitives, read_primitive
from pyrt.gltf_schema import Camera, Light, Material, Primitive, TextureInfo, TextureTransform
from pyrt.mesh_data import MeshData
from pyrt.model import (
    CLAMP,
    MIRROR,
    REPEAT,
    Model,
    add_colors,
    add_image,
    add_light,
    add_material,
    decode_image,
)

_WRAP = {10497: REPEAT, 33071: CLAMP, 33648: MIRROR}
_NEAREST = 9728
_PIXELS = 512 * 512  # of a film for a camera that has a shape but no size
_FAR = 2.0**20  # distance of a light at infinity, in radii of the scene
_READ_EXTENSIONS = {"KHR_materials_emissive_strength", "KHR_materials_transmission", "KHR_materials_ior"}


@dataclass
class _Reading:
    """What reading one file collects."""

    document: Document
    model: Model = field(default_factory=Model)
    images: dict[tuple[int, tuple[float, ...]], str | None] = field(default_factory=dict)  # texture names
    plain: dict[int | None, str] = field(default_factory=dict)  # names of materials without colours at corners
    unused: Counter[str] = field(default_factory=Counter)  # what materials ask for and do not get


def load_gltf(path: str | os.PathLike[str]) -> Model:
    """Reads a GLB or glTF file.

    Raises:
        SceneError: as `open_gltf`; or the file, or what its scene refers to is damaged or missing.
    """
    content = read_bytes(path)
    try:
        reading = _Reading(open_gltf(path, content))
        nodes = list(placed_nodes(reading.document))
        placed, warnings = placed_primitives(reading.document, nodes)
        reading.model.warnings.extend(warnings)
        _add_objects(reading, placed)
        _add_camera(reading, nodes)
        _add_lights(reading, nodes)
        _warn_about_materials(reading)
    except SceneError as error:
        raise SceneError([f"{path}: {problem}" for problem in error.problems]) from None
    if not reading.model.raw["objects"]:
        raise SceneError(f"{path}: it shows no triangle")
    return reading.model


def _add_objects(reading: _Reading, placed: list[PlacedPrimitive]) -> None:
    """One object for each primitive of each node; those of the same mesh share it."""
    shared: dict[str, dict[str, Any] | None] = {}
    for place, primitive, matrix in placed:
        if place not in shared:
            shared[place] = _object(reading, place, primitive)
        if (made := shared[place]) is not None:
            placing = {} if np.array_equal(matrix, np.eye(4)) else {"transform": matrix.ravel().tolist()}
            reading.model.raw["objects"].append({**made, **placing})


def _object(reading: _Reading, place: str, primitive: Primitive) -> dict[str, Any] | None:
    """The scene's object for a primitive, before it is placed; None if nothing of it can be seen."""
    material = Material()
    if primitive.material is not None:
        material = at(reading.document.tree.materials, primitive.material, place, "material")
    info = material.pbrMetallicRoughness.baseColorTexture
    transform = info.extensions.KHR_texture_transform if info else None
    texcoord = info.texCoord if info else 0
    if transform is not None and transform.texCoord is not None:
        texcoord = transform.texCoord
    mesh, colors = read_primitive(reading.document, primitive, place, texcoord)
    if not len(mesh.triangles) or not valid_triangles(mesh.vertices[mesh.triangles]).any():
        reading.model.warnings.append(f"{place}: it has no triangle with an area, and is left out")
        return None
    if mesh.uvs is not None and transform is not None:
        mesh = mesh._replace(uvs=_moved(mesh.uvs, transform))
    name, mesh = _material(reading, primitive.material, material, mesh, colors)
    reading.model.meshes[place] = mesh
    result: dict[str, Any] = {"type": "mesh", "path": place, "material_name": name}
    strength = material.extensions.KHR_materials_emissive_strength.emissiveStrength
    if any(material.emissiveFactor) and strength and material.emissiveTexture is None:
        result["light"] = {"radiance": [strength * x for x in material.emissiveFactor]}
    return result


def _moved(uvs: NDArray[np.float32], transform: TextureTransform) -> NDArray[np.float32]:
    """KHR_texture_transform: scaled, turned counter-clockwise as one sees it in the image, and shifted.

    As v runs down there, the matrix that the extension prints turns clockwise. Its words, its example and the programs
    that read it agree on this.
    """
    sine, cosine = math.sin(transform.rotation), math.cos(transform.rotation)
    u, v = np.moveaxis(uvs.astype(np.float64) * transform.scale, -1, 0)
    turned = np.stack([cosine * u + sine * v, cosine * v - sine * u], axis=-1)
    return (turned + transform.offset).astype(np.float32)


def _material(
    reading: _Reading, index: int | None, material: Material, mesh: MeshData, colors: NDArray[np.float64] | None
) -> tuple[str, MeshData]:
    """The name of the scene's material, and the mesh with the texture coordinates that it needs."""
    white = colors is None or (colors == 1).all()
    key = index
    if white and key in reading.plain:
        return reading.plain[key], mesh
    name = material.name or ("default" if index is None else f"materials[{index}]")
    if white or _is_glass(material):
        reading.plain[key] = add_material(reading.model, name, _definition(reading, index, material))
        return reading.plain[key], mesh
    assert colors is not None
    if material.pbrMetallicRoughness.baseColorTexture is not None:
        reading.unused["a base-colour texture under vertex colours"] += 1
    factor = material.pbrMetallicRoughness.baseColorFactor[:3]
    return add_colors(reading.model, name, mesh, colors * factor)


def _is_glass(material: Material) -> bool:
    return material.extensions.KHR_materials_transmission.transmissionFactor > 0.5


def _definition(reading: _Reading, index: int | None, material: Material) -> dict[str, Any]:
    pbr = material.pbrMetallicRoughness
    reading.unused.update(_not_rendered(material))
    if _is_glass(material):
        return {"type": "dielectric", "int_ior": material.extensions.KHR_materials_ior.ior or 1.5, "ext_ior": 1.0}
    factor = pbr.baseColorFactor[:3]
    if pbr.baseColorTexture is not None:
        texture = _image(reading, f"materials[{index}]", pbr.baseColorTexture, factor)
        if texture is not None:
            return {"type": "diffuse", "texture_name": texture}
    return {"type": "diffuse", "color": list(factor)}


def _not_rendered(material: Material) -> list[str]:
    """What a material asks for, and its picture will lack."""
    pbr, transmission = material.pbrMetallicRoughness, material.extensions.KHR_materials_transmission
    asked = {
        "metalness": pbr.metallicFactor or pbr.metallicRoughnessTexture is not None,
        "normal maps": material.normalTexture is not None,
        "emissive textures": material.emissiveTexture is not None and any(material.emissiveFactor),
        f"alpha mode {material.alphaMode[:20]}": material.alphaMode != "OPAQUE",
        "faint transmission": transmission.transmissionFactor > 0 and not _is_glass(material),
        "transmission textures": transmission.transmissionTexture is not None,
        "the colour of glass": _is_glass(material)
        and (pbr.baseColorTexture is not None or pbr.baseColorFactor[:3] != (1, 1, 1)),
    }
    others = [name[:60] for name in material.extensions.model_extra or {} if name not in _READ_EXTENSIONS]
    return [what for what, is_asked in asked.items() if is_asked] + others


def _warn_about_materials(reading: _Reading) -> None:
    if reading.unused:
        features = ", ".join(f"{what} ({count} times)" for what, count in sorted(reading.unused.items()))
        reading.model.warnings.append(f"its materials' {features} are not rendered: surfaces are matte or clear glass")


def _image(reading: _Reading, place: str, info: TextureInfo, factor: tuple[float, ...]) -> str | None:
    """The name of the texture for an image times a colour, or None where the file has no image that pyrt reads."""
    tree, key = reading.document.tree, (info.index, factor)
    if key not in reading.images:
        texture = at(tree.textures, info.index, place, "texture")
        webp = texture.extensions.EXT_texture_webp
        source = webp.source if webp and texture.source is None else texture.source
        if source is None:
            reading.unused["textures in formats other than PNG, JPEG and WebP"] += 1
            reading.images[key] = None
            return None
        content = image_bytes(reading.document, source, f"textures[{info.index}]")
        pixels = decode_image(content, f"images[{source}]") * np.array(factor, np.float32)
        wrap = (REPEAT, REPEAT)
        if texture.sampler is not None:
            sampler = at(tree.samplers, texture.sampler, f"textures[{info.index}]", "sampler")
            wrap = (_WRAP[sampler.wrapS], _WRAP[sampler.wrapT])
            if sampler.magFilter == _NEAREST:
                reading.unused["nearest filtering"] += 1
        reading.images[key] = add_image(reading.model, f"textures[{info.index}]", pixels, wrap)
    return reading.images[key]


def _add_camera(reading: _Reading, nodes: list[PlacedNode]) -> None:
    """The first perspective camera in the scene."""
    cameras: list[tuple[Camera, NDArray[np.float64]]] = []
    for number, node, matrix in nodes:
        if node.camera is not None:
            camera = at(reading.document.tree.cameras, node.camera, f"nodes[{number}].camera", "camera")
            cameras.append((camera, matrix))
    usable = [(camera.perspective, matrix) for camera, matrix in cameras if camera.perspective]
    if len(usable) < len(cameras):
        reading.model.warnings.append("its orthographic cameras are not used")
    if not usable:
        return
    if len(usable) > 1:
        reading.model.warnings.append(f"its first camera is used, of {len(usable)}")
    perspective, matrix = usable[0]
    if not np.isfinite(matrix).all() or not matrix[:3, :3].any(axis=0).all():
        reading.model.warnings.append("its camera has no direction, and is not used")
        return
    position, backward = matrix[:3, 3], matrix[:3, 2] / np.linalg.norm(matrix[:3, 2])
    reading.model.raw["camera"] = {
        "position": position.tolist(),
        "look_at": (position - backward * max(1.0, float(np.abs(position).max()))).tolist(),
        "ref_up": (matrix[:3, 1] / np.linalg.norm(matrix[:3, 1])).tolist(),
        "fov": math.degrees(perspective.yfov),
    }
    if perspective.aspectRatio is not None:
        height = math.sqrt(_PIXELS / perspective.aspectRatio)
        size = [round(height * perspective.aspectRatio), round(height)]
        reading.model.raw["film"] = {"resolution": size}


def _add_lights(reading: _Reading, nodes: list[PlacedNode]) -> None:
    for number, node, matrix in nodes:
        reference = node.extensions.KHR_lights_punctual
        if reference is not None:
            lights = reading.document.tree.extensions.KHR_lights_punctual.lights
            light = at(lights, reference.light, f"nodes[{number}].extensions.KHR_lights_punctual", "light")
            _add_light(reading, light, matrix)


def _add_light(reading: _Reading, light: Light, matrix: NDArray[np.float64]) -> None:
    warnings, position, intensity = reading.model.warnings, matrix[:3, 3], light.intensity
    if light.type == "directional":
        center, radius = _sphere_around(reading.model)
        backward = matrix[:3, 2] / max(float(np.linalg.norm(matrix[:3, 2])), 1e-300)
        position, intensity = center + backward * (radius * _FAR), light.intensity * (radius * _FAR) ** 2
    elif light.type not in ("point", "spot"):
        warnings.append(f"its lights of type {light.type[:20]!a} are not used")
        return
    if light.range is not None:
        warnings.append("the range of its lights is not used, they fade with the square of the distance")
    cone = (-matrix[:3, 2], light.spot.innerConeAngle, light.spot.outerConeAngle) if light.type == "spot" else None
    add_light(reading.model, position, intensity * np.array(light.color), cone)


def _sphere_around(model: Model) -> tuple[NDArray[np.float64], float]:
    """Centre and radius of a sphere around all objects."""
    corners = []
    for placed in model.raw["objects"]:
        vertices = model.meshes[placed["path"]].vertices
        box = np.stack([np.nanmin(vertices, axis=0), np.nanmax(vertices, axis=0)])
        ends = box[[[i, j, k] for i in (0, 1) for j in (0, 1) for k in (0, 1)], [0, 1, 2]]
        matrix = np.reshape(placed.get("transform", np.eye(4)), (4, 4))
        corners.append(ends @ matrix[:3, :3].T + matrix[:3, 3])
    points = np.concatenate(corners or [np.zeros((1, 3))])
    low, high = points.min(axis=0), points.max(axis=0)
    return (low + high) / 2, float(np.linalg.norm(high - low) / 2) or 1.0
