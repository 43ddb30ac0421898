/* The caller's rays in float64, normalised as the scene is; and the caller's t of what they hit.
 *
 * pyrt/rays.py says and does the same in numpy, bit for bit, for devices without doubles: there `real` is float, and rays
 * arrive normalised. A direction is scaled by a power of two to a largest component in [1/2, 1). An origin far outside moves
 * along its ray to the scene's box, so that float32 need not hold the distance.
 */
#ifndef PYRT_RAYS_H
#define PYRT_RAYS_H

#include "scene.h"

#ifndef HAS_DOUBLE
#define HAS_DOUBLE 0
#endif

/* The caller's t is (t + advance) 2^-exponent. */
#if HAS_DOUBLE

typedef double real;

typedef struct {
    double advance;
    int exponent;
} RayFrame;

#define MAGNITUDE 0x7fffffffffffffffUL
#define INFINITE_BITS 0x7ff0000000000000UL

INLINE ulong magnitude_bits(double a) { return as_ulong(a) & MAGNITUDE; }

/* Of the component farthest from 0. Above INFINITE_BITS: NaN. */
INLINE ulong largest_bits(double3 a)
{
    ulong x = magnitude_bits(a.x), y = magnitude_bits(a.y), z = magnitude_bits(a.z);
    ulong larger = x > y ? x : y;
    return larger > z ? larger : z;
}

/* The e of a = m 2^e with m in [1/2, 1), for the bits of a finite a > 0. */
INLINE int exponent_of(ulong bits)
{
    return bits >> 52 ? (int)(bits >> 52) - 1022 : (int)(as_ulong(as_double(bits) * 0x1p64) >> 52) - 1022 - 64;
}

/* a 2^n, rounded once: on the way down, steps keep 53 bits clear of the subnormal numbers. */
INLINE double times_power(double a, int n)
{
    for (int i = 0; i < 3 && n > 1023; ++i, n -= 1023)
        a *= 0x1p1023;
    for (int i = 0; i < 3 && n < -1022; ++i, n += 969)
        a *= 0x1p-969;
    n = n > 1023 ? 1023 : n < -1022 ? -1022 : n;
    return a * as_double((ulong)(n + 1023) << 52);
}

INLINE double3 load_point(const global double *points, size_t i)
{
    return (double3)(points[3 * i], points[3 * i + 1], points[3 * i + 2]);
}

/* How far along the axis the ray enters the box around the scene, which is 1.25 times as large. */
INLINE double axis_entry(double o, double d, double bound)
{
    double wall = 1.25 * (bound > 0.5 ? bound : 0.5);
    return d == 0.0 ? -INFINITY : -((d < 0.0 ? -wall : wall) + o) / d;
}

INLINE double advance_to_box(double3 o, double3 d, constant double *bound)
{
    double farthest = as_double(largest_bits(o));
    if (farthest <= 4.0)
        return 0.0;
    double x = axis_entry(o.x, d.x, bound[0]), y = axis_entry(o.y, d.y, bound[1]), z = axis_entry(o.z, d.z, bound[2]);
    double entry = x > y ? x : y;
    entry = entry > z ? entry : z;
    entry = entry > 0.0 ? entry : 0.0;
    return entry < 4.0 * farthest ? entry : 4.0 * farthest;
}

/* False for a ray that is not finite or has no direction. space: centre (3), scale, bound of the scene (3); limits: t_max
 * of every ray, or with stride 0 of all. */
NO_INLINE bool ray_load(constant double *space, const global double *origins, const global double *directions,
                        const global double *limits, uint stride, uint i, Ray *ray, RayFrame *frame)
{
    double3 o = load_point(origins, i), d = load_point(directions, i);
    double limit = limits[(size_t)i * stride];
    ulong largest = largest_bits(d);
    if (largest == 0UL || largest >= INFINITE_BITS || largest_bits(o) >= INFINITE_BITS || limit != limit)
        return false;
    int shift = exponent_of(largest);
    d = (double3)(times_power(d.x, -shift), times_power(d.y, -shift), times_power(d.z, -shift));
    o = (o - (double3)(space[0], space[1], space[2])) * space[3];
    frame->exponent = shift + exponent_of(as_ulong(space[3])) - 1;
    frame->advance = advance_to_box(o, d, space + 4);
    o = o + frame->advance * d;
    limit = times_power(limit, frame->exponent) - frame->advance;
    *ray = ray_make((float3)((float)o.x, (float)o.y, (float)o.z), (float3)((float)d.x, (float)d.y, (float)d.z),
                    (float)(limit > 0.0 ? limit : 0.0), -1);
    return true;
}

INLINE double ray_distance(const RayFrame *frame, float t)
{
    return times_power((double)t + frame->advance, -frame->exponent);
}

#else

typedef float real;

typedef struct {
    int unused;
} RayFrame;

INLINE bool ray_load(constant float *space, const global float *origins, const global float *directions,
                     const global float *limits, uint stride, uint i, Ray *ray, RayFrame *frame)
{
    *ray = ray_make(load3(origins + 3 * (size_t)i), load3(directions + 3 * (size_t)i), limits[(size_t)i * stride], -1);
    return true;
}

INLINE float ray_distance(const RayFrame *frame, float t) { return t; }

#endif

/* Loads rays `first` to first + PACKET - 1, or to the last; returns the lanes of those that are valid, and counts the others. */
INLINE uint rays_load(constant real *space, const global real *origins, const global real *directions,
                      const global real *limits, uint stride, uint first, uint count, Rays *rays, RayFrame *frames,
                      global uint *invalid)
{
    uint lanes = 0u, asked = 0u;
    rays->o = rays->d = vec_of(0.0f, 0.0f, 0.0f);
    rays->t_max = (Real)(0.0f);
    for (uint lane = 0u; lane < PACKET && first + lane < count; ++lane, ++asked) {
        Ray ray;
        if (!ray_load(space, origins, directions, limits, stride, first + lane, &ray, &frames[lane]))
            continue;
        lanes |= 1u << lane;
        vec_set(&rays->o, lane, ray.o);
        vec_set(&rays->d, lane, ray.d);
        real_set(&rays->t_max, lane, ray.t_max);
    }
    if (popcount(lanes) < asked)
        atomic_add(invalid, asked - popcount(lanes));
    return lanes;
}

#endif
