/* All device arrays of a scene, bundled once by the kernel entry; and what a ray is and finds. */
#ifndef PYRT_SCENE_H
#define PYRT_SCENE_H

#include "packet.h"

#ifndef RAYS_SKIP
#define RAYS_SKIP 1 /* whether rays have primitives that they must not hit */
#endif

typedef struct {
    const constant SceneParams *params;
    const global BvhNode *nodes;
    const global TriangleBlock *triangle_blocks;
    const global SphereBlock *sphere_blocks;
    const global Triangle *triangles;
    const global Corners *corners;
    const global Sphere *spheres;
    const global Material *materials;
    const global Texture *textures;
    const global float *texels;
    const global Light *lights;
    const global uint *cdf;
} Scene;

/* Points o + t d with 0 < t < t_max. Primitives that the ray must not hit: `self`, which it leaves, and the
 * `light_count` ones from `light_first` on, which it goes to. */
typedef struct {
    float3 o;
    float3 d;
    float t_max;
    int self;
    int light_first;
    uint light_count;
} Ray;

typedef struct {
    float t;
    float u; /* triangle: weights of v1 and v2 */
    float v;
    int id; /* primitive, or -1 for a miss */
} Hit;

/* The rays of a packet, and what they find. */
#if PACKET == 1
typedef Ray Rays;
typedef Hit Hits;
#else
typedef struct {
    Vec o;
    Vec d;
    Real t_max;
    Int self;
    Int light_first;
    uint light_count;
} Rays;

typedef struct {
    Real t;
    Real u;
    Real v;
    Int id;
} Hits;
#endif

INLINE Ray ray_make(float3 o, float3 d, float t_max, int self)
{
    Ray ray = {o, d, t_max, self, 0, 0u};
    return ray;
}

INLINE Ray ray_lane(const Rays *rays, int lane)
{
    Ray ray = {vec_lane(&rays->o, lane), vec_lane(&rays->d, lane), real_lane(&rays->t_max, lane),
               int_lane(&rays->self, lane), int_lane(&rays->light_first, lane), rays->light_count};
    return ray;
}

INLINE Hit hit_lane(const Hits *hits, int lane)
{
    Hit hit = {real_lane(&hits->t, lane), real_lane(&hits->u, lane), real_lane(&hits->v, lane), int_lane(&hits->id, lane)};
    return hit;
}

INLINE void hit_set(Hits *hits, int lane, const Hit *hit)
{
    real_set(&hits->t, lane, hit->t);
    real_set(&hits->u, lane, hit->u);
    real_set(&hits->v, lane, hit->v);
    int_set(&hits->id, lane, hit->id);
}

/* For one ray or for a packet's. Ties go to the lower id, so that the result does not depend on the order of the traversal. */
#define IS_CLOSER(HIT, T, ID) (((T) < (HIT)->t) | (((T) == (HIT)->t) & ((ID) < (HIT)->id)))

INLINE bool ray_skips(const Ray *ray, int id)
{
    return RAYS_SKIP && (id == ray->self || (uint)(id - ray->light_first) < ray->light_count);
}

#endif
