"""Meshes from every format: exact positions, corners where the file has them, transforms, no silent loss."""

from __future__ import annotations

import base64
import json
import struct
import subprocess
import sys
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import trimesh

from pyrt.errors import SceneError
from pyrt.mesh_data import MeshData, transformed
from pyrt.mesh_io import load_mesh
from pyrt.procedural import icosphere, noise, vertex_normals

SQUARE = "v 0 0 0\nv 1 0 0\nv 1 1 0\nv 0 1 0\n"
UVS = "vt 0 0\nvt 1 0\nvt 1 1\nvt 0 1\n"
MIRROR = np.diag([-2.0, 1.0, 0.5, 1.0])


def obj(tmp_path: Path, text: str) -> MeshData:
    path = tmp_path / "mesh.obj"
    path.write_text(text)
    return load_mesh(path)


def corners(mesh: MeshData) -> np.ndarray:
    return mesh.vertices[mesh.triangles]


def volume(mesh: MeshData) -> float:
    """Positive where the triangles' front sides are outside."""
    return float(np.linalg.det(corners(mesh)).sum() / 6)


def closed_edges(positions: np.ndarray) -> bool:
    """Whether every edge of (m, 3, 3) triangles, by the bits of its positions, is met once in each direction."""
    ends = [tuple(map(bytes, (t[i], t[(i + 1) % 3]))) for t in positions for i in range(3)]
    return len(set(ends)) == len(ends) and set(ends) == {(b, a) for a, b in ends}


def test_obj_keeps_every_bit_and_the_vertex_order(tmp_path: Path) -> None:
    values = [[0.1234567890123456, 1e-300, 10 / 3], [1e15 + 0.125, -0.1, 2.5], [7.0, 1e300, -1 / 3]]
    mesh = obj(tmp_path, "".join(f"v {x!r} {y!r} {z!r}\n" for x, y, z in values) + "f 3 2 1\n")
    assert mesh.vertices.tolist() == values
    assert mesh.triangles.tolist() == [[2, 1, 0]]
    assert (mesh.vertices.dtype, mesh.triangles.dtype) == (np.float64, np.int32)
    assert (mesh.uvs, mesh.normals, mesh.warnings) == (None, None, ())


@pytest.mark.parametrize(
    ("faces", "count"), [("f 1 2 3 4\n", 2), ("f 1 2 3 4\nf 1 2 3\n", 3), ("v -1 .5 0\nf 1 2 3 4 5\n", 3)]
)
def test_obj_polygons_become_fans(faces: str, count: int, tmp_path: Path) -> None:
    mesh = obj(tmp_path, SQUARE + faces)
    assert mesh.triangles[:2].tolist() in ([[0, 1, 2], [2, 3, 0]], [[0, 1, 2], [0, 2, 3]])
    assert len(mesh.triangles) == count
    edges = corners(mesh)[:, 1:] - corners(mesh)[:, :1]
    assert (np.cross(edges[:, 0], edges[:, 1])[:, 2] > 0).all()


def test_obj_corners_with_indices_of_their_own(tmp_path: Path) -> None:
    """Vertices shared by two faces with different texture coordinates and normals keep both, and equal positions."""
    text = SQUARE + UVS + "vt 0.25 0.75\nvn 0 0 2\nvn 0 3 4\nf 1/1/1 2/2/1 3/3/1\nf 1/5/2 3/1/2 4/4/2\n"
    mesh = obj(tmp_path, text)
    assert corners(mesh).tolist() == [[[0, 0, 0], [1, 0, 0], [1, 1, 0]], [[0, 0, 0], [1, 1, 0], [0, 1, 0]]]
    assert mesh.uvs is not None
    assert mesh.uvs.tolist() == [[[0, 0], [1, 0], [1, 1]], [[0.25, 0.75], [0, 0], [0, 1]]]
    assert mesh.normals is not None
    np.testing.assert_allclose(mesh.normals, [[[0, 0, 1]] * 3, [[0, 0.6, 0.8]] * 3], atol=1e-7)
    assert (mesh.uvs.dtype, mesh.normals.dtype) == (np.float32, np.float32)


def test_obj_negative_indices_count_from_the_face(tmp_path: Path) -> None:
    text = SQUARE + UVS + "f -4/-4 -3/-3 -2/-2\nv 5 5 5\nv 6 5 5\nv 6 6 5\nvt .5 .5\nf -3/-1 -2/-2 -1/1\n"
    mesh = obj(tmp_path, text)
    assert corners(mesh).tolist() == [[[0, 0, 0], [1, 0, 0], [1, 1, 0]], [[5, 5, 5], [6, 5, 5], [6, 6, 5]]]
    assert mesh.uvs is not None
    assert mesh.uvs.tolist() == [[[0, 0], [1, 0], [1, 1]], [[0.5, 0.5], [0, 1], [0, 0]]]


def test_obj_normals_without_direction_become_the_triangles(tmp_path: Path) -> None:
    mesh = obj(tmp_path, SQUARE + "vn 0 0 0\nvn 1 0 0\nf 1//1 2//1 3//2\n")
    assert mesh.normals is not None
    assert mesh.normals.tolist() == [[[0, 0, 1], [0, 0, 1], [1, 0, 0]]]


def test_obj_faces_without_corners_get_the_defaults(tmp_path: Path) -> None:
    text = SQUARE + UVS + "vn 0 1 0\nusemtl a\nf 1/4/1 2/4/1 3/4/1\nf 1/1 2/2 3/3\nf 1 3 4\nf 1//1 2//1 3//1\n"
    mesh = obj(tmp_path, text)
    assert mesh.uvs is not None
    assert mesh.normals is not None
    default = [[0, 0], [1, 0], [1, 1]]
    assert mesh.uvs.tolist() == [[[0, 1]] * 3, default, default, default]
    assert mesh.normals[:, 0].tolist() == [[0, 1, 0], [0, 0, 1], [0, 0, 1], [0, 1, 0]]
    prefix = f"{tmp_path}/mesh.obj: its"
    assert mesh.warnings == (
        f"{prefix} materials are not used",
        f"{prefix} texture coordinates do not cover every face",
        f"{prefix} normals do not cover every face",
    )


@pytest.mark.parametrize(
    "text",
    [
        SQUARE.replace("\n", "\r\n") + "f 1 2 3\r\n",
        SQUARE.replace(" ", "\t") + "f\t1 2\t 3 # the lower one\n",
        "  " + SQUARE.replace("1 0 0", "1 0 \\\n0") + "s off\ng a\nf 1 \\\n 2 3",
        SQUARE.replace("v 1 0 0", "v 1 0 0 1 0.5 0.5 0.5") + "f 1 2 3",
        SQUARE.replace("v 1 0 0", "v 1 0") + "vt 0.5\nf 1/1 2/1 3/1",
    ],
)
def test_obj_may_be_written_in_many_ways(text: str, tmp_path: Path) -> None:
    assert corners(obj(tmp_path, text)).tolist() == [[[0, 0, 0], [1, 0, 0], [1, 1, 0]]]


@pytest.mark.parametrize("file", sorted((Path(__file__).parents[2] / "scenes" / "meshes").glob("*.obj")), ids=str)
def test_obj_is_read_as_trimesh_reads_it(file: Path) -> None:
    mesh, other = load_mesh(file), trimesh.load(file, process=False, skip_materials=True)
    np.testing.assert_array_equal(corners(mesh), other.vertices[other.faces])
    if mesh.uvs is not None:
        np.testing.assert_array_equal(mesh.uvs, other.visual.uv.astype(np.float32)[other.faces])
    if mesh.normals is not None:
        np.testing.assert_allclose(mesh.normals, other.vertex_normals[other.faces], atol=1e-5)  # not normalised


@pytest.mark.parametrize(
    ("text", "warning"),
    [
        (SQUARE + "f 1 2 3\nf 1 2\n", "its faces with fewer than 3 corners are dropped"),
        ("v 0 0 0 1 0 0\nv 1 0 0 1 0 0\nv 1 1 0 1 0 0\nf 1 2 3\n", "its colours are not used"),
        (SQUARE + "usemtl gold\nf 1 2 3\n", "its materials are not used"),
    ],
)
def test_warnings(text: str, warning: str, tmp_path: Path) -> None:
    assert obj(tmp_path, text).warnings == (f"{tmp_path}/mesh.obj: {warning}",)


def test_degenerate_triangles_and_values_that_are_not_finite_are_kept(tmp_path: Path) -> None:
    mesh = obj(tmp_path, SQUARE + "v nan 0 inf\nf 1 2 3\nf 1 1 2\nf 1 2 5\n")
    assert len(mesh.triangles) == 3
    assert np.isnan(mesh.vertices).sum() == 1


@pytest.mark.parametrize("extension", ["ply", "stl", "off", "glb"])
def test_formats_agree(extension: str, tmp_path: Path) -> None:
    vertices, triangles = icosphere(2)
    vertices = np.round(vertices * 1024) / 1024  # exact in every format
    path = tmp_path / f"ball.{extension.upper()}"
    trimesh.Trimesh(vertices, triangles, process=False).export(path, file_type=extension)
    mesh = load_mesh(path)
    assert mesh.vertices.dtype == np.float64
    np.testing.assert_array_equal(corners(mesh), vertices[triangles])
    assert closed_edges(corners(mesh))


def gltf(tmp_path: Path, **changes: Any) -> Path:
    """A glTF file with one triangle, texture coordinates, no material, and a mirroring node."""
    data = struct.pack("<9f6f3H", 0, 0, 0, 1, 0, 0, 0, 1, 0, 0.25, 0.5, 1, 0, 0, 1, 0, 1, 2)
    tree = {
        "asset": {"version": "2.0"},
        "buffers": [{"uri": f"data:;base64,{base64.b64encode(data).decode()}", "byteLength": len(data)}],
        "bufferViews": [
            {"buffer": 0, "byteOffset": offset, "byteLength": length} for offset, length in ((0, 36), (36, 24), (60, 6))
        ],
        "accessors": [
            {"bufferView": 0, "componentType": 5126, "count": 3, "type": "VEC3"},
            {"bufferView": 1, "componentType": 5126, "count": 3, "type": "VEC2"},
            {"bufferView": 2, "componentType": 5123, "count": 3, "type": "SCALAR"},
        ],
        "meshes": [{"primitives": [{"attributes": {"POSITION": 0, "TEXCOORD_0": 1}, "indices": 2}]}],
        "nodes": [{"mesh": 0, "scale": [-1, 1, 1], "translation": [10, 0, 0]}],
        "scenes": [{"nodes": [0]}],
        "scene": 0,
        **changes,
    }
    path = tmp_path / "triangle.gltf"
    path.write_text(json.dumps(tree))
    return path


def test_gltf_texture_coordinates_and_node_transforms(tmp_path: Path) -> None:
    mesh = load_mesh(gltf(tmp_path))
    assert corners(mesh).tolist() == [[[10, 0, 0], [10, 1, 0], [9, 0, 0]]]
    assert mesh.uvs is not None
    assert mesh.uvs.tolist() == [[[0.25, 0.5], [0, 1], [1, 0]]]
    assert mesh.warnings == ()


def test_gltf_names_what_it_does_not_use(tmp_path: Path) -> None:
    path = gltf(tmp_path, materials=[{}], cameras=[{"type": "orthographic"}], extensionsUsed=["KHR_lights_punctual"])
    assert load_mesh(path).warnings == (f"{path}: its materials and cameras and lights are not used",)


def test_glb_joins_nodes_and_keeps_normals(tmp_path: Path) -> None:
    vertices, triangles = icosphere(1)
    ball = trimesh.Trimesh(vertices, triangles, vertex_normals=vertices, process=False)
    turn = trimesh.transformations.rotation_matrix(0.7, [1, 2, 3], [0, 1, 0])
    group = trimesh.Scene()
    group.add_geometry(ball, node_name="turned", transform=turn)
    group.add_geometry(ball, node_name="straight")
    path = tmp_path / "balls.glb"
    path.write_bytes(group.export(file_type="glb"))
    mesh = load_mesh(path)
    assert mesh.normals is not None
    rotation, shift = turn[:3, :3], turn[:3, 3]
    expected = {(0.0, 0.0, 0.0): vertices, tuple(np.round(shift, 5)): vertices @ rotation.T}
    for part in np.split(np.arange(len(mesh.triangles)), 2):
        center = mesh.vertices[mesh.triangles[part]].mean(axis=(0, 1))
        ball_vertices = expected.pop(tuple(np.round(center, 5) + 0.0))
        np.testing.assert_allclose(corners(mesh)[part] - center, ball_vertices[triangles], atol=1e-6)
        np.testing.assert_allclose(mesh.normals[part], ball_vertices[triangles], atol=1e-6)
    assert closed_edges(corners(mesh))


def test_transforms_keep_the_front_side_outside_and_normals_upright() -> None:
    vertices, triangles = icosphere(3)
    uvs = np.arange(len(triangles) * 6, dtype=np.float32).reshape(-1, 3, 2)
    ball = MeshData(vertices, triangles, uvs, vertices.astype(np.float32)[triangles])
    mirrored = transformed(ball, MIRROR)
    assert volume(mirrored) == pytest.approx(volume(ball), rel=1e-12)
    # the same two corners are swapped everywhere
    assert mirrored.uvs is not None
    assert mirrored.uvs[5].tolist() == uvs[5, [0, 2, 1]].tolist()
    # an ellipsoid's normal is the gradient of its equation
    gradient = corners(mirrored) / np.diag(MIRROR)[:3] ** 2
    gradient /= np.linalg.norm(gradient, axis=2, keepdims=True)
    assert mirrored.normals is not None
    np.testing.assert_allclose(mirrored.normals, gradient, atol=1e-6)


def test_transforms_keep_a_soup_closed() -> None:
    """Equal positions at different places of arrays of any length give equal bits."""
    random = np.random.default_rng(1)
    triangles = np.zeros((1, 3), np.int32)
    for _ in range(20):
        matrix = np.eye(4)
        matrix[:3] = random.standard_normal((3, 4))
        points = random.standard_normal((1, 3))
        copies = [transformed(MeshData(np.repeat(points, n, axis=0), triangles), matrix).vertices for n in range(1, 20)]
        assert len({bytes(vertex) for copy in copies for vertex in copy}) == 1


def test_errors_name_the_file(tmp_path: Path) -> None:
    with pytest.raises(SceneError, match=r"^.*none\.obj: cannot be read: no such file or directory$"):
        load_mesh(tmp_path / "none.obj")
    with pytest.raises(SceneError, match=r"mesh\.obj: the mesh has no triangle$"):
        obj(tmp_path, SQUARE)


def test_trimesh_is_imported_only_for_formats_that_need_it(tmp_path: Path) -> None:
    (tmp_path / "a.obj").write_text(SQUARE + "f 1 2 3")
    (tmp_path / "b.off").write_text("OFF\n3 1 0\n0 0 0\n1 0 0\n0 1 0\n3 0 1 2\n")
    for name, needed in (("a.obj", False), ("b.off", True)):
        load = f"pyrt.mesh_io.load_mesh({str(tmp_path / name)!r})"
        code = f"import sys, pyrt.mesh_io; {load}; sys.exit(('trimesh' in sys.modules) != {needed})"
        subprocess.run([sys.executable, "-c", code], check=True, cwd=Path(__file__).parents[2])


@pytest.mark.parametrize("subdivisions", [0, 1, 4])
def test_icosphere_is_closed_and_faces_outwards(subdivisions: int) -> None:
    vertices, triangles = icosphere(subdivisions)
    assert vertices.shape == (10 * 4**subdivisions + 2, 3)
    assert triangles.shape == (20 * 4**subdivisions, 3)
    np.testing.assert_allclose(np.linalg.norm(vertices, axis=1), 1, rtol=1e-15)
    assert np.linalg.det(vertices[triangles]).min() > 0
    assert closed_edges(triangles[..., None])
    assert not closed_edges(triangles[1:, :, None])  # the check can fail


def test_icosphere_approaches_the_sphere() -> None:
    vertices, triangles = icosphere(5)
    assert volume(MeshData(vertices, triangles)) == pytest.approx(4 / 3 * np.pi, rel=2e-3)
    np.testing.assert_allclose(vertex_normals(vertices, triangles), vertices, atol=4e-3)


def test_noise_is_bounded_smooth_and_repeatable() -> None:
    points = icosphere(4)[0]
    values = noise(points, 2.0, 4, seed=3)
    np.testing.assert_array_equal(values, noise(points, 2.0, 4, seed=3))
    assert np.abs(values - noise(points, 2.0, 4, seed=4)).max() > 0.1
    assert 0.2 < np.abs(values).max() <= 1
    # a sine of frequency f has a slope of at most 2πf; each octave doubles that and halves the weight
    slope = np.abs(noise(points + [1e-6, 0, 0], 2.0, 4, seed=3) - values) / 1e-6
    assert slope.max() < 2 * np.pi * 2.0 * 4 / (2 - 2.0**-3)
    # a single octave has the stated frequency along a line, on average over its 8 directions less
    assert np.abs(noise(points, 1e-9, 1, 0) - noise(points[:1], 1e-9, 1, 0)).max() < 1e-7
