"""What a render is asked for."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from pathlib import Path

from pyrt.aov import check_aovs
from pyrt.denoise import require_denoiser
from pyrt.errors import UsageError
from pyrt.passes import PASS_SAMPLES
from pyrt.scene import Scene
from pyrt.settings import Window, check_number, check_whole, crop_window, pair

_MAX_SAMPLES = 1 << 16  # of a pixel, where noise or time is the limit and spp is not given


@dataclass(frozen=True)
class Request:
    """The arguments of `Renderer.render`, all of them, and fit for each other.

    Attributes:
        extend: a checkpoint is to go on to `spp`, not only as far as it was to reach.
    """

    spp: int
    extend: bool
    seed: int
    window: Window
    noise: float | None
    time_limit: float | None
    samples: tuple[int, int] | None
    checkpoint: str | Path | None
    checkpoint_every: float
    resume: bool
    aovs: tuple[str, ...]
    denoise: bool
    pass_samples: int

    @property
    def adaptive(self) -> bool:
        """Whether pixels get samples where they are needed most."""
        return self.noise is not None or self.time_limit is not None

    @property
    def keeps(self) -> bool:
        """Whether the result holds what it takes to go on."""
        return self.checkpoint is not None or self.samples is not None


def request_for(
    scene: Scene,
    spp: int | None = None,
    seed: int = 0,
    size: tuple[int, int] | None = None,
    *,
    noise: float | None = None,
    time_limit: float | None = None,
    samples: tuple[int, int] | None = None,
    checkpoint: str | Path | None = None,
    checkpoint_every: float = 60.0,
    resume: bool = False,
    crop: tuple[int, int, int, int] | None = None,
    aovs: Iterable[str] = (),
    denoise: bool = False,
    pass_samples: int = PASS_SAMPLES,
) -> Request:
    """The request that these arguments of `Renderer.render` make.

    Raises:
        UsageError: an argument is out of range, does not go with another, or needs a package that is not there.
    """
    limited = noise is not None or time_limit is not None
    request = Request(
        spp=spp if spp is not None else _MAX_SAMPLES if limited else scene.spp,
        extend=spp is not None or samples is not None,
        seed=seed,
        window=crop_window(crop, *(pair("size", size) if size is not None else (scene.film.width, scene.film.height))),
        noise=noise,
        time_limit=time_limit,
        samples=None if samples is None else pair("samples", samples),
        checkpoint=checkpoint,
        checkpoint_every=checkpoint_every,
        resume=resume,
        aovs=check_aovs(aovs),
        denoise=denoise,
        pass_samples=pass_samples,
    )
    _check(request)
    return request


def _check(request: Request) -> None:
    """Raises UsageError, one sentence, for an argument that is out of range, or does not go with another."""
    check_whole("spp", request.spp, 1, 2**30)
    check_whole("seed", request.seed, 0, 2**32 - 1)
    check_whole("pass_samples", request.pass_samples, 1, 2**28)
    for name, limit in (("noise", request.noise), ("time_limit", request.time_limit)):
        if limit is not None:
            check_number(name, limit)
    samples, checkpoint, every = request.samples, request.checkpoint, request.checkpoint_every
    if samples is not None and request.adaptive:
        raise UsageError("samples: expected no noise target or time limit beside a range of samples")
    if samples is not None and not 0 <= samples[0] < samples[1] <= 2**30:
        raise UsageError(f"samples: expected 0 <= first < end <= 2^30, got {samples[0]}:{samples[1]}")
    check_number("checkpoint_every", every, zero=True)
    if checkpoint is not None and Path(checkpoint).suffix.lower() != ".exr":
        raise UsageError(f"{checkpoint}: expected a name ending in .exr, the format that can hold a checkpoint")
    if request.denoise:
        require_denoiser()
