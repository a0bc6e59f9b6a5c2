/* relay_reports.h: what relays report through NATS: themselves, and the relays below them.
 * Flow:    REPORT of each relay -> [relay_reports] -> lw_nats_publisher's reports()
 * Threads: one thread at a time.
 *
 * A relay that is silent for LW_NATS_WIRE_SILENCE_MS is gone, with those below it. All relays together have
 * LW_RELAY_TREE_MAX places. A report that finds no place is left out. */
#ifndef LW_NATS_RELAY_REPORTS_H
#define LW_NATS_RELAY_REPORTS_H

#include "server/serve/metrics/relay_tree.h"

struct lw_relay_reports {
    struct lw_relay_report {
        uint64_t relay, heard_ns;
        uint32_t count;
        struct lw_relay_tree_node *node; /* itself first */
    } report[LW_RELAY_TREE_MAX];
    uint32_t count;
    struct lw_relay_tree_node read[LW_RELAY_TREE_MAX]; /* the report that is being read */
};

/** Takes a report's lines in place of the relay's last one. Errors: LW_PROTOCOL: they are none; LW_NO_MEMORY.
 * Then the last report holds. */
LW_MUST_CHECK enum lw_status lw_relay_reports_take(struct lw_relay_reports *reports, const uint8_t *data,
                                                   size_t size, uint64_t now_ns);
/** Removes silent relays. Returns whether there were any. */
bool lw_relay_reports_forget_silent(struct lw_relay_reports *reports, uint64_t now_ns);
/** All relays, each once: as the newest report has it. node: room for LW_RELAY_TREE_MAX. Returns how many
 * there are. */
uint32_t lw_relay_reports_list(const struct lw_relay_reports *reports, struct lw_relay_tree_node *node);
/** A zeroed one is fine, and is an empty one. */
void lw_relay_reports_finish(struct lw_relay_reports *reports);

#endif
