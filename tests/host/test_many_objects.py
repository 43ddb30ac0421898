"""Scenes of many objects: read, placed and gathered together, with what each alone would give."""

from __future__ import annotations

import gc
import json
import random
from dataclasses import replace

import numpy as np
import pytest

from pyrt import scene_json, scene_objects
from pyrt.errors import PyrtError, SceneError
from pyrt.geometry import gather_triangles
from pyrt.pack import pack_scene
from pyrt.scene import Mesh, Scene
from pyrt.scene_io import load_scene

OBJ = """v 0 0 0
v 1 0 0
v 0 1 0
v 1 1 0.5
v 1 1 0.5
vt 0 0
vt 1 0
vt 0.3 1
vn 0 0 1
vn 0 0.6 0.8
f 1/1/1 2/2/2 3/3/1
f 2/1/1 4/2/1 5/3/2
f 2/1/1 4/2/1 3/3/2
"""  # its second triangle has no area
MATERIALS = {"m": {"type": "diffuse", "texture_name": "t"}, "n": {"type": "diffuse", "color": [0.5, 0.5, 0.5]}}


def draw_object(random: random.Random) -> dict:
    """An object of any kind; half of the meshes turned or mirrored, a few of all are lights."""

    def vector(size=1):
        return [random.uniform(-size, size) for _ in range(3)]

    kind = random.choice(["sphere", "rectangle", "mesh", "mesh", "icosphere"])
    own = {
        "sphere": {"center": vector(5), "radius": 0.1},
        "rectangle": {"center": vector(5), "edge1": vector(), "edge2": vector()},
        "mesh": {"path": "a.obj", "translate": vector(5)},
        "icosphere": {"center": vector(5), "subdivisions": random.choice([0, 1]), "smooth": random.random() < 0.5},
    }[kind]
    if kind == "mesh" and random.random() < 0.5:
        own["transform"] = [*vector(), 0, *vector(), 1, *vector(), 2, 0, 0, 0, 1]
    if random.random() < 0.05:
        own["light"] = {"radiance": [1, 2, 3]}
    return {"type": kind, "material_name": random.choice("mn"), **own}


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    folder = tmp_path_factory.mktemp("scene")
    (folder / "a.obj").write_text(OBJ)
    return folder


def loaded(folder, objects) -> Scene:
    scene = {"materials": MATERIALS, "textures": {"t": {"type": "checkerboard"}}, "objects": objects}
    return load_scene(scene, base_dir=folder)


OBJECTS = [draw_object(random.Random(seed)) for seed in range(80)]


def test_instances_are_placed_as_each_alone(folder):
    together = loaded(folder, OBJECTS).shapes
    for given, shape in zip(OBJECTS, together, strict=True):
        (alone,) = loaded(folder, [given]).shapes
        assert type(alone) is type(shape)
        for name in ("vertices", "triangles", "uvs", "normals") if isinstance(shape, Mesh) else ():
            np.testing.assert_array_equal(getattr(alone, name), getattr(shape, name))


def test_many_small_shapes_are_gathered_as_each_alone(folder):
    scene = loaded(folder, OBJECTS)
    together = gather_triangles(scene)
    alone = [gather_triangles(Scene(shapes=(shape,))) for shape in scene.shapes]
    assert together.dropped == sum(of.dropped for of in alone) > 0
    np.testing.assert_array_equal(together.corners, np.concatenate([of.corners for of in alone]))
    np.testing.assert_array_equal(together.source, np.concatenate([of.source for of in alone]))
    counts = [len(of.source) for of in alone]
    np.testing.assert_array_equal(together.shape, np.repeat(np.arange(len(alone)), counts))


def test_corners_of_many_shapes_are_packed_as_each_alone(folder):
    scene = loaded(folder, [{**given, "material_name": "m"} for given in OBJECTS if "light" not in given])
    alone = [pack_scene(replace(scene, shapes=(shape,))).arrays["corners"] for shape in scene.shapes]
    np.testing.assert_array_equal(pack_scene(scene).arrays["corners"], np.concatenate(alone))


@pytest.mark.parametrize("place", [0, 7, 8, 19])
def test_problems_name_their_place_in_any_part(folder, monkeypatch, place):
    monkeypatch.setattr(scene_objects, "_PART", 4)
    ball = {"type": "sphere", "center": [0, 0, 0], "radius": 1, "material_name": "m"}
    objects = [ball] * 20
    objects[place] = {**ball, "radius": "two", "material_name": "k"}
    with pytest.raises(SceneError) as caught:
        loaded(folder, objects)
    assert caught.value.problems == [f'scene: objects[{place}].radius: expected a number > 0, got "two"']
    objects[place] = {**ball, "material_name": "k"}
    with pytest.raises(SceneError, match=rf'scene: objects\[{place}\].material_name: no material "k"'):
        loaded(folder, objects)


def test_the_collector_is_as_it_was(folder):
    for switch in (gc.disable, gc.enable):
        switch()
        before = gc.isenabled()
        loaded(folder, OBJECTS[:1])
        with pytest.raises(SceneError):
            loaded(folder, [])
        assert gc.isenabled() == before


def test_a_file_that_memory_cannot_hold_is_not_read(tmp_path, monkeypatch):
    path = tmp_path / "scene.json"
    path.write_text(json.dumps({"objects": [OBJECTS[0]] * 10_000}))
    monkeypatch.setattr(scene_json, "available", lambda: 2.0**20)
    expected = r"scene.json: expected about 0.\d+ GiB of free memory to read \d MiB of JSON, found 0.000977 GiB"
    with pytest.raises(PyrtError, match=expected):
        load_scene(path)
    monkeypatch.setattr(scene_json, "available", lambda: 2.0**30)
    with pytest.raises(SceneError, match="no material"):  # it is read
        load_scene(path)
