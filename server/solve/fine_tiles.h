/* fine_tiles.h: which tiles of finer levels (atlas.h) are there: those that somebody looks at.
 * Flow:    interest -> [fine_tiles] -> texels and tiles behind those of level 0 -> plan, as any other tile
 * Threads: those of solver.h.
 *
 * A tile of a finer level has texels, sample points, sums and history of its own. It is solved, corrected,
 * filtered and published as a tile of level 0 is, and by itself: rays read level 0, which is always there. A
 * tile of a finer level depends on no other one, and nothing depends on it.
 *
 * Tiles are made at the beginning of a frame, some at a time, those of coarser levels first, once level 0
 * below has some light. Where there is no room left, those go first that nobody has looked at for the
 * longest. Where more are wanted than there is room for, those come first that interest has a low entry for:
 * clients have taken turns there (fine_turns.h). Among equal ones the finest levels are left out: a tile of a
 * coarser level takes the room of a finer one. A tile whose object's texels have
 * changed is made again. All this follows from the interest of each frame alone: the same interest gives the
 * same bytes. Tiles for maps of a bake are made at once, as many as there is room for, and have albedo.
 *
 * All layers of light have the same ones. */
#ifndef LW_SOLVE_FINE_TILES_H
#define LW_SOLVE_FINE_TILES_H

#include "server/solve/light_groups.h"
#include "server/solve/state/solver_terms.h"
#include "server/solve/state/tiles.h"
#include "server/solve/surface/fine_texels.h"

struct lw_fine_tile {
    bool used;
    lw_tile_id id;
    uint64_t made, looked_at; /* frames: in which it was made; the last one in which it was wanted */
    struct lw_fine_texels texels;
    uint8_t *pair; /* the filter's */
};

/** A layer of light. */
struct lw_fine_tiles_layer {
    struct lw_tiles *tiles;
    /* A tile comes, or goes. */
    void (*note)(void *user, lw_tile_id id);
    /* After some have come or gone: lw_tiles_set_pose() is due. */
    void (*place)(void *user);
    void *user;
};

struct lw_fine_tiles {
    struct lw_texels *texels; /* outlive it, with room for the tiles' texels, as does: */
    const struct lw_atlas_map *map;
    struct lw_fine_tiles_layer layer[LW_LIGHT_GROUPS_MAX];
    uint32_t layers;
    struct lw_fine_texels_maker *maker; /* NULL: there is no room */
    struct lw_fine_tile *tile;          /* per slot */
    uint32_t slots, used;
    lw_tile_id *wanted;                   /* by interest, coarser levels first, each by id */
    uint32_t wanted_count, granted_count; /* granted are the first ones, as many as there are slots */
    lw_tile_id *shown;                    /* scratch of lw_fine_tiles_list() */
    struct lw_fine_tile **fresh;          /* scratch of lw_fine_tiles_update() */
    uint64_t frame;                       /* the last update's */
    enum lw_fine_when when;
    bool warned; /* a line has said that there is not room for all that are wanted */
    int threads;
};

/** Errors: LW_NO_MEMORY; finish it then. */
LW_MUST_CHECK enum lw_status lw_fine_tiles_init(struct lw_fine_tiles *fine, struct lw_texels *texels,
                                                const struct lw_atlas_map *map, enum lw_fine_when when,
                                                int threads);
/** Before the first update: a layer's tiles, which outlive the last one. */
void lw_fine_tiles_add_layer(struct lw_fine_tiles *fine, const struct lw_fine_tiles_layer *layer);
/** A zeroed one is fine. */
void lw_fine_tiles_finish(struct lw_fine_tiles *fine);

/** Takes over who looks at what. interest: as for lw_solver_ops.set_interest(). Errors: LW_NO_MEMORY. */
LW_MUST_CHECK enum lw_status lw_fine_tiles_want(struct lw_fine_tiles *fine, const uint8_t *interest);

/** Makes and drops tiles, at the pose and with the rays' structure of the texels: once a frame, further calls
 * of a frame do nothing. Errors: LW_NO_MEMORY. */
LW_MUST_CHECK enum lw_status lw_fine_tiles_update(struct lw_fine_tiles *fine, const struct lw_pose *pose,
                                                  const struct lw_trace *trace, uint64_t frame);

/** Fills the gutters of a layer's tiles that frame `frame` has shown. any: it has shown some tile: tiles of
 * gutters alone are filled again, then. */
void lw_fine_tiles_fill(const struct lw_fine_tiles *fine, struct lw_tiles *tiles, uint64_t frame, bool any,
                        uint32_t channels);

/** Lists the tiles that have light, by id; until the next call. Returns how many. */
uint32_t lw_fine_tiles_list(const struct lw_fine_tiles *fine,
                            bool (*has_light)(const void *user, lw_tile_id id), const void *user,
                            const lw_tile_id **out_tile);

/** The frame in which a tile that is there was made. tiles: of any layer. */
static inline uint64_t lw_fine_tiles_made(const struct lw_fine_tiles *fine, const struct lw_tiles *tiles,
                                          lw_tile_id id) {
    return fine->tile[lw_tiles_at(tiles, id)->fine_slot].made;
}

/** Bytes held, without those of lw_tiles and lw_texels. */
size_t lw_fine_tiles_memory_bytes(const struct lw_fine_tiles *fine);

#endif
