/* builtin_texture.h: the computed textures of the built-in scenes.
 * Every texture is a function of (u, v) and tiles without a seam. Colours are written in sRGB, as stored.
 * Threads: [any]. */
#ifndef LW_COMMON_BUILTIN_TEXTURE_H
#define LW_COMMON_BUILTIN_TEXTURE_H

#include "common/builtin/builtin_stage.h"

/* name, width, height in texels, function */
#define LW_BUILTIN_TEXTURE_MAP(X)                                                                            \
    X(PLASTER, plaster, 512, 512)                                                                            \
    X(ASHLAR, ashlar, 512, 512) /* 2 x 4 blocks */                                                           \
    X(MARBLE, marble, 512, 512)                                                                              \
    X(INLAY, inlay, 1024, 1024)   /* one field of a stone floor */                                           \
    X(MEANDER, meander, 512, 128) /* runs along u */                                                         \
    X(TILES, tiles, 512, 512)     /* 4 x 4 terracotta tiles */                                               \
    X(WOOD, wood, 512, 512)       /* 4 planks along v */                                                     \
    X(ROOF_TILES, roof_tiles, 256, 256)                                                                      \
    X(RED_CLOTH, red_cloth, 512, 512) /* gold edges at u = 0 and 1 */                                        \
    X(BLUE_CLOTH, blue_cloth, 512, 512)                                                                      \
    X(GREEN_CLOTH, green_cloth, 512, 512)                                                                    \
    X(FROND, frond, 256, 1024)    /* root at v = 0; masked */                                                \
    X(LEAF, leaf, 256, 256)       /* root at v = 0; masked */                                                \
    X(POTTERY, pottery, 512, 512) /* painted bands along u */                                                \
    /* for the city alone */                                                                                 \
    X(SETTS, setts, 256, 256)   /* 12 x 16 paving stones */                                                  \
    X(PAVING, paving, 256, 256) /* 3 x 4 slabs */                                                            \
    X(BRICK, bricks, 256, 256)  /* 4 x 14 bricks */                                                          \
    X(GRASS, grass, 256, 256)                                                                                \
    X(FOLIAGE, foliage, 256, 256)                                                                            \
    X(SLATE, slate, 256, 256)    /* 6 x 6 slates */                                                          \
    X(STRIPES, stripes, 128, 16) /* 2 pairs along u */

enum lw_builtin_texture_kind {
#define X(kind, name, width, height) LW_BUILTIN_TEXTURE_##kind,
    LW_BUILTIN_TEXTURE_MAP(X)
#undef X
        LW_BUILTIN_TEXTURE_COUNT,
    LW_BUILTIN_TEXTURE_OF_CITY = LW_BUILTIN_TEXTURE_SETTS /* the first of them; all before are the atrium's */
};

/** Computes a texture into the stage and returns its index. */
uint32_t lw_builtin_texture_add(struct lw_builtin_stage *stage, enum lw_builtin_texture_kind kind);

/* name, width, height in texels, metres across, and whether it is equally rough everywhere; a function of
 * heights, roughness and how open a point lies */
#define LW_BUILTIN_RELIEF_MAP(X)                                                                             \
    X(PLASTER, plaster, 256, 256, 4.0f, true)                                                                \
    X(ASHLAR, ashlar, 512, 512, 1.5f, false) /* the texture's blocks; the others likewise */                 \
    X(MARBLE, marble, 256, 256, 2.4f, false)                                                                 \
    X(INLAY, inlay, 512, 512, 2.0f, false)                                                                   \
    X(MEANDER, meander, 512, 128, 2.48f, false)                                                              \
    X(TILES, tiles, 512, 512, 1.6f, false)                                                                   \
    X(WOOD, wood, 256, 256, 1.0f, true)                                                                      \
    X(ROOF, roof, 128, 128, 1.0f, true)                                                                      \
    X(WEAVE, weave, 512, 512, 2.15f, true)                                                                   \
    X(POTTERY, pottery, 256, 256, 1.2f, false)                                                               \
    X(BRONZE, bronze, 256, 256, 1.0f, false)                                                                 \
    X(RIPPLES, ripples, 256, 256, 1.0f, true)

enum lw_builtin_relief_kind {
#define X(kind, name, width, height, metres, even) LW_BUILTIN_RELIEF_##kind,
    LW_BUILTIN_RELIEF_MAP(X)
#undef X
        LW_BUILTIN_RELIEF_COUNT
};

/** Textures of finishes: a normal map, and a surface texture with metalness 1 unless the relief is even. */
struct lw_builtin_relief {
    uint32_t normal, surface;
};
/** Computes them into the stage. */
struct lw_builtin_relief lw_builtin_texture_add_relief(struct lw_builtin_stage *stage,
                                                       enum lw_builtin_relief_kind kind);

#endif
