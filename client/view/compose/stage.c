#include "client/view/compose/stage.h"

#include "common/base/clock.h"

#include <stdlib.h>
#include <string.h>

#define LOOK_NS 100000000u /* from one look around to the next */

enum lw_status lw_stage_init(struct lw_stage *stage, struct lw_client *client, unsigned threads,
                             struct lw_error *err) {
    *stage = (struct lw_stage){.client = client, .scene = lw_client_scene(client)};
    enum lw_status status = lw_pose_init(&stage->pose, stage->scene);
    if (status != LW_OK) {
        *stage = (struct lw_stage){0};
        return lw_status_fail(err, status, "no memory for the scene's pose");
    }
    status = lw_trace_create(stage->scene, &stage->pose, &stage->trace, err);
    if (status != LW_OK) goto fail;
    status = lw_drawn_lights_init(&stage->drawn, client);
    if (status != LW_OK) {
        lw_status_fail(err, status, "no memory for the lights of the view");
        goto fail;
    }
    status = lw_compose_create(&(struct lw_compose_desc){.scene = stage->scene,
                                                         .map = lw_client_atlas_map(client),
                                                         .trace = stage->trace,
                                                         .threads = threads,
                                                         .drawn = &stage->drawn,
                                                         .pose = &stage->pose},
                               &stage->compose, err);
    if (status != LW_OK) goto fail;
    status = lw_attention_init(&stage->attention, lw_client_atlas_map(client)->tile_count);
    if (status != LW_OK) {
        lw_status_fail(err, status, "no memory for the view");
        goto fail;
    }
    return LW_OK;
fail:
    lw_stage_finish(stage);
    return status;
}

void lw_stage_finish(struct lw_stage *stage) {
    free(stage->tile_colour);
    lw_attention_finish(&stage->attention);
    lw_compose_destroy(stage->compose);
    lw_client_lights_finish(&stage->drawn);
    lw_trace_destroy(stage->trace);
    if (stage->scene != NULL) lw_pose_finish(&stage->pose);
    *stage = (struct lw_stage){0};
}

/* Whether an object of the scene that has no motion of its own was moved. The server computes its place as we
 * do, perhaps on another machine, which may round otherwise. */
static bool is_elsewhere(const struct lw_affine *a, const struct lw_affine *b) {
    for (int i = 0; i < 3; i++)
        for (int j = 0; j < 4; j++)
            if (fabsf(a->m[i][j] - b->m[i][j]) > 1e-6f * (fabsf(a->m[i][j]) + fabsf(b->m[i][j])) + 1e-9f)
                return true;
    return false;
}

/* Takes over where objects are; whether that changes the picture. */
static bool take_objects(struct lw_stage *stage) {
    struct lw_pose *pose = &stage->pose;
    bool moved = false;
    for (uint32_t o = 0; o < stage->scene->object_count; o++) {
        const struct lw_affine *there = lw_client_object_to_world(stage->client, o);
        const bool hidden = lw_client_object_hidden(stage->client, o);
        if (lw_pose_object_moves(pose, stage->scene, o)) {
            moved |=
                memcmp(&pose->object_to_world[o], there, sizeof *there) || hidden != pose->object_hidden[o];
        } else if (hidden || is_elsewhere(&pose->object_to_world[o], there)) {
            pose->object_dynamic[o] = true;
            moved = true;
        }
        pose->object_to_world[o] = *there;
        pose->object_hidden[o] = hidden;
    }
    return moved;
}

enum lw_status lw_stage_follow(struct lw_stage *stage, bool *out_moved, struct lw_error *err) {
    struct lw_client_stats stats;
    lw_client_get_stats(stage->client, &stats);
    bool moved = take_objects(stage);
    /* Cameras hang on nodes, which only the scene's own animation moves; objects are where the server
     * says. */
    if (stage->scene->duration_s > 0 && stage->pose.time_s != stats.time_s) {
        lw_pose_evaluate(&stage->pose, stage->scene, stats.time_s);
        take_objects(stage);
    }
    if (moved) {
        enum lw_status status = lw_trace_set_pose(stage->trace, &stage->pose, err);
        if (status != LW_OK) return status;
    }
    moved |= lw_drawn_lights_follow(&stage->drawn, stage->client, &stage->pose);
    *out_moved = moved || stage->changed_frame != stats.changed_frame;
    stage->changed_frame = stats.changed_frame;
    return LW_OK;
}

enum lw_status lw_stage_look(struct lw_stage *stage, const struct lw_camera_view *camera, uint32_t width,
                             uint32_t height, struct lw_error *err) {
    const uint64_t now_ns = lw_clock_ns();
    if (now_ns - stage->looked_ns < LOOK_NS) return LW_OK;
    stage->looked_ns = now_ns;
    struct lw_compose_source source = lw_compose_source_of(stage->client);
    lw_compose_survey(stage->compose, &source, &stage->pose,
                      &(struct lw_compose_view){
                          .camera = *camera, .width = width, .height = height, .mirrors = stage->mirrors});
    struct lw_attention *a = &stage->attention;
    lw_attention_list(a, lw_compose_needed(stage->compose), lw_compose_around(stage->compose), now_ns);
    enum lw_status status = lw_client_want(stage->client, a->list, a->list_count);
    return status == LW_OK ? LW_OK : lw_status_fail(err, status, "no memory for what the view needs");
}

enum lw_status lw_stage_show(struct lw_stage *stage, enum lw_show show, struct lw_compose_view *view,
                             struct lw_error *err) {
    view->show = show;
    view->mirrors = stage->mirrors;
    view->tile_colour = NULL;
    if (!lw_show_is_of_tiles(show)) return LW_OK;
    const uint32_t count = lw_client_atlas_map(stage->client)->tile_count;
    if (stage->tile_colour == NULL) stage->tile_colour = calloc(count + 1ul, sizeof *stage->tile_colour);
    if (stage->tile_colour == NULL) return lw_status_fail(err, LW_NO_MEMORY, "no memory for a chart");
    const struct lw_compose_source source = lw_compose_source_of(stage->client);
    const struct lw_show_tiles tiles = {.count = count,
                                        .context = source.context,
                                        .tile = source.tile,
                                        .now_ns = lw_clock_ns(),
                                        .attention = &stage->attention,
                                        .around = lw_compose_around(stage->compose)};
    lw_show_colour_tiles(show, &tiles, stage->tile_colour);
    view->tile_colour = stage->tile_colour;
    return LW_OK;
}
