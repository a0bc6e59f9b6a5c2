/* levels.h: the mip pyramid of one channel of one object's atlas: filtered by coverage, gutters filled by
 * extrapolation.
 * Threads: one lw_levels belongs to one worker at a time.
 *
 * A texel of level k + 1 is the mean of those of its four texels of level k that hold light, gutter texels
 * too. So a texel on a chart's rim has the light at its own middle. Bilinear lookups on the rim read past it,
 * so the chart must be continued there. On level 0 the solver fills two texels around each chart. On levels 1
 * and 2, empty texels next to covered ones get the mean of their covered neighbours. These belong to the same
 * chart, except near slivers, since charts lie in blocks of 4 x 4 texels with a gutter
 * (common/lightmap/lightmap.h). Coarser levels are placeholders; all their texels are filled.
 *
 * On levels 1 and 2, only texels that depend on newly loaded tiles are built. Coarser levels, a 48th of all
 * texels, are built as a whole. */
#ifndef LW_PUBLISH_LEVELS_H
#define LW_PUBLISH_LEVELS_H

#include "common/tile/atlas.h"
#include "server/solve/solver.h"

struct lw_levels {
    uint32_t channel, planes; /* (tile_channels.h) */
    uint32_t count;
    uint32_t columns, rows; /* tiles of level 0 */
    uint8_t *part;          /* per tile of level 0: its state in the next or the last build */
    struct lw_levels_image {
        uint32_t width, height;
        float *value;     /* `planes` floats per texel */
        uint8_t *covered; /* 0: nothing; 1: has surface; 2 and more: filled, in that round */
    } level[LW_ATLAS_LEVELS_MAX];
};

/** Errors: LW_NO_MEMORY. */
LW_MUST_CHECK enum lw_status lw_levels_init(struct lw_levels *levels, uint32_t channel,
                                            const struct lw_atlas *atlas);
void lw_levels_finish(struct lw_levels *levels);

/** Copies the shown light of one level-0 tile into level 0. Load all of them before the first build. */
void lw_levels_load_tile(struct lw_levels *levels, const struct lw_tile_place *place,
                         const struct lw_solver_tile *tile);
/** Call after the changed tiles are loaded: fills gutters and builds the coarser texels that depend on
 * them. */
void lw_levels_build(struct lw_levels *levels);
/** Whether the last build may have changed a tile, of any level. */
bool lw_levels_has_changed(const struct lw_levels *levels, const struct lw_tile_place *place);
/** Copies one tile's texels: width * height * planes floats, and width * height bytes. A byte is 0 where no
 * look-up reads the texel. */
void lw_levels_store_tile(const struct lw_levels *levels, const struct lw_tile_place *place, float *out_value,
                          uint8_t *out_covered);

#endif
