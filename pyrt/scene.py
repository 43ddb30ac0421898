"""What the user wrote: an immutable scene in float64, in world units, with every file already read.

Colours are linear Rec.709. Indices refer to the tuples of `Scene`. `scene_io` makes scenes, `pack` turns them into
what the device reads.
"""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

Vec3 = tuple[float, float, float]
Vec2 = tuple[float, float]


@dataclass(frozen=True)
class Film:
    """Size of the picture in pixels. Pixels are square; row 0 is at the top."""

    width: int = 512
    height: int = 512


@dataclass(frozen=True)
class Camera:
    """A pinhole at `position` that looks at `look_at`.

    `fov` is the full vertical angle in degrees that a centred film sees; `center` is where the optical axis meets the
    film, in fractions of its width and height from the upper left; `stretch` is fx / fy of a calibrated camera: so many
    times wider does everything appear.
    """

    position: Vec3 = (0.0, 0.0, 1.0)
    look_at: Vec3 = (0.0, 0.0, 0.0)
    up: Vec3 = (0.0, 1.0, 0.0)
    fov: float = 45.0
    center: Vec2 = (0.5, 0.5)
    stretch: float = 1.0


@dataclass(frozen=True)
class ConstantTexture:
    color: Vec3


@dataclass(frozen=True)
class ImageTexture:
    """Bilinear, wrapped by repetition; st = scale·uv + delta, and st (0, 0) is the upper-left texel corner."""

    pixels: NDArray[np.float32]  # (height, width, 3), linear Rec.709, row 0 at the top
    scale: Vec2 = (1.0, 1.0)
    delta: Vec2 = (0.0, 0.0)


@dataclass(frozen=True)
class CheckerboardTexture:
    """color0 where floor(2s) + floor(2t) is even, else color1."""

    color0: Vec3 = (0.4, 0.4, 0.4)
    color1: Vec3 = (0.2, 0.2, 0.2)
    scale: Vec2 = (1.0, 1.0)
    delta: Vec2 = (0.0, 0.0)


Texture = ConstantTexture | ImageTexture | CheckerboardTexture


@dataclass(frozen=True)
class Diffuse:
    """Lambertian reflection ρ/π; ρ is the texture's colour."""

    texture: int
    twosided: bool = True


@dataclass(frozen=True)
class Refraction:
    """All energy transmitted, no Fresnel reflection; total internal reflection mirrors.

    `eta` is sinθ_t / sinθ_i on entering through the front side, 1/eta on leaving.
    """

    eta: float


@dataclass(frozen=True)
class Dielectric:
    """Smooth glass with Fresnel reflection; the interior is on the side away from the geometric normal."""

    int_ior: float = 1.5046
    ext_ior: float = 1.000277


Material = Diffuse | Refraction | Dielectric


@dataclass(frozen=True, kw_only=True)
class Shape:
    """Fields that every shape has. `material` None: a black body (an emitter needs no material)."""

    name: str  # its JSON path, for messages
    material: int | None = None
    radiance: Vec3 | None = None  # emitted by the front side; None: not a light


@dataclass(frozen=True, kw_only=True)
class Mesh(Shape):
    """Triangles in world space. The front side is where (v1 − v0) × (v2 − v0) points."""

    vertices: NDArray[np.float64]  # (n, 3)
    triangles: NDArray[np.int32]  # (m, 3)
    uvs: NDArray[np.float32] | None = None  # (m, 3, 2), per corner; None: (0,0), (1,0), (1,1)
    normals: NDArray[np.float32] | None = None  # (m, 3, 3), per corner, unit; None: flat


@dataclass(frozen=True, kw_only=True)
class Rectangle(Shape):
    """Points center + (u − ½)·edge1 + (v − ½)·edge2; the front side is where edge1 × edge2 points."""

    center: Vec3
    edge1: Vec3
    edge2: Vec3


@dataclass(frozen=True, kw_only=True)
class Sphere(Shape):
    """The front side is outside. (u, v): longitude around +y from +x towards +z, and angle from +y, both in [0, 1]."""

    center: Vec3
    radius: float


@dataclass(frozen=True)
class PointLight:
    """Isotropic; `flux` in watts per channel, so the intensity is flux / 4π."""

    position: Vec3
    flux: Vec3


@dataclass(frozen=True)
class SpotLight:
    """A point that shines along `direction`, a unit vector: `intensity` watts per steradian and channel up to the angle
    `inner` from it, in degrees, nothing from `outer` on, and ((cos θ − cos outer) / (cos inner − cos outer))² of it
    between."""

    position: Vec3
    direction: Vec3
    intensity: Vec3
    inner: float
    outer: float


Light = PointLight | SpotLight


@dataclass(frozen=True)
class Scene:
    """A complete scene. `spp` and `max_depth` are the file's defaults for rendering."""

    film: Film = Film()
    camera: Camera = Camera()
    textures: tuple[Texture, ...] = ()
    materials: tuple[Material, ...] = ()
    shapes: tuple[Shape, ...] = ()
    lights: tuple[Light, ...] = ()
    spp: int = 32
    max_depth: int = 16
    name: str = "scene"
    warnings: tuple[str, ...] = field(default=())  # what was dropped or replaced while loading, one sentence each
