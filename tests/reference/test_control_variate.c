/* Light that has changed is corrected by how much it has: as much as was found, no more, and no texel below
 * none. */
#include "common/base/colour.h"
#include "server/solve/adapt/control_variate.h"
#include "server/solve/cell_layer.h"
#include "tests/reference/room.h"

#include <string.h>

/* A room that has been lit, and one tile of its floor. */
struct lit {
    struct room_solution s;
    struct lw_tiles *tiles;
    struct lw_solve_tile *tile;
    struct lw_solve_block *block; /* all of it floor */
    uint32_t x, y;                /* its first texel */
};

static struct room make_room(void) {
    struct room room = {.texels_per_metre = 12};
    room_box(&room, lw_vec3(4, 2, 4), 0.5f, 0);
    room.light[0] = (struct lw_light){.kind = LW_LIGHT_POINT, .intensity = {4, 4, 4}};
    room.light_position[0] = lw_vec3(1, 1.6f, 1);
    room.light_count = 1;
    return room;
}

static void light_room(struct lit *lit) {
    const struct room room = make_room();
    room_solve(
        &lit->s, &room,
        (struct lw_solver_desc){
            .bounces = 3, .direct_samples = 1, .indirect_samples = 4, .target_error = -1, .directions = true},
        30);
    lit->tiles = lw_cell_layer_tiles(lit->s.solver);
    lit->tile = &lit->tiles->tile[lit->tiles->slot_of_id[lit->s.map.first_tile[0]]];
    lit->block = NULL;
    LW_TILES_EACH_BLOCK (lit->tile, block)
        if (block->covered_count == LW_TILE_BLOCK * LW_TILE_BLOCK) lit->block = block;
    assert_non_null(lit->block);
    const uint32_t b = (uint32_t)(lit->block - lit->tile->block);
    lit->x = b % lit->tile->block_columns * LW_TILE_BLOCK;
    lit->y = b / lit->tile->block_columns * LW_TILE_BLOCK;
}

/* Sums over the block's texels. */
struct sums {
    double direct[3], order[3][3], indirect[3], estimate[LW_TILES_ESTIMATES][3], mean;
    float least;
};

/* E of the last of three orders is the rest. */
static float order_of(const struct lw_tiles *t, int order, int c, uint32_t texel) {
    return order < 2 ? t->order[order][c][texel]
                     : t->indirect[c][texel] - t->order[0][c][texel] - t->order[1][c][texel];
}

static struct sums add_up(const struct lit *lit) {
    struct sums sums = {.least = 0};
    const struct lw_tiles *t = lit->tiles;
    for (uint32_t y = 0; y < LW_TILE_BLOCK; y++)
        for (uint32_t x = 0; x < LW_TILE_BLOCK; x++) {
            const uint32_t texel = lit->tile->first + (lit->y + y) * lit->tile->width + lit->x + x;
            for (int c = 0; c < 3; c++) {
                sums.direct[c] += (double)t->direct[c][texel];
                sums.indirect[c] += (double)t->indirect[c][texel];
                sums.least = fminf(sums.least, t->direct[c][texel]);
                for (int k = 0; k < 3; k++) {
                    sums.order[k][c] += (double)order_of(t, k, c, texel);
                    if (k < 2) sums.least = fminf(sums.least, order_of(t, k, c, texel));
                }
                for (int k = 0; k < LW_TILES_ESTIMATES; k++) {
                    const struct lw_vec3 estimate = lw_tiles_estimate(t, k, texel);
                    sums.estimate[k][c] += (double)(&estimate.x)[c];
                }
            }
            sums.mean += (double)t->mean[texel];
        }
    return sums;
}

/* As after packets of the block find that every texel's indirect light is off by `first` and `later`,
 * and by `noise` up or down besides. */
static void find(struct lit *lit, float first, float later, float noise) {
    struct lw_change_block *change = &lit->block->change;
    const struct lw_solve_tile *tile = lit->tile;
    const uint32_t number = (uint32_t)(lit->block - tile->block),
                   corner = tile->first + number / tile->block_columns * LW_TILE_BLOCK * tile->width +
                            number % tile->block_columns * LW_TILE_BLOCK;
    change->uncorrected = change->verified = lw_change_all_packets(lit->block);
    for (uint32_t set = 0; set < lit->block->packet_count; set++) {
        struct lw_change_packet *packet = &change->packet[set];
        memset(packet, 0, sizeof *packet);
        for (uint32_t lane = 0; lane < lit->block->packet[set].count; lane++) {
            const uint32_t texel = lw_packet_texel(&lit->block->packet[set], lane, corner, tile->width),
                           r = lit->tiles->region_of_texel[texel];
            const float sign = lane % 2 ? noise : -noise, all = first + later + sign;
            packet->indirect[LW_CHANGE_FIRST][r] = lw_vec3_add(
                packet->indirect[LW_CHANGE_FIRST][r], lw_vec3(first + sign, first + sign, first + sign));
            packet->indirect[LW_CHANGE_LATER][r] =
                lw_vec3_add(packet->indirect[LW_CHANGE_LATER][r], lw_vec3(later, later, later));
            packet->indirect_square[r] += 3 * all * all;
        }
    }
}

static double texels(const struct lit *lit) { return lit->block->covered_count; }

static void test_light_that_comes(void **state) {
    (void)state;
    struct lit lit;
    light_room(&lit);
    const struct sums before = add_up(&lit);
    const double luminance = lit.block->luminance;
    find(&lit, 0.02f, 0.01f, 0);
    assert_true(lw_control_variate_indirect(lit.tiles, lit.tile, 0.02f, true));
    const struct sums after = add_up(&lit);
    for (int c = 0; c < 3; c++) {
        expect_near(after.order[0][c] - before.order[0][c], 0.02 * texels(&lit), 1e-3);
        expect_near(after.order[1][c] + after.order[2][c] - before.order[1][c] - before.order[2][c],
                    0.01 * texels(&lit), 1e-3);
        expect_near(after.indirect[c] - before.indirect[c], 0.03 * texels(&lit), 1e-3);
        expect_near(after.estimate[LW_TILES_ESTIMATE_BOUNCES][c] -
                        before.estimate[LW_TILES_ESTIMATE_BOUNCES][c],
                    0.02 * texels(&lit), 1e-3);
        assert_true(after.direct[c] == before.direct[c]);
    }
    expect_near(after.mean - before.mean, 0.03 * texels(&lit), 1e-3);
    expect_near(lit.block->luminance - luminance, 0.03 * texels(&lit), 1e-3);
    /* A correction is not found again. */
    lit.block->change.uncorrected = lw_change_all_packets(lit.block);
    assert_false(lw_control_variate_indirect(lit.tiles, lit.tile, 0.02f, true));
    room_finish(&lit.s);
}

/* More than there is: no light is left, nowhere less. */
static void test_light_that_goes(void **state) {
    (void)state;
    struct lit lit;
    light_room(&lit);
    const struct sums before = add_up(&lit);
    const float half = (float)(-0.5 * before.order[0][1] / texels(&lit));
    find(&lit, half, 0, 0);
    assert_true(lw_control_variate_indirect(lit.tiles, lit.tile, 0.02f, true));
    const struct sums after = add_up(&lit);
    expect_near(after.order[0][1], 0.5 * before.order[0][1], 0.01);
    find(&lit, -1e3f, -1e3f, 0);
    assert_true(lw_control_variate_indirect(lit.tiles, lit.tile, 0.02f, true));
    const struct sums none = add_up(&lit);
    assert_true(none.indirect[1] < 1e-3 * before.indirect[1] && none.least >= 0);
    room_finish(&lit.s);
}

/* What chance explains is not taken for light; nor is the error that a converged block may have. */
static void test_noise_is_left(void **state) {
    (void)state;
    struct lit lit;
    light_room(&lit);
    const struct sums before = add_up(&lit);
    const float light = lit.block->reference_luminance;
    find(&lit, 0.05f * light, 0, 5 * light); /* 256 texels: known to a third of the light */
    assert_false(lw_control_variate_indirect(lit.tiles, lit.tile, 0.02f, true));
    find(&lit, 0.01f * light, 0, 0);
    assert_false(lw_control_variate_indirect(lit.tiles, lit.tile, 0.1f, true));
    const struct sums after = add_up(&lit);
    assert_memory_equal(&after, &before, sizeof after);
    room_finish(&lit.s);
}

/* What differs along a plane has no standard error; the edge of a shadow is. */
static void test_direct_light(void **state) {
    (void)state;
    struct lit lit;
    struct lw_ray_launch launch;
    struct lw_vec3 slope[LW_TRACE_WIDTH], edge[LW_TRACE_WIDTH], gone[LW_TRACE_WIDTH];
    light_room(&lit);
    lw_ray_launch_init(&launch, lit.tile, lit.block, 0);
    float square = 0;
    for (uint32_t lane = 0; lane < LW_TRACE_WIDTH; lane++) {
        const float x = (float)(launch.texel[lane] % lit.tile->width),
                    y = (float)(launch.texel[lane] / lit.tile->width);
        slope[lane] = lw_vec3(0.1f + 0.01f * x - 0.005f * y, 0.1f, 0.002f * y);
        edge[lane] = lw_vec3(0, x < (float)lit.x + 8 ? 0.2f : 0, 0);
        gone[lane] = lw_vec3(-1e3f, -1e3f, -1e3f);
        square += edge[lane].y * edge[lane].y;
    }
    const struct sums before = add_up(&lit);
    const struct lw_change_packet *found = &lit.block->change.packet[0];
    lw_control_variate_direct(lit.tiles, lit.tile, lit.block, 0, &launch, slope, NULL);
    const struct sums after = add_up(&lit);
    assert_true(found->direct_rough < 1e-3f * square);
    expect_near(after.direct[1] - before.direct[1], 0.1 * LW_TRACE_WIDTH, 1e-3);
    lw_control_variate_direct(lit.tiles, lit.tile, lit.block, 0, &launch, edge, NULL);
    assert_true(found->direct_rough > 0.05f * square && found->direct_rough < square);
    lw_control_variate_direct(lit.tiles, lit.tile, lit.block, 0, &launch, gone, NULL);
    assert_true(add_up(&lit).least >= 0);
    room_finish(&lit.s);
}

/* A part's cosine moments over its luminance, of the block's texels. */
static void take_directions(const struct lit *lit, int part,
                            struct lw_vec3 out[LW_TILE_BLOCK * LW_TILE_BLOCK]) {
    float *const *light = part == LW_TILES_DIRECT ? lit->tiles->direct : lit->tiles->indirect;
    for (uint32_t y = 0, n = 0; y < LW_TILE_BLOCK; y++)
        for (uint32_t x = 0; x < LW_TILE_BLOCK; x++, n++) {
            const uint32_t texel = lit->tile->first + (lit->y + y) * lit->tile->width + lit->x + x;
            out[n] = lw_vec3_scale(lw_texels_vector(lit->tiles->moment[part], texel),
                                   1 / lw_colour_luminance(lw_texels_vector(light, texel)));
            assert_true(lw_vec3_is_finite(out[n]) && lw_vec3_length(out[n]) > 0.3f);
        }
}

/* Light that is corrected comes from where it came: its moment changes as its luminance does. */
static void test_directions_stay(void **state) {
    (void)state;
    static struct lw_vec3 before[LW_TILES_PARTS][LW_TILE_BLOCK * LW_TILE_BLOCK],
        after[LW_TILE_BLOCK * LW_TILE_BLOCK];
    struct lit lit;
    light_room(&lit);
    for (int part = 0; part < LW_TILES_PARTS; part++) take_directions(&lit, part, before[part]);
    const struct sums sums = add_up(&lit);
    for (uint32_t set = 0; set < lit.block->packet_count; set++) {
        struct lw_ray_launch launch;
        struct lw_vec3 off[LW_TRACE_WIDTH];
        lw_ray_launch_init(&launch, lit.tile, lit.block, set);
        for (uint32_t lane = 0; lane < lit.block->packet[set].count; lane++)
            off[lane] =
                lw_vec3_scale(lw_texels_vector(lit.tiles->direct, lit.tile->first + launch.texel[lane]),
                              set % 2 ? 2 : -0.7f);
        lw_control_variate_direct(lit.tiles, lit.tile, lit.block, set, &launch, off, NULL);
    }
    find(&lit, 0.2f, 0.1f, 0);
    assert_true(lw_control_variate_indirect(lit.tiles, lit.tile, 0.02f, true));
    const struct sums changed = add_up(&lit);
    assert_true(fabs(changed.direct[0] - sums.direct[0]) > 0.1 * sums.direct[0]);
    expect_near(changed.indirect[0] - sums.indirect[0], 0.3 * texels(&lit), 1e-3);
    for (int part = 0; part < LW_TILES_PARTS; part++) {
        take_directions(&lit, part, after);
        for (uint32_t i = 0; i < LW_TILE_BLOCK * LW_TILE_BLOCK; i++)
            assert_true(lw_vec3_length(lw_vec3_sub(after[i], before[part][i])) < 1e-3f);
    }
    room_finish(&lit.s);
}

/* Packets that lie among each other see the same light: what they differ by is chance. */
static void test_packets_that_differ(void **state) {
    (void)state;
    struct lit lit;
    struct lw_ray_launch launch;
    struct lw_vec3 off[LW_TRACE_WIDTH];
    light_room(&lit);
    for (int differ = 0; differ < 2; differ++) {
        float standard_error = 0;
        lit.block->change.direct = lw_change_all_packets(lit.block);
        lit.block->noise[LW_TILES_DIRECT] = 0;
        for (uint32_t set = 0; set < lit.block->packet_count; set++) {
            const float x = differ && set % 2 ? 0 : 0.2f;
            for (uint32_t lane = 0; lane < LW_TRACE_WIDTH; lane++) off[lane] = lw_vec3(0, x, 0);
            lw_ray_launch_init(&launch, lit.tile, lit.block, set);
            lw_control_variate_direct(lit.tiles, lit.tile, lit.block, set, &launch, off, NULL);
        }
        lw_control_variate_note_error(lit.tile);
        for (uint32_t set = 0; set < lit.block->packet_count; set++)
            standard_error += lit.block->change.packet[set].direct_error;
        const double variance = differ ? 0.01 : 0; /* the variance of 0 and 0.2 */
        if (fabs((double)standard_error / texels(&lit) - variance) > 0.1 * variance + 1e-6)
            fail_msg("%g W/m^2 of standard error", sqrt((double)standard_error / texels(&lit)));
    }
    room_finish(&lit.s);
}

/* Samples as noisy as the light is bright may all have missed what the rest of the tile has seen change. */
static void test_what_may_be_missed(void **state) {
    (void)state;
    struct lit lit;
    struct lw_ray_launch launch;
    struct lw_vec3 off[LW_TRACE_WIDTH];
    light_room(&lit);
    for (uint32_t lane = 0; lane < LW_TRACE_WIDTH; lane++) off[lane] = lw_vec3(0.2f, 0, 0);
    for (int noisy = 0; noisy < 2; noisy++) {
        LW_TILES_EACH_BLOCK (lit.tile, block) {
            block->change.direct = lw_change_all_packets(block);
            block->noise[LW_TILES_DIRECT] = noisy ? 1 : 0;
            memset(block->change.packet, 0, block->packet_count * sizeof *block->change.packet);
            for (uint32_t set = 0; block != lit.block && set < block->packet_count; set++) {
                lw_ray_launch_init(&launch, lit.tile, block, set);
                lw_control_variate_direct(lit.tiles, lit.tile, block, set, &launch, off, NULL);
            }
        }
        lw_control_variate_note_error(lit.tile);
        const float standard_error = lit.block->change.packet[0].direct_error / LW_TRACE_WIDTH;
        if (noisy)
            assert_true(standard_error > 0.02f && standard_error < 0.04f);
        else
            assert_true(standard_error == 0);
    }
    room_finish(&lit.s);
}

/* Light that is almost gone is no measure for the distribution of new light. */
static void test_light_from_next_to_none(void **state) {
    (void)state;
    struct lit lit;
    light_room(&lit);
    for (uint32_t i = 0; i < lit.tile->width * lit.tile->height; i++)
        for (int c = 0; c < 3; c++) {
            lit.tiles->order[0][c][lit.tile->first + i] = 0;
            lit.tiles->order[1][c][lit.tile->first + i] = lit.tiles->indirect[c][lit.tile->first + i] =
                2e-38f;
        }
    const struct sums before = add_up(&lit);
    find(&lit, 0, 10, 0);
    assert_true(lw_control_variate_indirect(lit.tiles, lit.tile, 0.02f, true));
    const struct sums after = add_up(&lit);
    for (int c = 0; c < 3; c++) {
        expect_near(after.indirect[c] - before.indirect[c], 10 * texels(&lit), 1e-3);
        expect_near(after.order[1][c] + after.order[2][c], 10 * texels(&lit), 1e-3);
    }
    room_finish(&lit.s);
}

#define LAMPS 81u

static float lamp_intensity(uint32_t lamp, bool on) { return lamp % 2 ? 0.01f : on ? 0.2f : 0; }

/* Many lamps, half of which may be on: a sample of direct light is of one of them, and tells nothing of the
 * others. */
static struct room make_room_of_lamps(bool on) {
    struct room room = {.texels_per_metre = 3};
    room_box(&room, lw_vec3(2, 2, 2), 0.3f, 0);
    for (room.light_count = 0; room.light_count < LAMPS; room.light_count++) {
        const float x = 0.2f + 0.2f * (float)(room.light_count % 9),
                    z = 0.2f + 0.2f * (float)(room.light_count / 9);
        const float intensity = lamp_intensity(room.light_count, on);
        room.light[room.light_count] =
            (struct lw_light){.kind = LW_LIGHT_POINT, .intensity = {intensity, intensity, intensity}};
        room.light_position[room.light_count] = lw_vec3(x, 1.8f, z);
    }
    return room;
}

static void test_lights_that_come_and_go(void **state) {
    (void)state;
    struct room_solution right[2], s;
    uint64_t frame = 0;
    for (int on = 0; on < 2; on++) {
        const struct room room = make_room_of_lamps(on);
        room_solve(&right[on], &room, (struct lw_solver_desc){.bounces = 2, .target_error = -1}, 400);
    }
    struct room room = make_room_of_lamps(true);
    room_solve_layers(&s, room_scene(&room), room.texels_per_metre,
                      (struct lw_solver_desc){.bounces = 2,
                                              .target_error = 0.05f,
                                              .denoise = true,
                                              .frame_budget_s = 1e3,
                                              .indirect_samples = 2},
                      NULL, 0);
    for (unsigned cycle = 0; cycle < 20; cycle++)
        for (int on = 1; on >= 0; on--) {
            for (uint32_t i = 0; i < LAMPS; i++) {
                const float intensity = lamp_intensity(i, on);
                s.pose.light[i].intensity = lw_vec3(intensity, intensity, intensity);
            }
            room_solve_until_rest(&s, &frame);
            for (uint32_t o = 0; o < room.quad_count; o++) {
                const struct room_mean is = room_object_mean(&s, o), be = room_object_mean(&right[on], o);
                if (!(fabs(is.total - be.total) < 0.05 * be.total))
                    fail_msg("cycle %u, half of the lamps %s, side %u: direct %.4f, indirect %.4f, but for "
                             "%.4f, %.4f",
                             cycle, on ? "on" : "off", o, is.direct, is.indirect, be.direct, be.indirect);
            }
        }
    room_finish(&s);
    room_finish(&right[1]);
    room_finish(&right[0]);
}

#define STEP_M 0.1f

/* A lamp that walks down a corridor; frames have time for one tile. */
static struct room make_corridor(float lamp_x) {
    struct room room = {.texels_per_metre = 8};
    room_box(&room, lw_vec3(24, 2, 2), 0.3f, 0);
    room.light[0] = (struct lw_light){.kind = LW_LIGHT_POINT, .intensity = {4, 4, 4}};
    room.light_position[0] = lw_vec3(lamp_x, 1.5f, 1);
    room.light_count = 1;
    return room;
}

/* What a lamp that keeps moving has left behind is dark: light is no older than two sweeps, of which each
 * takes as many frames as there are tiles. */
static void test_a_lamp_that_walks(void **state) {
    (void)state;
    struct room_solution s, right[2];
    const struct room room = make_corridor(2);
    const unsigned frames = 120;
    room_solve_layers(&s, room_scene(&room), room.texels_per_metre,
                      (struct lw_solver_desc){.bounces = 1,
                                              .target_error = 0.02f,
                                              .denoise = true,
                                              .frame_budget_s = 1e-12,
                                              .threads = 1,
                                              .indirect_samples = 2},
                      NULL, 300);
    for (unsigned f = 0; f < frames; f++) {
        s.pose.light[0].position_ws.x += STEP_M;
        room_frame(&s, 301 + f);
    }
    const float age_m = STEP_M * (float)(2 * s.stats.tiles), is_m = s.pose.light[0].position_ws.x;
    for (int old = 0; old < 2; old++) {
        const struct room then = make_corridor(old ? is_m - age_m : is_m);
        room_solve(&right[old], &then, (struct lw_solver_desc){.bounces = 1, .target_error = -1}, 60);
    }
    for (uint32_t o = 0; o < room.quad_count; o++) {
        const double is = room_object_mean(&s, o).total, now = room_object_mean(&right[0], o).total,
                     then = room_object_mean(&right[1], o).total;
        if (!(is > 0.9 * fmin(now, then) && is < 1.1 * fmax(now, then)))
            fail_msg("side %u: %.4f, but now %.4f, then %.4f", o, is, now, then);
    }
    room_finish(&right[1]);
    room_finish(&right[0]);
    room_finish(&s);
}

int main(void) {
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(test_light_that_comes),        cmocka_unit_test(test_light_that_goes),
        cmocka_unit_test(test_noise_is_left),           cmocka_unit_test(test_direct_light),
        cmocka_unit_test(test_directions_stay),         cmocka_unit_test(test_packets_that_differ),
        cmocka_unit_test(test_what_may_be_missed),      cmocka_unit_test(test_light_from_next_to_none),
        cmocka_unit_test(test_lights_that_come_and_go), cmocka_unit_test(test_a_lamp_that_walks)};
    return cmocka_run_group_tests(tests, NULL, NULL);
}
