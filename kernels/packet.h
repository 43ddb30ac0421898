/* Packets: PACKET samples side by side, a lane each, so that the arithmetic of shading fills the vector units.
 *
 * With PACKET 1 a packet is a scalar and a `Vec` is a float3: the source is the same, and so is every bit. Masks are what
 * comparisons give; combine them with &, | and !, and choose with ?:. Where control flow depends on lanes, a set of them is
 * a uint, lane k its bit k.
 */
#ifndef PYRT_PACKET_H
#define PYRT_PACKET_H

#include "math.h"

#ifndef PACKET
#define PACKET 1
#endif

#if PACKET == 1

typedef float Real;
typedef int Int;
typedef uint Uint;
typedef float2 Vec2;
typedef float3 Vec;
typedef float4 Vec4;

INLINE uint lanes_of(int mask) { return mask ? 1u : 0u; }
INLINE int mask_of(uint lanes) { return (int)(lanes & 1u); }
INLINE float real_of(uint whole) { return (float)whole; }
INLINE uint bits_of(int number) { return (uint)number; }
INLINE float3 vec_lane(const float3 *v, int lane) { return *v; }
INLINE void vec_set(float3 *v, int lane, float3 value) { *v = value; }
INLINE float2 vec2_lane(const float2 *v, int lane) { return *v; }
INLINE void vec2_set(float2 *v, int lane, float2 value) { *v = value; }

#else

typedef float8 Real;
typedef int8 Int;
typedef uint8 Uint;
typedef struct { float8 x, y; } Vec2;
typedef struct { float8 x, y, z; } Vec;
typedef struct { float8 x, y, z, w; } Vec4;

INLINE uint lanes_of(int8 mask) { return mask8(mask); }
INLINE int8 mask_of(uint lanes) { return ((int8)((int)lanes) & (int8)(1, 2, 4, 8, 16, 32, 64, 128)) != 0; }

INLINE uint8 bits_of(int8 number) { return as_uint8(number); }

#if __has_builtin(__builtin_convertvector)
#define CONVERT(VECTOR, TYPE) __builtin_convertvector(VECTOR, TYPE)
#else
#define CONVERT(VECTOR, TYPE) convert_##TYPE(VECTOR)
#endif

INLINE float8 real_of(uint8 whole) /* below 2^31 */
{
    return CONVERT(as_int8(whole), float8);
}

INLINE float lanes_min(float8 a)
{
    float4 four = a.lo < a.hi ? a.lo : a.hi;
    return min1(min1(four.x, four.y), min1(four.z, four.w));
}

INLINE float lanes_max(float8 a)
{
    float4 four = a.lo > a.hi ? a.lo : a.hi;
    return max1(max1(four.x, four.y), max1(four.z, four.w));
}

INLINE float3 vec_lane(const Vec *v, int lane)
{
    return (float3)(((const float *)&v->x)[lane], ((const float *)&v->y)[lane], ((const float *)&v->z)[lane]);
}

INLINE void vec_set(Vec *v, int lane, float3 value)
{
    ((float *)&v->x)[lane] = value.x;
    ((float *)&v->y)[lane] = value.y;
    ((float *)&v->z)[lane] = value.z;
}

INLINE float2 vec2_lane(const Vec2 *v, int lane)
{
    return (float2)(((const float *)&v->x)[lane], ((const float *)&v->y)[lane]);
}

INLINE void vec2_set(Vec2 *v, int lane, float2 value)
{
    ((float *)&v->x)[lane] = value.x;
    ((float *)&v->y)[lane] = value.y;
}

INLINE OVERLOADED float8 fma1(float8 a, float8 b, float8 c) { return fma8(a, b, c); }
INLINE OVERLOADED float8 sqrt1(float8 a) { return sqrt8(a); }
INLINE OVERLOADED float8 abs1(float8 a) { return abs8(a); }
INLINE OVERLOADED float8 copysign1(float8 a, float8 b)
{
    return as_float8((as_int8(a) & 0x7fffffff) | (as_int8(b) & (int)0x80000000));
}
INLINE OVERLOADED float8 min1(float8 a, float8 b) { return min8(a, b); }
INLINE OVERLOADED float8 max1(float8 a, float8 b) { return max8(a, b); }
INLINE OVERLOADED float8 lerp1(float8 a, float8 b, float8 t) { return fma8(t, b - a, a); }

INLINE OVERLOADED Vec add3(Vec a, Vec b)
{
    Vec c = {a.x + b.x, a.y + b.y, a.z + b.z};
    return c;
}

INLINE OVERLOADED Vec sub3(Vec a, Vec b)
{
    Vec c = {a.x - b.x, a.y - b.y, a.z - b.z};
    return c;
}

INLINE OVERLOADED Vec neg3(Vec a)
{
    Vec c = {-a.x, -a.y, -a.z};
    return c;
}

INLINE OVERLOADED Vec mul3(Vec a, Vec b)
{
    Vec c = {a.x * b.x, a.y * b.y, a.z * b.z};
    return c;
}

INLINE OVERLOADED Vec scale3(Vec a, float8 s)
{
    Vec c = {a.x * s, a.y * s, a.z * s};
    return c;
}

INLINE OVERLOADED Vec select3(int8 mask, Vec a, Vec b)
{
    Vec c = {mask ? a.x : b.x, mask ? a.y : b.y, mask ? a.z : b.z};
    return c;
}

INLINE OVERLOADED float8 dot3(Vec a, Vec b)
{
    return fma8(a.x, b.x, fma8(a.y, b.y, a.z * b.z));
}

INLINE OVERLOADED Vec madd3(Vec a, float8 s, Vec b)
{
    Vec c = {fma8(a.x, s, b.x), fma8(a.y, s, b.y), fma8(a.z, s, b.z)};
    return c;
}

INLINE OVERLOADED Vec cross3(Vec a, Vec b)
{
    Vec c = {fma8(a.y, b.z, -(a.z * b.y)), fma8(a.z, b.x, -(a.x * b.z)), fma8(a.x, b.y, -(a.y * b.x))};
    return c;
}

INLINE OVERLOADED Vec normalize3(Vec a)
{
    return scale3(a, 1.0f / sqrt8(dot3(a, a)));
}

INLINE OVERLOADED float8 max3(Vec a)
{
    return max8(a.x, max8(a.y, a.z));
}

INLINE OVERLOADED Vec saturate3(Vec a)
{
    Vec c = {min8(FLT_MAX, a.x), min8(FLT_MAX, a.y), min8(FLT_MAX, a.z)};
    return c;
}

#endif

#define ALL_LANES ((1u << PACKET) - 1u)

INLINE float real_lane(const Real *packet, int lane) { return ((const float *)packet)[lane]; }
INLINE void real_set(Real *packet, int lane, float value) { ((float *)packet)[lane] = value; }
INLINE int int_lane(const Int *packet, int lane) { return ((const int *)packet)[lane]; }
INLINE void int_set(Int *packet, int lane, int value) { ((int *)packet)[lane] = value; }

/* The same vector in every lane. */
INLINE Vec vec_of(float x, float y, float z)
{
    Vec v;
    v.x = (Real)(x);
    v.y = (Real)(y);
    v.z = (Real)(z);
    return v;
}

INLINE Vec vec_load(const global float *p)
{
    return vec_of(p[0], p[1], p[2]);
}

/* Whether all of these lanes hold the same number; `lanes` is not empty. */
INLINE bool all_same(const Int *packet, uint lanes, int *number)
{
    *number = int_lane(packet, lowest_bit(lanes));
    return (lanes & ~lanes_of(*packet == *number)) == 0u;
}

#endif
