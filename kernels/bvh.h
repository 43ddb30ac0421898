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

typedef struct {
    float inv[3];       /* 1 / direction */
    float near_add[3];  /* plane * inv + near_add = padded entry distance */
    float far_add[3];
    int near_side[3];   /* which of [low, high] a ray meets first */
} SlabRay;

INLINE SlabRay slab_ray_from(const Scene *scene, const Ray *ray, const Shear *shear)
{
    float largest = abs1(axis_of(ray->d, shear->kz));
    float smallest = max1(largest * 0x1p-40f, 0x1p-120f);
    float3 bound = (float3)(scene->params->bound[0], scene->params->bound[1], scene->params->bound[2]);
    float depth = abs1(shear->oz) + axis_of(bound, shear->kz);
    float3 d = ray->d;
    d.x = abs1(d.x) < smallest ? copysign1(smallest, d.x) : d.x;
    d.y = abs1(d.y) < smallest ? copysign1(smallest, d.y) : d.y;
    d.z = abs1(d.z) < smallest ? copysign1(smallest, d.z) : d.z;
    float3 inv = 1.0f / d;
    float3 pad = (BOX_ULPS * ULP) * (abs3(ray->o) + bound + depth) * abs3(inv);
    float3 start = -ray->o * inv;
    float3 near = start - pad, far = start + pad;
    SlabRay s = {{inv.x, inv.y, inv.z}, {near.x, near.y, near.z}, {far.x, far.y, far.z}, {inv.x < 0.0f, inv.y < 0.0f, inv.z < 0.0f}};
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

typedef struct {
    float near[BVH_STACK_SIZE];
    int child[BVH_STACK_SIZE];
    int top;
} Stack;

/* Returns the nearest of the children in `mask` and leaves the others on the stack, the farthest at the bottom. */
INLINE int stack_push_far(Stack *stack, const global BvhNode *node, uint mask, float8 near)
{
    int lane = lowest_bit(mask);
    mask &= mask - 1u;
    int best = node->child[lane];
    if (mask == 0u)
        return best;
    float best_near = ((const float *)&near)[lane];
    int base = stack->top;
    for (; mask != 0u; mask &= mask - 1u) {
        lane = lowest_bit(mask);
        int child = node->child[lane];
        float child_near = ((const float *)&near)[lane];
        if (child_near < best_near) {
            int swap_child = best;
            float swap_near = best_near;
            best = child;
            best_near = child_near;
            child = swap_child;
            child_near = swap_near;
        }
        int slot = stack->top++;
        for (; slot > base && stack->near[slot - 1] < child_near; --slot) {
            stack->near[slot] = stack->near[slot - 1];
            stack->child[slot] = stack->child[slot - 1];
        }
        stack->near[slot] = child_near;
        stack->child[slot] = child;
    }
    return best;
}

/* The same without an order, for which any hit has no use. */
INLINE int stack_push_any(Stack *stack, const global BvhNode *node, uint mask)
{
    int first = node->child[lowest_bit(mask)];
    for (mask &= mask - 1u; mask != 0u; mask &= mask - 1u)
        stack->child[stack->top++] = node->child[lowest_bit(mask)];
    return first;
}

/* Starts a query: no hit yet. False for a direction without length and for what is not finite: such a ray misses. */
INLINE bool ray_prepare(const Ray *ray, Shear *shear, Hit *hit)
{
    hit->t = ray->t_max;
    hit->id = -1;
    *shear = shear_from(ray->o, ray->d);
    float sum = abs1(shear->ox) + abs1(shear->oy) + abs1(shear->oz) + abs1(shear->sx) + abs1(shear->sy);
    return shear->sz != 0.0f && abs1(shear->sz) <= 0x1p100f && sum < INFINITY;
}

/* Updates *hit by what is below a child reference. Returns whether there is a hit. */
INLINE bool bvh_walk(const Scene *scene, int current, const Ray *ray, const Shear *shear, bool any, Hit *hit)
{
    SlabRay slabs = slab_ray_from(scene, ray, shear);
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
            bool found = HAS_SPHERES && (~current & 1) == BLOCK_SPHERES
                             ? sphere_block_hit(&scene->sphere_blocks[block], ray, any, hit)
                             : triangle_block_hit(&scene->triangle_blocks[block], shear, ray, any, hit);
            if (any && found)
                return true;
        }
        do {
            if (stack.top == 0)
                return hit->id >= 0;
            --stack.top;
        } while (!any && stack.near[stack.top] > hit->t);
        current = stack.child[stack.top];
    }
}

/* The closest hit, or with `any` some hit, with 0 < t < t_max. `any` is a constant at every call. */
INLINE bool bvh_hit(const Scene *scene, const Ray *ray, bool any, Hit *hit)
{
    Shear shear;
    return ray_prepare(ray, &shear, hit) && bvh_walk(scene, scene->params->root, ray, &shear, any, hit);
}

#if PACKET == 1

/* As bvh_hit for each of the lanes; returns those that hit. */
INLINE uint bvh_hits(const Scene *scene, const Rays *rays, uint lanes, bool any, Hits *hits)
{
    Ray ray = ray_lane(rays, 0);
    Hit hit;
    if (lanes == 0u || !bvh_hit(scene, &ray, any, &hit))
        return 0u;
    hit_set(hits, 0, &hit);
    return 1u;
}

#else

/* Rays that run into the same octant: each of them as in SlabRay; and all as intervals, which a ray enters from o[0] on at the
 * latest and leaves from o[1] on at the earliest, seen along the axis. */
typedef struct {
    Real inv[3], near_add[3], far_add[3];
    float o[3][2];
    float speed[3][2]; /* least and largest 1 / |direction| */
    int near_side[3];
} SlabRays;

INLINE bool slab_rays_axis(SlabRays *s, int axis, float8 o, float8 d, float8 smallest, float8 reach, uint lanes)
{
    uint negative = lanes & lanes_of(d < 0.0f);
    if (negative != 0u && negative != lanes)
        return false;
    int8 in = mask_of(lanes);
    float8 speed = 1.0f / max8(abs8(d), smallest), pad = (BOX_ULPS * ULP) * reach;
    float8 along = negative ? -o : o;
    s->near_side[axis] = negative != 0u;
    s->inv[axis] = negative ? -speed : speed;
    s->near_add[axis] = -(along + pad) * speed;
    s->far_add[axis] = -(along - pad) * speed;
    s->o[axis][0] = lanes_max(in ? along + 2.0f * pad : -INFINITY);
    s->o[axis][1] = lanes_min(in ? along - 2.0f * pad : INFINITY);
    s->speed[axis][0] = lanes_min(in ? speed : INFINITY);
    s->speed[axis][1] = lanes_max(in ? speed : 0.0f);
    return true;
}

/* False for rays that do not run into the same octant. */
INLINE bool slab_rays_from(const Scene *scene, const Rays *rays, uint lanes, SlabRays *s)
{
    const constant float *bound = scene->params->bound;
    Vec d = rays->d, o = rays->o;
    float8 x = abs8(o.x) + bound[0], y = abs8(o.y) + bound[1], z = abs8(o.z) + bound[2];
    float8 depth = max8(x, max8(y, z));
    float8 smallest = max8(max8(abs8(d.x), max8(abs8(d.y), abs8(d.z))) * 0x1p-40f, 0x1p-120f);
    return slab_rays_axis(s, 0, o.x, d.x, smallest, x + depth, lanes) &&
           slab_rays_axis(s, 1, o.y, d.y, smallest, y + depth, lanes) &&
           slab_rays_axis(s, 2, o.z, d.z, smallest, z + depth, lanes);
}

/* Which children some ray may hit before t_max: more than they do, but in one test of all rays. */
INLINE uint slab_hits_some(const global BvhNode *node, const SlabRays *s, float t_max, float8 *near)
{
    float8 entry = 0.0f, leave = t_max;
    for (int axis = 0; axis < 3; ++axis) {
        int side = s->near_side[axis];
        float8 low = load8(node->bounds[axis][side]), high = load8(node->bounds[axis][1 - side]);
        float8 in = (side ? -low : low) - s->o[axis][0], out = (side ? -high : high) - s->o[axis][1];
        entry = max8(entry, min8(in * s->speed[axis][0], in * s->speed[axis][1]));
        leave = min8(leave, max8(out * s->speed[axis][0], out * s->speed[axis][1]));
    }
    *near = entry;
    int8 hit = entry <= leave;
    return mask8(hit);
}

/* Which rays may hit one child before their t_max. */
INLINE uint slab_lanes(const global BvhNode *node, int child, const SlabRays *s, Real t_max)
{
    Real entry = (Real)(0.0f), leave = t_max;
    for (int axis = 0; axis < 3; ++axis) {
        int side = s->near_side[axis];
        entry = max8(entry, fma8(node->bounds[axis][side][child], s->inv[axis], s->near_add[axis]));
        leave = min8(leave, fma8(node->bounds[axis][1 - side][child], s->inv[axis], s->far_add[axis]));
    }
    return lanes_of(entry <= leave);
}

typedef struct {
    Ray ray[PACKET];
    Shear shear[PACKET];
    Hit hit[PACKET];
    Real t_max;
} Query;

typedef struct {
    float near[BVH_STACK_SIZE];
    int child[BVH_STACK_SIZE];
    uint lanes[BVH_STACK_SIZE];
    int top;
} LaneStack;

/* Puts the children that some of the lanes may hit on the stack, the nearest on top. */
INLINE void lane_stack_push(LaneStack *stack, const global BvhNode *node, const SlabRays *slabs, uint lanes, bool any,
                            float farthest, Real t_max)
{
    float8 near;
    int base = stack->top;
    for (uint mask = slab_hits_some(node, slabs, farthest, &near); mask != 0u; mask &= mask - 1u) {
        int child = lowest_bit(mask);
        uint some = lanes & slab_lanes(node, child, slabs, t_max);
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

/* Tests a block with these lanes; returns those that now hit something nearer. */
INLINE uint block_hits(const Scene *scene, int leaf, uint lanes, bool any, Query *query)
{
    int block = ~leaf >> 1;
    uint changed = 0u;
    for (; lanes != 0u; lanes &= lanes - 1u) {
        int lane = lowest_bit(lanes);
        Hit *hit = &query->hit[lane];
        bool found = HAS_SPHERES && (~leaf & 1) == BLOCK_SPHERES
                         ? sphere_block_hit(&scene->sphere_blocks[block], &query->ray[lane], any, hit)
                         : triangle_block_hit(&scene->triangle_blocks[block], &query->shear[lane], &query->ray[lane], any, hit);
        if (found) {
            changed |= 1u << lane;
            real_set(&query->t_max, lane, hit->t);
        }
    }
    return changed;
}

/* Goes on with a lane that is alone below a child; returns it if it now hits something nearer. */
INLINE uint lane_walks(const Scene *scene, int current, int lane, bool any, Query *query)
{
    Hit *hit = &query->hit[lane];
    int id = hit->id;
    bvh_walk(scene, current, &query->ray[lane], &query->shear[lane], any, hit);
    if (hit->id == id)
        return 0u;
    real_set(&query->t_max, lane, hit->t);
    return 1u << lane;
}

#define LANES_TOGETHER 3 /* from so many on one traversal is cheaper than several */

/* As bvh_hit for each of the lanes; returns those that hit. The rays of a packet mostly run together: then one traversal serves
 * all. Else each starts at the root alone, and stays so. */
NO_INLINE uint bvh_hits(const Scene *scene, const Rays *rays, uint lanes, bool any, Hits *hits)
{
    Vec sum = add3(rays->o, rays->d);
    lanes &= lanes_of(abs1(sum.x) + abs1(sum.y) + abs1(sum.z) < INFINITY); /* others miss, and would spoil the intervals */
    SlabRays slabs;
    bool together = popcount(lanes) >= LANES_TOGETHER && slab_rays_from(scene, rays, lanes, &slabs);
    Query query;
    LaneStack stack;
    uint active = 0u, found = 0u;
    query.t_max = (Real)(0.0f);
    stack.top = 0;
    for (; lanes != 0u; lanes &= lanes - 1u) {
        int lane = lowest_bit(lanes);
        query.ray[lane] = ray_lane(rays, lane);
        if (!ray_prepare(&query.ray[lane], &query.shear[lane], &query.hit[lane]))
            continue;
        active |= 1u << lane;
        real_set(&query.t_max, lane, query.ray[lane].t_max);
        if (together && stack.top > 0)
            continue;
        stack.child[stack.top] = scene->params->root;
        stack.lanes[stack.top] = together ? ALL_LANES : 1u << lane;
        stack.near[stack.top++] = 0.0f;
    }
    float farthest = lanes_max(query.t_max);
    while (stack.top > 0) {
        --stack.top;
        uint some = stack.lanes[stack.top] & active;
        if (some == 0u || (!any && stack.near[stack.top] > farthest))
            continue;
        int current = stack.child[stack.top];
        if (current >= 0 && (some & (some - 1u)) != 0u) {
            lane_stack_push(&stack, &scene->nodes[current], &slabs, some, any, farthest, query.t_max);
            continue;
        }
        uint changed = current >= 0 ? lane_walks(scene, current, lowest_bit(some), any, &query)
                                    : block_hits(scene, current, some, any, &query);
        found |= changed;
        if (any)
            active &= ~changed;
        else if (changed != 0u)
            farthest = lanes_max(query.t_max);
    }
    for (lanes = any ? 0u : found; lanes != 0u; lanes &= lanes - 1u)
        hit_set(hits, lowest_bit(lanes), &query.hit[lowest_bit(lanes)]);
    return found;
}

#endif
#endif
