#include "tests/support/lightmap_case.h"

#include <stdlib.h>
#include <string.h>

uint32_t lightmap_case_add_vertex(struct lightmap_case_shape *s, struct lw_vec3 p, struct lw_vec3 n) {
    assert_true(s->vertex_count < LIGHTMAP_CASE_MAX);
    s->position[s->vertex_count] = p;
    s->normal[s->vertex_count] = n;
    return s->vertex_count++;
}

void lightmap_case_add_triangle(struct lightmap_case_shape *s, uint32_t a, uint32_t b, uint32_t c) {
    assert_true(s->triangle_count < LIGHTMAP_CASE_MAX);
    memcpy(s->triangle[s->triangle_count++], (uint32_t[3]){a, b, c}, 12);
}

void lightmap_case_add_quad(struct lightmap_case_shape *s, struct lw_vec3 p, struct lw_vec3 u,
                            struct lw_vec3 v) {
    struct lw_vec3 n = lw_vec3_normalize(lw_vec3_cross(u, v));
    uint32_t a = lightmap_case_add_vertex(s, p, n), b = lightmap_case_add_vertex(s, lw_vec3_add(p, u), n),
             c = lightmap_case_add_vertex(s, lw_vec3_add(lw_vec3_add(p, u), v), n),
             d = lightmap_case_add_vertex(s, lw_vec3_add(p, v), n);
    lightmap_case_add_triangle(s, a, b, c);
    lightmap_case_add_triangle(s, a, c, d);
}

void lightmap_case_add_cube(struct lightmap_case_shape *s, float side) {
    struct lw_vec3 x = lw_vec3(side, 0, 0), y = lw_vec3(0, side, 0), z = lw_vec3(0, 0, side),
                   o = lw_vec3(0, 0, 0);
    lightmap_case_add_quad(s, o, y, x), lightmap_case_add_quad(s, o, x, z),
        lightmap_case_add_quad(s, o, z, y);
    lightmap_case_add_quad(s, x, y, z), lightmap_case_add_quad(s, y, z, x),
        lightmap_case_add_quad(s, z, x, y);
}

void lightmap_case_add_grid(struct lightmap_case_shape *s, lightmap_case_surface *at, unsigned columns,
                            unsigned rows) {
    uint32_t first = s->vertex_count;
    const float step = 1e-3f;
    for (unsigned j = 0; j <= rows; j++)
        for (unsigned i = 0; i <= columns; i++) {
            float u = (float)i / (float)columns, v = (float)j / (float)rows;
            struct lw_vec3 du = lw_vec3_sub(at(u + step, v), at(u - step, v));
            struct lw_vec3 dv = lw_vec3_sub(at(u, v + step), at(u, v - step));
            lightmap_case_add_vertex(s, at(u, v), lw_vec3_normalize(lw_vec3_cross(du, dv)));
        }
    for (unsigned j = 0; j < rows; j++)
        for (unsigned i = 0; i < columns; i++) {
            uint32_t a = first + j * (columns + 1) + i, b = a + 1, d = a + columns + 1, c = d + 1;
            lightmap_case_add_triangle(s, a, b, c);
            lightmap_case_add_triangle(s, a, c, d);
        }
}

struct lw_vec3 lightmap_case_round_at(float u, float radius) {
    if (u == 1) u = 0;
    return lw_vec3(radius * cosf(2 * LW_PI * u), radius * sinf(2 * LW_PI * u), 0);
}
struct lw_vec3 lightmap_case_cylinder(float u, float v) {
    return lw_vec3_add(lightmap_case_round_at(u, 0.5f), lw_vec3(0, 0, 2 * v));
}
struct lw_vec3 lightmap_case_sphere(float u, float v) {
    float angle = LW_PI * (0.05f + 0.9f * v);
    return lw_vec3_add(lightmap_case_round_at(u, sinf(angle)), lw_vec3(0, 0, -cosf(angle)));
}
struct lw_vec3 lightmap_case_torus(float u, float v) {
    float angle = v == 1 ? 0 : 2 * LW_PI * v;
    return lw_vec3_add(lightmap_case_round_at(u, 1 + 0.3f * cosf(angle)), lw_vec3(0, 0, 0.3f * sinf(angle)));
}
/* Three turns of a ramp: flat rings that would land on each other when laid flat. */
struct lw_vec3 lightmap_case_ramp(float u, float v) {
    float angle = 6 * LW_PI * u, radius = 1 + v;
    return lw_vec3(radius * cosf(angle), radius * sinf(angle), u);
}

struct lw_scene *lightmap_case_scene_of(const struct lightmap_case_shape *s, const float *scale,
                                        unsigned objects) {
    struct lw_scene *scene;
    lw_support_ok(lw_scene_create(&scene), NULL);
    struct lw_mesh *mesh = scene->mesh = lw_scene_alloc(scene, 1, sizeof *mesh);
    scene->material = lw_scene_alloc(scene, 1, sizeof *scene->material);
    scene->node = lw_scene_alloc(scene, objects, sizeof *scene->node);
    scene->object = lw_scene_alloc(scene, objects, sizeof *scene->object);
    scene->mesh_count = scene->material_count = 1;
    scene->node_count = scene->object_count = objects;
    scene->material[0].double_sided = s->double_sided;
    for (unsigned i = 0; i < objects; i++) {
        scene->node[i].parent = LW_SCENE_NONE;
        scene->node[i].rotation[3] = 1;
        for (int k = 0; k < 3; k++) scene->node[i].scale[k] = scale ? scale[i] : 1;
        scene->object[i].node = i;
    }
    void *position = lw_scene_alloc(scene, s->vertex_count, sizeof *s->position);
    void *normal = lw_scene_alloc(scene, s->vertex_count, sizeof *s->normal);
    void *uv = lw_scene_alloc(scene, s->vertex_count, sizeof *s->uv1);
    void *triangles = lw_scene_alloc(scene, s->triangle_count, sizeof *s->triangle);
    memcpy(position, s->position, s->vertex_count * sizeof *s->position);
    memcpy(normal, s->normal, s->vertex_count * sizeof *s->normal);
    memcpy(uv, s->uv1, s->vertex_count * sizeof *s->uv1);
    memcpy(triangles, s->triangle, s->triangle_count * sizeof *s->triangle);
    *mesh = (struct lw_mesh){.name = "shape",
                             .vertex_count = s->vertex_count,
                             .triangle_count = s->triangle_count,
                             .position = position,
                             .normal = normal,
                             .triangle = triangles,
                             .material = lw_scene_alloc(scene, s->triangle_count, sizeof(uint32_t))};
    if (s->has_uv1) mesh->uv[1] = uv;
    return scene;
}

float lightmap_case_area_uv(const struct lw_mesh *m, uint32_t t) {
    struct lw_vec2 a = m->lightmap_uv[m->triangle[t][0]], b = m->lightmap_uv[m->triangle[t][1]],
                   c = m->lightmap_uv[m->triangle[t][2]];
    return ((b.x - a.x) * (c.y - a.y) - (b.y - a.y) * (c.x - a.x)) / 2;
}

float lightmap_case_area_os(const struct lw_mesh *m, uint32_t t) {
    struct lw_vec3 p = m->position[m->triangle[t][0]];
    return lw_vec3_length(lw_vec3_cross(lw_vec3_sub(m->position[m->triangle[t][1]], p),
                                        lw_vec3_sub(m->position[m->triangle[t][2]], p))) /
           2;
}

void lightmap_case_check_layout(const struct lw_mesh *m, const struct lw_lightmap_report *r,
                                float ratio_max) {
    assert_non_null(m->lightmap_uv);
    assert_int_equal(m->atlas_width % 4, 0);
    assert_int_equal(m->atlas_height % 4, 0);
    assert_int_equal(m->back_offset % 4, 0);
    uint32_t front = m->back_offset ? m->back_offset : m->atlas_height;
    assert_int_equal(m->atlas_height, m->back_offset ? 2 * front : front);
    float gutter = r->from_file ? 0 : (float)LW_LIGHTMAP_GUTTER;
    for (uint32_t v = 0; v < m->vertex_count; v++) {
        struct lw_vec2 uv = m->lightmap_uv[v];
        assert_true(uv.x >= gutter && uv.x <= (float)m->atlas_width - gutter);
        assert_true(uv.y >= gutter && uv.y <= (float)front - gutter);
    }
    for (uint32_t t = 0; t < m->triangle_count; t++) {
        float os = lightmap_case_area_os(m, t) * r->texels_per_metre * r->texels_per_metre,
              uv = lightmap_case_area_uv(m, t);
        if (os < 1e-3f) continue;
        assert_true(uv > 0); /* never mirrored */
        assert_true(uv < os * ratio_max && uv * ratio_max > os);
    }
    assert_int_equal(lw_lightmap_overlaps(m), 0);
    assert_true(r->coverage > 0 && r->coverage <= 1);
}

struct lw_lightmap_report lightmap_case_build(struct lw_scene *scene, float density, uint32_t side_max) {
    struct lw_lightmap_report r;
    struct lw_error err = {0};
    struct lw_lightmap_desc desc = {.texels_per_metre = density, .atlas_side_max = side_max, .threads = 1};
    lw_support_ok(lw_lightmap_build(scene, &desc, &r, &err), &err);
    return r;
}

struct lightmap_case_shape *lightmap_case_fresh(void **state) {
    struct lightmap_case_shape *s = *state;
    memset(s, 0, sizeof *s);
    return s;
}

int lightmap_case_set_up(void **state) {
    return (*state = malloc(sizeof(struct lightmap_case_shape))) ? 0 : -1;
}
int lightmap_case_tear_down(void **state) {
    free(*state);
    return 0;
}
