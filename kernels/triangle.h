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
INLINE float8 cross8(float8 px, float8 py, float8 qx, float8 qy)
{
    float8 product = py * qx;
    return fma8(px, qy, -product) + fma8(-py, qx, product);
}

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

#endif
