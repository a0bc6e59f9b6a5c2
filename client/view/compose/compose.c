#include "client/view/compose/compose.h"

#include "client/camera/place.h"
#include "client/view/lights/direct_pixels.h"
#include "client/view/shading/ambient.h"
#include "client/view/shading/gloss_maps.h"
#include "client/view/shading/mirror.h"
#include "common/colour.h"
#include "common/lightmap/lightmap.h"
#include "common/scene/environment.h"
#include "common/shading/tangent.h"
#include "common/tile/bilinear.h"
#include "common/tile/fine_choice.h"

#include <omp.h>
#include <stddef.h>
#include <stdlib.h>
#include <string.h>

#define SCREEN_TILE 32u   /* pixels; the unit that a thread takes */
#define LISTED      1024u /* the same, of pixels in a list */
#define BLOCK       4u    /* pixels; one packet is BLOCK x BLOCK */

_Static_assert(LW_GLOSS_WIDTH == LW_TRACE_WIDTH, "finishes are worked out packet by packet");
_Static_assert(BLOCK *BLOCK == LW_TRACE_WIDTH, "a packet is one block of pixels");
_Static_assert(SCREEN_TILE == BLOCK * LW_DIRECT_PIXELS_SIDE,
               "direct light is worked out for one screen tile");
_Static_assert(LISTED == LW_DIRECT_PIXELS_BLOCKS * LW_TRACE_WIDTH, "or for as many pixels of a list");

/* A share of light that no 8-bit picture shows. */
#define TRANSMITTANCE_MIN 1e-4f
/* A mirror that shows less of what it sees is not worth a ray. */
#define MIRROR_MIN 2e-3f
/* Seen at a grazing angle a pixel covers a long strip; past this its level would only blur. */
#define COSINE_MIN 0.05f

#define SURVEY_MARGIN 1.4f /* a survey's picture is wider and higher than the view by this factor */
#define SURVEY_SIDE   128u /* pixels of its longer side */

/* A pixel of light, in the sums of what tiles show: whole numbers, so that no order of threads changes
 * them. */
#define PIXEL_LIGHT 256

/* One level of one object, with the pointers of this render. */
struct level {
    const float *rgb;       /* NULL: not there, or finer: its tiles are apart */
    const float *direction; /* where it comes from (direction_form.h); NULL: not known */
    uint32_t width, height;
    uint32_t tiles_x, first_tile; /* the tile's id in the scene; not of finer levels */
};

/* level[-k] is the level that is 2^k times finer. */
struct object {
    const struct level *level;
    int level_count, finer_count;
    bool has_fine; /* a tile of a finer level is here */
};

/* What pixels mirror by a ray. */
struct mirrored {
    uint16_t lanes;
    struct lw_vec3 origin[LW_TRACE_WIDTH], direction[LW_TRACE_WIDTH];
    struct lw_vec3 tint[LW_TRACE_WIDTH]; /* share of the ray's radiance that the eye sees */
    float width_m[LW_TRACE_WIDTH];       /* width of the lobe where the ray begins */
    float slope[LW_TRACE_WIDTH];         /* and how much more there is of it a metre */
};

/* Sixteen pixels on their way through the layers in front of them. */
struct packet {
    struct lw_ray16 rays;
    struct lw_vec3 radiance[LW_TRACE_WIDTH];
    struct lw_vec3
        reflects[LW_TRACE_WIDTH]; /* radiance that the eye sees of the layer at hand, over E there */
    struct lw_vec3 mirrors[LW_TRACE_WIDTH]; /* the same, over what the gloss mirrors; with a finish */
    float base[LW_TRACE_WIDTH];             /* E there, luminance */
    float transmittance[LW_TRACE_WIDTH];
    struct lw_vec3 tint[LW_TRACE_WIDTH]; /* on top of that */
    const struct lw_camera_plane *plane;
    bool listed; /* its pixels are from anywhere */
    struct mirrored mirrored;
    bool is_mirrored; /* its rays are those that another one mirrors; width_m and slope are its own */
    /* the layer that reflects most of the tiles' light to the eye: its luminance there, and its tile */
    float reflected[LW_TRACE_WIDTH];
    uint32_t tile[LW_TRACE_WIDTH];
};

/* The pixels of a packet. */
struct places {
    uint32_t x[LW_TRACE_WIDTH], y[LW_TRACE_WIDTH];
    uint16_t active; /* the others are not in the picture */
    bool listed;     /* they are no block */
};

/* A thread's memory where direct light is worked out: of one screen tile, or as many pixels of a list. */
struct worker {
    struct lw_direct_tile *tile;
    struct packet second[LW_DIRECT_PIXELS_BLOCKS]; /* what the packets mirror */
    struct places at[LW_DIRECT_PIXELS_BLOCKS];
    struct packet packet[LW_DIRECT_PIXELS_BLOCKS];
    uint16_t going[LW_DIRECT_PIXELS_BLOCKS];
};

struct lw_compose {
    const struct lw_scene *scene;
    const struct lw_atlas_map *map;
    const struct lw_trace *trace;
    int threads;
    bool unfiltered;

    struct level *level; /* of all objects */
    struct object *object;
    uint8_t **coarsest; /* per mesh, per triangle: the level at which it reads its own light alone */
    uint8_t *here;      /* per tile */
    const float **fine; /* per id of a finer level: the tile's texels of this render; NULL: not there */
    const float **fine_direction; /* the same of where its light comes from */
    uint8_t *noise_level;         /* per tile: the finest level at which its noise is bearable */
    uint8_t *needed;              /* per tile; written by all threads, only ever with 1 */
    uint8_t *around;              /* the same, by the last survey */
    uint64_t *shown; /* per tile: how much of the last render's light is its; PIXEL_LIGHT a pixel */
    float *survey;   /* its pixels, which nobody sees */

    uint64_t pixel_count; /* in the last render */
    bool surveys;         /* a survey shows nothing */

    struct lw_direct_pixels *direct; /* NULL: all light is in the tiles */
    const uint8_t *drawn_material;   /* per material: 1: its light is drawn; with direct alone */
    struct lw_place *place;          /* per object; with direct or finishes alone */
    struct worker *worker;           /* per thread; with direct alone */
    struct lw_ambient ambient;       /* with finishes alone */

    /* this render's */
    enum lw_show show;
    const struct lw_vec3 *tile_colour;
    const struct lw_pose *pose;
    bool finishes;       /* pixels of finished surfaces are worked out by their finish */
    bool mirrors;        /* and smooth ones mirror the room */
    bool has_directions; /* some light has a direction */
    struct lw_vec3 sky;
    struct lw_vec3 stand_in; /* irradiance where nothing at all has arrived */
    float mean;              /* irradiance of all light so far, luminance; 0: there is none */
};

static struct lw_client_level client_level(const void *context, uint32_t object, uint32_t level) {
    return lw_client_get_level(context, object, level);
}

static struct lw_client_tile client_tile(const void *context, lw_tile_id tile) {
    return lw_client_get_tile(context, tile);
}

struct lw_compose_source lw_compose_source_of(const struct lw_client *client) {
    struct lw_client_stats stats;
    lw_client_get_stats(client, &stats);
    return (struct lw_compose_source){.context = client,
                                      .level = client_level,
                                      .tile = client_tile,
                                      .sky = lw_vec3(stats.sky[0], stats.sky[1], stats.sky[2]),
                                      .bounces = stats.bounces,
                                      .target_error = stats.target_error,
                                      .noise_shown = stats.noise_shown};
}

_Static_assert(LW_LIGHTMAP_LEVEL_MAX == LW_ATLAS_READ_MAX, "charts are apart on all levels that views read");

static bool find_coarsest(struct lw_compose *compose) {
    bool found = true;
#pragma omp parallel for schedule(dynamic) num_threads(compose->threads) reduction(&& : found)
    for (uint32_t m = 0; m < compose->scene->mesh_count; m++) {
        const struct lw_mesh *mesh = &compose->scene->mesh[m];
        if (mesh->lightmap_uv == NULL || mesh->triangle_count == 0) continue;
        compose->coarsest[m] = malloc(mesh->triangle_count);
        found = found && compose->coarsest[m] && lw_lightmap_coarsest(mesh, compose->coarsest[m]) == LW_OK;
    }
    return found;
}

/* The number that atlases have for a level (atlas.h). */
static uint32_t number_of(int level) {
    return level < 0 ? LW_ATLAS_FINER + (uint32_t)-level : (uint32_t)level;
}

static void lay_out_levels(struct lw_compose *compose) {
    const struct lw_atlas_map *map = compose->map;
    struct level *level = compose->level;
    for (uint32_t o = 0; o < map->object_count; o++) {
        const struct lw_atlas *atlas = &map->atlas[o];
        const int finer = (int)atlas->finer_count, count = (int)atlas->level_count;
        compose->object[o] = (struct object){level + finer, count, finer, false};
        for (int k = -finer; k < count; k++) {
            const struct lw_atlas_level *at = lw_atlas_level(atlas, number_of(k));
            *level++ = (struct level){.width = at->width,
                                      .height = at->height,
                                      .tiles_x = at->tiles_x,
                                      .first_tile = k < 0 ? 0 : lw_atlas_map_first(map, o, number_of(k))};
        }
    }
}

static bool init_direct(struct lw_compose *compose, const struct lw_compose_desc *desc) {
    compose->worker = aligned_alloc(64, (size_t)compose->threads * sizeof *compose->worker);
    if (!compose->worker) return false;
    memset(compose->worker, 0, (size_t)compose->threads * sizeof *compose->worker);
    for (int i = 0; i < compose->threads; i++)
        if (lw_direct_tile_create(&compose->worker[i].tile) != LW_OK) return false;
    compose->drawn_material = desc->drawn->material;
    return lw_direct_pixels_create(&(struct lw_direct_pixels_desc){.scene = desc->scene,
                                                                   .trace = desc->trace,
                                                                   .drawn = desc->drawn,
                                                                   .threads = compose->threads},
                                   desc->pose, &compose->direct, NULL) == LW_OK;
}

enum lw_status lw_compose_create(const struct lw_compose_desc *desc, struct lw_compose **out_compose,
                                 struct lw_error *err) {
    const struct lw_atlas_map *map = desc->map;
    size_t level_count = 0;
    for (uint32_t o = 0; o < map->object_count; o++)
        level_count += map->atlas[o].level_count + map->atlas[o].finer_count;

    struct lw_compose *compose = calloc(1, sizeof *compose);
    if (compose == NULL) goto fail;
    compose->scene = desc->scene;
    compose->map = map;
    compose->trace = desc->trace;
    compose->unfiltered = desc->unfiltered;
    compose->threads = desc->threads ? (int)desc->threads : omp_get_max_threads();
    /* one more of each: an empty scene is no failure */
    compose->level = calloc(level_count + 1, sizeof *compose->level);
    compose->object = calloc((size_t)map->object_count + 1, sizeof *compose->object);
    compose->coarsest = calloc((size_t)desc->scene->mesh_count + 1, sizeof *compose->coarsest);
    compose->here = calloc((size_t)map->tile_count + 1, 1);
    compose->fine = calloc(lw_atlas_map_room(map) + 1ul, sizeof *compose->fine);
    compose->fine_direction = calloc(lw_atlas_map_room(map) + 1ul, sizeof *compose->fine_direction);
    compose->noise_level = calloc((size_t)map->tile_count + 1, 1);
    compose->needed = calloc((size_t)map->tile_count + 1, 1);
    compose->around = calloc((size_t)map->tile_count + 1, 1);
    compose->shown = calloc((size_t)map->tile_count + 1, sizeof *compose->shown);
    compose->place = calloc((size_t)desc->scene->object_count + 1, sizeof *compose->place);
    compose->survey = calloc((size_t)SURVEY_SIDE * SURVEY_SIDE * 3, sizeof *compose->survey);
    if (!compose->level || !compose->object || !compose->coarsest || !compose->here || !compose->fine ||
        !compose->fine_direction || !compose->noise_level || !compose->needed || !compose->around ||
        !compose->shown || !compose->survey || !compose->place)
        goto fail;
    if (!find_coarsest(compose)) goto fail;
    if (lw_client_lights_any(desc->drawn) && !init_direct(compose, desc)) goto fail;
    lay_out_levels(compose);
    *out_compose = compose;
    return LW_OK;
fail:
    lw_compose_destroy(compose);
    return lw_status_fail(err, LW_NO_MEMORY, "no memory for the view");
}

void lw_compose_destroy(struct lw_compose *compose) {
    if (compose == NULL) return;
    lw_direct_pixels_destroy(compose->direct);
    for (int i = 0; compose->worker != NULL && i < compose->threads; i++)
        lw_direct_tile_destroy(compose->worker[i].tile);
    lw_ambient_finish(&compose->ambient);
    free(compose->worker);
    free(compose->place);
    free(compose->shown);
    free(compose->needed);
    free(compose->noise_level);
    free(compose->fine);
    free(compose->fine_direction);
    free(compose->here);
    for (uint32_t m = 0; compose->coarsest != NULL && m < compose->scene->mesh_count; m++)
        free(compose->coarsest[m]);
    free(compose->coarsest);
    free(compose->around);
    free(compose->survey);
    free(compose->object);
    free(compose->level);
    free(compose);
}

/* False for NaN, too. */
static bool is_light(struct lw_vec3 c) {
    return c.x >= 0 && c.y >= 0 && c.z >= 0 && c.x < INFINITY && c.y < INFINITY && c.z < INFINITY;
}

/* The average over the objects' coarsest levels that have arrived; before the first, light that shows a
 * surface as its albedo. */
static struct lw_vec3 average_irradiance(const struct lw_compose *compose, bool *out_known) {
    double sum[3] = {0}, count = 0;
    for (uint32_t o = 0; o < compose->map->object_count; o++) {
        const struct object *object = &compose->object[o];
        if (object->level_count == 0) continue;
        const struct level *coarsest = &object->level[object->level_count - 1];
        if (coarsest->rgb == NULL || !compose->here[coarsest->first_tile]) continue;
        for (size_t i = 0; i < (size_t)coarsest->width * coarsest->height; i++) {
            struct lw_vec3 e =
                lw_vec3(coarsest->rgb[3 * i], coarsest->rgb[3 * i + 1], coarsest->rgb[3 * i + 2]);
            if (!is_light(e)) continue;
            sum[0] += (double)e.x, sum[1] += (double)e.y, sum[2] += (double)e.z;
            count += 1;
        }
    }
    *out_known = count > 0 && sum[0] + sum[1] + sum[2] > 0;
    if (*out_known) return lw_vec3((float)(sum[0] / count), (float)(sum[1] / count), (float)(sum[2] / count));
    return lw_vec3(LW_PI, LW_PI, LW_PI);
}

static bool is_finished(const struct lw_material *material) { return material->finish && !material->unlit; }

/* Whether any material has a finish, or all surfaces are shown as if they had one. */
static bool find_finishes(const struct lw_compose *compose) {
    if (lw_show_is_of_finish(compose->show)) return true;
    for (uint32_t m = 0; m < compose->scene->material_count; m++)
        if (is_finished(&compose->scene->material[m])) return true;
    return false;
}

static void place_objects(struct lw_compose *compose) {
    for (uint32_t o = 0; o < compose->scene->object_count; o++)
        compose->place[o] = lw_place_of(&compose->pose->object_to_world[o]);
}

static void begin(struct lw_compose *compose, const struct lw_compose_source *source,
                  const struct lw_pose *pose) {
    const struct lw_atlas_map *map = compose->map;
    for (uint32_t o = 0; o < map->object_count; o++) compose->object[o].has_fine = false;
    for (uint32_t t = 0; t < map->tile_count; t++) {
        struct lw_client_tile tile = source->tile(source->context, (lw_tile_id){t});
        compose->here[t] = tile.version != 0;
        compose->noise_level[t] =
            compose->unfiltered ? 0 : (uint8_t)lw_atlas_noise_level_min(tile.error, source->noise_shown);
        if (t < map->plain_count) continue;
        compose->fine[t - map->plain_count] = tile.rgb;
        compose->fine_direction[t - map->plain_count] = tile.direction;
        if (compose->here[t]) compose->object[map->place[t].object].has_fine = true;
    }
    struct level *level = compose->level;
    compose->has_directions = false;
    for (uint32_t o = 0; o < map->object_count; o++) {
        level += compose->object[o].finer_count;
        for (uint32_t k = 0; (int)k < compose->object[o].level_count; k++, level++) {
            struct lw_client_level there = source->level(source->context, o, k);
            const bool fits = there.width == level->width && there.height == level->height;
            level->rgb = fits ? there.rgb : NULL;
            level->direction = fits ? there.direction : NULL;
            compose->has_directions |= level->direction != NULL;
        }
    }
    memset(compose->needed, 0, map->tile_count);
    compose->pose = pose;
    compose->sky = source->sky;
    bool known;
    compose->stand_in = average_irradiance(compose, &known);
    compose->mean = known ? lw_colour_luminance(compose->stand_in) : 0;
    compose->finishes = find_finishes(compose);
    if (!compose->finishes) return;
    place_objects(compose);
    /* without memory for it nothing is mirrored of the environment but what E tells */
    if (lw_ambient_take(&compose->ambient, &compose->scene->environment) != LW_OK) return;
}

/* The texels that a bilinear lookup reads, how it weighs them, and the tiles that hold them. */
struct footprint {
    struct lw_bilinear x, y;
    uint32_t tile[4];    /* UINT32_MAX: a tile of a finer level that has no id */
    unsigned tile_count; /* 1 where all are in one tile, else 4: the same id more than once in most cases */
};

/* Texels of a level along one of level 0. */
static float scale_of(int k) { return k < 0 ? (float)(1u << -k) : 1.0f / (float)(1u << k); }

static inline void footprint_at(const struct level *level, int k, struct lw_vec2 uv, struct footprint *f) {
    const float scale = scale_of(k);
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
#define FINE_IDS 8u

struct fine_ids {
    struct fine_id {
        uint32_t object, level, x, y, id; /* level 0: nothing is known */
    } known[FINE_IDS];
};

/* The id of such a tile, which gets one; UINT32_MAX: none is left. */
static uint32_t fine_id(const struct lw_compose *compose, struct fine_ids *ids, uint32_t object, int k,
                        uint32_t x, uint32_t y) {
    const uint32_t level = number_of(k);
    struct fine_id *known = &ids->known[(object + 3 * x + 5 * y + level) % FINE_IDS];
    if (known->object != object || known->level != level || known->x != x || known->y != y)
        *known =
            (struct fine_id){object, level, x, y, lw_atlas_map_claim(compose->map, object, level, x, y).v};
    return known->id;
}

/* The same as footprint_at() of a finer level. False: no id is left for what it reads. */
static bool fine_footprint_at(const struct lw_compose *compose, struct fine_ids *ids, uint32_t object, int k,
                              struct lw_vec2 uv, struct footprint *f) {
    const struct level *level = &compose->object[object].level[k];
    footprint_at(level, k, uv, f);
    const uint32_t x[2] = {f->x.low / LW_TILE_SIDE, f->x.high / LW_TILE_SIDE},
                   y[2] = {f->y.low / LW_TILE_SIDE, f->y.high / LW_TILE_SIDE};
    bool known = true;
    for (unsigned i = 0; i < f->tile_count; i++) {
        f->tile[i] = fine_id(compose, ids, object, k, x[i & 1], y[i >> 1]);
        known &= f->tile[i] != UINT32_MAX;
    }
    return known;
}

/* The same, but gives out no ids: false where a tile has none. */
static bool find_fine_footprint(const struct lw_compose *compose, uint32_t object, int k, struct lw_vec2 uv,
                                struct footprint *f) {
    footprint_at(&compose->object[object].level[k], k, uv, f);
    const uint32_t x[2] = {f->x.low / LW_TILE_SIDE, f->x.high / LW_TILE_SIDE},
                   y[2] = {f->y.low / LW_TILE_SIDE, f->y.high / LW_TILE_SIDE};
    for (unsigned i = 0; i < f->tile_count; i++) {
        f->tile[i] = lw_atlas_map_find(compose->map, object, number_of(k), x[i & 1], y[i >> 1]).v;
        if (f->tile[i] == UINT32_MAX) return false;
    }
    return true;
}

static size_t texel_index(const struct level *level, uint32_t x, uint32_t y) {
    return 3 * ((size_t)y * level->width + x);
}

static struct lw_vec3 vector_at(const float *from, size_t at) {
    return lw_vec3(from[at], from[at + 1], from[at + 2]);
}

static struct lw_vec3 texel(const struct level *level, uint32_t x, uint32_t y) {
    return vector_at(level->rgb, texel_index(level, x, y));
}

static struct lw_vec3 mix(struct lw_vec3 a, struct lw_vec3 b, float t) {
    return lw_vec3_mad(a, lw_vec3_sub(b, a), t);
}

static bool is_here(const struct lw_compose *compose, const struct footprint *f) {
    for (unsigned i = 0; i < f->tile_count; i++)
        if (f->tile[i] == UINT32_MAX || !compose->here[f->tile[i]]) return false;
    return true;
}

/* Light that is read: irradiance, and where it comes from; the latter 0 where that is not known. */
struct light {
    struct lw_vec3 e, direction;
};

/* Blends the texels of a footprint: the upper two from left to right, then the lower two. */
static inline struct lw_vec3 blend(const struct footprint *f, const float *from, const size_t at[4]) {
    const struct lw_vec3 upper = mix(vector_at(from, at[0]), vector_at(from, at[1]), f->x.share),
                         lower = mix(vector_at(from, at[2]), vector_at(from, at[3]), f->x.share);
    return mix(upper, lower, f->y.share);
}

/* Reads one level that is not finer. False: a tile of the footprint is not there, or its texels are no
 * light. */
static bool read_level(const struct lw_compose *compose, const struct level *level, const struct footprint *f,
                       struct light *out) {
    if (level->rgb == NULL || !is_here(compose, f)) return false;
    const size_t at[4] = {texel_index(level, f->x.low, f->y.low), texel_index(level, f->x.high, f->y.low),
                          texel_index(level, f->x.low, f->y.high), texel_index(level, f->x.high, f->y.high)};
    out->e = blend(f, level->rgb, at);
    out->direction = level->direction ? blend(f, level->direction, at) : lw_vec3(0, 0, 0);
    return is_light(out->e);
}

/* Blends the texels of a footprint of a finer level. of: by id, the tiles' texels; where a tile has none they
 * are 0. */
static struct lw_vec3 blend_fine(const struct lw_compose *compose, const float *const *of,
                                 const struct level *level, const struct footprint *f) {
    const uint32_t x[2] = {f->x.low, f->x.high}, y[2] = {f->y.low, f->y.high};
    float texel[12] = {0};
    for (unsigned i = 0; i < 4; i++) {
        const float *tile = of[f->tile[f->tile_count == 1 ? 0 : i] - compose->map->plain_count];
        const uint32_t left = x[i & 1] / LW_TILE_SIDE * LW_TILE_SIDE,
                       width = level->width - left < LW_TILE_SIDE ? level->width - left : LW_TILE_SIDE;
        if (tile) memcpy(texel + 3 * i, tile + 3 * (y[i >> 1] % LW_TILE_SIDE * width + x[i & 1] - left), 12);
    }
    return blend(f, texel, (const size_t[4]){0, 3, 6, 9});
}

/* The same as read_level() of a finer level. */
static bool read_fine(const struct lw_compose *compose, const struct level *level, const struct footprint *f,
                      struct light *out) {
    if (!is_here(compose, f)) return false;
    out->e = blend_fine(compose, compose->fine, level, f);
    out->direction =
        compose->has_directions ? blend_fine(compose, compose->fine_direction, level, f) : lw_vec3(0, 0, 0);
    return is_light(out->e);
}

static void mark_needed(struct lw_compose *compose, const struct footprint *f) {
    for (unsigned i = 0; i < f->tile_count; i++)
        /* all threads write the same value: the result does not depend on their order */
        if (!__atomic_load_n(&compose->needed[f->tile[i]], __ATOMIC_RELAXED))
            __atomic_store_n(&compose->needed[f->tile[i]], 1, __ATOMIC_RELAXED);
}

/* What stands in for a level: the next coarser one that can be read, or else a finer one. */
static struct light stand_in(const struct lw_compose *compose, const struct object *object, int first,
                             struct lw_vec2 uv, int *out_level) {
    struct light light;
    struct footprint f;
    for (int k = first; k < object->level_count; k++) {
        footprint_at(&object->level[k], k, uv, &f);
        *out_level = k;
        if (read_level(compose, &object->level[k], &f, &light)) return light;
    }
    for (int k = first - 1; k >= 0; k--) {
        footprint_at(&object->level[k], k, uv, &f);
        *out_level = k;
        if (read_level(compose, &object->level[k], &f, &light)) return light;
    }
    *out_level = (int)LW_ATLAS_LEVELS_MAX;
    return (struct light){.e = compose->stand_in};
}

/* A triangle that pixels meet. */
struct patch {
    uint32_t object, triangle;
    uint32_t packet; /* the last one that met it */
    struct lw_facet facet;
    struct lw_vec3 normal; /* world space; twice the triangle's area long */
    float grazing;         /* COSINE_MIN of that */
    float texels;          /* texels of level 0 on twice the triangle */
    int coarsest;          /* no coarser level serves */
    /* with direct light or finishes: */
    bool flat;                /* all normals are the face's */
    struct lw_vec3 corner[3]; /* world space, m; with direct light alone, as the next but one */
    struct lw_vec3 face;      /* unit normal */
    float largest_m;          /* for lw_trace_lift() */
    /* a surface that is shaded by a finish has these: */
    bool sound;  /* the mean of the corners' normals is on the face's side wherever it is */
    bool simple; /* gloss_maps.h reads its base colour, and nothing else of it varies */
    bool bumpy;
    struct lw_gloss_corner finish[3];
    float turn; /* handedness of the normal map */
};

/* Whether corners' normals are the face's, but for rounding. */
static bool is_flat(const struct lw_mesh *mesh, const uint32_t vertex[3], struct lw_vec3 face) {
    for (int k = 0; k < 3; k++)
        if (!(lw_vec3_dot(mesh->normal[vertex[k]], face) > 0.99999f)) return false;
    return true;
}

/* What of a triangle the points that light arrives at are made of. */
static void place_patch(const struct lw_compose *compose, uint32_t o, const struct lw_mesh *mesh,
                        struct lw_vec3 normal_os, struct patch *out) {
    const struct lw_place *place = &compose->place[o];
    const uint32_t *vertex = out->facet.vertex;
    float largest = 0;
    out->flat = is_flat(mesh, vertex, lw_vec3_normalize(normal_os));
    out->face = lw_vec3_normalize(out->normal);
    for (int k = 0; k < 3; k++) {
        out->corner[k] = lw_affine_point(&place->to_world, mesh->position[vertex[k]]);
        largest = fmaxf(largest, lw_vec3_max_abs(mesh->position[vertex[k]]));
    }
    out->largest_m = place->growth * largest + place->shift_m;
}

/* Whether a surface is shaded by its finish. */
static bool shades_finish(const struct lw_compose *compose, const struct lw_material *material) {
    return compose->finishes && !compose->surveys &&
           (is_finished(material) || lw_show_is_of_finish(compose->show));
}

static void turn_patch(const struct lw_affine *to_world, const struct lw_mesh *mesh, struct patch *out) {
    const uint16_t *code = mesh->tangent + 3 * (size_t)out->triangle;
    float turn = 1;
    for (int k = 0; k < 3; k++) {
        const struct lw_vec4 t = lw_tangent_decode(code[k], mesh->normal[out->facet.vertex[k]]);
        const struct lw_vec3 tangent = lw_affine_vector(to_world, lw_vec3(t.x, t.y, t.z));
        out->finish[k].tangent += (lw_gloss_float4){tangent.x, tangent.y, tangent.z, 0};
        turn = t.w;
    }
    out->turn = lw_affine_determinant(to_world) < 0 ? -turn : turn;
}

/* Whether its base colour is factor and texture alone, and its emission the same everywhere. */
static bool is_simple(const struct lw_mesh *mesh, const struct lw_material *material) {
    return is_finished(material) && material->alpha_mode == LW_ALPHA_OPAQUE && !mesh->colour &&
           (material->emission_texture.texture == LW_SCENE_NONE || !lw_material_shines(material));
}

/* lw_scene_light_normal() takes the face where a shading normal's cosine with it is not above 0.01. */
#define SOUND_MIN 0.011f

/* What the finishes of a triangle's points are made of. */
static void finish_patch(const struct lw_compose *compose, uint32_t o, const struct lw_mesh *mesh,
                         struct lw_vec3 normal_os, struct patch *out) {
    const struct lw_place *place = &compose->place[o];
    const struct lw_vec3 face = lw_vec3_normalize(normal_os);
    const struct lw_material *material = out->facet.material;
    out->simple = is_simple(mesh, material);
    out->bumpy =
        mesh->tangent && is_finished(material) && material->finish->normal_texture.texture != LW_SCENE_NONE;
    out->face = lw_vec3_normalize(out->normal);
    out->sound = true;
    for (int k = 0; k < 3; k++) {
        const uint32_t v = out->facet.vertex[k];
        const struct lw_vec2 none = {0, 0}, first = mesh->uv[0] ? mesh->uv[0][v] : none,
                             second = mesh->uv[1] ? mesh->uv[1][v] : none;
        const struct lw_vec3 normal = lw_affine_vector(&place->to_normal, mesh->normal[v]);
        out->sound &= lw_vec3_dot(mesh->normal[v], face) > SOUND_MIN;
        out->finish[k].normal = (lw_gloss_float4){normal.x, normal.y, normal.z, first.x};
        out->finish[k].tangent = (lw_gloss_float4){0, 0, 0, first.y};
        out->finish[k].second = (lw_gloss_float4){second.x, second.y, 0, 0};
    }
    out->turn = 1;
    if (out->bumpy) turn_patch(&place->to_world, mesh, out);
}

static void find_patch(const struct lw_compose *compose, uint32_t o, uint32_t triangle, struct patch *out) {
    const uint32_t m = compose->scene->object[o].mesh;
    const struct lw_mesh *mesh = &compose->scene->mesh[m];
    out->object = o;
    out->triangle = triangle;
    lw_scene_facet(compose->scene, mesh, triangle, &out->facet);
    const uint32_t *vertex = out->facet.vertex;
    const struct lw_vec2 *uv = out->facet.lightmap_uv;
    struct lw_vec3 a = lw_vec3_sub(mesh->position[vertex[1]], mesh->position[vertex[0]]);
    struct lw_vec3 b = lw_vec3_sub(mesh->position[vertex[2]], mesh->position[vertex[0]]);
    struct lw_vec3 normal_os = lw_vec3_cross(a, b);
    out->normal = lw_affine_cofactor_normal(&compose->pose->object_to_world[o], normal_os);
    out->grazing = COSINE_MIN * lw_vec3_length(out->normal);
    out->texels = fabsf(lw_vec2_twice_area(uv[0], uv[1], uv[2]));
    out->coarsest =
        compose->coarsest[m] && lw_vec3_length(normal_os) > 1e-30f ? compose->coarsest[m][triangle] : 0;
    const bool finished = shades_finish(compose, out->facet.material);
    if (compose->direct || (compose->mirrors && finished)) place_patch(compose, o, mesh, normal_os, out);
    if (finished) finish_patch(compose, o, mesh, normal_os, out);
}

/* The level of which a texel is as large as the pixel where its ray meets the surface, or smaller; of finer
 * ones, LW_FINE_CHOICE_PIXELS as large or larger. pixel_m^2 texels / (area cosine) texels of level 0 are
 * under a pixel, a quarter of it of level 1; no division is needed to tell which is one or less. */
static int level_for(const struct patch *patch, int finer, struct lw_vec3 dir, float pixel_m) {
    const float length = lw_vec3_length(dir), slanted = fabsf(lw_vec3_dot(patch->normal, dir));
    const float least = patch->grazing * length, area = slanted > least ? slanted : least;
    float texels = pixel_m * pixel_m * patch->texels * length;
    int level = 0;
    for (; level < patch->coarsest && texels >= 4 * area && texels > 0; level++) texels *= 0.25f;
    return level ? level : -lw_fine_choice(texels, area, finer);
}

/* Neighbouring pixels mostly meet the same few triangles: those met last, by a hash. */
#define PATCHES 64u
_Static_assert(PATCHES >= 2 * LW_TRACE_WIDTH, "a packet always finds a place");

struct patches {
    uint32_t packet; /* the number of this one */
    struct patch patch[PATCHES];
    struct fine_ids fine;
};

/* Good for the rest of the packet. */
static const struct patch *patch_of(const struct lw_compose *compose, struct patches *all, uint32_t object,
                                    uint32_t triangle) {
    for (uint32_t slot = triangle + 29u * object;; slot++) {
        struct patch *patch = &all->patch[slot % PATCHES];
        const bool same = patch->triangle == triangle && patch->object == object;
        if (!same && patch->packet == all->packet) continue;
        if (!same) find_patch(compose, object, triangle, patch);
        patch->packet = all->packet;
        return patch;
    }
}

/* A hit, with all that is read of it on the way into the cache. */
struct look {
    const struct patch *patch; /* NULL: the ray met nothing */
    const struct object *object;
    float weight[3];
    struct lw_texture_quad texels;
    struct lw_vec2 uv;          /* lightmap's */
    int finest;                 /* level that serves */
    int level;                  /* asked for */
    struct footprint footprint; /* in the level asked for */
};

/* Whether a look-up of level 0 reads even light: a finer level would show the same. Noisy texels, and tiles
 * that have not come yet, count as even. */
static bool is_even(const struct lw_compose *compose, const struct level *level, const struct footprint *f) {
    if (level->rgb == NULL || compose->noise_level[f->tile[0]]) return true;
    for (unsigned i = 0; i < f->tile_count; i++)
        if (!compose->here[f->tile[i]]) return true;
    const uint32_t x[2] = {f->x.low, f->x.high}, y[2] = {f->y.low, f->y.high};
    float luminance[4];
    for (int i = 0; i < 4; i++) luminance[i] = lw_colour_luminance(texel(level, x[i & 1], y[i >> 1]));
    return lw_fine_choice_is_even(luminance);
}

/* What a ray stands for where it meets a surface: a pixel, or the lobe of a mirror. */
static float width_at(const struct packet *p, unsigned i, float t) {
    return p->is_mirrored ? p->mirrored.width_m[i] + p->mirrored.slope[i] * t
                          : lw_camera_pixel_at(p->plane, t);
}

/* Finds out what a hit is to be shaded from, and starts to fetch it. */
static void look_at(const struct lw_compose *compose, struct patches *patches, const struct packet *p,
                    const struct lw_hit16 *hits, unsigned i, struct look *out) {
    out->patch = NULL;
    if (hits->object[i] == LW_TRACE_MISS) return;
    const struct patch *patch = patch_of(compose, patches, hits->object[i], hits->triangle[i]);
    const struct lw_facet *facet = &patch->facet;
    out->patch = patch;
    out->weight[0] = 1 - hits->u[i] - hits->v[i];
    out->weight[1] = hits->u[i];
    out->weight[2] = hits->v[i];
    const bool maps_read = shades_finish(compose, facet->material) && patch->simple;
    if (facet->varies && !maps_read) lw_scene_facet_texels(compose->scene, facet, out->weight, &out->texels);

    const struct object *object = &compose->object[hits->object[i]];
    out->object = object;
    if (object->level_count == 0) return;
    out->uv = lw_scene_facet_mean(facet->lightmap_uv, out->weight);
    if (hits->back[i]) out->uv.y += (float)facet->mesh->back_offset;
    const struct lw_vec3 dir = lw_vec3(p->rays.dir_x[i], p->rays.dir_y[i], p->rays.dir_z[i]);
    const int level =
        level_for(patch, p->is_mirrored ? 0 : object->finer_count, dir, width_at(p, i, hits->t[i]));
    out->finest = level < object->level_count ? level : object->level_count - 1;
    out->level = out->finest;
    if (out->level < 0 && patch->texels >= LW_FINE_CHOICE_TEXELS) {
        footprint_at(&object->level[0], 0, out->uv, &out->footprint);
        if (is_even(compose, &object->level[0], &out->footprint)) out->level = 0;
    }
    if (out->level < 0 &&
        fine_footprint_at(compose, &patches->fine, hits->object[i], out->level, out->uv, &out->footprint))
        return;
    if (out->level < 0) out->level = 0;
    const struct level *finest = &object->level[out->level];
    footprint_at(finest, out->level, out->uv, &out->footprint);
    if (finest->rgb == NULL) return;
    const size_t upper = texel_index(finest, out->footprint.x.low, out->footprint.y.low),
                 lower = texel_index(finest, out->footprint.x.low, out->footprint.y.high);
    __builtin_prefetch(finest->rgb + upper);
    __builtin_prefetch(finest->rgb + lower);
    if (!finest->direction) return;
    __builtin_prefetch(finest->direction + upper);
    __builtin_prefetch(finest->direction + lower);
}

/* Reads the finest of the finer levels that is there, asked for or not, and has less noise than would be
 * seen; false: none. */
static bool read_finer(const struct lw_compose *compose, const struct look *look, struct light *out,
                       int *out_level) {
    struct footprint f = look->footprint;
    for (int k = look->finest; k < 0; k++) {
        const struct level *level = &look->object->level[k];
        if (k != look->level && !find_fine_footprint(compose, look->patch->object, k, look->uv, &f)) continue;
        *out_level = k;
        if (!compose->noise_level[f.tile[0]] && read_fine(compose, level, &f, out)) return true;
    }
    return false;
}

/* out_level: that it is read at; LW_ATLAS_LEVELS_MAX: none */
static struct light light_at(struct lw_compose *compose, const struct look *look, int *out_level) {
    const struct object *object = look->object;
    struct footprint f = look->footprint;
    struct light light;
    *out_level = (int)LW_ATLAS_LEVELS_MAX;
    if (object->level_count == 0) return (struct light){.e = compose->stand_in};
    mark_needed(compose, &look->footprint);
    if (object->has_fine && read_finer(compose, look, &light, out_level)) return light;
    const int wanted = look->level < 0 ? 0 : look->level;
    if (wanted != look->level) footprint_at(&object->level[0], 0, look->uv, &f);
    /* Fresh light is noise, but a texel of level 2 is the mean of 4 x 4: until the error has fallen, less is
     * more. */
    const int last = object->level_count - 1, noise_level = compose->noise_level[f.tile[0]];
    int level = noise_level < look->patch->coarsest ? noise_level : look->patch->coarsest;
    if (level > last) level = last;
    *out_level = wanted;
    if (level <= wanted && read_level(compose, &object->level[wanted], &f, &light)) return light;
    return stand_in(compose, object, level > wanted ? level : wanted, look->uv, out_level);
}

static struct lw_vec3 grey(float value) { return lw_vec3(value, value, value); }

/* The colour of a chart at a hit; level: that its light is read at. */
static struct lw_vec3 chart(const struct lw_compose *compose, const struct look *look, int level) {
    const uint32_t tile = look->footprint.tile[0];
    if (look->object->level_count == 0) return grey(LW_SHOW_UNLIT);
    if (lw_show_is_of_tiles(compose->show)) return compose->tile_colour[tile];
    if (compose->show == LW_SHOW_LEVEL) return lw_show_level_colour(level);
    if (level >= look->object->level_count) return grey(LW_SHOW_UNLIT);
    const float scale = scale_of(level);
    const int64_t x = (int64_t)floorf(look->uv.x * scale), y = (int64_t)floorf(look->uv.y * scale);
    return grey((x + y) & 1 ? LW_SHOW_BRIGHT : LW_SHOW_DARK);
}

/* What a hit sends to the eye, of what the view shows. reflects: the albedo, set to what of the lights' light
 * that are drawn it shows. */
static struct lw_vec3 leaving(const struct lw_compose *compose, const struct look *look,
                              struct lw_vec3 emission, struct lw_vec3 reflected, struct lw_vec3 e, int level,
                              struct lw_vec3 *reflects) {
    switch (compose->show) {
    case LW_SHOW_ALL:
        return lw_vec3_add(reflected, emission);
    case LW_SHOW_DIRECT:
        return emission;
    case LW_SHOW_INDIRECT:
        *reflects = grey(0);
        return reflected;
    case LW_SHOW_IRRADIANCE:
        *reflects = grey(1);
        return lw_vec3_scale(e, 1.0f / LW_PI);
    default:
        *reflects = grey(0);
        return chart(compose, look, level);
    }
}

/* The sky behind all surfaces. */
static struct lw_vec3 behind(const struct lw_compose *compose, struct lw_vec3 direction) {
    if (lw_show_is_chart(compose->show)) return grey(LW_SHOW_BEHIND);
    if (compose->show == LW_SHOW_INDIRECT || compose->show == LW_SHOW_IRRADIANCE) return grey(0);
    return lw_vec3_add(compose->sky, lw_environment_radiance(&compose->scene->environment, direction));
}

/* The point of a surface that a pixel shows, as rays of light start there. */
static struct lw_place_point point_of(const struct lw_compose *compose, const struct look *look,
                                      const struct lw_hit16 *hits, unsigned i) {
    const struct patch *patch = look->patch;
    const struct lw_mesh *mesh = patch->facet.mesh;
    if (patch->flat) {
        const struct lw_vec3 face = lw_vec3_scale(patch->face, hits->back[i] ? -1.0f : 1.0f);
        struct lw_vec3 at = lw_vec3_scale(patch->corner[0], look->weight[0]);
        at = lw_vec3_mad(at, patch->corner[1], look->weight[1]);
        at = lw_vec3_mad(at, patch->corner[2], look->weight[2]);
        return (struct lw_place_point){lw_trace_lift(at, face, patch->largest_m), face, face};
    }
    struct lw_surface surface;
    surface.normal =
        lw_scene_normal(mesh, patch->triangle, hits->u[i], hits->v[i], &surface.geometric_normal);
    return lw_place_point(&compose->place[patch->object], mesh, hits, i, &surface);
}

/* The normal of a surface's point, on the side that was met. */
static struct lw_vec3 facing_of(const struct lw_compose *compose, const struct look *look,
                                const struct lw_hit16 *hits, unsigned i) {
    const struct patch *patch = look->patch;
    struct lw_vec3 face;
    const struct lw_vec3 normal =
        lw_scene_normal(patch->facet.mesh, patch->triangle, hits->u[i], hits->v[i], &face);
    const struct lw_vec3 turned =
        lw_affine_vector(&compose->place[patch->object].to_normal, lw_scene_light_normal(normal, face));
    return lw_vec3_scale(lw_vec3_normalize(turned), hits->back[i] ? -1.0f : 1.0f);
}

/* The lanes of a packet that have met surfaces with a finish. */
struct finished {
    struct lw_gloss16 gloss;
    struct lw_gloss_uv16 uv;
    float side[LW_TRACE_WIDTH];
    float e[3][LW_TRACE_WIDTH], direction[3][LW_TRACE_WIDTH];
    struct lw_gloss_corner mean[LW_TRACE_WIDTH];
    uint16_t lanes;
    uint16_t exact;                              /* lanes whose normals differ from the mean's */
    struct lw_place_point point[LW_TRACE_WIDTH]; /* from here on of those lanes alone */
    struct lw_vec3 base[LW_TRACE_WIDTH];         /* where the patch is not simple */
    struct lw_gloss_seen16 seen;
    struct lw_vec3 factor[LW_TRACE_WIDTH]; /* how much of the leaving light the eye sees */
    float weight[LW_TRACE_WIDTH];          /* the same without colour */
    struct lw_vec3 emission[LW_TRACE_WIDTH];
    int level[LW_TRACE_WIDTH];     /* e is read at it */
    float width_m[LW_TRACE_WIDTH]; /* what the ray stands for there */
};

static struct lw_vec3 lane(const float (*from)[LW_TRACE_WIDTH], unsigned i) {
    return lw_vec3(from[0][i], from[1][i], from[2][i]);
}

static void set_lane(float (*to)[LW_TRACE_WIDTH], unsigned i, struct lw_vec3 v) {
    to[0][i] = v.x, to[1][i] = v.y, to[2][i] = v.z;
}

/* Notes a hit for shade_finished(). surface: its alpha and emission; its base where it is not simple */
static void take_finish(struct lw_compose *compose, const struct packet *p, const struct look *look,
                        const struct lw_hit16 *hits, unsigned i, const struct lw_surface *surface,
                        float weight, struct finished *f) {
    const struct patch *patch = look->patch;
    if (f->lanes == 0) {
        memset(f->mean, 0, sizeof f->mean), memset(f->side, 0, sizeof f->side), memset(f->e, 0, sizeof f->e);
        memset(f->direction, 0, sizeof f->direction);
        f->exact = 0;
    }
    f->lanes |= (uint16_t)(1u << i);
    f->mean[i] = lw_gloss_maps_mean(patch->finish, look->weight);
    f->side[i] = hits->back[i] ? -1 : 1;
    const bool placed = compose->direct || compose->mirrors;
    if (placed)
        f->point[i] = point_of(compose, look, hits, i);
    else if (!patch->sound)
        f->point[i].normal = facing_of(compose, look, hits, i);
    f->width_m[i] = width_at(p, i, hits->t[i]);
    if (placed || !patch->sound) f->exact |= (uint16_t)(1u << i);
    f->base[i] = surface->base;
    f->weight[i] = weight;
    f->factor[i] = lw_vec3_scale(p->tint[i], weight);
    f->emission[i] = surface->emission;
    const struct light light = light_at(compose, look, &f->level[i]);
    set_lane(f->e, i, light.e);
    set_lane(f->direction, i, light.direction);
}

/* Lanes of the same finish, all of which is read the same way. */
static uint16_t lanes_like(const struct look look[LW_TRACE_WIDTH], uint32_t lanes, unsigned first) {
    const struct patch *like = look[first].patch;
    uint16_t same = 0;
    for (uint32_t left = lanes; left; left &= left - 1) {
        const unsigned i = (unsigned)__builtin_ctz(left);
        const struct patch *patch = look[i].patch;
        const bool is = patch == like || (patch->facet.material == like->facet.material &&
                                          patch->simple == like->simple && patch->bumpy == like->bumpy);
        if (is) same |= (uint16_t)(1u << i);
    }
    return same;
}

/* Reads the finishes of all lanes. */
static void read_finishes(const struct lw_compose *compose, const struct packet *p,
                          const struct look look[LW_TRACE_WIDTH], struct finished *f) {
    struct lw_gloss16 *g = &f->gloss;
    lw_gloss_maps_begin(f->mean, f->side, g, &f->uv);
    for (unsigned i = 0; i < LW_TRACE_WIDTH; i++)
        g->to_eye[0][i] = -p->rays.dir_x[i], g->to_eye[1][i] = -p->rays.dir_y[i],
        g->to_eye[2][i] = -p->rays.dir_z[i];
    for (uint32_t left = f->lanes; left;) {
        const unsigned first = (unsigned)__builtin_ctz(left);
        const struct patch *patch = look[first].patch;
        const uint16_t same = lanes_like(look, left, first);
        const unsigned what =
            (patch->bumpy ? LW_GLOSS_MAPS_BUMPS : 0u) | (patch->simple ? LW_GLOSS_MAPS_BASE : 0u);
        left &= ~(uint32_t)same;
        if (is_finished(patch->facet.material))
            lw_gloss_maps_take(g, same, compose->scene, patch->facet.material, what, &f->uv);
    }
    for (uint32_t left = f->lanes; left; left &= left - 1) {
        const unsigned i = (unsigned)__builtin_ctz(left);
        if (!look[i].patch->simple) set_lane(g->base, i, f->base[i]);
        if (f->exact >> i & 1u) set_lane(g->plain, i, f->point[i].normal);
        g->turn[i] = look[i].patch->turn;
    }
}

/* A chart of a lane's finish. */
static struct lw_vec3 finish_chart(const struct lw_compose *compose, const struct finished *f, unsigned i) {
    if (compose->show == LW_SHOW_NORMALS) return lw_show_normal_colour(lane(f->seen.normal, i));
    return grey(compose->show == LW_SHOW_ROUGHNESS ? f->seen.roughness[i] : f->seen.metalness[i]);
}

/* Lanes whose quads are of one object. */
static uint16_t find_quads(const struct look look[LW_TRACE_WIDTH], uint16_t lanes) {
    uint16_t quads = 0;
    for (unsigned q = 0; q < 4; q++) {
        const unsigned first = (q & 1) * 2 + (q >> 1) * 8, quad = 0x33u << first;
        if ((lanes & quad) != quad) continue;
        const uint32_t object = look[first].patch->object;
        if (look[first + 1].patch->object == object && look[first + 4].patch->object == object &&
            look[first + 5].patch->object == object)
            quads |= (uint16_t)quad;
    }
    return quads;
}

static void fill(float value, float out[16]) {
    for (unsigned i = 0; i < LW_TRACE_WIDTH; i++) out[i] = value;
}

/* Chooses lanes that mirror by a ray. out_kept: for lw_gloss_ambient16(). A lane has one ray: the first
 * layer's. */
static void choose_mirrors(const struct lw_compose *compose, struct packet *p, const struct finished *f,
                           float out_kept[LW_TRACE_WIDTH]) {
    const struct lw_gloss_seen16 *seen = &f->seen;
    fill(1, out_kept);
    if (!compose->mirrors || p->is_mirrored) return;
    for (uint32_t left = f->lanes & ~p->mirrored.lanes; left; left &= left - 1) {
        const unsigned i = (unsigned)__builtin_ctz(left);
        const float share = lw_mirror_share(seen->roughness[i]);
        const struct lw_vec3 of = lane(seen->mirrored, i),
                             tint = lw_vec3_scale(lw_vec3_mul(f->factor[i], of), share);
        if (!(lw_colour_luminance(tint) > MIRROR_MIN)) continue;
        const struct lw_vec3 normal = lane(seen->normal, i), eye = lane(seen->eye, i);
        p->mirrored.origin[i] = f->point[i].origin;
        const float alpha2 = seen->alpha[i] * seen->alpha[i] + seen->spread[i];
        p->mirrored.direction[i] = lw_mirror_direction(
            normal, eye, alpha2, lw_vec3(p->rays.dir_x[i], p->rays.dir_y[i], p->rays.dir_z[i]));
        p->mirrored.tint[i] = tint;
        p->mirrored.width_m[i] = f->width_m[i];
        p->mirrored.slope[i] = p->plane->pixel + lw_mirror_slope(alpha2);
        p->mirrored.lanes |= (uint16_t)(1u << i);
        out_kept[i] = 1 - share;
    }
}

/* Shades the lanes that shade() has left. */
static void shade_finished(const struct lw_compose *compose, struct packet *p,
                           const struct look look[LW_TRACE_WIDTH], struct finished *f) {
    const struct lw_gloss_sky sky = {compose->sky, &compose->ambient};
    float out[3][LW_TRACE_WIDTH], kept[LW_TRACE_WIDTH];
    read_finishes(compose, p, look, f);
    f->gloss.quads = p->listed ? 0 : find_quads(look, f->lanes);
    lw_gloss_see16(&f->gloss, &f->seen);
    choose_mirrors(compose, p, f, kept);
    lw_gloss_ambient16(&f->gloss, &f->seen, f->lanes, &sky, (const float(*)[LW_TRACE_WIDTH])f->e,
                       compose->has_directions ? (const float(*)[LW_TRACE_WIDTH])f->direction : NULL, kept,
                       out);
    for (uint32_t left = f->lanes; left; left &= left - 1) {
        const unsigned i = (unsigned)__builtin_ctz(left);
        const struct lw_vec3 reflected = lane((const float(*)[LW_TRACE_WIDTH])out, i),
                             e = lane((const float(*)[LW_TRACE_WIDTH])f->e, i);
        struct lw_vec3 reflects = lane((const float(*)[LW_TRACE_WIDTH])f->seen.diffuse, i);
        const struct lw_vec3 shown =
            lw_show_is_of_finish(compose->show)
                ? finish_chart(compose, f, i)
                : leaving(compose, &look[i], f->emission[i], reflected, e, f->level[i], &reflects);
        const float light = f->weight[i] * lw_colour_luminance(reflected);
        p->radiance[i] = lw_vec3_add(p->radiance[i], lw_vec3_mul(shown, f->factor[i]));
        if (light > p->reflected[i] && look[i].object->level_count > 0)
            p->reflected[i] = light, p->tile[i] = look[i].footprint.tile[0];
        if (!compose->direct) continue;
        const bool mirrors = compose->show == LW_SHOW_ALL || compose->show == LW_SHOW_DIRECT;
        if (lw_show_is_of_finish(compose->show)) reflects = grey(0);
        p->base[i] = lw_colour_luminance(e);
        p->reflects[i] = lw_vec3_scale(lw_vec3_mul(reflects, f->factor[i]), 1.0f / LW_PI);
        p->mirrors[i] = mirrors ? f->factor[i] : grey(0);
    }
}

/* Takes in one hit; true if the ray goes on behind it. */
static bool shade(struct lw_compose *compose, struct packet *p, const struct look *look,
                  const struct lw_hit16 *hits, unsigned i, bool last, struct finished *f) {
    struct lw_vec3 *radiance = &p->radiance[i];
    p->reflects[i] = lw_vec3(0, 0, 0);
    if (look->patch == NULL) {
        struct lw_vec3 direction = lw_vec3(p->rays.dir_x[i], p->rays.dir_y[i], p->rays.dir_z[i]);
        *radiance =
            lw_vec3_mad(*radiance, lw_vec3_mul(behind(compose, direction), p->tint[i]), p->transmittance[i]);
        return false;
    }
    const struct lw_facet *facet = &look->patch->facet;
    struct lw_surface surface = {
        .albedo = facet->albedo, .base = facet->base, .emission = facet->emission, .alpha = facet->alpha};
    const bool finished = shades_finish(compose, facet->material);
    if (facet->varies && !(finished && look->patch->simple))
        (finished ? lw_scene_facet_base : lw_scene_facet_colour)(compose->scene, facet, look->weight,
                                                                 &look->texels, &surface);
    if (p->is_mirrored && compose->drawn_material &&
        compose->drawn_material[facet->material - compose->scene->material])
        surface.emission = lw_vec3(0, 0, 0); /* the lamp's highlight is drawn */
    float alpha = 1.0f;
    if (facet->material->alpha_mode == LW_ALPHA_BLEND && !last) alpha = surface.alpha;
    if (alpha > 0 && finished) {
        take_finish(compose, p, look, hits, i, &surface, p->transmittance[i] * alpha, f);
        p->transmittance[i] *= 1.0f - alpha;
    } else if (alpha > 0) {
        int level;
        const struct lw_vec3 e = light_at(compose, look, &level).e;
        struct lw_vec3 reflected = lw_vec3_scale(lw_vec3_mul(surface.albedo, e), 1.0f / LW_PI);
        struct lw_vec3 reflects = surface.albedo;
        const struct lw_vec3 shown = leaving(compose, look, surface.emission, reflected, e, level, &reflects);
        const float weight = p->transmittance[i] * alpha, light = weight * lw_colour_luminance(reflected);
        *radiance = lw_vec3_mad(*radiance, lw_vec3_mul(shown, p->tint[i]), weight);
        if (light > p->reflected[i] && look->object->level_count > 0)
            p->reflected[i] = light, p->tile[i] = look->footprint.tile[0];
        p->base[i] = lw_colour_luminance(e);
        p->reflects[i] = lw_vec3_scale(lw_vec3_mul(reflects, p->tint[i]), weight * (1.0f / LW_PI));
        p->transmittance[i] *= 1.0f - alpha;
    }
    if (!(p->transmittance[i] > TRANSMITTANCE_MIN)) return false;
    p->tint[i] = lw_material_tint(facet->material, p->tint[i]);
    /* Past the hit by more than its rounding in any packet. */
    p->rays.t_near[i] = hits->t[i] * (1.0f + 4e-6f) + 1e-7f;
    return true;
}

/* The ray through each pixel of a block, of lw_camera_origin() and lw_camera_direction(), an axis at a
 * time. */
static void aim_axis(float middle, float right, float up, const float across[16], const float upward[16],
                     float out[16]) {
    for (unsigned i = 0; i < LW_TRACE_WIDTH; i++) out[i] = middle + right * across[i] + up * upward[i];
}

static void aim(struct packet *p, const struct lw_compose_view *view, const struct lw_camera_plane *plane,
                const struct places *at) {
    float across[LW_TRACE_WIDTH], upward[LW_TRACE_WIDTH];
    const struct lw_vec3 eye = plane->eye, across_m = plane->across, along_m = plane->along,
                         middle = plane->middle, right = plane->right, up = plane->up;
    for (unsigned i = 0; i < LW_TRACE_WIDTH; i++) {
        across[i] = (float)(int32_t)at->x[i] + 0.5f + view->offset_x - plane->half_width;
        upward[i] = plane->half_height - ((float)(int32_t)at->y[i] + 0.5f + view->offset_y);
    }
    aim_axis(middle.x, right.x, up.x, across, upward, p->rays.dir_x);
    aim_axis(middle.y, right.y, up.y, across, upward, p->rays.dir_y);
    aim_axis(middle.z, right.z, up.z, across, upward, p->rays.dir_z);
    aim_axis(eye.x, across_m.x, along_m.x, across, upward, p->rays.org_x);
    aim_axis(eye.y, across_m.y, along_m.y, across, upward, p->rays.org_y);
    aim_axis(eye.z, across_m.z, along_m.z, across, upward, p->rays.org_z);
    fill(0, p->rays.t_near), fill(INFINITY, p->rays.t_far), fill(1, p->transmittance);
    fill(0, p->reflected);
    p->rays.salt = 0;
    p->plane = plane;
    p->listed = at->listed;
    p->mirrored.lanes = 0;
    p->is_mirrored = false;
    for (unsigned i = 0; i < LW_TRACE_WIDTH; i++) p->radiance[i] = lw_vec3(0, 0, 0);
    for (unsigned i = 0; i < LW_TRACE_WIDTH; i++) p->tint[i] = lw_vec3(1, 1, 1);
}

/* Adds what each pixel shows of a tile's light; neighbours mostly show the same one. */
static void note_shown(struct lw_compose *compose, const struct packet *p, uint16_t active) {
    uint64_t sum = 0;
    uint32_t tile = 0;
    for (unsigned i = 0; i < LW_TRACE_WIDTH; i++) {
        if (!(active >> i & 1u) || !(p->reflected[i] > 0)) continue;
        const float all = lw_colour_luminance(p->radiance[i]);
        const uint64_t light = (uint64_t)((float)PIXEL_LIGHT * fminf(1, p->reflected[i] / all) + 0.5f);
        if (p->tile[i] != tile && sum > 0) {
            __atomic_fetch_add(&compose->shown[tile], sum, __ATOMIC_RELAXED);
            sum = 0;
        }
        tile = p->tile[i];
        sum += light;
    }
    if (sum > 0) __atomic_fetch_add(&compose->shown[tile], sum, __ATOMIC_RELAXED);
}

/* Takes in the nearest hits of a packet's rays; returns the rays that go on behind them. */
static uint16_t meet(struct lw_compose *compose, struct packet *p, uint16_t going, bool last,
                     struct patches *patches, struct look look[LW_TRACE_WIDTH], struct lw_hit16 *hits,
                     struct finished *f) {
    uint16_t go_on = 0;
    f->lanes = 0;
    lw_trace_closest16(compose->trace, LW_TRACE_VIEW | (p->is_mirrored ? 0 : LW_TRACE_COHERENT), going,
                       &p->rays, hits);
    patches->packet++;
    for (unsigned i = 0; i < LW_TRACE_WIDTH; i++)
        if (going >> i & 1u) look_at(compose, patches, p, hits, i, &look[i]);
    for (unsigned i = 0; i < LW_TRACE_WIDTH; i++)
        if ((going >> i & 1u) && shade(compose, p, &look[i], hits, i, last, f)) go_on |= (uint16_t)(1u << i);
    if (f->lanes) shade_finished(compose, p, look, f);
    return go_on;
}

/* The packet of the rays that another one mirrors. */
static void aim_mirrored(const struct packet *p, struct packet *out) {
    const struct mirrored *m = &p->mirrored;
    fill(0, out->rays.t_near), fill(INFINITY, out->rays.t_far), fill(1, out->transmittance);
    fill(0, out->reflected);
    out->rays.salt = 1;
    out->plane = p->plane;
    out->listed = out->is_mirrored = true;
    out->mirrored = *m;
    for (unsigned i = 0; i < LW_TRACE_WIDTH; i++) {
        const bool goes = m->lanes >> i & 1u;
        const struct lw_vec3 from = goes ? m->origin[i] : lw_vec3(0, 0, 0),
                             to = goes ? m->direction[i] : lw_vec3(0, 0, 1);
        out->rays.org_x[i] = from.x, out->rays.org_y[i] = from.y, out->rays.org_z[i] = from.z;
        out->rays.dir_x[i] = to.x, out->rays.dir_y[i] = to.y, out->rays.dir_z[i] = to.z;
        out->radiance[i] = lw_vec3(0, 0, 0);
        out->tint[i] = goes ? m->tint[i] : lw_vec3(0, 0, 0);
    }
}

static void add_mirrored(struct packet *p, const struct packet *second) {
    for (uint32_t left = p->mirrored.lanes; left; left &= left - 1) {
        const unsigned i = (unsigned)__builtin_ctz(left);
        p->radiance[i] = lw_vec3_add(p->radiance[i], second->radiance[i]);
    }
}

static void render_layers(struct lw_compose *compose, uint16_t going, struct patches *patches,
                          struct packet *p) {
    struct look look[LW_TRACE_WIDTH];
    struct lw_hit16 hits;
    struct finished finished;
    for (unsigned layer = 1; going && layer <= LW_COMPOSE_LAYERS_MAX; layer++)
        going = meet(compose, p, going, layer == LW_COMPOSE_LAYERS_MAX, patches, look, &hits, &finished);
}

/* All that a packet sees, of light that tiles hold. */
static void render_packet(struct lw_compose *compose, const struct lw_compose_view *view,
                          const struct lw_camera_plane *plane, const struct places *at,
                          struct patches *patches, struct packet *p) {
    struct packet second;
    aim(p, view, plane, at);
    render_layers(compose, at->active, patches, p);
    if (!p->mirrored.lanes) return;
    aim_mirrored(p, &second);
    render_layers(compose, p->mirrored.lanes, patches, &second);
    add_mirrored(p, &second);
}

static void place_block(const struct lw_compose_view *view, uint32_t x, uint32_t y, struct places *out) {
    out->active = 0;
    out->listed = false;
    for (unsigned i = 0; i < LW_TRACE_WIDTH; i++) {
        out->x[i] = x + i % BLOCK, out->y[i] = y + i / BLOCK;
        if (out->x[i] < view->width && out->y[i] < view->height) out->active |= (uint16_t)(1u << i);
    }
}

/* Puts a packet into the picture. */
static void show(struct lw_compose *compose, const struct lw_compose_view *view, const struct packet *p,
                 const struct places *at, float *out_rgb) {
    if (!compose->surveys) note_shown(compose, p, at->active);
    for (unsigned i = 0; i < LW_TRACE_WIDTH; i++) {
        if (!(at->active >> i & 1u)) continue;
        float *pixel = out_rgb + 3 * ((size_t)at->y[i] * view->width + at->x[i]);
        pixel[0] = p->radiance[i].x, pixel[1] = p->radiance[i].y, pixel[2] = p->radiance[i].z;
    }
}

static void render_block(struct lw_compose *compose, const struct lw_compose_view *view,
                         const struct lw_camera_plane *plane, uint32_t x, uint32_t y, struct patches *patches,
                         float *out_rgb) {
    struct packet p;
    struct places at;
    place_block(view, x, y, &at);
    render_packet(compose, view, plane, &at, patches, &p);
    show(compose, view, &p, &at, out_rgb);
}

static bool is_any(struct lw_vec3 v) { return v.x + v.y + v.z > 0; }

static void note_points(const struct lw_compose *compose, const struct packet *p, uint16_t going,
                        const struct look look[LW_TRACE_WIDTH], const struct lw_hit16 *hits,
                        const struct finished *f, struct lw_direct_block *out) {
    struct lw_points16 *at = &out->points;
    for (unsigned i = 0; i < LW_TRACE_WIDTH; i++) {
        if (!(going >> i & 1u) || !look[i].patch) continue;
        const bool finished = f->lanes >> i & 1u;
        if (!is_any(p->reflects[i]) && !(finished && is_any(p->mirrors[i]))) continue;
        const struct lw_place_point point = finished ? f->point[i] : point_of(compose, &look[i], hits, i);
        at->x[i] = point.origin.x, at->y[i] = point.origin.y, at->z[i] = point.origin.z;
        at->nx[i] = point.normal.x, at->ny[i] = point.normal.y, at->nz[i] = point.normal.z;
        out->base[i] = p->base[i];
        out->active |= (uint16_t)(1u << i);
    }
    out->finished = f->lanes & out->active;
    if (out->finished) out->seen = f->seen;
}

static void add_direct(struct packet *p, const struct lw_direct_block *block) {
    for (unsigned i = 0; i < LW_TRACE_WIDTH; i++) {
        if (!(block->active >> i & 1u)) continue;
        const struct lw_vec3 e = lane(block->e, i);
        p->radiance[i] = lw_vec3_add(p->radiance[i], lw_vec3_mul(p->reflects[i], e));
        if (!(block->finished >> i & 1u)) continue;
        const struct lw_vec3 mirrored = lane(block->mirrored, i);
        p->radiance[i] = lw_vec3_add(p->radiance[i], lw_vec3_mul(p->mirrors[i], mirrored));
    }
}

/* Packets with direct light, layer by layer. w->going: the rays of each that go */
static void light_layers(struct lw_compose *compose, struct patches *patches, struct worker *w,
                         struct packet *packet) {
    struct look look[LW_TRACE_WIDTH];
    struct finished finished;
    bool any = true;
    for (unsigned layer = 1; any && layer <= LW_COMPOSE_LAYERS_MAX; layer++) {
        any = false;
        for (uint32_t b = 0; b < LW_DIRECT_PIXELS_BLOCKS; b++) {
            struct lw_hit16 hits;
            w->tile->block[b].active = w->tile->block[b].finished = 0;
            if (!w->going[b]) continue;
            const uint16_t met = w->going[b];
            w->going[b] = meet(compose, &packet[b], met, layer == LW_COMPOSE_LAYERS_MAX, patches, look, &hits,
                               &finished);
            note_points(compose, &packet[b], met, look, &hits, &finished, &w->tile->block[b]);
            any |= w->going[b] != 0;
        }
        lw_direct_pixels_light(compose->direct, w->tile);
        for (uint32_t b = 0; b < LW_DIRECT_PIXELS_BLOCKS; b++) add_direct(&packet[b], &w->tile->block[b]);
    }
}

/* The packets at w->at with direct light, and what they mirror. */
static void render_lit(struct lw_compose *compose, const struct lw_compose_view *view,
                       const struct lw_camera_plane *plane, struct patches *patches, struct worker *w) {
    bool any = false;
    for (uint32_t b = 0; b < LW_DIRECT_PIXELS_BLOCKS; b++) {
        w->going[b] = w->at[b].active;
        w->packet[b].mirrored.lanes = 0;
        if (!w->going[b]) continue;
        aim(&w->packet[b], view, plane, &w->at[b]);
        any = true;
    }
    if (any) light_layers(compose, patches, w, w->packet);
    if (!compose->mirrors) return;
    any = false;
    for (uint32_t b = 0; b < LW_DIRECT_PIXELS_BLOCKS; b++) {
        w->going[b] = w->packet[b].mirrored.lanes;
        if (!w->going[b]) continue;
        aim_mirrored(&w->packet[b], &w->second[b]);
        any = true;
    }
    if (!any) return;
    w->tile->listed = true;
    light_layers(compose, patches, w, w->second);
    for (uint32_t b = 0; b < LW_DIRECT_PIXELS_BLOCKS; b++) add_mirrored(&w->packet[b], &w->second[b]);
}

static void render_lit_tile(struct lw_compose *compose, const struct lw_compose_view *view,
                            const struct lw_camera_plane *plane, uint32_t left, uint32_t top,
                            struct patches *patches, struct worker *w, float *out_rgb) {
    w->tile->x = left, w->tile->y = top;
    w->tile->listed = false;
    for (uint32_t b = 0; b < LW_DIRECT_PIXELS_BLOCKS; b++)
        place_block(view, left + b % LW_DIRECT_PIXELS_SIDE * BLOCK, top + b / LW_DIRECT_PIXELS_SIDE * BLOCK,
                    &w->at[b]);
    render_lit(compose, view, plane, patches, w);
    for (uint32_t b = 0; b < LW_DIRECT_PIXELS_BLOCKS; b++)
        if (w->at[b].active) show(compose, view, &w->packet[b], &w->at[b], out_rgb);
}

static void forget_patches(struct patches *patches) {
    patches->packet = 0;
    for (unsigned i = 0; i < PATCHES; i++)
        patches->patch[i].object = LW_TRACE_MISS, patches->patch[i].packet = 0;
    patches->fine = (struct fine_ids){0};
}

/* direct: whether the lights are drawn that the client draws. */
static void render(struct lw_compose *compose, const struct lw_compose_view *view,
                   const struct lw_camera_plane *plane, bool direct, float *out_rgb) {
    uint32_t columns = (view->width + SCREEN_TILE - 1) / SCREEN_TILE;
    uint32_t rows = (view->height + SCREEN_TILE - 1) / SCREEN_TILE;
#pragma omp parallel for schedule(dynamic) num_threads(compose->threads)
    for (uint32_t t = 0; t < columns * rows; t++) {
        uint32_t left = t % columns * SCREEN_TILE, top = t / columns * SCREEN_TILE;
        struct patches patches;
        forget_patches(&patches);
        if (direct) {
            render_lit_tile(compose, view, plane, left, top, &patches, &compose->worker[omp_get_thread_num()],
                            out_rgb);
            continue;
        }
        for (uint32_t y = top; y < top + SCREEN_TILE && y < view->height; y += BLOCK)
            for (uint32_t x = left; x < left + SCREEN_TILE && x < view->width; x += BLOCK)
                render_block(compose, view, plane, x, y, &patches, out_rgb);
    }
}

static void begin_direct(struct lw_compose *compose, uint32_t sample) {
    if (!compose->finishes) place_objects(compose);
    for (int i = 0; i < compose->threads; i++) compose->worker[i].tile->rays = 0;
    lw_direct_pixels_begin(compose->direct, compose->pose, compose->mean, sample);
}

/* Shadow rays of the last picture. */
static uint64_t count_shadow_rays(const struct lw_compose *compose) {
    uint64_t rays = 0;
    for (int i = 0; i < compose->threads; i++) rays += compose->worker[i].tile->rays;
    return rays;
}

void lw_compose_render(struct lw_compose *compose, const struct lw_compose_source *source,
                       const struct lw_pose *pose, const struct lw_compose_view *view, float *out_rgb,
                       struct lw_compose_report *out_report) {
    compose->show = view->show;
    compose->tile_colour = view->tile_colour;
    begin(compose, source, pose);
    compose->mirrors = view->mirrors && compose->finishes && view->show == LW_SHOW_ALL;
    memset(compose->shown, 0, compose->map->tile_count * sizeof *compose->shown);
    compose->pixel_count = (uint64_t)view->width * view->height;
    if (compose->direct) begin_direct(compose, view->sample);
    const struct lw_camera_plane plane = lw_camera_plane(&view->camera, view->width, view->height);
    render(compose, view, &plane, compose->direct != NULL, out_rgb);
    lw_compose_check(compose, source, out_report);
    if (compose->direct) out_report->shadow_rays = count_shadow_rays(compose);
}

/* The packet of the pixels of a list from `first` to `end`. */
static void place_listed(const struct lw_compose_view *view, const uint32_t *pixel, size_t first, size_t end,
                         struct places *out) {
    out->active = 0;
    out->listed = true;
    for (unsigned i = 0; i < LW_TRACE_WIDTH; i++) {
        const uint32_t place = pixel[first + i < end ? first + i : end - 1];
        out->x[i] = place % view->width, out->y[i] = place / view->width;
        if (first + i < end) out->active |= (uint16_t)(1u << i);
    }
}

static void list(const struct packet *p, uint16_t active, float *out_rgb) {
    for (unsigned i = 0; i < LW_TRACE_WIDTH; i++) {
        if (!(active >> i & 1u)) continue;
        float *pixel = out_rgb + 3 * (size_t)i;
        pixel[0] = p->radiance[i].x, pixel[1] = p->radiance[i].y, pixel[2] = p->radiance[i].z;
    }
}

static void render_lit_list(struct lw_compose *compose, const struct lw_compose_view *view,
                            const struct lw_camera_plane *plane, const uint32_t *pixel, size_t first,
                            size_t end, struct patches *patches, struct worker *w, float *out_rgb) {
    w->tile->x = (uint32_t)first, w->tile->y = UINT32_MAX; /* no place of a screen tile */
    w->tile->listed = true;
    for (uint32_t b = 0; b < LW_DIRECT_PIXELS_BLOCKS; b++) {
        const size_t at = first + b * LW_TRACE_WIDTH;
        w->at[b].active = 0;
        if (at < end) place_listed(view, pixel, at, end, &w->at[b]);
    }
    render_lit(compose, view, plane, patches, w);
    for (uint32_t b = 0; b < LW_DIRECT_PIXELS_BLOCKS; b++)
        if (w->at[b].active) list(&w->packet[b], w->at[b].active, out_rgb + 3 * (first + b * LW_TRACE_WIDTH));
}

void lw_compose_render_more(struct lw_compose *compose, const struct lw_compose_view *view,
                            const uint32_t *pixel, size_t pixel_count, float *out_rgb) {
    const struct lw_camera_plane plane = lw_camera_plane(&view->camera, view->width, view->height);
    const size_t chunks = (pixel_count + LISTED - 1) / LISTED;
    if (compose->direct) begin_direct(compose, view->sample);
#pragma omp parallel for schedule(dynamic) num_threads(compose->threads)
    for (size_t chunk = 0; chunk < chunks; chunk++) {
        struct patches patches;
        forget_patches(&patches);
        const size_t end = (chunk + 1) * LISTED < pixel_count ? (chunk + 1) * LISTED : pixel_count;
        if (compose->direct) {
            render_lit_list(compose, view, &plane, pixel, chunk * LISTED, end, &patches,
                            &compose->worker[omp_get_thread_num()], out_rgb);
            continue;
        }
        for (size_t first = chunk * LISTED; first < end; first += LW_TRACE_WIDTH) {
            struct packet p;
            struct places at;
            place_listed(view, pixel, first, end, &at);
            render_packet(compose, view, &plane, &at, &patches, &p);
            list(&p, at.active, out_rgb + 3 * first);
        }
    }
}

static void swap_needed(struct lw_compose *compose) {
    uint8_t *needed = compose->needed;
    compose->needed = compose->around;
    compose->around = needed;
}

/* A small picture of a wide view, whose pixels are taken to be as small as the view's own: they need the same
 * levels. */
void lw_compose_survey(struct lw_compose *compose, const struct lw_compose_source *source,
                       const struct lw_pose *pose, const struct lw_compose_view *view) {
    struct lw_compose_view wide = *view;
    const float longest = (float)(view->width > view->height ? view->width : view->height),
                scale = fminf(1, (float)SURVEY_SIDE / longest);
    wide.width = (uint32_t)fmaxf(1, (float)view->width * scale);
    wide.height = (uint32_t)fmaxf(1, (float)view->height * scale);
    wide.camera.fov_y = 2 * atanf(SURVEY_MARGIN * tanf(0.5f * view->camera.fov_y));
    wide.camera.height_m *= SURVEY_MARGIN;
    struct lw_camera_plane plane = lw_camera_plane(&wide.camera, wide.width, wide.height);
    plane.pixel = lw_camera_plane(&view->camera, view->width, view->height).pixel;
    swap_needed(compose);
    compose->show = LW_SHOW_ALL;
    compose->surveys = true;
    begin(compose, source, pose);
    render(compose, &wide, &plane, false, compose->survey);
    compose->surveys = false;
    swap_needed(compose);
}

void lw_compose_note(struct lw_compose *compose, const uint8_t *needed, const uint64_t *shown,
                     uint64_t pixel_count) {
    memcpy(compose->needed, needed, compose->map->tile_count * sizeof *needed);
    memcpy(compose->shown, shown, compose->map->tile_count * sizeof *shown);
    compose->pixel_count = pixel_count;
}

/* The visible part of a tile's error: the share that the server's filter leaves, in texels that are means
 * of finer ones where views read it coarser. */
static double shown_error(const struct lw_compose *compose, const struct lw_compose_source *source,
                          uint32_t t, float error) {
    const unsigned noise_level =
                       compose->unfiltered ? 0 : lw_atlas_noise_level_min(error, source->noise_shown),
                   finer = lw_atlas_finer(compose->map->place[t].level),
                   level = finer ? 0 : compose->map->place[t].level;
    const double shown =
        ldexp((double)(error * source->noise_shown), -(int)(noise_level > level ? noise_level : level));
    return shown < 1 ? shown : 1;
}

/* A tile of a finer level that is not there: views read level 0 in its place. Returns the error that is seen
 * of that. */
static double check_below(const struct lw_compose *compose, const struct lw_compose_source *source,
                          uint32_t t, struct lw_compose_report *report) {
    const lw_tile_id below = lw_atlas_map_below(compose->map, (lw_tile_id){t});
    const struct lw_client_tile tile = source->tile(source->context, below);
    report->tiles_missing += tile.version == 0;
    report->tiles_unfinished += tile.version && tile.bounces < source->bounces;
    report->tiles_noisy++;
    return tile.version ? shown_error(compose, source, below.v, tile.error) : 1;
}

void lw_compose_check(const struct lw_compose *compose, const struct lw_compose_source *source,
                      struct lw_compose_report *out_report) {
    struct lw_compose_report report = {0};
    double shown = 0;
    for (uint32_t t = 0; t < compose->map->tile_count; t++) {
        if (!compose->needed[t] || !lw_atlas_map_is_used(compose->map, (lw_tile_id){t})) continue;
        struct lw_client_tile tile = source->tile(source->context, (lw_tile_id){t});
        report.tiles_needed++;
        if (tile.version == 0 && lw_atlas_finer(compose->map->place[t].level)) {
            shown += (double)compose->shown[t] * check_below(compose, source, t, &report);
            continue;
        }
        const bool missing = tile.version == 0;
        shown += (double)compose->shown[t] * (missing ? 1 : shown_error(compose, source, t, tile.error));
        if (missing) {
            report.tiles_missing++;
            continue;
        }
        report.tiles_unfinished += tile.bounces < source->bounces;
        report.tiles_noisy += !(tile.error <= source->target_error);
        report.max_error = fmaxf(report.max_error, tile.error);
    }
    report.shown_error =
        (float)(shown / ((double)PIXEL_LIGHT * (double)(compose->pixel_count ? compose->pixel_count : 1)));
    report.complete = report.tiles_missing == 0 && report.tiles_unfinished == 0;
    report.converged = report.complete && report.tiles_noisy == 0;
    report.good = report.converged || (report.complete && report.shown_error <= LW_COMPOSE_GOOD_ERROR);
    *out_report = report;
}

const uint8_t *lw_compose_needed(const struct lw_compose *compose) { return compose->needed; }

const uint8_t *lw_compose_around(const struct lw_compose *compose) { return compose->around; }
