/* Ray queries in the caller's coordinates (see rays.h): one work-item for PACKET rays. */
#define RAYS_SKIP 0
#include "all_hits.h"
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
    uint first = (uint)get_global_id(0) * PACKET;
    if (first >= count)
        return;
    const Scene scene = trace_scene(params, nodes, blocks);
    Rays rays;
    RayFrames frames;
    Hits hits;
    uint lanes = rays_load(space, origins, directions, limits, stride, first, count, &rays, &frames, invalid);
    uint found = bvh_hits(&scene, &rays, lanes, false, &hits);
    rays_store_distances(&frames, &hits.t, found, first, count, t);
    for (uint lane = 0u; lane < PACKET && first + lane < count; ++lane) {
        uint i = first + lane;
        bool hit = found >> lane & 1u;
        ids[i] = hit ? int_lane(&hits.id, lane) : -1;
        u[i] = hit ? real_lane(&hits.u, lane) : (real)0;
        v[i] = hit ? real_lane(&hits.v, lane) : (real)0;
    }
}

kernel __attribute__((reqd_work_group_size(LOCAL_SIZE, 1, 1)))
void trace_any(uint count, constant SceneParams *params, const global BvhNode *nodes, const global TriangleBlock *blocks,
               constant real *space, const global real *origins, const global real *directions,
               const global real *limits, uint stride, global uint *invalid, global uchar *occluded)
{
    uint first = (uint)get_global_id(0) * PACKET;
    if (first >= count)
        return;
    const Scene scene = trace_scene(params, nodes, blocks);
    Rays rays;
    RayFrames frames;
    Hits hits;
    uint lanes = rays_load(space, origins, directions, limits, stride, first, count, &rays, &frames, invalid);
    uint found = bvh_hits(&scene, &rays, lanes, true, &hits);
    for (uint lane = 0u; lane < PACKET && first + lane < count; ++lane)
        occluded[first + lane] = found >> lane & 1u;
}

/* All hits of ray i, from hits[starts[i]] to hits[starts[i + 1] - 1]. `found` counts them, `kept` what is left after merging:
 * 0 where more were found than there is room for. */
kernel __attribute__((reqd_work_group_size(LOCAL_SIZE, 1, 1)))
void trace_all(uint count, constant SceneParams *params, const global BvhNode *nodes, const global TriangleBlock *blocks,
               constant real *space, const global real *origins, const global real *directions,
               const global real *limits, uint stride, const global long *starts, global uint *invalid,
               global uint *found, global uint *kept, global ulong *hits)
{
    uint first = (uint)get_global_id(0) * PACKET;
    if (first >= count)
        return;
    const Scene scene = trace_scene(params, nodes, blocks);
    Rays rays;
    RayFrames frames;
    Query query;
    uint lanes = rays_load(space, origins, directions, limits, stride, first, count, &rays, &frames, invalid);
    lanes = query_from(&scene, &rays, lanes, &query);
    for (uint lane = 0u; lane < PACKET && first + lane < count; ++lane) {
        uint i = first + lane;
        HitList list = {hits + starts[i], (uint)(starts[i + 1] - starts[i]), 0u, false};
        bool valid = lanes >> lane & 1u;
        kept[i] = valid ? bvh_all_hits(&scene, &query, lane, real_lane(&rays.t_max, lane), &list) : 0u;
        found[i] = list.count;
    }
}

#if HAS_DOUBLE

/* Hit h is number places[h] of `hits` and belongs to rays[h]: its triangle, and its t on the caller's ray. */
kernel __attribute__((reqd_work_group_size(LOCAL_SIZE, 1, 1)))
void trace_unpack(uint count, constant double *space, const global double *origins, const global double *directions,
                  const global double *limits, uint stride, const global ulong *hits, const global long *places,
                  const global long *rays, global long *triangles, global double *t)
{
    uint h = (uint)get_global_id(0);
    if (h >= count)
        return;
    ulong hit = hits[places[h]];
    Ray ray;
    RayFrame frame;
    ray_load(space, origins, directions, limits, stride, (uint)rays[h], &ray, &frame);
    triangles[h] = (long)((hit & 0xffffffffUL) >> 2);
    t[h] = ray_distance(&frame, hit_t(hit));
}

INLINE double dot_double(double3 a, double3 b)
{
    return a.x * b.x + a.y * b.y + a.z * b.z;
}

/* The point where ray h meets the plane of triangles[h], at most as far as the triangle reaches along the ray; so a ray that
 * nearly lies in the plane finds a point on the triangle too. corners: (m, 3, 3), normalised. */
kernel __attribute__((reqd_work_group_size(LOCAL_SIZE, 1, 1)))
void trace_points(uint count, constant double *space, const global double *corners, const global double *origins,
                  const global double *directions, const global long *triangles, global double *points)
{
    uint h = (uint)get_global_id(0);
    if (h >= count)
        return;
    double3 origin = load_point(origins, h), d = load_point(directions, h);
    double3 o = (origin - (double3)(space[0], space[1], space[2])) * space[3];
    int shift = exponent_of(largest_bits(d));
    d = (double3)(times_power(d.x, -shift), times_power(d.y, -shift), times_power(d.z, -shift));
    size_t first = 3 * (size_t)triangles[h];
    double3 a = load_point(corners, first), b = load_point(corners, first + 1), c = load_point(corners, first + 2);
    double3 e = b - a, f = c - a, p = a - o, q = b - o, r = c - o;
    double3 n = (double3)(e.y * f.z - e.z * f.y, e.z * f.x - e.x * f.z, e.x * f.y - e.y * f.x);
    double length = dot_double(d, d);
    double ta = dot_double(p, d) / length, tb = dot_double(q, d) / length, tc = dot_double(r, d) / length;
    double low = ta < tb ? ta : tb, high = ta > tb ? ta : tb;
    low = low < tc ? low : tc;
    high = high > tc ? high : tc;
    double t = dot_double(p, n) / dot_double(d, n);
    t = t > low ? t : low; /* also if it is not a number */
    t = t < high ? t : high;
    double3 point = origin + t / space[3] * d;
    points[3 * (size_t)h] = point.x;
    points[3 * (size_t)h + 1] = point.y;
    points[3 * (size_t)h + 2] = point.z;
}

#endif
