"""Direct light by brute force in float64: the semantics of the scene format, written for clarity.

The light of polygons is exact where only triangles can hide it; otherwise, and for spheres, its points are stratified.
A dielectric follows both of its rays. Shading normals give cosines, geometric normals decide sides.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np

from pyrt.scene import (
    Camera,
    CheckerboardTexture,
    ConstantTexture,
    Diffuse,
    Rectangle,
    Refraction,
    Scene,
    Sphere,
    SpotLight,
    Texture,
)

from .analytic import Array, Indices, dot, fresnel, point_irradiance, refract, spot_irradiance, unit, visible_irradiance
from .geometry import Geometry, Hits, build, closest, occluded
from .statistics import Estimate

EXACT_TRIANGLES = 1000  # beyond, cutting each of them out of the lights costs more than sampling
NEGLIGIBLE = 1e-7  # split rays of less weight are dropped
RAYS = 4  # of each stratum: enough that the variance that they show can be trusted
CHUNK = 1 << 18  # shadow rays at a time


@dataclass(frozen=True)
class Rays:
    origin: Array  # (k, 3)
    direction: Array  # (k, 3), unit
    weight: Array  # (k,)
    owner: Indices  # (k,) the camera ray that each belongs to

    def __getitem__(self, chosen: Indices | slice) -> Rays:
        return Rays(self.origin[chosen], self.direction[chosen], self.weight[chosen], self.owner[chosen])


@dataclass(frozen=True)
class World:
    """What shading needs to know: the scene, its primitives, and how area lights are sampled."""

    scene: Scene
    geometry: Geometry
    material: Indices  # of each shape; -1: a black body
    light_subdivision: int
    rng: np.random.Generator


@dataclass(frozen=True)
class Receivers:
    """Lit points (n, 3); both normals are on the side that is seen."""

    points: Array
    normals: Array
    shading: Array


def reference_image(
    scene: Scene, size: tuple[int, int], subpixels: int = 4, light_subdivision: int = 6, seed: int = 0
) -> Estimate:
    """Estimate of the (height, width, 3) image: RAYS random rays in each of subpixels² strata of every pixel.

    Each ray takes light_subdivision² shadow rays to every light that is not exact. The variance is the strata's own,
    and room for one ray's worth of what shows in the neighbouring pixels but has been missed in this one.
    """
    width, height = size
    rng = np.random.default_rng(seed)
    strata = subpixels**2
    cell = np.stack(np.divmod(np.arange(strata), subpixels)[::-1], 1)
    jitter = (cell[:, None] + rng.random((height, width, strata, RAYS, 2))) / subpixels
    corner = np.stack(np.meshgrid(np.arange(width), np.arange(height)), 2)
    origins, directions = camera_rays(scene.camera, size, (corner[:, :, None, None] + jitter).reshape(-1, 2))
    values = radiance(scene, origins, directions, light_subdivision, rng).reshape(height, width, strata, RAYS, 3)
    missed = _contrast(values.min((2, 3)), values.max((2, 3))) / (RAYS * strata)
    return Estimate(values.mean((2, 3)), values.var(3, ddof=1).sum(2) / (RAYS * strata**2) + missed**2)


def _contrast(low: Array, high: Array) -> Array:
    """(height, width, 3) difference between the highest and the lowest value in each pixel's 3×3 neighbourhood."""
    low, high = (np.pad(values, ((1, 1), (1, 1), (0, 0)), mode="edge") for values in (low, high))
    low, high = (np.lib.stride_tricks.sliding_window_view(values, (3, 3), (0, 1)) for values in (low, high))
    return np.asarray(high.max((-2, -1)) - low.min((-2, -1)))


def camera_rays(camera: Camera, size: tuple[int, int], film: Array) -> tuple[Array, Array]:
    """Origins and unit directions (k, 3) through film positions (k, 2), in pixels from the upper-left corner."""
    width, height = size
    forward = unit(np.subtract(camera.look_at, camera.position))
    right = unit(np.cross(forward, camera.up))
    half = math.tan(math.radians(camera.fov) / 2)
    x = (2 * film[:, 0] - width) / height * half
    y = (1 - 2 * film[:, 1] / height) * half
    directions = unit(forward + x[:, None] * right + y[:, None] * np.cross(right, forward))
    return np.broadcast_to(np.array(camera.position, float), directions.shape), directions


def pixel_average(
    camera: Camera, size: tuple[int, int], function: Callable[[Array, Array], Array], order: int = 4
) -> Array:
    """(height, width, 3) average over each pixel of a smooth function of (origins, directions), by Gauss."""
    width, height = size
    nodes, weights = np.polynomial.legendre.leggauss(order)
    inside = np.stack(np.meshgrid(nodes, nodes), 2).reshape(-1, 2) / 2 + 0.5
    corner = np.stack(np.meshgrid(np.arange(width), np.arange(height)), 2)
    values = function(*camera_rays(camera, size, (corner[:, :, None] + inside).reshape(-1, 2)))
    values = values.reshape(height, width, order**2, 3)
    return np.asarray(np.einsum("hwnc,n->hwc", values, np.outer(weights, weights).ravel() / 4))


def radiance(
    scene: Scene, origins: Array, directions: Array, light_subdivision: int, rng: np.random.Generator
) -> Array:
    """(k, 3) radiance that comes back along each ray."""
    material = np.array([-1 if shape.material is None else shape.material for shape in scene.shapes])
    world = World(scene, build(scene), material, light_subdivision, rng)
    result = np.zeros((len(origins), 3))
    rays = Rays(origins, directions, np.ones(len(origins)), np.arange(len(origins)))
    for _ in range(scene.max_depth + 1):
        hits = closest(world.geometry, rays.origin, rays.direction)
        found = np.flatnonzero(hits.shape >= 0)
        rays, hits = rays[found], hits[found]
        light = _emitted(scene, rays, hits) + _reflected(world, rays, hits)
        np.add.at(result, rays.owner, rays.weight[:, None] * light)
        rays = _specular(world, rays, hits)
        if not len(rays.weight):
            break
    return result


def _emitted(scene: Scene, rays: Rays, hits: Hits) -> Array:
    table = np.array([shape.radiance or (0.0, 0.0, 0.0) for shape in scene.shapes])
    front = dot(rays.direction, hits.normal) < 0
    return np.where(front[:, None], table[hits.shape], 0.0)


def _reflected(world: World, rays: Rays, hits: Hits) -> Array:
    """(k, 3) light that diffuse surfaces send back; they are lit on the side that is seen."""
    result = np.zeros((len(hits.shape), 3))
    side = -np.sign(dot(rays.direction, hits.normal))
    for index, material in enumerate(world.scene.materials):
        if isinstance(material, Diffuse):
            lit = np.flatnonzero((world.material[hits.shape] == index) & ((side > 0) | material.twosided))
            normals = hits.normal[lit] * side[lit, None]
            shading = hits.shading[lit] * np.where(dot(hits.shading[lit], normals) < 0, -1.0, 1.0)[:, None]
            irradiance = _irradiance(world, Receivers(hits.point[lit], normals, shading))
            result[lit] = texture_color(world.scene.textures[material.texture], hits.uv[lit]) / np.pi * irradiance
    return result


def _specular(world: World, rays: Rays, hits: Hits) -> Rays:
    """The rays that go on from refractive surfaces; a dielectric sends on two."""
    rows = []
    for index, material in enumerate(world.scene.materials):
        if isinstance(material, Diffuse):
            continue
        struck = np.flatnonzero(world.material[hits.shape] == index)
        ray = rays[struck]
        normal = _specular_normals(ray.direction, hits.normal[struck], hits.shading[struck])
        entering = material.eta if isinstance(material, Refraction) else material.ext_ior / material.int_ior
        eta = np.where(dot(ray.direction, hits.normal[struck]) < 0, entering, 1 / entering)
        bent = replace(ray, origin=hits.point[struck], direction=unit(refract(ray.direction, normal, eta)))
        if isinstance(material, Refraction):
            rows.append(bent)
        else:
            reflectance = fresnel(dot(ray.direction, normal), eta)
            mirrored = ray.direction - 2 * dot(ray.direction, normal)[:, None] * normal
            rows.append(replace(bent, direction=unit(mirrored), weight=ray.weight * reflectance))
            rows.append(replace(bent, weight=ray.weight * (1 - reflectance) * eta**2))
    rows.append(rays[:0])
    joined = Rays(*(np.concatenate([getattr(row, name) for row in rows]) for name in Rays.__dataclass_fields__))
    return joined[np.flatnonzero(joined.weight > NEGLIGIBLE)]


def _specular_normals(directions: Array, normals: Array, shading: Array) -> Array:
    """Shading normals, on the geometric normals' side; geometric ones where those face away from the ray."""
    shading = shading * np.sign(dot(shading, normals))[:, None]
    usable = dot(directions, shading) * dot(directions, normals) > 0
    return np.where(usable[:, None], shading, normals)


# Light ----------------------------------------------------------------------------------------------------------------


def _irradiance(world: World, at: Receivers) -> Array:
    """(n, 3) irradiance from every light of the scene."""
    total = np.zeros_like(at.points)
    for light in world.scene.lights:
        ends = np.broadcast_to(np.array(light.position, float), at.points.shape)
        lit = (dot(ends - at.points, at.normals) > 0) & ~occluded(world.geometry, at.points, ends)
        if isinstance(light, SpotLight):
            arriving = spot_irradiance(at.points, at.shading, light)
        else:
            arriving = point_irradiance(at.points, at.shading, light.position, light.flux)
        total += lit[:, None] * arriving
    for index, shape in enumerate(world.scene.shapes):
        if shape.radiance is not None:
            total += _area_irradiance(world, at, index)[:, None] * np.array(shape.radiance)
    return total


def _area_irradiance(world: World, at: Receivers, index: int) -> Array:
    """(n,) irradiance of one emitting shape, for radiance 1."""
    shape, geometry = world.scene.shapes[index], world.geometry
    if isinstance(shape, Sphere):
        return _sampled_sphere(world, at, shape)
    emitting = geometry.triangles[geometry.shape[: len(geometry.triangles)] == index]
    if len(geometry.radii) or len(geometry.triangles) > EXACT_TRIANGLES:
        return np.asarray(np.sum([_sampled_triangle(world, at, triangle) for triangle in emitting], axis=0))
    polygons = [np.append(emitting[0], emitting[1, 2:], 0)] if isinstance(shape, Rectangle) else emitting
    exact = (visible_irradiance(at.points, at.normals, p, geometry.triangles, at.shading) for p in polygons)
    return np.asarray(np.sum(list(exact), axis=0))


def _strata(world: World, count: int) -> Array:
    """(count, subdivision², 2) one random point in each cell of a square grid on the unit square."""
    cells = world.light_subdivision**2
    grid = np.stack(np.divmod(np.arange(cells), world.light_subdivision), 1)
    return (grid + world.rng.random((count, cells, 2))) / world.light_subdivision


def _sampled_triangle(world: World, at: Receivers, triangle: Array) -> Array:
    """(n,) irradiance of a triangle of radiance 1 from uniformly distributed points on it."""
    u, v = np.moveaxis(_strata(world, len(at.points))[..., None], 2, 0)
    root = np.sqrt(u)
    targets = triangle[0] * (1 - root) + root * (triangle[1] * (1 - v) + triangle[2] * v)
    to_light = targets - at.points[:, None]
    cross = np.cross(triangle[1] - triangle[0], triangle[2] - triangle[0])
    weight = np.maximum(-to_light @ cross / 2, 0) / dot(to_light, to_light) ** 2
    return _visible_mean(world, at, targets, weight * _cosine(at, to_light))


def _sampled_sphere(world: World, at: Receivers, sphere: Sphere) -> Array:
    """(n,) irradiance of a sphere of radiance 1 from directions uniform in the cone that it fills."""
    to_center = np.array(sphere.center) - at.points
    d2 = dot(to_center, to_center)
    cone = 1 - np.sqrt(np.maximum(1 - sphere.radius**2 / d2, 0))[:, None]
    u, v = np.moveaxis(_strata(world, len(at.points)), 2, 0)
    cosine, angle = 1 - u * cone, 2 * np.pi * v
    axis = unit(to_center)
    side = unit(np.cross(axis, np.eye(3)[np.argmin(np.abs(axis), axis=1)]))
    ring = np.cos(angle)[..., None] * side[:, None] + np.sin(angle)[..., None] * np.cross(axis, side)[:, None]
    directions = cosine[..., None] * axis[:, None] + np.sqrt(1 - cosine**2)[..., None] * ring
    along = dot(directions, to_center[:, None])
    reach = along - np.sqrt(np.maximum(sphere.radius**2 - d2[:, None] + along**2, 0))
    weight = 2 * np.pi * cone * _cosine(at, directions) * (d2 > sphere.radius**2)[:, None]
    return _visible_mean(world, at, at.points[:, None] + reach[..., None] * directions, weight)


def _cosine(at: Receivers, directions: Array) -> Array:
    """(n, m) cosine at the receiver times the length of directions (n, m, 3); 0 below either horizon."""
    cosine = np.maximum(dot(directions, at.shading[:, None]), 0)
    return np.where(dot(directions, at.normals[:, None]) > 0, cosine, 0.0)


def _visible_mean(world: World, at: Receivers, targets: Array, weight: Array) -> Array:
    """(n,) mean of the weights (n, m) of those targets (n, m, 3) that the points see."""
    wanted = np.flatnonzero(weight.ravel() > 0)
    visible = np.zeros(weight.size)
    for part in np.array_split(wanted, len(wanted) // CHUNK + 1):
        visible[part] = ~occluded(world.geometry, at.points[part // weight.shape[1]], targets.reshape(-1, 3)[part])
    return np.asarray((weight * visible.reshape(weight.shape)).mean(1))


# Textures -------------------------------------------------------------------------------------------------------------


def texture_color(texture: Texture, uv: Array) -> Array:
    """(n, 3) linear colour of a texture at texture coordinates (n, 2)."""
    if isinstance(texture, ConstantTexture):
        return np.broadcast_to(np.array(texture.color, float), (len(uv), 3))
    st = uv * texture.scale + texture.delta
    if isinstance(texture, CheckerboardTexture):
        odd = np.floor(2 * st).sum(1) % 2 == 1
        return np.where(odd[:, None], texture.color1, texture.color0)
    height, width = texture.pixels.shape[:2]
    place = st * (width, height) - 0.5
    low = np.floor(place).astype(int)
    fx, fy = (place - low).T[..., None]
    x, y = low.T
    texel = [[texture.pixels[(y + dy) % height, (x + dx) % width] for dx in (0, 1)] for dy in (0, 1)]
    top, bottom = ((1 - fx) * left + fx * right for left, right in texel)
    return np.asarray((1 - fy) * top + fy * bottom)
