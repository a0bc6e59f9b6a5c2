#include "tests/support/support.h"

#include "common/base/cache_folder.h"
#include "common/base/random.h"
#include "common/builtin/builtin.h"
#include "common/lightmap/lightmap.h"
#include "server/solve/geometry.h"
#include "server/solve/solvers.h"
#include "server/solve/surface/invalid_texels.h"
#include "server/solve/surface/saved_texels.h"
#include "server/solve/surface/standing.h"

#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <unistd.h>
#include <xxhash.h>

#define FRAMES 3u
/* Until all objects have been looked into, and light has followed. */
#define FLIPS   300u /* bytes of the file that are changed, one at a time */
#define PAYLOAD 88u  /* where planes begin, and their sizes end */

/* The Cornell box, whose blocks hide a part of the floor. */
struct box {
    struct lw_scene *scene;
    struct lw_pose pose;
    struct lw_trace *trace;
    struct lw_standing standing;
    struct lw_texels texels; /* searched */
    uint64_t count;
    struct lw_saved_texels saved;
    char *path;
};

static int set_up(void **state) {
    static struct box b;
    static unsigned number;
    static char folder[256];
    struct lw_error err = {0};
    char name[32];
    snprintf(name, sizeof name, "texels%u/in/it", number++);
    snprintf(folder, sizeof folder, "%s", lw_support_temporary(name));
    b = (struct box){.saved = {.folder = folder, .key = "sixteen bytes.."}};
    lw_support_ok(lw_builtin_build("builtin:cornell", &b.scene, &err), &err);
    lw_support_ok(lw_lightmap_build(b.scene, &(struct lw_lightmap_desc){.texels_per_metre = 12}, NULL, &err),
                  &err);
    lw_support_ok(lw_pose_init(&b.pose, b.scene), NULL);
    lw_support_ok(lw_trace_create(b.scene, &b.pose, &b.trace, &err), &err);
    lw_support_ok(lw_standing_init(&b.standing, b.scene, &b.pose), NULL);
    lw_support_ok(lw_texels_init(&b.texels, b.scene, 1, NULL, NULL, &err), &err);
    lw_support_ok(
        lw_invalid_texels_find(&b.texels, &b.pose, b.standing.stands, b.trace, 1, NULL, NULL, &b.count),
        NULL);
    assert_true(b.count > 0);
    assert_non_null(b.path = lw_cache_folder_path(folder, b.saved.key, LW_SAVED_TEXELS_SUFFIX));
    *state = &b;
    return 0;
}

static int tear_down(void **state) {
    struct box *b = *state;
    free(b->path);
    lw_texels_finish(&b->texels);
    lw_standing_finish(&b->standing);
    lw_trace_destroy(b->trace);
    lw_pose_finish(&b->pose);
    lw_scene_destroy(b->scene);
    return 0;
}

static void save(const struct box *b) {
    struct lw_error err = {0};
    const struct lw_invalid_texels_found found = {&b->texels, &b->pose, b->count};
    lw_support_ok(lw_saved_texels_save(&b->saved, &found, b->trace, &err), &err);
}

static void begin(const struct box *b, struct lw_texels *texels) {
    struct lw_error err = {0};
    lw_support_ok(lw_texels_init(texels, b->scene, 1, NULL, NULL, &err), &err);
}

static enum lw_status load(const struct box *b, struct lw_texels *texels, struct lw_error *err) {
    uint64_t count;
    const enum lw_status status =
        lw_saved_texels_load(&b->saved, texels, &b->pose, b->standing.stands, b->trace, &count, err);
    if (status == LW_OK) assert_int_equal(count, b->count);
    return status;
}

static void expect_same(const struct lw_texels *a, const struct lw_texels *b) {
    assert_memory_equal(a->covered, b->covered, a->count);
    assert_memory_equal(a->usable, b->usable, a->count);
    assert_memory_equal(a->walls, b->walls, a->count);
    assert_memory_equal(a->filled, b->filled, a->count);
    assert_memory_equal(a->side, b->side, a->count * sizeof *a->side);
    assert_memory_equal(a->source, b->source, a->count * sizeof *a->source);
}

/* A file that is not taken changes nothing. */
static void expect_refused(const struct box *b, enum lw_status expected, const char *text) {
    struct lw_texels texels, untouched;
    struct lw_error err = {0};
    begin(b, &texels);
    begin(b, &untouched);
    lw_support_fails(load(b, &texels, &err), expected, &err, text);
    expect_same(&texels, &untouched);
    assert_null(texels.stands);
    lw_texels_finish(&texels);
    lw_texels_finish(&untouched);
}

static void what_is_saved_is_what_would_be_found(void **state) {
    struct box *b = *state;
    struct lw_texels texels;
    struct lw_error err = {0};
    expect_refused(b, LW_NO_INPUT, b->path);
    save(b);
    begin(b, &texels);
    lw_support_ok(load(b, &texels, &err), &err);
    expect_same(&texels, &b->texels);
    assert_ptr_equal(texels.stands, b->standing.stands);
    lw_texels_finish(&texels);
}

static void of_another_scene_nothing_is_taken(void **state) {
    struct box *b = *state;
    save(b);
    b->pose.object_to_world[2].m[1][3] += 0.01f;
    expect_refused(b, LW_BAD_DATA, "is of other texels");
    b->pose.object_to_world[2].m[1][3] -= 0.01f;
    b->standing.stands[1] = !b->standing.stands[1];
    expect_refused(b, LW_BAD_DATA, "is of other texels");
    b->standing.stands[1] = !b->standing.stands[1];
    b->saved.key[3] ^= 1;
    expect_refused(b, LW_NO_INPUT, "cannot open");
    char *other = lw_cache_folder_path(b->saved.folder, b->saved.key, LW_SAVED_TEXELS_SUFFIX);
    assert_int_equal(rename(b->path, other), 0); /* under the name of another key */
    expect_refused(b, LW_BAD_DATA, "is of other texels");
    free(other);
}

/* What no search finds, in a file whose checksum is right. */
static void what_cannot_be_is_refused(void **state) {
    struct box *b = *state;
    const struct lw_texels found = b->texels;
    uint32_t covered = 0, bare = 0, other = 0; /* texels; the last one of another object than both */
    while (!found.covered[covered]) covered++;
    while (found.covered[bare] || found.source[bare] != LW_TEXEL_NONE) bare++;
    const uint32_t begins = bare > covered ? bare : covered;
    for (uint32_t o = 0; o < b->scene->object_count && other <= begins; o++) other = found.first[o];
    assert_true(other > begins);
    while (!found.covered[other]) other++;
    const struct {
        uint8_t *byte;
        uint32_t *word;
        uint32_t value;
    } wrong[] = {{.byte = &found.covered[covered], .value = 2},
                 {.byte = &found.covered[bare], .value = 1},
                 {.byte = &found.usable[covered], .value = 0},
                 {.byte = &found.usable[bare], .value = 1},
                 {.byte = &found.walls[covered], .value = 16},
                 {.word = &found.source[covered], .value = LW_TEXEL_NONE},
                 {.word = &found.source[covered], .value = other},
                 {.word = &found.source[bare], .value = bare},
                 {.word = &found.source[bare], .value = other},
                 {.word = &found.source[bare], .value = found.count},
                 {.word = &found.source[bare], .value = 0x7fffffff}};
    for (size_t i = 0; i < sizeof wrong / sizeof *wrong; i++) {
        const uint32_t before = wrong[i].byte ? *wrong[i].byte : *wrong[i].word;
        if (wrong[i].byte)
            *wrong[i].byte = (uint8_t)wrong[i].value;
        else
            *wrong[i].word = wrong[i].value;
        save(b);
        expect_refused(b, LW_BAD_DATA, "has a texel that cannot be");
        if (wrong[i].byte)
            *wrong[i].byte = (uint8_t)before;
        else
            *wrong[i].word = before;
    }
    save(b);
    struct lw_texels texels;
    struct lw_error err = {0};
    begin(b, &texels);
    lw_support_ok(load(b, &texels, &err), &err);
    expect_same(&texels, &b->texels);
    lw_texels_finish(&texels);
}

/* With the checksum that belongs to it. */
static void write_sealed(const struct box *b, uint8_t *bytes, size_t size) {
    uint64_t checksum = XXH3_64bits(bytes, size - sizeof checksum);
    memcpy(bytes + size - sizeof checksum, &checksum, sizeof checksum);
    lw_support_write_file(b->path, bytes, size);
}

/* All indices that are taken are in range. */
static void expect_sane(const struct lw_texels *texels) {
    for (uint32_t i = 0; i < texels->count; i++) {
        const uint32_t source = texels->source[i];
        if (source != LW_TEXEL_NONE) assert_true(source < texels->count && texels->covered[source] == 1);
        assert_true(!texels->covered[i] || (source == i && texels->usable[i]));
    }
}

static void hostile_bytes_give_a_status(void **state) {
    struct box *b = *state;
    size_t size;
    save(b);
    uint8_t *whole = lw_support_read_file(b->path, &size), *bytes = malloc(size);
    struct lw_texels texels;
    unsigned refused = 0;
    begin(b, &texels);
    assert_non_null(bytes);
    assert_true(size > PAYLOAD);
    for (uint32_t i = 0; i < FLIPS; i++) {
        const size_t at = i < PAYLOAD ? i : PAYLOAD + lw_random_hash(i) % (size - PAYLOAD - 8);
        struct lw_error err = {0};
        memcpy(bytes, whole, size);
        bytes[at] ^= (uint8_t)(1u << lw_random_hash(~i) % 8);
        write_sealed(b, bytes, size);
        uint64_t count;
        const enum lw_status status =
            lw_saved_texels_load(&b->saved, &texels, &b->pose, b->standing.stands, b->trace, &count, &err);
        assert_true(status == LW_OK || status == LW_BAD_DATA);
        refused += status != LW_OK;
        expect_sane(&texels);
    }
    lw_texels_finish(&texels);
    assert_true(refused > PAYLOAD - 8); /* `gone` alone may be anything that is not too much */
    memcpy(bytes, whole, size);
    for (size_t cut = 0; cut < size; cut += cut < PAYLOAD ? 8 : size / 16) {
        if (cut > 8) write_sealed(b, memcpy(bytes, whole, size), cut);
        if (cut <= 8) lw_support_write_file(b->path, whole, cut);
        expect_refused(b, LW_BAD_DATA, b->path);
    }
    bytes = memcpy(bytes, whole, size);
    bytes[size / 2] ^= 1; /* not sealed */
    lw_support_write_file(b->path, bytes, size);
    expect_refused(b, LW_BAD_DATA, "damaged");
    free(bytes);
    free(whole);
}

/* ---- light ---- */

/* Light of the box after some frames: a plane of each tile. */
static float *light_of(const struct box *b, const struct lw_atlas_map *map,
                       const struct lw_saved_texels *saved, unsigned threads, uint64_t frames,
                       size_t *out_count) {
    struct lw_solver *solver;
    struct lw_error err = {0};
    const struct lw_solver_desc desc = {.scene = b->scene,
                                        .atlas_map = map,
                                        .bounces = 2,
                                        .tracing_range_m = INFINITY,
                                        .direct_samples = 1,
                                        .indirect_samples = 2,
                                        .target_error = 0.02f,
                                        .threads = threads,
                                        .seed = 1,
                                        .saved_texels = saved,
                                        .denoise = true};
    float *light = malloc((b->texels.count + 1ul) * sizeof *light);
    size_t count = 0;
    assert_non_null(light);
    lw_support_ok(lw_solvers_create(NULL, &desc, &b->pose, &solver, &err), &err);
    for (uint64_t frame = 1; frame <= frames; frame++) {
        struct lw_solver_stats stats;
        lw_support_ok(solver->ops->frame(solver, &b->pose, frame, &stats, &err), &err);
    }
    for (uint32_t id = 0; id < map->tile_count; id++) {
        struct lw_solver_tile tile;
        if (map->place[id].level) continue;
        solver->ops->read_tile(solver, (lw_tile_id){id}, &tile);
        memcpy(light + count, tile.shown[0][1], (size_t)tile.width * tile.height * sizeof *light);
        count += (size_t)tile.width * tile.height;
    }
    solver->ops->destroy(solver);
    *out_count = count;
    return light;
}

static void light_is_the_same_with_and_without(void **state) {
    struct box *b = *state;
    struct lw_atlas_map map;
    size_t count, other;
    lw_support_ok(lw_atlas_map_init(&map, b->scene), NULL);
    float *found = light_of(b, &map, NULL, 1, FRAMES, &count);
    for (unsigned threads = 1; threads <= 3; threads++) { /* it is saved by the first one */
        assert_true((access(b->path, F_OK) == 0) == (threads > 1));
        float *read = light_of(b, &map, &b->saved, threads, FRAMES, &other);
        assert_int_equal(other, count);
        assert_memory_equal(read, found, count * sizeof *found);
        free(read);
    }
    lw_support_write_file(b->path, "damaged", 7); /* and again, by one that looks again */
    float *again = light_of(b, &map, &b->saved, 2, FRAMES, &other);
    assert_memory_equal(again, found, count * sizeof *found);
    struct lw_texels texels;
    struct lw_error err = {0};
    begin(b, &texels);
    lw_support_ok(load(b, &texels, &err), &err);
    expect_same(&texels, &b->texels);
    lw_texels_finish(&texels);
    free(again);
    free(found);
    lw_atlas_map_finish(&map);
}

int main(void) {
    const struct CMUnitTest tests[] = {
        cmocka_unit_test_setup_teardown(what_is_saved_is_what_would_be_found, set_up, tear_down),
        cmocka_unit_test_setup_teardown(of_another_scene_nothing_is_taken, set_up, tear_down),
        cmocka_unit_test_setup_teardown(what_cannot_be_is_refused, set_up, tear_down),
        cmocka_unit_test_setup_teardown(hostile_bytes_give_a_status, set_up, tear_down),
        cmocka_unit_test_setup_teardown(light_is_the_same_with_and_without, set_up, tear_down),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
