/* change.h: what a block's packets have found of changed light since it was
 * last solved (adapt/gradient.h). */
#ifndef LW_STATE_CHANGE_H
#define LW_STATE_CHANGE_H

#include "server/solve/surface/packets.h"

/* Of indirect light: its first bounce, and all later ones. */
enum { LW_CHANGE_FIRST, LW_CHANGE_LATER, LW_CHANGE_ORDERS };

/* What the texels of a packet have found; E in W/m^2. */
struct lw_change_packet {
    /* weighted (lw_solve_block.weight): sum of squared differences of direct light; of the channel that
     * differs most */
    float direct_square;
    /* Of what direct light was corrected by since the block was solved (control_variate.h); weighted: */
    struct lw_vec3 direct; /* mean */
    /* Sums of squares: that no plane explains; of the standard error in all. */
    float direct_rough, direct_error;
    struct lw_vec3 indirect[LW_CHANGE_ORDERS][LW_REGIONS]; /* sum of differences */
    float indirect_square[LW_REGIONS]; /* sum of the squared lengths of both orders' together */
};

static inline struct lw_vec3 lw_change_both_orders(const struct lw_change_packet *packet, uint32_t region) {
    return lw_vec3_add(packet->indirect[LW_CHANGE_FIRST][region], packet->indirect[LW_CHANGE_LATER][region]);
}

/* What a block's estimates are off the mean that they entered, over its texels of a region: running means
 * over some sixteen solves of that and of its square. Noise comes to nothing in the first; what stays is
 * light that has changed unnoticed. */
struct lw_change_drift {
    float mean, square; /* W/m^2 of luminance */
};

/* Of light: the parts that have a memory each (LW_TILES_PARTS). */
#define LW_CHANGE_PARTS 2

/* What a frame verifies of a block before it is chosen what it solves. */
enum lw_change_verified {
    LW_CHANGE_VERIFIED_NONE,
    /* All packets along the rays that there are. */
    LW_CHANGE_VERIFIED_RAYS,
    /* One packet in turn. */
    LW_CHANGE_VERIFIED_TURN,
    /* An onset: one packet, or one for each of a few surfaces; or all about direct light. */
    LW_CHANGE_VERIFIED_ONSET,
    /* An onset: all packets, about direct light and along the rays that there are. */
    LW_CHANGE_VERIFIED_ALL
};

struct lw_change_block {
    /* The last comparison since the block was solved; else 0. */
    struct lw_change_packet packet[LW_PACKETS_MAX];
    uint16_t compare, retrace; /* packets, a bit each: verified now; of these, with new rays */
    uint16_t direct;           /* verified now about direct light */
    uint16_t verified;         /* since the block was solved, or something began to move */
    uint16_t told;             /* since what was found was last taken over */
    /* those whose mean stands for the block, if they have invalidated it. */
    uint16_t judged;
    uint16_t unchecked;             /* whose rays were not traced again since something moved */
    enum lw_change_verified verify; /* in this frame */
    /* How much of its light has changed, about, if that is too much and it was not solved since; else 0. */
    float strength;
    bool moving;           /* something had moved when it was last solved */
    uint32_t next;         /* packet, in turn */
    uint32_t tick;         /* round in which it last served somebody */
    uint32_t moves;        /* of the scene, when it was last verified */
    uint32_t solved_moves; /* and solved */
    /* By how much the means are out of date (history.h); weighted. */
    float staleness_direct;                        /* root mean square over the texels */
    struct lw_vec3 staleness_indirect[LW_REGIONS]; /* mean over the texels of a region */
    float standard_error; /* standard error of what was taken over of indirect light */
    struct lw_change_drift drift[LW_CHANGE_PARTS][LW_REGIONS];
    uint32_t still_solves; /* since something had moved */
};

#endif
