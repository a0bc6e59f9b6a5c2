/* serve_metrics.h: figures of every program that serves, for monitoring: its sessions and its process.
 * Flow:    the server's figures -> [serve_metrics] -> pages
 * Threads: one thread per text. */
#ifndef LW_SERVE_METRICS_SERVE_METRICS_H
#define LW_SERVE_METRICS_SERVE_METRICS_H

#include "server/serve/metrics/exposition.h"
#include "server/serve/metrics/server_page.h"
#include "server/serve/metrics/server_stats.h"

/** Sessions, and what they were sent. */
void lw_serve_metrics_sessions(struct lw_exposition *exposition, const struct lw_server_stats *serve);
/** CPU time, memory, descriptors. started_s: of the Unix epoch. */
void lw_serve_metrics_process(struct lw_exposition *exposition, double started_s);
/** A page that is a text, which is copied. False: there is no memory. */
bool lw_serve_metrics_plain(struct lw_server_page *out_page, unsigned status, const char *text);

#endif
