#include "server/import/gltf/gltf_skin.h"

#include "server/import/gltf/gltf_accessor.h"

#include <stdlib.h>

/* The inverse bind matrix of a joint, column-major in the file; without an accessor it is the identity. */
static enum lw_status read_bind(const struct lw_gltf_accessor *accessor, uint32_t joint,
                                struct lw_affine *out, struct lw_error *err) {
    float m[16];
    *out = (struct lw_affine)LW_AFFINE_IDENTITY;
    if (!accessor->count) return LW_OK;
    lw_gltf_accessor_read(accessor, joint, m);
    for (int k = 0; k < 16; k++)
        if (!isfinite(m[k]))
            return lw_status_fail(err, LW_BAD_DATA,
                                  "inverseBindMatrices: accessor %u: element %u is not finite",
                                  accessor->index, joint);
    for (int row = 0; row < 3; row++)
        for (int column = 0; column < 4; column++) out->m[row][column] = m[column * 4 + row];
    return LW_OK;
}

static enum lw_status open_binds(const struct lw_gltf_document *document, const json_t *object,
                                 uint32_t joint_count, struct lw_gltf_accessor *out, struct lw_error *err) {
    uint32_t index = LW_SCENE_NONE;
    if (lw_gltf_document_index(document, object, "inverseBindMatrices", LW_GLTF_ACCESSORS, &index, err) ||
        index == LW_SCENE_NONE)
        return err->status;
    if (lw_gltf_accessor_open(document, index, 16, 16, LW_GLTF_ACCEPT_FLOAT, out, err)) {
        lw_status_context(err, "inverseBindMatrices");
        return err->status;
    }
    if (out->count < joint_count)
        return lw_status_fail(err, LW_BAD_DATA,
                              "inverseBindMatrices: accessor %u has %u elements for %u joints", index,
                              out->count, joint_count);
    return LW_OK;
}

static enum lw_status read_joint(struct lw_gltf_skin *skin, const struct lw_gltf_document *document,
                                 const json_t *joints, uint32_t i, const uint32_t *node_of,
                                 struct lw_error *err) {
    uint64_t node;
    if (!lw_gltf_json_whole(json_array_get(joints, i), &node) || node >= document->count[LW_GLTF_NODES])
        return lw_status_fail(err, LW_BAD_DATA,
                              "joints: [%u] must be an index into nodes, which has %u elements", i,
                              document->count[LW_GLTF_NODES]);
    if (node_of[node] == LW_SCENE_NONE)
        return lw_status_fail(err, LW_BAD_DATA, "joints: nodes[%u] is not in the default scene",
                              (uint32_t)node);
    skin->joint[i] = (uint32_t)node;
    return LW_OK;
}

static enum lw_status read_skin(struct lw_gltf_skin *skin, const struct lw_gltf_document *document,
                                const json_t *object, const uint32_t *node_of, const struct lw_affine *place,
                                struct lw_error *err) {
    const json_t *joints = NULL;
    struct lw_gltf_accessor binds = {0};
    if (lw_gltf_json_require(object, "joints", err) || lw_gltf_json_array(object, "joints", &joints, err))
        return err->status;
    skin->joint_count = (uint32_t)json_array_size(joints);
    if (!skin->joint_count) return lw_status_fail(err, LW_BAD_DATA, "joints: must have one at least");
    if (open_binds(document, object, skin->joint_count, &binds, err)) return err->status;
    skin->matrix = calloc(skin->joint_count, sizeof *skin->matrix);
    skin->joint = calloc(skin->joint_count, sizeof *skin->joint);
    if (!skin->matrix || !skin->joint) return lw_status_fail(err, LW_NO_MEMORY, "out of memory for joints");
    for (uint32_t i = 0; i < skin->joint_count; i++) {
        struct lw_affine bind;
        if (read_joint(skin, document, joints, i, node_of, err) || read_bind(&binds, i, &bind, err))
            return err->status;
        skin->matrix[i] = lw_affine_multiply(&place[node_of[skin->joint[i]]], &bind);
    }
    return LW_OK;
}

enum lw_status lw_gltf_skin_init(struct lw_gltf_skin *skin, const struct lw_gltf_document *document,
                                 uint32_t index, const uint32_t *node_of, const struct lw_affine *place,
                                 struct lw_error *err) {
    *skin = (struct lw_gltf_skin){0};
    if (read_skin(skin, document, lw_gltf_document_item(document, LW_GLTF_SKINS, index), node_of, place, err))
        lw_status_context(err, "skins[%u]", index);
    return err->status;
}

void lw_gltf_skin_finish(struct lw_gltf_skin *skin) {
    free(skin->matrix);
    free(skin->joint);
    *skin = (struct lw_gltf_skin){0};
}
