/* gl_case.h: a scene with light of a test's choice, drawn by OpenGL and by the composer. */
#ifndef LW_TESTS_GL_CASE_H
#define LW_TESTS_GL_CASE_H

#include "tests/support/support.h"

#include "client/gl/gl_offscreen.h"
#include "client/gl/gl_renderer.h"

enum { WIDTH = 192, HEIGHT = 108, PIXELS = WIDTH * HEIGHT, SAMPLES = 4 };

struct gl_case_world {
    struct lw_gl_offscreen *offscreen; /* NULL: there is no OpenGL here */
    struct lw_scene *scene;
    struct lw_pose pose;
    struct lw_atlas_map map;
    struct lw_trace *trace;
    struct lw_compose *compose;
    struct lw_gl_renderer *renderer;
    struct lw_compose_source source;
    struct lw_compose_view view;
    struct lw_client_lights drawn; /* zeroed: all light is in tiles */
    float **rgb;                   /* object * LW_ATLAS_LEVELS_MAX + level */
    float **direction;             /* the same of where light comes from; NULL: not known */
    struct lw_client_tile *tile;
    float *by_cpu, *by_gl;
};

/** Opens a scene that no test changes; the second time it is the same one. */
struct lw_scene *gl_case_open_scene(const char *name);

/** Group tear-down. */
int gl_case_close_scenes(void **state);

/** Takes the scene unless it is an opened one, and lights it. tint: how much levels differ; scale: of light.
 * Skips the test where there is no OpenGL. */
void gl_case_start(struct gl_case_world *w, struct lw_scene *scene, float tint, float scale);

void gl_case_world_finish(struct gl_case_world *w);

/** Both pictures, the mean of SAMPLES each. */
void gl_case_draw(struct gl_case_world *w);

/** One picture by OpenGL. */
void gl_case_take_and_draw(struct gl_case_world *w, unsigned samples);

/** Ends the test if the pictures of the last draw differ by more than a bound. */
void gl_case_compare(const char *name, struct gl_case_world *w);

/** With lights that the client draws, beside as much other light as there may be with them. */
void gl_case_start_lit(struct gl_case_world *w, struct lw_scene *scene, float tint, float scale,
                       const char *lights);

void gl_case_start_drawn(struct gl_case_world *w, const char *name, float scale);

#endif
