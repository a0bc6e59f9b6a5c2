/* The glTF reader on any bytes: a scene that validates, or an error with a text; never a crash. No file is
 * opened. */
#include "common/base/log.h"
#include "server/import/gltf/gltf.h"

#include <jansson.h>
#include <stdlib.h>
#include <string.h>

int LLVMFuzzerInitialize(int *argc, char ***argv);
int LLVMFuzzerTestOneInput(const uint8_t *bytes, size_t size);

int LLVMFuzzerInitialize(int *argc, char ***argv) {
    (void)argc, (void)argv;
    lw_log_init("fuzz_gltf", LW_LOG_ERROR);
    return 0;
}

int LLVMFuzzerTestOneInput(const uint8_t *bytes, size_t size) {
    struct lw_scene *scene = NULL;
    struct lw_error err = {0};
    enum lw_status status = lw_gltf_load_memory(bytes, size, "fuzz", &scene, &err);
    if (status == LW_OK ? lw_scene_validate(scene, &err) != LW_OK : scene || !err.text[0]) abort();
    lw_scene_destroy(scene);
    return 0;
}

#ifdef LW_FUZZ
/* Mutations that know JSON: most random bytes would only make texts that do not parse. */

size_t LLVMFuzzerMutate(uint8_t *bytes, size_t size, size_t size_max);
size_t LLVMFuzzerCustomMutator(uint8_t *bytes, size_t size, size_t size_max, unsigned seed);

struct choice {
    unsigned seed, seen;
    json_t *parent, *value; /* the value chosen so far, and what holds it */
    const char *key;        /* an object's key; else the place in an array */
    size_t at;
};

static unsigned next_random(struct choice *c) {
    c->seed = c->seed * 1664525u + 1013904223u;
    return c->seed >> 8;
}

/* Each value of the tree is as likely as any other. */
static void walk(struct choice *c, json_t *parent) {
    const char *key;
    json_t *value;
    size_t at;
    if (json_is_object(parent)) {
        json_object_foreach(parent, key, value) {
            if (next_random(c) % ++c->seen == 0) c->parent = parent, c->value = value, c->key = key;
            walk(c, value);
        }
    } else if (json_is_array(parent)) {
        json_array_foreach(parent, at, value) {
            if (next_random(c) % ++c->seen == 0)
                c->parent = parent, c->value = value, c->key = NULL, c->at = at;
            walk(c, value);
        }
    }
}

static json_t *other_value(struct choice *c, const json_t *root) {
    static const double numbers[] = {0,     1,   -1,   2,    3,   7, 255, 65536, 4294967295.0,
                                     1e300, 0.5, 5121, 5123, 5126};
    static const char *const texts[] = {"SCALAR", "VEC2",   "VEC3",        "MAT4",
                                        "BLEND",  "LINEAR", "CUBICSPLINE", ""};
    struct choice from = {.seed = next_random(c)};
    const unsigned kind = next_random(c) % 4;
    if (kind == 0) {
        const double number = numbers[next_random(c) % (sizeof numbers / sizeof *numbers)];
        return number < 1e10 && number != 0.5 ? json_integer((json_int_t)number) : json_real(number);
    }
    if (kind == 1 && json_is_string(c->value))
        return json_string(texts[next_random(c) % (sizeof texts / sizeof *texts)]);
    if (kind == 2 && json_is_integer(c->value))
        return json_integer(json_integer_value(c->value) + (next_random(c) % 2 ? 1 : -1));
    walk(&from, (json_t *)root); /* a value from elsewhere */
    return from.value ? json_deep_copy(from.value) : json_null();
}

size_t LLVMFuzzerCustomMutator(uint8_t *bytes, size_t size, size_t size_max, unsigned seed) {
    json_t *root = seed % 4 ? json_loadb((const char *)bytes, size, 0, NULL) : NULL;
    if (!root) return LLVMFuzzerMutate(bytes, size, size_max);
    struct choice c = {.seed = seed};
    walk(&c, root);
    if (c.value) {
        json_t *value = other_value(&c, root);
        const unsigned how = next_random(&c) % 5;
        if (how == 0 && c.key)
            json_object_del(c.parent, c.key);
        else if (how == 0)
            json_array_remove(c.parent, c.at);
        else if (how == 1 && !c.key)
            json_array_append(c.parent, value);
        else if (c.key)
            json_object_set(c.parent, c.key, value);
        else
            json_array_set(c.parent, c.at, value);
        json_decref(value);
    }
    char *text = json_dumps(root, JSON_COMPACT);
    json_decref(root);
    const size_t length = text ? strlen(text) : 0;
    const bool fits = length > 0 && length <= size_max;
    if (fits) memcpy(bytes, text, length);
    free(text);
    return fits ? length : LLVMFuzzerMutate(bytes, size, size_max);
}
#endif
