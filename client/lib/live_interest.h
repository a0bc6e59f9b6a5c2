/* live_interest.h: which tiles lie in a picture, by the frustum and by boxes around what tiles hold.
 * Flow:    view, where objects are -> [live_interest] -> lw_client_want()
 * Threads: one thread at a time. */
#ifndef LIGHTWELL_LIVE_INTEREST_H
#define LIGHTWELL_LIVE_INTEREST_H

#include "client/include/lightwell/lightwell.h"
#include "client/lib/client.h"
#include "client/lib/live_survey.h"

#define LW_LIVE_INTEREST_NS      100000000u  /* at most this often for a view that changes */
#define LW_LIVE_INTEREST_IDLE_NS 1000000000u /* and for one that does not: objects may move */
#define LW_LIVE_INTEREST_KEEP_NS 2000000000u /* tiles stay in the set after they left the picture */
/* Tiles of finer levels are looked for at most this often: it takes 4 to 12 ms with 300,000 triangles. */
#define LW_LIVE_INTEREST_FINER_NS 250000000u

struct lw_live_mesh_boxes {
    uint32_t first;            /* box of its first tile of level 0 */
    float texel_m;             /* side of a texel of level 0, object space */
    struct lw_live_box around; /* all of it */
};

struct lw_live_interest {
    const struct lw_atlas_map *map;
    struct lw_live_mesh_boxes *mesh; /* per mesh */
    struct lw_live_box *box;         /* what each tile of level 0 holds */
    /* per tile of level 0, by tile id: the level that is read in the picture; UINT8_MAX: not in it */
    uint8_t *level;
    uint32_t *mark;               /* per tile: the round in which it was listed last */
    uint64_t *seen_ns;            /* per tile: when it was in the picture last; 0: never */
    lw_tile_id *list;             /* LW_CLIENT_INTEREST_MAX + 1 */
    uint32_t finer_max;           /* tiles of finer levels in a list; 0: none */
    struct lw_live_survey survey; /* which these are; zeroed: without any */
    lw_tile_id *finer;            /* its last list, of finer_count, finer_max at most */
    uint32_t finer_count;
    uint64_t surveyed_ns; /* when that was made; 0: not yet */
    uint32_t round;

    struct lw_live_view view[LW_LIVE_VIEWS_MAX];
    uint32_t view_count;
    bool is_active, has_changed; /* views set the interest set; they have changed since the last list */
    uint64_t looked_ns;
};

/** Finds what each tile holds. Errors: LW_NO_MEMORY.
 * finer_max  of tiles of finer levels: lists have no more
 * as_it_is   noise is no reason to read coarser */
LW_MUST_CHECK enum lw_status lw_live_interest_init(struct lw_live_interest *interest,
                                                   const struct lw_client *client, uint32_t finer_max,
                                                   bool as_it_is);
/** A zeroed one is fine. */
void lw_live_interest_finish(struct lw_live_interest *interest);

/** Lists what lies in the views, where objects are now.
 * now_ns  growing, > 0
 * Returns how many tiles `list` has; over LW_CLIENT_INTEREST_MAX: too many at any level. */
uint32_t lw_live_interest_list(struct lw_live_interest *interest, const struct lw_client *client,
                               uint64_t now_ns);

/** Sets the client's interest set by the views, if it is time. Errors: LW_NO_MEMORY. */
LW_MUST_CHECK enum lw_status lw_live_interest_update(struct lw_live_interest *interest,
                                                     struct lw_client *client, uint64_t now_ns);

#endif
