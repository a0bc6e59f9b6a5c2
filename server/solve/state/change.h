/* change.h: temporal gradients of a block's packets since the block was last solved (adapt/gradient.h). */
#ifndef LW_STATE_CHANGE_H
#define LW_STATE_CHANGE_H

#include "server/solve/surface/packets.h"

/* Indirect light by order: the first bounce, and all later bounces together. */
enum { LW_CHANGE_FIRST, LW_CHANGE_LATER, LW_CHANGE_ORDERS };

/* The gradients of a packet's texels; E in W/m^2, weighted by lw_solve_block.weight. */
struct lw_change_packet {
    float direct_square; /* sum of squared differences of direct light, in the colour that differs most */
    /* Corrections of direct light since the block was solved (control_variate.h): their mean, the sum of
     * squares that a plane over the block leaves, and the sum of squared standard errors. */
    struct lw_vec3 direct;
    float direct_rough, direct_error;
    struct lw_vec3 indirect[LW_CHANGE_ORDERS][LW_REGIONS]; /* sum of differences */
    float indirect_square[LW_REGIONS]; /* sum of squared lengths of the difference over both orders */
};

static inline struct lw_vec3 lw_change_both_orders(const struct lw_change_packet *packet, uint32_t region) {
    return lw_vec3_add(packet->indirect[LW_CHANGE_FIRST][region], packet->indirect[LW_CHANGE_LATER][region]);
}

/* Drift of a region: the mean difference between a block's estimates and the means that they enter. Running
 * means over some sixteen solves, of the difference and of its square. Noise averages out of `mean`; light
 * that changed without being verified stays in it. */
struct lw_change_drift {
    float mean, square; /* W/m^2 of luminance */
};

/* Parts of light with a history each (LW_TILES_PARTS). */
#define LW_CHANGE_PARTS 2

/* Which packets of a block a frame verifies, before the plan chooses what to solve. */
enum lw_change_verified {
    LW_CHANGE_VERIFIED_NONE,
    LW_CHANGE_VERIFIED_RAYS,  /* all packets, along existing rays */
    LW_CHANGE_VERIFIED_TURN,  /* one packet, in turn */
    LW_CHANGE_VERIFIED_ONSET, /* onset: one packet, one for each of a few surfaces, or direct light of all */
    LW_CHANGE_VERIFIED_ALL    /* onset: all packets, direct light and along existing rays */
};

struct lw_change_block {
    /* One for each packet of the block: last comparison since the block was solved, or 0. */
    struct lw_change_packet *packet;
    /* Sets of packets, one bit each: */
    uint16_t compare;               /* verified in this frame */
    uint16_t retrace;               /* verified in this frame with new rays */
    uint16_t direct;                /* direct light verified in this frame */
    uint16_t verified;              /* verified since the block was solved or a movement began */
    uint16_t uncorrected;           /* verified since the control variate last took gradients over */
    uint16_t judged;                /* their mean invalidated the block */
    uint16_t unchecked;             /* rays not traced again since a movement */
    enum lw_change_verified verify; /* in this frame */
    /* Changed share of its light, about, while the block is invalidated; else 0. */
    float strength;
    bool moving;           /* its last solve followed a movement */
    uint32_t next;         /* next packet in turn */
    uint32_t tick;         /* last round in which its verification was chosen */
    uint32_t moves;        /* lw_motion.moves when it was last verified */
    uint32_t solved_moves; /* and when it was last solved */
    /* Staleness of the means (history.h), weighted: */
    float staleness_direct;                        /* root mean square over texels */
    struct lw_vec3 staleness_indirect[LW_REGIONS]; /* mean over texels of a region */
    float standard_error; /* standard error of the indirect gradients that the staleness took over */
    struct lw_change_drift drift[LW_CHANGE_PARTS][LW_REGIONS];
    uint32_t still_solves; /* solves since the last solve that followed a movement */
};

#endif
