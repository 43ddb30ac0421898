/* One work-item per pixel sample: work-item g is sample `g % sample_count` of pixel `pixels[g / sample_count]`. On a processor
 * with vector units, PACKET neighbours are traced together by the first of them, a lane each.
 *
 * Samples leave in planes, [sample][channel][pixel], so that the host's reduction is a sum of contiguous vectors. Each
 * work-group adds up what its samples did and stores it at counts[group].
 */
#include "beam.h"
#include "direct.h"

/* Before a pass: what each of its beams can meet; one work-item per beam. `starts`: the first pixel of each. */
kernel __attribute__((reqd_work_group_size(LOCAL_SIZE, 1, 1)))
void trace_beams(const PassParams pass, constant SceneParams *params, const global BvhNode *nodes,
                 const global TriangleBlock *triangle_blocks, const global SphereBlock *sphere_blocks,
                 const global Triangle *triangles, const global Light *lights, const global uint *pixels,
                 const global uint *starts, global Candidates *candidates)
{
    uint i = (uint)get_global_id(0);
    if (i >= pass.beam_count)
        return;
    const Scene scene = {params, nodes, triangle_blocks, sphere_blocks, triangles, 0, 0, 0, 0, 0, lights, 0};
    Beam beam = beam_of_pixels(&scene, pixels[pass.first_pixel + starts[i]], BEAM_SIDE);
    int shafts = shaft_count(params);
    beam_trace(&scene, &beam, shafts, candidates + (size_t)i * (size_t)(1 + shafts));
}

/* Traces the samples g … g + PACKET - 1 of a pass that has `samples`. */
NO_INLINE void render_packet(const Scene *scene, const PassParams *pass, const global uint *pixels, const global uint *beams,
                             const global Candidates *candidates, uint g, uint samples, global float *planes,
                             Counters *counters)
{
    uint count = samples - g < PACKET ? samples - g : PACKET;
    size_t place[PACKET]; /* in a plane */
    uint first_pixel = g / pass->sample_count, p = first_pixel, s = g - p * pass->sample_count;
    Uint pixel, index, beam;
    for (int lane = 0; lane < PACKET; ++lane) {
        uint some = p < pass->pixel_count ? p : first_pixel; /* lanes beyond the end trace nothing */
        ((uint *)&pixel)[lane] = pixels[pass->first_pixel + some];
        ((uint *)&index)[lane] = pass->first_sample + s;
        ((uint *)&beam)[lane] = HAS_BEAMS ? beams[some] : 0u;
        place[lane] = (size_t)(3u * s) * pass->stride + p;
        if (++s == pass->sample_count) {
            s = 0u;
            ++p;
        }
    }
    Sampler sampler = {hash_uint(pixel ^ hash_uint(pass->seed + 0x51633e2du)), index};
    Vec2 jitter = sample_2d(sampler, (Uint)(0u));
    Vec o, d;
    camera_ray(&scene->params->camera, real_of(pixel & 0xffffu) + jitter.x, real_of(pixel >> 16) + jitter.y, &o, &d);
    Vec radiance;
    for (uint rest = ALL_LANES >> (PACKET - count), same; rest != 0u; rest &= ~same) { /* mostly all are of one beam */
        uint number = ((const uint *)&beam)[lowest_bit(rest)];
        same = rest & lanes_of(beam == number);
        const global Candidates *known = HAS_BEAMS ? candidates + (size_t)number * (size_t)(1 + shaft_count(scene->params)) : 0;
        Vec part = direct_radiance(scene, o, d, same, sampler, known, counters);
        radiance = select3(mask_of(same), part, radiance);
    }

    for (uint lane = 0; lane < count; ++lane) {
        float3 value = vec_lane(&radiance, lane);
        global float *out = planes + place[lane];
        out[0] = value.x;
        out[pass->stride] = value.y;
        out[2u * pass->stride] = value.z;
    }
}

kernel __attribute__((reqd_work_group_size(LOCAL_SIZE, 1, 1)))
void render(const PassParams pass, constant SceneParams *params, const global BvhNode *nodes,
            const global TriangleBlock *triangle_blocks, const global SphereBlock *sphere_blocks,
            const global Triangle *triangles, const global Corners *corners, const global Sphere *spheres,
            const global Material *materials, const global Texture *textures, const global float *texels,
            const global Light *lights, const global uint *cdf, const global uint *pixels, const global uint *beams,
            const global Candidates *candidates, global float *planes, global uint *counts)
{
    const Scene scene = {params, nodes, triangle_blocks, sphere_blocks, triangles, corners,
                         spheres, materials, textures, texels, lights, cdf};
    local Counters group[LOCAL_SIZE / PACKET];
    uint g = (uint)get_global_id(0), item = (uint)get_local_id(0), samples = pass.pixel_count * pass.sample_count;
    if (item % PACKET == 0u) {
        Counters counters = {0u, 0u, 0u, 0u};
        if (g < samples)
            render_packet(&scene, &pass, pixels, beams, candidates, g, samples, planes, &counters);
        group[item / PACKET] = counters;
    }
    barrier(CLK_LOCAL_MEM_FENCE);
    if (item == 0u && g < samples) {
        Counters sum = {0u, 0u, 0u, 0u};
        for (uint i = 0; i < LOCAL_SIZE / PACKET; ++i) {
            sum.specular += group[i].specular;
            sum.shadow += group[i].shadow;
            sum.dark += group[i].dark;
            sum.clear += group[i].clear;
        }
        vstore4((uint4)(sum.specular, sum.shadow, sum.dark, sum.clear), get_group_id(0), counts);
    }
}
