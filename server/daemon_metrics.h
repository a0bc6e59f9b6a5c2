/* daemon_metrics.h: figures of a running lightwelld: /metrics, /healthz, /readyz.
 * Flow:    frames [solver], the server's figures [loop] -> [daemon metrics] -> text -> monitoring
 * Threads: lw_daemon_metrics_frame() is [solver], pages are [loop]; a mutex is held for copies only. */
#ifndef LW_DAEMON_METRICS_H
#define LW_DAEMON_METRICS_H

#include "common/base/waiting.h"
#include "server/cost_report.h"
#include "server/daemon_memory.h"
#include "server/nats/nats_publisher.h"
#include "server/publish/publisher.h"
#include "server/serve/server.h"

#include <pthread.h>

/** The passes with times of their own. */
#define LW_DAEMON_METRICS_PASSES(X)                                                                          \
    X(pose) X(change) X(direct) X(probe) X(scatter) X(denoise) X(weld) X(levels) X(encode)

enum lw_daemon_metrics_pass {
#define LW_DAEMON_METRICS_ENUM(name) LW_DAEMON_METRICS_##name,
    LW_DAEMON_METRICS_PASSES(LW_DAEMON_METRICS_ENUM)
#undef LW_DAEMON_METRICS_ENUM
        LW_DAEMON_METRICS_PASS_COUNT
};

/** Sums since the start. */
struct lw_daemon_metrics_sums {
    struct lw_durations frame, pass[LW_DAEMON_METRICS_PASS_COUNT];
    uint64_t rays_shadow, rays_bounce, rays_probe, texels_solved, tiles_encoded, bytes_encoded, saturated,
        changes, solve_cpu_ns, publish_cpu_ns, newest_frame, saves_failed;
    uint32_t tiles, tiles_converged, tiles_interest, tiles_fine, tiles_fine_wanted; /* in the last frame */
    uint64_t memory_bytes;             /* for solver and publisher */
    struct lw_daemon_memory budget;    /* zeroed: not chosen yet */
    double lit_after_s, whole_after_s; /* first light after the start; 0: none yet */
};

struct lw_daemon_metrics {
    pthread_mutex_t mutex;
    struct lw_daemon_metrics_sums sums; /* guarded */
    const char *isa, *solver;           /* outlive it */
    struct lw_cost_report renderers;    /* what users would run instead; none: nothing is reported */
    double started_s;                   /* since the Unix epoch */
};

/** Figures of one frame. */
struct lw_daemon_metrics_frame {
    uint64_t number, wall_ns, solve_cpu_ns, publish_cpu_ns;
    size_t changes;
    const struct lw_solver_stats *solve;
    const struct lw_publisher_stats *publish;
};

/** Figures of pages beside sums. */
struct lw_daemon_metrics_state {
    bool is_lit;      /* there is light to send */
    bool is_stalled;  /* the solver makes no progress */
    bool is_stopping; /* sessions are sent away */
    struct lw_waiting_state first_light;
    const struct lw_nats_publisher_stats *nats; /* NULL: there is no --nats */
};

void lw_daemon_metrics_init(struct lw_daemon_metrics *metrics, const char *isa, const char *solver);
void lw_daemon_metrics_finish(struct lw_daemon_metrics *metrics);

void lw_daemon_metrics_memory(struct lw_daemon_metrics *metrics, uint64_t bytes);
void lw_daemon_metrics_budget(struct lw_daemon_metrics *metrics, const struct lw_daemon_memory *budget);
void lw_daemon_metrics_save_failed(struct lw_daemon_metrics *metrics);
void lw_daemon_metrics_first_light(struct lw_daemon_metrics *metrics, double after_s);
/** The light of the whole density has come, after coarse light. */
void lw_daemon_metrics_whole_light(struct lw_daemon_metrics *metrics, double after_s);
void lw_daemon_metrics_frame(struct lw_daemon_metrics *metrics, const struct lw_daemon_metrics_frame *frame);

/** All metrics as text. Errors: LW_NO_MEMORY. */
LW_MUST_CHECK enum lw_status lw_daemon_metrics_text(struct lw_daemon_metrics *metrics,
                                                    const struct lw_daemon_metrics_state *state,
                                                    const struct lw_server_stats *serve, char **out_text,
                                                    size_t *out_size);

/** Page of a path. Returns false if there is none. */
bool lw_daemon_metrics_page(struct lw_daemon_metrics *metrics, const char *path,
                            const struct lw_daemon_metrics_state *state, const struct lw_server_stats *serve,
                            struct lw_server_page *out_page);

#endif
