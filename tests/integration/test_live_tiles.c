/* The interface lightwell.h against the real daemon: light in textures, views, threads, and what a frame
 * costs. */
#include "tests/integration/live_daemon.h"

#include "client/lib/live_state.h"
#include "common/base/sanitizer.h"

#include <math.h>
#include <signal.h>
#include <stdio.h>
#include <stdlib.h>

/* ---- counting allocations: of all threads of this process, libraries' too ---- */

static atomic_bool is_counted;
static atomic_uint allocations;

#if !LW_SANITIZER
extern void *__libc_malloc(size_t size);
extern void *__libc_calloc(size_t count, size_t size);
extern void *__libc_realloc(void *old, size_t size);
extern void *__libc_memalign(size_t alignment, size_t size);
void *malloc(size_t size) {
    if (atomic_load(&is_counted)) atomic_fetch_add(&allocations, 1);
    return __libc_malloc(size);
}
void *calloc(size_t count, size_t size) {
    if (atomic_load(&is_counted)) atomic_fetch_add(&allocations, 1);
    return __libc_calloc(count, size);
}
void *realloc(void *old, size_t size) {
    if (atomic_load(&is_counted)) atomic_fetch_add(&allocations, 1);
    return __libc_realloc(old, size);
}
void *aligned_alloc(size_t alignment, size_t size) {
    if (atomic_load(&is_counted)) atomic_fetch_add(&allocations, 1);
    return __libc_memalign(alignment, size);
}
#endif

/* ---- light ---- */

/* All levels 0 to 2 of all objects, uploaded by dirty rectangles alone. */
struct textures {
    float *rgb;
    size_t *first; /* by object and level */
    size_t size;
};

static struct textures make_textures(void) {
    struct textures t = {.first = calloc(3 * live->scene->object_count, sizeof *t.first)};
    for (uint32_t o = 0; o < live->scene->object_count; o++)
        for (uint32_t l = 0; l < 3; l++) {
            struct lw_live_rect rect;
            t.first[3 * o + l] = t.size;
            if (lw_live_get_level(live, o, l, &rect, NULL) == LW_LIVE_OK)
                t.size += (size_t)rect.width * rect.height;
        }
    t.rgb = calloc(t.size + 1, 3 * sizeof *t.rgb);
    assert_non_null(t.rgb);
    return t;
}

static void read_into(const struct textures *t, const struct lw_live_rect *rect) {
    struct lw_live_rect level;
    ok(lw_live_get_level(live, rect->object, rect->level, &level, &err));
    const size_t at = t->first[3 * rect->object + rect->level] + (size_t)rect->y * level.width + rect->x;
    const size_t row = level.width * 3 * sizeof(float);
    struct lw_live_texels texels = {.struct_size = sizeof texels,
                                    .format = LW_LIVE_RGB32F,
                                    .dst = t->rgb + 3 * at,
                                    .dst_size = (rect->height - 1) * row + rect->width * 3 * sizeof(float),
                                    .row_size = row};
    ok(lw_live_read(live, rect, &texels, &err));
}

static size_t upload(const struct textures *t, uint64_t texels_max) {
    struct lw_live_rect rect[8];
    size_t count, texels = 0;
    while ((count = lw_live_take_dirty(live, LW_LIVE_NONE, LW_LIVE_NONE, texels_max, rect, 8)) > 0) {
        for (size_t i = 0; i < count; i++) {
            texels += (size_t)rect[i].width * rect[i].height;
            if (rect[i].level < 3) read_into(t, &rect[i]);
        }
        if (texels_max) break;
    }
    return texels;
}

/* The pieces that arrived are the light that is there. */
static void test_dirty_rectangles_are_all(void **state) {
    (void)state;
    struct lw_process daemon;
    serve_never_resting(&daemon, "");
    open_live(daemon.port, LW_LIVE_AS_IT_IS);
    struct textures t = make_textures(), all = make_textures();
    assert_true(stats().dirty_tiles > 0);
    bool ends = false;
    const uint64_t last = stats().frame + 12, end_ns = lw_clock_ns() + LIMIT_NS;
    for (;;) {
        upload(&t, 3 * LW_LIVE_TILE_SIDE * LW_LIVE_TILE_SIDE);
        if (lw_live_poll(live, 5, &err) != LW_LIVE_OK) break;
        assert_true(lw_clock_ns() < end_ns);
        if (!ends && stats().frame >= last) ends = kill(daemon.pid, SIGTERM) == 0;
    }
    assert_true(ends);
    assert_int_equal(err.status, LW_LIVE_CLOSED);
    assert_false(stats().is_connected);
    upload(&t, 0);
    assert_int_equal(stats().dirty_tiles, 0);
    double sum = 0;
    for (uint32_t o = 0; o < live->scene->object_count; o++)
        for (uint32_t l = 0; l < 3; l++) {
            struct lw_live_rect rect;
            if (lw_live_get_level(live, o, l, &rect, NULL) != LW_LIVE_OK) continue;
            read_into(&all, &rect);
            const struct lw_client_level own = lw_client_get_level(live->client, o, l);
            assert_memory_equal(all.rgb + 3 * all.first[3 * o + l], own.rgb,
                                sizeof(float) * 3 * own.width * own.height);
        }
    assert_memory_equal(t.rgb, all.rgb, t.size * 3 * sizeof *t.rgb);
    for (size_t i = 0; i < 3 * t.size; i++) sum += (double)t.rgb[i];
    assert_true(sum > 0);
    free(t.rgb);
    free(t.first);
    free(all.rgb);
    free(all.first);
}

static void test_dirty_of_one_object(void **state) {
    (void)state;
    struct lw_process daemon;
    lw_process_serve(&daemon, RESTS);
    open_live(daemon.port, 0);
    assert_int_equal(kill(daemon.pid, SIGTERM), 0);
    while (lw_live_poll(live, 20, &err) == LW_LIVE_OK) {
    }
    struct lw_live_rect rect[64];
    const uint32_t before = stats().dirty_tiles;
    const size_t count = lw_live_take_dirty(live, 1, 0, 0, rect, 64);
    assert_true(count > 0);
    for (size_t i = 0; i < count; i++) assert_true(rect[i].object == 1 && rect[i].level == 0);
    assert_int_equal(lw_live_take_dirty(live, 1, 0, 0, rect, 64), 0);
    assert_true(stats().dirty_tiles < before);
    /* the rest in two steps: level 1 first, none twice */
    size_t level_1 = 0, others = 0, n;
    while ((n = lw_live_take_dirty(live, LW_LIVE_NONE, 1, 0, rect, 1)) > 0) level_1 += n;
    while ((n = lw_live_take_dirty(live, LW_LIVE_NONE, LW_LIVE_NONE, 0, rect, 1)) > 0) {
        assert_true(rect[0].level != 1 && !(rect[0].object == 1 && rect[0].level == 0));
        others += n;
    }
    assert_true(level_1 > 0 && others > 0);
    assert_int_equal(stats().dirty_tiles, 0);
    fails(lw_live_read(live, &(struct lw_live_rect){.object = 1, .x = 1, .width = UINT32_MAX, .height = 1},
                       &(struct lw_live_texels){.struct_size = sizeof(struct lw_live_texels)}, &err),
          LW_LIVE_USAGE, "do not lie within");
    uint8_t bytes[16];
    fails(lw_live_read(live, &(struct lw_live_rect){.width = 2, .height = 2},
                       &(struct lw_live_texels){
                           .struct_size = sizeof(struct lw_live_texels), .dst = bytes, .dst_size = 15},
                       &err),
          LW_LIVE_USAGE, "dst of 15 bytes");
    ok(lw_live_read(
        live, &(struct lw_live_rect){.width = 2, .height = 2},
        &(struct lw_live_texels){.struct_size = sizeof(struct lw_live_texels), .dst = bytes, .dst_size = 16},
        &err));
}

/* A session that wants nothing has the coarsest levels alone: the finest one is whole all the same. */
static void test_coarse_light_stands_in(void **state) {
    (void)state;
    open_live(still_daemon()->port, LW_LIVE_WANTS_NOTHING);
    uint32_t tiles = 0, lit = 0;
    for (uint32_t o = 0; o < live->scene->object_count; o++) {
        struct lw_live_rect level;
        ok(lw_live_get_level(live, o, 0, &level, &err));
        if (live->tiles.map->atlas[o]->level_count < 2) continue;
        assert_int_equal(
            lw_client_get_tile(live->client, lw_atlas_map_find(live->tiles.map, o, 0, 0, 0)).version, 0);
        float rgb[3];
        struct lw_live_texels texels = {.struct_size = sizeof texels,
                                        .format = LW_LIVE_RGB32F,
                                        .quantity = LW_LIVE_IRRADIANCE_OVER_PI,
                                        .scale = 3.14159265f,
                                        .dst = rgb,
                                        .dst_size = sizeof rgb};
        for (uint32_t y = 0; y < level.height; y += 7)
            for (uint32_t x = 0; x < level.width; x += 7, tiles++) {
                float sampled[3];
                ok(lw_live_read(live, &(struct lw_live_rect){o, 0, x, y, 1, 1}, &texels, &err));
                ok(lw_live_sample(live, o, (float[]){(float)x + 0.5f, (float)y + 0.5f}, sampled, &err));
                assert_true(fabsf(sampled[0] - rgb[0]) <= 1e-5f * fabsf(rgb[0]) + 1e-20f);
                lit += rgb[0] > 0;
            }
    }
    assert_true(lit > tiles / 2);
}

/* The mean of directions over level 0 of an object, all of whose texels are as they came. */
static struct lw_vec3 mean_direction(const char *name) {
    const uint32_t object = lw_live_find(live, LW_LIVE_KIND_OBJECT, name, 0);
    const struct lw_client_level own = lw_client_get_level(live->client, object, 0);
    const size_t count = (size_t)own.width * own.height;
    struct lw_live_rect level;
    struct lw_vec3 sum = lw_vec3(0, 0, 0);
    float *xyz = calloc(count, 3 * sizeof *xyz);
    assert_true(count && xyz && own.direction);
    ok(lw_live_get_level(live, object, 0, &level, &err));
    ok(lw_live_read(live, &level,
                    &(struct lw_live_texels){.struct_size = sizeof(struct lw_live_texels),
                                             .format = LW_LIVE_RGB32F,
                                             .quantity = LW_LIVE_DIRECTION,
                                             .dst = xyz,
                                             .dst_size = count * 3 * sizeof *xyz},
                    &err));
    for (size_t i = 0; i < 3 * count; i++) assert_true(xyz[i] == fminf(fmaxf(own.direction[i], -1), 1));
    for (size_t i = 0; i < count; i++)
        sum = lw_vec3_add(sum, lw_vec3(xyz[3 * i], xyz[3 * i + 1], xyz[3 * i + 2]));
    free(xyz);
    return lw_vec3_scale(sum, 1 / (float)count);
}

static bool has_directions(void) {
    for (uint32_t t = 0; t < live->tiles.map->tile_count; t++)
        if (!lw_client_get_tile(live->client, (lw_tile_id){t}).direction_version) return false;
    return true;
}

/* The lamp under the ceiling lights the floor from above, and the left wall from above and from its right. */
static void test_directions_of_light(void **state) {
    (void)state;
    struct lw_process daemon;
    lw_process_serve(&daemon, RESTS "--directional on");
    open_live(daemon.port, LW_LIVE_DIRECTIONS | LW_LIVE_AS_IT_IS);
    const uint64_t end_ns = lw_clock_ns() + LIMIT_NS;
    while (!has_directions()) {
        assert_true(lw_clock_ns() < end_ns);
        ok(lw_live_poll(live, 20, &err));
    }
    const struct lw_vec3 on_floor = mean_direction("floor"), on_wall = mean_direction("left wall"),
                         on_ceiling = mean_direction("ceiling");
    assert_true(on_floor.y > 0.6f && on_floor.y <= 1 && fabsf(on_floor.x) < 0.2f);
    assert_true(on_wall.x > 0.5f && on_wall.x <= 1 && on_wall.y > 0.1f);
    assert_true(on_ceiling.y < -0.4f && on_ceiling.y >= -1);
    uint8_t texel[16];
    struct lw_live_texels texels = {.struct_size = sizeof texels,
                                    .format = LW_LIVE_RGB9E5,
                                    .quantity = LW_LIVE_DIRECTION,
                                    .dst = texel,
                                    .dst_size = sizeof texel};
    const struct lw_live_rect rect = {.width = 1, .height = 1};
    fails(lw_live_read(live, &rect, &texels, &err), LW_LIVE_USAGE, "no sign");
    lw_live_close(live);
    open_live(daemon.port, 0);
    texels.format = LW_LIVE_RGBA32F;
    fails(lw_live_read(live, &rect, &texels, &err), LW_LIVE_USAGE, "LW_LIVE_DIRECTIONS alone");
}

/* A server without directions gives none; light is there all the same. */
static void test_no_directions_of_light(void **state) {
    (void)state;
    open_live(still_daemon()->port, LW_LIVE_DIRECTIONS);
    float xyz[4] = {9, 9, 9, 9}, rgb[3];
    ok(lw_live_read(live, &(struct lw_live_rect){.width = 1, .height = 1},
                    &(struct lw_live_texels){.struct_size = sizeof(struct lw_live_texels),
                                             .format = LW_LIVE_RGBA32F,
                                             .quantity = LW_LIVE_DIRECTION,
                                             .dst = xyz,
                                             .dst_size = sizeof xyz},
                    &err));
    assert_true(xyz[0] == 0 && xyz[1] == 0 && xyz[2] == 0 && xyz[3] == 1);
    ok(lw_live_sample(live, 0, (float[]){1, 1}, rgb, &err));
}

/* From the main camera to the surfaces in its view. */
static void test_a_ray_finds_light(void **state) {
    (void)state;
    open_live(still_daemon()->port, 0);
    struct lw_live_camera camera = {.struct_size = sizeof camera};
    ok(lw_live_get_camera(live, 0, &camera, &err));
    struct lw_live_hit hit = {.struct_size = sizeof hit};
    const float down[3] = {0, -1, 0}, up[3] = {0, 3, 0}, nowhere[3] = {0, 0, 0};
    ok(lw_live_cast(live, camera.position_ws, down, &hit, &err));
    assert_int_not_equal(hit.object, LW_LIVE_NONE);
    assert_true(fabsf(hit.distance - camera.position_ws[1]) < 0.2f && fabsf(hit.position_ws[1]) < 0.2f);
    float rgb[3];
    ok(lw_live_sample(live, hit.object, hit.lightmap_uv, rgb, &err));
    assert_true(rgb[0] > 0 && isfinite(rgb[0]));
    struct lw_live_mesh mesh = {.struct_size = sizeof mesh};
    ok(lw_live_get_mesh(live, live->scene->object[hit.object].mesh, &mesh, &err));
    assert_true(hit.lightmap_uv[0] > 0 && hit.lightmap_uv[0] < (float)mesh.atlas_width);
    ok(lw_live_cast(live, (float[]){500, 0, 0}, up, &hit, &err));
    assert_int_equal(hit.object, LW_LIVE_NONE);
    fails(lw_live_cast(live, up, nowhere, &hit, &err), LW_LIVE_USAGE, "direction");
}

/* ---- interest ---- */

static bool is_listed(uint32_t count, lw_tile_id tile) {
    for (uint32_t i = 0; i < count; i++)
        if (live->interest.list[i].v == tile.v) return true;
    return false;
}

static void test_views_want_what_they_show(void **state) {
    (void)state;
    open_live(still_daemon()->port, LW_LIVE_WANTS_NOTHING);
    struct lw_live_camera camera = {.struct_size = sizeof camera};
    ok(lw_live_get_camera(live, 0, &camera, &err));
    const uint32_t width = 1280, height = 720;
    struct lw_live_view view = view_of(&camera, width, height);
    ok(lw_live_want_views(live, &view, 1, &err));
    const uint64_t now_ns = lw_clock_ns();
    const uint32_t count = lw_live_interest_list(&live->interest, live->client, now_ns);
    uint32_t all = 0, hits = 0;
    for (uint32_t t = 0; t < live->tiles.map->tile_count; t++) all += live->tiles.map->place[t].level == 0;
    assert_true(count > 10 && count < all);
    /* whatever a ray of the picture meets is in the list, at some level */
    for (uint32_t y = 5; y < height; y += 60)
        for (uint32_t x = 5; x < width; x += 60) {
            const float right = tanf(camera.fov_y / 2) * (float)width / (float)height *
                                (2 * (float)x / (float)width - 1),
                        up = tanf(camera.fov_y / 2) * (1 - 2 * (float)y / (float)height);
            float direction[3];
            for (int k = 0; k < 3; k++)
                direction[k] = camera.forward_ws[k] + right * camera.right_ws[k] + up * camera.up_ws[k];
            struct lw_live_hit hit = {.struct_size = sizeof hit};
            ok(lw_live_cast(live, camera.position_ws, direction, &hit, &err));
            if (hit.object == LW_LIVE_NONE) continue;
            bool is_wanted = false;
            for (uint32_t l = 0; l < 3; l++) {
                const uint32_t tile_x = (uint32_t)hit.lightmap_uv[0] / LW_TILE_SIDE >> l,
                               tile_y = (uint32_t)hit.lightmap_uv[1] / LW_TILE_SIDE >> l;
                const lw_tile_id tile = lw_atlas_map_find(live->tiles.map, hit.object, l, tile_x, tile_y);
                is_wanted |= tile.v != UINT32_MAX && is_listed(count, tile);
            }
            assert_true(is_wanted);
            hits++;
        }
    assert_true(hits > 100);
    /* a small picture of the same reads coarser levels: fewer tiles */
    view = view_of(&camera, 16, 9);
    live->interest.view[0] = view;
    uint32_t finest = 0, finest_of_small = 0;
    for (uint32_t i = 0; i < count; i++)
        finest += live->tiles.map->place[live->interest.list[i].v].level == 0;
    const uint64_t later_ns = now_ns + 2 * LW_LIVE_INTEREST_KEEP_NS;
    const uint32_t count_of_small = lw_live_interest_list(&live->interest, live->client, later_ns);
    for (uint32_t i = 0; i < count_of_small; i++)
        finest_of_small += live->tiles.map->place[live->interest.list[i].v].level == 0;
    assert_true(count_of_small <= count && finest_of_small < 3 * finest / 4);
    /* and the server sends them */
    const uint64_t tiles = stats().tiles;
    for (uint64_t end_ns = lw_clock_ns() + LIMIT_NS; stats().tiles < tiles + 10;) {
        ok(lw_live_want_views(live, &view, 1, &err));
        ok(lw_live_poll(live, 5, &err));
        assert_true(lw_clock_ns() < end_ns);
    }
    assert_false(live->interest.has_changed);
    view.view_projection[5] = NAN;
    fails(lw_live_want_views(live, &view, 1, &err), LW_LIVE_USAGE, "view_projection[5]");
    view.width = 0;
    fails(lw_live_want_views(live, &view, 1, &err), LW_LIVE_USAGE, "no pixels");
    fails(lw_live_want_views(live, &view, 9, &err), LW_LIVE_USAGE, "9 views");
    struct lw_live_rect rect;
    ok(lw_live_get_level(live, 0, 0, &rect, &err));
    ok(lw_live_want_rects(live, &rect, 1, &err));
    assert_false(live->interest.is_active);
    rect.width++;
    fails(lw_live_want_rects(live, &rect, 1, &err), LW_LIVE_USAGE, "do not lie within");
}

/* ---- no allocation once warm ---- */

/* Until the server has made this number of frames. */
static void draw_frames(const struct textures *t, unsigned frames, unsigned *out_texels) {
    struct lw_live_camera camera = {.struct_size = sizeof camera};
    ok(lw_live_get_camera(live, 0, &camera, &err));
    const uint64_t last = stats().frame + frames;
    for (const uint64_t end_ns = lw_clock_ns() + LIMIT_NS; stats().frame < last;) {
        assert_true(lw_clock_ns() < end_ns);
        camera.position_ws[0] += 0.01f;
        const struct lw_live_view view = view_of(&camera, 1280, 720);
        ok(lw_live_want_views(live, &view, 1, &err));
        ok(lw_live_poll(live, 5, &err));
        *out_texels += (unsigned)upload(t, 1u << 16);
        for (uint32_t o = 0; o < live->scene->object_count; o++) {
            struct lw_live_object object = {.struct_size = sizeof object};
            ok(lw_live_get_object(live, o, &object, &err));
        }
        struct lw_live_stats s = {.struct_size = sizeof s};
        ok(lw_live_get_stats(live, &s, &err));
    }
}

static void test_frames_allocate_nothing(void **state) {
    (void)state;
    if (LW_SANITIZER) skip();
    for (uint32_t flags = 0; flags <= LW_LIVE_THREAD; flags += LW_LIVE_THREAD) {
        struct lw_process daemon;
        serve_never_resting(&daemon, "");
        open_live(daemon.port, flags);
        struct textures t = make_textures();
        unsigned texels = 0;
        draw_frames(&t, 40, &texels);
        texels = 0;
        atomic_store(&allocations, 0);
        atomic_store(&is_counted, true);
        draw_frames(&t, 20, &texels);
        atomic_store(&is_counted, false);
        assert_true(texels > 50000); /* light did come */
        assert_int_equal(atomic_load(&allocations), 0);
        atomic_store(&is_counted, true);
        void *volatile one = malloc(1); /* volatile: else the compiler leaves both calls out */
        free(one);
        atomic_store(&is_counted, false);
        assert_int_equal(atomic_load(&allocations), 1); /* and it does count */
        free(t.rgb);
        free(t.first);
        end_all(NULL);
    }
}

/* ---- a thread of its own ---- */

static void wait_frames(uint64_t session, uint64_t tiles) {
    for (uint64_t end_ns = lw_clock_ns() + LIMIT_NS; stats().session < session || stats().tiles < tiles;) {
        assert_true(lw_clock_ns() < end_ns);
        ok(lw_live_poll(live, 20, &err));
    }
}

static void test_thread_comes_back(void **state) {
    (void)state;
    struct lw_process daemon;
    char arguments[200];
    serve_never_resting(&daemon, "");
    open_live(daemon.port, LW_LIVE_THREAD);
    struct textures t = make_textures();
    assert_int_equal(lw_live_descriptor(live), -1);
    fails(lw_live_reconnect(live, &err), LW_LIVE_USAGE, "by itself");
    wait_frames(1, stats().tiles + 50);
    assert_true(upload(&t, 0) > 0);
    (void)lw_process_stop(&daemon, SIGTERM, LIMIT_S);
    for (uint64_t end_ns = lw_clock_ns() + LIMIT_NS; stats().is_connected;) {
        ok(lw_live_poll(live, 20, &err));
        assert_true(lw_clock_ns() < end_ns);
    }
    ok(lw_live_poll(live, 0, &err));
    snprintf(arguments, sizeof arguments, "--listen 127.0.0.1:%u", (unsigned)daemon.port);
    serve_never_resting(&daemon, arguments);
    wait_frames(2, stats().tiles + 50);
    /* another scene: one status, then it comes as the first one did */
    (void)lw_process_stop(&daemon, SIGTERM, LIMIT_S);
    snprintf(arguments, sizeof arguments, RESTS "--listen 127.0.0.1:%u", (unsigned)daemon.port);
    lw_process_serve(&daemon, arguments);
    enum lw_live_status status = LW_LIVE_OK;
    for (uint64_t end_ns = lw_clock_ns() + LIMIT_NS; status == LW_LIVE_OK;) {
        assert_true(lw_clock_ns() < end_ns);
        status = lw_live_poll(live, 20, &err);
    }
    fails(status, LW_LIVE_OTHER_SCENE, "another scene");
    struct lw_live_scene scene = {.struct_size = sizeof scene};
    status = lw_live_get_scene(live, &scene, &err); /* the library's thread may have it already */
    if (status != LW_LIVE_OK) fails(status, LW_LIVE_NOT_READY, "not arrived");
    for (uint64_t end_ns = lw_clock_ns() + LIMIT_NS; stats().session < 3 || !stats().has_light;) {
        assert_true(lw_clock_ns() < end_ns);
        ok(lw_live_poll(live, 20, &err));
    }
    ok(lw_live_get_scene(live, &scene, &err));
    free(t.rgb);
    free(t.first);
}

int main(void) {
    const struct CMUnitTest tests[] = {
        cmocka_unit_test_teardown(test_coarse_light_stands_in, end_session),
        cmocka_unit_test_teardown(test_no_directions_of_light, end_session),
        cmocka_unit_test_teardown(test_a_ray_finds_light, end_session),
        cmocka_unit_test_teardown(test_views_want_what_they_show, end_all),
        cmocka_unit_test_teardown(test_dirty_rectangles_are_all, end_all),
        cmocka_unit_test_teardown(test_dirty_of_one_object, end_all),
        cmocka_unit_test_teardown(test_frames_allocate_nothing, end_all),
        cmocka_unit_test_teardown(test_directions_of_light, end_all),
        cmocka_unit_test_teardown(test_thread_comes_back, end_all),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
