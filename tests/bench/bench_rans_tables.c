/* bench_rans_tables: the tables of codec 4's entropy coder, counted on tiles, and what they cost on tiles
 * they were not counted on.
 *
 *     bench_codec --dump FILE SCENE          for each scene
 *     bench_rans_tables [--unseen FILE] FILE FILE...
 *
 * Tiles are coded whole with steps of 0.1, 0.2 and 0.5, those of "a frame on" as what changed, with 0.1. A
 * coefficient's context is its diagonal and the class of its neighbours' sum, or that it is the last of its
 * list; a length's is the class of the lengths beside it (proto/wire_format.md). Contexts that cost least to
 * count together are put together until as many tables are left as the format has. Each scene counts as much
 * as any other.
 *   own        bits per texel that a look-up may read, by tables counted on this scene alone
 *   others     by tables counted on the other FILEs
 *   shipped    by those of common/tile/tile_rans.c
 *   as coded   by lw_tile_rans_put(): shipped, 3, and the lanes' states
 * Bits are of coefficients and lengths, not of means. Last come the tables counted on all FILEs, as
 * tile_rans.c has them. --unseen is measured alone. */
#include "common/log.h"
#include "common/options.h"
#include "common/tile/tile_dct.h"

#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#define FILES_MAX          16u
#define CLASSES            15u
#define DIAGONALS          4u
#define TOKENS             LW_TILE_RANS_TOKENS
#define NEAR_CONTEXTS      (DIAGONALS * CLASSES)
#define COEFFICIENT_TABLES 16u /* the last one is of a list's last coefficient */
#define TABLES             LW_TILE_RANS_TABLES
#define LENGTH_TABLES      (TABLES - COEFFICIENT_TABLES)
#define BLOCKS             (LW_TILE_SIDE / LW_TILE_RANS_SIDE)
#define SET_BEFORE         3u /* bench_codec's set "moving" and, after it, "a frame on" */
#define SET_CHANGED        4u
#define KINDS              4u

static const struct {
    const char *name;
    float step;
} kinds[KINDS] = {{"step 0.1", 0.1f}, {"step 0.2", 0.2f}, {"step 0.5", 0.5f}, {"what changed", 0.1f}};

/* How often each token was met. */
struct counts {
    double near[NEAR_CONTEXTS][TOKENS], last[1][TOKENS], length[CLASSES][TOKENS];
};

struct scene {
    const char *path;
    struct counts counts[KINDS];
    double raw_bits[KINDS], coded_bits[KINDS], covered[KINDS];
};

/* As the format has them. */
struct tables {
    uint32_t share[TABLES][TOKENS];
    uint32_t near[NEAR_CONTEXTS], last[1], length[CLASSES]; /* table by context */
};

struct token {
    uint32_t base, raw_bits;
};

struct bench {
    struct lw_tile_dct dct;
    struct token level_token[TOKENS], length_token[TOKENS];
    uint32_t length_tokens;
    struct lw_tile_dct_history history, **before; /* the latter by tile of SET_BEFORE */
    size_t before_count;
    int16_t change[3 * LW_TILE_DCT_PLANE_COEFFICIENTS];
    uint8_t payload[LW_TILE_DCT_BOUND], delta[LW_TILE_DCT_BOUND];
    float rgb[3 * LW_TILE_TEXELS_MAX];
    uint8_t covered[LW_TILE_TEXELS_MAX];
};

/* ---- what the format is ---- */

/* The tokens of a table, and how many slots it gives them. */
static uint32_t tokens_of(const struct lw_tile_rans *rans, uint32_t table, struct token *token,
                          uint32_t *share) {
    uint32_t count = 0;
    for (uint32_t i = 0; i < LW_TILE_RANS_SLOTS; i += share[count++]) {
        const uint32_t slot = rans->slot[table][i];
        token[count] = (struct token){slot >> 24, slot >> 20 & 7};
        share[count] = slot & (LW_TILE_RANS_SLOTS - 1);
    }
    return count;
}

static void shipped_tables(const struct lw_tile_rans *rans, struct tables *out) {
    struct token token[TOKENS];
    memset(out, 0, sizeof *out);
    for (uint32_t t = 0; t < TABLES; t++) {
        uint32_t share[TOKENS];
        const uint32_t count = tokens_of(rans, t, token, share);
        /* the table of last coefficients begins with a token of no slots */
        memcpy(out->share[t] + (t == COEFFICIENT_TABLES - 1), share, count * sizeof *share);
    }
    for (uint32_t i = 0; i < NEAR_CONTEXTS; i++) out->near[i] = rans->near_table[i / CLASSES][i % CLASSES];
    out->last[0] = COEFFICIENT_TABLES - 1;
    for (uint32_t sum = 0; sum < sizeof rans->length_table; sum++)
        out->length[rans->class_of_sum[sum]] = rans->length_table[sum];
}

/* ---- counting ---- */

static uint32_t count_token(const struct token *token, uint32_t tokens, uint32_t value, double *count,
                            double *raw_bits) {
    uint32_t t = tokens - 1;
    while (token[t].base > value) t--;
    count[t]++;
    *raw_bits += token[t].raw_bits;
    return t;
}

static void count_block(const struct bench *b, const int16_t *coefficient, const uint8_t *scan,
                        uint32_t length, struct counts *counts, double *raw_bits) {
    uint8_t near[LW_TILE_RANS_PLACES] = {0};
    for (uint32_t i = length; i-- > 0;) {
        const uint32_t size = (uint32_t)abs(coefficient[scan[i]]);
        uint32_t sum = 0;
        for (uint32_t n = 0; n < 5; n++) sum += near[b->dct.rans.neighbour[i][n]];
        double *count = i + 1 == length
                            ? counts->last[0]
                            : counts->near[b->dct.rans.diagonal[i] * CLASSES + b->dct.rans.class_of_sum[sum]];
        near[i] = (uint8_t)(size < LW_TILE_RANS_NEAR_MAX ? size : LW_TILE_RANS_NEAR_MAX);
        if (count_token(b->level_token, TOKENS, size, count, raw_bits) == TOKENS - 1) *raw_bits += 16;
    }
}

static void count_coefficients(struct bench *b, const int16_t *coefficient, uint32_t width, uint32_t height,
                               struct counts *counts, double *raw_bits) {
    const uint32_t across = (width + 7) / 8, down = (height + 7) / 8;
    for (uint32_t p = 0; p < 3; p++) {
        uint32_t length[BLOCKS][BLOCKS];
        for (uint32_t y = 0; y < down; y++)
            for (uint32_t x = 0; x < across; x++) {
                const uint32_t w = x + 1 < across ? 8 : width - x * 8, h = y + 1 < down ? 8 : height - y * 8;
                const int16_t *block = coefficient + ((p * down + y) * BLOCKS + x) * LW_TILE_RANS_PLACES;
                const uint8_t *scan = b->dct.rans.scan[w][h] + 1;
                uint32_t n = w * h - 1;
                while (n && !block[scan[n - 1]]) n--;
                const uint32_t left = x   ? length[y][x - 1]
                                      : y ? length[y - 1][x]
                                          : 0,
                               above = y ? length[y - 1][x] : left;
                length[y][x] = n;
                count_token(b->length_token, b->length_tokens, n,
                            counts->length[b->dct.rans.class_of_sum[left + above]], raw_bits);
                count_block(b, block, scan, n, counts, raw_bits);
            }
    }
}

static void count_kind(struct bench *b, const int16_t *coefficient, uint32_t width, uint32_t height,
                       unsigned kind, struct scene *scene) {
    count_coefficients(b, coefficient, width, height, &scene->counts[kind], &scene->raw_bits[kind]);
    scene->coded_bits[kind] += 8.0 * (double)lw_tile_rans_put(&b->dct.rans, 3, coefficient, width, height,
                                                              b->covered, 0, b->payload);
    for (uint32_t t = 0; t < width * height; t++) scene->covered[kind] += b->covered[t] != 0;
}

/* The tile in b->rgb, after b->history: its coefficients, or how they differ from those if that is
 * shorter. */
static void count_tile(struct bench *b, uint32_t width, uint32_t height, float dark, unsigned kind,
                       struct scene *scene) {
    struct lw_tile_dct_coded coded;
    memcpy(b->change, b->history.coefficients.coefficient, sizeof b->change);
    lw_tile_dct_encode(
        &b->dct,
        &(struct lw_tile_dct_source){b->rgb, b->covered, width, height, kinds[kind].step, dark, NULL},
        &b->history, b->payload, b->delta, &coded);
    const bool is_delta = coded.delta_size && coded.delta_size < coded.size;
    for (uint32_t i = 0; i < 3 * LW_TILE_DCT_PLANE_COEFFICIENTS; i++)
        b->change[i] = (int16_t)(b->history.coefficients.coefficient[i] - (is_delta ? b->change[i] : 0));
    count_kind(b, b->change, width, height, kind, scene);
}

static enum lw_status keep_before(struct bench *b) {
    struct lw_tile_dct_history **more = realloc(b->before, (b->before_count + 1) * sizeof *more),
                               *history =
                                   aligned_alloc(_Alignof(struct lw_tile_dct_history), sizeof *history);
    if (more) b->before = more;
    if (!more || !history) return free(history), LW_NO_MEMORY;
    *history = b->history;
    b->before[b->before_count++] = history;
    return LW_OK;
}

static void drop_before(struct bench *b) {
    while (b->before_count) free(b->before[--b->before_count]);
}

/* The next tile of a file, into b->rgb and b->covered; false at its end. */
static enum lw_status read_tile(struct bench *b, FILE *file, uint32_t head[3], float noise[2],
                                bool *out_is_there) {
    *out_is_there = false;
    if (fread(head, 4, 3, file) != 3) return feof(file) ? LW_OK : LW_IO;
    if (head[1] - 1 >= LW_TILE_SIDE || head[2] - 1 >= LW_TILE_SIDE) return LW_BAD_DATA;
    const size_t texels = (size_t)head[1] * head[2];
    if (fread(noise, 4, 2, file) != 2 || fread(b->rgb, 12, texels, file) != texels ||
        fread(b->covered, 1, texels, file) != texels)
        return LW_BAD_DATA;
    *out_is_there = true;
    return LW_OK;
}

static enum lw_status count_file(struct bench *b, FILE *file, struct scene *scene) {
    size_t changed = 0;
    for (;;) {
        uint32_t head[3];
        float noise[2];
        bool is_there;
        enum lw_status status = read_tile(b, file, head, noise, &is_there);
        if (status != LW_OK || !is_there) return status;
        if (head[0] == SET_CHANGED) {
            if (changed == b->before_count) return LW_BAD_DATA;
            b->history = *b->before[changed++];
            count_tile(b, head[1], head[2], noise[1], KINDS - 1, scene);
            continue;
        }
        for (unsigned kind = KINDS - 1; kind-- > 0;) {
            memset(&b->history, 0, sizeof b->history);
            count_tile(b, head[1], head[2], noise[1], kind, scene);
        }
        if (head[0] == SET_BEFORE && (status = keep_before(b)) != LW_OK) return status;
    }
}

static enum lw_status count_scene(struct bench *b, const char *path, struct scene *scene,
                                  struct lw_error *err) {
    FILE *file = fopen(path, "rb");
    if (!file) return lw_status_fail(err, LW_IO, "%s", path);
    scene->path = path;
    enum lw_status status = count_file(b, file, scene);
    drop_before(b);
    fclose(file);
    if (!(scene->covered[0] > 0)) status = LW_BAD_DATA;
    return status == LW_OK ? LW_OK
                           : lw_status_fail(err, status, "%s: not what bench_codec --dump wrote", path);
}

/* ---- tables of counts ---- */

static double sum_of(const double *count) {
    double sum = 0;
    for (uint32_t t = 0; t < TOKENS; t++) sum += count[t];
    return sum;
}

/* Bits of all tokens, each with a probability as its share of them. */
static double entropy_of(const double *count) {
    const double sum = sum_of(count);
    double bits = 0;
    for (uint32_t t = 0; t < TOKENS; t++)
        if (count[t] > 0) bits += count[t] * log2(sum / count[t]);
    return bits;
}

static void add(double *to, const double *from, double weight) {
    for (uint32_t t = 0; t < TOKENS; t++) to[t] += weight * from[t];
}

/* Deals 1024 slots. Each token from `first` on has one at least, and one more goes where it saves most. */
static void share_slots(const double *count, uint32_t first, uint32_t tokens, uint32_t *share) {
    uint32_t left = LW_TILE_RANS_SLOTS;
    for (uint32_t t = first; t < tokens; t++, left--) share[t] = 1;
    for (; left; left--) {
        uint32_t best = first;
        double most = -1;
        for (uint32_t t = first; t < tokens; t++) {
            const double saved = count[t] * log2((share[t] + 1.0) / share[t]);
            if (saved > most) most = saved, best = t;
        }
        share[best]++;
    }
}

/* `contexts` of them, of which rows of CLASSES are neighbours, by `tables` tables from number `first` on:
 * those that cost least to count together are put together. Tables are in the order of what they expect. */
static void merge(double (*count)[TOKENS], uint32_t contexts, uint32_t tables, uint32_t first,
                  const struct token *token, uint32_t tokens, struct tables *out, uint32_t *table_of) {
    double group[NEAR_CONTEXTS][TOKENS] = {{0}}, mean[NEAR_CONTEXTS];
    uint32_t group_of[NEAR_CONTEXTS], groups = contexts;
    for (uint32_t i = 0; i < contexts; i++) {
        group_of[i] = i;
        add(group[i], count[i], 1);
        /* one that was hardly met is like the class before it */
        if (i % CLASSES && sum_of(group[i - 1]) > 0) add(group[i], group[i - 1], 1e-9 / sum_of(group[i - 1]));
    }
    for (; groups > tables; groups--) {
        uint32_t a = 0, b = 1;
        double least = (double)INFINITY;
        for (uint32_t i = 0; i < groups; i++)
            for (uint32_t j = i + 1; j < groups; j++) {
                double both[TOKENS] = {0};
                add(both, group[i], 1);
                add(both, group[j], 1);
                const double lost = entropy_of(both) - entropy_of(group[i]) - entropy_of(group[j]);
                if (lost < least) least = lost, a = i, b = j;
            }
        add(group[a], group[b], 1);
        memcpy(group[b], group[groups - 1], sizeof group[b]);
        for (uint32_t i = 0; i < contexts; i++)
            group_of[i] = group_of[i] == b ? a : group_of[i] == groups - 1 ? b : group_of[i];
    }
    for (uint32_t g = 0; g < groups; g++) {
        mean[g] = 0;
        for (uint32_t t = 0; t < tokens; t++) mean[g] += group[g][t] * token[t].base / sum_of(group[g]);
    }
    for (uint32_t g = 0; g < groups; g++) {
        uint32_t place = first;
        for (uint32_t other = 0; other < groups; other++)
            place += mean[other] < mean[g] || (mean[other] == mean[g] && other < g);
        share_slots(group[g], 0, tokens, out->share[place]);
        for (uint32_t i = 0; i < contexts; i++)
            if (group_of[i] == g) table_of[i] = place;
    }
}

static void make_tables(const struct bench *b, struct counts *counts, struct tables *out) {
    memset(out, 0, sizeof *out);
    merge(counts->near, NEAR_CONTEXTS, COEFFICIENT_TABLES - 1, 0, b->level_token, TOKENS, out, out->near);
    merge(counts->length, CLASSES, LENGTH_TABLES, COEFFICIENT_TABLES, b->length_token, b->length_tokens, out,
          out->length);
    out->last[0] = COEFFICIENT_TABLES - 1;
    share_slots(counts->last[0], 1, TOKENS, out->share[COEFFICIENT_TABLES - 1]);
}

/* Adds a scene's tokens, of all kinds, as shares of them. */
static void add_scene(const struct scene *scene, struct counts *to) {
    double all = 0;
    for (unsigned k = 0; k < KINDS; k++) {
        const double *from = scene->counts[k].near[0];
        for (size_t i = 0; i < sizeof *to / sizeof *from; i++) all += from[i];
    }
    for (unsigned k = 0; k < KINDS; k++) {
        const double *from = scene->counts[k].near[0];
        double *sum = to->near[0];
        for (size_t i = 0; i < sizeof *to / sizeof *from; i++) sum[i] += from[i] / all;
    }
}

/* ---- what they cost ---- */

static double bits_of(double (*count)[TOKENS], uint32_t contexts, const struct tables *tables,
                      const uint32_t *table_of) {
    double bits = 0;
    for (uint32_t i = 0; i < contexts; i++)
        for (uint32_t t = 0; t < TOKENS; t++)
            if (count[i][t] > 0)
                bits += count[i][t] * log2((double)LW_TILE_RANS_SLOTS / tables->share[table_of[i]][t]);
    return bits;
}

/* Per texel. */
static double cost(struct scene *scene, unsigned kind, const struct tables *tables) {
    struct counts *c = &scene->counts[kind];
    return (scene->raw_bits[kind] + bits_of(c->near, NEAR_CONTEXTS, tables, tables->near) +
            bits_of(c->last, 1, tables, tables->last) + bits_of(c->length, CLASSES, tables, tables->length)) /
           scene->covered[kind];
}

static void report(const struct bench *b, struct scene *scene, size_t scenes, size_t counted) {
    struct tables shipped;
    shipped_tables(&b->dct.rans, &shipped);
    puts("| scene | tiles | own | others | shipped | as coded |\n|---|---|---|---|---|---|");
    for (size_t s = 0; s < scenes; s++) {
        struct counts own_counts = {0}, other_counts = {0};
        struct tables own, others;
        add_scene(&scene[s], &own_counts);
        for (size_t other = 0; other < counted; other++)
            if (other != s) add_scene(&scene[other], &other_counts);
        make_tables(b, &own_counts, &own);
        make_tables(b, &other_counts, &others);
        for (unsigned k = 0; k < KINDS; k++)
            if (scene[s].covered[k] > 0) {
                const double by_own = cost(&scene[s], k, &own), by_others = cost(&scene[s], k, &others),
                             by_shipped = cost(&scene[s], k, &shipped);
                printf("| %s | %s | %.3f | %.3f (%+.1f %%) | %.3f (%+.1f %%) | %.3f |\n", scene[s].path,
                       kinds[k].name, by_own, by_others, 100 * (by_others / by_own - 1), by_shipped,
                       100 * (by_shipped / by_own - 1), scene[s].coded_bits[k] / scene[s].covered[k]);
            }
    }
}

static void print_row(const uint32_t *number, uint32_t count) {
    for (uint32_t i = 0; i < count; i++) printf("%s%u", i ? ", " : "    {", number[i]);
    puts("},");
}

static void print_tables(const struct bench *b, const struct scene *scene, size_t counted) {
    struct counts counts = {0};
    struct tables t;
    for (size_t s = 0; s < counted; s++) add_scene(&scene[s], &counts);
    make_tables(b, &counts, &t);
    puts("\nshare_of");
    for (uint32_t i = 0; i < TABLES; i++)
        print_row(t.share[i], i < COEFFICIENT_TABLES ? TOKENS : b->length_tokens);
    puts("near_tables");
    for (uint32_t d = 0; d < DIAGONALS; d++) print_row(t.near + d * CLASSES, CLASSES);
    puts("length_tables");
    print_row(t.length, CLASSES);
}

int main(int argc, char **argv) {
    const char *unseen = NULL, *path[FILES_MAX];
    const struct lw_option table[] = {{"unseen", "FILE", "measure these tiles too, but never count them",
                                       LW_OPTION_STRING, &unseen, 0, 0, NULL}};
    const struct lw_options options = {.program = "bench_rans_tables",
                                       .synopsis = "[OPTIONS] FILE FILE...",
                                       .about =
                                           "The tables of codec 4, counted on tiles of bench_codec --dump.",
                                       .table = table,
                                       .count = sizeof table / sizeof table[0],
                                       .positional = path,
                                       .positional_min = 2,
                                       .positional_max = FILES_MAX - 1};
    static struct scene scene[FILES_MAX];
    static struct bench b;
    struct lw_error err = {0};
    size_t counted = 0;
    bool done = false;
    lw_log_init("bench_rans_tables", LW_LOG_WARNING);
    enum lw_status status = lw_options_parse(&options, argc, argv, &counted, &done, &err);
    if (status == LW_OK && done) return 0;
    const size_t scenes = counted + (unseen != NULL);
    if (unseen) path[counted] = unseen;
    lw_tile_dct_init(&b.dct);
    uint32_t share[TOKENS];
    tokens_of(&b.dct.rans, 0, b.level_token, share);
    b.length_tokens = tokens_of(&b.dct.rans, COEFFICIENT_TABLES, b.length_token, share);
    for (size_t s = 0; status == LW_OK && s < scenes; s++) status = count_scene(&b, path[s], &scene[s], &err);
    if (status == LW_OK) {
        report(&b, scene, scenes, counted);
        print_tables(&b, scene, counted);
    }
    free(b.before);
    return status == LW_OK ? 0 : lw_log_failure(&err);
}
