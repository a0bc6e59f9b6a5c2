#include "tests/support/support.h"

#include "common/base/log.h"
#include "server/publish/change_store.h"

#include <fcntl.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/stat.h>
#include <unistd.h>

static const uint8_t key[LW_CHANGE_STORE_KEY_SIZE] = "sixteen bytes..",
                     other_key[LW_CHANGE_STORE_KEY_SIZE] = "and others";

static struct lw_scene *scene;
static struct lw_scene_state now;
static struct lw_change_store store;
static char folder[256], path[300];
static struct lw_scene_change *kept;
static size_t kept_count;

static int begin(void **state) {
    static unsigned number;
    char name[32];
    (void)state;
    snprintf(name, sizeof name, "changes%u", number++);
    snprintf(folder, sizeof folder, "%s", lw_support_temporary(name));
    snprintf(path, sizeof path, "%s/changes", folder);
    assert_int_equal(mkdir(folder, 0700), 0);
    scene = lw_support_squares(3, 1);
    lw_support_ok(lw_scene_state_init(&now, scene, 0, false), NULL);
    return 0;
}

static int end(void **state) {
    (void)state;
    free(kept);
    kept = NULL;
    lw_change_store_finish(&store);
    lw_scene_state_finish(&now);
    lw_scene_destroy(scene);
    unlink(path);
    rmdir(folder);
    return 0;
}

static void open_with(const uint8_t *with) {
    struct lw_error err = {0};
    lw_change_store_finish(&store);
    free(kept);
    kept = NULL;
    lw_support_ok(lw_change_store_open(&store, folder, with, &kept, &kept_count, &err), &err);
}

static struct lw_scene_change move(uint32_t object, float x) {
    return (struct lw_scene_change){.kind = LW_SCENE_CHANGE_OBJECT_TRANSFORM,
                                    .target = object,
                                    .value_count = 12,
                                    .value = {1, 0, 0, x, 0, 1, 0, 0, 0, 0, 1, 0}};
}

static bool add(const struct lw_scene_change *change, size_t count, double wall_s) {
    for (size_t i = 0; i < count; i++) lw_scene_state_change(&now, &change[i], wall_s);
    return lw_change_store_add(&store, change, count, &now, wall_s);
}

static uint64_t file_size(void) {
    struct stat st;
    assert_int_equal(stat(path, &st), 0);
    return (uint64_t)st.st_size;
}

/* They are there as soon as they were added: nothing is closed first, as in a kill. */
static void each_frame_is_kept_at_once(void **state) {
    (void)state;
    const struct lw_scene_change first[] = {move(0, 1), move(1, 2)}, second = move(0, 3);
    open_with(key);
    assert_int_equal(kept_count, 0);
    assert_true(add(first, 2, 0) && add(NULL, 0, 0) && add(&second, 1, 0));
    open_with(key);
    assert_int_equal(kept_count, 3);
    assert_memory_equal(kept, first, sizeof first);
    assert_memory_equal(kept + 2, &second, sizeof second);
    assert_true(add(first, 1, 0));
    open_with(key);
    assert_int_equal(kept_count, 4);
}

/* A clock that is stopped stops there the next time, too. */
static void the_clock_is_kept_with_its_time(void **state) {
    (void)state;
    const struct lw_scene_change pause = {.kind = LW_SCENE_CHANGE_CLOCK_PAUSE};
    open_with(key);
    assert_true(add(&pause, 1, 12.5));
    open_with(key);
    assert_int_equal(kept_count, 2);
    assert_int_equal(kept[0].kind, LW_SCENE_CHANGE_CLOCK_PAUSE);
    assert_int_equal(kept[1].kind, LW_SCENE_CHANGE_CLOCK_SEEK);
    assert_true(kept[1].value[0] == 12.5f);
}

/* A lamp that walks for hours leaves a file of bounded size, and stands where it went last. */
static void the_file_does_not_grow_for_ever(void **state) {
    (void)state;
    const uint64_t most = 3u * LW_CHANGE_STORE_GROWN;
    open_with(key);
    for (uint32_t i = 0; i < 100000; i++) {
        const struct lw_scene_change step = move(i % 3, (float)i);
        assert_true(add(&step, 1, 0));
    }
    assert_true(file_size() < most && store.bytes == file_size());
    open_with(key);
    float x[3] = {0};
    for (size_t i = 0; i < kept_count; i++) x[kept[i].target] = kept[i].value[3];
    assert_true(x[0] == 99999 && x[1] == 99997 && x[2] == 99998);
}

/* A file cut at any byte holds the frames that are whole, and is written on behind them. */
static void a_cut_file_ends_with_the_last_whole_frame(void **state) {
    (void)state;
    size_t size;
    const struct lw_scene_change a = move(0, 1), b = move(1, 2), c = move(2, 3);
    open_with(key);
    assert_true(add(&a, 1, 0) && add(&b, 1, 0));
    uint8_t *bytes = lw_support_read_file(path, &size);
    const size_t each = sizeof a + 16, header = size - 2 * each;
    for (size_t cut = 0; cut <= size; cut++) {
        lw_support_write_file(path, bytes, cut);
        open_with(key);
        const size_t whole = cut < header ? 0 : (cut - header) / each;
        assert_int_equal(kept_count, whole);
        if (cut % 7) continue;
        assert_true(add(&c, 1, 0));
        open_with(key);
        assert_int_equal(kept_count, whole + 1);
        assert_memory_equal(kept + whole, &c, sizeof c);
    }
    free(bytes);
}

/* Any flipped bit: frames before it, or none. */
static void a_damaged_file_gives_nothing_false(void **state) {
    (void)state;
    size_t size;
    const struct lw_scene_change two[] = {move(0, 1), move(1, 2)};
    open_with(key);
    assert_true(add(&two[0], 1, 0) && add(&two[1], 1, 0));
    uint8_t *bytes = lw_support_read_file(path, &size);
    for (size_t bit = 0; bit < 8 * size; bit++) {
        bytes[bit / 8] ^= (uint8_t)(1u << bit % 8);
        lw_support_write_file(path, bytes, size);
        open_with(key);
        assert_true(kept_count <= 2);
        if (kept_count) assert_memory_equal(kept, two, kept_count * sizeof *two);
        bytes[bit / 8] ^= (uint8_t)(1u << bit % 8);
    }
    free(bytes);
}

static void another_scene_begins_anew(void **state) {
    (void)state;
    const struct lw_scene_change a = move(0, 1);
    open_with(key);
    assert_true(add(&a, 1, 0));
    open_with(other_key);
    assert_int_equal(kept_count, 0);
    open_with(key);
    assert_int_equal(kept_count, 0);
}

/* A failure to write is reported. The next change writes all of them. */
static void a_failure_heals(void **state) {
    (void)state;
    const struct lw_scene_change a = move(0, 1), b = move(1, 2);
    open_with(key);
    assert_true(add(&a, 1, 0));
    close(store.file);
    store.file = open(path, O_RDONLY | O_CLOEXEC); /* writes fail */
    assert_true(add(&b, 1, 0));                    /* the file is rewritten */
    open_with(key);
    assert_int_equal(kept_count, 2);
    close(store.file);
    store.file = -1;
    unlink(path);
    rmdir(folder);
    assert_false(add(&a, 1, 0));
    assert_int_equal(mkdir(folder, 0700), 0);
    assert_true(add(&b, 1, 0));
    open_with(key);
    assert_int_equal(kept_count, 2);
}

/* After a failure the store writes the changes again by itself, without a further change. */
static void a_failure_heals_by_itself(void **state) {
    (void)state;
    const struct lw_scene_change a = move(0, 1);
    open_with(key);
    unlink(path);
    rmdir(folder);
    close(store.file);
    store.file = -1;
    assert_false(add(&a, 1, 0));
    assert_int_equal(mkdir(folder, 0700), 0);
    store.failed_ns = 0; /* a second later */
    assert_true(add(NULL, 0, 0));
    open_with(key);
    assert_int_equal(kept_count, 1);
}

/* A change that cannot be made does not hold up later ones for ever. */
static void what_cannot_be_made_is_discarded(void **state) {
    (void)state;
    const struct lw_scene_change odd = {.kind = LW_SCENE_CHANGE_OBJECT_HIDE, .target = 99}, a = move(0, 1);
    open_with(key);
    assert_true(lw_change_store_add(&store, &odd, 1, &now, 0));
    open_with(key);
    assert_int_equal(kept_count, 1);
    lw_change_store_discard(&store);
    assert_true(add(&a, 1, 0));
    open_with(key);
    assert_int_equal(kept_count, 1);
    assert_memory_equal(kept, &a, sizeof a);
}

/* The time of a clock that has run for long is one that a change may say. */
static void a_late_clock_can_be_kept(void **state) {
    (void)state;
    struct lw_error err = {0};
    const struct lw_scene_change fast[] = {
        {.kind = LW_SCENE_CHANGE_CLOCK_SEEK, .value_count = 1, .value = {LW_SCENE_DURATION_MAX}},
        {.kind = LW_SCENE_CHANGE_CLOCK_RATE, .value_count = 1, .value = {LW_SCENE_CHANGE_RATE_MAX}}};
    open_with(key);
    for (size_t i = 0; i < 2; i++) lw_scene_state_change(&now, &fast[i], 0);
    assert_true(lw_change_store_add(&store, fast, 2, &now, 5000));
    open_with(key);
    assert_int_equal(kept_count, 3);
    for (size_t i = 0; i < 3; i++)
        assert_int_equal(lw_scene_change_check(scene, &kept[i], &err), LW_SCENE_CHANGE_OK);
}

int main(void) {
    const struct CMUnitTest tests[] = {
        cmocka_unit_test_setup_teardown(each_frame_is_kept_at_once, begin, end),
        cmocka_unit_test_setup_teardown(the_clock_is_kept_with_its_time, begin, end),
        cmocka_unit_test_setup_teardown(the_file_does_not_grow_for_ever, begin, end),
        cmocka_unit_test_setup_teardown(a_cut_file_ends_with_the_last_whole_frame, begin, end),
        cmocka_unit_test_setup_teardown(a_damaged_file_gives_nothing_false, begin, end),
        cmocka_unit_test_setup_teardown(another_scene_begins_anew, begin, end),
        cmocka_unit_test_setup_teardown(a_failure_heals, begin, end),
        cmocka_unit_test_setup_teardown(a_failure_heals_by_itself, begin, end),
        cmocka_unit_test_setup_teardown(what_cannot_be_made_is_discarded, begin, end),
        cmocka_unit_test_setup_teardown(a_late_clock_can_be_kept, begin, end),
    };
    lw_log_set_level(LW_LOG_ERROR); /* thousands of files are damaged */
    return cmocka_run_group_tests(tests, NULL, NULL);
}
