#include "tests/support/support.h"

#include "common/base/progress.h"

#include <pthread.h>

static void assert_is(const struct lw_waiting *waiting, enum lw_waiting_stage stage, float share) {
    const struct lw_waiting_state now = lw_waiting_read(waiting);
    assert_int_equal(now.stage, stage);
    assert_true(now.share == share);
}

static void test_it_only_grows(void **state) {
    (void)state;
    struct lw_waiting waiting = {0};
    assert_is(&waiting, LW_WAITING_UNKNOWN, 0);
    lw_waiting_raise(&waiting, LW_WAITING_LOOKING_INSIDE, 42, 100);
    assert_is(&waiting, LW_WAITING_LOOKING_INSIDE, 0.42f);
    lw_waiting_raise(&waiting, LW_WAITING_LOOKING_INSIDE, 41, 100);
    assert_is(&waiting, LW_WAITING_LOOKING_INSIDE, 0.42f);
    lw_waiting_raise(&waiting, LW_WAITING_PLACING_TEXELS, 100, 100);
    assert_is(&waiting, LW_WAITING_LOOKING_INSIDE, 0.42f);
    lw_waiting_raise(&waiting, LW_WAITING_FIRST_LIGHT, 0, 100);
    assert_is(&waiting, LW_WAITING_FIRST_LIGHT, 0);
    lw_waiting_raise(&waiting, LW_WAITING_FIRST_LIGHT, 200, 100); /* more steps than were announced */
    assert_is(&waiting, LW_WAITING_FIRST_LIGHT, 1);
    lw_waiting_raise(&waiting, LW_WAITING_READY, 1, 1);
    assert_is(&waiting, LW_WAITING_READY, 1);
}

/* All is 1 and nothing less is. */
static void test_hundredths(void **state) {
    (void)state;
    struct lw_waiting waiting = {0};
    lw_waiting_raise(&waiting, LW_WAITING_FIRST_LIGHT, 999, 0); /* nobody knows how many there are */
    assert_is(&waiting, LW_WAITING_FIRST_LIGHT, 0);
    lw_waiting_raise(&waiting, LW_WAITING_FIRST_LIGHT, UINT64_MAX - (UINT64_MAX >> 7), UINT64_MAX);
    assert_is(&waiting, LW_WAITING_FIRST_LIGHT, 0.99f);
    for (uint64_t done = 0; done <= 1000; done++) {
        struct lw_waiting other = {0};
        lw_waiting_raise(&other, LW_WAITING_FIRST_LIGHT, done, 1000);
        assert_true(lw_waiting_read(&other).share <= 1e-3f * (float)done + 1e-6f);
        assert_true(lw_waiting_read(&other).share > 1e-3f * (float)done - 0.011f);
        assert_true((lw_waiting_read(&other).share == 1) == (done == 1000));
    }
}

/* The first light of several layers is one stage. */
static void test_parts(void **state) {
    (void)state;
    struct lw_waiting waiting = {0};
    lw_waiting_set_part(&waiting, 0, 4);
    lw_waiting_raise(&waiting, LW_WAITING_LOOKING_INSIDE, 1, 2); /* it has no parts */
    assert_is(&waiting, LW_WAITING_LOOKING_INSIDE, 0.5f);
    lw_waiting_raise(&waiting, LW_WAITING_FIRST_LIGHT, 10, 10);
    assert_is(&waiting, LW_WAITING_FIRST_LIGHT, 0.25f);
    lw_waiting_set_part(&waiting, 3, 4);
    lw_waiting_raise(&waiting, LW_WAITING_FIRST_LIGHT, 0, 10);
    assert_is(&waiting, LW_WAITING_FIRST_LIGHT, 0.75f);
    lw_waiting_raise(&waiting, LW_WAITING_FIRST_LIGHT, 10, 10);
    assert_is(&waiting, LW_WAITING_FIRST_LIGHT, 1);
}

#define STEPS 20000u

static void *step(void *progress) {
    for (unsigned i = 0; i < STEPS; i++) lw_progress_step(progress, 1);
    return NULL;
}

/* Several threads step, another one reads; what it reads never falls. */
static void test_a_stage_of_several_threads(void **state) {
    (void)state;
    struct lw_waiting waiting = {0};
    struct lw_progress progress;
    pthread_t thread[2];
    lw_progress_init_waiting(&progress, "looking inside objects", 2 * STEPS, &waiting,
                             LW_WAITING_LOOKING_INSIDE);
    assert_is(&waiting, LW_WAITING_LOOKING_INSIDE, 0);
    for (int i = 0; i < 2; i++) assert_int_equal(pthread_create(&thread[i], NULL, step, &progress), 0);
    for (float share = 0, now; share < 1; share = now) {
        now = lw_waiting_read(&waiting).share;
        assert_true(now >= share);
    }
    for (int i = 0; i < 2; i++) assert_int_equal(pthread_join(thread[i], NULL), 0);
    lw_progress_finish(&progress);
    lw_progress_init(&progress, "another stage", 1); /* which nobody waits for */
    lw_progress_step(&progress, 1);
    assert_is(&waiting, LW_WAITING_LOOKING_INSIDE, 1);
}

static void assert_line(uint32_t stage, float share, const char *expected) {
    char line[LW_WAITING_LINE_SIZE];
    lw_waiting_line(stage, share, line);
    assert_string_equal(line, expected);
}

static void test_lines(void **state) {
    (void)state;
    assert_line(LW_WAITING_UNKNOWN, 0, "waiting for the first light");
    assert_line(LW_WAITING_PLACING_TEXELS, 0, "placing texels, 0 %");
    assert_line(LW_WAITING_LOOKING_INSIDE, 0.29f, "looking inside objects, 29 %");
    assert_line(LW_WAITING_LOOKING_INSIDE, 1, "looking inside objects, 100 %");
    assert_line(LW_WAITING_FIRST_LIGHT, 0.17f, "first light, 17 %");
    assert_line(LW_WAITING_READY, 1, "ready");
    assert_line(77, 0.5f, "waiting for the first light"); /* a newer server's stage */
    lw_waiting_raise(NULL, LW_WAITING_READY, 1, 1);
    lw_waiting_set_part(NULL, 0, 1);
}

int main(void) {
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(test_it_only_grows), cmocka_unit_test(test_hundredths),
        cmocka_unit_test(test_parts),         cmocka_unit_test(test_a_stage_of_several_threads),
        cmocka_unit_test(test_lines),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
