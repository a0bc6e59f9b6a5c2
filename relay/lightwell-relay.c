/* lightwell-relay.c: a server without a solver: forwards the light of another server.
 * Threads: main is the loop of the server [loop]; relay.h has a thread that talks to the server above. They
 *          share the server's hand-over, nothing else. */
#include "common/base/clock.h"
#include "common/base/folders.h"
#include "common/base/host_port.h"
#include "common/base/interrupt.h"
#include "common/base/log.h"
#include "common/base/options_config.h"
#include "proto/nats_wire.h"
#include "relay/relay.h"
#include "relay/relay_metrics.h"
#include "server/serve/serve_options.h"
#include "server/serve/service_notify.h"

#include <errno.h>
#include <limits.h>
#include <signal.h>
#include <stdatomic.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <time.h>
#include <unistd.h>

#define STATUS_MS 10000u
#define WAIT_MS   100u /* between two looks at what a signal says */

/* What makes no sense in a file or in the environment; variables that clients read. */
static const char *const command_only[] = {"config", "check-config", "print-config", NULL};
static const char *const client_variables[] = {"token", NULL};

struct settings {
    struct lw_options_config config;
    const char *upstream, *updates;
    struct lw_serve_options serve;
    struct lw_access_options access_options;
    struct lw_access access;
    const char *cache;
    int log_format, log_level;
    char default_cache[1024];
    struct lw_relay_address address[LW_RELAY_UPSTREAMS_MAX], updates_address;
    uint32_t address_count;
};

struct program {
    struct settings settings;
    struct lw_relay *relay;
    struct lw_server *server; /* for the scene that there is */
    struct lw_server_sockets sockets;
    bool hands_over, stops, announced; /* the last: it has reported where it serves */
    double started_s;
};

/* Signals while no server watches for them: a handler can reach nothing but globals. */
static _Atomic bool signalled;

static void on_early_signal(int number) {
    (void)number;
    signalled = true;
}

/* ---- options ---- */

static enum lw_status parse_upstreams(struct settings *s, struct lw_error *err) {
    char text[512];
    struct lw_nats_wire_address nats;
    const char *at = s->upstream;
    while (at) {
        const char *comma = strchr(at, ',');
        const size_t length = comma ? (size_t)(comma - at) : strlen(at);
        if (s->address_count == LW_RELAY_UPSTREAMS_MAX)
            return lw_status_fail(err, LW_USAGE, "UPSTREAM: at most %u servers", LW_RELAY_UPSTREAMS_MAX);
        if (length >= sizeof text) return lw_status_fail(err, LW_USAGE, "UPSTREAM: an address is too long");
        memcpy(text, at, length);
        text[length] = '\0';
        struct lw_relay_address *address = &s->address[s->address_count++];
        enum lw_status status = LW_OK;
        if (!lw_nats_wire_is_address(text))
            status = lw_access_address(text, address->host, sizeof address->host, &address->port, err);
        else if ((status = lw_nats_wire_address(text, &nats, err)) == LW_OK && length < sizeof address->host)
            strcpy(address->host, text);
        else if (status == LW_OK)
            status = lw_status_fail(err, LW_USAGE, "an address is too long");
        if (status != LW_OK) {
            lw_status_context(err, "UPSTREAM");
            return status;
        }
        at = comma ? comma + 1 : NULL;
    }
    return LW_OK;
}

static enum lw_status parse_updates(struct settings *s, struct lw_error *err) {
    struct lw_relay_address *a = &s->updates_address;
    if (!s->updates) return LW_OK;
    enum lw_status status = lw_access_address(s->updates, a->host, sizeof a->host, &a->port, err);
    if (status != LW_OK) lw_status_context(err, "--updates");
    return status;
}

/* Who asks for TLS gets none of it by an address of NATS in plain. */
static enum lw_status check_plain(const struct settings *s, struct lw_error *err) {
    struct lw_nats_wire_address nats;
    for (uint32_t i = 0; s->access.tls.wanted && i < s->address_count; i++) {
        if (!lw_nats_wire_is_address(s->address[i].host)) continue;
        enum lw_status status = lw_nats_wire_address(s->address[i].host, &nats, err);
        if (status != LW_OK) return status;
        if (!nats.tls)
            return lw_status_fail(
                err, LW_USAGE,
                "UPSTREAM: %s is in plain, and --tls, --ca and --tls-insecure are for TLS: write tls://",
                nats.name);
    }
    return LW_OK;
}

static enum lw_status print_config(const struct settings *s, const struct lw_options *options,
                                   struct lw_error *err) {
    char *text = lw_options_config_print(&s->config, options);
    if (!text) return lw_status_fail(err, LW_NO_MEMORY, "out of memory");
    const bool written = fputs(text, stdout) >= 0 && fflush(stdout) == 0;
    free(text);
    return written ? LW_OK : lw_status_fail(err, LW_IO, "standard output: %s", strerror(errno));
}

static enum lw_status parse(struct settings *s, int argc, char **argv, bool *out_done, struct lw_error *err) {
    const char *upstream[1] = {NULL};
    const struct lw_option table[] = {
        LW_SERVE_OPTIONS(&s->serve),
        LW_ACCESS_OPTIONS(&s->access_options),
        {"updates", "HOST[:PORT]",
         "the server that takes the changes of clients, where UPSTREAM is NATS, which carries light alone: "
         "the lightwelld that publishes the light; unix:PATH, too (default: UPSTREAM)",
         LW_OPTION_STRING, &s->updates, 0, 0, NULL},
        {"cache", "FOLDER",
         "keep scene packages there, so that none is downloaded twice; \"\": nowhere "
         "(default $XDG_CACHE_HOME/lightwell or ~/.cache/lightwell)",
         LW_OPTION_STRING, &s->cache, 0, 0, NULL},
        LW_OPTIONS_CONFIG(&s->config),
        LW_LOG_OPTIONS(&s->log_format, &s->log_level),
    };
    const struct lw_options options = {
        .program = "lightwell-relay",
        .synopsis = "UPSTREAM[,UPSTREAM...] [OPTIONS]",
        .about = "Forwards the light of a lightwelld, or of another relay, to clients of its own. It solves "
                 "nothing, and clients notice no difference.\n"
                 "UPSTREAM is HOST[:PORT], unix:PATH, nats://HOST:PORT[/SCENE] or tls://HOST:PORT[/SCENE], "
                 "which is NATS by TLS. Of several, the next one "
                 "is tried when one is gone; "
                 "clients keep their light meanwhile.",
        .table = table,
        .count = sizeof table / sizeof table[0],
        .positional = upstream,
        .positional_min = 1,
        .positional_max = 1};
    s->config = (struct lw_options_config){.prefix = "LIGHTWELL",
                                           .positional = "upstream",
                                           .command = command_only,
                                           .foreign = client_variables};
    enum lw_status status = lw_options_config_parse(&s->config, &options, argc, argv, out_done, err);
    if (status != LW_OK || *out_done) return status;
    s->upstream = upstream[0];
    status = parse_upstreams(s, err);
    if (status == LW_OK) status = parse_updates(s, err);
    if (status == LW_OK) status = lw_serve_options_check(&s->serve, err);
    if (status == LW_OK) status = lw_access_read(&s->access_options, &s->access, err);
    if (status == LW_OK) status = check_plain(s, err);
    if (status != LW_OK) return status;
    *out_done = s->config.check || s->config.print;
    if (s->config.check) lw_log(LW_LOG_INFO, "the options are good");
    return s->config.print ? print_config(s, &options, err) : LW_OK;
}

/* ---- hooks of the server; all [loop] ---- */

static void on_news(void *context) {
    const struct program *p = context;
    lw_relay_wake(p->relay);
}

static bool on_page(void *context, const char *path, struct lw_server_page *out_page) {
    const struct program *p = context;
    struct lw_server_stats serve;
    struct lw_relay_stats relay;
    lw_server_get_stats(p->server, &serve);
    lw_relay_get_stats(p->relay, &relay);
    const struct lw_relay_metrics_state state = {.started_s = p->started_s,
                                                 .is_stopping = p->stops,
                                                 .first_light = lw_waiting_read(lw_relay_waiting(p->relay))};
    return lw_relay_metrics_page(&relay, &state, &serve, path, out_page);
}

static void on_beat(void *context) {
    const struct program *p = context;
    struct lw_server_stats serve;
    struct lw_relay_stats relay;
    lw_server_get_stats(p->server, &serve);
    lw_relay_get_stats(p->relay, &relay);
    if (relay.lost_ns)
        lw_service_notify("WATCHDOG=1\nSTATUS=no server above for %.0f s, %llu sessions",
                          (double)relay.lost_ns * 1e-9, (unsigned long long)serve.sessions_now);
    else
        lw_service_notify("WATCHDOG=1\nSTATUS=light from %s, %llu sessions", relay.address,
                          (unsigned long long)serve.sessions_now);
}

/* While it still listens: no connection is refused in between. */
static void on_stopping(void *context) {
    struct program *p = context;
    struct lw_error err = {0};
    p->hands_over = lw_relay_has_next(p->relay) && !lw_server_was_signalled(p->server);
    if (p->hands_over && lw_server_share_sockets(p->server, &p->sockets, &err) != LW_OK) {
        lw_log(LW_LOG_ERROR, "%s", err.text);
        p->hands_over = false;
    }
    p->stops = !p->hands_over;
    if (p->stops) lw_service_notify("STOPPING=1\nWATCHDOG=1\nSTATUS=stopping");
}

static void on_reload(void *context) {
    const struct program *p = context;
    lw_server_reload(p->server);
}

/* ---- serving ---- */

static enum lw_status create_server(struct program *p, const struct lw_relay_scene *scene,
                                    struct lw_error *err) {
    uint64_t above[LW_MESSAGE_RELAYS_MAX];
    struct lw_server_desc desc = {
        .sockets = p->hands_over ? &p->sockets : NULL,
        .atlas_map = lw_relay_light_map(scene->light),
        .package = scene->package,
        .package_size = scene->package_size,
        .finishes = scene->finishes,
        .finishes_size = scene->finishes_size,
        .name = "lightwell-relay " LW_VERSION,
        .run = scene->welcome.run,
        .bounces = scene->welcome.bounces,
        .target_error = scene->welcome.target_error,
        .noise_shown = scene->welcome.noise_shown,
        .features = scene->welcome.features,
        .channels = scene->welcome.has_directions ? 1u << LW_TILE_CHANNEL_DIRECTION : 0,
        .client_lights = scene->welcome.client_lights,
        .client_lights_size = scene->welcome.client_lights_size,
        .client_materials = scene->welcome.client_materials,
        .client_materials_size = scene->welcome.client_materials_size,
        .first_light = lw_relay_waiting(p->relay),
        .relay = lw_relay_number(p->relay),
        .relays_above = above,
        .hooks = {
            .context = p, .news = on_news, .stopping = on_stopping, .reload = on_reload, .page = on_page}};
    desc.relays_above_count = lw_relay_above(p->relay, above);
    if (lw_service_notify_wanted()) {
        const unsigned watchdog_ms = lw_service_notify_watchdog_ms();
        desc.hooks.beat = on_beat;
        desc.hooks.beat_ms = watchdog_ms && watchdog_ms < STATUS_MS ? watchdog_ms : STATUS_MS;
    }
    lw_serve_options_fill(&p->settings.serve, &desc);
    return lw_server_create(&desc, &p->server, err);
}

static enum lw_status announce(struct program *p, const struct lw_relay_scene *scene, struct lw_error *err) {
    const struct settings *s = &p->settings;
    char address[LW_SERVE_OPTIONS_WHERE_SIZE];
    struct lw_relay_stats stats; /* the address there has no password */
    if (p->announced) return LW_OK;
    lw_relay_get_stats(p->relay, &stats);
    enum lw_status status = lw_serve_options_write_ports(&s->serve, p->server, err);
    if (status != LW_OK) return status;
    p->announced = true;
    lw_serve_options_where(&s->serve, p->server, address, sizeof address);
    lw_log(LW_LOG_INFO, "serving the light of %s at %s: %u objects, %u tiles", stats.address, address,
           lw_relay_light_scene(scene->light)->object_count, lw_relay_light_map(scene->light)->plain_count);
    lw_serve_options_tell(&s->serve, p->server);
    lw_service_notify("READY=1\nSTATUS=serving at %s", address);
    return LW_OK;
}

/* The name of the relay in a tree: its address. 0.0.0.0 and [::] are those of any machine: its name is in
 * their place. */
static void name_relay(const struct program *p, char *dst, size_t size) {
    const struct lw_serve_options *o = &p->settings.serve;
    char host[HOST_NAME_MAX + 1];
    lw_serve_options_where(o, p->server, dst, size);
    const bool is_any = !o->listen_unix && (strcmp(o->host, "0.0.0.0") == 0 || strcmp(o->host, "::") == 0);
    if (is_any && gethostname(host, sizeof host) == 0)
        lw_host_port_format(dst, size, host, lw_server_port(p->server));
}

/* Until it is to end, or another scene is there. */
static enum lw_status run_server(struct program *p, const struct lw_relay_scene *scene,
                                 struct lw_error *err) {
    enum lw_status status = create_server(p, scene, err);
    lw_server_sockets_close(&p->sockets);
    p->hands_over = false;
    if (status == LW_OK) status = announce(p, scene, err);
    if (status == LW_OK) {
        char name[LW_SERVE_OPTIONS_WHERE_SIZE];
        name_relay(p, name, sizeof name);
        lw_relay_serve(p->relay, p->server, name);
        status = lw_server_run(p->server, err);
        lw_relay_leave(p->relay);
    }
    lw_server_destroy(p->server);
    p->server = NULL;
    return status;
}

static enum lw_status run(struct program *p, struct lw_error *err) {
    const struct settings *s = &p->settings;
    const struct lw_relay_desc desc = {.upstream = s->address,
                                       .upstream_count = s->address_count,
                                       .updates = s->updates ? &s->updates_address : NULL,
                                       .access = &s->access,
                                       .cache_folder = *s->cache ? s->cache : NULL};
    enum lw_status status = lw_relay_create(&desc, &p->relay, err);
    lw_interrupt_watch(on_early_signal, NULL);
    for (bool ends = false; status == LW_OK && !ends && !signalled;) {
        const struct lw_relay_scene *scene = lw_relay_next_scene(p->relay, WAIT_MS);
        if (!scene) continue;
        status = run_server(p, scene, err);
        lw_interrupt_watch(on_early_signal, NULL); /* the server had its own watchers */
        ends = !p->hands_over;
    }
    if (p->announced) lw_serve_options_remove_ports(&s->serve);
    lw_server_sockets_close(&p->sockets);
    lw_relay_destroy(p->relay);
    return status;
}

int main(int argc, char **argv) {
    struct program *p = malloc(sizeof *p);
    struct lw_error err = {0};
    bool done = false;
    lw_log_init("lightwell-relay", LW_LOG_INFO);
    if (!p) return lw_log_failure(&(struct lw_error){.status = LW_NO_MEMORY});
    *p = (struct program){.sockets = {-1, -1, -1},
                          .started_s = (double)lw_clock_read_ns(CLOCK_REALTIME) * 1e-9,
                          .settings = {.serve = LW_SERVE_OPTIONS_DEFAULTS, .log_level = LW_LOG_INFO}};
    (void)lw_folders_cache(p->settings.default_cache, sizeof p->settings.default_cache);
    p->settings.cache = p->settings.default_cache;
    enum lw_status status = parse(&p->settings, argc, argv, &done, &err);
    if (status == LW_OK) { /* a mistake in the options is reported as text */
        lw_log_init("lightwell-relay", (enum lw_log_level)p->settings.log_level);
        lw_log_set_format((enum lw_log_format)p->settings.log_format);
    }
    if (status == LW_OK && !done) {
        /* Until a server watches for it: who asks to read files again must not end us. */
        if (!isatty(STDERR_FILENO)) signal(SIGHUP, SIG_IGN);
        signal(SIGPIPE, SIG_IGN);
        status = run(p, &err);
        if (status == LW_OK) lw_log(LW_LOG_INFO, "stopped");
    }
    lw_options_config_finish(&p->settings.config);
    free(p);
    return status == LW_OK ? 0 : lw_log_failure(&err);
}
