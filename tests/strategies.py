"""Hypothesis strategies for scenes: everything that the format allows, mostly where it hurts, and ways to break it.

A case depends on nothing but the choices that Hypothesis makes, so that it can be shrunk and printed.
"""

from __future__ import annotations

import copy
import struct
from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
from hypothesis import HealthCheck, settings
from hypothesis import strategies as st

Json = dict[str, Any]
Draw = Callable[[st.SearchStrategy[Any]], Any]
Strategy = st.SearchStrategy[Any]

_LIMIT = 1e30  # of every number in a scene
_NAN, _INF = float("nan"), float("inf")


def examples(count: int) -> settings:
    """So many examples, always the same ones."""
    slow = [HealthCheck.too_slow, HealthCheck.data_too_large, HealthCheck.filter_too_much]
    return settings(max_examples=count, derandomize=True, database=None, deadline=None, suppress_health_check=slow)


@dataclass(frozen=True)
class Case:
    """A scene as a dict, and the content of the files that it names."""

    scene: Json
    files: dict[str, bytes]

    def write_files(self, folder: Path) -> None:
        for name, content in self.files.items():
            (folder / name).write_bytes(content)


# --- numbers ----------------------------------------------------------------------------------------------------------

flags = st.booleans()
_powers_of_ten = st.builds(lambda m, e: float(f"{m}e{e}"), st.integers(-9, 9), st.integers(-40, 29))
numbers = st.sampled_from([0.0, -0.0, 1.0, -1.0, 5e-324, 1e-300, 1e-38, _LIMIT, -_LIMIT]) | _powers_of_ten
_number_lists = st.tuples(numbers, numbers, numbers).map(list)
_positive = numbers.map(abs).filter(lambda x: x > 0)
_fractions = st.sampled_from([0.0, 1.0, 0.5, 1e-45, 5e-324, 1 - 2**-53]) | st.floats(0, 1)
_colors = st.tuples(_fractions, _fractions, _fractions).map(list)


def mostly(usual: Strategy, odd: Strategy) -> Strategy:
    return st.integers(0, 7).flatmap(lambda i: odd if i == 7 else usual)


_usual_power, _odd_power = st.sampled_from([1.0, 20.0, 0.0]), numbers.map(abs)
_powers = mostly(st.tuples(*[_usual_power] * 3), st.tuples(*[_odd_power] * 3)).map(list)
_iors = mostly(st.sampled_from([1.0, 1.5, 0.5, 2.0, 1 + 1e-6, 1 - 1e-6, 10.0, 0.1]), _positive)


@dataclass(frozen=True)
class Frame:
    """Where a scene lies, how large it is, and whether some of its parts are somewhere else or of another size."""

    origin: tuple[float, float, float]
    scale: float
    wild: bool

    def points(self) -> Strategy:
        """On a lattice, so that surfaces meet and coincide; or anywhere near it; or far outside."""
        coordinate = st.integers(-4, 4).map(lambda i: i / 4) | st.floats(-1, 1)
        return self._or_wild(st.tuples(*[coordinate] * 3).map(self.place), _number_lists)

    def vectors(self) -> Strategy:
        coordinate = st.sampled_from([0.0, 0.0, 1.0, -1.0, 0.5, 2.0, 1e-5, 1e-7]).map(lambda x: x * self.scale)
        return self._or_wild(st.tuples(*[coordinate] * 3).map(list), _number_lists)

    def sizes(self) -> Strategy:
        size = st.sampled_from([1.0, 0.5, 0.25, 2.0, 1e-3, 1e-7, 100.0]).map(lambda x: x * self.scale)
        return self._or_wild(size, _positive)

    def place(self, p: tuple[float, float, float]) -> list[float]:
        return [o + self.scale * x for o, x in zip(self.origin, p, strict=True)]

    def _or_wild(self, usual: Strategy, odd: Strategy) -> Strategy:
        return mostly(usual, odd) if self.wild else usual


@st.composite
def frames(draw: Draw) -> Frame:
    """Mostly of ordinary size at the origin; else small, large, or far away for its size."""
    if draw(flags):
        return Frame((0.0, 0.0, 0.0), 1.0, draw(flags))
    scale = draw(st.integers(-28, 10).map(lambda e: float(f"1e{e}")))
    away = st.sampled_from([0.0, 0.0, 1.0, 1e6, -148376.25, 1e12]).map(lambda x: x * scale)
    return Frame((draw(away), draw(away), draw(away)), scale, draw(flags))


# --- files ------------------------------------------------------------------------------------------------------------


@st.composite
def _images(draw: Draw) -> tuple[str, bytes]:
    """Extension and content of an image of few pixels."""
    width, height = draw(st.sampled_from([(1, 1), (1, 4), (3, 5), (2, 2)]))
    n = 3 * width * height
    if draw(flags):
        return ".ppm", b"P6\n%d %d\n255\n" % (width, height) + draw(st.binary(min_size=n, max_size=n))
    value = st.floats(-1, 2, width=32) | st.sampled_from([65504.0, 1e-45])
    values = draw(st.lists(value, min_size=n, max_size=n))
    return ".pfm", b"PF\n%d %d\n-1.0\n" % (width, height) + struct.pack(f"<{n}f", *values)


@st.composite
def meshes(draw: Draw, frame: Frame) -> bytes:
    """An OBJ file of few vertices and faces: shared, repeated and degenerate; some numbers not finite."""
    points = [frame.place(p) for p in ((0.0, 0.0, 0.0), (1.0, 0.0, 0.0), (0.0, 1.0, 1.0))]
    lines = [f"v {x!r} {y!r} {z!r}" for x, y, z in points + draw(st.lists(frame.points(), max_size=5))]
    lines += draw(st.lists(st.sampled_from(["v nan 0 0", "v inf 0 0", "v 3e38 0 0", "v -1e300 0 1e300"]), max_size=1))
    corner = st.integers(1, len(lines))
    faces = [(1, 2, 3), *draw(st.lists(st.tuples(corner, corner, corner), max_size=11))]
    form = draw(st.sampled_from(["{0}", "{0}/{0}", "{0}//{0}", "{0}/{0}/{0}"]))
    coordinate = mostly(st.floats(-2, 2), numbers | st.sampled_from([_NAN, _INF, 1e300]))
    for _ in range(len(lines)):
        s, t, nx, ny, nz = (draw(coordinate) for _ in range(5))
        lines += [f"vt {s!r} {t!r}", f"vn {nx!r} {ny!r} {nz!r}"]
    lines += ["f " + " ".join(form.format(i) for i in face) for face in faces]
    return ("\n".join(lines) + "\n").encode()


# --- the parts of a scene ---------------------------------------------------------------------------------------------

_pair = st.tuples(numbers, numbers).map(list)
_mappings = st.fixed_dictionaries({}, optional={"type": st.just("uvmapping2d"), "scale": _pair, "delta": _pair})


@st.composite
def _textures(draw: Draw, files: dict[str, bytes]) -> Json:
    kind = draw(st.sampled_from(["constant", "checkerboard", "image"]))
    if kind == "constant":
        return {"type": kind, "color": draw(_colors)}
    mapping = {"tex_coordinate_generator": _mappings}
    if kind == "checkerboard":
        optional = {"color0": _colors, "color1": _colors, **mapping}
        return draw(st.fixed_dictionaries({"type": st.just(kind)}, optional=optional))
    extension, content = draw(_images())
    path = f"image{len(files)}{extension}"
    files[path] = content
    optional = {"colorspace": st.sampled_from(["srgb", "linear", None]), **mapping}
    return draw(st.fixed_dictionaries({"type": st.just(kind), "path": st.just(path)}, optional=optional))


def _diffuse(texture_names: list[str]) -> Strategy:
    kind, twosided = st.just("diffuse"), {"twosided": flags}
    plain = st.fixed_dictionaries({"type": kind, "color": _colors}, optional=twosided)
    if not texture_names:
        return plain
    name = st.sampled_from(texture_names)
    return plain | st.fixed_dictionaries({"type": kind, "texture_name": name}, optional=twosided)


def _materials(texture_names: list[str]) -> Strategy:
    refraction = st.fixed_dictionaries({"type": st.just("refraction"), "eta": _iors})
    dielectric = st.fixed_dictionaries({"type": st.just("dielectric")}, optional={"int_ior": _iors, "ext_ior": _iors})
    return _diffuse(texture_names) | refraction | dielectric


_displacements = st.fixed_dictionaries(
    {"amplitude": _fractions.filter(lambda x: x < 1)},
    optional={
        "frequency": _positive,
        "octaves": st.sampled_from([1, 3, 16]),
        "seed": st.sampled_from([0, 1, 2**32 - 1]),
    },
)
_transforms = st.sampled_from(
    [
        [1.0, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1],
        [-1.0, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1],
        [1e-8, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1],
        [1.0, 0.999999, 0, 0, 0, 1, 0, 0, 0.5, 0, 1, 0, 0, 0, 0, 1],
        [1e5, 0, 0, 0, 0, 1e5, 0, 0, 0, 0, 1e5, 0, 0, 0, 0, 1],
    ]
)


def _sine(a: list[float], b: list[float]) -> float:
    """At least about the sine of the angle between them; 0 if one is 0."""
    a, b = (np.asarray(v) / max(np.abs(v).max(), 5e-324) for v in (a, b))
    return float(np.linalg.norm(np.cross(a, b)))


def _shapes(frame: Frame, files: dict[str, bytes]) -> dict[str, Strategy]:
    """What each type of object needs besides its type, material and light."""
    edges = st.tuples(frame.vectors(), frame.vectors()).filter(lambda e: _sine(*e) > 1e-9)
    center, size = frame.points(), frame.sizes()
    mesh = st.fixed_dictionaries(
        {"path": st.just(f"mesh{len(files)}.obj")},
        optional={"transform": _transforms, "translate": replace(frame, wild=False).vectors()},
    )
    icosphere = st.fixed_dictionaries(
        {"center": center, "radius": size, "subdivisions": st.sampled_from([0, 1, 2])},
        optional={"smooth": flags, "displacement": _displacements},
    )
    return {
        "rectangle": st.builds(lambda c, e: {"center": c, "edge1": e[0], "edge2": e[1]}, center, edges),
        "sphere": st.fixed_dictionaries({"center": center, "radius": size}),
        "icosphere": icosphere,
        "mesh": mesh,
    }


@st.composite
def _objects(draw: Draw, frame: Frame, names: list[str], files: dict[str, bytes]) -> Json:
    kind = draw(st.sampled_from(["rectangle", "rectangle", "sphere", "icosphere", "mesh"]))
    shape = {"type": kind, **draw(_shapes(frame, files)[kind])}
    if kind == "mesh":
        files[shape["path"]] = draw(meshes(frame))
    if not names or draw(st.integers(0, 2)) == 2:
        shape["light"] = {"radiance": draw(_powers)}
    if names and ("light" not in shape or draw(flags)):
        shape["material_name"] = draw(st.sampled_from(names))
    return shape


def _wall(frame: Frame, material: str) -> Json:
    """Fills the picture of a camera that stands before the scene."""
    s = 4 * frame.scale
    edges = {"edge1": [s, 0.0, 0.0], "edge2": [0.0, s, 0.0]}
    return {"type": "rectangle", "center": list(frame.origin), **edges, "material_name": material}


@st.composite
def _cameras(draw: Draw, frame: Frame) -> Json:
    """Before the scene; or anywhere, inside of walls and far away as well."""
    position = draw(st.just(frame.place((0.3, 0.4, 3.0))) | frame.points())
    target = draw((st.just(list(frame.origin)) | frame.points()).filter(lambda p: p != position))
    direction = [b - a for a, b in zip(position, target, strict=True)]
    up = draw(_number_lists.filter(lambda v: _sine(v, direction) > 1e-6))
    usual, odd = [40.0, 90.0, 150.0], [5e-324, 1e-9, 0.001, 179.0, 179.99999, 180 - 3e-14]
    return {
        "position": position,
        "look_at": target,
        "ref_up": up,
        "fov": draw(mostly(st.sampled_from(usual), st.sampled_from(odd))),
    }


def _lights(frame: Frame) -> Strategy:
    point = st.fixed_dictionaries({"position": frame.points(), "flux": _powers}, optional={"type": st.just("point")})
    cones = st.sampled_from([(0, 45), (0, 90), (89, 90), (0, 1e-30), (1e-6, 1e-5), (24.999999999, 25)])
    spot = st.builds(
        lambda ends, power, cone: {
            **{"type": "spot", "intensity": power, "inner_angle": cone[0], "outer_angle": cone[1]},
            **dict(zip(("position", "look_at"), ends, strict=True)),
        },
        st.tuples(frame.points(), frame.points()).filter(lambda ends: list(ends[0]) != list(ends[1])),
        _powers,
        cones,
    )
    light = mostly(point, spot)
    return st.lists(light, max_size=2) | st.lists(light, min_size=9, max_size=10)


def _integrators(frame: Frame) -> Strategy:
    return st.fixed_dictionaries(
        {"spp": st.sampled_from([1, 2, 3, 16, 17])},
        optional={
            "type": st.sampled_from(["direct", "intersection_test"]),
            "max_depth": st.sampled_from([0, 1, 5, 1024]),
            "point_light_position": frame.points(),
            "point_light_flux": _powers,
        },
    )


@st.composite
def cases(draw: Draw) -> Case:
    """A valid scene of few objects, with a picture of at most 33×17 pixels and 17 samples a pixel."""
    frame = draw(frames())
    files: dict[str, bytes] = {}
    texture_names = [f"t{i}" for i in range(draw(st.integers(0, 2)))]
    textures = {name: draw(_textures(files)) for name in texture_names}
    names = [f"m{i}" for i in range(draw(st.sampled_from([1, 2, 3, 0])))]
    materials = {name: draw((_materials if i else _diffuse)(texture_names)) for i, name in enumerate(names)}
    objects = [draw(_objects(frame, names, files)) for _ in range(draw(st.integers(1, 6)))]
    if names and draw(st.integers(0, 3)) < 3:
        objects.append(_wall(frame, names[0]))
    scene = {
        "integrator": draw(_integrators(frame)),
        "film": {"resolution": draw(st.sampled_from([[8, 8], [33, 17], [17, 2], [1, 1]]))},
        "camera": draw(_cameras(frame)),
        "textures": textures,
        "materials": materials,
        "lights": draw(_lights(frame)),
        "objects": objects,
    }
    return Case(scene, files)


# --- broken scenes ----------------------------------------------------------------------------------------------------

_LONG = "x" * 300
_strings = st.sampled_from(["", "m0", "sphere", "constant", "a\nb", "a.b", "\0", "é", "\ud800", _LONG, "../m0", "/"])
_odd_numbers = st.sampled_from([_NAN, _INF, -_INF, -1, 0, 3, 2**31, 2**64, 10**400, 1e31, -1e-9, True])
_scalars = st.none() | _odd_numbers | _strings
_keys = st.sampled_from(["type", "m0", "color", "texture_name", "light", "", _LONG, "a b"])
json_values = st.recursive(_scalars, lambda v: st.lists(v, max_size=4) | st.dictionaries(_keys, v, max_size=3))
_not_json = st.sampled_from(
    [
        b"bytes",
        object(),
        {1, 2},
        1j,
        {1: 2},
        {"a\nb": 1},
        Path("x"),
        np.float32(0.5),
        np.zeros((2, 2)),
        np.array(["a"]),
        np.array([], object),
    ]
)


def _places(node: Any) -> Iterator[tuple[Any, Any]]:
    """Every (container, key or index) inside of the node."""
    if not isinstance(node, (dict, list)):
        return
    for key, value in list(node.items() if isinstance(node, dict) else enumerate(node)):
        yield node, key
        yield from _places(value)


def _mutate(draw: Draw, scene: Json, values: Strategy) -> None:
    """Removes, adds or replaces one value anywhere in the scene."""
    places = list(_places(scene))
    node, key = places[draw(st.integers(0, len(places) - 1))]
    action = draw(st.sampled_from(["replace", "replace", "remove", "add"]))
    if action == "remove":
        del node[key]
    elif action == "add" and isinstance(node, dict):
        node[draw(_keys)] = draw(values)
    elif action == "add":
        node.append(draw(values))
    else:
        node[key] = draw(values)


@st.composite
def mutants(draw: Draw, *, only_json: bool = False) -> Case:
    """A scene after a few random changes: nearly always invalid."""
    case = draw(cases())
    scene = copy.deepcopy(case.scene)
    for _ in range(draw(st.integers(1, 3))):
        if scene:
            _mutate(draw, scene, json_values if only_json else json_values | _not_json)
    return Case(scene, case.files)


@st.composite
def damaged(draw: Draw, content: bytes) -> bytes:
    """The content cut off, or with some bytes replaced, inserted or removed."""
    for _ in range(draw(st.integers(1, 3))):
        start = draw(st.integers(0, len(content)))
        length = draw(st.sampled_from([0, 1, 4, len(content)]))
        content = content[:start] + draw(st.binary(max_size=4)) + content[start + length :]
    return content
