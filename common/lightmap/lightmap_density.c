#include "common/lightmap/lightmap_density.h"

#include <stdlib.h>
#include <string.h>

#define SHOWN 100 /* letters of a name in an error */

static int shown(size_t length) { return length < SHOWN ? (int)length : SHOWN; }

/* Reads the number after "=", up to the end or a comma; 0: it is none, or out of bounds. */
static float factor_at(const char *text, size_t length) {
    char *end;
    const double factor = strtod(text, &end);
    const bool whole = length && end == text + length;
    return whole && factor >= LW_LIGHTMAP_FACTOR_MIN && factor <= LW_LIGHTMAP_FACTOR_MAX ? (float)factor : 0;
}

/* Returns whether any object is called so. */
static bool apply(const struct lw_scene *scene, const char *name, size_t length, float factor,
                  float *of_mesh) {
    bool found = false;
    for (uint32_t o = 0; o < scene->object_count; o++) {
        const char *called = scene->object[o].name;
        if (!called || strlen(called) != length || memcmp(called, name, length) != 0) continue;
        float *own = &of_mesh[scene->object[o].mesh];
        if (!(*own > factor)) *own = factor;
        found = true;
    }
    return found;
}

enum lw_status lw_lightmap_density_read(const char *text, const struct lw_scene *scene, float *out_factor,
                                        struct lw_error *err) {
    for (uint32_t m = 0; m < scene->mesh_count; m++) out_factor[m] = 0;
    for (const char *at = text; at; at++) {
        const size_t length = strcspn(at, ",");
        const char *equals = memrchr(at, '=', length);
        if (!equals || equals == at)
            return lw_status_fail(err, LW_USAGE, "--density-of: \"%.*s\" is no NAME=FACTOR", shown(length),
                                  at);
        const size_t name = (size_t)(equals - at);
        const float factor = factor_at(equals + 1, length - name - 1);
        if (!(factor > 0))
            return lw_status_fail(err, LW_USAGE, "--density-of: \"%.*s\" wants a factor from 1/64 to 8",
                                  shown(length), at);
        if (!apply(scene, at, name, factor, out_factor))
            return lw_status_fail(err, LW_USAGE, "--density-of: the scene has no object called \"%.*s\"",
                                  shown(name), at);
        at += length;
        if (!*at) break;
    }
    for (uint32_t m = 0; m < scene->mesh_count; m++)
        if (!(out_factor[m] > 0)) out_factor[m] = 1;
    return LW_OK;
}
