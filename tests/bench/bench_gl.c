/* bench_gl: what a picture by OpenGL costs on this machine's CPU, against the
 * composer's of the same view, in one run.
 *
 *     bench_gl [OPTIONS] SCENE[@PX,PY,PZ:TX,TY,TZ:FOV]...
 *
 * For machines without a GPU, where Mesa draws on the CPU. One table in Markdown, CPU milliseconds of the
 * whole process, medians over the rounds:
 *   compose  the composer's picture, all light in tiles
 *   gl       the same by OpenGL, one sample a pixel; its time over compose's: gl_over_compose
 *   msaa     the same with 4 samples at edges
 *   drawn    the composer's picture with the direct light of client lights
 *   lit the same by OpenGL, one sample a pixel, shadow maps as they are; its
 *   time over drawn's: lit_over_drawn
 *   survey   finding the tiles that the view needs
 *   tiles    to take in 16 tiles of light that have changed
 *   none     gl in a session with finer levels, of which no tile is there; its time over gl's: none_over_gl
 *   finer    gl with all tiles of finer levels that the view wants; its time over gl's: finer_over_gl
 * With --finishes another table: compose, drawn, gl and lit with the materials' finishes, and their time over
 * that of the same without, the pictures in turn. With --directional the same, of light with directions
 * (common/light/direction_form.h) over light without: only surfaces with a finish read them. */
#include "client/gl/gl_offscreen.h"
#include "client/gl/gl_renderer.h"
#include "client/paths/camera_default.h"
#include "common/base/clock.h"
#include "common/base/random.h"
#include "tests/bench/bench_setup.h"

#include <epoxy/gl.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#define ROUNDS_MAX 99
#define LIGHT      9.0f  /* W/m^2 */
#define CHANGED    16u   /* tiles that change from picture to picture */
#define FINER      2u    /* finer levels: as lightwelld has them */
#define FINE_ROOM  2048u /* tiles of these levels that have ids */

enum kind { COMPOSE, GL, MSAA, DRAWN, LIT, SURVEY, TILES, NONE, FINE, KINDS };

struct settings {
    struct lw_scene_open open;
    int64_t width, height, rounds;
    double time_s;
    bool finishes, directional;
};

struct scene {
    const struct settings *settings;
    struct lw_scene *scene;
    struct lw_pose pose;
    struct lw_atlas_map map;
    struct lw_trace *trace;
    struct lw_client_lights lights;
    struct lw_compose *compose, *drawing;
    struct lw_gl_renderer *renderer, *lit;
    struct lw_gl_renderer *spare, *spare_lit; /* --directional: the same two with directions, or without */
    const struct lw_finish **kept;            /* --finishes: of each material, while it has none */
    struct lw_atlas_map finer_map;
    struct lw_gl_renderer *none, *fine; /* for the finer map */
    struct lw_compose_view view;
    float *light;     /* enough for the largest level; every level reads it */
    float *direction; /* the same, of where it comes from */
    bool directed;    /* light at hand has directions */
    float *dark;      /* light of any tile of finer levels */
    uint32_t *version;
    float *picture;
    uint8_t *needed;
    uint64_t *shown;
};

static struct lw_client_level level(const void *context, uint32_t object, uint32_t k) {
    const struct scene *s = context;
    const struct lw_atlas_level *l = &s->map.atlas[object]->level[k];
    return (struct lw_client_level){.width = l->width,
                                    .height = l->height,
                                    .rgb = s->light,
                                    .direction = s->directed ? s->direction : NULL};
}

static struct lw_client_tile tile(const void *context, lw_tile_id id) {
    return (struct lw_client_tile){.version = ((const struct scene *)context)->version[id.v]};
}

/* The needed tiles of finer levels are there. */
static struct lw_client_tile finer_tile(const void *context, lw_tile_id id) {
    const struct scene *s = context;
    const bool plain = id.v < s->finer_map.plain_count;
    return (struct lw_client_tile){.version = plain || s->needed[id.v], .rgb = plain ? NULL : s->dark};
}

/* The renderers of light without directions. Light at hand has them from here on. */
static enum lw_status set_up_directions(struct scene *s, size_t texel_count, struct lw_error *err) {
    s->direction = malloc(texel_count * 3 * sizeof *s->direction);
    if (!s->direction) return LW_NO_MEMORY;
    for (size_t i = 0; i < texel_count * 3; i++)
        s->direction[i] = 0.3f + 0.4f * lw_random_unit(lw_random_hash2(2, (uint32_t)i));
    s->directed = true;
    const struct lw_gl_renderer_desc desc = {.scene = s->scene, .map = &s->map};
    const struct lw_gl_renderer_desc lit = {
        .scene = s->scene, .map = &s->map, .drawn = &s->lights, .trace = s->trace, .pose = &s->pose};
    const enum lw_status status = lw_gl_renderer_create(&desc, &s->spare, err);
    return status == LW_OK ? lw_gl_renderer_create(&lit, &s->spare_lit, err) : status;
}

/* Two renderers with finer levels; one of them has the tiles that the view wants. */
static enum lw_status set_up_finer(struct scene *s, struct lw_error *err) {
    const struct lw_gl_renderer_desc desc = {.scene = s->scene, .map = &s->finer_map};
    const struct lw_compose_source source = {
        .context = s, .level = level, .tile = finer_tile, .noise_shown = 1};
    uint64_t pixels;
    enum lw_status status = lw_atlas_map_init_finer(&s->finer_map, s->scene, FINER, FINE_ROOM);
    if (status != LW_OK) return status;
    s->dark = calloc(LW_TILE_TEXELS_MAX, 3 * sizeof *s->dark);
    s->needed = calloc(s->finer_map.tile_count + 1ul, 1);
    s->shown = calloc(s->finer_map.tile_count + 1ul, sizeof *s->shown);
    if (!s->dark || !s->needed || !s->shown) return LW_NO_MEMORY;
    status = lw_gl_renderer_create(&desc, &s->none, err);
    if (status == LW_OK) status = lw_gl_renderer_create(&desc, &s->fine, err);
    if (status == LW_OK) status = lw_gl_renderer_take(s->none, &source, &s->pose, 0, 0, NULL, err);
    if (status == LW_OK) status = lw_gl_renderer_survey(s->none, &s->view, s->needed, s->shown, &pixels, err);
    if (status == LW_OK) status = lw_gl_renderer_take(s->fine, &source, &s->pose, 0, 0, NULL, err);
    return status;
}

static enum lw_status set_up(struct scene *s, const char *name, struct lw_error *err) {
    const struct settings *o = s->settings;
    enum lw_status status =
        bench_open(&o->open, name, BENCH_MOTION_OWN, o->time_s, &s->scene, &s->pose, &s->map, err);
    if (status != LW_OK) return status;
    const char *camera = strchr(name, '@');
    s->view = (struct lw_compose_view){.width = (uint32_t)o->width, .height = (uint32_t)o->height};
    size_t most = 1;
    for (uint32_t i = 0; i < s->map.object_count; i++)
        for (uint32_t k = 0; k < s->map.atlas[i]->level_count; k++) {
            const struct lw_atlas_level *l = &s->map.atlas[i]->level[k];
            most = (size_t)l->width * l->height > most ? (size_t)l->width * l->height : most;
        }
    s->light = malloc(most * 3 * sizeof *s->light);
    s->version = malloc((s->map.tile_count + 1ul) * sizeof *s->version);
    s->picture = malloc((size_t)o->width * (size_t)o->height * 3 * sizeof *s->picture);
    if (!s->light || !s->version || !s->picture) return LW_NO_MEMORY;
    for (size_t i = 0; i < 3 * most; i++)
        s->light[i] = LIGHT * (0.5f + (float)(i * 2654435761u >> 22 & 1023u) / 1023);
    for (uint32_t t = 0; t < s->map.tile_count; t++) s->version[t] = 1;
    status = lw_trace_create(s->scene, &s->pose, &s->trace, err);
    if (status == LW_OK)
        status = lw_compose_create(
            &(struct lw_compose_desc){
                .scene = s->scene, .map = &s->map, .trace = s->trace, .threads = (unsigned)o->open.threads},
            &s->compose, err);
    if (status == LW_OK)
        status = lw_gl_renderer_create(&(struct lw_gl_renderer_desc){.scene = s->scene, .map = &s->map},
                                       &s->renderer, err);
    if (status == LW_OK) status = lw_client_lights_init(&s->lights, s->scene, &s->pose, "auto", err);
    if (status == LW_OK)
        status = lw_compose_create(&(struct lw_compose_desc){.scene = s->scene,
                                                             .map = &s->map,
                                                             .trace = s->trace,
                                                             .threads = (unsigned)o->open.threads,
                                                             .drawn = &s->lights,
                                                             .pose = &s->pose},
                                   &s->drawing, err);
    if (status == LW_OK)
        status = lw_gl_renderer_create(
            &(struct lw_gl_renderer_desc){
                .scene = s->scene, .map = &s->map, .drawn = &s->lights, .trace = s->trace, .pose = &s->pose},
            &s->lit, err);
    if (status != LW_OK) return status;
    if (camera)
        status = lw_camera_parse(camera + 1, &s->view.camera, err);
    else
        s->view.camera = s->scene->camera_count ? lw_camera_of_scene(s->scene, &s->pose, 0)
                                                : lw_camera_default(s->scene, &s->pose, s->trace,
                                                                    (float)o->width / (float)o->height);
    if (status == LW_OK && o->directional) status = set_up_directions(s, most, err);
    return status == LW_OK ? set_up_finer(s, err) : status;
}

static enum lw_status do_one(struct scene *s, enum kind kind, int64_t round, struct lw_error *err) {
    const float *sky = s->scene->sky;
    const struct lw_compose_source source = {
        .context = s, .level = level, .tile = tile, .sky = lw_vec3(sky[0], sky[1], sky[2]), .noise_shown = 1};
    struct lw_compose_report report;
    uint64_t pixel_count;
    enum lw_status status = LW_OK;
    switch (kind) {
    case COMPOSE:
        lw_compose_render(s->compose, &source, &s->pose, &s->view, s->picture, &report);
        return LW_OK;
    case GL:
    case MSAA:
        status = lw_gl_renderer_draw(s->renderer, &s->view, kind == MSAA ? 4 : 1, err);
        break;
    case DRAWN:
        lw_compose_render(s->drawing, &source, &s->pose, &s->view, s->picture, &report);
        return LW_OK;
    case LIT:
        status = lw_gl_renderer_draw(s->lit, &s->view, 1, err);
        break;
    case SURVEY:
        return lw_gl_renderer_survey(s->renderer, &s->view, s->needed, s->shown, &pixel_count, err);
    case TILES:
        for (uint32_t i = 0; i < CHANGED; i++)
            s->version[((uint32_t)round * CHANGED + i) % (s->map.tile_count ? s->map.tile_count : 1)]++;
        status = lw_gl_renderer_take(s->renderer, &source, &s->pose, 0, 0, NULL, err);
        break;
    case NONE:
    case FINE:
        status = lw_gl_renderer_draw(kind == NONE ? s->none : s->fine, &s->view, 1, err);
        break;
    case KINDS:
        break;
    }
    glFinish();
    return status;
}

static enum lw_status measure(struct scene *s, const char *name, struct lw_error *err) {
    double time_ms[KINDS][ROUNDS_MAX], ratio[ROUNDS_MAX], lit[ROUNDS_MAX], none[ROUNDS_MAX], fine[ROUNDS_MAX];
    const int64_t rounds = s->settings->rounds;
    const float *sky = s->scene->sky;
    const struct lw_compose_source source = {
        .context = s, .level = level, .tile = tile, .sky = lw_vec3(sky[0], sky[1], sky[2]), .noise_shown = 1};
    enum lw_status status = do_one(s, TILES, 0, err);
    if (status == LW_OK) status = lw_gl_renderer_take(s->lit, &source, &s->pose, 0, 0, NULL, err);
    for (int64_t i = -1; i < rounds && status == LW_OK; i++) /* once for nothing: shaders are compiled */
        for (int kind = 0; kind < KINDS && status == LW_OK; kind++) {
            const uint64_t start_ns = lw_clock_process_cpu_ns();
            status = do_one(s, (enum kind)kind, i + 1, err);
            if (i >= 0) time_ms[kind][i] = 1e-6 * (double)(lw_clock_process_cpu_ns() - start_ns);
        }
    if (status != LW_OK) return status;
    for (int64_t i = 0; i < rounds; i++) {
        ratio[i] = time_ms[GL][i] / time_ms[COMPOSE][i];
        lit[i] = time_ms[LIT][i] / time_ms[DRAWN][i];
        none[i] = time_ms[NONE][i] / time_ms[GL][i];
        fine[i] = time_ms[FINE][i] / time_ms[GL][i];
    }
    double median[KINDS];
    for (int kind = 0; kind < KINDS; kind++) median[kind] = bench_median(time_ms[kind], (size_t)rounds);
    const struct lw_gl_renderer_figures f = lw_gl_renderer_figures(s->renderer);
    printf("| %s | %.1f | %.1f | %.2f | %.1f | %.1f | %.1f | %.2f | %.1f | %.2f | %u | %u | %.3f | %.3f | %u "
           "|\n",
           name, median[COMPOSE], median[GL], bench_median(ratio, (size_t)rounds), median[MSAA],
           median[DRAWN], median[LIT], bench_median(lit, (size_t)rounds), median[SURVEY], median[TILES],
           f.objects, f.draw_calls, bench_median(none, (size_t)rounds), bench_median(fine, (size_t)rounds),
           lw_gl_renderer_figures(s->fine).fine_tiles);
    return LW_OK;
}

/* Takes finishes away, and puts them back. */
static void swap_finishes(struct scene *s) {
    for (uint32_t m = 0; m < s->scene->material_count; m++) {
        const struct lw_finish *was = s->scene->material[m].finish;
        s->scene->material[m].finish = s->kept[m];
        s->kept[m] = was;
    }
}

/* The same with directions of light. */
static void swap_directions(struct scene *s) {
    struct lw_gl_renderer *const renderer = s->renderer, *const lit = s->lit;
    s->renderer = s->spare;
    s->lit = s->spare_lit;
    s->spare = renderer;
    s->spare_lit = lit;
    s->directed = !s->directed;
}

static enum lw_status take_all(struct scene *s, struct lw_error *err) {
    const struct lw_compose_source source = {.context = s, .level = level, .tile = tile, .noise_shown = 1};
    const enum lw_status status = lw_gl_renderer_take(s->renderer, &source, &s->pose, 0, 0, NULL, err);
    return status == LW_OK ? lw_gl_renderer_take(s->lit, &source, &s->pose, 0, 0, NULL, err) : status;
}

/* What the scene has costs over what it has after swap(), which takes it away and puts it back. */
static enum lw_status measure_over(struct scene *s, const char *name, void (*swap)(struct scene *),
                                   struct lw_error *err) {
    static const enum kind kinds[] = {COMPOSE, DRAWN, GL, LIT};
    enum { COUNT = sizeof kinds / sizeof kinds[0] };
    double with[COUNT][ROUNDS_MAX], over[COUNT][ROUNDS_MAX];
    enum lw_status status = take_all(s, err);
    if (s->spare) {
        swap(s);
        if (status == LW_OK) status = take_all(s, err);
        swap(s);
    }
    for (int64_t i = -1; i < s->settings->rounds && status == LW_OK; i++)
        for (int k = 0; k < COUNT && status == LW_OK; k++) {
            uint64_t at_ns[3] = {lw_clock_process_cpu_ns()};
            status = do_one(s, kinds[k], i + 1, err);
            at_ns[1] = lw_clock_process_cpu_ns();
            swap(s);
            if (status == LW_OK) status = do_one(s, kinds[k], i + 1, err);
            at_ns[2] = lw_clock_process_cpu_ns();
            swap(s);
            if (i < 0) continue;
            with[k][i] = 1e-6 * (double)(at_ns[1] - at_ns[0]);
            over[k][i] = (double)(at_ns[1] - at_ns[0]) / (double)(at_ns[2] - at_ns[1]);
        }
    if (status != LW_OK) return status;
    printf("| %s |", name);
    for (int k = 0; k < COUNT; k++)
        printf(" %.1f | %.2f |", bench_median(with[k], (size_t)s->settings->rounds),
               bench_median(over[k], (size_t)s->settings->rounds));
    printf("\n");
    return LW_OK;
}

static enum lw_status measure_scene(struct scene *s, const char *name, struct lw_error *err) {
    if (s->settings->directional) return measure_over(s, name, swap_directions, err);
    if (!s->settings->finishes) return measure(s, name, err);
    s->kept = calloc(s->scene->material_count + 1ul, sizeof *s->kept);
    return s->kept ? measure_over(s, name, swap_finishes, err) : LW_NO_MEMORY;
}

static enum lw_status run(void *context, const char *name, struct lw_error *err) {
    struct scene s = {.settings = context};
    struct lw_gl_offscreen *offscreen = NULL;
    enum lw_status status = lw_gl_offscreen_create(&offscreen, err);
    if (status == LW_OK) status = set_up(&s, name, err);
    if (status == LW_OK) status = measure_scene(&s, name, err);
    lw_gl_renderer_destroy(s.fine);
    lw_gl_renderer_destroy(s.none);
    lw_gl_renderer_destroy(s.spare_lit);
    lw_gl_renderer_destroy(s.spare);
    lw_gl_renderer_destroy(s.lit);
    lw_gl_renderer_destroy(s.renderer);
    lw_gl_offscreen_destroy(offscreen);
    lw_compose_destroy(s.drawing);
    lw_compose_destroy(s.compose);
    lw_client_lights_finish(&s.lights);
    lw_trace_destroy(s.trace);
    free(s.shown);
    free(s.needed);
    free(s.picture);
    free(s.version);
    free(s.dark);
    free(s.direction);
    free(s.kept);
    free(s.light);
    lw_atlas_map_finish(&s.finer_map);
    if (s.scene) bench_close(s.scene, &s.pose, &s.map);
    return status == LW_OK ? LW_OK : lw_status_fail(err, status, "%s: %s", name, lw_status_text(status));
}

/* The columns of measure_over(). */
static void print_heading_over(const char *less) {
    static const char *const columns[] = {"compose", "drawn", "gl", "lit"};
    printf("| scene |");
    for (int k = 0; k < 4; k++) printf(" %s | over %s |", columns[k], less);
    puts("\n|---|---|---|---|---|---|---|---|---|");
}

static enum lw_status print_heading(void *context, struct lw_error *err) {
    const struct settings *s = context;
    (void)err;
    if (s->directional)
        print_heading_over("E alone");
    else if (s->finishes)
        print_heading_over("matt");
    else
        puts("| scene | compose | gl | gl_over_compose | msaa | drawn | lit | lit_over_drawn | survey | "
             "tiles | objects | draw calls | none_over_gl | finer_over_gl | finer tiles |\n"
             "|---|---|---|---|---|---|---|---|---|---|---|---|---|---|---|");
    return LW_OK;
}

int main(int argc, char **argv) {
    struct settings s = {.width = 1280, .height = 720, .rounds = 9};
    const struct lw_option table[] = {
        BENCH_SIZE(&s, "1280", "720", 1, 1),
        BENCH_ROUNDS(&s, ROUNDS_MAX),
        BENCH_TIME(&s),
        {"finishes", NULL, "what materials' finishes cost", LW_OPTION_FLAG, &s.finishes, 0, 0, NULL},
        {"directional", NULL, "what directions of light cost", LW_OPTION_FLAG, &s.directional, 0, 0, NULL}};
    return BENCH_MAIN(argc, argv, table, .name = "bench_gl",
                      .about = "CPU time of a picture by OpenGL, by the composer's.",
                      .operand = "SCENE[@CAMERA]", .open = &s.open, .context = &s, .begin = print_heading);
}
