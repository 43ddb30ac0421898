"""The parts of glTF 2.0 that pyrt reads, as pydantic models: what validates the JSON of a file.

Names and meanings are the specification's (Khronos Group, glTF 2.0, 2021); other keys are left alone.
"""

# ruff: noqa: N815

from __future__ import annotations

import json
import math
from typing import Annotated, Any, Literal

from pydantic import BaseModel, ConfigDict, Field, ValidationError

from pyrt.errors import SceneError
from pyrt.schema_errors import json_path, quote
from pyrt.schema_types import Flag, Number, Power, Reflectance, Vec2, Vec3, expect

_TYPES = dict.fromkeys(("model_type", "model_attributes_type", "dict_type"), "an object") | {"list_type": "an array"}
_MAX_PROBLEMS = 10

Index = Annotated[int, Field(strict=True, ge=0, lt=2**31), expect("an index, an integer >= 0")]
Size = Annotated[int, Field(strict=True, ge=0, lt=2**53), expect("an integer >= 0")]
Count = Annotated[int, Field(strict=True, ge=1, lt=2**53), expect("an integer >= 1")]
Stride = Annotated[int, Field(strict=True, ge=1, le=1024), expect("an integer from 1 to 1024")]
Text = Annotated[str, Field(strict=True), expect("a string")]
Factor = Annotated[Number, Field(ge=0, le=1), expect("a number from 0 to 1")]
Strength = Annotated[Number, Field(ge=0), expect("a number >= 0")]
Rgba = Annotated[tuple[Factor, Factor, Factor, Factor], expect("4 numbers from 0 to 1")]
Quaternion = Annotated[tuple[Number, Number, Number, Number], expect("4 numbers")]
Matrix = Annotated[tuple[Number, ...], Field(min_length=16, max_length=16), expect("16 numbers")]
ComponentType = Annotated[
    Literal[5120, 5121, 5122, 5123, 5125, 5126], expect("a component type: 5120, 5121, 5122, 5123, 5125 or 5126")
]
AccessorType = Annotated[
    Literal["SCALAR", "VEC2", "VEC3", "VEC4", "MAT2", "MAT3", "MAT4"], expect('a type such as "VEC3"')
]
Wrap = Annotated[Literal[10497, 33071, 33648], expect("a wrapping mode: 10497, 33071 or 33648")]


class Part(BaseModel):
    """Base of all models."""

    model_config = ConfigDict(extra="ignore", frozen=True)


class Asset(Part):
    version: Text


class Buffer(Part):
    byteLength: Count
    uri: Text | None = None


class BufferView(Part):
    buffer: Index
    byteLength: Count
    byteOffset: Size = 0
    byteStride: Stride | None = None


class SparseIndices(Part):
    bufferView: Index
    componentType: ComponentType
    byteOffset: Size = 0


class SparseValues(Part):
    bufferView: Index
    byteOffset: Size = 0


class Sparse(Part):
    count: Count
    indices: SparseIndices
    values: SparseValues


class Accessor(Part):
    componentType: ComponentType
    count: Count
    type: AccessorType
    bufferView: Index | None = None
    byteOffset: Size = 0
    normalized: Flag = False
    sparse: Sparse | None = None


class Image(Part):
    uri: Text | None = None
    bufferView: Index | None = None


class Sampler(Part):
    wrapS: Wrap = 10497
    wrapT: Wrap = 10497
    magFilter: Index | None = None


class WebpTexture(Part):
    source: Index


class TextureExtensions(Part):
    EXT_texture_webp: WebpTexture | None = None


class Texture(Part):
    sampler: Index | None = None
    source: Index | None = None
    extensions: TextureExtensions = TextureExtensions()


class TextureTransform(Part):
    offset: Vec2 = (0.0, 0.0)
    rotation: Number = 0.0
    scale: Vec2 = (1.0, 1.0)
    texCoord: Index | None = None


class TextureInfoExtensions(Part):
    KHR_texture_transform: TextureTransform | None = None


class TextureInfo(Part):
    index: Index
    texCoord: Index = 0
    extensions: TextureInfoExtensions = TextureInfoExtensions()


class MetallicRoughness(Part):
    baseColorFactor: Rgba = (1.0, 1.0, 1.0, 1.0)
    baseColorTexture: TextureInfo | None = None
    metallicFactor: Factor | None = None
    metallicRoughnessTexture: Any = None


class Strengthened(Part):
    emissiveStrength: Strength = 1.0


class Transmission(Part):
    transmissionFactor: Factor = 0.0
    transmissionTexture: Any = None


class Ior(Part):
    ior: Strength = 1.5


class MaterialExtensions(Part):
    model_config = ConfigDict(extra="allow", frozen=True)

    KHR_materials_emissive_strength: Strengthened = Strengthened()
    KHR_materials_transmission: Transmission = Transmission()
    KHR_materials_ior: Ior = Ior()


class Material(Part):
    name: Text = ""
    pbrMetallicRoughness: MetallicRoughness = MetallicRoughness()
    emissiveFactor: Reflectance = (0.0, 0.0, 0.0)
    alphaMode: Text = "OPAQUE"
    normalTexture: Any = None
    emissiveTexture: Any = None
    extensions: MaterialExtensions = MaterialExtensions()


class Primitive(Part):
    attributes: dict[str, Index]
    indices: Index | None = None
    material: Index | None = None
    mode: Index = 4
    targets: list[Any] = []


class Mesh(Part):
    primitives: Annotated[list[Primitive], Field(min_length=1), expect("a list of primitives")]
    name: Text = ""


class LightReference(Part):
    light: Index


class Visibility(Part):
    visible: Flag = True


class NodeExtensions(Part):
    KHR_lights_punctual: LightReference | None = None
    KHR_node_visibility: Visibility = Visibility()
    EXT_mesh_gpu_instancing: Any = None


class Node(Part):
    name: Text = ""
    children: list[Index] = []
    mesh: Index | None = None
    camera: Index | None = None
    matrix: Matrix | None = None
    translation: Vec3 = (0.0, 0.0, 0.0)
    rotation: Quaternion = (0.0, 0.0, 0.0, 1.0)
    scale: Vec3 = (1.0, 1.0, 1.0)
    extensions: NodeExtensions = NodeExtensions()


class Scene(Part):
    nodes: list[Index] = []


class Perspective(Part):
    yfov: Annotated[Number, Field(gt=0, lt=3.14159), expect("an angle in radians between 0 and pi")]
    aspectRatio: Annotated[Number, Field(ge=0.001, le=1000), expect("a number from 0.001 to 1000")] | None = None


class Camera(Part):
    type: Text
    name: Text = ""
    perspective: Perspective | None = None


class Spot(Part):
    innerConeAngle: Annotated[Number, Field(ge=0, le=1.571), expect("an angle in radians from 0 to pi/2")] = 0.0
    outerConeAngle: Annotated[Number, Field(gt=0, le=1.571), expect("an angle in radians > 0 and <= pi/2")] = (
        math.pi / 4
    )


class Light(Part):
    type: Text
    name: Text = ""
    color: Power = (1.0, 1.0, 1.0)
    intensity: Strength = 1.0
    range: Any = None
    spot: Spot = Spot()


class Lights(Part):
    lights: list[Light] = []


class RootExtensions(Part):
    KHR_lights_punctual: Lights = Lights()


class Gltf(Part):
    asset: Asset
    scene: Index | None = None
    scenes: list[Scene] = []
    nodes: list[Node] = []
    meshes: list[Mesh] = []
    materials: list[Material] = []
    textures: list[Texture] = []
    samplers: list[Sampler] = []
    images: list[Image] = []
    accessors: list[Accessor] = []
    bufferViews: list[BufferView] = []
    buffers: list[Buffer] = []
    cameras: list[Camera] = []
    animations: list[Any] = []
    skins: list[Any] = []
    extensionsUsed: list[Text] = []
    extensionsRequired: list[Text] = []
    extensions: RootExtensions = RootExtensions()


def parse_gltf(text: bytes) -> Gltf:
    """The validated JSON of a file. Raises SceneError, each problem starting with its JSON path."""
    try:
        return Gltf.model_validate(json.loads(text))
    except ValidationError as error:
        raise SceneError([_sentence(e) for e in error.errors(include_url=False)[:_MAX_PROBLEMS]]) from None
    except (ValueError, RecursionError):
        raise SceneError("its JSON is damaged") from None


def _sentence(error: Any) -> str:
    location, kind = error["loc"], error["type"]
    if kind == "missing":
        return f"{json_path(location[:-1])}: missing key {quote(location[-1])}".removeprefix(": ")
    expected = _TYPES.get(kind, error["msg"])
    return f"{json_path(location)}: expected {expected}, got {quote(error['input'])}".removeprefix(": ")
