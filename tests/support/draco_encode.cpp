#include "tests/support/draco_encode.h"

#include <cstring>
#include <draco/compression/encode.h>

static void add(draco::Mesh *mesh, draco::GeometryAttribute::Type kind, draco::DataType type, int components,
                size_t stride, const void *values, uint32_t count) {
    draco::GeometryAttribute attribute;
    attribute.Init(kind, nullptr, (int8_t)components, type, type == draco::DT_UINT8, (int64_t)stride, 0);
    const int id = mesh->AddAttribute(attribute, true, count);
    for (uint32_t i = 0; i < count; i++)
        mesh->attribute(id)->SetAttributeValue(draco::AttributeValueIndex(i),
                                               (const uint8_t *)values + i * stride);
}

size_t lw_draco_encode(const float *position, const float *normal, const uint8_t *colour,
                       uint32_t vertex_count, const uint32_t *index, uint32_t triangle_count,
                       bool edgebreaker, uint8_t *out, size_t capacity) {
    draco::Mesh mesh;
    mesh.set_num_points(vertex_count);
    mesh.SetNumFaces(triangle_count);
    for (uint32_t t = 0; t < triangle_count; t++) {
        draco::Mesh::Face face;
        for (int k = 0; k < 3; k++) face[k] = draco::PointIndex(index[3 * t + k]);
        mesh.SetFace(draco::FaceIndex(t), face);
    }
    add(&mesh, draco::GeometryAttribute::POSITION, draco::DT_FLOAT32, 3, 12, position, vertex_count);
    add(&mesh, draco::GeometryAttribute::NORMAL, draco::DT_FLOAT32, 3, 12, normal, vertex_count);
    add(&mesh, draco::GeometryAttribute::COLOR, draco::DT_UINT8, 4, 4, colour, vertex_count);
    draco::Encoder encoder;
    encoder.SetEncodingMethod(edgebreaker ? draco::MESH_EDGEBREAKER_ENCODING
                                          : draco::MESH_SEQUENTIAL_ENCODING);
    draco::EncoderBuffer buffer;
    if (!encoder.EncodeMeshToBuffer(mesh, &buffer).ok() || buffer.size() > capacity) return 0;
    memcpy(out, buffer.data(), buffer.size());
    return buffer.size();
}
