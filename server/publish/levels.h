/* levels.h: the mip pyramid of one object's atlas: filtered by coverage, gutters filled by extrapolation.
 * Threads: one lw_levels belongs to one worker at a time.
 *
 * A texel of level k + 1 is the mean of those among its four of level k that hold light, gutters too: on a
 * chart's rim that makes it the light at its middle, not that of the part of it which has surface. Bilinear
 * lookups on the rim must read a continuation of the chart. On level 0 the solver has filled two texels
 * around it, chart by chart. On levels 1 and 2 what is left next to covered texels is filled with the mean of
 * their covered neighbours: charts lie in blocks of 4 x 4 texels with a gutter (common/lightmap/lightmap.h),
 * so all of this is of the same chart, but for slivers. Coarser levels are placeholders and are filled
 * completely.
 *
 * Down to level 2 only what hangs on the tiles loaded since the last time is built; what is coarser, a 48th
 * of all texels, as a whole. */
#ifndef LW_PUBLISH_LEVELS_H
#define LW_PUBLISH_LEVELS_H

#include "common/tile/atlas.h"
#include "server/solve/solver.h"

struct lw_levels {
    uint32_t count;
    uint32_t columns, rows; /* tiles of level 0 */
    uint8_t *part;          /* per tile of level 0: what it does in the build that comes or was the last */
    struct lw_levels_image {
        uint32_t width, height;
        float *rgb;       /* 3 floats per texel, W/m^2 */
        uint8_t *covered; /* 0: nothing; 1: has surface; 2 and more: filled, in that round */
    } level[LW_ATLAS_LEVELS_MAX];
};

/** Errors: LW_NO_MEMORY. */
LW_MUST_CHECK enum lw_status lw_levels_init(struct lw_levels *levels, const struct lw_atlas *atlas);
void lw_levels_finish(struct lw_levels *levels);

/** Takes the light of one level-0 tile into level 0. The first build wants all of them. */
void lw_levels_load_tile(struct lw_levels *levels, const struct lw_tile_place *place,
                         const struct lw_solver_tile *tile);
/** After the tiles that have changed: fills gutters and builds what of the coarser levels hangs on them. */
void lw_levels_build(struct lw_levels *levels);
/** Whether the last build may have changed a tile, of any level. */
bool lw_levels_has_changed(const struct lw_levels *levels, const struct lw_tile_place *place);
/** Copies one tile's texels: width * height * 3 floats, and width * height bytes. A byte is 0 where no
 * look-up reads the texel. */
void lw_levels_store_tile(const struct lw_levels *levels, const struct lw_tile_place *place, float *out_rgb,
                          uint8_t *out_covered);

/* Ranges of E: by the first bits of a float, four to a doubling. */
#define LW_LEVELS_BINS 1024u

/** Adds a value, `weight` times, to how many lie in each range. */
void lw_levels_count_value(uint64_t bin[LW_LEVELS_BINS], float value, uint64_t weight);
/** Adds the values of a coarse level's texels with surface. */
void lw_levels_count_values(const struct lw_levels *levels, uint64_t bin[LW_LEVELS_BINS]);
/** Where the range begins under which this share of what was counted lies; 0: nothing was. */
float lw_levels_quantile(const uint64_t bin[LW_LEVELS_BINS], double share);

#endif
