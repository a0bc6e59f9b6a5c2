#include "tests/support/client_case.h"

#include "client/lib/client.h"
#include "client/lib/package_cache.h"
#include "server/serve/server.h"

#include <stdio.h>
#include <unistd.h>
#include <zstd.h>

/* Scene packages: in parts, in a folder, cut short, damaged. */

/* ---- coming back ---- */

/* Waits for the scene and returns the bytes that it took. */
static uint64_t fetch_scene(const struct client_case_running *r, const char *folder, uint32_t objects) {
    struct lw_client *client;
    struct lw_client_stats stats;
    struct lw_error err = {0};
    lw_support_ok(lw_client_create(&(struct lw_client_desc){.host = "127.0.0.1",
                                                            .port = lw_server_port(r->server),
                                                            .cache_folder = folder},
                                   &client, &err),
                  &err);
    while (!lw_client_scene(client)) lw_support_ok(lw_client_poll(client, 100, &err), &err);
    assert_int_equal(lw_client_scene(client)->object_count, objects);
    lw_client_get_stats(client, &stats);
    assert_true(stats.package_ns > 0);
    lw_client_destroy(client);
    return stats.bytes;
}

/* A fetched package is kept, each part once, and fetched again only if it is damaged. */
static void test_cache(void **state) {
    (void)state;
    struct client_case_world w = client_case_make_world();
    struct client_case_running r = client_case_start_server(&w, 0);
    char folder[256];
    snprintf(folder, sizeof folder, "%s", lw_support_temporary("cache"));
    const uint32_t objects = w.scene->object_count, parts = w.scene->texture_count + 1;
    const uint64_t whole = fetch_scene(&r, NULL, objects);
    assert_true(whole > w.compressed_size && parts > 1);
    assert_int_equal(fetch_scene(&r, folder, objects), whole); /* and keeps it */
    size_t size = 0;
    assert_int_equal(client_case_for_files(folder, ".lwpart", client_case_add_size, &size), parts);
    assert_int_equal(size, w.package_size);
    assert_int_equal(client_case_remove_files(folder, ".lwscene"), 0);
    const uint64_t nothing = fetch_scene(&r, folder, objects); /* but the hashes of its parts */
    assert_true(nothing < whole - w.compressed_size + 100);
    for (int cut = 0; cut < 2; cut++) { /* damaged, or cut off: downloaded once more, and whole again */
        assert_int_equal(client_case_for_files(folder, ".lwpart", client_case_damage, &(bool){cut}), parts);
        assert_int_equal(fetch_scene(&r, folder, objects), whole);
        assert_int_equal(fetch_scene(&r, folder, objects), nothing);
    }
    assert_int_equal(client_case_remove_files(folder, ".lwpart"), parts);
    rmdir(folder);
    /* nowhere to keep it */
    assert_int_equal(fetch_scene(&r, "/dev/null/cache", objects), whole);
    client_case_stop_server(&r);
    client_case_finish_world(&w);
}

/* A package in one piece serves too, under the hash that it has. */
static void test_a_package_in_the_cache(void **state) {
    (void)state;
    struct client_case_world w = client_case_make_world();
    struct client_case_running r = client_case_start_server(&w, 0);
    struct lw_package_hash hash;
    struct lw_error err = {0};
    char folder[256];
    snprintf(folder, sizeof folder, "%s", lw_support_temporary("package"));
    lw_package_hash(w.package, w.package_size, &hash);
    lw_support_ok(
        lw_package_cache_write(folder, LW_PACKAGE_CACHE_PACKAGE, &hash, w.package, w.package_size, &err),
        &err);
    assert_true(fetch_scene(&r, folder, w.scene->object_count) < 400);
    assert_int_equal(client_case_remove_files(folder, ".lwpart"), 0);
    assert_int_equal(client_case_remove_files(folder, ".lwscene"), 1);
    rmdir(folder);
    client_case_stop_server(&r);
    client_case_finish_world(&w);
}

/* Textures that came with another package are not sent, nor what else of it is the same. */
static void test_parts(void **state) {
    (void)state;
    struct client_case_world w = client_case_make_world(), other = client_case_make_world_with("3");
    char folder[256];
    snprintf(folder, sizeof folder, "%s", lw_support_temporary("parts"));
    assert_true(w.scene->texture_count > 1 && other.scene->object_count > w.scene->object_count);
    struct client_case_running r = client_case_start_server(&w, 0);
    (void)fetch_scene(&r, folder, w.scene->object_count);
    client_case_stop_server(&r);
    r = client_case_start_server(&other, 0);
    const uint64_t other_whole = fetch_scene(&r, NULL, other.scene->object_count);
    assert_true(fetch_scene(&r, folder, other.scene->object_count) < other_whole);
    assert_int_equal(client_case_remove_files(folder, ".lwpart"), w.scene->texture_count + 2);
    rmdir(folder);
    client_case_stop_server(&r);
    client_case_finish_world(&other);
    client_case_finish_world(&w);
}

/* ---- against a peer that reads from a script ---- */

/* A download that was cut short goes on where it was, if the server is the same; otherwise it begins
 * again. */
static void test_download_goes_on(void **state) {
    (void)state;
    struct client_case_world w = client_case_make_world();
    const size_t half = w.compressed_size / 2,
                 part[3][2] = {{0, half}, {half, w.compressed_size - half}, {0, w.compressed_size}};
    for (int same = 0; same < 2; same++) {
        struct client_case_script s = {.closes = true};
        struct lw_client *client;
        struct lw_error err = {0};
        struct lw_message welcome = client_case_welcome_of(&w);
        welcome.welcome.run = 77;
        client_case_say(&s, &welcome);
        client_case_say(&s, &(struct lw_message){.type = LW_MESSAGE_PACKAGE_CHUNK,
                                                 .package_chunk = {0, w.compressed, part[0][1]}});
        client_case_begin(&s);
        const uint16_t port = s.port;
        lw_support_ok(
            lw_client_create(&(struct lw_client_desc){.host = "127.0.0.1", .port = port}, &client, &err),
            &err);
        client_case_lose_connection(client);
        assert_null(lw_client_scene(client));
        assert_true(lw_client_package_progress(client) > 0.4f);
        client_case_end(&s);
        const size_t *rest = part[same ? 1 : 2];
        s = (struct client_case_script){.port = port};
        welcome.welcome.run = same ? 77 : 78;
        client_case_say(&s, &welcome);
        client_case_say(&s,
                        &(struct lw_message){.type = LW_MESSAGE_PACKAGE_CHUNK,
                                             .package_chunk = {rest[0], w.compressed + rest[0], rest[1]}});
        client_case_begin(&s);
        lw_support_ok(lw_client_reconnect(client, &err), &err);
        while (!lw_client_scene(client)) lw_support_ok(lw_client_poll(client, 4000, &err), &err);
        assert_int_equal(lw_client_scene(client)->object_count, w.scene->object_count);
        lw_client_destroy(client);
        client_case_end(&s);
    }
    client_case_finish_world(&w);
}

/* A download that was cut short, and a folder that has the package by the next welcome. */
static void test_a_download_that_a_folder_ends(void **state) {
    (void)state;
    struct client_case_world w = client_case_make_world();
    struct client_case_script s = {.closes = true};
    struct lw_client *client;
    struct lw_error err = {0};
    char folder[256];
    snprintf(folder, sizeof folder, "%s", lw_support_temporary("download"));
    struct lw_message welcome = client_case_welcome_of(&w);
    welcome.welcome.run = 77;
    client_case_say(&s, &welcome);
    client_case_say(&s, &(struct lw_message){.type = LW_MESSAGE_PACKAGE_CHUNK,
                                             .package_chunk = {0, w.compressed, w.compressed_size / 2}});
    client_case_begin(&s);
    const uint16_t port = s.port;
    lw_support_ok(
        lw_client_create(&(struct lw_client_desc){.host = "127.0.0.1", .port = port, .cache_folder = folder},
                         &client, &err),
        &err);
    client_case_lose_connection(client);
    client_case_end(&s);
    lw_support_ok(lw_package_cache_write(folder, LW_PACKAGE_CACHE_PACKAGE, &welcome.welcome.package_hash,
                                         w.package, w.package_size, &err),
                  &err);
    s = (struct client_case_script){.port = port};
    client_case_say(&s, &welcome);
    client_case_say_all_light(&s, &w, 1);
    client_case_begin(&s);
    lw_support_ok(lw_client_reconnect(client, &err), &err);
    assert_non_null(lw_client_scene(client));
    client_case_poll_until_tiles(client, w.map.tile_count);
    lw_client_destroy(client);
    client_case_end(&s);
    assert_int_equal(client_case_remove_files(folder, ".lwscene"), 1);
    rmdir(folder);
    client_case_finish_world(&w);
}

static void test_damaged_package(void **state) {
    (void)state;
    struct client_case_world w = client_case_make_world();
    struct client_case_script s = {0};
    struct lw_message good = client_case_welcome_of(&w), m = good;
    m.welcome.package_hash.bytes[15] ^= 1;
    client_case_say(&s, &m);
    client_case_say_package(&s, &w);
    client_case_expect_failure(&s, LW_PROTOCOL, "hash", true);
    m = good;
    m.welcome.package_size--;
    client_case_say(&s, &m);
    client_case_say_package(&s, &w);
    client_case_expect_failure(&s, LW_PROTOCOL, "scene package: ", true);
    m = good;
    m.welcome.package_size++;
    client_case_say(&s, &m);
    client_case_say_package(&s, &w);
    client_case_expect_failure(&s, LW_PROTOCOL, "were promised", true);
    m = good;
    m.welcome.package_compressed_size--;
    client_case_say(&s, &m);
    client_case_say_package(&s, &w);
    client_case_expect_failure(&s, LW_PROTOCOL, "scene package: ", true);
    m = good;
    m.welcome.package_compressed_size += 4;
    client_case_say(&s, &m);
    client_case_say_package(&s, &w);
    client_case_say(&s,
                    &(struct lw_message){.type = LW_MESSAGE_PACKAGE_CHUNK,
                                         .package_chunk = {w.compressed_size, (const uint8_t *)"more", 4}});
    client_case_expect_failure(&s, LW_PROTOCOL, "bytes after its end", true);
    client_case_say(&s, &good);
    client_case_say(&s, &(struct lw_message){.type = LW_MESSAGE_PACKAGE_CHUNK,
                                             .package_chunk = {1, w.compressed + 1, 10}});
    client_case_expect_failure(&s, LW_PROTOCOL, "chunk at 1 where 0 was expected", true);
    client_case_say(&s, &good);
    client_case_say(&s, &(struct lw_message){.type = LW_MESSAGE_PACKAGE_CHUNK,
                                             .package_chunk = {0, (const uint8_t *)"zstd?", 5}});
    client_case_expect_failure(&s, LW_PROTOCOL, "scene package: ", true);
    /* a hash that fits bytes that are no package */
    m = good;
    uint8_t compressed[64];
    m.welcome.package_size = 5;
    m.welcome.package_compressed_size = ZSTD_compress(compressed, sizeof compressed, "scene", 5, 1);
    lw_package_hash((const uint8_t *)"scene", 5, &m.welcome.package_hash);
    client_case_say(&s, &m);
    client_case_say(
        &s, &(struct lw_message){.type = LW_MESSAGE_PACKAGE_CHUNK,
                                 .package_chunk = {0, compressed, m.welcome.package_compressed_size}});
    client_case_expect_failure(&s, LW_BAD_DATA, "127.0.0.1", true);
    client_case_finish_world(&w);
}

int main(void) {
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(test_cache),
        cmocka_unit_test(test_parts),
        cmocka_unit_test(test_a_package_in_the_cache),
        cmocka_unit_test(test_download_goes_on),
        cmocka_unit_test(test_a_download_that_a_folder_ends),
        cmocka_unit_test(test_damaged_package),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
