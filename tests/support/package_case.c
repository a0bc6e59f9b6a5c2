#include "tests/support/package_case.h"

#include "common/scene/package.h"

#include <stdlib.h>
#include <string.h>

uint8_t *package_case_write(const struct lw_scene *scene, size_t *out_size) {
    struct lw_error err = {0};
    uint8_t *bytes = NULL;
    lw_support_ok(lw_package_write(scene, &bytes, out_size, &err), &err);
    return bytes;
}

uint8_t *package_case_write_sealed(const struct lw_scene *scene, size_t *out_size) {
    struct lw_error err = {0};
    uint8_t *bytes = NULL;
    lw_support_ok(lw_package_write_sealed(scene, &bytes, out_size, &err), &err);
    return bytes;
}

uint8_t *package_case_write_everything(size_t *out_size) {
    struct lw_scene *scene = lw_support_everything();
    uint8_t *bytes = package_case_write(scene, out_size);
    lw_scene_destroy(scene);
    return bytes;
}

static void assert_same_use(const struct lw_texture_use *a, const struct lw_texture_use *b) {
    assert_int_equal(a->texture, b->texture);
    assert_int_equal(a->uv_set, b->uv_set);
    assert_memory_equal(a->transform, b->transform, sizeof a->transform);
}

static void assert_same_array(const void *a, const void *b, size_t size) {
    assert_int_equal(a == NULL, b == NULL);
    if (a) assert_memory_equal(a, b, size);
}

static void assert_same_mesh(const struct lw_mesh *a, const struct lw_mesh *b) {
    assert_string_equal(a->name, b->name);
    assert_int_equal(a->vertex_count, b->vertex_count);
    assert_int_equal(a->triangle_count, b->triangle_count);
    size_t vertices = a->vertex_count, triangles = a->triangle_count;
    assert_same_array(a->position, b->position, vertices * sizeof *a->position);
    assert_same_array(a->normal, b->normal, vertices * sizeof *a->normal);
    assert_same_array(a->uv[0], b->uv[0], vertices * sizeof *a->uv[0]);
    assert_same_array(a->uv[1], b->uv[1], vertices * sizeof *a->uv[1]);
    assert_same_array(a->colour, b->colour, vertices * sizeof *a->colour);
    assert_same_array(a->triangle, b->triangle, triangles * sizeof *a->triangle);
    assert_same_array(a->material, b->material, triangles * sizeof *a->material);
    assert_same_array(a->lightmap_uv, b->lightmap_uv, vertices * sizeof *a->lightmap_uv);
    assert_int_equal(a->atlas_width, b->atlas_width);
    assert_int_equal(a->atlas_height, b->atlas_height);
    assert_int_equal(a->back_offset, b->back_offset);
}

static void assert_same_surfaces(const struct lw_scene *a, const struct lw_scene *b) {
    assert_int_equal(a->mesh_count, b->mesh_count);
    for (uint32_t i = 0; i < a->mesh_count; i++) assert_same_mesh(&a->mesh[i], &b->mesh[i]);
    assert_int_equal(a->material_count, b->material_count);
    for (uint32_t i = 0; i < a->material_count; i++) {
        const struct lw_material *m = &a->material[i], *n = &b->material[i];
        assert_string_equal(m->name, n->name);
        assert_memory_equal(m->base_colour, n->base_colour, sizeof m->base_colour);
        assert_memory_equal(m->emission, n->emission, sizeof m->emission);
        assert_same_use(&m->base_colour_texture, &n->base_colour_texture);
        assert_same_use(&m->emission_texture, &n->emission_texture);
        assert_true(m->alpha_cutoff == n->alpha_cutoff);
        assert_int_equal(m->alpha_mode, n->alpha_mode);
        assert_int_equal(m->double_sided, n->double_sided);
    }
    assert_int_equal(a->texture_count, b->texture_count);
    for (uint32_t i = 0; i < a->texture_count; i++) {
        const struct lw_texture *t = &a->texture[i], *u = &b->texture[i];
        assert_string_equal(t->name, u->name);
        assert_int_equal(t->width, u->width);
        assert_int_equal(t->height, u->height);
        assert_int_equal(t->wrap_s, u->wrap_s);
        assert_int_equal(t->wrap_t, u->wrap_t);
        assert_memory_equal(t->rgba, u->rgba, 4 * (size_t)t->width * t->height);
    }
}

static void assert_same_places(const struct lw_scene *a, const struct lw_scene *b) {
    assert_int_equal(a->node_count, b->node_count);
    for (uint32_t i = 0; i < a->node_count; i++) {
        const struct lw_node *m = &a->node[i], *n = &b->node[i];
        assert_string_equal(m->name, n->name);
        assert_int_equal(m->parent, n->parent);
        assert_memory_equal(m->translation, n->translation, sizeof m->translation);
        assert_memory_equal(m->rotation, n->rotation, sizeof m->rotation);
        assert_memory_equal(m->scale, n->scale, sizeof m->scale);
        assert_memory_equal(&m->matrix, &n->matrix, sizeof m->matrix);
        assert_int_equal(m->has_matrix, n->has_matrix);
    }
    assert_int_equal(a->object_count, b->object_count);
    for (uint32_t i = 0; i < a->object_count; i++) {
        assert_string_equal(a->object[i].name, b->object[i].name);
        assert_int_equal(a->object[i].mesh, b->object[i].mesh);
        assert_int_equal(a->object[i].node, b->object[i].node);
    }
    assert_int_equal(a->camera_count, b->camera_count);
    for (uint32_t i = 0; i < a->camera_count; i++) {
        assert_string_equal(a->camera[i].name, b->camera[i].name);
        assert_int_equal(a->camera[i].node, b->camera[i].node);
        assert_true(a->camera[i].fov_y == b->camera[i].fov_y);
        assert_true(a->camera[i].height_m == b->camera[i].height_m);
    }
}

static void assert_same_lights(const struct lw_scene *a, const struct lw_scene *b) {
    assert_int_equal(a->light_count, b->light_count);
    for (uint32_t i = 0; i < a->light_count; i++) {
        const struct lw_light *l = &a->light[i], *m = &b->light[i];
        assert_string_equal(l->name, m->name);
        assert_int_equal(l->node, m->node);
        assert_int_equal(l->kind, m->kind);
        assert_memory_equal(l->intensity, m->intensity, sizeof l->intensity);
        assert_true(l->inner_cone == m->inner_cone && l->outer_cone == m->outer_cone);
        assert_true(l->angular_diameter == m->angular_diameter);
    }
}

static void assert_same_channels(const struct lw_scene *a, const struct lw_scene *b) {
    assert_int_equal(a->channel_count, b->channel_count);
    for (uint32_t i = 0; i < a->channel_count; i++) {
        const struct lw_channel *c = &a->channel[i], *d = &b->channel[i];
        assert_int_equal(c->node, d->node);
        assert_int_equal(c->path, d->path);
        assert_int_equal(c->interpolation, d->interpolation);
        assert_int_equal(c->key_count, d->key_count);
        size_t width = c->path == LW_CHANNEL_ROTATION ? 4 : 3;
        if (c->interpolation == LW_INTERPOLATION_CUBIC) width *= 3;
        assert_memory_equal(c->time_s, d->time_s, c->key_count * sizeof(float));
        assert_memory_equal(c->value, d->value, c->key_count * width * sizeof(float));
    }
}

void package_case_expect_same_scene(const struct lw_scene *a, const struct lw_scene *b) {
    assert_string_equal(a->name, b->name);
    assert_true(a->duration_s == b->duration_s);
    assert_memory_equal(a->sky, b->sky, sizeof a->sky);
    assert_same_surfaces(a, b);
    assert_same_places(a, b);
    assert_same_lights(a, b);
    assert_same_channels(a, b);
}

enum lw_status package_case_read_exactly(const uint8_t *bytes, size_t size, struct lw_error *err) {
    uint8_t *block = malloc(size ? size : 1);
    assert_non_null(block);
    memcpy(block, bytes, size);
    struct lw_scene *scene = NULL;
    enum lw_status status = lw_package_read(block, size, &scene, err);
    free(block);
    assert_int_equal(scene != NULL, status == LW_OK);
    lw_scene_destroy(scene);
    return status;
}

void package_case_set_u32(uint8_t *p, uint32_t value) { memcpy(p, &value, sizeof value); }
void package_case_set_u64(uint8_t *p, uint64_t value) { memcpy(p, &value, sizeof value); }

uint64_t package_case_section_offset(const uint8_t *bytes, unsigned id) {
    uint64_t offset;
    memcpy(&offset, bytes + ENTRY(id) + 8, sizeof offset);
    return offset;
}
