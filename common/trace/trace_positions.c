#include "common/trace/trace_positions.h"

#include "common/scene/mesh_weld.h"

#include <stdlib.h>

static bool pays(const struct lw_mesh *mesh, uint32_t count, uint32_t objects) {
    const uint64_t saved = (uint64_t)(mesh->vertex_count - count) * objects * sizeof *mesh->position,
                   added = mesh->triangle_count * sizeof *mesh->triangle + count * sizeof(uint32_t);
    return saved > added;
}

/* weld: room for the vertices of the mesh. */
static enum lw_status list_mesh(const struct lw_mesh *mesh, uint32_t objects, uint32_t *weld,
                                struct lw_trace_positions *out) {
    uint32_t count;
    enum lw_status status = lw_mesh_weld(mesh, weld, &count);
    if (status != LW_OK || !pays(mesh, count, objects)) return status;
    out->vertex = malloc(count * sizeof *out->vertex);
    out->triangle = malloc(mesh->triangle_count * sizeof *out->triangle);
    if (!out->vertex || !out->triangle) return LW_NO_MEMORY;
    out->count = count;
    for (uint32_t v = mesh->vertex_count; v-- > 0;) out->vertex[weld[v]] = v;
    for (uint32_t t = 0; t < mesh->triangle_count; t++)
        for (int c = 0; c < 3; c++) out->triangle[t][c] = weld[mesh->triangle[t][c]];
    return LW_OK;
}

enum lw_status lw_trace_positions_list(const struct lw_scene *scene,
                                       struct lw_trace_positions **out_positions) {
    struct lw_trace_positions *positions = calloc(scene->mesh_count + 1ul, sizeof *positions);
    uint32_t *objects = calloc(scene->mesh_count + 1ul, sizeof *objects), vertices = 0;
    for (uint32_t m = 0; m < scene->mesh_count; m++)
        if (scene->mesh[m].vertex_count > vertices) vertices = scene->mesh[m].vertex_count;
    uint32_t *weld = malloc((vertices + 1ul) * sizeof *weld);
    enum lw_status status = positions && objects && weld ? LW_OK : LW_NO_MEMORY;
    for (uint32_t o = 0; status == LW_OK && o < scene->object_count; o++) objects[scene->object[o].mesh]++;
    for (uint32_t m = 0; status == LW_OK && m < scene->mesh_count; m++)
        if (objects[m] > 1) status = list_mesh(&scene->mesh[m], objects[m], weld, &positions[m]);
    free(weld);
    free(objects);
    if (status == LW_OK)
        *out_positions = positions;
    else
        lw_trace_positions_free(positions, scene);
    return status;
}

void lw_trace_positions_free(struct lw_trace_positions *positions, const struct lw_scene *scene) {
    for (uint32_t m = 0; positions && m < scene->mesh_count; m++) {
        free(positions[m].triangle);
        free(positions[m].vertex);
    }
    free(positions);
}
