"""The scripts in scenes/examples run, made small, and their numbers fit together."""

from __future__ import annotations

import json
import re
import runpy
import sys
from pathlib import Path

import numpy as np
import pytest
import trimesh

from pyrt.image_io import read_picture

EXAMPLES = Path(__file__).parents[2] / "scenes" / "examples"


@pytest.fixture
def run(tmp_path, monkeypatch):
    """Runs an example in an empty folder, which it returns."""
    monkeypatch.chdir(tmp_path)

    def run(name: str, *options: str) -> Path:
        monkeypatch.setattr(sys, "argv", [name, *options])
        runpy.run_path(str(EXAMPLES / name), run_name="__main__")
        return tmp_path

    return run


def test_every_example_is_tested():
    text = Path(__file__).read_text(encoding="utf-8")
    for path in EXAMPLES.glob("*.py"):
        assert f'run("{path.name}"' in text


def test_a_picture_of_meshes(run):
    picture = read_picture(run("mesh_picture.py", "--size", "32", "--spp", "4") / "mesh.png").pixels
    assert picture.shape == (24, 32, 3)
    middle, left = picture[11:13, 15:17].mean(axis=(0, 1)), picture[12, 6]
    assert middle.max() / middle.min() < 1.5  # the white ball
    assert left.max() / left.min() > 1.5  # the coloured ring


def test_views_with_depth_masks_and_cameras_that_belong_together(run, tmp_path):
    ball = trimesh.creation.icosphere(3)
    ball.apply_translation([5, 0, 0])
    ball.export(tmp_path / "ball.ply")
    folder = run("views.py", "ball.ply", "--views", "2", "--size", "33", "--spp", "1") / "views"
    cameras = json.loads((folder / "cameras.json").read_text())
    inverse = np.linalg.inv(cameras["K"])
    assert len(cameras["camera_to_world"]) == 2
    for i, matrix in enumerate(np.array(cameras["camera_to_world"])):
        depth, mask = np.load(folder / f"{i:03d}_depth.npy"), np.load(folder / f"{i:03d}_mask.npy")
        assert depth.shape == mask.shape == read_picture(folder / f"{i:03d}.png").pixels.shape[:2]
        assert read_picture(folder / f"{i:03d}.exr").pixels.any()
        assert np.array_equal(mask, np.isfinite(depth))
        rows, columns = np.nonzero(mask)
        pixels = np.stack([columns + 0.5, rows + 0.5, np.ones(len(rows))])
        local = np.vstack([inverse @ pixels * depth[mask], np.ones(len(rows))])
        # the ball has radius 1 at its corners, and 0.99 in the middle of its faces
        assert np.abs(np.linalg.norm((matrix @ local)[:3], axis=0) - 0.995).max() < 0.006


def test_ray_queries(run, capsys):
    run("ray_queries.py", "--rays", "4000")
    text = capsys.readouterr().out
    numbers = [float(number) for number in re.findall(r"\d+\.\d+", text)]
    hits, _, sky, _, by_points, by_formula = numbers
    assert 55 < hits < 70
    assert 85 < sky < 95
    assert by_points == pytest.approx(by_formula, rel=0.07)  # 4 sigma, of 4000 points half inside
