/* load_session.h: one user of a load test. It is a whole protocol client that checks what it receives and
 * keeps no light.
 * Flow:    link -> messages -> [load_session] -> figures
 * Threads: everything here is [loop]. */
#ifndef LW_CLIENT_LOAD_LOAD_SESSION_H
#define LW_CLIENT_LOAD_LOAD_SESSION_H

#include "client/load/frame_clock.h"
#include "client/load/load_figures.h"
#include "client/load/load_options.h"
#include "client/load/load_scene.h"
#include "client/load/tile_check.h"
#include "common/tls/tls_stream.h"

#include <uv.h>

#define LW_LOAD_CONNECT_TIMEOUT_S 10u /* until the WELCOME */
#define LW_LOAD_SILENCE_S         15u
#define LW_LOAD_PING_S            1u           /* more often than the protocol asks: this measures the link */
#define LW_LOAD_FOLLOWED_ONE_IN   100u         /* users */
#define LW_LOAD_FOLLOWED_BYTES    (256u << 20) /* a bound for the light of all of them but the first */
#define LW_LOAD_SLOW_RECEIVE      (64 << 10) /* bytes of receive buffer of a slow or never-reader's socket */

struct lw_load_session;

/** A user that will reconnect after its connection broke. */
struct lw_load_return {
    struct lw_load_return *next;
    uint32_t number;
    enum lw_load_reader reader;
    unsigned attempt;  /* how often that has failed */
    uint64_t due_ns;   /* when to try */
    uint64_t broke_ns; /* when the connection did */
    uint64_t light_ns; /* as lw_load_session_light_ns() */
    uint64_t run;      /* the server's run, of which it has... */
    uint64_t *known;   /* ...these versions, one per tile */
};

/** State that all sessions share. Zero-initialised, then filled in by the owner. */
struct lw_load_shared {
    uv_loop_t *loop;
    const struct lw_load_options *options;
    const struct lw_load_scene *scene;
    struct lw_tile_check *check;
    struct lw_frame_clock clock;
    uint64_t heard_before;      /* frames of earlier runs of the server, which the clock has forgotten */
    uint64_t run, run_began_ns; /* its id, and when it first welcomed a session */
    uint32_t run_count;
    bool other_scene;                 /* the first one of any user: the test ends there */
    struct lw_load_return *returning; /* in no order */
    size_t held_bytes;                /* memory that followed sessions may take */
    struct lw_load_figures *figures;
    struct lw_load_session *first;        /* all that have not ended, also those that have said goodbye */
    uint32_t live_count;                  /* sessions that have not said goodbye */
    uint32_t session_count;               /* sessions with handles that are not closed yet */
    uint64_t measured_from_ns;            /* while figures->measuring */
    uint8_t read_buffer[256u << 10];      /* libuv hands a read over before it starts the next */
    uint8_t record[LW_TLS_STREAM_RECORD]; /* what TLS reads, in plain */
    struct lw_tls_output output;          /* what it made: empty between calls; the owner finishes it */
    lw_tile_id chosen[LW_MESSAGE_INTEREST_MAX];
    struct lw_message_interest_tile named[LW_MESSAGE_INTEREST_MAX];
};

/** Begins to connect.
 * number   of the session: with the options' seed it fixes all its random choices
 * Errors: LW_NO_MEMORY, LW_OS; counted as a fault, and there is no session. */
LW_MUST_CHECK enum lw_status lw_load_session_start(struct lw_load_shared *shared, uint32_t number,
                                                   enum lw_load_reader reader);

/** Reconnects the users that are due. */
void lw_load_session_return_due(struct lw_load_shared *shared, uint64_t now_ns);

/** Drops the users that would have reconnected. */
void lw_load_session_forget_returning(struct lw_load_shared *shared);

/** Handles time limits, pings, a slow reader's next bytes and a walker's next step. Call it some 20 times
 * a second. The session may end in it; its memory is freed later, when libuv has closed the handle. */
void lw_load_session_tick(struct lw_load_session *session, uint64_t now_ns);

/** Leaves: says goodbye and waits for the server's end, or resets the connection. */
void lw_load_session_leave(struct lw_load_session *session, bool graceful);

/** Ends the session's part in the measured time: its frame rate goes into the figures. */
void lw_load_session_conclude(struct lw_load_session *session, uint64_t now_ns);

/** Closes at once, without any count; for the end of the run. */
void lw_load_session_close(struct lw_load_session *session);

/** Whether it gets frames and reads them. */
bool lw_load_session_is_streaming(const struct lw_load_session *session);
/** The moment that the user's newest light shows: when its frame first reached any user, less its solve.
 * 0: the user has had no frame. */
uint64_t lw_load_session_light_ns(const struct lw_load_session *session);
/** Whether it has not said goodbye. */
bool lw_load_session_is_live(const struct lw_load_session *session);
enum lw_load_reader lw_load_session_reader(const struct lw_load_session *session);
struct lw_load_session *lw_load_session_next(const struct lw_load_session *session);

#endif
