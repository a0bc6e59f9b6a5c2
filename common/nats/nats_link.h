/* nats_link.h: a connection with a NATS server, with a bounded queue of messages for one thread.
 * Flow:    NATS -> threads of libnats -> [queue] -> the owner's thread -> [link] -> NATS
 * Threads: one thread owns a link; lw_nats_link_wake() is [any]. Publishing may wait for the server: a thread
 *          that serves others owns none.
 *
 * A link that breaks reconnects by itself. Messages published meanwhile are dropped. */
#ifndef LW_NATS_NATS_LINK_H
#define LW_NATS_NATS_LINK_H

#include "common/base/status.h"
#include "common/base/tls_trust_desc.h"

#include <nats/nats.h>
#include <stdbool.h>
#include <stdint.h>

struct lw_nats_link;

struct lw_nats_link_desc {
    const char *url;                /* nats://... or tls://...; may hold a password */
    const char *tls_host;           /* by TLS, with a server of this name or number; NULL: in plain */
    struct lw_tls_trust_desc trust; /* for tls_host */
    const char *name;               /* the server's name for people; outlives the link */
    const char *client;
    unsigned timeout_ms;
    uint32_t queue_max; /* messages, and 64 MiB; further ones are dropped, which LW_NATS_LINK_DROPPED tells */
};

/** Errors: LW_UNAVAILABLE, LW_TIMED_OUT, LW_NOT_ALLOWED (also: a certificate that is not believed),
 * LW_PROTOCOL (one end speaks TLS, the other one does not), LW_OS, LW_NO_MEMORY, naming the server.
 * LW_NO_INPUT, LW_BAD_DATA: the file of trust.ca, by its option. */
LW_MUST_CHECK enum lw_status lw_nats_link_create(const struct lw_nats_link_desc *desc,
                                                 struct lw_nats_link **out_link, struct lw_error *err);
/** No message comes any more, and nothing can be published: to be called before a context of JetStream on the
 * link is destroyed, whose subscription lw_nats_link_unsubscribe() cannot reach. NULL is fine. */
void lw_nats_link_close(struct lw_nats_link *link);
void lw_nats_link_destroy(struct lw_nats_link *link); /* NULL is fine */

/** For JetStream, and for requests. */
natsConnection *lw_nats_link_connection(const struct lw_nats_link *link);
bool lw_nats_link_is_connected(const struct lw_nats_link *link);

/** Errors: LW_UNAVAILABLE, LW_NO_MEMORY. */
LW_MUST_CHECK enum lw_status lw_nats_link_subscribe(struct lw_nats_link *link, const char *subject,
                                                    natsSubscription **out_subscription);
/** Also for a subscription that was made on lw_nats_link_connection(): natsSubscription_Destroy() is not safe
 * while a message may come. NULL is fine. */
void lw_nats_link_unsubscribe(struct lw_nats_link *link, natsSubscription *subscription);

/** Frees malloc'ed memory, one piece, once no callback of the link's subscriptions can run any more: for what
 * callbacks of JetStream use. To be called at most once. */
void lw_nats_link_own(struct lw_nats_link *link, void *memory);

/** Returns whether it was handed to libnats: the link is there, and the payload is no larger than the server
 * takes. */
bool lw_nats_link_publish(struct lw_nats_link *link, const char *subject, const void *bytes, size_t size);

enum lw_nats_link_event {
    LW_NATS_LINK_NOTHING,
    LW_NATS_LINK_MESSAGE, /* the caller frees it: natsMsg_Destroy() */
    LW_NATS_LINK_GONE,    /* the server */
    LW_NATS_LINK_BACK,    /* the server is there again; messages of the time between are lost */
    LW_NATS_LINK_DROPPED  /* messages, here or in libnats: too many waited */
};
/** The next event or message, in order; events before messages. */
enum lw_nats_link_event lw_nats_link_take(struct lw_nats_link *link, natsMsg **out_message);
/** For poll(): POLLIN while an event or a message waits, or after lw_nats_link_wake(). A lw_nats_link_take()
 * that gives nothing resets it. */
int lw_nats_link_descriptor(const struct lw_nats_link *link);
void lw_nats_link_wake(struct lw_nats_link *link); /* [any] */

/** Text for people of a failure of JetStream. */
const char *lw_nats_link_text(natsStatus status, jsErrCode code);
/** Whether it says that there is no JetStream. */
bool lw_nats_link_lacks_jetstream(natsStatus status, jsErrCode code);

#endif
