/* direct_private.h: the state behind direct_pixels.h and direct_tile.h, and what their files do for one
 * another. Each uses those below it:
 *
 *   direct_tile.c        a screen tile: which lights count there, in which order they are added
 *   direct_job.c         one light at a tile, and the lights beyond the limit
 *   direct_weak.c        blocks as one point, lights that are weak there
 *   direct_resolve.c     shadow rays -> the share of a light that each pixel sees
 *   direct_rays.c        shadow rays: few at first, more where these disagree
 *   direct_unshadowed.c  E of a light without shadows, and what a finish mirrors of it
 *   direct_choice.c      the lights that may count within a tile
 *   direct_pixels.c      the lights of a picture
 *
 * Threads: while tiles are lit, the picture's state is constant and shared; a tile and its job belong to one
 *          worker. For these files alone. */
#ifndef LW_CLIENT_VIEW_LIGHTS_DIRECT_PRIVATE_H
#define LW_CLIENT_VIEW_LIGHTS_DIRECT_PRIVATE_H

#include "client/view/lights/direct_pixels.h"
#include "client/view/lights/direct_tile.h"
#include "client/view/lights/emitter_clusters.h"
#include "common/base/box.h"
#include "common/light/lights16.h"

#define LW_DIRECT_LANES    LW_TRACE_WIDTH
#define LW_DIRECT_BLOCKS   LW_DIRECT_TILE_BLOCKS
#define LW_DIRECT_SIDE     (4u * LW_DIRECT_TILE_SIDE) /* pixels of a tile */
#define LW_DIRECT_SAMPLES  8u                         /* shadow rays of a pixel, at most */
#define LW_DIRECT_VARIANTS 8u /* sequences of random numbers that blocks choose from */
/* A light that gives a pixel less than this share of its light so far has one ray for 2 x 2 pixels. */
#define LW_DIRECT_SHARE_FAINT 0.005f

/* A cluster is a group of emissive triangles. */
enum lw_direct_kind { LW_DIRECT_SUN, LW_DIRECT_NEAR, LW_DIRECT_CLUSTER };

/* All lights, structure of arrays, for direct_choice.c. */
struct lw_direct_candidates {
    uint32_t count;
    float *x, *y, *z; /* m */
    float *radius_m;
    float *intensity; /* luminance, W/sr, the most in any direction; suns: W/m^2 */
    float *axis_x, *axis_y, *axis_z, *cos_reach, *sin_reach; /* a spot's; cos_reach -1: all around */
    uint32_t *index;                                         /* the scene's light or the cluster */
    uint8_t *kind;
};

/* Directions of a sun's shadow rays. */
typedef struct lw_vec3 lw_direct_sun[LW_DIRECT_VARIANTS][LW_DIRECT_SAMPLES][LW_DIRECT_LANES];

struct lw_direct_pixels {
    struct lw_direct_pixels_desc desc;
    struct lw_client_lights drawn; /* desc.drawn, by value: its owner may move */
    struct lw_lights lights;
    struct lw_emitter_clusters clusters;
    bool ready; /* lights and clusters are there */
    bool fresh; /* the clusters have no place yet */
    struct lw_direct_candidates candidates;
    float *memory;           /* holds the candidates' numbers */
    uint32_t capacity;       /* in candidates */
    struct lw_affine *place; /* per object: where its emitters were at the last picture */
    bool *hidden;            /* per object */
    struct lw_box *box;      /* per mesh, object space */
    bool *dirty;             /* per cluster: its place is out of date */
    float (*emission)[3];    /* per material */
    bool blends;             /* there are surfaces that let part of the light pass */
    float white;
    float point[LW_DIRECT_VARIANTS][LW_DIRECT_SAMPLES][LW_DIRECT_LANES][2];
    lw_direct_sun *sun; /* per candidate that is a sun */
    uint32_t seed;
};

struct lw_direct_chosen {
    uint32_t candidate;
    float bound; /* upper bound of its E within the tile */
};

/* Blocks of a tile, each as one point. */
struct lw_direct_summary {
    /* mean points and normals; any finite ones of empty blocks */
    struct lw_points16 middle[LW_DIRECT_BLOCKS / LW_DIRECT_LANES];
    float radius_m[LW_DIRECT_BLOCKS]; /* how far points lie from the middle, at most */
    float spread[LW_DIRECT_BLOCKS];   /* how far normals differ from the mean, at most */
    float found[LW_DIRECT_BLOCKS];    /* E so far, luminance, mean */
    float filled[LW_DIRECT_BLOCKS];   /* 0: no point is active; else 1 */
};

/* A light at the blocks of a tile; luminance, W/m^2. */
struct lw_direct_outlook {
    float full[LW_DIRECT_BLOCKS];     /* E at the middle of what faces the light */
    float expected[LW_DIRECT_BLOCKS]; /* E at the middle */
    float most[LW_DIRECT_BLOCKS];     /* E anywhere in the block, as far as the middle tells */
    float near[LW_DIRECT_BLOCKS];     /* distance over the block's radius */
};

/* States of a block: its rays have found shadow, light. */
enum { LW_DIRECT_DARK = 1, LW_DIRECT_LIT = 2 };

/* A worker's memory. Pixels of a tile are numbered block by block: 16 block + lane. */
struct lw_direct_work {
    float e[LW_DIRECT_BLOCKS][LW_DIRECT_LANES]; /* E of the light at hand without shadows, over its colour */
    uint16_t facing[LW_DIRECT_BLOCKS];          /* bit i: e > 0 */
    /* bit i: e is at least a share of all light: LW_DIRECT_SHARE_FAINT, direct_job.c's SEEN and NOISY */
    uint16_t faint[LW_DIRECT_BLOCKS], seen[LW_DIRECT_BLOCKS], noisy[LW_DIRECT_BLOCKS];
    struct lw_gloss_lit16 gloss[LW_DIRECT_BLOCKS]; /* blocks with a finish: of the light at hand's e */
    uint16_t reached[LW_DIRECT_BLOCKS];            /* blocks with a finish: bit i: e > 0 */
    uint16_t flat[LW_DIRECT_BLOCKS];               /* bit i: pixel i belongs to a quad on one surface */
    bool finished;                                 /* some pixels of the tile have a finish */
    bool whole[LW_DIRECT_BLOCKS];                  /* the block lies on one flat piece of surface */
    /* shadow rays of a pixel: those that found light, all */
    uint8_t lit[LW_DIRECT_BLOCKS * LW_DIRECT_LANES], taken[LW_DIRECT_BLOCKS * LW_DIRECT_LANES];
    float share[LW_DIRECT_BLOCKS * LW_DIRECT_LANES];
    uint8_t state[LW_DIRECT_BLOCKS];
    /* bit x: a ray of that pixel has found light, shadow */
    uint32_t lit_row[LW_DIRECT_SIDE], dark_row[LW_DIRECT_SIDE];
    /* lw_emitter_clusters_share() of blocks, or of all in the first */
    float part[LW_DIRECT_BLOCKS][LW_EMITTER_CLUSTERS_POINTS];
    uint32_t shared[LW_DIRECT_BLOCKS]; /* the number of the job that has filled it */
    uint32_t jobs;
    struct lw_ray16 rays;
    uint16_t pixel[LW_DIRECT_LANES]; /* the rays' pixels */
    uint32_t waiting;                /* rays in the packet */
    struct lw_direct_summary summary;
    struct lw_direct_outlook outlook[LW_DIRECT_TILE_LIGHTS_MAX]; /* as in order */
    float weak[3][LW_DIRECT_BLOCKS];                             /* E of weak lights, W/m^2 */
    float *bound;                                                /* per candidate */
    struct lw_direct_chosen *order;
    uint32_t bound_capacity;
};

/* The light at hand, for one tile. */
struct lw_direct_job {
    const struct lw_direct_pixels *direct;
    struct lw_direct_tile *tile;
    struct lw_direct_work *work;
    uint32_t candidate;
    uint32_t seed;
    bool wide;       /* shadow rays of a pixel may differ */
    bool far;        /* the tile is small, seen from the light */
    bool finished;   /* some of its pixels have a finish */
    uint32_t number; /* this job's number in the worker's memory */
};

#endif
