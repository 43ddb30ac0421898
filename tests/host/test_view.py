"""`pyrt view` of picture files: half blocks on a terminal, characters elsewhere."""

from __future__ import annotations

import fcntl
import os
import pty
import re
import struct
import subprocess
import sys
import termios
from pathlib import Path

import numpy as np
import pytest

from pyrt.cli import main
from pyrt.image_io import linear_to_srgb, write_image

PACKAGE = Path(__file__).parents[2]
CELL = re.compile("\x1b\\[38;2;(\\d+);(\\d+);(\\d+);48;2;(\\d+);(\\d+);(\\d+)m\u2580")


@pytest.fixture(scope="module")
def picture(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Red above, green below, and a blue square of 8 pixels in the middle of 32 x 16."""
    pixels = np.zeros((16, 32, 3), np.float32)
    pixels[:8, :, 0], pixels[8:, :, 1], pixels[4:12, 12:20] = 1, 0.5, (0, 0, 0.25)
    path = tmp_path_factory.mktemp("view") / "a.exr"
    write_image(path, pixels)
    return path


def on_a_terminal(columns: int, rows: int, *words: object, **environment: str) -> tuple[int, str]:
    """Exit code and output of `pyrt` whose streams are a terminal of that size."""
    ours, theirs = pty.openpty()
    fcntl.ioctl(theirs, termios.TIOCSWINSZ, struct.pack("HHHH", rows, columns, 0, 0))
    kept = {name: value for name, value in os.environ.items() if name not in ("NO_COLOR", "COLUMNS", "LINES")}
    env = {**kept, "PYTHONPATH": str(PACKAGE), "TERM": "xterm-256color", "COLORTERM": "truecolor", **environment}
    command = [sys.executable, "-m", "pyrt", *map(str, words)]
    with subprocess.Popen(command, env=env, stdin=theirs, stdout=theirs, stderr=theirs) as process:
        os.close(theirs)
        output = b""
        while chunk := _read(ours):
            output += chunk
    os.close(ours)
    return process.returncode, output.decode()


def _read(descriptor: int) -> bytes:
    try:
        return os.read(descriptor, 65536)
    except OSError:  # how Linux tells that the other end is closed
        return b""


def pixels_of(output: str) -> np.ndarray:
    """The picture that truecolour half blocks show: (2 * rows, columns, 3)."""
    cells = np.array([[[int(v) for v in cell] for cell in CELL.findall(line)] for line in output.splitlines()])
    return cells.reshape(len(cells), -1, 2, 3).swapaxes(1, 2).reshape(2 * len(cells), -1, 3)


def test_two_pixels_a_character_in_truecolour(picture):
    status, output = on_a_terminal(80, 24, "view", picture)
    shown = pixels_of(output)
    assert status == 0
    assert shown.shape == (16, 32, 3)  # never larger than it is
    green, blue = (round(255 * float(linear_to_srgb(np.float32(value)))) for value in (0.5, 0.25))
    assert shown[0, 0].tolist() == [255, 0, 0]
    assert shown[15, 31].tolist() == [0, green, 0]
    assert (shown[4:12, 12:20] == [0, 0, blue]).all()


def test_it_fits_the_terminal_and_is_brightened(picture):
    shown = pixels_of(on_a_terminal(20, 5, "view", picture, "--exposure", "2")[1])
    assert shown.shape == (8, 16, 3)  # four rows are free; the fifth is for the prompt
    assert shown[3:5, 7:9].tolist() == [[[0, 0, 255]] * 2] * 2


def test_fewer_colours_where_the_terminal_has_fewer(picture):
    output = on_a_terminal(80, 24, "view", picture, COLORTERM="")[1]
    assert "\x1b[38;5;" in output
    assert not CELL.search(output)


@pytest.mark.parametrize(
    "environment",
    [{"NO_COLOR": "1"}, {"TERM": "dumb"}, {"LC_ALL": "C", "PYTHONUTF8": "0", "PYTHONCOERCECLOCALE": "0"}],
    ids=str,
)
def test_characters_where_colours_are_unwanted_or_unknown(picture, environment):
    status, output = on_a_terminal(80, 24, "view", picture, **environment)
    assert status == 0
    assert output.isascii()
    assert "\x1b[" not in output
    assert len(output.splitlines()) == 8


def test_characters_where_stdout_is_no_terminal(picture, capsys):
    assert main(["view", str(picture)]) == 0
    lines = capsys.readouterr().out.splitlines()
    assert [len(line) for line in lines] == [32] * 8
    red, green, blue = lines[0][0], lines[7][0], lines[3][16]
    assert " .:-=+*#%@".index(green) > " .:-=+*#%@".index(red) > " .:-=+*#%@".index(blue)  # by luminance


@pytest.mark.parametrize("option", ["--set=camera.fov=30", "--spp=4", "--device=0"])
def test_options_of_scenes_are_refused_for_pictures(picture, option, capsys):
    assert main(["view", str(picture), option]) == 2
    assert "expected a scene to render, got the picture" in capsys.readouterr().err


@pytest.mark.parametrize(
    ("words", "status", "message"),
    [
        (["missing.exr"], 2, "missing.exr: cannot be read"),
        (["missing.json"], 3, "missing.json: cannot be read"),
        (["missing.exr", "--exposure", "1000"], 2, "exposure: expected stops from -120 to 120"),
    ],
)
def test_errors(words, status, message, capsys):
    assert main(["view", *words]) == status
    assert message in capsys.readouterr().err
