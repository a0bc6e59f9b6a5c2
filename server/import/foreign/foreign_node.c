#include "server/import/foreign/foreign_node.h"

#include <stdlib.h>
#include <string.h>

#define FOV_MIN 1e-3f
#define FOV_MAX 3.1f

/* An FBX camera without an angle: Assimp makes it one degree; FBX means FBX_FOV (radians). */
#define FBX_UNSAID 0.017453292f
#define FBX_FOV    0.43833938f

struct conversion {
    struct lw_foreign_import *import;
    struct lw_foreign_meshes *meshes;
    struct lw_foreign_nodes *nodes;
    /* per mesh of the file: the node of the scene whose list begins with it and was built first */
    uint32_t *built;
    uint32_t *mesh_of_node; /* per node of the scene: its mesh; LW_SCENE_NONE: none */
};

/* ---- the tree ---- */

static size_t count_nodes(const struct aiNode *root) {
    size_t count = 0;
    const struct aiNode *node = root;
    /* walked without recursion: next sibling by the place among the parent's children */
    while (node) {
        if (++count > LW_SCENE_NODES_MAX) return count;
        if (node->mNumChildren) {
            node = node->mChildren[0];
            continue;
        }
        const struct aiNode *up = node;
        node = NULL;
        while (up != root && !node) {
            const struct aiNode *parent = up->mParent;
            unsigned i = 0;
            if (!parent) return count;
            while (i < parent->mNumChildren && parent->mChildren[i] != up) i++;
            if (i + 1 < parent->mNumChildren) node = parent->mChildren[i + 1];
            up = parent;
        }
    }
    return count;
}

static int compare_names(const void *a, const void *b, void *context) {
    const struct lw_foreign_nodes *nodes = context;
    uint32_t i = *(const uint32_t *)a, j = *(const uint32_t *)b;
    int order = strcmp(nodes->queue[i]->mName.data, nodes->queue[j]->mName.data);
    return order ? order : i < j ? -1 : i > j;
}

uint32_t lw_foreign_nodes_find(const struct lw_foreign_nodes *nodes, const struct aiString *name) {
    uint32_t low = 0, high = nodes->count;
    while (low < high) {
        uint32_t middle = low + (high - low) / 2;
        if (strcmp(nodes->queue[nodes->by_name[middle]]->mName.data, name->data) < 0)
            low = middle + 1;
        else
            high = middle;
    }
    if (low == nodes->count || strcmp(nodes->queue[nodes->by_name[low]]->mName.data, name->data) != 0)
        return LW_SCENE_NONE;
    return nodes->by_name[low];
}

void lw_foreign_nodes_finish(struct lw_foreign_nodes *nodes) {
    free(nodes->by_name);
    free(nodes->queue);
    *nodes = (struct lw_foreign_nodes){0};
}

static enum lw_status read_matrix(const struct aiMatrix4x4 *m, struct lw_node *out, struct lw_error *err) {
    const float rows[3][4] = {
        {m->a1, m->a2, m->a3, m->a4}, {m->b1, m->b2, m->b3, m->b4}, {m->c1, m->c2, m->c3, m->c4}};
    for (int r = 0; r < 3; r++)
        for (int c = 0; c < 4; c++)
            if (!(fabsf(rows[r][c]) <= LW_SCENE_COORDINATE_MAX))
                return lw_status_fail(err, LW_BAD_DATA, "its matrix holds %g", (double)rows[r][c]);
    memcpy(out->matrix.m, rows, sizeof rows);
    out->has_matrix = true;
    return LW_OK;
}

static enum lw_status add_node(struct conversion *conversion, uint32_t index, uint32_t parent,
                               struct lw_error *err) {
    const struct aiNode *from = conversion->nodes->queue[index];
    struct lw_node *out = &conversion->import->scene->node[index];
    *out = (struct lw_node){
        .parent = parent, .rotation = {0, 0, 0, 1}, .scale = {1, 1, 1}, .matrix = LW_AFFINE_IDENTITY};
    out->name = lw_foreign_import_text(conversion->import, &from->mName);
    if (!out->name) return lw_status_fail(err, LW_NO_MEMORY, "out of memory for nodes");
    if (read_matrix(&from->mTransformation, out, err)) lw_status_context(err, "node \"%.80s\"", out->name);
    return err->status;
}

static enum lw_status add_tree(struct conversion *conversion, uint32_t count, struct lw_error *err) {
    struct lw_foreign_nodes *nodes = conversion->nodes;
    if (add_node(conversion, 0, LW_SCENE_NONE, err)) return err->status;
    uint32_t filled = 1;
    for (uint32_t at = 0; at < filled; at++)
        for (unsigned i = 0; i < nodes->queue[at]->mNumChildren && filled < count; i++) {
            nodes->queue[filled] = nodes->queue[at]->mChildren[i];
            if (add_node(conversion, filled++, at, err)) return err->status;
        }
    nodes->count = conversion->import->scene->node_count = filled;
    for (uint32_t i = 0; i < filled; i++) nodes->by_name[i] = i;
    qsort_r(nodes->by_name, filled, sizeof *nodes->by_name, compare_names, nodes);
    return LW_OK;
}

/* ---- objects ---- */

static bool same_meshes(const struct aiNode *a, const struct aiNode *b) {
    return a->mNumMeshes == b->mNumMeshes &&
           memcmp(a->mMeshes, b->mMeshes, a->mNumMeshes * sizeof *a->mMeshes) == 0;
}

static enum lw_status add_object(struct conversion *conversion, uint32_t node, struct lw_error *err) {
    struct lw_scene *scene = conversion->import->scene;
    const struct aiNode *from = conversion->nodes->queue[node];
    conversion->mesh_of_node[node] = LW_SCENE_NONE;
    if (from->mNumMeshes == 0) return LW_OK;
    unsigned first = from->mMeshes[0];
    if (first >= conversion->import->ai->mNumMeshes)
        return lw_status_fail(err, LW_BAD_DATA, "a node names mesh %u of %u", first,
                              conversion->import->ai->mNumMeshes);
    uint32_t *built = &conversion->built[first], mesh;
    if (*built != LW_SCENE_NONE && same_meshes(from, conversion->nodes->queue[*built])) {
        mesh = conversion->mesh_of_node[*built];
    } else {
        struct lw_mesh *out = &scene->mesh[scene->mesh_count];
        if (lw_foreign_meshes_convert(conversion->meshes, from->mMeshes, from->mNumMeshes, out, err))
            return err->status;
        mesh = out->triangle_count ? scene->mesh_count++ : LW_SCENE_NONE;
        if (*built == LW_SCENE_NONE) *built = node;
    }
    conversion->mesh_of_node[node] = mesh;
    if (mesh == LW_SCENE_NONE) return LW_OK;
    return lw_scene_add_object(scene, mesh, node, err);
}

/* ---- lights and cameras ---- */

/* A node of its own below `parent` that looks along `direction`, since ours look along -Z. up: where +Y goes,
 * as far as it can. */
static enum lw_status add_mount(struct conversion *conversion, uint32_t parent, const char *name,
                                struct lw_vec3 position, struct lw_vec3 direction, struct lw_vec3 up,
                                uint32_t *out_node, struct lw_error *err) {
    struct lw_scene *scene = conversion->import->scene;
    if (!lw_vec3_is_finite(position) || !lw_vec3_is_finite(direction) || !lw_vec3_is_finite(up))
        return lw_status_fail(err, LW_BAD_DATA, "its place is not finite");
    if (scene->node_count >= LW_SCENE_NODES_MAX)
        return lw_status_fail(err, LW_BAD_DATA, "the scene has more than %u nodes", LW_SCENE_NODES_MAX);
    if (lw_vec3_length(direction) < 1e-6f) direction = lw_vec3(0, 0, -1);
    struct lw_vec3 z = lw_vec3_normalize(lw_vec3_scale(direction, -1)), x = lw_vec3_cross(up, z);
    if (lw_vec3_length(x) < 1e-6f)
        x = lw_vec3_cross(fabsf(z.y) < 0.9f ? lw_vec3(0, 1, 0) : lw_vec3(1, 0, 0), z);
    x = lw_vec3_normalize(x);
    struct lw_vec3 y = lw_vec3_cross(z, x);
    struct lw_node *node = &scene->node[scene->node_count];
    *node = (struct lw_node){
        .name = name,
        .parent = parent,
        .rotation = {0, 0, 0, 1},
        .scale = {1, 1, 1},
        .matrix = {{{x.x, y.x, z.x, position.x}, {x.y, y.y, z.y, position.y}, {x.z, y.z, z.z, position.z}}},
        .has_matrix = true};
    *out_node = scene->node_count++;
    return LW_OK;
}

static struct lw_vec3 vec(const struct aiVector3D *v) { return lw_vec3(v->x, v->y, v->z); }

/* Both formats give whole angles, ours are half ones. Collada's falloff angle is where its light ends. */
static void read_cones(enum lw_scene_format format, const struct aiLight *from, struct lw_light *out) {
    float inner = 0.5f * from->mAngleInnerCone, outer = 0.5f * from->mAngleOuterCone;
    if (format == LW_SCENE_FORMAT_COLLADA) {
        bool soft = outer > inner;
        outer = inner;
        inner = soft ? 0 : inner;
    }
    if (!(outer > 1e-3f)) outer = LW_PI / 4;
    if (outer > LW_PI / 2) outer = LW_PI / 2;
    if (!(inner >= 0)) inner = 0;
    out->outer_cone = outer;
    out->inner_cone = fminf(inner, LW_LIGHT_CONE_EDGE * outer);
}

/* Collada: intensity / (c + l d + q d^2) at distance d in units of the file; far away that is intensity / (q
 * d^2). */
static float strength_of(const struct conversion *conversion, const struct aiLight *from) {
    float q = from->mAttenuationQuadratic;
    const bool is_constant = from->mAttenuationConstant == 0 || from->mAttenuationConstant == 1;
    if (conversion->import->desc->format == LW_SCENE_FORMAT_COLLADA &&
        from->mType != aiLightSource_DIRECTIONAL && (from->mAttenuationLinear != 0 || !is_constant))
        lw_foreign_import_warn(conversion->import, LW_FOREIGN_WARN_ATTENUATION);
    if (conversion->import->desc->format != LW_SCENE_FORMAT_COLLADA || !(q > 0) ||
        from->mType == aiLightSource_DIRECTIONAL)
        return 1;
    float metres = cbrtf(fabsf(lw_affine_determinant(&conversion->import->scene->node[0].matrix)));
    return metres * metres / q;
}

/* *out_use: it is a light that is kept. */
static enum lw_status read_light(struct conversion *conversion, const struct aiLight *from,
                                 struct lw_light *out, bool *out_use, struct lw_error *err) {
    *out_use = true;
    switch (from->mType) {
    case aiLightSource_POINT:
        out->kind = LW_LIGHT_POINT;
        break;
    case aiLightSource_SPOT:
        out->kind = LW_LIGHT_SPOT;
        break;
    case aiLightSource_DIRECTIONAL:
        out->kind = LW_LIGHT_DIRECTIONAL;
        break;
    case aiLightSource_AREA:
        lw_foreign_import_warn(conversion->import, LW_FOREIGN_WARN_AREA); /* fall through */
    default:
        if (from->mType != aiLightSource_AREA)
            lw_foreign_import_warn(conversion->import, LW_FOREIGN_WARN_AMBIENT);
        *out_use = false;
        return LW_OK;
    }
    if (out->kind == LW_LIGHT_SPOT) read_cones(conversion->import->desc->format, from, out);
    float strength = strength_of(conversion, from);
    const float colour[3] = {from->mColorDiffuse.r, from->mColorDiffuse.g, from->mColorDiffuse.b};
    for (int c = 0; c < 3; c++) {
        out->intensity[c] = colour[c] * strength;
        if (!(out->intensity[c] >= 0 && out->intensity[c] <= LW_SCENE_RADIANCE_MAX))
            return lw_status_fail(err, LW_BAD_DATA, "its intensity is %g", (double)out->intensity[c]);
    }
    return LW_OK;
}

static enum lw_status add_light(struct conversion *conversion, const struct aiLight *from,
                                struct lw_error *err) {
    struct lw_scene *scene = conversion->import->scene;
    struct lw_light light = {0};
    bool use = false;
    uint32_t parent = lw_foreign_nodes_find(conversion->nodes, &from->mName);
    light.name = lw_foreign_import_text(conversion->import, &from->mName);
    if (!light.name) return lw_status_fail(err, LW_NO_MEMORY, "out of memory for lights");
    if (!read_light(conversion, from, &light, &use, err) && use &&
        !add_mount(conversion, parent == LW_SCENE_NONE ? 0 : parent, light.name, vec(&from->mPosition),
                   vec(&from->mDirection), vec(&from->mUp), &light.node, err))
        scene->light[scene->light_count++] = light;
    lw_status_context(err, "light \"%.80s\"", light.name);
    return err->status;
}

static enum lw_status add_camera(struct conversion *conversion, const struct aiCamera *from,
                                 struct lw_error *err) {
    struct lw_scene *scene = conversion->import->scene;
    struct lw_camera camera = {0};
    uint32_t parent = lw_foreign_nodes_find(conversion->nodes, &from->mName);
    float aspect =
        from->mAspect > 0 ? from->mAspect : 1; /* files without one mean a square, or say nothing */
    camera.name = lw_foreign_import_text(conversion->import, &from->mName);
    if (!camera.name) return lw_status_fail(err, LW_NO_MEMORY, "out of memory for cameras");
    if (!(from->mHorizontalFOV > 0)) {
        lw_foreign_import_warn(conversion->import, LW_FOREIGN_WARN_ORTHOGRAPHIC);
        return LW_OK;
    }
    float fov = fminf(from->mHorizontalFOV, FOV_MAX);
    if (conversion->import->desc->format == LW_SCENE_FORMAT_FBX && fabsf(fov - FBX_UNSAID) < 1e-7f)
        fov = FBX_FOV;
    camera.fov_y = 2 * atanf(tanf(0.5f * fov) / aspect);
    camera.fov_y = fminf(fmaxf(camera.fov_y, FOV_MIN), FOV_MAX);
    if (!add_mount(conversion, parent == LW_SCENE_NONE ? 0 : parent, camera.name, vec(&from->mPosition),
                   vec(&from->mLookAt), vec(&from->mUp), &camera.node, err))
        scene->camera[scene->camera_count++] = camera;
    lw_status_context(err, "camera \"%.80s\"", camera.name);
    return err->status;
}

/* ---- all ---- */

static enum lw_status allocate(struct conversion *conversion, size_t count, struct lw_error *err) {
    const struct aiScene *ai = conversion->import->ai;
    struct lw_scene *scene = conversion->import->scene;
    size_t meshes = ai->mNumMeshes, lights = ai->mNumLights, cameras = ai->mNumCameras;
    if (count + lights + cameras > LW_SCENE_NODES_MAX)
        return lw_status_fail(err, LW_BAD_DATA,
                              "has more than %u nodes: join what stands together into one mesh",
                              LW_SCENE_NODES_MAX);
    /* a mesh is built once for each different list of a node that begins with it */
    size_t built = count < LW_SCENE_MESHES_MAX ? count : LW_SCENE_MESHES_MAX;
    conversion->nodes->queue = malloc(count * sizeof *conversion->nodes->queue);
    conversion->nodes->by_name = malloc(count * sizeof *conversion->nodes->by_name);
    conversion->built = malloc((meshes + 1) * sizeof *conversion->built);
    conversion->mesh_of_node = malloc(count * sizeof *conversion->mesh_of_node);
    scene->node = lw_scene_alloc(scene, count + lights + cameras, sizeof *scene->node);
    scene->object = lw_scene_alloc(scene, count, sizeof *scene->object);
    scene->mesh = lw_scene_alloc(scene, built + 1, sizeof *scene->mesh);
    scene->light = lw_scene_alloc(scene, lights + 1, sizeof *scene->light);
    scene->camera = lw_scene_alloc(scene, cameras + 1, sizeof *scene->camera);
    if (!conversion->nodes->queue || !conversion->nodes->by_name || !conversion->built ||
        !conversion->mesh_of_node || !scene->node || !scene->object || !scene->mesh || !scene->light ||
        !scene->camera)
        return lw_status_fail(err, LW_NO_MEMORY, "out of memory for %zu nodes", count);
    for (size_t i = 0; i < meshes; i++) conversion->built[i] = LW_SCENE_NONE;
    conversion->nodes->queue[0] = ai->mRootNode;
    return LW_OK;
}

static enum lw_status convert(struct conversion *conversion, struct lw_error *err) {
    const struct aiScene *ai = conversion->import->ai;
    struct lw_scene *scene = conversion->import->scene;
    size_t count = count_nodes(ai->mRootNode);
    if (allocate(conversion, count, err) || add_tree(conversion, (uint32_t)count, err)) return err->status;
    for (uint32_t node = 0; node < conversion->nodes->count; node++) {
        if (scene->mesh_count >= LW_SCENE_MESHES_MAX)
            return lw_status_fail(err, LW_BAD_DATA, "has more than %u meshes", LW_SCENE_MESHES_MAX);
        if (add_object(conversion, node, err)) return err->status;
    }
    for (unsigned i = 0; i < ai->mNumLights; i++)
        if (add_light(conversion, ai->mLights[i], err)) return err->status;
    for (unsigned i = 0; i < ai->mNumCameras; i++)
        if (add_camera(conversion, ai->mCameras[i], err)) return err->status;
    return LW_OK;
}

enum lw_status lw_foreign_nodes_convert(struct lw_foreign_nodes *nodes, struct lw_foreign_import *import,
                                        struct lw_foreign_meshes *meshes, struct lw_error *err) {
    *nodes = (struct lw_foreign_nodes){0};
    struct conversion conversion = {.import = import, .meshes = meshes, .nodes = nodes};
    enum lw_status status = convert(&conversion, err);
    free(conversion.mesh_of_node);
    free(conversion.built);
    return status;
}
