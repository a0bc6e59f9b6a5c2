/* texels.h: where the light is computed: position, normals, albedo and sample points
 * of every texel of every atlas.
 * Flow:    scene with lightmap UVs -> [texels] -> passes
 *          hit -> [texels] -> index of the texel that was hit
 * Threads: built once; then [any].
 *
 * Texels lie tile by tile (level 0), row by row within a tile, so that a tile is one run of memory. Geometry
 * is kept once per mesh, in object space; each object has a run of its own in the global numbering. */
#ifndef LW_SURFACE_TEXELS_H
#define LW_SURFACE_TEXELS_H

#include "common/base/invariant.h"
#include "common/base/waiting.h"
#include "common/scene/scene.h"
#include "common/tile/atlas.h"
#include "server/solve/surface/packed_albedo.h"
#include "server/solve/surface/packed_normal.h"
#include "server/solve/surface/sample_points.h"

#define LW_TEXEL_NONE UINT32_MAX

/** What stands on a texel or beside it. */
enum lw_texels_walls {
    LW_TEXELS_WALL_RIGHT = 1, /* between it and the texel to its right */
    LW_TEXELS_WALL_BELOW = 2, /* between it and the one below */
    LW_TEXELS_WALL_ON = 4,    /* on it: light reaches none of its points */
    LW_TEXELS_WALL_NEAR = 8   /* its square may lie on several sides */
};

/** The lightmap coordinates of one triangle, in quarter texels; 16 bytes, one load per hit. */
struct lw_triangle_uv {
    uint16_t u[3], v[3];
    uint16_t double_sided, unused;
};

/** Texels of one mesh; arrays of texel_count. */
struct lw_mesh_texels {
    uint32_t width, height, texel_count;
    float texel_m;      /* side of a texel, object space, m: the mean over the mesh */
    float *position[3]; /* object space, m; on the surface */
    /* Normals in object space (packed_normal.h): the shading normal, and the triangle's on the side that this
     * texel lights. */
    uint32_t *normal, *geometric;
    struct lw_packed_albedo *albedo; /* mean over the texel; a gutter has that of the texel it copies */
    uint8_t *covered;                /* 1: the texel's square overlaps a triangle */
    /* The chart that covers the texel, or else reads it in bilinear look-ups; LW_TEXEL_NONE: none. */
    uint32_t *chart;
    struct lw_sample_points sample_points; /* where on the texel its rays start */
    struct lw_triangle_uv *triangle;
    uint32_t back_offset;
};

struct lw_texels {
    const struct lw_scene *scene;
    struct lw_mesh_texels *mesh; /* per mesh */
    float (*base_colour)[3];     /* per material: the factor that is in albedo */
    uint32_t *first;             /* per object: its first texel in the global numbering */
    uint32_t count;              /* texels in the global numbering, all objects */
    uint32_t capacity;           /* texels in the arrays per texel: fine tiles lie behind all objects */
    /* Per texel of the global numbering: has surface, light can reach it (invalid_texels.h), and it does not
     * yield to its neighbours (crossings.h). */
    uint8_t *covered;
    /* Per texel of the global numbering: mask of its sample points that light can reach. */
    uint8_t *usable;
    uint8_t *filled; /* per texel of the global numbering: 1: not covered, but another texel stands for it */
    /* Per texel of the global numbering: which part of its object it is on, of those that walls and the
     * borders of charts make (crossings.h). Light is not shared between texels of different sides. */
    uint32_t *side;
    uint8_t *walls; /* per texel of the global numbering: enum lw_texels_walls */
    /* Per texel: the covered one that stands for it: itself, the nearest within 2 texels,
     * first of its chart, or NONE. */
    uint32_t *source;
    /* Per object: it hides points and parts texels (standing.h). Not the texels' own; NULL until they are
     * asked about (invalid_texels.h). */
    const bool *stands;
    uint32_t *changes; /* per object: how often its covered texels or their sides have changed */
};

/** Rasterises every mesh that an object uses.
 * cancel   may be NULL; once true, it ends within a mesh
 * waiting  may be NULL; hears of the progress.
 * Errors: LW_NO_MEMORY; LW_BAD_DATA for more than 2^30 texels in all; LW_CLOSED, with *err as it was:
 * cancelled. */
LW_MUST_CHECK enum lw_status lw_texels_init(struct lw_texels *texels, const struct lw_scene *scene,
                                            unsigned threads, const _Atomic bool *cancel,
                                            struct lw_waiting *waiting, struct lw_error *err);
void lw_texels_finish(struct lw_texels *texels);

/** Makes room for the texels of fine tiles (fine_texels.h), which are not covered yet. Arrays move: nothing
 * may point at them. Errors: LW_NO_MEMORY; finish the texels then. */
LW_MUST_CHECK enum lw_status lw_texels_reserve(struct lw_texels *texels, uint32_t more);

/** Rasterises part of a mesh: coordinates, atlas size and back_offset of `mesh` are those of the part, and
 * triangles may reach beyond it. texels: width to back_offset are set. There is no list of triangles.
 * Returns false without memory. lw_texels_finish_mesh() frees it in any case. */
LW_MUST_CHECK bool lw_texels_rasterise(struct lw_mesh_texels *texels, const struct lw_scene *scene,
                                       const struct lw_mesh *mesh, bool has_albedo);
void lw_texels_finish_mesh(struct lw_mesh_texels *mesh);

/** Bytes held. */
size_t lw_texels_memory_bytes(const struct lw_texels *texels);

/** Takes over the albedo of meshes of which a material has changed its base colour: rasterises them
 * again, at the price of their share of lw_texels_init(). Errors: LW_NO_MEMORY; some meshes may then
 * have their new albedo already. */
LW_MUST_CHECK enum lw_status lw_texels_set_albedo(struct lw_texels *texels, int threads);

/** Forgets all walls of an object: each of its charts is one side. */
void lw_texels_forget_walls(struct lw_texels *texels, uint32_t object);

/** Where a covered texel's light comes from, object space: the middle of its usable points, for its own
 * position may lie beyond what cuts it. local: within the object */
struct lw_vec3 lw_texels_place(const struct lw_texels *texels, uint32_t object, uint32_t local);

/** Sets source and filled of every texel from covered. */
void lw_texels_link(struct lw_texels *texels, int threads);
/** The same for one object. */
void lw_texels_link_object(struct lw_texels *texels, uint32_t object);
/** The same for one of its blocks of level 0. x, y: its first texel */
void lw_texels_link_block(struct lw_texels *texels, uint32_t object, uint32_t x, uint32_t y);

/** How many tiles, and blocks, that many texels of a row are. */
static inline uint32_t lw_texels_tiles_along(uint32_t texels) {
    return (texels + LW_TILE_SIDE - 1) / LW_TILE_SIDE;
}
static inline uint32_t lw_texels_blocks_along(uint32_t texels) {
    return (texels + LW_TILE_BLOCK - 1) / LW_TILE_BLOCK;
}

/** A covered texel near a gutter. */
struct lw_texels_neighbour {
    uint32_t x, y;
    /* The larger of the columns and rows between them: 1 or 2. */
    uint32_t reach;
    /* Square of the distance, texels. */
    uint32_t distance2;
};
#define LW_TEXELS_NEIGHBOURS_MAX 24u

/** The covered texels that a gutter at (x, y) takes its light from: at most two columns and
 * rows away, of its own chart, or of any where that has none there. Row by row. covered: that
 * of one object. Returns how many. */
uint32_t lw_texels_neighbours(const struct lw_mesh_texels *mesh, const uint8_t *covered, uint32_t x,
                              uint32_t y, struct lw_texels_neighbour out[LW_TEXELS_NEIGHBOURS_MAX]);

/** One texel's entry of a planar array of vectors. */
static inline struct lw_vec3 lw_texels_vector(float *const plane[3], uint32_t i) {
    return lw_vec3(plane[0][i], plane[1][i], plane[2][i]);
}

/** First texel of a level-0 tile within its mesh. */
static inline uint32_t lw_texels_tile_start(const struct lw_mesh_texels *mesh, uint32_t tile_x,
                                            uint32_t tile_y) {
    uint32_t rows = mesh->height - tile_y * LW_TILE_SIDE;
    if (rows > LW_TILE_SIDE) rows = LW_TILE_SIDE;
    return tile_y * LW_TILE_SIDE * mesh->width + tile_x * LW_TILE_SIDE * rows;
}

/** Index within the mesh of texel (x, y), both inside the atlas. */
static inline uint32_t lw_texels_index(const struct lw_mesh_texels *mesh, uint32_t x, uint32_t y) {
    LW_INVARIANT_DEAR(x < mesh->width && y < mesh->height);
    uint32_t tile_x = x / LW_TILE_SIDE, tile_y = y / LW_TILE_SIDE,
             columns = mesh->width - tile_x * LW_TILE_SIDE;
    if (columns > LW_TILE_SIDE) columns = LW_TILE_SIDE;
    return lw_texels_tile_start(mesh, tile_x, tile_y) + (y % LW_TILE_SIDE) * columns + x % LW_TILE_SIDE;
}

/** Where a texel of a mesh lies in its atlas. */
static inline void lw_texels_coordinates(const struct lw_mesh_texels *mesh, uint32_t index, uint32_t *out_x,
                                         uint32_t *out_y) {
    LW_INVARIANT_DEAR(index < mesh->texel_count);
    const uint32_t tile_y = index / (LW_TILE_SIDE * mesh->width);
    uint32_t rows = mesh->height - tile_y * LW_TILE_SIDE;
    if (rows > LW_TILE_SIDE) rows = LW_TILE_SIDE;
    const uint32_t within = index - tile_y * LW_TILE_SIDE * mesh->width,
                   tile_x = within / (rows * LW_TILE_SIDE);
    uint32_t columns = mesh->width - tile_x * LW_TILE_SIDE;
    if (columns > LW_TILE_SIDE) columns = LW_TILE_SIDE;
    const uint32_t in_tile = within - tile_x * LW_TILE_SIDE * rows;
    *out_x = tile_x * LW_TILE_SIDE + in_tile % columns;
    *out_y = tile_y * LW_TILE_SIDE + in_tile / columns;
}

/** Where a triangle of an object lies in the lightmap. */
static inline const struct lw_triangle_uv *lw_texels_triangle(const struct lw_texels *texels, uint32_t object,
                                                              uint32_t triangle) {
    return &texels->mesh[texels->scene->object[object].mesh].triangle[triangle];
}

/** The texel (global index) whose square a hit lies in, or NONE: the back of a single-sided surface. Its
 * source is the one to read. u, v: barycentrics of the triangle's 2nd and 3rd vertex. */
static inline uint32_t lw_texels_under(const struct lw_texels *texels, uint32_t object, uint32_t triangle,
                                       float u, float v, bool back) {
    const struct lw_mesh_texels *mesh = &texels->mesh[texels->scene->object[object].mesh];
    const struct lw_triangle_uv *t = lw_texels_triangle(texels, object, triangle);
    if (back && !t->double_sided) return LW_TEXEL_NONE;
    float w = 1.0f - u - v;
    uint32_t x = (uint32_t)(0.25f * (w * t->u[0] + u * t->u[1] + v * t->u[2]));
    uint32_t y =
        (uint32_t)(0.25f * (w * t->v[0] + u * t->v[1] + v * t->v[2])) + (back ? mesh->back_offset : 0);
    if (x >= mesh->width) x = mesh->width - 1;
    if (y >= mesh->height) y = mesh->height - 1;
    return texels->first[object] + lw_texels_index(mesh, x, y);
}

/** The texel (global index) to read for a hit, or NONE: nothing to read there, or a back as above. */
static inline uint32_t lw_texels_at(const struct lw_texels *texels, uint32_t object, uint32_t triangle,
                                    float u, float v, bool back) {
    const uint32_t texel = lw_texels_under(texels, object, triangle, u, v, back);
    return texel == LW_TEXEL_NONE ? LW_TEXEL_NONE : texels->source[texel];
}

#endif
