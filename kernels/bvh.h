/* Traversal of the 8-wide BVH for closest and any hit: of one ray, or of the rays of a packet together.
 *
 * Per node: eight padded slab tests in float8, the hit children visited from near to far, the others left on a stack. Wald,
 * Benthin, Boulos: Getting Rid of Packets, 2008, for the wide single-ray traversal; Ize: Robust BVH Ray Traversal, 2013, for
 * why boxes need padding. Here the pad covers the triangle test's own error too: a hit that the test accepts may lie outside
 * the triangle's exact box by a few rounding errors of the ray's farthest depth. The pad is added per ray and axis:
 *
 *     pad_a = BOX_ULPS * 2^-24 * (|o_a| + bound_a + |o_z| + bound_z),   z the dominant axis
 *
 * Direction components far below the largest one are replaced by a tiny one of the same sign, so that 0 * inf cannot
 * occur; over the scene's size the ray moves sideways by less than the pad.
 */
#ifndef PYRT_BVH_H
#define PYRT_BVH_H

#include "sphere.h"
#include "triangle.h"

#ifndef BOX_ULPS
#define BOX_ULPS 8.0f
#endif

/* For the slabs between the planes of each axis. */
typedef struct {
    float inv[3];       /* 1 / direction */
    float near_add[3];  /* plane * inv + near_add = padded entry distance */
    float far_add[3];
    int near_side[3];   /* which of [low, high] a ray meets first */
} SlabRay;

/* The same of a packet's rays, lane by lane. */
typedef struct {
    Real inv[3], near_add[3], far_add[3];
    Real pad[3];
} Slabs;

INLINE void slabs_axis(Slabs *s, int axis, Real o, Real d, Real smallest, Real reach)
{
    Real inv = 1.0f / (abs1(d) < smallest ? copysign1(smallest, d) : d), start = -o * inv;
    s->pad[axis] = (BOX_ULPS * ULP) * reach;
    s->inv[axis] = inv;
    s->near_add[axis] = start - s->pad[axis] * abs1(inv);
    s->far_add[axis] = start + s->pad[axis] * abs1(inv);
}

INLINE void slabs_from(const Scene *scene, const Rays *rays, const Shears *shears, Slabs *s)
{
    const constant float *bound = scene->params->bound;
    Vec o = rays->o, d = rays->d;
    Real smallest = max1(along(shears->kz, abs1(d.x), abs1(d.y), abs1(d.z)) * 0x1p-40f, (Real)(0x1p-120f));
    Real depth = abs1(shears->oz) + along(shears->kz, (Real)(bound[0]), (Real)(bound[1]), (Real)(bound[2]));
    slabs_axis(s, 0, o.x, d.x, smallest, abs1(o.x) + bound[0] + depth);
    slabs_axis(s, 1, o.y, d.y, smallest, abs1(o.y) + bound[1] + depth);
    slabs_axis(s, 2, o.z, d.z, smallest, abs1(o.z) + bound[2] + depth);
}

INLINE SlabRay slab_lane(const Slabs *slabs, int lane)
{
    float x = real_lane(&slabs->inv[0], lane), y = real_lane(&slabs->inv[1], lane), z = real_lane(&slabs->inv[2], lane);
    SlabRay s = {{x, y, z},
                 {real_lane(&slabs->near_add[0], lane), real_lane(&slabs->near_add[1], lane), real_lane(&slabs->near_add[2], lane)},
                 {real_lane(&slabs->far_add[0], lane), real_lane(&slabs->far_add[1], lane), real_lane(&slabs->far_add[2], lane)},
                 {x < 0.0f, y < 0.0f, z < 0.0f}};
    return s;
}

/* Which children the ray may hit before t_max, as a mask; their entry distances in *near. */
INLINE uint slab_hits(const global BvhNode *node, const SlabRay *s, float t_max, float8 *near)
{
    float8 nx = fma8(load8(node->bounds[0][s->near_side[0]]), s->inv[0], s->near_add[0]);
    float8 ny = fma8(load8(node->bounds[1][s->near_side[1]]), s->inv[1], s->near_add[1]);
    float8 nz = fma8(load8(node->bounds[2][s->near_side[2]]), s->inv[2], s->near_add[2]);
    float8 fx = fma8(load8(node->bounds[0][1 - s->near_side[0]]), s->inv[0], s->far_add[0]);
    float8 fy = fma8(load8(node->bounds[1][1 - s->near_side[1]]), s->inv[1], s->far_add[1]);
    float8 fz = fma8(load8(node->bounds[2][1 - s->near_side[2]]), s->inv[2], s->far_add[2]);
    float8 entry = max8(max8(nx, ny), max8(nz, 0.0f));
    float8 leave = min8(min8(fx, fy), min8(fz, t_max));
    *near = entry;
    return mask8(entry <= leave);
}

/* An entry: the bits of a child's entry distance, which sort as the distances do, then its reference. */
typedef struct {
    ulong entry[BVH_STACK_SIZE];
    int top;
} Stack;

INLINE ulong stack_entry(const global BvhNode *node, const float8 *near, int lane)
{
    return (ulong)as_uint(((const float *)near)[lane]) << 32 | (ulong)(uint)node->child[lane];
}

/* Returns the nearest of the children in `mask` and leaves the others on the stack, the farthest at the bottom. */
INLINE int stack_push_far(Stack *stack, const global BvhNode *node, uint mask, float8 near)
{
    int lane = lowest_bit(mask), base = stack->top;
    mask &= mask - 1u;
    if (mask == 0u)
        return node->child[lane];
    ulong best = stack_entry(node, &near, lane);
    for (; mask != 0u; mask &= mask - 1u) {
        ulong other = stack_entry(node, &near, lowest_bit(mask));
        ulong far = best < other ? other : best;
        best = best < other ? best : other;
        int slot = stack->top++;
        for (; slot > base && stack->entry[slot - 1] < far; --slot)
            stack->entry[slot] = stack->entry[slot - 1];
        stack->entry[slot] = far;
    }
    return (int)(uint)best;
}

/* The same in the order of the children, of which the last is likely to settle whether there is any hit. */
INLINE int stack_push_any(Stack *stack, const global BvhNode *node, uint mask)
{
    for (;;) {
        int child = node->child[lowest_bit(mask)];
        mask &= mask - 1u;
        if (mask == 0u)
            return child;
        stack->entry[stack->top++] = (ulong)(uint)child;
    }
}

INLINE bool is_triangles(int child)
{
    return child < 0 && !(HAS_SPHERES && (~child & 1) == BLOCK_SPHERES);
}

/* Rays made ready for traversal, lane by lane. */
typedef struct {
    Shears shears;
    Slabs slabs;
} Query;

/* Returns the lanes that can hit something. */
INLINE uint query_from(const Scene *scene, const Rays *rays, uint lanes, Query *query)
{
    lanes = shears_from(rays, lanes, &query->shears);
    slabs_from(scene, rays, &query->shears, &query->slabs);
    return lanes;
}

/* Updates *hit by what is below a child reference, and returns whether there is a hit; with `any`, only returns that. `any` is a
 * constant at every call. */
INLINE bool bvh_walk(const Scene *scene, int current, const Ray *ray, const Query *query, int lane, bool any, Hit *hit)
{
    Shear shear = shear_lane(&query->shears, lane);
    SlabRay slabs = slab_lane(&query->slabs, lane);
    Stack stack;
    stack.top = 0;
    for (;;) {
        if (current >= 0) {
            const global BvhNode *node = &scene->nodes[current];
            float8 near;
            uint mask = slab_hits(node, &slabs, hit->t, &near);
            if (mask != 0u) {
                current = any ? stack_push_any(&stack, node, mask) : stack_push_far(&stack, node, mask, near);
                continue;
            }
        } else {
            int block = ~current >> 1;
            bool found = is_triangles(current) ? triangle_block_hit(&scene->triangle_blocks[block], &shear, ray, any, hit)
                                               : sphere_block_hit(&scene->sphere_blocks[block], ray, any, hit);
            if (any && found)
                return true;
        }
        do {
            if (stack.top == 0)
                return !any && hit->id >= 0;
            --stack.top;
        } while (!any && (uint)(stack.entry[stack.top] >> 32) > as_uint(hit->t));
        current = (int)(uint)stack.entry[stack.top];
    }
}

#if PACKET == 1

INLINE uint bvh_hits(const Scene *scene, const Rays *rays, uint lanes, bool any, Hits *hits)
{
    Query query;
    hits->t = rays->t_max;
    hits->id = -1;
    return query_from(scene, rays, lanes, &query) && bvh_walk(scene, scene->params->root, rays, &query, 0, any, hits);
}

/* The closest hit, or with `any` whether there is one, with 0 < t < t_max. */
INLINE bool bvh_hit(const Scene *scene, const Ray *ray, bool any, Hit *hit)
{
    return bvh_hits(scene, ray, 1u, any, hit) != 0u;
}

#else

/* Rays that run into the same octant, as intervals: all enter it from o[0] on at the latest and leave it from o[1] on at the
 * earliest, seen along the axis. */
typedef struct {
    float o[3][2];
    float speed[3][2]; /* least and largest 1 / |direction| */
    int near_side[3];
} Bundle;

INLINE bool bundle_axis(Bundle *b, int axis, const Slabs *slabs, float8 o, uint lanes)
{
    float8 inv = slabs->inv[axis], pad = 2.0f * slabs->pad[axis];
    uint negative = lanes & lanes_of(inv < 0.0f);
    if (negative != 0u && negative != lanes)
        return false;
    int8 in = mask_of(lanes);
    float8 place = negative ? -o : o, speed = abs8(inv);
    b->near_side[axis] = negative != 0u;
    b->o[axis][0] = lanes_max(in ? place + pad : -INFINITY);
    b->o[axis][1] = lanes_min(in ? place - pad : INFINITY);
    b->speed[axis][0] = lanes_min(in ? speed : INFINITY);
    b->speed[axis][1] = lanes_max(in ? speed : 0.0f);
    return true;
}

/* False for rays that do not run into the same octant. */
INLINE bool bundle_from(const Rays *rays, const Slabs *slabs, uint lanes, Bundle *b)
{
    return bundle_axis(b, 0, slabs, rays->o.x, lanes) && bundle_axis(b, 1, slabs, rays->o.y, lanes) &&
           bundle_axis(b, 2, slabs, rays->o.z, lanes);
}

/* Narrows the intervals in which some ray may be inside eight boxes to those between two planes of each, seen along the axis. */
INLINE void bundle_slab(const Bundle *b, int axis, float8 low, float8 high, float8 *entry, float8 *leave)
{
    int side = b->near_side[axis];
    float8 in = (side ? -high : low) - b->o[axis][0], out = (side ? -low : high) - b->o[axis][1];
    *entry = max8(*entry, min8(in * b->speed[axis][0], in * b->speed[axis][1]));
    *leave = min8(*leave, max8(out * b->speed[axis][0], out * b->speed[axis][1]));
}

/* Which children some ray may hit before t_max: more than they do, but in one test of all rays. */
INLINE uint bundle_node(const Bundle *b, const global BvhNode *node, float t_max, float8 *near)
{
    float8 leave = t_max;
    *near = 0.0f;
    bundle_slab(b, 0, load8(node->bounds[0][0]), load8(node->bounds[0][1]), near, &leave);
    bundle_slab(b, 1, load8(node->bounds[1][0]), load8(node->bounds[1][1]), near, &leave);
    bundle_slab(b, 2, load8(node->bounds[2][0]), load8(node->bounds[2][1]), near, &leave);
    int8 hit = *near <= leave;
    return mask8(hit);
}

INLINE void bundle_corners(const Bundle *b, int axis, const global TriangleBlock *block, float8 *entry, float8 *leave)
{
    float8 p = load8(block->vertex[0][axis]), q = load8(block->vertex[1][axis]), r = load8(block->vertex[2][axis]);
    bundle_slab(b, axis, min8(p, min8(q, r)), max8(p, max8(q, r)), entry, leave);
}

/* The same of a block's triangles, by their boxes. */
INLINE uint bundle_block(const Bundle *b, const global TriangleBlock *block, float t_max)
{
    float8 entry = 0.0f, leave = t_max;
    bundle_corners(b, 0, block, &entry, &leave);
    bundle_corners(b, 1, block, &entry, &leave);
    bundle_corners(b, 2, block, &entry, &leave);
    int8 hit = entry <= leave;
    return mask8(hit);
}

INLINE void slabs_side(const Slabs *s, const Bundle *b, const global BvhNode *node, int axis, int child, Real *entry, Real *leave)
{
    int side = b->near_side[axis];
    *entry = max8(*entry, fma8(node->bounds[axis][side][child], s->inv[axis], s->near_add[axis]));
    *leave = min8(*leave, fma8(node->bounds[axis][1 - side][child], s->inv[axis], s->far_add[axis]));
}

/* Which rays may hit one child before their t_max. */
INLINE uint slabs_lanes(const Slabs *s, const Bundle *b, const global BvhNode *node, int child, Real t_max)
{
    Real entry = (Real)(0.0f), leave = t_max;
    slabs_side(s, b, node, 0, child, &entry, &leave);
    slabs_side(s, b, node, 1, child, &entry, &leave);
    slabs_side(s, b, node, 2, child, &entry, &leave);
    return lanes_of(entry <= leave);
}

typedef struct {
    float near[BVH_STACK_SIZE];
    int child[BVH_STACK_SIZE];
    uint lanes[BVH_STACK_SIZE];
    int top;
} LaneStack;

/* Puts the children that some of the lanes may hit on the stack, for closest hits the nearest on top. */
INLINE void lane_stack_push(LaneStack *stack, const global BvhNode *node, const Query *query, const Bundle *bundle, uint lanes,
                            bool any, float farthest, Real t_max)
{
    float8 near;
    int base = stack->top;
    for (uint mask = bundle_node(bundle, node, farthest, &near); mask != 0u; mask &= mask - 1u) {
        int child = lowest_bit(mask);
        uint some = lanes & slabs_lanes(&query->slabs, bundle, node, child, t_max);
        if (some == 0u)
            continue;
        float child_near = ((const float *)&near)[child];
        int slot = stack->top++;
        for (; !any && slot > base && stack->near[slot - 1] < child_near; --slot) {
            stack->near[slot] = stack->near[slot - 1];
            stack->child[slot] = stack->child[slot - 1];
            stack->lanes[slot] = stack->lanes[slot - 1];
        }
        stack->near[slot] = child_near;
        stack->child[slot] = node->child[child];
        stack->lanes[slot] = some;
    }
}

/* Traces each of the lanes below a child; returns those that now hit something nearer. */
NO_INLINE uint lanes_walk(const Scene *scene, int current, const Rays *rays, const Query *query, uint lanes, bool any, Hits *hits)
{
    uint changed = 0u;
    for (; lanes != 0u; lanes &= lanes - 1u) {
        int lane = lowest_bit(lanes);
        Ray ray = ray_lane(rays, lane);
        Hit hit = hit_lane(hits, lane);
        int id = hit.id;
        bool found = bvh_walk(scene, current, &ray, query, lane, any, &hit);
        if (any ? !found : hit.id == id)
            continue;
        changed |= 1u << lane;
        if (!any)
            hit_set(hits, lane, &hit);
    }
    return changed;
}

#define LANES_TOGETHER 3 /* from so many on, one traversal or one test of all is cheaper than one for each */

/* The closest hits of the lanes, or with `any` only which of them hit something, with 0 < t < t_max; returns those that do. The
 * rays of a packet mostly run together: then one traversal serves all. */
NO_INLINE uint bvh_hits(const Scene *scene, const Rays *rays, uint lanes, bool any, Hits *hits)
{
    Query query;
    Bundle bundle;
    LaneStack stack;
    lanes = query_from(scene, rays, lanes, &query);
    hits->t = mask_of(lanes) ? rays->t_max : 0.0f;
    hits->id = (Int)(-1);
    bool together = popcount(lanes) >= LANES_TOGETHER && bundle_from(rays, &query.slabs, lanes, &bundle);
    if (!together)
        return lanes_walk(scene, scene->params->root, rays, &query, lanes, any, hits);
    float farthest = lanes_max(hits->t);
    uint found = 0u;
    stack.child[0] = scene->params->root;
    stack.lanes[0] = lanes;
    stack.near[0] = 0.0f;
    stack.top = 1;
    while (stack.top > 0) {
        --stack.top;
        uint some = stack.lanes[stack.top] & lanes, changed;
        if (some == 0u || (!any && stack.near[stack.top] > farthest))
            continue;
        int current = stack.child[stack.top];
        if (current >= 0 && (some & (some - 1u)) != 0u) {
            lane_stack_push(&stack, &scene->nodes[current], &query, &bundle, some, any, farthest, hits->t);
            continue;
        }
        if (is_triangles(current) && popcount(some) >= LANES_TOGETHER) {
            const global TriangleBlock *block = &scene->triangle_blocks[~current >> 1];
            uint triangles = bundle_block(&bundle, block, farthest);
            changed = triangle_block_hits(block, triangles, rays, &query.shears, some, any, hits);
        } else {
            changed = lanes_walk(scene, current, rays, &query, some, any, hits);
        }
        found |= changed;
        if (any)
            lanes &= ~changed;
        else if (changed != 0u)
            farthest = lanes_max(hits->t);
    }
    return found;
}

#endif
#endif
