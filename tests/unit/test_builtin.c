#include "tests/support/failing_memory.h"
#include "tests/support/support.h"

#include "common/base/random.h"
#include "common/builtin/builtin.h"
#include "common/builtin/builtin_texture.h"
#include "common/scene/package.h"
#include "common/scene/pose.h"
#include "common/shading/tangent.h"
#include "common/trace/trace.h"

#include <stdlib.h>
#include <string.h>

static struct lw_scene *build(const char *name) {
    struct lw_scene *scene = NULL;
    struct lw_error err = {0};
    lw_support_ok(lw_builtin_build(name, &scene, &err), &err);
    return scene;
}

static struct lw_vec3 corner(const struct lw_mesh *mesh, uint32_t triangle, int c) {
    return mesh->position[mesh->triangle[triangle][c]];
}

/** Twice the area, along the front's normal. */
static struct lw_vec3 face(const struct lw_mesh *mesh, uint32_t triangle) {
    struct lw_vec3 a = corner(mesh, triangle, 0);
    return lw_vec3_cross(lw_vec3_sub(corner(mesh, triangle, 1), a),
                         lw_vec3_sub(corner(mesh, triangle, 2), a));
}

static void check_scene(const struct lw_scene *scene, uint32_t triangles_min, uint32_t triangles_max) {
    struct lw_error err = {0};
    lw_support_ok(lw_scene_validate(scene, &err), &err);
    assert_true(lw_scene_has_light(scene));
    uint32_t triangles = 0;
    for (uint32_t o = 0; o < scene->object_count; o++)
        triangles += scene->mesh[scene->object[o].mesh].triangle_count;
    assert_in_range(triangles, triangles_min, triangles_max);
    assert_string_equal(scene->camera[0].name, "main");
}

static void check_normals(const struct lw_scene *scene) {
    uint64_t agree = 0, all = 0;
    for (uint32_t m = 0; m < scene->mesh_count; m++) {
        const struct lw_mesh *mesh = &scene->mesh[m];
        for (uint32_t v = 0; v < mesh->vertex_count; v++)
            if (fabsf(lw_vec3_length(mesh->normal[v]) - 1.0f) > 1e-4f)
                fail_msg("%s: normal %u", mesh->name, v);
        for (uint32_t t = 0; t < mesh->triangle_count; t++) {
            struct lw_vec3 n = face(mesh, t);
            if (lw_vec3_length(n) < 1e-9f) fail_msg("%s: triangle %u has no area", mesh->name, t);
            bool outward = true;
            for (int c = 0; c < 3; c++) outward &= lw_vec3_dot(n, mesh->normal[mesh->triangle[t][c]]) > 0;
            agree += outward;
            all++;
        }
    }
    assert_true((double)agree > 0.999 * (double)all);
}

/** Reflects at most what plaster reflects, whatever texture and factor say together. */
static void check_albedo(const struct lw_scene *scene) {
    for (uint32_t m = 0; m < scene->mesh_count; m++) {
        const struct lw_mesh *mesh = &scene->mesh[m];
        for (uint32_t t = 0; t < mesh->triangle_count; t++) {
            struct lw_surface surface;
            lw_scene_surface(scene, mesh, t, 1 / 3.0f, 1 / 3.0f, &surface);
            const float high = fmaxf(surface.base.x, fmaxf(surface.base.y, surface.base.z));
            if (high > 0.86f || high < 0.01f) fail_msg("%s: albedo %g", mesh->name, (double)high);
        }
    }
}

static void test_cornell(void **state) {
    (void)state;
    struct lw_scene *scene = build("builtin:cornell");
    check_scene(scene, 32, 32);
    check_normals(scene);
    check_albedo(scene);
    assert_int_equal(scene->object_count, 8);
    assert_true(scene->duration_s == 0);
    lw_scene_destroy(scene);
}

static void test_cornell_faces_inward(void **state) {
    (void)state;
    struct lw_scene *scene = build("builtin:cornell");
    struct lw_vec3 middle = lw_vec3(0, 1, 0);
    for (uint32_t o = 0; o < scene->object_count; o++) {
        const struct lw_mesh *mesh = &scene->mesh[scene->object[o].mesh];
        bool block = strstr(scene->object[o].name, "block") != NULL;
        for (uint32_t t = 0; t < mesh->triangle_count && !block; t++)
            assert_true(lw_vec3_dot(face(mesh, t), lw_vec3_sub(middle, corner(mesh, t, 0))) > 0);
    }
    lw_scene_destroy(scene);
}

static void test_ajar(void **state) {
    (void)state;
    struct lw_scene *scene = build("builtin:ajar");
    check_scene(scene, 72, 72);
    check_normals(scene);
    check_albedo(scene);
    assert_int_equal(scene->object_count, 16);
    assert_int_equal(scene->camera_count, 1);
    assert_int_equal(scene->light_count, 0); /* the lamp is a surface */
    assert_true(scene->duration_s == 0);
    lw_scene_destroy(scene);
}

/* The lamp sees nothing of the room but a wedge behind the door: all other light there has been reflected. */
static void test_ajar_hides_its_lamp(void **state) {
    (void)state;
    struct lw_scene *scene = build("builtin:ajar");
    struct lw_pose pose;
    struct lw_trace *trace;
    struct lw_error err = {0};
    assert_int_equal(lw_pose_init(&pose, scene), LW_OK);
    lw_support_ok(lw_trace_create(scene, &pose, &trace, &err), &err);
    for (uint32_t i = 0; i < 1 << 16; i += LW_TRACE_WIDTH) {
        struct lw_ray16 rays = {.salt = 0};
        for (uint32_t lane = 0; lane < LW_TRACE_WIDTH; lane++) {
            float at[2], to[2], up[2];
            lw_random_sobol2(i + lane, 1, at);
            lw_random_sobol2(i + lane, 2, to);
            lw_random_sobol2(i + lane, 3, up);
            const struct lw_vec3 from = lw_vec3(0.9f + 0.8f * at[0], 2.49f, -1.7f + 0.8f * at[1]);
            const struct lw_vec3 there = lw_vec3(-2 + 4 * to[0], 2.5f * up[0], 0.45f + 3.5f * to[1]);
            lw_trace_set_ray(&rays, lane, from, lw_vec3_sub(there, from), 1);
        }
        assert_int_equal(lw_trace_occluded16(trace, LW_TRACE_LIGHT, 0xffff, &rays), 0xffff);
    }
    lw_trace_destroy(trace);
    lw_pose_finish(&pose);
    lw_scene_destroy(scene);
}

static void test_atrium(void **state) {
    const struct lw_scene *scene = *state;
    check_scene(scene, 250000, 350000);
    check_normals(scene);
    check_albedo(scene);
    assert_in_range(scene->object_count, 19, 25);
    size_t texture_bytes = 0;
    for (uint32_t i = 0; i < scene->texture_count; i++)
        texture_bytes += (size_t)scene->texture[i].width * scene->texture[i].height * 4;
    assert_in_range(texture_bytes, 1, 16u << 20);
    static const char *const cameras[] = {"main", "gallery", "vase", "lamp"};
    assert_int_equal(scene->camera_count, 4);
    for (int i = 0; i < 4; i++) assert_string_equal(scene->camera[i].name, cameras[i]);
    assert_int_equal(scene->light_count, 1);
    assert_int_equal(scene->light[0].kind, LW_LIGHT_DIRECTIONAL);
}

static void test_atrium_has_what_it_promises(void **state) {
    const struct lw_scene *scene = *state;
    static const char *const names[] = {"floor",        "lower columns", "lower arcade", "red cloth",
                                        "plants",       "amphora",       "krater",       "jar",
                                        "hanging lamp", "lantern",       "armillary"};
    for (size_t i = 0; i < sizeof names / sizeof *names; i++) lw_support_object(scene, names[i]);
    unsigned masked = 0, emissive = 0;
    for (uint32_t i = 0; i < scene->material_count; i++) {
        masked += scene->material[i].alpha_mode == LW_ALPHA_MASK;
        emissive += scene->material[i].emission[0] > 0;
    }
    assert_int_equal(masked, 2);
    assert_int_equal(emissive, 2);
}

/** Whether any entry of two transforms differs by more than `tolerance`. */
static bool differ(const struct lw_affine *a, const struct lw_affine *b, float tolerance) {
    for (int i = 0; i < 3; i++)
        for (int j = 0; j < 4; j++)
            if (fabsf(a->m[i][j] - b->m[i][j]) > tolerance) return true;
    return false;
}

static void test_atrium_moves_lantern_and_rings_alone(void **state) {
    const struct lw_scene *scene = *state;
    struct lw_pose at_start, later;
    lw_support_ok(lw_pose_init(&at_start, scene), NULL);
    lw_support_ok(lw_pose_init(&later, scene), NULL);
    lw_pose_evaluate(&later, scene, 0.2 * (double)scene->duration_s);
    uint32_t lantern = lw_support_object(scene, "lantern"), rings = lw_support_object(scene, "armillary");
    for (uint32_t o = 0; o < scene->object_count; o++) {
        bool expected = o == lantern || o == rings;
        assert_int_equal(lw_pose_object_moves(&at_start, scene, o), expected);
        assert_int_equal(differ(&at_start.object_to_world[o], &later.object_to_world[o], 0.1f), expected);
    }
    lw_pose_finish(&at_start);
    lw_pose_finish(&later);
}

/* Neither a key nor the end of the loop may be felt: at 240 steps a second no step is longer than 4 m/s
 * allow, and no speed changes faster than 8 m/s^2. */
static void test_atrium_loop_is_smooth(void **state) {
    const struct lw_scene *scene = *state;
    struct lw_pose pose;
    lw_support_ok(lw_pose_init(&pose, scene), NULL);
    assert_true(scene->duration_s == 20.0f);
    const int rate = 240, steps = rate * 20;
    uint32_t moving[2] = {lw_support_object(scene, "lantern"), lw_support_object(scene, "armillary")};
    for (int m = 0; m < 2; m++) {
        struct lw_vec3 before = {0, 0, 0}, speed_before = {0, 0, 0};
        for (int i = 0; i <= steps + rate; i++) { /* a second into the next round */
            lw_pose_evaluate(&pose, scene, (double)i / rate);
            struct lw_vec3 at = lw_affine_point(&pose.object_to_world[moving[m]], lw_vec3(0.3f, 0, 0.3f));
            struct lw_vec3 speed = lw_vec3_scale(lw_vec3_sub(at, before), (float)rate);
            if (i > 0) assert_true(lw_vec3_length(speed) < 4.0f);
            if (i > 1) assert_true(lw_vec3_length(lw_vec3_sub(speed, speed_before)) * (float)rate < 8.0f);
            before = at;
            speed_before = speed;
        }
    }
    lw_pose_finish(&pose);
}

static const struct lw_finish *finish_of(const struct lw_scene *scene, const char *material) {
    for (uint32_t m = 0; m < scene->material_count; m++)
        if (strcmp(scene->material[m].name, material) == 0) return scene->material[m].finish;
    fail_msg("no material %s", material);
    return NULL;
}

static void test_atrium_has_finishes(void **state) {
    const struct lw_scene *scene = *state;
    for (uint32_t m = 0; m < scene->material_count; m++) /* all but what shines */
        assert_int_equal(scene->material[m].finish == NULL, lw_material_shines(&scene->material[m]));
    assert_true(finish_of(scene, "bronze")->metalness == 1 && finish_of(scene, "brass")->metalness == 1);
    assert_true(finish_of(scene, "water")->ior == 1.33f && finish_of(scene, "water")->roughness < 0.1f);
    assert_true(finish_of(scene, "red cloth")->roughness > 0.8f);
    uint32_t metals = 0;
    for (uint32_t m = 0; m < scene->material_count; m++)
        metals += scene->material[m].finish && scene->material[m].finish->metalness > 0;
    assert_int_equal(metals, 2);
}

/* Tiles are smooth and their grout is not; metals send back about what their base colour says. */
static void test_atrium_finishes_vary(void **state) {
    const struct lw_scene *scene = *state;
    const struct lw_texture *surface =
        &scene->finish_texture[finish_of(scene, "tiles")->surface_texture.texture];
    const uint8_t *grout = surface->rgba, /* where four tiles meet, and the middle of one */
        *glaze = surface->rgba + 4 * ((size_t)(surface->height / 8) * surface->width + surface->width / 8);
    assert_int_equal(surface->content, LW_CONTENT_SURFACE);
    assert_true(grout[1] > 220 && glaze[1] < 130);
    assert_true(grout[0] < glaze[0]);
    const struct lw_mesh *rings = &scene->mesh[scene->object[lw_support_object(scene, "armillary")].mesh];
    struct lw_surface at;
    lw_scene_surface(scene, rings, 0, 0.3f, 0.3f, &at);
    assert_true(at.base.x > 0.5f && fabsf(at.albedo.x / at.base.x - 1) < 0.1f);
}

/** The largest mean step in either direction between texels `from` and `from + 1` of rows or columns. */
static float step_across(const struct lw_texture *texture, bool rows, uint32_t from) {
    const uint32_t count = rows ? texture->width : texture->height,
                   side = rows ? texture->height : texture->width;
    float sum[2] = {0, 0};
    for (uint32_t i = 0; i < count; i++)
        for (int c = 0; c < 2; c++) {
            const uint32_t a = from, b = (from + 1) % side;
            const size_t p = rows ? (size_t)a * texture->width + i : (size_t)i * texture->width + a,
                         q = rows ? (size_t)b * texture->width + i : (size_t)i * texture->width + b;
            sum[c] +=
                fabsf((float)texture->rgba[4 * p + (size_t)c] - (float)texture->rgba[4 * q + (size_t)c]);
        }
    return fmaxf(sum[0], sum[1]) / (float)count;
}

/* Every normal map is of unit normals that lean little on the whole, and goes on where it repeats: the step
 * there is no larger than the largest one inside. */
static void test_atrium_normal_maps_repeat(void **state) {
    const struct lw_scene *scene = *state;
    unsigned maps = 0;
    for (uint32_t t = 0; t < scene->finish_texture_count; t++) {
        const struct lw_texture *texture = &scene->finish_texture[t];
        if (texture->content != LW_CONTENT_NORMAL) continue;
        double up = 0, aside[2] = {0, 0};
        const size_t count = (size_t)texture->width * texture->height;
        for (size_t i = 0; i < count; i++) {
            const uint8_t *p = texture->rgba + 4 * i;
            const float x = (float)p[0] / 127.5f - 1, y = (float)p[1] / 127.5f - 1,
                        z = (float)p[2] / 127.5f - 1;
            if (fabsf(x * x + y * y + z * z - 1) > 0.03f) fail_msg("%s: a normal is not unit", texture->name);
            aside[0] += (double)x, aside[1] += (double)y, up += (double)z;
        }
        if (up < 0.9 * (double)count) fail_msg("%s: %g", texture->name, up / (double)count);
        for (int c = 0; c < 2; c++) assert_true(fabs(aside[c]) < 0.02 * (double)count);
        for (int rows = 0; rows < 2; rows++) {
            const uint32_t side = rows ? texture->height : texture->width;
            float inside = 0;
            for (uint32_t i = 0; i + 1 < side; i++) inside = fmaxf(inside, step_across(texture, rows, i));
            if (step_across(texture, rows, side - 1) > 1.01f * inside)
                fail_msg("%s: %g across its edge, at most %g inside", texture->name,
                         (double)step_across(texture, rows, side - 1), (double)inside);
        }
        maps++;
    }
    assert_in_range(maps, 8, 16);
}

/* A map's x is where u grows on the surface, its y where v falls, whichever way the triangle lies. */
static void test_atrium_tangents(void **state) {
    const struct lw_scene *scene = *state;
    uint32_t checked = 0;
    for (uint32_t m = 0; m < scene->mesh_count; m++) {
        const struct lw_mesh *mesh = &scene->mesh[m];
        for (uint32_t t = 0; t < mesh->triangle_count && mesh->tangent; t += 7) {
            const uint32_t *v = mesh->triangle[t];
            const struct lw_vec2 *uv = mesh->uv[0];
            const float eu = uv[v[1]].x - uv[v[0]].x, ev = uv[v[1]].y - uv[v[0]].y,
                        fu = uv[v[2]].x - uv[v[0]].x, fv = uv[v[2]].y - uv[v[0]].y, area = eu * fv - ev * fu;
            const struct lw_vec3 e = lw_vec3_sub(corner(mesh, t, 1), corner(mesh, t, 0)),
                                 f = lw_vec3_sub(corner(mesh, t, 2), corner(mesh, t, 0)),
                                 n = lw_vec3_normalize(face(mesh, t));
            bool even = fabsf(area) > 1e-6f; /* its corners' normals are its own */
            for (int c = 0; c < 3; c++) even &= lw_vec3_dot(mesh->normal[v[c]], n) > 0.9999f;
            if (!even) continue;
            const struct lw_vec4 decoded =
                lw_tangent_decode(mesh->tangent[3 * (size_t)t], mesh->normal[v[0]]);
            const struct lw_vec3 tangent = lw_vec3(decoded.x, decoded.y, decoded.z),
                                 y = lw_vec3_scale(lw_vec3_cross(n, tangent), decoded.w);
            const struct lw_vec3 along_u = lw_vec3_normalize(
                lw_vec3_scale(lw_vec3_sub(lw_vec3_scale(e, fv), lw_vec3_scale(f, ev)), 1 / area));
            const struct lw_vec3 along_v =
                lw_vec3_scale(lw_vec3_sub(lw_vec3_scale(f, eu), lw_vec3_scale(e, fu)), 1 / area);
            if (lw_vec3_dot(tangent, along_u) < 0.999f) fail_msg("%s: triangle %u: tangent", mesh->name, t);
            if (lw_vec3_dot(y, along_v) >= 0) fail_msg("%s: triangle %u: y", mesh->name, t);
            checked++;
        }
    }
    assert_true(checked > 1000);
}

static void assert_same(const void *a, const void *b, size_t size) {
    assert_int_equal(a == NULL, b == NULL);
    if (a) assert_memory_equal(a, b, size);
}

/* It is the same court: meshes but the water's texture coordinates, colours but the metals', all the rest. */
static void test_atrium_matt(void **state) {
    const struct lw_scene *scene = *state;
    struct lw_scene *matt = build("builtin:atrium-matt");
    check_scene(matt, 250000, 350000);
    assert_string_equal(matt->name, scene->name);
    assert_int_equal(matt->finish_texture_count, 0);
    assert_int_equal(matt->material_count, scene->material_count);
    for (uint32_t m = 0; m < matt->material_count; m++) {
        assert_null(matt->material[m].finish);
        const bool metal = scene->material[m].finish && scene->material[m].finish->metalness > 0;
        if (!metal)
            assert_memory_equal(matt->material[m].base_colour, scene->material[m].base_colour,
                                sizeof matt->material[m].base_colour);
    }
    assert_int_equal(matt->texture_count, scene->texture_count);
    for (uint32_t t = 0; t < matt->texture_count; t++)
        assert_same(matt->texture[t].rgba, scene->texture[t].rgba,
                    4ul * matt->texture[t].width * matt->texture[t].height);
    assert_int_equal(matt->mesh_count, scene->mesh_count);
    for (uint32_t m = 0; m < matt->mesh_count; m++) {
        const struct lw_mesh *a = &matt->mesh[m], *b = &scene->mesh[m];
        assert_null(a->tangent);
        assert_int_equal(a->vertex_count, b->vertex_count);
        assert_int_equal(a->triangle_count, b->triangle_count);
        assert_same(a->position, b->position, a->vertex_count * sizeof *a->position);
        assert_same(a->normal, b->normal, a->vertex_count * sizeof *a->normal);
        assert_same(a->triangle, b->triangle, a->triangle_count * sizeof *a->triangle);
        assert_same(a->material, b->material, a->triangle_count * sizeof *a->material);
        if (strcmp(a->name, "basin") != 0)
            assert_same(a->uv[0], b->uv[0], a->vertex_count * sizeof *a->uv[0]);
    }
    lw_scene_destroy(matt);
}

/* ---- city ---- */

static void test_city(void **state) {
    (void)state;
    struct lw_scene *scene = build("builtin:city:1");
    check_scene(scene, 100000, 200000);
    check_normals(scene);
    check_albedo(scene);
    static const char *const cameras[] = {"main", "square", "bird", "roofs", "walk"};
    assert_int_equal(scene->camera_count, 5);
    for (int i = 0; i < 5; i++) assert_string_equal(scene->camera[i].name, cameras[i]);
    unsigned kinds[3] = {0};
    for (uint32_t i = 0; i < scene->light_count; i++) kinds[scene->light[i].kind]++;
    assert_int_equal(kinds[LW_LIGHT_DIRECTIONAL], 1);
    assert_int_equal(kinds[LW_LIGHT_SPOT], 2);
    for (uint32_t m = 0; m < scene->mesh_count; m++) { /* no tower where none stands */
        uint32_t uses = 0;
        for (uint32_t o = 0; o < scene->object_count; o++) uses += scene->object[o].mesh == m;
        assert_true(uses > 0);
    }
    lw_scene_destroy(scene);
}

/** Triangles that shine, of all objects. */
static uint32_t count_emitters(const struct lw_scene *scene) {
    uint32_t count = 0;
    for (uint32_t o = 0; o < scene->object_count; o++) {
        const struct lw_mesh *mesh = &scene->mesh[scene->object[o].mesh];
        for (uint32_t t = 0; t < mesh->triangle_count; t++)
            count += scene->material[mesh->material[t]].emission[0] > 0;
    }
    return count;
}

static void test_city_grows_by_instances(void **state) {
    (void)state;
    struct lw_scene *town = build("builtin:city"), *largest = build("builtin:city:32");
    check_scene(town, 3500000, 4500000);
    check_scene(largest, 28u * 3500000u, LW_SCENE_TRIANGLES_MAX);
    assert_int_equal(town->mesh_count, largest->mesh_count);
    assert_true(count_emitters(town) > 5000);
    uint64_t once = 0; /* what clients download */
    for (uint32_t m = 0; m < town->mesh_count; m++) once += town->mesh[m].triangle_count;
    assert_true(once < 500000);
    lw_scene_destroy(town);
    lw_scene_destroy(largest);
}

/** How far one can go from a point, m. */
static float clearance(const struct lw_trace *trace, struct lw_vec3 from, struct lw_vec3 direction) {
    struct lw_ray16 rays = {0};
    struct lw_hit16 hits;
    lw_trace_set_ray(&rays, 0, from, direction, 1e4f);
    lw_trace_closest16(trace, LW_TRACE_LIGHT, 1, &rays, &hits);
    return hits.object[0] == LW_TRACE_MISS ? 1e4f : hits.t[0];
}

/* Every quarter of a second the walker has pavement under the feet, nothing within a foot of the head, and
 * nothing in the way to the next place; its speed is that of a person, and it ends where it began. */
static void test_city_walk_is_free(void **state) {
    (void)state;
    struct lw_scene *scene = build("builtin:city:2");
    struct lw_pose pose;
    struct lw_trace *trace = NULL;
    struct lw_error err = {0};
    lw_support_ok(lw_pose_init(&pose, scene), NULL);
    assert_true(scene->duration_s == 120.0f);
    const uint32_t node = scene->camera[4].node;
    struct lw_vec3 before = {0, 0, 0}, start = {0, 0, 0};
    for (int step = 0; step <= 480; step++) {
        /* the end of the loop is its start again: stop just short of it */
        lw_pose_evaluate(&pose, scene, fmin(0.25 * step, 119.9999));
        if (!trace) lw_support_ok(lw_trace_create(scene, &pose, &trace, &err), &err);
        lw_support_ok(lw_trace_set_pose(trace, &pose, &err), &err);
        const struct lw_vec3 eye = lw_affine_point(&pose.node_to_world[node], lw_vec3(0, 0, 0));
        const float floor = clearance(trace, eye, lw_vec3(0, -1, 0));
        if (floor < 1.6f || floor > 1.75f)
            fail_msg("at %g s the floor is %g m below", 0.25 * step, (double)floor);
        for (int i = 0; i < 12; i++) {
            float angle = LW_PI * (float)i / 6.0f;
            if (clearance(trace, eye, lw_vec3(sinf(angle), 0, cosf(angle))) < 0.3f)
                fail_msg("at %g s something is within 0.3 m", 0.25 * step);
        }
        const struct lw_vec3 way = lw_vec3_sub(eye, before);
        if (step == 0)
            start = eye;
        else {
            const float length = lw_vec3_length(way);
            assert_true(length < 0.25f * 2.5f);
            assert_true(clearance(trace, before, lw_vec3_normalize(way)) > length);
        }
        before = eye;
    }
    assert_true(lw_vec3_length(lw_vec3_sub(before, start)) < 0.01f);
    lw_trace_destroy(trace);
    lw_pose_finish(&pose);
    lw_scene_destroy(scene);
}

/* Car, tram and lantern go round their blocks without a jump and clear of all else, and nothing else
 * moves. */
static void test_city_traffic(void **state) {
    (void)state;
    struct lw_scene *scene = build("builtin:city:2");
    struct lw_pose pose;
    struct lw_trace *trace = NULL;
    struct lw_error err = {0};
    lw_support_ok(lw_pose_init(&pose, scene), NULL);
    lw_support_ok(lw_trace_create(scene, &pose, &trace, &err), &err);
    const struct {
        const char *name;
        float half_x, front, rear, height, speed_max;
    } vehicle[] = {{"car", 0.9f, -2.2f, 2.2f, 0.6f, 9.0f},
                   {"tram", 1.2f, -4.3f, 4.3f, 1.0f, 7.0f},
                   {"lantern", 0.2f, -0.2f, 0.2f, 0, 2.5f}};
    uint32_t movers = 0;
    for (uint32_t o = 0; o < scene->object_count; o++) movers += lw_pose_object_moves(&pose, scene, o);
    assert_int_equal(movers, 3);
    for (int v = 0; v < 3; v++) {
        const uint32_t object = lw_support_object(scene, vehicle[v].name);
        struct lw_vec3 before = {0, 0, 0};
        for (int step = 0; step <= 1300; step++) { /* a second into the next round */
            lw_pose_evaluate(&pose, scene, 0.1 * step);
            lw_support_ok(lw_trace_set_pose(trace, &pose, &err), &err);
            const struct lw_affine *at = &pose.object_to_world[object];
            const struct lw_vec3 middle = lw_affine_point(at, lw_vec3(0, 0, 0));
            if (step) assert_true(lw_vec3_length(lw_vec3_sub(middle, before)) < 0.1f * vehicle[v].speed_max);
            before = middle;
            /* along the outline, at bumpers' height */
            const struct lw_vec3 corner[4] = {
                lw_affine_point(at, lw_vec3(-vehicle[v].half_x, vehicle[v].height, vehicle[v].front)),
                lw_affine_point(at, lw_vec3(vehicle[v].half_x, vehicle[v].height, vehicle[v].front)),
                lw_affine_point(at, lw_vec3(vehicle[v].half_x, vehicle[v].height, vehicle[v].rear)),
                lw_affine_point(at, lw_vec3(-vehicle[v].half_x, vehicle[v].height, vehicle[v].rear))};
            for (int i = 0; i < 4; i++) {
                const struct lw_vec3 side = lw_vec3_sub(corner[(i + 1) % 4], corner[i]);
                if (clearance(trace, corner[i], lw_vec3_normalize(side)) < lw_vec3_length(side))
                    fail_msg("%s touches something at %g s", vehicle[v].name, 0.1 * step);
            }
        }
    }
    lw_trace_destroy(trace);
    lw_pose_finish(&pose);
    lw_scene_destroy(scene);
}

static void test_arguments(void **state) {
    (void)state;
    static const struct {
        const char *name, *said;
    } bad[] = {{"builtin:city:0", "\"0\""},
               {"builtin:city:33", "\"33\""},
               {"builtin:city:", "\"\""},
               {"builtin:city:two", "\"two\""},
               {"builtin:city:2 ", "\"2 \""},
               {"builtin:city:-1", "\"-1\""},
               {"builtin:city:+1", "\"+1\""},
               {"builtin:city:4294967297", "\"4294967297\""},
               {"builtin:city:2:3", "\"2:3\""},
               {"builtin:city:1e1", "\"1e1\""},
               {"builtin:cornell:2", "no argument"},
               {"builtin:ajar:1", "no argument"},
               {"builtin:atrium:", "no argument"},
               {"builtin:atrium-matt:1", "builtin:atrium-matt takes no argument"}};
    for (size_t i = 0; i < sizeof bad / sizeof *bad; i++) {
        struct lw_scene *scene = NULL;
        struct lw_error err = {0};
        assert_int_equal(lw_builtin_build(bad[i].name, &scene, &err), LW_USAGE);
        assert_null(scene);
        if (!strstr(err.text, bad[i].said)) fail_msg("%s: %s", bad[i].name, err.text);
        if (strstr(bad[i].name, "city")) assert_non_null(strstr(err.text, "from 1 to 32"));
    }
    char many[300] = "builtin:city:";
    memset(many + strlen(many), '7', 280);
    struct lw_scene *scene = NULL;
    struct lw_error err = {0};
    assert_int_equal(lw_builtin_build(many, &scene, &err), LW_USAGE);
    assert_non_null(strstr(err.text, "from 1 to 32"));
    assert_int_equal(lw_builtin_build("builtin:citycentre", &scene, &err), LW_NO_INPUT);
}

/* test_atrium_matt() compares the two atriums. */
static void test_same_bytes_every_time(void **state) {
    (void)state;
    static const char *const names[] = {"builtin:cornell", "builtin:ajar", "builtin:city:1"};
    for (size_t i = 0; i < sizeof names / sizeof *names; i++) {
        uint8_t *bytes[2];
        size_t size[2];
        for (int k = 0; k < 2; k++) {
            struct lw_scene *scene = build(names[i]);
            struct lw_error err = {0};
            lw_support_ok(lw_package_write(scene, &bytes[k], &size[k], &err), &err);
            lw_scene_destroy(scene);
        }
        assert_int_equal(size[0], size[1]);
        assert_memory_equal(bytes[0], bytes[1], size[0]);
        free(bytes[0]);
        free(bytes[1]);
    }
}

/** Builds with one failing allocation, after `before` good ones. Returns false if the build needs no more
 * than `before`. */
static bool fails_after(const char *name, unsigned before) {
    struct lw_scene *scene = NULL;
    struct lw_error err = {0};
    failing_memory_one(before);
    enum lw_status status = lw_builtin_build(name, &scene, &err);
    const bool failed = failing_memory_end();
    assert_int_equal(status, failed ? LW_NO_MEMORY : LW_OK);
    if (failed) {
        assert_null(scene);
        assert_non_null(strstr(err.text, "memory"));
    }
    lw_scene_destroy(scene);
    return failed;
}

/* Every allocation of the small scene fails in turn, and some of the large one's, which takes its time. */
static void test_out_of_memory(void **state) {
    (void)state;
    unsigned enough = 0;
    while (fails_after("builtin:cornell", enough)) enough++;
    assert_in_range(enough, 10, 1000);
    static const unsigned stops[] = {0, 4, 4000};
    for (size_t i = 0; i < sizeof stops / sizeof *stops; i++)
        assert_true(fails_after("builtin:atrium-matt", stops[i]) && fails_after("builtin:city:1", stops[i]));
}

static void test_reliefs_out_of_memory(void **state) {
    (void)state;
    bool failed = true;
    for (unsigned before = 0; failed; before++) {
        struct lw_builtin_stage stage;
        struct lw_scene *scene = NULL;
        struct lw_error err = {0};
        assert_int_equal(lw_builtin_stage_init(&stage, "reliefs"), LW_OK);
        failing_memory_one(before);
        const struct lw_builtin_relief relief =
            lw_builtin_texture_add_relief(&stage, LW_BUILTIN_RELIEF_BRONZE);
        failed = failing_memory_end();
        assert_int_equal(stage.failed, failed);
        if (!failed) assert_true(before >= 3 && relief.normal == 0 && relief.surface == 1);
        assert_int_equal(lw_builtin_stage_finish(&stage, &scene, &err), failed ? LW_NO_MEMORY : LW_OK);
        lw_scene_destroy(scene);
    }
}

static void test_unknown_name_lists_the_names(void **state) {
    (void)state;
    struct lw_scene *scene = NULL;
    struct lw_error err = {0};
    assert_int_equal(lw_builtin_build("builtin:teapot", &scene, &err), LW_NO_INPUT);
    assert_null(scene);
    assert_non_null(strstr(err.text, "builtin:teapot"));
    unsigned count = 0;
    for (; lw_builtin_name(count); count++) {
        assert_non_null(strstr(err.text, lw_builtin_name(count)));
        assert_true(strlen(lw_builtin_about(count)) > 0);
    }
    assert_true(count >= 1);
    assert_null(lw_builtin_about(count));
}

int main(void) {
    struct lw_scene *atrium = build("builtin:atrium");
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(test_cornell),
        cmocka_unit_test(test_cornell_faces_inward),
        cmocka_unit_test(test_ajar),
        cmocka_unit_test(test_ajar_hides_its_lamp),
        cmocka_unit_test_prestate(test_atrium, atrium),
        cmocka_unit_test_prestate(test_atrium_has_what_it_promises, atrium),
        cmocka_unit_test_prestate(test_atrium_moves_lantern_and_rings_alone, atrium),
        cmocka_unit_test_prestate(test_atrium_loop_is_smooth, atrium),
        cmocka_unit_test_prestate(test_atrium_has_finishes, atrium),
        cmocka_unit_test_prestate(test_atrium_finishes_vary, atrium),
        cmocka_unit_test_prestate(test_atrium_normal_maps_repeat, atrium),
        cmocka_unit_test_prestate(test_atrium_tangents, atrium),
        cmocka_unit_test_prestate(test_atrium_matt, atrium),
        cmocka_unit_test(test_city),
        cmocka_unit_test(test_city_grows_by_instances),
        cmocka_unit_test(test_city_walk_is_free),
        cmocka_unit_test(test_city_traffic),
        cmocka_unit_test(test_arguments),
        cmocka_unit_test(test_same_bytes_every_time),
        cmocka_unit_test(test_out_of_memory),
        cmocka_unit_test(test_reliefs_out_of_memory),
        cmocka_unit_test(test_unknown_name_lists_the_names),
    };
    int failed = cmocka_run_group_tests(tests, NULL, NULL);
    lw_scene_destroy(atrium);
    return failed;
}
