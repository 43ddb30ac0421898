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
    uint dark;     /* shadow rays saved: the unoccluded light was exactly zero */
    uint clear;    /* shadow rays saved: nothing stands between the beam and the light */
} Counters;

/* As bvh_hit, for a ray of the bundle that the candidates were gathered for; none (0): traverse. */
INLINE bool candidates_hit(const Scene *scene, const global Candidates *candidates, const Ray *ray, bool any, Hit *hit)
{
    if (!HAS_BEAMS || !candidates || candidates->count < 0)
        return bvh_hit(scene, ray, any, hit);
    Shear shear;
    if (!ray_prepare(ray, &shear, hit) || candidates->count == 0)
        return false;
    return triangle_block_hit(&candidates->block, &shear, ray, any, hit);
}

/* The segment between the two points, open at both ends, is free of everything but the light itself. */
INLINE bool light_is_visible(const Scene *scene, const Surface *si, const LightSample *s,
                             const global Candidates *shaft)
{
    float3 o = spawn_point(si, si->ng);
    Ray ray = ray_make(o, s->q - o, 1.0f, si->id);
    ray.light_first = s->first;
    ray.light_count = s->count;
    Hit hit;
    return !candidates_hit(scene, shaft, &ray, true, &hit);
}

/* Irradiance at the surface from all lights, one shadow ray per light that can contribute and may be hidden. `shafts`: by
 * light, for the beam that found the surface, or 0. */
INLINE float3 direct_irradiance(const Scene *scene, const Surface *si, Sampler sampler, const global Candidates *shafts,
                                Counters *counters)
{
    float3 sum = (float3)(0.0f);
    for (int i = 0; i < scene->params->light_count; ++i) {
        const global Light *light = &scene->lights[i];
        LightSample s = light_sample(scene, light, si, sampler, 1u + 2u * (uint)i);
        if (!(max3(s.irradiance) > 0.0f)) {
            ++counters->dark;
            continue;
        }
        const global Candidates *shaft = shafts ? shafts + i : 0;
        if (HAS_BEAMS && shaft && shaft->count == 0) {
            ++counters->clear;
            sum += s.irradiance;
            continue;
        }
        ++counters->shadow;
        if (light_is_visible(scene, si, &s, shaft))
            sum += s.irradiance;
    }
    return saturate3(sum);
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
 * else one way is picked by its share. Both are unbiased; the bright reflections of lamps are without noise. The threshold
 * allows 63 splits, unless radiance grows on its way into thinner media: so that they cannot breed, splits are counted too. */
#define SPLIT_THRESHOLD (1.0f / 64.0f)
#define SPLIT_PATHS 8
#define SPLITS 63

INLINE Path path_leave(const Path *from, const Surface *si, float3 d, float weight)
{
    float3 side = dot3(d, si->ng) < 0.0f ? -si->ng : si->ng; /* where the new direction points to */
    Path path = {spawn_point(si, side), d, min1(FLT_MAX, from->throughput * weight), from->depth + 1, si->id};
    return path;
}

/* Goes on through a specular surface: returns the path to follow now, and may leave another one in `pending`, if `splits` of
 * that are left. */
INLINE Path path_continue(const Path *path, const global Material *material, const Surface *si, Sampler sampler,
                          uint pair, Path *pending, int *count, int *splits)
{
    Specular s = bsdf_specular(material, si, path->d);
    float reflectance = s.reflectance;
    bool reflect = reflectance == 1.0f;
    if (HAS_DIELECTRIC && reflectance > 0.0f && !reflect) {
        float weaker = path->throughput * min1(reflectance, 1.0f - reflectance);
        if (weaker >= SPLIT_THRESHOLD && *count < SPLIT_PATHS && *splits > 0) {
            --*splits;
            pending[(*count)++] = path_leave(path, si, s.reflected, reflectance);
            return path_leave(path, si, s.refracted, (1.0f - reflectance) * s.transmission);
        }
        reflect = sample_2d(sampler, pair).x < reflectance;
    }
    return reflect ? path_leave(path, si, s.reflected, 1.0f) : path_leave(path, si, s.refracted, s.transmission);
}

/* Radiance that arrives along a camera ray. A miss is black, and so is a path of more than max_depth specular events.
 * `beam`: the candidates of the ray's beam, followed by those of its shafts. */
INLINE float3 direct_radiance(const Scene *scene, float3 o, float3 d, Sampler sampler, const global Candidates *beam,
                              Counters *counters)
{
    bool has_shafts = scene->params->light_count <= SHAFT_LIGHTS;
    float3 radiance = (float3)(0.0f);
    Path pending[SPLIT_PATHS];
    int count = 0, splits = SPLITS;
    Path path = {o, d, 1.0f, 0, -1};
    for (;;) {
        Ray ray = ray_make(path.o, path.d, INFINITY, path.self);
        Hit hit;
        bool first = path.depth == 0;
        if (candidates_hit(scene, first ? beam : 0, &ray, false, &hit)) {
            Surface si = surface_at(scene, &ray, &hit);

            /* An emitter shows its front, whatever the path came through. */
            if (HAS_AREA_LIGHTS && si.light >= 0 && si.front)
                radiance += path.throughput * load3(scene->lights[si.light].emission);

            const global Material *material = &scene->materials[max(si.material, 0)];
            if (HAS_SPECULAR && si.material >= 0 && bsdf_is_specular(material)) {
                if (path.depth < scene->params->max_depth) {
                    uint pair = 1u + 2u * (uint)scene->params->light_count + (uint)path.depth;
                    path = path_continue(&path, material, &si, sampler, pair, pending, &count, &splits);
                    ++counters->specular;
                    continue;
                }
            } else if (si.material >= 0) {
                float3 f = bsdf_diffuse(scene, material, &si);
                if (max3(f) > 0.0f)
                    radiance += path.throughput * f * direct_irradiance(scene, &si, sampler, first && has_shafts ? beam + 1 : 0, counters);
            }
        }
        if (!HAS_DIELECTRIC || count == 0)
            return saturate3(radiance);
        path = pending[--count];
        ++counters->specular;
    }
}

#endif
