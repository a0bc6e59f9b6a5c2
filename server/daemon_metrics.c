#include "server/daemon_metrics.h"

#include "common/base/clock.h"
#include "server/serve/metrics/serve_metrics.h"

#include <stdlib.h>
#include <string.h>
#include <time.h>

void lw_daemon_metrics_init(struct lw_daemon_metrics *metrics, const char *isa, const char *solver) {
    *metrics = (struct lw_daemon_metrics){
        .isa = isa, .solver = solver, .started_s = (double)lw_clock_read_ns(CLOCK_REALTIME) * 1e-9};
    pthread_mutex_init(&metrics->mutex, NULL);
}

void lw_daemon_metrics_finish(struct lw_daemon_metrics *metrics) { pthread_mutex_destroy(&metrics->mutex); }

void lw_daemon_metrics_memory(struct lw_daemon_metrics *metrics, uint64_t bytes) {
    pthread_mutex_lock(&metrics->mutex);
    metrics->sums.memory_bytes = bytes;
    pthread_mutex_unlock(&metrics->mutex);
}

void lw_daemon_metrics_budget(struct lw_daemon_metrics *metrics, const struct lw_daemon_memory *budget) {
    pthread_mutex_lock(&metrics->mutex);
    metrics->sums.budget = *budget;
    pthread_mutex_unlock(&metrics->mutex);
}

void lw_daemon_metrics_save_failed(struct lw_daemon_metrics *metrics) {
    pthread_mutex_lock(&metrics->mutex);
    metrics->sums.saves_failed++;
    pthread_mutex_unlock(&metrics->mutex);
}

void lw_daemon_metrics_first_light(struct lw_daemon_metrics *metrics, double after_s) {
    pthread_mutex_lock(&metrics->mutex);
    metrics->sums.lit_after_s = after_s;
    pthread_mutex_unlock(&metrics->mutex);
}

void lw_daemon_metrics_whole_light(struct lw_daemon_metrics *metrics, double after_s) {
    pthread_mutex_lock(&metrics->mutex);
    metrics->sums.whole_after_s = after_s;
    pthread_mutex_unlock(&metrics->mutex);
}

/* A pass that did not run took no time, and counts as none. */
static void add_pass(struct lw_daemon_metrics_sums *sums, enum lw_daemon_metrics_pass pass, uint64_t ns) {
    if (ns) lw_durations_add(&sums->pass[pass], ns);
}

void lw_daemon_metrics_frame(struct lw_daemon_metrics *metrics, const struct lw_daemon_metrics_frame *frame) {
    const struct lw_solver_stats *solve = frame->solve;
    const struct lw_publisher_stats *publish = frame->publish;
    struct lw_daemon_metrics_sums *sums = &metrics->sums;
    pthread_mutex_lock(&metrics->mutex);
    lw_durations_add(&sums->frame, frame->wall_ns);
    add_pass(sums, LW_DAEMON_METRICS_pose, solve->pose_ns);
    add_pass(sums, LW_DAEMON_METRICS_change, solve->change_ns);
    add_pass(sums, LW_DAEMON_METRICS_direct, solve->direct_ns);
    add_pass(sums, LW_DAEMON_METRICS_probe, solve->probe_ns);
    add_pass(sums, LW_DAEMON_METRICS_scatter, solve->scatter_ns);
    add_pass(sums, LW_DAEMON_METRICS_denoise, solve->denoise_ns);
    add_pass(sums, LW_DAEMON_METRICS_weld, solve->weld_ns);
    add_pass(sums, LW_DAEMON_METRICS_levels, publish->levels_ns);
    add_pass(sums, LW_DAEMON_METRICS_encode, publish->encode_ns);
    sums->rays_shadow += solve->rays_shadow;
    sums->rays_bounce += solve->rays_bounce;
    sums->rays_probe += solve->rays_probe;
    sums->texels_solved += solve->texels_solved;
    sums->tiles_encoded += publish->tiles_encoded;
    sums->bytes_encoded += publish->bytes_encoded;
    if (publish->saturated) sums->saturated = publish->saturated; /* a frame without snapshot has none */
    sums->changes += frame->changes;
    sums->solve_cpu_ns += frame->solve_cpu_ns;
    sums->publish_cpu_ns += frame->publish_cpu_ns;
    sums->newest_frame = frame->number;
    sums->tiles = solve->tiles;
    sums->tiles_converged = solve->tiles_converged;
    sums->tiles_interest = solve->tiles_interest;
    sums->tiles_fine = solve->tiles_fine;
    sums->tiles_fine_wanted = solve->tiles_fine_wanted;
    pthread_mutex_unlock(&metrics->mutex);
}

static void write_build(struct lw_exposition *e, const struct lw_daemon_metrics *metrics) {
    char isa[64], solver[64], labels[256];
    lw_exposition_escape(isa, sizeof isa, metrics->isa);
    lw_exposition_escape(solver, sizeof solver, metrics->solver);
    snprintf(labels, sizeof labels, "version=\"" LW_VERSION "\",isa=\"%s\",solver=\"%s\"", isa, solver);
    lw_exposition_metric(e, "lightwell_build_info", "gauge",
                         "Always 1: the version, the instruction set that rays are traced with, the solver.");
    lw_exposition_sample(e, "lightwell_build_info", labels, 1);
}

static void write_solve(struct lw_exposition *e, const struct lw_daemon_metrics_sums *sums) {
    static const char *const passes[] = {
#define LW_DAEMON_METRICS_LABEL(name) "pass=\"" #name "\"",
        LW_DAEMON_METRICS_PASSES(LW_DAEMON_METRICS_LABEL)
#undef LW_DAEMON_METRICS_LABEL
    };
    lw_exposition_metric(e, "lightwell_frame_duration_seconds", "histogram",
                         "Wall time of a frame: simulated, solved and published.");
    lw_exposition_durations(e, "lightwell_frame_duration_seconds", NULL, &sums->frame);
    lw_exposition_metric(e, "lightwell_pass_duration_seconds", "histogram",
                         "Wall time of a frame's passes; a pass that did not run is not counted.");
    for (unsigned p = 0; p < LW_DAEMON_METRICS_PASS_COUNT; p++)
        lw_exposition_durations(e, "lightwell_pass_duration_seconds", passes[p], &sums->pass[p]);
    lw_exposition_gauge(e, "lightwell_frame", (double)sums->newest_frame, "Number of the newest frame.");
    lw_exposition_metric(e, "lightwell_rays_total", "counter", "Rays traced, by what they are for.");
    lw_exposition_sample(e, "lightwell_rays_total", "kind=\"shadow\"", (double)sums->rays_shadow);
    lw_exposition_sample(e, "lightwell_rays_total", "kind=\"bounce\"", (double)sums->rays_bounce);
    lw_exposition_sample(e, "lightwell_rays_total", "kind=\"probe\"", (double)sums->rays_probe);
    lw_exposition_counter(e, "lightwell_solved_texels_total", (double)sums->texels_solved,
                          "Texels solved; one counts in each frame that solves it.");
    lw_exposition_gauge(e, "lightwell_tiles", sums->tiles, "Level-0 tiles of the scene.");
    lw_exposition_gauge(e, "lightwell_converged_tiles", sums->tiles_converged,
                        "Level-0 tiles that are converged: they cost no ray.");
    lw_exposition_gauge(e, "lightwell_fine_tiles", sums->tiles_fine, "Tiles of finer levels that are there.");
    lw_exposition_gauge(e, "lightwell_wanted_fine_tiles", sums->tiles_fine_wanted,
                        "Tiles of finer levels that clients ask for.");
    lw_exposition_gauge(e, "lightwell_interest_tiles", sums->tiles_interest,
                        "Level-0 tiles in the interest set of all clients together.");
    lw_exposition_counter(e, "lightwell_scene_changes_total", (double)sums->changes,
                          "Changes of the scene that clients made.");
    lw_exposition_counter(e, "lightwell_saturated_channels_total", (double)sums->saturated,
                          "Channels of light that did not fit the tile codec's range.");
    lw_exposition_counter(e, "lightwell_failed_saves_total", (double)sums->saves_failed,
                          "Times that --keep could not save the light.");
    lw_exposition_gauge(e, "lightwell_solve_memory_bytes", (double)sums->memory_bytes,
                        "Memory of solver and publisher, rays' structure included.");
    const struct lw_daemon_memory *budget = &sums->budget;
    lw_exposition_gauge(e, "lightwell_light_memory_bytes",
                        (double)(budget->base_bytes + sums->tiles_fine * budget->tile_bytes),
                        "Forecast of the light's memory, with the tiles of finer levels that are there.");
    lw_exposition_gauge(e, "lightwell_light_memory_limit_bytes", (double)budget->limit_bytes,
                        "The most memory that the light may take (--memory).");
    lw_exposition_gauge(e, "lightwell_first_light_seconds", sums->lit_after_s,
                        "First light after the start; 0: none yet.");
    lw_exposition_gauge(e, "lightwell_whole_light_seconds", sums->whole_after_s,
                        "Light of the whole density after the start, where coarse light came first; 0: there "
                        "is none yet, or it came first.");
}

static void write_serve(struct lw_exposition *e, const struct lw_daemon_metrics_sums *sums,
                        const struct lw_server_stats *serve) {
    lw_exposition_counter(e, "lightwell_encoded_tiles_total", (double)sums->tiles_encoded,
                          "Tiles encoded, once for all clients.");
    lw_exposition_counter(e, "lightwell_encoded_bytes_total", (double)sums->bytes_encoded,
                          "Bytes of these, for a client that has the tiles of the frame before.");
    lw_serve_metrics_sessions(e, serve);
}

/* Cost of a user without this server, beside the cost with it. */
static void write_renderers(struct lw_exposition *e, const struct lw_cost_report *report) {
    if (!report->count) return;
    lw_exposition_metric(
        e, "lightwell_renderer_frame_cpu_seconds", "gauge",
        "CPU time of a frame of a renderer for each user, by the report of --crossover-report.");
    for (unsigned i = 0; i < report->count; i++) {
        char renderer[128], setting[128], labels[300];
        lw_exposition_escape(renderer, sizeof renderer, report->row[i].renderer);
        lw_exposition_escape(setting, sizeof setting, report->row[i].setting);
        snprintf(labels, sizeof labels, "renderer=\"%s\",setting=\"%s\"", renderer, setting);
        lw_exposition_sample(e, "lightwell_renderer_frame_cpu_seconds", labels, report->row[i].cpu_s);
    }
}

static void write_nats(struct lw_exposition *e, const struct lw_nats_publisher_stats *nats) {
    if (!nats) return;
    lw_exposition_gauge(
        e, "lightwell_nats_connected", nats->is_connected && !nats->is_stood_down,
        "1: the light is published at --nats; 0: NATS is gone, or another lightwelld publishes "
        "under that name.");
    lw_exposition_gauge(e, "lightwell_nats_relays", nats->relays,
                        "Relays that want light by NATS; one that takes both channels of it counts twice.");
    lw_exposition_counter(e, "lightwell_nats_published_messages_total", (double)nats->messages,
                          "Messages handed to NATS.");
    lw_exposition_counter(e, "lightwell_nats_published_bytes_total", (double)nats->bytes,
                          "Bytes of their payloads.");
    lw_exposition_counter(e, "lightwell_nats_kept_messages_total", (double)nats->kept,
                          "Those of them that JetStream was asked to keep: light.");
    lw_exposition_counter(e, "lightwell_nats_failures_total", (double)nats->failures,
                          "Messages that could not be handed over: NATS was gone, or full.");
    lw_exposition_counter(e, "lightwell_nats_requests_total", (double)nats->requests, "Messages of relays.");
    lw_exposition_counter(e, "lightwell_nats_refused_messages_total", (double)nats->refused_messages,
                          "Those of them that made no sense.");
}

static void write_cpu(struct lw_exposition *e, const struct lw_daemon_metrics_sums *sums,
                      const struct lw_server_stats *serve) {
    lw_exposition_metric(e, "lightwell_cpu_seconds_total", "counter",
                         "CPU time by stage, over the threads of each.");
    lw_exposition_sample(e, "lightwell_cpu_seconds_total", "stage=\"solve\"",
                         (double)sums->solve_cpu_ns * 1e-9);
    lw_exposition_sample(e, "lightwell_cpu_seconds_total", "stage=\"publish\"",
                         (double)sums->publish_cpu_ns * 1e-9);
    lw_exposition_sample(e, "lightwell_cpu_seconds_total", "stage=\"serve\"",
                         (double)serve->loop_cpu_ns * 1e-9);
}

enum lw_status lw_daemon_metrics_text(struct lw_daemon_metrics *metrics,
                                      const struct lw_daemon_metrics_state *state,
                                      const struct lw_server_stats *serve, char **out_text,
                                      size_t *out_size) {
    struct lw_exposition e;
    pthread_mutex_lock(&metrics->mutex);
    const struct lw_daemon_metrics_sums sums = metrics->sums;
    pthread_mutex_unlock(&metrics->mutex);
    enum lw_status status = lw_exposition_begin(&e);
    if (status != LW_OK) return status;
    write_build(&e, metrics);
    lw_exposition_gauge(&e, "lightwell_ready", state->is_lit && !state->is_stalled && !state->is_stopping,
                        "1: clients get light; what /readyz says.");
    lw_exposition_gauge(&e, "lightwell_solver_stalled", state->is_stalled,
                        "1: the solver has made no progress within --stall-limit.");
    lw_exposition_gauge(&e, "lightwell_waiting_stage", state->first_light.stage,
                        "What the first light waits for; 1: placing texels, 2: looking inside objects, 3: "
                        "first light itself, 4: nothing, it is there.");
    lw_exposition_gauge(&e, "lightwell_waiting_share", (double)state->first_light.share,
                        "How much of that is done, 0 to 1.");
    write_solve(&e, &sums);
    write_serve(&e, &sums, serve);
    write_nats(&e, state->nats);
    write_cpu(&e, &sums, serve);
    write_renderers(&e, &metrics->renderers);
    lw_serve_metrics_process(&e, metrics->started_s);
    return lw_exposition_end(&e, out_text, out_size);
}

/* "no light yet: looking inside objects, 42 %" */
static bool unlit_page(struct lw_server_page *out_page, const struct lw_waiting_state *first_light) {
    char line[LW_WAITING_LINE_SIZE], text[LW_WAITING_LINE_SIZE + 16];
    lw_waiting_line(first_light->stage, first_light->share, line);
    snprintf(text, sizeof text, "no light yet: %s\n", line);
    return lw_serve_metrics_plain(out_page, 503, text);
}

bool lw_daemon_metrics_page(struct lw_daemon_metrics *metrics, const char *path,
                            const struct lw_daemon_metrics_state *state, const struct lw_server_stats *serve,
                            struct lw_server_page *out_page) {
    if (strcmp(path, "/healthz") == 0)
        return state->is_stalled ? lw_serve_metrics_plain(out_page, 503, "the solver makes no progress\n")
                                 : lw_serve_metrics_plain(out_page, 200, "ok\n");
    if (strcmp(path, "/readyz") == 0)
        return state->is_stopping  ? lw_serve_metrics_plain(out_page, 503, "stopping\n")
               : state->is_stalled ? lw_serve_metrics_plain(out_page, 503, "the solver makes no progress\n")
               : !state->is_lit    ? unlit_page(out_page, &state->first_light)
                                   : lw_serve_metrics_plain(out_page, 200, "ok\n");
    if (strcmp(path, "/metrics") != 0) return false;
    *out_page = (struct lw_server_page){.status = 200, .type = LW_EXPOSITION_TYPE};
    return lw_daemon_metrics_text(metrics, state, serve, &out_page->text, &out_page->size) == LW_OK;
}
