/* (film position) -> ray, for a pinhole. See Camera in types.h for why both ends of the ray vary. */
#ifndef PYRT_CAMERA_H
#define PYRT_CAMERA_H

#include "math.h"

/* The ray through film position (x, y) in pixels, (0, 0) the upper-left corner of the picture. */
INLINE void camera_ray(const constant Camera *c, float x, float y, float3 *origin, float3 *direction)
{
    float3 o, d;
    o.x = fma1(x, c->origin_dx[0], fma1(y, c->origin_dy[0], c->origin[0]));
    o.y = fma1(x, c->origin_dx[1], fma1(y, c->origin_dy[1], c->origin[1]));
    o.z = fma1(x, c->origin_dx[2], fma1(y, c->origin_dy[2], c->origin[2]));
    d.x = fma1(x, c->direction_dx[0], fma1(y, c->direction_dy[0], c->direction[0]));
    d.y = fma1(x, c->direction_dx[1], fma1(y, c->direction_dy[1], c->direction[1]));
    d.z = fma1(x, c->direction_dx[2], fma1(y, c->direction_dy[2], c->direction[2]));
    *origin = o;
    *direction = d;
}

#endif
