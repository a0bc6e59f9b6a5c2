#include "client/view/compose/compose_finish.h"

#include "client/view/shading/mirror.h"
#include "common/base/colour.h"

#include <string.h>

_Static_assert(LW_GLOSS_WIDTH == LW_TRACE_WIDTH, "finishes are worked out packet by packet");

/* A mirror that shows less of what it sees is not worth a ray. */
#define MIRROR_MIN 2e-3f

static void set_lane(float (*to)[LW_TRACE_WIDTH], unsigned i, struct lw_vec3 v) {
    to[0][i] = v.x, to[1][i] = v.y, to[2][i] = v.z;
}

void lw_compose_finish_take(struct lw_compose *compose, const struct lw_compose_packet *p,
                            const struct lw_compose_look *look, const struct lw_hit16 *hits, unsigned i,
                            const struct lw_surface *surface, float weight, struct lw_compose_finished *f) {
    const struct lw_compose_patch *patch = look->patch;
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
        f->point[i] = lw_compose_look_point(compose, look, hits, i);
    else if (!patch->sound)
        f->point[i].normal = lw_compose_look_normal(compose, look, hits, i);
    f->width_m[i] = lw_compose_packet_width(p, i, hits->t[i]);
    if (placed || !patch->sound) f->exact |= (uint16_t)(1u << i);
    f->base[i] = surface->base;
    f->weight[i] = weight;
    f->factor[i] = lw_vec3_scale(p->tint[i], weight);
    f->emission[i] = surface->emission;
    const struct lw_compose_light light = lw_compose_look_light(compose, look, &f->level[i]);
    set_lane(f->e, i, light.e);
    set_lane(f->direction, i, light.direction);
}

/* Lanes of the same finish, all of which is read the same way. */
static uint16_t lanes_like(const struct lw_compose_look look[LW_TRACE_WIDTH], uint32_t lanes,
                           unsigned first) {
    const struct lw_compose_patch *like = look[first].patch;
    uint16_t same = 0;
    for (uint32_t left = lanes; left; left &= left - 1) {
        const unsigned i = (unsigned)__builtin_ctz(left);
        const struct lw_compose_patch *patch = look[i].patch;
        const bool is = patch == like || (patch->facet.material == like->facet.material &&
                                          patch->simple == like->simple && patch->bumpy == like->bumpy);
        if (is) same |= (uint16_t)(1u << i);
    }
    return same;
}

/* Reads the finishes of all lanes. */
static void read_finishes(const struct lw_compose *compose, const struct lw_compose_packet *p,
                          const struct lw_compose_look look[LW_TRACE_WIDTH], struct lw_compose_finished *f) {
    struct lw_gloss16 *g = &f->gloss;
    lw_gloss_maps_begin(f->mean, f->side, g, &f->uv);
    for (unsigned i = 0; i < LW_TRACE_WIDTH; i++)
        g->to_eye[0][i] = -p->rays.dir_x[i], g->to_eye[1][i] = -p->rays.dir_y[i],
        g->to_eye[2][i] = -p->rays.dir_z[i];
    for (uint32_t left = f->lanes; left;) {
        const unsigned first = (unsigned)__builtin_ctz(left);
        const struct lw_compose_patch *patch = look[first].patch;
        const uint16_t same = lanes_like(look, left, first);
        const unsigned what =
            (patch->bumpy ? LW_GLOSS_MAPS_BUMPS : 0u) | (patch->simple ? LW_GLOSS_MAPS_BASE : 0u);
        left &= ~(uint32_t)same;
        if (lw_compose_is_finished(patch->facet.material))
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
static struct lw_vec3 finish_chart(const struct lw_compose *compose, const struct lw_compose_finished *f,
                                   unsigned i) {
    if (compose->show == LW_SHOW_NORMALS) return lw_show_normal_colour(lw_compose_lane(f->seen.normal, i));
    return lw_compose_grey(compose->show == LW_SHOW_ROUGHNESS ? f->seen.roughness[i] : f->seen.metalness[i]);
}

/* Lanes whose quads are of one object. */
static uint16_t find_quads(const struct lw_compose_look look[LW_TRACE_WIDTH], uint16_t lanes) {
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

/* Chooses lanes that mirror by a ray. out_kept: for lw_gloss_ambient16(). A lane has one ray: the first
 * layer's. */
static void choose_mirrors(const struct lw_compose *compose, struct lw_compose_packet *p,
                           const struct lw_compose_finished *f, float out_kept[LW_TRACE_WIDTH]) {
    const struct lw_gloss_seen16 *seen = &f->seen;
    lw_compose_fill(1, out_kept);
    if (!compose->mirrors || p->is_mirrored) return;
    for (uint32_t left = f->lanes & ~p->mirrored.lanes; left; left &= left - 1) {
        const unsigned i = (unsigned)__builtin_ctz(left);
        const float share = lw_mirror_share(seen->roughness[i]);
        const struct lw_vec3 of = lw_compose_lane(seen->mirrored, i),
                             tint = lw_vec3_scale(lw_vec3_mul(f->factor[i], of), share);
        if (!(lw_colour_luminance(tint) > MIRROR_MIN)) continue;
        const struct lw_vec3 normal = lw_compose_lane(seen->normal, i), eye = lw_compose_lane(seen->eye, i);
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

void lw_compose_finish_shade(const struct lw_compose *compose, struct lw_compose_packet *p,
                             const struct lw_compose_look look[LW_TRACE_WIDTH],
                             struct lw_compose_finished *f) {
    const struct lw_gloss_sky sky = {compose->sky, &compose->ambient};
    float out[3][LW_TRACE_WIDTH], kept[LW_TRACE_WIDTH];
    read_finishes(compose, p, look, f);
    f->gloss.quads = p->listed ? 0 : find_quads(look, f->lanes);
    f->gloss.samples = (float)compose->samples;
    lw_gloss_see16(&f->gloss, &f->seen);
    if (compose->show == LW_SHOW_IRRADIANCE) lw_gloss_take_off(&f->seen);
    choose_mirrors(compose, p, f, kept);
    lw_gloss_ambient16(&f->gloss, &f->seen, f->lanes, &sky, (const float(*)[LW_TRACE_WIDTH])f->e,
                       compose->has_directions ? (const float(*)[LW_TRACE_WIDTH])f->direction : NULL, kept,
                       out);
    for (uint32_t left = f->lanes; left; left &= left - 1) {
        const unsigned i = (unsigned)__builtin_ctz(left);
        const struct lw_vec3 reflected = lw_compose_lane((const float(*)[LW_TRACE_WIDTH])out, i),
                             e = lw_compose_lane((const float(*)[LW_TRACE_WIDTH])f->e, i);
        struct lw_vec3 reflects = lw_compose_lane((const float(*)[LW_TRACE_WIDTH])f->seen.diffuse, i);
        const struct lw_vec3 shown = lw_show_is_of_finish(compose->show)
                                         ? finish_chart(compose, f, i)
                                         : lw_compose_look_leaving(compose, &look[i], f->emission[i],
                                                                   reflected, e, f->level[i], &reflects);
        const float light = f->weight[i] * lw_colour_luminance(reflected);
        p->radiance[i] = lw_vec3_add(p->radiance[i], lw_vec3_mul(shown, f->factor[i]));
        if (light > p->reflected[i] && look[i].object->level_count > 0)
            p->reflected[i] = light, p->tile[i] = look[i].footprint.tile[0];
        if (!compose->direct) continue;
        const bool mirrors = compose->show == LW_SHOW_ALL || compose->show == LW_SHOW_DIRECT;
        if (lw_show_is_of_finish(compose->show)) reflects = lw_compose_grey(0);
        p->base[i] = lw_colour_luminance(e);
        p->reflects[i] = lw_vec3_scale(lw_vec3_mul(reflects, f->factor[i]), 1.0f / LW_PI);
        p->mirrors[i] = mirrors ? f->factor[i] : lw_compose_grey(0);
    }
}
