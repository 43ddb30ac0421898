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

INLINE float lane8(float8 v, int lane)
{
    return ((const float *)&v)[lane];
}

/* The sign of the edge function of (p, q) at a point moved by (1, eps), where it is 0 at the point itself. */
INLINE float moved_sign(float8 px, float8 py, float8 qx, float8 qy, int lane)
{
    float rise = lane8(py, lane) - lane8(qy, lane);
    return rise != 0.0f ? rise : lane8(qx, lane) - lane8(px, lane);
}

typedef struct {
    global ulong *hits;
    uint capacity;
    uint count; /* also of those that did not fit */
    bool edges; /* some hit is on an edge */
} HitList;

/* Adds the block's hits with 0 < t < t_max. */
INLINE void triangle_block_all(const global TriangleBlock *block, const Shear *s, float t_max, HitList *list)
{
    Sheared e;
    int8 inside = sheared_from(block, s, &e);
    if (mask8(inside) == 0u)
        return;
    float8 t = sheared_t(&e, s, 1.0f / (e.u + e.v + e.w));
    uint mask = mask8(inside & (t > 0.0f) & (t < t_max));
    uint edges = mask8((e.u == 0.0f) | (e.v == 0.0f) | (e.w == 0.0f));
    for (; mask != 0u; mask &= mask - 1u) {
        int lane = lowest_bit(mask);
        ulong kind = HIT_WHOLE;
        if (edges >> lane & 1u) {
            float ux = lane8(e.u, lane), vx = lane8(e.v, lane), wx = lane8(e.w, lane);
            kind = ux + vx + wx > 0.0f ? HIT_FRONT : HIT_BACK;
            ux = ux != 0.0f ? ux : moved_sign(e.cx, e.cy, e.bx, e.by, lane);
            vx = vx != 0.0f ? vx : moved_sign(e.ax, e.ay, e.cx, e.cy, lane);
            wx = wx != 0.0f ? wx : moved_sign(e.bx, e.by, e.ax, e.ay, lane);
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
NO_INLINE uint bvh_all_hits(const Scene *scene, const Query *query, int lane, float t_max, HitList *list)
{
    Shear shear = shear_lane(&query->shears, lane);
    SlabRay slabs = slab_lane(&query->slabs, lane);
    Stack stack;
    stack.top = 0;
    int current = scene->params->root;
    for (;;) {
        if (current >= 0) {
            const global BvhNode *node = &scene->nodes[current];
            float8 near;
            uint mask = slab_hits(node, &slabs, t_max, &near);
            if (mask != 0u) {
                current = stack_push_any(&stack, node, mask);
                continue;
            }
        } else {
            triangle_block_all(&scene->triangle_blocks[~current >> 1], &shear, t_max, list);
        }
        if (stack.top == 0)
            break;
        current = (int)(uint)stack.entry[--stack.top];
    }
    if (list->count > list->capacity)
        return 0u;
    hits_sort(list->hits, list->count);
    float depth = abs1(shear.oz) + scene->params->bound[shear.kz];
    return list->edges ? hits_merge(list->hits, list->count, EDGE_ULPS * ULP * depth * abs1(shear.sz)) : list->count;
}

#endif
