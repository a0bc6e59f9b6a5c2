/* scene_densities.h: one scene as packages, with its lightmap at several densities.
 * Flow:    SCENE, motion -> [scene_densities] -> scene, packages for lightwelld
 * Threads: one thread at a time. */
#ifndef LW_CLIENT_MEASURE_SIDES_SCENE_DENSITIES_H
#define LW_CLIENT_MEASURE_SIDES_SCENE_DENSITIES_H

#include "common/open/scene_open.h"
#include "common/scene/scene_motion.h"

#include <limits.h>

#define LW_SCENE_DENSITIES_MAX 8u

struct lw_scene_densities {
    struct lw_scene_open open;
    enum lw_scene_motion motion;
    struct lw_scene *scene; /* at density 1: the default's, or that of --texels-per-metre */
    struct lw_scene_motion_report report;
    double texels_per_metre; /* at density 1, over the scene's area */
    double texels;           /* at density 1, covered by surface */
    uint64_t triangles;      /* of all objects */
    char folder[PATH_MAX];   /* temporary; "": there is none */
    struct lw_scene_package {
        double density;
        double build_cpu_s; /* import and lightmap coordinates included */
        char path[PATH_MAX + 32];
    } package[LW_SCENE_DENSITIES_MAX];
    uint32_t package_count;
};

/** Opens the scene, sets its motion, writes its first package. Finish it in any case.
 * Errors: lw_scene_open()'s, lw_scene_motion_set()'s, lw_package_save()'s. */
LW_MUST_CHECK enum lw_status lw_scene_densities_init(struct lw_scene_densities *densities,
                                                     const struct lw_scene_open *open,
                                                     enum lw_scene_motion motion, struct lw_error *err);
/** Removes the packages. A zeroed one is fine. */
void lw_scene_densities_finish(struct lw_scene_densities *densities);

/** Gives the package at a density, times the default; the first call makes it. *out_path: good until
 * finish.
 * Errors: as init. */
LW_MUST_CHECK enum lw_status lw_scene_densities_find(struct lw_scene_densities *densities, double density,
                                                     const char **out_path, struct lw_error *err);

/** Whether the lightmap at a density is one that a server can hold; warns where it is not. */
bool lw_scene_densities_fits(const struct lw_scene_densities *densities, double density);

/** CPU seconds that the package of a density took; NAN: it was not made. */
double lw_scene_densities_build_cpu_s(const struct lw_scene_densities *densities, double density);

#endif
