#include "server/import/gltf/gltf_draco.h"

enum lw_status lw_gltf_draco_open(const struct lw_gltf_document *document, const json_t *extension,
                                  const struct lw_gltf_accessor *position, struct lw_gltf_accessor *indices,
                                  struct lw_draco_mesh **out_mesh, struct lw_error *err) {
    uint32_t view = 0;
    struct lw_draco_mesh *mesh = NULL;
    *out_mesh = NULL;
    if (lw_gltf_json_require(extension, "bufferView", err) ||
        lw_gltf_document_index(document, extension, "bufferView", LW_GLTF_BUFFER_VIEWS, &view, err))
        return err->status;
    const struct lw_gltf_bytes *bytes = &document->view[view].bytes;
    if (lw_draco_mesh_create(bytes->data, bytes->size, indices->count / 3, position->count, &mesh, err)) {
        lw_status_context(err, "bufferView %u", view);
        return err->status;
    }
    if (lw_draco_mesh_triangle_count(mesh) == 0) {
        lw_draco_mesh_destroy(mesh);
        return lw_status_fail(err, LW_BAD_DATA, "bufferView %u: is a Draco stream without triangles", view);
    }
    indices->count = 3 * lw_draco_mesh_triangle_count(mesh);
    indices->type = LW_GLTF_UINT32;
    indices->data = (const uint8_t *)lw_draco_mesh_indices(mesh);
    indices->stride = 4;
    indices->sparse_count = 0;
    *out_mesh = mesh;
    return LW_OK;
}

static enum lw_draco_mesh_type type_of(enum lw_gltf_component type, size_t *out_size) {
    switch (type) {
    case LW_GLTF_INT8:
        return *out_size = 1, LW_DRACO_INT8;
    case LW_GLTF_UINT8:
        return *out_size = 1, LW_DRACO_UINT8;
    case LW_GLTF_INT16:
        return *out_size = 2, LW_DRACO_INT16;
    case LW_GLTF_UINT16:
        return *out_size = 2, LW_DRACO_UINT16;
    case LW_GLTF_UINT32:
        return *out_size = 4, LW_DRACO_UINT32;
    case LW_GLTF_FLOAT:
        break;
    }
    return *out_size = 4, LW_DRACO_FLOAT;
}

enum lw_status lw_gltf_draco_attribute(const json_t *extension, struct lw_draco_mesh *mesh, const char *name,
                                       struct lw_gltf_accessor *accessor, struct lw_error *err) {
    const json_t *attributes = NULL;
    uint64_t id = 0;
    size_t size = 0;
    if (lw_gltf_json_require(extension, "attributes", err) ||
        lw_gltf_json_object(extension, "attributes", &attributes, err))
        return err->status;
    if (!accessor->count || !json_object_get(attributes, name)) return LW_OK;
    if (lw_gltf_json_integer(attributes, name, 0, UINT32_MAX, &id, err)) return err->status;
    if (accessor->count != lw_draco_mesh_vertex_count(mesh))
        return lw_status_fail(err, LW_BAD_DATA, "%s: accessor %u has %u elements, the Draco stream %u", name,
                              accessor->index, accessor->count, lw_draco_mesh_vertex_count(mesh));
    const enum lw_draco_mesh_type type = type_of(accessor->type, &size);
    if (lw_draco_mesh_attribute(mesh, (uint32_t)id, type, accessor->components, &accessor->data, err)) {
        lw_status_context(err, "%s", name);
        return err->status;
    }
    accessor->stride = size * accessor->components;
    accessor->sparse_count = 0;
    return LW_OK;
}
