/* Whole pictures in float64: what tracer.py computes, for millions of samples. No code of pyrt's kernels, but their random
 * numbers and what they are used for, written again: a sample's place in its pixel, its points on lights, its way through
 * glass. So a picture has the noise of pyrt's, and differs by rounding and by what either does wrong. With `uniform`, points
 * on lights are uniform instead, of random numbers of their own: a picture that owes nothing to how pyrt samples lights.
 *
 * Triangles have boxes in a binary tree, in depth-first order.
 */
#pragma OPENCL EXTENSION cl_khr_fp64 : enable
#define INLINE static inline __attribute__((always_inline))
#define SPLIT_WEIGHT (1.0 / 64.0)
#define SPLIT_PATHS 8
#define SPLITS 63
#define SLACK 1e-12 /* barycentric: a ray through an edge hits one triangle at least */

enum { DIFFUSE, REFRACTION, DIELECTRIC };
enum { CONSTANT, CHECKERBOARD, IMAGE };

typedef struct {
    int node_count, triangle_count, sphere_count, shape_count, point_count, rectangle_count, max_depth, size;
} Counts;

typedef struct {
    Counts n;
    double clearance;
    const global double *boxes;    /* low, high */
    const global int *links;       /* next node if the box is missed, first triangle, how many (0: not a leaf) */
    const global double *corners;  /* v0, v1 - v0, v2 - v0 */
    const global double *uvs;
    const global double *normals;  /* zero where flat */
    const global int *owners;      /* shape of each triangle, then of each sphere */
    const global double *spheres;  /* centre, radius */
    const global double *shapes;   /* material or -1, radiance */
    const global double *materials; /* kind, texture, two-sided, eta on entering */
    const global double *textures; /* kind, two colours, scale, delta, width, height, first texel */
    const global float *texels;
    const global double *points;   /* position, flux */
    const global double *rectangles; /* corner, edges, radiance */
    int uniform;
} World;

typedef struct {
    double3 o, d;
    double weight;
    int depth;
} Path;

typedef struct {
    double t;
    int id;
} Nearest;

/* Random numbers ------------------------------------------------------------------------------------------------------- */

typedef struct {
    uint pixel, index;
} Sampler;

INLINE uint hash(uint x)
{
    x = (x ^ (x >> 16)) * 0x21f0aaadu;
    x = (x ^ (x >> 15)) * 0x735a2d97u;
    return x ^ (x >> 15);
}

INLINE uint reversed(uint x)
{
    x = (x << 16) | (x >> 16);
    x = ((x & 0x00ff00ffu) << 8) | ((x >> 8) & 0x00ff00ffu);
    x = ((x & 0x0f0f0f0fu) << 4) | ((x >> 4) & 0x0f0f0f0fu);
    x = ((x & 0x33333333u) << 2) | ((x >> 2) & 0x33333333u);
    return ((x & 0x55555555u) << 1) | ((x >> 1) & 0x55555555u);
}

INLINE uint scrambled(uint x, uint seed)
{
    x = (x ^ x * 0x3d20adeau) + seed;
    x *= (seed >> 16) | 1u;
    x ^= x * 0x05526c56u;
    return x ^ x * 0x53a22864u;
}

INLINE double fraction(uint x)
{
    return (double)(reversed(x) >> 8) * 0x1p-24;
}

/* Sobol's first two dimensions with Owen's scrambling (Burley 2020); `pair` tells uses apart. */
INLINE double2 random_pair(Sampler sampler, uint pair)
{
    uint seed = hash(sampler.pixel + pair * 0x9e3779b9u);
    uint i = reversed(scrambled(reversed(sampler.index), seed)), second = i;
    for (uint step = 16u; step != 0u; step /= 2u)
        second ^= (second >> step) & (0xffffffffu / ((1u << step) + 1u));
    return (double2)(fraction(scrambled(i, hash(seed ^ 0x68bc21ebu))), fraction(scrambled(second, hash(seed ^ 0x02e5be93u))));
}

/* Vectors -------------------------------------------------------------------------------------------------------------- */

INLINE double larger(double a, double b)
{
    return a > b ? a : b;
}

INLINE double smaller(double a, double b)
{
    return a < b ? a : b;
}

INLINE double3 at3(const global double *p)
{
    return (double3)(p[0], p[1], p[2]);
}

INLINE double inner(double3 a, double3 b)
{
    return a.x * b.x + a.y * b.y + a.z * b.z;
}

INLINE double3 outer(double3 a, double3 b)
{
    return (double3)(a.y * b.z - a.z * b.y, a.z * b.x - a.x * b.z, a.x * b.y - a.y * b.x);
}

INLINE double3 unit3(double3 a)
{
    return a / sqrt(inner(a, a));
}

/* Rays against primitives ---------------------------------------------------------------------------------------------- */

INLINE bool meets_box(const global double *box, double3 o, double3 inv, double t_max)
{
    double3 a = (at3(box) - o) * inv, b = (at3(box + 3) - o) * inv;
    double3 low = a < b ? a : b, high = a < b ? b : a;
    double enter = larger(larger(low.x, low.y), larger(low.z, 0.0));
    double leave = smaller(smaller(high.x, high.y), smaller(high.z, t_max));
    return !(enter > leave * (1.0 + 1e-12) + 1e-12);
}

/* Distance to a triangle, or infinity (Moeller and Trumbore 1997). */
INLINE double meets_triangle(const global double *corners, double3 o, double3 d)
{
    double3 e1 = at3(corners + 3), e2 = at3(corners + 6), offset = o - at3(corners);
    double3 p = outer(d, e2);
    double scale = 1.0 / inner(e1, p);
    double3 q = outer(offset, e1);
    double u = inner(offset, p) * scale, v = inner(d, q) * scale;
    return u >= -SLACK && v >= -SLACK && u + v <= 1.0 + SLACK ? inner(e2, q) * scale : INFINITY;
}

/* The closest primitive with clearance < t < t_max; with `any` the first that is found. */
INLINE Nearest trace(const World *w, double3 o, double3 d, double t_max, bool any)
{
    Nearest nearest = {t_max, -1};
    double3 inv = 1.0 / d;
    for (int node = 0; node < w->n.node_count;) {
        const global int *link = w->links + 3 * node;
        if (!meets_box(w->boxes + 6 * node, o, inv, nearest.t)) {
            node = link[0];
            continue;
        }
        for (int i = link[1]; i < link[1] + link[2]; ++i) {
            double t = meets_triangle(w->corners + 9 * i, o, d);
            if (t > w->clearance && t < nearest.t) {
                nearest.t = t;
                nearest.id = i;
                if (any)
                    return nearest;
            }
        }
        ++node;
    }
    for (int i = 0; i < w->n.sphere_count; ++i) {
        double3 to = at3(w->spheres + 4 * i) - o;
        double along = inner(to, d), radius = w->spheres[4 * i + 3];
        double3 away = to - along * d;
        double chord = sqrt(radius * radius - inner(away, away)); /* NaN: a miss */
        double t = along - chord > w->clearance ? along - chord : along + chord;
        if (t > w->clearance && t < nearest.t) {
            nearest.t = t;
            nearest.id = w->n.triangle_count + i;
        }
    }
    return nearest;
}

INLINE bool is_free(const World *w, double3 p, double3 to)
{
    double distance = sqrt(inner(to, to));
    return trace(w, p, to / distance, distance - w->clearance, true).id < 0;
}

/* Surfaces ------------------------------------------------------------------------------------------------------------- */

typedef struct {
    double3 p, n, shading; /* n: geometric, on the front side */
    double2 uv;
    int shape;
} Point;

INLINE Point point_at(const World *w, Nearest hit, double3 o, double3 d)
{
    Point x;
    x.p = o + hit.t * d;
    x.uv = 0.0;
    x.shape = w->owners[hit.id];
    if (hit.id >= w->n.triangle_count) {
        x.n = x.shading = unit3(x.p - at3(w->spheres + 4 * (hit.id - w->n.triangle_count)));
        return x;
    }
    const global double *corners = w->corners + 9 * hit.id, *uv = w->uvs + 6 * hit.id, *n = w->normals + 9 * hit.id;
    double3 e1 = at3(corners + 3), e2 = at3(corners + 6), offset = x.p - at3(corners), area = outer(e1, e2);
    double u = inner(outer(offset, e2), area) / inner(area, area), v = inner(outer(e1, offset), area) / inner(area, area);
    double r = 1.0 - u - v;
    x.n = unit3(area);
    x.uv = (double2)(r * uv[0] + u * uv[2] + v * uv[4], r * uv[1] + u * uv[3] + v * uv[5]);
    double3 smooth = r * at3(n) + u * at3(n + 3) + v * at3(n + 6);
    x.shading = inner(smooth, smooth) > 0.0 ? unit3(smooth) : x.n;
    return x;
}

INLINE double3 texel(const World *w, const global double *texture, long x, long y)
{
    long width = (long)texture[11], height = (long)texture[12];
    x = (x % width + width) % width;
    y = (y % height + height) % height;
    const global float *texel = w->texels + (long)texture[13] + 3 * (y * width + x);
    return (double3)(texel[0], texel[1], texel[2]);
}

INLINE double3 color_at(const World *w, int index, double2 uv)
{
    const global double *texture = w->textures + 14 * index;
    double2 st = uv * (double2)(texture[7], texture[8]) + (double2)(texture[9], texture[10]);
    if (texture[0] == IMAGE) {
        double2 place = st * (double2)(texture[11], texture[12]) - 0.5, low = floor(place), f = place - low;
        long x = (long)low.x, y = (long)low.y;
        double3 top = (1.0 - f.x) * texel(w, texture, x, y) + f.x * texel(w, texture, x + 1, y);
        double3 bottom = (1.0 - f.x) * texel(w, texture, x, y + 1) + f.x * texel(w, texture, x + 1, y + 1);
        return (1.0 - f.y) * top + f.y * bottom;
    }
    bool second = texture[0] == CHECKERBOARD && (((long)floor(2.0 * st.x) + (long)floor(2.0 * st.y)) & 1);
    return at3(texture + (second ? 4 : 1));
}

/* Light ---------------------------------------------------------------------------------------------------------------- */

/* A rectangle, or the part of it that counts, as seen from a receiver. */
typedef struct {
    double3 corner, e1, e2;
} Patch;

/* Cuts the patch along its edges to what is above the horizon of n; false if nothing is. */
INLINE bool cut_to_horizon(Patch *patch, double3 n)
{
    double value = inner(n, patch->corner), a = inner(n, patch->e1), b = inner(n, patch->e2);
    double from = -(value + larger(b, 0.0)) / a, other = -(value + larger(a, 0.0)) / b;
    if (value + smaller(a, 0.0) + smaller(b, 0.0) >= 0.0)
        return true;
    double low1 = a > 0.0 ? larger(from, 0.0) : 0.0, high1 = a < 0.0 ? smaller(from, 1.0) : 1.0;
    double low2 = b > 0.0 ? larger(other, 0.0) : 0.0, high2 = b < 0.0 ? smaller(other, 1.0) : 1.0;
    patch->corner += low1 * patch->e1 + low2 * patch->e2;
    patch->e1 *= high1 - low1;
    patch->e2 *= high2 - low2;
    return high1 > low1 && high2 > low2;
}

/* x in [0, 1] with density proportional to (1 - x) a + x b. */
INLINE double linear(double u, double a, double b)
{
    return smaller(u * (a + b) / larger(a + sqrt((1.0 - u) * a * a + u * b * b), 1e-30), 1.0);
}

/* Edge coordinates on a patch, uniform in solid angle (Urena, Fajardo, King 2013); the solid angle, or 0 if it is small. */
INLINE double by_solid_angle(const Patch *patch, double height, double2 u, double2 *st)
{
    double2 size = (double2)(sqrt(inner(patch->e1, patch->e1)), sqrt(inner(patch->e2, patch->e2)));
    if (!(fabs(inner(patch->e1, patch->e2)) < 1e-5 * size.x * size.y))
        return 0.0;
    double2 low = (double2)(inner(patch->corner, patch->e1), inner(patch->corner, patch->e2)) / size, high = low + size;
    double4 side = (double4)(-low.y, high.x, high.y, -low.x), cosine = side / sqrt(side * side + height * height);
    double4 angle = acos(-cosine * cosine.yzwx);
    double solid_angle = angle.x + angle.y + angle.z + angle.w - 2.0 * M_PI;
    if (!(solid_angle > 0.05))
        return 0.0;
    double turn = u.x * solid_angle + 2.0 * M_PI - angle.z - angle.w;
    double slope = (cos(turn) * cosine.x - cosine.z) / sin(turn);
    double c = copysign(1.0 / sqrt(slope * slope + cosine.x * cosine.x), slope);
    double x = smaller(larger(c * height / sqrt(1.0 - c * c), low.x), high.x), d2 = x * x + height * height;
    double v0 = low.y / sqrt(d2 + low.y * low.y), v1 = high.y / sqrt(d2 + high.y * high.y), v = v0 + u.y * (v1 - v0);
    double y = smaller(larger(v * sqrt(d2 / larger(1.0 - v * v, 1e-30)), low.y), high.y);
    *st = ((double2)(x, y) - low) / size;
    return solid_angle;
}

/* What a patch of radiance 1 sends from a point chosen as pyrt does (rectangle_sample in light.h); the point in *to. */
INLINE double guided(Patch patch, const Point *x, double2 u, double3 *to)
{
    double3 normal = unit3(outer(patch.e1, patch.e2));
    double height = -inner(normal, patch.corner);
    if (!(height > 0.0) || !cut_to_horizon(&patch, x->shading))
        return 0.0;
    double weight[4], nearest = INFINITY;
    for (int i = 0; i < 4; ++i) {
        *to = patch.corner + (i % 2) * patch.e1 + (i / 2) * patch.e2;
        double cosine = inner(*to, x->shading), r2 = inner(*to, *to);
        weight[i] = cosine > 0.0 ? cosine / (r2 * r2) : 0.0;
        nearest = smaller(nearest, r2);
    }
    double sum = weight[0] + weight[1] + weight[2] + weight[3], solid_angle = 0.0, density = 1.0;
    if (!(sum > 0.0))
        return 0.0;
    double2 st;
    if (nearest < inner(patch.e1, patch.e1) + inner(patch.e2, patch.e2))
        solid_angle = by_solid_angle(&patch, height, u, &st);
    if (solid_angle == 0.0) {
        st.y = linear(u.y, weight[0] + weight[1], weight[2] + weight[3]);
        double a = weight[0] + st.y * (weight[2] - weight[0]), b = weight[1] + st.y * (weight[3] - weight[1]);
        st.x = linear(u.x, a, b);
        density = (a + st.x * (b - a)) * 4.0 / sum;
    }
    *to = patch.corner + st.x * patch.e1 + st.y * patch.e2;
    double r2 = inner(*to, *to);
    double area = sqrt(inner(outer(patch.e1, patch.e2), outer(patch.e1, patch.e2)));
    return inner(*to, x->shading) * (solid_angle > 0.0 ? solid_angle / sqrt(r2) : height * area / (r2 * r2 * density));
}

/* The same for a point that is uniform on the patch. */
INLINE double uniform(Patch patch, const Point *x, double2 u, double3 *to)
{
    *to = patch.corner + u.x * patch.e1 + u.y * patch.e2;
    double r2 = inner(*to, *to);
    return inner(*to, x->shading) * -inner(*to, outer(patch.e1, patch.e2)) / (r2 * r2);
}

/* Irradiance from all lights at x, whose normals are on the side that is seen. */
INLINE double3 irradiance_at(const World *w, const Point *x, Sampler sampler)
{
    double3 sum = 0.0, to;
    for (int i = 0; i < w->n.point_count; ++i) {
        const global double *light = w->points + 6 * i;
        to = at3(light) - x->p;
        double r2 = inner(to, to), cosine = inner(to, x->shading) / sqrt(r2);
        if (inner(to, x->n) > 0.0 && cosine > 0.0 && is_free(w, x->p, to))
            sum += at3(light + 3) * (cosine / (4.0 * M_PI * r2));
    }
    sampler.pixel = w->uniform ? hash(~sampler.pixel) : sampler.pixel;
    for (int i = 0; i < w->n.rectangle_count; ++i) {
        const global double *light = w->rectangles + 12 * i;
        double2 u = random_pair(sampler, 1u + 2u * (uint)(w->n.point_count + i));
        Patch patch = {at3(light) - x->p, at3(light + 3), at3(light + 6)};
        double received = w->uniform ? uniform(patch, x, u, &to) : guided(patch, x, u, &to);
        if (received > 0.0 && inner(to, x->shading) > 0.0 && inner(to, x->n) > 0.0 && is_free(w, x->p, to))
            sum += at3(light + 9) * received;
    }
    return sum;
}

/* Paths ---------------------------------------------------------------------------------------------------------------- */

INLINE double3 bend(double3 d, double3 n, double eta)
{
    n = inner(n, d) > 0.0 ? -n : n;
    double cosine = -inner(n, d), cos2_t = 1.0 - eta * eta * (1.0 - cosine * cosine);
    return unit3(cos2_t > 0.0 ? eta * d + (eta * cosine - sqrt(cos2_t)) * n : d + 2.0 * cosine * n);
}

INLINE double reflectance_of(double cosine, double eta)
{
    double cos2_t = 1.0 - eta * eta * (1.0 - cosine * cosine);
    double cos_t = sqrt(larger(cos2_t, 0.0));
    double parallel = (cosine - eta * cos_t) / (cosine + eta * cos_t);
    double perpendicular = (eta * cosine - cos_t) / (eta * cosine + cos_t);
    return cos2_t > 0.0 ? 0.5 * (parallel * parallel + perpendicular * perpendicular) : 1.0;
}

/* Adds the one or two rays that go on from a specular surface. */
INLINE void follow(const World *w, const global double *material, const Point *x, const Path *path, Sampler sampler,
                   Path *pending, int *count, int *splits)
{
    double3 d = path->d, n = inner(x->shading, x->n) < 0.0 ? -x->shading : x->shading;
    n = inner(d, n) * inner(d, x->n) > 0.0 ? n : x->n;
    double eta = inner(d, x->n) < 0.0 ? material[3] : 1.0 / material[3];
    Path bent = {x->p, bend(d, n, eta), path->weight, path->depth + 1};
    if (material[0] == REFRACTION) {
        pending[(*count)++] = bent;
        return;
    }
    double r = reflectance_of(fabs(inner(d, n)), eta), weaker = path->weight * smaller(r, 1.0 - r);
    Path mirrored = {x->p, unit3(d - 2.0 * inner(d, n) * n), path->weight, path->depth + 1};
    bent.weight *= eta * eta;
    if (weaker >= SPLIT_WEIGHT && *count < SPLIT_PATHS && *splits > 0) {
        --*splits;
        mirrored.weight *= r;
        bent.weight *= 1.0 - r;
        pending[(*count)++] = mirrored;
        pending[(*count)++] = bent;
    } else {
        uint pair = 1u + 2u * (uint)(w->n.point_count + w->n.rectangle_count) + (uint)path->depth;
        pending[(*count)++] = random_pair(sampler, pair).x < r ? mirrored : bent;
    }
}

INLINE double3 radiance_along(const World *w, double3 o, double3 d, Sampler sampler)
{
    Path pending[SPLIT_PATHS + 2] = {{o, d, 1.0, 0}};
    double3 sum = 0.0;
    int splits = SPLITS;
    for (int count = 1; count > 0;) {
        Path path = pending[--count];
        Nearest hit = trace(w, path.o, path.d, INFINITY, false);
        if (hit.id < 0)
            continue;
        Point x = point_at(w, hit, path.o, path.d);
        const global double *shape = w->shapes + 4 * x.shape, *material = w->materials + 4 * (int)shape[0];
        bool front = inner(path.d, x.n) < 0.0;
        if (front)
            sum += path.weight * at3(shape + 1);
        if (shape[0] < 0.0)
            continue;
        if (material[0] == DIFFUSE && (front || material[2] != 0.0)) {
            x.n = front ? x.n : -x.n;
            x.shading = inner(x.shading, x.n) < 0.0 ? -x.shading : x.shading;
            sum += path.weight / M_PI * color_at(w, (int)material[1], x.uv) * irradiance_at(w, &x, sampler);
        } else if (material[0] != DIFFUSE && path.depth < w->n.max_depth) {
            follow(w, material, &x, &path, sampler, pending, &count, &splits);
        }
    }
    return sum;
}

/* Work-item: `block` samples of one pixel of row `row`; their sum. */
kernel __attribute__((reqd_work_group_size(LOCAL_SIZE, 1, 1)))
void picture(const Counts n, const double clearance, const int uniform, const uint seed, const uint row, const uint block,
             const uint blocks,
             const global double *boxes, const global int *links, const global double *corners, const global double *uvs,
             const global double *normals, const global int *owners, const global double *spheres,
             const global double *shapes, const global double *materials, const global double *textures,
             const global float *texels, const global double *points, const global double *rectangles,
             const global double *camera, /* position, then direction at the upper-left corner and its steps per pixel */
             global double *sums)
{
    const World w = {n,       clearance, boxes,     links,    corners, uvs,    normals,   owners,
                     spheres, shapes,    materials, textures, texels,  points, rectangles, uniform};
    uint item = (uint)get_global_id(0), column = item / blocks;
    if (column >= (uint)n.size)
        return;
    uint pixel = column | row << 16;
    Sampler sampler = {hash(pixel ^ hash(seed + 0x51633e2du)), (item % blocks) * block};
    double3 sum = 0.0;
    for (uint i = 0; i < block; ++i, ++sampler.index) {
        double2 place = random_pair(sampler, 0u) + (double2)(column, row);
        double3 d = at3(camera + 3) + place.x * at3(camera + 6) + place.y * at3(camera + 9);
        sum += radiance_along(&w, at3(camera), unit3(d), sampler);
    }
    vstore3(sum, item, sums);
}
