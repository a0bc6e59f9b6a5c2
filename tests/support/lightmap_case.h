/* lightmap_case.h: meshes under construction, the scene of their instances, and its atlases. */
#ifndef LW_TESTS_LIGHTMAP_CASE_H
#define LW_TESTS_LIGHTMAP_CASE_H

#include "tests/support/support.h"

#include "common/lightmap/lightmap.h"

#define LIGHTMAP_CASE_MAX 32768 /* vertices; triangles */

/* One mesh under construction, and the scene of its instances. */
struct lightmap_case_shape {
    struct lw_vec3 position[LIGHTMAP_CASE_MAX], normal[LIGHTMAP_CASE_MAX];
    struct lw_vec2 uv1[LIGHTMAP_CASE_MAX];
    uint32_t triangle[LIGHTMAP_CASE_MAX][3], vertex_count, triangle_count;
    bool has_uv1, double_sided;
};

uint32_t lightmap_case_add_vertex(struct lightmap_case_shape *s, struct lw_vec3 p, struct lw_vec3 n);

void lightmap_case_add_triangle(struct lightmap_case_shape *s, uint32_t a, uint32_t b, uint32_t c);

/** A parallelogram from p along u and v, facing u x v. */
void lightmap_case_add_quad(struct lightmap_case_shape *s, struct lw_vec3 p, struct lw_vec3 u,
                            struct lw_vec3 v);

void lightmap_case_add_cube(struct lightmap_case_shape *s, float side);

typedef struct lw_vec3 lightmap_case_surface(float u, float v);

/** A smooth grid over a surface; normals by differences. */
void lightmap_case_add_grid(struct lightmap_case_shape *s, lightmap_case_surface *at, unsigned columns,
                            unsigned rows);

/** Radius 0.5 m, height 2 m. Whole turns are snapped, so that the seam's positions are the same bits. */
struct lw_vec3 lightmap_case_round_at(float u, float radius);
struct lw_vec3 lightmap_case_cylinder(float u, float v);
struct lw_vec3 lightmap_case_sphere(float u, float v);
struct lw_vec3 lightmap_case_torus(float u, float v);
struct lw_vec3 lightmap_case_ramp(float u, float v);

/** The scene of `objects` instances of a shape, each by its scale. */
struct lw_scene *lightmap_case_scene_of(const struct lightmap_case_shape *s, const float *scale,
                                        unsigned objects);

/** Area of a triangle: in texels, in m^2 of object space. */
float lightmap_case_area_uv(const struct lw_mesh *m, uint32_t t);
float lightmap_case_area_os(const struct lw_mesh *m, uint32_t t);

/** What holds for every layout of ours. */
void lightmap_case_check_layout(const struct lw_mesh *m, const struct lw_lightmap_report *r, float ratio_max);

struct lw_lightmap_report lightmap_case_build(struct lw_scene *scene, float density, uint32_t side_max);

/** Shared by all tests: one at a time is under construction. */
struct lightmap_case_shape *lightmap_case_fresh(void **state);

int lightmap_case_set_up(void **state);
int lightmap_case_tear_down(void **state);

#endif
