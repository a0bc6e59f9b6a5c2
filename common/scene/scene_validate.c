#include "common/scene/pose.h"
#include "common/scene/scene.h"

#include <stdarg.h>
#include <stdio.h>
#include <stdlib.h>

/* Exporters round; a length this far from 1 is not rounding. */
#define UNIT_TOLERANCE 0.01f

/* One channel's. Blue has the least share of luminance, 0.0722: all of it in blue is 13.9. */
#define TINT_MAX 14.0f

/* Names come from outside and their messages end on a terminal: no control characters, bounded length. */
#define NAME_SHOWN_SIZE 65

/* The element under check, for the message. */
struct element {
    struct lw_error *err;
    const char *kind;
    uint32_t index; /* LW_SCENE_NONE: the only one of its kind */
    const char *name;
};

static void make_printable(const char *name, char out[NAME_SHOWN_SIZE]) {
    size_t i = 0;
    for (; name[i] && i + 1 < NAME_SHOWN_SIZE; i++)
        out[i] = (unsigned char)name[i] < 0x20 || name[i] == 0x7f ? '?' : name[i];
    while (i > 0 && ((unsigned char)name[i] & 0xC0) == 0x80) i--; /* cut between characters, not inside one */
    out[i] = 0;
}

static enum lw_status LW_PRINTF(2, 3) refuse(const struct element *e, const char *format, ...) {
    char text[256], name[NAME_SHOWN_SIZE];
    va_list args;
    va_start(args, format);
    vsnprintf(text, sizeof text, format, args);
    va_end(args);
    if (e->index == LW_SCENE_NONE) return lw_status_fail(e->err, LW_BAD_DATA, "%s: %s", e->kind, text);
    if (!e->name || !*e->name)
        return lw_status_fail(e->err, LW_BAD_DATA, "%s %u: %s", e->kind, e->index, text);
    make_printable(e->name, name);
    return lw_status_fail(e->err, LW_BAD_DATA, "%s %u \"%s\": %s", e->kind, e->index, name, text);
}

/* Length of the UTF-8 sequence at p (RFC 3629: shortest form, no surrogates, up to U+10FFFF); 0 if it is
 * none. A terminating NUL is no continuation byte, so nothing past it is read. */
static size_t utf8_length(const unsigned char *p) {
    if (p[0] < 0x80) return 1;
    size_t length = p[0] >= 0xC2 && p[0] <= 0xDF   ? 2
                    : (p[0] & 0xF0) == 0xE0        ? 3
                    : p[0] >= 0xF0 && p[0] <= 0xF4 ? 4
                                                   : 0;
    for (size_t i = 1; i < length; i++)
        if ((p[i] & 0xC0) != 0x80) return 0;
    if (p[0] == 0xE0 && p[1] < 0xA0) return 0;
    if (p[0] == 0xED && p[1] > 0x9F) return 0;
    if (p[0] == 0xF0 && p[1] < 0x90) return 0;
    if (p[0] == 0xF4 && p[1] > 0x8F) return 0;
    return length;
}

static enum lw_status check_name(struct element *e, const char *name) {
    if (!name) return refuse(e, "name is NULL; a nameless one has \"\"");
    for (const unsigned char *p = (const unsigned char *)name; *p;) {
        size_t length = utf8_length(p);
        if (length == 0) return refuse(e, "name is not UTF-8");
        p += length;
    }
    e->name = name; /* from here on messages may show it */
    return LW_OK;
}

/* Index of the first float that is not finite, or count. Blocks are tested as a whole first, which
 * vectorises. */
static size_t find_not_finite(const float *x, size_t count) {
    enum { BLOCK = 1024 };
    for (size_t start = 0; start < count; start += BLOCK) {
        size_t end = count - start < BLOCK ? count : start + BLOCK;
        unsigned bad = 0;
        for (size_t i = start; i < end; i++) bad |= !isfinite(x[i]);
        if (!bad) continue;
        for (size_t i = start; i < end; i++)
            if (!isfinite(x[i])) return i;
    }
    return count;
}

/* Checks `count` elements of `width` floats each. */
static enum lw_status check_finite(const struct element *e, const char *field, const void *array,
                                   size_t count, size_t width) {
    size_t i = find_not_finite(array, count * width);
    if (i < count * width) return refuse(e, "%s of entry %zu is not a finite number", field, i / width);
    return LW_OK;
}

/* Finite and within +-limit. */
static enum lw_status check_magnitude(const struct element *e, const char *field, const float *x,
                                      size_t count, float limit) {
    for (size_t i = 0; i < count; i++)
        if (!(fabsf(x[i]) <= limit))
            return refuse(e, "%s component %zu is %g; it must be finite and within +-%g", field, i,
                          (double)x[i], (double)limit);
    return LW_OK;
}

/* Finite and within [low, high]. */
static enum lw_status check_range(const struct element *e, const char *field, const float *x, size_t count,
                                  float low, float high) {
    for (size_t i = 0; i < count; i++)
        if (!(x[i] >= low && x[i] <= high))
            return refuse(e, "%s is %g; it must be within [%g, %g]", field, (double)x[i], (double)low,
                          (double)high);
    return LW_OK;
}

static bool is_unit(float length_squared) {
    return length_squared >= (1 - UNIT_TOLERANCE) * (1 - UNIT_TOLERANCE) &&
           length_squared <= (1 + UNIT_TOLERANCE) * (1 + UNIT_TOLERANCE);
}

static bool is_unit_quaternion(const float q[4]) {
    return is_unit(q[0] * q[0] + q[1] * q[1] + q[2] * q[2] + q[3] * q[3]);
}

static enum lw_status check_counts(const struct lw_scene *scene, struct lw_error *err) {
    const struct {
        const char *what;
        uint32_t count, limit;
        const void *array;
    } lists[] = {
        {"meshes", scene->mesh_count, LW_SCENE_MESHES_MAX, scene->mesh},
        {"materials", scene->material_count, LW_SCENE_MATERIALS_MAX, scene->material},
        {"textures", scene->texture_count, LW_SCENE_TEXTURES_MAX, scene->texture},
        {"textures of finishes", scene->finish_texture_count, LW_SCENE_TEXTURES_MAX, scene->finish_texture},
        {"nodes", scene->node_count, LW_SCENE_NODES_MAX, scene->node},
        {"objects", scene->object_count, LW_SCENE_OBJECTS_MAX, scene->object},
        {"lights", scene->light_count, LW_SCENE_LIGHTS_MAX, scene->light},
        {"cameras", scene->camera_count, LW_SCENE_CAMERAS_MAX, scene->camera},
        {"channels", scene->channel_count, LW_SCENE_CHANNELS_MAX, scene->channel},
        {"channels of lights", scene->light_channel_count, LW_SCENE_CHANNELS_MAX, scene->light_channel},
    };
    for (size_t i = 0; i < sizeof lists / sizeof *lists; i++) {
        if (lists[i].count > lists[i].limit)
            return lw_status_fail(err, LW_BAD_DATA, "scene has %u %s; the limit is %u", lists[i].count,
                                  lists[i].what, lists[i].limit);
        if (lists[i].count > 0 && !lists[i].array)
            return lw_status_fail(err, LW_BAD_DATA, "scene has %u %s but no array of them", lists[i].count,
                                  lists[i].what);
    }
    return LW_OK;
}

static enum lw_status check_texture(const struct lw_texture *texture, struct element *e) {
    enum lw_status status = check_name(e, texture->name);
    if (status) return status;
    if (texture->width < 1 || texture->width > LW_SCENE_TEXTURE_SIDE_MAX || texture->height < 1 ||
        texture->height > LW_SCENE_TEXTURE_SIDE_MAX)
        return refuse(e, "size %ux%u; each side must be within [1, %u]", texture->width, texture->height,
                      LW_SCENE_TEXTURE_SIDE_MAX);
    if (!texture->rgba) return refuse(e, "has no pixels");
    if (texture->wrap_s > LW_WRAP_MIRROR) return refuse(e, "wrap_s %u is no wrap mode", texture->wrap_s);
    if (texture->wrap_t > LW_WRAP_MIRROR) return refuse(e, "wrap_t %u is no wrap mode", texture->wrap_t);
    if (texture->content > LW_CONTENT_SURFACE) return refuse(e, "content %u is none", texture->content);
    return LW_OK;
}

static enum lw_status check_texture_place(const struct lw_texture_use *use, const struct element *e,
                                          const char *field) {
    if (use->uv_set > 1) return refuse(e, "%s uses UV set %u; there are sets 0 and 1", field, use->uv_set);
    if (find_not_finite(use->transform, 6) < 6)
        return refuse(e, "%s has a transform that is not finite", field);
    return LW_OK;
}

static enum lw_status check_texture_use(const struct lw_scene *scene, const struct lw_texture_use *use,
                                        const struct element *e, const char *field) {
    if (use->texture != LW_SCENE_NONE && use->texture >= scene->texture_count)
        return refuse(e, "%s names texture %u of %u", field, use->texture, scene->texture_count);
    return check_texture_place(use, e, field);
}

static enum lw_status check_finish_texture_use(const struct lw_scene *scene, const struct lw_texture_use *use,
                                               enum lw_content content, const struct element *e,
                                               const char *field) {
    if (use->texture != LW_SCENE_NONE) {
        if (use->texture >= scene->finish_texture_count)
            return refuse(e, "%s names texture %u of %u", field, use->texture, scene->finish_texture_count);
        if (scene->finish_texture[use->texture].content != content)
            return refuse(e, "%s names texture %u, whose content is %u, not %u", field, use->texture,
                          scene->finish_texture[use->texture].content, content);
    }
    return check_texture_place(use, e, field);
}

static enum lw_status check_finish(const struct lw_scene *scene, const struct lw_finish *finish,
                                   const struct element *e) {
    const struct {
        const char *name;
        const float *value;
        size_t count;
        float low, high;
    } number[] = {
        {"metalness", &finish->metalness, 1, 0, 1},
        {"roughness", &finish->roughness, 1, 0, 1},
        {"specular", &finish->specular, 1, 0, 1},
        {"specular_colour", finish->specular_colour, 3, 0, LW_SCENE_RADIANCE_MAX},
        {"ior", &finish->ior, 1, 1, LW_SCENE_RADIANCE_MAX},
        {"occlusion", &finish->occlusion, 1, 0, 1},
        {"normal_scale", &finish->normal_scale, 1, -LW_SCENE_RADIANCE_MAX, LW_SCENE_RADIANCE_MAX},
    };
    const struct {
        const char *name;
        const struct lw_texture_use *use;
        enum lw_content content;
    } texture[] = {
        {"surface_texture", &finish->surface_texture, LW_CONTENT_SURFACE},
        {"specular_texture", &finish->specular_texture, LW_CONTENT_COLOUR},
        {"occlusion_texture", &finish->occlusion_texture, LW_CONTENT_SURFACE},
        {"normal_texture", &finish->normal_texture, LW_CONTENT_NORMAL},
    };
    enum lw_status status = LW_OK;
    for (size_t i = 0; i < sizeof number / sizeof *number && !status; i++)
        status =
            check_range(e, number[i].name, number[i].value, number[i].count, number[i].low, number[i].high);
    for (size_t i = 0; i < sizeof texture / sizeof *texture && !status; i++)
        status = check_finish_texture_use(scene, texture[i].use, texture[i].content, e, texture[i].name);
    return status;
}

static enum lw_status check_material(const struct lw_scene *scene, const struct lw_material *material,
                                     struct element *e) {
    enum lw_status status = check_name(e, material->name);
    if (!status) status = check_range(e, "base_colour", material->base_colour, 4, 0, LW_SCENE_RADIANCE_MAX);
    if (!status) status = check_texture_use(scene, &material->base_colour_texture, e, "base_colour_texture");
    if (!status) status = check_range(e, "emission", material->emission, 3, 0, LW_SCENE_RADIANCE_MAX);
    if (!status) status = check_texture_use(scene, &material->emission_texture, e, "emission_texture");
    if (!status)
        status = check_range(e, "alpha_cutoff", &material->alpha_cutoff, 1, 0, LW_SCENE_RADIANCE_MAX);
    if (status) return status;
    if (material->alpha_mode > LW_ALPHA_BLEND)
        return refuse(e, "alpha_mode %u is none", material->alpha_mode);
    if (material->drawn_by > LW_DRAWN_BY_SERVER)
        return refuse(e, "drawn_by is %u, not 0, 1 or 2", material->drawn_by);
    if (material->double_sided > 1)
        return refuse(e, "double_sided is %u, not 0 or 1", material->double_sided);
    if (material->unlit > 1) return refuse(e, "unlit is %u, not 0 or 1", material->unlit);
    if (material->unlit && lw_material_shines(material)) return refuse(e, "is unlit, and has an emission");
    if (lw_material_tints(material) && material->alpha_mode != LW_ALPHA_BLEND)
        return refuse(e, "has a tint, but lets no light pass: its alpha mode is not blend");
    return check_range(e, "tint", material->tint, 3, 0, TINT_MAX);
}

static enum lw_status check_triangles(const struct lw_scene *scene, const struct lw_mesh *mesh,
                                      const struct element *e) {
    for (uint32_t t = 0; t < mesh->triangle_count; t++) {
        for (int c = 0; c < 3; c++)
            if (mesh->triangle[t][c] >= mesh->vertex_count)
                return refuse(e, "triangle %u uses vertex %u of %u", t, mesh->triangle[t][c],
                              mesh->vertex_count);
        if (mesh->material[t] >= scene->material_count)
            return refuse(e, "triangle %u uses material %u of %u", t, mesh->material[t],
                          scene->material_count);
    }
    return LW_OK;
}

static enum lw_status check_vertices(const struct lw_mesh *mesh, const struct element *e) {
    size_t count = mesh->vertex_count;
    for (size_t i = 0; i < count; i++) {
        struct lw_vec3 p = mesh->position[i], n = mesh->normal[i];
        if (!(fabsf(p.x) <= LW_SCENE_COORDINATE_MAX && fabsf(p.y) <= LW_SCENE_COORDINATE_MAX &&
              fabsf(p.z) <= LW_SCENE_COORDINATE_MAX))
            return refuse(e, "position %zu is (%g, %g, %g); it must be finite and within +-%g m", i,
                          (double)p.x, (double)p.y, (double)p.z, (double)LW_SCENE_COORDINATE_MAX);
        if (!is_unit(lw_vec3_dot(n, n)))
            return refuse(e, "normal %zu is (%g, %g, %g); it must have length 1", i, (double)n.x, (double)n.y,
                          (double)n.z);
    }
    enum lw_status status = LW_OK;
    if (mesh->uv[0]) status = check_finite(e, "UV set 0", mesh->uv[0], count, 2);
    if (!status && mesh->uv[1]) status = check_finite(e, "UV set 1", mesh->uv[1], count, 2);
    if (!status && mesh->colour) status = check_finite(e, "vertex colour", mesh->colour, count, 4);
    return status;
}

static bool has_back(const struct lw_scene *scene, const struct lw_mesh *mesh) {
    for (uint32_t t = 0; t < mesh->triangle_count; t++)
        if (scene->material[mesh->material[t]].double_sided) return true;
    return false;
}

static bool is_atlas_side(uint32_t side) {
    return side > 0 && side % 4 == 0 && side <= LW_SCENE_ATLAS_SIDE_MAX;
}

static enum lw_status check_lightmap(const struct lw_scene *scene, const struct lw_mesh *mesh,
                                     const struct element *e) {
    uint32_t width = mesh->atlas_width, height = mesh->atlas_height, back = mesh->back_offset;
    if (!mesh->lightmap_uv) {
        if (width || height || back)
            return refuse(e, "has an atlas of %ux%u but no lightmap UVs", width, height);
        return LW_OK;
    }
    if (!is_atlas_side(width) || !is_atlas_side(height))
        return refuse(e, "atlas of %ux%u; each side must be a multiple of 4 within [4, %u]", width, height,
                      LW_SCENE_ATLAS_SIDE_MAX);
    if (back % 4 || back >= height)
        return refuse(e, "back_offset %u; it must be a multiple of 4 below the atlas height %u", back,
                      height);
    if (back == 0 && has_back(scene, mesh)) return refuse(e, "has double-sided triangles but back_offset 0");
    /* The front lies above back_offset, and its copy for the backs must still end inside the atlas. */
    float u_max = (float)width, v_max = (float)(back == 0              ? height
                                                : back < height - back ? back
                                                                       : height - back);
    for (uint32_t i = 0; i < mesh->vertex_count; i++) {
        struct lw_vec2 uv = mesh->lightmap_uv[i];
        if (!(uv.x >= 0 && uv.x <= u_max && uv.y >= 0 && uv.y <= v_max))
            return refuse(e, "lightmap UV %u is (%g, %g); it must be within [0, %g] x [0, %g]", i,
                          (double)uv.x, (double)uv.y, (double)u_max, (double)v_max);
    }
    return LW_OK;
}

static enum lw_status check_mesh(const struct lw_scene *scene, const struct lw_mesh *mesh,
                                 struct element *e) {
    enum lw_status status = check_name(e, mesh->name);
    if (status) return status;
    if (mesh->vertex_count == 0 || mesh->triangle_count == 0)
        return refuse(e, "has %u vertices and %u triangles; leave out a mesh that is empty",
                      mesh->vertex_count, mesh->triangle_count);
    if (!mesh->position || !mesh->normal || !mesh->triangle || !mesh->material)
        return refuse(e, "lacks positions, normals, triangles or triangle materials");
    status = check_triangles(scene, mesh, e);
    if (!status) status = check_vertices(mesh, e);
    if (!status) status = check_lightmap(scene, mesh, e);
    return status;
}

static enum lw_status check_node(const struct lw_node *node, struct element *e) {
    enum lw_status status = check_name(e, node->name);
    if (status) return status;
    if (node->parent != LW_SCENE_NONE && node->parent >= e->index)
        return refuse(e, "parent %u does not come before it", node->parent);
    if (node->has_matrix > 1) return refuse(e, "has_matrix is %u, not 0 or 1", node->has_matrix);
    status = check_magnitude(e, "translation", node->translation, 3, LW_SCENE_COORDINATE_MAX);
    if (!status) status = check_magnitude(e, "scale", node->scale, 3, LW_SCENE_COORDINATE_MAX);
    if (!status) status = check_magnitude(e, "rotation", node->rotation, 4, LW_SCENE_COORDINATE_MAX);
    if (!status) status = check_magnitude(e, "matrix", node->matrix.m[0], 12, LW_SCENE_COORDINATE_MAX);
    if (status) return status;
    if (!node->has_matrix && !is_unit_quaternion(node->rotation))
        return refuse(e, "rotation is no unit quaternion");
    return LW_OK;
}

static enum lw_status check_node_index(const struct lw_scene *scene, uint32_t node, const struct element *e) {
    if (node >= scene->node_count) return refuse(e, "names node %u of %u", node, scene->node_count);
    return LW_OK;
}

static enum lw_status check_object(const struct lw_scene *scene, const struct lw_object *object,
                                   struct element *e) {
    enum lw_status status = check_name(e, object->name);
    if (status) return status;
    if (object->mesh >= scene->mesh_count)
        return refuse(e, "names mesh %u of %u", object->mesh, scene->mesh_count);
    return object->node == LW_SCENE_NONE ? LW_OK : check_node_index(scene, object->node, e);
}

static enum lw_status check_light(const struct lw_scene *scene, const struct lw_light *light,
                                  struct element *e) {
    enum lw_status status = check_name(e, light->name);
    if (!status) status = check_node_index(scene, light->node, e);
    if (status) return status;
    if (light->kind > LW_LIGHT_DIRECTIONAL) return refuse(e, "kind %u is none", light->kind);
    if (light->drawn_by > LW_DRAWN_BY_SERVER)
        return refuse(e, "drawn_by is %u, not 0, 1 or 2", light->drawn_by);
    status = check_range(e, "intensity", light->intensity, 3, 0, LW_SCENE_RADIANCE_MAX);
    if (!status) status = check_range(e, "inner_cone", &light->inner_cone, 1, 0, LW_PI / 2);
    if (!status) status = check_range(e, "outer_cone", &light->outer_cone, 1, 0, LW_PI / 2);
    if (!status) status = check_range(e, "angular_diameter", &light->angular_diameter, 1, 0, LW_PI);
    if (status) return status;
    if (light->kind == LW_LIGHT_SPOT && !(light->inner_cone < light->outer_cone))
        return refuse(e, "outer_cone %g must be wider than inner_cone %g", (double)light->outer_cone,
                      (double)light->inner_cone);
    return LW_OK;
}

static enum lw_status check_camera(const struct lw_scene *scene, const struct lw_camera *camera,
                                   struct element *e) {
    enum lw_status status = check_name(e, camera->name);
    if (!status) status = check_node_index(scene, camera->node, e);
    if (status) return status;
    if (!(camera->fov_y > 0 && camera->fov_y < LW_PI))
        return refuse(e, "fov_y is %g; it must be between 0 and pi", (double)camera->fov_y);
    return check_range(e, "height_m", &camera->height_m, 1, 0, LW_SCENE_COORDINATE_MAX);
}

static enum lw_status check_keys(const struct lw_channel *channel, const struct element *e) {
    float previous = 0;
    for (uint32_t k = 0; k < channel->key_count; k++) {
        float time_s = channel->time_s[k];
        if (!(time_s >= 0 && time_s <= LW_SCENE_DURATION_MAX))
            return refuse(e, "time of key %u is %g; it must be within [0, %g] s", k, (double)time_s,
                          (double)LW_SCENE_DURATION_MAX);
        if (k > 0 && !(time_s > previous))
            return refuse(e, "time of key %u is not after the key before it", k);
        previous = time_s;
    }
    size_t width = lw_channel_width(channel);
    size_t stride = channel->interpolation == LW_INTERPOLATION_CUBIC ? 3 * width : width;
    if (channel->path >= LW_CHANNEL_INTENSITY) {
        const float least = channel->interpolation == LW_INTERPOLATION_CUBIC ? -LW_SCENE_RADIANCE_MAX : 0;
        return check_range(e, "key value", channel->value, channel->key_count * stride, least,
                           LW_SCENE_RADIANCE_MAX);
    }
    enum lw_status status =
        check_magnitude(e, "key value", channel->value, channel->key_count * stride, LW_SCENE_COORDINATE_MAX);
    if (status || width == 3) return status;
    for (uint32_t k = 0; k < channel->key_count; k++)
        if (!is_unit_quaternion(channel->value + k * stride + (stride > width ? width : 0)))
            return refuse(e, "rotation of key %u is no unit quaternion", k);
    return LW_OK;
}

static enum lw_status check_curve(const struct lw_channel *channel, const struct element *e) {
    if (channel->interpolation > LW_INTERPOLATION_CUBIC)
        return refuse(e, "interpolation %u is none", channel->interpolation);
    if (channel->key_count == 0 || !channel->time_s || !channel->value) return refuse(e, "has no keys");
    return check_keys(channel, e);
}

static enum lw_status check_channel(const struct lw_scene *scene, const struct lw_channel *channel,
                                    struct element *e) {
    enum lw_status status = check_node_index(scene, channel->node, e);
    if (status) return status;
    if (scene->node[channel->node].has_matrix)
        return refuse(e, "animates node %u, which has a matrix", channel->node);
    if (channel->path > LW_CHANNEL_SCALE) return refuse(e, "path %u is none", channel->path);
    return check_curve(channel, e);
}

static enum lw_status check_light_channel(const struct lw_scene *scene, const struct lw_channel *channel,
                                          const struct element *e) {
    if (channel->node >= scene->light_count)
        return refuse(e, "names light %u of %u", channel->node, scene->light_count);
    if (channel->path != LW_CHANNEL_INTENSITY && channel->path != LW_CHANNEL_FACTOR)
        return refuse(e, "path %u is none", channel->path);
    return check_curve(channel, e);
}

static enum lw_status check_elements(const struct lw_scene *scene, struct lw_error *err) {
    enum lw_status status = LW_OK;
    for (uint32_t i = 0; !status && i < scene->texture_count; i++)
        status = check_texture(&scene->texture[i], &(struct element){err, "texture", i, NULL});
    for (uint32_t i = 0; !status && i < scene->material_count; i++)
        status = check_material(scene, &scene->material[i], &(struct element){err, "material", i, NULL});
    for (uint32_t i = 0; !status && i < scene->mesh_count; i++)
        status = check_mesh(scene, &scene->mesh[i], &(struct element){err, "mesh", i, NULL});
    for (uint32_t i = 0; !status && i < scene->node_count; i++)
        status = check_node(&scene->node[i], &(struct element){err, "node", i, NULL});
    for (uint32_t i = 0; !status && i < scene->object_count; i++)
        status = check_object(scene, &scene->object[i], &(struct element){err, "object", i, NULL});
    for (uint32_t i = 0; !status && i < scene->light_count; i++)
        status = check_light(scene, &scene->light[i], &(struct element){err, "light", i, NULL});
    for (uint32_t i = 0; !status && i < scene->camera_count; i++)
        status = check_camera(scene, &scene->camera[i], &(struct element){err, "camera", i, NULL});
    for (uint32_t i = 0; !status && i < scene->channel_count; i++)
        status = check_channel(scene, &scene->channel[i], &(struct element){err, "channel", i, NULL});
    for (uint32_t i = 0; !status && i < scene->light_channel_count; i++)
        status = check_light_channel(scene, &scene->light_channel[i],
                                     &(struct element){err, "channel of a light", i, NULL});
    return status;
}

/* Two channels for one property would make the later one win, silently. */
static enum lw_status check_channels_differ(const struct lw_channel *channels, uint32_t count,
                                            const char *kind, const char *target, uint32_t targets,
                                            struct lw_error *err) {
    if (count == 0) return LW_OK;
    uint8_t *paths = calloc(targets, 1); /* bit per path */
    if (!paths)
        return lw_status_fail(err, LW_NO_MEMORY, "no memory to check the channels of %u %ss", targets,
                              target);
    enum lw_status status = LW_OK;
    for (uint32_t i = 0; !status && i < count; i++) {
        const struct lw_channel *channel = &channels[i];
        uint8_t bit = (uint8_t)(1u << channel->path);
        if (paths[channel->node] & bit)
            status = refuse(&(struct element){err, kind, i, NULL},
                            "animates a property of %s %u that an earlier channel animates", target,
                            channel->node);
        paths[channel->node] |= bit;
    }
    free(paths);
    return status;
}

/* Instances cost memory that no byte of a package backs, so their sum has a limit too. */
static enum lw_status check_totals(const struct lw_scene *scene, struct lw_error *err) {
    uint64_t mesh_triangles = 0, mesh_vertices = 0, triangles = 0, vertices = 0, texels = 0;
    for (uint32_t i = 0; i < scene->mesh_count; i++) {
        mesh_triangles += scene->mesh[i].triangle_count;
        mesh_vertices += scene->mesh[i].vertex_count;
    }
    for (uint32_t i = 0; i < scene->object_count; i++) {
        const struct lw_mesh *mesh = &scene->mesh[scene->object[i].mesh];
        triangles += mesh->triangle_count;
        vertices += mesh->vertex_count;
        texels += (uint64_t)mesh->atlas_width * mesh->atlas_height;
    }
    const struct {
        const char *what;
        uint64_t count, limit;
    } sums[] = {
        {"triangles in its meshes", mesh_triangles, LW_SCENE_TRIANGLES_MAX},
        {"vertices in its meshes", mesh_vertices, LW_SCENE_VERTICES_MAX},
        {"triangles in its objects", triangles, LW_SCENE_TRIANGLES_MAX},
        {"vertices in its objects", vertices, LW_SCENE_VERTICES_MAX},
        {"texels in its objects' atlases", texels, LW_SCENE_TEXELS_MAX},
    };
    for (size_t i = 0; i < sizeof sums / sizeof *sums; i++)
        if (sums[i].count > sums[i].limit)
            return lw_status_fail(err, LW_BAD_DATA, "scene has %llu %s; the limit is %llu",
                                  (unsigned long long)sums[i].count, sums[i].what,
                                  (unsigned long long)sums[i].limit);
    return LW_OK;
}

/* Every node may be in bounds and their product out of them. */
static enum lw_status check_rest_pose(const struct lw_scene *scene, struct lw_error *err) {
    struct lw_pose pose;
    enum lw_status status = lw_pose_init(&pose, scene);
    if (status) return lw_status_fail(err, status, "no memory for the pose of %u nodes", scene->node_count);
    for (uint32_t i = 0; !status && i < scene->node_count; i++)
        status =
            check_magnitude(&(struct element){err, "node", i, scene->node[i].name}, "transform to the world",
                            pose.node_to_world[i].m[0], 12, LW_SCENE_COORDINATE_MAX);
    lw_pose_finish(&pose);
    return status;
}

static enum lw_status check_environment(const struct lw_environment *environment, struct lw_error *err) {
    const struct element e = {err, "environment", LW_SCENE_NONE, NULL};
    if (!environment->width && !environment->height && !environment->rgb) return LW_OK;
    if (!environment->width || !environment->height || !environment->rgb ||
        environment->width > LW_SCENE_ENVIRONMENT_SIDE_MAX ||
        environment->height > LW_SCENE_ENVIRONMENT_SIDE_MAX)
        return refuse(&e, "is %u x %u texels; each side is from 1 to %u", environment->width,
                      environment->height, LW_SCENE_ENVIRONMENT_SIDE_MAX);
    return check_range(&e, "radiance", environment->rgb, 3ul * environment->width * environment->height, 0,
                       LW_SCENE_RADIANCE_MAX);
}

enum lw_status lw_scene_validate_finishes(const struct lw_scene *scene, struct lw_error *err) {
    enum lw_status status = LW_OK;
    for (uint32_t i = 0; !status && i < scene->finish_texture_count; i++)
        status =
            check_texture(&scene->finish_texture[i], &(struct element){err, "texture of finishes", i, NULL});
    for (uint32_t i = 0; !status && i < scene->material_count; i++)
        if (scene->material[i].finish)
            status = check_finish(scene, scene->material[i].finish,
                                  &(struct element){err, "material", i, scene->material[i].name});
    return status;
}

enum lw_status lw_scene_validate(const struct lw_scene *scene, struct lw_error *err) {
    struct element whole = {err, "scene", LW_SCENE_NONE, NULL};
    enum lw_status status = check_name(&whole, scene->name);
    if (!status) status = check_range(&whole, "duration_s", &scene->duration_s, 1, 0, LW_SCENE_DURATION_MAX);
    if (!status) status = check_range(&whole, "sky", scene->sky, 3, 0, LW_SCENE_RADIANCE_MAX);
    if (!status) status = check_environment(&scene->environment, err);
    if (!status) status = check_counts(scene, err);
    if (!status) status = check_elements(scene, err);
    if (!status) status = lw_scene_validate_finishes(scene, err);
    if (!status)
        status = check_channels_differ(scene->channel, scene->channel_count, "channel", "node",
                                       scene->node_count, err);
    if (!status)
        status = check_channels_differ(scene->light_channel, scene->light_channel_count, "channel of a light",
                                       "light", scene->light_count, err);
    if (!status) status = check_totals(scene, err);
    if (!status) status = check_rest_pose(scene, err);
    return status;
}
