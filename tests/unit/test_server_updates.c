#include "tests/support/serving.h"

#include "common/scene/scene_spares.h"
#include "server/serve/server.h"
#include "tests/support/server_clock.h"

#include <math.h>
#include <signal.h>
#include <stdlib.h>
#include <sys/socket.h>
#include <unistd.h>

/* Updates of the scene and their answers. */

/* ---- updates of the scene ---- */

static void expect_updated(int s, uint64_t request, uint32_t code, uint32_t change, uint64_t frame) {
    struct lw_message m;
    serving_expect(s, LW_MESSAGE_UPDATED, &m);
    assert_int_equal(m.updated.request, request);
    assert_int_equal(m.updated.code, code);
    assert_int_equal(m.updated.change, change);
    assert_int_equal(m.updated.frame, frame);
    assert_int_equal(*m.updated.text == 0, code == LW_SCENE_CHANGE_OK);
    lw_message_finish(&m);
}

static void expect_added(int s, uint64_t request, const uint32_t *object, size_t count) {
    struct lw_message m;
    serving_expect(s, LW_MESSAGE_UPDATED, &m);
    assert_int_equal(m.updated.request, request);
    assert_int_equal(m.updated.code, LW_SCENE_CHANGE_OK);
    assert_int_equal(m.updated.added_count, count);
    assert_memory_equal(m.updated.added, object, count * sizeof *object);
    lw_message_finish(&m);
}

static void test_updates_are_answered_with_their_frame(void **state) {
    (void)state;
    struct serving *f = serving_start_controlled();
    int s = serving_dial_and_control(f, true), other = serving_dial_and_stream(f);
    serving_update(s, 17, (struct lw_scene_change[]){serving_hide_1, serving_sky}, 2);
    serving_update(s, 18, NULL, 0);
    struct lw_scene_change *change = serving_take(f, 5, 2, 2);
    assert_memory_equal(&change[0], &serving_hide_1, sizeof serving_hide_1);
    assert_memory_equal(&change[1], &serving_sky, sizeof serving_sky);
    free(change);
    serving_expect_silence(s); /* taken, but not to be seen yet */
    serving_publish(f, serving_make_snapshot(f, 5, 0));
    serving_expect_frame(s, 5, 1); /* the frame before its answer */
    expect_updated(s, 17, LW_SCENE_CHANGE_OK, 0, 5);
    expect_updated(s, 18, LW_SCENE_CHANGE_OK, 0, 5);
    serving_expect_tiles(s, f->map.tile_count, 5);
    serving_expect_light(f, other, 5); /* nobody else hears of it */
    serving_update(s, 19, &serving_hide_1, 1);
    free(serving_take(f, 6, 1, 1)); /* the next frame overtakes this one */
    serving_publish(f, serving_make_snapshot(f, 7, 5));
    serving_expect_frame(s, 7, 2);
    expect_updated(s, 19, LW_SCENE_CHANGE_OK, 0, 6);
    serving_expect_frame(other, 7, 2);
    close(s);
    close(other);
    serving_end(f);
}

static void test_wrong_updates_are_answered_and_nothing_of_them_is_done(void **state) {
    (void)state;
    struct serving *f = serving_start_controlled();
    int s = serving_dial_and_control(f, false);
    struct lw_scene_change bad[] = {serving_hide_1, serving_no_such};
    serving_update(s, 1, bad, 2);
    expect_updated(s, 1, LW_SCENE_CHANGE_UNKNOWN_TARGET, 1, 0);
    struct lw_scene_change wrong = serving_sky;
    wrong.value[1] = NAN;
    serving_update(s, 2, &wrong, 1);
    expect_updated(s, 2, LW_SCENE_CHANGE_NOT_FINITE, 0, 0);
    wrong.value[1] = -1;
    serving_update(s, 3, &wrong, 1);
    expect_updated(s, 3, LW_SCENE_CHANGE_OUT_OF_RANGE, 0, 0);
    wrong = (struct lw_scene_change){4711, 0, 2, {0}};
    serving_update(s, 4, &wrong, 1);
    expect_updated(s, 4, LW_SCENE_CHANGE_UNKNOWN_KIND, 0, 0);
    wrong = (struct lw_scene_change){LW_SCENE_CHANGE_OBJECT_TRANSFORM, 0, 12, {0}};
    serving_update(s, 5, &wrong, 1);
    expect_updated(s, 5, LW_SCENE_CHANGE_DEGENERATE, 0, 0);
    serving_update(s, 6, &serving_hide_1, 1);
    free(serving_take(f, 1, 1, 1)); /* this update alone */
    serving_publish(f, serving_make_snapshot(f, 1, 0));
    expect_updated(s, 6, LW_SCENE_CHANGE_OK, 0, 1); /* without any FRAME: it has not asked for the package */
    close(s);
    serving_end(f);
}

/* Two at once, from two sessions: each spare goes to one of them, and both hear of both. */
static void test_spares_are_given_out_in_order(void **state) {
    (void)state;
    static const struct lw_scene_change add = {
        LW_SCENE_CHANGE_OBJECT_ADD, 0, 12, {1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1, 0}};
    static const struct lw_scene_change remove = {LW_SCENE_CHANGE_OBJECT_REMOVE, 1, 0, {0}};
    struct lw_scene *scene = lw_support_squares(SERVING_OBJECTS, 1);
    struct lw_error err = {0};
    lw_support_ok(lw_scene_spares_add(scene, "2", &err), &err);
    struct serving *f = serving_start(
        &(struct lw_server_desc){.scene = scene, .control_socket = lw_support_temporary("control.sock")});
    int a = serving_dial_and_control(f, false), b = serving_dial_and_control(f, false);
    const struct lw_scene_change hide_second = {LW_SCENE_CHANGE_OBJECT_HIDE, SERVING_OBJECTS + 1, 0, {0}};
    serving_update(a, 1, (struct lw_scene_change[]){add, hide_second}, 2); /* refused, and so it takes none */
    expect_updated(a, 1, LW_SCENE_CHANGE_ABSENT, 1, 0);
    serving_update(a, 2, &add, 1);
    free(serving_take(f, 1, 1, 1));
    serving_update(b, 1, (struct lw_scene_change[]){add, add}, 2); /* one too many, and so none */
    expect_updated(b, 1, LW_SCENE_CHANGE_NO_SPARE, 1, 0);
    serving_update(b, 2, (struct lw_scene_change[]){remove, add, add}, 3);
    free(serving_take(f, 1, 1, 3));
    serving_update(a, 3, &remove, 1); /* the one that has just been added; so is this number a spare again */
    free(serving_take(f, 1, 1, 1));
    serving_update(a, 4, &remove, 1);
    expect_updated(a, 4, LW_SCENE_CHANGE_ABSENT, 0, 0);
    serving_update(a, 5, &serving_hide_1, 1);
    expect_updated(a, 5, LW_SCENE_CHANGE_ABSENT, 0, 0);
    serving_publish(f, serving_make_snapshot(f, 1, 0));
    expect_added(a, 2, (uint32_t[]){SERVING_OBJECTS}, 1);
    expect_updated(a, 3, LW_SCENE_CHANGE_OK, 0, 1);
    expect_added(b, 2, (uint32_t[]){1, SERVING_OBJECTS + 1}, 2);
    serving_update(b, 3, &(struct lw_scene_change){LW_SCENE_CHANGE_RESET, 0, 0, {0}}, 1);
    free(serving_take(f, 2, 1, 1));
    serving_update(b, 4, (struct lw_scene_change[]){serving_hide_1, add, add}, 3); /* all is as it was */
    free(serving_take(f, 2, 1, 3));
    close(a); /* it does not wait for the answer */
    close(b);
    serving_publish(f, serving_make_snapshot(f, 2, 0));
    serving_end(f);
    lw_scene_destroy(scene);
}

static void test_a_thousand_updates_in_one_frame_keep_their_order(void **state) {
    (void)state;
    struct serving *f = serving_start_controlled();
    int s = serving_dial_and_control(f, false);
    struct lw_scene_change change = {LW_SCENE_CHANGE_CLOCK_SEEK, 0, 1, {0}};
    for (unsigned i = 0; i < 1024; i++) {
        change.value[0] = (float)i;
        serving_update(s, i, &change, 1);
    }
    serving_update(s, 1024, &change, 1); /* one too many */
    expect_updated(s, 1024, LW_SCENE_CHANGE_BUSY, 0, 0);
    struct lw_scene_change *all = serving_take(f, 3, 1024, 1024);
    for (unsigned i = 0; i < 1024; i++) assert_true(all[i].value[0] == (float)i);
    free(all);
    serving_update(s, 1025, &change, 1); /* there is room again, before the frame is published */
    free(serving_take(f, 4, 1, 1));
    serving_publish(f, serving_make_snapshot(f, 3, 0));
    for (unsigned i = 0; i < 1024; i++) expect_updated(s, i, LW_SCENE_CHANGE_OK, 0, 3);
    serving_expect_silence(s);
    serving_publish(f, serving_make_snapshot(f, 4, 0));
    expect_updated(s, 1025, LW_SCENE_CHANGE_OK, 0, 4);
    close(s);
    serving_end(f);
}

static void test_changes_that_wait_are_bounded(void **state) {
    (void)state;
    struct serving *f = serving_start_controlled();
    int s = serving_dial_and_control(f, false);
    static struct lw_scene_change many[LW_MESSAGE_CHANGES_MAX];
    for (size_t i = 0; i < LW_MESSAGE_CHANGES_MAX; i++) many[i] = serving_hide_1;
    const size_t full = (128u << 10) / LW_MESSAGE_CHANGES_MAX;
    for (size_t i = 0; i < full; i++) serving_update(s, i, many, LW_MESSAGE_CHANGES_MAX);
    serving_update(s, full, &serving_hide_1, 1);
    expect_updated(s, full, LW_SCENE_CHANGE_BUSY, 0, 0);
    free(serving_take(f, 1, full, full * LW_MESSAGE_CHANGES_MAX));
    close(s);
    serving_end(f);
}

static void test_who_leaves_gets_no_answer_but_its_changes_are_made(void **state) {
    (void)state;
    struct serving *f = serving_start_controlled();
    int s = serving_dial_and_control(f, false), other = serving_dial_and_control(f, false);
    serving_update(s, 1, &serving_hide_1, 1);
    serving_update(other, 2, &serving_sky, 1);
    serving_put(other, &(struct lw_message){.type = LW_MESSAGE_PING, .ping.token = 1});
    struct lw_message m;
    serving_expect(other, LW_MESSAGE_PONG, &m);
    lw_message_finish(&m);
    free(serving_take(f, 9, 2, 2));
    close(s);
    serving_wait_for_sessions(f, 1);
    serving_publish(f, serving_make_snapshot(f, 9, 0));
    expect_updated(other, 2, LW_SCENE_CHANGE_OK, 0, 9);
    close(other);
    serving_end(f);
}

/* ---- tokens ---- */

static void test_answers_that_nobody_reads_end_the_session(void **state) {
    (void)state;
    struct serving *f = serving_start_controlled();
    int s = serving_dial_and_control(f, false), other = serving_dial_and_stream(f);
    struct lw_blob *blob = serving_blob_of(&(struct lw_message){
        .type = LW_MESSAGE_UPDATE, .update = {.change = &serving_no_such, .change_count = 1}});
    /* each of them is answered at once, and none of the answers is read */
    for (size_t total = 0; serving_stats_of(f).sessions_now == 2;) {
        const size_t at = total % blob->size;
        const ssize_t n = send(s, blob->bytes + at, blob->size - at, MSG_NOSIGNAL | MSG_DONTWAIT);
        if (n > 0)
            total += (size_t)n;
        else
            server_clock_step(SERVING_STEP_MS);
    }
    lw_blob_unref(blob);
    serving_publish(f, serving_make_snapshot(f, 1, 0));
    serving_expect_frame(other, 1, 1); /* its changes are made all the same */
    close(s);
    close(other);
    serving_end(f);
}

int main(void) {
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(test_updates_are_answered_with_their_frame),
        cmocka_unit_test(test_wrong_updates_are_answered_and_nothing_of_them_is_done),
        cmocka_unit_test(test_spares_are_given_out_in_order),
        cmocka_unit_test(test_a_thousand_updates_in_one_frame_keep_their_order),
        cmocka_unit_test(test_changes_that_wait_are_bounded),
        cmocka_unit_test(test_who_leaves_gets_no_answer_but_its_changes_are_made),
        cmocka_unit_test(test_answers_that_nobody_reads_end_the_session),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
