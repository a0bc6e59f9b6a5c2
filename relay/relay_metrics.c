#include "relay/relay_metrics.h"

#include "server/serve/metrics/serve_metrics.h"

#include <stdio.h>
#include <string.h>

static bool is_ready(const struct lw_relay_stats *relay, const struct lw_relay_metrics_state *state) {
    return relay->has_light && !state->is_stopping;
}

static void write_upstream(struct lw_exposition *e, const struct lw_relay_stats *relay) {
    char address[350], labels[380];
    lw_exposition_escape(address, sizeof address, relay->address);
    snprintf(labels, sizeof labels, "address=\"%s\"", address);
    lw_exposition_metric(e, "lightwell_upstream_connected", "gauge",
                         "1: there is a server above, which is named.");
    lw_exposition_sample(e, "lightwell_upstream_connected", labels, relay->is_connected);
    lw_exposition_gauge(
        e, "lightwell_upstream_lost_seconds", (double)relay->lost_ns * 1e-9,
        "How long there has been no server above: clients have the light of then. 0: there is "
        "one, or there was none yet.");
    lw_exposition_counter(e, "lightwell_upstream_connects_total", (double)relay->connects,
                          "Sessions with a server above that began.");
    lw_exposition_counter(e, "lightwell_upstream_failures_total", (double)relay->failures,
                          "Attempts at one that failed.");
    lw_exposition_counter(e, "lightwell_upstream_received_bytes_total", (double)relay->bytes_received,
                          "Bytes that came from servers above.");
    lw_exposition_counter(e, "lightwell_upstream_received_tiles_total", (double)relay->tiles_received,
                          "Tiles that came from servers above.");
    lw_exposition_counter(e, "lightwell_passed_updates_total", (double)relay->updates_passed,
                          "Updates of clients that were passed on.");
    lw_exposition_counter(e, "lightwell_snapshots_total", (double)relay->snapshots,
                          "Times that new light was handed to sessions.");
    lw_exposition_gauge(e, "lightwell_frame", (double)relay->frame, "Number of the newest frame.");
    lw_exposition_gauge(e, "lightwell_interest_tiles", (double)relay->interest_tiles,
                        "Tiles that clients list, all of them together.");
    lw_exposition_gauge(
        e, "lightwell_interest_everything", relay->wants_everything,
        "1: every tile is wanted: a client wants it, or clients list more than a message holds.");
}

static enum lw_status write_all(const struct lw_relay_stats *relay,
                                const struct lw_relay_metrics_state *state,
                                const struct lw_server_stats *serve, struct lw_server_page *out_page) {
    struct lw_exposition e;
    enum lw_status status = lw_exposition_begin(&e);
    if (status != LW_OK) return status;
    lw_exposition_metric(&e, "lightwell_relay_info", "gauge", "Always 1: the version.");
    lw_exposition_sample(&e, "lightwell_relay_info", "version=\"" LW_VERSION "\"", 1);
    lw_exposition_gauge(&e, "lightwell_ready", is_ready(relay, state),
                        "1: clients get light; what /readyz says.");
    lw_exposition_gauge(&e, "lightwell_waiting_stage", state->first_light.stage,
                        "What the server above says that its first light waits for; 4: nothing.");
    lw_exposition_gauge(&e, "lightwell_waiting_share", (double)state->first_light.share,
                        "How much of that is done, 0 to 1.");
    write_upstream(&e, relay);
    lw_serve_metrics_sessions(&e, serve);
    lw_exposition_metric(&e, "lightwell_cpu_seconds_total", "counter", "CPU time by stage.");
    lw_exposition_sample(&e, "lightwell_cpu_seconds_total", "stage=\"relay\"", (double)relay->cpu_ns * 1e-9);
    lw_exposition_sample(&e, "lightwell_cpu_seconds_total", "stage=\"serve\"",
                         (double)serve->loop_cpu_ns * 1e-9);
    lw_serve_metrics_process(&e, state->started_s);
    return lw_exposition_end(&e, &out_page->text, &out_page->size);
}

/* Light stays while there is no server above, and its age is reported. */
static bool ready_page(const struct lw_relay_stats *relay, const struct lw_relay_metrics_state *state,
                       struct lw_server_page *out_page) {
    char line[LW_WAITING_LINE_SIZE], text[LW_WAITING_LINE_SIZE + 64];
    if (state->is_stopping) return lw_serve_metrics_plain(out_page, 503, "stopping\n");
    if (!relay->has_light) {
        lw_waiting_line(state->first_light.stage, state->first_light.share, line);
        snprintf(text, sizeof text, "no light yet: %s\n", line);
        return lw_serve_metrics_plain(out_page, 503, text);
    }
    snprintf(text, sizeof text, "no server above for %.0f s: the light is of then\n",
             (double)relay->lost_ns * 1e-9);
    return lw_serve_metrics_plain(out_page, 200, relay->lost_ns ? text : "ok\n");
}

bool lw_relay_metrics_page(const struct lw_relay_stats *relay, const struct lw_relay_metrics_state *state,
                           const struct lw_server_stats *serve, const char *path,
                           struct lw_server_page *out_page) {
    if (strcmp(path, "/healthz") == 0) return lw_serve_metrics_plain(out_page, 200, "ok\n");
    if (strcmp(path, "/readyz") == 0) return ready_page(relay, state, out_page);
    if (strcmp(path, "/metrics") != 0) return false;
    *out_page = (struct lw_server_page){.status = 200, .type = LW_EXPOSITION_TYPE};
    return write_all(relay, state, serve, out_page) == LW_OK;
}
