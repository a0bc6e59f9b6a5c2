#include "server/bake/glb.h"

#include "common/base/atomic_file.h"

#include <stdlib.h>
#include <string.h>

#define HEADER_BYTES       12u
#define CHUNK_HEADER_BYTES 8u

void lw_glb_init(struct lw_glb *glb, const char *generator) {
    *glb = (struct lw_glb){
        .root = json_pack("{s:{s:s, s:s}}", "asset", "version", "2.0", "generator", generator)};
    if (!glb->root) lw_glb_fail(glb, LW_NO_MEMORY, "out of memory");
}

void lw_glb_finish(struct lw_glb *glb) {
    json_decref(glb->root);
    free(glb->bin);
    *glb = (struct lw_glb){0};
}

void lw_glb_fail(struct lw_glb *glb, enum lw_status status, const char *what) {
    lw_status_fail(&glb->error, status, "%s", what);
}

static uint32_t out_of_memory(struct lw_glb *glb) {
    lw_glb_fail(glb, LW_NO_MEMORY, "out of memory");
    return LW_GLB_NONE;
}

/* ---- JSON ---- */

static json_t *array_of(struct lw_glb *glb, const char *name) {
    json_t *array = json_object_get(glb->root, name);
    if (array) return array;
    array = json_array();
    return json_object_set_new(glb->root, name, array) == 0 ? array : NULL;
}

uint32_t lw_glb_add(struct lw_glb *glb, const char *array, json_t *item) {
    if (glb->error.status != LW_OK) {
        json_decref(item);
        return LW_GLB_NONE;
    }
    json_t *items = array_of(glb, array);
    if (!items || !item || json_array_append_new(items, item) != 0) return out_of_memory(glb);
    return (uint32_t)json_array_size(items) - 1;
}

void lw_glb_use_extension(struct lw_glb *glb, const char *name) {
    const json_t *used = json_object_get(glb->root, "extensionsUsed");
    for (size_t i = 0; i < json_array_size(used); i++)
        if (strcmp(json_string_value(json_array_get(used, i)), name) == 0) return;
    lw_glb_add(glb, "extensionsUsed", json_string(name));
}

json_t *lw_glb_numbers(const float *values, unsigned count) {
    json_t *array = json_array();
    for (unsigned i = 0; array && i < count; i++)
        if (json_array_append_new(array, json_real((double)values[i])) != 0) {
            json_decref(array);
            return NULL;
        }
    return array;
}

/* ---- the buffer ---- */

static size_t round_up(size_t size) { return (size + 3) & ~(size_t)3; }

static bool reserve(struct lw_glb *glb, size_t size) {
    if (size <= glb->capacity - glb->size) return true;
    size_t capacity = glb->capacity + glb->capacity / 2;
    if (capacity < glb->size + size) capacity = glb->size + size;
    uint8_t *moved = realloc(glb->bin, capacity);
    if (!moved) return false;
    glb->bin = moved;
    glb->capacity = capacity;
    return true;
}

uint32_t lw_glb_view(struct lw_glb *glb, const void *bytes, size_t size, enum lw_glb_target target) {
    if (glb->error.status != LW_OK) return LW_GLB_NONE;
    if (size > UINT32_MAX || glb->size + round_up(size) > UINT32_MAX - HEADER_BYTES) {
        lw_glb_fail(glb, LW_BAD_DATA, "a .glb file cannot be larger than 4 GiB");
        return LW_GLB_NONE;
    }
    if (!reserve(glb, round_up(size))) return out_of_memory(glb);
    json_t *view = json_pack("{s:i, s:I, s:I}", "buffer", 0, "byteOffset", (json_int_t)glb->size,
                             "byteLength", (json_int_t)size);
    if (view && target != LW_GLB_TARGET_NONE) json_object_set_new(view, "target", json_integer(target));
    memcpy(glb->bin + glb->size, bytes, size);
    memset(glb->bin + glb->size + size, 0, round_up(size) - size);
    glb->size += round_up(size);
    return lw_glb_add(glb, "bufferViews", view);
}

static unsigned components_of(const char *type) {
    if (strcmp(type, "SCALAR") == 0) return 1;
    return (unsigned)(type[3] - '0'); /* VEC2, VEC3, VEC4 */
}

static void add_bounds(json_t *accessor, const float *values, uint32_t count, unsigned components) {
    float lo[4], hi[4];
    memcpy(lo, values, components * sizeof *lo);
    memcpy(hi, values, components * sizeof *hi);
    for (uint32_t i = 1; i < count; i++)
        for (unsigned c = 0; c < components; c++) {
            const float v = values[(size_t)i * components + c];
            if (v < lo[c]) lo[c] = v;
            if (v > hi[c]) hi[c] = v;
        }
    json_object_set_new(accessor, "min", lw_glb_numbers(lo, components));
    json_object_set_new(accessor, "max", lw_glb_numbers(hi, components));
}

uint32_t lw_glb_accessor(struct lw_glb *glb, const void *values, uint32_t count, const char *type,
                         enum lw_glb_component component, enum lw_glb_target target, bool with_bounds) {
    const unsigned components = components_of(type);
    const size_t size = (size_t)count * components * (component == LW_GLB_UINT16 ? 2 : 4);
    const uint32_t view = lw_glb_view(glb, values, size, target);
    if (view == LW_GLB_NONE) return LW_GLB_NONE;
    json_t *accessor = json_pack("{s:I, s:i, s:I, s:s}", "bufferView", (json_int_t)view, "componentType",
                                 (int)component, "count", (json_int_t)count, "type", type);
    if (accessor && with_bounds) add_bounds(accessor, values, count, components);
    return lw_glb_add(glb, "accessors", accessor);
}

/* ---- the file ---- */

static void put_u32(uint8_t *out, size_t value) {
    for (int i = 0; i < 4; i++) out[i] = (uint8_t)(value >> (8 * i));
}

static enum lw_status write_chunk(struct lw_atomic_file *file, const char type[4], const void *bytes,
                                  size_t size, char padding, struct lw_error *err) {
    uint8_t header[CHUNK_HEADER_BYTES];
    const char pad[3] = {padding, padding, padding};
    put_u32(header, round_up(size));
    memcpy(header + 4, type, 4);
    enum lw_status status = lw_atomic_file_write(file, header, sizeof header, err);
    if (status == LW_OK) status = lw_atomic_file_write(file, bytes, size, err);
    if (status == LW_OK) status = lw_atomic_file_write(file, pad, round_up(size) - size, err);
    return status;
}

static enum lw_status write_file(const struct lw_glb *glb, const char *path, const char *json, size_t total,
                                 struct lw_error *err) {
    uint8_t header[HEADER_BYTES] = {'g', 'l', 'T', 'F', 2};
    struct lw_atomic_file file;
    enum lw_status status = lw_atomic_file_open(&file, path, err);
    if (status != LW_OK) return status;
    put_u32(header + 8, total);
    status = lw_atomic_file_write(&file, header, sizeof header, err);
    if (status == LW_OK) status = write_chunk(&file, "JSON", json, strlen(json), ' ', err);
    if (status == LW_OK && glb->size) status = write_chunk(&file, "BIN", glb->bin, glb->size, 0, err);
    if (status == LW_OK) return lw_atomic_file_commit(&file, err);
    lw_atomic_file_abandon(&file);
    return status;
}

enum lw_status lw_glb_write(struct lw_glb *glb, const char *path, struct lw_error *err) {
    if (glb->size) lw_glb_add(glb, "buffers", json_pack("{s:I}", "byteLength", (json_int_t)glb->size));
    if (glb->error.status != LW_OK)
        return lw_status_fail(err, glb->error.status, "%s: %s", path, glb->error.text);
    char *json = json_dumps(glb->root, JSON_COMPACT | JSON_REAL_PRECISION(9)); /* 9 digits keep a float */
    if (!json) return lw_status_fail(err, LW_NO_MEMORY, "%s: out of memory", path);
    const size_t total = HEADER_BYTES + CHUNK_HEADER_BYTES + round_up(strlen(json)) +
                         (glb->size ? CHUNK_HEADER_BYTES + glb->size : 0);
    enum lw_status status =
        total > UINT32_MAX
            ? lw_status_fail(err, LW_BAD_DATA, "%s: a .glb file cannot be larger than 4 GiB", path)
            : write_file(glb, path, json, total, err);
    free(json);
    return status;
}
