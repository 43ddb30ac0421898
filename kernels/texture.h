/* Colour of a texture at a surface's (u, v). */
#ifndef PYRT_TEXTURE_H
#define PYRT_TEXTURE_H

#include "scene.h"

/* x - floor1(x) as a number in [0, 1); 0 for what is not finite. */
INLINE float wrap_unit(float x)
{
    float f = x - floor1(x);
    return f < 1.0f ? max1(f, 0.0f) : 0.0f; /* -1e-9 rounds to 1: the seam */
}

/* Of a whole number, exactly; false for what is not finite. */
INLINE bool is_odd(float n)
{
    return n - 2.0f * floor1(0.5f * n) == 1.0f;
}

INLINE float3 texel(const Scene *scene, const global Texture *texture, int x, int y)
{
    return load3(scene->texels + 3u * (size_t)(texture->texels + (uint)y * (uint)texture->width + (uint)x));
}

/* Bilinear between texel centres, wrapped around; (0, 0) is the upper-left corner of the upper-left texel. */
INLINE float3 image_lookup(const Scene *scene, const global Texture *texture, float s, float t)
{
    float x = wrap_unit(s) * texture->width - 0.5f;
    float y = wrap_unit(t) * texture->height - 0.5f;
    int x0 = (int)floor1(x), y0 = (int)floor1(y);
    float fx = x - x0, fy = y - y0;
    int x1 = x0 + 1 == texture->width ? 0 : x0 + 1;
    int y1 = y0 + 1 == texture->height ? 0 : y0 + 1;
    x0 = x0 < 0 ? texture->width - 1 : x0;
    y0 = y0 < 0 ? texture->height - 1 : y0;
    float3 top = lerp3(texel(scene, texture, x0, y0), texel(scene, texture, x1, y0), fx);
    float3 bottom = lerp3(texel(scene, texture, x0, y1), texel(scene, texture, x1, y1), fx);
    return lerp3(top, bottom, fy);
}

INLINE float3 texture_color(const Scene *scene, int index, float2 uv)
{
    const global Texture *texture = &scene->textures[index];
    if (!HAS_TEXTURES || texture->kind == TEXTURE_CONSTANT)
        return load3(texture->color0);
    float s = fma1(texture->scale_s, uv.x, texture->delta[0]);
    float t = fma1(texture->scale_t, uv.y, texture->delta[1]);
    if (HAS_IMAGES && texture->kind == TEXTURE_IMAGE)
        return image_lookup(scene, texture, s, t);
    return load3(is_odd(floor1(2.0f * s)) == is_odd(floor1(2.0f * t)) ? texture->color0 : texture->color1);
}

#endif
