"""A model file as a scene: what it holds in the words of the scene format, its meshes and images beside that."""

from __future__ import annotations

import math
import tempfile
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from pyrt.errors import SceneError
from pyrt.image_io import TextureData, read_texture
from pyrt.mesh_data import MeshData

REPEAT, CLAMP, MIRROR = "repeat", "clamp", "mirror"

_MAX_NAME = 100
_SUFFIXES = {b"\x89PNG": ".png", b"\xff\xd8\xff": ".jpg", b"RIFF": ".webp"}


@dataclass(frozen=True)
class Model:
    """Attributes:
    raw: the scene, as `json` would read it from a scene file.
    meshes: what the objects' paths name, instead of files.
    images: what the textures' paths name, instead of files. They may hold colours outside of 0 to 1 where no
        texture coordinate leads.
    warnings: what was left out.
    """

    raw: dict[str, Any] = field(
        default_factory=lambda: {"camera": {}, "textures": {}, "materials": {}, "lights": [], "objects": []}
    )
    meshes: dict[str, MeshData] = field(default_factory=dict)
    images: dict[str, TextureData] = field(default_factory=dict)
    warnings: list[str] = field(default_factory=list)


def unique_name(wanted: str, taken: dict[str, Any], fallback: str) -> str:
    """`wanted`, if it can name an entry of the scene, with a number behind it if it is taken."""
    name = wanted if wanted.isprintable() and 0 < len(wanted) <= _MAX_NAME else fallback
    if name not in taken:
        return name
    number = 2
    while f"{name} {number}" in taken:
        number += 1
    return f"{name} {number}"


def add_image(
    model: Model, name: str, pixels: NDArray[np.float32], wrap: tuple[str, str] = (REPEAT, REPEAT), flip: bool = False
) -> str:
    """Adds an image (height, width, 3) as a texture; `flip`: its v runs upwards. Returns the texture's name.

    The kernels repeat images. A mirrored one is stored beside its mirror image, and one whose edges go on for ever
    gets its edges doubled, which is right from half a texel outside.
    """
    name = unique_name(name, model.raw["textures"], "image")
    mapping = []
    for axis, mode in ((1, wrap[0]), (0, wrap[1])):
        size = pixels.shape[axis]
        if mode == MIRROR:
            pixels = np.concatenate([pixels, np.flip(pixels, axis)], axis)
            mapping.append((0.5, 0.0))
        elif mode == CLAMP:
            pixels = np.pad(pixels, [(int(i == axis),) * 2 for i in range(3)], "edge")
            mapping.append((size / (size + 2), 1 / (size + 2)))
        else:
            mapping.append((1.0, 0.0))
    (scale_s, delta_s), (scale_t, delta_t) = mapping
    if flip:
        scale_t, delta_t = -scale_t, delta_t + scale_t
    model.images[name] = TextureData(np.ascontiguousarray(pixels, np.float32))
    coordinates = {"scale": [scale_s, scale_t], "delta": [delta_s, delta_t]}
    model.raw["textures"][name] = {"type": "image", "path": name, "tex_coordinate_generator": coordinates}
    return name


def add_light(
    model: Model,
    position: NDArray[np.float64],
    intensity: NDArray[np.float64],
    cone: tuple[NDArray[np.float64], float, float] | None = None,
) -> None:
    """Adds a light of some watts per steradian and channel (3,). `cone`: its axis, and the angles from that in radians
    between which it fades; as files have equal ones for a sharp edge, they are moved a little apart."""
    if cone is None:
        model.raw["lights"].append({"position": position.tolist(), "flux": (4 * math.pi * intensity).tolist()})
        return
    axis, inner, outer = cone
    length = float(np.linalg.norm(axis))
    if not 0 < length < math.inf:
        model.warnings.append("its spot lights without a direction are not used")
        return
    outer_angle = min(math.degrees(outer), 90.0)
    spot = {
        "type": "spot",
        "position": position.tolist(),
        "look_at": (position + axis / length * max(1.0, float(np.abs(position).max()))).tolist(),
        "intensity": intensity.tolist(),
        "inner_angle": min(math.degrees(inner), 0.999 * outer_angle),
        "outer_angle": outer_angle,
    }
    model.raw["lights"].append(spot)


def add_material(model: Model, name: str, definition: dict[str, Any]) -> str:
    """Adds a material; returns the name that it got."""
    name = unique_name(name, model.raw["materials"], "material")
    model.raw["materials"][name] = definition
    return name


def add_colors(model: Model, name: str, mesh: MeshData, colors: NDArray[np.float64]) -> tuple[str, MeshData]:
    """A diffuse material of linear colours at the corners (m, 3, 3), and the mesh with coordinates into it."""
    if np.ptp(colors, axis=(0, 1)).max() == 0:
        return add_material(model, name, {"type": "diffuse", "color": colors[0, 0].tolist()}), mesh
    pixels, uvs = color_atlas(colors)
    texture = add_image(model, name, pixels)
    return add_material(model, name, {"type": "diffuse", "texture_name": texture}), mesh._replace(uvs=uvs)


def color_atlas(colors: NDArray[np.float64]) -> tuple[NDArray[np.float32], NDArray[np.float32]]:
    """An image, and texture coordinates (m, 3, 2), that interpolate colours (m, 3, 3) linearly over each triangle.

    Each triangle has 2×2 texels of its own: the colours c0, c1, c2 at three of them, and c1 + c2 − c0 at the fourth,
    which makes the bilinear interpolation between them linear.
    """
    count = len(colors)
    columns = math.ceil(math.sqrt(count))
    rows = math.ceil(count / columns)
    c0, c1, c2 = colors.transpose(1, 0, 2)
    blocks = np.zeros((rows * columns, 2, 2, 3), np.float32)
    blocks[:count] = np.stack([np.stack([c0, c1], 1), np.stack([c2, c1 + c2 - c0], 1)], 1)
    pixels = blocks.reshape(rows, columns, 2, 2, 3).swapaxes(1, 2).reshape(2 * rows, 2 * columns, 3)
    row, column = np.divmod(np.arange(count), columns)
    corner = np.stack([column, row], 1)[:, None] * 2 + 0.5 + np.array([[0, 0], [1, 0], [0, 1]])
    return pixels, (corner / [2 * columns, 2 * rows]).astype(np.float32)


def decode_image(content: bytes, place: str) -> NDArray[np.float32]:
    """The linear pixels (height, width, 3) of an encoded PNG, JPEG or WebP image, whose colours are sRGB."""
    suffix = next((suffix for magic, suffix in _SUFFIXES.items() if content.startswith(magic)), None)
    if suffix is None:
        raise SceneError(f"{place}: expected a PNG, JPEG or WebP image, it begins with {content[:4]!r}")
    with tempfile.TemporaryDirectory() as folder:  # OpenImageIO's Python reads only files
        file = Path(folder, f"image{suffix}")
        file.write_bytes(content)
        try:
            return read_texture(file, "srgb").pixels
        except SceneError as error:
            raise SceneError([p.replace(str(file), place) for p in error.problems]) from None
