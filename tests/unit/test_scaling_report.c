#include "tests/support/support.h"

#include "client/measure/scaling_measure.h"
#include "client/measure/scaling_report.h"

#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#define REPEATS 2u

static struct lw_scaling scaling; /* too large for the stack */

static void set_sides(struct lw_scaling *x) {
    static const struct lw_scaling_point paths[] = {
        {.setting = {.samples = 1}, .error = 0.4, .cost = {.cpu_s[LW_STAGE_TRACE] = 0.5}},
        {.setting = {.samples = 4}, .error = 0.1, .cost = {.cpu_s[LW_STAGE_TRACE] = 2}}};
    static const struct lw_scaling_point shared[] = {
        {.setting = {.density = 0.5, .direct_samples = 1, .indirect_samples = 1, .target_error = 0.2},
         .error = 0.3,
         .cost = {.cpu_s[LW_STAGE_SOLVE] = 0.25}},
        {.setting = {.density = 1, .direct_samples = 1, .indirect_samples = 2, .target_error = 0.02},
         .error = 0.09,
         .cost = {.cpu_s[LW_STAGE_SOLVE] = 1}}};
    x->side[LW_SCALING_PATHS] = (struct lw_scaling_side){.name = "svgf", .traces = true, .point_count = 2};
    x->side[LW_SCALING_SHARED] = (struct lw_scaling_side){.name = "shared cache", .point_count = 2};
    memcpy(x->side[LW_SCALING_PATHS].point, paths, sizeof paths);
    memcpy(x->side[LW_SCALING_SHARED].point, shared, sizeof shared);
    for (int s = 0; s < LW_SCALING_SIDES; s++)
        for (uint32_t eye = 0; eye < x->eyes; eye++) {
            struct lw_scaling_errors *errors = &x->side[s].point[1].errors;
            errors->judged[0][eye] = true;
            errors->of[0][eye] = 0.05 * (1 + eye) + 0.01 * s;
        }
    x->target[0] = (struct lw_scaling_target){.error = 0.1, .best = {1, 1}};
    x->target[1] = (struct lw_scaling_target){.error = 0.02, .best = {-1, -1}};
    x->target_count = 2;
}

/* One user and eight, in two repeats that differ by a tenth. */
static void set_users(struct lw_scaling *x) {
    static const uint32_t users[] = {1, 8};
    for (uint32_t c = 0; c < 2; c++) {
        struct lw_scaling_count *count = &x->count[c];
        count->users = users[c];
        for (uint32_t i = 0; i < REPEATS; i++) {
            count->cost_s[LW_SCALING_PATHS][i] = 2 * users[c] * (1 + 0.1 * i);
            count->cost_s[LW_SCALING_SHARED][i] = 1 + 0.1 * users[c];
        }
        count->cost = (struct lw_cost){.cpu_s = {[LW_STAGE_SOLVE] = 1, [LW_STAGE_COMPOSE] = 0.1 * users[c]},
                                       .bytes = 5000.0 * users[c]};
        count->ratio = (struct lw_scaling_figure){(1 + 0.1 * users[c]) / (2 * users[c]), 0.01};
    }
    x->options.users[0] = 1;
    x->options.users[1] = 8;
    x->options.user_counts = x->count_done = 2;
    x->options.base.repeats = x->repeats_done = REPEATS;
    for (int s = 0; s < LW_SCALING_SIDES; s++) {
        x->chosen[s] = x->side[s].point[1].setting;
        x->chosen_error[s] = x->side[s].point[1].error;
    }
    for (uint32_t i = 0; i < REPEATS; i++) {
        x->shared_error[i] = 0.09 + 0.01 * i;
        x->paths_error[i] = 0.1 + 0.01 * i;
    }
    x->first_ratio = x->count[0].ratio;
    x->marginal = (struct lw_scaling_figure){0.05, 0.002};
    x->crossover = (struct lw_scaling_figure){0.53, 0.01};
}

/* A run by hand. Finish it with lw_scaling_finish(). */
static struct lw_scaling *make_run(const char *name) {
    struct lw_scaling *x = &scaling;
    struct lw_error err = {0};
    *x = (struct lw_scaling){.stride = 2, .eyes = 2, .lag_error = 1};
    x->options.base = (struct lw_measure_options){.scene = {.path = "builtin:hand"},
                                                  .folder = lw_support_temporary(name),
                                                  .motion = LW_SCENE_MOTION_LIGHT,
                                                  .width = 64,
                                                  .height = 36,
                                                  .bounces = 2};
    x->options.spread = 0.5;
    x->options.denoise = true;
    x->options.opponent = LW_PATH_RENDERER_SVGF;
    x->base.options = &x->options.base;
    x->base.densities.triangles = 12;
    x->base.densities.texels_per_metre = 4;
    x->base.densities.report.light = "lamp";
    lw_support_ok(lw_measure_store_open(&x->base.store, x->options.base.folder, false, &err), &err);
    lw_support_ok(lw_measure_store_set(&x->base.store, "command", "lightwell-load scaling", &err), &err);
    lw_support_ok(lw_measure_store_set(&x->base.store, "machine", "a processor", &err), &err);
    lw_support_ok(lw_measure_store_set(&x->base.store, "day", "2026-01-02", &err), &err);
    set_sides(x);
    set_users(x);
    return x;
}

static char *file_of(const struct lw_scaling *x, const char *name) {
    struct lw_error err = {0};
    lw_support_ok(lw_scaling_report_write(x, &err), &err);
    return lw_support_read_text(x->options.base.folder, name);
}

static void assert_says(const char *report, const char *text) {
    if (!strstr(report, text)) fail_msg("no \"%s\" in %s", text, report);
}

static void the_report_has_its_origin_and_its_result(void **state) {
    (void)state;
    struct lw_scaling *x = make_run("report");
    char *report = file_of(x, "report.md");
    assert_says(report, "# Scaling run: builtin:hand\n\n    lightwell-load scaling\n\na processor, "
                        "2026-01-02.\n\n12 triangles, 4 lightmap texels per metre");
    assert_says(report, "* one shared solve over path tracers, 1 user: **r = 0.55 ± 0.01**\n");
    assert_says(report, "\n* one more user over one more path tracer: **m = 0.05 ± 0.002**\n");
    assert_says(report, "from the **first** user on (the lines cross at 0.53 ± 0.01)\n");
    assert_says(report,
                "In the repeats, with 1 of the users: 0.09, 0.1, where the path tracer has 0.1, 0.11");
    free(report);
    lw_scaling_finish(x);
}

static void tables_are_whole(void **state) {
    (void)state;
    struct lw_scaling *x = make_run("tables");
    char *report = file_of(x, "report.md");
    assert_says(report, "\n\n| users | path tracers, CPU s | shared, CPU s | ratio |\n|---|---|---|---|\n"
                        "| 1 | 2.1 | 1.1 | 0.55 ± 0.01 |\n| 8 | 16.8 | 1.8 | 0.113 ± 0.01 |\n\n");
    assert_says(report, "\n\n| stage | 1 user | 8 users |\n|---|---|---|\n| solve | 1e+03 | 1e+03 |\n"
                        "| compose | 100 | 800 |\n\n");
    assert_says(report, "\n\n| relMSE | path tracer | CPU s | shared | CPU s | ratio |\n"
                        "|---|---|---|---|---|---|\n| 0.1 | 4 paths per pixel | 2 | density ×1, 1 + 2 "
                        "samples, target error 0.02 | 1 | 0.5 |\n"
                        "| 0.02 | not reached | – | not reached | – | – |\n\n");
    assert_says(report, "\n\n| side | setting | relMSE | CPU s per frame | path tracer at that cost |\n"
                        "|---|---|---|---|---|\n| svgf | 1 path per pixel | 0.4 | 0.5 |  |\n");
    assert_says(report, "target error 0.2 | 0.3 | 0.25 | no picture |\n");
    assert_says(report, "target error 0.02 | 0.09 | 1 | 0.2 |\n\n");
    free(report);
    lw_scaling_finish(x);
}

/* Light that is a second late must err by three times the first target, 0.1. */
static void a_run_that_does_not_test_motion_says_so(void **state) {
    (void)state;
    struct lw_scaling *x = make_run("late");
    x->lag_error = 0.29;
    char *report = file_of(x, "report.md");
    assert_says(report, "has relMSE 0.29 in these views");
    assert_says(report, "under 3 times the error asked for: this run does not test motion.**");
    free(report);
    x->lag_error = 0.31;
    report = file_of(x, "report.md");
    assert_null(strstr(report, "does not test motion"));
    free(report);
    lw_scaling_finish(x);
}

static void other_files_have_the_same_figures(void **state) {
    (void)state;
    struct lw_scaling *x = make_run("files");
    char *users = file_of(x, "scaling.csv"),
         *points = lw_support_read_text(x->options.base.folder, "settings.csv"),
         *json = lw_support_read_text(x->options.base.folder, "scaling.json"),
         *plots = lw_support_read_text(x->options.base.folder, "scaling.gp");
    assert_says(users, "users,repeat,paths_cpu_s_per_frame,shared_cpu_s_per_frame,ratio,mean ");
    assert_says(users, "\n1,2,2.2,1.1,0.5,");
    assert_says(points, "\npaths,4,0,0,0,0,0.1,2\n");
    assert_says(points, "\nshared,0,1,1,2,0.02,0.09,1\n");
    assert_says(json, "\"command\": \"lightwell-load scaling\"");
    assert_says(json, "\"marginal\": {\n  \"mean\": 0.05,\n  \"half_width_95\": 0.002\n }");
    assert_says(plots, "set output 'cost.png'\n");
    assert_says(plots, "set output 'error.svg'\nreplot\n");
    free(plots);
    free(json);
    free(points);
    free(users);
    lw_scaling_finish(x);
}

static void a_run_without_users_says_why(void **state) {
    (void)state;
    struct lw_scaling *x = make_run("shortfall");
    x->shortfall = "the path tracer did not reach the error";
    x->repeats_done = x->count_done = 0;
    char *report = file_of(x, "report.md"),
         *plots = lw_support_read_text(x->options.base.folder, "scaling.gp");
    assert_says(report, "**No figures for counts of users: the path tracer did not reach the error.**\n\n");
    assert_null(strstr(report, "## Result"));
    assert_says(report, "\n## Error and cost\n");
    assert_null(strstr(plots, "cost.png"));
    free(plots);
    free(report);
    lw_scaling_finish(x);
}

int main(void) {
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(the_report_has_its_origin_and_its_result), cmocka_unit_test(tables_are_whole),
        cmocka_unit_test(a_run_that_does_not_test_motion_says_so),
        cmocka_unit_test(other_files_have_the_same_figures), cmocka_unit_test(a_run_without_users_says_why)};
    return cmocka_run_group_tests(tests, NULL, NULL);
}
