"""Renders that stop, are killed, or cannot write: nothing is lost but a round, and what goes on has the same bits."""

from __future__ import annotations

import functools
import json
import multiprocessing
import os
import resource
import shutil
import signal
import sys
import time
from concurrent.futures import ProcessPoolExecutor, ThreadPoolExecutor
from contextlib import nullcontext
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import pyrt
from pyrt import checkpoint
from pyrt.adaptive import FIRST_SAMPLES
from pyrt.cli import main
from pyrt.farm import merge, render_parallel
from pyrt.partial_file import read_header, read_partial
from pyrt.passes import SampleTracer
from pyrt.result import Result

SIZE = (20, 13)
SPP = 37
SCENE: dict[str, Any] = {
    "film": {"resolution": list(SIZE)},
    "camera": {"position": [0, 1, 4], "look_at": [0, 0.5, 0], "fov": 45},
    "objects": [
        {"type": "rectangle", "center": [0, 0, 0], "edge1": [4, 0, 0], "edge2": [0, 0, -4], "material_name": "grey"},
        {"type": "mesh", "path": "tetrahedron.obj", "material_name": "grey"},
        {"type": "sphere", "center": [1, 2, 1], "radius": 0.3, "light": {"radiance": [9, 8, 7]}},
    ],
    "materials": {"grey": {"type": "diffuse", "color": [0.6, 0.5, 0.4]}},
}
MESH = "v 0 1 0\nv -1 0 1\nv 1 0 1\nv 0 0 -1\nf 1 2 3\nf 1 3 4\nf 1 4 2\n"


@pytest.fixture(scope="module")
def scene_file(tmp_path_factory) -> Path:
    return write_scene(tmp_path_factory.mktemp("scene"))


def write_scene(folder: Path) -> Path:
    (folder / "tetrahedron.obj").write_text(MESH)
    (folder / "scene.json").write_text(json.dumps(SCENE))
    return folder / "scene.json"


@pytest.fixture(scope="module")
def renderer(scene_file) -> pyrt.Renderer:
    return pyrt.Renderer(pyrt.load_scene(scene_file))


@pytest.fixture(scope="module")
def whole(renderer) -> Result:
    return renderer.render(SPP)


@pytest.fixture(autouse=True)
def _short_rounds(monkeypatch):
    monkeypatch.setattr(checkpoint, "_FIRST_ROUND", 1)


def assert_same_bits(a: Result, b: Result) -> None:
    for name in ("image", "variance", "samples"):
        assert getattr(a, name).tobytes() == getattr(b, name).tobytes()


def stop_after(passes: int, error: type[BaseException] | None = None):
    """A progress callable that stops in the given pass."""
    calls = []

    def report(event: dict[str, Any]) -> bool:
        calls.append(event)
        if len(calls) == passes and error:
            raise error
        return len(calls) < passes

    return report


# Bits -----------------------------------------------------------------------------------------------------------------


def test_a_checkpoint_changes_no_bits(renderer, whole, tmp_path):
    result = renderer.render(SPP, checkpoint=tmp_path / "a.exr", checkpoint_every=0)
    assert_same_bits(result, whole)
    assert read_partial(tmp_path / "a.exr").end == SPP
    assert os.listdir(tmp_path) == ["a.exr"]


def test_all_rounds_share_what_was_looked_ahead(renderer, whole, tmp_path, monkeypatch):
    looks = []
    look = SampleTracer._trace_beams
    monkeypatch.setattr(SampleTracer, "_trace_beams", lambda *args: looks.append(args) or look(*args))
    rounds = []
    renderer.render(SPP, checkpoint=tmp_path / "a.exr", checkpoint_every=0, progress=rounds.append)
    assert len(looks) == 1 < len(rounds)


@pytest.mark.parametrize(("options", "writes"), [([], 1), (["--float"], 2), (["--aov", "z"], 2)])
def test_the_last_checkpoint_is_the_output(scene_file, tmp_path, monkeypatch, options, writes):
    saved = []
    save = Result.save
    monkeypatch.setattr(Result, "save", lambda self, path, **kw: saved.append(Path(path)) or save(self, path, **kw))
    out = [str(tmp_path / name) for name in ("a.exr", "a.png")]
    words = ["render", str(scene_file), "-q", "--spp", str(SPP), "--checkpoint", "1h", "-o", out[0], "-o", out[1]]
    assert main([*words, *options]) == 0
    assert [saved.count(Path(path)) for path in out] == [writes, 1]
    assert read_partial(out[0]).end == SPP


@pytest.mark.parametrize("error", [None, KeyboardInterrupt, ValueError])
@pytest.mark.parametrize("passes", [1, 3, 6])
def test_what_stops_and_goes_on_has_the_same_bits(renderer, whole, tmp_path, passes, error):
    keep = {"checkpoint": tmp_path / "a.exr"}
    with pytest.raises(error) if error else nullcontext():
        part = renderer.render(SPP, progress=stop_after(passes, error), **keep)
        assert (part.samples == part.partial.end).all()
    if passes > 1:
        assert 0 < read_partial(tmp_path / "a.exr").end < SPP
    assert_same_bits(renderer.render(SPP, resume=True, **keep), whole)


def test_without_a_checkpoint_a_stop_leaves_whole_pixels(renderer, whole):
    result = renderer.render(SPP, pass_samples=SPP * 48, progress=stop_after(2))
    done = result.samples > 0
    assert done.sum() == 96
    assert (result.samples[done] == SPP).all()
    assert (result.image[done] == whole.image[done]).all()
    assert (result.image[~done] == 0).all()


def test_a_render_can_be_extended_and_remembers_its_aim(renderer, whole, tmp_path):
    keep = {"checkpoint": tmp_path / "a.exr"}
    renderer.render(5, **keep)
    renderer.render(SPP, resume=True, progress=stop_after(1), **keep)
    result = renderer.render(resume=True, **keep)
    assert_same_bits(result, whole)
    assert result.stats["samples"] < SPP * result.samples.size


def test_without_resume_it_begins_anew(renderer, tmp_path):
    renderer.render(8, checkpoint=tmp_path / "a.exr")
    assert renderer.render(4, checkpoint=tmp_path / "a.exr").stats["samples"] == 4 * SIZE[0] * SIZE[1]


def test_progress_goes_on_where_it_stopped(renderer, tmp_path):
    renderer.render(8, checkpoint=tmp_path / "a.exr")
    events: list[dict[str, Any]] = []
    renderer.render(16, checkpoint=tmp_path / "a.exr", resume=True, progress=events.append)
    assert 0.5 < events[0]["done"] <= events[-1]["done"] == 1


# Crops ----------------------------------------------------------------------------------------------------------------

CROP = (3, 2, 17, 12)


@pytest.mark.parametrize("limits", [{"spp": SPP}, {"spp": 64, "noise": 0.01}], ids=["fixed", "adaptive"])
def test_a_crop_stops_and_goes_on_to_the_same_bits(renderer, whole, tmp_path, limits):
    keep = {"checkpoint": tmp_path / "a.exr", "crop": CROP, "pass_samples": 600, **limits}
    part = renderer.render(**keep, progress=stop_after(3))
    assert part.image.shape == (10, 14, 3)
    assert part.samples.min() < part.samples.max() or part.samples.max() < SPP
    result = renderer.render(**keep, resume=True)
    assert_same_bits(result, renderer.render(**limits, crop=CROP))
    assert result.stats["samples"] < result.samples.sum()
    if "noise" not in limits:
        assert result.image.tobytes() == whole.image[2:12, 3:17].tobytes()


def test_ranges_of_a_crop_are_merged_where_they_lie(renderer, tmp_path):
    for name, samples in (("a.exr", (0, 16)), ("b.exr", (16, SPP))):
        renderer.render(samples=samples, crop=CROP).save(tmp_path / name)
    result = merge([tmp_path / "a.exr", tmp_path / "b.exr"])
    assert_same_bits(result, renderer.render(SPP, crop=CROP))
    assert result.window == (*CROP, *SIZE)


# Adaptive renders -----------------------------------------------------------------------------------------------------

TARGET = {"noise": 0.004, "spp": 256}


@pytest.fixture(scope="module")
def refined(renderer) -> Result:
    result = renderer.render(**TARGET)
    assert len(np.unique(result.samples)) > 2
    return result


@pytest.mark.parametrize("part", [300, 1 << 26])
def test_saving_an_adaptive_render_changes_no_bits(renderer, refined, tmp_path, monkeypatch, part):
    """Also if rounds are done in parts."""
    monkeypatch.setattr("pyrt.adaptive._PART", part)
    assert_same_bits(renderer.render(**TARGET, checkpoint=tmp_path / "a.exr", checkpoint_every=1), refined)


@pytest.fixture(scope="module")
def passes_of_refined(renderer) -> int:
    """With so few samples in a pass that rounds have several."""
    events: list[dict[str, Any]] = []
    renderer.render(**TARGET, pass_samples=600, progress=events.append)
    assert len(events) > 12
    return len(events)


@pytest.mark.parametrize("error", [None, KeyboardInterrupt])
@pytest.mark.parametrize("share", [0.0, 0.3, 0.8])
def test_an_adaptive_render_goes_on_to_the_same_bits(renderer, refined, passes_of_refined, tmp_path, share, error):
    """It stops in the middle of rounds."""
    passes = 1 + int(share * passes_of_refined)
    keep = {"checkpoint": tmp_path / "a.exr", "pass_samples": 600}
    with pytest.raises(error) if error else nullcontext():
        renderer.render(**TARGET, **keep, progress=stop_after(passes, error))
    result = renderer.render(**TARGET, **keep, resume=True)
    assert_same_bits(result, refined)
    assert result.stats["samples"] < refined.stats["samples"] or not share
    assert_same_bits(renderer.render(**TARGET, **keep, resume=True, progress=lambda event: 1 / 0), refined)


def test_an_adaptive_render_goes_on_after_its_time(renderer, tmp_path):
    keep = {"checkpoint": tmp_path / "a.exr"}
    first = renderer.render(spp=64, time_limit=1e-9, **keep)
    assert (first.samples == FIRST_SAMPLES).all()
    assert (renderer.render(spp=64, time_limit=100, resume=True, **keep).samples >= first.samples).all()


def test_another_kind_of_render_is_not_continued(renderer, tmp_path):
    keep = {"checkpoint": tmp_path / "a.exr", "resume": True}
    renderer.render(**TARGET, **keep)
    with pytest.raises(pyrt.UsageError, match=r"it is rendered to the noise 0.004, expected 0.01"):
        renderer.render(noise=0.01, **keep)
    with pytest.raises(pyrt.UsageError, match="it is rendered with at most 256 samples, expected 1"):
        renderer.render(noise=0.004, spp=1, **keep)
    with pytest.raises(pyrt.UsageError, match="it was rendered with --noise or --time"):
        renderer.render(9, **keep)
    with pytest.raises(pyrt.UsageError, match="it was rendered with --noise or --time"):
        read_header(tmp_path / "a.exr")
    with pytest.raises(pyrt.UsageError, match="samples: expected no noise target"):
        renderer.render(noise=0.1, samples=(0, 4))


# Refusals -------------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"seed": 1}, r"its samples are of another seed \(0\), expected 1"),
        ({"size": (20, 14)}, "its samples are of another height"),
        ({"crop": (0, 0, 9, 9)}, r"its samples are of another crop \(\(0, 0, 20, 13\)\), expected \(0, 0, 9, 9\)"),
        ({"spp": 3}, "it holds samples up to 4 already, expected at most 3"),
        ({"samples": (2, 9), "spp": None}, "its samples begin with 0, expected 2"),
    ],
)
def test_another_render_is_not_continued(renderer, tmp_path, change, message):
    file = tmp_path / "a.exr"
    renderer.render(4, checkpoint=file)
    before = file.read_bytes()
    with pytest.raises(pyrt.UsageError, match=message):
        renderer.render(**{"spp": 8, "checkpoint": file, "resume": True, **change})
    assert file.read_bytes() == before


def test_another_scene_device_or_version_is_not_continued(renderer, scene_file, tmp_path, monkeypatch):
    keep = {"checkpoint": tmp_path / "a.exr", "resume": True}
    renderer.render(4, **keep)
    scene = pyrt.load_scene(scene_file)
    other = pyrt.Renderer(replace(scene, camera=replace(scene.camera, fov=46)))
    with pytest.raises(pyrt.UsageError, match="another scene"):
        other.render(4, **keep)
    monkeypatch.setattr("pyrt.picture.kernels_hash", lambda: "new")
    with pytest.raises(pyrt.UsageError, match="another kernels"):
        renderer.render(4, **keep)
    device = renderer._on_device.device
    monkeypatch.setattr(device, "info", replace(device.info, name="another machine's"))
    with pytest.raises(pyrt.UsageError, match="another device"):
        renderer.render(4, **keep)


def test_a_file_of_another_kind_is_not_replaced_by_resuming(renderer, tmp_path):
    renderer.render(1).save(tmp_path / "a.exr")
    with pytest.raises(pyrt.UsageError, match="expected a file that pyrt wrote"):
        renderer.render(4, checkpoint=tmp_path / "a.exr", resume=True)


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        ({"checkpoint": "a.png"}, "a.png: expected a name ending in .exr"),
        ({"checkpoint": "nowhere/a.exr"}, "there is no folder"),
        ({"checkpoint": "a.exr", "checkpoint_every": -1.0}, "checkpoint_every: expected"),
        ({"samples": (4, 4)}, "samples: expected 0 <= first < end"),
        ({"samples": (-1, 4)}, "samples: expected 0 <= first < end"),
    ],
)
def test_arguments_that_make_no_sense_are_refused(renderer, arguments, message):
    with pytest.raises(pyrt.UsageError, match=message):
        renderer.render(**arguments)


# Ranges of samples ----------------------------------------------------------------------------------------------------


def test_merged_ranges_have_the_same_bits(scene_file, whole, tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    for samples in ("0:5", "20:37", "5:20"):
        assert main(["render", str(scene_file), "-q", "--samples", samples, "-o", f"{samples[0]}.exr"]) == 0
    assert main(["merge", "2.exr", "5.exr", "-o", "tail.exr"]) == 0
    assert main(["merge", "tail.exr", "0.exr", "-o", "all.exr", "-o", "all.png"]) == 0
    assert_same_bits(merge(["all.exr"]), whole)
    assert "all.exr, all.png: 37 samples per pixel" in capsys.readouterr().err


@pytest.mark.parametrize(
    ("files", "message"),
    [
        (["a.exr", "b.exr"], "a.exr and b.exr overlap: they hold the samples 0:4 and 3:6"),
        (["a.exr", "c.exr"], "a.exr and c.exr leave a gap"),
        (["a.exr", "seed.exr"], "seed.exr: its samples are of another seed"),
        (["a.exr", "a.exr"], "expected different files"),
        (["a.exr", "none.exr"], "none.exr: expected a file that pyrt wrote with --checkpoint or --samples, found none"),
        (["a.exr", "text.exr"], "text.exr: expected a file that pyrt wrote"),
    ],
)
def test_files_that_do_not_fit_are_not_merged(renderer, tmp_path, files, message, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    for name, samples, seed in (("a", (0, 4), 0), ("b", (3, 6), 0), ("c", (5, 6), 0), ("seed", (4, 6), 1)):
        renderer.render(samples=samples, seed=seed).save(f"{name}.exr")
    Path("text.exr").write_text("no picture")
    assert main(["merge", *files, "-o", "out.exr"]) == 2
    assert message in capsys.readouterr().err
    assert not Path("out.exr").exists()


def test_merging_carries_the_channels_of_any_part(renderer, tmp_path, monkeypatch, capsys):
    """Geometry and filtered channels do not depend on the samples, variance and their number are of all together."""
    monkeypatch.chdir(tmp_path)
    parts = {"a": ((0, 16), ["z", "albedo", "variance"]), "b": ((16, SPP), ["z", "object", "samples", "normal"])}
    for name, (samples, aovs) in parts.items():
        part = renderer.render(samples=samples, aovs=aovs)
        replace(part, denoised=part.image).save(f"{name}.exr")
    assert main(["merge", "b.exr", "a.exr", "-o", "all.exr"]) == 0
    message = "warning: denoised.B, denoised.G, denoised.R: left out, as they are of single parts; pyrt denoise makes"
    assert capsys.readouterr().err.startswith(message)
    names = ["z", "albedo", "variance", "object", "samples", "normal"]
    expected = renderer.render(SPP, aovs=names)
    merged = merge(["all.exr"])
    assert merged.stats["left_out"] == []
    assert set(merged.aovs) == set(names)
    for name in names:
        assert merged.aovs[name].tobytes() == expected.aovs[name].tobytes(), name
    for name in ("worldToCamera", "worldToNDC"):
        np.testing.assert_allclose(merged.metadata[name], expected.metadata[name], rtol=1e-6, atol=1e-6)
    assert merged.metadata["pyrt:spp"] == SPP


@pytest.mark.parametrize("name", ["z", "object"])
def test_parts_that_show_different_things_are_not_merged(renderer, tmp_path, monkeypatch, name):
    monkeypatch.chdir(tmp_path)
    renderer.render(samples=(0, 4), aovs=[name]).save("a.exr")
    part = renderer.render(samples=(4, 8), aovs=[name])
    other = part.aovs[name].copy()
    other[10, 10] += 1
    replace(part, aovs={name: other}).save("b.exr")
    with pytest.raises(pyrt.UsageError, match=f"b.exr: its channels of {name} are not those of a.exr"):
        merge(["a.exr", "b.exr"])


def test_threads_of_an_executor_render_the_same_bits(scene_file, whole):
    with ThreadPoolExecutor(1) as executor:
        assert_same_bits(render_parallel(scene_file, executor, 3, spp=SPP), whole)


@pytest.mark.slow
def test_processes_of_an_executor_render_the_same_bits(scene_file, whole):
    with ProcessPoolExecutor(2, multiprocessing.get_context("spawn")) as executor:
        assert_same_bits(render_parallel(scene_file, executor, 2, spp=SPP), whole)


@pytest.mark.parametrize("parts", [0, 3])
def test_more_parts_than_samples_are_refused(scene_file, parts):
    with pytest.raises(pyrt.UsageError, match="parts: expected a whole number from 1 to 2"):
        render_parallel(scene_file, ThreadPoolExecutor(1), parts, spp=2)


# Signals and kill -9, in other processes ------------------------------------------------------------------------------


@functools.cache
def clean_processes() -> multiprocessing.context.ForkServerContext:
    """Forks processes that have imported all they need but have not opened a device."""
    context = multiprocessing.get_context("forkserver")
    context.set_forkserver_preload(["pyrt.api", "pyrt.cli_render", "OpenImageIO", "pyopencl", __name__])
    return context


def run_cli(arguments: list[str], log: Path) -> None:
    """Many short rounds, each saved if the command asks for --checkpoint 0, so that signals meet all stages of that."""
    checkpoint._FIRST_ROUND, checkpoint._ROUND_SECONDS = 1, 0.0
    with open(log, "w", encoding="utf-8") as stream:
        sys.stdout = sys.stderr = stream
        code = main([*arguments, "--progress", "json"])
    os._exit(code)


def start(arguments: list[str], log: Path) -> multiprocessing.process.BaseProcess:
    """Starts the command, and returns once it renders."""
    process = clean_processes().Process(target=run_cli, args=(arguments, log))
    process.start()
    while process.exitcode is None and not (log.exists() and '"render"' in log.read_text()):
        time.sleep(0.005)
    return process


def sentences(log: Path) -> list[str]:
    return [line for line in log.read_text().splitlines() if not line.startswith("{")]


@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM], ids=lambda number: number.name)
def test_signals_save_and_exit_with_130(renderer, scene_file, tmp_path, number):
    log, file = tmp_path / "log", tmp_path / "a.exr"
    process = start(["render", str(scene_file), "--spp", "1000000", "-o", str(file), "--checkpoint", "1h"], log)
    os.kill(process.pid, number)
    process.join(60)
    assert process.exitcode == 130
    end = read_partial(file).end
    assert sentences(log) == [f"pyrt: interrupted with {end:.4g} samples per pixel; --resume continues"]
    assert sorted(os.listdir(tmp_path)) == ["a.exr", "log"]
    assert_same_bits(merge([file]), renderer.render(end))


@pytest.mark.parametrize("kills", [3, pytest.param(30, marks=pytest.mark.slow)])
def test_killed_at_any_moment_it_ends_with_the_same_bits(renderer, scene_file, tmp_path, kills):
    log, folder, spp = tmp_path / "log", tmp_path / "out", 300
    folder.mkdir()
    file = folder / "a.exr"
    arguments = ["render", str(scene_file), "--spp", str(spp), "-o", str(file), "--checkpoint", "0", "--resume"]
    rng, ends = np.random.default_rng(kills), [0]
    for _ in range(kills):
        log.unlink(missing_ok=True)
        process = start(arguments, log)
        time.sleep(rng.uniform(0, 0.5 / kills))
        os.kill(process.pid, signal.SIGKILL)
        process.join(60)
        assert process.exitcode == -signal.SIGKILL
        assert len(os.listdir(folder)) <= 2  # the file, and one that was being written
        ends.append(read_partial(file).end if file.exists() else 0)
    assert ends == sorted(ends)
    assert 0 < ends[-1] < spp
    process = start(arguments, log)
    process.join(60)
    assert process.exitcode == 0
    assert os.listdir(folder) == ["a.exr"]
    assert_same_bits(merge([file]), renderer.render(spp))


# Accidents while rendering --------------------------------------------------------------------------------------------


def full_disk(folder: Path) -> None:
    resource.setrlimit(resource.RLIMIT_FSIZE, (3000, resource.getrlimit(resource.RLIMIT_FSIZE)[1]))


def removed_folder(folder: Path) -> None:
    shutil.rmtree(folder)


def file_for_a_folder(folder: Path) -> None:
    folder.rename(folder.with_name("moved"))
    folder.write_text("no folder")


@pytest.fixture
def accident(monkeypatch):
    """Calls the function once the scene is loaded and compiled; restores what it may have changed of the process."""
    limit = resource.getrlimit(resource.RLIMIT_FSIZE)
    real = checkpoint.accumulate

    def plan(happens, *arguments):
        def accumulate(*args):
            happens(*arguments)
            return real(*args)

        monkeypatch.setattr("pyrt.picture.accumulate", accumulate)

    yield plan
    resource.setrlimit(resource.RLIMIT_FSIZE, limit)


@pytest.mark.parametrize(
    ("happens", "code", "message"),
    [
        (full_disk, 1, "cannot be written: "),
        (removed_folder, 2, "there is no folder"),
        (file_for_a_folder, 2, "there is no folder"),
    ],
)
def test_what_cannot_be_written_is_said_in_one_sentence(scene_file, tmp_path, accident, capsys, happens, code, message):
    folder = tmp_path / "out"
    folder.mkdir()
    file = folder / "a.exr"
    arguments = ["render", str(scene_file), "-q", "-o", str(file), "--checkpoint", "0"]
    assert main([*arguments, "--spp", "2"]) == 0
    old = file.read_bytes()
    accident(happens, folder)
    capsys.readouterr()
    assert main([*arguments, "--spp", "4", "--resume"]) == code
    printed = capsys.readouterr().err.splitlines()
    assert len(printed) == 1
    assert printed[0].startswith(f"pyrt: {file}: {message}")
    for place in (folder, folder.with_name("moved")):
        if place.is_dir():
            assert os.listdir(place) == ["a.exr"]
            assert (place / "a.exr").read_bytes() == old


def test_the_scenes_files_may_go_once_they_are_loaded(tmp_path, whole, accident):
    folder = tmp_path / "scene"
    folder.mkdir()
    scene = write_scene(folder)
    accident(removed_folder, folder)
    file = tmp_path / "a.exr"
    assert main(["render", str(scene), "-q", "--spp", str(SPP), "-o", str(file), "--checkpoint", "0"]) == 0
    assert not folder.exists()
    assert_same_bits(merge([file]), whole)


def test_the_command_line_wants_an_exr_to_save_to(scene_file, tmp_path, capsys):
    for option in (["--checkpoint", "60s"], ["--resume"], ["--samples", "0:4"]):
        assert main(["render", str(scene_file), "-o", str(tmp_path / "a.png"), *option]) == 2
        assert "expected an output ending in .exr" in capsys.readouterr().err
