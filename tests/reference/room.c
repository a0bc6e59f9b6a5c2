#include "tests/reference/room.h"

#include "common/lightmap/lightmap.h"
#include "server/solve/surface/texels.h"

#include <math.h>
#include <string.h>

#define DISC_SEGMENTS 96u

void room_quad(struct room *room, struct lw_vec3 corner, struct lw_vec3 edge_u, struct lw_vec3 edge_v,
               float albedo, float emission) {
    assert_true(room->quad_count < ROOM_QUADS_MAX);
    room->quad[room->quad_count++] =
        (struct room_quad){corner, edge_u, edge_v, albedo, emission, false, LW_ALPHA_OPAQUE, 1, 0};
}

void room_disc(struct room *room, struct lw_vec3 centre, struct lw_vec3 radius_u, struct lw_vec3 radius_v,
               float albedo, float emission) {
    room_quad(room, centre, radius_u, radius_v, albedo, emission);
    room->quad[room->quad_count - 1].segments = DISC_SEGMENTS;
}

void room_box(struct room *room, struct lw_vec3 s, float albedo, float emission) {
    const struct lw_vec3 x = lw_vec3(s.x, 0, 0), y = lw_vec3(0, s.y, 0), z = lw_vec3(0, 0, s.z),
                         o = lw_vec3(0, 0, 0);
    room_quad(room, o, z, x, albedo, emission); /* floor, facing +Y */
    room_quad(room, y, x, z, albedo, emission); /* ceiling */
    room_quad(room, o, x, y, albedo, emission); /* z = 0, facing +Z */
    room_quad(room, z, y, x, albedo, emission);
    room_quad(room, o, y, z, albedo, emission); /* x = 0, facing +X */
    room_quad(room, x, z, y, albedo, emission);
}

struct room room_lit_box(float texels_per_metre) {
    struct room room = {.texels_per_metre = texels_per_metre};
    room_box(&room, lw_vec3(2, 2, 3), 0.6f, 0);
    room_quad(&room, lw_vec3(0.7f, 1.99f, 0.7f), lw_vec3(0.6f, 0, 0), lw_vec3(0, 0, 0.6f), 0, 5);
    return room;
}

struct room room_with_two_lamps(void) {
    struct room room = {.texels_per_metre = 12};
    room_box(&room, lw_vec3(4, 2, 2), 0.5f, 0);
    room_quad(&room, lw_vec3(1.4f, 0.4f, 0.8f), lw_vec3(0, 0, 0.4f), lw_vec3(0.4f, 0, 0), 0.5f, 0);
    room.quad[ROOM_PLATE].double_sided = true;
    room_quad(&room, lw_vec3(2, 1.9f, 0.8f), lw_vec3(0.4f, 0, 0), lw_vec3(0, 0, 0.4f), 0.5f, 6);
    room.light[0] = (struct lw_light){.name = "left", .kind = LW_LIGHT_POINT, .intensity = {4, 4, 4}};
    room.light_position[0] = lw_vec3(1, 1.6f, 1);
    room.light[1] = (struct lw_light){.name = "right", .kind = LW_LIGHT_POINT, .intensity = {3, 0, 1}};
    room.light_position[1] = lw_vec3(3, 1.6f, 1);
    room.light_count = 2;
    return room;
}

/* A quad's corners about its rim; a disc's centre, then its rim. */
static void place_vertices(const struct room_quad *quad, struct lw_vec3 *out_position) {
    if (!quad->segments) {
        out_position[0] = quad->corner;
        out_position[1] = lw_vec3_add(quad->corner, quad->edge_u);
        out_position[2] = lw_vec3_add(out_position[1], quad->edge_v);
        out_position[3] = lw_vec3_add(quad->corner, quad->edge_v);
        return;
    }
    out_position[0] = quad->corner;
    for (unsigned k = 0; k < quad->segments; k++) {
        float angle = 2 * LW_PI * (float)k / (float)quad->segments;
        out_position[1 + k] =
            lw_vec3_mad(lw_vec3_mad(quad->corner, quad->edge_u, cosf(angle)), quad->edge_v, sinf(angle));
    }
}

static void add_quad(struct lw_scene *scene, uint32_t i, const struct room_quad *quad) {
    const uint32_t vertices = quad->segments ? quad->segments + 1 : 4,
                   triangles = quad->segments ? quad->segments : 2;
    struct lw_vec3 *position = lw_scene_alloc(scene, vertices, sizeof *position),
                   *normal = lw_scene_alloc(scene, vertices, sizeof *normal);
    uint32_t(*triangle)[3] = lw_scene_alloc(scene, triangles, sizeof *triangle);
    uint32_t *material = lw_scene_alloc(scene, triangles, sizeof *material);
    struct lw_vec2 *uv = lw_scene_alloc(scene, vertices, sizeof *uv);
    assert_non_null(uv);
    assert_non_null(position);
    assert_non_null(normal);
    assert_non_null(triangle);
    assert_non_null(material);
    place_vertices(quad, position);
    for (uint32_t v = 0; v < vertices; v++)
        normal[v] = lw_vec3_normalize(lw_vec3_cross(quad->edge_u, quad->edge_v));
    for (uint32_t v = 0; v < 4 && !quad->segments; v++)
        uv[v] = (struct lw_vec2){v == 1 || v == 2 ? 1 : 0, v >= 2 ? 1 : 0};
    for (uint32_t t = 0; t < triangles; t++) {
        const uint32_t k = quad->segments;
        const uint32_t corner[3] = {0, 1 + t, k ? 1 + (t + 1) % k : 2 + t};
        memcpy(triangle[t], corner, sizeof corner);
        material[t] = i;
    }
    scene->mesh[i] = (struct lw_mesh){.name = "quad",
                                      .vertex_count = vertices,
                                      .triangle_count = triangles,
                                      .position = position,
                                      .normal = normal,
                                      .uv = {uv},
                                      .triangle = triangle,
                                      .material = material};
    struct lw_material *m = &scene->material[i];
    *m = (struct lw_material){
        .name = "grey",
        .alpha_cutoff = 0.5f,
        .double_sided = quad->double_sided,
        .alpha_mode = quad->alpha_mode,
        .base_colour = {quad->albedo, quad->albedo, quad->albedo, quad->alpha},
        .emission = {quad->emission, quad->emission, quad->emission},
        .base_colour_texture = {.texture = LW_SCENE_NONE, .transform = {1, 0, 0, 0, 1, 0}},
        .emission_texture = {.texture = LW_SCENE_NONE, .transform = {1, 0, 0, 0, 1, 0}}};
    scene->object[i] = (struct lw_object){.name = "quad", .mesh = i, .node = i};
}

struct lw_scene *room_scene(const struct room *room) {
    struct lw_scene *scene;
    lw_support_ok(lw_scene_create(&scene), NULL);
    scene->name = "room";
    scene->mesh_count = scene->material_count = scene->object_count = room->quad_count;
    scene->light_count = room->light_count;
    scene->node_count = room->quad_count + room->light_count;
    scene->mesh = lw_scene_alloc(scene, room->quad_count, sizeof *scene->mesh);
    scene->material = lw_scene_alloc(scene, room->quad_count, sizeof *scene->material);
    scene->object = lw_scene_alloc(scene, room->quad_count, sizeof *scene->object);
    scene->node = lw_scene_alloc(scene, scene->node_count, sizeof *scene->node);
    scene->light = lw_scene_alloc(scene, room->light_count + 1, sizeof *scene->light);
    for (uint32_t i = 0; i < scene->node_count; i++)
        scene->node[i] = (struct lw_node){
            .name = "", .parent = LW_SCENE_NONE, .rotation = {0, 0, 0, 1}, .scale = {1, 1, 1}};
    for (uint32_t i = 0; i < room->quad_count; i++) add_quad(scene, i, &room->quad[i]);
    for (uint32_t i = 0; i < room->light_count; i++) {
        struct lw_node *node = &scene->node[room->quad_count + i];
        memcpy(node->translation, &room->light_position[i], sizeof node->translation);
        node->rotation[0] = -sqrtf(0.5f); /* -Z turned to -Y */
        node->rotation[3] = sqrtf(0.5f);
        scene->light[i] = room->light[i];
        if (!scene->light[i].name) scene->light[i].name = "light";
        scene->light[i].node = room->quad_count + i;
    }
    for (int c = 0; c < 3; c++) scene->sky[c] = room->sky;
    scene->environment = room->environment;
    return scene;
}

/* All but the solver. */
static void prepare(struct room_solution *solution, struct lw_scene *scene, float texels_per_metre,
                    struct lw_solver_desc *desc, double time_s) {
    struct lw_error err = {0};
    lw_support_ok(lw_scene_validate(scene, &err), &err);
    *solution = (struct room_solution){.scene = scene};
    if (!scene->mesh_count || !scene->mesh[0].lightmap_uv)
        lw_support_ok(lw_lightmap_build(scene,
                                        &(struct lw_lightmap_desc){.texels_per_metre = texels_per_metre},
                                        NULL, &err),
                      &err);
    lw_support_ok(lw_atlas_map_init(&solution->map, scene), NULL);
    lw_support_ok(lw_pose_init(&solution->pose, scene), NULL);
    lw_pose_evaluate(&solution->pose, scene, time_s);
    desc->scene = scene;
    desc->atlas_map = &solution->map;
    if (!desc->direct_samples) desc->direct_samples = 1;
    if (!desc->indirect_samples) desc->indirect_samples = 4;
    if (!desc->seed) desc->seed = 1;
}

static void solve(struct room_solution *solution, unsigned frames) {
    struct lw_error err = {0};
    for (unsigned f = 1; f <= frames; f++) {
        lw_support_ok(
            solution->solver->ops->frame(solution->solver, &solution->pose, f, &solution->stats, &err), &err);
        solution->rays +=
            solution->stats.rays_shadow + solution->stats.rays_bounce + solution->stats.rays_probe;
    }
}

#define AROUND 32u
#define DOWN   16u

void room_make_ball(struct lw_scene *scene, uint32_t quad, struct lw_vec3 centre, float radius) {
    const uint32_t vertices = (AROUND + 1) * (DOWN + 1), triangles = 2 * AROUND * (DOWN - 1);
    struct lw_vec3 *position = lw_scene_alloc(scene, vertices, sizeof *position),
                   *normal = lw_scene_alloc(scene, vertices, sizeof *normal);
    uint32_t(*triangle)[3] = lw_scene_alloc(scene, triangles, sizeof *triangle);
    uint32_t *material = lw_scene_alloc(scene, triangles, sizeof *material), n = 0;
    assert_true(position && normal && triangle && material);
    for (uint32_t v = 0; v < vertices; v++) {
        float polar = LW_PI * (float)(v / (AROUND + 1)) / (float)DOWN;
        float angle = 2 * LW_PI * (float)(v % (AROUND + 1)) / (float)AROUND;
        normal[v] = lw_vec3(sinf(polar) * cosf(angle), cosf(polar), sinf(polar) * sinf(angle));
        position[v] = lw_vec3_mad(centre, normal[v], radius);
    }
    for (uint32_t j = 0; j < DOWN; j++)
        for (uint32_t i = 0; i < AROUND; i++) {
            const uint32_t a = j * (AROUND + 1) + i, b = a + 1, c = a + AROUND + 1, d = c + 1;
            if (j > 0) memcpy(triangle[n++], (const uint32_t[3]){a, b, c}, sizeof *triangle);
            if (j + 1 < DOWN) memcpy(triangle[n++], (const uint32_t[3]){b, d, c}, sizeof *triangle);
        }
    for (uint32_t t = 0; t < triangles; t++) material[t] = scene->mesh[quad].material[0];
    scene->mesh[quad] = (struct lw_mesh){.name = "ball",
                                         .vertex_count = vertices,
                                         .triangle_count = triangles,
                                         .position = position,
                                         .normal = normal,
                                         .triangle = triangle,
                                         .material = material};
}

void room_solve_at(struct room_solution *solution, struct lw_scene *scene, float texels_per_metre,
                   struct lw_solver_desc desc, double time_s, unsigned frames) {
    struct lw_error err = {0};
    prepare(solution, scene, texels_per_metre, &desc, time_s);
    lw_support_ok(lw_solvers_create(NULL, &desc, &solution->pose, &solution->solver, &err), &err);
    solve(solution, frames);
}

void room_solve_layers(struct room_solution *solution, struct lw_scene *scene, float texels_per_metre,
                       struct lw_solver_desc desc, const char *light_groups, unsigned frames) {
    struct lw_error err = {0};
    struct lw_light_groups groups;
    prepare(solution, scene, texels_per_metre, &desc, 0);
    lw_support_ok(lw_light_groups_init(&groups, scene, &solution->pose, light_groups, &err), &err);
    desc.light_groups = &groups;
    lw_support_ok(lw_solvers_create(NULL, &desc, &solution->pose, &solution->solver, &err), &err);
    lw_light_groups_finish(&groups);
    solve(solution, frames);
}

void room_solve_scene(struct room_solution *solution, struct lw_scene *scene, float texels_per_metre,
                      struct lw_solver_desc desc, unsigned frames) {
    room_solve_at(solution, scene, texels_per_metre, desc, 0, frames);
}

void room_solve(struct room_solution *solution, const struct room *room, struct lw_solver_desc desc,
                unsigned frames) {
    room_solve_scene(solution, room_scene(room), room->texels_per_metre, desc, frames);
}

void room_solve_by(struct room_solution *solution, const struct room *room, const char *solver,
                   struct lw_solver_desc desc, unsigned frames) {
    struct lw_error err = {0};
    prepare(solution, room_scene(room), room->texels_per_metre, &desc, 0);
    lw_support_ok(lw_solvers_create(solver, &desc, &solution->pose, &solution->solver, &err), &err);
    solve(solution, frames);
}

void room_frame(struct room_solution *solution, uint64_t frame) {
    struct lw_error err = {0};
    struct lw_solver *solver = solution->solver;
    lw_support_ok(solver->ops->frame(solver, &solution->pose, frame, &solution->stats, &err), &err);
}

unsigned room_solve_on(struct room_solution *solution, uint64_t *frame, unsigned frames) {
    const struct lw_solver_stats *stats = &solution->stats;
    unsigned tiles = 0;
    for (unsigned f = 0; f < frames; f++) {
        room_frame(solution, ++*frame);
        solution->rays += stats->rays_shadow + stats->rays_bounce + stats->rays_probe;
        tiles += stats->tiles_solved;
    }
    return tiles;
}

void room_solve_until_rest(struct room_solution *solution, uint64_t *frame) {
    for (unsigned quiet = 0, f = 0; quiet < 20; f++) {
        assert_true(f < 3000);
        room_frame(solution, ++*frame);
        quiet = solution->stats.tiles_solved ? 0 : quiet + 1;
    }
}

void room_finish(struct room_solution *solution) {
    solution->solver->ops->destroy(solution->solver);
    lw_pose_finish(&solution->pose);
    lw_atlas_map_finish(&solution->map);
    lw_scene_destroy(solution->scene);
}

/* The chart of a quad is a rectangle: how much of texel (x, y) it covers. */
static double covered_area(const struct lw_mesh *mesh, double x, double y) {
    double x0 = 1e9, x1 = -1e9, y0 = 1e9, y1 = -1e9;
    for (uint32_t v = 0; v < mesh->vertex_count; v++) {
        x0 = fmin(x0, (double)mesh->lightmap_uv[v].x);
        x1 = fmax(x1, (double)mesh->lightmap_uv[v].x);
        y0 = fmin(y0, (double)mesh->lightmap_uv[v].y);
        y1 = fmax(y1, (double)mesh->lightmap_uv[v].y);
    }
    if (mesh->back_offset && y >= mesh->back_offset) y -= mesh->back_offset;
    return fmax(0, fmin(x + 1, x1) - fmax(x, x0)) * fmax(0, fmin(y + 1, y1) - fmax(y, y0));
}

void room_each_texel(const struct room_solution *solution, uint32_t object, room_texel_fn *fn, void *user) {
    struct lw_error err = {0};
    struct lw_texels texels;
    lw_support_ok(lw_texels_init(&texels, solution->scene, 1, NULL, NULL, &err), &err);
    const struct lw_mesh_texels *mesh = &texels.mesh[solution->scene->object[object].mesh];
    const struct lw_atlas_level *level = &solution->map.atlas[object]->level[0];
    for (uint32_t t = 0; t < level->tiles_x * level->tiles_y; t++) {
        struct lw_solver_tile tile;
        solution->solver->ops->read_tile(solution->solver, (lw_tile_id){solution->map.first_tile[object] + t},
                                         &tile);
        uint32_t start = lw_texels_tile_start(mesh, t % level->tiles_x, t / level->tiles_x);
        for (uint32_t i = 0; i < tile.width * tile.height; i++) {
            if (!tile.covered[i]) continue;
            struct lw_vec3 p = lw_vec3(mesh->position[0][start + i], mesh->position[1][start + i],
                                       mesh->position[2][start + i]);
            double area = covered_area(&solution->scene->mesh[solution->scene->object[object].mesh],
                                       t % level->tiles_x * LW_TILE_SIDE + i % tile.width,
                                       t / level->tiles_x * LW_TILE_SIDE + i / tile.width);
            fn(user, lw_affine_point(&solution->pose.object_to_world[object], p), area,
               (double)tile.direct[0][i], (double)tile.indirect[0][i]);
        }
    }
    lw_texels_finish(&texels);
}

static void add_to_mean(void *user, struct lw_vec3 position_ws, double area, double direct, double indirect) {
    (void)position_ws;
    struct room_mean *mean = user;
    mean->direct += area * direct;
    mean->indirect += area * indirect;
    mean->texels += area;
}

uint32_t room_expect_same(const struct room_solution *a, const struct room_solution *b) {
    uint32_t compared = 0;
    assert_int_equal(a->map.tile_count, b->map.tile_count);
    for (uint32_t id = 0; id < a->map.tile_count; id++) {
        if (a->map.place[id].level) continue;
        struct lw_solver_tile x, y;
        a->solver->ops->read_tile(a->solver, (lw_tile_id){id}, &x);
        b->solver->ops->read_tile(b->solver, (lw_tile_id){id}, &y);
        const size_t bytes = (size_t)x.width * x.height * sizeof(float);
        for (int c = 0; c < 3; c++) {
            assert_memory_equal(x.direct[c], y.direct[c], bytes);
            assert_memory_equal(x.indirect[c], y.indirect[c], bytes);
            assert_memory_equal(x.shown[LW_TILE_CHANNEL_FULL][c], y.shown[LW_TILE_CHANNEL_FULL][c], bytes);
        }
        assert_memory_equal(&x.error, &y.error, sizeof x.error);
        assert_int_equal(x.solved_frame, y.solved_frame);
        compared++;
    }
    return compared;
}

struct room_mean room_object_mean(const struct room_solution *solution, uint32_t object) {
    struct room_mean mean = {0};
    room_each_texel(solution, object, add_to_mean, &mean);
    assert_true(mean.texels > 0);
    mean.direct /= mean.texels;
    mean.indirect /= mean.texels;
    mean.total = mean.direct + mean.indirect;
    return mean;
}

struct lw_vec3 room_texel(const struct room_solution *solution, uint32_t object, uint32_t x, uint32_t y) {
    const struct lw_atlas_level *level = &solution->map.atlas[object]->level[0];
    const uint32_t id =
        solution->map.first_tile[object] + y / LW_TILE_SIDE * level->tiles_x + x / LW_TILE_SIDE;
    struct lw_solver_tile tile;
    solution->solver->ops->read_tile(solution->solver, (lw_tile_id){id}, &tile);
    const uint32_t i = y % LW_TILE_SIDE * tile.width + x % LW_TILE_SIDE;
    return lw_vec3(tile.shown[LW_TILE_CHANNEL_FULL][0][i], tile.shown[LW_TILE_CHANNEL_FULL][1][i],
                   tile.shown[LW_TILE_CHANNEL_FULL][2][i]);
}

struct lw_vec3 room_look_up(const struct room_solution *solution, uint32_t quad, double along_u,
                            double along_v) {
    const struct lw_mesh *mesh = &solution->scene->mesh[quad];
    const struct lw_vec2 a = mesh->lightmap_uv[mesh->triangle[0][0]],
                         b = mesh->lightmap_uv[mesh->triangle[0][1]],
                         c = mesh->lightmap_uv[mesh->triangle[1][2]];
    const double x = (double)a.x + along_u * (double)(b.x - a.x) + along_v * (double)(c.x - a.x) - 0.5,
                 y = (double)a.y + along_u * (double)(b.y - a.y) + along_v * (double)(c.y - a.y) - 0.5;
    struct lw_vec3 sum = {0};
    for (uint32_t k = 0; k < 4; k++) {
        const uint32_t i = k & 1, j = k >> 1;
        const double wx = i ? x - floor(x) : 1 - (x - floor(x)), wy = j ? y - floor(y) : 1 - (y - floor(y));
        if (wx * wy > 0)
            sum = lw_vec3_mad(sum, room_texel(solution, quad, (uint32_t)floor(x) + i, (uint32_t)floor(y) + j),
                              (float)(wx * wy));
    }
    return sum;
}
