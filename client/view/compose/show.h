/* show.h: what a view shows in place of its light: parts of it, and charts of how it is made.
 * Flow:    option or key -> [show] -> compose and gl_renderer; tiles of the client -> [show] -> a colour each
 * Threads: pure functions, [any]. */
#ifndef LW_CLIENT_VIEW_COMPOSE_SHOW_H
#define LW_CLIENT_VIEW_COMPOSE_SHOW_H

#include "client/lib/client.h"
#include "client/view/compose/attention.h"

/* tag, name, description in a few words. The first three are those of enum lw_path_part. From TEXELS on it is
 * a chart. */
#define LW_SHOW_MAP(X)                                                                                       \
    X(ALL, "all", "all light")                                                                               \
    X(DIRECT, "direct", "what shines, and the lights that are drawn here")                                   \
    X(INDIRECT, "indirect", "the light of tiles")                                                            \
    X(IRRADIANCE, "irradiance", "the light that arrives, as if all were white")                              \
    X(TEXELS, "texels", "texels, as they are read")                                                          \
    X(AGE, "age", "since a tile came: blue 0.1 s, green 10 s, red 1000 s")                                   \
    X(ERROR, "error", "a tile's error: blue 0.1 %, green 3 %, red 100 %")                                    \
    X(LEVEL, "level", "mip level that is read: green 0, yellow 1, red 2, violet coarser")                    \
    X(INTEREST, "interest", "asked for: green in view, blue around it, yellow seen before; else dark")       \
    X(NORMALS, "normals", "normals with their maps: X red, Y green, Z blue, 0 grey")                         \
    X(ROUGHNESS, "roughness", "roughness: a mirror is black")                                                \
    X(METALNESS, "metalness", "metalness: a metal is white")

enum lw_show {
#define X(tag, name, about) LW_SHOW_##tag,
    LW_SHOW_MAP(X)
#undef X
        LW_SHOW_COUNT
};
#define LW_SHOW_CHOICES                                                                                      \
    "all|direct|indirect|irradiance|texels|age|error|level|interest|normals|roughness|metalness"

const char *lw_show_name(enum lw_show show);
const char *lw_show_about(enum lw_show show);

/** Whether it is a chart, whose colours want neither exposure nor a tone curve. */
static inline bool lw_show_is_chart(enum lw_show show) { return show >= LW_SHOW_TEXELS; }
/** Whether its colours are those of tiles, of lw_show_colour_tiles(). */
static inline bool lw_show_is_of_tiles(enum lw_show show) {
    return show == LW_SHOW_AGE || show == LW_SHOW_ERROR || show == LW_SHOW_INTEREST;
}
/** Whether it is a chart of the surfaces themselves, which need no light. */
static inline bool lw_show_is_of_finish(enum lw_show show) { return show >= LW_SHOW_NORMALS; }

/* Colours of charts where a surface has no lightmap, and behind all surfaces. */
#define LW_SHOW_UNLIT  0.2f
#define LW_SHOW_BEHIND 0.02f
/* Texels are dark and bright in turn. */
#define LW_SHOW_DARK   0.15f
#define LW_SHOW_BRIGHT 0.6f

/** Linear RGB from blue at 0 over green at 1/2 to red at 1; NaN is 0. */
struct lw_vec3 lw_show_ramp(float t);

/** Linear RGB of a mip level. */
struct lw_vec3 lw_show_level_colour(int level);

/** Linear RGB of a unit normal in world space. */
static inline struct lw_vec3 lw_show_normal_colour(struct lw_vec3 n) {
    return lw_vec3(0.5f + 0.5f * n.x, 0.5f + 0.5f * n.y, 0.5f + 0.5f * n.z);
}

/** The tiles as the client has them. */
struct lw_show_tiles {
    uint32_t count;
    const void *context;
    struct lw_client_tile (*tile)(const void *context, lw_tile_id tile);
    uint64_t now_ns;
    const struct lw_attention *attention; /* as of its last list; NULL: nothing is asked for */
    const uint8_t *around;                /* as of that list; may be NULL */
};

/** Linear RGB of each tile in a chart that lw_show_is_of_tiles(). */
void lw_show_colour_tiles(enum lw_show show, const struct lw_show_tiles *of, struct lw_vec3 *out_colour);

#endif
