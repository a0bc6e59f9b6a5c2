#include "common/builtin/builtin_mesh.h"

#include "common/shading/tangent.h"

#include <stdlib.h>
#include <string.h>

/* A quad half is dropped below this area: shorter than a hair, and its normal would be noise. */
#define AREA_MIN_M2 1e-9f

void lw_builtin_mesh_init(struct lw_builtin_mesh *mesh) {
    *mesh = (struct lw_builtin_mesh){.placement = LW_AFFINE_IDENTITY, .uv_repeat = 1.0f, .crease_cos = 0.82f};
}

void lw_builtin_mesh_finish(struct lw_builtin_mesh *mesh) {
    free(mesh->position);
    free(mesh->normal);
    free(mesh->uv);
    free(mesh->triangle);
    free(mesh->triangle_material);
    memset(mesh, 0, sizeof *mesh);
}

void lw_builtin_mesh_use(struct lw_builtin_mesh *mesh, uint32_t material, enum lw_builtin_uv mode,
                         float metres) {
    mesh->material = material;
    mesh->uv_mode = mode;
    mesh->uv_repeat = 1.0f / metres;
    mesh->uv_offset = (struct lw_vec2){0, 0};
}

void lw_builtin_mesh_place(struct lw_builtin_mesh *mesh, struct lw_vec3 position, float angle,
                           struct lw_vec3 scale) {
    float c = cosf(angle), s = sinf(angle);
    mesh->placement = (struct lw_affine){{{c * scale.x, 0, s * scale.z, position.x},
                                          {0, scale.y, 0, position.y},
                                          {-s * scale.x, 0, c * scale.z, position.z}}};
}

static bool grow(struct lw_builtin_mesh *mesh, void *array_of_pointers[], const size_t sizes[],
                 unsigned arrays, uint32_t *capacity) {
    uint32_t wanted = *capacity ? *capacity * 2 : 1024;
    for (unsigned i = 0; i < arrays; i++) {
        void **array = array_of_pointers[i];
        void *grown = *capacity < LW_SCENE_TRIANGLES_MAX ? realloc(*array, wanted * sizes[i]) : NULL;
        if (!grown) {
            mesh->failed = true;
            return false;
        }
        *array = grown;
    }
    *capacity = wanted;
    return true;
}

uint32_t lw_builtin_mesh_vertex(struct lw_builtin_mesh *mesh, struct lw_vec3 position, struct lw_vec3 normal,
                                struct lw_vec2 uv) {
    if (mesh->failed) return 0;
    if (mesh->vertex_count == mesh->vertex_capacity) {
        void *arrays[] = {&mesh->position, &mesh->normal, &mesh->uv};
        const size_t sizes[] = {sizeof *mesh->position, sizeof *mesh->normal, sizeof *mesh->uv};
        if (!grow(mesh, arrays, sizes, 3, &mesh->vertex_capacity)) return 0;
    }
    uint32_t index = mesh->vertex_count++;
    mesh->position[index] = lw_affine_point(&mesh->placement, position);
    mesh->normal[index] = lw_affine_normal(&mesh->placement, normal);
    mesh->uv[index] = uv;
    return index;
}

void lw_builtin_mesh_triangle(struct lw_builtin_mesh *mesh, uint32_t a, uint32_t b, uint32_t c) {
    if (mesh->failed) return;
    if (mesh->triangle_count == mesh->triangle_capacity) {
        void *arrays[] = {&mesh->triangle, &mesh->triangle_material};
        const size_t sizes[] = {sizeof *mesh->triangle, sizeof *mesh->triangle_material};
        if (!grow(mesh, arrays, sizes, 2, &mesh->triangle_capacity)) return;
    }
    uint32_t *t = mesh->triangle[mesh->triangle_count];
    bool mirrored = lw_affine_determinant(&mesh->placement) < 0;
    t[0] = a;
    t[1] = mirrored ? c : b;
    t[2] = mirrored ? b : c;
    mesh->triangle_material[mesh->triangle_count++] = mesh->material;
}

/* With edges e and f, dp/du = (e fv - f ev) / (eu fv - ev fu). The divisor is negative where v runs down
 * beside u, as in pictures: there glTF's w is 1. */
void lw_builtin_mesh_tangents(const struct lw_builtin_mesh *mesh, uint16_t *out_tangent) {
    for (uint32_t t = 0; !mesh->failed && t < mesh->triangle_count; t++) {
        const uint32_t *corner = mesh->triangle[t];
        const struct lw_vec3 at = mesh->position[corner[0]];
        const struct lw_vec3 e = lw_vec3_sub(mesh->position[corner[1]], at),
                             f = lw_vec3_sub(mesh->position[corner[2]], at);
        const struct lw_vec2 *uv = mesh->uv, *from = &uv[corner[0]];
        const float eu = uv[corner[1]].x - from->x, ev = uv[corner[1]].y - from->y,
                    fu = uv[corner[2]].x - from->x, fv = uv[corner[2]].y - from->y;
        const bool mirrored = eu * fv - ev * fu > 0;
        const struct lw_vec3 tangent =
            lw_vec3_scale(lw_vec3_sub(lw_vec3_scale(e, fv), lw_vec3_scale(f, ev)), mirrored ? 1 : -1);
        for (int c = 0; c < 3; c++)
            *out_tangent++ = lw_tangent_encode(mesh->normal[corner[c]], tangent, mirrored);
    }
}

/* ---- patches ---- */

/** A patch while it is being turned into vertices. Quads are (rows - 1) x (columns - 1). */
struct patch {
    const struct lw_vec3 *points;
    uint32_t rows, columns;
    bool closed, flipped;
    struct lw_vec3 *face;      /* area-weighted normal per quad */
    float *along, *up;         /* metres from the first column, from the first row */
    bool *row_edge, *col_edge; /* whether a line of the grid is a crease */
    uint32_t *index;           /* 4 per quad: its vertices */
};

static struct lw_vec3 point_at(const struct patch *p, uint32_t row, uint32_t column) {
    return p->points[row * p->columns + column];
}

static struct lw_vec3 *face_at(const struct patch *p, uint32_t row, uint32_t column) {
    return &p->face[row * (p->columns - 1) + column];
}

static void measure(struct patch *p) {
    for (uint32_t r = 0; r + 1 < p->rows; r++)
        for (uint32_t c = 0; c + 1 < p->columns; c++) {
            struct lw_vec3 across = lw_vec3_sub(point_at(p, r + 1, c + 1), point_at(p, r, c));
            struct lw_vec3 back = lw_vec3_sub(point_at(p, r + 1, c), point_at(p, r, c + 1));
            *face_at(p, r, c) = lw_vec3_scale(lw_vec3_cross(across, back), p->flipped ? -0.5f : 0.5f);
        }
    /* the longest line rules, so that a texture is squeezed but never smeared */
    for (uint32_t c = 1; c < p->columns; c++) {
        float longest = 0;
        for (uint32_t r = 0; r < p->rows; r++)
            longest = fmaxf(longest, lw_vec3_length(lw_vec3_sub(point_at(p, r, c), point_at(p, r, c - 1))));
        p->along[c] = p->along[c - 1] + longest;
    }
    for (uint32_t r = 1; r < p->rows; r++) {
        float longest = 0;
        for (uint32_t c = 0; c < p->columns; c++)
            longest = fmaxf(longest, lw_vec3_length(lw_vec3_sub(point_at(p, r, c), point_at(p, r - 1, c))));
        p->up[r] = p->up[r - 1] + longest;
    }
}

static bool folds(struct lw_vec3 a, struct lw_vec3 b, float crease_cos) {
    float lengths = lw_vec3_length(a) * lw_vec3_length(b);
    return lengths > AREA_MIN_M2 * AREA_MIN_M2 && lw_vec3_dot(a, b) < crease_cos * lengths;
}

/* Whole lines are creases or not: it keeps patches rectangular, which keeps charts few. */
static void find_edges(struct patch *p, float crease_cos) {
    for (uint32_t r = 1; r + 1 < p->rows; r++)
        for (uint32_t c = 0; c + 1 < p->columns && !p->row_edge[r]; c++)
            p->row_edge[r] = folds(*face_at(p, r - 1, c), *face_at(p, r, c), crease_cos);
    for (uint32_t c = 1; c + 1 < p->columns; c++)
        for (uint32_t r = 0; r + 1 < p->rows && !p->col_edge[c]; r++)
            p->col_edge[c] = folds(*face_at(p, r, c - 1), *face_at(p, r, c), crease_cos);
    for (uint32_t r = 0; p->closed && r + 1 < p->rows && !p->col_edge[0]; r++)
        p->col_edge[0] = folds(*face_at(p, r, p->columns - 2), *face_at(p, r, 0), crease_cos);
}

/** Sum of the faces around a grid point that lie on the quad's side of every crease. */
static struct lw_vec3 smooth_normal(const struct patch *p, uint32_t row, uint32_t column, uint32_t quad_row,
                                    uint32_t quad_column) {
    struct lw_vec3 sum = *face_at(p, quad_row, quad_column);
    uint32_t quads = p->columns - 1;
    bool seam = p->closed && (column == 0 || column == quads);
    uint32_t other_row = row == quad_row ? row - 1 : row; /* wraps to a huge number at the rim */
    uint32_t other_column = column == quad_column ? column - 1 : column;
    if (seam) other_column = quad_column == 0 ? quads - 1 : 0;
    bool rows_join = other_row < p->rows - 1 && !p->row_edge[row];
    bool columns_join = other_column < quads && !p->col_edge[seam ? 0 : column];
    if (rows_join) sum = lw_vec3_add(sum, *face_at(p, other_row, quad_column));
    if (columns_join) sum = lw_vec3_add(sum, *face_at(p, quad_row, other_column));
    if (rows_join && columns_join) sum = lw_vec3_add(sum, *face_at(p, other_row, other_column));
    return lw_vec3_normalize(sum);
}

static struct lw_vec2 texture_point(const struct lw_builtin_mesh *mesh, const struct patch *p, uint32_t row,
                                    uint32_t column, struct lw_vec3 normal) {
    float unit = mesh->uv_mode == LW_BUILTIN_UV_FIT ? fmaxf(p->along[p->columns - 1], 1e-6f) : 1.0f;
    struct lw_vec2 m = {p->along[column] / unit, p->up[row] / unit};
    if (mesh->uv_mode == LW_BUILTIN_UV_SPACE) {
        struct lw_vec3 at = lw_affine_point(&mesh->placement, point_at(p, row, column));
        struct lw_vec3 n = lw_affine_normal(&mesh->placement, normal);
        float x = fabsf(n.x), y = fabsf(n.y), z = fabsf(n.z);
        if (y >= x && y >= z)
            m = (struct lw_vec2){at.x, at.z};
        else if (x >= z)
            m = (struct lw_vec2){at.z, -at.y};
        else
            m = (struct lw_vec2){at.x, -at.y};
    }
    return (struct lw_vec2){(m.x + mesh->uv_offset.x) * mesh->uv_repeat,
                            (m.y + mesh->uv_offset.y) * mesh->uv_repeat};
}

/* A vertex is shared by the quads around it that lie on the same side of every crease: each quad takes its
 * corner from the quad below or to the left if no crease is between them. */
static void index_quad(struct lw_builtin_mesh *mesh, struct patch *p, uint32_t r, uint32_t c) {
    uint32_t quads = p->columns - 1;
    uint32_t *own = &p->index[4 * (r * quads + c)]; /* corners: (r,c) (r,c+1) (r+1,c) (r+1,c+1) */
    bool below = r > 0 && !p->row_edge[r], left = c > 0 && !p->col_edge[c];
    const uint32_t *under = below ? own - 4 * quads : NULL, *before = left ? own - 4 : NULL;
    for (uint32_t corner = 0; corner < 4; corner++) {
        uint32_t dr = corner >> 1, dc = corner & 1;
        if (before && dc == 0)
            own[corner] = before[corner + 1];
        else if (under && dr == 0)
            own[corner] = under[corner + 2];
        else {
            struct lw_vec3 normal = smooth_normal(p, r + dr, c + dc, r, c);
            own[corner] = lw_builtin_mesh_vertex(mesh, point_at(p, r + dr, c + dc), normal,
                                                 texture_point(mesh, p, r + dr, c + dc, *face_at(p, r, c)));
        }
    }
}

static void emit(struct lw_builtin_mesh *mesh, const struct patch *p, uint32_t a, uint32_t b, uint32_t c) {
    if (mesh->failed) return;
    struct lw_vec3 n = lw_vec3_cross(lw_vec3_sub(mesh->position[b], mesh->position[a]),
                                     lw_vec3_sub(mesh->position[c], mesh->position[a]));
    if (lw_vec3_length(n) * 0.5f < AREA_MIN_M2) return;
    lw_builtin_mesh_triangle(mesh, a, p->flipped ? c : b, p->flipped ? b : c);
}

void lw_builtin_mesh_patch(struct lw_builtin_mesh *mesh, const struct lw_vec3 *points, uint32_t rows,
                           uint32_t columns, unsigned flags) {
    if (mesh->failed) return;
    size_t quads = (size_t)(rows - 1) * (columns - 1);
    struct patch p = {.points = points,
                      .rows = rows,
                      .columns = columns,
                      .closed = flags & LW_BUILTIN_CLOSED_COLUMNS,
                      .flipped = flags & LW_BUILTIN_FLIPPED};
    p.face = calloc(quads, sizeof *p.face);
    p.along = calloc((size_t)rows + columns, sizeof *p.along);
    p.row_edge = calloc((size_t)rows + columns, sizeof *p.row_edge);
    p.index = calloc(quads, 4 * sizeof *p.index);
    if (!p.face || !p.along || !p.row_edge || !p.index) {
        mesh->failed = true;
    } else {
        p.up = p.along + columns;
        p.col_edge = p.row_edge + rows;
        measure(&p);
        find_edges(&p, mesh->crease_cos);
        for (uint32_t r = 0; r + 1 < rows; r++)
            for (uint32_t c = 0; c + 1 < columns; c++) {
                index_quad(mesh, &p, r, c); /* for a hole too: no two adjoin, so its corners are all used */
                if ((flags & LW_BUILTIN_HOLES) && (r & c & 1)) continue;
                const uint32_t *i = &p.index[4 * (r * (columns - 1) + c)];
                emit(mesh, &p, i[0], i[1], i[3]);
                emit(mesh, &p, i[0], i[3], i[2]);
            }
    }
    free(p.index);
    free(p.row_edge);
    free(p.along);
    free(p.face);
}

/* ---- shapes ---- */

void lw_builtin_mesh_quad(struct lw_builtin_mesh *mesh, struct lw_vec3 corner, struct lw_vec3 right,
                          struct lw_vec3 up, float cell_m) {
    uint32_t columns = 2, rows = 2;
    if (cell_m > 0) {
        columns += (uint32_t)(lw_vec3_length(right) / cell_m);
        rows += (uint32_t)(lw_vec3_length(up) / cell_m);
    }
    struct lw_vec3 *points = malloc((size_t)rows * columns * sizeof *points);
    if (!points) {
        mesh->failed = true;
        return;
    }
    for (uint32_t r = 0; r < rows; r++)
        for (uint32_t c = 0; c < columns; c++)
            points[r * columns + c] = lw_vec3_mad(lw_vec3_mad(corner, right, (float)c / (float)(columns - 1)),
                                                  up, (float)r / (float)(rows - 1));
    lw_builtin_mesh_patch(mesh, points, rows, columns, 0);
    free(points);
}

void lw_builtin_mesh_box(struct lw_builtin_mesh *mesh, struct lw_vec3 low, struct lw_vec3 high,
                         unsigned faces) {
    float w = high.x - low.x, h = high.y - low.y, d = high.z - low.z;
    struct lw_vec3 x = lw_vec3(w, 0, 0), y = lw_vec3(0, h, 0), z = lw_vec3(0, 0, d);
    struct lw_vec3 minus_x = lw_vec3(-w, 0, 0), minus_z = lw_vec3(0, 0, -d);
    if (faces & LW_BUILTIN_LEFT) lw_builtin_mesh_quad(mesh, low, z, y, 0);
    if (faces & LW_BUILTIN_RIGHT) lw_builtin_mesh_quad(mesh, lw_vec3(high.x, low.y, high.z), minus_z, y, 0);
    if (faces & LW_BUILTIN_BOTTOM) lw_builtin_mesh_quad(mesh, low, x, z, 0);
    if (faces & LW_BUILTIN_TOP) lw_builtin_mesh_quad(mesh, lw_vec3(low.x, high.y, high.z), x, minus_z, 0);
    if (faces & LW_BUILTIN_BACK) lw_builtin_mesh_quad(mesh, lw_vec3(high.x, low.y, low.z), minus_x, y, 0);
    if (faces & LW_BUILTIN_FRONT) lw_builtin_mesh_quad(mesh, lw_vec3(low.x, low.y, high.z), x, y, 0);
}

void lw_builtin_mesh_revolve(struct lw_builtin_mesh *mesh, const struct lw_vec2 *profile, uint32_t count,
                             uint32_t segments) {
    uint32_t columns = segments + 1;
    struct lw_vec3 *points = malloc((size_t)count * columns * sizeof *points);
    if (!points) {
        mesh->failed = true;
        return;
    }
    for (uint32_t r = 0; r < count; r++)
        for (uint32_t c = 0; c < columns; c++) {
            /* the seam's two columns must agree to the bit, or smoothing would leave a crack */
            float angle = 2.0f * LW_PI * (float)(c % segments) / (float)segments;
            points[r * columns + c] =
                lw_vec3(profile[r].x * sinf(angle), profile[r].y, profile[r].x * cosf(angle));
        }
    lw_builtin_mesh_patch(mesh, points, count, columns, LW_BUILTIN_CLOSED_COLUMNS);
    free(points);
}

void lw_builtin_mesh_sweep(struct lw_builtin_mesh *mesh, const struct lw_vec2 *profile, uint32_t count,
                           const struct lw_builtin_frame *frames, uint32_t frame_count, unsigned flags) {
    struct lw_vec3 *points = malloc((size_t)count * frame_count * sizeof *points);
    if (!points) {
        mesh->failed = true;
        return;
    }
    for (uint32_t r = 0; r < count; r++)
        for (uint32_t c = 0; c < frame_count; c++)
            points[r * frame_count + c] = lw_vec3_mad(
                lw_vec3_mad(frames[c].origin, frames[c].out, profile[r].x), frames[c].up, profile[r].y);
    lw_builtin_mesh_patch(mesh, points, count, frame_count, flags);
    free(points);
}

void lw_builtin_mesh_frame(struct lw_builtin_mesh *mesh, const struct lw_vec2 *profile, uint32_t count,
                           float half_x, float half_z, float y, bool inward, float piece_m) {
    /* the corners, to the right seen from outside */
    static const float corner[5][2] = {{-1, 1}, {1, 1}, {1, -1}, {-1, -1}, {-1, 1}};
    float half[2] = {half_x, half_z};
    uint32_t pieces[2] = {1, 1}, n = 0; /* along X, along Z */
    for (int i = 0; i < 2 && piece_m > 0; i++) pieces[i] += (uint32_t)(2.0f * half[i] / piece_m);
    struct lw_builtin_frame *frames = malloc((2u * (pieces[0] + pieces[1]) + 1) * sizeof *frames);
    if (!frames) {
        mesh->failed = true;
        return;
    }
    for (int side = 0; side < 4; side++)
        for (uint32_t k = 0; k < pieces[side % 2] + (side == 3); k++) {
            float t = (float)k / (float)pieces[side % 2];
            float x = corner[side][0] + (corner[side + 1][0] - corner[side][0]) * t;
            float z = corner[side][1] + (corner[side + 1][1] - corner[side][1]) * t;
            /* along a side the mitre turns with the position, so that all lines of the grid stay straight */
            frames[n++] = (struct lw_builtin_frame){.origin = lw_vec3(x * half_x, y, z * half_z),
                                                    .out = lw_vec3(inward ? -x : x, 0, inward ? -z : z),
                                                    .up = lw_vec3(0, 1, 0)};
        }
    lw_builtin_mesh_sweep(mesh, profile, count, frames, n,
                          LW_BUILTIN_CLOSED_COLUMNS | (inward ? LW_BUILTIN_FLIPPED : 0u));
    free(frames);
}
