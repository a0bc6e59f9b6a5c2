#include "client/load/viewer_model.h"

#include "common/base/box.h"
#include "common/base/random.h"
#include "common/scene/pose.h"

#include <assert.h>
#include <stdlib.h>

#define CONE_COS     0.76f /* 40 degrees: the half angle to the corner of a 60 degree, 4:3 picture */
#define CONE_SIN     0.65f
#define PIXEL        (1.0472f / 720) /* radians */
#define PIXEL_MAX    64.0f           /* coarser pixels change nothing any more that is worth another round */
#define EYE_HEIGHT_M 1.7f
#define WALK_M_S     1.4f
#define WALK_SHARE_S 0.05f /* in small scenes: of the longest side, per second */
#define MARGIN       0.1f  /* share of the bounds that is kept free on all sides */
#define LEG_MIN_S    0.5

struct lw_viewer_model {
    const struct lw_atlas_map *map;
    struct lw_box *tile;   /* per tile id; in world space, as are all here */
    struct lw_box *object; /* per object */
    float *texel_m;        /* per object: side of a texel of level 0 */
    struct lw_box bounds;
};

/* ---- boxes of tiles ---- */

/* A triangle in the world and in its atlas. */
struct corner {
    struct lw_vec3 p;
    struct lw_vec2 uv;
};

/* The part of a triangle that lies in a rectangle of the atlas: the rectangle's corners on the triangle's
 * plane, cut by the triangle's own box. A floor of two triangles is many tiles, and each is to be where it
 * is. */
static struct lw_box part_in(const struct corner c[3], const struct lw_box *whole, struct lw_vec2 min,
                             struct lw_vec2 max) {
    float area = lw_vec2_twice_area(c[0].uv, c[1].uv, c[2].uv);
    if (fabsf(area) < 1e-6f) return *whole;
    struct lw_box part = LW_BOX_EMPTY;
    for (int i = 0; i < 4; i++) {
        struct lw_vec2 at = {i & 1 ? max.x : min.x, i & 2 ? max.y : min.y};
        float u = lw_vec2_twice_area(c[0].uv, at, c[2].uv) / area,
              v = lw_vec2_twice_area(c[0].uv, c[1].uv, at) / area;
        struct lw_vec3 p =
            lw_vec3_mad(lw_vec3_mad(c[0].p, lw_vec3_sub(c[1].p, c[0].p), u), lw_vec3_sub(c[2].p, c[0].p), v);
        lw_box_add_point(&part, p);
    }
    return (struct lw_box){lw_vec3_max(part.low, whole->low), lw_vec3_min(part.high, whole->high)};
}

/* Tile columns or rows that an interval of texels touches. */
static void tile_range(float min, float max, uint32_t tiles, uint32_t *out_first, uint32_t *out_last) {
    float last = (float)(tiles - 1);
    *out_first = (uint32_t)fminf(fmaxf(floorf(min / LW_TILE_SIDE), 0), last);
    *out_last = (uint32_t)fminf(fmaxf(floorf(max / LW_TILE_SIDE), 0), last);
}

static void add_triangle(struct lw_box *tile, const struct lw_atlas_level *level, const struct corner c[3]) {
    struct lw_box whole = LW_BOX_EMPTY;
    struct lw_vec2 min = c[0].uv, max = c[0].uv;
    for (int i = 0; i < 3; i++) {
        lw_box_add_point(&whole, c[i].p);
        min = (struct lw_vec2){fminf(min.x, c[i].uv.x), fminf(min.y, c[i].uv.y)};
        max = (struct lw_vec2){fmaxf(max.x, c[i].uv.x), fmaxf(max.y, c[i].uv.y)};
    }
    uint32_t x0, x1, y0, y1;
    tile_range(min.x, max.x, level->tiles_x, &x0, &x1);
    tile_range(min.y, max.y, level->tiles_y, &y0, &y1);
    for (uint32_t y = y0; y <= y1; y++)
        for (uint32_t x = x0; x <= x1; x++) {
            struct lw_vec2 low = {fmaxf(min.x, (float)(x * LW_TILE_SIDE)),
                                  fmaxf(min.y, (float)(y * LW_TILE_SIDE))},
                           high = {fminf(max.x, (float)((x + 1) * LW_TILE_SIDE)),
                                   fminf(max.y, (float)((y + 1) * LW_TILE_SIDE))};
            struct lw_box part = x0 == x1 && y0 == y1 ? whole : part_in(c, &whole, low, high);
            lw_box_add(&tile[level->first_tile + y * level->tiles_x + x], &part);
        }
}

/* A coarser tile is its up to four finer ones. */
static void add_coarser(struct lw_box *tile, const struct lw_atlas *atlas) {
    for (uint32_t l = 1; l < atlas->level_count; l++) {
        const struct lw_atlas_level *fine = &atlas->level[l - 1], *coarse = &atlas->level[l];
        for (uint32_t y = 0; y < fine->tiles_y; y++)
            for (uint32_t x = 0; x < fine->tiles_x; x++)
                lw_box_add(&tile[coarse->first_tile + y / 2 * coarse->tiles_x + x / 2],
                           &tile[fine->first_tile + y * fine->tiles_x + x]);
    }
}

static void add_object(struct lw_viewer_model *in, const struct lw_scene *scene, uint32_t object,
                       const struct lw_affine *to_world) {
    const struct lw_mesh *mesh = &scene->mesh[scene->object[object].mesh];
    const struct lw_atlas *atlas = in->map->atlas[object];
    struct lw_box *tile = in->tile + in->map->first_tile[object];
    double area_m2 = 0, area_texels = 0;
    for (uint32_t t = 0; t < mesh->triangle_count; t++) {
        struct corner c[3];
        for (int i = 0; i < 3; i++) {
            uint32_t v = mesh->triangle[t][i];
            c[i] = (struct corner){lw_affine_point(to_world, mesh->position[v]),
                                   mesh->lightmap_uv ? mesh->lightmap_uv[v] : (struct lw_vec2){0, 0}};
            lw_box_add_point(&in->object[object], c[i].p);
        }
        area_m2 += 0.5 * (double)lw_vec3_length(
                             lw_vec3_cross(lw_vec3_sub(c[1].p, c[0].p), lw_vec3_sub(c[2].p, c[0].p)));
        area_texels += 0.5 * (double)fabsf(lw_vec2_twice_area(c[0].uv, c[1].uv, c[2].uv));
        if (!atlas->level_count) continue;
        add_triangle(tile, &atlas->level[0], c);
        if (!mesh->back_offset) continue;
        for (int i = 0; i < 3; i++) c[i].uv.y += (float)mesh->back_offset;
        add_triangle(tile, &atlas->level[0], c);
    }
    in->texel_m[object] = area_texels > 0 ? (float)sqrt(area_m2 / area_texels) : 1.0f;
    add_coarser(tile, atlas);
    lw_box_add(&in->bounds, &in->object[object]);
}

enum lw_status lw_viewer_model_create(const struct lw_scene *scene, const struct lw_atlas_map *map,
                                      struct lw_viewer_model **out_interest) {
    struct lw_viewer_model *in = calloc(1, sizeof *in);
    struct lw_pose pose;
    if (!in) return LW_NO_MEMORY;
    in->map = map;
    in->bounds = LW_BOX_EMPTY;
    in->tile = malloc(((size_t)map->tile_count + 1) * sizeof *in->tile);
    in->object = malloc(((size_t)map->object_count + 1) * sizeof *in->object);
    in->texel_m = malloc(((size_t)map->object_count + 1) * sizeof *in->texel_m);
    if (!in->tile || !in->object || !in->texel_m || lw_pose_init(&pose, scene) != LW_OK) {
        lw_viewer_model_destroy(in);
        return LW_NO_MEMORY;
    }
    for (uint32_t i = 0; i < map->tile_count; i++) in->tile[i] = LW_BOX_EMPTY;
    for (uint32_t i = 0; i < map->object_count; i++) {
        in->object[i] = LW_BOX_EMPTY;
        if (!pose.object_hidden[i]) add_object(in, scene, i, &pose.object_to_world[i]);
    }
    if (lw_box_is_empty(&in->bounds)) in->bounds = (struct lw_box){{0, 0, 0}, {0, 0, 0}};
    lw_pose_finish(&pose);
    *out_interest = in;
    return LW_OK;
}

void lw_viewer_model_destroy(struct lw_viewer_model *in) {
    if (!in) return;
    free(in->tile);
    free(in->object);
    free(in->texel_m);
    free(in);
}

/* ---- tiles in view ---- */

static bool is_seen(const struct lw_box *box, const struct lw_viewer_model_eye *eye) {
    if (lw_box_is_empty(box)) return false; /* no surface */
    const struct lw_vec3 centre = lw_box_middle(box);
    const float radius = lw_box_radius(box);
    /* the box's ball against the cone: the distance of its centre from the cone's side, as if that went on
     * behind the tip, where the ball around the tip decides */
    struct lw_vec3 to = lw_vec3_sub(centre, eye->position);
    float along = lw_vec3_dot(to, eye->forward);
    float across = sqrtf(fmaxf(lw_vec3_dot(to, to) - along * along, 0));
    if (lw_vec3_dot(to, to) <= radius * radius) return true;
    return along > -radius && across * CONE_COS - along * CONE_SIN <= radius;
}

struct choice {
    const struct lw_viewer_model *in;
    const struct lw_viewer_model_eye *eye;
    float pixel; /* radians */
    lw_tile_id *ids;
    uint32_t count, capacity; /* count goes on past capacity */
};

static void choose(struct choice *c, lw_tile_id id) {
    if (c->count < c->capacity) c->ids[c->count] = id;
    c->count++;
}

/* From a coarse tile down to the level whose texels are as small as pixels; the finer tiles of a tile are no
 * nearer than it is, so that nothing is left out on the way. */
static void descend(struct choice *c, uint32_t object, uint32_t level, uint32_t x, uint32_t y) {
    lw_tile_id id = lw_atlas_map_find(c->in->map, object, level, x, y);
    if (id.v == UINT32_MAX || !is_seen(&c->in->tile[id.v], c->eye)) return;
    float texel_m = c->in->texel_m[object] * (float)(1u << level);
    bool fine = level == 0 || texel_m <= c->pixel * lw_box_distance(&c->in->tile[id.v], c->eye->position);
    if (fine) {
        choose(c, id);
        return;
    }
    for (uint32_t i = 0; i < 4; i++) descend(c, object, level - 1, 2 * x + (i & 1), 2 * y + (i >> 1));
}

static void choose_all(struct choice *c) {
    const struct lw_atlas_map *map = c->in->map;
    c->count = 0;
    for (uint32_t o = 0; o < map->object_count; o++) {
        const struct lw_atlas *atlas = map->atlas[o];
        if (!atlas->level_count || !is_seen(&c->in->object[o], c->eye)) continue;
        const struct lw_atlas_level *coarsest = &atlas->level[atlas->level_count - 1];
        for (uint32_t y = 0; y < coarsest->tiles_y; y++)
            for (uint32_t x = 0; x < coarsest->tiles_x; x++) descend(c, o, atlas->level_count - 1, x, y);
    }
}

uint32_t lw_viewer_model_choose(const struct lw_viewer_model *in, const struct lw_viewer_model_eye *eye,
                                lw_tile_id *ids, uint32_t capacity) {
    struct choice c = {.in = in, .eye = eye, .pixel = (float)PIXEL, .ids = ids, .capacity = capacity};
    choose_all(&c);
    while (c.count > capacity && c.pixel < PIXEL_MAX * (float)PIXEL) {
        c.pixel *= 2;
        choose_all(&c);
    }
    return c.count < capacity ? c.count : capacity;
}

/* ---- where users are ---- */

static float within(float min, float max, float fraction) {
    return min + (max - min) * (MARGIN + (1 - 2 * MARGIN) * fraction);
}

static struct lw_vec3 place_of(const struct lw_viewer_model *in, uint32_t seed, uint32_t user,
                               uint32_t stay) {
    const struct lw_box *b = &in->bounds;
    float height = b->high.y - b->low.y;
    return lw_vec3(within(b->low.x, b->high.x, lw_random_unit(lw_random_hash4(seed, user, stay, 0))),
                   b->low.y + fminf(EYE_HEIGHT_M, 0.5f * height),
                   within(b->low.z, b->high.z, lw_random_unit(lw_random_hash4(seed, user, stay, 1))));
}

struct lw_viewer_model_eye lw_viewer_model_place(const struct lw_viewer_model *in, uint32_t seed,
                                                 uint32_t user, uint32_t stay) {
    float angle = 2 * LW_PI * lw_random_unit(lw_random_hash4(seed, user, stay, 2));
    return (struct lw_viewer_model_eye){place_of(in, seed, user, stay), lw_vec3(cosf(angle), 0, sinf(angle))};
}

struct lw_viewer_model_eye lw_viewer_model_walk(const struct lw_viewer_model *in, uint32_t seed,
                                                uint32_t user, double seconds) {
    struct lw_vec3 size = lw_box_size(&in->bounds);
    float speed = fminf(WALK_M_S, WALK_SHARE_S * fmaxf(size.x, size.z));
    struct lw_vec3 from = place_of(in, seed, user, 0);
    for (uint32_t leg = 1;; leg++) {
        struct lw_vec3 to = place_of(in, seed, user, leg), way = lw_vec3_sub(to, from);
        double leg_s = fmax(speed > 0 ? (double)(lw_vec3_length(way) / speed) : 0, LEG_MIN_S);
        if (seconds < leg_s)
            return (struct lw_viewer_model_eye){lw_vec3_mad(from, way, (float)(seconds / leg_s)),
                                                lw_vec3_normalize(way)};
        seconds -= leg_s;
        from = to;
    }
}
