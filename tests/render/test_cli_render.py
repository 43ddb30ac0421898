"""`pyrt render`: what it would do, what it tells on the way, when it stops, and places where it can hardly write."""

from __future__ import annotations

import json
import os
import re
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

from pyrt.cli import main
from pyrt.image_io import read_picture

SCENE = "example:cornell"
SIZE = ["--size", "16x12"]
PACKAGE = Path(__file__).parents[2]


def shell(command: str, folder: Path, **environment: str) -> subprocess.CompletedProcess[str]:
    """Runs a shell command in which `pyrt` is `python -m pyrt`, in a folder; stops it after five minutes."""
    env = {**os.environ, "PYTHONPATH": str(PACKAGE), **environment}
    script = f'pyrt() {{ "{sys.executable}" -m pyrt "$@"; }}\n{command}'
    return subprocess.run(["bash", "-c", script], cwd=folder, env=env, capture_output=True, timeout=300, text=True)


def render(capsys: pytest.CaptureFixture[str], *words: object) -> tuple[int, str, str]:
    """Exit code, stdout and stderr of `pyrt render example:cornell --size 16x12 …`."""
    status = main(["render", SCENE, *SIZE, *map(str, words)])
    return status, *capsys.readouterr()


# --- what it would do -------------------------------------------------------------------------------------------------


def test_a_dry_run_tells_and_writes_nothing(tmp_path, capsys):
    (tmp_path / "a.exr").write_text("old")
    outputs = ["-o", tmp_path / "a.exr", "-o", tmp_path / "b.png"]
    status, out, err = render(capsys, "--dry-run", *outputs, "--noise", "0.01", "--time", "5m", "--crop", "0,0,8,4")
    assert (status, err) == (0, "")
    for line in (
        "scene      cornell: 16x12",
        "memory     about",
        "stop at    an error of 0.01, or 300 s, or 65536 samples per pixel",
        "pixels     8x4, seed 0",
        f"b.png, replacing {tmp_path / 'a.exr'}\n",
    ):
        assert line in out
    assert [file.name for file in tmp_path.iterdir()] == ["a.exr"]


@pytest.mark.parametrize(
    ("words", "status"),
    [
        (["--set", "camera.fovv=3"], 3),
        (["--spp", "0"], 2),
        (["--crop", "0,0,17,12"], 2),
        (["--noise", "-1"], 2),
        (["-o", "no/such/folder.png"], 2),
        (["--view", "sepia"], 2),
    ],
    ids=str,
)
def test_a_dry_run_refuses_what_the_render_would(words, status, capsys):
    assert render(capsys, "--dry-run", *words)[0] == status


def test_a_dry_run_tells_the_memory_of_what_is_asked_for(tmp_path, capsys):
    def memory(*words: str) -> int:
        out = render(capsys, "--dry-run", "--size", "1024x1024", "-o", str(tmp_path / "a.exr"), *words)[1]
        return int(re.search(r"memory +about (\d+) MiB", out)[1])

    plain = memory()
    for words in (["--noise", "0.01"], ["--time", "9s"], ["--aov", "z,normal"], ["--checkpoint", "9s"], ["--resume"]):
        assert memory(*words) > plain
    assert memory("--crop", "0,0,64,64") < plain


def test_a_dry_run_needs_no_device(tmp_path):
    done = shell(f"pyrt render {SCENE} --dry-run", tmp_path, OCL_ICD_VENDORS="/nonexistent")
    assert done.returncode == 0, done.stderr


# --- what it tells ----------------------------------------------------------------------------------------------------


def test_verbose_names_stages_with_seconds_and_rays(tmp_path, capsys):
    status, out, err = render(capsys, "-v", "--spp", "2", "-o", tmp_path / "a.png")
    assert (status, out) == (0, "")
    words = [line.split() for line in err.splitlines()]
    assert [line[0] for line in words[:5]] == ["load", "build", "compile", "render", "save"]
    assert all(float(line[1]) >= 0 and line[2] == "s" for line in words[:5])
    assert f"{16 * 12 * 2} camera" in err


def test_quiet_and_json_progress_go_together(tmp_path, capsys):
    err = render(capsys, "-q", "--progress", "json", "--spp", "1", "-o", tmp_path / "a.png")[2]
    assert all(json.loads(line) for line in err.splitlines())


def test_progress_of_a_noise_target_knows_the_error_and_what_is_left(tmp_path, capsys):
    err = render(capsys, "-q", "--progress=json", "--noise=0.002", "-o", tmp_path / "a.png")[2]
    events = [event for event in map(json.loads, err.splitlines()) if event["stage"] == "render"]
    errors = [event["noise"] for event in events]
    assert errors[1] is None  # after the first half of the first round
    assert (events[1]["done"], events[1]["eta"]) == (0.0, None)
    assert errors[-1] is not None
    assert 0.05 < events[-1]["done"] <= 1.0
    assert events[-1]["eta"] >= 0.0


# --- when it stops ----------------------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("limits", "status", "most"),
    [
        (["--spp=4"], 0, 4),
        (["--noise=10"], 0, 16),  # reached by the first samples
        (["--noise=10", "--spp=64"], 0, 16),
        (["--noise=1e-6", "--spp=64"], 5, 64),
        (["--noise=1e-6", "--spp=1"], 5, 1),  # too few to know the error
        (["--noise=1e-6", "--time=0.001"], 5, 64),
        (["--noise=10", "--time=1h"], 0, 16),
        (["--time=0.001"], 0, 64),  # no target, so nothing was missed
        (["--time=1h", "--spp=32"], 0, 32),
        (["--noise=1e-6", "--time=1h", "--spp=32"], 5, 32),
    ],
    ids=str,
)
def test_the_first_limit_reached_ends_it(limits, status, most, tmp_path, capsys):
    code, out, _ = render(capsys, "-q", *limits, "-o", tmp_path / "a.png", "--stats", "-")
    assert code == status
    assert 0 < json.loads(out)["samples"] <= 16 * 12 * most
    assert (tmp_path / "a.png").exists()


# --- pictures ---------------------------------------------------------------------------------------------------------


def test_float_keeps_all_bits(tmp_path, capsys):
    outputs = [tmp_path / name for name in ("a.exr", "b.npy", "c.exr")]
    assert render(capsys, "--spp=2", "--float", "-o", outputs[0], "-o", outputs[1])[0] == 0
    assert render(capsys, "--spp=2", "-o", outputs[2])[0] == 0
    full, exact, half = (read_picture(path).pixels for path in outputs)
    np.testing.assert_array_equal(full, exact)
    np.testing.assert_array_equal(half, exact.astype(np.float16).astype(np.float32))
    assert (half != exact).any()


def test_a_scene_whose_file_name_is_no_text_is_named_in_the_header(tmp_path):
    square = {"type": "rectangle", "center": [0, 0, 0], "edge1": [1, 0, 0], "edge2": [0, 1, 0], "material_name": "grey"}
    scene = {"materials": {"grey": {"type": "diffuse", "color": [0.5, 0.5, 0.5]}}, "objects": [square]}
    path = tmp_path / os.fsdecode(b"\xff.json")
    path.write_text(json.dumps(scene))
    assert main(["render", str(path), *SIZE, "--spp=1", "-q", "-o", str(tmp_path / "a.exr")]) == 0
    assert rb"\udcff" in (tmp_path / "a.exr").read_bytes()


def test_threads_change_nothing_but_the_speed(tmp_path):
    command = f"pyrt render {SCENE} --size 24x20 --spp 4 -q -o"
    done = shell(f"{command} a.npy --threads 1 && {command} b.npy", tmp_path)
    assert done.returncode == 0, done.stderr
    assert (tmp_path / "a.npy").read_bytes() == (tmp_path / "b.npy").read_bytes()


def test_threads_are_limited():
    from pyrt.device import choose_device

    if choose_device().compute_units < 2:
        pytest.skip("this machine has one core")
    code = (
        "from pyrt.toolchain import limit_threads; from pyrt.device import choose_device\n"
        "limit_threads(1); print(choose_device().compute_units)"
    )
    env = {**os.environ, "PYTHONPATH": str(PACKAGE)}
    done = subprocess.run([sys.executable, "-c", code], env=env, capture_output=True, text=True, check=True)
    assert done.stdout == "1\n"


def test_a_limit_of_threads_that_comes_too_late_is_an_error(tmp_path, capsys, monkeypatch):
    from pyrt.device import choose_device

    if choose_device().compute_units < 2:  # which also makes sure that PoCL runs in this process already
        pytest.skip("this machine has one core")
    for name in ("POCL_MAX_PTHREAD_COUNT", "POCL_CPU_MAX_CU_COUNT"):
        monkeypatch.setenv(name, "0")  # so that it is restored
    status, _, err = render(capsys, "--threads=1", "-o", tmp_path / "a.png")
    assert (status, "to limit its threads" in err) == (4, True)
    assert render(capsys, "--threads=0")[0] == 2


def test_a_scene_is_viewed_as_a_small_picture(capsys):
    assert main(["view", SCENE, "--spp", "1", "--exposure", "2"]) == 0
    lines = capsys.readouterr().out.splitlines()
    assert len(lines) == 24  # of a terminal of 25
    assert max(map(len, lines)) <= 48
    assert len(set("".join(lines))) > 5
    assert main(["view", SCENE, "--spp", "0"]) == 2


# --- where it can hardly write ----------------------------------------------------------------------------------------


@pytest.mark.skipif(not Path("/dev/full").exists(), reason="needs /dev/full")
@pytest.mark.parametrize("streams", ["2>/dev/full", "2>&1 | head -1 >/dev/null"])
def test_messages_that_nobody_can_read_do_not_stop_it(streams, tmp_path):
    command = f"set -o pipefail; pyrt render {SCENE} --size 8x8 --spp 1 --progress json -v -o a.png {streams}"
    done = shell(command, tmp_path)
    assert done.returncode == 0
    assert (tmp_path / "a.png").stat().st_size > 0


def test_without_a_home(tmp_path):
    done = shell(f"unset HOME; pyrt render {SCENE} --size 8x8 --spp 1 -q -o a.png", tmp_path)
    assert (done.returncode, done.stderr) == (0, "")


@pytest.mark.skipif(not Path("/proc/self").exists(), reason="needs a folder that nobody can write to: /proc")
def test_a_folder_that_cannot_be_written_to_is_named():
    done = shell(f"pyrt render {SCENE} --size 8x8 --spp 1", Path("/proc"))
    assert done.returncode in (1, 2)  # 1 as root, whom only the writing itself tells
    assert re.fullmatch(r"pyrt: cornell.exr: (the folder . is not writable|cannot be written: .*)\n", done.stderr)


BALL = {"type": "sphere", "center": [0, 0, 0], "radius": 1, "material_name": "m"}


@pytest.mark.parametrize(
    ("change", "reason"),
    [
        ({"camera": {"position": [0, 0, 4], "look_at": [0, 0, 9]}}, "the camera sees no surface that reflects light"),
        (
            {"materials": {"m": {"type": "diffuse", "color": [0, 0, 0]}}},
            "the camera sees no surface that reflects light",
        ),
        ({"materials": {"m": {"type": "dielectric"}}}, "the camera sees glass and nothing else"),
        ({"lights": [{"position": [0, 0, -9], "flux": [9, 9, 9]}]}, "no light shines on the sides of the surfaces"),
        ({"integrator": {"point_light_flux": [0, 0, 0]}, "lights": []}, "no light shines on the sides of the surfaces"),
        ({"objects": [BALL, {**BALL, "radius": 2}]}, "what the camera sees lies in shadow"),
        ({}, None),
    ],
)
def test_a_black_picture_says_why(change, reason, capsys, tmp_path):
    scene = {
        "camera": {"position": [0, 0, 1.5]},
        "materials": {"m": {"type": "diffuse", "color": [0.5, 0.5, 0.5]}},
        "lights": [{"position": [0, 0, 9], "flux": [9, 9, 9]}],
        "objects": [BALL],
    }
    path = tmp_path / "scene.json"
    path.write_text(json.dumps(scene | change))
    assert main(["render", str(path), *SIZE, "--spp=1", "-q", "-o", str(tmp_path / "a.png")]) == 0
    error = capsys.readouterr().err
    assert error.startswith(f"warning: the picture is black: {reason}") if reason else error == ""
