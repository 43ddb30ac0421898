"""Runs a few lines of OpenCL C that include one kernel header over numpy arrays."""

from __future__ import annotations

import tempfile
from functools import lru_cache
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from pyrt.device import Device
from pyrt.features import feature_table
from pyrt.layout import dtypes
from pyrt.scene import Scene

_SOURCE = """#include "{header}"
kernel __attribute__((reqd_work_group_size(LOCAL_SIZE, 1, 1)))
void probe(const uint count, {arguments})
{{
    uint i = (uint)get_global_id(0);
    if (i >= count)
        return;
    {code}
}}
"""
_SCALARS = {np.dtype(np.float32): "float", np.dtype(np.uint32): "uint", np.dtype(np.int32): "int"}


@lru_cache(maxsize=1)
def device() -> Device:
    return Device()


def evaluate(
    header: str, code: str, count: int, outputs: dict[str, Any], options: tuple[str, ...] = (), **inputs: NDArray[Any]
) -> dict[str, NDArray[Any]]:
    """Run `code` once for every i in [0, count), and return the outputs.

    Inputs are pointers of their own name, to float, uint, int or a struct of types.h. Outputs are given as
    dtype, for one value each i, or as (dtype, k) for a row of k. All features are on, unless `options` say otherwise.
    """
    shapes = {name: kind if isinstance(kind, tuple) else (kind,) for name, kind in outputs.items()}
    arguments = [f"const {_space(array.dtype)} {_c_type(array.dtype)} *{name}" for name, array in inputs.items()]
    arguments += [f"global {_c_type(np.dtype(kind))} *{name}" for name, (kind, *_) in shapes.items()]
    features = [f"-D{row.macro}=1" for row in feature_table(Scene()) if not any(row.macro in o for o in options)]
    with tempfile.NamedTemporaryFile("w", suffix=".cl") as file:
        file.write(_SOURCE.format(header=header, arguments=", ".join(arguments), code=code))
        file.flush()
        kernel = device().build(str(Path(file.name)), [*features, *options])["probe"]
    buffers = [device().upload(name, array) for name, array in inputs.items()]
    results = [device().allocate(count * np.dtype((kind, tuple(k))).itemsize) for kind, *k in shapes.values()]
    device().run(kernel, count, np.uint32(count), *buffers, *results)
    out = {}
    for buffer, (name, (kind, *k)) in zip(results, shapes.items(), strict=True):
        with device().mapped(buffer, (count, *k), kind) as array:
            out[name] = array.copy()
    return out


def sobol_points(pixels: NDArray[Any], pair: int, samples: int, first: int = 0) -> NDArray[np.float32]:
    """(pixels, samples, 2) points of the given pixel hashes, from sample index `first` on."""
    code = """
        Sampler sampler = {pixels[i / how[0]], how[1] + i % how[0]};
        vstore2(sample_2d(sampler, how[2]), i, points);
    """
    how = np.array([samples, first, pair], np.uint32)
    count, shape = len(pixels) * samples, {"points": (np.float32, 2)}
    points = evaluate("sampling.h", code, count, shape, pixels=pixels, how=how)["points"]
    return points.reshape(len(pixels), samples, 2)


def _c_type(dtype: np.dtype[Any]) -> str:
    return _SCALARS.get(dtype) or next(name for name, struct in dtypes().items() if struct == dtype)


def _space(dtype: np.dtype[Any]) -> str:
    return "constant" if dtype in (dtypes()["Camera"], dtypes()["SceneParams"]) else "global"
