"""Random command lines: whatever is asked for, the answer is a documented exit code, and never a traceback."""

from __future__ import annotations

import io
import json
import os
import warnings
from collections.abc import Iterator
from contextlib import redirect_stderr, redirect_stdout
from pathlib import Path

import pytest
from hypothesis import given
from hypothesis import strategies as st

from pyrt.cli import main
from tests.strategies import examples

EXIT_CODES = {0, 1, 2, 3, 4, 5, 130}
SCENE = {
    "integrator": {"spp": 1},
    "film": {"resolution": [4, 3]},
    "objects": [{"type": "sphere", "center": [0, 0, -3], "radius": 1, "light": {"radiance": [1, 0.5, 0]}}],
}
LONG = "x" * 300
ODD = "\u00e9\u202e\udc80"  # é, a mark that turns the line around, a byte that is not UTF-8


@pytest.fixture(scope="module", autouse=True)
def folder(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Path]:
    """The current folder of the module's tests, with a few files."""
    folder = tmp_path_factory.mktemp("command line")
    (folder / "scene.json").write_text(json.dumps(SCENE))
    (folder / os.fsdecode(b"\xff.json")).write_text(json.dumps(SCENE))
    (folder / "broken.json").write_text('{"film": }')
    (folder / "invalid.json").write_text('{"objects": [{"type": "cube"}]}')
    (folder / "folder.png").mkdir()
    before = Path.cwd()
    os.chdir(folder)
    yield folder
    os.chdir(before)


def run(arguments: list[str]) -> tuple[int, str]:
    """Exit code and stderr, of streams that are as strict as a terminal's."""
    out = io.TextIOWrapper(io.BytesIO(), encoding="utf-8")
    err = io.TextIOWrapper(io.BytesIO(), encoding="utf-8", errors="backslashreplace")
    with redirect_stdout(out), redirect_stderr(err), warnings.catch_warnings():
        warnings.simplefilter("error")
        code = main(arguments)
    err.seek(0)
    assert code in EXIT_CODES
    return code, err.read()


odd_texts = st.sampled_from(["", " ", "-", "--", "-1", "0", "1e999", "nan", "inf", "²", "9" * 5000, LONG, ODD])
scenes = st.sampled_from(
    ["scene.json"] * 6
    + [os.fsdecode(b"\xff.json"), "broken.json", "invalid.json", "missing.json", "folder.png", "/dev/null"]
    + ["example:", "example:nothing", "example:../scene", f"example:{LONG}", "example:a/b", f"{LONG}.json"]
)
outputs = st.sampled_from(
    ["a.png", "a.exr", "b.jpg", "c.npy", "c.hdr", "d.tif", "folder.png", "no/such/a.png"]
    + ["a", ".png", f"{LONG}.exr", "/"]
)
settings = st.sampled_from(
    ["camera.fov=30", "camera.fov=0", "film.resolution=[2,2]", "film.resolution=[2]", "a", "="]
    + ["objects.0.radius=1e-300"]
    + ["objects.0.light.radiance=[1e30,1e30,1e30]", "objects.7.type=x", "x.y.z=1", "objects=null"]
    + ["camera=" + "[" * 2000]
    + ["camera.position=[0,0,1e29]", "integrator.max_depth=1024", f"{LONG}=1", "objects.0.type=" + ODD, "film=1"]
)
OPTIONS = {
    "--spp": st.sampled_from(["1", "2", "17", "0", "-1", "1.5", "1073741825"]) | odd_texts,
    "--size": st.sampled_from(["3x2", "1x1", "0x1", "65537x1", "65536x65536", "1", "x", "²x²", "1x1x1"]) | odd_texts,
    "--seed": st.sampled_from(["0", "4294967295", "4294967296", "-1"]) | odd_texts,
    "--exposure": st.sampled_from(["1", "-1", "300", "-3000", "1e9", "x"]) | odd_texts,
    "--noise": st.sampled_from(["0.5", "1e-300", "0", "-1", "x"]) | odd_texts,
    "--time": st.sampled_from(["1", "1s", "0.001m", "s", "1d", "-1h", "1e308h"]) | odd_texts,
    "--device": st.sampled_from(["0", "pocl", "none of these", "99"]) | odd_texts,
    "--progress": st.sampled_from(["auto", "bar", "json", "none", "loud"]),
    "--stats": st.sampled_from(["-", "stats.json", "folder.png", "no/such/stats.json"]) | odd_texts,
    "--output": outputs | odd_texts,
    "--set": settings | odd_texts,
    "--no-clobber": None,
    "--dry-run": None,
    "--float": None,
    "--verbose": None,
    "--threads": st.sampled_from(["0", "-1", "x"]) | odd_texts,  # more would change this process
    "--view": st.sampled_from(["aces", "srgb", "sepia"]) | odd_texts,
    "--crop": st.sampled_from(["0,0,1,1", "0,0,9,9", "1,1,0,0", "1,2", "x"]) | odd_texts,
    "--aov": st.sampled_from(["z", "z,normal", "z,z", "x", ","]) | odd_texts,
    "--quiet": None,
    "--unknown": odd_texts,
}


@st.composite
def command_lines(draw: st.DrawFn) -> list[str]:
    verb = draw(st.sampled_from(["render"] * 5 + ["validate", "info", "view", "schema", "devices", "help", ""]))
    words = [verb, draw(scenes)]
    for name in draw(st.lists(st.sampled_from(sorted(OPTIONS)), max_size=4, unique=True)):
        values = OPTIONS[name]
        words.append(name if values is None else f"{name}={draw(values)}")
    # few samples, unless the line itself says otherwise; at most, so that a limit of noise or time cannot take long
    return [*words, "--spp=4"] if verb == "render" and not any(w.startswith("--spp") for w in words) else words


def check(words: list[str]) -> None:
    code, err = run(words)
    assert "Traceback" not in err
    assert code in (0, 5) or err.strip(), "an error without a word"


@examples(150)
@given(command_lines())
def test_every_command_line_ends_with_a_documented_exit_code(words):
    check(words)


@pytest.mark.slow
@examples(3000)
@given(command_lines())
def test_many_command_lines_end_with_documented_exit_codes(words):
    check(words)
