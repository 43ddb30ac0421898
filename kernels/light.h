/* Direct light: a point on a light, and what it would send to a surface if nothing stood between.
 *
 * Each sampler returns the light arriving per unit reflectance: emission * cos(theta) * (area measure / pdf), the cosine taken
 * with the shading normal. Where that is exactly zero no shadow ray is worth tracing.
 */
#ifndef PYRT_LIGHT_H
#define PYRT_LIGHT_H

#include "sampling.h"
#include "surface.h"

/* What a sample did, for the statistics. */
typedef struct {
    uint specular; /* rays traced on from specular surfaces */
    uint shadow;   /* shadow rays traced, or lines cut by shadows */
    uint dark;     /* of these saved: the unoccluded light was exactly zero */
    uint clear;    /* of these saved: nothing stands between the beam and the light */
} Counters;

typedef struct {
    Vec q;          /* where the shadow ray ends: on the light, off its surface by its rounding error */
    Vec irradiance; /* unoccluded, zero if the light is behind either surface */
    Int first;      /* the primitives that the shadow ray passes through: those that q lies on */
    uint count;
} LightSample;

INLINE LightSample light_sample_none(const global Light *light)
{
    LightSample s = {vec_of(0.0f, 0.0f, 0.0f), vec_of(0.0f, 0.0f, 0.0f), (Int)(light->first), (uint)light->count};
    return s;
}

/* What arrives: emission * factor, finite but for its overflow. No factor at all where its parts were out of range. */
INLINE Vec light_irradiance(const global Light *light, Real factor)
{
    Real finite = min1(factor, (Real)(FLT_MAX));
    return scale3(vec_load(light->emission), factor > 0.0f ? finite : 0.0f);
}

/* Cosine at the receiver; 0 below its horizon, which is bounded by both normals. */
INLINE Real receiver_cosine(const Surface *si, Vec wi)
{
    return dot3(si->ng, wi) > 0.0f ? max1(dot3(si->n, wi), (Real)(0.0f)) : 0.0f;
}

/* How much of its intensity a point light sends along -wi: fades with the cosine's square between two angles from its axis
 * (KHR_lights_punctual). Squared distances of unit vectors are 2 - 2 cos, with digits for narrow cones too. */
INLINE Real cone_falloff(const global Light *light, Vec wi)
{
    Vec off = add3(wi, vec_load(light->n));
    Real share = 1.0f - (dot3(off, off) - light->cone_inner) * light->cone_slope;
    share = min1(max1(share, (Real)(0.0f)), (Real)(1.0f));
    return share * share;
}

INLINE LightSample point_sample(const global Light *light, const Surface *si)
{
    LightSample s = light_sample_none(light);
    s.q = vec_load(light->position);
    Vec to = sub3(s.q, si->p);
    Real inv_r2 = 1.0f / dot3(to, to);
    Vec wi = scale3(to, sqrt1(inv_r2));
    Real share = HAS_SPOT_LIGHTS ? cone_falloff(light, wi) : (Real)(1.0f);
    s.irradiance = light_irradiance(light, receiver_cosine(si, wi) * inv_r2 * share);
    return s;
}

/* An area light's differential form factor without the distance-free factors: cos * cos' / r^2 for a patch at `to`. */
INLINE Real patch_factor(const Surface *si, Vec light_n, Vec to)
{
    Real inv_r2 = 1.0f / dot3(to, to);
    return receiver_cosine(si, to) * max1(-dot3(light_n, to), (Real)(0.0f)) * inv_r2 * inv_r2;
}

/* Point (u, v) of the unit square with density proportional to the bilinear function of corner weights w: 00, 10, 01, 11.
 * Returns the density in *pdf. (Hart et al., Practical Product Sampling by Fitting and Composing Warps, 2020.) */
INLINE Vec2 sample_bilinear(Vec2 u, Vec4 w, Real *value)
{
    Real v = sample_linear(u.y, w.x + w.y, w.z + w.w);
    Real a = lerp1(w.x, w.z, v), b = lerp1(w.y, w.w, v);
    Real s = sample_linear(u.x, a, b);
    *value = lerp1(a, b, s);
    Vec2 st = {s, v};
    return st;
}

/* The part of [0, 1] where value + slope * x > 0. */
INLINE Vec2 positive_range(Real value, Real slope)
{
    Real zero = -value / slope;
    Vec2 range = {slope > 0.0f ? max1(zero, (Real)(0.0f)) : 0.0f, slope < 0.0f ? min1(zero, (Real)(1.0f)) : 1.0f};
    return range;
}

/* A point of a rectangle, moved off it by the rounding error. */
INLINE Vec off_light(const global Light *light, Vec point)
{
    return madd3(vec_load(light->n), (Real)(light->offset), point);
}

/* A rectangle light, or the part of it that each lane samples. */
typedef struct {
    Vec corner, e1, e2;
    Real area; /* 0 if no part is left */
} Patch;

/* Cuts rectangles to the smallest ones, along their edges, around their parts above the receivers' horizons. */
INLINE void patch_clip(const Surface *si, Patch *patch)
{
    Real value = dot3(si->n, sub3(patch->corner, si->p));
    Real slope1 = dot3(si->n, patch->e1), slope2 = dot3(si->n, patch->e2), zero = (Real)(0.0f);
    Int cut = !(value + min1(slope1, zero) + min1(slope2, zero) >= 0.0f);
    if (lanes_of(cut) == 0u)
        return;
    Vec2 range1 = positive_range(value + max1(slope2, zero), slope1);
    Vec2 range2 = positive_range(value + max1(slope1, zero), slope2);
    Real size1 = range1.y - range1.x, size2 = range2.y - range2.x;
    Vec corner = madd3(patch->e2, range2.x, madd3(patch->e1, range1.x, patch->corner));
    Int some = (size1 > 0.0f) & (size2 > 0.0f);
    patch->corner = select3(cut, corner, patch->corner);
    patch->e1 = select3(cut, scale3(patch->e1, size1), patch->e1);
    patch->e2 = select3(cut, scale3(patch->e2, size2), patch->e2);
    patch->area = cut ? (some ? patch->area * (size1 * size2) : 0.0f) : patch->area;
}

/* A point (s, t) of a rectangle, seen from `height` above its plane with the corner in direction `to`, uniform in solid angle
 * (Urena, Fajardo, King 2013). Returns the solid angle; 0 where it is small, and so a difference of large numbers that all
 * its digits cancel in, or where the edges are not at right angles. Angles come from atan2 of both legs: a rectangle that
 * is very close has them near 0 and pi, where acos has no digits. */
INLINE float sample_solid_angle(float3 to, float3 e1, float3 e2, float height, float2 u, float2 *st)
{
    float2 size = (float2)(sqrt1(dot3(e1, e1)), sqrt1(dot3(e2, e2)));
    if (!(abs1(dot3(e1, e2)) < 1e-5f * size.x * size.y))
        return 0.0f;
    float2 low = (float2)(dot3(to, e1), dot3(to, e2)) / size, high = low + size;
    float h2 = height * height;
    float4 side = (float4)(-low.y, high.x, high.y, -low.x);
    float4 hypotenuse2 = side * side + h2;
    float4 cosine = side / sqrt(hypotenuse2); /* of the planes through the sides, to that of the rectangle */
    float4 sine2 = h2 / hypotenuse2;
    float4 corner = atan2(sqrt(sine2 + cosine * cosine * sine2.yzwx), -cosine * cosine.yzwx);
    float solid_angle = (corner.x + corner.y) + (corner.z + corner.w) - 2.0f * PI;
    if (!(solid_angle > 0.05f))
        return 0.0f;

    float half_angle = 0.5f * fma1(u.x, solid_angle, 2.0f * PI - corner.z - corner.w);
    float sn = sin(half_angle), cs = cos(half_angle);
    float product = cosine.x * cosine.z;
    float rest = (sine2.x + cosine.x * cosine.x * sine2.z) / (1.0f + abs1(product)); /* 1 - |product|, without cancellation */
    float g = product < 0.0f ? 2.0f * cs * cs - rest : rest - 2.0f * sn * sn; /* cosine of the angle - product */
    float x = height * 2.0f * sn * cs / sqrt1(max1(fma1(g, g, -sine2.x * sine2.z), 1e-37f));
    x *= copysign1(1.0f, fma1(fma1(cs, cs, -sn * sn), cosine.x, -cosine.z));
    x = min1(max1(x, low.x), high.x);
    float d2 = fma1(x, x, h2);
    float v = lerp1(low.y / sqrt1(fma1(low.y, low.y, d2)), high.y / sqrt1(fma1(high.y, high.y, d2)), u.y);
    float y = v * sqrt1(d2 / max1(1.0f - v * v, 1e-30f));
    y = min1(max1(y, low.y), high.y);
    *st = ((float2)(x, y) - low) / size;
    return solid_angle;
}

/* For those of the lanes that are near: their solid angles, and the points of these in *st. */
INLINE Real sample_solid_angles(Vec to, const Patch *patch, Real height, Vec2 u, uint lanes, Vec2 *st)
{
    Real solid_angle = (Real)(0.0f);
    for (; lanes != 0u; lanes &= lanes - 1u) {
        int lane = lowest_bit(lanes);
        float2 place;
        float found = sample_solid_angle(vec_lane(&to, lane), vec_lane(&patch->e1, lane), vec_lane(&patch->e2, lane),
                                         real_lane(&height, lane), vec2_lane(&u, lane), &place);
        real_set(&solid_angle, lane, found);
        if (found > 0.0f)
            vec2_set(st, lane, place);
    }
    return solid_angle;
}

/* Irradiance from a corner in direction `to`, over that from the nearest one if it faced the receiver: 1 / r^4 may overflow. */
INLINE Real corner_weight(const Surface *si, Vec to, Real nearness)
{
    Real cosine = dot3(si->n, to);
    return cosine > 0.0f ? cosine * nearness * nearness : 0.0f;
}

/* A point on a rectangle, nearly proportional to what it contributes: the density is the bilinear interpolation of the
 * contributions of the four corners. Where all four are below the receiver's horizon, the whole rectangle is. A surface that
 * is closer than the rectangle is large gets most of its light from a spot that no corner knows of. There the density is
 * that of the solid angle, so that no sample counts for more than a direction can. */
INLINE LightSample rectangle_sample(const global Light *light, const Surface *si, Vec2 u)
{
    LightSample s = light_sample_none(light);
    Vec n = vec_load(light->n);
    Patch patch = {vec_load(light->position), vec_load(light->edge1), vec_load(light->edge2), (Real)(light->area)};
    Real height = dot3(n, sub3(si->p, patch.corner));
    patch_clip(si, &patch);
    Vec to = sub3(patch.corner, si->p);
    Real tiny = (Real)(1e-24f); /* so that no later quotient overflows */
    Vec c10 = add3(to, patch.e1), c01 = add3(to, patch.e2), c11 = add3(to, add3(patch.e1, patch.e2));
    Vec4 r2 = {dot3(to, to) + tiny, dot3(c10, c10) + tiny, dot3(c01, c01) + tiny, dot3(c11, c11) + tiny};
    Real near2 = min1(min1(r2.x, r2.y), min1(r2.z, r2.w));
    Vec4 w = {corner_weight(si, to, near2 / r2.x), corner_weight(si, c10, near2 / r2.y),
              corner_weight(si, c01, near2 / r2.z), corner_weight(si, c11, near2 / r2.w)};
    Real sum = w.x + w.y + w.z + w.w;
    Int lit = (height > 0.0f) & (patch.area > 0.0f) & (sum > 1e-30f);
    uint lanes = lanes_of(lit);
    if (lanes == 0u)
        return s;

    Real scale = 4.0f / sum, value;
    w.x *= scale;
    w.y *= scale;
    w.z *= scale;
    w.w *= scale;
    Vec2 st = sample_bilinear(u, w, &value);
    uint near = lanes & lanes_of(near2 < dot3(patch.e1, patch.e1) + dot3(patch.e2, patch.e2));
    Real solid_angle = sample_solid_angles(to, &patch, height, u, near, &st);
    s.q = off_light(light, madd3(patch.e2, st.y, madd3(patch.e1, st.x, patch.corner)));
    to = madd3(patch.e2, st.y, madd3(patch.e1, st.x, to));
    Real inv_r2 = 1.0f / max1(dot3(to, to), tiny);
    Real per_cosine = solid_angle > 0.0f ? solid_angle * sqrt1(inv_r2) : height * inv_r2 * (patch.area * inv_r2) / value;
    lit &= (solid_angle > 0.0f) | (value > 0.0f);
    s.irradiance = light_irradiance(light, lit ? receiver_cosine(si, to) * per_cosine : 0.0f);
    return s;
}

/* First index of the ascending 32-bit cumulative distribution whose entry exceeds u. */
INLINE int cdf_find(const global uint *cdf, int count, uint u)
{
    int low = 0, high = count - 1;
    while (low < high) {
        int middle = (low + high) / 2;
        if (cdf[middle] > u)
            high = middle;
        else
            low = middle + 1;
    }
    return low;
}

/* A triangle of an emitting mesh by area (`pick`: 32 random bits), then a uniform point on it. */
INLINE LightSample mesh_sample(const Scene *scene, const global Light *light, const Surface *si, Vec2 u, Uint pick)
{
    LightSample s = light_sample_none(light);
    const global uint *cdf = scene->cdf + light->cdf;
    Real share;
    for (int lane = 0; lane < PACKET; ++lane) {
        int i = cdf_find(cdf, light->count, ((const uint *)&pick)[lane]);
        real_set(&share, lane, (float)(cdf[i] - (i > 0 ? cdf[i - 1] : 0u)) + (i + 1 == light->count ? 1.0f : 0.0f));
        int_set(&s.first, lane, light->first + i);
    }
    s.count = 1u;
    Triangles tri = triangles_at(scene, &s.first, ALL_LANES);
    Vec2 b = sample_triangle(u);
    Vec q = madd3(tri.e2, b.y, madd3(tri.e1, b.x, tri.v0));
    Vec c = cross3(tri.e1, tri.e2);
    Real area_over_pdf = 0.5f * sqrt1(dot3(c, c)) * (0x1p32f / share);
    s.q = madd3(tri.n, tri.offset, q);
    s.irradiance = light_irradiance(light, patch_factor(si, tri.n, sub3(q, si->p)) * area_over_pdf);
    return s;
}

/* A direction uniform in the cone that a sphere fills, and where it first meets the sphere. */
INLINE LightSample sphere_light_sample(const global Light *light, const Surface *si, Vec2 u)
{
    LightSample s = light_sample_none(light);
    Vec to = sub3(vec_load(light->position), si->p);
    Real d2 = dot3(to, to), zero = (Real)(0.0f);
    Real sin2_max = light->radius * light->radius / d2;
    Int outside = sin2_max < 1.0f; /* the front */
    Real one_minus_cos_max = sin2_max / (1.0f + sqrt1(max1(1.0f - sin2_max, zero)));
    Real one_minus_cos = u.x * one_minus_cos_max;
    Real sin2 = one_minus_cos * (2.0f - one_minus_cos);
    Real cos = 1.0f - one_minus_cos;
    Vec axis = scale3(to, 1.0f / sqrt1(d2)), ring;
    for (int lane = 0; lane < PACKET; ++lane) {
        float3 x, y;
        frame_from(vec_lane(&axis, lane), &x, &y);
        float turns = 2.0f * vec2_lane(&u, lane).y;
        vec_set(&ring, lane, x * cospi(turns) + y * sinpi(turns));
    }
    Vec wi = madd3(axis, cos, scale3(ring, sqrt1(sin2)));
    Real t = sqrt1(d2) * cos - sqrt1(max1(light->radius * light->radius - d2 * sin2, zero));
    Vec n = normalize3(madd3(wi, t, neg3(to)));
    s.q = madd3(n, (Real)(light->radius + light->offset), vec_load(light->position));
    Real factor = receiver_cosine(si, wi) * 2.0f * PI * one_minus_cos_max;
    s.irradiance = light_irradiance(light, outside ? factor : 0.0f);
    return s;
}

/* `pair`: the first of two dimension pairs that the light may use. Of `lanes` alone the sample has a meaning. */
INLINE LightSample light_sample(const Scene *scene, const global Light *light, const Surface *si, uint lanes,
                                Sampler sampler, uint pair)
{
    if (HAS_RECTANGLE_LIGHTS && light->kind == LIGHT_RECTANGLE) {
        Real height = dot3(vec_load(light->n), sub3(si->p, vec_load(light->position)));
        if ((lanes & lanes_of(height > 0.0f)) == 0u)
            return light_sample_none(light); /* all behind it: no need of a sample */
        return rectangle_sample(light, si, sample_2d(sampler, (Uint)(pair)));
    }
    if (HAS_MESH_LIGHTS && light->kind == LIGHT_MESH) {
        Uint pick, unused;
        sample_bits(sampler, (Uint)(pair + 1u), &pick, &unused);
        return mesh_sample(scene, light, si, sample_2d(sampler, (Uint)(pair)), pick);
    }
    if (HAS_SPHERE_LIGHTS && light->kind == LIGHT_SPHERE)
        return sphere_light_sample(light, si, sample_2d(sampler, (Uint)(pair)));
    return point_sample(light, si);
}

#endif
