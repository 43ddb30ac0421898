/* What camera rays meet, for the channels beside the picture (AOVs). One work-item per pixel.
 *
 * Where on a primitive a ray hits it is left to the host, which has float64: pyrt/aov.py.
 */
#include "bsdf.h"
#include "bvh.h"
#include "camera.h"

/* The primitive behind the centre of a pixel, or -1. */
NO_INLINE int primitive_behind(const Scene *scene, uint pixel)
{
    float3 o, d;
    camera_ray(&scene->params->camera, (float)(pixel & 0xffffu) + 0.5f, (float)(pixel >> 16) + 0.5f, &o, &d);
    Ray ray = ray_make(o, d, INFINITY, -1);
    Hit hit;
    bvh_hit(scene, &ray, false, &hit);
    return hit.id;
}

kernel __attribute__((reqd_work_group_size(LOCAL_SIZE, 1, 1)))
void aov_primitives(uint count, constant SceneParams *params, const global BvhNode *nodes,
                    const global TriangleBlock *triangle_blocks, const global SphereBlock *sphere_blocks,
                    const global uint *pixels, global int *ids)
{
    uint i = (uint)get_global_id(0);
    if (i >= count)
        return;
    const Scene scene = {params, nodes, triangle_blocks, sphere_blocks, 0, 0, 0, 0, 0, 0, 0, 0};
    ids[i] = primitive_behind(&scene, pixels[i]);
}

/* A ray that counts for `weight` of its sample. */
typedef struct {
    float3 o;
    float3 d;
    float weight;
    int depth; /* specular events so far */
    int self;  /* the primitive it leaves, or -1 */
} Probe;

typedef struct {
    float3 albedo;
    float3 normal;
} Features;

#define MAX_PROBES 8
#define NEGLIGIBLE (1.0f / 64.0f)

INLINE Probe probe_leave(const Probe *from, const Surface *si, float3 d, float share)
{
    float3 side = dot3(d, si->ng) < 0.0f ? -si->ng : si->ng;
    Probe probe = {spawn_point(si, side), d, from->weight * share, from->depth + 1, si->id};
    return probe;
}

/* The share of the colour that a matte surface reflects; 1 for one that is specular. */
INLINE float3 surface_albedo(const Scene *scene, const Surface *si)
{
    if (si->material < 0)
        return (float3)(0.0f);
    const global Material *material = &scene->materials[si->material];
    if (HAS_SPECULAR && bsdf_is_specular(material))
        return (float3)(1.0f);
    return si->front || material->twosided ? texture_color(scene, material->texture, si->uv) : (float3)(0.0f);
}

/* Albedo and normal of the first surface that is not specular, or of the one after `depth` specular ones. Where a ray splits,
 * the weights are Fresnel's and sum to 1; a negligible part goes to the other ray, so there is no noise. */
NO_INLINE Features features_along(const Scene *scene, float3 o, float3 d, int depth)
{
    Features sum = {(float3)(0.0f), (float3)(0.0f)};
    Probe probes[MAX_PROBES];
    int count = 1;
    probes[0].o = o;
    probes[0].d = d;
    probes[0].weight = 1.0f;
    probes[0].depth = 0;
    probes[0].self = -1;
    while (count > 0) {
        Probe probe = probes[--count];
        Ray ray = ray_make(probe.o, probe.d, INFINITY, probe.self);
        Hit hit;
        if (!bvh_hit(scene, &ray, false, &hit))
            continue;
        Surface si = surface_at(scene, &ray, &hit, 1u);
        if (HAS_SPECULAR && si.material >= 0 && probe.depth < depth && bsdf_is_specular(&scene->materials[si.material])) {
            Specular s = bsdf_specular(&scene->materials[si.material], &si, probe.d);
            bool split = probe.weight * min1(s.reflectance, 1.0f - s.reflectance) >= NEGLIGIBLE && count + 2 <= MAX_PROBES;
            float reflected = split ? s.reflectance : s.reflectance > 0.5f ? 1.0f : 0.0f;
            if (reflected > 0.0f)
                probes[count++] = probe_leave(&probe, &si, s.reflected, reflected);
            if (reflected < 1.0f)
                probes[count++] = probe_leave(&probe, &si, s.refracted, 1.0f - reflected);
            continue;
        }
        sum.albedo += probe.weight * surface_albedo(scene, &si);
        sum.normal += probe.weight * si.n;
    }
    return sum;
}

/* Means over the first `samples` samples of each pixel: planes of albedo r g b and normal x y z. */
kernel __attribute__((reqd_work_group_size(LOCAL_SIZE, 1, 1)))
void aov_features(uint count, uint samples, uint seed, int depth, constant SceneParams *params,
                  const global BvhNode *nodes, const global TriangleBlock *triangle_blocks,
                  const global SphereBlock *sphere_blocks, const global Triangle *triangles,
                  const global Corners *corners, const global Sphere *spheres, const global Material *materials,
                  const global Texture *textures, const global float *texels, const global Light *lights,
                  const global uint *cdf, const global uint *pixels, global float *planes)
{
    uint i = (uint)get_global_id(0);
    if (i >= count)
        return;
    const Scene scene = {params, nodes, triangle_blocks, sphere_blocks, triangles, corners,
                         spheres, materials, textures, texels, lights, cdf};
    Features sum = {(float3)(0.0f), (float3)(0.0f)};
    uint x = pixels[i] & 0xffffu, y = pixels[i] >> 16;
    for (uint s = 0u; s < samples; ++s) {
        Sampler sampler = {hash_uint(pixels[i] ^ hash_uint(seed + 0x51633e2du)), s};
        float2 jitter = sample_2d(sampler, 0u);
        float3 o, d;
        camera_ray(&params->camera, (float)x + jitter.x, (float)y + jitter.y, &o, &d);
        Features features = features_along(&scene, o, d, depth);
        sum.albedo += features.albedo;
        sum.normal += features.normal;
    }
    float scale = 1.0f / (float)samples;
    for (int c = 0; c < 3; ++c) {
        planes[i + (size_t)c * count] = scale * axis_of(sum.albedo, c);
        planes[i + (size_t)(c + 3) * count] = scale * axis_of(sum.normal, c);
    }
}
