#include "common/builtin/builtin_stage.h"

#include <string.h>

static void *allocate(struct lw_builtin_stage *stage, size_t count, size_t size) {
    void *memory = stage->failed ? NULL : lw_scene_alloc(stage->scene, count, size);
    if (!memory) stage->failed = true;
    return memory;
}

static const char *copy_string(struct lw_builtin_stage *stage, const char *text) {
    const char *copy = stage->failed ? NULL : lw_scene_string(stage->scene, text);
    if (!copy) stage->failed = true;
    return copy;
}

/** One more element of the list that `list_pointer` points to the pointer of, or NULL when out of memory. The
 * list doubles whenever its count is a power of two; the outgrown copies, shorter together than the last one,
 * stay with the scene. */
static void *append(struct lw_builtin_stage *stage, void *list_pointer, uint32_t *count, size_t size) {
    if (stage->failed) return NULL;
    void *list;
    memcpy(&list, list_pointer, sizeof list);
    if ((*count & (*count - 1)) == 0) {
        void *grown = allocate(stage, *count ? 2 * (size_t)*count : 1, size);
        if (!grown) return NULL;
        if (*count) memcpy(grown, list, *count * size);
        memcpy(list_pointer, &grown, sizeof grown);
        list = grown;
    }
    return (char *)list + (*count)++ * size;
}

enum lw_status lw_builtin_stage_init(struct lw_builtin_stage *stage, const char *name) {
    *stage = (struct lw_builtin_stage){0};
    if (lw_scene_create(&stage->scene) != LW_OK) return LW_NO_MEMORY;
    stage->scene->name = copy_string(stage, name);
    if (!stage->failed) return LW_OK;
    lw_scene_destroy(stage->scene);
    return LW_NO_MEMORY;
}

static void drop_unused_meshes(struct lw_builtin_stage *stage) {
    struct lw_scene *scene = stage->scene;
    uint32_t *now = allocate(stage, (size_t)scene->mesh_count + 1, sizeof *now),
             count = 0; /* first whether, then where */
    if (!now) return;
    for (uint32_t o = 0; o < scene->object_count; o++) now[scene->object[o].mesh] = 1;
    for (uint32_t m = 0; m < scene->mesh_count; m++) {
        if (!now[m]) continue;
        scene->mesh[count] = scene->mesh[m];
        now[m] = count++;
    }
    scene->mesh_count = count;
    for (uint32_t o = 0; o < scene->object_count; o++) scene->object[o].mesh = now[scene->object[o].mesh];
}

enum lw_status lw_builtin_stage_finish(struct lw_builtin_stage *stage, struct lw_scene **out_scene,
                                       struct lw_error *err) {
    if (!stage->failed) drop_unused_meshes(stage);
    enum lw_status status = stage->failed
                                ? lw_status_fail(err, LW_NO_MEMORY, "out of memory while building a scene")
                                : lw_scene_validate(stage->scene, err);
    if (status == LW_OK)
        *out_scene = stage->scene;
    else
        lw_scene_destroy(stage->scene);
    stage->scene = NULL;
    return status;
}

/** Texels of a texture that is appended to a list: lw_scene.texture or finish_texture. */
static uint8_t *add_texture(struct lw_builtin_stage *stage, void *list_pointer, uint32_t *count,
                            struct lw_texture texture, uint32_t *out_index) {
    uint8_t *rgba = allocate(stage, (size_t)texture.width * texture.height, 4);
    const char *kept_name = copy_string(stage, texture.name);
    *out_index = LW_SCENE_NONE;
    struct lw_texture *added = append(stage, list_pointer, count, sizeof *added);
    if (!added) return NULL;
    *out_index = *count - 1;
    *added = texture;
    added->name = kept_name;
    added->rgba = rgba;
    added->wrap_s = added->wrap_t = LW_WRAP_REPEAT;
    return rgba;
}

uint8_t *lw_builtin_stage_texture(struct lw_builtin_stage *stage, const char *name, uint32_t width,
                                  uint32_t height, uint32_t *out_index) {
    const struct lw_texture texture = {.name = name, .width = width, .height = height};
    return add_texture(stage, &stage->scene->texture, &stage->scene->texture_count, texture, out_index);
}

uint8_t *lw_builtin_stage_finish_texture(struct lw_builtin_stage *stage, const char *name, uint32_t width,
                                         uint32_t height, enum lw_content content, uint32_t *out_index) {
    const struct lw_texture texture = {
        .name = name, .width = width, .height = height, .content = (uint8_t)content};
    return add_texture(stage, &stage->scene->finish_texture, &stage->scene->finish_texture_count, texture,
                       out_index);
}

uint32_t lw_builtin_stage_material(struct lw_builtin_stage *stage, const char *name, struct lw_vec3 albedo,
                                   uint32_t texture) {
    const char *kept_name = copy_string(stage, name);
    struct lw_material *material =
        append(stage, &stage->scene->material, &stage->scene->material_count, sizeof *material);
    if (!material) return 0;
    *material =
        (struct lw_material){.name = kept_name,
                             .base_colour = {albedo.x, albedo.y, albedo.z, 1},
                             .base_colour_texture = {.texture = texture, .transform = {1, 0, 0, 0, 1, 0}},
                             .emission_texture = {.texture = LW_SCENE_NONE, .transform = {1, 0, 0, 0, 1, 0}},
                             .alpha_cutoff = 0.5f,
                             .alpha_mode = LW_ALPHA_OPAQUE};
    return stage->scene->material_count - 1;
}

void lw_builtin_stage_gloss(struct lw_builtin_stage *stage, uint32_t material,
                            const struct lw_finish *finish) {
    struct lw_finish *kept = allocate(stage, 1, sizeof *kept);
    if (!kept) return;
    *kept = *finish;
    stage->scene->material[material].finish = kept;
}

void lw_builtin_stage_emission(struct lw_builtin_stage *stage, uint32_t material, const float radiance[3]) {
    if (!stage->failed)
        memcpy(stage->scene->material[material].emission, radiance,
               sizeof stage->scene->material[material].emission);
}

uint32_t lw_builtin_stage_node(struct lw_builtin_stage *stage, const char *name, uint32_t parent,
                               struct lw_vec3 translation) {
    const char *kept_name = copy_string(stage, name);
    struct lw_node *node = append(stage, &stage->scene->node, &stage->scene->node_count, sizeof *node);
    if (!node) return 0;
    *node = (struct lw_node){.name = kept_name,
                             .parent = parent,
                             .translation = {translation.x, translation.y, translation.z},
                             .rotation = {0, 0, 0, 1},
                             .scale = {1, 1, 1},
                             .matrix = LW_AFFINE_IDENTITY};
    return stage->scene->node_count - 1;
}

void lw_builtin_stage_turn(struct lw_builtin_stage *stage, uint32_t node, float angle) {
    if (stage->failed) return;
    stage->scene->node[node].rotation[1] = sinf(0.5f * angle);
    stage->scene->node[node].rotation[3] = cosf(0.5f * angle);
}

static void *keep_copy(struct lw_builtin_stage *stage, const void *from, size_t count, size_t size) {
    void *to = allocate(stage, count, size);
    if (to) memcpy(to, from, count * size);
    return to;
}

static bool needs_tangents(const struct lw_builtin_stage *stage, const struct lw_builtin_mesh *mesh) {
    for (uint32_t t = 0; !stage->failed && t < mesh->triangle_count; t++) {
        const struct lw_finish *finish = stage->scene->material[mesh->triangle_material[t]].finish;
        if (finish && finish->normal_texture.texture != LW_SCENE_NONE) return true;
    }
    return false;
}

static const uint16_t *keep_tangents(struct lw_builtin_stage *stage, const struct lw_builtin_mesh *mesh) {
    if (!needs_tangents(stage, mesh)) return NULL;
    uint16_t *tangent = allocate(stage, mesh->triangle_count, 3 * sizeof *tangent);
    if (tangent) lw_builtin_mesh_tangents(mesh, tangent);
    return tangent;
}

uint32_t lw_builtin_stage_mesh(struct lw_builtin_stage *stage, const char *name,
                               struct lw_builtin_mesh *mesh) {
    stage->failed |= mesh->failed;
    struct lw_mesh kept = {.name = copy_string(stage, name),
                           .vertex_count = mesh->vertex_count,
                           .triangle_count = mesh->triangle_count};
    kept.position = keep_copy(stage, mesh->position, mesh->vertex_count, sizeof *mesh->position);
    kept.normal = keep_copy(stage, mesh->normal, mesh->vertex_count, sizeof *mesh->normal);
    kept.uv[0] = keep_copy(stage, mesh->uv, mesh->vertex_count, sizeof *mesh->uv);
    kept.triangle = keep_copy(stage, mesh->triangle, mesh->triangle_count, sizeof *mesh->triangle);
    kept.material =
        keep_copy(stage, mesh->triangle_material, mesh->triangle_count, sizeof *mesh->triangle_material);
    kept.tangent = keep_tangents(stage, mesh);
    lw_builtin_mesh_finish(mesh);
    lw_builtin_mesh_init(mesh);
    struct lw_mesh *added = append(stage, &stage->scene->mesh, &stage->scene->mesh_count, sizeof *added);
    if (!added) return 0;
    *added = kept;
    return stage->scene->mesh_count - 1;
}

void lw_builtin_stage_instance(struct lw_builtin_stage *stage, const char *name, uint32_t mesh,
                               uint32_t node) {
    const char *kept_name = copy_string(stage, name);
    struct lw_object *object =
        append(stage, &stage->scene->object, &stage->scene->object_count, sizeof *object);
    if (object) *object = (struct lw_object){.name = kept_name, .mesh = mesh, .node = node};
}

void lw_builtin_stage_object(struct lw_builtin_stage *stage, const char *name, struct lw_builtin_mesh *mesh,
                             uint32_t node) {
    uint32_t index = lw_builtin_stage_mesh(stage, name, mesh);
    lw_builtin_stage_instance(stage, name, index, node);
}

/** Turns a node so that its -Z points along `forward`, with +Y as near to up as that leaves. */
static void aim(struct lw_node *node, struct lw_vec3 forward) {
    struct lw_vec3 z = lw_vec3_normalize(lw_vec3_scale(forward, -1));
    struct lw_vec3 up = fabsf(z.y) > 0.999f ? lw_vec3(0, 0, 1) : lw_vec3(0, 1, 0);
    struct lw_vec3 x = lw_vec3_normalize(lw_vec3_cross(up, z)), y = lw_vec3_cross(z, x);
    /* columns x, y, z of a rotation to a quaternion, by its largest component (Shepperd 1978) */
    float four[4] = {1 + x.x - y.y - z.z, 1 - x.x + y.y - z.z, 1 - x.x - y.y + z.z, 1 + x.x + y.y + z.z};
    int largest = 3;
    for (int i = 0; i < 3; i++)
        if (four[i] > four[largest]) largest = i;
    float q[4][4] = {{four[0], y.x + x.y, z.x + x.z, y.z - z.y},
                     {y.x + x.y, four[1], z.y + y.z, z.x - x.z},
                     {z.x + x.z, z.y + y.z, four[2], x.y - y.x},
                     {y.z - z.y, z.x - x.z, x.y - y.x, four[3]}};
    float *row = q[largest];
    float length = sqrtf(row[0] * row[0] + row[1] * row[1] + row[2] * row[2] + row[3] * row[3]);
    for (int i = 0; i < 4; i++) node->rotation[i] = row[i] / length;
}

/** A light at a node, by whose name it goes. */
static void add_light(struct lw_builtin_stage *stage, uint32_t node, struct lw_light light) {
    struct lw_light *added = append(stage, &stage->scene->light, &stage->scene->light_count, sizeof *added);
    if (!added) return;
    *added = light;
    added->name = stage->scene->node[node].name;
    added->node = node;
}

/** A node that looks somewhere. */
static uint32_t aimed_node(struct lw_builtin_stage *stage, const char *name, uint32_t parent,
                           struct lw_vec3 position, struct lw_vec3 forward) {
    uint32_t node = lw_builtin_stage_node(stage, name, parent, position);
    if (!stage->failed) aim(&stage->scene->node[node], forward);
    return node;
}

void lw_builtin_stage_quad(struct lw_builtin_stage *stage, const char *name, uint32_t material,
                           struct lw_vec3 corner, struct lw_vec3 right, struct lw_vec3 up) {
    struct lw_builtin_mesh mesh;
    lw_builtin_mesh_init(&mesh);
    mesh.material = material;
    lw_builtin_mesh_quad(&mesh, corner, right, up, 0);
    lw_builtin_stage_object(stage, name, &mesh,
                            lw_builtin_stage_node(stage, name, LW_SCENE_NONE, lw_vec3(0, 0, 0)));
    lw_builtin_mesh_finish(&mesh);
}

void lw_builtin_stage_sun(struct lw_builtin_stage *stage, const char *name, struct lw_vec3 direction,
                          struct lw_vec3 irradiance, float angular_diameter) {
    uint32_t node = aimed_node(stage, name, LW_SCENE_NONE, lw_vec3(0, 0, 0), direction);
    add_light(stage, node,
              (struct lw_light){.kind = LW_LIGHT_DIRECTIONAL,
                                .intensity = {irradiance.x, irradiance.y, irradiance.z},
                                .angular_diameter = angular_diameter});
}

void lw_builtin_stage_point(struct lw_builtin_stage *stage, const char *name, uint32_t parent,
                            struct lw_vec3 position, struct lw_vec3 intensity) {
    uint32_t node = lw_builtin_stage_node(stage, name, parent, position);
    add_light(
        stage, node,
        (struct lw_light){.kind = LW_LIGHT_POINT, .intensity = {intensity.x, intensity.y, intensity.z}});
}

void lw_builtin_stage_spot(struct lw_builtin_stage *stage, const char *name, uint32_t parent,
                           struct lw_vec3 position, struct lw_vec3 direction, struct lw_vec3 intensity,
                           float inner_cone, float outer_cone) {
    uint32_t node = aimed_node(stage, name, parent, position, direction);
    add_light(stage, node,
              (struct lw_light){.kind = LW_LIGHT_SPOT,
                                .intensity = {intensity.x, intensity.y, intensity.z},
                                .inner_cone = inner_cone,
                                .outer_cone = outer_cone});
}

uint32_t lw_builtin_stage_camera(struct lw_builtin_stage *stage, const char *name, struct lw_vec3 eye,
                                 struct lw_vec3 target, float fov_y_deg) {
    uint32_t node = aimed_node(stage, name, LW_SCENE_NONE, eye, lw_vec3_sub(target, eye));
    struct lw_camera *camera =
        append(stage, &stage->scene->camera, &stage->scene->camera_count, sizeof *camera);
    if (camera)
        *camera = (struct lw_camera){
            .name = stage->scene->node[node].name, .node = node, .fov_y = fov_y_deg * LW_PI / 180.0f};
    return node;
}

float *lw_builtin_stage_channel(struct lw_builtin_stage *stage, uint32_t node, enum lw_channel_path path,
                                enum lw_interpolation interpolation, uint32_t key_count, float duration_s) {
    size_t width =
        (path == LW_CHANNEL_ROTATION ? 4u : 3u) * (interpolation == LW_INTERPOLATION_CUBIC ? 3u : 1u);
    float *time_s = allocate(stage, key_count, sizeof *time_s),
          *value = allocate(stage, key_count * width, sizeof *value);
    struct lw_channel *channel =
        append(stage, &stage->scene->channel, &stage->scene->channel_count, sizeof *channel);
    if (!channel) return NULL;
    for (uint32_t i = 0; i < key_count; i++) time_s[i] = duration_s * (float)i / (float)(key_count - 1);
    *channel = (struct lw_channel){.node = node,
                                   .path = (uint8_t)path,
                                   .interpolation = (uint8_t)interpolation,
                                   .key_count = key_count,
                                   .time_s = time_s,
                                   .value = value};
    if (duration_s > stage->scene->duration_s) stage->scene->duration_s = duration_s;
    return value;
}
