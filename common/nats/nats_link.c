#include "common/nats/nats_link.h"

#include "common/base/invariant.h"

#include <errno.h>
#include <pthread.h>
#include <stdatomic.h>
#include <stdlib.h>
#include <string.h>
#include <sys/eventfd.h>
#include <unistd.h>

#define RECONNECT_WAIT_MS 200
#define WRITE_LIMIT_MS    5000
#define PING_MS           5000
#define PINGS_OUT         2
#define BYTES_MAX         (64u << 20) /* for waiting messages */
#define RECONNECT_BYTES   1           /* without a server messages are lost, by design */

/* Callbacks of libnats come in threads of its own, as late as they please: each subscription, and the
 * connection, holds a reference. */
struct inbox {
    _Atomic uint32_t references;
    int wake;
    pthread_mutex_t mutex; /* guards what follows */
    bool is_gone, is_back, dropped, is_closed;
    natsMsg **message; /* a ring */
    uint32_t capacity, first, count;
    size_t bytes; /* in waiting messages */
    void *owned;
};

/* A subscription that has ended. Up to libnats 3.6.0 the thread that reads finds the subscription of a
 * message and then uses it without a reference of its own. If it is freed meanwhile, that thread waits for a
 * mutex that is no more, for ever, and who closes the connection waits for that thread. */
struct ended {
    natsSubscription *subscription;
    uint64_t read; /* messages that were read when it ended: the last of them may be its own */
};

struct lw_nats_link {
    struct inbox *inbox;
    natsConnection *connection;
    natsStatistics *statistics;
    int64_t payload_max;
    bool is_closed;
    struct ended *ended; /* not freed yet */
    size_t ended_count, ended_capacity;
};

static void unref(struct inbox *inbox) {
    LW_INVARIANT(inbox->references > 0);
    if (--inbox->references) return;
    for (uint32_t i = 0; i < inbox->count; i++)
        natsMsg_Destroy(inbox->message[(inbox->first + i) % inbox->capacity]);
    pthread_mutex_destroy(&inbox->mutex);
    close(inbox->wake);
    free(inbox->owned);
    free(inbox->message);
    free(inbox);
}

static void wake(const struct inbox *inbox) {
    const uint64_t one = 1;
    (void)!write(inbox->wake, &one, sizeof one); /* full: it is awake already */
}

/* ---- callbacks, in threads of libnats ---- */

static size_t size_of(const natsMsg *message) {
    const int size = natsMsg_GetDataLength(message);
    return size > 0 ? (size_t)size : 0;
}

static void on_message(natsConnection *connection, natsSubscription *subscription, natsMsg *message,
                       void *context) {
    (void)connection, (void)subscription;
    struct inbox *inbox = context;
    const size_t size = size_of(message);
    pthread_mutex_lock(&inbox->mutex);
    const bool fits = !inbox->is_closed && inbox->count < inbox->capacity && inbox->bytes + size <= BYTES_MAX;
    if (fits) {
        inbox->message[(inbox->first + inbox->count++) % inbox->capacity] = message;
        inbox->bytes += size;
    }
    inbox->dropped |= !fits;
    pthread_mutex_unlock(&inbox->mutex);
    if (!fits) natsMsg_Destroy(message);
    wake(inbox);
}

static void on_complete(void *context) { unref(context); }

static void set(struct inbox *inbox, bool *flag) {
    pthread_mutex_lock(&inbox->mutex);
    *flag = true;
    pthread_mutex_unlock(&inbox->mutex);
    wake(inbox);
}

static void on_gone(natsConnection *connection, void *context) {
    (void)connection;
    struct inbox *inbox = context;
    set(inbox, &inbox->is_gone);
}

static void on_back(natsConnection *connection, void *context) {
    (void)connection;
    struct inbox *inbox = context;
    set(inbox, &inbox->is_back);
}

static void on_error(natsConnection *connection, natsSubscription *subscription, natsStatus status,
                     void *context) {
    (void)connection, (void)subscription;
    struct inbox *inbox = context;
    if (status == NATS_SLOW_CONSUMER) set(inbox, &inbox->dropped);
}

static void on_closed(natsConnection *connection, void *context) {
    (void)connection;
    unref(context);
}

/* ---- create, destroy ---- */

static struct inbox *create_inbox(uint32_t capacity) {
    struct inbox *inbox = calloc(1, sizeof *inbox);
    if (!inbox) return NULL;
    inbox->references = 1;
    inbox->capacity = capacity;
    inbox->message = calloc(capacity, sizeof(natsMsg *));
    inbox->wake = eventfd(0, EFD_NONBLOCK | EFD_CLOEXEC);
    if (!inbox->message || inbox->wake < 0) {
        if (inbox->wake >= 0) close(inbox->wake);
        free(inbox->message);
        free(inbox);
        return NULL;
    }
    pthread_mutex_init(&inbox->mutex, NULL); /* glibc's cannot fail */
    return inbox;
}

static natsStatus set_options(natsOptions *options, const struct lw_nats_link_desc *desc,
                              struct inbox *inbox) {
    const natsStatus each[] = {
        natsOptions_SetURL(options, desc->url),
        natsOptions_SetName(options, desc->client),
        natsOptions_SetTimeout(options, desc->timeout_ms),
        natsOptions_SetNoEcho(options, true),
        natsOptions_UseGlobalMessageDelivery(options, true), /* one thread, whatever there is to listen to */
        natsOptions_SetMaxReconnect(options, -1),
        natsOptions_SetReconnectWait(options, RECONNECT_WAIT_MS),
        natsOptions_SetReconnectJitter(options, RECONNECT_WAIT_MS, RECONNECT_WAIT_MS),
        natsOptions_SetReconnectBufSize(options, RECONNECT_BYTES),
        natsOptions_SetPingInterval(options, PING_MS),
        natsOptions_SetMaxPingsOut(options, PINGS_OUT),
        natsOptions_SetWriteDeadline(options, WRITE_LIMIT_MS),
        natsOptions_SetMaxPendingMsgs(options, (int)desc->queue_max),
        natsOptions_SetDisconnectedCB(options, on_gone, inbox),
        natsOptions_SetReconnectedCB(options, on_back, inbox),
        natsOptions_SetErrorHandler(options, on_error, inbox),
        natsOptions_SetClosedCB(options, on_closed, inbox)};
    for (size_t i = 0; i < sizeof each / sizeof *each; i++)
        if (each[i] != NATS_OK) return each[i];
    return NATS_OK;
}

/* Errors: as lw_nats_link_create(). */
static enum lw_status set_tls(natsOptions *options, const struct lw_nats_link_desc *desc,
                              struct lw_error *err) {
    const struct lw_tls_trust_desc *trust = &desc->trust;
    if (!desc->tls_host) return LW_OK;
    if (trust->ca && access(trust->ca, R_OK) != 0)
        return lw_status_fail(err, errno == ENOENT ? LW_NO_INPUT : LW_IO, "--ca: %s: %s", trust->ca,
                              strerror(errno));
    natsStatus status = natsOptions_SetSecure(options, true);
    if (status == NATS_OK && trust->trusts_all) status = natsOptions_SkipServerVerification(options, true);
    if (status == NATS_OK && !trust->trusts_all) /* what libnats checks without it depends on its version */
        status = natsOptions_SetExpectedHostname(options, desc->tls_host);
    if (status == NATS_OK && trust->ca &&
        natsOptions_LoadCATrustedCertificates(options, trust->ca) != NATS_OK)
        return lw_status_fail(err, LW_BAD_DATA, "--ca: %s holds no certificate in PEM, or a broken one",
                              trust->ca);
    return status == NATS_OK ? LW_OK : lw_status_fail(err, LW_NO_MEMORY, "out of memory");
}

/* libnats's text of a failure, without the place in its source. */
static const char *last_error(natsStatus status) {
    natsStatus last = NATS_OK;
    const char *text = nats_GetLastError(&last);
    if (last != status || !text || !*text) return natsStatus_GetText(status);
    const char *place_end = *text == '(' ? strstr(text, "): ") : NULL;
    return place_end ? place_end + 3 : text;
}

/* The part of TLS in a failure; LW_OK: it has none. libnats tries TLS with a server that wants it. */
static enum lw_status tls_failure(const struct lw_nats_link_desc *desc, natsStatus status,
                                  struct lw_error *err) {
    const bool is_refused = status == NATS_SSL_ERROR;
    if (status == NATS_SECURE_CONNECTION_REQUIRED || (is_refused && !desc->tls_host))
        return lw_status_fail(err, LW_PROTOCOL, "%s speaks TLS alone: write tls:// in place of nats://",
                              desc->name);
    if (status == NATS_SECURE_CONNECTION_WANTED)
        return lw_status_fail(err, LW_PROTOCOL, "%s does not speak TLS: write nats:// in place of tls://",
                              desc->name);
    if (!is_refused) return LW_OK;
    return lw_status_fail(
        err, LW_NOT_ALLOWED,
        "%s is not trusted: %s: --ca FILE names the certificate to believe, or its issuer's; "
        "it must be for %s",
        desc->name, last_error(status), desc->tls_host);
}

static enum lw_status connect_failure(const struct lw_nats_link_desc *desc, natsStatus status,
                                      struct lw_error *err) {
    const enum lw_status by_tls = tls_failure(desc, status, err);
    if (by_tls != LW_OK) return by_tls;
    const enum lw_status ours = status == NATS_NO_MEMORY                ? LW_NO_MEMORY
                                : status == NATS_TIMEOUT                ? LW_TIMED_OUT
                                : status == NATS_CONNECTION_AUTH_FAILED ? LW_NOT_ALLOWED
                                                                        : LW_UNAVAILABLE;
    return lw_status_fail(err, ours, "cannot connect to %s: %s: is nats-server running?", desc->name,
                          natsStatus_GetText(status));
}

enum lw_status lw_nats_link_create(const struct lw_nats_link_desc *desc, struct lw_nats_link **out_link,
                                   struct lw_error *err) {
    LW_INVARIANT(desc->queue_max > 0);
    struct lw_nats_link *link = calloc(1, sizeof *link);
    struct inbox *inbox = link ? create_inbox(desc->queue_max) : NULL;
    natsOptions *options = NULL;
    if (!inbox) {
        free(link);
        return lw_status_fail(err, LW_NO_MEMORY, "out of memory");
    }
    link->inbox = inbox;
    enum lw_status tls = LW_OK;
    natsStatus status = natsStatistics_Create(&link->statistics);
    if (status == NATS_OK) status = natsOptions_Create(&options);
    if (status == NATS_OK) status = set_options(options, desc, inbox);
    if (status == NATS_OK) tls = set_tls(options, desc, err);
    inbox->references++; /* the connection's, until on_closed() */
    if (status == NATS_OK && tls == LW_OK) status = natsConnection_Connect(&link->connection, options);
    natsOptions_Destroy(options);
    if (status != NATS_OK || tls != LW_OK) {
        unref(inbox);
        unref(inbox);
        natsStatistics_Destroy(link->statistics);
        free(link);
        return tls == LW_OK ? connect_failure(desc, status, err) : tls;
    }
    link->payload_max = natsConnection_GetMaxPayload(link->connection);
    *out_link = link;
    return LW_OK;
}

/* They are in the order in which they ended. */
static void free_ended(struct lw_nats_link *link, uint64_t read) {
    size_t freed = 0;
    while (freed < link->ended_count && link->ended[freed].read < read)
        natsSubscription_Destroy(link->ended[freed++].subscription);
    if (!freed) return;
    link->ended_count -= freed;
    memmove(link->ended, link->ended + freed, link->ended_count * sizeof *link->ended);
}

void lw_nats_link_close(struct lw_nats_link *link) {
    if (!link) return;
    pthread_mutex_lock(&link->inbox->mutex);
    link->inbox->is_closed = true;
    pthread_mutex_unlock(&link->inbox->mutex);
    natsConnection_Close(link->connection); /* waits for the thread that reads */
    link->is_closed = true;
}

void lw_nats_link_destroy(struct lw_nats_link *link) {
    if (!link) return;
    lw_nats_link_close(link);
    free_ended(link, UINT64_MAX);
    natsConnection_Destroy(link->connection);
    natsStatistics_Destroy(link->statistics);
    unref(link->inbox);
    free(link->ended);
    free(link);
}

void lw_nats_link_own(struct lw_nats_link *link, void *memory) {
    LW_INVARIANT(!link->inbox->owned);
    link->inbox->owned = memory;
}

natsConnection *lw_nats_link_connection(const struct lw_nats_link *link) { return link->connection; }

bool lw_nats_link_is_connected(const struct lw_nats_link *link) {
    return natsConnection_Status(link->connection) == NATS_CONN_STATUS_CONNECTED;
}

/* ---- publish, subscribe, take ---- */

enum lw_status lw_nats_link_subscribe(struct lw_nats_link *link, const char *subject,
                                      natsSubscription **out_subscription) {
    natsSubscription *subscription;
    const natsStatus status =
        natsConnection_Subscribe(&subscription, link->connection, subject, on_message, link->inbox);
    if (status != NATS_OK) return status == NATS_NO_MEMORY ? LW_NO_MEMORY : LW_UNAVAILABLE;
    link->inbox->references++;
    if (natsSubscription_SetOnCompleteCB(subscription, on_complete, link->inbox) != NATS_OK) {
        lw_nats_link_unsubscribe(link, subscription); /* the reference stays: it may be in use for a while */
        return LW_UNAVAILABLE;
    }
    *out_subscription = subscription;
    return LW_OK;
}

/* The thread that reads counts a message when it looks for its subscription. */
static uint64_t count_read(const struct lw_nats_link *link) {
    uint64_t messages = 0;
    natsStatus status = natsConnection_GetStats(link->connection, link->statistics);
    if (status == NATS_OK)
        status = natsStatistics_GetCounts(link->statistics, &messages, NULL, NULL, NULL, NULL);
    LW_INVARIANT(status == NATS_OK);
    return messages;
}

static bool has_room_for_ended(struct lw_nats_link *link) {
    if (link->ended_count < link->ended_capacity) return true;
    const size_t capacity = link->ended_capacity ? 2 * link->ended_capacity : 16;
    struct ended *grown = realloc(link->ended, capacity * sizeof *grown);
    if (!grown) return false;
    link->ended = grown;
    link->ended_capacity = capacity;
    return true;
}

void lw_nats_link_unsubscribe(struct lw_nats_link *link, natsSubscription *subscription) {
    if (!subscription) return;
    if (link->is_closed) { /* nothing reads any more */
        natsSubscription_Destroy(subscription);
        return;
    }
    (void)natsSubscription_Unsubscribe(subscription);
    const uint64_t read = count_read(link);
    free_ended(link, read);
    if (has_room_for_ended(link)) /* else it is never freed */
        link->ended[link->ended_count++] = (struct ended){subscription, read};
}

bool lw_nats_link_publish(struct lw_nats_link *link, const char *subject, const void *bytes, size_t size) {
    if ((int64_t)size > link->payload_max || !lw_nats_link_is_connected(link)) return false;
    return natsConnection_Publish(link->connection, subject, bytes, (int)size) == NATS_OK;
}

static enum lw_nats_link_event take_event(struct inbox *inbox) {
    const struct {
        bool *flag;
        enum lw_nats_link_event event;
    } each[] = {{&inbox->is_gone, LW_NATS_LINK_GONE},
                {&inbox->is_back, LW_NATS_LINK_BACK},
                {&inbox->dropped, LW_NATS_LINK_DROPPED}};
    for (size_t i = 0; i < sizeof each / sizeof *each; i++)
        if (*each[i].flag) {
            *each[i].flag = false;
            return each[i].event;
        }
    return LW_NATS_LINK_NOTHING;
}

enum lw_nats_link_event lw_nats_link_take(struct lw_nats_link *link, natsMsg **out_message) {
    struct inbox *inbox = link->inbox;
    uint64_t wakes;
    pthread_mutex_lock(&inbox->mutex);
    enum lw_nats_link_event event = take_event(inbox);
    if (event == LW_NATS_LINK_NOTHING && inbox->count) {
        event = LW_NATS_LINK_MESSAGE;
        *out_message = inbox->message[inbox->first];
        inbox->first = (inbox->first + 1) % inbox->capacity;
        inbox->count--;
        LW_INVARIANT(inbox->bytes >= size_of(*out_message));
        inbox->bytes -= size_of(*out_message);
    }
    if (event == LW_NATS_LINK_NOTHING) (void)!read(inbox->wake, &wakes, sizeof wakes);
    pthread_mutex_unlock(&inbox->mutex);
    return event;
}

int lw_nats_link_descriptor(const struct lw_nats_link *link) { return link->inbox->wake; }
void lw_nats_link_wake(struct lw_nats_link *link) { wake(link->inbox); }

bool lw_nats_link_lacks_jetstream(natsStatus status, jsErrCode code) {
    return code == JSNotEnabledErr || code == JSNotEnabledForAccountErr || status == NATS_NO_RESPONDERS;
}

const char *lw_nats_link_text(natsStatus status, jsErrCode code) {
    switch ((int)code) {
    case 0:
        return natsStatus_GetText(status);
    case JSStreamStoreFailedErr:
    case JSInsufficientResourcesErr:
    case JSStorageResourcesExceededErr:
    case JSMemoryResourcesExceededErr:
    case JSAccountResourcesExceededErr:
        return "JetStream is full";
    default:
        return lw_nats_link_lacks_jetstream(status, code) ? "this nats-server has no JetStream"
                                                          : natsStatus_GetText(status);
    }
}
