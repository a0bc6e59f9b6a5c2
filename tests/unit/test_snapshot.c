#include "tests/support/support.h"

#include "server/publish/snapshot.h"

#include <pthread.h>
#include <stdlib.h>
#include <string.h>

static void test_blob(void **state) {
    (void)state;
    struct lw_blob *blob;
    lw_support_ok(lw_blob_create(5, &blob), NULL);
    assert_int_equal(blob->size, 5);
    assert_int_equal(blob->references, 1);
    assert_ptr_equal(lw_blob_ref(blob), blob);
    assert_int_equal(blob->references, 2);
    lw_blob_unref(blob);
    assert_int_equal(blob->references, 1);
    lw_blob_unref(blob);
    lw_blob_unref(NULL);
    assert_int_equal(lw_blob_create(SIZE_MAX - 4, &blob), LW_NO_MEMORY);
}

static void test_blob_from_message(void **state) {
    (void)state;
    struct lw_message message = {.type = LW_MESSAGE_ACK, .ack.frame = 300};
    struct lw_blob *blob = NULL;
    lw_support_ok(lw_blob_from_message(&message, &blob), NULL);
    const uint8_t expected[] = {3, 0, 0, 0, 9, 0, 0, 0, 0x08, 0xac, 0x02};
    assert_int_equal(blob->size, sizeof expected);
    assert_memory_equal(blob->bytes, expected, sizeof expected);
    lw_blob_unref(blob);
    blob = NULL;
    message = (struct lw_message){.type = LW_MESSAGE_TILE}; /* breaks limits: our own mistake */
    assert_int_equal(lw_blob_from_message(&message, &blob), LW_INTERNAL);
    assert_null(blob);
}

static void test_snapshot_owns_its_blobs(void **state) {
    (void)state;
    struct lw_snapshot *a, *b;
    struct lw_blob *blob;
    lw_support_ok(lw_snapshot_create(3, 1u << LW_TILE_CHANNEL_FULL, &a), NULL);
    lw_support_ok(lw_snapshot_create(3, 1u << LW_TILE_CHANNEL_FULL, &b), NULL);
    assert_int_equal(a->tile_count, 3);
    assert_int_equal(a->tile[LW_TILE_CHANNEL_FULL][2].version, 0);
    assert_null(a->tile[LW_TILE_CHANNEL_FULL][2].blob);
    lw_support_ok(lw_blob_create(1, &blob), NULL);
    a->tile[LW_TILE_CHANNEL_FULL][1] = (struct lw_snapshot_tile){.version = 1, .blob = lw_blob_ref(blob)};
    b->tile[LW_TILE_CHANNEL_FULL][1] = (struct lw_snapshot_tile){.version = 1, .blob = lw_blob_ref(blob)};
    b->frame_full = lw_blob_ref(blob);
    b->frame_delta = lw_blob_ref(blob);
    assert_int_equal(blob->references, 5);
    assert_ptr_equal(lw_snapshot_ref(b), b);
    lw_snapshot_unref(b);
    assert_int_equal(blob->references, 5);
    lw_snapshot_unref(b);
    assert_int_equal(blob->references, 2);
    lw_snapshot_unref(a);
    assert_int_equal(blob->references, 1);
    lw_blob_unref(blob);
    lw_snapshot_unref(NULL);
}

#define ROUNDS 20000

static void *ref_and_unref(void *context) {
    for (int i = 0; i < ROUNDS; i++) {
        struct lw_snapshot *snapshot = lw_snapshot_ref(context);
        lw_blob_unref(lw_blob_ref(snapshot->tile[LW_TILE_CHANNEL_FULL][0].blob));
        lw_snapshot_unref(snapshot);
    }
    lw_snapshot_unref(context);
    return NULL;
}

static void test_threads(void **state) {
    (void)state;
    struct lw_snapshot *snapshot;
    struct lw_blob *blob;
    pthread_t thread[4];
    lw_support_ok(lw_snapshot_create(1, 1u << LW_TILE_CHANNEL_FULL, &snapshot), NULL);
    lw_support_ok(lw_blob_create(1, &blob), NULL);
    snapshot->tile[LW_TILE_CHANNEL_FULL][0] =
        (struct lw_snapshot_tile){.version = 1, .blob = lw_blob_ref(blob)};
    for (int i = 0; i < 4; i++) pthread_create(&thread[i], NULL, ref_and_unref, lw_snapshot_ref(snapshot));
    lw_snapshot_unref(snapshot); /* the last thread frees it */
    for (int i = 0; i < 4; i++) pthread_join(thread[i], NULL);
    assert_int_equal(blob->references, 1);
    lw_blob_unref(blob);
}

int main(void) {
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(test_blob),
        cmocka_unit_test(test_blob_from_message),
        cmocka_unit_test(test_snapshot_owns_its_blobs),
        cmocka_unit_test(test_threads),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
