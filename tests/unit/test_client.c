#include "tests/support/client_case.h"

#include "client/lib/client.h"
#include "client/lib/link.h"
#include "common/base/clock.h"
#include "common/tile/tile_codec.h"
#include "server/serve/server.h"

#include <arpa/inet.h>
#include <netinet/in.h>
#include <poll.h>
#include <pthread.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/socket.h>
#include <unistd.h>

/* A session: welcome, updates, refusals, silence, and messages that no server says. */

/* ---- against our own server ---- */

static void test_session(void **state) {
    (void)state;
    struct client_case_world w = client_case_make_world();
    struct lw_server *server;
    struct lw_error err = {0};
    pthread_t thread;
    struct lw_server_desc desc = {.host = "127.0.0.1",
                                  .atlas_map = &w.map,
                                  .package = w.package,
                                  .package_size = w.package_size,
                                  .bounces = 3,
                                  .target_error = 0.25f,
                                  .noise_shown = 0.5f};
    lw_support_ok(lw_server_create(&desc, &server, &err), &err);
    assert_int_equal(pthread_create(&thread, NULL, client_case_serve, server), 0);

    struct lw_client *client;
    uint64_t before_ns = lw_clock_ns();
    lw_support_ok(
        lw_client_create(
            &(struct lw_client_desc){.host = "127.0.0.1", .port = lw_server_port(server), .name = "test"},
            &client, &err),
        &err);
    print_message("handshake on loopback: %.3f ms\n", 1e-6 * (double)(lw_clock_ns() - before_ns));
    assert_true(lw_client_descriptor(client) >= 0);
    while (!lw_client_scene(client)) lw_support_ok(lw_client_poll(client, 100, &err), &err);
    assert_true(lw_client_package_progress(client) == 1);
    assert_int_equal(lw_client_scene(client)->object_count, w.scene->object_count);
    assert_int_equal(lw_client_atlas_map(client)->tile_count, w.map.tile_count);
    assert_null(lw_client_object_to_world(client, w.scene->object_count));
    for (uint32_t t = 0; t < w.map.tile_count; t++)
        client_case_expect_tile(client, &w, t, 0); /* zeros, not garbage */

    for (uint64_t frame = 1; frame <= 3; frame += 2) {
        struct lw_snapshot *snapshot = client_case_make_snapshot(&w, frame);
        lw_server_publish(server, snapshot);
        lw_snapshot_unref(snapshot);
        client_case_poll_until_tiles(client, (frame + 1) / 2 * w.map.tile_count);
        for (uint32_t t = 0; t < w.map.tile_count; t++) client_case_expect_tile(client, &w, t, frame);
        assert_true(lw_client_object_to_world(client, 1)->m[1][3] == (float)frame);
        struct lw_client_stats stats;
        do {
            lw_support_ok(lw_client_poll(client, 100, &err), &err);
            lw_client_get_stats(client, &stats);
        } while (stats.settled_frame != frame); /* it comes behind the tiles */
        assert_int_equal(stats.frame, frame);
        assert_int_equal(stats.frames, (frame + 1) / 2);
        assert_int_equal(stats.rays_total, 1000 * frame);
        assert_int_equal(stats.server_cpu_ns, 7 * frame);
        assert_true(stats.decode_ns > 0);
        assert_int_equal(stats.bounces, 3);
        assert_true(stats.target_error == 0.25f && stats.noise_shown == 0.5f);
        assert_true(stats.time_s == 0.5 * (double)frame && stats.sky[2] == 3);
        assert_true(stats.light_age_ns >= 1000000 && stats.light_age_ns < CLIENT_CASE_WAIT_NS);
        assert_true(before_ns <= stats.connected_ns && stats.connected_ns <= stats.package_ns &&
                    stats.package_ns <= stats.first_ns);
        assert_true(stats.bytes > w.compressed_size);
    }
    struct lw_client_tile tile = lw_client_get_tile(client, (lw_tile_id){0});
    assert_true(tile.bounces == 2 && tile.error == 0.5f);
    assert_int_equal(lw_client_get_tile(client, (lw_tile_id){w.map.tile_count}).version, 0);
    assert_int_equal(lw_client_get_level(client, 0, LW_ATLAS_LEVELS_MAX).width, 0);
    assert_int_equal(lw_client_get_level(client, w.scene->object_count, 0).width, 0);
    lw_support_ok(lw_client_poll(client, 0, &err), &err); /* nothing there: returns at once */

    lw_server_stop(server);
    enum lw_status status = LW_OK;
    while (status == LW_OK) status = lw_client_poll(client, 1000, &err);
    lw_support_fails(status, LW_CLOSED, &err, "ended the session: the server ends");
    client_case_expect_tile(client, &w, 0, 3); /* received light stays readable */
    lw_client_destroy(client);
    lw_client_destroy(NULL);
    assert_int_equal(pthread_join(thread, NULL), 0);
    lw_server_destroy(server);
    client_case_finish_world(&w);
}

/* A snapshot whose frame hides object 0, paints material 0 and sets another sky. */
static struct lw_snapshot *make_changed_snapshot(const struct client_case_world *w, uint64_t frame) {
    static const uint32_t hidden[] = {0};
    static const struct lw_message_material material[] = {{0, {0.25f, 0.5f, 0.75f}, {4, 5, 6}}};
    struct lw_snapshot *snapshot = client_case_make_snapshot(w, frame);
    lw_blob_unref(snapshot->frame_full);
    const struct lw_message m = {.type = LW_MESSAGE_FRAME,
                                 .frame = {.frame = frame,
                                           .sky = {7, 8, 9},
                                           .hidden = hidden,
                                           .hidden_count = 1,
                                           .material = material,
                                           .material_count = 1}};
    lw_support_ok(lw_blob_from_message(&m, &snapshot->frame_full), NULL);
    return snapshot;
}

static struct lw_client_answer await_answer(struct lw_client *client) {
    struct lw_client_answer answer = {0};
    struct lw_error err = {0};
    const uint64_t end_ns = lw_clock_ns() + CLIENT_CASE_WAIT_NS;
    while (!lw_client_next_answer(client, &answer)) {
        assert_true(lw_clock_ns() < end_ns);
        lw_support_ok(lw_client_poll(client, 100, &err), &err);
    }
    return answer;
}

static void test_updates(void **state) {
    (void)state;
    struct client_case_world w = client_case_make_world();
    struct lw_client *client, *other;
    struct lw_error err = {0};
    struct client_case_running r = client_case_start_server_with(
        &w, (struct lw_server_desc){.scene = w.scene, .control_socket = "auto"});
    struct lw_server *server = r.server;
    struct lw_client_desc desc = {.host = "127.0.0.1", .port = lw_server_port(server), .control = true};
    lw_support_ok(lw_client_create(&desc, &client, &err), &err);
    while (!lw_client_scene(client)) lw_support_ok(lw_client_poll(client, 100, &err), &err);
    desc.control = false;
    desc.scene_of = client;
    lw_support_ok(lw_client_create(&desc, &other, &err), &err);
    assert_true(lw_client_may_update(client));
    assert_false(lw_client_may_update(other));
    lw_support_fails(lw_client_update(other, NULL, 0, NULL, &err), LW_UNAVAILABLE, &err, "takes no updates");
    static struct lw_scene_change many[LW_CLIENT_CHANGES_MAX + 1];
    for (size_t i = 0; i <= LW_CLIENT_CHANGES_MAX; i++)
        many[i] = (struct lw_scene_change){.kind = LW_SCENE_CHANGE_OBJECT_TRANSFORM, .value_count = 12};
    err = (struct lw_error){0};
    lw_support_fails(lw_client_update(client, many, LW_CLIENT_CHANGES_MAX + 1, NULL, &err), LW_USAGE, &err,
                     "at most 1024 changes");
    struct lw_scene_change wide = {.value_count = LW_SCENE_CHANGE_VALUES_MAX + 1};
    err = (struct lw_error){0};
    lw_support_fails(lw_client_update(client, &wide, 1, NULL, &err), LW_USAGE, &err, "at most 12 values");

    uint64_t request = 0;
    err = (struct lw_error){0};
    lw_support_ok(lw_client_update(client, many, LW_CLIENT_CHANGES_MAX, &request, &err), &err);
    assert_int_equal(request, 1);
    struct lw_client_answer answer = await_answer(client); /* the largest message there is; scaled to 0 */
    assert_int_equal(answer.request, 1);
    assert_int_equal(answer.code, LW_SCENE_CHANGE_DEGENERATE);
    assert_int_equal(answer.frame, 0);
    assert_non_null(strstr(answer.text, "OBJECT_TRANSFORM 0"));
    const struct lw_scene_change hide = {.kind = LW_SCENE_CHANGE_OBJECT_HIDE};
    lw_support_ok(lw_client_update(client, &hide, 1, &request, &err), &err);
    struct lw_scene_change *taken = NULL;
    size_t count = 0;
    for (uint64_t end_ns = lw_clock_ns() + CLIENT_CASE_WAIT_NS; count == 0;) {
        assert_true(lw_clock_ns() < end_ns);
        free(taken);
        (void)lw_server_take_updates(server, 5, &taken, &count);
    }
    assert_memory_equal(taken, &hide, sizeof hide);
    free(taken);
    const struct lw_material before = w.scene->material[0];
    assert_memory_equal(lw_client_scene(client)->material[0].base_colour, before.base_colour,
                        sizeof before.base_colour);
    assert_false(lw_client_object_hidden(client, 0));
    struct lw_snapshot *snapshot = make_changed_snapshot(&w, 5);
    lw_server_publish(server, snapshot);
    lw_snapshot_unref(snapshot);
    answer = await_answer(client);
    assert_true(answer.request == request && answer.code == LW_SCENE_CHANGE_OK && answer.frame == 5);
    struct lw_client_stats stats;
    lw_client_get_stats(client, &stats);
    assert_true(stats.frame == 5 && stats.changed_frame == 5); /* it came before the answer */
    const struct lw_scene *now = lw_client_scene(client);
    assert_true(lw_client_object_hidden(client, 0) && !lw_client_object_hidden(client, 1));
    assert_false(lw_client_object_hidden(client, UINT32_MAX));
    assert_true(now->material[0].base_colour[2] == 0.75f && now->material[0].emission[1] == 5);
    assert_true(now->material[0].base_colour[3] == before.base_colour[3] && now->sky[0] == 7);
    const struct lw_vec3 own = lw_client_own_emission(client, 0); /* what the scene has stays known */
    assert_true(own.x == before.emission[0] && own.y == before.emission[1] && own.z == before.emission[2]);
    assert_true(before.emission[1] != 5 && lw_client_own_emission(client, UINT32_MAX).x == 0);
    assert_true(lw_client_scene(other)->material[0].base_colour[2] ==
                before.base_colour[2]); /* not polled yet */
    assert_true(lw_client_get_light(client, UINT32_MAX).intensity.x == 0);
    lw_client_destroy(other);
    lw_client_destroy(client);
    client_case_stop_server(&r);
    client_case_finish_world(&w);
}

/* ---- coming back ---- */

/* What a server says of an object that is added while a client looks on. */
static struct lw_snapshot *make_spare_snapshot(const struct client_case_world *w, uint64_t frame,
                                               uint32_t object, bool spare, uint64_t coarsest) {
    struct lw_snapshot *snapshot = client_case_make_snapshot(w, frame);
    const struct lw_message m = {.type = LW_MESSAGE_FRAME,
                                 .frame = {.frame = frame,
                                           .hidden = &object,
                                           .hidden_count = spare,
                                           .spare_count = spare,
                                           .shown = &object,
                                           .shown_count = !spare}};
    lw_blob_unref(snapshot->frame_full);
    lw_support_ok(lw_blob_from_message(&m, &snapshot->frame_full), NULL);
    uint8_t *payload = malloc(lw_tile_codec_bound());
    for (uint32_t t = 0; t < w->map.tile_count; t++) { /* only its coarsest level has come, long ago */
        if (w->map.place[t].object != object) continue;
        const struct lw_message tile = client_case_tile_message(w, t, coarsest, payload);
        snapshot->tile[LW_TILE_CHANNEL_FULL][t].version = coarsest;
        lw_blob_unref(snapshot->tile[LW_TILE_CHANNEL_FULL][t].blob);
        lw_support_ok(lw_blob_from_message(&tile, &snapshot->tile[LW_TILE_CHANNEL_FULL][t].blob), NULL);
    }
    free(payload);
    return snapshot;
}

static void test_spares(void **state) {
    (void)state;
    struct client_case_world w = client_case_make_world_with("#0=1");
    const uint32_t spare = w.scene->object_count - 1;
    struct client_case_running r = client_case_start_server(&w, 0);
    struct lw_client *client;
    struct lw_client_stats stats = {0};
    struct lw_error err = {0};
    assert_true(w.map.atlas[spare]->level_count > 0);
    lw_support_ok(
        lw_client_create(&(struct lw_client_desc){.host = "127.0.0.1", .port = lw_server_port(r.server)},
                         &client, &err),
        &err);
    assert_int_equal(lw_client_object_state(client, 0), LW_CLIENT_OBJECT_SPARE);
    while (!lw_client_scene(client)) lw_support_ok(lw_client_poll(client, 100, &err), &err);
    assert_int_equal(lw_client_object_state(client, 0), LW_CLIENT_OBJECT_SHOWN); /* as the package has it */
    assert_int_equal(lw_client_object_state(client, spare), LW_CLIENT_OBJECT_SPARE);
    assert_int_equal(lw_client_object_state(client, spare + 1), LW_CLIENT_OBJECT_SPARE);
    assert_true(lw_client_object_hidden(client, spare));
    client_case_publish(&r, make_spare_snapshot(&w, 1, spare, true, 1));
    while (stats.settled_frame < 1) {
        lw_support_ok(lw_client_poll(client, 100, &err), &err);
        lw_client_get_stats(client, &stats);
    }
    assert_true(lw_client_object_hidden(client, spare));
    client_case_publish(&r, make_spare_snapshot(&w, 2, spare, false, 1)); /* no light of it yet */
    while (stats.settled_frame < 2) {
        lw_support_ok(lw_client_poll(client, 100, &err), &err);
        lw_client_get_stats(client, &stats);
    }
    assert_int_equal(lw_client_object_state(client, spare), LW_CLIENT_OBJECT_SHOWN);
    assert_true(lw_client_object_hidden(client, spare));
    client_case_publish(&r, make_spare_snapshot(&w, 3, spare, false, 3));
    while (stats.settled_frame < 3) {
        lw_support_ok(lw_client_poll(client, 100, &err), &err);
        lw_client_get_stats(client, &stats);
    }
    assert_false(lw_client_object_hidden(client, spare));
    lw_client_destroy(client);
    client_case_stop_server(&r);
    client_case_finish_world(&w);
}

/* ---- finishes ---- */

static void test_backoff(void **state) {
    (void)state;
    for (unsigned attempt = 0; attempt < 40; attempt++) {
        unsigned least = UINT32_MAX, most = 0, low = attempt < 4 ? 50u << attempt : 500;
        for (uint32_t seed = 0; seed < 1000; seed++) {
            unsigned ms = lw_client_backoff_ms(attempt, seed);
            least = ms < least ? ms : least;
            most = ms > most ? ms : most;
        }
        assert_in_range(least, low, low + low / 10 + 1);
        assert_in_range(most, 2 * low - low / 10 - 1, 2 * low);
    }
}

/* ---- against a peer that reads from a script ---- */

static void test_no_server(void **state) {
    (void)state;
    struct lw_client *client = NULL;
    struct lw_error err = {0};
    struct client_case_script s = {0};
    client_case_begin(&s);
    uint16_t port = s.port;
    struct sockaddr_in address = {
        .sin_family = AF_INET, .sin_port = htons(port), .sin_addr.s_addr = htonl(INADDR_LOOPBACK)};
    int once = socket(AF_INET, SOCK_STREAM, 0);
    assert_int_equal(connect(once, (struct sockaddr *)&address, sizeof address), 0);
    close(once);
    client_case_end(&s); /* nobody listens there any more */
    char name[100];
    snprintf(name, sizeof name, "cannot connect to 127.0.0.1:%u: Connection refused: is lightwelld running?",
             port);
    lw_support_fails(
        lw_client_create(&(struct lw_client_desc){.host = "127.0.0.1", .port = port}, &client, &err),
        LW_UNAVAILABLE, &err, name);
    err = (struct lw_error){0};
    lw_support_fails(
        lw_client_create(&(struct lw_client_desc){.host = "no such host", .port = 1}, &client, &err),
        LW_NO_HOST, &err, "no such host:1");
    assert_null(client);
}

static void test_not_a_lightwelld(void **state) {
    (void)state;
    struct client_case_script s = {0};
    client_case_say_bytes(&s, "SSH-2.0-OpenSSH_9.2p1\r\n", 23);
    client_case_expect_failure(&s, LW_PROTOCOL, "no welcome from a lightwelld of this version", false);
    client_case_expect_failure(&s, LW_TIMED_OUT, "does not answer: is it a lightwelld?",
                               false); /* says nothing */
    s.closes = true;
    client_case_expect_failure(&s, LW_PROTOCOL, "closed the connection", false);
    uint8_t cut[] = {200, 0, 0, 0, 2, 0, 0, 0, 1, 2, 3};
    s.closes = true;
    client_case_say_bytes(&s, cut, sizeof cut);
    client_case_expect_failure(&s, LW_PROTOCOL, "closed the connection", false);
    client_case_say(&s, &(struct lw_message){.type = LW_MESSAGE_HELLO, .hello.version = 1}); /* a client */
    client_case_expect_failure(&s, LW_PROTOCOL, "message HELLO: not one that a server sends", false);
}

static void test_refused(void **state) {
    (void)state;
    struct client_case_script s = {0};
    client_case_say(&s,
                    &(struct lw_message){.type = LW_MESSAGE_REFUSAL,
                                         .refusal = {.code = LW_REFUSAL_VERSION, .text = "speak version 2"}});
    client_case_expect_failure(&s, LW_PROTOCOL, "it refused us: speak version 2", false);
    client_case_say(&s,
                    &(struct lw_message){.type = LW_MESSAGE_REFUSAL,
                                         .refusal = {.code = LW_REFUSAL_FULL, .text = "come back later"}});
    s.closes = true;
    client_case_expect_failure(&s, LW_UNAVAILABLE, "it refused us: come back later", false);
    client_case_say(&s, &(struct lw_message){.type = LW_MESSAGE_REFUSAL,
                                             .refusal = {.code = (enum lw_refusal)999, .text = ""}});
    client_case_expect_failure(&s, LW_UNAVAILABLE, "it did not say why", false);
    struct client_case_world w = client_case_make_world();
    struct lw_message welcome = client_case_welcome_of(&w);
    welcome.welcome.version = 2;
    client_case_say(&s, &welcome);
    client_case_expect_failure(&s, LW_PROTOCOL, "it speaks version 2 of the protocol", false);
    client_case_finish_world(&w);
}

static void test_unknown_types_are_skipped(void **state) {
    (void)state;
    struct client_case_world w = client_case_make_world();
    struct client_case_script s = {0};
    const uint8_t future[] = {5, 0, 0, 0, 200, 1, 0, 0, 0xff, 0xff, 0xff, 0xff, 0xff};
    struct lw_message welcome = client_case_welcome_of(&w);
    client_case_say_bytes(&s, future, sizeof future);
    client_case_say(&s, &welcome);
    client_case_say_bytes(&s, future, sizeof future);
    client_case_say(&s, &(struct lw_message){.type = LW_MESSAGE_PING, .ping.token = 1});
    client_case_say_package(&s, &w);
    client_case_say(&s, &(struct lw_message){.type = LW_MESSAGE_REFUSAL,
                                             .refusal = {.code = LW_REFUSAL_SHUTDOWN, .text = "good night"}});
    client_case_expect_failure(&s, LW_CLOSED, "it ended the session: good night", true);
    client_case_finish_world(&w);
}

static void test_what_comes_with_the_welcome(void **state) {
    (void)state;
    struct client_case_world w = client_case_make_world();
    struct client_case_script s = {0};
    struct lw_message welcome = client_case_welcome_of(&w);
    client_case_say(&s, &welcome);
    client_case_say_package(&s, &w);
    client_case_begin(&s);
    struct lw_client *client;
    struct lw_error err = {0};
    lw_support_ok(
        lw_client_create(&(struct lw_client_desc){.host = "127.0.0.1", .port = s.port}, &client, &err), &err);
    LW_SUPPORT_WAIT_UNTIL(s.said); /* now all of it is read already, or waits in the socket */
    /* a poll that waited for messages which are here already would never return */
    while (!lw_client_scene(client)) lw_support_ok(lw_client_poll(client, INT_MAX, &err), &err);
    lw_client_destroy(client);
    client_case_end(&s);
    client_case_finish_world(&w);
}

static void say_beginning(struct client_case_script *s, const struct client_case_world *w) {
    struct lw_message welcome = client_case_welcome_of(w);
    client_case_say(s, &welcome);
    client_case_say_package(s, w);
}

static void test_messages_out_of_place(void **state) {
    (void)state;
    struct client_case_world w = client_case_make_world();
    struct client_case_script s = {0};
    uint8_t *payload = malloc(lw_tile_codec_bound());
    struct lw_message tile = client_case_tile_message(&w, 0, 1, payload), m,
                      welcome = client_case_welcome_of(&w);
    struct lw_message frame = {.type = LW_MESSAGE_FRAME, .frame = {.frame = 5}};
    client_case_say(&s, &welcome);
    client_case_say(&s, &tile);
    client_case_expect_failure(&s, LW_PROTOCOL, "message TILE: out of order", true);
    client_case_say(&s, &welcome);
    client_case_say(&s, &frame);
    client_case_expect_failure(&s, LW_PROTOCOL, "message FRAME: out of order", true);
    client_case_say(&s, &welcome);
    client_case_say(&s, &welcome);
    /* both may arrive while the client still waits for the first */
    struct lw_client *client = NULL;
    struct lw_error err = {0};
    client_case_begin(&s);
    enum lw_status status =
        lw_client_create(&(struct lw_client_desc){.host = "127.0.0.1", .port = s.port}, &client, &err);
    while (status == LW_OK) status = lw_client_poll(client, 100, &err);
    lw_support_fails(status, LW_PROTOCOL, &err, "message WELCOME: out of order");
    lw_client_destroy(client);
    client_case_end(&s);
    const struct lw_message_interest_tile nowhere[] = {{w.scene->object_count, 0, 0},
                                                       {0, w.map.atlas[0]->level_count, 0},
                                                       {0, w.map.atlas[0]->level_count - 1, 1},
                                                       {UINT32_MAX, UINT32_MAX, UINT32_MAX},
                                                       {0, 0, UINT32_MAX}};
    for (size_t i = 0; i < sizeof nowhere / sizeof *nowhere; i++) {
        m = tile;
        m.tile.object = nowhere[i].object;
        m.tile.level = nowhere[i].level;
        m.tile.tile = nowhere[i].tile;
        say_beginning(&s, &w);
        client_case_say(&s, &m);
        client_case_expect_failure(&s, LW_PROTOCOL, "message TILE: there is no object", true);
    }
    m = tile;
    m.tile.codec = 3;
    say_beginning(&s, &w);
    client_case_say(&s, &m);
    client_case_expect_failure(&s, LW_PROTOCOL, "codec 3 is unknown", true);
    m = tile;
    m.tile.payload_size--;
    say_beginning(&s, &w);
    client_case_say(&s, &m);
    client_case_expect_failure(&s, LW_PROTOCOL, "the payload is damaged", true);
    struct lw_message_transform transform = {w.scene->object_count, LW_AFFINE_IDENTITY};
    m = frame;
    m.frame.transform = &transform;
    m.frame.transform_count = 1;
    say_beginning(&s, &w);
    client_case_say(&s, &m);
    client_case_expect_failure(&s, LW_PROTOCOL, "transform_object", true);
    struct lw_message_light light = {.light = w.scene->light_count};
    m = frame;
    m.frame.light = &light;
    m.frame.light_count = 1;
    say_beginning(&s, &w);
    client_case_say(&s, &m);
    client_case_expect_failure(&s, LW_PROTOCOL, "message FRAME: light", true);
    m = frame;
    m.frame.frame = 4;
    say_beginning(&s, &w);
    client_case_say(&s, &frame);
    client_case_say(&s, &m);
    client_case_expect_failure(&s, LW_PROTOCOL, "number 4 after 5", true);
    m = (struct lw_message){.type = LW_MESSAGE_SETTLED, .settled.frame = 6};
    say_beginning(&s, &w);
    client_case_say(&s, &m);
    client_case_expect_failure(&s, LW_PROTOCOL, "message SETTLED: out of order", true);
    say_beginning(&s, &w);
    client_case_say(&s, &frame);
    client_case_say(&s, &m);
    client_case_expect_failure(&s, LW_PROTOCOL, "message SETTLED: out of order", true);
    free(payload);
    client_case_finish_world(&w);
}

/* A tile in codec 4, as a whole and then as a delta: the smallest tile there is. */
static void say_light(struct client_case_script *s, const struct client_case_world *w) {
    uint32_t id = 0;
    for (uint32_t t = 1; t < w->map.tile_count; t++)
        if (w->map.place[t].width * w->map.place[t].height < w->map.place[id].width * w->map.place[id].height)
            id = t;
    const struct lw_tile_place *p = &w->map.place[id];
    static struct lw_tile_dct_history history;
    static float rgb[LW_TILE_TEXELS_MAX * 3];
    uint8_t *payload = malloc(lw_tile_codec_bound()), *delta = malloc(lw_tile_codec_bound());
    struct lw_message m = client_case_tile_message(w, id, 10, payload); /* for its names */
    m.tile.codec = LW_TILE_CODEC_DCT;
    for (uint64_t version = 10; version < 12; version++) {
        struct lw_tile_dct_coded coded;
        for (uint32_t i = 0; i < p->width * p->height * 3; i++) rgb[i] = 1 + (float)(i % 7 * version);
        lw_support_ok(
            lw_tile_codec_encode_dct(
                w->codec,
                &(struct lw_tile_dct_source){.rgb = rgb, .width = p->width, .height = p->height, .step = 1},
                &history, payload, delta, lw_tile_codec_bound(), &coded),
            NULL);
        m.tile.version = version;
        m.tile.base = version == 10 ? 0 : 10;
        m.tile.scale = coded.scale;
        m.tile.payload = version == 10 ? payload : delta;
        m.tile.payload_size = version == 10 ? coded.size : coded.delta_size;
        client_case_say(s, &m);
    }
    free(delta);
    free(payload);
}

/* Plays bytes to a client that has the scene already, until it fails. */
static enum lw_status listen_to(const struct lw_client *scene_of, const uint8_t *bytes, size_t size,
                                struct lw_client_stats *out_stats) {
    struct client_case_script s = {.closes = true};
    struct lw_client *client = NULL;
    struct lw_error err = {0};
    client_case_say_bytes(&s, bytes, size);
    client_case_begin(&s);
    enum lw_status status = lw_client_create(
        &(struct lw_client_desc){.host = "127.0.0.1", .port = s.port, .scene_of = scene_of}, &client, &err);
    while (status == LW_OK) status = lw_client_poll(client, 1000, &err);
    assert_true(err.text[0] != '\0');
    if (client) lw_client_get_stats(client, out_stats);
    lw_client_destroy(client);
    client_case_end(&s);
    return status;
}

/* What a server says cut off at every byte, and with every bit turned: a status, and nothing worse. */
static void test_bytes_gone_wrong(void **state) {
    (void)state;
    struct client_case_world w = client_case_make_world();
    struct client_case_script s = {0}, first = {0};
    struct lw_client *owner;
    struct lw_client_stats stats = {0};
    struct lw_error err = {0};
    say_beginning(&first, &w);
    client_case_begin(&first);
    lw_support_ok(
        lw_client_create(&(struct lw_client_desc){.host = "127.0.0.1", .port = first.port}, &owner, &err),
        &err);
    while (!lw_client_scene(owner)) lw_support_ok(lw_client_poll(owner, 1000, &err), &err);

    const struct lw_message_transform moved = {.object = 1, .object_to_world = LW_AFFINE_IDENTITY};
    const struct lw_message welcome = client_case_welcome_of(&w),
                            frame = {.type = LW_MESSAGE_FRAME,
                                     .frame = {.frame = 5, .transform = &moved, .transform_count = 1}},
                            settled = {.type = LW_MESSAGE_SETTLED, .settled.frame = 5};
    client_case_say(&s, &welcome);
    client_case_say(&s, &frame);
    say_light(&s, &w);
    client_case_say(&s, &settled);
    assert_int_equal(listen_to(owner, s.bytes, s.size, &stats), LW_CLOSED);
    assert_true(stats.tiles == 2 && stats.settled_frame == 5);
    for (size_t cut = 0; cut < s.size; cut++) {
        enum lw_status status = listen_to(owner, s.bytes, cut, &stats);
        assert_true(status == LW_CLOSED || status == LW_PROTOCOL);
    }
    unsigned refused = 0;
    for (size_t bit = 0; bit < 8 * s.size; bit++) {
        s.bytes[bit / 8] ^= (uint8_t)(1u << bit % 8);
        enum lw_status status = listen_to(owner, s.bytes, s.size, &stats);
        s.bytes[bit / 8] ^= (uint8_t)(1u << bit % 8);
        assert_true(status == LW_CLOSED || status == LW_PROTOCOL || status == LW_BAD_DATA);
        refused += status != LW_CLOSED;
    }
    assert_true(refused > s.size); /* the rest are other numbers, other light, or an end too early */
    free(s.bytes);
    lw_client_destroy(owner);
    client_case_end(&first);
    client_case_finish_world(&w);
}

/* ---- silence ---- */

static void test_silence(void **state) {
    (void)state;
    struct client_case_script s = {0};
    struct lw_link link;
    struct lw_error err = {0};
    client_case_begin(&s);
    lw_support_ok(
        lw_link_connect(
            &link, &(struct lw_link_desc){.host = "127.0.0.1", .port = s.port, .timeout_ms = 1000}, &err),
        &err);
    uint64_t second = 1000000000, now_ns = lw_clock_ns();
    link.heard_ns = now_ns - (LW_LINK_SILENCE_S - 1) * second;
    link.looked_ns = now_ns;
    lw_support_ok(lw_link_wait(&link, 0, &err), &err);
    link.heard_ns = now_ns - (LW_LINK_SILENCE_S + 1) * second;
    link.looked_ns =
        now_ns - (LW_LINK_PING_S + 1) * second; /* nobody looked for a while: that is no silence */
    lw_support_ok(lw_link_wait(&link, 0, &err), &err);
    link.heard_ns = lw_clock_ns() - (LW_LINK_SILENCE_S + 1) * second;
    char text[100];
    snprintf(text, sizeof text, "127.0.0.1:%u has been silent for 15 s", (unsigned)s.port);
    lw_support_fails(lw_link_wait(&link, 0, &err), LW_TIMED_OUT, &err, text);
    lw_link_finish(&link);
    client_case_end(&s);
}

static void test_ping(void **state) {
    (void)state;
    int listener = socket(AF_INET, SOCK_STREAM | SOCK_CLOEXEC, 0);
    struct sockaddr_in address = {.sin_family = AF_INET, .sin_addr.s_addr = htonl(INADDR_LOOPBACK)};
    socklen_t size = sizeof address;
    assert_int_equal(bind(listener, (struct sockaddr *)&address, size), 0);
    assert_int_equal(listen(listener, 1), 0);
    assert_int_equal(getsockname(listener, (struct sockaddr *)&address, &size), 0);
    struct lw_link link;
    struct lw_error err = {0};
    lw_support_ok(
        lw_link_connect(
            &link,
            &(struct lw_link_desc){.host = "127.0.0.1", .port = ntohs(address.sin_port), .timeout_ms = 1000},
            &err),
        &err);
    int peer = accept(listener, NULL, NULL);
    link.pinged_ns = lw_clock_ns() - LW_LINK_PING_S * 1000000000ull;
    lw_support_ok(lw_link_wait(&link, 0, &err), &err);
    uint8_t bytes[100];
    ssize_t got = recv(peer, bytes, sizeof bytes, 0);
    assert_true(got > 8);
    assert_int_equal(bytes[4], LW_MESSAGE_PING);
    struct pollfd wait = {.fd = peer, .events = POLLIN};
    lw_support_ok(lw_link_wait(&link, 0, &err), &err);
    assert_int_equal(poll(&wait, 1, 0), 0); /* one is enough for now */
    close(peer);
    close(listener);
    lw_link_finish(&link);
}

int main(void) {
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(test_session),
        cmocka_unit_test(test_updates),
        cmocka_unit_test(test_spares),
        cmocka_unit_test(test_no_server),
        cmocka_unit_test(test_not_a_lightwelld),
        cmocka_unit_test(test_refused),
        cmocka_unit_test(test_unknown_types_are_skipped),
        cmocka_unit_test(test_what_comes_with_the_welcome),
        cmocka_unit_test(test_backoff),
        cmocka_unit_test(test_messages_out_of_place),
        cmocka_unit_test(test_bytes_gone_wrong),
        cmocka_unit_test(test_silence),
        cmocka_unit_test(test_ping),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
