#include "server/solve/filter/seams.h"

#include "common/base/invariant.h"
#include "common/base/union_find.h"
#include "common/lightmap/lightmap_bevel.h"
#include "common/tile/bilinear.h"

#include <stdlib.h>
#include <string.h>

/* Points per texel of a seam's length, in the atlas where it is longer. */
#define POINTS_PER_TEXEL 3.0f
#define POINTS_MAX       4096.0f /* on one edge */
/* How readily a gutter's texel moves, against a covered one's: nobody sees it but through
 * the look-ups that are welded. */
#define GUTTER_EASE 4.0f
/* 16 frames: 12 leave 6.2 % of the atrium's points over 1 %, 13 5.4 %, 20 3 %; but more of them level light:
 * 20 take 1 % of the balustrade's. */
#define ITERATIONS 13
#define DONE       1e-10 /* over the light's square: below, steps only add up rounding */
/* The share of a correction that the next frame goes on from. The rest comes back where the rows need it;
 * where they can only be had by levelling light along a seam or over a chain of slivers, the light wins back
 * a part. Kept in full, 40 frames of builtin:atrium bring 96 % of points within 1 %, but its upper columns
 * fall from 0.959 of the path tracer's to 0.933; so, 92 % and 0.940. */
#define KEPT 0.9f
/* The shown light of a covered texel is at least this share of its own light, and gutters are not negative.
 * The correction itself is free: bounds within the iteration kept 20 % of the points apart. */
#define LEAST 0.1f
/* Rows that a bound has pulled apart are brought together again, as far as may be, in this many rounds. 16
 * frames of Sponza, 12 iterations: 6 leave the sides of a seam 0.50 % apart in the mean, 32 0.36 %. */
#define SETTLE 8
/* The mean of a component is restored by up to this factor; what needs more stays unwelded. */
#define KEEP_MOST 1.5
#define GUESSES   8u /* texels that a gutter is extrapolated from */

/* What two look-ups differ by, brought to length 1 in units in which all members move with the same ease. */
struct lw_seams_row {
    uint32_t member[8];
    float weight[8];
};
struct lw_seams_member {
    uint32_t texel;  /* in the global numbering */
    float root_ease; /* square root of how readily it moves */
};
/* A gutter's value before it is welded: the sum of weight x light of covered members. */
struct lw_seams_guess {
    uint32_t count; /* 0: covered, it has a value of its own */
    uint32_t member[GUESSES];
    float weight[GUESSES];
};

/* While the seams are set up. */
struct builder {
    const struct lw_scene *scene;
    const struct lw_texels *texels;
    const struct lw_tiles *tiles;
    uint32_t *member_of; /* per texel of the global numbering; LW_TEXEL_NONE: none yet */
    uint32_t *parent;    /* per member: union-find */
    uint32_t member_capacity, row_capacity;
    struct lw_seams *seams;
    bool failed;
};

static const struct lw_mesh_texels *mesh_of(const struct builder *b, uint32_t object) {
    return &b->texels->mesh[b->scene->object[object].mesh];
}

static bool is_covered(const struct builder *b, uint32_t object, int64_t x, int64_t y) {
    const struct lw_mesh_texels *mesh = mesh_of(b, object);
    if (x < 0 || y < 0 || x >= mesh->width || y >= mesh->height) return false;
    return b->texels->covered[b->texels->first[object] + lw_texels_index(mesh, (uint32_t)x, (uint32_t)y)];
}

static bool grow_members(struct builder *b) {
    struct lw_seams *s = b->seams;
    if (s->member_count < b->member_capacity) return true;
    const size_t capacity = b->member_capacity ? 2 * (size_t)b->member_capacity : 1024;
    struct lw_seams_member *member = realloc(s->member, capacity * sizeof *member);
    if (member) s->member = member;
    struct lw_seams_guess *guess = realloc(s->guess, capacity * sizeof *guess);
    if (guess) s->guess = guess;
    uint32_t *parent = realloc(b->parent, capacity * sizeof *parent);
    if (parent) b->parent = parent;
    if (!member || !guess || !parent) return false;
    b->member_capacity = (uint32_t)capacity;
    return true;
}

/* The member that stands for a texel; LW_TEXEL_NONE when out of memory. */
static uint32_t member_at(struct builder *b, uint32_t object, uint32_t x, uint32_t y) {
    const uint32_t texel = b->texels->first[object] + lw_texels_index(mesh_of(b, object), x, y);
    if (b->member_of[texel] != LW_TEXEL_NONE) return b->member_of[texel];
    if (!grow_members(b)) {
        b->failed = true;
        return LW_TEXEL_NONE;
    }
    const uint32_t m = b->seams->member_count++;
    const bool covered = b->texels->covered[texel];
    b->seams->member[m] =
        (struct lw_seams_member){.texel = texel, .root_ease = covered ? 1 : sqrtf(GUTTER_EASE)};
    b->seams->guess[m].count = 0;
    b->parent[m] = m;
    b->member_of[texel] = m;
    return m;
}

/* Where a gutter's light is guessed from. */
struct source {
    uint32_t x, y;
    float weight;
};

/* The covered texels that stand for a gutter: the ones that touch it, or else the
 * farther ones; the nearer the more. */
static uint32_t find_sources(const struct builder *b, uint32_t object, uint32_t x, uint32_t y,
                             struct source out[GUESSES]) {
    struct lw_texels_neighbour near[LW_TEXELS_NEIGHBOURS_MAX];
    const uint32_t found =
        lw_texels_neighbours(mesh_of(b, object), b->texels->covered + b->texels->first[object], x, y, near);
    uint32_t count = 0, nearest = 2;
    float sum = 0;
    for (uint32_t i = 0; i < found; i++) nearest = near[i].reach < nearest ? near[i].reach : nearest;
    for (uint32_t i = 0; i < found && count < GUESSES; i++) {
        if (near[i].reach != nearest) continue;
        out[count] = (struct source){near[i].x, near[i].y, 1 / (float)near[i].distance2};
        sum += out[count++].weight;
    }
    for (uint32_t i = 0; i < count; i++) out[i].weight /= sum;
    return count;
}

/* The texels that a bilinear look-up reads. */
struct look_up {
    uint32_t x[4], y[4];
    float weight[4];
};

/* False if a texel that matters has no light and none to guess it from: inside
 * something, or no texel at all. */
static bool look_up_at(const struct builder *b, uint32_t object, struct lw_vec2 at, struct look_up *out) {
    const struct lw_mesh_texels *mesh = mesh_of(b, object);
    const struct lw_bilinear x = lw_bilinear_at(at.x, mesh->width), y = lw_bilinear_at(at.y, mesh->height);
    for (int i = 0; i < 4; i++) {
        out->x[i] = i & 1 ? x.high : x.low, out->y[i] = i >> 1 ? y.high : y.low;
        out->weight[i] = (i & 1 ? x.share : 1 - x.share) * (i >> 1 ? y.share : 1 - y.share);
        struct source source[GUESSES];
        if (out->weight[i] > 0 && !is_covered(b, object, out->x[i], out->y[i]) &&
            !find_sources(b, object, out->x[i], out->y[i], source))
            return false;
    }
    return true;
}

static bool grow_rows(struct builder *b) {
    struct lw_seams *s = b->seams;
    if (s->row_count < b->row_capacity) return true;
    const size_t capacity = b->row_capacity ? 2 * (size_t)b->row_capacity : 1024;
    struct lw_seams_row *row = realloc(s->row, capacity * sizeof *row);
    if (!row) return false;
    s->row = row;
    b->row_capacity = (uint32_t)capacity;
    return true;
}

/* The member of a texel that a row reads; a gutter's brings those that it is guessed from. */
static uint32_t row_member(struct builder *b, uint32_t object, uint32_t x, uint32_t y) {
    const uint32_t m = member_at(b, object, x, y);
    if (m == LW_TEXEL_NONE || is_covered(b, object, x, y) || b->seams->guess[m].count) return m;
    struct source source[GUESSES];
    const uint32_t count = find_sources(b, object, x, y, source);
    for (uint32_t i = 0; i < count; i++) {
        const uint32_t from = member_at(b, object, source[i].x, source[i].y);
        if (from == LW_TEXEL_NONE) return from;
        b->seams->guess[m].member[i] = from;
        b->seams->guess[m].weight[i] = source[i].weight;
        lw_union_find_join(b->parent, m, from);
    }
    b->seams->guess[m].count = count;
    return m;
}

static void add_row(struct builder *b, const struct lw_seam_edge *edge, const struct look_up look_up[2]) {
    if (b->seams->row_count == LW_SEAMS_ROWS_MAX) {
        b->seams->rows_left_out++;
        return;
    }
    if (!grow_rows(b)) {
        b->failed = true;
        return;
    }
    struct lw_seams_row row;
    for (int i = 0; i < 8; i++) {
        const struct look_up *l = &look_up[i / 4];
        const float weight = l->weight[i % 4];
        /* a texel that is not read repeats the first read one, at no weight */
        row.weight[i] = i < 4 ? weight : -weight;
        row.member[i] =
            weight > 0 ? row_member(b, edge->object[i / 4], l->x[i % 4], l->y[i % 4]) : LW_TEXEL_NONE;
    }
    uint32_t first = LW_TEXEL_NONE;
    for (int i = 0; i < 8 && first == LW_TEXEL_NONE; i++) first = row.member[i];
    if (b->failed) return;
    float length2 = 0;
    for (int i = 0; i < 8; i++) {
        if (row.member[i] == LW_TEXEL_NONE) row.member[i] = first;
        lw_union_find_join(b->parent, first, row.member[i]);
        row.weight[i] *= b->seams->member[row.member[i]].root_ease;
        length2 += row.weight[i] * row.weight[i];
    }
    for (int i = 0; i < 8; i++) row.weight[i] /= sqrtf(length2);
    b->seams->row[b->seams->row_count++] = row;
}

static void add_edge(struct builder *b, const struct lw_seam_edge *edge) {
    float length = 0;
    for (int s = 0; s < 2; s++)
        length = fmaxf(length, hypotf(edge->to[s].x - edge->from[s].x, edge->to[s].y - edge->from[s].y));
    const int points = (int)fminf(ceilf(length * POINTS_PER_TEXEL), POINTS_MAX) + 1;
    for (int i = 0; i < points && !b->failed; i++) {
        const float t = points > 1 ? (float)i / (float)(points - 1) : 0.5f;
        struct look_up look_up[2];
        bool found = true;
        for (int s = 0; s < 2 && found; s++) {
            struct lw_vec2 at = {edge->from[s].x + t * (edge->to[s].x - edge->from[s].x),
                                 edge->from[s].y + t * (edge->to[s].y - edge->from[s].y)};
            found = look_up_at(b, edge->object[s], at, &look_up[s]);
        }
        if (found) add_row(b, edge, look_up);
    }
}

/* Puts members and rows in the order of their components. */
static bool sort_by_component(struct builder *b) {
    struct lw_seams *s = b->seams;
    uint32_t *component = malloc(((size_t)s->member_count + 1) * sizeof *component),
             *moved = malloc(((size_t)s->member_count + 1) * sizeof *moved);
    struct lw_seams_row *row = malloc(((size_t)s->row_count + 1) * sizeof *row);
    struct lw_seams_member *member = malloc(((size_t)s->member_count + 1) * sizeof *member);
    struct lw_seams_guess *guess = malloc(((size_t)s->member_count + 1) * sizeof *guess);
    bool ok = component && moved && row && member && guess;
    for (uint32_t m = 0; ok && m < s->member_count; m++) {
        const uint32_t r = lw_union_find_root(b->parent, m); /* never above m: its component has its number */
        component[m] = r == m ? s->component_count++ : component[r];
    }
    ok = ok && (s->first_row = calloc((size_t)s->component_count + 2, sizeof *s->first_row)) &&
         (s->first_member = calloc((size_t)s->component_count + 2, sizeof *s->first_member));
    if (ok) {
        /* counting sort; while it runs, first_x[c + 1] is where component c's next goes */
        for (uint32_t m = 0; m < s->member_count; m++)
            if (component[m] + 2 <= s->component_count) s->first_member[component[m] + 2]++;
        for (uint32_t r = 0; r < s->row_count; r++)
            if (component[s->row[r].member[0]] + 2 <= s->component_count)
                s->first_row[component[s->row[r].member[0]] + 2]++;
        for (uint32_t c = 2; c <= s->component_count; c++) {
            s->first_member[c] += s->first_member[c - 1];
            s->first_row[c] += s->first_row[c - 1];
        }
        for (uint32_t m = 0; m < s->member_count; m++) moved[m] = s->first_member[component[m] + 1]++;
        for (uint32_t m = 0; m < s->member_count; m++) {
            member[moved[m]] = s->member[m];
            guess[moved[m]] = s->guess[m];
            for (uint32_t i = 0; i < s->guess[m].count; i++)
                guess[moved[m]].member[i] = moved[s->guess[m].member[i]];
        }
        for (uint32_t r = 0; r < s->row_count; r++) {
            struct lw_seams_row *to = &row[s->first_row[component[s->row[r].member[0]] + 1]++];
            *to = s->row[r];
            for (int i = 0; i < 8; i++) to->member[i] = moved[to->member[i]];
        }
        free(s->row);
        free(s->member);
        free(s->guess);
        s->row = row, s->member = member, s->guess = guess;
        row = NULL, member = NULL, guess = NULL;
    }
    free(component);
    free(moved);
    free(row);
    free(member);
    free(guess);
    return ok;
}

/* Lists the blocks of each component, each once. */
static bool list_blocks(struct builder *b) {
    struct lw_seams *s = b->seams;
    uint32_t *last = malloc(((size_t)b->tiles->block_count + 1) * sizeof *last); /* component to list it */
    s->block = malloc(((size_t)s->member_count + 1) * sizeof *s->block);
    s->first_block = malloc(((size_t)s->component_count + 1) * sizeof *s->first_block);
    const bool ok = last && s->block && s->first_block;
    if (ok) {
        memset(last, 0xff, b->tiles->block_count * sizeof *last);
        for (uint32_t c = 0; c < s->component_count; c++) {
            s->first_block[c] = s->block_count;
            for (uint32_t m = s->first_member[c]; m < s->first_member[c + 1]; m++) {
                const uint32_t block = b->tiles->block_of_texel[s->member[m].texel];
                if (last[block] != c) s->block[s->block_count++] = block;
                last[block] = c;
            }
        }
        s->first_block[s->component_count] = s->block_count;
        uint32_t *fits = realloc(s->block, ((size_t)s->block_count + 1) * sizeof *fits);
        if (fits) s->block = fits;
    }
    free(last);
    return ok;
}

/* From a seam's middle some texels into the chart of one side, in lightmap texels of the object. */
static struct lw_vec2 place_inside(const struct builder *b, const struct lw_seam_edge *edge, int s,
                                   float texels) {
    const struct lw_mesh *mesh = &b->scene->mesh[b->scene->object[edge->object[s]].mesh];
    const struct lw_vec2 from = edge->from[s], to = edge->to[s],
                         middle = {0.5f * (from.x + to.x), 0.5f * (from.y + to.y)};
    struct lw_vec2 way = {-middle.x, -middle.y};
    if (mesh->back_offset && middle.y >= (float)mesh->back_offset) way.y += (float)mesh->back_offset;
    for (int k = 0; k < 3; k++) {
        const struct lw_vec2 corner = mesh->lightmap_uv[mesh->triangle[edge->triangle[s]][k]];
        way.x += corner.x / 3;
        way.y += corner.y / 3;
    }
    const float x = from.y - to.y, y = to.x - from.x, length = sqrtf(x * x + y * y);
    const float side = x * way.x + y * way.y > 0 ? texels / length : -texels / length;
    if (!(length > 0)) return middle;
    return (struct lw_vec2){middle.x + side * x, middle.y + side * y};
}

/* Which way the surface looks there, in object space; false: no texel there has a surface. */
static bool normal_inside(const struct builder *b, const struct lw_seam_edge *edge, int s, float texels,
                          struct lw_vec3 *out) {
    const struct lw_vec2 at = place_inside(b, edge, s, texels);
    const int64_t x = (int64_t)floorf(at.x), y = (int64_t)floorf(at.y);
    const struct lw_mesh_texels *mesh = mesh_of(b, edge->object[s]);
    if (!is_covered(b, edge->object[s], x, y)) return false;
    *out = lw_packed_normal_unpack(mesh->normal[lw_texels_index(mesh, (uint32_t)x, (uint32_t)y)]);
    return true;
}

/* Which way the flat wall looks that one side of a seam borders on, but for a bevel; false: it is none. */
static bool wall_inside(const struct builder *b, const struct lw_seam_edge *edge, int s,
                        struct lw_vec3 *out) {
    struct lw_vec3 farther;
    return normal_inside(b, edge, s, 1, out) && normal_inside(b, edge, s, 2, &farther) &&
           lw_vec3_dot(*out, farther) > LW_SEAM_EDGES_COSINE;
}

/* A seam along a bevel that is narrower than a texel (lightmap_bevel.h): the shading goes on across it, but
 * texels on either side are of walls that look another way. */
static bool is_corner(const struct builder *b, const struct lw_seam_edge *edge) {
    struct lw_vec3 wall[2];
    return edge->object[0] == edge->object[1] && wall_inside(b, edge, 0, &wall[0]) &&
           wall_inside(b, edge, 1, &wall[1]) && lw_vec3_dot(wall[0], wall[1]) < LW_LIGHTMAP_CORNER_COS;
}

/* Without those along corners. out: to be free()d */
static bool list_edges(const struct builder *b, const struct lw_seam_edges *all, struct lw_seam_edges *out) {
    *out = (struct lw_seam_edges){.edge = malloc((all->count + 1) * sizeof *out->edge),
                                  .capacity = all->count + 1};
    for (size_t e = 0; out->edge && e < all->count; e++)
        if (!is_corner(b, &all->edge[e])) out->edge[out->count++] = all->edge[e];
    return out->edge != NULL;
}

static bool build(struct builder *b, const struct lw_seam_edges *edges) {
    struct lw_seams *s = b->seams;
    b->member_of = malloc(((size_t)b->texels->count + 1) * sizeof *b->member_of);
    if (!b->member_of) return false;
    for (uint32_t t = 0; t < b->texels->count; t++) b->member_of[t] = LW_TEXEL_NONE;
    for (size_t e = 0; e < edges->count && !b->failed; e++) add_edge(b, &edges->edge[e]);
    if (b->failed || !sort_by_component(b) || !list_blocks(b)) return false;
    uint8_t *welded = calloc((size_t)b->texels->count + 1, 1); /* gutters that are members */
    if (!welded) return false;
    for (uint32_t m = 0; m < s->member_count; m++)
        welded[s->member[m].texel] = !b->texels->covered[s->member[m].texel];
    const enum lw_status status =
        lw_seam_gutters_find(b->scene, b->texels, b->tiles, edges, welded, &s->gutters);
    free(welded);
    return status == LW_OK;
}

enum lw_status lw_seams_init(struct lw_seams *seams, const struct lw_scene *scene,
                             const struct lw_seam_edges *edges, const struct lw_texels *texels,
                             const struct lw_tiles *tiles) {
    *seams = (struct lw_seams){0};
    struct builder b = {.scene = scene, .texels = texels, .tiles = tiles, .seams = seams};
    struct lw_seam_edges smooth;
    const bool ok = list_edges(&b, edges, &smooth) && build(&b, &smooth);
    free(smooth.edge);
    free(b.member_of);
    free(b.parent);
    if (ok) return LW_OK;
    lw_seams_finish(seams);
    return LW_NO_MEMORY;
}

void lw_seams_finish(struct lw_seams *seams) {
    free(seams->row);
    free(seams->member);
    free(seams->guess);
    free(seams->block);
    free(seams->first_row);
    free(seams->first_member);
    free(seams->first_block);
    lw_seam_gutters_finish(&seams->gutters);
    *seams = (struct lw_seams){0};
}

size_t lw_seams_memory_bytes(const struct lw_seams *s) {
    return s->row_count * sizeof *s->row + s->block_count * sizeof *s->block +
           s->member_count * (sizeof *s->member + sizeof *s->guess) +
           s->component_count * (sizeof *s->first_row + sizeof *s->first_member + sizeof *s->first_block) +
           lw_seam_gutters_memory_bytes(&s->gutters);
}

/* ---- the channels of one solve ---- */

static void finish_light(struct lw_seams_light *light) {
    free(light->active);
    free(light->light);
    free(light->welded);
    free(light->correction);
    for (int i = 0; i < 3; i++) free(light->scratch[i]);
    *light = (struct lw_seams_light){0};
}

static bool init_light(struct lw_seams_light *light, const struct lw_seams *seams, uint32_t channel) {
    const size_t members = (size_t)seams->member_count + 1;
    *light = (struct lw_seams_light){.channel = channel,
                                     .planes = lw_tile_channel_at(channel)->planes,
                                     .member_count = seams->member_count,
                                     .component_count = seams->component_count,
                                     .fresh = true};
    light->active = calloc((size_t)seams->component_count + 1, 1);
    light->light = calloc(members, sizeof *light->light);
    light->welded = calloc(members, sizeof *light->welded);
    light->correction = calloc(members, light->planes * sizeof *light->correction);
    bool ok = light->active && light->light && light->welded && light->correction;
    for (int i = 0; i < 3; i++)
        ok &= (light->scratch[i] = calloc(members, sizeof *light->scratch[i])) != NULL;
    return ok;
}

enum lw_status lw_seams_welds_init(struct lw_seams_welds *welds, const struct lw_seams *seams,
                                   uint32_t channels) {
    bool ok = true;
    lw_seams_welds_finish(welds);
    LW_TILE_CHANNELS_EACH (channel, channels) ok = ok && init_light(&welds->of[channel], seams, channel);
    if (ok) return LW_OK;
    lw_seams_welds_finish(welds);
    return LW_NO_MEMORY;
}

void lw_seams_welds_finish(struct lw_seams_welds *welds) {
    for (uint32_t i = 0; i < LW_TILE_CHANNELS_MAX; i++) finish_light(&welds->of[i]);
}

static size_t correction_bytes(const struct lw_seams_light *light) {
    return (size_t)light->member_count * light->planes * sizeof *light->correction;
}

size_t lw_seams_welds_memory_bytes(const struct lw_seams_welds *welds) {
    size_t bytes = 0;
    for (const struct lw_seams_light *light = welds->of; light < welds->of + LW_TILE_CHANNELS_MAX; light++)
        bytes += light->member_count *
                     (sizeof *light->light + sizeof *light->welded + 3 * sizeof *light->scratch[0]) +
                 correction_bytes(light) + light->component_count * sizeof *light->active;
    return bytes;
}

uint32_t lw_seams_welds_list_parts(const struct lw_seams_welds *welds,
                                   struct lw_checkpoint_part out_part[LW_TILE_CHANNELS_MAX]) {
    uint32_t n = 0;
    for (const struct lw_seams_light *light = welds->of; light < welds->of + LW_TILE_CHANNELS_MAX; light++)
        if (light->member_count)
            out_part[n++] = (struct lw_checkpoint_part){light->correction, correction_bytes(light)};
    return n;
}

void lw_seams_welds_resume(struct lw_seams_welds *welds) {
    for (uint32_t i = 0; i < LW_TILE_CHANNELS_MAX; i++) welds->of[i].fresh = true;
}

void lw_seams_welds_forget(struct lw_seams_welds *welds) {
    for (struct lw_seams_light *light = welds->of; light < welds->of + LW_TILE_CHANNELS_MAX; light++)
        if (light->member_count) memset(light->correction, 0, correction_bytes(light));
}

/* ---- each frame ---- */

/* What a worker welds: a component. */
struct job {
    const struct lw_seams *seams;
    struct lw_seams_light *light;
    struct lw_tiles *tiles;
    uint64_t frame;
    uint32_t first, last;         /* its members */
    uint32_t first_row, last_row; /* its rows */
};

static bool is_shown(const struct lw_seams *s, const struct lw_tiles *tiles, uint64_t frame,
                     uint32_t component) {
    for (uint32_t b = s->first_block[component]; b < s->first_block[component + 1]; b++)
        if (tiles->block[s->block[b]].shown_frame == frame) return true;
    return false;
}

/* Takes the light of what the frame shows; a block that it does not keeps what
 * it had, before it was welded. */
static void load(const struct job *job) {
    const struct lw_tiles *tiles = job->tiles;
    for (uint32_t m = job->first; m < job->last; m++) {
        const uint32_t texel = job->seams->member[m].texel;
        const bool shown = tiles->block[tiles->block_of_texel[texel]].shown_frame == job->frame;
        if (job->seams->guess[m].count || !(shown || job->light->fresh)) continue;
        for (uint32_t p = 0; p < job->light->planes; p++)
            job->light->light[m][p] = shown ? tiles->shown[job->light->channel][p][texel]
                                            : lw_tiles_sum(tiles, job->light->channel, p, texel);
    }
}

/* Gutters start as what their neighbours are. */
static void guess_gutters(const struct job *job) {
    float(*light)[4] = job->light->light;
    for (uint32_t m = job->first; m < job->last; m++) {
        const struct lw_seams_guess *guess = &job->seams->guess[m];
        for (uint32_t p = 0; p < job->light->planes && guess->count; p++) {
            float sum = 0;
            for (uint32_t i = 0; i < guess->count; i++) sum += guess->weight[i] * light[guess->member[i]][p];
            light[m][p] = sum;
        }
    }
}

/* The planes of a channel, and nothing. */
typedef float rgb __attribute__((vector_size(4 * sizeof(float))));
typedef double wide_rgb __attribute__((vector_size(4 * sizeof(double))));

/* Projects onto one row: moves its eight texels by the least that makes its two look-ups agree. */
static inline void project(const struct lw_seams_row *row, rgb *x) {
    const uint32_t *m = row->member;
    const float *w = row->weight;
    const rgb error = ((w[0] * x[m[0]] + w[1] * x[m[1]]) + (w[2] * x[m[2]] + w[3] * x[m[3]])) +
                      ((w[4] * x[m[4]] + w[5] * x[m[5]]) + (w[6] * x[m[6]] + w[7] * x[m[7]]));
    for (int i = 0; i < 8; i++) x[m[i]] -= w[i] * error; /* one may be there twice */
}

/* Forth and back over all rows of a component: a symmetric operator, so that
 * conjugate gradients may use it. */
static void sweep(const struct job *job, rgb *x) {
    const struct lw_seams_row *row = job->seams->row;
    for (uint32_t r = job->first_row; r < job->last_row; r++) project(&row[r], x);
    for (uint32_t r = job->last_row; r-- > job->first_row;) project(&row[r], x);
}

static void dot(const struct job *job, const rgb *a, const rgb *b, double out[3]) {
    wide_rgb sum = {0};
    for (uint32_t m = job->first; m < job->last; m++)
        sum += __builtin_convertvector(a[m], wide_rgb) * __builtin_convertvector(b[m], wide_rgb);
    for (int c = 0; c < 3; c++) out[c] = sum[c];
}

/* Kaczmarz's sweeps, accelerated by conjugate gradients (Bjorck and Elfving 1979, "CGMN"): with S the
 * sweep, solves x = S x from x = the light. Every step lies in the space of the rows, so the solution is
 * the one nearest to the light. */
static void relax(const struct job *job) {
    rgb *x = (rgb *)job->light->welded, *r = (rgb *)job->light->scratch[0],
        *p = (rgb *)job->light->scratch[1], *q = (rgb *)job->light->scratch[2];
    const size_t bytes = (job->last - job->first) * sizeof *x;
    memcpy(r + job->first, x + job->first, bytes);
    sweep(job, r);
    for (uint32_t m = job->first; m < job->last; m++) p[m] = r[m] -= x[m];
    double rr[3], xx[3];
    dot(job, x, x, xx);
    dot(job, r, r, rr);
    for (int k = 0; k < ITERATIONS; k++) {
        memcpy(q + job->first, p + job->first, bytes);
        sweep(job, q);
        for (uint32_t m = job->first; m < job->last; m++) q[m] = p[m] - q[m];
        double pq[3], next[3];
        rgb alpha = {0}, beta = {0};
        dot(job, p, q, pq);
        for (int c = 0; c < 3; c++) alpha[c] = rr[c] > DONE * xx[c] && pq[c] > 0 ? (float)(rr[c] / pq[c]) : 0;
        for (uint32_t m = job->first; m < job->last; m++) {
            x[m] += alpha * p[m];
            r[m] -= alpha * q[m];
        }
        dot(job, r, r, next);
        for (int c = 0; c < 3; c++) beta[c] = rr[c] > 0 ? (float)(next[c] / rr[c]) : 0;
        for (uint32_t m = job->first; m < job->last; m++) p[m] = r[m] + beta * p[m];
        memcpy(rr, next, sizeof rr);
        if (rr[0] <= DONE * xx[0] && rr[1] <= DONE * xx[1] && rr[2] <= DONE * xx[2]) break;
    }
}

/* By what to scale a component so that the light of its covered texels keeps its sum: a row that holds,
 * holds at any scale. (Both sides of a row move alike, but a share of it falls to gutters, which do not
 * count.) False where that is far from 1: the rows demand something else than light that continues, and the
 * light is worth more than they are. */
static bool find_keep(const struct job *job, float out_keep[3]) {
    double before[3] = {0}, after[3] = {0};
    for (uint32_t m = job->first; m < job->last; m++)
        for (int c = 0; c < 3 && !job->seams->guess[m].count; c++) {
            before[c] += (double)job->light->light[m][c];
            after[c] += (double)job->light->welded[m][c];
        }
    for (int c = 0; c < 3; c++) {
        const double keep = after[c] > 0 ? before[c] / after[c] : 1;
        if (!(keep <= KEEP_MOST && keep >= 1 / KEEP_MOST)) return false;
        out_keep[c] = (float)keep;
    }
    return true;
}

static inline rgb larger(rgb a, rgb b) {
    typedef int32_t whole __attribute__((vector_size(sizeof(rgb))));
    const whole yes = a > b;
    return (rgb)(((whole)a & yes) | ((whole)b & ~yes));
}

/* Projects onto one row, then to where light may be. */
static inline void project_bounded(const struct lw_seams_row *row, rgb *x, const rgb *least) {
    project(row, x);
    for (int i = 0; i < 8; i++) x[row->member[i]] = larger(x[row->member[i]], least[row->member[i]]);
}

/* Takes what the component shows to where light may be, and, where that changes it, on between there and the
 * rows alternately: projections onto convex sets. Only texels near a bound move; where none is met,
 * the correction stays the smallest. */
static void bound(const struct job *job) {
    rgb *x = (rgb *)job->light->welded, *least = (rgb *)job->light->scratch[0];
    const struct lw_seams_row *row = job->seams->row;
    bool bounds = false;
    for (uint32_t m = job->first; m < job->last; m++) {
        const float share = job->seams->guess[m].count ? 0 : LEAST;
        for (int c = 0; c < 3; c++) {
            least[m][c] = share * job->light->light[m][c];
            bounds |= x[m][c] < least[m][c];
        }
        x[m] = larger(x[m], least[m]);
    }
    for (int k = 0; k < SETTLE && bounds; k++) {
        for (uint32_t r = job->first_row; r < job->last_row; r++) project_bounded(&row[r], x, least);
        for (uint32_t r = job->last_row; r-- > job->first_row;) project_bounded(&row[r], x, least);
    }
}

static void weld_component(const struct job *job) {
    const struct lw_seams_member *member = job->seams->member;
    struct lw_seams_light *light = job->light;
    const uint32_t planes = light->planes;
    load(job);
    guess_gutters(job);
    /* In units in which every member moves with the same ease; from where the last correction leads. */
    for (uint32_t m = job->first; m < job->last; m++)
        for (uint32_t p = 0; p < planes; p++)
            light->welded[m][p] =
                light->light[m][p] / member[m].root_ease + KEPT * light->correction[planes * m + p];
    relax(job);
    for (uint32_t m = job->first; m < job->last; m++)
        for (uint32_t p = 0; p < planes; p++)
            light->correction[planes * m + p] =
                light->welded[m][p] - light->light[m][p] / member[m].root_ease;
    float keep[3] = {1, 1, 1};
    bool welds = true;
    if (!lw_tile_channel_at(light->channel)->is_signed) {
        bound(job);
        welds = find_keep(job, keep);
    }
    for (uint32_t m = job->first; m < job->last; m++)
        for (uint32_t p = 0; p < planes; p++)
            job->tiles->shown[light->channel][p][member[m].texel] =
                welds ? light->welded[m][p] * member[m].root_ease * keep[p] : light->light[m][p];
}

/* All that a component has changed is shown. */
static void mark_shown(const struct lw_seams *s, const struct lw_seams_light *light, struct lw_tiles *tiles,
                       uint64_t frame) {
    for (uint32_t c = 0; c < s->component_count; c++)
        for (uint32_t b = s->first_block[c]; light->active[c] && b < s->first_block[c + 1]; b++) {
            struct lw_solve_block *block = &tiles->block[s->block[b]];
            block->shown_frame = frame;
            lw_tiles_at(tiles, (lw_tile_id){block->tile_id})->light.solved_frame = frame;
        }
}

static void weld_channel(const struct lw_seams *s, struct lw_seams_light *light, struct lw_tiles *tiles,
                         uint64_t frame, int threads) {
#pragma omp parallel for schedule(dynamic, 1) num_threads(threads)
    for (uint32_t c = 0; c < s->component_count; c++) {
        const struct job job = {.seams = s,
                                .light = light,
                                .tiles = tiles,
                                .frame = frame,
                                .first = s->first_member[c],
                                .last = s->first_member[c + 1],
                                .first_row = s->first_row[c],
                                .last_row = s->first_row[c + 1]};
        light->active[c] = is_shown(s, tiles, frame, c);
        if (light->active[c])
            weld_component(&job);
        else if (light->fresh)
            load(&job);
    }
    light->fresh = false;
}

/* Shown blocks are noted at the end: a channel's welding reads what the filter has shown, not what another
 * channel's welding has. */
void lw_seams_weld(const struct lw_seams *s, struct lw_seams_welds *welds, uint32_t channels,
                   struct lw_tiles *tiles, uint64_t frame, int threads) {
    struct lw_seams_light *last = NULL;
    LW_INVARIANT(channels != 0);
    LW_TILE_CHANNELS_EACH (channel, channels)
        weld_channel(s, last = &welds->of[channel], tiles, frame, threads);
    if (last) mark_shown(s, last, tiles, frame);
}
