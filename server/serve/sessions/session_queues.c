#include "server/serve/sessions/session_private.h"

#include "common/base/invariant.h"

void lw_session_queues_dequeue(struct lw_session *s) {
    struct lw_session_queue *queue = s->queue;
    if (!queue) return;
    LW_INVARIANT((queue->first == s) == !s->previous_due && (queue->last == s) == !s->next_due);
    s->queue = NULL;
    *(s->previous_due ? &s->previous_due->next_due : &queue->first) = s->next_due;
    *(s->next_due ? &s->next_due->previous_due : &queue->last) = s->previous_due;
}

void lw_session_queues_enqueue(struct lw_session *s, struct lw_session_queue *queue) {
    lw_session_queues_dequeue(s);
    LW_INVARIANT(s->state != LW_SESSION_CLOSED); /* it may be freed at any time */
    LW_INVARIANT(!queue->first == !queue->last && (!queue->last || queue->last->queue == queue));
    s->queue = queue;
    s->next_due = NULL;
    s->previous_due = queue->last;
    *(queue->last ? &queue->last->next_due : &queue->first) = s;
    queue->last = s;
}

void lw_session_queues_leave_inbox(struct lw_session *s) {
    struct lw_session_inbox *inbox = s->inbox;
    if (!inbox) return;
    LW_INVARIANT((inbox->first == s) == !s->previous_unread && (inbox->last == s) == !s->next_unread);
    s->inbox = NULL;
    *(s->previous_unread ? &s->previous_unread->next_unread : &inbox->first) = s->next_unread;
    *(s->next_unread ? &s->next_unread->previous_unread : &inbox->last) = s->previous_unread;
}

void lw_session_queues_read_on(struct lw_session *s) {
    if (!s->inbox) return;
    lw_session_queues_leave_inbox(s);
    s->link->ops->read(s->link, true);
}

void lw_session_queues_enter_inbox(struct lw_session *s, struct lw_session_inbox *inbox) {
    if (!s->inbox) s->link->ops->read(s->link, false);
    lw_session_queues_leave_inbox(s);
    LW_INVARIANT(s->state != LW_SESSION_CLOSED);
    LW_INVARIANT(!inbox->first == !inbox->last && (!inbox->last || inbox->last->inbox == inbox));
    s->inbox = inbox;
    s->next_unread = NULL;
    s->previous_unread = inbox->last;
    *(inbox->last ? &inbox->last->next_unread : &inbox->first) = s;
    inbox->last = s;
}

void lw_session_queues_set_due(struct lw_session *s, bool asked) {
    struct lw_session_queue *due = s->shared->queues.due;
    if (s->state == LW_SESSION_CLOSED || s->queue == &due[0] || (s->queue == &due[1] && !asked)) return;
    lw_session_queues_enqueue(s, &due[asked ? 0 : 1]);
}
