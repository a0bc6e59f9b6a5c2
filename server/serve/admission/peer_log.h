/* peer_log.h: lines about peers, as many as a person can read: who makes more of them is counted instead.
 * Flow:    session -> [peer_log] -> lw_log()
 * Threads: one thread at a time. */
#ifndef LW_SERVE_ADMISSION_PEER_LOG_H
#define LW_SERVE_ADMISSION_PEER_LOG_H

#include "server/serve/admission/address_places.h"
#include "server/serve/admission/leaky_bucket.h"

#include <stdarg.h>

#define LW_PEER_LOG_BURST  40u /* lines of one address at once */
#define LW_PEER_LOG_HZ     2u  /* and then a second */
#define LW_PEER_LOG_ALL_HZ 50u /* lines of all addresses a second; ten times as many at once */
#define LW_PEER_LOG_SLOTS  256u
#define LW_PEER_LOG_TELL_S 10u /* between two reports of left out lines */

/** Zero but for seed has said nothing. */
struct lw_peer_log {
    uint64_t seed;
    uint64_t logged_ns;
    struct lw_peer_log_slot {
        struct lw_leaky_bucket bucket; /* counts lines */
        uint64_t left_out;
        char address[64]; /* the last left out line's: addresses may share a slot */
    } slot[LW_PEER_LOG_SLOTS];
    struct lw_leaky_bucket all; /* of all lines */
};

/** Whether a line may be said now; if not it is counted. address_text: for people. */
bool lw_peer_log_allows(struct lw_peer_log *log, const struct lw_address *address, const char *address_text,
                        uint64_t now_ns);

/** Reports left out lines, every LW_PEER_LOG_TELL_S. Call now and then. */
void lw_peer_log_tell(struct lw_peer_log *log, uint64_t now_ns);

/** Quotes a name that a peer has chosen, so that it cannot look like ours: "name", with \"
 * and \\. Cut where dst ends. */
void lw_peer_log_quote(char *dst, size_t dst_size, const char *name);

#endif
