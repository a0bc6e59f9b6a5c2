#include "client/view/window/comparison.h"

#include "client/paths/path_trace.h"
#include "common/base/colour.h"

#include <math.h>
#include <omp.h>
#include <pthread.h>
#include <stdlib.h>
#include <string.h>

/* The scene at the time of the request: its materials and sky change while tiles are taken in. */
struct world {
    struct lw_scene scene; /* all but materials is that of the stage */
    struct lw_material *material;
    struct lw_pose pose;
    bool has_pose, has_lights;
    struct lw_trace *trace;
    struct lw_lights lights;
    struct lw_path_trace *tracer;
};

struct lw_comparison {
    unsigned threads;
    pthread_t thread;
    pthread_mutex_t lock;
    pthread_cond_t wake;
    _Atomic bool cancel;

    /* under the lock: the picture that is asked for */
    bool quit, asked;
    struct world *next; /* NULL: the one at hand still holds */
    struct lw_path_view view;
    uint32_t width, height;
    /* and what there is */
    enum lw_status status;
    float *shared;
    uint32_t shared_width, shared_height, shared_samples;
    double shared_error;
    uint64_t number; /* the picture's */

    /* the owner's */
    float *taken;
    uint64_t taken_number;
    struct lw_comparison_picture picture;
    bool following;
};

/* ---- a scene of its own ---- */

static void destroy_world(struct world *w) {
    if (w == NULL) return;
    lw_path_trace_destroy(w->tracer);
    if (w->has_lights) lw_lights_finish(&w->lights);
    lw_trace_destroy(w->trace);
    if (w->has_pose) lw_pose_finish(&w->pose);
    free(w->material);
    free(w);
}

/* The client's current scene. Rays and lights are built on the thread. */
static struct world *copy_world(const struct lw_stage *stage) {
    const struct lw_scene *scene = stage->scene;
    struct world *w = calloc(1, sizeof *w);
    if (w == NULL) return NULL;
    w->scene = *scene;
    w->material = malloc((scene->material_count + 1ul) * sizeof *w->material);
    if (w->material == NULL || lw_pose_init(&w->pose, scene) != LW_OK) {
        destroy_world(w);
        return NULL;
    }
    w->has_pose = true;
    if (scene->material_count > 0)
        memcpy(w->material, scene->material, scene->material_count * sizeof *w->material);
    w->scene.material = w->material;
    lw_pose_copy(&w->pose, &stage->pose, scene);
    for (uint32_t l = 0; l < scene->light_count; l++) {
        const struct lw_client_light light = lw_client_get_light(stage->client, l);
        w->pose.light[l] = (struct lw_light_state){.position_ws = light.position_ws,
                                                   .direction_ws = light.direction_ws,
                                                   .intensity = light.intensity};
    }
    return w;
}

static enum lw_status build_world(struct world *w, unsigned threads) {
    struct lw_error err = {0};
    enum lw_status status = lw_trace_create(&w->scene, &w->pose, &w->trace, &err);
    if (status == LW_OK) status = lw_lights_init(&w->lights, &w->scene, &w->pose);
    if (status != LW_OK) return status;
    w->has_lights = true;
    return lw_path_trace_create(&(struct lw_path_trace_desc){.scene = &w->scene,
                                                             .trace = w->trace,
                                                             .lights = &w->lights,
                                                             .pose = &w->pose,
                                                             .threads = threads},
                                &w->tracer, &err);
}

/* ---- the thread ---- */

struct tracing {
    struct world *world;
    struct lw_path_view view;
    struct lw_path_film film;
    float *rgb;
};

/* Waits for something to do; false: to end. */
static bool next_job(struct lw_comparison *c, struct tracing *t) {
    bool go_on = true, begins;
    struct world *next = NULL;
    uint32_t width, height;
    pthread_mutex_lock(&c->lock);
    while (!c->quit && !c->asked &&
           (t->world == NULL || c->status != LW_OK || t->film.samples >= LW_COMPARISON_SAMPLES_MAX))
        pthread_cond_wait(&c->wake, &c->lock);
    go_on = !c->quit;
    begins = c->asked;
    if (begins) {
        next = c->next;
        c->next = NULL;
        t->view = c->view;
        c->asked = false;
        atomic_store(&c->cancel, false);
    }
    width = c->width, height = c->height;
    pthread_mutex_unlock(&c->lock);
    if (!go_on || !begins) return go_on;
    enum lw_status status = LW_OK;
    if (next != NULL) {
        destroy_world(t->world);
        t->world = next;
        status = build_world(next, c->threads);
    }
    t->view.cancel = &c->cancel;
    if (t->film.width != width || t->film.height != height) {
        struct lw_error err = {0};
        lw_path_film_finish(&t->film);
        free(t->rgb);
        t->rgb = malloc(sizeof *t->rgb * 3 * width * height);
        if (t->rgb == NULL) status = LW_NO_MEMORY;
        if (status == LW_OK) status = lw_path_film_init(&t->film, width, height, &err);
    }
    if (status == LW_OK) lw_path_film_clear(&t->film);
    pthread_mutex_lock(&c->lock);
    c->status = status;
    pthread_mutex_unlock(&c->lock);
    return true;
}

static void publish(struct lw_comparison *c, struct tracing *t) {
    const double error = t->film.samples >= 2 ? lw_path_film_error(&t->film) : (double)INFINITY;
    lw_path_film_resolve(&t->film, t->rgb);
    pthread_mutex_lock(&c->lock);
    if (!c->asked && c->width == t->film.width && c->height == t->film.height) {
        memcpy(c->shared, t->rgb, sizeof *t->rgb * 3 * t->film.width * t->film.height);
        c->shared_width = t->film.width, c->shared_height = t->film.height;
        c->shared_samples = t->film.samples;
        c->shared_error = error;
        c->number++;
    }
    pthread_mutex_unlock(&c->lock);
}

static void *trace(void *argument) {
    struct lw_comparison *c = argument;
    struct tracing t = {0};
    while (next_job(c, &t)) {
        pthread_mutex_lock(&c->lock);
        const bool good = c->status == LW_OK && t.world != NULL && !c->asked;
        pthread_mutex_unlock(&c->lock);
        /* what a pass that was cut short has left is cleared with the next job */
        if (good && lw_path_trace_render(t.world->tracer, &t.view, 1, &t.film, NULL)) publish(c, &t);
    }
    lw_path_film_finish(&t.film);
    free(t.rgb);
    destroy_world(t.world);
    return NULL;
}

/* ---- its owner ---- */

enum lw_status lw_comparison_create(unsigned threads, struct lw_comparison **out_comparison,
                                    struct lw_error *err) {
    struct lw_comparison *c = calloc(1, sizeof *c);
    if (c == NULL) return lw_status_fail(err, LW_NO_MEMORY, "no memory for the path tracer");
    c->threads = threads ? threads : ((unsigned)omp_get_max_threads() + 1) / 2;
    pthread_mutex_init(&c->lock, NULL);
    pthread_cond_init(&c->wake, NULL);
    if (pthread_create(&c->thread, NULL, trace, c) != 0) {
        pthread_cond_destroy(&c->wake);
        pthread_mutex_destroy(&c->lock);
        free(c);
        return lw_status_fail(err, LW_OS, "no thread for the path tracer");
    }
    *out_comparison = c;
    return LW_OK;
}

void lw_comparison_destroy(struct lw_comparison *c) {
    if (c == NULL) return;
    pthread_mutex_lock(&c->lock);
    c->quit = true;
    atomic_store(&c->cancel, true);
    pthread_cond_signal(&c->wake);
    pthread_mutex_unlock(&c->lock);
    pthread_join(c->thread, NULL);
    pthread_cond_destroy(&c->wake);
    pthread_mutex_destroy(&c->lock);
    destroy_world(c->next);
    free(c->shared);
    free(c->taken);
    free(c);
}

static bool same_view(const struct lw_camera_view *a, const struct lw_camera_view *b) {
    return memcmp(a, b, sizeof *a) == 0;
}

/* Room for pictures of another size, in place of the old ones. */
static enum lw_status make_room(struct lw_comparison *c, uint32_t width, uint32_t height,
                                struct lw_error *err) {
    const size_t size = sizeof *c->shared * 3 * width * height;
    float *shared = malloc(size), *taken = malloc(size);
    if (shared == NULL || taken == NULL) {
        free(shared);
        free(taken);
        return lw_status_fail(err, LW_NO_MEMORY, "no memory for the path tracer's picture");
    }
    pthread_mutex_lock(&c->lock);
    free(c->shared);
    c->shared = shared;
    c->width = width, c->height = height;
    pthread_mutex_unlock(&c->lock);
    free(c->taken);
    c->taken = taken;
    return LW_OK;
}

enum lw_status lw_comparison_follow(struct lw_comparison *c, const struct lw_stage *stage,
                                    const struct lw_camera_view *camera, uint32_t width, uint32_t height,
                                    bool changed, struct lw_error *err) {
    struct lw_client_stats stats;
    lw_client_get_stats(stage->client, &stats);
    const bool resized = c->width != width || c->height != height;
    changed = changed || !c->following;
    pthread_mutex_lock(&c->lock);
    enum lw_status status = c->status;
    pthread_mutex_unlock(&c->lock);
    if (status != LW_OK)
        return lw_status_fail(err, status, "no path tracer for this scene: %s", lw_status_text(status));
    if (!changed && !resized && same_view(&c->view.camera, camera) && c->view.bounces == stats.bounces)
        return LW_OK;
    struct world *world = NULL;
    if (resized) status = make_room(c, width, height, err);
    if (status != LW_OK) return status;
    if (changed && (world = copy_world(stage)) == NULL)
        return lw_status_fail(err, LW_NO_MEMORY, "no memory for the path tracer's scene");
    pthread_mutex_lock(&c->lock);
    if (world != NULL) {
        destroy_world(c->next);
        c->next = world;
    }
    c->view = (struct lw_path_view){
        .camera = *camera, .bounces = stats.bounces, .seed = 1, .pixel = LW_PATH_PIXEL_BOX};
    c->asked = true;
    c->shared_samples = 0;
    c->number++;
    atomic_store(&c->cancel, true);
    pthread_cond_signal(&c->wake);
    pthread_mutex_unlock(&c->lock);
    c->following = true;
    return LW_OK;
}

bool lw_comparison_take(struct lw_comparison *c, struct lw_comparison_picture *out) {
    pthread_mutex_lock(&c->lock);
    const bool other = c->number != c->taken_number;
    if (other) {
        c->taken_number = c->number;
        c->picture = (struct lw_comparison_picture){.error = (double)INFINITY};
        if (c->shared_samples > 0) {
            memcpy(c->taken, c->shared, sizeof *c->taken * 3 * c->shared_width * c->shared_height);
            c->picture = (struct lw_comparison_picture){.rgb = c->taken,
                                                        .width = c->shared_width,
                                                        .height = c->shared_height,
                                                        .samples = c->shared_samples,
                                                        .error = c->shared_error};
        }
    }
    pthread_mutex_unlock(&c->lock);
    *out = c->picture;
    return other;
}

/* ---- the shown picture ---- */

static uint32_t argb_of(const uint8_t rgb[3]) {
    return 0xff000000u | (uint32_t)rgb[0] << 16 | (uint32_t)rgb[1] << 8 | rgb[2];
}

void lw_comparison_wipe(const struct lw_comparison_picture *picture, enum lw_tonemap_curve curve, float stops,
                        uint32_t out_width, uint32_t out_height, uint32_t left, uint32_t *out) {
    struct lw_tonemap tonemap;
    lw_tonemap_init(&tonemap, curve, stops);
    for (uint32_t y = 0; y < out_height; y++)
        for (uint32_t x = left; x < out_width; x++) {
            const size_t at = (size_t)y * picture->height / out_height * picture->width +
                              (size_t)x * picture->width / out_width;
            uint8_t srgb[3];
            lw_tonemap_encode(&tonemap, picture->rgb + 3 * at, 1, 3, srgb);
            *out++ = x < left + 2 ? 0xffffffffu : argb_of(srgb);
        }
}

/* Mean of the pixels of a picture that fall into one of another size. */
static float luminance_at(const float *rgb, uint32_t width, uint32_t height, uint32_t x, uint32_t y,
                          uint32_t out_width, uint32_t out_height) {
    const uint32_t x0 = (uint32_t)((uint64_t)x * width / out_width),
                   y0 = (uint32_t)((uint64_t)y * height / out_height);
    uint32_t x1 = (uint32_t)((uint64_t)(x + 1) * width / out_width),
             y1 = (uint32_t)((uint64_t)(y + 1) * height / out_height);
    if (x1 <= x0) x1 = x0 + 1;
    if (y1 <= y0) y1 = y0 + 1;
    double sum = 0;
    for (uint32_t j = y0; j < y1; j++)
        for (uint32_t i = x0; i < x1; i++) {
            const float *p = rgb + 3 * ((size_t)j * width + i);
            sum += (double)lw_colour_luminance(lw_vec3(p[0], p[1], p[2]));
        }
    return (float)(sum / ((double)(x1 - x0) * (y1 - y0)));
}

double lw_comparison_difference(const struct lw_comparison_picture *picture, const float *other,
                                uint32_t other_width, uint32_t other_height, uint32_t out_width,
                                uint32_t out_height, uint32_t *out) {
    const uint32_t width = picture->width, height = picture->height;
    struct lw_tonemap plain;
    lw_tonemap_init(&plain, LW_TONEMAP_NONE, 0);
    double mean = 0, squares = 0;
    for (size_t i = 0; i < (size_t)width * height; i++) {
        const float *p = picture->rgb + 3 * i;
        mean += (double)lw_colour_luminance(lw_vec3(p[0], p[1], p[2])) / ((double)width * height);
    }
    for (uint32_t y = 0; y < out_height; y++)
        for (uint32_t x = 0; x < out_width; x++) {
            const uint32_t px = (uint32_t)((uint64_t)x * width / out_width),
                           py = (uint32_t)((uint64_t)y * height / out_height);
            const float *p = picture->rgb + 3 * ((size_t)py * width + px);
            const double traced = (double)lw_colour_luminance(lw_vec3(p[0], p[1], p[2])),
                         cached =
                             (double)luminance_at(other, other_width, other_height, px, py, width, height);
            const double off = fabs(cached - traced) / (traced + 0.01 * mean + 1e-30);
            squares += off * off;
            const struct lw_vec3 c = lw_show_ramp(log10f(fmaxf((float)off, 1e-9f) / 0.001f) / 3);
            const float rgb[3] = {c.x, c.y, c.z};
            uint8_t srgb[3];
            lw_tonemap_encode(&plain, rgb, 1, 3, srgb);
            *out++ = argb_of(srgb);
        }
    return sqrt(squares / ((double)out_width * out_height));
}
