/* lightwelld.c: the daemon. Reads a scene, lights it frame by frame in one thread, serves it from another.
 * Threads: main is the loop [loop]; see daemon.h. */
#include "common/base/clock.h"
#include "common/base/interrupt.h"
#include "common/base/log.h"
#include "common/base/wait_policy.h"
#include "common/trace/trace.h"
#include "server/daemon_frames.h"
#include "server/daemon_succession.h"
#include "server/serve/service_notify.h"

#include <malloc.h>
#include <signal.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/resource.h>
#include <unistd.h>

#define STATUS_MS   10000u
#define STOP_WAIT_S 3u        /* for the end of a frame */
#define MAPPED_MIN  (1 << 18) /* bytes of an array that is mapped by itself */

/* Signals before the loop watches for them: a handler can reach nothing but globals. */
static _Atomic bool signalled;

static void on_early_signal(int number) {
    (void)number;
    signalled = true;
}

/* ---- the server's hooks ---- */

/* [loop] A service manager starts a server again that does not say WATCHDOG=1. */
static void on_beat(void *context) {
    struct lw_daemon *d = context;
    struct lw_server_stats serve;
    lw_server_get_stats(d->server, &serve);
    if (lw_daemon_frames_stalled(d)) {
        if (!d->logged_stall) lw_log(LW_LOG_ERROR, "the solver has made no progress within --stall-limit");
        d->logged_stall = true;
        lw_service_notify("STATUS=the solver has made no progress within --stall-limit");
        return;
    }
    d->logged_stall = false;
    const unsigned long long frames = d->frame_count;
    const struct lw_waiting_state first_light = lw_waiting_read(&d->first_light);
    char waiting[LW_WAITING_LINE_SIZE];
    lw_waiting_line(first_light.stage, first_light.share, waiting);
    if (frames)
        lw_service_notify("WATCHDOG=1\nSTATUS=%llu frames, %llu sessions", frames,
                          (unsigned long long)serve.sessions_now);
    else
        lw_service_notify("WATCHDOG=1\nSTATUS=no light yet: %s; %llu sessions", waiting,
                          (unsigned long long)serve.sessions_now);
}

/* [loop] */
static void on_stopping(void *context) {
    struct lw_daemon *d = context;
    d->stops = true;
    if (d->succession.relays)
        lw_service_notify("WATCHDOG=1\nSTATUS=going over to what has changed");
    else
        lw_service_notify("STOPPING=1\nWATCHDOG=1\nSTATUS=stopping");
}

/* [loop] Light of the last run is light, too. */
static bool on_page(void *context, const char *path, struct lw_server_page *out_page) {
    struct lw_daemon *d = context;
    struct lw_server_stats serve;
    lw_server_get_stats(d->server, &serve);
    struct lw_nats_publisher_stats nats;
    if (d->nats) lw_nats_publisher_get_stats(d->nats, &nats);
    const struct lw_daemon_metrics_state state = {.nats = d->nats ? &nats : NULL,
                                                  .is_lit = d->lit || d->channels_kept,
                                                  .is_stalled = lw_daemon_frames_stalled(d),
                                                  .is_stopping = d->stops,
                                                  .first_light = lw_waiting_read(&d->first_light)};
    return lw_daemon_metrics_page(&d->metrics, path, &state, &serve, out_page);
}

static struct lw_server_hooks hooks_of(struct lw_daemon *d) {
    struct lw_server_hooks hooks = {
        .context = d, .stopping = on_stopping, .reload = lw_daemon_succession_reload, .page = on_page};
    if (lw_service_notify_wanted()) {
        const unsigned watchdog_ms = lw_service_notify_watchdog_ms();
        hooks.beat = on_beat;
        hooks.beat_ms = watchdog_ms && watchdog_ms < STATUS_MS ? watchdog_ms : STATUS_MS;
    }
    return hooks;
}

/* ---- serving ---- */

static unsigned count_suns(const struct lw_daemon *d) {
    unsigned suns = 0;
    for (uint32_t l = 0; l < d->client_lights.light_count; l++)
        suns += d->client_lights.light[l] && d->scene->light[l].kind == LW_LIGHT_DIRECTIONAL;
    return suns;
}

static void tell_client_lights(const struct lw_daemon *d) {
    const struct lw_client_lights *client = &d->client_lights;
    if (!lw_client_lights_any(client)) {
        lw_log(LW_LOG_INFO, "clients draw no direct light: all of it is in tiles");
        return;
    }
    const struct {
        const char *thing;
        unsigned count;
    } of[] = {{"sun", count_suns(d)},
              {"lamp", client->drawn_lights - count_suns(d)},
              {"emissive material", client->drawn_materials}};
    char text[128];
    int length = 0;
    for (size_t i = 0; i < sizeof of / sizeof *of; i++)
        if (of[i].count)
            length += snprintf(text + length, sizeof text - (size_t)length, "%s%u %s%s", length ? ", " : "",
                               of[i].count, of[i].thing, of[i].count == 1 ? "" : "s");
    lw_log(LW_LOG_INFO, "clients draw the direct light of %s, if they can", text);
}

/* Advice, after too little memory. */
static void explain_memory(const struct lw_daemon *d, struct lw_error *err) {
    uint64_t texels = 0, triangles = 0;
    struct rusage usage;
    if (err->status != LW_NO_MEMORY || getrusage(RUSAGE_SELF, &usage) != 0) return;
    for (uint32_t i = 0; i < d->atlas_map.tile_count; i++)
        if (d->atlas_map.place[i].level == 0)
            texels += (uint64_t)d->atlas_map.place[i].width * d->atlas_map.place[i].height;
    for (uint32_t o = 0; o < d->scene->object_count; o++)
        triangles += d->scene->mesh[d->scene->object[o].mesh].triangle_count;
    const struct lw_error cause = *err;
    *err = (struct lw_error){0};
    lw_status_fail(err, LW_NO_MEMORY,
                   "out of memory at %.0f MB (%s), with %llu texels and %llu triangles: fewer texels with "
                   "--max-texels %llu or --texels-per-metre, less for each with --light-groups none",
                   (double)usage.ru_maxrss * 1024e-6, cause.text, (unsigned long long)texels,
                   (unsigned long long)triangles, (unsigned long long)texels / 2);
}

/* Saved light is of a whole frame: one that ends soon is waited for; a longer one is given up, and the light
 * of the frame before it is saved, without sums. */
static void join_solver(struct lw_daemon *d) {
    const struct timespec until = lw_daemon_in_seconds(STOP_WAIT_S);
    d->cancel = !d->settings.keep || !d->lit;
    if (pthread_timedjoin_np(d->solver_thread, NULL, &until) == 0) return;
    lw_log(LW_LOG_INFO, "the frame under way is given up: it takes longer than %u s", STOP_WAIT_S);
    d->cancel = true;
    pthread_join(d->solver_thread, NULL);
}

static enum lw_status serve(struct lw_daemon *d, struct lw_error *err) {
    const struct lw_daemon_settings *s = &d->settings;
    enum lw_status status = lw_serve_options_write_ports(&s->serve, d->server, err);
    if (status != LW_OK) return status;
    char address[LW_SERVE_OPTIONS_WHERE_SIZE];
    lw_serve_options_where(&s->serve, d->server, address, sizeof address);
    lw_log(LW_LOG_INFO, "serving %s at %s", s->scene.path, address);
    tell_client_lights(d);
    const char *name = strrchr(d->argv[0], '/'); /* the viewer lies beside it */
    lw_log(LW_LOG_INFO, "look at it: %.*slightwell-view %s     stop it: Ctrl-C",
           name ? (int)(name + 1 - d->argv[0]) : 0, d->argv[0], address);
    lw_serve_options_tell(&s->serve, d->server);
    lw_daemon_frames_expect(d);
    if (pthread_create(&d->solver_thread, NULL, lw_daemon_frames_run, d) != 0) {
        lw_serve_options_remove_ports(&s->serve);
        return lw_status_fail(err, LW_OS, "cannot start the solver's thread");
    }
    lw_service_notify("READY=1\nSTATUS=serving at %s, no light yet", address);
    status = lw_server_run(d->server, err);
    d->stopping = true;
    join_solver(d);
    if (status == LW_OK && d->solver_error.status != LW_OK) {
        *err = d->solver_error;
        status = err->status;
    }
    if (status != LW_OK) explain_memory(d, err);
    if (!d->succession.relays) lw_serve_options_remove_ports(&s->serve);
    return status;
}

/* In the publisher's thread. */
static void on_relays_want(void *context, const struct lw_nats_publisher_wants *wants) {
    const struct lw_daemon *d = context;
    const struct lw_server_outside outside = {.channels = wants->channels,
                                              .everything = wants->everything,
                                              .tile = wants->tile,
                                              .tile_count = wants->tile_count,
                                              .fine = wants->fine,
                                              .fine_count = wants->fine_count};
    if (!lw_server_set_outside(d->server, &outside))
        lw_log(LW_LOG_WARNING, "out of memory for what relays want: they get what was wanted before");
}

/* In the publisher's thread. */
static void on_relays_report(void *context, const struct lw_relay_tree_node *node, uint32_t count) {
    const struct lw_daemon *d = context;
    lw_server_set_relays_outside(d->server, node, count);
}

/* follows: a server before it has served: then a failure ends nothing. */
static enum lw_status join_nats(struct lw_daemon *d, bool follows, struct lw_error *err) {
    const struct lw_daemon_settings *s = &d->settings;
    struct lw_server_scene scene;
    struct lw_error cause = {0};
    if (!s->nats) return LW_OK;
    enum lw_status status = lw_server_get_scene(d->server, &scene);
    if (status != LW_OK) return lw_status_fail(err, status, "out of memory");
    status = lw_nats_publisher_create(
        &(struct lw_nats_publisher_desc){.address = &s->nats_address,
                                         .trust = s->nats_trust,
                                         .map = &d->atlas_map,
                                         .object_count = d->scene->object_count,
                                         .light_count = d->scene->light_count,
                                         .channels = scene.channels,
                                         .run = scene.run,
                                         .welcome = scene.welcome,
                                         .chunk = scene.chunk,
                                         .chunk_count = scene.chunk_count,
                                         .finish_chunk = scene.finish_chunk,
                                         .finish_chunk_count = scene.finish_chunk_count,
                                         .wants = on_relays_want,
                                         .reports = on_relays_report,
                                         .context = d},
        &d->nats, &cause);
    lw_server_scene_finish(&scene);
    if (status == LW_OK)
        lw_log(LW_LOG_INFO, "relays find the light at %s", s->nats_address.name);
    else if (follows)
        lw_log(LW_LOG_ERROR, "relays find no light: --nats: %s", cause.text);
    else
        return lw_status_fail(err, status, "--nats: %s", cause.text);
    return LW_OK;
}

static enum lw_status run(struct lw_daemon *d, struct lw_error *err) {
    const struct lw_daemon_settings *s = &d->settings;
    d->started_ns = lw_clock_ns();
    lw_waiting_raise(&d->first_light, LW_WAITING_PLACING_TEXELS, 0, 0);
    const bool follows = d->server != NULL;
    if (!d->server) { /* it follows nobody */
        enum lw_status status = lw_daemon_read_scene(d, err);
        if (status != LW_OK) return status;
        /* Binds the port before the long work, so that an address in use fails at once. */
        if ((status = lw_daemon_create_server(d, NULL, err)) != LW_OK) return status;
    }
    enum lw_status status = join_nats(d, follows, err);
    if (status == LW_OK && s->keep) status = lw_daemon_restore_light(d, err);
    if (status != LW_OK) return status;
    if (signalled) return lw_status_fail(err, LW_CLOSED, "%s: stopped before it was lit", s->scene.path);
    return serve(d, err);
}

/* Arrays of a scene, which are large, are mapped by themselves and go back to the system with it. The C
 * library would raise that threshold to 32 MB as such arrays are freed, and later scenes would leave the heap
 * in pieces. */
static void map_large_arrays(void) {
    mallopt(M_MMAP_THRESHOLD, MAPPED_MIN);
    mallopt(M_TRIM_THRESHOLD, 8 * MAPPED_MIN); /* what frames free is not given back each time */
}

int main(int argc, char **argv) {
    map_large_arrays();
    struct lw_daemon *d = malloc(sizeof *d);
    struct lw_error err = {0};
    bool done = false, left = false;
    lw_log_init("lightwelld", LW_LOG_INFO);
    lw_wait_passively(argv);
    if (!d) return lw_log_failure(&(struct lw_error){.status = LW_NO_MEMORY});
    lw_daemon_init(d, argc, argv, &signalled);
    d->hooks = hooks_of(d);
    enum lw_status status = lw_daemon_settings_parse(&d->settings, argc, argv, &done, &err);
    if (status == LW_OK) { /* a mistake in the options is reported as text */
        lw_log_init("lightwelld", (enum lw_log_level)d->settings.log_level);
        lw_log_set_format((enum lw_log_format)d->settings.log_format);
    }
    if (status == LW_OK && !done) status = lw_trace_check_isa(&d->isa, &err); /* before anybody is served */
    if (status == LW_OK && !done) {
        lw_interrupt_watch(on_early_signal, NULL);
        /* Until the loop watches for it: a request to read again while we read must not end us. A
         * terminal that closes still does. */
        if (!isatty(STDERR_FILENO)) signal(SIGHUP, SIG_IGN);
        lw_daemon_metrics_init(&d->metrics, d->isa, d->settings.entry->name);
        d->metrics.renderers = d->settings.renderers;
        status = run(d, &err);
        for (struct lw_daemon *next; (next = lw_daemon_succession_take(d, status == LW_OK, &left)) != NULL;) {
            lw_daemon_finish(d);
            free(d);
            malloc_trim(0); /* else memory that each scene leaves free in pieces adds up */
            d = next;
            status = run(d, &err);
        }
        if (status == LW_CLOSED) status = LW_OK; /* stopped by a signal before it served */
        if (status == LW_OK) lw_log(LW_LOG_INFO, "stopped");
    }
    if (left) /* the process ends, and with it that thread */
        _exit(status == LW_OK ? 0 : lw_log_failure(&err));
    lw_daemon_finish(d);
    free(d);
    return status == LW_OK ? 0 : lw_log_failure(&err);
}
