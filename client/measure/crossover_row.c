#include "client/measure/crossover_row.h"

#include "client/measure/sides/views.h"
#include "common/base/folders.h"
#include "common/base/log.h"

#include <math.h>
#include <stdio.h>

_Static_assert(LW_MEASURE_VIEWS == LW_FIXED_VIEWS_COUNT, "one user a view");

/* After the lamp has gone off: frames that are judged. */
static const uint32_t after_switch[] = {1, 2, 4, 8, 15, 30};

struct lw_camera_view lw_crossover_row_camera(const void *context, uint32_t user, uint64_t frame) {
    return lw_fixed_views_at(context, user, (double)(frame - 1) / LW_VIEWS_HZ);
}

struct lw_renderer_desc lw_crossover_row_side(struct lw_crossover_row *row) {
    return lw_measure_row_side(&row->base,
                               &(struct lw_renderer_cameras){&row->views, lw_crossover_row_camera});
}

/* ---- what the row is ---- */

static void lay_out(struct lw_crossover_row *row) {
    const struct lw_crossover_options *o = row->options;
    const uint32_t window = (uint32_t)fmax(2, round(o->base.seconds * LW_VIEWS_HZ));
    if (o->base.motion == LW_SCENE_MOTION_LAMP_SWITCH) { /* all that its step costs */
        const uint32_t before = (uint32_t)lroundf(LW_SCENE_MOTION_OFF_S * LW_VIEWS_HZ);
        for (size_t i = 0; i < sizeof after_switch / sizeof *after_switch; i++)
            row->judged[row->judged_count++] = before + after_switch[i];
        row->window = before + 1;
        return;
    }
    row->judged[0] = (uint32_t)lround(o->warm_s * LW_VIEWS_HZ) + 1;
    row->judged[1] = row->judged[0] + 1;
    row->judged_count = 2;
    row->window = row->judged[1] > window ? row->judged[1] - window + 1 : 1;
}

static enum lw_status note_references(struct lw_crossover_row *row, struct lw_error *err) {
    const struct lw_crossover_references *t = &row->references;
    struct lw_measure_late late[LW_CROSSOVER_LATES * LW_MEASURE_VIEWS];
    char text[100] = "";
    size_t count = 0, at = 0;
    for (uint32_t l = 0; l < LW_CROSSOVER_LATES; l++)
        for (uint32_t v = 0; v < LW_MEASURE_VIEWS; v++)
            if (!t->dark[v])
                late[count++] =
                    (struct lw_measure_late){.view = v,
                                             .frame = t->judged[0],
                                             .late = LW_CROSSOVER_LATE_FRAMES * (LW_CROSSOVER_LATES - l),
                                             .relmse = lw_crossover_references_late_error(t, l, v)};
    enum lw_status status = lw_measure_store_set_late(&row->base.store, late, count, err);
    for (uint32_t v = 0; v < LW_MEASURE_VIEWS; v++)
        if (t->dark[v]) at += (size_t)snprintf(text + at, sizeof text - at, "%s%u", at ? " " : "", v);
    if (status == LW_OK) status = lw_measure_row_note(&row->base, err, "dark views", "%s", text);
    if (status == LW_OK) status = lw_measure_row_note(&row->base, err, "mean square", "%.6g", t->mean_square);
    if (status == LW_OK) status = lw_measure_row_note(&row->base, err, "stops", "%.4g", (double)t->stops);
    return status == LW_OK ? lw_measure_row_note(&row->base, err, "crop", "%u", t->side) : status;
}

/* ---- preparing ---- */

/* Tells views of other tables apart, bit by bit (FNV-1a). */
static uint32_t hash_views(const struct lw_fixed_views *views) {
    uint32_t hash = 2166136261u;
    for (uint32_t v = 0; v < LW_MEASURE_VIEWS; v++)
        for (uint32_t moment = 0; moment < 2; moment++) {
            const struct lw_camera_view camera = lw_fixed_views_at(views, v, moment);
            const uint8_t *byte = (const uint8_t *)&camera; /* floats alone: nothing between them */
            for (size_t i = 0; i < sizeof camera; i++) hash = (hash ^ byte[i]) * 16777619u;
        }
    return hash;
}

static enum lw_status find_views(struct lw_crossover_row *row, struct lw_error *err) {
    struct lw_scene *scene;
    struct lw_scene_open open = row->options->base.scene;
    open.cancel = row->base.cancel;
    open.lightmap_unused = true;
    enum lw_status status = lw_scene_open(&open, &scene, err); /* the scene before a mover is added */
    if (status != LW_OK) return status;
    status = lw_fixed_views_init(&row->views, scene, (unsigned)open.threads, err);
    lw_scene_destroy(scene);
    if (status == LW_OK)
        status = lw_measure_row_bind(&row->base, err, "views' key", "%08x", hash_views(&row->views));
    return status == LW_OK ? lw_measure_row_note(&row->base, err, "views", "%s",
                                                 row->views.from_table ? "of the table" : "by the rule")
                           : status;
}

enum lw_status lw_crossover_row_open(struct lw_crossover_row *row, const struct lw_crossover_options *o,
                                     const char *command, const _Atomic bool *cancel, struct lw_error *err) {
    char pictures[4096];
    *row = (struct lw_crossover_row){.options = o};
    snprintf(pictures, sizeof pictures, "%s/pictures", o->base.folder);
    enum lw_status status = lw_measure_row_open(&row->base, &o->base, cancel, err);
    if (status == LW_OK) status = lw_measure_row_bind(&row->base, err, "warm", "%g", o->warm_s);
    if (status == LW_OK) status = lw_folders_make(pictures, err);
    if (status == LW_OK) status = find_views(row, err);
    if (status == LW_OK) status = lw_measure_row_open_scene(&row->base, command, err);
    if (status != LW_OK) return status;
    lay_out(row);
    lw_log(LW_LOG_INFO, "%s, %s: %llu triangles, twelve views %s", o->base.scene.path,
           lw_scene_motion_name(o->base.motion), (unsigned long long)row->base.densities.triangles,
           row->views.from_table ? "of the table" : "by the rule");
    status =
        lw_crossover_references_init(&row->references,
                                     &(struct lw_crossover_references_desc){
                                         .options = &o->base,
                                         .scene = row->base.densities.scene,
                                         .content = row->base.content,
                                         .cameras = {.context = &row->views, .at = lw_crossover_row_camera},
                                         .folder = o->base.folder,
                                         .judged = row->judged,
                                         .judged_count = row->judged_count,
                                         .cancel = row->base.cancel},
                                     err);
    return status == LW_OK ? note_references(row, err) : status;
}

void lw_crossover_row_finish(struct lw_crossover_row *row) {
    lw_crossover_references_finish(&row->references);
    lw_measure_row_finish(&row->base);
}
