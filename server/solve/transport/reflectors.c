#include "server/solve/transport/reflectors.h"

#include "common/base/cdf.h"
#include "common/base/colour.h"
#include "common/base/invariant.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>

/* What a ray that meets it would bring, over the mean light of all texels: from here on rays are sent. */
#define RARE 16.0f
/* The same of the mean of a block, before its texels are looked at. */
#define RARE_BLOCK 4.0f
/* Its radius over the scene's, at most, and how many triangles it may have. Radii are those of tiles, which
 * are up to 1.7 times too large. */
#define SIZE_SHARE    (1.0f / 9)
#define TRIANGLES_MAX 8192u
/* Within this many of its radii bounce rays have its light. */
#define NEAR 2.0f
/* A triangle is picked by its radiance and this share of the reflector's mean, for that is read at one
 * point. */
#define EVEN 0.05f

enum lw_status lw_reflectors_init(struct lw_reflectors *r, const struct lw_scene *scene,
                                  const struct lw_texels *texels, const struct lw_pose *pose) {
    struct lw_vec3 lo = {0}, hi = {0};
    *r = (struct lw_reflectors){.scene = scene, .texels = texels};
    if (lw_pose_bounds(pose, scene, &lo, &hi))
        r->radius_max_m = SIZE_SHARE * 0.5f * lw_vec3_length(lw_vec3_sub(hi, lo));
    r->is_bright = calloc((size_t)scene->object_count + 1, sizeof *r->is_bright);
    r->of_object = malloc((size_t)scene->object_count + 1);
    if (!r->is_bright || !r->of_object) {
        lw_reflectors_finish(r);
        return LW_NO_MEMORY;
    }
    memset(r->of_object, LW_REFLECTORS_MAX, scene->object_count);
    return LW_OK;
}

void lw_reflectors_finish(struct lw_reflectors *r) {
    for (uint32_t i = 0; i <= LW_REFLECTORS_MAX; i++) {
        free(r->list[i].triangle);
        free(r->list[i].upto);
        free(r->list[i].radiance);
    }
    free(r->is_bright);
    free(r->of_object);
    *r = (struct lw_reflectors){0};
}

size_t lw_reflectors_memory_bytes(const struct lw_reflectors *r) {
    if (!r->scene) return 0;
    size_t bytes = r->scene->object_count * (sizeof *r->is_bright + sizeof *r->of_object);
    for (uint32_t i = 0; i <= LW_REFLECTORS_MAX; i++)
        bytes += r->list[i].capacity *
                 (sizeof *r->list->triangle + sizeof *r->list->upto + sizeof *r->list->radiance);
    return bytes;
}

/* ---- what shines ---- */

static const struct lw_mesh *mesh_of(const struct lw_reflectors *r, uint32_t object) {
    return &r->scene->mesh[r->scene->object[object].mesh];
}

static bool is_opaque(const struct lw_reflectors *r, const struct lw_mesh *mesh, uint32_t triangle) {
    return r->scene->material[mesh->material[triangle]].alpha_mode == LW_ALPHA_OPAQUE;
}

/* A triangle's first corner, and the ways to its others. */
static void edges(const struct lw_mesh *mesh, uint32_t triangle, struct lw_vec3 *a, struct lw_vec3 *ab,
                  struct lw_vec3 *ac) {
    const uint32_t *vertex = mesh->triangle[triangle];
    *a = mesh->position[vertex[0]];
    *ab = lw_vec3_sub(mesh->position[vertex[1]], *a);
    *ac = lw_vec3_sub(mesh->position[vertex[2]], *a);
}

/* Luminance of all that a texel sends out. */
static float radiance_of(const struct lw_tiles *tiles, uint32_t texel) {
    float sum = 0;
    if (texel == LW_TEXEL_NONE) return 0;
    for (uint32_t bounce = 0; bounce < tiles->bounces; bounce++)
        sum += lw_colour_luminance(lw_tiles_radiance(tiles, bounce, texel));
    return sum;
}

/* At the middle, on the brighter side. */
static float radiance_of_triangle(const struct lw_reflectors *r, const struct lw_tiles *tiles,
                                  uint32_t object, uint32_t triangle) {
    const float third = 1.0f / 3;
    return fmaxf(radiance_of(tiles, lw_texels_at(r->texels, object, triangle, third, third, false)),
                 radiance_of(tiles, lw_texels_at(r->texels, object, triangle, third, third, true)));
}

static float power_of(const struct lw_reflector *c) { return c->upto[c->count - 1]; }

static enum lw_status reserve(struct lw_reflector *c, uint32_t count) {
    if (count <= c->capacity) return LW_OK;
    uint32_t *triangle = realloc(c->triangle, count * sizeof *triangle);
    if (triangle) c->triangle = triangle;
    float *upto = realloc(c->upto, count * sizeof *upto);
    if (upto) c->upto = upto;
    float *radiance = realloc(c->radiance, count * sizeof *radiance);
    if (radiance) c->radiance = radiance;
    if (!triangle || !upto || !radiance) return LW_NO_MEMORY;
    c->capacity = count;
    return LW_OK;
}

/* Returns its greatest radiance. */
static float list_triangles(const struct lw_reflectors *r, const struct lw_tiles *tiles,
                            const struct lw_affine *to_world, struct lw_reflector *c) {
    const struct lw_mesh *mesh = mesh_of(r, c->object);
    struct lw_vec3 a, ab, ac;
    float most = 0, power = 0, area = 0;
    double sum = 0;
    c->count = 0;
    for (uint32_t i = 0; i < mesh->triangle_count; i++) {
        if (!is_opaque(r, mesh, i)) continue;
        edges(mesh, i, &a, &ab, &ac);
        const float own = 0.5f * lw_vec3_length(lw_vec3_cross(lw_affine_vector(to_world, ab),
                                                              lw_affine_vector(to_world, ac))),
                    radiance = radiance_of_triangle(r, tiles, c->object, i);
        LW_INVARIANT(c->count < c->capacity);
        c->triangle[c->count] = i;
        c->upto[c->count] = own;
        c->radiance[c->count++] = radiance;
        most = fmaxf(most, radiance);
        power += own * radiance;
        area += own;
    }
    for (uint32_t i = 0; i < c->count; i++) {
        c->radiance[i] += EVEN * power / area;
        sum += (double)(c->upto[i] * c->radiance[i]);
        c->upto[i] = (float)sum;
    }
    return sum > 0 && isfinite((float)sum) ? most : 0;
}

static void replace(struct lw_reflectors *r, uint32_t index) {
    const struct lw_reflector was = r->list[index];
    r->list[index] = r->list[LW_REFLECTORS_MAX];
    r->list[LW_REFLECTORS_MAX] = was;
}

static void add(struct lw_reflectors *r) {
    uint32_t weakest = 0;
    LW_INVARIANT(r->list[LW_REFLECTORS_MAX].count > 0 && power_of(&r->list[LW_REFLECTORS_MAX]) > 0);
    for (uint32_t i = 1; i < r->count; i++)
        if (power_of(&r->list[i]) < power_of(&r->list[weakest])) weakest = i;
    if (r->count < LW_REFLECTORS_MAX)
        replace(r, r->count++);
    else if (power_of(&r->list[LW_REFLECTORS_MAX]) > power_of(&r->list[weakest]))
        replace(r, weakest);
}

/* Rays read the light of level 0 alone. */
static bool is_of(const struct lw_solve_tile *tile, uint32_t object) {
    return tile->object == object && !tile->fine_pair;
}

/* The sphere around the tiles of an object. */
static void bound_tiles(struct lw_reflector *c, const struct lw_tiles *tiles) {
    struct lw_vec3 sum = {0};
    uint32_t count = 0;
    for (uint32_t i = 0; i < tiles->count; i++) {
        if (!is_of(&tiles->tile[i], c->object)) continue;
        sum = lw_vec3_add(sum, tiles->tile[i].centre_ws);
        count++;
    }
    LW_INVARIANT(count > 0); /* it shone in one */
    c->centre_ws = lw_vec3_scale(sum, 1 / (float)count);
    c->radius_m = 0;
    for (uint32_t i = 0; i < tiles->count; i++)
        if (is_of(&tiles->tile[i], c->object))
            c->radius_m =
                fmaxf(c->radius_m, lw_vec3_length(lw_vec3_sub(tiles->tile[i].centre_ws, c->centre_ws)) +
                                       tiles->tile[i].radius_m);
}

/* Lists a bright object if it is small, and if a ray that meets it may bring `least` or more. */
static enum lw_status consider(struct lw_reflectors *r, const struct lw_tiles *tiles,
                               const struct lw_pose *pose, uint32_t object, float least) {
    struct lw_reflector *c = &r->list[LW_REFLECTORS_MAX];
    const uint32_t triangles = mesh_of(r, object)->triangle_count;
    if (triangles > TRIANGLES_MAX) return LW_OK;
    c->object = object;
    bound_tiles(c, tiles);
    if (!(c->radius_m <= r->radius_max_m)) return LW_OK;
    if (reserve(c, triangles) != LW_OK) return LW_NO_MEMORY;
    if (LW_PI * list_triangles(r, tiles, &pose->object_to_world[object], c) > least) add(r);
    return LW_OK;
}

static float light_of_texel(const struct lw_tiles *tiles, uint32_t texel) {
    return lw_colour_luminance(
        lw_vec3_add(lw_texels_vector(tiles->direct, texel), lw_texels_vector(tiles->indirect, texel)));
}

/* E of a block's texels: the sum, and the most of one. */
struct block_light {
    double sum;
    float most;
};

static struct block_light survey_block(const struct lw_tiles *tiles, const struct lw_solve_tile *tile,
                                       const struct lw_solve_block *block) {
    const uint32_t index = (uint32_t)(block - tile->block), column = index % tile->block_columns,
                   row = index / tile->block_columns;
    struct block_light light = {0, 0};
    LW_TILES_EACH_TEXEL (tile, column, row, x, y) {
        const uint32_t texel = tile->first + y * tile->width + x;
        if (!tiles->covered[texel]) continue;
        const float own = light_of_texel(tiles, texel);
        light.sum += (double)own;
        light.most = fmaxf(light.most, own);
    }
    return light;
}

/* A block that is solved for the first time has no sum yet. */
static double light_of(const struct lw_tiles *tiles, const struct lw_solve_tile *tile,
                       const struct lw_solve_block *block) {
    return block->sample_count ? block->luminance : survey_block(tiles, tile, block).sum;
}

/* Mean E of all texels that are there; of sums that corrections have left below none, none. */
static float mean_light(const struct lw_tiles *tiles) {
    double light = 0, texels = 0;
    for (uint32_t i = 0; i < tiles->count; i++) {
        const struct lw_solve_tile *tile = &tiles->tile[i];
        if (tile->hidden || tile->fine_pair) continue;
        LW_TILES_EACH_BLOCK (tile, block) {
            if (!block->covered_count) continue;
            light += light_of(tiles, tile, block);
            texels += block->covered_count;
        }
    }
    return light > 0 ? (float)(light / texels) : 0;
}

/* Which objects have a texel that may be worth it: no albedo is above 1. */
static void find_bright(struct lw_reflectors *r, const struct lw_tiles *tiles, float mean) {
    memset(r->is_bright, 0, r->scene->object_count * sizeof *r->is_bright);
    for (uint32_t i = 0; i < tiles->count; i++) {
        const struct lw_solve_tile *tile = &tiles->tile[i];
        if (tile->hidden || tile->fine_pair || r->is_bright[tile->object]) continue;
        LW_TILES_EACH_BLOCK (tile, block) {
            if (!block->covered_count ||
                !(light_of(tiles, tile, block) > (double)(RARE_BLOCK * mean) * block->covered_count))
                continue;
            r->is_bright[tile->object] |= survey_block(tiles, tile, block).most > RARE * mean;
        }
    }
}

enum lw_status lw_reflectors_update(struct lw_reflectors *r, const struct lw_tiles *tiles,
                                    const struct lw_pose *pose) {
    const float mean = mean_light(tiles);
    enum lw_status status = LW_OK;
    LW_INVARIANT(mean >= 0 && isfinite(mean));
    r->count = 0;
    memset(r->of_object, LW_REFLECTORS_MAX, r->scene->object_count);
    find_bright(r, tiles, mean);
    for (uint32_t o = 0; status == LW_OK && o < r->scene->object_count; o++)
        if (r->is_bright[o]) status = consider(r, tiles, pose, o, RARE * mean);
    if (status != LW_OK) r->count = 0;
    LW_INVARIANT(r->count <= LW_REFLECTORS_MAX);
    for (uint32_t i = 0; i < r->count; i++) r->of_object[r->list[i].object] = (uint8_t)i;
    return status;
}

void lw_reflectors_place(struct lw_reflectors *r, const struct lw_tiles *tiles) {
    for (uint32_t i = 0; i < r->count; i++) bound_tiles(&r->list[i], tiles);
}

/* ---- what packets ask ---- */

static float square_of(const struct lw_reflector *c, struct lw_vec3 from) {
    const struct lw_vec3 d = lw_vec3_sub(c->centre_ws, from);
    return lw_vec3_dot(d, d);
}

static float near_square(const struct lw_reflector *c) { return NEAR * NEAR * c->radius_m * c->radius_m; }

bool lw_reflectors_have(const struct lw_reflectors *r, struct lw_vec3 from, uint32_t object,
                        uint32_t triangle) {
    const uint8_t index = r->of_object[object];
    return index < LW_REFLECTORS_MAX && is_opaque(r, mesh_of(r, object), triangle) &&
           square_of(&r->list[index], from) >= near_square(&r->list[index]);
}

static float most_of(const struct lw_reflector *c, struct lw_vec3 place) {
    return power_of(c) / fmaxf(square_of(c, place), near_square(c));
}

float lw_reflectors_most(const struct lw_reflectors *r, struct lw_vec3 place) {
    float sum = 0;
    for (uint32_t i = 0; i < r->count; i++) sum += most_of(&r->list[i], place);
    return sum;
}

const struct lw_reflector *lw_reflectors_pick(const struct lw_reflectors *r, struct lw_vec3 place,
                                              float random, float *out_probability) {
    const float all = lw_reflectors_most(r, place);
    LW_INVARIANT_DEAR(r->count > 0 && random >= 0 && random < 1);
    float left = random * all;
    uint32_t i = 0;
    while (i + 1 < r->count && (left -= most_of(&r->list[i], place)) >= 0) i++;
    *out_probability = most_of(&r->list[i], place) / all;
    LW_INVARIANT_DEAR(*out_probability > 0 && *out_probability < 1.001f);
    return &r->list[i];
}

void lw_reflectors_point(const struct lw_reflectors *r, const struct lw_reflector *c,
                         const struct lw_pose *pose, const float random[3], struct lw_reflector_point *out) {
    const uint32_t i = lw_cdf_choose(c->upto, c->count, random[0] * power_of(c));
    const float root = sqrtf(random[1]);
    const struct lw_affine *to_world = &pose->object_to_world[c->object];
    struct lw_vec3 a, ab, ac;
    edges(mesh_of(r, c->object), c->triangle[i], &a, &ab, &ac);
    out->triangle = c->triangle[i];
    out->u = root * (1 - random[2]);
    out->v = root * random[2];
    out->position_ws = lw_affine_point(to_world, lw_vec3_mad(lw_vec3_mad(a, ab, out->u), ac, out->v));
    out->normal_ws = lw_affine_normal(to_world, lw_vec3_cross(ab, ac));
    out->area_m2 = power_of(c) / c->radiance[i];
    LW_INVARIANT_DEAR(out->area_m2 > 0);
}
