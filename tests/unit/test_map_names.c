#include "tests/support/support.h"

#include "server/bake/map_names.h"

#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#define COUNT(array) (sizeof(array) / sizeof *(array))

static void expect_names(const char *const name[], const char *const file[], uint32_t count) {
    struct lw_object *object = calloc(count, sizeof *object);
    struct lw_map_names names;
    assert_non_null(object);
    for (uint32_t i = 0; i < count; i++) object[i].name = name[i];
    lw_support_ok(lw_map_names_init(&names, &(struct lw_scene){.object = object, .object_count = count}),
                  NULL);
    assert_int_equal(names.count, count);
    for (uint32_t i = 0; i < count; i++) assert_string_equal(names.file[i], file[i]);
    lw_map_names_finish(&names);
    free(object);
}

static void plain_names_stay(void **state) {
    (void)state;
    const char *const name[] = {"floor", "Table.001", "a_b-c"}, *const file[] = {"floor.exr", "Table.001.exr",
                                                                                 "a_b-c.exr"};
    expect_names(name, file, COUNT(name));
}

static void nothing_leaves_the_folder_or_hides(void **state) {
    (void)state;
    const char *const name[] = {"../../etc/passwd", "..",           ".",       "/",        "",
                                ".hidden",          "-rf",          "a\nb\tc", "a\\b:c*d", "back wall",
                                "\xe5\xba\x8a",     "b\xc3\xa9ton", "con",     "Com1.x",   "NUL"},
                      *const file[] = {"_.._etc_passwd.exr", "object.exr",    "object-2.exr", "_.exr",
                                       "object-3.exr",       "hidden.exr",    "rf.exr",       "a_b_c.exr",
                                       "a_b_c_d.exr",        "back_wall.exr", "_-2.exr",      "b_ton.exr",
                                       "con_.exr",           "Com1_.x.exr",   "NUL_.exr"};
    expect_names(name, file, COUNT(name));
}

static void equal_names_are_numbered(void **state) {
    (void)state;
    const char *const name[] = {"a", "a", "A", "a-2", "a", "a-2"}, *const file[] = {"a.exr",   "a-2.exr",
                                                                                    "A-3.exr", "a-2-2.exr",
                                                                                    "a-4.exr", "a-2-3.exr"};
    expect_names(name, file, COUNT(name));
}

static void long_names_are_cut(void **state) {
    (void)state;
    char longest[301], cut[LW_MAP_NAMES_STEM_MAX + 1], first[128], second[128];
    memset(longest, 'x', 300);
    longest[300] = 0;
    memset(cut, 'x', LW_MAP_NAMES_STEM_MAX);
    cut[LW_MAP_NAMES_STEM_MAX] = 0;
    snprintf(first, sizeof first, "%s.exr", cut);
    snprintf(second, sizeof second, "%s-2.exr", cut);
    const char *const name[] = {longest, longest}, *const file[] = {first, second};
    expect_names(name, file, COUNT(name));
}

/* A million instances of a cube: numbering must not look through all numbers again for each. */
static void many_equal_names_are_quick(void **state) {
    (void)state;
    enum { MANY = 200000 };
    struct lw_object *object = calloc(MANY, sizeof *object);
    struct lw_map_names names;
    assert_non_null(object);
    for (uint32_t i = 0; i < MANY; i++) object[i].name = "cube";
    lw_support_ok(lw_map_names_init(&names, &(struct lw_scene){.object = object, .object_count = MANY}),
                  NULL);
    char last[32];
    snprintf(last, sizeof last, "cube-%u.exr", MANY);
    assert_string_equal(names.file[MANY - 1], last);
    lw_map_names_finish(&names);
    free(object);
}

int main(void) {
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(plain_names_stay),           cmocka_unit_test(nothing_leaves_the_folder_or_hides),
        cmocka_unit_test(equal_names_are_numbered),   cmocka_unit_test(long_names_are_cut),
        cmocka_unit_test(many_equal_names_are_quick),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
