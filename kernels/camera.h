/* (film position) -> ray, for a pinhole. See Camera in types.h for why both ends of the ray vary. */
#ifndef PYRT_CAMERA_H
#define PYRT_CAMERA_H

#include "packet.h"

/* The ray through film position (x, y) in pixels, (0, 0) the upper-left corner of the picture. */
#define CAMERA_RAY(REAL, VEC) \
    INLINE OVERLOADED void camera_ray(const constant Camera *c, REAL x, REAL y, VEC *origin, VEC *direction) \
    { \
        VEC o, d; \
        o.x = fma1(x, (REAL)(c->origin_dx[0]), fma1(y, (REAL)(c->origin_dy[0]), (REAL)(c->origin[0]))); \
        o.y = fma1(x, (REAL)(c->origin_dx[1]), fma1(y, (REAL)(c->origin_dy[1]), (REAL)(c->origin[1]))); \
        o.z = fma1(x, (REAL)(c->origin_dx[2]), fma1(y, (REAL)(c->origin_dy[2]), (REAL)(c->origin[2]))); \
        d.x = fma1(x, (REAL)(c->direction_dx[0]), fma1(y, (REAL)(c->direction_dy[0]), (REAL)(c->direction[0]))); \
        d.y = fma1(x, (REAL)(c->direction_dx[1]), fma1(y, (REAL)(c->direction_dy[1]), (REAL)(c->direction[1]))); \
        d.z = fma1(x, (REAL)(c->direction_dx[2]), fma1(y, (REAL)(c->direction_dy[2]), (REAL)(c->direction[2]))); \
        *origin = o; \
        *direction = d; \
    }

CAMERA_RAY(float, float3)
#if PACKET > 1
CAMERA_RAY(Real, Vec)
#endif

#endif
