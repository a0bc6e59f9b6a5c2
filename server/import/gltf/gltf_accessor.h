/* gltf_accessor.h: typed elements of a buffer, bounds-checked once, then read one by one (sparse ones
 * included). Nothing is copied: an accessor costs no memory by its declared count. min and max are not used.
 * Threads: pure reads once open. After: glTF 2.0, 3.6.2. */
#ifndef LW_IMPORT_GLTF_GLTF_ACCESSOR_H
#define LW_IMPORT_GLTF_GLTF_ACCESSOR_H

#include "server/import/gltf/gltf_document.h"

#define LW_GLTF_ELEMENTS_MAX (1u << 31) /* elements of one accessor */
/* Elements of an accessor without a bufferView (all zero except sparse ones). */
#define LW_GLTF_UNBACKED_MAX (1u << 20)

enum lw_gltf_component {
    LW_GLTF_INT8 = 5120,
    LW_GLTF_UINT8 = 5121,
    LW_GLTF_INT16 = 5122,
    LW_GLTF_UINT16 = 5123,
    LW_GLTF_UINT32 = 5125,
    LW_GLTF_FLOAT = 5126
};

/* Component types as a set, for what a use accepts. */
enum {
    LW_GLTF_ACCEPT_FLOAT = 1 << 0,
    LW_GLTF_ACCEPT_NORMALIZED_UNSIGNED = 1 << 1, /* 8 and 16 bits */
    LW_GLTF_ACCEPT_NORMALIZED_SIGNED = 1 << 2,
    LW_GLTF_ACCEPT_UNSIGNED = 1 << 3, /* 8 and 16 bits */
    LW_GLTF_ACCEPT_SIGNED = 1 << 4,
    LW_GLTF_ACCEPT_INDEX = 1 << 5, /* unsigned integers, 32 bits too */
    LW_GLTF_ACCEPT_ANY = LW_GLTF_ACCEPT_INDEX - 1,
    LW_GLTF_ACCEPT_UNBACKED =
        1 << 6, /* no type: any count without a bufferView, as its bytes come otherwise */
};

struct lw_gltf_accessor {
    uint32_t index; /* in the document */
    uint32_t count;
    uint8_t components; /* per element: 1 to 4, or 16: a matrix, column-major */
    bool normalized;
    enum lw_gltf_component type;
    const uint8_t *data; /* NULL: zeros */
    size_t stride;
    uint32_t sparse_count;
    enum lw_gltf_component sparse_type;
    const uint8_t *sparse_index; /* strictly increasing, below count */
    const uint8_t *sparse_value; /* tightly packed */
};

/** Checks an accessor against its buffer views and what the use accepts.
 * components_min, components_max  e.g. 3, 4 for a colour
 * Errors: LW_BAD_DATA that starts with "accessor N". */
LW_MUST_CHECK enum lw_status lw_gltf_accessor_open(const struct lw_gltf_document *document, uint32_t index,
                                                   unsigned components_min, unsigned components_max,
                                                   unsigned accept, struct lw_gltf_accessor *out,
                                                   struct lw_error *err);

/** Element i < count as numbers; writes `components` floats, which may be NaN or infinite. */
void lw_gltf_accessor_read(const struct lw_gltf_accessor *accessor, uint32_t i, float *out);

/** Element i < count of an accessor that was opened with LW_GLTF_ACCEPT_INDEX. */
uint32_t lw_gltf_accessor_integer(const struct lw_gltf_accessor *accessor, uint32_t i);

#endif
