/* Small vectors and the floating-point rules that every kernel keeps.
 *
 * Contraction is off: a product and a sum fuse only where `fma` is written, so that the same expression gives the same
 * bits wherever it is inlined. The watertight triangle test depends on it.
 */
#ifndef PYRT_MATH_H
#define PYRT_MATH_H

#include "simd.h"
#include "types.h"

#define PI 3.14159265358979323846f
#define INV_PI 0.31830988618379067154f
#define ULP 5.9604644775390625e-8f /* 2^-24, half the spacing of the floats in [1, 2) */

INLINE float3 load3(const global float *p)
{
    return (float3)(p[0], p[1], p[2]);
}

INLINE OVERLOADED float lerp1(float a, float b, float t)
{
    return fma1(t, b - a, a);
}

INLINE float3 lerp3(float3 a, float3 b, float t)
{
    return a + (b - a) * t;
}

INLINE OVERLOADED float3 add3(float3 a, float3 b) { return a + b; }
INLINE OVERLOADED float3 sub3(float3 a, float3 b) { return a - b; }
INLINE OVERLOADED float3 neg3(float3 a) { return -a; }
INLINE OVERLOADED float3 mul3(float3 a, float3 b) { return a * b; }
INLINE OVERLOADED float3 scale3(float3 a, float s) { return a * s; }
INLINE OVERLOADED float3 select3(int mask, float3 a, float3 b) { return mask ? a : b; }

INLINE OVERLOADED float dot3(float3 a, float3 b)
{
    return fma1(a.x, b.x, fma1(a.y, b.y, a.z * b.z));
}

INLINE float3 abs3(float3 a)
{
    return (float3)(abs1(a.x), abs1(a.y), abs1(a.z));
}

INLINE OVERLOADED float3 madd3(float3 a, float s, float3 b)
{
    return (float3)(fma1(a.x, s, b.x), fma1(a.y, s, b.y), fma1(a.z, s, b.z));
}

INLINE OVERLOADED float3 cross3(float3 a, float3 b)
{
    return (float3)(fma1(a.y, b.z, -(a.z * b.y)), fma1(a.z, b.x, -(a.x * b.z)), fma1(a.x, b.y, -(a.y * b.x)));
}

INLINE OVERLOADED float3 normalize3(float3 a)
{
    return a * (1.0f / sqrt1(dot3(a, a)));
}

INLINE OVERLOADED float max3(float3 a)
{
    return max1(a.x, max1(a.y, a.z));
}

/* What overflowed becomes the largest float. */
INLINE OVERLOADED float3 saturate3(float3 a)
{
    return (float3)(min1(FLT_MAX, a.x), min1(FLT_MAX, a.y), min1(FLT_MAX, a.z));
}

/* Two unit vectors that make a right-handed frame with the unit vector n (Duff et al. 2017). */
INLINE void frame_from(float3 n, float3 *s, float3 *t)
{
    float sign = copysign1(1.0f, n.z);
    float a = -1.0f / (sign + n.z);
    float b = n.x * n.y * a;
    *s = (float3)(1.0f + sign * n.x * n.x * a, sign * b, -sign * n.x);
    *t = (float3)(b, sign + n.y * n.y * a, -n.y);
}

#endif
