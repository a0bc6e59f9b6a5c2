/* gltf_shape.h: moves the vertices of a primitive before they are lit: morph targets by their weights,
 * then a skin in its rest pose. Neither is animated.
 * Threads: [any]; a shape belongs to one primitive. After: glTF 2.0, 3.7.2.2 and 3.7.3. */
#ifndef LW_IMPORT_GLTF_GLTF_SHAPE_H
#define LW_IMPORT_GLTF_GLTF_SHAPE_H

#include "server/import/gltf/gltf_accessor.h"
#include "server/import/gltf/gltf_skin.h"

/* Shape of a mesh at one node; zeroed: the mesh's own. */
struct lw_gltf_look {
    const json_t *weights; /* the node's; NULL: the mesh's count */
    const struct lw_gltf_skin *skin;
};

struct lw_gltf_morph {
    struct lw_gltf_accessor position, normal; /* differences; count 0: absent */
    float weight;
};

/* Joints and weights come four a set. */
#define LW_GLTF_SHAPE_SETS 2

struct lw_gltf_shape {
    struct lw_gltf_morph *morph; /* targets whose weight is not 0 */
    size_t morph_count;
    const struct lw_gltf_skin *skin; /* or NULL */
    struct lw_gltf_accessor joints[LW_GLTF_SHAPE_SETS], weights[LW_GLTF_SHAPE_SETS];
};

/** Opens the targets and the skin of a primitive of `count` vertices. finish() also after failure.
 * mesh  whose `weights` count where the node has none
 * Errors: LW_BAD_DATA, LW_NO_MEMORY. */
LW_MUST_CHECK enum lw_status lw_gltf_shape_init(struct lw_gltf_shape *shape,
                                                const struct lw_gltf_document *document, const json_t *mesh,
                                                const json_t *primitive, const struct lw_gltf_look *look,
                                                uint32_t count, struct lw_error *err);
void lw_gltf_shape_finish(struct lw_gltf_shape *shape);

/** Moves the position of vertex i < count, in the mesh's space; with a skin into world space.
 * Errors: LW_BAD_DATA: a joint that the skin has not, numbers that are not finite. */
LW_MUST_CHECK enum lw_status lw_gltf_shape_position(const struct lw_gltf_shape *shape, uint32_t i,
                                                    struct lw_vec3 *position, struct lw_error *err);
/** The same for its normal, which need not be unit before and is not after. */
LW_MUST_CHECK enum lw_status lw_gltf_shape_normal(const struct lw_gltf_shape *shape, uint32_t i,
                                                  struct lw_vec3 *normal, struct lw_error *err);
/** Whether the skin turns the winding of a triangle about vertex i. Its position was found good. */
bool lw_gltf_shape_mirrors(const struct lw_gltf_shape *shape, uint32_t i);

#endif
