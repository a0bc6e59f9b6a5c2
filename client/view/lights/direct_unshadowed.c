#include "client/view/lights/direct_unshadowed.h"

#include "common/base/colour.h"
#include "common/base/wide.h"

#define LANES LW_DIRECT_LANES

/* A cluster looks like a disc that is smaller than the ball around it. */
#define DISC_SHARE 0.6f

LW_WIDE static uint32_t find_positive(const float *restrict e) {
    uint32_t bits = 0;
    for (uint32_t k = 0; k < LANES; k++) bits |= e[k] > 0 ? 1u << k : 0;
    return bits;
}

uint16_t lw_direct_unshadowed_points(const struct lw_direct_pixels *d, uint32_t candidate,
                                     const struct lw_points16 *points, float e[LANES]) {
    const uint32_t index = d->candidates.index[candidate];
    if (d->candidates.kind[candidate] == LW_DIRECT_CLUSTER) {
        lw_emitter_clusters_light16(&d->clusters.cluster[index], points, e);
    } else {
        struct lw_light_sample16 sample;
        lw_lights_sample_punctual16(&d->lights, index, 0, 0, points, &sample);
        const struct lw_vec3 i = d->lights.punctual[index].intensity;
        const float scale = 1 / (i.x + i.y + i.z);
        for (uint32_t k = 0; k < LANES; k++)
            e[k] = (sample.e[0][k] + sample.e[1][k] + sample.e[2][k]) * scale;
    }
    return (uint16_t)find_positive(e);
}

struct lw_vec3 lw_direct_unshadowed_colour(const struct lw_direct_pixels *d, uint32_t candidate) {
    const uint32_t index = d->candidates.index[candidate];
    return d->candidates.kind[candidate] == LW_DIRECT_CLUSTER ? d->clusters.cluster[index].colour
                                                              : d->lights.punctual[index].intensity;
}

LW_WIDE void lw_direct_unshadowed_bump(const struct lw_direct_block *restrict block,
                                       struct lw_points16 *restrict out) {
    for (uint32_t i = 0; i < LANES; i++) {
        const bool finished = block->finished >> i & 1u;
        out->x[i] = block->points.x[i], out->y[i] = block->points.y[i], out->z[i] = block->points.z[i];
        out->nx[i] = finished ? block->seen.normal[0][i] : block->points.nx[i];
        out->ny[i] = finished ? block->seen.normal[1][i] : block->points.ny[i];
        out->nz[i] = finished ? block->seen.normal[2][i] : block->points.nz[i];
    }
}

/* Bits of the points whose plain surface faces a lamp. */
LW_WIDE static uint32_t find_above(const struct lw_points16 *restrict p, struct lw_vec3 at, float at_point,
                                   float radius) {
    uint32_t bits = 0;
    for (uint32_t i = 0; i < LANES; i++) {
        const float x = at.x - at_point * p->x[i], y = at.y - at_point * p->y[i],
                    z = at.z - at_point * p->z[i];
        bits |= p->nx[i] * x + p->ny[i] * y + p->nz[i] * z > -radius ? 1u << i : 0;
    }
    return bits;
}

static struct lw_gloss_lamp lamp_of(const struct lw_direct_pixels *d, uint32_t candidate) {
    const struct lw_direct_candidates *c = &d->candidates;
    const uint32_t index = c->index[candidate];
    if (c->kind[candidate] != LW_DIRECT_SUN)
        return (struct lw_gloss_lamp){.at = lw_vec3(c->x[candidate], c->y[candidate], c->z[candidate]),
                                      .radius = DISC_SHARE * c->radius_m[candidate]};
    return (struct lw_gloss_lamp){.at = lw_vec3_scale(d->lights.punctual[index].direction_ws, -1),
                                  .radius = tanf(0.5f * d->desc.scene->light[index].angular_diameter),
                                  .is_sun = true};
}

/* The same of a block with finishes, and the shares of e that it mirrors. */
static uint16_t light_finished(const struct lw_direct_pixels *d, uint32_t candidate,
                               const struct lw_direct_block *block, float e[LANES],
                               struct lw_gloss_lit16 *lit) {
    const struct lw_gloss_lamp lamp = lamp_of(d, candidate);
    struct lw_points16 bumped;
    lw_direct_unshadowed_bump(block, &bumped);
    const uint32_t reached = lw_direct_unshadowed_points(d, candidate, &bumped, e);
    /* a part of the lamp is: shadow rays meet the surface itself where they go below it */
    const uint32_t above = find_above(&block->points, lamp.at, lamp.is_sun ? 0 : 1, lamp.radius);
    lw_gloss_lamp16(&block->seen, &block->points, &lamp, lit);
    return (uint16_t)(reached & (above | ~(uint32_t)block->finished));
}

uint16_t lw_direct_unshadowed_block(const struct lw_direct_pixels *d, uint32_t candidate,
                                    struct lw_direct_work *w, const struct lw_direct_block *block,
                                    uint32_t b) {
    return block->finished ? light_finished(d, candidate, block, w->e[b], &w->gloss[b])
                           : lw_direct_unshadowed_points(d, candidate, &block->points, w->e[b]);
}

LW_WIDE void lw_direct_unshadowed_add(const float *restrict e, const struct lw_gloss_lit16 *restrict lit,
                                      struct lw_vec3 colour, struct lw_direct_block *restrict block) {
    const float tint[3] = {colour.x, colour.y, colour.z};
    for (uint32_t c = 0; c < 3; c++)
        for (uint32_t i = 0; i < LANES; i++) {
            const bool finished = block->finished >> i & 1u;
            const float f = block->seen.mirror[c][i] + block->seen.rim[c][i] * lit->rim[i];
            block->e[c][i] += e[i] * tint[c] * (finished ? lit->left[i] : 1);
            block->mirrored[c][i] += finished ? e[i] * lit->dv[i] * tint[c] * f : 0;
        }
}

LW_WIDE void lw_direct_unshadowed_weigh_mirrored(const struct lw_direct_block *restrict block,
                                                 const struct lw_gloss_lit16 *restrict lit,
                                                 float *restrict out) {
    const struct lw_gloss_seen16 *restrict g = &block->seen;
    for (uint32_t i = 0; i < LANES; i++) {
        const float diffuse =
            0.2126f * g->diffuse[0][i] + 0.7152f * g->diffuse[1][i] + 0.0722f * g->diffuse[2][i];
        const float mirror =
            0.2126f * g->mirror[0][i] + 0.7152f * g->mirror[1][i] + 0.0722f * g->mirror[2][i];
        const float edge = 0.2126f * g->rim[0][i] + 0.7152f * g->rim[1][i] + 0.0722f * g->rim[2][i];
        const float all =
            0.2126f * g->mirrored[0][i] + 0.7152f * g->mirrored[1][i] + 0.0722f * g->mirrored[2][i];
        const float shown = diffuse * lit->left[i] + LW_PI * lit->dv[i] * (mirror + edge * lit->rim[i]);
        out[i] = block->finished >> i & 1u ? shown / (diffuse + all + 1e-6f) : 1;
    }
}
