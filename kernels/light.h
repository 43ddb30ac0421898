/* Direct light: a point on a light, and what it would send to a surface if nothing stood between.
 *
 * Each sampler returns the light arriving per unit reflectance: emission * cos(theta) * (area measure / pdf), the cosine taken
 * with the shading normal. Where that is exactly zero no shadow ray is worth tracing.
 */
#ifndef PYRT_LIGHT_H
#define PYRT_LIGHT_H

#include "sampling.h"
#include "surface.h"

typedef struct {
    float3 q;          /* where the shadow ray ends: on the light, off its surface by its rounding error */
    float3 irradiance; /* unoccluded, zero if the light is behind either surface */
    int first;         /* the primitives that the shadow ray passes through: those that q lies on */
    uint count;
} LightSample;

INLINE LightSample light_sample_none(const global Light *light)
{
    LightSample s = {(float3)(0.0f), (float3)(0.0f), light->first, (uint)light->count};
    return s;
}

/* What arrives: emission * factor, finite but for its overflow. No factor at all where its parts were out of range. */
INLINE float3 light_irradiance(const global Light *light, float factor)
{
    return factor > 0.0f ? load3(light->emission) * min1(factor, FLT_MAX) : (float3)(0.0f);
}

/* Cosine at the receiver; 0 below its horizon, which is bounded by both normals. */
INLINE float receiver_cosine(const Surface *si, float3 wi)
{
    return dot3(si->ng, wi) > 0.0f ? max1(dot3(si->n, wi), 0.0f) : 0.0f;
}

INLINE LightSample point_sample(const global Light *light, const Surface *si)
{
    LightSample s = light_sample_none(light);
    s.q = load3(light->position);
    float3 to = s.q - si->p;
    float inv_r2 = 1.0f / dot3(to, to);
    s.irradiance = light_irradiance(light, receiver_cosine(si, to * sqrt1(inv_r2)) * inv_r2);
    return s;
}

/* An area light's differential form factor without the distance-free factors: cos * cos' / r^2 for a patch at `to`. */
INLINE float patch_factor(const Surface *si, float3 light_n, float3 to)
{
    float inv_r2 = 1.0f / dot3(to, to);
    return receiver_cosine(si, to) * max1(-dot3(light_n, to), 0.0f) * inv_r2 * inv_r2;
}

/* Point (u, v) of the unit square with density proportional to the bilinear function of corner weights w: 00, 10, 01, 11.
 * Returns the density in *pdf. (Hart et al., Practical Product Sampling by Fitting and Composing Warps, 2020.) */
INLINE float2 sample_bilinear(float2 u, float4 w, float *value)
{
    float v = sample_linear(u.y, w.x + w.y, w.z + w.w);
    float a = lerp1(w.x, w.z, v), b = lerp1(w.y, w.w, v);
    float s = sample_linear(u.x, a, b);
    *value = lerp1(a, b, s);
    return (float2)(s, v);
}

/* The part of [0, 1] where value + slope * x > 0. */
INLINE float2 positive_range(float value, float slope)
{
    float zero = -value / slope;
    return (float2)(slope > 0.0f ? max1(zero, 0.0f) : 0.0f, slope < 0.0f ? min1(zero, 1.0f) : 1.0f);
}

/* Cuts a rectangle to the smallest one, along its edges, around its part above the receiver's horizon; false if none. */
INLINE bool rectangle_clip(const Surface *si, float3 *corner, float3 *e1, float3 *e2, float *area)
{
    float value = dot3(si->n, *corner - si->p);
    float slope1 = dot3(si->n, *e1), slope2 = dot3(si->n, *e2);
    if (value + min1(slope1, 0.0f) + min1(slope2, 0.0f) >= 0.0f)
        return true;
    float2 range1 = positive_range(value + max1(slope2, 0.0f), slope1);
    float2 range2 = positive_range(value + max1(slope1, 0.0f), slope2);
    float size1 = range1.y - range1.x, size2 = range2.y - range2.x;
    *corner = madd3(*e2, range2.x, madd3(*e1, range1.x, *corner));
    *e1 *= size1;
    *e2 *= size2;
    *area *= size1 * size2;
    return size1 > 0.0f && size2 > 0.0f;
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

/* A point on a rectangle, nearly proportional to what it contributes: the density is the bilinear interpolation of the
 * contributions of the four corners. Where all four are below the receiver's horizon, the whole rectangle is. A surface that
 * is closer than the rectangle is large gets most of its light from a spot that no corner knows of. There the density is
 * that of the solid angle, so that no sample counts for more than a direction can. */
INLINE LightSample rectangle_sample(const global Light *light, const Surface *si, float2 u)
{
    LightSample s = light_sample_none(light);
    float3 n = load3(light->n), e1 = load3(light->edge1), e2 = load3(light->edge2), corner = load3(light->position);
    float height = dot3(n, si->p - corner);
    if (!(height > 0.0f))
        return s;
    float area = light->area;
    if (!rectangle_clip(si, &corner, &e1, &e2, &area))
        return s;
    float3 to = corner - si->p;
    float4 x = to.x + (float4)(0.0f, e1.x, e2.x, e1.x + e2.x);
    float4 y = to.y + (float4)(0.0f, e1.y, e2.y, e1.y + e2.y);
    float4 z = to.z + (float4)(0.0f, e1.z, e2.z, e1.z + e2.z);
    float4 r2 = x * x + y * y + z * z + 1e-24f; /* so that no later quotient overflows */
    float near2 = min1(min1(r2.x, r2.y), min1(r2.z, r2.w));
    float4 cosine = x * si->n.x + y * si->n.y + z * si->n.z;
    float4 w = cosine > 0.0f ? cosine * (near2 / r2) * (near2 / r2) : 0.0f; /* relative: 1 / r^4 may overflow */
    float sum = w.x + w.y + w.z + w.w;
    if (!(sum > 1e-30f))
        return s;

    float2 st;
    float solid_angle = 0.0f, value;
    if (near2 < dot3(e1, e1) + dot3(e2, e2))
        solid_angle = sample_solid_angle(to, e1, e2, height, u, &st);
    if (solid_angle == 0.0f)
        st = sample_bilinear(u, w * (4.0f / sum), &value);
    float3 q = madd3(e2, st.y, madd3(e1, st.x, corner));
    s.q = madd3(n, light->offset, q);
    to = madd3(e2, st.y, madd3(e1, st.x, to));
    float inv_r2 = 1.0f / max1(dot3(to, to), 1e-24f);
    float per_cosine = solid_angle > 0.0f ? solid_angle * sqrt1(inv_r2) : height * inv_r2 * (area * inv_r2) / value;
    if (solid_angle > 0.0f || value > 0.0f)
        s.irradiance = light_irradiance(light, receiver_cosine(si, to) * per_cosine);
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
INLINE LightSample mesh_sample(const Scene *scene, const global Light *light, const Surface *si, float2 u, uint pick)
{
    const global uint *cdf = scene->cdf + light->cdf;
    int i = cdf_find(cdf, light->count, pick);
    float share = (float)(cdf[i] - (i > 0 ? cdf[i - 1] : 0u)) + (i + 1 == light->count ? 1.0f : 0.0f);
    const global Triangle *tri = &scene->triangles[light->first + i];
    float3 n = load3(tri->n), e1 = load3(tri->e1), e2 = load3(tri->e2);
    float2 b = sample_triangle(u);
    float3 q = madd3(e2, b.y, madd3(e1, b.x, load3(tri->v0)));
    float3 c = cross3(e1, e2);
    float area_over_pdf = 0.5f * sqrt1(dot3(c, c)) * (0x1p32f / share);
    LightSample s = light_sample_none(light);
    s.first = light->first + i;
    s.count = 1u;
    s.q = madd3(n, tri->offset, q);
    s.irradiance = light_irradiance(light, patch_factor(si, n, q - si->p) * area_over_pdf);
    return s;
}

/* A direction uniform in the cone that a sphere fills, and where it first meets the sphere. */
INLINE LightSample sphere_light_sample(const global Light *light, const Surface *si, float2 u)
{
    LightSample s = light_sample_none(light);
    float3 to = load3(light->position) - si->p;
    float d2 = dot3(to, to);
    float sin2_max = light->radius * light->radius / d2;
    if (!(sin2_max < 1.0f))
        return s; /* inside: the front is outside */
    float one_minus_cos_max = sin2_max / (1.0f + sqrt1(1.0f - sin2_max));
    float one_minus_cos = u.x * one_minus_cos_max;
    float sin2 = one_minus_cos * (2.0f - one_minus_cos);
    float cos = 1.0f - one_minus_cos;
    float3 axis = to * (1.0f / sqrt1(d2)), bx, by;
    frame_from(axis, &bx, &by);
    float3 wi = madd3(axis, cos, (bx * cospi(2.0f * u.y) + by * sinpi(2.0f * u.y)) * sqrt1(sin2));
    float t = sqrt1(d2) * cos - sqrt1(max1(light->radius * light->radius - d2 * sin2, 0.0f));
    float3 n = normalize3(madd3(wi, t, -to));
    s.q = madd3(n, light->radius + light->offset, load3(light->position));
    s.irradiance = light_irradiance(light, receiver_cosine(si, wi) * 2.0f * PI * one_minus_cos_max);
    return s;
}

/* `pair`: the first of two dimension pairs that the light may use. */
INLINE LightSample light_sample(const Scene *scene, const global Light *light, const Surface *si, Sampler sampler, uint pair)
{
    if (HAS_AREA_LIGHTS && light->kind == LIGHT_RECTANGLE && !(dot3(load3(light->n), si->p - load3(light->position)) > 0.0f))
        return light_sample_none(light); /* behind it: no need of a sample */
    if (HAS_RECTANGLE_LIGHTS && light->kind == LIGHT_RECTANGLE)
        return rectangle_sample(light, si, sample_2d(sampler, pair));
    if (HAS_MESH_LIGHTS && light->kind == LIGHT_MESH)
        return mesh_sample(scene, light, si, sample_2d(sampler, pair), sample_bits(sampler, pair + 1u).x);
    if (HAS_SPHERE_LIGHTS && light->kind == LIGHT_SPHERE)
        return sphere_light_sample(light, si, sample_2d(sampler, pair));
    return point_sample(light, si);
}

#endif
