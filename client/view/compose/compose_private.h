/* compose_private.h: a composer's state, and what its files do for one another. Each uses those below it:
 *
 *   compose.c         the picture, the survey, the report
 *   compose_render.c  screen tiles and lists of pixels: packets through all layers, direct light, mirrors
 *   compose_hits.c    the nearest hits of a packet, shaded
 *   compose_finish.c  the lanes of a packet that meet surfaces with a finish
 *   compose_look.c    a hit: the light there, its point and normal, what leaves it
 *   compose_patch.c   a triangle that pixels meet
 *   compose_texels.c  bilinear look-ups in the levels, or in coarser ones where those lack
 *
 * Threads: rendering threads share struct lw_compose; patches and packets belong to one of them.
 *          For these files alone. */
#ifndef LW_CLIENT_VIEW_COMPOSE_COMPOSE_PRIVATE_H
#define LW_CLIENT_VIEW_COMPOSE_COMPOSE_PRIVATE_H

#include "client/camera/place.h"
#include "client/view/compose/compose.h"
#include "client/view/lights/direct_pixels.h"
#include "client/view/lights/direct_tile.h"
#include "client/view/shading/gloss_maps.h"

/* A pixel of light, in the sums of what tiles show: whole numbers, so that no order of threads changes
 * them. */
#define LW_COMPOSE_PIXEL_LIGHT 256

/* One level of one object, with the pointers of this render. */
struct lw_compose_level {
    const float *rgb;       /* NULL: not there, or finer: its tiles are apart */
    const float *direction; /* where it comes from (direction_form.h); NULL: not known */
    uint32_t width, height;
    uint32_t tiles_x, first_tile; /* the tile's id in the scene; not of finer levels */
};

/* level[-k] is the level that is 2^k times finer. */
struct lw_compose_object {
    const struct lw_compose_level *level;
    int level_count, finer_count;
    bool has_fine; /* a tile of a finer level is here */
};

/* Rays that pixels mirror. */
struct lw_compose_mirrored {
    uint16_t lanes;
    struct lw_vec3 origin[LW_TRACE_WIDTH], direction[LW_TRACE_WIDTH];
    struct lw_vec3 tint[LW_TRACE_WIDTH]; /* share of the ray's radiance that the eye sees */
    float width_m[LW_TRACE_WIDTH];       /* width of the lobe where the ray begins */
    float slope[LW_TRACE_WIDTH];         /* growth of the width a metre */
};

/* Sixteen pixels on their way through the layers in front of them. */
struct lw_compose_packet {
    struct lw_ray16 rays;
    struct lw_vec3 radiance[LW_TRACE_WIDTH];
    /* radiance that the eye sees of the layer at hand, over E there */
    struct lw_vec3 reflects[LW_TRACE_WIDTH];
    struct lw_vec3 mirrors[LW_TRACE_WIDTH]; /* the same, over what the gloss mirrors; with a finish */
    float base[LW_TRACE_WIDTH];             /* E there, luminance */
    float transmittance[LW_TRACE_WIDTH];
    struct lw_vec3 tint[LW_TRACE_WIDTH]; /* on top of that */
    const struct lw_camera_plane *plane;
    bool listed; /* its pixels are from anywhere */
    struct lw_compose_mirrored mirrored;
    bool is_mirrored; /* its rays are mirrored by another packet, and mirrored.width_m and slope are theirs */
    /* the layer that reflects most of the tiles' light to the eye: its luminance there, and its tile */
    float reflected[LW_TRACE_WIDTH];
    uint32_t tile[LW_TRACE_WIDTH];
};

/* The pixels of a packet. */
struct lw_compose_pixels {
    uint32_t x[LW_TRACE_WIDTH], y[LW_TRACE_WIDTH];
    uint16_t active; /* the others are not in the picture */
    bool listed;     /* they are no block */
};

/* A thread's memory where direct light is worked out: of one screen tile, or as many pixels of a list. */
struct lw_compose_worker {
    struct lw_direct_tile *tile;
    struct lw_compose_packet second[LW_DIRECT_TILE_BLOCKS]; /* what the packets mirror */
    struct lw_compose_pixels at[LW_DIRECT_TILE_BLOCKS];
    struct lw_compose_packet packet[LW_DIRECT_TILE_BLOCKS];
    uint16_t going[LW_DIRECT_TILE_BLOCKS];
};

struct lw_compose {
    const struct lw_scene *scene;
    const struct lw_atlas_map *map;
    const struct lw_trace *trace;
    int threads;
    bool unfiltered;

    struct lw_compose_level *level; /* of all objects */
    struct lw_compose_object *object;
    uint8_t **coarsest; /* per mesh, per triangle: the level at which it reads its own light alone */
    uint8_t *here;      /* per tile */
    const float **fine; /* per id of a finer level: the tile's texels of this render; NULL: not there */
    const float **fine_direction; /* the same of where its light comes from */
    uint8_t *noise_level;         /* per tile: the finest level at which its noise is bearable */
    uint8_t *needed;              /* per tile; written by all threads, only ever with 1 */
    uint8_t *around;              /* the same, by the last survey */
    uint64_t *shown; /* per tile: its part of the last render's light; LW_COMPOSE_PIXEL_LIGHT a pixel */
    float *survey;   /* its pixels, which nobody sees */

    uint64_t pixel_count; /* in the last render */
    bool surveys;         /* a survey shows nothing */

    struct lw_direct_pixels *direct;  /* NULL: all light is in the tiles */
    const uint8_t *drawn_material;    /* per material: 1: its light is drawn; with direct alone */
    struct lw_place *place;           /* per object; with direct or finishes alone */
    struct lw_compose_worker *worker; /* per thread; with direct alone */
    struct lw_ambient ambient;        /* with finishes alone */

    /* this render's */
    enum lw_show show;
    const struct lw_vec3 *tile_colour;
    const struct lw_pose *pose;
    bool finishes;       /* pixels of finished surfaces are worked out by their finish */
    bool mirrors;        /* and smooth ones mirror the room */
    uint32_t samples;    /* a pixel has that many; 0: one */
    bool has_directions; /* some light has a direction */
    struct lw_vec3 sky;
    struct lw_vec3 stand_in; /* irradiance where nothing at all has arrived */
    float mean;              /* irradiance of all light so far, luminance; 0: there is none */
};

/* The number that atlases have for a level (atlas.h). */
static inline uint32_t lw_compose_level_number(int level) {
    return level < 0 ? LW_ATLAS_FINER + (uint32_t)-level : (uint32_t)level;
}

/* False for NaN, too. */
static inline bool lw_compose_is_light(struct lw_vec3 c) {
    return c.x >= 0 && c.y >= 0 && c.z >= 0 && c.x < INFINITY && c.y < INFINITY && c.z < INFINITY;
}

static inline bool lw_compose_is_finished(const struct lw_material *material) {
    return material->finish && !material->unlit;
}

/* Whether a surface is shaded by its finish. */
static inline bool lw_compose_shades_finish(const struct lw_compose *compose,
                                            const struct lw_material *material) {
    return compose->finishes && (!compose->surveys || compose->mirrors) &&
           (lw_compose_is_finished(material) || lw_show_is_of_finish(compose->show));
}

/* Width of a ray where it meets a surface: that of a pixel, or of a mirror's lobe. */
static inline float lw_compose_packet_width(const struct lw_compose_packet *p, unsigned i, float t) {
    return p->is_mirrored ? p->mirrored.width_m[i] + p->mirrored.slope[i] * t
                          : lw_camera_pixel_at(p->plane, t);
}

static inline struct lw_vec3 lw_compose_grey(float value) { return lw_vec3(value, value, value); }

/* One lane of an array of three axes. */
static inline struct lw_vec3 lw_compose_lane(const float (*from)[LW_TRACE_WIDTH], unsigned i) {
    return lw_vec3(from[0][i], from[1][i], from[2][i]);
}

static inline void lw_compose_fill(float value, float out[16]) {
    for (unsigned i = 0; i < LW_TRACE_WIDTH; i++) out[i] = value;
}

#endif
