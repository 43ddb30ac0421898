"""The examples of the READMEs run, in the order of the page, made small: see `_SMALL`. Heavy ones are only parsed."""

from __future__ import annotations

import json
import re
import shlex
import textwrap
from contextlib import redirect_stdout
from importlib.util import find_spec
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import trimesh

import pyrt
from pyrt.cli import _parsers, main

ROOT = Path(__file__).parents[2]

# What replaces parts of the lines, so that a rendering takes a moment. The scenes have 24 x 18 pixels.
_SMALL = {
    "--size 320x240": "--size 24x18",
    "--spp 4096": "--spp 4",
    "--time 30s": "--time 0.05s",
    "--crop 100,50,260,200": "--crop 2,1,20,11",
    "--noise 0.01": "--noise 0.1",
    "render model.glb": "render model.glb --size 24x18 --spp 4",
    "0:512": "0:2",
    "512:1024": "2:4",
    "[640,360]": "[24,18]",
}
_SMALL_PYTHON = {
    "size=(128, 128)": "size=(24, 18)",
    "noise=0.005": "noise=0.1",
    "spp=1024": "spp=4",
}
_NAMES = """
import multiprocessing
from concurrent.futures import ProcessPoolExecutor

import numpy as np
import trimesh

import pyrt

mesh = trimesh.creation.box()
vertices, triangles = mesh.vertices, mesh.faces
origins, directions = np.array([[0.1, 0.2, 3], [9, 9, 9]]), np.array([[0, 0, -1], [0, 0, -1]])
points = np.zeros((1, 3))
"""


def commands() -> list[str]:
    """Lines `pyrt ...` of README's shell examples, made small."""
    blocks = re.findall(
        r"^```sh\n(.*?)^```$", (ROOT / "README.md").read_text(encoding="utf-8"), re.MULTILINE | re.DOTALL
    )
    lines = "".join(blocks)
    for large, little in _SMALL.items():
        assert large in lines, "nothing to replace any more"
        lines = lines.replace(large, little)
    return [line for line in lines.splitlines() if line.startswith("pyrt ")]


def python_blocks() -> list[str]:
    """README's examples in Python, made small."""
    text = (ROOT / "README.md").read_text(encoding="utf-8")
    for large, little in _SMALL_PYTHON.items():
        assert large in text, "nothing to replace any more"
        text = text.replace(large, little)
    return re.findall(r"^```python\n(.*?)^```$", text, re.MULTILINE | re.DOTALL)


def is_heavy(words: list[str]) -> bool:
    """Whether it needs a large scene, or a package that is not there."""
    denoises = "denoise" in words or "--denoise" in words
    return "example:showcase" in words or (denoises and find_spec("pyoidn") is None)


@pytest.fixture
def folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """The current folder: the scenes that the page names, and a reference picture."""
    scene = json.loads((ROOT / "scenes" / "cornell.json").read_text())
    scene["film"]["resolution"], scene["integrator"]["spp"] = [24, 18], 4
    (tmp_path / "scenes").mkdir()
    (tmp_path / "scenes" / "meshes").symlink_to(ROOT / "scenes" / "meshes")
    (tmp_path / "meshes").symlink_to(ROOT / "scenes" / "meshes")
    for name in ("scene.json", "scenes/cornell.json"):
        (tmp_path / name).write_text(json.dumps(scene))
    trimesh.creation.icosphere(1).export(tmp_path / "model.glb")
    monkeypatch.chdir(tmp_path)
    assert main(["render", "scene.json", "-q", "-o", "reference.exr"]) == 0
    return tmp_path


def test_the_examples_run(folder: Path) -> None:
    lines = commands()
    assert len(lines) > 20
    for line in lines:
        words = shlex.split(line, comments=True)[1:]
        words = [word for word in words if word != "..."]
        target = "stdout"
        if ">" in words:
            target, words = words[-1], words[:-2]
        if is_heavy(words):
            _parsers()[0].parse_args(words)
            continue
        with open(folder / target, "w", encoding="utf-8") as stdout, redirect_stdout(stdout):
            status = main(words)
        assert status == 0, line
    for name in ("cornell.exr", "cornell.png", "stats.json", "scene.schema.json", "picture.png"):
        assert (folder / name).stat().st_size > 0
    assert json.loads((folder / "scene.schema.json").read_text())["$schema"]


def test_the_tour_in_python_runs(folder: Path) -> None:
    blocks = python_blocks()
    assert len(blocks) == 2
    names: dict[str, Any] = {}
    exec(_NAMES + blocks[0], names)
    assert names["result"].image.shape == (18, 24, 3)
    assert names["result"].image.dtype == np.float32
    assert (folder / "cornell.exr").stat().st_size > 0
    assert names["preview"].samples.max() == 4
    assert names["clean"].stats["noise"] <= 0.1
    assert list(names["hits"].triangle >= 0) == [True, False]
    assert list(names["dark"]) == [False, False]
    assert list(names["every"].ray) == [0, 0]
    assert list(names["inside"]) == [True]
    assert len(names["locations"]) == 2
    compile(blocks[1], "README.md", "exec")


def test_the_example_of_the_package_runs(folder: Path) -> None:
    example = re.search(r"\n\n((?:    .*\n)+)", pyrt.__doc__ or "")
    assert example
    (folder / "cornell.exr").unlink(missing_ok=True)
    exec(textwrap.dedent(example[1]), {})
    assert (folder / "cornell.exr").stat().st_size > 0


@pytest.mark.slow
def test_the_executor_of_the_page_runs(folder: Path) -> None:
    names: dict[str, Any] = {}
    exec(_NAMES + python_blocks()[1], names)
    assert names["result"].samples.min() == 4


def test_overrides_for_models_work(folder: Path) -> None:
    """Those of scenes/README.md."""
    text = (ROOT / "scenes" / "README.md").read_text(encoding="utf-8")
    settings = re.findall(r"`--set (.*?)`", text)
    assert len(settings) >= 5
    box = trimesh.creation.box()
    box.visual = trimesh.visual.TextureVisuals(material=trimesh.visual.material.PBRMaterial(name="Body"))
    box.export("model.glb")
    for words in settings:
        assert main(["validate", "model.glb", "--set", *shlex.split(words)]) == 0, words
