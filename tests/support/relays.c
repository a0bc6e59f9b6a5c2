#include "tests/support/relays.h"
#include "tests/support/client_light.h"

#include "common/base/clock.h"
#include "proto/message.h"

#include <limits.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

struct lw_client *lw_relays_client[LW_RELAYS_CLIENTS];

void lw_relays_end(void) {
    for (int i = 0; i < LW_RELAYS_CLIENTS; i++) {
        lw_client_destroy(lw_relays_client[i]);
        lw_relays_client[i] = NULL;
    }
    lw_process_kill_all();
}

static uint16_t read_port(const char *path) {
    size_t size;
    char *text = (char *)lw_support_read_file(path, &size);
    const int port = atoi(text);
    free(text);
    assert_true(port > 0);
    return (uint16_t)port;
}

/* On a free port, or on the one it had. */
void lw_relays_start(struct lw_process *process, const char *upstream, const char *options) {
    static unsigned number;
    char arguments[900], file[64];
    const unsigned port = process->port;
    snprintf(file, sizeof file, "relay%u.port", number++);
    const char *path = lw_support_temporary(file);
    snprintf(arguments, sizeof arguments, "%s --listen 127.0.0.1:%u --port-file %s --http none %s", upstream,
             port, path, options);
    lw_process_start(process, "lightwell-relay", arguments);
    if (!lw_process_await_file(process, path)) lw_process_expect(process, -1, 0);
    process->port = read_port(path);
}

void lw_relays_join_with(int i, uint16_t port, struct lw_client_desc desc) {
    struct lw_error err = {0};
    if (!desc.host) desc.host = "127.0.0.1";
    desc.port = port;
    desc.name = "test";
    desc.timeout_ms = LW_PROCESS_LIMIT_S * 1000;
    lw_support_ok(lw_client_create(&desc, &lw_relays_client[i], &err), &err);
}

void lw_relays_join(int i, uint16_t port) {
    lw_relays_join_with(i, port, (struct lw_client_desc){.draws_direct = false});
}

void lw_relays_poll(void) {
    struct lw_error err = {0};
    for (int i = 0; i < LW_RELAYS_CLIENTS; i++)
        if (lw_relays_client[i]) lw_support_ok(lw_client_poll(lw_relays_client[i], 5, &err), &err);
}

struct lw_client_stats lw_relays_stats(int i) {
    struct lw_client_stats stats;
    lw_client_get_stats(lw_relays_client[i], &stats);
    return stats;
}

bool lw_relays_is_at_rest(int i) {
    const struct lw_client_stats stats = lw_relays_stats(i);
    return stats.frame && stats.settled_frame == stats.frame &&
           client_light_is_whole(lw_relays_client[i], 0.3f);
}

/* The last figures of other names, the newest first: what a wait in vain has seen. */
static struct figure {
    const char *name; /* NULL: none */
    double value;
} last_figure[4];

static void note_figure(const char *name, double value) {
    const size_t most = sizeof last_figure / sizeof *last_figure;
    size_t at = 0;
    while (at < most - 1 && last_figure[at].name && strcmp(last_figure[at].name, name) != 0) at++;
    memmove(last_figure + 1, last_figure, at * sizeof *last_figure);
    last_figure[0] = (struct figure){name, value};
}

static void fail_wait(const char *name) {
    char figures[400] = "";
    for (size_t i = 0; i < sizeof last_figure / sizeof *last_figure && last_figure[i].name; i++) {
        const size_t length = strlen(figures);
        snprintf(figures + length, sizeof figures - length, ", %s %g", last_figure[i].name,
                 last_figure[i].value);
    }
    fail_msg("%s() did not come within %u s%s", name, LW_PROCESS_LIMIT_S, figures);
}

void lw_relays_wait_for(bool (*is_so)(void), const char *name) {
    const uint64_t end_ns = lw_clock_ns() + LW_PROCESS_LIMIT_S * 1000000000ull;
    memset(last_figure, 0, sizeof last_figure);
    while (!is_so()) {
        lw_relays_poll();
        if (lw_clock_ns() > end_ns) fail_wait(name);
    }
}

bool lw_relays_all_rest(void) {
    for (int i = 0; i < LW_RELAYS_CLIENTS; i++)
        if (lw_relays_client[i] && !lw_relays_is_at_rest(i)) return false;
    return true;
}

static const struct lw_process *resting;
static bool daemon_is_converged(void) {
    const double tiles = lw_relays_figure(resting, "lightwell_tiles");
    return tiles && lw_relays_figure(resting, "lightwell_converged_tiles") == tiles;
}

void lw_relays_rest(const struct lw_process *daemon) {
    resting = daemon;
    lw_relays_wait(daemon_is_converged);
    lw_relays_poll(); /* the figure comes after the FRAME */
    lw_relays_wait(lw_relays_all_rest);
    lw_relays_expect_same();
}

/* Runs that a relay joins are 2^32 frames apart, and versions are twice the frames. */
static uint64_t frame_of_run(int i) { return lw_relays_stats(i).frame % (UINT64_C(1) << 32); }

static uint64_t version_of_run(int i, uint32_t tile) {
    return lw_client_get_tile(lw_relays_client[i], (lw_tile_id){tile}).version % (UINT64_C(1) << 33);
}

bool lw_relays_all_same(void) {
    const struct lw_atlas_map *map = lw_client_atlas_map(lw_relays_client[0]);
    for (int i = 0; i < LW_RELAYS_CLIENTS; i++)
        if (lw_relays_client[i] &&
            (!lw_client_atlas_map(lw_relays_client[i]) || frame_of_run(i) != frame_of_run(0) ||
             lw_relays_stats(i).settled_frame != lw_relays_stats(i).frame))
            return false;
    for (int i = 0; i < LW_RELAYS_CLIENTS; i++)
        for (uint32_t t = 0; lw_relays_client[i] && t < map->tile_count; t++)
            if (!version_of_run(i, t) || version_of_run(i, t) != version_of_run(0, t)) return false;
    return true;
}

void lw_relays_expect_same_texels(void) {
    const struct lw_atlas_map *map = lw_client_atlas_map(lw_relays_client[0]);
    for (int i = 1; i < LW_RELAYS_CLIENTS; i++)
        for (uint32_t o = 0; lw_relays_client[i] && o < map->object_count; o++)
            for (uint32_t l = 0; l < map->atlas[o]->level_count; l++) {
                const struct lw_client_level ours = lw_client_get_level(lw_relays_client[i], o, l),
                                             theirs = lw_client_get_level(lw_relays_client[0], o, l);
                assert_true(ours.width == theirs.width && ours.height == theirs.height);
                assert_memory_equal(ours.rgb, theirs.rgb,
                                    3 * sizeof(float) * (size_t)ours.width * ours.height);
            }
}

void lw_relays_expect_same(void) {
    lw_relays_wait(lw_relays_all_same);
    lw_relays_expect_same_texels();
    for (int i = 1; i < LW_RELAYS_CLIENTS; i++)
        for (uint32_t o = 0; lw_relays_client[i] && o < lw_client_scene(lw_relays_client[0])->object_count;
             o++) {
            assert_memory_equal(lw_client_object_to_world(lw_relays_client[i], o),
                                lw_client_object_to_world(lw_relays_client[0], o), sizeof(struct lw_affine));
            assert_int_equal(lw_client_object_state(lw_relays_client[i], o),
                             lw_client_object_state(lw_relays_client[0], o));
        }
}

static bool directions_are_the_same(void) {
    const struct lw_atlas_map *map = lw_client_atlas_map(lw_relays_client[0]);
    uint32_t tiles = 0;
    if (!lw_relays_all_same()) return false;
    for (uint32_t t = 0; t < map->tile_count; t++) {
        const uint64_t version = lw_client_get_tile(lw_relays_client[0], (lw_tile_id){t}).direction_version;
        if (version != lw_client_get_tile(lw_relays_client[1], (lw_tile_id){t}).direction_version)
            return false;
        tiles += version > 0;
    }
    return tiles > 4;
}

void lw_relays_expect_same_directions(void) {
    lw_relays_wait(directions_are_the_same);
    const struct lw_atlas_map *map = lw_client_atlas_map(lw_relays_client[0]);
    for (uint32_t o = 0; o < map->object_count; o++) {
        const struct lw_client_level own = lw_client_get_level(lw_relays_client[0], o, 0),
                                     far = lw_client_get_level(lw_relays_client[1], o, 0);
        if (!own.width) continue;
        assert_true(own.direction && far.direction);
        assert_memory_equal(own.direction, far.direction, 12ul * own.width * own.height);
    }
}

uint64_t lw_relays_update(int i, const struct lw_scene_change *change, struct lw_client_answer *out_answer) {
    struct lw_error err = {0};
    uint64_t request;
    lw_support_ok(lw_client_update(lw_relays_client[i], change, 1, &request, &err), &err);
    const uint64_t end_ns = lw_clock_ns() + LW_PROCESS_LIMIT_S * 1000000000ull;
    while (!lw_client_next_answer(lw_relays_client[i], out_answer)) {
        lw_relays_poll();
        assert_true(lw_clock_ns() < end_ns);
    }
    assert_int_equal(out_answer->request, request);
    return out_answer->frame;
}

void lw_relays_reconnect(int i) {
    struct lw_error err = {0};
    const uint64_t end_ns = lw_clock_ns() + LW_PROCESS_LIMIT_S * 1000000000ull;
    while (lw_client_poll(lw_relays_client[i], 10, &err) == LW_OK) assert_true(lw_clock_ns() < end_ns);
    do {
        err = (struct lw_error){0};
        assert_true(lw_clock_ns() < end_ns);
        lw_support_pause();
    } while (lw_client_reconnect(lw_relays_client[i], &err) != LW_OK);
}

double lw_relays_figure(const struct lw_process *process, const char *name) {
    struct lw_client *operator_ = NULL;
    struct lw_error err = {0};
    uint32_t code;
    char *text;
    const struct lw_client_desc desc = {.host = process->host ? process->host : "127.0.0.1",
                                        .port = process->port,
                                        .operate = true,
                                        .timeout_ms = LW_PROCESS_LIMIT_S * 1000};
    lw_support_ok(lw_client_create(&desc, &operator_, &err), &err);
    lw_support_ok(lw_client_ask(operator_, LW_ASK_STATS, 0, &err), &err);
    while (!lw_client_take_report(operator_, &code, &text))
        lw_support_ok(lw_client_poll(operator_, 100, &err), &err);
    lw_client_destroy(operator_);
    char line[100];
    snprintf(line, sizeof line, "\n%s ", name);
    const char *at = strstr(text, line);
    assert_true(code == LW_REPORT_DONE && at);
    const double value = atof(at + strlen(line));
    free(text);
    note_figure(name, value);
    return value;
}

char *lw_relays_show_tree(const struct lw_process *of) {
    char line[100];
    struct lw_process ctl;
    snprintf(line, sizeof line, "127.0.0.1:%u tree", of->port);
    lw_process_run(&ctl, "lightwellctl", line, 0);
    return lw_process_out(&ctl);
}

void lw_relays_await_in_tree(const struct lw_process *of, unsigned indent, const char *host, uint16_t port,
                             unsigned clients) {
    char name[HOST_NAME_MAX + 64], counted[64];
    snprintf(name, sizeof name, "\n%*s%s:%u ", (int)indent, "", host, port);
    snprintf(counted, sizeof counted, "clients %u ", clients);
    const uint64_t end_ns = lw_clock_ns() + LW_PROCESS_LIMIT_S * 1000000000ull;
    for (bool found = false; !found;) {
        char *text = lw_relays_show_tree(of), *at = strstr(text, name),
             *end = at ? strchr(at + 1, '\n') : NULL;
        if (end) *end = '\0';
        found = at && strstr(at, counted) && strstr(at, "light current");
        if (lw_clock_ns() > end_ns) fail_msg("\"%s\" with %s is not in \"%s\"", name, counted, text);
        free(text);
        lw_relays_poll();
    }
}

void lw_relays_await_not_in_tree(const struct lw_process *of, const char *host, uint16_t port) {
    char name[HOST_NAME_MAX + 64];
    snprintf(name, sizeof name, "%s:%u ", host, port);
    const uint64_t end_ns = lw_clock_ns() + LW_PROCESS_LIMIT_S * 1000000000ull;
    for (bool is_gone = false; !is_gone;) {
        char *text = lw_relays_show_tree(of);
        is_gone = !strstr(text, name);
        if (lw_clock_ns() > end_ns) fail_msg("\"%s\" is still in \"%s\"", name, text);
        free(text);
        lw_relays_poll();
    }
}

void lw_relays_await_other_scene(int i) {
    struct lw_error err = {0};
    while (lw_client_poll(lw_relays_client[i], 10, &err) == LW_OK) {
    }
    while (lw_client_reconnect(lw_relays_client[i], &err) != LW_OK &&
           !lw_client_found_other_scene(lw_relays_client[i]))
        lw_support_pause();
    assert_true(lw_client_found_other_scene(lw_relays_client[i]));
    lw_client_destroy(lw_relays_client[i]);
    lw_relays_client[i] = NULL;
}
