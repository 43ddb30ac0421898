"""A linker for PoCL: which one is chosen, what it is given, what is remembered. The linkers are short scripts."""

import os
import subprocess
import sys
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from types import SimpleNamespace

import pytest

from pyrt import toolchain
from pyrt.errors import DeviceError
from pyrt.toolchain import ensure_cache, ensure_linker, kernel_cache

pytestmark = pytest.mark.skipif(sys.platform != "linux", reason="PoCL's linker is looked after on Linux only")

GOOD = """#!/bin/sh
printf '%s|' "$@" >> LOG; echo >> LOG
while [ "$1" != -o ]; do shift; done
echo linked > "$2"
"""
SILENT = "#!/bin/sh\nexit 0\n"
BROKEN = "#!/bin/sh\nexit 1\n"
VERSION = "OpenCL 3.0 PoCL 3.0-rc2  Linux, Release, LLVM 14.0.6"


@pytest.fixture
def machine(tmp_path, monkeypatch):
    """A machine without any linker; `install` adds one."""
    programs = tmp_path / "some programs"
    programs.mkdir()
    monkeypatch.setenv("PATH", str(programs))
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path / "cache"))
    monkeypatch.setattr(toolchain, "find_spec", lambda name: None)
    log = tmp_path / "log"
    log.touch()

    def install(name, script):
        program = programs / name
        program.write_text(script.replace("LOG", str(log)))
        program.chmod(0o755)
        return program

    def new_process():
        monkeypatch.setenv("PATH", str(programs))

    return SimpleNamespace(
        install=install, log=lambda: log.read_text().splitlines(), new_process=new_process, cache=tmp_path / "cache"
    )


def first_folder():
    return Path(os.environ["PATH"].split(os.pathsep)[0])


def run_ld(*arguments):
    subprocess.run([first_folder() / "ld", *arguments], check=True)


def test_kernels_are_linked_without_libraries(machine, tmp_path):
    machine.install("ld", GOOD)
    ensure_linker(VERSION)
    kernel, target = str(tmp_path / "tempfile_a b.so.o"), str(tmp_path / "tempfile_c.so")
    run_ld("-shared", "-o", target, "-L/x", kernel, "-lgcc", "--as-needed", "-lgcc_s", "-lc")
    assert machine.log()[-1] == f"-shared|-o|{target}|-L/x|{kernel}|--as-needed|"
    assert Path(target).exists()


def test_other_commands_reach_the_linker_unchanged(machine, tmp_path):
    machine.install("ld", GOOD)
    ensure_linker(VERSION)
    run_ld("-o", str(tmp_path / "a.out"), "main file.o", "-lm", "")
    assert machine.log()[-1] == f"-o|{tmp_path / 'a.out'}|main file.o|-lm||"


@pytest.mark.parametrize("unfit", [BROKEN, SILENT, "#!/no/such/interpreter\n"])
def test_an_unfit_linker_gives_way_to_the_next(machine, unfit):
    machine.install("ld", unfit)
    good = machine.install("ld.lld", GOOD)
    ensure_linker(VERSION)
    assert f"exec '{good}'" in (first_folder() / "ld").read_text()


def test_the_wheels_linker_is_the_last_resort(machine, monkeypatch):
    zig = machine.install("zig", GOOD)
    monkeypatch.setattr(toolchain, "find_spec", lambda name: SimpleNamespace(origin=str(zig.with_name("__init__.py"))))
    ensure_linker(VERSION)
    assert machine.log()[-1].startswith("ld.lld|")
    machine.new_process()
    machine.install("ld", GOOD)
    ensure_linker(VERSION)
    assert not machine.log()[-1].startswith("ld.lld|")


@pytest.mark.parametrize("unfit", [None, BROKEN, SILENT])
def test_no_linker_is_one_sentence_with_both_cures(machine, unfit):
    if unfit:
        machine.install("ld", unfit)
    path = os.environ["PATH"]
    with pytest.raises(DeviceError) as caught:
        ensure_linker(VERSION)
    message = str(caught.value)
    assert message.startswith("PoCL 3.0 needs a linker")
    assert "`pip install ziglang`" in message
    assert "`apt-get install binutils`" in message
    assert "\n" not in message
    assert os.environ["PATH"] == path


def test_a_linker_is_tried_once(machine):
    ld = machine.install("ld", GOOD)
    ensure_linker(VERSION)
    path = os.environ["PATH"]
    ensure_linker(VERSION)
    assert os.environ["PATH"] == path
    machine.new_process()
    ensure_linker(VERSION)
    assert os.environ["PATH"] == path
    assert len(machine.log()) == 1
    machine.new_process()
    os.utime(ld, (1, 1))
    ensure_linker(VERSION)
    assert len(machine.log()) == 2


def test_an_emptied_cache_is_filled_again(machine):
    ld = machine.install("ld", GOOD)
    ensure_linker(VERSION)
    (first_folder() / "ld").unlink()
    ensure_linker(VERSION)
    assert f"exec '{ld}'" in (first_folder() / "ld").read_text()


def test_an_unusable_cache_folder_does_no_harm(machine):
    machine.install("ld", GOOD)
    machine.cache.write_text("a file, where a folder should be")
    ensure_linker(VERSION)
    assert (first_folder() / "ld").exists()
    assert not first_folder().is_relative_to(machine.cache)


def test_a_user_without_a_home_gets_no_stray_folder(machine, monkeypatch, tmp_path):
    machine.install("ld", GOOD)
    monkeypatch.setenv("XDG_CACHE_HOME", "relative")
    monkeypatch.chdir(tmp_path)
    ensure_linker(VERSION)
    assert first_folder().is_absolute()
    assert not (tmp_path / "relative").exists()


def test_simultaneous_first_starts_leave_one_script(machine):
    linker = (str(machine.install("ld", GOOD)),)
    with ThreadPoolExecutor(8) as pool:
        folders = set(pool.map(toolchain._install, [linker] * 8))
    (folder,) = folders
    assert [file.name for file in folder.iterdir()] == ["ld"]


@pytest.fixture
def room(tmp_path, monkeypatch):
    """The bytes free below each folder that is a key, and plenty elsewhere."""
    free = {}
    for name in ("cache", "kernels", "temporary"):
        monkeypatch.setenv(
            {"cache": "XDG_CACHE_HOME", "kernels": "POCL_CACHE_DIR"}.get(name, "TMPDIR"), str(tmp_path / name)
        )
        (tmp_path / name).mkdir()
    monkeypatch.setattr(toolchain.tempfile, "tempdir", str(tmp_path / "temporary"))

    def disk_usage(folder):
        return SimpleNamespace(free=min((n for name, n in free.items() if name in folder.parts), default=2**40))

    monkeypatch.setattr(toolchain.shutil, "disk_usage", disk_usage)
    return free


def test_a_cache_with_room_is_kept(room, tmp_path):
    ensure_cache()
    assert kernel_cache() == tmp_path / "kernels"
    assert os.environ["XDG_CACHE_HOME"] == str(tmp_path / "cache")


@pytest.mark.parametrize(("full", "variable"), [("cache", "XDG_CACHE_HOME"), ("kernels", "POCL_CACHE_DIR")])
def test_a_full_disk_gives_way_to_the_temporary_folder(room, tmp_path, full, variable):
    room[full] = 2**20
    ensure_cache()
    assert Path(os.environ[variable]).parent == tmp_path / "temporary"
    room[full] = 2**30
    before = dict(os.environ)
    ensure_cache()
    assert dict(os.environ) == before


def test_no_room_at_all_is_one_sentence(room, tmp_path):
    room |= {"cache": 0, "temporary": 0}
    with pytest.raises(DeviceError) as caught:
        ensure_cache()
    assert str(caught.value) == (
        f"no room for compiled kernels: {tmp_path / 'cache'} and the folder for temporary files are full or cannot be "
        "written to; expected 16 MiB free in one of them"
    )
