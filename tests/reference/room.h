/* room.h: scenes of squares with known answers, and their solution. */
#ifndef LW_TESTS_ROOM_H
#define LW_TESTS_ROOM_H

#include "server/solve/solvers.h"
#include "tests/support/support.h"

#include <math.h>

/** Fails unless |got - want| <= tolerance |want|, and says all three. */
static inline void expect_near(double got, double want, double tolerance) {
    if (!(fabs(got - want) <= tolerance * fabs(want)))
        fail_msg("got %.6g, expected %.6g within %.2g %% (off by %.2g %%)", got, want, 100 * tolerance,
                 100 * (got / want - 1));
}

#define ROOM_QUADS_MAX  48
#define ROOM_LIGHTS_MAX 128

/** A scene under construction: each quad is an object of its own with a material of its own, front by the
 * right hand from edge_u to edge_v. */
struct room {
    struct room_quad {
        struct lw_vec3 corner, edge_u, edge_v;
        float albedo, emission; /* grey; W/(m^2 sr) */
        bool double_sided;
        uint8_t alpha_mode; /* enum lw_alpha_mode */
        float alpha;        /* for BLEND and MASK (cut off under 0.5) */
        /* 0: a quad. Else the number of triangles of a disc: the edges are its radii, corner its centre */
        unsigned segments;
    } quad[ROOM_QUADS_MAX];
    struct lw_light light[ROOM_LIGHTS_MAX]; /* without a name: "light" */
    /* punctual lights shine along -Y where they have a direction */
    struct lw_vec3 light_position[ROOM_LIGHTS_MAX];
    uint32_t quad_count, light_count;
    float sky;
    struct lw_environment environment; /* its texels must outlive the solution */
    float texels_per_metre;
};

void room_quad(struct room *room, struct lw_vec3 corner, struct lw_vec3 edge_u, struct lw_vec3 edge_v,
               float albedo, float emission);
/** A disc about `centre`, with two perpendicular radii: front by the right hand from radius_u to radius_v. */
void room_disc(struct room *room, struct lw_vec3 centre, struct lw_vec3 radius_u, struct lw_vec3 radius_v,
               float albedo, float emission);
/** The six inner faces of a box from (0,0,0) to size. */
void room_box(struct room *room, struct lw_vec3 size, float albedo, float emission);
/** 2 x 2 x 3 m of albedo 0.6, under a square lamp of 0.6 m and 5 W/(m^2 sr). */
struct room room_lit_box(float texels_per_metre);
/** 4 x 2 x 2 m at 12 texels a metre: point lights "left" and "right", a double-sided plate (ROOM_PLATE)
 * over the floor, and a panel that glows (ROOM_PANEL) under the ceiling; after the six faces of
 * room_box(). */
struct room room_with_two_lamps(void);
enum { ROOM_FACES = 6, ROOM_PLATE = ROOM_FACES, ROOM_PANEL };

/** A room with everything that a solve needs. */
struct room_solution {
    struct lw_scene *scene;
    struct lw_atlas_map map;
    struct lw_pose pose;
    struct lw_solver *solver;
    struct lw_solver_stats stats; /* the last frame's */
    uint64_t rays;                /* of all frames */
};

/** Builds and solves `frames` frames; scene, map and pose of the desc are filled in. */
void room_solve(struct room_solution *solution, const struct room *room, struct lw_solver_desc desc,
                unsigned frames);
/** The scene alone, for changes that a room cannot say: quad i is mesh, material, object and node i; its UV
 * set 0 runs from (0, 0) at the corner to (1, 1). Light j hangs on node quad_count + j. */
struct lw_scene *room_scene(const struct room *room);
/** A smooth ball in place of a quad. It has seams. */
void room_make_ball(struct lw_scene *scene, uint32_t quad, struct lw_vec3 centre, float radius);
/** Solves a ready scene, which it takes, at a moment of its animation. */
void room_solve_at(struct room_solution *solution, struct lw_scene *scene, float texels_per_metre,
                   struct lw_solver_desc desc, double time_s, unsigned frames);
/** The same at time 0. */
void room_solve_scene(struct room_solution *solution, struct lw_scene *scene, float texels_per_metre,
                      struct lw_solver_desc desc, unsigned frames);
/** The same in layers, by light_groups.h. */
void room_solve_layers(struct room_solution *solution, struct lw_scene *scene, float texels_per_metre,
                       struct lw_solver_desc desc, const char *light_groups, unsigned frames);
/** A room by the solver of that name. */
void room_solve_by(struct room_solution *solution, const struct room *room, const char *solver,
                   struct lw_solver_desc desc, unsigned frames);
void room_finish(struct room_solution *solution);

/** Solves a frame of that number, the pose as it is now. */
void room_frame(struct room_solution *solution, uint64_t frame);
/** Solves on. *frame: the last one's number. Returns how many tiles the frames solved. */
unsigned room_solve_on(struct room_solution *solution, uint64_t *frame, unsigned frames);
/** Solves on, the pose as it is now, until nothing more is solved; fails if that takes too long. *frame: the
 * last one's number. */
void room_solve_until_rest(struct room_solution *solution, uint64_t *frame);

/** Ends the test unless the light of two solutions of one scene is the same, bit for bit. Returns how many
 * tiles that is. */
uint32_t room_expect_same(const struct room_solution *a, const struct room_solution *b);

/** Mean E over the surface of an object: red channel, direct and indirect. */
struct room_mean {
    double direct, indirect, total;
    double texels; /* covered, by area */
};
struct room_mean room_object_mean(const struct room_solution *solution, uint32_t object);

/** The shown light of a texel of level 0. */
struct lw_vec3 room_texel(const struct room_solution *solution, uint32_t object, uint32_t x, uint32_t y);
/** Light that an engine reads at a quad's front, bilinear, along its edges, each 0 to 1. */
struct lw_vec3 room_look_up(const struct room_solution *solution, uint32_t quad, double along_u,
                            double along_v);

/** Calls back for every covered texel of an object. position: world space; area: how much of the texel is
 * surface. */
typedef void room_texel_fn(void *user, struct lw_vec3 position_ws, double area, double direct,
                           double indirect);
void room_each_texel(const struct room_solution *solution, uint32_t object, room_texel_fn *fn, void *user);

#endif
