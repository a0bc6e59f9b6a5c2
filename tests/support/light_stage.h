/* light_stage.h: scenes of quads that shine and of lights, for tests of sampling lights. */
#ifndef LW_TESTS_LIGHT_STAGE_H
#define LW_TESTS_LIGHT_STAGE_H

#include "tests/support/support.h"

#define LIGHT_STAGE_MAX 64 /* quads; lights */

/** A scene with nothing in it. */
struct lw_scene *light_stage_create(void);

/** Adds a quad, an object and a material of its own. It faces along u x v. */
void light_stage_add_quad(struct lw_scene *scene, struct lw_vec3 corner, struct lw_vec3 u, struct lw_vec3 v,
                          float emission, bool double_sided);

/** Adds a light that faces -Y. */
void light_stage_add_light(struct lw_scene *scene, struct lw_light light, struct lw_vec3 position);

#endif
