/* direction_maps.h: directions of baked light, in the forms that engines read.
 * Flow:    r, plain normal and irradiance of each texel -> [direction_maps] -> EXR
 * Threads: one lw_map belongs to one thread.
 * After:   UnityCG.cginc of Unity, DecodeDirectionalLightmap(). Godot 4.4 and newer, modules/lightmapper_rd:
 *          lm_compute.glsl (USE_SH_LIGHTMAPS, MODE_PACK_L1_COEFFS). scene/3d/lightmap_gi.cpp stacks layers.
 *          scene_forward_clustered.glsl of the renderer reads them (uses_sh).
 *
 * Axes are those of glTF and of Godot: right-handed, y up. With the line of direction_linear.h:
 *
 * form      ratio  a texel holds
 * own       -      r of direction_form.h; A: coverage
 * dominant  1      D / 2 + 1/2, D = slope / even; A: (1 + D.n) / 2. E(m) = E (D.m + 1) / 2 / A
 * sh        4      four layers, from the top: L0 = even E / pi, and of y, z, x slope / (8 even) + 1/2; A:
 *                  coverage. E(m) / pi = L0 (1 + 4 (2 y - 1) m.y + 4 (2 z - 1) m.z + 4 (2 x - 1) m.x)
 *
 * Godot's own lightmapper, from 4.5 on, writes the same layers for a lamp alone. For other light it writes
 * L0 = E / (4 pi) and L1 = V / pi, which is 8 % dark at the plain normal under an even sky; `sh` is exact. */
#ifndef LW_BAKE_DIRECTION_MAPS_H
#define LW_BAKE_DIRECTION_MAPS_H

#include "server/bake/map.h"

enum lw_direction_maps_kind {
    LW_DIRECTION_MAPS_OWN,
    LW_DIRECTION_MAPS_DOMINANT,
    LW_DIRECTION_MAPS_SH,
    LW_DIRECTION_MAPS_COUNT
};

/** The names in that order, as an option's choices. */
#define LW_DIRECTION_MAPS_CHOICES "own|dominant|sh"

struct lw_direction_maps_form {
    const char *name;
    const char *quantity; /* an attribute of the file */
    const char *units;
    uint32_t layers; /* images of the atlas' size, one below the other in a file */
};

/** A form; its strings are constants. */
const struct lw_direction_maps_form *lw_direction_maps_get(enum lw_direction_maps_kind kind);

/** Turns a map of r (lw_map_build_directions()) into a form.
 * normals, irradiance: of the same object. Errors: LW_NO_MEMORY; the map is as it was. */
LW_MUST_CHECK enum lw_status lw_direction_maps_convert(struct lw_map *map, enum lw_direction_maps_kind kind,
                                                       const struct lw_map *normals,
                                                       const struct lw_map *irradiance, struct lw_error *err);

#endif
