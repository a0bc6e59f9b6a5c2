#include "server/solve/surface/fine_texels.h"

#include "common/base/invariant.h"
#include "server/solve/surface/crossings.h"
#include "server/solve/surface/searched_tiles.h"

#include <stdlib.h>
#include <string.h>

/* Texels around a tile that are placed with it: what crossings and gutters look at. */
#define MARGIN 4u
/* Texels of level 0 along the side of a cell, for which triangles are listed. */
#define CELL 16u
/* Results of searches that are kept: some 0.5 kB each. */
#define SEARCHED_MAX       4096u
#define SEARCHED_BYTES_MAX (4u << 20)

/* The triangles of a mesh by the cell of its atlas that they touch, those of their backs too. Entries are
 * 2 * triangle + (1 for its back). */
struct cells {
    uint32_t columns, rows;
    uint32_t *first; /* per cell and one more; NULL: not listed */
    uint32_t *entry;
};

struct lw_fine_texels_maker {
    const struct lw_texels *texels;
    struct cells *cells; /* per mesh */
    uint32_t *zero;      /* per object: texels of a window begin at 0 */
    bool has_albedo;
    struct lw_searched_tiles *searched; /* NULL: nothing is remembered */
};

enum lw_status lw_fine_texels_maker_create(const struct lw_texels *texels, bool has_albedo,
                                           struct lw_fine_texels_maker **out_maker) {
    struct lw_fine_texels_maker *maker = calloc(1, sizeof *maker);
    if (!maker) return LW_NO_MEMORY;
    maker->texels = texels;
    maker->has_albedo = has_albedo;
    maker->cells = calloc(texels->scene->mesh_count + 1ul, sizeof *maker->cells);
    maker->zero = calloc(texels->scene->object_count + 1ul, sizeof *maker->zero);
    if (!maker->cells || !maker->zero ||
        (!has_albedo &&
         lw_searched_tiles_create(SEARCHED_MAX, SEARCHED_BYTES_MAX, &maker->searched) != LW_OK)) {
        lw_fine_texels_maker_destroy(maker);
        return LW_NO_MEMORY;
    }
    *out_maker = maker;
    return LW_OK;
}

void lw_fine_texels_maker_destroy(struct lw_fine_texels_maker *maker) {
    if (!maker) return;
    for (uint32_t m = 0; maker->cells && m < maker->texels->scene->mesh_count; m++) {
        free(maker->cells[m].first);
        free(maker->cells[m].entry);
    }
    free(maker->cells);
    free(maker->zero);
    lw_searched_tiles_destroy(maker->searched);
    free(maker);
}

size_t lw_fine_texels_maker_memory_bytes(const struct lw_fine_texels_maker *maker) {
    const struct lw_scene *scene = maker->texels->scene;
    size_t bytes = scene->mesh_count * sizeof *maker->cells + scene->object_count * sizeof *maker->zero +
                   lw_searched_tiles_memory_bytes(maker->searched);
    for (uint32_t m = 0; m < scene->mesh_count; m++) {
        const struct cells *cells = &maker->cells[m];
        const size_t count = (size_t)cells->columns * cells->rows;
        if (cells->first) bytes += (count + 1 + cells->first[count]) * sizeof *cells->first;
    }
    return bytes;
}

/* ---- which triangles lie where ---- */

struct span {
    uint32_t x0, y0, x1, y1; /* cells, the last ones included */
};

static uint32_t cell_at(float texel, uint32_t count) {
    const float cell = texel / CELL;
    return cell <= 0 ? 0 : cell >= (float)(count - 1) ? count - 1 : (uint32_t)cell;
}

static struct span span_of(const struct cells *cells, const struct lw_mesh *mesh, uint32_t triangle,
                           bool back) {
    struct lw_vec2 low = {INFINITY, INFINITY}, high = {-INFINITY, -INFINITY};
    for (int k = 0; k < 3; k++) {
        const struct lw_vec2 uv = mesh->lightmap_uv[mesh->triangle[triangle][k]];
        const float y = uv.y + (back ? (float)mesh->back_offset : 0);
        low = (struct lw_vec2){fminf(low.x, uv.x), fminf(low.y, y)};
        high = (struct lw_vec2){fmaxf(high.x, uv.x), fmaxf(high.y, y)};
    }
    /* look-ups read a texel beyond covered ones */
    return (struct span){cell_at(low.x - 1, cells->columns), cell_at(low.y - 1, cells->rows),
                         cell_at(high.x + 1, cells->columns), cell_at(high.y + 1, cells->rows)};
}

/* Counts the entries of cells, or writes them to where first[cell] points, and moves that on. */
static void list_entries(struct cells *cells, const struct lw_scene *scene, const struct lw_mesh *mesh,
                         bool write) {
    for (uint32_t t = 0; t < mesh->triangle_count; t++) {
        const bool has_back = mesh->back_offset && scene->material[mesh->material[t]].double_sided;
        for (uint32_t back = 0; back <= (has_back ? 1u : 0u); back++) {
            const struct span span = span_of(cells, mesh, t, back);
            for (uint32_t y = span.y0; y <= span.y1; y++)
                for (uint32_t x = span.x0; x <= span.x1; x++) {
                    uint32_t *first = &cells->first[y * cells->columns + x];
                    if (write)
                        cells->entry[(*first)++] = 2 * t + back;
                    else
                        first[1]++;
                }
        }
    }
}

enum lw_status lw_fine_texels_prepare(struct lw_fine_texels_maker *maker, uint32_t object) {
    const struct lw_scene *scene = maker->texels->scene;
    const uint32_t m = scene->object[object].mesh;
    const struct lw_mesh *mesh = &scene->mesh[m];
    if (maker->cells[m].first) return LW_OK;
    struct cells cells = {.columns = (mesh->atlas_width + CELL - 1) / CELL,
                          .rows = (mesh->atlas_height + CELL - 1) / CELL};
    const size_t count = (size_t)cells.columns * cells.rows;
    if (!(cells.first = calloc(count + 2, sizeof *cells.first))) return LW_NO_MEMORY;
    list_entries(&cells, scene, mesh, false);
    for (size_t i = 1; i <= count; i++) cells.first[i] += cells.first[i - 1];
    if (!(cells.entry = malloc((cells.first[count] + 1ul) * sizeof *cells.entry))) {
        free(cells.first);
        return LW_NO_MEMORY;
    }
    list_entries(&cells, scene, mesh, true);
    /* each first is where the next began */
    memmove(cells.first + 1, cells.first, count * sizeof *cells.first);
    cells.first[0] = 0;
    maker->cells[m] = cells;
    return LW_OK;
}

/* ---- a window: the tile and what lies around it ---- */

struct window {
    uint32_t object, finer;
    uint32_t x, y, width, height;   /* in texels of the finer level; (x, y): its first texel */
    uint32_t inner_x, inner_y;      /* the tile's first texel, within the window */
    struct lw_mesh mesh;            /* the triangles that lie there, in its coordinates */
    void *storage[6];               /* the mesh's arrays */
    struct lw_mesh_texels texels;   /* the mesh's */
    struct lw_mesh_texels *of_mesh; /* per mesh of the scene: where lw_texels has them */
    uint8_t *covered, *usable, *filled, *walls;
    uint32_t *side, *source;
};

static int compare_words(const void *left, const void *right) {
    const uint32_t a = *(const uint32_t *)left, b = *(const uint32_t *)right;
    return a < b ? -1 : a > b;
}

/* Sorts, and leaves each once. Returns how many are left. */
static uint32_t sort_once(uint32_t *word, uint32_t count) {
    uint32_t kept = 0;
    qsort(word, count, sizeof *word, compare_words);
    for (uint32_t i = 0; i < count; i++)
        if (!kept || word[kept - 1] != word[i]) word[kept++] = word[i];
    return kept;
}

static uint32_t rank_of(const uint32_t *sorted, uint32_t count, uint32_t word) {
    const uint32_t *at = bsearch(&word, sorted, count, sizeof *sorted, compare_words);
    LW_INVARIANT(at);
    return (uint32_t)(at - sorted);
}

static uint32_t smaller(uint32_t a, uint32_t b) { return a < b ? a : b; }

/* Triangles that touch a window, each once. malloc'ed; NULL: no memory. */
static uint32_t *list_triangles(const struct cells *cells, const struct window *w, uint32_t *out_count) {
    const uint32_t shift = w->finer, x0 = (w->x >> shift) / CELL, y0 = (w->y >> shift) / CELL,
                   x1 = smaller(((w->x + w->width - 1) >> shift) / CELL, cells->columns - 1),
                   y1 = smaller(((w->y + w->height - 1) >> shift) / CELL, cells->rows - 1);
    uint32_t count = 0;
    for (uint32_t y = y0; y <= y1; y++)
        for (uint32_t x = x0; x <= x1; x++) {
            const uint32_t *first = &cells->first[y * cells->columns + x];
            count += first[1] - first[0];
        }
    uint32_t *list = malloc((count + 1ul) * sizeof *list);
    if (!list) return NULL;
    count = 0;
    for (uint32_t y = y0; y <= y1; y++)
        for (uint32_t x = x0; x <= x1; x++) {
            const uint32_t *first = &cells->first[y * cells->columns + x];
            for (uint32_t i = first[0]; i < first[1]; i++) list[count++] = cells->entry[i] / 2;
        }
    *out_count = sort_once(list, count);
    return list;
}

static void *copy_rows(const void *from, size_t size, const uint32_t *row, uint32_t count) {
    char *to = malloc(count * size + 1);
    for (uint32_t i = 0; i < count && to; i++)
        memcpy(to + i * size, (const char *)from + row[i] * size, size);
    return to;
}

/* Copies the vertices of a mesh's listed triangles, with lightmap coordinates of the window. */
static bool copy_vertices(struct window *w, const struct lw_mesh *mesh, const uint32_t *vertex,
                          uint32_t count) {
    struct lw_vec2 *uv = NULL;
    bool ok = (w->storage[0] = copy_rows(mesh->position, sizeof *mesh->position, vertex, count)) != NULL;
    ok &= (w->storage[1] = copy_rows(mesh->normal, sizeof *mesh->normal, vertex, count)) != NULL;
    for (int k = 0; k < 2; k++)
        if (mesh->uv[k])
            ok &= (w->storage[2 + k] = copy_rows(mesh->uv[k], sizeof *mesh->uv[k], vertex, count)) != NULL;
    if (mesh->colour)
        ok &= (w->storage[4] = copy_rows(mesh->colour, sizeof *mesh->colour, vertex, count)) != NULL;
    ok &= (w->storage[5] = uv = copy_rows(mesh->lightmap_uv, sizeof *uv, vertex, count)) != NULL;
    if (!ok) return false;
    const float scale = ldexpf(1, (int)w->finer);
    for (uint32_t i = 0; i < count; i++)
        uv[i] = (struct lw_vec2){uv[i].x * scale - (float)w->x, uv[i].y * scale - (float)w->y};
    w->mesh.vertex_count = count;
    w->mesh.position = w->storage[0];
    w->mesh.normal = w->storage[1];
    w->mesh.uv[0] = w->storage[2];
    w->mesh.uv[1] = w->storage[3];
    w->mesh.colour = w->storage[4];
    w->mesh.lightmap_uv = uv;
    return true;
}

static bool copy_triangles(struct window *w, const struct lw_mesh *mesh, const uint32_t *list, uint32_t count,
                           uint32_t (*triangle)[3], uint32_t *material, uint32_t *vertex) {
    for (uint32_t i = 0; i < count; i++) {
        memcpy(triangle[i], mesh->triangle[list[i]], sizeof *triangle);
        memcpy(vertex + 3 * i, triangle[i], sizeof *triangle);
        material[i] = mesh->material[list[i]];
    }
    const uint32_t vertices = sort_once(vertex, 3 * count);
    for (uint32_t i = 0; i < count; i++)
        for (int k = 0; k < 3; k++) triangle[i][k] = rank_of(vertex, vertices, triangle[i][k]);
    w->mesh.triangle_count = count;
    w->mesh.triangle = triangle;
    w->mesh.material = material;
    w->mesh.atlas_width = w->width;
    w->mesh.atlas_height = w->height;
    w->mesh.back_offset = mesh->back_offset << w->finer;
    return copy_vertices(w, mesh, vertex, vertices);
}

static bool rasterise(struct window *w, const struct lw_fine_texels_maker *maker) {
    const struct lw_scene *scene = maker->texels->scene;
    const uint32_t m = scene->object[w->object].mesh;
    uint32_t count = 0, *list = list_triangles(&maker->cells[m], w, &count);
    uint32_t(*triangle)[3] = malloc((count + 1ul) * sizeof *triangle),
    *material = malloc((count + 1ul) * sizeof *material),
    *vertex = malloc((3 * (size_t)count + 1) * sizeof *vertex);
    w->texels = (struct lw_mesh_texels){.width = w->width,
                                        .height = w->height,
                                        .texel_count = w->width * w->height,
                                        .back_offset = scene->mesh[m].back_offset << w->finer};
    const bool ok = list && triangle && material && vertex &&
                    copy_triangles(w, &scene->mesh[m], list, count, triangle, material, vertex) &&
                    lw_texels_rasterise(&w->texels, scene, &w->mesh, maker->has_albedo);
    for (size_t i = 0; i < sizeof w->storage / sizeof *w->storage; i++) free(w->storage[i]);
    free(list);
    free(triangle);
    free(material);
    free(vertex);
    if (ok && !(w->texels.texel_m > 0)) /* no triangle reaches it */
        w->texels.texel_m = ldexpf(maker->texels->mesh[m].texel_m, -(int)w->finer);
    return ok;
}

static bool window_allocate(struct window *w, uint32_t meshes) {
    const size_t count = (size_t)w->width * w->height + 1;
    w->of_mesh = calloc(meshes + 1ul, sizeof *w->of_mesh);
    w->covered = calloc(count, 1);
    w->usable = calloc(count, 1);
    w->filled = calloc(count, 1);
    w->walls = calloc(count, 1);
    w->side = calloc(count, sizeof *w->side);
    w->source = calloc(count, sizeof *w->source);
    return w->of_mesh && w->covered && w->usable && w->filled && w->walls && w->side && w->source;
}

static void window_finish(struct window *w) {
    lw_texels_finish_mesh(&w->texels);
    free(w->of_mesh);
    free(w->covered);
    free(w->usable);
    free(w->filled);
    free(w->walls);
    free(w->side);
    free(w->source);
}

/* The window as texels of a scene in which its object has no others. */
static struct lw_texels as_texels(const struct window *w, const struct lw_fine_texels_maker *maker) {
    struct lw_texels texels = *maker->texels;
    texels.mesh = w->of_mesh;
    texels.first = maker->zero;
    texels.count = texels.capacity = w->texels.texel_count;
    texels.covered = w->covered;
    texels.usable = w->usable;
    texels.filled = w->filled;
    texels.walls = w->walls;
    texels.side = w->side;
    texels.source = w->source;
    return texels;
}

/* ---- hidden points and walls ---- */

/* Whether light may not reach all of a texel of level 0, or a wall stands by it. */
static bool is_doubtful(const struct lw_texels *texels, uint32_t object, int64_t x, int64_t y) {
    const struct lw_mesh_texels *mesh = &texels->mesh[texels->scene->object[object].mesh];
    if (x < 0 || y < 0 || x >= mesh->width || y >= mesh->height) return false;
    const uint32_t local = lw_texels_index(mesh, (uint32_t)x, (uint32_t)y),
                   texel = texels->first[object] + local;
    if (!mesh->covered[local]) return false;
    return !texels->covered[texel] || texels->walls[texel] ||
           texels->usable[texel] != lw_sample_points_all(&mesh->sample_points, local);
}

static bool is_near_doubtful(const struct lw_texels *texels, const struct window *w, uint32_t x, uint32_t y) {
    const int64_t u = (w->x + x) >> w->finer, v = (w->y + y) >> w->finer;
    for (int64_t j = v - 1; j <= v + 1; j++)
        for (int64_t i = u - 1; i <= u + 1; i++)
            if (is_doubtful(texels, w->object, i, j)) return true;
    return false;
}

/* Lists the texels to search, and the blocks that hold some. Returns how many. */
static uint32_t list_doubtful(const struct lw_texels *texels, const struct window *w, uint32_t *out_texel,
                              bool *out_block) {
    uint32_t count = 0;
    for (uint32_t y = 0; y < w->height; y++)
        for (uint32_t x = 0; x < w->width; x++) {
            const uint32_t i = lw_texels_index(&w->texels, x, y);
            if (!w->covered[i] || !is_near_doubtful(texels, w, x, y)) continue;
            out_texel[count++] = i;
            out_block[y / LW_TILE_BLOCK * lw_texels_blocks_along(w->width) + x / LW_TILE_BLOCK] = true;
        }
    return count;
}

static void find_hidden(const struct lw_hidden_points_search *search, const struct window *w,
                        const uint32_t *texel, uint32_t count) {
    uint8_t left[LW_HIDDEN_POINTS_TEXELS];
    for (uint32_t first = 0, n; first < count; first += n) {
        n = smaller(count - first, LW_HIDDEN_POINTS_TEXELS);
        for (uint32_t k = 0; k < n; k++) left[k] = w->usable[texel[first + k]];
        lw_hidden_points_find(search, w->object, texel + first, n, left);
        for (uint32_t k = 0; k < n; k++) {
            w->usable[texel[first + k]] = left[k];
            if (!left[k]) w->covered[texel[first + k]] = 0;
        }
    }
}

static enum lw_status search(const struct lw_fine_texels_maker *maker, struct window *w,
                             const struct lw_hidden_points_search *points, bool *out_any) {
    struct lw_texels texels = as_texels(w, maker);
    const uint32_t blocks = lw_texels_blocks_along(w->width) * lw_texels_blocks_along(w->height);
    uint32_t *texel = malloc((w->texels.texel_count + 1ul) * sizeof *texel);
    bool *block = calloc(blocks + 1ul, sizeof *block);
    enum lw_status status = texel && block ? LW_OK : LW_NO_MEMORY;
    const uint32_t count = status == LW_OK ? list_doubtful(maker->texels, w, texel, block) : 0;
    *out_any = count > 0;
    if (count) {
        struct lw_hidden_points_search hidden = *points;
        uint64_t yielding = 0;
        hidden.texels = &texels;
        find_hidden(&hidden, w, texel, count);
        status = lw_crossings_find(&texels, points->pose, points->trace, w->object, block, &yielding);
    }
    free(texel);
    free(block);
    return status;
}

/* Gives every covered texel all of its points, parts nothing, and links gutters. */
static void begin(const struct lw_fine_texels_maker *maker, struct window *w) {
    w->of_mesh[maker->texels->scene->object[w->object].mesh] = w->texels;
    struct lw_texels texels = as_texels(w, maker);
    memcpy(w->covered, w->texels.covered, w->texels.texel_count);
    for (uint32_t i = 0; i < w->texels.texel_count; i++)
        w->usable[i] = lw_sample_points_all(&w->texels.sample_points, i);
    lw_texels_forget_walls(&texels, w->object);
    lw_texels_link_object(&texels, w->object);
}

/* ---- the tile ---- */

static bool fine_allocate(struct lw_fine_texels *fine, uint32_t width, uint32_t height,
                          const struct lw_sample_points *points, uint32_t point_count, bool has_albedo) {
    const size_t count = (size_t)width * height;
    struct lw_mesh_texels *mesh = &fine->mesh;
    bool ok = true;
    *fine =
        (struct lw_fine_texels){.mesh = {.width = width, .height = height, .texel_count = width * height}};
    for (int c = 0; c < 3; c++) {
        ok &= (mesh->position[c] = malloc(count * sizeof(float))) != NULL;
    }
    ok &= (mesh->normal = malloc(count * sizeof *mesh->normal)) != NULL;
    ok &= (mesh->geometric = malloc(count * sizeof *mesh->geometric)) != NULL;
    if (has_albedo) ok &= (mesh->albedo = malloc(count * sizeof *mesh->albedo)) != NULL;
    ok &= (mesh->covered = malloc(count)) != NULL;
    ok &= (mesh->chart = malloc(count * sizeof *mesh->chart)) != NULL;
    ok &= lw_sample_points_init(&mesh->sample_points, mesh->texel_count);
    ok &= (mesh->sample_points.spot = malloc(point_count + 1ul)) != NULL;
    ok &= lw_sample_points_take_planes(&mesh->sample_points, points);
    ok &= (fine->covered = malloc(count)) != NULL;
    ok &= (fine->usable = malloc(count)) != NULL;
    ok &= (fine->filled = malloc(count)) != NULL;
    ok &= (fine->walls = malloc(count)) != NULL;
    ok &= (fine->side = malloc(count * sizeof *fine->side)) != NULL;
    ok &= (fine->source = malloc(count * sizeof *fine->source)) != NULL;
    if (!ok) lw_fine_texels_finish(fine);
    return ok;
}

void lw_fine_texels_finish(struct lw_fine_texels *fine) {
    lw_texels_finish_mesh(&fine->mesh);
    free(fine->covered);
    free(fine->usable);
    free(fine->filled);
    free(fine->walls);
    free(fine->side);
    free(fine->source);
    *fine = (struct lw_fine_texels){0};
}

/* Returns false without memory. */
static bool copy_texel(struct lw_mesh_texels *to, uint32_t i, const struct lw_mesh_texels *from, uint32_t j) {
    for (int c = 0; c < 3; c++) {
        to->position[c][i] = from->position[c][j];
    }
    to->normal[i] = from->normal[j];
    to->geometric[i] = from->geometric[j];
    if (from->albedo) to->albedo[i] = from->albedo[j];
    to->covered[i] = from->covered[j];
    to->chart[i] = from->chart[j];
    return lw_sample_points_copy(&to->sample_points, i, &from->sample_points, j);
}

/* The texel of the tile that is one of the window; LW_TEXEL_NONE: it lies around the tile. */
static uint32_t inner_of(const struct window *w, const struct lw_fine_texels *fine, uint32_t texel) {
    uint32_t x, y;
    if (texel == LW_TEXEL_NONE) return LW_TEXEL_NONE;
    lw_texels_coordinates(&w->texels, texel, &x, &y);
    if (x < w->inner_x || y < w->inner_y || x - w->inner_x >= fine->mesh.width ||
        y - w->inner_y >= fine->mesh.height)
        return LW_TEXEL_NONE;
    return (y - w->inner_y) * fine->mesh.width + x - w->inner_x;
}

/* Takes the tile out of its window. */
static bool cut_out(const struct window *w, const struct lw_tile_place *place, struct lw_fine_texels *out) {
    const struct lw_sample_points *points = &w->texels.sample_points;
    if (!fine_allocate(out, place->width, place->height, points, points->first[w->texels.texel_count],
                       w->texels.albedo != NULL))
        return false;
    out->mesh.texel_m = w->texels.texel_m;
    for (uint32_t i = 0; i < out->mesh.texel_count; i++) {
        const uint32_t j =
            lw_texels_index(&w->texels, w->inner_x + i % place->width, w->inner_y + i / place->width);
        if (!copy_texel(&out->mesh, i, &w->texels, j)) {
            lw_fine_texels_finish(out);
            return false;
        }
        out->covered[i] = w->covered[j];
        out->usable[i] = w->usable[j];
        out->walls[i] = w->walls[j];
        out->side[i] = w->side[j];
        out->source[i] = inner_of(w, out, w->source[j]);
        out->filled[i] = !out->covered[i] && out->source[i] != LW_TEXEL_NONE;
    }
    lw_sample_points_trim(&out->mesh.sample_points);
    return true;
}

static struct window window_of(const struct lw_fine_texels_maker *maker, const struct lw_tile_place *place) {
    const struct lw_mesh_texels *mesh =
        &maker->texels->mesh[maker->texels->scene->object[place->object].mesh];
    const uint32_t finer = lw_atlas_finer(place->level), left = place->x * LW_TILE_SIDE,
                   top = place->y * LW_TILE_SIDE;
    struct window w = {.object = place->object, .finer = finer};
    LW_INVARIANT(finer > 0 && maker->cells[maker->texels->scene->object[place->object].mesh].first);
    w.x = left > MARGIN ? left - MARGIN : 0;
    w.y = top > MARGIN ? top - MARGIN : 0;
    w.width = smaller(left + place->width + MARGIN, mesh->width << finer) - w.x;
    w.height = smaller(top + place->height + MARGIN, mesh->height << finer) - w.y;
    w.inner_x = left - w.x;
    w.inner_y = top - w.y;
    return w;
}

static struct lw_searched_texels arrays_of(const struct lw_fine_texels *fine) {
    return (struct lw_searched_texels){.mesh = &fine->mesh,
                                       .covered = fine->covered,
                                       .usable = fine->usable,
                                       .filled = fine->filled,
                                       .walls = fine->walls,
                                       .side = fine->side,
                                       .source = fine->source};
}

void lw_fine_texels_remember(struct lw_fine_texels_maker *maker, const struct lw_tile_place *place,
                             const struct lw_fine_texels *fine) {
    const struct lw_searched_texels arrays = arrays_of(fine);
    if (maker->searched && (fine->searched || fine->remembered))
        lw_searched_tiles_keep(maker->searched, place, maker->texels->changes[place->object], &arrays);
}

enum lw_status lw_fine_texels_make(const struct lw_fine_texels_maker *maker,
                                   const struct lw_hidden_points_search *points,
                                   const struct lw_tile_place *place, struct lw_fine_texels *out) {
    struct window w = window_of(maker, place);
    const bool stands = maker->texels->stands && maker->texels->stands[place->object],
               remembered = stands && lw_searched_tiles_find(maker->searched, place,
                                                             maker->texels->changes[place->object]);
    bool searched = false;
    enum lw_status status =
        window_allocate(&w, maker->texels->scene->mesh_count) && rasterise(&w, maker) ? LW_OK : LW_NO_MEMORY;
    *out = (struct lw_fine_texels){0};
    if (status == LW_OK && !remembered) begin(maker, &w);
    if (status == LW_OK && stands && !remembered) status = search(maker, &w, points, &searched);
    if (status == LW_OK && !cut_out(&w, place, out)) status = LW_NO_MEMORY;
    const struct lw_searched_texels arrays = arrays_of(out);
    if (status == LW_OK && remembered) status = lw_searched_tiles_restore(maker->searched, place, &arrays);
    if (status != LW_OK) lw_fine_texels_finish(out);
    out->searched = searched;
    out->remembered = remembered;
    window_finish(&w);
    return status;
}
