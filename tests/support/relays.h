/* relays.h: relays as a test runs them, and clients that are to see the same at each. */
#ifndef LW_TESTS_RELAYS_H
#define LW_TESTS_RELAYS_H

#include "tests/support/process.h"

#include "client/lib/client.h"

#define LW_RELAYS_CLIENTS 4
/* A scene that comes to rest: options of a lightwelld. */
#define LW_RELAYS_CORNELL                                                                                    \
    "builtin:cornell --texels-per-metre 8 --clock step --light whole --error 0.3 --frame-rate 200 --http "   \
    "none"

/** NULL: there is none. Functions that speak of a client take its index. */
extern struct lw_client *lw_relays_client[LW_RELAYS_CLIENTS];

/** Ends all clients, and all programs. */
void lw_relays_end(void);

/** Starts lightwell-relay on a free port, or on the one that the process had, and waits until it serves. */
void lw_relays_start(struct lw_process *process, const char *upstream, const char *options);

void lw_relays_join(int i, uint16_t port);
/** At 127.0.0.1, or at the description's host. */
void lw_relays_join_with(int i, uint16_t port, struct lw_client_desc desc);
/** Waits for the session's end, and for another one. */
void lw_relays_reconnect(int i);
/** Waits for the session's end, and until the server there has another scene. Ends the client. */
void lw_relays_await_other_scene(int i);
/** Ends the test if a session has ended. */
void lw_relays_poll(void);
struct lw_client_stats lw_relays_stats(int i);
/** Polls until it is so. Else the test ends with the name of the condition and the last figures that were
 * read. */
#define lw_relays_wait(is_so) lw_relays_wait_for(is_so, #is_so)
void lw_relays_wait_for(bool (*is_so)(void), const char *name);

/** The client has every tile of visible objects, converged, and the server has nothing left to send. */
bool lw_relays_is_at_rest(int i);
bool lw_relays_all_rest(void);
/** Waits until a daemon's light is converged, so that no frame of its own follows, and every client has it.
 * Client 0 is the daemon's own. The texels that clients see may be good enough some frames before. */
void lw_relays_rest(const struct lw_process *daemon);
/** Every client has every tile in the version of the first, and the same frame; a run that a relay has joined
 * to another counts as itself. */
bool lw_relays_all_same(void);
/** Ends the test unless it comes to that, and all see the same. */
void lw_relays_expect_same(void);
void lw_relays_expect_same_texels(void);
/** Waits until clients 0 and 1 have the same light, and directions in the same versions, of more than a few
 * tiles. Ends the test unless the texels of these are the same. */
void lw_relays_expect_same_directions(void);

/** Makes a change and waits for the answer; its frame. */
uint64_t lw_relays_update(int i, const struct lw_scene_change *change, struct lw_client_answer *out_answer);

/** What `lightwellctl tree` shows of a server; the caller frees it. */
char *lw_relays_show_tree(const struct lw_process *of);
/** Waits until the tree has a line of this server, indented so, with that number of clients and current
 * light; or until it has no line of it. */
void lw_relays_await_in_tree(const struct lw_process *of, unsigned indent, const char *host, uint16_t port,
                             unsigned clients);
void lw_relays_await_not_in_tree(const struct lw_process *of, const char *host, uint16_t port);

/** A figure of a server, as its operator reads it; the name outlives the test. */
double lw_relays_figure(const struct lw_process *process, const char *name);

#endif
