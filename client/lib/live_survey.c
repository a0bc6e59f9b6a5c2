#include "client/lib/live_survey.h"

#include "common/base/colour.h"
#include "common/base/invariant.h"
#include "common/tile/bilinear.h"
#include "common/tile/fine_choice.h"

#include <float.h>
#include <stdlib.h>
#include <string.h>

#define NONE       UINT32_MAX
#define CELLS      (LW_LIVE_SURVEY_SIDE * LW_LIVE_SURVEY_SIDE)
#define TABLE      (2 * LW_LIVE_SURVEY_TILES_MAX)
#define NEAR_SHARE 1e-3f /* share of the farthest depth; nearer surfaces are cut off */

_Static_assert((TABLE & (TABLE - 1)) == 0, "places in a table are masked");

/* What a cell of the picture shows. */
struct lw_live_survey_cell {
    float depth;
    uint32_t object; /* NONE: nothing that has a lightmap */
    struct lw_vec2 uv;
    float texels; /* level 0, in a pixel of the view */
    bool small;   /* the triangle has few texels */
};

struct lw_live_survey_tile {
    uint64_t name;  /* plus one; 0: the place is free */
    uint32_t count; /* cells that ask for it */
};

/* ---- boxes around triangles ---- */

static struct lw_live_box box_of(const struct lw_mesh *mesh, uint32_t first, uint32_t end) {
    struct lw_vec3 low = lw_vec3(FLT_MAX, FLT_MAX, FLT_MAX), high = lw_vec3_scale(low, -1);
    for (uint32_t t = first; t < end; t++)
        for (int i = 0; i < 3; i++) {
            low = lw_vec3_min(low, mesh->position[mesh->triangle[t][i]]);
            high = lw_vec3_max(high, mesh->position[mesh->triangle[t][i]]);
        }
    return (struct lw_live_box){lw_vec3_scale(lw_vec3_add(low, high), 0.5f),
                                lw_vec3_scale(lw_vec3_sub(high, low), 0.5f)};
}

static uint32_t count_groups(const struct lw_mesh *mesh) {
    return mesh->triangle_count / LW_LIVE_SURVEY_GROUP + (mesh->triangle_count % LW_LIVE_SURVEY_GROUP != 0);
}

static enum lw_status measure(struct lw_live_survey *s) {
    const struct lw_scene *scene = s->scene;
    for (uint32_t m = 0; m < scene->mesh_count; m++)
        s->first_group[m + 1] = s->first_group[m] + count_groups(&scene->mesh[m]);
    s->group = calloc(s->first_group[scene->mesh_count] + 1ul, sizeof *s->group);
    if (!s->group) return LW_NO_MEMORY;
    for (uint32_t m = 0; m < scene->mesh_count; m++) {
        const struct lw_mesh *mesh = &scene->mesh[m];
        for (uint32_t g = 0; g < count_groups(mesh); g++) {
            const uint32_t first = g * LW_LIVE_SURVEY_GROUP, left = mesh->triangle_count - first;
            s->group[s->first_group[m] + g] =
                box_of(mesh, first, first + (left < LW_LIVE_SURVEY_GROUP ? left : LW_LIVE_SURVEY_GROUP));
        }
    }
    return LW_OK;
}

enum lw_status lw_live_survey_init(struct lw_live_survey *s, const struct lw_client *client, bool as_it_is,
                                   const float *texel_m) {
    const struct lw_scene *scene = lw_client_scene(client);
    const size_t meshes = scene->mesh_count + 1ul;
    *s = (struct lw_live_survey){
        .client = client, .scene = scene, .map = lw_client_atlas_map(client), .as_it_is = as_it_is};
    s->texel_m = calloc(meshes, sizeof *s->texel_m);
    s->first_group = calloc(meshes, sizeof *s->first_group);
    s->cell = calloc(CELLS, sizeof *s->cell);
    s->tile = calloc(TABLE, sizeof *s->tile);
    s->spare = calloc(TABLE, sizeof *s->spare);
    if (!s->texel_m || !s->first_group || !s->cell || !s->tile || !s->spare) return LW_NO_MEMORY;
    memcpy(s->texel_m, texel_m, scene->mesh_count * sizeof *texel_m);
    return measure(s);
}

void lw_live_survey_finish(struct lw_live_survey *s) {
    free(s->texel_m);
    free(s->first_group);
    free(s->group);
    free(s->cell);
    free(s->tile);
    free(s->spare);
    *s = (struct lw_live_survey){0};
}

/* ---- the picture ---- */

struct picture {
    const struct lw_live_view *view;
    uint32_t width, height; /* cells */
    float pixels;           /* pixels of the view in a cell */
    float near, far;        /* depths between which it is drawn */
    uint32_t work;          /* cells that may still be looked at */
    struct lw_live_survey_cell *cell;
};

/* A corner of a triangle in clip space; x and y are so wide as the frustum. */
struct corner {
    float x, y, w;
    struct lw_vec2 uv;
};

struct surface {
    uint32_t object; /* NONE: it has no lightmap */
    bool small;
};

static struct corner between(const struct corner *a, const struct corner *b, float t) {
    return (struct corner){a->x + t * (b->x - a->x),
                           a->y + t * (b->y - a->y),
                           a->w + t * (b->w - a->w),
                           {a->uv.x + t * (b->uv.x - a->uv.x), a->uv.y + t * (b->uv.y - a->uv.y)}};
}

/* Where a corner lies in the picture, cells. */
static struct lw_vec2 project(const struct picture *p, const struct corner *c) {
    return (struct lw_vec2){(c->x / c->w * 0.5f + 0.5f) * (float)p->width,
                            (c->y / c->w * 0.5f + 0.5f) * (float)p->height};
}

/* The first cell with its middle at `at` or beyond, within `count`. */
static uint32_t first_cell(float at, uint32_t count) {
    const float cell = ceilf(at - 0.5f);
    return cell > 0 ? (cell < (float)count ? (uint32_t)cell : count) : 0;
}

/* A triangle that lies before the eye. In perspective uv / w and 1 / w are linear in the picture, and an
 * area of uv is to that of the picture as w^3 / (w0 w1 w2) times what it is for the whole triangle. */
static void draw(struct picture *p, const struct corner *const c[3], const struct surface *surface) {
    const struct lw_vec2 at[3] = {project(p, c[0]), project(p, c[1]), project(p, c[2])};
    const float twice = lw_vec2_twice_area(at[0], at[1], at[2]);
    if (!(fabsf(twice) > 1e-9f)) return;
    const float stretch = fabsf(lw_vec2_twice_area(c[0]->uv, c[1]->uv, c[2]->uv) / twice) /
                          (c[0]->w * c[1]->w * c[2]->w * p->pixels);
    const uint32_t left = first_cell(fminf(at[0].x, fminf(at[1].x, at[2].x)), p->width),
                   right = first_cell(fmaxf(at[0].x, fmaxf(at[1].x, at[2].x)), p->width),
                   top = first_cell(fminf(at[0].y, fminf(at[1].y, at[2].y)), p->height),
                   bottom = first_cell(fmaxf(at[0].y, fmaxf(at[1].y, at[2].y)), p->height);
    const uint32_t cells = left < right && top < bottom ? (right - left) * (bottom - top) : 0;
    if (cells > p->work) return;
    p->work -= cells;
    for (uint32_t y = top; y < bottom; y++)
        for (uint32_t x = left; x < right; x++) {
            const struct lw_vec2 here = {(float)x + 0.5f, (float)y + 0.5f};
            const float a = lw_vec2_twice_area(here, at[1], at[2]) / twice / c[0]->w,
                        b = lw_vec2_twice_area(at[0], here, at[2]) / twice / c[1]->w,
                        d = lw_vec2_twice_area(at[0], at[1], here) / twice / c[2]->w;
            if (a < 0 || b < 0 || d < 0) continue;
            const float w = 1 / (a + b + d);
            struct lw_live_survey_cell *cell = &p->cell[y * p->width + x];
            if (!(w < cell->depth)) continue;
            *cell =
                (struct lw_live_survey_cell){.depth = w,
                                             .object = surface->object,
                                             .uv = {w * (a * c[0]->uv.x + b * c[1]->uv.x + d * c[2]->uv.x),
                                                    w * (a * c[0]->uv.y + b * c[1]->uv.y + d * c[2]->uv.y)},
                                             .texels = stretch * w * w * w,
                                             .small = surface->small};
        }
}

/* Cuts a triangle at the near plane (Sutherland and Hodgman 1974). */
static void cut_and_draw(struct picture *p, const struct corner corner[3], const struct surface *surface) {
    struct corner kept[4];
    int count = 0;
    for (int i = 0; i < 3; i++) {
        const struct corner *a = &corner[i], *b = &corner[(i + 1) % 3];
        const float from = a->w - p->near, to = b->w - p->near;
        if (from >= 0) kept[count++] = *a;
        if ((from >= 0) != (to >= 0)) kept[count++] = between(a, b, from / (from - to));
    }
    for (int i = 2; i < count; i++) {
        const struct corner *const c[3] = {&kept[0], &kept[i - 1], &kept[i]};
        draw(p, c, surface);
    }
}

/* An object as the view sees it. */
struct seen {
    const struct lw_mesh *mesh;
    struct lw_live_linear x, y, w; /* clip coordinates; x and y as wide as the frustum */
    float turn;                    /* determinant of the three: its sign tells fronts from backs */
    uint32_t object;
};

static float triple(struct lw_vec3 a, struct lw_vec3 b, struct lw_vec3 c) {
    return lw_vec3_dot(a, lw_vec3_cross(b, c));
}

static struct corner corner_of(const struct seen *o, uint32_t vertex) {
    const struct lw_vec3 p = o->mesh->position[vertex];
    return (struct corner){lw_vec3_dot(o->x.n, p) + o->x.d, lw_vec3_dot(o->y.n, p) + o->y.d,
                           lw_vec3_dot(o->w.n, p) + o->w.d,
                           o->mesh->lightmap_uv ? o->mesh->lightmap_uv[vertex] : (struct lw_vec2){0, 0}};
}

static void draw_triangle(const struct lw_live_survey *s, struct picture *p, const struct seen *o,
                          uint32_t triangle) {
    const struct lw_material *material = &s->scene->material[o->mesh->material[triangle]];
    const uint32_t *v = o->mesh->triangle[triangle];
    struct corner c[3] = {corner_of(o, v[0]), corner_of(o, v[1]), corner_of(o, v[2])};
    if (material->alpha_mode == LW_ALPHA_BLEND) return;
    const float facing = triple(lw_vec3(c[0].x, c[0].y, c[0].w), lw_vec3(c[1].x, c[1].y, c[1].w),
                                lw_vec3(c[2].x, c[2].y, c[2].w)) *
                         o->turn;
    const bool back = facing > 0;
    if (back && !material->double_sided) return;
    struct surface surface = {.object = o->object};
    if (o->object != NONE)
        surface.small = fabsf(lw_vec2_twice_area(c[0].uv, c[1].uv, c[2].uv)) < LW_FINE_CHOICE_TEXELS;
    for (int i = 0; back && i < 3; i++) c[i].uv.y += (float)o->mesh->back_offset;
    cut_and_draw(p, c, &surface);
}

static struct lw_live_linear widened(struct lw_live_linear l) {
    const float by = 1 / (1 + LW_LIVE_FRUSTUM_AROUND);
    return (struct lw_live_linear){lw_vec3_scale(l.n, by), l.d * by};
}

static void draw_object(const struct lw_live_survey *s, struct picture *p, uint32_t object) {
    const uint32_t m = s->scene->object[object].mesh;
    const struct lw_affine *to_world = lw_client_object_to_world(s->client, object);
    const struct lw_live_frustum f = lw_live_frustum_of(p->view, to_world);
    struct seen o = {.mesh = &s->scene->mesh[m],
                     .x = widened(lw_live_frustum_row(p->view, 0, to_world)),
                     .y = widened(lw_live_frustum_row(p->view, 1, to_world)),
                     .w = lw_live_frustum_row(p->view, 3, to_world),
                     .object = s->map->atlas[object]->level_count ? object : NONE};
    o.turn = triple(o.x.n, o.y.n, o.w.n);
    for (uint32_t g = s->first_group[m]; g < s->first_group[m + 1]; g++) {
        float depth;
        if (!lw_live_frustum_meets(&f, &s->group[g], &depth) || depth > p->far) continue;
        const uint32_t first = (g - s->first_group[m]) * LW_LIVE_SURVEY_GROUP,
                       left = o.mesh->triangle_count - first,
                       end = first + (left < LW_LIVE_SURVEY_GROUP ? left : LW_LIVE_SURVEY_GROUP);
        for (uint32_t t = first; t < end; t++) draw_triangle(s, p, &o, t);
    }
}

/* Beyond this depth no finer level is wanted: its texels would be too small. 0: nowhere. */
static float find_far(const struct lw_live_survey *s, const struct lw_live_view *view) {
    float far = 0;
    for (uint32_t o = 0; o < s->map->object_count; o++) {
        const float texel_m = s->texel_m[s->scene->object[o].mesh];
        if (!s->map->atlas[o]->finer_count || lw_client_object_hidden(s->client, o)) continue;
        const struct lw_live_frustum f = lw_live_frustum_of(view, lw_client_object_to_world(s->client, o));
        if (f.pixel_m > 0) far = fmaxf(far, texel_m / (2 * LW_FINE_CHOICE_PIXELS * f.pixel_m));
    }
    return far;
}

static void draw_view(const struct lw_live_survey *s, struct picture *p) {
    const float wide = 1 + LW_LIVE_FRUSTUM_AROUND, width = (float)p->view->width,
                height = (float)p->view->height, longest = fmaxf(width, height),
                scale = fminf(1, (float)LW_LIVE_SURVEY_SIDE / longest);
    p->width = (uint32_t)fmaxf(1, width * scale);
    p->height = (uint32_t)fmaxf(1, height * scale);
    p->pixels = width * wide / (float)p->width * (height * wide / (float)p->height);
    p->near = NEAR_SHARE * p->far;
    p->work = LW_LIVE_SURVEY_WORK_MAX;
    for (uint32_t i = 0; i < p->width * p->height; i++)
        p->cell[i] = (struct lw_live_survey_cell){.depth = INFINITY, .object = NONE};
    for (uint32_t o = 0; o < s->map->object_count; o++)
        if (!lw_client_object_hidden(s->client, o)) draw_object(s, p, o);
}

/* ---- what cells ask for ---- */

static struct lw_live_survey_tile *place_in(struct lw_live_survey_tile *table, uint64_t name) {
    uint64_t at = (name * 0x9e3779b97f4a7c15u) >> 40;
    while (table[at & (TABLE - 1)].name && table[at & (TABLE - 1)].name != name + 1) at++;
    return &table[at & (TABLE - 1)];
}

/* The tile of a coarser one of the finer levels that covers a tile. */
static uint64_t cover(const struct lw_atlas_map *map, uint64_t name, uint32_t coarser) {
    uint32_t low = 0, high = map->object_count; /* objects [low, high) have it */
    while (high - low > 1) {
        const uint32_t middle = (low + high) / 2;
        if (map->first_finer[middle] <= name)
            low = middle;
        else
            high = middle;
    }
    const struct lw_atlas *atlas = map->atlas[low];
    const uint32_t tile = (uint32_t)(name - map->first_finer[low]);
    uint32_t k = atlas->finer_count;
    while (k > 1 && atlas->finer[k - 1].first_tile > tile) k--;
    const uint32_t up = coarser < k ? coarser : k - 1, number = tile - atlas->finer[k - 1].first_tile,
                   x = number % atlas->finer[k - 1].tiles_x >> up,
                   y = number / atlas->finer[k - 1].tiles_x >> up;
    const struct lw_atlas_level *at = &atlas->finer[k - 1 - up];
    return map->first_finer[low] + at->first_tile + y * at->tiles_x + x;
}

static void add(struct lw_live_survey *s, uint64_t name, uint32_t count) {
    struct lw_live_survey_tile *tile = place_in(s->tile, name);
    s->tile_count += !tile->name;
    tile->name = name + 1;
    tile->count += count;
}

/* All that is asked for is a level coarser, down to the coarsest of the finer ones. */
static void coarsen(struct lw_live_survey *s) {
    struct lw_live_survey_tile *before = s->tile;
    s->tile = s->spare;
    s->spare = before;
    memset(s->tile, 0, TABLE * sizeof *s->tile);
    s->tile_count = 0;
    s->coarser++;
    for (uint32_t i = 0; i < TABLE; i++)
        if (before[i].name) add(s, cover(s->map, before[i].name - 1, 1), before[i].count);
}

static bool is_here(const struct lw_live_survey *s, lw_tile_id tile) {
    const struct lw_client_tile is = lw_client_get_tile(s->client, tile);
    return is.version && (s->as_it_is || lw_atlas_noise_level_min(is.error, s->noise_shown) == 0);
}

/* Whether level 0 shows the same as a finer one. Where it is noisy, or has not come yet, it may. */
static bool is_even(const struct lw_live_survey *s, const struct lw_live_survey_cell *cell) {
    const struct lw_client_level level = lw_client_get_level(s->client, cell->object, 0);
    const struct lw_bilinear x = lw_bilinear_at(cell->uv.x, level.width),
                             y = lw_bilinear_at(cell->uv.y, level.height);
    float luminance[4];
    for (uint32_t i = 0; i < 4; i++) {
        const uint32_t at_x = i & 1 ? x.high : x.low, at_y = i >> 1 ? y.high : y.low;
        const lw_tile_id tile =
            lw_atlas_map_find(s->map, cell->object, 0, at_x / LW_TILE_SIDE, at_y / LW_TILE_SIDE);
        if (!is_here(s, tile)) return true;
        const float *rgb = level.rgb + 3 * ((size_t)at_y * level.width + at_x);
        luminance[i] = lw_colour_luminance(lw_vec3(rgb[0], rgb[1], rgb[2]));
    }
    return lw_fine_choice_is_even(luminance);
}

/* Adds the tiles that a look-up of a cell reads. */
static void add_tiles_of(struct lw_live_survey *s, const struct lw_live_survey_cell *cell) {
    if (cell->object == NONE) return;
    while (s->tile_count > LW_LIVE_SURVEY_TILES_MAX - 4 && s->coarser + 1 < s->map->finer_count) coarsen(s);
    if (s->tile_count > LW_LIVE_SURVEY_TILES_MAX - 4) return;
    const struct lw_atlas *atlas = s->map->atlas[cell->object];
    const int wanted = lw_fine_choice(cell->texels, 1, (int)atlas->finer_count);
    if (wanted == 0 || (!cell->small && is_even(s, cell))) return;
    uint32_t k = (uint32_t)wanted;
    k = k > s->coarser ? k - s->coarser : 1;
    const struct lw_atlas_level *level = &atlas->finer[k - 1];
    const float scale = (float)(1u << k);
    const struct lw_bilinear x = lw_bilinear_at(cell->uv.x * scale, level->width),
                             y = lw_bilinear_at(cell->uv.y * scale, level->height);
    const uint32_t left = x.low / LW_TILE_SIDE, right = x.high / LW_TILE_SIDE, top = y.low / LW_TILE_SIDE,
                   bottom = y.high / LW_TILE_SIDE;
    const uint64_t first = s->map->first_finer[cell->object] + level->first_tile;
    for (uint32_t row = top; row <= bottom; row++)
        for (uint32_t column = left; column <= right; column++)
            add(s, first + (uint64_t)row * level->tiles_x + column, 1);
    LW_INVARIANT_DEAR(s->tile_count <= LW_LIVE_SURVEY_TILES_MAX);
}

/* Counts the tiles that at least `least` cells ask for. */
static uint32_t count_asked(const struct lw_live_survey *s, uint32_t least) {
    uint32_t count = 0;
    for (uint32_t i = 0; i < TABLE; i++) count += s->tile[i].name && s->tile[i].count >= least;
    return count;
}

/* Gives ids to what most cells ask for. */
static uint32_t choose(const struct lw_live_survey *s, uint32_t most, lw_tile_id *out_tile) {
    uint32_t least = 1, count = 0;
    while (count_asked(s, least) > most) least *= 2;
    /* first the tiles that fit, then some of the rest */
    for (uint32_t rest = 0; rest < 2; rest++)
        for (uint32_t i = 0; i < TABLE && count < most; i++) {
            const struct lw_live_survey_tile *tile = &s->tile[i];
            if (!tile->name || (tile->count < least) != (rest == 1)) continue;
            const lw_tile_id id = lw_atlas_map_claim_name(s->map, tile->name - 1);
            if (id.v != UINT32_MAX) out_tile[count++] = id;
        }
    return count;
}

uint32_t lw_live_survey_list(struct lw_live_survey *s, const struct lw_live_view *view, uint32_t view_count,
                             uint32_t most, lw_tile_id *out_tile) {
    struct lw_client_stats stats;
    lw_client_get_stats(s->client, &stats);
    s->noise_shown = stats.noise_shown;
    s->coarser = s->tile_count = 0;
    memset(s->tile, 0, TABLE * sizeof *s->tile);
    for (uint32_t v = 0; v < view_count; v++) {
        struct picture p = {.view = &view[v], .far = find_far(s, &view[v]), .cell = s->cell};
        const float *m = view[v].view_projection;
        const bool is_perspective = m[3] != 0 || m[7] != 0 || m[11] != 0;
        if (!is_perspective || !(p.far > 0) || !isfinite(p.far)) continue;
        draw_view(s, &p);
        for (uint32_t i = 0; i < p.width * p.height; i++) add_tiles_of(s, &p.cell[i]);
    }
    while (s->tile_count > most && s->coarser + 1 < s->map->finer_count) coarsen(s);
    const uint32_t count = choose(s, most, out_tile);
    LW_INVARIANT(count <= most);
    return count;
}
