/* Tiles of finer levels that a session over NATS lists: each once, and no more than there is room for. */
#include "tests/support/support.h"

#include "relay/nats_fine.h"

#include <stdlib.h>

static void tiles_are_found_by_name(void **state) {
    (void)state;
    struct lw_scene *scene = lw_support_squares(2, 1);
    struct lw_nats_fine *fine = calloc(1, sizeof *fine);
    struct lw_atlas_map map;
    for (uint32_t i = 0; i < scene->mesh_count; i++)
        scene->mesh[i].atlas_width = scene->mesh[i].atlas_height = 1024;
    lw_support_ok(lw_atlas_map_init_finer(&map, scene, 2, 8), NULL);
    const uint32_t level = LW_ATLAS_FINER + 1;
    const struct lw_message_interest_tile listed[] = {{1, level, 3},     {0, level + 1, 5},   {0, 0, 0},
                                                      {1, level, 3},     {0, level, 7},       {9, level, 0},
                                                      {0, level + 5, 0}, {0, level, 1u << 30}};
    struct lw_message_interest interest = {.tile = listed, .tile_count = sizeof listed / sizeof *listed};
    lw_nats_fine_list(fine, &map, &interest);
    assert_int_equal(fine->count, 3);
    for (uint32_t i = 0; i < fine->count; i++) {
        const struct lw_nats_fine_tile *t = &fine->tile[i];
        assert_int_equal(t->name, lw_atlas_map_name_tile(&map, t->object, t->level, t->tile));
        assert_int_equal(lw_nats_fine_find(fine, t->name), i);
        assert_true(!i || fine->tile[i - 1].name < t->name);
    }
    assert_int_equal(lw_nats_fine_find(fine, fine->tile[2].name + 1), LW_NATS_FINE_NONE);
    /* as many as there is room for, the first ones */
    struct lw_message_interest_tile *many = calloc(LW_NATS_WIRE_FINE_MAX + 9, sizeof *many);
    for (uint32_t i = 0; i < LW_NATS_WIRE_FINE_MAX + 9; i++)
        many[i] = (struct lw_message_interest_tile){i / 1000, level, i % 1000};
    interest = (struct lw_message_interest){.tile = many, .tile_count = LW_NATS_WIRE_FINE_MAX + 9};
    lw_nats_fine_list(fine, &map, &interest);
    assert_int_equal(fine->count, LW_NATS_WIRE_FINE_MAX);
    assert_int_not_equal(lw_nats_fine_find(fine, lw_atlas_map_name_tile(&map, 0, level, 0)),
                         LW_NATS_FINE_NONE);
    lw_nats_fine_list(fine, &map, NULL);
    assert_int_equal(fine->count, 0);
    free(many);
    free(fine);
    lw_atlas_map_finish(&map);
    lw_scene_destroy(scene);
}

int main(void) {
    const struct CMUnitTest tests[] = {cmocka_unit_test(tiles_are_found_by_name)};
    return cmocka_run_group_tests(tests, NULL, NULL);
}
