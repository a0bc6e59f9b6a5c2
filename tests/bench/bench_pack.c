/* bench_pack: how far apart in space the texels are that lie together in the lightmaps.
 *
 *     bench_pack [--side N] [--texels-per-metre D] SCENE...
 *
 * Squares of texels are solved, sent and forgotten together. One row in Markdown per scene: how many squares
 * of N x N texels show any surface; how much of these, and of all atlases, is surface; the root mean square
 * distance of their texels from their middle, in metres: the median texel's square and that of the ninth in
 * ten; the length of a square's mean normal, in the mean over texels; and how many of the triangles are read
 * up to level 0, 1 and 2, as coarser ones mix other light in. */
#include "common/lightmap/lightmap.h"
#include "server/solve/surface/texels.h"
#include "tests/bench/bench_setup.h"

#include <math.h>
#include <stdio.h>
#include <stdlib.h>

struct settings {
    struct lw_scene_open open;
    int64_t side;
};

struct square {
    float radius_m;
    uint32_t texels;
};

struct figures {
    struct square *square;
    size_t count, texels, atlas_texels, triangles, upto[LW_LIGHTMAP_LEVEL_MAX + 1];
    double normal; /* sum over texels */
};

static int by_radius(const void *left, const void *right) {
    const struct square *a = left, *b = right;
    return a->radius_m < b->radius_m ? -1 : a->radius_m > b->radius_m;
}

static void add_square(struct figures *f, const struct lw_mesh_texels *mesh, uint32_t left, uint32_t low,
                       uint32_t side, float scale) {
    struct lw_vec3 middle = {0}, normal = {0};
    double square = 0;
    uint32_t n = 0;
    for (int pass = 0; pass < 2; pass++) {
        if (pass && !n) return;
        if (pass) middle = lw_vec3_scale(middle, 1 / (float)n);
        for (uint32_t y = low; y < low + side && y < mesh->height; y++)
            for (uint32_t x = left; x < left + side && x < mesh->width; x++) {
                const uint32_t i = lw_texels_index(mesh, x, y);
                if (!mesh->covered[i]) continue;
                const struct lw_vec3 p = lw_texels_vector(mesh->position, i);
                if (!pass) {
                    middle = lw_vec3_add(middle, p);
                    normal = lw_vec3_add(normal, lw_texels_vector(mesh->geometric, i));
                    n++;
                } else {
                    const struct lw_vec3 d = lw_vec3_sub(p, middle);
                    square += (double)lw_vec3_dot(d, d);
                }
            }
    }
    f->square[f->count++] = (struct square){scale * (float)sqrt(square / n), n};
    f->texels += n;
    f->normal += (double)lw_vec3_length(normal);
}

/* The object's scale, as that of its longest axis. */
static float scale_of(const struct lw_affine *m) {
    return fmaxf(lw_vec3_length(lw_affine_vector(m, lw_vec3(1, 0, 0))),
                 fmaxf(lw_vec3_length(lw_affine_vector(m, lw_vec3(0, 1, 0))),
                       lw_vec3_length(lw_affine_vector(m, lw_vec3(0, 0, 1)))));
}

static void print(struct figures *f, const char *label, uint32_t side) {
    double half = 0, most = 0, seen = 0;
    qsort(f->square, f->count, sizeof *f->square, by_radius);
    for (size_t i = 0; i < f->count; i++) {
        seen += f->square[i].texels;
        if (seen <= 0.5 * (double)f->texels) half = (double)f->square[i].radius_m;
        if (seen <= 0.9 * (double)f->texels) most = (double)f->square[i].radius_m;
    }
    printf("| %s | %u | %zu | %.0f %% of them, %.0f %% of all | %.2f / %.2f | %.2f | %.0f, %.0f, %.0f %% |\n",
           label, side, f->count, 100 * (double)f->texels / ((double)f->count * side * side),
           100 * (double)f->texels / (double)f->atlas_texels, half, most, f->normal / (double)f->texels,
           100 * (double)f->upto[0] / (double)f->triangles, 100 * (double)f->upto[1] / (double)f->triangles,
           100 * (double)f->upto[2] / (double)f->triangles);
    fflush(stdout);
}

static enum lw_status count_levels(struct figures *f, const struct lw_scene *scene) {
    for (uint32_t o = 0; o < scene->object_count; o++) {
        const struct lw_mesh *mesh = &scene->mesh[scene->object[o].mesh];
        uint8_t *level = calloc((size_t)mesh->triangle_count + 1, 1);
        enum lw_status status = level ? lw_lightmap_coarsest(mesh, level) : LW_NO_MEMORY;
        for (uint32_t t = 0; status == LW_OK && t < mesh->triangle_count; t++) f->upto[level[t]]++;
        f->triangles += mesh->triangle_count;
        free(level);
        if (status != LW_OK) return status;
    }
    return LW_OK;
}

static enum lw_status run(void *context, const char *path, struct lw_error *err) {
    const struct settings *set = context;
    const uint32_t side = (uint32_t)set->side;
    struct lw_scene *scene = NULL;
    struct lw_pose pose = {0};
    struct lw_texels texels = {0};
    struct figures f = {0};
    char label[64];
    enum lw_status status = bench_open(&set->open, path, BENCH_MOTION_OWN, 0, &scene, &pose, NULL, err);
    if (status == LW_OK) status = lw_texels_init(&texels, scene, 0, NULL, NULL, err);
    for (uint32_t o = 0; status == LW_OK && o < scene->object_count; o++)
        f.atlas_texels += texels.mesh[scene->object[o].mesh].texel_count;
    if (status == LW_OK && !(f.square = malloc((f.atlas_texels + 1) * sizeof *f.square)))
        status = lw_status_fail(err, LW_NO_MEMORY, "squares");
    for (uint32_t o = 0; status == LW_OK && o < scene->object_count; o++) {
        const struct lw_mesh_texels *mesh = &texels.mesh[scene->object[o].mesh];
        for (uint32_t y = 0; y < mesh->height; y += side)
            for (uint32_t x = 0; x < mesh->width; x += side)
                add_square(&f, mesh, x, y, side, scale_of(&pose.object_to_world[o]));
    }
    if (status == LW_OK && count_levels(&f, scene) != LW_OK)
        status = lw_status_fail(err, LW_NO_MEMORY, "triangles");
    if (status == LW_OK) print(&f, bench_label(path, label, sizeof label), side);
    free(f.square);
    lw_texels_finish(&texels);
    bench_close(scene, &pose, NULL);
    return status;
}

int main(int argc, char **argv) {
    struct settings s = {.side = 16};
    const struct lw_option table[] = {
        {"side", "N", "of the squares, in texels (default 16)", LW_OPTION_INT, &s.side, 1, 4096, NULL}};
    return bench_main(
        &(struct bench_program){.name = "bench_pack",
                                .about = "How far apart the texels are that lie together.",
                                .table = table,
                                .count = sizeof table / sizeof table[0],
                                .open = &s.open,
                                .heading = "| scene | side | squares | surface | distance, m: half / 90 % | "
                                           "normal | coarsest level 0, 1, 2 |\n"
                                           "|---|---|---|---|---|---|---|",
                                .context = &s,
                                .run = run},
        argc, argv);
}
