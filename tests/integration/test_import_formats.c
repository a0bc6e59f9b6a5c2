/* lightwell-import and those who spawn it on other formats than glTF: real scenes, the same scene through
 * every format, and files at which the reader crashes, loops or eats memory. */
#include "tests/support/process.h"
#include "tests/support/support.h"

#include "common/base/log.h"
#include "common/base/sanitizer.h"
#include "common/open/import_spawn.h"
#include "common/scene/package.h"
#include "common/scene/pose.h"
#include "server/import/foreign/foreign.h"
#include "server/import/gltf/gltf.h"

#include <dirent.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/wait.h>
#include <unistd.h>

static struct lw_scene *load(const char *path) {
    struct lw_foreign_desc desc = {.path = path};
    struct lw_scene *scene = NULL;
    struct lw_error err = {0};
    lw_support_ok(lw_scene_format_of(path, &desc.format, &err), &err);
    lw_support_ok(desc.format == LW_SCENE_FORMAT_GLTF ? lw_gltf_load(path, 0, &scene, &err)
                                                      : lw_foreign_load(&desc, &scene, &err),
                  &err);
    return scene;
}

struct bounds {
    struct lw_vec3 min, max;
};

static struct bounds bounds_of(const struct lw_scene *scene) {
    struct lw_pose pose;
    struct bounds bounds;
    lw_support_ok(lw_pose_init(&pose, scene), NULL);
    assert_true(lw_pose_bounds(&pose, scene, &bounds.min, &bounds.max));
    lw_pose_finish(&pose);
    return bounds;
}

static void assert_near(struct lw_vec3 a, struct lw_vec3 b, float tolerance, const char *what) {
    if (lw_vec3_length(lw_vec3_sub(a, b)) > tolerance)
        fail_msg("%s: (%g, %g, %g), not (%g, %g, %g)", what, (double)a.x, (double)a.y, (double)a.z,
                 (double)b.x, (double)b.y, (double)b.z);
}

/* ---- real scenes ---- */

static void the_cornell_box_of_obj_arrives(void **state) {
    (void)state;
    struct lw_scene *scene = load(lw_support_scene("cornell-obj/CornellBox-Original.obj"));
    assert_int_equal(lw_support_triangles(scene), 36);
    struct bounds bounds = bounds_of(scene); /* the extremes of its "v" lines */
    assert_near(bounds.min, lw_vec3(-1.02f, 0, -1.04f), 1e-5f, "lowest corner");
    assert_near(bounds.max, lw_vec3(1, 1.99f, 0.99f), 1e-5f, "highest corner");
    unsigned lamps = 0, reds = 0;
    for (uint32_t i = 0; i < scene->material_count; i++) {
        const struct lw_material *material = &scene->material[i];
        if (strcmp(material->name, "light") == 0) {
            assert_float_equal(material->emission[0], 17, 0);
            assert_float_equal(material->emission[1], 12, 0);
            assert_float_equal(material->emission[2], 4, 0);
            assert_float_equal(material->base_colour[0], 0.78, 1e-6);
            lamps++;
        } else {
            assert_float_equal(material->emission[0], 0, 0);
        }
        if (strcmp(material->name, "leftWall") == 0) {
            assert_float_equal(material->base_colour[0], 0.63, 1e-6);
            assert_float_equal(material->base_colour[2], 0.05, 1e-6);
            reds++;
        }
    }
    assert_int_equal(lamps, 1);
    assert_true(reds >= 1);
    lw_scene_destroy(scene);
    scene = load(lw_support_scene("cornell-obj/cornell_box_multimaterial.obj"));
    assert_int_equal(lw_support_triangles(scene), 36);
    lw_scene_destroy(scene);
}

/* ---- one scene, all formats ---- */

/* Runs Debian's `assimp export` where it is installed. */
static bool export_scene(const char *from, const char *to, const char *format) {
    pid_t pid = fork();
    if (pid == 0) {
        freopen("/dev/null", "w", stdout);
        freopen("/dev/null", "w", stderr);
        execlp("assimp", "assimp", "export", from, to, format, (char *)NULL);
        _exit(127);
    }
    int status;
    assert_int_equal(waitpid(pid, &status, 0), pid);
    return WIFEXITED(status) && WEXITSTATUS(status) == 0 && access(to, R_OK) == 0;
}

/* Albedo of the material of the first triangle of every object, summed with the object's index as weight:
 * tells whether objects have their own materials. */
static struct lw_vec3 paint_of(const struct lw_scene *scene) {
    struct lw_vec3 sum = {0};
    for (uint32_t i = 0; i < scene->object_count; i++) {
        const struct lw_mesh *mesh = &scene->mesh[scene->object[i].mesh];
        const float *c = scene->material[mesh->material[0]].base_colour;
        sum = lw_vec3_add(sum, lw_vec3((float)mesh->triangle_count * c[0], (float)mesh->triangle_count * c[1],
                                       (float)mesh->triangle_count * c[2]));
    }
    return sum;
}

static void a_scene_is_the_same_through_every_format(void **state) {
    (void)state;
    static const struct {
        const char *path;
        bool sheared; /* by a matrix, which FBX has no words for */
    } scenes[] = {
        {"conformance/khronos/Box/Box.glb", false},
        {"conformance/emissive_strength/emissive_strength.gltf", false},
        {"conformance/negative_scale/negative_scale.gltf", true},
        {"conformance/alpha_modes/alpha_modes.gltf", false},
    };
    /* factor: what the exporter forgets. It writes metres and calls them FBX's centimetres. */
    static const struct {
        const char *format, *ending;
        float factor;
        bool materials;
    } formats[] = {
        {"-fobj", ".obj", 1, true},   {"-fcollada", ".dae", 1, true}, {"-ffbxa", ".fbx", 100, true},
        {"-fply", ".ply", 1, false},  {"-fplyb", ".ply", 1, false},   {"-fstl", ".stl", 1, false},
        {"-fstlb", ".stl", 1, false},
    };
    for (size_t s = 0; s < sizeof scenes / sizeof *scenes; s++) {
        struct lw_scene *source = load(lw_support_scene(scenes[s].path));
        struct bounds expected = bounds_of(source);
        float size = lw_vec3_length(lw_vec3_sub(expected.max, expected.min));
        for (size_t f = 0; f < sizeof formats / sizeof *formats; f++) {
            char name[64], path[512];
            if (scenes[s].sheared && strcmp(formats[f].ending, ".fbx") == 0) continue;
            snprintf(name, sizeof name, "copy%zu%zu%s", s, f, formats[f].ending);
            snprintf(path, sizeof path, "%s", lw_support_temporary(name));
            if (!export_scene(lw_support_scene(scenes[s].path), path, formats[f].format)) {
                print_message("no `assimp export` here (Debian: assimp-utils): skipped\n");
                lw_scene_destroy(source);
                skip();
            }
            struct lw_scene *copy = load(path);
            if (lw_support_triangles(copy) != lw_support_triangles(source))
                fail_msg("%s as %s has %llu triangles", scenes[s].path, formats[f].format,
                         (unsigned long long)lw_support_triangles(copy));
            struct bounds bounds = bounds_of(copy);
            assert_near(lw_vec3_scale(bounds.min, formats[f].factor), expected.min, 1e-5f * size, path);
            assert_near(lw_vec3_scale(bounds.max, formats[f].factor), expected.max, 1e-5f * size, path);
            if (formats[f].materials) {
                assert_int_equal(copy->object_count, source->object_count);
                /* pictures do not come along: colours stand in for them */
                if (!source->texture_count) assert_near(paint_of(copy), paint_of(source), 1e-3f, path);
            }
            lw_scene_destroy(copy);
        }
        lw_scene_destroy(source);
    }
}

/* ---- files that hurt ---- */

static void write_text(const char *name, const char *text) {
    FILE *file = fopen(lw_support_temporary(name), "wb");
    if (!file || fputs(text, file) < 0 || fclose(file)) fail_msg("cannot write %s", name);
}

#define DAE_HEAD                                                                                             \
    "<?xml version=\"1.0\"?><COLLADA xmlns=\"http://www.collada.org/2005/11/COLLADASchema\" "                \
    "version=\"1.4.1\">"                                                                                     \
    "<asset><unit meter=\"1\"/></asset>"
#define DAE_TAIL "<scene><instance_visual_scene url=\"#vs\"/></scene></COLLADA>"

/* A node that holds itself: Assimp follows it until its stack ends. */
static void write_cycle(const char *name) {
    write_text(name,
               DAE_HEAD "<library_visual_scenes><visual_scene id=\"vs\"><node id=\"a\">"
                        "<instance_node url=\"#a\"/></node></visual_scene></library_visual_scenes>" DAE_TAIL);
}

/* One polygon of `count` corners, which takes Assimp the square of it. */
static void write_polygon(const char *name, unsigned count) {
    FILE *file = fopen(lw_support_temporary(name), "wb");
    assert_non_null(file);
    for (unsigned i = 0; i < count; i++) {
        float angle = 2 * LW_PI * (float)i / (float)count, radius = i % 2 ? 1.0f : 1.1f;
        fprintf(file, "v %.6f %.6f 0\n", (double)(radius * cosf(angle)), (double)(radius * sinf(angle)));
    }
    fprintf(file, "f");
    for (unsigned i = 0; i < count; i++) fprintf(file, " %u", i + 1);
    fprintf(file, "\n");
    assert_int_equal(fclose(file), 0);
}

static void start_import(struct lw_process *process, const char *scene, const char *options) {
    char arguments[1024], path[512];
    snprintf(path, sizeof path, "%s", lw_support_temporary(scene));
    snprintf(arguments, sizeof arguments, "%s -o %s --threads 1 %s", path,
             lw_support_temporary("out.lwscene"), options);
    lw_process_start(process, "lightwell-import", arguments);
}

/* Runs the program, which must end with the code and say one line, or none, that holds `text`. */
static void expect_program(const char *scene, const char *options, int code, const char *text) {
    struct lw_process process;
    start_import(&process, scene, options);
    int ended = lw_process_finish(&process, LW_PROCESS_LIMIT_S);
    char *said = lw_process_err(&process);
    if (ended != code || !strstr(said, text)) fail_msg("%s: ends with %d: %s", scene, ended, said);
    const char *error = strstr(said, "error: ");
    if (code && (!error || strchr(error, '\n')[1] || strstr(error + 1, "error: ")))
        fail_msg("%s: not one line: %s", scene, said);
    if (code) assert_int_equal(access(lw_support_temporary("out.lwscene"), F_OK), -1); /* nothing half done */
    free(said);
}

static void what_hurts_the_reader_is_one_line(void **state) {
    (void)state;
    if (LW_SANITIZER) skip(); /* such builds keep their own handlers */
    write_cycle("cycle.dae");
    expect_program("cycle.dae", "", 65, "cycle.dae: Assimp, which reads Collada, crashed on it");
    write_polygon("polygon.obj", 100000);
    expect_program("polygon.obj", "--read-seconds 1", 65,
                   "polygon.obj: Assimp, which reads OBJ, took more than 1 s of processor time");
    expect_program("polygon.obj", "--import-seconds 1", 65,
                   "polygon.obj: importing it took more than 1 s of processor time, so it was stopped; "
                   "--import-seconds gives it more");
    write_text("claims.ply",
               "ply\nformat binary_little_endian 1.0\nelement vertex 2147483647\nproperty float x\n"
               "property float y\nproperty float z\nelement face 1\n"
               "property list uchar int vertex_indices\nend_header\n");
    expect_program("claims.ply", "", 65, "claims.ply: needs more memory than a file of");
    write_text("empty.stl", "solid nothing\nendsolid nothing\n");
    expect_program("empty.stl", "", 65, "empty.stl: has no triangles");
    write_text("unknown.blend", "BLENDER-v300");
    expect_program("unknown.blend", "", 65, "is in no format that is read: .gltf, .glb, .obj");
    write_text("flat.ply", "ply\nformat ascii 1.0\nelement vertex 3\nproperty float x\nproperty float y\n"
                           "element face 1\nproperty list uchar int vertex_indices\nend_header\n"
                           "0 0\n1 0\n0 1\n3 0 1 2\n");
    expect_program("flat.ply", "", 0, "flat.ply: has no light of its own"); /* z is 0 where there is none */
}

/* Files that were broken at random, and those that were found to hurt: each is a scene or one line, never a
 * signal. */
static void the_corpus_ends_in_a_scene_or_one_line(void **state) {
    (void)state;
    if (LW_SANITIZER) skip();
    char folder[512];
    snprintf(folder, sizeof folder, "%s", lw_support_source("tests/integration/broken_scenes"));
    DIR *list = opendir(folder);
    assert_non_null(list);
    unsigned whole = 0, refused = 0;
    for (struct dirent *entry; (entry = readdir(list));) {
        char arguments[1400];
        struct lw_process process;
        if (entry->d_name[0] == '.') continue;
        snprintf(arguments, sizeof arguments, "%s/%s -o %s --threads 1 --read-seconds 2 --texels-per-metre 4",
                 folder, entry->d_name, lw_support_temporary("out.lwscene"));
        lw_process_start(&process, "lightwell-import", arguments);
        int ended = lw_process_finish(&process, LW_PROCESS_LIMIT_S);
        char *said = lw_process_err(&process);
        const char *error = strstr(said, "error: ");
        if ((ended != 0 && ended != 65) || (ended == 0) != (error == NULL) ||
            (error && strstr(error + 1, "error: ")))
            fail_msg("%s: ends with %d: %s", entry->d_name, ended, said);
        if (strncmp(entry->d_name, "whole", 5) == 0) {
            if (ended != 0) fail_msg("%s: %s", entry->d_name, said);
            whole++;
        }
        refused += ended == 65;
        free(said);
    }
    closedir(list);
    assert_int_equal(whole, 6);
    assert_true(refused >= 20);
}

/* Who spawned the importer gets the same line as an error, and lives. */
static void the_spawner_survives(void **state) {
    (void)state;
    if (LW_SANITIZER) skip();
    struct lw_scene *scene = NULL;
    char path[512];
    write_cycle("cycle.dae");
    snprintf(path, sizeof path, "%s", lw_support_temporary("cycle.dae"));
    struct lw_error err = {0};
    lw_support_fails(lw_import_spawn(&(struct lw_import_spawn_desc){.scene = path}, &scene, &err),
                     LW_BAD_DATA, &err, "Assimp, which reads Collada, crashed on it");
    assert_true(strncmp(err.text, path, strlen(path)) == 0);
    assert_null(strchr(err.text, '\n'));
}

/* Who spawned it may have ended before its death could be followed: the other end of the pipe is closed
 * then. */
static void an_orphan_ends(void **state) {
    (void)state;
    int ends[2];
    char option[32];
    write_text("sheet.obj", "v 0 0 0\nv 2 0 0\nv 2 0 -2\nv 0 0 -2\nf 1 2 3 4\n");
    assert_int_equal(pipe(ends), 0);
    close(ends[0]);
    snprintf(option, sizeof option, "--failure-fd %d", ends[1]);
    expect_program("sheet.obj", option, lw_status_exit_code(LW_CLOSED), "started this one has ended");
    close(ends[1]);
}

/* ---- options ---- */

static void scale_and_sides_reach_the_package(void **state) {
    (void)state;
    write_text("sheet.obj", "v 100 0 0\nv 300 0 0\nv 300 0 -200\nv 100 0 -200\nf 1 2 3 4\n");
    struct lw_scene *scene;
    struct lw_error err = {0};
    expect_program("sheet.obj", "--scale 0.01 --sides one --texels-per-metre 4", 0, "has no light");
    lw_support_ok(lw_package_load(lw_support_temporary("out.lwscene"), &scene, &err), &err);
    struct bounds bounds = bounds_of(scene);
    assert_near(bounds.min, lw_vec3(1, 0, -2), 1e-5f, "lowest corner");
    assert_near(bounds.max, lw_vec3(3, 0, 0), 1e-5f, "highest corner");
    assert_false(scene->material[0].double_sided);
    lw_scene_destroy(scene);
    expect_program("sheet.obj", "--texels-per-metre 0.04", 0, "has no light");
    lw_support_ok(lw_package_load(lw_support_temporary("out.lwscene"), &scene, &err), &err);
    assert_near(bounds_of(scene).max, lw_vec3(300, 0, 0), 1e-3f, "highest corner");
    assert_true(scene->material[0].double_sided);
    lw_scene_destroy(scene);
    /* JSON is UTF-8, file names need not be */
    char from[512];
    snprintf(from, sizeof from, "%s", lw_support_temporary("sheet.obj"));
    assert_int_equal(rename(from, lw_support_temporary("sh\xE4\xE4t.obj")), 0);
    expect_program("sh\xE4\xE4t.obj", "--json --texels-per-metre 0.04", 0, "has no light");
}

/* A desk of 2 x 2 m, a lamp 0.4 m above it and a camera beside that, all at (x, 0, 0). */
static void write_desk(const char *name, const char *x) {
    static const char format[] =
        "{\"asset\":{\"version\":\"2.0\"},\"extensionsUsed\":[\"KHR_lights_punctual\"],"
        "\"extensions\":{\"KHR_lights_punctual\":{\"lights\":[{\"type\":\"point\",\"name\":\"desk lamp\"}]}},"
        "\"scene\":0,\"scenes\":[{\"nodes\":[0]}],\"nodes\":[{\"translation\":[%s,0,0],\"children\":[1,2,3]},"
        "{\"mesh\":0,\"name\":\"desk\"},{\"translation\":[0,0.4,0],\"extensions\":{\"KHR_lights_punctual\":"
        "{\"light\":0}}},{\"camera\":0,\"name\":\"eye\",\"translation\":[0,0.5,0]}],"
        "\"cameras\":[{\"name\":\"eye\",\"type\":\"perspective\",\"perspective\":{\"yfov\":1,\"znear\":0.1}}]"
        ","
        "\"meshes\":[{\"primitives\":[{\"attributes\":{\"POSITION\":0},\"indices\":1}]}],"
        "\"buffers\":[{\"byteLength\":60,\"uri\":\"data:application/octet-stream;base64,"
        "AACAvwAAAAAAAIA/AACAPwAAAAAAAIA/AACAPwAAAAAAAIC/AACAvwAAAAAAAIC/AAABAAIAAAACAAMA\"}],"
        "\"bufferViews\":[{\"buffer\":0,\"byteLength\":48},{\"buffer\":0,\"byteOffset\":48,\"byteLength\":12}"
        "],"
        "\"accessors\":[{\"bufferView\":0,\"componentType\":5126,\"count\":4,\"type\":\"VEC3\",\"min\":[-1,0,"
        "-1],"
        "\"max\":[1,0,1]},{\"bufferView\":1,\"componentType\":5123,\"count\":6,\"type\":\"SCALAR\"}]}";
    char text[2048];
    snprintf(text, sizeof text, format, x);
    write_text(name, text);
}

/* What the program tells on stderr of a scene that it reads. */
static char *talk_of(const char *scene, const char *options) {
    struct lw_process process;
    start_import(&process, scene, options);
    assert_int_equal(lw_process_finish(&process, LW_PROCESS_LIMIT_S), 0);
    return lw_process_err(&process);
}

static void expect_talk(const char *scene, const char *text, bool expected) {
    char *talk = talk_of(scene, "--texels-per-metre 10");
    if ((strstr(talk, text) != NULL) != expected)
        fail_msg("%s: \"%s\" is %sreported: %s", scene, text, expected ? "not " : "", talk);
    free(talk);
}

/* Where floats are too coarse for texels, for the distance of a lamp and of a camera. A ray starts 7 cm off a
 * surface at 100 km: 0.4 m below a lamp that is half as much light again. */
static void what_lies_too_far_out_is_reported(void **state) {
    (void)state;
    write_text("far.obj", "v 1000000 0 0\nv 1000002 0 0\nv 1000002 0 -2\nv 1000000 0 -2\nf 1 2 3 4\n");
    expect_talk("far.obj", "so far out (1e+06 m) that floats are coarse against their texels", true);
    write_desk("desk.gltf", "0");
    expect_talk("desk.gltf", "so far out", false);
    write_desk("desk.gltf", "10000");
    expect_talk("desk.gltf", "so far out", false);
    write_desk("desk.gltf", "20000");
    expect_talk("desk.gltf", "lamp \"desk lamp\" and 0 more lie so far out (20000 m)", true);
    expect_talk("desk.gltf", "light is up to 8 % off there", true);
    expect_talk("desk.gltf", "object \"desk\"", false);
    write_desk("desk.gltf", "-1e5");
    expect_talk("desk.gltf", "(0.4 m): light is up to 48 % off there; bring the scene nearer to the origin",
                true);
    expect_talk("desk.gltf", "camera \"eye\" and 0 more lie so far out (100000 m)", true);
    expect_talk("desk.gltf", "object \"desk\" and 0 more lie so far out (100001 m)", true);
    /* a material that shines is a lamp too, over a desk but not over itself */
    write_text("far.mtl", "newmtl lamp\nKe 5 5 5\n");
    write_text("lamp.obj",
               "mtllib far.mtl\no desk\nv 20000 0 0\nv 20002 0 0\nv 20002 0 -2\nv 20000 0 -2\nf 1 2 3 4\n"
               "o lamp\nusemtl lamp\nv 20001 0.4 -1\nv 20001 0.4 -1.1\nv 20001.1 0.4 -1\nf 5 6 7\n");
    expect_talk("lamp.obj", "lamp \"lamp\" and 0 more lie so far out (20001.1 m)", true);
    write_text("lamp.obj", "mtllib far.mtl\no lamp\nusemtl lamp\nv 20001 0.4 -1\nv 20001 0.4 -1.1\n"
                           "v 20001.1 0.4 -1\nf 1 2 3\n");
    expect_talk("lamp.obj", "so far out", false);
}

static int clean_up(void **state) {
    (void)state;
    lw_process_kill_all();
    unlink(lw_support_temporary("out.lwscene"));
    return 0;
}

int main(void) {
    lw_log_init("test_import_formats", LW_LOG_ERROR);
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(the_cornell_box_of_obj_arrives),
        cmocka_unit_test(a_scene_is_the_same_through_every_format),
        cmocka_unit_test_teardown(what_hurts_the_reader_is_one_line, clean_up),
        cmocka_unit_test_teardown(the_corpus_ends_in_a_scene_or_one_line, clean_up),
        cmocka_unit_test_teardown(the_spawner_survives, clean_up),
        cmocka_unit_test_teardown(an_orphan_ends, clean_up),
        cmocka_unit_test_teardown(scale_and_sides_reach_the_package, clean_up),
        cmocka_unit_test_teardown(what_lies_too_far_out_is_reported, clean_up),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
