"""glTF files as scenes: each feature gives the scene that the JSON format gives, or a warning that names it."""

from __future__ import annotations

import json
import math
import struct
import warnings
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from pyrt.errors import SceneError
from pyrt.image_io import write_image
from pyrt.scene import Diffuse, ImageTexture, Mesh, Scene, SpotLight
from pyrt.scene_hash import scene_hash
from pyrt.scene_io import load_scene
from tests.gltf_files import GltfFile
from tests.strategies import damaged, examples, json_values

SQUARE = [[0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0]]
FACES = [0, 1, 2, 0, 2, 3]
TRIANGLE = SQUARE[:3]
LIGHT = {"extensions": {"KHR_lights_punctual": {"light": 0}}, "translation": [0, 2, 3]}
LIGHTS = {"extensions": {"KHR_lights_punctual": {"lights": [{"type": "point", "intensity": 5, "color": [1, 0.5, 0]}]}}}
CAMERA = {"camera": 0, "translation": [0.5, 0.5, 4]}
PERSPECTIVE = [{"type": "perspective", "perspective": {"yfov": 0.7, "aspectRatio": 1.0}}]
UVS = [[0, 1], [1, 1], [1, 0], [0, 0]]


def load(file: GltfFile, tmp_path: Path, name: str = "model.glb", **options: Any) -> Scene:
    return load_scene(file.save(tmp_path / name), **options)


def lit(**sections: Any) -> GltfFile:
    """A file with a camera and a light, whose node 2 is to come."""
    file = GltfFile(cameras=PERSPECTIVE, nodes=[CAMERA, LIGHT], **LIGHTS)
    file.tree.update(sections)
    return file


def meshes(scene: Scene) -> list[Mesh]:
    return [shape for shape in scene.shapes if isinstance(shape, Mesh)]


def corners(scene: Scene) -> Any:
    return np.concatenate([mesh.vertices[mesh.triangles] for mesh in meshes(scene)]).tolist()


def one_mesh(tmp_path: Path, *mesh: Any, node: Any = None, **attributes: Any) -> Scene:
    file = lit()
    file.mesh(*mesh, **attributes)
    file.tree["nodes"].append({"mesh": 0, **(node or {})})
    return load(file, tmp_path)


@pytest.mark.parametrize("name", ["model.glb", "model.gltf"])
def test_a_file_is_the_scene_that_json_says(name: str, tmp_path: Path) -> None:
    file = lit(materials=[{"name": "red", "pbrMetallicRoughness": {"baseColorFactor": [0.5, 0.25, 0.125, 1]}}])
    file.mesh(SQUARE, FACES, material=0)
    file.tree["nodes"].append({"mesh": 0, "translation": [0, 0, -1]})
    (tmp_path / "square.obj").write_text("v 0 0 0\nv 1 0 0\nv 1 1 0\nv 0 1 0\nf 1 2 3 4\n")
    flux = 4 * math.pi * 5
    expected = load_scene(
        {
            "camera": {"position": [0.5, 0.5, 4], "look_at": [0.5, 0.5, 0], "fov": math.degrees(0.7)},
            "lights": [{"position": [0, 2, 3], "flux": [flux, flux / 2, 0]}],
            "materials": {"red": {"type": "diffuse", "color": [0.5, 0.25, 0.125]}},
            "objects": [{"type": "mesh", "path": "square.obj", "material_name": "red", "translate": [0, 0, -1]}],
        },
        base_dir=tmp_path,
    )
    scene = load(file, tmp_path, name)
    assert scene_hash(scene) == scene_hash(expected)
    assert (scene.film, scene.warnings, scene.name) == (expected.film, (), "model")


@pytest.mark.parametrize(
    ("mode", "indices", "expected"),
    [
        (4, None, [[0, 1, 2]]),
        (4, [0, 1, 2, 0, 2, 3], [[0, 1, 2], [0, 2, 3]]),
        (5, None, [[0, 1, 2], [1, 3, 2]]),
        (5, [0, 1, 3, 2], [[0, 1, 3], [1, 2, 3]]),
        (6, None, [[1, 2, 0], [2, 3, 0]]),
    ],
)
def test_primitives(mode: int, indices: Any, expected: Any, tmp_path: Path) -> None:
    scene = one_mesh(tmp_path, SQUARE, indices, mode=mode)
    assert corners(scene) == np.array(SQUARE, float)[expected].tolist()


@pytest.mark.parametrize("kind", ["u1", "u2", "u4"])
def test_index_types(kind: str, tmp_path: Path) -> None:
    file = lit()
    file.mesh(SQUARE, file.accessor(FACES, kind))
    file.tree["nodes"].append({"mesh": 0})
    assert corners(load(file, tmp_path)) == np.array(SQUARE, float)[np.reshape(FACES, (2, 3))].tolist()


def test_accessors_with_strides_offsets_fractions_and_sparse_changes(tmp_path: Path) -> None:
    file = lit()
    mixed = np.zeros(4, [("pad", "f4"), ("p", "f4", 3), ("uv", "u2", 2)])
    mixed["p"], mixed["uv"] = SQUARE, np.multiply(UVS, 65535)
    view = file.view(mixed.tobytes(), byteStride=20)
    lifted = file.accessor([[0, 0, 7]])
    file.tree["accessors"] += [
        {
            "bufferView": view,
            "byteOffset": 4,
            "componentType": 5126,
            "count": 4,
            "type": "VEC3",
            "sparse": {
                "count": 1,
                "indices": {"bufferView": file.view(b"\2"), "componentType": 5121},
                "values": {"bufferView": file.tree["accessors"][lifted]["bufferView"]},
            },
        },
        {"bufferView": view, "byteOffset": 16, "componentType": 5123, "normalized": True, "count": 4, "type": "VEC2"},
    ]
    primitive = {"attributes": {"POSITION": 1, "TEXCOORD_0": 2}, "mode": 6}
    file.tree["meshes"].append({"primitives": [primitive]})
    file.tree["nodes"].append({"mesh": 0})
    scene = load(file, tmp_path)
    assert corners(scene)[0] == [[1, 0, 0], [0, 0, 7], [0, 0, 0]]
    uvs = meshes(scene)[0].uvs
    assert uvs is not None
    assert uvs[1].tolist() == [UVS[2], UVS[3], UVS[0]]


def test_nodes_place_shared_meshes(tmp_path: Path) -> None:
    """Matrices and translation, rotation, scale, one below the other; a mirror keeps the front side."""
    file = lit()
    file.mesh(TRIANGLE)
    half = math.sqrt(0.5)
    file.tree["nodes"] += [
        {"matrix": [1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1, 0, 10, 0, 0, 1], "children": [3, 4]},
        {"mesh": 0, "rotation": [0, 0, half, half], "scale": [2, 2, 2], "translation": [0, 0, 5]},
        {"mesh": 0, "scale": [-1, 1, 1]},
    ]
    turned, mirrored = meshes(load(file, tmp_path))
    np.testing.assert_allclose(turned.vertices, [[10, 0, 5], [10, 2, 5], [8, 2, 5]], atol=1e-12)
    assert mirrored.vertices.tolist() == [[10, 0, 0], [9, 0, 0], [9, 1, 0]]
    assert mirrored.triangles.tolist() == [[0, 2, 1]]


def test_only_the_files_scene_is_shown(tmp_path: Path) -> None:
    file = GltfFile(nodes=[{"mesh": 0}, {"mesh": 0, "translation": [5, 0, 0]}], scene=1)
    file.tree["scenes"] = [{"nodes": [0]}, {"nodes": [1]}]
    file.mesh(TRIANGLE)
    assert corners(load(file, tmp_path)) == [[[5, 0, 0], [6, 0, 0], [6, 1, 0]]]


def test_normals_are_smooth_and_of_unit_length(tmp_path: Path) -> None:
    scene = one_mesh(tmp_path, TRIANGLE, NORMAL=[[0, 0, 2], [0, 3, 4], [0, 0, 0]], node={"scale": [1, 1, 2]})
    normals = meshes(scene)[0].normals
    assert normals is not None
    np.testing.assert_allclose(normals[0], [[0, 0, 1], [0, 3 / math.sqrt(13), 2 / math.sqrt(13)], [0, 0, 1]], atol=1e-6)


def textured(tmp_path: Path, info: Any = None, sampler: Any = None, how: str = "view", **attributes: Any) -> Scene:
    """A square with an image of 2×1 texels, 0.25 and 1."""
    path = tmp_path / "a b.png"
    write_image(path, np.array([[[0.25] * 3, [1.0] * 3]], np.float32))
    file = lit()
    image = {
        "view": lambda: {"bufferView": file.view(path.read_bytes()), "mimeType": "image/png"},
        "file": lambda: {"uri": "a%20b.png"},
    }[how]()
    pbr = {"baseColorFactor": [1, 0.5, 0, 1], "baseColorTexture": {"index": 0, **(info or {})}}
    file.tree["materials"] = [{"pbrMetallicRoughness": pbr}]
    file.tree["images"] = [image]
    file.tree["samplers"] = [sampler or {}]
    file.tree["textures"] = [{"source": 0, "sampler": 0}]
    file.mesh(SQUARE, FACES, material=0, **{"TEXCOORD_0": UVS, **attributes})
    file.tree["nodes"].append({"mesh": 0})
    return load(file, tmp_path)


def image_of(scene: Scene) -> ImageTexture:
    (texture,) = scene.textures
    assert isinstance(texture, ImageTexture)
    return texture


@pytest.mark.parametrize("how", ["view", "file"])
def test_images_times_factors(how: str, tmp_path: Path) -> None:
    scene = textured(tmp_path, how=how)
    texture = image_of(scene)
    # 8 bits on the sRGB curve
    np.testing.assert_allclose(texture.pixels, [[[0.25, 0.125, 0], [1, 0.5, 0]]], atol=4e-3)
    uvs = meshes(scene)[0].uvs
    assert uvs is not None
    assert uvs[0].tolist() == UVS[:3]
    assert (texture.scale, texture.delta) == ((1, 1), (0, 0))


def looked_up(texture: ImageTexture, u: float) -> float:
    """Red at (u, 0.5): bilinear between texel centres, repeated."""
    row = texture.pixels[len(texture.pixels) // 2, :, 0]
    x = (texture.scale[0] * u + texture.delta[0]) % 1 * len(row) - 0.5
    left, part = math.floor(x), x - math.floor(x)
    return float(row[left % len(row)] * (1 - part) + row[(left + 1) % len(row)] * part)


@pytest.mark.parametrize(
    ("wrap", "expected"),
    [
        (10497, [0.625, 0.25, 0.625, 1, 0.625, 0.25]),
        (33071, [0.25, 0.25, 0.625, 1, 1, 1]),
        (33648, [0.25, 0.25, 0.625, 1, 1, 1]),
    ],
)
def test_wrap_modes(wrap: int, expected: list[float], tmp_path: Path) -> None:
    texture = image_of(textured(tmp_path, sampler={"wrapS": wrap}))
    found = [looked_up(texture, u) for u in (0, 0.25, 0.5, 0.75, 1, 1.25)][: 5 if wrap == 33071 else 6]
    np.testing.assert_allclose(found, expected[: len(found)], atol=4e-3)


def test_a_mirrored_image_runs_backwards_on_its_second_round(tmp_path: Path) -> None:
    texture = image_of(textured(tmp_path, sampler={"wrapS": 33648}))
    np.testing.assert_allclose([looked_up(texture, u) for u in (1.25, 1.75, 2.25)], [1, 0.25, 0.25], atol=4e-3)


def test_texture_transforms_and_second_coordinates(tmp_path: Path) -> None:
    transform = {"offset": [0.5, 0.25], "rotation": math.pi / 2, "scale": [2, 3], "texCoord": 1}
    info = {"extensions": {"KHR_texture_transform": transform}}
    scene = textured(tmp_path, info, TEXCOORD_0=np.zeros((4, 2)), TEXCOORD_1=[[0, 0], [1, 0], [0, 1], [1, 1]])
    uvs = meshes(scene)[0].uvs
    assert uvs is not None
    # u = (1, 0), doubled, turned counter-clockwise in the picture, whose v runs down
    np.testing.assert_allclose(uvs[0], [[0.5, 0.25], [0.5, -1.75], [3.5, 0.25]], atol=1e-6)


def test_an_image_that_a_broken_material_no_longer_uses_is_no_second_mistake(tmp_path: Path) -> None:
    textured(tmp_path)
    with pytest.raises(SceneError) as error:
        load_scene(tmp_path / "model.glb", overrides={'materials["materials[0]"].color': [1, 0, 0]})
    (problem,) = error.value.problems
    assert problem.endswith('expected either "texture_name" or "color", found both; null takes one away')


def test_vertex_colours_are_interpolated_exactly(tmp_path: Path) -> None:
    colors = np.random.default_rng(0).uniform(0, 1, (4, 3))
    scene = one_mesh(tmp_path, SQUARE, FACES, COLOR_0=colors)
    texture, mesh = image_of(scene), meshes(scene)[0]
    assert mesh.uvs is not None
    for triangle in range(2):
        for weights in ([1, 0, 0], [0, 1, 0], [0, 0, 1], [0.5, 0.5, 0], [0.2, 0.3, 0.5]):
            u, v = weights @ mesh.uvs[triangle]
            height, width = texture.pixels.shape[:2]
            x, y = u * width - 0.5, v * height - 0.5
            x0, y0 = min(math.floor(x + 1e-6), width - 2), min(math.floor(y + 1e-6), height - 2)
            block = texture.pixels[y0 : y0 + 2, x0 : x0 + 2]
            rows = block[0] * (1 - (y - y0)) + block[1] * (y - y0)
            found = rows[0] * (1 - (x - x0)) + rows[1] * (x - x0)
            expected = weights @ colors[np.reshape(FACES, (2, 3))[triangle]]
            np.testing.assert_allclose(found, expected, atol=1e-5)


def test_one_vertex_colour_is_a_constant(tmp_path: Path) -> None:
    scene = one_mesh(tmp_path, SQUARE, FACES, COLOR_0=[[0.5, 0.25, 1, 1]] * 4)
    assert [texture.color for texture in scene.textures] == [(0.5, 0.25, 1)]  # type: ignore[union-attr]


def test_emission_glass_and_names(tmp_path: Path) -> None:
    glass = {"KHR_materials_transmission": {"transmissionFactor": 1}, "KHR_materials_ior": {"ior": 1.4}}
    materials = [
        {
            "name": "same",
            "emissiveFactor": [1, 0.5, 0],
            "extensions": {"KHR_materials_emissive_strength": {"emissiveStrength": 4}},
        },
        {"name": "same", "extensions": glass},
    ]
    file = GltfFile(materials=materials, nodes=[{"mesh": 0}, {"mesh": 1}])
    file.mesh(SQUARE, FACES, material=0)
    file.mesh(SQUARE, FACES, material=1)
    scene = load(file, tmp_path, overrides={"materials.same 2.int_ior": 1.3})
    assert [shape.radiance for shape in scene.shapes] == [(4, 2, 0), None]
    assert [replace(m, texture=0) if isinstance(m, Diffuse) else m.int_ior for m in scene.materials] == [
        Diffuse(0),
        1.3,
    ]  # type: ignore[union-attr]


def test_a_directional_light_is_parallel_and_as_strong_everywhere(tmp_path: Path) -> None:
    file = lit()
    file.tree["extensions"]["KHR_lights_punctual"]["lights"] = [{"type": "directional", "intensity": 3}]
    file.tree["nodes"][1] = {**LIGHT, "rotation": [-math.sqrt(0.5), 0, 0, math.sqrt(0.5)]}  # -z is turned to -y
    file.mesh(SQUARE, FACES)
    file.tree["nodes"].append({"mesh": 0, "scale": [100, 100, 100]})
    (light,) = load(file, tmp_path).lights
    for corner in np.multiply(SQUARE, 100.0):
        away = light.position - corner
        irradiance = light.flux[0] / (4 * math.pi * away @ away)
        assert irradiance == pytest.approx(3, rel=1e-5)
        np.testing.assert_allclose(away / np.linalg.norm(away), [0, 1, 0], atol=2e-6)


def spot_of(tmp_path: Path, spot: Any, **node: Any) -> SpotLight:
    file = lit()
    light = {"type": "spot", "intensity": 5, "color": [1, 0.5, 0], **spot}
    file.tree["extensions"]["KHR_lights_punctual"]["lights"] = [light]
    file.tree["nodes"][1] = {**LIGHT, **node}
    file.mesh(SQUARE, FACES)
    file.tree["nodes"].append({"mesh": 0})
    (found,) = load(file, tmp_path).lights
    assert isinstance(found, SpotLight)
    return found


def test_a_spot_light_shines_along_its_nodes_axis(tmp_path: Path) -> None:
    """-z, turned by the node; its scale changes neither the intensity nor the cone."""
    turn = [-math.sqrt(0.5), 0, 0, math.sqrt(0.5)]  # -z to -y
    light = spot_of(tmp_path, {"spot": {"innerConeAngle": 0.1}}, rotation=turn, scale=[3, 2, 5])
    assert (light.position, light.intensity) == ((0, 2, 3), (5, 2.5, 0))
    np.testing.assert_allclose(light.direction, [0, -1, 0], atol=1e-12)
    assert (light.inner, light.outer) == (pytest.approx(math.degrees(0.1)), pytest.approx(45))


@pytest.mark.parametrize("angle", [0.3, 1.5707964])  # as float32 has the right angle
def test_a_spot_light_with_a_sharp_edge(angle: float, tmp_path: Path) -> None:
    light = spot_of(tmp_path, {"spot": {"innerConeAngle": angle, "outerConeAngle": angle}})
    assert light.outer == min(math.degrees(angle), 90)
    assert 0.99 * light.outer < light.inner < light.outer


def warnings_of(tmp_path: Path, **sections: Any) -> list[str]:
    file = lit()
    file.mesh(SQUARE, FACES, material=0)
    file.tree["materials"] = [{}]
    file.tree["nodes"].append({"mesh": 0})
    for key, value in sections.items():
        file.tree[key] = value(file.tree[key]) if callable(value) else value
    prefix = f"{tmp_path}/model.glb: "
    found = load(file, tmp_path).warnings
    assert all(warning.startswith(prefix) for warning in found)
    return [warning.removeprefix(prefix) for warning in found]


def materials(**fields: Any) -> dict[str, Any]:
    return {"materials": [fields]}


NOT_RENDERED = "are not rendered: surfaces are matte or clear glass"


@pytest.mark.parametrize(
    ("sections", "warning"),
    [
        (materials(pbrMetallicRoughness={"metallicFactor": 0.5}), f"its materials' metalness (1 times) {NOT_RENDERED}"),
        (
            materials(alphaMode="BLEND", normalTexture={"index": 0}),
            f"its materials' alpha mode BLEND (1 times), normal maps (1 times) {NOT_RENDERED}",
        ),
        (
            materials(emissiveFactor=[1, 1, 1], emissiveTexture={"index": 0}),
            f"its materials' emissive textures (1 times) {NOT_RENDERED}",
        ),
        (
            materials(extensions={"KHR_materials_unlit": {}}),
            f"its materials' KHR_materials_unlit (1 times) {NOT_RENDERED}",
        ),
        ({"animations": [{}]}, "its animations are not used"),
        ({"skins": [{}]}, "its skins are not used, shapes are as they are stored"),
        ({"cameras": [{"type": "orthographic"}]}, "its orthographic cameras are not used"),
        ({"nodes": lambda nodes: [*nodes, CAMERA]}, "its first camera is used, of 2"),
        ({"nodes": lambda nodes: [*nodes, {"mesh": 0, "scale": [0, 1, 1]}]}, "its nodes without extent are left out"),
        (
            {"meshes": lambda meshes: [{"primitives": [*meshes[0]["primitives"], {"attributes": {}, "mode": 0}]}]},
            "its points and lines are not used",
        ),
        (
            {"extensions": {"KHR_lights_punctual": {"lights": [{"type": "laser"}]}}},
            "its lights of type 'laser' are not used",
        ),
        (
            {
                "extensions": {"KHR_lights_punctual": {"lights": [{"type": "spot"}]}},
                "nodes": lambda nodes: [nodes[0], {**LIGHT, "scale": [1, 1, 0]}, nodes[2]],
            },
            "its spot lights without a direction are not used",
        ),
    ],
)
def test_what_is_not_rendered_is_named(sections: Any, warning: str, tmp_path: Path) -> None:
    assert warnings_of(tmp_path, **sections) == [warning]


def test_a_plain_file_has_no_warning(tmp_path: Path) -> None:
    assert warnings_of(tmp_path) == []


def broken(tmp_path: Path, change: Any, name: str = "model.glb") -> str:
    file = lit()
    file.mesh(SQUARE, FACES)
    file.tree["nodes"].append({"mesh": 0})
    change(file.tree)
    with pytest.raises(SceneError) as error:
        load(file, tmp_path, name)
    (problem,) = error.value.problems
    assert problem.startswith(f"{tmp_path}/{name}: ")
    return problem.removeprefix(f"{tmp_path}/{name}: ")


def setting(*path: Any) -> Any:
    *parents, last, value = path

    def change(tree: Any) -> None:
        for step in parents:
            tree = tree[step]
        tree[last] = value

    return change


@pytest.mark.parametrize(
    ("change", "sentence"),
    [
        (setting("asset", "version", "1.0"), 'expected glTF version 2, found "1.0"'),
        (
            setting("extensionsRequired", ["KHR_draco_mesh_compression"]),
            'it needs the glTF extension "KHR_draco_mesh_compression", which pyrt does not read',
        ),
        (
            setting("extensionsRequired", ["EXT_meshopt_compression"]),
            'it needs the glTF extension "EXT_meshopt_compression", which pyrt does not read',
        ),
        (setting("nodes", 2, "mesh", 9), "nodes[2].mesh: no mesh 9, there are 1"),
        (setting("scenes", [{"nodes": [2, 2]}]), "nodes[2]: it is in the scene twice, or above itself"),
        (lambda tree: tree.update(scenes=[{}], scene=1), "scene: no scene 1, there are 1"),
        (setting("accessors", 0, "count", 10**9), "accessors[0]: its 1000000000 elements end at byte 12000000000"),
        (setting("accessors", 0, "count", -1), "accessors[0].count: expected an integer >= 1, got -1"),
        (setting("accessors", 0, "byteOffset", 2**40), "accessors[0]: its 4 elements end at byte 1099511627824"),
        (setting("accessors", 0, "componentType", 5), "accessors[0].componentType: expected a component type: 5120"),
        (setting("accessors", 0, "type", "VEC2"), 'accessors[0].type: expected VEC3, got "VEC2"'),
        (setting("bufferViews", 0, "byteLength", 10**9), "bufferViews[0]: it ends at byte 1000000000, its buffer at"),
        (setting("bufferViews", 0, "buffer", 3), "bufferViews[0]: no buffer 3, there are 1"),
        (setting("buffers", [{"byteLength": 10**9}]), "buffers[0].byteLength: 1000000000 bytes,"),
        (setting("meshes", 0, "primitives", []), "meshes[0].primitives: expected a list of primitives, got []"),
        (setting("meshes", 0, "primitives", 0, "attributes", {}), "meshes[0].primitives[0].attributes: missing key"),
        (setting("nodes", 0, "camera", 7), "nodes[0].camera: no camera 7, there are 1"),
        (setting("nodes", 2, "mesh", None), "it shows no triangle"),
        (setting("nodes", 2, "scale", [1, 1]), "nodes[2].scale: expected 3 numbers from -1e30 to 1e30, got [1, 1]"),
    ],
)
def test_malformed_files_are_refused_with_the_place(change: Any, sentence: str, tmp_path: Path) -> None:
    assert broken(tmp_path, change).startswith(sentence)


def test_an_index_beyond_the_vertices_is_refused(tmp_path: Path) -> None:
    file = GltfFile(nodes=[{"mesh": 0}])
    file.mesh(SQUARE, [0, 1, 9])
    with pytest.raises(SceneError, match=r"meshes\[0\]\.primitives\[0\]\.indices: no vertex 9, there are 4$"):
        load(file, tmp_path)


def test_zeros_and_copies_are_bounded_before_they_are_made(tmp_path: Path) -> None:
    """Elements without bytes, and a mesh that a million nodes share."""
    zeros = {"componentType": 5126, "count": 2**40, "type": "VEC3"}
    assert broken(tmp_path, lambda tree: tree["accessors"].__setitem__(0, zeros)).startswith("accessors[0].count: exp")
    file = GltfFile(nodes=[{"mesh": 0}] * 300)
    file.mesh(SQUARE, np.zeros(3 * 2**17, np.uint16))
    with pytest.raises(SceneError, match=r"nodes\[256\]: with it the scene has more than 33554432 triangles$"):
        load(file, tmp_path)


@pytest.mark.parametrize(
    "uri",
    [
        "../secret.bin",
        "/etc/passwd",
        "https://example.org/a.bin",
        "file:///etc/passwd",
        "a/../../b",
        "%2e%2e/b",
        "C:\\b",
    ],
)
def test_files_stay_in_their_folder(uri: str, tmp_path: Path) -> None:
    (tmp_path / "secret.bin").write_bytes(bytes(1000))
    folder = tmp_path / "models"
    folder.mkdir()
    problem = broken(folder, setting("buffers", [{"byteLength": 4, "uri": uri}]))
    assert problem == f"buffers[0].uri: expected a file in the model's folder or below, got {json.dumps(uri)}"


def test_a_missing_file_and_a_damaged_image_are_named(tmp_path: Path) -> None:
    problem = broken(tmp_path, setting("buffers", [{"byteLength": 4, "uri": "no.bin"}]))
    assert problem == f"buffers[0].uri: {tmp_path}/no.bin: cannot be read: no such file or directory"

    def bad_image(tree: Any) -> None:
        tree["images"] = [{"uri": "data:;base64,aGVsbG8="}]
        tree["textures"] = [{"source": 0}]
        tree["materials"] = [{"pbrMetallicRoughness": {"baseColorTexture": {"index": 0}}}]
        tree["meshes"][0]["primitives"][0]["material"] = 0

    assert broken(tmp_path, bad_image) == "images[0]: expected a PNG, JPEG or WebP image, it begins with b'hell'"


@pytest.mark.parametrize(
    ("content", "sentence"),
    [
        (b"", "it has no glTF header"),
        (b"glTF\1\0\0\0" + bytes(12), "expected GLB version 2, found 1"),
        (b"glTF\2\0\0\0\xff\xff\xff\xff" + bytes(8), "its header says 4294967295 bytes, the file has 20"),
        (b"glTF\2\0\0\0\x14\0\0\0\xff\0\0\0JSON", "a chunk says 255 bytes, 0 are left"),
        (b"glTF\2\0\0\0\x14\0\0\0\0\0\0\0JSON", "its JSON is damaged"),
        (b"glTF\2\0\0\0\x14\0\0\0\0\0\0\0NOSJ", "it has no JSON chunk"),
    ],
)
def test_damaged_containers(content: bytes, sentence: str, tmp_path: Path) -> None:
    path = tmp_path / "model.glb"
    path.write_bytes(content)
    with pytest.raises(SceneError) as error:
        load_scene(path)
    assert error.value.problems == [f"{path}: {sentence}"]


def test_a_node_above_itself_is_refused(tmp_path: Path) -> None:
    def loop(tree: Any) -> None:
        tree["scenes"] = [{"nodes": [2]}]
        tree["nodes"][2]["children"] = [0]
        tree["nodes"][0]["children"] = [2]

    assert broken(tmp_path, loop) == "nodes[2]: it is in the scene twice, or above itself"


def rich_file() -> bytes:
    """A small file of every kind of thing, to damage."""
    pbr = {"baseColorFactor": [1, 0.5, 0, 1], "baseColorTexture": {"index": 0, "texCoord": 1}}
    transform = {"KHR_texture_transform": {"offset": [0.5, 0], "rotation": 1, "scale": [2, 2]}}
    file = lit(
        materials=[
            {"name": "a", "pbrMetallicRoughness": {**pbr, "extensions": transform}, "emissiveFactor": [1, 0, 0]}
        ],
        textures=[{"source": 0, "sampler": 0}],
        samplers=[{"wrapS": 33071, "wrapT": 33648}],
        scenes=[{"nodes": [0, 1, 2]}],
        scene=0,
    )
    file.tree["images"] = [{"bufferView": file.view(PNG), "mimeType": "image/png"}]
    attributes = {"NORMAL": [[0, 0, 1]] * 4, "TEXCOORD_1": UVS, "COLOR_0": np.eye(4)}
    file.mesh(SQUARE, FACES, material=0, **attributes)
    file.mesh(SQUARE, mode=5)
    file.tree["nodes"] += [{"mesh": 0, "rotation": [0, 0, 1, 0], "scale": [1, 2, 3], "children": [3]}, {"mesh": 1}]
    return file.glb()


PNG = bytes.fromhex(
    "89504e470d0a1a0a0000000d494844520000000100000001080200000090775"
    "3de0000000c49444154789c63f8cfc0000003010100c9fe92ef0000000049454e44ae426082"
)
RICH = rich_file()


def check_damaged(content: bytes, folder: Path) -> None:
    path = folder / "model.glb"
    path.write_bytes(content)
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        try:
            load_scene(path)
        except SceneError as error:
            check_sentences(error.problems)


def check_sentences(problems: list[str]) -> None:
    assert problems
    for problem in problems:
        assert problem.isprintable()
        assert 10 < len(problem) < 1000


def test_the_undamaged_file_loads(tmp_path: Path) -> None:
    (tmp_path / "model.glb").write_bytes(RICH)
    assert len(load_scene(tmp_path / "model.glb").shapes) == 2


@examples(50)
@given(st.data())
def test_damaged_files_are_refused_in_sentences(folder: Path, data: st.DataObject) -> None:
    check_damaged(data.draw(damaged(RICH)), folder)


@examples(100)
@given(st.data())
def test_files_with_other_json_are_refused_in_sentences(folder: Path, data: st.DataObject) -> None:
    check_damaged(data.draw(other_json()), folder)


@pytest.mark.slow
@examples(5000)
@given(st.data())
def test_many_damaged_files_are_refused_in_sentences(folder: Path, data: st.DataObject) -> None:
    check_damaged(data.draw(damaged(RICH) | other_json()), folder)


@st.composite
def other_json(draw: st.DrawFn) -> bytes:
    """RICH with values of its JSON replaced by others."""
    length = int.from_bytes(RICH[12:16], "little")
    tree = json.loads(RICH[20 : 20 + length])
    for _ in range(draw(st.integers(1, 3))):
        node = tree
        while True:
            keys = list(node) if isinstance(node, dict) else range(len(node))
            if not keys:
                break
            key = draw(st.sampled_from(list(keys)))
            if isinstance(node[key], (dict, list)) and node[key] and draw(st.integers(0, 9)):
                node = node[key]
                continue
            numbers = st.sampled_from([0, 1, -1, 2, 3, 7, 255, 2**31, 2**60, 0.5, 1e30, 1e-30, 10**400])
            node[key] = draw(numbers | json_values)
            break
    text = json.dumps(tree).encode("utf-8", "surrogatepass")
    text += b" " * (-len(text) % 4)
    chunks = struct.pack("<I4s", len(text), b"JSON") + text + RICH[20 + length :]
    return struct.pack("<4sII", b"glTF", 2, 12 + len(chunks)) + chunks


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return tmp_path_factory.mktemp("models")
