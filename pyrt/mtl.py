"""Reads MTL, the material files of Wavefront OBJ: base colours, their images, emission and glass."""

from __future__ import annotations

from dataclasses import dataclass, field, replace

import numpy as np

Color = tuple[float, float, float]

_GLASS = (4, 6, 7, 9)  # illumination models that refract
_UNUSED = ("map_bump", "bump", "norm", "disp", "map_d", "map_ke", "pm", "map_pm")


@dataclass(frozen=True)
class MtlMaterial:
    """`image`: name of the file of the base colour; `unused`: statements that pyrt does not render."""

    color: Color = (0.8, 0.8, 0.8)
    image: str | None = None
    emission: Color = (0.0, 0.0, 0.0)
    glass: bool = False
    ior: float = 1.5
    unused: tuple[str, ...] = field(default=())


def read_mtl(content: bytes) -> dict[str, MtlMaterial]:
    """Materials by name. Statements that are not understood are left out."""
    materials: dict[str, MtlMaterial] = {}
    name = None
    for line in content.decode("utf-8", "replace").splitlines():
        key, _, value = line.strip().partition(" ")
        if key.lower() == "newmtl":
            name = value.strip()
            materials[name] = MtlMaterial()
        elif name is not None:
            materials[name] = _with_statement(materials[name], key.lower(), value.split())
    return materials


def _with_statement(material: MtlMaterial, key: str, words: list[str]) -> MtlMaterial:
    numbers = _numbers(words)
    if key == "kd" and numbers:
        return replace(material, color=_color(numbers, 1.0))
    if key == "ke" and numbers:
        return replace(material, emission=_color(numbers, 1e30))
    if key == "map_kd" and words:
        return replace(material, image=words[-1] if words[0].startswith("-") else " ".join(words))
    if key == "illum" and numbers and numbers[0] in _GLASS:
        return replace(material, glass=True)
    if key == "ni" and numbers and numbers[0] > 1:
        return replace(material, ior=numbers[0])
    transparent = (key == "d" and numbers and numbers[0] < 1) or (key == "tr" and numbers and numbers[0] > 0)
    if key in _UNUSED or transparent:
        return replace(material, unused=(*material.unused, key))
    return material


def _color(numbers: list[float], limit: float) -> Color:
    red, green, blue = np.clip((numbers * 3)[:3] if len(numbers) < 3 else numbers[:3], 0, limit).tolist()
    return red, green, blue


def _numbers(words: list[str]) -> list[float]:
    try:
        numbers = [float(word) for word in words]
    except ValueError:
        return []
    return numbers if np.isfinite(numbers).all() else []
