#include "tests/support/serving.h"

#include "server/serve/server.h"

#include <pthread.h>
#include <unistd.h>

/* Forms of light, beside each other. */

/* Both forms, or one, of all tiles. */
static struct lw_snapshot *make_forms(const struct serving *f, uint64_t frame, uint64_t previous,
                                      uint32_t forms) {
    struct lw_snapshot *of[LW_LIGHT_FORM_COUNT] = {0}, *snapshot = NULL;
    const enum lw_light_form before = serving_form;
    for (unsigned i = 0; i < LW_LIGHT_FORM_COUNT; i++) {
        serving_form = (enum lw_light_form)i;
        if (forms >> i & 1) snapshot = of[i] = serving_make_snapshot(f, frame, previous);
    }
    serving_form = before;
    for (unsigned i = 0; i < LW_LIGHT_FORM_COUNT; i++) {
        if (!of[i] || of[i] == snapshot) continue;
        snapshot->tile[i] = of[i]->tile[i];
        of[i]->tile[i] = NULL;
        lw_snapshot_unref(of[i]);
    }
    snapshot->channels = forms;
    return snapshot;
}

static int dial_in(const struct serving *f, enum lw_light_form as) {
    serving_form = as;
    return serving_dial_and_stream(f);
}

static void expect_light_in(const struct serving *f, int s, enum lw_light_form as, uint64_t frame) {
    serving_form = as;
    serving_expect_light(f, s, frame);
}

static void wait_for_forms(const struct serving *f, uint32_t forms) {
    LW_SUPPORT_WAIT_UNTIL(lw_server_channels_taken(f->server) == forms);
}

/* Each gets its own form, whatever others get; a client of a form that nobody has taken waits for it. */
static void test_forms_beside_each_other(void **state) {
    (void)state;
    enum { FULL = 1u << LW_LIGHT_FORM_FULL, SPLIT = 1u << LW_LIGHT_FORM_SPLIT };
    struct serving *f = serving_start(&(struct lw_server_desc){0});
    assert_int_equal(lw_server_channels_taken(f->server), 0);
    serving_publish(f, make_forms(f, 1, 0, FULL));
    int full = dial_in(f, LW_LIGHT_FORM_FULL);
    expect_light_in(f, full, LW_LIGHT_FORM_FULL, 1);
    assert_int_equal(lw_server_channels_taken(f->server), FULL);
    int split = dial_in(f, LW_LIGHT_FORM_SPLIT);
    wait_for_forms(f, FULL | SPLIT);
    assert_int_equal(serving_stats_of(f).sessions_now, 2);
    assert_int_equal(serving_stats_of(f).sessions_drawing, 1);
    serving_expect_silence(split);
    serving_publish(f, make_forms(f, 2, 1, FULL | SPLIT));
    expect_light_in(f, split, LW_LIGHT_FORM_SPLIT, 2);
    serving_form = LW_LIGHT_FORM_FULL;
    serving_expect_frame(full, 2, 2); /* as a difference: it had all of the one before */
    serving_expect_tiles(full, f->map.tile_count, 2);
    /* one form is left out: its sessions keep what they have, and a newcomer gets nothing of old */
    serving_publish(f, make_forms(f, 3, 2, FULL));
    serving_expect_frame(full, 3, 2);
    serving_expect_tiles(full, f->map.tile_count, 3);
    int late = dial_in(f, LW_LIGHT_FORM_SPLIT);
    serving_expect_silence(split);
    serving_expect_silence(late);
    serving_publish(f, make_forms(f, 4, 3, FULL | SPLIT));
    expect_light_in(f, split, LW_LIGHT_FORM_SPLIT, 4);
    expect_light_in(f, late, LW_LIGHT_FORM_SPLIT, 4);
    serving_form = LW_LIGHT_FORM_FULL;
    serving_expect_frame(full, 4, 2);
    serving_expect_tiles(full, f->map.tile_count, 4);
    close(full);
    wait_for_forms(f, SPLIT);
    close(split);
    serving_wait_for_sessions(f, 1);
    assert_int_equal(lw_server_channels_taken(f->server), SPLIT);
    close(late);
    wait_for_forms(f, 0);
    assert_int_equal(serving_stats_of(f).sessions_drawing, 0);
    serving_end(f);
    serving_form = LW_LIGHT_FORM_FULL;
}

/* A client that has not asked for light takes no form. */
static void test_a_form_is_taken_with_the_package(void **state) {
    (void)state;
    struct serving *f = serving_start(&(struct lw_server_desc){0});
    serving_form = LW_LIGHT_FORM_SPLIT;
    int s = serving_dial_and_greet(f);
    serving_expect_silence(s);
    assert_int_equal(lw_server_channels_taken(f->server), 0);
    serving_ask_for_package(s, 0);
    wait_for_forms(f, 1u << LW_LIGHT_FORM_SPLIT);
    close(s);
    wait_for_forms(f, 0);
    serving_end(f);
    serving_form = LW_LIGHT_FORM_FULL;
}

/* A server without client lights takes the offer of nobody. */
static void test_no_client_lights(void **state) {
    (void)state;
    static const uint8_t none[] = {0, 0};
    for (int i = 0; i < 2; i++) {
        struct lw_server *server;
        struct serving *f = serving_start(&(struct lw_server_desc){0});
        struct lw_server_desc desc = {.host = "127.0.0.1",
                                      .atlas_map = &f->map,
                                      .package = f->package,
                                      .package_size = SERVING_PACKAGE_SIZE,
                                      .client_lights = i ? none : NULL,
                                      .client_lights_size = i ? sizeof none : 0};
        lw_server_stop(f->server);
        serving_join(f);
        lw_support_ok(lw_server_create(&desc, &server, NULL), NULL);
        f->server = server;
        assert_int_equal(pthread_create(&f->thread, NULL, serving_serve, f), 0);
        close(serving_dial_and_greet_with(f, LW_FEATURE_DRAWS)); /* which checks the accepted features */
        serving_end(f);
    }
}

int main(void) {
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(test_forms_beside_each_other),
        cmocka_unit_test(test_a_form_is_taken_with_the_package),
        cmocka_unit_test(test_no_client_lights),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
