#include "server/serve/sessions/session.h"

#include "common/base/clock.h"
#include "common/base/invariant.h"
#include "common/base/log.h"
#include "server/serve/sessions/session_private.h"

#include <inttypes.h>
#include <stdarg.h>
#include <stdio.h>
#include <stdlib.h>

#define LINGER_NS (LW_SERVER_LINGER_S * 1000000000ull)

bool lw_session_is_relay(const struct lw_session *session) { return session->relay; }
bool lw_session_reads_runs(const struct lw_session *session) { return session->reads_runs; }

struct lw_session *lw_session_next(const struct lw_session *session) {
    return session->next;
}

void lw_session_count(struct lw_session_shared *shared, uint64_t *counter, int64_t change) {
    uv_mutex_lock(&shared->stats_mutex);
    LW_INVARIANT(change >= 0 || *counter >= (uint64_t)-change);
    *counter += (uint64_t)change;
    uv_mutex_unlock(&shared->stats_mutex);
}

/* A line about a peer, unless there were many. */
void lw_session_tell(const struct lw_session *s, const char *format, ...) {
    char text[LW_MESSAGE_TEXT_MAX + 100];
    if (!lw_peer_log_allows(&s->shared->log, &s->peer.at, s->peer.address, lw_clock_ns())) return;
    va_list args;
    va_start(args, format);
    vsnprintf(text, sizeof text, format, args);
    va_end(args);
    lw_log(LW_LOG_INFO, "session %" PRIu64 ": %s%s%s %s", s->number, s->peer.address, *s->name ? " " : "",
           s->name, text);
}

static void link_session(struct lw_session *s) {
    struct lw_session_shared *shared = s->shared;
    s->next = shared->first;
    if (s->next) s->next->previous = s;
    shared->first = s;
}

static uint32_t address_share(const struct lw_session_shared *shared, const struct lw_address *at) {
    return shared->limits.address_sessions_max ? shared->limits.address_sessions_max
                                               : lw_address_places_share(at, shared->limits.sessions_max);
}

uint32_t lw_session_kept_places(const struct lw_session_shared *shared) {
    return shared->tokens ? shared->limits.sessions_max / LW_SERVER_KEPT_ONE_IN : 0;
}

bool lw_session_is_crowded(const struct lw_session_shared *shared) {
    LW_INVARIANT(shared->control_count <= shared->place_count);
    return shared->place_count - shared->control_count >
           shared->limits.sessions_max - lw_session_kept_places(shared);
}

/* A place lasts until the link is closed: a refused peer that lingers has one still. Without one there is
 * room to say so for a few. false: there is not even that. */
static bool take_place(struct lw_session *s) {
    struct lw_session_shared *shared = s->shared;
    const struct lw_address *at = &s->peer.at;
    enum lw_status status = LW_UNAVAILABLE;
    if (s->peer.is_local) return true;
    if (!s->peer.is_too_many && shared->place_count < shared->limits.sessions_max)
        status = lw_address_places_take(&shared->places, at, address_share(shared, at));
    if (status == LW_OK) {
        s->has_place = true;
        shared->place_count++;
    } else if (status == LW_UNAVAILABLE && shared->turned_away_count < LW_SERVER_TURNED_AWAY_MAX &&
               lw_address_places_take(&shared->turned_away, at, LW_SERVER_ADDRESS_TURNED_AWAY_MAX) == LW_OK) {
        s->is_turned_away = true;
        shared->turned_away_count++;
    }
    LW_INVARIANT(!(s->has_place && s->is_turned_away));
    LW_INVARIANT(shared->place_count <= shared->limits.sessions_max &&
                 shared->turned_away_count <= LW_SERVER_TURNED_AWAY_MAX);
    return s->has_place || s->is_turned_away;
}

static void give_place_back(struct lw_session *s) {
    struct lw_session_shared *shared = s->shared;
    if (s->has_place) lw_address_places_give(&shared->places, &s->peer.at);
    if (s->is_turned_away) lw_address_places_give(&shared->turned_away, &s->peer.at);
    LW_INVARIANT(shared->place_count >= s->has_place && shared->turned_away_count >= s->is_turned_away);
    LW_INVARIANT(shared->control_count >= s->keeps_control_place);
    shared->place_count -= s->has_place;
    shared->turned_away_count -= s->is_turned_away;
    shared->control_count -= s->keeps_control_place;
    s->has_place = s->is_turned_away = s->keeps_control_place = false;
}

/* As many as there are places for it. */
static uint32_t connections_at_once(const struct lw_session_shared *shared, const struct lw_address *at) {
    const uint32_t places = address_share(shared, at);
    return places > LW_SERVER_CONNECTIONS_MIN ? places : LW_SERVER_CONNECTIONS_MIN;
}

bool lw_session_may_connect(struct lw_session_shared *shared, const struct lw_address *at) {
    const double burst = connections_at_once(shared, at);
    return lw_address_rates_allow(&shared->connecting, at, burst / LW_SERVER_CONNECTIONS_REFILL_S, burst,
                                  lw_clock_ns());
}

struct lw_session *lw_session_open(struct lw_session_shared *shared, struct lw_session_transport *link,
                                   const struct lw_session_peer *peer) {
    struct lw_session *s = calloc(1, sizeof *s);
    if (!s) return NULL;
    s->link = link;
    s->shared = shared;
    s->peer = *peer;
    if (!take_place(s)) {
        free(s);
        return NULL;
    }
    s->input.body_max = LW_FRAMING_CLIENT_BODY_MAX;
    s->take[s->take_count++].channel = &shared->channels.at[LW_TILE_CHANNEL_FULL];
    s->interest.everything = true;
    s->number = ++shared->number;
    s->since_ns = s->looked_ns = s->heard_ns = s->progress_ns = lw_clock_ns();
    s->linger_ns = LINGER_NS;
    lw_message_rates_init(&s->rates, s->since_ns);
    link_session(s);
    shared->on_open(shared->server);
    if (s->is_turned_away && peer->is_too_many)
        lw_session_refuse(s, LW_REFUSAL_RATE, "this address connects too often: %u times a second at most",
                          connections_at_once(shared, &peer->at) / LW_SERVER_CONNECTIONS_REFILL_S);
    else if (s->is_turned_away && shared->place_count >= shared->limits.sessions_max)
        lw_session_refuse(s, LW_REFUSAL_FULL, "the server has its %u sessions", shared->limits.sessions_max);
    else if (s->is_turned_away)
        lw_session_refuse(s, LW_REFUSAL_FULL, "this address has its %u sessions",
                          address_share(shared, &peer->at));
    return s;
}

static void free_sending(struct lw_session_sending *sending) {
    lw_blob_unref(sending->partial);
    free(sending->held);
}

void lw_session_closed(struct lw_session *s) {
    struct lw_session_shared *shared = s->shared;
    LW_INVARIANT(s->state == LW_SESSION_CLOSED && !s->welcomed && !s->has_place && !s->is_turned_away);
    LW_INVARIANT(!s->queue && !s->inbox); /* nobody finds it any more */
    lw_blob_unref(s->control);
    for (struct lw_blob *blob; (blob = lw_session_take_answer(s));) lw_blob_unref(blob);
    free_sending(&s->package);
    free_sending(&s->finishes);
    lw_message_reader_clear(&s->input);
    for (uint32_t i = 0; i < s->take_count; i++) {
        free(s->take[i].sent);
        free(s->take[i].lacked);
    }
    free(s->interest_bits);
    lw_session_interest_free(s, &s->interest);
    lw_session_interest_free(s, &s->waiting);
    free(s);
    shared->on_close(shared->server);
}

static void unlink_session(struct lw_session *s) {
    LW_INVARIANT((s->shared->first == s) == !s->previous && (!s->next || s->next->previous == s));
    if (s->previous)
        s->previous->next = s->next;
    else
        s->shared->first = s->next;
    if (s->next) s->next->previous = s->previous;
}

void lw_session_count_one(const struct lw_session *s, int64_t change) {
    struct lw_server_stats *stats = &s->shared->stats;
    lw_session_count(s->shared, &stats->sessions_now, change);
    if (s->take[0].channel->number == LW_TILE_CHANNEL_SPLIT)
        lw_session_count(s->shared, &stats->sessions_drawing, change);
}

/* No longer one of those who are served. */
static void end_service(struct lw_session *s) {
    if (s->state == LW_SESSION_STREAMING) lw_session_interest_leave(s);
    if (s->controls && s->shared->is_relay) lw_passed_updates_forget(&s->shared->passed, s);
    if (s->controls) lw_updates_forget(&s->shared->updates, s);
    s->controls = false;
    if (s->welcomed) lw_session_count_one(s, -1);
    s->welcomed = false;
}

void lw_session_close(struct lw_session *s, const char *reason) {
    if (s->state == LW_SESSION_CLOSED) return;
    if (s->welcomed) lw_session_tell(s, "left: %s", reason);
    end_service(s);
    give_place_back(s);
    lw_session_queues_dequeue(s);
    lw_session_queues_leave_inbox(s);
    s->state = LW_SESSION_CLOSED;
    unlink_session(s);
    lw_session_relays_leave(s);
    s->link->ops->close(s->link);
}

/* A client that leaves with light unread on its link resets it: nothing went wrong. */
static const char *reason(int result) {
    return result == UV_ECONNRESET || result == UV_EPIPE || result == UV_EOF ? "closed by the peer"
                                                                             : uv_strerror(result);
}

void lw_session_lost(struct lw_session *s, int result) { lw_session_close(s, reason(result)); }

void lw_session_written(struct lw_session *s, int result, bool was_full) {
    LW_INVARIANT(s->is_writing || s->state == LW_SESSION_CLOSED);
    s->is_writing = false;
    if (s->state == LW_SESSION_CLOSED) return;
    if (result < 0) {
        lw_session_close(s, reason(result));
        return;
    }
    lw_session_count(s->shared, &s->shared->stats.bytes_sent, (int64_t)s->writing);
    s->link_was_full |= was_full;
    lw_session_queues_set_due(s, false);
}

void lw_session_refuse(struct lw_session *s, enum lw_refusal code, const char *format, ...) {
    if (code == LW_REFUSAL_SHUTDOWN) s->linger_ns = LINGER_NS; /* also for a leaving session */
    if (s->state == LW_SESSION_LEAVING || s->state == LW_SESSION_CLOSED) return;
    char *text = s->refusal_text;
    va_list args;
    va_start(args, format);
    vsnprintf(text, sizeof s->refusal_text, format, args);
    va_end(args);
    s->refusal = code;
    lw_session_tell(s, "%s: %s", s->welcomed ? "sent away" : "refused", text);
    end_service(s);
    /* unread bytes would make the close a reset, which the refusal may not survive */
    lw_session_queues_read_on(s);
    lw_session_count(s->shared, &s->shared->stats.refused, 1);
    s->state = LW_SESSION_LEAVING;
    s->since_ns = lw_clock_ns();
    lw_message_rates_init(&s->rates,
                          s->since_ns); /* what it says from now on is dropped, but not at any rate */
    lw_message_rates_bound(&s->rates, LW_MESSAGE_RATES_BYTES, LW_SERVER_DROPPED_MAX);
    lw_message_rates_bound(&s->rates, LW_MESSAGE_RATES_FRAMES, LW_SERVER_DROPPED_FRAMES_MAX);
    s->link->ops->push(s->link);
    lw_blob_unref(s->control);
    s->control = NULL;
    struct lw_message message = {.type = LW_MESSAGE_REFUSAL, .refusal = {code, text, 0}};
    if (code == LW_REFUSAL_SHUTDOWN) message.refusal.retry_after_ms = s->shared->retry_after_ms;
    if (lw_blob_from_message(&message, &s->control) != LW_OK)
        lw_session_lacks_memory(s);
    else
        lw_session_queues_set_due(s, true);
}

void lw_session_lacks_memory(struct lw_session *s) {
    s->lacks_memory = true;
    lw_session_queues_set_due(s, true);
}

void lw_session_close_lacking(struct lw_session *s) {
    static const char why[] = "out of memory";
    if (s->state == LW_SESSION_CLOSED) return;
    if (!s->welcomed) lw_session_tell(s, "closed: %s", why); /* else a line says that it left */
    lw_session_close(s, why);
}

void lw_session_check_token(struct lw_session *s) {
    if (s->role == LW_TOKENS_NONE || !s->shared->tokens) return;
    if (lw_tokens_role(s->shared->tokens, s->token.bytes) != s->role)
        lw_session_refuse(s, LW_REFUSAL_TOKEN, "the token is no longer one of this server's");
}

void lw_session_count_other(struct lw_session *s, enum lw_message_rates_kind kind, size_t many) {
    if (s->state == LW_SESSION_CLOSED || !many) return;
    if (lw_message_rates_count_other(&s->rates, kind, (double)many, lw_clock_ns()) &&
        s->inbox != &s->shared->queues.slowed)
        lw_session_queues_enter_inbox(s, &s->shared->queues.slowed);
}

void lw_session_queue_answer(struct lw_session *s, const struct lw_message *message) {
    if (s->answer_count >= LW_SERVER_ANSWERS_MAX) {
        lw_session_refuse(s, LW_REFUSAL_PROTOCOL, "message UPDATE: %u answers wait to be read",
                          LW_SERVER_ANSWERS_MAX);
        return;
    }
    struct lw_session_answer_entry *last = malloc(sizeof *last);
    if (!last || lw_blob_from_message(message, &last->blob) != LW_OK) {
        free(last);
        lw_session_lacks_memory(s); /* an answer must not be lost */
        return;
    }
    LW_INVARIANT(!s->first_answer == !s->answer_count && !s->last_answer == !s->answer_count);
    last->next = NULL;
    if (s->last_answer)
        s->last_answer->next = last;
    else
        s->first_answer = last;
    s->last_answer = last;
    s->answer_count++;
    lw_session_queues_set_due(s, true);
}

struct lw_blob *lw_session_take_answer(struct lw_session *s) {
    struct lw_session_answer_entry *answer = s->first_answer;
    if (!answer) return NULL;
    struct lw_blob *blob = answer->blob;
    LW_INVARIANT(s->answer_count > 0 && (s->answer_count == 1) == !answer->next);
    s->first_answer = answer->next;
    if (!s->first_answer) s->last_answer = NULL;
    s->answer_count--;
    free(answer);
    return blob;
}

void lw_session_answer(struct lw_session *s, const struct lw_message_updated *answer) {
    lw_session_queue_answer(s, &(struct lw_message){.type = LW_MESSAGE_UPDATED, .updated = *answer});
}

/* The peer hears of it at its turn. */
static void look_at_first_light(struct lw_session *s, uint64_t now_ns) {
    if (!s->shared->first_light || s->state != LW_SESSION_STREAMING ||
        s->sent_waiting.stage == LW_WAITING_READY)
        return;
    if (now_ns < s->sent_waiting_ns + LW_SERVER_WAITING_MS * 1000000ull) return;
    const struct lw_waiting_state now = lw_waiting_read(s->shared->first_light);
    if (now.stage == s->sent_waiting.stage && now.share == s->sent_waiting.share) return;
    s->first_light_due = true;
    lw_session_queues_set_due(s, false);
}

/* Progress is what the peer takes: our own socket would take megabytes for one who reads nothing. */
static bool is_stalled(struct lw_session *s, uint64_t now_ns, struct lw_session_waiting *waiting) {
    size_t ours, socket;
    s->link->ops->waiting(s->link, &ours, &socket);
    waiting->bytes += ours;
    waiting->socket_bytes += socket;
    if (waiting->bytes_max < ours) waiting->bytes_max = ours;
    const uint64_t taken = s->given - ours - socket;
    if (!(ours + socket) || taken != s->taken_last) s->progress_ns = now_ns;
    s->taken_last = taken;
    return now_ns > s->progress_ns && now_ns - s->progress_ns > s->shared->limits.stall_timeout_ns;
}

/* It may only be slow with what it has: it finds the refusal behind that. Until then the link stays, since
 * what the peer says to one that is closed would make the rest of it a reset. */
static void refuse_stalled(struct lw_session *s) {
    s->linger_ns = s->shared->limits.stall_timeout_ns;
    lw_session_refuse(s, LW_REFUSAL_TIMEOUT, "took no byte for %u s",
                      (unsigned)(s->shared->limits.stall_timeout_ns / 1000000000u));
}

/* Pings a peer that says nothing; true: that did not help. What waits in an inbox counts as said. */
static bool is_silent(struct lw_session *s, uint64_t now_ns) {
    const uint64_t silence_ns = s->inbox || now_ns < s->heard_ns ? 0 : now_ns - s->heard_ns;
    if (!s->pinged && silence_ns > s->shared->limits.silence_timeout_ns / 2) {
        s->pinged = s->ping_due = true;
        lw_session_queues_set_due(s, true);
    }
    return silence_ns > s->shared->limits.silence_timeout_ns;
}

/* With nearly no place left it is for those who say who they are. */
static uint64_t hello_timeout_ns(const struct lw_session_shared *shared) {
    const uint64_t crowded_ns = LW_SERVER_CROWDED_HELLO_S * 1000000000ull;
    return lw_session_is_crowded(shared) && crowded_ns < shared->limits.hello_timeout_ns
               ? crowded_ns
               : shared->limits.hello_timeout_ns;
}

void lw_session_tick(struct lw_session *s, uint64_t now_ns, struct lw_session_waiting *waiting) {
    uint64_t age_ns = now_ns > s->since_ns ? now_ns - s->since_ns : 0;
    LW_INVARIANT(s->state != LW_SESSION_CLOSED && now_ns >= s->looked_ns);
    if (s->link->ops->overhead)
        lw_session_count_other(s, LW_MESSAGE_RATES_OVERHEAD, s->link->ops->overhead(s->link));
    const char *excess =
        lw_message_rates_judge(&s->rates, now_ns - s->looked_ns, s->shared->limits.excess_timeout_ns);
    s->looked_ns = now_ns;
    look_at_first_light(s, now_ns);
    if (s->state == LW_SESSION_LEAVING && age_ns > s->linger_ns)
        lw_session_close(s, "refused");
    else if (s->state == LW_SESSION_EXPECTS_HELLO && age_ns > hello_timeout_ns(s->shared))
        lw_session_refuse(s, LW_REFUSAL_TIMEOUT, "no hello in time");
    else if (s->state != LW_SESSION_LEAVING && excess)
        lw_session_refuse(s, LW_REFUSAL_RATE, "%s, for too long", excess);
    else if (s->state == LW_SESSION_WELCOMED && !s->controls && !s->operates &&
             age_ns > s->shared->limits.package_timeout_ns)
        lw_session_refuse(s, LW_REFUSAL_TIMEOUT, "no PACKAGE_REQUEST in time");
    else if (s->welcomed && is_silent(s, now_ns))
        lw_session_refuse(s, LW_REFUSAL_TIMEOUT, "nothing was heard, not even a PONG");
    else if (s->state != LW_SESSION_LEAVING && is_stalled(s, now_ns, waiting))
        refuse_stalled(s);
    else if (s->has_waiting)
        lw_session_queues_set_due(s, true);
}
