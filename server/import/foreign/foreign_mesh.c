#include "server/import/foreign/foreign_mesh.h"

#include "common/base/colour.h"
#include "server/import/mesh/mesh_sides.h"

#include <stdlib.h>
#include <string.h>
#include <xxhash.h>

#define TABLE_SIZE_MIN 1024u

/* Vertex colours outside of this are wrong, not rounded. */
#define COLOUR_ROUNDING 1e-3f
#define COLOUR_MIN      (-COLOUR_ROUNDING)
#define COLOUR_MAX      (1 + COLOUR_ROUNDING)

void lw_foreign_meshes_init(struct lw_foreign_meshes *meshes, struct lw_foreign_materials *materials) {
    *meshes = (struct lw_foreign_meshes){.materials = materials};
    lw_mesh_builder_init(&meshes->builder);
}

void lw_foreign_meshes_finish(struct lw_foreign_meshes *meshes) {
    free(meshes->coloured);
    free(meshes->table);
    lw_mesh_builder_finish(&meshes->builder);
    *meshes = (struct lw_foreign_meshes){0};
}

/* ---- checks ---- */

static bool is_finite(const struct aiVector3D *v) {
    return isfinite(v->x) && isfinite(v->y) && isfinite(v->z);
}

static enum lw_status check_mesh(struct lw_foreign_import *import, const struct aiMesh *mesh,
                                 uint64_t *face_count, struct lw_error *err) {
    if (mesh->mNumVertices && !mesh->mVertices) return lw_status_fail(err, LW_BAD_DATA, "has no positions");
    for (unsigned i = 0; i < mesh->mNumVertices; i++) {
        const struct aiVector3D *p = &mesh->mVertices[i];
        if (!is_finite(p))
            return lw_status_fail(err, LW_BAD_DATA, "the position of vertex %u is not a finite number", i);
        if (fabsf(p->x) > LW_SCENE_COORDINATE_MAX || fabsf(p->y) > LW_SCENE_COORDINATE_MAX ||
            fabsf(p->z) > LW_SCENE_COORDINATE_MAX)
            return lw_status_fail(err, LW_BAD_DATA, "vertex %u is farther than %g m", i,
                                  (double)LW_SCENE_COORDINATE_MAX);
    }
    for (unsigned f = 0; f < mesh->mNumFaces; f++) {
        const struct aiFace *face = &mesh->mFaces[f];
        for (unsigned k = 0; k < face->mNumIndices; k++)
            if (face->mIndices[k] >= mesh->mNumVertices)
                return lw_status_fail(err, LW_BAD_DATA, "face %u uses vertex %u; it has %u vertices", f,
                                      face->mIndices[k], mesh->mNumVertices);
        if (face->mNumIndices == 0) return lw_status_fail(err, LW_BAD_DATA, "face %u has no vertices", f);
        if (face->mNumIndices < 3) lw_foreign_import_warn(import, LW_FOREIGN_WARN_POINTS);
        *face_count += face->mNumIndices >= 3;
    }
    return LW_OK;
}

static void name_mesh(const struct aiScene *ai, unsigned index, struct lw_error *err) {
    lw_status_context(err, "mesh %u \"%.80s\"", index, ai->mMeshes[index]->mName.data);
}

enum lw_status lw_foreign_meshes_check(struct lw_foreign_import *import, struct lw_error *err) {
    const struct aiScene *ai = import->ai;
    uint64_t face_count = 0;
    for (unsigned m = 0; m < ai->mNumMeshes; m++)
        if (check_mesh(import, ai->mMeshes[m], &face_count, err)) {
            name_mesh(ai, m, err);
            return err->status;
        }
    if (face_count == 0) /* Assimp's post-processing crashes on a scene of points */
        return lw_status_fail(err, LW_BAD_DATA, "has no triangles: there is nothing to light");
    return LW_OK;
}

/* ---- vertices ---- */

static struct lw_vec3 unit_or_none(const struct aiVector3D *n) {
    double length =
        sqrt((double)n->x * (double)n->x + (double)n->y * (double)n->y + (double)n->z * (double)n->z);
    if (!(length > 1e-20) || !isfinite(length)) return lw_vec3(0, 0, 0);
    return lw_vec3((float)((double)n->x / length), (float)((double)n->y / length),
                   (float)((double)n->z / length));
}

/* Assimp's colour for facets of an STL without a colour beside facets with one. A colour of the file
 * is a multiple of 1/31. */
static bool is_stl_default(const struct lw_foreign_import *import, const struct aiColor4D *c) {
    const float grey = 0.6f;
    return import->desc->format == LW_SCENE_FORMAT_STL && c->r == grey && c->g == grey && c->b == grey;
}

/* Colours on vertices are what a screen shows, in all of these formats. */
static enum lw_status read_colour(struct lw_foreign_meshes *meshes, const struct aiColor4D *c, unsigned i,
                                  struct lw_vec4 *out, struct lw_error *err) {
    const float in[3] = {c->r, c->g, c->b};
    float linear[3];
    if (is_stl_default(meshes->materials->import, c)) {
        *out = (struct lw_vec4){c->r, c->g, c->b, 1};
        return LW_OK;
    }
    for (int k = 0; k < 3; k++) {
        if (!isfinite(in[k]) || in[k] < COLOUR_MIN)
            return lw_status_fail(err, LW_BAD_DATA, "the colour of vertex %u is (%g, %g, %g)", i,
                                  (double)in[0], (double)in[1], (double)in[2]);
        meshes->is_bright |= in[k] > COLOUR_MAX;
        linear[k] = lw_colour_from_srgb(fminf(fmaxf(in[k], 0), 1));
    }
    if (c->a < 1 - COLOUR_ROUNDING)
        lw_foreign_import_warn(meshes->materials->import, LW_FOREIGN_WARN_VERTEX_ALPHA);
    *out = (struct lw_vec4){linear[0], linear[1], linear[2], 1};
    return LW_OK;
}

static enum lw_status read_vertex(struct lw_foreign_meshes *meshes, const struct aiMesh *mesh, unsigned i,
                                  struct lw_mesh_builder_vertex *out, struct lw_error *err) {
    const struct aiVector3D *p = &mesh->mVertices[i];
    *out = (struct lw_mesh_builder_vertex){.position = lw_vec3(p->x, p->y, p->z), .colour = {1, 1, 1, 1}};
    if (mesh->mNormals) out->normal = unit_or_none(&mesh->mNormals[i]);
    for (int set = 0; set < 2; set++) {
        const struct aiVector3D *uv = mesh->mTextureCoords[set];
        if (!uv) continue;
        if (!isfinite(uv[i].x) || !isfinite(uv[i].y))
            return lw_status_fail(err, LW_BAD_DATA,
                                  "the texture coordinates of vertex %u are not finite numbers", i);
        out->uv[set] = (struct lw_vec2){uv[i].x, 1 - uv[i].y}; /* v = 0 is at the bottom there, on top here */
    }
    return mesh->mColors[0] ? read_colour(meshes, &mesh->mColors[0][i], i, &out->colour, err) : LW_OK;
}

static size_t slot_of(const struct lw_foreign_meshes *meshes, const struct lw_mesh_builder_vertex *vertex) {
    size_t mask = meshes->table_size - 1, slot = XXH3_64bits(vertex, sizeof *vertex) & mask;
    while (meshes->table[slot] != LW_SCENE_NONE &&
           memcmp(&meshes->builder.vertex[meshes->table[slot]], vertex, sizeof *vertex) != 0)
        slot = (slot + 1) & mask;
    return slot;
}

static enum lw_status grow_table(struct lw_foreign_meshes *meshes, size_t size, struct lw_error *err) {
    uint32_t *table = malloc(size * sizeof *table);
    if (!table) return lw_status_fail(err, LW_NO_MEMORY, "out of memory for vertices");
    free(meshes->table);
    meshes->table = table;
    meshes->table_size = size;
    memset(table, 0xff, size * sizeof *table);
    for (uint32_t i = 0; i < meshes->builder.vertex_count; i++)
        table[slot_of(meshes, &meshes->builder.vertex[i])] = i;
    return LW_OK;
}

/* The vertex, or the equal one that is there. All of its members are floats, so equal bytes are equal
 * vertices. */
static enum lw_status share_vertex(struct lw_foreign_meshes *meshes,
                                   const struct lw_mesh_builder_vertex *vertex, uint32_t *out,
                                   struct lw_error *err) {
    if (2 * (meshes->builder.vertex_count + 1ul) > meshes->table_size &&
        grow_table(meshes, 2 * meshes->table_size, err))
        return err->status;
    uint32_t *slot = &meshes->table[slot_of(meshes, vertex)];
    if (*slot == LW_SCENE_NONE && lw_mesh_builder_vertex(&meshes->builder, vertex, slot, err))
        return err->status;
    *out = *slot;
    return LW_OK;
}

/* ---- triangles ---- */

static bool faces_away(const struct lw_mesh_builder_vertex corner[3], struct lw_vec3 normal) {
    for (int k = 0; k < 3; k++)
        if (!(lw_vec3_dot(corner[k].normal, normal) < 0)) return false;
    return true;
}

static enum lw_status add_face(struct lw_foreign_meshes *meshes, const struct aiMesh *mesh,
                               const struct aiFace *face, struct lw_error *err) {
    struct lw_mesh_builder_vertex corner[3];
    struct lw_vec3 normal;
    uint32_t vertex[3];
    for (int k = 0; k < 3; k++)
        if (read_vertex(meshes, mesh, face->mIndices[k], &corner[k], err)) return err->status;
    if (!lw_mesh_builder_normal(
            (const struct lw_vec3[]){corner[0].position, corner[1].position, corner[2].position}, &normal)) {
        meshes->builder.degenerate_count++;
        return LW_OK;
    }
    if (faces_away(corner, normal)) { /* exporters that mirror forget the winding, not the normals */
        struct lw_mesh_builder_vertex second = corner[1];
        corner[1] = corner[2];
        corner[2] = second;
        normal = lw_vec3_scale(normal, -1);
        meshes->turned_count++;
    }
    for (int k = 0; k < 3; k++) {
        if (lw_vec3_dot(corner[k].normal, corner[k].normal) == 0) corner[k].normal = normal;
        if (share_vertex(meshes, &corner[k], &vertex[k], err)) return err->status;
    }
    if (!lw_mesh_builder_reserve((void **)&meshes->coloured, &meshes->coloured_capacity,
                                 meshes->builder.triangle_count + 1ul, 1))
        return lw_status_fail(err, LW_NO_MEMORY, "out of memory for triangles");
    meshes->coloured[meshes->builder.triangle_count] = mesh->mColors[0] != NULL;
    return lw_mesh_builder_triangle(&meshes->builder, vertex, mesh->mMaterialIndex, normal, err);
}

static enum lw_status add_mesh(struct lw_foreign_meshes *meshes, const struct aiMesh *mesh,
                               struct lw_error *err) {
    if (mesh->mNumBones) lw_foreign_import_warn(meshes->materials->import, LW_FOREIGN_WARN_SKIN);
    if (mesh->mNumAnimMeshes) lw_foreign_import_warn(meshes->materials->import, LW_FOREIGN_WARN_MORPH);
    meshes->triangle_total += mesh->mNumFaces;
    if (meshes->triangle_total > LW_SCENE_TRIANGLES_MAX)
        return lw_status_fail(err, LW_BAD_DATA, "the meshes together have more than %u triangles",
                              LW_SCENE_TRIANGLES_MAX);
    uint32_t before = meshes->builder.triangle_count;
    for (unsigned f = 0; f < mesh->mNumFaces; f++)
        if (mesh->mFaces[f].mNumIndices == 3 && add_face(meshes, mesh, &mesh->mFaces[f], err))
            return err->status;
    if (meshes->builder.triangle_count == before) return LW_OK;
    for (int set = 0; set < 2; set++) meshes->builder.has_uv[set] |= mesh->mTextureCoords[set] != NULL;
    meshes->builder.has_colour |= mesh->mColors[0] != NULL;
    return LW_OK;
}

static void warn_about_uv(struct lw_foreign_meshes *meshes, const struct lw_material *material) {
    const struct lw_finish *f = material->finish;
    const struct lw_texture_use *uses[] = {&material->base_colour_texture, &material->emission_texture,
                                           f ? &f->surface_texture : NULL, f ? &f->normal_texture : NULL};
    for (size_t i = 0; i < sizeof uses / sizeof *uses; i++)
        if (uses[i] && uses[i]->texture != LW_SCENE_NONE && !meshes->builder.has_uv[uses[i]->uv_set])
            lw_foreign_import_warn(meshes->materials->import, LW_FOREIGN_WARN_UV_MISSING);
}

/* So far triangles have the file's materials: now that the surface is whole, they get the scene's. */
static enum lw_status choose_materials(struct lw_foreign_meshes *meshes, const uint8_t *closed,
                                       struct lw_error *err) {
    struct lw_mesh_builder *builder = &meshes->builder;
    uint32_t previous = LW_SCENE_NONE;
    for (uint32_t t = 0; t < builder->triangle_count; t++) {
        const struct lw_foreign_surface surface = {.closed = closed[t], .coloured = meshes->coloured[t]};
        if (lw_foreign_materials_get(meshes->materials, builder->material[t], surface, &builder->material[t],
                                     err))
            return err->status;
        if (builder->material[t] == previous) continue;
        previous = builder->material[t];
        warn_about_uv(meshes, &meshes->materials->import->scene->material[previous]);
    }
    return LW_OK;
}

static enum lw_status end_mesh(struct lw_foreign_meshes *meshes, const struct aiString *name,
                               struct lw_mesh *out, struct lw_error *err) {
    uint8_t *closed = malloc(meshes->builder.triangle_count + 1ul);
    if (!closed) return lw_status_fail(err, LW_NO_MEMORY, "out of memory for triangles");
    if (!lw_mesh_sides_find(&meshes->builder, closed, err)) (void)choose_materials(meshes, closed, err);
    free(closed);
    if (err->status) return err->status;
    const char *text = lw_foreign_import_text(meshes->materials->import, name);
    if (!text) return lw_status_fail(err, LW_NO_MEMORY, "out of memory for meshes");
    return lw_mesh_builder_end(&meshes->builder, meshes->materials->import->scene, text, out, err);
}

enum lw_status lw_foreign_meshes_convert(struct lw_foreign_meshes *meshes, const unsigned *index,
                                         unsigned count, struct lw_mesh *out, struct lw_error *err) {
    const struct aiScene *ai = meshes->materials->import->ai;
    lw_mesh_builder_begin(&meshes->builder);
    if (grow_table(meshes, TABLE_SIZE_MIN, err)) return err->status;
    meshes->is_bright = false;
    *out = (struct lw_mesh){0};
    for (unsigned i = 0; i < count; i++) {
        if (index[i] >= ai->mNumMeshes)
            return lw_status_fail(err, LW_BAD_DATA, "a node names mesh %u of %u", index[i], ai->mNumMeshes);
        if (add_mesh(meshes, ai->mMeshes[index[i]], err)) {
            name_mesh(ai, index[i], err);
            return err->status;
        }
    }
    if (meshes->builder.triangle_count == 0) return LW_OK;
    const struct aiString *name = &ai->mMeshes[index[0]]->mName;
    if (meshes->is_bright) lw_tally_add(&meshes->bright, name->data);
    if (end_mesh(meshes, name, out, err)) name_mesh(ai, index[0], err);
    return err->status;
}
