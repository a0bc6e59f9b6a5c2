#include "tests/support/support.h"

#include "common/scene/package.h"

#include <ctype.h>
#include <dirent.h>
#include <signal.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/resource.h>
#include <sys/stat.h>
#include <unistd.h>

/* Allocations until one fails; negative: none does. The linker sends the library's calls here. */
static long allocations_left = -1;

static bool allocation_fails(void) { return allocations_left >= 0 && allocations_left-- == 0; }

void *__real_malloc(size_t size);
void *__real_calloc(size_t count, size_t size);
void *__real_realloc(void *memory, size_t size);
void *__wrap_malloc(size_t size);
void *__wrap_calloc(size_t count, size_t size);
void *__wrap_realloc(void *memory, size_t size);
void *__wrap_malloc(size_t size) { return allocation_fails() ? NULL : __real_malloc(size); }
void *__wrap_calloc(size_t count, size_t size) {
    return allocation_fails() ? NULL : __real_calloc(count, size);
}
void *__wrap_realloc(void *memory, size_t size) {
    return allocation_fails() ? NULL : __real_realloc(memory, size);
}

/* What docs/scene_package.md shows byte by byte: one triangle that shines. */
static struct lw_scene *build_example(void) {
    static const struct lw_vec3 position[] = {{0, 0, 0}, {1, 0, 0}, {0, 1, 0}};
    static const struct lw_vec3 normal[] = {{0, 0, 1}, {0, 0, 1}, {0, 0, 1}};
    static const uint32_t triangle[][3] = {{0, 1, 2}};
    static const uint32_t triangle_material[] = {0};
    static struct lw_mesh mesh = {.name = "tri",
                                  .vertex_count = 3,
                                  .triangle_count = 1,
                                  .position = position,
                                  .normal = normal,
                                  .triangle = triangle,
                                  .material = triangle_material};
    static struct lw_material material = {.name = "glow",
                                          .base_colour = {0.5f, 0.5f, 0.5f, 1},
                                          .emission = {2, 1, 0.5f},
                                          .base_colour_texture = {LW_SCENE_NONE, 0, {1, 0, 0, 0, 1, 0}},
                                          .emission_texture = {LW_SCENE_NONE, 0, {1, 0, 0, 0, 1, 0}},
                                          .alpha_cutoff = 0.5f,
                                          .double_sided = 1};
    static struct lw_node node = {.name = "",
                                  .parent = LW_SCENE_NONE,
                                  .translation = {0, 1, 0},
                                  .rotation = {0, 0, 0, 1},
                                  .scale = {1, 1, 1}};
    static struct lw_object object = {.name = "tri"};
    struct lw_scene *scene;
    lw_support_ok(lw_scene_create(&scene), NULL);
    scene->name = "example";
    scene->mesh = &mesh;
    scene->material = &material;
    scene->node = &node;
    scene->object = &object;
    scene->mesh_count = scene->material_count = scene->node_count = scene->object_count = 1;
    return scene;
}

static uint8_t *write_package(const struct lw_scene *scene, size_t *out_size) {
    struct lw_error err = {0};
    uint8_t *bytes = NULL;
    lw_support_ok(lw_package_write(scene, &bytes, out_size, &err), &err);
    return bytes;
}

static uint8_t *write_sealed(const struct lw_scene *scene, size_t *out_size) {
    struct lw_error err = {0};
    uint8_t *bytes = NULL;
    lw_support_ok(lw_package_write_sealed(scene, &bytes, out_size, &err), &err);
    return bytes;
}

static uint8_t *write_everything(size_t *out_size) {
    struct lw_scene *scene = lw_support_everything();
    uint8_t *bytes = write_package(scene, out_size);
    lw_scene_destroy(scene);
    return bytes;
}

/* Bytes of the text's next block ```hex: lines of an offset, bytes, and a comment behind ';'. */
static size_t parse_document(const char **text, uint8_t *out, size_t capacity) {
    const char *line = strstr(*text, "```hex\n");
    assert_non_null(line);
    size_t count = 0;
    for (line = strchr(line, '\n') + 1; strncmp(line, "```", 3) != 0; line = strchr(line, '\n') + 1) {
        char *end;
        assert_int_equal(strtoul(line, &end, 16), count); /* the offset */
        while (true) {
            const char *start = end + strspn(end, " ");
            if (!isxdigit((unsigned char)*start)) break; /* strtoul would go on to the next line */
            unsigned long byte = strtoul(start, &end, 16);
            assert_true(byte < 256 && count < capacity);
            out[count++] = (uint8_t)byte;
        }
        assert_true(end[strspn(end, " ")] == ';' || *end == '\n');
    }
    *text = line;
    return count;
}

static void the_document_shows_the_bytes(void **state) {
    (void)state;
    size_t text_size, size;
    char *text = (char *)lw_support_read_file(lw_support_source("docs/scene_package.md"), &text_size);
    uint8_t expected[4096], head[64];
    const char *at = text;
    size_t expected_size = parse_document(&at, expected, sizeof expected);
    struct lw_scene *scene = build_example();
    uint8_t *bytes = write_package(scene, &size);
    assert_int_equal(size, expected_size);
    assert_memory_equal(bytes, expected, size);
    struct lw_scene *read;
    struct lw_error err = {0};
    lw_support_ok(lw_package_read(expected, expected_size, &read, &err), &err);
    assert_string_equal(read->object[0].name, "tri");
    assert_true(read->material[0].emission[1] == 1.0f);
    lw_scene_destroy(read);
    free(bytes);
    bytes = write_sealed(scene, &size); /* as a file: its header */
    assert_int_equal(parse_document(&at, head, sizeof head), 32);
    assert_memory_equal(bytes, head, 32);
    lw_scene_destroy(scene);
    free(bytes);
    free(text);
}

static void assert_same_use(const struct lw_texture_use *a, const struct lw_texture_use *b) {
    assert_int_equal(a->texture, b->texture);
    assert_int_equal(a->uv_set, b->uv_set);
    assert_memory_equal(a->transform, b->transform, sizeof a->transform);
}

static void assert_same_array(const void *a, const void *b, size_t size) {
    assert_int_equal(a == NULL, b == NULL);
    if (a) assert_memory_equal(a, b, size);
}

static void assert_same_mesh(const struct lw_mesh *a, const struct lw_mesh *b) {
    assert_string_equal(a->name, b->name);
    assert_int_equal(a->vertex_count, b->vertex_count);
    assert_int_equal(a->triangle_count, b->triangle_count);
    size_t vertices = a->vertex_count, triangles = a->triangle_count;
    assert_same_array(a->position, b->position, vertices * sizeof *a->position);
    assert_same_array(a->normal, b->normal, vertices * sizeof *a->normal);
    assert_same_array(a->uv[0], b->uv[0], vertices * sizeof *a->uv[0]);
    assert_same_array(a->uv[1], b->uv[1], vertices * sizeof *a->uv[1]);
    assert_same_array(a->colour, b->colour, vertices * sizeof *a->colour);
    assert_same_array(a->triangle, b->triangle, triangles * sizeof *a->triangle);
    assert_same_array(a->material, b->material, triangles * sizeof *a->material);
    assert_same_array(a->lightmap_uv, b->lightmap_uv, vertices * sizeof *a->lightmap_uv);
    assert_int_equal(a->atlas_width, b->atlas_width);
    assert_int_equal(a->atlas_height, b->atlas_height);
    assert_int_equal(a->back_offset, b->back_offset);
}

static void assert_same_surfaces(const struct lw_scene *a, const struct lw_scene *b) {
    assert_int_equal(a->mesh_count, b->mesh_count);
    for (uint32_t i = 0; i < a->mesh_count; i++) assert_same_mesh(&a->mesh[i], &b->mesh[i]);
    assert_int_equal(a->material_count, b->material_count);
    for (uint32_t i = 0; i < a->material_count; i++) {
        const struct lw_material *m = &a->material[i], *n = &b->material[i];
        assert_string_equal(m->name, n->name);
        assert_memory_equal(m->base_colour, n->base_colour, sizeof m->base_colour);
        assert_memory_equal(m->emission, n->emission, sizeof m->emission);
        assert_same_use(&m->base_colour_texture, &n->base_colour_texture);
        assert_same_use(&m->emission_texture, &n->emission_texture);
        assert_true(m->alpha_cutoff == n->alpha_cutoff);
        assert_int_equal(m->alpha_mode, n->alpha_mode);
        assert_int_equal(m->double_sided, n->double_sided);
    }
    assert_int_equal(a->texture_count, b->texture_count);
    for (uint32_t i = 0; i < a->texture_count; i++) {
        const struct lw_texture *t = &a->texture[i], *u = &b->texture[i];
        assert_string_equal(t->name, u->name);
        assert_int_equal(t->width, u->width);
        assert_int_equal(t->height, u->height);
        assert_int_equal(t->wrap_s, u->wrap_s);
        assert_int_equal(t->wrap_t, u->wrap_t);
        assert_memory_equal(t->rgba, u->rgba, 4 * (size_t)t->width * t->height);
    }
}

static void assert_same_places(const struct lw_scene *a, const struct lw_scene *b) {
    assert_int_equal(a->node_count, b->node_count);
    for (uint32_t i = 0; i < a->node_count; i++) {
        const struct lw_node *m = &a->node[i], *n = &b->node[i];
        assert_string_equal(m->name, n->name);
        assert_int_equal(m->parent, n->parent);
        assert_memory_equal(m->translation, n->translation, sizeof m->translation);
        assert_memory_equal(m->rotation, n->rotation, sizeof m->rotation);
        assert_memory_equal(m->scale, n->scale, sizeof m->scale);
        assert_memory_equal(&m->matrix, &n->matrix, sizeof m->matrix);
        assert_int_equal(m->has_matrix, n->has_matrix);
    }
    assert_int_equal(a->object_count, b->object_count);
    for (uint32_t i = 0; i < a->object_count; i++) {
        assert_string_equal(a->object[i].name, b->object[i].name);
        assert_int_equal(a->object[i].mesh, b->object[i].mesh);
        assert_int_equal(a->object[i].node, b->object[i].node);
    }
    assert_int_equal(a->camera_count, b->camera_count);
    for (uint32_t i = 0; i < a->camera_count; i++) {
        assert_string_equal(a->camera[i].name, b->camera[i].name);
        assert_int_equal(a->camera[i].node, b->camera[i].node);
        assert_true(a->camera[i].fov_y == b->camera[i].fov_y);
        assert_true(a->camera[i].height_m == b->camera[i].height_m);
    }
}

static void assert_same_lights(const struct lw_scene *a, const struct lw_scene *b) {
    assert_int_equal(a->light_count, b->light_count);
    for (uint32_t i = 0; i < a->light_count; i++) {
        const struct lw_light *l = &a->light[i], *m = &b->light[i];
        assert_string_equal(l->name, m->name);
        assert_int_equal(l->node, m->node);
        assert_int_equal(l->kind, m->kind);
        assert_memory_equal(l->intensity, m->intensity, sizeof l->intensity);
        assert_true(l->inner_cone == m->inner_cone && l->outer_cone == m->outer_cone);
        assert_true(l->angular_diameter == m->angular_diameter);
    }
}

static void assert_same_channels(const struct lw_scene *a, const struct lw_scene *b) {
    assert_int_equal(a->channel_count, b->channel_count);
    for (uint32_t i = 0; i < a->channel_count; i++) {
        const struct lw_channel *c = &a->channel[i], *d = &b->channel[i];
        assert_int_equal(c->node, d->node);
        assert_int_equal(c->path, d->path);
        assert_int_equal(c->interpolation, d->interpolation);
        assert_int_equal(c->key_count, d->key_count);
        size_t width = c->path == LW_CHANNEL_ROTATION ? 4 : 3;
        if (c->interpolation == LW_INTERPOLATION_CUBIC) width *= 3;
        assert_memory_equal(c->time_s, d->time_s, c->key_count * sizeof(float));
        assert_memory_equal(c->value, d->value, c->key_count * width * sizeof(float));
    }
}

static void assert_same_scene(const struct lw_scene *a, const struct lw_scene *b) {
    assert_string_equal(a->name, b->name);
    assert_true(a->duration_s == b->duration_s);
    assert_memory_equal(a->sky, b->sky, sizeof a->sky);
    assert_same_surfaces(a, b);
    assert_same_places(a, b);
    assert_same_lights(a, b);
    assert_same_channels(a, b);
}

static void everything_comes_back(void **state) {
    (void)state;
    struct lw_scene *scene = lw_support_everything(), *read;
    size_t size, again_size;
    uint8_t *bytes = write_package(scene, &size);
    struct lw_error err = {0};
    lw_support_ok(lw_package_read(bytes, size, &read, &err), &err);
    uint8_t *again = write_package(read, &again_size);
    assert_int_equal(again_size, size);
    assert_memory_equal(again, bytes, size);
    memset(bytes, 0xEE, size); /* the scene needs nothing of what it was read from */
    free(bytes);
    assert_same_scene(scene, read);
    free(again);
    lw_scene_destroy(read);
    lw_scene_destroy(scene);
}

static void same_scene_same_bytes(void **state) {
    (void)state;
    size_t size, other_size;
    uint8_t *bytes = write_everything(&size);
    /* memory with other garbage in it */
    for (int i = 0; i < 50; i++) {
        void *garbage = malloc(100u << i % 10);
        assert_non_null(garbage);
        memset(garbage, 0x5A, 100u << i % 10);
        free(garbage);
    }
    uint8_t *other = write_everything(&other_size);
    assert_int_equal(size, other_size);
    assert_memory_equal(bytes, other, size);
    free(bytes);
    free(other);
}

static void an_unsound_scene_is_not_written(void **state) {
    (void)state;
    struct lw_scene *scene = lw_support_everything();
    scene->object[1].mesh = 99;
    uint8_t *bytes = NULL;
    size_t size = 0;
    struct lw_error err = {0};
    enum lw_status status = lw_package_write(scene, &bytes, &size, &err);
    lw_support_fails(status, LW_BAD_DATA, &err, "object 1 \"second\": names mesh 99 of 2");
    assert_null(bytes);
    err = (struct lw_error){0};
    const char *path = lw_support_temporary("unsound.lwscene");
    status = lw_package_save(scene, path, &err);
    lw_support_fails(status, LW_BAD_DATA, &err, "unsound.lwscene: object 1");
    assert_int_equal(access(path, F_OK), -1);
    lw_scene_destroy(scene);
}

/* Reads from a block of exactly that size, so that a sanitizer sees every byte too many. */
static enum lw_status read_exactly(const uint8_t *bytes, size_t size, struct lw_error *err) {
    uint8_t *block = malloc(size ? size : 1);
    assert_non_null(block);
    memcpy(block, bytes, size);
    struct lw_scene *scene = NULL;
    enum lw_status status = lw_package_read(block, size, &scene, err);
    free(block);
    assert_int_equal(scene != NULL, status == LW_OK);
    lw_scene_destroy(scene);
    return status;
}

static void set_u32(uint8_t *p, uint32_t value) { memcpy(p, &value, sizeof value); }
static void set_u64(uint8_t *p, uint64_t value) { memcpy(p, &value, sizeof value); }

static void cut_off_anywhere_is_refused(void **state) {
    (void)state;
    size_t size;
    uint8_t *bytes = write_everything(&size);
    for (size_t cut = 0; cut < size; cut++) {
        struct lw_error err = {0};
        assert_int_equal(read_exactly(bytes, cut, &err), LW_BAD_DATA);
        assert_true(*err.text);
        /* a liar may also adapt the size field */
        if (cut < 24) continue;
        uint8_t header_size[8];
        memcpy(header_size, bytes + 16, 8);
        set_u64(bytes + 16, cut);
        assert_int_equal(read_exactly(bytes, cut, NULL), LW_BAD_DATA);
        memcpy(bytes + 16, header_size, 8);
    }
    free(bytes);
}

static void every_flipped_bit_is_refused_or_sound(void **state) {
    (void)state;
    size_t size;
    uint8_t *bytes = write_everything(&size);
    size_t refused = 0;
    for (size_t bit = 0; bit < 8 * size; bit++) {
        bytes[bit / 8] ^= (uint8_t)(1u << bit % 8);
        struct lw_error err = {0};
        enum lw_status status = read_exactly(bytes, size, &err);
        assert_true(status == LW_OK || (status == LW_BAD_DATA && *err.text));
        refused += status != LW_OK;
        bytes[bit / 8] ^= (uint8_t)(1u << bit % 8);
    }
    assert_true(refused > 8 * 512); /* every bit of the header at least */
    assert_int_equal(read_exactly(bytes, size, NULL), LW_OK);
    free(bytes);
}

/* As files have it: whatever else it is, it is not read. */
static void no_flipped_bit_of_a_sealed_package_is_read(void **state) {
    (void)state;
    struct lw_scene *scene = lw_support_everything(), *read;
    struct lw_error err = {0};
    size_t size, again_size;
    uint8_t *bytes = write_sealed(scene, &size);
    assert_int_equal(bytes[8], 5);
    lw_support_ok(lw_package_read(bytes, size, &read, &err), &err);
    assert_same_scene(scene, read);
    uint8_t *again = write_sealed(read, &again_size);
    assert_int_equal(again_size, size);
    assert_memory_equal(again, bytes, size);
    free(again);
    lw_scene_destroy(read);
    lw_scene_destroy(scene);
    for (size_t bit = 0; bit < 8 * size; bit++) {
        err = (struct lw_error){0};
        bytes[bit / 8] ^= (uint8_t)(1u << bit % 8);
        if (read_exactly(bytes, size, &err) != LW_BAD_DATA || !*err.text)
            fail_msg("bit %zu of byte %zu is flipped, and it is read", bit % 8, bit / 8);
        bytes[bit / 8] ^= (uint8_t)(1u << bit % 8);
    }
    for (size_t cut = 0; cut < size; cut++) assert_int_equal(read_exactly(bytes, cut, NULL), LW_BAD_DATA);
    assert_int_equal(read_exactly(bytes, size, NULL), LW_OK);
    free(bytes);
}

/* What a disk that lost a write leaves; and two that changed places. */
static void no_lost_block_of_a_sealed_file_is_read(void **state) {
    (void)state;
    static const size_t blocks[] = {512, 4096};
    struct lw_scene *scene = lw_support_squares(800, 1), *read = NULL;
    const char *path = lw_support_temporary("lost.lwscene");
    struct lw_error err = {0};
    size_t size, lost = 0;
    lw_support_ok(lw_package_save(scene, path, &err), &err);
    lw_scene_destroy(scene);
    uint8_t *bytes = lw_support_read_file(path, &size), *damaged = malloc(size);
    assert_non_null(damaged);
    assert_true(size > 20 * 4096);
    for (size_t b = 0; b < 2; b++)
        for (size_t at = 0; at < size; at += blocks[b]) {
            const size_t length = size - at < blocks[b] ? size - at : blocks[b];
            memcpy(damaged, bytes, size);
            memset(damaged + at, 0, length);
            if (memcmp(damaged, bytes, size) == 0) continue; /* zeros were there */
            lost++;
            if (read_exactly(damaged, size, NULL) != LW_BAD_DATA)
                fail_msg("%zu bytes from %zu on are zero, and it is read", length, at);
        }
    assert_true(lost > 100);
    memcpy(damaged, bytes, size);
    memcpy(damaged + 4096, bytes + 8192, 4096);
    memcpy(damaged + 8192, bytes + 4096, 4096);
    lw_support_write_file(path, damaged, size);
    lw_support_fails(lw_package_load(path, &read, &err), LW_BAD_DATA, &err,
                     "lost.lwscene: scene package is damaged: its bytes do not have its checksum");
    assert_null(read);
    free(damaged);
    free(bytes);
}

static void every_word_with_an_extreme_value_is_refused_or_sound(void **state) {
    (void)state;
    static const uint32_t extremes[] = {
        0,          1,          3,          4,          0x7F,       0x100,      0x7FFFFFFF, 0x80000000,
        0xFFFFFFFE, 0xFFFFFFFF, 0x7F800000, 0xFF800000, 0x7FC00000, 0x7F7FFFFF, 0x00000001, 0x40000000};
    size_t size;
    uint8_t *bytes = write_everything(&size);
    for (size_t word = 0; word + 4 <= size; word += 4) {
        uint8_t kept[4];
        memcpy(kept, bytes + word, 4);
        for (size_t i = 0; i < sizeof extremes / sizeof *extremes; i++) {
            set_u32(bytes + word, extremes[i]);
            struct lw_error err = {0};
            enum lw_status status = read_exactly(bytes, size, &err);
            assert_true(status == LW_OK || (status == LW_BAD_DATA && *err.text));
        }
        memcpy(bytes + word, kept, 4);
    }
    free(bytes);
}

#define HEADER_SIZE 32u
#define ENTRY(n)    (HEADER_SIZE + 24u * ((n)-1)) /* offset of section id n */
enum {
    SCENE = 1,
    MESHES,
    MATERIALS,
    TEXTURES,
    NODES,
    OBJECTS,
    LIGHTS,
    CAMERAS,
    CHANNELS,
    STRINGS,
    POSITIONS
};

static uint64_t section_offset(const uint8_t *bytes, unsigned id) {
    uint64_t offset;
    memcpy(&offset, bytes + ENTRY(id) + 8, sizeof offset);
    return offset;
}

static uint32_t float_bits(float value) {
    uint32_t bits;
    memcpy(&bits, &value, sizeof bits);
    return bits;
}

/* A round trip cannot see two fields that writer and reader swap alike; the offsets of the document can. */
static void fields_lie_where_the_document_says(void **state) {
    (void)state;
    const struct {
        unsigned section, record_size, record, offset;
        uint32_t value;
    } fields[] = {
        {SCENE, 24, 0, 8, float_bits(4)},
        {SCENE, 24, 0, 12, float_bits(0.5f)},
        {MESHES, 64, 0, 8, 4},
        {MESHES, 64, 0, 12, 2},
        {MESHES, 64, 0, 28, 4},
        {MESHES, 64, 0, 48, 12},
        {MESHES, 64, 0, 52, 24},
        {MESHES, 64, 0, 56, 12},
        {MATERIALS, 112, 2, 40, 2},
        {MATERIALS, 112, 2, 72, 1},
        {MATERIALS, 112, 2, 76, 1},
        {MATERIALS, 112, 1, 36, float_bits(0.25f)},
        {MATERIALS, 112, 1, 104, 1},
        {MATERIALS, 112, 1, 108, 1},
        {MATERIALS, 112, 2, 24, float_bits(10)},
        {TEXTURES, 28, 2, 8, 3},
        {TEXTURES, 28, 2, 12, 1},
        {TEXTURES, 28, 2, 16, 5},
        {TEXTURES, 28, 2, 20, 1},
        {TEXTURES, 28, 2, 24, 2},
        {NODES, 104, 2, 8, 1},
        {NODES, 104, 1, 12, 1},
        {NODES, 104, 1, 56, float_bits(-1)},
        {NODES, 104, 2, 48, float_bits(2)},
        {NODES, 104, 3, 20, float_bits(10)},
        {NODES, 104, 3, 28, float_bits(0.6f)},
        {OBJECTS, 16, 1, 8, 0},
        {OBJECTS, 16, 1, 12, 3},
        {LIGHTS, 40, 1, 8, 2},
        {LIGHTS, 40, 1, 12, 1},
        {LIGHTS, 40, 1, 16, float_bits(4)},
        {LIGHTS, 40, 1, 28, float_bits(0.1f)},
        {LIGHTS, 40, 1, 32, float_bits(0.75f)},
        {LIGHTS, 40, 2, 36, float_bits(0.0093f)},
        {CAMERAS, 16, 0, 8, 3},
        {CAMERAS, 16, 0, 12, float_bits(1)},
        {CHANNELS, 24, 1, 0, 2},
        {CHANNELS, 24, 1, 4, 1},
        {CHANNELS, 24, 3, 8, 2},
        {CHANNELS, 24, 2, 12, 2},
        {CHANNELS, 24, 2, 16, 6},
        {CHANNELS, 24, 2, 20, 21},
    };
    size_t size;
    uint8_t *bytes = write_everything(&size);
    for (size_t i = 0; i < sizeof fields / sizeof *fields; i++) {
        uint32_t value;
        memcpy(&value,
               bytes + section_offset(bytes, fields[i].section) + fields[i].record * fields[i].record_size +
                   fields[i].offset,
               sizeof value);
        if (value != fields[i].value)
            fail_msg("section %u, record %u, offset %u: 0x%x instead of 0x%x", fields[i].section,
                     fields[i].record, fields[i].offset, value, fields[i].value);
    }
    free(bytes);
}

/* One lie each: the name of a place, and its message. */
#define LIE_MAP(X)                                                                                           \
    X("does not begin with LWSCENE", b[0] = 'l')                                                             \
    X("has version 8; this program reads versions 1 to 7", set_u32(b + 8, 8))                                \
    X("has 22 sections; version 1 has 20", set_u32(b + 8, 1))                                                \
    X("has 21 sections; version 3 has 22", set_u32(b + 12, 21))                                              \
    X("section environments has 0 elements, not 1: without one", set_u32(b + 8, 2))                          \
    X("says it has 12 bytes", set_u64(b + 16, 12))                                                           \
    X("reserved field of the header", b[24] = 1)                                                             \
    X("entry 1 of the section table has id 3, not 2 (meshes)", set_u32(b + ENTRY(MESHES), 3))                \
    X("entry 2 of the section table has id 2, not 3 (materials)",                                            \
      memcpy(b + ENTRY(MATERIALS), b + ENTRY(MESHES), 24))                                                   \
    X("section meshes has elements of 60 bytes, not 64", set_u32(b + ENTRY(MESHES) + 4, 60))                 \
    X("section positions starts at byte",                                                                    \
      set_u64(b + ENTRY(POSITIONS) + 8, section_offset(b, POSITIONS) + 1))                                   \
    X("section positions starts at byte", set_u64(b + ENTRY(POSITIONS) + 8, section_offset(b, STRINGS)))     \
    X("section nodes starts at byte 18446744073709551600", set_u64(b + ENTRY(NODES) + 8, (uint64_t)-16))     \
    X("section strings has 18446744073709551615 elements, more",                                             \
      set_u64(b + ENTRY(STRINGS) + 16, UINT64_MAX))                                                          \
    X("section meshes has 288230376151711744 elements, more", set_u64(b + ENTRY(MESHES) + 16, 1ull << 58))   \
    X("section meshes starts at byte 592, not 560", set_u64(b + ENTRY(SCENE) + 16, 0))                       \
    X("before section meshes is padding, but not 0", b[section_offset(b, SCENE) + 24] = 1)                   \
    X("section scene, record 0: name starts at 1 of strings; the next free element is 0",                    \
      set_u32(b + section_offset(b, SCENE), 1))                                                              \
    X("section scene, record 0: name of 3 bytes does not end", set_u32(b + section_offset(b, SCENE) + 4, 3)) \
    X("section scene, record 0: name takes", set_u32(b + section_offset(b, SCENE) + 4, UINT32_MAX))          \
    X("section scene, record 0: name of 26 bytes does not end", b[section_offset(b, STRINGS) + 4] = 0)       \
    X("scene: name is not UTF-8", b[section_offset(b, STRINGS)] = 0xFF)                                      \
    X("section meshes, record 0: positions takes 4294967295 positions",                                      \
      set_u32(b + section_offset(b, MESHES) + 8, UINT32_MAX))                                                \
    X("section meshes, record 0: a reserved field is 9", b[section_offset(b, MESHES) + 60] = 9)              \
    X("section meshes, record 1: positions starts at 0 of positions; the next free element is 4",            \
      set_u32(b + section_offset(b, MESHES) + 64 + 16, 0))                                                   \
    X("section positions has 7 elements, but 4 are in use",                                                  \
      set_u32(b + section_offset(b, MESHES) + 64 + 16, UINT32_MAX))                                          \
    X("section materials, record 2: alpha mode is 258",                                                      \
      set_u32(b + section_offset(b, MATERIALS) + 2 * 112 + 104, 258))                                        \
    X("section textures, record 0: pixels takes 268435456 pixels",                                           \
      (set_u32(b + section_offset(b, TEXTURES) + 8, 16384),                                                  \
       set_u32(b + section_offset(b, TEXTURES) + 12, 16384)))                                                \
    X("section textures, record 0: pixels takes 18446744065119617025 pixels",                                \
      (set_u32(b + section_offset(b, TEXTURES) + 8, UINT32_MAX),                                             \
       set_u32(b + section_offset(b, TEXTURES) + 12, UINT32_MAX)))                                           \
    X("section channels, record 2: times takes 103 key times",                                               \
      b[section_offset(b, CHANNELS) + 2 * 24 + 12] = 3 + 100)                                                \
    X("node 2 \"turned\": parent 3", set_u32(b + section_offset(b, NODES) + 2 * 104 + 8, 3))

static void tell_lie(uint8_t *b, unsigned lie) {
    unsigned i = 0;
#define X(message, ...)                                                                                      \
    if (lie == i++) __VA_ARGS__;
    LIE_MAP(X)
#undef X
}

static const char *const lie_messages[] = {
#define X(message, ...) message,
    LIE_MAP(X)
#undef X
};

static void each_lie_is_named(void **state) {
    (void)state;
    for (unsigned lie = 0; lie < sizeof lie_messages / sizeof *lie_messages; lie++) {
        size_t size;
        uint8_t *bytes = write_everything(&size);
        tell_lie(bytes, lie);
        struct lw_error err = {0};
        enum lw_status status = read_exactly(bytes, size, &err);
        lw_support_fails(status, LW_BAD_DATA, &err, lie_messages[lie]);
        free(bytes);
    }
}

static void what_nobody_uses_is_refused(void **state) {
    (void)state;
    size_t size;
    uint8_t *bytes = write_everything(&size);
    uint8_t *longer = calloc(size + 16, 1);
    assert_non_null(longer);
    memcpy(longer, bytes, size);
    struct lw_error err = {0};
    enum lw_status status = read_exactly(longer, size + 16, &err); /* trailing garbage */
    lw_support_fails(status, LW_BAD_DATA, &err, "says it has");
    set_u64(longer + 16, size + 16);
    err = (struct lw_error){0};
    status = read_exactly(longer, size + 16, &err); /* the header knows of it, the table does not */
    lw_support_fails(status, LW_BAD_DATA, &err, "scene package ends at byte");
    uint64_t pixels;
    memcpy(&pixels, longer + ENTRY(20) + 16, sizeof pixels);
    set_u64(longer + ENTRY(20) + 16, pixels + 4); /* sections begin at multiples of 16 */
    for (unsigned id = 21; id <= 22; id++) set_u64(longer + ENTRY(id) + 8, section_offset(longer, id) + 16);
    err = (struct lw_error){0};
    status = read_exactly(longer, size + 16, &err); /* the table too, but no texture */
    lw_support_fails(status, LW_BAD_DATA, &err, "section pixels has 12 elements, but 8 are in use");
    free(longer);
    free(bytes);
}

static void a_package_without_a_scene_is_refused(void **state) {
    (void)state;
    struct lw_scene *scene;
    size_t size;
    lw_support_ok(lw_scene_create(&scene), NULL);
    uint8_t *bytes = write_package(scene, &size);
    lw_scene_destroy(scene);
    for (unsigned id = SCENE; id <= 20; id++) {
        set_u64(bytes + ENTRY(id) + 8, 512);
        set_u64(bytes + ENTRY(id) + 16, 0);
    }
    set_u64(bytes + 16, 512);
    struct lw_error err = {0};
    enum lw_status status = read_exactly(bytes, 512, &err);
    lw_support_fails(status, LW_BAD_DATA, &err, "section scene has 0 elements, not 1");
    free(bytes);
}

/* The limit of a section is checked before a record is read: records of zeros up to it pass that check. */
static void counts_are_limited(void **state) {
    (void)state;
    const uint32_t limits[] = {LW_SCENE_CAMERAS_MAX, LW_SCENE_CAMERAS_MAX + 1};
    const char *const messages[] = {"section cameras, record 0",
                                    "section cameras has 65537 elements; the limit is 65536"};
    for (int past = 0; past < 2; past++) {
        struct lw_scene *scene;
        size_t size;
        lw_support_ok(lw_scene_create(&scene), NULL);
        uint8_t *empty = write_package(scene, &size);
        lw_scene_destroy(scene);
        uint64_t cameras = section_offset(empty, CAMERAS), shift = 16ull * limits[past];
        uint8_t *bytes = calloc(size + shift, 1);
        assert_non_null(bytes);
        memcpy(bytes, empty, cameras);
        memcpy(bytes + cameras + shift, empty + cameras, size - cameras);
        set_u64(bytes + 16, size + shift);
        set_u64(bytes + ENTRY(CAMERAS) + 16, limits[past]);
        for (unsigned id = CHANNELS; id <= 20; id++)
            set_u64(bytes + ENTRY(id) + 8, section_offset(empty, id) + shift);
        struct lw_error err = {0};
        enum lw_status status = read_exactly(bytes, size + shift, &err);
        lw_support_fails(status, LW_BAD_DATA, &err, messages[past]);
        free(bytes);
        free(empty);
    }
}

/* What version 1 made of a scene with textures: two sections less, pixels as they are. */
static uint8_t *write_version_1(const struct lw_scene *scene, size_t *out_size) {
    enum { TABLE_END = 560, LESS = 48, PIXELS = 20 };
    size_t size;
    uint8_t *bytes = write_package(scene, &size), *pixels = bytes + section_offset(bytes, PIXELS);
    for (uint32_t t = 0; t < scene->texture_count; t++) {
        const size_t texture = 4 * (size_t)scene->texture[t].width * scene->texture[t].height;
        memcpy(pixels, scene->texture[t].rgba, texture);
        pixels += texture;
    }
    const size_t end = (size_t)(pixels - bytes); /* end of the last section of version 1 */
    for (unsigned id = SCENE; id <= PIXELS; id++)
        set_u64(bytes + ENTRY(id) + 8, section_offset(bytes, id) - LESS);
    memmove(bytes + TABLE_END - LESS, bytes + TABLE_END, end - TABLE_END);
    set_u32(bytes + 8, 1);
    set_u32(bytes + 12, PIXELS);
    *out_size = end - LESS;
    set_u64(bytes + 16, *out_size);
    return bytes;
}

static void textures_of_version_1_are_read(void **state) {
    (void)state;
    struct lw_scene *scene = lw_support_everything(), *read;
    size_t size, again_size, newest_size;
    uint8_t *bytes = write_version_1(scene, &size), *newest = write_package(scene, &newest_size);
    struct lw_error err = {0};
    lw_support_ok(lw_package_read(bytes, size, &read, &err), &err);
    assert_same_scene(scene, read);
    uint8_t *again = write_package(read, &again_size); /* in the newest version */
    assert_int_equal(again[8], 3);
    assert_int_equal(again_size, newest_size);
    assert_memory_equal(again, newest, newest_size);
    free(again);
    free(newest);
    free(bytes);
    lw_scene_destroy(read);
    lw_scene_destroy(scene);
}

/* In front of each texture and behind the last. */
static void parts_are_textures(void **state) {
    (void)state;
    struct lw_scene *scene = lw_support_everything();
    size_t size, count, texels = 0;
    uint64_t *end;
    uint8_t *bytes = write_package(scene, &size);
    lw_support_ok(lw_package_cut(bytes, size, &end, &count), NULL);
    assert_true(scene->texture_count > 1);
    for (uint32_t t = 0; t < scene->texture_count; t++)
        texels += (size_t)scene->texture[t].width * scene->texture[t].height;
    assert_int_equal(count, scene->texture_count + 1); /* pixels are the last section */
    assert_int_equal(end[0], size - 4 * texels);
    for (uint32_t t = 0; t < scene->texture_count; t++)
        assert_int_equal(end[t + 1] - end[t], 4 * (size_t)scene->texture[t].width * scene->texture[t].height);
    free(end);
    /* what the header, the table or a record says may be anything */
    for (size_t at = 0; at < size; at++)
        for (unsigned bit = 0; bit < 8; bit++) {
            bytes[at] ^= (uint8_t)(1u << bit);
            lw_support_ok(lw_package_cut(bytes, size, &end, &count), NULL);
            assert_true(count >= 1 && end[count - 1] == size);
            for (size_t i = 1; i < count; i++) assert_true(end[i] > end[i - 1]);
            free(end);
            bytes[at] ^= (uint8_t)(1u << bit);
        }
    lw_support_ok(lw_package_cut(bytes, 1, &end, &count), NULL);
    assert_true(count == 1 && end[0] == 1);
    free(end);
    free(bytes);
    lw_scene_destroy(scene);
}

/* Textures and an environment; and version 3 without textures, which is one of the others. */
static void version_3_has_textures(void **state) {
    (void)state;
    struct lw_scene *scene = lw_support_everything(), *read;
    float *rgb = lw_scene_alloc(scene, 3, sizeof *rgb);
    assert_non_null(rgb);
    rgb[0] = rgb[1] = rgb[2] = 1;
    scene->environment = (struct lw_environment){.width = 1, .height = 1, .rgb = rgb};
    size_t size, again_size;
    uint8_t *bytes = write_package(scene, &size);
    struct lw_error err = {0};
    assert_int_equal(bytes[8], 3);
    lw_support_ok(lw_package_read(bytes, size, &read, &err), &err);
    assert_same_scene(scene, read);
    assert_int_equal(read->environment.width, 1);
    uint8_t *again = write_package(read, &again_size);
    assert_int_equal(again_size, size);
    assert_memory_equal(again, bytes, size);
    free(again);
    free(bytes);
    lw_scene_destroy(read);
    lw_scene_destroy(scene);
    scene = lw_support_squares(1, 1);
    scene->environment = (struct lw_environment){.width = 1, .height = 1, .rgb = (const float[]){1, 1, 1}};
    bytes = write_package(scene, &size);
    set_u32(bytes + 8, 3);
    lw_support_fails(read_exactly(bytes, size, &err), LW_BAD_DATA, &err,
                     "section textures has 0 elements: without one, the version is 1 or 2");
    free(bytes);
    lw_scene_destroy(scene);
}

/* Each thing alone asks for version 6, in files and for clients, with a checksum. Without any it is one of
 * the others. */
static void version_6_says_what_is_unlit_tinted_parallel_and_dimmed(void **state) {
    (void)state;
    static const float times[] = {0, 1}, intensities[] = {1, 2, 3, 4, 5, 6}, factors[] = {0.5f, 2};
    struct lw_channel channels[] = {
        {1, LW_CHANNEL_INTENSITY, LW_INTERPOLATION_LINEAR, 2, times, intensities},
        {1, LW_CHANNEL_FACTOR, LW_INTERPOLATION_STEP, 2, times, factors},
    };
    for (unsigned what = 1; what < 16; what++) {
        struct lw_scene *scene = lw_support_everything(), *read;
        struct lw_error err = {0};
        size_t size, again_size;
        uint32_t blend = 0;
        while (scene->material[blend].alpha_mode != LW_ALPHA_BLEND) blend++;
        if (what & 1) scene->material[0].unlit = 1;
        if (what & 2) scene->material[blend].tint[2] = 13.85f;
        if (what & 4) scene->camera[1].height_m = 2.5f;
        if (what & 8) scene->light_channel = channels, scene->light_channel_count = 2;
        uint8_t *bytes = write_package(scene, &size), *sealed = write_sealed(scene, &again_size);
        assert_int_equal(bytes[8], 6);
        assert_int_equal(bytes[12], 27);
        assert_int_equal(again_size, size);
        assert_memory_equal(bytes, sealed, size);
        lw_support_ok(lw_package_read(bytes, size, &read, &err), &err);
        assert_same_scene(scene, read);
        for (uint32_t m = 0; m < scene->material_count; m++) {
            assert_int_equal(read->material[m].unlit, scene->material[m].unlit);
            assert_memory_equal(read->material[m].tint, scene->material[m].tint,
                                sizeof scene->material->tint);
        }
        assert_int_equal(read->light_channel_count, what & 8 ? 2 : 0);
        for (uint32_t i = 0; i < read->light_channel_count; i++) {
            const struct lw_channel *c = &read->light_channel[i];
            assert_int_equal(c->node, 1);
            assert_int_equal(c->path, channels[i].path);
            assert_int_equal(c->key_count, 2);
            assert_memory_equal(c->value, channels[i].value, 2 * lw_channel_width(c) * sizeof *c->value);
        }
        uint8_t *again = write_package(read, &again_size);
        assert_int_equal(again_size, size);
        assert_memory_equal(again, bytes, size);
        bytes[section_offset(bytes, 25)] ^= 1;
        lw_support_fails(read_exactly(bytes, size, &err), LW_BAD_DATA, &err, "do not have its checksum");
        free(again);
        free(sealed);
        free(bytes);
        lw_scene_destroy(read);
        lw_scene_destroy(scene);
    }
    struct lw_scene *scene = lw_support_everything();
    struct lw_error err = {0};
    size_t size;
    scene->material[0].unlit = 1;
    uint8_t *bytes = write_package(scene, &size);
    set_u32(bytes + section_offset(bytes, 25), 0);
    lw_package_seal(bytes, size);
    lw_support_fails(read_exactly(bytes, size, &err), LW_BAD_DATA, &err, "then the version is 1 to 5");
    err = (struct lw_error){0};
    set_u32(bytes + section_offset(bytes, 25), 2);
    lw_package_seal(bytes, size);
    lw_support_fails(read_exactly(bytes, size, &err), LW_BAD_DATA, &err,
                     "section material looks, record 0: unlit is 2; the largest is 1");
    free(bytes);
    lw_scene_destroy(scene);
}

/* Who draws a light or what shines; and version 4 that does not say it, which is one of the others. */
static void version_4_says_who_draws(void **state) {
    (void)state;
    struct lw_scene *scene = lw_support_everything(), *read;
    struct lw_error err = {0};
    size_t size, again_size;
    assert_true(scene->light_count > 1 && scene->material_count > 1);
    scene->light[1].drawn_by = LW_DRAWN_BY_SERVER;
    scene->material[0].drawn_by = LW_DRAWN_BY_CLIENTS;
    uint8_t *bytes = write_package(scene, &size);
    assert_int_equal(bytes[8], 4);
    assert_int_equal(bytes[12], 24);
    uint8_t *lights = bytes + section_offset(bytes, 23), *materials = bytes + section_offset(bytes, 24);
    const uint32_t of_light[2] = {0, 2}, of_material[2] = {1, 0};
    assert_memory_equal(lights, of_light, sizeof of_light);
    assert_memory_equal(materials, of_material, sizeof of_material);
    lw_support_ok(lw_package_read(bytes, size, &read, &err), &err);
    assert_same_scene(scene, read);
    assert_int_equal(read->light[0].drawn_by, LW_DRAWN_BY_RULE);
    assert_int_equal(read->light[1].drawn_by, LW_DRAWN_BY_SERVER);
    assert_int_equal(read->material[0].drawn_by, LW_DRAWN_BY_CLIENTS);
    assert_int_equal(read->material[1].drawn_by, LW_DRAWN_BY_RULE);
    uint8_t *again = write_package(read, &again_size);
    assert_int_equal(again_size, size);
    assert_memory_equal(again, bytes, size);
    free(again);
    lw_scene_destroy(read);

    set_u32(lights, 3);
    lw_support_fails(read_exactly(bytes, size, &err), LW_BAD_DATA, &err,
                     "section light drawers, record 0: who draws it is 3; the largest is 2");
    err = (struct lw_error){0};
    set_u32(lights, 0), set_u32(lights + 4, 0), set_u32(materials, 0);
    lw_support_fails(read_exactly(bytes, size, &err), LW_BAD_DATA, &err,
                     "no light and no material says who draws it: then the version is 1 to 3");
    free(bytes);
    scene->material[0].drawn_by = 3;
    err = (struct lw_error){0};
    lw_support_fails(lw_scene_validate(scene, &err), LW_BAD_DATA, &err, "drawn_by is 3");
    lw_scene_destroy(scene);
}

/* Squares under a sky of 3 x 2 texels. */
static struct lw_scene *build_outside(void) {
    struct lw_scene *scene = lw_support_squares(1, 1);
    float *rgb = lw_scene_alloc(scene, 18, sizeof *rgb);
    assert_non_null(rgb);
    for (unsigned i = 0; i < 18; i++) rgb[i] = 0.25f * (float)i;
    scene->environment = (struct lw_environment){.width = 3, .height = 2, .rgb = rgb};
    return scene;
}

static void an_environment_comes_back(void **state) {
    (void)state;
    struct lw_scene *scene = build_outside(), *read;
    size_t size, again_size;
    uint8_t *bytes = write_package(scene, &size);
    assert_int_equal(bytes[8], 2);
    assert_int_equal(bytes[12], 22);
    /* record: width, height, first texel; then the texels */
    const uint8_t *record = bytes + section_offset(bytes, 21), *texels = bytes + section_offset(bytes, 22);
    const uint32_t words[3] = {3, 2, 0};
    assert_memory_equal(record, words, sizeof words);
    assert_memory_equal(texels, scene->environment.rgb, 18 * sizeof(float));
    struct lw_error err = {0};
    lw_support_ok(lw_package_read(bytes, size, &read, &err), &err);
    assert_int_equal(read->environment.width, 3);
    assert_int_equal(read->environment.height, 2);
    assert_memory_equal(read->environment.rgb, scene->environment.rgb, 18 * sizeof(float));
    uint8_t *again = write_package(read, &again_size);
    assert_int_equal(again_size, size);
    assert_memory_equal(again, bytes, size);
    free(again);
    lw_scene_destroy(read);
    /* without one it is version 1, as ever */
    scene->environment = (struct lw_environment){0};
    uint8_t *plain = write_package(scene, &again_size);
    assert_int_equal(plain[8], 1);
    assert_int_equal(plain[12], 20);
    free(plain);
    free(bytes);
    lw_scene_destroy(scene);
}

static void lies_about_an_environment_are_named(void **state) {
    (void)state;
    const float infinite = INFINITY, negative = -1, past = 1.1e12f;
    for (unsigned lie = 0; lie < 9; lie++) {
        struct lw_scene *scene = build_outside();
        size_t size;
        uint8_t *bytes = write_package(scene, &size);
        lw_scene_destroy(scene);
        uint8_t *record = bytes + section_offset(bytes, 21), *texels = bytes + section_offset(bytes, 22);
        static const char *const messages[] = {
            "section environments, record 0: has no texels",
            "section environments, record 0: texels takes 12 environment texels",
            "section environments, record 0: texels takes 18446744065119617025 environment texels",
            "environment: is 0 x 2 texels; each side is from 1 to 4096",
            "section environments, record 0: texels starts at 1",
            "environment: radiance is inf; it must be within [0, 1e+12]",
            "environment: radiance is -1; it must be within [0, 1e+12]",
            "environment: radiance is 1.1e+12; it must be within [0, 1e+12]",
            "section environments has 0 elements, not 1: without one, the version is 1",
        };
        switch (lie) {
        case 0:
            set_u32(record + 8, UINT32_MAX);
            break;
        case 1:
            set_u32(record, 6);
            break;
        case 2:
            set_u32(record, UINT32_MAX), set_u32(record + 4, UINT32_MAX);
            break;
        case 3: /* and nothing left over */
            set_u32(record, 0);
            set_u64(bytes + ENTRY(22) + 16, 0);
            size -= 18 * sizeof(float);
            set_u64(bytes + 16, size);
            break;
        case 4:
            set_u32(record + 8, 1);
            break;
        case 5:
            memcpy(texels + 8, &infinite, 4);
            break;
        case 6:
            memcpy(texels + 8, &negative, 4);
            break;
        case 7:
            memcpy(texels + 8, &past, 4);
            break;
        case 8:
            set_u64(bytes + ENTRY(21) + 16, 0);
            set_u64(bytes + ENTRY(22) + 8, section_offset(bytes, 21));
            set_u64(bytes + ENTRY(22) + 16, 0);
            size = section_offset(bytes, 21);
            set_u64(bytes + 16, size);
            break;
        }
        struct lw_error err = {0};
        enum lw_status status = read_exactly(bytes, size, &err);
        lw_support_fails(status, LW_BAD_DATA, &err, messages[lie]);
        free(bytes);
    }
}

static void an_environment_cut_off_or_flipped_is_refused_or_sound(void **state) {
    (void)state;
    struct lw_scene *scene = build_outside();
    size_t size;
    uint8_t *bytes = write_package(scene, &size);
    lw_scene_destroy(scene);
    for (size_t cut = 0; cut < size; cut++) assert_int_equal(read_exactly(bytes, cut, NULL), LW_BAD_DATA);
    for (size_t bit = 0; bit < 8 * size; bit++) {
        bytes[bit / 8] ^= (uint8_t)(1u << bit % 8);
        enum lw_status status = read_exactly(bytes, size, NULL);
        assert_true(status == LW_OK || status == LW_BAD_DATA);
        bytes[bit / 8] ^= (uint8_t)(1u << bit % 8);
    }
    free(bytes);
}

/* The limit of a side, and one past it. */
static void environments_are_limited(void **state) {
    (void)state;
    for (uint32_t past = 0; past < 2; past++)
        for (int wide = 0; wide < 2; wide++) {
            struct lw_scene *scene = lw_support_squares(1, 1);
            uint32_t side = LW_SCENE_ENVIRONMENT_SIDE_MAX + past;
            scene->environment = (struct lw_environment){
                .width = wide ? side : 1, .height = wide ? 1 : side, .rgb = lw_scene_alloc(scene, side, 12)};
            struct lw_error err = {0};
            enum lw_status status = lw_scene_validate(scene, &err);
            if (past)
                lw_support_fails(status, LW_BAD_DATA, &err, "each side is from 1 to 4096");
            else
                lw_support_ok(status, &err);
            lw_scene_destroy(scene);
        }
}

static void failing_allocations_are_reported(void **state) {
    (void)state;
    struct lw_scene *scene = lw_support_everything();
    size_t size, other_size;
    uint8_t *bytes = write_package(scene, &size), *other;
    unsigned write_failures = 0, read_failures = 0;
    for (long n = 0;; n++, write_failures++) {
        struct lw_error err = {0};
        allocations_left = n;
        enum lw_status status = lw_package_write(scene, &other, &other_size, &err);
        allocations_left = -1;
        if (status == LW_OK) break;
        lw_support_fails(status, LW_NO_MEMORY, &err, "no memory");
    }
    assert_memory_equal(other, bytes, size);
    free(other);
    for (long n = 0;; n++, read_failures++) {
        struct lw_error err = {0};
        struct lw_scene *read = NULL;
        allocations_left = n;
        enum lw_status status = lw_package_read(bytes, size, &read, &err);
        allocations_left = -1;
        assert_int_equal(read != NULL, status == LW_OK);
        lw_scene_destroy(read);
        if (status == LW_OK) break;
        lw_support_fails(status, LW_NO_MEMORY, &err, "no memory");
    }
    /* the bytes or the scene, the check of channels, the four arrays of a pose */
    assert_true(write_failures >= 6 && read_failures >= 7);
    free(bytes);
    lw_scene_destroy(scene);
}

static void files_keep_what_was_saved(void **state) {
    (void)state;
    struct lw_scene *scene = lw_support_everything(), *read;
    struct lw_error err = {0};
    const char *path = lw_support_temporary("saved.lwscene");
    for (int i = 0; i < 2; i++)
        lw_support_ok(lw_package_save(scene, path, &err), &err); /* the second replaces */
    lw_support_ok(lw_package_load(path, &read, &err), &err);
    assert_same_scene(scene, read);
    size_t size, file_size;
    uint8_t *bytes = write_sealed(scene, &size), *file = lw_support_read_file(path, &file_size);
    assert_int_equal(size, file_size);
    assert_memory_equal(bytes, file, size);
    free(file);
    free(bytes);
    lw_scene_destroy(read);
    lw_scene_destroy(scene);
}

static unsigned count_files(const char *folder) {
    DIR *dir = opendir(folder);
    assert_non_null(dir);
    unsigned count = 0;
    for (struct dirent *entry; (entry = readdir(dir));) count += entry->d_name[0] != '.';
    closedir(dir);
    return count;
}

static void files_that_cannot_be_are_named(void **state) {
    (void)state;
    struct lw_scene *scene = lw_support_everything(), *read = NULL;
    struct lw_error err = {0};
    enum lw_status status = lw_package_load("/nonexistent/a.lwscene", &read, &err);
    lw_support_fails(status, LW_NO_INPUT, &err, "/nonexistent/a.lwscene: No such file");
    err = (struct lw_error){0};
    status = lw_package_load("/tmp", &read, &err);
    lw_support_fails(status, LW_NO_INPUT, &err, "/tmp: not a regular file");
    const char *pipe_path = lw_support_temporary("pipe");
    assert_int_equal(mkfifo(pipe_path, 0600), 0);
    err = (struct lw_error){0};
    status = lw_package_load(pipe_path, &read, &err); /* and does not wait for a writer */
    lw_support_fails(status, LW_NO_INPUT, &err, "not a regular file");
    err = (struct lw_error){0};
    lw_support_ok(lw_package_save(scene, "/dev/null", &err), &err); /* and it stays a device */
    struct stat null;
    assert_int_equal(stat("/dev/null", &null), 0);
    assert_true(S_ISCHR(null.st_mode));
    err = (struct lw_error){0};
    status = lw_package_save(scene, "/nonexistent/b.lwscene", &err);
    lw_support_fails(status, LW_CANNOT_CREATE, &err, "/nonexistent/b.lwscene");
    const char *text_path = lw_support_temporary("text.lwscene");
    lw_support_write_file(text_path, "# an OBJ, say\n", 14);
    err = (struct lw_error){0};
    status = lw_package_load(text_path, &read, &err);
    lw_support_fails(status, LW_BAD_DATA, &err, "text.lwscene: not a scene package");
    assert_null(read);
    lw_scene_destroy(scene);
}

static void a_failed_save_leaves_the_old_file_and_nothing_else(void **state) {
    (void)state;
    const char *folder = lw_support_temporary("folder");
    assert_int_equal(mkdir(folder, 0700), 0);
    const char *path = lw_support_temporary("folder/scene.lwscene");
    struct lw_scene *scene = lw_support_squares(1, 1), *read;
    struct lw_error err = {0};
    lw_support_ok(lw_package_save(scene, path, &err), &err);
    scene->name = "newer";
    struct rlimit kept, small;
    assert_int_equal(getrlimit(RLIMIT_FSIZE, &kept), 0);
    small = kept;
    small.rlim_cur = 100; /* as a full disk: the first bytes are written, the rest are not */
    signal(SIGXFSZ, SIG_IGN);
    assert_int_equal(setrlimit(RLIMIT_FSIZE, &small), 0);
    enum lw_status status = lw_package_save(scene, path, &err);
    assert_int_equal(setrlimit(RLIMIT_FSIZE, &kept), 0);
    lw_support_fails(status, LW_IO, &err, "scene.lwscene");
    assert_int_equal(count_files(folder), 1);
    err = (struct lw_error){0};
    lw_support_ok(lw_package_load(path, &read, &err), &err);
    assert_string_equal(read->name, "squares");
    lw_scene_destroy(read);
    lw_scene_destroy(scene);
}

static void a_stopped_save_leaves_the_old_file_and_nothing_else(void **state) {
    (void)state;
    const char *folder = lw_support_temporary("stopped");
    assert_int_equal(mkdir(folder, 0700), 0);
    const char *path = lw_support_temporary("stopped/scene.lwscene");
    struct lw_scene *scene = lw_support_squares(1, 1), *read;
    struct lw_error err = {0};
    volatile sig_atomic_t stop = 0;
    lw_support_ok(lw_package_save_stoppable(scene, path, &stop, &err), &err);
    assert_int_equal(chmod(path, 0604), 0);
    scene->name = "newer";
    stop = SIGTERM;
    lw_support_fails(lw_package_save_stoppable(scene, path, &stop, &err), LW_CLOSED, &err, "scene.lwscene");
    assert_int_equal(count_files(folder), 1);
    err = (struct lw_error){0};
    lw_support_ok(lw_package_load(path, &read, &err), &err);
    assert_string_equal(read->name, "squares");
    lw_scene_destroy(read);
    /* what a killed writer left goes with the next, and the file's mode stays */
    lw_support_write_file(lw_support_temporary("stopped/scene.lwscene.77-0.tmp"), "half", 4);
    lw_support_ok(lw_package_save(scene, path, &err), &err);
    struct stat st;
    assert_int_equal(stat(path, &st), 0);
    assert_int_equal(st.st_mode & 0777, 0604);
    assert_int_equal(count_files(folder), 1);
    lw_scene_destroy(scene);
}

static void hash_is_xxh3_of_the_bytes(void **state) {
    (void)state;
    /* XXH3-128 of the empty input, seed 0, as xxhsum -H2 prints it: 99aa06d3014798d86001c324468d497f */
    static const uint8_t expected[16] = {0x99, 0xAA, 0x06, 0xD3, 0x01, 0x47, 0x98, 0xD8,
                                         0x60, 0x01, 0xC3, 0x24, 0x46, 0x8D, 0x49, 0x7F};
    struct lw_package_hash hash, other;
    lw_package_hash((const uint8_t *)"", 0, &hash);
    assert_memory_equal(hash.bytes, expected, 16);
    size_t size;
    uint8_t *bytes = write_everything(&size);
    lw_package_hash(bytes, size, &hash);
    bytes[size - 1] ^= 1;
    lw_package_hash(bytes, size, &other);
    assert_memory_not_equal(hash.bytes, other.bytes, 16);
    free(bytes);
}

int main(void) {
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(the_document_shows_the_bytes),
        cmocka_unit_test(fields_lie_where_the_document_says),
        cmocka_unit_test(everything_comes_back),
        cmocka_unit_test(same_scene_same_bytes),
        cmocka_unit_test(an_unsound_scene_is_not_written),
        cmocka_unit_test(cut_off_anywhere_is_refused),
        cmocka_unit_test(every_flipped_bit_is_refused_or_sound),
        cmocka_unit_test(no_flipped_bit_of_a_sealed_package_is_read),
        cmocka_unit_test(no_lost_block_of_a_sealed_file_is_read),
        cmocka_unit_test(every_word_with_an_extreme_value_is_refused_or_sound),
        cmocka_unit_test(each_lie_is_named),
        cmocka_unit_test(what_nobody_uses_is_refused),
        cmocka_unit_test(a_package_without_a_scene_is_refused),
        cmocka_unit_test(counts_are_limited),
        cmocka_unit_test(textures_of_version_1_are_read),
        cmocka_unit_test(parts_are_textures),
        cmocka_unit_test(version_3_has_textures),
        cmocka_unit_test(version_4_says_who_draws),
        cmocka_unit_test(version_6_says_what_is_unlit_tinted_parallel_and_dimmed),
        cmocka_unit_test(an_environment_comes_back),
        cmocka_unit_test(lies_about_an_environment_are_named),
        cmocka_unit_test(an_environment_cut_off_or_flipped_is_refused_or_sound),
        cmocka_unit_test(environments_are_limited),
        cmocka_unit_test(failing_allocations_are_reported),
        cmocka_unit_test(files_keep_what_was_saved),
        cmocka_unit_test(files_that_cannot_be_are_named),
        cmocka_unit_test(a_failed_save_leaves_the_old_file_and_nothing_else),
        cmocka_unit_test(a_stopped_save_leaves_the_old_file_and_nothing_else),
        cmocka_unit_test(hash_is_xxh3_of_the_bytes),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
