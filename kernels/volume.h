/* Convex volumes that enclose bundles of rays, and the triangles that reach into them.
 *
 * A volume is an intersection of half-spaces n . x <= d with unit n, each moved outwards by more than the rounding errors of
 * the rays inside and of the triangle test. So a triangle that a ray of the bundle could hit is always found; one too
 * many only costs time. (Haines and Wallace, Shaft Culling for Efficient Ray-Traced Radiosity, 1994.)
 */
#ifndef PYRT_VOLUME_H
#define PYRT_VOLUME_H

#include "triangle.h"

#define VOLUME_PLANES 18       /* a shaft's: 6 of its box and at most 12 between the corners */
#define VOLUME_ULPS 128.0f     /* outward shift of each plane in half ulps of the scene's extent */

typedef struct {
    float3 n[VOLUME_PLANES];
    float d[VOLUME_PLANES];
    int count;
    float pad;
} Volume;

typedef struct {
    float3 low;
    float3 high;
} Box;

INLINE Volume volume_empty(const Scene *scene, float3 farthest)
{
    const constant float *bound = scene->params->bound;
    Volume volume;
    volume.count = 0;
    volume.pad = VOLUME_ULPS * ULP * (bound[0] + bound[1] + bound[2] + abs1(farthest.x) + abs1(farthest.y) + abs1(farthest.z));
    return volume;
}

/* n need not be of unit length; a plane without direction is left out. */
INLINE void volume_add(Volume *volume, float3 n, float d)
{
    float length2 = dot3(n, n);
    if (!(length2 > 1e-30f))
        return;
    float inv = 1.0f / sqrt1(length2);
    volume->n[volume->count] = n * inv;
    volume->d[volume->count++] = d * inv + volume->pad;
}

/* Which children's boxes reach into the volume. */
INLINE uint volume_node_mask(const Volume *volume, const global BvhNode *node)
{
    int8 outside = !(load8(node->bounds[0][0]) <= load8(node->bounds[0][1])); /* an empty slot */
    NO_UNROLL
    for (int i = 0; i < volume->count; ++i) {
        float3 n = volume->n[i];
        float8 x = load8(node->bounds[0][n.x < 0.0f]);
        float8 y = load8(node->bounds[1][n.y < 0.0f]);
        float8 z = load8(node->bounds[2][n.z < 0.0f]);
        outside |= !(n.x * x + n.y * y + n.z * z <= volume->d[i]);
    }
    return ~mask8(outside) & 0xffu;
}

/* Which triangles of a block reach into the volume. Unused lanes hold NaN and do not. */
INLINE uint volume_block_mask(const Volume *volume, const global TriangleBlock *block)
{
    int8 outside = (int8)(0);
    NO_UNROLL
    for (int i = 0; i < volume->count; ++i) {
        float3 n = volume->n[i];
        float8 nearest = (float8)(INFINITY);
        for (int k = 0; k < 3; ++k)
            nearest = min8(n.x * load8(block->vertex[k][0]) + n.y * load8(block->vertex[k][1]) + n.z * load8(block->vertex[k][2]),
                           nearest);
        outside |= !(nearest <= volume->d[i]);
    }
    return ~mask8(outside) & 0xffu;
}

/* Whether a sphere of the block reaches into the volume. */
INLINE bool volume_meets_spheres(const Volume *volume, const global SphereBlock *block)
{
    int8 outside = !(load8(block->radius) >= 0.0f); /* an unused lane */
    NO_UNROLL
    for (int i = 0; i < volume->count; ++i) {
        float3 n = volume->n[i];
        float8 along = n.x * load8(block->center[0]) + n.y * load8(block->center[1]) + n.z * load8(block->center[2]);
        outside |= !(along - load8(block->radius) <= volume->d[i]);
    }
    return mask8(outside) != 0xffu;
}

/* Four rays from one point, in order around a convex beam. */
typedef struct {
    float3 o[4];
    float3 d[4];
} Beam;

/* Which triangles of a block some ray of the beam may hit. With the axes sheared as in triangle.h, an edge function is linear
 * over the beam: where its four corners lie on the outer side of one edge and on the inner side of another, whichever way
 * round the triangle is, no ray between them hits. */
INLINE uint beam_block_mask(const Beam *beam, const global TriangleBlock *block, float pad)
{
    int8 negative[3] = {(int8)(-1), (int8)(-1), (int8)(-1)}, positive[3] = {(int8)(-1), (int8)(-1), (int8)(-1)};
    Shear first = shear_from(beam->o[0], beam->d[0]);
    NO_UNROLL
    for (int i = 0; i < 4; ++i) {
        Shear s = shear_from(beam->o[i], beam->d[i]);
        if (s.kz != first.kz || (s.sz < 0.0f) != (first.sz < 0.0f))
            return 0xffu; /* the shear would not be linear over the beam */
        float8 x[3], y[3];
        for (int k = 0; k < 3; ++k) {
            float8 z = load8(block->vertex[k][s.kz]) - s.oz;
            x[k] = load8(block->vertex[k][s.kx]) - s.ox - s.sx * z;
            y[k] = load8(block->vertex[k][s.ky]) - s.oy - s.sy * z;
        }
        for (int k = 0; k < 3; ++k) {
            int b = k == 2 ? 0 : k + 1;
            float8 edge = x[b] * y[k] - y[b] * x[k];
            float8 margin = pad * (abs8(x[b]) + abs8(y[b]) + abs8(x[k]) + abs8(y[k]));
            negative[k] &= edge < -margin;
            positive[k] &= edge > margin;
        }
    }
    int8 missed = (negative[0] | negative[1] | negative[2]) & (positive[0] | positive[1] | positive[2]);
    return ~mask8(missed) & 0xffu;
}

/* Whether lane `lane` of a block lies on or behind the plane of every receiver, as seen from where the beam came. Rays leave a
 * receiver from at least half its offset in front of it (see spawn_point), so such a triangle cannot be in their way. */
INLINE bool behind_receivers(const Scene *scene, const global Candidates *receivers, const Beam *beam,
                             const global TriangleBlock *block, int lane)
{
    NO_UNROLL
    for (int i = 0; i < receivers->count; ++i) {
        const global Triangle *tri = &scene->triangles[candidate_id(scene, receivers->places[i])];
        float3 n = load3(tri->n), v0 = load3(tri->v0);
        float side = dot3(n, beam->d[0]) < 0.0f ? 1.0f : -1.0f;
        for (int k = 0; k < 4; ++k)
            if (!(side * dot3(n, beam->d[k]) < 0.0f))
                return false; /* seen edge-on */
        for (int k = 0; k < 3; ++k) {
            float3 to = (float3)(block->vertex[k][0][lane], block->vertex[k][1][lane], block->vertex[k][2][lane]) - v0;
            float error = 3.0f * ULP * dot3(abs3(n), abs3(to));
            if (!(side * dot3(n, to) + error <= 0.5f * tri->offset))
                return false;
        }
    }
    return true;
}

/* Gathers the triangles that some ray of the bundle may hit. For a beam, `receivers` is 0. For a shaft they are the beam's
 * candidates, and the light's own primitives, `light_count` from `light_first` on, are left out. More triangles than
 * `limit`, or a sphere, leave the candidates unknown. */
INLINE void volume_collect(const Scene *scene, const Volume *volume, const Beam *beam, const global Candidates *receivers,
                           int light_first, uint light_count, int limit, global Candidates *out)
{
    int stack[BVH_STACK_SIZE];
    int top = 0, count = 0;
    stack[top++] = scene->params->root;
    while (top > 0) {
        int reference = stack[--top];
        if (reference >= 0) {
            const global BvhNode *node = &scene->nodes[reference];
            for (uint mask = volume_node_mask(volume, node); mask != 0u; mask &= mask - 1u)
                stack[top++] = node->child[lowest_bit(mask)];
            continue;
        }
        if (HAS_SPHERES && (~reference & 1) == BLOCK_SPHERES) {
            if (volume_meets_spheres(volume, &scene->sphere_blocks[~reference >> 1]))
                return;
            continue;
        }
        int index = ~reference >> 1;
        const global TriangleBlock *block = &scene->triangle_blocks[index];
        uint mask = volume_block_mask(volume, block);
        if (!receivers && mask != 0u)
            mask &= beam_block_mask(beam, block, volume->pad);
        for (; mask != 0u; mask &= mask - 1u) {
            int lane = lowest_bit(mask);
            int id = block->id[lane];
            if ((uint)(id - light_first) < light_count)
                continue;
            if (receivers && behind_receivers(scene, receivers, beam, block, lane))
                continue;
            if (count == limit)
                return;
            out->places[count++] = BVH_WIDTH * index + lane;
        }
    }
    out->count = count;
}

/* The convex hull of two boxes: the box around both, and the planes through an edge of each that separate outside from
 * inside in one of the three axis-aligned projections. */
INLINE void volume_add_hull(Volume *volume, Box a, Box b)
{
    float low[2][3] = {{a.low.x, a.low.y, a.low.z}, {b.low.x, b.low.y, b.low.z}};
    float high[2][3] = {{a.high.x, a.high.y, a.high.z}, {b.high.x, b.high.y, b.high.z}};
    NO_UNROLL
    for (int i = 0; i < 3; ++i) {
        float3 axis = (float3)(i == 0, i == 1, i == 2);
        volume_add(volume, axis, max1(high[0][i], high[1][i]));
        volume_add(volume, -axis, -min1(low[0][i], low[1][i]));
        int j = i == 2 ? 0 : i + 1;
        NO_UNROLL
        for (int corner = 0; corner < 4; ++corner) {
            float sign_i = corner & 1 ? 1.0f : -1.0f, sign_j = corner & 2 ? 1.0f : -1.0f;
            float ai = corner & 1 ? high[0][i] : low[0][i], bi = corner & 1 ? high[1][i] : low[1][i];
            float aj = corner & 2 ? high[0][j] : low[0][j], bj = corner & 2 ? high[1][j] : low[1][j];
            float di = (bi - ai) * sign_i, dj = (bj - aj) * sign_j;
            if (!(di * dj < 0.0f))
                continue; /* one box's corner is outside the other's in both directions: no edge of the hull */
            float ni = abs1(dj) * sign_i, nj = abs1(di) * sign_j;
            float3 n = axis * ni + (float3)(j == 0, j == 1, j == 2) * nj;
            volume_add(volume, n, max1(ni * ai + nj * aj, ni * bi + nj * bj));
        }
    }
}

#endif
