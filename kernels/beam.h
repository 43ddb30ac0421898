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

/* The beam of `count` pixels: through the film rectangle around them. */
NO_INLINE Beam beam_of_pixels(const Scene *scene, const global uint *pixels, uint count)
{
    uint x0 = 0xffffu, x1 = 0u, y0 = 0xffffu, y1 = 0u;
    for (uint i = 0; i < count; ++i) {
        uint x = pixels[i] & 0xffffu, y = pixels[i] >> 16;
        x0 = x < x0 ? x : x0;
        x1 = x > x1 ? x : x1;
        y0 = y < y0 ? y : y0;
        y1 = y > y1 ? y : y1;
    }
    float left = (float)x0, right = (float)(x1 + 1u), above = (float)y0, below = (float)(y1 + 1u);
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
        Box box = beam_footprint(scene, beam, hits->block.id[lane], pad);
        if (box.low.x <= box.high.x && box.low.y <= box.high.y && box.low.z <= box.high.z) {
            box_add(&receivers, box.low);
            box_add(&receivers, box.high);
        }
    }
    return receivers;
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
        volume_collect(scene, &volume, beam, i > 0 ? out : 0, light->first, i > 0 ? (uint)light->count : 0u, &out[i]);
        if (i > 0)
            continue;
        if (out->count <= 0)
            return;
        receivers = beam_receivers(scene, beam, out, volume.pad);
    }
}

#endif
