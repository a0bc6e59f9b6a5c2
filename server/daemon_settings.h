/* daemon_settings.h: the options of lightwelld, from the command line, a file and the environment.
 * Flow:    argv, file, environment -> [daemon_settings: one row an option] -> values, --help, --print-config
 * Threads: one caller at a time per struct. */
#ifndef LW_SERVER_DAEMON_SETTINGS_H
#define LW_SERVER_DAEMON_SETTINGS_H

#include "common/base/options_config.h"
#include "common/base/tls_trust_desc.h"
#include "common/open/scene_open.h"
#include "proto/nats_wire.h"
#include "server/cost_report.h"
#include "server/probe_options.h"
#include "server/serve/serve_options.h"
#include "server/solve/solvers.h"

enum lw_daemon_clock { LW_DAEMON_CLOCK_REAL, LW_DAEMON_CLOCK_STEP, LW_DAEMON_CLOCK_MANUAL };
enum lw_daemon_light { LW_DAEMON_LIGHT_WHOLE, LW_DAEMON_LIGHT_SEEN };
enum lw_daemon_first { LW_DAEMON_FIRST_COARSE, LW_DAEMON_FIRST_WHOLE };
enum lw_daemon_directional {
    LW_DAEMON_DIRECTIONAL_AUTO,
    LW_DAEMON_DIRECTIONAL_ON,
    LW_DAEMON_DIRECTIONAL_OFF
};
enum lw_daemon_codec { LW_DAEMON_CODEC_HALF, LW_DAEMON_CODEC_DCT };

struct lw_daemon_settings {
    struct lw_scene_open scene;
    struct lw_options_config config;
    char *printed; /* all options, as a file for --config */
    struct lw_serve_options serve;
    const char *nats; /* NULL: none */
    struct lw_nats_wire_address nats_address;
    struct lw_tls_trust_desc nats_trust;
    const char *plan_log;
    const char *crossover_report;
    struct lw_cost_report renderers; /* from that report */
    const char *keep, *cache, *spares, *light_groups, *client_lights, *solver;
    const struct lw_solvers_entry *entry; /* the solver's */
    int64_t bounces, direct_samples, indirect_samples, seed, frames, detail;
    int64_t memory_mb; /* 0: a share of the machine's */
    struct lw_probe_options probes;
    int denoise;
    double frame_rate, frame_budget_ms, frame_budget_units, freeze_s, error, tile_step, stall_s, prepare_s;
    bool animate, freeze, json, keep_changes;
    int clock, light, first, directional, codec, log_format, log_level;
    char default_cache[1024];
};

/** Sets the defaults. cancel: ends opening a scene. */
void lw_daemon_settings_init(struct lw_daemon_settings *settings, const _Atomic bool *cancel);
void lw_daemon_settings_finish(struct lw_daemon_settings *settings);

/** Reads all options and checks them together. *out_done: --help or the like has done its work.
 * Errors: LW_USAGE naming the option; those of files that options name; LW_NO_MEMORY. */
LW_MUST_CHECK enum lw_status lw_daemon_settings_parse(struct lw_daemon_settings *settings, int argc,
                                                      char **argv, bool *out_done, struct lw_error *err);

/** Takes options that SIGHUP cannot change from the settings before, and warns of each that differs.
 * *out_changed: whether an option that SIGHUP can change does. Errors: LW_NO_MEMORY. */
LW_MUST_CHECK enum lw_status lw_daemon_settings_keep(struct lw_daemon_settings *settings,
                                                     const struct lw_daemon_settings *before,
                                                     bool *out_changed, struct lw_error *err);

#endif
