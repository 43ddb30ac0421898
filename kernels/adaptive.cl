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
    bool same = whole == PIXEL_PLAIN || candidates->count < 0;
    for (uint i = 0; i < count; ++i) {
        beam = beam_of_pixels(&scene, pixels + i, 1u);
        classes[i] = same ? whole : classify_beam(&scene, &beam, candidates, (int)shafts);
    }
}

/* One work-item per eight pixels of a row: for each the weighted mean of the values of the other pixels of its class nearby, and,
 * with the weight `prior`, of the class as a whole. The pixel's own value has no part in it. Pictures have a margin of two
 * pixels of no class, rows of them above and below, and rows of `stride` floats. */
kernel __attribute__((reqd_work_group_size(LOCAL_SIZE, 1, 1)))
void pool(uint width, uint height, uint stride, float prior, constant float *class_means, const global float *values,
          const global float *classes, global float *pooled)
{
    const float weights[5] = {0.278037f, 0.726149f, 1.0f, 0.726149f, 0.278037f}; /* a Gaussian of deviation 1.25 */
    uint i = (uint)get_global_id(0), columns = (width + 7u) / 8u;
    uint x = i % columns * 8u, y = i / columns;
    if (y >= height)
        return;
    float8 own = vload8(0, classes + (y + 2u) * stride + x + 2u), weight = (float8)(prior), sum = (float8)(0.0f);
    for (int c = 0; c < PIXEL_CLASSES; ++c)
        sum = own == (float)c ? prior * class_means[c] : sum;
    for (uint dy = 0; dy < 5u; ++dy)
        for (uint dx = 0; dx < 5u; ++dx) {
            uint at = (y + dy) * stride + x + dx;
            float8 w = vload8(0, classes + at) == own ? (dx == 2u && dy == 2u ? 0.0f : weights[dx] * weights[dy]) : (float8)(0.0f);
            weight += w;
            sum += w * vload8(0, values + at);
        }
    vstore8(sum / weight, 0, pooled + (y + 2u) * stride + x + 2u);
}
