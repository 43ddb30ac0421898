"""What a scene needs of the kernels: one table, a row per build macro.

Every macro is always passed, as 0 or 1; the kernels test it with a plain `if (HAS_X && …)`. Leaving a feature out never
changes the image: it only removes code that this scene cannot reach.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

from pyrt.scene import (
    ConstantTexture,
    Dielectric,
    Diffuse,
    ImageTexture,
    Material,
    Mesh,
    Rectangle,
    Refraction,
    Scene,
    Shape,
    Sphere,
    SpotLight,
)


@dataclass(frozen=True)
class Feature:
    """A build macro, what it adds to the kernels, and whether this scene needs it (`count` things do)."""

    macro: str
    adds: str
    what: str
    count: int

    @property
    def on(self) -> bool:
        return self.count > 0

    @property
    def reason(self) -> str:
        return f"{self.count} {self.what}" if self.on else f"no {self.what}"


def used_materials(scene: Scene) -> list[Material]:
    """The materials that some shape has, each once."""
    return [scene.materials[i] for i in sorted({s.material for s in scene.shapes if s.material is not None})]


def used_textures(scene: Scene) -> list[int]:
    """Indices of the textures that some used material reads."""
    return sorted({m.texture for m in used_materials(scene) if isinstance(m, Diffuse)})


def has_corners(shape: Shape, textures: bool) -> bool:
    """Whether the kernels read attributes at the shape's corners; `textures`: whether the scene has some that vary.

    A mesh without texture coordinates has the same ones in each triangle; a rectangle's two triangles differ.
    """
    if isinstance(shape, Rectangle):
        return textures
    return isinstance(shape, Mesh) and (shape.normals is not None or (textures and shape.uvs is not None))


def feature_table(scene: Scene) -> list[Feature]:
    """All rows, in the order in which the macros are passed to the compiler."""
    materials = used_materials(scene)
    textures = [scene.textures[i] for i in used_textures(scene)]
    meshes = [s for s in scene.shapes if isinstance(s, Mesh)]
    lights = [s for s in scene.shapes if s.radiance is not None]
    varying = sum(not isinstance(t, ConstantTexture) for t in textures)
    smooth = sum(m.normals is not None for m in meshes)
    corners = sum(has_corners(s, bool(varying)) for s in scene.shapes)
    specular = _count(materials, Refraction) + _count(materials, Dielectric)
    return [
        Feature("HAS_TEXTURES", "texture coordinates and lookup", "textures that vary", varying),
        Feature("HAS_IMAGES", "bilinear image lookup", "image textures", _count(textures, ImageTexture)),
        Feature("HAS_CORNERS", "per-corner attributes", "shapes with attributes that matter", corners),
        Feature("HAS_SMOOTH_NORMALS", "interpolated normals", "meshes with normals", smooth),
        Feature("HAS_SPHERES", "sphere intersection", "spheres", _count(scene.shapes, Sphere)),
        Feature("HAS_SPECULAR", "paths through specular surfaces", "specular materials", specular),
        Feature("HAS_REFRACTION", "perfect refraction", "refraction materials", _count(materials, Refraction)),
        Feature("HAS_DIELECTRIC", "Fresnel reflection", "dielectric materials", _count(materials, Dielectric)),
        Feature("HAS_SPOT_LIGHTS", "cones of point lights", "spot lights", _count(scene.lights, SpotLight)),
        Feature("HAS_AREA_LIGHTS", "emission at hit points", "area lights", len(lights)),
        Feature("HAS_RECTANGLE_LIGHTS", "rectangle sampling", "rectangle lights", _count(lights, Rectangle)),
        Feature("HAS_MESH_LIGHTS", "emitting-triangle sampling", "mesh lights", _count(lights, Mesh)),
        Feature("HAS_SPHERE_LIGHTS", "sphere-cone sampling", "sphere lights", _count(lights, Sphere)),
    ]


def _count(things: Sequence[object], kind: type) -> int:
    return sum(isinstance(thing, kind) for thing in things)


def build_options(table: list[Feature], everything: bool = False) -> list[str]:
    """Compiler options for the table; with `everything`, as if the scene needed every feature."""
    return [f"-D{row.macro}={int(row.on or everything)}" for row in table]
