"""The command line as a user meets it: files, messages, exit codes."""

import json
import os
import subprocess
import sys
from pathlib import Path

import pytest

from pyrt.cli import main

SCENE = "example:cornell"
SMALL = ["--size", "16x12", "--spp", "1"]


def pyrt(*arguments: str, folder: Path, **environment: str) -> subprocess.CompletedProcess[str]:
    """Runs `python -m pyrt` in a folder, as another process."""
    package = Path(__file__).parents[2]
    kept = {name: value for name, value in os.environ.items() if name != "POCL_CACHE_DIR"}
    env = {**kept, "PYTHONPATH": str(package), **environment}
    command = [sys.executable, "-m", "pyrt", *arguments]
    return subprocess.run(command, cwd=folder, env=env, capture_output=True, text=True, timeout=300)


def test_default_output_is_an_exr_and_a_png_named_after_the_scene(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    assert main(["render", SCENE, *SMALL]) == 0
    assert sorted(file.name for file in tmp_path.iterdir()) == ["cornell.exr", "cornell.png"]


def test_several_outputs_stats_and_quiet(tmp_path, capsys):
    outputs = [tmp_path / "a.png", tmp_path / "b.exr"]
    assert main(["render", SCENE, *SMALL, "-q", "-o", str(outputs[0]), "-o", str(outputs[1]), "--stats", "-"]) == 0
    printed = capsys.readouterr()
    stats = json.loads(printed.out)
    assert printed.err == ""
    assert stats["samples"] == stats["rays"]["camera"] == 16 * 12
    assert all(file.stat().st_size > 0 for file in outputs)


def test_json_progress_is_one_event_a_line(tmp_path, capsys):
    assert main(["render", SCENE, *SMALL, "--progress", "json", "-o", str(tmp_path / "a.png")]) == 0
    events = [json.loads(line) for line in capsys.readouterr().err.splitlines() if line.startswith("{")]
    keys = {"stage", "done", "seconds"}
    more = {"samples", "rays", "rays_per_second", "noise", "eta"}
    stages = ["load", "build", "compile", "render", "render", "save", "done"]
    assert [event["stage"] for event in events] == stages
    assert [set(event) for event in events] == [keys | more if stage == "render" else keys for stage in stages]
    assert [event["done"] for event in events] == [0.0, 0.0, 0.0, 0.0, 1.0, 0.0, 1.0]
    assert [event["seconds"] for event in events] == sorted(event["seconds"] for event in events)
    assert (events[4]["samples"], events[4]["noise"], events[4]["eta"]) == (16 * 12, None, 0.0)


def test_no_clobber_keeps_the_old_file(tmp_path, capsys):
    target = tmp_path / "a.png"
    target.write_bytes(b"old")
    assert main(["render", SCENE, *SMALL, "--no-clobber", "-o", str(target)]) == 2
    assert target.read_bytes() == b"old"
    assert "exists already" in capsys.readouterr().err


@pytest.mark.parametrize(
    ("arguments", "code", "message"),
    [
        (["render", "missing.json"], 3, "missing.json: cannot be read: no such file or directory"),
        (["render", SCENE, "--set", "camera.fovv=3"], 3, 'did you mean "fov"?'),
        (["render", SCENE, "-o", "picture.xyz"], 2, "picture.xyz: expected a name ending in"),
        (["render", SCENE, "-o", "no/such/folder.png"], 2, "there is no folder"),
        (["render", SCENE, "--spp", "0"], 2, "spp: expected a whole number from 1 to"),
        (["render", SCENE, "--size", "0x4"], 2, "width: expected a whole number from 1 to"),
        (["render", SCENE, "--device", "no such device"], 4, 'no OpenCL device matches "no such device"'),
    ],
)
def test_errors_are_one_sentence_with_an_exit_code(arguments, code, message, tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    assert main(arguments) == code
    error = capsys.readouterr().err
    assert message in error
    assert error.count("\n") == 1
    assert not list(tmp_path.iterdir())


def test_info_names_every_feature_with_a_reason(capsys):
    assert main(["info", "example:cornell_area_light"]) == 0
    text = capsys.readouterr().out
    assert "on   HAS_RECTANGLE_LIGHTS" in text
    assert "off  HAS_SPHERES" in text
    assert "no spheres" in text


def test_validate_devices_and_doctor(capsys):
    assert main(["validate", SCENE]) == 0
    assert main(["devices"]) == 0
    assert main(["doctor"]) == 0
    assert capsys.readouterr().out.count("*") == 2


def test_without_an_opencl_platform_the_message_names_the_cure(tmp_path):
    done = pyrt("render", SCENE, folder=tmp_path, OCL_ICD_VENDORS="/nonexistent")
    assert done.returncode == 4
    assert "pip install 'pyopencl[pocl]'" in done.stderr
    assert "Traceback" not in done.stderr


@pytest.mark.skipif(not Path("/proc/self").exists(), reason="needs a folder that nobody can write to: /proc")
def test_a_home_that_cannot_be_written_to_does_not_matter(tmp_path):
    environment = {"HOME": "/proc/none", "XDG_CACHE_HOME": ""}
    done = pyrt("render", SCENE, *SMALL, "-o", "a.png", folder=tmp_path, **environment)
    assert done.returncode == 0, done.stderr
    assert (tmp_path / "a.png").exists()
