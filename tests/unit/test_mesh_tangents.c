/* Tangents against those of npm's mikktspace (three's mikktspace.module.js, Mikkelsen's code in WebAssembly),
 * and against what they must be on flat squares. */
#include "tests/support/support.h"

#include "common/shading/tangent.h"
#include "server/import/mesh/mesh_tangents.h"

#include <math.h>
#include <string.h>

#define COLUMNS  5u
#define ROWS     4u
#define VERTICES (COLUMNS * ROWS)
#define FACES    (2 * (COLUMNS - 1) * (ROWS - 1))
#define STEP     1.2e-4f /* error of a tangent's 15 bits, radians: half a step, and rounding */

/* A rough sheet: u runs to its middle column and back, as mirrored halves of a model have it; the first
 * triangle has no area in the picture. */
static const float height[VERTICES] = {0, 2, 1, 0, 3, 1, 4, 2, 1, 0,
                                       0, 1, 3, 2, 1, 2, 0, 1, 4, 0}; /* 1/8 m */
static const struct lw_vec3 normal[VERTICES] = {
    {-0.123796895f, -0.0618984476f, 0.990375161f},  {-0.0618984476f, -0.123796895f, 0.990375161f},
    {0.123796895f, -0.0618984476f, 0.990375161f},   {-0.123796895f, -0.0618984476f, 0.990375161f},
    {-0.181236625f, 0.181236625f, 0.966595352f},    {-0.184288532f, 0.00000000f, 0.982872188f},
    {-0.0622572824f, 0.0622572824f, 0.996116519f},  {0.182913229f, -0.121942155f, 0.975537241f},
    {0.123091489f, -0.123091489f, 0.984731913f},    {0.0618984476f, 0.123796895f, 0.990375161f},
    {-0.0622572824f, -0.0622572824f, 0.996116519f}, {-0.178965002f, 0.238619998f, 0.954479992f},
    {-0.0622572824f, 0.0622572824f, 0.996116519f},  {0.121942155f, -0.182913229f, 0.975537241f},
    {0.0623782873f, 0.00000000f, 0.998052597f},     {0.123091489f, -0.123091489f, 0.984731913f},
    {0.0622572824f, 0.0622572824f, 0.996116519f},   {-0.240771711f, 0.120385855f, 0.963086843f},
    {0.0618984476f, -0.123796895f, 0.990375161f},   {0.242091015f, 0.0605227537f, 0.968364060f}};
/* npm's, per corner */
static const float expected[3 * FACES][4] = {
    {1.000000f, 0.000000f, 0.000000f, -1},    {0.994111f, 0.080789f, 0.072231f, 1},
    {0.956241f, -0.231206f, 0.179295f, 1},    {0.956241f, -0.231206f, 0.179295f, 1},
    {0.994111f, 0.080789f, 0.072231f, 1},     {0.998046f, 0.009152f, 0.061806f, 1},
    {0.994111f, 0.080789f, 0.072231f, 1},     {0.965346f, 0.238587f, -0.105757f, 1},
    {0.998046f, 0.009152f, 0.061806f, 1},     {0.998046f, 0.009152f, 0.061806f, 1},
    {0.965346f, 0.238587f, -0.105757f, 1},    {0.957945f, 0.245259f, -0.148957f, 1},
    {-0.961128f, 0.240742f, 0.135187f, -1},   {-0.992302f, 0.011097f, -0.123344f, -1},
    {-0.950114f, 0.233064f, 0.207279f, -1},   {-0.950114f, 0.233064f, 0.207279f, -1},
    {-0.992302f, 0.011097f, -0.123344f, -1},  {-0.992368f, -0.007839f, 0.123066f, -1},
    {-0.992302f, 0.011097f, -0.123344f, -1},  {-0.958560f, -0.252236f, -0.132436f, -1},
    {-0.992368f, -0.007839f, 0.123066f, -1},  {-0.992368f, -0.007839f, 0.123066f, -1},
    {-0.958560f, -0.252236f, -0.132436f, -1}, {-0.964586f, -0.247492f, 0.091223f, -1},
    {0.956241f, -0.231206f, 0.179295f, 1},    {0.998046f, 0.009152f, 0.061806f, 1},
    {0.971545f, -0.232305f, 0.046202f, 1},    {0.971545f, -0.232305f, 0.046202f, 1},
    {0.998046f, 0.009152f, 0.061806f, 1},     {0.983563f, 0.019726f, 0.179486f, 1},
    {0.998046f, 0.009152f, 0.061806f, 1},     {0.957945f, 0.245259f, -0.148957f, 1},
    {0.983563f, 0.019726f, 0.179486f, 1},     {0.983563f, 0.019726f, 0.179486f, 1},
    {0.957945f, 0.245259f, -0.148957f, 1},    {0.971917f, 0.230718f, 0.046325f, 1},
    {-0.950114f, 0.233064f, 0.207279f, -1},   {-0.992368f, -0.007839f, 0.123066f, -1},
    {-0.969379f, 0.233773f, -0.075197f, -1},  {-0.969379f, 0.233773f, -0.075197f, -1},
    {-0.992368f, -0.007839f, 0.123066f, -1},  {-0.992499f, -0.013845f, 0.121466f, -1},
    {-0.992368f, -0.007839f, 0.123066f, -1},  {-0.964586f, -0.247492f, 0.091223f, -1},
    {-0.992499f, -0.013845f, 0.121466f, -1},  {-0.992499f, -0.013845f, 0.121466f, -1},
    {-0.964586f, -0.247492f, 0.091223f, -1},  {-0.968828f, -0.240221f, 0.060552f, -1},
    {0.971545f, -0.232305f, 0.046202f, 1},    {0.983563f, 0.019726f, 0.179486f, 1},
    {0.960934f, -0.233088f, -0.149253f, 1},   {0.960934f, -0.233088f, -0.149253f, 1},
    {0.983563f, 0.019726f, 0.179486f, 1},     {0.998041f, 0.002332f, -0.062523f, 1},
    {0.983563f, 0.019726f, 0.179486f, 1},     {0.971917f, 0.230718f, 0.046325f, 1},
    {0.998041f, 0.002332f, -0.062523f, 1},    {0.998041f, 0.002332f, -0.062523f, 1},
    {0.971917f, 0.230718f, 0.046325f, 1},     {0.943348f, 0.262435f, 0.203033f, 1},
    {-0.969379f, 0.233773f, -0.075197f, -1},  {-0.992499f, -0.013845f, 0.121466f, -1},
    {-0.938184f, 0.225369f, -0.262717f, -1},  {-0.938184f, 0.225369f, -0.262717f, -1},
    {-0.992499f, -0.013845f, 0.121466f, -1},  {-0.998071f, -0.002903f, 0.062017f, -1},
    {-0.992499f, -0.013845f, 0.121466f, -1},  {-0.968828f, -0.240221f, 0.060552f, -1},
    {-0.998071f, -0.002903f, 0.062017f, -1},  {-0.998071f, -0.002903f, 0.062017f, -1},
    {-0.968828f, -0.240221f, 0.060552f, -1},  {-0.939451f, -0.234863f, 0.249542f, -1}};

struct sheet {
    struct lw_vec3 position[VERTICES];
    struct lw_vec2 uv[VERTICES]; /* v down */
    uint32_t triangle[FACES][3], material[FACES];
};

static const struct lw_texture_use none = {LW_SCENE_NONE, 0, {1, 0, 0, 0, 1, 0}};

/* One material with a normal map, one without. */
static struct lw_scene *make_scene(void) {
    struct lw_scene *scene;
    assert_int_equal(lw_scene_create(&scene), LW_OK);
    struct lw_finish *finish = lw_scene_alloc(scene, 1, sizeof *finish);
    scene->material = lw_scene_alloc(scene, 2, sizeof *scene->material);
    scene->material_count = 2;
    *finish = (struct lw_finish){.normal_scale = 1, .normal_texture = none};
    finish->normal_texture.texture = 0;
    scene->material[0].finish = finish;
    return scene;
}

static struct lw_texture_use *normal_map(struct lw_scene *scene) {
    return (struct lw_texture_use *)(uintptr_t)&scene->material[0].finish->normal_texture;
}

static void make_sheet(struct sheet *sheet) {
    uint32_t f = 0;
    for (uint32_t y = 0; y < ROWS; y++)
        for (uint32_t x = 0; x < COLUMNS; x++) {
            const uint32_t v = y * COLUMNS + x;
            const float fold = x <= 2 ? (float)x : 4 - (float)x;
            sheet->position[v] = lw_vec3((float)x, (float)y, height[v] / 8);
            sheet->uv[v] = (struct lw_vec2){fold, 1 - ((float)y + (float)(x % 2) / 4)};
        }
    sheet->uv[0] = sheet->uv[1];
    for (uint32_t y = 0; y + 1 < ROWS; y++)
        for (uint32_t x = 0; x + 1 < COLUMNS; x++, f += 2) {
            const uint32_t a = y * COLUMNS + x, b = a + COLUMNS;
            memcpy(sheet->triangle[f], (const uint32_t[]){a, a + 1, b}, sizeof *sheet->triangle);
            memcpy(sheet->triangle[f + 1], (const uint32_t[]){b, a + 1, b + 1}, sizeof *sheet->triangle);
        }
    memset(sheet->material, 0, sizeof sheet->material);
}

static struct lw_mesh mesh_of(const struct sheet *sheet) {
    return (struct lw_mesh){.name = "sheet",
                            .vertex_count = VERTICES,
                            .triangle_count = FACES,
                            .position = sheet->position,
                            .normal = normal,
                            .uv = {sheet->uv, NULL},
                            .triangle = sheet->triangle,
                            .material = sheet->material};
}

static uint64_t build(struct lw_scene *scene, struct lw_mesh *mesh, struct lw_vec4 *given) {
    uint64_t bad = 0;
    struct lw_error err = {0};
    lw_support_ok(lw_mesh_tangents_build(scene, mesh, given, &bad, &err), &err);
    return bad;
}

static struct lw_vec4 tangent_at(const struct lw_mesh *mesh, uint32_t corner) {
    return lw_tangent_decode(mesh->tangent[corner], mesh->normal[mesh->triangle[corner / 3][corner % 3]]);
}

static void assert_tangent(struct lw_vec4 found, const float wanted[4], uint32_t corner) {
    const struct lw_vec3 a = lw_vec3(found.x, found.y, found.z), b = lw_vec3(wanted[0], wanted[1], wanted[2]);
    if (found.w != wanted[3] || lw_vec3_length(lw_vec3_sub(a, b)) > STEP)
        fail_msg("corner %u: (%g, %g, %g, %g), not (%g, %g, %g, %g)", corner, (double)found.x,
                 (double)found.y, (double)found.z, (double)found.w, (double)wanted[0], (double)wanted[1],
                 (double)wanted[2], (double)wanted[3]);
}

static void tangents_are_those_of_mikktspace(void **state) {
    (void)state;
    struct lw_scene *scene = make_scene();
    struct sheet sheet;
    make_sheet(&sheet);
    struct lw_mesh mesh = mesh_of(&sheet);
    build(scene, &mesh, NULL);
    /* corner 0 lies beside no group: npm's has a tangent that means nothing */
    for (uint32_t c = 1; c < 3 * FACES; c++) assert_tangent(tangent_at(&mesh, c), expected[c], c);
    assert_true(isfinite(tangent_at(&mesh, 0).x));
    lw_scene_destroy(scene);
}

/* The same sheet with each corner a vertex of its own, as many files have it. */
static void corners_are_welded(void **state) {
    (void)state;
    struct lw_scene *scene = make_scene();
    struct sheet sheet;
    make_sheet(&sheet);
    struct lw_vec3 position[3 * FACES], own_normal[3 * FACES];
    struct lw_vec2 uv[3 * FACES];
    uint32_t triangle[FACES][3];
    for (uint32_t c = 0; c < 3 * FACES; c++) {
        const uint32_t v = sheet.triangle[c / 3][c % 3];
        position[c] = sheet.position[v];
        own_normal[c] = normal[v];
        uv[c] = sheet.uv[v];
        triangle[c / 3][c % 3] = c;
    }
    struct lw_mesh mesh = mesh_of(&sheet);
    mesh.vertex_count = 3 * FACES;
    mesh.position = position;
    mesh.normal = own_normal;
    mesh.uv[0] = uv;
    mesh.triangle = triangle;
    build(scene, &mesh, NULL);
    for (uint32_t c = 1; c < 3 * FACES; c++) assert_tangent(tangent_at(&mesh, c), expected[c], c);
    lw_scene_destroy(scene);
}

/* The picture turned by a quarter and mirrored: u' = v, v' = u. */
static void a_transform_turns_tangents(void **state) {
    (void)state;
    struct lw_scene *scene = make_scene();
    const struct lw_vec3 position[3] = {{0, 0, 0}, {1, 0, 0}, {0, 1, 0}},
                         up[3] = {{0, 0, 1}, {0, 0, 1}, {0, 0, 1}};
    const struct lw_vec2 uv[3] = {{0, 1}, {1, 1}, {0, 0}}; /* the picture stands upright */
    const uint32_t triangle[1][3] = {{0, 1, 2}}, material[1] = {0};
    struct lw_mesh mesh = {.vertex_count = 3,
                           .triangle_count = 1,
                           .position = position,
                           .normal = up,
                           .uv = {uv, NULL},
                           .triangle = triangle,
                           .material = material};
    build(scene, &mesh, NULL);
    assert_tangent(tangent_at(&mesh, 0), (const float[]){1, 0, 0, 1}, 0);
    memcpy(normal_map(scene)->transform, (const float[]){0, 1, 0, 1, 0, 0}, 6 * sizeof(float));
    build(scene, &mesh, NULL);
    assert_tangent(tangent_at(&mesh, 0), (const float[]){0, -1, 0, -1}, 0);
    lw_scene_destroy(scene);
}

static void only_normal_maps_have_tangents(void **state) {
    (void)state;
    struct lw_scene *scene = make_scene();
    struct sheet sheet;
    make_sheet(&sheet);
    struct lw_mesh mesh = mesh_of(&sheet);
    for (uint32_t f = 0; f < FACES; f++) sheet.material[f] = 1;
    build(scene, &mesh, NULL);
    assert_null(mesh.tangent);
    sheet.material[5] = 0;
    build(scene, &mesh, NULL);
    for (uint32_t c = 0; c < 3 * FACES; c++)
        if (c / 3 != 5) assert_int_equal(mesh.tangent[c], 0);
    assert_int_not_equal(mesh.tangent[15], 0);
    /* a set of coordinates that is not there */
    normal_map(scene)->uv_set = 1;
    build(scene, &mesh, NULL);
    assert_null(mesh.tangent);
    lw_scene_destroy(scene);
}

static void tangents_of_a_file_stay(void **state) {
    (void)state;
    struct lw_scene *scene = make_scene();
    struct sheet sheet;
    make_sheet(&sheet);
    struct lw_mesh mesh = mesh_of(&sheet);
    struct lw_vec4 given[VERTICES];
    for (uint32_t v = 0; v < VERTICES; v++) given[v] = (struct lw_vec4){0, 2, 0, v % 2 ? -1 : 1};
    const uint32_t last = 3 * FACES - 1, vertex = VERTICES - 1; /* in one triangle alone */
    static const struct lw_vec4 broken[] = {{NAN, 0, 0, 1},   {0, 0, 0, 1},        {INFINITY, 0, 0, 1},
                                            {1, 0, 0, 0.5f},  {1, 0, 0, NAN},      {1, 0, 0, 3},
                                            {0, 0, 3e38f, 1}, {1e38f, 1e38f, 0, 1}};
    assert_int_equal(build(scene, &mesh, given), 0);
    for (uint32_t c = 0; c < 3 * FACES; c++) {
        const uint32_t v = sheet.triangle[c / 3][c % 3];
        const struct lw_vec3 n = normal[v], flat = lw_vec3_mad(lw_vec3(0, 1, 0), n, -n.y),
                             unit = lw_vec3_normalize(flat);
        assert_tangent(tangent_at(&mesh, c), (const float[]){unit.x, unit.y, unit.z, given[v].w}, c);
    }
    for (size_t i = 0; i < sizeof broken / sizeof *broken; i++) {
        given[vertex] = broken[i];
        assert_int_equal(build(scene, &mesh, given), 1);
        assert_tangent(tangent_at(&mesh, last), expected[last], last);
    }
    given[vertex] = (struct lw_vec4){normal[vertex].x, normal[vertex].y, normal[vertex].z, 1};
    assert_int_equal(build(scene, &mesh, given), 1);
    lw_scene_destroy(scene);
}

/* Texture coordinates that overflow or stand still, and a fan of many triangles about one point. */
static void broken_coordinates_make_finite_tangents(void **state) {
    (void)state;
    enum { SPOKES = 3000 };
    struct lw_scene *scene = make_scene();
    struct lw_vec3 *position = lw_scene_alloc(scene, SPOKES + 1, sizeof *position),
                   *up = lw_scene_alloc(scene, SPOKES + 1, sizeof *up);
    struct lw_vec2 *uv = lw_scene_alloc(scene, SPOKES + 1, sizeof *uv);
    uint32_t(*triangle)[3] = lw_scene_alloc(scene, SPOKES, sizeof *triangle);
    uint32_t *material = lw_scene_alloc(scene, SPOKES, sizeof *material);
    for (uint32_t i = 0; i <= SPOKES; i++) {
        const float angle = 2 * LW_PI * (float)i / SPOKES;
        position[i] = i == SPOKES ? lw_vec3(0, 0, 0) : lw_vec3(cosf(angle), sinf(angle), 0);
        up[i] = lw_vec3(0, 0, 1);
        uv[i] = (struct lw_vec2){position[i].x, -position[i].y};
        if (i % 100 == 7) uv[i] = (struct lw_vec2){i % 200 == 7 ? 3e38f : 1, -3e38f};
        if (i < SPOKES)
            memcpy(triangle[i], (const uint32_t[]){SPOKES, i, (i + 1) % SPOKES}, sizeof *triangle);
    }
    struct lw_mesh mesh = {.vertex_count = SPOKES + 1,
                           .triangle_count = SPOKES,
                           .position = position,
                           .normal = up,
                           .uv = {uv, NULL},
                           .triangle = triangle,
                           .material = material};
    build(scene, &mesh, NULL);
    for (uint32_t c = 0; c < 3 * SPOKES; c++) assert_true(isfinite(tangent_at(&mesh, c).x));
    assert_tangent(tangent_at(&mesh, 3 * 50), (const float[]){1, 0, 0, 1}, 150);
    for (uint32_t i = 0; i <= SPOKES; i++) uv[i] = (struct lw_vec2){0.5f, 0.5f};
    build(scene, &mesh, NULL);
    assert_non_null(mesh.tangent);
    lw_scene_destroy(scene);
}

int main(void) {
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(tangents_are_those_of_mikktspace),
        cmocka_unit_test(corners_are_welded),
        cmocka_unit_test(a_transform_turns_tangents),
        cmocka_unit_test(only_normal_maps_have_tangents),
        cmocka_unit_test(tangents_of_a_file_stay),
        cmocka_unit_test(broken_coordinates_make_finite_tangents),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
