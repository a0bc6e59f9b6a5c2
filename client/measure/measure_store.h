/* measure_store.h: the measurements of a row on disk: append-only tables, from which the report is made.
 * Flow:    a unit's samples and costs -> [measure_store] -> samples.csv, costs.csv; and back
 * Threads: one thread at a time.
 *
 * A unit is one renderer at one setting in one repeat. Its lines are written at once, samples first, and
 * flushed to the disk. The line of its costs that says `all` ends it. A unit that lacks a line is not
 * measured:
 * opening the store removes its lines, and a line without its end. Unknown cells are empty.
 *
 *     samples.csv   renderer,setting,repeat,view,frame, a column per error measure
 *     costs.csv     renderer,setting,repeat,users,view, CPU seconds per frame of all these users by stage,
 *                   and more; view: a number, `some` (counts of users, in scaling runs) or `all`
 *     late.csv      view,frame,late,relmse: the error of the reference of N frames earlier
 *     row.csv       key,value: the row's options, and notes for the report
 *     failures.csv  renderer,setting,repeat,text */
#ifndef LW_CLIENT_MEASURE_MEASURE_STORE_H
#define LW_CLIENT_MEASURE_MEASURE_STORE_H

#include "client/measure/sides/renderer.h"

#define LW_MEASURE_VIEWS       12u
#define LW_MEASURE_REPEATS_MAX 21u              /* repeats from 0 on: 20, and the search of a scaling run */
#define LW_MEASURE_ALL         UINT32_MAX       /* view: all of them, each by a user */
#define LW_MEASURE_SOME        (UINT32_MAX - 1) /* view: as many as there are users; does not end a unit */
#define LW_MEASURE_NAME_SIZE   64u
#define LW_MEASURE_NOTE_SIZE   2048u

/* tag, column, what it is */
#define LW_MEASURE_COIN_MAP(X)                                                                               \
    X(RELMSE, "relmse", "relMSE, ε = 1 % of the mean square over all views, without what shines")            \
    X(RELMSE_SMALL, "relmse_1e-4", "relMSE, ε = 10⁻⁴")                                                       \
    X(RELMSE_TRIMMED, "relmse_999", "relMSE without the worst 0.1 % of the pixels")                          \
    X(FLIP, "flip", "ꟻLIP, 67 pixels per degree")                                                            \
    X(FLICKER, "flicker", "flicker: relMSE of the difference of two successive frames")

enum lw_measure_coin {
#define X(tag, name, about) LW_MEASURE_COIN_##tag,
    LW_MEASURE_COIN_MAP(X)
#undef X
        LW_MEASURE_COIN_COUNT
};

const char *lw_measure_coin_name(enum lw_measure_coin coin);
const char *lw_measure_coin_about(enum lw_measure_coin coin);

#define LW_MEASURE_CACHE "cache" /* as a renderer; the others are path renderers, by name */

struct lw_measure_unit {
    char renderer[LW_MEASURE_NAME_SIZE], setting[LW_MEASURE_NAME_SIZE]; /* no commas */
    uint32_t repeat;
};

/** Writes the name of a setting: "2 paths", "x0.5 1+2 rest 0.02 tiles". */
void lw_measure_store_setting(const struct lw_setting *setting, bool is_cache,
                              char out[LW_MEASURE_NAME_SIZE]);
bool lw_measure_store_same(const struct lw_measure_unit *a, const struct lw_measure_unit *b);

/** Errors of one view in one frame. */
struct lw_measure_sample {
    struct lw_measure_unit unit;
    uint32_t view, frame;
    double coin[LW_MEASURE_COIN_COUNT]; /* NAN: not known */
};

/* Further columns of a line of costs: name, meaning */
#define LW_MEASURE_EXTRA_MAP(X)                                                                              \
    X(WALL, "wall_s", "wall seconds per frame")                                                              \
    X(RAYS, "rays", "rays per frame")                                                                        \
    X(BYTES, "bytes", "received per frame by all these users")                                               \
    X(SERVER_MEMORY, "server_bytes", "most memory of the server")                                            \
    X(USER_MEMORY, "user_bytes", "growth of our own memory, of all these users")                             \
    X(BUILD_CPU, "build_cpu_s", "start: import, lightmap coordinates, package")                              \
    X(START_CPU, "start_cpu_s", "start: the server until its first frame, or a user's rays' structure")      \
    X(JOIN_CPU, "join_cpu_s", "start: the first client's scene and rays' structure")                         \
    X(WARM_CPU, "warm_cpu_s", "the server alone, of the frames before the ones measured")                    \
    X(WARM_FRAMES, "warm_frames", "how many these are")                                                      \
    X(START_WALL, "start_wall_s", "wall seconds until the first frame begins")                               \
    X(LAG, "lag_s", "age of the light that fits the first judged frame best, over all views")                \
    X(LAG_RELMSE, "lag_relmse", "relMSE of that fit")                                                        \
    X(LAG_RELMSE_NOW, "lag_relmse_now", "relMSE of the fit to the frame's own light")

enum lw_measure_extra {
#define X(tag, name, about) LW_MEASURE_EXTRA_##tag,
    LW_MEASURE_EXTRA_MAP(X)
#undef X
        LW_MEASURE_EXTRA_COUNT
};

struct lw_measure_expense {
    struct lw_measure_unit unit;
    uint32_t users, view;                 /* LW_MEASURE_ALL: ends the unit */
    uint32_t frames, samples;             /* measured; of the unit, in the line that ends it */
    double cpu_s[LW_STAGE_COUNT];         /* per frame */
    double extra[LW_MEASURE_EXTRA_COUNT]; /* NAN: not known */
};

/** An empty expense of a unit: NAN and 0. */
struct lw_measure_expense lw_measure_store_expense(const struct lw_measure_unit *unit, uint32_t users,
                                                   uint32_t view);
double lw_measure_store_total(const struct lw_measure_expense *expense);
/** Cost of a frame, by stage, with bytes and rays where they are known. */
struct lw_cost lw_measure_store_cost(const struct lw_measure_expense *expense);

/* Light that is a second late must be off by this multiple of the error asked for. Else nothing tests
 * motion. */
#define LW_MEASURE_GATE_TIMES 3.0

struct lw_measure_late {
    uint32_t view, frame, late;
    double relmse;
};

struct lw_measure_failure {
    struct lw_measure_unit unit;
    char text[LW_ERROR_TEXT_SIZE];
};

struct lw_measure_note {
    char key[LW_MEASURE_NAME_SIZE], value[LW_MEASURE_NOTE_SIZE];
};

struct lw_measure_store {
    char folder[3800];
    int samples_file, costs_file; /* -1: read only */
    struct lw_measure_sample *sample;
    struct lw_measure_expense *expense;
    struct lw_measure_late *late;
    struct lw_measure_failure *failure;
    struct lw_measure_note *note;
    size_t sample_count, expense_count, late_count, failure_count, note_count;
};

/** Makes the folder if it is not there, reads its tables and gets ready to append. read_only: makes and
 * changes nothing. Finish it in any case.
 * Errors: LW_CANNOT_CREATE, LW_IO, LW_NO_INPUT (read_only and no such folder), LW_BAD_DATA naming file and
 *         line, LW_NO_MEMORY. */
LW_MUST_CHECK enum lw_status lw_measure_store_open(struct lw_measure_store *store, const char *folder,
                                                   bool read_only, struct lw_error *err);
void lw_measure_store_finish(struct lw_measure_store *store);

bool lw_measure_store_has(const struct lw_measure_store *store, const struct lw_measure_unit *unit);

/** Mean error of a renderer at a setting. unit->repeat, view, frame: LW_MEASURE_ALL stands for any. NAN: not
 * known. */
double lw_measure_store_mean(const struct lw_measure_store *store, const struct lw_measure_unit *unit,
                             uint32_t view, uint32_t frame, enum lw_measure_coin coin);

/** Adds a unit. Its last expense is the sum of the others. On failure the files are as before.
 * Errors: LW_IO naming the file; LW_NO_MEMORY. */
LW_MUST_CHECK enum lw_status lw_measure_store_append(struct lw_measure_store *store,
                                                     const struct lw_measure_sample *sample,
                                                     size_t sample_count,
                                                     const struct lw_measure_expense *expense,
                                                     size_t expense_count, struct lw_error *err);

/** Replaces late.csv. Errors: LW_IO, LW_CANNOT_CREATE, LW_NO_MEMORY. */
LW_MUST_CHECK enum lw_status lw_measure_store_set_late(struct lw_measure_store *store,
                                                       const struct lw_measure_late *late, size_t count,
                                                       struct lw_error *err);

/** Sets a value and writes row.csv. Commas stay; line ends and other control characters become "?".
 * Errors: as above. */
LW_MUST_CHECK enum lw_status lw_measure_store_set(struct lw_measure_store *store, const char *key,
                                                  const char *value, struct lw_error *err);
/** NULL: not set. */
const char *lw_measure_store_get(const struct lw_measure_store *store, const char *key);
/** The same for sentences: `otherwise` where it is not set or empty. */
const char *lw_measure_store_note(const struct lw_measure_store *store, const char *key,
                                  const char *otherwise);
/** Whether a list, with "; " between entries, has this entry. */
bool lw_measure_store_lists(const char *list, const char *entry);

/** Notes that a unit failed; text NULL: removes that note. Errors: as above. */
LW_MUST_CHECK enum lw_status lw_measure_store_fail(struct lw_measure_store *store,
                                                   const struct lw_measure_unit *unit, const char *text,
                                                   struct lw_error *err);

/** Path of a picture of a unit in a row's folder: pictures/KIND-RENDERER-SETTING.ENDING. */
void lw_measure_store_picture_path(const char *folder, const char *kind, const struct lw_measure_unit *unit,
                                   const char *ending, char *out, size_t size);

#endif
