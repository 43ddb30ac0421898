/* One work-item per pixel sample: work-item g is sample `g % sample_count` of pixel `pixels[g / sample_count]`.
 *
 * Samples leave in planes, [sample][channel][pixel], so that the host's reduction is a sum of contiguous vectors. Each
 * work-group adds up what its samples did and stores it at counts[group].
 */
#include "beam.h"
#include "direct.h"

/* How many of the lights have a shaft of their own. */
static uint shaft_count(constant SceneParams *params)
{
    return params->light_count <= SHAFT_LIGHTS ? (uint)params->light_count : 0u;
}

/* Before a pass: what each beam of BEAM_PIXELS pixels can meet; one work-item per beam. */
kernel __attribute__((reqd_work_group_size(LOCAL_SIZE, 1, 1)))
void trace_beams(const PassParams pass, constant SceneParams *params, const global BvhNode *nodes,
                 const global TriangleBlock *triangle_blocks, const global Triangle *triangles,
                 const global Light *lights, const global uint *pixels, global Candidates *candidates)
{
    uint first = (uint)get_global_id(0) * BEAM_PIXELS;
    if (first >= pass.pixel_count)
        return;
    const Scene scene = {params, nodes, triangle_blocks, 0, triangles, 0, 0, 0, 0, 0, lights, 0};
    Beam beam = beam_of_pixels(&scene, pixels + pass.first_pixel + first, min(pass.pixel_count - first, (uint)BEAM_PIXELS));
    uint shafts = shaft_count(params);
    beam_trace(&scene, &beam, (int)shafts, candidates + (first / BEAM_PIXELS) * (1u + shafts));
}

kernel __attribute__((reqd_work_group_size(LOCAL_SIZE, 1, 1)))
void render(const PassParams pass, constant SceneParams *params, const global BvhNode *nodes,
            const global TriangleBlock *triangle_blocks, const global SphereBlock *sphere_blocks,
            const global Triangle *triangles, const global Corners *corners, const global Sphere *spheres,
            const global Material *materials, const global Texture *textures, const global float *texels,
            const global Light *lights, const global uint *cdf, const global uint *pixels,
            const global Candidates *candidates, global float *planes, global uint *counts)
{
    const Scene scene = {params, nodes, triangle_blocks, sphere_blocks, triangles, corners,
                         spheres, materials, textures, texels, lights, cdf};
    local Counters group[LOCAL_SIZE];
    uint g = (uint)get_global_id(0);
    Counters counters = {0u, 0u, 0u, 0u};
    if (g < pass.pixel_count * pass.sample_count) {
        uint p = g / pass.sample_count;
        uint s = g - p * pass.sample_count;
        uint pixel = pixels[pass.first_pixel + p];
        Sampler sampler = {hash_uint(pixel ^ hash_uint(pass.seed + 0x51633e2du)), pass.first_sample + s};

        float2 jitter = sample_2d(sampler, 0u);
        float3 o, d;
        camera_ray(&params->camera, (float)(pixel & 0xffffu) + jitter.x, (float)(pixel >> 16) + jitter.y, &o, &d);
        const global Candidates *beam = candidates + (p / BEAM_PIXELS) * (1u + shaft_count(params));
        float3 radiance = direct_radiance(&scene, o, d, sampler, beam, &counters);

        global float *out = planes + (size_t)(3u * s) * pass.stride + p;
        out[0] = radiance.x;
        out[pass.stride] = radiance.y;
        out[2u * pass.stride] = radiance.z;
    }
    uint item = (uint)get_local_id(0);
    group[item] = counters;
    barrier(CLK_LOCAL_MEM_FENCE);
    if (item == 0u && g < pass.pixel_count * pass.sample_count) {
        Counters sum = {0u, 0u, 0u, 0u};
        for (uint i = 0; i < LOCAL_SIZE; ++i) {
            sum.specular += group[i].specular;
            sum.shadow += group[i].shadow;
            sum.dark += group[i].dark;
            sum.clear += group[i].clear;
        }
        vstore4((uint4)(sum.specular, sum.shadow, sum.dark, sum.clear), get_group_id(0), counts);
    }
}
