/* bench_lights: what direct light costs, and how far it is off, as the lamps become more. CSV on stdout.
 *
 *     bench_lights [--frames N] [--reference N] [--texels-per-metre D] point:N|spot:N|area:N|SCENE...
 *
 * point:N: a hall of 24 m x 24 m x 6 m with 36 pillars, and N lamps in the air by chance (of area: squares of
 * 5 cm, two triangles each). The strongest are 100 times as strong as the weakest; all together are always as
 * strong. The solver's direct pass lights the hall, or any other scene, frame by frame, with one worker; a
 * row says what there is after 1, 2, 4, ... frames:
 *   us_per_texel    CPU microseconds of the direct pass per texel so far; those of the hall's lamps are not
 *   lit
 *   rays_per_texel  shadow rays so far
 *   relmse          of the texels' E: mean((x - a)(x - b) / (t^2 + eps)): a, b two references with seeds of
 *   their own after
 *                   --reference frames, t their mean, eps 1 % of the mean of t^2: their own noise drops out.
 *   bias            mean of x over that of t, less 1 */
#include "common/builtin/builtin_stage.h"
#include "common/clock.h"
#include "common/colour.h"
#include "common/lightmap/lightmap.h"
#include "common/random.h"
#include "server/solve/solvers.h"
#include "server/solve/transport/direct_light.h"
#include "tests/bench/bench_setup.h"

#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#define HALL_M       24.0f
#define HEIGHT_M     6.0f
#define PILLARS      6u /* a side */
#define PILLAR_M     0.7f
#define APART_M      0.3f /* of a lamp from walls and pillars */
#define SQUARE_M     0.05f
#define POWER        3000.0f /* W/sr, of all lamps together */
#define LAMPS_MAX    100000
#define REFERENCES   2u
#define LAMPS_OBJECT 2u /* behind walls and pillars */

static const struct {
    const char *name;
    enum { POINT, SPOT, AREA } value;
} kinds[] = {{"point", POINT}, {"spot", SPOT}, {"area", AREA}};

struct settings {
    struct lw_scene_open open;
    int64_t frames, reference;
};

/* What the hook below reads and fills. */
static struct {
    uint32_t lamps; /* the object that is not lit, or LW_SCENE_NONE */
    uint64_t cpu_ns, rays;
} meter;

void __real_lw_direct_light_solve(const struct lw_transport *p, struct lw_solve_tile *tile,
                                  struct lw_ray_count *count);
void __wrap_lw_direct_light_solve(const struct lw_transport *p, struct lw_solve_tile *tile,
                                  struct lw_ray_count *count);
_Static_assert(__builtin_types_compatible_p(__typeof__(lw_direct_light_solve),
                                            __typeof__(__wrap_lw_direct_light_solve)),
               "the parameters of lw_direct_light_solve have changed");

void __wrap_lw_direct_light_solve(const struct lw_transport *p, struct lw_solve_tile *tile,
                                  struct lw_ray_count *count) {
    if (tile->object == meter.lamps) return;
    const uint64_t began_ns = lw_clock_thread_cpu_ns();
    __real_lw_direct_light_solve(p, tile, count);
    meter.cpu_ns += lw_clock_thread_cpu_ns() - began_ns;
    meter.rays += count->shadow;
}

/* ---- the hall ---- */

static float number(uint32_t *state) { return lw_random_unit(*state = lw_random_hash(*state + 1)); }

/* The middle of a pillar, along either side of the hall. */
static float pillar_at(uint32_t i) { return HALL_M * (((float)i + 0.5f) / PILLARS - 0.5f); }

static void add_hall(struct lw_builtin_stage *stage) {
    const uint32_t grey = lw_builtin_stage_material(stage, "grey", lw_vec3(0.5f, 0.5f, 0.5f), LW_SCENE_NONE);
    struct lw_builtin_mesh mesh;
    lw_builtin_mesh_init(&mesh);
    mesh.material = grey;
    const float h = HALL_M / 2;
    const struct lw_vec3 x = lw_vec3(HALL_M, 0, 0), y = lw_vec3(0, HEIGHT_M, 0), z = lw_vec3(0, 0, HALL_M),
                         back_x = lw_vec3(-HALL_M, 0, 0), back_z = lw_vec3(0, 0, -HALL_M);
    lw_builtin_mesh_quad(&mesh, lw_vec3(-h, 0, h), x, back_z, 0);
    lw_builtin_mesh_quad(&mesh, lw_vec3(-h, HEIGHT_M, -h), x, z, 0);
    lw_builtin_mesh_quad(&mesh, lw_vec3(-h, 0, -h), x, y, 0);
    lw_builtin_mesh_quad(&mesh, lw_vec3(h, 0, h), back_x, y, 0);
    lw_builtin_mesh_quad(&mesh, lw_vec3(-h, 0, h), back_z, y, 0);
    lw_builtin_mesh_quad(&mesh, lw_vec3(h, 0, -h), z, y, 0);
    lw_builtin_stage_object(stage, "walls", &mesh,
                            lw_builtin_stage_node(stage, "walls", LW_SCENE_NONE, lw_vec3(0, 0, 0)));
    mesh.material = grey;
    for (uint32_t i = 0; i < PILLARS * PILLARS; i++) {
        const float at_x = pillar_at(i % PILLARS), at_z = pillar_at(i / PILLARS);
        lw_builtin_mesh_box(&mesh, lw_vec3(at_x - PILLAR_M / 2, 0, at_z - PILLAR_M / 2),
                            lw_vec3(at_x + PILLAR_M / 2, HEIGHT_M, at_z + PILLAR_M / 2), LW_BUILTIN_SIDES);
    }
    lw_builtin_stage_object(stage, "pillars", &mesh,
                            lw_builtin_stage_node(stage, "pillars", LW_SCENE_NONE, lw_vec3(0, 0, 0)));
    lw_builtin_mesh_finish(&mesh);
}

/* A place in the air. */
static struct lw_vec3 place_of(uint32_t *state) {
    for (;;) {
        const struct lw_vec3 at = lw_vec3((number(state) - 0.5f) * (HALL_M - 2 * APART_M),
                                          APART_M + number(state) * (HEIGHT_M - 2 * APART_M),
                                          (number(state) - 0.5f) * (HALL_M - 2 * APART_M));
        bool free = true;
        for (uint32_t i = 0; i < PILLARS * PILLARS; i++)
            free &= fmaxf(fabsf(at.x - pillar_at(i % PILLARS)), fabsf(at.z - pillar_at(i / PILLARS))) >
                    PILLAR_M / 2 + APART_M;
        if (free) return at;
    }
}

static void add_lamps(struct lw_builtin_stage *stage, int kind, uint32_t count) {
    enum { CLASSES = 8 }; /* of strength, each a material of its own where surfaces shine */
    uint32_t material[CLASSES], state = 7 * count;
    double strength[CLASSES], sum = 0;
    for (uint32_t c = 0; c < CLASSES; c++) strength[c] = pow(100, (double)c / (CLASSES - 1));
    for (uint32_t i = 0; i < count; i++) sum += strength[i % CLASSES];
    struct lw_builtin_mesh mesh;
    lw_builtin_mesh_init(&mesh);
    for (uint32_t c = 0; c < CLASSES && kind == AREA; c++) {
        /* as strong on its axis as a point */
        const float radiance = (float)((double)POWER * strength[c] / sum) / (SQUARE_M * SQUARE_M);
        material[c] = lw_builtin_stage_material(stage, "lamp", lw_vec3(0, 0, 0), LW_SCENE_NONE);
        lw_builtin_stage_emission(stage, material[c], (float[3]){radiance, radiance, radiance});
    }
    for (uint32_t i = 0; i < count; i++) {
        const float power = (float)((double)POWER * strength[i % CLASSES] / sum);
        const struct lw_vec3 at = place_of(&state), intensity = lw_vec3(power, power, power);
        const float z = 2 * number(&state) - 1, angle = 2 * LW_PI * number(&state), r = sqrtf(1 - z * z);
        const struct lw_vec3 axis = lw_vec3(r * cosf(angle), z, r * sinf(angle));
        struct lw_vec3 u, v;
        lw_vec3_frame(axis, &u, &v);
        if (kind == POINT) lw_builtin_stage_point(stage, "lamp", LW_SCENE_NONE, at, intensity);
        if (kind == SPOT)
            lw_builtin_stage_spot(stage, "lamp", LW_SCENE_NONE, at, axis, intensity, 0.4f, 0.8f);
        if (kind != AREA) continue;
        mesh.material = material[i % CLASSES];
        lw_builtin_mesh_quad(&mesh, at, lw_vec3_scale(u, SQUARE_M), lw_vec3_scale(v, SQUARE_M), 0);
    }
    if (kind == AREA)
        lw_builtin_stage_object(stage, "lamps", &mesh,
                                lw_builtin_stage_node(stage, "lamps", LW_SCENE_NONE, lw_vec3(0, 0, 0)));
    lw_builtin_mesh_finish(&mesh);
}

static enum lw_status build_hall(const struct settings *s, int kind, uint32_t lamps,
                                 struct lw_scene **out_scene, struct lw_error *err) {
    struct lw_builtin_stage stage;
    if (lw_builtin_stage_init(&stage, "hall") != LW_OK) return lw_status_fail(err, LW_NO_MEMORY, "the hall");
    add_hall(&stage);
    add_lamps(&stage, kind, lamps);
    enum lw_status status = lw_builtin_stage_finish(&stage, out_scene, err);
    if (status != LW_OK) return status;
    const double density = s->open.texels_per_metre;
    const struct lw_lightmap_desc desc = {.texels_per_metre = density > 0 ? (float)density : 2.5f};
    return lw_lightmap_build(*out_scene, &desc, NULL, err);
}

/* ---- runs ---- */

struct run {
    const struct settings *settings;
    struct lw_scene *scene;
    struct lw_pose pose;
    struct lw_atlas_map map;
    float *reference[REFERENCES], *value; /* luminance of E by covered texel of the hall; count */
    size_t count, capacity;
    double eps;
};

static enum lw_status read_light(struct run *r, const struct lw_solver *solver, float *out) {
    r->count = 0;
    for (uint32_t id = 0; id < r->map.tile_count; id++) {
        struct lw_solver_tile tile;
        if (r->map.place[id].level || r->map.place[id].object == meter.lamps) continue;
        solver->ops->read_tile(solver, (lw_tile_id){id}, &tile);
        for (uint32_t i = 0; i < tile.width * tile.height; i++)
            if (tile.covered[i])
                out[r->count++] =
                    lw_colour_luminance(lw_vec3(tile.direct[0][i], tile.direct[1][i], tile.direct[2][i]));
    }
    return r->count ? LW_OK : LW_BAD_DATA;
}

static void print_row(const struct run *r, const char *name, uint32_t frame) {
    char label[64];
    double error = 0, sum = 0, reference = 0;
    for (size_t i = 0; i < r->count; i++) {
        const double x = (double)r->value[i], a = (double)r->reference[0][i], b = (double)r->reference[1][i];
        error += (x - a) * (x - b) / ((a + b) * (a + b) / 4 + r->eps);
        sum += x;
        reference += (a + b) / 2;
    }
    const double texels = (double)r->count;
    printf("%s,%zu,%u,%.4f,%.3f,%.6g,%.5f\n", bench_label(name, label, sizeof label), r->count, frame,
           1e-3 * (double)meter.cpu_ns / texels, (double)meter.rays / texels, error / texels,
           sum / reference - 1);
    fflush(stdout);
}

/* `out`: what there is after the last frame; name: prints rows on the way. */
static enum lw_status solve(struct run *r, uint32_t seed, int64_t frames, float *out, const char *name,
                            struct lw_error *err) {
    struct lw_solver *solver;
    struct lw_solver_stats stats;
    enum lw_status status = lw_solvers_create(NULL,
                                              &(struct lw_solver_desc){.scene = r->scene,
                                                                       .atlas_map = &r->map,
                                                                       .direct_samples = 1,
                                                                       .indirect_samples = 1,
                                                                       .target_error = -1,
                                                                       .seed = seed,
                                                                       .threads = 1},
                                              &r->pose, &solver, err);
    if (status != LW_OK) return status;
    meter.cpu_ns = meter.rays = 0;
    for (int64_t f = 1; status == LW_OK && f <= frames; f++) {
        status = solver->ops->frame(solver, &r->pose, (uint64_t)f, &stats, err);
        if (status != LW_OK || (name ? (f & (f - 1)) != 0 : f != frames)) continue;
        status = read_light(r, solver, out);
        if (name && status == LW_OK) print_row(r, name, (uint32_t)f);
    }
    solver->ops->destroy(solver);
    return status;
}

static enum lw_status measure(struct run *r, const char *name, struct lw_error *err) {
    enum lw_status status = LW_OK;
    for (uint32_t id = 0; id < r->map.tile_count; id++)
        if (!r->map.place[id].level) r->capacity += (size_t)r->map.place[id].width * r->map.place[id].height;
    r->value = calloc(r->capacity, sizeof *r->value);
    for (uint32_t j = 0; j < REFERENCES; j++) r->reference[j] = calloc(r->capacity, sizeof *r->reference[j]);
    if (!r->value || !r->reference[0] || !r->reference[1])
        return lw_status_fail(err, LW_NO_MEMORY, "the light of the hall");
    for (uint32_t j = 0; status == LW_OK && j < REFERENCES; j++)
        status = solve(r, 1000 + j, r->settings->reference, r->reference[j], NULL, err);
    if (status != LW_OK) return status;
    for (size_t i = 0; i < r->count; i++) {
        const double t = ((double)r->reference[0][i] + (double)r->reference[1][i]) / 2;
        r->eps += 0.01 * t * t / (double)r->count;
    }
    return solve(r, 1, r->settings->frames, r->value, name, err);
}

/* KIND:N is a hall of N lamps, anything else a scene. */
static enum lw_status open_one(const struct settings *s, const char *name, struct run *r,
                               struct lw_error *err) {
    meter.lamps = LW_SCENE_NONE;
    for (size_t k = 0; k < sizeof kinds / sizeof *kinds; k++) {
        const size_t length = strlen(kinds[k].name);
        if (strncmp(kinds[k].name, name, length) != 0 || name[length] != ':') continue;
        const long lamps = strtol(name + length + 1, NULL, 10);
        if (lamps < 1 || lamps > LAMPS_MAX)
            return lw_status_fail(err, LW_USAGE, "%s: 1 to %d lamps", name, LAMPS_MAX);
        if (kinds[k].value == AREA) meter.lamps = LAMPS_OBJECT;
        enum lw_status status = build_hall(s, (int)kinds[k].value, (uint32_t)lamps, &r->scene, err);
        if (status == LW_OK) status = lw_atlas_map_init(&r->map, r->scene);
        return status == LW_OK ? lw_pose_init(&r->pose, r->scene) : status;
    }
    return bench_open(&s->open, name, BENCH_MOTION_OWN, 0, &r->scene, &r->pose, &r->map, err);
}

static enum lw_status run(void *context, const char *name, struct lw_error *err) {
    struct run r = {.settings = context};
    enum lw_status status = open_one(context, name, &r, err);
    if (status == LW_OK) status = measure(&r, name, err);
    free(r.value);
    for (uint32_t j = 0; j < REFERENCES; j++) free(r.reference[j]);
    bench_close(r.scene, &r.pose, &r.map);
    return status;
}

int main(int argc, char **argv) {
    struct settings s = {.frames = 64, .reference = 256};
    const struct lw_option table[] = {
        {"frames", "N", "of light at most (default 64)", LW_OPTION_INT, &s.frames, 1, 100000, NULL},
        {"reference", "N", "frames of either reference (default 256)", LW_OPTION_INT, &s.reference, 1, 100000,
         NULL}};
    return bench_main(
        &(struct bench_program){.name = "bench_lights",
                                .about = "Direct light of few or many lamps: error and cost, as CSV.",
                                .operand = "point:N|spot:N|area:N|SCENE",
                                .table = table,
                                .count = sizeof table / sizeof table[0],
                                .open = &s.open,
                                .context = &s,
                                .heading = "scene,texels,frames,us_per_texel,rays_per_texel,relmse,bias",
                                .run = run},
        argc, argv);
}
