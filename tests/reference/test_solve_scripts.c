/* Scripts of what a solver is asked for, frame by frame: interest that jumps, movements, groups, forms,
 * objects that go and come, a checkpoint, finer levels, a scene that is lit in part. Under a budget of units
 * the same script gives the same bytes at any thread count. `test_solve_scripts digests` prints a digest of
 * each frame, which scripts/same_bytes.sh compares between two builds. */
#include "common/light/client_lights.h"
#include "common/lightmap/lightmap.h"
#include "server/solve/adapt/plan_log.h"
#include "server/solve/sparse_solver.h"
#include "tests/reference/room.h"

#include <stdio.h>
#include <stdlib.h>
#include <string.h>

enum { OTHER_ROOM = ROOM_PANEL + 1, OBJECTS = OTHER_ROOM + ROOM_FACES };
enum { BOTH = 1u << LW_TILE_CHANNEL_FULL | 1u << LW_TILE_CHANNEL_SPLIT, SPLIT = 1u << LW_TILE_CHANNEL_SPLIT };
#define FRAMES_MAX 128u
#define FINE_IDS   2048u /* all tiles that scripts look at */

/* Texels of a frame. */
#define MANY 10000 /* two tiles of a finer level */
#define SOME 900   /* a sixth of the rooms */
#define FEW  60

/* A digest of each frame. */
struct record {
    uint64_t frame[FRAMES_MAX];
    unsigned count;
};

struct run {
    struct room_solution s;
    struct lw_client_lights client;
    uint64_t number;
    struct record *record;
};

/* Two rooms: one with two lamps, a plate and a panel that glows; one with a lamp of its own. */
static struct room make_rooms(void) {
    struct room room = room_with_two_lamps();
    room.texels_per_metre = 8;
    room_box(&room, lw_vec3(2, 2, 2), 0.6f, 0);
    for (uint32_t q = OTHER_ROOM; q < OBJECTS; q++) room.quad[q].corner.x += 10;
    room.light[2] = (struct lw_light){.kind = LW_LIGHT_POINT, .intensity = {2, 3, 4}};
    room.light_position[2] = lw_vec3(10.6f, 1.2f, 0.9f);
    room.light_count = 3;
    return room;
}

/* ---- digests ---- */

static uint64_t digest(uint64_t sum, const void *bytes, size_t size) {
    const unsigned char *at = bytes;
    for (size_t i = 0; i < size; i++) sum = (sum ^ at[i]) * 0x100000001b3u; /* FNV-1a */
    return sum;
}

static uint64_t digest_plane(uint64_t sum, const float *const plane[3], size_t texels) {
    for (int c = 0; c < 3 && plane[0]; c++) sum = digest(sum, plane[c], texels * sizeof *plane[c]);
    return sum;
}

static uint64_t digest_tile(uint64_t sum, const struct room_solution *s, lw_tile_id id) {
    static struct lw_solver_room room;
    struct lw_solver_tile tile;
    lw_solver_read_light(s->solver, id, &room, &tile);
    const size_t texels = (size_t)tile.width * tile.height;
    sum = digest_plane(sum, tile.direct, texels);
    sum = digest_plane(sum, tile.indirect, texels);
    for (uint32_t k = 0; k < LW_TILE_CHANNELS_MAX; k++) sum = digest_plane(sum, tile.shown[k], texels);
    sum = digest(sum, &tile.sample_count, sizeof tile.sample_count);
    sum = digest(sum, &tile.error, sizeof tile.error);
    return digest(sum, &tile.solved_frame, sizeof tile.solved_frame);
}

static uint64_t digest_frame(const struct run *run) {
    const struct room_solution *s = &run->s;
    const lw_tile_id *fine;
    const uint64_t counts[] = {s->stats.rays_shadow,   s->stats.rays_bounce,     s->stats.rays_probe,
                               s->stats.texels_solved, s->stats.tiles_converged, s->stats.tiles_shown,
                               s->stats.tiles_solved,  s->stats.tiles_interest,  s->stats.tiles_contributing};
    uint64_t sum = digest(0xcbf29ce484222325u, counts, sizeof counts);
    for (uint32_t id = 0; id < s->map.plain_count; id++)
        if (!s->map.place[id].level) sum = digest_tile(sum, s, (lw_tile_id){id});
    const uint32_t count = s->solver->ops->list_fine ? s->solver->ops->list_fine(s->solver, &fine) : 0;
    if (count) sum = digest(sum, fine, count * sizeof *fine);
    for (uint32_t i = 0; i < count; i++) sum = digest_tile(sum, s, fine[i]);
    return sum;
}

static void step(struct run *run, unsigned frames) {
    struct lw_error err = {0};
    for (unsigned f = 0; f < frames; f++) {
        lw_support_ok(
            run->s.solver->ops->frame(run->s.solver, &run->s.pose, ++run->number, &run->s.stats, &err), &err);
        assert_true(run->record->count < FRAMES_MAX);
        run->record->frame[run->record->count++] = digest_frame(run);
    }
}

/* ---- what scripts do ---- */

static struct lw_solver_desc describe(double units, unsigned threads) {
    return (struct lw_solver_desc){.bounces = 2,
                                   .direct_samples = 1,
                                   .indirect_samples = 2,
                                   .target_error = 0.08f,
                                   .denoise = true,
                                   .frame_budget_units = units,
                                   .threads = threads,
                                   .seed = 3};
}

/* Looks at `count` objects from `first` on, at a level; count 0: at nothing. */
static void set_interest(struct run *run, uint32_t first, uint32_t count, uint32_t level) {
    const struct lw_atlas_map *map = &run->s.map;
    uint8_t *wanted = calloc(map->tile_count, 1);
    assert_non_null(wanted);
    for (uint32_t id = 0; id < map->tile_count; id++)
        if (map->place[id].level == 0 && map->place[id].object - first < count)
            wanted[id] = (uint8_t)(1 + level);
    lw_support_ok(run->s.solver->ops->set_interest(run->s.solver, wanted, NULL), NULL);
    free(wanted);
}

static void move_lamp(struct run *run, uint32_t lamp, float x) { run->s.pose.light[lamp].position_ws.x += x; }

static void colour_lamp(struct run *run, uint32_t lamp, struct lw_vec3 factor) {
    struct lw_vec3 *intensity = &run->s.pose.light[lamp].intensity;
    *intensity = lw_vec3(intensity->x * factor.x, intensity->y * factor.y, intensity->z * factor.z);
}

static void move_object(struct run *run, uint32_t object, float z) {
    run->s.pose.object_to_world[object].m[2][3] += z;
}

static void begin(struct run *run, struct record *record, struct lw_solver_desc desc, const char *groups) {
    const struct room room = make_rooms();
    *run = (struct run){.record = record};
    room_solve_layers(&run->s, room_scene(&room), room.texels_per_metre, desc, groups, 0);
}

static void begin_split(struct run *run, struct record *record, struct lw_solver_desc desc) {
    struct lw_error err = {0};
    const struct room room = make_rooms();
    struct lw_scene *scene = room_scene(&room);
    struct lw_pose pose;
    *run = (struct run){.record = record};
    lw_support_ok(lw_pose_init(&pose, scene), NULL);
    lw_support_ok(lw_client_lights_init(&run->client, scene, &pose, "left", &err), &err);
    lw_pose_finish(&pose);
    desc.client_lights = &run->client;
    room_solve_layers(&run->s, scene, room.texels_per_metre, desc, NULL, 0);
}

/* Finer levels, with room for `tiles` of their tiles. is_sparse: and for those of level 0. */
static void begin_finer(struct run *run, struct record *record, unsigned threads, uint32_t tiles,
                        bool is_sparse) {
    const struct lw_solvers_entry *entry = lw_solvers_at(0);
    const struct room room = make_rooms();
    struct lw_solver_desc desc = describe(MANY, threads);
    struct lw_error err = {0};
    *run = (struct run){.record = record, .s = {.scene = room_scene(&room)}};
    struct room_solution *s = &run->s;
    const struct lw_lightmap_desc density = {.texels_per_metre = room.texels_per_metre * (is_sparse ? 2 : 1)};
    lw_support_ok(lw_lightmap_build(s->scene, &density, NULL, &err), &err);
    lw_support_ok(lw_atlas_map_init_finer(&s->map, s->scene, LW_ATLAS_FINER_MAX, FINE_IDS), NULL);
    lw_support_ok(lw_pose_init(&s->pose, s->scene), NULL);
    lw_pose_evaluate(&s->pose, s->scene, 0);
    desc.scene = s->scene;
    desc.atlas_map = &s->map;
    desc.fine_when = LW_FINE_AFTER_FRAMES; /* few samples do: it waits for no error */
    desc.fine_tiles = tiles;
    lw_support_ok(is_sparse ? lw_sparse_solver_create(entry, &desc, &s->pose, &s->solver, &err)
                            : entry->create(&desc, &s->pose, &s->solver, &err),
                  &err);
}

/* Looks at `count` tiles from the first on of a finer level of an object, and at level 0 of it. */
static void look_closely(struct run *run, uint32_t object, uint32_t finer, uint32_t count) {
    const struct lw_atlas_map *map = &run->s.map;
    const uint32_t level = LW_ATLAS_FINER + finer;
    uint8_t *wanted = calloc(map->tile_count, 1);
    assert_non_null(wanted);
    for (uint32_t id = 0; id < map->plain_count; id++)
        wanted[id] = map->place[id].level == 0 && map->place[id].object == object;
    for (uint32_t t = 0; t < count && lw_atlas_map_has_tile(map, object, level, t); t++) {
        const lw_tile_id id = lw_atlas_map_claim_tile(map, object, level, t);
        assert_true(id.v != UINT32_MAX);
        wanted[id.v] = 1;
    }
    lw_support_ok(run->s.solver->ops->set_interest(run->s.solver, wanted, NULL), NULL);
    free(wanted);
}

static void end(struct run *run) {
    room_finish(&run->s);
    lw_client_lights_finish(&run->client);
}

/* ---- scripts ---- */

static void still(struct record *record, unsigned threads) {
    struct run run;
    begin(&run, record, describe(SOME, threads), NULL);
    step(&run, 24);
    end(&run);
}

static void interest_jumps(struct record *record, unsigned threads) {
    struct run run;
    begin(&run, record, describe(SOME, threads), NULL);
    set_interest(&run, 0, 0, 0);
    step(&run, 2);
    for (uint32_t jump = 0; jump < 6; jump++) {
        set_interest(&run, jump * 5 % OBJECTS, 3, jump % 3);
        step(&run, 7);
        if (jump % 2) move_lamp(&run, jump % 3, 0.1f);
        step(&run, 3);
    }
    set_interest(&run, 0, 0, 0);
    move_lamp(&run, 0, 0.1f);
    step(&run, 2);
    set_interest(&run, 0, 2, 0);
    step(&run, 8);
    end(&run);
}

static void onset_within(struct record *record, double units, unsigned threads) {
    struct run run;
    begin(&run, record, describe(units, threads), NULL);
    step(&run, 40);
    move_lamp(&run, 0, 0.3f);
    step(&run, 16);
    move_object(&run, ROOM_PLATE, 0.2f);
    step(&run, 16);
    end(&run);
}

static void onset(struct record *record, unsigned threads) { onset_within(record, SOME, threads); }
static void onset_in_no_time(struct record *record, unsigned threads) { onset_within(record, FEW, threads); }
static void onset_without_limit(struct record *record, unsigned threads) { onset_within(record, 0, threads); }

static void sweep(struct record *record, unsigned threads) {
    struct run run;
    begin(&run, record, describe(SOME, threads), NULL);
    set_interest(&run, 0, OTHER_ROOM, 0);
    step(&run, 16);
    for (unsigned f = 0; f < 24; f++) {
        move_lamp(&run, 1, f % 8 < 4 ? 0.05f : -0.05f);
        step(&run, 1);
    }
    step(&run, 16);
    end(&run);
}

static void groups(struct record *record, unsigned threads) {
    struct run run;
    begin(&run, record, describe(SOME, threads), "left,right");
    step(&run, 24);
    colour_lamp(&run, 0, lw_vec3(0.5f, 1, 2));
    step(&run, 6);
    move_lamp(&run, 1, 0.3f);
    step(&run, 16);
    colour_lamp(&run, 1, lw_vec3(0, 0, 0));
    move_lamp(&run, 2, 0.2f);
    step(&run, 16);
    colour_lamp(&run, 0, lw_vec3(2, 1, 0.5f));
    move_object(&run, ROOM_PLATE, 0.2f);
    step(&run, 12);
    end(&run);
}

static void forms(struct record *record, unsigned threads) {
    struct run run;
    begin_split(&run, record, describe(SOME, threads));
    static const unsigned shown[] = {SPLIT, BOTH, LW_TILE_CHANNELS_FULL, BOTH, SPLIT, LW_TILE_CHANNELS_FULL};
    for (unsigned i = 0; i < sizeof shown / sizeof *shown; i++) {
        run.s.solver->ops->choose_channels(run.s.solver, shown[i]);
        step(&run, 8);
        move_lamp(&run, i % 2, 0.1f);
        step(&run, 6);
    }
    end(&run);
}

static void hidden_and_shown(struct record *record, unsigned threads) {
    struct run run;
    begin(&run, record, describe(SOME, threads), NULL);
    step(&run, 12);
    for (unsigned i = 0; i < 6; i++) {
        run.s.pose.object_hidden[i % 3 ? ROOM_PLATE : ROOM_PANEL] ^= 1;
        step(&run, 5);
        move_object(&run, ROOM_PLATE, 0.02f);
        step(&run, 4);
    }
    end(&run);
}

static void kept(struct record *record, unsigned threads) {
    static const uint8_t key[16] = {7};
    const char *path = lw_support_temporary("solve_script");
    struct lw_error err = {0};
    struct run run;
    uint64_t frames;
    begin(&run, record, describe(SOME, threads), "left,right");
    step(&run, 20);
    move_lamp(&run, 0, 0.2f);
    step(&run, 8);
    lw_support_ok(run.s.solver->ops->save(run.s.solver, path, key, &err), &err);
    end(&run);
    begin(&run, record, describe(SOME, threads), "left,right");
    move_lamp(&run, 0, 0.2f);
    lw_support_ok(run.s.solver->ops->load(run.s.solver, path, key, &frames, &err), &err);
    run.number = frames;
    step(&run, 8);
    move_lamp(&run, 0, 0.2f);
    step(&run, 16);
    end(&run);
}

static void probes(struct record *record, unsigned threads) {
    struct run run;
    struct lw_solver_desc desc = describe(SOME, threads);
    desc.tracing_range_m = 1;
    begin(&run, record, desc, NULL);
    step(&run, 12);
    move_lamp(&run, 0, 0.2f);
    step(&run, 12);
    end(&run);
}

/* Looks that jump over all finer levels, at more tiles than there is room for, `frames` frames each, and a
 * lamp that walks from the second look on. */
static void look_around_closely(struct run *run, uint32_t tiles, uint32_t jumps, unsigned frames) {
    const lw_tile_id *fine;
    uint32_t levels = 0;
    set_interest(run, 0, OBJECTS, 0);
    step(run, 24);
    for (uint32_t jump = 0; jump < jumps; jump++) {
        look_closely(run, jump % 4, 1 + jump % LW_ATLAS_FINER_MAX, tiles + 2);
        for (unsigned f = 0; f < frames; f++) {
            if (jump) move_lamp(run, 0, jump % 2 ? 0.01f : -0.01f);
            step(run, 1);
        }
        const uint32_t count = run->s.solver->ops->list_fine(run->s.solver, &fine);
        for (uint32_t i = 0; i < count; i++)
            levels |= 1u << lw_atlas_finer(run->s.map.place[fine[i].v].level);
    }
    assert_int_equal(levels, 0x1e);                   /* tiles of each level had light */
    assert_int_equal(run->s.stats.tiles_fine, tiles); /* all of the room is taken: some have given way */
}

static void finer(struct record *record, unsigned threads) {
    struct run run;
    begin_finer(&run, record, threads, 6, false);
    look_around_closely(&run, 6, 5, 10);
    end(&run);
}

static void sparse(struct record *record, unsigned threads) {
    struct run run;
    begin_finer(&run, record, threads, 6, true);
    look_around_closely(&run, 6, 4, 18);
    end(&run);
}

static const struct script {
    const char *name;
    void (*run)(struct record *record, unsigned threads);
} scripts[] = {
    {"still", still},
    {"interest_jumps", interest_jumps},
    {"onset", onset},
    {"onset_in_no_time", onset_in_no_time},
    {"onset_without_limit", onset_without_limit},
    {"sweep", sweep},
    {"groups", groups},
    {"forms", forms},
    {"hidden_and_shown", hidden_and_shown},
    {"kept", kept},
    {"probes", probes},
    {"finer", finer},
    {"sparse", sparse},
};
#define SCRIPT_COUNT (sizeof scripts / sizeof *scripts)

static void same_bytes_at_any_thread_count(void **state) {
    (void)state;
    for (size_t i = 0; i < SCRIPT_COUNT; i++) {
        struct record one = {0}, three = {0};
        scripts[i].run(&one, 1);
        scripts[i].run(&three, 3);
        assert_int_equal(one.count, three.count);
        for (unsigned f = 0; f < one.count; f++)
            if (one.frame[f] != three.frame[f])
                fail_msg("%s: frame %u of 1 thread is not that of 3", scripts[i].name, f + 1);
    }
}

/* A log's plans are made again from their inputs; one entry that is another is named by its line. */
static void a_log_is_replayed(void **state) {
    (void)state;
    const char *path = lw_support_temporary("plans");
    struct lw_error err = {0}, other = {0}, none = {0};
    struct record record = {0};
    struct run run;
    struct lw_solver_desc desc = describe(SOME, 2);
    uint64_t plans = 0;
    desc.plan_log = path;
    begin(&run, &record, desc, NULL);
    step(&run, 20);
    move_lamp(&run, 0, 0.3f);
    step(&run, 6);
    set_interest(&run, 0, 3, 0);
    for (unsigned f = 0; f < 6; f++) {
        move_lamp(&run, 0, 0.05f);
        step(&run, 1);
    }
    end(&run);
    lw_support_ok(lw_plan_log_replay(path, NULL, 0, &plans, &err), &err);
    assert_int_equal(plans, 3 * 32);

    size_t size;
    char *text = (char *)lw_support_read_file(path, &size), *entry = strstr(text, "\nplan ");
    assert_non_null(entry);
    entry += strcspn(entry + 1, "\n"); /* the last figure of the last tile of the list */
    *entry = *entry == '1' ? '2' : '1';
    FILE *file = fopen(path, "w");
    assert_non_null(file);
    assert_int_equal(fwrite(text, 1, size, file), size);
    fclose(file);
    free(text);
    lw_support_fails(lw_plan_log_replay(path, NULL, 0, &plans, &other), LW_BAD_DATA, &other, "is another");
    lw_support_fails(lw_plan_log_replay(lw_support_source("README.md"), NULL, 0, &plans, &none), LW_BAD_DATA,
                     &none, "README.md:1: no plan log");
}

/* Frames of few units solve and verify little, frames of many units much: the budget is kept. */
static void budgets_are_kept(void **state) {
    (void)state;
    static const double units[] = {FEW, SOME};
    for (int k = 0; k < 2; k++) {
        struct record record = {0};
        struct run run;
        begin(&run, &record, describe(units[k], 2), NULL);
        step(&run, 1); /* lights all */
        for (unsigned f = 0; f < 60; f++) {
            if (f > 30) move_lamp(&run, 0, 0.01f);
            step(&run, 1);
            const uint64_t most = (uint64_t)units[k] + 64u * 64u; /* a tile more */
            assert_in_range(run.s.stats.texels_solved, 0, most);
        }
        end(&run);
    }
}

static int print_digests(void) {
    for (size_t i = 0; i < SCRIPT_COUNT; i++) {
        struct record record = {0};
        scripts[i].run(&record, 2);
        for (unsigned f = 0; f < record.count; f++)
            printf("%s %u %016llx\n", scripts[i].name, f + 1, (unsigned long long)record.frame[f]);
    }
    return 0;
}

int main(int argc, char **argv) {
    if (argc == 2 && !strcmp(argv[1], "digests")) return print_digests();
    const struct CMUnitTest tests[] = {cmocka_unit_test(same_bytes_at_any_thread_count),
                                       cmocka_unit_test(a_log_is_replayed),
                                       cmocka_unit_test(budgets_are_kept)};
    return cmocka_run_group_tests(tests, NULL, NULL);
}
