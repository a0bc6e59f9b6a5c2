#include "server/import/gltf/gltf_node.h"

#include "common/scene/pose.h"
#include "server/import/gltf/gltf_instances.h"

#include <stdio.h>
#include <stdlib.h>
#include <string.h>

struct conversion {
    struct lw_gltf_document *document;
    struct lw_gltf_meshes *meshes;
    struct lw_scene *scene;
    uint32_t *parent;  /* per glTF node: its parent, or LW_SCENE_NONE */
    uint32_t *queue;   /* glTF nodes in the order of the scene's nodes */
    uint32_t *node_of; /* the inverse of queue */
    bool *hidden;      /* per glTF node: its mesh and its light are left out */
    /* glTF mesh -> scene mesh, as the mesh itself says; LW_SCENE_NONE: not converted yet, MESH_EMPTY: no
     * triangles */
    uint32_t *mesh_of;
    struct lw_pose pose; /* places at rest, for skins */
};
#define MESH_EMPTY (UINT32_MAX - 1)

/* ---- the tree ---- */

static enum lw_status read_children(const struct lw_gltf_document *document, uint32_t node,
                                    const json_t **out, struct lw_error *err) {
    *out = NULL;
    return lw_gltf_json_array(lw_gltf_document_item(document, LW_GLTF_NODES, node), "children", out, err);
}

static enum lw_status read_node_index(const struct lw_gltf_document *document, const json_t *array, size_t i,
                                      uint32_t *out, struct lw_error *err) {
    uint64_t index;
    if (!lw_gltf_json_whole(json_array_get(array, i), &index) || index >= document->count[LW_GLTF_NODES])
        return lw_status_fail(err, LW_BAD_DATA, "[%zu] must be an index into nodes, which has %u elements", i,
                              document->count[LW_GLTF_NODES]);
    *out = (uint32_t)index;
    return LW_OK;
}

static enum lw_status find_parents(struct conversion *conversion, struct lw_error *err) {
    const struct lw_gltf_document *document = conversion->document;
    for (uint32_t node = 0; node < document->count[LW_GLTF_NODES]; node++) {
        const json_t *children;
        if (read_children(document, node, &children, err)) {
            lw_status_context(err, "nodes[%u]", node);
            return err->status;
        }
        for (size_t i = 0; i < json_array_size(children); i++) {
            uint32_t child = 0;
            if (read_node_index(document, children, i, &child, err)) {
                lw_status_context(err, "nodes[%u].children", node);
                return err->status;
            }
            if (conversion->parent[child] != LW_SCENE_NONE)
                return lw_status_fail(
                    err, LW_BAD_DATA,
                    "nodes[%u]: has two parents, nodes[%u] and nodes[%u]; glTF asks for a tree", child,
                    conversion->parent[child], node);
            conversion->parent[child] = node;
        }
    }
    return LW_OK;
}

/* With one parent each, nodes form trees and cycles. Walk up from each node, marking with the walk's number
 * where it has been: a walk that meets its own mark went in a circle. Each node is walked over once. */
static enum lw_status refuse_cycles(const struct conversion *conversion, uint32_t *mark,
                                    struct lw_error *err) {
    uint32_t count = conversion->document->count[LW_GLTF_NODES];
    for (uint32_t i = 0; i < count; i++) mark[i] = LW_SCENE_NONE;
    for (uint32_t start = 0; start < count; start++) {
        uint32_t node = start;
        for (; node != LW_SCENE_NONE && mark[node] == LW_SCENE_NONE; node = conversion->parent[node])
            mark[node] = start;
        if (node != LW_SCENE_NONE && mark[node] == start)
            return lw_status_fail(err, LW_BAD_DATA, "nodes[%u]: is its own ancestor; glTF asks for a tree",
                                  node);
    }
    return LW_OK;
}

static enum lw_status add_root(struct conversion *conversion, uint32_t node, struct lw_error *err) {
    if (conversion->parent[node] != LW_SCENE_NONE)
        return lw_status_fail(err, LW_BAD_DATA, "nodes[%u] is a root of the scene and a child of nodes[%u]",
                              node, conversion->parent[node]);
    if (conversion->node_of[node] != LW_SCENE_NONE)
        return lw_status_fail(err, LW_BAD_DATA, "nodes[%u] is listed twice", node);
    conversion->node_of[node] = conversion->scene->node_count;
    conversion->queue[conversion->scene->node_count++] = node;
    return LW_OK;
}

static enum lw_status read_roots(struct conversion *conversion, uint32_t scene, struct lw_error *err) {
    const json_t *object = lw_gltf_document_item(conversion->document, LW_GLTF_SCENES, scene), *roots = NULL;
    const char *name = "";
    if (lw_gltf_json_array(object, "nodes", &roots, err) || lw_gltf_json_string(object, "name", &name, err))
        return err->status;
    if (!(conversion->scene->name = lw_scene_string(conversion->scene, name)))
        return lw_status_fail(err, LW_NO_MEMORY, "out of memory");
    for (size_t i = 0; i < json_array_size(roots); i++) {
        uint32_t node = 0;
        if (read_node_index(conversion->document, roots, i, &node, err) || add_root(conversion, node, err)) {
            lw_status_context(err, "nodes");
            return err->status;
        }
    }
    return LW_OK;
}

/* Roots of the default scene, or of the first if none is named, or every root if there is no scene. */
static enum lw_status find_roots(struct conversion *conversion, struct lw_error *err) {
    const struct lw_gltf_document *document = conversion->document;
    uint32_t scene = 0;
    if (lw_gltf_document_index(document, document->root, "scene", LW_GLTF_SCENES, &scene, err))
        return err->status;
    if (document->count[LW_GLTF_SCENES]) {
        if (read_roots(conversion, scene, err)) lw_status_context(err, "scenes[%u]", scene);
        return err->status;
    }
    for (uint32_t node = 0; node < document->count[LW_GLTF_NODES]; node++)
        if (conversion->parent[node] == LW_SCENE_NONE && add_root(conversion, node, err)) return err->status;
    return LW_OK;
}

/* Breadth first, so that parents come before their children. Indices were checked by find_parents(). */
static void queue_descendants(struct conversion *conversion) {
    struct lw_scene *scene = conversion->scene;
    for (uint32_t at = 0; at < scene->node_count; at++) {
        const json_t *object =
            lw_gltf_document_item(conversion->document, LW_GLTF_NODES, conversion->queue[at]);
        const json_t *children = json_object_get(object, "children"), *value;
        size_t i;
        json_array_foreach(children, i, value) {
            uint64_t child = 0;
            if (!lw_gltf_json_whole(value, &child)) continue; /* never: see above */
            conversion->node_of[child] = scene->node_count;
            conversion->queue[scene->node_count++] = (uint32_t)child;
        }
    }
}

/* ---- visibility ---- */

/* KHR_node_visibility: a node that is not visible hides the nodes below it. */
static enum lw_status read_visibility(const json_t *object, bool *out, struct lw_error *err) {
    const json_t *extension = NULL;
    if (lw_gltf_json_extension(object, "KHR_node_visibility", &extension, err)) return err->status;
    if (extension && lw_gltf_json_flag(extension, "visible", out, err))
        lw_status_context(err, "KHR_node_visibility");
    return err->status;
}

/* MSFT_lod: the node is the finest level, and ids names its coarser ones, which are not drawn beside it. */
static enum lw_status hide_coarser(struct conversion *conversion, const json_t *object,
                                   struct lw_error *err) {
    const json_t *extension = NULL, *ids = NULL;
    if (lw_gltf_json_extension(object, "MSFT_lod", &extension, err)) return err->status;
    if (extension && !lw_gltf_json_array(extension, "ids", &ids, err))
        for (size_t i = 0; i < json_array_size(ids); i++) {
            uint32_t level = 0;
            if (read_node_index(conversion->document, ids, i, &level, err)) break;
            if (lw_gltf_document_item(conversion->document, LW_GLTF_NODES, level) != object)
                conversion->hidden[level] = true;
        }
    if (err->status) lw_status_context(err, "MSFT_lod");
    return err->status;
}

static enum lw_status find_hidden(struct conversion *conversion, struct lw_error *err) {
    const struct lw_scene *scene = conversion->scene;
    for (uint32_t at = 0; at < scene->node_count; at++) {
        uint32_t node = conversion->queue[at];
        const json_t *object = lw_gltf_document_item(conversion->document, LW_GLTF_NODES, node);
        bool visible = true;
        if (read_visibility(object, &visible, err) || hide_coarser(conversion, object, err)) {
            lw_status_context(err, "nodes[%u]", node);
            return err->status;
        }
        conversion->hidden[node] |= !visible;
    }
    for (uint32_t at = 0; at < scene->node_count; at++) { /* parents first */
        uint32_t node = conversion->queue[at], parent = conversion->parent[node];
        if (parent != LW_SCENE_NONE) conversion->hidden[node] |= conversion->hidden[parent];
    }
    return LW_OK;
}

/* ---- places ---- */

static enum lw_status read_matrix(const json_t *object, struct lw_node *out, struct lw_error *err) {
    float m[16]; /* column-major */
    if (lw_gltf_json_reals(object, "matrix", 16, -HUGE_VAL, HUGE_VAL, m, err)) return err->status;
    if (m[3] != 0 || m[7] != 0 || m[11] != 0 || m[15] != 1)
        return lw_status_fail(err, LW_BAD_DATA, "matrix: its last row must be 0, 0, 0, 1");
    if (json_object_get(object, "translation") || json_object_get(object, "rotation") ||
        json_object_get(object, "scale"))
        return lw_status_fail(err, LW_BAD_DATA, "matrix: excludes translation, rotation and scale");
    for (int row = 0; row < 3; row++)
        for (int column = 0; column < 4; column++) out->matrix.m[row][column] = m[column * 4 + row];
    out->has_matrix = true;
    return LW_OK;
}

static enum lw_status read_place(const json_t *object, struct lw_node *out, struct lw_error *err) {
    if (json_object_get(object, "matrix")) return read_matrix(object, out, err);
    if (lw_gltf_json_reals(object, "translation", 3, -HUGE_VAL, HUGE_VAL, out->translation, err) ||
        lw_gltf_json_reals(object, "rotation", 4, -1.001, 1.001, out->rotation, err) ||
        lw_gltf_json_reals(object, "scale", 3, -HUGE_VAL, HUGE_VAL, out->scale, err))
        return err->status;
    double square = 0;
    for (int c = 0; c < 4; c++) square += (double)out->rotation[c] * (double)out->rotation[c];
    if (fabs(square - 1) > 0.01)
        return lw_status_fail(err, LW_BAD_DATA, "rotation: must be a unit quaternion");
    for (int c = 0; c < 4; c++) out->rotation[c] = (float)((double)out->rotation[c] / sqrt(square));
    return LW_OK;
}

/* ---- what hangs on a node ---- */

/* Nodes that look alike share a mesh. A skin and weights of a node's own make one more. */
static enum lw_status find_mesh(struct conversion *conversion, uint32_t index,
                                const struct lw_gltf_look *look, uint32_t *out, struct lw_error *err) {
    struct lw_scene *scene = conversion->scene;
    uint32_t own = LW_SCENE_NONE;
    uint32_t *slot = look->skin || look->weights ? &own : &conversion->mesh_of[index];
    if (*slot == LW_SCENE_NONE) {
        struct lw_mesh *mesh = &scene->mesh[scene->mesh_count];
        if (lw_gltf_meshes_convert(conversion->meshes, index, look, mesh, err)) return err->status;
        *slot = mesh->triangle_count ? scene->mesh_count++ : MESH_EMPTY;
    }
    *out = *slot;
    return LW_OK;
}

static enum lw_status add_instances(struct conversion *conversion, const struct lw_gltf_instances *instances,
                                    uint32_t mesh, uint32_t node, struct lw_error *err) {
    struct lw_scene *scene = conversion->scene;
    for (uint32_t i = 0; i < instances->count; i++) {
        struct lw_node *place = &scene->node[scene->node_count];
        const char *name = scene->node[node].name;
        char numbered[200];
        snprintf(numbered, sizeof numbered, "%.180s %u", name, i);
        *place = (struct lw_node){
            .parent = node, .rotation = {0, 0, 0, 1}, .scale = {1, 1, 1}, .matrix = LW_AFFINE_IDENTITY};
        if (lw_gltf_instances_read(instances, i, place, err)) return err->status;
        place->name = *name ? lw_scene_string(scene, numbered) : name;
        if (!place->name) return lw_status_fail(err, LW_NO_MEMORY, "out of memory");
        if (lw_scene_add_object(scene, mesh, scene->node_count++, err)) return err->status;
    }
    return LW_OK;
}

/* A skinned mesh is in world space already: it hangs on a node of its own at the root. */
static enum lw_status add_skinned(struct conversion *conversion, uint32_t mesh, uint32_t node,
                                  struct lw_error *err) {
    struct lw_scene *scene = conversion->scene;
    scene->node[scene->node_count] = (struct lw_node){.name = scene->node[node].name,
                                                      .parent = LW_SCENE_NONE,
                                                      .rotation = {0, 0, 0, 1},
                                                      .scale = {1, 1, 1},
                                                      .matrix = LW_AFFINE_IDENTITY};
    return lw_scene_add_object(scene, mesh, scene->node_count++, err);
}

/* Marks the joints of skins and the nodes above them: their animation is reported. */
static void mark_joints(struct conversion *conversion, const struct lw_gltf_skin *skin) {
    for (uint32_t i = 0; i < skin->joint_count; i++)
        for (uint32_t node = skin->joint[i]; node != LW_SCENE_NONE && !conversion->document->moves_skin[node];
             node = conversion->parent[node])
            conversion->document->moves_skin[node] = true;
}

static enum lw_status add_skin(struct conversion *conversion, uint32_t skin, const struct lw_gltf_look *look,
                               uint32_t mesh_index, uint32_t node, struct lw_error *err) {
    struct lw_gltf_look skinned = *look;
    struct lw_gltf_skin opened;
    uint32_t mesh = MESH_EMPTY;
    if (!conversion->pose.node_to_world && lw_pose_init(&conversion->pose, conversion->scene))
        return lw_status_fail(err, LW_NO_MEMORY, "out of memory");
    skinned.skin = &opened;
    enum lw_status status = lw_gltf_skin_init(&opened, conversion->document, skin, conversion->node_of,
                                              conversion->pose.node_to_world, err);
    if (status == LW_OK) status = find_mesh(conversion, mesh_index, &skinned, &mesh, err);
    if (status == LW_OK) mark_joints(conversion, &opened);
    if (status == LW_OK && mesh != MESH_EMPTY) status = add_skinned(conversion, mesh, node, err);
    lw_gltf_skin_finish(&opened);
    return status;
}

/* A node's statements of its mesh. Values stay where it says nothing. */
static enum lw_status read_look(const struct lw_gltf_document *document, const json_t *object, uint32_t *mesh,
                                uint32_t *skin, struct lw_gltf_look *look,
                                struct lw_gltf_instances *instances, struct lw_error *err) {
    if (lw_gltf_document_index(document, object, "mesh", LW_GLTF_MESHES, mesh, err) ||
        lw_gltf_document_index(document, object, "skin", LW_GLTF_SKINS, skin, err) ||
        lw_gltf_json_array(object, "weights", &look->weights, err) ||
        lw_gltf_instances_open(document, object, instances, err))
        return err->status;
    return LW_OK;
}

static enum lw_status add_object(struct conversion *conversion, const json_t *object, uint32_t node,
                                 struct lw_error *err) {
    struct lw_scene *scene = conversion->scene;
    uint32_t index = LW_SCENE_NONE, skin = LW_SCENE_NONE, mesh = MESH_EMPTY;
    struct lw_gltf_look look = {0};
    struct lw_gltf_instances instances = {0};
    if (read_look(conversion->document, object, &index, &skin, &look, &instances, err)) {
        lw_status_context(err, "nodes[%u]", conversion->queue[node]);
        return err->status;
    }
    if (index == LW_SCENE_NONE) return LW_OK;
    if (skin != LW_SCENE_NONE) return add_skin(conversion, skin, &look, index, node, err);
    if (find_mesh(conversion, index, &look, &mesh, err)) return err->status;
    if (mesh == MESH_EMPTY) return LW_OK;
    if (!instances.count) return lw_scene_add_object(scene, mesh, node, err);
    if (add_instances(conversion, &instances, mesh, node, err))
        lw_status_context(err, "nodes[%u]", conversion->queue[node]);
    return err->status;
}

static enum lw_status read_spot(struct conversion *conversion, const json_t *object, struct lw_light *out,
                                struct lw_error *err) {
    const json_t *spot = NULL;
    if (lw_gltf_json_require(object, "spot", err) || lw_gltf_json_object(object, "spot", &spot, err))
        return err->status;
    out->inner_cone = 0;
    out->outer_cone = LW_PI / 4;
    /* a hair above pi/2: exporters write it rounded to a float */
    if (lw_gltf_json_real(spot, "innerConeAngle", 0, 1.5707964, &out->inner_cone, err) ||
        lw_gltf_json_real(spot, "outerConeAngle", 0, 1.5707964, &out->outer_cone, err)) {
        lw_status_context(err, "spot");
        return err->status;
    }
    if (!(out->outer_cone > 0))
        return lw_status_fail(err, LW_BAD_DATA, "spot: outerConeAngle must be greater than 0");
    if (out->inner_cone >= out->outer_cone) { /* as exporters write a spot without a soft edge */
        lw_gltf_document_warn(conversion->document, LW_GLTF_WARN_CONES);
        out->inner_cone = LW_LIGHT_CONE_EDGE * out->outer_cone;
    }
    return LW_OK;
}

/* KHR_lights_punctual. 1 cd is taken as 1 W/sr and 1 lux as 1 W/m^2. */
static enum lw_status read_light(struct conversion *conversion, const json_t *object, struct lw_light *out,
                                 struct lw_error *err) {
    const char *type = "", *name = "";
    float colour[3] = {1, 1, 1}, intensity = 1;
    if (lw_gltf_json_require(object, "type", err) || lw_gltf_json_string(object, "type", &type, err) ||
        lw_gltf_json_string(object, "name", &name, err) ||
        lw_gltf_json_reals(object, "color", 3, 0, HUGE_VAL, colour, err) ||
        lw_gltf_json_real(object, "intensity", 0, HUGE_VAL, &intensity, err) ||
        lw_gltf_json_drawn_by(object, &out->drawn_by, err))
        return err->status;
    if (strcmp(type, "point") == 0)
        out->kind = LW_LIGHT_POINT;
    else if (strcmp(type, "spot") == 0)
        out->kind = LW_LIGHT_SPOT;
    else if (strcmp(type, "directional") == 0)
        out->kind = LW_LIGHT_DIRECTIONAL;
    else
        return lw_status_fail(err, LW_BAD_DATA, "type: must be point, spot or directional");
    if (out->kind == LW_LIGHT_SPOT && read_spot(conversion, object, out, err)) return err->status;
    if (json_object_get(object, "range"))
        lw_gltf_document_warn(conversion->document, LW_GLTF_WARN_LIGHT_RANGE);
    for (int c = 0; c < 3; c++) {
        out->intensity[c] = colour[c] * intensity;
        if (!isfinite(out->intensity[c])) return lw_status_fail(err, LW_BAD_DATA, "intensity: is too large");
    }
    out->name = *name ? lw_scene_string(conversion->scene, name) : conversion->scene->node[out->node].name;
    return out->name ? LW_OK : lw_status_fail(err, LW_NO_MEMORY, "out of memory");
}

static enum lw_status add_light(struct conversion *conversion, const json_t *object, uint32_t node,
                                struct lw_error *err) {
    struct lw_scene *scene = conversion->scene;
    const json_t *extension = NULL;
    uint32_t index = 0;
    if (lw_gltf_json_extension(object, "KHR_lights_punctual", &extension, err) ||
        (extension &&
         (lw_gltf_json_require(extension, "light", err) ||
          lw_gltf_document_index(conversion->document, extension, "light", LW_GLTF_LIGHTS, &index, err)))) {
        lw_status_context(err, "nodes[%u]", conversion->queue[node]);
        return err->status;
    }
    if (!extension) return LW_OK;
    if (scene->light_count >= LW_SCENE_LIGHTS_MAX)
        return lw_status_fail(err, LW_BAD_DATA, "has more than %u lights", LW_SCENE_LIGHTS_MAX);
    struct lw_light *light = &scene->light[scene->light_count];
    light->node = node;
    if (read_light(conversion, lw_gltf_document_item(conversion->document, LW_GLTF_LIGHTS, index), light,
                   err)) {
        lw_status_context(err, "extensions.KHR_lights_punctual.lights[%u]", index);
        return err->status;
    }
    conversion->document->light_of[scene->light_count++] = index;
    return LW_OK;
}

static enum lw_status read_perspective(const json_t *camera, struct lw_camera *out, struct lw_error *err) {
    const json_t *frame = NULL;
    if (lw_gltf_json_require(camera, "perspective", err) ||
        lw_gltf_json_object(camera, "perspective", &frame, err) || lw_gltf_json_require(frame, "yfov", err) ||
        lw_gltf_json_real(frame, "yfov", 1e-3, 3.14, &out->fov_y, err))
        return err->status;
    return LW_OK;
}

/* Windows choose the width, as of perspective cameras; near and far planes cut nothing. */
static enum lw_status read_orthographic(const json_t *camera, struct lw_camera *out, struct lw_error *err) {
    const json_t *frame = NULL;
    float half = 0;
    if (lw_gltf_json_require(camera, "orthographic", err) ||
        lw_gltf_json_object(camera, "orthographic", &frame, err) ||
        lw_gltf_json_require(frame, "ymag", err) ||
        lw_gltf_json_real(frame, "ymag", -HUGE_VAL, HUGE_VAL, &half, err))
        return err->status;
    out->fov_y = LW_PI / 4; /* for who knows none */
    out->height_m = 2 * fabsf(half);
    if (!(out->height_m > 0)) return lw_status_fail(err, LW_BAD_DATA, "ymag: must not be 0");
    return LW_OK;
}

static enum lw_status read_camera(struct conversion *conversion, const json_t *object, struct lw_camera *out,
                                  struct lw_error *err) {
    const char *type = "", *name = "";
    if (lw_gltf_json_require(object, "type", err) || lw_gltf_json_string(object, "type", &type, err) ||
        lw_gltf_json_string(object, "name", &name, err))
        return err->status;
    if (strcmp(type, "perspective") != 0 && strcmp(type, "orthographic") != 0)
        return lw_status_fail(err, LW_BAD_DATA, "type: must be perspective or orthographic");
    if (strcmp(type, "orthographic") == 0 ? read_orthographic(object, out, err)
                                          : read_perspective(object, out, err)) {
        lw_status_context(err, "%s", type);
        return err->status;
    }
    out->name = *name ? lw_scene_string(conversion->scene, name) : conversion->scene->node[out->node].name;
    return out->name ? LW_OK : lw_status_fail(err, LW_NO_MEMORY, "out of memory");
}

static enum lw_status add_camera(struct conversion *conversion, const json_t *object, uint32_t node,
                                 struct lw_error *err) {
    struct lw_scene *scene = conversion->scene;
    uint32_t index = LW_SCENE_NONE;
    if (lw_gltf_document_index(conversion->document, object, "camera", LW_GLTF_CAMERAS, &index, err)) {
        lw_status_context(err, "nodes[%u]", conversion->queue[node]);
        return err->status;
    }
    if (index == LW_SCENE_NONE) return LW_OK;
    if (scene->camera_count >= LW_SCENE_CAMERAS_MAX)
        return lw_status_fail(err, LW_BAD_DATA, "has more than %u cameras", LW_SCENE_CAMERAS_MAX);
    struct lw_camera *camera = &scene->camera[scene->camera_count];
    camera->node = node;
    if (read_camera(conversion, lw_gltf_document_item(conversion->document, LW_GLTF_CAMERAS, index), camera,
                    err)) {
        lw_status_context(err, "cameras[%u]", index);
        return err->status;
    }
    scene->camera_count++;
    return LW_OK;
}

/* ---- the scene ---- */

static enum lw_status read_node(struct conversion *conversion, const json_t *object, uint32_t node,
                                struct lw_error *err) {
    struct lw_scene *scene = conversion->scene;
    struct lw_node *out = &scene->node[node];
    uint32_t parent = conversion->parent[conversion->queue[node]];
    const char *name = "";
    *out = (struct lw_node){.parent = parent == LW_SCENE_NONE ? LW_SCENE_NONE : conversion->node_of[parent],
                            .rotation = {0, 0, 0, 1},
                            .scale = {1, 1, 1},
                            .matrix = LW_AFFINE_IDENTITY};
    if (lw_gltf_json_string(object, "name", &name, err) || read_place(object, out, err)) {
        lw_status_context(err, "nodes[%u]", conversion->queue[node]);
        return err->status;
    }
    if (!(out->name = lw_scene_string(scene, name)))
        return lw_status_fail(err, LW_NO_MEMORY, "out of memory");
    if (!conversion->hidden[conversion->queue[node]] && add_light(conversion, object, node, err))
        return err->status;
    return add_camera(conversion, object, node, err);
}

/* Nodes, meshes and objects that a node may add to those of the document. */
static enum lw_status count_more(const struct conversion *conversion, size_t *nodes, size_t *meshes,
                                 struct lw_error *err) {
    const struct lw_gltf_document *document = conversion->document;
    *nodes = *meshes = 0;
    for (uint32_t node = 0; node < document->count[LW_GLTF_NODES]; node++) {
        const json_t *object = lw_gltf_document_item(document, LW_GLTF_NODES, node);
        struct lw_gltf_instances instances = {0};
        if (lw_gltf_instances_open(document, object, &instances, err)) {
            lw_status_context(err, "nodes[%u]", node);
            return err->status;
        }
        *nodes += instances.count + (json_object_get(object, "skin") != NULL);
        *meshes += json_object_get(object, "skin") || json_object_get(object, "weights");
    }
    return LW_OK;
}

static size_t smaller(size_t a, size_t b) { return a < b ? a : b; }

static enum lw_status allocate(struct conversion *conversion, struct lw_error *err) {
    const struct lw_gltf_document *document = conversion->document;
    struct lw_scene *scene = conversion->scene;
    size_t node_count = document->count[LW_GLTF_NODES], mesh_count = document->count[LW_GLTF_MESHES];
    size_t more_nodes, more_meshes;
    if (count_more(conversion, &more_nodes, &more_meshes, err)) return err->status;
    node_count += more_nodes;
    mesh_count += more_meshes;
    if (node_count > LW_SCENE_NODES_MAX)
        return lw_status_fail(err, LW_BAD_DATA,
                              "has %zu nodes; the limit is %u: join what stands together into one mesh",
                              node_count, LW_SCENE_NODES_MAX);
    if (mesh_count > LW_SCENE_MESHES_MAX)
        return lw_status_fail(err, LW_BAD_DATA, "has %zu meshes; the limit is %u", mesh_count,
                              LW_SCENE_MESHES_MAX);
    conversion->parent = malloc((node_count + 1) * sizeof *conversion->parent);
    conversion->queue = malloc((node_count + 1) * sizeof *conversion->queue);
    conversion->document->moves_skin = calloc(node_count + 1, sizeof *conversion->document->moves_skin);
    conversion->document->light_of = calloc(node_count + 1, sizeof *conversion->document->light_of);
    conversion->hidden = calloc(node_count + 1, sizeof *conversion->hidden);
    conversion->mesh_of = malloc((mesh_count + 1) * sizeof *conversion->mesh_of);
    scene->node = lw_scene_alloc(scene, node_count + 1, sizeof *scene->node);
    scene->mesh = lw_scene_alloc(scene, mesh_count + 1, sizeof *scene->mesh);
    scene->object =
        lw_scene_alloc(scene, smaller(node_count, LW_SCENE_OBJECTS_MAX) + 1, sizeof *scene->object);
    scene->light = lw_scene_alloc(scene, smaller(node_count, LW_SCENE_LIGHTS_MAX) + 1, sizeof *scene->light);
    scene->camera =
        lw_scene_alloc(scene, smaller(node_count, LW_SCENE_CAMERAS_MAX) + 1, sizeof *scene->camera);
    if (!conversion->parent || !conversion->queue || !conversion->hidden ||
        !conversion->document->moves_skin || !conversion->document->light_of || !conversion->mesh_of ||
        !scene->node || !scene->mesh || !scene->object || !scene->light || !scene->camera)
        return lw_status_fail(err, LW_NO_MEMORY, "out of memory for %zu nodes", node_count);
    for (size_t i = 0; i < document->count[LW_GLTF_NODES]; i++)
        conversion->parent[i] = conversion->node_of[i] = LW_SCENE_NONE;
    for (size_t i = 0; i < mesh_count; i++) conversion->mesh_of[i] = LW_SCENE_NONE;
    return LW_OK;
}

static enum lw_status convert(struct conversion *conversion, struct lw_error *err) {
    if (allocate(conversion, err) || find_parents(conversion, err) ||
        refuse_cycles(conversion, conversion->queue, err) || find_roots(conversion, err))
        return err->status;
    queue_descendants(conversion);
    if (find_hidden(conversion, err)) return err->status;
    const struct lw_gltf_document *document = conversion->document;
    const uint32_t count = conversion->scene->node_count; /* instances and skins add more */
    for (uint32_t node = 0; node < count; node++)
        if (read_node(conversion, lw_gltf_document_item(document, LW_GLTF_NODES, conversion->queue[node]),
                      node, err))
            return err->status;
    for (uint32_t node = 0; node < count; node++) {
        const uint32_t index = conversion->queue[node];
        if (!conversion->hidden[index] &&
            add_object(conversion, lw_gltf_document_item(document, LW_GLTF_NODES, index), node, err))
            return err->status;
    }
    return LW_OK;
}

enum lw_status lw_gltf_node_convert(struct lw_gltf_document *document, struct lw_gltf_meshes *meshes,
                                    struct lw_scene *scene, uint32_t *out_node_of, struct lw_error *err) {
    struct conversion conversion = {
        .document = document, .meshes = meshes, .scene = scene, .node_of = out_node_of};
    enum lw_status status = convert(&conversion, err);
    lw_pose_finish(&conversion.pose);
    free(conversion.mesh_of);
    free(conversion.hidden);
    free(conversion.queue);
    free(conversion.parent);
    return status;
}
