/* Where samples are worth most: the class of each pixel, and errors averaged over neighbours of a class. */
#include "classify.h"

/* One work-item per beam of a pass: most beams show one class only, and the others are asked pixel by pixel. */
kernel __attribute__((reqd_work_group_size(LOCAL_SIZE, 1, 1)))
void classify(const PassParams pass, constant SceneParams *params, const global Triangle *triangles,
              const global Corners *corners, const global Material *materials, const global Texture *textures,
              const global Light *lights, const global uint *pixels, const global Candidates *candidates, global uchar *classes)
{
    const Scene scene = {.params = params, .triangles = triangles, .corners = corners, .materials = materials,
                         .textures = textures, .lights = lights};
    uint first = (uint)get_global_id(0) * BEAM_PIXELS;
    if (first >= pass.pixel_count)
        return;
    uint count = min(pass.pixel_count - first, (uint)BEAM_PIXELS);
    uint shafts = params->light_count <= SHAFT_LIGHTS ? (uint)params->light_count : 0u;
    pixels += pass.first_pixel + first;
    classes += first;
    candidates += (first / BEAM_PIXELS) * (1u + shafts);
    Beam beam = beam_of_pixels(&scene, pixels, count);
    uchar whole = classify_beam(&scene, &beam, candidates, (int)shafts);
    bool same = whole == PIXEL_PLAIN || whole == PIXEL_UNKNOWN; /* no edge, and no light would be better known */
    for (uint i = 0; i < count; ++i) {
        beam = beam_of_pixels(&scene, pixels + i, 1u);
        classes[i] = same ? whole : classify_beam(&scene, &beam, candidates, (int)shafts);
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
