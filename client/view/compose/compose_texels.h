/* compose_texels.h: bilinear look-ups in the levels of an atlas, in a coarser one where a level lacks.
 * Flow:    level, coordinates -> [compose_texels] -> the footprint, its light; needed tiles
 * Threads: any rendering thread. The look-ups are inline: each pixel has one. */
#ifndef LW_CLIENT_VIEW_COMPOSE_COMPOSE_TEXELS_H
#define LW_CLIENT_VIEW_COMPOSE_COMPOSE_TEXELS_H

#include "client/view/compose/compose_private.h"
#include "common/tile/bilinear.h"

/* The texels that a bilinear lookup reads, how it weighs them, and the tiles that hold them. */
struct lw_compose_footprint {
    struct lw_bilinear x, y;
    uint32_t tile[4];    /* UINT32_MAX: a tile of a finer level that has no id */
    unsigned tile_count; /* 1 where all are in one tile, else 4: the same id more than once in most cases */
};

/* Texels of a level along one of level 0. */
static inline float lw_compose_texels_scale(int k) {
    return k < 0 ? (float)(1u << -k) : 1.0f / (float)(1u << k);
}

static inline void lw_compose_texels_footprint(const struct lw_compose_level *level, int k, struct lw_vec2 uv,
                                               struct lw_compose_footprint *f) {
    const float scale = lw_compose_texels_scale(k);
    f->x = lw_bilinear_at(uv.x * scale, level->width);
    f->y = lw_bilinear_at(uv.y * scale, level->height);
    const uint32_t left = f->x.low / LW_TILE_SIDE, right = f->x.high / LW_TILE_SIDE;
    const uint32_t top = f->y.low / LW_TILE_SIDE, bottom = f->y.high / LW_TILE_SIDE;
    f->tile[0] = level->first_tile + top * level->tiles_x + left;
    f->tile_count = 1;
    if (left == right && top == bottom) return;
    f->tile_count = 4;
    f->tile[1] = level->first_tile + top * level->tiles_x + right;
    f->tile[2] = level->first_tile + bottom * level->tiles_x + left;
    f->tile[3] = level->first_tile + bottom * level->tiles_x + right;
}

/* The ids of tiles of finer levels that pixels want: neighbours mostly want the same. */
#define LW_COMPOSE_FINE_IDS 8u

struct lw_compose_fine_ids {
    struct lw_compose_fine_id {
        uint32_t object, level, x, y, id; /* level 0: nothing is known */
    } known[LW_COMPOSE_FINE_IDS];
};

/** lw_compose_texels_footprint() of a finer level, whose tiles get ids. False: no id is left for one. */
bool lw_compose_texels_claim_fine(const struct lw_compose *compose, struct lw_compose_fine_ids *ids,
                                  uint32_t object, int k, struct lw_vec2 uv, struct lw_compose_footprint *f);

/** The same without giving out ids. False: a tile has none. */
bool lw_compose_texels_find_fine(const struct lw_compose *compose, uint32_t object, int k, struct lw_vec2 uv,
                                 struct lw_compose_footprint *f);

static inline size_t lw_compose_texels_index(const struct lw_compose_level *level, uint32_t x, uint32_t y) {
    return 3 * ((size_t)y * level->width + x);
}

static inline struct lw_vec3 lw_compose_texels_vector(const float *from, size_t at) {
    return lw_vec3(from[at], from[at + 1], from[at + 2]);
}

static inline struct lw_vec3 lw_compose_texels_at(const struct lw_compose_level *level, uint32_t x,
                                                  uint32_t y) {
    return lw_compose_texels_vector(level->rgb, lw_compose_texels_index(level, x, y));
}

static inline struct lw_vec3 lw_compose_texels_mix(struct lw_vec3 a, struct lw_vec3 b, float t) {
    return lw_vec3_mad(a, lw_vec3_sub(b, a), t);
}

static inline bool lw_compose_texels_here(const struct lw_compose *compose,
                                          const struct lw_compose_footprint *f) {
    for (unsigned i = 0; i < f->tile_count; i++)
        if (f->tile[i] == UINT32_MAX || !compose->here[f->tile[i]]) return false;
    return true;
}

/* Light that is read: irradiance, and where it comes from; the latter 0 where that is not known. */
struct lw_compose_light {
    struct lw_vec3 e, direction;
};

/* Blends the texels of a footprint: the upper two from left to right, then the lower two. */
static inline struct lw_vec3 lw_compose_texels_blend(const struct lw_compose_footprint *f, const float *from,
                                                     const size_t at[4]) {
    const struct lw_vec3 upper = lw_compose_texels_mix(lw_compose_texels_vector(from, at[0]),
                                                       lw_compose_texels_vector(from, at[1]), f->x.share),
                         lower = lw_compose_texels_mix(lw_compose_texels_vector(from, at[2]),
                                                       lw_compose_texels_vector(from, at[3]), f->x.share);
    return lw_compose_texels_mix(upper, lower, f->y.share);
}

/* Reads one level that is not finer. False: a tile of the footprint is not there, or its texels are no
 * light. */
static inline bool lw_compose_texels_read(const struct lw_compose *compose,
                                          const struct lw_compose_level *level,
                                          const struct lw_compose_footprint *f,
                                          struct lw_compose_light *out) {
    if (level->rgb == NULL || !lw_compose_texels_here(compose, f)) return false;
    const size_t at[4] = {lw_compose_texels_index(level, f->x.low, f->y.low),
                          lw_compose_texels_index(level, f->x.high, f->y.low),
                          lw_compose_texels_index(level, f->x.low, f->y.high),
                          lw_compose_texels_index(level, f->x.high, f->y.high)};
    out->e = lw_compose_texels_blend(f, level->rgb, at);
    out->direction = level->direction ? lw_compose_texels_blend(f, level->direction, at) : lw_vec3(0, 0, 0);
    return lw_compose_is_light(out->e);
}

/** lw_compose_texels_read() of a finer level. */
bool lw_compose_texels_read_fine(const struct lw_compose *compose, const struct lw_compose_level *level,
                                 const struct lw_compose_footprint *f, struct lw_compose_light *out);

static inline void lw_compose_texels_mark_needed(struct lw_compose *compose,
                                                 const struct lw_compose_footprint *f) {
    for (unsigned i = 0; i < f->tile_count; i++)
        /* all threads write the same value: the result does not depend on their order */
        if (!__atomic_load_n(&compose->needed[f->tile[i]], __ATOMIC_RELAXED))
            __atomic_store_n(&compose->needed[f->tile[i]], 1, __ATOMIC_RELAXED);
}

/** Level that is read in place of one that lacks: the next coarser level that has light, or else a finer one.
 * out_level  that it is read at; LW_ATLAS_LEVELS_MAX: none, and it is the scene's average */
struct lw_compose_light lw_compose_texels_stand_in(const struct lw_compose *compose,
                                                   const struct lw_compose_object *object, int first,
                                                   struct lw_vec2 uv, int *out_level);

#endif
