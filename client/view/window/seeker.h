/* seeker.h: looks for a server in the background, so that a window stays alive meanwhile.
 * Threads: the owner's calls from one thread; connects on a thread of its own. */
#ifndef LW_CLIENT_VIEW_WINDOW_SEEKER_H
#define LW_CLIENT_VIEW_WINDOW_SEEKER_H

#include "client/lib/client.h"

/* Time that a client takes in messages before the window draws again. A picture of 60 a second has 16 ms, and
 * tiles may take a fourth of it (bench_take). */
#define LW_SEEKER_BUDGET_NS 2000000u

struct lw_seeker;

/** access, name, cache_folder, draws_direct: as for lw_client_create(); name and cache_folder outlive
 * the seeker. Errors: LW_NO_MEMORY. */
LW_MUST_CHECK enum lw_status lw_seeker_create(const char *host, uint16_t port, const struct lw_access *access,
                                              const char *name, const char *cache_folder, bool draws_direct,
                                              struct lw_seeker **out_seeker, struct lw_error *err);
/** Connects at once, with the terms of all clients that it looks for. Errors: as lw_client_create(). */
LW_MUST_CHECK enum lw_status lw_seeker_connect(const struct lw_seeker *seeker, unsigned timeout_ms,
                                               struct lw_client **out_client, struct lw_error *err);
/** Waits for an attempt that is under way. */
void lw_seeker_destroy(struct lw_seeker *seeker);

/** Begins to look, with pauses as lw_client_return_ms() has them; retry_after_ms: as the server said. */
void lw_seeker_start(struct lw_seeker *seeker, uint32_t retry_after_ms);

/** Call often. Returns the client once there is one, the caller's from then on; otherwise NULL. */
struct lw_client *lw_seeker_take(struct lw_seeker *seeker);

/** The link held: the next search begins with the first pause again. */
void lw_seeker_reset(struct lw_seeker *seeker);

#endif
