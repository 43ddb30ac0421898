/* One traversal of the 8-wide BVH for closest and any hit.
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

/* The closest hit, or with `any` some hit, with 0 < t < t_max. `any` is a constant at every call. */
INLINE bool bvh_hit(const Scene *scene, const Ray *ray, bool any, Hit *hit)
{
    Shear shear;
    if (!ray_prepare(ray, &shear, hit))
        return false;
    SlabRay slabs = slab_ray_from(scene, ray, &shear);
    Stack stack;
    stack.top = 0;
    int current = scene->params->root;
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
                             : triangle_block_hit(&scene->triangle_blocks[block], &shear, ray, any, hit);
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

#endif
