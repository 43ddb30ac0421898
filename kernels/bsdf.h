/* Materials: reflection of light, and the specular continuation of a path. */
#ifndef PYRT_BSDF_H
#define PYRT_BSDF_H

#include "sampling.h"
#include "surface.h"
#include "texture.h"

INLINE bool bsdf_is_specular(const global Material *material)
{
    return (HAS_REFRACTION && material->kind == MATERIAL_REFRACTION) ||
           (HAS_DIELECTRIC && material->kind == MATERIAL_DIELECTRIC);
}

/* Lambert: reflectance / pi, the same for all directions; the cosine is the caller's. For `lanes`, whose materials are
 * diffuse; black in the others. */
INLINE Vec bsdf_diffuse(const Scene *scene, const Surface *si, uint lanes)
{
    Vec color = vec_of(0.0f, 0.0f, 0.0f);
    int first;
    if (!HAS_TEXTURES && all_same(&si->material, lanes, &first)) {
        const global Material *material = &scene->materials[first];
        lanes &= material->twosided ? ALL_LANES : lanes_of(si->front);
        Vec constant_color = vec_load(scene->textures[material->texture].color0);
        return select3(mask_of(lanes), scale3(constant_color, (Real)(INV_PI)), color);
    }
    uint front = lanes_of(si->front);
    for (; lanes != 0u; lanes &= lanes - 1u) {
        int lane = lowest_bit(lanes);
        const global Material *material = &scene->materials[int_lane(&si->material, lane)];
        if (material->twosided || (front >> lane & 1u))
            vec_set(&color, lane, texture_color(scene, material->texture, vec2_lane(&si->uv, lane)) * INV_PI);
    }
    return color;
}

/* Snell's law at an interface with eta = sin(theta_t) / sin(theta_i): cos^2(theta_t) = (eta cos_i)^2 - (eta^2 - 1), negative
 * on total internal reflection. Near the critical angle the two cancel: fma gives what their products were rounded by. */
INLINE float cos2_transmitted(float eta, float cos_i)
{
    float p = eta * cos_i, p_error = fma1(eta, cos_i, -p);
    float p2 = p * p, p2_error = fma1(p, p, -p2);
    float eta2 = eta * eta, eta2_error = fma1(eta, eta, -eta2);
    return (p2 - (eta2 - 1.0f)) + fma1(2.0f * p, p_error, p2_error - eta2_error);
}

/* d: unit, towards the surface; n: unit, on d's side. */
INLINE float3 refract(float3 d, float3 n, float eta, float cos_i, float cos_t)
{
    return normalize3(madd3(n, eta * cos_i - cos_t, eta * d));
}

INLINE float3 reflect(float3 d, float3 n, float cos_i)
{
    return normalize3(madd3(n, 2.0f * cos_i, d));
}

/* Unpolarised Fresnel reflectance of an interface with eta = n_i / n_t. */
INLINE float fresnel(float eta, float cos_i, float cos_t)
{
    float parallel = (cos_i - eta * cos_t) / (cos_i + eta * cos_t);
    float perpendicular = (eta * cos_i - cos_t) / (eta * cos_i + cos_t);
    return 0.5f * fma1(parallel, parallel, perpendicular * perpendicular);
}

/* Both ways on from a specular surface. Radiance along `refracted` counts for (1 - reflectance) * transmission,
 * along `reflected` for `reflectance`. */
typedef struct {
    float3 reflected;
    float3 refracted;
    float reflectance;  /* 1 on total internal reflection; 0 otherwise for `refraction`, Fresnel's for `dielectric` */
    float transmission; /* eta^2 for `dielectric`: radiance over the square of the index is what a ray conserves */
} Specular;

INLINE Specular bsdf_specular(const global Material *material, const LaneSurface *si, float3 d)
{
    if (material->eta == 1.0f) { /* no interface: the direction stays, bit for bit */
        Specular straight = {d, d, 0.0f, 1.0f};
        return straight;
    }
    d = normalize3(d);
    float3 n = dot3(d, si->n) < 0.0f ? si->n : si->ng; /* an interpolated normal may face away from the ray */
    float eta = si->front ? material->eta : 1.0f / material->eta;
    float cos_i = min1(abs1(dot3(d, n)), 1.0f);
    float cos2_t = cos2_transmitted(eta, cos_i);
    float cos_t = sqrt1(max1(cos2_t, 0.0f));
    bool total = cos2_t < 0.0f;
    Specular s;
    s.reflected = reflect(d, n, cos_i);
    s.refracted = refract(d, n, eta, cos_i, cos_t);
    s.reflectance = total ? 1.0f : 0.0f;
    s.transmission = 1.0f;
    if (HAS_DIELECTRIC && material->kind == MATERIAL_DIELECTRIC) {
        s.reflectance = total ? 1.0f : fresnel(eta, cos_i, cos_t);
        s.transmission = eta * eta;
    }
    return s;
}

#endif
