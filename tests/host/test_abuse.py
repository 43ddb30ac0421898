"""Files are data: what they claim is checked before memory is taken for it, and messages stay short."""

from __future__ import annotations

import json
import struct
import subprocess
import sys
import zlib
from pathlib import Path

import numpy as np
import pytest

from pyrt import image_io, loading, mesh_obj, scene_io, schema_errors
from pyrt.errors import PyrtError, SceneError, UsageError
from pyrt.image_io import read_picture, read_texture, write_image
from pyrt.mesh_io import load_mesh
from pyrt.schema import json_schema

PLY = b"""ply
format %s 1.0
element vertex 4000000000
property float x
property float y
property float z
element face 1000000000
property list uchar int vertex_indices
end_header
0 0 0
1 0 0
0 1 0
3 0 1 2
"""
GLTF = {
    "asset": {"version": "2.0"},
    "nodes": [{"mesh": 0}],
    "meshes": [{"primitives": [{"attributes": {"POSITION": 0}}]}],
    "accessors": [{"componentType": 5126, "count": 10**7, "type": "VEC3"}],
}
NPY = b"{'descr': '<f4', 'fortran_order': False, 'shape': (1000000000, 1000000000, 3)}\n"
parse = mesh_obj._numbers
BALL = {"type": "icosphere", "subdivisions": 9, "light": {"radiance": [1, 1, 1]}}


@pytest.mark.parametrize(
    ("name", "content", "message"),
    [
        (
            "a.stl",
            bytes(80) + struct.pack("<I", 4 * 10**9) + bytes(100),
            "4000000000 triangles, the file has room for 2",
        ),
        ("a.ply", PLY % b"binary_little_endian", "not a readable PLY mesh"),
        ("a.ply", PLY % b"ascii", "a.ply: "),
        ("a.off", b"OFF\n4000000000 4000000000 0\n0 0 0\n1 0 0\n0 1 0\n3 0 1 2\n", "not a readable OFF mesh"),
        ("a.obj", b"v 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 99999999999999999999\n", "a face refers to v"),
        ("a.glb", struct.pack("<4sIIII", b"glTF", 2, 2**32 - 1, 2**32 - 1, 0x4E4F534A) + b"{}", "a.glb: "),
        ("a.gltf", json.dumps(GLTF).encode(), "expected at most 1048576 without a bufferView, got 10000000"),
    ],
)
def test_absurd_counts_in_meshes(tmp_path, name, content, message):
    (tmp_path / name).write_bytes(content)
    with pytest.raises(SceneError, match=message):
        load_mesh(tmp_path / name)


SIDE = 16384  # the largest square that a texture may be


def chunk(kind: bytes, data: bytes) -> bytes:
    return struct.pack(">I", len(data)) + kind + data + struct.pack(">I", zlib.crc32(kind + data))


def png(side: int) -> bytes:
    header = chunk(b"IHDR", struct.pack(">IIBBBBB", side, side, 8, 2, 0, 0, 0))
    return b"\x89PNG\r\n\x1a\n" + header + chunk(b"IDAT", zlib.compress(bytes(100))) + chunk(b"IEND", b"")


def hdr(side: int) -> bytes:
    return b"#?RADIANCE\nFORMAT=32-bit_rle_rgbe\n\n-Y %d +X %d\n" % (side, side) + bytes(100)


def exr(side: int, channels: int = 3) -> bytes:
    box = struct.pack("<iiii", 0, 0, side - 1, side - 1)
    names = [b"R", b"G", b"B"] if channels == 3 else [b"c%d" % i for i in range(channels)]
    attributes = {
        b"channels\0chlist": b"".join(name + b"\0" + struct.pack("<IIII", 1, 0, 1, 1) for name in sorted(names))
        + b"\0",
        b"compression\0compression": b"\0",
        b"dataWindow\0box2i": box,
        b"displayWindow\0box2i": box,
        b"lineOrder\0lineOrder": b"\0",
        b"pixelAspectRatio\0float": struct.pack("<f", 1),
        b"screenWindowCenter\0v2f": bytes(8),
        b"screenWindowWidth\0float": struct.pack("<f", 1),
    }
    header = b"".join(name + b"\0" + struct.pack("<I", len(data)) + data for name, data in attributes.items())
    return struct.pack("<II", 20000630, 2) + header + bytes(101)


def tiff(side: int, channels: int = 3) -> bytes:
    tags = [(256, 4, side), (257, 4, side), (258, 3, 8), (259, 3, 1), (262, 3, 2), (273, 4, 8)]
    tags += [(277, 3, channels), (278, 4, side), (279, 4, 100)]
    entries = b"".join(struct.pack("<HHII", tag, kind, 1, value) for tag, kind, value in tags)
    return b"II*\0" + struct.pack("<IH", 8, len(tags)) + entries + bytes(104)


IMAGES = {
    f"{name}.{make.__name__}": make(side)
    for make in (png, hdr, exr, tiff)
    for name, side in (("huge", 1 << 30), ("large", SIDE))
} | {"many.exr": exr(4096, 2000), "many.tiff": tiff(SIDE, 60_000)}
READ_ALL = """
import re, sys
from pathlib import Path
from pyrt.errors import SceneError
from pyrt.image_io import read_texture
for file in sorted(Path(sys.argv[1]).iterdir()):
    try:
        read_texture(file)
    except SceneError as error:
        print(error)
print(int(re.search(r"VmHWM:\\s*(\\d+)", Path("/proc/self/status").read_text())[1]) >> 10)  # ru_maxrss has the parent's
"""


@pytest.mark.skipif(sys.platform != "linux", reason="elsewhere the peak has another unit")
def test_absurd_sizes_in_images(tmp_path):
    """In a process of its own, for its peak. OpenImageIO compares what the headers claim with the files' lengths; were
    the pixels of one allocated, that would be 768 MiB at least."""
    for name, content in IMAGES.items():
        (tmp_path / name).write_bytes(content)
    command = [sys.executable, "-c", READ_ALL, str(tmp_path)]
    done = subprocess.run(command, cwd=Path(__file__).parents[2], capture_output=True, text=True, check=True)
    *problems, peak = done.stdout.splitlines()
    assert [Path(problem.split(":")[0]).name for problem in problems] == sorted(IMAGES)
    assert all("not a readable image" in problem for problem in problems)
    assert int(peak) < 300


def test_images_that_memory_cannot_hold_are_not_decoded(tmp_path, monkeypatch):
    write_image(tmp_path / "a.png", np.zeros((64, 128, 3)))
    monkeypatch.setattr(image_io, "_UNASKED", 0)
    monkeypatch.setattr(image_io, "available", lambda: 2.0**16)
    expected = "a.png: expected 0.000114 GiB of free memory for 128 x 64 pixels of 3 channels, found 6.1e-05 GiB"
    with pytest.raises(PyrtError, match=expected):
        read_texture(tmp_path / "a.png")
    monkeypatch.setattr(image_io, "available", lambda: 2.0**17)
    assert read_texture(tmp_path / "a.png").pixels.shape == (64, 128, 3)


def test_an_absurd_array(tmp_path):
    (tmp_path / "a.npy").write_bytes(b"\x93NUMPY\1\0" + struct.pack("<H", len(NPY)) + NPY)
    with pytest.raises(UsageError, match="not a readable array"):
        read_picture(tmp_path / "a.npy")


def test_polygons_of_a_thousand_sizes(tmp_path):
    """As many triangles as there are corners but two, around the first one."""
    faces = b"".join(b"f" + b" 1 2 3" * size + b"\n" for size in range(1, 200))
    (tmp_path / "a.obj").write_bytes(b"v 0 0 0\nv 1 0 0\nv 0 1 0\n" + faces)
    triangles = load_mesh(tmp_path / "a.obj").triangles
    assert len(triangles) == sum(3 * size - 2 for size in range(1, 200))
    assert triangles[:5].tolist() == [[0, 1, 2], [0, 1, 2], [0, 2, 0], [0, 0, 1], [0, 1, 2]]


def test_the_work_for_polygons_does_not_depend_on_their_sizes(monkeypatch):
    """Numbers are parsed once for each form of a corner, and each coordinate table."""
    calls = []
    monkeypatch.setattr(mesh_obj, "_numbers", lambda *args: calls.append(args) or parse(*args))
    corner = [b" 1", b" 2/1", b" 3//1"]
    faces = b"".join(b"f" + corner[size % 3] * size + b"\n" for size in range(3, 300))
    found = mesh_obj.read_obj(b"v 0 0 0\nv 1 0 0\nv 0 1 0\nvt 0 0\nvn 0 0 1\n" + faces)
    assert len(found.corners) == sum(size - 2 for size in range(3, 300))
    assert len(calls) == 3 + 3


def test_corners_of_one_face_may_have_different_forms():
    table = b"v 0 0 0\nv 1 0 0\nv 0 1 0\nvt 0 0\nvn 0 0 1\n"
    found = mesh_obj.read_obj(table + b"f 1/1 2 3//1\nf 3 2 1\nf 3/1/1 -2/ 1//\n")
    assert found.corners.tolist() == [
        [[0, 0, -1], [1, -1, -1], [2, -1, 0]],
        [[2, -1, -1], [1, -1, -1], [0, -1, -1]],
        [[2, 0, 0], [1, -1, -1], [0, -1, -1]],
    ]
    for face, message in (
        (b"f 1/1 0 2", "refers to index 0"),
        (b"f 1/1 2 9//1", "refers to v 9"),
        (b"f 1/1 2 x", "not"),
    ):
        with pytest.raises(ValueError, match=message):
            mesh_obj.read_obj(table + face)


def test_objects_that_memory_cannot_hold_are_not_made(monkeypatch):
    monkeypatch.setattr(loading, "available", lambda: 1e9)
    with pytest.raises(PyrtError, match=r"objects\[1\]: 5,242,880 triangles, memory has room for 4,757,120 more"):
        scene_io.load_scene({"objects": [BALL, BALL]})


def test_the_schema_is_made_once_for_all_problems(monkeypatch):
    made = []
    monkeypatch.setattr(schema_errors, "json_schema", lambda: made.append(1) or json_schema())
    schema_errors._schema.cache_clear()
    ball = {"type": "sphere", "center": [0, 0, 0], "radius": 1, "light": {"radiance": [1, 1, 1]}}
    with pytest.raises(SceneError) as caught:
        scene_io.load_scene({"objects": [{**ball, "colour": 1}] * 1000})
    assert caught.value.problems[999].startswith("scene: objects[999].colour: unknown key")
    assert len(made) == 1


def test_a_message_ends(tmp_path):
    with pytest.raises(SceneError) as caught:
        scene_io.load_scene({"objects": [{"type": "sphere", "center": [0, 0, 0], "radius": -1}] * 300})
    assert len(caught.value.problems) == 300
    lines = str(caught.value).splitlines()
    assert (len(lines), lines[-1]) == (101, "... and 200 more problems")
