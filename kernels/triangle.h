/* Watertight intersection of a ray with eight triangles.
 *
 * Woop, Benthin, Wald: Watertight Ray/Triangle Intersection, JCGT 2013. The axes are permuted so that z is the direction's
 * largest component; a shear then maps the ray onto the z axis. An edge's function is a 2D cross product of its two sheared
 * corners, and both neighbours of a shared edge find the same sign, so a ray cannot pass between: the shear of a corner uses
 * the same instructions whichever triangle it belongs to. Zero counts as inside. The products are not rounded before they are
 * subtracted, or else a ray in the plane of a triangle, where all three functions nearly vanish, would hit it from anywhere.
 * t is a convex combination of the corners' depths: a false far hit cannot occur. It is taken relative to the first corner's,
 * so that the barycentrics' rounding counts by the triangle's depth and not by its distance. Only det = 0 is rejected.
 */
#ifndef PYRT_TRIANGLE_H
#define PYRT_TRIANGLE_H

#include "scene.h"

typedef struct {
    int kx, ky, kz;    /* permuted axes, kz the dominant one */
    float ox, oy, oz;  /* permuted origin */
    float sx, sy, sz;  /* shear */
} Shear;

INLINE float axis_of(float3 v, int axis)
{
    return axis == 0 ? v.x : axis == 1 ? v.y : v.z;
}

INLINE Shear shear_from(float3 o, float3 d)
{
    float3 a = abs3(d);
    Shear s;
    s.kz = a.x > a.y ? (a.x > a.z ? 0 : 2) : (a.y > a.z ? 1 : 2);
    s.kx = s.kz == 2 ? 0 : s.kz + 1;
    s.ky = s.kx == 2 ? 0 : s.kx + 1;
    float dz = axis_of(d, s.kz);
    s.ox = axis_of(o, s.kx);
    s.oy = axis_of(o, s.ky);
    s.oz = axis_of(o, s.kz);
    s.sz = 1.0f / dz;
    s.sx = axis_of(d, s.kx) * s.sz;
    s.sy = axis_of(d, s.ky) * s.sz;
    return s;
}

/* px qy - py qx within 1.5 ulp, and so of the right sign (Jeannerod, Louvet, Muller: Further Analysis of Kahan's Algorithm
 * for the Accurate Computation of 2x2 Determinants, 2013). */
#define CROSS(NAME, REAL, FMA) \
    INLINE REAL NAME(REAL px, REAL py, REAL qx, REAL qy) \
    { \
        REAL product = py * qx; \
        return FMA(px, qy, -product) + FMA(-py, qx, product); \
    }

CROSS(cross8, float8, fma8)
CROSS(cross_lanes, Real, fma1)

/* Tests one block; with `any`, returns at the first hit. Updates *hit and returns whether it changed. */
INLINE bool triangle_block_hit(const global TriangleBlock *block, const Shear *s, const Ray *ray, bool any, Hit *hit)
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
    uint mask = mask8((low >= 0.0f) ^ (high <= 0.0f)); /* both: all are zero */
    if (mask == 0u)
        return false;

    float8 inv_det = 1.0f / (u + v + w);
    float8 t = fma8(fma8(v, bz - az, w * (cz - az)), inv_det, az) * s->sz;
    mask &= mask8((t > 0.0f) & (t <= hit->t));
    bool changed = false;
    for (; mask != 0u; mask &= mask - 1u) {
        int lane = lowest_bit(mask);
        int id = block->id[lane];
        float t_lane = ((const float *)&t)[lane];
        if (ray_skips(ray, id) || !hit_is_closer(hit, t_lane, id))
            continue;
        float scale = ((const float *)&inv_det)[lane];
        hit->t = t_lane;
        hit->u = ((const float *)&v)[lane] * scale;
        hit->v = ((const float *)&w)[lane] * scale;
        hit->id = id;
        changed = true;
        if (any)
            return true;
    }
    return changed;
}

INLINE Real component(const Vec *v, int axis)
{
    return axis == 0 ? v->x : axis == 1 ? v->y : v->z;
}

/* As bvh_hit, for lanes whose largest direction component is kz, against the first `count` triangles of a block: the same
 * arithmetic, with a triangle and many rays in place of a ray and many triangles. */
INLINE uint triangles_hits_along(const global TriangleBlock *block, int count, int kz, const Rays *rays, uint lanes, bool any,
                                 Hits *hits)
{
    int kx = kz == 2 ? 0 : kz + 1, ky = kx == 2 ? 0 : kx + 1;
    Real ox = component(&rays->o, kx), oy = component(&rays->o, ky), oz = component(&rays->o, kz);
    Real sz = 1.0f / component(&rays->d, kz);
    Real sx = component(&rays->d, kx) * sz, sy = component(&rays->d, ky) * sz;
    Real sum = abs1(ox) + abs1(oy) + abs1(oz) + abs1(sx) + abs1(sy);
    lanes &= lanes_of((sz != 0.0f) & (abs1(sz) <= 0x1p100f) & (sum < INFINITY));
    uint found = 0u;
    for (int i = 0; i < count; ++i) {
        Real az = block->vertex[0][kz][i] - oz, bz = block->vertex[1][kz][i] - oz, cz = block->vertex[2][kz][i] - oz;
        Real ax = fma1(-sx, az, block->vertex[0][kx][i] - ox), ay = fma1(-sy, az, block->vertex[0][ky][i] - oy);
        Real bx = fma1(-sx, bz, block->vertex[1][kx][i] - ox), by = fma1(-sy, bz, block->vertex[1][ky][i] - oy);
        Real cx = fma1(-sx, cz, block->vertex[2][kx][i] - ox), cy = fma1(-sy, cz, block->vertex[2][ky][i] - oy);
        Real u = cross_lanes(cx, cy, bx, by), v = cross_lanes(ax, ay, cx, cy), w = cross_lanes(bx, by, ax, ay);
        Real low = min1(u, min1(v, w)), high = max1(u, max1(v, w));
        uint inside = lanes & lanes_of((low >= 0.0f) ^ (high <= 0.0f));
        if (inside == 0u)
            continue;
        int id = block->id[i];
        Real inv_det = 1.0f / (u + v + w);
        Real t = fma1(fma1(v, bz - az, w * (cz - az)), inv_det, az) * sz;
        Int skipped = rays->self == id | (bits_of(id - rays->light_first) < rays->light_count);
        Int closer = (t < hits->t) | ((t == hits->t) & (hits->id > id));
        inside &= lanes_of((t > 0.0f) & closer & !skipped);
        found |= inside;
        if (any) {
            lanes &= ~inside;
            if (lanes == 0u)
                return found;
            continue;
        }
        Int now = mask_of(inside);
        hits->t = now ? t : hits->t;
        hits->u = now ? v * inv_det : hits->u;
        hits->v = now ? w * inv_det : hits->v;
        hits->id = now ? (Int)(id) : hits->id;
    }
    return found;
}

/* As bvh_hit for each of the lanes, of a scene that is the first `count` triangles of the block; returns those that hit. */
NO_INLINE uint triangles_hits(const global TriangleBlock *block, int count, const Rays *rays, uint lanes, bool any,
                              Hits *hits)
{
    hits->t = rays->t_max;
    hits->id = (Int)(-1);
    if (count == 0)
        return 0u;
    Real x = abs1(rays->d.x), y = abs1(rays->d.y), z = abs1(rays->d.z);
    uint along_x = lanes & lanes_of((x > y) & (x > z)), along_y = lanes & ~along_x & lanes_of(!(x > y) & (y > z));
    uint axes[3] = {along_x, along_y, lanes & ~along_x & ~along_y};
    uint found = 0u;
    for (int axis = 0; axis < 3; ++axis)
        if (axes[axis] != 0u)
            found |= triangles_hits_along(block, count, axis, rays, axes[axis], any, hits);
    return found;
}

#endif
