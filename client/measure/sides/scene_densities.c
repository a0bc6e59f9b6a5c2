#include "client/measure/sides/scene_densities.h"

#include "common/base/clock.h"
#include "common/base/folders.h"
#include "common/base/log.h"
#include "common/scene/package.h"
#include "common/scene/pose.h"

#include <math.h>
#include <stdio.h>
#include <sys/resource.h>

#define TEXELS_MAX 8e6 /* the server takes some 600 bytes for each */

/* CPU seconds of this process and of those that it has waited for: the importer's. */
static double all_cpu_s(void) {
    struct rusage usage;
    double sum = 1e-9 * (double)lw_clock_process_cpu_ns();
    if (getrusage(RUSAGE_CHILDREN, &usage) == 0)
        sum += (double)usage.ru_utime.tv_sec + (double)usage.ru_stime.tv_sec +
               1e-6 * (double)(usage.ru_utime.tv_usec + usage.ru_stime.tv_usec);
    return sum;
}

/* The lightmap's texels over the surface that they stand for. */
static enum lw_status measure(struct lw_scene_densities *d, struct lw_error *err) {
    const struct lw_scene *scene = d->scene;
    struct lw_pose pose;
    double area_m2 = 0;
    if (lw_pose_init(&pose, scene) != LW_OK)
        return lw_status_fail(err, LW_NO_MEMORY, "no memory for the scene's pose");
    for (uint32_t o = 0; o < scene->object_count; o++) {
        const struct lw_mesh *mesh = &scene->mesh[scene->object[o].mesh];
        const struct lw_affine *to_world = &pose.object_to_world[o];
        d->triangles += mesh->triangle_count;
        for (uint32_t t = 0; mesh->lightmap_uv && t < mesh->triangle_count; t++) {
            const uint32_t *v = mesh->triangle[t];
            struct lw_vec3 a = lw_affine_point(to_world, mesh->position[v[0]]);
            struct lw_vec3 b = lw_vec3_sub(lw_affine_point(to_world, mesh->position[v[1]]), a);
            struct lw_vec3 c = lw_vec3_sub(lw_affine_point(to_world, mesh->position[v[2]]), a);
            const struct lw_vec2 *uv = mesh->lightmap_uv;
            area_m2 += 0.5 * (double)lw_vec3_length(lw_vec3_cross(b, c));
            d->texels += 0.5 * fabs((double)(uv[v[1]].x - uv[v[0]].x) * (double)(uv[v[2]].y - uv[v[0]].y) -
                                    (double)(uv[v[1]].y - uv[v[0]].y) * (double)(uv[v[2]].x - uv[v[0]].x));
        }
    }
    lw_pose_finish(&pose);
    d->texels_per_metre = area_m2 > 0 ? sqrt(d->texels / area_m2) : 0;
    return LW_OK;
}

static enum lw_status open_scene(const struct lw_scene_densities *d, double density,
                                 struct lw_scene **out_scene, struct lw_scene_motion_report *out_report,
                                 struct lw_error *err) {
    struct lw_scene_open open = d->open;
    if (density != 1) {
        open.texels_per_metre = density * d->texels_per_metre;
        open.texels_max = 0; /* the limit is for density 1 */
    }
    struct lw_scene *scene;
    enum lw_status status = lw_scene_open(&open, &scene, err);
    if (status != LW_OK) return status;
    status = lw_scene_motion_set(scene, d->motion, out_report, err);
    if (status == LW_OK)
        *out_scene = scene;
    else
        lw_scene_destroy(scene);
    return status;
}

/* began_s: all_cpu_s() before the scene was opened. */
static enum lw_status save(struct lw_scene_densities *d, const struct lw_scene *scene, double density,
                           double began_s, struct lw_error *err) {
    if (d->package_count == LW_SCENE_DENSITIES_MAX)
        return lw_status_fail(err, LW_INTERNAL, "too many densities");
    struct lw_scene_package *p = &d->package[d->package_count];
    p->density = density;
    snprintf(p->path, sizeof p->path, "%s/%g.lwscene", d->folder, density);
    enum lw_status status = lw_package_save(scene, p->path, err);
    p->build_cpu_s = all_cpu_s() - began_s;
    if (status == LW_OK) d->package_count++;
    return status;
}

enum lw_status lw_scene_densities_init(struct lw_scene_densities *d, const struct lw_scene_open *open,
                                       enum lw_scene_motion motion, struct lw_error *err) {
    const double began_s = all_cpu_s();
    *d = (struct lw_scene_densities){.open = *open, .motion = motion};
    enum lw_status status = lw_folders_make_temporary(d->folder, sizeof d->folder, err);
    if (status == LW_OK) status = open_scene(d, 1, &d->scene, &d->report, err);
    if (status == LW_OK) status = measure(d, err);
    return status == LW_OK ? save(d, d->scene, 1, began_s, err) : status;
}

void lw_scene_densities_finish(struct lw_scene_densities *d) {
    lw_folders_remove_temporary(d->folder);
    lw_scene_destroy(d->scene);
    *d = (struct lw_scene_densities){0};
}

enum lw_status lw_scene_densities_find(struct lw_scene_densities *d, double density, const char **out_path,
                                       struct lw_error *err) {
    for (uint32_t i = 0; i < d->package_count; i++)
        if (d->package[i].density == density) {
            *out_path = d->package[i].path;
            return LW_OK;
        }
    const double began_s = all_cpu_s();
    struct lw_scene *scene;
    struct lw_scene_motion_report report;
    enum lw_status status = open_scene(d, density, &scene, &report, err);
    if (status != LW_OK) return status;
    status = save(d, scene, density, began_s, err);
    lw_scene_destroy(scene);
    if (status == LW_OK) *out_path = d->package[d->package_count - 1].path;
    return status;
}

bool lw_scene_densities_fits(const struct lw_scene_densities *d, double density) {
    const double texels = d->texels * density * density;
    if (density <= 1 || texels <= TEXELS_MAX) return true;
    lw_log(LW_LOG_WARNING, "density x%g is not tried: %.3g million texels", density, 1e-6 * texels);
    return false;
}

double lw_scene_densities_build_cpu_s(const struct lw_scene_densities *d, double density) {
    for (uint32_t i = 0; i < d->package_count; i++)
        if (d->package[i].density == density) return d->package[i].build_cpu_s;
    return (double)NAN;
}
