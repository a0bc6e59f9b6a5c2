#include "server/solve/adapt/control_variate.h"

#include "common/base/colour.h"
#include "common/base/invariant.h"

#include <math.h>

#define LANES LW_TRACE_WIDTH
/* The share of the variance of a surface's findings that counts against believing them: viewers average
 * noise, but not change. */
#define NOISE_COUNTS 0.125f
/* The standard error of indirect light is this share of its correction: few rays may all have missed the same
 * bright spot. And by this share of the variance of what a surface has found: that is noise, of what its rays
 * end on, which the samples of the next solves have as well. (Counted in full, it kept means at three frames
 * for as long as light was taken to be changing: docs/lab/dynamic.md.) */
#define ERROR_MIN   0.25f
#define ERROR_NOISE 0.3f
/* Shares of a block's light. A change below TAKEN_MIN is not corrected. In a converged block, a change below
 * TAKEN_OF_TARGET of its error is not corrected either. A change below SHOWN_MIN is not shown for its own
 * sake. */
#define TAKEN_MIN       2e-3f
#define TAKEN_OF_TARGET 0.25f
#define SHOWN_MIN       2e-2f

/* Packets of the surface whose first is `first`. */
#define EACH_PACKET(block, first, set)                                                                       \
    for (uint32_t set = (first); set < (first) + (block)->packet[first].group; set++)
#define EACH_SURFACE(block, first)                                                                           \
    for (uint32_t first = 0; first < (block)->packet_count; first += (block)->packet[first].group)

static float most_square(struct lw_vec3 v) { return lw_vec3_max_abs(lw_vec3_mul(v, v)); }

static float luminance(float r, float g, float b) { return lw_colour_luminance(lw_vec3(r, g, b)); }

/* ---- direct light ---- */

/* The sum of squares that remains of one channel's differences when the plane that fits them best is taken
 * off. */
static float roughness(const struct lw_solve_tile *tile, const struct lw_ray_launch *launch,
                       const struct lw_vec3 off[LANES], uint32_t lanes, int channel) {
    const float n = (float)lanes;
    float x = 0, y = 0, d = 0, xx = 1, xy = 0, yy = 1, xd = 0, yd = 0, dd = 0;
    for (uint32_t lane = 0; lane < lanes; lane++) {
        x += (float)(launch->texel[lane] % tile->width) / n;
        y += (float)(launch->texel[lane] / tile->width) / n;
        d += (&off[lane].x)[channel] / n;
    }
    for (uint32_t lane = 0; lane < lanes; lane++) {
        const float u = (float)(launch->texel[lane] % tile->width) - x,
                    v = (float)(launch->texel[lane] / tile->width) - y, w = (&off[lane].x)[channel] - d;
        xx += u * u, xy += u * v, yy += v * v;
        xd += u * w, yd += v * w, dd += w * w;
    }
    if (lanes <= 3) return dd + n * d * d;
    const float determinant = xx * yy - xy * xy, along_x = (yy * xd - xy * yd) / determinant,
                along_y = (xx * yd - xy * xd) / determinant;
    return fmaxf(dd - along_x * xd - along_y * yd, 0) * n / (n - 3);
}

/* The mean after its sample has changed from `then` to `now`. Light that comes is added. For light that goes,
 * the mean loses the same share as the sample, so that its noise becomes less with it. */
static float changed(float mean, float then, float now) {
    if (now >= then || !(then > 0)) return fmaxf(mean + now - then, 0);
    return mean * fmaxf(now, 0) / then;
}

/* Corrects one channel: client-drawn light and all other light change each by itself. then, drawn_then: its
 * estimates of before. *out_served: by how much the other light is brighter. Returns by how much all light
 * is. */
static float add_channel(struct lw_tiles *tiles, uint32_t texel, int c, float then, float off,
                         float drawn_then, float off_drawn, float *out_served) {
    float *mean = &tiles->direct[c][texel], *drawn = &tiles->drawn[c][texel];
    const float now = then + off, was = *mean;
    if (!tiles->drawn[c]) return *out_served = (*mean = changed(was, then, now)) - was;
    const float drawn_now = drawn_then + off_drawn, served = was - *drawn;
    *drawn = changed(*drawn, drawn_then, drawn_now);
    const float served_now = changed(served, then - drawn_then, now - drawn_now);
    *mean = *drawn + served_now;
    *out_served = served_now - served;
    return *mean - was;
}

/* Luminance of a texel's direct light: of client lights, and of others. */
struct direct_luminance {
    float served, drawn;
};

static struct direct_luminance luminance_of(const struct lw_tiles *tiles, uint32_t texel) {
    struct direct_luminance l = {0};
    if (!tiles->moment[LW_TILES_DIRECT][0]) return l;
    if (tiles->drawn[0]) l.drawn = lw_colour_luminance(lw_texels_vector(tiles->drawn, texel));
    l.served = lw_colour_luminance(lw_texels_vector(tiles->direct, texel)) - l.drawn;
    return l;
}

/* Light keeps its direction while its amount is corrected. */
static void scale_moments(struct lw_tiles *tiles, uint32_t texel, const struct direct_luminance *then) {
    if (!tiles->moment[LW_TILES_DIRECT][0]) return;
    const struct direct_luminance now = luminance_of(tiles, texel);
    lw_tiles_scale_moment(tiles->moment[LW_TILES_DIRECT], texel, then->served, now.served);
    if (tiles->drawn[0]) lw_tiles_scale_moment(tiles->drawn_moment, texel, then->drawn, now.drawn);
}

static void add_direct(struct lw_tiles *tiles, struct lw_solve_block *block, uint32_t texel,
                       struct lw_vec3 off, struct lw_vec3 off_drawn) {
    float more[3], served[3];
    const struct direct_luminance then = luminance_of(tiles, texel);
    const struct lw_vec3 estimate = lw_tiles_estimate(tiles, LW_TILES_ESTIMATE_DIRECT, texel),
                         drawn = tiles->drawn[0] ? lw_tiles_drawn_estimate(tiles, texel) : lw_vec3(0, 0, 0);
    for (int c = 0; c < 3; c++)
        more[c] = add_channel(tiles, texel, c, (&estimate.x)[c], (&off.x)[c], (&drawn.x)[c],
                              (&off_drawn.x)[c], &served[c]);
    lw_tiles_keep_estimate(tiles, LW_TILES_ESTIMATE_DIRECT, texel, lw_vec3_add(estimate, off));
    if (tiles->drawn[0]) lw_tiles_keep_drawn_estimate(tiles, texel, lw_vec3_add(drawn, off_drawn));
    const float brighter = luminance(more[0], more[1], more[2]);
    tiles->mean[texel] += brighter;
    block->luminance += (double)brighter;
    if (tiles->split_mean) tiles->split_mean[texel] += luminance(served[0], served[1], served[2]);
    scale_moments(tiles, texel, &then);
    LW_INVARIANT_DEAR(lw_vec3_is_finite(lw_texels_vector(tiles->direct, texel)));
}

void lw_control_variate_direct(struct lw_tiles *tiles, const struct lw_solve_tile *tile,
                               struct lw_solve_block *block, uint32_t set, const struct lw_ray_launch *launch,
                               const struct lw_vec3 off[LW_TRACE_WIDTH], const struct lw_vec3 *off_drawn) {
    const uint32_t lanes = (uint32_t)__builtin_popcount(launch->active);
    struct lw_change_packet *packet = &block->change.packet[set];
    struct lw_vec3 weighted[LANES];
    float rough = 0;
    LW_INVARIANT(lanes > 0 && set < block->packet_count);
    packet->direct_square = 0;
    for (uint32_t lane = 0; lane < lanes; lane++) {
        const uint32_t texel = tile->first + launch->texel[lane];
        add_direct(tiles, block, texel, off[lane], off_drawn ? off_drawn[lane] : lw_vec3(0, 0, 0));
        weighted[lane] = lw_vec3_scale(off[lane], block->weight[tiles->region_of_texel[texel]]);
        packet->direct = lw_vec3_mad(packet->direct, weighted[lane], 1 / (float)lanes);
    }
    for (int c = 0; c < 3; c++) rough = fmaxf(rough, roughness(tile, launch, weighted, lanes, c));
    LW_INVARIANT_DEAR(rough >= 0 && lw_vec3_is_finite(packet->direct));
    packet->direct_rough += rough;
    block->unseen = true;
}

/* Variance of what the packets of a surface were corrected by, of the channel in which it is most. */
static float variance_of(const struct lw_solve_block *block, uint32_t first) {
    const float n = block->packet[first].group;
    struct lw_vec3 mean = {0}, square = {0};
    EACH_PACKET(block, first, set) mean = lw_vec3_mad(mean, block->change.packet[set].direct, 1 / n);
    EACH_PACKET(block, first, set) {
        const struct lw_vec3 off = lw_vec3_sub(block->change.packet[set].direct, mean);
        square = lw_vec3_mad(square, lw_vec3_mul(off, off), 1 / fmaxf(n - 1, 1));
    }
    return lw_vec3_max_abs(square);
}

static bool was_corrected(const struct lw_solve_block *block) {
    return block->packet_count && block->change.direct == lw_change_all_packets(block);
}

/* What a tile's packets were corrected by: the mean square of a texel; of the squares, the share that is
 * uncertain where packets lie among others. */
struct tile_change {
    float square, share;
};

static struct tile_change change_of(const struct lw_solve_tile *tile) {
    double square = 0, texels = 0, among = 0, variance = 0;
    LW_TILES_EACH_BLOCK (tile, block) {
        if (was_corrected(block))
            EACH_SURFACE (block, first) {
                const uint32_t n = block->packet[first].group;
                if (n > 1) variance += n * (double)variance_of(block, first);
                EACH_PACKET(block, first, set) {
                    const double own = (double)most_square(block->change.packet[set].direct);
                    if (n > 1) among += own;
                    square += block->packet[set].count * own;
                    texels += block->packet[set].count;
                }
            }
    }
    return (struct tile_change){.square = texels > 0 ? (float)(square / texels) : 0,
                                .share = among > 0 ? (float)fmin(1, variance / among) : 1};
}

/* The mean square of the change that samples as noisy as the block's may miss. It is not more than the tile
 * has changed elsewhere. */
static float may_be_missed(const struct lw_solve_block *block, const struct tile_change *whole) {
    const float noise = block->noise[LW_TILES_DIRECT];
    return noise < 0 ? whole->square
                     : fminf(noise * block->reference_luminance * block->reference_luminance, whole->square);
}

void lw_control_variate_note_error(struct lw_solve_tile *tile) {
    const struct tile_change tile_change = change_of(tile);
    LW_TILES_EACH_BLOCK (tile, block) {
        const float missed = may_be_missed(block, &tile_change);
        if (was_corrected(block))
            EACH_SURFACE (block, first) {
                const bool alone = block->packet[first].group < 2;
                const float variance = variance_of(block, first);
                EACH_PACKET(block, first, set) {
                    struct lw_change_packet *packet = &block->change.packet[set];
                    const float off = alone ? tile_change.share * most_square(packet->direct) : variance;
                    packet->direct_error =
                        packet->direct_rough + block->packet[set].count * fmaxf(off, missed);
                    LW_INVARIANT_DEAR(packet->direct_error >= 0);
                }
            }
    }
}

/* ---- indirect light: findings ---- */

/* Findings of a surface's packets that were verified since the last call, by the regions of the block. */
struct finding {
    struct lw_vec3 sum[LW_CHANGE_ORDERS][LW_REGIONS];
    float square[LW_REGIONS];
    uint32_t lanes[LW_REGIONS];
};

static struct finding find(const struct lw_solve_block *block, uint32_t first) {
    struct finding f = {.lanes = {0}};
    EACH_PACKET(block, first, set) {
        const struct lw_change_packet *packet = &block->change.packet[set];
        if (!(block->change.uncorrected >> set & 1)) continue;
        for (uint32_t r = 0; r < LW_REGIONS; r++) {
            f.lanes[r] += block->packet[set].lanes[r];
            f.square[r] += packet->indirect_square[r];
            for (int order = 0; order < LW_CHANGE_ORDERS; order++)
                f.sum[order][r] = lw_vec3_add(f.sum[order][r], packet->indirect[order][r]);
        }
    }
    return f;
}

/* Mean difference of `lanes` texels, and the square of its standard error. */
struct mean {
    struct lw_vec3 of[LW_CHANGE_ORDERS], all;
    float square, error;
    uint32_t lanes;
};

/* The mean over the regions from `first` to before `end`. */
static struct mean mean_of(const struct finding *f, uint32_t first, uint32_t end) {
    struct mean m = {.lanes = 0};
    float square = 0;
    for (uint32_t r = first; r < end; r++) {
        m.lanes += f->lanes[r];
        square += f->square[r];
        for (int order = 0; order < LW_CHANGE_ORDERS; order++)
            m.of[order] = lw_vec3_add(m.of[order], f->sum[order][r]);
    }
    if (!m.lanes) return m;
    const float n = (float)m.lanes;
    for (int order = 0; order < LW_CHANGE_ORDERS; order++) {
        m.of[order] = lw_vec3_scale(m.of[order], 1 / n);
        m.all = lw_vec3_add(m.all, m.of[order]);
    }
    m.square = lw_vec3_dot(m.all, m.all);
    m.error = m.lanes > 1 ? fmaxf(square / n - m.square, 0) / (n - 1) : m.square;
    return m;
}

/* The regions of a block's part: what lies on other sides of walls says nothing of it (regions.h). */
#define EACH_PART(block, from, to)                                                                           \
    for (uint32_t part_ = 0, from = 0, to; part_ < (block)->parts.count && (to = (block)->parts.end[part_]); \
         from = to, part_++)

/* Weighted mean square by which the surfaces of a tile have changed, less the part that is noise, and less a
 * standard deviation that chance gives if nothing has changed. */
static float spread_of(const struct lw_solve_tile *tile) {
    double square = 0, chance = 0, lanes = 0;
    LW_TILES_EACH_BLOCK (tile, block) {
        if (!block->change.uncorrected) continue;
        EACH_SURFACE (block, first) {
            const struct finding f = find(block, first);
            EACH_PART(block, from, to) {
                const struct mean m = mean_of(&f, from, to);
                const double weight = (double)block->weight[from], each = weight * weight * (double)m.lanes,
                             noise = each * (double)m.error;
                square += each * (double)m.square - noise;
                chance += 2 * noise * noise;
                lanes += m.lanes;
            }
        }
    }
    return lanes > 0 ? (float)fmax((square - sqrt(chance)) / lanes, 0) : 0;
}

/* ---- indirect light: correction ---- */

/* W/m^2 to be added to the mean of a surface's texels in each region of a part of the block. */
struct shift {
    uint32_t from, to; /* regions */
    struct lw_vec3 of[LW_CHANGE_ORDERS][LW_REGIONS];
};

/* Returns the believed share of a surface's findings, 0 to 1. spread: its tile's; weight: its part's. */
static float choose_shift(const struct finding *f, const struct mean *whole, float spread, float weight,
                          struct shift *out) {
    const float believed = spread / (spread + NOISE_COUNTS * weight * weight * whole->error);
    LW_INVARIANT_DEAR(out->from < out->to && out->to <= LW_REGIONS && believed >= 0 && believed <= 1);
    for (uint32_t r = out->from; r < out->to; r++) {
        const struct mean region = mean_of(f, r, r + 1);
        const struct lw_vec3 off = lw_vec3_sub(region.all, whole->all);
        const float square = lw_vec3_dot(off, off),
                    own = region.lanes > 1 && square > region.error ? 1 - region.error / square : 0;
        for (int order = 0; order < LW_CHANGE_ORDERS; order++)
            out->of[order][r] = lw_vec3_mad(lw_vec3_scale(whole->of[order], believed),
                                            lw_vec3_sub(region.of[order], whole->of[order]), own);
    }
    return believed;
}

/* Takes the correction that was taken over off the findings of the packets. */
static void take_from(struct lw_solve_block *block, uint32_t first, const struct shift *shift) {
    EACH_PACKET(block, first, set) {
        struct lw_change_packet *packet = &block->change.packet[set];
        if (!(block->change.verified >> set & 1)) continue;
        for (uint32_t r = shift->from; r < shift->to; r++) {
            const float n = (float)block->packet[set].lanes[r];
            const struct lw_vec3 both =
                lw_vec3_add(shift->of[LW_CHANGE_FIRST][r], shift->of[LW_CHANGE_LATER][r]);
            packet->indirect_square[r] +=
                n * lw_vec3_dot(both, both) - 2 * lw_vec3_dot(both, lw_change_both_orders(packet, r));
            for (int order = 0; order < LW_CHANGE_ORDERS; order++)
                packet->indirect[order][r] = lw_vec3_mad(packet->indirect[order][r], shift->of[order][r], -n);
        }
    }
}

/* Light of `texels` texels together. */
struct sum {
    double light[LW_CHANGE_ORDERS];
    uint32_t texels;
};

/* Light that comes is added evenly; of light that goes each texel loses the same share, so
 * that none has less than none. */
static float shifted(float value, float shift, double light, uint32_t texels) {
    if (shift >= 0) return value + shift;
    const double left = light + (double)shift * texels;
    return left > 0 ? value * (float)(left / light) : 0;
}

/* Under this share of what they become, a texel's later bounces do not tell how that is
 * to be shared out among them. */
#define SHARED_MIN 1e-6f

/* Returns by how much the texel is brighter. */
static float shift_texel(struct lw_tiles *tiles, uint32_t texel, int c, const struct sum *sum,
                         const float shift[LW_CHANGE_ORDERS]) {
    const float first = lw_tiles_first(tiles, (uint32_t)c, texel),
                later = lw_tiles_later(tiles, (uint32_t)c, texel),
                first_now = shifted(first, shift[LW_CHANGE_FIRST], sum->light[LW_CHANGE_FIRST], sum->texels),
                later_now = shifted(later, shift[LW_CHANGE_LATER], sum->light[LW_CHANGE_LATER], sum->texels);
    const bool shared = later > 0 && later >= SHARED_MIN * later_now;
    for (uint32_t k = 0; k + 1 < tiles->bounces; k++) {
        float *light = &tiles->order[k][c][texel];
        if (k == 0)
            *light = first_now;
        else
            *light = shared ? *light * (later_now / later) : k == 1 ? later_now : 0;
    }
    tiles->indirect[c][texel] = first_now + later_now;
    LW_INVARIANT_DEAR(isfinite(tiles->indirect[c][texel]));
    return first_now - first + later_now - later;
}

/* The texels of a surface and a part, with the region that each lies in. */
struct texels {
    uint32_t texel[LW_TILE_BLOCK * LW_TILE_BLOCK], count;
    uint8_t region[LW_TILE_BLOCK * LW_TILE_BLOCK];
};

static void list_texels(const struct lw_tiles *tiles, const struct lw_solve_tile *tile,
                        const struct lw_solve_block *block, uint32_t first, const struct shift *shift,
                        struct texels *out) {
    out->count = 0;
    EACH_PACKET(block, first, set) {
        struct lw_ray_launch launch;
        lw_ray_launch_init(&launch, tile, block, set);
        for (uint32_t lane = 0; lane < block->packet[set].count; lane++) {
            const uint32_t texel = tile->first + launch.texel[lane];
            const uint8_t region = tiles->region_of_texel[texel];
            if (region < shift->from || region >= shift->to) continue;
            LW_INVARIANT_DEAR(out->count < LW_TILE_BLOCK * LW_TILE_BLOCK);
            out->texel[out->count] = texel;
            out->region[out->count++] = region;
        }
    }
}

static void shift_texels(struct lw_tiles *tiles, struct lw_solve_block *block, const struct texels *texels,
                         const struct shift *shift, bool estimates) {
    static const float weight[3] = {0.2126f, 0.7152f, 0.0722f};
    float then[LW_TILE_BLOCK * LW_TILE_BLOCK];
    for (uint32_t i = 0; tiles->moment[LW_TILES_INDIRECT][0] && i < texels->count; i++)
        then[i] = lw_colour_luminance(lw_texels_vector(tiles->indirect, texels->texel[i]));
    for (int c = 0; c < 3; c++) {
        struct sum sum[LW_REGIONS] = {{{0}, 0}};
        for (uint32_t i = 0; i < texels->count; i++) {
            struct sum *region = &sum[texels->region[i]];
            region->light[LW_CHANGE_FIRST] += (double)lw_tiles_first(tiles, (uint32_t)c, texels->texel[i]);
            region->light[LW_CHANGE_LATER] += (double)lw_tiles_later(tiles, (uint32_t)c, texels->texel[i]);
            region->texels++;
        }
        for (uint32_t i = 0; i < texels->count; i++) {
            const uint32_t texel = texels->texel[i], r = texels->region[i];
            const float by[LW_CHANGE_ORDERS] = {(&shift->of[LW_CHANGE_FIRST][r].x)[c],
                                                (&shift->of[LW_CHANGE_LATER][r].x)[c]};
            const float brighter = weight[c] * shift_texel(tiles, texel, c, &sum[r], by);
            tiles->mean[texel] += brighter;
            if (tiles->split_mean) tiles->split_mean[texel] += brighter;
            block->luminance += (double)brighter;
        }
    }
    for (uint32_t i = 0; estimates && i < texels->count; i++)
        for (int order = 0; order < LW_CHANGE_ORDERS; order++) {
            const int which = LW_TILES_ESTIMATE_BOUNCES + order;
            lw_tiles_keep_estimate(tiles, which, texels->texel[i],
                                   lw_vec3_add(lw_tiles_estimate(tiles, which, texels->texel[i]),
                                               shift->of[order][texels->region[i]]));
        }
    for (uint32_t i = 0; tiles->moment[LW_TILES_INDIRECT][0] && i < texels->count; i++)
        lw_tiles_scale_moment(tiles->moment[LW_TILES_INDIRECT], texels->texel[i], then[i],
                              lw_colour_luminance(lw_texels_vector(tiles->indirect, texels->texel[i])));
}

/* shift: has its regions. */
static bool correct_part(struct lw_tiles *tiles, const struct lw_solve_tile *tile,
                         struct lw_solve_block *block, uint32_t first, const struct finding *f, float spread,
                         float least, bool estimates, struct shift *shift) {
    const struct mean whole = mean_of(f, shift->from, shift->to);
    if (!whole.lanes) return false;
    struct texels texels;
    const float weight = block->weight[shift->from],
                believed = choose_shift(f, &whole, spread, weight, shift),
                all = (block->reference_luminance + block->other_luminance) / weight,
                square = believed * believed * whole.square, light = all * all;
    if (!(square > least * least * light)) return false;
    list_texels(tiles, tile, block, first, shift, &texels);
    shift_texels(tiles, block, &texels, shift, estimates);
    take_from(block, first, shift);
    const bool much = square > SHOWN_MIN * SHOWN_MIN * light;
    const float variance = ERROR_NOISE * believed * whole.error + (much ? ERROR_MIN * ERROR_MIN * square : 0),
                share = (float)texels.count / (float)block->covered_count;
    block->change.standard_error = sqrtf(block->change.standard_error * block->change.standard_error +
                                         share * weight * weight * variance);
    LW_INVARIANT(texels.count > 0 && texels.count <= block->covered_count);
    LW_INVARIANT_DEAR(block->change.standard_error >= 0 && isfinite(block->change.standard_error));
    block->unseen |= much;
    return true;
}

static bool correct_surface(struct lw_tiles *tiles, const struct lw_solve_tile *tile,
                            struct lw_solve_block *block, uint32_t first, float spread, float least,
                            bool estimates) {
    const struct finding f = find(block, first);
    bool any = false;
    EACH_PART(block, from, to) {
        struct shift shift = {.from = from, .to = to};
        any |= correct_part(tiles, tile, block, first, &f, spread, least, estimates, &shift);
    }
    return any;
}

bool lw_control_variate_indirect(struct lw_tiles *tiles, struct lw_solve_tile *tile, float target_error,
                                 bool estimates) {
    const float spread = tiles->bounces ? spread_of(tile) : 0,
                least = fmaxf(TAKEN_MIN, TAKEN_OF_TARGET * target_error);
    bool any = false;
    LW_TILES_EACH_BLOCK (tile, block) {
        if (spread > 0 && block->change.uncorrected)
            EACH_SURFACE (block, first)
                any |= correct_surface(tiles, tile, block, first, spread, least, estimates);
        block->change.uncorrected = 0;
    }
    return any;
}
