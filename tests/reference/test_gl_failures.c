/* A GPU that gives errors, or whose limits are small: one line, nothing leaks, and the next renderer works.
 * libepoxy's functions are pointers, which the test replaces. */
#include "tests/support/support.h"

#include "client/gl/gl_light.h"
#include "client/gl/gl_offscreen.h"
#include "client/gl/gl_renderer.h"
#include "common/builtin/builtin.h"
#include "common/lightmap/lightmap.h"

#include <epoxy/gl.h>
#include <stdlib.h>
#include <string.h>

static struct lw_gl_offscreen *offscreen; /* NULL: there is no OpenGL here */
static struct lw_scene *scene;
static struct lw_pose pose;
static struct lw_atlas_map map;
static struct lw_trace *trace;
static struct lw_client_lights drawn;
static float *black;

static PFNGLGETERRORPROC real_get_error;
static PFNGLGETINTEGERVPROC real_get_integerv;

static GLenum the_error;
static int calls_left; /* calls of glGetError() that still work */
static GLenum fail_late(void) {
    if (calls_left > 0) return calls_left--, real_get_error();
    return the_error;
}

static GLenum limited;
static GLint limit;
static void small_limit(GLenum name, GLint *out) {
    real_get_integerv(name, out);
    if (name == limited) *out = limit;
}

static struct lw_client_level level(const void *context, uint32_t object, uint32_t k) {
    (void)context;
    const struct lw_atlas_level *l = &map.atlas[object]->level[k];
    return (struct lw_client_level){.width = l->width, .height = l->height, .rgb = black};
}

static struct lw_client_tile tile(const void *context, lw_tile_id id) {
    (void)context;
    (void)id;
    return (struct lw_client_tile){.version = 1};
}

static const struct lw_compose_source source = {.level = level, .tile = tile};

static int start(void **state) {
    (void)state;
    struct lw_error err = {0};
    size_t texels = 1;
    lw_support_ok(lw_builtin_build("builtin:cornell", &scene, &err), &err);
    lw_support_ok(lw_lightmap_build(scene, &(struct lw_lightmap_desc){.texels_per_metre = 8}, NULL, &err),
                  &err);
    lw_support_ok(lw_pose_init(&pose, scene), NULL);
    lw_support_ok(lw_atlas_map_init(&map, scene), NULL);
    lw_support_ok(lw_trace_create(scene, &pose, &trace, &err), &err);
    lw_support_ok(lw_client_lights_init(&drawn, scene, &pose, "auto", &err), &err);
    for (uint32_t o = 0; o < map.object_count; o++)
        for (uint32_t k = 0; k < map.atlas[o]->level_count; k++) {
            const size_t size = (size_t)map.atlas[o]->level[k].width * map.atlas[o]->level[k].height;
            if (size > texels) texels = size;
        }
    black = calloc(3 * texels, sizeof *black);
    assert_non_null(black);
    if (lw_gl_offscreen_create(&offscreen, &err) != LW_OK)
        print_message("no OpenGL here, so it is not tested: %s\n", err.text);
    if (offscreen == NULL) return 0;
    GLint any;
    glGetError(); /* the first call of each finds the driver's */
    glGetIntegerv(GL_MAX_TEXTURE_SIZE, &any);
    real_get_error = epoxy_glGetError, real_get_integerv = epoxy_glGetIntegerv;
    return 0;
}

static int stop(void **state) {
    (void)state;
    lw_gl_offscreen_destroy(offscreen);
    free(black);
    lw_client_lights_finish(&drawn);
    lw_trace_destroy(trace);
    lw_atlas_map_finish(&map);
    lw_pose_finish(&pose);
    lw_scene_destroy(scene);
    return 0;
}

/* All that the viewer does with a renderer. */
static enum lw_status use(struct lw_error *err) {
    static float rgb[64 * 36 * 3];
    struct lw_gl_renderer *renderer = NULL;
    float stops;
    const struct lw_compose_view view = {
        .camera = lw_camera_of_scene(scene, &pose, 0), .width = 64, .height = 36};
    uint8_t *needed = calloc(map.tile_count, 1);
    uint64_t *shown = calloc(map.tile_count, sizeof *shown), pixels;
    assert_true(needed && shown);
    enum lw_status status = lw_gl_renderer_create(
        &(struct lw_gl_renderer_desc){
            .scene = scene, .map = &map, .drawn = &drawn, .trace = trace, .pose = &pose},
        &renderer, err);
    if (status == LW_OK) status = lw_gl_renderer_take(renderer, &source, &pose, 0, 0, NULL, err);
    if (status == LW_OK) status = lw_gl_renderer_draw(renderer, &view, 4, err);
    if (status == LW_OK) status = lw_gl_renderer_meter(renderer, &stops, err);
    if (status == LW_OK) status = lw_gl_renderer_survey(renderer, &view, needed, shown, &pixels, err);
    if (status == LW_OK) status = lw_gl_renderer_draw(renderer, &view, 1, err);
    if (status == LW_OK) status = lw_gl_renderer_read(renderer, rgb, err);
    lw_gl_renderer_destroy(renderer);
    free(shown);
    free(needed);
    return status;
}

static void skip_without_gl(void) {
    if (offscreen == NULL) skip();
}

/* Wherever it is looked for, an error ends in one line, which says what a user can do. Each place finds one
 * of the three errors: what an error means does not depend on the place. */
static void test_errors(void **state) {
    (void)state;
    static const struct {
        GLenum error;
        enum lw_status status;
    } cases[] = {
        {GL_OUT_OF_MEMORY, LW_NO_MEMORY}, {GL_INVALID_OPERATION, LW_UNAVAILABLE}, {0x0507, LW_UNAVAILABLE}};
    skip_without_gl();
    int places = 0;
    for (;; places++) {
        struct lw_error err = {0};
        the_error = cases[places % 3].error; /* 0x0507: the context is lost, and says so for ever */
        calls_left = places;
        epoxy_glGetError = fail_late;
        const enum lw_status status = use(&err);
        epoxy_glGetError = real_get_error;
        if (status == LW_OK) break;
        lw_support_fails(status, cases[places % 3].status, &err, "--renderer cpu");
        assert_null(strchr(err.text, '\n'));
        assert_true(places < 1000);
    }
    print_message("%d places\n", places);
    assert_true(places >= 6);
    struct lw_error err = {0};
    lw_support_ok(use(&err), &err);
}

/* A scene that is larger than the GPU takes. */
static void test_limits(void **state) {
    (void)state;
    static const GLenum names[] = {GL_MAX_TEXTURE_BUFFER_SIZE, GL_MAX_TEXTURE_SIZE,
                                   GL_MAX_ARRAY_TEXTURE_LAYERS, GL_MAX_RENDERBUFFER_SIZE};
    skip_without_gl();
    for (size_t i = 0; i < sizeof names / sizeof *names; i++) {
        struct lw_error err = {0};
        limited = names[i];
        limit = names[i] == GL_MAX_ARRAY_TEXTURE_LAYERS ? 0 : 4;
        epoxy_glGetIntegerv = small_limit;
        const enum lw_status status = use(&err);
        epoxy_glGetIntegerv = real_get_integerv;
        lw_support_fails(status, LW_UNAVAILABLE, &err, "");
        assert_null(strchr(err.text, '\n'));
        print_message("0x%x: %s\n", names[i], err.text);
    }
    struct lw_error err = {0};
    lw_support_ok(use(&err), &err);
}

int main(void) {
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(test_errors),
        cmocka_unit_test(test_limits),
    };
    return cmocka_run_group_tests(tests, start, stop);
}
