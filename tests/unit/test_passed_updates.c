/* Updates that a relay forwards: in order, answered once, with the frame that shows them. */
#include "tests/support/support.h"

#include "server/serve/sessions/passed_updates.h"

#include <stdlib.h>
#include <string.h>

/* Sessions are told apart by their addresses alone. */
static char session_memory[2];
static struct lw_session *session(int i) { return (struct lw_session *)(void *)&session_memory[i]; }

static struct lw_passed_updates updates;

static int begin(void **state) {
    (void)state;
    lw_support_ok(lw_passed_updates_init(&updates), NULL);
    return 0;
}

static int end(void **state) {
    (void)state;
    lw_passed_updates_finish(&updates);
    return 0;
}

static bool add(int i, uint64_t request, size_t changes) {
    static struct lw_scene_change change[LW_MESSAGE_CHANGES_MAX];
    return lw_passed_updates_add(&updates, session(i), NULL,
                                 &(struct lw_message_update){request, change, changes});
}

static uint64_t take_number(void) {
    struct lw_passed_update update;
    if (!lw_passed_updates_take(&updates, &update)) return 0;
    free(update.change);
    return update.number;
}

static void answer(uint64_t number, uint32_t code, uint64_t frame) {
    const uint32_t added[2] = {7, 9};
    assert_true(lw_passed_updates_answer(&updates, number,
                                         &(struct lw_message_updated){.request = 1000,
                                                                      .code = code,
                                                                      .text = code ? "no" : "",
                                                                      .frame = frame,
                                                                      .added = added,
                                                                      .added_count = code ? 0 : 2}));
}

/* The next answer at a frame: its request; 0: there is none. */
static uint64_t next(uint64_t frame) {
    struct lw_passed_updates_done done;
    if (!lw_passed_updates_next(&updates, frame, &done)) return 0;
    const uint64_t request = done.is_lost ? UINT64_MAX : done.answer.request;
    if (!done.is_lost && !done.answer.code) {
        assert_int_equal(done.answer.added_count, 2);
        assert_true(done.answer.added[0] == 7 && done.answer.added[1] == 9);
    }
    if (!done.is_lost && done.answer.code) assert_string_equal(done.answer.text, "no");
    free(done.storage);
    return request;
}

static void success_comes_with_its_frame(void **state) {
    (void)state;
    assert_false(updates.waiting);
    for (uint64_t i = 1; i <= 4; i++) assert_true(add(0, 10 * i, 1));
    assert_true(updates.waiting);
    for (uint64_t i = 1; i <= 4; i++) assert_int_equal(take_number(), i);
    assert_int_equal(take_number(), 0);
    assert_false(updates.waiting);
    assert_int_equal(next(100), 0);
    answer(1, 0, 5);
    answer(2, 0, 5);
    answer(3, LW_SCENE_CHANGE_UNKNOWN_TARGET, 0);
    answer(1, LW_SCENE_CHANGE_BUSY, 0); /* a second answer means nothing */
    answer(99, 0, 1);                   /* nor does one to nothing */
    assert_int_equal(next(4), 30);      /* a refusal at once */
    assert_int_equal(next(4), 0);
    assert_int_equal(next(5), 10);
    assert_int_equal(next(5), 20);
    assert_int_equal(next(5), 0);
    lw_passed_updates_lose(&updates, 4);
    assert_int_equal(next(5), UINT64_MAX);
    assert_int_equal(next(5), 0);
}

/* Answers wait for frames of a run that has ended. Frames of the next run have greater numbers, and do not
 * show the changes. */
static void another_run_shows_no_change_of_the_last_one(void **state) {
    (void)state;
    const uint64_t run = UINT64_C(1) << 32;
    for (uint64_t i = 1; i <= 4; i++) assert_true(add(0, 10 * i, 1));
    for (uint64_t i = 1; i <= 4; i++) assert_int_equal(take_number(), i);
    answer(1, 0, 5);
    answer(2, 0, 6);
    assert_int_equal(next(5), 10);
    answer(3, LW_SCENE_CHANGE_UNKNOWN_TARGET, 0);
    answer(4, 0, run + 2); /* made by the next run */
    assert_int_equal(next(run + 1), UINT64_MAX);
    assert_int_equal(next(run + 1), 30);
    assert_int_equal(next(run + 1), 0);
    assert_int_equal(next(run + 2), 40);
    assert_int_equal(updates.entry_count, 0);
}

static void a_session_that_is_gone_hears_nothing(void **state) {
    (void)state;
    assert_true(add(0, 1, 1) && add(1, 2, 1) && add(0, 3, 1));
    assert_int_equal(take_number(), 1);
    lw_passed_updates_forget(&updates, session(0));
    assert_int_equal(take_number(), 2);
    assert_int_equal(take_number(), 3); /* it goes on all the same */
    for (uint64_t i = 1; i <= 3; i++) answer(i, 0, 1);
    assert_int_equal(next(1), 2);
    assert_int_equal(next(1), 0);
    assert_int_equal(updates.entry_count, 0);
}

static void there_are_limits(void **state) {
    (void)state;
    const unsigned most = LW_PASSED_UPDATES_CHANGES_MAX / LW_MESSAGE_CHANGES_MAX;
    for (unsigned i = 0; i < most; i++) assert_true(add(0, i, LW_MESSAGE_CHANGES_MAX));
    assert_false(add(0, 1, 1));
    assert_true(add(0, 1, 0));
    assert_int_equal(take_number(), 1); /* a taken update is the taker's */
    assert_true(add(0, 1, LW_MESSAGE_CHANGES_MAX));
    while (updates.entry_count < LW_PASSED_UPDATES_MAX) assert_true(add(0, 1, 0));
    assert_false(add(0, 1, 0));
}

int main(void) {
    const struct CMUnitTest tests[] = {
        cmocka_unit_test_setup_teardown(success_comes_with_its_frame, begin, end),
        cmocka_unit_test_setup_teardown(another_run_shows_no_change_of_the_last_one, begin, end),
        cmocka_unit_test_setup_teardown(a_session_that_is_gone_hears_nothing, begin, end),
        cmocka_unit_test_setup_teardown(there_are_limits, begin, end),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
