/* The direct-light estimator: perfect refraction is followed, the first diffuse surface is lit by every light. */
#ifndef PYRT_DIRECT_H
#define PYRT_DIRECT_H

#include "bsdf.h"
#include "bvh.h"
#include "line.h"

/* As bvh_hits, for rays of a bundle whose candidates are known; none (0): traverse. */
INLINE uint candidates_hits(const Scene *scene, const global Candidates *candidates, const Rays *rays, uint lanes, bool any,
                            Hits *hits)
{
    if (!HAS_BEAMS || !candidates || candidates->count < 0)
        return bvh_hits(scene, rays, lanes, any, hits);
    return triangles_hits(scene, candidates, rays, lanes, any, hits);
}

/* Which of the lanes see their light: the segments between the two points, open at both ends, are free of everything but the
 * light itself. */
INLINE uint light_is_visible(const Scene *scene, const Surface *si, const LightSample *s, uint lanes,
                             const global Candidates *shaft)
{
    Vec o = spawn_point(si, si->ng);
    Rays rays = {o, sub3(s->q, o), (Real)(1.0f), si->id, s->first, s->count};
    Hits hits;
    return lanes & ~candidates_hits(scene, shaft, &rays, lanes, true, &hits);
}

/* Irradiance at the surfaces of `lanes` from all lights, one shadow ray per light that can contribute and may be hidden.
 * `shafts`: by light, for the beam that found the surfaces, or 0. */
INLINE Vec direct_irradiance(const Scene *scene, const Surface *si, uint lanes, Sampler sampler,
                             const global Candidates *shafts, Counters *counters)
{
    Vec sum = vec_of(0.0f, 0.0f, 0.0f);
    for (int i = 0; i < scene->params->light_count; ++i) {
        const global Light *light = &scene->lights[i];
        const global Candidates *shaft = shafts && i < SHAFT_LIGHTS ? shafts + i : 0;
        if (HAS_LINES && HAS_RECTANGLE_LIGHTS && light->kind == LIGHT_RECTANGLE && shaft && shaft->count >= 0) {
            Real u = sample_2d(sampler, (Uint)(1u + 2u * (uint)i)).x;
            sum = add3(sum, line_irradiance(scene, light, si, lanes, u, shaft, counters));
            continue;
        }
        LightSample s = light_sample(scene, light, si, lanes, sampler, 1u + 2u * (uint)i);
        uint lit = lanes & lanes_of(max3(s.irradiance) > 0.0f);
        counters->dark += popcount(lanes & ~lit);
        if (HAS_BEAMS && shaft && shaft->count == 0) {
            counters->clear += popcount(lit);
        } else if (lit != 0u) {
            counters->shadow += popcount(lit);
            lit = light_is_visible(scene, si, &s, lit, shaft);
        }
        sum = add3(sum, select3(mask_of(lit), s.irradiance, vec_of(0.0f, 0.0f, 0.0f)));
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

INLINE Path path_leave(const Path *from, const LaneSurface *at, float3 d, float weight)
{
    float3 side = dot3(d, at->ng) < 0.0f ? -at->ng : at->ng; /* where the new direction points to */
    float3 o = madd3(side, at->offset, at->p);
    Path path = {o, d, min1(FLT_MAX, from->throughput * weight), from->depth + 1, at->id};
    return path;
}

/* Goes on through a specular surface: returns the path to follow now, and may leave another one in `pending`, if `splits` of
 * that are left. `choice`: a random number. */
INLINE Path path_continue(const Path *path, const global Material *material, const LaneSurface *at, float choice,
                          Path *pending, int *count, int *splits)
{
    Specular s = bsdf_specular(material, at, path->d);
    float reflectance = s.reflectance;
    bool reflect = reflectance == 1.0f;
    if (HAS_DIELECTRIC && reflectance > 0.0f && !reflect) {
        float weaker = path->throughput * min1(reflectance, 1.0f - reflectance);
        if (weaker >= SPLIT_THRESHOLD && *count < SPLIT_PATHS && *splits > 0) {
            --*splits;
            pending[(*count)++] = path_leave(path, at, s.reflected, reflectance);
            return path_leave(path, at, s.refracted, (1.0f - reflectance) * s.transmission);
        }
        reflect = choice < reflectance;
    }
    return reflect ? path_leave(path, at, s.reflected, 1.0f) : path_leave(path, at, s.refracted, s.transmission);
}

/* Which of the lanes hit a surface that is specular. */
INLINE uint specular_lanes(const Scene *scene, const Surface *si, uint lanes)
{
    uint specular = 0u;
    for (; HAS_SPECULAR && lanes != 0u; lanes &= lanes - 1u) {
        int lane = lowest_bit(lanes);
        if (bsdf_is_specular(&scene->materials[int_lane(&si->material, lane)]))
            specular |= 1u << lane;
    }
    return specular;
}

/* Emission towards the lanes that see the front of a light. */
INLINE Vec emitted_radiance(const Scene *scene, const Surface *si, uint lanes)
{
    Vec radiance = vec_of(0.0f, 0.0f, 0.0f);
    for (lanes &= lanes_of(si->front & (si->light >= 0)); lanes != 0u; lanes &= lanes - 1u) {
        int lane = lowest_bit(lanes);
        vec_set(&radiance, lane, load3(scene->lights[int_lane(&si->light, lane)].emission));
    }
    return radiance;
}

/* The paths that the lanes follow, and those that each has left for later. */
typedef struct {
    Path now[PACKET];
    Path pending[PACKET][SPLIT_PATHS];
    int count[PACKET];
    int splits[PACKET];
} Paths;

INLINE void paths_begin(Paths *paths, const Rays *rays)
{
    for (int lane = 0; lane < PACKET; ++lane) {
        Path path = {vec_lane(&rays->o, lane), vec_lane(&rays->d, lane), 1.0f, 0, -1};
        paths->now[lane] = path;
        paths->count[lane] = 0;
        paths->splits[lane] = SPLITS;
    }
}

/* Moves on the lanes that hit a specular surface, and those that have a path left; returns which these are. */
INLINE uint paths_next(const Scene *scene, Paths *paths, const Surface *si, uint lanes, uint specular, Sampler sampler,
                       Counters *counters)
{
    Vec2 choice;
    if (HAS_DIELECTRIC && specular != 0u) {
        Uint pair;
        for (int lane = 0; lane < PACKET; ++lane)
            ((uint *)&pair)[lane] = 1u + 2u * (uint)scene->params->light_count + (uint)paths->now[lane].depth;
        choice = sample_2d(sampler, pair);
    }
    uint active = 0u;
    for (; lanes != 0u; lanes &= lanes - 1u) {
        int lane = lowest_bit(lanes);
        Path *path = &paths->now[lane];
        if ((specular >> lane & 1u) && path->depth < scene->params->max_depth) {
            const global Material *material = &scene->materials[int_lane(&si->material, lane)];
            LaneSurface at = surface_lane(si, lane);
            *path = path_continue(path, material, &at, HAS_DIELECTRIC ? vec2_lane(&choice, lane).x : 0.0f,
                                  paths->pending[lane], &paths->count[lane], &paths->splits[lane]);
        } else if (HAS_DIELECTRIC && paths->count[lane] > 0) {
            *path = paths->pending[lane][--paths->count[lane]];
        } else {
            continue;
        }
        ++counters->specular;
        active |= 1u << lane;
    }
    return active;
}

INLINE void paths_load(const Paths *paths, uint lanes, Rays *rays, Real *throughput)
{
    for (; lanes != 0u; lanes &= lanes - 1u) {
        int lane = lowest_bit(lanes);
        const Path *path = &paths->now[lane];
        vec_set(&rays->o, lane, path->o);
        vec_set(&rays->d, lane, path->d);
        int_set(&rays->self, lane, path->self);
        real_set(throughput, lane, path->throughput);
    }
}

/* Radiance that arrives along the camera rays of a packet's `lanes`. A miss is black, and so is a path of more than max_depth
 * specular events. `beam`: the candidates of the rays' beam, followed by those of its shafts, or 0. */
INLINE Vec direct_radiance(const Scene *scene, Vec o, Vec d, uint lanes, Sampler sampler, const global Candidates *beam,
                           Counters *counters)
{
    const global Candidates *shafts = beam ? beam + 1 : 0;
    Vec radiance = vec_of(0.0f, 0.0f, 0.0f);
    Real throughput = (Real)(1.0f);
    Rays rays = {o, d, (Real)(INFINITY), (Int)(-1), (Int)(0), 0u};
    Paths paths;
    if (HAS_SPECULAR)
        paths_begin(&paths, &rays);
    for (;;) {
        Hits hits;
        uint found = candidates_hits(scene, beam, &rays, lanes, false, &hits);
        uint specular = 0u;
        Surface si;
        if (found != 0u) {
            si = surface_at(scene, &rays, &hits, found);
            if (HAS_AREA_LIGHTS) /* an emitter shows its front, whatever the path came through */
                radiance = add3(radiance, scale3(emitted_radiance(scene, &si, found), throughput));
            found &= lanes_of(si.material >= 0);
            specular = specular_lanes(scene, &si, found);
            uint diffuse = found & ~specular;
            if (diffuse != 0u) {
                Vec f = bsdf_diffuse(scene, &si, diffuse);
                diffuse &= lanes_of(max3(f) > 0.0f);
                if (diffuse != 0u) {
                    Vec light = direct_irradiance(scene, &si, diffuse, sampler, shafts, counters);
                    radiance = add3(radiance, mul3(scale3(f, throughput), light));
                }
            }
        }
        if (!HAS_SPECULAR)
            return saturate3(radiance);
        lanes = paths_next(scene, &paths, &si, lanes, specular, sampler, counters);
        if (lanes == 0u)
            return saturate3(radiance);
        paths_load(&paths, lanes, &rays, &throughput);
        beam = 0;
        shafts = 0;
    }
}

#endif
