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

/* The same of a packet's rays, lane by lane. */
typedef struct {
    Int kz;
    Real ox, oy, oz;
    Real sx, sy, sz;
} Shears;

INLINE Real along(Int axis, Real x, Real y, Real z)
{
    return axis == 0 ? x : axis == 1 ? y : z;
}

/* Returns the lanes that can hit something: not rays without a direction, nor what is not finite. */
INLINE uint shears_from(const Rays *rays, uint lanes, Shears *s)
{
    Vec o = rays->o, d = rays->d;
    Real x = abs1(d.x), y = abs1(d.y), z = abs1(d.z);
    Int kz = (x > y) & (x > z) ? (Int)(0) : !(x > y) & (y > z) ? (Int)(1) : (Int)(2);
    s->kz = kz;
    s->ox = along(kz, o.y, o.z, o.x);
    s->oy = along(kz, o.z, o.x, o.y);
    s->oz = along(kz, o.x, o.y, o.z);
    s->sz = 1.0f / along(kz, d.x, d.y, d.z);
    s->sx = along(kz, d.y, d.z, d.x) * s->sz;
    s->sy = along(kz, d.z, d.x, d.y) * s->sz;
    Real sum = abs1(s->ox) + abs1(s->oy) + abs1(s->oz) + abs1(s->sx) + abs1(s->sy);
    return lanes & lanes_of((s->sz != 0.0f) & (abs1(s->sz) <= 0x1p100f) & (sum < INFINITY));
}

INLINE Shear shear_lane(const Shears *s, int lane)
{
    int kz = int_lane(&s->kz, lane), kx = kz == 2 ? 0 : kz + 1, ky = kx == 2 ? 0 : kx + 1;
    Shear shear = {kx, ky, kz, real_lane(&s->ox, lane), real_lane(&s->oy, lane), real_lane(&s->oz, lane),
                   real_lane(&s->sx, lane), real_lane(&s->sy, lane), real_lane(&s->sz, lane)};
    return shear;
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

/* By the least and the largest edge function. Where both hold, all are zero. */
#define IS_INSIDE(LOW, HIGH) (((LOW) >= 0.0f) ^ ((HIGH) <= 0.0f))

/* The triangles of a block as a ray sees them: corners a, b and c sheared, z the depth, and the edge functions opposite of them. */
typedef struct {
    float8 ax, ay, az, bx, by, bz, cx, cy, cz;
    float8 u, v, w;
} Sheared;

/* Returns which of them the ray passes through, before or behind its origin. */
INLINE int8 sheared_from(const global TriangleBlock *block, const Shear *s, Sheared *e)
{
    float8 sx = -s->sx, sy = -s->sy;
    e->az = load8(block->vertex[0][s->kz]) - s->oz;
    e->ax = fma8(sx, e->az, load8(block->vertex[0][s->kx]) - s->ox);
    e->ay = fma8(sy, e->az, load8(block->vertex[0][s->ky]) - s->oy);
    e->bz = load8(block->vertex[1][s->kz]) - s->oz;
    e->bx = fma8(sx, e->bz, load8(block->vertex[1][s->kx]) - s->ox);
    e->by = fma8(sy, e->bz, load8(block->vertex[1][s->ky]) - s->oy);
    e->cz = load8(block->vertex[2][s->kz]) - s->oz;
    e->cx = fma8(sx, e->cz, load8(block->vertex[2][s->kx]) - s->ox);
    e->cy = fma8(sy, e->cz, load8(block->vertex[2][s->ky]) - s->oy);

    e->u = cross8(e->cx, e->cy, e->bx, e->by);
    e->v = cross8(e->ax, e->ay, e->cx, e->cy);
    e->w = cross8(e->bx, e->by, e->ax, e->ay);
    float8 low = min8(e->u, min8(e->v, e->w)), high = max8(e->u, max8(e->v, e->w));
    return IS_INSIDE(low, high);
}

INLINE float8 sheared_t(const Sheared *e, const Shear *s, float8 inv_det)
{
    return fma8(fma8(e->v, e->bz - e->az, e->w * (e->cz - e->az)), inv_det, e->az) * s->sz;
}

/* Tests one block. Updates *hit and returns whether it changed; with `any`, only tells whether something is hit. */
INLINE bool triangle_block_hit(const global TriangleBlock *block, const Shear *s, const Ray *ray, bool any, Hit *hit)
{
    Sheared e;
    int8 inside = sheared_from(block, s, &e);
    float8 inv_det = 1.0f / (e.u + e.v + e.w);
    float8 t = sheared_t(&e, s, inv_det);
    uint mask = mask8(inside & (t > 0.0f) & (any ? t < hit->t : t <= hit->t));
    bool changed = false;
    for (; mask != 0u; mask &= mask - 1u) {
        int lane = lowest_bit(mask);
        int id = block->id[lane];
        if (ray_skips(ray, id))
            continue;
        if (any)
            return true;
        float t_lane = ((const float *)&t)[lane];
        if (!IS_CLOSER(hit, t_lane, id))
            continue;
        float scale = ((const float *)&inv_det)[lane];
        hit->t = t_lane;
        hit->u = ((const float *)&e.v)[lane] * scale;
        hit->v = ((const float *)&e.w)[lane] * scale;
        hit->id = id;
        changed = true;
    }
    return changed;
}

/* A corner of a candidate, on one axis. */
INLINE float candidate_corner(const Scene *scene, int place, int corner, int axis)
{
    return scene->triangle_blocks[place / BVH_WIDTH].vertex[corner][axis][place % BVH_WIDTH];
}

INLINE int candidate_id(const Scene *scene, int place)
{
    return scene->triangle_blocks[place / BVH_WIDTH].id[place % BVH_WIDTH];
}

/* As triangle_block_hit for lanes whose dominant axis is kz, with some triangles of a block: the same arithmetic, with a
 * triangle and many rays in place of a ray and many triangles. */
INLINE uint triangle_block_hits_along(const global TriangleBlock *block, uint triangles, int kz, const Rays *rays,
                                      const Shears *s, uint lanes, bool any, Hits *hits)
{
    int kx = kz == 2 ? 0 : kz + 1, ky = kx == 2 ? 0 : kx + 1;
    uint found = 0u;
    for (; triangles != 0u; triangles &= triangles - 1u) {
        int i = lowest_bit(triangles);
        Real az = block->vertex[0][kz][i] - s->oz, bz = block->vertex[1][kz][i] - s->oz, cz = block->vertex[2][kz][i] - s->oz;
        Real ax = fma1(-s->sx, az, block->vertex[0][kx][i] - s->ox), ay = fma1(-s->sy, az, block->vertex[0][ky][i] - s->oy);
        Real bx = fma1(-s->sx, bz, block->vertex[1][kx][i] - s->ox), by = fma1(-s->sy, bz, block->vertex[1][ky][i] - s->oy);
        Real cx = fma1(-s->sx, cz, block->vertex[2][kx][i] - s->ox), cy = fma1(-s->sy, cz, block->vertex[2][ky][i] - s->oy);
        Real u = cross_lanes(cx, cy, bx, by), v = cross_lanes(ax, ay, cx, cy), w = cross_lanes(bx, by, ax, ay);
        Real low = min1(u, min1(v, w)), high = max1(u, max1(v, w));
        uint inside = lanes & lanes_of(IS_INSIDE(low, high));
        if (inside == 0u)
            continue;
        int id = block->id[i];
        Real inv_det = 1.0f / (u + v + w);
        Real t = fma1(fma1(v, bz - az, w * (cz - az)), inv_det, az) * s->sz;
        Int closer = IS_CLOSER(hits, t, id);
        if (RAYS_SKIP)
            closer &= !(rays->self == id | (bits_of(id - rays->light_first) < rays->light_count));
        inside &= lanes_of((t > 0.0f) & closer);
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

/* The same for all axes. Updates *hits and returns the lanes that changed; with `any`, only returns those that hit. */
INLINE uint triangle_block_hits(const global TriangleBlock *block, uint triangles, const Rays *rays, const Shears *s,
                                uint lanes, bool any, Hits *hits)
{
    uint found = 0u;
    for (int axis = 0; axis < 3; ++axis) {
        uint some = lanes & lanes_of(s->kz == axis);
        if (some != 0u)
            found |= triangle_block_hits_along(block, triangles, axis, rays, s, some, any, hits);
    }
    return found;
}

/* As bvh_hits, of a scene that is the candidates. */
NO_INLINE uint triangles_hits(const Scene *scene, const global Candidates *candidates, const Rays *rays, uint lanes, bool any,
                              Hits *hits)
{
    Shears shears;
    hits->t = rays->t_max;
    hits->id = (Int)(-1);
    if (candidates->count == 0)
        return 0u;
    lanes = shears_from(rays, lanes, &shears);
    uint found = 0u;
    for (int axis = 0; axis < 3; ++axis) {
        uint some = lanes & lanes_of(shears.kz == axis);
        for (int k = 0; k < candidates->count && some != 0u; ++k) {
            int place = candidates->places[k];
            const global TriangleBlock *block = &scene->triangle_blocks[place / BVH_WIDTH];
            uint hit = triangle_block_hits_along(block, 1u << place % BVH_WIDTH, axis, rays, &shears, some, any, hits);
            found |= hit;
            some = any ? some & ~hit : some;
        }
    }
    return found;
}

#endif
