/* test_package_damage.c: damaged and untrue packages are refused or sound; each lie has its line. */
#include "tests/support/damage.h"
#include "tests/support/package_case.h"

#include "common/scene/package.h"

#include <stdlib.h>
#include <string.h>
#include <unistd.h>

static void cut_off_anywhere_is_refused(void **state) {
    (void)state;
    size_t size;
    uint8_t *bytes = package_case_write_everything(&size);
    damage_cut(bytes, size, package_case_read_exactly);
    free(bytes);
}

static void every_flipped_bit_is_refused_or_sound(void **state) {
    (void)state;
    size_t size;
    uint8_t *bytes = package_case_write_everything(&size);
    assert_true(damage_flip(bytes, size, package_case_read_exactly) >
                8 * 512); /* every bit of the header at least */
    assert_int_equal(package_case_read_exactly(bytes, size, NULL), LW_OK);
    free(bytes);
}

/* As files have it: whatever else it is, it is not read. */
static void no_flipped_bit_of_a_sealed_package_is_read(void **state) {
    (void)state;
    struct lw_scene *scene = lw_support_everything(), *read;
    struct lw_error err = {0};
    size_t size, again_size;
    uint8_t *bytes = package_case_write_sealed(scene, &size);
    assert_int_equal(bytes[8], 5);
    lw_support_ok(lw_package_read(bytes, size, &read, &err), &err);
    package_case_expect_same_scene(scene, read);
    uint8_t *again = package_case_write_sealed(read, &again_size);
    assert_int_equal(again_size, size);
    assert_memory_equal(again, bytes, size);
    free(again);
    lw_scene_destroy(read);
    lw_scene_destroy(scene);
    for (size_t bit = 0; bit < 8 * size; bit++) {
        err = (struct lw_error){0};
        bytes[bit / 8] ^= (uint8_t)(1u << bit % 8);
        if (package_case_read_exactly(bytes, size, &err) != LW_BAD_DATA || !*err.text)
            fail_msg("bit %zu of byte %zu is flipped, and it is read", bit % 8, bit / 8);
        bytes[bit / 8] ^= (uint8_t)(1u << bit % 8);
    }
    for (size_t cut = 0; cut < size; cut++)
        assert_int_equal(package_case_read_exactly(bytes, cut, NULL), LW_BAD_DATA);
    assert_int_equal(package_case_read_exactly(bytes, size, NULL), LW_OK);
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
            if (package_case_read_exactly(damaged, size, NULL) != LW_BAD_DATA)
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
    size_t size;
    uint8_t *bytes = package_case_write_everything(&size);
    damage_words(bytes, size, package_case_read_exactly);
    free(bytes);
}

/* One lie each: the name of a place, and its message. */
#define LIE_MAP(X)                                                                                           \
    X("does not begin with LWSCENE", b[0] = 'l')                                                             \
    X("has version 8; this program reads versions 1 to 7", package_case_set_u32(b + 8, 8))                   \
    X("has 22 sections; version 1 has 20", package_case_set_u32(b + 8, 1))                                   \
    X("has 21 sections; version 3 has 22", package_case_set_u32(b + 12, 21))                                 \
    X("section environments has 0 elements, not 1: without one", package_case_set_u32(b + 8, 2))             \
    X("says it has 12 bytes", package_case_set_u64(b + 16, 12))                                              \
    X("reserved field of the header", b[24] = 1)                                                             \
    X("entry 1 of the section table has id 3, not 2 (meshes)", package_case_set_u32(b + ENTRY(MESHES), 3))   \
    X("entry 2 of the section table has id 2, not 3 (materials)",                                            \
      memcpy(b + ENTRY(MATERIALS), b + ENTRY(MESHES), 24))                                                   \
    X("section meshes has elements of 60 bytes, not 64", package_case_set_u32(b + ENTRY(MESHES) + 4, 60))    \
    X("section positions starts at byte",                                                                    \
      package_case_set_u64(b + ENTRY(POSITIONS) + 8, package_case_section_offset(b, POSITIONS) + 1))         \
    X("section positions starts at byte",                                                                    \
      package_case_set_u64(b + ENTRY(POSITIONS) + 8, package_case_section_offset(b, STRINGS)))               \
    X("section nodes starts at byte 18446744073709551600",                                                   \
      package_case_set_u64(b + ENTRY(NODES) + 8, (uint64_t)-16))                                             \
    X("section strings has 18446744073709551615 elements, more",                                             \
      package_case_set_u64(b + ENTRY(STRINGS) + 16, UINT64_MAX))                                             \
    X("section meshes has 288230376151711744 elements, more",                                                \
      package_case_set_u64(b + ENTRY(MESHES) + 16, 1ull << 58))                                              \
    X("section meshes starts at byte 592, not 560", package_case_set_u64(b + ENTRY(SCENE) + 16, 0))          \
    X("before section meshes is padding, but not 0", b[package_case_section_offset(b, SCENE) + 24] = 1)      \
    X("section scene, record 0: name starts at 1 of strings; the next free element is 0",                    \
      package_case_set_u32(b + package_case_section_offset(b, SCENE), 1))                                    \
    X("section scene, record 0: name of 3 bytes does not end",                                               \
      package_case_set_u32(b + package_case_section_offset(b, SCENE) + 4, 3))                                \
    X("section scene, record 0: name takes",                                                                 \
      package_case_set_u32(b + package_case_section_offset(b, SCENE) + 4, UINT32_MAX))                       \
    X("section scene, record 0: name of 26 bytes does not end",                                              \
      b[package_case_section_offset(b, STRINGS) + 4] = 0)                                                    \
    X("scene: name is not UTF-8", b[package_case_section_offset(b, STRINGS)] = 0xFF)                         \
    X("section meshes, record 0: positions takes 4294967295 positions",                                      \
      package_case_set_u32(b + package_case_section_offset(b, MESHES) + 8, UINT32_MAX))                      \
    X("section meshes, record 0: a reserved field is 9", b[package_case_section_offset(b, MESHES) + 60] = 9) \
    X("section meshes, record 1: positions starts at 0 of positions; the next free element is 4",            \
      package_case_set_u32(b + package_case_section_offset(b, MESHES) + 64 + 16, 0))                         \
    X("section positions has 7 elements, but 4 are in use",                                                  \
      package_case_set_u32(b + package_case_section_offset(b, MESHES) + 64 + 16, UINT32_MAX))                \
    X("section materials, record 2: alpha mode is 258",                                                      \
      package_case_set_u32(b + package_case_section_offset(b, MATERIALS) + 2 * 112 + 104, 258))              \
    X("section textures, record 0: pixels takes 268435456 pixels",                                           \
      (package_case_set_u32(b + package_case_section_offset(b, TEXTURES) + 8, 16384),                        \
       package_case_set_u32(b + package_case_section_offset(b, TEXTURES) + 12, 16384)))                      \
    X("section textures, record 0: pixels takes 18446744065119617025 pixels",                                \
      (package_case_set_u32(b + package_case_section_offset(b, TEXTURES) + 8, UINT32_MAX),                   \
       package_case_set_u32(b + package_case_section_offset(b, TEXTURES) + 12, UINT32_MAX)))                 \
    X("section channels, record 2: times takes 103 key times",                                               \
      b[package_case_section_offset(b, CHANNELS) + 2 * 24 + 12] = 3 + 100)                                   \
    X("node 2 \"turned\": parent 3",                                                                         \
      package_case_set_u32(b + package_case_section_offset(b, NODES) + 2 * 104 + 8, 3))

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
        uint8_t *bytes = package_case_write_everything(&size);
        tell_lie(bytes, lie);
        struct lw_error err = {0};
        enum lw_status status = package_case_read_exactly(bytes, size, &err);
        lw_support_fails(status, LW_BAD_DATA, &err, lie_messages[lie]);
        free(bytes);
    }
}

static void what_nobody_uses_is_refused(void **state) {
    (void)state;
    size_t size;
    uint8_t *bytes = package_case_write_everything(&size);
    uint8_t *longer = calloc(size + 16, 1);
    assert_non_null(longer);
    memcpy(longer, bytes, size);
    struct lw_error err = {0};
    enum lw_status status = package_case_read_exactly(longer, size + 16, &err); /* trailing garbage */
    lw_support_fails(status, LW_BAD_DATA, &err, "says it has");
    package_case_set_u64(longer + 16, size + 16);
    err = (struct lw_error){0};
    status =
        package_case_read_exactly(longer, size + 16, &err); /* the header knows of it, the table does not */
    lw_support_fails(status, LW_BAD_DATA, &err, "scene package ends at byte");
    uint64_t pixels;
    memcpy(&pixels, longer + ENTRY(20) + 16, sizeof pixels);
    package_case_set_u64(longer + ENTRY(20) + 16, pixels + 4); /* sections begin at multiples of 16 */
    for (unsigned id = 21; id <= 22; id++)
        package_case_set_u64(longer + ENTRY(id) + 8, package_case_section_offset(longer, id) + 16);
    err = (struct lw_error){0};
    status = package_case_read_exactly(longer, size + 16, &err); /* the table too, but no texture */
    lw_support_fails(status, LW_BAD_DATA, &err, "section pixels has 12 elements, but 8 are in use");
    free(longer);
    free(bytes);
}

static void a_package_without_a_scene_is_refused(void **state) {
    (void)state;
    struct lw_scene *scene;
    size_t size;
    lw_support_ok(lw_scene_create(&scene), NULL);
    uint8_t *bytes = package_case_write(scene, &size);
    lw_scene_destroy(scene);
    for (unsigned id = SCENE; id <= 20; id++) {
        package_case_set_u64(bytes + ENTRY(id) + 8, 512);
        package_case_set_u64(bytes + ENTRY(id) + 16, 0);
    }
    package_case_set_u64(bytes + 16, 512);
    struct lw_error err = {0};
    enum lw_status status = package_case_read_exactly(bytes, 512, &err);
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
        uint8_t *empty = package_case_write(scene, &size);
        lw_scene_destroy(scene);
        uint64_t cameras = package_case_section_offset(empty, CAMERAS), shift = 16ull * limits[past];
        uint8_t *bytes = calloc(size + shift, 1);
        assert_non_null(bytes);
        memcpy(bytes, empty, cameras);
        memcpy(bytes + cameras + shift, empty + cameras, size - cameras);
        package_case_set_u64(bytes + 16, size + shift);
        package_case_set_u64(bytes + ENTRY(CAMERAS) + 16, limits[past]);
        for (unsigned id = CHANNELS; id <= 20; id++)
            package_case_set_u64(bytes + ENTRY(id) + 8, package_case_section_offset(empty, id) + shift);
        struct lw_error err = {0};
        enum lw_status status = package_case_read_exactly(bytes, size + shift, &err);
        lw_support_fails(status, LW_BAD_DATA, &err, messages[past]);
        free(bytes);
        free(empty);
    }
}

int main(void) {
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(cut_off_anywhere_is_refused),
        cmocka_unit_test(every_flipped_bit_is_refused_or_sound),
        cmocka_unit_test(no_flipped_bit_of_a_sealed_package_is_read),
        cmocka_unit_test(no_lost_block_of_a_sealed_file_is_read),
        cmocka_unit_test(every_word_with_an_extreme_value_is_refused_or_sound),
        cmocka_unit_test(each_lie_is_named),
        cmocka_unit_test(what_nobody_uses_is_refused),
        cmocka_unit_test(a_package_without_a_scene_is_refused),
        cmocka_unit_test(counts_are_limited),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
