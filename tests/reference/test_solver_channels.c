/* A channel that only this file knows goes the way of every other through the solver: filtered, welded,
 * filled into gutters, summed over layers, kept in a checkpoint. What it holds is light times a number, and
 * every one of these is linear; so its shown planes must be those of light, times that number. */
#include "tests/reference/room.h"

#include "server/solve/cell_layer.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>

#define MADE_UP 4u /* its number */
#define PLANES  2u

static const struct lw_tile_channel made_up = {.name = "shade",
                                               .unit = "W/m^2",
                                               .meaning = "light that is missing, and green light twice",
                                               .planes = PLANES,
                                               .is_signed = true,
                                               .coding = LW_TILE_CODING_PLAIN,
                                               .step = 1,
                                               .kept = true,
                                               .slot = 1,
                                               .follows = LW_TILE_CHANNEL_FULL};
static const struct {
    int colour;
    float factor;
} of_light[PLANES] = {{0, -1}, {1, 2}};

/* ---- the table, and the layers that a solver has ---- */

const struct lw_tile_channels *__real_lw_tile_channels(void);
const struct lw_tile_channels *__wrap_lw_tile_channels(void);
const struct lw_tile_channels *__wrap_lw_tile_channels(void) {
    static struct lw_tile_channels table;
    if (!table.count) {
        table = *__real_lw_tile_channels();
        assert_int_equal(table.count, MADE_UP);
        table.channel[table.count++] = made_up;
    }
    return &table;
}

static struct lw_solver *layer[LW_LIGHT_GROUPS_MAX]; /* layers of the newest solver */
static uint32_t layers;

enum lw_status __real_lw_cell_layer_create(struct lw_geometry *geometry, const struct lw_solver_desc *desc,
                                           const struct lw_pose *pose, struct lw_solver **out_solver,
                                           struct lw_error *err);
enum lw_status __wrap_lw_cell_layer_create(struct lw_geometry *geometry, const struct lw_solver_desc *desc,
                                           const struct lw_pose *pose, struct lw_solver **out_solver,
                                           struct lw_error *err);
enum lw_status __wrap_lw_cell_layer_create(struct lw_geometry *geometry, const struct lw_solver_desc *desc,
                                           const struct lw_pose *pose, struct lw_solver **out_solver,
                                           struct lw_error *err) {
    enum lw_status status = __real_lw_cell_layer_create(geometry, desc, pose, out_solver, err);
    layer[layers++] = *out_solver;
    return status;
}

/* ---- a room ---- */

static void begin(struct room_solution *s, const char *groups, bool denoise, unsigned frames) {
    const struct room room = room_with_two_lamps();
    const struct lw_solver_desc desc = {.bounces = 1,
                                        .direct_samples = 1,
                                        .indirect_samples = 2,
                                        .target_error = 0.05f,
                                        .frames_max = frames,
                                        .denoise = denoise};
    layers = 0;
    room_solve_layers(s, room_scene(&room), room.texels_per_metre, desc, groups, frames);
}

static void fill(const struct lw_tiles *tiles) {
    for (uint32_t p = 0; p < PLANES; p++)
        for (uint32_t t = 0; t < tiles->texel_count; t++)
            tiles->sum[MADE_UP][p][t] = of_light[p].factor * lw_tiles_sum(tiles, LW_TILE_CHANNEL_FULL,
                                                                          (uint32_t)of_light[p].colour, t);
}

static void fill_all(void) {
    for (uint32_t k = 0; k < layers; k++) fill(lw_cell_layer_tiles(layer[k]));
}

static void step(struct room_solution *s, uint64_t frame) { room_frame(s, frame); }

static void show_and_step(struct room_solution *s, uint32_t channels, uint64_t frame) {
    s->solver->ops->choose_channels(s->solver, channels);
    step(s, frame);
}

struct compared {
    uint32_t texels, gutters;
    double most, square, light; /* the largest difference; sums of squares, of differences and of light */
};

/* factor[p]: of light, in each plane. */
static struct compared compare(const struct room_solution *s, const double factor[PLANES]) {
    struct compared c = {0};
    for (uint32_t id = 0; id < s->map.tile_count; id++) {
        struct lw_solver_tile tile;
        if (s->map.place[id].level) continue;
        s->solver->ops->read_tile(s->solver, (lw_tile_id){id}, &tile);
        for (uint32_t i = 0; i < tile.width * tile.height; i++) {
            if (!tile.covered[i] && !tile.filled[i]) continue;
            c.texels++;
            c.gutters += !tile.covered[i];
            for (uint32_t p = 0; p < PLANES; p++) {
                const double light = (double)tile.shown[LW_TILE_CHANNEL_FULL][of_light[p].colour][i],
                             off = (double)tile.shown[MADE_UP][p][i] - factor[p] * light;
                c.most = fmax(c.most, fabs(off));
                c.square += off * off;
                c.light += factor[p] * factor[p] * light * light;
            }
        }
    }
    assert_true(c.texels > 1000 && c.gutters > 100 && c.light > 0);
    return c;
}

static const double factor_alone[PLANES] = {-1, 2};

/* Welding keeps light from falling below none and scales what it moves to keep its sum: of what has a sign
 * neither is done. There is no other difference, and it is small. */
#define WELDS_SHARE 0.002 /* share of the light, as a root mean square */

static void expect_linear(const struct room_solution *s, const double factor[PLANES]) {
    const struct compared c = compare(s, factor);
    if (!(sqrt(c.square / c.light) < WELDS_SHARE))
        fail_msg("off by %g of the light; at most by %g", sqrt(c.square / c.light), c.most);
}

static void shown_as_light_is(bool denoise) {
    struct room_solution s;
    begin(&s, NULL, denoise, 4);
    assert_int_equal(layers, 1);
    struct lw_solver_tile tile;
    s.solver->ops->read_tile(s.solver, (lw_tile_id){0}, &tile);
    assert_null(tile.shown[MADE_UP][0]); /* nobody asked */
    fill_all();
    show_and_step(&s, LW_TILE_CHANNELS_FULL | lw_tile_channel_bit(MADE_UP), 5);
    assert_int_equal(s.stats.texels_solved, 0);
    expect_linear(&s, factor_alone);
    room_finish(&s);
}

static void test_shown(void **state) {
    (void)state;
    shown_as_light_is(false);
}

static void test_filtered(void **state) {
    (void)state;
    shown_as_light_is(true);
}

/* Shown alone it is filtered by light all the same. */
static void test_alone(void **state) {
    (void)state;
    struct room_solution s;
    begin(&s, NULL, true, 4);
    fill_all();
    show_and_step(&s, lw_tile_channel_bit(MADE_UP), 5);
    expect_linear(&s, factor_alone);
    room_finish(&s);
}

/* The sum over layers weighs a plane by the layer's intensity. A plane that is no colour has the weight of
 * luminance. */
static void test_layers(void **state) {
    (void)state;
    struct room_solution s;
    begin(&s, "left", true, 4);
    assert_int_equal(layers, 2);
    fill_all();
    show_and_step(&s, LW_TILE_CHANNELS_FULL | lw_tile_channel_bit(MADE_UP), 5);
    expect_linear(&s, factor_alone);
    s.pose.light[0].intensity = lw_vec3_scale(s.pose.light[0].intensity, 0.5f);
    step(&s, 6);
    expect_linear(&s, factor_alone);
    room_finish(&s);
}

static void test_checkpoint(void **state) {
    (void)state;
    static const uint8_t key[16] = {7};
    const char *path = lw_support_temporary("channels");
    struct lw_error err = {0};
    struct room_solution first, second;
    begin(&first, NULL, true, 4);
    fill_all();
    const struct lw_tiles *before = lw_cell_layer_tiles(layer[0]);
    show_and_step(&first, LW_TILE_CHANNELS_FULL | lw_tile_channel_bit(MADE_UP), 5);
    lw_support_ok(first.solver->ops->save(first.solver, path, key, &err), &err);
    begin(&second, NULL, true, 0);
    const struct lw_tiles *after = lw_cell_layer_tiles(layer[0]);
    uint64_t frames;
    lw_support_ok(second.solver->ops->load(second.solver, path, key, &frames, &err), &err);
    for (uint32_t p = 0; p < PLANES; p++) {
        const size_t bytes = before->texel_count * sizeof(float);
        assert_memory_equal(after->sum[MADE_UP][p], before->sum[MADE_UP][p], bytes);
        assert_memory_equal(after->shown[MADE_UP][p], before->shown[MADE_UP][p], bytes);
    }
    room_finish(&first);
    room_finish(&second);
}

int main(void) {
    const struct CMUnitTest tests[] = {cmocka_unit_test(test_shown), cmocka_unit_test(test_filtered),
                                       cmocka_unit_test(test_alone), cmocka_unit_test(test_layers),
                                       cmocka_unit_test(test_checkpoint)};
    return cmocka_run_group_tests(tests, NULL, NULL);
}
