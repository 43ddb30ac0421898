"""The camera of the JSON scene format: where it stands, and how it projects."""

from __future__ import annotations

from typing import Annotated, Literal

import numpy as np
from pydantic import AfterValidator, Field, model_validator

from pyrt.schema_types import (
    Angle,
    Model,
    Number,
    Positive,
    Resolution,
    Vec3,
    expect,
    sentence,
    unexpected,
)

# Of a rotation's axes: lengths and right angles, as far as files that round to 4 digits keep them.
_RIGID = 1e-3
_MAX_PIXELS = 1e6  # beyond, float32 directions would lose the picture

_Row3 = tuple[Number, Number, Number]
_Row4 = tuple[Number, Number, Number, Number]


def _check_pose(matrix: tuple[_Row4, _Row4, _Row4, _Row4]) -> tuple[_Row4, _Row4, _Row4, _Row4]:
    if matrix[3] != (0.0, 0.0, 0.0, 1.0):
        raise unexpected("a matrix whose last row is 0, 0, 0, 1")
    axes = np.array(matrix)[:3, :3]
    if np.abs(axes.T @ axes - np.eye(3)).max() > _RIGID:
        raise unexpected("a rotation, 3 perpendicular columns of length 1")
    if np.linalg.det(axes) < 0:
        raise unexpected("a rotation, not a mirror image of one")
    return matrix


def _check_calibration(matrix: tuple[_Row3, _Row3, _Row3]) -> tuple[_Row3, _Row3, _Row3]:
    (fx, skew, cx), (zero, fy, cy), last = matrix
    if min(fx, fy) <= 0 or (skew, zero, *last) != (0.0, 0.0, 0.0, 0.0, 1.0):
        raise unexpected("[[fx, 0, cx], [0, fy, cy], [0, 0, 1]] with positive fx and fy")
    if max(fx, fy, abs(cx), abs(cy)) > _MAX_PIXELS or min(fx, fy) < 1 / _MAX_PIXELS:
        raise unexpected("focal lengths from 1e-6 to 1e6 pixels, and cx and cy from -1e6 to 1e6")
    return matrix


Pose = Annotated[tuple[_Row4, _Row4, _Row4, _Row4], expect("4 rows of 4 numbers"), AfterValidator(_check_pose)]
Focal = Annotated[Number, Field(ge=1 / _MAX_PIXELS, le=_MAX_PIXELS), expect("a number from 1e-6 to 1e6")]
Pixels = Annotated[Number, Field(ge=-_MAX_PIXELS, le=_MAX_PIXELS), expect("a number from -1e6 to 1e6")]
Calibration = Annotated[tuple[_Row3, _Row3, _Row3], expect("3 rows of 3 numbers"), AfterValidator(_check_calibration)]


class Intrinsics(Model):
    """A pinhole's calibration in pixels; exactly one of `K` and `fx`. It goes with the film's shape, not its size."""

    K: Calibration | None = Field(None, description="[[fx, 0, cx], [0, fy, cy], [0, 0, 1]].")
    fx: Focal | None = Field(None, description="Focal length in pixel widths.")
    fy: Focal | None = Field(None, description="Focal length in pixel heights; null: fx.")
    cx: Pixels | None = Field(
        None,
        description="The optical axis, from the picture's left edge, where OpenCV counts from the first pixel's "
        "centre and so has 0.5 less; null: in the middle.",
    )
    cy: Pixels | None = Field(None, description="The optical axis, from the picture's upper edge; null: in the middle.")
    size: Resolution | None = Field(
        None, description="Width and height of the picture that these pixels belong to; null: the film's resolution."
    )

    @model_validator(mode="after")
    def _check_form(self) -> Intrinsics:
        if (self.K is None) == (self.fx is None):
            raise sentence(f'expected either "K" or "fx", found {"neither" if self.K is None else "both"}')
        if self.K is not None and self.model_fields_set & {"fy", "cx", "cy"}:
            raise sentence('expected no "fy", "cx" or "cy" beside "K"')
        return self


class Camera(Model):
    """A pinhole camera. It stands by `position` and `look_at` or by `matrix`, and projects by `fov` or `intrinsics`."""

    position: Vec3 = Field((0.0, 0.0, 1.0), description="Where the camera is.")
    look_at: Vec3 = Field(
        (0.0, 0.0, 0.0), description="The point in the centre of the picture, not the camera's position."
    )
    ref_up: Vec3 = Field((0.0, 1.0, 0.0), description="The direction that is up in the picture, not that of the view.")
    fov: Angle = Field(45.0, description="Full vertical angle of view in degrees.")
    focal_length: Positive = Field(1.0, description="Read and not used: a pinhole has none.")
    matrix: Pose | None = Field(
        None, description="Camera to world, 4 rows for column vectors: a rotation and the camera's position."
    )
    convention: Annotated[Literal["opengl", "opencv", "blender"], expect('"opengl", "opencv" or "blender"')] | None = (
        Field(
            None,
            description="The axes of `matrix`. opengl: +x right, +y up, looks along -z. opencv: +x right, +y down, "
            "looks along +z. blender: as opengl, in a world whose z is up, which is turned so that y is.",
        )
    )
    intrinsics: Intrinsics | None = Field(None, description="The projection by a calibrated camera's numbers.")

    @model_validator(mode="after")
    def _check_one_form(self) -> Camera:
        beside = [name for name in ("position", "look_at", "ref_up") if name in self.model_fields_set]
        if self.matrix is not None and beside:
            raise sentence(f'expected either "matrix" or "{beside[0]}", found both')
        if (self.matrix is None) != (self.convention is None):
            found, missing = ("matrix", "convention") if self.convention is None else ("convention", "matrix")
            raise sentence(f'"{found}" needs "{missing}" beside it')
        if self.intrinsics is not None and "fov" in self.model_fields_set:
            raise sentence('expected either "intrinsics" or "fov", found both')
        return self
