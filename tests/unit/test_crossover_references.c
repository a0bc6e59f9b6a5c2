#include "tests/support/support.h"

#include "client/measure/crossover_references.h"
#include "common/builtin/builtin.h"
#include "common/trace/trace.h"

#include <math.h>
#include <sys/stat.h>

#define FIRST 31u  /* a second before it is frame 1 */
#define LAMP  17.0 /* W/(m^2 sr), of the lamp's red */

/* Towards the lamp, from somewhat lower for each view, so that its rim is in some crops. */
static struct lw_camera_view at_the_lamp(const void *context, uint32_t user, uint64_t frame) {
    (void)context;
    (void)frame;
    return lw_camera_look_at(lw_vec3(0, 0.3f + 0.03f * (float)user, 0.9f), lw_vec3(0, 1.95f, 0), 0.5f);
}

static _Atomic bool never;

static void trace(struct lw_crossover_references *references, const struct lw_scene *scene) {
    static const uint32_t judged[] = {FIRST, FIRST + 1};
    const struct lw_measure_options options = {.scene = {.path = "builtin:cornell"},
                                               .width = 128,
                                               .height = 72,
                                               .bounces = 1,
                                               .reference_samples = 8};
    const char *folder = lw_support_temporary("references");
    assert_int_equal(mkdir(folder, 0777), 0);
    struct lw_error err = {0};
    lw_support_ok(
        lw_crossover_references_init(references,
                                     &(struct lw_crossover_references_desc){.options = &options,
                                                                            .scene = scene,
                                                                            .content = "here",
                                                                            .cameras = {.at = at_the_lamp},
                                                                            .folder = folder,
                                                                            .judged = judged,
                                                                            .judged_count = 2,
                                                                            .cancel = &never},
                                     &err),
        &err);
}

/* A lamp that is in sight decides neither what an error is measured by nor how far late light is off. */
static void what_shines_does_not_count(void **state) {
    (void)state;
    struct lw_scene *scene;
    struct lw_crossover_references t;
    struct lw_error err = {0};
    lw_support_ok(lw_builtin_build("builtin:cornell", &scene, &err), &err);
    trace(&t, scene);
    const size_t pixels = (size_t)LW_CROSSOVER_CROPS * t.side * t.side;
    uint32_t shining = 0, bright = 0;
    double squares = 0, brightest = 0;
    for (uint32_t v = 0; v < LW_MEASURE_VIEWS; v++) {
        const struct lw_crossover_reference *now = &t.now[0][v], *late = &t.late[0][v];
        for (size_t i = 0; i < pixels; i++) {
            const double red = 0.5 * ((double)now->half[0][3 * i] + (double)now->half[1][3 * i]);
            bright += red > 0.9 * LAMP;
            if (now->object[i] == LW_TRACE_MISS) {
                shining++;
                assert_true(late->left_out[i]); /* nothing moves */
                continue;
            }
            brightest = fmax(brightest, red);
            squares = fmax(squares, red * red);
        }
    }
    assert_true(bright > 20);      /* it is in sight */
    assert_true(shining > bright); /* and its rim is left out as well */
    if (brightest > 0.3 * LAMP) fail_msg("a pixel that counts has %g W/(m2 sr)", brightest);
    assert_true(t.mean_square > 0 && t.mean_square <= squares);
    lw_crossover_references_finish(&t);
    lw_scene_destroy(scene);
}

int main(void) {
    const struct CMUnitTest tests[] = {cmocka_unit_test(what_shines_does_not_count)};
    return cmocka_run_group_tests(tests, NULL, NULL);
}
