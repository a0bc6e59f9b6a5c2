#include "server/solve/state/tile_file.h"
#include "tests/support/support.h"

#include <fcntl.h>
#include <stdlib.h>
#include <string.h>
#include <unistd.h>

#define TILES  5u
#define PLANES 3u

static const uint8_t key[LW_TILE_FILE_KEY_SIZE] = "one", other_key[LW_TILE_FILE_KEY_SIZE] = "another";

static struct lw_tile_file_tile *tile_of(uint32_t n) {
    struct lw_tile_file_tile *tile = calloc(1, sizeof *tile);
    assert_non_null(tile);
    tile->texels = 64 * (n + 1);
    tile->sample_count = n;
    tile->error = 0.5f;
    for (uint32_t i = 0; i < tile->texels; i++) {
        tile->covered[i] = i % 3 == 0;
        for (uint32_t p = 0; p < PLANES; p++) tile->plane[p][i] = (float)(1000 * n + 10 * i + p);
    }
    return tile;
}

static void expect_tile(const struct lw_tile_file *file, uint32_t n) {
    struct lw_error err = {0};
    struct lw_tile_file_tile *want = tile_of(n), *got = calloc(1, sizeof *got);
    assert_non_null(got);
    lw_support_ok(lw_tile_file_get(file, n, got, &err), &err);
    assert_memory_equal(got, want, sizeof *got);
    free(got);
    free(want);
}

/* A file with tiles 3 and 1. */
static void begin(struct lw_tile_file *file, const char *path) {
    struct lw_error err = {0};
    lw_support_ok(lw_tile_file_open(file, path, key, TILES, PLANES, &err), &err);
    for (uint32_t n = 3; n < TILES; n -= 2) {
        struct lw_tile_file_tile *tile = tile_of(n);
        lw_support_ok(lw_tile_file_put(file, n, tile, &err), &err);
        free(tile);
    }
    assert_int_equal(file->count, 2);
}

static void a_later_run_finds_the_tiles(void **state) {
    (void)state;
    struct lw_tile_file file;
    struct lw_error err = {0};
    const char *path = lw_support_temporary("tiles");
    begin(&file, path);
    expect_tile(&file, 1);
    lw_tile_file_close(&file);
    lw_support_ok(lw_tile_file_open(&file, path, key, TILES, PLANES, &err), &err);
    assert_int_equal(file.count, 2);
    assert_true(file.has[1] && file.has[3] && !file.has[0] && !file.has[2] && !file.has[4]);
    expect_tile(&file, 3);
    lw_tile_file_forget(&file, 3);
    assert_true(file.count == 1 && !file.has[3]);
    lw_tile_file_close(&file);
}

static void another_bake_begins_again(void **state) {
    (void)state;
    struct lw_tile_file file;
    struct lw_error err = {0};
    static const struct {
        const uint8_t *key;
        uint32_t tiles, planes;
    } other[] = {{other_key, TILES, PLANES}, {key, TILES + 1, PLANES}, {key, TILES, PLANES + 3}};
    for (size_t i = 0; i < sizeof other / sizeof *other; i++) {
        const char *path = lw_support_temporary("others");
        begin(&file, path);
        lw_tile_file_close(&file);
        lw_support_ok(lw_tile_file_open(&file, path, other[i].key, other[i].tiles, other[i].planes, &err),
                      &err);
        assert_int_equal(file.count, 0);
        lw_tile_file_close(&file);
    }
}

/* Every byte of a record counts. */
static void damage_is_found(void **state) {
    (void)state;
    struct lw_tile_file file;
    struct lw_error err = {0};
    const char *path = lw_support_temporary("damaged");
    struct lw_tile_file_tile *got = calloc(1, sizeof *got);
    assert_non_null(got);
    begin(&file, path);
    const int descriptor = open(path, O_RDWR);
    const off_t end = lseek(descriptor, 0, SEEK_END);
    for (off_t back = 1; back < 50000; back += 7919) {
        uint8_t byte;
        assert_int_equal(pread(descriptor, &byte, 1, end - back), 1);
        byte ^= 1;
        assert_int_equal(pwrite(descriptor, &byte, 1, end - back), 1);
        assert_int_equal(lw_tile_file_get(&file, 3, got, &err), LW_BAD_DATA);
        byte ^= 1;
        assert_int_equal(pwrite(descriptor, &byte, 1, end - back), 1);
    }
    expect_tile(&file, 3);
    assert_int_equal(ftruncate(descriptor, end - 1), 0);
    err = (struct lw_error){0};
    assert_int_equal(lw_tile_file_get(&file, 3, got, &err), LW_IO);
    assert_non_null(strstr(err.text, "cut off"));
    expect_tile(&file, 1);
    close(descriptor);
    lw_tile_file_close(&file);
    free(got);
}

static void failures_name_the_file(void **state) {
    (void)state;
    struct lw_tile_file file;
    struct lw_error err = {0};
    assert_int_equal(lw_tile_file_open(&file, "/nowhere/tiles", key, TILES, PLANES, &err), LW_CANNOT_CREATE);
    assert_non_null(strstr(err.text, "/nowhere/tiles"));
    lw_tile_file_close(&file);
    err = (struct lw_error){0};
    assert_int_equal(lw_tile_file_open(&file, "/dev/full", key, TILES, PLANES, &err), LW_IO);
    assert_non_null(strstr(err.text, "/dev/full"));
}

int main(void) {
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(a_later_run_finds_the_tiles),
        cmocka_unit_test(another_bake_begins_again),
        cmocka_unit_test(damage_is_found),
        cmocka_unit_test(failures_name_the_file),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
