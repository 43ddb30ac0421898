/* Every triangle that a ray meets, in order, and each passage through the surface once.
 *
 * The test is the one of triangle.h, in which zero counts as inside: a ray through an edge or a corner meets all the triangles
 * around it, which is right for the closest hit and too many for a list of hits. So of each such group only as many stay as
 * the ray would meet if it were moved sideways by an infinitesimal (1, eps): one where it passes through, two or none where it
 * grazes an outline (Edelsbrunner, Muecke: Simulation of Simplicity, 1990; the signs of the edge functions are exact, so
 * neighbours agree). Where that leaves none, as on the border of an open mesh, the first of each side stays.
 *
 * A hit is one ulong: the bits of t > 0, then the triangle, then its kind; so numbers sort by t, then by triangle.
 */
#ifndef PYRT_ALL_HITS_H
#define PYRT_ALL_HITS_H

#include "bvh.h"

#define HIT_WHOLE 0UL /* inside the triangle */
#define HIT_OWNED 1UL /* on an edge or a corner, and met by the moved ray too */
#define HIT_FRONT 2UL /* not met by the moved ray; which side of the triangle the ray comes to */
#define HIT_BACK 3UL
#define EDGE_ULPS 16.0f /* how far apart hits on a shared edge may seem, in roundings of the farthest depth */

/* The sign of the edge function of (p, q) at a point moved by (1, eps), where it is 0 at the point itself. */
INLINE float moved_sign(float px, float py, float qx, float qy)
{
    return py != qy ? py - qy : qx - px;
}

INLINE float lane8(float8 v, int lane)
{
    return ((const float *)&v)[lane];
}

typedef struct {
    global ulong *hits;
    uint capacity;
    uint count; /* also of those that did not fit */
    bool edges; /* some hit is on an edge */
} HitList;

/* Adds the block's hits with 0 < t < t_max. The arithmetic is triangle_block_hit's. */
INLINE void triangle_block_all(const global TriangleBlock *block, const Shear *s, float t_max, HitList *list)
{
    float8 sx = -s->sx, sy = -s->sy;
    float8 az = load8(block->vertex[0][s->kz]) - s->oz;
    float8 ax = fma8(sx, az, load8(block->vertex[0][s->kx]) - s->ox);
    float8 ay = fma8(sy, az, load8(block->vertex[0][s->ky]) - s->oy);
    float8 bz = load8(block->vertex[1][s->kz]) - s->oz;
    float8 bx = fma8(sx, bz, load8(block->vertex[1][s->kx]) - s->ox);
    float8 by = fma8(sy, bz, load8(block->vertex[1][s->ky]) - s->oy);
    float8 cz = load8(block->vertex[2][s->kz]) - s->oz;
    float8 cx = fma8(sx, cz, load8(block->vertex[2][s->kx]) - s->ox);
    float8 cy = fma8(sy, cz, load8(block->vertex[2][s->ky]) - s->oy);

    float8 u = cross8(cx, cy, bx, by);
    float8 v = cross8(ax, ay, cx, cy);
    float8 w = cross8(bx, by, ax, ay);
    float8 low = min8(u, min8(v, w)), high = max8(u, max8(v, w));
    uint mask = mask8((low >= 0.0f) ^ (high <= 0.0f));
    if (mask == 0u)
        return;
    float8 inv_det = 1.0f / (u + v + w);
    float8 t = fma8(fma8(v, bz - az, w * (cz - az)), inv_det, az) * s->sz;
    mask &= mask8((t > 0.0f) & (t < t_max));
    uint edges = mask8((u == 0.0f) | (v == 0.0f) | (w == 0.0f));
    for (; mask != 0u; mask &= mask - 1u) {
        int lane = lowest_bit(mask);
        ulong kind = HIT_WHOLE;
        if (edges >> lane & 1u) {
            float ux = lane8(u, lane), vx = lane8(v, lane), wx = lane8(w, lane);
            kind = ux + vx + wx > 0.0f ? HIT_FRONT : HIT_BACK;
            ux = ux != 0.0f ? ux : moved_sign(lane8(cx, lane), lane8(cy, lane), lane8(bx, lane), lane8(by, lane));
            vx = vx != 0.0f ? vx : moved_sign(lane8(ax, lane), lane8(ay, lane), lane8(cx, lane), lane8(cy, lane));
            wx = wx != 0.0f ? wx : moved_sign(lane8(bx, lane), lane8(by, lane), lane8(ax, lane), lane8(ay, lane));
            if ((ux > 0.0f && vx > 0.0f && wx > 0.0f) || (ux < 0.0f && vx < 0.0f && wx < 0.0f))
                kind = HIT_OWNED;
            list->edges = true;
        }
        if (list->count < list->capacity)
            list->hits[list->count] = (ulong)as_uint(lane8(t, lane)) << 32 | (ulong)(uint)block->id[lane] << 2 | kind;
        ++list->count;
    }
}

/* Shell's sort, with halved gaps. */
INLINE void hits_sort(global ulong *hits, uint count)
{
    for (uint gap = count / 2u; gap > 0u; gap /= 2u)
        for (uint i = gap; i < count; ++i) {
            ulong moving = hits[i];
            uint j = i;
            for (; j >= gap && hits[j - gap] > moving; j -= gap)
                hits[j] = hits[j - gap];
            hits[j] = moving;
        }
}

INLINE float hit_t(ulong hit)
{
    return as_float((uint)(hit >> 32));
}

/* Leaves of every group of sorted hits on edges, within `apart` of each other, those that count; returns how many hits remain. */
INLINE uint hits_merge(global ulong *hits, uint count, float apart)
{
    uint kept = 0u;
    for (uint i = 0u, end; i < count; i = end) {
        uint owned = 0u, first = count;
        float reach = -1.0f;
        for (end = i; end < count && (end == i || hit_t(hits[end]) <= reach); ++end) {
            ulong kind = hits[end] & 3UL;
            owned += kind == HIT_OWNED;
            if (kind != HIT_WHOLE)
                reach = hit_t(hits[end]) + apart;
            if (kind != HIT_WHOLE && first == count)
                first = end;
        }
        bool front = false, back = false;
        for (uint j = i; j < end; ++j) {
            ulong kind = hits[j] & 3UL;
            bool keep = kind == HIT_WHOLE || (owned == 1u ? j == first : owned > 1u ? kind == HIT_OWNED
                                              : kind == HIT_FRONT ? !front : !back);
            front |= kind == HIT_FRONT;
            back |= kind == HIT_BACK;
            if (keep)
                hits[kept++] = hits[j];
        }
    }
    return kept;
}

/* Fills the list with all hits with 0 < t < t_max, in order if they fit; returns how many there are after merging, or 0 if
 * they do not fit. */
NO_INLINE uint bvh_all_hits(const Scene *scene, const Ray *ray, HitList *list)
{
    Shear shear;
    Hit none;
    if (!ray_prepare(ray, &shear, &none))
        return 0u;
    SlabRay slabs = slab_ray_from(scene, ray, &shear);
    Stack stack;
    stack.top = 0;
    int current = scene->params->root;
    for (;;) {
        if (current >= 0) {
            const global BvhNode *node = &scene->nodes[current];
            float8 near;
            uint mask = slab_hits(node, &slabs, ray->t_max, &near);
            if (mask != 0u) {
                current = stack_push_any(&stack, node, mask);
                continue;
            }
        } else {
            triangle_block_all(&scene->triangle_blocks[~current >> 1], &shear, ray->t_max, list);
        }
        if (stack.top == 0)
            break;
        current = stack.child[--stack.top];
    }
    if (list->count > list->capacity)
        return 0u;
    hits_sort(list->hits, list->count);
    float depth = abs1(shear.oz) + scene->params->bound[shear.kz];
    return list->edges ? hits_merge(list->hits, list->count, EDGE_ULPS * ULP * depth * abs1(shear.sz)) : list->count;
}

#endif
