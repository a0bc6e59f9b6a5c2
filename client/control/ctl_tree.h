/* ctl_tree.h: a server and the relays below it, for people: the feeder and the state of each.
 * Flow:    REPORT's figures, twice -> [ctl_tree] -> lines, or JSON
 * Threads: one thread at a time. */
#ifndef LW_CLIENT_CTL_TREE_H
#define LW_CLIENT_CTL_TREE_H

#include "client/control/ctl_figures.h"

#include <stdio.h>

struct lw_ctl_tree {
    char *above; /* address of the server that feeds a relay, or fed it last; NULL for a daemon */
    double frame;
    struct lw_ctl_tree_node {
        char *name;
        uint64_t relay, above; /* numbers of relays; 0 of the server asked */
        double clients;        /* sessions, without ours and one of each relay that it feeds */
        double light_age_s;    /* how long it, or a relay that feeds it, has had no server above */
        double sent_bytes_hz;
        int parent;     /* index of the node that feeds it; -1 of the server asked */
        unsigned depth; /* 0 of the server asked */
        bool is_written;
    } * node; /* the server asked first */
    uint32_t count;
};

/** address: of the server asked. before, now: its figures, some time apart. Errors: LW_PROTOCOL: labels that
 * are none; LW_NO_MEMORY. */
LW_MUST_CHECK enum lw_status lw_ctl_tree_read(struct lw_ctl_tree *tree, const char *address,
                                              const struct lw_ctl_figures *before,
                                              const struct lw_ctl_figures *now, struct lw_error *err);
/** A zeroed one is fine. */
void lw_ctl_tree_finish(struct lw_ctl_tree *tree);

/** A line for each server, below the one that feeds it. Errors: LW_IO. */
LW_MUST_CHECK enum lw_status lw_ctl_tree_write(struct lw_ctl_tree *tree, FILE *stream);

#endif
