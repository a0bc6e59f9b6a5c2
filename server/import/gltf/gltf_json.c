#include "server/import/gltf/gltf_json.h"

#include "common/scene/scene.h"

#include <float.h>
#include <math.h>

static enum lw_status wrong(struct lw_error *err, const char *key, const char *expected) {
    return lw_status_fail(err, LW_BAD_DATA, "%s: must be %s", key, expected);
}

enum lw_status lw_gltf_json_require(const json_t *object, const char *key, struct lw_error *err) {
    if (json_object_get(object, key)) return LW_OK;
    return lw_status_fail(err, LW_BAD_DATA, "%s: is required and missing", key);
}

enum lw_status lw_gltf_json_object(const json_t *object, const char *key, const json_t **out,
                                   struct lw_error *err) {
    const json_t *value = json_object_get(object, key);
    if (!value) return LW_OK;
    if (!json_is_object(value)) return wrong(err, key, "an object");
    *out = value;
    return LW_OK;
}

enum lw_status lw_gltf_json_array(const json_t *object, const char *key, const json_t **out,
                                  struct lw_error *err) {
    const json_t *value = json_object_get(object, key);
    if (!value) return LW_OK;
    if (!json_is_array(value)) return wrong(err, key, "an array");
    *out = value;
    return LW_OK;
}

enum lw_status lw_gltf_json_string(const json_t *object, const char *key, const char **out,
                                   struct lw_error *err) {
    const json_t *value = json_object_get(object, key);
    if (!value) return LW_OK;
    if (!json_is_string(value)) return wrong(err, key, "a string");
    *out = json_string_value(value);
    return LW_OK;
}

enum lw_status lw_gltf_json_flag(const json_t *object, const char *key, bool *out, struct lw_error *err) {
    const json_t *value = json_object_get(object, key);
    if (!value) return LW_OK;
    if (!json_is_boolean(value)) return wrong(err, key, "true or false");
    *out = json_is_true(value);
    return LW_OK;
}

bool lw_gltf_json_whole(const json_t *value, uint64_t *out) {
    const double exact_max = 9007199254740992.0; /* 2^53: the integers that a double holds */
    double real = json_real_value(value);
    if (json_is_integer(value) && json_integer_value(value) >= 0)
        *out = (uint64_t)json_integer_value(value);
    else if (json_is_real(value) && real >= 0 && real <= exact_max && real == floor(real))
        *out = (uint64_t)real;
    else
        return false;
    return true;
}

enum lw_status lw_gltf_json_integer(const json_t *object, const char *key, uint64_t min, uint64_t max,
                                    uint64_t *out, struct lw_error *err) {
    const json_t *value = json_object_get(object, key);
    uint64_t integer;
    if (!value) return LW_OK;
    if (!lw_gltf_json_whole(value, &integer) || integer < min || integer > max)
        return lw_status_fail(err, LW_BAD_DATA, "%s: must be an integer from %llu to %llu", key,
                              (unsigned long long)min, (unsigned long long)max);
    *out = integer;
    return LW_OK;
}

static bool real_from(const json_t *value, double min, double max, float *out) {
    if (!json_is_number(value)) return false;
    double real = json_number_value(value);
    if (!(real >= min && real <= max && fabs(real) <= (double)FLT_MAX)) return false;
    *out = (float)real;
    return true;
}

static enum lw_status wrong_range(struct lw_error *err, const char *key, const char *what, double min,
                                  double max) {
    if (isinf(min) && isinf(max)) return lw_status_fail(err, LW_BAD_DATA, "%s: must be %s", key, what);
    if (isinf(max)) return lw_status_fail(err, LW_BAD_DATA, "%s: must be %s, at least %g", key, what, min);
    return lw_status_fail(err, LW_BAD_DATA, "%s: must be %s from %g to %g", key, what, min, max);
}

enum lw_status lw_gltf_json_real(const json_t *object, const char *key, double min, double max, float *out,
                                 struct lw_error *err) {
    const json_t *value = json_object_get(object, key);
    if (!value || real_from(value, min, max, out)) return LW_OK;
    return wrong_range(err, key, "a number", min, max);
}

enum lw_status lw_gltf_json_reals(const json_t *object, const char *key, size_t count, double min, double max,
                                  float *out, struct lw_error *err) {
    const json_t *array = json_object_get(object, key);
    if (!array) return LW_OK;
    float reals[16];
    bool good = json_is_array(array) && json_array_size(array) == count && count <= 16;
    for (size_t i = 0; good && i < count; i++)
        good = real_from(json_array_get(array, i), min, max, &reals[i]);
    if (!good) {
        char what[32];
        snprintf(what, sizeof what, "an array of %zu numbers", count);
        return wrong_range(err, key, what, min, max);
    }
    for (size_t i = 0; i < count; i++) out[i] = reals[i];
    return LW_OK;
}

enum lw_status lw_gltf_json_extension(const json_t *object, const char *name, const json_t **out,
                                      struct lw_error *err) {
    const json_t *extensions = NULL;
    if (lw_gltf_json_object(object, "extensions", &extensions, err)) return err->status;
    if (!extensions || !lw_gltf_json_object(extensions, name, out, err)) return LW_OK;
    lw_status_context(err, "extensions");
    return err->status;
}

enum lw_status lw_gltf_json_drawn_by(const json_t *object, uint8_t *out, struct lw_error *err) {
    const json_t *extras = json_object_get(object, "extras"), *ours = NULL;
    bool clients = false;
    if (!extras || !json_is_object(extras)) return LW_OK;
    if (lw_gltf_json_object(extras, "lightwell", &ours, err)) {
        lw_status_context(err, "extras");
        return err->status;
    }
    if (!ours || !json_object_get(ours, "clientLight")) return LW_OK;
    if (lw_gltf_json_flag(ours, "clientLight", &clients, err)) {
        lw_status_context(err, "extras: lightwell");
        return err->status;
    }
    *out = clients ? LW_DRAWN_BY_CLIENTS : LW_DRAWN_BY_SERVER;
    return LW_OK;
}
