#include "client/measure/figures/reference.h"

#include "client/measure/figures/view_error.h"

#include <math.h>
#include <stdlib.h>

static size_t value_count(const struct lw_reference *reference) {
    return (size_t)reference->width * reference->height * 3;
}

static double at(const struct lw_reference *reference, size_t i) {
    return 0.5 * ((double)reference->half[0][i] + (double)reference->half[1][i]);
}

/* Divisor of the squares, without the pixel's own part. */
static double floor_of(const struct lw_reference *reference) {
    return LW_REFERENCE_FLOOR_SHARE * reference->mean_square;
}

enum lw_status lw_reference_init(struct lw_reference *reference, const struct lw_path_world *world,
                                 const struct lw_camera_view *camera, uint32_t width, uint32_t height,
                                 uint32_t samples, uint32_t seed, struct lw_error *err) {
    struct lw_path_film film;
    enum lw_status status = lw_path_film_init(&film, width, height, err);
    if (status != LW_OK) return status;
    lw_path_world_render(world, &(struct lw_path_view){.camera = *camera, .seed = seed}, samples, &film);
    *reference =
        (struct lw_reference){.width = width, .height = height, .half = {film.half[0], film.half[1]}};
    const float scale = 2.0f / (float)samples;
    for (size_t i = 0; i < value_count(reference); i++)
        reference->half[0][i] *= scale, reference->half[1][i] *= scale;

    for (size_t i = 0; i < value_count(reference); i++)
        reference->mean_square += at(reference, i) * at(reference, i);
    reference->mean_square /= (double)value_count(reference);
    const double floor = floor_of(reference);
    for (size_t i = 0; i < value_count(reference); i++) {
        double off = 0.5 * ((double)reference->half[0][i] - (double)reference->half[1][i]);
        if (floor > 0) reference->noise += off * off / (at(reference, i) * at(reference, i) + floor);
    }
    reference->noise /= (double)value_count(reference);
    return LW_OK;
}

enum lw_status lw_reference_init_real(struct lw_reference *reference, struct lw_path_world *world,
                                      const struct lw_renderer_desc *side,
                                      const struct lw_real_picture *picture, uint32_t samples, uint32_t seed,
                                      struct lw_error *err) {
    const struct lw_camera_view camera =
        side->cameras.at(side->cameras.context, picture->user, picture->view_frame);
    enum lw_status status = lw_path_world_set_time(world, picture->time_s, err);
    if (status != LW_OK) return status;
    return lw_reference_init(reference, world, &camera, side->width / side->stride,
                             side->height / side->stride, samples, seed, err);
}

void lw_reference_finish(struct lw_reference *reference) {
    free(reference->half[0]);
    free(reference->half[1]);
    *reference = (struct lw_reference){0};
}

static struct lw_view_error_reference reference_without(const struct lw_reference *reference,
                                                        const uint8_t *left_out) {
    return (struct lw_view_error_reference){.width = reference->width,
                                            .height = reference->height,
                                            .half = {reference->half[0], reference->half[1]},
                                            .left_out = left_out};
}

double lw_reference_error(const struct lw_reference *reference, const float *rgb) {
    const struct lw_view_error_reference all = reference_without(reference, NULL);
    const double floor = floor_of(reference);
    /* a black reference shows the emission of nothing: any picture of it is right */
    return floor > 0 ? lw_view_error_relmse(&all, (const float *[]){rgb, rgb}, floor) : 0;
}

bool lw_reference_is_dark(const struct lw_reference *reference, double mean_square) {
    return reference->mean_square <= LW_REFERENCE_DARK_SHARE * mean_square;
}

enum lw_status lw_reference_look(const struct lw_path_world *world, const struct lw_camera_view *camera,
                                 uint32_t width, uint32_t height, uint32_t *out_object,
                                 struct lw_error *err) {
    struct lw_gbuffer gbuffer;
    enum lw_status status = lw_gbuffer_init(&gbuffer,
                                            &(struct lw_gbuffer_desc){.scene = world->scene,
                                                                      .trace = world->trace,
                                                                      .width = width,
                                                                      .height = height,
                                                                      .threads = world->threads},
                                            err);
    if (status != LW_OK) return status;
    lw_gbuffer_render(&gbuffer, &world->pose, camera);
    for (size_t i = 0; i < (size_t)width * height; i++) {
        float *const *emission = gbuffer.plane.emission;
        const bool shines = emission[0][i] + emission[1][i] + emission[2][i] > 0;
        out_object[i] = shines ? LW_TRACE_MISS : gbuffer.plane.object[i];
    }
    lw_gbuffer_finish(&gbuffer);
    return LW_OK;
}

/* By halves of both, which leaves all noise out. left_out: room for a flag a pixel. */
static double lag_error(const struct lw_reference *reference, const struct lw_path_film *late,
                        const uint32_t *now, const uint32_t *then, uint8_t *left_out) {
    const struct lw_view_error_reference same = reference_without(reference, left_out);
    const float scale = 2.0f / (float)late->samples;
    for (size_t i = 0; i < value_count(reference); i++) late->half[0][i] *= scale, late->half[1][i] *= scale;
    for (size_t i = 0; i < value_count(reference) / 3; i++)
        left_out[i] = now[i] == LW_TRACE_MISS || now[i] != then[i];
    const double error =
        lw_view_error_relmse(&same, (const float *[]){late->half[0], late->half[1]}, floor_of(reference));
    return isfinite(error) ? error : 0;
}

enum lw_status lw_reference_lag_error(const struct lw_reference *reference, const uint32_t *object,
                                      const struct lw_path_world *world, const struct lw_camera_view *camera,
                                      uint32_t samples, uint32_t seed, double *out_error,
                                      struct lw_error *err) {
    struct lw_path_film film = {0};
    const size_t pixels = value_count(reference) / 3;
    uint32_t *then = malloc(pixels * (sizeof *then + 1)); /* and a flag each */
    enum lw_status status = then ? lw_path_film_init(&film, reference->width, reference->height, err)
                                 : lw_status_fail(err, LW_NO_MEMORY, "no memory for a view");
    if (status == LW_OK)
        status = lw_reference_look(world, camera, reference->width, reference->height, then, err);
    if (status == LW_OK) {
        lw_path_world_render(world, &(struct lw_path_view){.camera = *camera, .seed = seed}, samples, &film);
        *out_error = lag_error(reference, &film, object, then, (uint8_t *)(then + pixels));
    }
    lw_path_film_finish(&film);
    free(then);
    return status;
}
