/* The arithmetic that must be one instruction: scalars, and eight lanes at a time.
 *
 * PoCL's CPU devices keep the OpenCL builtins as calls into a library (fma alone took a tenth of a frame), where the
 * compiler's own builtins become instructions. Both round alike; elsewhere the OpenCL ones are used.
 */
#ifndef PYRT_SIMD_H
#define PYRT_SIMD_H

#pragma OPENCL FP_CONTRACT OFF

#ifndef __has_builtin
#define __has_builtin(x) 0
#endif

#ifndef NATIVE_X86
#if defined(__x86_64__) && defined(__FMA__) && defined(__AVX2__) && __has_builtin(__builtin_ia32_vfmaddps256)
#define NATIVE_X86 1
#else
#define NATIVE_X86 0
#endif
#endif

#define INLINE static inline __attribute__((always_inline))

/* For the large ones: called twice, they are compiled once; and PoCL compiles what is inlined into a kernel three times. */
#define NO_INLINE static __attribute__((noinline))

#define NO_UNROLL _Pragma("unroll 1") /* where copies of a loop's body would cost more to compile than they save */

/* Functions of one name for scalars and for packets (packet.h). */
#if defined(PACKET) && PACKET > 1
#define OVERLOADED __attribute__((overloadable))
#else
#define OVERLOADED
#endif

#if NATIVE_X86

typedef float native8 __attribute__((__vector_size__(32)));

INLINE OVERLOADED float fma1(float a, float b, float c) { return __builtin_fmaf(a, b, c); }
INLINE OVERLOADED float sqrt1(float a) { return __builtin_sqrtf(a); }
INLINE OVERLOADED float abs1(float a) { return __builtin_fabsf(a); }
INLINE float floor1(float a) { return __builtin_floorf(a); }
INLINE OVERLOADED float copysign1(float a, float b) { return __builtin_copysignf(a, b); }
INLINE OVERLOADED float min1(float a, float b) { return a < b ? a : b; } /* NaN in a gives b */
INLINE OVERLOADED float max1(float a, float b) { return a > b ? a : b; }

INLINE float8 fma8(float8 a, float8 b, float8 c)
{
    return __builtin_astype(__builtin_ia32_vfmaddps256(__builtin_astype(a, native8), __builtin_astype(b, native8),
                                                       __builtin_astype(c, native8)), float8);
}

INLINE float8 sqrt8(float8 a)
{
    return __builtin_astype(__builtin_ia32_sqrtps256(__builtin_astype(a, native8)), float8);
}

INLINE float8 load8(const global float *p) { return *(const global float8 *)p; } /* p is 32-byte aligned */

/* The bits of each lane in reverse order: within bytes by looking up their halves, then the bytes themselves. */
INLINE uint8 reverse_bits8(uint8 x)
{
    typedef char bytes __attribute__((__vector_size__(32)));
    const bytes low = {0, -128, 64, -64, 32, -96, 96, -32, 16, -112, 80, -48, 48, -80, 112, -16,
                       0, -128, 64, -64, 32, -96, 96, -32, 16, -112, 80, -48, 48, -80, 112, -16};
    const bytes high = {0, 8, 4, 12, 2, 10, 6, 14, 1, 9, 5, 13, 3, 11, 7, 15,
                        0, 8, 4, 12, 2, 10, 6, 14, 1, 9, 5, 13, 3, 11, 7, 15};
    const bytes swap = {3, 2, 1, 0, 7, 6, 5, 4, 11, 10, 9, 8, 15, 14, 13, 12,
                        3, 2, 1, 0, 7, 6, 5, 4, 11, 10, 9, 8, 15, 14, 13, 12};
    bytes l = __builtin_astype(x & 0x0f0f0f0fu, bytes), h = __builtin_astype((x >> 4) & 0x0f0f0f0fu, bytes);
    bytes r = __builtin_ia32_pshufb256(low, l) | __builtin_ia32_pshufb256(high, h);
    return __builtin_astype(__builtin_ia32_pshufb256(r, swap), uint8);
}

/* Bit k of the result is the sign bit of lane k. */
INLINE uint mask8(int8 m) { return (uint)__builtin_ia32_movmskps256(__builtin_astype(m, native8)); }

/* Index of the lowest set bit of a non-zero mask. */
INLINE int lowest_bit(uint mask) { return __builtin_ctz(mask); }

#else

INLINE OVERLOADED float fma1(float a, float b, float c) { return fma(a, b, c); }
INLINE OVERLOADED float sqrt1(float a) { return sqrt(a); }
INLINE OVERLOADED float abs1(float a) { return fabs(a); }
INLINE float floor1(float a) { return floor(a); }
INLINE OVERLOADED float copysign1(float a, float b) { return copysign(a, b); }
INLINE OVERLOADED float min1(float a, float b) { return a < b ? a : b; }
INLINE OVERLOADED float max1(float a, float b) { return a > b ? a : b; }
INLINE float8 fma8(float8 a, float8 b, float8 c) { return fma(a, b, c); }
INLINE float8 sqrt8(float8 a) { return sqrt(a); }
INLINE float8 load8(const global float *p) { return vload8(0, p); }

INLINE uint mask8(int8 m)
{
    int8 bits = m & (int8)(1, 2, 4, 8, 16, 32, 64, 128);
    int4 four = bits.lo | bits.hi;
    int2 two = four.lo | four.hi;
    return (uint)(two.x | two.y);
}

INLINE int lowest_bit(uint mask) { return 31 - (int)clz(mask & (0u - mask)); }

#endif

INLINE float8 abs8(float8 a) { return as_float8(as_int8(a) & 0x7fffffff); }
INLINE float8 min8(float8 a, float8 b) { return a < b ? a : b; }
INLINE float8 max8(float8 a, float8 b) { return a > b ? a : b; }

#endif
