#include "server/solve/surface/crossings.h"

#include "common/base/random.h"
#include "common/base/union_find.h"
#include "common/light/direction.h"

#include <stdlib.h>
#include <string.h>

/* Cuts are looked for this high above the surface, in texels: under what counts as close. */
#define HEIGHT 0.1f
/* Neighbours whose normals differ by more, or whose places by more texels, are apart anyway; a bulge parts
 * none. */
#define NORMALS_COSINE 0.866f
#define APART          3.0f

/* Shares of the sky that places out of doors see at least, and more than those in a room. */
#define SKY_OUTSIDE 0.2f
#define SKY_MORE    0.1f
#define SKY_PACKETS 2 /* packets of rays for each texel near a cut; its neighbours' count as well */
/* Regions of this size may be one of a room and one out of doors, or cut a strip off. Thin bars, which cross
 * each other all over a chair, are smaller. */
#define REGION 32
/* In a room a quarter of the rays go this far, in texels, even from beside a wall: a cupboard is none. */
#define ROOM 4.0f

enum {
    CUT_RIGHT = LW_TEXELS_WALL_RIGHT,
    CUT_BELOW = LW_TEXELS_WALL_BELOW,
    CUT = 4,  /* on any side */
    NEAR = 8, /* at or beside a cut of two large regions, in either */
    CLOSE = 16,
    ALIEN = 32, /* a cavity or out of doors, and its neighbour not */
    DEEP = 64,  /* the same farther from there: else these would be filled from it */
    EDGE = 128,
    BEHIND = 256 /* the face that parts it from a neighbour shows it its back, and that one its front */
};

/* What no cut parts; held at its root. */
struct region {
    uint32_t texels, beside;  /* beside cuts */
    uint32_t met;             /* the texels of the largest region that it may yield to, across its cuts */
    uint32_t cuts, to_behind; /* how often cuts part it from others, and from surfaces behind */
};

/* One object, its texels by their index within the mesh. */
struct part {
    const struct lw_mesh_texels *mesh;
    const struct lw_scene *scene;
    const bool *stands;
    const struct lw_trace *trace;
    struct lw_affine to_world;
    struct lw_sample_points_frame frame;
    float size_m;
    uint8_t *covered;
    const uint8_t *usable;
    const bool *sought;    /* per block, row by row; NULL: all are */
    uint32_t blocks_x;     /* blocks of a row */
    uint32_t first, end;   /* its texels that may be on a side with sought ones: whole rows of tiles */
    uint32_t row, end_row; /* the same as rows of texels */
    struct lw_vec3 *place; /* per texel, object space: the middle of its usable points */
    float *height_m;       /* above each texel, at which cuts are looked for */
    uint16_t *flags;       /* per texel: flags as above */
    /* Per NEAR texel: rays that see the sky, rays that go far, all; then sums over it and its neighbours. */
    struct sight {
        uint16_t sky, far, all;
    } * own, *sight;
    uint32_t *parent;
    struct region *region; /* by its root */
};

/* Sixteen rays of texels in a row: up, or to a neighbour. */
struct rays {
    struct lw_ray16 ray;
    struct lw_vec3 from[LW_TRACE_WIDTH], way[LW_TRACE_WIDTH];
    uint32_t texel[LW_TRACE_WIDTH], neighbour[LW_TRACE_WIDTH];
    uint16_t active;
};

/* Around blocks that are sought it is known how texels lie, as these yield by their neighbours. */
#define AROUND 4

static bool is_sought(const struct part *p, uint32_t x, uint32_t y) {
    return !p->sought || p->sought[y / LW_TILE_BLOCK * p->blocks_x + x / LW_TILE_BLOCK];
}

/* Whether a block that is sought is that many texels away, or less. */
static bool is_by_sought(const struct part *p, uint32_t x, uint32_t y, uint32_t reach) {
    const uint32_t left = x > reach ? x - reach : 0, top = y > reach ? y - reach : 0,
                   right = x + reach < p->mesh->width ? x + reach : p->mesh->width - 1,
                   bottom = y + reach < p->mesh->height ? y + reach : p->mesh->height - 1;
    return is_sought(p, left, top) || is_sought(p, right, top) || is_sought(p, left, bottom) ||
           is_sought(p, right, bottom);
}

static bool is_still(const struct part *p, const struct lw_hit16 *hits, uint32_t lane) {
    const uint32_t object = hits->object[lane];
    if (object == LW_TRACE_MISS || !p->stands[object]) return false;
    return lw_trace_material(p->scene, hits, lane)->alpha_mode == LW_ALPHA_OPAQUE;
}

static struct lw_vec3 normal_at(const struct part *p, uint32_t i) {
    return lw_affine_normal(&p->to_world, lw_packed_normal_unpack(p->mesh->geometric[i]));
}

static struct lw_vec3 raised(const struct part *p, uint32_t i, float height_m) {
    return lw_vec3_mad(lw_affine_point(&p->to_world, p->place[i]), normal_at(p, i), height_m);
}

static float lift_of(const struct part *p, uint32_t i) {
    return lw_sample_points_lift_m(&p->frame, lw_packed_length_unpack(p->mesh->sample_points.lift[i]));
}

/* How much room there is above each texel. */
static void measure(struct part *p, const struct rays *rays) {
    struct lw_hit16 hits;
    lw_trace_closest16(p->trace, LW_TRACE_COHERENT, rays->active, &rays->ray, &hits);
    for (uint32_t lane = 0; lane < LW_TRACE_WIDTH; lane++) {
        if (!(rays->active >> lane & 1)) continue;
        const uint32_t i = rays->texel[lane];
        p->height_m[i] = HEIGHT * p->size_m;
        if (!is_still(p, &hits, lane)) continue;
        if (hits.t[lane] < LW_CROSSINGS_CLOSE * p->size_m) p->flags[i] |= CLOSE;
        p->height_m[i] = fminf(p->height_m[i], lift_of(p, i) + 0.5f * hits.t[lane]);
    }
}

/* Looks for cuts from the texels to their neighbours, and where there are any, whether those who look along
 * the way see them: single-sided faces only show their fronts. */
static void note_cuts(struct part *p, const struct rays *rays, uint8_t side) {
    struct lw_hit16 hits, there, back;
    lw_trace_closest16(p->trace, 0, rays->active, &rays->ray, &hits);
    struct lw_ray16 returning = {.salt = 0};
    uint16_t cut = 0;
    for (uint32_t lane = 0; lane < LW_TRACE_WIDTH; lane++) {
        if (!(rays->active >> lane & 1) || !is_still(p, &hits, lane)) continue;
        p->flags[rays->texel[lane]] |= side;
        const struct lw_vec3 way = rays->way[lane];
        lw_trace_set_ray(&returning, lane, lw_vec3_add(rays->from[lane], way), lw_vec3_scale(way, -1), 1);
        cut |= (uint16_t)(1u << lane);
    }
    if (!cut) return;
    lw_trace_closest16(p->trace, LW_TRACE_VIEW, cut, &rays->ray, &there);
    lw_trace_closest16(p->trace, LW_TRACE_VIEW, cut, &returning, &back);
    for (uint32_t lane = 0; lane < LW_TRACE_WIDTH; lane++) {
        if (!(cut >> lane & 1)) continue;
        const bool own = is_still(p, &there, lane), other = is_still(p, &back, lane);
        if (own != other) p->flags[own ? rays->neighbour[lane] : rays->texel[lane]] |= BEHIND;
    }
}

static float distance(const struct part *p, uint32_t i, uint32_t j) {
    return lw_vec3_length(
        lw_vec3_sub(lw_texels_vector(p->mesh->position, i), lw_texels_vector(p->mesh->position, j)));
}

/* The texel beside or below one, of the same piece of surface; LW_TEXEL_NONE: there is none. */
static uint32_t next_to(const struct part *p, uint32_t x, uint32_t y, uint8_t side) {
    const struct lw_mesh_texels *mesh = p->mesh;
    const uint32_t nx = x + (side == CUT_RIGHT), ny = y + (side == CUT_BELOW),
                   i = lw_texels_index(mesh, x, y);
    if (nx >= mesh->width || ny >= mesh->height || !p->usable[i]) return LW_TEXEL_NONE;
    const uint32_t j = lw_texels_index(mesh, nx, ny);
    if (!p->usable[j] || mesh->chart[i] != mesh->chart[j]) return LW_TEXEL_NONE;
    const struct lw_vec3 n = lw_packed_normal_unpack(mesh->geometric[i]),
                         m = lw_packed_normal_unpack(mesh->geometric[j]);
    return lw_vec3_dot(n, m) < NORMALS_COSINE || distance(p, i, j) > APART * mesh->texel_m ? LW_TEXEL_NONE
                                                                                           : j;
}

/* Gathers rays of all texels by sixteens: those up, or those to a neighbour. */
static void shoot(struct part *p, uint8_t side) {
    struct rays rays = {.active = 0};
    uint32_t lane = 0;
    for (uint32_t y = p->row; y < p->end_row; y++)
        for (uint32_t x = 0; x < p->mesh->width; x++) {
            if (!is_by_sought(p, x, y, side ? AROUND : AROUND + 1)) continue;
            const uint32_t i = lw_texels_index(p->mesh, x, y), j = side ? next_to(p, x, y, side) : i;
            if (j == LW_TEXEL_NONE || !p->covered[i]) continue;
            rays.texel[lane] = i;
            rays.neighbour[lane] = j;
            rays.from[lane] = raised(p, i, side ? p->height_m[i] : lift_of(p, i));
            rays.way[lane] =
                side ? lw_vec3_sub(raised(p, j, p->height_m[j]), rays.from[lane]) : normal_at(p, i);
            lw_trace_set_ray(&rays.ray, lane, rays.from[lane], rays.way[lane],
                             side ? 1 : 2 * HEIGHT * p->size_m);
            rays.active |= (uint16_t)(1u << lane);
            if (++lane < LW_TRACE_WIDTH) continue;
            side ? note_cuts(p, &rays, side) : measure(p, &rays);
            lane = rays.active = 0;
        }
    if (lane) side ? note_cuts(p, &rays, side) : measure(p, &rays);
}

typedef void each_pair(struct part *p, uint32_t i, uint32_t j, bool cut);

/* Calls back for all neighbours. */
static void walk(struct part *p, each_pair *each) {
    for (uint32_t y = p->row; y < p->end_row; y++)
        for (uint32_t x = 0; x < p->mesh->width; x++)
            for (uint8_t side = CUT_RIGHT; side <= CUT_BELOW; side++) {
                const uint32_t i = lw_texels_index(p->mesh, x, y), j = y + (side == CUT_BELOW) < p->end_row
                                                                           ? next_to(p, x, y, side)
                                                                           : LW_TEXEL_NONE;
                if (j != LW_TEXEL_NONE) each(p, i, j, (p->flags[i] & side) != 0);
            }
}

static void join(struct part *p, uint32_t i, uint32_t j, bool cut) {
    if (!cut) return lw_union_find_join(p->parent, i, j);
    p->flags[i] |= CUT;
    p->flags[j] |= CUT;
}

static struct region *region_of(struct part *p, uint32_t i) {
    return &p->region[lw_union_find_root(p->parent, i)];
}

static void count_regions(struct part *p) {
    for (uint32_t i = p->first; i < p->end; i++) {
        if (!p->covered[i]) continue;
        struct region *region = region_of(p, i);
        region->texels++;
        region->beside += (p->flags[i] & CUT) != 0;
    }
}

static void note_edges(struct part *p, uint32_t i, uint32_t j, bool cut) {
    if (!cut || region_of(p, i)->texels < REGION || region_of(p, j)->texels < REGION) return;
    p->flags[i] |= NEAR | EDGE;
    p->flags[j] |= NEAR | EDGE;
}

static void note_near(struct part *p, uint32_t i, uint32_t j, bool cut) {
    if (cut) return;
    if (p->flags[i] & EDGE) p->flags[j] |= NEAR;
    if (p->flags[j] & EDGE) p->flags[i] |= NEAR;
}

static void look_around(struct part *p, uint32_t i) {
    struct sight *sight = &p->own[i];
    for (uint32_t k = 0; k < SKY_PACKETS; k++) {
        struct lw_ray16 rays = {.salt = 0};
        struct lw_hit16 hits;
        for (uint32_t r = 0; r < LW_TRACE_WIDTH; r++) {
            float point[2];
            lw_random_sobol2(k * LW_TRACE_WIDTH + r, 0, point);
            lw_trace_set_ray(&rays, r, raised(p, i, lift_of(p, i)),
                             lw_direction_about(normal_at(p, i), lw_direction_cosine(point)), INFINITY);
        }
        lw_trace_closest16(p->trace, 0, UINT16_MAX, &rays, &hits);
        for (uint32_t r = 0; r < LW_TRACE_WIDTH; r++) {
            const bool missed = hits.object[r] == LW_TRACE_MISS;
            sight->sky += missed;
            sight->far += missed || hits.t[r] > ROOM * p->size_m;
        }
        sight->all += LW_TRACE_WIDTH;
    }
    p->sight[i] = *sight;
}

static void add_sight(struct sight *sum, const struct sight *s) {
    sum->sky += s->sky;
    sum->far += s->far;
    sum->all += s->all;
}

static void share_sight(struct part *p, uint32_t i, uint32_t j, bool cut) {
    if (cut || !p->own[i].all || !p->own[j].all) return;
    add_sight(&p->sight[i], &p->own[j]);
    add_sight(&p->sight[j], &p->own[i]);
}

static float sky_of(const struct sight *s) { return s->all ? (float)s->sky / s->all : 0; }

static bool is_room(const struct sight *s) { return 4 * s->far >= s->all; }

/* Whether j has close above it what i has not, or lies out of doors behind the wall of i's room. */
static bool is_alien(const struct part *p, uint32_t i, uint32_t j, bool cut) {
    if (p->flags[i] & CLOSE) return false;
    if (p->flags[j] & CLOSE) return true;
    const float before = sky_of(&p->sight[i]), sky = sky_of(&p->sight[j]);
    return cut && is_room(&p->sight[i]) && sky >= SKY_OUTSIDE && sky >= before + SKY_MORE;
}

static void find_aliens(struct part *p, uint32_t i, uint32_t j, bool cut) {
    if (is_alien(p, i, j, cut)) p->flags[j] |= ALIEN;
    if (is_alien(p, j, i, cut)) p->flags[i] |= ALIEN;
}

/* Whether something parts two texels beside or above each other, or one of them is no part of the chart. */
static bool is_parted(const struct part *p, uint32_t x, uint32_t y, uint32_t u, uint32_t v) {
    const uint32_t i = lw_texels_index(p->mesh, x < u ? x : u, y < v ? y : v);
    const uint32_t a = lw_texels_index(p->mesh, x, y), b = lw_texels_index(p->mesh, u, v);
    return !p->covered[a] || !p->covered[b] || p->mesh->chart[a] != p->mesh->chart[b] ||
           p->flags[i] & (x != u ? CUT_RIGHT : CUT_BELOW);
}

/* At the corner of a room the texel beyond both of its walls touches one inside. */
static void find_corner_aliens(struct part *p) {
    for (uint32_t y = p->row; y + 1 < p->end_row; y++)
        for (uint32_t x = 0; x + 1 < p->mesh->width; x++)
            for (uint32_t k = 0; k < 2; k++) {
                const uint32_t u = x + k, w = x + 1 - k; /* from (u, y) to (w, y + 1) */
                const uint32_t i = lw_texels_index(p->mesh, u, y), j = lw_texels_index(p->mesh, w, y + 1);
                if (!p->covered[i] || !p->covered[j] || p->mesh->chart[i] != p->mesh->chart[j]) continue;
                const bool parted = (is_parted(p, u, y, w, y) || is_parted(p, w, y, w, y + 1)) &&
                                    (is_parted(p, u, y, u, y + 1) || is_parted(p, u, y + 1, w, y + 1));
                if (parted) find_aliens(p, i, j, true);
            }
}

static bool is_like(const struct part *p, uint32_t i, uint32_t j) {
    return p->flags[i] & BEHIND || (p->flags[i] & CLOSE && p->flags[j] & CLOSE);
}

static void find_deep(struct part *p, uint32_t i, uint32_t j, bool cut) {
    if (cut) return;
    if (p->flags[i] & (ALIEN | BEHIND) && is_like(p, i, j)) p->flags[j] |= DEEP;
    if (p->flags[j] & (ALIEN | BEHIND) && is_like(p, j, i)) p->flags[i] |= DEEP;
}

/* behind: the other's side of the cut. */
static void meet_one(struct region *region, const struct region *other, bool behind) {
    region->cuts++;
    region->to_behind += behind;
    if (!behind && other->texels > region->met) region->met = other->texels;
}

static void meet(struct part *p, uint32_t i, uint32_t j, bool cut) {
    if (!cut) return;
    struct region *a = region_of(p, i), *b = region_of(p, j);
    meet_one(a, b, p->flags[j] & BEHIND);
    meet_one(b, a, p->flags[i] & BEHIND);
}

/* Few of a strip's texels are not beside a cut: those at the ends, whose neighbour lies inside a pillar.
 * No texel yields to a surface behind: a ledge before a wall that is only modelled from outside has its own
 * light. */
static bool is_strip(const struct region *region) {
    return region->texels - region->beside <= region->texels / 4 && region->met >= REGION &&
           region->met >= 2 * region->texels && 2 * region->to_behind <= region->cuts;
}

static bool yields(struct part *p, uint32_t i) {
    return p->covered[i] && (p->flags[i] & (ALIEN | DEEP | BEHIND) || is_strip(region_of(p, i)));
}

/* before: which texels were covered; those that are not sought are again. */
static uint64_t choose(struct part *p, const uint8_t *before) {
    uint64_t yielding = 0;
    for (uint32_t y = p->row; y < p->end_row; y++)
        for (uint32_t x = 0; x < p->mesh->width; x++) {
            const uint32_t i = lw_texels_index(p->mesh, x, y);
            if (!is_sought(p, x, y)) {
                p->covered[i] = before[i];
            } else if (yields(p, i)) {
                p->covered[i] = 0;
                yielding++;
            }
        }
    return yielding;
}

/* ---- what stands for texels that yield ---- */

/* The eight texels around one, in a circle. */
#define RING 8
static const int ring_x[RING] = {1, 1, 0, -1, -1, -1, 0, 1}, ring_y[RING] = {0, 1, 1, 1, 0, -1, -1, -1};

/* A run of covered texels around an uncovered one that nothing parts. */
struct run {
    struct sight sight;
    uint32_t nearest; /* its nearest texel */
    float square;     /* square of the nearest texel's distance, object space */
};

/* Whether the texel at place k of the circle about (x, y) is covered, and of the same chart. */
static bool has_ring_texel(const struct part *p, uint32_t x, uint32_t y, uint32_t k) {
    const int64_t u = (int64_t)x + ring_x[k], v = (int64_t)y + ring_y[k];
    if (u < 0 || v < 0 || u >= p->mesh->width || v >= p->mesh->height) return false;
    const uint32_t j = lw_texels_index(p->mesh, (uint32_t)u, (uint32_t)v);
    return p->covered[j] && p->mesh->chart[j] == p->mesh->chart[lw_texels_index(p->mesh, x, y)];
}

static uint32_t ring_texel(const struct part *p, uint32_t x, uint32_t y, uint32_t k) {
    return lw_texels_index(p->mesh, x + (uint32_t)ring_x[k], y + (uint32_t)ring_y[k]);
}

/* Whether the texel at place k goes on a run from the one before it. */
static bool goes_on(const struct part *p, uint32_t x, uint32_t y, const bool there[RING], uint32_t k) {
    const uint32_t before = (k + RING - 1) % RING;
    return there[k] && there[before] &&
           !is_parted(p, x + (uint32_t)ring_x[before], y + (uint32_t)ring_y[before], x + (uint32_t)ring_x[k],
                      y + (uint32_t)ring_y[k]);
}

static void add_to_run(const struct part *p, struct run *run, uint32_t texel, struct lw_vec3 middle) {
    const struct lw_vec3 way = lw_vec3_sub(p->place[texel], middle);
    const float square = lw_vec3_dot(way, way);
    if (square < run->square) run->square = square, run->nearest = texel;
}

/* Lists the runs about (x, y); returns how many there are. Sights are of two or more. */
static uint32_t list_runs(struct part *p, uint32_t x, uint32_t y, struct run out[RING]) {
    const struct lw_vec3 middle = lw_texels_vector(p->mesh->position, lw_texels_index(p->mesh, x, y));
    bool there[RING];
    uint32_t of[RING], count = 0, first = 0;
    for (uint32_t k = 0; k < RING; k++) there[k] = has_ring_texel(p, x, y, k);
    while (first < RING && (!there[first] || goes_on(p, x, y, there, first))) first++;
    if (first == RING) return 0;
    for (uint32_t i = 0; i < RING; i++) {
        const uint32_t k = (first + i) % RING;
        if (!there[k]) continue;
        if (!goes_on(p, x, y, there, k))
            out[count++] = (struct run){.nearest = LW_TEXEL_NONE, .square = INFINITY};
        of[k] = count - 1;
        add_to_run(p, &out[of[k]], ring_texel(p, x, y, k), middle);
    }
    for (uint32_t k = 0; k < RING && count > 1; k++) {
        if (!there[k]) continue;
        const uint32_t texel = ring_texel(p, x, y, k);
        if (!p->own[texel].all) look_around(p, texel);
        add_sight(&out[of[k]].sight, &p->own[texel]);
    }
    return count;
}

/* The one of two runs in whose place a texel between them is shown: the room's, where its rival is out of
 * doors; else the nearer one. */
static const struct run *better_of(const struct run *a, const struct run *b) {
    const float sky_a = sky_of(&a->sight), sky_b = sky_of(&b->sight);
    const struct run *dark = sky_a < sky_b ? a : b;
    if (is_room(&dark->sight) && fmaxf(sky_a, sky_b) >= SKY_OUTSIDE && fabsf(sky_a - sky_b) >= SKY_MORE)
        return dark;
    return a->square <= b->square ? a : b;
}

/* Texels between several sides: which of them each shows. */
static void choose_sources(struct part *p, uint32_t first, uint32_t *source) {
    for (uint32_t y = p->row; y < p->end_row; y++)
        for (uint32_t x = 0; x < p->mesh->width; x++) {
            const uint32_t i = lw_texels_index(p->mesh, x, y);
            struct run run[RING];
            if (!p->mesh->covered[i] || p->covered[i] || !is_sought(p, x, y)) continue;
            const uint32_t count = list_runs(p, x, y, run);
            const struct run *best = run;
            for (uint32_t k = 1; k < count; k++) best = better_of(best, &run[k]);
            if (count) source[i] = first + best->nearest;
        }
}

/* Whether something cuts a texel off a neighbour, or one beside it: that may cut off its corner. */
static bool has_cut_near(const struct part *p, uint32_t x, uint32_t y) {
    for (uint32_t v = y ? y - 1 : 0; v <= y + 1 && v < p->mesh->height; v++)
        for (uint32_t u = x ? x - 1 : 0; u <= x + 1 && u < p->mesh->width; u++)
            if (p->flags[lw_texels_index(p->mesh, u, v)] & CUT) return true;
    return false;
}

/* Tells the walls to all that share light between texels. */
static void note_walls(struct part *p, uint8_t *walls) {
    for (uint32_t y = p->row; y < p->end_row; y++)
        for (uint32_t x = 0; x < p->mesh->width; x++) {
            const uint32_t i = lw_texels_index(p->mesh, x, y);
            if (!is_sought(p, x, y)) continue;
            walls[i] = (uint8_t)((p->flags[i] & (CUT_RIGHT | CUT_BELOW)) |
                                 (p->mesh->covered[i] && !p->usable[i] ? LW_TEXELS_WALL_ON : 0));
            if (walls[i] & LW_TEXELS_WALL_ON || has_cut_near(p, x, y)) walls[i] |= LW_TEXELS_WALL_NEAR;
        }
}

/* Numbers the sides: wherever a wall comes or goes, texels far from it may be joined or parted. */
static void note_sides(struct part *p, const uint8_t *walls, uint32_t *side) {
    for (uint32_t i = 0; i < p->mesh->texel_count; i++) p->parent[i] = i;
    for (uint32_t y = 0; y < p->mesh->height; y++)
        for (uint32_t x = 0; x < p->mesh->width; x++)
            for (uint8_t way = CUT_RIGHT; way <= CUT_BELOW; way++) {
                const uint32_t i = lw_texels_index(p->mesh, x, y), j = next_to(p, x, y, way);
                if (j != LW_TEXEL_NONE && !(walls[i] & way)) lw_union_find_join(p->parent, i, j);
            }
    for (uint32_t i = 0; i < p->mesh->texel_count; i++) side[i] = lw_union_find_root(p->parent, i);
}

static enum lw_status allocate(struct part *p) {
    const size_t count = p->mesh->texel_count + 1ul;
    p->place = malloc(count * sizeof *p->place);
    p->height_m = malloc(count * sizeof *p->height_m);
    p->flags = calloc(count, sizeof *p->flags);
    p->own = calloc(count, sizeof *p->own);
    p->sight = calloc(count, sizeof *p->sight);
    p->parent = malloc(count * sizeof *p->parent);
    p->region = calloc(count, sizeof *p->region);
    return p->place && p->height_m && p->flags && p->own && p->sight && p->parent && p->region ? LW_OK
                                                                                               : LW_NO_MEMORY;
}

static void release(struct part *p) {
    free(p->place);
    free(p->height_m);
    free(p->flags);
    free(p->own);
    free(p->sight);
    free(p->parent);
    free(p->region);
}

/* The rows of tiles with blocks that are sought, and one before and behind: what their sides go on to. */
static void set_rows(struct part *p) {
    const uint32_t tiles_y = lw_texels_tiles_along(p->mesh->height);
    uint32_t row = 0, end = tiles_y;
    p->blocks_x = lw_texels_blocks_along(p->mesh->width);
    if (p->sought) {
        row = tiles_y, end = 0;
        for (uint32_t b = 0; b < p->blocks_x * lw_texels_blocks_along(p->mesh->height); b++) {
            if (!p->sought[b]) continue;
            const uint32_t tile = b / p->blocks_x * LW_TILE_BLOCK / LW_TILE_SIDE;
            if (tile < row) row = tile;
            end = tile + 1;
        }
        row -= row > 0 && row < end;
        end += end < tiles_y && end > 0;
    }
    p->row = row * LW_TILE_SIDE;
    p->end_row = end < tiles_y ? end * LW_TILE_SIDE : p->mesh->height;
    p->first = row < tiles_y ? lw_texels_tile_start(p->mesh, 0, row) : p->mesh->texel_count;
    p->end = end < tiles_y ? lw_texels_tile_start(p->mesh, 0, end) : p->mesh->texel_count;
}

/* Sets the places of the texels, and the state of texels that are not sought. */
static void begin(struct part *p, const struct lw_texels *texels, uint32_t object, uint8_t *out_before) {
    const uint8_t *walls = texels->walls + texels->first[object];
    for (uint32_t i = p->first; i < p->end; i++) {
        out_before[i] = p->covered[i];
        p->covered[i] = p->usable[i] != 0;
        p->parent[i] = i;
        p->height_m[i] = HEIGHT * p->size_m;
        if (p->covered[i]) p->place[i] = lw_texels_place(texels, object, i);
        if (p->sought) p->flags[i] = walls[i] & (CUT_RIGHT | CUT_BELOW);
    }
    for (uint32_t y = p->row; y < p->end_row && p->sought; y++)
        for (uint32_t x = 0; x < p->mesh->width; x++)
            if (is_by_sought(p, x, y, AROUND)) p->flags[lw_texels_index(p->mesh, x, y)] = 0;
}

static void look_around_near(struct part *p) {
    for (uint32_t y = p->row; y < p->end_row; y++)
        for (uint32_t x = 0; x < p->mesh->width; x++) {
            const uint32_t i = lw_texels_index(p->mesh, x, y);
            if (p->covered[i] && p->flags[i] & NEAR && is_by_sought(p, x, y, AROUND)) look_around(p, i);
        }
}

static void link_blocks(const struct part *p, struct lw_texels *texels, uint32_t object) {
    for (uint32_t y = p->row; y < p->end_row; y += LW_TILE_BLOCK)
        for (uint32_t x = 0; x < p->mesh->width; x += LW_TILE_BLOCK)
            if (is_sought(p, x, y)) lw_texels_link_block(texels, object, x, y);
}

enum lw_status lw_crossings_find(struct lw_texels *texels, const struct lw_pose *pose,
                                 const struct lw_trace *trace, uint32_t object, const bool *blocks,
                                 uint64_t *out_count) {
    struct part p = {.mesh = &texels->mesh[texels->scene->object[object].mesh],
                     .scene = texels->scene,
                     .stands = texels->stands,
                     .trace = trace,
                     .to_world = pose->object_to_world[object],
                     .covered = texels->covered + texels->first[object],
                     .usable = texels->usable + texels->first[object],
                     .sought = blocks};
    uint8_t *before = malloc(p.mesh->texel_count + 1ul);
    lw_sample_points_frame_init(&p.frame, &p.to_world);
    p.size_m = p.mesh->texel_m * p.frame.stretch;
    set_rows(&p);
    enum lw_status status = allocate(&p);
    if (!before) status = LW_NO_MEMORY;
    if (status == LW_OK) {
        begin(&p, texels, object, before);
        shoot(&p, 0);
        shoot(&p, CUT_RIGHT);
        shoot(&p, CUT_BELOW);
        walk(&p, join);
        count_regions(&p);
        walk(&p, note_edges);
        walk(&p, note_near);
        look_around_near(&p);
        walk(&p, share_sight);
        walk(&p, find_aliens);
        find_corner_aliens(&p);
        walk(&p, find_deep);
        walk(&p, meet);
        *out_count += choose(&p, before);
        note_walls(&p, texels->walls + texels->first[object]);
        note_sides(&p, texels->walls + texels->first[object], texels->side + texels->first[object]);
        link_blocks(&p, texels, object);
        choose_sources(&p, texels->first[object], texels->source + texels->first[object]);
    }
    free(before);
    release(&p);
    return status;
}
