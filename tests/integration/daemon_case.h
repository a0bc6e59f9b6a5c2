/* daemon_case.h: a daemon of a test, what it prints, and its clients. */
#ifndef LW_TESTS_DAEMON_CASE_H
#define LW_TESTS_DAEMON_CASE_H

#include "tests/support/process.h"

#include "client/lib/client.h"

#define VIEWERS_MAX 40
#define LIMIT_S     LW_PROCESS_LIMIT_S

/* All of the scene, with or without clients: what --light seen does is test_seen's. */
#define CORNELL "builtin:cornell --texels-per-metre 8 --clock step --json --light whole "
/* converges after a few dozen frames; then some more show soon that it has */
#define CONVERGES   CORNELL "--error 0.3 --frame-rate 300 "
#define NEVER_RESTS CORNELL "--error 1e-6 " /* hundreds of frames a second, for ever */

/* The clients of a test, of one daemon or of several in turn. What they have
 * received outlives their daemon. */
extern struct daemon_case_viewers {
    struct lw_client *client[VIEWERS_MAX];
    bool closed[VIEWERS_MAX];
    unsigned count;
} daemon_case_viewers;

/** Adds a client; a name and a time limit are its own. */
struct lw_client *daemon_case_join_at(const char *host, const struct lw_process *daemon);
struct lw_client *daemon_case_join(const struct lw_process *daemon);

struct lw_client_stats daemon_case_stats_of(const struct lw_client *client);

/** Takes in messages for all clients, waiting a little for them. Returns how many
 * clients still have their link. */
unsigned daemon_case_poll_all(void);

/** Every tile is there, with all bounces. */
bool daemon_case_is_complete(const struct lw_client *client);

/** When a wait that begins now must end. */
uint64_t daemon_case_limit_ns(void);

/** Polls until that is so. */
void daemon_case_wait_complete(const struct lw_client *client);

/** A teardown: ends all clients and all programs. */
int daemon_case_end_all(void **state);

/** The clients listen meanwhile: the daemon gives those who do not a second to take its goodbye. */
void daemon_case_stop(struct lw_process *daemon);

/* What a client says first; it offers all features. */
extern const uint8_t daemon_case_hello[22], daemon_case_package_request[8];
enum { REFUSAL = 3, PACKAGE_CHUNK = 5, TILE = 8 };

/** A socket to the daemon; bytes to it. */
int daemon_case_connect_raw(const struct lw_process *daemon);
void daemon_case_say(int peer, const uint8_t *bytes, size_t size);

/** Says what a client says first. */
int daemon_case_connect_stranger(const struct lw_process *daemon);

#endif
