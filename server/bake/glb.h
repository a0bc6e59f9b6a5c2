/* glb.h: builds a glTF 2.0 file: the JSON's arrays and the binary buffer.
 * Flow:    vertices, indices, pictures -> [glb] -> one .glb file
 * Threads: one lw_glb belongs to one thread.
 * After:   the glTF 2.0 specification, 3.6 (buffers, views, accessors) and 4.4 (GLB layout).
 *
 * The first failure is kept: later calls do nothing and return LW_GLB_NONE; lw_glb_write() returns it. */
#ifndef LW_BAKE_GLB_H
#define LW_BAKE_GLB_H

#include "common/base/status.h"

#include <jansson.h>
#include <stdint.h>

#define LW_GLB_NONE UINT32_MAX

enum lw_glb_component { LW_GLB_UINT16 = 5123, LW_GLB_UINT32 = 5125, LW_GLB_FLOAT = 5126 };
enum lw_glb_target { LW_GLB_TARGET_NONE = 0, LW_GLB_TARGET_VERTICES = 34962, LW_GLB_TARGET_INDICES = 34963 };

struct lw_glb {
    json_t *root;
    uint8_t *bin;
    size_t size, capacity; /* bytes of bin */
    struct lw_error error;
};

/** Begins a file; `generator` is kept in its `asset`. End with lw_glb_finish(). */
void lw_glb_init(struct lw_glb *glb, const char *generator);
void lw_glb_finish(struct lw_glb *glb);

/** Keeps a failure, if it is the first. */
void lw_glb_fail(struct lw_glb *glb, enum lw_status status, const char *what);

/** Appends to one of the root's arrays ("materials"), made at its first use. Takes `item`; NULL is out of
 * memory. Returns its index. */
uint32_t lw_glb_add(struct lw_glb *glb, const char *array, json_t *item);

/** Lists an extension in extensionsUsed, once. */
void lw_glb_use_extension(struct lw_glb *glb, const char *name);

/** Copies bytes into the buffer, aligned to 4. Returns the index of a bufferView. */
uint32_t lw_glb_view(struct lw_glb *glb, const void *bytes, size_t size, enum lw_glb_target target);

/** The same with an accessor on it. type: "SCALAR", "VEC2", ...; with_bounds: adds min and max, for floats.
 * Returns the accessor's index. */
uint32_t lw_glb_accessor(struct lw_glb *glb, const void *values, uint32_t count, const char *type,
                         enum lw_glb_component component, enum lw_glb_target target, bool with_bounds);

/** [a, b, ...]; NULL when out of memory. */
json_t *lw_glb_numbers(const float *values, unsigned count);

/** Writes the file; it appears whole or not at all.
 * Errors: the first failure kept; LW_CANNOT_CREATE, LW_IO naming the path; LW_BAD_DATA beyond 4 GiB. */
LW_MUST_CHECK enum lw_status lw_glb_write(struct lw_glb *glb, const char *path, struct lw_error *err);

#endif
