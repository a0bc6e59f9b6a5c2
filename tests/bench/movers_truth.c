#include "tests/bench/movers_truth.h"

#include "common/clock.h"
#include "common/colour.h"
#include "tests/bench/bench_light.h"

#include <math.h>
#include <string.h>

#define CHANGED  0.1
#define SLIGHTLY 0.02
#define IDLE     20 /* as in bench_change */

void *movers_truth_take(const struct movers *m, size_t count, size_t size) {
    return lw_scene_alloc(m->scene, count + 1, size);
}

/* ---- solving ---- */

enum lw_status movers_truth_create(const struct movers *m, int place, double error, uint32_t seed,
                                   struct lw_cell_solver **out, struct lw_error *err) {
    struct lw_solver_desc desc = bench_light_desc(m->scene, &m->map, error, seed);
    struct lw_solver *solver;
    desc.threads = (unsigned)m->settings->open.threads;
    enum lw_status status = lw_cell_layer_create(NULL, &desc, &m->pose[place], &solver, err);
    if (status == LW_OK) *out = (struct lw_cell_solver *)solver;
    return status;
}

void movers_truth_destroy(struct lw_cell_solver *s) {
    if (s) s->base.ops->destroy(&s->base);
}

enum lw_status movers_truth_go_on(const struct movers *m, struct lw_cell_solver *s, int place, int64_t frames,
                                  struct movers_cost *cost, uint8_t *solved, struct lw_error *err) {
    const uint64_t began_ns = lw_clock_process_cpu_ns();
    struct lw_solver_stats stats;
    for (int64_t i = 0, idle = 0; i < frames && idle < IDLE; i++, idle++) {
        enum lw_status status =
            s->base.ops->frame(&s->base, &m->pose[place], (uint64_t)(place * frames + i + 1), &stats, err);
        if (status != LW_OK) return status;
        cost->rays += stats.rays_shadow + stats.rays_bounce;
        for (uint32_t b = 0; solved && b < s->tiles.block_count; b++) solved[b] |= s->tiles.block[b].due;
        if (stats.tiles_solved) idle = 0;
    }
    cost->cpu_s += 1e-9 * (double)(lw_clock_process_cpu_ns() - began_ns);
    return LW_OK;
}

enum lw_status movers_truth_read(const struct movers *m, const struct lw_cell_solver *s, float **out_all,
                                 float **out_direct, struct lw_error *err) {
    float *all = movers_truth_take(m, 3 * (size_t)m->count, sizeof *all),
          *direct = movers_truth_take(m, 3 * (size_t)m->count, sizeof *direct);
    if (!all || !direct) return lw_status_fail(err, LW_NO_MEMORY, "%u texels", m->count);
    for (uint32_t v = 0; v < 3 * m->count; v++) {
        const uint32_t texel = m->texel[v / 3];
        if (!s->tiles.covered[texel]) m->part[v / 3] = 0;
        direct[v] = s->tiles.direct[v % 3][texel];
        all[v] = direct[v] + s->tiles.indirect[v % 3][texel];
    }
    *out_all = all;
    *out_direct = direct;
    return LW_OK;
}

/* ---- what there is, and what changes ---- */

static enum lw_status list_texels(struct movers *m, const struct lw_tiles *tiles, struct lw_error *err) {
    const uint32_t most = tiles->texel_count, blocks = tiles->block_count;
    m->block_count = blocks;
    bool ok = (m->texel = movers_truth_take(m, most, sizeof *m->texel)) &&
              (m->block = movers_truth_take(m, most, sizeof *m->block)) &&
              (m->part = movers_truth_take(m, most, 1)) && (m->part_of = movers_truth_take(m, blocks, 1));
    for (uint32_t seed = 0; ok && seed < MOVERS_SEEDS; seed++) {
        ok = (m->shown[seed] = movers_truth_take(m, 3 * (size_t)most, sizeof(float))) &&
             (m->sent[seed] = movers_truth_take(m, 4 * (size_t)most, sizeof(float))) &&
             (m->told[seed] = movers_truth_take(m, blocks, 1));
        for (int place = A; ok && place < MOVERS_PLACES; place++)
            ok = (m->sight[place][seed] = movers_truth_take(m, blocks, sizeof(struct movers_sight)));
    }
    if (!ok) return lw_status_fail(err, LW_NO_MEMORY, "%u texels", most);
    for (uint32_t texel = 0; texel < most; texel++) {
        const uint32_t block = tiles->block_of_texel[texel], i = m->count;
        if (!tiles->covered[texel]) continue;
        const bool moves = m->map.place[tiles->block[block].tile_id].object == m->mover;
        if (moves && !m->end) m->first = i;
        if (moves) m->end = i + 1; /* texels of an object lie together */
        m->texel[i] = texel;
        m->block[i] = block;
        m->part[i] = m->part_of[block] = moves ? MOVER : STILL;
        m->count++;
    }
    return m->end ? LW_OK : lw_status_fail(err, LW_BAD_DATA, "\"%s\" has no texels", m->settings->object);
}

double movers_truth_luminance(const struct movers *m, int place, uint32_t seed, uint32_t i) {
    const float *e = m->truth[place][seed] + 3 * (size_t)i;
    return (double)lw_colour_luminance(lw_vec3(e[0], e[1], e[2]));
}

/* Whether both seeds say that light has changed by more than a share of it, the same way. */
static bool has_changed(double light[MOVERS_PLACES][MOVERS_SEEDS], double share) {
    const double d0 = light[B][0] - light[A][0], d1 = light[B][1] - light[A][1];
    return d0 * d1 > 0 && fabs(d0) > share * light[A][0] && fabs(d1) > share * light[A][1];
}

static enum lw_status find_change(struct movers *m, struct lw_error *err) {
    double(*sum)[MOVERS_PLACES][MOVERS_SEEDS] = movers_truth_take(m, m->block_count, sizeof *sum), square = 0;
    if (!sum) return lw_status_fail(err, LW_NO_MEMORY, "%u blocks", m->block_count);
    for (uint32_t i = 0; i < m->count; i++) {
        double light[MOVERS_PLACES][MOVERS_SEEDS];
        if (!m->part[i]) continue;
        for (int place = A; place < MOVERS_PLACES; place++)
            for (uint32_t seed = 0; seed < MOVERS_SEEDS; seed++)
                sum[m->block[i]][place][seed] += light[place][seed] =
                    movers_truth_luminance(m, place, seed, i);
        if (m->part[i] == STILL && has_changed(light, CHANGED)) m->part[i] |= STILL_CHANGED;
        for (uint32_t v = 3 * i; v < 3 * i + 3; v++)
            square += (double)m->truth[B][0][v] * (double)m->truth[B][1][v];
    }
    m->epsilon = 0.01 * square / (3 * (double)m->count);
    for (uint32_t b = 0; b < m->block_count; b++) {
        if (m->part_of[b] != STILL) continue;
        if (has_changed(sum[b], SLIGHTLY)) m->part_of[b] |= STILL_SLIGHTLY;
        if (has_changed(sum[b], CHANGED)) m->part_of[b] |= STILL_CHANGED;
    }
    return LW_OK;
}

static enum lw_status solve_truth(struct movers *m, int place, uint32_t seed, struct lw_error *err) {
    struct lw_cell_solver *s = NULL;
    struct movers_cost ignored = {0};
    enum lw_status status = movers_truth_create(m, place, -1, 7 + 2 * seed + (uint32_t)place, &s, err);
    if (status == LW_OK)
        status = movers_truth_go_on(m, s, place, m->settings->reference_frames, &ignored, NULL, err);
    if (status == LW_OK && !m->texel) status = list_texels(m, &s->tiles, err);
    if (status == LW_OK) status = movers_truth_read(m, s, &m->truth[place][seed], &m->direct[seed], err);
    if (place == A) {
        m->solver[seed] = s;
        return status;
    }
    if (status == LW_OK)
        memcpy(m->sent[seed], s->tiles.radiance[0], 4 * (size_t)s->tiles.texel_count * sizeof(float));
    movers_truth_destroy(s);
    return status;
}

enum lw_status movers_truth_find(struct movers *m, struct lw_error *err) {
    enum lw_status status = LW_OK;
    for (int place = A; place < MOVERS_PLACES; place++)
        for (uint32_t seed = 0; seed < MOVERS_SEEDS && status == LW_OK; seed++)
            status = solve_truth(m, place, seed, err);
    return status == LW_OK ? find_change(m, err) : status;
}

struct movers_error movers_truth_error(const struct movers *m, unsigned part) {
    struct movers_error e = {0};
    for (uint32_t i = 0; i < m->count; i++) {
        double product = 0;
        if (!(m->part[i] & part)) continue;
        for (uint32_t v = 3 * i; v < 3 * i + 3; v++) {
            const double t = (double)m->truth[B][0][v], u = (double)m->truth[B][1][v], mean = (t + u) / 2;
            product +=
                ((double)m->shown[0][v] - t) * ((double)m->shown[1][v] - u) / (mean * mean + m->epsilon) / 3;
        }
        for (uint32_t seed = 0; seed < MOVERS_SEEDS; seed++)
            e.plain += bench_light_error(m->shown[seed] + 3 * (size_t)i, m->truth[B][seed] + 3 * (size_t)i,
                                         m->epsilon) /
                       MOVERS_SEEDS;
        e.clean += fmax(-1, fmin(1, product));
        e.count++;
    }
    e.plain /= fmax(1, e.count);
    e.clean /= fmax(1, e.count);
    return e;
}
