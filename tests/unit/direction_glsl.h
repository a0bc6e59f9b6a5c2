/* direction_glsl.h: the GLSL of docs/baking.md, and of page and three, as functions of C.
 * Threads: pure functions, [any]. */
#ifndef LW_TESTS_UNIT_DIRECTION_GLSL_H
#define LW_TESTS_UNIT_DIRECTION_GLSL_H

#ifdef __cplusplus
extern "C" {
#endif

/** Factor of a map's irradiance, as docs/baking.md shows it. r: of the map; n, m: the plain and the bumped
 * normal, unit. */
double lw_direction_glsl_of_document(const float r[3], const float n[3], const float m[3]);

/** Factor and gain, as client/web/src/direction_shader.ts has them. */
void lw_direction_glsl_of_web(const float r[3], const float n[3], const float m[3], const float ahead[3],
                              float alpha, double out_by[2]);

/** r of a texel, as that file reads it. */
void lw_direction_glsl_from_texel(const float texel[3], double out_r[3]);

#ifdef __cplusplus
}
#endif

#endif
