/* load_series.h: age of light and received bytes of all users over time, as CSV.
 * Flow:    load_session -> [load_series] -> file
 * Threads: everything here is [loop]. */
#ifndef LW_CLIENT_LOAD_LOAD_SERIES_H
#define LW_CLIENT_LOAD_LOAD_SERIES_H

#include "client/load/load_session.h"

#define LW_LOAD_SERIES_MS 100u /* from one line to the next */

struct lw_load_series;

/** Creates the file and writes the names of its columns:
 *   unix_s       seconds since 1970, so that series of several processes share an axis
 *   users        sessions that get frames
 *   bytes        received by all users since the line before
 *   age_p50_ms   age of a user's light: since its newest frame first reached any user, and that frame's
 *   age_max_ms   solve; a user that has lost its server counts on. Empty while nobody has light
 * Errors: LW_IO naming the file; LW_NO_MEMORY. */
LW_MUST_CHECK enum lw_status lw_load_series_create(const char *path, struct lw_load_series **out_series,
                                                   struct lw_error *err);
/** Writes a line. */
void lw_load_series_add(struct lw_load_series *series, const struct lw_load_shared *shared, uint64_t now_ns);

/** Closes the file and frees the series; NULL is fine. Errors: LW_IO: a line was not written. */
LW_MUST_CHECK enum lw_status lw_load_series_finish(struct lw_load_series *series, struct lw_error *err);

#endif
