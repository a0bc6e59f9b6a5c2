#include "server/import/mesh/mesh_builder.h"

#include "server/import/mesh/mesh_tangents.h"

#include <stdlib.h>
#include <string.h>

void lw_mesh_builder_init(struct lw_mesh_builder *builder) { *builder = (struct lw_mesh_builder){0}; }

void lw_mesh_builder_finish(struct lw_mesh_builder *builder) {
    free(builder->material);
    free(builder->triangle);
    free(builder->vertex);
    *builder = (struct lw_mesh_builder){0};
}

void lw_mesh_builder_begin(struct lw_mesh_builder *builder) {
    builder->vertex_count = builder->triangle_count = 0;
    builder->has_uv[0] = builder->has_uv[1] = builder->has_colour = builder->has_tangent = false;
}

bool lw_mesh_builder_reserve(void **array, size_t *capacity, size_t count, size_t size) {
    if (count <= *capacity) return true;
    size_t grown = *capacity + *capacity / 2 > count ? *capacity + *capacity / 2 : count;
    void *moved = reallocarray(*array, grown, size);
    if (!moved) return false;
    *array = moved;
    *capacity = grown;
    return true;
}

/* In double, because a float's square of an area underflows for small triangles. */
bool lw_mesh_builder_normal(const struct lw_vec3 corner[3], struct lw_vec3 *out) {
    double a[3] = {(double)corner[1].x - (double)corner[0].x, (double)corner[1].y - (double)corner[0].y,
                   (double)corner[1].z - (double)corner[0].z};
    double b[3] = {(double)corner[2].x - (double)corner[0].x, (double)corner[2].y - (double)corner[0].y,
                   (double)corner[2].z - (double)corner[0].z};
    double c[3] = {b[0] - a[0], b[1] - a[1], b[2] - a[2]};
    double n[3] = {a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]};
    double length = sqrt(n[0] * n[0] + n[1] * n[1] + n[2] * n[2]);
    double longest =
        fmax(fmax(a[0] * a[0] + a[1] * a[1] + a[2] * a[2], b[0] * b[0] + b[1] * b[1] + b[2] * b[2]),
             c[0] * c[0] + c[1] * c[1] + c[2] * c[2]);
    if (!(length > 1e-7 * longest)) return false;
    *out = lw_vec3((float)(n[0] / length), (float)(n[1] / length), (float)(n[2] / length));
    return true;
}

enum lw_status lw_mesh_builder_vertex(struct lw_mesh_builder *builder,
                                      const struct lw_mesh_builder_vertex *vertex, uint32_t *out_index,
                                      struct lw_error *err) {
    if (!lw_mesh_builder_reserve((void **)&builder->vertex, &builder->vertex_capacity,
                                 builder->vertex_count + 1ul, sizeof *builder->vertex))
        return lw_status_fail(err, LW_NO_MEMORY, "out of memory for vertices");
    builder->vertex[builder->vertex_count] = *vertex;
    *out_index = builder->vertex_count++;
    return LW_OK;
}

enum lw_status lw_mesh_builder_triangle(struct lw_mesh_builder *builder, const uint32_t vertex[3],
                                        uint32_t material, struct lw_vec3 normal, struct lw_error *err) {
    if (!lw_mesh_builder_reserve((void **)&builder->triangle, &builder->triangle_capacity,
                                 builder->triangle_count + 1ul, sizeof *builder->triangle) ||
        !lw_mesh_builder_reserve((void **)&builder->material, &builder->material_capacity,
                                 builder->triangle_count + 1ul, sizeof *builder->material))
        return lw_status_fail(err, LW_NO_MEMORY, "out of memory for triangles");
    for (unsigned k = 0; k < 3; k++) {
        struct lw_mesh_builder_vertex *v = &builder->vertex[vertex[k]];
        if (lw_vec3_dot(v->normal, v->normal) == 0) v->normal = normal;
        builder->triangle[builder->triangle_count][k] = vertex[k];
    }
    builder->material[builder->triangle_count++] = material;
    return LW_OK;
}

static enum lw_status build_tangents(struct lw_mesh_builder *builder, struct lw_scene *scene,
                                     struct lw_mesh *mesh, struct lw_error *err) {
    struct lw_vec4 *given = NULL;
    if (builder->has_tangent) {
        given = malloc(builder->vertex_count * sizeof *given);
        if (!given) return lw_status_fail(err, LW_NO_MEMORY, "out of memory for tangents");
        for (uint32_t i = 0; i < builder->vertex_count; i++) given[i] = builder->vertex[i].tangent;
    }
    const enum lw_status status =
        lw_mesh_tangents_build(scene, mesh, given, &builder->bad_tangent_count, err);
    free(given);
    return status;
}

enum lw_status lw_mesh_builder_end(struct lw_mesh_builder *builder, struct lw_scene *scene, const char *name,
                                   struct lw_mesh *out, struct lw_error *err) {
    uint32_t vertices = builder->vertex_count, triangles = builder->triangle_count;
    struct lw_vec3 *position = lw_scene_alloc(scene, vertices, sizeof *position);
    struct lw_vec3 *normal = lw_scene_alloc(scene, vertices, sizeof *normal);
    uint32_t(*triangle)[3] = lw_scene_alloc(scene, triangles, sizeof *triangle);
    uint32_t *material = lw_scene_alloc(scene, triangles, sizeof *material);
    struct lw_vec2 *uv[2] = {NULL, NULL};
    struct lw_vec4 *colour = NULL;
    const char *own_name = lw_scene_string(scene, name);
    bool good = position && normal && triangle && material && own_name;
    for (int set = 0; good && set < 2; set++)
        if (builder->has_uv[set]) good = (uv[set] = lw_scene_alloc(scene, vertices, sizeof *uv[set])) != NULL;
    if (good && builder->has_colour)
        good = (colour = lw_scene_alloc(scene, vertices, sizeof *colour)) != NULL;
    if (!good) return lw_status_fail(err, LW_NO_MEMORY, "out of memory for %u vertices", vertices);

    for (uint32_t i = 0; i < vertices; i++) {
        const struct lw_mesh_builder_vertex *v = &builder->vertex[i];
        position[i] = v->position;
        normal[i] = v->normal;
        if (uv[0]) uv[0][i] = v->uv[0];
        if (uv[1]) uv[1][i] = v->uv[1];
        if (colour) colour[i] = v->colour;
    }
    memcpy(triangle, builder->triangle, triangles * sizeof *triangle);
    memcpy(material, builder->material, triangles * sizeof *material);
    *out = (struct lw_mesh){.name = own_name,
                            .vertex_count = vertices,
                            .triangle_count = triangles,
                            .position = position,
                            .normal = normal,
                            .uv = {uv[0], uv[1]},
                            .colour = colour,
                            .triangle = triangle,
                            .material = material};
    return build_tangents(builder, scene, out, err);
}
