#include "server/serve/transports/tcp_transport.h"

#include "common/base/clock.h"
#include "common/base/host_port.h"
#include "common/base/invariant.h"
#include "server/serve/sessions/session_handlers.h"
#include "server/serve/transports/control_socket.h"

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
#define PUSHED_MAX    (NOTSENT_LOWAT + (int)LW_SERVER_QUEUE_MAX)

/* A write that libuv has not finished: it holds the blobs meanwhile. */
struct pending_write {
    uv_write_t request;
    uint32_t blob_count;
    struct lw_blob *blob[];
};

/* The same of TLS, whose bytes are of this link alone. */
struct tls_write {
    uv_write_t request;
    bool of_session; /* which waits for it */
    uint8_t bytes[];
};

enum tls {
    TLS_NONE,    /* a Unix socket, or a server without a certificate */
    TLS_EXPECTS, /* nothing has come */
    TLS_SHAKES_HANDS,
    TLS_READY,
    TLS_FAILED /* nothing can be said any more */
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
    uint64_t turn; /* the loop's turn in which it was last read */
    bool is_new;   /* nothing has come */
    enum tls tls;
    struct lw_tls_stream *stream;
    struct lw_blob *held; /* what the session said before TLS was ready */
    uint64_t overhead;    /* bytes of TLS that were no messages, counted so far; */
    uint64_t sealed;      /* bytes but those of messages so far; half a record counts as a message's */
};

/* ---- writing ---- */

static struct link *link_of(struct lw_session_transport *transport) { return (struct link *)transport; }

static void unref_all(struct lw_blob *const *blob, uint32_t blob_count) {
    for (uint32_t i = 0; i < blob_count; i++) lw_blob_unref(blob[i]);
}

static void on_written(uv_write_t *request, int result) {
    struct link *link = request->data;
    struct pending_write *pending = link->pending;
    LW_INVARIANT(request == &pending->request); /* one write at a time */
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
    LW_INVARIANT(first < count && !link->pending);
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

/* ---- writing by TLS ---- */

static void on_tls_written(uv_write_t *request, int result) {
    struct tls_write *write = request->data;
    struct link *link = request->handle->data;
    const bool of_session = write->of_session;
    free(write);
    if (of_session) lw_session_written(link->session, result, true);
}

/* Bytes that the link takes at once. An error is met again by who sends the rest. */
static size_t take_output(void *context, const void *bytes, size_t size) {
    struct link *link = context;
    const uv_buf_t buffer = uv_buf_init((char *)bytes, (unsigned)size);
    const int taken = uv_try_write(&link->on.stream, &buffer, 1);
    return taken > 0 ? (size_t)taken : 0;
}

/* The shared output is this link's until the next call. */
static struct lw_tls_output *output_of(struct link *link) {
    struct lw_tls_output *output = &link->shared->output;
    output->take = take_output;
    output->link = link;
    output->size = output->taken = 0;
    output->is_full = false;
    return output;
}

/* Sends what the link has not taken yet of what TLS has made. of_session: lw_session_written() follows when
 * the link has taken the rest. Returns how many bytes the link took at once, or libuv's error. */
static int send_output(struct link *link, bool of_session) {
    struct lw_tls_output *output = &link->shared->output;
    const size_t size = output->size;
    output->size = 0; /* its bytes stay */
    if (!size) return 0;
    uv_buf_t buffer = uv_buf_init((char *)output->bytes, (unsigned)size);
    int result = uv_try_write(&link->on.stream, &buffer, 1);
    if (result < 0 && result != UV_EAGAIN) return result;
    const size_t sent = result < 0 ? 0 : (size_t)result;
    LW_INVARIANT(sent <= size);
    if (sent == size) return (int)size;
    struct tls_write *write = malloc(sizeof *write + size - sent);
    if (!write) return UV_ENOMEM;
    write->of_session = of_session;
    write->request.data = write;
    memcpy(write->bytes, output->bytes + sent, size - sent);
    buffer = uv_buf_init((char *)write->bytes, (unsigned)(size - sent));
    result = uv_write(&write->request, &link->on.stream, &buffer, 1, on_tls_written);
    if (result < 0) free(write);
    return result < 0 ? result : (int)sent;
}

/* Tiles are small: several go into a record. */
static enum lw_status encrypt(struct link *link, struct lw_blob *const *blob, uint32_t count) {
    struct lw_tcp_transport_shared *shared = link->shared;
    enum lw_status status = LW_OK;
    size_t filled = 0;
    for (uint32_t i = 0; i < count && status == LW_OK; i++) {
        const uint8_t *bytes = blob[i]->bytes;
        for (size_t left = blob[i]->size; left && status == LW_OK;) {
            const size_t room = sizeof shared->record - filled, size = left < room ? left : room;
            LW_INVARIANT(filled < sizeof shared->record);
            if (size == sizeof shared->record) {
                status = lw_tls_stream_write(link->stream, bytes, size, &shared->output);
            } else {
                memcpy(shared->record + filled, bytes, size);
                filled += size;
                if (filled == sizeof shared->record) {
                    status = lw_tls_stream_write(link->stream, shared->record, filled, &shared->output);
                    filled = 0;
                }
            }
            bytes += size;
            left -= size;
        }
    }
    return status == LW_OK ? lw_tls_stream_write(link->stream, shared->record, filled, &shared->output)
                           : status;
}

/* As write_blobs(). Returns what the link took of the records, in bytes of the blobs. */
static int write_by_tls(struct link *link, struct lw_blob *const *blob, uint32_t count, size_t bytes) {
    const struct lw_tls_output *output = output_of(link);
    const enum lw_status status = encrypt(link, blob, count);
    unref_all(blob, count);
    if (status != LW_OK) return status == LW_NO_MEMORY ? UV_ENOMEM : UV_EPROTO;
    const size_t size = output->taken + output->size;
    const int result = send_output(link, true);
    if (result < 0) return result;
    const size_t sent = output->taken + (size_t)result;
    LW_INVARIANT(sent <= size);
    if (sent == size) return (int)bytes;
    const size_t share = (size_t)((double)bytes * (double)sent / (double)size);
    return (int)(share < bytes ? share : bytes - 1); /* not all: the rest is waited for */
}

/* Before the handshake is done a session says one thing: that it is refused. */
static int hold_refusal(struct link *link, struct lw_blob *const *blob, uint32_t count) {
    LW_INVARIANT(count == 1 && !link->held);
    (void)count;
    link->held = blob[0];
    return 0;
}

static int write_blobs(struct lw_session_transport *transport, struct lw_blob *const *blob, uint32_t count) {
    struct link *link = link_of(transport);
    uv_buf_t buffer[LW_SESSION_TRANSPORT_BLOBS] = {{0}};
    size_t bytes = 0;
    LW_INVARIANT(count <= LW_SESSION_TRANSPORT_BLOBS && !link->pending);
    if (!count) return 0;
    for (uint32_t i = 0; i < count; i++) {
        buffer[i] = uv_buf_init((char *)blob[i]->bytes, (unsigned)blob[i]->size);
        bytes += blob[i]->size;
    }
    if (link->tls == TLS_READY) return write_by_tls(link, blob, count, bytes);
    if (link->tls == TLS_EXPECTS || link->tls == TLS_SHAKES_HANDS) return hold_refusal(link, blob, count);
    if (link->tls == TLS_FAILED) {
        unref_all(blob, count);
        return (int)bytes;
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

static void push(struct lw_session_transport *transport) {
    uv_os_fd_t descriptor;
    if (uv_fileno((const uv_handle_t *)&link_of(transport)->on.stream, &descriptor) == 0)
        lw_tcp_transport_push(descriptor);
}

static void on_shutdown(uv_shutdown_t *request, int result) {
    (void)request;
    (void)result;
}

static int end_writing(struct lw_session_transport *transport, enum lw_refusal code, const char *text) {
    struct link *link = link_of(transport);
    (void)code; /* the REFUSAL has said so */
    (void)text;
    if (link->stream) {
        lw_tls_stream_end(link->stream, output_of(link));
        (void)send_output(link, false); /* if that fails so does the next */
    }
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

/* Sends the held message. */
static void send_held(struct link *link) {
    struct lw_blob *blob = link->held;
    LW_INVARIANT(link->tls != TLS_EXPECTS && link->tls != TLS_SHAKES_HANDS); /* else it is held again */
    link->held = NULL;
    if (!blob) return;
    const size_t size = blob->size;
    const int written = write_blobs(&link->transport, &blob, 1);
    if (written < 0 || (size_t)written == size)
        lw_session_written(link->session, written < 0 ? written : 0, false);
}

/* The first bytes are no TLS. A message of ours in plain is answered so: its sender can read that. */
static void refuse_plain(struct link *link) {
    link->tls = TLS_NONE;
    lw_tls_stream_destroy(link->stream);
    link->stream = NULL;
    send_held(link);
    lw_session_refuse(link->session, LW_REFUSAL_PROTOCOL, "this server speaks TLS alone: connect with --tls");
}

static void fail_tls(struct link *link, enum lw_status status, const char *why) {
    if (status == LW_CLOSED) {
        lw_session_lost(link->session, UV_EOF);
        return;
    }
    link->tls = TLS_FAILED;
    send_held(link);
    lw_session_refuse(link->session, LW_REFUSAL_PROTOCOL, "TLS: %s", why);
}

static void count_overhead(struct link *link) {
    if (link->sealed <= link->overhead) return;
    const size_t more = (size_t)(link->sealed - link->overhead);
    link->overhead = link->sealed;
    lw_session_count_other(link->session, LW_MESSAGE_RATES_OVERHEAD, more);
}

/* Decrypts what came, and hands it on. A session that is refused or closed meanwhile gets nothing more. */
static void receive_by_tls(struct link *link, const uint8_t *bytes, size_t size) {
    struct lw_tcp_transport_shared *shared = link->shared;
    const bool shakes_hands = link->tls == TLS_SHAKES_HANDS;
    const uint64_t began_ns = shakes_hands ? lw_clock_ns() : 0;
    struct lw_error err = {0};
    enum lw_status status;
    size_t got;
    lw_tls_stream_lend(link->stream, bytes, size);
    link->sealed += size;
    do {
        got = 0;
        status = lw_tls_stream_read(link->stream, shared->record, sizeof shared->record, &got,
                                    output_of(link), &err);
        const bool sent = send_output(link, false) >= 0;
        if (!sent || uv_stream_get_write_queue_size(&link->on.stream) >
                         LW_SERVER_QUEUE_MAX * 2 + LW_SERVER_ASIDE_MAX) {
            lw_session_lost(link->session, UV_EPIPE);
            return;
        }
        LW_INVARIANT_DEAR(got <= link->sealed);
        link->sealed -= got;
        if (status == LW_OK && got) lw_session_handlers_receive(link->session, shared->record, got);
    } while (status == LW_OK && got && !uv_is_closing((uv_handle_t *)&link->on.stream));
    if (uv_is_closing((uv_handle_t *)&link->on.stream)) return;
    if (shakes_hands) shared->handshakes_ns += lw_clock_ns() - began_ns;
    if (status == LW_OK && shakes_hands && lw_tls_stream_is_ready(link->stream)) {
        link->tls = TLS_READY;
        send_held(link);
    }
    if (status != LW_OK)
        fail_tls(link, status, err.text);
    else
        count_overhead(link);
}

/* A record of a handshake, as 5.1 of RFC 8446 has it. As a message of ours it would be longer than any is. */
static bool is_tls(const uint8_t *bytes, size_t size) {
    return bytes[0] == 0x16 && (size < 2 || bytes[1] == 3) && (size < 3 || (bytes[2] && bytes[2] <= 4));
}

static void receive(struct link *link, const uint8_t *bytes, size_t size) {
    const bool is_first = link->is_new;
    link->is_new = false;
    if (is_first && link->tls == TLS_EXPECTS) {
        if (is_tls(bytes, size)) {
            link->tls = TLS_SHAKES_HANDS;
        } else {
            refuse_plain(link);
            return;
        }
    }
    if (link->tls == TLS_SHAKES_HANDS || link->tls == TLS_READY)
        receive_by_tls(link, bytes, size);
    else if (is_first && size > 2 && is_tls(bytes, size))
        lw_session_refuse(link->session, LW_REFUSAL_PROTOCOL,
                          "it speaks TLS, and this server has no certificate (--tls-certificate)");
    else if (link->tls == TLS_NONE)
        lw_session_handlers_receive(link->session, bytes, size);
}

/* Handshakes take the most of a turn of all that newcomers ask for. */
static bool is_over_budget(struct link *link) {
    struct lw_tcp_transport_shared *shared = link->shared;
    if (link->tls != TLS_EXPECTS && link->tls != TLS_SHAKES_HANDS) return false;
    if (shared->handshakes_turn != shared->turn) shared->handshakes_ns = 0;
    shared->handshakes_turn = shared->turn;
    return shared->handshakes_ns > LW_SERVER_HANDSHAKES_MS * 1000000ull;
}

/* libuv would read 32 times in a row from a peer that sends without end. Without a buffer it stops, and tells
 * on_read UV_ENOBUFS; the rest is still there in the next turn. */
static void on_alloc(uv_handle_t *handle, size_t suggested, uv_buf_t *out_buffer) {
    struct link *link = handle->data;
    const bool had_turn = link->turn == link->shared->turn || is_over_budget(link);
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
        receive(link, (const uint8_t *)buffer->base, (size_t)size);
}

static void read_on(struct lw_session_transport *transport, bool on) {
    uv_stream_t *stream = &link_of(transport)->on.stream;
    if (on)
        (void)uv_read_start(stream, on_alloc, on_read); /* fails for a closing stream alone */
    else
        uv_read_stop(stream);
}

/* ---- beginning and end ---- */

static void on_closed(uv_handle_t *handle) {
    struct link *link = handle->data;
    LW_INVARIANT(!link->pending); /* libuv cancels writes before it calls back */
    if (link->session) lw_session_closed(link->session);
    lw_blob_unref(link->held);
    lw_tls_stream_destroy(link->stream);
    free(link);
}

static void close_link(struct lw_session_transport *transport) {
    uv_close((uv_handle_t *)&link_of(transport)->on.stream, on_closed);
}

static const struct lw_session_transport_ops ops = {write_blobs, read_on, push, end_writing,
                                                    close_link,  waiting, NULL};

static int init_stream(struct link *link, uv_stream_t *listener) {
    if (listener->type == UV_NAMED_PIPE) return uv_pipe_init(listener->loop, &link->on.pipe, 0);
    return uv_tcp_init(listener->loop, &link->on.tcp);
}

/* On a Unix socket nobody is served but the server's user and root. */
static enum lw_status open_session(struct link *link, int descriptor) {
    struct lw_session_shared *sessions = link->shared->sessions;
    const bool is_local = link->on.stream.type == UV_NAMED_PIPE;
    struct lw_session_peer peer =
        is_local ? lw_control_socket_peer(descriptor) : lw_tcp_transport_peer(descriptor);
    if (!is_local) {
        lw_tcp_transport_set_options(descriptor);
        peer.is_too_many = !lw_session_may_connect(sessions, &peer.at);
        if (link->shared->tls) link->tls = TLS_EXPECTS;
    }
    if (link->tls == TLS_EXPECTS) {
        if (peer.is_too_many)
            return LW_UNAVAILABLE; /* a handshake to say so would cost more than it is worth */
        const enum lw_status status =
            lw_tls_stream_create(lw_tls_context_ssl(link->shared->tls), NULL, &link->stream);
        if (status != LW_OK) return status;
    }
    link->session = lw_session_open(sessions, &link->transport, &peer);
    if (!link->session) return LW_UNAVAILABLE;
    if (is_local && !peer.may_control)
        lw_session_refuse(link->session, LW_REFUSAL_NOT_ALLOWED,
                          "this socket is for the server's own user and root alone");
    return LW_OK;
}

enum lw_status lw_tcp_transport_accept(struct lw_tcp_transport_shared *shared, uv_stream_t *listener) {
    struct link *link = calloc(1, sizeof *link);
    if (!link) return LW_NO_MEMORY;
    *link = (struct link){.transport = {&ops}, .shared = shared, .turn = UINT64_MAX, .is_new = true};
    if (init_stream(link, listener) < 0) {
        free(link);
        return LW_OS;
    }
    link->on.stream.data = link;
    uv_os_fd_t descriptor;
    enum lw_status status = LW_OS;
    if (uv_accept(listener, &link->on.stream) == 0 &&
        uv_fileno((const uv_handle_t *)&link->on.stream, &descriptor) == 0)
        status = open_session(link, descriptor);
    if (status == LW_OK)
        read_on(&link->transport, true);
    else
        close_link(&link->transport);
    return status;
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
        lw_host_port_format(peer.address, sizeof peer.address, host, ntohs(v6->sin6_port));
    } else if (address.ss_family == AF_INET) {
        const struct sockaddr_in *v4 = (const struct sockaddr_in *)&address;
        uv_ip4_name(v4, host, sizeof host);
        lw_host_port_format(peer.address, sizeof peer.address, host, ntohs(v4->sin_port));
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

void lw_tcp_transport_push(int socket) {
    int size = 0, low_water = PUSHED_MAX;
    socklen_t length = sizeof size;
    (void)setsockopt(socket, IPPROTO_TCP, TCP_NOTSENT_LOWAT, &low_water, sizeof low_water);
    if (getsockopt(socket, SOL_SOCKET, SO_SNDBUF, &size, &length) != 0 || size >= 2 * PUSHED_MAX) return;
    size = PUSHED_MAX; /* the system counts twice that, for what it keeps beside the bytes */
    (void)setsockopt(socket, SOL_SOCKET, SO_SNDBUF, &size, sizeof size);
}

uint64_t lw_tcp_transport_came(int socket) {
#if defined(__linux__)
    struct { /* the C library's ends before what Linux 4.1 added */
        struct tcp_info begin;
        uint64_t pacing_rate, max_pacing_rate, bytes_acked, bytes_received;
    } info;
    _Static_assert(sizeof info == 136, "not that of linux/tcp.h");
    socklen_t length = sizeof info;
    if (getsockopt(socket, IPPROTO_TCP, TCP_INFO, &info, &length) == 0 && length == sizeof info)
        return info.bytes_received;
#else
    (void)socket;
#endif
    return 0;
}

size_t lw_tcp_transport_unread(int socket) {
    int bytes;
    return ioctl(socket, FIONREAD, &bytes) == 0 && bytes > 0 ? (size_t)bytes : 0;
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
