#include "client/view/compose/compose_look.h"

#include "common/base/colour.h"
#include "common/tile/fine_choice.h"

/* Whether a look-up of level 0 reads even light: a finer level would show the same. Noisy texels, and tiles
 * that have not come yet, count as even. */
static bool is_even(const struct lw_compose *compose, const struct lw_compose_level *level,
                    const struct lw_compose_footprint *f) {
    if (level->rgb == NULL || compose->noise_level[f->tile[0]]) return true;
    for (unsigned i = 0; i < f->tile_count; i++)
        if (!compose->here[f->tile[i]]) return true;
    const uint32_t x[2] = {f->x.low, f->x.high}, y[2] = {f->y.low, f->y.high};
    float luminance[4];
    for (int i = 0; i < 4; i++)
        luminance[i] = lw_colour_luminance(lw_compose_texels_at(level, x[i & 1], y[i >> 1]));
    return lw_fine_choice_is_even(luminance);
}

void lw_compose_look_at(const struct lw_compose *compose, struct lw_compose_patches *patches,
                        const struct lw_compose_packet *p, const struct lw_hit16 *hits, unsigned i,
                        struct lw_compose_look *out) {
    out->patch = NULL;
    if (hits->object[i] == LW_TRACE_MISS) return;
    const struct lw_compose_patch *patch =
        lw_compose_patch_of(compose, patches, hits->object[i], hits->triangle[i]);
    const struct lw_facet *facet = &patch->facet;
    out->patch = patch;
    out->weight[0] = 1 - hits->u[i] - hits->v[i];
    out->weight[1] = hits->u[i];
    out->weight[2] = hits->v[i];
    const bool maps_read = lw_compose_shades_finish(compose, facet->material) && patch->simple;
    if (facet->varies && !maps_read) lw_scene_facet_texels(compose->scene, facet, out->weight, &out->texels);

    const struct lw_compose_object *object = &compose->object[hits->object[i]];
    out->object = object;
    if (object->level_count == 0) return;
    out->uv = lw_scene_facet_mean(facet->lightmap_uv, out->weight);
    if (hits->back[i]) out->uv.y += (float)facet->mesh->back_offset;
    const struct lw_vec3 dir = lw_vec3(p->rays.dir_x[i], p->rays.dir_y[i], p->rays.dir_z[i]);
    const int level = lw_compose_patch_level(patch, p->is_mirrored ? 0 : object->finer_count, dir,
                                             lw_compose_packet_width(p, i, hits->t[i]));
    out->finest = level < object->level_count ? level : object->level_count - 1;
    out->level = out->finest;
    if (out->level < 0 && patch->texels >= LW_FINE_CHOICE_TEXELS) {
        lw_compose_texels_footprint(&object->level[0], 0, out->uv, &out->footprint);
        if (is_even(compose, &object->level[0], &out->footprint)) out->level = 0;
    }
    if (out->level < 0 && lw_compose_texels_claim_fine(compose, &patches->fine, hits->object[i], out->level,
                                                       out->uv, &out->footprint))
        return;
    if (out->level < 0) out->level = 0;
    const struct lw_compose_level *finest = &object->level[out->level];
    lw_compose_texels_footprint(finest, out->level, out->uv, &out->footprint);
    if (finest->rgb == NULL) return;
    const size_t upper = lw_compose_texels_index(finest, out->footprint.x.low, out->footprint.y.low),
                 lower = lw_compose_texels_index(finest, out->footprint.x.low, out->footprint.y.high);
    __builtin_prefetch(finest->rgb + upper);
    __builtin_prefetch(finest->rgb + lower);
    if (!finest->direction) return;
    __builtin_prefetch(finest->direction + upper);
    __builtin_prefetch(finest->direction + lower);
}

/* Reads the finest of the finer levels that is there, asked for or not, and has less noise than would be
 * seen; false: none. */
static bool read_finer(const struct lw_compose *compose, const struct lw_compose_look *look,
                       struct lw_compose_light *out, int *out_level) {
    struct lw_compose_footprint f = look->footprint;
    for (int k = look->finest; k < 0; k++) {
        const struct lw_compose_level *level = &look->object->level[k];
        if (k != look->level && !lw_compose_texels_find_fine(compose, look->patch->object, k, look->uv, &f))
            continue;
        *out_level = k;
        if (!compose->noise_level[f.tile[0]] && lw_compose_texels_read_fine(compose, level, &f, out))
            return true;
    }
    return false;
}

struct lw_compose_light lw_compose_look_light(struct lw_compose *compose, const struct lw_compose_look *look,
                                              int *out_level) {
    const struct lw_compose_object *object = look->object;
    struct lw_compose_footprint f = look->footprint;
    struct lw_compose_light light;
    *out_level = (int)LW_ATLAS_LEVELS_MAX;
    if (object->level_count == 0) return (struct lw_compose_light){.e = compose->stand_in};
    lw_compose_texels_mark_needed(compose, &look->footprint);
    if (object->has_fine && read_finer(compose, look, &light, out_level)) return light;
    const int wanted = look->level < 0 ? 0 : look->level;
    if (wanted != look->level) lw_compose_texels_footprint(&object->level[0], 0, look->uv, &f);
    /* Fresh light is noise, but a texel of level 2 is the mean of 4 x 4: until the error has fallen, less is
     * more. */
    const int last = object->level_count - 1, noise_level = compose->noise_level[f.tile[0]];
    int level = noise_level < look->patch->coarsest ? noise_level : look->patch->coarsest;
    if (level > last) level = last;
    *out_level = wanted;
    if (level <= wanted && lw_compose_texels_read(compose, &object->level[wanted], &f, &light)) return light;
    return lw_compose_texels_stand_in(compose, object, level > wanted ? level : wanted, look->uv, out_level);
}

/* Colour of a chart at a hit. level: of its light */
static struct lw_vec3 chart(const struct lw_compose *compose, const struct lw_compose_look *look, int level) {
    const uint32_t tile = look->footprint.tile[0];
    if (look->object->level_count == 0) return lw_compose_grey(LW_SHOW_UNLIT);
    if (lw_show_is_of_tiles(compose->show)) return compose->tile_colour[tile];
    if (compose->show == LW_SHOW_LEVEL) return lw_show_level_colour(level);
    if (level >= look->object->level_count) return lw_compose_grey(LW_SHOW_UNLIT);
    const float scale = lw_compose_texels_scale(level);
    const int64_t x = (int64_t)floorf(look->uv.x * scale), y = (int64_t)floorf(look->uv.y * scale);
    return lw_compose_grey((x + y) & 1 ? LW_SHOW_BRIGHT : LW_SHOW_DARK);
}

struct lw_vec3 lw_compose_look_leaving(const struct lw_compose *compose, const struct lw_compose_look *look,
                                       struct lw_vec3 emission, struct lw_vec3 reflected, struct lw_vec3 e,
                                       int level, struct lw_vec3 *reflects) {
    switch (compose->show) {
    case LW_SHOW_ALL:
        return lw_vec3_add(reflected, emission);
    case LW_SHOW_DIRECT:
        return emission;
    case LW_SHOW_INDIRECT:
        *reflects = lw_compose_grey(0);
        return reflected;
    case LW_SHOW_IRRADIANCE:
        *reflects = lw_compose_grey(1);
        return lw_vec3_scale(e, 1.0f / LW_PI);
    default:
        *reflects = lw_compose_grey(0);
        return chart(compose, look, level);
    }
}

struct lw_place_point lw_compose_look_point(const struct lw_compose *compose,
                                            const struct lw_compose_look *look, const struct lw_hit16 *hits,
                                            unsigned i) {
    const struct lw_compose_patch *patch = look->patch;
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

struct lw_vec3 lw_compose_look_normal(const struct lw_compose *compose, const struct lw_compose_look *look,
                                      const struct lw_hit16 *hits, unsigned i) {
    const struct lw_compose_patch *patch = look->patch;
    struct lw_vec3 face;
    const struct lw_vec3 normal =
        lw_scene_normal(patch->facet.mesh, patch->triangle, hits->u[i], hits->v[i], &face);
    const struct lw_vec3 turned =
        lw_affine_vector(&compose->place[patch->object].to_normal, lw_scene_light_normal(normal, face));
    return lw_vec3_scale(lw_vec3_normalize(turned), hits->back[i] ? -1.0f : 1.0f);
}
