#include "server/serve/transports/ws_transport.h"

#include "common/base/invariant.h"
#include "server/serve/sessions/session_handlers.h"
#include "server/serve/transports/tcp_transport.h"

#include <stdlib.h>
#include <string.h>

#define REASON_MAX 123u /* bytes of text in a Close: RFC 6455, 5.5 */

struct lw_ws_transport {
    struct lw_session_transport transport;
    struct lws *wsi;
    struct lw_ws_transport_shared *shared;
    struct lw_session *session;
    /* unwritten from `first` on, but for `written` bytes of it */
    struct lw_blob *blob[LW_SESSION_TRANSPORT_BLOBS];
    uint32_t first, blob_count;
    size_t written, waiting;
    uint64_t received;  /* bytes of messages */
    uint64_t came_last; /* to the socket */
    uint64_t overhead;  /* bytes of `came_last` that were no messages, counted so far */
    bool was_full;
    bool in_event; /* an event of this WebSocket runs: its return value closes it, nothing else may */
    bool closing;  /* the session wants it to */
    bool lost;     /* nothing can be written any more */
};

static struct lw_ws_transport *link_of(struct lw_session_transport *transport) {
    return (struct lw_ws_transport *)transport;
}

/* ---- what the session asks for ---- */

static int write_blobs(struct lw_session_transport *transport, struct lw_blob *const *blob, uint32_t count) {
    struct lw_ws_transport *link = link_of(transport);
    LW_INVARIANT(link->first == link->blob_count && count <= LW_SESSION_TRANSPORT_BLOBS);
    LW_INVARIANT(!link->waiting); /* the session is notified before it writes again */
    memcpy(link->blob, blob, count * sizeof(struct lw_blob *));
    link->first = 0;
    link->blob_count = count;
    link->written = 0;
    for (uint32_t i = 0; i < count; i++) link->waiting += blob[i]->size;
    lws_callback_on_writable(link->wsi);
    return 0;
}

static void read_on(struct lw_session_transport *transport, bool on) {
    struct lw_ws_transport *link = link_of(transport);
    if (!link->lost) lws_rx_flow_control(link->wsi, on);
}

static void push(struct lw_session_transport *transport) {
    struct lw_ws_transport *link = link_of(transport);
    if (!link->lost) lw_tcp_transport_push(lws_get_socket_fd(link->wsi));
}

/* A Close with a reason. To return from writeable() would not do: a debug build of libwebsockets, as Debian's
 * is, then closes twice, the second time at once. */
static int end_writing(struct lw_session_transport *transport, enum lw_refusal code, const char *text) {
    struct lw_ws_transport *link = link_of(transport);
    char reason[REASON_MAX];
    size_t size = strlen(text);
    LW_INVARIANT(!link->in_event);
    if (link->lost) return 0;
    if (size > REASON_MAX)
        for (size = REASON_MAX; size && ((unsigned char)text[size] & 0xc0) == 0x80;)
            size--; /* whole characters */
    memcpy(reason, text, size);
    lws_close_reason(link->wsi, (enum lws_close_status)(LW_WS_TRANSPORT_REFUSED + (unsigned)code),
                     (unsigned char *)reason, size);
    lws_set_timeout(link->wsi, PENDING_TIMEOUT_USER_OK, LWS_TO_KILL_SYNC);
    return 0;
}

static void close_link(struct lw_session_transport *transport) {
    struct lw_ws_transport *link = link_of(transport);
    LW_INVARIANT(!link->closing); /* a session closes its link once */
    link->closing = true;
    if (link->lost || link->in_event) return;
    lws_set_timeout(link->wsi, PENDING_TIMEOUT_USER_OK, LWS_TO_KILL_SYNC);
}

static void waiting(const struct lw_session_transport *transport, size_t *out_ours, size_t *out_socket) {
    const struct lw_ws_transport *link = (const struct lw_ws_transport *)transport;
    *out_ours = link->waiting;
    *out_socket = link->lost ? 0 : lw_tcp_transport_socket_waiting(lws_get_socket_fd(link->wsi));
}

/* Bytes that the socket got and that were no message: libwebsockets answers pings by itself, and reports
 * neither them nor headers. Unread bytes may be a message. */
static size_t overhead(struct lw_session_transport *transport) {
    struct lw_ws_transport *link = link_of(transport);
    if (link->lost) return 0;
    const uint64_t came = lw_tcp_transport_came(lws_get_socket_fd(link->wsi));
    if (came == link->came_last) return 0;
    link->came_last = came;
    const uint64_t known = link->received + link->overhead +
                           lw_tcp_transport_unread(lws_get_socket_fd(link->wsi)),
                   more = came > known ? came - known : 0;
    link->overhead += more;
    return more;
}

static const struct lw_session_transport_ops ops = {write_blobs, read_on, push,    end_writing,
                                                    close_link,  waiting, overhead};

/* ---- events ---- */

struct lw_ws_transport *lw_ws_transport_open(struct lw_ws_transport_shared *shared, struct lws *wsi) {
    struct lw_ws_transport *link = calloc(1, sizeof *link);
    if (!link) return NULL;
    *link = (struct lw_ws_transport){.transport = {&ops}, .wsi = wsi, .shared = shared, .in_event = true};
    struct lw_session_peer peer = lw_tcp_transport_peer(lws_get_socket_fd(wsi));
    peer.is_web = true;
    lw_tcp_transport_set_options(lws_get_socket_fd(wsi));
    link->overhead = link->came_last = lw_tcp_transport_came(lws_get_socket_fd(wsi)); /* the request */
    link->session = lw_session_open(shared->sessions, &link->transport, &peer);
    link->in_event = false;
    if (link->session) return link;
    free(link);
    return NULL;
}

int lw_ws_transport_receive(struct lw_ws_transport *link, const void *bytes, size_t size) {
    LW_INVARIANT_DEAR(!link->in_event && !link->lost);
    if (link->closing) return -1;
    link->in_event = true;
    link->received += size;
    if (size) lw_session_handlers_receive(link->session, bytes, size);
    if (!lws_remaining_packet_payload(link->wsi))
        lw_session_count_other(link->session, LW_MESSAGE_RATES_FRAMES, 1);
    link->in_event = false;
    return link->closing ? -1 : 0;
}

/* As much as fits into one message; returns its bytes. */
static size_t fill(struct lw_ws_transport *link) {
    uint8_t *message = link->shared->message + LWS_PRE;
    size_t size = 0;
    while (link->first < link->blob_count && size < LW_WS_TRANSPORT_MESSAGE) {
        struct lw_blob *blob = link->blob[link->first];
        const size_t left = blob->size - link->written, room = LW_WS_TRANSPORT_MESSAGE - size,
                     piece = left < room ? left : room;
        memcpy(message + size, blob->bytes + link->written, piece);
        size += piece;
        link->written += piece;
        if (link->written < blob->size) break;
        link->written = 0;
        link->first++;
        lw_blob_unref(blob);
    }
    LW_INVARIANT(size <= link->waiting && size <= LW_WS_TRANSPORT_MESSAGE);
    link->waiting -= size;
    return size;
}

static int write_next(struct lw_ws_transport *link) {
    const size_t size = fill(link);
    if (size && lws_write(link->wsi, link->shared->message + LWS_PRE, size, LWS_WRITE_BINARY) < 0) return -1;
    link->was_full |= lws_partial_buffered(link->wsi);
    if (link->first < link->blob_count) {
        lws_callback_on_writable(link->wsi);
    } else if (size) {
        lw_session_written(link->session, 0, link->was_full);
        link->was_full = false;
    }
    return 0;
}

int lw_ws_transport_writeable(struct lw_ws_transport *link) {
    LW_INVARIANT_DEAR(!link->in_event && !link->lost);
    if (link->closing) return -1;
    link->in_event = true;
    const int result = write_next(link);
    link->in_event = false;
    return result < 0 || link->closing ? -1 : 0;
}

void lw_ws_transport_lost(struct lw_ws_transport *link) {
    link->lost = true;
    lw_session_lost(link->session, UV_EOF);
}

void lw_ws_transport_destroy(struct lw_ws_transport *link) {
    if (!link) return;
    if (!link->lost) lw_ws_transport_lost(link);
    LW_INVARIANT(link->first <= link->blob_count && !link->in_event);
    for (uint32_t i = link->first; i < link->blob_count; i++) lw_blob_unref(link->blob[i]);
    lw_session_closed(link->session);
    free(link);
}
