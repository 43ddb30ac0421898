/* Ray queries: one work-item per ray, in normalised coordinates. */
#include "bvh.h"

static Scene trace_scene(constant SceneParams *params, const global BvhNode *nodes, const global TriangleBlock *blocks)
{
    Scene scene = {params, nodes, blocks, 0, 0, 0, 0, 0, 0, 0, 0, 0};
    return scene;
}

/* rays: [component][ray], components ox oy oz dx dy dz t_max. */
static Ray trace_ray(const global float *rays, uint count, uint i)
{
    float3 o = (float3)(rays[i], rays[i + count], rays[i + 2u * (size_t)count]);
    float3 d = (float3)(rays[i + 3u * (size_t)count], rays[i + 4u * (size_t)count], rays[i + 5u * (size_t)count]);
    return ray_make(o, d, rays[i + 6u * (size_t)count], -1);
}

kernel __attribute__((reqd_work_group_size(LOCAL_SIZE, 1, 1)))
void trace_closest(uint count, constant SceneParams *params, const global BvhNode *nodes,
                   const global TriangleBlock *blocks, const global float *rays, global float *tuv, global int *ids)
{
    uint i = (uint)get_global_id(0);
    if (i >= count)
        return;
    const Scene scene = trace_scene(params, nodes, blocks);
    Ray ray = trace_ray(rays, count, i);
    Hit hit;
    bvh_hit(&scene, &ray, false, &hit);
    ids[i] = hit.id;
    tuv[i] = hit.t;
    tuv[i + count] = hit.u;
    tuv[i + 2u * (size_t)count] = hit.v;
}

kernel __attribute__((reqd_work_group_size(LOCAL_SIZE, 1, 1)))
void trace_any(uint count, constant SceneParams *params, const global BvhNode *nodes,
               const global TriangleBlock *blocks, const global float *rays, global uchar *occluded)
{
    uint i = (uint)get_global_id(0);
    if (i >= count)
        return;
    const Scene scene = trace_scene(params, nodes, blocks);
    Ray ray = trace_ray(rays, count, i);
    Hit hit;
    occluded[i] = bvh_hit(&scene, &ray, true, &hit);
}
