/* Finishes as clients draw them, against the exact lobes and closed forms; whatever a file may have. */
#include "tests/support/support.h"

#include "client/view/shading/gloss_maps.h"
#include "common/base/random.h"
#include "common/light/direction_form.h"
#include "common/shading/lobe_table.h"
#include "common/shading/shading_bend.h"
#include "common/shading/tangent.h"

#include <stdlib.h>
#include <string.h>

enum { WIDTH = LW_GLOSS_WIDTH };

static void set(float (*to)[WIDTH], unsigned i, struct lw_vec3 v) {
    to[0][i] = v.x, to[1][i] = v.y, to[2][i] = v.z;
}
static struct lw_vec3 get(const float (*from)[WIDTH], unsigned i) {
    return lw_vec3(from[0][i], from[1][i], from[2][i]);
}

static void set_texels(struct lw_gloss_texels16 *to, unsigned i, uint32_t texel) {
    for (int k = 0; k < 4; k++) to->at[k][i] = texel;
}

/* What a floor is made of, and the lobes that it has. */
struct stuff {
    struct lw_vec3 base;
    float metalness, roughness;
};
static struct lw_lobes lobes_of(const struct stuff *s) {
    const float under = 1 - s->metalness, gloss = 0.04f;
    return (struct lw_lobes){.diffuse = lw_vec3_scale(s->base, under),
                             .f0 = lw_vec3(gloss * under + s->base.x * s->metalness,
                                           gloss * under + s->base.y * s->metalness,
                                           gloss * under + s->base.z * s->metalness),
                             .f90 = 1,
                             .gloss0 = gloss,
                             .gloss90 = 1,
                             .roughness = s->roughness};
}

/* An even floor that is seen from to_eye. */
static void set_floor(struct lw_gloss16 *g, unsigned i, const struct stuff *s, struct lw_vec3 to_eye) {
    set(g->base, i, s->base);
    g->metalness[i] = s->metalness, g->roughness[i] = s->roughness, g->specular[i] = 1;
    set(g->dielectric, i, lw_vec3(0.04f, 0.04f, 0.04f));
    set_texels(&g->surface, i, UINT32_MAX), set_texels(&g->shade, i, UINT32_MAX);
    set(g->plain, i, lw_vec3(0, 0, 1)), set(g->tangent, i, lw_vec3(1, 0, 0));
    g->turn[i] = g->side[i] = 1;
    g->quads = 0xffff;
    set(g->to_eye, i, to_eye);
}

static struct lw_vec3 ambient(const struct lw_gloss16 *g, const struct lw_gloss_seen16 *seen, unsigned i,
                              const struct lw_gloss_sky *sky, struct lw_vec3 e) {
    float all[3][WIDTH], out[3][WIDTH];
    for (unsigned k = 0; k < WIDTH; k++) set(all, k, e);
    lw_gloss_ambient16(g, seen, (uint16_t)(1u << i), sky, (const float(*)[WIDTH])all, NULL, NULL, out);
    return lw_vec3(out[0][i], out[1][i], out[2][i]);
}

static struct lw_vec3 slanted(float cosine) { return lw_vec3(sqrtf(1 - cosine * cosine), 0, cosine); }

static struct stuff metal(float roughness) { return (struct stuff){{1, 0.7f, 0.3f}, 1, roughness}; }
static struct stuff glossy(float roughness) { return (struct stuff){{1, 1, 1}, 0, roughness}; }

/* Under an even sky white surfaces send back all light, and none sends back more. */
static void test_furnace(void **state) {
    (void)state;
    const struct lw_ambient none = {0};
    const struct lw_gloss_sky sky = {{1, 1, 1}, &none};
    for (int k = 0; k <= 20; k++) {
        struct lw_gloss16 g = {0};
        struct lw_gloss_seen16 seen;
        for (unsigned i = 0; i < WIDTH; i++) {
            struct stuff stuff = i < 8 ? metal((float)k / 20) : glossy((float)k / 20);
            stuff.base = lw_vec3(1, 1, 1);
            set_floor(&g, i, &stuff, slanted(0.05f + 0.95f * (float)(i % 8) / 7));
            if (i % 3 == 2) set(g.dielectric, i, lw_vec3(0.8f, 0.8f, 0.8f)); /* a bright gloss */
        }
        lw_gloss_see16(&g, &seen);
        for (unsigned i = 0; i < WIDTH; i++) {
            const struct lw_vec3 l = ambient(&g, &seen, i, &sky, lw_vec3(LW_PI, LW_PI, LW_PI));
            if (!(l.x > 0.99f && l.x < 1.02f))
                fail_msg("roughness %g, lane %u: %g", (double)g.roughness[i], i, (double)l.x);
        }
    }
}

/* Light of a point lamp in all directions: against the exact lobes; all that is mirrored is what the ambient
 * term has. */
static void test_lamp(void **state) {
    (void)state;
    enum { STEPS = 256 };
    for (int k = 3; k <= 10; k++) {
        const struct stuff stuff = metal((float)k / 10);
        const struct lw_lobes lobes = lobes_of(&stuff);
        struct lw_gloss16 g = {0};
        struct lw_gloss_seen16 seen;
        struct lw_points16 points = {.x = {0}};
        for (unsigned i = 0; i < WIDTH; i++) set_floor(&g, i, &stuff, slanted(0.3f + 0.7f * (float)i / 15));
        lw_gloss_see16(&g, &seen);
        double sum[WIDTH] = {0}, exact[WIDTH] = {0}, off[WIDTH] = {0};
        for (int s = 0; s < STEPS * STEPS; s++) {
            const float u = ((float)(s % STEPS) + 0.5f) / STEPS, v = ((float)(s / STEPS) + 0.5f) / STEPS;
            const float r = sqrtf(u), phi = 2 * LW_PI * v; /* by the cosine: each stands for pi/count of it */
            const struct lw_vec3 to_light = lw_vec3(r * cosf(phi), r * sinf(phi), sqrtf(1 - u));
            const struct lw_gloss_lamp lamp = {.at = to_light, .is_sun = true};
            struct lw_gloss_lit16 lit;
            lw_gloss_lamp16(&seen, &points, &lamp, &lit);
            for (unsigned i = 0; i < WIDTH; i++) {
                const double part = (double)(lit.dv[i] * (seen.mirror[0][i] + seen.rim[0][i] * lit.rim[i]));
                const struct lw_lobes_seen from = lw_lobes_see(&lobes, slanted(0.3f + 0.7f * (float)i / 15));
                const double truth = (double)(lw_lobes_reflect(&from, to_light).x / to_light.z);
                sum[i] += part, exact[i] += truth, off[i] += fabs(part - truth);
            }
            if (k > 3 && s % 4 == 0) s += 12; /* rough lobes want fewer */
        }
        for (unsigned i = 0; i < WIDTH; i++) {
            const double scale = exact[i];
            if (fabs(sum[i] - exact[i]) > 0.02 * scale || off[i] > 0.25 * scale)
                fail_msg("roughness %g, lane %u: %g of light, %g off", k / 10.0, i, sum[i] / scale,
                         off[i] / scale);
        }
    }
}

/* A gloss leaves light of a lamp to the diffuse lobe by the lamp's angle, as the exact lobes do. */
static void test_left(void **state) {
    (void)state;
    for (int k = 2; k <= 20; k++) {
        const struct stuff white = glossy((float)k / 20), black = {{0, 0, 0}, 0, (float)k / 20};
        const struct lw_lobes lobes = lobes_of(&white), gloss = lobes_of(&black);
        struct lw_gloss16 g = {0};
        struct lw_gloss_seen16 seen;
        struct lw_gloss_lit16 lit;
        struct lw_points16 points = {.x = {0}};
        const struct lw_vec3 eye = slanted(0.6f);
        for (unsigned i = 0; i < WIDTH; i++) {
            set_floor(&g, i, &white, eye);
            points.x[i] = -slanted((float)(i + 1) / WIDTH).x,
            points.z[i] = -slanted((float)(i + 1) / WIDTH).z;
        }
        lw_gloss_see16(&g, &seen);
        lw_gloss_lamp16(&seen, &points, &(struct lw_gloss_lamp){.at = {0, 0, 0}}, &lit);
        const struct lw_lobes_seen all = lw_lobes_see(&lobes, eye), mirrored = lw_lobes_see(&gloss, eye);
        for (unsigned i = 0; i < WIDTH; i++) {
            const struct lw_vec3 to_light = slanted((float)(i + 1) / WIDTH);
            const float truth =
                (lw_lobes_reflect(&all, to_light).x - lw_lobes_reflect(&mirrored, to_light).x) / to_light.z;
            const float drawn = seen.diffuse[0][i] / LW_PI * lit.left[i];
            if (fabsf(drawn / truth - 1) > 0.015f)
                fail_msg("roughness %g, cosine %g: %g of it", k / 20.0, (double)to_light.z,
                         (double)(drawn / truth));
        }
    }
}

/* A lamp's highlight lies where the floor is its mirror, and is as bright as D V F there. */
static void test_highlight(void **state) {
    (void)state;
    const float roughness = 0.2f, alpha = roughness * roughness, height = 2;
    const struct stuff stuff = metal(roughness);
    const struct lw_vec3 eye = {-1, 0, 2};
    float best = 0, at = 0;
    for (int n = 0; n < 400; n++) {
        struct lw_gloss16 g = {0};
        struct lw_gloss_seen16 seen;
        struct lw_points16 points = {.x = {0}};
        struct lw_gloss_lit16 lit;
        for (unsigned i = 0; i < WIDTH; i++) {
            points.x[i] = -1 + 2 * (float)(n * 16 + (int)i) / 6400;
            set_floor(&g, i, &stuff, lw_vec3_sub(eye, lw_vec3(points.x[i], 0, 0)));
        }
        lw_gloss_see16(&g, &seen);
        const struct lw_gloss_lamp lamp = {.at = {1, 0, height}};
        lw_gloss_lamp16(&seen, &points, &lamp, &lit);
        for (unsigned i = 0; i < WIDTH; i++)
            if (lit.dv[i] > best) best = lit.dv[i], at = points.x[i];
    }
    assert_true(fabsf(at) < 0.02f);
    /* both cosines are 2 / sqrt 5: their squares 0.8 */
    const float stretch2 = alpha * alpha + (1 - alpha * alpha) * 0.8f;
    const float expected = 1 / (LW_PI * alpha * alpha) * 0.25f / sqrtf(0.8f * stretch2);
    assert_true(fabsf(best - expected) < 0.01f * expected);
}

/* A wide lamp's highlight is wider and weaker, all of it no brighter. */
static void test_wide_lamp(void **state) {
    (void)state;
    enum { STEPS = 128 };
    const struct stuff stuff = metal(0.1f);
    struct lw_gloss16 g = {0};
    struct lw_gloss_seen16 seen;
    struct lw_points16 points = {.x = {0}};
    for (unsigned i = 0; i < WIDTH; i++) set_floor(&g, i, &stuff, slanted(0.3f + 0.7f * (float)i / 15));
    lw_gloss_see16(&g, &seen);
    double sum[WIDTH] = {0};
    for (int s = 0; s < STEPS * STEPS; s++) {
        const float u = ((float)(s % STEPS) + 0.5f) / STEPS,
                    phi = 2 * LW_PI * ((float)(s / STEPS) + 0.5f) / STEPS;
        const float r = sqrtf(u);
        const struct lw_gloss_lamp lamp = {
            .at = {r * cosf(phi), r * sinf(phi), sqrtf(1 - u)}, .radius = 0.5f, .is_sun = true};
        struct lw_gloss_lit16 lit;
        lw_gloss_lamp16(&seen, &points, &lamp, &lit);
        for (unsigned i = 0; i < WIDTH; i++) sum[i] += (double)(LW_PI * lit.dv[i] / (STEPS * STEPS));
    }
    for (unsigned i = 0; i < WIDTH; i++)
        if (!(sum[i] < 1.02 && sum[i] > 0.8)) fail_msg("lane %u: %g", i, sum[i]);
}

/* The mirrored sky: E tells which directions are open. */
static void test_ambient(void **state) {
    (void)state;
    enum { W = 64, H = 32 };
    static float rgb[3 * W * H];
    for (int y = 0; y < H; y++)
        for (int x = 0; x < W; x++)
            for (int c = 0; c < 3; c++) rgb[3 * (y * W + x) + c] = y < H / 2 ? 1 : 0; /* bright above */
    const struct lw_environment e = {.width = W, .height = H, .rgb = rgb};
    struct lw_ambient maps = {0};
    assert_int_equal(lw_ambient_take(&maps, &e), LW_OK);
    for (unsigned k = 0; k < 3 * LW_AMBIENT_MAPS * LW_AMBIENT_SIDE * LW_AMBIENT_SIDE; k++)
        assert_true(maps.rgb[k] >= 0 && maps.rgb[k] <= 1.0001f);
    assert_true(fabsf(lw_ambient_matt(&maps, lw_vec3(0, 1, 0)).x - 1) < 0.01f);
    assert_true(fabsf(lw_ambient_matt(&maps, lw_vec3(1, 0, 0)).x - 0.5f) < 0.02f);
    assert_true(lw_ambient_matt(&maps, lw_vec3(0, -1, 0)).x < 0.01f);
    assert_true(lw_ambient_mirrored(&maps, lw_vec3(0.8f, 0.6f, 0), 0).x > 0.99f);
    assert_true(lw_ambient_mirrored(&maps, lw_vec3(0.8f, -0.6f, 0), 0).x < 0.01f);
    const float blurred = lw_ambient_mirrored(&maps, lw_vec3(0.8f, -0.6f, 0), 0.9f).x;
    assert_true(blurred > 0.05f && blurred < 0.5f);

    const struct lw_gloss_sky sky = {{0, 0, 0}, &maps};
    const struct stuff stuff = metal(0);
    struct lw_gloss16 g = {0};
    struct lw_gloss_seen16 seen;
    for (unsigned i = 0; i < WIDTH; i++) {
        set_floor(&g, i, &stuff, lw_vec3(0.6f, 0.8f, 0)); /* a floor whose up is Y */
        set(g.plain, i, lw_vec3(0, 1, 0));
    }
    lw_gloss_see16(&g, &seen);
    const float open = ambient(&g, &seen, 0, &sky, lw_vec3(LW_PI, LW_PI, LW_PI)).x;
    const float half = ambient(&g, &seen, 0, &sky, lw_vec3(LW_PI / 2, LW_PI / 2, LW_PI / 2)).x;
    const float more = ambient(&g, &seen, 0, &sky, lw_vec3(2 * LW_PI, 2 * LW_PI, 2 * LW_PI)).x;
    assert_true(fabsf(open - 1) < 0.02f && fabsf(half - 0.5f) < 0.02f && fabsf(more - 2) < 0.03f);
    /* a warm lamp in a dim corner of the white sky: bright, but a quarter of the sky's blue arrives */
    const struct lw_vec3 warm = ambient(&g, &seen, 0, &sky, lw_vec3(4 * LW_PI, LW_PI, LW_PI / 4));
    assert_true(fabsf(warm.x - 4) < 0.05f && fabsf(warm.y - 0.7f) < 0.02f && fabsf(warm.z - 0.075f) < 0.003f);
    lw_ambient_finish(&maps);
}

/* Where normals differ within a quad of pixels, highlights are wider; other pixels are no neighbours. */
static void test_spread(void **state) {
    (void)state;
    const struct stuff stuff = metal(0);
    struct lw_gloss16 g = {0};
    struct lw_gloss_seen16 seen;
    const float tilt = 0.1f;
    for (unsigned i = 0; i < WIDTH; i++) {
        set_floor(&g, i, &stuff, lw_vec3(0, 0, 1));
        set(g.plain, i, i & 1 && i < 8 ? lw_vec3(sinf(tilt), 0, cosf(tilt)) : lw_vec3(0, 0, 1));
    }
    g.quads = 0x0f33;
    lw_gloss_see16(&g, &seen);
    const float chord = 2 * sinf(0.5f * tilt);
    for (unsigned i = 0; i < WIDTH; i++)
        assert_true(fabsf(seen.spread[i] - (i >= 12 || (i & 2 && i < 8) ? 0.01f
                                            : i < 8                     ? 0.5f * chord * chord
                                                                        : 0)) < 1e-5f);
    struct lw_gloss_lit16 lit;
    const struct lw_points16 points = {.x = {0}};
    lw_gloss_lamp16(&seen, &points, &(struct lw_gloss_lamp){.at = {0, 0, 1}, .is_sun = true}, &lit);
    assert_true(lit.dv[0] < 0.001f * lit.dv[8] && lit.dv[0] > 0 && lit.dv[12] < 0.001f * lit.dv[8]);
    /* Each of 16 samples stands for a 16th. A lobe of alpha 0.49 hides small differences. */
    struct lw_gloss_seen16 sharper, rough;
    g.samples = 16;
    lw_gloss_see16(&g, &sharper);
    g.samples = 1;
    for (unsigned i = 0; i < WIDTH; i++) g.roughness[i] = 0.7f;
    lw_gloss_see16(&g, &rough);
    for (unsigned i = 0; i < WIDTH; i++) {
        const float s = seen.spread[i];
        assert_float_equal(sharper.spread[i], s / 16, 0.01f * s);
        assert_float_equal(rough.spread[i], s * s / (s + 0.49f * 0.49f), 0.01f * s);
    }
}

static uint32_t g_random = 1;
static float draw(float low, float high) {
    g_random = lw_random_hash2(g_random, 77);
    return low + (high - low) * lw_random_unit(g_random);
}

/* Unit, or none at all. */
static struct lw_vec3 draw_vector(bool unit) {
    const struct lw_vec3 v = lw_vec3(draw(-1, 1), draw(-1, 1), draw(-1, 1));
    if (unit) return lw_vec3_normalize(v);
    const float length[] = {0, 1e-30f, 1e-4f, 1, 1e9f};
    return lw_vec3_scale(v, length[(unsigned)draw(0, 4.99f)]);
}

static void draw_texels(struct lw_gloss_texels16 *to, unsigned i) {
    for (int k = 0; k < 4; k++) to->at[k][i] = g_random = lw_random_hash2(g_random, 5);
    to->x[i] = draw(0, 1), to->y[i] = draw(0, 1);
}

static void draw_lane(struct lw_gloss16 *g, unsigned i) {
    const float ends[] = {0, 1, draw(0, 1), 1e-20f};
    set(g->base, i, lw_vec3(ends[(unsigned)draw(0, 3.99f)], draw(0, 1), 0));
    set(g->dielectric, i, lw_vec3(draw(0, 1) < 0.1f ? 1e30f : draw(0, 1), draw(0, 0.1f), 0));
    g->metalness[i] = ends[(unsigned)draw(0, 3.99f)], g->specular[i] = ends[(unsigned)draw(0, 3.99f)];
    g->roughness[i] = ends[(unsigned)draw(0, 3.99f)], g->occlusion[i] = draw(0, 1);
    g->normal_scale[i] = draw(0, 1) < 0.1f ? -1e38f : draw(-3, 3);
    draw_texels(&g->surface, i), draw_texels(&g->shade, i), draw_texels(&g->bump, i);
    set(g->plain, i, draw_vector(true)), set(g->tangent, i, draw_vector(false));
    g->turn[i] = draw(0, 1) < 0.5f ? 1 : -1, g->side[i] = draw(0, 1) < 0.5f ? 1 : -1;
    set(g->to_eye, i, lw_vec3_scale(draw_vector(true), draw(0.1f, 100)));
    if (draw(0, 1) < 0.2f) set(g->to_eye, i, lw_vec3_cross(get(g->plain, i), lw_vec3(0, 0, 1))); /* n.v = 0 */
}

static bool is_good(struct lw_vec3 v) {
    return v.x >= 0 && v.y >= 0 && v.z >= 0 && v.x < INFINITY && v.y < INFINITY && v.z < INFINITY;
}

/* Lanes of a packet, at random places of a square. */
struct spots {
    struct lw_surface surface[WIDTH];
    struct lw_finish_point point[WIDTH];
    struct lw_gloss_corner mean[WIDTH];
    float side[WIDTH];
};

static struct lw_gloss_corner corner_of(const struct lw_mesh *mesh, uint32_t triangle, int k) {
    const uint32_t v = mesh->triangle[triangle][k];
    const struct lw_vec3 n = mesh->normal[v];
    const struct lw_vec4 t = lw_tangent_decode(mesh->tangent[3 * triangle + (uint32_t)k], n);
    return (struct lw_gloss_corner){{n.x, n.y, n.z, mesh->uv[0][v].x},
                                    {t.x, t.y, t.z, mesh->uv[0][v].y},
                                    {mesh->uv[1][v].x, mesh->uv[1][v].y, 0, 0}};
}

static void draw_spots(const struct lw_scene *scene, struct spots *out) {
    const struct lw_mesh *mesh = scene->mesh;
    for (unsigned i = 0; i < WIDTH; i++) {
        const float u = draw(0, 0.5f), v = draw(0, 0.5f), weight[3] = {1 - u - v, u, v};
        const uint32_t t = i % 2;
        const struct lw_gloss_corner corner[3] = {corner_of(mesh, t, 0), corner_of(mesh, t, 1),
                                                  corner_of(mesh, t, 2)};
        lw_scene_surface(scene, mesh, t, u, v, &out->surface[i]);
        lw_scene_finish(scene, mesh, t, u, v, &out->surface[i], &out->point[i]);
        out->mean[i] = lw_gloss_maps_mean(corner, weight);
        out->side[i] = 1;
    }
}

static void compare_lane(const struct spots *spots, const struct lw_gloss16 *g,
                         const struct lw_gloss_seen16 *seen, unsigned i) {
    const struct lw_surface *surface = &spots->surface[i];
    const struct lw_finish_point *point = &spots->point[i];
    const struct lw_vec3 along = lw_vec3(point->tangent.x, point->tangent.y, point->tangent.z);
    const struct lw_vec3 bent = lw_shading_bend(lw_scene_bump(point, surface->normal, along), surface->normal,
                                                lw_vec3_normalize(get(g->to_eye, i)));
    assert_true(lw_vec3_length(lw_vec3_sub(bent, get(seen->normal, i))) < 1e-3f);
    assert_true(lw_vec3_length(lw_vec3_sub(surface->base, get(g->base, i))) < 1e-5f);
    assert_true(fabsf(seen->open[i] - point->occlusion) < 1e-5f);
    assert_true(fabsf(seen->roughness[i] - point->lobes.roughness) < 1e-5f);
    const struct lw_lobe_share s = lw_lobe_table_at(seen->cosine[i], point->lobes.roughness);
    const struct lw_lobes *l = &point->lobes;
    const float again = 1 / (s.a + s.b) - 1;
    const float under = 1 - (l->gloss0 * s.a + l->gloss90 * s.b) * (1 + l->gloss0 * again);
    assert_true(fabsf(seen->diffuse[1][i] - l->diffuse.y * under) < 1e-4f);
    assert_true(fabsf(seen->mirror[2][i] - l->f0.z * (1 + l->f0.z * again)) < 1e-4f);
    assert_true(fabsf(seen->mirrored[0][i] - (l->f0.x * s.a + l->f90 * s.b) * (1 + l->f0.x * again)) < 1e-4f);
}

enum { TEXTURES = 5, SIDE_MAX = 8 };

/* Textures of both kinds, whose sides and wraps are drawn again for each round. */
static void draw_textures(struct lw_texture texture[TEXTURES], uint8_t rgba[TEXTURES][4 * 64]) {
    for (unsigned k = 0; k < TEXTURES; k++) {
        for (unsigned j = 0; j < 4 * 64; j++) rgba[k][j] = (uint8_t)draw(0, 255.9f);
        texture[k] = (struct lw_texture){.name = "",
                                         .width = 1 + (uint32_t)draw(0, SIDE_MAX - 0.01f),
                                         .height = 1 + (uint32_t)draw(0, SIDE_MAX - 0.01f),
                                         .rgba = rgba[k],
                                         .wrap_s = (uint8_t)draw(0, 2.99f),
                                         .wrap_t = (uint8_t)draw(0, 2.99f)};
    }
}

static struct lw_texture_use draw_use(uint32_t texture) {
    struct lw_texture_use use = {.texture = texture, .uv_set = draw(0, 1) < 0.5f};
    for (int k = 0; k < 6; k++) use.transform[k] = draw(-3, 3);
    return use;
}

/* A material with all maps; some of them at the same places. */
static void draw_finish(struct lw_scene *scene, struct lw_finish *out) {
    *out = (struct lw_finish){.metalness = draw(0, 1),
                              .roughness = draw(0, 1),
                              .specular = draw(0, 1),
                              .specular_colour = {1, 0.5f, 2},
                              .ior = 1.7f,
                              .occlusion = 0.6f,
                              .normal_scale = 0.8f,
                              .surface_texture = draw_use(0),
                              .normal_texture = draw_use(1),
                              .specular_texture = draw_use(2),
                              .occlusion_texture = draw_use(3)};
    struct lw_material *material = scene->material;
    material->base_colour_texture = draw_use(0);
    for (int c = 0; c < 3; c++) material->base_colour[c] = draw(0, 1);
    if (draw(0, 1) < 0.5f) { /* as most files have it */
        out->occlusion_texture = out->surface_texture;
        out->normal_texture = out->surface_texture, out->normal_texture.texture = 1;
        material->base_colour_texture = out->surface_texture;
    }
    if (draw(0, 1) < 0.5f) out->specular_texture.texture = LW_SCENE_NONE;
    material->finish = out;
}

/* Against lw_scene_finish() and the rule that path tracers have; lanes that are not asked for stay. */
static void test_same_finish(void **state) {
    (void)state;
    uint8_t rgba[TEXTURES][4 * 64];
    struct lw_texture texture[TEXTURES];
    struct lw_scene *scene = lw_support_squares(1, 1);
    struct lw_vec2 uv[2][4];
    uint16_t tangent[6];
    for (int c = 0; c < 6; c++) tangent[c] = lw_tangent_encode(lw_vec3(0, 1, 0), lw_vec3(1, 0, 0.4f), c > 2);
    assert_true(scene->mesh[0].vertex_count <= 4);
    scene->mesh[0].tangent = tangent;
    scene->mesh[0].uv[0] = uv[0], scene->mesh[0].uv[1] = uv[1];
    scene->finish_texture = texture, scene->finish_texture_count = 4;
    scene->texture = texture + 4, scene->texture_count = 1;
    for (int n = 0; n < 400; n++) {
        struct lw_gloss16 g;
        struct lw_gloss_uv16 places;
        struct lw_gloss_seen16 seen;
        struct lw_finish finish;
        struct spots spots;
        const uint16_t lanes = n % 4 ? (uint16_t)lw_random_hash2((uint32_t)n, 3) : 0xffff;
        draw_textures(texture, rgba);
        if (draw(0, 1) < 0.5f) texture[0].width = texture[1].width = texture[4].width = 4;
        if (draw(0, 1) < 0.5f) texture[2].content = LW_CONTENT_SURFACE;
        texture[0].content = texture[3].content = LW_CONTENT_SURFACE, texture[1].content = LW_CONTENT_NORMAL;
        for (int v = 0; v < 4; v++)
            for (int k = 0; k < 2; k++) uv[k][v] = (struct lw_vec2){draw(-2, 2), draw(-2, 2)};
        draw_finish(scene, &finish);
        draw_spots(scene, &spots);
        lw_gloss_maps_begin(spots.mean, spots.side, &g, &places);
        for (unsigned i = 0; i < WIDTH; i++)
            set(g.to_eye, i, lw_vec3(draw(-1, 1), draw(0.1f, 1), draw(-1, 1))),
                g.turn[i] = spots.point[i].tangent.w;
        lw_gloss_maps_take(&g, lanes, scene, scene->material, LW_GLOSS_MAPS_BUMPS | LW_GLOSS_MAPS_BASE,
                           &places);
        lw_gloss_see16(&g, &seen);
        for (unsigned i = 0; i < WIDTH; i++) {
            if (lanes >> i & 1u)
                compare_lane(&spots, &g, &seen, i);
            else
                assert_true(seen.metalness[i] == 0 && seen.roughness[i] == 1 && g.base[0][i] == 0);
        }
    }
    scene->texture = NULL, scene->finish_texture = NULL;
    scene->texture_count = scene->finish_texture_count = 0;
    lw_scene_destroy(scene);
}

/* Whatever a file has for texture coordinates, texels are those of the texture. */
static void test_far_coordinates(void **state) {
    (void)state;
    static const float odd[] = {NAN, INFINITY, -INFINITY, 3e38f, -3e38f, 1e30f,       -8388609, 1e-40f,
                                1,   -1,       2,         -2,    0,      0.99999994f, -1e-9f,   16777216};
    uint8_t rgba[4 * 6];
    memset(rgba, 77, sizeof rgba);
    struct lw_scene *scene = lw_support_squares(1, 1);
    for (unsigned wrap = 0; wrap < 9; wrap++) {
        struct lw_texture texture = {.name = "",
                                     .width = 3,
                                     .height = 2,
                                     .rgba = rgba,
                                     .content = LW_CONTENT_SURFACE,
                                     .wrap_s = (uint8_t)(wrap % 3),
                                     .wrap_t = (uint8_t)(wrap / 3)};
        const struct lw_texture_use none = {.texture = LW_SCENE_NONE},
                                    use = {.transform = {1, 0, 0, 0, 1, 0}};
        const struct lw_finish finish = {.roughness = 1,
                                         .ior = 1,
                                         .surface_texture = use,
                                         .specular_texture = none,
                                         .occlusion_texture = none,
                                         .normal_texture = none};
        struct lw_gloss16 g = {0};
        struct lw_gloss_uv16 uv;
        scene->finish_texture = &texture, scene->finish_texture_count = 1;
        scene->material[0].finish = &finish;
        for (unsigned i = 0; i < WIDTH; i++) uv.u[0][i] = odd[i], uv.v[0][i] = odd[(i + wrap) % WIDTH];
        lw_gloss_maps_take(&g, 0xffff, scene, scene->material, 0, &uv);
        for (unsigned i = 0; i < WIDTH; i++) {
            for (int k = 0; k < 4; k++) assert_int_equal(g.surface.at[k][i], 0x4d4d4d4d);
            assert_true(g.surface.x[i] >= 0 && g.surface.x[i] <= 1 && g.surface.y[i] >= 0 &&
                        g.surface.y[i] <= 1);
        }
    }
    scene->finish_texture = NULL, scene->finish_texture_count = 0;
    lw_scene_destroy(scene);
}

/* Never NaN, never negative, the mirrored direction never below the surface. */
static void test_hostile(void **state) {
    (void)state;
    const struct lw_ambient none = {0};
    for (int k = 0; k < 20000; k++) {
        struct lw_gloss16 g;
        struct lw_gloss_seen16 seen;
        struct lw_points16 points;
        struct lw_gloss_lit16 lit;
        for (unsigned i = 0; i < WIDTH; i++) {
            draw_lane(&g, i);
            points.x[i] = draw(-1, 1), points.y[i] = draw(-1, 1), points.z[i] = 0;
        }
        g.quads = (uint16_t)lw_random_hash2((uint32_t)k, 9);
        const struct lw_gloss_sky sky = {{draw(0, 1), 0, draw(0, 1e12f)}, &none};
        const struct lw_gloss_lamp lamp = {.at = k % 3 ? draw_vector(true)
                                                       : lw_vec3(points.x[0], points.y[0], 0),
                                           .radius = k % 5 ? 0 : draw(0, 10),
                                           .is_sun = k % 2};
        lw_gloss_see16(&g, &seen);
        lw_gloss_lamp16(&seen, &points, &lamp, &lit);
        for (unsigned i = 0; i < WIDTH; i++) {
            const struct lw_vec3 l = ambient(&g, &seen, i, &sky, lw_vec3(draw(0, 1e12f), 0, 1));
            const struct lw_vec3 n = get(seen.normal, i), v = get(seen.eye, i), plain = get(g.plain, i);
            assert_true(is_good(l) && is_good(get(seen.mirror, i)) && is_good(get(seen.rim, i)));
            assert_true(lit.dv[i] >= 0 && lit.dv[i] < INFINITY && lit.rim[i] >= 0 && lit.rim[i] <= 1);
            assert_true(lit.left[i] >= 0 && lit.left[i] <= 1 / seen.even[i]);
            assert_true(fabsf(lw_vec3_dot(n, n) - 1) < 1e-3f && lw_vec3_dot(n, v) > 0);
            const struct lw_vec3 direction = lw_vec3_sub(lw_vec3_scale(n, 2 * lw_vec3_dot(n, v)), v);
            assert_true(lw_vec3_dot(plain, v) < 0.01f || lw_vec3_dot(direction, plain) > 0);
        }
    }
}

/* For any moments, eyes and normal maps sixteen lanes give what direction_form.h gives, within its bounds. */
static void test_direction_form(void **state) {
    (void)state;
    float most = 0;
    for (uint32_t round = 0; round < 2000; round++) {
        struct lw_gloss16 g = {0};
        struct lw_gloss_seen16 seen;
        float direction[3][WIDTH], factor[WIDTH], gain[WIDTH];
        for (unsigned i = 0; i < WIDTH; i++) {
            uint32_t random[8];
            for (uint32_t k = 0; k < 8; k++) random[k] = lw_random_hash3(round, i, k);
            const struct stuff stuff = metal((float)(random[0] % 101) / 100);
            set_floor(&g, i, &stuff, slanted(0.05f + 0.95f * (float)(random[1] % 100) / 100));
            set_texels(&g.bump, i, 0xff000000u | (random[2] & 0xffffffu));
            g.normal_scale[i] = 1;
            for (int k = 0; k < 3; k++) {
                const float value = (float)(random[3 + k] % 2401) / 1000 - 1.2f;
                direction[k][i] = value;
                if (random[6] % 8 == 0) memcpy(&direction[k][i], &random[3 + k], sizeof value); /* any bits */
            }
        }
        lw_gloss_see16(&g, &seen);
        lw_gloss_direct16(&g, &seen, (const float(*)[WIDTH])direction, factor, gain);
        for (unsigned i = 0; i < WIDTH; i++) {
            const struct lw_vec3 n = get((const float(*)[WIDTH])g.plain, i),
                                 m = get((const float(*)[WIDTH])seen.normal, i),
                                 eye = get((const float(*)[WIDTH])seen.eye, i),
                                 mirrored = lw_vec3_sub(lw_vec3_scale(m, 2 * seen.cosine[i]), eye);
            const struct lw_direction_source source =
                lw_direction_source_of(get((const float(*)[WIDTH])direction, i), n);
            assert_true(factor[i] >= 0 && factor[i] <= LW_DIRECTION_FACTOR_MAX);
            assert_true(gain[i] >= 0 && gain[i] <= LW_DIRECTION_GAIN_MAX);
            most = fmaxf(most, fabsf(factor[i] - lw_direction_factor(&source, n, m)));
            most = fmaxf(most, fabsf(gain[i] - lw_direction_gain(&source, n, mirrored, seen.alpha[i])));
        }
    }
    if (!(most < 2e-3f)) fail_msg("off by %g", (double)most);
}

/* What all eyes see of light of irradiance pi with a direction. Each eye stands for the same share of the
 * cosine. */
struct energy {
    double even;           /* with no direction */
    double all, halves[2]; /* halves: by every second eye */
    float most;            /* gain */
};
static struct energy energy_of(const struct stuff *stuff, struct lw_vec3 r) {
    enum { STEPS = 64 };
    struct energy out = {0};
    for (int s = 0; s < STEPS * STEPS; s += WIDTH) {
        struct lw_gloss16 g = {0};
        struct lw_gloss_seen16 seen;
        float direction[3][WIDTH], factor[WIDTH], gain[WIDTH];
        for (unsigned i = 0; i < WIDTH; i++) {
            const float u = ((float)(s / STEPS) + 0.5f) / STEPS,
                        phi = 2 * LW_PI * ((float)((s + (int)i) % STEPS) + 0.5f) / STEPS;
            set_floor(&g, i, stuff, lw_vec3(sqrtf(u) * cosf(phi), sqrtf(u) * sinf(phi), sqrtf(1 - u)));
            set(direction, i, r);
        }
        lw_gloss_see16(&g, &seen);
        lw_gloss_direct16(&g, &seen, (const float(*)[WIDTH])direction, factor, gain);
        for (unsigned i = 0; i < WIDTH; i++) {
            out.even += (double)seen.mirrored[0][i] / (STEPS * STEPS);
            out.halves[i & 1] += 2 * (double)(gain[i] * seen.mirrored[0][i]) / (STEPS * STEPS);
            out.most = fmaxf(out.most, gain[i]);
        }
    }
    out.all = 0.5 * (out.halves[0] + out.halves[1]);
    return out;
}

/* What the split-sum table says that an even floor mirrors of light from `from`. */
static double mirrored_from(const struct stuff *stuff, struct lw_vec3 from) {
    struct lw_gloss16 g = {0};
    struct lw_gloss_seen16 seen;
    for (unsigned i = 0; i < WIDTH; i++) set_floor(&g, i, stuff, from);
    lw_gloss_see16(&g, &seen);
    return (double)seen.mirrored[0][0];
}

/* A mirror sends back what the split-sum table says of the side that light comes from. By the Gaussian and
 * its cosine white metal sends back 0.95 to 1.18 of that. Gloss sends back at most 4 % of E more: its rim
 * is that of the eye's side. Where an eye meets the bound of the gain, light is lost. Quadrature: both
 * halves of the eyes agree to 0.001 of E. */
static bool check_energy(const struct stuff *stuff, float cosine, float share) {
    const struct lw_vec3 from = slanted(cosine), r = lw_vec3_mad(lw_vec3_scale(from, share), lw_vec3(0, 0, 1),
                                                                 (1 - share) * LW_DIRECTION_EVEN);
    const struct energy energy = energy_of(stuff, r);
    const bool bound = energy.most >= LW_DIRECTION_GAIN_MAX, gloss = stuff->metalness == 0;
    const double w = (double)share, wanted = (1 - w) * energy.even + w * mirrored_from(stuff, from);
    const double most = gloss ? wanted + 0.04 : 1.18 * wanted, least = gloss || bound ? 0 : 0.95 * wanted;
    if (!(energy.all >= least && energy.all <= most && fabs(energy.halves[0] - energy.halves[1]) < 1e-3))
        fail_msg("%s, roughness %g, from cosine %g, share %g: %g of %g", gloss ? "gloss" : "metal",
                 (double)stuff->roughness, (double)cosine, w, energy.all, wanted);
    return bound;
}

static void test_gain_keeps_energy(void **state) {
    (void)state;
    static const float cosine[] = {0, 0.02f, 0.05f, 0.1f, 0.3f, 0.5f, 0.8f, 1};
    uint32_t bounded = 0, count = 0;
    for (int k = 0; k < 20; k++)
        for (size_t side = 0; side < sizeof cosine / sizeof *cosine; side++)
            for (int part = 1; part <= 10; part += 3, count++) {
                const float roughness = 0.05f * (float)(1 + k / 2 * 2), share = 0.1f * (float)part;
                struct stuff stuff = k % 2 ? metal(roughness + 0.05f) : glossy(roughness + 0.05f);
                stuff.base = lw_vec3(1, 1, 1);
                bounded += check_energy(&stuff, cosine[side], share);
            }
    assert_true(bounded > count / 10 && bounded < count / 2);
}

/* Nothing is known: a surface looks as without. */
static void test_without_direction(void **state) {
    (void)state;
    const struct lw_ambient none = {0};
    const struct lw_gloss_sky sky = {{0.2f, 0.1f, 0.3f}, &none};
    struct lw_gloss16 g = {0};
    struct lw_gloss_seen16 seen;
    float e[3][WIDTH], direction[3][WIDTH] = {{0}}, out[2][3][WIDTH];
    for (unsigned i = 0; i < WIDTH; i++) {
        const struct stuff stuff = glossy(0.06f * (float)i);
        set_floor(&g, i, &stuff, slanted(1));
        set(e, i, lw_vec3(3, 2, (float)i));
    }
    lw_gloss_see16(&g, &seen);
    lw_gloss_ambient16(&g, &seen, 0xffff, &sky, (const float(*)[WIDTH])e, NULL, NULL, out[0]);
    lw_gloss_ambient16(&g, &seen, 0xffff, &sky, (const float(*)[WIDTH])e, (const float(*)[WIDTH])direction,
                       NULL, out[1]);
    assert_memory_equal(out[0], out[1], sizeof out[0]);
}

int main(void) {
    const struct CMUnitTest tests[] = {cmocka_unit_test(test_furnace),
                                       cmocka_unit_test(test_lamp),
                                       cmocka_unit_test(test_left),
                                       cmocka_unit_test(test_highlight),
                                       cmocka_unit_test(test_wide_lamp),
                                       cmocka_unit_test(test_ambient),
                                       cmocka_unit_test(test_hostile),
                                       cmocka_unit_test(test_spread),
                                       cmocka_unit_test(test_same_finish),
                                       cmocka_unit_test(test_far_coordinates),
                                       cmocka_unit_test(test_direction_form),
                                       cmocka_unit_test(test_without_direction),
                                       cmocka_unit_test(test_gain_keeps_energy)};
    return cmocka_run_group_tests(tests, NULL, NULL);
}
