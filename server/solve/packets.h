/* packets.h: which texels of a block trace their rays together.
 * Flow:    texels of a mesh, what is covered -> [packets] -> passes
 * Threads: pure function, [any].
 *
 * The sixteen texels of a packet share each direction, about normals of their own. Their rays are as coherent as these texels
 * are near one another and look the same way, and cost the less the more lanes are filled; but neighbours that share
 * directions share their error, which no filter then removes. So the covered texels of a block, which charts of several
 * surfaces may share, are halved until each group lies on one surface; the packets of a group then take turns with its texels, so that
 * neighbours belong to different ones. On a block that is one flat surface packet k takes every fourth texel in both
 * directions. Groups are cut at multiples of sixteen: a block has as few packets as its texels fill. */
#ifndef LW_SOLVE_PACKETS_H
#define LW_SOLVE_PACKETS_H

#include "common/trace/trace.h"
#include "server/solve/texels.h"

/* Of a block of 16 x 16 texels. */
#define LW_PACKETS_MAX (LW_TILE_BLOCK * LW_TILE_BLOCK / LW_TRACE_WIDTH)

struct lw_packet {
    uint8_t count;                 /* of its lanes, from the first */
    uint8_t place, places;         /* which of its group's packets it is; how many they are */
    uint8_t texel[LW_TRACE_WIDTH]; /* within the block: 16 y + x */
};

/** Deals out the covered texels of one block.
 * first    the block's first texel within the mesh
 * stride   from one of its rows to the next; width, height: of the block, in texels
 * covered  of the block's first texel, rows as above: what takes part
 * Returns how many packets there are, 0 to LW_PACKETS_MAX. */
uint32_t lw_packets_deal(const struct lw_mesh_texels *mesh, uint32_t first, uint32_t stride, uint32_t width,
                         uint32_t height, const uint8_t *covered, struct lw_packet out[LW_PACKETS_MAX]);

/* Indirect light at a lower resolution. At level k one texel's bounce rays serve for some 4^k: those of the same lane in packets that
 * lie beside one another in their group, a run, and at level 3 those of four lanes in a row too. Which one takes turns from frame to frame, so that each
 * texel's mean tends to that over the square in which it lies. */
#define LW_PACKETS_LEVEL_MAX 3u

/** Packets `first` to `end` - 1 of a block, of which one is traced for all. */
struct lw_packet_run {
    uint32_t first, end;
};

/** The run of packet `set` of a block's packets at a level. */
static inline struct lw_packet_run lw_packets_run(const struct lw_packet *packet, uint32_t set,
                                                  uint32_t level) {
    const uint32_t places = packet[set].places, start = set - packet[set].place;
    const uint32_t most = level == 0 ? 1 : level == 1 ? 4 : LW_PACKETS_MAX;
    const uint32_t runs = (places + most - 1) / most, run = packet[set].place * runs / places;
    return (struct lw_packet_run){start + (run * places + runs - 1) / runs,
                                  start + ((run + 1) * places + runs - 1) / runs};
}

/** Of a run with `count` packets, the one that is traced in frame `frame`, counted from its first. */
static inline uint32_t lw_packets_tracer(struct lw_packet_run run, uint32_t frame) {
    return run.first + frame % (run.end - run.first);
}

/** The lane whose rays serve for lane `lane` of `count`. */
static inline uint32_t lw_packets_lane(struct lw_packet_run run, uint32_t level, uint32_t frame,
                                       uint32_t lane, uint32_t count) {
    if (level < 3) return lane < count ? lane : count - 1;
    const uint32_t first = (lane < count ? lane : count - 1) / 4 * 4,
                   lanes = count - first < 4 ? count - first : 4;
    return first + frame / (run.end - run.first) % lanes;
}

#endif
