/* convention.h: the quantity and units of a lightmap's values, by engine.
 * Flow:    irradiance and albedo of a texel -> [convention] -> the texel of the map
 * Threads: pure functions, [any].
 * After:   the engines' own shaders; docs/baking_engines.md names the lines. */
#ifndef LW_BAKE_CONVENTION_H
#define LW_BAKE_CONVENTION_H

#include "common/base/vec.h"

enum lw_convention_kind {
    LW_CONVENTION_IRRADIANCE, /* E */
    LW_CONVENTION_RADIOSITY,  /* albedo * E: reflected light, without emission */
    LW_CONVENTION_THREE,   /* E: three.js adds a texel to irradiance, and multiplies by albedo / pi itself */
    LW_CONVENTION_GODOT,   /* E / pi: Godot multiplies by albedo alone */
    LW_CONVENTION_BABYLON, /* albedo / pi * E: Babylon.js adds a texel to the final colour */
    LW_CONVENTION_COUNT
};

/** The names in that order, as an option's choices. */
#define LW_CONVENTION_CHOICES "irradiance|radiosity|three|godot|babylon"

struct lw_convention {
    const char *name;
    const char *quantity; /* "irradiance" */
    const char *units;    /* "W/m^2" */
    float scale;
    bool times_albedo;
};

/** A convention; its strings are constants. */
const struct lw_convention *lw_convention_get(enum lw_convention_kind kind);

/** The texel for irradiance e (W/m^2) on a surface of that albedo. */
static inline struct lw_vec3 lw_convention_texel(const struct lw_convention *convention, struct lw_vec3 e,
                                                 struct lw_vec3 albedo) {
    const struct lw_vec3 scaled = lw_vec3_scale(e, convention->scale);
    return convention->times_albedo ? lw_vec3_mul(scaled, albedo) : scaled;
}

#endif
