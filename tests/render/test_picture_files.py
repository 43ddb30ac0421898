"""Files of whole renders: channels, headers and windows, as asked for on the command line."""

from __future__ import annotations

import numpy as np
import pytest

import pyrt
from pyrt import __version__
from pyrt.aov import AOVS
from pyrt.camera import film_plane, world_to_camera, world_to_ndc
from pyrt.cli import main
from pyrt.image_file import read_exr
from pyrt.scene_hash import scene_hash
from pyrt.settings import Window

SCENE = "example:cornell"
SIZE = (16, 12)
SMALL = ["--size", "16x12", "--spp", "2", "-q"]


def test_exr_headers_say_what_the_picture_is_of(tmp_path, monkeypatch):
    monkeypatch.delenv("SOURCE_DATE_EPOCH", raising=False)
    scene = pyrt.load_scene(SCENE)
    pyrt.render(scene, spp=2, seed=2**32 - 1, size=SIZE).save(tmp_path / "a.exr")
    found = read_exr(tmp_path / "a.exr").metadata
    plane = film_plane(scene.camera, *SIZE)
    np.testing.assert_allclose(found.pop("worldToCamera"), world_to_camera(plane), rtol=1e-6, atol=1e-7)
    np.testing.assert_allclose(found.pop("worldToNDC"), world_to_ndc(plane, *SIZE), rtol=1e-6, atol=1e-7)
    assert found.pop("pyrt:seconds") > 0
    assert found.pop("pyrt:device")
    assert found == {
        "Software": f"pyrt {__version__}",
        "pyrt:scene": "cornell",
        "pyrt:scene_hash": scene_hash(scene),
        "pyrt:seed": str(2**32 - 1),  # beyond the 32 bits of whole numbers in headers
        "pyrt:first_sample": 0,
        "pyrt:spp": 2,
        "PixelAspectRatio": 1.0,
    }


def test_a_range_of_samples_is_in_the_header(tmp_path):
    renderer = pyrt.Renderer(pyrt.load_scene(SCENE))
    for first, end in ((8, 12), (12, 14)):
        result = renderer.render(size=SIZE, samples=(first, end))
        assert (result.metadata["pyrt:first_sample"], result.metadata["pyrt:spp"]) == (first, end - first)
        result.save(tmp_path / f"{first}.exr")
    merged = pyrt.merge([tmp_path / "8.exr", tmp_path / "12.exr"]).metadata
    assert (merged["pyrt:first_sample"], merged["pyrt:spp"]) == (8, 6)
    assert merged["pyrt:scene_hash"] == scene_hash(renderer.scene)


def test_bytes_of_equal_renders_are_equal_with_a_source_date(tmp_path, monkeypatch):
    renderer = pyrt.Renderer(pyrt.load_scene(SCENE))

    def content(name: str) -> bytes:
        renderer.render(2, size=SIZE, aovs=AOVS).save(tmp_path / name)
        return (tmp_path / name).read_bytes()

    monkeypatch.setenv("SOURCE_DATE_EPOCH", "86400")
    assert content("a.exr") == content("b.exr")
    assert "pyrt:seconds" not in read_exr(tmp_path / "a.exr").metadata
    monkeypatch.delenv("SOURCE_DATE_EPOCH")
    assert content("c.exr") != content("a.exr")


def test_every_aov_is_in_the_file(tmp_path):
    path = tmp_path / "a.exr"
    assert main(["render", SCENE, *SMALL, "--aov", ",".join(AOVS), "-o", str(path)]) == 0
    planes = read_exr(path).planes
    aovs = pyrt.render(SCENE, spp=2, size=SIZE, aovs=AOVS).aovs
    assert set(planes) == {channel for aov in AOVS.values() for channel in aov.channels}
    for name, aov in AOVS.items():
        stored = np.stack([planes[channel] for channel in aov.channels], axis=2)
        expected = aovs[name].reshape(stored.shape).astype(np.uint32 if aov.dtype is np.uint32 else np.float32)
        np.testing.assert_array_equal(stored, expected)


def test_a_crop_keeps_its_place_in_the_display_window(tmp_path):
    whole, part = tmp_path / "a.exr", tmp_path / "b.exr"
    assert main(["render", SCENE, *SMALL, "-o", str(whole)]) == 0
    assert main(["render", SCENE, *SMALL, "--crop", "3,2,11,9", "-o", str(part), "-o", str(tmp_path / "b.npy")]) == 0
    found = read_exr(part)
    assert found.window == Window(3, 2, 11, 9, 16, 12)
    np.testing.assert_array_equal(found.pixels, read_exr(whole).pixels[2:9, 3:11])
    assert np.load(tmp_path / "b.npy").shape == (7, 8, 3)


@pytest.mark.parametrize(
    ("options", "message"),
    [
        (["--aov", "z,dept"], 'aov: expected some of z, distance, position, normal, uv, object, '),
        (["--aov", "z", "-o", "a.png"], "--aov, --float: expected an output ending in .exr"),
        (["--view", "fog", "-o", "a.png"], 'view: expected one of aces, srgb, raw, got "fog"'),
        (["--crop", "0,0,17,12", "-o", "a.png"], "crop: expected x0,y0,x1,y1 inside the picture, 16 x 12, got 0,0,17"),
        (["--crop", "0,0,17", "-o", "a.png"], 'expected X0,Y0,X1,Y1 such as 0,0,320,240, got "0,0,17"'),
    ],
)  # fmt: skip
def test_what_cannot_be_is_one_sentence(options, message, tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    assert main(["render", SCENE, *SMALL, *options]) == 2
    assert message in capsys.readouterr().err
    assert not list(tmp_path.iterdir())
