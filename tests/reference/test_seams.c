/* Seams: walks every seam of a scene and reads both sides as the viewer does. */
#include "tests/reference/room.h"

#include "common/scene/builtin.h"
#include "common/scene/scene_open.h"
#include "server/publish/levels.h"
#include "server/solve/seam_edges.h"

#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#define STEPS 8 /* points per texel along a seam */

struct walk {
    const struct room_solution *solution;
    struct lw_levels *levels; /* per object */
    bool unwelded;            /* reads what the solver had before it welded */
    double floor;             /* under the divisor: a share of the scene's mean */
};

static void load_levels(struct walk *walk) {
    const struct room_solution *s = walk->solution;
    walk->levels = calloc(s->map.object_count + 1, sizeof *walk->levels);
    assert_non_null(walk->levels);
    double sum = 0, count = 0;
    for (uint32_t o = 0; o < s->map.object_count; o++) {
        const struct lw_atlas *atlas = &s->map.atlas[o];
        lw_support_ok(lw_levels_init(&walk->levels[o], atlas), NULL);
        if (!atlas->level_count) continue;
        for (uint32_t t = 0; t < atlas->level[0].tiles_x * atlas->level[0].tiles_y; t++) {
            const lw_tile_id id = {s->map.first_tile[o] + t};
            struct lw_solver_tile tile;
            s->solver->ops->read_tile(s->solver, id, &tile);
            float *plain = calloc((size_t)tile.width * tile.height, sizeof *plain);
            assert_non_null(plain);
            for (uint32_t i = 0; i < tile.width * tile.height; i++) {
                plain[i] = tile.direct[0][i] + tile.indirect[0][i];
                if (tile.covered[i]) sum += (double)plain[i], count++;
            }
            if (walk->unwelded) {
                tile.filled = NULL;
                for (int c = 0; c < 3; c++) tile.light[c] = plain;
            }
            lw_levels_load_tile(&walk->levels[o], &s->map.place[id.v], &tile);
            free(plain);
        }
        lw_levels_build(&walk->levels[o]);
    }
    walk->floor = 0.02 * sum / fmax(1, count);
}

static void unload_levels(struct walk *walk) {
    for (uint32_t o = 0; o < walk->solution->map.object_count; o++) lw_levels_finish(&walk->levels[o]);
    free(walk->levels);
}

/* A bilinear look-up of a level, as in client/view/compose.c. */
static double read_level(const struct lw_levels_image *image, unsigned k, double u, double v, bool *dead) {
    const double scale = 1.0 / (1u << k);
    const double x = fmin(fmax(u * scale - 0.5, 0), image->width - 1),
                 y = fmin(fmax(v * scale - 0.5, 0), image->height - 1);
    const uint32_t x0 = (uint32_t)x, y0 = (uint32_t)y;
    double sum = 0;
    for (uint32_t j = 0; j < 2; j++)
        for (uint32_t i = 0; i < 2; i++) {
            const uint32_t tx = x0 + i < image->width ? x0 + i : x0,
                           ty = y0 + j < image->height ? y0 + j : y0;
            const double weight = (i ? x - x0 : 1 - (x - x0)) * (j ? y - y0 : 1 - (y - y0));
            const size_t at = (size_t)ty * image->width + tx;
            if (weight > 0 && !image->covered[at]) *dead = true;
            sum += weight * (double)image->rgb[at * 3];
        }
    return sum;
}

static int compare(const void *a, const void *b) {
    const double x = *(const double *)a, y = *(const double *)b;
    return x < y ? -1 : x > y;
}

struct spread {
    size_t points;
    double mean, p50, p99, p999, worst,
        over; /* relative differences of the two sides; share of points over 1 % */
};

/* Walks all seams at one level. Where a side has nothing but holes to read (inside something), there is no seam. */
static struct spread walk_seams(const struct walk *walk, const struct lw_seam_edges *edges, unsigned level) {
    size_t capacity = 1024, count = 0;
    double *difference = malloc(capacity * sizeof *difference);
    for (size_t e = 0; e < edges->count; e++) {
        const struct lw_seam_edge *edge = &edges->edge[e];
        double length = 0;
        for (int s = 0; s < 2; s++)
            length = fmax(length, hypot((double)(edge->to[s].x - edge->from[s].x),
                                        (double)(edge->to[s].y - edge->from[s].y)));
        const unsigned points = (unsigned)ceil(length * STEPS / (1u << level)) + 1;
        for (unsigned i = 0; i < points; i++) {
            const double t = (i + 0.5) / points;
            double e2[2];
            bool dead = false;
            for (int s = 0; s < 2; s++) {
                const struct lw_levels *levels = &walk->levels[edge->object[s]];
                if (level >= levels->count) {
                    dead = true;
                    break;
                }
                e2[s] = read_level(&levels->level[level], level,
                                   (double)edge->from[s].x + t * (double)(edge->to[s].x - edge->from[s].x),
                                   (double)edge->from[s].y + t * (double)(edge->to[s].y - edge->from[s].y),
                                   &dead);
            }
            if (dead) continue;
            assert_true(isfinite(e2[0]) && isfinite(e2[1]) && e2[0] >= 0 && e2[1] >= 0);
            if (count == capacity) difference = realloc(difference, (capacity *= 2) * sizeof *difference);
            assert_non_null(difference);
            difference[count++] = fabs(e2[0] - e2[1]) / fmax(0.5 * (e2[0] + e2[1]), walk->floor);
        }
    }
    struct spread spread = {.points = count};
    if (count) {
        qsort(difference, count, sizeof *difference, compare);
        for (size_t i = 0; i < count; i++) {
            spread.mean += difference[i] / (double)count;
            spread.over += (difference[i] > 0.01) / (double)count;
        }
        spread.p50 = difference[count / 2];
        spread.p99 = difference[(size_t)(0.99 * (double)(count - 1))];
        spread.p999 = difference[(size_t)(0.999 * (double)(count - 1))];
        spread.worst = difference[count - 1];
    }
    free(difference);
    return spread;
}

static void print_spread(const char *name, const char *when, unsigned level, const struct spread *s) {
    printf("%-12s level %u %-8s %8zu points: mean %.4f median %.4f 99%% %.4f 99.9%% %.4f worst %.4f, over 1 "
           "%%: %.4f\n",
           name, level, when, s->points, s->mean, s->p50, s->p99, s->p999, s->worst, s->over);
}

/* Relative change of the mean light by welding: of the scene, and the worst of an object of 1,000 texels and more. */
static void mean_change(const struct room_solution *s, double *out_scene, double *out_object) {
    double total[2] = {0};
    *out_object = 0;
    for (uint32_t o = 0; o < s->map.object_count; o++) {
        const struct lw_atlas *atlas = &s->map.atlas[o];
        double sum[2] = {0}, count = 0;
        for (uint32_t t = 0; atlas->level_count && t < atlas->level[0].tiles_x * atlas->level[0].tiles_y;
             t++) {
            struct lw_solver_tile tile;
            s->solver->ops->read_tile(s->solver, (lw_tile_id){s->map.first_tile[o] + t}, &tile);
            for (uint32_t i = 0; i < tile.width * tile.height; i++) {
                if (!tile.covered[i]) continue;
                sum[0] += (double)(tile.direct[1][i] + tile.indirect[1][i]);
                sum[1] += (double)tile.light[1][i];
                count++;
            }
        }
        for (int i = 0; i < 2; i++) total[i] += sum[i];
        if (count >= 1000 && sum[0] > 0) *out_object = fmax(*out_object, fabs(sum[1] / sum[0] - 1));
    }
    *out_scene = total[1] / total[0] - 1;
}

static void expect_welded(const char *name, struct lw_scene *scene, float density, uint32_t samples,
                          unsigned frames, double mean_most, double worst_most, size_t points_min) {
    struct room_solution solution;
    room_solve_scene(
        &solution, scene, density,
        (struct lw_solver_desc){.bounces = 2, .direct_samples = samples, .indirect_samples = 2 * samples},
        frames);
    struct lw_seam_edges edges;
    lw_support_ok(lw_seam_edges_find(scene, &solution.pose, &edges), NULL);
    struct walk before = {.solution = &solution, .unwelded = true}, after = {.solution = &solution};
    load_levels(&before);
    load_levels(&after);
    double change, worst;
    mean_change(&solution, &change, &worst);
    printf("%-12s mean light changes by %.5f, that of an object by up to %.5f\n", name, change, worst);
    for (unsigned level = 0; level < 3; level++) {
        struct spread b = walk_seams(&before, &edges, level), a = walk_seams(&after, &edges, level);
        print_spread(name, "unwelded", level, &b);
        print_spread(name, "welded", level, &a);
        if (level > 0) continue;
        assert_true(a.points >= points_min);
        /* Frames go on from each other's corrections: these few leave a rest, which more frames take away. */
        assert_true(a.worst <= worst_most);
        assert_true(a.mean < mean_most && a.mean < 0.4 * b.mean && a.p50 < 0.015);
    }
    assert_true(fabs(change) < 0.001 && worst < 0.005);
    unload_levels(&before);
    unload_levels(&after);
    lw_seam_edges_finish(&edges);
    room_finish(&solution);
}

#define AROUND 32u
#define DOWN   16u

/* A smooth ball in place of quad `q`. */
static void make_ball(struct lw_scene *scene, uint32_t q, struct lw_vec3 centre, float radius) {
    const uint32_t vertices = (AROUND + 1) * (DOWN + 1), triangles = 2 * AROUND * (DOWN - 1);
    struct lw_vec3 *position = lw_scene_alloc(scene, vertices, sizeof *position),
                   *normal = lw_scene_alloc(scene, vertices, sizeof *normal);
    uint32_t(*triangle)[3] = lw_scene_alloc(scene, triangles, sizeof *triangle);
    uint32_t *material = lw_scene_alloc(scene, triangles, sizeof *material), n = 0;
    assert_true(position && normal && triangle && material);
    for (uint32_t v = 0; v < vertices; v++) {
        float polar = LW_PI * (float)(v / (AROUND + 1)) / (float)DOWN;
        float angle = 2 * LW_PI * (float)(v % (AROUND + 1)) / (float)AROUND;
        normal[v] = lw_vec3(sinf(polar) * cosf(angle), cosf(polar), sinf(polar) * sinf(angle));
        position[v] = lw_vec3_mad(centre, normal[v], radius);
    }
    for (uint32_t j = 0; j < DOWN; j++)
        for (uint32_t i = 0; i < AROUND; i++) {
            const uint32_t a = j * (AROUND + 1) + i, b = a + 1, c = a + AROUND + 1, d = c + 1;
            if (j > 0) memcpy(triangle[n++], (const uint32_t[3]){a, b, c}, sizeof *triangle);
            if (j + 1 < DOWN) memcpy(triangle[n++], (const uint32_t[3]){b, d, c}, sizeof *triangle);
        }
    for (uint32_t t = 0; t < triangles; t++) material[t] = scene->mesh[q].material[0];
    scene->mesh[q] = (struct lw_mesh){.name = "ball",
                                      .vertex_count = vertices,
                                      .triangle_count = triangles,
                                      .position = position,
                                      .normal = normal,
                                      .triangle = triangle,
                                      .material = material};
}

/* Where light varies over texels but has no edge between two of them, every point of every seam agrees within 1 %. */
static void test_ball(void **state) {
    (void)state;
    struct room room = {.sky = 0.3f};
    room_quad(&room, lw_vec3(0, 0, 0), lw_vec3(1, 0, 0), lw_vec3(0, 1, 0), 0.7f, 0); /* becomes the ball */
    room_quad(&room, lw_vec3(-2, 0, -2), lw_vec3(0, 0, 4), lw_vec3(4, 0, 0), 0.7f, 0);
    room_quad(&room, lw_vec3(-0.5f, 2.5f, -0.5f), lw_vec3(1, 0, 0), lw_vec3(0, 0, 1), 0, 5); /* facing down */
    struct lw_scene *scene = room_scene(&room);
    make_ball(scene, 0, lw_vec3(0, 0.7f, 0), 0.5f);
    expect_welded("ball", scene, 16, 8, 32, 0.002, 0.01, 1000);
}

static void test_atrium(void **state) {
    (void)state;
    struct lw_scene *scene;
    struct lw_error err = {0};
    lw_support_ok(lw_builtin_build("builtin:atrium", &scene, &err), &err);
    expect_welded("atrium", scene, 0, 1, 16, 0.03, 2, 10000);
}

/* Sponza is not part of the project: LW_TEST_SCENES names the folder of scenes that holds it. */
static void test_sponza(void **state) {
    (void)state;
    const char *folder = getenv("LW_TEST_SCENES");
    char path[4096];
    snprintf(path, sizeof path, "%s/sponza/Sponza_lit.gltf", folder ? folder : "../shared/scenes");
    FILE *file = fopen(path, "rb");
    if (!file) {
        printf("skipped: there is no %s (LW_TEST_SCENES)\n", path);
        skip();
    }
    fclose(file);
    struct lw_scene *scene;
    struct lw_error err = {0};
    struct lw_scene_open open = {.path = path, .sun_angle_deg = LW_SCENE_OPEN_SUN_DIAMETER_DEG};
    lw_support_ok(lw_scene_open(&open, &scene, &err), &err);
    expect_welded("Sponza", scene, 0, 1, 16, 0.15, 2, 10000);
}

int main(void) {
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(test_ball),
        cmocka_unit_test(test_atrium),
        cmocka_unit_test(test_sponza),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
