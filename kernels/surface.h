/* What a hit found: place, normals, texture coordinates and material, computed once per hit that is shaded. */
#ifndef PYRT_SURFACE_H
#define PYRT_SURFACE_H

#include "scene.h"

typedef struct {
    float3 p;
    float3 ng;    /* unit geometric normal, on the ray's side */
    float3 n;     /* unit shading normal, on the same side as ng */
    float2 uv;
    float offset; /* bound on the error of p along ng */
    bool front;   /* the ray came from the front side */
    int id;
    int material; /* or -1 */
    int light;    /* or -1 */
} Surface;

/* The hit point, but not nearer to an edge than EDGE_MARGIN of the triangle's height: rounded, it might lie behind the
 * neighbour, and a ray that leaves would miss that. */
#define EDGE_MARGIN 0x1p-18f

INLINE float3 triangle_point(const global Triangle *tri, const Hit *hit)
{
    float u = max1(hit->u, EDGE_MARGIN), v = max1(hit->v, EDGE_MARGIN), w = max1(1.0f - hit->u - hit->v, EDGE_MARGIN);
    float inv_sum = 2.0f - (u + v + w); /* the sum is near 1 */
    return madd3(load3(tri->e2), v * inv_sum, madd3(load3(tri->e1), u * inv_sum, load3(tri->v0)));
}

INLINE Surface triangle_surface(const Scene *scene, const Hit *hit)
{
    const global Triangle *tri = &scene->triangles[hit->id];
    Surface si;
    si.p = triangle_point(tri, hit);
    si.ng = load3(tri->n);
    si.n = si.ng;
    si.uv = (float2)(hit->u + hit->v, hit->v);
    si.offset = tri->offset;
    si.material = tri->material;
    si.light = tri->light;
    if (HAS_CORNERS && tri->corners >= 0) {
        const global Corners *c = &scene->corners[tri->corners];
        float w = 1.0f - hit->u - hit->v;
        if (HAS_TEXTURES)
            si.uv = w * vload2(0, c->uv[0]) + hit->u * vload2(0, c->uv[1]) + hit->v * vload2(0, c->uv[2]);
        if (HAS_SMOOTH_NORMALS) {
            float3 n = w * load3(c->n[0]) + hit->u * load3(c->n[1]) + hit->v * load3(c->n[2]);
            float length2 = dot3(n, n);
            si.n = length2 > 0.0f ? n * (1.0f / sqrt1(length2)) : si.ng;
        }
    }
    return si;
}

INLINE Surface sphere_surface(const Scene *scene, const Ray *ray, const Hit *hit)
{
    const global Sphere *sphere = &scene->spheres[hit->id - scene->params->triangle_count];
    float3 center = load3(sphere->center);
    Surface si;
    si.ng = normalize3(madd3(ray->d, hit->t, ray->o) - center);
    si.n = si.ng;
    si.p = madd3(si.ng, sphere->radius, center);
    si.uv = (float2)(0.0f, 0.0f);
    if (HAS_TEXTURES) {
        float longitude = atan2(si.ng.z, si.ng.x) * (0.5f * INV_PI);
        si.uv = (float2)(longitude < 0.0f ? longitude + 1.0f : longitude, acos(clamp(si.ng.y, -1.0f, 1.0f)) * INV_PI);
    }
    si.offset = sphere->offset;
    si.material = sphere->material;
    si.light = sphere->light;
    return si;
}

INLINE Surface surface_at(const Scene *scene, const Ray *ray, const Hit *hit)
{
    bool is_sphere = HAS_SPHERES && hit->id >= scene->params->triangle_count;
    Surface si = is_sphere ? sphere_surface(scene, ray, hit) : triangle_surface(scene, hit);
    si.id = hit->id;
    si.front = dot3(si.ng, ray->d) < 0.0f;
    if (!si.front)
        si.ng = -si.ng;
    if (dot3(si.n, si.ng) < 0.0f)
        si.n = -si.n;
    return si;
}

/* Where a ray that leaves on the side of `n` starts: off the surface by more than the error of p. */
INLINE float3 spawn_point(const Surface *si, float3 n)
{
    return madd3(n, si->offset, si->p);
}

#endif
