"""What a render needs is known beforehand, and refused where there is less."""

from __future__ import annotations

import numpy as np
import pytest

from pyrt import memory
from pyrt.errors import PyrtError
from pyrt.memory import Need, estimate, picture_bytes
from pyrt.room import available
from pyrt.scene import Mesh, Scene

GIB = 1 << 30


def system(tmp_path, cgroup, files):
    """A /proc and a /sys/fs/cgroup with 8 GiB free in the machine."""
    files = {"proc/meminfo": f"MemTotal: 99 kB\nMemAvailable:  {8 << 20} kB\n", "proc/self/cgroup": cgroup, **files}
    for name, text in files.items():
        path = tmp_path / name
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_text(text)
    return available(tmp_path / "proc", tmp_path / "groups")


def group(folder, limit, used, cache, names=("max", "current", "inactive_file")):
    return {
        f"groups/{folder}/memory.{names[0]}": f"{limit}\n",
        f"groups/{folder}/memory.{names[1]}": f"{used}\n",
        f"groups/{folder}/memory.stat": f"anon 5\n{names[2]} {cache}\n",
    }


VERSION_1 = ("limit_in_bytes", "usage_in_bytes", "total_inactive_file")


@pytest.mark.parametrize(
    ("cgroup", "files", "expected"),
    [
        ("", {}, 8),
        ("0::/job/step\n", group("job/step", "max", GIB, 0), 8),
        ("0::/job/step\n", group("job/step", 4 * GIB, 3 * GIB, GIB), 2),
        ("0::/job/step\n", group("job", 4 * GIB, 3 * GIB, 0), 1),  # the limit of a group above
        ("4:memory:/job\n3:cpu:/job\n", group("memory/job", 4 * GIB, 3 * GIB, GIB, VERSION_1), 2),
        ("3:cpu:/job\n", group("memory/job", 4 * GIB, 3 * GIB, GIB, VERSION_1), 8),
    ],
)
def test_the_least_of_machine_and_groups_is_available(tmp_path, cgroup, files, expected):
    assert system(tmp_path, cgroup, files) == expected * GIB


def test_a_system_that_does_not_tell_has_no_limit(tmp_path):
    assert available(tmp_path, tmp_path) == np.inf


def test_what_does_not_fit_is_refused(monkeypatch):
    need = Need(scene=9 * GIB, build=2 * GIB, picture=GIB)  # the scene is there already
    monkeypatch.setattr(memory, "available", lambda: 3.0 * GIB)
    need.require("room")
    monkeypatch.setattr(memory, "available", lambda: 2.9 * GIB)
    message = r"room: expected 3 GiB of free memory \(2 for the scene, 1 for the picture\), found 2.9 GiB"
    with pytest.raises(PyrtError, match=message):
        need.require("room")


def test_estimates_grow_with_what_takes_memory():
    def mesh(n):
        return Mesh(name="", vertices=np.zeros((n, 3)), triangles=np.zeros((2 * n, 3), np.int32))

    shared = mesh(1000)
    assert estimate(Scene(shapes=(shared, shared))).scene < estimate(Scene(shapes=(shared, mesh(1000)))).scene
    assert estimate(Scene(shapes=(mesh(2000),))).build == 2 * estimate(Scene(shapes=(mesh(1000),))).build
    scene = Scene()
    few = picture_bytes(scene, 10**6, 1024)
    assert picture_bytes(scene, 10**6, 1023, keep=True) > 3 * picture_bytes(scene, 10**6, 1024, keep=True)  # by digits
    assert picture_bytes(scene, 10**6, 1024, channels=3) > few
    assert picture_bytes(scene, 10**6, 1023, keep=True) > picture_bytes(scene, 10**6, 1023)
    assert picture_bytes(scene, 4096, 10**5) < 100 << 20  # whatever the number of samples
