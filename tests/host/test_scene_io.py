"""Scene files and dicts become the scenes that they describe."""

from __future__ import annotations

import copy
import json
import os
import subprocess
import sys
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from pyrt import scene
from pyrt.errors import SceneError
from pyrt.image_io import srgb_to_linear, write_image
from pyrt.mesh_io import load_mesh
from pyrt.scene_io import example_path, load_scene
from pyrt.schema import SceneModel, json_schema

ROOT = Path(__file__).resolve().parents[2]

# the example of the assignment's format
ASSIGNMENT: dict[str, Any] = {
    "integrator": {
        "type": "intersection_test",
        "point_light_position": [0, 1.5, 0.5],
        "point_light_flux": [17, 12, 5],
        "max_depth": 8,
        "spp": 64,
    },
    "film": {"resolution": [320, 200], "filter": {"type": "box", "radius": 0.5}},
    "camera": {
        "position": [0, 1, 6.8],
        "look_at": [0, 1, 0],
        "ref_up": [0, 1, 0],
        "fov": 19.5,
        "focal_length": 1,
    },
    "textures": {
        "grey": {"type": "constant", "color": [0.725, 0.71, 0.68]},
        "wood": {
            "type": "image",
            "path": "../textures/wood.png",
            "tex_coordinate_generator": {"type": "uvmapping2d", "scale": [2, 3], "delta": [0.5, 0]},
        },
        "tiles": {
            "type": "checkerboard",
            "color0": [0.4, 0.4, 0.5],
            "color1": [0.2, 0.2, 0.3],
            "tex_coordinate_generator": {"type": "uvmapping2d", "scale": [4, 4]},
        },
    },
    "materials": {
        "grey_diffuse": {"type": "diffuse", "texture_name": "grey"},
        "wood_diffuse": {"type": "diffuse", "texture_name": "wood", "twosided": False},
        "tiles_diffuse": {"type": "diffuse", "texture_name": "tiles"},
        "bent": {"type": "refraction", "eta": 2.0},
        "glass": {"type": "dielectric"},
    },
    "objects": [
        {"type": "mesh", "path": "left.obj", "material_name": "grey_diffuse", "translate": [0, 0, 5]},
        {"type": "sphere", "center": [0, 0.6, 0.6], "radius": 0.5, "material_name": "bent"},
        {
            "type": "rectangle",
            "center": [0, 1.99, 0],
            "edge1": [0.4, 0, 0],
            "edge2": [0, 0, 0.4],
            "light": {"radiance": [80, 56, 23]},
        },
        {"type": "mesh", "path": "left.obj", "material_name": "wood_diffuse"},
        {"type": "mesh", "path": "left.obj", "material_name": "tiles_diffuse"},
        {"type": "sphere", "center": [3, 0.6, 0.6], "radius": 0.5, "material_name": "glass"},
    ],
}
SPHERE = {"type": "sphere", "center": [0, 0, 0], "radius": 1, "light": {"type": "area", "radiance": [0, 0, 0]}}
LAMP = scene.PointLight((0.0, 5.0, 0.0), (1.0, 1.0, 1.0))


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    """A folder `scenes` with what ASSIGNMENT refers to."""
    (tmp_path / "scenes").mkdir()
    (tmp_path / "textures").mkdir()
    (tmp_path / "scenes" / "left.obj").write_text("v 0 0 0\nv 0 1 0\nv 0 1 1\nv 0 0 1\nf 1 2 3 4\n")
    write_image(tmp_path / "textures" / "wood.png", np.full((4, 6, 3), srgb_to_linear(np.array(0.6)), np.float32))
    return tmp_path / "scenes"


def mesh_scene(**fields: Any) -> dict[str, Any]:
    objects = [{"type": "mesh", "path": "left.obj", "material_name": "m", **fields}]
    return {"materials": {"m": {"type": "diffuse", "color": [0.5, 0.25, 1]}}, "objects": objects}


def test_a_file_of_the_assignment_loads_unmodified(folder: Path) -> None:
    file = folder / "assignment.json"
    file.write_text(json.dumps(ASSIGNMENT))
    loaded = load_scene(file)
    assert loaded.film == scene.Film(320, 200)
    assert loaded.camera == scene.Camera((0, 1, 6.8), (0, 1, 0), (0, 1, 0), 19.5)
    assert (loaded.spp, loaded.max_depth, loaded.name, loaded.warnings) == (64, 8, "assignment", ())
    assert loaded.lights == (scene.PointLight((0, 1.5, 0.5), (17, 12, 5)),)
    grey, wood, tiles = loaded.textures
    assert grey == scene.ConstantTexture((0.725, 0.71, 0.68))
    assert tiles == scene.CheckerboardTexture((0.4, 0.4, 0.5), (0.2, 0.2, 0.3), (4, 4), (0, 0))
    assert isinstance(wood, scene.ImageTexture)
    assert (wood.scale, wood.delta, wood.pixels.shape) == ((2, 3), (0.5, 0), (4, 6, 3))
    np.testing.assert_allclose(wood.pixels, srgb_to_linear(np.array(0.6)), rtol=1e-5)
    assert loaded.materials == (
        scene.Diffuse(0),
        scene.Diffuse(1, twosided=False),
        scene.Diffuse(2),
        scene.Refraction(2.0),
        scene.Dielectric(),
    )
    assert [(shape.name, shape.material, shape.radiance) for shape in loaded.shapes] == [
        ("objects[0]", 0, None),
        ("objects[1]", 3, None),
        ("objects[2]", None, (80, 56, 23)),
        ("objects[3]", 1, None),
        ("objects[4]", 2, None),
        ("objects[5]", 4, None),
    ]
    left = loaded.shapes[0]
    assert isinstance(left, scene.Mesh)
    assert left.vertices.tolist() == [[0, 0, 5], [0, 1, 5], [0, 1, 6], [0, 0, 6]]
    assert loaded.shapes[1] == scene.Sphere(name="objects[1]", material=3, center=(0, 0.6, 0.6), radius=0.5)
    assert loaded.shapes[2] == scene.Rectangle(
        name="objects[2]", radiance=(80, 56, 23), center=(0, 1.99, 0), edge1=(0.4, 0, 0), edge2=(0, 0, 0.4)
    )


def test_a_dict_works_as_a_file(folder: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    (folder / "a.json").write_text(json.dumps(mesh_scene(translate=[1, 2, 3])))
    expected = load_scene(folder / "a.json").shapes[0]
    description = mesh_scene(path=Path("left.obj"), translate=np.array([1, 2, 3]))
    untouched = copy.deepcopy(description)
    for loaded in (load_scene(description, base_dir=folder), load_scene(str(folder / "a.json"))):
        shape = loaded.shapes[0]
        assert isinstance(shape, scene.Mesh)
        assert isinstance(expected, scene.Mesh)
        np.testing.assert_array_equal(shape.vertices, expected.vertices)
    monkeypatch.chdir(folder)
    assert load_scene(description, overrides={"camera.fov": 12}).camera.fov == 12
    np.testing.assert_equal(description, untouched)


def test_defaults_are_those_of_the_scene_classes() -> None:
    loaded = load_scene({"objects": [SPHERE]})
    default = scene.Scene()
    assert (loaded.film, loaded.camera, loaded.spp, loaded.max_depth) == (
        default.film,
        default.camera,
        default.spp,
        default.max_depth,
    )
    texture = {"type": "checkerboard"}
    materials = {"a": {"type": "diffuse", "texture_name": "t"}, "b": {"type": "dielectric"}}
    objects = [{**SPHERE, "material_name": name} for name in "ab"]
    loaded = load_scene({"textures": {"t": texture}, "materials": materials, "objects": objects})
    assert loaded.textures == (scene.CheckerboardTexture(),)
    assert loaded.materials == (scene.Diffuse(0), scene.Dielectric())


@pytest.mark.parametrize(
    ("integrator", "lights", "emitter", "expected"),
    [
        ({}, [], False, (LAMP,)),
        ({}, [], True, ()),
        ({}, [{"position": [1, 2, 3], "flux": [4, 5, 6]}], False, (scene.PointLight((1, 2, 3), (4, 5, 6)),)),
        ({"point_light_flux": [3, 2, 1]}, [], False, (scene.PointLight((0, 5, 0), (3, 2, 1)),)),
        ({"point_light_position": [3, 2, 1]}, [], True, (scene.PointLight((3, 2, 1), (1, 1, 1)),)),
        (
            {"point_light_flux": [0, 0, 0]},
            [{"type": "point", "position": [1, 2, 3], "flux": [4, 5, 6]}],
            True,
            (scene.PointLight((0, 5, 0), (0, 0, 0)), scene.PointLight((1, 2, 3), (4, 5, 6))),
        ),
    ],
)
def test_which_point_lights_there_are(
    integrator: dict[str, Any], lights: list[Any], emitter: bool, expected: tuple[scene.PointLight, ...]
) -> None:
    sphere = SPHERE if emitter else {**SPHERE, "light": None, "material_name": "m"}
    materials = {"m": {"type": "dielectric"}}
    assert (
        load_scene({"integrator": integrator, "lights": lights, "materials": materials, "objects": [sphere]}).lights
        == expected
    )


@pytest.mark.parametrize("name", ["Steel.001", "materials[0]", 'a "quoted" one', "back\\slash", "é", "plain"])
def test_overrides_reach_keys_of_any_name(name: str) -> None:
    """Written as errors write them."""
    sphere = {**SPHERE, "light": None, "material_name": name}
    raw = {"materials": {name: {"type": "refraction", "eta": "two"}}, "objects": [sphere]}
    with pytest.raises(SceneError) as error:
        load_scene(raw)
    path = error.value.problems[0].removeprefix("scene: ").partition(": expected")[0]
    assert load_scene(raw, overrides={path: 2}).materials == (scene.Refraction(2),)
    with pytest.raises(SceneError, match="a key in quotes is no JSON string"):
        load_scene(raw, overrides={r'materials["\q"].eta': 2})


def test_a_spot_light_points_at_what_it_looks_at() -> None:
    light = {"type": "spot", "position": [1, 5, 3], "look_at": [1, 1, 0], "intensity": [3, 2, 1], "outer_angle": 30}
    expected = scene.SpotLight((1, 5, 3), (0, -0.8, -0.6), (3, 2, 1), 0, 30)
    assert load_scene({"lights": [light], "objects": [SPHERE]}).lights == (expected,)


def test_only_what_is_used_becomes_part_of_the_scene(folder: Path) -> None:
    (folder / "broken.png").write_bytes(b"never read")
    description = mesh_scene()
    description["textures"] = {
        "unused": {"type": "image", "path": "broken.png"},
        "used": {"type": "constant", "color": [0, 0, 0]},
    }
    description["materials"] = {
        "unused": {"type": "diffuse", "texture_name": "unused"},
        "m": {"type": "diffuse", "texture_name": "used"},
    }
    loaded = load_scene(description, base_dir=folder)
    assert loaded.textures == (scene.ConstantTexture((0, 0, 0)),)
    assert loaded.materials == (scene.Diffuse(0),)
    assert loaded.shapes[0].material == 0
    (folder / "broken.png").unlink()
    with pytest.raises(SceneError, match=r"textures\.unused\.path: .*broken\.png: cannot be read: no such file"):
        load_scene(description, base_dir=folder)


def test_each_file_is_read_once(folder: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    read = []

    def counted(path: str) -> Any:
        read.append(os.path.basename(path))
        return load_mesh(path)

    monkeypatch.setattr("pyrt.scene_objects.load_mesh", counted)
    description = mesh_scene()
    description["objects"] += [{**description["objects"][0], "path": "../scenes/left.obj", "translate": [1, 0, 0]}]
    assert len(load_scene(description, base_dir=folder).shapes) == 2
    assert read == ["left.obj"]


def test_the_transform_comes_before_the_translation(folder: Path) -> None:
    matrix = [0, -2, 0, 10, 2, 0, 0, 20, 0, 0, 2, 30, 0, 0, 0, 1]  # row-major: a turn, a scale and a shift
    (mesh,) = load_scene(mesh_scene(transform=matrix, translate=[0, 0, 0.5]), base_dir=folder).shapes
    assert isinstance(mesh, scene.Mesh)
    points = np.array([[0, 0, 0], [0, 1, 0], [0, 1, 1], [0, 0, 1]])
    np.testing.assert_array_equal(
        mesh.vertices, np.stack([10 - 2 * points[:, 1], 20 + 2 * points[:, 0], 30.5 + 2 * points[:, 2]], axis=1)
    )


def test_reflectances_of_images_are_clamped_with_a_warning(folder: Path) -> None:
    pixels = np.full((2, 3, 3), 0.5, np.float32)
    pixels[0, 0] = (-0.25, 0.5, 4)
    write_image(folder / "bright.exr", pixels)
    description = mesh_scene()
    description["textures"] = {"t": {"type": "image", "path": "bright.exr"}}
    description["materials"] = {"m": {"type": "diffuse", "texture_name": "t"}}
    loaded = load_scene(description, base_dir=folder)
    (texture,) = loaded.textures
    assert isinstance(texture, scene.ImageTexture)
    assert texture.pixels[0, 0].tolist() == [0, 0.5, 1]
    assert loaded.warnings == (
        "scene: textures.t: 1 pixels have reflectances outside 0 to 1 (from -0.25 to 4) and are clamped",
    )
    description["textures"]["t"]["colorspace"] = "srgb"
    assert load_scene(description, base_dir=folder).textures[0].pixels[1, 1, 1] == np.float32(
        srgb_to_linear(np.array(0.5))
    )  # type: ignore[union-attr]


def test_warnings_of_files_name_the_object(folder: Path) -> None:
    (folder / "left.obj").write_text("v 0 0 0\nv 1 0 0\nv 0 1 0\nusemtl gold\nf 1 2 3\n")
    assert load_scene(mesh_scene(), base_dir=folder).warnings == (
        f"scene: objects[0].path: {folder}/left.obj: its materials are not used",
    )


def test_overrides(folder: Path) -> None:
    overrides = {
        "camera.fov": 40,
        "film.resolution": (64, 32),
        "film.filter.radius": 2,
        "objects[0].translate": [0, 0, 6],
        "objects.0.translate.2": 7,
        "integrator": {"spp": 5},
        "materials.m.color": [1, 1, 1],
    }
    loaded = load_scene(mesh_scene(), base_dir=folder, overrides=overrides)
    assert (loaded.camera.fov, loaded.film, loaded.spp) == (40, scene.Film(64, 32), 5)
    assert loaded.textures == (scene.ConstantTexture((1, 1, 1)),)
    mesh = loaded.shapes[0]
    assert isinstance(mesh, scene.Mesh)
    assert mesh.vertices[0].tolist() == [0, 0, 7]


@pytest.mark.parametrize("smooth", [True, False])
def test_icospheres(smooth: bool) -> None:
    description = {"type": "icosphere", "center": [1, 2, 3], "radius": 2, "subdivisions": 3, "smooth": smooth}
    (plain,) = load_scene({"objects": [{**description, "light": {"radiance": [1, 1, 1]}}]}).shapes
    assert isinstance(plain, scene.Mesh)
    assert plain.triangles.shape == (1280, 3)
    offsets = plain.vertices - [1, 2, 3]
    np.testing.assert_allclose(np.linalg.norm(offsets, axis=1), 2)
    assert (plain.normals is not None) == smooth
    if plain.normals is not None:
        np.testing.assert_allclose(plain.normals, offsets[plain.triangles] / 2, atol=0.02)
    bumpy = {**description, "displacement": {"amplitude": 0.5}, "light": {"radiance": [1, 1, 1]}}
    (displaced,) = load_scene({"objects": [bumpy]}).shapes
    assert isinstance(displaced, scene.Mesh)
    radii = np.linalg.norm(displaced.vertices - [1, 2, 3], axis=1)
    assert radii.min() >= 1
    assert radii.max() <= 3
    assert radii.std() > 0.1


def test_every_example_is_found_and_valid_for_the_published_schema() -> None:
    names = [path.stem for path in (ROOT / "scenes").glob("*.json")]
    assert "cornell" in names
    for name in names:
        assert example_path(name) == ROOT / "scenes" / f"{name}.json"
        SceneModel.model_validate_json(example_path(name).read_bytes())
    loaded = load_scene("example:cornell")
    assert loaded.name == "cornell"
    assert len(loaded.shapes) == 7


def test_the_schema_documents_every_field() -> None:
    schema = json_schema()
    for name, model in {"SceneModel": schema, **schema["$defs"]}.items():
        assert model["description"], name
        assert model["additionalProperties"] is False, name
        for key, value in model["properties"].items():
            assert "description" in value or "const" in value, f"{name}.{key}"
    assert schema["$defs"]["Refraction"]["properties"]["eta"]["exclusiveMinimum"] == 0
    assert set(schema["properties"]) == {
        "integrator",
        "film",
        "camera",
        "textures",
        "materials",
        "lights",
        "objects",
    }


def test_nothing_is_imported_that_a_scene_does_not_need() -> None:
    code = f"""
import sys
from pyrt.scene_io import load_scene
load_scene({{"objects": [{SPHERE!r}]}})
sys.exit(any(name in sys.modules for name in ("trimesh", "OpenImageIO", "pyopencl")))
"""
    subprocess.run([sys.executable, "-c", code], check=True, cwd=ROOT)
