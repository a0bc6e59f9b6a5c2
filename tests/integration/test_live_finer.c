/* Finer levels of liblightwell, on a real lightwelld: what a view and what a list of an engine's own bring,
 * how the texels of slots fit the rest, and what a server without them means. */
#include "tests/integration/live_case.h"

#include "client/lib/live_state.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>

#define SCENE                                                                                                \
    "builtin:cornell --texels-per-metre 20 --bounces 0 --frame-rate 100 --error 0.01 --light seen "          \
    "--client-lights none "
#define BY_HAND                                                                                              \
    "builtin:cornell --texels-per-metre 20 --bounces 0 --error 0.01 --light seen --client-lights none"
#define SLOTS 128u
#define SIDE  (LW_LIVE_TILE_SIDE + 1)

static bool has_light(void) {
    const struct lw_live_stats s = stats();
    return s.has_light && s.settled_frame;
}

static void open_live(uint16_t port, uint32_t flags, uint32_t slots) {
    open_with(&(struct lw_live_desc){.struct_size = sizeof(struct lw_live_desc),
                                     .port = port,
                                     .flags = flags,
                                     .name = "test_live_finer",
                                     .finer_slots = slots});
}

static struct lw_live_finer finer(void) {
    struct lw_live_finer f = {.struct_size = sizeof f};
    ok(lw_live_get_finer(live, &f, &err));
    return f;
}

static uint32_t the_floor(void) { return lw_live_find(live, LW_LIVE_KIND_OBJECT, "floor", 0); }

/* The view of the scene's first camera. */
static struct lw_live_view first_view(uint32_t width, uint32_t height) {
    struct lw_live_camera c = {.struct_size = sizeof c};
    ok(lw_live_get_camera(live, 0, &c, &err));
    return view_of(&c, width, height);
}

/* ---- an engine's pool ---- */

static struct pool {
    struct lw_live_slot slot[SLOTS]; /* share 0: free */
    float rgb[SLOTS][3 * SIDE * SIDE];
    uint64_t now_ns; /* the engine's clock */
    uint32_t filled, gone;
} pool;

static void take_slots(uint64_t step_ns) {
    static struct lw_live_slot entry[2 * SLOTS];
    pool.now_ns += step_ns;
    const size_t count = lw_live_take_slots(live, pool.now_ns, 0, entry, 2 * SLOTS);
    for (size_t i = 0; i < count; i++) {
        const struct lw_live_slot *s = &entry[i];
        assert_true(s->slot < SLOTS && s->share >= 0 && s->share <= 1);
        struct lw_live_pages pages = {.struct_size = sizeof pages};
        ok(lw_live_get_pages(live, s->rect.object, s->rect.level, &pages, &err));
        assert_int_equal(s->page, pages.first + s->rect.y / LW_LIVE_TILE_SIDE * pages.columns +
                                      s->rect.x / LW_LIVE_TILE_SIDE);
        pool.gone += !s->has_texels && s->share == 0;
        pool.slot[s->slot] = *s;
        if (!s->has_texels) continue;
        struct lw_live_texels to = {.struct_size = sizeof to,
                                    .format = LW_LIVE_RGB32F,
                                    .dst = pool.rgb[s->slot],
                                    .dst_size = sizeof pool.rgb[s->slot],
                                    .row_size = SIDE * 3 * sizeof(float)};
        ok(lw_live_read(live, &s->rect, &to, &err));
        pool.filled++;
    }
}

static uint32_t count_whole(void) {
    uint32_t count = 0;
    for (uint32_t i = 0; i < SLOTS; i++) count += pool.slot[i].share == 1;
    return count;
}

/* As an engine draws: until this number of tiles is shown whole, and nothing waits. */
static void draw_until(const struct lw_live_view *view, uint32_t tiles) {
    for (const uint64_t end_ns = lw_clock_ns() + LIMIT_NS;
         count_whole() < tiles || finer().slots_waiting || !has_light();) {
        assert_true(lw_clock_ns() < end_ns);
        if (view) ok(lw_live_want_views(live, view, 1, &err));
        ok(lw_live_poll(live, 5, &err));
        take_slots(20000000);
    }
}

static int begin(void **state) {
    (void)state;
    memset(&pool, 0, sizeof pool);
    pool.now_ns = 1000000000;
    return 0;
}

/* ---- tests ---- */

/* A view brings tiles of several finer levels. Each slot has the texels of its tile, and beside these the
 * ones that the next tile's slot begins with. Wanted no more, all of them go. */
static void test_a_view_fills_the_pool(void **state) {
    (void)state;
    struct lw_process daemon;
    lw_process_serve(&daemon, SCENE);
    open_live(daemon.port, 0, SLOTS);
    const struct lw_live_finer has = finer();
    assert_int_equal(has.level_count, 4);
    assert_int_equal(has.slot_count, SLOTS);
    assert_true(has.page_count > 100);
    assert_int_equal(has.slots_used, 0);
    const struct lw_live_view view = first_view(1280, 720);
    draw_until(&view, 6);
    print_message("%u of %u slots used, filled %u times\n", finer().slots_used, SLOTS, pool.filled);
    uint32_t beside = 0;
    for (uint32_t i = 0; i < SLOTS; i++) {
        const struct lw_live_slot *a = &pool.slot[i];
        if (a->share == 0) continue;
        struct lw_live_rect level;
        ok(lw_live_get_level(live, a->rect.object, a->rect.level, &level, &err));
        assert_true(a->rect.x + a->rect.width <= level.width && a->rect.y + a->rect.height <= level.height);
        const lw_tile_id id = lw_atlas_map_find(live->tiles.map, a->rect.object, a->rect.level,
                                                a->rect.x / LW_TILE_SIDE, a->rect.y / LW_TILE_SIDE);
        const struct lw_client_tile tile = lw_client_get_tile(live->client, id);
        const uint32_t width = live->tiles.map->place[id.v].width;
        assert_memory_equal(pool.rgb[i], tile.rgb, width * 3 * sizeof(float)); /* its first row */
        for (uint32_t j = 0; j < SLOTS; j++) {
            const struct lw_live_slot *b = &pool.slot[j];
            if (b->share == 0 || b->rect.object != a->rect.object || b->rect.level != a->rect.level ||
                b->rect.y != a->rect.y || b->rect.x != a->rect.x + LW_LIVE_TILE_SIDE)
                continue;
            for (uint32_t y = 0; y < a->rect.height; y++)
                assert_memory_equal(&pool.rgb[i][3 * (y * SIDE + LW_LIVE_TILE_SIDE)],
                                    &pool.rgb[j][3 * y * SIDE], 3 * sizeof(float));
            beside++;
        }
    }
    assert_true(beside > 0);
    ok(lw_live_want_views(live, NULL, 0, &err));
    for (const uint64_t end_ns = lw_clock_ns() + LIMIT_NS; finer().slots_used;) {
        assert_true(lw_clock_ns() < end_ns);
        ok(lw_live_poll(live, 5, &err));
        take_slots(20000000);
    }
    assert_true(pool.gone > 0);
    for (uint32_t i = 0; i < SLOTS; i++) assert_true(pool.slot[i].share == 0);
}

/* ---- lists of an engine's own ---- */

static struct lw_live_rect tile_at(uint32_t object, uint32_t level, uint32_t x, uint32_t y) {
    struct lw_live_rect rect = {.object = object, .level = level}, whole;
    ok(lw_live_get_level(live, object, level, &whole, &err));
    rect.x = x * LW_LIVE_TILE_SIDE;
    rect.y = y * LW_LIVE_TILE_SIDE;
    rect.width = whole.width - rect.x < LW_LIVE_TILE_SIDE ? whole.width - rect.x : LW_LIVE_TILE_SIDE;
    rect.height = whole.height - rect.y < LW_LIVE_TILE_SIDE ? whole.height - rect.y : LW_LIVE_TILE_SIDE;
    return rect;
}

static double mean_of(const struct lw_live_rect *rect) {
    static float rgb[3 * LW_LIVE_TILE_SIDE * LW_LIVE_TILE_SIDE];
    struct lw_live_texels to = {
        .struct_size = sizeof to, .format = LW_LIVE_RGB32F, .dst = rgb, .dst_size = sizeof rgb};
    double sum = 0;
    ok(lw_live_read(live, rect, &to, &err));
    for (uint32_t i = 0; i < 3 * rect->width * rect->height; i++) sum += (double)rgb[i];
    return sum / (3.0 * rect->width * rect->height);
}

/* What a list names comes, and nothing else; where it has not come, level 0 is read, interpolated. With a
 * thread of the library's own as without, and where texels are read as they came. */
static void test_a_list_of_our_own(void **state) {
    (void)state;
    struct lw_process daemon;
    lw_process_serve(&daemon, SCENE);
    const uint32_t flags[] = {0, LW_LIVE_THREAD, LW_LIVE_AS_IT_IS};
    for (size_t f = 0; f < sizeof flags / sizeof *flags; f++) {
        begin(NULL);
        open_live(daemon.port, flags[f], SLOTS);
        const uint32_t object = the_floor();
        struct lw_live_rect wanted[2] = {tile_at(object, LW_LIVE_FINER + 2, 1, 0),
                                         tile_at(object, LW_LIVE_FINER + 1, 0, 0)};
        ok(lw_live_want_rects(live, wanted, 2, &err));
        struct lw_live_rect below = {
            .object = object, .level = 0, .x = wanted[0].x / 4, .y = wanted[0].y / 4};
        below.width = wanted[0].width / 4, below.height = wanted[0].height / 4;
        const double coarse = mean_of(&below), stand_in = mean_of(&wanted[0]);
        assert_true(coarse > 0 && fabs(stand_in - coarse) < 0.1 * coarse);
        draw_until(NULL, 2);
        assert_int_equal(finer().slots_used, 2);
        assert_true(fabs(mean_of(&wanted[0]) - coarse) < 0.3 * coarse);
        assert_true(mean_of(&wanted[0]) != stand_in);
        struct lw_live_rect dirty[64];
        size_t count;
        while ((count = lw_live_take_dirty(live, LW_LIVE_NONE, LW_LIVE_NONE, 0, dirty, 64)) > 0)
            for (size_t i = 0; i < count; i++) assert_true(dirty[i].level < LW_LIVE_FINER);
        ok(lw_live_want_rects(live, wanted, 1, &err)); /* the second one goes */
        for (const uint64_t end_ns = lw_clock_ns() + LIMIT_NS; finer().slots_used > 1;) {
            assert_true(lw_clock_ns() < end_ns);
            ok(lw_live_want_rects(live, wanted, 1, &err));
            ok(lw_live_poll(live, 5, &err));
            take_slots(20000000);
        }
        assert_true(pool.gone == 1 && count_whole() == 1);
        lw_live_want_everything(live); /* no finer ones among them */
        for (const uint64_t end_ns = lw_clock_ns() + LIMIT_NS; finer().slots_used;) {
            assert_true(lw_clock_ns() < end_ns);
            ok(lw_live_poll(live, 5, &err));
            take_slots(20000000);
        }
        lw_live_close(live);
        live = NULL;
    }
}

/* An error names the wrong part of a list in one line. The former list stays. */
static void test_wrong_lists(void **state) {
    (void)state;
    struct lw_process daemon;
    lw_process_serve(&daemon, SCENE);
    open_live(daemon.port, 0, 3);
    struct lw_live_rect rect = {.level = LW_LIVE_FINER + 3, .width = 256, .height = 64}, level;
    struct lw_live_pages pages = {.struct_size = sizeof pages};
    struct lw_live_finer has = {.struct_size = 1};
    const uint32_t object = rect.object = the_floor();
    struct lw_live_rect good[2] = {tile_at(object, LW_LIVE_FINER + 1, 0, 0),
                                   tile_at(object, LW_LIVE_FINER + 1, 1, 0)};
    ok(lw_live_want_rects(live, good, 2, &err));
    const uint32_t listed = live->interest.finer_max;
    assert_int_equal(listed, 3);
    fails(lw_live_want_rects(live, &rect, 1, &err), LW_LIVE_USAGE,
          "4 tiles of finer levels: lw_live_desc.finer_slots is 3");
    rect.width = 1u << 30;
    fails(lw_live_want_rects(live, &rect, 1, &err), LW_LIVE_USAGE, "do not lie within");
    rect = (struct lw_live_rect){.object = object, .level = LW_LIVE_FINER + 5, .width = 1, .height = 1};
    fails(lw_live_want_rects(live, &rect, 1, &err), LW_LIVE_UNAVAILABLE, "has 4 finer levels");
    fails(lw_live_get_level(live, object, LW_LIVE_FINER + 5, &level, &err), LW_LIVE_UNAVAILABLE, "level 69");
    fails(lw_live_get_level(live, object, LW_LIVE_FINER, &level, &err), LW_LIVE_USAGE, "level 64 of");
    rect.object = 1000;
    fails(lw_live_want_rects(live, &rect, 1, &err), LW_LIVE_USAGE, "object 1000");
    fails(lw_live_get_pages(live, object, 0, &pages, &err), LW_LIVE_USAGE, "level 0 has no pages");
    fails(lw_live_get_pages(live, 1000, LW_LIVE_FINER + 1, &pages, &err), LW_LIVE_USAGE, "object 1000");
    fails(lw_live_get_pages(NULL, 0, LW_LIVE_FINER + 1, &pages, &err), LW_LIVE_USAGE, "NULL");
    pages.struct_size = 1;
    fails(lw_live_get_pages(live, object, LW_LIVE_FINER + 1, &pages, &err), LW_LIVE_USAGE, "lw_live_pages");
    fails(lw_live_get_finer(live, &has, &err), LW_LIVE_USAGE, "lw_live_finer");
    fails(lw_live_get_finer(NULL, &has, &err), LW_LIVE_USAGE, "NULL");
    assert_int_equal(lw_live_take_slots(NULL, 0, 0, pool.slot, SLOTS), 0);
    assert_int_equal(lw_live_take_slots(live, 0, 0, NULL, 0), 0);
    draw_until(NULL, 2); /* the good list holds */
    /* views that show more than there are slots want fewer, coarser ones */
    const struct lw_live_view view = first_view(2560, 1440);
    draw_until(&view, 3);
    assert_int_equal(finer().slots_used, 3);
}

/* Without slots, and of a server that lights no finer levels, all is as it was. */
static void test_without_finer_levels(void **state) {
    (void)state;
    struct lw_process daemon, plain;
    struct lw_live_rect rect = {.level = LW_LIVE_FINER + 1, .width = 1, .height = 1};
    struct lw_live_desc desc = {.struct_size = sizeof desc, .port = 1, .finer_slots = LW_LIVE_SLOTS_MAX + 1};
    fails(lw_live_open(&desc, &live, &err), LW_LIVE_USAGE, "finer_slots is 1025: there may be 1024");
    desc.struct_size =
        offsetof(struct lw_live_desc, finer_slots); /* the former struct: finer_slots is not read */
    fails(lw_live_open(&desc, &live, &err), LW_LIVE_UNAVAILABLE, "127.0.0.1:1");
    lw_process_serve(&daemon, SCENE);
    open_live(daemon.port, 0, 0);
    rect.object = the_floor();
    assert_int_equal(finer().level_count, 0);
    assert_int_equal(finer().page_count, 0);
    assert_int_equal(live->tiles.map->tile_count, live->tiles.map->plain_count);
    fails(lw_live_want_rects(live, &rect, 1, &err), LW_LIVE_USAGE, "finer_slots is 0");
    fails(lw_live_get_level(live, rect.object, LW_LIVE_FINER + 1, &rect, &err), LW_LIVE_USAGE,
          "finer_slots is 0");
    assert_int_equal(lw_live_take_slots(live, 1, 0, pool.slot, SLOTS), 0);
    lw_live_close(live);
    lw_process_serve(&plain, SCENE "--detail 0");
    open_live(plain.port, 0, SLOTS);
    assert_int_equal(finer().level_count, 0);
    assert_int_equal(finer().slot_count, SLOTS);
    fails(lw_live_want_rects(live, &rect, 1, &err), LW_LIVE_UNAVAILABLE, "the server has 0 finer levels");
    const struct lw_live_view view = first_view(1280, 720);
    ok(lw_live_want_views(live, &view, 1, &err));
    ok(lw_live_poll(live, 5, &err));
    assert_int_equal(lw_live_take_slots(live, 1, 0, pool.slot, SLOTS), 0);
}

/* ---- the same bytes ---- */

static float *read_all(size_t *out_count) {
    size_t count = 0, capacity = 1u << 22;
    float *rgb = malloc(capacity * sizeof *rgb);
    assert_non_null(rgb);
    for (uint32_t o = 0; o < live->scene->object_count; o++)
        for (uint32_t l = 0; l < live->tiles.map->atlas[o]->level_count; l++) {
            struct lw_live_rect level;
            ok(lw_live_get_level(live, o, l, &level, &err));
            struct lw_live_texels to = {.struct_size = sizeof to,
                                        .format = LW_LIVE_RGB32F,
                                        .dst = rgb + count,
                                        .dst_size = (capacity - count) * sizeof *rgb};
            ok(lw_live_read(live, &level, &to, &err));
            count += 3ul * level.width * level.height;
        }
    *out_count = count;
    return rgb;
}

/* All base levels, and with finer levels one tile of these. */
static void want_all(bool with) {
    struct lw_live_rect wanted[128];
    size_t rects = 0;
    for (uint32_t o = 0; o < live->scene->object_count; o++)
        for (uint32_t l = 0; l < live->tiles.map->atlas[o]->level_count; l++) {
            assert_true(rects + 1 < sizeof wanted / sizeof *wanted);
            ok(lw_live_get_level(live, o, l, &wanted[rects++], &err));
        }
    if (with) wanted[rects++] = tile_at(the_floor(), LW_LIVE_FINER + 2, 1, 0);
    ok(lw_live_want_rects(live, wanted, rects, &err));
}

/* Two sessions get the same frames. The one that reads finer levels has the same texels of base levels. */
static void test_other_levels_stay_the_same(void **state) {
    (void)state;
    struct lw_process daemon;
    struct lw_live *both[2];
    float *rgb[2];
    size_t count[2];
    uint64_t frames = 0;
    lw_process_serve_by_hand(&daemon, BY_HAND);
    lw_process_step(&daemon, 1);
    for (int with = 0; with < 2; with++) {
        open_live(daemon.port, 0, with ? SLOTS : 0);
        want_all(with);
        both[with] = live;
    }
    for (const uint64_t end_ns = lw_clock_ns() + LIMIT_NS; !count_whole();) {
        lw_process_step(&daemon, 1);
        frames++;
        for (int with = 0; with < 2; with++)
            for (live = both[with]; stats().settled_frame < 1 + frames;) {
                assert_true(lw_clock_ns() < end_ns);
                ok(lw_live_poll(live, 20, &err));
            }
        take_slots(20000000);
    }
    for (int with = 0; with < 2; with++) {
        live = both[with];
        rgb[with] = read_all(&count[with]);
    }
    print_message("%llu frames, %zu values\n", (unsigned long long)frames, count[0]);
    assert_int_equal(count[0], count[1]);
    assert_true(count[0] > 1000);
    assert_memory_equal(rgb[0], rgb[1], count[0] * sizeof *rgb[0]);
    free(rgb[0]);
    free(rgb[1]);
    lw_live_close(both[0]);
}

/* A session that breaks: what there was of finer tiles goes, and comes again. */
static void test_comes_back(void **state) {
    (void)state;
    struct lw_process daemon;
    lw_process_serve(&daemon, SCENE);
    open_live(daemon.port, 0, SLOTS);
    struct lw_live_rect wanted = tile_at(the_floor(), LW_LIVE_FINER + 2, 1, 0);
    ok(lw_live_want_rects(live, &wanted, 1, &err));
    draw_until(NULL, 1);
    ok(lw_live_reconnect(live, &err));
    take_slots(20000000);
    take_slots(400000000);
    assert_int_equal(pool.gone, 1);
    assert_int_equal(count_whole(), 0);
    draw_until(NULL, 1);
    assert_int_equal(finer().level_count, 4);
}

int main(void) {
    const struct CMUnitTest tests[] = {
        cmocka_unit_test_setup_teardown(test_a_view_fills_the_pool, begin, end_all),
        cmocka_unit_test_setup_teardown(test_a_list_of_our_own, begin, end_all),
        cmocka_unit_test_setup_teardown(test_wrong_lists, begin, end_all),
        cmocka_unit_test_setup_teardown(test_without_finer_levels, begin, end_all),
        cmocka_unit_test_setup_teardown(test_other_levels_stay_the_same, begin, end_all),
        cmocka_unit_test_setup_teardown(test_comes_back, begin, end_all),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
