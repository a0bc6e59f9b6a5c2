/* test_package_versions.c: what each version of the format added; older packages are still read. */
#include "tests/support/damage.h"
#include "tests/support/package_case.h"

#include "common/scene/package.h"

#include <stdlib.h>
#include <string.h>
#include <unistd.h>

/* What version 1 made of a scene with textures: two sections less, pixels as they are. */
static uint8_t *write_version_1(const struct lw_scene *scene, size_t *out_size) {
    enum { TABLE_END = 560, LESS = 48, PIXELS = 20 };
    size_t size;
    uint8_t *bytes = package_case_write(scene, &size),
            *pixels = bytes + package_case_section_offset(bytes, PIXELS);
    for (uint32_t t = 0; t < scene->texture_count; t++) {
        const size_t texture = 4 * (size_t)scene->texture[t].width * scene->texture[t].height;
        memcpy(pixels, scene->texture[t].rgba, texture);
        pixels += texture;
    }
    const size_t end = (size_t)(pixels - bytes); /* end of the last section of version 1 */
    for (unsigned id = SCENE; id <= PIXELS; id++)
        package_case_set_u64(bytes + ENTRY(id) + 8, package_case_section_offset(bytes, id) - LESS);
    memmove(bytes + TABLE_END - LESS, bytes + TABLE_END, end - TABLE_END);
    package_case_set_u32(bytes + 8, 1);
    package_case_set_u32(bytes + 12, PIXELS);
    *out_size = end - LESS;
    package_case_set_u64(bytes + 16, *out_size);
    return bytes;
}

static void textures_of_version_1_are_read(void **state) {
    (void)state;
    struct lw_scene *scene = lw_support_everything(), *read;
    size_t size, again_size, newest_size;
    uint8_t *bytes = write_version_1(scene, &size), *newest = package_case_write(scene, &newest_size);
    struct lw_error err = {0};
    lw_support_ok(lw_package_read(bytes, size, &read, &err), &err);
    package_case_expect_same_scene(scene, read);
    uint8_t *again = package_case_write(read, &again_size); /* in the newest version */
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
    uint8_t *bytes = package_case_write(scene, &size);
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
    uint8_t *bytes = package_case_write(scene, &size);
    struct lw_error err = {0};
    assert_int_equal(bytes[8], 3);
    lw_support_ok(lw_package_read(bytes, size, &read, &err), &err);
    package_case_expect_same_scene(scene, read);
    assert_int_equal(read->environment.width, 1);
    uint8_t *again = package_case_write(read, &again_size);
    assert_int_equal(again_size, size);
    assert_memory_equal(again, bytes, size);
    free(again);
    free(bytes);
    lw_scene_destroy(read);
    lw_scene_destroy(scene);
    scene = lw_support_squares(1, 1);
    scene->environment = (struct lw_environment){.width = 1, .height = 1, .rgb = (const float[]){1, 1, 1}};
    bytes = package_case_write(scene, &size);
    package_case_set_u32(bytes + 8, 3);
    lw_support_fails(package_case_read_exactly(bytes, size, &err), LW_BAD_DATA, &err,
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
        uint8_t *bytes = package_case_write(scene, &size),
                *sealed = package_case_write_sealed(scene, &again_size);
        assert_int_equal(bytes[8], 6);
        assert_int_equal(bytes[12], 27);
        assert_int_equal(again_size, size);
        assert_memory_equal(bytes, sealed, size);
        lw_support_ok(lw_package_read(bytes, size, &read, &err), &err);
        package_case_expect_same_scene(scene, read);
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
        uint8_t *again = package_case_write(read, &again_size);
        assert_int_equal(again_size, size);
        assert_memory_equal(again, bytes, size);
        bytes[package_case_section_offset(bytes, 25)] ^= 1;
        lw_support_fails(package_case_read_exactly(bytes, size, &err), LW_BAD_DATA, &err,
                         "do not have its checksum");
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
    uint8_t *bytes = package_case_write(scene, &size);
    package_case_set_u32(bytes + package_case_section_offset(bytes, 25), 0);
    lw_package_seal(bytes, size);
    lw_support_fails(package_case_read_exactly(bytes, size, &err), LW_BAD_DATA, &err,
                     "then the version is 1 to 5");
    err = (struct lw_error){0};
    package_case_set_u32(bytes + package_case_section_offset(bytes, 25), 2);
    lw_package_seal(bytes, size);
    lw_support_fails(package_case_read_exactly(bytes, size, &err), LW_BAD_DATA, &err,
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
    uint8_t *bytes = package_case_write(scene, &size);
    assert_int_equal(bytes[8], 4);
    assert_int_equal(bytes[12], 24);
    uint8_t *lights = bytes + package_case_section_offset(bytes, 23),
            *materials = bytes + package_case_section_offset(bytes, 24);
    const uint32_t of_light[2] = {0, 2}, of_material[2] = {1, 0};
    assert_memory_equal(lights, of_light, sizeof of_light);
    assert_memory_equal(materials, of_material, sizeof of_material);
    lw_support_ok(lw_package_read(bytes, size, &read, &err), &err);
    package_case_expect_same_scene(scene, read);
    assert_int_equal(read->light[0].drawn_by, LW_DRAWN_BY_RULE);
    assert_int_equal(read->light[1].drawn_by, LW_DRAWN_BY_SERVER);
    assert_int_equal(read->material[0].drawn_by, LW_DRAWN_BY_CLIENTS);
    assert_int_equal(read->material[1].drawn_by, LW_DRAWN_BY_RULE);
    uint8_t *again = package_case_write(read, &again_size);
    assert_int_equal(again_size, size);
    assert_memory_equal(again, bytes, size);
    free(again);
    lw_scene_destroy(read);

    package_case_set_u32(lights, 3);
    lw_support_fails(package_case_read_exactly(bytes, size, &err), LW_BAD_DATA, &err,
                     "section light drawers, record 0: who draws it is 3; the largest is 2");
    err = (struct lw_error){0};
    package_case_set_u32(lights, 0), package_case_set_u32(lights + 4, 0), package_case_set_u32(materials, 0);
    lw_support_fails(package_case_read_exactly(bytes, size, &err), LW_BAD_DATA, &err,
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
    uint8_t *bytes = package_case_write(scene, &size);
    assert_int_equal(bytes[8], 2);
    assert_int_equal(bytes[12], 22);
    /* record: width, height, first texel; then the texels */
    const uint8_t *record = bytes + package_case_section_offset(bytes, 21),
                  *texels = bytes + package_case_section_offset(bytes, 22);
    const uint32_t words[3] = {3, 2, 0};
    assert_memory_equal(record, words, sizeof words);
    assert_memory_equal(texels, scene->environment.rgb, 18 * sizeof(float));
    struct lw_error err = {0};
    lw_support_ok(lw_package_read(bytes, size, &read, &err), &err);
    assert_int_equal(read->environment.width, 3);
    assert_int_equal(read->environment.height, 2);
    assert_memory_equal(read->environment.rgb, scene->environment.rgb, 18 * sizeof(float));
    uint8_t *again = package_case_write(read, &again_size);
    assert_int_equal(again_size, size);
    assert_memory_equal(again, bytes, size);
    free(again);
    lw_scene_destroy(read);
    /* without one it is version 1, as ever */
    scene->environment = (struct lw_environment){0};
    uint8_t *plain = package_case_write(scene, &again_size);
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
        uint8_t *bytes = package_case_write(scene, &size);
        lw_scene_destroy(scene);
        uint8_t *record = bytes + package_case_section_offset(bytes, 21),
                *texels = bytes + package_case_section_offset(bytes, 22);
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
            package_case_set_u32(record + 8, UINT32_MAX);
            break;
        case 1:
            package_case_set_u32(record, 6);
            break;
        case 2:
            package_case_set_u32(record, UINT32_MAX), package_case_set_u32(record + 4, UINT32_MAX);
            break;
        case 3: /* and nothing left over */
            package_case_set_u32(record, 0);
            package_case_set_u64(bytes + ENTRY(22) + 16, 0);
            size -= 18 * sizeof(float);
            package_case_set_u64(bytes + 16, size);
            break;
        case 4:
            package_case_set_u32(record + 8, 1);
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
            package_case_set_u64(bytes + ENTRY(21) + 16, 0);
            package_case_set_u64(bytes + ENTRY(22) + 8, package_case_section_offset(bytes, 21));
            package_case_set_u64(bytes + ENTRY(22) + 16, 0);
            size = package_case_section_offset(bytes, 21);
            package_case_set_u64(bytes + 16, size);
            break;
        }
        struct lw_error err = {0};
        enum lw_status status = package_case_read_exactly(bytes, size, &err);
        lw_support_fails(status, LW_BAD_DATA, &err, messages[lie]);
        free(bytes);
    }
}

static void an_environment_cut_off_or_flipped_is_refused_or_sound(void **state) {
    (void)state;
    struct lw_scene *scene = build_outside();
    size_t size;
    uint8_t *bytes = package_case_write(scene, &size);
    lw_scene_destroy(scene);
    damage_cut(bytes, size, package_case_read_exactly);
    assert_true(damage_flip(bytes, size, package_case_read_exactly) > 0);
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

int main(void) {
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(textures_of_version_1_are_read),
        cmocka_unit_test(parts_are_textures),
        cmocka_unit_test(version_3_has_textures),
        cmocka_unit_test(version_4_says_who_draws),
        cmocka_unit_test(version_6_says_what_is_unlit_tinted_parallel_and_dimmed),
        cmocka_unit_test(an_environment_comes_back),
        cmocka_unit_test(lies_about_an_environment_are_named),
        cmocka_unit_test(an_environment_cut_off_or_flipped_is_refused_or_sound),
        cmocka_unit_test(environments_are_limited),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
