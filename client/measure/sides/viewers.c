#include "client/measure/sides/viewers.h"

#include "common/base/clock.h"

#include <stdlib.h>
#include <string.h>

#define JOIN_S 300u /* for the package, which waits for nothing but the link */

void lw_viewers_init(struct lw_viewers *a, uint16_t port, uint32_t width, uint32_t height, unsigned threads,
                     bool wants_everything, bool unfiltered) {
    *a = (struct lw_viewers){.port = port,
                             .width = width,
                             .height = height,
                             .threads = threads,
                             .wants_everything = wants_everything,
                             .unfiltered = unfiltered};
}

/* The last one goes. */
static void leave(struct lw_viewers *a) {
    struct lw_viewers_user *user = &a->user[--a->count];
    lw_gl_renderer_destroy(user->gl);
    lw_attention_finish(&user->attention);
    lw_client_destroy(user->client);
}

void lw_viewers_finish(struct lw_viewers *a) {
    for (uint32_t i = 0; i < a->count; i++) { /* before what they draw goes */
        lw_gl_renderer_destroy(a->user[i].gl);
        a->user[i].gl = NULL;
    }
    lw_gl_offscreen_destroy(a->offscreen);
    lw_compose_destroy(a->compose);
    lw_client_lights_finish(&a->drawn);
    lw_trace_destroy(a->trace);
    if (a->scene) lw_pose_finish(&a->pose);
    while (a->count) leave(a); /* the first one, whose scene it is, goes last */
    free(a->user);
    *a = (struct lw_viewers){0};
}

struct lw_client_stats lw_viewers_stats(const struct lw_viewers *a, uint32_t user) {
    struct lw_client_stats stats;
    lw_client_get_stats(a->user[user].client, &stats);
    return stats;
}

/* All clients use the first client's scene. */
static enum lw_status set_stage(struct lw_viewers *a, struct lw_error *err) {
    const struct lw_scene *scene = lw_client_scene(a->user[0].client);
    enum lw_status status = lw_pose_init(&a->pose, scene);
    if (status != LW_OK) return lw_status_fail(err, status, "no memory for the scene's pose");
    a->scene = scene;
    status = lw_trace_create(scene, &a->pose, &a->trace, err);
    if (status != LW_OK) return status;
    status = lw_drawn_lights_init(&a->drawn, a->user[0].client);
    if (status != LW_OK) return lw_status_fail(err, status, "no memory for the lights of the view");
    status = lw_compose_create(&(struct lw_compose_desc){.scene = scene,
                                                         .map = lw_client_atlas_map(a->user[0].client),
                                                         .trace = a->trace,
                                                         .threads = a->threads,
                                                         .drawn = &a->drawn,
                                                         .pose = &a->pose,
                                                         .unfiltered = a->unfiltered},
                               &a->compose, err);
    return status == LW_OK && a->draws_by_gl ? lw_gl_offscreen_create(&a->offscreen, err) : status;
}

static enum lw_status set_gl(struct lw_viewers *a, struct lw_viewers_user *user, struct lw_error *err) {
    return lw_gl_renderer_create(&(struct lw_gl_renderer_desc){.scene = a->scene,
                                                               .map = lw_client_atlas_map(user->client),
                                                               .unfiltered = a->unfiltered,
                                                               .drawn = &a->drawn,
                                                               .trace = a->trace,
                                                               .pose = &a->pose},
                                 &user->gl, err);
}

static enum lw_status add_user(struct lw_viewers *a, struct lw_error *err) {
    struct lw_viewers_user user = {.looked_ns = 0};
    const struct lw_client_desc desc = {.host = "127.0.0.1",
                                        .port = a->port,
                                        .name = "lightwell-load scaling",
                                        .wants_nothing = !a->wants_everything,
                                        .draws_direct = a->draws_direct,
                                        .scene_of = a->count ? a->user[0].client : NULL};
    enum lw_status status = lw_client_create(&desc, &user.client, err);
    if (status != LW_OK) return status;
    a->user[a->count++] = user;
    for (uint64_t end_ns = lw_clock_ns() + JOIN_S * 1000000000ull; !lw_client_scene(user.client);) {
        status = lw_client_poll(user.client, 100, err);
        if (status != LW_OK) return status;
        if (lw_clock_ns() > end_ns)
            return lw_status_fail(err, LW_TIMED_OUT, "the scene has not arrived in %u s", JOIN_S);
    }
    status =
        lw_attention_init(&a->user[a->count - 1].attention, lw_client_atlas_map(user.client)->tile_count);
    if (status != LW_OK) return lw_status_fail(err, status, "no memory for a user's interest");
    if (a->count == 1) status = set_stage(a, err);
    return status == LW_OK && a->draws_by_gl ? set_gl(a, &a->user[a->count - 1], err) : status;
}

enum lw_status lw_viewers_set_count(struct lw_viewers *a, uint32_t count, struct lw_error *err) {
    if (count > a->capacity) {
        struct lw_viewers_user *grown = realloc(a->user, count * sizeof *grown);
        if (!grown) return lw_status_fail(err, LW_NO_MEMORY, "no memory for %u clients", count);
        a->user = grown;
        a->capacity = count;
    }
    while (a->count > count && a->count > 1) leave(a);
    while (a->count < count) {
        enum lw_status status = add_user(a, err);
        if (status != LW_OK) {
            lw_status_context(err, "user %u", a->count);
            return status;
        }
    }
    return LW_OK;
}

enum lw_status lw_viewers_follow(struct lw_viewers *a, struct lw_error *err) {
    bool moved = false;
    for (uint32_t o = 0; o < a->scene->object_count; o++) {
        const struct lw_affine *there = lw_client_object_to_world(a->user[0].client, o);
        moved |= memcmp(&a->pose.object_to_world[o], there, sizeof *there) != 0;
        a->pose.object_to_world[o] = *there;
    }
    lw_drawn_lights_follow(&a->drawn, a->user[0].client, &a->pose);
    return moved ? lw_trace_set_pose(a->trace, &a->pose, err) : LW_OK;
}

enum lw_status lw_viewers_forget(struct lw_viewers *a, uint32_t user, struct lw_error *err) {
    struct lw_viewers_user *u = &a->user[user];
    const uint32_t tiles = u->attention.tile_count;
    lw_attention_finish(&u->attention);
    u->looked_ns = 0;
    if (lw_attention_init(&u->attention, tiles) == LW_OK) return LW_OK;
    return lw_status_fail(err, LW_NO_MEMORY, "no memory for a user's interest");
}

static enum lw_status show_by_gl(struct lw_viewers *a, struct lw_gl_renderer *gl,
                                 const struct lw_compose_source *source, const struct lw_compose_view *view,
                                 float *out_rgb, struct lw_error *err) {
    enum lw_status status = lw_gl_renderer_take(gl, source, &a->pose, 0, 0, NULL, err);
    if (status == LW_OK) status = lw_gl_renderer_draw(gl, view, 1, err);
    return status == LW_OK ? lw_gl_renderer_read(gl, out_rgb, err) : status;
}

enum lw_status lw_viewers_show(struct lw_viewers *a, uint32_t user, const struct lw_camera_view *camera,
                               float *out_rgb, struct lw_error *err) {
    const struct lw_compose_source source = lw_compose_source_of(a->user[user].client);
    const struct lw_compose_view view = {.camera = *camera, .width = a->width, .height = a->height};
    struct lw_compose_report report;
    if (a->draws_by_gl) return show_by_gl(a, a->user[user].gl, &source, &view, out_rgb, err);
    lw_compose_render(a->compose, &source, &a->pose, &view, out_rgb, &report);
    return LW_OK;
}

enum lw_status lw_viewers_look(struct lw_viewers *a, uint32_t user, const struct lw_camera_view *camera,
                               uint64_t now_ns, struct lw_error *err) {
    struct lw_viewers_user *u = &a->user[user];
    if (a->wants_everything || (u->looked_ns && now_ns < u->looked_ns + LW_VIEWERS_LOOK_NS)) return LW_OK;
    const struct lw_compose_source source = lw_compose_source_of(u->client);
    const struct lw_compose_view view = {.camera = *camera, .width = a->width, .height = a->height};
    /* the survey before may be another user's: this one finds all that this user needs */
    lw_compose_survey(a->compose, &source, &a->pose, &view);
    lw_attention_list(&u->attention, lw_compose_around(a->compose), lw_compose_around(a->compose), now_ns);
    u->looked_ns = now_ns;
    enum lw_status status = lw_client_want(u->client, u->attention.list, u->attention.list_count);
    return status == LW_OK ? LW_OK : lw_status_fail(err, status, "no memory for a user's interest");
}
