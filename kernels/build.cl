/* Splits nodes of a binary tree over boxes by the surface area heuristic: pyrt/sah.py, step for step, with the same tree as
 * the result wherever division is correctly rounded. See there for the method.
 *
 * A primitive is its box, -low and high, and its id in the bits of s6. One work-item takes one node. A node of more than
 * `whole` primitives is split once, and its children are tasks of the next launch; the others are split down to leaves.
 * Each task's nodes begin at twice the place of its first primitive, the root first; children lie side by side.
 */
#include "types.h"

#pragma OPENCL FP_CONTRACT OFF

#define MAX_BINS 32
#define SMALL_GAIN 0.8f
#define BALANCE 1e-5f

typedef struct {
    float8 box[3][MAX_BINS]; /* [axis] */
    uint count[3][MAX_BINS];
} Bins;

typedef struct {
    int axis;
    int last; /* bins above it are on the right */
    bool gain; /* worth it even for a node that fits a block */
} Plane;

/* Where the positions of a node's primitives (twice their centers) lie. The last component of vectors has no meaning. */
typedef struct {
    float4 low;
    float4 extent;
    float4 unit; /* the same, but never 0 */
    float bins;
} Grid;

static float4 position(float8 p) { return p.s3454 - p.s0121; }
static float8 join(float8 a, float8 b) { return b > a ? b : a; }

static int4 grid_bins(const Grid *grid, float4 x)
{
    float4 place = (x - grid->low) / grid->unit * grid->bins, last = grid->bins - 1.0f;
    return convert_int4(place < last ? place : last); /* never negative */
}

static Grid grid_of(const global float8 *primitives, uint count)
{
    Grid grid;
    float4 low = position(primitives[0]), high = low;
    for (uint i = 1; i < count; ++i) {
        float4 x = position(primitives[i]);
        low = x < low ? x : low;
        high = x > high ? x : high;
    }
    grid.low = low;
    grid.extent = high - low;
    grid.unit = grid.extent == 0.0f ? 1.0f : grid.extent;
    grid.bins = count <= 8 ? 8.0f : count <= 32 ? 16.0f : 32.0f;
    return grid;
}

static void fill_bins(const global float8 *primitives, uint count, const Grid *grid, Bins *bins)
{
    for (int axis = 0; axis < 3; ++axis)
        for (int k = 0; k < (int)grid->bins; ++k) {
            bins->box[axis][k] = -INFINITY;
            bins->count[axis][k] = 0;
        }
    for (uint i = 0; i < count; ++i) {
        float8 p = primitives[i];
        int4 cell = grid_bins(grid, position(p));
        bins->box[0][cell.x] = join(bins->box[0][cell.x], p);
        bins->box[1][cell.y] = join(bins->box[1][cell.y], p);
        bins->box[2][cell.z] = join(bins->box[2][cell.z], p);
        ++bins->count[0][cell.x];
        ++bins->count[1][cell.y];
        ++bins->count[2][cell.z];
    }
}

/* Half the surface in units of unit^2; inf for the box of nothing. */
static float area(float8 box, float unit)
{
    float4 e = (box.s0121 + box.s3454) / unit;
    return e.x * e.y + e.z * (e.x + e.y);
}

static float blocks(uint count) { return (float)((count + BVH_WIDTH - 1) / BVH_WIDTH); }

/* The best plane between bins; `box` becomes the node's. */
static Plane best_plane(const Bins *bins, int size, uint count, float8 *box)
{
    Plane best = {0, 0, false};
    float least = INFINITY, unit = 1.0f, balance = BALANCE / (float)count;
    float8 above[MAX_BINS];
    for (int axis = 0; axis < 3; ++axis) {
        above[size - 1] = bins->box[axis][size - 1];
        for (int k = size - 2; k >= 0; --k)
            above[k] = join(above[k + 1], bins->box[axis][k]);
        if (axis == 0) {
            *box = above[0];
            float4 e = box->s0121 + box->s3454;
            unit = e.x > e.y ? e.x : e.y;
            unit = e.z > unit ? e.z : unit;
            unit = unit == 0.0f ? 1.0f : unit;
        }
        float8 below = bins->box[axis][0];
        uint left = 0;
        for (int k = 0; k < size - 1; ++k) {
            if (bins->count[axis][k] == 0)
                continue; /* the same sides as for the plane before */
            below = join(below, bins->box[axis][k]);
            left += bins->count[axis][k];
            float cost = area(below, unit) * blocks(left) + area(above[k + 1], unit) * blocks(count - left);
            cost += fabs((float)left - (float)(count - left)) * balance;
            if (cost < least) {
                least = cost;
                best.axis = axis;
                best.last = k;
            }
        }
    }
    best.gain = least < SMALL_GAIN * area(*box, unit);
    return best;
}

static float component(float4 v, int axis) { return axis == 0 ? v.x : axis == 1 ? v.y : v.z; }

static uint on_left(const Bins *bins, Plane plane)
{
    uint left = 0;
    for (int k = 0; k <= plane.last; ++k)
        left += bins->count[plane.axis][k];
    return left;
}

/* Moves what lies on the left to the front; both sides keep their order. */
static void part(global float8 *primitives, global float8 *scratch, uint count, const Grid *grid, Plane plane)
{
    uint left = 0, right = 0;
    for (uint i = 0; i < count; ++i) {
        float8 p = primitives[i];
        int4 cell = grid_bins(grid, position(p));
        bool moves = (plane.axis == 0 ? cell.x : plane.axis == 1 ? cell.y : cell.z) > plane.last;
        primitives[left] = p;
        scratch[right] = p;
        left += !moves;
        right += moves;
    }
    for (uint i = 0; i < right; ++i)
        primitives[left + i] = scratch[i];
}

/* Bits of x in the order of the numbers; -0 as 0. */
static uint ordered(float x)
{
    uint bits = as_uint(x + 0.0f);
    return bits ^ (bits >> 31 ? 0xffffffffu : 0x80000000u);
}

/* Moves the first `wanted` primitives by position on the widest axis to the front; of equal ones the first. */
static void part_at_rank(global float8 *primitives, global float8 *scratch, uint count, const Grid *grid, uint wanted)
{
    float4 e = grid->extent;
    int axis = e.x >= e.y && e.x >= e.z ? 0 : e.y >= e.z ? 1 : 2;
    uint key = 0, rank = wanted; /* of the sought key's digits so far; among the primitives that share them */
    for (int shift = 24; shift >= 0; shift -= 8) {
        uint histogram[256], digit = 0;
        for (int k = 0; k < 256; ++k)
            histogram[k] = 0;
        for (uint i = 0; i < count; ++i) {
            uint bits = ordered(component(position(primitives[i]), axis));
            if (shift == 24 || bits >> (shift + 8) == key >> (shift + 8))
                ++histogram[bits >> shift & 255];
        }
        for (; rank > histogram[digit]; ++digit)
            rank -= histogram[digit];
        key |= digit << shift;
    }
    uint left = 0, right = 0;
    for (uint i = 0; i < count; ++i) {
        float8 p = primitives[i];
        uint bits = ordered(component(position(p), axis));
        bool stays = bits < key || (bits == key && rank > 0);
        rank -= bits == key && rank > 0;
        primitives[left] = p;
        scratch[right] = p;
        left += stays;
        right += !stays;
    }
    for (uint i = 0; i < right; ++i)
        primitives[left + i] = scratch[i];
}

/* Splits a node that begins at `primitives`; returns how many are on the left, or 0 for a leaf. */
static uint split(global float8 *primitives, global float8 *scratch, uint count, uint depth, uint max_depth, float8 *box)
{
    Bins bins;
    Grid grid = grid_of(primitives, count);
    fill_bins(primitives, count, &grid, &bins);
    Plane plane = best_plane(&bins, (int)grid.bins, count, box);
    uint left = on_left(&bins, plane), larger = max(left, count - left);
    bool bad = larger == count || larger > ((ulong)BVH_WIDTH << max_depth) >> (depth + 1);
    if (count <= BVH_WIDTH && (bad || !plane.gain || depth >= max_depth))
        return 0;
    if (!bad)
        part(primitives, scratch, count, &grid, plane);
    else {
        left = (count + 2 * BVH_WIDTH - 1) / (2 * BVH_WIDTH) * BVH_WIDTH;
        part_at_rank(primitives, scratch, count, &grid, left);
    }
    return left;
}

kernel __attribute__((reqd_work_group_size(1, 1, 1)))
void split_nodes(uint whole, uint max_depth, const global BuildTask *tasks, global float8 *primitives,
                 global float8 *scratch, global BuildNode *nodes, global uint *sizes)
{
    BuildTask stack[BVH_MAX_DEPTH + 1];
    BuildTask task = tasks[get_global_id(0)];
    bool once = task.count > whole;
    uint waiting = 1, size = 1;
    nodes += 2 * (size_t)task.first;
    task.node = 0;
    stack[0] = task;
    while (waiting) {
        task = stack[--waiting];
        float8 box;
        uint left = split(primitives + task.first, scratch + task.first, task.count, task.depth, max_depth, &box);
        global BuildNode *node = nodes + task.node;
        vstore4(box.lo, 0, node->box);
        vstore2(box.s45, 2, node->box);
        node->count = task.count;
        node->link = left ? (int)size : ~(int)task.first;
        if (left == 0)
            continue;
        BuildTask second = {task.first + left, task.count - left, task.depth + 1, size + 1};
        BuildTask first = {task.first, left, task.depth + 1, size};
        nodes[size].count = left;
        nodes[size + 1].count = task.count - left;
        size += 2;
        if (once)
            break;
        stack[waiting++] = second;
        stack[waiting++] = first;
    }
    sizes[get_global_id(0)] = size;
}
