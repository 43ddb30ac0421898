"""The JSON scene format as pydantic models: what validates a scene, and what `pyrt schema` publishes.

What spans several entries or files (names, meshes, images) is checked by `scene_io`. Where the default is null, a null
in the file is the same as leaving the key out.
"""

from __future__ import annotations

from typing import Annotated, Any, Literal

from pydantic import BeforeValidator, ConfigDict, Field, model_validator

from pyrt.schema_camera import Camera
from pyrt.schema_types import (
    Depth,
    Flag,
    Fraction,
    Matrix,
    Model,
    Name,
    Number,
    Positive,
    Power,
    Reflectance,
    Resolution,
    Samples,
    Vec2,
    Vec3,
    expect,
    sentence,
    sine,
)


class Integrator(Model):
    """How light is computed, how many samples a pixel gets, and a point light beside those of `lights`."""

    type: Annotated[Literal["intersection_test", "direct"], expect('"intersection_test" or its alias "direct"')] = (
        Field("intersection_test", description="Direct light through perfect refraction; `direct` is an alias.")
    )
    point_light_position: Vec3 | None = Field(
        None, description="Position of the point light; (0, 5, 0) where only the flux is given."
    )
    point_light_flux: Power | None = Field(
        None,
        description="Its flux in watts; (1, 1, 1) where only the position is given. "
        "A scene that gives neither has this light at its defaults if it has no other light.",
    )
    max_depth: Depth = Field(16, description="Refractions or reflections that a ray may follow before it is dropped.")
    spp: Samples = Field(32, description="Samples per pixel.")


class Filter(Model):
    """The reconstruction filter. pyrt averages the samples of a pixel, so the radius has no effect."""

    type: Annotated[Literal["box"], expect('"box"')] = Field("box", description="The only filter.")
    radius: Positive = Field(0.5, description="Read and not used.")


class Film(Model):
    """The size of the picture and how samples make its pixels."""

    resolution: Resolution = Field((512, 512), description="Width and height in pixels.")
    filter: Filter = Field(Filter(), description="The reconstruction filter.")


class UvMapping(Model):
    """Texture coordinates from surface parameters: st = scale · uv + delta."""

    type: Annotated[Literal["uvmapping2d"], expect('"uvmapping2d"')] = Field("uvmapping2d", description="The only one.")
    scale: Vec2 = Field((1.0, 1.0), description="Repetitions over the unit square.")
    delta: Vec2 = Field((0.0, 0.0), description="Offset.")


class ConstantTexture(Model):
    """One colour."""

    type: Literal["constant"]
    color: Reflectance = Field(description="Linear Rec.709.")


class ImageTexture(Model):
    """An image, bilinear, wrapped by repetition; (0, 0) is its upper-left corner."""

    type: Literal["image"]
    path: Name = Field(description="Image file, relative to the scene file.")
    colorspace: Annotated[Literal["srgb", "linear"], expect('"srgb" or "linear"')] | None = Field(
        None, description="Overrides what the file says: integer formats are taken as sRGB, EXR and HDR as linear."
    )
    tex_coordinate_generator: UvMapping = Field(UvMapping(), description="Texture coordinates.")


class CheckerboardTexture(Model):
    """color0 where floor(2s) + floor(2t) is even, else color1."""

    type: Literal["checkerboard"]
    color0: Reflectance = Field((0.4, 0.4, 0.4), description="Linear Rec.709.")
    color1: Reflectance = Field((0.2, 0.2, 0.2), description="Linear Rec.709.")
    tex_coordinate_generator: UvMapping = Field(UvMapping(), description="Texture coordinates.")


class Diffuse(Model):
    """Lambertian reflection; exactly one of `texture_name` and `color`."""

    type: Literal["diffuse"]
    texture_name: Name | None = Field(None, description="The reflectance: a name in `textures`.")
    color: Reflectance | None = Field(None, description="The reflectance as one linear colour.")
    twosided: Flag = Field(True, description="Whether the back reflects too; it is black otherwise.")

    @model_validator(mode="after")
    def _check_reflectance(self) -> Diffuse:
        if (self.texture_name is None) == (self.color is None):
            found = "neither" if self.color is None else "both; null takes one away"
            raise sentence(f'expected either "texture_name" or "color", found {found}')
        return self


class Refraction(Model):
    """Refraction without reflection; total internal reflection mirrors."""

    type: Literal["refraction"]
    eta: Positive = Field(description="sinθ_t / sinθ_i on entering through the front side; 1/eta on leaving.")


class Dielectric(Model):
    """Smooth glass with Fresnel reflection."""

    type: Literal["dielectric"]
    int_ior: Positive = Field(1.5046, description="Index of refraction behind the surface.")
    ext_ior: Positive = Field(1.000277, description="Index of refraction in front of the surface.")


class AreaLight(Model):
    """Makes an object emit from its front side."""

    type: Annotated[Literal["area"], expect('"area"')] = Field("area", description="The only kind.")
    radiance: Power = Field(description="Emitted radiance, linear Rec.709, in watts per steradian and unit of area.")


class PointLight(Model):
    """An isotropic point light."""

    model_config = ConfigDict(json_schema_extra=lambda schema: schema["required"].remove("type"))  # see _with_type

    type: Literal["point"]
    position: Vec3 = Field(description="Where it is.")
    flux: Power = Field(description="Emitted power in watts per channel.")


class SpotLight(Model):
    """A point light that shines in a cone, and fades at its rim with the square of the angle's cosine."""

    type: Literal["spot"]
    position: Vec3 = Field(description="Where it is.")
    look_at: Vec3 = Field(description="What it points at.")
    intensity: Power = Field(description="Watts per steradian and channel within the inner angle.")
    inner_angle: Annotated[Number, Field(ge=0, lt=90), expect("an angle in degrees >= 0 and < 90")] = Field(
        0.0, description="From the axis, in degrees, where it begins to fade."
    )
    outer_angle: Annotated[Number, Field(gt=0, le=90), expect("an angle in degrees > 0 and <= 90")] = Field(
        45.0, description="From the axis, in degrees, where nothing is left; more than `inner_angle`."
    )

    @model_validator(mode="after")
    def _check_cone(self) -> SpotLight:
        if self.position == self.look_at:
            raise sentence(f"expected a look_at away from the position, got {list(self.look_at)} for both")
        if self.inner_angle >= self.outer_angle:
            raise sentence(f"expected inner_angle < outer_angle, got {self.inner_angle:g} and {self.outer_angle:g}")
        return self


class Object(Model):
    """What all objects have; at least one of `material_name` and `light`."""

    material_name: Name | None = Field(None, description="A name in `materials`; without one, a black body.")
    light: AreaLight | None = Field(None, description="Makes the object an area light.")

    @model_validator(mode="after")
    def _check_visible(self) -> Object:
        if self.material_name is None and self.light is None:
            raise sentence('expected "material_name", "light" or both, found neither')
        return self


class Mesh(Object):
    """Triangles from a file: OBJ, PLY, STL, OFF, GLB or glTF."""

    type: Literal["mesh"]
    path: Name = Field(description="Mesh file, relative to the scene file.")
    transform: Matrix | None = Field(
        None, description="Invertible affine 4×4 matrix, row-major, applied to column vectors."
    )
    translate: Vec3 = Field((0.0, 0.0, 0.0), description="Added after the transform.")


class Sphere(Object):
    """An exact sphere; its front side is outside."""

    type: Literal["sphere"]
    center: Vec3 = Field(description="Centre.")
    radius: Positive = Field(description="Radius.")


class Rectangle(Object):
    """The points center + (u − ½)·edge1 + (v − ½)·edge2; the front side is where edge1 × edge2 points."""

    type: Literal["rectangle"]
    center: Vec3 = Field(description="Centre.")
    edge1: Vec3 = Field(description="Full side vector.")
    edge2: Vec3 = Field(description="Full side vector, not parallel to edge1.")

    @model_validator(mode="after")
    def _check_area(self) -> Rectangle:
        if sine(self.edge1, self.edge2) < 1e-12:
            raise sentence(f"edge1 {list(self.edge1)} and edge2 {list(self.edge2)} span no area")
        return self


class Displacement(Model):
    """Smooth noise that moves an icosphere's vertices along the radius."""

    amplitude: Fraction = Field(description="Bound of the displacement, as a fraction of the radius.")
    frequency: Positive = Field(2.0, description="Waves of the coarsest octave per radius.")
    octaves: Annotated[int, Field(strict=True, ge=1, le=16), expect("an integer from 1 to 16")] = Field(
        4, description="Each octave has double the frequency and half the amplitude of the one before."
    )
    seed: Annotated[int, Field(strict=True, ge=0, lt=2**32), expect("an integer from 0 to 2^32 - 1")] = Field(
        0, description="Another seed gives another shape."
    )


class Icosphere(Object):
    """A closed mesh of 20·4^subdivisions triangles, made at load time; its front side is outside."""

    type: Literal["icosphere"]
    center: Vec3 = Field((0.0, 0.0, 0.0), description="Centre.")
    radius: Positive = Field(1.0, description="Radius before displacement.")
    subdivisions: Annotated[int, Field(strict=True, ge=0, le=9), expect("an integer from 0 to 9")] = Field(
        4, description="7 gives 327,680 triangles."
    )
    displacement: Displacement | None = Field(None, description="Noise along the radius.")
    smooth: Flag = Field(True, description="Whether shading normals are interpolated.")


TextureModel = ConstantTexture | ImageTexture | CheckerboardTexture
MaterialModel = Diffuse | Refraction | Dielectric
LightModel = PointLight | SpotLight
ObjectModel = Mesh | Sphere | Rectangle | Icosphere


def _with_type(light: Any) -> Any:
    """A light without a type is a point."""
    return {"type": "point", **light} if isinstance(light, dict) else light


class SceneModel(Model):
    """A scene for pyrt: right-handed, +y up; lengths in any unit; colours linear Rec.709; paths relative to it."""

    integrator: Integrator = Field(Integrator(), description="How light is computed.")
    film: Film = Field(Film(), description="The picture.")
    camera: Camera = Field(Camera(), description="The camera.")
    textures: dict[str, Annotated[TextureModel, Field(discriminator="type")]] = Field({}, description="By name.")
    materials: dict[str, Annotated[MaterialModel, Field(discriminator="type")]] = Field({}, description="By name.")
    lights: list[Annotated[LightModel, Field(discriminator="type"), BeforeValidator(_with_type)]] = Field(
        [], description="Points and spots, beside the point light of the integrator; without a `type`, a point."
    )
    objects: list[Annotated[ObjectModel, Field(discriminator="type")]] = Field(
        description="What is in the scene, at least one object.", json_schema_extra={"minItems": 1}
    )


def json_schema() -> dict[str, Any]:
    """The JSON Schema (draft 2020-12) of a scene file, generated from the models that validate it."""
    return {"$schema": "https://json-schema.org/draft/2020-12/schema", **SceneModel.model_json_schema()}
