/* Whatever reads as a scene package must be written again as the very same bytes: the format has one way to
 * say each thing, but that textures were once written in versions 1 and 2: those come again in version 3. And
 * nothing that is refused may crash, leak, or be refused without a reason. */
#include "common/scene/package.h"
#include "common/scene/pose.h"

#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#define VERSION_FILTERED 3 /* the first whose textures are filtered */
#define VERSION_SEALED   5 /* has a checksum */
#define VERSION_FINISHES 7 /* is for files alone, too */

int LLVMFuzzerTestOneInput(const uint8_t *bytes, size_t size);

static void require(bool condition, const char *what, const struct lw_error *err) {
    if (condition) return;
    fprintf(stderr, "fuzz_package: %s: %s\n", what, err->text);
    abort();
}

/* Uses what a reader may rely on: every array through surfaces, every channel through poses. */
static void use(const struct lw_scene *scene) {
    (void)lw_scene_has_light(scene);
    for (uint32_t i = 0; i < scene->mesh_count; i++) {
        struct lw_surface surface;
        for (uint32_t t = 0; t < scene->mesh[i].triangle_count; t++) {
            lw_scene_surface(scene, &scene->mesh[i], t, 0.25f, 0.5f, &surface);
            (void)lw_scene_alpha(scene, &scene->mesh[i], t, 1, 0);
        }
    }
    (void)lw_scene_sky(scene, lw_vec3(0.6f, -0.8f, 0));
    struct lw_pose pose;
    struct lw_vec3 low, high;
    struct lw_error err = {0};
    require(lw_pose_init(&pose, scene) == LW_OK, "no memory for a pose", &err);
    lw_pose_evaluate(&pose, scene, 0.75 * (double)scene->duration_s);
    (void)lw_pose_bounds(&pose, scene, &low, &high);
    lw_pose_finish(&pose);
}

static void run(const uint8_t *bytes, size_t size) {
    struct lw_scene *scene;
    struct lw_error err = {0};
    enum lw_status status = lw_package_read(bytes, size, &scene, &err);
    if (status != LW_OK) {
        require(status == LW_BAD_DATA && err.status == status && *err.text && !strchr(err.text, '\n'),
                "refused without a one-line reason", &err);
        return;
    }
    use(scene);
    uint8_t *again;
    size_t again_size;
    status = bytes[8] == VERSION_SEALED || bytes[8] == VERSION_FINISHES
                 ? lw_package_write_sealed(scene, &again, &again_size, &err)
                 : lw_package_write(scene, &again, &again_size, &err);
    require(status == LW_OK, "what was read cannot be written", &err);
    if (scene->texture_count == 0 || bytes[8] >= VERSION_FILTERED)
        require(again_size == size && memcmp(again, bytes, size) == 0, "written again, it differs", &err);
    else
        require(again_size > size && again[8] == VERSION_FILTERED, "written again, it is as old", &err);
    free(again);
    lw_scene_destroy(scene);
}

/* A checksum is in the way of a search, so that each sealed package is tried with the right one as well. */
int LLVMFuzzerTestOneInput(const uint8_t *bytes, size_t size) {
    run(bytes, size);
    if (size < 12 || (bytes[8] != VERSION_SEALED && bytes[8] != VERSION_FINISHES)) return 0;
    uint8_t *sealed = malloc(size);
    if (!sealed) abort();
    memcpy(sealed, bytes, size);
    lw_package_seal(sealed, size);
    run(sealed, size);
    free(sealed);
    return 0;
}
