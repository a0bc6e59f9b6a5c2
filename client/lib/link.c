#include "client/lib/link.h"

#include "client/lib/access.h"
#include "client/lib/tls_trust.h"
#include "common/base/clock.h"
#include "common/base/control_path.h"
#include "common/base/host_port.h"
#include "common/base/invariant.h"

#include <arpa/inet.h>
#include <errno.h>
#include <fcntl.h>
#include <netdb.h>
#include <netinet/in.h>
#include <netinet/tcp.h>
#include <poll.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/socket.h>
#include <sys/un.h>
#include <unistd.h>

#define INPUT_SIZE (256u << 10) /* bytes in one read */
#define SEALED_MORE                                                                                          \
    (2u * LW_TLS_STREAM_RECORD) /* TLS may have kept one record of the read before; one to ask into */
#define SECOND_NS 1000000000ull

/* Milliseconds until a deadline, rounded up so that waiting does not spin, and 0 once it has passed. */
static int milliseconds_until(uint64_t deadline_ns) {
    uint64_t now_ns = lw_clock_ns();
    if (now_ns >= deadline_ns) return 0;
    uint64_t ms = (deadline_ns - now_ns + 999999) / 1000000;
    return ms > 1000000 ? 1000000 : (int)ms;
}

/* Waits for a connection under way. Returns errno's value. */
static int finish_connect(int descriptor, uint64_t deadline_ns) {
    struct pollfd wait = {.fd = descriptor, .events = POLLOUT};
    int ready;
    do {
        ready = poll(&wait, 1, milliseconds_until(deadline_ns));
    } while (ready < 0 && errno == EINTR);
    if (ready < 0) return errno;
    if (ready == 0) return ETIMEDOUT;
    int result = 0;
    socklen_t size = sizeof result;
    return getsockopt(descriptor, SOL_SOCKET, SO_ERROR, &result, &size) == 0 ? result : errno;
}

/* Returns a connected, non-blocking socket, or -1 with errno. */
static int connect_to(const struct addrinfo *address, uint64_t deadline_ns) {
    int descriptor =
        socket(address->ai_family, address->ai_socktype | SOCK_NONBLOCK | SOCK_CLOEXEC, address->ai_protocol);
    if (descriptor < 0) return -1;
    int failure = connect(descriptor, address->ai_addr, address->ai_addrlen) == 0 ? 0 : errno;
    if (failure == EINPROGRESS) failure = finish_connect(descriptor, deadline_ns);
    if (failure) {
        close(descriptor);
        errno = failure;
        return -1;
    }
    int on = 1; /* these help, and cannot fail on a connected socket in a way that matters */
    (void)setsockopt(descriptor, IPPROTO_TCP, TCP_NODELAY, &on, sizeof on);
    (void)setsockopt(descriptor, SOL_SOCKET, SO_KEEPALIVE, &on, sizeof on);
    return descriptor;
}

static enum lw_status connect_failure(struct lw_error *err, const char *address, int failure) {
    switch (failure) {
    case ETIMEDOUT:
        return lw_status_fail(err, LW_TIMED_OUT, "%s does not answer", address);
    case ECONNREFUSED:
    case EHOSTUNREACH:
    case ENETUNREACH:
    case ENOENT: /* no such Unix socket */
        return lw_status_fail(err, LW_UNAVAILABLE, "cannot connect to %s: %s: is lightwelld running?",
                              address, strerror(failure));
    default:
        return lw_status_fail(err, LW_OS, "cannot connect to %s: %s", address, strerror(failure));
    }
}

/* Returns a connected, non-blocking socket, or -1 with errno. */
static int connect_to_path(const char *path, uint64_t deadline_ns) {
    struct sockaddr_un address = {.sun_family = AF_UNIX};
    if (strlen(path) >= sizeof address.sun_path) {
        errno = ENAMETOOLONG;
        return -1;
    }
    strcpy(address.sun_path, path);
    const struct addrinfo info = {.ai_family = AF_UNIX,
                                  .ai_socktype = SOCK_STREAM,
                                  .ai_addr = (struct sockaddr *)&address,
                                  .ai_addrlen = sizeof address};
    return connect_to(&info, deadline_ns);
}

static bool is_own_machine(const char *host) {
    struct in_addr v4;
    return strcmp(host, "localhost") == 0 || strcmp(host, "::1") == 0 ||
           (inet_pton(AF_INET, host, &v4) == 1 && ntohl(v4.s_addr) >> 24 == 127);
}

/* The Unix socket of the server at this port; -1: there is none that answers. */
static int connect_locally(uint16_t port, uint64_t deadline_ns) {
    char path[LW_CONTROL_PATH_SIZE];
    int descriptor = -1;
    for (unsigned i = 0; descriptor < 0 && lw_control_path_find(port, i, path); i++)
        descriptor = connect_to_path(path, deadline_ns);
    return descriptor;
}

static enum lw_status connect_by_name(struct lw_link *link, const char *host, uint16_t port,
                                      uint64_t deadline_ns, struct lw_error *err) {
    char service[8];
    snprintf(service, sizeof service, "%u", (unsigned)port);
    struct addrinfo hints = {.ai_socktype = SOCK_STREAM, .ai_flags = AI_NUMERICSERV}, *found;
    int result = getaddrinfo(host, service, &hints, &found);
    if (result != 0)
        return lw_status_fail(err, LW_NO_HOST, "cannot find %s: %s", link->address,
                              result == EAI_SYSTEM ? strerror(errno) : gai_strerror(result));
    for (const struct addrinfo *a = found; a && link->socket < 0; a = a->ai_next)
        link->socket = connect_to(a, deadline_ns);
    int failure = errno;
    freeaddrinfo(found);
    return link->socket < 0 ? connect_failure(err, link->address, failure) : LW_OK;
}

/* ---- TLS ---- */

/* Sends what TLS has made, as far as the socket takes it. Returns 0 or errno's value. */
static int send_sealed(struct lw_link *link) {
    struct lw_tls_output *sealed = &link->sealed;
    while (link->sealed_sent < sealed->size) {
        ssize_t sent = send(link->socket, sealed->bytes + link->sealed_sent, sealed->size - link->sealed_sent,
                            MSG_NOSIGNAL);
        if (sent < 0 && errno == EINTR) continue;
        if (sent < 0) return errno == EWOULDBLOCK ? EAGAIN : errno;
        link->sealed_sent += (size_t)sent;
        LW_INVARIANT(link->sealed_sent <= sealed->size);
    }
    sealed->size = link->sealed_sent = 0;
    return 0;
}

/* Opens the input that has come; all of it goes into link->input, whose first *size bytes are in use. */
static enum lw_status unseal(struct lw_link *link, size_t *size, struct lw_error *err) {
    for (size_t got = 1; got;) {
        enum lw_status status = lw_tls_stream_read(
            link->tls, link->input + *size, INPUT_SIZE + SEALED_MORE - *size, &got, &link->sealed, err);
        if (status != LW_OK) return status;
        LW_INVARIANT(got <= INPUT_SIZE + SEALED_MORE - *size);
        *size += got;
    }
    return LW_OK;
}

static enum lw_status read_sealed(struct lw_link *link, uint64_t deadline_ns, size_t *size,
                                  struct lw_error *cause) {
    struct pollfd wait = {.fd = link->socket, .events = POLLIN | (link->sealed.size ? POLLOUT : 0)};
    if (poll(&wait, 1, milliseconds_until(deadline_ns)) == 0)
        return lw_status_fail(cause, LW_TIMED_OUT, "it does not answer");
    const ssize_t got = recv(link->socket, link->sealed_input, INPUT_SIZE, 0);
    if (got < 0 && (errno == EAGAIN || errno == EWOULDBLOCK || errno == EINTR)) return LW_OK;
    if (got <= 0)
        return lw_status_fail(cause, LW_CLOSED, "it hung up: %s", got ? strerror(errno) : "without a word");
    if (link->first_byte < 0) link->first_byte = link->sealed_input[0];
    lw_tls_stream_lend(link->tls, link->sealed_input, (size_t)got);
    return unseal(link, size, cause);
}

/* What a server says right after is lent to the reader, as all that comes later. */
static enum lw_status shake_hands(struct lw_link *link, const struct lw_link_desc *desc, uint64_t deadline_ns,
                                  struct lw_error *err) {
    struct lw_error cause = {0};
    size_t size = 0;
    link->sealed_input = malloc(INPUT_SIZE);
    if (!link->sealed_input || lw_tls_stream_create(desc->tls, desc->host, &link->tls) != LW_OK)
        return lw_status_fail(err, LW_NO_MEMORY, "cannot connect to %s: out of memory", link->address);
    enum lw_status status = unseal(link, &size, &cause);
    while (status == LW_OK && !lw_tls_stream_is_ready(link->tls)) {
        const int failure = send_sealed(link);
        if (failure && failure != EAGAIN)
            status = lw_status_fail(&cause, LW_CLOSED, "%s", strerror(failure));
        else
            status = read_sealed(link, deadline_ns, &size, &cause);
    }
    const int failure = send_sealed(link); /* also what tells a server why it is not believed */
    if (status == LW_OK && failure && failure != EAGAIN)
        status = lw_status_fail(&cause, LW_CLOSED, "%s", strerror(failure));
    if (status != LW_OK) return lw_tls_trust_explain(err, link->address, &cause, link->first_byte);
    LW_INVARIANT(size <= INPUT_SIZE + SEALED_MORE);
    lw_message_reader_lend(&link->reader, link->input, size);
    link->bytes_received += size;
    return LW_OK;
}

enum lw_status lw_link_connect(struct lw_link *link, const struct lw_link_desc *desc, struct lw_error *err) {
    const uint64_t deadline_ns = lw_clock_ns() + desc->timeout_ms * 1000000ull;
    const bool is_path = strncmp(desc->host, LW_ACCESS_UNIX, strlen(LW_ACCESS_UNIX)) == 0;
    enum lw_status status = LW_OK;
    *link = (struct lw_link){.socket = -1, .first_byte = -1};
    if (is_path || desc->socket)
        snprintf(link->address, sizeof link->address, "%s", desc->host);
    else
        lw_host_port_format(link->address, sizeof link->address, desc->host, desc->port);
    if (desc->socket) link->socket = *desc->socket;
    if (is_path && !desc->socket) {
        link->socket = connect_to_path(desc->host + strlen(LW_ACCESS_UNIX), deadline_ns);
        if (link->socket < 0) return connect_failure(err, link->address, errno);
    }
    if (link->socket < 0 && desc->prefers_local && is_own_machine(desc->host))
        link->socket = connect_locally(desc->port, deadline_ns);
    const bool by_tls = link->socket < 0 && desc->tls;
    if (link->socket < 0) status = connect_by_name(link, desc->host, desc->port, deadline_ns, err);
    if (status != LW_OK) return status;
    link->input = malloc(INPUT_SIZE + (by_tls ? SEALED_MORE : 0));
    if (!link->input) {
        lw_link_finish(link);
        return lw_status_fail(err, LW_NO_MEMORY, "cannot connect to %s: out of memory", link->address);
    }
    link->reader.body_max = LW_FRAMING_BODY_MAX;
    if (by_tls && (status = shake_hands(link, desc, deadline_ns, err)) != LW_OK) {
        lw_link_finish(link);
        return status;
    }
    link->heard_ns = link->pinged_ns = link->looked_ns = lw_clock_ns();
    return LW_OK;
}

void lw_link_finish(struct lw_link *link) {
    if (link->socket >= 0) close(link->socket);
    lw_message_reader_clear(&link->reader);
    lw_tls_stream_destroy(link->tls);
    lw_tls_output_finish(&link->sealed);
    free(link->input);
    free(link->sealed_input);
    link->socket = -1;
    link->tls = NULL;
    link->sealed_sent = 0;
    link->input = link->sealed_input = NULL;
}

void lw_link_hang_up(struct lw_link *link) { (void)shutdown(link->socket, SHUT_RDWR); }

static enum lw_status closed(const struct lw_link *link, const char *why, struct lw_error *err) {
    return lw_status_fail(err, LW_CLOSED, "%s closed the connection: %s", link->address, why);
}

/* Bytes that go to TLS count as sent: it takes no less than all of them. */
static enum lw_status flush_by_tls(struct lw_link *link, struct lw_error *err) {
    int failure = send_sealed(link);
    if (!failure && link->outbox_size) {
        LW_INVARIANT(!link->sealed.size && !link->sealed_sent); /* records keep their order */
        if (lw_tls_stream_write(link->tls, link->outbox, link->outbox_size, &link->sealed) != LW_OK)
            return closed(link, "TLS failed", err);
        link->outbox_size = 0;
        failure = send_sealed(link);
    }
    return failure && failure != EAGAIN ? closed(link, strerror(failure), err) : LW_OK;
}

static enum lw_status flush(struct lw_link *link, struct lw_error *err) {
    if (link->tls) return flush_by_tls(link, err);
    while (link->outbox_size) {
        ssize_t sent = send(link->socket, link->outbox, link->outbox_size, MSG_NOSIGNAL);
        if (sent < 0 && errno == EINTR) continue;
        if (sent < 0 && (errno == EAGAIN || errno == EWOULDBLOCK)) return LW_OK;
        if (sent < 0) return closed(link, strerror(errno), err);
        LW_INVARIANT((size_t)sent <= link->outbox_size);
        link->outbox_size -= (size_t)sent;
        memmove(link->outbox, link->outbox + sent, link->outbox_size);
    }
    return LW_OK;
}

enum lw_status lw_link_fits(struct lw_link *link, const struct lw_message *message, bool *out_fits,
                            struct lw_error *err) {
    enum lw_status status = flush(link, err);
    LW_INVARIANT(link->outbox_size <= sizeof link->outbox);
    if (status == LW_OK) *out_fits = lw_message_size(message) <= sizeof link->outbox - link->outbox_size;
    return status;
}

enum lw_status lw_link_send(struct lw_link *link, const struct lw_message *message, struct lw_error *err) {
    size_t size;
    bool fits = false;
    enum lw_status status = lw_link_fits(link, message, &fits, err);
    if (status != LW_OK || !fits) return status;
    status = lw_message_encode(message, link->outbox + link->outbox_size,
                               sizeof link->outbox - link->outbox_size, &size);
    if (status != LW_OK)
        return lw_status_fail(err, status, "cannot write message %s: %s",
                              lw_message_name((uint16_t)message->type), lw_status_text(status));
    link->outbox_size += size;
    LW_INVARIANT(link->outbox_size <= sizeof link->outbox);
    return flush(link, err);
}

/* Pings when due; gives up on a server that says nothing although somebody listens. */
static enum lw_status check_silence(struct lw_link *link, uint64_t now_ns, struct lw_error *err) {
    /* silence counts only while we look: after a pause of our own the count begins again */
    LW_INVARIANT(now_ns >= link->looked_ns && now_ns >= link->heard_ns && now_ns >= link->pinged_ns);
    if (now_ns - link->looked_ns > LW_LINK_PING_S * SECOND_NS) link->heard_ns = now_ns;
    link->looked_ns = now_ns;
    if (now_ns - link->heard_ns > LW_LINK_SILENCE_S * SECOND_NS)
        return lw_status_fail(err, LW_TIMED_OUT, "%s has been silent for %u s", link->address,
                              LW_LINK_SILENCE_S);
    if (now_ns - link->pinged_ns < LW_LINK_PING_S * SECOND_NS) return LW_OK;
    link->pinged_ns = now_ns;
    struct lw_message ping = {.type = LW_MESSAGE_PING, .ping.token = now_ns};
    return lw_link_send(link, &ping, err);
}

enum lw_status lw_link_wait(struct lw_link *link, uint64_t deadline_ns, struct lw_error *err) {
    for (;;) {
        uint64_t now_ns = lw_clock_ns(), ping_ns = link->pinged_ns + LW_LINK_PING_S * SECOND_NS;
        struct pollfd wait = {.fd = link->socket, .events = POLLIN};
        if (link->outbox_size || link->sealed.size) wait.events |= POLLOUT;
        int ready = poll(&wait, 1, milliseconds_until(deadline_ns < ping_ns ? deadline_ns : ping_ns));
        if (ready < 0 && errno != EINTR)
            return lw_status_fail(err, LW_OS, "%s: cannot wait: %s", link->address, strerror(errno));
        if (ready > 0 && wait.revents & ~POLLOUT) return LW_OK; /* also for errors: reading tells which */
        if (ready > 0) {
            enum lw_status status = flush(link, err);
            if (status != LW_OK) return status;
        }
        now_ns = lw_clock_ns();
        enum lw_status status = check_silence(link, now_ns, err);
        if (status != LW_OK || now_ns >= deadline_ns) return status;
    }
}

static enum lw_status receive_by_tls(struct lw_link *link, size_t sealed_size, size_t *out_size,
                                     struct lw_error *err) {
    struct lw_error cause = {0};
    lw_tls_stream_lend(link->tls, link->sealed_input, sealed_size);
    const enum lw_status status = unseal(link, out_size, &cause);
    lw_message_reader_lend(&link->reader, link->input, *out_size);
    if (status == LW_CLOSED) return closed(link, "it ended the session", err);
    if (status != LW_OK) return lw_status_fail(err, status, "%s: TLS: %s", link->address, cause.text);
    return flush(link, err); /* answers of TLS itself */
}

enum lw_status lw_link_receive(struct lw_link *link, size_t *out_size, struct lw_error *err) {
    *out_size = 0;
    if (lw_message_reader_keep(&link->reader) != LW_OK)
        return lw_status_fail(err, LW_NO_MEMORY, "%s: out of memory for a message", link->address);
    ssize_t size;
    do {
        size = recv(link->socket, link->tls ? link->sealed_input : link->input, INPUT_SIZE, 0);
    } while (size < 0 && errno == EINTR);
    if (size < 0 && (errno == EAGAIN || errno == EWOULDBLOCK)) return LW_OK;
    if (size < 0) return closed(link, strerror(errno), err);
    if (size == 0) return closed(link, "it ended the session", err);
    link->bytes_received += (uint64_t)size;
    link->heard_ns = link->looked_ns = lw_clock_ns();
    if (link->tls) return receive_by_tls(link, (size_t)size, out_size, err);
    lw_message_reader_lend(&link->reader, link->input, (size_t)size);
    *out_size = (size_t)size;
    return LW_OK;
}

enum lw_status lw_link_take(struct lw_link *link, struct lw_framing_header *out_header,
                            const uint8_t **out_body, struct lw_error *err) {
    return lw_message_reader_take(&link->reader, out_header, out_body, err);
}
