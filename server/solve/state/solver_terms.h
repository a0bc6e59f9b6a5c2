/* solver_terms.h: what solver.h and the rooms below it both name: choices of a
 * desc, constants of every solve. */
#ifndef LW_STATE_SOLVER_TERMS_H
#define LW_STATE_SOLVER_TERMS_H

#include <stdbool.h>
#include <stdint.h>

/* No block counts as converged before this many frames. */
#define LW_SOLVER_FRAMES_MIN 16u

/* About what share of a texel's standard error the filter leaves. Views read coarser levels of
 * tiles that show more noise than they bear; with this their pictures come nearest to the path
 * tracer's (docs/lab/denoise.md). */
#define LW_SOLVER_NOISE_SHOWN 0.2f

/** When tiles of finer levels are made. */
enum lw_fine_when {
    LW_FINE_ONCE_SMOOTH,     /* some at a time, once level 0 below has little noise */
    LW_FINE_AFTER_FRAMES,    /* the same once it has had some frames, whatever its noise is */
    LW_FINE_AT_ONCE_FOR_MAPS /* in the frame after somebody asks for them, and they have albedo */
};

/** How a probe keeps what it sees (probe_form.h). */
enum lw_probe_form_kind { LW_PROBE_FORM_OCTAHEDRAL = 0, LW_PROBE_FORM_SH, LW_PROBE_FORM_CUBE };

/** In which direction a probe is read for what a ray beside it runs towards: that of the point where the ray
 * will arrive. Where that is, is guessed: */
enum lw_probe_projection {
    LW_PROBE_PROJECTION_DEPTH = 0, /* by the distances that the probe sees */
    LW_PROBE_PROJECTION_BOX,       /* at the scene's box: distant-point projection (Vandersanden 2023, 3.6) */
    LW_PROBE_PROJECTION_STEP       /* one longest side of the scene ahead: the same, cheaper */
};

/** Which texels of a window stand for it when it sends light (shooters.h). */
enum lw_undersample {
    LW_UNDERSAMPLE_NONE = 0, /* each for itself */
    LW_UNDERSAMPLE_STRIDE,   /* the first */
    LW_UNDERSAMPLE_RANDOM,   /* one drawn for each window and frame */
    LW_UNDERSAMPLE_MIP       /* their mean */
};
#define LW_UNDERSAMPLE_CHOICES "none|stride|random|mip"

#define LW_RADIOSITY_DIRECTIONS_MAX 1024u

/** What the radiosity solver is asked for; zeroed: full passes. */
struct lw_radiosity_terms {
    enum lw_undersample undersample;
    float subdivide;     /* > 0: squares of texels shoot as one as far as their light agrees to this */
    uint32_t directions; /* N > 0: each patch looks along these instead of at all shooters */
    /* The visibility of all pairs is kept: further passes take no ray. */
    bool keeps_visibility;
    const char *visibility_path; /* it is read from this file and written to it; NULL: none. With the above */
    uint32_t window; /* side of a window, texels; 0: 1/128 of the side of a square of all texels */
};

#define LW_VPL_LIGHTS_MAX     65536u
#define LW_VPL_LIGHTS_DEFAULT 512 /* without a suffix: --help has its digits */
#define LW_VPL_SETS_MAX       64u
#define LW_VPL_SETS_DEFAULT   1

/** What the solver of virtual point lights is asked for; zero: the default. */
struct lw_vpl_terms {
    uint32_t lights;  /* in all; LW_VPL_LIGHTS_DEFAULT */
    uint32_t sets;    /* each frame shades one of as many sets of them; LW_VPL_SETS_DEFAULT */
    uint32_t reshoot; /* lights at most that a frame shoots again; a set; UINT32_MAX: none but those lost */
    float near_m;     /* nearer than this a light is not brighter; by the area that it stands for */
};

static inline bool lw_vpl_terms_any(const struct lw_vpl_terms *t) {
    return t->lights || t->sets || t->reshoot || t->near_m > 0;
}
#endif
