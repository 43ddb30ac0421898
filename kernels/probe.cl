/* What the device's arithmetic does with three numbers, alone and as a lane of eight; pyrt/doctor.py judges it. */
#include "sampling.h"

#define PROBE_ROWS 10

kernel __attribute__((reqd_work_group_size(LOCAL_SIZE, 1, 1)))
void probe(uint count, const global float *numbers, const global uint *bits, global float *results, global uint *comparisons)
{
    uint i = (uint)get_global_id(0);
    if (i >= count)
        return;
    float a = numbers[i], b = numbers[i + count], c = numbers[i + 2u * count];
    float8 a8 = (float8)(a), b8 = (float8)(b), c8 = (float8)(c);
    float8 sum8 = a8 * b8 + c8, fused8 = fma8(a8, b8, c8), quotient8 = a8 / b8, root8 = sqrt8(abs8(a8));
    float row[PROBE_ROWS] = {a * b + c, sum8.s5, fma1(a, b, c), fused8.s5, a / b, quotient8.s5,
                             sqrt1(abs1(a)), root8.s5, min1(a, b), unit_float(bits[i])};
    for (uint k = 0; k < PROBE_ROWS; ++k)
        results[k * count + i] = row[k];
    uint alone = (uint)(a < b) | (uint)(a > b) << 1 | (uint)(a <= b) << 2 | (uint)(a >= b) << 3 | (uint)(a == b) << 4;
    uint lanes = (mask8(a8 < b8) & 1u) | (mask8(a8 > b8) & 2u) | (mask8(a8 <= b8) & 4u) | (mask8(a8 >= b8) & 8u) |
                 (mask8(a8 == b8) & 16u);
    comparisons[i] = alone | lanes << 5;
}
