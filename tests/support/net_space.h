/* net_space.h: a network namespace of the test's own, and cables to it that the test pulls out. Names and
 * addresses are those of the process, so that tests may run beside each other. */
#ifndef LW_TESTS_NET_SPACE_H
#define LW_TESTS_NET_SPACE_H

#include <stdbool.h>

#define LW_NET_SPACE_CABLES 2

struct lw_net_space {
    char name[32]; /* for ip netns exec, and under /run/netns */
    unsigned cable_count;
    struct lw_net_space_cable {
        char near_end[16], far_end[16]; /* interfaces: here, and there */
        char here[24], there[24];       /* addresses */
    } cable[LW_NET_SPACE_CABLES];
};

/** Makes it, with cables that are up. False: the system allows none; a line on stdout says that the test is
 * skipped. */
bool lw_net_space_make(struct lw_net_space *space, unsigned cable_count);
/** Pulls a cable out, or plugs it in. No packet says so to either end. */
void lw_net_space_plug(const struct lw_net_space *space, unsigned cable, bool in);
/** A zeroed one is fine. */
void lw_net_space_remove(struct lw_net_space *space);

#endif
