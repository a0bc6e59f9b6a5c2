#include "server/bake/map.h"

#include "common/base/random.h"
#include "common/light/direction_form.h"
#include "server/publish/levels.h"
#include "server/solve/surface/texels.h"

#include <stdlib.h>
#include <string.h>

#define HALF_MAX        65504.0
#define HALF_MANTISSA   10    /* bits behind the point */
#define HALF_SUBNORMAL  -14   /* exponent under which precision falls */
#define CLIPPED_MAX     0.001 /* share of the surface */
#define HISTOGRAM_STEPS 4096u

double lw_map_half_loss(const float *value, size_t count) {
    double sum = 0, lost = 0;
    for (size_t i = 0; i < count; i++) {
        const double x = fabs((double)value[i]);
        if (!(x <= HALF_MAX)) return (double)INFINITY;
        int exponent = 0;
        frexp(x, &exponent); /* x = [0.5, 1) * 2^exponent */
        exponent = exponent - 1 < HALF_SUBNORMAL ? HALF_SUBNORMAL : exponent - 1;
        const double step = ldexp(1, exponent - HALF_MANTISSA);
        lost += fabs(rint(x / step) * step - x);
        sum += x;
    }
    return sum > 0 ? lost / sum : 0;
}

/* ---- from the solver's tiles ---- */

/* Contents of a map: light of a channel by a convention, or without one a plain channel, or normals. */
struct content {
    uint32_t channel;
    const struct lw_convention *convention;
    const struct lw_mesh_texels *normals; /* their mesh; NULL: not normals */
    const struct lw_affine *to_world;     /* with normals: their object's */
};

/* Normals in place of a tile's light. Gutters are left to the levels. */
static void put_normals(struct lw_solver_tile *tile, const struct lw_tile_place *place,
                        const struct content *content, float plane[3][LW_TILE_TEXELS_MAX]) {
    const uint32_t start = lw_texels_tile_start(content->normals, place->x, place->y);
    for (uint32_t i = 0; i < tile->width * tile->height; i++) {
        struct lw_vec3 n = {0};
        if (tile->covered[i] && content->normals->covered[start + i])
            n = lw_affine_normal(content->to_world,
                                 lw_packed_normal_unpack(content->normals->normal[start + i]));
        plane[0][i] = n.x, plane[1][i] = n.y, plane[2][i] = n.z;
    }
    for (int c = 0; c < 3; c++) tile->shown[content->channel][c] = plane[c];
    tile->filled = NULL;
}

/* A tile's light by the convention, in `plane`, in place of its irradiance. */
static void convert_tile(struct lw_solver_tile *tile, const struct content *content,
                         float plane[3][LW_TILE_TEXELS_MAX]) {
    const float **e = tile->shown[content->channel];
    if (!content->convention) return;
    for (uint32_t i = 0; i < tile->width * tile->height; i++) {
        const struct lw_vec3 albedo = content->convention->times_albedo
                                          ? lw_packed_albedo_unpack(tile->albedo[i])
                                          : lw_vec3(0, 0, 0); /* tile_by_tile.h has none then */
        const struct lw_vec3 texel =
            lw_convention_texel(content->convention, lw_vec3(e[0][i], e[1][i], e[2][i]), albedo);
        plane[0][i] = texel.x;
        plane[1][i] = texel.y;
        plane[2][i] = texel.z;
    }
    for (int c = 0; c < 3; c++) e[c] = plane[c];
}

static void load_tiles(struct lw_map *map, struct lw_levels *levels, const struct lw_atlas_map *atlas_map,
                       const struct lw_solver *solver, const struct content *content,
                       float plane[3][LW_TILE_TEXELS_MAX]) {
    double squares = 0;
    map->samples = UINT32_MAX;
    const struct lw_atlas_level *level = &atlas_map->atlas[map->object]->level[0];
    for (uint32_t t = 0; t < level->tiles_x * level->tiles_y; t++) {
        const lw_tile_id id = {atlas_map->first_tile[map->object] + level->first_tile + t};
        struct lw_solver_tile tile;
        solver->ops->read_tile(solver, id, &tile);
        if (content->normals)
            put_normals(&tile, &atlas_map->place[id.v], content, plane);
        else
            convert_tile(&tile, content, plane);
        lw_levels_load_tile(levels, &atlas_map->place[id.v], &tile);
        uint32_t covered = 0;
        for (uint32_t i = 0; i < tile.width * tile.height; i++) covered += tile.covered[i] != 0;
        if (!covered) continue;
        map->covered += covered;
        squares += (double)covered * (double)tile.error * (double)tile.error;
        if (tile.error > map->error_worst) map->error_worst = tile.error;
        if (tile.sample_count < map->samples) map->samples = tile.sample_count;
    }
    if (map->covered)
        map->error = (float)sqrt(squares / map->covered);
    else
        map->samples = 0;
}

/* Level 0 with its gutters; further out the nearest coarser texel, so that an engine's own mip levels and
 * compression blocks find no black beside a chart. */
static void fill_map(struct lw_map *map, const struct lw_levels *levels) {
    for (uint32_t y = 0; y < map->height; y++)
        for (uint32_t x = 0; x < map->width; x++) {
            float *out = map->rgba + ((size_t)y * map->width + x) * 4;
            for (uint32_t l = 0; l < levels->count; l++) {
                const struct lw_levels_image *image = &levels->level[l];
                const size_t i = (size_t)(y >> l) * image->width + (x >> l);
                if (!image->covered[i]) continue;
                memcpy(out, image->value + i * 3, 3 * sizeof *out);
                out[3] = l == 0 && image->covered[i] == 1;
                break;
            }
        }
}

static bool measure(struct lw_map *map) {
    float *surface = malloc((size_t)map->covered * 3 * sizeof *surface + 1);
    if (!surface) return false;
    size_t n = 0;
    for (size_t i = 0; i < (size_t)map->width * map->height; i++)
        for (int c = 0; c < 3; c++) {
            const float v = map->rgba[i * 4 + (size_t)c];
            map->largest = fmaxf(map->largest, v);
            if (map->rgba[i * 4 + 3] == 1) surface[n++] = v;
        }
    map->fits_half = lw_map_half_loss(surface, n) <= LW_MAP_HALF_LOSS_MAX && (double)map->largest <= HALF_MAX;
    free(surface);
    return true;
}

static bool is_finite(const struct lw_map *map) {
    for (size_t i = 0; i < (size_t)map->width * map->height * 4; i++)
        if (!isfinite(map->rgba[i])) return false;
    return true;
}

static enum lw_status build(struct lw_map *map, const struct lw_scene *scene,
                            const struct lw_atlas_map *atlas_map, const struct lw_solver *solver,
                            uint32_t object, const struct content *content, struct lw_error *err) {
    const struct lw_mesh *mesh = &scene->mesh[scene->object[object].mesh];
    struct lw_levels levels;
    *map = (struct lw_map){.object = object,
                           .width = mesh->atlas_width,
                           .height = mesh->atlas_height,
                           .back_offset = mesh->back_offset};
    if (lw_levels_init(&levels, content->channel, atlas_map->atlas[object]) != LW_OK)
        return lw_status_fail(err, LW_NO_MEMORY, "the map of object %u", object);
    float(*plane)[LW_TILE_TEXELS_MAX] = malloc(3 * sizeof *plane);
    map->rgba = calloc((size_t)map->width * map->height, 4 * sizeof *map->rgba);
    bool ok = plane && map->rgba;
    if (ok) {
        load_tiles(map, &levels, atlas_map, solver, content, plane);
        lw_levels_build(&levels);
        fill_map(map, &levels);
        ok = measure(map);
    }
    free(plane);
    lw_levels_finish(&levels);
    enum lw_status status = LW_OK;
    if (!ok)
        status = lw_status_fail(err, LW_NO_MEMORY, "the map of object %u", object);
    else if (!is_finite(map))
        status = lw_status_fail(err, LW_INTERNAL, "the light on object \"%.100s\" is not finite",
                                scene->object[object].name);
    if (status != LW_OK) lw_map_finish(map);
    return status;
}

enum lw_status lw_map_build(struct lw_map *map, const struct lw_scene *scene,
                            const struct lw_atlas_map *atlas_map, const struct lw_solver *solver,
                            uint32_t channel, uint32_t object, const struct lw_convention *convention,
                            struct lw_error *err) {
    const struct content content = {.channel = channel, .convention = convention};
    return build(map, scene, atlas_map, solver, object, &content, err);
}

static void divide_by_light(struct lw_map *map, const struct lw_map *light) {
    for (size_t i = 0; i < (size_t)map->width * map->height; i++) {
        float *moment = map->rgba + 4 * i;
        const struct lw_vec3 r = lw_direction_of(moment, light->rgba + 4 * i);
        moment[0] = r.x, moment[1] = r.y, moment[2] = r.z;
    }
}

enum lw_status lw_map_build_directions(struct lw_map *map, const struct lw_scene *scene,
                                       const struct lw_atlas_map *atlas_map, const struct lw_solver *solver,
                                       uint32_t channel, const struct lw_map *irradiance,
                                       struct lw_error *err) {
    const struct content moment = {.channel = LW_TILE_CHANNEL_DIRECTION + channel};
    enum lw_status status = build(map, scene, atlas_map, solver, irradiance->object, &moment, err);
    if (status == LW_OK) divide_by_light(map, irradiance);
    return status;
}

enum lw_status lw_map_build_normals(struct lw_map *map, const struct lw_scene *scene,
                                    const struct lw_atlas_map *atlas_map, const struct lw_pose *pose,
                                    const struct lw_solver *solver, uint32_t object, struct lw_error *err) {
    const struct lw_mesh *mesh = &scene->mesh[scene->object[object].mesh];
    struct lw_mesh_texels texels = {.width = mesh->atlas_width,
                                    .height = mesh->atlas_height,
                                    .texel_count = mesh->atlas_width * mesh->atlas_height,
                                    .back_offset = mesh->back_offset};
    const struct content normals = {
        .channel = LW_TILE_CHANNEL_FULL, .normals = &texels, .to_world = &pose->object_to_world[object]};
    enum lw_status status = lw_texels_rasterise(&texels, scene, mesh, false)
                                ? build(map, scene, atlas_map, solver, object, &normals, err)
                                : lw_status_fail(err, LW_NO_MEMORY, "the normals of object %u", object);
    lw_texels_finish_mesh(&texels);
    return status;
}

void lw_map_finish(struct lw_map *map) {
    free(map->rgba);
    *map = (struct lw_map){0};
}

/* ---- in 8 bits ---- */

/* The value that at most CLIPPED_MAX of the surface exceeds, to one part in HISTOGRAM_STEPS of the
 * largest. */
static float choose_scale(const struct lw_map *map) {
    uint32_t histogram[HISTOGRAM_STEPS + 1] = {0}, total = 0;
    if (!(map->largest > 0)) return 1;
    for (size_t i = 0; i < (size_t)map->width * map->height; i++) {
        const float *p = map->rgba + i * 4;
        if (p[3] != 1) continue;
        histogram[(uint32_t)(fmaxf(p[0], fmaxf(p[1], p[2])) / map->largest * HISTOGRAM_STEPS)]++;
        total++;
    }
    uint32_t above = 0, step = HISTOGRAM_STEPS;
    while (step > 0 && (double)(above + histogram[step]) <= CLIPPED_MAX * total) above += histogram[step--];
    return map->largest * (float)(step + 1 < HISTOGRAM_STEPS ? step + 1 : HISTOGRAM_STEPS) /
           (float)HISTOGRAM_STEPS;
}

enum lw_status lw_map_to_8_bit(const struct lw_map *map, uint8_t **out_rgb, float *out_scale) {
    const size_t count = (size_t)map->width * map->height;
    uint8_t *rgb = malloc(count * 3);
    if (!rgb) return LW_NO_MEMORY;
    const float scale = choose_scale(map);
    for (size_t i = 0; i < count; i++) {
        const float dither =
            lw_random_unit(lw_random_hash((uint32_t)i)); /* in [0, 1): rounds up as often as it should */
        for (size_t c = 0; c < 3; c++)
            rgb[i * 3 + c] = (uint8_t)fminf(255, floorf(map->rgba[i * 4 + c] / scale * 255 + dither));
    }
    *out_rgb = rgb;
    *out_scale = scale;
    return LW_OK;
}
