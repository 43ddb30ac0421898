/* Sample points: every pixel owns a two-dimensional stratified point set for each pair of dimensions it needs.
 *
 * The points are Sobol's first two dimensions with Owen's nested scrambling, padded pair by pair: the index is shuffled
 * (itself an Owen scramble, so aligned blocks of 2^k indices stay together) and both coordinates are scrambled, all
 * by a hash of (pixel, seed, pair). The first 2^k samples of a pixel hold one point in each of the 2^k strata of every
 * elementary grid (1 x 2^k, 2 x 2^(k-1), ...). A point depends on nothing but (pixel, seed, pair, index).
 *
 * Burley, Practical Hash-based Owen Scrambling, JCGT 2020; the scrambling hash with the constants of Vegdahl.
 */
#ifndef PYRT_SAMPLING_H
#define PYRT_SAMPLING_H

#include "packet.h"

typedef struct {
    Uint pixel; /* hash of the pixel and the seed */
    Uint index; /* of the sample within the pixel */
} Sampler;

INLINE OVERLOADED uint hash_uint(uint x)
{
    x ^= x >> 16;
    x *= 0x21f0aaadu;
    x ^= x >> 15;
    x *= 0x735a2d97u;
    x ^= x >> 15;
    return x;
}

#if PACKET > 1
INLINE OVERLOADED Uint hash_uint(Uint x)
{
    x ^= x >> 16;
    x *= 0x21f0aaadu;
    x ^= x >> 15;
    x *= 0x735a2d97u;
    x ^= x >> 15;
    return x;
}
#endif

INLINE Uint reverse_bits(Uint x)
{
#if PACKET == 1 && __has_builtin(__builtin_bitreverse32)
    return __builtin_bitreverse32(x);
#elif PACKET > 1 && NATIVE_X86
    return reverse_bits8(x);
#endif
    x = (x << 16) | (x >> 16);
    x = ((x & 0x00ff00ffu) << 8) | ((x >> 8) & 0x00ff00ffu);
    x = ((x & 0x0f0f0f0fu) << 4) | ((x >> 4) & 0x0f0f0f0fu);
    x = ((x & 0x33333333u) << 2) | ((x >> 2) & 0x33333333u);
    return ((x & 0x55555555u) << 1) | ((x >> 1) & 0x55555555u);
}

/* Owen scrambling of a number whose bits stand in reverse order: each bit is flipped by a hash of the bits below it. */
INLINE Uint scramble_reversed(Uint x, Uint seed)
{
    x ^= x * 0x3d20adeau;
    x += seed;
    x *= (seed >> 16) | 1u;
    x ^= x * 0x05526c56u;
    x ^= x * 0x53a22864u;
    return x;
}

/* Bits of the second Sobol' coordinate in reverse order: Pascal's triangle modulo 2 applied to the index. */
INLINE Uint sobol_second_reversed(Uint i)
{
    i ^= (i >> 16) & 0x0000ffffu;
    i ^= (i >> 8) & 0x00ff00ffu;
    i ^= (i >> 4) & 0x0f0f0f0fu;
    i ^= (i >> 2) & 0x33333333u;
    i ^= (i >> 1) & 0x55555555u;
    return i;
}

/* The point of the current sample in dimension pair `pair`, as the bits behind the binary point. */
INLINE void sample_bits(Sampler sampler, Uint pair, Uint *x, Uint *y)
{
    Uint seed = hash_uint(sampler.pixel + pair * 0x9e3779b9u);
    Uint i = reverse_bits(scramble_reversed(reverse_bits(sampler.index), seed));
    *x = reverse_bits(scramble_reversed(i, hash_uint(seed ^ 0x68bc21ebu)));
    *y = reverse_bits(scramble_reversed(sobol_second_reversed(i), hash_uint(seed ^ 0x02e5be93u)));
}

/* A multiple of 2^-24 in [0, 1): never 1, because the bits that a float cannot hold are cut off first. */
INLINE Real unit_float(Uint bits)
{
    return real_of(bits >> 8) * ULP;
}

/* The same in [0, 1)^2. */
INLINE Vec2 sample_2d(Sampler sampler, Uint pair)
{
    Uint x, y;
    sample_bits(sampler, pair, &x, &y);
    Vec2 u = {unit_float(x), unit_float(y)};
    return u;
}

/* x in [0, 1] with density proportional to (1 - x) a + x b; a, b >= 0, not both 0. */
INLINE Real sample_linear(Real u, Real a, Real b)
{
    return min1(u * (a + b) / max1(a + sqrt1(fma1(u, b * b - a * a, a * a)), (Real)(1e-30f)), (Real)(1.0f));
}

/* Uniform barycentrics (b1, b2) of a triangle: the square folded along its diagonal, shear-free (Heitz 2019). */
INLINE Vec2 sample_triangle(Vec2 u)
{
    Real b1 = 0.5f * u.x, b2 = 0.5f * u.y;
    Vec2 b = {u.y > u.x ? b1 : u.x - b2, u.y > u.x ? u.y - b1 : b2};
    return b;
}

#endif
