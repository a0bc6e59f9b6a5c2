/* link.h: the client's end of the connection, by TCP, in plain or by TLS, or a Unix socket: framed messages
 * in, framed messages out, silence noticed.
 * Flow:    server -> socket -> [link] -> messages -> client
 * Threads: one thread at a time. */
#ifndef LIGHTWELL_LINK_H
#define LIGHTWELL_LINK_H

#include "common/tls/tls_stream.h"
#include "proto/message.h"
#include "proto/message_reader.h"

#define LW_LINK_ADDRESS_SIZE 300u
/* Bytes that the socket has not taken yet. Messages beyond that are dropped. The longest UPDATE fits. */
#define LW_LINK_OUTBOX_SIZE (64u << 10)
#define LW_LINK_PING_S      5u
#define LW_LINK_SILENCE_S   15u

struct lw_link {
    int socket;
    char address[LW_LINK_ADDRESS_SIZE]; /* HOST:PORT, for people */
    uint8_t *input;                     /* bytes that were read last */
    struct lw_message_reader reader;    /* to it that is lent */
    uint8_t outbox[LW_LINK_OUTBOX_SIZE];
    size_t outbox_size;
    struct lw_tls_stream *tls;   /* NULL: it is plain */
    struct lw_tls_output sealed; /* the outbox's bytes, by TLS */
    size_t sealed_sent;
    uint8_t *sealed_input; /* bytes that were read last, before TLS */
    int first_byte;        /* of all sealed input; negative: nothing came */
    uint64_t bytes_received;
    uint64_t heard_ns, pinged_ns, looked_ns;
};

/** Where to connect, and how. */
struct lw_link_desc {
    const char *host; /* a name or address; "unix:PATH": a Unix socket */
    uint16_t port;
    unsigned timeout_ms;
    /* To change the scene without a token: on the own machine (127.0.0.0/8, ::1, localhost) the server's Unix
     * socket is tried first. */
    bool prefers_local;
    const int *socket;      /* connected already; the link closes it. host names it. NULL: connect */
    struct ssl_ctx_st *tls; /* by TLS, but on a Unix socket: whom to believe (tls_trust.h); NULL: in plain */
};

/** Connects within a time limit, and shakes hands where there is TLS. Errors: LW_NO_HOST, LW_UNAVAILABLE,
 * LW_TIMED_OUT, LW_OS, LW_NO_MEMORY, with TLS LW_NOT_ALLOWED and LW_PROTOCOL, each naming the address.
 * lw_link_finish() is needed after success only. */
LW_MUST_CHECK enum lw_status lw_link_connect(struct lw_link *link, const struct lw_link_desc *desc,
                                             struct lw_error *err);
void lw_link_finish(struct lw_link *link);
/** Ends the connection for both sides; the descriptor stays until lw_link_finish(). */
void lw_link_hang_up(struct lw_link *link);

/** Sends, or keeps until there is room. If the outbox is full the message is dropped whole: use it for
 * messages that a later one makes good, or ask lw_link_fits() first. Errors: LW_CLOSED, LW_NO_MEMORY. */
LW_MUST_CHECK enum lw_status lw_link_send(struct lw_link *link, const struct lw_message *message,
                                          struct lw_error *err);

/** Whether lw_link_send() would take a message now, rather than drop it. Errors: LW_CLOSED. */
LW_MUST_CHECK enum lw_status lw_link_fits(struct lw_link *link, const struct lw_message *message,
                                          bool *out_fits, struct lw_error *err);

/** Waits until there is something to read or the deadline (lw_clock_ns) has passed; pings meanwhile.
 * Errors: LW_TIMED_OUT if the server has been silent for LW_LINK_SILENCE_S; LW_CLOSED, LW_OS. */
LW_MUST_CHECK enum lw_status lw_link_wait(struct lw_link *link, uint64_t deadline_ns, struct lw_error *err);

/** Reads once. *out_size is 0 if nothing was there. Errors: LW_CLOSED; what came before can still be
 * taken. */
LW_MUST_CHECK enum lw_status lw_link_receive(struct lw_link *link, size_t *out_size, struct lw_error *err);

/** Takes the next whole message; *out_body is NULL if there is none, and valid until the next call on the
 * link.
 * Errors: LW_PROTOCOL, LW_NO_MEMORY. */
LW_MUST_CHECK enum lw_status lw_link_take(struct lw_link *link, struct lw_framing_header *out_header,
                                          const uint8_t **out_body, struct lw_error *err);

#endif
