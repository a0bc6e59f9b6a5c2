/* Whatever reads as a finish package must be written again as the very same bytes, and every surface of the
 * scene must then be finite. A refusal has a reason, and leaves the scene matt. */
#include "common/scene/finish_package.h"
#include "tests/support/support.h"

#include <stdio.h>
#include <stdlib.h>
#include <string.h>

int LLVMFuzzerTestOneInput(const uint8_t *bytes, size_t size);

static void require(bool condition, const char *what, const struct lw_error *err) {
    if (condition) return;
    fprintf(stderr, "fuzz_finish_package: %s: %s\n", what, err->text);
    abort();
}

static void use(const struct lw_scene *scene, const struct lw_error *err) {
    for (uint32_t i = 0; i < scene->mesh_count; i++)
        for (uint32_t t = 0; t < scene->mesh[i].triangle_count; t++) {
            const struct lw_mesh *mesh = &scene->mesh[i];
            struct lw_surface surface;
            struct lw_finish_point point;
            lw_scene_surface(scene, mesh, t, 0.25f, 0.5f, &surface);
            lw_scene_finish(scene, mesh, t, 0.25f, 0.5f, &surface, &point);
            require(point.occlusion >= 0 && point.occlusion <= 1, "occlusion", err);
            require(lw_vec3_is_finite(surface.albedo), "albedo", err);
            if (!point.bumpy) continue;
            const struct lw_vec3 tangent = lw_vec3(point.tangent.x, point.tangent.y, point.tangent.z);
            require(lw_vec3_is_finite(lw_scene_bump(&point, surface.normal, tangent)), "bump", err);
        }
}

int LLVMFuzzerTestOneInput(const uint8_t *bytes, size_t size) {
    struct lw_scene *scene = lw_support_everything();
    struct lw_error err = {0};
    uint64_t *end;
    size_t count;
    if (size) {
        require(lw_finish_package_cut(bytes, size, &end, &count) == LW_OK && end[count - 1] == size, "cut",
                &err);
        free(end);
    }
    const enum lw_status status = lw_finish_package_read(bytes, size, scene, &err);
    if (status == LW_OK) {
        uint8_t *again;
        size_t again_size;
        require(lw_finish_package_write(scene, &again, &again_size, &err) == LW_OK, "not written", &err);
        require(again_size == size && memcmp(again, bytes, size) == 0, "written again, it differs", &err);
        free(again);
        use(scene, &err);
    } else {
        require(status == LW_BAD_DATA && *err.text && !strchr(err.text, '\n'), "refused without a reason",
                &err);
        require(!lw_scene_has_finishes(scene) && !scene->finish_texture_count, "refused, and left", &err);
    }
    lw_scene_destroy(scene);
    return 0;
}
