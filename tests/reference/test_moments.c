/* The cosine moment of light, beside irradiance: closed channels, bounds, both irradiances, change. */
#include "common/base/colour.h"
#include "common/light/client_lights.h"
#include "common/light/direction_form.h"
#include "common/tile/tile_codec.h"
#include "proto/message.h"
#include "server/publish/levels.h"
#include "server/publish/publisher.h"
#include "server/solve/cell_layer.h"
#include "tests/reference/room.h"

#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <unistd.h>

enum {
    FULL = 1u << LW_TILE_CHANNEL_FULL,
    BOTH = FULL | 1u << LW_TILE_CHANNEL_SPLIT,
    DIRECTION = 1u << LW_TILE_CHANNEL_DIRECTION,
    DIRECTIONS = DIRECTION | 1u << LW_TILE_CHANNEL_DIRECTION_SPLIT
};

static const struct lw_solver_desc kept = {
    .bounces = 2, .direct_samples = 1, .indirect_samples = 4, .target_error = -1, .directions = true};

struct lit {
    struct room_solution s;
    struct lw_client_lights client;
    uint64_t frame;
};

static void step(struct lit *l, unsigned frames) {
    for (unsigned i = 0; i < frames; i++)
        lw_support_ok(l->s.solver->ops->frame(l->s.solver, &l->s.pose, ++l->frame, &l->s.stats, NULL), NULL);
}

/* drawn: names of client lights; NULL: there are none. */
static void begin_scene(struct lit *l, struct lw_scene *scene, float texels_per_metre,
                        struct lw_solver_desc desc, const char *drawn, uint32_t channels, unsigned frames) {
    struct lw_error err = {0};
    struct lw_pose pose;
    *l = (struct lit){.frame = 0};
    lw_support_ok(lw_pose_init(&pose, scene), NULL);
    if (drawn) lw_support_ok(lw_client_lights_init(&l->client, scene, &pose, drawn, &err), &err);
    lw_pose_finish(&pose);
    desc.client_lights = drawn ? &l->client : NULL;
    room_solve_scene(&l->s, scene, texels_per_metre, desc, 0);
    l->s.solver->ops->choose_channels(l->s.solver, channels);
    step(l, frames);
}

static void begin(struct lit *l, const struct room *room, struct lw_solver_desc desc, const char *drawn,
                  uint32_t channels, unsigned frames) {
    begin_scene(l, room_scene(room), room->texels_per_metre, desc, drawn, channels, frames);
}

static void end(struct lit *l) {
    room_finish(&l->s);
    lw_client_lights_finish(&l->client);
}

/* A covered texel as it is shown. Objects stand where their meshes are. */
struct texel {
    uint32_t object;
    struct lw_vec3 at, normal, e[2], v[2]; /* by irradiance; e, v: 0 where it is not shown */
};

typedef void texel_fn(void *user, const struct texel *texel);

static struct lw_vec3 shown(const struct lw_solver_tile *tile, uint32_t channel, uint32_t i) {
    const float *const *plane = tile->shown[channel];
    return plane[0] ? lw_vec3(plane[0][i], plane[1][i], plane[2][i]) : lw_vec3(0, 0, 0);
}

static void each_texel(const struct lit *l, texel_fn *fn, void *user) {
    const struct lw_tiles *tiles = lw_cell_layer_tiles(l->s.solver);
    uint32_t count = 0;
    for (uint32_t t = 0; t < tiles->count; t++) {
        const struct lw_solve_tile *place = &tiles->tile[t];
        struct lw_solver_tile tile;
        l->s.solver->ops->read_tile(l->s.solver, place->id, &tile);
        for (uint32_t i = 0; i < tile.width * tile.height; i++) {
            if (!tile.covered[i]) continue;
            struct texel texel = {.object = place->object,
                                  .at = lw_texels_vector(place->mesh->position, place->local + i),
                                  .normal = lw_packed_normal_unpack(place->mesh->normal[place->local + i])};
            for (uint32_t channel = 0; channel < LW_TILE_CHANNEL_IRRADIANCES; channel++) {
                texel.e[channel] = shown(&tile, channel, i);
                texel.v[channel] = shown(&tile, LW_TILE_CHANNEL_DIRECTION + channel, i);
            }
            fn(user, &texel);
            count++;
        }
    }
    assert_true(count > 100);
}

/* ---- closed channels ---- */

struct mean {
    double e, along, across[2]; /* sums over texels: E; V along the normal, and across it */
};

static void add_mean(void *user, const struct texel *texel) {
    struct mean *mean = user;
    struct lw_vec3 t, b;
    lw_vec3_frame(texel->normal, &t, &b);
    mean->e += (double)lw_colour_luminance(texel->e[0]);
    mean->along += (double)lw_vec3_dot(texel->v[0], texel->normal);
    mean->across[0] += (double)lw_vec3_dot(texel->v[0], t);
    mean->across[1] += (double)lw_vec3_dot(texel->v[0], b);
}

/* V = 2/3 E n: an even hemisphere. */
static void expect_even(const struct lit *l) {
    struct mean mean = {0};
    each_texel(l, add_mean, &mean);
    expect_near(mean.along / mean.e, 2.0 / 3, 0.005);
    for (int k = 0; k < 2; k++) assert_true(fabs(mean.across[k] / mean.e) < 0.005);
}

static void test_even_sky(void **state) {
    (void)state;
    struct room room = {.texels_per_metre = 4, .sky = 2};
    struct lit l;
    room_quad(&room, lw_vec3(0, 0, 0), lw_vec3(0, 0, 4), lw_vec3(4, 0, 0), 0.5f, 0);
    begin(&l, &room, kept, NULL, FULL | DIRECTION, 32);
    expect_even(&l);
    end(&l);
}

/* All faces glow and reflect alike: every order of light is even. */
static void test_furnace(void **state) {
    (void)state;
    struct room room = {.texels_per_metre = 6};
    struct lit l;
    room_box(&room, lw_vec3(2, 2, 2), 0.5f, 1);
    begin(&l, &room, kept, NULL, FULL | DIRECTION, 48);
    expect_even(&l);
    end(&l);
}

struct lamp {
    struct lw_vec3 at;
    uint32_t off; /* the channel that lacks its light; FULL: V of that channel is all its light's */
    uint32_t texels;
};

/* V = E w: all light from one point. */
static void expect_lamp(void *user, const struct texel *texel) {
    struct lamp *lamp = user;
    struct lw_vec3 e = texel->e[0], v = texel->v[0];
    if (lamp->off) e = lw_vec3_sub(e, texel->e[lamp->off]), v = lw_vec3_sub(v, texel->v[lamp->off]);
    const float light = lw_colour_luminance(e);
    if (!(light > 0.02f)) return;
    const struct lw_vec3 wanted = lw_vec3_scale(lw_vec3_normalize(lw_vec3_sub(lamp->at, texel->at)), light);
    /* a texel's light is the mean over its sample points */
    assert_true(lw_vec3_length(lw_vec3_sub(v, wanted)) < 0.06f * light);
    lamp->texels++;
}

static struct room floor_and_lamp(void) {
    struct room room = {.texels_per_metre = 6, .light_count = 1};
    room_quad(&room, lw_vec3(0, 0, 0), lw_vec3(0, 0, 4), lw_vec3(4, 0, 0), 0.5f, 0);
    room.light[0] = (struct lw_light){.name = "lamp", .kind = LW_LIGHT_POINT, .intensity = {9, 5, 2}};
    room.light_position[0] = lw_vec3(1, 1.5f, 1);
    return room;
}

static void test_one_lamp(void **state) {
    (void)state;
    const struct room room = floor_and_lamp();
    struct lamp lamp = {.at = room.light_position[0]};
    struct lit l;
    begin(&l, &room, kept, NULL, FULL | DIRECTION, 12);
    each_texel(&l, expect_lamp, &lamp);
    assert_true(lamp.texels > 300);
    end(&l);
}

/* ---- both irradiances ---- */

static void test_channels_differ_by_the_lamp(void **state) {
    (void)state;
    struct room room = room_with_two_lamps();
    struct lamp lamp = {.at = room.light_position[0], .off = LW_TILE_CHANNEL_SPLIT};
    struct lit l;
    begin(&l, &room, kept, "left", BOTH | DIRECTIONS, 12);
    each_texel(&l, expect_lamp, &lamp);
    assert_true(lamp.texels > 300);
    end(&l);
}

static void expect_bounds(void *user, const struct texel *texel) {
    uint32_t *lit = user;
    for (uint32_t channel = 0; channel < LW_TILE_CHANNEL_IRRADIANCES; channel++) {
        const float light = lw_colour_luminance(texel->e[channel]);
        assert_true(lw_vec3_length(texel->v[channel]) <= 1.005f * light + 1e-6f);
        assert_true(lw_vec3_dot(texel->v[channel], texel->normal) >= -1e-6f);
        *lit += light > 0;
    }
}

static void test_bounds(void **state) {
    (void)state;
    const struct room room = room_with_two_lamps();
    uint32_t lit = 0;
    struct lit l;
    begin(&l, &room, kept, "left", BOTH | DIRECTIONS, 5);
    each_texel(&l, expect_bounds, &lit);
    assert_true(lit > 1000);
    end(&l);
}

/* ---- bounds of shown planes ---- */

/* A ball over a floor, under two lamps, at night: edges of shadow cross its seams. It is turned. */
static void begin_ball(struct lit *l, unsigned frames) {
    struct room room = floor_and_lamp();
    struct lw_solver_desc desc = kept;
    room.light[1] = room.light[0];
    room.light[0].name = "left", room.light[1].name = "right";
    room.light_position[1] = lw_vec3(3, 2, 2);
    room.light_count = 2;
    room_quad(&room, lw_vec3(0, 0, 0), lw_vec3(1, 0, 0), lw_vec3(0, 1, 0), 0.7f, 0); /* becomes the ball */
    struct lw_scene *scene = room_scene(&room);
    const uint32_t ball = room.quad_count - 1;
    room_make_ball(scene, ball, lw_vec3(0, 0, 0), 0.4f);
    memcpy(scene->node[ball].translation, (float[]){2, 0.7f, 1}, 3 * sizeof(float));
    memcpy(scene->node[ball].rotation, (float[]){0.6f, 0, 0, 0.8f}, 4 * sizeof(float));
    desc.denoise = true;
    begin_scene(l, scene, 24, desc, "left", BOTH | DIRECTIONS, frames);
}

/* At the current pose. */
static struct lw_vec3 normal_of(const struct lit *l, const struct lw_solve_tile *place, uint32_t i) {
    return lw_affine_normal(&l->s.pose.object_to_world[place->object],
                            lw_packed_normal_unpack(place->mesh->normal[place->local + i]));
}

static void test_shown_texels_and_gutters(void **state) {
    (void)state;
    struct lit l;
    begin_ball(&l, 6);
    const struct lw_tiles *tiles = lw_cell_layer_tiles(l.s.solver);
    uint32_t covered = 0, gutters = 0;
    for (uint32_t t = 0; t < tiles->count; t++) {
        const struct lw_solve_tile *place = &tiles->tile[t];
        struct lw_solver_tile tile;
        l.s.solver->ops->read_tile(l.s.solver, place->id, &tile);
        for (uint32_t i = 0; i < tile.width * tile.height; i++)
            for (uint32_t channel = 0; channel < LW_TILE_CHANNEL_IRRADIANCES; channel++) {
                const float light = lw_colour_luminance(shown(&tile, channel, i));
                const struct lw_vec3 v = shown(&tile, LW_TILE_CHANNEL_DIRECTION + channel, i);
                if (!tile.covered[i] && !tile.filled[i]) continue;
                assert_true(lw_vec3_length(v) <= (1 + 1e-5f) * light + 1e-9f);
                *(tile.covered[i] ? &covered : &gutters) += light > 0;
                if (tile.covered[i])
                    assert_true(lw_vec3_dot(v, normal_of(&l, place, i)) >= -1e-5f * light - 1e-9f);
            }
    }
    assert_true(covered > 10000 && gutters > 1000);
    end(&l);
}

/* The pyramid of one channel of an object. */
static void make_levels(const struct lit *l, uint32_t object, uint32_t channel, struct lw_levels *out) {
    lw_support_ok(lw_levels_init(out, channel, l->s.map.atlas[object]), NULL);
    for (uint32_t id = 0; id < l->s.map.plain_count; id++) {
        const struct lw_tile_place *place = &l->s.map.place[id];
        struct lw_solver_tile tile;
        if (place->object != object || place->level) continue;
        l->s.solver->ops->read_tile(l->s.solver, (lw_tile_id){id}, &tile);
        lw_levels_load_tile(out, place, &tile);
    }
    lw_levels_build(out);
}

/* All that look-ups read; returns how many texels have light. */
static uint32_t expect_short(const struct lw_levels_image *light, const struct lw_levels_image *moment) {
    uint32_t lit = 0;
    for (uint32_t i = 0; i < light->width * light->height; i++) {
        if (!light->covered[i]) continue;
        const float *e = light->value + 3 * i, *v = moment->value + 3 * i;
        const struct lw_vec3 r = lw_direction_of(v, e);
        const float luminance = lw_colour_luminance(lw_vec3(e[0], e[1], e[2]));
        assert_true(lw_vec3_length(lw_vec3(v[0], v[1], v[2])) <= (1 + 1e-5f) * luminance + 1e-9f);
        assert_true(lw_vec3_length(r) <= 1 + 1e-5f);
        lit += luminance > 0;
    }
    return lit;
}

static void test_levels(void **state) {
    (void)state;
    struct lit l;
    begin_ball(&l, 6);
    for (uint32_t object = 0; object < l.s.map.object_count; object++)
        for (uint32_t channel = 0; channel < LW_TILE_CHANNEL_IRRADIANCES; channel++) {
            struct lw_levels light, moment;
            make_levels(&l, object, channel, &light);
            make_levels(&l, object, LW_TILE_CHANNEL_DIRECTION + channel, &moment);
            assert_true(light.count > 3);
            for (uint32_t k = 0; k < light.count; k++)
                assert_true(expect_short(&light.level[k], &moment.level[k]) > 0);
            lw_levels_finish(&light);
            lw_levels_finish(&moment);
        }
    end(&l);
}

/* The longest r of a published tile, as a client decodes it. */
static float longest_of(struct lw_tile_codec *codec, const struct lw_blob *blob, uint32_t channel,
                        const struct lw_tile_place *place) {
    static float r[3 * LW_TILE_TEXELS_MAX];
    struct lw_framing_header header;
    struct lw_message m;
    float longest = 0;
    lw_support_ok(lw_framing_read_header(blob->bytes, LW_FRAMING_BODY_MAX, &header, NULL), NULL);
    lw_support_ok(lw_message_decode(header, blob->bytes + LW_FRAMING_HEADER_SIZE, &m, NULL), NULL);
    lw_support_ok(lw_tile_codec_decode(codec, lw_tile_channel_at(channel), m.tile.codec, m.tile.payload,
                                       m.tile.payload_size, m.tile.scale, place->width, place->height, NULL,
                                       r),
                  NULL);
    lw_message_finish(&m);
    for (uint32_t i = 0; i < place->width * place->height; i++)
        longest = fmaxf(longest, lw_vec3_length(lw_vec3(r[3 * i], r[3 * i + 1], r[3 * i + 2])));
    return longest;
}

/* The longest direction of all tiles that a publisher makes with this codec. */
static float longest_published(struct lit *l, uint32_t codec_number) {
    struct lw_publisher *publisher;
    struct lw_publisher_stats stats;
    struct lw_snapshot *snapshot;
    struct lw_tile_codec *codec;
    float longest = 0;
    lw_support_ok(lw_tile_codec_create(&codec), NULL);
    lw_support_ok(lw_publisher_create(&(struct lw_publisher_desc){.scene = l->s.scene,
                                                                  .atlas_map = &l->s.map,
                                                                  .solver = l->s.solver,
                                                                  .target_error = 0.02f,
                                                                  .codec = codec_number,
                                                                  .threads = 1},
                                      &publisher),
                  NULL);
    lw_support_ok(lw_publisher_set_channels(publisher, BOTH | DIRECTIONS), NULL);
    lw_support_ok(
        lw_publisher_publish(publisher, &l->s.pose, l->frame, 1, 1, l->s.map.tile_count, &snapshot, &stats),
        NULL);
    for (uint32_t channel = 0; channel < LW_TILE_CHANNEL_IRRADIANCES; channel++)
        for (uint32_t id = 0; id < l->s.map.plain_count; id++) {
            const uint32_t moment = LW_TILE_CHANNEL_DIRECTION + channel;
            const struct lw_snapshot_tile *tile = &snapshot->tile[moment][id];
            assert_non_null(tile->blob);
            longest = fmaxf(longest, longest_of(codec, tile->blob, moment, &l->s.map.place[id]));
        }
    lw_snapshot_unref(snapshot);
    lw_publisher_destroy(publisher);
    lw_tile_codec_destroy(codec);
    return longest;
}

/* In halves r is at most 1, but for their rounding. The lossy codec adds its error. */
static void test_published(void **state) {
    (void)state;
    struct lit l;
    begin_ball(&l, 6);
    const float halves = longest_published(&l, LW_TILE_CODEC_HALF_ZSTD),
                lossy = longest_published(&l, LW_TILE_CODEC_DCT);
    printf("|r| is at most %.4f in halves, %.4f in the lossy codec\n", (double)halves, (double)lossy);
    assert_true(halves > 0.9f && halves <= 1.001f);
    assert_true(lossy <= 1.25f);
    end(&l);
}

/* ---- change ---- */

struct difference {
    const struct lit *other;
    struct lw_vec3 *v; /* the other's, in the order of texels */
    uint32_t count;
    double off, light;
};

static void take_v(void *user, const struct texel *texel) {
    struct difference *d = user;
    d->v[d->count++] = texel->v[0];
}
static void compare_v(void *user, const struct texel *texel) {
    struct difference *d = user;
    d->off += (double)lw_vec3_length(lw_vec3_sub(texel->v[0], d->v[d->count++]));
    d->light += (double)lw_colour_luminance(texel->e[0]);
}

static double difference_of(const struct lit *a, const struct lit *b) {
    struct difference d = {.v = malloc(sizeof *d.v * 65536)};
    assert_non_null(d.v);
    each_texel(b, take_v, &d);
    d.count = 0;
    each_texel(a, compare_v, &d);
    free(d.v);
    return d.off / d.light;
}

/* A lamp moves to the other end of its room after 30 frames: light that has changed forgets where it came
 * from. Eight frames later it is as in a room where it always was there. */
static void test_follows_a_lamp(void **state) {
    (void)state;
    struct room room = room_with_two_lamps(), after;
    struct lit moved, fresh, before;
    room.texels_per_metre = 6;
    room.light_count = 1;
    room.quad[ROOM_PANEL].emission = 0;
    after = room;
    after.light_position[0] = lw_vec3(3, 1.6f, 1);
    begin(&fresh, &after, kept, NULL, FULL | DIRECTION, 40);
    begin(&before, &room, kept, NULL, FULL | DIRECTION, 40);
    begin(&moved, &room, kept, NULL, FULL | DIRECTION, 30);
    lw_pose_copy(&moved.s.pose, &fresh.s.pose, moved.s.scene);
    step(&moved, 8);
    assert_true(difference_of(&before, &fresh) > 0.5);
    assert_true(difference_of(&moved, &fresh) < 0.1);
    end(&moved);
    end(&fresh);
    end(&before);
}

/* ---- light stays as it is ---- */

static void test_light_is_the_same_without(void **state) {
    (void)state;
    const struct room room = room_with_two_lamps();
    struct lw_solver_desc off = kept;
    struct lit with, without;
    off.directions = false;
    begin(&with, &room, kept, "left", BOTH, 6);
    begin(&without, &room, off, "left", BOTH, 6);
    assert_true(room_expect_same(&with.s, &without.s) > 0);
    assert_true(with.s.solver->ops->memory_bytes(with.s.solver) >
                without.s.solver->ops->memory_bytes(without.s.solver));
    end(&with);
    end(&without);
}

struct of_object {
    uint32_t object;
    double length, others; /* sums of moments' lengths: of its texels, of all others */
};

static void sum_lengths(void *user, const struct texel *texel) {
    struct of_object *sum = user;
    *(texel->object == sum->object ? &sum->length : &sum->others) +=
        (double)lw_vec3_length(texel->v[LW_TILE_CHANNEL_FULL]);
}

/* Nobody reads where the light of one object comes from: its moments stay 0. All light, and the moments of
 * other objects, are as if all moments were read. */
static void test_only_objects_that_are_read_have_it(void **state) {
    (void)state;
    const struct room room = room_with_two_lamps();
    struct lw_solver_desc some = kept;
    bool directional[ROOM_QUADS_MAX];
    struct lit all, part;
    struct of_object of_all = {.object = 0}, of_part = {.object = 0};
    for (uint32_t o = 0; o < ROOM_QUADS_MAX; o++) directional[o] = o != 0;
    some.directional = directional;
    begin(&all, &room, kept, "left", BOTH | DIRECTIONS, 4);
    begin(&part, &room, some, "left", BOTH | DIRECTIONS, 4);
    assert_true(room_expect_same(&all.s, &part.s) > 0);
    each_texel(&all, sum_lengths, &of_all);
    each_texel(&part, sum_lengths, &of_part);
    assert_true(of_all.length > 0 && of_part.length == 0);
    assert_true(of_all.others > 0 && of_part.others == of_all.others);
    end(&all);
    end(&part);
}

static void test_a_checkpoint_keeps_it(void **state) {
    (void)state;
    const struct room room = room_with_two_lamps();
    const uint8_t key[16] = {7};
    char path[] = "/tmp/lightwell-moments-XXXXXX";
    struct lw_error err = {0};
    struct lit first, again;
    uint64_t frames;
    const int file = mkstemp(path);
    assert_true(file >= 0);
    close(file);
    begin(&first, &room, kept, "left", BOTH | DIRECTIONS, 5);
    lw_support_ok(first.s.solver->ops->save(first.s.solver, path, key, &err), &err);
    begin(&again, &room, kept, "left", BOTH | DIRECTIONS, 0);
    lw_support_ok(again.s.solver->ops->load(again.s.solver, path, key, &frames, &err), &err);
    again.frame = first.frame;
    assert_true(difference_of(&first, &again) == 0);
    step(&first, 2);
    step(&again, 2);
    assert_true(difference_of(&first, &again) == 0);
    unlink(path);
    end(&first);
    end(&again);
}

int main(void) {
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(test_even_sky),
        cmocka_unit_test(test_furnace),
        cmocka_unit_test(test_one_lamp),
        cmocka_unit_test(test_channels_differ_by_the_lamp),
        cmocka_unit_test(test_bounds),
        cmocka_unit_test(test_shown_texels_and_gutters),
        cmocka_unit_test(test_levels),
        cmocka_unit_test(test_published),
        cmocka_unit_test(test_follows_a_lamp),
        cmocka_unit_test(test_light_is_the_same_without),
        cmocka_unit_test(test_only_objects_that_are_read_have_it),
        cmocka_unit_test(test_a_checkpoint_keeps_it),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
