/* relay_tree.h: the relays below a server, by their own reports, each with its feeder.
 * Flow:    REPORT of each relay's session -> [relay_tree] -> /metrics, STATS; REPORT to the server above
 *          REPORT through NATS -> server/nats/relay_reports -> [relay_tree]
 * Threads: lw_relay_tree_get() and lw_relay_tree_set_outside() [any], all else [loop]. */
#ifndef LW_SERVE_METRICS_RELAY_TREE_H
#define LW_SERVE_METRICS_RELAY_TREE_H

#include "proto/message.h"
#include "server/serve/metrics/server_page.h"

#include <uv.h>

#define LW_RELAY_TREE_MAX          256u /* relays of a server; in a report one less has room for the sender */
#define LW_RELAY_TREE_SESSIONS_MAX 64u  /* sessions whose relays are listed */
#define LW_RELAY_TREE_TEXT_MAX     (LW_RELAY_TREE_MAX * 160u) /* bytes of a report */

struct lw_relay_tree_node {
    uint64_t relay, above; /* numbers of relays; above: the one that feeds it, 0: a daemon */
    uint64_t sessions, light_age_ms, sent_bytes_hz;
    char name[LW_MESSAGE_NAME_MAX + 1]; /* where it serves */
};

struct lw_session;

/** Sum of the reports of all relays. */
struct lw_relay_tree {
    uv_mutex_t mutex;                          /* guards the fields below; held for a copy only */
    struct lw_relay_tree_node *node, *outside; /* relays with a session; other relays */
    uint32_t count, outside_count;
};

/** Errors: LW_NO_MEMORY. */
LW_MUST_CHECK enum lw_status lw_relay_tree_init(struct lw_relay_tree *tree);
/** A zeroed one is fine. */
void lw_relay_tree_finish(struct lw_relay_tree *tree);

/** A name for reports: at most LW_MESSAGE_NAME_MAX characters. Characters that no address has become
 * underscores. */
void lw_relay_tree_name(char dst[LW_MESSAGE_NAME_MAX + 1], const char *text);

/** Reads the lines of a report (proto/wire_format.md, REPORT). capacity: LW_RELAY_TREE_MAX suffices.
 * Errors: LW_PROTOCOL. */
LW_MUST_CHECK enum lw_status lw_relay_tree_read(const uint8_t *data, size_t size,
                                                struct lw_relay_tree_node *out_node, uint32_t capacity,
                                                uint32_t *out_count, struct lw_error *err);
/** Writes them. Returns its bytes; dst_size: LW_RELAY_TREE_TEXT_MAX suffices. */
size_t lw_relay_tree_write(const struct lw_relay_tree_node *node, uint32_t count, char *dst, size_t dst_size);

/** Appends relays that are not in `node` yet, up to its capacity. Returns how many there are then. */
uint32_t lw_relay_tree_join(struct lw_relay_tree_node *node, uint32_t count, uint32_t capacity,
                            const struct lw_relay_tree_node *more, uint32_t more_count);

/** Replaces the relays below that have no session here: they take light from NATS. Copied; count: at most
 * LW_RELAY_TREE_MAX. [any] */
void lw_relay_tree_set_outside(struct lw_relay_tree *tree, const struct lw_relay_tree_node *node,
                               uint32_t count);
/** A copy of what there is, each relay once. capacity: LW_RELAY_TREE_MAX suffices. [any] */
uint32_t lw_relay_tree_get(struct lw_relay_tree *tree, struct lw_relay_tree_node *out_node,
                           uint32_t capacity);
/** Adds a line for each relay to a page of metrics. Without memory the page stays as it is. */
void lw_relay_tree_add_metrics(struct lw_relay_tree *tree, struct lw_server_page *page);

#endif
