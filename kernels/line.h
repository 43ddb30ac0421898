/* Direct light of a rectangle, a whole line of it at a time.
 *
 * A sample picks a line across the light and finds in closed form what arrives from those parts of it that the triangles of a
 * shaft leave visible. Of a penumbra's two dimensions only one is left to chance, and of a horizon's none: the variance falls
 * with N^-3 in place of N^-3/2 where no edge of the shadow runs along the lines. (Billen, Dutre: Line Sampling for Direct
 * Illumination, 2016.)
 */
#ifndef PYRT_LINE_H
#define PYRT_LINE_H

#include "light.h"

/* The points a + s e, 0 <= s <= 1, as seen from the receiver. Along it u = (s - foot) * length counts from the nearest point. */
typedef struct {
    Vec a, e;
    Real length;
    Real foot;
    Real d2;        /* squared distance of the whole line */
    Real n0, n1;    /* the receiver's cosine times distance is n0 + n1 u */
    Real low, high; /* the part in front of the receiver, in s */
} LightLine;

/* The angle of (x, y), y >= 0, in [0, pi], within 2 ulp. */
INLINE Real angle_of(Real x, Real y)
{
    Real a = abs1(x), low = min1(a, y), high = max1(a, y);
    Int steep = low > 0.41421356f * high; /* tan(pi / 8) */
    Real r = (steep ? low - high : low) / (steep ? low + high : high), z = r * r;
    Real tail = fma1(fma1(fma1((Real)(0.0806027949f), z, (Real)(-0.138798401f)), z, (Real)(0.199779257f)), z, (Real)(-0.333329558f));
    Real angle = fma1(r * z, tail, r);
    angle = steep ? angle + 0.25f * PI : angle;
    angle = y > a ? 0.5f * PI - angle : angle;
    return x < 0.0f ? PI - angle : angle;
}

/* Integral of cosine / distance^3 over u, from s = from to s = to. The antiderivative's difference is taken in closed form, so
 * that nothing cancels where the line is short and far away. */
INLINE Real line_integral(const LightLine *line, Real from, Real to)
{
    Real u = (from - line->foot) * line->length, v = (to - line->foot) * line->length, step = (to - from) * line->length;
    Real d2 = line->d2, d = sqrt1(d2);
    Real inv_r4 = 1.0f / (fma1(u, u, d2) * fma1(v, v, d2));
    Real angle = angle_of(fma1(u, v, d2), d * step);
    Real even = fma1(step * fma1(-u, v, d2), inv_r4, angle / d) / d2, odd = step * (u + v) * inv_r4;
    return max1(0.5f * fma1(line->n0, even, line->n1 * odd), (Real)(0.0f));
}

/* Cuts it to where value + slope s > 0. */
INLINE void line_clip(LightLine *line, Real value, Real slope)
{
    Real zero = -value / slope;
    line->low = slope > 0.0f ? max1(zero, line->low) : line->low;
    line->high = slope < 0.0f ? min1(zero, line->high) : line->high;
    line->high = (slope == 0.0f) & (value <= 0.0f) ? line->low : line->high;
}

INLINE LightLine line_from(const Surface *si, Vec a, Vec e)
{
    LightLine line = {a, e};
    Real length2 = dot3(e, e), along = dot3(a, e), slope = dot3(si->n, e);
    Vec c = cross3(a, e);
    line.length = sqrt1(length2);
    line.foot = -along / length2;
    line.d2 = dot3(c, c) / length2 + 1e-24f; /* so that no later quotient overflows */
    line.n0 = dot3(si->n, madd3(e, line.foot, a));
    line.n1 = slope / line.length;
    line.low = (Real)(0.0f);
    line.high = (Real)(1.0f);
    line_clip(&line, dot3(si->n, a), slope);
    if (HAS_SMOOTH_NORMALS || HAS_SPHERES)
        line_clip(&line, dot3(si->ng, a), dot3(si->ng, e));
    return line;
}

INLINE Real line_whole(const LightLine *line)
{
    return line->high > line->low ? line_integral(line, line->low, line->high) : 0.0f;
}

/* Places between the first line of a patch, 0, and the last one, 1, with a density that is nearly proportional to what arrives
 * from there: linear between the two ends. */
INLINE Real line_place(const Surface *si, const Patch *patch, Vec to, Real u, Real *density)
{
    Real tiny = (Real)(1e-24f);
    Vec c10 = add3(to, patch->e1), c01 = add3(to, patch->e2), c11 = add3(c01, patch->e1);
    Vec4 r2 = {dot3(to, to) + tiny, dot3(c10, c10) + tiny, dot3(c01, c01) + tiny, dot3(c11, c11) + tiny};
    Real near2 = min1(min1(r2.x, r2.y), min1(r2.z, r2.w));
    Real first = corner_weight(si, to, near2 / r2.x) + corner_weight(si, c10, near2 / r2.y);
    Real last = corner_weight(si, c01, near2 / r2.z) + corner_weight(si, c11, near2 / r2.w);
    Real sum = first + last, v = sample_linear(u, first, last);
    *density = sum > 1e-30f ? 2.0f * lerp1(first, last, v) / sum : 0.0f;
    return v;
}

/* The same of a patch that is nearer than it is wide, where the lines next to the receiver give most: lines of equal length at
 * distance d, with y^2 = d^2 - height^2, give like 1 / d^3, so that y / d is nearly uniform. */
INLINE Real line_place_near(const Surface *si, const Patch *patch, Vec to, Real height, Vec perpendicular, Real u, Real *density)
{
    LightLine line = line_from(si, to, patch->e1);
    Real first = line_whole(&line);
    line = line_from(si, add3(to, patch->e2), patch->e1);
    Real last = line_whole(&line);
    Real width = sqrt1(dot3(perpendicular, perpendicular)), h2 = height * height;
    Real y0 = dot3(to, perpendicular) / width, y1 = y0 + width;
    Real d0 = sqrt1(fma1(y0, y0, h2)), d1 = sqrt1(fma1(y1, y1, h2)), t0 = y0 / d0, t1 = y1 / d1;
    first *= d0 * d0 * d0;
    last *= d1 * d1 * d1;
    Real x = sample_linear(u, first, last), t = lerp1(t0, t1, x);
    Real y = min1(max1(height * t / sqrt1(max1(fma1(-t, t, (Real)(1.0f)), (Real)(1e-14f))), y0), y1);
    Real d2 = fma1(y, y, h2);
    *density = 2.0f * lerp1(first, last, x) * h2 * width / ((first + last) * (t1 - t0) * (d2 * sqrt1(d2)));
    return (y - y0) / width;
}

/* Of 0 from the interval that begins at `start`. */
INLINE Real distance_outside(Real start, Real length)
{
    return max1(max1(start, -(start + length)), (Real)(0.0f));
}

INLINE LightLine line_sample(const Surface *si, const Patch *patch, Real height, uint lanes, Real u, Real *density)
{
    Vec to = sub3(patch->corner, si->p);
    Real v = line_place(si, patch, to, u, density);
    Real length2 = dot3(patch->e1, patch->e1), x = dot3(to, patch->e1);
    Vec perpendicular = sub3(patch->e2, scale3(patch->e1, dot3(patch->e1, patch->e2) / length2));
    Real width2 = dot3(perpendicular, perpendicular), y = dot3(to, perpendicular);
    Real aside = distance_outside(x, length2), before = distance_outside(y, width2);
    Int near = fma1(height, height, aside * aside / length2 + before * before / width2) < width2;
    if ((lanes & lanes_of(near)) != 0u) {
        Real other_density, other = line_place_near(si, patch, to, height, perpendicular, u, &other_density);
        v = near ? other : v;
        *density = near ? other_density : *density;
    }
    return line_from(si, madd3(patch->e2, v, to), patch->e1);
}

/* The plane through a receiver at o and a line: normal . x = 0. A point x - o of it is alpha times one of the line, at
 * s = beta / alpha. */
typedef struct {
    Vec o, normal, alpha, beta;
} Fan;

INLINE Fan fan_from(Vec o, Vec a, Vec e)
{
    Fan fan;
    fan.o = o;
    fan.normal = cross3(a, e);
    Real inv = 1.0f / (dot3(fan.normal, fan.normal) + 1e-37f);
    fan.alpha = scale3(cross3(e, fan.normal), inv);
    fan.beta = scale3(cross3(fan.normal, a), inv);
    return fan;
}

typedef struct {
    Real side, alpha, beta;
} FanPoint;

INLINE FanPoint fan_point_choose(Int mask, FanPoint a, FanPoint b)
{
    FanPoint c = {mask ? a.side : b.side, mask ? a.alpha : b.alpha, mask ? a.beta : b.beta};
    return c;
}

/* Where an edge meets the plane. From both ends it is the same to the last bit, so that triangles which share it leave no gap. */
INLINE FanPoint fan_crossing(FanPoint p, FanPoint q)
{
    Real inv = 1.0f / (q.side - p.side);
    FanPoint c = {(Real)(0.0f), (p.alpha * q.side - q.alpha * p.side) * inv, (p.beta * q.side - q.beta * p.side) * inv};
    return c;
}

/* s of a crossing, or of where the way to the other one enters 0 < alpha < 1. */
INLINE Real fan_shadow_end(FanPoint p, Real slope)
{
    Real beyond = fma1(1.0f - p.alpha, slope, p.beta), behind = fma1(-p.alpha, slope, p.beta) * 0x1p100f;
    return p.alpha > 1.0f ? beyond : p.alpha > 0.0f ? p.beta / p.alpha : behind;
}

/* The part of the line that a triangle hides, from *low to *high; *low > *high: none. */
INLINE void fan_shadow(const Fan *fan, const Scene *scene, int place, Real *low, Real *high)
{
    const global TriangleBlock *block = &scene->triangle_blocks[place / BVH_WIDTH];
    int lane = place % BVH_WIDTH;
    FanPoint p[3];
    for (int i = 0; i < 3; ++i) {
        Vec x = sub3(vec_of(block->vertex[i][0][lane], block->vertex[i][1][lane], block->vertex[i][2][lane]), fan->o);
        FanPoint point = {dot3(fan->normal, x), dot3(fan->alpha, x), dot3(fan->beta, x)};
        p[i] = point;
    }
    Int side0 = p[0].side >= 0.0f, side1 = p[1].side >= 0.0f, side2 = p[2].side >= 0.0f;
    Int all = (side0 == side1) & (side0 == side2);
    Int second = (side1 != side0) & (side1 != side2), third = (side2 != side0) & (side2 != side1);
    FanPoint alone = fan_point_choose(second, p[1], fan_point_choose(third, p[2], p[0]));
    FanPoint c = fan_crossing(alone, fan_point_choose(second, p[0], p[1]));
    FanPoint d = fan_crossing(alone, fan_point_choose(third, p[0], p[2]));
    Int some = !all & (max1(c.alpha, d.alpha) > 0.0f) & (min1(c.alpha, d.alpha) < 1.0f);
    Real slope = (d.beta - c.beta) / (d.alpha - c.alpha);
    Real s = fan_shadow_end(c, slope), t = fan_shadow_end(d, slope);
    *low = some ? min1(s, t) : INFINITY;
    *high = some ? max1(s, t) : -INFINITY;
}

/* The shadows on a line, ordered by where they begin; returns how many there are. */
INLINE int fan_shadows(const Fan *fan, const Scene *scene, const LightLine *line, Int self, uint lanes,
                       const global Candidates *shaft, Real *low, Real *high)
{
    int count = 0;
    for (int k = 0; k < shaft->count; ++k) {
        Real from, to;
        fan_shadow(fan, scene, shaft->places[k], &from, &to);
        Int some = (to > line->low) & (from < line->high) & (self != candidate_id(scene, shaft->places[k]));
        if ((lanes & lanes_of(some)) == 0u)
            continue;
        from = some ? from : INFINITY;
        to = some ? to : -INFINITY;
        int place = count++;
        for (; place > 0; --place) {
            Real other_from = low[place - 1], other_to = high[place - 1];
            Int before = other_from > from;
            if ((lanes & lanes_of(before)) == 0u)
                break;
            low[place] = before ? other_from : from;
            high[place] = before ? other_to : to;
            from = before ? from : other_from;
            to = before ? to : other_to;
        }
        low[place] = from;
        high[place] = to;
    }
    return count;
}

/* What is left of the line between the shadows, integrated as in line_integral. */
INLINE Real line_visible(const LightLine *line, uint lanes, int count, const Real *low, const Real *high)
{
    Real sum = (Real)(0.0f), end = line->low;
    for (int k = 0; k <= count; ++k) {
        Real next = k < count ? min1(low[k], line->high) : line->high;
        Int gap = next > end;
        if ((lanes & lanes_of(gap)) != 0u) {
            Real part = line_integral(line, end, next);
            sum += gap ? part : 0.0f;
        }
        end = max1(end, next);
        end = k < count ? max1(end, high[k]) : end;
    }
    return sum;
}

/* What arrives from a rectangle, past the triangles of a shaft. */
NO_INLINE Vec line_irradiance(const Scene *scene, const global Light *light, const Surface *si, uint lanes, Real u,
                              const global Candidates *shaft, Counters *counters)
{
    bool across = shaft->across != 0;
    Patch patch = {vec_load(light->position), vec_load(across ? light->edge2 : light->edge1),
                   vec_load(across ? light->edge1 : light->edge2), (Real)(light->area)};
    Real height = dot3(vec_load(light->n), sub3(si->p, patch.corner)), density;
    patch_clip(si, &patch);
    uint above = lanes & lanes_of((height > 0.0f) & (patch.area > 0.0f));
    LightLine line = line_sample(si, &patch, height, above, u, &density);
    uint lit = above & lanes_of((density > 0.0f) & (line.high > line.low));
    counters->dark += popcount(lanes & ~lit);
    if (lit == 0u)
        return vec_of(0.0f, 0.0f, 0.0f);
    Real low[SHAFT_CANDIDATES], high[SHAFT_CANDIDATES];
    int count = 0;
    if (shaft->count > 0) {
        Vec o = spawn_point(si, si->ng);
        Fan fan = fan_from(o, off_light(light, add3(line.a, sub3(si->p, o))), line.e);
        count = fan_shadows(&fan, scene, &line, si->id, lit, shaft, low, high);
        counters->shadow += popcount(lit);
    } else {
        counters->clear += popcount(lit);
    }
    Real visible = line_visible(&line, lit, count, low, high);
    Vec light_all = light_irradiance(light, visible * height * patch.area / (density * line.length));
    return select3(mask_of(lit), light_all, vec_of(0.0f, 0.0f, 0.0f));
}

#endif
