/* The importer's cage: every way out that the tests' build of it tries, with and without; and scenes whose
 * links lead out of their folder. */
#include "tests/support/import_probe.h"
#include "tests/support/process.h"

#include "common/open/import_spawn.h"
#include "common/scene/package.h"
#include "server/import/cage.h"

#include <errno.h>
#include <fcntl.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/stat.h>
#include <unistd.h>

#define TRIANGLE "v 0 0 0\nv 1 0 0\nv 0 1 0\n"

static char place[256], scene_folder[300]; /* place/secret, place/scene/... */

static void put(const char *name, const char *text) {
    char path[512];
    snprintf(path, sizeof path, "%s/%s", place, name);
    lw_support_write_file(path, text, strlen(text));
}

static void put_link(const char *name, const char *target) {
    char path[512];
    snprintf(path, sizeof path, "%s/%s", place, name);
    assert_int_equal(symlink(target, path), 0);
}

static int make_place(void **state) {
    (void)state;
    snprintf(place, sizeof place, "%s", lw_support_temporary("place"));
    snprintf(scene_folder, sizeof scene_folder, "%s/scene", place);
    if (mkdir(place, 0755) != 0 || mkdir(scene_folder, 0755) != 0) return -1;
    put("secret", "a secret, which is no buffer");
    put("scene/inside", "what a scene may name");
    put("scene/tri.obj", TRIANGLE "f 1 2 3\n");
    put_link("scene/link", "../secret");
    return 0;
}

/* Every way out is open without the cage, or the probe proves nothing. */
static const char *const shut[] = {"read outside",
                                   "read an absolute path",
                                   "read through a link",
                                   "read the starter's environment",
                                   "write outside",
                                   "write inside",
                                   "create outside",
                                   "create a folder",
                                   "create a link",
                                   "change a mode",
                                   "list outside",
                                   "network",
                                   "connection",
                                   "unix socket",
                                   "process",
                                   "process by clone",
                                   "process by clone3",
                                   "program",
                                   "memory of others",
                                   "signal to others",
                                   "memory that runs",
                                   "descriptor",
                                   "environment",
                                   "many files",
                                   "core dump"};

static void expect_line(const char *talk, const char *how, const char *way, bool is_open) {
    char start[128];
    snprintf(start, sizeof start, "%s %s: ", how, way);
    const char *line = strstr(talk, start);
    if (!line) fail_msg("nothing is said of \"%s\": %s", start, talk);
    const bool found = line && strncmp(line + strlen(start), "open\n", 5) == 0;
    if (found != is_open) fail_msg("it should be %s: %.80s", is_open ? "open" : "shut", line ? line : "");
}

static void expect_cage(const char *talk) {
    if (strstr(talk, "this system has n")) {
        print_message("skipped: %s", strstr(talk, "this system has n"));
        skip();
    }
    expect_line(talk, "free", "read inside", true);
    expect_line(talk, "caged", "read inside", true);
    for (size_t i = 0; i < sizeof shut / sizeof *shut; i++) {
        /* a user who may not do all this anyhow, or has no clone3() */
        const bool may_lack =
            strstr(shut[i], "clone3") || strstr(shut[i], "starter") || strstr(shut[i], "core");
        if (!may_lack) expect_line(talk, "free", shut[i], true);
        expect_line(talk, "caged", shut[i], false);
    }
    expect_line(talk, "caged", "ptrace", false);
}

static void nothing_gets_out_of_the_program(void **state) {
    (void)state;
    if (!lw_cage_is_built()) skip(); /* a sanitizer or a measurement of coverage needs what the cage takes */
    struct lw_process process;
    char words[700];
    const char *out = lw_support_temporary("out");
    assert_true(mkdir(out, 0755) == 0 || errno == EEXIST);
    snprintf(words, sizeof words, "%s/tri.obj -o %s/tri.lwscene", scene_folder, out);
    setenv("LW_PROBE_TOKEN", "0123456789abcdef", 1);
    assert_int_equal(dup2(STDERR_FILENO, LW_IMPORT_PROBE_DESCRIPTOR), LW_IMPORT_PROBE_DESCRIPTOR);
    lw_process_start(&process, "import_probe", words);
    close(LW_IMPORT_PROBE_DESCRIPTOR);
    const int code = lw_process_finish(&process, LW_PROCESS_LIMIT_S);
    lw_process_expect(&process, code, 0);
    char *talk = lw_process_err(&process);
    expect_cage(talk);
    free(talk);
    unsetenv("LW_PROBE_TOKEN");
    char package[512];
    snprintf(package, sizeof package, "%s/tri.lwscene", out);
    struct lw_scene *scene;
    struct lw_error err = {0};
    lw_support_ok(lw_package_load(package, &scene, &err), &err);
    lw_scene_destroy(scene);
}

/* As the daemon does it: where that is root, the importer is nobody, and reads what root alone may. */
static void nothing_gets_out_of_the_daemons_child(void **state) {
    (void)state;
    if (!lw_cage_is_built()) skip();
    char path[512];
    const char *talk_path = lw_support_temporary("talk");
    const int before = dup(STDERR_FILENO),
              file = open(talk_path, O_RDWR | O_CREAT | O_TRUNC | O_CLOEXEC, 0600);
    struct lw_scene *scene = NULL;
    struct lw_error err = {0};
    snprintf(path, sizeof path, "%s/tri.obj", scene_folder);
    assert_int_equal(chmod(path, 0600), 0);
    char self[512];
    const ssize_t length = readlink("/proc/self/exe", self, sizeof self - 1);
    assert_true(length > 0);
    self[length] = 0;
    strcpy(strrchr(self, '/'), "/import_probe");
    setenv("LW_PROBE_TOKEN", "0123456789abcdef", 1);
    assert_int_equal(dup2(file, LW_IMPORT_PROBE_DESCRIPTOR), LW_IMPORT_PROBE_DESCRIPTOR);
    dup2(file, STDERR_FILENO);
    const enum lw_status status =
        lw_import_spawn(&(struct lw_import_spawn_desc){.scene = path, .program = self}, &scene, &err);
    dup2(before, STDERR_FILENO);
    close(LW_IMPORT_PROBE_DESCRIPTOR);
    close(before);
    close(file);
    unsetenv("LW_PROBE_TOKEN");
    lw_support_ok(status, &err);
    lw_scene_destroy(scene);
    size_t size;
    char *talk = (char *)lw_support_read_file(talk_path, &size);
    expect_cage(talk);
    char user[64];
    snprintf(user, sizeof user, "caged user %u\n", geteuid() ? geteuid() : 65534);
    if (!strstr(talk, user)) fail_msg("not \"%s\": %s", user, talk);
    free(talk);
}

/* ---- links ---- */

static int import(const char *name, char **out_talk) {
    struct lw_process process;
    char words[700];
    snprintf(words, sizeof words, "%s/%s -o %s", scene_folder, name, lw_support_temporary("links.lwscene"));
    lw_process_start(&process, "lightwell-import", words);
    const int code = lw_process_finish(&process, LW_PROCESS_LIMIT_S);
    *out_talk = lw_process_err(&process);
    return code;
}

static bool package_holds(const char *text) {
    size_t size;
    uint8_t *bytes = lw_support_read_file(lw_support_temporary("links.lwscene"), &size);
    const bool found = memmem(bytes, size, text, strlen(text)) != NULL;
    free(bytes);
    return found;
}

static void buffers_behind_links_are_refused(void **state) {
    (void)state;
    static const char json[] =
        "{\"asset\":{\"version\":\"2.0\"},\"buffers\":[{\"uri\":\"%s\",\"byteLength\":36}],"
        "\"bufferViews\":[{\"buffer\":0,\"byteLength\":36}],\"accessors\":[{\"bufferView\":0,"
        "\"componentType\":5126,\"count\":3,\"type\":\"VEC3\",\"min\":[0,0,0],\"max\":[1,1,0]}],"
        "\"meshes\":[{\"primitives\":[{\"attributes\":{\"POSITION\":0}}]}],\"nodes\":[{\"mesh\":0}],"
        "\"scenes\":[{\"nodes\":[0]}],\"scene\":0}";
    static const float corners[9] = {0, 0, 0, 1, 0, 0, 0, 1, 0};
    char text[1024], path[512], absolute[512], *talk;
    snprintf(path, sizeof path, "%s/corners.bin", place);
    lw_support_write_file(path, corners, sizeof corners);
    snprintf(path, sizeof path, "%s/corners.bin", scene_folder);
    lw_support_write_file(path, corners, sizeof corners);
    snprintf(absolute, sizeof absolute, "%s/corners.bin", scene_folder);
    put_link("scene/out.bin", "../corners.bin");
    put_link("scene/above", "..");
    put_link("scene/near.bin", "corners.bin");
    put_link("scene/here", ".");
    put_link("scene/absolute.bin", absolute);
    static const struct {
        const char *uri;
        bool good;
    } files[] = {{"corners.bin", true},   {"near.bin", true},
                 {"here/near.bin", true}, {"here/../scene/corners.bin", false},
                 {"out.bin", false},      {"above/corners.bin", false},
                 {"absolute.bin", false}, {"here/out.bin", false}};
    for (size_t i = 0; i < sizeof files / sizeof *files; i++) {
        snprintf(text, sizeof text, json, files[i].uri);
        put("scene/links.gltf", text);
        const int code = import("links.gltf", &talk);
        if ((code == 0) != files[i].good) fail_msg("%s: %d: %s", files[i].uri, code, talk);
        if (!files[i].good && !strstr(talk, "leads out of the folder") && !strstr(talk, "No such file"))
            fail_msg("%s: %s", files[i].uri, talk);
        free(talk);
    }
}

/* A picture and a library: the scene stays, with a line each. */
static void what_a_material_names_behind_a_link_stays_out(void **state) {
    (void)state;
    char *talk;
    put("outside.mtl", "newmtl outside\nKd 0.1 0.2 0.3\n");
    put("outside.png", "no picture, but who asks");
    put("scene/inside.mtl", "newmtl inside\nKd 0.1 0.2 0.3\nmap_Kd outside.png\n");
    put_link("scene/outside.mtl", "../outside.mtl");
    put_link("scene/outside.png", "../outside.png");
    put("scene/library.obj", "mtllib outside.mtl\n" TRIANGLE "usemtl outside\nf 1 2 3\n");
    assert_int_equal(import("library.obj", &talk), 0);
    assert_non_null(strstr(talk, "outside.mtl"));
    free(talk);
    assert_false(package_holds("\xcd\xcc\xcc\x3d")); /* 0.1: nothing of the library is there */
    put("scene/picture.obj", "mtllib inside.mtl\n" TRIANGLE "usemtl inside\nf 1 2 3\n");
    assert_int_equal(import("picture.obj", &talk), 0);
    if (!strstr(talk, "outside.png") || !strstr(talk, "leads out of the folder")) fail_msg("%s", talk);
    free(talk);
}

int main(void) {
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(nothing_gets_out_of_the_program),
        cmocka_unit_test(nothing_gets_out_of_the_daemons_child),
        cmocka_unit_test(buffers_behind_links_are_refused),
        cmocka_unit_test(what_a_material_names_behind_a_link_stays_out),
    };
    return cmocka_run_group_tests(tests, make_place, lw_process_teardown);
}
