"""What goes wrong in the first hour: each mistake ends in one sentence that says what to do, and in its exit code."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest
import trimesh

import pyrt
from pyrt.cli import main
from pyrt.errors import UsageError
from pyrt.image_io import write_image
from pyrt.request import request_for
from pyrt.scene import Scene

SCENE = {
    "camera": {"position": [0, 0, 4]},
    "materials": {"grey": {"type": "diffuse", "color": [0.5, 0.5, 0.5]}},
    "objects": [{"type": "sphere", "center": [0, 0, 0], "radius": 1, "material_name": "grey"}],
}
TEXTURED = {"grey": {"type": "diffuse", "texture_name": "wood"}}
MESH = [{"type": "mesh", "path": "gone.obj", "material_name": "grey"}]
BROKEN = {
    "key.json": {"flim": {}},
    "type.json": {"camera": {"fov": "two"}},
    "nan.json": {"camera": {"position": [0, float("nan"), 4]}},
    "huge.json": {"film": {"resolution": [10**9, 10**9]}},
    "inside.json": {"camera": {"position": [0, 0, 0]}},
    "texture.json": {"materials": TEXTURED, "textures": {"wood": {"type": "image", "path": "gone.png"}}},
    "folder.json": {"materials": TEXTURED, "textures": {"wood": {"type": "image", "path": "folder"}}},
    "mesh.json": {"objects": MESH},
}


@pytest.fixture(scope="module")
def files(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A folder with good files and broken ones."""
    folder = tmp_path_factory.mktemp("first hour")
    (folder / "folder").mkdir()
    for name, change in {"scene.json": {}, **BROKEN}.items():
        (folder / name).write_text(json.dumps({**SCENE, **change}))
    (folder / "cut.json").write_text('{"film": {"resolution": [64, 64]')
    trimesh.creation.icosphere(1).export(folder / "ball.glb")
    (folder / "cut.glb").write_bytes((folder / "ball.glb").read_bytes()[:300])
    (folder / "cut.ply").write_text("ply\nformat ascii")
    (folder / "points.obj").write_text("v 0 0 0\nv 1 0 0\nv 0 1 0\n")
    write_image(folder / "small.exr", np.ones((4, 4, 3)))
    write_image(folder / "large.exr", np.ones((64, 64, 3)))
    (folder / "cut.exr").write_bytes((folder / "large.exr").read_bytes()[:500])
    return folder


@pytest.mark.parametrize(
    ("command", "code", "message"),
    [
        ("render gone.json", 3, "gone.json: cannot be read: no such file or directory"),
        ("render folder", 3, "folder: expected a file, found a folder"),
        ("render cut.json", 3, "cut.json: line 1, column 33: not valid JSON: expecting ',' delimiter"),
        ("render key.json", 3, 'key.json: flim: unknown key; did you mean "film"?'),
        ("render type.json", 3, 'camera.fov: expected an angle in degrees between 0 and 180, got "two"'),
        ("render nan.json", 3, "camera.position: expected 3 numbers from -1e30 to 1e30, got [0, NaN, 4]"),
        ("render huge.json", 3, "film.resolution: expected width and height, 2 integers from 1 to 65536 with"),
        ("render inside.json", 3, "camera.look_at: expected another point than the camera's position"),
        ("render texture.json", 3, "textures.wood.path: gone.png: cannot be read: no such file"),
        ("render folder.json", 3, "textures.wood.path: folder: expected a file, found a folder"),
        ("render mesh.json", 3, "objects[0].path: gone.obj: cannot be read: no such file"),
        ("render cut.glb", 3, "cut.glb: its header says "),
        ("render cut.ply", 3, "cut.ply: not a readable PLY mesh: it is damaged"),
        ("render points.obj", 3, "points.obj: the mesh has no triangle"),
        ("render model.blend", 3, "expected a scene (.json) or a model (.obj,"),
        ("render small.exr", 3, "expected a scene (.json) or a model; pictures are for: pyrt view"),
        ("render example:cornel", 3, 'no example scene "cornel"; did you mean "cornell"?'),
        ("render scene.json --set camera.fvo=3", 3, 'camera.fvo: unknown key; did you mean "fov"?'),
        ("render scene.json --dry-run --size 0x0", 2, "width: expected a whole number from 1 to 65536, got 0"),
        (
            "render scene.json --dry-run --size 99999999x1",
            2,
            "width: expected a whole number from 1 to 65536, got 99999999",
        ),
        ("render scene.json --dry-run --spp -3", 2, "spp: expected a whole number from 1 to 1073741824, got -3"),
        ("render scene.json --aov depth", 2, "aov: expected some of z, distance, position"),
        ("render scene.json --dry-run --crop 5,5,5,5", 2, "crop: expected x0,y0,x1,y1 inside the picture, 512 x 512"),
        ("render scene.json -o folder", 2, "folder: expected a name ending in .exr"),
        ("render scene.json -o gone/a.png", 2, "gone/a.png: there is no folder gone"),
        ("render scene.json -o a.gif", 2, "a.gif: expected a name ending in .exr"),
        ("render scene.json --stats folder", 2, "folder: expected a file name, found a folder"),
        ("render scene.json --stats gone/a.json", 2, "gone/a.json: there is no folder gone"),
        ("render scene.json --no-clobber -o small.exr", 2, "small.exr: exists already, and --no-clobber forbids"),
        ("render scene.json --checkpoint 9s -o a.png", 2, "expected an output ending in .exr, which can be continued"),
        ("render scene.json --view nice -o a.png", 2, 'view: expected one of aces, srgb, raw, got "nice"'),
        ("merge small.exr large.exr -o a.exr", 2, "small.exr: expected a file that pyrt wrote with --checkpoint"),
        ("diff small.exr large.exr", 2, "expected two pictures of one size, got 4 x 4 and 64 x 64 pixels"),
        ("diff small.exr gone.exr", 2, "gone.exr: cannot be read: no such file"),
        ("diff folder small.exr", 2, "folder: expected a file, found a folder"),
        ("view cut.exr", 2, "cut.exr: not a readable image: "),
        ("view gone.exr", 2, "gone.exr: cannot be read: no such file"),
        ("info folder", 3, "folder: expected a file, found a folder"),
        ("render scene.json --exposure 1 -o a.exr", 2, "--exposure, --view: expected an output ending in .png or .jpg"),
        ("merge small.exr -o a.exr --view aces", 2, "--exposure, --view: expected an output ending in .png or .jpg"),
        ("render scene.json --float -o a.png", 2, "--aov, --float: expected an output ending in .exr"),
        ("render scene.json --threads 9999", 2, "as many as there are cores, got 9999"),
        ("render scene.json --aov uv,", 2, 'denoising_normal, variance, samples, got ""'),
        ("render scene.json --dry-run --samples 0:4 --noise 0.1", 2, "samples: expected no noise target or time limit"),
        (
            "render scene.json --dry-run --samples 5:5 -o a.exr",
            2,
            "samples: expected 0 <= first < end <= 2^30, got 5:5",
        ),
        ("render scene.json --set objects.7.radius=3", 3, 'no "7" in objects; expected an index from 0 to 0'),
        ("diff small.exr scene.json", 2, "scene.json: not a readable image: "),
    ],
)
def test_a_mistake_is_one_sentence(command, code, message, files, monkeypatch, capsys):
    monkeypatch.chdir(files)
    before = sorted(files.iterdir())
    assert main(command.split()) == code
    out, error = capsys.readouterr()
    assert message in error
    assert error.count("\n") == 1
    assert out == ""
    assert sorted(files.iterdir()) == before


@pytest.mark.parametrize(
    ("command", "message"),
    [
        ("scene.json", 'no verb "scene.json"; did you mean pyrt render?'),
        ("merge small.exr -o a.exr --spp 4", "no option --spp; there are --exposure, --help, --output, --view"),
        ("render scene.json --spp 4.5", 'argument --spp: expected a whole number, got "4.5"'),
        ("render scene.json --noise 5%", 'argument --noise: expected a number, got "5%"'),
        ("render scene.json --size 64", 'argument --size: expected WIDTHxHEIGHT such as 640x480, got "64"'),
    ],
)
def test_wrong_usage_shows_the_right_one(command, message, files, monkeypatch, capsys):
    monkeypatch.chdir(files)
    assert main(command.split()) == 2
    usage, error = capsys.readouterr().err.splitlines()
    assert usage.startswith("usage: pyrt ")
    assert message in error


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        ({"size": (1, 2, 3)}, "size: expected two whole numbers, got (1, 2, 3)"),
        ({"size": 64}, "size: expected two whole numbers, got 64"),
        ({"size": "64x48"}, "size: expected two whole numbers, got '64x48'"),
        ({"samples": 5}, "samples: expected two whole numbers, got 5"),
        ({"samples": (0.0, 4.0)}, "samples: expected two whole numbers, got (0.0, 4.0)"),
        ({"noise": "0.1"}, "noise: expected a number > 0, got '0.1'"),
        ({"time_limit": "5s"}, "time_limit: expected a number > 0, got '5s'"),
        ({"checkpoint_every": "60s"}, "checkpoint_every: expected a number >= 0, got '60s'"),
        ({"crop": "0,0,4,4"}, "crop: expected x0,y0,x1,y1 inside the picture, 512 x 512, got 0,0,4,4"),
        ({"crop": 4}, "crop: expected x0,y0,x1,y1 inside the picture, 512 x 512, got 4"),
        ({"aovs": "z,uv"}, 'variance, samples, got "z,uv"'),
        ({"checkpoint": "a.png"}, "a.png: expected a name ending in .exr"),
    ],
)
def test_a_wrong_argument_in_python_is_one_sentence_too(arguments, message):
    with pytest.raises(UsageError) as error:
        request_for(Scene(), **arguments)
    assert message in str(error.value)


def test_one_name_for_several_in_python():
    assert request_for(Scene(), aovs="uv").aovs == ("uv",)
    with pytest.raises(UsageError, match="merge: expected a list of files, got the single name a"):
        pyrt.merge("a.exr")
    with pytest.raises(UsageError, match="scene: expected what load_scene returns, got str"):
        pyrt.Renderer("scene.json")


def test_without_a_mistake_there_is_no_complaint(files, monkeypatch, capsys):
    monkeypatch.chdir(files)
    for command in ("validate scene.json", "validate ball.glb", "view large.exr", "diff small.exr small.exr"):
        assert main(command.split()) == 0
    assert capsys.readouterr().err == ""
