/* message_rates.h: how many messages a peer may say in a second, by kind, and how many bytes.
 * Flow:    message -> [message_rates] -> go on reading, or wait; waited for long: refuse
 * Threads: one thread at a time.
 *
 * A bucket for each kind holds the messages that may be said at once and fills by its rate. A message that
 * finds less than itself in its bucket is still taken; the peer's next ones wait until each bucket has filled
 * for LW_MESSAGE_RATES_PAUSE_MS: to stop and to go on costs as much as some messages. */
#ifndef LW_SERVE_ADMISSION_MESSAGE_RATES_H
#define LW_SERVE_ADMISSION_MESSAGE_RATES_H

#include "proto/framing.h"

/* name, messages or bytes a second, at once */
#define LW_MESSAGE_RATES_MAP(X)                                                                              \
    X(INTEREST, 30, 60)                                                                                      \
    X(PING, 20, 60)                                                                                          \
    X(PONG, 20, 60)                                                                                          \
    X(ACK, 1200, 1200) /* a FRAME each: as many as a server may make */                                      \
    X(UPDATE, 4000, 8000)                                                                                    \
    X(ASK, 20, 60)                                                                                           \
    X(HOLDS, 50, 512)         /* at once: for a million tiles */                                             \
    X(BYTES, 524288, 1048576) /* of all but HOLDS: ten of the longest INTEREST */                            \
    X(FRAMES, 100, 1000)      /* WebSocket frames, beyond one for each message */                            \
    X(OVERHEAD, 4096,                                                                                        \
      32768) /* bytes that the link had for itself, beyond LW_MESSAGE_RATES_ENVELOPE for each */

enum lw_message_rates_kind {
#define X(name, rate_hz, burst) LW_MESSAGE_RATES_##name,
    LW_MESSAGE_RATES_MAP(X)
#undef X
        LW_MESSAGE_RATES_COUNT
};

#define LW_MESSAGE_RATES_PAUSE_MS 250

struct lw_message_rates {
    double left[LW_MESSAGE_RATES_COUNT]; /* below 0: that much is lacking */
    uint64_t as_of_ns, waited_ns;
    bool waits, trusted;
};

/* Bytes in which a message may come: the header of a frame of a WebSocket and a record of TLS. */
#define LW_MESSAGE_RATES_ENVELOPE 40

/* Times the bytes, frames and overhead, for a peer that moves a thousand objects thirty times a second. */
#define LW_MESSAGE_RATES_TRUST 8

void lw_message_rates_init(struct lw_message_rates *rates, uint64_t now_ns);

/** Whether the peer may change the scene: then it may send LW_MESSAGE_RATES_TRUST times as much. */
void lw_message_rates_trust(struct lw_message_rates *rates, bool trusted);

/** Counts a message. Returns whether the next one has to wait. */
bool lw_message_rates_count(struct lw_message_rates *rates, struct lw_framing_header header, uint64_t now_ns);

/** From now on there is no more at once than this, until it has filled again. */
void lw_message_rates_bound(struct lw_message_rates *rates, enum lw_message_rates_kind kind, double at_once);

/** Counts frames, or bytes of overhead. Returns the same. */
bool lw_message_rates_count_other(struct lw_message_rates *rates, enum lw_message_rates_kind kind,
                                  double count, uint64_t now_ns);

/** Fills the buckets. Returns whether the next message still has to wait. */
bool lw_message_rates_wait(struct lw_message_rates *rates, uint64_t now_ns);

/** Text of the peer's excess: "more than 20 PING a second". NULL: it has not had to wait that long. Time
 * without excess makes up for time of waiting. Call a few times a second.
 * elapsed_ns  since the last call */
const char *lw_message_rates_judge(struct lw_message_rates *rates, uint64_t elapsed_ns, uint64_t limit_ns);

#endif
