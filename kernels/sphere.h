/* Intersection of a ray with eight analytic spheres.
 *
 * The discriminant comes from the perpendicular distance of the centre, and the two roots from Citardauq's formula, so that
 * neither a distant origin nor a large sphere cancels digits (Haines et al., Ray Tracing Gems, chapter 7).
 * A ray that leaves this very sphere starts at a root: the constant term is exactly zero for it.
 */
#ifndef PYRT_SPHERE_H
#define PYRT_SPHERE_H

#include "scene.h"

INLINE bool sphere_block_hit(const global SphereBlock *block, const Ray *ray, bool any, Hit *hit)
{
    float8 fx = ray->o.x - load8(block->center[0]);
    float8 fy = ray->o.y - load8(block->center[1]);
    float8 fz = ray->o.z - load8(block->center[2]);
    float8 r = load8(block->radius);
    int8 ids = vload8(0, block->id);
    float a = dot3(ray->d, ray->d);
    float8 b = -fma8(fx, ray->d.x, fma8(fy, ray->d.y, fz * ray->d.z));
    float8 along = b / a;
    float8 lx = fma8(along, ray->d.x, fx);
    float8 ly = fma8(along, ray->d.y, fy);
    float8 lz = fma8(along, ray->d.z, fz);
    float8 disc = fma8(r, r, -fma8(lx, lx, fma8(ly, ly, lz * lz)));
    if (mask8(disc >= 0.0f) == 0u)
        return false;

    float8 dist = sqrt8(fma8(fx, fx, fma8(fy, fy, fz * fz)));
    float8 c = ids == ray->self ? (float8)(0.0f) : (dist - r) * (dist + r);
    float8 root = sqrt8(a * disc);
    float8 q = b + (b < 0.0f ? -root : root);
    float8 t0 = c / q;
    float8 t1 = q / a;
    float8 low = min8(t0, t1);
    float8 t = low > 0.0f ? low : max8(t0, t1);
    uint mask = mask8((disc >= 0.0f) & (t > 0.0f) & (t <= hit->t));
    bool changed = false;
    for (; mask != 0u; mask &= mask - 1u) {
        int lane = lowest_bit(mask);
        int id = block->id[lane];
        float t_lane = ((const float *)&t)[lane];
        if ((uint)(id - ray->light_first) < ray->light_count || !IS_CLOSER(hit, t_lane, id))
            continue;
        hit->t = t_lane;
        hit->u = 0.0f;
        hit->v = 0.0f;
        hit->id = id;
        changed = true;
        if (any)
            return true;
    }
    return changed;
}

#endif
