/* mirror.h: materials that name a diffuse and a specular colour: which of the two is the albedo. */
#ifndef LW_IMPORT_MIRROR_H
#define LW_IMPORT_MIRROR_H

#include <math.h>
#include <stdbool.h>

/* A diffuse colour this dark beside a specular one this bright is that of a mirror or of glass. Below: black
 * rubber, with the highlight that exporters put on everything (0.2 in FBX, 0.4 in Collada, 0.5 in MTL files
 * of some). */
#define LW_MIRROR_BLACK  0.02f
#define LW_MIRROR_BRIGHT 0.55f

static inline float lw_mirror_brightest(const float c[3]) { return fmaxf(c[0], fmaxf(c[1], c[2])); }

/** Whether the specular colour takes the diffuse colour's place. */
static inline bool lw_mirror_is(const float diffuse[3], const float specular[3]) {
    return lw_mirror_brightest(diffuse) <= LW_MIRROR_BLACK &&
           lw_mirror_brightest(specular) >= LW_MIRROR_BRIGHT;
}

#endif
