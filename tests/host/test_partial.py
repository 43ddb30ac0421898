"""Films in EXR files: the same bits come back, anything else is refused in one sentence, merging takes no nonsense."""

from __future__ import annotations

import json
from dataclasses import replace
from itertools import pairwise
from pathlib import Path

import numpy as np
import pytest

from pyrt.errors import UsageError
from pyrt.exr_state import StatePart
from pyrt.files import remove_leftovers, replacing
from pyrt.film import Film
from pyrt.image_io import read_texture, write_image
from pyrt.partial import Adaptive, Partial, PartialAdaptive, Work, merge, merge_order
from pyrt.partial_file import read_adaptive, read_header, read_partial, state_part

WIDTH, HEIGHT = 7, 5
WORK = Work("c0ffee", WIDTH, HEIGHT, (0, 0, WIDTH, HEIGHT), 3, "a device", "0.1.0", "beef")
PICTURE = np.linspace(0, 1, WIDTH * HEIGHT * 3, dtype=np.float32).reshape(HEIGHT, WIDTH, 3)


def partial_of(first: int, end: int, seed: int = 0) -> Partial:
    """Random samples with bad ones among them, in an order of pixels of its own."""
    rng = np.random.default_rng(seed)
    planes = np.exp(rng.uniform(-20, 20, (end, 3, WIDTH * HEIGHT))).astype(np.float32)
    planes[rng.random(planes.shape) < 0.01] = np.nan
    film = Film.empty(WIDTH * HEIGHT)
    film.add(planes[first:], 0, first)
    return Partial(WORK, first, end, 64, film, np.random.default_rng(1).permutation(WIDTH * HEIGHT))


def written(path: Path, partial: Partial) -> Path:
    write_image(path, PICTURE, state=state_part(partial))
    return path


def assert_same_film(a: Partial, b: Partial) -> None:
    assert (a.first, a.end, a.spp, a.work) == (b.first, b.end, b.spp, b.work)
    assert a.film.nodes().keys() == b.film.nodes().keys()
    for key, sums in a.film.nodes().items():
        assert sums[:, :, a.order].tobytes() == b.film.nodes()[key][:, :, b.order].tobytes()
    assert (a.film.count[a.order] == b.film.count[b.order]).all()
    assert a.film.dropped == b.film.dropped


# Round trip -----------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize(("first", "end"), [(0, 64), (0, 63), (5, 29), (31, 32)])
def test_what_is_read_has_the_bits_of_what_was_written(tmp_path, first, end):
    partial = partial_of(first, end)
    file = written(tmp_path / "a.exr", partial)
    assert read_header(file) == (WORK, first, end)
    assert_same_film(read_partial(file), partial)
    assert_same_film(read_partial(file, WORK, partial.order), partial)


def test_an_adaptive_render_comes_back_too(tmp_path):
    rng, pixels = np.random.default_rng(0), WIDTH * HEIGHT
    state = Adaptive(
        sums=np.exp(rng.uniform(-20, 20, (2, 3, pixels))),
        count=rng.integers(0, 2**32, pixels, np.uint32),
        error=np.where(rng.random(pixels) < 0.5, np.inf, rng.random(pixels)),
        level=rng.integers(0, 31, pixels, np.uint8),
        wanted=rng.integers(0, 31, pixels, np.uint8),
        classes=rng.integers(0, 4, pixels, np.uint8),
        decay=rng.random(5),
        falls=np.exp(rng.uniform(-20, 20, (3, 5))),
        dropped=3,
    )
    order = rng.permutation(pixels)
    write_image(tmp_path / "a.exr", PICTURE, state=state_part(PartialAdaptive(WORK, 0.1, 64, state, order)))
    found = read_adaptive(tmp_path / "a.exr", WORK, order)
    assert (found.noise, found.spp, found.work) == (0.1, 64, WORK)
    for name, value in vars(state).items():
        assert np.array_equal(getattr(found.state, name), value)
    with pytest.raises(UsageError, match="it was rendered with --noise or --time"):
        read_partial(tmp_path / "a.exr")
    with pytest.raises(UsageError, match="expected a render with --noise or --time"):
        read_adaptive(written(tmp_path / "b.exr", partial_of(0, 4)), WORK, order)


def test_the_file_is_a_picture_too(tmp_path):
    file = written(tmp_path / "a.exr", partial_of(0, 3))
    assert (read_texture(file).pixels == PICTURE.astype(np.float16)).all()


@pytest.mark.parametrize("cuts", [(1, 5, 8), (32,), (13, 14)])
def test_merged_parts_have_the_bits_of_the_whole(tmp_path, cuts):
    whole = partial_of(0, 64)
    assert whole.film.dropped > 0
    ends = [0, *cuts, 64]
    rng = np.random.default_rng(0)
    planes = np.exp(rng.uniform(-20, 20, (64, 3, WIDTH * HEIGHT))).astype(np.float32)
    planes[rng.random(planes.shape) < 0.01] = np.nan
    parts = []
    for first, end in pairwise(ends):
        film = Film.empty(WIDTH * HEIGHT)
        film.add(planes[first:end], 0, first)
        parts.append(read_partial(written(tmp_path / f"{first}.exr", replace(whole, first=first, end=end, film=film))))
    merged = parts[0]
    for part in parts[1:]:
        merged = merge(merged, part)
    assert_same_film(merged, whole)


# Refusals -------------------------------------------------------------------------------------------------------------


def test_the_order_is_that_of_the_samples():
    assert merge_order({"c": (WORK, 9, 12), "a": (WORK, 0, 4), "b": (WORK, 4, 9)}) == ["a", "b", "c"]


@pytest.mark.parametrize(
    ("other", "message"),
    [
        ((WORK, 3, 8), "a and b overlap: they hold the samples 0:4 and 3:8"),
        ((WORK, 0, 4), "a and b overlap"),
        ((WORK, 6, 8), "a and b leave a gap: they hold the samples 0:4 and 6:8"),
        ((replace(WORK, scene="f00d"), 4, 8), r"b: its samples are of another scene \(f00d\), expected c0ffee"),
        ((replace(WORK, width=8), 4, 8), r"b: its samples are of another width \(8\), expected 7"),
        ((replace(WORK, seed=4), 4, 8), "b: its samples are of another seed"),
        ((replace(WORK, device="b"), 4, 8), "b: its samples are of another device"),
        ((replace(WORK, pyrt="9"), 4, 8), "b: its samples are of another pyrt"),
        ((replace(WORK, kernels="9"), 4, 8), "b: its samples are of another kernels"),
    ],
)
def test_parts_that_do_not_fit_are_refused(other, message):
    with pytest.raises(UsageError, match=message):
        merge_order({"a": (WORK, 0, 4), "b": other})


def refusal(path: Path) -> str:
    """The one sentence, which begins with the file."""
    with pytest.raises(UsageError) as caught:
        read_partial(path)
    text = str(caught.value)
    assert text.startswith(f"{path}: ")
    assert "\n" not in text
    return text


def test_other_files_are_refused(tmp_path):
    assert "found none" in refusal(tmp_path / "none.exr")
    assert "found none" in refusal(tmp_path)
    for name in ("plain.exr", "plain.png"):
        write_image(tmp_path / name, PICTURE)
        assert "expected a file that pyrt wrote with --checkpoint or --samples" in refusal(tmp_path / name)
    (tmp_path / "text.exr").write_text("no picture")
    assert "expected a file that pyrt wrote" in refusal(tmp_path / "text.exr")


@pytest.mark.parametrize(
    ("path", "value"),
    [
        (("format",), 2),
        (("samples",), [4, 4]),
        (("samples",), [0, 2**40]),
        (("samples",), [0, 4.5]),
        (("work", "width"), 1 << 16),
        (("work", "height"), -1),
        (("work", "seed"), None),
        (("work",), "text"),
    ],
)
def test_headers_that_make_no_sense_are_refused(tmp_path, path, value):
    part = state_part(partial_of(0, 4))
    header = json.loads(part.header)
    place = header if len(path) == 1 else header[path[0]]
    place[path[-1]] = value
    write_image(tmp_path / "a.exr", PICTURE, state=part._replace(header=json.dumps(header)))
    assert "damaged" in refusal(tmp_path / "a.exr")


def test_a_header_that_is_no_json_is_refused(tmp_path):
    blocks = iter([np.zeros((2, 2), np.uint32)])
    write_image(tmp_path / "a.exr", PICTURE, state=StatePart("{" * 9999, 2, 2, blocks))
    assert "damaged" in refusal(tmp_path / "a.exr")


def test_flipped_bits_are_noticed_or_change_nothing(tmp_path):
    """EXR itself has fields between the rows that its reader does not need."""
    partial = partial_of(0, 5)
    file = written(tmp_path / "a.exr", partial)
    data = file.read_bytes()
    noticed = 0
    for place in np.random.default_rng(0).integers(0, len(data), 60):
        bad = bytearray(data)
        bad[place] ^= 0x10
        file.write_bytes(bad)
        try:
            assert_same_film(read_partial(file), partial)
        except UsageError as error:
            noticed += str(error).startswith(f"{file}: ")
    assert noticed > 30


@pytest.mark.parametrize("share", [0.0, 0.02, 0.1, 0.5, 0.9, 0.999])
def test_files_that_were_cut_short_are_refused(tmp_path, share):
    file = written(tmp_path / "a.exr", partial_of(0, 5))
    data = file.read_bytes()
    file.write_bytes(data[: int(share * len(data))])
    refusal(file)


# Leftovers ------------------------------------------------------------------------------------------------------------


def test_leftovers_of_killed_writers_are_removed_and_nothing_else(tmp_path):
    target = tmp_path / "a[1].exr"
    keep = ["a[1].exr", ".a[1].exr", ".a[1].nothex99.exr", ".b.0123abcd.exr", ".a[1].0123abcd.png"]
    with replacing(target) as temporary:
        leftover = temporary.name
        temporary.write_bytes(b"new")
    for name in (*keep, leftover):
        (tmp_path / name).touch()
    remove_leftovers(target)
    assert sorted(file.name for file in tmp_path.iterdir()) == sorted(keep)
