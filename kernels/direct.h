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

/* A path still to be followed. */
typedef struct {
    float3 o;
    float3 d;
    float throughput;
    int depth; /* specular events so far */
    int self;  /* the primitive it leaves, or -1 */
} Path;

/* A glass surface sends a path both ways if the weaker one counts for at least this much and there is room to remember it;
 * else one way is picked by its share. Both are unbiased; the bright reflections of lamps are without noise. */
#define SPLIT_THRESHOLD (1.0f / 64.0f)
#define SPLIT_PATHS 8

INLINE Path path_leave(const Path *from, const Surface *si, float3 d, float weight)
{
    float3 side = dot3(d, si->ng) < 0.0f ? -si->ng : si->ng; /* where the new direction points to */
    Path path = {spawn_point(si, side), d, from->throughput * weight, from->depth + 1, si->id};
    return path;
}

/* Goes on through a specular surface: returns the path to follow now, and may leave another one in `pending`. */
INLINE Path path_continue(const Path *path, const global Material *material, const Surface *si, Sampler sampler,
                          uint pair, Path *pending, int *count)
{
    Specular s = bsdf_specular(material, si, path->d);
    float reflectance = s.reflectance;
    bool reflect = reflectance == 1.0f;
    if (HAS_DIELECTRIC && reflectance > 0.0f && !reflect) {
        float weaker = path->throughput * min1(reflectance, 1.0f - reflectance);
        if (weaker >= SPLIT_THRESHOLD && *count < SPLIT_PATHS) {
            pending[(*count)++] = path_leave(path, si, s.reflected, reflectance);
            return path_leave(path, si, s.refracted, (1.0f - reflectance) * s.transmission);
        }
        reflect = sample_2d(sampler, pair).x < reflectance;
    }
    return reflect ? path_leave(path, si, s.reflected, 1.0f) : path_leave(path, si, s.refracted, s.transmission);
}

/* Radiance that arrives along a ray. A miss is black, and so is a path of more than max_depth specular events. */
INLINE float3 direct_radiance(const Scene *scene, float3 o, float3 d, Sampler sampler, Counters *counters)
{
    float3 radiance = (float3)(0.0f);
    Path pending[SPLIT_PATHS];
    int count = 0;
    Path path = {o, d, 1.0f, 0, -1};
    for (;;) {
        Ray ray = ray_make(path.o, path.d, INFINITY, path.self);
        Hit hit;
        if (bvh_hit(scene, &ray, false, &hit)) {
            Surface si = surface_at(scene, &ray, &hit);

            /* An emitter shows its front, whatever the path came through. */
            if (HAS_AREA_LIGHTS && si.light >= 0 && si.front)
                radiance += path.throughput * load3(scene->lights[si.light].emission);

            const global Material *material = &scene->materials[max(si.material, 0)];
            if (HAS_SPECULAR && si.material >= 0 && bsdf_is_specular(material)) {
                if (path.depth < scene->params->max_depth) {
                    uint pair = 1u + 2u * (uint)scene->params->light_count + (uint)path.depth;
                    path = path_continue(&path, material, &si, sampler, pair, pending, &count);
                    ++counters->specular;
                    continue;
                }
            } else if (si.material >= 0) {
                float3 f = bsdf_diffuse(scene, material, &si);
                if (max3(f) > 0.0f)
                    radiance += path.throughput * f * direct_irradiance(scene, &si, sampler, counters);
            }
        }
        if (!HAS_DIELECTRIC || count == 0)
            return radiance;
        path = pending[--count];
        ++counters->specular;
    }
}

#endif
