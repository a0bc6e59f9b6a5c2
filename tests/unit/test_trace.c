#include "tests/support/support.h"

#include "common/base/random.h"
#include "common/trace/trace.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>

struct fixture {
    struct lw_scene *scene;
    struct lw_pose pose;
    struct lw_trace *trace;
};

static void start(struct fixture *f, struct lw_scene *scene) {
    struct lw_error err = {0};
    f->scene = scene;
    lw_support_ok(lw_pose_init(&f->pose, scene), NULL);
    lw_support_ok(lw_trace_create(scene, &f->pose, &f->trace, &err), &err);
}

static void stop(struct fixture *f) {
    lw_trace_destroy(f->trace);
    lw_pose_finish(&f->pose);
    lw_scene_destroy(f->scene);
}

/* One ray in lane 3, the others at rest. */
static struct lw_hit16 shoot(const struct fixture *f, unsigned flags, struct lw_vec3 org,
                             struct lw_vec3 dir) {
    struct lw_ray16 rays;
    struct lw_hit16 hits;
    memset(&rays, 0, sizeof rays);
    rays.org_x[3] = org.x, rays.org_y[3] = org.y, rays.org_z[3] = org.z;
    rays.dir_x[3] = dir.x, rays.dir_y[3] = dir.y, rays.dir_z[3] = dir.z;
    rays.t_far[3] = INFINITY;
    lw_trace_closest16(f->trace, flags, 1u << 3, &rays, &hits);
    for (int i = 0; i < 16; i++) assert_true(i == 3 || hits.object[i] == LW_TRACE_MISS);
    uint16_t occluded = lw_trace_occluded16(f->trace, flags, 1u << 3, &rays);
    assert_int_equal(occluded, hits.object[3] == LW_TRACE_MISS ? 0 : 1u << 3);
    return hits;
}

static const struct lw_vec3 down = {0, -1, 0}, up = {0, 1, 0};

static void test_front_and_back(void **state) {
    (void)state;
    struct fixture f;
    start(&f, lw_support_squares(2, 1));
    struct lw_hit16 hit = shoot(&f, LW_TRACE_LIGHT, lw_vec3(2.1f, 3, 0.2f), down);
    assert_int_equal(hit.object[3], 1);
    assert_float_equal(hit.t[3], 3, 1e-6);
    assert_int_equal(hit.back[3], 0);
    hit = shoot(&f, LW_TRACE_LIGHT, lw_vec3(0.1f, -3, 0.2f), up);
    assert_int_equal(hit.object[3], 0);
    assert_int_equal(hit.back[3], 1);
    /* View rays do not see the backs of single-sided surfaces. */
    assert_int_equal(shoot(&f, LW_TRACE_VIEW, lw_vec3(0.1f, -3, 0.2f), up).object[3], LW_TRACE_MISS);
    f.scene->material[0].double_sided = 1;
    assert_int_equal(shoot(&f, LW_TRACE_VIEW, lw_vec3(0.1f, -3, 0.2f), up).back[3], 1);
    stop(&f);
}

/* Gives object 0 an animation, so that it becomes an instance. */
static void animate(struct lw_scene *scene) {
    static const float times[] = {0, 1}, values[] = {0, 0, 0, 0, 5, 0};
    scene->channel = lw_scene_alloc(scene, 1, sizeof *scene->channel);
    scene->channel[0] = (struct lw_channel){.node = 0,
                                            .path = LW_CHANNEL_TRANSLATION,
                                            .interpolation = LW_INTERPOLATION_LINEAR,
                                            .key_count = 2,
                                            .time_s = times,
                                            .value = values};
    scene->channel_count = 1;
    scene->duration_s = 1;
}

static void test_mirrored_objects_keep_their_front(void **state) {
    (void)state;
    for (int moving = 0; moving < 2; moving++) {
        struct fixture f;
        struct lw_scene *scene = lw_support_squares(1, 1);
        scene->node[0].scale[0] = -2;
        if (moving) animate(scene);
        start(&f, scene);
        struct lw_hit16 hit = shoot(&f, LW_TRACE_LIGHT, lw_vec3(0.7f, 3, 0.2f), down);
        assert_int_equal(hit.object[3], 0);
        assert_int_equal(hit.back[3], 0);
        assert_int_equal(shoot(&f, LW_TRACE_VIEW, lw_vec3(0.7f, 3, 0.2f), down).object[3], 0);
        assert_int_equal(shoot(&f, LW_TRACE_LIGHT, lw_vec3(0.7f, -3, 0.2f), up).back[3], 1);
        assert_int_equal(shoot(&f, LW_TRACE_VIEW, lw_vec3(0.7f, -3, 0.2f), up).object[3], LW_TRACE_MISS);
        stop(&f);
    }
}

static void test_moving_objects_follow_the_pose(void **state) {
    (void)state;
    struct fixture f;
    struct lw_error err = {0};
    struct lw_scene *scene = lw_support_squares(2, 1);
    animate(scene);
    start(&f, scene);
    assert_float_equal(shoot(&f, 0, lw_vec3(0.1f, 9, 0.2f), down).t[3], 9, 1e-5);
    lw_pose_evaluate(&f.pose, scene, 0.6);
    lw_support_ok(lw_trace_set_pose(f.trace, &f.pose, &err), &err);
    struct lw_hit16 hit = shoot(&f, 0, lw_vec3(0.1f, 9, 0.2f), down);
    assert_float_equal(hit.t[3], 6, 1e-4);
    assert_int_equal(hit.object[3], 0);
    assert_int_equal(shoot(&f, 0, lw_vec3(2.1f, 9, 0.2f), down).object[3], 1);
    stop(&f);
}

/* How the scene of static objects is built again: before the next ray, in a thread that has ended by then, or
 * in one that may still run. */
enum when { AT_ONCE, SOON, LATER };

static void take_pose(struct fixture *f, enum when when) {
    struct lw_error err = {0};
    if (when == AT_ONCE)
        lw_support_ok(lw_trace_set_pose(f->trace, &f->pose, &err), &err);
    else
        lw_support_ok(lw_trace_set_pose_soon(f->trace, &f->pose, &err), &err);
    if (when == SOON) lw_support_ok(lw_trace_take_rebuilt(f->trace, true, &err), &err);
}

/* What an update has moved or hidden: out of the flattened set, into the instances. */
static void expect_movers(bool animated, enum when when) {
    struct fixture f;
    struct lw_scene *scene = lw_support_squares(3, 1);
    if (animated) animate(scene);
    start(&f, scene);
    f.pose.object_dynamic[1] = true;
    f.pose.object_to_world[1].m[1][3] = 4;
    take_pose(&f, when);
    struct lw_hit16 hit = shoot(&f, LW_TRACE_LIGHT, lw_vec3(2.1f, 9, 0.2f), down);
    assert_int_equal(hit.object[3], 1);
    assert_float_equal(hit.t[3], 5, 1e-4);
    assert_int_equal(hit.back[3], 0);
    assert_int_equal(shoot(&f, LW_TRACE_LIGHT, lw_vec3(2.1f, 2, 0.2f), down).object[3], LW_TRACE_MISS);
    assert_int_equal(shoot(&f, LW_TRACE_LIGHT, lw_vec3(4.1f, 9, 0.2f), down).object[3], 2);

    f.pose.object_hidden[1] = f.pose.object_hidden[2] = f.pose.object_dynamic[2] = true;
    take_pose(&f, when);
    assert_int_equal(shoot(&f, LW_TRACE_LIGHT, lw_vec3(2.1f, 9, 0.2f), down).object[3], LW_TRACE_MISS);
    assert_int_equal(shoot(&f, LW_TRACE_VIEW, lw_vec3(4.1f, 9, 0.2f), down).object[3], LW_TRACE_MISS);
    assert_int_equal(shoot(&f, LW_TRACE_LIGHT, lw_vec3(0.1f, 9, 0.2f), down).object[3], 0);

    f.pose.object_hidden[1] = f.pose.object_hidden[2] = false;
    take_pose(&f, when);
    assert_float_equal(shoot(&f, LW_TRACE_LIGHT, lw_vec3(2.1f, 9, 0.2f), down).t[3], 5, 1e-4);
    assert_int_equal(shoot(&f, LW_TRACE_VIEW, lw_vec3(4.1f, 9, 0.2f), down).object[3], 2);

    for (int o = 0; o < 3; o++) f.pose.object_dynamic[o] = f.pose.object_hidden[o] = true;
    take_pose(&f, when); /* nothing is left to meet */
    for (int o = 0; o < 3; o++)
        assert_int_equal(shoot(&f, LW_TRACE_LIGHT, lw_vec3(2 * (float)o + 0.1f, 9, 0.2f), down).object[3],
                         LW_TRACE_MISS);
    stop(&f);
}

static void test_still_objects_become_movers(void **state) {
    (void)state;
    for (int animated = 0; animated < 2; animated++)
        for (enum when when = AT_ONCE; when <= LATER; when++) expect_movers(animated, when);
}

static void test_hidden_from_the_beginning(void **state) {
    (void)state;
    struct fixture f;
    struct lw_error err = {0};
    start(&f, lw_support_squares(2, 1));
    lw_trace_destroy(f.trace);
    f.pose.object_dynamic[0] = f.pose.object_hidden[0] = true;
    lw_support_ok(lw_trace_create(f.scene, &f.pose, &f.trace, &err), &err);
    assert_int_equal(shoot(&f, LW_TRACE_LIGHT, lw_vec3(0.1f, 9, 0.2f), down).object[3], LW_TRACE_MISS);
    assert_int_equal(shoot(&f, LW_TRACE_LIGHT, lw_vec3(2.1f, 9, 0.2f), down).object[3], 1);
    stop(&f);
}

static float between(uint32_t *state, float low, float high) {
    return low + (high - low) * lw_random_unit(lw_random_hash2(77, (*state)++));
}

static struct lw_vec3 point_between(uint32_t *state, float low, float high) {
    const float x = between(state, low, high), y = between(state, low, high);
    return lw_vec3(x, y, between(state, low, high));
}

/* Turned, stretched, now and then mirrored. */
static struct lw_affine random_place(uint32_t *state) {
    struct lw_vec3 x, y, z = lw_vec3_normalize(point_between(state, -1, 1)), at = point_between(state, -4, 4);
    lw_vec3_frame(z, &x, &y);
    const float size = between(state, 0.2f, 2), flip = between(state, -1, 1) < -0.5f ? -size : size;
    return (struct lw_affine){{{flip * x.x, size * y.x, size * z.x, at.x},
                               {flip * x.y, size * y.y, size * z.y, at.y},
                               {flip * x.z, size * y.z, size * z.z, at.z}}};
}

/* A packet of rays from one place in similar directions, or of rays of all kinds. */
static void random_packet(uint32_t *state, bool coherent, struct lw_ray16 *rays) {
    const struct lw_vec3 from = point_between(state, -6, 6), along = point_between(state, -1, 1);
    for (uint32_t i = 0; i < LW_TRACE_WIDTH; i++) {
        struct lw_vec3 dir = lw_vec3_mad(along, point_between(state, -1, 1), coherent ? 0.1f : 1);
        if (i == 5) dir.x = 0; /* parallel to a side of every box */
        if (i == 6) dir = lw_vec3(0, 0, -1);
        lw_trace_set_ray(rays, i, coherent ? from : point_between(state, -6, 6), dir,
                         i % 4 == 3 ? between(state, 0, 9) : INFINITY);
    }
    rays->salt = 0;
}

/* Rays hit moving objects as in a static structure that is built for each pose. */
static void test_movers_are_met_as_in_a_flat_scene(void **state) {
    (void)state;
    const uint32_t objects[] = {1, 2, 9, 40};
    uint32_t r = 1;
    for (int n = 0; n < 4; n++) {
        struct fixture f;
        struct lw_error err = {0};
        struct lw_scene *scene = lw_support_squares(objects[n], 4);
        scene->material[0].double_sided = n & 1;
        f.scene = scene;
        lw_support_ok(lw_pose_init(&f.pose, scene), NULL);
        for (uint32_t o = 0; o < objects[n]; o++) f.pose.node_moves[scene->object[o].node] = o % 3 != 2;
        lw_support_ok(lw_trace_create(scene, &f.pose, &f.trace, &err), &err);
        unsigned hits = 0, apart = 0;
        for (int pose = 0; pose < 20; pose++) {
            for (uint32_t o = 0; o < objects[n]; o++)
                if (o % 3 != 2) f.pose.object_to_world[o] = random_place(&r);
            lw_support_ok(lw_trace_set_pose(f.trace, &f.pose, &err), &err);
            bool *node_moves = f.pose.node_moves, none[64] = {false};
            struct lw_trace *flat;
            f.pose.node_moves = none;
            lw_support_ok(lw_trace_create(scene, &f.pose, &flat, &err), &err);
            f.pose.node_moves = node_moves;
            for (int packet = 0; packet < 200; packet++) {
                struct lw_ray16 rays;
                struct lw_hit16 here, there;
                const bool coherent = packet & 1;
                const unsigned flags =
                    (packet & 2 ? LW_TRACE_VIEW : LW_TRACE_LIGHT) | (coherent ? LW_TRACE_COHERENT : 0u);
                const uint16_t active = packet & 4 ? 0xffff : 0x5b71;
                random_packet(&r, coherent, &rays);
                lw_trace_closest16(f.trace, flags, active, &rays, &here);
                lw_trace_closest16(flat, flags, active, &rays, &there);
                const uint16_t occluded = lw_trace_occluded16(f.trace, flags, active, &rays);
                const uint16_t shadowed = lw_trace_occluded16(flat, flags, active, &rays);
                apart += (unsigned)__builtin_popcount(occluded ^ shadowed);
                for (int i = 0; i < LW_TRACE_WIDTH; i++) {
                    const bool same = here.object[i] == there.object[i];
                    hits += here.object[i] != LW_TRACE_MISS;
                    apart += !same;
                    if (!same || here.object[i] == LW_TRACE_MISS) continue;
                    assert_float_equal(here.t[i], there.t[i], 1e-4f * (1 + there.t[i]));
                    assert_int_equal(here.back[i], there.back[i]);
                }
            }
            lw_trace_destroy(flat);
        }
        assert_true(hits > 300);
        assert_true(apart * 2000 <= hits); /* rays that graze an edge */
        stop(&f);
    }
}

/* What lw_trace_through16() finds, by closest hits. */
static void step(const struct lw_trace *trace, uint16_t active, struct lw_ray16 rays, const float gap[16],
                 struct lw_trace_through out[16]) {
    struct lw_hit16 hits;
    for (int i = 0; i < LW_TRACE_WIDTH; i++) out[i].count = 0;
    for (uint32_t k = 0; k < LW_TRACE_THROUGH_MAX; k++) {
        lw_trace_closest16(trace, LW_TRACE_LIGHT, active, &rays, &hits);
        for (int i = 0; i < LW_TRACE_WIDTH; i++) {
            if (hits.object[i] == LW_TRACE_MISS) active &= (uint16_t) ~(1u << i);
            if (!(active >> i & 1)) continue;
            out[i].met[out[i].count++] =
                (struct lw_trace_met){hits.t[i], hits.object[i], hits.triangle[i], hits.back[i] != 0};
            rays.t_near[i] = hits.t[i] + gap[i];
        }
    }
}

/* Some squares move, some lie back to back or let rays pass, and some lie in a pile that no list of hits
 * holds. */
static void test_rays_meet_the_same_at_once_as_step_by_step(void **state) {
    (void)state;
    enum { HEAP = 60, PILE = 40 };
    uint32_t r = 1;
    for (int n = 0; n < 6; n++) {
        struct fixture f;
        struct lw_error err = {0};
        struct lw_scene *scene = lw_support_squares(HEAP + PILE, 4);
        scene->material[0].double_sided = n & 1;
        if (n & 2) scene->material[0].alpha_mode = LW_ALPHA_BLEND, scene->material[0].base_colour[3] = 0.5f;
        f.scene = scene;
        lw_support_ok(lw_pose_init(&f.pose, scene), NULL);
        for (uint32_t o = 0; o < HEAP; o++) {
            f.pose.node_moves[scene->object[o].node] = n > 3 && o % 4 < 2;
            struct lw_affine *place = &f.pose.object_to_world[o];
            *place = random_place(&r);
            if (o % 2 == 0 || n & 2) continue;
            *place = place[-1]; /* turned over, in the place of the one before */
            for (int row = 0; row < 3; row++) place->m[row][1] *= -1, place->m[row][2] *= -1;
        }
        for (uint32_t o = HEAP; o < HEAP + PILE; o++)
            f.pose.object_to_world[o] =
                (struct lw_affine){{{9, 0, 0, 0}, {0, 9, 0, 20 + 0.1f * (float)o}, {0, 0, 9, 0}}};
        lw_support_ok(lw_trace_create(scene, &f.pose, &f.trace, &err), &err);
        uint32_t met = 0, apart = 0, many = 0;
        for (int packet = 0; packet < 400; packet++) {
            struct lw_ray16 rays;
            struct lw_trace_through here[LW_TRACE_WIDTH], there[LW_TRACE_WIDTH];
            const uint16_t active = packet & 4 ? 0xffff : 0x5b71;
            float gap[LW_TRACE_WIDTH];
            random_packet(&r, packet & 1, &rays);
            for (int i = 0; i < LW_TRACE_WIDTH; i++) gap[i] = i % 4 ? 1e-4f : 0.7f;
            lw_trace_through16(f.trace, active, &rays, gap, here);
            step(f.trace, active, rays, gap, there);
            for (int i = 0; i < LW_TRACE_WIDTH; i++) {
                if (!(active >> i & 1)) continue;
                bool same = here[i].count == there[i].count;
                for (uint32_t k = 0; same && k < here[i].count; k++)
                    same = here[i].met[k].t == there[i].met[k].t &&
                           (n & 1 || here[i].met[k].back == there[i].met[k].back); /* else it is chance */
                apart += !same;
                met += there[i].count;
                many += there[i].count == LW_TRACE_THROUGH_MAX;
            }
        }
        assert_true(met > 3000 && many > 30);
        assert_true(apart * 1000 <= met); /* rays that graze an edge, or meet two squares at one distance */
        stop(&f);
    }
}

/* Packets in which some rays meet a back first: the view sees the surface behind it, and the other rays are
 * left alone. */
static void test_views_look_through_backs(void **state) {
    (void)state;
    for (int moving = 0; moving < 4; moving++) { /* bit o: square o */
        struct fixture f;
        struct lw_error err = {0};
        f.scene = lw_support_squares(2, 1);
        lw_support_ok(lw_pose_init(&f.pose, f.scene), NULL);
        f.pose.node_moves[f.scene->object[0].node] = moving & 1;
        f.pose.node_moves[f.scene->object[1].node] = moving & 2;
        /* square 0 looks down, at a height of 1; square 1 below it looks up and is larger */
        f.pose.object_to_world[0] = (struct lw_affine){{{1, 0, 0, 0}, {0, -1, 0, 1}, {0, 0, -1, 0}}};
        f.pose.object_to_world[1] = (struct lw_affine){{{4, 0, 0, 0}, {0, 4, 0, 0}, {0, 0, 4, 0}}};
        lw_support_ok(lw_trace_create(f.scene, &f.pose, &f.trace, &err), &err);
        struct lw_ray16 rays = {.salt = 0};
        struct lw_hit16 hits;
        for (uint32_t i = 0; i < LW_TRACE_WIDTH; i++)
            lw_trace_set_ray(&rays, i, lw_vec3(-1.9f + 0.25f * (float)i, 3, 0.1f), down,
                             i == 8 ? 2.5f : INFINITY);
        lw_trace_closest16(f.trace, LW_TRACE_VIEW | LW_TRACE_COHERENT, 0x7fff, &rays, &hits);
        for (int i = 0; i < LW_TRACE_WIDTH; i++) {
            const bool ends = i == 8 || i == 15; /* between the two; not active */
            assert_int_equal(hits.object[i], ends ? LW_TRACE_MISS : 1);
            assert_int_equal(hits.back[i], 0);
            if (!ends) assert_float_equal(hits.t[i], 3, 1e-5);
        }
        lw_trace_closest16(f.trace, LW_TRACE_LIGHT | LW_TRACE_COHERENT, 0x7fff, &rays, &hits);
        assert_int_equal(hits.object[7], 0); /* light does not */
        assert_int_equal(hits.back[7], 1);
        stop(&f);
    }
}

/* Lanes that are not active may hold anything; whatever it is, they are misses, and the others meet what they
 * meet alone. */
static void test_lanes_that_are_not_active_meet_nothing(void **state) {
    (void)state;
    for (int moving = 0; moving < 2; moving++) {
        struct fixture f;
        struct lw_error err = {0};
        f.scene = lw_support_squares(2, 1);
        lw_support_ok(lw_pose_init(&f.pose, f.scene), NULL);
        f.pose.node_moves[f.scene->object[1].node] = moving;
        /* square 0 runs through the origin, upright; square 1 lies across it, seen from below */
        f.pose.object_to_world[0] = (struct lw_affine){{{2, 0, 0, 0}, {0, 0, 2, 0}, {0, -2, 0, 0}}};
        f.pose.object_to_world[1] = (struct lw_affine){{{3, 0, 0, 0}, {0, -3, 0, 0.25f}, {0, 0, -3, 0}}};
        lw_support_ok(lw_trace_create(f.scene, &f.pose, &f.trace, &err), &err);
        uint32_t r = 1;
        for (unsigned packet = 0; packet < 400; packet++) {
            const unsigned flags = packet & 3; /* light and view, coherent or not */
            const uint16_t active = (uint16_t)lw_random_hash2(3, packet);
            struct lw_ray16 rays;
            struct lw_hit16 hits, one;
            random_packet(&r, flags & LW_TRACE_COHERENT, &rays);
            for (uint32_t i = 0; i < LW_TRACE_WIDTH; i++) {
                if (active >> i & 1 || packet % 5 == 0) continue;
                const float bad = packet % 5 == 1   ? 0
                                  : packet % 5 == 2 ? NAN
                                  : packet % 5 == 3 ? -1
                                                    : INFINITY;
                lw_trace_set_ray(&rays, i, lw_vec3(bad, bad, bad), lw_vec3(bad, bad, bad), bad);
                rays.t_near[i] = bad;
            }
            lw_trace_closest16(f.trace, flags, active, &rays, &hits);
            const uint16_t occluded = lw_trace_occluded16(f.trace, flags, active, &rays);
            assert_int_equal(occluded & ~active, 0);
            for (int i = 0; i < LW_TRACE_WIDTH; i++) {
                if (!(active >> i & 1)) {
                    assert_int_equal(hits.object[i], LW_TRACE_MISS);
                    assert_int_equal(hits.back[i], 0);
                    continue;
                }
                assert_int_equal(occluded >> i & 1, hits.object[i] != LW_TRACE_MISS);
                lw_trace_closest16(f.trace, flags, (uint16_t)(1u << i), &rays, &one);
                assert_int_equal(hits.object[i], one.object[i]);
                assert_int_equal(hits.back[i], one.back[i]);
            }
        }
        stop(&f);
    }
}

static void test_the_environment_chooses_the_instruction_set(void **state) {
    (void)state;
    static const char *const set[] = {"sse4.2", "avx2", "avx512"};
    const char *given = getenv("LW_TRACE_ISA");
    char *before = given ? strdup(given) : NULL;
    struct fixture f;
    unsigned opened = 0;
    start(&f, lw_support_squares(1, 1));
    if (before && *before) assert_string_equal(lw_trace_isa(f.trace), before);
    for (size_t i = 0; i < sizeof set / sizeof *set; i++) {
        struct lw_error err = {0};
        struct lw_trace *trace;
        setenv("LW_TRACE_ISA", set[i], 1);
        const enum lw_status status = lw_trace_create(f.scene, &f.pose, &trace, &err);
        if (status == LW_UNAVAILABLE) {
            print_message("%s\n", err.text);
            assert_non_null(strstr(err.text, "this processor lacks"));
            assert_non_null(strstr(err.text, set[i]));
            continue;
        }
        lw_support_ok(status, &err);
        assert_string_equal(lw_trace_isa(trace), set[i]);
        lw_trace_destroy(trace);
        opened++;
    }
#ifdef __x86_64__
    assert_true(opened > 0 || !__builtin_cpu_supports("sse4.2"));
#endif
    static const char *const unknown[] = {"avx", "AVX2", "avx512 ", "avx2,verbose=3"};
    for (size_t i = 0; i < sizeof unknown / sizeof *unknown; i++) {
        struct lw_error err = {0};
        struct lw_trace *trace;
        setenv("LW_TRACE_ISA", unknown[i], 1);
        assert_int_equal(lw_trace_create(f.scene, &f.pose, &trace, &err), LW_USAGE);
        assert_non_null(strstr(err.text, "LW_TRACE_ISA"));
        assert_non_null(strstr(err.text, unknown[i]));
    }
    if (before)
        setenv("LW_TRACE_ISA", before, 1);
    else
        unsetenv("LW_TRACE_ISA");
    free(before);
    stop(&f);
}

static void test_masked_surfaces_let_rays_pass(void **state) {
    (void)state;
    struct fixture f;
    struct lw_scene *scene = lw_support_squares(1, 1);
    scene->material[0].alpha_mode = LW_ALPHA_MASK;
    scene->material[0].base_colour[3] = 0.4f;
    start(&f, scene);
    for (unsigned flags = 0; flags < 2; flags++) {
        scene->material[0].alpha_cutoff = 0.5f;
        assert_int_equal(shoot(&f, flags, lw_vec3(0.1f, 3, 0.2f), down).object[3], LW_TRACE_MISS);
        scene->material[0].alpha_cutoff = 0.4f;
        assert_int_equal(shoot(&f, flags, lw_vec3(0.1f, 3, 0.2f), down).object[3], 0);
    }
    stop(&f);
}

static void test_blended_surfaces_stop_their_share_of_rays(void **state) {
    (void)state;
    struct fixture f;
    struct lw_scene *scene = lw_support_squares(1, 1);
    scene->material[0].alpha_mode = LW_ALPHA_BLEND;
    scene->material[0].base_colour[3] = 0.3f;
    start(&f, scene);
    const int count = 4000;
    int stopped = 0;
    for (int i = 0; i < count; i++) {
        struct lw_vec3 dir = lw_vec3(0.0001f * (float)i - 0.2f, -1, 0.05f);
        stopped += shoot(&f, LW_TRACE_LIGHT, lw_vec3(0, 1, 0), dir).object[3] == 0;
        assert_int_equal(shoot(&f, LW_TRACE_VIEW, lw_vec3(0, 1, 0), dir).object[3], 0);
    }
    /* four standard deviations of a binomial */
    assert_float_equal((float)stopped / (float)count, 0.3f, 4 * sqrtf(0.3f * 0.7f / (float)count));
    stop(&f);
}

/* Each of sixteen rays passes as many panes as there are below it, of which one moves: its tint is a power,
 * whatever the packet. */
static void test_tints_colour_what_passes(void **state) {
    (void)state;
    for (int animated = 0; animated < 2; animated++) {
        struct fixture f;
        struct lw_scene *scene = lw_support_squares(3, 2);
        for (uint32_t i = 0; i < 3; i++) { /* from 1 to 3 of them over one another, side by side */
            scene->node[i].translation[0] = 0.5f * (float)i;
            scene->node[i].translation[1] = (float)i;
        }
        struct lw_material *m = &scene->material[0];
        m->alpha_mode = LW_ALPHA_BLEND;
        m->base_colour[3] = 0;
        const float tint[3] = {2, 0.75f, 0.5f};
        memcpy(m->tint, tint, sizeof tint);
        if (animated) animate(scene);
        start(&f, scene);
        assert_true(lw_trace_tints(f.trace));
        for (unsigned packet = 0; packet < 64; packet++) {
            struct lw_ray16 rays = {.salt = packet};
            float got[3][16];
            const uint16_t active = (uint16_t)(packet < 16 ? 1u << packet : 0x9e37u * packet | 1u);
            const unsigned flags = packet & 1 ? LW_TRACE_COHERENT : LW_TRACE_LIGHT;
            float x[16];
            for (uint32_t i = 0; i < 16; i++) {
                x[i] = -0.8f + 0.17f * (float)((i * 7 + packet) % 16);
                lw_trace_set_ray(&rays, i, lw_vec3(x[i], -2, 0.13f), up, INFINITY);
            }
            assert_int_equal(lw_trace_tinted16(f.trace, flags, active, &rays, got), 0);
            for (uint32_t i = 0; i < 16; i++) {
                unsigned panes = 0;
                for (uint32_t o = 0; o < 3; o++) panes += fabsf(x[i] - 0.5f * (float)o) < 1;
                if (!(active >> i & 1u)) panes = 0;
                for (int c = 0; c < 3; c++) assert_float_equal(got[c][i], powf(tint[c], (float)panes), 1e-5f);
            }
        }
        stop(&f);
    }
}

int main(void) {
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(test_front_and_back),
        cmocka_unit_test(test_mirrored_objects_keep_their_front),
        cmocka_unit_test(test_moving_objects_follow_the_pose),
        cmocka_unit_test(test_still_objects_become_movers),
        cmocka_unit_test(test_hidden_from_the_beginning),
        cmocka_unit_test(test_movers_are_met_as_in_a_flat_scene),
        cmocka_unit_test(test_rays_meet_the_same_at_once_as_step_by_step),
        cmocka_unit_test(test_views_look_through_backs),
        cmocka_unit_test(test_lanes_that_are_not_active_meet_nothing),
        cmocka_unit_test(test_the_environment_chooses_the_instruction_set),
        cmocka_unit_test(test_masked_surfaces_let_rays_pass),
        cmocka_unit_test(test_blended_surfaces_stop_their_share_of_rays),
        cmocka_unit_test(test_tints_colour_what_passes),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
