#include "common/tile/tile_channels.h"

static const struct lw_tile_channels table = {
    .count = LW_LIGHT_FORM_COUNT,
    .channel = {[LW_LIGHT_FORM_FULL] = {.name = "irradiance",
                                        .unit = "W/m^2",
                                        .meaning = "all light that arrives, without albedo",
                                        .planes = 3,
                                        .coding = LW_TILE_CODING_LIGHT,
                                        .step = 1,
                                        .kept = true,
                                        .asked = LW_TILE_CHANNELS_DRAWS,
                                        .asks = 0,
                                        .follows = LW_LIGHT_FORM_FULL},
                /* Clients add light without a coding error: the view's error is that of tiles with all light,
                 * for a quarter of the bytes less than with the same steps (docs/lab/codec.md). */
                [LW_LIGHT_FORM_SPLIT] = {.name = "irradiance-split",
                                         .unit = "W/m^2",
                                         .meaning = "the same without the direct light that clients draw",
                                         .planes = 3,
                                         .coding = LW_TILE_CODING_LIGHT,
                                         .step = 2,
                                         .kept = true,
                                         .asked = LW_TILE_CHANNELS_DRAWS,
                                         .asks = LW_TILE_CHANNELS_DRAWS,
                                         .parted = true,
                                         .follows = LW_LIGHT_FORM_SPLIT}}};

const struct lw_tile_channels *lw_tile_channels(void) { return &table; }
