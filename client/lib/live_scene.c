#include "client/lib/live_scene.h"

#include "client/lib/live_error.h"
#include "common/base/invariant.h"
#include "common/shading/tangent.h"

#include <float.h>
#include <stdlib.h>
#include <string.h>

/* ---- checks of each getter ---- */

static enum lw_live_status no_scene(struct lw_live_error *err) {
    return lw_live_fail(err, LW_LIVE_NOT_READY, "the scene has not arrived yet");
}

static enum lw_live_status check_index(const struct lw_live *live, const char *what, uint32_t index,
                                       uint32_t count, struct lw_live_error *err) {
    if (!live->scene) return no_scene(err);
    if (index >= count) return lw_live_fail(err, LW_LIVE_USAGE, "%s %u of %u", what, index, count);
    return LW_LIVE_OK;
}

/* Begins a getter: locks, and checks its index; count: member of struct lw_scene. */
#define BEGIN(live, what, index, count)                                                                      \
    if (!(live)) return lw_live_fail(err, LW_LIVE_USAGE, "live is NULL");                                    \
    lw_live_lock(live);                                                                                      \
    const struct lw_scene *scene = (live)->scene;                                                            \
    enum lw_live_status result = check_index(live, what, index, scene ? scene->count : 0, err);              \
    if (result != LW_LIVE_OK) {                                                                              \
        lw_live_unlock(live);                                                                                \
        return result;                                                                                       \
    }

#define END(live, out, value, name)                                                                          \
    lw_live_unlock(live);                                                                                    \
    return lw_live_write_struct(out, &value, sizeof value)                                                   \
               ? LW_LIVE_OK                                                                                  \
               : lw_live_fail(err, LW_LIVE_USAGE, name ": struct_size is not sizeof it");

static void to_floats(float *out, struct lw_vec3 v) {
    out[0] = v.x;
    out[1] = v.y;
    out[2] = v.z;
}

static struct lw_vec3 from_floats(const float *v) { return lw_vec3(v[0], v[1], v[2]); }

/* ---- getters ---- */

enum lw_live_status lw_live_get_scene(const struct lw_live *live, struct lw_live_scene *out_scene,
                                      struct lw_live_error *err) {
    if (!live) return lw_live_fail(err, LW_LIVE_USAGE, "live is NULL");
    lw_live_lock(live);
    const struct lw_scene *s = live->scene;
    if (!s) {
        lw_live_unlock(live);
        return no_scene(err);
    }
    struct lw_live_scene of = {.name = s->name,
                               .object_count = s->object_count,
                               .mesh_count = s->mesh_count,
                               .node_count = s->node_count,
                               .material_count = s->material_count,
                               .texture_count = s->texture_count,
                               .light_count = s->light_count,
                               .camera_count = s->camera_count,
                               .duration_s = s->duration_s,
                               .sky = {s->sky[0], s->sky[1], s->sky[2]},
                               .environment_width = s->environment.width,
                               .environment_height = s->environment.height,
                               .environment = s->environment.rgb,
                               .finish_texture_count = s->finish_texture_count};
    END(live, out_scene, of, "lw_live_scene")
}

enum lw_live_status lw_live_get_object(const struct lw_live *live, uint32_t object,
                                       struct lw_live_object *out_object, struct lw_live_error *err) {
    BEGIN(live, "object", object, object_count)
    const struct lw_object *o = &scene->object[object];
    struct lw_live_object of = {.name = o->name,
                                .mesh = o->mesh,
                                .node = o->node == LW_SCENE_NONE ? LW_LIVE_NONE : o->node,
                                .level_count = live->tiles.map->atlas[object]->level_count,
                                .state =
                                    (enum lw_live_object_state)lw_client_object_state(live->client, object),
                                .is_drawn = !lw_client_object_hidden(live->client, object)};
    memcpy(of.object_to_world, lw_client_object_to_world(live->client, object)->m, sizeof of.object_to_world);
    END(live, out_object, of, "lw_live_object")
}

enum lw_live_status lw_live_get_mesh(const struct lw_live *live, uint32_t mesh, struct lw_live_mesh *out_mesh,
                                     struct lw_live_error *err) {
    BEGIN(live, "mesh", mesh, mesh_count)
    const struct lw_mesh *m = &scene->mesh[mesh];
    struct lw_live_mesh of = {.name = m->name,
                              .vertex_count = m->vertex_count,
                              .triangle_count = m->triangle_count,
                              .position = &m->position->x,
                              .normal = &m->normal->x,
                              .uv = {m->uv[0] ? &m->uv[0]->x : NULL, m->uv[1] ? &m->uv[1]->x : NULL},
                              .colour = m->colour ? &m->colour->x : NULL,
                              .triangle = *m->triangle,
                              .material = m->material,
                              .lightmap_uv = m->lightmap_uv ? &m->lightmap_uv->x : NULL,
                              .atlas_width = m->atlas_width,
                              .atlas_height = m->atlas_height,
                              .back_offset = m->back_offset,
                              .tangent = m->tangent};
    END(live, out_mesh, of, "lw_live_mesh")
}

enum lw_live_status lw_live_get_node(const struct lw_live *live, uint32_t node, struct lw_live_node *out_node,
                                     struct lw_live_error *err) {
    BEGIN(live, "node", node, node_count)
    const struct lw_node *n = &scene->node[node];
    struct lw_live_node of = {.name = n->name,
                              .parent = n->parent == LW_SCENE_NONE ? LW_LIVE_NONE : n->parent};
    END(live, out_node, of, "lw_live_node")
}

static struct lw_live_texture_use texture_use(const struct lw_texture_use *use) {
    struct lw_live_texture_use of = {.texture = use->texture == LW_SCENE_NONE ? LW_LIVE_NONE : use->texture,
                                     .uv_set = use->uv_set};
    memcpy(of.transform, use->transform, sizeof of.transform);
    return of;
}

static void add_finish(struct lw_live_material *of, const struct lw_finish *f) {
    of->has_finish = 1;
    of->metalness = f->metalness;
    of->roughness = f->roughness;
    of->surface_texture = texture_use(&f->surface_texture);
    of->specular = f->specular;
    memcpy(of->specular_colour, f->specular_colour, sizeof of->specular_colour);
    of->specular_texture = texture_use(&f->specular_texture);
    of->ior = f->ior;
    of->occlusion = f->occlusion;
    of->occlusion_texture = texture_use(&f->occlusion_texture);
    of->normal_scale = f->normal_scale;
    of->normal_texture = texture_use(&f->normal_texture);
}

void lw_live_tangent(uint16_t code, const float *normal, float *out_tangent) {
    const struct lw_vec4 t = lw_tangent_decode(code, from_floats(normal));
    memcpy(out_tangent, &t, sizeof t);
}

enum lw_live_status lw_live_get_material(const struct lw_live *live, uint32_t material,
                                         struct lw_live_material *out_material, struct lw_live_error *err) {
    BEGIN(live, "material", material, material_count)
    const struct lw_material *m = &scene->material[material];
    const struct lw_client_draws *draws = lw_client_draws(live->client);
    struct lw_live_material of = {.name = m->name,
                                  .base_colour_texture = texture_use(&m->base_colour_texture),
                                  .emission_texture = texture_use(&m->emission_texture),
                                  .alpha = (enum lw_live_alpha)m->alpha_mode,
                                  .alpha_cutoff = m->alpha_cutoff,
                                  .is_double_sided = m->double_sided,
                                  .is_client_light = draws && draws->material[material],
                                  .is_unlit = m->unlit};
    if (m->finish) add_finish(&of, m->finish);
    to_floats(of.tint, lw_material_tint(m, lw_vec3(1, 1, 1)));
    memcpy(of.base_colour, m->base_colour, sizeof of.base_colour);
    memcpy(of.emission, m->emission, sizeof of.emission);
    to_floats(of.first_emission, lw_client_own_emission(live->client, material));
    END(live, out_material, of, "lw_live_material")
}

static struct lw_live_texture live_texture(const struct lw_texture *t) {
    return (struct lw_live_texture){.name = t->name,
                                    .width = t->width,
                                    .height = t->height,
                                    .rgba = t->rgba,
                                    .wrap_s = (enum lw_live_wrap)t->wrap_s,
                                    .wrap_t = (enum lw_live_wrap)t->wrap_t,
                                    .content = (enum lw_live_content)t->content};
}

enum lw_live_status lw_live_get_finish_texture(const struct lw_live *live, uint32_t texture,
                                               struct lw_live_texture *out_texture,
                                               struct lw_live_error *err) {
    BEGIN(live, "texture of finishes", texture, finish_texture_count)
    struct lw_live_texture of = live_texture(&scene->finish_texture[texture]);
    END(live, out_texture, of, "lw_live_texture")
}

enum lw_live_status lw_live_get_texture(const struct lw_live *live, uint32_t texture,
                                        struct lw_live_texture *out_texture, struct lw_live_error *err) {
    BEGIN(live, "texture", texture, texture_count)
    struct lw_live_texture of = live_texture(&scene->texture[texture]);
    END(live, out_texture, of, "lw_live_texture")
}

enum lw_live_status lw_live_get_light(const struct lw_live *live, uint32_t light,
                                      struct lw_live_light *out_light, struct lw_live_error *err) {
    BEGIN(live, "light", light, light_count)
    const struct lw_light *l = &scene->light[light];
    const struct lw_client_light now = lw_client_get_light(live->client, light);
    const struct lw_client_draws *draws = lw_client_draws(live->client);
    struct lw_live_light of = {.name = l->name,
                               .kind = (enum lw_live_light_kind)l->kind,
                               .inner_cone = l->inner_cone,
                               .outer_cone = l->outer_cone,
                               .angular_diameter = l->angular_diameter,
                               .is_client_light = draws && draws->light[light]};
    to_floats(of.position_ws, now.position_ws);
    to_floats(of.direction_ws, now.direction_ws);
    to_floats(of.intensity, now.intensity);
    END(live, out_light, of, "lw_live_light")
}

_Static_assert((int)LW_LIVE_LIGHT_DIRECTIONAL == LW_LIGHT_DIRECTIONAL &&
                   (int)LW_LIVE_LIGHT_SPOT == LW_LIGHT_SPOT && (int)LW_LIVE_WRAP_MIRROR == LW_WRAP_MIRROR &&
                   (int)LW_LIVE_WRAP_CLAMP == LW_WRAP_CLAMP && (int)LW_LIVE_ALPHA_BLEND == LW_ALPHA_BLEND &&
                   (int)LW_LIVE_ALPHA_MASK == LW_ALPHA_MASK &&
                   (int)LW_LIVE_CONTENT_NORMAL == LW_CONTENT_NORMAL &&
                   (int)LW_LIVE_CONTENT_SURFACE == LW_CONTENT_SURFACE &&
                   (int)LW_LIVE_OBJECT_SPARE == LW_CLIENT_OBJECT_SPARE &&
                   (int)LW_LIVE_OBJECT_HIDDEN == LW_CLIENT_OBJECT_HIDDEN,
               "ours and the public ones are the same numbers");

enum lw_live_status lw_live_get_camera(const struct lw_live *live, uint32_t camera,
                                       struct lw_live_camera *out_camera, struct lw_live_error *err) {
    BEGIN(live, "camera", camera, camera_count)
    struct lw_client_stats stats;
    lw_client_get_stats(live->client, &stats);
    struct lw_pose *pose = &((struct lw_live *)live)->cameras;
    lw_pose_evaluate(pose, scene, stats.time_s);
    const struct lw_camera *c = &scene->camera[camera];
    const struct lw_affine *to_world = &pose->node_to_world[c->node];
    const struct lw_vec3 forward = lw_vec3_normalize(lw_affine_vector(to_world, lw_vec3(0, 0, -1)));
    /* A node may be sheared or mirrored; the picture must be neither. */
    struct lw_vec3 right = lw_vec3_cross(forward, lw_affine_vector(to_world, lw_vec3(0, 1, 0))), unused;
    if (lw_vec3_length(right) > 1e-12f)
        right = lw_vec3_normalize(right);
    else
        lw_vec3_frame(forward, &right, &unused);
    struct lw_live_camera of = {.name = c->name, .fov_y = c->fov_y, .height_m = c->height_m};
    to_floats(of.position_ws, lw_affine_point(to_world, lw_vec3(0, 0, 0)));
    to_floats(of.right_ws, right);
    to_floats(of.up_ws, lw_vec3_cross(right, forward));
    to_floats(of.forward_ws, forward);
    END(live, out_camera, of, "lw_live_camera")
}

/* ---- names ---- */

static uint32_t count_of(const struct lw_scene *s, enum lw_live_kind kind) {
    const uint32_t count[LW_LIVE_KINDS] = {s->object_count,   s->node_count,    s->mesh_count,
                                           s->material_count, s->texture_count, s->light_count,
                                           s->camera_count};
    return count[kind];
}

static const char *name_of(const struct lw_scene *s, enum lw_live_kind kind, uint32_t index) {
    switch (kind) {
    case LW_LIVE_KIND_OBJECT:
        return s->object[index].name;
    case LW_LIVE_KIND_NODE:
        return s->node[index].name;
    case LW_LIVE_KIND_MESH:
        return s->mesh[index].name;
    case LW_LIVE_KIND_MATERIAL:
        return s->material[index].name;
    case LW_LIVE_KIND_TEXTURE:
        return s->texture[index].name;
    case LW_LIVE_KIND_LIGHT:
        return s->light[index].name;
    default:
        return s->camera[index].name;
    }
}

struct named {
    const struct lw_scene *scene;
    enum lw_live_kind kind;
};

static int by_name(const void *a, const void *b, void *context) {
    const struct named *of = context;
    const uint32_t i = *(const uint32_t *)a, j = *(const uint32_t *)b;
    const int order = strcmp(name_of(of->scene, of->kind, i), name_of(of->scene, of->kind, j));
    return order ? order : (i > j) - (i < j);
}

uint32_t lw_live_find(const struct lw_live *live, enum lw_live_kind kind, const char *name, uint32_t nth) {
    if (!live || !name || (unsigned)kind >= LW_LIVE_KINDS) return LW_LIVE_NONE;
    lw_live_lock(live);
    uint32_t found = LW_LIVE_NONE;
    if (live->scene) {
        const uint32_t *sorted = live->by_name[kind], count = count_of(live->scene, kind);
        uint32_t low = 0, high = count; /* the first whose name is not less */
        while (low < high) {
            const uint32_t middle = low + (high - low) / 2;
            if (strcmp(name_of(live->scene, kind, sorted[middle]), name) < 0)
                low = middle + 1;
            else
                high = middle;
        }
        if (nth < count - low && !strcmp(name_of(live->scene, kind, sorted[low + nth]), name))
            found = sorted[low + nth];
    }
    lw_live_unlock(live);
    return found;
}

/* ---- once the scene is there ---- */

/* By name, then by index: each once. */
static bool is_in_order(struct named *of, const uint32_t *index, uint32_t count) {
    for (uint32_t i = 1; i < count; i++)
        if (by_name(&index[i - 1], &index[i], of) >= 0) return false;
    return true;
}

enum lw_status lw_live_scene_init(struct lw_live *live, const struct lw_scene *scene) {
    for (unsigned k = 0; k < LW_LIVE_KINDS; k++) {
        struct named of = {scene, (enum lw_live_kind)k};
        const uint32_t count = count_of(scene, of.kind);
        uint32_t *index = live->by_name[k] = malloc(((size_t)count + 1) * sizeof *index);
        if (!index) return LW_NO_MEMORY;
        for (uint32_t i = 0; i < count; i++) index[i] = i;
        qsort_r(index, count, sizeof *index, by_name, &of);
        LW_INVARIANT_DEAR(is_in_order(&of, index, count));
    }
    live->mesh_box = malloc(((size_t)scene->mesh_count + 1) * sizeof *live->mesh_box);
    if (!live->mesh_box) return LW_NO_MEMORY;
    for (uint32_t i = 0; i < scene->mesh_count; i++) {
        struct lw_vec3 *box = live->mesh_box[i];
        box[0] = lw_vec3(FLT_MAX, FLT_MAX, FLT_MAX);
        box[1] = lw_vec3(-FLT_MAX, -FLT_MAX, -FLT_MAX);
        for (uint32_t v = 0; v < scene->mesh[i].vertex_count; v++) {
            box[0] = lw_vec3_min(box[0], scene->mesh[i].position[v]);
            box[1] = lw_vec3_max(box[1], scene->mesh[i].position[v]);
        }
    }
    enum lw_status status = lw_pose_init(&live->cameras, scene);
    live->has_cameras = status == LW_OK;
    return status;
}

void lw_live_scene_finish(struct lw_live *live) {
    for (unsigned k = 0; k < LW_LIVE_KINDS; k++) free(live->by_name[k]);
    free(live->mesh_box);
    if (live->has_cameras) lw_pose_finish(&live->cameras);
    memset(live->by_name, 0, sizeof live->by_name);
    live->mesh_box = NULL;
    live->has_cameras = false;
}

/* ---- a ray ---- */

struct ray {
    struct lw_vec3 origin, direction; /* object space; t is the same as in world space */
    bool is_mirrored;
};

/* false: the object has no volume to turn the ray into. */
static bool into_object(const struct lw_affine *to_world, struct lw_vec3 origin, struct lw_vec3 direction,
                        struct ray *out) {
    const float determinant = lw_affine_determinant(to_world);
    if (!(fabsf(determinant) > FLT_MIN)) return false;
    const float(*m)[4] = to_world->m;
    const struct lw_vec3 x = lw_vec3(m[0][0], m[1][0], m[2][0]), y = lw_vec3(m[0][1], m[1][1], m[2][1]),
                         z = lw_vec3(m[0][2], m[1][2], m[2][2]);
    const struct lw_vec3 row[3] = {lw_vec3_cross(y, z), lw_vec3_cross(z, x), lw_vec3_cross(x, y)};
    const struct lw_vec3 from = lw_vec3_sub(origin, lw_vec3(m[0][3], m[1][3], m[2][3]));
    const float scale = 1 / determinant;
    out->origin = lw_vec3_scale(
        lw_vec3(lw_vec3_dot(row[0], from), lw_vec3_dot(row[1], from), lw_vec3_dot(row[2], from)), scale);
    out->direction = lw_vec3_scale(lw_vec3(lw_vec3_dot(row[0], direction), lw_vec3_dot(row[1], direction),
                                           lw_vec3_dot(row[2], direction)),
                                   scale);
    out->is_mirrored = determinant < 0;
    return true;
}

static bool meets_box(const struct ray *ray, const struct lw_vec3 box[2], float t_max) {
    const float o[3] = {ray->origin.x, ray->origin.y, ray->origin.z},
                d[3] = {ray->direction.x, ray->direction.y, ray->direction.z},
                low[3] = {box[0].x, box[0].y, box[0].z}, high[3] = {box[1].x, box[1].y, box[1].z};
    float near = 0, far = t_max;
    for (int i = 0; i < 3; i++) {
        if (d[i] == 0) {
            if (o[i] < low[i] || o[i] > high[i]) return false;
            continue;
        }
        const float a = (low[i] - o[i]) / d[i], b = (high[i] - o[i]) / d[i];
        near = fmaxf(near, fminf(a, b));
        far = fminf(far, fmaxf(a, b));
    }
    return near <= far * (1 + 4 * FLT_EPSILON);
}

struct meeting {
    uint32_t triangle;
    float t, u, v;
    bool is_back;
};

/* Moeller and Trumbore 1997. The back of a single-sided triangle is not there, as in glTF. */
static bool meets_triangle(const struct ray *ray, const struct lw_scene *scene, const struct lw_mesh *mesh,
                           uint32_t triangle, struct meeting *nearest) {
    const uint32_t *i = mesh->triangle[triangle];
    const struct lw_vec3 a = mesh->position[i[0]], ab = lw_vec3_sub(mesh->position[i[1]], a),
                         ac = lw_vec3_sub(mesh->position[i[2]], a);
    const struct lw_vec3 p = lw_vec3_cross(ray->direction, ac);
    const float determinant = lw_vec3_dot(ab, p);
    const bool is_back = (determinant < 0) != ray->is_mirrored;
    if (determinant == 0 || (is_back && !scene->material[mesh->material[triangle]].double_sided))
        return false;
    const struct lw_vec3 from = lw_vec3_sub(ray->origin, a), q = lw_vec3_cross(from, ab);
    const float u = lw_vec3_dot(from, p) / determinant, v = lw_vec3_dot(ray->direction, q) / determinant,
                t = lw_vec3_dot(ac, q) / determinant;
    if (!(u >= 0 && v >= 0 && u + v <= 1 && t > 0 && t < nearest->t)) return false;
    *nearest = (struct meeting){triangle, t, u, v, is_back};
    return true;
}

static struct lw_live_hit cast(const struct lw_live *live, struct lw_vec3 origin, struct lw_vec3 direction) {
    struct lw_live_hit hit = {.object = LW_LIVE_NONE};
    struct meeting nearest = {.t = FLT_MAX};
    const struct lw_scene *scene = live->scene;
    for (uint32_t o = 0; o < scene->object_count; o++) {
        const struct lw_mesh *mesh = &scene->mesh[scene->object[o].mesh];
        struct ray ray;
        if (lw_client_object_hidden(live->client, o) ||
            !into_object(lw_client_object_to_world(live->client, o), origin, direction, &ray) ||
            !meets_box(&ray, live->mesh_box[scene->object[o].mesh], nearest.t))
            continue;
        for (uint32_t t = 0; t < mesh->triangle_count; t++)
            if (meets_triangle(&ray, scene, mesh, t, &nearest)) hit.object = o;
    }
    if (hit.object == LW_LIVE_NONE) return hit;
    hit.triangle = nearest.triangle;
    hit.distance = nearest.t;
    to_floats(hit.position_ws, lw_vec3_mad(origin, direction, nearest.t));
    const struct lw_mesh *mesh = &scene->mesh[scene->object[hit.object].mesh];
    const uint32_t *i = mesh->triangle[nearest.triangle];
    if (mesh->lightmap_uv) {
        const struct lw_vec2 *uv = mesh->lightmap_uv;
        const float w = 1 - nearest.u - nearest.v;
        hit.lightmap_uv[0] = w * uv[i[0]].x + nearest.u * uv[i[1]].x + nearest.v * uv[i[2]].x;
        hit.lightmap_uv[1] = w * uv[i[0]].y + nearest.u * uv[i[1]].y + nearest.v * uv[i[2]].y +
                             (nearest.is_back ? (float)mesh->back_offset : 0);
    }
    return hit;
}

enum lw_live_status lw_live_cast(const struct lw_live *live, const float *origin_ws,
                                 const float *direction_ws, struct lw_live_hit *out_hit,
                                 struct lw_live_error *err) {
    if (!live || !origin_ws || !direction_ws)
        return lw_live_fail(err, LW_LIVE_USAGE, "live, origin_ws or direction_ws is NULL");
    const struct lw_vec3 origin = from_floats(origin_ws), direction = from_floats(direction_ws);
    if (!lw_vec3_is_finite(origin) || !lw_vec3_is_finite(direction) || lw_vec3_max_abs(direction) == 0)
        return lw_live_fail(err, LW_LIVE_USAGE, "the ray has no direction, or is not finite");
    lw_live_lock(live);
    if (!live->scene) {
        lw_live_unlock(live);
        return no_scene(err);
    }
    struct lw_live_hit hit = cast(live, origin, direction);
    END(live, out_hit, hit, "lw_live_hit")
}
