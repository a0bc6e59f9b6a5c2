/* Light in two channels: all of it is the split irradiance and the direct light of client lights. */
#include "common/light/client_lights.h"
#include "tests/reference/room.h"

#include <stdlib.h>
#include <string.h>

enum { BOTH = 1u << LW_TILE_CHANNEL_FULL | 1u << LW_TILE_CHANNEL_SPLIT, SPLIT = 1u << LW_TILE_CHANNEL_SPLIT };

static struct room make_room(void) {
    struct room room = room_with_two_lamps();
    room.texels_per_metre = 6;
    return room;
}

static const struct lw_solver_desc plain = {
    .bounces = 2, .direct_samples = 1, .indirect_samples = 4, .target_error = 0.05f};

struct parted {
    struct room_solution s;
    struct lw_client_lights client;
    uint64_t frame;
};

static void begin(struct parted *p, const struct room *room, struct lw_solver_desc desc, const char *drawn,
                  const char *groups) {
    struct lw_error err = {0};
    struct lw_scene *scene = room_scene(room);
    struct lw_pose pose;
    lw_support_ok(lw_pose_init(&pose, scene), NULL);
    lw_support_ok(lw_client_lights_init(&p->client, scene, &pose, drawn, &err), &err);
    lw_pose_finish(&pose);
    desc.client_lights = &p->client;
    room_solve_layers(&p->s, scene, room->texels_per_metre, desc, groups, 0);
    p->frame = 0;
}

static void end(struct parted *p) {
    room_finish(&p->s);
    lw_client_lights_finish(&p->client);
}

static void show_channels(struct parted *p, unsigned channels) {
    p->s.solver->ops->choose_channels(p->s.solver, channels);
}

static void step(struct parted *p, unsigned frames) {
    for (unsigned i = 0; i < frames; i++)
        lw_support_ok(p->s.solver->ops->frame(p->s.solver, &p->s.pose, ++p->frame, &p->s.stats, NULL), NULL);
}

/* The mean of an object's shown light over its covered texels, red channel; and of the squares of the part
 * that the two channels differ by. */
struct shown {
    double full, split, difference_square;
};

static struct shown shown_of(const struct parted *p, uint32_t object) {
    struct shown shown = {0};
    double count = 0;
    const struct lw_atlas_level *level = &p->s.map.atlas[object]->level[0];
    for (uint32_t t = 0; t < level->tiles_x * level->tiles_y; t++) {
        struct lw_solver_tile tile;
        p->s.solver->ops->read_tile(p->s.solver, (lw_tile_id){p->s.map.first_tile[object] + t}, &tile);
        for (uint32_t i = 0; i < tile.width * tile.height; i++) {
            if (!tile.covered[i]) continue;
            const double full = (double)tile.shown[LW_TILE_CHANNEL_FULL][0][i],
                         split = (double)(tile.shown[LW_TILE_CHANNEL_SPLIT][0]
                                              ? tile.shown[LW_TILE_CHANNEL_SPLIT][0][i]
                                              : 0);
            shown.full += full;
            shown.split += split;
            shown.difference_square += (full - split) * (full - split);
            count++;
        }
    }
    shown.full /= count, shown.split /= count, shown.difference_square /= count;
    return shown;
}

/* The channels differ, over each face of the room, by the direct light of a room that has the client lights
 * alone. */
static void expect_difference(const struct parted *p, const struct room *drawn, double tolerance) {
    struct room_solution direct;
    struct lw_solver_desc desc = plain;
    uint64_t frame = 0;
    desc.bounces = 0;
    room_solve_scene(&direct, room_scene(drawn), drawn->texels_per_metre, desc, 0);
    room_solve_until_rest(&direct, &frame);
    for (uint32_t o = 0; o < ROOM_FACES; o++) {
        const struct shown shown = shown_of(p, o);
        expect_near(shown.full - shown.split, room_object_mean(&direct, o).direct, tolerance);
    }
    room_finish(&direct);
}

static void test_channels_differ_by_what_clients_draw(void **state) {
    (void)state;
    const char *const groups[] = {"none", "left;right"};
    struct room room = make_room(), left = make_room();
    left.light_count = 1;
    left.quad[ROOM_PANEL].emission = 0;
    for (int denoise = 0; denoise < 2; denoise++)
        for (int g = 0; g < 2; g++) {
            struct parted p;
            struct lw_solver_desc desc = plain;
            desc.denoise = denoise;
            begin(&p, &room, desc, "left", groups[g]);
            show_channels(&p, BOTH);
            room_solve_until_rest(&p.s, &p.frame);
            expect_difference(&p, &left, 0.02);
            end(&p);
        }
}

/* Nothing but client lights, and no bounces: nothing is left. */
static void test_nothing_is_left_without_bounces(void **state) {
    (void)state;
    struct room room = make_room();
    struct parted p;
    struct lw_solver_desc desc = plain;
    desc.bounces = 0;
    begin(&p, &room, desc, NULL, "none");
    assert_int_equal(p.client.drawn_lights, 2);
    assert_int_equal(p.client.drawn_materials, 1); /* the panel is small */
    show_channels(&p, BOTH);
    step(&p, 8);
    for (uint32_t o = 0; o < ROOM_FACES; o++) {
        const struct shown shown = shown_of(&p, o);
        assert_true(shown.full > 0.01 && fabs(shown.split) < 1e-5 * shown.full);
    }
    end(&p);
}

/* A lamp that is drawn moves, is dimmed, goes out: in each frame after, the channels differ by its light as
 * it is now. */
static void test_drawn_lights_change(void **state) {
    (void)state;
    const char *const groups[] = {"none", "left;right"};
    for (int g = 0; g < 2; g++) {
        struct room room = make_room(), left = make_room();
        struct parted p;
        begin(&p, &room, plain, "left", groups[g]);
        show_channels(&p, BOTH);
        room_solve_until_rest(&p.s, &p.frame);
        left.light_count = 1;
        left.quad[ROOM_PANEL].emission = 0;

        left.light_position[0] = p.s.pose.light[0].position_ws = lw_vec3(1.2f, 1.2f, 1.1f);
        step(&p, 1); /* changed light is corrected by samples taken again */
        step(&p, 40);
        expect_difference(&p, &left, 0.03);

        p.s.pose.light[0].intensity = lw_vec3(1, 1, 1);
        for (int c = 0; c < 3; c++) left.light[0].intensity[c] = 1;
        step(&p, 40);
        expect_difference(&p, &left, 0.03);

        const double before = shown_of(&p, 0).split;
        p.s.pose.light[0].intensity = lw_vec3(0, 0, 0);
        step(&p, 1);
        struct shown dark = shown_of(&p, 0);
        assert_true(sqrt(dark.difference_square) < 0.01 * dark.full);
        assert_true(dark.split < before); /* its bounces are gone as well, or go */
        room_solve_until_rest(&p.s, &p.frame);
        dark = shown_of(&p, 0);
        assert_true(sqrt(dark.difference_square) < 0.01 * dark.full);
        end(&p);
    }
}

/* A channel that is asked for when all has converged comes whole in the next frame, by no ray, and
 * is the same as if asked for from the start. */
static void test_a_form_may_come_late(void **state) {
    (void)state;
    const char *const groups[] = {"none", "left;right"};
    for (int g = 0; g < 2; g++) {
        struct room room = make_room();
        struct parted early, late;
        begin(&early, &room, plain, "left", groups[g]);
        begin(&late, &room, plain, "left", groups[g]);
        show_channels(&early, SPLIT);
        room_solve_until_rest(&early.s, &early.frame);
        room_solve_until_rest(&late.s, &late.frame);
        struct lw_solver_tile tile;
        late.s.solver->ops->read_tile(late.s.solver, (lw_tile_id){late.s.map.first_tile[0]}, &tile);
        assert_null(tile.shown[LW_TILE_CHANNEL_SPLIT][0]);
        show_channels(&late, SPLIT);
        step(&late, 1);
        assert_int_equal(late.s.stats.rays_shadow + late.s.stats.rays_bounce, 0);
        assert_true(late.s.stats.tiles_shown > 0);
        late.s.solver->ops->read_tile(late.s.solver, (lw_tile_id){late.s.map.first_tile[0]}, &tile);
        assert_int_equal(tile.solved_frame, late.frame);
        for (uint32_t o = 0; o < ROOM_FACES; o++)
            expect_near(shown_of(&late, o).split, shown_of(&early, o).split, 0.005);
        const double split = shown_of(&late, 0).split, full = shown_of(&late, 0).full;
        show_channels(&late, LW_TILE_CHANNELS_FULL);
        step(&late, 1);
        expect_near(shown_of(&late, 0).full, full, 0.005);
        show_channels(&late, BOTH);
        step(&late, 1);
        expect_near(shown_of(&late, 0).split, split, 0.005);
        end(&early);
        end(&late);
    }
}

/* Without client lights there is one channel, whatever the settings. */
static void test_no_client_lights(void **state) {
    (void)state;
    struct room room = make_room();
    struct parted p;
    begin(&p, &room, plain, "none", "none");
    show_channels(&p, BOTH);
    step(&p, 2);
    struct lw_solver_tile tile;
    p.s.solver->ops->read_tile(p.s.solver, (lw_tile_id){p.s.map.first_tile[0]}, &tile);
    assert_null(tile.shown[LW_TILE_CHANNEL_SPLIT][0]);
    assert_true(shown_of(&p, 0).full > 0);
    end(&p);
}

static uint64_t rays_until_rest(struct parted *p) {
    uint64_t rays = 0;
    for (unsigned quiet = 0; quiet < 20; quiet = p->s.stats.tiles_solved ? 0 : quiet + 1) {
        step(p, 1);
        rays += p->s.stats.rays_shadow + p->s.stats.rays_bounce;
    }
    return rays;
}

/* The filter goes by the noise of what it shows: that of a panel which clients draw does not wash out the
 * shadows of lamps which the server keeps. */
static void test_noise_of_what_is_drawn_filters_nothing(void **state) {
    (void)state;
    struct room room = make_room(), lamps = make_room();
    struct parted p, sharp;
    struct lw_solver_desc desc = plain;
    double change = 0, light = 0;
    room.texels_per_metre = lamps.texels_per_metre = 12;
    room.quad[ROOM_PANEL].emission = 200; /* the one material that shines; all are called "grey" */
    lamps.quad[ROOM_PANEL].emission = 0;
    desc.bounces = 0;
    begin(&sharp, &lamps, desc, "none", "none");
    desc.denoise = true;
    begin(&p, &room, desc, "grey", "none");
    assert_int_equal(p.client.drawn_lights + 10 * p.client.drawn_materials, 10);
    show_channels(&p, BOTH);
    step(&p, 16);
    step(&sharp, 16);
    for (uint32_t id = 0; id < p.s.map.tile_count; id++) {
        struct lw_solver_tile x, y;
        if (p.s.map.place[id].level || p.s.map.place[id].object >= ROOM_FACES) continue;
        p.s.solver->ops->read_tile(p.s.solver, (lw_tile_id){id}, &x);
        sharp.s.solver->ops->read_tile(sharp.s.solver, (lw_tile_id){id}, &y);
        for (uint32_t i = 0; i < x.width * x.height; i++) {
            const double off =
                x.covered[i]
                    ? (double)(x.shown[LW_TILE_CHANNEL_SPLIT][0][i] - y.shown[LW_TILE_CHANNEL_FULL][0][i])
                    : 0;
            change += off * off;
            light += x.covered[i]
                         ? (double)(y.shown[LW_TILE_CHANNEL_FULL][0][i] * y.shown[LW_TILE_CHANNEL_FULL][0][i])
                         : 0;
        }
    }
    print_message("relative squared change %.2g\n", change / light);
    assert_true(change / light < 1.4e-4);
    end(&p);
    end(&sharp);
}

/* Standard error of the split irradiance at a texel of the floor, against all light: by another solve of the
 * same error. */
static double error_between(const struct parted *a, const struct parted *b) {
    double square = 0, light = 0, count = 0;
    const struct lw_atlas_level *level = &a->s.map.atlas[0]->level[0];
    for (uint32_t t = 0; t < level->tiles_x * level->tiles_y; t++) {
        struct lw_solver_tile x, y;
        a->s.solver->ops->read_tile(a->s.solver, (lw_tile_id){a->s.map.first_tile[0] + t}, &x);
        b->s.solver->ops->read_tile(b->s.solver, (lw_tile_id){b->s.map.first_tile[0] + t}, &y);
        for (uint32_t i = 0; i < x.width * x.height; i++) {
            if (!x.covered[i]) continue;
            const double off =
                (double)(x.shown[LW_TILE_CHANNEL_SPLIT][0][i] - y.shown[LW_TILE_CHANNEL_SPLIT][0][i]);
            square += off * off / 2;
            light += (double)(y.direct[0][i] + y.indirect[0][i]);
            count++;
        }
    }
    return sqrt(square / count) / (light / count);
}

/* Noise of what clients draw costs no ray while all who look draw it; when others come, it does. */
static void test_noise_of_what_is_shown_counts(void **state) {
    (void)state;
    struct room room = make_room();
    struct parted split, both;
    struct lw_solver_desc desc = plain;
    room.quad[ROOM_PANEL].emission = 40; /* near the ceiling and the plate: a good deal of noise */
    room.texels_per_metre = 4;
    desc.target_error = 0.02f;
    begin(&split, &room, desc, NULL, "none");
    desc.seed = 5;
    begin(&both, &room, desc, NULL, "none");
    show_channels(&split, SPLIT);
    show_channels(&both, BOTH);
    const uint64_t rays = rays_until_rest(&split), more = rays_until_rest(&both);
    print_message("%.3g rays of %.3g; error %.4f\n", (double)rays, (double)more,
                  error_between(&split, &both));
    assert_true(rays < 0.9 * (double)more);
    assert_true(error_between(&split, &both) < (double)desc.target_error);
    show_channels(&split, BOTH);
    step(&split, 1);
    assert_true(split.s.stats.tiles_solved > 0 && split.s.stats.tiles_converged < split.s.stats.tiles);
    end(&split);
    end(&both);
}

int main(void) {
    const struct CMUnitTest tests[] = {cmocka_unit_test(test_channels_differ_by_what_clients_draw),
                                       cmocka_unit_test(test_nothing_is_left_without_bounces),
                                       cmocka_unit_test(test_drawn_lights_change),
                                       cmocka_unit_test(test_a_form_may_come_late),
                                       cmocka_unit_test(test_no_client_lights),
                                       cmocka_unit_test(test_noise_of_what_is_drawn_filters_nothing),
                                       cmocka_unit_test(test_noise_of_what_is_shown_counts)};
    return cmocka_run_group_tests(tests, NULL, NULL);
}
