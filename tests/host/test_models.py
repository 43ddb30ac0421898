"""Mesh files and trimesh objects as scenes: their colours, a camera that shows all of them, a floor and lamps."""

from __future__ import annotations

import math
import warnings
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import trimesh
from hypothesis import given
from hypothesis import strategies as st

import pyrt
from pyrt.camera import film_plane, world_to_ndc
from pyrt.errors import SceneError, UsageError
from pyrt.image_io import srgb_to_linear, write_image
from pyrt.mesh_data import MeshData
from pyrt.procedural import icosphere
from pyrt.scene import ConstantTexture, Dielectric, Diffuse, ImageTexture, Mesh, Rectangle, Scene, SpotLight
from pyrt.scene_hash import scene_hash
from pyrt.scene_io import load_scene
from pyrt.smooth import smoothed
from tests.gltf_files import GltfFile
from tests.strategies import damaged, examples


def box(scale: float = 1.0) -> str:
    corners = [(x * scale, y * scale, z * scale) for x in (0, 2) for y in (0, 1) for z in (0, 3)]
    faces = "f 1 2 4 3\nf 5 7 8 6\nf 1 5 6 2\nf 3 4 8 7\nf 1 3 7 5\nf 2 6 8 4\n"
    return "".join(f"v {x!r} {y!r} {z!r}\n" for x, y, z in corners) + faces


BOX = box()
SQUARE = "v 0 0 0\nv 1 0 0\nv 1 1 0\nv 0 1 0\nvt 0 0\nvt 1 0\nvt 1 1\nvt 0 1\n"


def load(tmp_path: Path, text: str, name: str = "model.obj", **overrides: Any) -> Scene:
    path = tmp_path / name
    path.write_text(text)
    return load_scene(path, overrides={key.replace("__", "."): value for key, value in overrides.items()})


def mesh_of(scene: Scene) -> Mesh:
    (mesh,) = (shape for shape in scene.shapes if isinstance(shape, Mesh))
    return mesh


def on_film(scene: Scene, points: Any) -> np.ndarray:
    """Positions in fractions of the film."""
    size = scene.film.width, scene.film.height
    plane = film_plane(scene.camera, *size)
    homogeneous = np.c_[np.asarray(points, float), np.ones(len(points))] @ world_to_ndc(plane, *size)
    assert (homogeneous[:, 3] > 0).all()
    return homogeneous[:, :2] / homogeneous[:, 3:]


@pytest.mark.parametrize("size", [(512, 512), (640, 200), (100, 400)])
@pytest.mark.parametrize("camera", [{}, {"camera__fov": 90}, {"camera__intrinsics": {"fx": 400, "fy": 300}}])
@pytest.mark.parametrize("scale", [1.0, 1e-6, 1e9])
def test_the_camera_shows_the_whole_model(
    size: tuple[int, int], camera: dict[str, Any], scale: float, tmp_path: Path
) -> None:
    scene = load(tmp_path, box(scale), film__resolution=list(size), **camera)
    ends = on_film(scene, mesh_of(scene).vertices)
    extent = np.ptp(ends, axis=0)
    # it fills the film but for the margin in one direction, and is in the middle
    assert extent.max() == pytest.approx(1 / 1.12)
    off = ends.min(axis=0) + ends.max(axis=0) - 1
    assert off[extent.argmax()] == pytest.approx(0, abs=1e-9)
    assert off[extent.argmin()] == pytest.approx(0, abs=0.2)


def test_it_stands_on_the_floor_below_the_lamps(tmp_path: Path) -> None:
    scene = load(tmp_path, BOX)
    lamps = [s for s in scene.shapes if isinstance(s, Rectangle) and s.radiance]
    (floor,) = (s for s in scene.shapes if isinstance(s, Rectangle) and not s.radiance)
    assert -1e-3 < floor.center[1] < 0
    assert np.cross(floor.edge1, floor.edge2) @ [0, 1, 0] > 0
    center = mesh_of(scene).vertices.mean(axis=0)
    for lamp in lamps:
        assert np.cross(lamp.edge1, lamp.edge2) @ (center - lamp.center) > 0  # faces the model
    assert len(lamps) == 3


@pytest.mark.parametrize(("size", "at"), [((512, 512), 0.0), ((900, 300), 0.0), ((200, 600), 0.0)])
def test_the_floor_fills_the_film_and_no_lamp_is_on_it(size: tuple[int, int], at: float, tmp_path: Path) -> None:
    scene = load(tmp_path, BOX, film__resolution=list(size))
    plane = film_plane(scene.camera, *size)
    (floor,) = (s for s in scene.shapes if isinstance(s, Rectangle) and not s.radiance)
    for x in (at, size[0]):
        for y in (at, size[1]):
            direction = plane.corner + x * plane.dx + y * plane.dy
            assert direction[1] < 0
            hit = plane.position + direction * ((floor.center[1] - plane.position[1]) / direction[1])
            local = (hit - floor.center) @ np.transpose([floor.edge1, floor.edge2]) / np.dot(floor.edge1, floor.edge1)
            assert np.abs(local).max() < 0.5
            for lamp in (s for s in scene.shapes if isinstance(s, Rectangle) and s.radiance):
                assert not crosses(lamp, plane.position, hit)


def crosses(lamp: Rectangle, start: np.ndarray, end: np.ndarray) -> bool:
    matrix = np.transpose([lamp.edge1, lamp.edge2, start - end])
    u, v, t = np.linalg.solve(matrix, start - lamp.center)
    return bool(abs(u) < 0.5 and abs(v) < 0.5 and 0 < t < 1)


def test_up_follows_the_format_and_the_setting(tmp_path: Path) -> None:
    vertices, triangles = icosphere(0)
    trimesh.Trimesh(vertices, triangles, process=False).export(tmp_path / "ball.stl")
    stl = load_scene(tmp_path / "ball.stl")
    assert stl.camera.up == (0, 0, 1)
    assert stl.camera.position[2] > 0
    assert stl.camera.position[1] < 0  # the front is -y
    assert load(tmp_path, BOX).camera.up == (0, 1, 0)
    turned = load(tmp_path, BOX, camera__ref_up=[0, 0, 2])
    (floor,) = (s for s in turned.shapes if isinstance(s, Rectangle) and not s.radiance)
    assert floor.center[2] < 0 < abs(floor.edge1[0]) + abs(floor.edge1[1])


def test_what_the_user_sets_stays(tmp_path: Path) -> None:
    scene = load(
        tmp_path, BOX, camera__position=[9, 9, 9], camera__fov=20, lights=[{"position": [0, 9, 0], "flux": [1, 1, 1]}]
    )
    assert (scene.camera.position, scene.camera.fov) == ((9, 9, 9), 20)
    np.testing.assert_allclose(scene.camera.look_at, [1, 0.5, 1.5])
    assert [light.position for light in scene.lights] == [(0, 9, 0)]
    assert not any(shape.radiance for shape in scene.shapes)


def test_a_position_of_the_users_keeps_floor_and_lamps(tmp_path: Path) -> None:
    scene = load(tmp_path, BOX, camera__position=[9, 9, 9])
    assert len(scene.shapes) == len(load(tmp_path, BOX).shapes) == 5


@pytest.mark.parametrize("position", [[9, 2, 0], [-9, 5, 3], [0, 1, -9]])
def test_the_key_light_is_to_the_left_of_any_camera(position: list[float], tmp_path: Path) -> None:
    scene = load(tmp_path, BOX, camera__position=position)
    key = next(shape for shape in scene.shapes if isinstance(shape, Rectangle))
    right = film_plane(scene.camera, 512, 512).dx
    center = mesh_of(scene).vertices.mean(axis=0)
    assert (key.center - center) @ right < 0 < (key.center - center) @ (position - center)


@pytest.mark.parametrize("name", ["no.glb", "no.obj"])
def test_a_missing_model_is_named_once(name: str, tmp_path: Path) -> None:
    with pytest.raises(SceneError, match=r"^[^:]*/no\.\w+: cannot be read: no such file or directory$"):
        load_scene(tmp_path / name)


def test_formats_to_convert_are_named(tmp_path: Path) -> None:
    with pytest.raises(SceneError, match=r"a\.fbx: expected a scene \(\.json\) or a model \(\.obj, .*Blender"):
        load_scene(tmp_path / "a.fbx")


def test_a_light_inside_a_room_that_has_only_a_camera(tmp_path: Path) -> None:
    file = GltfFile(cameras=[{"type": "perspective", "perspective": {"yfov": 1}}], nodes=[{"mesh": 0}, {"camera": 0}])
    file.mesh([[-1, -1, -1], [1, -1, -1], [0, 1, 1]])
    scene = load_scene(file.save(tmp_path / "room.glb"))
    assert [light.position for light in scene.lights] == [scene.camera.position]
    assert len(scene.shapes) == 1


def test_obj_materials(tmp_path: Path) -> None:
    write_image(tmp_path / "dots.png", np.full((1, 2, 3), 0.5, np.float32))
    (tmp_path / "my.mtl").write_text(
        "newmtl red\nKd 0.5 0.25 0\nnewmtl dots\nKd 0 0 0\nmap_Kd dots.png\nnewmtl lamp\nKe 3 2 1\n"
        "newmtl glass\nNi 1.4\nillum 7\nd 0.5\n"
    )
    faces = "".join(f"usemtl {name}\nf 1/1 2/2 3/3 4/4\n" for name in ("red", "dots", "lamp", "glass", "red", "none"))
    scene = load(tmp_path, "mtllib my.mtl\n" + SQUARE + faces)
    by_radiance = [(len(s.triangles), s.radiance) for s in scene.shapes if isinstance(s, Mesh)]
    assert by_radiance == [(4, None), (2, None), (2, (3, 2, 1)), (2, None), (2, None)]
    red, dots, _, glass, neutral = (scene.materials[s.material or 0] for s in scene.shapes)
    assert isinstance(red, Diffuse)
    assert scene.textures[red.texture] == ConstantTexture((0.5, 0.25, 0))
    assert isinstance(dots, Diffuse)
    image = scene.textures[dots.texture]
    assert isinstance(image, ImageTexture)
    assert (image.scale, image.delta) == ((1, -1), (0, 1))  # v runs upwards
    assert glass == Dielectric(1.4)
    assert isinstance(neutral, Diffuse)
    assert scene.warnings == (f"{tmp_path}/model.obj: its materials' d (1 times) are not rendered",)


def test_missing_obj_materials_and_images_are_named(tmp_path: Path) -> None:
    text = "mtllib no.mtl\n" + SQUARE + "usemtl red\nf 1 2 3\n"
    reason = "cannot be read: no such file or directory"
    place = f"{tmp_path}/model.obj: {tmp_path}"
    assert load(tmp_path, text).warnings == (f"{place}/no.mtl: {reason}; its materials are grey",)
    (tmp_path / "no.mtl").write_text("newmtl red\nmap_Kd no.png\n")
    assert load(tmp_path, text).warnings == (f"{place}/no.png: {reason}; the colour of the material is used",)


def test_colours_of_positions(tmp_path: Path) -> None:
    scene = load(tmp_path, "v 0 0 0 1 0 0\nv 1 0 0 0 1 0\nv 1 1 0 0 0 1\nf 1 2 3\n")
    assert isinstance(scene.textures[0], ImageTexture)
    np.testing.assert_allclose(scene.textures[0].pixels, [[[1, 0, 0], [0, 1, 0]], [[0, 0, 1], [-1, 1, 1]]])
    path = tmp_path / "ball.ply"
    vertices, triangles = icosphere(0)
    trimesh.Trimesh(vertices, triangles, process=False, vertex_colors=[[64, 128, 255]] * 12).export(path)
    (color, _) = load_scene(path).textures
    assert isinstance(color, ConstantTexture)
    np.testing.assert_allclose(color.color, srgb_to_linear(np.array([64, 128, 255]) / 255))


def test_smoothing_keeps_edges_and_rounds_the_rest() -> None:
    vertices, triangles = icosphere(3)
    ball = smoothed(MeshData(vertices, triangles))
    assert ball.normals is not None
    np.testing.assert_allclose(ball.normals, vertices[triangles], atol=0.02)
    box = trimesh.creation.box()
    cube = smoothed(MeshData(np.array(box.vertices), np.array(box.faces, np.int32)))
    assert cube.normals is not None
    np.testing.assert_allclose(cube.normals, np.repeat(box.face_normals[:, None], 3, axis=1), atol=1e-6)
    # the side of a cylinder is round up to its rims, which are sharp, also where no vertex is shared
    rod = trimesh.creation.cylinder(1, 2, sections=24)
    soup = smoothed(
        MeshData(rod.triangles.reshape(-1, 3), np.arange(3 * len(rod.faces), dtype=np.int32).reshape(-1, 3))
    )
    assert soup.normals is not None
    side = np.abs(rod.face_normals[:, 2]) < 0.5
    radial = rod.triangles[side] * [1, 1, 0]
    np.testing.assert_allclose(soup.normals[side], radial, atol=0.02)
    np.testing.assert_allclose(np.abs(soup.normals[~side]), [[[0, 0, 1]] * 3] * (~side).sum(), atol=1e-6)


def test_smoothing_leaves_given_normals() -> None:
    vertices, triangles = icosphere(0)
    mesh = MeshData(vertices, triangles, normals=np.zeros((20, 3, 3), np.float32))
    assert smoothed(mesh) is mesh


def test_the_camera_stands_to_the_right_of_the_front(tmp_path: Path) -> None:
    camera = load(tmp_path, BOX).camera
    away = np.subtract(camera.position, camera.look_at)
    assert math.degrees(math.atan2(away[0], away[2])) == pytest.approx(30, abs=1e-9)


def test_a_trimesh_is_the_scene_of_its_file(tmp_path: Path) -> None:
    vertices, triangles = icosphere(1)
    ball = trimesh.Trimesh(np.round(vertices * 1024) / 1024, triangles, process=False)  # exact in the file
    ball.export(tmp_path / "ball.ply")
    assert ball.vertex_normals is not None  # that they have been computed changes nothing
    assert scene_hash(pyrt.from_trimesh(ball)) == scene_hash(load_scene(tmp_path / "ball.ply"))


def test_trimesh_colours_and_images() -> None:
    box = trimesh.creation.box()
    box.visual.face_colors = np.arange(36).reshape(12, 3) * 7
    texture = pyrt.from_trimesh(box).textures[0]
    assert isinstance(texture, ImageTexture)
    np.testing.assert_allclose(texture.pixels[:2, :2][0, 0], srgb_to_linear(np.array([0, 7, 14]) / 255), rtol=1e-6)

    class Picture:
        """What a PIL image looks like."""

        def convert(self, mode: str) -> Any:
            assert mode == "RGB"
            return np.full((2, 3, 3), 255, np.uint8)

    square = trimesh.Trimesh([[0, 0, 0], [1, 0, 0], [1, 1, 0]], [[0, 1, 2]], process=False)
    square.visual = trimesh.visual.TextureVisuals(uv=[[0, 0], [1, 0], [1, 1]])
    square.visual.material = trimesh.visual.material.PBRMaterial(baseColorFactor=[255, 0, 51, 255])
    square.visual.material._data["baseColorTexture"] = Picture()
    scene = pyrt.from_trimesh(square)
    assert isinstance(scene.textures[0], ImageTexture)
    np.testing.assert_allclose(scene.textures[0].pixels, np.broadcast_to([1, 0, 0.2], (2, 3, 3)), rtol=1e-6)
    assert scene.textures[0].scale == (1, -1)


def test_trimesh_scenes_keep_places_camera_and_lights() -> None:
    group = trimesh.Scene()
    turn = trimesh.transformations.rotation_matrix(0.5, [0, 1, 0], [1, 2, 3])
    group.add_geometry(trimesh.creation.box(), node_name="turned", transform=turn)
    group.add_geometry(trimesh.points.PointCloud([[0, 0, 0]]), node_name="cloud")
    alone = pyrt.from_trimesh(group, overrides={"film.resolution": [80, 60]})
    np.testing.assert_allclose(mesh_of(alone).vertices.mean(axis=0), turn[:3, :3] @ [0, 0, 0] + turn[:3, 3], atol=1e-12)
    assert (alone.film.width, alone.film.height) == (80, 60)
    assert alone.warnings == ("model: 'cloud': it is no mesh, and left out",)
    assert len([shape for shape in alone.shapes if shape.radiance]) == 3

    lamp = trimesh.scene.lighting.PointLight(name="lamp", color=[255, 0, 0, 255], intensity=2)
    pose = trimesh.transformations.translation_matrix([0, 0, 9])
    group = trimesh.Scene(trimesh.creation.box(), camera=trimesh.scene.Camera(resolution=(200, 100), fov=(60, 32)))
    group.camera_transform = pose
    group.lights = [lamp]
    group.graph["lamp"] = pose
    seen = pyrt.from_trimesh(group)
    assert (seen.camera.position, seen.camera.up, seen.film.width) == ((0, 0, 9), (0, 1, 0), 200)
    assert seen.camera.look_at[2] < 9
    assert seen.camera.fov == pytest.approx(32)
    assert [light.flux for light in seen.lights] == [pytest.approx((8 * math.pi, 0, 0))]
    assert not any(shape.radiance for shape in seen.shapes)

    group.lights = [trimesh.scene.lighting.SpotLight(name="lamp", color=[0, 255, 0, 255], intensity=2)]
    assert pyrt.from_trimesh(group).lights == (SpotLight((0, 0, 9), (0, 0, -1), (0, 2, 0), 0, 45),)


@pytest.mark.parametrize("wrong", [3, "ball.ply", None])
def test_other_things_are_refused(wrong: Any) -> None:
    with pytest.raises(
        UsageError, match=rf"^from_trimesh: expected a trimesh\.Trimesh or trimesh\.Scene, got {type(wrong).__name__}$"
    ):
        pyrt.from_trimesh(wrong)
    with pytest.raises(SceneError, match=r"^from_trimesh: it holds no triangle$"):
        pyrt.from_trimesh(trimesh.Trimesh())


def test_models_are_framed_for_the_size_of_the_picture(tmp_path: Path) -> None:
    (tmp_path / "box.obj").write_text(BOX)
    by_size = load_scene(tmp_path / "box.obj", size=(100, 300))
    assert by_size.camera == load(tmp_path, BOX, "box.obj", film__resolution=[100, 300]).camera


MATERIALS = b"newmtl a\nKd 0.5 0.25 0\nmap_Kd dots.png\nKe 3 2 1\nnewmtl b\nNi 1.4\nillum 7\nd 0.5\n"
USES = ("mtllib my.mtl\n" + SQUARE + "usemtl a\nf 1/1 2/2 3/3 4/4\nusemtl b\nf 1 2 3\n").encode()


@examples(60)
@given(st.data())
def test_damaged_obj_and_mtl_files_are_refused_in_sentences(folder: Path, data: st.DataObject) -> None:
    (folder / "my.mtl").write_bytes(data.draw(st.just(MATERIALS) | damaged(MATERIALS)))
    (folder / "model.obj").write_bytes(data.draw(st.just(USES) | damaged(USES)))
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        try:
            found = list(load_scene(folder / "model.obj").warnings)
        except SceneError as error:
            found = error.problems
    assert all(10 < len(text) < 1000 for text in found)


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return tmp_path_factory.mktemp("models")
