/* bench_tangents: the tangents of a scene's normal maps, and what they cost to compute.
 *
 *     bench_tangents -o FOLDER SCENE...
 *
 * Prints corners and CPU s, of five rounds the median. FOLDER/SCENE.corners has, for each mesh and material
 * with a normal map: u32 corners; then 12 floats of each corner, three a triangle: position, normal, texture
 * coordinates of the normal map (v up), tangent and w. client/web/test/tangents.mjs holds them against
 * three.js' MikkTSpace. Tangents of the file do not count. */
#include "common/base/status.h"
#include "common/shading/tangent.h"
#include "server/import/mesh/mesh_tangents.h"
#include "tests/bench/bench_setup.h"

#include <stdio.h>
#include <stdlib.h>
#include <time.h>

#define ROUNDS 5

struct settings {
    struct lw_scene_open open;
    const char *folder;
};

static double cpu_s(void) {
    struct timespec now;
    clock_gettime(CLOCK_PROCESS_CPUTIME_ID, &now);
    return (double)now.tv_sec + 1e-9 * (double)now.tv_nsec;
}

static const struct lw_texture_use *normal_map(const struct lw_scene *scene, const struct lw_mesh *mesh,
                                               uint32_t material) {
    const struct lw_finish *finish = scene->material[material].finish;
    const struct lw_texture_use *use = finish ? &finish->normal_texture : NULL;
    return use && use->texture != LW_SCENE_NONE && mesh->uv[use->uv_set] ? use : NULL;
}

static void write_corner(const struct lw_mesh *mesh, const struct lw_texture_use *use, uint32_t corner,
                         FILE *out) {
    const uint32_t vertex = mesh->triangle[corner / 3][corner % 3];
    const struct lw_vec3 p = mesh->position[vertex], n = mesh->normal[vertex];
    const struct lw_vec2 uv = mesh->uv[use->uv_set][vertex];
    const struct lw_vec4 t = lw_tangent_decode(mesh->tangent[corner], n);
    const float *m = use->transform;
    const float row[12] = {p.x,
                           p.y,
                           p.z,
                           n.x,
                           n.y,
                           n.z,
                           m[0] * uv.x + m[1] * uv.y + m[2],
                           1 - (m[3] * uv.x + m[4] * uv.y + m[5]),
                           t.x,
                           t.y,
                           t.z,
                           t.w};
    fwrite(row, sizeof row, 1, out);
}

/* Returns the corners that it has written. */
static uint64_t write_mesh(const struct lw_scene *scene, const struct lw_mesh *mesh, FILE *out) {
    uint64_t all = 0;
    for (uint32_t m = 0; mesh->tangent && m < scene->material_count; m++) {
        const struct lw_texture_use *use = normal_map(scene, mesh, m);
        uint32_t count = 0;
        for (uint32_t t = 0; use && t < mesh->triangle_count; t++) count += 3 * (mesh->material[t] == m);
        if (!count) continue;
        fwrite(&count, sizeof count, 1, out);
        for (uint32_t c = 0; c < 3 * mesh->triangle_count; c++)
            if (mesh->material[c / 3] == m) write_corner(mesh, use, c, out);
        all += count;
    }
    return all;
}

static enum lw_status measure(struct lw_scene *scene, double *out_s, struct lw_error *err) {
    double seconds[ROUNDS];
    uint64_t bad = 0;
    for (int round = 0; round < ROUNDS; round++) {
        const double begin = cpu_s();
        for (uint32_t m = 0; m < scene->mesh_count; m++)
            if (lw_mesh_tangents_build(scene, &scene->mesh[m], NULL, &bad, err)) return err->status;
        seconds[round] = cpu_s() - begin;
    }
    *out_s = bench_median(seconds, ROUNDS);
    return LW_OK;
}

static enum lw_status run(void *context, const char *name, struct lw_error *err) {
    const struct settings *s = context;
    struct lw_scene *scene = NULL;
    struct lw_pose pose = {0};
    char label[64], *path = NULL;
    double seconds = 0;
    uint64_t corners = 0;
    FILE *out = NULL;
    enum lw_status status = bench_open(&s->open, name, BENCH_MOTION_OWN, 0, &scene, &pose, NULL, err);
    if (status == LW_OK) status = measure(scene, &seconds, err);
    (void)bench_label(name, label, sizeof label);
    if (status == LW_OK && asprintf(&path, "%s/%s.corners", s->folder, label) < 0)
        status = lw_status_fail(err, LW_NO_MEMORY, "out of memory");
    if (status == LW_OK && !(out = fopen(path, "wb")))
        status = lw_status_fail(err, LW_CANNOT_CREATE, "%s: cannot be created", path);
    for (uint32_t m = 0; status == LW_OK && m < scene->mesh_count; m++)
        corners += write_mesh(scene, &scene->mesh[m], out);
    if (out && fclose(out) != 0 && status == LW_OK)
        status = lw_status_fail(err, LW_IO, "%s: cannot be written", path);
    if (status == LW_OK) printf("%s: %llu corners, %.2f CPU s\n", path, (unsigned long long)corners, seconds);
    free(path);
    bench_close(scene, &pose, NULL);
    return status;
}

int main(int argc, char **argv) {
    struct settings s = {.folder = "."};
    const struct lw_option table[] = {
        {"o", "DIR", "write the corners there (default: here)", LW_OPTION_STRING, &s.folder, 0, 0, NULL}};
    return BENCH_MAIN(argc, argv, table, .name = "bench_tangents",
                      .about = "The tangents of a scene's normal maps.", .open = &s.open, .folder = &s.folder,
                      .context = &s);
}
