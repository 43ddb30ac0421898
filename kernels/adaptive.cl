/* Where samples are worth most: the class of each pixel, and errors averaged over neighbours of a class. */
#include "classify.h"

/* One work-item per beam of a pass: most beams show one class only, and the others are asked pixel by pixel. */
kernel __attribute__((reqd_work_group_size(LOCAL_SIZE, 1, 1)))
void classify(const PassParams pass, constant SceneParams *params, const global Triangle *triangles,
              const global Corners *corners, const global Material *materials, const global Texture *textures,
              const global Light *lights, const global TriangleBlock *triangle_blocks, const global uint *pixels,
              const global uint *starts, const global Candidates *candidates, global TriangleBlock *gathered,
              global uchar *classes)
{
    const Scene scene = {.params = params, .triangles = triangles, .corners = corners, .materials = materials,
                         .textures = textures, .lights = lights, .triangle_blocks = triangle_blocks};
    uint i = (uint)get_global_id(0);
    if (i >= pass.beam_count)
        return;
    uint first = starts[i], end = i + 1u < pass.beam_count ? starts[i + 1u] : pass.pixel_count;
    int shafts = shaft_count(params);
    candidates += (size_t)i * (size_t)(1 + shafts);
    gathered += (size_t)i * (size_t)(1 + shafts);
    for (int k = 0; k <= shafts; ++k)
        candidates_gather(&scene, candidates + k, gathered + k);
    Beam beam = beam_of_pixels(&scene, pixels[pass.first_pixel + first], BEAM_SIDE);
    uchar whole = classify_beam(&scene, &beam, candidates, gathered, shafts);
    bool same = whole == PIXEL_PLAIN || whole == PIXEL_UNKNOWN; /* no edge, and no light would be better known */
    for (uint p = first; p < end; ++p) {
        beam = beam_of_pixels(&scene, pixels[pass.first_pixel + p], 1u);
        classes[p] = same ? whole : classify_beam(&scene, &beam, candidates, gathered, shafts);
    }
}

/* One work-item per pixel: its kind and its value times the factor of its kind into pictures, for `gains`. These have rows of
 * `stride` floats and a margin of two pixels; `order`: where each pixel of a picture, row by row, stands in the lists. */
kernel __attribute__((reqd_work_group_size(LOCAL_SIZE, 1, 1)))
void spread(uint width, uint height, uint stride, const global uint *order, const global float *values,
            const global uchar *kinds, constant float *factors, global float *scaled, global float *kind_picture)
{
    uint i = (uint)get_global_id(0);
    if (i >= width * height)
        return;
    uint at = (i / width + 2u) * stride + i % width + 2u, p = order[i];
    scaled[at] = values[p] * factors[kinds[p]];
    kind_picture[at] = (float)kinds[p];
}

/* One work-item per eight pixels of a row: for each the weighted mean of the scaled values of the other pixels of its class
 * nearby, and, with the weight `prior`, of the class as a whole. The pixel's own value has no part in it. Stored is the kind
 * and, in steps of 1 / `steps` from `low` on, the logarithm of that mean plus the kind's shift. A class is `levels` kinds. */
kernel __attribute__((reqd_work_group_size(LOCAL_SIZE, 1, 1)))
void gains(uint width, uint height, uint stride, uint levels, float prior, float low, float steps, uint bins,
           const global uint *order, constant float *class_means, constant float *shifts, const global float *scaled,
           const global float *kind_picture, global uint *keys)
{
    const float weights[5] = {0.278037f, 0.726149f, 1.0f, 0.726149f, 0.278037f}; /* a Gaussian of deviation 1.25 */
    uint i = (uint)get_global_id(0), columns = (width + 7u) / 8u;
    uint x = i % columns * 8u, y = i / columns;
    if (y >= height)
        return;
    float8 kinds = vload8(0, kind_picture + (y + 2u) * stride + x + 2u), first = (float8)(0.0f), weight = (float8)(prior);
    float8 sum = prior * class_means[0];
    for (int c = 1; c < PIXEL_CLASSES; ++c) {
        float start = (float)(c * (int)levels);
        sum = kinds >= start ? prior * class_means[c] : sum;
        first = kinds >= start ? start : first;
    }
    float8 after = first + (float)levels;
    for (uint dy = 0; dy < 5u; ++dy)
        for (uint dx = 0; dx < 5u; ++dx) {
            if (dx == 2u && dy == 2u)
                continue;
            uint at = (y + dy) * stride + x + dx;
            float8 other = vload8(0, kind_picture + at);
            float8 w = (other >= first) & (other < after) ? weights[dx] * weights[dy] : (float8)(0.0f);
            weight += w;
            sum += w * vload8(0, scaled + at);
        }
    float gain[8], kind[8];
    vstore8(log2(max(sum / weight, 1e-30f)), 0, gain);
    vstore8(kinds, 0, kind);
    for (uint k = 0; k < 8u && x + k < width; ++k) {
        uint own = (uint)kind[k];
        float bin = clamp((gain[k] + shifts[own] - low) * steps, 0.0f, (float)(bins - 1u));
        keys[order[y * width + x + k]] = own * bins + (uint)bin;
    }
}

#if HAS_DOUBLE
#include "film.h"

typedef struct {
    double before[PIXEL_CLASSES], after[PIXEL_CLASSES], pixels[PIXEL_CLASSES], lost;
} Falls;

INLINE double8 relative(const double8 *squared, const double8 *mean, double floor)
{
    double8 sum = squared[0] / (mean[0] * mean[0] + floor) + squared[1] / (mean[1] * mean[1] + floor);
    return (sum + squared[2] / (mean[2] * mean[2] + floor)) / 3.0;
}

/* Adds a pass's samples to eight pixels of the state, as `_add_block` of pyrt/adaptive.py does, with the same bits. */
static void refine_eight(const PassParams *pass, uint first, uint total, uint steady, double floor, const global float *planes,
                         const global uint *places, const global uchar *classes, const global uchar *wanted,
                         constant double *decay, global double *sums, global double *errors, global uchar *levels,
                         global uint *counts, Falls *falls)
{
    uint at[8], lanes = min(pass->pixel_count - first, 8u);
    double8 sum[6], error, falling;
    for (uint k = 0; k < 8u; ++k) {
        at[k] = places[pass->first_pixel + first + min(k, lanes - 1u)];
        for (uint c = 0; c < 6u; ++c)
            ((double *)&sum[c])[k] = sums[(size_t)c * total + at[k]];
        ((double *)&error)[k] = errors[at[k]];
        ((double *)&falling)[k] = decay[classes[at[k]]];
    }
    int8 lost = (int8)(0);
    uint s = pass->first_sample, end = s + pass->sample_count, level = 0;
    for (; s < end; s += 1u << level) { /* the nodes that make up the range, see node_keys of pyrt/film.py */
        for (level = 31u - clz(end - s); (s & ((1u << level) - 1u)) != 0u;)
            --level;
        double8 node[6], squared[3], mean[3], before = error;
        sum_node(planes + (size_t)(s - pass->first_sample) * 3 * pass->stride + first, pass->stride, level, node, &lost);
        double samples = (double)(2u << level);
        for (int c = 0; c < 3; ++c) {
            double8 apart = (sum[c] - node[c]) / samples;
            mean[c] = s == 0u ? node[c] / 2.0 : (sum[c] + node[c]) / samples;
            squared[c] = s == 0u ? node[3 + c] / 2.0 - mean[c] * mean[c] : apart * apart;
            squared[c] = squared[c] > 0.0 ? squared[c] : 0.0; /* PoCL 3.0 cannot compile max() of these */
        }
        if (s != 0u || level != 0u)
            error = relative(squared, mean, floor);
        for (uint k = 0; k < lanes && s != 0u; ++k) {
            uint class = classes[at[k]];
            falls->before[class] += ((double *)&before)[k];
            falls->after[class] += ((double *)&error)[k];
            falls->pixels[class] += 1.0;
        }
        if (s != 0u && level + 1u >= steady)
            error = (error + falling * before) / 2.0;
        for (int c = 0; c < 6; ++c)
            sum[c] += node[c];
    }
    for (uint k = 0; k < lanes; ++k) {
        for (uint c = 0; c < 6u; ++c)
            sums[(size_t)c * total + at[k]] = ((double *)&sum[c])[k];
        errors[at[k]] = ((double *)&error)[k];
        levels[at[k]] = wanted[at[k]];
        uint gone = (uint)((int *)&lost)[k];
        counts[at[k]] += pass->sample_count - gone;
        falls->lost += (double)gone;
    }
}

/* One work-item per PIXELS_REFINED pixels of a pass of `refine` (pyrt/adaptive.py), which has all their new samples: adds them
 * to the state, whose arrays are over the `total` pixels of the picture, and tells by class how errors fell. */
kernel __attribute__((reqd_work_group_size(LOCAL_SIZE, 1, 1)))
void refine(const PassParams pass, uint total, uint steady, double floor, const global float *planes, const global uint *places,
            const global uchar *classes, const global uchar *wanted, constant double *decay, global double *sums,
            global double *errors, global uchar *levels, global uint *counts, global Falls *falls)
{
    uint first = (uint)get_global_id(0) * PIXELS_REFINED, end = min(first + PIXELS_REFINED, pass.pixel_count);
    if (first >= pass.pixel_count)
        return;
    Falls own = {{0.0}, {0.0}, {0.0}, 0.0};
    for (; first < end; first += 8u)
        refine_eight(&pass, first, total, steady, floor, planes, places, classes, wanted, decay, sums, errors, levels, counts,
                     &own);
    falls[get_global_id(0)] = own;
}
#endif
