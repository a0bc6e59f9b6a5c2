/* compose_patch.h: the triangles that pixels meet, with all that is known of one before a pixel is shaded.
 * Flow:    object, triangle -> [compose_patch] -> what compose_look and compose_finish read
 * Threads: a set of patches belongs to one rendering thread. */
#ifndef LW_CLIENT_VIEW_COMPOSE_COMPOSE_PATCH_H
#define LW_CLIENT_VIEW_COMPOSE_COMPOSE_PATCH_H

#include "client/view/compose/compose_texels.h"

/* A triangle that pixels meet. */
struct lw_compose_patch {
    uint32_t object, triangle;
    uint32_t packet; /* the last one that met it */
    struct lw_facet facet;
    struct lw_vec3 normal; /* world space; twice the triangle's area long */
    float grazing;         /* COSINE_MIN of that */
    float texels;          /* texels of level 0 on twice the triangle */
    int coarsest;          /* no coarser level serves */
    /* with direct light or finishes: */
    bool flat;                /* all normals are the face's */
    struct lw_vec3 corner[3]; /* world space, m; with direct light alone, as the next but one */
    struct lw_vec3 face;      /* unit normal */
    float largest_m;          /* for lw_trace_lift() */
    /* a surface that is shaded by a finish has these: */
    bool sound;  /* the mean of the corners' normals is on the face's side wherever it is */
    bool simple; /* gloss_maps.h reads its base colour, and nothing else of it varies */
    bool bumpy;
    struct lw_gloss_corner finish[3];
    float turn; /* handedness of the normal map */
};

/* Neighbouring pixels mostly meet the same few triangles: those met last, by a hash. */
#define LW_COMPOSE_PATCHES 64u
_Static_assert(LW_COMPOSE_PATCHES >= 2 * LW_TRACE_WIDTH, "a packet always finds a place");

struct lw_compose_patches {
    uint32_t packet; /* the number of this one */
    struct lw_compose_patch patch[LW_COMPOSE_PATCHES];
    struct lw_compose_fine_ids fine;
};

/** An empty set, for the pixels of one screen tile. */
void lw_compose_patch_forget(struct lw_compose_patches *patches);

/** Works a triangle out. */
void lw_compose_patch_init(const struct lw_compose *compose, uint32_t o, uint32_t triangle,
                           struct lw_compose_patch *out);

/* Good for the rest of the packet. */
static inline const struct lw_compose_patch *lw_compose_patch_of(const struct lw_compose *compose,
                                                                 struct lw_compose_patches *all,
                                                                 uint32_t object, uint32_t triangle) {
    for (uint32_t slot = triangle + 29u * object;; slot++) {
        struct lw_compose_patch *patch = &all->patch[slot % LW_COMPOSE_PATCHES];
        const bool same = patch->triangle == triangle && patch->object == object;
        if (!same && patch->packet == all->packet) continue;
        if (!same) lw_compose_patch_init(compose, object, triangle, patch);
        patch->packet = all->packet;
        return patch;
    }
}

/** The level of which a texel is as large as the pixel where its ray meets the surface, or smaller; of finer
 * ones, LW_FINE_CHOICE_PIXELS as large or larger. pixel_m^2 texels / (area cosine) texels of level 0 are
 * under a pixel, a quarter of it of level 1; no division is needed to tell which is one or less. */
int lw_compose_patch_level(const struct lw_compose_patch *patch, int finer, struct lw_vec3 dir,
                           float pixel_m);

#endif
