#include "server/serve/tcp_transport.h"

#include "server/serve/control_socket.h"

#include <assert.h>
#if defined(__linux__)
#include <linux/sockios.h>
#endif
#include <netinet/in.h>
#include <netinet/tcp.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/ioctl.h>

#define KEEPALIVE_S   30
#define NOTSENT_LOWAT (128 << 10) /* bytes; what the kernel holds cannot be replaced by a newer version */

/* A write that libuv has not finished: it holds the blobs meanwhile. */
struct pending_write {
    uv_write_t request;
    uint32_t blob_count;
    struct lw_blob *blob[];
};

struct link {
    struct lw_session_transport transport;
    union {
        uv_stream_t stream;
        uv_tcp_t tcp;
        uv_pipe_t pipe; /* on a Unix socket */
    } on;
    uv_shutdown_t shutdown;
    struct lw_session *session; /* NULL: it never got one */
    struct lw_tcp_transport_shared *shared;
    struct pending_write *pending;
    uint64_t turn; /* of the loop, in which it was last read */
};

/* ---- writing ---- */

static struct link *link_of(struct lw_session_transport *transport) { return (struct link *)transport; }

static void unref_all(struct lw_blob *const *blob, uint32_t blob_count) {
    for (uint32_t i = 0; i < blob_count; i++) lw_blob_unref(blob[i]);
}

static void on_written(uv_write_t *request, int result) {
    struct link *link = request->data;
    struct pending_write *pending = link->pending;
    link->pending = NULL;
    unref_all(pending->blob, pending->blob_count);
    free(pending);
    lw_session_written(link->session, result, true);
}

/* Leaves the rest, from byte `written` on, to libuv. Takes over the references.
 * Returns 0 or libuv's error. */
static int queue_rest(struct link *link, struct lw_blob *const *blob, uv_buf_t *buffer, uint32_t count,
                      size_t written) {
    uint32_t first = 0;
    for (; written >= buffer[first].len; first++) {
        written -= buffer[first].len;
        lw_blob_unref(blob[first]);
    }
    buffer[first].base += written;
    buffer[first].len -= written;
    const uint32_t left = count - first;
    struct pending_write *pending = malloc(sizeof *pending + left * sizeof(struct lw_blob *));
    int result = UV_ENOMEM;
    if (pending) {
        pending->request.data = link;
        pending->blob_count = left;
        memcpy(pending->blob, blob + first, left * sizeof(struct lw_blob *));
        result = uv_write(&pending->request, &link->on.stream, buffer + first, left, on_written);
    }
    if (result == 0) {
        link->pending = pending;
    } else {
        free(pending);
        unref_all(blob + first, left);
    }
    return result;
}

static int write_blobs(struct lw_session_transport *transport, struct lw_blob *const *blob, uint32_t count) {
    struct link *link = link_of(transport);
    uv_buf_t buffer[LW_SESSION_TRANSPORT_BLOBS] = {{0}};
    size_t bytes = 0;
    assert(count <= LW_SESSION_TRANSPORT_BLOBS && !link->pending);
    if (!count) return 0;
    for (uint32_t i = 0; i < count; i++) {
        buffer[i] = uv_buf_init((char *)blob[i]->bytes, (unsigned)blob[i]->size);
        bytes += blob[i]->size;
    }
    int result = uv_try_write(&link->on.stream, buffer, count);
    if (result < 0 && result != UV_EAGAIN) {
        unref_all(blob, count);
        return result;
    }
    const int written = result < 0 ? 0 : result;
    if ((size_t)written == bytes) {
        unref_all(blob, count);
        return written;
    }
    result = queue_rest(link, blob, buffer, count, (size_t)written);
    return result < 0 ? result : written;
}

static void on_shutdown(uv_shutdown_t *request, int result) {
    (void)request;
    (void)result;
}

static int end_writing(struct lw_session_transport *transport, enum lw_refusal code, const char *text) {
    struct link *link = link_of(transport);
    (void)code; /* the REFUSAL has said so */
    (void)text;
    return uv_shutdown(&link->shutdown, &link->on.stream, on_shutdown);
}

static void waiting(const struct lw_session_transport *transport, size_t *out_ours, size_t *out_socket) {
    const struct link *link = (const struct link *)transport;
    uv_os_fd_t descriptor;
    *out_ours = uv_stream_get_write_queue_size(&link->on.stream);
    *out_socket = uv_fileno((const uv_handle_t *)&link->on.stream, &descriptor) == 0
                      ? lw_tcp_transport_socket_waiting(descriptor)
                      : 0;
}

/* ---- reading ---- */

/* libuv would read 32 times in a row from whoever sends without end. Without a buffer it stops, and tells
 * on_read UV_ENOBUFS; the rest is still there in the next turn. */
static void on_alloc(uv_handle_t *handle, size_t suggested, uv_buf_t *out_buffer) {
    struct link *link = handle->data;
    const bool had_turn = link->turn == link->shared->turn;
    (void)suggested;
    link->turn = link->shared->turn;
    *out_buffer =
        uv_buf_init((char *)link->shared->read_buffer, had_turn ? 0 : sizeof link->shared->read_buffer);
}

static void on_read(uv_stream_t *stream, ssize_t size, const uv_buf_t *buffer) {
    struct link *link = stream->data;
    if (size < 0 && size != UV_ENOBUFS)
        lw_session_lost(link->session, (int)size);
    else if (size > 0)
        lw_session_receive(link->session, (const uint8_t *)buffer->base, (size_t)size);
}

static void read_on(struct lw_session_transport *transport, bool on) {
    uv_stream_t *stream = &link_of(transport)->on.stream;
    if (on)
        (void)uv_read_start(stream, on_alloc, on_read); /* fails for what is closing alone */
    else
        uv_read_stop(stream);
}

/* ---- beginning and end ---- */

static void on_closed(uv_handle_t *handle) {
    struct link *link = handle->data;
    assert(!link->pending); /* libuv cancels writes before it calls back */
    if (link->session) lw_session_closed(link->session);
    free(link);
}

static void close_link(struct lw_session_transport *transport) {
    uv_close((uv_handle_t *)&link_of(transport)->on.stream, on_closed);
}

static const struct lw_session_transport_ops ops = {write_blobs, read_on, end_writing, close_link, waiting};

static int init_stream(struct link *link, uv_stream_t *listener) {
    if (listener->type == UV_NAMED_PIPE) return uv_pipe_init(listener->loop, &link->on.pipe, 0);
    return uv_tcp_init(listener->loop, &link->on.tcp);
}

/* On a Unix socket nobody is served but the server's user and root. */
static void open_session(struct link *link, int descriptor) {
    const bool is_local = link->on.stream.type == UV_NAMED_PIPE;
    const struct lw_session_peer peer =
        is_local ? lw_control_socket_peer(descriptor) : lw_tcp_transport_peer(descriptor);
    if (!is_local) lw_tcp_transport_set_options(descriptor);
    link->session = lw_session_open(link->shared->sessions, &link->transport, &peer);
    if (link->session && is_local && !peer.may_control)
        lw_session_refuse(link->session, LW_REFUSAL_NOT_ALLOWED,
                          "this socket is for the server's own user and root alone");
}

enum lw_status lw_tcp_transport_accept(struct lw_tcp_transport_shared *shared, uv_stream_t *listener) {
    struct link *link = calloc(1, sizeof *link);
    if (!link) return LW_NO_MEMORY;
    *link = (struct link){.transport = {&ops}, .shared = shared, .turn = UINT64_MAX};
    if (init_stream(link, listener) < 0) {
        free(link);
        return LW_OS;
    }
    link->on.stream.data = link;
    uv_os_fd_t descriptor;
    if (uv_accept(listener, &link->on.stream) == 0 &&
        uv_fileno((const uv_handle_t *)&link->on.stream, &descriptor) == 0)
        open_session(link, descriptor);
    if (!link->session) {
        close_link(&link->transport);
        return LW_OS;
    }
    read_on(&link->transport, true);
    return LW_OK;
}

/* ---- sockets ---- */

struct lw_session_peer lw_tcp_transport_peer(int socket) {
    struct sockaddr_storage address = {0};
    socklen_t length = sizeof address;
    struct lw_session_peer peer = {.address = "?"};
    char host[48] = "?";
    if (getpeername(socket, (struct sockaddr *)&address, &length) != 0) return peer;
    peer.at = lw_address_of((const struct sockaddr *)&address);
    if (address.ss_family == AF_INET6) {
        const struct sockaddr_in6 *v6 = (const struct sockaddr_in6 *)&address;
        uv_ip6_name(v6, host, sizeof host);
        snprintf(peer.address, sizeof peer.address, "[%s]:%u", host, ntohs(v6->sin6_port));
    } else if (address.ss_family == AF_INET) {
        const struct sockaddr_in *v4 = (const struct sockaddr_in *)&address;
        uv_ip4_name(v4, host, sizeof host);
        snprintf(peer.address, sizeof peer.address, "%s:%u", host, ntohs(v4->sin_port));
    }
    return peer;
}

void lw_tcp_transport_set_options(int socket) {
    const int on = 1, idle_s = KEEPALIVE_S, low_water = NOTSENT_LOWAT;
    /* none of these can fail on a connected socket in a way that matters */
    (void)setsockopt(socket, IPPROTO_TCP, TCP_NODELAY, &on, sizeof on);
    (void)setsockopt(socket, SOL_SOCKET, SO_KEEPALIVE, &on, sizeof on);
    (void)setsockopt(socket, IPPROTO_TCP, TCP_KEEPIDLE, &idle_s, sizeof idle_s);
    (void)setsockopt(socket, IPPROTO_TCP, TCP_NOTSENT_LOWAT, &low_water, sizeof low_water);
}

size_t lw_tcp_transport_socket_waiting(int socket) {
#ifdef SIOCOUTQ
    int bytes;
    if (ioctl(socket, SIOCOUTQ, &bytes) == 0 && bytes > 0) return (size_t)bytes;
#else
    (void)socket;
#endif
    return 0;
}
