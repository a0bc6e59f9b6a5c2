/* The renderer by OpenGL: what it uploads, draws, asks for and shows, and what each costs. */
#include "tests/reference/gl_case.h"

#include "client/camera/camera.h"
#include "client/gl/gl_rgb9e5.h"
#include "client/view/tonemap.h"

#include <epoxy/gl.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

/* Uploads are capped, what waits comes later, and nothing is uploaded twice. */
static void test_uploads(void **state) {
    (void)state;
    struct gl_case_world w;
    struct lw_error err = {0};
    gl_case_start(&w, gl_case_open_scene("builtin:cornell"), 0.5f, 1);
    uint32_t waiting = 0, tile_count = w.map.tile_count, calls = 0;
    do {
        const uint32_t before = waiting;
        lw_support_ok(lw_gl_renderer_take(w.renderer, &w.source, &w.pose, 3, 0, &waiting, &err), &err);
        assert_int_equal(calls == 0 ? tile_count - 3 : before > 3 ? before - 3 : 0, waiting);
        assert_true(++calls <= tile_count);
    } while (waiting > 0);
    assert_int_equal(lw_gl_renderer_figures(w.renderer).tiles_uploaded, tile_count);
    gl_case_draw(&w);
    assert_int_equal(lw_gl_renderer_figures(w.renderer).tiles_uploaded, tile_count);
    gl_case_compare("builtin:cornell, in steps", &w);
    w.tile[tile_count / 2].version++;
    gl_case_draw(&w);
    assert_int_equal(lw_gl_renderer_figures(w.renderer).tiles_uploaded, tile_count + 1);
    gl_case_world_finish(&w);
}

/* Parts of the light, and charts, are the same by both; the parts add up. */
static void test_shows(void **state) {
    (void)state;
    struct gl_case_world w;
    struct lw_error err = {0};
    gl_case_start_drawn(&w, "builtin:cornell", 0.02f);
    struct lw_vec3 *colour = calloc(w.map.tile_count, sizeof *colour);
    float *sum = calloc((size_t)3 * PIXELS, sizeof *sum);
    assert_true(colour && sum);
    for (uint32_t t = 0; t < w.map.tile_count; t++)
        w.tile[t].error = 0.002f * (float)(1 + (t * 2654435761u >> 16) % 7);
    for (int show = LW_SHOW_DIRECT; show < LW_SHOW_COUNT; show++) {
        char name[64];
        const struct lw_show_tiles tiles = {
            .count = w.map.tile_count, .context = &w, .tile = w.source.tile, .now_ns = 5000000000u};
        lw_show_colour_tiles(LW_SHOW_ERROR, &tiles, colour);
        w.view.show = (enum lw_show)show, w.view.tile_colour = colour;
        gl_case_draw(&w);
        snprintf(name, sizeof name, "builtin:cornell, %s", lw_show_name((enum lw_show)show));
        gl_case_compare(name, &w);
        if (show <= LW_SHOW_INDIRECT)
            for (size_t i = 0; i < (size_t)3 * PIXELS; i++) sum[i] += w.by_cpu[i];
    }
    w.view.show = LW_SHOW_ALL;
    gl_case_draw(&w);
    double off = 0, all = 0;
    for (size_t i = 0; i < (size_t)3 * PIXELS; i++) {
        off += fabs((double)sum[i] - (double)w.by_cpu[i]);
        all += (double)w.by_cpu[i];
    }
    assert_true(off < 1e-5 * all);
    (void)err;
    free(sum);
    free(colour);
    gl_case_world_finish(&w);
}

/* The object of a room that fills the least of it: a thing that stands there. */
static uint32_t find_inner(const struct gl_case_world *w) {
    uint32_t inner = 0;
    float least = INFINITY;
    for (uint32_t o = 0; o < w->scene->object_count; o++) {
        const struct lw_mesh *mesh = &w->scene->mesh[w->scene->object[o].mesh];
        struct lw_vec3 low = {INFINITY, INFINITY, INFINITY}, high = {-INFINITY, -INFINITY, -INFINITY};
        for (uint32_t v = 0; v < mesh->vertex_count; v++) {
            const struct lw_vec3 p = lw_affine_point(&w->pose.object_to_world[o], mesh->position[v]);
            low = lw_vec3(fminf(low.x, p.x), fminf(low.y, p.y), fminf(low.z, p.z));
            high = lw_vec3(fmaxf(high.x, p.x), fmaxf(high.y, p.y), fmaxf(high.z, p.z));
        }
        const struct lw_vec3 side = lw_vec3_sub(high, low);
        const float volume = side.x * side.y * side.z;
        if (volume > 1e-3f && volume < least) least = volume, inner = o;
    }
    return inner;
}

/* The shadow maps that hold the moved thing are drawn again, and no others; the moved thing is
 * seen. */
static void test_moved_caster(void **state) {
    (void)state;
    struct gl_case_world w;
    struct lw_error err = {0};
    gl_case_start_drawn(&w, "builtin:cornell", 0.02f);
    gl_case_take_and_draw(&w, 1);
    const uint64_t all = lw_gl_renderer_figures(w.renderer).maps_drawn;
    gl_case_take_and_draw(&w, 1);
    assert_int_equal(lw_gl_renderer_figures(w.renderer).maps_drawn, all);
    const uint32_t inner = find_inner(&w);
    w.pose.object_dynamic[inner] = true;
    w.pose.object_to_world[inner].m[0][3] += 0.02f;
    lw_support_ok(lw_trace_set_pose(w.trace, &w.pose, &err), &err);
    gl_case_take_and_draw(&w, 1);
    const uint64_t again = lw_gl_renderer_figures(w.renderer).maps_drawn - all;
    print_message("%u maps, %u of them again when object %u moves\n", (unsigned)all, (unsigned)again, inner);
    assert_true(again > 0 && again < all);
    gl_case_draw(&w);
    gl_case_compare("builtin:cornell, a box moved", &w);
    gl_case_world_finish(&w);
}

static struct lw_gl_renderer_figures figures_from(struct gl_case_world *w, const char *camera) {
    struct lw_error err = {0};
    lw_support_ok(lw_camera_parse(camera, &w->view.camera, &err), &err);
    gl_case_take_and_draw(w, 1);
    return lw_gl_renderer_figures(w->renderer);
}

/* Draw calls if each object had its own: one for each of its materials. */
static uint32_t count_single_calls(const struct gl_case_world *w) {
    uint32_t calls = 0;
    uint8_t *used = calloc(w->scene->material_count + 1ul, 1);
    assert_non_null(used);
    for (uint32_t o = 0; o < w->scene->object_count; o++) {
        const struct lw_mesh *mesh = &w->scene->mesh[w->scene->object[o].mesh];
        memset(used, 0, w->scene->material_count);
        for (uint32_t t = 0; t < mesh->triangle_count; t++) used[mesh->material[t]] = 1;
        for (uint32_t m = 0; m < w->scene->material_count; m++) calls += used[m];
    }
    free(used);
    return calls;
}

/* Instances share draw calls, and objects out of sight are not drawn. */
static void test_draw_calls(void **state) {
    (void)state;
    struct gl_case_world w;
    gl_case_start(&w, gl_case_open_scene("builtin:city:1"), 0, 1);
    uint32_t placed = 0;
    for (uint32_t o = 0; o < w.scene->object_count; o++) placed += !w.pose.object_hidden[o];
    const struct lw_gl_renderer_figures all = figures_from(&w, "-900,700,-900:0,0,0:60"),
                                        part = figures_from(&w, "0,2,0:100,2,0:40"),
                                        none = figures_from(&w, "0,400,0:0,500,1:40");
    print_message("city:1, %u objects: %u in %u draw calls; from within %u in %u; of the sky %u in %u\n",
                  placed, all.objects, all.draw_calls, part.objects, part.draw_calls, none.objects,
                  none.draw_calls);
    assert_int_equal(all.objects, placed);
    assert_true(all.draw_calls < count_single_calls(&w));
    assert_true(part.objects < placed && part.objects > 0);
    assert_true(part.draw_calls <= all.draw_calls);
    assert_int_equal(none.objects, 0);
    assert_true(none.draw_calls <= 1);
    gl_case_world_finish(&w);
}

/* By how many codes at most a framebuffer differs from what lw_tonemap makes of the picture. */
static unsigned codes_apart(struct gl_case_world *w, GLuint frame, enum lw_tonemap_curve curve, float stops) {
    struct lw_tonemap tonemap;
    unsigned most = 0;
    uint8_t *shown = malloc(4ul * PIXELS), *expected = malloc(3ul * PIXELS);
    assert_true(shown && expected);
    lw_tonemap_init(&tonemap, curve, stops);
    lw_tonemap_encode(&tonemap, w->by_gl, PIXELS, 3, expected);
    lw_gl_renderer_show(w->renderer, frame, curve, stops, WIDTH, HEIGHT);
    glBindFramebuffer(GL_READ_FRAMEBUFFER, frame);
    glPixelStorei(GL_PACK_ALIGNMENT, 4);
    glReadPixels(0, 0, WIDTH, HEIGHT, GL_RGBA, GL_UNSIGNED_BYTE, shown);
    for (size_t y = 0; y < HEIGHT; y++)
        for (size_t x = 0; x < WIDTH; x++)
            for (size_t c = 0; c < 3; c++) {
                const int a = shown[4 * ((HEIGHT - 1 - y) * WIDTH + x) + c],
                          b = expected[3 * (y * WIDTH + x) + c];
                if ((unsigned)abs(a - b) > most) most = (unsigned)abs(a - b);
            }
    free(expected);
    free(shown);
    return most;
}

/* What the window gets is the picture as lw_tonemap encodes it, and its exposure that of the whole
 * picture. */
static void test_show_and_meter(void **state) {
    (void)state;
    struct gl_case_world w;
    struct lw_error err = {0};
    gl_case_start(&w, gl_case_open_scene("builtin:cornell"), 0, 1);
    gl_case_take_and_draw(&w, 1);
    lw_support_ok(lw_gl_renderer_read(w.renderer, w.by_gl, &err), &err);
    float stops = 0;
    lw_support_ok(lw_gl_renderer_meter(w.renderer, &stops, &err), &err);
    const float whole = lw_tonemap_auto_stops(w.by_gl, PIXELS);
    print_message("metered %+.3f stops, of all pixels %+.3f\n", (double)stops, (double)whole);
    assert_true(fabsf(stops - whole) < 0.1f);
    GLuint frame, buffer;
    glGenFramebuffers(1, &frame);
    glBindFramebuffer(GL_FRAMEBUFFER, frame);
    glGenRenderbuffers(1, &buffer);
    glBindRenderbuffer(GL_RENDERBUFFER, buffer);
    glRenderbufferStorage(GL_RENDERBUFFER, GL_RGBA8, WIDTH, HEIGHT);
    glFramebufferRenderbuffer(GL_FRAMEBUFFER, GL_COLOR_ATTACHMENT0, GL_RENDERBUFFER, buffer);
    for (int curve = LW_TONEMAP_REINHARD; curve <= LW_TONEMAP_NONE; curve++) {
        const unsigned most = codes_apart(&w, frame, (enum lw_tonemap_curve)curve, whole);
        print_message("curve %d: codes differ by %u at most\n", curve, most);
        assert_true(most <= 1);
    }
    glDeleteFramebuffers(1, &frame);
    glDeleteRenderbuffers(1, &buffer);
    gl_case_world_finish(&w);
}

/* The tiles of a survey are those that the composer needs, but for few that cover a pixel or two. */
static void test_survey(void **state) {
    (void)state;
    struct gl_case_world w;
    struct lw_error err = {0};
    struct lw_compose_report report;
    gl_case_start(&w, gl_case_open_scene("builtin:cornell"), 0.5f, 1);
    uint8_t *needed = calloc(w.map.tile_count, 1);
    uint64_t *shown = calloc(w.map.tile_count, sizeof *shown), pixel_count = 0, lit = 0;
    assert_true(needed && shown);
    lw_compose_render(w.compose, &w.source, &w.pose, &w.view, w.by_cpu, &report);
    lw_support_ok(lw_gl_renderer_take(w.renderer, &w.source, &w.pose, 0, 0, NULL, &err), &err);
    lw_support_ok(lw_gl_renderer_survey(w.renderer, &w.view, needed, shown, &pixel_count, &err), &err);
    uint32_t both = 0, one = 0;
    for (uint32_t t = 0; t < w.map.tile_count; t++) {
        both += needed[t] && lw_compose_needed(w.compose)[t];
        one += needed[t] != lw_compose_needed(w.compose)[t];
        lit += shown[t];
        if (shown[t]) assert_true(needed[t]);
    }
    print_message("%u tiles needed by both, %u by one\n", both, one);
    assert_int_equal(pixel_count, WIDTH / 4 * HEIGHT / 4);
    assert_true(both > 3 * one);
    assert_true(lit <= 256 * pixel_count && lit > 64 * pixel_count);
    free(shown);
    free(needed);
    gl_case_world_finish(&w);
}

/* RGB9E5 is within half a step of what it holds, times the scale. */
static void test_pack(void **state) {
    (void)state;
    for (int i = -20; i < 16; i++)
        for (int k = 0; k < 40; k++) {
            const float most = ldexpf(1 + (float)k / 39.0f, i), rgb[3] = {most, 0.3f * most, 0.001f * most};
            const uint32_t packed = lw_gl_rgb9e5_pack(rgb, 1);
            const float step = ldexpf(1, (int)(packed >> 27) - 24);
            if (most > 65408) continue;
            for (int c = 0; c < 3; c++)
                assert_true(fabsf((float)(packed >> (9 * c) & 511) * step - rgb[c]) <= 0.5f * step);
            assert_true(step <= fmaxf(most / 255, ldexpf(1, -24)));
        }
    const float wrong[3] = {NAN, -1, 1e30f};
    const uint32_t packed = lw_gl_rgb9e5_pack(wrong, 1);
    assert_int_equal(packed & 0x3ffff, 0);
    assert_int_equal(packed >> 18, 31 << 9 | 511);
    const float dim[3] = {0.5f, 0.125f, 0}, bright[3] = {2, 0.5f, 0};
    assert_int_equal(lw_gl_rgb9e5_pack(dim, 4), lw_gl_rgb9e5_pack(bright, 1));
    assert_int_not_equal(lw_gl_rgb9e5_pack(dim, 4), lw_gl_rgb9e5_pack(dim, 1));
}

/* A picture that no GPU draws fails with a word, and the next one is drawn. */
static void test_sizes(void **state) {
    (void)state;
    struct gl_case_world w;
    struct lw_error err = {0};
    gl_case_start(&w, gl_case_open_scene("builtin:cornell"), 0, 1);
    struct lw_compose_view view = w.view;
    for (int i = 0; i < 2; i++) {
        view.width = i ? 1u << 20 : 0;
        err = (struct lw_error){0};
        lw_support_fails(lw_gl_renderer_draw(w.renderer, &view, 1, &err), LW_UNAVAILABLE, &err, "pixels");
    }
    gl_case_draw(&w);
    gl_case_compare("builtin:cornell, after sizes that cannot be", &w);
    gl_case_world_finish(&w);
}

int main(void) {
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(test_shows),      cmocka_unit_test(test_moved_caster),
        cmocka_unit_test(test_draw_calls), cmocka_unit_test(test_show_and_meter),
        cmocka_unit_test(test_uploads),    cmocka_unit_test(test_survey),
        cmocka_unit_test(test_pack),       cmocka_unit_test(test_sizes),
    };
    return cmocka_run_group_tests(tests, NULL, gl_case_close_scenes);
}
