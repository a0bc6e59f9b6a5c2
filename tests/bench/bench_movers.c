/* bench_movers: precomputed light and rays from an object that moves, against following it with the solver.
 * A table in Markdown per scene.
 *
 *     bench_movers [--object NAME] [--shift WIDTHS] [--away] [--rays N] [--error E] [--frames N]
 *     [--reference N] [--texels-per-metre D] SCENE...
 *
 * Vandersanden 2023 left open whether precomputed probes and rays from moving objects alone would do. An
 * object, the mover, stands at A, or nowhere (--away), then at B. Solves of --reference frames that never
 * converge, two for each place, are the truth; those of A are also what is precomputed. All is measured by
 * both seeds, each against its own truth. Texels that are covered at A alone, since the mover reaches into
 * something at B, are left out. Ways:
 *   nothing      all texels keep their light of A
 *   lightmaps    the mover alone is lit: N bounce rays a texel, as the solver shoots them, read what texels
 *                sent out at A; of what meets the mover itself, what the mover sent out at A. "direct light
 *                of B": what texels send out of direct light is the truth's of B, later orders are of A
 *   probes       likewise by the solver's probes at a tracing range of next to nothing, filled at A. By
 *                depth, they decline where they cannot know. "+ rays": what they decline is traced, as in the
 *                solver. "alone": it is left out, and a texel has the mean of what they answer. "box": asked
 *                at the scene's box, as in the thesis. "alone" is timed with all surfaces hidden, so that its
 *                rays meet nothing, and these are not counted
 *   told by n    still blocks (16 x 16 texels) that one of the first n such rays of a texel meets, from A or
 *                from B, have the truth of B; others keep A. "p % that most meet": those that most of them
 *                meet, p % of all still blocks. Cost: of the rays from both places; for n < N a share
 *   followed     the solver converges at A to an error of E and goes on at B until it has converged again.
 *                Told are the blocks that it solves; what it corrects without a solve is not counted
 * The mover's direct light is the truth's in all rows but the first: every way wants it. "followed" alone
 * pays for it, and for the still scene's light: what it costs to solve told blocks is in no other row.
 *
 * relMSE as in bench_light.h, by the epsilon of the whole scene. In brackets without noise, as bench_hybrid
 * has it: mean((a-t)(b-u) / (m^2+eps)). A texel, or the mean of a block, changes if both seeds say so, the
 * same way. Change: sum of |E_B - E_A| over told blocks, over that over all still ones: the noise of texels
 * beside lamps is much of it. Squared: likewise of the two seeds' products (E_B - E_A) / (m^2+eps), without
 * noise. */
#include "common/clock.h"
#include "server/solve/transport/bounces.h"
#include "server/solve/transport/ray_hit.h"
#include "tests/bench/bench_shift.h"
#include "tests/bench/movers_truth.h"

#include <math.h>
#include <stdio.h>
#include <string.h>

#define GATHERINGS 64u   /* of 128 rays from each probe */
#define NO_RANGE   1e-4f /* of a cell's side: bench_thesis calls it 0 */
#define RAY_SEED   100u

/* ---- rows ---- */

/* A way, as shown[] and told[] have it; cost: of all seeds. */
struct row {
    const char *name;
    unsigned parts; /* that it says something about */
    bool tells;
    struct movers_cost cost;
};

static void print_share(double of, double all) {
    if (all > 0)
        printf(" %.1f %% |", 100 * of / all);
    else
        printf(" – |");
}

/* Of still blocks, and of those that change, the share that is told. */
static void print_blocks(const struct movers *m) {
    static const uint8_t parts[] = {STILL, STILL_CHANGED, STILL_SLIGHTLY};
    for (size_t k = 0; k < sizeof parts; k++) {
        uint32_t all = 0, told = 0;
        for (uint32_t b = 0; b < m->block_count; b++) {
            if (!(m->part_of[b] & parts[k])) continue;
            all += MOVERS_SEEDS;
            for (uint32_t seed = 0; seed < MOVERS_SEEDS; seed++) told += m->told[seed][b];
        }
        print_share(told, all);
    }
}

/* Of the still change, the share that is told. */
static void print_change(const struct movers *m) {
    double all = 0, told = 0, all_square = 0, told_square = 0;
    for (uint32_t i = 0; i < m->count; i++) {
        double d[MOVERS_SEEDS], mean = 0;
        if (!(m->part[i] & STILL)) continue;
        for (uint32_t seed = 0; seed < MOVERS_SEEDS; seed++) {
            const double b = movers_truth_luminance(m, B, seed, i);
            d[seed] = b - movers_truth_luminance(m, A, seed, i);
            mean += b / MOVERS_SEEDS;
        }
        const double share = (m->told[0][m->block[i]] + m->told[1][m->block[i]]) / 2.0,
                     square = fmax(-1, fmin(1, d[0] * d[1] / (mean * mean + m->epsilon)));
        all += fabs(d[0] + d[1]);
        told += share * fabs(d[0] + d[1]);
        all_square += square;
        told_square += share * square;
    }
    print_share(told, all);
    print_share(told_square, all_square);
}

static void print_row(const struct movers *m, const struct row *row) {
    printf("| %s |", row->name);
    if (row->tells) {
        print_blocks(m);
        print_change(m);
    } else
        printf(" – | – | – | – | – |");
    for (unsigned part = MOVER; part <= STILL_CHANGED; part *= 2) {
        const struct movers_error e =
            row->parts & part ? movers_truth_error(m, part) : (struct movers_error){0};
        if (e.count)
            printf(" %.5f (%.5f) |", e.plain, e.clean);
        else
            printf(" – |");
    }
    printf(" %.4f | %.3f |\n", row->cost.cpu_s / MOVERS_SEEDS, 1e-6 * (double)row->cost.rays / MOVERS_SEEDS);
    fflush(stdout);
}

static void add_cost(struct movers_cost *sum, const struct movers_cost *more) {
    sum->cpu_s += more->cpu_s;
    sum->rays += more->rays;
}

/* ---- rays from the mover ---- */

/* What reads its rays. NULL: nobody. */
struct volley {
    struct lw_transport transport;
    float *sum;         /* three values for each of its texels */
    uint64_t *answered; /* sum has what probes answer alone; how often they do, for each of its texels */
    struct movers_sight *sight; /* per block */
    struct movers_cost cost;
};

static struct volley volley_of(const struct movers *m, uint32_t seed) {
    struct volley v = {.transport = lw_cell_frame_transport(m->solver[seed])};
    v.transport.seed = RAY_SEED + seed;
    return v;
}

static void see(const struct volley *v, uint32_t hit, uint32_t ray) {
    if (hit & LW_RAY_HIT_PROBE) return; /* nothing, too */
    struct movers_sight *sight = &v->sight[v->transport.tiles->block_of_texel[hit]];
    if (!sight->hits++) sight->first = ray;
}

static struct lw_vec3 ask(const struct lw_transport *t, uint32_t hit) {
    struct lw_vec3 sum = {0};
    for (uint32_t bounce = 0; bounce < t->tiles->bounces; bounce++)
        sum = lw_vec3_add(
            sum, lw_probes_radiance(t->probes, bounce, lw_ray_hit_probe(hit), lw_ray_hit_direction(hit)));
    return lw_vec3_scale(sum, LW_PI);
}

/* Rays of a round of the mover's texel i. */
static void read_texel(struct volley *v, uint32_t i, uint32_t texel, uint32_t round) {
    const struct lw_transport *t = &v->transport;
    const uint32_t n = t->indirect_samples, *hit = t->ray_hit + (size_t)texel * n;
    struct lw_vec3 e = {0};
    for (uint32_t s = 0; s < n; s++) {
        if (v->sight) see(v, hit[s], round * n + s + 1);
        if (!v->answered || hit[s] == LW_RAY_HIT_NOTHING || !(hit[s] & LW_RAY_HIT_PROBE)) continue;
        e = lw_vec3_add(e, ask(t, hit[s]));
        v->answered[i]++;
    }
    if (v->sight && t->reflected[texel].weight > 0) see(v, t->reflected[texel].texel, round * n + 1);
    if (!v->sum) return;
    for (uint32_t bounce = 1; !v->answered && bounce <= t->tiles->bounces; bounce++)
        e = lw_vec3_add(e, lw_bounces_at(t, texel, bounce));
    v->sum[3 * (size_t)i] += e.x;
    v->sum[3 * (size_t)i + 1] += e.y;
    v->sum[3 * (size_t)i + 2] += e.z;
}

static uint32_t rounds_of(const struct movers *m) {
    const uint32_t samples = m->solver[0]->desc.indirect_samples;
    return ((uint32_t)m->settings->rays + samples - 1) / samples;
}

static void shoot(const struct movers *m, struct volley *v) {
    const struct lw_tiles *tiles = v->transport.tiles;
    const uint64_t began_ns = lw_clock_process_cpu_ns();
    struct lw_ray_count count = {0};
    for (uint32_t round = 0; round < rounds_of(m); round++) {
        for (uint32_t k = 0; k < tiles->count; k++) {
            if (tiles->tile[k].object != m->mover) continue;
            LW_TILES_EACH_BLOCK (&tiles->tile[k], block) {
                block->due = true;
                block->sample_count = round;
            }
            lw_bounces_trace(&v->transport, &tiles->tile[k], &count);
        }
        for (uint32_t i = m->first; i < m->end; i++) read_texel(v, i - m->first, m->texel[i], round);
    }
    v->cost = (struct movers_cost){1e-9 * (double)(lw_clock_process_cpu_ns() - began_ns), count.bounce};
}

/* Shoots, and shows the mover with the truth's direct light and the indirect light that it finds. */
static enum lw_status light_mover(const struct movers *m, uint32_t seed, struct volley *v, bool alone,
                                  struct lw_error *err) {
    const uint32_t texels = m->end - m->first;
    if (!(v->sum = movers_truth_take(m, 3 * (size_t)texels, sizeof *v->sum)) ||
        (alone && !(v->answered = movers_truth_take(m, texels, sizeof *v->answered))))
        return lw_status_fail(err, LW_NO_MEMORY, "%u texels", texels);
    shoot(m, v);
    for (uint32_t k = 0; k < 3 * texels; k++) {
        const uint32_t v3 = 3 * m->first + k;
        const double samples = alone ? fmax(1, (double)v->answered[k / 3]) : rounds_of(m);
        m->shown[seed][v3] = m->direct[seed][v3] + (float)((double)v->sum[k] / samples);
    }
    return LW_OK;
}

/* By what is sent at A, or, direct light alone, at B. Notes what rays from B meet. */
static enum lw_status run_lightmaps(const struct movers *m, bool direct_of_b, struct movers_cost *telling,
                                    struct lw_error *err) {
    struct row row = {.name = direct_of_b ? "lightmaps, direct light of B" : "lightmaps", .parts = MOVER};
    enum lw_status status = LW_OK;
    for (uint32_t seed = 0; seed < MOVERS_SEEDS && status == LW_OK; seed++) {
        struct volley v = volley_of(m, seed);
        float **sent = &v.transport.tiles->radiance[0], *of_a = *sent;
        if (direct_of_b)
            *sent = m->sent[seed];
        else
            v.sight = m->sight[B][seed];
        status = light_mover(m, seed, &v, false, err);
        *sent = of_a;
        add_cost(&row.cost, &v.cost);
    }
    if (status == LW_OK) print_row(m, &row);
    if (!direct_of_b) add_cost(telling, &row.cost);
    return status;
}

/* alone: a structure of rays without a surface; NULL: what probes decline is traced in the scene */
static enum lw_status run_probes(struct movers *m, const char *name, enum lw_probe_projection projection,
                                 const struct lw_trace *alone, struct lw_error *err) {
    const double launched = (double)(m->end - m->first) * rounds_of(m) * m->solver[0]->desc.indirect_samples;
    struct row row = {.parts = MOVER};
    double answered = 0;
    char text[64];
    for (uint32_t seed = 0; seed < MOVERS_SEEDS; seed++) {
        struct volley v = volley_of(m, seed);
        m->probes[seed].desc.projection = projection;
        v.transport.probes = &m->probes[seed];
        v.transport.tracing_range_m = NO_RANGE * lw_vec3_max_abs(m->probes[seed].grid.size_m);
        if (alone) v.transport.trace = alone;
        enum lw_status status = light_mover(m, seed, &v, alone != NULL, err);
        if (status != LW_OK) return status;
        answered += 2 - (double)v.cost.rays / launched; /* all rays end at once; what is declined goes on */
        v.cost.rays = alone ? 0 : v.cost.rays - (uint64_t)launched;
        add_cost(&row.cost, &v.cost);
    }
    snprintf(text, sizeof text, "%s, %.0f %% answered", name, 100 * answered / MOVERS_SEEDS);
    row.name = text;
    print_row(m, &row);
    return LW_OK;
}

/* With all surfaces hidden. */
static enum lw_status run_probes_alone(struct movers *m, struct lw_error *err) {
    struct lw_pose pose;
    struct lw_trace *trace = NULL;
    if (lw_pose_init(&pose, m->scene) != LW_OK) return lw_status_fail(err, LW_NO_MEMORY, "poses");
    for (uint32_t o = 0; o < m->scene->object_count; o++)
        pose.object_dynamic[o] = pose.object_hidden[o] = true;
    enum lw_status status = lw_trace_create(m->scene, &pose, &trace, err);
    if (status == LW_OK) status = run_probes(m, "probes alone", LW_PROBE_PROJECTION_DEPTH, trace, err);
    if (status == LW_OK) status = run_probes(m, "probes alone, box", LW_PROBE_PROJECTION_BOX, trace, err);
    lw_trace_destroy(trace);
    lw_pose_finish(&pose);
    return status;
}

/* ---- told blocks ---- */

static uint32_t hits_of(const struct movers *m, uint32_t seed, uint32_t block) {
    return m->sight[A][seed][block].hits + m->sight[B][seed][block].hits;
}

/* Tells still blocks that one of the first `rays` of a texel has met, from A or from B. */
static void tell_by(const struct movers *m, uint32_t rays) {
    for (uint32_t seed = 0; seed < MOVERS_SEEDS; seed++)
        for (uint32_t b = 0; b < m->block_count; b++) {
            const struct movers_sight *a = &m->sight[A][seed][b], *o = &m->sight[B][seed][b];
            m->told[seed][b] =
                (m->part_of[b] & STILL) && ((a->hits && a->first <= rays) || (o->hits && o->first <= rays));
        }
}

/* Of those that are told, a share of all still ones: those that most rays have met. */
static void tell_most(const struct movers *m, double share) {
    for (uint32_t seed = 0; seed < MOVERS_SEEDS; seed++) {
        uint32_t still = 0, least = 0, told = UINT32_MAX;
        for (uint32_t b = 0; b < m->block_count; b++) still += (m->part_of[b] & STILL) != 0;
        while (told > share * still) { /* some doublings */
            told = 0;
            least += least / 64 + 1;
            for (uint32_t b = 0; b < m->block_count; b++)
                told += (m->part_of[b] & STILL) && hits_of(m, seed, b) >= least;
        }
        for (uint32_t b = 0; b < m->block_count; b++)
            m->told[seed][b] = (m->part_of[b] & STILL) && hits_of(m, seed, b) >= least;
    }
}

/* Shows the truth of A, and that of B in blocks that are told. */
static void print_told(const struct movers *m, const char *name, struct movers_cost cost) {
    for (uint32_t seed = 0; seed < MOVERS_SEEDS; seed++)
        for (uint32_t v = 0; v < 3 * m->count; v++)
            m->shown[seed][v] = m->truth[m->told[seed][m->block[v / 3]] ? B : A][seed][v];
    print_row(m, &(struct row){name, STILL | STILL_CHANGED, true, cost});
}

static void run_told(const struct movers *m, const struct movers_cost *whole) {
    const uint32_t all = (uint32_t)m->settings->rays, few = all < 4 ? all : 4;
    char name[64];
    snprintf(name, sizeof name, "told by %u", few);
    tell_by(m, few);
    print_told(m, name, (struct movers_cost){whole->cpu_s * few / all, whole->rays * few / all});
    snprintf(name, sizeof name, "told by %u", all);
    tell_by(m, all);
    print_told(m, name, *whole);
    for (uint32_t percent = 30; percent > 1; percent /= 3) {
        snprintf(name, sizeof name, "told by %u, %u %% that most meet", all, percent);
        tell_most(m, 0.01 * percent);
        print_told(m, name, *whole);
    }
}

static enum lw_status follow(const struct movers *m, uint32_t seed, struct movers_cost *cost,
                             struct lw_error *err) {
    struct lw_cell_solver *s = NULL;
    struct movers_cost ignored = {0};
    float *light, *direct;
    const int64_t frames = m->settings->frames;
    memset(m->told[seed], 0, m->block_count);
    enum lw_status status = movers_truth_create(m, A, m->settings->error, 1 + seed, &s, err);
    if (status == LW_OK) status = movers_truth_go_on(m, s, A, frames, &ignored, NULL, err);
    if (status == LW_OK) status = movers_truth_go_on(m, s, B, frames, cost, m->told[seed], err);
    if (status == LW_OK) status = movers_truth_read(m, s, &light, &direct, err);
    for (uint32_t v = 0; status == LW_OK && v < 3 * m->count; v++)
        m->shown[seed][v] = light[v] + (m->part[v / 3] == MOVER ? m->direct[seed][v] - direct[v] : 0);
    movers_truth_destroy(s);
    return status;
}

static enum lw_status run_followed(const struct movers *m, struct lw_error *err) {
    struct row row = {.name = "followed", .parts = MOVER | STILL | STILL_CHANGED, .tells = true};
    enum lw_status status = LW_OK;
    for (uint32_t seed = 0; seed < MOVERS_SEEDS && status == LW_OK; seed++)
        status = follow(m, seed, &row.cost, err);
    if (status == LW_OK) print_row(m, &row);
    return status;
}

/* ---- a scene ---- */

static enum lw_status fill_probes(struct movers *m, uint32_t seed, struct lw_error *err) {
    const struct lw_cell_solver *s = m->solver[seed];
    struct lw_probes *probes = &m->probes[seed];
    const uint64_t began_ns = lw_clock_process_cpu_ns();
    struct lw_probes_desc desc = {.scene = m->scene, .bounces = s->desc.bounces, .seed = RAY_SEED + seed};
    lw_pose_bounds(&s->pose, m->scene, &desc.minimum_ws, &desc.maximum_ws);
    if (lw_probes_init(probes, &desc) != LW_OK) return lw_status_fail(err, LW_NO_MEMORY, "probes");
    uint64_t rays = lw_probes_place(probes, &s->pose, s->geometry->trace, s->threads);
    const struct lw_wall_sides sides = lw_geometry_sides(s->geometry);
    for (uint32_t g = 0; g < GATHERINGS; g++) {
        rays += lw_probes_gather(probes, &sides, g, true, s->threads);
        for (uint32_t bounce = 0; bounce < desc.bounces; bounce++)
            lw_probes_project(probes, bounce, s->tiles.radiance[bounce], UINT32_MAX, s->threads);
    }
    m->filling = (struct movers_cost){1e-9 * (double)(lw_clock_process_cpu_ns() - began_ns), rays};
    return LW_OK;
}

/* The mover alone goes to B: what all texels send out stays as it was at A. */
static enum lw_status carry(const struct movers *m, struct lw_cell_solver *s, struct lw_error *err) {
    lw_pose_copy(&s->pose, &m->pose[B], m->scene);
    enum lw_status status = lw_geometry_set_pose(s->geometry, &s->pose, false, s->frames, err);
    if (status != LW_OK) return status;
    lw_tiles_recount(&s->tiles, s->threads);
    lw_tiles_set_pose(&s->tiles, &s->cells, &s->pose);
    lw_reflectors_place(&s->reflectors, &s->tiles);
    return LW_OK;
}

/* Fills probes, sees what there is from A, and takes the mover to B. */
static enum lw_status prepare(struct movers *m, struct movers_cost *telling, struct lw_error *err) {
    for (uint32_t seed = 0; seed < MOVERS_SEEDS; seed++) {
        enum lw_status status = fill_probes(m, seed, err);
        if (status != LW_OK) return status;
        struct volley v = volley_of(m, seed);
        v.sight = m->sight[A][seed];
        if (!m->settings->away) shoot(m, &v);
        add_cost(telling, &v.cost);
        status = carry(m, m->solver[seed], err);
        if (status != LW_OK) return status;
    }
    return LW_OK;
}

/* What is known before any way has been tried. */
static void print_scene(const struct movers *m, const char *label) {
    uint32_t blocks = 0, changed = 0, slightly = 0;
    for (uint32_t b = 0; b < m->block_count; b++) {
        blocks += (m->part_of[b] & STILL) != 0;
        changed += (m->part_of[b] & STILL_CHANGED) != 0;
        slightly += (m->part_of[b] & STILL_SLIGHTLY) != 0;
    }
    for (uint32_t seed = 0; seed < MOVERS_SEEDS; seed++)
        memcpy(m->shown[seed], m->truth[B][1 - seed], 3 * (size_t)m->count * sizeof(float));
    const struct movers_error mover = movers_truth_error(m, MOVER), still = movers_truth_error(m, STILL),
                              changing = movers_truth_error(m, STILL_CHANGED);
    printf("\n### %s, %s%s\n\n"
           "%u texels of the mover, %u still, of which %u change by over a tenth; relMSE of one seed's truth "
           "against the other's: %.5f, %.5f, %.5f. %u still blocks; %u change by over a tenth, %u by over "
           "2 %%. %u probes, filled by %.1f M rays in %.1f CPU s.\n\n"
           "| way | still blocks told | of those that change by 10 %% | by 2 %% | change | squared | relMSE "
           "mover | still | still that change | CPU s | Mrays "
           "|\n|---|---|---|---|---|---|---|---|---|---|---|\n",
           label, m->settings->object, m->settings->away ? " that appears" : "", mover.count, still.count,
           changing.count, mover.plain, still.plain, changing.plain, blocks, changed, slightly,
           m->probes[0].alive, 1e-6 * (double)m->filling.rays, m->filling.cpu_s);
    for (uint32_t seed = 0; seed < MOVERS_SEEDS; seed++)
        memcpy(m->shown[seed], m->truth[A][seed], 3 * (size_t)m->count * sizeof(float));
    print_row(m, &(struct row){.name = "nothing", .parts = MOVER | STILL | STILL_CHANGED, .tells = true});
}

static enum lw_status measure(struct movers *m, const char *label, struct lw_error *err) {
    struct movers_cost telling = {0};
    enum lw_status status = movers_truth_find(m, err);
    if (status == LW_OK) status = prepare(m, &telling, err);
    if (status != LW_OK) return status;
    print_scene(m, label);
    status = run_lightmaps(m, false, &telling, err);
    if (status == LW_OK) status = run_lightmaps(m, true, &telling, err);
    if (status == LW_OK) status = run_probes(m, "probes + rays", LW_PROBE_PROJECTION_DEPTH, NULL, err);
    if (status == LW_OK) status = run_probes_alone(m, err);
    if (status != LW_OK) return status;
    run_told(m, &telling);
    return run_followed(m, err);
}

static enum lw_status run(void *context, const char *path, struct lw_error *err) {
    const struct movers_settings *set = context;
    struct movers m = {.settings = set};
    char label[64];
    enum lw_status status =
        bench_open(&set->open, path, BENCH_MOTION_OWN, 0, &m.scene, &m.pose[A], &m.map, err);
    if (status == LW_OK) status = bench_shift(m.scene, set->object, (float)set->shift, &m.mover, err);
    lw_pose_finish(&m.pose[A]);
    for (int place = A; place < MOVERS_PLACES && status == LW_OK; place++) {
        if (lw_pose_init(&m.pose[place], m.scene) != LW_OK)
            status = lw_status_fail(err, LW_NO_MEMORY, "poses of %s", path);
        else
            lw_pose_evaluate(&m.pose[place], m.scene, place);
    }
    if (status == LW_OK) {
        m.pose[A].object_hidden[m.mover] = set->away;
        status = measure(&m, bench_label(path, label, sizeof label), err);
    }
    for (uint32_t seed = 0; seed < MOVERS_SEEDS; seed++) {
        lw_probes_finish(&m.probes[seed]);
        movers_truth_destroy(m.solver[seed]);
    }
    lw_pose_finish(&m.pose[B]);
    bench_close(m.scene, &m.pose[A], &m.map);
    return status;
}

int main(int argc, char **argv) {
    struct movers_settings s = {.open.threads = 1,
                                .object = "amphora",
                                .shift = 1,
                                .error = 0.1,
                                .rays = 64,
                                .frames = 4096,
                                .reference_frames = 512};
    const struct lw_option table[] = {
        {"object", "NAME", "what moves (default amphora)", LW_OPTION_STRING, &s.object, 0, 0, NULL},
        {"shift", "WIDTHS", "by so much along its own x (default 1)", LW_OPTION_REAL, &s.shift, -1000, 1000,
         NULL},
        {"away", NULL, "before it moves, it is not there", LW_OPTION_FLAG, &s.away, 0, 0, NULL},
        {"rays", "N", "from each texel of it, an even number (default 64)", LW_OPTION_INT, &s.rays, 2, 4096,
         NULL},
        {"error", "E", "relative error at which the solver that follows converges (default 0.1)",
         LW_OPTION_REAL, &s.error, 1e-4, 1, NULL},
        {"frames", "N", "at most, of that solver, at A and at B (default 4096)", LW_OPTION_INT, &s.frames, 8,
         1000000, NULL},
        {"reference", "N", "frames of each solve that counts as the truth (default 512)", LW_OPTION_INT,
         &s.reference_frames, 1, 1000000, NULL}};
    return bench_main(
        &(struct bench_program){.name = "bench_movers",
                                .about = "Precomputed light and rays from an object that moves, against "
                                         "following it, as tables in Markdown.",
                                .table = table,
                                .count = sizeof table / sizeof table[0],
                                .open = &s.open,
                                .context = &s,
                                .run = run},
        argc, argv);
}
