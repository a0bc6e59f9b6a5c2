/* server_limits.h: what a server allows its sessions. docs/access.md tells users; test_limits compares
 * its table with these, and with those of message_rates.h, web_server.h and others. */
#ifndef LW_SERVE_ADMISSION_SERVER_LIMITS_H
#define LW_SERVE_ADMISSION_SERVER_LIMITS_H

#define LW_SERVER_SESSIONS_MAX 10000u
/* With tokens one place in 20 is kept for those for control. While the others are taken, there is less time
 * to say HELLO. */
#define LW_SERVER_KEPT_ONE_IN     20u
#define LW_SERVER_CROWDED_HELLO_S 2u
/* Connections that got no place, and stay until the FULL has reached them: in all, and of one address.
 * Further ones are closed without a word. */
#define LW_SERVER_TURNED_AWAY_MAX         1024u
#define LW_SERVER_ADDRESS_TURNED_AWAY_MAX 32u
/* An address may connect as often as it has places, at least so often, and again within so long: */
#define LW_SERVER_CONNECTIONS_MIN      100u
#define LW_SERVER_CONNECTIONS_REFILL_S 20u
#define LW_SERVER_PARSE_MAX            (8u << 20) /* bytes of memory to read one message of a peer */

/* Limits of one peer in one turn of the loop, before others get theirs: */
#define LW_SERVER_TURN_READ        (16u << 10) /* bytes */
#define LW_SERVER_TURN_MESSAGES    256u
#define LW_SERVER_TURN_FRAMES_READ (2u << 10) /* bytes of a WebSocket, in which there may be 340 frames */
/* Connections of all peers that are accepted at a port in a turn. The rest wait for the next turn.
 * libwebsockets has no budget of time, so its handshakes are counted. */
#define LW_SERVER_TURN_CONNECTIONS       32u
#define LW_SERVER_TURN_HTTPS_CONNECTIONS 4u
/* Time that TLS handshakes of all peers take in a turn. The remaining ones go on in the next turn. */
#define LW_SERVER_HANDSHAKES_MS 2u
/* Bytes of a peer that the system keeps until they are read. By themselves they grow to megabytes. */
#define LW_SERVER_RECEIVE_SIZE (128u << 10)
#define LW_SERVER_ASIDE_MAX    (32u << 10) /* bytes of TLS itself that may wait for a peer that reads none */

/* A peer is refused, or closed, after so long: */
#define LW_SERVER_HELLO_TIMEOUT_S   10u /* without a HELLO */
#define LW_SERVER_PACKAGE_TIMEOUT_S 60u /* without a request for the package, unless it controls */
#define LW_SERVER_STALL_TIMEOUT_S   15u /* in which it takes no byte, though bytes wait */
/* Bytes and frames on their way from a peer that is refused: dropped at once, the rest by its rates. */
#define LW_SERVER_DROPPED_MAX        (64u << 10) /* bytes */
#define LW_SERVER_DROPPED_FRAMES_MAX 64u
#define LW_SERVER_LINGER_S           1u  /* from its refusal to the close, unless it was slow to read */
#define LW_SERVER_EXCESS_TIMEOUT_S   10u /* time with too many messages (message_rates.h) */
#define LW_SERVER_SILENCE_S          60u /* during which it says nothing; it is pinged after half of it */

/* Bytes that wait per session before tiles are held back. The newest state of a tile is chosen when there is
 * room, so a slow reader skips versions. */
#define LW_SERVER_QUEUE_MAX   (256u << 10)
#define LW_SESSION_FINE_MAX   1024u /* tiles of finer levels that a session may list; the rest are left out */
#define LW_SESSION_FINE_SHARE 64u   /* for the first of them other sessions leave ids */
#define LW_SERVER_ANSWERS_MAX 4096u /* to updates, that wait for a session to read them; more end it */
#define LW_SERVER_BURST_MS    100u  /* a session under a rate limit may have this much of it at once */

#define LW_SERVER_RELAY_MS   200u /* when clients come back to a server that is followed by another at once */
#define LW_SERVER_WINDOW_S   5u   /* over which delays are reported */
#define LW_SERVER_LOOKS_HZ   4u   /* looks at time limits and at what waits */
#define LW_SERVER_WAITING_MS 200u /* between two WAITING of a session that waits for the first light */

#endif
