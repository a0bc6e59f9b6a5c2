#include "server/serve/sessions/turns.h"

#include "common/base/clock.h"
#include "common/base/invariant.h"
#include "server/serve/sessions/session_handlers.h"
#include "server/serve/sessions/session_private.h"

static void pump(struct lw_session *s) {
    LW_INVARIANT(!s->queue && s->state != LW_SESSION_CLOSED);
    if (s->rate_limit_bytes_hz) lw_send_queue_renew_allowance(s, lw_clock_ns());
    if (s->has_waiting && s->interest_epoch != s->shared->epoch && !lw_session_interest_take_up(s))
        s->lacks_memory = true;
    s->waits = false;
    const bool has_all = !s->lacks_memory && lw_send_queue_write(s);
    if (s->lacks_memory) {
        lw_session_close_lacking(s);
        return;
    }
    if (has_all && s->is_paced)
        lw_session_queues_enqueue(s, &s->shared->queues.paced);
    else if (has_all && s->waits)
        lw_session_queues_enqueue(s, &s->shared->queues.waiting);
    else if (!has_all && !s->is_writing)
        lw_session_queues_set_due(s, false); /* more than one turn's */
    if (has_all && s->state == LW_SESSION_LEAVING && !s->ended) {
        s->ended = true; /* the peer's own close, or the time limit, ends the session */
        if (s->link->ops->end(s->link, s->refusal, s->refusal_text) < 0) lw_session_close(s, "link is gone");
    }
}

static void end_waiting(struct lw_session_shared *shared, uint64_t now_ns) {
    for (struct lw_session *s = shared->queues.slowed.first, *next; s; s = next) {
        next = s->next_unread;
        if (!lw_message_rates_wait(&s->rates, now_ns))
            lw_session_queues_enter_inbox(s, &shared->queues.unread);
    }
}

void lw_turns_begin_snapshot(struct lw_session_shared *shared) {
    for (struct lw_session *s = shared->first; s; s = lw_session_next(s)) lw_session_queues_set_due(s, false);
}

void lw_turns_serve_paced(struct lw_session_shared *shared) {
    for (struct lw_session *s; (s = shared->queues.paced.first);) {
        lw_session_queues_set_due(s, false);
        LW_INVARIANT(s->queue == &shared->queues.due[1]); /* it is not found again */
    }
    end_waiting(shared, lw_clock_ns());
}

void lw_turns_collect(struct lw_session_shared *shared) {
    bool any = false;
    for (unsigned c = 0; c < LW_TILE_CHANNELS_MAX; c++)
        any |= lw_deltas_collect(&shared->channels.at[c].deltas);
    if (!any) return;
    for (struct lw_session *s; (s = shared->queues.waiting.first);) {
        lw_session_queues_set_due(s, false);
        LW_INVARIANT(s->queue == &shared->queues.due[1]);
    }
}

bool lw_turns_any_due(const struct lw_session_shared *shared) {
    return shared->queues.due[0].first || shared->queues.due[1].first || shared->queues.unread.first;
}

void lw_turns_serve_due(struct lw_session_shared *shared, uint64_t deadline_ns) {
    while ((shared->queues.due[0].first || shared->queues.due[1].first) && lw_clock_ns() < deadline_ns)
        for (int q = 0; q < 2; q++) {
            struct lw_session *s = shared->queues.due[q].first;
            if (!s) continue;
            lw_session_queues_dequeue(s);
            pump(s);
        }
}

void lw_turns_read_on(struct lw_session_shared *shared) {
    const struct lw_session *last = shared->queues.unread.last; /* each once */
    for (struct lw_session *s = shared->queues.unread.first, *next; s; s = next) {
        next = s == last ? NULL : s->next_unread;
        lw_session_handlers_take(s);
    }
}
