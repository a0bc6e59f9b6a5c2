/* gltf_json.h: typed fields of a JSON object. Each function leaves *out alone if the field is absent, so that
 * *out holds the default; a field of the wrong type or range is an error that starts with its name.
 * Threads: [any]. err is never NULL inside the glTF reader, so that calls chain: if (f() || g()) return
 *          err->status; */
#ifndef LW_IMPORT_GLTF_GLTF_JSON_H
#define LW_IMPORT_GLTF_GLTF_JSON_H

#include "common/base/status.h"

#include <jansson.h>
#include <stdint.h>

LW_MUST_CHECK enum lw_status lw_gltf_json_require(const json_t *object, const char *key,
                                                  struct lw_error *err);
LW_MUST_CHECK enum lw_status lw_gltf_json_object(const json_t *object, const char *key, const json_t **out,
                                                 struct lw_error *err);
LW_MUST_CHECK enum lw_status lw_gltf_json_array(const json_t *object, const char *key, const json_t **out,
                                                struct lw_error *err);
LW_MUST_CHECK enum lw_status lw_gltf_json_string(const json_t *object, const char *key, const char **out,
                                                 struct lw_error *err);
LW_MUST_CHECK enum lw_status lw_gltf_json_flag(const json_t *object, const char *key, bool *out,
                                               struct lw_error *err);
/** Whether a value is an integer of 0 or more. 48.0 is one, since some exporters write it. NULL is
 * not. */
LW_MUST_CHECK bool lw_gltf_json_whole(const json_t *value, uint64_t *out);
/** An integer within [min, max], as lw_gltf_json_whole() takes it. */
LW_MUST_CHECK enum lw_status lw_gltf_json_integer(const json_t *object, const char *key, uint64_t min,
                                                  uint64_t max, uint64_t *out, struct lw_error *err);
/** A number within [min, max] and the range of float. */
LW_MUST_CHECK enum lw_status lw_gltf_json_real(const json_t *object, const char *key, double min, double max,
                                               float *out, struct lw_error *err);
/** An array of exactly `count` such numbers. */
LW_MUST_CHECK enum lw_status lw_gltf_json_reals(const json_t *object, const char *key, size_t count,
                                                double min, double max, float *out, struct lw_error *err);

/** object.extras.lightwell.clientLight as an enum lw_drawn_by. Extras of other programs may be anything. */
LW_MUST_CHECK enum lw_status lw_gltf_json_drawn_by(const json_t *object, uint8_t *out, struct lw_error *err);

/** object.extensions[name], or *out untouched. */
LW_MUST_CHECK enum lw_status lw_gltf_json_extension(const json_t *object, const char *name,
                                                    const json_t **out, struct lw_error *err);

#endif
