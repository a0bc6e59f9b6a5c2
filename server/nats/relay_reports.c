#include "server/nats/relay_reports.h"

#include "common/base/invariant.h"
#include "proto/nats_wire.h"

#include <stdlib.h>
#include <string.h>

#define SILENCE_NS (LW_NATS_WIRE_SILENCE_MS * 1000000ull)

static struct lw_relay_report *find(struct lw_relay_reports *reports, uint64_t relay) {
    for (struct lw_relay_report *r = reports->report; r < reports->report + reports->count; r++)
        if (r->relay == relay) return r;
    return NULL;
}

static void remove_report(struct lw_relay_reports *reports, struct lw_relay_report *report) {
    free(report->node);
    *report = reports->report[--reports->count];
}

/* Places that other relays leave. */
static uint32_t room_beside(const struct lw_relay_reports *reports, const struct lw_relay_report *own) {
    uint32_t room = LW_RELAY_TREE_MAX;
    for (const struct lw_relay_report *r = reports->report; r < reports->report + reports->count; r++)
        if (r != own) room -= r->count;
    LW_INVARIANT(room <= LW_RELAY_TREE_MAX);
    return room;
}

enum lw_status lw_relay_reports_take(struct lw_relay_reports *reports, const uint8_t *data, size_t size,
                                     uint64_t now_ns) {
    uint32_t count;
    const enum lw_status status =
        lw_relay_tree_read(data, size, reports->read, LW_RELAY_TREE_MAX, &count, NULL);
    if (status != LW_OK || !count) return status == LW_OK ? LW_PROTOCOL : status;
    struct lw_relay_report *own = find(reports, reports->read[0].relay);
    const uint32_t room = room_beside(reports, own);
    if (!room) return LW_OK;
    if (count > room) count = room;
    struct lw_relay_tree_node *node = malloc(count * sizeof *node);
    if (!node) return LW_NO_MEMORY;
    memcpy(node, reports->read, count * sizeof *node);
    node[0].above = 0; /* the daemon feeds it */
    if (own) remove_report(reports, own);
    LW_INVARIANT(reports->count < LW_RELAY_TREE_MAX);
    reports->report[reports->count++] = (struct lw_relay_report){node[0].relay, now_ns, count, node};
    return LW_OK;
}

bool lw_relay_reports_forget_silent(struct lw_relay_reports *reports, uint64_t now_ns) {
    bool any = false;
    for (uint32_t i = 0; i < reports->count;) {
        const bool is_silent = now_ns - reports->report[i].heard_ns >= SILENCE_NS;
        if (is_silent)
            remove_report(reports, &reports->report[i]);
        else
            i++;
        any |= is_silent;
    }
    return any;
}

static int compare_age(const void *left, const void *right) {
    const struct lw_relay_report *const *a = left, *const *b = right;
    if ((*a)->heard_ns != (*b)->heard_ns) return (*a)->heard_ns < (*b)->heard_ns ? 1 : -1;
    return ((*a)->relay > (*b)->relay) - ((*a)->relay < (*b)->relay);
}

uint32_t lw_relay_reports_list(const struct lw_relay_reports *reports, struct lw_relay_tree_node *node) {
    const struct lw_relay_report *newest[LW_RELAY_TREE_MAX];
    uint32_t count = 0;
    for (uint32_t i = 0; i < reports->count; i++) newest[i] = &reports->report[i];
    qsort(newest, reports->count, sizeof *newest, compare_age);
    for (uint32_t i = 0; i < reports->count; i++)
        count = lw_relay_tree_join(node, count, LW_RELAY_TREE_MAX, newest[i]->node, newest[i]->count);
    return count;
}

void lw_relay_reports_finish(struct lw_relay_reports *reports) {
    while (reports->count) remove_report(reports, reports->report);
}
