/* Sums of samples in float64, by the tree of pyrt/film.py: the samples index·2^level … (index + 1)·2^level − 1 are a node, the
 * sum of its two halves. So the bits are those of numpy's sums, whatever the passes. Needs cl_khr_fp64. */
#ifndef PYRT_FILM_H
#define PYRT_FILM_H

#pragma OPENCL EXTENSION cl_khr_fp64 : enable
#pragma OPENCL FP_CONTRACT OFF

#define TREE_LEVELS 32

/* The node of 2^level samples of eight neighbouring pixels: sums of x, then of x², of each channel. `planes`: of its first
 * sample. Samples that are not finite count as 0 and as lost. */
static void sum_node(const global float *planes, size_t stride, uint level, double8 *sums, int8 *lost)
{
    double8 done[TREE_LEVELS][6]; /* nodes that wait for their other half */
    for (uint s = 0; s < 1u << level; ++s, planes += 3 * stride) {
        float8 x[3];
        int8 finite = (int8)(-1);
        for (int c = 0; c < 3; ++c) {
            x[c] = vload8(0, planes + c * stride);
            finite &= (x[c] > -INFINITY) & (x[c] < INFINITY);
        }
        *lost -= ~finite;
        for (int c = 0; c < 3; ++c) {
            sums[c] = convert_double8(finite ? x[c] : (float8)(0.0f));
            sums[3 + c] = sums[c] * sums[c];
        }
        uint l = 0;
        for (; (s >> l & 1u) != 0u; ++l)
            for (int k = 0; k < 6; ++k)
                sums[k] += done[l][k];
        for (int k = 0; k < 6; ++k)
            done[l][k] = sums[k];
    }
}

#endif
