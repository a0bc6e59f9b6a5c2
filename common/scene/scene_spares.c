#include "common/scene/scene_spares.h"

#include <stdio.h>
#include <stdlib.h>
#include <string.h>

static bool read_number(const char *text, const char *end, uint32_t max, uint32_t *out) {
    uint64_t number = 0;
    if (text == end) return false;
    for (; text < end; text++) {
        if (*text < '0' || *text > '9') return false;
        number = number * 10 + (uint64_t)(*text - '0');
        if (number > max) return false;
    }
    *out = (uint32_t)number;
    return true;
}

/* Meshes of one name share its entry. Returns how many there are. */
static uint32_t set_named(const struct lw_scene *scene, const char *name, size_t length, uint32_t count,
                          uint32_t *wanted) {
    uint32_t found = 0, number;
    if (length && name[0] == '#' && scene->mesh_count &&
        read_number(name + 1, name + length, scene->mesh_count - 1, &number)) {
        wanted[number] = count;
        return 1;
    }
    for (uint32_t m = 0; m < scene->mesh_count; m++) {
        if (strlen(scene->mesh[m].name) != length || memcmp(scene->mesh[m].name, name, length) != 0) continue;
        wanted[m] = count;
        found++;
    }
    return found;
}

/* One of the items between commas. A name may hold "=", its number may not. */
static enum lw_status read_item(const struct lw_scene *scene, const char *item, const char *end,
                                uint32_t *wanted, struct lw_error *err) {
    const char *equals = NULL;
    uint32_t count;
    for (const char *at = item; at < end; at++)
        if (*at == '=') equals = at;
    if (!read_number(equals ? equals + 1 : item, end, LW_SCENE_SPARES_MAX, &count))
        return lw_status_fail(err, LW_USAGE, "\"%.*s\" is neither MESH=N nor N, with N from 0 to %u",
                              (int)(end - item), item, LW_SCENE_SPARES_MAX);
    if (equals && !set_named(scene, item, (size_t)(equals - item), count, wanted))
        return lw_status_fail(err, LW_USAGE, "no mesh is called \"%.*s\" (lightwellctl list names them)",
                              (int)(equals - item), item);
    for (uint32_t m = 0; !equals && m < scene->mesh_count; m++) wanted[m] = count;
    return LW_OK;
}

static const char *name_of(struct lw_scene *scene, const char *mesh, uint32_t number) {
    const size_t size = strlen(mesh) + 16;
    char *name = lw_scene_alloc(scene, size, 1);
    if (name) snprintf(name, size, "%s#%u", *mesh ? mesh : "unnamed", number);
    return name;
}

static enum lw_status append(struct lw_scene *scene, const uint32_t *wanted, uint64_t total,
                             struct lw_error *err) {
    const uint32_t before = scene->object_count;
    struct lw_object *const old = scene->object;
    if (total > LW_SCENE_OBJECTS_MAX - before)
        return lw_status_fail(err, LW_BAD_DATA, "the scene would have over %u objects", LW_SCENE_OBJECTS_MAX);
    struct lw_object *object = lw_scene_alloc(scene, before + total, sizeof *object);
    if (!object) return lw_status_fail(err, LW_NO_MEMORY, "no memory for %u objects", (unsigned)total);
    if (before) memcpy(object, old, before * sizeof *object);
    uint32_t n = before;
    for (uint32_t m = 0; m < scene->mesh_count; m++)
        for (uint32_t i = 1; i <= wanted[m]; i++) {
            object[n] = (struct lw_object){
                .name = name_of(scene, scene->mesh[m].name, i), .mesh = m, .node = LW_SCENE_NONE};
            if (!object[n++].name)
                return lw_status_fail(err, LW_NO_MEMORY, "no memory for %u objects", (unsigned)total);
        }
    scene->object = object;
    scene->object_count = n;
    enum lw_status status = lw_scene_validate(scene, err);
    if (status == LW_OK) return LW_OK;
    scene->object = old;
    scene->object_count = before;
    return status;
}

enum lw_status lw_scene_spares_add(struct lw_scene *scene, const char *text, struct lw_error *err) {
    uint32_t *wanted = calloc(scene->mesh_count + 1ul, sizeof *wanted);
    if (!wanted) return lw_status_fail(err, LW_NO_MEMORY, "no memory for %u meshes", scene->mesh_count);
    enum lw_status status = LW_OK;
    for (const char *item = text, *end; status == LW_OK; item = end + 1) {
        end = item + strcspn(item, ",");
        status = read_item(scene, item, end, wanted, err);
        if (!*end) break;
    }
    uint64_t total = 0;
    for (uint32_t m = 0; m < scene->mesh_count; m++) total += wanted[m];
    if (status == LW_OK && total) status = append(scene, wanted, total, err);
    free(wanted);
    return status;
}
