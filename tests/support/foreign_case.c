#include "tests/support/foreign_case.h"

#include "common/image/image.h"

#include <errno.h>
#include <fcntl.h>
#include <math.h>
#include <stdio.h>
#include <string.h>
#include <sys/stat.h>
#include <unistd.h>

static char talk[16384];

void lw_foreign_case_write_bytes(const char *name, const void *bytes, size_t size) {
    lw_support_write_file(lw_support_temporary(name), bytes, size);
}

void lw_foreign_case_write_text(const char *name, const char *text) {
    lw_foreign_case_write_bytes(name, text, strlen(text));
}

void lw_foreign_case_make_folder(const char *name) {
    assert_true(mkdir(lw_support_temporary(name), 0700) == 0 || errno == EEXIST);
}

enum lw_status lw_foreign_case_load(const char *name, enum lw_foreign_sides sides, struct lw_scene **out,
                                    struct lw_error *err) {
    char path[512];
    snprintf(path, sizeof path, "%s", lw_support_temporary(name));
    struct lw_foreign_desc desc = {.path = path, .sides = sides};
    *out = NULL;
    fflush(stderr);
    int saved = dup(STDERR_FILENO);
    int file = open(lw_support_temporary("talk"), O_RDWR | O_CREAT | O_TRUNC, 0600);
    assert_true(saved >= 0 && file >= 0 && dup2(file, STDERR_FILENO) >= 0);
    enum lw_status status = lw_scene_format_of(path, &desc.format, err);
    if (status == LW_OK) {
        assert_int_not_equal(desc.format, LW_SCENE_FORMAT_GLTF);
        status = lw_foreign_load(&desc, out, err);
    }
    fflush(stderr);
    dup2(saved, STDERR_FILENO);
    ssize_t length = pread(file, talk, sizeof talk - 1, 0);
    talk[length > 0 ? length : 0] = 0;
    close(saved);
    close(file);
    return status;
}

const char *lw_foreign_case_talk(void) { return talk; }

void lw_foreign_case_write_png(const char *name) {
    static const uint8_t rgb[12] = {255, 0, 0, 0, 255, 0, 0, 0, 255, 255, 255, 255};
    struct lw_error err = {0};
    lw_support_ok(lw_image_write_png(lw_support_temporary(name), rgb, 2, 2, &err), &err);
}

struct lw_scene *lw_foreign_case_scene(const char *name) {
    struct lw_scene *scene;
    struct lw_error err = {0};
    lw_support_ok(lw_foreign_case_load(name, LW_FOREIGN_SIDES_AUTO, &scene, &err), &err);
    return scene;
}

struct lw_scene *lw_foreign_case_scene_of(const char *name, const char *text) {
    lw_foreign_case_write_text(name, text);
    return lw_foreign_case_scene(name);
}

void lw_foreign_case_refuse(const char *name, const char *reason) {
    struct lw_scene *scene;
    struct lw_error err = {0};
    enum lw_status status = lw_foreign_case_load(name, LW_FOREIGN_SIDES_AUTO, &scene, &err);
    if (status != LW_BAD_DATA || !strstr(err.text, reason))
        fail_msg("%s: \"%s\", not \"%s\"", name, status ? err.text : "it loads", reason);
    assert_null(scene);
    assert_non_null(strstr(err.text, name)); /* the file is named */
}

void lw_foreign_case_refuse_text(const char *name, const char *text, const char *reason) {
    lw_foreign_case_write_text(name, text);
    lw_foreign_case_refuse(name, reason);
}

void lw_foreign_case_expect_vec3(struct lw_vec3 v, float x, float y, float z) {
    if (fabsf(v.x - x) > 1e-4f || fabsf(v.y - y) > 1e-4f || fabsf(v.z - z) > 1e-4f)
        fail_msg("(%g, %g, %g), not (%g, %g, %g)", (double)v.x, (double)v.y, (double)v.z, (double)x,
                 (double)y, (double)z);
}

void lw_foreign_case_write_texel(const char *name, uint8_t red, uint8_t green, uint8_t blue) {
    const uint8_t tga[21] = {[2] = 2, [12] = 1, [14] = 1, [16] = 24, [18] = blue, [19] = green, [20] = red};
    lw_foreign_case_write_bytes(name, tga, sizeof tga);
}

void lw_foreign_case_expect_line(const char *phrase) {
    if (!strstr(lw_foreign_case_talk(), phrase))
        fail_msg("\"%s\" is not told; but: %s", phrase, lw_foreign_case_talk());
}

void lw_foreign_case_expect_silence(const char *text) {
    if (*lw_foreign_case_talk()) fail_msg("%s tells: %s", text, lw_foreign_case_talk());
}

const struct lw_material *lw_foreign_case_first_material(const struct lw_scene *scene) {
    return &scene->material[scene->mesh[0].material[0]];
}

void lw_foreign_case_expect_colour(const struct lw_scene *scene, float red, float green, float blue,
                                   const char *of) {
    const float *c = lw_foreign_case_first_material(scene)->base_colour;
    if (fabsf(c[0] - red) > 1e-5f || fabsf(c[1] - green) > 1e-5f || fabsf(c[2] - blue) > 1e-5f)
        fail_msg("%s: (%g, %g, %g), not (%g, %g, %g); told: %s", of, (double)c[0], (double)c[1], (double)c[2],
                 (double)red, (double)green, (double)blue, lw_foreign_case_talk());
}
