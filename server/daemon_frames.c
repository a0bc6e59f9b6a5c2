#include "server/daemon_frames.h"

#include "common/base/clock.h"
#include "common/base/log.h"
#include "server/serve/service_notify.h"

#include <errno.h>
#include <jansson.h>
#include <math.h>
#include <poll.h>
#include <stdio.h>
#include <stdlib.h>
#include <unistd.h>

/* Before the first light a stall is this many times the limit: texels are placed, and the rays' structure is
 * built. */
#define STALL_FIRST 6.0
#define STEP_HZ     30 /* scene time advances by 1/30 s a frame under --clock step */
/* A channel that no client takes any more is published for this long, since clients come back after a
 * broken link. */
#define CHANNEL_LINGERS_NS 10000000000u
/* A picture of one sample for each texel is blotched. So the first shown picture has this many samples, or as
 * many as frames end within so long after the first frame. */
#define FIRST_ROUNDS 3
#define FIRST_NS     500000000u

/* The solver asks as well: that closes the gap between the last look at the flag and the loop's own
 * watchers. */
static bool should_stop(const struct lw_daemon *d) { return d->stopping || *d->signalled; }

struct frame_cost {
    uint64_t wall_ns, solve_cpu_ns, publish_cpu_ns;
    size_t changes; /* changes of the scene by updates */
};

/* CPU time of the solver's thread and its workers: of the process, less the loop. */
static uint64_t work_cpu_ns(const struct lw_daemon *d) {
    struct lw_server_stats serve;
    lw_server_get_stats(d->server, &serve);
    return lw_clock_process_cpu_ns() - serve.loop_cpu_ns;
}

static void put_count(json_t *line, const char *key, uint64_t count) {
    json_object_set_new(line, key, json_integer((json_int_t)count));
}

static void put_ms(json_t *line, const char *key, uint64_t ns) {
    json_object_set_new(line, key, json_real(round((double)ns * 1e-3) * 1e-3));
}

static void print_frame(const struct lw_daemon *d, uint64_t frame, const struct frame_cost *cost,
                        const struct lw_solver_stats *solve, const struct lw_publisher_stats *publish) {
    struct lw_server_stats serve;
    lw_server_get_stats(d->server, &serve);
    json_t *line = json_object();
    put_count(line, "frame", frame);
    put_count(line, "published", d->published);
    json_object_set_new(line, "time_s", json_real(round(d->pose.time_s * 1e6) * 1e-6));
    put_ms(line, "frame_ms", cost->wall_ns);
    put_ms(line, "pose_ms", solve->pose_ns);
    put_ms(line, "change_ms", solve->change_ns);
    put_ms(line, "direct_ms", solve->direct_ns);
    put_ms(line, "probe_ms", solve->probe_ns);
    put_ms(line, "scatter_ms", solve->scatter_ns);
    put_ms(line, "denoise_ms", solve->denoise_ns);
    put_ms(line, "weld_ms", solve->weld_ns);
    put_ms(line, "levels_ms", publish->levels_ns);
    put_ms(line, "encode_ms", publish->encode_ns);
    put_count(line, "rays_shadow", solve->rays_shadow);
    put_count(line, "rays_bounce", solve->rays_bounce);
    put_count(line, "rays_probe", solve->rays_probe);
    put_count(line, "rays_total", d->rays_total);
    put_count(line, "texels_solved", solve->texels_solved);
    put_count(line, "tiles_solved", solve->tiles_solved);
    put_count(line, "tiles_converged", solve->tiles_converged);
    put_count(line, "tiles", solve->tiles);
    put_count(line, "coarse", solve->coarse);
    put_count(line, "tiles_interest", solve->tiles_interest);
    put_count(line, "tiles_contributing", solve->tiles_contributing);
    put_count(line, "tiles_fine", solve->tiles_fine);
    put_count(line, "tiles_fine_wanted", solve->tiles_fine_wanted);
    put_count(line, "tiles_encoded", publish->tiles_encoded);
    put_count(line, "bytes_encoded", publish->bytes_encoded);
    put_count(line, "split_tiles_encoded", publish->split_tiles_encoded);
    put_count(line, "split_bytes_encoded", publish->split_bytes_encoded);
    put_count(line, "saturated", publish->saturated);
    put_count(line, "changes", cost->changes);
    put_count(line, "sessions", serve.sessions_now);
    put_count(line, "sessions_drawing", serve.sessions_drawing);
    put_count(line, "tiles_sent", serve.tiles_sent);
    put_count(line, "bytes_sent", serve.bytes_sent);
    put_ms(line, "solve_cpu_ms", cost->solve_cpu_ns);
    put_ms(line, "publish_cpu_ms", cost->publish_cpu_ns);
    put_ms(line, "loop_cpu_ms", serve.loop_cpu_ns);
    put_ms(line, "cpu_ms", lw_clock_process_cpu_ns());
    put_ms(line, "loop_lag_p99_ms", serve.loop_lag_p99_ns);
    put_ms(line, "loop_lag_max_ms", serve.loop_lag_max_ns);
    put_ms(line, "ack_p99_ms", serve.ack_p99_ns);
    put_count(line, "waiting_bytes", serve.waiting_bytes);
    put_count(line, "waiting_bytes_max", serve.waiting_bytes_max);
    put_count(line, "socket_bytes", serve.socket_bytes);
    if (json_dumpf(line, stdout, JSON_COMPACT | JSON_REAL_PRECISION(15)) == 0) putchar('\n');
    json_decref(line);
    fflush(stdout);
}

/* The time of the animation's clock, s: of the wall, or counted in frames. */
static double wall_time(const struct lw_daemon *d, uint64_t frame) {
    if (d->settings.clock != LW_DAEMON_CLOCK_REAL) return (double)(frame - d->first) / STEP_HZ;
    return (double)(lw_clock_ns() - d->started_ns) * 1e-9;
}

/* Makes the changes that have come for this frame and poses the scene. Returns how many updates there
 * were. */
static size_t simulate(struct lw_daemon *d, uint64_t frame, size_t *out_change_count) {
    const double wall_s = wall_time(d, frame);
    struct lw_scene_change *change;
    size_t count = lw_server_take_updates(d->server, frame, &change, out_change_count);
    for (size_t i = 0; i < d->restored_count; i++) /* the server has checked the updates after these */
        lw_scene_state_change(&d->state, &d->restored[i], wall_s);
    d->restored_count = 0;
    for (size_t i = 0; i < *out_change_count; i++) lw_scene_state_change(&d->state, &change[i], wall_s);
    if (d->settings.keep_changes &&
        !lw_change_store_add(&d->change_store, change, *out_change_count, &d->state, wall_s))
        lw_daemon_metrics_save_failed(&d->metrics);
    free(change);
    lw_scene_state_pose(&d->state, wall_s, &d->pose);
    return count;
}

/* Sleeps in short pieces, so that a stop is heard within a tenth of a second. */
static void wait_until(const struct lw_daemon *d, uint64_t deadline_ns) {
    for (uint64_t now; !should_stop(d) && (now = lw_clock_ns()) < deadline_ns;) {
        uint64_t rest = deadline_ns - now < 100000000u ? deadline_ns - now : 100000000u;
        nanosleep(&(struct timespec){.tv_sec = 0, .tv_nsec = (long)rest}, NULL);
    }
}

static bool wants_something(const struct lw_daemon *d, const struct lw_server_interest *wanted) {
    for (uint32_t id = 0; !wanted->everything && id < d->atlas_map.tile_count; id++)
        if (wanted->levels[id]) return true;
    return wanted->everything;
}

/* Gives the solver the interest set, if that has changed. */
static enum lw_status follow_clients(struct lw_daemon *d, struct lw_error *err) {
    struct lw_server_interest wanted;
    if (d->settings.light != LW_DAEMON_LIGHT_SEEN || !lw_server_take_interest(d->server, &wanted))
        return LW_OK;
    d->is_looked_at = wants_something(d, &wanted);
    d->interest = wanted.number;
    d->prepares = false;
    enum lw_status status = d->solver->ops->set_interest(d->solver, wanted.levels, err);
    lw_publisher_want(d->publisher, wanted.levels);
    free(wanted.levels);
    return status;
}

/* Without clients, all of the scene is solved from the second frame on, for --prepare seconds. */
static enum lw_status prepare(struct lw_daemon *d, uint64_t frame, struct lw_error *err) {
    const struct lw_daemon_settings *s = &d->settings;
    const bool wanted = s->light == LW_DAEMON_LIGHT_SEEN && s->clock == LW_DAEMON_CLOCK_REAL &&
                        frame > d->first && !d->is_looked_at && (double)d->prepared_ns < 1e9 * s->prepare_s;
    if (wanted == d->prepares || d->is_looked_at) return LW_OK;
    d->prepares = wanted;
    return wanted ? d->solver->ops->set_interest(d->solver, NULL, err) : lw_daemon_solve_nothing(d, err);
}

/* The channels that clients take, and those that they took within CHANNEL_LINGERS_NS. Without clients, they
 * stay. Time is the scene's clock's, since the channels decide the work, and runs must be
 * repeatable. */
static uint32_t choose_channels(struct lw_daemon *d, uint64_t frame) {
    const uint32_t taken = lw_server_channels_taken(d->server);
    const uint64_t now_ns =
        d->settings.clock == LW_DAEMON_CLOCK_REAL ? lw_clock_ns() : 1 + (uint64_t)(1e9 * wall_time(d, frame));
    uint32_t channels = taken;
    for (unsigned f = 0; f < LW_TILE_CHANNELS_MAX; f++) {
        if (taken >> f & 1) d->taken_ns[f] = now_ns;
        if (d->taken_ns[f] && now_ns - d->taken_ns[f] < CHANNEL_LINGERS_NS) channels |= d->channels & 1u << f;
    }
    return taken ? channels : d->channels;
}

/* Once light is shown, lack of memory for what more sessions want ends nothing: they wait, and each frame
 * tries again. True: they do, and *err is empty. */
static bool may_wait(const struct lw_daemon *d, enum lw_status status, const char *what, bool *waits,
                     struct lw_error *err) {
    const bool waited = *waits;
    *waits = status == LW_NO_MEMORY && d->lit;
    if (*waits) *err = (struct lw_error){0};
    if (*waits && !waited)
        lw_log(LW_LOG_WARNING,
               "out of memory for %s: clients keep the light that they have until it is there", what);
    else if (waited && status == LW_OK)
        lw_log(LW_LOG_INFO, "there is memory for %s again", what);
    return *waits;
}

static enum lw_status show_channels(struct lw_daemon *d, uint32_t channels, struct lw_error *err) {
    if (channels == d->channels) return LW_OK;
    enum lw_status status = lw_publisher_set_channels(d->publisher, channels);
    if (may_wait(d, status, "another channel", &d->owes_channel, err)) return LW_OK;
    if (status != LW_OK) return lw_status_fail(err, status, "publisher");
    d->solver->ops->choose_channels(d->solver, channels);
    d->channels = channels;
    return LW_OK;
}

/* Ids of tiles of finer levels are free again with a snapshot that knows the newest list of interest: one is
 * due where they run short. */
static bool owes_ids(const struct lw_daemon *d) {
    const struct lw_atlas_map *map = &d->atlas_map;
    return map->fine && d->interest > d->published_interest &&
           lw_fine_ids_free_count(map->fine) < lw_atlas_map_room(map) / 4;
}

/* Whether relays listen by NATS. */
static bool has_relays(const struct lw_daemon *d) {
    struct lw_nats_publisher_stats stats = {.relays = 0};
    if (d->nats) lw_nats_publisher_get_stats(d->nats, &stats);
    return stats.relays > 0;
}

/* Sessions need new transforms even if no tile in their interest set was solved, and a session that sent an
 * update waits for its frame. */
static bool has_news(struct lw_daemon *d, const struct lw_solver_stats *solve, size_t updates) {
    struct lw_server_stats serve;
    lw_server_get_stats(d->server, &serve);
    d->moved |= solve->moved;
    return solve->tiles_shown > 0 || updates > 0 || (d->moved && (serve.sessions_now > 0 || has_relays(d))) ||
           owes_ids(d);
}

/* *out_snapshot: stays NULL where there is no memory for it now. */
static enum lw_status publish_frame(struct lw_daemon *d, uint64_t frame, uint64_t solve_ns,
                                    uint64_t tiles_shown, struct lw_snapshot **out_snapshot,
                                    struct lw_publisher_stats *out_stats, struct lw_error *err) {
    const enum lw_status status = lw_publisher_publish(d->publisher, &d->pose, frame, solve_ns, d->rays_total,
                                                       tiles_shown, out_snapshot, out_stats);
    if (may_wait(d, status, "new light", &d->owes_snapshot, err)) return LW_OK;
    if (status != LW_OK)
        return lw_status_fail(err, status, "publishing frame %llu", (unsigned long long)frame);
    (*out_snapshot)->interest = d->published_interest = d->interest;
    lw_server_publish(d->server, *out_snapshot);
    if (d->nats) lw_nats_publisher_publish(d->nats, *out_snapshot);
    d->published = frame;
    d->moved = false;
    return LW_OK;
}

/* Whether the first light is held back, to be better soon. A change of the scene does not wait. */
static bool is_too_young(struct lw_daemon *d, uint64_t frame, const struct lw_solver_stats *solve,
                         size_t updates) {
    const struct lw_daemon_settings *s = &d->settings;
    const bool goes_on = s->light != LW_DAEMON_LIGHT_SEEN || d->is_looked_at || s->prepare_s > 0;
    return s->clock == LW_DAEMON_CLOCK_REAL && !d->lit && !d->channels_kept && !updates && goes_on &&
           solve->tiles_solved && d->young.rounds < FIRST_ROUNDS &&
           frame - d->first + 1 != (uint64_t)s->frames &&
           lw_clock_ns() + d->young.frame_ns - d->young.lit_ns < FIRST_NS;
}

static void note_young(struct lw_daemon *d, const struct lw_solver_stats *solve, uint64_t began_ns) {
    if (!d->young.rounds++) {
        d->young.lit_ns = lw_clock_ns();
        d->young.frame_ns = d->young.lit_ns - began_ns;
        d->young.texels = solve->texels_solved;
    }
}

static void tell_first_light(struct lw_daemon *d, const struct lw_solver_stats *solve) {
    const double after_s = (double)(lw_clock_ns() - d->started_ns) * 1e-9;
    lw_log(LW_LOG_INFO, "first light after %.1f s%s: %u texels in %u tiles, %.1f M rays, frame %.0f ms",
           after_s, solve->coarse ? ", coarse" : "", (unsigned)d->young.texels, solve->tiles,
           (double)d->rays_total * 1e-6, (double)d->young.frame_ns * 1e-6);
    lw_service_notify("STATUS=first light after %.1f s", after_s);
    lw_daemon_metrics_first_light(&d->metrics, after_s);
    d->lit = true;
    lw_waiting_raise(&d->first_light, LW_WAITING_READY, 1, 1);
}

/* Says when coarse light gives way to the light of the whole density. */
static void tell_whole_light(struct lw_daemon *d, const struct lw_solver_stats *solve) {
    if (d->is_coarse && !solve->coarse) {
        const double after_s = (double)(lw_clock_ns() - d->started_ns) * 1e-9;
        const uint64_t bytes = lw_daemon_memory_bytes(d);
        lw_log(LW_LOG_INFO, "all detail after %.1f s: %u tiles; %.0f MB for the solve", after_s, solve->tiles,
               (double)bytes * 1e-6);
        lw_daemon_metrics_memory(&d->metrics, bytes);
        lw_daemon_metrics_whole_light(&d->metrics, after_s);
    }
    d->is_coarse = solve->coarse;
}

static enum lw_status run_frame(struct lw_daemon *d, uint64_t frame, bool *out_rested, struct lw_error *err) {
    struct lw_solver_stats solve = {0};
    struct lw_publisher_stats publish = {0};
    struct lw_snapshot *snapshot = NULL;
    struct frame_cost cost = {0};
    uint64_t began = lw_clock_ns(), cpu_began = work_cpu_ns(d);
    const size_t updates = simulate(d, frame, &cost.changes);
    enum lw_status status = follow_clients(d, err);
    if (status == LW_OK) status = prepare(d, frame, err);
    const uint32_t channels_before = d->channels;
    if (status == LW_OK) status = show_channels(d, choose_channels(d, frame), err);
    if (status == LW_OK) status = d->solver->ops->frame(d->solver, &d->pose, frame, &solve, err);
    if (status != LW_OK) return status;
    uint64_t cpu_solved = work_cpu_ns(d);
    cost.solve_cpu_ns = cpu_solved - cpu_began;
    d->rays_total += solve.rays_shadow + solve.rays_bounce + solve.rays_probe;
    if (!d->lit && solve.tiles_shown) note_young(d, &solve, began);
    /* A frame in which nothing was solved and nothing moved gives no snapshot and no bytes, unless a session
     * has asked for a channel that was not published. */
    const bool news =
        !is_too_young(d, frame, &solve, updates) &&
        (has_news(d, &solve, updates) || !d->lit || d->owes_snapshot || (d->channels & ~channels_before));
    *out_rested = !news && !solve.tiles_solved;
    if (news) {
        status = publish_frame(d, frame, lw_clock_ns() - began, solve.tiles_shown, &snapshot, &publish, err);
        if (status != LW_OK) return status;
        *out_rested = d->owes_snapshot;
        cost.publish_cpu_ns = work_cpu_ns(d) - cpu_solved;
    }
    if (d->settings.keep) {
        lw_light_store_note(&d->light_store, snapshot, solve.tiles_solved > 0, solve.moved);
        if (!lw_light_store_save_sometimes(&d->light_store, d->solver))
            lw_daemon_metrics_save_failed(&d->metrics);
    }
    lw_snapshot_unref(snapshot);
    cost.wall_ns = lw_clock_ns() - began;
    if (d->prepares) d->prepared_ns += cost.wall_ns;
    if (news && !d->lit) tell_first_light(d, &solve);
    tell_whole_light(d, &solve);
    lw_daemon_metrics_frame(&d->metrics,
                            &(struct lw_daemon_metrics_frame){.number = frame,
                                                              .wall_ns = cost.wall_ns,
                                                              .solve_cpu_ns = cost.solve_cpu_ns,
                                                              .publish_cpu_ns = cost.publish_cpu_ns,
                                                              .changes = cost.changes,
                                                              .solve = &solve,
                                                              .publish = &publish});
    d->frame_count++;
    if (solve.tiles_solved || news)
        lw_log(LW_LOG_DEBUG, "frame %llu: %.1f ms, %u tiles solved, %u shown, %zu changes",
               (unsigned long long)frame, (double)cost.wall_ns * 1e-6, (unsigned)solve.tiles_solved,
               (unsigned)solve.tiles_shown, cost.changes);
    if (d->settings.json) print_frame(d, frame, &cost, &solve, &publish);
    return LW_OK;
}

/* ---- whether the solver makes progress ---- */

/* A stage that begins now ends within the limit, or the solver hangs. */
void lw_daemon_frames_expect(struct lw_daemon *d) {
    const double limit_s = d->settings.stall_s * (d->lit ? 1 : STALL_FIRST);
    d->solver_due_ns = lw_clock_ns() + (uint64_t)(limit_s * 1e9);
}

static void rest(struct lw_daemon *d) { d->solver_due_ns = UINT64_MAX; }

/* [loop] */
bool lw_daemon_frames_stalled(const struct lw_daemon *d) { return lw_clock_ns() > d->solver_due_ns; }

/* ---- the loop over frames ---- */

/* Under the manual clock: whether another line came. Waits in short pieces, as wait_until(). */
static bool await_line(const struct lw_daemon *d) {
    while (!should_stop(d)) {
        struct pollfd input = {.fd = STDIN_FILENO, .events = POLLIN};
        if (poll(&input, 1, 100) <= 0) continue;
        char c;
        ssize_t size = read(STDIN_FILENO, &c, 1);
        if (size == 0 || (size < 0 && errno != EINTR)) return false;
        if (size == 1 && c == '\n') return true;
    }
    return false;
}

/* solver: NULL in the middle of a frame */
static void save_light(struct lw_daemon *d, const struct lw_solver *solver) {
    if (!d->settings.keep || lw_light_store_save(&d->light_store, solver, &d->solver_error) == LW_OK) return;
    lw_daemon_metrics_save_failed(&d->metrics);
}

static void solve_frames(struct lw_daemon *d) {
    const struct lw_daemon_settings *s = &d->settings;
    const uint64_t interval_ns = (uint64_t)(1e9 / s->frame_rate);
    bool rested = false;
    for (uint64_t frame = d->first; !should_stop(d) && (!s->frames || frame - d->first < (uint64_t)s->frames);
         frame++) {
        rest(d);
        if (s->clock == LW_DAEMON_CLOCK_MANUAL && !await_line(d)) break;
        lw_daemon_frames_expect(d);
        uint64_t began = lw_clock_ns();
        enum lw_status status = run_frame(d, frame, &rested, &d->solver_error);
        if (status != LW_OK) { /* LW_CLOSED, without an error: stopped in the middle of a frame */
            if (status == LW_CLOSED) save_light(d, NULL);
            return;
        }
        /* Under the step clock frames follow each other at once while there is work; at rest they keep the
         * pace. */
        if (s->clock == LW_DAEMON_CLOCK_REAL || (s->clock == LW_DAEMON_CLOCK_STEP && rested && !s->frames)) {
            rest(d);
            wait_until(d, began + interval_ns);
        }
    }
    lw_daemon_frames_expect(d);
    save_light(d, d->solver);
}

static void log_scene(const struct lw_daemon *d, uint64_t bytes) {
    char finishes[40] = "";
    if (d->finishes_size)
        snprintf(finishes, sizeof finishes, " and %.1f MB of finishes", (double)d->finishes_size * 1e-6);
    lw_log(LW_LOG_INFO, "%s: %u objects, %u tiles; %.0f MB for the solve, package %.1f MB%s",
           d->settings.scene.path, d->scene->object_count, d->atlas_map.tile_count, (double)bytes * 1e-6,
           (double)d->package_size * 1e-6, finishes);
}

/* Texels and rays' structure are built while clients already get the scene package. */
void *lw_daemon_frames_run(void *argument) {
    struct lw_daemon *d = argument;
    lw_daemon_give_way();
    if (d->solver || lw_daemon_set_up_solver(d, &d->solver_error) == LW_OK) {
        lw_daemon_metrics_memory(&d->metrics, lw_daemon_memory_bytes(d));
        lw_daemon_metrics_budget(&d->metrics, &d->memory);
        log_scene(d, lw_daemon_memory_bytes(d));
        d->first = 1;
        if (d->settings.keep) d->first += lw_light_store_resume(&d->light_store, &d->atlas_map, d->solver);
        if (!d->channels_kept || show_channels(d, d->channels_kept, &d->solver_error) == LW_OK)
            solve_frames(d);
    }
    rest(d);
    lw_server_stop(d->server);
    return NULL;
}
