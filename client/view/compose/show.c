#include "client/view/compose/show.h"

#include <math.h>

static const char *const names[] = {
#define X(tag, name, about) name,
    LW_SHOW_MAP(X)
#undef X
};

static const char *const abouts[] = {
#define X(tag, name, about) about,
    LW_SHOW_MAP(X)
#undef X
};

const char *lw_show_name(enum lw_show show) { return names[show]; }
const char *lw_show_about(enum lw_show show) { return abouts[show]; }

struct lw_vec3 lw_show_level_colour(int level) {
    static const struct lw_vec3 finer = {0.05f, 0.5f, 0.8f}, finest = {0.6f, 0.9f, 1.0f};
    static const struct lw_vec3 colour[] = {
        {0.05f, 0.6f, 0.1f}, {0.8f, 0.6f, 0.05f}, {0.8f, 0.1f, 0.05f}, {0.4f, 0.1f, 0.7f}};
    if (level < 0) return level == -1 ? finer : finest;
    return colour[level < 3 ? level : 3];
}

struct lw_vec3 lw_show_ramp(float t) {
    t = t > 0 ? fminf(t, 1) : 0; /* NaN is 0 */
    const struct lw_vec3 low = {0.05f, 0.1f, 0.9f}, middle = {0.1f, 0.7f, 0.1f}, high = {0.9f, 0.05f, 0.05f};
    return t < 0.5f ? lw_vec3_mad(low, lw_vec3_sub(middle, low), 2 * t)
                    : lw_vec3_mad(middle, lw_vec3_sub(high, middle), 2 * t - 1);
}

static const struct lw_vec3 missing = {0.5f, 0.0f, 0.5f};

static struct lw_vec3 of_age(const struct lw_client_tile *tile, uint64_t now_ns) {
    if (tile->version == 0) return missing;
    const double age_s = now_ns > tile->arrived_ns ? (double)(now_ns - tile->arrived_ns) * 1e-9 : 0;
    return lw_show_ramp((float)(log10(fmax(age_s, 1e-9) / 0.1) / 4)); /* 0.1 s to 1000 s */
}

static struct lw_vec3 of_error(const struct lw_client_tile *tile) {
    if (tile->version == 0) return missing;
    return lw_show_ramp(log10f(fmaxf(tile->error, 1e-9f) / 0.001f) / 3); /* 0.1 % to 100 % */
}

static void colour_interest(const struct lw_show_tiles *of, struct lw_vec3 *out) {
    const struct lw_attention *a = of->attention;
    uint64_t newest_ns = 0;
    for (uint32_t t = 0; t < of->count; t++) out[t] = lw_vec3(LW_SHOW_BEHIND, LW_SHOW_BEHIND, LW_SHOW_BEHIND);
    if (a == NULL) return;
    for (uint32_t i = 0; i < a->list_count; i++)
        if (a->seen_ns[a->list[i].v] > newest_ns) newest_ns = a->seen_ns[a->list[i].v];
    for (uint32_t i = 0; i < a->list_count; i++) {
        const uint32_t t = a->list[i].v;
        const bool seen = newest_ns > 0 && a->seen_ns[t] == newest_ns;
        out[t] = seen                          ? lw_vec3(0.05f, 0.6f, 0.1f)
                 : of->around && of->around[t] ? lw_vec3(0.05f, 0.1f, 0.8f)
                                               : lw_vec3(0.8f, 0.6f, 0.05f);
    }
}

void lw_show_colour_tiles(enum lw_show show, const struct lw_show_tiles *of, struct lw_vec3 *out) {
    if (show == LW_SHOW_INTEREST) {
        colour_interest(of, out);
        return;
    }
    for (uint32_t t = 0; t < of->count; t++) {
        const struct lw_client_tile tile = of->tile(of->context, (lw_tile_id){t});
        out[t] = show == LW_SHOW_AGE ? of_age(&tile, of->now_ns) : of_error(&tile);
    }
}
