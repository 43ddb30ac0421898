"""Textures are decoded exactly, pictures are encoded exactly, and files are all or nothing."""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path
from typing import Any

import numpy as np
import OpenImageIO as oiio
import pytest

from pyrt import image_file, image_io
from pyrt.errors import PyrtError, SceneError, UsageError
from pyrt.image_io import check_output, linear_to_srgb, read_texture, srgb_to_linear, write_image


def store(path: Path, pixels: np.ndarray, kind: str, names: tuple[str, ...] = (), **attributes: Any) -> Path:
    spec = oiio.ImageSpec(pixels.shape[1], pixels.shape[0], pixels.shape[2], kind)
    if names:
        spec.channelnames = names
    for name, value in attributes.items():
        spec.attribute(name.replace("__", ":"), value)
    file = oiio.ImageOutput.create(str(path))
    assert file is not None
    assert file.open(str(path), spec), file.geterror()
    assert file.write_image(np.ascontiguousarray(pixels))
    file.close()
    return path


def stored(path: Path) -> tuple[Any, np.ndarray]:
    file = oiio.ImageInput.open(str(path))
    assert file is not None
    pixels = file.read_image("float")
    assert pixels is not None
    return file.spec(), pixels


@pytest.fixture
def picture() -> np.ndarray:
    return np.random.default_rng(0).random((13, 17, 3)).astype(np.float32)


def test_srgb_curve_is_the_standards() -> None:
    codes = np.arange(256) / 255
    # reference values of IEC 61966-2-1, in float64
    np.testing.assert_allclose(
        srgb_to_linear(np.array([0, 0.04045, 0.5, 1])), [0, 0.04045 / 12.92, 0.21404114, 1], atol=1e-8
    )
    np.testing.assert_allclose(linear_to_srgb(srgb_to_linear(codes)), codes, atol=1e-7)


@pytest.mark.parametrize(("kind", "dtype"), [("uint8", np.uint8), ("uint16", np.uint16)])
def test_integers_are_srgb_unless_overridden(kind: str, dtype: type, tmp_path: Path) -> None:
    codes = np.arange(256).astype(dtype) * (257 if dtype is np.uint16 else 1)
    pixels = np.repeat(codes.reshape(16, 16, 1), 3, axis=2)
    path = store(tmp_path / "a.png", pixels, kind)
    fractions = pixels / np.iinfo(dtype).max
    assert read_texture(path).pixels.dtype == np.float32
    np.testing.assert_array_equal(read_texture(path).pixels, srgb_to_linear(fractions).astype(np.float32))
    np.testing.assert_array_equal(read_texture(path, "linear").pixels, fractions.astype(np.float32))
    assert read_texture(path).warnings == ()


@pytest.mark.parametrize("name", ["a.exr", "a.hdr", "a.tif"])
def test_floats_are_linear_unless_overridden(name: str, picture: np.ndarray, tmp_path: Path) -> None:
    path = store(tmp_path / name, picture, "float")
    tolerance = 0.01 if name == "a.hdr" else 0  # 8 bits of mantissa, shared exponent
    np.testing.assert_allclose(read_texture(path).pixels, picture, atol=tolerance)
    expected = srgb_to_linear(read_texture(path).pixels.astype(np.float64))
    np.testing.assert_allclose(read_texture(path, "srgb").pixels, expected, rtol=1e-5)


def test_tags_of_the_file_count(picture: np.ndarray, tmp_path: Path) -> None:
    linear = store(tmp_path / "a.png", picture, "uint16", oiio__ColorSpace="lin_rec709_scene")
    np.testing.assert_allclose(read_texture(linear).pixels, picture, atol=1e-5)
    srgb = store(tmp_path / "a.tif", picture, "float", oiio__ColorSpace="sRGB")
    np.testing.assert_allclose(read_texture(srgb).pixels, srgb_to_linear(picture), atol=1e-6)


def test_grey_is_replicated_and_alpha_dropped_with_a_warning(picture: np.ndarray, tmp_path: Path) -> None:
    grey = store(tmp_path / "grey.png", picture[..., :1], "uint8")
    pixels = read_texture(grey).pixels
    assert pixels.shape == (13, 17, 3)
    assert (pixels[..., 0] == pixels[..., 2]).all()
    colors = np.full((4, 4, 3), 200, np.uint8)
    half_clear = np.dstack([colors, np.full((4, 4, 1), 100, np.uint8)])
    path = store(tmp_path / "clear.png", half_clear, "uint8", oiio__UnassociatedAlpha=1)
    clear = read_texture(path)
    np.testing.assert_allclose(clear.pixels, srgb_to_linear(np.array(200 / 255)), rtol=1e-6)
    assert clear.warnings == (f"{path}: the image's alpha is not used",)
    opaque = np.dstack([colors, np.full((4, 4, 1), 255, np.uint8)])
    assert read_texture(store(tmp_path / "opaque.png", opaque, "uint8")).warnings == ()


def test_channels_go_by_name(picture: np.ndarray, tmp_path: Path) -> None:
    depth = np.full((13, 17, 1), 9, np.float32)
    path = store(tmp_path / "a.exr", np.dstack([depth, picture]), "float", ("Z", "R", "G", "B"))
    np.testing.assert_array_equal(read_texture(path).pixels, picture)
    path = store(tmp_path / "b.exr", picture, "float", ("N.X", "N.Y", "N.Z"))
    with pytest.raises(SceneError, match=r"b\.exr: expected channels R, G, B or Y, found N\.X, N\.Y, N\.Z"):
        read_texture(path)


def test_row_0_is_at_the_top(tmp_path: Path) -> None:
    rows = np.zeros((2, 2, 3), np.uint8)
    rows[0] = 255
    for name in ("a.png", "a.exr", "a.tif"):
        assert read_texture(store(tmp_path / name, rows / np.float32(255), "float")).pixels[0].min() == 1


def test_exr_holds_planes_and_metadata(picture: np.ndarray, tmp_path: Path) -> None:
    path = tmp_path / "out.exr"
    variance = picture[..., 0] * np.float32(1 / 3)
    metadata = {"pyrt:spp": 32, "pyrt:seed": 2**32 - 1, "pyrt:seconds": 1.5, "pyrt:scene": "cornell"}
    assert write_image(path, picture, planes={"variance.R": variance, "Z": variance}, metadata=metadata) == ()
    spec, pixels = stored(path)
    assert spec.channelnames == ("R", "G", "B", "Z", "variance.R")
    assert [str(f) for f in spec.channelformats] == ["half", "half", "half", "float", "float"]
    np.testing.assert_array_equal(pixels[..., :3], picture.astype(np.float16))
    np.testing.assert_array_equal(pixels[..., 4], variance)
    found = {name: spec.getattribute(name) for name in metadata}
    assert found == {**metadata, "pyrt:seed": "4294967295"}


@pytest.mark.parametrize("name", ["a.exr", "a.tif", "a.npy"])
def test_linear_formats_keep_floats(name: str, picture: np.ndarray, tmp_path: Path) -> None:
    write_image(tmp_path / name, picture * 3, half=False, exposure=5)
    found = np.load(tmp_path / name) if name == "a.npy" else stored(tmp_path / name)[1]
    np.testing.assert_array_equal(found, picture * 3)


def test_hdr_keeps_8_bits_of_mantissa(picture: np.ndarray, tmp_path: Path) -> None:
    write_image(tmp_path / "a.hdr", picture * 1000)
    np.testing.assert_allclose(stored(tmp_path / "a.hdr")[1], picture * 1000, atol=4)


def test_half_overflow_is_clamped_with_a_warning(tmp_path: Path) -> None:
    bright = np.full((2, 2, 3), 1.0, np.float32)
    bright[0, 0] = 1e6
    (warning,) = write_image(tmp_path / "a.exr", bright)
    assert warning == f"{tmp_path}/a.exr: 3 values above 65504 are clamped to that, the largest half float"
    assert stored(tmp_path / "a.exr")[1].max() == 65504
    assert write_image(tmp_path / "a.exr", bright, half=False) == ()
    assert stored(tmp_path / "a.exr")[1].max() == 1e6


def test_png_is_srgb_with_exposure_and_clipping(tmp_path: Path) -> None:
    exact = srgb_to_linear(np.arange(256) / 255).astype(np.float32)  # codes that dithering leaves alone
    image = np.repeat(exact.reshape(16, 16, 1), 3, axis=2)
    write_image(tmp_path / "a.png", image / 4, exposure=2)
    spec, pixels = stored(tmp_path / "a.png")
    assert spec.getattribute("oiio:ColorSpace").startswith("srgb")
    np.testing.assert_allclose(pixels[..., 1].ravel() * 255, np.arange(256), atol=1.001)
    assert (np.round(pixels[..., 1].ravel() * 255) == np.arange(256)).mean() > 0.97
    write_image(tmp_path / "b.png", np.array([[[-1, 2, np.nan]]], np.float32))
    assert stored(tmp_path / "b.png")[1].tolist() == [[[0, 1, 0]]]


@pytest.mark.parametrize("code", [0.3, 10.25, 127.5, 200.9])
def test_dithering_is_unbiased(code: float, tmp_path: Path) -> None:
    flat = np.full((128, 128, 3), srgb_to_linear(np.array(code / 255)), np.float32)
    write_image(tmp_path / "a.png", flat)
    pixels = stored(tmp_path / "a.png")[1] * 255
    assert pixels.min() < code < pixels.max()  # without dithering all are equal, and off by up to half a code
    np.testing.assert_allclose(pixels.mean(axis=(0, 1)), code, atol=0.01)


def test_jpeg_is_close(tmp_path: Path) -> None:
    ramp = np.linspace(0, 1, 64 * 64 * 3, dtype=np.float32).reshape(64, 64, 3)
    write_image(tmp_path / "a.jpg", ramp)
    assert np.abs(stored(tmp_path / "a.jpg")[1] - linear_to_srgb(ramp)).mean() < 0.01


@pytest.mark.parametrize("name", ["a.exr", "a.png", "a.jpg", "a.tif", "a.hdr", "a.npy"])
def test_bytes_are_reproducible(
    name: str, picture: np.ndarray, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("SOURCE_DATE_EPOCH", "86400")
    contents = []
    for time in (1e9, 2e9):
        monkeypatch.setattr(image_file.time, "time", lambda now=time: now)
        write_image(tmp_path / name, picture)
        contents.append((tmp_path / name).read_bytes())
    assert contents[0] == contents[1]
    monkeypatch.delenv("SOURCE_DATE_EPOCH")
    write_image(tmp_path / name, picture)
    assert ((tmp_path / name).read_bytes() == contents[0]) == (name not in ("a.exr", "a.tif"))


def test_a_failed_write_leaves_the_old_file(
    picture: np.ndarray, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    path = tmp_path / "a.png"
    path.write_bytes(b"old")

    def fail(temporary: Path, *_: object) -> None:
        temporary.write_bytes(b"half a pict")
        raise OSError(28, "No space left on device")

    with monkeypatch.context() as patch:
        patch.setattr(image_io, "write_file", fail)
        with pytest.raises(PyrtError, match=r"a\.png: cannot be written: no space left on device$"):
            write_image(path, picture)
    assert path.read_bytes() == b"old"
    write_image(path, picture)
    assert path.read_bytes() != b"old"
    assert [file.name for file in tmp_path.iterdir()] == ["a.png"]


def test_a_link_stays_a_link(picture: np.ndarray, tmp_path: Path) -> None:
    (tmp_path / "real.png").touch()
    (tmp_path / "link.png").symlink_to("real.png")
    write_image(tmp_path / "link.png", picture)
    assert (tmp_path / "link.png").is_symlink()
    assert (tmp_path / "real.png").stat().st_size > 0


def test_outputs_are_checked_before_rendering(tmp_path: Path) -> None:
    (tmp_path / "folder.png").mkdir()
    for name, problem in {
        "a.xyz": "expected a name ending in .exr, .hdr, .jpeg, .jpg, .npy, .png, .tif, .tiff$",
        "a": "expected a name ending in",
        "no/a.png": "there is no folder .*no$",
        "folder.png": "expected a file name, found a folder$",
    }.items():
        with pytest.raises(UsageError, match=f"{name}: {problem}"):
            check_output(tmp_path / name)
        with pytest.raises(UsageError, match=problem):
            write_image(tmp_path / name, np.zeros((1, 1, 3)))
    check_output(tmp_path / "a.PNG")
    check_output("a.exr")


def test_openimageio_is_imported_only_to_read_or_write() -> None:
    code = "import sys, pyrt.image_io; sys.exit('OpenImageIO' in sys.modules)"
    subprocess.run([sys.executable, "-c", code], check=True, cwd=Path(__file__).parents[2])


def test_colours_are_in_the_order_that_packing_takes(tmp_path):
    """Otherwise every use of a large texture would copy it."""
    write_image(tmp_path / "a.png", np.zeros((3, 2, 3)))
    assert read_texture(tmp_path / "a.png").pixels.flags.c_contiguous
