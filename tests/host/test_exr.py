"""EXR files hold channels of every kind, windows and matrices, and OpenImageIO's own tool reads them back."""

from __future__ import annotations

import shutil
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

from pyrt.errors import UsageError
from pyrt.image_file import read_exr
from pyrt.image_io import write_image
from pyrt.settings import Window

NONE = 0xFFFFFFFF
MATRIX = np.arange(16.0).reshape(4, 4)


@pytest.fixture
def picture() -> np.ndarray:
    return np.random.default_rng(0).random((131, 17, 3)).astype(np.float32)  # more rows than one block has


def oiiotool(*arguments: str) -> str:
    tool = shutil.which("oiiotool", path=str(Path(sys.executable).parent)) or shutil.which("oiiotool")
    if tool is None:
        pytest.skip("OpenImageIO came without its command-line tool")
    return subprocess.run([tool, *arguments], capture_output=True, text=True, check=True).stdout


@pytest.mark.parametrize("half", [True, False])
def test_what_is_written_is_read(half, picture, tmp_path):
    ids = np.random.default_rng(1).integers(0, 2**23 + 1, picture.shape[:2]).astype(np.uint32)
    ids[0, :4] = 0, 1, 2**23, NONE
    depth = np.where(picture[..., 0] > 0.9, np.inf, picture[..., 1] * np.float32(1e9))
    metadata = {"pyrt:spp": 32, "pyrt:seconds": 1.5, "pyrt:scene": "cornell", "worldToCamera": MATRIX}
    window = Window(10, 20, 27, 151, 40, 200)
    path = tmp_path / "a.exr"
    planes = {"Z": depth, "object": ids, "N.X": picture[..., 2]}
    assert write_image(path, picture, planes=planes, metadata=metadata, half=half, window=window) == ()
    layers = read_exr(path)
    np.testing.assert_array_equal(layers.pixels, picture.astype(np.float16) if half else picture)
    assert layers.half == half
    assert layers.window == window
    assert layers.planes.keys() == planes.keys()
    for name, plane in planes.items():
        assert layers.planes[name].dtype == (np.uint32 if name == "object" else np.float32)
        np.testing.assert_array_equal(layers.planes[name], plane)
    np.testing.assert_array_equal(layers.metadata.pop("worldToCamera"), MATRIX)
    del metadata["worldToCamera"]
    assert layers.metadata == {**metadata, "PixelAspectRatio": 1.0}  # every EXR file has one


def test_oiiotool_reads_it(picture, tmp_path):
    path = tmp_path / "a.exr"
    planes = {"Z": picture[..., 0], "object": np.full(picture.shape[:2], 7, np.uint32)}
    metadata = {"worldToNDC": MATRIX, "Software": "pyrt"}
    write_image(path, picture, planes=planes, metadata=metadata, window=Window(3, 4, 20, 135, 40, 200))
    text = oiiotool("--info", "-v", str(path))
    for line in (
        "channel list: R (half), G (half), B (half), Z (float), object (uint)",
        "pixel data origin: x=3, y=4",
        "full/display size: 40 x 200",
        "PixelAspectRatio: 1",
        "worldToNDC: 0, 1, 2, 3, 4, 5, 6, 7, 8, 9, 10, 11, 12, 13, 14, 15",
        'Software: "pyrt"',
    ):
        assert line in text
    assert "PASS" in oiiotool("--diff", str(path), str(path))


@pytest.mark.parametrize("name", ["a.png", "a.jpg", "a.hdr", "a.tif"])
def test_other_formats_hold_the_window_alone(name, picture, tmp_path):
    write_image(tmp_path / name, picture, window=Window(3, 4, 20, 135, 40, 200))
    text = oiiotool("--info", "-v", str(tmp_path / name))
    assert "17 x  131" in text
    assert "origin" not in text
    assert "PASS" in oiiotool("--diff", str(tmp_path / name), str(tmp_path / name))


def test_whole_numbers_that_would_be_rounded_are_left_out_with_a_warning(picture, tmp_path):
    ids = np.full(picture.shape[:2], 2**23 + 1, np.uint32)
    (warning,) = write_image(tmp_path / "a.exr", picture, planes={"triangle": ids, "Z": picture[..., 0]})
    assert "triangle is left out: it holds numbers above 8388608" in warning
    assert list(read_exr(tmp_path / "a.exr").planes) == ["Z"]


def test_exr_bytes_are_reproducible(picture, tmp_path, monkeypatch):
    monkeypatch.setenv("SOURCE_DATE_EPOCH", "86400")
    contents = []
    for _ in range(2):
        write_image(tmp_path / "a.exr", picture, planes={"Z": picture[..., 0]}, metadata={"worldToNDC": MATRIX})
        contents.append((tmp_path / "a.exr").read_bytes())
    assert contents[0] == contents[1]


def test_what_is_no_picture_of_ours_is_refused(picture, tmp_path):
    write_image(tmp_path / "a.png", picture)
    oiiotool("--create", "4x4", "1", "--chnames", "Y", "-o", str(tmp_path / "mono.exr"))
    (tmp_path / "bad.exr").write_bytes(b"v/1\x01 and so on")
    for name, problem in {
        "none.exr": "expected an EXR file, found none$",
        "a.png": "expected an EXR file, found png$",
        "mono.exr": "expected channels R, G and B, found Y$",
        "bad.exr": "not a readable image: ",
    }.items():
        with pytest.raises(UsageError, match=f"{name}: {problem}"):
            read_exr(tmp_path / name)


# Views ----------------------------------------------------------------------------------------------------------------


def png(path: Path, image: np.ndarray, **options: str) -> np.ndarray:
    import OpenImageIO as oiio

    write_image(path, image, **options)
    return oiio.ImageInput.open(str(path)).read_image("float")


def test_views_are_opencolorios(tmp_path):
    ramp = np.repeat(np.linspace(0, 4, 64, dtype=np.float32).reshape(8, 8, 1), 3, axis=2)
    plain = png(tmp_path / "a.png", ramp)
    np.testing.assert_allclose(png(tmp_path / "b.png", ramp, view="srgb"), plain, atol=1.5 / 255)
    np.testing.assert_allclose(png(tmp_path / "c.png", ramp, view="raw"), np.minimum(ramp, 1), atol=1.5 / 255)
    film = png(tmp_path / "d.png", ramp, view="aces")[..., 0].ravel()
    assert (np.diff(film) > -1.5 / 255).all()
    assert film[-1] < 0.95  # four times as bright as white, and not clipped yet
    assert plain[..., 0].ravel()[-40:].min() == 1  # negative control: the plain curve clips


def test_unknown_views_are_refused_before_anything_is_written(tmp_path):
    with pytest.raises(UsageError, match='view: expected one of aces, srgb, raw, got "fog"'):
        write_image(tmp_path / "a.png", np.zeros((2, 2, 3)), view="fog")
    assert not list(tmp_path.iterdir())
