/* gl_light.h: received light as the GPU reads it: every level of every atlas in pages of RGB9E5, and for each
 * tile at which level it is read now. Tiles of finer levels are in a pool of their own (gl_fine_tiles.h).
 * Flow:    lw_compose_source -> [gl_light] -> gl_renderer
 * Threads: that of the context.
 *
 * Levels 0, 1 and 2 of an atlas are the mip levels of one place in a page, so that a look-up there needs no
 * table; coarser ones, which stand in for those until they arrive, have places of their own.
 *
 * The level at which a point is read follows the composer's rule (client/view/compose/compose.h). The part of
 * it that depends on the arrived tiles and on their noise is worked out here, a word for each tile: a point
 * asks the tile of the level that its pixel needs, and reads the level that the word names. */
#ifndef LW_CLIENT_GL_LIGHT_H
#define LW_CLIENT_GL_LIGHT_H

#include "client/gl/gl_fine_tiles.h"
#include "client/view/compose/compose.h"

#include <epoxy/gl.h>

/* The word of a tile: the level to read where the finest one that serves is its own, 1 or 2, four bits each,
 * or LW_GL_LIGHT_NONE; and its noise level (tile/atlas.h). Tiles of finer levels have words of
 * gl_fine_tiles.h. */
#define LW_GL_LIGHT_NONE        15u
#define LW_GL_LIGHT_NOISE_SHIFT 12

struct lw_gl_light {
    const struct lw_atlas_map *map;
    bool unfiltered;
    GLuint pages;         /* GL_TEXTURE_2D_ARRAY of GL_RGB9_E5 */
    GLuint directions;    /* the same of GL_RGB10_A2: where light comes from (gl_rgb10.h); 0: not known */
    GLuint levels, tiles; /* GL_TEXTURE_BUFFER: a GL_RGBA32UI for each level, a GL_R16UI for each tile */
    GLuint level_buffer, tile_buffer;
    uint32_t side, layers;   /* the pages' */
    uint32_t *first_level;   /* per object: where its level 0 is in `levels`; finer ones are before it */
    float scale;             /* what a page holds is E times this, a power of two */
    struct lw_vec3 stand_in; /* E where nothing has arrived */
    float mean;              /* luminance of the E that has arrived; 0: nothing */
    uint32_t waiting;        /* tiles that have arrived and are not in the pages yet; and as of `fine` */
    uint64_t uploaded;       /* tiles, so far */
    struct lw_gl_fine_tiles fine;

    struct lw_gl_light_rect *rect; /* per level, as in `levels` */
    uint64_t *version;             /* per tile, but of finer levels: lw_client_tile_changes() in the pages */
    uint8_t *noise_level;          /* per tile, but of finer levels */
    bool *settled;  /* per object: all of it is there and of noise level 0, so that these words say nothing */
    uint16_t *word; /* per tile */
    uint32_t *queue;  /* tiles to upload */
    uint32_t *texels; /* scratch: one tile and its border */
};

/** Makes room for all light of a scene. map must outlive it. Zeroed on failure.
 * unfiltered: as of lw_compose_desc
 * Errors: LW_NO_MEMORY; LW_UNAVAILABLE if the scene is larger than the GPU's limits allow. */
LW_MUST_CHECK enum lw_status lw_gl_light_init(struct lw_gl_light *light, const struct lw_atlas_map *map,
                                              bool unfiltered, struct lw_error *err);
/** A zeroed one is fine. */
void lw_gl_light_finish(struct lw_gl_light *light);

/** Takes over arrived tiles, coarse levels first.
 * tiles_max   to upload at most; the rest waits for the next call. 0: all
 * now_ns      as of lw_gl_fine_tiles_take() */
void lw_gl_light_take(struct lw_gl_light *light, const struct lw_compose_source *source, uint32_t tiles_max,
                      uint64_t now_ns);

/** Place of an object's light, for the shaders: four words, as their v_atlas. */
void lw_gl_light_place(const struct lw_gl_light *light, uint32_t object, uint32_t back_offset,
                       uint32_t out_words[4]);

#endif
