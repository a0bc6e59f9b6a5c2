/* direct_weak.h: blocks as one point, and lights that are weak there.
 * Flow:    blocks -> [direct_weak] summary, outlook of a light -> which blocks it is weak for -> their E
 * Threads: any worker. */
#ifndef LW_CLIENT_VIEW_LIGHTS_DIRECT_WEAK_H
#define LW_CLIENT_VIEW_LIGHTS_DIRECT_WEAK_H

#include "client/view/lights/direct_private.h"

/** Mean point, normal and light of a block. */
void lw_direct_weak_summarise(const struct lw_direct_block *restrict block, uint32_t b,
                              struct lw_direct_summary *restrict out);

/** Fills the bounds and estimates of a light at each block. Returns the sum of the estimates. */
float lw_direct_weak_expect(const struct lw_direct_pixels *direct, const struct lw_direct_summary *summary,
                            uint32_t candidate, float luminance, struct lw_direct_outlook *out);

/* Blocks that take a light as weak, and as full. A light is weak where it is far and a small part of the
 * block's light. Then the middle of the block has E of all its pixels, but for their normals. */
struct lw_direct_parts {
    float weak[LW_DIRECT_BLOCKS]; /* the most that it may add, over all; 0: not weak */
    uint32_t full[LW_DIRECT_BLOCKS];
};

/** Returns bit 0: some blocks are weak, bit 1: some are full. outlook: NULL where the light has none */
uint32_t lw_direct_weak_part(const struct lw_direct_job *job, const struct lw_direct_outlook *outlook,
                             struct lw_direct_parts *out);

/** Adds a light to its weak blocks. colour: of unit luminance */
void lw_direct_weak_add(struct lw_direct_job *job, const struct lw_direct_outlook *outlook,
                        const struct lw_direct_parts *parts, struct lw_vec3 colour);

#endif
