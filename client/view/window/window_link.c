#include "client/view/window/window_link.h"

#include "client/paths/camera_default.h"
#include "client/view/window/window_compare.h"
#include "client/view/window/window_panels.h"
#include "client/view/window/window_screen.h"
#include "common/base/host_port.h"
#include "common/base/log.h"

#include <stdio.h>
#include <string.h>

#define CLIENT_NAME   "lightwell-view"
#define CONNECT_MS    5000u
#define KEYS_SHOWN_NS 20000000000u /* after the first picture, unless somebody presses a key before */

static void drop_incoming(struct lw_window *w) {
    lw_client_destroy(w->incoming);
    w->incoming = NULL;
}

static void seek_again(struct lw_window *w, const struct lw_client *lost, const struct lw_error *err) {
    lw_log(LW_LOG_WARNING, "%s; looking for the server again", err->text);
    lw_seeker_start(w->seeker, lw_client_retry_after_ms(lost));
}

/* Chooses the camera of a new scene. first: the command line's camera counts */
static enum lw_status choose_start(struct lw_window *w, bool first, struct lw_error *err) {
    const struct lw_scene *scene = w->stage.scene;
    uint32_t camera = 0;
    if (first && w->options->camera_name != NULL) {
        enum lw_status status = lw_camera_find(scene, w->options->camera_name, &camera, err);
        if (status != LW_OK) return status;
    }
    if (first && w->options->camera_given)
        w->start = w->options->camera;
    else if (camera < scene->camera_count)
        w->start = lw_camera_of_scene(scene, &w->stage.pose, camera);
    else
        w->start = lw_camera_default(scene, &w->stage.pose, w->stage.trace,
                                     w->height > 0 ? (float)w->width / (float)w->height : 1);
    w->next_camera = scene->camera_count > 1 ? camera + 1 : 0;
    struct lw_vec3 low, high;
    float high_m = 0;
    w->size_m = 0;
    if (lw_pose_bounds(&w->stage.pose, scene, &low, &high)) {
        w->size_m = lw_vec3_length(lw_vec3_sub(high, low));
        high_m = high.y - low.y;
    }
    lw_steering_start(&w->steering, &w->start, w->size_m, high_m);
    lw_window_touch(w);
    return LW_OK;
}

/* Shows the incoming client in place of the current one. */
static enum lw_status stage_incoming(struct lw_window *w, struct lw_error *err) {
    const bool first = !w->staged;
    const bool other = first || memcmp(lw_client_package_hash(w->client), lw_client_package_hash(w->incoming),
                                       LW_CLIENT_HASH_SIZE) != 0;
    bool moved;
    struct lw_stage stage;
    enum lw_status status = lw_stage_init(&stage, w->incoming, w->options->threads, err);
    if (status != LW_OK) return status;
    status = lw_stage_follow(&stage, &moved, err);
    if (status != LW_OK) {
        lw_stage_finish(&stage);
        return status;
    }
    lw_window_compare_stop(w); /* it looks at that scene; the next picture begins again */
    lw_gl_view_finish(&w->gl);
    stage.mirrors = w->options->mirrors;
    lw_stage_finish(&w->stage);
    lw_client_destroy(w->client);
    w->stage = stage;
    w->client = w->incoming;
    w->incoming = NULL;
    w->lost = false;
    w->staged = w->stale = true;
    w->seen_tiles = w->seen_frame = w->figures.bytes = 0;
    lw_seeker_reset(w->seeker);
    if (w->screen.context != NULL && lw_gl_view_init(&w->gl, &w->stage, false, err) != LW_OK) {
        status = lw_window_screen_leave_gl(w, err);
        if (status != LW_OK) return status;
    }
    if (!first) lw_log(LW_LOG_INFO, "%s: connected again%s", w->address, other ? ", to another scene" : "");
    if (!first && other) lw_window_panels_notify(w, "the scene is another one");
    if (first && w->show_keys) w->keys_until_ns = lw_clock_ns() + KEYS_SHOWN_NS;
    return other ? choose_start(w, first, err) : LW_OK;
}

static bool is_ready(const struct lw_window *w, struct lw_client *client) {
    struct lw_client_stats stats;
    lw_client_get_stats(client, &stats);
    /* The old light stays until the new server's first light is there. */
    return lw_client_scene(client) != NULL && (!w->staged || stats.first_ns != 0);
}

enum lw_status lw_window_link_incoming(struct lw_window *w, struct lw_error *err) {
    if (w->seeker == NULL) return LW_OK; /* a server of our own is not there yet */
    if (w->incoming == NULL) w->incoming = lw_seeker_take(w->seeker);
    if (w->incoming == NULL) return LW_OK;
    struct lw_error lost = {0};
    if (lw_client_poll(w->incoming, 0, &lost) != LW_OK) {
        seek_again(w, w->incoming, &lost);
        drop_incoming(w);
        return LW_OK;
    }
    if (!is_ready(w, w->incoming)) return LW_OK;
    if (!w->staged) lw_window_panels_message(w, "building the scene", 1);
    return stage_incoming(w, err);
}

enum lw_status lw_window_link_shown(struct lw_window *w, struct lw_error *err) {
    if (!w->staged) return LW_OK;
    struct lw_error lost = {0};
    if (!w->lost && lw_client_poll(w->client, 0, &lost) != LW_OK) {
        w->lost = true;
        seek_again(w, w->client, &lost);
    }
    struct lw_client_stats stats;
    lw_client_get_stats(w->client, &stats);
    if (stats.tiles != w->seen_tiles || stats.finishes_ns != w->seen_finishes_ns) w->stale = true;
    w->seen_finishes_ns = stats.finishes_ns;
    /* a chart of tiles shows their age and the interest set, which change without a message */
    if (lw_show_is_of_tiles(w->picture.show) && lw_clock_ns() - w->coloured_ns > LW_WINDOW_FIGURES_EVERY_NS) {
        w->coloured_ns = lw_clock_ns();
        w->stale = true;
    }
    if (stats.frame == w->seen_frame && stats.tiles == w->seen_tiles) return LW_OK;
    w->seen_tiles = stats.tiles;
    w->seen_frame = stats.frame;
    bool moved;
    enum lw_status status = lw_stage_follow(&w->stage, &moved, err);
    if (status == LW_OK && moved) {
        w->scene_changed = true;
        lw_window_touch(w);
    }
    return status;
}

enum lw_status lw_window_link_connect(struct lw_window *w, uint16_t port, struct lw_error *err) {
    const struct lw_view_options *o = w->options;
    lw_host_port_format(w->address, sizeof w->address, o->host, port);
    enum lw_status status = lw_seeker_create(o->host, port, &o->access, CLIENT_NAME, o->cache_folder,
                                             o->draws_direct, &w->seeker, err);
    if (status != LW_OK) return status;
    return lw_seeker_connect(w->seeker, CONNECT_MS, &w->incoming, err);
}

enum lw_status lw_window_link_await(struct lw_window *w, struct lw_error *err) {
    uint16_t port = 0;
    if (w->importing_ns == 0) return LW_OK;
    enum lw_status status = lw_own_server_poll(w->server, &port, err);
    if (status != LW_OK || port == 0) return status;
    w->importing_ns = 0;
    return lw_window_link_connect(w, port, err);
}
