#include "client/load/load_options.h"

#include "common/base/options.h"
#include "common/open/scene_open.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>

#define DEFAULT_RAMP_HZ  500
#define SLOW_KBPS_MIN    1
#define SLOW_KBPS_MAX    1e6
#define MILLISECONDS_MAX 1e6

/* Values of the table that are used here alone. */
struct raw {
    struct lw_access_options access;
    const char *address, *reader;
    int64_t users, odd_readers;
    int path;
    bool odd_readers_given;
};

static enum lw_status parse_reader(const char *text, struct lw_load_options *out, struct lw_error *err) {
    if (strcmp(text, "fast") == 0) {
        out->reader = LW_LOAD_FAST;
    } else if (strcmp(text, "never") == 0) {
        out->reader = LW_LOAD_NEVER;
    } else if (strncmp(text, "slow:", 5) == 0) {
        char *end;
        double kbps = strtod(text + 5, &end);
        if (end == text + 5 || *end != '\0' || !(kbps >= SLOW_KBPS_MIN && kbps <= SLOW_KBPS_MAX))
            return lw_status_fail(
                err, LW_USAGE,
                "--reader slow: \"%.60s\" is not a number of kilobytes per second from %d to %.0f", text + 5,
                SLOW_KBPS_MIN, SLOW_KBPS_MAX);
        out->reader = LW_LOAD_SLOW;
        out->slow_bytes_hz = kbps * 1000;
    } else {
        return lw_status_fail(err, LW_USAGE, "--reader: \"%.60s\" is none of fast, slow:KBPS, never", text);
    }
    return LW_OK;
}

static enum lw_status interpret(const struct raw *raw, struct lw_load_options *out, struct lw_error *err) {
    const char *address = raw->address ? raw->address : LW_OPTIONS_ADDRESS;
    if (lw_scene_open_is_scene(address))
        return lw_status_fail(err, LW_USAGE,
                              "\"%.200s\" is a scene, not a server: \"lightwelld %.200s\" lights it, "
                              "then lightwell-load finds that",
                              address, address);
    enum lw_status status = lw_options_address(address, out->host, sizeof out->host, &out->port, err);
    if (status == LW_OK) status = lw_access_read(&raw->access, &out->access, err);
    if (status == LW_OK) status = parse_reader(raw->reader, out, err);
    if (status != LW_OK) return status;
    if (raw->odd_readers_given && out->reader == LW_LOAD_FAST)
        return lw_status_fail(err, LW_USAGE, "--odd-readers works with --reader slow:KBPS or never only");
    if (raw->odd_readers > raw->users)
        return lw_status_fail(err, LW_USAGE, "--odd-readers: %lld of %lld users", (long long)raw->odd_readers,
                              (long long)raw->users);
    out->users = (uint32_t)raw->users;
    out->path = (enum lw_load_path)raw->path;
    out->odd_readers = out->reader == LW_LOAD_FAST ? 0
                       : raw->odd_readers_given    ? (uint32_t)raw->odd_readers
                                                   : out->users;
    return LW_OK;
}

enum lw_status lw_load_options_parse(int argc, char **argv, struct lw_load_options *out_options,
                                     bool *out_done, struct lw_error *err) {
    struct lw_load_options o = {.seconds = 10,
                                .ramp_hz = DEFAULT_RAMP_HZ,
                                .seed = 1,
                                .latency_max_ms = (double)INFINITY,
                                .first_view_max_ms = (double)INFINITY};
    struct raw raw = {.reader = "fast", .users = 100};
    const struct lw_option table[] = {
        {.name = "users",
         .argument = "N",
         .help = "sessions at the same time (default {})",
         .kind = LW_OPTION_INT,
         .value = &raw.users,
         .min = 1,
         .max = LW_LOAD_USERS_MAX},
        {.name = "seconds",
         .argument = "S",
         .help = "measured time, from the moment when the last user has begun to connect (default {})",
         .kind = LW_OPTION_REAL,
         .value = &o.seconds,
         .min = 0.1,
         .max = 1e6},
        {.name = "ramp",
         .argument = "R",
         .help = "users that begin to connect per second (default {})",
         .kind = LW_OPTION_REAL,
         .value = &o.ramp_hz,
         .min = 0.1,
         .max = 1e6},
        {.name = "path",
         .argument = "everything|walk|still|teleport",
         .help = "what a user asks for. everything: every tile{everything}. walk: what it sees on a walk. "
                 "still: from one place. teleport: from one place after another",
         .kind = LW_OPTION_CHOICE,
         .value = &raw.path},
        {.name = "reader",
         .argument = "fast|slow:KBPS|never",
         .help = "how a user reads: at once{fast}; at a rate of kilobytes per second; or not at all "
                 "after its first frame",
         .kind = LW_OPTION_STRING,
         .value = &raw.reader},
        {.name = "odd-readers",
         .argument = "N",
         .help = "how many users read so; the others read fast (default: all)",
         .kind = LW_OPTION_INT,
         .value = &raw.odd_readers,
         .min = 1,
         .max = LW_LOAD_USERS_MAX,
         .given = &raw.odd_readers_given},
        {.name = "churn",
         .argument = "R",
         .help = "users that leave per second, every other one without a goodbye, each replaced at once "
                 "(default {})",
         .kind = LW_OPTION_REAL,
         .value = &o.churn_hz,
         .min = 0,
         .max = 1e5},
        {.name = "reconnect",
         .help = "users that lose the connection, or whom the server sends away, come back, as clients do "
                 "(default: they are errors)",
         .kind = LW_OPTION_FLAG,
         .value = &o.reconnect},
        {.name = "download",
         .help = "every user downloads the scene package (default: one for all)",
         .kind = LW_OPTION_FLAG,
         .value = &o.download},
        {.name = "decode-all",
         .help = "every user decodes every tile (default: equal bytes are decoded once)",
         .kind = LW_OPTION_FLAG,
         .value = &o.decode_all},
        {.name = "seed",
         .argument = "N",
         .help = "seed of all random choices (default {})",
         .kind = LW_OPTION_INT,
         .value = &o.seed,
         .min = 0,
         .max = UINT32_MAX},
        {.name = "max-latency-ms",
         .argument = "MS",
         .help = "must hold: the update latency of 99 % of the tiles (default: any)",
         .kind = LW_OPTION_REAL,
         .value = &o.latency_max_ms,
         .min = 0,
         .max = MILLISECONDS_MAX},
        {.name = "max-first-view-ms",
         .argument = "MS",
         .help = "must hold: from connect to a complete view, for 99 % of the users (default: any)",
         .kind = LW_OPTION_REAL,
         .value = &o.first_view_max_ms,
         .min = 0,
         .max = MILLISECONDS_MAX},
        {.name = "min-frames-per-s",
         .argument = "F",
         .help = "must hold: frames per second that 99 % of the users get (default {})",
         .kind = LW_OPTION_REAL,
         .value = &o.frames_min_hz,
         .min = 0,
         .max = 1e6},
        {.name = "max-errors",
         .argument = "N",
         .help =
             "must hold: users refused or lost, and messages that broke the protocol, together (default {})",
         .kind = LW_OPTION_INT,
         .value = &o.errors_max,
         .min = 0,
         .max = 1e15},
        LW_ACCESS_OPTIONS(&raw.access),
        {.name = "series",
         .argument = "FILE",
         .help = "write CSV, a line each 100 ms: users, received bytes, and the age of their light. A scene "
                 "at rest sends nothing, and the age grows",
         .kind = LW_OPTION_STRING,
         .value = &o.series},
        {.name = "json", .help = "report as one JSON object", .kind = LW_OPTION_FLAG, .value = &o.json},
    };
    const struct lw_options options = {
        .program = "lightwell-load",
        .synopsis = "[HOST:PORT | HOST | PORT] [OPTIONS]",
        .about =
            "Loads a lightwelld (default " LW_OPTIONS_ADDRESS
            "; HOST alone: its port 7780, PORT alone: this machine) with many users at the same time, checks "
            "every byte that they get and reports how long "
            "things took. Exit code 0: all that must hold did; 1: it did not, or the run was cut short.\n"
            "lightwell-load crossover SCENE compares one server with what users would run instead, at equal "
            "error; lightwell-load scaling SCENE asks from how many users on it is cheaper. Both have "
            "--help.",
        .table = table,
        .count = sizeof table / sizeof table[0],
        .positional = &raw.address,
        .positional_min = 0,
        .positional_max = 1};
    enum lw_status status = lw_options_parse(&options, argc, argv, NULL, out_done, err);
    if (status != LW_OK || *out_done) return status;
    status = interpret(&raw, &o, err);
    if (status == LW_OK) *out_options = o;
    return status;
}
