#include "client/view/compose/compose_hits.h"

#include "common/base/colour.h"
#include "common/scene/environment.h"

/* A share of light that no 8-bit picture shows. */
#define TRANSMITTANCE_MIN 1e-4f

/* The sky behind all surfaces. */
static struct lw_vec3 behind(const struct lw_compose *compose, struct lw_vec3 direction) {
    if (lw_show_is_chart(compose->show)) return lw_compose_grey(LW_SHOW_BEHIND);
    if (compose->show == LW_SHOW_INDIRECT || compose->show == LW_SHOW_IRRADIANCE) return lw_compose_grey(0);
    return lw_vec3_add(compose->sky, lw_environment_radiance(&compose->scene->environment, direction));
}

/* Takes in one hit; true if the ray goes on behind it. */
static bool shade(struct lw_compose *compose, struct lw_compose_packet *p, const struct lw_compose_look *look,
                  const struct lw_hit16 *hits, unsigned i, bool last, struct lw_compose_finished *f) {
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
    const bool finished = lw_compose_shades_finish(compose, facet->material);
    if (facet->varies && !(finished && look->patch->simple))
        (finished ? lw_scene_facet_base : lw_scene_facet_colour)(compose->scene, facet, look->weight,
                                                                 &look->texels, &surface);
    if (p->is_mirrored && compose->drawn_material &&
        compose->drawn_material[facet->material - compose->scene->material])
        surface.emission = lw_vec3(0, 0, 0); /* the lamp's highlight is drawn */
    float alpha = 1.0f;
    if (facet->material->alpha_mode == LW_ALPHA_BLEND && !last) alpha = surface.alpha;
    if (alpha > 0 && finished) {
        lw_compose_finish_take(compose, p, look, hits, i, &surface, p->transmittance[i] * alpha, f);
        p->transmittance[i] *= 1.0f - alpha;
    } else if (alpha > 0) {
        int level;
        const struct lw_vec3 e = lw_compose_look_light(compose, look, &level).e;
        struct lw_vec3 reflected = lw_vec3_scale(lw_vec3_mul(surface.albedo, e), 1.0f / LW_PI);
        struct lw_vec3 reflects = surface.albedo;
        const struct lw_vec3 shown =
            lw_compose_look_leaving(compose, look, surface.emission, reflected, e, level, &reflects);
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

uint16_t lw_compose_hits_meet(struct lw_compose *compose, struct lw_compose_packet *p, uint16_t going,
                              bool last, struct lw_compose_patches *patches,
                              struct lw_compose_look look[LW_TRACE_WIDTH], struct lw_hit16 *hits,
                              struct lw_compose_finished *f) {
    uint16_t go_on = 0;
    f->lanes = 0;
    lw_trace_closest16(compose->trace, LW_TRACE_VIEW | (p->is_mirrored ? 0 : LW_TRACE_COHERENT), going,
                       &p->rays, hits);
    patches->packet++;
    for (unsigned i = 0; i < LW_TRACE_WIDTH; i++)
        if (going >> i & 1u) lw_compose_look_at(compose, patches, p, hits, i, &look[i]);
    for (unsigned i = 0; i < LW_TRACE_WIDTH; i++)
        if ((going >> i & 1u) && shade(compose, p, &look[i], hits, i, last, f)) go_on |= (uint16_t)(1u << i);
    if (f->lanes) lw_compose_finish_shade(compose, p, look, f);
    return go_on;
}
