/* session_private.h: a session's state, and what its files do for one another. Each uses those below it:
 *
 *   turns.c             which session has its turn, and takes it
 *   session_handlers.c  handles what the peer says
 *   send_queue.c        the next messages, in batches, within the rate limit
 *   tile_stream.c       the tiles of the newest snapshot that the session lacks
 *   session.c           begins, ends, answers, keeps time limits
 *   session_interest.c  what the session wants, and what all want
 *   session_queues.c    the queues in which sessions wait for a turn
 *   session_relays.c    the relays below, as they report themselves
 *
 * Threads: everything here is [loop]. For these files alone. */
#ifndef LW_SERVE_SESSIONS_SESSION_PRIVATE_H
#define LW_SERVE_SESSIONS_SESSION_PRIVATE_H

#include "proto/message_reader.h"
#include "server/serve/sessions/session.h"

enum lw_session_state {
    LW_SESSION_EXPECTS_HELLO,
    LW_SESSION_WELCOMED,  /* may ask for the package */
    LW_SESSION_STREAMING, /* package chunks, then frames and tiles */
    LW_SESSION_LEAVING,   /* was refused: what it sends is dropped */
    LW_SESSION_CLOSED     /* waits for its link */
};

/* One UPDATED. */
struct lw_session_answer_entry {
    struct lw_session_answer_entry *next;
    struct lw_blob *blob;
};

/* What an INTEREST said. */
struct lw_session_interest {
    bool everything, stand_ins;
    uint32_t tile_count;
    uint32_t *tile; /* lw_tile_id, each once */
};

/* A channel that a session gets. */
struct lw_session_take {
    struct lw_session_channel *channel;
    uint64_t *sent;      /* per tile: the version sent; NULL before that matters */
    uint64_t generation; /* the snapshot's that the walk below goes over */
    /* What the walk goes over: tiles that it lacks, by priority. NULL: it had all of the snapshot before, and
     * the walk goes over what this one changed. */
    uint32_t *lacked;
    uint32_t walk_left;   /* tiles still to look at */
    uint32_t walk_cursor; /* in lacked, or in changed */
    bool delta_follows;   /* to the delta sent last: of the walk's next tile */
    bool is_narrow;       /* the link takes less than changes: it gets coarse tiles before finer ones */
    bool refines;         /* narrow: it has all of these, and the walk goes over what they lack */
    uint64_t judged;      /* a generation: whether the link is narrow */
};

struct lw_session {
    struct lw_session_transport *link;
    struct lw_session_shared *shared;
    struct lw_session *previous, *next;
    struct lw_session_queue *queue; /* in which it waits for its turn; NULL: in none */
    struct lw_session *previous_due, *next_due;
    enum lw_session_state state;
    bool ended, welcomed;
    bool lacks_memory;        /* for what it must have: it is closed at its turn */
    bool has_place;           /* in all, and of its address; or */
    bool is_turned_away;      /* it got none */
    bool keeps_control_place; /* it counts among those who may control */
    bool controls;            /* may send updates */
    bool operates;            /* may ask as an operator */
    enum lw_tokens_role role; /* by its token; NONE: it needed none */
    struct lw_token token;    /* then, of that role */
    bool resumes;             /* may say what it has */
    uint64_t number;
    uint64_t relay; /* its number, if the peer is one; 0: it is none */
    struct lw_session_peer peer;
    char name[2 * LW_MESSAGE_NAME_MAX + 4]; /* in quotes; "": no HELLO yet */
    uint64_t since_ns;                      /* connected; in LW_SESSION_LEAVING: refused */
    uint64_t linger_ns;                     /* from a refusal to the close */
    struct lw_message_reader input;
    struct lw_message_rates rates;  /* for its messages */
    struct lw_session_inbox *inbox; /* in which it is: then nothing is read; NULL: in none */
    struct lw_session *previous_unread, *next_unread;
    uint64_t looked_ns; /* when the tick last came */
    uint64_t heard_ns;  /* when bytes last came */

    struct lw_blob *control; /* welcome or refusal */
    enum lw_refusal refusal; /* in LW_SESSION_LEAVING */
    char refusal_text[LW_MESSAGE_TEXT_MAX + 1];
    struct lw_waiting_state sent_waiting; /* last, of the first light; UNKNOWN: nothing */
    uint64_t sent_waiting_ns;             /* when */
    bool first_light_due;                 /* it has come further since */
    bool pong_due, ping_due;
    bool pinged; /* since it was heard */
    uint64_t pong_token;
    struct lw_session_answer_entry *first_answer, *last_answer; /* to updates, not sent yet */
    uint32_t answer_count;
    struct lw_session_sending {
        const struct lw_session_package *of; /* NULL: it was not asked for */
        struct lw_blob *partial;             /* where a request starts inside a chunk */
        uint32_t next;                       /* chunk */
        uint8_t *held;                       /* bit per part that is not sent; NULL: all are */
    } package, finishes;
    bool has_materials;               /* may ask for finishes */
    bool has_finer;                   /* may ask for tiles of finer levels */
    bool reads_runs;                  /* relays alone: the session reads the run of FRAMEs */
    bool reports;                     /* a relay that says which relays are below it */
    struct lw_relay_tree_node *below; /* as it reported last, itself first; NULL: nothing yet */
    uint32_t below_count;
    bool has_first_light; /* it was sent, or there is nothing to send */
    uint64_t first_sent;  /* tiles, until then */
    int64_t tiles_before; /* bytes of tiles that go before the next FINISH_CHUNK */
    uint64_t frame_sent, frame_acked;
    uint64_t frame_held;                          /* the last one that the peer has: no earlier one is sent */
    bool settled_due;                             /* SETTLED of the frame sent */
    struct lw_session_interest interest, waiting; /* what holds; what came since, if has_waiting */
    bool has_waiting;
    uint64_t interest_epoch; /* the server's, when interest was last taken up */
    /* Bit per tile: to be sent; then a bit per tile again: it is no stand-in. NULL: everything. */
    uint64_t *interest_bits;
    struct lw_session_take take[LW_TILE_CHANNELS_MAX]; /* what it gets, by the channels' numbers */
    uint32_t take_count;
    bool waits;         /* for what the transcoder makes of a tile */
    bool link_was_full; /* since the snapshot was new */

    uint64_t rate_limit_bytes_hz; /* 0: none */
    double allowance;             /* bytes that it may be sent now; below 0: it has had too much */
    uint64_t allowed_ns;          /* as of then */
    bool is_paced;                /* the rate limit holds something back */

    bool is_writing;     /* the link has not taken all yet */
    uint64_t writing;    /* bytes of that */
    uint64_t given;      /* bytes handed to the link so far */
    uint64_t taken_last; /* bytes of `given` that the peer has, at the last look at progress */
    uint64_t progress_ns;
};

/* ---- session.c ---- */

/** Adds to a counter of shared->stats. */
void lw_session_count(struct lw_session_shared *shared, uint64_t *counter, int64_t change);
/** Places that are kept for those whose token is for control. */
uint32_t lw_session_kept_places(const struct lw_session_shared *shared);
/** Whether all others are taken. */
bool lw_session_is_crowded(const struct lw_session_shared *shared);
/** One session more, or less, that was welcomed. */
void lw_session_count_one(const struct lw_session *s, int64_t change);
/** Queues an answer, UPDATED or REPORT, which is written after the frame that shows it. The session may be
 * refused or closed instead. */
void lw_session_queue_answer(struct lw_session *s, const struct lw_message *message);
/** The next of these; NULL: there is none. The caller has it then. */
struct lw_blob *lw_session_take_answer(struct lw_session *s);
/** There is no memory for what a session must have. It stops reading and writing, and the loop closes it at
 * its next turn: callers still use it, and its link may free it when it is closed. */
void lw_session_lacks_memory(struct lw_session *s);
/** Closes it then, with a line. */
void lw_session_close_lacking(struct lw_session *s);
/** Logs a line about a peer, unless there were many. */
void lw_session_tell(const struct lw_session *s, const char *format, ...) LW_PRINTF(2, 3);

/* ---- session_relays.c ---- */

/** A relay says which relays are below it. Errors: LW_PROTOCOL. */
LW_MUST_CHECK enum lw_status
lw_session_relays_report(struct lw_session *s, const struct lw_message_report *report, struct lw_error *err);
/** The session has ended: its report is dropped. */
void lw_session_relays_leave(struct lw_session *s);

/* ---- session_interest.c ---- */

/** The ids of tiles that a session can get: the first ones of the scene. */
static inline uint32_t lw_session_tiles(const struct lw_session *s) {
    return s->has_finer ? s->shared->atlas_map->tile_count : s->shared->atlas_map->plain_count;
}

/** Words of one of the two sets of bits in s->interest_bits. */
static inline size_t lw_session_interest_words(const struct lw_session *s) {
    return (size_t)lw_session_tiles(s) / 64 + 1;
}
static inline bool lw_session_interest_is_set(const uint64_t *bits, uint32_t tile) {
    return bits[tile / 64] >> (tile % 64) & 1;
}
/** Sets a tile's bit; returns whether it was set. */
bool lw_session_interest_test_and_set(uint64_t *bits, uint32_t tile);
/** A peer drops the tiles of finer levels that it lists no more: they are sent whole, should it list them
 * again. before: a list of the session's; listed: bits of the one after it, NULL: everything, which has no
 * such tile */
void lw_session_interest_forget_fine(struct lw_session *s, const struct lw_session_interest *before,
                                     const uint64_t *listed);
/** Frees a list of the session's. */
void lw_session_interest_free(struct lw_session *s, struct lw_session_interest *interest);
/** s->waiting holds from now on. false: there is no memory, and nothing has changed. */
bool lw_session_interest_take_up(struct lw_session *s);
/** The session's interest and its channels' counts, from when it is streamed to until it is no more. */
void lw_session_interest_join(struct lw_session *s);
void lw_session_interest_leave(struct lw_session *s);

/* ---- session_queues.c ---- */

/** Gives it a turn: there may be something to send.
 * asked  for an answer: sessions that did not ask have another queue, and neither queue waits for the other
 */
void lw_session_queues_set_due(struct lw_session *s, bool asked);
/** Into a queue, at its end; and out of the one that it was in. */
void lw_session_queues_enqueue(struct lw_session *s, struct lw_session_queue *queue);
/** Out of the queue that it is in, if any. */
void lw_session_queues_dequeue(struct lw_session *s);
/** Into an inbox, at its end: nothing is read meanwhile. The link keeps what it has, and so does the peer. */
void lw_session_queues_enter_inbox(struct lw_session *s, struct lw_session_inbox *inbox);
void lw_session_queues_leave_inbox(struct lw_session *s);
/** Out of the inbox that it is in, if any: the session is read again. */
void lw_session_queues_read_on(struct lw_session *s);

/* ---- tile_stream.c ---- */

/** Whether there is a snapshot for the session. */
bool lw_tile_stream_has_light(const struct lw_session *s);
/** References to the next blobs to send, in this order. NULL: nothing, or (tiles, with s->waits) a blob that
 * the transcoder makes. */
struct lw_blob *lw_tile_stream_next_frame(struct lw_session *s);
struct lw_blob *lw_tile_stream_next_tile(struct lw_session *s);
struct lw_blob *lw_tile_stream_next_settled(struct lw_session *s);

/* ---- send_queue.c ---- */

/** Chunks of a package of part_count parts are sent as a valid request asks. false: there is no memory. */
bool lw_send_queue_start(struct lw_session_sending *sending, const struct lw_session_package *package,
                         size_t part_count, const struct lw_message_package_request *request);
/** Adds what the rate limit has let through since the last call. */
void lw_send_queue_renew_allowance(struct lw_session *s, uint64_t now_ns);
/** Writes a turn's batches. true: nothing is left that may be sent now; false: the link is full, or the turn
 * is over. */
bool lw_send_queue_write(struct lw_session *s);

#endif
