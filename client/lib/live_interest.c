#include "client/lib/live_interest.h"

#include "common/base/invariant.h"

#include <float.h>
#include <stdlib.h>
#include <string.h>

#define FILTER_TEXELS 1.0f /* a look-up reads so far beyond a triangle's edge */

/* ---- what tiles hold ---- */

/* A corner of a triangle, or of what a tile leaves of it. */
struct corner {
    struct lw_vec2 uv;
    struct lw_vec3 position;
};

#define CORNERS_MAX 7 /* a triangle cut by four lines */

static struct corner between(const struct corner *a, const struct corner *b, float t) {
    const struct lw_vec3 way = lw_vec3_sub(b->position, a->position);
    return (struct corner){{a->uv.x + t * (b->uv.x - a->uv.x), a->uv.y + t * (b->uv.y - a->uv.y)},
                           lw_vec3_mad(a->position, way, t)};
}

/* Keeps what lies where sign * (coordinate - line) >= 0 (Sutherland and Hodgman 1974). */
static int cut(const struct corner *in, int count, bool is_y, float line, float sign, struct corner *out) {
    int kept = 0;
    for (int i = 0; i < count; i++) {
        const struct corner *a = &in[i], *b = &in[(i + 1) % count];
        const float from = sign * ((is_y ? a->uv.y : a->uv.x) - line),
                    to = sign * ((is_y ? b->uv.y : b->uv.x) - line);
        if (from >= 0) out[kept++] = *a;
        if ((from >= 0) != (to >= 0)) out[kept++] = between(a, b, from / (from - to));
    }
    return kept;
}

struct bounds {
    struct lw_vec3 low, high;
};

static void widen(struct bounds *b, struct lw_vec3 p) {
    b->low = lw_vec3_min(b->low, p);
    b->high = lw_vec3_max(b->high, p);
}

static const struct bounds nothing = {{FLT_MAX, FLT_MAX, FLT_MAX}, {-FLT_MAX, -FLT_MAX, -FLT_MAX}};

static struct lw_live_box to_box(const struct bounds *b) {
    if (b->low.x > b->high.x) return (struct lw_live_box){.half = {-1, 0, 0}};
    return (struct lw_live_box){lw_vec3_scale(lw_vec3_add(b->low, b->high), 0.5f),
                                lw_vec3_scale(lw_vec3_sub(b->high, b->low), 0.5f)};
}

/* Widens the boxes of the tiles that a triangle lies in by what lies in them. */
static void add_triangle(const struct corner corner[3], const struct lw_atlas_level *level,
                         struct bounds *tile) {
    float low_x = FLT_MAX, low_y = FLT_MAX, high_x = 0, high_y = 0;
    for (int i = 0; i < 3; i++) {
        low_x = fminf(low_x, corner[i].uv.x);
        low_y = fminf(low_y, corner[i].uv.y);
        high_x = fmaxf(high_x, corner[i].uv.x);
        high_y = fmaxf(high_y, corner[i].uv.y);
    }
    const float side = (float)LW_TILE_SIDE;
    const uint32_t first_x = (uint32_t)(fmaxf(low_x - FILTER_TEXELS, 0) / side),
                   first_y = (uint32_t)(fmaxf(low_y - FILTER_TEXELS, 0) / side);
    for (uint32_t y = first_y; y < level->tiles_y && (float)y * side <= high_y + FILTER_TEXELS; y++)
        for (uint32_t x = first_x; x < level->tiles_x && (float)x * side <= high_x + FILTER_TEXELS; x++) {
            struct corner a[CORNERS_MAX], b[CORNERS_MAX];
            int count = cut(corner, 3, false, (float)x * side - FILTER_TEXELS, 1, a);
            count = cut(a, count, false, (float)(x + 1) * side + FILTER_TEXELS, -1, b);
            count = cut(b, count, true, (float)y * side - FILTER_TEXELS, 1, a);
            count = cut(a, count, true, (float)(y + 1) * side + FILTER_TEXELS, -1, b);
            for (int i = 0; i < count; i++) widen(&tile[y * level->tiles_x + x], b[i].position);
        }
}

static float area_uv(const struct corner c[3]) {
    return 0.5f * fabsf(lw_vec2_twice_area(c[0].uv, c[1].uv, c[2].uv));
}

static float area_m2(const struct corner c[3]) {
    return 0.5f * lw_vec3_length(lw_vec3_cross(lw_vec3_sub(c[1].position, c[0].position),
                                               lw_vec3_sub(c[2].position, c[0].position)));
}

/* tile: bounds of each, nothing in them yet */
static void measure_mesh(const struct lw_scene *scene, const struct lw_mesh *mesh,
                         const struct lw_atlas_level *level, struct bounds *tile,
                         struct lw_live_mesh_boxes *out) {
    double texels = 0, m2 = 0;
    struct bounds around = nothing;
    for (uint32_t t = 0; t < mesh->triangle_count; t++) {
        struct corner corner[3];
        for (int i = 0; i < 3; i++) {
            const uint32_t v = mesh->triangle[t][i];
            corner[i] = (struct corner){mesh->lightmap_uv[v], mesh->position[v]};
            widen(&around, mesh->position[v]);
        }
        texels += (double)area_uv(corner);
        m2 += (double)area_m2(corner);
        add_triangle(corner, level, tile);
        if (!mesh->back_offset || !scene->material[mesh->material[t]].double_sided) continue;
        for (int i = 0; i < 3; i++) corner[i].uv.y += (float)mesh->back_offset;
        add_triangle(corner, level, tile);
    }
    out->texel_m = texels > 0 ? (float)sqrt(m2 / texels) : 0;
    out->around = to_box(&around);
}

static enum lw_status measure(struct lw_live_interest *interest, const struct lw_scene *scene) {
    const struct lw_atlas_map *map = interest->map;
    uint32_t boxes = 0, largest = 0;
    for (uint32_t m = 0; m < scene->mesh_count; m++) interest->mesh[m].first = UINT32_MAX;
    for (uint32_t o = 0; o < scene->object_count; o++) {
        struct lw_live_mesh_boxes *mesh = &interest->mesh[scene->object[o].mesh];
        if (mesh->first != UINT32_MAX || !map->atlas[o]->level_count) continue;
        const uint32_t tiles = map->atlas[o]->level[0].tiles_x * map->atlas[o]->level[0].tiles_y;
        mesh->first = boxes;
        boxes += tiles;
        if (tiles > largest) largest = tiles;
    }
    interest->box = calloc((size_t)boxes + 1, sizeof *interest->box);
    struct bounds *tile = malloc(((size_t)largest + 1) * sizeof *tile);
    bool *is_measured = calloc((size_t)scene->mesh_count + 1, sizeof *is_measured);
    const bool has_memory = interest->box && tile && is_measured;
    for (uint32_t o = 0; has_memory && o < scene->object_count; o++) {
        const uint32_t m = scene->object[o].mesh;
        if (is_measured[m] || !map->atlas[o]->level_count) continue;
        is_measured[m] = true;
        const struct lw_atlas_level *level = &map->atlas[o]->level[0];
        const uint32_t tiles = level->tiles_x * level->tiles_y;
        LW_INVARIANT(tiles <= largest && interest->mesh[m].first + tiles <= boxes);
        for (uint32_t i = 0; i < tiles; i++) tile[i] = nothing;
        measure_mesh(scene, &scene->mesh[m], level, tile, &interest->mesh[m]);
        for (uint32_t i = 0; i < tiles; i++) interest->box[interest->mesh[m].first + i] = to_box(&tile[i]);
    }
    free(tile);
    free(is_measured);
    return has_memory ? LW_OK : LW_NO_MEMORY;
}

/* Prepares lists with tiles of finer levels. */
static enum lw_status init_finer(struct lw_live_interest *interest, const struct lw_client *client,
                                 bool as_it_is) {
    const uint32_t meshes = lw_client_scene(client)->mesh_count;
    float *texel_m = calloc(meshes + 1ul, sizeof *texel_m);
    interest->finer = calloc(interest->finer_max, sizeof *interest->finer);
    enum lw_status status = texel_m && interest->finer ? LW_OK : LW_NO_MEMORY;
    for (uint32_t m = 0; status == LW_OK && m < meshes; m++) texel_m[m] = interest->mesh[m].texel_m;
    if (status == LW_OK) status = lw_live_survey_init(&interest->survey, client, as_it_is, texel_m);
    free(texel_m);
    return status;
}

enum lw_status lw_live_interest_init(struct lw_live_interest *interest, const struct lw_client *client,
                                     uint32_t finer_max, bool as_it_is) {
    const struct lw_scene *scene = lw_client_scene(client);
    const size_t tiles = lw_client_atlas_map(client)->tile_count;
    interest->map = lw_client_atlas_map(client); /* views may be there already */
    interest->mesh = calloc((size_t)scene->mesh_count + 1, sizeof *interest->mesh);
    interest->level = calloc(tiles + 1, sizeof *interest->level);
    interest->mark = calloc(tiles + 1, sizeof *interest->mark);
    interest->seen_ns = calloc(tiles + 1, sizeof *interest->seen_ns);
    interest->list = calloc(LW_CLIENT_INTEREST_MAX + 1, sizeof *interest->list);
    if (!interest->mesh || !interest->level || !interest->mark || !interest->seen_ns || !interest->list)
        return LW_NO_MEMORY;
    const enum lw_status status = measure(interest, scene);
    if (status != LW_OK || !finer_max || !lw_atlas_map_room(interest->map)) return status;
    interest->finer_max = finer_max;
    return init_finer(interest, client, as_it_is);
}

void lw_live_interest_finish(struct lw_live_interest *interest) {
    free(interest->mesh);
    free(interest->box);
    free(interest->level);
    free(interest->mark);
    free(interest->seen_ns);
    free(interest->list);
    free(interest->finer);
    lw_live_survey_finish(&interest->survey);
    *interest = (struct lw_live_interest){0};
}

/* ---- what lies in a view ---- */

/* The level whose texels are as large as pixels, rather finer. Above LW_ATLAS_READ_MAX charts run into each
 * other. */
static uint8_t level_at(float depth, float texel_pixels, uint32_t level_count) {
    const float texels = depth * texel_pixels;
    uint8_t level = 0;
    while (level < LW_ATLAS_READ_MAX && level + 1u < level_count && texels >= (float)(2u << level)) level++;
    return level;
}

static void look_at_object(struct lw_live_interest *interest, const struct lw_client *client, uint32_t object,
                           uint32_t mesh) {
    const struct lw_atlas *atlas = interest->map->atlas[object];
    const struct lw_live_mesh_boxes *boxes = &interest->mesh[mesh];
    const uint32_t tiles = atlas->level[0].tiles_x * atlas->level[0].tiles_y;
    uint8_t *level = interest->level + interest->map->first_tile[object] + atlas->level[0].first_tile;
    LW_INVARIANT(interest->map->first_tile[object] + atlas->level[0].first_tile + tiles <=
                 interest->map->tile_count);
    memset(level, UINT8_MAX, tiles);
    if (lw_client_object_hidden(client, object)) return;
    for (uint32_t v = 0; v < interest->view_count; v++) {
        const struct lw_live_frustum f =
            lw_live_frustum_of(&interest->view[v], lw_client_object_to_world(client, object));
        /* height of a pixel at depth 1, in texels of level 0 */
        const float texel_pixels = boxes->texel_m > 0 ? f.pixel_m / boxes->texel_m : 0;
        float depth;
        if (!lw_live_frustum_meets(&f, &boxes->around, &depth)) continue;
        for (uint32_t t = 0; t < tiles; t++) {
            if (!lw_live_frustum_meets(&f, &interest->box[boxes->first + t], &depth)) continue;
            const uint8_t read = level_at(depth, texel_pixels, atlas->level_count);
            if (read < level[t]) level[t] = read;
        }
    }
}

/* ---- lists ---- */

/* Lists a tile that is not in this round's list; counts up to one too many. */
static void list(struct lw_live_interest *interest, lw_tile_id tile, uint32_t *count) {
    LW_INVARIANT(tile.v < interest->map->tile_count);
    if (interest->mark[tile.v] == interest->round || *count > LW_CLIENT_INTEREST_MAX) return;
    interest->mark[tile.v] = interest->round;
    interest->list[(*count)++] = tile;
}

/* The tiles of the picture, `coarser` levels above the level that it reads. */
static uint32_t list_picture(struct lw_live_interest *interest, uint32_t coarser) {
    const struct lw_atlas_map *map = interest->map;
    uint32_t count = 0;
    interest->round++;
    for (uint32_t o = 0; o < map->object_count; o++) {
        const struct lw_atlas *atlas = map->atlas[o];
        if (!atlas->level_count) continue;
        const uint32_t first = map->first_tile[o] + atlas->level[0].first_tile;
        for (uint32_t t = 0; t < atlas->level[0].tiles_x * atlas->level[0].tiles_y; t++) {
            if (interest->level[first + t] == UINT8_MAX) continue;
            uint32_t level = interest->level[first + t] + coarser;
            if (level >= atlas->level_count) level = atlas->level_count - 1;
            const struct lw_tile_place *p = &map->place[first + t];
            LW_INVARIANT(p->level == 0 && p->object == o);
            list(interest, lw_atlas_map_find(map, o, level, p->x >> level, p->y >> level), &count);
            if (count > LW_CLIENT_INTEREST_MAX) return count;
        }
    }
    return count;
}

/* Lists tiles of finer levels that the views show, as far as there is room for them. Returns how many.
 * Between surveys those of the last one are listed, and the next list is due soon. */
static uint32_t list_finer(struct lw_live_interest *interest, uint64_t now_ns, uint32_t *count) {
    const uint32_t before = *count, left = LW_CLIENT_INTEREST_MAX - before,
                   most = left < interest->finer_max ? left : interest->finer_max;
    if (interest->finer_max == 0 || interest->view_count == 0) return 0;
    if (interest->surveyed_ns == 0 || now_ns - interest->surveyed_ns >= LW_LIVE_INTEREST_FINER_NS) {
        interest->finer_count = lw_live_survey_list(&interest->survey, interest->view, interest->view_count,
                                                    interest->finer_max, interest->finer);
        interest->surveyed_ns = now_ns;
    } else {
        interest->has_changed = true;
    }
    for (uint32_t i = 0; i < interest->finer_count && *count - before < most; i++)
        if (lw_atlas_map_is_used(interest->map, interest->finer[i])) /* ids are released, too */
            list(interest, interest->finer[i], count);
    return *count - before;
}

/* Lists tiles that were in the picture before. finer: how many of these are of finer levels; more than
 * there may be are left out. */
static uint32_t list_seen(struct lw_live_interest *interest, uint64_t now_ns, uint32_t count,
                          uint32_t finer) {
    const struct lw_atlas_map *map = interest->map;
    for (uint32_t t = 0; t < map->tile_count; t++) {
        const bool was_seen =
            interest->seen_ns[t] && now_ns - interest->seen_ns[t] <= LW_LIVE_INTEREST_KEEP_NS;
        if (!was_seen || interest->mark[t] == interest->round) continue;
        if (t >= map->plain_count &&
            (!lw_atlas_map_is_used(map, (lw_tile_id){t}) || finer++ >= interest->finer_max))
            continue;
        list(interest, (lw_tile_id){t}, &count);
    }
    return count;
}

uint32_t lw_live_interest_list(struct lw_live_interest *interest, const struct lw_client *client,
                               uint64_t now_ns) {
    const struct lw_scene *scene = lw_client_scene(client);
    const struct lw_atlas_map *map = interest->map;
    for (uint32_t o = 0; o < map->object_count; o++)
        if (map->atlas[o]->level_count) look_at_object(interest, client, o, scene->object[o].mesh);
    uint32_t count = 0;
    for (uint32_t coarser = 0; coarser < LW_ATLAS_LEVELS_MAX; coarser++) {
        count = list_picture(interest, coarser);
        if (count <= LW_CLIENT_INTEREST_MAX) break;
    }
    if (count > LW_CLIENT_INTEREST_MAX) return count;
    const uint32_t finer = list_finer(interest, now_ns, &count);
    for (uint32_t i = 0; i < count; i++) interest->seen_ns[interest->list[i].v] = now_ns;
    const uint32_t with_seen = list_seen(interest, now_ns, count, finer);
    LW_INVARIANT(with_seen >= count && count <= LW_CLIENT_INTEREST_MAX);
    return with_seen <= LW_CLIENT_INTEREST_MAX ? with_seen : count;
}

enum lw_status lw_live_interest_update(struct lw_live_interest *interest, struct lw_client *client,
                                       uint64_t now_ns) {
    const uint64_t since_ns = now_ns - interest->looked_ns;
    LW_INVARIANT(now_ns >= interest->looked_ns && interest->view_count <= LW_LIVE_VIEWS_MAX);
    if (!interest->is_active || since_ns < LW_LIVE_INTEREST_NS) return LW_OK;
    if (!interest->has_changed && since_ns < LW_LIVE_INTEREST_IDLE_NS) return LW_OK;
    if (!interest->map) return interest->view_count ? LW_OK : lw_client_want(client, NULL, 0);
    interest->looked_ns = now_ns;
    interest->has_changed = false;
    const uint32_t count = lw_live_interest_list(interest, client, now_ns);
    if (count <= LW_CLIENT_INTEREST_MAX) return lw_client_want(client, interest->list, count);
    lw_client_want_everything(client);
    return LW_OK;
}
