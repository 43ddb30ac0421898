/* The direct-light estimator: perfect refraction is followed, the first diffuse surface is lit by every light. */
#ifndef PYRT_DIRECT_H
#define PYRT_DIRECT_H

#include "bsdf.h"
#include "bvh.h"
#include "light.h"

/* What a sample did, for the statistics. */
typedef struct {
    uint specular; /* rays traced on from specular surfaces */
    uint shadow;   /* shadow rays traced */
    uint skipped;  /* shadow rays saved: the unoccluded light was exactly zero */
} Counters;

/* The segment between the two points, open at both ends, is free of everything but the light itself. */
INLINE bool light_is_visible(const Scene *scene, const Surface *si, const LightSample *s)
{
    float3 o = spawn_point(si, si->ng);
    Ray ray = ray_make(o, s->q - o, 1.0f, si->id);
    ray.light_first = s->first;
    ray.light_count = s->count;
    Hit hit;
    return !bvh_hit(scene, &ray, true, &hit);
}

/* Irradiance at the surface from all lights, one shadow ray per light that can contribute. */
INLINE float3 direct_irradiance(const Scene *scene, const Surface *si, Sampler sampler, Counters *counters)
{
    float3 sum = (float3)(0.0f);
    for (int i = 0; i < scene->params->light_count; ++i) {
        const global Light *light = &scene->lights[i];
        LightSample s = light_sample(scene, light, si, sampler, 1u + 2u * (uint)i);
        if (!(max3(s.irradiance) > 0.0f)) {
            ++counters->skipped;
            continue;
        }
        ++counters->shadow;
        if (light_is_visible(scene, si, &s))
            sum += s.irradiance;
    }
    return sum;
}

/* Radiance that arrives along the ray. A miss is black, and so is a path of more than max_depth specular events. */
INLINE float3 direct_radiance(const Scene *scene, Ray ray, Sampler sampler, Counters *counters)
{
    float3 radiance = (float3)(0.0f);
    float throughput = 1.0f;
    for (int depth = 0;; ++depth) {
        Hit hit;
        if (!bvh_hit(scene, &ray, false, &hit))
            return radiance;
        Surface si = surface_at(scene, &ray, &hit);

        /* An emitter shows its front, whatever the path came through. */
        if (HAS_AREA_LIGHTS && si.light >= 0 && si.front)
            radiance += throughput * load3(scene->lights[si.light].emission);
        if (si.material < 0)
            return radiance;

        const global Material *material = &scene->materials[si.material];
        if (!HAS_SPECULAR || !bsdf_is_specular(material)) {
            float3 f = bsdf_diffuse(scene, material, &si);
            if (max3(f) > 0.0f)
                radiance += throughput * f * direct_irradiance(scene, &si, sampler, counters);
            return radiance;
        }
        if (depth >= scene->params->max_depth)
            return radiance;

        /* Leave the specular surface on whichever side the new direction points to. */
        uint pair = 1u + 2u * (uint)scene->params->light_count + (uint)depth;
        float u = HAS_DIELECTRIC ? sample_2d(sampler, pair).x : 0.0f;
        float weight;
        float3 d = bsdf_specular(material, &si, ray.d, u, &weight);
        throughput *= weight;
        float side = dot3(d, si.ng) < 0.0f ? -1.0f : 1.0f;
        ray = ray_make(spawn_point(&si, side * si.ng), d, INFINITY, si.id);
        ++counters->specular;
    }
}

#endif
