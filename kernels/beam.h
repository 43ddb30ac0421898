/* What the camera rays of a few neighbouring pixels can hit, and what can stand between those hits and each light.
 *
 * Most beams meet a handful of triangles, and most shafts to a light are empty. Then a sample needs no traversal, only the
 * test of one block, or no shadow ray at all. The tests that remain are the same as the traversal's, so not a bit of the
 * picture changes.
 */
#ifndef PYRT_BEAM_H
#define PYRT_BEAM_H

#include "camera.h"
#include "volume.h"

/* How many of the lights have a shaft of their own: of the first ones. */
INLINE int shaft_count(constant SceneParams *params)
{
    return min(params->light_count, SHAFT_LIGHTS);
}

/* The beam through the square of side x side pixels that holds this one; their corners are multiples of `side`. */
INLINE Beam beam_of_pixels(const Scene *scene, uint pixel, uint side)
{
    uint x = (pixel & 0xffffu) / side * side, y = (pixel >> 16) / side * side;
    float left = (float)x, right = (float)(x + side), above = (float)y, below = (float)(y + side);
    Beam beam;
    camera_ray(&scene->params->camera, left, above, &beam.o[0], &beam.d[0]);
    camera_ray(&scene->params->camera, right, above, &beam.o[1], &beam.d[1]);
    camera_ray(&scene->params->camera, right, below, &beam.o[2], &beam.d[2]);
    camera_ray(&scene->params->camera, left, below, &beam.o[3], &beam.d[3]);
    return beam;
}

/* Four sides, and a plane across the axis where the rays start, unless some run back along it, as in a wide beam. A side
 * contains a corner ray and runs along the film's x or y: the cross product of two corner rays, nearly parallel, would lose
 * the digits. */
INLINE Volume beam_volume(const Scene *scene, const Beam *beam)
{
    const constant Camera *camera = &scene->params->camera;
    float3 along[2] = {(float3)(camera->direction_dx[0], camera->direction_dx[1], camera->direction_dx[2]),
                       (float3)(camera->direction_dy[0], camera->direction_dy[1], camera->direction_dy[2])};
    float3 axis = beam->d[0] + beam->d[2];
    Volume volume = volume_empty(scene, beam->o[0]);
    float start = -INFINITY, forwards = INFINITY;
    NO_UNROLL
    for (int i = 0; i < 4; ++i) {
        float3 n = cross3(beam->d[i], along[i & 1]);
        n = dot3(n, axis) > 0.0f ? -n : n; /* outwards: away from the middle of the beam */
        volume_add(&volume, n, max1(dot3(n, beam->o[i]), dot3(n, beam->o[(i + 1) & 3])));
        start = max1(start, -dot3(axis, beam->o[i]));
        forwards = min1(forwards, dot3(axis, beam->d[i]));
    }
    if (forwards > 0.01f * dot3(axis, axis))
        volume_add(&volume, -axis, start);
    return volume;
}

INLINE Box box_empty(void)
{
    Box box = {(float3)(INFINITY), (float3)(-INFINITY)};
    return box;
}

INLINE void box_add(Box *box, float3 p)
{
    box->low = (float3)(min1(box->low.x, p.x), min1(box->low.y, p.y), min1(box->low.z, p.z));
    box->high = (float3)(max1(box->high.x, p.x), max1(box->high.y, p.y), max1(box->high.z, p.z));
}

/* Around the part of a triangle that the beam may hit: the triangle's box, cut to where the corner rays meet its plane if all
 * four do so steeply enough to be trusted. */
INLINE Box beam_footprint(const Scene *scene, const Beam *beam, int id, float pad)
{
    const global Triangle *tri = &scene->triangles[id];
    float3 v0 = load3(tri->v0), n = load3(tri->n);
    Box box = box_empty(), cut = box_empty();
    box_add(&box, v0);
    box_add(&box, v0 + load3(tri->e1));
    box_add(&box, v0 + load3(tri->e2));
    float reach = pad;
    NO_UNROLL
    for (int i = 0; i < 4; ++i) {
        float slope = dot3(n, beam->d[i]);
        float steepness = abs1(slope) / sqrt1(dot3(beam->d[i], beam->d[i]));
        float t = dot3(n, v0 - beam->o[i]) / slope;
        if (!(steepness > 0.01f && t > 0.0f)) {
            cut = box;
            break;
        }
        box_add(&cut, madd3(beam->d[i], t, beam->o[i]));
        reach = max1(reach, pad / steepness);
    }
    box.low = (float3)(max1(box.low.x, cut.low.x), max1(box.low.y, cut.low.y), max1(box.low.z, cut.low.z)) - reach;
    box.high = (float3)(min1(box.high.x, cut.high.x), min1(box.high.y, cut.high.y), min1(box.high.z, cut.high.z)) + reach;
    return box;
}

/* Around all points of a light that shadow rays go to; false for a mesh. */
INLINE bool light_box(const global Light *light, Box *box)
{
    float3 p = load3(light->position);
    *box = box_empty();
    if (light->kind == LIGHT_MESH)
        return false;
    box_add(box, p - light->radius);
    box_add(box, p + light->radius);
    box_add(box, p + load3(light->edge1));
    box_add(box, p + load3(light->edge2));
    box_add(box, p + load3(light->edge1) + load3(light->edge2));
    return true;
}

/* Around what the beam may hit of its candidates. */
INLINE Box beam_receivers(const Scene *scene, const Beam *beam, const global Candidates *hits, float pad)
{
    Box receivers = box_empty();
    NO_UNROLL
    for (int lane = 0; lane < hits->count; ++lane) {
        Box box = beam_footprint(scene, beam, candidate_id(scene, hits->places[lane]), pad);
        if (box.low.x <= box.high.x && box.low.y <= box.high.y && box.low.z <= box.high.z) {
            box_add(&receivers, box.low);
            box_add(&receivers, box.high);
        }
    }
    return receivers;
}

/* Whether the edges of triangles before a rectangle light, thrown onto it from the middle of the receivers, run more along its
 * first edge than along the second. Lines across them are cut, where lines along them are hidden or not as a whole. */
INLINE bool shadows_run_along(const Scene *scene, const Box *receivers, const global Light *light, const global Candidates *shaft)
{
    float3 eye = 0.5f * (receivers->low + receivers->high), n = load3(light->n);
    float3 e1 = load3(light->edge1), e2 = load3(light->edge2);
    float3 c1 = cross3(e2, n) / dot3(cross3(e2, n), e1), c2 = cross3(e1, n) / dot3(cross3(e1, n), e2);
    float height = dot3(n, load3(light->position) - eye), along1 = 0.0f, along2 = 0.0f;
    NO_UNROLL
    for (int i = 0; i < shaft->count; ++i) {
        float2 shadow[3];
        for (int k = 0; k < 3; ++k) {
            int place = shaft->places[i];
            float3 to = (float3)(candidate_corner(scene, place, k, 0), candidate_corner(scene, place, k, 1),
                                 candidate_corner(scene, place, k, 2)) - eye;
            to *= height / min1(dot3(n, to), height * 1e-3f); /* height is negative */
            shadow[k] = (float2)(dot3(c1, to), dot3(c2, to));
        }
        for (int k = 0; k < 3; ++k) {
            float2 edge = shadow[k == 2 ? 0 : k + 1] - shadow[k];
            float x = abs1(edge.x), y = abs1(edge.y), scale = 1.0f / max1(max1(x, y), 1.0f);
            along1 += x * scale;
            along2 += y * scale;
        }
    }
    return along1 > along2;
}

/* Candidates of the beam at out[0] and of its shaft to light i at out[1 + i]. */
NO_INLINE void beam_trace(const Scene *scene, const Beam *beam, int shaft_lights, global Candidates *out)
{
    for (int i = 0; i <= shaft_lights; ++i)
        out[i].count = -1;
    Box receivers;
    NO_UNROLL
    for (int i = 0; i <= shaft_lights; ++i) { /* 0: the beam itself; one loop, so that all is compiled once */
        const global Light *light = &scene->lights[max(i - 1, 0)];
        Volume volume;
        Box target;
        if (i == 0) {
            volume = beam_volume(scene, beam);
        } else {
            if (!light_box(light, &target))
                continue;
            volume = volume_empty(scene, target.low);
            volume_add_hull(&volume, receivers, target);
        }
        volume_collect(scene, &volume, beam, i > 0 ? out : 0, light->first, i > 0 ? (uint)light->count : 0u,
                       i > 0 ? SHAFT_CANDIDATES : BEAM_CANDIDATES, &out[i]);
        if (i > 0) {
            if (HAS_RECTANGLE_LIGHTS && light->kind == LIGHT_RECTANGLE)
                out[i].across = shadows_run_along(scene, &receivers, light, &out[i]);
            continue;
        }
        if (out->count <= 0)
            return;
        receivers = beam_receivers(scene, beam, out, volume.pad);
    }
}

#endif
