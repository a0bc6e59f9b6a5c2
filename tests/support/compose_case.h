/* compose_case.h: squares with light of a test's choice, and pictures of them. */
#ifndef LW_TESTS_COMPOSE_CASE_H
#define LW_TESTS_COMPOSE_CASE_H

#include "tests/support/support.h"

#include "client/view/compose/compose.h"

#define SIDE_M  4.0f
#define BOUNCES 2u

/* A scene with hand-made light: every texel and tile of every level is ours to fill. */
struct compose_case_world {
    struct lw_scene *scene;
    struct lw_pose pose;
    struct lw_atlas_map map;
    struct lw_trace *trace;
    struct lw_compose *compose;
    float **rgb; /* object * LW_ATLAS_LEVELS_MAX + level */
    struct lw_client_tile *tile;
    struct lw_compose_source source;
};

/** Squares of SIDE_M with an atlas of texels x texels, u along X and v along Z. Twice as many rows with
 * backs. */
struct lw_scene *compose_case_squares(unsigned count, uint32_t texels, bool double_sided);

/** Replaces the world's composer by one with that number of threads. */
void compose_case_make_compose(struct compose_case_world *w, unsigned threads);

/** A world of a scene, which it takes. All tiles have light, of value 0. finer: finer levels. */
void compose_case_world_init_finer(struct compose_case_world *w, struct lw_scene *scene, uint32_t finer);

void compose_case_world_init(struct compose_case_world *w, struct lw_scene *scene);

void compose_case_world_finish(struct compose_case_world *w);

void compose_case_fill_level(struct compose_case_world *w, uint32_t object, uint32_t k, float value);

/** Every level of an object holds its own constant: first, first + 1, ... */
void compose_case_fill_by_level(struct compose_case_world *w, uint32_t object, float first);

void compose_case_fill_constant(struct compose_case_world *w, uint32_t object, float value);

enum { WIDTH = 37, HEIGHT = 22 }; /* no multiple of a packet or a screen tile */

struct lw_compose_view compose_case_view_towards(float from_x, float from_y, float from_z, float to_x,
                                                 float to_y, float to_z, float fov_deg);

/** From above on the middle of the first square; all rays meet it. */
struct lw_compose_view compose_case_view_down(void);

/** Renders into rgb. Ends the test unless all its values are finite and not negative. */
struct lw_compose_report compose_case_render(struct compose_case_world *w, const struct lw_compose_view *view,
                                             float *rgb);

void compose_case_assert_near(float value, float expected, float relative);

/** E = u, v and their sum in texels of level 0, written into the texel centres of every level: bilinear
 * interpolation gives it back exactly, at whatever level it is read. */
void compose_case_fill_ramps(struct compose_case_world *w);

uint32_t compose_case_tile_at(const struct compose_case_world *w, uint32_t level, uint32_t x, uint32_t y);

#endif
