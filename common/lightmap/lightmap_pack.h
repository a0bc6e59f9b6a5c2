/* lightmap_pack.h: places every chart in the atlas, near the charts that are near it in space
 * (lightmap_order.h).
 * Flow:    charts -> [pack] -> lightmap UVs
 * Threads: one mesh at a time per thread; nothing is shared. */
#ifndef LW_COMMON_LIGHTMAP_PACK_H
#define LW_COMMON_LIGHTMAP_PACK_H

#include "common/lightmap/lightmap_slot.h"

/** Computes the boxes of all charts. They may then be packed at any scale, any number of times. charts must
 * outlive the layout.
 * Errors: LW_NO_MEMORY. */
LW_MUST_CHECK enum lw_status lw_lightmap_pack_init(struct lw_lightmap_layout *layout,
                                                   const struct lw_lightmap_charts *charts,
                                                   const struct lw_mesh *mesh);
void lw_lightmap_pack_finish(struct lw_lightmap_layout *layout);

/** Packs the charts at `scale` times their own size into the smallest atlas found.
 * width_max, height_max  texels
 * out_fits               false: does not fit; the layout is then undefined
 * Errors: LW_NO_MEMORY. */
LW_MUST_CHECK enum lw_status lw_lightmap_pack(struct lw_lightmap_layout *layout, float scale,
                                              uint32_t width_max, uint32_t height_max, bool *out_fits);

#endif
