#include "common/scene/package.h"

#include "common/base/atomic_file.h"
#include "common/scene/finish_package.h"
#include "common/scene/pixel_filter.h"
#include "common/scene/records.h"

#include <errno.h>
#include <fcntl.h>
#include <stdlib.h>
#include <string.h>
#include <sys/stat.h>
#include <unistd.h>
#include <xxhash.h>

/* docs/scene_package.md is the format; this file follows it. Arrays are used where they lie in the reader's
 * copy. */
#define SUFFIX      ".lwscene"
#define MAGIC       "LWSCENE\n"
#define CHECKSUM_AT 24u /* in the header; reserved before version 5 */
#define NO_LIMIT    LW_RECORDS_NO_LIMIT

/* id - 1, name, bytes per element, most elements; the order is the file's */
#define SECTION_MAP(X)                                                                                       \
    X(SCENE, "scene", 24, 1)                                                                                 \
    X(MESHES, "meshes", 64, LW_SCENE_MESHES_MAX)                                                             \
    X(MATERIALS, "materials", 112, LW_SCENE_MATERIALS_MAX)                                                   \
    X(TEXTURES, "textures", 28, LW_SCENE_TEXTURES_MAX)                                                       \
    X(NODES, "nodes", 104, LW_SCENE_NODES_MAX)                                                               \
    X(OBJECTS, "objects", 16, LW_SCENE_OBJECTS_MAX)                                                          \
    X(LIGHTS, "lights", 40, LW_SCENE_LIGHTS_MAX)                                                             \
    X(CAMERAS, "cameras", 16, LW_SCENE_CAMERAS_MAX)                                                          \
    X(CHANNELS, "channels", 24, LW_SCENE_CHANNELS_MAX)                                                       \
    X(STRINGS, "strings", 1, NO_LIMIT)                                                                       \
    X(POSITIONS, "positions", 12, NO_LIMIT)                                                                  \
    X(NORMALS, "normals", 12, NO_LIMIT)                                                                      \
    X(UVS, "uvs", 8, NO_LIMIT)                                                                               \
    X(COLOURS, "colours", 16, NO_LIMIT)                                                                      \
    X(TRIANGLES, "triangles", 12, NO_LIMIT)                                                                  \
    X(TRIANGLE_MATERIALS, "triangle materials", 4, NO_LIMIT)                                                 \
    X(LIGHTMAP_UVS, "lightmap uvs", 8, NO_LIMIT)                                                             \
    X(KEY_TIMES, "key times", 4, NO_LIMIT)                                                                   \
    X(KEY_VALUES, "key values", 4, NO_LIMIT)                                                                 \
    X(PIXELS, "pixels", 4, NO_LIMIT)                                                                         \
    X(ENVIRONMENTS, "environments", 12, 1)                                                                   \
    X(ENVIRONMENT_TEXELS, "environment texels", 12, NO_LIMIT)                                                \
    X(LIGHT_DRAWERS, "light drawers", 4, LW_SCENE_LIGHTS_MAX)                                                \
    X(MATERIAL_DRAWERS, "material drawers", 4, LW_SCENE_MATERIALS_MAX)                                       \
    X(MATERIAL_LOOKS, "material looks", 16, LW_SCENE_MATERIALS_MAX)                                          \
    X(CAMERA_HEIGHTS, "camera heights", 4, LW_SCENE_CAMERAS_MAX)                                             \
    X(LIGHT_CHANNELS, "light channels", 24, LW_SCENE_CHANNELS_MAX)                                           \
    X(FINISHES, "finishes", 1, NO_LIMIT)

/* Version 1 ends with the pixels, version 2 has an environment, in version 3 pixels are filtered, version 4
 * says who draws lights. For clients each scene is written in one of them, so that there is one way to say
 * it: where the file says who draws a light in version 4, else with textures in version 3. Earlier ones
 * are read as well. Version 5, for files, is version 4 for every scene, and has a checksum. Version 6, with a
 * checksum too, is for files and clients: for scenes with what no earlier one can say. Version 7, for files,
 * has the finishes of a scene (finish_package.h) besides; clients get these apart. */
#define SECTION_COUNT_V1 20u
#define SECTION_COUNT_V2 22u
#define SECTION_COUNT_V4 24u
#define SECTION_COUNT_V6 27u
#define VERSION_FILTERED 3u
#define VERSION_DRAWERS  4u
#define VERSION_SEALED   5u
#define VERSION_LOOKS    6u
#define VERSION_FINISHES 7u

enum section_id {
#define X(id, name, size, limit) SECTION_##id,
    SECTION_MAP(X)
#undef X
        SECTION_COUNT
};

static const struct lw_records_kind kinds[SECTION_COUNT] = {
#define X(id, name, size, limit) {name, size, limit},
    SECTION_MAP(X)
#undef X
};

static const struct lw_records_format format = {MAGIC, "scene package", kinds, SECTION_STRINGS,
                                                LW_PACKAGE_SIZE_MAX};

/* The arrays' C types are the file's elements. */
_Static_assert(sizeof(struct lw_vec2) == 8 && sizeof(struct lw_vec3) == 12 && sizeof(struct lw_vec4) == 16,
               "");

static void scene_record(struct lw_records *c, struct lw_scene *scene) {
    scene->name = lw_record_string(c, scene->name);
    lw_record_words(c, &scene->duration_s, 1);
    lw_record_words(c, scene->sky, 3);
}

static void mesh_record(struct lw_records *c, struct lw_mesh *mesh) {
    mesh->name = lw_record_string(c, mesh->name);
    lw_record_words(c, &mesh->vertex_count, 1);
    lw_record_words(c, &mesh->triangle_count, 1);
    uint32_t vertices = mesh->vertex_count, triangles = mesh->triangle_count;
    mesh->position = lw_record_array(c, SECTION_POSITIONS, mesh->position, vertices, "positions");
    mesh->normal = lw_record_array(c, SECTION_NORMALS, mesh->normal, vertices, "normals");
    mesh->uv[0] = lw_record_array(c, SECTION_UVS, mesh->uv[0], vertices, "UV set 0");
    mesh->uv[1] = lw_record_array(c, SECTION_UVS, mesh->uv[1], vertices, "UV set 1");
    mesh->colour = lw_record_array(c, SECTION_COLOURS, mesh->colour, vertices, "colours");
    mesh->triangle = lw_record_array(c, SECTION_TRIANGLES, mesh->triangle, triangles, "triangles");
    mesh->material =
        lw_record_array(c, SECTION_TRIANGLE_MATERIALS, mesh->material, triangles, "triangle materials");
    mesh->lightmap_uv = lw_record_array(c, SECTION_LIGHTMAP_UVS, mesh->lightmap_uv, vertices, "lightmap UVs");
    lw_record_words(c, &mesh->atlas_width, 1);
    lw_record_words(c, &mesh->atlas_height, 1);
    lw_record_words(c, &mesh->back_offset, 1);
    lw_record_reserved(c);
}

static void material_record(struct lw_records *c, struct lw_material *material) {
    material->name = lw_record_string(c, material->name);
    lw_record_words(c, material->base_colour, 4);
    lw_record_words(c, material->emission, 3);
    lw_record_words(c, &material->alpha_cutoff, 1);
    lw_record_texture_use(c, &material->base_colour_texture);
    lw_record_texture_use(c, &material->emission_texture);
    lw_record_choice(c, &material->alpha_mode, LW_ALPHA_BLEND, "alpha mode");
    lw_record_choice(c, &material->double_sided, 1, "double_sided");
}

/* In place: the reader's copy of the package is the scene's own. */
static void unfilter(struct lw_records *c, const struct lw_texture *texture, uint8_t *pixels) {
    const size_t size = 4 * (size_t)texture->width * texture->height;
    uint8_t *bytes = malloc(size + 1);
    if (!bytes) {
        c->status = lw_status_fail(c->err, LW_NO_MEMORY, "no memory for a texture of %zu bytes", size);
        return;
    }
    if (size) memcpy(bytes, pixels, size);
    lw_pixel_filter_undo(bytes, texture->width, texture->height, pixels);
    free(bytes);
}

static void texture_record(struct lw_records *c, struct lw_texture *texture) {
    texture->name = lw_record_string(c, texture->name);
    lw_record_words(c, &texture->width, 1);
    lw_record_words(c, &texture->height, 1);
    const uint64_t pixels = (uint64_t)texture->width * texture->height;
    const struct lw_records_section *section = &c->section[SECTION_PIXELS];
    uint8_t *there = section->bytes ? section->bytes + 4 * section->cursor : NULL;
    const uint8_t *rgba = lw_record_array(c, SECTION_PIXELS, texture->rgba, pixels, "pixels");
    if (c->mode == LW_RECORDS_WRITE) lw_pixel_filter_apply(rgba, texture->width, texture->height, there);
    if (c->mode == LW_RECORDS_READ && rgba && c->version >= VERSION_FILTERED) unfilter(c, texture, there);
    texture->rgba = rgba;
    lw_record_choice(c, &texture->wrap_s, LW_WRAP_MIRROR, "wrap_s");
    lw_record_choice(c, &texture->wrap_t, LW_WRAP_MIRROR, "wrap_t");
}

static void node_record(struct lw_records *c, struct lw_node *node) {
    node->name = lw_record_string(c, node->name);
    lw_record_words(c, &node->parent, 1);
    lw_record_choice(c, &node->has_matrix, 1, "has_matrix");
    lw_record_words(c, node->translation, 3);
    lw_record_words(c, node->rotation, 4);
    lw_record_words(c, node->scale, 3);
    lw_record_words(c, node->matrix.m, 12);
}

static void object_record(struct lw_records *c, struct lw_object *object) {
    object->name = lw_record_string(c, object->name);
    lw_record_words(c, &object->mesh, 1);
    lw_record_words(c, &object->node, 1);
}

static void light_record(struct lw_records *c, struct lw_light *light) {
    light->name = lw_record_string(c, light->name);
    lw_record_words(c, &light->node, 1);
    lw_record_choice(c, &light->kind, LW_LIGHT_DIRECTIONAL, "kind");
    lw_record_words(c, light->intensity, 3);
    lw_record_words(c, &light->inner_cone, 1);
    lw_record_words(c, &light->outer_cone, 1);
    lw_record_words(c, &light->angular_diameter, 1);
}

static void camera_record(struct lw_records *c, struct lw_camera *camera) {
    camera->name = lw_record_string(c, camera->name);
    lw_record_words(c, &camera->node, 1);
    lw_record_words(c, &camera->fov_y, 1);
}

static void channel_record(struct lw_records *c, struct lw_channel *channel) {
    lw_record_words(c, &channel->node, 1);
    lw_record_choice(c, &channel->path,
                     c->record_section == SECTION_CHANNELS ? LW_CHANNEL_SCALE : LW_CHANNEL_FACTOR, "path");
    lw_record_choice(c, &channel->interpolation, LW_INTERPOLATION_CUBIC, "interpolation");
    lw_record_words(c, &channel->key_count, 1);
    uint64_t floats = lw_channel_width(channel);
    if (channel->interpolation == LW_INTERPOLATION_CUBIC) floats *= 3;
    channel->time_s = lw_record_array(c, SECTION_KEY_TIMES, channel->time_s, channel->key_count, "times");
    channel->value =
        lw_record_array(c, SECTION_KEY_VALUES, channel->value, floats * channel->key_count, "values");
}

static void environment_record(struct lw_records *c, struct lw_environment *environment) {
    lw_record_words(c, &environment->width, 1);
    lw_record_words(c, &environment->height, 1);
    environment->rgb = lw_record_array(c, SECTION_ENVIRONMENT_TEXELS, environment->rgb,
                                       (uint64_t)environment->width * environment->height, "texels");
    if (!environment->rgb) lw_record_fail(c, "has no texels");
}

static void light_drawer_record(struct lw_records *c, struct lw_light *light) {
    lw_record_choice(c, &light->drawn_by, LW_DRAWN_BY_SERVER, "who draws it");
}

static void material_drawer_record(struct lw_records *c, struct lw_material *material) {
    lw_record_choice(c, &material->drawn_by, LW_DRAWN_BY_SERVER, "who draws it");
}

static void material_look_record(struct lw_records *c, struct lw_material *material) {
    lw_record_choice(c, &material->unlit, 1, "unlit");
    lw_record_words(c, material->tint, 3);
}

static void camera_height_record(struct lw_records *c, struct lw_camera *camera) {
    lw_record_words(c, &camera->height_m, 1);
}

static void all_records(struct lw_records *c, struct lw_scene *scene) {
    lw_record_begin(c, SECTION_SCENE, 0);
    scene_record(c, scene);
    LW_RECORDS_EACH(c, SECTION_MESHES, scene->mesh, scene->mesh_count, mesh_record(c, &element))
    LW_RECORDS_EACH(c, SECTION_MATERIALS, scene->material, scene->material_count,
                    material_record(c, &element))
    LW_RECORDS_EACH(c, SECTION_TEXTURES, scene->texture, scene->texture_count, texture_record(c, &element))
    LW_RECORDS_EACH(c, SECTION_NODES, scene->node, scene->node_count, node_record(c, &element))
    LW_RECORDS_EACH(c, SECTION_OBJECTS, scene->object, scene->object_count, object_record(c, &element))
    LW_RECORDS_EACH(c, SECTION_LIGHTS, scene->light, scene->light_count, light_record(c, &element))
    LW_RECORDS_EACH(c, SECTION_CAMERAS, scene->camera, scene->camera_count, camera_record(c, &element))
    LW_RECORDS_EACH(c, SECTION_CHANNELS, scene->channel, scene->channel_count, channel_record(c, &element))
    const uint64_t environments =
        c->mode == LW_RECORDS_READ ? c->section[SECTION_ENVIRONMENTS].count : scene->environment.width > 0;
    LW_RECORDS_EACH(c, SECTION_ENVIRONMENTS, &scene->environment, environments,
                    environment_record(c, &element))
    if (c->version < VERSION_DRAWERS) return;
    LW_RECORDS_EACH(c, SECTION_LIGHT_DRAWERS, scene->light, scene->light_count,
                    light_drawer_record(c, &element))
    LW_RECORDS_EACH(c, SECTION_MATERIAL_DRAWERS, scene->material, scene->material_count,
                    material_drawer_record(c, &element))
    if (c->version < VERSION_LOOKS) return;
    LW_RECORDS_EACH(c, SECTION_MATERIAL_LOOKS, scene->material, scene->material_count,
                    material_look_record(c, &element))
    LW_RECORDS_EACH(c, SECTION_CAMERA_HEIGHTS, scene->camera, scene->camera_count,
                    camera_height_record(c, &element))
    LW_RECORDS_EACH(c, SECTION_LIGHT_CHANNELS, scene->light_channel, scene->light_channel_count,
                    channel_record(c, &element))
}

/* Number of a version's sections; 0: the version is not known. */
static uint32_t sections_of(uint32_t version) {
    static const uint32_t of[LW_PACKAGE_VERSION + 1] = {0,
                                                        SECTION_COUNT_V1,
                                                        SECTION_COUNT_V2,
                                                        SECTION_COUNT_V2,
                                                        SECTION_COUNT_V4,
                                                        SECTION_COUNT_V4,
                                                        SECTION_COUNT_V6,
                                                        SECTION_COUNT};
    return version <= LW_PACKAGE_VERSION ? of[version] : 0;
}

static bool says_who_draws(const struct lw_scene *scene) {
    for (uint32_t i = 0; i < scene->light_count; i++)
        if (scene->light[i].drawn_by) return true;
    for (uint32_t i = 0; i < scene->material_count; i++)
        if (scene->material[i].drawn_by) return true;
    return false;
}

/* Whether versions before this one cannot say all of it. */
static bool wants_looks(const struct lw_scene *scene) {
    for (uint32_t i = 0; i < scene->material_count; i++)
        if (scene->material[i].unlit || lw_material_tints(&scene->material[i])) return true;
    for (uint32_t i = 0; i < scene->camera_count; i++)
        if (scene->camera[i].height_m > 0) return true;
    return scene->light_channel_count > 0;
}

static uint32_t version_of(const struct lw_scene *scene) {
    if (wants_looks(scene)) return VERSION_LOOKS;
    if (says_who_draws(scene)) return VERSION_DRAWERS;
    return scene->texture_count ? VERSION_FILTERED : scene->environment.width ? 2 : 1;
}

/* Needs the bytes for a moment, to leave the checksum itself out without a copy or an allocation. */
static uint64_t checksum_of(uint8_t *bytes, size_t size) {
    const uint64_t there = lw_records_get_u64(bytes + CHECKSUM_AT);
    uint64_t checksum;
    struct lw_package_hash hash;
    lw_records_put_u64(bytes + CHECKSUM_AT, 0);
    lw_package_hash(bytes, size, &hash);
    lw_records_put_u64(bytes + CHECKSUM_AT, there);
    memcpy(&checksum, hash.bytes, sizeof checksum);
    return checksum;
}

void lw_package_seal(uint8_t *bytes, size_t size) {
    if (size >= LW_RECORDS_HEADER && lw_records_get_u32(bytes + 8) >= VERSION_SEALED)
        lw_records_put_u64(bytes + CHECKSUM_AT, checksum_of(bytes, size));
}

static struct lw_records records_of(enum lw_records_mode mode, uint32_t version, struct lw_error *err) {
    return (struct lw_records){.format = &format,
                               .mode = mode,
                               .version = version,
                               .section_count = sections_of(version),
                               .err = err};
}

/* finishes: bytes of their package, for version 7. */
struct blob {
    uint8_t *bytes;
    size_t size;
};

/* Lays out what the scene would take in a version. */
static enum lw_status measure(struct lw_records *c, struct lw_scene *copy, const struct blob *finishes,
                              uint64_t offset[LW_RECORDS_SECTIONS_MAX], uint64_t *out_size) {
    all_records(c, copy);
    c->section[SECTION_FINISHES].cursor = finishes->size;
    return lw_records_measure(c, offset, out_size);
}

enum lw_status lw_package_check_size(const struct lw_scene *scene, struct lw_error *err) {
    struct lw_scene copy = *scene;
    struct lw_records c = records_of(LW_RECORDS_MEASURE, VERSION_SEALED, err);
    uint64_t offset[LW_RECORDS_SECTIONS_MAX], size = 0;
    return measure(&c, &copy, &(struct blob){0}, offset, &size);
}

static enum lw_status write_version(const struct lw_scene *scene, uint32_t version,
                                    const struct blob *finishes, uint8_t **out_bytes, size_t *out_size,
                                    struct lw_error *err) {
    struct lw_scene copy = *scene; /* records of the original are only read */
    struct lw_records c = records_of(LW_RECORDS_MEASURE, version, err);
    uint64_t offset[LW_RECORDS_SECTIONS_MAX], size = 0;
    enum lw_status status = measure(&c, &copy, finishes, offset, &size);
    if (status) return status;
    uint8_t *bytes = calloc(size, 1); /* reserved fields and padding are zero */
    if (!bytes)
        return lw_status_fail(err, LW_NO_MEMORY, "no memory for a scene package of %llu bytes",
                              (unsigned long long)size);
    lw_records_start_writing(&c, offset, bytes, size);
    all_records(&c, &copy);
    if (finishes->size) memcpy(c.section[SECTION_FINISHES].bytes, finishes->bytes, finishes->size);
    lw_package_seal(bytes, size);
    *out_bytes = bytes;
    *out_size = size;
    return LW_OK;
}

enum lw_status lw_package_write(const struct lw_scene *scene, uint8_t **out_bytes, size_t *out_size,
                                struct lw_error *err) {
    enum lw_status status = lw_scene_validate(scene, err);
    return status ? status
                  : write_version(scene, version_of(scene), &(struct blob){0}, out_bytes, out_size, err);
}

enum lw_status lw_package_write_sealed(const struct lw_scene *scene, uint8_t **out_bytes, size_t *out_size,
                                       struct lw_error *err) {
    struct blob finishes = {0};
    uint32_t version = wants_looks(scene) ? VERSION_LOOKS : VERSION_SEALED;
    enum lw_status status = lw_scene_validate(scene, err);
    if (!status && lw_scene_has_finishes(scene)) {
        version = VERSION_FINISHES;
        status = lw_finish_package_write(scene, &finishes.bytes, &finishes.size, err);
    }
    if (!status) status = write_version(scene, version, &finishes, out_bytes, out_size, err);
    free(finishes.bytes);
    return status;
}

static enum lw_status check_header(const uint8_t *bytes, size_t size, struct lw_error *err) {
    if (size < LW_RECORDS_MAGIC || memcmp(bytes, MAGIC, LW_RECORDS_MAGIC) != 0)
        return lw_status_fail(err, LW_BAD_DATA, "not a scene package: it does not begin with LWSCENE");
    if (size < LW_RECORDS_HEADER)
        return lw_status_fail(err, LW_BAD_DATA, "scene package is cut off after %zu bytes, in its header",
                              size);
    const uint32_t version = lw_records_get_u32(bytes + 8), sections = sections_of(version);
    if (!sections)
        return lw_status_fail(
            err, LW_BAD_DATA,
            "scene package has version %u; this program reads versions 1 to %u: import the scene again",
            version, LW_PACKAGE_VERSION);
    if (size < LW_RECORDS_HEADER + sections * LW_RECORDS_ENTRY)
        return lw_status_fail(err, LW_BAD_DATA, "scene package is cut off after %zu bytes, in its header",
                              size);
    if (lw_records_get_u32(bytes + 12) != sections)
        return lw_status_fail(err, LW_BAD_DATA, "scene package has %u sections; version %u has %u",
                              lw_records_get_u32(bytes + 12), version, sections);
    if (lw_records_get_u64(bytes + 16) != size)
        return lw_status_fail(err, LW_BAD_DATA, "scene package says it has %llu bytes, but there are %zu",
                              (unsigned long long)lw_records_get_u64(bytes + 16), size);
    if (size > LW_PACKAGE_SIZE_MAX)
        return lw_status_fail(err, LW_BAD_DATA, "scene package has %zu bytes; the limit is %llu", size,
                              LW_PACKAGE_SIZE_MAX);
    if (version < VERSION_SEALED && lw_records_get_u64(bytes + CHECKSUM_AT) != 0)
        return lw_status_fail(err, LW_BAD_DATA, "scene package: a reserved field of the header is not 0");
    return LW_OK;
}

static enum lw_status read_table(struct lw_records *c, uint8_t *bytes, size_t size) {
    enum lw_status status = lw_records_read_table(c, bytes, size);
    if (status) return status;
    if (c->section[SECTION_SCENE].count != 1)
        return lw_status_fail(c->err, LW_BAD_DATA, "section scene has %llu elements, not 1",
                              (unsigned long long)c->section[SECTION_SCENE].count);
    if (c->version == VERSION_FILTERED && !c->section[SECTION_TEXTURES].count)
        return lw_status_fail(c->err, LW_BAD_DATA,
                              "section textures has 0 elements: without one, the version is 1 or 2");
    if (c->version == 2 && c->section[SECTION_ENVIRONMENTS].count != 1)
        return lw_status_fail(c->err, LW_BAD_DATA,
                              "section environments has 0 elements, not 1: without one, the version is 1");
    return LW_OK;
}

/* The records' counts are backed by bytes of the file by now, so the allocation is at most a few times its
 * size. */
static bool allocate_records(struct lw_scene *scene, const struct lw_records *c) {
#define ALLOCATE(id, elements, element_count)                                                                \
    do {                                                                                                     \
        element_count = (uint32_t)c->section[SECTION_##id].count;                                            \
        elements = lw_scene_alloc(scene, element_count, sizeof *(elements));                                 \
        if (!(elements)) return false;                                                                       \
    } while (0)
    ALLOCATE(MESHES, scene->mesh, scene->mesh_count);
    ALLOCATE(MATERIALS, scene->material, scene->material_count);
    ALLOCATE(TEXTURES, scene->texture, scene->texture_count);
    ALLOCATE(NODES, scene->node, scene->node_count);
    ALLOCATE(OBJECTS, scene->object, scene->object_count);
    ALLOCATE(LIGHTS, scene->light, scene->light_count);
    ALLOCATE(CAMERAS, scene->camera, scene->camera_count);
    ALLOCATE(CHANNELS, scene->channel, scene->channel_count);
    if (c->section_count >= SECTION_COUNT_V6)
        ALLOCATE(LIGHT_CHANNELS, scene->light_channel, scene->light_channel_count);
#undef ALLOCATE
    return true;
}

/* Turns bytes that the scene owns into the scene. */
static enum lw_status read_in_place(struct lw_scene *scene, uint8_t *bytes, size_t size,
                                    struct lw_error *err) {
    const uint32_t version = lw_records_get_u32(bytes + 8);
    if (version >= VERSION_SEALED && checksum_of(bytes, size) != lw_records_get_u64(bytes + CHECKSUM_AT))
        return lw_status_fail(
            err, LW_BAD_DATA,
            "scene package is damaged: its bytes do not have its checksum; import the scene "
            "again");
    struct lw_records c = records_of(LW_RECORDS_READ, version, err);
    enum lw_status status = read_table(&c, bytes, size);
    if (status) return status;
    if (!allocate_records(scene, &c))
        return lw_status_fail(err, LW_NO_MEMORY, "no memory for the records of a scene package");
    all_records(&c, scene);
    if (c.status) return c.status;
    const struct lw_records_section finishes = c.section[SECTION_FINISHES];
    c.section[SECTION_FINISHES].cursor = finishes.count;
    status = lw_records_check_used(&c);
    if (status) return status;
    if (version == VERSION_DRAWERS && !says_who_draws(scene))
        return lw_status_fail(err, LW_BAD_DATA,
                              "no light and no material says who draws it: then the version is 1 to 3");
    if (version == VERSION_LOOKS && !wants_looks(scene))
        return lw_status_fail(err, LW_BAD_DATA,
                              "no material is unlit or has a tint, no camera orthographic, no light has a "
                              "channel: then the version is 1 to 5");
    status = lw_scene_validate(scene, err);
    if (status || version < VERSION_FINISHES) return status;
    status = lw_finish_package_take(finishes.bytes, (size_t)finishes.count, scene, err);
    if (status) lw_status_context(err, "section finishes");
    return status;
}

/* An empty scene with room for the package's bytes in its storage. */
static enum lw_status create_holder(size_t size, struct lw_scene **out_scene, uint8_t **out_bytes,
                                    struct lw_error *err) {
    struct lw_scene *scene = NULL;
    enum lw_status status = lw_scene_create(&scene);
    uint8_t *bytes = status ? NULL : lw_scene_alloc(scene, size, 1);
    if (!bytes) {
        lw_scene_destroy(scene);
        return lw_status_fail(err, LW_NO_MEMORY, "no memory for a scene package of %zu bytes", size);
    }
    *out_scene = scene;
    *out_bytes = bytes;
    return LW_OK;
}

enum lw_status lw_package_read(const uint8_t *bytes, size_t size, struct lw_scene **out_scene,
                               struct lw_error *err) {
    enum lw_status status = check_header(bytes, size, err);
    if (status) return status;
    struct lw_scene *scene = NULL;
    uint8_t *copy = NULL;
    status = create_holder(size, &scene, &copy, err);
    if (status) return status;
    memcpy(copy, bytes, size);
    status = read_in_place(scene, copy, size, err);
    if (status)
        lw_scene_destroy(scene);
    else
        *out_scene = scene;
    return status;
}

/* Offsets in a texture's record. */
#define TEXTURE_WIDTH  8u
#define TEXTURE_HEIGHT 12u
#define TEXTURE_PIXELS 16u

/* Ends of parts, for a reader's codec with its table; returns how many. */
static size_t find_cuts(const struct lw_records *c, const uint8_t *bytes, size_t size, uint64_t *end) {
    const struct lw_records_section *textures = &c->section[SECTION_TEXTURES],
                                    *pixels = &c->section[SECTION_PIXELS];
    const uint64_t first = (uint64_t)(pixels->bytes - bytes);
    size_t count = 0;
    uint64_t at = 0; /* in pixels */
    for (uint64_t i = 0; i < textures->count; i++) {
        const uint8_t *record = textures->bytes + i * kinds[SECTION_TEXTURES].element_size;
        const uint64_t texels = (uint64_t)lw_records_get_u32(record + TEXTURE_WIDTH) *
                                lw_records_get_u32(record + TEXTURE_HEIGHT);
        if (lw_records_get_u32(record + TEXTURE_PIXELS) != at || !texels || texels > pixels->count - at)
            break;
        if (!i) end[count++] = first;
        at += texels;
        end[count++] = first + 4 * at;
    }
    if (!count || end[count - 1] < size) end[count++] = size;
    return count;
}

enum lw_status lw_package_cut(const uint8_t *bytes, size_t size, uint64_t **out_end, size_t *out_count) {
    uint64_t *end = malloc((LW_SCENE_TEXTURES_MAX + 2) * sizeof *end);
    if (!end) return LW_NO_MEMORY;
    end[0] = size;
    *out_count = 1;
    if (check_header(bytes, size, NULL) == LW_OK) {
        const uint32_t version = lw_records_get_u32(bytes + 8);
        struct lw_records c = records_of(LW_RECORDS_READ, version, NULL);
        uint8_t *unchanged = (uint8_t *)bytes; /* tables are only read */
        if (read_table(&c, unchanged, size) == LW_OK) *out_count = find_cuts(&c, bytes, size, end);
    }
    *out_end = end;
    return LW_OK;
}

void lw_package_hash(const uint8_t *bytes, size_t size, struct lw_package_hash *out_hash) {
    XXH128_canonical_t canonical;
    XXH128_canonicalFromHash(&canonical, XXH3_128bits(bytes, size));
    memcpy(out_hash->bytes, canonical.digest, sizeof out_hash->bytes);
}

static enum lw_status read_fully(int fd, uint8_t *bytes, size_t size, const char *path,
                                 struct lw_error *err) {
    for (size_t done = 0; done < size;) {
        ssize_t n = read(fd, bytes + done, size - done);
        if (n < 0 && errno == EINTR) continue;
        if (n < 0) return lw_status_fail(err, LW_IO, "%s: cannot read: %s", path, strerror(errno));
        if (n == 0) return lw_status_fail(err, LW_IO, "%s: became shorter while it was read", path);
        done += (size_t)n;
    }
    return LW_OK;
}

static enum lw_status load_from(int fd, const char *path, struct lw_scene **out_scene, struct lw_error *err) {
    struct stat st;
    if (fstat(fd, &st) != 0) return lw_status_fail(err, LW_IO, "%s: %s", path, strerror(errno));
    if (!S_ISREG(st.st_mode)) return lw_status_fail(err, LW_NO_INPUT, "%s: not a regular file", path);
    uint64_t size = (uint64_t)st.st_size;
    if (size > LW_PACKAGE_SIZE_MAX)
        return lw_status_fail(err, LW_BAD_DATA, "%s: scene package has %llu bytes; the limit is %llu", path,
                              (unsigned long long)size, LW_PACKAGE_SIZE_MAX);
    struct lw_scene *scene = NULL;
    uint8_t *bytes = NULL;
    enum lw_status status = create_holder(size, &scene, &bytes, err);
    if (status) return status;
    status = read_fully(fd, bytes, size, path, err);
    if (status) goto fail;
    status = check_header(bytes, size, err);
    if (!status) status = read_in_place(scene, bytes, size, err);
    if (status) {
        lw_status_context(err, "%s", path);
        goto fail;
    }
    *out_scene = scene;
    return LW_OK;
fail:
    lw_scene_destroy(scene);
    return status;
}

bool lw_package_is(const char *path) {
    const size_t length = strlen(path), suffix = strlen(SUFFIX);
    if (length >= suffix && strcmp(path + length - suffix, SUFFIX) == 0) return true;
    char start[LW_RECORDS_MAGIC];
    int fd = open(path, O_RDONLY | O_CLOEXEC | O_NONBLOCK);
    if (fd < 0) return false;
    ssize_t got = read(fd, start, sizeof start);
    close(fd);
    return got == (ssize_t)sizeof start && memcmp(start, MAGIC, sizeof start) == 0;
}

enum lw_status lw_package_load(const char *path, struct lw_scene **out_scene, struct lw_error *err) {
    int fd = open(path, O_RDONLY | O_CLOEXEC | O_NONBLOCK); /* nonblocking: a pipe must not hang us */
    if (fd < 0) return lw_status_fail(err, LW_NO_INPUT, "%s: %s", path, strerror(errno));
    enum lw_status status = load_from(fd, path, out_scene, err);
    close(fd);
    return status;
}

enum lw_status lw_package_save_stoppable(const struct lw_scene *scene, const char *path,
                                         const volatile sig_atomic_t *stop, struct lw_error *err) {
    uint8_t *bytes;
    size_t size;
    struct lw_atomic_file file;
    enum lw_status status = lw_package_write_sealed(scene, &bytes, &size, err);
    if (status) {
        lw_status_context(err, "%s", path);
        return status;
    }
    status = lw_atomic_file_open(&file, path, err);
    if (status == LW_OK && file.temporary_path) lw_atomic_file_sweep(file.path);
    file.durable = true;
    file.stop = stop;
    if (status == LW_OK) status = lw_atomic_file_write(&file, bytes, size, err);
    free(bytes);
    if (status == LW_OK) return lw_atomic_file_commit(&file, err);
    lw_atomic_file_abandon(&file);
    return status;
}

enum lw_status lw_package_save(const struct lw_scene *scene, const char *path, struct lw_error *err) {
    return lw_package_save_stoppable(scene, path, NULL, err);
}
