#include "tests/support/support.h"

#include "client/measure/crossover_row.h"

#include <math.h>
#include <signal.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/resource.h>
#include <unistd.h>

static struct lw_measure_unit unit(const char *renderer, uint32_t repeat) {
    struct lw_measure_unit u = {.setting = "x0.5 1+2 rest 0.02", .repeat = repeat};
    snprintf(u.renderer, sizeof u.renderer, "%s", renderer);
    return u;
}

/* Two views, two lines of costs. */
static enum lw_status append(struct lw_measure_store *store, const struct lw_measure_unit *u,
                             struct lw_error *err) {
    struct lw_measure_sample sample[2] = {
        {.unit = *u, .view = 1, .frame = 61, .coin = {0.25, 0.5, 0.125, 0.0625, (double)NAN}},
        {.unit = *u, .view = 11, .frame = 62, .coin = {-1e-5, 1, 2, 3, 4}}};
    struct lw_measure_expense expense[2] = {lw_measure_store_expense(u, 1, 1),
                                            lw_measure_store_expense(u, 12, LW_MEASURE_ALL)};
    expense[0].cpu_s[LW_STAGE_SOLVE] = 0.5;
    expense[1].cpu_s[LW_STAGE_SOLVE] = 0.75;
    expense[1].extra[LW_MEASURE_EXTRA_BYTES] = 1000;
    expense[1].samples = 2;
    return lw_measure_store_append(store, sample, 2, expense, 2, err);
}

static void open_store(struct lw_measure_store *store, const char *folder) {
    struct lw_error err = {0};
    lw_support_ok(lw_measure_store_open(store, folder, false, &err), &err);
}

/* A row with units `a` and `b`. */
static const char *make_row(const char *name) {
    const char *folder = lw_support_temporary(name);
    struct lw_measure_store store;
    struct lw_error err = {0};
    const struct lw_measure_unit a = unit("svgf", 0), b = unit("cache", 1);
    open_store(&store, folder);
    assert_false(lw_measure_store_has(&store, &a));
    lw_support_ok(append(&store, &a, &err), &err);
    lw_support_ok(append(&store, &b, &err), &err);
    lw_measure_store_finish(&store);
    return folder;
}

/* Lines of counts of users stand before the line that ends a unit; the last repeat is the 20th's. */
static void counts_of_users_are_there_again(void **state) {
    (void)state;
    const char *folder = lw_support_temporary("counts");
    const struct lw_measure_unit u = unit("cache", LW_MEASURE_REPEATS_MAX - 1);
    struct lw_measure_expense expense[2] = {lw_measure_store_expense(&u, 1, LW_MEASURE_SOME),
                                            lw_measure_store_expense(&u, 256, LW_MEASURE_ALL)};
    struct lw_measure_store store;
    struct lw_error err = {0};
    expense[1].extra[LW_MEASURE_EXTRA_RAYS] = 7;
    expense[1].cpu_s[LW_STAGE_SEND] = 0.25;
    open_store(&store, folder);
    lw_support_ok(lw_measure_store_append(&store, NULL, 0, expense, 2, &err), &err);
    lw_measure_store_finish(&store);
    open_store(&store, folder);
    assert_true(lw_measure_store_has(&store, &u));
    assert_int_equal(store.expense_count, 2);
    assert_true(store.expense[0].view == LW_MEASURE_SOME && store.expense[0].users == 1);
    assert_true(store.expense[1].view == LW_MEASURE_ALL && store.expense[1].users == 256);
    const struct lw_cost cost = lw_measure_store_cost(&store.expense[1]);
    assert_true(cost.cpu_s[LW_STAGE_SEND] == 0.25 && cost.rays == 7 && cost.bytes == 0);
    lw_measure_store_finish(&store);
}

static void settings_have_names(void **state) {
    (void)state;
    char name[LW_MEASURE_NAME_SIZE];
    lw_measure_store_setting(&(struct lw_setting){.samples = 1}, false, name);
    assert_string_equal(name, "1 path");
    lw_measure_store_setting(&(struct lw_setting){.samples = 20}, false, name);
    assert_string_equal(name, "20 paths");
    const struct lw_setting setting = {.density = 0.25,
                                       .direct_samples = 16,
                                       .indirect_samples = 32,
                                       .target_error = 0.02,
                                       .by_gl = true,
                                       .whole = true};
    lw_measure_store_setting(&setting, true, name);
    assert_string_equal(name, "x0.25 16+32 rest 0.02 tiles gl whole");
}

static void path_of(const char *folder, const char *name, char out[300]) {
    snprintf(out, 300, "%s/%s", folder, name);
}

/* Takes bytes off a file's end. */
static void cut(const char *folder, const char *name, size_t bytes) {
    char path[300];
    size_t size;
    path_of(folder, name, path);
    free(lw_support_read_file(path, &size));
    assert_int_equal(truncate(path, (off_t)(size - bytes)), 0);
}

static void what_was_measured_is_there_again(void **state) {
    (void)state;
    const char *folder = make_row("row");
    const struct lw_measure_unit a = unit("svgf", 0), b = unit("cache", 1), c = unit("cache", 0);
    struct lw_measure_store store;
    open_store(&store, folder);
    assert_true(lw_measure_store_has(&store, &a) && lw_measure_store_has(&store, &b));
    assert_false(lw_measure_store_has(&store, &c));
    assert_int_equal(store.sample_count, 4);
    assert_int_equal(store.expense_count, 4);
    assert_true(store.sample[0].coin[0] == 0.25 && isnan(store.sample[0].coin[4]) &&
                store.sample[0].view == 1);
    assert_true(store.sample[3].coin[0] == -1e-5 && store.sample[3].frame == 62);
    assert_true(store.expense[1].view == LW_MEASURE_ALL && store.expense[1].users == 12);
    assert_true(store.expense[1].cpu_s[LW_STAGE_SOLVE] == 0.75 &&
                lw_measure_store_total(&store.expense[1]) == 0.75);
    assert_true(store.expense[1].extra[LW_MEASURE_EXTRA_BYTES] == 1000);
    assert_true(isnan(store.expense[1].extra[LW_MEASURE_EXTRA_RAYS]));
    lw_measure_store_finish(&store);
}

/* Where a run was cut off, that unit is measured again, and nothing of it counts twice. */
static void a_unit_that_was_cut_off_is_measured_again(void **state) {
    (void)state;
    static const struct {
        const char *name, *file;
        size_t bytes;
    } cuts[] = {
        {"cut1", "costs.csv", 1},    /* the end of the last line */
        {"cut2", "costs.csv", 30},   /* in the middle of the last line */
        {"cut3", "samples.csv", 1},  /* costs are there, a sample is not */
        {"cut4", "samples.csv", 60}, /* both of them */
    };
    const struct lw_measure_unit a = unit("svgf", 0), b = unit("cache", 1);
    for (size_t i = 0; i < sizeof cuts / sizeof *cuts; i++) {
        const char *folder = make_row(cuts[i].name);
        struct lw_measure_store store;
        struct lw_error err = {0};
        cut(folder, cuts[i].file, cuts[i].bytes);
        open_store(&store, folder);
        assert_true(lw_measure_store_has(&store, &a));
        assert_false(lw_measure_store_has(&store, &b));
        assert_int_equal(store.sample_count, 2);
        assert_int_equal(store.expense_count, 2);
        lw_support_ok(append(&store, &b, &err), &err);
        lw_measure_store_finish(&store);
        open_store(&store, folder);
        assert_true(lw_measure_store_has(&store, &b));
        assert_int_equal(store.sample_count, 4);
        assert_int_equal(store.expense_count, 4);
        lw_measure_store_finish(&store);
    }
}

static void other_tables_are_refused_by_line(void **state) {
    (void)state;
    const char *folder = make_row("other");
    char path[300];
    struct lw_measure_store store;
    struct lw_error err = {0};
    path_of(folder, "costs.csv", path);
    FILE *f = fopen(path, "a");
    fprintf(f, "svgf,1 path,x\n");
    fclose(f);
    lw_support_fails(lw_measure_store_open(&store, folder, false, &err), LW_BAD_DATA, &err,
                     "costs.csv, line 6: not a cost");
    lw_measure_store_finish(&store);
    lw_support_write_file(path, "a,b,c\n", 6);
    err = (struct lw_error){0};
    lw_support_fails(lw_measure_store_open(&store, folder, true, &err), LW_BAD_DATA, &err,
                     "costs.csv, line 1: other columns");
    lw_measure_store_finish(&store);
    err = (struct lw_error){0};
    lw_support_fails(lw_measure_store_open(&store, "/nowhere/at/all", true, &err), LW_NO_INPUT, &err,
                     "/nowhere/at/all");
    lw_measure_store_finish(&store);
}

/* A limit on a file's size stands for a disk that is full. */
/* A line of a table must have its columns: all, no more, each within its limit. */
static void lines_that_are_none_are_refused(void **state) {
    (void)state;
    static const struct {
        const char *file, *line, *fault;
    } cases[] = {{"late.csv", "view,frame,late,relmse\n3,61,30\n", "line 2: not an error of late light"},
                 {"late.csv", "view,frame,late,relmse\n3,61,30,1,2\n", "line 2: not an error of late light"},
                 {"late.csv", "view,frame,late,relmse\n12,61,30,1\n", "line 2: not an error of late light"},
                 {"late.csv", "view,frame,late,relmse\n3,-1,30,1\n", "line 2: not an error of late light"},
                 {"late.csv", "view,frame,late,relmse\n3,61,30,1x\n", "line 2: not an error of late light"},
                 {"late.csv", "view,frame,late\n", "line 1: other columns than this version writes"},
                 {"row.csv", "scene\n", "line 1: not KEY,VALUE"},
                 {"failures.csv", "cache,x1,0\n", "line 1: not a failure"},
                 {"failures.csv", "cache,x1,21,why\n", "line 1: not a failure"}};
    const char *folder = make_row("lines");
    for (size_t i = 0; i < sizeof cases / sizeof *cases; i++) {
        struct lw_measure_store store;
        struct lw_error err = {0};
        char path[300];
        path_of(folder, cases[i].file, path);
        FILE *f = fopen(path, "we");
        assert_non_null(f);
        fprintf(f, "%s", cases[i].line);
        fclose(f);
        lw_support_fails(lw_measure_store_open(&store, folder, true, &err), LW_BAD_DATA, &err,
                         cases[i].fault);
        lw_measure_store_finish(&store);
        assert_int_equal(unlink(path), 0);
    }
}

static void a_full_disk_takes_nothing_away(void **state) {
    (void)state;
    const char *folder = make_row("full");
    const struct lw_measure_unit a = unit("svgf", 0), c = unit("cache", 2);
    struct lw_measure_store store;
    struct lw_error err = {0};
    struct rlimit before;
    char path[300];
    size_t size;
    path_of(folder, "samples.csv", path);
    free(lw_support_read_file(path, &size));
    open_store(&store, folder);
    assert_int_equal(getrlimit(RLIMIT_FSIZE, &before), 0);
    signal(SIGXFSZ, SIG_IGN);
    assert_int_equal(setrlimit(RLIMIT_FSIZE, &(struct rlimit){size + 20, before.rlim_max}), 0);
    const enum lw_status status = append(&store, &c, &err);
    assert_int_equal(setrlimit(RLIMIT_FSIZE, &before), 0);
    lw_support_fails(status, LW_IO, &err, "samples.csv: cannot write");
    assert_false(lw_measure_store_has(&store, &c));
    lw_measure_store_finish(&store);
    size_t after;
    free(lw_support_read_file(path, &after));
    assert_int_equal(after, size);
    open_store(&store, folder);
    assert_true(lw_measure_store_has(&store, &a));
    assert_int_equal(store.expense_count, 4);
    lw_measure_store_finish(&store);
}

static void notes_and_failures_stay(void **state) {
    (void)state;
    const char *folder = lw_support_temporary("notes");
    const struct lw_measure_unit a = unit("cache", 0), b = unit("cache", 1);
    struct lw_measure_store store;
    struct lw_error err = {0};
    open_store(&store, folder);
    lw_support_ok(lw_measure_store_set(&store, "scene", "a, b\nc", &err), &err);
    lw_support_ok(lw_measure_store_set(&store, "scene", "d, e\nf", &err), &err);
    lw_support_ok(lw_measure_store_fail(&store, &a, "lightwelld has ended, alas", &err), &err);
    lw_support_ok(lw_measure_store_fail(&store, &b, "timed out", &err), &err);
    lw_support_ok(lw_measure_store_fail(&store, &b, NULL, &err), &err);
    const struct lw_measure_late late[2] = {{.view = 3, .frame = 61, .late = 30, .relmse = 0.5},
                                            {.view = 4, .frame = 61, .late = 30, .relmse = (double)NAN}};
    lw_support_ok(lw_measure_store_set_late(&store, late, 2, &err), &err);
    lw_measure_store_finish(&store);
    open_store(&store, folder);
    assert_string_equal(lw_measure_store_get(&store, "scene"), "d, e?f");
    assert_null(lw_measure_store_get(&store, "motion"));
    assert_int_equal(store.failure_count, 1);
    assert_string_equal(store.failure[0].text, "lightwelld has ended, alas");
    assert_int_equal(store.late_count, 2);
    assert_true(store.late[0].relmse == 0.5 && store.late[0].view == 3);
    assert_true(isnan(store.late[1].relmse) && store.late[1].view == 4);
    lw_measure_store_finish(&store);
}

/* Flicker is known in view 11 alone. One repeat has another relMSE there. */
static void means_are_of_what_was_asked_for(void **state) {
    (void)state;
    struct lw_measure_store store;
    struct lw_error err = {0};
    struct lw_measure_unit one = unit("cache", 0), other = unit("cache", 1),
                           any = unit("cache", LW_MEASURE_ALL);
    const uint32_t all = LW_MEASURE_ALL;
    open_store(&store, make_row("means"));
    lw_support_ok(append(&store, &one, &err), &err);
    store.sample[store.sample_count - 1].coin[0] = 4;
    assert_true(lw_measure_store_mean(&store, &one, all, all, LW_MEASURE_COIN_RELMSE) == (0.25 + 4) / 2);
    assert_true(lw_measure_store_mean(&store, &one, 11, all, LW_MEASURE_COIN_RELMSE) == 4);
    assert_true(lw_measure_store_mean(&store, &other, all, 61, LW_MEASURE_COIN_RELMSE) == 0.25);
    assert_true(fabs(lw_measure_store_mean(&store, &any, 11, all, LW_MEASURE_COIN_RELMSE) - 2) < 1e-4);
    assert_true(lw_measure_store_mean(&store, &any, all, all, LW_MEASURE_COIN_FLICKER) == 4);
    assert_true(isnan(lw_measure_store_mean(&store, &any, 1, all, LW_MEASURE_COIN_FLICKER)));
    assert_true(isnan(lw_measure_store_mean(&store, &any, 2, all, LW_MEASURE_COIN_RELMSE)));
    lw_measure_store_finish(&store);
}

static void a_list_has_whole_entries(void **state) {
    (void)state;
    const char *list = "x1 1+2 rest 0.02 tiles; x2 1+2 rest 0.02";
    assert_true(lw_measure_store_lists(list, "x1 1+2 rest 0.02 tiles"));
    assert_true(lw_measure_store_lists(list, "x2 1+2 rest 0.02"));
    assert_false(lw_measure_store_lists(list, "x1 1+2 rest 0.02"));
    assert_false(lw_measure_store_lists(list, "2 1+2 rest 0.02"));
    assert_false(lw_measure_store_lists(list, "x2 1+2 rest 0.02 tiles"));
    assert_false(lw_measure_store_lists("", "x2 1+2 rest 0.02"));
}

/* Goes as far as opening the scene, which is not there: options are compared before. */
static void run_row(const char *folder, const struct lw_crossover_options *options, const char *refused) {
    struct lw_crossover_row row;
    struct lw_crossover_options o = *options;
    struct lw_error err = {0};
    _Atomic bool cancel = false;
    o.base.folder = folder;
    const enum lw_status status = lw_crossover_row_open(&row, &o, "command", &cancel, &err);
    lw_crossover_row_finish(&row);
    if (refused)
        lw_support_fails(status, LW_USAGE, &err, refused);
    else
        assert_true(status != LW_OK && !strstr(err.text, "holds a row"));
}

static void another_row_is_refused_by_what_differs(void **state) {
    (void)state;
    const struct lw_crossover_options first = {
        .base = {.scene = {.path = "none.lwscene", .sun_angle_deg = 0.53}, .width = 64, .height = 36},
        .minutes_max = (double)INFINITY};
    struct lw_crossover_options other = first;
    struct lw_measure_store store;
    struct lw_error err = {0};
    const char *folder = lw_support_temporary("bound");
    run_row(folder, &first, NULL);
    run_row(folder, &first, NULL);
    other.base.scene.sky_given = true;
    other.base.scene.sky[1] = 0.5f;
    run_row(folder, &other, "whose sky is the scene's, not 0,0.5,0");
    other = first;
    other.base.scene.environment = "day.exr";
    run_row(folder, &other, "whose environment is the scene's, not day.exr");
    other = first;
    other.base.scene.sun_angle_given = true;
    run_row(folder, &other, "whose sun-angle is the scene's, not 0.53");
    other = first;
    other.base.scene.atlas_side_max = 512;
    run_row(folder, &other, "whose atlas-max is the default, not 512");
    other = first;
    other.base.scene.density_of = "floor=2";
    run_row(folder, &other, "whose density-of is none, not floor=2");
    run_row(folder, &first, NULL);
    lw_support_ok(lw_measure_store_open(&store, folder, false, &err), &err);
    lw_support_ok(lw_measure_store_set(&store, "version", "0.0.1", &err), &err);
    lw_measure_store_finish(&store);
    run_row(folder, &first, "whose version is 0.0.1, not " LW_VERSION);
}

/* Written by a version without the newer columns. */
static void a_row_without_notes_is_refused_once_it_holds_figures(void **state) {
    (void)state;
    const struct lw_crossover_options o = {
        .base = {.scene = {.path = "none.lwscene"}, .width = 64, .height = 36}};
    struct lw_measure_store store;
    struct lw_error err = {0};
    const char *folder = lw_support_temporary("unbound");
    const struct lw_measure_unit unit = {.renderer = "raw", .setting = "1 path"};
    const struct lw_measure_expense all = lw_measure_store_expense(&unit, 1, LW_MEASURE_ALL);
    lw_support_ok(lw_measure_store_open(&store, folder, false, &err), &err);
    lw_support_ok(lw_measure_store_append(&store, NULL, 0, &all, 1, &err), &err);
    lw_measure_store_finish(&store);
    run_row(folder, &o, "holds a row that does not note its version");
}

int main(void) {
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(another_row_is_refused_by_what_differs),
        cmocka_unit_test(a_row_without_notes_is_refused_once_it_holds_figures),
        cmocka_unit_test(a_list_has_whole_entries),
        cmocka_unit_test(what_was_measured_is_there_again),
        cmocka_unit_test(counts_of_users_are_there_again),
        cmocka_unit_test(settings_have_names),
        cmocka_unit_test(a_unit_that_was_cut_off_is_measured_again),
        cmocka_unit_test(other_tables_are_refused_by_line),
        cmocka_unit_test(lines_that_are_none_are_refused),
        cmocka_unit_test(means_are_of_what_was_asked_for),
        cmocka_unit_test(a_full_disk_takes_nothing_away),
        cmocka_unit_test(notes_and_failures_stay),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
