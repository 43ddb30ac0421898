/* Paths that bounce from surface to surface, to see whether they get through or hit again what they leave. */
#include "bvh.h"
#include "sampling.h"
#include "surface.h"

/* A unit direction on the side of n, half of them grazing, none lower than 2^-18. */
static float3 random_direction(uint seed, float3 n)
{
    uint a = hash_uint(seed), b = hash_uint(a), c = hash_uint(b);
    float z = a & 1u ? exp2(-18.0f * unit_float(b)) : max1(unit_float(b), 0x1p-18f);
    float r = sqrt1((1.0f - z) * (1.0f + z)), turn = 2.0f * unit_float(c);
    float3 s, t;
    frame_from(n, &s, &t);
    return (s * cospi(turn) + t * sinpi(turn)) * r + n * z;
}

/* counts: [hits, hits on the triangle that the path had just left, 1 if it got out][path]. */
kernel __attribute__((reqd_work_group_size(LOCAL_SIZE, 1, 1)))
void bounce(uint count, int steps, int both_sides, constant SceneParams *params, const global BvhNode *nodes,
            const global TriangleBlock *triangle_blocks, const global SphereBlock *sphere_blocks,
            const global Triangle *triangles, const global Corners *corners, const global Sphere *spheres,
            const global float *rays, global int *counts)
{
    uint i = (uint)get_global_id(0);
    if (i >= count)
        return;
    const Scene scene = {params, nodes, triangle_blocks, sphere_blocks, triangles, corners, spheres, 0, 0, 0, 0, 0};
    float3 o = (float3)(rays[i], rays[i + count], rays[i + 2u * count]);
    float3 d = (float3)(rays[i + 3u * count], rays[i + 4u * count], rays[i + 5u * count]);
    int id = -1, hits = 0, again = 0, escaped = 0;
    for (int step = 0; step <= steps && !escaped; ++step) {
        Ray ray = ray_make(o, d, INFINITY, id);
        Hit hit;
        escaped = !bvh_hit(&scene, &ray, false, &hit);
        if (escaped)
            break;
        ++hits;
        again += hit.id == id && id < params->triangle_count;
        id = hit.id;
        Surface si = surface_at(&scene, &ray, &hit, 1u);
        uint seed = hash_uint(i) + (uint)step;
        float3 side = both_sides && (hash_uint(~seed) & 1u) ? -si.ng : si.ng;
        o = spawn_point(&si, side);
        d = random_direction(seed, side);
    }
    counts[i] = hits;
    counts[i + count] = again;
    counts[i + 2u * count] = escaped;
}
