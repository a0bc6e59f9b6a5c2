/* fine_ids.h: ids for the tiles of finer levels (atlas.h) that are in use.
 * Flow:    names of tiles that somebody lists or sees -> [fine_ids] -> ids, for arrays per tile
 * Threads: [any], to find and claim, many at a time. No other call runs beside a release, except that the
 * holder of an id may ask about this id.
 *
 * A scene has far more tiles of finer levels than are in use. An array per tile has room for the ids,
 * of which there are few; the names, which are many, are keys of a hash table. */
#ifndef LW_COMMON_FINE_IDS_H
#define LW_COMMON_FINE_IDS_H

#include "common/base/status.h"

#include <stdbool.h>
#include <stdint.h>

#define LW_FINE_IDS_NONE UINT32_MAX

/** Place of a tile. */
struct lw_tile_place {
    uint32_t object, level, x, y; /* x, y: tile column and row within the level */
    uint32_t width, height;       /* texels */
};

struct lw_fine_ids;

#ifdef __cplusplus
extern "C" {
#endif

/** room: how many ids there are, from 0 on. place: where each one's tile lies; written by claims, outlives
 * it. Errors: LW_NO_MEMORY. */
LW_MUST_CHECK enum lw_status lw_fine_ids_create(uint32_t room, struct lw_tile_place *place,
                                                struct lw_fine_ids **out_ids);
/** NULL is fine. */
void lw_fine_ids_destroy(struct lw_fine_ids *ids);

/** Id of a name; NONE if it has no id. */
uint32_t lw_fine_ids_find(const struct lw_fine_ids *ids, uint64_t name);
/** The id of a name; without one it gets the free id that was released first. NONE: no id is free. */
uint32_t lw_fine_ids_claim(struct lw_fine_ids *ids, uint64_t name, const struct lw_tile_place *place);
/** Frees an id that is claimed. */
void lw_fine_ids_release(struct lw_fine_ids *ids, uint32_t id);

/** Whether an id is claimed. */
bool lw_fine_ids_is_claimed(const struct lw_fine_ids *ids, uint32_t id);
uint32_t lw_fine_ids_free_count(const struct lw_fine_ids *ids);

#ifdef __cplusplus
}
#endif

#endif
