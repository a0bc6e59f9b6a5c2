#include "tests/support/client_case.h"

#include "client/lib/client.h"
#include "common/base/clock.h"
#include "common/scene/finish_package.h"
#include "server/serve/server.h"

#include <stdio.h>
#include <stdlib.h>
#include <sys/socket.h>
#include <unistd.h>
#include <zstd.h>

/* Packages of finishes, which come behind the light. */

/* ---- finishes ---- */

static uint8_t *write_finishes(const struct client_case_world *w, struct lw_server_desc *desc) {
    uint8_t *bytes;
    lw_support_ok(lw_finish_package_write(w->scene, &bytes, &desc->finishes_size, NULL), NULL);
    desc->finishes = bytes;
    return bytes;
}

static uint8_t *add_finishes(struct client_case_world *w, struct lw_server_desc *desc) {
    lw_support_add_finishes(w->scene);
    return write_finishes(w, desc);
}

static void expect_finish(const struct client_case_world *w, const struct lw_client *client) {
    const struct lw_scene *scene = lw_client_scene(client);
    uint8_t *ours, *theirs;
    size_t our_size, their_size;
    lw_support_ok(lw_finish_package_write(w->scene, &ours, &our_size, NULL), NULL);
    lw_support_ok(lw_finish_package_write(scene, &theirs, &their_size, NULL), NULL);
    assert_int_equal(our_size, their_size);
    assert_memory_equal(ours, theirs, our_size);
    free(ours);
    free(theirs);
}

static void expect_matt(const struct lw_client *client) {
    const struct lw_scene *scene = lw_client_scene(client);
    for (uint32_t m = 0; m < scene->material_count; m++) assert_null(scene->material[m].finish);
    for (uint32_t m = 0; m < scene->mesh_count; m++) assert_null(scene->mesh[m].tangent);
    assert_int_equal(scene->finish_texture_count, 0);
}

static void count_finishes(void *context) { ++*(unsigned *)context; }

/* Waits for the light and, where they are to come, finishes. Returns the bytes that it took. */
static uint64_t fetch_finishes(const struct client_case_running *r, const struct client_case_world *w,
                               struct lw_client_desc desc, enum lw_client_finishes expected) {
    struct lw_client *client;
    struct lw_client_stats stats;
    struct lw_error err = {0};
    unsigned reports = 0;
    desc.host = "127.0.0.1";
    desc.port = lw_server_port(r->server);
    desc.watch.context = &reports;
    desc.watch.finishes = count_finishes;
    lw_support_ok(lw_client_create(&desc, &client, &err), &err);
    do {
        lw_support_ok(lw_client_poll(client, 100, &err), &err);
        lw_client_get_stats(client, &stats);
        if (!stats.first_ns && lw_client_scene(client)) expect_matt(client);
    } while (!stats.settled_frame || lw_client_finishes(client) == LW_CLIENT_FINISHES_COMING);
    assert_int_equal(lw_client_finishes(client), expected);
    assert_int_equal(reports, expected == LW_CLIENT_FINISHES_THERE);
    assert_int_equal(stats.finishes_ns != 0, reports);
    assert_int_equal(stats.finish_bytes != 0, reports);
    assert_in_range(stats.package_bytes, 1, stats.bytes);
    if (reports) {
        assert_in_range(stats.finish_bytes, 1, stats.bytes - stats.package_bytes);
        assert_true(stats.finishes_ns >= stats.first_ns);
        expect_finish(w, client);
    } else {
        expect_matt(client);
    }
    lw_client_destroy(client);
    return stats.bytes;
}

/* A client that asks gets them, after its light. A client that does not ask has a matt scene, and so has one
 * whose server has none. */
static void test_finishes(void **state) {
    (void)state;
    struct client_case_world w = client_case_make_world();
    struct lw_server_desc desc = {0};
    uint8_t *bytes = add_finishes(&w, &desc);
    struct client_case_running r = client_case_start_server_with(&w, desc);
    client_case_publish(&r, client_case_make_snapshot(&w, 1));
    const uint64_t matt = fetch_finishes(&r, &w, (struct lw_client_desc){0}, LW_CLIENT_FINISHES_NONE);
    const uint64_t all =
        fetch_finishes(&r, &w, (struct lw_client_desc){.materials = true}, LW_CLIENT_FINISHES_THERE);
    assert_true(all > matt);
    client_case_stop_server(&r);
    r = client_case_start_server(&w, 0);
    client_case_publish(&r, client_case_make_snapshot(&w, 1));
    fetch_finishes(&r, &w, (struct lw_client_desc){.materials = true}, LW_CLIENT_FINISHES_NONE);
    client_case_stop_server(&r);
    free(bytes);
    client_case_finish_world(&w);
}

static void test_cached_finishes(void **state) {
    (void)state;
    struct client_case_world w = client_case_make_world();
    struct lw_server_desc desc = {0};
    uint8_t *bytes = add_finishes(&w, &desc);
    struct client_case_running r = client_case_start_server_with(&w, desc);
    char folder[256];
    snprintf(folder, sizeof folder, "%s", lw_support_temporary("finishes"));
    const struct lw_client_desc cached = {.materials = true, .cache_folder = folder};
    const unsigned parts = w.scene->texture_count + 1 + w.scene->finish_texture_count + 1;
    client_case_publish(&r, client_case_make_snapshot(&w, 1));
    const uint64_t whole = fetch_finishes(&r, &w, cached, LW_CLIENT_FINISHES_THERE);
    size_t size = 0;
    assert_int_equal(client_case_for_files(folder, ".lwpart", client_case_add_size, &size), parts);
    assert_int_equal(size, w.package_size + desc.finishes_size);
    const uint64_t again = fetch_finishes(&r, &w, cached, LW_CLIENT_FINISHES_THERE);
    assert_true(again + w.compressed_size < whole);
    client_case_for_files(folder, ".lwpart", client_case_damage, &(bool){false});
    assert_int_equal(fetch_finishes(&r, &w, cached, LW_CLIENT_FINISHES_THERE), whole);
    assert_int_equal(client_case_remove_files(folder, ".lwpart"), parts);
    rmdir(folder);
    client_case_stop_server(&r);
    free(bytes);
    client_case_finish_world(&w);
}

static void poll_until_finished(struct lw_client *client) {
    struct lw_error err = {0};
    const uint64_t end_ns = lw_clock_ns() + CLIENT_CASE_WAIT_NS;
    while (lw_client_finishes(client) != LW_CLIENT_FINISHES_THERE) {
        assert_true(lw_clock_ns() < end_ns);
        lw_support_ok(lw_client_poll(client, 100, &err), &err);
    }
}

/* A client that comes back keeps its finishes; other finishes are another scene. */
static void test_finishes_of_another_session(void **state) {
    (void)state;
    struct client_case_world w = client_case_make_world();
    struct lw_server_desc desc = {0};
    struct lw_client *client;
    struct lw_client_stats before, after;
    struct lw_error err = {0};
    uint8_t *bytes = add_finishes(&w, &desc);
    struct client_case_running r = client_case_start_server_with(&w, desc);
    const uint16_t port = lw_server_port(r.server);
    client_case_publish(&r, client_case_make_snapshot(&w, 1));
    lw_support_ok(
        lw_client_create(&(struct lw_client_desc){.host = "127.0.0.1", .port = port, .materials = true},
                         &client, &err),
        &err);
    poll_until_finished(client);
    lw_client_get_stats(client, &before);
    assert_int_equal(shutdown(lw_client_descriptor(client), SHUT_RDWR), 0);
    client_case_lose_connection(client);
    lw_support_ok(lw_client_reconnect(client, &err), &err);
    client_case_poll_until_tiles(client, before.tiles);
    lw_client_get_stats(client, &after);
    assert_int_equal(after.finishes_ns, before.finishes_ns);
    expect_finish(&w, client);
    client_case_stop_server(&r);
    free(bytes);

    ((struct lw_finish *)w.scene->material[1].finish)->roughness = 0.125f;
    bytes = write_finishes(&w, &desc);
    desc.port = port;
    r = client_case_start_server_with(&w, desc);
    client_case_publish(&r, client_case_make_snapshot(&w, 1));
    client_case_lose_connection(client);
    lw_support_fails(lw_client_reconnect(client, &err), LW_BAD_DATA, &err, "another scene");
    assert_true(lw_client_found_other_scene(client));
    lw_client_forget_scene(client);
    assert_int_equal(lw_client_finishes(client), LW_CLIENT_FINISHES_NONE);
    err = (struct lw_error){0};
    lw_support_ok(lw_client_reconnect(client, &err), &err);
    poll_until_finished(client);
    expect_finish(&w, client);
    lw_client_destroy(client);
    client_case_stop_server(&r);
    free(bytes);
    client_case_finish_world(&w);
}

/* ---- against a peer that reads from a script ---- */

/* Finishes of a script: all of them in one part. */
static uint8_t *tell_finishes(struct client_case_world *w, struct lw_message *welcome, const uint8_t *bytes,
                              size_t size) {
    static uint64_t sizes[2];
    static struct lw_package_hash hash;
    uint8_t *compressed = malloc(ZSTD_compressBound(size));
    sizes[0] = size;
    sizes[1] = ZSTD_compress(compressed, ZSTD_compressBound(size), bytes, size, 3);
    lw_package_hash(bytes, size, &hash);
    *welcome = client_case_welcome_of(w);
    welcome->welcome.run = 77;
    welcome->welcome.features = LW_FEATURE_MATERIALS;
    welcome->welcome.finish = (struct lw_message_package){.hash = hash,
                                                          .size = sizes[0],
                                                          .compressed_size = sizes[1],
                                                          .part_size = &sizes[0],
                                                          .part_compressed_size = &sizes[1],
                                                          .part_hash = &hash,
                                                          .part_count = 1};
    return compressed;
}

static void expect_finish_failure(struct client_case_script *s, enum lw_status expected, const char *text) {
    struct lw_client *client = NULL;
    struct lw_error err = {0};
    client_case_begin(s);
    lw_support_ok(lw_client_create(&(struct lw_client_desc){.host = "127.0.0.1",
                                                            .port = s->port,
                                                            .timeout_ms = 400,
                                                            .budget_ns = 1, /* a message at a time */
                                                            .materials = true},
                                   &client, &err),
                  &err);
    enum lw_status status = LW_OK;
    while (status == LW_OK) status = lw_client_poll(client, 100, &err);
    lw_support_fails(status, expected, &err, text);
    if (lw_client_scene(client)) expect_matt(client);
    lw_client_destroy(client);
    client_case_end(s);
}

static void test_damaged_finishes(void **state) {
    (void)state;
    struct client_case_world w = client_case_make_world();
    struct lw_server_desc desc = {0};
    struct lw_message welcome;
    uint8_t *bytes = add_finishes(&w, &desc), *compressed;
    const struct {
        enum lw_status status;
        const char *text;
    } expected[] = {{LW_PROTOCOL, "message FINISH_CHUNK: out of order"},
                    {LW_PROTOCOL, "finish package: chunk at 1 where 0 was expected"},
                    {LW_PROTOCOL, "finish package: its hash is not the one promised"},
                    {LW_BAD_DATA, "material 3, after 1 of 3"},
                    {LW_PROTOCOL, "message FINISH_CHUNK: out of order"}};
    for (int lie = 0; lie < 5; lie++) {
        struct client_case_script s = {0};
        uint8_t *record = bytes + 32 + 24 * 7 + 8 + 16 + 168; /* the second finish, behind the scene */
        if (lie == 3) record[0] = 3;
        compressed = tell_finishes(&w, &welcome, bytes, desc.finishes_size);
        record[0] = 2;
        if (lie == 2) welcome.welcome.finish.hash.bytes[3] ^= 1;
        const size_t size = welcome.welcome.finish.compressed_size;
        struct lw_message chunk = {.type = LW_MESSAGE_FINISH_CHUNK, .finish_chunk = {0, compressed, size}};
        if (lie == 1) chunk.finish_chunk = (struct lw_message_package_chunk){1, compressed + 1, size - 1};
        client_case_say(&s, &welcome);
        if (lie) client_case_say_package(&s, &w);
        if (lie) client_case_say_all_light(&s, &w, 1);
        client_case_say(&s, &chunk);
        if (lie == 4) client_case_say(&s, &chunk); /* they are there */
        if (lie < 4) {
            expect_finish_failure(&s, expected[lie].status, expected[lie].text);
        } else {
            struct lw_client *client = NULL;
            struct lw_error err = {0};
            client_case_begin(&s);
            enum lw_status status = lw_client_create(
                &(struct lw_client_desc){
                    .host = "127.0.0.1", .port = s.port, .budget_ns = 1, .materials = true},
                &client, &err);
            while (status == LW_OK) status = lw_client_poll(client, 100, &err);
            lw_support_fails(status, LW_PROTOCOL, &err, expected[lie].text);
            expect_finish(&w, client);
            lw_client_destroy(client);
            client_case_end(&s);
        }
        free(compressed);
    }
    free(bytes);
    client_case_finish_world(&w);
}

/* An interrupted download goes on in the same run, and begins again in another. */
static void test_finishes_go_on(void **state) {
    (void)state;
    struct client_case_world w = client_case_make_world();
    struct lw_server_desc desc = {0};
    struct lw_message welcome;
    uint8_t *bytes = add_finishes(&w, &desc), *compressed;
    compressed = tell_finishes(&w, &welcome, bytes, desc.finishes_size);
    const size_t size = welcome.welcome.finish.compressed_size, half = size / 2;
    for (int same = 0; same < 2; same++) {
        struct client_case_script s = {.closes = true};
        struct lw_client *client;
        struct lw_error err = {0};
        welcome.welcome.run = 77;
        client_case_say(&s, &welcome);
        client_case_say_package(&s, &w);
        client_case_say_all_light(&s, &w, 1);
        client_case_say(
            &s, &(struct lw_message){.type = LW_MESSAGE_FINISH_CHUNK, .finish_chunk = {0, compressed, half}});
        client_case_begin(&s);
        const uint16_t port = s.port;
        lw_support_ok(lw_client_create(
                          &(struct lw_client_desc){
                              .host = "127.0.0.1", .port = port, .budget_ns = 1, .materials = true},
                          &client, &err),
                      &err);
        client_case_lose_connection(client);
        assert_int_equal(lw_client_finishes(client), LW_CLIENT_FINISHES_COMING);
        client_case_end(&s);
        const size_t from = same ? half : 0;
        s = (struct client_case_script){.port = port};
        welcome.welcome.run = same ? 77 : 78;
        client_case_say(&s, &welcome);
        client_case_say_all_light(&s, &w, 1);
        client_case_say(&s, &(struct lw_message){.type = LW_MESSAGE_FINISH_CHUNK,
                                                 .finish_chunk = {from, compressed + from, size - from}});
        client_case_begin(&s);
        lw_support_ok(lw_client_reconnect(client, &err), &err);
        poll_until_finished(client);
        expect_finish(&w, client);
        lw_client_destroy(client);
        client_case_end(&s);
    }
    free(compressed);
    free(bytes);
    client_case_finish_world(&w);
}

int main(void) {
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(test_finishes),
        cmocka_unit_test(test_cached_finishes),
        cmocka_unit_test(test_finishes_of_another_session),
        cmocka_unit_test(test_damaged_finishes),
        cmocka_unit_test(test_finishes_go_on),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
