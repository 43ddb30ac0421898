"""Scene file or dict → Scene: validates everything, reads the files that the scene needs, reports all problems at once.

Only what an object uses becomes part of the scene: unused materials and textures are checked and left out, and the
images of unused textures are not read.
"""

from __future__ import annotations

import os
from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from pyrt import scene, schema
from pyrt.errors import SceneError, UsageError
from pyrt.files import check_file
from pyrt.geometry import unit
from pyrt.image_io import read_texture
from pyrt.loading import Loading, uncollected
from pyrt.model import Model
from pyrt.model_io import is_model, load_model
from pyrt.scene_camera import camera_faults, camera_from
from pyrt.scene_json import override, plain, read_json
from pyrt.scene_objects import read_shapes
from pyrt.schema_errors import json_path, quote, suggestion, validate
from pyrt.settings import pair
from pyrt.studio import completed

Source = str | os.PathLike[str] | Mapping[str, Any] | Model

_EXAMPLE = "example:"
_BLACK = np.zeros((1, 1, 3), np.float32)


@uncollected()
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
    film_size = (0, 0) if size is None else pair("size", size)
    raw, loading, name = _open(source, base_dir)
    for path, value in (overrides or {}).items():
        try:
            override(raw, path, value)
        except SceneError as error:
            loading.problems += [f"{loading.place}: {problem}" for problem in error.problems]
    model, problems = validate(raw)
    loading.problems += [f"{loading.place}: {problem}" for problem in problems]
    result = _scene(loading, raw, model, name)
    if loading.model is not None and not loading.problems and any(model.camera.ref_up):
        film = scene.Film(*film_size) if min(film_size) > 0 else result.film
        has_camera = "position" in loading.model.raw["camera"] or "matrix" in loading.model.raw["camera"]
        lit = _has_lights(model, result.shapes)
        result = completed(replace(result, film=film), model.camera.model_fields_set, has_camera, lit)
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


def _open(source: Source, base_dir: str | os.PathLike[str] | None) -> tuple[dict[str, Any], Loading, str]:
    if isinstance(source, Model):
        return plain(source.raw), _loading("model", Path(), source), "model"
    if isinstance(source, Mapping):
        try:
            return plain(source), Loading("scene", Path(base_dir or ".")), "scene"
        except SceneError as error:
            raise SceneError(f"scene: {error}") from None
    if not isinstance(source, (str, os.PathLike)):
        raise UsageError(f"scene: expected a file name or a dict, got {type(source).__name__}")
    place = os.fspath(source)
    path = example_path(place.removeprefix(_EXAMPLE)) if place.startswith(_EXAMPLE) else Path(place)
    if is_model(path):
        opened = load_model(path)
        return plain(opened.raw), _loading(place, path.parent, opened), path.stem
    return read_json(path), Loading(place, Path(base_dir or path.parent)), path.stem


def _loading(place: str, folder: Path, model: Model) -> Loading:
    return Loading(place, folder, model, warnings=[f"{place}: {warning}" for warning in model.warnings])


def _scene(loading: Loading, raw: dict[str, Any], model: schema.SceneModel, name: str) -> scene.Scene:
    """The scene, as far as it has no problems. Empties the list of objects in `raw`."""
    objects = raw["objects"] if isinstance(raw.get("objects"), list) else []
    if raw.get("objects") == []:
        loading.problem("objects", "expected at least one object, got []")
    for key, material in model.materials.items():
        if isinstance(material, schema.Diffuse):
            path = json_path(("materials", key, "texture_name"))
            loading.check_name(path, "texture", material.texture_name, raw.get("textures", {}))
    given = (entry.get("material_name") for entry in objects if isinstance(entry, dict))
    used = {of for of in given if isinstance(of, str)}
    materials = {key: material for key, material in model.materials.items() if key in used}
    textures = _textures(loading, model, materials)
    places = {path: i for i, path in enumerate(textures)}
    shapes = tuple(read_shapes(loading, objects, raw.get("materials", {}), {key: i for i, key in enumerate(materials)}))
    film = scene.Film(*model.film.resolution)
    return scene.Scene(
        film=film,
        camera=camera_from(model.camera, film),
        textures=tuple(textures.values()),
        materials=tuple(_material(key, material, places) for key, material in materials.items()),
        shapes=shapes,
        lights=_lights(model, shapes),
        spp=model.integrator.spp,
        max_depth=model.integrator.max_depth,
        name=name,
        warnings=tuple(loading.warnings),
    )


def _texture_path(key: str, material: schema.Diffuse) -> str:
    """Where the file defines a material's reflectance."""
    if material.texture_name is None:
        return json_path(("materials", key, "color"))
    return json_path(("textures", material.texture_name))


def _textures(
    loading: Loading, model: schema.SceneModel, materials: Mapping[str, schema.MaterialModel]
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
        elif isinstance(texture, schema.ImageTexture) and not loading.has_image(texture.path):
            loading.read(f"{path}.path", check_file, texture.path)
    return textures


def _texture(loading: Loading, path: str, texture: schema.TextureModel) -> scene.Texture:
    if isinstance(texture, schema.ConstantTexture):
        return scene.ConstantTexture(texture.color)
    mapping = (texture.tex_coordinate_generator.scale, texture.tex_coordinate_generator.delta)
    if isinstance(texture, schema.CheckerboardTexture):
        return scene.CheckerboardTexture(texture.color0, texture.color1, *mapping)
    if loading.model is not None and loading.has_image(texture.path):
        return scene.ImageTexture(loading.model.images[texture.path].pixels, *mapping)
    image = loading.read(f"{path}.path", read_texture, texture.path, texture.colorspace)
    return scene.ImageTexture(_BLACK if image is None else _reflectance(loading, path, image.pixels), *mapping)


def _reflectance(loading: Loading, path: str, pixels: NDArray[np.float32]) -> NDArray[np.float32]:
    """Clamps to [0, 1], with a warning: a surface cannot reflect more light than arrives."""
    if pixels.min() >= 0 and pixels.max() <= 1:
        return pixels
    outside = int(np.sum(((pixels < 0) | (pixels > 1)).any(axis=2)))
    values = f"from {pixels.min():g} to {pixels.max():g}"
    loading.warn(path, f"{outside} pixels have reflectances outside 0 to 1 ({values}) and are clamped")
    return np.clip(pixels, 0, 1)


def _material(key: str, material: schema.MaterialModel, textures: Mapping[str, int]) -> scene.Material:
    if isinstance(material, schema.Refraction):
        return scene.Refraction(material.eta)
    if isinstance(material, schema.Dielectric):
        return scene.Dielectric(material.int_ior, material.ext_ior)
    # an unknown texture is a problem that has been reported
    return scene.Diffuse(textures.get(_texture_path(key, material), -1), material.twosided)


def _lights(model: schema.SceneModel, shapes: Sequence[scene.Shape]) -> tuple[scene.Light, ...]:
    """The integrator's point light, if it says anything about one or there is no other light, and then the rest."""
    lights = tuple(_light(light) for light in model.lights)
    position, flux = model.integrator.point_light_position, model.integrator.point_light_flux
    if position is None and flux is None and _has_lights(model, shapes):
        return lights
    return (scene.PointLight(position or (0.0, 5.0, 0.0), flux or (1.0, 1.0, 1.0)), *lights)


def _light(light: schema.LightModel) -> scene.Light:
    if isinstance(light, schema.PointLight):
        return scene.PointLight(light.position, light.flux)
    x, y, z = unit(np.subtract(light.look_at, light.position)).tolist()
    return scene.SpotLight(light.position, (x, y, z), light.intensity, light.inner_angle, light.outer_angle)


def _has_lights(model: schema.SceneModel, shapes: Sequence[scene.Shape]) -> bool:
    given = (model.integrator.point_light_position, model.integrator.point_light_flux)
    areas = any(shape.radiance is not None for shape in shapes)
    return bool(model.lights or areas or any(of is not None for of in given))
