"""The example scenes' own data: measured numbers, closed meshes, textures that tile, files that exist and load."""

from __future__ import annotations

import json
import math
import re
import subprocess
import sys
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import OpenImageIO as oiio
import pytest
from numpy.typing import NDArray

from pyrt.scene import Mesh
from pyrt.scene_io import load_scene

ROOT = Path(__file__).resolve().parents[2]
SCENES = sorted((ROOT / "scenes").glob("*.json"))
MESHES = sorted((ROOT / "scenes" / "meshes").glob("*.obj"))
TEXTURES = sorted((ROOT / "textures").glob("*.png"))

WALLS = {
    "left": [(-1, 0, -1), (-1, 2, -1), (-1, 2, 1), (-1, 0, 1)],
    "right": [(1, 0, 1), (1, 2, 1), (1, 2, -1), (1, 0, -1)],
    "floor": [(-1, 0, 1), (-1, 0, -1), (1, 0, -1), (1, 0, 1)],
    "back": [(-1, 0, -1), (-1, 2, -1), (1, 2, -1), (1, 0, -1)],
    "ceiling": [(1, 2, -1), (-1, 2, -1), (-1, 2, 1), (1, 2, 1)],
}
BOXES = {
    "short_box": (0.6, [(-0.04607, -0.573007), (0.124253, -0.003104), (0.703337, -0.176177), (0.533009, -0.746079)]),
    "tall_box": (1.2, [(0.0495656, 0.108948), (-0.523986, -0.0906493), (-0.720444, 0.473882), (-0.146892, 0.673479)]),
}
POINT = [0, 1.5, 0.5]
# scene: (point flux, rectangle radiance, has the disc)
CORNELL = {
    "cornell": ([17, 12, 5], None, False),
    "cornell_refraction": ([17, 12, 5], None, True),
    "cornell_textured": ([17, 12, 5], None, True),
    "cornell_area_light": (None, [80, 56, 23], True),
    "cornell_two_lights": ([50, 10, 10], [30, 120, 120], True),
}


@dataclass(frozen=True)
class Obj:
    """Triangles of an OBJ file whose corners use one index for everything."""

    v: NDArray[np.float64]  # (n, 3)
    vt: NDArray[np.float64]  # (n, 2) or empty
    vn: NDArray[np.float64]  # (n, 3) or empty
    f: NDArray[np.int_]  # (m, 3)


def read_obj(path: Path) -> Obj:
    rows: dict[str, list[list[float]]] = {"v": [], "vt": [], "vn": [], "f": []}
    for line in path.read_text(encoding="ascii").splitlines():
        key, *words = line.split()
        if key == "f":
            indices = [set(map(int, filter(None, word.split("/")))) for word in words]
            assert all(len(index) == 1 for index in indices), line
            rows["f"].append([index.pop() - 1 for index in indices])
        else:
            rows[key].append([float(word) for word in words])
    return Obj(np.array(rows["v"]), np.array(rows["vt"]), np.array(rows["vn"]), np.array(rows["f"], int))


def mesh(name: str) -> Obj:
    return read_obj(ROOT / "scenes" / "meshes" / f"{name}.obj")


def doubled_areas(m: Obj) -> NDArray[np.float64]:
    """The cross product of two sides of each triangle, (m, 3): the normal times twice the area."""
    a, b, c = m.v[m.f].transpose(1, 0, 2)
    return np.cross(b - a, c - a)


def is_closed(m: Obj) -> bool:
    """Whether every edge, between positions, is run through once in either direction."""
    _, position = np.unique(m.v, axis=0, return_inverse=True)
    corners = position.reshape(-1)[m.f]
    edges = np.concatenate([corners[:, [0, 1]], corners[:, [1, 2]], corners[:, [2, 0]]])
    unique = {(int(a), int(b)) for a, b in edges}
    return len(unique) == len(edges) and all((b, a) in unique for a, b in unique)


def signed_volume(m: Obj) -> float:
    a, b, c = m.v[m.f].transpose(1, 0, 2)
    return float(np.einsum("ij,ij->", a, np.cross(b, c))) / 6


@pytest.mark.parametrize("name", WALLS)
def test_wall_has_the_given_corners_and_faces_the_room(name: str) -> None:
    wall = mesh(name)
    assert np.array_equal(wall.v, WALLS[name])
    assert np.array_equal(wall.vt, [(0, 0), (1, 0), (1, 1), (0, 1)])
    assert wall.vn.size == 0
    doubled = doubled_areas(wall)
    assert np.array_equal(np.linalg.norm(doubled, axis=1), [4, 4])
    to_room = np.array([0, 1, 0]) - wall.v[wall.f].mean(axis=1)
    assert (np.einsum("ij,ij->i", doubled, to_room) > 0).all()


@pytest.mark.parametrize("name", BOXES)
def test_box_is_a_closed_outward_prism_over_the_given_base(name: str) -> None:
    height, base = BOXES[name]
    box = mesh(name)
    assert {(x, z) for x, _, z in box.v} == set(base)
    assert set(box.v[:, 1]) == {1e-4, height}
    assert len(box.f) == 12
    assert box.vt.size == box.vn.size == 0
    assert is_closed(box)
    (x0, z0), (x1, z1) = np.transpose(base), np.transpose(np.roll(base, -1, axis=0))
    area = abs(float(np.sum(x0 * z1 - x1 * z0))) / 2
    assert signed_volume(box) == pytest.approx(area * (height - 1e-4), rel=1e-12)


@pytest.mark.parametrize("name", BOXES)
def test_checkerboard_continues_across_the_diagonals_of_a_box(name: str) -> None:
    """Two triangles of a face are its halves by a half turn, which maps the default coordinates to 1 - uv."""
    box = mesh(name)
    for first, second in box.f.reshape(6, 2, 3):
        assert first[0] == second[2]
        assert first[2] == second[0]


def test_disc_is_a_flat_32_gon_that_faces_the_camera() -> None:
    disc = mesh("disc")
    assert disc.v.shape == (32, 3)
    assert len(disc.f) == 30
    assert (disc.v[:, 2] == 1).all()
    assert np.hypot(disc.v[:, 0], disc.v[:, 1] - 1) == pytest.approx(0.5, abs=1e-12)
    doubled = doubled_areas(disc)
    assert (doubled[:, 2] > 0).all()
    assert (doubled[:, :2] == 0).all()
    assert doubled[:, 2].sum() / 2 == pytest.approx(32 / 2 * 0.5**2 * math.sin(2 * math.pi / 32), rel=1e-11)


@pytest.mark.parametrize("name", sorted({path.stem for path in MESHES} - {*WALLS, *BOXES, "disc"}))
def test_body_of_revolution_is_closed_and_its_normals_point_outward(name: str) -> None:
    body = mesh(name)
    assert is_closed(body)
    assert signed_volume(body) > 0
    assert np.linalg.norm(body.vn, axis=1) == pytest.approx(1, abs=2e-5)
    doubled = doubled_areas(body)
    flat = doubled / np.linalg.norm(doubled, axis=1, keepdims=True)
    assert (np.einsum("ij,ikj->ik", flat, body.vn[body.f]) > 0.5).all()
    assert body.vt.min() == 0
    assert body.vt.max() == 1


def test_checks_of_closedness_notice_a_hole_and_a_turned_triangle() -> None:
    box = mesh("short_box")
    assert not is_closed(Obj(box.v, box.vt, box.vn, box.f[1:]))
    assert not is_closed(Obj(box.v, box.vt, box.vn, np.vstack([box.f[:1, ::-1], box.f[1:]])))


def run_script(script: str, directory: Path) -> None:
    subprocess.run([sys.executable, str(ROOT / script), str(directory)], check=True)


def test_mesh_script_writes_the_meshes_byte_for_byte(tmp_path: Path) -> None:
    run_script("scenes/make_meshes.py", tmp_path)
    assert {p.name: p.read_bytes() for p in tmp_path.iterdir()} == {p.name: p.read_bytes() for p in MESHES}


def read_texture(path: Path) -> NDArray[np.uint8]:
    """Return an 8-bit image as (height, width, 3)."""
    image = oiio.ImageBuf(str(path))
    assert image.spec().format == oiio.UINT8
    assert image.nchannels == 3
    return np.asarray(image.get_pixels(oiio.UINT8))


def test_texture_script_paints_the_textures_pixel_for_pixel(tmp_path: Path) -> None:
    run_script("textures/make_textures.py", tmp_path)
    assert {p.name for p in tmp_path.iterdir()} == {p.name for p in TEXTURES}
    for path in TEXTURES:
        assert np.array_equal(read_texture(tmp_path / path.name), read_texture(path)), path.name


def seam(pixels: NDArray[Any], axis: int) -> float:
    """The mean step across the border, in units of the 95th percentile of those between neighbouring rows."""
    image = pixels.astype(float)
    steps = np.abs(image - np.roll(image, 1, axis)).mean(axis=(1 - axis, 2))
    return float(steps[0] / np.quantile(steps, 0.95))


@pytest.mark.parametrize("path", TEXTURES, ids=lambda path: path.stem)
def test_texture_is_small_and_tiles_without_a_seam(path: Path) -> None:
    pixels = read_texture(path)
    assert pixels.shape == (512, 512, 3)
    assert path.stat().st_size < 700_000
    assert seam(pixels, 0) < 2
    assert seam(pixels, 1) < 2


def test_seam_check_notices_an_image_that_does_not_tile() -> None:
    pixels = read_texture(ROOT / "textures" / "marble.png")[:300, :300]
    assert seam(pixels, 0) > 2
    assert seam(pixels, 1) > 2


def load(name: str) -> dict[str, Any]:
    scene: dict[str, Any] = json.loads((ROOT / "scenes" / f"{name}.json").read_text(encoding="utf-8"))
    return scene


def files_of(scene: dict[str, Any]) -> set[Path]:
    entries = [*scene["textures"].values(), *scene["objects"]]
    return {(ROOT / "scenes" / entry["path"]).resolve() for entry in entries if "path" in entry}


@pytest.mark.parametrize("path", SCENES, ids=lambda path: path.stem)
def test_scene_names_only_what_exists_and_uses_all_that_it_defines(path: Path) -> None:
    scene = load(path.stem)
    assert [p for p in files_of(scene) if not p.is_file()] == []
    assert {o["material_name"] for o in scene["objects"] if "material_name" in o} == set(scene["materials"])
    used = {m["texture_name"] for m in scene["materials"].values() if "texture_name" in m}
    assert used == set(scene["textures"])


def test_every_mesh_and_texture_belongs_to_a_scene() -> None:
    used = set().union(*(files_of(load(path.stem)) for path in SCENES))
    assert used == {*MESHES, *TEXTURES}


@pytest.mark.parametrize("name", CORNELL)
def test_cornell_scene_is_the_one_of_its_figure(name: str) -> None:
    flux, radiance, has_disc = CORNELL[name]
    scene = load(name)
    assert scene["integrator"].get("point_light_flux") == flux
    assert scene["integrator"].get("point_light_position") == (POINT if flux else None)
    assert scene["film"]["resolution"] == [512, 512]
    assert scene["integrator"]["spp"] == 32
    assert scene["camera"]["position"] == [0, 1, 6.8]
    assert scene["camera"]["look_at"] == [0, 1, 0]
    assert scene["camera"]["fov"] == 19.5

    meshes = {Path(o["path"]).stem: o for o in scene["objects"] if o["type"] == "mesh"}
    assert set(meshes) == {*WALLS, *BOXES, *(["disc"] if has_disc else [])}
    assert meshes["short_box"]["translate"] == [-0.7, 0, 0.6]
    assert meshes["tall_box"]["translate"] == [0.7, 0, -0.5]
    if has_disc:
        assert scene["materials"][meshes["disc"]["material_name"]] == {"type": "refraction", "eta": 2.0}

    lamps = [o for o in scene["objects"] if "light" in o]
    assert [o["light"]["radiance"] for o in lamps] == ([radiance] if radiance else [])
    for lamp in lamps:
        assert [lamp[key] for key in ("center", "edge1", "edge2")] == [[0, 1.99, 0], [0.4, 0, 0], [0, 0, 0.4]]


def test_cornell_colours_are_the_measured_ones() -> None:
    scene = load("cornell")
    colors = {name: texture["color"] for name, texture in scene["textures"].items()}
    assert colors == {"red": [0.63, 0.065, 0.05], "green": [0.14, 0.45, 0.091], "grey": [0.725, 0.71, 0.68]}
    of = {Path(o["path"]).stem: scene["materials"][o["material_name"]]["texture_name"] for o in scene["objects"]}
    assert of.pop("left") == "red"
    assert of.pop("right") == "green"
    assert set(of.values()) == {"grey"}


def are_apart(a: NDArray[np.float64], b: NDArray[np.float64]) -> bool:
    """Whether a side of one of two convex polygons, (n, 2), separates them."""
    for polygon in (a, b):
        for side in polygon - np.roll(polygon, 1, axis=0):
            p, q = a @ (side[1], -side[0]), b @ (side[1], -side[0])
            if p.max() < q.min() or q.max() < p.min():
                return True
    return False


def test_boxes_stand_in_the_room_apart_from_each_other() -> None:
    short, tall = (np.add(BOXES[name][1], at) for name, at in (("short_box", (-0.7, 0.6)), ("tall_box", (0.7, -0.5))))
    assert (np.abs([short, tall]) < 1).all()
    assert are_apart(short, tall)
    assert not are_apart(short, short + 0.1)


def test_boulder_of_the_mesh_room_rests_on_the_floor_and_touches_nothing_else() -> None:
    meshes = [shape for shape in load_scene(ROOT / "scenes/mesh_room.json").shapes if isinstance(shape, Mesh)]
    boulder = max(meshes, key=lambda shape: len(shape.triangles))
    assert len(boulder.triangles) == 327_680
    low, high = boulder.vertices.min(axis=0), boulder.vertices.max(axis=0)
    assert (low[[0, 2]] > -0.95).all()
    assert (high < [0.95, 1.9, 0.95]).all()
    assert 0 < low[1] < 0.01


@pytest.mark.parametrize("path", SCENES, ids=lambda path: path.stem)
def test_scene_loads_without_a_warning(path: Path) -> None:
    assert load_scene(path).warnings == ()


def test_scene_of_the_readme_loads() -> None:
    match = re.search(r"```json\n(.*?)```", (ROOT / "scenes/README.md").read_text(encoding="utf-8"), re.DOTALL)
    assert match
    assert len(load_scene(json.loads(match[1]), base_dir=ROOT / "scenes").shapes) == 4
