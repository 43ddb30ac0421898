"""Hypothesis strategies for scenes: everything that the format allows, mostly where it hurts, and ways to break it."""

from __future__ import annotations

import copy
import struct
from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from hypothesis import strategies as st

Json = dict[str, Any]
Draw = Callable[[st.SearchStrategy[Any]], Any]

LIMIT = 1e30  # of every number in a scene
_MOST_PRIMITIVES = 6  # objects of a scene


@dataclass(frozen=True)
class Case:
    """A scene as a dict, and the files that it names."""

    scene: Json
    files: dict[str, bytes]


def _bits(name: str) -> st.SearchStrategy[float]:
    """Numbers of any size that hold few digits, so that they meet others: ±m·10^e."""
    limits = {"any": (-40, 30), "near": (-9, 1)}[name]
    return st.builds(lambda m, e: float(f"{m}e{e}"), st.integers(-9, 9), st.integers(*limits)).filter(
        lambda x: abs(x) <= LIMIT
    )


numbers = st.sampled_from([0.0, -0.0, 1.0, -1.0, 5e-324, 1e-300, 1e-38, LIMIT, -LIMIT]) | _bits("any")
positive_numbers = numbers.map(abs).filter(lambda x: x > 0)
fractions = st.sampled_from([0.0, 1.0, 0.5, 1e-45, 5e-324, 1 - 2**-53]) | st.floats(0, 1)
colors = st.tuples(fractions, fractions, fractions).map(list)
flags = st.booleans()


def mostly(usual: st.SearchStrategy[Any], odd: st.SearchStrategy[Any]) -> st.SearchStrategy[Any]:
    """`usual` in 7 of 8 cases."""
    return st.integers(0, 7).flatmap(lambda i: odd if i == 7 else usual)


powers = mostly(
    st.tuples(*[st.sampled_from([1.0, 20.0, 0.0])] * 3), st.tuples(*[numbers.map(abs)] * 3)
).map(list)


@dataclass(frozen=True)
class Frame:
    """Where a scene lies, how large it is, and whether some of its parts are somewhere else or of another size."""

    origin: tuple[float, float, float]
    scale: float
    wild: bool

    def points(self) -> st.SearchStrategy[list[float]]:
        """On a lattice, so that surfaces meet and coincide; or anywhere near it; or far outside."""
        lattice, near = st.integers(-4, 4).map(lambda i: i / 4), st.floats(-1, 1)
        local = st.tuples(*[lattice | near] * 3).map(lambda p: [o + self.scale * x for o, x in zip(self.origin, p)])
        return self._or_wild(local, st.tuples(numbers, numbers, numbers).map(list))

    def vectors(self) -> st.SearchStrategy[list[float]]:
        lattice = st.sampled_from([0.0, 0.0, 1.0, -1.0, 0.5, 2.0, 1e-5, 1e-7])
        local = st.tuples(*[lattice] * 3).map(lambda p: [self.scale * x for x in p])
        return self._or_wild(local, st.tuples(numbers, numbers, numbers).map(list))

    def sizes(self) -> st.SearchStrategy[float]:
        local = st.sampled_from([1.0, 0.5, 0.25, 2.0, 1e-3, 1e-7, 100.0]).map(lambda x: x * self.scale)
        return self._or_wild(local, positive_numbers)

    def tame(self) -> Frame:
        return replace(self, wild=False)

    def _or_wild(self, local: st.SearchStrategy[Any], wild: st.SearchStrategy[Any]) -> st.SearchStrategy[Any]:
        return mostly(local, wild) if self.wild else local


@st.composite
def frames(draw: Draw) -> Frame:
    """Mostly of ordinary size at the origin; else as small, as large, or as far away for its size as numbers allow."""
    ordinary = draw(flags)
    scale = 1.0 if ordinary else draw(st.integers(-28, 10).map(lambda e: float(f"1e{e}")))
    away = st.sampled_from([0.0, 0.0, 1.0, 1e6, -148376.25, 1e12])
    place = (0.0, 0.0, 0.0) if ordinary else tuple(scale * draw(away) for _ in range(3))
    return Frame(place, scale, draw(flags))


# --- files ------------------------------------------------------------------------------------------------------------


def _ppm(width: int, height: int, values: bytes) -> bytes:
    return b"P6\n%d %d\n255\n" % (width, height) + values


def _pfm(width: int, height: int, values: list[float]) -> bytes:
    return b"PF\n%d %d\n-1.0\n" % (width, height) + struct.pack(f"<{len(values)}f", *values)


@st.composite
def images(draw: Draw) -> tuple[str, bytes]:
    """Name and content of an image of few pixels; 1×1 often."""
    width, height = draw(st.sampled_from([(1, 1), (1, 4), (3, 5), (2, 2)]))
    n = 3 * width * height
    if draw(flags):
        return ".ppm", _ppm(width, height, draw(st.binary(min_size=n, max_size=n)))
    values = st.lists(st.floats(-1, 2, width=32) | st.sampled_from([65504.0, 1e-45]), min_size=n, max_size=n)
    return ".pfm", _pfm(width, height, draw(values))


@st.composite
def objs(draw: Draw, frame: Frame) -> bytes:
    """An OBJ file of up to 8 vertices and up to 12 faces: shared, repeated and degenerate; some vertices not finite."""
    points = [[0.0, 0.0, 0.0], [frame.scale, 0.0, 0.0], [0.0, frame.scale, frame.scale]]
    points = [[o + x for o, x in zip(frame.origin, p)] for p in points]
    points += draw(st.lists(frame.points(), max_size=5))
    lines = [f"v {x!r} {y!r} {z!r}" for x, y, z in points]
    if draw(st.integers(0, 9)) == 9:
        lines.append(draw(st.sampled_from(["v nan 0 0", "v inf 0 0", "v 3e38 0 0", "v -1e300 0 1e300"])))
    corner = st.integers(1, len(lines))
    faces = [(1, 2, 3)] + draw(st.lists(st.tuples(corner, corner, corner), max_size=11))
    form = draw(st.sampled_from(["{0}", "{0}/{0}", "{0}//{0}", "{0}/{0}/{0}"]))
    count = len(lines)
    coordinate = mostly(st.floats(-2, 2), numbers | st.just(float("nan")) | st.just(float("inf")))
    for _ in range(count):
        s, t, nx, ny, nz = (draw(coordinate) for _ in range(5))
        lines += [f"vt {s!r} {t!r}", f"vn {nx!r} {ny!r} {nz!r}"]
    lines += ["f " + " ".join(form.format(i) for i in face) for face in faces]
    return ("\n".join(lines) + "\n").encode()


# --- parts of a scene -------------------------------------------------------------------------------------------------


def _sine(a: list[float], b: list[float]) -> float:
    a, b = (np.asarray(v) / max(np.abs(v).max(), 5e-324) for v in (a, b))
    return float(np.linalg.norm(np.cross(a, b)))


mappings = st.fixed_dictionaries(
    {},
    optional={
        "type": st.just("uvmapping2d"),
        "scale": st.tuples(numbers, numbers).map(list),
        "delta": st.tuples(numbers, numbers).map(list),
    },
)
iors = mostly(st.sampled_from([1.0, 1.5, 0.5, 2.0, 1 + 1e-6, 1 - 1e-6, 10.0, 0.1]), positive_numbers)


@st.composite
def textures(draw: Draw, files: dict[str, bytes]) -> Json:
    kind = draw(st.sampled_from(["constant", "checkerboard", "image"]))
    if kind == "constant":
        return {"type": kind, "color": draw(colors)}
    mapping = {"tex_coordinate_generator": draw(mappings)} if draw(flags) else {}
    if kind == "checkerboard":
        given = draw(st.fixed_dictionaries({}, optional={"color0": colors, "color1": colors}))
        return {"type": kind, **given, **mapping}
    extension, content = draw(images())
    path = f"image{len(files)}{extension}"
    files[path] = content
    space = {"colorspace": draw(st.sampled_from(["srgb", "linear", None]))} if draw(flags) else {}
    return {"type": kind, "path": path, **space, **mapping}


def diffuse(texture_names: list[str]) -> st.SearchStrategy[Json]:
    kind, twosided = st.just("diffuse"), {"twosided": flags}
    plain = st.fixed_dictionaries({"type": kind, "color": colors}, optional=twosided)
    if not texture_names:
        return plain
    name = st.sampled_from(texture_names)
    return plain | st.fixed_dictionaries({"type": kind, "texture_name": name}, optional=twosided)


def materials(texture_names: list[str]) -> st.SearchStrategy[Json]:
    refraction = st.fixed_dictionaries({"type": st.just("refraction"), "eta": iors})
    dielectric = st.fixed_dictionaries({"type": st.just("dielectric")}, optional={"int_ior": iors, "ext_ior": iors})
    return diffuse(texture_names) | refraction | dielectric


displacements = st.fixed_dictionaries(
    {"amplitude": fractions.filter(lambda x: x < 1)},
    optional={
        "frequency": positive_numbers,
        "octaves": st.sampled_from([1, 3, 16]),
        "seed": st.sampled_from([0, 1, 2**32 - 1]),
    },
)
transforms = st.sampled_from(
    [
        [1.0, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1],
        [-1.0, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1],
        [1e-8, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1],
        [1.0, 0.999999, 0, 0, 0, 1, 0, 0, 0.5, 0, 1, 0, 0, 0, 0, 1],
        [1e5, 0, 0, 0, 0, 1e5, 0, 0, 0, 0, 1e5, 0, 0, 0, 0, 1],
    ]
)


@st.composite
def objects(draw: Draw, frame: Frame, names: list[str], files: dict[str, bytes]) -> Json:
    kind = draw(st.sampled_from(["rectangle", "rectangle", "sphere", "icosphere", "mesh"]))
    out: Json = {"type": kind}
    if kind == "rectangle":
        edges = st.tuples(frame.vectors(), frame.vectors()).filter(lambda e: _sine(*e) > 1e-9)
        out["center"], (out["edge1"], out["edge2"]) = draw(frame.points()), draw(edges)
    elif kind == "sphere":
        out["center"], out["radius"] = draw(frame.points()), draw(frame.sizes())
    elif kind == "icosphere":
        required = {"center": frame.points(), "radius": frame.sizes(), "subdivisions": st.sampled_from([0, 1, 2])}
        optional = {"smooth": flags, "displacement": displacements}
        out |= draw(st.fixed_dictionaries(required, optional=optional))
    else:
        out["path"] = f"mesh{len(files)}.obj"
        files[out["path"]] = draw(objs(frame))
        out |= draw(st.fixed_dictionaries({}, optional={"transform": transforms, "translate": frame.tame().vectors()}))
    light = {"light": {"radiance": draw(powers)}} if not names or draw(st.integers(0, 2)) == 2 else {}
    material = {"material_name": draw(st.sampled_from(names))} if names and (not light or draw(flags)) else {}
    return out | material | light


def _wall(frame: Frame, material: str) -> Json:
    """Fills the picture of a camera that stands before the scene."""
    s = 4 * frame.scale
    return {
        "type": "rectangle",
        "center": list(frame.origin),
        "edge1": [s, 0.0, 0.0],
        "edge2": [0.0, s, 0.0],
        "material_name": material,
    }


@st.composite
def cameras(draw: Draw, frame: Frame) -> Json:
    """Mostly before the scene; else anywhere, inside of walls as well."""
    before = [o + frame.scale * x for o, x in zip(frame.origin, (0.3, 0.4, 3.0))]
    position = draw(st.just(before) | frame.points())
    target = draw((st.just(list(frame.origin)) | frame.points()).filter(lambda p: p != position))
    direction = [b - a for a, b in zip(position, target)]
    up = draw(st.tuples(numbers, numbers, numbers).map(list).filter(lambda v: _sine(v, direction) > 1e-6))
    angles = mostly(st.sampled_from([40.0, 90.0]), st.sampled_from([5e-324, 1e-9, 0.001, 179.0, 179.99999, 180 - 3e-14]))
    return {"position": position, "look_at": target, "ref_up": up, "fov": draw(angles)}


def _point_lights(frame: Frame) -> st.SearchStrategy[list[Json]]:
    light = st.fixed_dictionaries({"position": frame.points(), "flux": powers}, optional={"type": st.just("point")})
    return st.lists(light, max_size=2) | st.lists(light, min_size=9, max_size=10)


@st.composite
def cases(draw: Draw) -> Case:
    """A valid scene, a picture of at most 33×17 pixels, and at most 17 samples a pixel."""
    frame = draw(frames())
    files: dict[str, bytes] = {}
    texture_names = [f"t{i}" for i in range(draw(st.integers(0, 2)))]
    texture_entries = {name: draw(textures(files)) for name in texture_names}
    names = [f"m{i}" for i in range(draw(st.sampled_from([1, 2, 3, 0])))]
    material_entries = {name: draw((materials if i else diffuse)(texture_names)) for i, name in enumerate(names)}
    count = draw(st.integers(1, _MOST_PRIMITIVES))
    shapes = [draw(objects(frame, names, files)) for _ in range(count)]
    if names and draw(st.integers(0, 3)) < 3:
        shapes.append(_wall(frame, names[0]))
    integrator = st.fixed_dictionaries(
        {"spp": st.sampled_from([1, 2, 3, 16, 17])},
        optional={
            "type": st.sampled_from(["direct", "intersection_test"]),
            "max_depth": st.sampled_from([0, 1, 5, 1024]),
            "point_light_position": frame.points(),
            "point_light_flux": powers,
        },
    )
    scene = {
        "integrator": draw(integrator),
        "film": {"resolution": draw(st.sampled_from([[8, 8], [33, 17], [17, 2], [1, 1]]))},
        "camera": draw(cameras(frame)),
        "textures": texture_entries,
        "materials": material_entries,
        "lights": draw(_point_lights(frame)),
        "objects": shapes,
    }
    return Case(scene, files)
