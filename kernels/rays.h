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

/* Of a packet. If all its rays are plain, vectors hold their frames; else `each` does. */
typedef struct {
    RayFrame each[PACKET];
    bool plain;
#if HAS_DOUBLE && PACKET > 1
    long4 exponent[2];
#endif
} RayFrames;

#if HAS_DOUBLE && PACKET > 1

#define PLAIN_EXPONENT 500L /* up to here any power of two that is needed is one normal number */

INLINE long4 magnitude4(double4 a) { return as_long4(a) & (long)MAGNITUDE; }
INLINE long4 larger4(long4 a, long4 b) { return a > b ? a : b; }
INLINE long4 largest4(double4 x, double4 y, double4 z) { return larger4(magnitude4(x), larger4(magnitude4(y), magnitude4(z))); }
INLINE double4 power4(long4 n) { return as_double4((n + 1023L) << 52); }
INLINE double4 every_third(const global double *p) { return (double4)(p[0], p[3], p[6], p[9]); }

/* Four rays. A double8 is as wide as the float16 that crashes PoCL's compiler. */
typedef struct {
    float4 ox, oy, oz, dx, dy, dz, t_max;
} Quad;

/* As ray_load for rays `first` to first + 3. Returns false if one is far away, invalid, or of a length that takes several
 * powers of two. */
INLINE bool quad_load(constant double *space, const global double *origins, const global double *directions,
                      const global double *limits, uint stride, uint first, Quad *quad, long4 *exponent)
{
    const global double *o = origins + 3 * (size_t)first, *d = directions + 3 * (size_t)first;
    const global double *t = limits + (size_t)first * stride;
    double4 dx = every_third(d), dy = every_third(d + 1), dz = every_third(d + 2);
    double4 ox = (every_third(o) - space[0]) * space[3];
    double4 oy = (every_third(o + 1) - space[1]) * space[3];
    double4 oz = (every_third(o + 2) - space[2]) * space[3];
    double4 limit = stride ? (double4)(t[0], t[1], t[2], t[3]) : (double4)(t[0]);
    long4 shift = (largest4(dx, dy, dz) >> 52) - 1022L, farthest = largest4(ox, oy, oz);
    long scale = exponent_of(as_ulong(space[3]));
    long4 plain = (shift >= -PLAIN_EXPONENT) & (shift <= PLAIN_EXPONENT) & (farthest <= as_long(4.0)) & (limit == limit);
    if (!(plain.x & plain.y & plain.z & plain.w) || scale < -PLAIN_EXPONENT || scale > PLAIN_EXPONENT)
        return false;
    *exponent = shift + (scale - 1L);
    double4 unit = power4(-shift);
    limit *= power4(*exponent);
    quad->ox = CONVERT(ox, float4);
    quad->oy = CONVERT(oy, float4);
    quad->oz = CONVERT(oz, float4);
    quad->dx = CONVERT(dx * unit, float4);
    quad->dy = CONVERT(dy * unit, float4);
    quad->dz = CONVERT(dz * unit, float4);
    quad->t_max = CONVERT(limit > 0.0 ? limit : (double4)(0.0), float4);
    return true;
}

INLINE bool rays_load_plain(constant double *space, const global double *origins, const global double *directions,
                            const global double *limits, uint stride, uint first, Rays *rays, RayFrames *frames)
{
    Quad a, b;
    if (!quad_load(space, origins, directions, limits, stride, first, &a, &frames->exponent[0]) ||
        !quad_load(space, origins, directions, limits, stride, first + 4u, &b, &frames->exponent[1]))
        return false;
    Vec o = {(float8)(a.ox, b.ox), (float8)(a.oy, b.oy), (float8)(a.oz, b.oz)};
    Vec d = {(float8)(a.dx, b.dx), (float8)(a.dy, b.dy), (float8)(a.dz, b.dz)};
    rays->o = o;
    rays->d = d;
    rays->t_max = (float8)(a.t_max, b.t_max);
    return true;
}

#endif

/* Loads rays `first` to first + PACKET - 1, or to the last; returns the lanes of those that are valid, and counts the others. */
NO_INLINE uint rays_load(constant real *space, const global real *origins, const global real *directions,
                      const global real *limits, uint stride, uint first, uint count, Rays *rays, RayFrames *frames,
                      global uint *invalid)
{
    uint lanes = 0u, asked = 0u;
    rays->self = (Int)(-1);
    rays->light_first = (Int)(0);
    rays->light_count = 0u;
#if HAS_DOUBLE && PACKET > 1
    frames->plain = first + PACKET <= count &&
                    rays_load_plain(space, origins, directions, limits, stride, first, rays, frames);
    if (frames->plain)
        return ALL_LANES;
#endif
    rays->o = rays->d = vec_of(0.0f, 0.0f, 0.0f);
    rays->t_max = (Real)(0.0f);
    for (uint lane = 0u; lane < PACKET && first + lane < count; ++lane, ++asked) {
        Ray ray;
        if (!ray_load(space, origins, directions, limits, stride, first + lane, &ray, &frames->each[lane]))
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

/* Stores the distances of the lanes in `found`, and infinity for the others. */
INLINE void rays_store_distances(const RayFrames *frames, const Real *t, uint found, uint first, uint count, global real *out)
{
#if HAS_DOUBLE && PACKET > 1
    if (frames->plain) {
        double4 far[2] = {CONVERT((*t).lo, double4) * power4(-frames->exponent[0]),
                          CONVERT((*t).hi, double4) * power4(-frames->exponent[1])};
        for (uint lane = 0u; lane < PACKET; ++lane)
            out[first + lane] = found >> lane & 1u ? ((const double *)far)[lane] : (double)INFINITY;
        return;
    }
#endif
    for (uint lane = 0u; lane < PACKET && first + lane < count; ++lane)
        out[first + lane] = found >> lane & 1u ? ray_distance(&frames->each[lane], real_lane(t, lane)) : (real)INFINITY;
}

#endif
