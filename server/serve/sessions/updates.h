/* updates.h: updates of the scene between the session that sent them and the frame that shows them.
 * Flow:    session -> [waiting] -> taken for a frame by the solver -> [taken] ->
 *          answered when that frame is published
 * Threads: lw_updates_take() [any], everything else [loop]; a mutex inside, held for an
 *          assignment or a short walk. */
#ifndef LW_SERVE_SESSIONS_UPDATES_H
#define LW_SERVE_SESSIONS_UPDATES_H

#include "common/scene/scene_change.h"

#include <stdatomic.h>
#include <uv.h>

#define LW_UPDATES_MAX         1024u        /* updates that may wait for a frame */
#define LW_UPDATES_CHANGES_MAX (128u << 10) /* changes of all together: 7.5 MiB */

struct lw_session;

struct lw_updates {
    uv_mutex_t mutex;               /* guards the fields below */
    struct lw_scene_change *change; /* the waiting updates', in order */
    size_t change_count, change_capacity;
    struct lw_updates_entry *entry; /* in order: first those that were taken, then those that wait */
    size_t taken_count, entry_count, entry_capacity;
    _Atomic bool waiting; /* some are; [any] may read it */
};

/** Errors: LW_OS. */
LW_MUST_CHECK enum lw_status lw_updates_init(struct lw_updates *updates);
void lw_updates_finish(struct lw_updates *updates);

/** Adds an update, whose changes are checked and copied, as is what its answer will
 * say: the objects that it adds.
 * false: there are too many, or there is no memory for it. [loop] */
bool lw_updates_add(struct lw_updates *updates, struct lw_session *session, uint64_t request,
                    const struct lw_scene_change *change, size_t count, const uint32_t *added,
                    size_t added_count);

/** Takes all that wait, for a frame. *out_change: theirs, in order; the taker's to
 * free(). Returns how many updates that
 * were: none may have a change, and of all changes there may be none. [any] */
size_t lw_updates_take(struct lw_updates *updates, uint64_t frame, struct lw_scene_change **out_change,
                       size_t *out_change_count);

/** An update that was taken for a published frame. */
struct lw_updates_entry {
    struct lw_session *session; /* who waits for the answer; NULL: it is gone */
    uint64_t request, frame;
    uint32_t *added; /* the taker's to free() */
    size_t added_count;
};
/** Takes off the first one that was taken for this frame or an earlier one; false: there is none. [loop] */
bool lw_updates_next(struct lw_updates *updates, uint64_t frame, struct lw_updates_entry *out_entry);

/** The session that sent them is gone: the updates take effect all the same, unanswered. [loop] */
void lw_updates_forget(struct lw_updates *updates, const struct lw_session *session);

#endif
