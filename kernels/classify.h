/* What a pixel shows, as far as the candidates of its beam tell: where samples are worth most. A wrong class costs time and
 * nothing else.
 *
 * Within one pixel everything is linear: a plane seen through it has 1 / t affine over the film, and segments from a flat
 * piece of surface to a point fill a pyramid. So corners decide.
 */
#ifndef PYRT_CLASSIFY_H
#define PYRT_CLASSIFY_H

#include "beam.h"

#define COPLANAR_ULPS 64.0f
#define EDGE_SLACK 1e-5f /* in barycentrics: neighbours overlap rather than leave a crack */

/* Whether there are some candidates, and no more than lanes. */
INLINE bool candidates_fit(const global Candidates *candidates)
{
    return candidates->count > 0 && candidates->count <= BVH_WIDTH;
}

/* The candidates side by side, if they fit; unused lanes hold NaN. */
static void candidates_gather(const Scene *scene, const global Candidates *candidates, global TriangleBlock *block)
{
    if (!candidates_fit(candidates))
        return;
    for (int lane = 0; lane < BVH_WIDTH; ++lane) {
        bool some = lane < candidates->count;
        int place = some ? candidates->places[lane] : 0;
        for (int k = 0; k < 3; ++k)
            for (int axis = 0; axis < 3; ++axis)
                block->vertex[k][axis][lane] = some ? candidate_corner(scene, place, k, axis) : NAN;
        block->id[lane] = some ? candidate_id(scene, place) : -1;
    }
}

/* Which lanes the line o + t d crosses at 0 < t < t_max; *inv_t: 1 / t where it crosses their planes. */
static uint lanes_crossed(const global TriangleBlock *block, float3 o, float3 d, float t_max, float8 *inv_t)
{
    float8 ax = load8(block->vertex[0][0]), ay = load8(block->vertex[0][1]), az = load8(block->vertex[0][2]);
    float8 ux = load8(block->vertex[1][0]) - ax, uy = load8(block->vertex[1][1]) - ay, uz = load8(block->vertex[1][2]) - az;
    float8 vx = load8(block->vertex[2][0]) - ax, vy = load8(block->vertex[2][1]) - ay, vz = load8(block->vertex[2][2]) - az;
    float8 sx = o.x - ax, sy = o.y - ay, sz = o.z - az;
    float8 px = d.y * vz - d.z * vy, py = d.z * vx - d.x * vz, pz = d.x * vy - d.y * vx;
    float8 qx = sy * uz - sz * uy, qy = sz * ux - sx * uz, qz = sx * uy - sy * ux;
    float8 inv_det = 1.0f / (ux * px + uy * py + uz * pz);
    float8 v = (sx * px + sy * py + sz * pz) * inv_det, w = (d.x * qx + d.y * qy + d.z * qz) * inv_det;
    float8 t = (vx * qx + vy * qy + vz * qz) * inv_det;
    *inv_t = 1.0f / t;
    return mask8((v >= -EDGE_SLACK) & (w >= -EDGE_SLACK) & (v + w <= 1.0f + EDGE_SLACK) & (t > 0.0f) & (t < t_max));
}

/* Which lanes lie in the plane of the triangle, whichever way they face. */
static uint lanes_in_plane(const Scene *scene, const global Triangle *tri, const global TriangleBlock *block)
{
    const constant float *bound = scene->params->bound;
    float slack = COPLANAR_ULPS * ULP * (bound[0] + bound[1] + bound[2]);
    int8 inside = (int8)(-1);
    for (int k = 0; k < 3; ++k) {
        float8 x = load8(block->vertex[k][0]) - tri->v0[0];
        float8 y = load8(block->vertex[k][1]) - tri->v0[1];
        float8 z = load8(block->vertex[k][2]) - tri->v0[2];
        inside &= abs8(tri->n[0] * x + tri->n[1] * y + tri->n[2] * z) <= slack;
    }
    return mask8(inside);
}

/* Which lanes have a corner in front of the plane through v0 with normal n. */
static uint lanes_in_front(const Scene *scene, float3 v0, float3 n, const global TriangleBlock *block)
{
    const constant float *bound = scene->params->bound;
    float slack = COPLANAR_ULPS * ULP * (bound[0] + bound[1] + bound[2]);
    int8 front = (int8)(0);
    for (int k = 0; k < 3; ++k) {
        float8 x = load8(block->vertex[k][0]) - v0.x, y = load8(block->vertex[k][1]) - v0.y, z = load8(block->vertex[k][2]) - v0.z;
        front |= n.x * x + n.y * y + n.z * z > slack;
    }
    return mask8(front);
}

/* Shading that varies over a triangle by more than its distance and slope to the lights. */
INLINE bool surface_has_detail(const Scene *scene, const global Triangle *tri)
{
    if (tri->material < 0)
        return false;
    const global Material *material = &scene->materials[tri->material];
    if (HAS_SPECULAR && material->kind != MATERIAL_DIFFUSE)
        return true;
    if (HAS_TEXTURES && scene->textures[material->texture].kind != TEXTURE_CONSTANT)
        return true;
    if (HAS_SMOOTH_NORMALS && tri->corners >= 0) {
        const global Corners *c = &scene->corners[tri->corners];
        for (int k = 0; k < 3; ++k)
            if (!(dot3(load3(c->n[k]), load3(tri->n)) > 0.99999f))
                return true;
    }
    return false;
}

/* Whether each segment from a corner of the footprint to one of the light crosses the lanes of one plane. */
static bool light_is_hidden(const Scene *scene, const float3 *footprint, const global Light *light,
                            const global TriangleBlock *block, uint lanes)
{
    if (light->kind != LIGHT_POINT && light->kind != LIGHT_RECTANGLE)
        return false;
    int corners = light->kind == LIGHT_POINT ? 1 : 4;
    uint crossed[16];
    for (int i = 0; i < 4; ++i)
        for (int k = 0; k < corners; ++k) {
            float3 q = load3(light->position) + (k & 1 ? load3(light->edge1) : (float3)(0.0f))
                     + (k & 2 ? load3(light->edge2) : (float3)(0.0f));
            float8 unused;
            crossed[4 * k + i] = lanes & lanes_crossed(block, footprint[i], q - footprint[i], 1.0f, &unused);
        }
    for (uint rest = crossed[0]; rest != 0u; rest &= rest - 1u) {
        uint plane = lanes_in_plane(scene, &scene->triangles[block->id[lowest_bit(rest)]], block);
        bool hidden = true;
        for (int i = 1; i < 4 * corners; ++i)
            hidden &= (crossed[i] & plane) != 0u;
        if (hidden)
            return true;
    }
    return false;
}

/* Whether the footprint shows the inner or the outer end of a point light's cone, where it is not smooth: unit vectors to it
 * lie at most `radius` from `middle`. */
INLINE bool cone_ends_in(const float3 *footprint, const global Light *light)
{
    float3 position = load3(light->position), sum = (float3)(0.0f);
    for (int i = 0; i < 4; ++i)
        sum += normalize3(footprint[i] - position);
    float3 middle = normalize3(sum);
    float radius = 0.0f;
    for (int i = 0; i < 4; ++i)
        radius = max1(radius, length(normalize3(footprint[i] - position) - middle));
    float away = length(middle - load3(light->n));
    float inner = sqrt(light->cone_inner), outer = sqrt(light->cone_inner + 1.0f / light->cone_slope);
    return abs1(away - inner) <= radius || abs1(away - outer) <= radius;
}

/* What stands between a flat footprint and a light: nothing or everything (plain), or perhaps something. */
static uchar classify_light(const Scene *scene, const float3 *footprint, float3 n, float pad, int i, const global Candidates *shaft,
                            const global TriangleBlock *block)
{
    const global Light *light = &scene->lights[i];
    Box target;
    if (!light_box(light, &target))
        return PIXEL_UNKNOWN;
    float3 middle = 0.5f * (target.low + target.high), half_size = 0.5f * (target.high - target.low);
    if (dot3(n, middle - footprint[0]) + dot3(abs3(n), half_size) <= pad)
        return PIXEL_PLAIN; /* below the horizon */
    if (HAS_SPOT_LIGHTS && light->cone_slope > 0.0f && cone_ends_in(footprint, light))
        return PIXEL_PENUMBRA;
    if (shaft->count == 0)
        return PIXEL_PLAIN;
    if (!candidates_fit(shaft))
        return PIXEL_UNKNOWN;
    Box from = box_empty();
    for (int k = 0; k < 4; ++k)
        box_add(&from, footprint[k]);
    from.low -= pad;
    from.high += pad;
    Volume volume = volume_empty(scene, target.low);
    volume_add_hull(&volume, from, target);
    uint lanes = volume_block_mask(&volume, block) & lanes_in_front(scene, footprint[0], n, block);
    if (lanes == 0u || light_is_hidden(scene, footprint, light, block, lanes))
        return PIXEL_PLAIN;
    return PIXEL_PENUMBRA;
}

/* The class of the pixels of a beam as one, from the candidates of this beam, or of one around it, and of their shafts; and the
 * same side by side. */
static uchar classify_beam(const Scene *scene, const Beam *beam, const global Candidates *candidates,
                           const global TriangleBlock *block, int shafts)
{
    if (candidates->count == 0)
        return PIXEL_PLAIN;
    if (!candidates_fit(candidates) || shafts < scene->params->light_count)
        return PIXEL_UNKNOWN;
    Volume volume = beam_volume(scene, beam);
    uint mask = volume_block_mask(&volume, block) & beam_block_mask(beam, block, volume.pad);
    if (mask == 0u)
        return PIXEL_PLAIN;
    float inv_t[4][BVH_WIDTH];
    uint crossed[4];
    for (int i = 0; i < 4; ++i) {
        float8 all;
        crossed[i] = lanes_crossed(block, beam->o[i], beam->d[i], INFINITY, &all);
        vstore8(all, 0, inv_t[i]);
    }
    uchar edge = PIXEL_EDGE;
    for (uint rest = mask; rest != 0u; rest &= rest - 1u)
        edge = scene->triangles[block->id[lowest_bit(rest)]].light >= 0 ? PIXEL_LIGHT_EDGE : edge;
    int front = -1;
    for (uint rest = crossed[0]; rest != 0u; rest &= rest - 1u) {
        int lane = lowest_bit(rest);
        front = front < 0 || inv_t[0][lane] > inv_t[0][front] ? lane : front;
    }
    if (front < 0)
        return edge;
    const global Triangle *tri = &scene->triangles[block->id[front]];
    uint face = 0u;
    for (uint rest = lanes_in_plane(scene, tri, block); rest != 0u; rest &= rest - 1u) {
        int lane = lowest_bit(rest);
        if (scene->triangles[block->id[lane]].material == tri->material && scene->triangles[block->id[lane]].light == tri->light)
            face |= 1u << lane;
    }
    for (int i = 0; i < 4; ++i) {
        if ((crossed[i] & face) == 0u)
            return edge;
        for (uint rest = mask & ~face; rest != 0u; rest &= rest - 1u)
            if (!(inv_t[i][lowest_bit(rest)] < inv_t[i][front]))
                return edge;
    }
    float3 n = load3(tri->n), footprint[4];
    n = dot3(n, beam->d[0]) > 0.0f ? -n : n;
    if (surface_has_detail(scene, tri))
        return PIXEL_UNKNOWN;
    for (int i = 0; i < 4; ++i)
        footprint[i] = madd3(beam->d[i], 1.0f / inv_t[i][front], beam->o[i]);
    uchar worst = PIXEL_PLAIN;
    for (int i = 0; i < shafts; ++i)
        worst = max(worst, classify_light(scene, footprint, n, volume.pad, i, candidates + 1 + i, block + 1 + i));
    return worst;
}

#endif
