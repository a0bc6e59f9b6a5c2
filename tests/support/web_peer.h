/* web_peer.h: the other end of HTTP and of a WebSocket, byte by byte, so that a test may misbehave as it
 * likes. */
#ifndef LW_TESTS_WEB_PEER_H
#define LW_TESTS_WEB_PEER_H

#include "tests/support/support.h"

#include <stdbool.h>
#include <stddef.h>

enum web_peer_opcode {
    WEB_PEER_MORE = 0, /* continues the message before */
    WEB_PEER_TEXT = 1,
    WEB_PEER_BINARY = 2,
    WEB_PEER_CLOSE = 8,
    WEB_PEER_PING = 9,
    WEB_PEER_PONG = 10
};

/** A function that is asked while bytes are waited for: true counts as the end of the connection. NULL, as at
 * first: none. */
void lw_web_peer_give_up(bool (*is_time)(void *context), void *context);

/** Connects to a port of 127.0.0.1, or ends the test. */
int lw_web_peer_dial(uint16_t port);

/** The same from an address of this machine, such as 127.0.0.2. */
int lw_web_peer_dial_from(const char *own, uint16_t port);

/** Sends all of a text; false: the peer has closed. */
bool lw_web_peer_put(int socket, const char *text);

/** Sends a text and reads until the other end closes, or an answer is whole by its Content-Length. The caller
 * frees. head: an answer has no body. *out_size may be NULL. */
char *lw_web_peer_ask(int socket, const char *request, bool head, size_t *out_size);

/** Sends the request for a WebSocket at a path with these further header lines ("" or "Name: value\r\n..."),
 * and returns the answer's status. Host and protocol are among the lines. */
unsigned lw_web_peer_upgrade(int socket, const char *path, const char *lines);

/** A session's usual one: at /ws, without Origin. Returns the socket. */
int lw_web_peer_open(uint16_t port);

/** Writes a frame. Masked, as a client must, with zeros. size_said: what its header says. */
bool lw_web_peer_write(int socket, bool fin, enum web_peer_opcode opcode, const void *bytes, size_t size,
                       uint64_t size_said);

/** Reads the next frame into memory of the caller. false: the connection is closed. */
struct lw_web_peer_frame {
    enum web_peer_opcode opcode;
    bool fin;
    uint8_t *bytes; /* the caller frees */
    size_t size;
};
bool lw_web_peer_read(int socket, struct lw_web_peer_frame *out_frame);

/** Whether the other end closes within a time. Messages until then are dropped. */
bool lw_web_peer_closes(int socket, unsigned limit_ms);

#endif
