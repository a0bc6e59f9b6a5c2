#include "common/shading/lobes.h"

#include "common/shading/lobe_table.h"
#include "common/shading/microfacets.h"

/* Below it a mirror that loses nothing has nothing to spread. */
#define LOST_MIN 1e-4f

#define GRAZING 1e-4f /* the smallest cosine of an eye */

/* Fm of facets whose mean Fresnel reflectance is f, which send back `mean` once. */
static float many_times(float f, float mean) { return f * f * mean / (1 - f * (1 - mean)); }

/* Schlick's reflectance, the mean over all directions: the mean of c is 1/21. */
static float fresnel_mean(float f0, float f90) { return f0 + (f90 - f0) * (1.0f / 21); }

static float total(struct lw_lobe_share s) { return fminf(s.a + s.b, 1); }

static float largest(struct lw_vec3 v) { return fmaxf(v.x, fmaxf(v.y, v.z)); }

/* G: of the gloss alone. */
static float of_gloss(const struct lw_lobes *lobes, struct lw_lobe_share s, float many) {
    return fminf(lobes->gloss0 * s.a + lobes->gloss90 * s.b + (1 - total(s)) * many, 1);
}

struct lw_lobes_seen lw_lobes_see(const struct lw_lobes *lobes, struct lw_vec3 to_eye) {
    const struct lw_vec3 above = lw_vec3_normalize(lw_vec3(to_eye.x, to_eye.y, fmaxf(to_eye.z, GRAZING)));
    struct lw_lobes_seen seen = {.lobes = *lobes, .to_eye = above};
    seen.diffuse = lw_vec3_scale(lobes->diffuse, 1 / LW_PI);
    seen.spread = lobes->diffuse;
    if (!lw_lobes_mirror(lobes)) return seen;
    seen.alpha = lw_microfacets_alpha(lobes->roughness);
    const struct lw_lobe_share at = lw_lobe_table_at(seen.to_eye.z, lobes->roughness);
    const struct lw_lobe_share mean = lw_lobe_table_mean(lobes->roughness);
    const float e = total(mean), lost = 1 - total(at);
    const struct lw_vec3 f0 = lobes->f0;
    const struct lw_vec3 many =
        lw_vec3(many_times(fresnel_mean(f0.x, lobes->f90), e), many_times(fresnel_mean(f0.y, lobes->f90), e),
                many_times(fresnel_mean(f0.z, lobes->f90), e));
    seen.of_gloss = many_times(fresnel_mean(lobes->gloss0, lobes->gloss90), e);
    if (1 - e > LOST_MIN) seen.many = lw_vec3_scale(many, lost / (LW_PI * (1 - e)));
    const float left = 1 - of_gloss(lobes, at, seen.of_gloss);
    const float left_mean = 1 - of_gloss(lobes, mean, seen.of_gloss);
    seen.diffuse = lw_vec3_scale(lobes->diffuse, left / (LW_PI * fmaxf(left_mean, LOST_MIN)));
    seen.mirrored = lw_vec3(f0.x * at.a + lobes->f90 * at.b, f0.y * at.a + lobes->f90 * at.b,
                            f0.z * at.a + lobes->f90 * at.b);
    seen.spread = lw_vec3_mad(lw_vec3_scale(lobes->diffuse, left), many, lost);
    const float mirrored = largest(seen.mirrored), spread = largest(seen.spread);
    seen.mirror_share = mirrored / fmaxf(mirrored + spread, 1e-12f);
    return seen;
}

static struct lw_vec3 mirrored_once(const struct lw_lobes_seen *seen, struct lw_vec3 to_light,
                                    struct lw_vec3 half) {
    const float d = lw_microfacets_density(half, seen->alpha);
    const float v = lw_microfacets_visibility(seen->to_eye.z, to_light.z, seen->alpha);
    const float c = lw_microfacets_schlick(lw_vec3_dot(seen->to_eye, half)), f90 = seen->lobes.f90;
    const struct lw_vec3 f0 = seen->lobes.f0;
    const struct lw_vec3 f =
        lw_vec3(f0.x + (f90 - f0.x) * c, f0.y + (f90 - f0.y) * c, f0.z + (f90 - f0.z) * c);
    return lw_vec3_scale(f, d * v);
}

struct lw_vec3 lw_lobes_reflect(const struct lw_lobes_seen *seen, struct lw_vec3 to_light) {
    if (!(to_light.z > 0)) return lw_vec3(0, 0, 0);
    if (!lw_lobes_mirror(&seen->lobes)) return lw_vec3_scale(seen->diffuse, to_light.z);
    const struct lw_lobe_share at = lw_lobe_table_at(to_light.z, seen->lobes.roughness);
    const float left = 1 - of_gloss(&seen->lobes, at, seen->of_gloss);
    const struct lw_vec3 half = lw_vec3_normalize(lw_vec3_add(seen->to_eye, to_light));
    struct lw_vec3 f = mirrored_once(seen, to_light, half);
    f = lw_vec3_mad(f, seen->diffuse, left);
    f = lw_vec3_mad(f, seen->many, 1 - total(at));
    return lw_vec3_scale(f, to_light.z);
}

bool lw_lobes_sample(const struct lw_lobes_seen *seen, const float u[2], float pick, struct lw_vec3 *out) {
    if (pick < seen->mirror_share) {
        *out = lw_microfacets_mirror(seen->to_eye, lw_microfacets_sample(seen->to_eye, seen->alpha, u));
        return out->z > 0;
    }
    const float r = sqrtf(u[0]), phi = 2 * LW_PI * u[1];
    *out = lw_vec3(r * cosf(phi), r * sinf(phi), sqrtf(fmaxf(1 - u[0], 0)));
    return out->z > 0;
}

float lw_lobes_pdf_with(const struct lw_lobes_seen *seen, struct lw_vec3 to_light, float spread) {
    if (!(to_light.z > 0)) return 0;
    const float rest = (1 - seen->mirror_share) * spread;
    if (!(seen->mirror_share > 0)) return rest;
    const struct lw_vec3 half = lw_vec3_normalize(lw_vec3_add(seen->to_eye, to_light));
    return rest + seen->mirror_share * lw_microfacets_pdf(seen->to_eye, half, seen->alpha);
}

float lw_lobes_pdf(const struct lw_lobes_seen *seen, struct lw_vec3 to_light) {
    return lw_lobes_pdf_with(seen, to_light, to_light.z / LW_PI);
}

/* By the diffuse lobe, and by facets once and many times. */
static float sent_back(float diffuse, float f0, float f90, struct lw_lobe_share mean) {
    const float e = total(mean), many = many_times(fresnel_mean(f0, f90), e);
    return fminf(diffuse + f0 * mean.a + f90 * mean.b + (1 - e) * many, 1);
}

struct lw_vec3 lw_lobes_albedo(const struct lw_lobes *lobes) {
    if (!lw_lobes_mirror(lobes)) return lobes->diffuse;
    const struct lw_lobe_share mean = lw_lobe_table_mean(lobes->roughness);
    const float many = many_times(fresnel_mean(lobes->gloss0, lobes->gloss90), total(mean));
    const float left = 1 - of_gloss(lobes, mean, many);
    return lw_vec3(sent_back(lobes->diffuse.x * left, lobes->f0.x, lobes->f90, mean),
                   sent_back(lobes->diffuse.y * left, lobes->f0.y, lobes->f90, mean),
                   sent_back(lobes->diffuse.z * left, lobes->f0.z, lobes->f90, mean));
}
