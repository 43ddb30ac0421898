"""Paint the example textures: `python textures/make_textures.py [DIRECTORY]`, by default beside this script.

Every image is a function of noise that is periodic in the unit square, so it tiles without a seam. (u, v) = (0, 0) is
the upper left corner. Colours are sRGB in [0, 1], written as 8-bit PNG. Arrays of colours are (height, width, 3).
"""

from __future__ import annotations

import sys
from collections.abc import Callable
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]
Color = tuple[float, float, float]


def grid(size: int) -> tuple[Array, Array]:
    """Return u and v at the texel centres, each (size, size)."""
    centres = (np.arange(size) + 0.5) / size
    u, v = np.meshgrid(centres, centres)
    return u, v


def smoothstep(low: Array | float, high: Array | float, x: Array) -> Array:
    t: Array = np.clip((x - low) / (high - low), 0.0, 1.0)
    return t * t * (3.0 - 2.0 * t)


def mix(a: Array | Color, b: Array | Color, t: Array) -> Array:
    """Interpolate between two colours by `t`, one number for each texel."""
    return np.add(a, t[..., None] * np.subtract(b, a))


def hashed(index: NDArray[np.int_], count: int, seed: int) -> Array:
    """Return one random number in [0, 1) for each index in [0, count)."""
    return np.random.default_rng(seed).random(count)[index]


def noise(u: Array, v: Array, cells: tuple[int, int], seed: int) -> Array:
    """Perlin's gradient noise, about [-1, 1], period 1 in u and v, with `cells` lattice cells in a period."""
    nu, nv = cells
    angle = 2.0 * np.pi * np.random.default_rng(seed).random(nv * nu)
    gradient_x, gradient_y = np.cos(angle), np.sin(angle)
    x, y = u * nu, v * nv
    i, j = np.floor(x), np.floor(y)
    x, y = x - i, y - j
    columns = [(i.astype(np.int32) + k) % nu for k in (0, 1)]
    rows = [(j.astype(np.int32) + k) % nv * nu for k in (0, 1)]

    def corner(di: int, dj: int) -> Array:
        at = rows[dj] + columns[di]
        return np.asarray(gradient_x[at] * (x - di) + gradient_y[at] * (y - dj))

    fade_x, fade_y = (t * t * t * (t * (6.0 * t - 15.0) + 10.0) for t in (x, y))
    top = corner(0, 0) + fade_x * (corner(1, 0) - corner(0, 0))
    bottom = corner(0, 1) + fade_x * (corner(1, 1) - corner(0, 1))
    return np.asarray(1.5 * (top + fade_y * (bottom - top)))


def fractal(u: Array, v: Array, cells: tuple[int, int], octaves: int, seed: int) -> Array:
    """Sum octaves of noise, each of twice the frequency and half the amplitude, to about [-1, 1]."""
    layers = [noise(u, v, (cells[0] << k, cells[1] << k), seed + k) * 0.5**k for k in range(octaves)]
    total: Array = np.sum(layers, axis=0)
    return total / (2.0 - 0.5 ** (octaves - 1))


def wood(size: int) -> Array:
    """Oak boards along u, each cut from its own log: year rings about an axis that wanders through the board."""
    u, v = grid(size)
    rows = 6
    board = np.floor(v * rows).astype(int)
    across = v * rows - board
    along = (u - 0.39 * board - 0.2 * hashed(board, rows, 1)) % 1.0

    x, y = u + hashed(board, rows, 2), v + hashed(board, rows, 3)  # each board sees another part of the noise
    heart = 2.2 * hashed(board, rows, 4) - 0.6  # where in the board's width the log's axis lies
    lean = 1.6 * (hashed(board, rows, 5) - 0.5)  # the axis rises or sinks along the board, which opens the rings
    depth = 0.75 + lean * (along - 0.5) + 0.16 * noise(x, 0.1 * board, (4, 17), 6)
    bend = 0.10 * noise(x, y, (3, 12), 7) + 0.04 * fractal(x, y, (9, 48), 2, 8)
    rings = 11.0 * np.hypot(across - heart + bend, depth)
    year = (rings + 0.10 * noise(x, y, (20, 128), 9)) % 1.0
    late = smoothstep(0.25, 0.92, year) * (1.0 - smoothstep(0.92, 1.0, year))

    fibres = noise(x, y, (14, 200), 10)
    pores = smoothstep(0.35, 0.7, noise(x, y, (22, 230), 11)) * (0.4 + 0.6 * late)
    color = mix((0.76, 0.575, 0.385), (0.58, 0.385, 0.22), np.clip(0.75 * late + 0.2 * fibres, 0, 1))
    color = mix(color, (0.33, 0.19, 0.10), 0.45 * pores)
    tone = 0.82 + 0.28 * hashed(board, rows, 12) + 0.06 * fractal(x, y, (3, 9), 3, 13)
    tint = 0.07 * (hashed(board, rows, 14) - 0.5)
    color = color * np.stack([tone + tint, tone, tone - 2.0 * tint], axis=-1)

    edge = np.minimum(np.minimum(across, 1.0 - across) / rows, np.minimum(along, 1.0 - along)) * size
    return mix((0.14, 0.08, 0.045), color, smoothstep(0.2, 1.6, edge))


def marble(size: int) -> Array:
    """White marble: veins run where warped noise crosses zero, some broad and faint, some thin and dark."""
    u, v = grid(size)
    du, dv = (0.07 * fractal(u, v, (4, 4), 6, seed) for seed in (20, 30))
    s, t = u + v + du, v - u + dv  # veins lean, and a period of (u, v) is one of (s, t)
    cloud = fractal(u + du, v + dv, (3, 3), 6, 40)
    veil = fractal(u - dv, v + du, (2, 2), 4, 50)
    broad = np.exp(-np.abs(fractal(s, t, (1, 3), 5, 60)) / 0.06)
    thin = np.exp(-np.abs(fractal(s + du, t - dv, (2, 4), 4, 70)) / 0.014)
    color = mix((0.935, 0.93, 0.915), (0.79, 0.795, 0.80), smoothstep(-0.25, 0.7, cloud))
    color = mix(color, (0.55, 0.565, 0.59), 0.6 * broad * smoothstep(-0.4, 0.4, veil))
    return mix(color, (0.33, 0.34, 0.37), 0.65 * thin * smoothstep(-0.2, 0.4, -veil))


def tiles(size: int, count: int, joint: float, seed: int) -> tuple[Array, NDArray[np.int_], Array]:
    """Lay `count` rows of `count` square tiles with uneven edges.

    Returns their cover in [0, 1], the tile's index, and a bevel's brightness in [-1, 1], lit from the upper left.
    """
    u, v = grid(size)
    x = (u + 0.004 * fractal(u, v, (12, 12), 3, seed)) * count
    y = (v + 0.004 * fractal(u, v, (12, 12), 3, seed + 9)) * count
    i, j = np.floor(x).astype(int), np.floor(y).astype(int)
    p, q = x - i - 0.5, y - j - 0.5
    edge = 0.5 - (np.abs(p) ** 8 + np.abs(q) ** 8) ** 0.125
    bevel = sum(smoothstep(0.36, 0.5, -x) - smoothstep(0.36, 0.5, x) for x in (p, q)) / 2.0
    return smoothstep(joint, joint + 0.02, edge), (j % count) * count + i % count, np.asarray(bevel)


def terracotta(size: int) -> Array:
    """Burnt clay tiles, matt and mottled, in pale grout."""
    u, v = grid(size)
    cover, tile, bevel = tiles(size, 4, 0.022, 100)
    tone = hashed(tile, 16, 110)
    mottle = fractal(u, v, (9, 9), 5, 120)
    clay = mix((0.77, 0.36, 0.23), (0.62, 0.235, 0.15), np.clip(0.15 + 0.7 * tone + 0.5 * mottle, 0, 1))
    clay = mix(clay, (0.84, 0.52, 0.36), 0.5 * smoothstep(0.25, 0.75, fractal(u, v, (6, 6), 4, 130)))
    clay = mix(clay, (0.30, 0.12, 0.08), 0.55 * smoothstep(0.62, 0.85, noise(u, v, (80, 80), 140)))
    clay = clay * (1.0 + 0.10 * bevel)[..., None]
    grout = mix((0.72, 0.66, 0.57), (0.58, 0.52, 0.44), 0.5 + 0.5 * fractal(u, v, (64, 64), 2, 150))
    return mix(grout, clay, cover)


def zellige(size: int) -> Array:
    """Hand-cut glazed tiles: each its own depth of green, the glaze pooling unevenly, the edges worn to the clay."""
    u, v = grid(size)
    cover, tile, bevel = tiles(size, 5, 0.012, 200)
    tone = hashed(tile, 25, 210)
    pool = fractal(u + 0.37 * tone, v + 0.61 * tone, (5, 5), 4, 220)
    depth = np.clip(0.12 + 0.75 * tone + 0.55 * pool, 0, 1)
    glaze = mix((0.42, 0.66, 0.47), (0.05, 0.31, 0.20), depth)
    glaze = glaze * (1.0 + 0.12 * bevel)[..., None]
    glaze = mix(glaze, (0.80, 0.72, 0.58), 0.8 * smoothstep(0.72, 0.85, noise(u, v, (64, 64), 230)) * tone)
    grout = mix((0.70, 0.67, 0.60), (0.55, 0.52, 0.46), 0.5 + 0.5 * fractal(u, v, (64, 64), 2, 240))
    return mix(grout, glaze, cover)


def plaster(size: int) -> Array:
    """Blue-green limewash over troweled plaster."""
    u, v = grid(size)
    du, dv = (0.06 * fractal(u, v, (4, 4), 3, seed) for seed in (300, 310))
    cloud = fractal(u + du, v + dv, (3, 3), 6, 320)
    strokes = fractal(u + 2 * du, v + 0.5 * dv, (6, 30), 3, 330) + fractal(u + 0.5 * du, v + 2 * dv, (30, 6), 3, 340)
    light = np.clip(0.5 + 0.65 * cloud + 0.16 * strokes + 0.05 * noise(u, v, (200, 200), 350), 0, 1)
    return mix((0.14, 0.30, 0.33), (0.33, 0.51, 0.52), light)


def brush(distance: Array, width: Array | float) -> Array:
    """Paint a stroke of half-width `width` around distance 0, darkest at its rims, where the ink settles."""
    t = np.abs(distance) / np.maximum(width, 1e-9)
    return (1.0 - smoothstep(0.85, 1.15, t)) * (0.55 + 0.45 * smoothstep(0.3, 0.95, t))


def porcelain(size: int) -> Array:
    """White porcelain painted in cobalt: u runs around a vase, v from its lip down; flowers on a winding stalk."""
    u, v = grid(size)
    wobble = 0.004 * fractal(u, v, (12, 12), 3, 400)
    y = v + wobble
    lines = ((0.075, 8), (0.10, 3), (0.275, 4), (0.30, 10), (0.775, 10), (0.80, 4), (0.965, 12))
    ink = [brush(y - at, width / 1000) for at, width in lines]

    flowers, middle = 6, 0.537
    turn = np.pi * flowers * u  # half a turn of the stalk for each flower
    off_stalk = y - middle + 0.105 * np.sin(turn)
    leaf = 0.017 * np.sin(np.pi * np.clip((4 * flowers * u) % 2.0, 0.0, 1.0)) ** 0.8
    outside = np.where(np.sin(2.0 * turn) > 0, 1.0, -1.0)
    ink += [brush(off_stalk, 0.0045), brush(off_stalk - leaf * outside, leaf)]

    column = np.floor(u * flowers)
    p = (u * flowers - column - 0.5) * 0.29  # in units of v where the vase is widest
    q = y - middle - 0.02 * (-1.0) ** column + wobble
    petals = 0.092 * (0.72 + 0.28 * np.abs(np.cos(2.5 * np.arctan2(q, p))) ** 0.7)
    radius = np.hypot(p, q)
    ink += [brush(radius - petals / 2 - 0.014, petals / 2 - 0.014), 1.0 - smoothstep(0.020, 0.024, radius)]

    for base, tip in ((0.92, 0.825), (0.16, 0.255)):
        reach = np.clip((y - tip) / (base - tip), 0.0, 1.0) * ((y - base) * (tip - base) > 0)
        ink.append(brush(np.abs((24 * u + 0.5) % 1.0 - 0.5), 0.4 * np.sqrt(reach)))

    shade = 0.85 + 0.25 * fractal(u, v, (10, 10), 4, 410)
    return mix((0.90, 0.905, 0.895), (0.07, 0.14, 0.46), np.clip(np.max(ink, axis=0) * shade, 0.0, 1.0))


IMAGES: dict[str, Callable[[int], Array]] = {
    "wood": wood,
    "marble": marble,
    "terracotta": terracotta,
    "zellige": zellige,
    "plaster": plaster,
    "porcelain": porcelain,
}


def write_png(path: Path, color: Array) -> None:
    import OpenImageIO as oiio

    size = color.shape[0]
    pixels = np.floor(np.clip(color, 0.0, 1.0) * 255.0 + 0.5).astype(np.uint8)
    image = oiio.ImageBuf(oiio.ImageSpec(size, size, 3, oiio.UINT8))
    if not (image.set_pixels(image.roi, pixels) and image.write(str(path))):
        raise OSError(f"{path}: {image.geterror()}")


def main(directory: Path) -> None:
    directory.mkdir(parents=True, exist_ok=True)
    for name, paint in IMAGES.items():
        write_png(directory / f"{name}.png", paint(512))


if __name__ == "__main__":
    main(Path(sys.argv[1]) if len(sys.argv) > 1 else Path(__file__).parent)
