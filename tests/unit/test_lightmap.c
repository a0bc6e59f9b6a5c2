#include "tests/support/support.h"

#include "common/builtin/builtin.h"
#include "common/lightmap/lightmap.h"
#include "common/lightmap/lightmap_things.h"

#include <stdlib.h>
#include <string.h>

#define SHAPE_MAX 32768 /* vertices; triangles */

/* One mesh under construction, and the scene of its instances. */
struct shape {
    struct lw_vec3 position[SHAPE_MAX], normal[SHAPE_MAX];
    struct lw_vec2 uv1[SHAPE_MAX];
    uint32_t triangle[SHAPE_MAX][3], vertex_count, triangle_count;
    bool has_uv1, double_sided;
};

static uint32_t vertex(struct shape *s, struct lw_vec3 p, struct lw_vec3 n) {
    assert_true(s->vertex_count < SHAPE_MAX);
    s->position[s->vertex_count] = p;
    s->normal[s->vertex_count] = n;
    return s->vertex_count++;
}

static void triangle(struct shape *s, uint32_t a, uint32_t b, uint32_t c) {
    assert_true(s->triangle_count < SHAPE_MAX);
    memcpy(s->triangle[s->triangle_count++], (uint32_t[3]){a, b, c}, 12);
}

/* A parallelogram from p along u and v, facing u x v. */
static void quad(struct shape *s, struct lw_vec3 p, struct lw_vec3 u, struct lw_vec3 v) {
    struct lw_vec3 n = lw_vec3_normalize(lw_vec3_cross(u, v));
    uint32_t a = vertex(s, p, n), b = vertex(s, lw_vec3_add(p, u), n),
             c = vertex(s, lw_vec3_add(lw_vec3_add(p, u), v), n), d = vertex(s, lw_vec3_add(p, v), n);
    triangle(s, a, b, c);
    triangle(s, a, c, d);
}

static void cube(struct shape *s, float side) {
    struct lw_vec3 x = lw_vec3(side, 0, 0), y = lw_vec3(0, side, 0), z = lw_vec3(0, 0, side),
                   o = lw_vec3(0, 0, 0);
    quad(s, o, y, x), quad(s, o, x, z), quad(s, o, z, y);
    quad(s, x, y, z), quad(s, y, z, x), quad(s, z, x, y);
}

typedef struct lw_vec3 surface(float u, float v);

/* A smooth grid over a surface; normals by differences. */
static void grid(struct shape *s, surface *at, unsigned columns, unsigned rows) {
    uint32_t first = s->vertex_count;
    const float step = 1e-3f;
    for (unsigned j = 0; j <= rows; j++)
        for (unsigned i = 0; i <= columns; i++) {
            float u = (float)i / (float)columns, v = (float)j / (float)rows;
            struct lw_vec3 du = lw_vec3_sub(at(u + step, v), at(u - step, v));
            struct lw_vec3 dv = lw_vec3_sub(at(u, v + step), at(u, v - step));
            vertex(s, at(u, v), lw_vec3_normalize(lw_vec3_cross(du, dv)));
        }
    for (unsigned j = 0; j < rows; j++)
        for (unsigned i = 0; i < columns; i++) {
            uint32_t a = first + j * (columns + 1) + i, b = a + 1, d = a + columns + 1, c = d + 1;
            triangle(s, a, b, c);
            triangle(s, a, c, d);
        }
}

/* Radius 0.5 m, height 2 m. Whole turns are snapped, so that the seam's positions are the same bits. */
static struct lw_vec3 round_at(float u, float radius) {
    if (u == 1) u = 0;
    return lw_vec3(radius * cosf(2 * LW_PI * u), radius * sinf(2 * LW_PI * u), 0);
}
static struct lw_vec3 cylinder(float u, float v) {
    return lw_vec3_add(round_at(u, 0.5f), lw_vec3(0, 0, 2 * v));
}
static struct lw_vec3 sphere(float u, float v) {
    float angle = LW_PI * (0.05f + 0.9f * v);
    return lw_vec3_add(round_at(u, sinf(angle)), lw_vec3(0, 0, -cosf(angle)));
}
static struct lw_vec3 torus(float u, float v) {
    float angle = v == 1 ? 0 : 2 * LW_PI * v;
    return lw_vec3_add(round_at(u, 1 + 0.3f * cosf(angle)), lw_vec3(0, 0, 0.3f * sinf(angle)));
}
/* Three turns of a ramp: flat rings that would land on each other when laid flat. */
static struct lw_vec3 ramp(float u, float v) {
    float angle = 6 * LW_PI * u, radius = 1 + v;
    return lw_vec3(radius * cosf(angle), radius * sinf(angle), u);
}

static struct lw_scene *scene_of(const struct shape *s, const float *scale, unsigned objects) {
    struct lw_scene *scene;
    lw_support_ok(lw_scene_create(&scene), NULL);
    struct lw_mesh *mesh = scene->mesh = lw_scene_alloc(scene, 1, sizeof *mesh);
    scene->material = lw_scene_alloc(scene, 1, sizeof *scene->material);
    scene->node = lw_scene_alloc(scene, objects, sizeof *scene->node);
    scene->object = lw_scene_alloc(scene, objects, sizeof *scene->object);
    scene->mesh_count = scene->material_count = 1;
    scene->node_count = scene->object_count = objects;
    scene->material[0].double_sided = s->double_sided;
    for (unsigned i = 0; i < objects; i++) {
        scene->node[i].parent = LW_SCENE_NONE;
        scene->node[i].rotation[3] = 1;
        for (int k = 0; k < 3; k++) scene->node[i].scale[k] = scale ? scale[i] : 1;
        scene->object[i].node = i;
    }
    void *position = lw_scene_alloc(scene, s->vertex_count, sizeof *s->position);
    void *normal = lw_scene_alloc(scene, s->vertex_count, sizeof *s->normal);
    void *uv = lw_scene_alloc(scene, s->vertex_count, sizeof *s->uv1);
    void *triangles = lw_scene_alloc(scene, s->triangle_count, sizeof *s->triangle);
    memcpy(position, s->position, s->vertex_count * sizeof *s->position);
    memcpy(normal, s->normal, s->vertex_count * sizeof *s->normal);
    memcpy(uv, s->uv1, s->vertex_count * sizeof *s->uv1);
    memcpy(triangles, s->triangle, s->triangle_count * sizeof *s->triangle);
    *mesh = (struct lw_mesh){.name = "shape",
                             .vertex_count = s->vertex_count,
                             .triangle_count = s->triangle_count,
                             .position = position,
                             .normal = normal,
                             .triangle = triangles,
                             .material = lw_scene_alloc(scene, s->triangle_count, sizeof(uint32_t))};
    if (s->has_uv1) mesh->uv[1] = uv;
    return scene;
}

static float area_uv(const struct lw_mesh *m, uint32_t t) {
    struct lw_vec2 a = m->lightmap_uv[m->triangle[t][0]], b = m->lightmap_uv[m->triangle[t][1]],
                   c = m->lightmap_uv[m->triangle[t][2]];
    return ((b.x - a.x) * (c.y - a.y) - (b.y - a.y) * (c.x - a.x)) / 2;
}

static float area_os(const struct lw_mesh *m, uint32_t t) {
    struct lw_vec3 p = m->position[m->triangle[t][0]];
    return lw_vec3_length(lw_vec3_cross(lw_vec3_sub(m->position[m->triangle[t][1]], p),
                                        lw_vec3_sub(m->position[m->triangle[t][2]], p))) /
           2;
}

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

/* What holds for every layout of ours. */
static void check_layout(const struct lw_mesh *m, const struct lw_lightmap_report *r, float ratio_max) {
    assert_non_null(m->lightmap_uv);
    assert_int_equal(m->atlas_width % 4, 0);
    assert_int_equal(m->atlas_height % 4, 0);
    assert_int_equal(m->back_offset % 4, 0);
    uint32_t front = m->back_offset ? m->back_offset : m->atlas_height;
    assert_int_equal(m->atlas_height, m->back_offset ? 2 * front : front);
    float gutter = r->from_file ? 0 : (float)LW_LIGHTMAP_GUTTER;
    for (uint32_t v = 0; v < m->vertex_count; v++) {
        struct lw_vec2 uv = m->lightmap_uv[v];
        assert_true(uv.x >= gutter && uv.x <= (float)m->atlas_width - gutter);
        assert_true(uv.y >= gutter && uv.y <= (float)front - gutter);
    }
    for (uint32_t t = 0; t < m->triangle_count; t++) {
        float os = area_os(m, t) * r->texels_per_metre * r->texels_per_metre, uv = area_uv(m, t);
        if (os < 1e-3f) continue;
        assert_true(uv > 0); /* never mirrored */
        assert_true(uv < os * ratio_max && uv * ratio_max > os);
    }
    assert_int_equal(lw_lightmap_overlaps(m), 0);
    assert_true(r->coverage > 0 && r->coverage <= 1);
}

static struct lw_lightmap_report build(struct lw_scene *scene, float density, uint32_t side_max) {
    struct lw_lightmap_report r;
    struct lw_error err = {0};
    struct lw_lightmap_desc desc = {.texels_per_metre = density, .atlas_side_max = side_max, .threads = 1};
    lw_support_ok(lw_lightmap_build(scene, &desc, &r, &err), &err);
    return r;
}

/* Shared by all tests: one at a time is under construction. */
static struct shape *fresh(void **state) {
    struct shape *s = *state;
    memset(s, 0, sizeof *s);
    return s;
}

static void a_cube_is_six_squares(void **state) {
    struct shape *s = fresh(state);
    cube(s, 1);
    struct lw_scene *scene = scene_of(s, NULL, 1);
    struct lw_lightmap_report r = build(scene, 32, 0);
    check_layout(scene->mesh, &r, 1.01f);
    check_blocks(scene->mesh);
    assert_int_equal(r.chart_count, 6);
    assert_int_equal(r.texels_covered, 6 * 32 * 32);
    assert_true(r.coverage > 0.6f);
    assert_true(fabsf(r.stretch_rms - 1) < 1e-3f);
    assert_int_equal(scene->mesh->vertex_count, 24);
    lw_scene_destroy(scene);
}

static void a_column_is_one_chart(void **state) {
    struct shape *s = fresh(state);
    grid(s, cylinder, 48, 8);
    struct lw_scene *scene = scene_of(s, NULL, 1);
    struct lw_lightmap_report r = build(scene, 32, 0);
    check_layout(scene->mesh, &r, 1.3f);
    check_blocks(scene->mesh);
    assert_int_equal(r.chart_count, 1);
    assert_true(r.stretch_max < 1.1f);
    assert_true(r.coverage > 0.85f);
    assert_true(scene->mesh->vertex_count <=
                50 * 9); /* split by one cut, and where the shape is split itself */
    lw_scene_destroy(scene);
}

static void curved_shapes_stay_in_bounds(void **state) {
    surface *const shapes[] = {sphere, torus, ramp};
    for (int i = 0; i < 3; i++) {
        struct shape *s = fresh(state);
        grid(s, shapes[i], 48, shapes[i] == ramp ? 4 : 24);
        struct lw_scene *scene = scene_of(s, NULL, 1);
        struct lw_lightmap_report r = build(scene, 100, 0);
        check_layout(scene->mesh, &r, 2.5f);
        assert_true(r.stretch_max < 2.0f);
        assert_true(r.coverage > 0.4f);
        assert_true(r.chart_count > 1); /* none of them lies flat in one piece */
        assert_true(r.chart_count < 60);
        lw_scene_destroy(scene);
    }
}

/* Texels of the atlas for each that the density asks for. */
static float refined(void **state, surface *at, float density) {
    struct shape *s = fresh(state);
    float uv = 0, os = 0;
    grid(s, at, 48, 24);
    struct lw_scene *scene = scene_of(s, NULL, 1);
    const struct lw_lightmap_report r = build(scene, density, 0);
    for (uint32_t t = 0; t < scene->mesh->triangle_count; t++) {
        uv += area_uv(scene->mesh, t);
        os += area_os(scene->mesh, t) * r.texels_per_metre * r.texels_per_metre;
    }
    assert_int_equal(lw_lightmap_overlaps(scene->mesh), 0);
    lw_scene_destroy(scene);
    return uv / os;
}

static void what_bends_has_narrow_texels(void **state) {
    const float wider = 1.13f; /* charts are, to fill blocks */
    float around = refined(state, cylinder, 20);
    assert_true(around > 0.9f && around < wider); /* 0.1 radians a texel */
    around = refined(state, cylinder, 3);         /* 0.67: 1.67 times as many around as along */
    assert_true(around > 1.5f && around < 1.7f * wider * wider);
    around = refined(state, cylinder, 1); /* 2: no more than twice as many */
    assert_true(around > 1.8f && around < 2 * wider * wider);
    const float both = refined(state, sphere, 1.5f); /* 0.67 either way */
    assert_true(both > 2 && both < 4 * wider * wider);
}

/* Facets lower than a texel may stretch: cut along them, a moulding would be all border. */
static void fine_facets_stay_together(void **state) {
    struct shape *s = fresh(state);
    grid(s, torus, 80, 40);
    struct lw_scene *scene = scene_of(s, NULL, 1);
    struct lw_lightmap_report r = build(scene, 8, 0);
    assert_true(r.chart_count < 29); /* 32 where they may not */
    assert_true(r.stretch_max < 8.0f && r.stretch_rms < 1.5f);
    assert_int_equal(lw_lightmap_overlaps(scene->mesh), 0);
    lw_scene_destroy(scene);
}

/* L-shapes hold each other: the packer must keep gutters between blocks where rectangles overlap. */
static void hooks_interlock(void **state) {
    struct shape *s = fresh(state);
    for (int i = 0; i < 9; i++) {
        float z = 3 * (float)i, arm = 1.5f + 0.07f * (float)i;
        quad(s, lw_vec3(0, 0, z), lw_vec3(arm, 0, 0), lw_vec3(0, 0.6f, 0));
        quad(s, lw_vec3(0, 0.6f, z), lw_vec3(0.6f, 0, 0), lw_vec3(0, arm, 0));
        quad(s, lw_vec3(0.6f, 0, z), lw_vec3(arm - 0.6f, 0, 0), lw_vec3(0, 0.6f, 0));
        s->triangle_count -= 6; /* three quads' vertices, joined again without T-junctions */
        uint32_t v = s->vertex_count - 12;
        triangle(s, v, v + 8, v + 11), triangle(s, v, v + 11, v + 3);
        triangle(s, v + 8, v + 9, v + 10), triangle(s, v + 8, v + 10, v + 11);
        triangle(s, v + 4, v + 5, v + 6), triangle(s, v + 4, v + 6, v + 7);
    }
    struct lw_scene *scene = scene_of(s, NULL, 1);
    struct lw_lightmap_report r = build(scene, 40, 0);
    check_layout(scene->mesh, &r, 1.3f);
    check_blocks(scene->mesh);
    assert_true(r.chart_count >= 9);
    lw_scene_destroy(scene);
}

static void attributes_follow_their_vertices(void **state) {
    struct shape *s = fresh(state);
    cube(s, 2);
    s->has_uv1 = true;
    for (uint32_t v = 0; v < s->vertex_count; v++)
        s->uv1[v] = (struct lw_vec2){5 + (float)v, 7}; /* not in [0, 1] */
    struct lw_scene *scene = scene_of(s, NULL, 1);
    struct lw_lightmap_report r = build(scene, 16, 0);
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
    struct shape *s = fresh(state);
    for (int i = 0; i < 1000; i++) /* a tenth of a metre, apart from each other */
        quad(s, lw_vec3((float)(i % 32), (float)(i / 32), 0), lw_vec3(0.1f, 0, 0), lw_vec3(0, 0.1f, 0));
    struct lw_scene *scene = scene_of(s, NULL, 1);
    struct lw_lightmap_report r = build(scene, 20, 0); /* two texels each */
    check_layout(scene->mesh, &r, 1.01f);
    /* read in three texels a side, the fewest that there are: from centre to centre to centre */
    assert_int_equal(r.texels_covered, 9000);
    assert_true(r.coverage > 0.7f); /* a rectangle each: 4 of 64 */
    assert_int_equal(lw_lightmap_mixed(scene->mesh), 0);
    lw_scene_destroy(scene);
}

/* Two rooms in one mesh, their walls listed in turn: hardly a tile of the atlas shows both. */
static void what_is_near_lies_together(void **state) {
    struct shape *s = fresh(state);
    for (int i = 0; i < 2000; i++)
        quad(s, lw_vec3((float)(i / 2 % 32) + (i & 1 ? 1000 : 0), (float)(i / 2 / 32), 0),
             lw_vec3(0.6f, 0, 0), lw_vec3(0, 0.5f, 0));
    struct lw_scene *scene = scene_of(s, NULL, 1);
    struct lw_lightmap_report r = build(scene, 20, 0);
    check_layout(scene->mesh, &r, 1.3f);
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

/* However thin: what lights one side of a bar must not show on another. */
static void a_thin_bar_has_a_chart_for_each_side(void **state) {
    struct shape *s = fresh(state);
    struct lw_vec3 x = lw_vec3(0.02f, 0, 0), y = lw_vec3(0, 3, 0), z = lw_vec3(0, 0, 0.02f),
                   o = lw_vec3(0, 0, 0);
    quad(s, o, y, x), quad(s, o, x, z), quad(s, o, z, y), quad(s, x, y, z), quad(s, y, z, x),
        quad(s, z, x, y);
    struct lw_scene *scene = scene_of(s, NULL, 1);
    struct lw_lightmap_report r = build(scene, 10, 0);
    check_layout(scene->mesh, &r, 1.01f);
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
    struct shape *s = fresh(state);
    for (int i = 0; i < QUADS; i++)
        quad(s, lw_vec3(5 * (float)i, 0, 0), lw_vec3(0.1f + 0.03f * (float)(i % 40), 0, 0),
             lw_vec3(0, 0.1f + 0.03f * (float)(i * 7 % 40), 0));
    struct lw_scene *scene = scene_of(s, NULL, 1);
    build(scene, 10, 0);
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
    struct shape *s = fresh(state);
    quad(s, lw_vec3(0, 0, 0), lw_vec3(1, 0, 0), lw_vec3(0, 1, 0));
    s->double_sided = true;
    struct lw_scene *scene = scene_of(s, NULL, 1);
    struct lw_lightmap_report r = build(scene, 32, 0);
    check_layout(scene->mesh, &r, 1.01f);
    assert_int_equal(scene->mesh->back_offset, 36);
    assert_int_equal(scene->mesh->atlas_height, 72);
    assert_int_equal(r.texels_covered, 2 * 32 * 32);
    lw_scene_destroy(scene);
}

static void the_largest_instance_decides(void **state) {
    struct shape *s = fresh(state);
    quad(s, lw_vec3(0, 0, 0), lw_vec3(1, 0, 0), lw_vec3(0, 1, 0));
    struct lw_scene *scene = scene_of(s, (float[]){1, 3, 0.5f}, 3);
    struct lw_lightmap_report r = build(scene, 16, 0);
    assert_int_equal(r.texels_covered, 48 * 48);
    assert_true(fabsf(r.texels_per_metre - 16) < 1e-3f);
    lw_scene_destroy(scene);
}

static void use_uv1(struct shape *s, float shift) {
    quad(s, lw_vec3(0, 0, 0), lw_vec3(1, 0, 0), lw_vec3(0, 1, 0));
    quad(s, lw_vec3(3, 0, 0), lw_vec3(1, 0, 0), lw_vec3(0, 1, 0));
    s->has_uv1 = true;
    for (uint32_t v = 0; v < 8; v++)
        s->uv1[v] = (struct lw_vec2){0.4f * s->position[v % 4].x + (v < 4 ? 0.05f : shift),
                                     0.4f * s->position[v % 4].y + 0.3f};
}

static void good_uv1_is_used(void **state) {
    struct shape *s = fresh(state);
    use_uv1(s, 0.55f);
    struct lw_scene *scene = scene_of(s, NULL, 1);
    struct lw_lightmap_report r = build(scene, 32, 0);
    assert_true(r.from_file);
    check_layout(scene->mesh, &r, 1.1f);
    assert_int_equal(scene->mesh->atlas_width, 80); /* 32 texels are 0.4 of it */
    assert_int_equal(scene->mesh->vertex_count, 8);
    lw_scene_destroy(scene);
}

static void bad_uv1_is_refused(void **state) {
    const float shift[] = {0.3f, 0.605f, 0.455f}; /* overlapping, outside, apart by less than a texel */
    for (int i = 0; i < 3; i++) {
        struct shape *s = fresh(state);
        use_uv1(s, shift[i]);
        struct lw_scene *scene = scene_of(s, NULL, 1);
        struct lw_lightmap_report r = build(scene, 9, 0);
        assert_false(r.from_file);
        check_layout(scene->mesh, &r, 1.3f);
        lw_scene_destroy(scene);
    }
}

/* All triangles of a fan meet at its hub. Compared each with each, they would take the square of their
 * number; a bound makes several charts of them. Nothing lies on anything else all the same. */
static void fans_are_bounded(void **state) {
    enum { COUNT = 20000 };
    struct shape *s = fresh(state);
    const uint32_t hub = vertex(s, lw_vec3(0, 0, 0), lw_vec3(0, 0, 1));
    for (uint32_t i = 0; i < COUNT; i++) vertex(s, round_at((float)i / COUNT, 10), lw_vec3(0, 0, 1));
    for (uint32_t i = 0; i < COUNT; i++) triangle(s, hub, 1 + i, 1 + (i + 1) % COUNT);
    struct lw_scene *scene = scene_of(s, NULL, 1);
    struct lw_lightmap_report r = build(scene, 5, 0);
    assert_true(r.chart_count > 1); /* one, without the bound */
    assert_int_equal(lw_lightmap_overlaps(scene->mesh), 0);
    lw_scene_destroy(scene);
}

/* By their area, before each triangle is laid out over all texels. */
static void uv1_that_covers_itself_is_refused(void **state) {
    struct shape *s = fresh(state);
    for (int i = 0; i < 1000; i++) {
        quad(s, lw_vec3((float)i, 0, 0), lw_vec3(1, 0, 0), lw_vec3(0, 1, 0));
        const struct lw_vec2 square[4] = {{0, 0}, {1, 0}, {1, 1}, {0, 1}};
        memcpy(s->uv1 + s->vertex_count - 4, square, sizeof square);
    }
    s->has_uv1 = true;
    struct lw_scene *scene = scene_of(s, NULL, 1);
    struct lw_lightmap_report r = build(scene, 100, 4096);
    assert_false(r.from_file);
    lw_scene_destroy(scene);
}

static void too_much_is_capped(void **state) {
    struct shape *s = fresh(state);
    cube(s, 1);
    struct lw_scene *scene = scene_of(s, NULL, 1);
    struct lw_lightmap_report r = build(scene, 1000, 256);
    assert_true(r.capped);
    assert_true(r.atlas_width <= 256 && r.atlas_height <= 256);
    assert_true(r.texels_per_metre < 1000 && r.texels_per_metre > 60);
    check_layout(scene->mesh, &r, 1.4f);
    lw_scene_destroy(scene);
}

static void what_cannot_fit_is_named(void **state) {
    struct shape *s = fresh(state);
    for (int i = 0; i < 1000; i++) quad(s, lw_vec3((float)i * 3, 0, 0), lw_vec3(1, 0, 0), lw_vec3(0, 1, 0));
    struct lw_scene *scene = scene_of(s, NULL, 1);
    struct lw_error err = {0};
    struct lw_lightmap_desc desc = {.texels_per_metre = 4, .atlas_side_max = 16, .threads = 1};
    assert_int_equal(lw_lightmap_build(scene, &desc, NULL, &err), LW_BAD_DATA);
    assert_non_null(strstr(err.text, "shape"));
    assert_non_null(strstr(err.text, "1000 charts"));
    assert_null(scene->mesh->lightmap_uv);
    lw_scene_destroy(scene);
}

static void ugly_meshes_are_laid_out(void **state) {
    struct shape *s = fresh(state);
    cube(s, 1);
    for (int i = 0; i < 4; i++) triangle(s, 0, 1, 2);                  /* duplicates: non-manifold */
    triangle(s, 3, 3, 5);                                              /* no area */
    quad(s, lw_vec3(9, 0, 0), lw_vec3(1, 0, 0), lw_vec3(1e-9f, 0, 0)); /* thinner than single precision */
    struct lw_scene *scene = scene_of(s, NULL, 1);
    struct lw_lightmap_report r = build(scene, 16, 0);
    check_layout(scene->mesh, &r, 1.4f);
    lw_scene_destroy(scene);

    s = fresh(state); /* nothing but a point */
    vertex(s, lw_vec3(1, 2, 3), lw_vec3(0, 1, 0));
    triangle(s, 0, 0, 0);
    scene = scene_of(s, NULL, 1);
    r = build(scene, 0, 0);
    assert_int_equal(r.atlas_width, 8);
    assert_int_equal(lw_lightmap_overlaps(scene->mesh), 0);
    lw_scene_destroy(scene);
}

static struct lw_lightmap_report build_default(struct lw_scene *scene, uint32_t texels_max) {
    struct lw_lightmap_report r;
    struct lw_error err = {0};
    const struct lw_lightmap_desc desc = {.texels_max = texels_max, .threads = 1};
    lw_support_ok(lw_lightmap_build(scene, &desc, &r, &err), &err);
    return r;
}

static struct lw_scene *cube_of_side(void **state, float side_m) {
    struct shape *s = fresh(state);
    cube(s, 1);
    return scene_of(s, &side_m, 1);
}

static void the_default_is_a_density(void **state) {
    const float side_m[] = {30, 60};
    for (int i = 0; i < 2; i++) {
        struct lw_scene *scene = cube_of_side(state, side_m[i]);
        struct lw_lightmap_report r = build_default(scene, 0);
        const double texels = 6 * pow((double)side_m[i] * LW_LIGHTMAP_DENSITY_DEFAULT, 2);
        assert_in_range(r.texels_covered, (uint32_t)(texels * 0.97), (uint32_t)(texels * 1.05));
        assert_float_equal(r.texels_per_metre, LW_LIGHTMAP_DENSITY_DEFAULT, 1e-4);
        assert_float_equal(r.density_wanted, LW_LIGHTMAP_DENSITY_DEFAULT, 1e-6);
        assert_int_equal(r.texels_max, LW_LIGHTMAP_TEXELS_MAX);
        assert_false(r.bounded);
        lw_scene_destroy(scene);
    }
}

static void a_small_scene_has_texels_enough(void **state) {
    const float side_m[] = {1e-3f, 1, 10};
    for (int i = 0; i < 3; i++) {
        struct lw_scene *scene = cube_of_side(state, side_m[i]);
        struct lw_lightmap_report r = build_default(scene, 0);
        assert_in_range(r.texels_covered, (uint32_t)(LW_LIGHTMAP_TEXELS_MIN * 0.9),
                        (uint32_t)(LW_LIGHTMAP_TEXELS_MIN * 1.1));
        assert_false(r.bounded);
        lw_scene_destroy(scene);
    }
    struct lw_scene *scene = cube_of_side(state, 1); /* the bound is stronger */
    struct lw_lightmap_report r = build_default(scene, 10000);
    assert_in_range(r.texels_covered, 9000, 11000);
    lw_scene_destroy(scene);
}

/* Cubes of 1 m have what a thing of 1 m wants, while that is affordable. */
static void small_things_have_finer_texels(void **state) {
    const uint32_t cubes[] = {50, 500};
    for (int i = 0; i < 2; i++) {
        struct shape *s = fresh(state);
        cube(s, 1);
        struct lw_scene *scene = scene_of(s, NULL, cubes[i]);
        struct lw_lightmap_report r = build_default(scene, 0);
        const double wanted = fmin(LW_LIGHTMAP_ACROSS, sqrt(LW_LIGHTMAP_TEXELS_FINE / (6.0 * cubes[i])));
        assert_float_equal(r.density_wanted, wanted, 1e-4);
        lw_scene_destroy(scene);
        scene = scene_of(s, NULL, cubes[i]);
        r = build_default(scene, 150 * cubes[i]); /* the bound is stronger */
        assert_in_range(r.texels_covered, 100, 160);
        lw_scene_destroy(scene);
    }
}

/* An open cylinder of radius 0.5 and height 2: its two rims, and a full turn along its height, in right
 * angles. */
static void round_things_have_one_size(void **state) {
    for (unsigned columns = 12; columns <= 96; columns *= 2) {
        struct shape *s = fresh(state);
        grid(s, cylinder, columns, 4);
        struct lw_scene *scene = scene_of(s, NULL, 1);
        double length;
        lw_support_ok(lw_lightmap_things_edges(scene->mesh, &length), NULL);
        const double rims = 2 * columns * sin((double)LW_PI / columns), turn = 4 * 2;
        assert_true(fabs(length - (rims + turn)) < 1e-3);
        lw_scene_destroy(scene);
    }
}

static void texels_bound_the_density(void **state) {
    struct lw_scene *scene = cube_of_side(state, 1e5f);
    struct lw_lightmap_report r = build_default(scene, 0);
    assert_in_range(r.texels_covered, (uint32_t)(LW_LIGHTMAP_TEXELS_MAX * 0.95),
                    (uint32_t)(LW_LIGHTMAP_TEXELS_MAX * 1.05));
    assert_true(r.bounded);
    lw_scene_destroy(scene);

    scene = cube_of_side(state, 60);
    r = build_default(scene, 50000);
    assert_in_range(r.texels_covered, 47500, 52500);
    assert_true(r.bounded);
    assert_int_equal(r.texels_max, 50000);
    lw_scene_destroy(scene);

    /* one that is asked for has no bound but its own */
    for (uint32_t most = 0; most <= 50000; most += 50000) {
        struct lw_error err = {0};
        scene = cube_of_side(state, 60);
        const struct lw_lightmap_desc desc = {.texels_per_metre = 12, .texels_max = most, .threads = 1};
        lw_support_ok(lw_lightmap_build(scene, &desc, &r, &err), &err);
        assert_int_equal(r.bounded, most > 0);
        assert_float_equal(r.density_wanted, 12, 1e-6);
        if (most)
            assert_in_range(r.texels_covered, 47500, 52500);
        else
            assert_float_equal(r.texels_per_metre, 12, 1e-4);
        lw_scene_destroy(scene);
    }
}

/* A grid of 3,200 triangles, 3,000 times, on cylinders large enough to be bounded: what suffices for fewer
 * would be under half a texel for each. */
static void many_triangles_get_texels(void **state) {
    struct shape *s = fresh(state);
    grid(s, cylinder, 40, 40);
    struct lw_scene *scene = scene_of(s, NULL, 3000);
    for (uint32_t n = 0; n < scene->node_count; n++)
        for (int k = 0; k < 3; k++) scene->node[n].scale[k] = 100;
    struct lw_lightmap_report r = build_default(scene, 0);
    assert_true(r.bounded);
    assert_in_range(r.texels_covered, (uint32_t)(1600 * 0.95), (uint32_t)(1600 * 1.05));
    lw_scene_destroy(scene);
}

/* A square plate on a ground of this side; mesh 0 is the ground. */
static struct lw_scene *plate_on_a_ground(void **state, float ground_m, float plate_m) {
    struct shape *s = fresh(state);
    quad(s, lw_vec3(0, 0, 0), lw_vec3(ground_m, 0, 0), lw_vec3(0, ground_m, 0));
    struct lw_scene *scene = scene_of(s, NULL, 2);
    struct lw_mesh *mesh = lw_scene_alloc(scene, 2, sizeof *mesh);
    struct lw_vec3 *small = lw_scene_alloc(scene, s->vertex_count, sizeof *small);
    for (uint32_t v = 0; v < s->vertex_count; v++)
        small[v] = lw_vec3_scale(s->position[v], plate_m / ground_m);
    mesh[0] = mesh[1] = scene->mesh[0];
    mesh[1].position = small;
    scene->mesh = mesh;
    scene->mesh_count = 2;
    scene->object[1].mesh = 1;
    return scene;
}

/* A ground of 3 km and a plate of 10 m: even densities would leave the plate 11 of the 1,000,000 texels. */
static void a_ground_does_not_starve_the_rest(void **state) {
    struct lw_scene *scene = plate_on_a_ground(state, 3000, 10);
    struct lw_lightmap_report r[2];
    struct lw_error err = {0};
    lw_support_ok(lw_lightmap_build(scene, &(struct lw_lightmap_desc){0}, r, &err), &err);
    assert_in_range(r[0].texels_covered + r[1].texels_covered, (uint32_t)(LW_LIGHTMAP_TEXELS_MAX * 0.95),
                    (uint32_t)(LW_LIGHTMAP_TEXELS_MAX * 1.05));
    /* The plate has the density that is wanted; the ground has what that leaves. */
    assert_float_equal(r[1].texels_per_metre, LW_LIGHTMAP_DENSITY_DEFAULT, 0.2);
    assert_false(r[1].bounded);
    assert_true(r[0].bounded);
    assert_true(r[0].texels_per_metre > 0.28f && r[0].texels_per_metre < 0.36f);
    lw_scene_destroy(scene);
}

static void density_of(struct lw_scene *scene, const char *text, const char *error,
                       struct lw_lightmap_report *out_report) {
    struct lw_error err = {0};
    const struct lw_lightmap_desc desc = {
        .texels_per_metre = 8, .threads = 1, .density_of = text, .texels_max = error ? 0 : 3000};
    if (error)
        lw_support_fails(lw_lightmap_build(scene, &desc, out_report, &err), LW_USAGE, &err, error);
    else
        lw_support_ok(lw_lightmap_build(scene, &desc, out_report, &err), &err);
}

/* Two cubes of 1 m, whose objects have names; a name may hold an equals sign. */
static void named_objects_have_their_own_density(void **state) {
    struct shape *s = fresh(state);
    struct lw_lightmap_report r;
    cube(s, 1);
    struct lw_scene *scene = scene_of(s, NULL, 1);
    scene->object[0].name = lw_scene_string(scene, "a=b");
    density_of(scene, "a=b", "\"a=b\" wants a factor from 1/64 to 8", &r);
    density_of(scene, "a", "\"a\" is no NAME=FACTOR", &r);
    density_of(scene, "=2", "\"=2\" is no NAME=FACTOR", &r);
    density_of(scene, "", "\"\" is no NAME=FACTOR", &r);
    density_of(scene, "a=b=9", "wants a factor", &r);
    density_of(scene, "a=b=nan", "wants a factor", &r);
    density_of(scene, "a=b=2x", "wants a factor", &r);
    density_of(scene, "a=b=2,c=1", "no object called \"c\"", &r);
    density_of(scene, "a=b=2,", "\"\" is no NAME=FACTOR", &r);
    density_of(scene, "a=b=2", NULL, &r);
    assert_float_equal(r.texels_per_metre, 16, 0.01f);
    assert_int_equal(r.texels_covered, 6 * 16 * 16);
    assert_false(r.bounded);
    lw_scene_destroy(scene);
    scene = scene_of(s, NULL, 1);
    scene->object[0].name = lw_scene_string(scene, "cube");
    density_of(scene, "cube=8", NULL, &r); /* 6 * 64 * 64 would be past the bound of 3000 */
    assert_true(r.bounded && r.texels_covered < 3600 && r.density_wanted == 64);
    lw_scene_destroy(scene);
}

/* The ground, far larger, counts as a second plate: of its area and its share of the ground's edges. */
static void a_ground_does_not_coarsen_the_rest(void **state) {
    struct lw_scene *scene = plate_on_a_ground(state, 30, 2);
    struct lw_lightmap_report r[2];
    struct lw_error err = {0};
    lw_support_ok(lw_lightmap_build(scene, &(struct lw_lightmap_desc){0}, r, &err), &err);
    const double edges_m = 4 * 2 + 4 * 30 / 225.0, things_m = 2 * (4 + 4) / edges_m;
    for (int i = 0; i < 2; i++)
        assert_float_equal(r[i].density_wanted, (float)(LW_LIGHTMAP_ACROSS / things_m), 1e-4f);
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
    struct shape *s = fresh(state);
    quad(s, lw_vec3(0, 0, 0), lw_vec3(1, 0, 0), lw_vec3(0, 1, 0));
    quad(s, lw_vec3(3, 0, 0), lw_vec3(1, 0, 0), lw_vec3(0, 1, 0));
    struct lw_scene *scene = scene_of(s, NULL, 1);
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
    struct shape *s = fresh(state);
    quad(s, lw_vec3(0, 0, 0), lw_vec3(1, 0, 0), lw_vec3(0, 1, 0));
    quad(s, lw_vec3(3, 0, 0), lw_vec3(1, 0, 0), lw_vec3(0, 1, 0));
    struct lw_scene *scene = scene_of(s, NULL, 1);
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

static int set_up(void **state) { return (*state = malloc(sizeof(struct shape))) ? 0 : -1; }
static int tear_down(void **state) {
    free(*state);
    return 0;
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
        cmocka_unit_test(a_thin_bar_has_a_chart_for_each_side),
        cmocka_unit_test(no_level_that_is_named_reads_other_charts),
        cmocka_unit_test(backs_have_their_own_half),
        cmocka_unit_test(the_largest_instance_decides),
        cmocka_unit_test(good_uv1_is_used),
        cmocka_unit_test(bad_uv1_is_refused),
        cmocka_unit_test(fans_are_bounded),
        cmocka_unit_test(uv1_that_covers_itself_is_refused),
        cmocka_unit_test(too_much_is_capped),
        cmocka_unit_test(what_cannot_fit_is_named),
        cmocka_unit_test(ugly_meshes_are_laid_out),
        cmocka_unit_test(the_default_is_a_density),
        cmocka_unit_test(a_small_scene_has_texels_enough),
        cmocka_unit_test(small_things_have_finer_texels),
        cmocka_unit_test(round_things_have_one_size),
        cmocka_unit_test(texels_bound_the_density),
        cmocka_unit_test(many_triangles_get_texels),
        cmocka_unit_test(a_ground_does_not_starve_the_rest),
        cmocka_unit_test(a_ground_does_not_coarsen_the_rest),
        cmocka_unit_test(named_objects_have_their_own_density),
        cmocka_unit_test(threads_do_not_matter),
        cmocka_unit_test(overlaps_are_seen),
        cmocka_unit_test(mixed_texels_are_seen),
    };
    return cmocka_run_group_tests(tests, set_up, tear_down);
}
