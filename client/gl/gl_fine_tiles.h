/* gl_fine_tiles.h: tiles of finer levels on the GPU: a bounded pool of them, which fade in and out.
 * Flow:    lw_compose_source -> [gl_fine_tiles] -> words of gl_light, gl_renderer
 * Threads: that of the context.
 *
 * A slot of the pool holds one tile and a border of one texel at its right and lower sides. A bilinear
 * look-up belongs to the tile that holds its upper left texel, so it reads one slot. The border is the
 * neighbours' where they have arrived, else the tile's own edge; it follows the neighbours.
 *
 * A tile is in the pool while it is there and has noise level 0, as the composer reads it
 * (client/view/compose/compose_look.c). Then it fades out, withdrawn or not: the slot keeps its texels, and
 * its share falls to 0. A tile that comes back before that fades in from its present share. When the pool is
 * full, a new tile takes the slot of one that fades out, at once. It takes the slot of any other tile only if
 * surveys have wanted it more recently. */
#ifndef LW_CLIENT_GL_FINE_TILES_H
#define LW_CLIENT_GL_FINE_TILES_H

#include "client/view/compose/compose.h"

#include <epoxy/gl.h>

#define LW_GL_FINE_TILES_MAX                                                                                 \
    1024u /* slots: 17 MB; a server makes some 700 tiles for all at most, by default */
#define LW_GL_FINE_TILES_SIDE  (LW_TILE_SIDE + 1)
#define LW_GL_FINE_TILES_FADE  250000000u /* ns, from nothing to all of a tile */
#define LW_GL_FINE_TILES_UNITS 20u        /* textures that a fragment shader of finer levels reads, at most */

/* The word of a tile: its slot plus one, and the share of it that is seen. 0: it is not in the pool. */
#define LW_GL_FINE_TILES_SHIFT 11
#define LW_GL_FINE_TILES_WHOLE 31u
_Static_assert(LW_GL_FINE_TILES_MAX < 1u << LW_GL_FINE_TILES_SHIFT, "a slot has a number in a word");
_Static_assert(LW_GL_FINE_TILES_WHOLE << LW_GL_FINE_TILES_SHIFT <= UINT16_MAX, "and so has a share");

struct lw_gl_fine_tiles {
    const struct lw_atlas_map *map;
    GLuint pool;         /* GL_TEXTURE_2D_ARRAY of GL_RGB9_E5, a layer a slot; 0: there is none */
    GLuint directions;   /* the same of GL_RGB10_A2: where light comes from; 0: not known */
    uint32_t slot_count; /* 0: there is none */
    struct lw_gl_fine_slot *slot;
    uint32_t *in_pool; /* per object: its tiles */
    uint32_t *wanted;  /* per id of finer levels: the last survey that wanted it; 0: none */
    uint16_t *word;    /* per id of finer levels, as in the table; 0: it has no slot */
    uint32_t survey;   /* number of the last one */
    uint32_t *texels;  /* scratch: of one slot */
    float scale;       /* the pool holds E times this */
    uint64_t moved_ns; /* when shares were last moved on */
    uint32_t used;     /* slots */
    uint32_t waiting;  /* slots that the last call had no time to fill, or whose tiles fade */
    uint64_t uploaded; /* tiles, so far */
};

/** Input of lw_gl_fine_tiles_take(). */
struct lw_gl_fine_tiles_take {
    const struct lw_compose_source *source;
    bool unfiltered;    /* as of lw_compose_desc */
    float scale;        /* what the pool is to hold is E times this */
    uint64_t now_ns;    /* by any clock. 0: nothing fades */
    uint32_t tiles_max; /* to upload at most */
    GLuint table;       /* the buffer of words: those of finer levels follow the map's plain ones, by name */
};

/** Makes a pool. There is none, and `pool` is 0, where the map has no finer levels or the GPU's limits leave
 * no room; views then read level 0. map must outlive it. Zeroed on failure.
 * slots_max   at most LW_GL_FINE_TILES_MAX
 * Errors: LW_NO_MEMORY, of the GPU too; LW_UNAVAILABLE if OpenGL fails. */
LW_MUST_CHECK enum lw_status lw_gl_fine_tiles_init(struct lw_gl_fine_tiles *fine,
                                                   const struct lw_atlas_map *map, uint32_t slots_max,
                                                   struct lw_error *err);
/** Makes room for where light comes from, if there is a pool. */
void lw_gl_fine_tiles_add_directions(struct lw_gl_fine_tiles *fine);
/** A zeroed one is fine. */
void lw_gl_fine_tiles_finish(struct lw_gl_fine_tiles *fine);

/** Takes over tiles that have arrived, were withdrawn or have lost their id, and moves fades on. Returns
 * whether a word has changed. */
bool lw_gl_fine_tiles_take(struct lw_gl_fine_tiles *fine, const struct lw_gl_fine_tiles_take *take);

/** Begins a survey. The tiles that it finds have priority over those of earlier surveys. */
void lw_gl_fine_tiles_survey(struct lw_gl_fine_tiles *fine);
/** A survey has found a tile, of any level. */
void lw_gl_fine_tiles_want(struct lw_gl_fine_tiles *fine, lw_tile_id tile);

#endif
