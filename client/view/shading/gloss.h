/* gloss.h: sixteen points of surfaces with a finish as an eye sees them, in the form that clients draw.
 * Flow:    finishes of a packet's hits (gloss_maps) -> [gloss] -> compose (light from everywhere),
 *          direct_tile (lamps)
 * Threads: pure functions, [any].
 *
 * With a and b of common/shading/lobe_table.h for the eye's cosine, E = a + b:
 *
 *   boost = 1 + f0 (1/E - 1)               light that facets send to and fro
 *   under = 1 - (gloss0 a + gloss90 b) (1 + gloss0 (1/E - 1))     what the gloss leaves
 *   of a lamp, E there:      E (diffuse under left / pi + D V F boost)
 *   of everything else:      occlusion (E/pi factor diffuse under + gain ambient (f0 a + f90 b) boost)
 *
 * left is `under` of the lamp's cosine over its mean: the gloss takes from light on its way in, too. The
 * mean is `under` of the cosine LW_GLOSS_EVEN0 + roughness LW_GLOSS_EVEN1, to 0.3 %. A varnished floor gets
 * 1.05 of the light of a high sun, and half of a low one's.
 *
 * ambient is the radiance along the mirrored direction: of the share of sky and environment that E shows as
 * visible. The rest of E counts as even. factor and gain are 1, or, where it is known where E comes from,
 * those of common/light/direction_form.h for the normal of the map and for the mirrored direction. Path
 * tracers have the exact form (lobes.h), whose lobes are reciprocal.
 *
 * After: Karis 2013 (the split sum); Turquin 2019 (boost); Tokuyoshi and Kaplanyan 2019 (a lamp's lobe is as
 * much wider as normals differ between neighbouring pixels, so that no pixel glints by chance. With n samples
 * a pixel it is an n-th of that: they find the rest. Rough lobes hide such differences, and are widened less:
 * wide ones show metal cloth in the sun too bright). */
#ifndef LW_CLIENT_VIEW_SHADING_GLOSS_H
#define LW_CLIENT_VIEW_SHADING_GLOSS_H

#include "client/view/shading/ambient.h"
#include "common/base/points16.h"
#include "common/shading/lobes.h"

#define LW_GLOSS_WIDTH 16u

#define LW_GLOSS_EVEN0 0.47f
#define LW_GLOSS_EVEN1 0.08f

/** A bilinear look-up of a texture: four texels of R, G, B, A in that order of bytes, and how far from the
 * first to the second, from the first two to the others. All bits set: white. */
struct lw_gloss_texels16 {
    uint32_t at[4][LW_GLOSS_WIDTH];
    float x[LW_GLOSS_WIDTH], y[LW_GLOSS_WIDTH];
};

/** Finishes (scene.h), structure of arrays. Vectors are in world space. Zeroed lanes are fine. */
struct lw_gloss16 {
    _Alignas(64) float base[3][LW_GLOSS_WIDTH];                    /* colour, in [0, 1] */
    float metalness[LW_GLOSS_WIDTH], roughness[LW_GLOSS_WIDTH];    /* times their map */
    float specular[LW_GLOSS_WIDTH], dielectric[3][LW_GLOSS_WIDTH]; /* ((ior - 1) / (ior + 1))^2 x colour */
    float occlusion[LW_GLOSS_WIDTH], normal_scale[LW_GLOSS_WIDTH]; /* strengths of their maps */
    struct lw_gloss_texels16 surface, shade, bump; /* metalness and roughness; occlusion; normals */
    float plain[3][LW_GLOSS_WIDTH]; /* shading normals without bumps, unit, on the side that is seen */
    /* tangent: where u of the normal map points, any length. turn: 1, or -1 where v points the other way.
     * side: -1 where the back is seen */
    float tangent[3][LW_GLOSS_WIDTH], turn[LW_GLOSS_WIDTH], side[LW_GLOSS_WIDTH];
    float to_eye[3][LW_GLOSS_WIDTH]; /* any length but 0 */
    uint16_t quads;                  /* lanes that are pixels of a quad of 4 x 4 pixels, all of one surface */
    float samples;                   /* a pixel has that many; 0: one */
};

/** Their shares of reflection towards the eye, for any light. Finite for finite input, even a hostile one. */
struct lw_gloss_seen16 {
    _Alignas(
        64) float normal[3][LW_GLOSS_WIDTH]; /* bumped: the eye and the mirrored direction lie above it */
    float eye[3][LW_GLOSS_WIDTH];            /* unit */
    float cosine[LW_GLOSS_WIDTH], alpha[LW_GLOSS_WIDTH];
    float spread[LW_GLOSS_WIDTH]; /* the normals' within a sample's share, alpha^2; widens lobes of lamps */
    float roughness[LW_GLOSS_WIDTH], metalness[LW_GLOSS_WIDTH], open[LW_GLOSS_WIDTH]; /* 1: not occluded */
    float diffuse[3][LW_GLOSS_WIDTH];                        /* with what the gloss leaves of it */
    float mirror[3][LW_GLOSS_WIDTH], rim[3][LW_GLOSS_WIDTH]; /* F boost = mirror + rim (1 - cos)^5 */
    float mirrored[3][LW_GLOSS_WIDTH];                       /* (f0 a + f90 b) boost */
    float gloss0[LW_GLOSS_WIDTH], gloss90[LW_GLOSS_WIDTH];   /* the gloss over the diffuse lobe */
    float even[LW_GLOSS_WIDTH];                              /* what it leaves of even light */
};
void lw_gloss_see16(const struct lw_gloss16 *gloss, struct lw_gloss_seen16 *out);

/** Takes the gloss off the diffuse lobe: all light of lamps arrives there. */
void lw_gloss_take_off(struct lw_gloss_seen16 *seen);

/** Light from outside: an even sky, and the environment on top. */
struct lw_gloss_sky {
    struct lw_vec3 sky; /* W/(m^2 sr) */
    const struct lw_ambient *ambient;
};
/** Radiance that points send to the eye of light from everywhere, W/(m^2 sr).
 * lanes  that are asked for
 * e      at plain normals, W/m^2, not negative
 * direction  its cosine moment over its luminance (direction_form.h), any value; NULL: not known
 * kept       how much of what they mirror is in it: the rest comes by a ray (mirror.h); NULL: all */
void lw_gloss_ambient16(const struct lw_gloss16 *gloss, const struct lw_gloss_seen16 *seen, uint16_t lanes,
                        const struct lw_gloss_sky *sky, const float e[3][LW_GLOSS_WIDTH],
                        const float (*direction)[LW_GLOSS_WIDTH], const float *kept,
                        float out[3][LW_GLOSS_WIDTH]);

/** The factor and the gain of direction_form.h: of E at the bumped normal, and of radiance along the mirrored
 * direction. For any `direction`. */
void lw_gloss_direct16(const struct lw_gloss16 *gloss, const struct lw_gloss_seen16 *seen,
                       const float (*direction)[LW_GLOSS_WIDTH], float out_factor[LW_GLOSS_WIDTH],
                       float out_gain[LW_GLOSS_WIDTH]);

/** A lamp: a ball, or a sun. */
struct lw_gloss_lamp {
    struct lw_vec3 at; /* world space, m; a sun's direction, unit */
    float radius;      /* m; a sun's is the tangent of half its angle */
    bool is_sun;
};
/** A lamp's light at each point. E is that of the bumped normal. The surface mirrors E D V (mirror + rim of
 * the point x rim of the lamp); E left arrives at its diffuse lobe. */
struct lw_gloss_lit16 {
    float dv[LW_GLOSS_WIDTH];   /* D V, 1/sr */
    float rim[LW_GLOSS_WIDTH];  /* (1 - cos)^5 of the facets */
    float left[LW_GLOSS_WIDTH]; /* what the gloss leaves, over that of even light */
};
/** The lobe is as much wider as the lamp is. */
void lw_gloss_lamp16(const struct lw_gloss_seen16 *seen, const struct lw_points16 *points,
                     const struct lw_gloss_lamp *lamp, struct lw_gloss_lit16 *out);

#endif
