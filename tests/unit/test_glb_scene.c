/* A scene written as .glb and read back by the strict importer is the same scene; what the importer does not
 * look at (second texture coordinates, extensions, extras) is looked up in the JSON. */
#include "tests/support/support.h"

#include "common/lightmap/lightmap.h"
#include "common/scene/pose.h"
#include "server/bake/glb_scene.h"
#include "server/import/gltf/gltf.h"

#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

struct written {
    struct lw_scene *scene, *read; /* before; read back */
    uint8_t *bytes;
    size_t size;
    json_t *json;
};

static bool split_sides;
static const uint8_t
    *first_shows; /* per vertex: what the first object shows; NULL: fronts, as the others do */

static void write_scene(struct written *w, struct lw_scene *scene, bool with_lights) {
    const char *path = lw_support_temporary("scene.glb");
    struct lw_error err = {0};
    struct lw_glb_scene g;
    *w = (struct written){.scene = scene};
    lw_support_ok(lw_lightmap_build(scene, &(struct lw_lightmap_desc){.texels_per_metre = 8}, NULL, &err),
                  &err);
    lw_support_ok(lw_glb_scene_init(
                      &g, &(struct lw_glb_scene_desc){.scene = scene,
                                                      .convention = lw_convention_get(LW_CONVENTION_GODOT),
                                                      .map_folder = "../maps/",
                                                      .split_sides = split_sides,
                                                      .with_lights = with_lights}),
                  NULL);
    for (uint32_t o = 0; o < scene->object_count; o++) {
        const struct lw_mesh *mesh = &scene->mesh[scene->object[o].mesh];
        const struct lw_map map = {.object = o,
                                   .width = mesh->atlas_width,
                                   .height = mesh->atlas_height,
                                   .back_offset = mesh->back_offset};
        uint8_t *rgb = calloc((size_t)map.width * map.height, 3);
        assert_non_null(rgb);
        memset(rgb, (int)o, (size_t)map.width * map.height * 3);
        const struct lw_sides_shown shown = {
            .back = o == 0 ? (uint8_t *)first_shows : NULL, .back_m2 = 1, .total_m2 = 1};
        lw_glb_scene_add(&g, &map, &shown, "name.exr", rgb, 2.5f);
        free(rgb);
    }
    lw_support_ok(lw_glb_scene_write(&g, path, &err), &err);
    lw_glb_scene_finish(&g);
    lw_support_ok(lw_gltf_load(path, 0, &w->read, &err), &err);
    w->bytes = lw_support_read_file(path, &w->size);
    assert_memory_equal(w->bytes, "glTF\2\0\0\0", 8);
    uint32_t length;
    memcpy(&length, w->bytes + 8, 4);
    assert_int_equal(length, w->size);
    memcpy(&length, w->bytes + 12, 4);
    w->json = json_loadb((const char *)w->bytes + 20, length, 0, NULL);
    assert_non_null(w->json);
}

static void free_written(struct written *w) {
    json_decref(w->json);
    free(w->bytes);
    lw_scene_destroy(w->read);
    lw_scene_destroy(w->scene);
}

/* ---- the same triangles ---- */

/* A corner in world space with all that the reader keeps of it. */
struct corner {
    float value[14]; /* position, normal, UV set 0, colour; alpha mode and sides of the material */
};
struct triangle {
    struct corner corner[3];
};

static struct corner corner_of(const struct lw_scene *scene, const struct lw_pose *pose, uint32_t o,
                               uint32_t t, int k, bool uv) {
    const struct lw_mesh *mesh = &scene->mesh[scene->object[o].mesh];
    const uint32_t v = mesh->triangle[t][k];
    const struct lw_affine *to_world = &pose->object_to_world[o];
    const struct lw_vec3 p = lw_affine_point(to_world, mesh->position[v]),
                         n = lw_affine_normal(to_world, mesh->normal[v]);
    const struct lw_vec4 colour = mesh->colour ? mesh->colour[v] : (struct lw_vec4){1, 1, 1, 1};
    const struct lw_material *m = &scene->material[mesh->material[t]];
    const float u = uv ? mesh->uv[0][v].x : 0, w = uv ? mesh->uv[0][v].y : 0;
    return (struct corner){{p.x, p.y, p.z, n.x, n.y, n.z, u, w, colour.x, colour.y, colour.z, colour.w,
                            (float)m->alpha_mode, (float)m->double_sided}};
}

static int compare(const void *a, const void *b) {
    const float *x = a, *y = b;
    for (int i = 0; i < 3 * 14; i++)
        if (fabsf(x[i] - y[i]) > 1e-4f) return x[i] < y[i] ? -1 : 1;
    return 0;
}

static struct triangle *list_triangles(const struct lw_scene *scene, const struct lw_scene *uv_of,
                                       double time_s, uint32_t *out_count) {
    struct lw_pose pose;
    lw_support_ok(lw_pose_init(&pose, scene), NULL);
    lw_pose_evaluate(&pose, scene, time_s);
    uint32_t count = 0;
    for (uint32_t o = 0; o < scene->object_count; o++)
        count += scene->mesh[scene->object[o].mesh].triangle_count;
    struct triangle *list = calloc(count + 1, sizeof *list);
    assert_non_null(list);
    *out_count = 0;
    for (uint32_t o = 0; o < scene->object_count; o++) {
        const struct lw_mesh *mesh = &scene->mesh[scene->object[o].mesh];
        /* without a set 0 of its own a mesh gets the lightmap's there */
        bool uv = mesh->uv[0] != NULL;
        for (uint32_t m = 0; uv && m < uv_of->mesh_count; m++)
            if (strcmp(uv_of->mesh[m].name, mesh->name) == 0) uv = uv_of->mesh[m].uv[0] != NULL;
        for (uint32_t t = 0; t < mesh->triangle_count; t++, ++*out_count)
            for (int k = 0; k < 3; k++) list[*out_count].corner[k] = corner_of(scene, &pose, o, t, k, uv);
    }
    lw_pose_finish(&pose);
    qsort(list, count, sizeof *list, compare);
    return list;
}

static void expect_same_triangles(const struct written *w, double time_s) {
    uint32_t before, after;
    struct triangle *a = list_triangles(w->scene, w->scene, time_s, &before),
                    *b = list_triangles(w->read, w->scene, time_s, &after);
    assert_int_equal(before, after);
    for (uint32_t i = 0; i < before; i++)
        if (compare(&a[i], &b[i]) != 0) fail_msg("triangle %u of %u differs at %g s", i, before, time_s);
    free(a);
    free(b);
}

static void the_same_scene_comes_back(void **state) {
    (void)state;
    struct written w;
    write_scene(&w, lw_support_everything(), true);
    for (double t = 0; t < 4; t += 0.4) expect_same_triangles(&w, t); /* animation too */
    assert_int_equal(w.read->camera_count, w.scene->camera_count);
    assert_int_equal(w.read->light_count, w.scene->light_count);
    for (uint32_t l = 0; l < w.scene->light_count; l++)
        for (uint32_t r = 0; r < w.read->light_count; r++) {
            const struct lw_light *a = &w.scene->light[l], *b = &w.read->light[r];
            if (strcmp(a->name, b->name) != 0) continue;
            assert_int_equal(a->kind, b->kind);
            for (int c = 0; c < 3; c++) assert_true(fabsf(a->intensity[c] / b->intensity[c] - 1) < 1e-6f);
            assert_true(a->kind != LW_LIGHT_SPOT || a->outer_cone == b->outer_cone);
        }
    free_written(&w);
}

/* ---- materials ---- */

static json_t *at(json_t *json, const char *array, size_t index) {
    json_t *item = json_array_get(json_object_get(json, array), index);
    assert_non_null(item);
    return item;
}

static json_t *down(json_t *json, const char *path) {
    char copy[128];
    snprintf(copy, sizeof copy, "%s", path);
    for (char *key = strtok(copy, "/"); key; key = strtok(NULL, "/")) {
        json = json_is_array(json) ? json_array_get(json, (size_t)atoi(key)) : json_object_get(json, key);
        if (!json) fail_msg("no \"%s\" of %s", key, path);
    }
    return json;
}

static double number(json_t *json, const char *path) { return json_number_value(down(json, path)); }

/* The first material of that name: of the first object that uses it. */
static json_t *material_of(json_t *json, const char *name) {
    json_t *materials = json_object_get(json, "materials");
    for (size_t i = 0; i < json_array_size(materials); i++)
        if (strcmp(json_string_value(down(at(json, "materials", i), "name")), name) == 0)
            return at(json, "materials", i);
    fail_msg("no material %s", name);
    return NULL;
}

static const float *floats_of(const struct written *w, json_t *accessor) {
    json_t *view = at(w->json, "bufferViews", (size_t)number(accessor, "bufferView"));
    uint32_t json_size;
    memcpy(&json_size, w->bytes + 12, 4);
    return (const float *)(w->bytes + 20 + json_size + 8 + (size_t)number(view, "byteOffset"));
}

static void each_object_has_its_own_map(void **state) {
    (void)state;
    struct written w;
    write_scene(&w, lw_support_everything(), false);
    /* two objects of a mesh with two materials, one of a mesh with one */
    assert_int_equal(json_array_size(json_object_get(w.json, "meshes")), 3);
    assert_int_equal(json_array_size(json_object_get(w.json, "materials")), 5);
    bool seen[32] = {false};
    for (size_t m = 0; m < 5; m++) {
        json_t *material = at(w.json, "materials", m);
        assert_true(number(material, "extensions/MOZ_lightmap/intensity") == 2.5);
        assert_true(number(material, "extensions/MOZ_lightmap/texCoord") == 1);
        seen[(size_t)number(material, "extensions/MOZ_lightmap/index")] = true;
        assert_string_equal(json_string_value(down(material, "extras/lightwell/lightmap")),
                            "../maps/name.exr");
        assert_string_equal(json_string_value(down(material, "extras/lightwell/convention")), "godot");
        assert_string_equal(json_string_value(down(material, "extras/lightwell/units")), "W/(m^2 sr)");
    }
    unsigned maps = 0;
    for (size_t i = 0; i < 32; i++) maps += seen[i];
    assert_int_equal(maps, 3);
    /* vertices are written once for both objects */
    assert_true(number(at(w.json, "meshes", 0), "primitives/0/attributes/POSITION") ==
                number(at(w.json, "meshes", 1), "primitives/0/attributes/POSITION"));
    assert_null(json_object_get(json_object_get(w.json, "extensions"), "KHR_lights_punctual"));
    assert_int_equal(w.read->light_count, 0);
    assert_true(json_is_true(down(w.json, "asset/extras/lightwell/lamps_left_out")));
    free_written(&w);
}

static void lightmap_coordinates_are_texels_over_size(void **state) {
    (void)state;
    struct written w;
    write_scene(&w, lw_support_everything(), false);
    const struct lw_mesh *mesh = &w.scene->mesh[0];
    json_t *primitive = down(at(w.json, "meshes", 0), "primitives/0");
    const float *uv =
        floats_of(&w, at(w.json, "accessors", (size_t)number(primitive, "attributes/TEXCOORD_1")));
    for (uint32_t v = 0; v < mesh->vertex_count; v++) {
        assert_true(fabsf(uv[v * 2] * (float)mesh->atlas_width - mesh->lightmap_uv[v].x) < 1e-4f);
        assert_true(fabsf(uv[v * 2 + 1] * (float)mesh->atlas_height - mesh->lightmap_uv[v].y) < 1e-4f);
    }
    /* the scene's own second set has moved on, and who used it follows */
    const float *moved =
        floats_of(&w, at(w.json, "accessors", (size_t)number(primitive, "attributes/TEXCOORD_2")));
    for (uint32_t v = 0; v < mesh->vertex_count; v++)
        assert_true(moved[v * 2] == mesh->uv[1][v].x && moved[v * 2 + 1] == mesh->uv[1][v].y);
    json_t *leaf = material_of(w.json, "leaf 葉"), *lamp = material_of(w.json, "lamp");
    assert_true(number(leaf, "pbrMetallicRoughness/baseColorTexture/texCoord") == 2);
    assert_true(number(lamp, "emissiveTexture/texCoord") == 2);
    assert_true(number(lamp, "pbrMetallicRoughness/baseColorTexture/texCoord") == 0);
    /* {2, 0, 0.5, 0, -1, 1} is a scale and an offset; {0, 1, 0, 1, 0, 0} swaps the axes */
    json_t *transform = down(leaf, "pbrMetallicRoughness/baseColorTexture/extensions/KHR_texture_transform");
    assert_true(number(transform, "scale/0") == 2 && number(transform, "scale/1") == -1);
    assert_true(number(transform, "offset/0") == 0.5 && number(transform, "offset/1") == 1);
    assert_true(fabs(number(transform, "rotation")) < 1e-6);
    transform = down(lamp, "emissiveTexture/extensions/KHR_texture_transform");
    const double angle = number(transform, "rotation"), su = number(transform, "scale/0"),
                 sv = number(transform, "scale/1");
    const double m[4] = {cos(angle) * su, sin(angle) * sv, -sin(angle) * su, cos(angle) * sv},
                 want[4] = {0, 1, 1, 0};
    for (int i = 0; i < 4; i++) assert_true(fabs(m[i] - want[i]) < 1e-6);
    /* a mesh without texture coordinates of its own */
    primitive = down(at(w.json, "meshes", 2), "primitives/0/attributes");
    assert_true(number(primitive, "TEXCOORD_0") == number(primitive, "TEXCOORD_1"));
    free_written(&w);
}

static void emission_and_alpha_stay(void **state) {
    (void)state;
    struct written w;
    write_scene(&w, lw_support_everything(), false);
    json_t *lamp = material_of(w.json, "lamp"), *leaf = material_of(w.json, "leaf 葉");
    const double strength = number(lamp, "extensions/KHR_materials_emissive_strength/emissiveStrength");
    assert_true(fabs(number(lamp, "emissiveFactor/0") * strength - 10) < 1e-5);
    assert_true(fabs(number(lamp, "emissiveFactor/2") * strength - 2.5) < 1e-5);
    assert_string_equal(json_string_value(down(lamp, "alphaMode")), "BLEND");
    assert_string_equal(json_string_value(down(leaf, "alphaMode")), "MASK");
    assert_true(number(leaf, "alphaCutoff") == 0.25);
    assert_true(json_is_true(down(leaf, "doubleSided")));
    free_written(&w);
}

/* Gloss and relief go out as glTF has them; matt materials are written as they always were. */
static void finishes_stay(void **state) {
    (void)state;
    struct written w;
    struct lw_scene *scene = lw_support_everything();
    lw_support_add_finishes(scene);
    write_scene(&w, scene, true);
    json_t *materials = json_object_get(w.json, "materials"), *m;
    size_t i, found = 0;
    json_array_foreach(materials, i, m) {
        const char *name = json_string_value(json_object_get(m, "name"));
        json_t *pbr = json_object_get(m, "pbrMetallicRoughness"),
               *extensions = json_object_get(m, "extensions");
        const double metal = json_number_value(json_object_get(pbr, "metallicFactor")),
                     rough = json_number_value(json_object_get(pbr, "roughnessFactor"));
        json_t *normal = json_object_get(m, "normalTexture"),
               *specular = json_object_get(extensions, "KHR_materials_specular");
        if (strcmp(name, "plain") == 0) {
            assert_true(metal == 0 && rough == 1 && !normal && !specular);
        } else if (strcmp(name, "lamp") == 0) {
            assert_true(metal == 1 && rough == 0 && !normal && specular);
            assert_non_null(json_object_get(specular, "specularTexture"));
        } else {
            found++;
            assert_true(metal == 0.25 && rough == 0.5);
            assert_true(json_number_value(json_object_get(normal, "scale")) == -1.5);
            json_t *surface = json_object_get(pbr, "metallicRoughnessTexture");
            assert_int_equal(json_integer_value(json_object_get(surface, "texCoord")), 2);
            json_t *occlusion = json_object_get(m, "occlusionTexture");
            assert_true(json_number_value(json_object_get(occlusion, "strength")) == 0.875);
            assert_true(json_integer_value(json_object_get(occlusion, "index")) ==
                        json_integer_value(json_object_get(surface, "index")));
            assert_true(json_number_value(json_object_get(specular, "specularFactor")) == 0.75);
            json_t *ior = json_object_get(json_object_get(extensions, "KHR_materials_ior"), "ior");
            assert_true(fabs(json_number_value(ior) - 1.33) < 1e-6);
        }
    }
    assert_int_equal(found, 2); /* both objects */
    free_written(&w);
}

/* An unlit object has no lightmap; an orthographic camera stays one. */
static void unlit_materials_and_orthographic_cameras_stay(void **state) {
    (void)state;
    struct written w;
    struct lw_scene *scene = lw_support_everything();
    scene->material[0].unlit = 1;
    scene->camera[1].height_m = 2.5f;
    write_scene(&w, scene, false);
    json_t *plain = material_of(w.json, "plain");
    assert_non_null(down(plain, "extensions/KHR_materials_unlit"));
    assert_null(json_object_get(down(plain, "extensions"), "MOZ_lightmap"));
    assert_null(json_object_get(plain, "extras")); /* by which engines find a map */
    assert_non_null(json_object_get(material_of(w.json, "lamp"), "extras"));
    assert_non_null(down(material_of(w.json, "lamp"), "extensions/MOZ_lightmap"));
    for (uint32_t m = 0; m < w.read->material_count; m++)
        assert_int_equal(w.read->material[m].unlit, strcmp(w.read->material[m].name, "plain") == 0);
    assert_int_equal(w.read->camera_count, 2);
    for (uint32_t c = 0; c < 2; c++)
        assert_float_equal(w.read->camera[c].height_m, strcmp(w.read->camera[c].name, "main") ? 2.5f : 0, 0);
    free_written(&w);
}

static void textures_keep_pixels_and_wraps(void **state) {
    (void)state;
    struct written w;
    write_scene(&w, lw_support_everything(), false);
    const struct lw_texture *ramp = &w.scene->texture[2], *read = NULL;
    for (uint32_t i = 0; i < w.read->texture_count; i++)
        if (strcmp(w.read->texture[i].name, ramp->name) == 0) read = &w.read->texture[i];
    assert_non_null(read);
    assert_int_equal(read->width, 3);
    assert_int_equal(read->height, 1);
    assert_memory_equal(read->rgba, ramp->rgba, 3 * 4);
    assert_int_equal(read->wrap_s, LW_WRAP_CLAMP);
    assert_int_equal(read->wrap_t, LW_WRAP_MIRROR);
    free_written(&w);
}

static void a_texture_without_coordinates_becomes_a_factor(void **state) {
    (void)state;
    struct written w;
    struct lw_scene *scene = lw_support_everything();
    scene->material[0].base_colour_texture.texture = 1; /* grey 188, on the mesh that has no UV set */
    write_scene(&w, scene, false);
    json_t *pbr = down(material_of(w.json, "plain"), "pbrMetallicRoughness");
    assert_null(json_object_get(pbr, "baseColorTexture"));
    assert_true(fabs(number(pbr, "baseColorFactor/2") - 0.75 * pow((188 / 255.0 + 0.055) / 1.055, 2.4)) <
                1e-4);
    free_written(&w);
}

/* ---- split sides ---- */

static void sides_are_split(void **state) {
    (void)state;
    struct written w;
    split_sides = true;
    write_scene(&w, lw_support_everything(), false);
    split_sides = false;
    /* mesh "full": a leaf, double-sided, one triangle; a lamp, single-sided, one triangle */
    const struct lw_mesh *mesh = &w.scene->mesh[0];
    json_t *primitives = down(at(w.json, "meshes", 0), "primitives");
    assert_int_equal(json_array_size(primitives), 3);
    json_t *front = json_array_get(primitives, 0), *back = json_array_get(primitives, 1);
    assert_true(number(front, "material") == number(back, "material"));
    assert_null(json_object_get(at(w.json, "materials", (size_t)number(front, "material")), "doubleSided"));
    /* the back lies behind the front by a ten-thousandth of the mesh or so, that nothing flickers */
    const float *front_at =
                    floats_of(&w, at(w.json, "accessors", (size_t)number(front, "attributes/POSITION"))),
                *back_at =
                    floats_of(&w, at(w.json, "accessors", (size_t)number(back, "attributes/POSITION")));
    const float *front_uv =
                    floats_of(&w, at(w.json, "accessors", (size_t)number(front, "attributes/TEXCOORD_1"))),
                *back_uv =
                    floats_of(&w, at(w.json, "accessors", (size_t)number(back, "attributes/TEXCOORD_1"))),
                *front_normal =
                    floats_of(&w, at(w.json, "accessors", (size_t)number(front, "attributes/NORMAL"))),
                *back_normal =
                    floats_of(&w, at(w.json, "accessors", (size_t)number(back, "attributes/NORMAL")));
    assert_true(mesh->back_offset > 0);
    for (uint32_t v = 0; v < mesh->vertex_count; v++) {
        assert_true(back_uv[v * 2] == front_uv[v * 2]);
        assert_true(fabsf((back_uv[v * 2 + 1] - front_uv[v * 2 + 1]) * (float)mesh->atlas_height -
                          (float)mesh->back_offset) < 1e-3f);
        float behind = 0;
        for (uint32_t c = 0; c < 3; c++) {
            assert_true(back_normal[v * 3 + c] == -front_normal[v * 3 + c]);
            behind += (front_at[v * 3 + c] - back_at[v * 3 + c]) * front_normal[v * 3 + c];
        }
        assert_true(behind > 0 && behind < 1e-3f);
    }
    const uint16_t *a = (const uint16_t *)(const void *)floats_of(
                       &w, at(w.json, "accessors", (size_t)number(front, "indices"))),
                   *b = (const uint16_t *)(const void *)floats_of(
                       &w, at(w.json, "accessors", (size_t)number(back, "indices")));
    for (int k = 0; k < 3; k++) assert_int_equal(a[k], b[2 - k]);
    free_written(&w);
}

/* Two objects of a mesh: of the first one a vertex's chart shows the back. */
static void an_object_may_show_its_backs(void **state) {
    (void)state;
    struct written w;
    static const uint8_t second_vertex[64] = {[1] = 1};
    first_shows = second_vertex;
    write_scene(&w, lw_support_everything(), false);
    first_shows = NULL;
    const struct lw_mesh *mesh = &w.scene->mesh[0];
    json_t *own = down(at(w.json, "meshes", 0), "primitives/0/attributes"),
           *other = down(at(w.json, "meshes", 1), "primitives/0/attributes");
    assert_true(number(own, "POSITION") == number(other, "POSITION"));
    const float *own_uv = floats_of(&w, at(w.json, "accessors", (size_t)number(own, "TEXCOORD_1"))),
                *other_uv = floats_of(&w, at(w.json, "accessors", (size_t)number(other, "TEXCOORD_1")));
    for (uint32_t v = 0; v < mesh->vertex_count; v++) {
        assert_true(own_uv[v * 2] == other_uv[v * 2]);
        const float rows = (own_uv[v * 2 + 1] - other_uv[v * 2 + 1]) * (float)mesh->atlas_height;
        assert_true(fabsf(rows - (v == 1 ? (float)mesh->back_offset : 0)) < 1e-3f);
    }
    json_t *lightwell = down(at(w.json, "materials", 0), "extras/lightwell");
    assert_string_equal(json_string_value(down(lightwell, "side")), "back");
    free_written(&w);
}

/* ---- what cannot be written ---- */

static void failures_name_the_file(void **state) {
    (void)state;
    struct lw_glb glb;
    struct lw_error err = {0};
    lw_glb_init(&glb, "test");
    lw_support_fails(lw_glb_write(&glb, "/nowhere/a.glb", &err), LW_CANNOT_CREATE, &err, "/nowhere/a.glb");
    err = (struct lw_error){0};
    lw_support_fails(lw_glb_write(&glb, "/dev/full", &err), LW_IO, &err, "/dev/full");
    lw_glb_fail(&glb, LW_BAD_DATA, "the first");
    lw_glb_fail(&glb, LW_NO_MEMORY, "the second");
    assert_int_equal(lw_glb_view(&glb, "x", 1, LW_GLB_TARGET_NONE), LW_GLB_NONE);
    assert_int_equal(lw_glb_add(&glb, "nodes", json_object()), LW_GLB_NONE);
    err = (struct lw_error){0};
    lw_support_fails(lw_glb_write(&glb, lw_support_temporary("never.glb"), &err), LW_BAD_DATA, &err,
                     "the first");
    lw_glb_finish(&glb);
}

int main(void) {
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(the_same_scene_comes_back),
        cmocka_unit_test(each_object_has_its_own_map),
        cmocka_unit_test(lightmap_coordinates_are_texels_over_size),
        cmocka_unit_test(emission_and_alpha_stay),
        cmocka_unit_test(finishes_stay),
        cmocka_unit_test(unlit_materials_and_orthographic_cameras_stay),
        cmocka_unit_test(textures_keep_pixels_and_wraps),
        cmocka_unit_test(a_texture_without_coordinates_becomes_a_factor),
        cmocka_unit_test(sides_are_split),
        cmocka_unit_test(an_object_may_show_its_backs),
        cmocka_unit_test(failures_name_the_file),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
