#include "tests/reference/path_case.h"

void path_case_set_up(struct path_case_set *set, struct lw_scene *scene, unsigned threads) {
    struct lw_error err = {0};
    set->scene = scene;
    set->seeds = 16;
    lw_support_ok(lw_path_world_init(&set->world, scene, 0, threads, &err), &err);
}

void path_case_tear_down(struct path_case_set *set) {
    lw_path_world_finish(&set->world);
    lw_scene_destroy(set->scene);
}

struct lw_path_film path_case_render(const struct path_case_set *set, const struct lw_path_view *view,
                                     uint32_t width, uint32_t height, uint32_t samples) {
    struct lw_path_film film;
    struct lw_error err = {0};
    lw_support_ok(lw_path_film_init(&film, width, height, &err), &err);
    lw_path_trace_render(set->world.tracer, view, samples, &film, NULL);
    return film;
}

struct path_case_mean path_case_mean_of(const struct path_case_set *set, struct lw_path_view view,
                                        uint32_t side, uint32_t samples) {
    double sum = 0, squares = 0;
    for (uint32_t seed = 1; seed <= set->seeds; seed++) {
        view.seed = seed;
        struct lw_path_film film = path_case_render(set, &view, side, side, samples);
        double value = 0;
        for (uint32_t i = 0; i < side * side; i++)
            value += (double)film.half[0][3 * i] + (double)film.half[1][3 * i];
        value /= side * side * samples;
        sum += value, squares += value * value;
        lw_path_film_finish(&film);
    }
    double mean = sum / set->seeds;
    return (struct path_case_mean){mean,
                                   sqrt(fmax(0, squares / set->seeds - mean * mean) / (set->seeds - 1))};
}

void path_case_expect_same(const struct path_case_mean *mean, int count) {
    for (int a = 0; a < count; a++)
        for (int b = 0; b < a; b++) {
            const double both = sqrt(mean[a].error * mean[a].error + mean[b].error * mean[b].error);
            if (!(fabs(mean[a].value - mean[b].value) <= SIGMA * both))
                fail_msg("way %d: %.6g +- %.2g, way %d: %.6g +- %.2g", a, mean[a].value, mean[a].error, b,
                         mean[b].value, mean[b].error);
        }
}

struct lw_path_view path_case_view_of(struct lw_vec3 from, struct lw_vec3 to, float fov_deg,
                                      uint32_t bounces) {
    return (struct lw_path_view){.camera = lw_camera_look_at(from, to, fov_deg * LW_PI / 180),
                                 .bounces = bounces};
}

struct lw_path_view path_case_floor_view(void) {
    struct lw_path_view view = path_case_view_of(lw_vec3(0, 4, 0), lw_vec3(0, 0, 0), 0, 0);
    view.camera.fov_y = 2 * atanf(0.25f);
    view.pixel = LW_PATH_PIXEL_CENTRE;
    return view;
}
