#include "tests/support/damage.h"
#include "tests/support/failing_memory.h"
#include "tests/support/support.h"

#include "common/scene/finish_package.h"
#include "common/scene/package.h"

#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#define HEADER_SIZE 32u
#define ENTRY(n)    (HEADER_SIZE + 24u * ((n)-1)) /* offset of section id n */
enum { SCENE = 1, FINISHES, TEXTURES, MESHES, STRINGS, TANGENTS, PIXELS };

static void set_u32(uint8_t *p, uint32_t value) { memcpy(p, &value, sizeof value); }
static void set_u64(uint8_t *p, uint64_t value) { memcpy(p, &value, sizeof value); }
static void set_float(uint8_t *p, float value) { memcpy(p, &value, sizeof value); }

static size_t section_offset(const uint8_t *bytes, unsigned id) {
    uint64_t offset;
    memcpy(&offset, bytes + ENTRY(id) + 8, sizeof offset);
    return (size_t)offset;
}

static uint8_t *write_finishes(const struct lw_scene *scene, size_t *out_size) {
    struct lw_error err = {0};
    uint8_t *bytes = NULL;
    lw_support_ok(lw_finish_package_write(scene, &bytes, out_size, &err), &err);
    return bytes;
}

static uint8_t *write_everything(size_t *out_size) {
    struct lw_scene *scene = lw_support_everything();
    lw_support_add_finishes(scene);
    uint8_t *bytes = write_finishes(scene, out_size);
    lw_scene_destroy(scene);
    return bytes;
}

static void expect_matt(const struct lw_scene *scene) {
    assert_false(lw_scene_has_finishes(scene));
    assert_int_equal(scene->finish_texture_count, 0);
    for (uint32_t m = 0; m < scene->mesh_count; m++) assert_null(scene->mesh[m].tangent);
}

/* What docs/scene_package.md shows byte by byte: the triangle of the scene package's example. */
static struct lw_scene *build_example(void) {
    static const uint8_t bump[] = {128, 255, 128, 255, 200, 100, 233, 255};
    static const uint16_t tangent[] = {0, 0, 0x8000};
    static struct lw_texture texture = {.name = "bump",
                                        .width = 2,
                                        .height = 1,
                                        .rgba = bump,
                                        .wrap_t = LW_WRAP_CLAMP,
                                        .content = LW_CONTENT_NORMAL};
    const struct lw_texture_use none = {LW_SCENE_NONE, 0, {1, 0, 0, 0, 1, 0}};
    static struct lw_finish finish;
    finish = (struct lw_finish){.metalness = 0,
                                .roughness = 0.5f,
                                .surface_texture = none,
                                .specular = 1,
                                .specular_colour = {1, 1, 1},
                                .specular_texture = none,
                                .ior = 1.5f,
                                .occlusion = 1,
                                .occlusion_texture = none,
                                .normal_scale = 1,
                                .normal_texture = {0, 0, {1, 0, 0, 0, 1, 0}}};
    struct lw_scene *scene = lw_support_squares(1, 1);
    struct lw_mesh *mesh = scene->mesh;
    mesh->triangle_count = 1;
    mesh->tangent = tangent;
    scene->material[0].finish = &finish;
    scene->finish_texture = &texture;
    scene->finish_texture_count = 1;
    assert_int_equal(scene->mesh_count, 1);
    assert_int_equal(scene->material_count, 1);
    return scene;
}

static void the_document_shows_the_bytes(void **state) {
    (void)state;
    size_t text_size, size;
    char *text = (char *)lw_support_read_file(lw_support_source("docs/scene_package.md"), &text_size);
    uint8_t expected[1024];
    const char *example = strstr(text, "finishes of the example");
    assert_non_null(example);
    const size_t expected_size = lw_support_document_bytes(&example, expected, sizeof expected);
    struct lw_scene *scene = build_example();
    uint8_t *bytes = write_finishes(scene, &size);
    assert_int_equal(size, expected_size);
    assert_memory_equal(bytes, expected, size);
    free(bytes);
    free(text);
    lw_scene_destroy(scene);
}

static void assert_same_use(const struct lw_texture_use *a, const struct lw_texture_use *b) {
    assert_int_equal(a->texture, b->texture);
    assert_int_equal(a->uv_set, b->uv_set);
    assert_memory_equal(a->transform, b->transform, sizeof a->transform);
}

static void assert_same_finish(const struct lw_finish *a, const struct lw_finish *b) {
    assert_true(a->metalness == b->metalness && a->roughness == b->roughness);
    assert_true(a->specular == b->specular && a->ior == b->ior);
    assert_memory_equal(a->specular_colour, b->specular_colour, sizeof a->specular_colour);
    assert_true(a->occlusion == b->occlusion && a->normal_scale == b->normal_scale);
    assert_same_use(&a->surface_texture, &b->surface_texture);
    assert_same_use(&a->specular_texture, &b->specular_texture);
    assert_same_use(&a->occlusion_texture, &b->occlusion_texture);
    assert_same_use(&a->normal_texture, &b->normal_texture);
}

static void assert_same_texture(const struct lw_texture *a, const struct lw_texture *b) {
    assert_string_equal(a->name, b->name);
    assert_int_equal(a->width, b->width);
    assert_int_equal(a->height, b->height);
    assert_int_equal(a->wrap_s, b->wrap_s);
    assert_int_equal(a->wrap_t, b->wrap_t);
    assert_int_equal(a->content, b->content);
    for (size_t i = 0; i < (size_t)a->width * a->height; i++) {
        const uint8_t *p = a->rgba + 4 * i, *q = b->rgba + 4 * i;
        assert_memory_equal(p, q, a->content == LW_CONTENT_NORMAL ? 2 : 3);
        assert_int_equal(q[3], a->content == LW_CONTENT_COLOUR ? p[3] : 255);
        if (a->content != LW_CONTENT_NORMAL) continue;
        const double x = (q[0] - 127.5) / 127.5, y = (q[1] - 127.5) / 127.5;
        const double z = sqrt(fmax(0, 1 - x * x - y * y));
        assert_true(fabs(127.5 * (1 + z) - q[2]) <= 0.501);
    }
}

static void assert_same_finishes(const struct lw_scene *a, const struct lw_scene *b) {
    for (uint32_t m = 0; m < a->material_count; m++) {
        assert_int_equal(a->material[m].finish != NULL, b->material[m].finish != NULL);
        if (a->material[m].finish) assert_same_finish(a->material[m].finish, b->material[m].finish);
    }
    for (uint32_t m = 0; m < a->mesh_count; m++) {
        assert_int_equal(a->mesh[m].tangent != NULL, b->mesh[m].tangent != NULL);
        if (a->mesh[m].tangent)
            assert_memory_equal(a->mesh[m].tangent, b->mesh[m].tangent,
                                6 * (size_t)a->mesh[m].triangle_count);
    }
    assert_int_equal(a->finish_texture_count, b->finish_texture_count);
    for (uint32_t t = 0; t < a->finish_texture_count; t++)
        assert_same_texture(&a->finish_texture[t], &b->finish_texture[t]);
}

static void everything_comes_back(void **state) {
    (void)state;
    struct lw_scene *scene = lw_support_everything(), *matt = lw_support_everything();
    struct lw_error err = {0};
    size_t size, again_size;
    lw_support_add_finishes(scene);
    lw_support_ok(lw_scene_validate(scene, &err), &err);
    uint8_t *bytes = write_finishes(scene, &size);
    expect_matt(matt);
    lw_support_ok(lw_finish_package_read(bytes, size, matt, &err), &err);
    assert_same_finishes(scene, matt);
    lw_support_ok(lw_scene_validate(matt, &err), &err);
    uint8_t *again = write_finishes(matt, &again_size);
    assert_int_equal(again_size, size);
    assert_memory_equal(again, bytes, size);
    free(again);
    free(bytes);
    lw_scene_destroy(scene);
    lw_scene_destroy(matt);
}

/* A round trip cannot see two fields that writer and reader swap alike. */
static void fields_lie_where_the_document_says(void **state) {
    (void)state;
    const struct {
        unsigned section, record_size, record, offset;
        float value;
        uint32_t word;
    } fields[] = {
        {SCENE, 16, 0, 0, NAN, 3},        {SCENE, 16, 0, 4, NAN, 2},         {FINISHES, 168, 0, 0, NAN, 1},
        {FINISHES, 168, 1, 0, NAN, 2},    {FINISHES, 168, 0, 4, 0.25f, 0},   {FINISHES, 168, 0, 8, 0.5f, 0},
        {FINISHES, 168, 0, 12, 0.75f, 0}, {FINISHES, 168, 0, 20, 0.5f, 0},   {FINISHES, 168, 0, 24, 2, 0},
        {FINISHES, 168, 0, 28, 1.33f, 0}, {FINISHES, 168, 0, 32, 0.875f, 0}, {FINISHES, 168, 0, 36, -1.5f, 0},
        {FINISHES, 168, 0, 40, NAN, 1},   {FINISHES, 168, 0, 44, NAN, 1},    {FINISHES, 168, 1, 72, NAN, 2},
        {FINISHES, 168, 0, 104, NAN, 1},  {FINISHES, 168, 0, 136, NAN, 0},   {FINISHES, 168, 0, 148, 1, 0},
        {TEXTURES, 32, 1, 8, NAN, 3},     {TEXTURES, 32, 2, 12, NAN, 2},     {TEXTURES, 32, 1, 16, NAN, 2},
        {TEXTURES, 32, 1, 20, NAN, 2},    {TEXTURES, 32, 0, 24, NAN, 1},     {TEXTURES, 32, 1, 28, NAN, 8},
        {TEXTURES, 32, 2, 28, NAN, 17},   {MESHES, 8, 0, 0, NAN, 0},
    };
    size_t size;
    uint8_t *bytes = write_everything(&size);
    for (size_t i = 0; i < sizeof fields / sizeof *fields; i++) {
        uint32_t word, expected = fields[i].word;
        if (fields[i].value == fields[i].value) memcpy(&expected, &fields[i].value, sizeof expected);
        memcpy(&word,
               bytes + section_offset(bytes, fields[i].section) + fields[i].record * fields[i].record_size +
                   fields[i].offset,
               sizeof word);
        if (word != expected)
            fail_msg("section %u, record %u, offset %u: 0x%x instead of 0x%x", fields[i].section,
                     fields[i].record, fields[i].offset, word, expected);
    }
    free(bytes);
}

/* Reads from a block of exactly that size, so that a sanitizer sees every byte too many. A refused package
 * leaves no trace. */
static enum lw_status read_exactly(const uint8_t *bytes, size_t size, struct lw_error *err) {
    uint8_t *block = malloc(size ? size : 1), *again;
    assert_non_null(block);
    memcpy(block, bytes, size);
    struct lw_scene *scene = lw_support_everything();
    enum lw_status status = lw_finish_package_read(block, size, scene, err);
    free(block);
    if (status == LW_OK) { /* and there is one way to say it */
        size_t again_size;
        lw_support_ok(lw_finish_package_write(scene, &again, &again_size, NULL), NULL);
        assert_int_equal(again_size, size);
        assert_memory_equal(again, bytes, size);
        free(again);
    } else {
        expect_matt(scene);
    }
    lw_scene_destroy(scene);
    return status;
}

static void cut_off_anywhere_is_refused(void **state) {
    (void)state;
    size_t size;
    uint8_t *bytes = write_everything(&size);
    damage_cut(bytes, size, read_exactly);
    free(bytes);
}

/* As many the reader of the page refuses as well (client/web/test/finish_package.test.mjs). */
#define FLIPPED_BITS_REFUSED 3521

static void every_flipped_bit_is_refused_or_sound(void **state) {
    (void)state;
    size_t size;
    uint8_t *bytes = write_everything(&size);
    /* every bit of header and table among them */
    assert_int_equal(damage_flip(bytes, size, read_exactly), FLIPPED_BITS_REFUSED);
    free(bytes);
}

static void every_word_with_an_extreme_value_is_refused_or_sound(void **state) {
    (void)state;
    size_t size;
    uint8_t *bytes = write_everything(&size);
    damage_words(bytes, size, read_exactly);
    free(bytes);
}

/* One lie each: the name of a place, and its message. f is the first finish, t the first texture. */
#define LIE_MAP(X)                                                                                           \
    X("does not begin with LWFINIS", b[0] = 'l')                                                             \
    X("has version 2; this program reads 1", set_u32(b + 8, 2))                                              \
    X("has 8 sections, not 7", set_u32(b + 12, 8))                                                           \
    X("says it has 12 bytes", set_u64(b + 16, 12))                                                           \
    X("reserved field of the header", b[24] = 1)                                                             \
    X("section finishes has elements of 160 bytes, not 168", set_u32(b + ENTRY(FINISHES) + 4, 160))          \
    X("section pixels starts at byte", set_u64(b + ENTRY(PIXELS) + 8, section_offset(b, STRINGS)))           \
    X("before section tangents is padding, but not 0", b[section_offset(b, TANGENTS) - 1] = 1)               \
    X("record 0: is of another scene, with 4 materials, not 3", set_u32(b + section_offset(b, SCENE), 4))    \
    X("record 0: is of another scene, with 1 meshes, not 2", set_u32(b + section_offset(b, SCENE) + 4, 1))   \
    X("record 0: a reserved field is 1", set_u32(b + section_offset(b, SCENE) + 12, 1))                      \
    X("section finishes, record 1: material 1, after 1 of 3", set_u32(f + 168, 1))                           \
    X("section finishes, record 1: material 0, after 1 of 3", set_u32(f + 168, 0))                           \
    X("section finishes, record 1: material 3, after 1 of 3", set_u32(f + 168, 3))                           \
    X("metalness is 1.5", set_float(f + 4, 1.5f))                                                            \
    X("roughness is nan", set_float(f + 8, NAN))                                                             \
    X("specular is -1", set_float(f + 12, -1))                                                               \
    X("specular_colour is -1", set_float(f + 20, -1))                                                        \
    X("ior is 0.5", set_float(f + 28, 0.5f))                                                                 \
    X("occlusion is 2", set_float(f + 32, 2))                                                                \
    X("normal_scale is inf", set_float(f + 36, INFINITY))                                                    \
    X("surface_texture names texture 3 of 3", set_u32(f + 40, 3))                                            \
    X("surface_texture names texture 0, whose content is 1, not 2", set_u32(f + 40, 0))                      \
    X("surface_texture uses UV set 2", set_u32(f + 44, 2))                                                   \
    X("normal_texture has a transform that is not finite", set_float(f + 136 + 12, INFINITY))                \
    X("section textures, record 0: size 0x2", set_u32(t + 8, 0))                                             \
    X("section textures, record 0: size 16385x2", set_u32(t + 8, 16385))                                     \
    X("section textures, record 0: content is 3", set_u32(t + 16, 3))                                        \
    X("section textures, record 0: wrap_s is 3", set_u32(t + 20, 3))                                         \
    X("section textures, record 0: pixels starts at 1", set_u32(t + 28, 1))                                  \
    X("section textures, record 0: pixels takes 536870912", (set_u32(t + 8, 16384), set_u32(t + 12, 16384))) \
    X("section pixels has 25 elements, but 23 are in use", set_u32(t + 2 * 32 + 16, 2))                      \
    X("section textures, record 0: name starts at 1", set_u32(t, 1))                                         \
    X("section meshes, record 0: names mesh 2 of 2", set_u32(b + section_offset(b, MESHES), 2))              \
    X("section tangents has 6 elements, but 3 are in use", set_u32(b + section_offset(b, MESHES), 1))        \
    X("section meshes, record 0: tangents starts at 3", set_u32(b + section_offset(b, MESHES) + 4, 3))

static void tell_lie(uint8_t *b, unsigned lie) {
    uint8_t *f = b + section_offset(b, FINISHES), *t = b + section_offset(b, TEXTURES);
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
        struct lw_error err = {0};
        uint8_t *bytes = write_everything(&size);
        tell_lie(bytes, lie);
        const enum lw_status status = read_exactly(bytes, size, &err);
        lw_support_fails(status, LW_BAD_DATA, &err, lie_messages[lie]);
        free(bytes);
    }
}

/* A file keeps them, and says so by its version; a package for clients knows nothing of them. */
static void files_of_version_7_keep_finishes(void **state) {
    (void)state;
    struct lw_scene *scene = lw_support_everything(), *read;
    struct lw_error err = {0};
    size_t size, matt_size, sealed_size, again_size;
    uint8_t *matt, *bytes, *sealed, *again;
    lw_support_ok(lw_package_write(scene, &matt, &matt_size, &err), &err);
    lw_support_add_finishes(scene);
    lw_support_ok(lw_package_write(scene, &bytes, &size, &err), &err);
    assert_int_equal(size, matt_size);
    assert_memory_equal(bytes, matt, size);
    free(matt);
    free(bytes);
    lw_support_ok(lw_package_write_sealed(scene, &sealed, &sealed_size, &err), &err);
    assert_int_equal(sealed[8], 7);
    lw_support_ok(lw_package_read(sealed, sealed_size, &read, &err), &err);
    assert_same_finishes(scene, read);
    lw_support_ok(lw_package_write_sealed(read, &again, &again_size, &err), &err);
    assert_int_equal(again_size, sealed_size);
    assert_memory_equal(again, sealed, sealed_size);
    lw_scene_destroy(read);
    free(again);
    for (size_t at = 0; at < sealed_size; at++) {
        read = NULL;
        sealed[at] ^= 1;
        assert_int_equal(lw_package_read(sealed, sealed_size, &read, NULL), LW_BAD_DATA);
        sealed[at] ^= 1;
    }
    free(sealed);
    lw_scene_destroy(scene);
}

/* Parts are the head and each texture; what the bytes say may be anything. */
static void parts_are_textures(void **state) {
    (void)state;
    size_t size, count;
    uint64_t *end;
    uint8_t *bytes = write_everything(&size);
    lw_support_ok(lw_finish_package_cut(bytes, size, &end, &count), NULL);
    assert_int_equal(count, 4);
    const uint64_t head = section_offset(bytes, PIXELS);
    const uint64_t expected[] = {head, head + 8, head + 8 + 9, size};
    assert_memory_equal(end, expected, sizeof expected);
    free(end);
    for (size_t bit = 0; bit < 8 * size; bit++) {
        bytes[bit / 8] ^= (uint8_t)(1u << bit % 8);
        lw_support_ok(lw_finish_package_cut(bytes, size, &end, &count), NULL);
        assert_true(count >= 1 && end[count - 1] == size);
        for (size_t i = 1; i < count; i++) assert_true(end[i] > end[i - 1]);
        free(end);
        bytes[bit / 8] ^= (uint8_t)(1u << bit % 8);
    }
    free(bytes);
}

static void failing_allocations_are_reported(void **state) {
    (void)state;
    struct lw_scene *scene = lw_support_everything();
    lw_support_add_finishes(scene);
    size_t size;
    unsigned write_failures = 0;
    uint8_t *bytes = NULL;
    for (;; write_failures++) {
        struct lw_error err = {0};
        failing_memory_one(write_failures);
        const enum lw_status status = lw_finish_package_write(scene, &bytes, &size, &err);
        (void)failing_memory_end();
        if (status == LW_OK) break;
        lw_support_fails(status, LW_NO_MEMORY, &err, "no memory");
    }
    assert_true(write_failures >= 3);
    lw_scene_destroy(scene);
    struct lw_scene *target = lw_support_everything();
    struct lw_error err = {0};
    for (;;) { /* until its small chunk is full, nothing is allocated */
        err = (struct lw_error){0};
        failing_memory_one(0);
        const enum lw_status status = lw_finish_package_read(bytes, size, target, &err);
        if (failing_memory_end() && status != LW_OK) {
            lw_support_fails(status, LW_NO_MEMORY, &err, "no memory");
            expect_matt(target);
            break;
        }
        assert_int_equal(status, LW_OK);
        for (uint32_t m = 0; m < target->material_count; m++) target->material[m].finish = NULL;
        for (uint32_t m = 0; m < target->mesh_count; m++) target->mesh[m].tangent = NULL;
        target->finish_texture_count = 0;
    }
    lw_scene_destroy(target);
    free(bytes);
}

int main(void) {
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(the_document_shows_the_bytes),
        cmocka_unit_test(everything_comes_back),
        cmocka_unit_test(fields_lie_where_the_document_says),
        cmocka_unit_test(cut_off_anywhere_is_refused),
        cmocka_unit_test(every_flipped_bit_is_refused_or_sound),
        cmocka_unit_test(every_word_with_an_extreme_value_is_refused_or_sound),
        cmocka_unit_test(each_lie_is_named),
        cmocka_unit_test(files_of_version_7_keep_finishes),
        cmocka_unit_test(parts_are_textures),
        cmocka_unit_test(failing_allocations_are_reported),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
