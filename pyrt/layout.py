"""Where the kernels are, the numpy dtypes and constants that `kernels/types.h` defines, and arrays of these.

The header is the only definition; the OpenCL compiler reads the same file.
"""

from __future__ import annotations

import re
from functools import lru_cache
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

_CACHE_LINE = 64  # bytes
_SCALARS = {"float": np.float32, "int": np.int32, "uint": np.uint32}


def kernel_dir() -> Path:
    """The folder of the kernels: inside an installed package, or beside it in a checkout."""
    package = Path(__file__).resolve().parent
    inside = package / "kernels"
    return inside if inside.is_dir() else package.parent / "kernels"


@lru_cache(maxsize=1)
def _header() -> str:
    text = (kernel_dir() / "types.h").read_text(encoding="utf-8")
    return re.sub(r"/\*.*?\*/", "", text, flags=re.DOTALL)


@lru_cache(maxsize=1)
def constants() -> dict[str, int]:
    """Every `#define NAME integer` of types.h."""
    return {name: int(value) for name, value in re.findall(r"#define (\w+) (-?\d+)\s*$", _header(), re.MULTILINE)}


@lru_cache(maxsize=1)
def dtypes() -> dict[str, np.dtype]:
    """Every struct of types.h as a numpy dtype without padding, by name."""
    structs: dict[str, np.dtype] = {}
    for body, name in re.findall(r"typedef struct \{(.*?)\} (\w+);", _header(), re.DOTALL):
        members = re.findall(r"(\w+) (\w+)((?:\[\w+\])*);", body)
        structs[name] = np.dtype(
            [(field, structs.get(kind) or _SCALARS[kind], _shape(dims)) for kind, field, dims in members]
        )
    return structs


def _shape(dims: str) -> tuple[int, ...]:
    return tuple(int(size) if size.isdigit() else constants()[size] for size in re.findall(r"\[(\w+)\]", dims))


def aligned_empty(count: int, dtype: Any) -> NDArray[Any]:
    """(count,) from a cache line on, as devices want memory that they share with the host."""
    size = count * np.dtype(dtype).itemsize
    memory = np.empty(size + _CACHE_LINE, np.uint8)
    first = -memory.ctypes.data % _CACHE_LINE
    return memory[first : first + size].view(dtype)


def is_aligned(array: NDArray[Any]) -> bool:
    """Whether it begins on a cache line."""
    return array.ctypes.data % _CACHE_LINE == 0
