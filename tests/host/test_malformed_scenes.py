"""Every malformed scene gives one clear sentence per problem, with file, JSON path, value and expectation."""

from __future__ import annotations

import copy
import json
import struct
import zlib
from pathlib import Path
from typing import Any

import numpy as np
import OpenImageIO as oiio
import pytest

from pyrt.errors import SceneError, UsageError
from pyrt.scene_io import load_scene

REMOVED = object()
NAN, INF = float("nan"), float("inf")

VALID: dict[str, Any] = {
    "integrator": {"type": "direct", "point_light_position": [0, 1.5, 0.5], "point_light_flux": [17, 12, 5]},
    "film": {"resolution": [64, 48], "filter": {"type": "box", "radius": 0.5}},
    "camera": {"position": [0, 1, 6.8], "look_at": [0, 1, 0], "ref_up": [0, 1, 0], "fov": 19.5},
    "textures": {
        "grey": {"type": "constant", "color": [0.7, 0.7, 0.7]},
        "tiles": {"type": "checkerboard", "tex_coordinate_generator": {"type": "uvmapping2d", "scale": [4, 4]}},
    },
    "materials": {
        "grey_diffuse": {"type": "diffuse", "texture_name": "grey"},
        "glass": {"type": "refraction", "eta": 2.0},
        "crystal": {"type": "dielectric", "int_ior": 1.6},
    },
    "lights": [{"type": "point", "position": [0, 1, 0], "flux": [1, 1, 1]}],
    "objects": [
        {"type": "sphere", "center": [0, 1, 0], "radius": 0.5, "material_name": "glass"},
        {
            "type": "rectangle",
            "center": [0, 2, 0],
            "edge1": [1, 0, 0],
            "edge2": [0, 0, 1],
            "light": {"radiance": [1, 1, 1]},
        },
        {"type": "icosphere", "subdivisions": 1, "material_name": "grey_diffuse"},
        {"type": "mesh", "path": "square.obj", "material_name": "grey_diffuse", "translate": [0, 0, 1]},
    ],
}
SQUARE = "v 0 0 0\nv 1 0 0\nv 1 1 0\nv 0 1 0\nf 1 2 3 4\n"
RESOLUTION = "width and height, 2 integers from 1 to 65536 with at most 2^28 pixels in all"
IDENTITY = [1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1]


def changed(changes: dict[str, Any]) -> dict[str, Any]:
    """VALID with values set at dotted paths, or removed."""
    scene = copy.deepcopy(VALID)
    for path, value in changes.items():
        *parents, last = path.split(".")
        node: Any = scene
        for step in parents:
            node = node[int(step)] if isinstance(node, list) else node[step]
        if value is REMOVED:
            del node[last]
        elif isinstance(node, list):
            node[int(last)] = value
        else:
            node[last] = value
    return scene


def problems_of(source: Any, folder: Path, **options: Any) -> list[str]:
    (folder / "square.obj").write_text(SQUARE)
    with pytest.raises(SceneError) as caught:
        load_scene(source, base_dir=folder, **options)
    assert caught.value.exit_code == 3
    for problem in caught.value.problems:
        assert "\n" not in problem
        assert len(problem) < 300
    return caught.value.problems


def short(value: object) -> str:
    return repr(value)[:40]


def test_the_unchanged_scene_is_valid(tmp_path: Path) -> None:
    (tmp_path / "square.obj").write_text(SQUARE)
    assert len(load_scene(changed({}), base_dir=tmp_path).shapes) == 4


MALFORMED: dict[str, tuple[dict[str, Any], list[str]]] = {
    # numbers
    "number as text": ({"materials.glass.eta": "two"}, ['materials.glass.eta: expected a number > 0, got "two"']),
    "zero": ({"materials.glass.eta": 0}, ["materials.glass.eta: expected a number > 0, got 0"]),
    "boolean": ({"materials.glass.eta": True}, ["materials.glass.eta: expected a number > 0, got true"]),
    "null": ({"materials.glass.eta": None}, ["materials.glass.eta: expected a number > 0, got null"]),
    "nan": ({"materials.glass.eta": NAN}, ["materials.glass.eta: expected a number > 0, got NaN"]),
    "infinite": ({"materials.glass.eta": INF}, ["materials.glass.eta: expected a number > 0, got Infinity"]),
    "too large for a double": (
        {"materials.glass.eta": 10**400},
        ["materials.glass.eta: expected a number > 0, got 1" + "0" * 56 + "..."],
    ),
    "too large to print": (
        {"materials.glass.eta": 10**5000},
        ["materials.glass.eta: expected a number > 0, got a value that JSON cannot hold"],
    ),
    "negative ior": ({"materials.crystal.int_ior": -1}, ["materials.crystal.int_ior: expected a number > 0, got -1"]),
    "flag as number": (
        {"materials.grey_diffuse.twosided": 1},
        ["materials.grey_diffuse.twosided: expected true or false, got 1"],
    ),
    # keys, types and names
    "unknown key": ({"materials.glass.eat": 1}, ['materials.glass.eat: unknown key; did you mean "eta"?']),
    "unknown key, nothing near": (
        {"film.size": [1, 1]},
        ['film.size: unknown key; expected one of "resolution", "filter"'],
    ),
    "unknown nested key": (
        {"textures.tiles.tex_coordinate_generator.scle": [1, 1]},
        ['textures.tiles.tex_coordinate_generator.scle: unknown key; did you mean "scale"?'],
    ),
    "unknown section": ({"texture": {}}, ['texture: unknown key; did you mean "textures"?']),
    "missing key": ({"materials.glass.eta": REMOVED}, ['materials.glass: missing key "eta"']),
    "misspelt key": (
        {"objects.1": {"type": "sphere", "centre": [0, 0, 0], "radius": 1, "material_name": "glass"}},
        ['objects[1]: missing key "center"', 'objects[1].centre: unknown key; did you mean "center"?'],
    ),
    "missing type": (
        {"materials.glass.type": REMOVED},
        ['materials.glass: missing key "type"; expected one of "dielectric", "diffuse", "refraction"'],
    ),
    "unknown material type": (
        {"materials.glass.type": "glass"},
        ['materials.glass.type: no material type "glass"; expected one of "dielectric", "diffuse", "refraction"'],
    ),
    "unknown texture type": (
        {"textures.grey.type": "const"},
        ['textures.grey.type: no texture type "const"; did you mean "constant"?'],
    ),
    "unknown object type": (
        {"objects.0.type": "spere"},
        ['objects[0].type: no object type "spere"; did you mean "sphere"?'],
    ),
    "type not a string": (
        {"objects.0.type": ["sphere"]},
        ['objects[0].type: no object type ["sphere"]; did you mean "sphere"?'],
    ),
    "unknown integrator": (
        {"integrator.type": "path"},
        ['integrator.type: expected "intersection_test" or its alias "direct", got "path"'],
    ),
    "unknown filter": ({"film.filter.type": "gauss"}, ['film.filter.type: expected "box", got "gauss"']),
    "unknown light": ({"lights.0.type": "spott"}, ['lights[0].type: no light type "spott"; did you mean "spot"?']),
    "light no object": ({"lights": [3]}, ["lights[0]: expected an object, got 3"]),
    "spot without intensity": (
        {"lights": [{"type": "spot", "position": [0, 1, 0], "look_at": [0, 0, 0], "flux": [1, 1, 1]}]},
        [
            'lights[0]: missing key "intensity"',
            'lights[0].flux: unknown key; expected one of "type", "position", "look_at", "intensity", "inner_angle", '
            '"outer_angle"',
        ],
    ),
    "spot at itself": (
        {"lights": [{"type": "spot", "position": [0, 1, 0], "look_at": [0, 1, 0], "intensity": [1, 1, 1]}]},
        ["lights[0]: expected a look_at away from the position, got [0.0, 1.0, 0.0] for both"],
    ),
    "cone inside out": (
        {
            "lights": [
                {"type": "spot", "position": [0, 1, 0], "look_at": [0, 0, 0], "intensity": [1, 1, 1], "inner_angle": 45}
            ]
        },
        ["lights[0]: expected inner_angle < outer_angle, got 45 and 45"],
    ),
    "wide cone": (
        {
            "lights": [
                {"type": "spot", "position": [0, 1, 0], "look_at": [0, 0, 0], "intensity": [1, 1, 1], "outer_angle": 91}
            ]
        },
        ["lights[0].outer_angle: expected an angle in degrees > 0 and <= 90, got 91"],
    ),
    "unknown area light": ({"objects.1.light.type": "spot"}, ['objects[1].light.type: expected "area", got "spot"']),
    "unknown material": (
        {"objects.3.material_name": "gray_difuse"},
        ['objects[3].material_name: no material "gray_difuse"; did you mean "grey_diffuse"?'],
    ),
    "unknown texture": (
        {"materials.grey_diffuse.texture_name": "marble"},
        ['materials.grey_diffuse.texture_name: no texture "marble"; expected one of "grey", "tiles"'],
    ),
    "no textures": (
        {"textures": REMOVED},
        ['materials.grey_diffuse.texture_name: no texture "grey"; there is none'],
    ),
    "name not a string": (
        {"objects.0.material_name": 3},
        ["objects[0].material_name: expected a string of 1 to 1024 characters, got 3"],
    ),
    # sections
    "section not an object": ({"film": 3}, ["film: expected an object, got 3"]),
    "section null": ({"materials": None}, ["materials: expected an object, got null"]),
    "entry not an object": ({"objects.0": "sphere"}, ['objects[0]: expected an object, got "sphere"']),
    "lights not an array": ({"lights": {}}, ["lights: expected an array, got {}"]),
    "objects not an array": ({"objects": {}}, ["objects: expected an array, got {}"]),
    "objects missing": ({"objects": REMOVED}, ['missing key "objects"']),
    "objects empty": ({"objects": []}, ["objects: expected at least one object, got []"]),
    # film and integrator
    "no pixels": ({"film.resolution": [0, 10]}, [f"film.resolution: expected {RESOLUTION}, got [0, 10]"]),
    "side too large": ({"film.resolution": [65537, 1]}, [f"film.resolution: expected {RESOLUTION}, got [65537, 1]"]),
    "too many pixels": (
        {"film.resolution": [65536, 4097]},
        [f"film.resolution: expected {RESOLUTION}, got [65536, 4097]"],
    ),
    "fractional pixels": ({"film.resolution": [64.5, 64]}, [f"film.resolution: expected {RESOLUTION}, got [64.5, 64]"]),
    "one side": ({"film.resolution": [64]}, [f"film.resolution: expected {RESOLUTION}, got [64]"]),
    "spp 0": ({"integrator.spp": 0}, ["integrator.spp: expected an integer from 1 to 2^30, got 0"]),
    "spp too large": (
        {"integrator.spp": 2**30 + 1},
        ["integrator.spp: expected an integer from 1 to 2^30, got 1073741825"],
    ),
    "negative depth": (
        {"integrator.max_depth": -1},
        ["integrator.max_depth: expected an integer from 0 to 1024, got -1"],
    ),
    "depth too large": (
        {"integrator.max_depth": 1025},
        ["integrator.max_depth: expected an integer from 0 to 1024, got 1025"],
    ),
    # camera
    "fov 0": ({"camera.fov": 0}, ["camera.fov: expected an angle in degrees between 0 and 180, got 0"]),
    "fov 180": ({"camera.fov": 180}, ["camera.fov: expected an angle in degrees between 0 and 180, got 180"]),
    "two coordinates": (
        {"camera.position": [0, 1]},
        ["camera.position: expected 3 numbers from -1e30 to 1e30, got [0, 1]"],
    ),
    "beyond 1e30": (
        {"camera.position": [0, 1e31, 0]},
        ["camera.position: expected 3 numbers from -1e30 to 1e30, got [0, 1e+31, 0]"],
    ),
    "camera looks at itself": (
        {"camera.look_at": [0, 1, 6.8]},
        ["camera.look_at: expected another point than the camera's position, got [0, 1, 6.8]"],
    ),
    "camera in the default target": (
        {"camera": {"position": [0, 0, 0]}},
        ["camera.look_at: expected another point than the camera's position, got [0, 0, 0]"],
    ),
    "camera rolled over": (
        {"camera.ref_up": [0, 0, 2]},
        ["camera.ref_up: expected a direction that is not parallel to the line of sight, got [0, 0, 2]"],
    ),
    "up is zero": (
        {"camera.ref_up": [0, 0, 0]},
        ["camera.ref_up: expected a direction that is not parallel to the line of sight, got [0, 0, 0]"],
    ),
    # energy
    "reflectance above 1": (
        {"textures.grey.color": [0.5, 0.5, 1.5]},
        ["textures.grey.color: expected 3 numbers from 0 to 1, got [0.5, 0.5, 1.5]"],
    ),
    "negative reflectance": (
        {"textures.tiles.color1": [0.5, 0.5, -0.1]},
        ["textures.tiles.color1: expected 3 numbers from 0 to 1, got [0.5, 0.5, -0.1]"],
    ),
    "negative radiance": (
        {"objects.1.light.radiance": [1, -1, 1]},
        ["objects[1].light.radiance: expected 3 numbers from 0 to 1e30, got [1, -1, 1]"],
    ),
    "negative flux": (
        {"integrator.point_light_flux": [-1, 0, 0]},
        ["integrator.point_light_flux: expected 3 numbers from 0 to 1e30, got [-1, 0, 0]"],
    ),
    "nan flux": (
        {"lights.0.flux": [1, 2, NAN]},
        ["lights[0].flux: expected 3 numbers from 0 to 1e30, got [1, 2, NaN]"],
    ),
    "two reflectances": (
        {"materials.grey_diffuse.color": [0.5, 0.5, 0.5]},
        ['materials.grey_diffuse: expected either "texture_name" or "color", found both; null takes one away'],
    ),
    "no reflectance": (
        {"materials.grey_diffuse.texture_name": REMOVED},
        ['materials.grey_diffuse: expected either "texture_name" or "color", found neither'],
    ),
    "neither material nor light": (
        {"objects.1.light": REMOVED},
        ['objects[1]: expected "material_name", "light" or both, found neither'],
    ),
    # shapes
    "radius 0": ({"objects.0.radius": 0}, ["objects[0].radius: expected a number > 0, got 0"]),
    "negative radius": ({"objects.2.radius": -1}, ["objects[2].radius: expected a number > 0, got -1"]),
    "parallel edges": (
        {"objects.1.edge2": [2, 0, 0]},
        ["objects[1]: edge1 [1.0, 0.0, 0.0] and edge2 [2.0, 0.0, 0.0] span no area"],
    ),
    "edge of length 0": (
        {"objects.1.edge1": [0, 0, 0]},
        ["objects[1]: edge1 [0.0, 0.0, 0.0] and edge2 [0.0, 0.0, 1.0] span no area"],
    ),
    "too fine": ({"objects.2.subdivisions": 10}, ["objects[2].subdivisions: expected an integer from 0 to 9, got 10"]),
    "displacement through the centre": (
        {"objects.2.displacement": {"amplitude": 1}},
        ["objects[2].displacement.amplitude: expected a number >= 0 and < 1, got 1"],
    ),
    "15 numbers": (
        {"objects.3.transform": IDENTITY[:15]},
        [f"objects[3].transform: expected 16 numbers, row-major, got {IDENTITY[:15]}"],
    ),
    "singular transform": (
        {"objects.3.transform": [*IDENTITY[:10], 0, *IDENTITY[11:]]},
        [
            "objects[3].transform: expected an invertible matrix, not a singular one, "
            "got [1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 0, 0, 0, 0, 0, 1]"
        ],
    ),
    "projective transform": (
        {"objects.3.transform": [*IDENTITY[:14], 1, 1]},
        [
            "objects[3].transform: expected 16 numbers, row-major, of which the last row is 0, 0, 0, 1, "
            "got [1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1, 0, 0, 0, 1, 1]"
        ],
    ),
    # several at once
    "problems in every section": (
        {
            "integrator.spp": 0,
            "camera.fov": -3,
            "textures.grey.colour": [1, 1, 1],
            "materials.glass.eta": "two",
            "objects.0.material_name": "gleiss",
            "objects.3.path": "missing.obj",
        },
        [
            "integrator.spp: expected an integer from 1 to 2^30, got 0",
            "camera.fov: expected an angle in degrees between 0 and 180, got -3",
            'textures.grey.colour: unknown key; did you mean "color"?',
            'materials.glass.eta: expected a number > 0, got "two"',
            'objects[0].material_name: no material "gleiss"; did you mean "glass"?',
            "objects[3].path: FOLDER/missing.obj: cannot be read: no such file or directory",
        ],
    ),
    "broken objects keep the others' indices": (
        {"objects.0": 0, "objects.1": 1, "objects.3.material_name": "clay"},
        [
            "objects[0]: expected an object, got 0",
            "objects[1]: expected an object, got 1",
            'objects[3].material_name: no material "clay"; expected one of "grey_diffuse", "glass", "crystal"',
        ],
    ),
    "a broken material is not also missing": (
        {"materials.glass.eta": -1, "materials.glass.name": "glass"},
        [
            "materials.glass.eta: expected a number > 0, got -1",
            'materials.glass.name: unknown key; expected one of "type", "eta"',
        ],
    ),
    "two missing files": (
        {"objects.0": {"type": "mesh", "path": "a.obj", "material_name": "glass"}, "objects.3.path": "b.obj"},
        [
            "objects[0].path: FOLDER/a.obj: cannot be read: no such file or directory",
            "objects[3].path: FOLDER/b.obj: cannot be read: no such file or directory",
        ],
    ),
}


@pytest.mark.parametrize("case", MALFORMED)
def test_one_sentence_per_problem(case: str, tmp_path: Path) -> None:
    changes, sentences = MALFORMED[case]
    expected = [f"scene: {sentence}".replace("FOLDER", str(tmp_path)) for sentence in sentences]
    assert problems_of(changed(changes), tmp_path) == expected


@pytest.mark.parametrize(
    ("content", "problems"),
    [
        (b"", ["line 1, column 1: not valid JSON: the file is empty"]),
        (b'{"film": {', ["line 1, column 11: not valid JSON: expecting property name enclosed in double quotes"]),
        (b'{"film":\n [1, }', ["line 2, column 6: not valid JSON: expecting value"]),
        (b'{"film": "\x01"}', ["line 1, column 11: not valid JSON: invalid control character"]),
        (b"[1, 2]", ["expected a JSON object, got [1, 2]"]),
        (b"null", ["expected a JSON object, got null"]),
        (b'{"film": "\xff"}', ["expected UTF-8 text, found the byte 0xff at position 10"]),
        (b"[" * 100_000, ["arrays or objects are nested too deeply"]),
        (b'{"objects": ' + b"9" * 5000 + b"}", ["a number has too many digits"]),
        (
            b'{"film": {"a": 1, "a": 2, "a": 3}, "film": {}}',
            ['the key "a" occurs 3 times in one object', 'the key "film" occurs 2 times in one object'],
        ),
        (b'{"\\ud800": 1}', ["the key '\\ud800' holds characters that cannot be printed"]),
        (
            b'{"camera": {"fov": NaN, "position": [0, -Infinity, 0]}, '
            b'"objects": [{"type": "sphere", "radius": 1e999}]}',
            [
                "camera.position: expected 3 numbers from -1e30 to 1e30, got [0, -Infinity, 0]",
                "camera.fov: expected an angle in degrees between 0 and 180, got NaN",
                'objects[0]: missing key "center"',
                "objects[0].radius: expected a number > 0, got Infinity",
            ],
        ),
        (
            b"\xef\xbb\xbf" + b'{"a":' * 500 + b"1" + b"}" * 500,
            [
                'missing key "objects"',
                'a: unknown key; expected one of "integrator", "film", "camera", "textures", "materials", "lights", '
                '"objects"',
            ],
        ),
    ],
    ids=short,
)
def test_malformed_files(content: bytes, problems: list[str], tmp_path: Path) -> None:
    file = tmp_path / "scene.json"
    file.write_bytes(content)
    assert problems_of(file, tmp_path) == [f"{file}: {problem}" for problem in problems]


def test_unreadable_files(tmp_path: Path) -> None:
    assert problems_of(tmp_path / "no.json", tmp_path) == [
        f"{tmp_path}/no.json: cannot be read: no such file or directory"
    ]
    assert problems_of(tmp_path, tmp_path) == [f"{tmp_path}: expected a file, found a folder"]
    assert problems_of("/dev/null", tmp_path) == ["/dev/null: expected a file, found a device"]
    (problem,) = problems_of("example:cornel", tmp_path)
    assert problem == 'example:cornel: no example scene "cornel"; did you mean "cornell"?'


def test_malformed_dicts(tmp_path: Path) -> None:
    endless: dict[str, Any] = {}
    endless["film"] = endless
    assert problems_of(endless, tmp_path) == ["scene: arrays or objects are nested too deeply"]
    assert problems_of({1: 2}, tmp_path) == ["scene: expected a printable string as key, got 1"]
    assert problems_of({"objects": {1, 2}}, tmp_path) == [
        "scene: expected numbers, strings, lists or dicts, got a value of type set"
    ]
    with pytest.raises(UsageError, match="expected a file name or a dict, got int"):
        load_scene(3)  # type: ignore[arg-type]


def png_header(width: int, height: int) -> bytes:
    def chunk(kind: bytes, data: bytes) -> bytes:
        return struct.pack(">I", len(data)) + kind + data + struct.pack(">I", zlib.crc32(kind + data))

    header = struct.pack(">IIBBBBB", width, height, 8, 2, 0, 0, 0)
    return b"\x89PNG\r\n\x1a\n" + chunk(b"IHDR", header) + chunk(b"IDAT", zlib.compress(bytes(9))) + chunk(b"IEND", b"")


V = b"v 0 0 0\nv 1 0 0\nv 1 1 0\n"
GLTF = b'{"asset": {"version": "2.0"}%b}'


@pytest.mark.parametrize(
    ("name", "content", "problem"),
    [
        ("a.obj", b"", "the mesh has no triangle"),
        ("a.obj", b"hello", "the mesh has no triangle"),
        ("a.obj", V, "the mesh has no triangle"),
        ("a.obj", bytes(range(256)), "the mesh has no triangle"),
        ("a.obj", V + b"f 1 2 9\n", "not a readable OBJ mesh: a face refers to v 9, there are 3"),
        ("a.obj", V + b"f 0 1 2\n", "not a readable OBJ mesh: a face refers to index 0"),
        ("a.obj", V + b"f -4 -2 -1\n", "not a readable OBJ mesh: a face refers to index -4"),
        ("a.obj", V + b"f 1 2/1 3\n", "not a readable OBJ mesh: a face refers to vt 1, there are 0"),
        ("a.obj", V + b"f 1 2 x\n", "not a readable OBJ mesh: a face is not made of indices: 1 2 x"),
        ("a.obj", V + b"f 1 2 9" + b"9" * 30 + b"\n", "not a readable OBJ mesh: a face refers to v "),
        ("a.obj", b"v a b c\nf 1 1 1\n", "not a readable OBJ mesh: a coordinate is not a number"),
        ("a.obj", V + b"f 1 1 2\nf 1 2 2\n", 'none of the 2 triangles of "a.obj" has an area'),
        ("a.obj", b"v nan 0 0\n" + V + b"f 1 2 3\n", 'none of the 1 triangles of "a.obj" has an area'),
        ("a.ply", b"", "not a readable PLY mesh: "),
        ("a.stl", bytes(84), "the mesh has no triangle"),
        ("a.off", b"OFF\n3 1 0\n0 0 0\n1 0 0\n1 1 0\n3 0 1 7\n", "not a readable OFF mesh: "),
        ("a.glb", b"glTF", "it has no glTF header"),
        ("a.gltf", b"{}", 'missing key "asset"'),
        ("a.gltf", GLTF % b"", "the mesh has no triangle"),
        ("a.gltf", GLTF % b', "extensionsRequired": ["KHR_draco_x"]', 'it needs the glTF extension "KHR_draco_x"'),
        ("a.txt", b"", "expected a mesh file ending in .obj, .ply, .stl, .off, .glb, .gltf"),
        ("a.png", b"hello", "not a readable image: Not a PNG file"),
        ("a.exr", b"", "not a readable image: "),
        ("b.txt", b"hello", "not a readable image: OpenImageIO could not find a format reader"),
        ("a.png", png_header(32769, 1), "the image has 32769 x 1 pixels, expected at most 32768 on a side"),
        ("a.png", png_header(2**31 - 1, 2**31 - 1), "not a readable image: "),
        ("a.png", png_header(8, 8), "not a readable image: "),
    ],
    ids=short,
)
def test_unreadable_assets(name: str, content: bytes, problem: str, tmp_path: Path) -> None:
    (tmp_path / name).write_bytes(content)
    mesh = name[0] == "a" and name not in ("a.png", "a.exr")
    entry = "objects[3]" if mesh else "textures.grey"
    changes = {"objects.3.path": name} if mesh else {"textures.grey": {"type": "image", "path": name}}
    (found,) = problems_of(changed(changes), tmp_path)
    assert found.startswith(f"scene: {entry}.path: ")
    assert problem in found


def test_images_with_values_that_are_not_finite(tmp_path: Path) -> None:
    pixels = np.full((2, 3, 3), 0.5, np.float32)
    pixels[0, 1] = NAN
    file = oiio.ImageOutput.create(str(tmp_path / "nan.exr"))
    assert file is not None
    assert file.open(str(tmp_path / "nan.exr"), oiio.ImageSpec(3, 2, 3, "float"))
    assert file.write_image(pixels)
    file.close()
    scene = changed({"textures.grey": {"type": "image", "path": "nan.exr"}})
    assert problems_of(scene, tmp_path) == [f"scene: textures.grey.path: {tmp_path}/nan.exr: 1 pixels are not finite"]


@pytest.mark.parametrize(
    ("path", "value", "problem"),
    [
        ("camera.fov", 0, "camera.fov: expected an angle in degrees between 0 and 180, got 0"),
        ("camera.fow", 3, 'camera.fow: unknown key; did you mean "fov"?'),
        ("camra.fov", 3, 'camra: unknown key; did you mean "camera"?'),
        ("camera.fov.x", 3, 'camera.fov.x: no "x" in camera.fov, which is 19.5'),
        ("objects.9.radius", 1, 'objects.9.radius: no "9" in objects; expected an index from 0 to 3'),
        ("objects.x.radius", 1, 'objects.x.radius: no "x" in objects; expected an index from 0 to 3'),
        ("objects[9].radius", 1, 'objects[9].radius: no "9" in objects; expected an index from 0 to 3'),
        ("objects.-1.radius", 1, 'objects.-1.radius: no "-1" in objects; expected an index from 0 to 3'),
        ("objects.-1", 1, 'objects.-1: no "-1" in objects; expected an index from 0 to 3'),
        ("camera.position.3", 1, 'camera.position.3: no "3" in camera.position; expected an index from 0 to 2'),
        ("textures.gray.color", [0, 0, 0], 'textures.gray.color: no "gray" in textures; did you mean "grey"?'),
        ("objects.0.light.radiance", [1], "objects[0].light.radiance: expected 3 numbers from 0 to 1e30, got [1]"),
        ("camera.fov", object(), "expected numbers, strings, lists or dicts, got a value of type object"),
        ("\udcff", 1, "'\\udcff' holds characters that cannot be printed"),
    ],
)
def test_malformed_overrides(path: str, value: Any, problem: str, tmp_path: Path) -> None:
    assert problems_of(changed({}), tmp_path, overrides={path: value}) == [f"scene: {problem}"]


def test_an_override_of_an_entry_where_there_are_none_is_one_problem(tmp_path: Path) -> None:
    scene = changed({})
    del scene["lights"]
    found = problems_of(scene, tmp_path, overrides={"lights.0.flux": [1, 1, 1]})
    assert found == ['scene: lights.0.flux: no "0" in lights, which is empty']


def test_every_problem_of_file_and_overrides_at_once(tmp_path: Path) -> None:
    file = tmp_path / "scene.json"
    file.write_text(json.dumps(changed({"film.resolution": [0, 0]})))
    found = problems_of(file, tmp_path, overrides={"objects.7.radius": 1, "camera.fov": 200})
    assert [problem.split(": ")[1] for problem in found] == ["objects.7.radius", "film.resolution", "camera.fov"]
