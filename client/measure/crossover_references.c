#include "client/measure/crossover_references.h"

#include "client/measure/figures/reference.h"
#include "client/measure/sides/views.h"
#include "common/base/atomic_file.h"
#include "common/base/folders.h"
#include "common/base/log.h"
#include "common/base/progress.h"
#include "common/base/random.h"

#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#define STEP       16u /* crops begin and end at multiples of it: their samples are the whole picture's */
#define SIDE_MAX   96u
#define LATE_SHARE 4u /* late references have a quarter of the paths */
#define KEY_SIZE   512u
#define PLACES     0x5eedu /* seed of the crops' places; fixed before anything runs */

/* ---- crops ---- */

/* Where the right half begins. */
static uint32_t middle_of(uint32_t width) { return (width / 2 + STEP - 1) / STEP * STEP; }

uint32_t lw_crossover_references_side(uint32_t width, uint32_t height) {
    const uint32_t right = width - middle_of(width); /* never the wider half */
    uint32_t side = height * 4 / 15;                 /* 96 of 360 */
    if (side > right) side = right;
    side = side / STEP * STEP;
    return side < STEP ? STEP : side > SIDE_MAX ? SIDE_MAX : side;
}

struct lw_crossover_crop lw_crossover_references_crop(uint32_t width, uint32_t height, uint32_t view,
                                                      uint32_t index) {
    const uint32_t side = lw_crossover_references_side(width, height);
    const uint32_t middle = middle_of(width);
    const uint32_t from = index ? middle : 0, to = index ? width : middle;
    const uint32_t across = (to - from - side) / STEP + 1, down = (height - side) / STEP + 1;
    return (struct lw_crossover_crop){.x = from + STEP * (lw_random_hash4(PLACES, view, index, 0) % across),
                                      .y = STEP * (lw_random_hash4(PLACES, view, index, 1) % down)};
}

static size_t pixel_count(const struct lw_crossover_references *t) {
    return (size_t)LW_CROSSOVER_CROPS * t->side * t->side;
}

void lw_crossover_references_cut(const struct lw_crossover_references *t, uint32_t view, const float *rgb,
                                 uint32_t width, float *out) {
    for (uint32_t c = 0; c < LW_CROSSOVER_CROPS; c++)
        for (uint32_t y = 0; y < t->side; y++, out += 3 * (size_t)t->side) {
            const struct lw_crossover_crop crop = t->crop[view][c];
            memcpy(out, rgb + 3 * ((size_t)(crop.y + y) * width + crop.x), 3 * sizeof *out * t->side);
        }
}

struct lw_view_error_reference lw_crossover_references_of(const struct lw_crossover_references *t,
                                                          const struct lw_crossover_reference *r,
                                                          uint32_t crop) {
    const size_t from = (size_t)crop * t->side * t->side;
    return (struct lw_view_error_reference){.width = t->side,
                                            .height = t->side,
                                            .half = {r->half[0] + 3 * from, r->half[1] + 3 * from},
                                            .left_out = r->left_out ? r->left_out + from : NULL};
}

/* ---- files ---- */

/* One reference to be had. */
struct wish {
    uint32_t view, frame, late; /* the camera's; frames by which the scene is older */
    uint32_t samples;
    struct lw_crossover_reference *out;
};

static void path_of(const struct lw_crossover_references_desc *d, const struct wish *w, char *out,
                    size_t size) {
    snprintf(out, size, "%s/reference/v%02u-f%04u-l%02u.raw", d->folder, w->view, w->frame, w->late);
}

static void key_of(const struct lw_crossover_references_desc *d, const struct lw_crossover_references *t,
                   const struct wish *w, char out[KEY_SIZE]) {
    const struct lw_camera_view camera = d->cameras.at(d->cameras.context, w->view, w->frame);
    snprintf(out, KEY_SIZE,
             "lightwell " LW_VERSION
             " reference 2: %.40s %.150s %s %ux%u bounces %u samples %u seed %u camera %g,%g,%g side %u "
             "crops %u,%u %u,%u objects %u\n",
             d->content, d->options->scene.path, lw_scene_motion_name(d->options->motion), d->options->width,
             d->options->height, d->options->bounces, w->samples, d->options->seed, (double)camera.position.x,
             (double)camera.position.y, (double)camera.position.z, t->side, t->crop[w->view][0].x,
             t->crop[w->view][0].y, t->crop[w->view][1].x, t->crop[w->view][1].y, d->scene->object_count);
}

static enum lw_status allocate(const struct lw_crossover_references *t, struct lw_crossover_reference *r,
                               struct lw_error *err) {
    const size_t count = pixel_count(t);
    for (int h = 0; h < 2; h++) r->half[h] = malloc(3 * count * sizeof *r->half[h]);
    r->object = malloc(count * sizeof *r->object);
    return r->half[0] && r->half[1] && r->object
               ? LW_OK
               : lw_status_fail(err, LW_NO_MEMORY, "no memory for a reference");
}

static bool load(const struct lw_crossover_references *t, const char *path, const char *key,
                 struct lw_crossover_reference *r) {
    char found[KEY_SIZE];
    const size_t count = pixel_count(t);
    FILE *f = fopen(path, "re");
    if (!f) return false;
    bool good = fgets(found, sizeof found, f) && strcmp(found, key) == 0;
    for (int h = 0; good && h < 2; h++)
        good = fread(r->half[h], sizeof *r->half[h], 3 * count, f) == 3 * count;
    good = good && fread(r->object, sizeof *r->object, count, f) == count && fgetc(f) == EOF;
    fclose(f);
    return good;
}

static enum lw_status save(const struct lw_crossover_references *t, const char *path, const char *key,
                           const struct lw_crossover_reference *r, struct lw_error *err) {
    struct lw_atomic_file file;
    const size_t count = pixel_count(t);
    enum lw_status status = lw_atomic_file_open(&file, path, err);
    if (status != LW_OK) return status;
    status = lw_atomic_file_write(&file, key, strlen(key), err);
    for (int h = 0; status == LW_OK && h < 2; h++)
        status = lw_atomic_file_write(&file, r->half[h], 3 * count * sizeof *r->half[h], err);
    if (status == LW_OK) status = lw_atomic_file_write(&file, r->object, count * sizeof *r->object, err);
    if (status == LW_OK) return lw_atomic_file_commit(&file, err);
    lw_atomic_file_abandon(&file);
    return status;
}

/* ---- tracing ---- */

/* Made for the first reference that no file holds. */
struct tracing {
    const struct lw_crossover_references_desc *desc;
    const struct lw_crossover_references *references;
    struct lw_path_world world;
    bool ready;
    uint32_t scene_frame; /* 0: none yet */
};

static enum lw_status go_to(struct tracing *tr, uint32_t frame, struct lw_error *err) {
    const struct lw_measure_options *o = tr->desc->options;
    enum lw_status status = LW_OK;
    if (!tr->ready)
        status = lw_path_world_init(&tr->world, tr->desc->scene, o->bounces, (unsigned)o->scene.threads, err);
    tr->ready |= status == LW_OK;
    if (status == LW_OK && tr->scene_frame != frame)
        status = lw_path_world_set_time(&tr->world, (double)(frame - 1) / LW_VIEWS_HZ, err);
    tr->scene_frame = frame;
    return status;
}

static enum lw_status find_objects(struct tracing *tr, const struct wish *w,
                                   const struct lw_camera_view *camera, struct lw_error *err) {
    const uint32_t width = tr->desc->options->width, height = tr->desc->options->height;
    uint32_t *object = malloc((size_t)width * height * sizeof *object), *out = w->out->object;
    enum lw_status status = object ? lw_reference_look(&tr->world, camera, width, height, object, err)
                                   : lw_status_fail(err, LW_NO_MEMORY, "no memory for a view");
    for (uint32_t c = 0; status == LW_OK && c < LW_CROSSOVER_CROPS; c++)
        for (uint32_t y = 0; y < tr->references->side; y++, out += tr->references->side) {
            const struct lw_crossover_crop crop = tr->references->crop[w->view][c];
            memcpy(out, object + (size_t)(crop.y + y) * width + crop.x, tr->references->side * sizeof *out);
        }
    free(object);
    return status;
}

static enum lw_status trace(struct tracing *tr, const struct wish *w, struct lw_error *err) {
    const struct lw_measure_options *o = tr->desc->options;
    const struct lw_camera_view camera = tr->desc->cameras.at(tr->desc->cameras.context, w->view, w->frame);
    const uint32_t side = tr->references->side;
    struct lw_path_film film = {0};
    enum lw_status status = go_to(tr, w->frame - w->late, err);
    if (status == LW_OK) status = lw_path_film_init(&film, side, side, err);
    for (uint32_t c = 0; status == LW_OK && c < LW_CROSSOVER_CROPS; c++) {
        const struct lw_crossover_crop crop = tr->references->crop[w->view][c];
        const struct lw_path_view view = {
            .camera = camera,
            .crop = {.x = crop.x, .y = crop.y, .width = o->width, .height = o->height},
            .bounces = o->bounces,
            /* other seeds than any side's, and than another moment's: noise must know nothing of theirs */
            .seed = lw_random_hash3(~o->seed, w->view, w->frame << 8 | w->late),
            .pixel = LW_PATH_PIXEL_BOX,
            .all_lights = true};
        const size_t from = (size_t)c * side * side * 3;
        lw_path_film_clear(&film);
        lw_path_trace_render(tr->world.tracer, &view, w->samples, &film, NULL);
        for (int h = 0; h < 2; h++)
            for (size_t i = 0; i < 3 * (size_t)side * side; i++)
                w->out->half[h][from + i] = film.half[h][i] * (2.0f / (float)w->samples);
    }
    lw_path_film_finish(&film);
    return status == LW_OK ? find_objects(tr, w, &camera, err) : status;
}

static enum lw_status get(struct tracing *tr, const struct wish *w, struct lw_error *err) {
    char path[4096], key[KEY_SIZE];
    path_of(tr->desc, w, path, sizeof path);
    key_of(tr->desc, tr->references, w, key);
    enum lw_status status = allocate(tr->references, w->out, err);
    if (status != LW_OK || load(tr->references, path, key, w->out)) return status;
    status = trace(tr, w, err);
    return status == LW_OK ? save(tr->references, path, key, w->out, err) : status;
}

static enum lw_status get_moment(struct tracing *tr, uint32_t frame, uint32_t late, uint32_t samples,
                                 struct lw_crossover_reference *out, struct lw_progress *progress,
                                 struct lw_error *err) {
    enum lw_status status = LW_OK;
    for (uint32_t v = 0; status == LW_OK && v < LW_MEASURE_VIEWS; v++) {
        if (*tr->desc->cancel) return lw_status_fail(err, LW_CLOSED, "interrupted");
        status = get(tr, &(struct wish){v, frame, late, samples, &out[v]}, err);
        lw_progress_step(progress, samples);
    }
    return status;
}

static enum lw_status get_all(struct lw_crossover_references *t,
                              const struct lw_crossover_references_desc *desc, struct lw_error *err) {
    struct tracing tr = {.desc = desc, .references = t};
    struct lw_progress progress;
    const uint32_t samples = desc->options->reference_samples;
    enum lw_status status = LW_OK;
    lw_progress_init(&progress, "tracing the references",
                     (uint64_t)LW_MEASURE_VIEWS * samples * t->judged_count +
                         (uint64_t)LW_MEASURE_VIEWS * (samples / LATE_SHARE) * LW_CROSSOVER_LATES);
    for (uint32_t j = 0; status == LW_OK && j < t->judged_count; j++)
        status = get_moment(&tr, t->judged[j], 0, samples, t->now[j], &progress, err);
    for (uint32_t l = 0; status == LW_OK && l < LW_CROSSOVER_LATES; l++)
        status = get_moment(&tr, t->judged[0], LW_CROSSOVER_LATE_FRAMES * (LW_CROSSOVER_LATES - l),
                            samples / LATE_SHARE, t->late[l], &progress, err);
    lw_progress_end(&progress, status == LW_OK);
    if (tr.ready) lw_path_world_finish(&tr.world);
    return status;
}

/* ---- what they tell ---- */

/* Lets neighbours of what shines count as shining. Pixels are means over their squares: at a lamp's rim one
 * whose middle shows the wall holds a share of the lamp, hundreds of times what lights the wall. */
static void widen_shine(const struct lw_crossover_references *t, struct lw_crossover_reference *r,
                        uint8_t *shines) {
    const uint32_t side = t->side;
    for (size_t i = 0; i < pixel_count(t); i++) shines[i] = r->object[i] == LW_TRACE_MISS;
    for (size_t i = 0; i < pixel_count(t); i++) {
        const uint32_t x = (uint32_t)(i % side), y = (uint32_t)(i / side % side);
        for (uint32_t k = 0; k < 9 && r->object[i] != LW_TRACE_MISS; k++) {
            const uint32_t u = x + k % 3 - 1, v = y + k / 3 - 1; /* below 0: beyond the crop as well */
            if (u < side && v < side && shines[i - x - (size_t)y * side + u + (size_t)v * side])
                r->object[i] = LW_TRACE_MISS;
        }
    }
}

static enum lw_status widen_all(struct lw_crossover_references *t, struct lw_error *err) {
    uint8_t *shines = malloc(pixel_count(t));
    if (!shines) return lw_status_fail(err, LW_NO_MEMORY, "no memory for a reference");
    for (uint32_t v = 0; v < LW_MEASURE_VIEWS; v++) {
        for (uint32_t j = 0; j < t->judged_count; j++) widen_shine(t, &t->now[j][v], shines);
        for (uint32_t l = 0; l < LW_CROSSOVER_LATES; l++) widen_shine(t, &t->late[l][v], shines);
    }
    free(shines);
    return LW_OK;
}

static enum lw_status mask_late(struct lw_crossover_references *t, struct lw_error *err) {
    const size_t count = pixel_count(t);
    for (uint32_t l = 0; l < LW_CROSSOVER_LATES; l++)
        for (uint32_t v = 0; v < LW_MEASURE_VIEWS; v++) {
            struct lw_crossover_reference *late = &t->late[l][v];
            const uint32_t *now = t->now[0][v].object;
            late->left_out = malloc(count);
            if (!late->left_out) return lw_status_fail(err, LW_NO_MEMORY, "no memory for a reference");
            for (size_t i = 0; i < count; i++)
                late->left_out[i] = now[i] == LW_TRACE_MISS || late->object[i] != now[i];
        }
    return LW_OK;
}

/* Mean square over pixels that do not shine. A lamp is a thousand times brighter than what it lights: with it
 * in sight, 1 % of the mean square is so much that errors count nowhere but in the sun. */
static double mean_square_of(const struct lw_crossover_references *t,
                             const struct lw_crossover_reference *const *of, uint32_t count) {
    double sum = 0;
    uint64_t pixels = 0;
    for (uint32_t i = 0; i < count; i++)
        for (size_t p = 0; p < pixel_count(t); p++) {
            const float *a = of[i]->half[0] + 3 * p, *b = of[i]->half[1] + 3 * p;
            double squares = 0;
            for (int c = 0; c < 3; c++)
                squares += 0.25 * ((double)a[c] + (double)b[c]) * ((double)a[c] + (double)b[c]);
            if (of[i]->object[p] == LW_TRACE_MISS || !isfinite(squares)) continue;
            sum += squares;
            pixels++;
        }
    return pixels ? sum / (3 * (double)pixels) : 0;
}

/* Mean square of some views, in the judged frames or a second before them, whichever is brighter. Where a
 * lamp goes off, the judged frames may show next to nothing, and errors come from the light before. */
static double brightness_of(const struct lw_crossover_references *t, uint32_t first_view, uint32_t views,
                            bool *out_before) {
    const struct lw_crossover_reference *now[LW_CROSSOVER_JUDGED_MAX * LW_MEASURE_VIEWS],
        *before[LW_MEASURE_VIEWS];
    uint32_t count = 0;
    for (uint32_t v = 0; v < views; v++) {
        before[v] = &t->late[0][first_view + v];
        for (uint32_t j = 0; j < t->judged_count; j++) now[count++] = &t->now[j][first_view + v];
    }
    const double of_now = mean_square_of(t, now, count), of_before = mean_square_of(t, before, views);
    *out_before = of_before > of_now;
    return fmax(of_now, of_before);
}

static enum lw_status leave_out_dark(struct lw_crossover_references *t, const char *scene,
                                     struct lw_error *err) {
    bool before;
    t->mean_square = brightness_of(t, 0, LW_MEASURE_VIEWS, &before);
    for (uint32_t v = 0; v < LW_MEASURE_VIEWS; v++) {
        t->dark[v] = !(brightness_of(t, v, 1, &before) > LW_REFERENCE_DARK_SHARE * t->mean_square);
        t->dark_count += t->dark[v];
    }
    if (t->dark_count == LW_MEASURE_VIEWS || !(t->mean_square > 0))
        return lw_status_fail(err, LW_BAD_DATA, "%s: the views show no light", scene);
    if (t->dark_count)
        lw_log(LW_LOG_WARNING, "%u of %u views show next to nothing and are not judged", t->dark_count,
               LW_MEASURE_VIEWS);
    return LW_OK;
}

/* One exposure for all views, so that dark views are seen as such. */
static enum lw_status expose(struct lw_crossover_references *t, struct lw_error *err) {
    const size_t count = pixel_count(t);
    float *rgb = malloc(3 * count * LW_MEASURE_VIEWS * sizeof *rgb);
    bool before;
    if (!rgb) return lw_status_fail(err, LW_NO_MEMORY, "no memory for the views' exposure");
    (void)brightness_of(t, 0, LW_MEASURE_VIEWS, &before);
    for (uint32_t v = 0; v < LW_MEASURE_VIEWS; v++) {
        const struct lw_crossover_reference *r = before ? &t->late[0][v] : &t->now[0][v];
        for (size_t i = 0; i < 3 * count; i++)
            rgb[3 * count * v + i] = 0.5f * (r->half[0][i] + r->half[1][i]);
    }
    t->stops = lw_tonemap_auto_stops(rgb, count * LW_MEASURE_VIEWS);
    free(rgb);
    return LW_OK;
}

double lw_crossover_references_late_error(const struct lw_crossover_references *t, uint32_t late,
                                          uint32_t view) {
    const struct lw_crossover_reference *l = &t->late[late][view], *now = &t->now[0][view];
    const struct lw_view_error_reference all = {.width = t->side,
                                                .height = LW_CROSSOVER_CROPS * t->side,
                                                .half = {now->half[0], now->half[1]},
                                                .left_out = l->left_out};
    return lw_view_error_relmse(&all, (const float *[]){l->half[0], l->half[1]},
                                LW_REFERENCE_FLOOR_SHARE * t->mean_square);
}

/* ---- the whole ---- */

enum lw_status lw_crossover_references_init(struct lw_crossover_references *t,
                                            const struct lw_crossover_references_desc *desc,
                                            struct lw_error *err) {
    const struct lw_measure_options *o = desc->options;
    char folder[4096];
    *t = (struct lw_crossover_references){.side = lw_crossover_references_side(o->width, o->height),
                                          .judged_count = desc->judged_count};
    memcpy(t->judged, desc->judged, desc->judged_count * sizeof *t->judged);
    for (uint32_t v = 0; v < LW_MEASURE_VIEWS; v++)
        for (uint32_t c = 0; c < LW_CROSSOVER_CROPS; c++)
            t->crop[v][c] = lw_crossover_references_crop(o->width, o->height, v, c);
    snprintf(folder, sizeof folder, "%s/reference", desc->folder);
    enum lw_status status = lw_folders_make(folder, err);
    if (status == LW_OK) status = get_all(t, desc, err);
    if (status == LW_OK) status = widen_all(t, err);
    if (status == LW_OK) status = mask_late(t, err);
    if (status == LW_OK) status = leave_out_dark(t, o->scene.path, err);
    if (status == LW_OK) status = expose(t, err);
    return status;
}

static void free_reference(struct lw_crossover_reference *r) {
    free(r->half[0]);
    free(r->half[1]);
    free(r->object);
    free(r->left_out);
}

void lw_crossover_references_finish(struct lw_crossover_references *t) {
    for (uint32_t v = 0; v < LW_MEASURE_VIEWS; v++) {
        for (uint32_t j = 0; j < LW_CROSSOVER_JUDGED_MAX; j++) free_reference(&t->now[j][v]);
        for (uint32_t l = 0; l < LW_CROSSOVER_LATES; l++) free_reference(&t->late[l][v]);
    }
    *t = (struct lw_crossover_references){.side = 0};
}
