#include "server/serve/sessions/session_private.h"

#include "common/base/invariant.h"

#include <stdlib.h>
#include <string.h>

/* All that sessions have reported: what there is room for. */
static void merge(struct lw_session_shared *shared) {
    struct lw_relay_tree *tree = &shared->tree;
    uv_mutex_lock(&tree->mutex);
    tree->count = 0;
    for (const struct lw_session *s = shared->first; s; s = s->next) {
        const uint32_t room = LW_RELAY_TREE_MAX - tree->count,
                       count = s->below_count < room ? s->below_count : room;
        if (!s->below) continue;
        memcpy(tree->node + tree->count, s->below, count * sizeof *s->below);
        tree->count += count;
    }
    uv_mutex_unlock(&tree->mutex);
}

/* A relay has a session for each channel of irradiance, and reports in one. The last report counts. */
static void leave_others(const struct lw_session *reporter) {
    for (struct lw_session *s = reporter->shared->first, *next; s; s = next) {
        next = s->next;
        if (s != reporter && s->relay == reporter->relay) lw_session_relays_leave(s);
    }
}

enum lw_status lw_session_relays_report(struct lw_session *s, const struct lw_message_report *report,
                                        struct lw_error *err) {
    struct lw_session_shared *shared = s->shared;
    uint32_t count;
    if (!s->below && shared->reporting_count == LW_RELAY_TREE_SESSIONS_MAX) leave_others(s);
    if (!s->below && shared->reporting_count == LW_RELAY_TREE_SESSIONS_MAX) return LW_OK;
    struct lw_relay_tree_node *below = malloc(LW_RELAY_TREE_MAX * sizeof *below), *fitting;
    if (!below) return LW_OK; /* the next one, perhaps */
    enum lw_status status =
        lw_relay_tree_read(report->data, report->size, below, LW_RELAY_TREE_MAX, &count, err);
    if (status == LW_OK && (!count || below->relay != s->relay))
        status = lw_status_fail(err, LW_PROTOCOL, "message REPORT: its first line is not of its sender");
    if (status != LW_OK) {
        free(below);
        return status == LW_NO_MEMORY ? LW_OK : status;
    }
    leave_others(s);
    below->above = shared->is_relay ? shared->relays[0] : 0;
    if ((fitting = realloc(below, count * sizeof *below))) below = fitting;
    if (!s->below) shared->reporting_count++;
    free(s->below);
    s->below = below;
    s->below_count = count;
    merge(shared);
    return LW_OK;
}

void lw_session_relays_leave(struct lw_session *s) {
    if (!s->below) return;
    LW_INVARIANT(s->shared->reporting_count > 0);
    s->shared->reporting_count--;
    free(s->below);
    s->below = NULL;
    s->below_count = 0;
    merge(s->shared);
}
