/* fine_choice.h: which finer level a view reads, and where it asks for one. The composer and liblightwell
 * take it from here, the GPU's shaders the constants alone. Threads: pure functions, [any]. */
#ifndef LW_COMMON_FINE_CHOICE_H
#define LW_COMMON_FINE_CHOICE_H

#include <math.h>
#include <stdbool.h>

/* A texel of a finer level is this many pixels wide, or wider: what light there is in the tiles is smooth. */
#define LW_FINE_CHOICE_PIXELS 4.0f
/* Finer levels are asked for where light differs by more than this share between the texels that a look-up
 * mixes (Kahl's threshold, of light instead of colour), and on triangles of fewer texels than these, whose
 * charts may be narrower than a texel: texels of level 0 on twice the triangle. */
#define LW_FINE_CHOICE_CHANGE 0.1f
#define LW_FINE_CHOICE_TEXELS 16.0f

/** Number of doublings by which a pixel's level may be finer than level 0; 0: level 0 is fine enough. texels,
 * area  texels of level 0 in the pixel are texels / area; area > 0
 * finer         how many finer levels there are */
static inline int lw_fine_choice(float texels, float area, int finer) {
    int level = 0;
    texels *= LW_FINE_CHOICE_PIXELS * LW_FINE_CHOICE_PIXELS;
    for (; level < finer && 4 * texels <= area; level++) texels *= 4;
    return level;
}

/** Whether a finer level would show the same as level 0.
 * luminance  of the four texels of level 0 that a look-up mixes */
static inline bool lw_fine_choice_is_even(const float luminance[4]) {
    float low = INFINITY, high = 0;
    for (int i = 0; i < 4; i++) {
        low = fminf(low, luminance[i]);
        high = fmaxf(high, luminance[i]);
    }
    return high - low <= LW_FINE_CHOICE_CHANGE * high;
}

#endif
