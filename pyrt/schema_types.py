"""The types of numbers, vectors and names in a scene file.

Each states in words what it expects, so that an error can say `expected a number > 0, got "two"`.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Annotated, Any

import numpy as np
from pydantic import (
    AfterValidator,
    BaseModel,
    ConfigDict,
    Field,
    ValidationError,
    ValidatorFunctionWrapHandler,
    WrapValidator,
)
from pydantic_core import PydanticCustomError

_MAX_SIDE = 65536
_MAX_PIXELS = 2**28


class Model(BaseModel):
    """Base of all models: unknown keys are errors, and defaults are checked like given values."""

    model_config = ConfigDict(extra="forbid", frozen=True, validate_default=True)


def expect(what: str) -> WrapValidator:
    """Replaces every error inside a value by `unexpected(what)` for the value as a whole."""

    def check(value: Any, handler: ValidatorFunctionWrapHandler) -> Any:
        try:
            return handler(value)
        except ValidationError:
            raise unexpected(what) from None

    return WrapValidator(check)


def unexpected(what: str) -> PydanticCustomError:
    """The error `expected {what}, got ...`."""
    return PydanticCustomError("expected", what)


def sentence(text: str) -> PydanticCustomError:
    """An error with a text of its own."""
    return PydanticCustomError("sentence", text)


def _check_pixels(resolution: tuple[int, int]) -> tuple[int, int]:
    if resolution[0] * resolution[1] > _MAX_PIXELS:
        raise ValueError
    return resolution


def _check_affine(matrix: tuple[float, ...]) -> tuple[float, ...]:
    if matrix[12:] != (0.0, 0.0, 0.0, 1.0):
        raise unexpected("16 numbers, row-major, of which the last row is 0, 0, 0, 1")
    if np.linalg.matrix_rank(np.reshape(matrix, (4, 4))[:3, :3]) < 3:
        raise unexpected("an invertible matrix, not a singular one")
    return matrix


def sine(a: Sequence[float], b: Sequence[float]) -> float:
    """Sine of the angle between two vectors; 0 if one of them is zero."""
    length_a, length_b = math.hypot(*a), math.hypot(*b)
    if length_a == 0 or length_b == 0:
        return 0.0
    (ax, ay, az), (bx, by, bz) = ([x / length_a for x in a], [x / length_b for x in b])
    return math.hypot(ay * bz - az * by, az * bx - ax * bz, ax * by - ay * bx)


# far inside the range of double, so that squares and cubes of what a scene holds are finite too
Number = Annotated[float, Field(strict=True, allow_inf_nan=False, ge=-1e30, le=1e30)]
_NonNegative = Annotated[Number, Field(ge=0)]
_Unit = Annotated[Number, Field(ge=0, le=1)]
_Side = Annotated[int, Field(strict=True, ge=1, le=_MAX_SIDE)]

Name = Annotated[str, Field(min_length=1, max_length=1024), expect("a string of 1 to 1024 characters")]
Flag = Annotated[bool, Field(strict=True), expect("true or false")]
Positive = Annotated[Number, Field(gt=0), expect("a number > 0")]
Fraction = Annotated[Number, Field(ge=0, lt=1), expect("a number >= 0 and < 1")]
Angle = Annotated[Number, Field(gt=0, lt=180), expect("an angle in degrees between 0 and 180")]
Samples = Annotated[int, Field(strict=True, ge=1, le=2**30), expect("an integer from 1 to 2^30")]
Depth = Annotated[int, Field(strict=True, ge=0, le=1024), expect("an integer from 0 to 1024")]
Vec2 = Annotated[tuple[Number, Number], expect("2 numbers from -1e30 to 1e30")]
Vec3 = Annotated[tuple[Number, Number, Number], expect("3 numbers from -1e30 to 1e30")]
Reflectance = Annotated[tuple[_Unit, _Unit, _Unit], expect("3 numbers from 0 to 1")]
Power = Annotated[tuple[_NonNegative, _NonNegative, _NonNegative], expect("3 numbers from 0 to 1e30")]
Resolution = Annotated[
    tuple[_Side, _Side],
    AfterValidator(_check_pixels),
    expect("width and height, 2 integers from 1 to 65536 with at most 2^28 pixels in all"),
]
Matrix = Annotated[
    tuple[Number, ...],
    Field(min_length=16, max_length=16),
    expect("16 numbers, row-major"),
    AfterValidator(_check_affine),
]
