#include "common/scene/finish_package.h"

#include "common/scene/pixel_filter.h"
#include "common/scene/records.h"

#include <stdlib.h>
#include <string.h>

#define MAGIC "LWFINIS\n"

/* id - 1, name, bytes per element, most elements; the order is the package's */
#define SECTION_MAP(X)                                                                                       \
    X(SCENE, "scene", 16, 1)                                                                                 \
    X(FINISHES, "finishes", 168, LW_SCENE_MATERIALS_MAX)                                                     \
    X(TEXTURES, "textures", 32, LW_SCENE_TEXTURES_MAX)                                                       \
    X(MESHES, "meshes", 8, LW_SCENE_MESHES_MAX)                                                              \
    X(STRINGS, "strings", 1, LW_RECORDS_NO_LIMIT)                                                            \
    X(TANGENTS, "tangents", 2, LW_RECORDS_NO_LIMIT)                                                          \
    X(PIXELS, "pixels", 1, LW_RECORDS_NO_LIMIT)

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

static const struct lw_records_format format = {MAGIC, "finish package", kinds, SECTION_STRINGS,
                                                LW_FINISH_PACKAGE_SIZE_MAX};

/* A finish with its material, and tangents with their mesh. */
struct finish_of {
    uint32_t material;
    struct lw_finish finish;
};
struct tangents_of {
    uint32_t mesh;
    const uint16_t *tangent;
};

/* Contents of the package, in their order. */
struct content {
    struct lw_scene *scene;
    struct finish_of *finish;
    struct tangents_of *tangents;
    struct lw_texture *texture;
    uint32_t finish_count, mesh_count, texture_count;
};

/* ---- records ---- */

/* The counts of the scene that it belongs to: its records have numbers of that scene. */
static void scene_record(struct lw_records *c, const struct lw_scene *scene) {
    const struct {
        uint32_t count;
        const char *what;
    } expected[] = {{scene->material_count, "materials"}, {scene->mesh_count, "meshes"}};
    for (int i = 0; i < 2; i++) {
        uint32_t count = expected[i].count;
        lw_record_words(c, &count, 1);
        if (count != expected[i].count)
            lw_record_fail(c, "is of another scene, with %u %s, not %u", count, expected[i].what,
                           expected[i].count);
    }
    lw_record_reserved(c);
    lw_record_reserved(c);
}

static void finish_record(struct lw_records *c, struct finish_of *of) {
    struct lw_finish *f = &of->finish;
    lw_record_words(c, &of->material, 1);
    lw_record_words(c, &f->metalness, 1);
    lw_record_words(c, &f->roughness, 1);
    lw_record_words(c, &f->specular, 1);
    lw_record_words(c, f->specular_colour, 3);
    lw_record_words(c, &f->ior, 1);
    lw_record_words(c, &f->occlusion, 1);
    lw_record_words(c, &f->normal_scale, 1);
    lw_record_texture_use(c, &f->surface_texture);
    lw_record_texture_use(c, &f->specular_texture);
    lw_record_texture_use(c, &f->occlusion_texture);
    lw_record_texture_use(c, &f->normal_texture);
}

/* Bytes of a texel: R, G, B, A of a colour, x and y of a normal, or R, G, B of a surface. */
static uint32_t planes_of(uint8_t content) {
    return content == LW_CONTENT_COLOUR ? 4 : content == LW_CONTENT_NORMAL ? 2 : 3;
}

static void restore_texels(uint8_t *rgba, size_t count, uint8_t content) {
    for (size_t i = 0; i < count; i++) {
        if (content == LW_CONTENT_NORMAL)
            rgba[4 * i + 2] = lw_scene_normal_blue(rgba[4 * i], rgba[4 * i + 1]);
        rgba[4 * i + 3] = 255;
    }
}

/* The package's bytes of a texture, filtered, to and from the scene's. */
static void filter_pixels(struct lw_records *c, struct lw_scene *scene, struct lw_texture *t,
                          uint8_t *bytes) {
    const size_t count = (size_t)t->width * t->height;
    if (c->mode == LW_RECORDS_WRITE) {
        if (t->content == LW_CONTENT_COLOUR)
            lw_pixel_filter_apply(t->rgba, t->width, t->height, bytes);
        else
            lw_pixel_filter_apply_planes(t->rgba, t->width, t->height, planes_of(t->content), bytes);
        return;
    }
    uint8_t *rgba = lw_scene_alloc(scene, count, 4);
    if (!rgba) {
        c->status = lw_status_fail(c->err, LW_NO_MEMORY, "no memory for %zu texels", count);
        return;
    }
    if (t->content == LW_CONTENT_COLOUR) {
        lw_pixel_filter_undo(bytes, t->width, t->height, rgba);
    } else {
        lw_pixel_filter_undo_planes(bytes, t->width, t->height, planes_of(t->content), rgba);
        restore_texels(rgba, count, t->content);
    }
    t->rgba = rgba;
}

static void texture_record(struct lw_records *c, struct lw_scene *scene, struct lw_texture *t) {
    t->name = lw_record_string(c, t->name);
    lw_record_words(c, &t->width, 1);
    lw_record_words(c, &t->height, 1);
    lw_record_choice(c, &t->content, LW_CONTENT_SURFACE, "content");
    lw_record_choice(c, &t->wrap_s, LW_WRAP_MIRROR, "wrap_s");
    lw_record_choice(c, &t->wrap_t, LW_WRAP_MIRROR, "wrap_t");
    uint32_t first = (uint32_t)c->section[SECTION_PIXELS].cursor;
    lw_record_words(c, &first, 1);
    if (t->width < 1 || t->width > LW_SCENE_TEXTURE_SIDE_MAX || t->height < 1 ||
        t->height > LW_SCENE_TEXTURE_SIDE_MAX)
        lw_record_fail(c, "size %ux%u; each side must be within [1, %u]", t->width, t->height,
                       LW_SCENE_TEXTURE_SIDE_MAX);
    if (c->status) return;
    const uint64_t size = (uint64_t)t->width * t->height * planes_of(t->content);
    uint8_t *bytes = lw_record_take(c, SECTION_PIXELS, size, first, "pixels");
    if (bytes && c->mode != LW_RECORDS_MEASURE) filter_pixels(c, scene, t, bytes);
}

static void tangents_record(struct lw_records *c, const struct lw_scene *scene, struct tangents_of *of) {
    lw_record_words(c, &of->mesh, 1);
    if (of->mesh >= scene->mesh_count) lw_record_fail(c, "names mesh %u of %u", of->mesh, scene->mesh_count);
    uint32_t first = (uint32_t)c->section[SECTION_TANGENTS].cursor;
    lw_record_words(c, &first, 1);
    if (c->status) return;
    const uint64_t corners = 3ull * scene->mesh[of->mesh].triangle_count;
    uint8_t *bytes = lw_record_take(c, SECTION_TANGENTS, corners, first, "tangents");
    if (bytes && c->mode == LW_RECORDS_WRITE) memcpy(bytes, of->tangent, 2 * corners);
    of->tangent = (const uint16_t *)(const void *)bytes;
}

static void all_records(struct lw_records *c, struct content *of) {
    lw_record_begin(c, SECTION_SCENE, 0);
    scene_record(c, of->scene);
    LW_RECORDS_EACH(c, SECTION_FINISHES, of->finish, of->finish_count, finish_record(c, &element))
    LW_RECORDS_EACH(c, SECTION_TEXTURES, of->texture, of->texture_count,
                    texture_record(c, of->scene, &element))
    LW_RECORDS_EACH(c, SECTION_MESHES, of->tangents, of->mesh_count, tangents_record(c, of->scene, &element))
}

/* ---- writing ---- */

/* Counts of a scene's finishes. False: no memory. */
static bool gather(const struct lw_scene *scene, struct lw_scene *copy, struct content *out) {
    *copy = *scene; /* the original is only read */
    *out = (struct content){.scene = copy,
                            .texture = copy->finish_texture,
                            .texture_count = copy->finish_texture_count,
                            .finish = malloc((scene->material_count + 1ul) * sizeof *out->finish),
                            .tangents = malloc((scene->mesh_count + 1ul) * sizeof *out->tangents)};
    if (!out->finish || !out->tangents) return false;
    for (uint32_t m = 0; m < scene->material_count; m++)
        if (scene->material[m].finish)
            out->finish[out->finish_count++] = (struct finish_of){m, *scene->material[m].finish};
    for (uint32_t m = 0; m < scene->mesh_count; m++)
        if (scene->mesh[m].tangent)
            out->tangents[out->mesh_count++] = (struct tangents_of){m, scene->mesh[m].tangent};
    return true;
}

static struct lw_records records_of(enum lw_records_mode mode, struct lw_error *err) {
    return (struct lw_records){.format = &format,
                               .mode = mode,
                               .version = LW_FINISH_PACKAGE_VERSION,
                               .section_count = SECTION_COUNT,
                               .err = err};
}

static enum lw_status write_content(struct content *content, uint8_t **out_bytes, size_t *out_size,
                                    struct lw_error *err) {
    struct lw_records c = records_of(LW_RECORDS_MEASURE, err);
    uint64_t offset[LW_RECORDS_SECTIONS_MAX], size = 0;
    all_records(&c, content);
    enum lw_status status = lw_records_measure(&c, offset, &size);
    if (status) return status;
    uint8_t *bytes = calloc(size, 1); /* reserved fields and padding are zero */
    if (!bytes) return lw_status_fail(err, LW_NO_MEMORY, "no memory for the finishes of a scene");
    lw_records_start_writing(&c, offset, bytes, size);
    all_records(&c, content);
    *out_bytes = bytes;
    *out_size = size;
    return LW_OK;
}

enum lw_status lw_finish_package_write(const struct lw_scene *scene, uint8_t **out_bytes, size_t *out_size,
                                       struct lw_error *err) {
    struct lw_scene copy;
    struct content content;
    enum lw_status status = LW_OK;
    if (!gather(scene, &copy, &content))
        status = lw_status_fail(err, LW_NO_MEMORY, "no memory for the finishes of a scene");
    if (!status) status = write_content(&content, out_bytes, out_size, err);
    free(content.finish);
    free(content.tangents);
    return status;
}

/* ---- reading ---- */

static enum lw_status check_header(const uint8_t *bytes, size_t size, struct lw_error *err) {
    if (size < LW_RECORDS_MAGIC || memcmp(bytes, MAGIC, LW_RECORDS_MAGIC) != 0)
        return lw_status_fail(err, LW_BAD_DATA, "no finish package: it does not begin with LWFINIS");
    if (size < LW_RECORDS_HEADER + SECTION_COUNT * LW_RECORDS_ENTRY)
        return lw_status_fail(err, LW_BAD_DATA, "finish package is cut off after %zu bytes, in its header",
                              size);
    const uint32_t version = lw_records_get_u32(bytes + 8), sections = lw_records_get_u32(bytes + 12);
    if (version != LW_FINISH_PACKAGE_VERSION)
        return lw_status_fail(err, LW_BAD_DATA, "finish package has version %u; this program reads %u",
                              version, LW_FINISH_PACKAGE_VERSION);
    if (sections != SECTION_COUNT)
        return lw_status_fail(err, LW_BAD_DATA, "finish package has %u sections, not %u", sections,
                              SECTION_COUNT);
    if (lw_records_get_u64(bytes + 16) != size)
        return lw_status_fail(err, LW_BAD_DATA, "finish package says it has %llu bytes, but there are %zu",
                              (unsigned long long)lw_records_get_u64(bytes + 16), size);
    if (lw_records_get_u64(bytes + 24) != 0)
        return lw_status_fail(err, LW_BAD_DATA, "finish package: a reserved field of the header is not 0");
    return LW_OK;
}

static enum lw_status read_table(struct lw_records *c, uint8_t *bytes, size_t size) {
    enum lw_status status = lw_records_read_table(c, bytes, size);
    if (status) return status;
    if (c->section[SECTION_SCENE].count != 1)
        return lw_status_fail(c->err, LW_BAD_DATA, "section scene has %llu elements, not 1",
                              (unsigned long long)c->section[SECTION_SCENE].count);
    if (!c->section[SECTION_FINISHES].count)
        return lw_status_fail(c->err, LW_BAD_DATA,
                              "section finishes has 0 elements: then there is no finish package");
    return LW_OK;
}

/* One finish a material and one mesh once, in ascending order: there is one way to say it. */
static enum lw_status check_order(const struct content *content, struct lw_error *err) {
    for (uint32_t i = 0; i < content->finish_count; i++)
        if (content->finish[i].material >= content->scene->material_count ||
            (i && content->finish[i].material <= content->finish[i - 1].material))
            return lw_status_fail(err, LW_BAD_DATA,
                                  "section finishes, record %u: material %u, after %u of %u", i,
                                  content->finish[i].material, i ? content->finish[i - 1].material : 0,
                                  content->scene->material_count);
    for (uint32_t i = 1; i < content->mesh_count; i++)
        if (content->tangents[i].mesh <= content->tangents[i - 1].mesh)
            return lw_status_fail(err, LW_BAD_DATA, "section meshes, record %u: mesh %u, after %u", i,
                                  content->tangents[i].mesh, content->tangents[i - 1].mesh);
    return LW_OK;
}

/* To a scene that passes all checks with it, or to none. */
static enum lw_status attach(const struct content *content, struct lw_error *err) {
    struct lw_scene *scene = content->scene;
    scene->finish_texture = content->texture;
    scene->finish_texture_count = content->texture_count;
    for (uint32_t i = 0; i < content->finish_count; i++)
        scene->material[content->finish[i].material].finish = &content->finish[i].finish;
    for (uint32_t i = 0; i < content->mesh_count; i++)
        scene->mesh[content->tangents[i].mesh].tangent = content->tangents[i].tangent;
    const enum lw_status status = lw_scene_validate_finishes(scene, err);
    if (status) lw_scene_drop_finishes(scene);
    return status;
}

/* Allocates in the scene's storage: finishes live as long as it does. */
static bool allocate(struct content *content, const struct lw_records *c) {
    struct lw_scene *scene = content->scene;
    content->finish_count = (uint32_t)c->section[SECTION_FINISHES].count;
    content->texture_count = (uint32_t)c->section[SECTION_TEXTURES].count;
    content->mesh_count = (uint32_t)c->section[SECTION_MESHES].count;
    content->finish = lw_scene_alloc(scene, content->finish_count, sizeof *content->finish);
    content->texture = lw_scene_alloc(scene, content->texture_count, sizeof *content->texture);
    content->tangents = lw_scene_alloc(scene, content->mesh_count, sizeof *content->tangents);
    return content->finish && content->texture && content->tangents;
}

enum lw_status lw_finish_package_take(uint8_t *bytes, size_t size, struct lw_scene *scene,
                                      struct lw_error *err) {
    struct content content = {.scene = scene};
    struct lw_records c = records_of(LW_RECORDS_READ, err);
    enum lw_status status = check_header(bytes, size, err);
    if (!status) status = read_table(&c, bytes, size);
    if (status) return status;
    if (!allocate(&content, &c)) return lw_status_fail(err, LW_NO_MEMORY, "no memory for finishes");
    all_records(&c, &content);
    status = c.status;
    if (!status) status = lw_records_check_used(&c);
    if (!status) status = check_order(&content, err);
    return status ? status : attach(&content, err);
}

enum lw_status lw_finish_package_read(const uint8_t *bytes, size_t size, struct lw_scene *scene,
                                      struct lw_error *err) {
    const enum lw_status status = check_header(bytes, size, err);
    if (status) return status;
    uint8_t *copy = lw_scene_alloc(scene, size, 1);
    if (!copy) return lw_status_fail(err, LW_NO_MEMORY, "no memory for finishes of %zu bytes", size);
    memcpy(copy, bytes, size);
    return lw_finish_package_take(copy, size, scene, err);
}

/* ---- parts ---- */

/* Offsets in a texture's record. */
#define TEXTURE_WIDTH   8u
#define TEXTURE_HEIGHT  12u
#define TEXTURE_CONTENT 16u

enum lw_status lw_finish_package_cut(const uint8_t *bytes, size_t size, uint64_t **out_end,
                                     size_t *out_count) {
    uint64_t *end = malloc((LW_SCENE_TEXTURES_MAX + 2) * sizeof *end);
    if (!end) return LW_NO_MEMORY;
    struct lw_records c = records_of(LW_RECORDS_READ, NULL);
    uint8_t *unchanged = (uint8_t *)bytes; /* tables are only read */
    size_t count = 0;
    if (check_header(bytes, size, NULL) == LW_OK && read_table(&c, unchanged, size) == LW_OK &&
        c.section[SECTION_TEXTURES].count) {
        uint64_t at = (uint64_t)(c.section[SECTION_PIXELS].bytes - bytes);
        end[count++] = at;
        for (uint64_t i = 0; i < c.section[SECTION_TEXTURES].count; i++) {
            const uint8_t *record =
                c.section[SECTION_TEXTURES].bytes + i * kinds[SECTION_TEXTURES].element_size;
            const uint64_t texels = (uint64_t)lw_records_get_u32(record + TEXTURE_WIDTH) *
                                    lw_records_get_u32(record + TEXTURE_HEIGHT);
            const uint64_t planes = planes_of((uint8_t)lw_records_get_u32(record + TEXTURE_CONTENT));
            if (!texels || texels * planes > size - at) break;
            end[count++] = at += texels * planes;
        }
    }
    if (!count || end[count - 1] < size) end[count++] = size;
    *out_end = end;
    *out_count = count;
    return LW_OK;
}
