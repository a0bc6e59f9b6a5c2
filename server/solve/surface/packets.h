/* packets.h: which texels of a block trace their rays together.
 * Flow:    texels of a mesh, covered -> [packets] -> passes
 * Threads: pure function, [any].
 *
 * The sixteen texels of a packet share each direction, about normals of their own. Their rays are the more
 * coherent the nearer the texels are and the more alike their normals, and cost the less the more lanes are
 * filled. But neighbours that share directions share their error, which no filter removes.
 *
 * So the covered texels of a block, on which charts of several surfaces may lie, are halved until each group
 * lies on one surface. The packets of a group take turns with its texels, so that neighbours belong to
 * different ones. On a block of one flat surface packet k takes every fourth texel in both directions.
 * Groups are cut at multiples of sixteen: a block has as few packets as its texels fill. */
#ifndef LW_SURFACE_PACKETS_H
#define LW_SURFACE_PACKETS_H

#include "common/trace/trace.h"
#include "server/solve/surface/regions.h"

/* Packets in a block of 16 x 16 texels. */
#define LW_PACKETS_MAX (LW_TILE_BLOCK * LW_TILE_BLOCK / LW_TRACE_WIDTH)

struct lw_packet {
    uint8_t count;                 /* lanes in use, from the first */
    uint8_t group;                 /* packets of its group, which follow each other */
    uint8_t texel[LW_TRACE_WIDTH]; /* within the block: 16 y + x */
    uint8_t lanes[LW_REGIONS];     /* its lanes in each region (regions.h) */
};

/** Where the texel of a lane lies, from the block's first texel, `corner`, on; stride: from one row to the
 * next. */
static inline uint32_t lw_packet_texel(const struct lw_packet *packet, uint32_t lane, uint32_t corner,
                                       uint32_t stride) {
    const uint32_t texel = packet->texel[lane];
    return corner + texel / LW_TILE_BLOCK * stride + texel % LW_TILE_BLOCK;
}

/** Deals out the covered texels of one block.
 * first    the block's first texel within the mesh
 * stride   from one of its rows to the next; width, height: of the block, in texels
 * covered  of the block's first texel, rows as above: what takes part
 * region   likewise
 * Returns how many packets there are, 0 to LW_PACKETS_MAX. */
uint32_t lw_packets_deal(const struct lw_mesh_texels *mesh, uint32_t first, uint32_t stride, uint32_t width,
                         uint32_t height, const uint8_t *covered, const uint8_t *region,
                         struct lw_packet out[LW_PACKETS_MAX]);

#endif
