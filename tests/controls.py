"""Kernels with one protection taken away: what the tests of a protection must be able to notice.

A control is a copy of the kernels with one edit. Within `kernels(...)` pyrt compiles it.
"""

from __future__ import annotations

import shutil
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from tempfile import TemporaryDirectory
from unittest.mock import patch

from pyrt.layout import kernel_dir


@dataclass(frozen=True)
class Control:
    """`old` occurs once in the kernel file and is replaced."""

    file: str
    old: str
    new: str


# Möller and Trumbore, Fast, Minimum Storage Ray/Triangle Intersection, 1997: every triangle rounds on its own.
_MOLLER_TRUMBORE = """
    sheared_from(block, s, &e);
    float8 p[3], q[3], r[3], x[3], y[3];
    const float o[3] = {ray->o.x, ray->o.y, ray->o.z}, d[3] = {ray->d.x, ray->d.y, ray->d.z};
    for (int i = 0; i < 3; ++i) {
        p[i] = load8(block->vertex[1][i]) - load8(block->vertex[0][i]);
        q[i] = load8(block->vertex[2][i]) - load8(block->vertex[0][i]);
        r[i] = o[i] - load8(block->vertex[0][i]);
    }
    for (int i = 0, j = 1, k = 2; i < 3; j = k, k = i, ++i) {
        x[i] = d[j] * q[k] - d[k] * q[j];
        y[i] = r[j] * p[k] - r[k] * p[j];
    }
    float8 det = p[0] * x[0] + p[1] * x[1] + p[2] * x[2];
    e.v = (r[0] * x[0] + r[1] * x[1] + r[2] * x[2]) / det;
    e.w = (d[0] * y[0] + d[1] * y[1] + d[2] * y[2]) / det;
    e.u = 1.0f - e.v - e.w;
    int8 inside = min8(e.u, min8(e.v, e.w)) >= 0.0f;
    float8 inv_det"""
_MOLLER_TRUMBORE_PACKET = """
        Vec o = rays->o, d = rays->d;
        float a[3], p[3], q[3];
        for (int k = 0; k < 3; ++k) {
            a[k] = block->vertex[0][k][i];
            p[k] = block->vertex[1][k][i] - a[k];
            q[k] = block->vertex[2][k][i] - a[k];
        }
        Vec to = sub3(o, vec_of(a[0], a[1], a[2])), e = vec_of(p[0], p[1], p[2]), f = vec_of(q[0], q[1], q[2]);
        Vec x = cross3(d, f), y = cross3(to, e);
        Real det = dot3(e, x), v = dot3(to, x) / det, w = dot3(d, y) / det, u = 1.0f - v - w;
"""
_INSIDE = "    int8 inside = sheared_from(block, s, &e);\n    float8 inv_det"
_PACKET_EDGES = """
        Real u = cross_lanes(cx, cy, bx, by), v = cross_lanes(ax, ay, cx, cy), w = cross_lanes(bx, by, ax, ay);
"""
_CROSS = "return FMA(px, qy, -product) + FMA(-py, qx, product);"

CONTROLS = {
    "Möller–Trumbore": Control("triangle.h", _INSIDE, _MOLLER_TRUMBORE),
    "Möller–Trumbore in packets": Control("triangle.h", _PACKET_EDGES, _MOLLER_TRUMBORE_PACKET),
    "contracted edges": Control("triangle.h", _CROSS, "return FMA(px, qy, -product);"),
    "rounded edges": Control("triangle.h", _CROSS, "return px * qy - product;"),
    "edges that belong to nobody": Control(
        "triangle.h",
        "(((LOW) >= 0.0f) ^ ((HIGH) <= 0.0f))",
        "(((LOW) > 0.0f) ^ ((HIGH) < 0.0f))",
    ),
    "slopes bounded too soon": Control(
        "bvh.h",
        "abs1(d.z)) * 0x1p-40f,",
        "abs1(d.z)) * 0x1p-20f,",
    ),
    "ties to the first that is found": Control(
        "scene.h", "(((T) < (HIT)->t) | (((T) == (HIT)->t) & ((ID) < (HIT)->id)))", "((T) < (HIT)->t)"
    ),
    "lamps without offset": Control("light.h", "(Real)(light->offset), point)", "(Real)(0.0f), point)"),
    "no box padding": Control("bvh.h", "#define BOX_ULPS 8.0f", "#define BOX_ULPS 0.0f"),
    "relative shadow epsilon": Control("direct.h", "s->q, o), (Real)(1.0f)", "s->q, o), (Real)(1.0f - 1e-3f)"),
    "lines that end before the lamp": Control("line.h", "d.alpha) < 1.0f", "d.alpha) < 1.0f - 1e-3f"),
    "no id skip": Control("scene.h", "id == ray->self || ", ""),
    "no offset": Control("surface.h", "madd3(n, si->offset, si->p)", "si->p"),
    "texels by truncation": Control("texture.h", "float f = x - floor1(x);", "float f = x - (float)(int)x;"),
    "no edge margin": Control("surface.h", "if (lanes_of(min1(u, min1(v, w)) < share) != 0u)", "if (false)"),
    "shrunken volumes": Control("volume.h", "d * inv + volume->pad", "d * inv - 1e-2f"),
    "shrunken intervals": Control("bvh.h", "lanes_min(in ? place - pad", "lanes_min(in ? place + 1e-2f"),
    "beams that start on their axis": Control(
        "beam.h", "if (forwards > 0.01f * dot3(axis, axis))\n        volume_add", "volume_add"
    ),
    "splits without number": Control("direct.h", " && *splits > 0", ""),
    "overflow": Control("packet.h", "{min8(FLT_MAX, a.x), min8(FLT_MAX, a.y), min8(FLT_MAX, a.z)}", "a"),
    "receivers' planes moved up": Control("volume.h", "+ error <= 0.5f * tri->offset", "+ error <= 0.5f"),
    "vectors of rays too long": Control("rays.h", "limit *= power4(*exponent);", "limit *= 1.5 * power4(*exponent);"),
    "every ray alone": Control("bvh.h", "#define LANES_TOGETHER 3", "#define LANES_TOGETHER 9"),
    "shadows that do not meet": Control(
        "line.h", "(p.beta * q.side - q.beta * p.side) * inv", "p.beta - (q.beta - p.beta) * (p.side * inv)"
    ),
    "lines of equal weight": Control("line.h", "? 2.0f * lerp1(first, last, v) / sum : 0.0f", "? 1.0f : 0.0f"),
    "lamps' lines too long": Control("line.h", "line.high = (Real)(1.0f);", "line.high = (Real)(1.02f);"),
    # No protection, but, for rays alone, the truth for one: every box is entered, and nothing is culled by distance.
    "brute force": Control(
        "bvh.h",
        "*near = entry;\n    return mask8(entry <= leave);",
        "*near = 0.0f;\n    return mask8(load8(node->bounds[0][0]) <= load8(node->bounds[0][1]));",
    ),
}


@contextmanager
def edited(*controls: str, files: Mapping[str, str] | None = None) -> Iterator[Path]:
    """A folder of the kernels with these controls applied, and with additional files (name: text)."""
    with TemporaryDirectory() as folder:
        copy = Path(folder) / "kernels"
        shutil.copytree(kernel_dir(), copy)
        for control in (CONTROLS[name] for name in controls):
            text = (copy / control.file).read_text(encoding="utf-8")
            assert text.count(control.old) == 1, f"{control.file}: expected this once:\n{control.old}"
            (copy / control.file).write_text(text.replace(control.old, control.new), encoding="utf-8")
        for name, text in (files or {}).items():
            (copy / name).write_text(text, encoding="utf-8")
        yield copy


@contextmanager
def compiled_from(folder: Path) -> Iterator[None]:
    """Makes pyrt take its kernels from the folder."""
    with patch("pyrt.device.kernel_dir", lambda: folder):
        yield


@contextmanager
def kernels(*controls: str, files: Mapping[str, str] | None = None) -> Iterator[None]:
    """Both at once."""
    with edited(*controls, files=files) as folder, compiled_from(folder):
        yield
