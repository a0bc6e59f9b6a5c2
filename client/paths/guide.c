#include "client/paths/guide.h"

#include "common/base/wide.h"

#include <omp.h>
#include <stdatomic.h>
#include <stdlib.h>
#include <string.h>

#define CELLS         (LW_GUIDE_SIDE * LW_GUIDE_SIDE * LW_GUIDE_SIDE)
#define SOLID_ANGLE   (4 * LW_PI / LW_GUIDE_SECTORS) /* a sector's */
#define NOTE_BITS     36                             /* one note's: 2^28 of them fit a sum */
#define HEADROOM_BITS 12                             /* above the brightest note of the pass before */
#define UNIT_FIRST    0x1p-20f                       /* W/(m^2 sr), while no brightest note is known */
#define VISITS_MAX    65535.0f                       /* by then alpha has long taken over */
#define TAKEN_MAX     0x1p24f                        /* floats count no further */

/* The notes of a sector: one cache line has four. */
struct note {
    _Atomic uint64_t sum;
    _Atomic uint32_t count;
    uint32_t visits; /* notes ever taken, up to VISITS_MAX */
};

struct lw_guide {
    struct lw_guide_desc desc;
    struct lw_vec3 cells_per_m;
    /* Per sector; calloc'ed, so that cells without a surface take no memory. Q of a cell is slice by slice,
     * the bands of each together: a vector of eight. */
    float *q;
    struct note *note;
    /* per cell */
    _Atomic uint8_t *noted; /* in this pass */
    float *taken;           /* notes ever taken */
    float unit;             /* the sums' */
    _Atomic uint32_t peak;  /* bits of the brightest note of this pass: they sort like their floats */
};

/* Middles of slices and of bands. */
static const float slice_x[LW_GUIDE_SLICES] = {0.98078528f,  0.83146961f,  0.55557023f,  0.19509032f,
                                               -0.19509032f, -0.55557023f, -0.83146961f, -0.98078528f,
                                               -0.98078528f, -0.83146961f, -0.55557023f, -0.19509032f,
                                               0.19509032f,  0.55557023f,  0.83146961f,  0.98078528f};
static const float slice_z[LW_GUIDE_SLICES] = {0.19509032f,  0.55557023f,  0.83146961f,  0.98078528f,
                                               0.98078528f,  0.83146961f,  0.55557023f,  0.19509032f,
                                               -0.19509032f, -0.55557023f, -0.83146961f, -0.98078528f,
                                               -0.98078528f, -0.83146961f, -0.55557023f, -0.19509032f};
static const float band_y[LW_GUIDE_BANDS] = {0.875f,  0.625f,  0.375f,  0.125f,
                                             -0.125f, -0.375f, -0.625f, -0.875f};
static const float band_radius[LW_GUIDE_BANDS] = {0.48412292f, 0.78062475f, 0.92702481f, 0.99215674f,
                                                  0.99215674f, 0.92702481f, 0.78062475f, 0.48412292f};

enum lw_status lw_guide_create(const struct lw_guide_desc *desc, struct lw_guide **out_guide,
                               struct lw_error *err) {
    struct lw_guide *g = calloc(1, sizeof *g);
    if (!g) return lw_status_fail(err, LW_NO_MEMORY, "no memory for guiding");
    g->desc = *desc;
    if (!(g->desc.alpha > 0)) g->desc.alpha = LW_GUIDE_ALPHA;
    if (!(g->desc.beta > 0)) g->desc.beta = LW_GUIDE_BETA;
    if (!(g->desc.trust > 0)) g->desc.trust = LW_GUIDE_TRUST;
    const struct lw_vec3 size = lw_vec3_sub(desc->maximum_ws, desc->minimum_ws);
    const float side = (float)LW_GUIDE_SIDE;
    g->cells_per_m =
        lw_vec3(side / fmaxf(size.x, 1e-20f), side / fmaxf(size.y, 1e-20f), side / fmaxf(size.z, 1e-20f));
    g->unit = UNIT_FIRST;
    const size_t sectors = (size_t)CELLS * LW_GUIDE_SECTORS;
    g->q = calloc(sectors, sizeof *g->q);
    g->note = calloc(sectors, sizeof *g->note);
    g->noted = calloc(CELLS, sizeof *g->noted);
    g->taken = calloc(CELLS, sizeof *g->taken);
    if (!g->q || !g->note || !g->noted || !g->taken) {
        lw_guide_destroy(g);
        return lw_status_fail(err, LW_NO_MEMORY, "no memory for guiding");
    }
    *out_guide = g;
    return LW_OK;
}

void lw_guide_destroy(struct lw_guide *g) {
    if (!g) return;
    free(g->q);
    free(g->note);
    free(g->noted);
    free(g->taken);
    free(g);
}

static uint32_t step_of(float from_minimum, float cells_per_m) {
    const float x = from_minimum * cells_per_m, most = (float)(LW_GUIDE_SIDE - 1);
    return x > 0 ? (uint32_t)fminf(x, most) : 0;
}

static uint32_t cell_of(const struct lw_guide *g, struct lw_vec3 point) {
    const struct lw_vec3 p = lw_vec3_sub(point, g->desc.minimum_ws);
    return (step_of(p.z, g->cells_per_m.z) * LW_GUIDE_SIDE + step_of(p.y, g->cells_per_m.y)) * LW_GUIDE_SIDE +
           step_of(p.x, g->cells_per_m.x);
}

static uint32_t sector_of(struct lw_vec3 d) {
    const float band = (1 - d.y) * (0.5f * LW_GUIDE_BANDS), turn = atan2f(d.z, d.x) * (0.5f / LW_PI);
    const float slice = (turn < 0 ? turn + 1 : turn) * LW_GUIDE_SLICES;
    const uint32_t k = band > 0 ? (uint32_t)fminf(band, LW_GUIDE_BANDS - 1) : 0;
    return (uint32_t)fminf(slice, LW_GUIDE_SLICES - 1) * LW_GUIDE_BANDS + k;
}

/* Weight of a sector among the sectors of its aim. */
static float weight_of(const struct lw_guide_aim *aim, uint32_t slice, uint32_t band) {
    const float along = aim->normal.x * slice_x[slice] + aim->normal.z * slice_z[slice];
    const float cosine = band_radius[band] * along + band_y[band] * aim->normal.y;
    return cosine > 0 ? cosine * aim->q[slice * LW_GUIDE_BANDS + band] : 0;
}

/* The same of all, summed band by band. */
LW_WIDE static void sum_bands(const float *restrict q, struct lw_vec3 normal, float *restrict out) {
    float upright[LW_GUIDE_BANDS], sum[LW_GUIDE_BANDS] = {0};
    for (uint32_t k = 0; k < LW_GUIDE_BANDS; k++) upright[k] = band_y[k] * normal.y;
    for (uint32_t j = 0; j < LW_GUIDE_SLICES; j++) {
        const float along = normal.x * slice_x[j] + normal.z * slice_z[j];
        for (uint32_t k = 0; k < LW_GUIDE_BANDS; k++) {
            const float cosine = band_radius[k] * along + upright[k];
            sum[k] += cosine > 0 ? cosine * q[j * LW_GUIDE_BANDS + k] : 0;
        }
    }
    for (uint32_t k = 0; k < LW_GUIDE_BANDS; k++) out[k] = sum[k];
}

void lw_guide_aim_at(const struct lw_guide *g, struct lw_vec3 point, struct lw_vec3 normal,
                     struct lw_guide_aim *out) {
    out->normal = normal;
    out->cell = cell_of(g, point);
    const float taken = g->taken[out->cell];
    out->beta = g->desc.beta * taken / (taken + g->desc.trust);
    out->total = 0;
    out->q = NULL;
    if (!(taken > 0)) return;
    const float *q = g->q + (size_t)out->cell * LW_GUIDE_SECTORS;
    sum_bands(q, normal, out->band);
    for (uint32_t k = 0; k < LW_GUIDE_BANDS; k++) out->total += out->band[k];
    if (out->total > 0 && isfinite(out->total)) out->q = q;
}

/* Density by Q of a sector of that weight. */
static float density_of(const struct lw_guide_aim *aim, float weight) {
    return weight / (aim->total * SOLID_ANGLE);
}

/* Mixture of that density by Q with cosine sampling. */
static float mix(const struct lw_guide_aim *aim, float by_q, struct lw_vec3 normal,
                 struct lw_vec3 direction) {
    const float cosine = fmaxf(0, lw_vec3_dot(normal, direction)) / LW_PI;
    return (1 - aim->beta) * cosine + aim->beta * by_q;
}

float lw_guide_density(const struct lw_guide_aim *aim, struct lw_vec3 normal, struct lw_vec3 d) {
    if (!aim->q) return fmaxf(0, lw_vec3_dot(normal, d)) / LW_PI;
    const uint32_t sector = sector_of(d);
    const float weight = weight_of(aim, sector / LW_GUIDE_BANDS, sector % LW_GUIDE_BANDS);
    return mix(aim, density_of(aim, weight), normal, d);
}

/* Malley's method, as lw_direction_cosine() about the normal. */
static struct lw_vec3 by_cosine(struct lw_vec3 normal, float u, float v) {
    struct lw_vec3 t, b;
    const float radius = sqrtf(u), angle = 2 * LW_PI * v;
    lw_vec3_frame(normal, &t, &b);
    return lw_vec3_mad(lw_vec3_mad(lw_vec3_scale(normal, sqrtf(fmaxf(0, 1 - u))), t, radius * cosf(angle)), b,
                       radius * sinf(angle));
}

/* Number of the weight that `at` (in [0, 1)) falls on, among `count` that sum to total. *out_rest: where in
 * it. Never a weight of 0, unless all are 0. */
static uint32_t choose(const float *weight, uint32_t count, float total, float at, float *out_rest) {
    float left = at * total;
    uint32_t last = 0;
    for (uint32_t i = 0; i < count; i++) {
        if (!(weight[i] > 0)) continue;
        last = i;
        if (left < weight[i]) break;
        left -= weight[i];
    }
    *out_rest = weight[last] > 0 ? fminf(left / weight[last], 0x1.fffffep-1f) : 0;
    return last;
}

/* A direction by Q alone. u chooses the band and the height in it, v the slice and the turn in it: strata of
 * the unit square stay strata. */
static struct lw_vec3 by_q(const struct lw_guide_aim *aim, float u, float v, uint32_t *out_sector,
                           float *out_density) {
    float weight[LW_GUIDE_SLICES], total = 0, rise, turn;
    const uint32_t k = choose(aim->band, LW_GUIDE_BANDS, aim->total, u, &rise);
    for (uint32_t j = 0; j < LW_GUIDE_SLICES; j++) total += weight[j] = weight_of(aim, j, k);
    const uint32_t j = choose(weight, LW_GUIDE_SLICES, total, v, &turn);
    const float y = 1 - ((float)k + rise) * (2.0f / LW_GUIDE_BANDS), radius = sqrtf(fmaxf(0, 1 - y * y));
    const float angle = ((float)j + turn) * (2 * LW_PI / LW_GUIDE_SLICES);
    *out_sector = j * LW_GUIDE_BANDS + k;
    *out_density = density_of(aim, weight[j]);
    return lw_vec3(radius * cosf(angle), y, radius * sinf(angle));
}

struct lw_guide_sample lw_guide_sample(const struct lw_guide_aim *aim, struct lw_vec3 normal,
                                       const float point[2]) {
    const float beta = aim->q ? aim->beta : 0;
    struct lw_guide_sample s;
    uint32_t sector;
    if (point[0] < beta) {
        float density;
        s.direction = by_q(aim, point[0] / beta, point[1], &sector, &density);
        s.density = mix(aim, density, normal, s.direction);
    } else {
        const float u = fminf((point[0] - beta) / (1 - beta), 0x1.fffffep-1f);
        s.direction = by_cosine(normal, u, point[1]);
        sector = sector_of(s.direction);
        s.density = lw_guide_density(aim, normal, s.direction);
    }
    s.place = aim->cell * LW_GUIDE_SECTORS + sector;
    return s;
}

float lw_guide_reflected(const struct lw_guide_aim *aim) {
    return aim->q ? aim->total * SOLID_ANGLE / LW_PI : 0;
}

void lw_guide_note(struct lw_guide *g, uint32_t place, float luminance) {
    const float most = 0x1p36f;
    _Static_assert(NOTE_BITS == 36, "what `most` says");
    const float l = luminance > 0 && isfinite(luminance) ? luminance : 0;
    _Atomic uint8_t *noted = &g->noted[place / LW_GUIDE_SECTORS];
    uint32_t bits, peak = atomic_load_explicit(&g->peak, memory_order_relaxed);
    memcpy(&bits, &l, sizeof bits);
    while (bits > peak)
        if (atomic_compare_exchange_weak_explicit(&g->peak, &peak, bits, memory_order_relaxed,
                                                  memory_order_relaxed))
            break;
    struct note *note = &g->note[place];
    atomic_fetch_add_explicit(&note->sum, (uint64_t)fminf(l / g->unit, most), memory_order_relaxed);
    atomic_fetch_add_explicit(&note->count, 1, memory_order_relaxed);
    if (!atomic_load_explicit(noted, memory_order_relaxed))
        atomic_store_explicit(noted, 1, memory_order_relaxed);
}

/* Returns how many notes there were. */
static uint32_t learn_sector(struct lw_guide *g, size_t i) {
    struct note *note = &g->note[i];
    const uint32_t n = atomic_load_explicit(&note->count, memory_order_relaxed);
    if (!n) return 0;
    const double sum = (double)atomic_load_explicit(&note->sum, memory_order_relaxed) * (double)g->unit;
    const float mean = (float)(sum / n), visits = (float)note->visits;
    const float by_alpha = 1 - powf(1 - g->desc.alpha, (float)n), by_count = (float)n / (visits + (float)n);
    g->q[i] += fmaxf(by_alpha, by_count) * (mean - g->q[i]);
    note->visits = (uint32_t)fminf(visits + (float)n, VISITS_MAX);
    atomic_store_explicit(&note->sum, 0, memory_order_relaxed);
    atomic_store_explicit(&note->count, 0, memory_order_relaxed);
    return n;
}

void lw_guide_learn(struct lw_guide *g, unsigned threads) {
    const int workers = threads ? (int)threads : omp_get_max_threads();
#pragma omp parallel for schedule(dynamic, 64) num_threads(workers)
    for (uint32_t c = 0; c < CELLS; c++) {
        if (!atomic_load_explicit(&g->noted[c], memory_order_relaxed)) continue;
        uint32_t notes = 0;
        for (uint32_t s = 0; s < LW_GUIDE_SECTORS; s++)
            notes += learn_sector(g, (size_t)c * LW_GUIDE_SECTORS + s);
        g->taken[c] = fminf(g->taken[c] + (float)notes, TAKEN_MAX);
        atomic_store_explicit(&g->noted[c], 0, memory_order_relaxed);
    }
    const uint32_t bits = atomic_exchange_explicit(&g->peak, 0, memory_order_relaxed);
    float peak;
    int exponent;
    memcpy(&peak, &bits, sizeof peak);
    if (!(peak > 0)) return;
    frexpf(peak, &exponent); /* peak < 2^exponent */
    g->unit = fmaxf(ldexpf(1, exponent - NOTE_BITS + HEADROOM_BITS), 0x1p-120f);
}
