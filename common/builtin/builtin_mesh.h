/* builtin_mesh.h: a growing triangle mesh, for scenes that are computed instead of loaded. Everything is a
 * patch: a grid of points that becomes smooth quads, split where it bends sharply. Columns are patches closed
 * in one direction, mouldings are patches swept along frames.
 * Failure: the first allocation that fails sets `failed`; from then on every call does nothing. Ask once, at
 * the end.
 * Threads: one builder, one thread. */
#ifndef LW_COMMON_BUILTIN_MESH_H
#define LW_COMMON_BUILTIN_MESH_H

#include "common/scene/scene.h"

enum lw_builtin_uv {
    LW_BUILTIN_UV_SURFACE, /* metres along the patch's columns and rows */
    LW_BUILTIN_UV_FIT,     /* 0 to 1 over the columns, rows in proportion: one picture across */
    LW_BUILTIN_UV_SPACE    /* metres along two axes of object space, picked by the normal */
};

struct lw_builtin_mesh {
    /* state that the next part is built with; set freely */
    struct lw_affine placement; /* for the points given; may mirror, must not shear */
    uint32_t material;
    enum lw_builtin_uv uv_mode;
    struct lw_vec2 uv_offset; /* metres */
    float uv_repeat;          /* texture repeats per metre, or across a patch that is fitted */
    float crease_cos;         /* a fold whose normals' cosine is below this is an edge */

    bool failed;
    /* the mesh so far */
    struct lw_vec3 *position, *normal;
    struct lw_vec2 *uv;
    uint32_t (*triangle)[3];
    uint32_t *triangle_material;
    uint32_t vertex_count, vertex_capacity, triangle_count, triangle_capacity;
};

void lw_builtin_mesh_init(struct lw_builtin_mesh *mesh);
void lw_builtin_mesh_finish(struct lw_builtin_mesh *mesh);

/** Material of the next parts. metres: size of one repeat of the texture, or
 * of a patch with a fitted texture */
void lw_builtin_mesh_use(struct lw_builtin_mesh *mesh, uint32_t material, enum lw_builtin_uv mode,
                         float metres);

/** Places the next parts: scaled and turned by angle (radians) about +Y, then moved. Negative scale.x
 * mirrors. */
void lw_builtin_mesh_place(struct lw_builtin_mesh *mesh, struct lw_vec3 position, float angle,
                           struct lw_vec3 scale);

/** Tangents of all corners by their triangles' texture coordinates, 3 codes per triangle (tangent.h): a
 * normal map's x points where u grows, its y where v falls. */
void lw_builtin_mesh_tangents(const struct lw_builtin_mesh *mesh, uint16_t *out_tangent);

/** Adds one vertex, or one triangle counter-clockwise from its front. Only the placement is applied. */
uint32_t lw_builtin_mesh_vertex(struct lw_builtin_mesh *mesh, struct lw_vec3 position, struct lw_vec3 normal,
                                struct lw_vec2 uv);
void lw_builtin_mesh_triangle(struct lw_builtin_mesh *mesh, uint32_t a, uint32_t b, uint32_t c);

enum {
    LW_BUILTIN_CLOSED_COLUMNS = 1, /* the last column is the first again */
    LW_BUILTIN_FLIPPED = 2,        /* fronts face the other way */
    LW_BUILTIN_HOLES = 4           /* quads of odd row and odd column are left out */
};

/** Adds a grid of rows x columns points, points[row * columns + column]. Its front is where rows run up and
 * columns run to the right. Quads that collapse to a line are left out. Quads that collapse to a triangle are
 * triangles. */
void lw_builtin_mesh_patch(struct lw_builtin_mesh *mesh, const struct lw_vec3 *points, uint32_t rows,
                           uint32_t columns, unsigned flags);

/** Adds the parallelogram with corner `corner` and edges `right`, `up`; seen from the front they lie so.
 * It is cut into squares of about cell_m, or left whole with 0. */
void lw_builtin_mesh_quad(struct lw_builtin_mesh *mesh, struct lw_vec3 corner, struct lw_vec3 right,
                          struct lw_vec3 up, float cell_m);

/** Faces of a box that lw_builtin_mesh_box() builds. */
enum {
    LW_BUILTIN_LEFT = 1,
    LW_BUILTIN_RIGHT = 2,
    LW_BUILTIN_BOTTOM = 4,
    LW_BUILTIN_TOP = 8,
    LW_BUILTIN_BACK = 16,
    LW_BUILTIN_FRONT = 32, /* +Z */
    LW_BUILTIN_SIDES = 51,
    LW_BUILTIN_ALL = 63
};
void lw_builtin_mesh_box(struct lw_builtin_mesh *mesh, struct lw_vec3 low, struct lw_vec3 high,
                         unsigned faces);

/** Turns a profile about the Y axis. profile: (radius, height) in metres, from the bottom up for an outer
 * surface. */
void lw_builtin_mesh_revolve(struct lw_builtin_mesh *mesh, const struct lw_vec2 *profile, uint32_t count,
                             uint32_t segments);

/** Frame of a swept profile: point = origin + out * x + up * y. Longer vectors make mitres. */
struct lw_builtin_frame {
    struct lw_vec3 origin, out, up;
};

/** Sweeps a profile along frames; its front is outward where the profile runs up and the frames run to the
 * right, seen from `out`. */
void lw_builtin_mesh_sweep(struct lw_builtin_mesh *mesh, const struct lw_vec2 *profile, uint32_t count,
                           const struct lw_builtin_frame *frames, uint32_t frame_count, unsigned flags);

/** Sweeps a profile around a rectangle in the ground plane, |x| <= half_x and |z| <= half_z, at height y. The
 * profile's x grows away from the rectangle's middle, or towards it if `inward`. Sides are cut into pieces
 * of about piece_m, since a chart is made of whole triangles; 0 leaves them whole. */
void lw_builtin_mesh_frame(struct lw_builtin_mesh *mesh, const struct lw_vec2 *profile, uint32_t count,
                           float half_x, float half_z, float y, bool inward, float piece_m);

#endif
