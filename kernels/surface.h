/* What the hits of a packet found: place, normals, texture coordinates and material, computed once per hit that is shaded. */
#ifndef PYRT_SURFACE_H
#define PYRT_SURFACE_H

#include "triangle.h"

typedef struct {
    Vec p;
    Vec ng;      /* unit geometric normal, on the ray's side */
    Vec n;       /* unit shading normal, on the same side as ng */
    Vec2 uv;
    Real offset; /* bound on the error of p along ng */
    Int front;   /* mask: the ray came from the front side */
    Int id;
    Int material; /* or -1 */
    Int light;    /* or -1 */
} Surface;

/* The surface of one lane, as far as specular paths need it. */
#if PACKET == 1
typedef Surface LaneSurface;
INLINE LaneSurface surface_lane(const Surface *si, int lane) { return *si; }
#else
typedef struct {
    float3 p, ng, n;
    float offset;
    int front;
    int id;
} LaneSurface;

INLINE LaneSurface surface_lane(const Surface *si, int lane)
{
    LaneSurface at = {vec_lane(&si->p, lane), vec_lane(&si->ng, lane), vec_lane(&si->n, lane),
                      real_lane(&si->offset, lane), int_lane(&si->front, lane), int_lane(&si->id, lane)};
    return at;
}
#endif

/* The triangles that the lanes hit. */
typedef struct {
    Vec v0, e1, e2, n;
    Real offset;
    Int material, light, corners;
} Triangles;

/* `lanes`: those that hit a triangle; what others get has no meaning. Neighbours mostly hit the same one. */
INLINE Triangles triangles_at(const Scene *scene, const Int *id, uint lanes)
{
    Triangles out;
    int first;
    if (all_same(id, lanes, &first)) {
        const global Triangle *tri = &scene->triangles[first];
        out.v0 = vec_load(tri->v0);
        out.e1 = vec_load(tri->e1);
        out.e2 = vec_load(tri->e2);
        out.n = vec_load(tri->n);
        out.offset = (Real)(tri->offset);
        out.material = (Int)(tri->material);
        out.light = (Int)(tri->light);
        out.corners = (Int)(tri->corners);
        return out;
    }
    for (int lane = 0; lane < PACKET; ++lane) {
        const global Triangle *tri = &scene->triangles[lanes >> lane & 1u ? int_lane(id, lane) : first];
        vec_set(&out.v0, lane, load3(tri->v0));
        vec_set(&out.e1, lane, load3(tri->e1));
        vec_set(&out.e2, lane, load3(tri->e2));
        vec_set(&out.n, lane, load3(tri->n));
        real_set(&out.offset, lane, tri->offset);
        int_set(&out.material, lane, tri->material);
        int_set(&out.light, lane, tri->light);
        int_set(&out.corners, lane, tri->corners);
    }
    return out;
}

/* The hit point, but not nearer to an edge than EDGE_MARGIN, in units of the normalised scene: rounded, it might lie behind
 * the neighbour, and a ray that leaves would miss that. Of a thin triangle, EDGE_SHARE of its height must do. */
#define EDGE_MARGIN 0x1p-18f
#define EDGE_SHARE 0x1p-6f

INLINE Vec triangle_point(const Triangles *tri, const Hits *hits)
{
    Real u = hits->u, v = hits->v, w = 1.0f - u - v, share = (Real)(EDGE_SHARE);
    if (lanes_of(min1(u, min1(v, w)) < share) != 0u) {
        Vec e3 = sub3(tri->e2, tri->e1), area = cross3(tri->e1, tri->e2);
        Real scale = EDGE_MARGIN / sqrt1(dot3(area, area));
        u = max1(u, min1(sqrt1(dot3(tri->e2, tri->e2)) * scale, share));
        v = max1(v, min1(sqrt1(dot3(tri->e1, tri->e1)) * scale, share));
        w = max1(w, min1(sqrt1(dot3(e3, e3)) * scale, share));
    }
    Real inv_sum = 2.0f - (u + v + w); /* the sum is near 1 */
    return madd3(tri->e2, v * inv_sum, madd3(tri->e1, u * inv_sum, tri->v0));
}

/* Texture coordinates and normals that vary over a triangle, for one lane. */
INLINE void corners_at(const Scene *scene, const global Corners *c, const Hits *hits, int lane, Surface *si)
{
    float u = real_lane(&hits->u, lane), v = real_lane(&hits->v, lane), w = 1.0f - u - v;
    if (HAS_TEXTURES) {
        float2 uv = w * vload2(0, c->uv[0]) + u * vload2(0, c->uv[1]) + v * vload2(0, c->uv[2]);
        vec2_set(&si->uv, lane, uv);
    }
    if (HAS_SMOOTH_NORMALS) {
        float3 n = w * load3(c->n[0]) + u * load3(c->n[1]) + v * load3(c->n[2]);
        float length2 = dot3(n, n);
        if (length2 > 0.0f)
            vec_set(&si->n, lane, n * (1.0f / sqrt1(length2)));
    }
}

INLINE void triangle_surfaces(const Scene *scene, const Hits *hits, uint lanes, Surface *si)
{
    Triangles tri = triangles_at(scene, &hits->id, lanes);
    si->p = triangle_point(&tri, hits);
    si->ng = tri.n;
    si->n = tri.n;
    si->uv.x = hits->u + hits->v;
    si->uv.y = hits->v;
    si->offset = tri.offset;
    si->material = tri.material;
    si->light = tri.light;
    if (HAS_CORNERS)
        for (uint rest = lanes & lanes_of(tri.corners >= 0); rest != 0u; rest &= rest - 1u) {
            int lane = lowest_bit(rest);
            corners_at(scene, &scene->corners[int_lane(&tri.corners, lane)], hits, lane, si);
        }
}

INLINE void sphere_surface(const Scene *scene, float3 o, float3 d, const Hits *hits, int lane, Surface *si)
{
    const global Sphere *sphere = &scene->spheres[int_lane(&hits->id, lane) - scene->params->triangle_count];
    float3 center = load3(sphere->center);
    float3 n = normalize3(madd3(d, real_lane(&hits->t, lane), o) - center);
    vec_set(&si->ng, lane, n);
    vec_set(&si->n, lane, n);
    vec_set(&si->p, lane, madd3(n, sphere->radius, center));
    float2 uv = (float2)(0.0f, 0.0f);
    if (HAS_TEXTURES) {
        float longitude = atan2(n.z, n.x) * (0.5f * INV_PI);
        uv = (float2)(longitude < 0.0f ? longitude + 1.0f : longitude, acos(clamp(n.y, -1.0f, 1.0f)) * INV_PI);
    }
    vec2_set(&si->uv, lane, uv);
    real_set(&si->offset, lane, sphere->offset);
    int_set(&si->material, lane, sphere->material);
    int_set(&si->light, lane, sphere->light);
}

/* `lanes`: those that hit something, at least one; what others get has no meaning. */
INLINE Surface surface_at(const Scene *scene, const Rays *rays, const Hits *hits, uint lanes)
{
    Surface si;
    uint spheres = HAS_SPHERES ? lanes & lanes_of(hits->id >= scene->params->triangle_count) : 0u;
    if (lanes != spheres)
        triangle_surfaces(scene, hits, lanes & ~spheres, &si);
    for (; spheres != 0u; spheres &= spheres - 1u) {
        int lane = lowest_bit(spheres);
        sphere_surface(scene, vec_lane(&rays->o, lane), vec_lane(&rays->d, lane), hits, lane, &si);
    }
    si.id = hits->id;
    si.front = dot3(si.ng, rays->d) < 0.0f;
    si.ng = select3(si.front, si.ng, neg3(si.ng));
    si.n = select3(dot3(si.n, si.ng) < 0.0f, neg3(si.n), si.n);
    return si;
}

/* Where a ray that leaves on the side of `n` starts: off the surface by more than the error of p. */
INLINE Vec spawn_point(const Surface *si, Vec n)
{
    return madd3(n, si->offset, si->p);
}

#endif
