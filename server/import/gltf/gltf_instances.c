#include "server/import/gltf/gltf_instances.h"

static enum lw_status open_attribute(const struct lw_gltf_document *document, const json_t *attributes,
                                     const char *key, unsigned components, unsigned accept,
                                     struct lw_gltf_accessor *out, uint32_t *count, struct lw_error *err) {
    uint32_t index = LW_SCENE_NONE;
    if (lw_gltf_document_index(document, attributes, key, LW_GLTF_ACCESSORS, &index, err) ||
        index == LW_SCENE_NONE)
        return err->status;
    if (lw_gltf_accessor_open(document, index, components, components, accept, out, err)) {
        lw_status_context(err, "%s", key);
        return err->status;
    }
    if (*count && *count != out->count)
        return lw_status_fail(err, LW_BAD_DATA, "%s: accessor %u has %u elements, others have %u", key, index,
                              out->count, *count);
    *count = out->count;
    return LW_OK;
}

static enum lw_status open_attributes(const struct lw_gltf_document *document, const json_t *extension,
                                      struct lw_gltf_instances *out, struct lw_error *err) {
    const json_t *attributes = NULL;
    const unsigned real = LW_GLTF_ACCEPT_FLOAT, rotation = real | LW_GLTF_ACCEPT_NORMALIZED_SIGNED;
    if (lw_gltf_json_require(extension, "attributes", err) ||
        lw_gltf_json_object(extension, "attributes", &attributes, err) ||
        open_attribute(document, attributes, "TRANSLATION", 3, real, &out->translation, &out->count, err) ||
        open_attribute(document, attributes, "ROTATION", 4, rotation, &out->rotation, &out->count, err) ||
        open_attribute(document, attributes, "SCALE", 3, real, &out->scale, &out->count, err))
        return err->status;
    return LW_OK;
}

enum lw_status lw_gltf_instances_open(const struct lw_gltf_document *document, const json_t *node,
                                      struct lw_gltf_instances *out, struct lw_error *err) {
    const json_t *extension = NULL;
    struct lw_gltf_instances instances = {0};
    if (lw_gltf_json_extension(node, "EXT_mesh_gpu_instancing", &extension, err)) return err->status;
    if (extension && open_attributes(document, extension, &instances, err)) {
        lw_status_context(err, "EXT_mesh_gpu_instancing");
        return err->status;
    }
    *out = instances;
    return LW_OK;
}

static enum lw_status read_finite(const struct lw_gltf_accessor *accessor, uint32_t i, float *out,
                                  struct lw_error *err) {
    float v[4];
    if (!accessor->count) return LW_OK; /* the node's default stays */
    lw_gltf_accessor_read(accessor, i, v);
    for (unsigned c = 0; c < accessor->components; c++) {
        if (!(fabsf(v[c]) <= LW_SCENE_COORDINATE_MAX))
            return lw_status_fail(err, LW_BAD_DATA,
                                  "accessor %u: element %u is not a finite number, or too large",
                                  accessor->index, i);
        out[c] = v[c];
    }
    return LW_OK;
}

enum lw_status lw_gltf_instances_read(const struct lw_gltf_instances *instances, uint32_t i,
                                      struct lw_node *node, struct lw_error *err) {
    double square = 0;
    if (read_finite(&instances->translation, i, node->translation, err) ||
        read_finite(&instances->rotation, i, node->rotation, err) ||
        read_finite(&instances->scale, i, node->scale, err)) {
        lw_status_context(err, "EXT_mesh_gpu_instancing");
        return err->status;
    }
    for (int c = 0; c < 4; c++) square += (double)node->rotation[c] * (double)node->rotation[c];
    if (!(square > 1e-12))
        return lw_status_fail(err, LW_BAD_DATA,
                              "EXT_mesh_gpu_instancing: accessor %u: element %u is not a rotation",
                              instances->rotation.index, i);
    for (int c = 0; c < 4; c++) node->rotation[c] = (float)((double)node->rotation[c] / sqrt(square));
    return LW_OK;
}
