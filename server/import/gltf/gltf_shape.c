#include "server/import/gltf/gltf_shape.h"

#include <stdio.h>
#include <stdlib.h>

/* ---- opening ---- */

static enum lw_status open_accessor(const struct lw_gltf_document *document, const json_t *attributes,
                                    const char *key, unsigned components, unsigned accept, uint32_t count,
                                    struct lw_gltf_accessor *out, struct lw_error *err) {
    uint32_t index = LW_SCENE_NONE;
    if (lw_gltf_document_index(document, attributes, key, LW_GLTF_ACCESSORS, &index, err) ||
        index == LW_SCENE_NONE)
        return err->status;
    if (!lw_gltf_accessor_open(document, index, components, components, accept, out, err) &&
        out->count != count)
        lw_status_fail(err, LW_BAD_DATA, "accessor %u has %u elements, POSITION has %u", index, out->count,
                       count);
    if (err->status) lw_status_context(err, "%s", key);
    return err->status;
}

static enum lw_status open_morph(struct lw_gltf_shape *shape, const struct lw_gltf_document *document,
                                 const json_t *target, float weight, uint32_t count, struct lw_error *err) {
    const unsigned plain = LW_GLTF_ACCEPT_FLOAT,
                   quantized = plain | LW_GLTF_ACCEPT_SIGNED | LW_GLTF_ACCEPT_NORMALIZED_SIGNED;
    const unsigned accept = document->quantized ? quantized : plain;
    struct lw_gltf_morph *morph = &shape->morph[shape->morph_count];
    *morph = (struct lw_gltf_morph){.weight = weight};
    if (!json_is_object(target)) return lw_status_fail(err, LW_BAD_DATA, "must be an object");
    if (open_accessor(document, target, "POSITION", 3, accept, count, &morph->position, err) ||
        open_accessor(document, target, "NORMAL", 3, accept, count, &morph->normal, err))
        return err->status;
    shape->morph_count++;
    return LW_OK;
}

static enum lw_status read_weight(const json_t *weights, size_t i, float *out, struct lw_error *err) {
    const json_t *value = json_array_get(weights, i);
    const double real = json_number_value(value);
    *out = 0;
    if (!value) return LW_OK;
    if (!json_is_number(value) || !(fabs(real) <= (double)LW_SCENE_COORDINATE_MAX))
        return lw_status_fail(err, LW_BAD_DATA, "weights[%zu]: must be a number, at most %g", i,
                              (double)LW_SCENE_COORDINATE_MAX);
    *out = (float)real;
    return LW_OK;
}

static enum lw_status open_morphs(struct lw_gltf_shape *shape, const struct lw_gltf_document *document,
                                  const json_t *mesh, const json_t *primitive, const json_t *weights,
                                  uint32_t count, struct lw_error *err) {
    const json_t *targets = NULL, *target;
    size_t i;
    if ((!weights && lw_gltf_json_array(mesh, "weights", &weights, err)) ||
        lw_gltf_json_array(primitive, "targets", &targets, err))
        return err->status;
    if (!json_array_size(targets) || !json_array_size(weights)) return LW_OK;
    shape->morph = calloc(json_array_size(targets), sizeof *shape->morph);
    if (!shape->morph) return lw_status_fail(err, LW_NO_MEMORY, "out of memory for morph targets");
    json_array_foreach(targets, i, target) {
        float weight;
        if (read_weight(weights, i, &weight, err)) return err->status;
        if (weight != 0 && open_morph(shape, document, target, weight, count, err)) {
            lw_status_context(err, "targets[%zu]", i);
            return err->status;
        }
    }
    return LW_OK;
}

static enum lw_status open_skin(struct lw_gltf_shape *shape, const struct lw_gltf_document *document,
                                const json_t *primitive, const struct lw_gltf_skin *skin, uint32_t count,
                                struct lw_error *err) {
    const json_t *attributes = NULL;
    if (lw_gltf_json_object(primitive, "attributes", &attributes, err)) return err->status;
    for (int set = 0; set < LW_GLTF_SHAPE_SETS; set++) {
        char joints[16], weights[16];
        snprintf(joints, sizeof joints, "JOINTS_%d", set);
        snprintf(weights, sizeof weights, "WEIGHTS_%d", set);
        if (open_accessor(document, attributes, joints, 4, LW_GLTF_ACCEPT_UNSIGNED, count,
                          &shape->joints[set], err) ||
            open_accessor(document, attributes, weights, 4,
                          LW_GLTF_ACCEPT_FLOAT | LW_GLTF_ACCEPT_NORMALIZED_UNSIGNED, count,
                          &shape->weights[set], err))
            return err->status;
        if (!shape->joints[set].count != !shape->weights[set].count)
            return lw_status_fail(err, LW_BAD_DATA, "attributes: %s and %s come together", joints, weights);
    }
    if (shape->joints[0].count) shape->skin = skin; /* else its node is its place */
    return LW_OK;
}

enum lw_status lw_gltf_shape_init(struct lw_gltf_shape *shape, const struct lw_gltf_document *document,
                                  const json_t *mesh, const json_t *primitive,
                                  const struct lw_gltf_look *look, uint32_t count, struct lw_error *err) {
    *shape = (struct lw_gltf_shape){0};
    if (open_morphs(shape, document, mesh, primitive, look->weights, count, err)) return err->status;
    return look->skin ? open_skin(shape, document, primitive, look->skin, count, err) : LW_OK;
}

void lw_gltf_shape_finish(struct lw_gltf_shape *shape) {
    free(shape->morph);
    *shape = (struct lw_gltf_shape){0};
}

/* ---- moving ---- */

static void add_scaled(struct lw_affine *sum, const struct lw_affine *matrix, float weight) {
    for (int row = 0; row < 3; row++)
        for (int column = 0; column < 4; column++) sum->m[row][column] += weight * matrix->m[row][column];
}

/* The mean of the joints' matrices by their weights, which need not sum to 1. */
static enum lw_status blend(const struct lw_gltf_shape *shape, uint32_t i, struct lw_affine *out,
                            struct lw_error *err) {
    float sum = 0;
    *out = (struct lw_affine){0};
    for (int set = 0; set < LW_GLTF_SHAPE_SETS && shape->joints[set].count; set++) {
        float joint[4], weight[4];
        lw_gltf_accessor_read(&shape->joints[set], i, joint);
        lw_gltf_accessor_read(&shape->weights[set], i, weight);
        for (int k = 0; k < 4; k++) {
            if (!(weight[k] >= 0 && weight[k] <= 1e6f))
                return lw_status_fail(err, LW_BAD_DATA, "WEIGHTS_%d: element %u is not a weight", set, i);
            if (weight[k] == 0) continue;
            if (joint[k] >= (float)shape->skin->joint_count)
                return lw_status_fail(err, LW_BAD_DATA, "JOINTS_%d: element %u names joint %g of %u", set, i,
                                      (double)joint[k], shape->skin->joint_count);
            add_scaled(out, &shape->skin->matrix[(uint32_t)joint[k]], weight[k]);
            sum += weight[k];
        }
    }
    if (sum == 0) /* as other programs take it */
        *out = shape->skin->matrix[0];
    else
        for (int k = 0; k < 12; k++) out->m[k / 4][k % 4] /= sum;
    return LW_OK;
}

static enum lw_status morph(const struct lw_gltf_shape *shape, uint32_t i, bool normals, struct lw_vec3 *v,
                            struct lw_error *err) {
    for (size_t m = 0; m < shape->morph_count; m++) {
        const struct lw_gltf_accessor *from = normals ? &shape->morph[m].normal : &shape->morph[m].position;
        float difference[4];
        if (!from->count) continue;
        lw_gltf_accessor_read(from, i, difference);
        const struct lw_vec3 d = lw_vec3(difference[0], difference[1], difference[2]);
        if (!lw_vec3_is_finite(d))
            return lw_status_fail(err, LW_BAD_DATA, "targets: accessor %u: element %u is not a finite number",
                                  from->index, i);
        *v = lw_vec3_mad(*v, d, shape->morph[m].weight);
    }
    return LW_OK;
}

static enum lw_status check_finite(struct lw_vec3 v, uint32_t i, struct lw_error *err) {
    if (lw_vec3_is_finite(v)) return LW_OK;
    return lw_status_fail(err, LW_BAD_DATA, "vertex %u is not finite where its targets and skin move it", i);
}

enum lw_status lw_gltf_shape_position(const struct lw_gltf_shape *shape, uint32_t i, struct lw_vec3 *position,
                                      struct lw_error *err) {
    struct lw_vec3 v = *position;
    if (morph(shape, i, false, &v, err)) return err->status;
    if (shape->skin) {
        struct lw_affine matrix;
        if (blend(shape, i, &matrix, err)) return err->status;
        v = lw_affine_point(&matrix, v);
    }
    if (check_finite(v, i, err)) return err->status;
    *position = v;
    return LW_OK;
}

enum lw_status lw_gltf_shape_normal(const struct lw_gltf_shape *shape, uint32_t i, struct lw_vec3 *normal,
                                    struct lw_error *err) {
    struct lw_vec3 v = *normal;
    if (morph(shape, i, true, &v, err)) return err->status;
    if (shape->skin) {
        struct lw_affine matrix;
        if (blend(shape, i, &matrix, err)) return err->status;
        v = lw_affine_normal(&matrix, v);
        if (!lw_vec3_is_finite(v)) v = lw_vec3(0, 0, 0); /* flattened: its face's normal counts */
    }
    if (check_finite(v, i, err)) return err->status;
    *normal = v;
    return LW_OK;
}

bool lw_gltf_shape_mirrors(const struct lw_gltf_shape *shape, uint32_t i) {
    struct lw_affine matrix;
    struct lw_error ignored = {0};
    return shape->skin && !blend(shape, i, &matrix, &ignored) && lw_affine_determinant(&matrix) < 0;
}
