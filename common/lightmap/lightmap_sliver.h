/* lightmap_sliver.h: puts charts that are a few texels wide into common rectangles.
 * Flow:    pack: charts -> [slivers] -> rectangles -> atlas
 * Threads: pure functions, [any].
 *
 * A chart of two texels would need a rectangle of 64. So slivers that are near each other in space and face
 * the same way share a rectangle. At level 0, bilinear lookups of two slivers read no common texel. At levels
 * 1 and 2 they mix with neighbouring slivers. */
#ifndef LW_COMMON_LIGHTMAP_SLIVER_H
#define LW_COMMON_LIGHTMAP_SLIVER_H

#include "common/lightmap/lightmap_slot.h"

/** Whether a chart would waste most of a rectangle of its own. */
bool lw_lightmap_sliver_is(const struct lw_lightmap_slot *slot, float scale);

/** Number of slivers, in the order given, that the next rectangle takes. */
uint32_t lw_lightmap_sliver_group(const struct lw_lightmap_slot *slot, const uint32_t *member, uint32_t count,
                                  float scale);

/** Fits slivers into one rectangle: sets x, y, width, height, origin and scale of their slots, relative to
 * the content of the rectangle. slot: all slots; member: numbers of the slivers.
 * Errors: LW_NO_MEMORY. */
LW_MUST_CHECK enum lw_status lw_lightmap_sliver_fit(const struct lw_lightmap_layout *layout,
                                                    struct lw_lightmap_slot *slot, const uint32_t *member,
                                                    uint32_t count, float scale, uint32_t *out_width,
                                                    uint32_t *out_height);

#endif
