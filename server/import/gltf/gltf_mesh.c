#include "server/import/gltf/gltf_mesh.h"

#include "server/import/gltf/gltf_accessor.h"
#include "server/import/gltf/gltf_draco.h"

#include <stdio.h>
#include <stdlib.h>
#include <string.h>

/* Vertex colours outside of this are wrong, not rounded. */
#define COLOUR_MIN (-1e-3f)
#define COLOUR_MAX 1.001f

enum { MODE_TRIANGLES = 4, MODE_STRIP = 5, MODE_FAN = 6 };

/* A primitive with its accessors open; count 0: absent. */
struct primitive {
    struct lw_gltf_accessor position, normal, uv[2], colour, tangent, indices;
    uint32_t material; /* the scene's */
    uint64_t mode;
    uint32_t corner_count; /* indices, or vertices if there are none */
    const json_t *draco;   /* KHR_draco_mesh_compression, or NULL */
    struct lw_draco_mesh *draco_mesh;
    struct lw_gltf_shape shape;
};

void lw_gltf_meshes_init(struct lw_gltf_meshes *meshes, struct lw_gltf_materials *materials) {
    *meshes = (struct lw_gltf_meshes){.materials = materials};
    lw_mesh_builder_init(&meshes->builder);
}

void lw_gltf_meshes_finish(struct lw_gltf_meshes *meshes) {
    free(meshes->kept);
    lw_mesh_builder_finish(&meshes->builder);
    *meshes = (struct lw_gltf_meshes){0};
}

/* ---- opening a primitive ---- */

static enum lw_status open_attribute(struct lw_gltf_meshes *meshes, const json_t *attributes, const char *key,
                                     unsigned components_min, unsigned components_max, unsigned accept,
                                     struct lw_gltf_accessor *out, struct lw_error *err) {
    const struct lw_gltf_document *document = meshes->materials->document;
    uint32_t index = LW_SCENE_NONE;
    if (!lw_gltf_document_index(document, attributes, key, LW_GLTF_ACCESSORS, &index, err) &&
        index != LW_SCENE_NONE &&
        lw_gltf_accessor_open(document, index, components_min, components_max, accept, out, err))
        lw_status_context(err, "%s", key);
    return err->status;
}

static enum lw_status open_attributes(struct lw_gltf_meshes *meshes, const json_t *attributes,
                                      struct primitive *p, struct lw_error *err) {
    bool quantized = meshes->materials->document->quantized;
    const unsigned more = p->draco ? LW_GLTF_ACCEPT_UNBACKED : 0;
    const unsigned real = LW_GLTF_ACCEPT_FLOAT | more, any = LW_GLTF_ACCEPT_ANY | more;
    const unsigned normalized = real | LW_GLTF_ACCEPT_NORMALIZED_UNSIGNED;
    if (lw_gltf_json_require(attributes, "POSITION", err) ||
        open_attribute(meshes, attributes, "POSITION", 3, 3, quantized ? any : real, &p->position, err) ||
        open_attribute(meshes, attributes, "NORMAL", 3, 3,
                       quantized ? real | LW_GLTF_ACCEPT_NORMALIZED_SIGNED : real, &p->normal, err) ||
        open_attribute(meshes, attributes, "TEXCOORD_0", 2, 2, quantized ? any : normalized, &p->uv[0],
                       err) ||
        open_attribute(meshes, attributes, "TEXCOORD_1", 2, 2, quantized ? any : normalized, &p->uv[1],
                       err) ||
        open_attribute(meshes, attributes, "COLOR_0", 3, 4, normalized, &p->colour, err))
        return err->status;
    const struct lw_gltf_accessor *rest[] = {&p->normal, &p->uv[0], &p->uv[1], &p->colour};
    for (int i = 0; i < 4; i++)
        if (rest[i]->count && rest[i]->count != p->position.count)
            return lw_status_fail(err, LW_BAD_DATA, "accessor %u has %u elements, POSITION has %u",
                                  rest[i]->index, rest[i]->count, p->position.count);
    return LW_OK;
}

static enum lw_status open_indices(const struct lw_gltf_document *document, const json_t *object,
                                   struct primitive *p, struct lw_error *err) {
    uint32_t index = LW_SCENE_NONE;
    if (lw_gltf_document_index(document, object, "indices", LW_GLTF_ACCESSORS, &index, err))
        return err->status;
    p->corner_count = p->position.count;
    if (index == LW_SCENE_NONE) return LW_OK;
    if (lw_gltf_accessor_open(document, index, 1, 1,
                              LW_GLTF_ACCEPT_INDEX | (p->draco ? LW_GLTF_ACCEPT_UNBACKED : 0), &p->indices,
                              err)) {
        lw_status_context(err, "indices");
        return err->status;
    }
    p->corner_count = p->indices.count;
    return LW_OK;
}

/* Takes the bytes of accessors from the primitive's Draco stream. */
static enum lw_status read_draco(const struct lw_gltf_document *document, struct primitive *p,
                                 struct lw_error *err) {
    if (!p->draco) return LW_OK;
    if (!p->indices.count || p->mode != MODE_TRIANGLES)
        lw_status_fail(err, LW_BAD_DATA, "asks for indices and mode 4");
    else if (!lw_gltf_draco_open(document, p->draco, &p->position, &p->indices, &p->draco_mesh, err) &&
             !lw_gltf_draco_attribute(p->draco, p->draco_mesh, "POSITION", &p->position, err) &&
             !lw_gltf_draco_attribute(p->draco, p->draco_mesh, "NORMAL", &p->normal, err) &&
             !lw_gltf_draco_attribute(p->draco, p->draco_mesh, "TEXCOORD_0", &p->uv[0], err) &&
             !lw_gltf_draco_attribute(p->draco, p->draco_mesh, "TEXCOORD_1", &p->uv[1], err) &&
             !lw_gltf_draco_attribute(p->draco, p->draco_mesh, "COLOR_0", &p->colour, err))
        p->corner_count = p->indices.count;
    if (err->status) lw_status_context(err, "KHR_draco_mesh_compression");
    return err->status;
}

static void warn_about(struct lw_gltf_meshes *meshes, const struct primitive *p) {
    struct lw_gltf_document *document = meshes->materials->document;
    const struct lw_material *material = &meshes->materials->scene->material[p->material];
    const struct lw_finish *f = material->finish;
    const struct lw_texture_use *uses[] = {&material->base_colour_texture, &material->emission_texture,
                                           f ? &f->surface_texture : NULL, f ? &f->specular_texture : NULL,
                                           f ? &f->normal_texture : NULL};
    for (size_t i = 0; i < sizeof uses / sizeof *uses; i++)
        if (uses[i] && uses[i]->texture != LW_SCENE_NONE && !p->uv[uses[i]->uv_set].count)
            lw_gltf_document_warn(document, LW_GLTF_WARN_UV_MISSING);
}

/* Without normals those of the file do not count, as glTF has it. */
static enum lw_status open_tangents(struct lw_gltf_meshes *meshes, const json_t *attributes,
                                    struct primitive *p, struct lw_error *err) {
    const struct lw_finish *finish = meshes->materials->scene->material[p->material].finish;
    const unsigned accept =
        LW_GLTF_ACCEPT_FLOAT | LW_GLTF_ACCEPT_NORMALIZED_SIGNED | (p->draco ? LW_GLTF_ACCEPT_UNBACKED : 0);
    if (!finish || finish->normal_texture.texture == LW_SCENE_NONE || !p->normal.count) return LW_OK;
    if (!open_attribute(meshes, attributes, "TANGENT", 4, 4, accept, &p->tangent, err) &&
        !(p->draco_mesh && p->tangent.count &&
          lw_gltf_draco_attribute(p->draco, p->draco_mesh, "TANGENT", &p->tangent, err)) &&
        p->tangent.count && p->tangent.count != p->position.count)
        lw_status_fail(err, LW_BAD_DATA, "TANGENT: accessor %u has %u elements, POSITION has %u",
                       p->tangent.index, p->tangent.count, p->position.count);
    if (err->status) lw_status_context(err, "attributes");
    return err->status;
}

static enum lw_status open_primitive(struct lw_gltf_meshes *meshes, const json_t *object, struct primitive *p,
                                     struct lw_error *err) {
    const struct lw_gltf_document *document = meshes->materials->document;
    const json_t *attributes = NULL;
    uint32_t material = LW_SCENE_NONE;
    if (lw_gltf_json_require(object, "attributes", err) ||
        lw_gltf_json_object(object, "attributes", &attributes, err) ||
        lw_gltf_json_extension(object, "KHR_draco_mesh_compression", &p->draco, err) ||
        lw_gltf_document_index(document, object, "material", LW_GLTF_MATERIALS, &material, err))
        return err->status;
    if (open_attributes(meshes, attributes, p, err)) {
        lw_status_context(err, "attributes");
        return err->status;
    }
    if (open_indices(document, object, p, err) || read_draco(document, p, err) ||
        lw_gltf_materials_get(meshes->materials, material, &p->material, err) ||
        open_tangents(meshes, attributes, p, err))
        return err->status;
    warn_about(meshes, p);
    return LW_OK;
}

/* ---- vertices ---- */

static enum lw_status read_finite(const struct lw_gltf_accessor *accessor, const char *name, uint32_t i,
                                  float out[4], struct lw_error *err) {
    lw_gltf_accessor_read(accessor, i, out);
    for (unsigned c = 0; c < accessor->components; c++)
        if (!isfinite(out[c]))
            return lw_status_fail(err, LW_BAD_DATA,
                                  "attributes.%s: accessor %u: element %u is not a finite number", name,
                                  accessor->index, i);
    return LW_OK;
}

static enum lw_status read_position(const struct primitive *p, uint32_t i, struct lw_vec3 *out,
                                    struct lw_error *err) {
    float v[4];
    if (read_finite(&p->position, "POSITION", i, v, err)) return err->status;
    for (int c = 0; c < 3; c++)
        if (fabsf(v[c]) > LW_SCENE_COORDINATE_MAX)
            return lw_status_fail(err, LW_BAD_DATA,
                                  "attributes.POSITION: accessor %u: element %u is farther than %g m",
                                  p->position.index, i, (double)LW_SCENE_COORDINATE_MAX);
    *out = lw_vec3(v[0], v[1], v[2]);
    if (lw_gltf_shape_position(&p->shape, i, out, err)) return err->status;
    if (lw_vec3_max_abs(*out) > LW_SCENE_COORDINATE_MAX)
        return lw_status_fail(err, LW_BAD_DATA,
                              "vertex %u is moved farther than %g m by its targets and skin", i,
                              (double)LW_SCENE_COORDINATE_MAX);
    return LW_OK;
}

static float clamp_unit(float v) { return v < 0 ? 0 : v > 1 ? 1 : v; }

/* A moved shape's tangent is none: it is made again at the new place. Wrong tangents are reported later. */
static struct lw_vec4 read_tangent(const struct primitive *p, uint32_t i) {
    float t[4];
    if (!p->tangent.count || p->shape.skin || p->shape.morph_count) return (struct lw_vec4){0, 0, 0, 0};
    lw_gltf_accessor_read(&p->tangent, i, t);
    return (struct lw_vec4){t[0], t[1], t[2], t[3] == 0 ? NAN : t[3]};
}

static enum lw_status read_vertex(struct lw_gltf_meshes *meshes, const struct primitive *p, uint32_t i,
                                  struct lw_mesh_builder_vertex *out, struct lw_error *err) {
    static const char *const uv_name[2] = {"TEXCOORD_0", "TEXCOORD_1"};
    float v[4] = {0};
    *out = (struct lw_mesh_builder_vertex){.colour = {1, 1, 1, 1}};
    if (read_position(p, i, &out->position, err)) return err->status;
    if (p->normal.count) {
        if (read_finite(&p->normal, "NORMAL", i, v, err)) return err->status;
        struct lw_vec3 moved = lw_vec3(v[0], v[1], v[2]);
        if (lw_gltf_shape_normal(&p->shape, i, &moved, err)) return err->status;
        v[0] = moved.x, v[1] = moved.y, v[2] = moved.z;
        double length =
            sqrt((double)v[0] * (double)v[0] + (double)v[1] * (double)v[1] + (double)v[2] * (double)v[2]);
        if (length > 1e-20)
            out->normal = lw_vec3((float)((double)v[0] / length), (float)((double)v[1] / length),
                                  (float)((double)v[2] / length));
    }
    for (int set = 0; set < 2; set++) {
        if (!p->uv[set].count) continue;
        if (read_finite(&p->uv[set], uv_name[set], i, v, err)) return err->status;
        out->uv[set] = (struct lw_vec2){v[0], v[1]};
    }
    out->tangent = read_tangent(p, i);
    if (p->colour.count) {
        v[3] = 1;
        if (read_finite(&p->colour, "COLOR_0", i, v, err)) return err->status;
        if (v[0] < COLOUR_MIN || v[1] < COLOUR_MIN || v[2] < COLOUR_MIN || v[3] < COLOUR_MIN)
            return lw_status_fail(err, LW_BAD_DATA, "attributes.COLOR_0: accessor %u: element %u is negative",
                                  p->colour.index, i);
        if (v[0] > COLOUR_MAX || v[1] > COLOUR_MAX || v[2] > COLOUR_MAX || v[3] > COLOUR_MAX)
            meshes->is_bright = true;
        out->colour =
            (struct lw_vec4){clamp_unit(v[0]), clamp_unit(v[1]), clamp_unit(v[2]), clamp_unit(v[3])};
    }
    return LW_OK;
}

/* Adds vertex i of the primitive, or finds where it went. */
static enum lw_status keep_vertex(struct lw_gltf_meshes *meshes, const struct primitive *p, uint32_t i,
                                  bool alone, uint32_t *out, struct lw_error *err) {
    struct lw_gltf_kept *kept = &meshes->kept[i];
    if (!alone && kept->stamp == meshes->stamp) {
        *out = kept->vertex;
        return LW_OK;
    }
    struct lw_mesh_builder_vertex vertex;
    if (read_vertex(meshes, p, i, &vertex, err) ||
        lw_mesh_builder_vertex(&meshes->builder, &vertex, &kept->vertex, err))
        return err->status;
    kept->stamp = meshes->stamp;
    *out = kept->vertex;
    return LW_OK;
}

/* ---- triangles ---- */

/* Index into the list of corners: glTF 2.0, 3.7.2.1, which keeps the winding of strips and fans. */
static uint32_t corner(uint64_t mode, uint32_t triangle, unsigned k) {
    if (mode == MODE_STRIP) return triangle + (k == 0 ? 0 : k == 1 ? 1 + triangle % 2 : 2 - triangle % 2);
    if (mode == MODE_FAN) return k == 2 ? 0 : triangle + k + 1;
    return 3 * triangle + k;
}

static enum lw_status add_triangle(struct lw_gltf_meshes *meshes, const struct primitive *p,
                                   uint32_t triangle, struct lw_error *err) {
    uint32_t index[3], vertex[3];
    struct lw_vec3 position[3], normal;
    for (unsigned k = 0; k < 3; k++) {
        index[k] = corner(p->mode, triangle, k);
        if (p->indices.count) index[k] = lw_gltf_accessor_integer(&p->indices, index[k]);
        if (index[k] >= p->position.count)
            return lw_status_fail(
                err, LW_BAD_DATA,
                "indices: accessor %u: triangle %u uses vertex %u, POSITION has %u vertices",
                p->indices.index, triangle, index[k], p->position.count);
    }
    if (lw_gltf_shape_mirrors(&p->shape, index[0])) {
        const uint32_t second = index[1];
        index[1] = index[2], index[2] = second;
    }
    for (unsigned k = 0; k < 3; k++)
        if (read_position(p, index[k], &position[k], err)) return err->status;
    if (!lw_mesh_builder_normal(position, &normal)) {
        meshes->builder.degenerate_count++;
        return LW_OK;
    }
    bool flat = !p->normal.count; /* then glTF asks for flat normals: vertices are split */
    for (unsigned k = 0; k < 3; k++)
        if (keep_vertex(meshes, p, index[k], flat, &vertex[k], err)) return err->status;
    return lw_mesh_builder_triangle(&meshes->builder, vertex, p->material, normal, err);
}

static enum lw_status reserve_primitive(struct lw_gltf_meshes *meshes, const struct primitive *p,
                                        struct lw_error *err) {
    size_t before = meshes->kept_capacity;
    if (!lw_mesh_builder_reserve((void **)&meshes->kept, &meshes->kept_capacity, p->position.count,
                                 sizeof *meshes->kept))
        return lw_status_fail(err, LW_NO_MEMORY, "out of memory for %u vertices", p->position.count);
    /* stamps, instead of clearing the whole map for each primitive that shares a large buffer */
    memset(meshes->kept + before, 0, (meshes->kept_capacity - before) * sizeof *meshes->kept);
    meshes->stamp++;
    return LW_OK;
}

static enum lw_status add_triangles(struct lw_gltf_meshes *meshes, const struct primitive *p,
                                    struct lw_error *err) {
    if (p->corner_count < 3 || (p->mode == MODE_TRIANGLES && p->corner_count % 3))
        return lw_status_fail(err, LW_BAD_DATA, "%u indices do not make whole triangles", p->corner_count);
    uint32_t triangles = p->mode == MODE_TRIANGLES ? p->corner_count / 3 : p->corner_count - 2;
    meshes->triangle_total += triangles;
    if (meshes->triangle_total > LW_SCENE_TRIANGLES_MAX)
        return lw_status_fail(err, LW_BAD_DATA, "the meshes together have more than %u triangles",
                              LW_SCENE_TRIANGLES_MAX);
    if (reserve_primitive(meshes, p, err)) return err->status;
    for (uint32_t t = 0; t < triangles; t++)
        if (add_triangle(meshes, p, t, err)) return err->status;
    for (int set = 0; set < 2; set++) meshes->builder.has_uv[set] |= p->uv[set].count > 0;
    meshes->builder.has_colour |= p->colour.count > 0;
    meshes->builder.has_tangent |= p->tangent.count > 0;
    return LW_OK;
}

static enum lw_status add_primitive(struct lw_gltf_meshes *meshes, const json_t *mesh, const json_t *object,
                                    const struct lw_gltf_look *look, struct lw_error *err) {
    struct primitive p = {.mode = MODE_TRIANGLES};
    if (lw_gltf_json_integer(object, "mode", 0, MODE_FAN, &p.mode, err)) return err->status;
    if (p.mode < MODE_TRIANGLES) {
        lw_gltf_document_warn(meshes->materials->document, LW_GLTF_WARN_POINTS);
        return LW_OK;
    }
    enum lw_status status = open_primitive(meshes, object, &p, err);
    if (status == LW_OK)
        status = lw_gltf_shape_init(&p.shape, meshes->materials->document, mesh, object, look,
                                    p.position.count, err);
    if (status == LW_OK) status = add_triangles(meshes, &p, err);
    lw_gltf_shape_finish(&p.shape);
    lw_draco_mesh_destroy(p.draco_mesh);
    return status;
}

/* ---- the mesh ---- */

static enum lw_status convert(struct lw_gltf_meshes *meshes, const json_t *object,
                              const struct lw_gltf_look *look, struct lw_mesh *out, struct lw_error *err) {
    const json_t *primitives = NULL, *primitive;
    const char *name = "";
    size_t i;
    lw_mesh_builder_begin(&meshes->builder);
    if (lw_gltf_json_string(object, "name", &name, err) || lw_gltf_json_require(object, "primitives", err) ||
        lw_gltf_json_array(object, "primitives", &primitives, err))
        return err->status;
    meshes->is_bright = false;
    json_array_foreach(primitives, i, primitive) {
        if (!json_is_object(primitive))
            return lw_status_fail(err, LW_BAD_DATA, "primitives[%zu]: must be an object", i);
        if (add_primitive(meshes, object, primitive, look, err)) {
            lw_status_context(err, "primitives[%zu]", i);
            return err->status;
        }
    }
    if (meshes->builder.triangle_count == 0) {
        *out = (struct lw_mesh){0};
        return LW_OK;
    }
    return lw_mesh_builder_end(&meshes->builder, meshes->materials->scene, name, out, err);
}

enum lw_status lw_gltf_meshes_convert(struct lw_gltf_meshes *meshes, uint32_t index,
                                      const struct lw_gltf_look *look, struct lw_mesh *out,
                                      struct lw_error *err) {
    if (convert(meshes, lw_gltf_document_item(meshes->materials->document, LW_GLTF_MESHES, index), look, out,
                err))
        lw_status_context(err, "meshes[%u]", index);
    if (meshes->is_bright) {
        char name[160];
        snprintf(name, sizeof name, "meshes[%u] %s", index, out->name ? out->name : "");
        lw_tally_add(&meshes->bright, name);
    }
    return err->status;
}
