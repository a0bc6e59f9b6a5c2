/* test_lightmap.c: charts of an atlas: how surfaces are cut, laid out and packed, and which UVs are kept. */
#include "tests/support/lightmap_case.h"

#include "common/builtin/builtin.h"

#include <stdlib.h>
#include <string.h>

/* Whether a triangle touches an open rectangle: by separating axes, independent of the code under test. */
static bool touches(const struct lw_vec2 c[3], float x0, float y0, float x1, float y1) {
    const float slack = 2e-3f;
    x0 += slack, y0 += slack, x1 -= slack, y1 -= slack;
    if (fminf(c[0].x, fminf(c[1].x, c[2].x)) >= x1 || fmaxf(c[0].x, fmaxf(c[1].x, c[2].x)) <= x0)
        return false;
    if (fminf(c[0].y, fminf(c[1].y, c[2].y)) >= y1 || fmaxf(c[0].y, fmaxf(c[1].y, c[2].y)) <= y0)
        return false;
    for (int e = 0; e < 3; e++) {
        struct lw_vec2 p = c[e], q = c[(e + 1) % 3];
        float nx = p.y - q.y, ny = q.x - p.x;
        float most = nx * ((nx > 0 ? x1 : x0) - p.x) + ny * ((ny > 0 ? y1 : y0) - p.y);
        if (most <= 0) return false;
    }
    return true;
}

static uint32_t root(uint32_t *parent, uint32_t i) {
    while (parent[i] != i) i = parent[i];
    return i;
}

/* Every block of 4x4 texels, with the gutter around what lies in it, belongs to one connected piece. Holds
 * where no piece is a sliver and no chart was merged from several. */
static void check_blocks(const struct lw_mesh *m) {
    uint32_t *parent = malloc(m->vertex_count * sizeof *parent);
    uint32_t width = m->atlas_width / 4, height = m->atlas_height / 4;
    uint32_t *owner = malloc((size_t)width * height * sizeof *owner);
    for (uint32_t v = 0; v < m->vertex_count; v++) parent[v] = v;
    memset(owner, 0xff, (size_t)width * height * sizeof *owner);
    for (uint32_t t = 0; t < m->triangle_count; t++)
        for (int k = 1; k < 3; k++) parent[root(parent, m->triangle[t][k])] = root(parent, m->triangle[t][0]);
    for (uint32_t v = 0; v < m->vertex_count; v++) /* vertices that differ in another attribute alone */
        for (uint32_t w = 0; w < v; w++)
            if (fabsf(m->lightmap_uv[v].x - m->lightmap_uv[w].x) < 0.1f &&
                fabsf(m->lightmap_uv[v].y - m->lightmap_uv[w].y) < 0.1f)
                parent[root(parent, v)] = root(parent, w);
    for (uint32_t t = 0; t < m->triangle_count; t++) {
        struct lw_vec2 c[3];
        for (int k = 0; k < 3; k++) c[k] = m->lightmap_uv[m->triangle[t][k]];
        for (uint32_t y = 0; y < height; y++)
            for (uint32_t x = 0; x < width; x++) {
                float g = (float)LW_LIGHTMAP_GUTTER, fx = 4 * (float)x, fy = 4 * (float)y;
                if (!touches(c, fx - g, fy - g, fx + 4 + g, fy + 4 + g)) continue;
                uint32_t *o = &owner[y * width + x], piece = root(parent, m->triangle[t][0]);
                if (*o == UINT32_MAX) *o = piece;
                assert_int_equal(*o, piece);
            }
    }
    free(owner);
    free(parent);
}

static void a_cube_is_six_squares(void **state) {
    struct lightmap_case_shape *s = lightmap_case_fresh(state);
    lightmap_case_add_cube(s, 1);
    struct lw_scene *scene = lightmap_case_scene_of(s, NULL, 1);
    struct lw_lightmap_report r = lightmap_case_build(scene, 32, 0);
    lightmap_case_check_layout(scene->mesh, &r, 1.01f);
    check_blocks(scene->mesh);
    assert_int_equal(r.chart_count, 6);
    assert_int_equal(r.texels_covered, 6 * 32 * 32);
    assert_true(r.coverage > 0.6f);
    assert_true(fabsf(r.stretch_rms - 1) < 1e-3f);
    assert_int_equal(scene->mesh->vertex_count, 24);
    lw_scene_destroy(scene);
}

static void a_column_is_one_chart(void **state) {
    struct lightmap_case_shape *s = lightmap_case_fresh(state);
    lightmap_case_add_grid(s, lightmap_case_cylinder, 48, 8);
    struct lw_scene *scene = lightmap_case_scene_of(s, NULL, 1);
    struct lw_lightmap_report r = lightmap_case_build(scene, 32, 0);
    lightmap_case_check_layout(scene->mesh, &r, 1.3f);
    check_blocks(scene->mesh);
    assert_int_equal(r.chart_count, 1);
    assert_true(r.stretch_max < 1.1f);
    assert_true(r.coverage > 0.85f);
    assert_true(scene->mesh->vertex_count <=
                50 * 9); /* split by one cut, and where the shape is split itself */
    lw_scene_destroy(scene);
}

static void curved_shapes_stay_in_bounds(void **state) {
    lightmap_case_surface *const shapes[] = {lightmap_case_sphere, lightmap_case_torus, lightmap_case_ramp};
    for (int i = 0; i < 3; i++) {
        struct lightmap_case_shape *s = lightmap_case_fresh(state);
        lightmap_case_add_grid(s, shapes[i], 48, shapes[i] == lightmap_case_ramp ? 4 : 24);
        struct lw_scene *scene = lightmap_case_scene_of(s, NULL, 1);
        struct lw_lightmap_report r = lightmap_case_build(scene, 100, 0);
        lightmap_case_check_layout(scene->mesh, &r, 2.5f);
        assert_true(r.stretch_max < 2.0f);
        assert_true(r.coverage > 0.4f);
        assert_true(r.chart_count > 1); /* none of them lies flat in one piece */
        assert_true(r.chart_count < 60);
        lw_scene_destroy(scene);
    }
}

/* Texels of the atlas for each that the density asks for. */
static float refined(void **state, lightmap_case_surface *at, float density) {
    struct lightmap_case_shape *s = lightmap_case_fresh(state);
    float uv = 0, os = 0;
    lightmap_case_add_grid(s, at, 48, 24);
    struct lw_scene *scene = lightmap_case_scene_of(s, NULL, 1);
    const struct lw_lightmap_report r = lightmap_case_build(scene, density, 0);
    for (uint32_t t = 0; t < scene->mesh->triangle_count; t++) {
        uv += lightmap_case_area_uv(scene->mesh, t);
        os += lightmap_case_area_os(scene->mesh, t) * r.texels_per_metre * r.texels_per_metre;
    }
    assert_int_equal(lw_lightmap_overlaps(scene->mesh), 0);
    lw_scene_destroy(scene);
    return uv / os;
}

static void what_bends_has_narrow_texels(void **state) {
    const float wider = 1.13f; /* charts are, to fill blocks */
    float around = refined(state, lightmap_case_cylinder, 20);
    assert_true(around > 0.9f && around < wider);       /* 0.1 radians a texel */
    around = refined(state, lightmap_case_cylinder, 3); /* 0.67: 1.67 times as many around as along */
    assert_true(around > 1.5f && around < 1.7f * wider * wider);
    around = refined(state, lightmap_case_cylinder, 1); /* 2: no more than twice as many */
    assert_true(around > 1.8f && around < 2 * wider * wider);
    const float both = refined(state, lightmap_case_sphere, 1.5f); /* 0.67 either way */
    assert_true(both > 2 && both < 4 * wider * wider);
}

/* Facets lower than a texel may stretch: cut along them, a moulding would be all border. */
static void fine_facets_stay_together(void **state) {
    struct lightmap_case_shape *s = lightmap_case_fresh(state);
    lightmap_case_add_grid(s, lightmap_case_torus, 80, 40);
    struct lw_scene *scene = lightmap_case_scene_of(s, NULL, 1);
    struct lw_lightmap_report r = lightmap_case_build(scene, 8, 0);
    assert_true(r.chart_count < 29); /* 32 where they may not */
    assert_true(r.stretch_max < 8.0f && r.stretch_rms < 1.5f);
    assert_int_equal(lw_lightmap_overlaps(scene->mesh), 0);
    lw_scene_destroy(scene);
}

/* L-shapes hold each other: the packer must keep gutters between blocks where rectangles overlap. */
static void hooks_interlock(void **state) {
    struct lightmap_case_shape *s = lightmap_case_fresh(state);
    for (int i = 0; i < 9; i++) {
        float z = 3 * (float)i, arm = 1.5f + 0.07f * (float)i;
        lightmap_case_add_quad(s, lw_vec3(0, 0, z), lw_vec3(arm, 0, 0), lw_vec3(0, 0.6f, 0));
        lightmap_case_add_quad(s, lw_vec3(0, 0.6f, z), lw_vec3(0.6f, 0, 0), lw_vec3(0, arm, 0));
        lightmap_case_add_quad(s, lw_vec3(0.6f, 0, z), lw_vec3(arm - 0.6f, 0, 0), lw_vec3(0, 0.6f, 0));
        s->triangle_count -= 6; /* three quads' vertices, joined again without T-junctions */
        uint32_t v = s->vertex_count - 12;
        lightmap_case_add_triangle(s, v, v + 8, v + 11), lightmap_case_add_triangle(s, v, v + 11, v + 3);
        lightmap_case_add_triangle(s, v + 8, v + 9, v + 10),
            lightmap_case_add_triangle(s, v + 8, v + 10, v + 11);
        lightmap_case_add_triangle(s, v + 4, v + 5, v + 6),
            lightmap_case_add_triangle(s, v + 4, v + 6, v + 7);
    }
    struct lw_scene *scene = lightmap_case_scene_of(s, NULL, 1);
    struct lw_lightmap_report r = lightmap_case_build(scene, 40, 0);
    lightmap_case_check_layout(scene->mesh, &r, 1.3f);
    check_blocks(scene->mesh);
    assert_true(r.chart_count >= 9);
    lw_scene_destroy(scene);
}

static void attributes_follow_their_vertices(void **state) {
    struct lightmap_case_shape *s = lightmap_case_fresh(state);
    lightmap_case_add_cube(s, 2);
    s->has_uv1 = true;
    for (uint32_t v = 0; v < s->vertex_count; v++)
        s->uv1[v] = (struct lw_vec2){5 + (float)v, 7}; /* not in [0, 1] */
    struct lw_scene *scene = lightmap_case_scene_of(s, NULL, 1);
    struct lw_lightmap_report r = lightmap_case_build(scene, 16, 0);
    assert_false(r.from_file);
    const struct lw_mesh *m = scene->mesh;
    for (uint32_t t = 0; t < m->triangle_count; t++)
        for (int k = 0; k < 3; k++) {
            uint32_t now = m->triangle[t][k], was = s->triangle[t][k];
            assert_memory_equal(&m->position[now], &s->position[was], 12);
            assert_memory_equal(&m->normal[now], &s->normal[was], 12);
            assert_memory_equal(&m->uv[1][now], &s->uv1[was], 8);
        }
    lw_scene_destroy(scene);
}

static void leaves_share_rectangles(void **state) {
    struct lightmap_case_shape *s = lightmap_case_fresh(state);
    for (int i = 0; i < 1000; i++) /* a tenth of a metre, apart from each other */
        lightmap_case_add_quad(s, lw_vec3((float)(i % 32), (float)(i / 32), 0), lw_vec3(0.1f, 0, 0),
                               lw_vec3(0, 0.1f, 0));
    struct lw_scene *scene = lightmap_case_scene_of(s, NULL, 1);
    struct lw_lightmap_report r = lightmap_case_build(scene, 20, 0); /* two texels each */
    lightmap_case_check_layout(scene->mesh, &r, 1.01f);
    /* read in three texels a side, the fewest that there are: from centre to centre to centre */
    assert_int_equal(r.texels_covered, 9000);
    assert_true(r.coverage > 0.7f); /* a rectangle each: 4 of 64 */
    assert_int_equal(lw_lightmap_mixed(scene->mesh), 0);
    lw_scene_destroy(scene);
}

/* Two rooms in one mesh, their walls listed in turn: hardly a tile of the atlas shows both. */
static void what_is_near_lies_together(void **state) {
    struct lightmap_case_shape *s = lightmap_case_fresh(state);
    for (int i = 0; i < 2000; i++)
        lightmap_case_add_quad(s, lw_vec3((float)(i / 2 % 32) + (i & 1 ? 1000 : 0), (float)(i / 2 / 32), 0),
                               lw_vec3(0.6f, 0, 0), lw_vec3(0, 0.5f, 0));
    struct lw_scene *scene = lightmap_case_scene_of(s, NULL, 1);
    struct lw_lightmap_report r = lightmap_case_build(scene, 20, 0);
    lightmap_case_check_layout(scene->mesh, &r, 1.3f);
    const struct lw_mesh *m = scene->mesh;
    const uint32_t columns = r.atlas_width / 64 + 1, tiles = columns * (r.atlas_height / 64 + 1);
    uint8_t *shows = calloc(tiles, 1);
    uint32_t both = 0;
    for (uint32_t t = 0; t < m->triangle_count; t++) {
        const uint32_t v = m->triangle[t][0];
        const uint32_t x = (uint32_t)m->lightmap_uv[v].x, y = (uint32_t)m->lightmap_uv[v].y;
        shows[y / 64 * columns + x / 64] |= m->position[v].x > 500 ? 2 : 1;
    }
    for (uint32_t i = 0; i < tiles; i++) both += shows[i] == 3;
    free(shows);
    assert_true(tiles > 50);
    assert_in_range(both, 0, 4); /* nearly all, if they are packed as they come */
    lw_scene_destroy(scene);
}

static float bevel_m;

/* Two walls of a metre at a right angle; between them a corner that three facets round off. */
static struct lw_vec3 bevelled(float u, float v) {
    const float at = 5 * u, turn = 0.5f * LW_PI * (fminf(fmaxf(at, 1), 4) - 1) / 3;
    const float before = fmaxf(0, 1 - at), behind = fmaxf(0, at - 4);
    return lw_vec3(bevel_m * sinf(turn) - before, 2 * v, bevel_m * (1 - cosf(turn)) + behind);
}

static uint32_t charts_of_bevel(void **state, float bevel, unsigned rows) {
    bevel_m = bevel;
    lightmap_case_add_grid(lightmap_case_fresh(state), bevelled, 5, rows);
    struct lw_scene *scene = lightmap_case_scene_of(*state, NULL, 1);
    const struct lw_lightmap_report r = lightmap_case_build(scene, 10, 0);
    lightmap_case_check_layout(scene->mesh, &r, 1.6f);
    lw_scene_destroy(scene);
    return r.chart_count;
}

/* A corner is one, sharp or not, where a texel would have both walls. */
static void a_bevel_within_a_texel_is_a_border(void **state) {
    const float texel_m = 0.1f;
    assert_int_equal(charts_of_bevel(state, 0.05f * texel_m, 1), 2);
    assert_int_equal(charts_of_bevel(state, 0.25f * texel_m, 1), 2);
    assert_int_equal(charts_of_bevel(state, 0.25f * texel_m, 16), 2);
    assert_int_equal(charts_of_bevel(state, 2 * texel_m, 1), 1);
}

/* However thin: what lights one side of a bar must not show on another. */
static void a_thin_bar_has_a_chart_for_each_side(void **state) {
    struct lightmap_case_shape *s = lightmap_case_fresh(state);
    struct lw_vec3 x = lw_vec3(0.02f, 0, 0), y = lw_vec3(0, 3, 0), z = lw_vec3(0, 0, 0.02f),
                   o = lw_vec3(0, 0, 0);
    lightmap_case_add_quad(s, o, y, x), lightmap_case_add_quad(s, o, x, z),
        lightmap_case_add_quad(s, o, z, y), lightmap_case_add_quad(s, x, y, z),
        lightmap_case_add_quad(s, y, z, x), lightmap_case_add_quad(s, z, x, y);
    struct lw_scene *scene = lightmap_case_scene_of(s, NULL, 1);
    struct lw_lightmap_report r = lightmap_case_build(scene, 10, 0);
    lightmap_case_check_layout(scene->mesh, &r, 1.01f);
    assert_int_equal(r.chart_count, 6);
    lw_scene_destroy(scene);
}

/* Whether a bilinear look-up of a level at `at` reads a texel into which a look-up of level 0 of another quad
 * goes. */
static bool reads_another(const struct lw_mesh *mesh, const uint32_t *quad_of, struct lw_vec2 at,
                          uint32_t own, unsigned level) {
    const float side = (float)(1u << level);
    const int x0 = (int)floorf(at.x / side - 0.5f), y0 = (int)floorf(at.y / side - 0.5f);
    for (int y = y0 << level; y < (y0 + 2) << level; y++)
        for (int x = x0 << level; x < (x0 + 2) << level; x++) {
            if (x < 0 || y < 0 || x >= (int)mesh->atlas_width || y >= (int)mesh->atlas_height) continue;
            const uint32_t quad = quad_of[(uint32_t)y * mesh->atlas_width + (uint32_t)x];
            if (quad != LW_SCENE_NONE && quad != own) return true;
        }
    return false;
}

static struct lw_vec2 point_on(const struct lw_mesh *mesh, uint32_t triangle, int i, int j, int steps) {
    struct lw_vec2 c[3];
    for (int k = 0; k < 3; k++) c[k] = mesh->lightmap_uv[mesh->triangle[triangle][k]];
    /* not on the very rim, where rounding decides which texel is read */
    const float u = ((float)i + 0.5f) / (float)steps, v = ((float)j + 0.5f) / (float)steps * (1 - u);
    return (struct lw_vec2){c[0].x + u * (c[1].x - c[0].x) + v * (c[2].x - c[0].x),
                            c[0].y + u * (c[1].y - c[0].y) + v * (c[2].y - c[0].y)};
}

/* Quads of all sizes up to wider than slivers, far from each other: what level is named must hold, and no
 * less than that. */
static void no_level_that_is_named_reads_other_charts(void **state) {
    enum { QUADS = 60, STEPS = 40 };
    struct lightmap_case_shape *s = lightmap_case_fresh(state);
    for (int i = 0; i < QUADS; i++)
        lightmap_case_add_quad(s, lw_vec3(5 * (float)i, 0, 0), lw_vec3(0.1f + 0.03f * (float)(i % 40), 0, 0),
                               lw_vec3(0, 0.1f + 0.03f * (float)(i * 7 % 40), 0));
    struct lw_scene *scene = lightmap_case_scene_of(s, NULL, 1);
    lightmap_case_build(scene, 10, 0);
    const struct lw_mesh *mesh = scene->mesh;
    uint8_t level[2 * QUADS];
    assert_int_equal(lw_lightmap_coarsest(mesh, level), LW_OK);

    const size_t texels = (size_t)mesh->atlas_width * mesh->atlas_height;
    uint32_t *quad_of = malloc(texels * sizeof *quad_of), count[LW_LIGHTMAP_LEVEL_MAX + 1] = {0};
    assert_non_null(quad_of);
    memset(quad_of, 0xff, texels * sizeof *quad_of);
    for (uint32_t t = 0; t < 2 * QUADS; t++)
        for (int i = 0; i < STEPS * STEPS; i++) {
            struct lw_vec2 at = point_on(mesh, t, i % STEPS, i / STEPS, STEPS);
            const uint32_t x = (uint32_t)floorf(at.x - 0.5f), y = (uint32_t)floorf(at.y - 0.5f);
            for (uint32_t k = 0; k < 4; k++) quad_of[(y + k / 2) * mesh->atlas_width + x + k % 2] = t / 2;
        }
    for (uint32_t t = 0; t < 2 * QUADS; t++) {
        bool reads = false;
        for (int i = 0; i < STEPS * STEPS; i++) {
            struct lw_vec2 at = point_on(mesh, t, i % STEPS, i / STEPS, STEPS);
            assert_false(level[t] > 0 && reads_another(mesh, quad_of, at, t / 2, level[t]));
            reads |=
                level[t] < LW_LIGHTMAP_LEVEL_MAX && reads_another(mesh, quad_of, at, t / 2, level[t] + 1u);
        }
        assert_true(reads || level[t] == LW_LIGHTMAP_LEVEL_MAX);
        count[level[t]]++;
    }
    assert_true(count[0] > 3 && count[LW_LIGHTMAP_LEVEL_MAX] > 3);
    free(quad_of);
    lw_scene_destroy(scene);
}

static void backs_have_their_own_half(void **state) {
    struct lightmap_case_shape *s = lightmap_case_fresh(state);
    lightmap_case_add_quad(s, lw_vec3(0, 0, 0), lw_vec3(1, 0, 0), lw_vec3(0, 1, 0));
    s->double_sided = true;
    struct lw_scene *scene = lightmap_case_scene_of(s, NULL, 1);
    struct lw_lightmap_report r = lightmap_case_build(scene, 32, 0);
    lightmap_case_check_layout(scene->mesh, &r, 1.01f);
    assert_int_equal(scene->mesh->back_offset, 36);
    assert_int_equal(scene->mesh->atlas_height, 72);
    assert_int_equal(r.texels_covered, 2 * 32 * 32);
    lw_scene_destroy(scene);
}

static void use_uv1(struct lightmap_case_shape *s, float shift) {
    lightmap_case_add_quad(s, lw_vec3(0, 0, 0), lw_vec3(1, 0, 0), lw_vec3(0, 1, 0));
    lightmap_case_add_quad(s, lw_vec3(3, 0, 0), lw_vec3(1, 0, 0), lw_vec3(0, 1, 0));
    s->has_uv1 = true;
    for (uint32_t v = 0; v < 8; v++)
        s->uv1[v] = (struct lw_vec2){0.4f * s->position[v % 4].x + (v < 4 ? 0.05f : shift),
                                     0.4f * s->position[v % 4].y + 0.3f};
}

static void good_uv1_is_used(void **state) {
    struct lightmap_case_shape *s = lightmap_case_fresh(state);
    use_uv1(s, 0.55f);
    struct lw_scene *scene = lightmap_case_scene_of(s, NULL, 1);
    struct lw_lightmap_report r = lightmap_case_build(scene, 32, 0);
    assert_true(r.from_file);
    lightmap_case_check_layout(scene->mesh, &r, 1.1f);
    assert_int_equal(scene->mesh->atlas_width, 80); /* 32 texels are 0.4 of it */
    assert_int_equal(scene->mesh->vertex_count, 8);
    lw_scene_destroy(scene);
}

static void bad_uv1_is_refused(void **state) {
    const float shift[] = {0.3f, 0.605f, 0.455f}; /* overlapping, outside, apart by less than a texel */
    for (int i = 0; i < 3; i++) {
        struct lightmap_case_shape *s = lightmap_case_fresh(state);
        use_uv1(s, shift[i]);
        struct lw_scene *scene = lightmap_case_scene_of(s, NULL, 1);
        struct lw_lightmap_report r = lightmap_case_build(scene, 9, 0);
        assert_false(r.from_file);
        lightmap_case_check_layout(scene->mesh, &r, 1.3f);
        lw_scene_destroy(scene);
    }
}

/* All triangles of a fan meet at its hub. Compared each with each, they would take the square of their
 * number; a bound makes several charts of them. Nothing lies on anything else all the same. */
static void fans_are_bounded(void **state) {
    enum { COUNT = 20000 };
    struct lightmap_case_shape *s = lightmap_case_fresh(state);
    const uint32_t hub = lightmap_case_add_vertex(s, lw_vec3(0, 0, 0), lw_vec3(0, 0, 1));
    for (uint32_t i = 0; i < COUNT; i++)
        lightmap_case_add_vertex(s, lightmap_case_round_at((float)i / COUNT, 10), lw_vec3(0, 0, 1));
    for (uint32_t i = 0; i < COUNT; i++) lightmap_case_add_triangle(s, hub, 1 + i, 1 + (i + 1) % COUNT);
    struct lw_scene *scene = lightmap_case_scene_of(s, NULL, 1);
    struct lw_lightmap_report r = lightmap_case_build(scene, 5, 0);
    assert_true(r.chart_count > 1); /* one, without the bound */
    assert_int_equal(lw_lightmap_overlaps(scene->mesh), 0);
    lw_scene_destroy(scene);
}

/* By their area, before each triangle is laid out over all texels. */
static void uv1_that_covers_itself_is_refused(void **state) {
    struct lightmap_case_shape *s = lightmap_case_fresh(state);
    for (int i = 0; i < 1000; i++) {
        lightmap_case_add_quad(s, lw_vec3((float)i, 0, 0), lw_vec3(1, 0, 0), lw_vec3(0, 1, 0));
        const struct lw_vec2 square[4] = {{0, 0}, {1, 0}, {1, 1}, {0, 1}};
        memcpy(s->uv1 + s->vertex_count - 4, square, sizeof square);
    }
    s->has_uv1 = true;
    struct lw_scene *scene = lightmap_case_scene_of(s, NULL, 1);
    struct lw_lightmap_report r = lightmap_case_build(scene, 100, 4096);
    assert_false(r.from_file);
    lw_scene_destroy(scene);
}

static void ugly_meshes_are_laid_out(void **state) {
    struct lightmap_case_shape *s = lightmap_case_fresh(state);
    lightmap_case_add_cube(s, 1);
    for (int i = 0; i < 4; i++) lightmap_case_add_triangle(s, 0, 1, 2); /* duplicates: non-manifold */
    lightmap_case_add_triangle(s, 3, 3, 5);                             /* no area */
    lightmap_case_add_quad(s, lw_vec3(9, 0, 0), lw_vec3(1, 0, 0),
                           lw_vec3(1e-9f, 0, 0)); /* thinner than single precision */
    struct lw_scene *scene = lightmap_case_scene_of(s, NULL, 1);
    struct lw_lightmap_report r = lightmap_case_build(scene, 16, 0);
    lightmap_case_check_layout(scene->mesh, &r, 1.4f);
    lw_scene_destroy(scene);

    s = lightmap_case_fresh(state); /* nothing but a point */
    lightmap_case_add_vertex(s, lw_vec3(1, 2, 3), lw_vec3(0, 1, 0));
    lightmap_case_add_triangle(s, 0, 0, 0);
    scene = lightmap_case_scene_of(s, NULL, 1);
    r = lightmap_case_build(scene, 0, 0);
    assert_int_equal(r.atlas_width, 8);
    assert_int_equal(lw_lightmap_overlaps(scene->mesh), 0);
    lw_scene_destroy(scene);
}

static void threads_do_not_matter(void **state) {
    (void)state;
    struct lw_scene *scene[2];
    for (unsigned i = 0; i < 2; i++) {
        struct lw_error err = {0};
        lw_support_ok(lw_builtin_build("builtin:cornell", &scene[i], &err), &err);
        struct lw_lightmap_desc desc = {.threads = i ? 4 : 1};
        lw_support_ok(lw_lightmap_build(scene[i], &desc, NULL, &err), &err);
    }
    for (uint32_t m = 0; m < scene[0]->mesh_count; m++) {
        const struct lw_mesh *a = &scene[0]->mesh[m], *b = &scene[1]->mesh[m];
        assert_int_equal(a->vertex_count, b->vertex_count);
        assert_int_equal(a->atlas_width, b->atlas_width);
        assert_memory_equal(a->lightmap_uv, b->lightmap_uv, a->vertex_count * sizeof *a->lightmap_uv);
        assert_int_equal(lw_lightmap_overlaps(a), 0);
    }
    lw_scene_destroy(scene[0]);
    lw_scene_destroy(scene[1]);
}

/* The measure that all other tests lean on must itself see an overlap. */
static void overlaps_are_seen(void **state) {
    struct lightmap_case_shape *s = lightmap_case_fresh(state);
    lightmap_case_add_quad(s, lw_vec3(0, 0, 0), lw_vec3(1, 0, 0), lw_vec3(0, 1, 0));
    lightmap_case_add_quad(s, lw_vec3(3, 0, 0), lw_vec3(1, 0, 0), lw_vec3(0, 1, 0));
    struct lw_scene *scene = lightmap_case_scene_of(s, NULL, 1);
    struct lw_vec2 uv[8];
    for (uint32_t v = 0; v < 8; v++)
        uv[v] = (struct lw_vec2){4 * s->position[v % 4].x + (v < 4 ? 2 : 4.5f), 4 * s->position[v % 4].y + 2};
    scene->mesh->lightmap_uv = uv;
    scene->mesh->atlas_width = scene->mesh->atlas_height = 12;
    assert_int_equal(lw_lightmap_overlaps(scene->mesh), 2 * 4); /* columns 4 and 5 */
    for (uint32_t v = 4; v < 8; v++) uv[v].x += 1.5f;           /* side by side: no texel shared */
    assert_int_equal(lw_lightmap_overlaps(scene->mesh), 0);
    lw_scene_destroy(scene);
}

/* Two quads, a metre apart, in the atlas two texels apart, then less. */
static void mixed_texels_are_seen(void **state) {
    struct lightmap_case_shape *s = lightmap_case_fresh(state);
    lightmap_case_add_quad(s, lw_vec3(0, 0, 0), lw_vec3(1, 0, 0), lw_vec3(0, 1, 0));
    lightmap_case_add_quad(s, lw_vec3(3, 0, 0), lw_vec3(1, 0, 0), lw_vec3(0, 1, 0));
    struct lw_scene *scene = lightmap_case_scene_of(s, NULL, 1);
    struct lw_vec2 uv[8];
    for (uint32_t v = 0; v < 8; v++)
        uv[v] =
            (struct lw_vec2){4 * s->position[v % 4].x + (v < 4 ? 1.2f : 7.2f), 4 * s->position[v % 4].y + 2};
    scene->mesh->lightmap_uv = uv;
    scene->mesh->atlas_width = scene->mesh->atlas_height = 12;
    assert_int_equal(lw_lightmap_mixed(scene->mesh), 0); /* texel lengths: 0.25; the gap is 8 of them */
    for (uint32_t v = 4; v < 8; v++) uv[v].x -= 1;       /* one column is read by both, of six rows */
    assert_int_equal(lw_lightmap_overlaps(scene->mesh), 0);
    assert_int_equal(lw_lightmap_mixed(scene->mesh), 6);
    for (uint32_t v = 4; v < 8; v++) uv[v].x -= 1; /* joined: two */
    assert_int_equal(lw_lightmap_mixed(scene->mesh), 12);
    lw_scene_destroy(scene);
}

int main(void) {
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(a_cube_is_six_squares),
        cmocka_unit_test(a_column_is_one_chart),
        cmocka_unit_test(curved_shapes_stay_in_bounds),
        cmocka_unit_test(what_bends_has_narrow_texels),
        cmocka_unit_test(fine_facets_stay_together),
        cmocka_unit_test(hooks_interlock),
        cmocka_unit_test(attributes_follow_their_vertices),
        cmocka_unit_test(leaves_share_rectangles),
        cmocka_unit_test(what_is_near_lies_together),
        cmocka_unit_test(a_bevel_within_a_texel_is_a_border),
        cmocka_unit_test(a_thin_bar_has_a_chart_for_each_side),
        cmocka_unit_test(no_level_that_is_named_reads_other_charts),
        cmocka_unit_test(backs_have_their_own_half),
        cmocka_unit_test(good_uv1_is_used),
        cmocka_unit_test(bad_uv1_is_refused),
        cmocka_unit_test(fans_are_bounded),
        cmocka_unit_test(uv1_that_covers_itself_is_refused),
        cmocka_unit_test(ugly_meshes_are_laid_out),
        cmocka_unit_test(threads_do_not_matter),
        cmocka_unit_test(overlaps_are_seen),
        cmocka_unit_test(mixed_texels_are_seen),
    };
    return cmocka_run_group_tests(tests, lightmap_case_set_up, lightmap_case_tear_down);
}
