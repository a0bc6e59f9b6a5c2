#include "client/view/shading/gloss.h"

#include "common/base/wide.h"
#include "common/light/direction_form.h"
#include "common/shading/lobe_table.h"
#include "common/shading/microfacets.h"
#include "common/shading/shading_bend.h"

#include <float.h>

#define WIDTH LW_GLOSS_WIDTH

#define GRAZING      1e-4f /* the smallest cosine of an eye */
#define GRAZING_IN   1e-3f /* the same of light: lamps have a size */
#define SPREAD_MAX   0.18f
#define SPREAD_ALONE 0.01f /* for pixels without neighbours: a lamp's lobe of alpha 0.1 */
#define BUMP_MAX     1e4f  /* slope */
#define SHORT2       1e-12f
#define EVEN_MIN     1e-3f

LW_WIDE_INLINE float least(float a, float b) { return a < b ? a : b; }
LW_WIDE_INLINE float most(float a, float b) { return a > b ? a : b; }
LW_WIDE_INLINE float inside(float x, float low, float high) { return least(most(x, low), high); }

/* A channel of look-ups, in [0, 1]. */
LW_WIDE_INLINE float channel(const struct lw_gloss_texels16 *t, unsigned shift, unsigned i) {
    const float a = (float)(int)(t->at[0][i] >> shift & 255u), b = (float)(int)(t->at[1][i] >> shift & 255u),
                c = (float)(int)(t->at[2][i] >> shift & 255u), d = (float)(int)(t->at[3][i] >> shift & 255u);
    const float upper = a + t->x[i] * (b - a), lower = c + t->x[i] * (d - c);
    return (upper + t->y[i] * (lower - upper)) * (1.0f / 255);
}

/* The bumped normal, on the side that is seen. Where the map's tangent is none, the plain one. */
LW_WIDE static void bump_all(const struct lw_gloss16 *restrict g, float (*restrict normal)[WIDTH]) {
    for (unsigned i = 0; i < WIDTH; i++) {
        const float side = g->side[i];
        const float nx = side * g->plain[0][i], ny = side * g->plain[1][i], nz = side * g->plain[2][i];
        float tx = g->tangent[0][i], ty = g->tangent[1][i], tz = g->tangent[2][i];
        const float along = tx * nx + ty * ny + tz * nz;
        tx -= along * nx, ty -= along * ny, tz -= along * nz;
        const float length2 = tx * tx + ty * ty + tz * tz;
        const bool good = (length2 > SHORT2) & (length2 < FLT_MAX);
        const float scale = good ? 1 / sqrtf(length2) : 0;
        tx *= scale, ty *= scale, tz *= scale;
        const float bx = ny * tz - nz * ty, by = nz * tx - nx * tz, bz = nx * ty - ny * tx;
        const float u = 2 * channel(&g->bump, 0, i) - 1, v = 2 * channel(&g->bump, 8, i) - 1;
        const float x = inside(g->normal_scale[i] * u, -BUMP_MAX, BUMP_MAX);
        const float y = inside(g->normal_scale[i] * v, -BUMP_MAX, BUMP_MAX) * g->turn[i];
        const float z = sqrtf(most(1 - u * u - v * v, 1e-4f));
        const float mx = x * tx + y * bx + z * nx, my = x * ty + y * by + z * ny,
                    mz = x * tz + y * bz + z * nz;
        const float unit = side / sqrtf(most(mx * mx + my * my + mz * mz, SHORT2));
        normal[0][i] = mx * unit, normal[1][i] = my * unit, normal[2][i] = mz * unit;
    }
}

LW_WIDE static void read_all(const struct lw_gloss16 *restrict g, struct lw_gloss_seen16 *restrict out) {
    for (unsigned i = 0; i < WIDTH; i++) {
        out->roughness[i] = inside(g->roughness[i] * channel(&g->surface, 8, i), 0, 1);
        out->metalness[i] = inside(g->metalness[i] * channel(&g->surface, 16, i), 0, 1);
        out->open[i] = 1 + g->occlusion[i] * (channel(&g->shade, 0, i) - 1);
        out->alpha[i] = most(out->roughness[i] * out->roughness[i], LW_MICROFACETS_ALPHA_MIN);
    }
}

/* lw_shading_bend(), and the unit direction of the eye. */
LW_WIDE static void bend_all(const struct lw_gloss16 *restrict g, struct lw_gloss_seen16 *restrict out) {
    for (unsigned i = 0; i < WIDTH; i++) {
        float vx = g->to_eye[0][i], vy = g->to_eye[1][i], vz = g->to_eye[2][i];
        const float near = 1 / sqrtf(most(vx * vx + vy * vy + vz * vz, FLT_MIN));
        vx *= near, vy *= near, vz *= near;
        float gx = g->plain[0][i], gy = g->plain[1][i], gz = g->plain[2][i];
        const float turned = most(LW_SHADING_BEND_SEEN_MIN - (gx * vx + gy * vy + gz * vz), 0);
        gx += turned * vx, gy += turned * vy, gz += turned * vz;
        const float even = 1 / sqrtf(most(gx * gx + gy * gy + gz * gz, SHORT2));
        gx *= even, gy *= even, gz *= even;
        const float nx = out->normal[0][i], ny = out->normal[1][i], nz = out->normal[2][i];
        const float seen = gx * vx + gy * vy + gz * vz, wanted = least(0.9f * seen, 0.01f);
        const float facing = nx * vx + ny * vy + nz * vz;
        float rx = 2 * facing * nx - vx, ry = 2 * facing * ny - vy, rz = 2 * facing * nz - vz;
        const float above = rx * gx + ry * gy + rz * gz, lift = most(wanted - above, 0);
        rx += lift * gx, ry += lift * gy, rz += lift * gz;
        const float unit = 1 / sqrtf(most(rx * rx + ry * ry + rz * rz, SHORT2));
        const float hx = rx * unit + vx, hy = ry * unit + vy, hz = rz * unit + vz;
        const float half2 = hx * hx + hy * hy + hz * hz, scale = 1 / sqrtf(most(half2, SHORT2));
        const bool stays = (facing > 0) & (above >= wanted), none = !(half2 > SHORT2);
        const float x = stays  ? nx
                        : none ? gx
                               : hx * scale,
                    y = stays  ? ny
                        : none ? gy
                               : hy * scale,
                    z = stays  ? nz
                        : none ? gz
                               : hz * scale;
        out->normal[0][i] = x, out->normal[1][i] = y, out->normal[2][i] = z;
        out->eye[0][i] = vx, out->eye[1][i] = vy, out->eye[2][i] = vz;
        out->cosine[i] = inside(x * vx + y * vy + z * vz, GRAZING, 1);
    }
}

/* The two shares of an entry of the packed table. */
LW_WIDE_INLINE float share_a(uint32_t entry) { return (float)(int)(entry & 0xffffu) * (1.0f / 65535); }
LW_WIDE_INLINE float share_b(uint32_t entry) { return (float)(int)(entry >> 16) * (1.0f / 65535); }

LW_WIDE_INLINE float mix(float a, float b, float t) { return a + t * (b - a); }

/* a and b of lobe_table.h; where light falls out of it by rounding, none. */
LW_WIDE static void look_up(const uint32_t *restrict table, const float *restrict cosine,
                            const float *restrict roughness, float *restrict a, float *restrict b) {
    const int side = LW_LOBE_TABLE_SIDE;
    for (unsigned i = 0; i < WIDTH; i++) {
        const float x = sqrtf(cosine[i]) * (float)(side - 1), y = roughness[i] * (float)(side - 1);
        const int cut_x = (int)x, cut_y = (int)y; /* to be cut off as floats they would want a branch */
        const int u = cut_x < side - 2 ? cut_x : side - 2, v = cut_y < side - 2 ? cut_y : side - 2;
        const float s = x - (float)u, t = y - (float)v;
        const int at = v * side + u;
        const uint32_t first = table[at], second = table[at + 1], third = table[at + side],
                       fourth = table[at + side + 1];
        a[i] = mix(mix(share_a(first), share_a(second), s), mix(share_a(third), share_a(fourth), s), t);
        b[i] = mix(mix(share_b(first), share_b(second), s), mix(share_b(third), share_b(fourth), s), t);
    }
}

/* What the gloss leaves of light along a direction. */
LW_WIDE_INLINE float leave(float gloss0, float gloss90, float a, float b) {
    const float again = 1 / inside(a + b, 1e-3f, 1) - 1;
    return most(1 - (gloss0 * a + gloss90 * b) * (1 + gloss0 * again), 0);
}

/* The same of even light. */
static void leave_even(struct lw_gloss_seen16 *seen) {
    float cosine[WIDTH], a[WIDTH], b[WIDTH];
    for (unsigned i = 0; i < WIDTH; i++) cosine[i] = LW_GLOSS_EVEN0 + LW_GLOSS_EVEN1 * seen->roughness[i];
    look_up(lw_lobe_table_packed(), cosine, seen->roughness, a, b);
    for (unsigned i = 0; i < WIDTH; i++)
        seen->even[i] = most(leave(seen->gloss0[i], seen->gloss90[i], a[i], b[i]), EVEN_MIN);
}

LW_WIDE static void weigh_all(const struct lw_gloss16 *restrict g, const float *restrict a,
                              const float *restrict b, struct lw_gloss_seen16 *restrict out) {
    float under[WIDTH], again[WIDTH], f90[WIDTH], strength[WIDTH];
    for (unsigned i = 0; i < WIDTH; i++) {
        const float metal = out->metalness[i];
        strength[i] = inside(g->specular[i], 0, 1);
        f90[i] = strength[i] + metal * (1 - strength[i]);
        const float gloss0 =
            inside(most(g->dielectric[0][i], most(g->dielectric[1][i], g->dielectric[2][i])), 0, 1);
        out->gloss0[i] = strength[i] * gloss0, out->gloss90[i] = strength[i];
        again[i] = 1 / inside(a[i] + b[i], 1e-3f, 1) - 1;
        under[i] = leave(out->gloss0[i], out->gloss90[i], a[i], b[i]) * (1 - metal);
    }
    for (unsigned c = 0; c < 3; c++)
        for (unsigned i = 0; i < WIDTH; i++) {
            const float gloss = inside(g->dielectric[c][i], 0, 1) * strength[i];
            const float f0 = gloss + out->metalness[i] * (g->base[c][i] - gloss), boost = 1 + f0 * again[i];
            out->diffuse[c][i] = g->base[c][i] * under[i];
            out->mirror[c][i] = f0 * boost;
            out->rim[c][i] = most(f90[i] - f0, 0) * boost;
            out->mirrored[c][i] = (f0 * a[i] + f90[i] * b[i]) * boost;
        }
}

/* Difference s of neighbours in a quad, over the samples of a pixel. Thin objects and edges have none. A lobe
 * that is wider than that shows no glints: s is lowered to s s / (s + alpha^2). */
LW_WIDE static void spread_all(const float (*restrict normal)[WIDTH], const float *restrict alpha,
                               unsigned quads, float samples, float *restrict out) {
    const float share = 1 / most(samples, 1);
    for (unsigned i = 0; i < WIDTH; i++) {
        float sum = 0;
        for (unsigned c = 0; c < 3; c++) {
            const float across = normal[c][i] - normal[c][i ^ 1u], down = normal[c][i] - normal[c][i ^ 4u];
            sum += across * across + down * down;
        }
        const float s = share * (quads >> i & 1u ? least(0.5f * sum, SPREAD_MAX) : SPREAD_ALONE);
        out[i] = s * s / (s + alpha[i] * alpha[i]);
    }
}

void lw_gloss_see16(const struct lw_gloss16 *gloss, struct lw_gloss_seen16 *out) {
    float a[WIDTH], b[WIDTH];
    bump_all(gloss, out->normal);
    bend_all(gloss, out);
    read_all(gloss, out);
    spread_all((const float(*)[WIDTH])out->normal, out->alpha, gloss->quads, gloss->samples, out->spread);
    look_up(lw_lobe_table_packed(), out->cosine, out->roughness, a, b);
    weigh_all(gloss, a, b, out);
    leave_even(out);
}

void lw_gloss_take_off(struct lw_gloss_seen16 *seen) {
    for (unsigned i = 0; i < WIDTH; i++) seen->gloss0[i] = seen->gloss90[i] = 0, seen->even[i] = 1;
}

/* The open sky: open is its irradiance over pi, mirrored its radiance in the mirror. As much of it is seen as
 * each colour of e allows. */
LW_WIDE static void ambient_all(const struct lw_gloss_seen16 *restrict seen, const float (*restrict e)[WIDTH],
                                const float (*restrict open)[WIDTH], const float (*restrict mirrored)[WIDTH],
                                const float *restrict factor, const float *restrict gain,
                                float (*restrict out)[WIDTH]) {
    float share[WIDTH];
    for (unsigned i = 0; i < WIDTH; i++) share[i] = open[0][i] + open[1][i] + open[2][i] > 0;
    for (unsigned c = 0; c < 3; c++)
        for (unsigned i = 0; i < WIDTH; i++)
            share[i] = least(share[i], e[c][i] * (1 / LW_PI) / most(open[c][i], FLT_MIN));
    for (unsigned c = 0; c < 3; c++)
        for (unsigned i = 0; i < WIDTH; i++) {
            const float even = e[c][i] * (1 / LW_PI);
            const float ambient = share[i] * mirrored[c][i] + most(even - share[i] * open[c][i], 0);
            out[c][i] = seen->open[i] *
                        (factor[i] * even * seen->diffuse[c][i] + gain[i] * ambient * seen->mirrored[c][i]);
        }
}

/* e^x for x <= 0, to 1e-4 of the value; 0 below -80. */
LW_WIDE_INLINE float exp_of(float x) {
    const float t = most(x, -80) * 1.442695041f, whole = (float)(int)(t - 0.5f),
                f = (t - whole) * 0.693147181f;
    const union {
        int32_t bits;
        float value;
    } power = {.bits = ((int)whole + 127) << 23};
    const float series = 1 + f * (1 + f * (1 / 2.0f + f * (1 / 6.0f + f * (1 / 24.0f))));
    return x < -80 ? 0 : power.value * series;
}

/* lw_direction_source_of(), lw_direction_factor() and lw_direction_gain(). */
LW_WIDE static void direct_all(const struct lw_gloss16 *restrict g,
                               const struct lw_gloss_seen16 *restrict seen,
                               const float (*restrict direction)[WIDTH], float *restrict factor,
                               float *restrict gain) {
    for (unsigned i = 0; i < WIDTH; i++) {
        const float nx = g->plain[0][i], ny = g->plain[1][i], nz = g->plain[2][i];
        float rx = direction[0][i], ry = direction[1][i], rz = direction[2][i];
        const float length2 = rx * rx + ry * ry + rz * rz;
        const bool known = (length2 > LW_DIRECTION_SHORT * LW_DIRECTION_SHORT) & (length2 < FLT_MAX);
        const float scale = 1 / sqrtf(inside(length2, 1, FLT_MAX));
        rx = known ? rx * scale : 0, ry = known ? ry * scale : 0, rz = known ? rz * scale : 0;
        const float below = most(-(rx * nx + ry * ny + rz * nz), 0) - LW_DIRECTION_EVEN;
        const float ux = rx + below * nx, uy = ry + below * ny, uz = rz + below * nz;
        const float rise = 1.2f * (ux * nx + uy * ny + uz * nz);
        const float found = least(rise + sqrtf(rise * rise + 1.8f * (ux * ux + uy * uy + uz * uz)), 1);
        const bool even = !known | !(found > LW_DIRECTION_SHORT);
        const float w = even ? 0 : found, inverse = 1 / most(found, LW_DIRECTION_SHORT);
        float dx = ux * inverse + LW_DIRECTION_EVEN * nx, dy = uy * inverse + LW_DIRECTION_EVEN * ny,
              dz = uz * inverse + LW_DIRECTION_EVEN * nz;
        const float unit = 1 / sqrtf(most(dx * dx + dy * dy + dz * dz, SHORT2));
        dx = even ? nx : dx * unit, dy = even ? ny : dy * unit, dz = even ? nz : dz * unit;
        const float mx = seen->normal[0][i], my = seen->normal[1][i], mz = seen->normal[2][i];
        const float own = dx * nx + dy * ny + dz * nz, bent = dx * mx + dy * my + dz * mz;
        const float wide = 0.5f * (1 - w);
        const float lobe_own = (1 - wide) * most(own, 0) + wide * 0.5f * (1 + own),
                    lobe_bent = (1 - wide) * most(bent, 0) + wide * 0.5f * (1 + bent);
        const float turned = nx * (mx - nx) + ny * (my - ny) + nz * (mz - nz);
        const float bends = wide * turned + w * (lobe_bent - lobe_own) / most(lobe_own, 0.05f);
        factor[i] = inside(known ? 1 + bends : 1, 0, LW_DIRECTION_FACTOR_MAX);
        const float sharp = 2 + 12 * w / (1.02f - w), q = 0.5f / (seen->alpha[i] * seen->alpha[i]),
                    k = sharp * q / (sharp + q), behind = exp_of(-2 * k);
        const float high = ((1 + behind) / (1 - behind) - 1 / k) * own;
        const float cosine = most(0.5f * (high + sqrtf(high * high + 1 / (4 + 0.5f * LW_PI * k))), 0.05f);
        const float facing = 2 * seen->cosine[i];
        const float along = (facing * mx - seen->eye[0][i]) * dx + (facing * my - seen->eye[1][i]) * dy +
                            (facing * mz - seen->eye[2][i]) * dz;
        const float lobe = k * exp_of(k * (least(along, 1) - 1)) / (2 * cosine * (1 - behind));
        gain[i] = least(1 - w + w * lobe, LW_DIRECTION_GAIN_MAX);
    }
}

void lw_gloss_direct16(const struct lw_gloss16 *gloss, const struct lw_gloss_seen16 *seen,
                       const float (*direction)[LW_GLOSS_WIDTH], float out_factor[LW_GLOSS_WIDTH],
                       float out_gain[LW_GLOSS_WIDTH]) {
    direct_all(gloss, seen, direction, out_factor, out_gain);
}

static struct lw_vec3 lane(const float (*from)[WIDTH], unsigned i) {
    return lw_vec3(from[0][i], from[1][i], from[2][i]);
}

static void add_lane(float (*to)[WIDTH], unsigned i, struct lw_vec3 v) {
    to[0][i] += v.x, to[1][i] += v.y, to[2][i] += v.z;
}

void lw_gloss_ambient16(const struct lw_gloss16 *gloss, const struct lw_gloss_seen16 *seen, uint16_t lanes,
                        const struct lw_gloss_sky *sky, const float e[3][LW_GLOSS_WIDTH],
                        const float (*direction)[LW_GLOSS_WIDTH], const float *kept,
                        float out[3][LW_GLOSS_WIDTH]) {
    float open[3][WIDTH], mirrored[3][WIDTH], factor[WIDTH], gain[WIDTH];
    const float even[3] = {sky->sky.x, sky->sky.y, sky->sky.z};
    for (unsigned c = 0; c < 3; c++)
        for (unsigned i = 0; i < WIDTH; i++) open[c][i] = mirrored[c][i] = even[c];
    for (uint32_t left = sky->ambient->rgb ? lanes : 0; left; left &= left - 1) {
        const unsigned i = (unsigned)__builtin_ctz(left);
        const struct lw_vec3 normal = lane(seen->normal, i), eye = lane(seen->eye, i);
        const struct lw_vec3 mirror = lw_vec3_sub(lw_vec3_scale(normal, 2 * seen->cosine[i]), eye);
        add_lane(open, i, lw_ambient_matt(sky->ambient, lane(gloss->plain, i)));
        add_lane(mirrored, i, lw_ambient_mirrored(sky->ambient, mirror, seen->roughness[i]));
    }
    for (unsigned i = 0; i < WIDTH; i++) factor[i] = gain[i] = 1;
    if (direction) lw_gloss_direct16(gloss, seen, direction, factor, gain);
    for (unsigned i = 0; kept && i < WIDTH; i++) gain[i] *= kept[i];
    ambient_all(seen, e, (const float(*)[WIDTH])open, (const float(*)[WIDTH])mirrored, factor, gain, out);
}

LW_WIDE_INLINE float stretch(float cosine, float alpha2) {
    return sqrtf(alpha2 + (1 - alpha2) * cosine * cosine);
}

/* at_point: 0 for a sun, whose direction is the same everywhere; else 1. */
LW_WIDE static void lamp_all(const struct lw_gloss_seen16 *restrict g, const struct lw_points16 *restrict p,
                             struct lw_vec3 at, float at_point, float radius, float *restrict dv,
                             float *restrict rim, float *restrict come) {
    for (unsigned i = 0; i < WIDTH; i++) {
        float x = at.x - at_point * p->x[i], y = at.y - at_point * p->y[i], z = at.z - at_point * p->z[i];
        const float near = 1 / sqrtf(x * x + y * y + z * z + 1e-20f);
        x *= near, y *= near, z *= near;
        const float nx = g->normal[0][i], ny = g->normal[1][i], nz = g->normal[2][i];
        const float vx = g->eye[0][i], vy = g->eye[1][i], vz = g->eye[2][i];
        const float wide = 0.5f * radius * near;
        const float a2 = least(g->alpha[i] * g->alpha[i] + g->spread[i] + wide * wide, 1);
        const float in = inside(nx * x + ny * y + nz * z, GRAZING_IN, 1), out = g->cosine[i];
        float hx = x + vx, hy = y + vy, hz = z + vz;
        const float unit = 1 / sqrtf(hx * hx + hy * hy + hz * hz + SHORT2);
        hx *= unit, hy *= unit, hz *= unit;
        const float cx = ny * hz - nz * hy, cy = nz * hx - nx * hz, cz = nx * hy - ny * hx;
        const float up = nx * hx + ny * hy + nz * hz;
        const float d = cx * cx + cy * cy + cz * cz + a2 * up * up;
        const float v = 0.5f / (in * stretch(out, a2) + out * stretch(in, a2));
        const float c = 1 - inside(vx * hx + vy * hy + vz * hz, 0, 1), c2 = c * c;
        dv[i] = a2 / (LW_PI * d * d + FLT_MIN) * v;
        rim[i] = c2 * c2 * c;
        come[i] = in;
    }
}

void lw_gloss_lamp16(const struct lw_gloss_seen16 *seen, const struct lw_points16 *points,
                     const struct lw_gloss_lamp *lamp, struct lw_gloss_lit16 *out) {
    float come[WIDTH], a[WIDTH], b[WIDTH];
    lamp_all(seen, points, lamp->at, lamp->is_sun ? 0 : 1, lamp->radius, out->dv, out->rim, come);
    look_up(lw_lobe_table_packed(), come, seen->roughness, a, b);
    for (unsigned i = 0; i < WIDTH; i++)
        out->left[i] = leave(seen->gloss0[i], seen->gloss90[i], a[i], b[i]) / seen->even[i];
}
