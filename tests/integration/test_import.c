/* The importer as a whole: real scenes, files and folders, the program lightwell-import, and the code that
 * spawns it. */
#include "tests/support/process.h"

#include "common/base/clock.h"
#include "common/base/log.h"
#include "common/base/sanitizer.h"
#include "common/lightmap/lightmap.h"
#include "common/open/import_spawn.h"
#include "common/scene/package.h"
#include "common/scene/pose.h"
#include "server/import/gltf/gltf.h"

#include <dirent.h>
#include <errno.h>
#include <fcntl.h>
#include <pthread.h>
#include <signal.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/stat.h>
#include <unistd.h>

/* ---- real scenes ---- */

static struct lw_scene *load_scene(const char *relative) {
    struct lw_scene *scene = NULL;
    struct lw_error err = {0};
    lw_support_ok(lw_gltf_load(lw_support_scene(relative), 0, &scene, &err), &err);
    return scene;
}

static const struct {
    const char *path;
    unsigned triangles, degenerate, objects, lights;
} real_scenes[] = {
    {"sponza/Sponza.gltf", 262267, 422, 25, 0},
    {"sponza/Sponza_lit.gltf", 262267, 422, 25, 6},
    {"classroom/classroom.gltf", 103832, 2, 79, 1},
    {"mixed-lighting/MixedLightingExample.gltf", 40898, 0, 6, 1},
    {"cornell-uv1/CornellBox.glb", 36, 0, 4, 0},
    {"conformance/khronos/Box/Box.glb", 12, 0, 1, 0},
    {"conformance/khronos/BoxInterleaved/BoxInterleaved.gltf", 12, 0, 1, 0},
    {"conformance/khronos/BoxVertexColors/BoxVertexColors.gltf", 12, 0, 1, 0},
    {"conformance/khronos/SimpleMeshes/SimpleMeshes.gltf", 2, 0, 2, 0},
    {"conformance/khronos/SimpleSparseAccessor/SimpleSparseAccessor.gltf", 12, 0, 1, 0},
    {"conformance/khronos/TriangleWithoutIndices/TriangleWithoutIndices.gltf", 1, 0, 1, 0},
    {"conformance/khronos/TextureCoordinateTest/TextureCoordinateTest.gltf", 10, 0, 5, 0},
    {"conformance/khronos/TextureTransformTest/TextureTransformTest.gltf", 24, 0, 12, 0},
    {"conformance/alpha_modes/alpha_modes.gltf", 14, 0, 7, 0},
    {"conformance/emissive_strength/emissive_strength.gltf", 22, 0, 6, 0},
    {"conformance/lights_punctual/lights_punctual.gltf", 24, 0, 2, 6},
    {"conformance/negative_scale/negative_scale.gltf", 84, 0, 12, 0},
    {"conformance/uv1/uv1.gltf", 50, 0, 5, 0},
    {"conformance/draco/uv1_draco.glb", 50, 0, 5, 0},
};

static void real_scenes_have_their_triangles(void **state) {
    (void)state;
    for (size_t i = 0; i < sizeof real_scenes / sizeof *real_scenes; i++) {
        struct lw_scene *scene = load_scene(real_scenes[i].path);
        if (lw_support_triangles(scene) + real_scenes[i].degenerate != real_scenes[i].triangles ||
            scene->object_count != real_scenes[i].objects || scene->light_count != real_scenes[i].lights)
            fail_msg("%s: %llu triangles, %u objects, %u lights", real_scenes[i].path,
                     (unsigned long long)lw_support_triangles(scene), scene->object_count,
                     scene->light_count);
        lw_scene_destroy(scene);
    }
}

static const struct lw_material *material_of(const struct lw_scene *scene, const char *object) {
    for (uint32_t i = 0; i < scene->object_count; i++)
        if (strcmp(scene->object[i].name, object) == 0)
            return &scene->material[scene->mesh[scene->object[i].mesh].material[0]];
    fail_msg("no object %s", object);
    return NULL;
}

static void emission_is_factor_times_strength(void **state) {
    (void)state;
    static const struct {
        const char *object;
        float strength, green;
    } expected[] = {{"q0", 1, 0.5f}, {"q1", 2.5f, 0.5f}, {"q2", 25, 0.5f}, {"q3", 250, 0.5f}, {"q4", 25, 1}};
    struct lw_scene *scene = load_scene("conformance/emissive_strength/emissive_strength.gltf");
    for (size_t i = 0; i < sizeof expected / sizeof *expected; i++) {
        const struct lw_material *material = material_of(scene, expected[i].object);
        assert_float_equal(material->emission[0], expected[i].strength, 1e-4);
        assert_float_equal(material->emission[1], expected[i].strength * expected[i].green, 1e-4);
    }
    assert_int_equal(material_of(scene, "q3")->emission_texture.texture, LW_SCENE_NONE);
    assert_int_equal(material_of(scene, "q4")->emission_texture.texture, 0);
    lw_scene_destroy(scene);
}

static void lights_keep_their_units(void **state) {
    (void)state;
    struct lw_scene *scene = load_scene("conformance/lights_punctual/lights_punctual.gltf");
    assert_float_equal(lw_support_light(scene, "pt")->intensity[0], 50, 0);
    assert_int_equal(lw_support_light(scene, "pt")->kind, LW_LIGHT_POINT);
    assert_float_equal(lw_support_light(scene, "pt_range")->intensity[0], 6, 1e-5);
    assert_float_equal(lw_support_light(scene, "spot")->intensity[2], 120, 1e-4);
    assert_float_equal(lw_support_light(scene, "spot")->inner_cone, 0.2, 1e-6);
    assert_float_equal(lw_support_light(scene, "spot")->outer_cone, 0.5, 1e-6);
    assert_float_equal(lw_support_light(scene, "spot_default")->inner_cone, 0, 0);
    assert_float_equal(lw_support_light(scene, "spot_default")->outer_cone, 0.785398163, 1e-6);
    assert_int_equal(lw_support_light(scene, "sun")->kind, LW_LIGHT_DIRECTIONAL);
    assert_float_equal(lw_support_light(scene, "sun")->intensity[2], 2.7, 1e-5);
    assert_float_equal(lw_support_light(scene, "default_everything")->intensity[1], 1, 0);

    /* the spot hangs on a parent that is scaled by 2 and turned by -90 degrees about x: (0, 0, 1) goes to (0,
     * 2, 0) above the parent's (0, 2, 0), and -z to -y */
    struct lw_pose pose;
    lw_support_ok(lw_pose_init(&pose, scene), NULL);
    const struct lw_light_state *spot = &pose.light[lw_support_light(scene, "spot") - scene->light];
    assert_float_equal(spot->position_ws.y, 4, 1e-5);
    assert_float_equal(spot->position_ws.z, 0, 1e-5);
    assert_float_equal(spot->direction_ws.y, -1, 1e-5);
    lw_pose_finish(&pose);
    lw_scene_destroy(scene);

    scene = load_scene("sponza/Sponza_lit.gltf");
    assert_float_equal(lw_support_light(scene, "sun")->intensity[0], 80000, 0);
    assert_float_equal(lw_support_light(scene, "brazier2")->intensity[2], 100, 1e-4);
    lw_scene_destroy(scene);
}

static void mirrored_objects_keep_their_normals_outward(void **state) {
    (void)state;
    struct lw_scene *scene = load_scene("conformance/negative_scale/negative_scale.gltf");
    struct lw_pose pose;
    unsigned mirrored = 0;
    lw_support_ok(lw_pose_init(&pose, scene), NULL);
    for (uint32_t i = 0; i < scene->object_count; i++) {
        const struct lw_mesh *mesh = &scene->mesh[scene->object[i].mesh];
        const struct lw_affine *place = &pose.object_to_world[i];
        bool is_box = mesh->triangle_count == 12;
        mirrored += lw_affine_determinant(place) < 0;
        struct lw_vec3 centre = lw_affine_point(place, lw_vec3(0, 0, 0));
        for (uint32_t v = 0; is_box && v < mesh->vertex_count; v++) {
            struct lw_vec3 outward = lw_vec3_sub(lw_affine_point(place, mesh->position[v]), centre);
            assert_true(lw_vec3_dot(outward, lw_affine_normal(place, mesh->normal[v])) > 0);
        }
    }
    assert_int_equal(mirrored, 4);
    lw_pose_finish(&pose);
    lw_scene_destroy(scene);
}

static void uv_sets_are_those_of_the_file(void **state) {
    (void)state;
    static const bool has[5][2] = {{true, true}, {true, true}, {true, false}, {false, false}, {true, true}};
    struct lw_scene *scene = load_scene("conformance/uv1/uv1.gltf");
    for (uint32_t i = 0; i < scene->object_count; i++)
        for (int set = 0; set < 2; set++)
            assert_int_equal(scene->mesh[scene->object[i].mesh].uv[set] != NULL, has[i][set]);
    assert_int_equal(material_of(scene, "n0")->base_colour_texture.uv_set, 0);
    assert_int_equal(material_of(scene, "n1")->base_colour_texture.uv_set, 1);
    lw_scene_destroy(scene);
}

static void alpha_modes_arrive(void **state) {
    (void)state;
    struct lw_scene *scene = load_scene("conformance/alpha_modes/alpha_modes.gltf");
    static const int mode[5] = {LW_ALPHA_OPAQUE, LW_ALPHA_MASK, LW_ALPHA_MASK, LW_ALPHA_BLEND,
                                LW_ALPHA_BLEND};
    for (int i = 0; i < 5; i++) {
        char name[3] = {'q', (char)('0' + i), 0};
        assert_int_equal(material_of(scene, name)->alpha_mode, mode[i]);
        assert_int_equal(material_of(scene, name)->double_sided, i == 4);
    }
    assert_float_equal(material_of(scene, "q1")->alpha_cutoff, 0.5, 0);
    assert_float_equal(material_of(scene, "q2")->alpha_cutoff, 0.9, 1e-6);
    assert_float_equal(material_of(scene, "glass_factor")->base_colour[3], 0.25, 0);
    assert_int_equal(scene->texture_count, 1); /* five materials, one picture */
    lw_scene_destroy(scene);
}

/* The test has markers where the tip of the arrow must be seen, and where it is seen by a reader that ignores
 * the rotation. Both must then fall on the same place of the texture. */
static void rotated_textures_turn_the_right_way(void **state) {
    (void)state;
    struct lw_scene *scene = load_scene("conformance/khronos/TextureTransformTest/TextureTransformTest.gltf");
    const float *m = material_of(scene, "Rotation")->base_colour_texture.transform;
    float right[2] = {0.5f - 0.07904822f, 0.5f + 0.51626749f}, plain = 0.5f + 0.27781746f;
    assert_float_equal(m[0] * right[0] + m[1] * right[1] + m[2], plain, 1e-4);
    assert_float_equal(m[3] * right[0] + m[4] * right[1] + m[5], plain, 1e-4);
    m = material_of(scene, "Offset V")->base_colour_texture.transform;
    assert_float_equal(m[5], 0.5, 0);
    m = material_of(scene, "Scale")->base_colour_texture.transform;
    assert_float_equal(m[0], 1.5, 1e-6);
    lw_scene_destroy(scene);
}

static void sparse_elements_arrive(void **state) {
    (void)state;
    struct lw_scene *scene = load_scene("conformance/khronos/SimpleSparseAccessor/SimpleSparseAccessor.gltf");
    float highest = 0;
    for (uint32_t i = 0; i < scene->mesh[0].vertex_count; i++)
        highest = fmaxf(highest, scene->mesh[0].position[i].y);
    assert_float_equal(highest, 4, 0); /* 1 in the plain data */
    lw_scene_destroy(scene);
}

static void vertex_colours_arrive(void **state) {
    (void)state;
    struct lw_scene *scene = load_scene("conformance/khronos/BoxVertexColors/BoxVertexColors.gltf");
    const struct lw_mesh *mesh = &scene->mesh[0];
    assert_non_null(mesh->colour);
    struct lw_vec3 lowest = lw_vec3(1, 1, 1), highest = lw_vec3(0, 0, 0);
    for (uint32_t i = 0; i < mesh->vertex_count; i++) {
        struct lw_vec4 c = mesh->colour[i];
        lowest = lw_vec3(fminf(lowest.x, c.x), fminf(lowest.y, c.y), fminf(lowest.z, c.z));
        highest = lw_vec3(fmaxf(highest.x, c.x), fmaxf(highest.y, c.y), fmaxf(highest.z, c.z));
    }
    assert_float_equal(lowest.x + lowest.y + lowest.z, 0, 1e-2);
    assert_float_equal(highest.x + highest.y + highest.z, 3, 1e-2);
    lw_scene_destroy(scene);
}

/* ---- files beside the scene ---- */

static const char scene_format[] =
    "{\"asset\":{\"version\":\"2.0\"},\"nodes\":[{\"mesh\":0}],"
    "\"meshes\":[{\"primitives\":[{\"attributes\":{\"POSITION\":0}%s}]}],%s"
    "\"accessors\":[{\"bufferView\":0,\"componentType\":5126,\"count\":3,\"type\":\"VEC3\"}],"
    "\"bufferViews\":[{\"buffer\":0,\"byteLength\":36}],\"buffers\":[{\"byteLength\":36,\"uri\":\"%s\"}]}";

/* A scene of one triangle that names its buffer by `uri`; `texture`: NULL or the uri of its picture. */
static const char *write_scene(const char *uri, const char *texture) {
    char textures[512] = "", text[2048];
    if (texture)
        snprintf(textures, sizeof textures,
                 "\"materials\":[{\"pbrMetallicRoughness\":{\"baseColorTexture\":{\"index\":0}}}],"
                 "\"textures\":[{\"source\":0}],\"images\":[{\"uri\":\"%s\"}],",
                 texture);
    int length = snprintf(text, sizeof text, scene_format, texture ? ",\"material\":0" : "", textures, uri);
    const char *path = lw_support_temporary("one.gltf");
    lw_support_write_file(path, text, (size_t)length);
    return path;
}

static const float corners[9] = {0, 0, 0, 1, 0, 0, 0, 1, 0};

static void load_one(const char *uri, const char *texture, enum lw_status expected, const char *text) {
    struct lw_scene *scene = NULL;
    struct lw_error err = {0};
    const char *path = write_scene(uri, texture);
    enum lw_status status = lw_gltf_load(path, 0, &scene, &err);
    if (expected == LW_OK)
        lw_support_ok(status, &err);
    else
        lw_support_fails(status, expected, &err, text);
    if (expected != LW_OK) assert_true(strncmp(err.text, path, strlen(path)) == 0);
    lw_scene_destroy(scene);
}

static void buffers_lie_in_the_folder_of_the_scene(void **state) {
    (void)state;
    lw_support_write_file(lw_support_temporary("a b.bin"), corners, sizeof corners);
    assert_true(mkdir(lw_support_temporary("sub"), 0700) == 0 || errno == EEXIST);
    lw_support_write_file(lw_support_temporary("sub/c.bin"), corners, sizeof corners);
    lw_support_write_file(lw_support_temporary("short.bin"), corners, sizeof corners - 1);
    load_one("a%20b.bin", NULL, LW_OK, NULL);
    load_one("a b.bin", NULL, LW_OK, NULL);
    load_one("./sub/../sub/%63.bin", NULL, LW_OK, NULL);
    load_one("sub/../../one.gltf", NULL, LW_BAD_DATA, "leaves the folder");
    load_one("../../../../../../etc/passwd", NULL, LW_BAD_DATA, "leaves the folder");
    load_one("/etc/passwd", NULL, LW_BAD_DATA, "leaves the folder");
    load_one("file:///etc/passwd", NULL, LW_BAD_DATA, "only data: and relative paths");
    load_one("short.bin", NULL, LW_BAD_DATA, "\"short.bin\": has 35 bytes, 36 are declared");
    load_one("missing.bin", NULL, LW_BAD_DATA, "\"missing.bin\": No such file");
    load_one("sub", NULL, LW_BAD_DATA, "is not a regular file");
    load_one("a b.bin", "missing.png", LW_OK, NULL); /* one warning; a colour stands in */
    load_one("a b.bin", "short.bin", LW_OK, NULL);
    load_one("a b.bin", "sub", LW_OK, NULL);
    load_one("a b.bin", "../missing.png", LW_OK, NULL);
}

static void a_fifo_does_not_hang_the_reader(void **state) {
    (void)state;
    assert_true(mkfifo(lw_support_temporary("fifo"), 0600) == 0 || errno == EEXIST);
    load_one("fifo", NULL, LW_BAD_DATA, "is not a regular file");
}

static void a_scene_that_is_not_there_is_no_input(void **state) {
    (void)state;
    struct lw_scene *scene = NULL;
    struct lw_error err = {0};
    lw_support_fails(lw_gltf_load(lw_support_temporary("none.gltf"), 0, &scene, &err), LW_NO_INPUT, &err,
                     "none.gltf: No such");
}

/* ---- spawning ---- */

/* What a call leaves behind in $TMPDIR and says on stderr. */
struct surroundings {
    char folder[512], talk[4096];
    int saved_stderr;
};

static void enter(struct surroundings *s) {
    snprintf(s->folder, sizeof s->folder, "%s", lw_support_temporary("tmp"));
    assert_true(mkdir(s->folder, 0700) == 0 || errno == EEXIST);
    setenv("TMPDIR", s->folder, 1);
    fflush(stderr);
    s->saved_stderr = dup(STDERR_FILENO);
    int file = open(lw_support_temporary("talk"), O_RDWR | O_CREAT | O_TRUNC, 0600);
    assert_true(file >= 0 && dup2(file, STDERR_FILENO) >= 0);
    close(file);
}

static void leave(struct surroundings *s) {
    fflush(stderr);
    dup2(s->saved_stderr, STDERR_FILENO);
    close(s->saved_stderr);
    size_t size;
    uint8_t *talk = lw_support_read_file(lw_support_temporary("talk"), &size);
    snprintf(s->talk, sizeof s->talk, "%s", (const char *)talk);
    free(talk);
    DIR *folder = opendir(s->folder);
    assert_non_null(folder);
    for (struct dirent *entry; (entry = readdir(folder));)
        if (entry->d_name[0] != '.') fail_msg("%s/%s was left behind", s->folder, entry->d_name);
    closedir(folder);
}

static enum lw_status spawn(const struct lw_import_spawn_desc *desc, struct surroundings *s,
                            struct lw_scene **out, struct lw_error *err) {
    *out = NULL;
    enter(s);
    enum lw_status status = lw_import_spawn(desc, out, err);
    leave(s);
    return status;
}

static void a_spawned_import_gives_a_scene_with_lightmaps(void **state) {
    (void)state;
    struct lw_scene *scene;
    struct lw_error err = {0};
    struct surroundings s;
    const struct lw_import_spawn_desc desc = {
        .scene = "builtin:cornell", .texels_per_metre = 8, .threads = 1};
    lw_support_ok(spawn(&desc, &s, &scene, &err), &err);
    assert_true(scene->object_count > 0);
    assert_non_null(scene->mesh[0].lightmap_uv);

    /* a package is read as it is */
    const char *package = lw_support_temporary("own.lwscene");
    lw_support_ok(lw_package_save(scene, package, &err), &err);
    struct lw_scene *again;
    lw_support_ok(
        spawn(&(struct lw_import_spawn_desc){.scene = package, .program = "/nonexistent"}, &s, &again, &err),
        &err);
    assert_int_equal(again->object_count, scene->object_count);
    assert_string_equal(s.talk, "");
    lw_scene_destroy(again);

    /* also by its magic, and options that come too late are named */
    const char *renamed = lw_support_temporary("own.data");
    assert_int_equal(rename(package, renamed), 0);
    lw_support_ok(
        spawn(&(struct lw_import_spawn_desc){.scene = renamed, .texels_per_metre = 9}, &s, &again, &err),
        &err);
    assert_non_null(strstr(s.talk, "--texels-per-metre"));
    lw_scene_destroy(again);
    lw_scene_destroy(scene);
}

static void density_reaches_the_importer(void **state) {
    (void)state;
    struct lw_scene *coarse, *fine;
    struct lw_error err = {0};
    struct surroundings s;
    lw_support_ok(spawn(&(struct lw_import_spawn_desc){.scene = "builtin:cornell", .texels_per_metre = 8}, &s,
                        &coarse, &err),
                  &err);
    lw_support_ok(spawn(&(struct lw_import_spawn_desc){.scene = "builtin:cornell", .texels_per_metre = 32},
                        &s, &fine, &err),
                  &err);
    assert_true(fine->mesh[0].atlas_width > coarse->mesh[0].atlas_width);
    lw_scene_destroy(coarse);

    /* a bound on texels is reported once, in metres */
    lw_support_ok(spawn(&(struct lw_import_spawn_desc){.scene = "builtin:cornell", .texels_max = 2000}, &s,
                        &coarse, &err),
                  &err);
    const char *line = strstr(s.talk, "m texels (object \"");
    assert_non_null(line);
    assert_null(strstr(line + 1, "m texels (object \""));
    assert_non_null(strstr(line, "2000 texels in all are the most; set --max-texels or --texels-per-metre"));
    assert_true(coarse->mesh[0].atlas_width < fine->mesh[0].atlas_width);
    lw_scene_destroy(coarse);
    lw_scene_destroy(fine);
    lw_support_ok(spawn(&(struct lw_import_spawn_desc){.scene = "builtin:cornell"}, &s, &fine, &err), &err);
    assert_null(strstr(s.talk, "texels"));
    lw_scene_destroy(fine);

    /* whatever the daemon takes, the importer takes */
    const struct lw_import_spawn_desc least = {.scene = "builtin:cornell",
                                               .texels_per_metre = LW_LIGHTMAP_DENSITY_MIN,
                                               .atlas_side_max = LW_LIGHTMAP_SIDE_MIN},
                                      most = {.scene = "builtin:cornell",
                                              .texels_per_metre = LW_LIGHTMAP_DENSITY_MAX,
                                              .atlas_side_max = LW_LIGHTMAP_SIDE_MIN};
    lw_support_ok(spawn(&least, &s, &coarse, &err), &err);
    lw_support_ok(spawn(&most, &s, &fine, &err), &err);
    for (uint32_t m = 0; m < fine->mesh_count; m++) {
        assert_true(fine->mesh[m].atlas_width <= LW_LIGHTMAP_SIDE_MIN);
        assert_true(fine->mesh[m].atlas_width >= coarse->mesh[m].atlas_width);
    }
    lw_scene_destroy(fine);
    lw_scene_destroy(coarse);
}

static void a_failure_is_reported_once_and_keeps_its_kind(void **state) {
    (void)state;
    struct lw_scene *scene;
    struct surroundings s;
    lw_support_write_file(lw_support_temporary("short.bin"), corners, sizeof corners - 1);
    struct lw_error err = {0};
    const char *path = write_scene("short.bin", NULL);
    lw_support_fails(spawn(&(struct lw_import_spawn_desc){.scene = path}, &s, &scene, &err), LW_BAD_DATA,
                     &err, "has 35 bytes, 36 are declared");
    assert_true(strncmp(err.text, path, strlen(path)) == 0);
    assert_null(strstr(s.talk, "declared"));

    err = (struct lw_error){0};
    lw_support_fails(spawn(&(struct lw_import_spawn_desc){.scene = "no such file.glb"}, &s, &scene, &err),
                     LW_NO_INPUT, &err, "no such file.glb");
    err = (struct lw_error){0};
    lw_support_fails(spawn(&(struct lw_import_spawn_desc){.scene = "--help"}, &s, &scene, &err), LW_NO_INPUT,
                     &err, "--help");
    err = (struct lw_error){0};
    lw_support_fails(spawn(&(struct lw_import_spawn_desc){.scene = "builtin:nothing"}, &s, &scene, &err),
                     LW_NO_INPUT, &err, "builtin:nothing");
    err = (struct lw_error){0};
    lw_support_fails(
        spawn(&(struct lw_import_spawn_desc){.scene = "x.glb", .program = "/nonexistent/importer"}, &s,
              &scene, &err),
        LW_OS, &err, "/nonexistent/importer");
}

/* A stand-in for the importer: a shell script. */
static const char *write_program(const char *script) {
    const char *path = lw_support_temporary("stand-in");
    lw_support_write_file(path, script, strlen(script));
    assert_int_equal(chmod(path, 0700), 0);
    return path;
}

static void crashes_are_distinguished_from_refusals(void **state) {
    (void)state;
    struct lw_scene *scene;
    struct surroundings s;
    struct lw_error err = {0};
    struct lw_import_spawn_desc desc = {.scene = "x.glb"};
    desc.program = write_program("#!/bin/sh\nkill -SEGV $$\n");
    lw_support_fails(spawn(&desc, &s, &scene, &err), LW_INTERNAL, &err, "signal 11");
    err = (struct lw_error){0};
    desc.program = write_program("#!/bin/sh\nkill -TERM $$\n");
    lw_support_fails(spawn(&desc, &s, &scene, &err), LW_CLOSED, &err, "signal 15");
    err = (struct lw_error){0};
    desc.program = write_program("#!/bin/sh\necho talk >&2\nexit 74\n");
    lw_support_fails(spawn(&desc, &s, &scene, &err), LW_IO, &err, "ended with code 74");
    assert_string_equal(s.talk, "talk\n"); /* what it says reaches the terminal */
    err = (struct lw_error){0};
    desc.program = write_program("#!/bin/sh\nexit 1\n");
    lw_support_fails(spawn(&desc, &s, &scene, &err), LW_INTERNAL, &err, "ended with code 1");
    err = (struct lw_error){0};
    desc.program = write_program("#!/bin/sh\nprintf garbage >\"$2\"\n");
    lw_support_fails(spawn(&desc, &s, &scene, &err), LW_BAD_DATA, &err, "scene.lwscene");
    err = (struct lw_error){0};
    desc.program = write_program("#!/bin/sh\nexit 0\n");
    lw_support_fails(spawn(&desc, &s, &scene, &err), LW_NO_INPUT, &err, "scene.lwscene");
    /* a failure longer than an error holds is cut, not waited for */
    err = (struct lw_error){0};
    desc.program = write_program("#!/bin/sh\nhead -c 200000 /dev/zero | tr '\\0' x >&3\nexit 65\n");
    lw_support_fails(spawn(&desc, &s, &scene, &err), LW_BAD_DATA, &err, "xxxx");
}

static _Atomic bool cancelled;

static void *cancel_soon(void *context) {
    (void)context;
    nanosleep(&(struct timespec){.tv_nsec = 200000000}, NULL);
    cancelled = 1;
    return NULL;
}

/* talk: what the importer must have said */
static void expect_quick_cancel(const char *script, const char *talk) {
    struct lw_scene *scene;
    struct surroundings s;
    struct lw_error err = {0};
    pthread_t thread;
    cancelled = 0;
    const struct lw_import_spawn_desc desc = {
        .scene = "x.glb", .program = write_program(script), .cancel = &cancelled};
    assert_int_equal(pthread_create(&thread, NULL, cancel_soon, NULL), 0);
    uint64_t started_ns = lw_clock_ns();
    enum lw_status status = spawn(&desc, &s, &scene, &err);
    pthread_join(thread, NULL);
    lw_support_fails(status, LW_CLOSED, &err, "x.glb: the import was stopped");
    assert_true(lw_clock_ns() - started_ns < 20000000000ull);
    assert_string_equal(s.talk, talk);
}

static void cancelling_stops_the_importer(void **state) {
    (void)state;
    expect_quick_cancel("#!/bin/sh\ntouch \"$2\" \"$2.part\"\nexec sleep 60\n", "");
    /* it is asked first; and one that will not hear of it, or that closed the pipe, ends as well */
    expect_quick_cancel("#!/bin/sh\ntrap 'echo asked >&2; exit 0' TERM\nwhile :; do sleep 0.05; done\n",
                        "asked\n");
    expect_quick_cancel("#!/bin/sh\ntrap '' TERM\nwhile :; do :; done\n", "");
    expect_quick_cancel("#!/bin/sh\nexec 3>&-\nexec sleep 60\n", "");
}

static void memory_is_bounded(void **state) {
    (void)state;
    struct lw_scene *scene;
    struct surroundings s;
    struct lw_error err = {0};
    if (LW_SANITIZER) skip(); /* the limit is not imposed in such builds */
    const struct lw_import_spawn_desc desc = {
        .scene = "x.glb",
        .memory_max = 64 << 20,
        .program =
            write_program("#!/bin/sh\ni=0\nwhile [ $i -lt 300 ]\ndo\n[ $(ulimit -v) = 65536 ] && exit 71\n"
                          "sleep 0.1\ni=$((i + 1))\ndone\nexit 1\n")}; /* the limit comes after the start */
    lw_support_fails(spawn(&desc, &s, &scene, &err), LW_NO_MEMORY, &err, "out of memory");
}

/* By its own name, by a hard link, by a symbolic one; a package may be written over itself. */
static void what_is_read_is_not_written_over(void **state) {
    (void)state;
    char words[1024];
    size_t size, after;
    const char *scene = lw_support_temporary("court.obj"), *hard = lw_support_temporary("hard.obj"),
               *soft = lw_support_temporary("soft.obj"), *package = lw_support_temporary("court.lwscene");
    static const char text[] = "v 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 3\n";
    lw_support_write_file(scene, text, strlen(text));
    assert_int_equal(link(scene, hard), 0);
    assert_int_equal(symlink("court.obj", soft), 0);
    const char *const names[] = {scene, hard, soft};
    for (size_t i = 0; i < 3; i++) {
        snprintf(words, sizeof words, "%s -o %s", scene, names[i]);
        lw_process_refuses("lightwell-import", words, 64, "would write over the scene, which is read",
                           LW_PROCESS_LIMIT_S);
        uint8_t *bytes = lw_support_read_file(scene, &after);
        assert_int_equal(after, strlen(text));
        assert_memory_equal(bytes, text, after);
        free(bytes);
    }
    struct lw_process process;
    uint8_t *bytes[2];
    for (int i = 0; i < 2; i++) {
        snprintf(words, sizeof words, "%s -o %s", i ? package : scene, package);
        lw_process_start(&process, "lightwell-import", words);
        assert_int_equal(lw_process_finish(&process, LW_PROCESS_LIMIT_S), 0);
        bytes[i] = lw_support_read_file(package, i ? &after : &size);
    }
    assert_int_equal(size, after);
    assert_memory_equal(bytes[0], bytes[1], size);
    free(bytes[0]);
    free(bytes[1]);
}

/* Whether a file of the folder has this ending. */
static bool has_ending(const char *folder, const char *ending) {
    DIR *dir = opendir(folder);
    assert_non_null(dir);
    bool found = false;
    for (struct dirent *entry; (entry = readdir(dir));) {
        const size_t length = strlen(entry->d_name), wanted = strlen(ending);
        found |= length > wanted && strcmp(entry->d_name + length - wanted, ending) == 0;
    }
    closedir(dir);
    return found;
}

/* At once when it begins to write: either it is stopped, or it was done. */
static void a_signal_while_it_writes_leaves_nothing(void **state) {
    (void)state;
    static const int signals[] = {SIGTERM, SIGINT, SIGHUP};
    const char *folder = lw_support_temporary("half");
    assert_int_equal(mkdir(folder, 0700), 0);
    char words[512], package[256];
    snprintf(package, sizeof package, "%s/city.lwscene", folder);
    char source[256]; /* charts and all: the work before the writing takes a fifth of building it */
    struct lw_process importer;
    snprintf(source, sizeof source, "%s", lw_support_temporary("city.lwscene"));
    snprintf(words, sizeof words, "builtin:city:1 --texels-per-metre 0.5 -o %s", source);
    lw_process_run(&importer, "lightwell-import", words, 0);
    snprintf(words, sizeof words, "%s -o %s", source, package);
    for (size_t i = 0; i < sizeof signals / sizeof *signals; i++) {
        struct lw_process process;
        lw_process_start(&process, "lightwell-import", words);
        while (lw_process_runs(&process) && !has_ending(folder, ".tmp")) {
        }
        const int code = lw_process_stop(&process, signals[i], LW_PROCESS_LIMIT_S);
        assert_true(code == 0 || code == -signals[i]);
        assert_false(has_ending(folder, ".tmp"));
        const bool there = access(package, F_OK) == 0;
        assert_true(there || code != 0);
        if (there) { /* the signal may have come right behind the last byte */
            struct lw_scene *scene;
            struct lw_error err = {0};
            lw_support_ok(lw_package_load(package, &scene, &err), &err);
            lw_scene_destroy(scene);
        }
        unlink(package);
    }
    assert_int_equal(rmdir(folder), 0);
}

static void help_tells_people_what_is_for_people(void **state) {
    (void)state;
    struct lw_process process;
    lw_process_start(&process, "lightwell-import", "--help");
    assert_int_equal(lw_process_finish(&process, LW_PROCESS_LIMIT_S), 0);
    char *help = lw_process_out(&process);
    assert_non_null(strstr(help, "--texels-per-metre"));
    assert_null(strstr(help, "--failure-fd"));
    free(help);
}

int main(void) {
    lw_log_init("test_import", LW_LOG_WARNING);
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(real_scenes_have_their_triangles),
        cmocka_unit_test(emission_is_factor_times_strength),
        cmocka_unit_test(lights_keep_their_units),
        cmocka_unit_test(mirrored_objects_keep_their_normals_outward),
        cmocka_unit_test(uv_sets_are_those_of_the_file),
        cmocka_unit_test(alpha_modes_arrive),
        cmocka_unit_test(rotated_textures_turn_the_right_way),
        cmocka_unit_test(sparse_elements_arrive),
        cmocka_unit_test(vertex_colours_arrive),
        cmocka_unit_test(buffers_lie_in_the_folder_of_the_scene),
        cmocka_unit_test(a_fifo_does_not_hang_the_reader),
        cmocka_unit_test(a_scene_that_is_not_there_is_no_input),
        cmocka_unit_test(a_spawned_import_gives_a_scene_with_lightmaps),
        cmocka_unit_test(density_reaches_the_importer),
        cmocka_unit_test(a_failure_is_reported_once_and_keeps_its_kind),
        cmocka_unit_test(crashes_are_distinguished_from_refusals),
        cmocka_unit_test(cancelling_stops_the_importer),
        cmocka_unit_test(memory_is_bounded),
        cmocka_unit_test(what_is_read_is_not_written_over),
        cmocka_unit_test(a_signal_while_it_writes_leaves_nothing),
        cmocka_unit_test(help_tells_people_what_is_for_people),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
