/* Objects that come and go in a real lightwelld, as its clients see them. */
#include "tests/support/process.h"

#include "client/lib/client.h"
#include "common/base/clock.h"

#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#define LIMIT_NS        (LW_PROCESS_LIMIT_S * 1000000000ull)
#define SETTLING_FRAMES 60u
#define CORNELL         "builtin:cornell --texels-per-metre 8 --threads 1 --frame-rate 500 --spares 2"

static struct lw_process server;

static void serve(const char *arguments) { lw_process_serve(&server, arguments); }

static void stop(void) { lw_process_end(&server); }

static int kill_all(void **state) {
    (void)state;
    lw_process_kill_all();
    return 0;
}

static void poll_once(struct lw_client *client) {
    struct lw_error err = {0};
    lw_support_ok(lw_client_poll(client, 5, &err), &err);
}

/* A session that may change the scene, and gets light if it wants it. */
static struct lw_client *join(bool wants_nothing) {
    struct lw_client *client;
    struct lw_error err = {0};
    lw_support_ok(lw_client_create(&(struct lw_client_desc){.host = "127.0.0.1",
                                                            .port = server.port,
                                                            .wants_nothing = wants_nothing,
                                                            .control = true},
                                   &client, &err),
                  &err);
    struct lw_client_stats stats = {0};
    for (const uint64_t end_ns = lw_clock_ns() + LIMIT_NS; !stats.first_ns;
         lw_client_get_stats(client, &stats)) {
        assert_true(lw_clock_ns() < end_ns);
        poll_once(client);
    }
    return client;
}

static uint32_t mesh_of_block(const struct lw_client *client) {
    const struct lw_scene *scene = lw_client_scene(client);
    for (uint32_t m = 0; m < scene->mesh_count; m++)
        if (strcmp(scene->mesh[m].name, "short block") == 0) return m;
    fail_msg("no block");
    return 0;
}

static struct lw_scene_change add_at(const struct lw_client *client, float x, float y, float z) {
    return (struct lw_scene_change){
        LW_SCENE_CHANGE_OBJECT_ADD, mesh_of_block(client), 12, {1, 0, 0, x, 0, 1, 0, y, 0, 0, 1, z}};
}

static void send(struct lw_client *client, const struct lw_scene_change *change, size_t count) {
    struct lw_error err = {0};
    lw_support_ok(lw_client_update(client, change, count, NULL, &err), &err);
}

static struct lw_client_answer await(struct lw_client *client) {
    struct lw_client_answer answer;
    const uint64_t end_ns = lw_clock_ns() + LIMIT_NS;
    while (!lw_client_next_answer(client, &answer)) {
        assert_true(lw_clock_ns() < end_ns);
        poll_once(client);
    }
    return answer;
}

/* Adds one and returns which it is. */
static uint32_t add(struct lw_client *client, float x, float y, float z) {
    const struct lw_scene_change change = add_at(client, x, y, z);
    send(client, &change, 1);
    const struct lw_client_answer answer = await(client);
    assert_int_equal(answer.code, LW_SCENE_CHANGE_OK);
    assert_int_equal(answer.added_count, 1);
    return answer.added[0];
}

static void change(struct lw_client *client, enum lw_scene_change_kind kind, uint32_t target) {
    const struct lw_scene_change change = {.kind = kind, .target = target};
    send(client, &change, 1);
    assert_int_equal(await(client).code, LW_SCENE_CHANGE_OK);
}

/* Mean E of the coarsest level, over lit texels. */
static double brightness(const struct lw_client *client, uint32_t object) {
    const struct lw_client_level level =
        lw_client_get_level(client, object, lw_client_atlas_map(client)->atlas[object]->level_count - 1);
    double sum = 0, count = 0;
    for (uint32_t i = 0; i < 3 * level.width * level.height; i++) {
        sum += (double)level.rgb[i];
        count += level.rgb[i] > 0;
    }
    return count > 0 ? sum / count : 0;
}

/* What an object looks like when it may be drawn first. */
static double first_brightness(struct lw_client *client, uint32_t object) {
    const uint64_t end_ns = lw_clock_ns() + LIMIT_NS;
    while (lw_client_object_hidden(client, object)) {
        assert_true(lw_clock_ns() < end_ns);
        poll_once(client);
    }
    return brightness(client, object);
}

/* An update without changes asks for it. */
static uint64_t next_frame(struct lw_client *client) {
    send(client, NULL, 0);
    const struct lw_client_answer answer = await(client);
    assert_int_equal(answer.code, LW_SCENE_CHANGE_OK);
    return answer.frame;
}

/* The brightness of an object after SETTLING_FRAMES more frames. */
static double settled_brightness(struct lw_client *client, uint32_t object) {
    const uint64_t first = next_frame(client);
    while (next_frame(client) < first + SETTLING_FRAMES) continue;
    return brightness(client, object);
}

static void expect_lit_at_once(struct lw_client *client, uint32_t object) {
    const double first = first_brightness(client, object), settled = settled_brightness(client, object);
    print_message("object %u: %.4f at first, %.4f later\n", object, first, settled);
    assert_true(settled > 0 && fabs(first - settled) < 0.5 * settled);
}

static void what_is_added_is_lit_from_the_first(void **state) {
    (void)state;
    static const char *const how[] = {CORNELL, CORNELL " --frame-budget-ms 1",
                                      CORNELL " --light whole --bounces 0", CORNELL " --tracing-range 0.5"};
    for (size_t i = 0; i < sizeof how / sizeof *how; i++) {
        serve(how[i]);
        struct lw_client *client = join(false);
        const uint32_t object = add(client, 0.3f, 0.5f, 0.4f);
        expect_lit_at_once(client, object);
        lw_client_destroy(client);
        stop();
    }
}

/* To a hundredth, with a breath of sky: other light, not the same with another weight (light_layers.h). */
static void dim_lamp(struct lw_client *client) {
    const struct lw_scene *scene = lw_client_scene(client);
    for (uint32_t m = 0; m < scene->material_count; m++) {
        if (strcmp(scene->material[m].name, "lamp") != 0) continue;
        const struct lw_scene_change dim[] = {
            {LW_SCENE_CHANGE_MATERIAL_EMISSION, m, 3, {0.17f, 0.12f, 0.04f}},
            {LW_SCENE_CHANGE_SKY, 0, 3, {1e-4f, 1e-4f, 1e-4f}}};
        send(client, dim, 2);
        assert_int_equal(await(client).code, LW_SCENE_CHANGE_OK);
    }
}

/* Nothing is solved then but the added object: a client that joins sees it lit. */
static void what_is_added_while_nobody_looks_is_lit_too(void **state) {
    (void)state;
    serve(CORNELL " --json --prepare 0");
    struct lw_client *controller = join(true);
    const double rays = lw_process_newest(&server, "rays_total");
    const uint32_t object = add(controller, 0.3f, 0.5f, 0.4f);
    lw_process_await_frames(&server, 2); /* an answer may come before its frame's line */
    assert_true(lw_process_newest(&server, "rays_total") > rays);
    struct lw_client *newcomer = join(true);
    expect_lit_at_once(newcomer, object);
    assert_int_equal(lw_client_object_state(newcomer, object), LW_CLIENT_OBJECT_SHOWN);
    assert_true(lw_client_object_to_world(newcomer, object)->m[1][3] == 0.5f);
    const double before = brightness(newcomer, object);
    lw_client_destroy(newcomer);
    change(controller, LW_SCENE_CHANGE_OBJECT_REMOVE, object); /* what nobody sees counts all the same */
    dim_lamp(controller);
    assert_int_equal(add(controller, 0.3f, 0.5f, 0.4f), object);
    newcomer = join(true);
    expect_lit_at_once(newcomer, object);
    assert_true(brightness(newcomer, object) < 0.5 * before); /* what its bounces end on is lit as of old */
    lw_client_destroy(newcomer);
    lw_client_destroy(controller);
    stop();
}

/* No client shows it in the light of the place where it was. */
static void what_comes_back_comes_in_the_light_of_now(void **state) {
    (void)state;
    serve(CORNELL);
    struct lw_client *client = join(false);
    const uint32_t object = add(client, 0.3f, 0.5f, 0.4f);
    expect_lit_at_once(client, object);
    change(client, LW_SCENE_CHANGE_OBJECT_REMOVE, object);
    const double before = settled_brightness(client, object); /* messages on their way have come */
    assert_int_equal(lw_client_object_state(client, object), LW_CLIENT_OBJECT_SPARE);
    assert_true(lw_client_object_hidden(client, object));
    dim_lamp(client);
    (void)settled_brightness(client, object);
    assert_true(brightness(client, object) == before); /* nobody has solved it meanwhile */
    assert_int_equal(add(client, 0.3f, 0.5f, 0.4f), object);
    const double after = first_brightness(client, object);
    print_message("object %u: %.4f before, %.4f by a hundredth of the light\n", object, before, after);
    const double settled = settled_brightness(client, object);
    assert_true(settled > 0 && settled < 0.1 * before && fabs(after - settled) < 0.5 * settled);
    /* and where nothing has changed, as it was: that comes too */
    change(client, LW_SCENE_CHANGE_OBJECT_REMOVE, object);
    assert_int_equal(add(client, 0.3f, 0.5f, 0.4f), object);
    expect_lit_at_once(client, object);
    lw_client_destroy(client);
    stop();
}

static void two_who_add_at_once_get_two_objects(void **state) {
    (void)state;
    serve(CORNELL);
    struct lw_client *client[2] = {join(true), join(true)};
    const struct lw_scene_change one = add_at(client[0], 0.3f, 0.5f, 0.4f),
                                 other = add_at(client[0], -0.3f, 0.5f, 0.4f);
    uint32_t object[2];
    send(client[0], &one, 1);
    send(client[1], &other, 1);
    for (int i = 0; i < 2; i++) {
        const struct lw_client_answer answer = await(client[i]);
        assert_true(answer.code == LW_SCENE_CHANGE_OK && answer.added_count == 1);
        object[i] = answer.added[0];
    }
    assert_int_not_equal(object[0], object[1]);
    send(client[0], &one, 1);
    const struct lw_client_answer none = await(client[0]);
    assert_true(none.code == LW_SCENE_CHANGE_NO_SPARE && none.added_count == 0 && !none.frame);
    /* a late client sees the same scene */
    struct lw_client *late = join(true);
    for (int i = 0; i < 2; i++) {
        assert_int_equal(lw_client_object_state(late, object[i]), LW_CLIENT_OBJECT_SHOWN);
        assert_true(lw_client_object_to_world(late, object[i])->m[0][3] == (i ? -0.3f : 0.3f));
    }
    /* one removes, moves and hides what the other has added; in one frame another takes its place */
    const struct lw_scene_change contradicting[][2] = {
        {{LW_SCENE_CHANGE_OBJECT_REMOVE, object[1], 0, {0}},
         {LW_SCENE_CHANGE_OBJECT_REMOVE, object[1], 0, {0}}},
        {{LW_SCENE_CHANGE_OBJECT_REMOVE, object[1], 0, {0}},
         {LW_SCENE_CHANGE_OBJECT_SHOW, object[1], 0, {0}}},
        {{LW_SCENE_CHANGE_OBJECT_REMOVE, object[1], 0, {0}}, one}};
    for (int i = 0; i < 3; i++) {
        send(client[0], contradicting[i], 2);
        const struct lw_client_answer answer = await(client[0]);
        assert_int_equal(answer.code, i < 2 ? LW_SCENE_CHANGE_ABSENT : LW_SCENE_CHANGE_OK);
        assert_int_equal(answer.change, i < 2);
        if (i < 2) continue;
        assert_true(answer.added_count == 1 && answer.added[0] == object[1]);
    }
    for (const uint64_t end_ns = lw_clock_ns() + LIMIT_NS;
         lw_client_object_to_world(late, object[1])->m[0][3] != 0.3f;) {
        assert_true(lw_clock_ns() < end_ns);
        poll_once(late);
    }
    assert_int_equal(lw_client_object_state(late, object[1]), LW_CLIENT_OBJECT_SHOWN);
    /* all of them gone, and all of it back */
    for (uint32_t o = 0; o < lw_client_scene(late)->object_count; o++)
        if (lw_client_object_state(late, o) != LW_CLIENT_OBJECT_SPARE)
            change(client[1], LW_SCENE_CHANGE_OBJECT_REMOVE, o);
    change(client[1], LW_SCENE_CHANGE_RESET, 0);
    struct lw_client *last = join(false);
    for (uint32_t o = 0; o < lw_client_scene(last)->object_count; o++)
        assert_int_equal(lw_client_object_state(last, o), lw_scene_is_spare(lw_client_scene(last), o)
                                                              ? LW_CLIENT_OBJECT_SPARE
                                                              : LW_CLIENT_OBJECT_SHOWN);
    lw_client_destroy(last);
    lw_client_destroy(late);
    for (int i = 0; i < 2; i++) lw_client_destroy(client[i]);
    stop();
}

/* Saved light is that of the scene with this number of spares; added objects end with the server. */
static void kept_light_knows_spares(void **state) {
    (void)state;
    char arguments[512];
    snprintf(arguments, sizeof arguments, CORNELL " --keep %s", lw_support_temporary("kept"));
    serve(arguments);
    struct lw_client *client = join(false);
    const uint32_t object = add(client, 0.3f, 0.5f, 0.4f);
    expect_lit_at_once(client, object);
    lw_client_destroy(client);
    stop();
    serve(arguments);
    client = join(false);
    assert_true(lw_process_said(&server, "showing frame"));
    for (const uint64_t end_ns = lw_clock_ns() + LIMIT_NS;
         lw_client_object_state(client, object) != LW_CLIENT_OBJECT_SPARE;) { /* as of the first frame */
        assert_true(lw_clock_ns() < end_ns);
        poll_once(client);
    }
    assert_int_equal(add(client, 0.3f, 0.5f, 0.4f), object);
    expect_lit_at_once(client, object);
    lw_client_destroy(client);
    stop();
    snprintf(arguments, sizeof arguments,
             "builtin:cornell --texels-per-metre 8 --threads 1 --spares 1 --keep %s",
             lw_support_temporary("kept"));
    serve(arguments); /* another scene to the light store */
    client = join(true);
    assert_true(lw_process_said(&server, "lighting afresh") && !lw_process_said(&server, "showing frame"));
    lw_client_destroy(client);
    stop();
}

static void bad_spares_end_the_daemon_with_a_line(void **state) {
    (void)state;
    static const char *const bad[] = {"chair=1", "1,2x", "#99=1", "short=-1", "2=99999"};
    for (size_t i = 0; i < sizeof bad / sizeof *bad; i++) {
        char arguments[256];
        struct lw_process p;
        snprintf(arguments, sizeof arguments, "builtin:cornell --texels-per-metre 8 --spares %s", bad[i]);
        lw_process_start(&p, "lightwelld", arguments);
        assert_int_equal(lw_process_finish(&p, LW_PROCESS_LIMIT_S), 64);
        assert_true(lw_process_said(&p, "--spares: "));
    }
}

int main(void) {
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(what_is_added_is_lit_from_the_first),
        cmocka_unit_test(what_is_added_while_nobody_looks_is_lit_too),
        cmocka_unit_test(what_comes_back_comes_in_the_light_of_now),
        cmocka_unit_test(two_who_add_at_once_get_two_objects),
        cmocka_unit_test(kept_light_knows_spares),
        cmocka_unit_test(bad_spares_end_the_daemon_with_a_line),
    };
    return cmocka_run_group_tests(tests, NULL, kill_all);
}
