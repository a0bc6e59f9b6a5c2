/* path_case.h: scenes for the path tracer, and means of its pictures. */
#ifndef LW_TESTS_PATH_CASE_H
#define LW_TESTS_PATH_CASE_H

#include "client/measure/sides/path_world.h"
#include "tests/reference/room.h"

#define SIGMA 4.5  /* standard errors; of a thousand such comparisons none fails by chance */
#define FLAT  1e-5 /* what float sums may be off by where nothing is random */

/* A scene with everything that a render needs. */
struct path_case_set {
    struct lw_scene *scene;
    struct lw_path_world world;
    unsigned seeds; /* pictures of a mean */
};

/** Takes the scene. A mean is of 16 pictures, until `seeds` is changed. */
void path_case_set_up(struct path_case_set *set, struct lw_scene *scene, unsigned threads);

void path_case_tear_down(struct path_case_set *set);

/** The caller finishes the film. */
struct lw_path_film path_case_render(const struct path_case_set *set, const struct lw_path_view *view,
                                     uint32_t width, uint32_t height, uint32_t samples);

struct path_case_mean {
    double value, error; /* standard error */
};

/** Mean of the red channel of a square picture. */
struct path_case_mean path_case_mean_of(const struct path_case_set *set, struct lw_path_view view,
                                        uint32_t side, uint32_t samples);

/** Fails unless each two means agree within SIGMA of their errors, and says which do not. */
void path_case_expect_same(const struct path_case_mean *mean, int count);

struct lw_path_view path_case_view_of(struct lw_vec3 from, struct lw_vec3 to, float fov_deg,
                                      uint32_t bounces);

/** Straight down: pixel (x, y) of `side` sees ((x + 0.5) * 2 / side - 1) and z
 * likewise, of a floor of 2 m x 2 m. */
struct lw_path_view path_case_floor_view(void);

#endif
