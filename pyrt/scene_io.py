"""Scene file or dict → Scene: validates everything, reads the files that the scene needs, reports all problems at once.

Only what an object uses becomes part of the scene: unused materials and textures are checked and left out, and the
images of unused textures are not read.
"""

from __future__ import annotations

import os
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any, TypeVar

import numpy as np
from numpy.typing import NDArray

from pyrt import procedural, scene, schema
from pyrt.errors import PyrtError, SceneError, UsageError
from pyrt.files import check_file
from pyrt.geometry import COORDINATE_LIMIT, valid_triangles
from pyrt.image_io import read_texture
from pyrt.mesh_data import MeshData, transformed
from pyrt.mesh_io import load_mesh
from pyrt.model import Model
from pyrt.model_io import is_model, load_model
from pyrt.room import available
from pyrt.scene_camera import camera_faults, camera_from
from pyrt.scene_json import override, plain, read_json
from pyrt.schema_errors import json_path, quote, suggestion, validate
from pyrt.studio import completed

Source = str | os.PathLike[str] | Mapping[str, Any] | Model
T = TypeVar("T")

_EXAMPLE = "example:"
_TRIANGLE = 100  # bytes of one in a scene; building its tree takes more, see `memory`
_BLACK = np.zeros((1, 1, 3), np.float32)


@dataclass
class _Loading:
    """What one call of load_scene collects."""

    place: str
    folder: Path
    model: Model | None = None  # whose meshes and images stand for files
    problems: list[str] = field(default_factory=list)
    warnings: list[str] = field(default_factory=list)
    files: dict[tuple[Any, ...], Any] = field(default_factory=dict)  # read files, or None for unreadable ones
    room: float = field(default_factory=lambda: available() / _TRIANGLE)  # for so many triangles

    def take(self, path: str, triangles: int) -> None:
        """Raises PyrtError unless there is memory for the object at `path`, too."""
        if triangles > self.room:
            found = f"{triangles:,} triangles, memory has room for {int(self.room):,} more"
            raise PyrtError(f"{self.place}: {path}: {found}")
        self.room -= triangles

    def problem(self, path: str, text: str) -> None:
        self.problems.append(f"{self.place}: {path}: {text}")

    def warn(self, path: str, text: str) -> None:
        self.warnings.append(f"{self.place}: {path}: {text}")

    def read(self, path: str, reader: Callable[..., T], name: str, *options: Any) -> T | None:
        """reader(file, *options), once per file; None, and a problem at `path`, if it fails."""
        file = os.path.normpath(self.folder / name)
        key = (reader, file, *options)
        if key not in self.files:
            try:
                self.files[key] = reader(file, *options)
            except SceneError as error:
                self.files[key] = None
                for problem in error.problems:
                    self.problem(path, problem)
            else:
                for warning in getattr(self.files[key], "warnings", ()):
                    self.warn(path, warning)
        result: T | None = self.files[key]
        return result


def load_scene(
    source: Source,
    *,
    base_dir: str | os.PathLike[str] | None = None,
    overrides: Mapping[str, Any] | None = None,
    size: tuple[int, int] | None = None,
) -> scene.Scene:
    """Loads a scene.

    Args:
        source: a scene file; a model file (GLB, glTF, OBJ, PLY, STL or OFF), which gets a camera, a floor and lamps as
            far as it has none; `example:NAME` for a scene that comes with pyrt; or the content of a scene file as a
            dict, which may hold tuples, paths and numpy arrays.
        base_dir: the folder that asset paths are relative to; by default the scene file's, or for a dict the current
            one.
        overrides: values by dotted path, such as {"camera.fov": 40, "objects.0.translate": [0, 1, 0]}, set before
            validation.
        size: width and height of the picture that a model is framed for; None: the film's resolution.

    Raises:
        SceneError: with one sentence per problem, each starting with the file and the JSON path.
    """
    raw, loading, name = _open(source, base_dir)
    for path, value in (overrides or {}).items():
        try:
            override(raw, path, value)
        except SceneError as error:
            loading.problems += [f"{loading.place}: {problem}" for problem in error.problems]
    model, indices, problems = validate(raw)
    loading.problems += [f"{loading.place}: {problem}" for problem in problems]
    result = _scene(loading, raw, model, indices, name)
    if loading.model is not None and not loading.problems and any(model.camera.ref_up):
        film = scene.Film(*size) if size is not None and min(size) > 0 else result.film
        has_camera = "position" in loading.model.raw["camera"] or "matrix" in loading.model.raw["camera"]
        result = completed(replace(result, film=film), model.camera.model_fields_set, has_camera, _has_lights(model))
    loading.problems += [f"{loading.place}: camera.{key}: {fault}" for key, fault in camera_faults(result.camera)]
    if loading.problems:
        raise SceneError(loading.problems)
    return result


def example_path(name: str) -> Path:
    """The file of an example scene that comes with pyrt, installed or in a checkout. Raises SceneError otherwise."""
    package = Path(__file__).parent
    folder = next((f for f in (package / "scenes", package.parent / "scenes") if f.is_dir()), package / "scenes")
    path = folder / f"{name}.json"
    if not os.path.isfile(path):  # unlike Path.is_file, no error for a name that is too long
        names = sorted(file.stem for file in folder.glob("*.json"))
        raise SceneError(f"{_EXAMPLE}{name}: no example scene {quote(name)}{suggestion(name, names)}")
    return path


def _open(source: Source, base_dir: str | os.PathLike[str] | None) -> tuple[dict[str, Any], _Loading, str]:
    if isinstance(source, Model):
        return plain(source.raw), _loading("model", Path(), source), "model"
    if isinstance(source, Mapping):
        try:
            return plain(source), _Loading("scene", Path(base_dir or ".")), "scene"
        except SceneError as error:
            raise SceneError(f"scene: {error}") from None
    if not isinstance(source, (str, os.PathLike)):
        raise UsageError(f"scene: expected a file name or a dict, got {type(source).__name__}")
    place = os.fspath(source)
    path = example_path(place.removeprefix(_EXAMPLE)) if place.startswith(_EXAMPLE) else Path(place)
    if is_model(path):
        opened = load_model(path)
        return plain(opened.raw), _loading(place, path.parent, opened), path.stem
    return read_json(path), _Loading(place, Path(base_dir or path.parent)), path.stem


def _loading(place: str, folder: Path, model: Model) -> _Loading:
    return _Loading(place, folder, model, warnings=[f"{place}: {warning}" for warning in model.warnings])


def _scene(
    loading: _Loading, raw: dict[str, Any], model: schema.SceneModel, indices: list[int], name: str
) -> scene.Scene:
    """The scene, as far as it has no problems. `indices` are those of the model's objects in `raw`."""
    if raw.get("objects") == []:
        loading.problem("objects", "expected at least one object, got []")
    objects = {json_path(("objects", i)): o for i, o in zip(indices, model.objects, strict=True)}
    for path, shape in objects.items():
        _check_name(loading, f"{path}.material_name", "material", shape.material_name, raw.get("materials", {}))
    for key, material in model.materials.items():
        if isinstance(material, schema.Diffuse):
            path = json_path(("materials", key, "texture_name"))
            _check_name(loading, path, "texture", material.texture_name, raw.get("textures", {}))
    used = {shape.material_name for shape in objects.values()}
    materials = {key: material for key, material in model.materials.items() if key in used}
    textures = _textures(loading, model, materials)
    for path, shape in objects.items():
        if isinstance(shape, schema.Icosphere):
            loading.take(path, 20 * 4**shape.subdivisions)
    shapes = [_shape(loading, path, shape, list(materials)) for path, shape in objects.items()]
    film = scene.Film(*model.film.resolution)
    return scene.Scene(
        film=film,
        camera=camera_from(model.camera, film),
        textures=tuple(textures.values()),
        materials=tuple(_material(key, material, list(textures)) for key, material in materials.items()),
        shapes=tuple(shape for shape in shapes if shape is not None),
        lights=_point_lights(model),
        spp=model.integrator.spp,
        max_depth=model.integrator.max_depth,
        name=name,
        warnings=tuple(loading.warnings),
    )


def _check_name(loading: _Loading, path: str, kind: str, name: str | None, entries: Any) -> None:
    """Looks the name up in the file's entries, valid or not, so that a broken one is not reported as missing too."""
    if name is not None and isinstance(entries, dict) and name not in entries:
        loading.problem(path, f"no {kind} {quote(name)}{suggestion(name, entries)}")


def _texture_path(key: str, material: schema.Diffuse) -> str:
    """Where the file defines a material's reflectance."""
    if material.texture_name is None:
        return json_path(("materials", key, "color"))
    return json_path(("textures", material.texture_name))


def _textures(
    loading: _Loading, model: schema.SceneModel, materials: Mapping[str, schema.MaterialModel]
) -> dict[str, scene.Texture]:
    """The textures of the used materials by their JSON path. Of the other ones only the image files are looked for."""
    diffuse = {key: material for key, material in materials.items() if isinstance(material, schema.Diffuse)}
    used = {_texture_path(key, material): material.color for key, material in diffuse.items()}
    textures: dict[str, scene.Texture] = {
        path: scene.ConstantTexture(color) for path, color in used.items() if color is not None
    }
    for key, texture in model.textures.items():
        path = json_path(("textures", key))
        if path in used:
            textures[path] = _texture(loading, path, texture)
        elif isinstance(texture, schema.ImageTexture):
            loading.read(f"{path}.path", check_file, texture.path)
    return textures


def _texture(loading: _Loading, path: str, texture: schema.TextureModel) -> scene.Texture:
    if isinstance(texture, schema.ConstantTexture):
        return scene.ConstantTexture(texture.color)
    mapping = (texture.tex_coordinate_generator.scale, texture.tex_coordinate_generator.delta)
    if isinstance(texture, schema.CheckerboardTexture):
        return scene.CheckerboardTexture(texture.color0, texture.color1, *mapping)
    if loading.model is not None and texture.path in loading.model.images:
        return scene.ImageTexture(loading.model.images[texture.path].pixels, *mapping)
    image = loading.read(f"{path}.path", read_texture, texture.path, texture.colorspace)
    return scene.ImageTexture(_BLACK if image is None else _reflectance(loading, path, image.pixels), *mapping)


def _reflectance(loading: _Loading, path: str, pixels: NDArray[np.float32]) -> NDArray[np.float32]:
    """Clamps to [0, 1], with a warning: a surface cannot reflect more light than arrives."""
    outside = int(np.sum(((pixels < 0) | (pixels > 1)).any(axis=2)))
    if not outside:
        return pixels
    values = f"from {pixels.min():g} to {pixels.max():g}"
    loading.warn(path, f"{outside} pixels have reflectances outside 0 to 1 ({values}) and are clamped")
    return np.clip(pixels, 0, 1)


def _material(key: str, material: schema.MaterialModel, textures: list[str]) -> scene.Material:
    if isinstance(material, schema.Refraction):
        return scene.Refraction(material.eta)
    if isinstance(material, schema.Dielectric):
        return scene.Dielectric(material.int_ior, material.ext_ior)
    return scene.Diffuse(_index(textures, _texture_path(key, material)), material.twosided)


def _shape(loading: _Loading, path: str, shape: schema.ObjectModel, materials: list[str]) -> scene.Shape | None:
    common: dict[str, Any] = {
        "name": path,
        "material": None if shape.material_name is None else _index(materials, shape.material_name),
        "radiance": None if shape.light is None else shape.light.radiance,
    }
    if isinstance(shape, schema.Sphere):
        return scene.Sphere(center=shape.center, radius=shape.radius, **common)
    if isinstance(shape, schema.Rectangle):
        return scene.Rectangle(center=shape.center, edge1=shape.edge1, edge2=shape.edge2, **common)
    mesh = _icosphere(shape) if isinstance(shape, schema.Icosphere) else _mesh(loading, path, shape)
    if mesh is None:
        return None
    return scene.Mesh(vertices=mesh.vertices, triangles=mesh.triangles, uvs=mesh.uvs, normals=mesh.normals, **common)


def _index(names: list[str], name: str) -> int:
    """Where the name is; -1 for an unknown one, which is a problem that has been reported."""
    return names.index(name) if name in names else -1


def _mesh(loading: _Loading, path: str, shape: schema.Mesh) -> MeshData | None:
    mesh = loading.model.meshes.get(shape.path) if loading.model is not None else None
    mesh = mesh or loading.read(f"{path}.path", load_mesh, shape.path)
    if mesh is None:
        return None
    loading.take(path, len(mesh.triangles))
    with np.errstate(over="ignore", invalid="ignore"):
        if shape.transform is not None:
            mesh = transformed(mesh, np.reshape(shape.transform, (4, 4)))
        mesh = mesh._replace(vertices=mesh.vertices + shape.translate)
    if not valid_triangles(mesh.vertices[mesh.triangles]).any():
        found = f"none of the {len(mesh.triangles)} triangles of {quote(shape.path)} has an area"
        loading.problem(f"{path}.path", f"{found} and all its coordinates below {COORDINATE_LIMIT:g}")
    return mesh


def _icosphere(shape: schema.Icosphere) -> MeshData:
    vertices, triangles = procedural.icosphere(shape.subdivisions)
    if shape.displacement is not None:
        d = shape.displacement
        vertices = vertices * (1 + d.amplitude * procedural.noise(vertices, d.frequency, d.octaves, d.seed)[:, None])
    normals = procedural.vertex_normals(vertices, triangles).astype(np.float32)[triangles] if shape.smooth else None
    return MeshData(vertices * shape.radius + shape.center, triangles, normals=normals)


def _point_lights(model: schema.SceneModel) -> tuple[scene.PointLight, ...]:
    """The integrator's point light, if it says anything about one or there is no other light, and then the rest."""
    lights = tuple(scene.PointLight(light.position, light.flux) for light in model.lights)
    position, flux = model.integrator.point_light_position, model.integrator.point_light_flux
    if position is None and flux is None and _has_lights(model):
        return lights
    return (scene.PointLight(position or (0.0, 5.0, 0.0), flux or (1.0, 1.0, 1.0)), *lights)


def _has_lights(model: schema.SceneModel) -> bool:
    given = (model.integrator.point_light_position, model.integrator.point_light_flux)
    return bool(model.lights or any(shape.light for shape in model.objects) or any(of is not None for of in given))
