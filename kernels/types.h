/* The one definition of every struct and constant that host and device share.
 *
 * The OpenCL compiler includes this file; pyrt/layout.py parses it and derives the numpy dtypes from it. So it keeps to
 * a small subset of C: `#define NAME integer`, and `typedef struct { ... } Name;` with members of type float, int or uint
 * or of an earlier struct, with literal or #defined array sizes. Every member is 4 bytes wide, so there is no hidden padding.
 *
 * Coordinates are normalised: the host has subtracted the scene's centre and scaled by a power of two to |x| <= 1.
 */
#ifndef PYRT_TYPES_H
#define PYRT_TYPES_H

#define BVH_WIDTH 8       /* children of a node, and primitives of a block: one float8 */
#define BVH_MAX_DEPTH 32  /* the builder's bound on the depth of the tree */
#define BVH_STACK_SIZE 225 /* 7 siblings left behind on each level, and one */

/* A child reference: an inner node's index if >= 0; else ~(2 * block + kind). */
#define BLOCK_TRIANGLES 0
#define BLOCK_SPHERES 1

typedef struct {
    float bounds[3][2][BVH_WIDTH]; /* [axis][low, high][child]; an empty slot has low = +inf, high = -inf */
    int child[BVH_WIDTH];
    int unused[BVH_WIDTH]; /* pads a node to four cache lines */
} BvhNode;

typedef struct {
    float vertex[3][3][BVH_WIDTH]; /* [corner][axis][lane]; an unused lane holds NaN */
    int id[BVH_WIDTH];             /* triangle, or -1 */
} TriangleBlock;

typedef struct {
    float center[3][BVH_WIDTH];
    float radius[BVH_WIDTH]; /* an unused lane holds NaN */
    int id[BVH_WIDTH];       /* primitive, or -1 */
} SphereBlock;

/* A node of the binary tree that becomes the BVH, and one that build.cl has to split. */
typedef struct {
    float box[6]; /* -low, high */
    uint count;   /* primitives below */
    int link;     /* left child, which the right one follows; or of a leaf: ~(place of its first primitive) */
} BuildNode;

typedef struct {
    uint first; /* place of the first primitive */
    uint count;
    uint depth;
    uint node;
} BuildTask;

/* What a bundle of rays may hit: a few triangles; or `count` < 0: unknown, so traverse. A beam is the camera rays of
 * BEAM_SIDE x BEAM_SIDE pixels of the picture, a shaft their shadow rays towards one light. */
#define BEAM_SIDE 4
#define BEAM_PIXELS 16
#define BEAM_CANDIDATES 8
#define SHAFT_CANDIDATES 30
#define SHAFT_LIGHTS 8 /* the first ones; of the others all shadow rays are traced */

typedef struct {
    int count;
    int across; /* of a rectangle light: lines run along its second edge */
    int places[SHAFT_CANDIDATES]; /* of the triangles: BVH_WIDTH * block + lane */
} Candidates;

/* Classes of pixels, by what makes their samples differ. */
#define PIXEL_PLAIN 0    /* one flat surface, and each light wholly visible or wholly hidden */
#define PIXEL_EDGE 1     /* several surfaces */
#define PIXEL_PENUMBRA 2 /* one surface, and something may stand before a part of a light */
#define PIXEL_UNKNOWN 3
#define PIXEL_LIGHT_EDGE 4 /* several surfaces, some of which may emit */
#define PIXEL_CLASSES 5
#define PIXELS_REFINED 64 /* by a work-item of `refine` */

/* Primitive ids: triangles first, in the order of the scene's shapes, then spheres. */

typedef struct {
    float v0[3];
    float offset; /* bound on the rounding error of a hit point along the normal */
    float e1[3];
    int material; /* or -1: absorbs everything */
    float e2[3];
    int light; /* or -1 */
    float n[3]; /* unit geometric normal, the front side */
    int corners; /* index of its Corners, or -1: flat, with uv (0,0) (1,0) (1,1) */
} Triangle;

typedef struct {
    float uv[3][2];
    float n[3][3];
} Corners;

typedef struct {
    float center[3];
    float radius;
    float offset; /* as for triangles */
    int material;
    int light;
    int unused;
} Sphere;

#define MATERIAL_DIFFUSE 0
#define MATERIAL_REFRACTION 1
#define MATERIAL_DIELECTRIC 2

typedef struct {
    int kind;
    int texture;  /* diffuse: the reflectance */
    int twosided; /* diffuse */
    float eta;    /* refraction and dielectric: sin(theta_t) / sin(theta_i) on entering through the front */
} Material;

#define TEXTURE_CONSTANT 0
#define TEXTURE_IMAGE 1
#define TEXTURE_CHECKERBOARD 2

typedef struct {
    int kind;
    uint texels; /* image: index of its first texel */
    int width;
    int height;
    float color0[3];
    float scale_s;
    float color1[3];
    float scale_t;
    float delta[2];
    int unused[2];
} Texture;

#define LIGHT_POINT 0
#define LIGHT_RECTANGLE 1
#define LIGHT_MESH 2
#define LIGHT_SPHERE 3

typedef struct {
    int kind;
    int first; /* first primitive id of an area light */
    int count; /* number of its primitives */
    int cdf;   /* mesh: index of the first of `count` cumulative areas, the last being 1 */
    float position[3]; /* point: position; rectangle: corner; sphere: center */
    float area;
    float edge1[3];
    float radius;
    float edge2[3];
    float offset; /* bound on the rounding error of a sampled point along the normal */
    float n[3];       /* of the rectangle; point: the axis of its cone */
    float cone_inner; /* point: squared distance of unit vectors from the axis where it begins to fade, 0 without a cone */
    float emission[3]; /* point: intensity, in normalised units; area: radiance */
    float cone_slope;  /* point: how fast it fades with that squared distance */
} Light;

/* The ray through film position (x, y), in pixels from the upper-left corner, starts at origin + x * origin_dx + y * origin_dy
 * and runs along direction + x * direction_dx + y * direction_dy. For a camera outside the scene's box the origins lie on a
 * plane just before the box, found in float64, so that distance costs no precision. */
typedef struct {
    float origin[3];
    float origin_dx[3];
    float origin_dy[3];
    float direction[3];
    float direction_dx[3];
    float direction_dy[3];
} Camera;

typedef struct {
    int root;         /* child reference of the BVH's root */
    int triangle_count; /* ids from here on are spheres */
    int light_count;
    int max_depth;    /* specular events before a path is dropped */
    float bound[3];   /* the scene lies in |x| <= bound */
    Camera camera;
} SceneParams;

typedef struct {
    uint first_pixel;  /* of this pass, in the list of pixels */
    uint pixel_count;
    uint sample_count; /* samples of each of them */
    uint first_sample;
    uint stride;       /* floats from one output plane to the next */
    uint seed;
    uint beam_count;
} PassParams;

#endif
