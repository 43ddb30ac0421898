"""How much memory a render takes: known before it takes any."""

from __future__ import annotations

from dataclasses import dataclass

from pyrt.errors import PyrtError
from pyrt.layout import constants, dtypes
from pyrt.passes import MAX_BEAM_BYTES, PASS_SAMPLES, pass_shape
from pyrt.room import available
from pyrt.scene import ImageTexture, Mesh, Rectangle, Scene, Sphere

# Bytes, measured with PoCL on Linux: most that are in use at once.
_PROGRAM = 125 << 20  # Python, numpy, OpenCL with its compiler, OpenImageIO
_TRIANGLE = 230  # while the tree is built
_SPHERE = 200
_OBJECTS = {Mesh: 690, Rectangle: 950, Sphere: 560}  # of the scene file
_TEXEL = 12
_KEPT = 30  # of a pixel: its places in lists, if what it takes to continue is kept
_SUM = 48  # of a pixel: its channels and their squares, in float64
_PART = 12 << 20  # sums of the pixels that are traced at a time, if nothing is kept to continue
_WRITTEN = 32  # of a pixel: mean, variance, number of samples, and its place in a list
_ADAPTIVE = 100  # of a pixel, if pixels have their own numbers of samples
_CHANNEL = 6  # of a pixel: one channel beside the picture
_UNASKED = 64 << 20  # to ask how much there is takes a millisecond
_GIB = 1 << 30


@dataclass(frozen=True)
class Need:
    """Bytes of memory at the peak of a render."""

    scene: int  # what is loaded
    build: int  # the tree while it is built, or, if that is more, what the device holds
    picture: int

    @property
    def total(self) -> int:
        """Of the process."""
        return _PROGRAM + self.scene + self.build + self.picture

    def require(self, name: str) -> None:
        """Raises PyrtError, one sentence, unless what is not loaded yet fits into memory."""
        more = self.build + self.picture
        if more > _UNASKED and more > (free := available()):
            raise PyrtError(
                f"{name}: expected {more / _GIB:.3g} GiB of free memory ({self.build / _GIB:.3g} for the scene, "
                f"{self.picture / _GIB:.3g} for the picture), found {max(free, 0) / _GIB:.3g} GiB"
            )


def estimate(scene: Scene, picture: int = 0) -> Need:
    """What rendering the scene takes, within 20 %; compiling its kernels the first time, 130 MiB more for a moment.

    For `picture` see `picture_bytes`.
    """
    triangles, spheres, texels = _counts(scene)
    meshes = [shape for shape in scene.shapes if isinstance(shape, Mesh)]
    images = sum(isinstance(t, ImageTexture) for t in scene.textures)
    arrays = (a for m in meshes for a in (m.vertices, m.triangles, m.uvs, m.normals) if a is not None)
    loaded = sum({id(a): a.nbytes for a in arrays}.values()) + _TEXEL * texels
    loaded += sum(size * sum(isinstance(shape, kind) for shape in scene.shapes) for kind, size in _OBJECTS.items())
    build = _TRIANGLE * triangles + _SPHERE * spheres + _TEXEL * texels * (1 + (images > 1))
    return Need(loaded, build, picture)


def buffer_bytes(scene: Scene) -> dict[str, int]:
    """Of the largest arrays that the device will hold, as far as the tree does not decide about their size."""
    triangles, spheres, texels = _counts(scene)
    size = {name: dtype.itemsize for name, dtype in dtypes().items()}
    return {"triangles": size["Triangle"] * triangles, "spheres": size["Sphere"] * spheres, "texels": _TEXEL * texels}


def _counts(scene: Scene) -> tuple[int, int, int]:
    """Triangles, spheres and texels."""
    triangles = sum(len(shape.triangles) for shape in scene.shapes if isinstance(shape, Mesh))
    rectangles, spheres = (sum(isinstance(shape, kind) for shape in scene.shapes) for kind in (Rectangle, Sphere))
    texels = sum(t.pixels.size // 3 for t in scene.textures if isinstance(t, ImageTexture))
    return triangles + 2 * rectangles, spheres, texels


def picture_bytes(
    scene: Scene, pixels: int, spp: int, *, channels: int = 0, keep: bool = False, adaptive: bool = False
) -> int:
    """Of a picture of so many pixels in passes of the default size.

    `channels` come beside it; `keep`: what it takes to continue is kept, too; `adaptive`: for a noise target or a time.
    """
    lights = len(scene.lights) + sum(shape.radiance is not None for shape in scene.shapes)
    beam = constants()["BEAM_PIXELS"]
    pixel_step, sample_step = pass_shape(spp, PASS_SAMPLES)
    in_pass = min(pixels, pixel_step)
    planes = 12 * in_pass * sample_step
    shafts = min(lights, constants()["SHAFT_LIGHTS"])
    beam_bytes = dtypes()["Candidates"].itemsize * (1 + shafts)
    ahead = beam_bytes * (pixels // beam)
    beams = ahead if (keep or adaptive) and ahead <= MAX_BEAM_BYTES else beam_bytes * (in_pass // beam)
    nodes = spp.bit_count()  # and their sum
    kept = pixels * (_ADAPTIVE if adaptive else _KEPT + 2 * _SUM * (nodes + (nodes > 1)))
    sums = kept if adaptive or keep else min(_SUM * pixels, _PART)
    return planes + beams + sums + pixels * (_WRITTEN + _CHANNEL * channels)
