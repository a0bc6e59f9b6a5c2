/* live_survey.h: which tiles of finer levels views want, by a small picture of near surfaces.
 * Flow:    view, where objects are, light of level 0 -> [live_survey] -> live_interest
 * Threads: one thread at a time.
 *
 * Triangles that are near enough for a finer level are drawn with a depth buffer. Each cell of the picture
 * asks for the tiles that the composer's pixel would (common/tile/fine_choice.h). Where these are too many,
 * all cells ask for a coarser level. Tiles of finer levels are some 256 pixels wide, so that few cells are
 * enough.
 *
 * What the picture leaves out: transparent surfaces (BLEND), holes by alpha (MASK), orthographic views. */
#ifndef LIGHTWELL_LIVE_SURVEY_H
#define LIGHTWELL_LIVE_SURVEY_H

#include "client/lib/client.h"
#include "client/lib/live_frustum.h"

#define LW_LIVE_SURVEY_SIDE  160u /* cells of the longer side of the picture */
#define LW_LIVE_SURVEY_GROUP 128u /* triangles that have a box */
/* Different tiles; with more, all cells ask for a coarser level at once. */
#define LW_LIVE_SURVEY_TILES_MAX 8192u
/* Cells under the rectangles of all triangles of a picture; triangles beyond that are left out. */
#define LW_LIVE_SURVEY_WORK_MAX 8000000u

struct lw_live_survey {
    const struct lw_client *client;
    const struct lw_scene *scene;
    const struct lw_atlas_map *map;
    bool as_it_is;         /* noise is no reason to read coarser */
    float noise_shown;     /* WELCOME's noise_shown */
    float *texel_m;        /* per mesh: side of a texel of level 0, object space; 0: it has none */
    uint32_t *first_group; /* per mesh, and one more */
    struct lw_live_box *group;
    struct lw_live_survey_cell *cell;
    struct lw_live_survey_tile *tile, *spare; /* hash tables of twice TILES_MAX, by name */
    uint32_t tile_count;
    uint32_t coarser; /* levels above what they read that all cells ask for */
};

/** texel_m: per mesh. Errors: LW_NO_MEMORY. */
LW_MUST_CHECK enum lw_status lw_live_survey_init(struct lw_live_survey *survey,
                                                 const struct lw_client *client, bool as_it_is,
                                                 const float *texel_m);
/** A zeroed one is fine. */
void lw_live_survey_finish(struct lw_live_survey *survey);

/** Lists tiles, at most `most` of them, which get ids. Fewer where ids run out.
 * Returns how many out_tile has. */
uint32_t lw_live_survey_list(struct lw_live_survey *survey, const struct lw_live_view *view,
                             uint32_t view_count, uint32_t most, lw_tile_id *out_tile);

#endif
