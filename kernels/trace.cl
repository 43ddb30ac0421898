/* Ray queries: one work-item per ray, in the caller's coordinates (see rays.h). */
#include "bvh.h"
#include "rays.h"

static Scene trace_scene(constant SceneParams *params, const global BvhNode *nodes, const global TriangleBlock *blocks)
{
    Scene scene = {params, nodes, blocks, 0, 0, 0, 0, 0, 0, 0, 0, 0};
    return scene;
}

kernel __attribute__((reqd_work_group_size(LOCAL_SIZE, 1, 1)))
void trace_closest(uint count, constant SceneParams *params, const global BvhNode *nodes, const global TriangleBlock *blocks,
                   constant real *space, const global real *origins, const global real *directions,
                   const global real *limits, uint stride, global uint *invalid,
                   global real *t, global int *ids, global real *u, global real *v)
{
    uint i = (uint)get_global_id(0);
    if (i >= count)
        return;
    const Scene scene = trace_scene(params, nodes, blocks);
    Ray ray;
    RayFrame frame;
    Hit hit;
    bool valid = ray_load(space, origins, directions, limits, stride, i, &ray, &frame);
    if (!valid)
        atomic_inc(invalid);
    bool found = valid && bvh_hit(&scene, &ray, false, &hit);
    t[i] = found ? ray_distance(&frame, hit.t) : (real)INFINITY;
    ids[i] = found ? hit.id : -1;
    u[i] = found ? hit.u : (real)0;
    v[i] = found ? hit.v : (real)0;
}

kernel __attribute__((reqd_work_group_size(LOCAL_SIZE, 1, 1)))
void trace_any(uint count, constant SceneParams *params, const global BvhNode *nodes, const global TriangleBlock *blocks,
               constant real *space, const global real *origins, const global real *directions,
               const global real *limits, uint stride, global uint *invalid, global uchar *occluded)
{
    uint i = (uint)get_global_id(0);
    if (i >= count)
        return;
    const Scene scene = trace_scene(params, nodes, blocks);
    Ray ray;
    RayFrame frame;
    Hit hit;
    bool valid = ray_load(space, origins, directions, limits, stride, i, &ray, &frame);
    if (!valid)
        atomic_inc(invalid);
    occluded[i] = valid && bvh_hit(&scene, &ray, true, &hit);
}
