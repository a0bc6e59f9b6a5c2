/* passed_updates.h: updates that a relay forwards to the server above, and the answers that come back.
 * Flow:    session -> [waiting] -> the relay's link -> server above -> [answered] -> session, once the frame
 *          is here
 * Threads: lw_passed_updates_take(), _answer() and _lose() [any], everything else [loop]; a mutex inside,
 *          held for short walks. */
#ifndef LW_SERVE_SESSIONS_PASSED_UPDATES_H
#define LW_SERVE_SESSIONS_PASSED_UPDATES_H

#include "proto/message.h"

#include <stdatomic.h>
#include <uv.h>

#define LW_PASSED_UPDATES_MAX         1024u        /* without an answer */
#define LW_PASSED_UPDATES_CHANGES_MAX (128u << 10) /* not taken yet, over all updates: 7.5 MiB */

/* A relay that goes on with another run counts its frames from the next multiple of this on. */
#define LW_PASSED_UPDATES_RUN_FRAMES (UINT64_C(1) << 32)

struct lw_session;

/** An update on its way up. */
struct lw_passed_update {
    uint64_t number; /* the update's, here */
    bool has_token;
    struct lw_token token; /* the session's */
    struct lw_scene_change *change;
    size_t change_count;
};

struct lw_passed_updates {
    uv_mutex_t mutex;                      /* guards the fields below */
    struct lw_passed_updates_entry *entry; /* in the order in which they came */
    size_t entry_count, entry_capacity, change_count;
    uint64_t number;      /* the last update's */
    _Atomic bool waiting; /* some were not taken; [any] may read it */
};

/** Errors: LW_OS. */
LW_MUST_CHECK enum lw_status lw_passed_updates_init(struct lw_passed_updates *updates);
void lw_passed_updates_finish(struct lw_passed_updates *updates);

/** Adds an update, which is copied. token: NULL: the session has none. false: there are too many, or there is
 * no memory. [loop] */
bool lw_passed_updates_add(struct lw_passed_updates *updates, struct lw_session *session,
                           const struct lw_token *token, const struct lw_message_update *update);

/** Takes the first one that was not taken; false: there is none. The taker frees its changes. [any] */
bool lw_passed_updates_take(struct lw_passed_updates *updates, struct lw_passed_update *out_update);

/** The answer of the server above, which is copied; its request means nothing. false: there is no memory: the
 * answer is lost. [any] */
bool lw_passed_updates_answer(struct lw_passed_updates *updates, uint64_t number,
                              const struct lw_message_updated *answer);
/** An update was sent up, and no answer will come: nobody knows whether it was made. [any] */
void lw_passed_updates_lose(struct lw_passed_updates *updates, uint64_t number);

/** What became of an update. */
struct lw_passed_updates_done {
    struct lw_session *session; /* who waits for the answer */
    bool is_lost;
    struct lw_message_updated answer; /* unless it is lost; its request is the session's */
    void *storage;                    /* the answer's; the caller frees it */
};
/** The next one that its session may hear of: refusals at once, success with the frame that shows it, in the
 * order in which the updates came. One is lost whose frame is of an earlier run than the newest: the new run
 * lacks the change. frame: the newest here; 0: none. false: there is none. [loop] */
bool lw_passed_updates_next(struct lw_passed_updates *updates, uint64_t frame,
                            struct lw_passed_updates_done *out_done);

/** The session that sent them is gone: those on their way go on, unanswered. [loop] */
void lw_passed_updates_forget(struct lw_passed_updates *updates, const struct lw_session *session);

#endif
