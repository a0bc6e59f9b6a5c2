#include "server/bake/convention.h"

const struct lw_convention *lw_convention_get(enum lw_convention_kind kind) {
    static const struct lw_convention table[LW_CONVENTION_COUNT] = {
        [LW_CONVENTION_IRRADIANCE] = {"irradiance", "irradiance E", "W/m^2", 1, false},
        /* Goral et al. 1984 count emission in; a material has it at its texture's own resolution, and would
         * show it twice. */
        [LW_CONVENTION_RADIOSITY] = {"radiosity", "reflected radiosity, albedo * E", "W/m^2", 1, true},
        [LW_CONVENTION_THREE] = {"three", "irradiance E", "W/m^2", 1, false},
        [LW_CONVENTION_GODOT] = {"godot", "E / pi", "W/(m^2 sr)", 1 / LW_PI, false},
        [LW_CONVENTION_BABYLON] = {"babylon", "reflected radiance, albedo / pi * E", "W/(m^2 sr)", 1 / LW_PI,
                                   true},
    };
    return &table[kind];
}
