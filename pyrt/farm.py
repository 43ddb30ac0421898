"""One picture by several processes or machines: each renders a range of its samples, and `merge` adds them exactly."""

from __future__ import annotations

import os
from collections.abc import Sequence
from concurrent.futures import Executor
from dataclasses import replace
from functools import reduce
from itertools import pairwise
from typing import Any

import numpy as np
from numpy.typing import NDArray

from pyrt.aov import exr_planes, stored_aovs
from pyrt.errors import UsageError
from pyrt.image_file import Attribute, read_exr
from pyrt.partial import Partial, merge_order
from pyrt.partial import merge as add
from pyrt.partial_file import read_header, read_partial
from pyrt.picture import partial_result
from pyrt.renderer import Renderer
from pyrt.result import Result
from pyrt.scene_io import Source, load_scene


def merge(paths: Sequence[str | os.PathLike[str]]) -> Result:
    """The picture of all the samples in EXR files that renders with `samples=` or `checkpoint=` wrote, with the same
    bits as that of one render.

    It has the AOVs that any of the files has, which do not depend on the range of samples; variance and samples are
    those of all together. `Result.stats["left_out"]` lists the other channels, such as those of a denoised part.

    Raises:
        UsageError: a file is damaged or of another kind, they are not of one picture on one kind of device, their
            samples overlap or leave a gap, or their AOVs differ.
    """
    if isinstance(paths, str | os.PathLike):
        raise UsageError(f"merge: expected a list of files, got the single name {paths}")
    names = [os.fspath(path) for path in paths]
    if not names or len(set(names)) < len(names):
        raise UsageError(f"expected different files to merge, got {', '.join(names) or 'none'}")
    order = merge_order({name: read_header(name) for name in names})
    return _with_channels(partial_result(reduce(add, (read_partial(name) for name in order))), order)


def _with_channels(result: Result, names: list[str]) -> Result:
    """The result with the AOVs of its parts, and what their headers say of the scene."""
    aovs: dict[str, NDArray[Any]] = {}
    left_out: set[str] = set()
    metadata: dict[str, Attribute] = {}
    sampled = {"variance": result.variance, "samples": result.samples}
    for name in names:
        layers = read_exr(name)
        found = stored_aovs(layers.planes)
        left_out |= layers.planes.keys() - exr_planes(found).keys()
        metadata = metadata or layers.metadata
        for aov, array in found.items():
            if aov not in sampled and not _same(array, aovs.setdefault(aov, array)):
                raise UsageError(
                    f"{name}: its channels of {aov} are not those of {names[0]}, expected the same picture"
                )
        aovs |= {aov: array for aov, array in sampled.items() if aov in found}
    metadata = {key: value for key, value in metadata.items() if key != "pyrt:seconds"} | result.metadata
    return replace(result, aovs=aovs, metadata=metadata, stats={**result.stats, "left_out": sorted(left_out)})


def _same(a: NDArray[Any], b: NDArray[Any]) -> bool:
    """Whether AOVs are equal, but for the rounding of another machine."""
    if a.shape != b.shape or a.dtype.kind == "u":
        return np.array_equal(a, b)
    finite = np.abs(a[np.isfinite(a)])
    return np.allclose(a, b, rtol=1e-5, atol=1e-5 * finite.max(initial=0))


def render_samples(
    scene: Source, samples: tuple[int, int], seed: int, size: tuple[int, int] | None, device: str | int | None
) -> Partial:
    """The unit of work: the film of some samples of a scene file or dict. It may run in another process, which loads
    the scene for itself."""
    partial = Renderer(load_scene(scene), device).render(seed=seed, size=size, samples=samples).partial
    assert isinstance(partial, Partial)
    return partial


def render_parallel(
    scene: Source,
    executor: Executor,
    parts: int,
    *,
    spp: int | None = None,
    seed: int = 0,
    size: tuple[int, int] | None = None,
    device: str | int | None = None,
) -> Result:
    """Renders a scene file or dict by the workers of any executor, with the same bits as `render`.

    Processes must be spawned, as OpenCL does not survive a fork. Files of the scene must be there for all workers.
    Where processes share PoCL's cache of compiled kernels, render the scene once before: they disturb each other
    filling it.

    Args:
        scene: a scene file, a model, `example:NAME` or a dict, as for `load_scene`.
        executor: any concurrent.futures.Executor, or one that behaves so.
        parts: ranges of samples, one for each worker at best.
        spp, seed, size, device: as for `Renderer` and its `render`.

    Raises:
        UsageError: `parts` is not from 1 to spp, or the workers' devices are of different kinds.
        SceneError, DeviceError: as for `load_scene` and `Renderer`; a worker's come here.
    """
    spp = load_scene(scene).spp if spp is None else spp
    if not 1 <= parts <= spp:
        raise UsageError(f"parts: expected a whole number from 1 to {spp}, one sample each, got {parts!r}")
    ends = [spp * part // parts for part in range(parts + 1)]
    units = [executor.submit(render_samples, scene, samples, seed, size, device) for samples in pairwise(ends)]
    partials = {f"part {i}": unit.result() for i, unit in enumerate(units)}
    order = merge_order({name: (p.work, p.first, p.end) for name, p in partials.items()})
    return partial_result(reduce(add, (partials[name] for name in order)))
