/* lobes.h: how a point of a surface scatters light: a diffuse lobe under a gloss, or a metal.
 * Flow:    finish of a material (scene.h) -> lw_lobes -> [lobes] -> path tracer, composer, solver
 * Threads: pure functions, [any].
 *
 *   f = diffuse/pi (1 - G(o)) (1 - G(i)) / (1 - G)            what the gloss leaves
 *     + D V F                                                 facets, once: microfacets.h
 *     + (1 - E(o)) (1 - E(i)) / (pi (1 - E)) Fm               facets, many times
 *
 * E(x) is the share of light along x that white facets send back once, E its mean (lobe_table.h). G is the
 * gloss's share, many times included. Fm = F^2 E / (1 - F (1 - E)), F the mean of Fresnel's reflectance. So f
 * is reciprocal, and a white surface of any roughness sends back all light.
 *
 * After: Kulla and Conty 2017 (facets, many times; the diffuse lobe); Turquin 2019 (lw_lobes_shade()).
 *
 * Directions are in the surface's frame, as in microfacets.h. */
#ifndef LW_COMMON_LOBES_H
#define LW_COMMON_LOBES_H

#include "common/base/vec.h"

struct lw_lobes {
    struct lw_vec3 diffuse; /* albedo of the lobe without its gloss, in [0, 1]: base x (1 - metalness) */
    struct lw_vec3 f0;      /* mirrored at normal incidence, in [0, 1] */
    float f90;              /* at grazing incidence, in [0, 1]. 0, with f0: nothing is mirrored */
    float gloss0, gloss90;  /* the same of the gloss over the diffuse lobe */
    float roughness;        /* [0, 1] */
};

/** A matt surface. */
static inline struct lw_lobes lw_lobes_matt(struct lw_vec3 albedo) {
    const struct lw_lobes matt = {.diffuse = albedo, .roughness = 1};
    return matt;
}

static inline bool lw_lobes_mirror(const struct lw_lobes *lobes) { return lobes->f90 > 0; }

/** The surface as an eye sees it, without all that depends on the light. */
struct lw_lobes_seen {
    struct lw_lobes lobes;
    struct lw_vec3 to_eye; /* unit */
    float alpha;
    struct lw_vec3 diffuse; /* in f: all factors but the light direction's */
    struct lw_vec3 many;    /* in f: all factors but the light direction's */
    float of_gloss;         /* Fm of the gloss */
    /* Albedo towards the eye by lobes: mirrored once, and the rest, which goes everywhere */
    struct lw_vec3 mirrored, spread;
    float mirror_share; /* share of bounce rays that are sampled as a mirror's */
};
/** to_eye: unit; below the surface it counts as grazing. */
struct lw_lobes_seen lw_lobes_see(const struct lw_lobes *lobes, struct lw_vec3 to_eye);

/** f times the light's cosine, 1/sr. to_light: unit; below the surface: 0. Always finite, never negative. */
struct lw_vec3 lw_lobes_reflect(const struct lw_lobes_seen *seen, struct lw_vec3 to_light);

/** A direction to look for light, unit, sampled about by f times its cosine. u: two even random numbers in
 * [0, 1), pick: a third. False: it is below the surface. */
bool lw_lobes_sample(const struct lw_lobes_seen *seen, const float u[2], float pick, struct lw_vec3 *out);
/** Density of such directions per solid angle. */
float lw_lobes_pdf(const struct lw_lobes_seen *seen, struct lw_vec3 to_light);

/** The same where directions that are not a mirror's are sampled with the density `spread` there, in place
 * of cosine / pi: pick >= seen->mirror_share. */
float lw_lobes_pdf_with(const struct lw_lobes_seen *seen, struct lw_vec3 to_light, float spread);

/** The share of light from everywhere that is reflected towards the eye. */
static inline struct lw_vec3 lw_lobes_seen_albedo(const struct lw_lobes_seen *seen) {
    return lw_vec3_add(seen->mirrored, seen->spread);
}

/** Reflectance of all lobes for even light, in [0, 1]. Bounces of the solve spread it evenly. */
struct lw_vec3 lw_lobes_albedo(const struct lw_lobes *lobes);

#endif
