#include "server/solve/seam_edges.h"

#include "common/random.h"

#include <stdlib.h>
#include <string.h>

/* Two places closer than this in the atlas, in texels, are one: no seam. */
#define SAME_PLACE 1e-3f
/* Edges that more sides share than this are no surface that goes on. */
#define SIDES_MAX 8u

/* One side of an edge. */
struct side {
    uint64_t edge; /* ids of its ends, the smaller one in the upper half */
    uint32_t object, triangle;
    uint8_t corner; /* the edge runs from this corner to the next */
    bool reversed;  /* from the end of the larger id */
};

struct sides {
    struct side *side;
    size_t count, capacity;
};

/* Gives equal positions equal ids. */
struct names {
    int64_t (*key)[3];
    uint32_t *slot; /* hash table of index + 1 */
    uint32_t count, capacity, slots;
};

static bool names_init(struct names *names, size_t capacity) {
    *names = (struct names){.slots = 16, .capacity = (uint32_t)capacity};
    while (names->slots < 2 * capacity) names->slots *= 2;
    names->key = malloc((capacity + 1) * sizeof *names->key);
    names->slot = calloc(names->slots, sizeof *names->slot);
    return names->key && names->slot;
}

static void names_finish(struct names *names) {
    free(names->key);
    free(names->slot);
}

static uint32_t name(struct names *names, struct lw_vec3 p, double step) {
    const int64_t key[3] = {llrint((double)p.x / step), llrint((double)p.y / step),
                            llrint((double)p.z / step)};
    uint32_t hash = 0;
    for (int c = 0; c < 3; c++) hash = lw_random_hash3(hash, (uint32_t)key[c], (uint32_t)(key[c] >> 32));
    for (uint32_t i = hash & (names->slots - 1);; i = (i + 1) & (names->slots - 1)) {
        const uint32_t found = names->slot[i];
        if (found && memcmp(names->key[found - 1], key, sizeof key) == 0) return found - 1;
        if (found) continue;
        memcpy(names->key[names->count], key, sizeof key);
        names->slot[i] = ++names->count;
        return names->count - 1;
    }
}

static bool push(struct sides *sides, struct side side) {
    if (sides->count == sides->capacity) {
        size_t capacity = sides->capacity ? 2 * sides->capacity : 256;
        struct side *grown = realloc(sides->side, capacity * sizeof *grown);
        if (!grown) return false;
        sides->side = grown;
        sides->capacity = capacity;
    }
    sides->side[sides->count++] = side;
    return true;
}

static bool push_edge(struct lw_seam_edges *edges, struct lw_seam_edge edge) {
    if (edges->count == edges->capacity) {
        size_t capacity = edges->capacity ? 2 * edges->capacity : 256;
        struct lw_seam_edge *grown = realloc(edges->edge, capacity * sizeof *grown);
        if (!grown) return false;
        edges->edge = grown;
        edges->capacity = capacity;
    }
    edges->edge[edges->count++] = edge;
    return true;
}

static int by_edge(const void *a, const void *b) {
    const struct side *x = a, *y = b;
    if (x->edge != y->edge) return x->edge < y->edge ? -1 : 1;
    if (x->object != y->object) return x->object < y->object ? -1 : 1;
    if (x->triangle != y->triangle) return x->triangle < y->triangle ? -1 : 1;
    return x->corner - y->corner;
}

static const struct lw_mesh *mesh_of(const struct lw_scene *scene, uint32_t object) {
    return &scene->mesh[scene->object[object].mesh];
}

/* Vertex of one end of a side: end 0 is that of the smaller id. */
static uint32_t vertex_of(const struct lw_mesh *mesh, const struct side *side, int end) {
    return mesh->triangle[side->triangle][(side->corner + (side->reversed ? 1 - end : end)) % 3];
}

static bool make_side(uint32_t object, uint32_t triangle, int corner, uint32_t from, uint32_t to,
                      struct side *out) {
    if (from == to) return false;
    const bool reversed = from > to;
    *out = (struct side){.edge = reversed ? (uint64_t)to << 32 | from : (uint64_t)from << 32 | to,
                         .object = object,
                         .triangle = triangle,
                         .corner = (uint8_t)corner,
                         .reversed = reversed};
    return true;
}

static bool double_sided(const struct lw_scene *scene, const struct side *side) {
    const struct lw_mesh *mesh = mesh_of(scene, side->object);
    return mesh->back_offset && scene->material[mesh->material[side->triangle]].double_sided;
}

static bool has_area(const struct lw_mesh *mesh, uint32_t triangle) {
    const uint32_t *v = mesh->triangle[triangle];
    const struct lw_vec2 a = mesh->lightmap_uv[v[0]], b = mesh->lightmap_uv[v[1]],
                         c = mesh->lightmap_uv[v[2]];
    return fabsf((b.x - a.x) * (c.y - a.y) - (b.y - a.y) * (c.x - a.x)) > 1e-6f;
}

/* Whether the surface goes on smoothly from one side to the other. */
static bool goes_on(const struct lw_scene *scene, const struct lw_pose *pose, const struct side *a,
                    const struct side *b) {
    const struct lw_mesh *ma = mesh_of(scene, a->object), *mb = mesh_of(scene, b->object);
    struct lw_vec3 face_a, face_b;
    (void)lw_scene_normal(ma, a->triangle, 0.3f, 0.3f, &face_a);
    (void)lw_scene_normal(mb, b->triangle, 0.3f, 0.3f, &face_b);
    const bool same = a->object == b->object;
    const struct lw_affine *ta = &pose->object_to_world[a->object], *tb = &pose->object_to_world[b->object];
    for (int end = 0; end < 2; end++) {
        struct lw_vec3 na = ma->normal[vertex_of(ma, a, end)], nb = mb->normal[vertex_of(mb, b, end)];
        if (!same) na = lw_affine_normal(ta, na), nb = lw_affine_normal(tb, nb);
        if (lw_vec3_dot(lw_vec3_normalize(na), lw_vec3_normalize(nb)) < LW_SEAM_EDGES_COSINE) return false;
    }
    if (!same) face_a = lw_affine_normal(ta, face_a), face_b = lw_affine_normal(tb, face_b);
    return lw_vec3_dot(face_a, face_b) > 0;
}

static bool apart(struct lw_vec2 a, struct lw_vec2 b) {
    return fabsf(a.x - b.x) > SAME_PLACE || fabsf(a.y - b.y) > SAME_PLACE;
}

/* Notes the seam of two sides, and that of their backs. */
static bool note(const struct lw_scene *scene, const struct side *a, const struct side *b,
                 struct lw_seam_edges *edges) {
    const struct side *side[2] = {a, b};
    struct lw_seam_edge edge;
    float back[2];
    for (int s = 0; s < 2; s++) {
        const struct lw_mesh *mesh = mesh_of(scene, side[s]->object);
        edge.object[s] = side[s]->object;
        edge.from[s] = mesh->lightmap_uv[vertex_of(mesh, side[s], 0)];
        edge.to[s] = mesh->lightmap_uv[vertex_of(mesh, side[s], 1)];
        back[s] = (float)mesh->back_offset;
    }
    if (a->object == b->object && !apart(edge.from[0], edge.from[1]) && !apart(edge.to[0], edge.to[1]))
        return true;
    if (!push_edge(edges, edge)) return false;
    if (!double_sided(scene, a) || !double_sided(scene, b)) return true;
    for (int s = 0; s < 2; s++) edge.from[s].y += back[s], edge.to[s].y += back[s];
    return push_edge(edges, edge);
}

/* Sorts sides and notes the seams among those of one edge. Sides that stay alone go to `open`, if asked for. */
static bool match(const struct lw_scene *scene, const struct lw_pose *pose, struct sides *sides,
                  struct sides *open, struct lw_seam_edges *edges) {
    if (sides->count) qsort(sides->side, sides->count, sizeof *sides->side, by_edge);
    for (size_t first = 0, end; first < sides->count; first = end) {
        for (end = first + 1; end < sides->count && sides->side[end].edge == sides->side[first].edge;) end++;
        if (end - first == 1 && open && !push(open, sides->side[first])) return false;
        if (end - first > SIDES_MAX) continue;
        for (size_t i = first; i < end; i++)
            for (size_t j = i + 1; j < end; j++)
                if (goes_on(scene, pose, &sides->side[i], &sides->side[j]) &&
                    !note(scene, &sides->side[i], &sides->side[j], edges))
                    return false;
    }
    return true;
}

/* All sides of a mesh, in the name of one object. */
static bool list_sides(const struct lw_mesh *mesh, uint32_t object, struct sides *out) {
    struct names names;
    uint32_t *id = malloc((mesh->vertex_count + 1) * sizeof *id);
    bool ok = id && names_init(&names, mesh->vertex_count);
    if (ok) {
        float largest = 0;
        for (uint32_t v = 0; v < mesh->vertex_count; v++) {
            struct lw_vec3 p = mesh->position[v];
            largest = fmaxf(largest, fmaxf(fabsf(p.x), fmaxf(fabsf(p.y), fabsf(p.z))));
        }
        /* Vertices that a lightmap has doubled are equal to the bit: a step far below theirs. */
        const double step = (double)largest * 0x1p-40 + 1e-30;
        for (uint32_t v = 0; v < mesh->vertex_count; v++) id[v] = name(&names, mesh->position[v], step);
        for (uint32_t t = 0; ok && t < mesh->triangle_count; t++) {
            struct side side;
            if (!has_area(mesh, t)) continue;
            for (int c = 0; ok && c < 3; c++)
                if (make_side(object, t, c, id[mesh->triangle[t][c]], id[mesh->triangle[t][(c + 1) % 3]],
                              &side))
                    ok = push(out, side);
        }
        names_finish(&names);
    }
    free(id);
    return ok;
}

/* Renames open sides by where their ends are in the world. */
static bool rename_in_world(const struct lw_scene *scene, const struct lw_pose *pose, struct sides *open,
                            double step) {
    struct names names;
    bool ok = names_init(&names, 2 * open->count);
    size_t kept = 0;
    for (size_t i = 0; ok && i < open->count; i++) {
        const struct side *s = &open->side[i];
        const struct lw_mesh *mesh = mesh_of(scene, s->object);
        const struct lw_affine *t = &pose->object_to_world[s->object];
        const uint32_t *v = mesh->triangle[s->triangle];
        uint32_t from = name(&names, lw_affine_point(t, mesh->position[v[s->corner]]), step),
                 to = name(&names, lw_affine_point(t, mesh->position[v[(s->corner + 1) % 3]]), step);
        struct side renamed;
        if (make_side(s->object, s->triangle, s->corner, from, to, &renamed)) open->side[kept++] = renamed;
    }
    open->count = kept;
    names_finish(&names);
    return ok;
}

/* Copies the seams that the first object of a mesh has, from index `first` on, to another one. */
static bool copy_edges(struct lw_seam_edges *edges, size_t first, size_t count, uint32_t object) {
    for (size_t i = 0; i < count; i++) {
        struct lw_seam_edge edge = edges->edge[first + i];
        edge.object[0] = edge.object[1] = object;
        if (!push_edge(edges, edge)) return false;
    }
    return true;
}

/* The seams of one mesh, for all its objects; its open sides in the name of those that never move. next: links them. */
static bool find_in_mesh(const struct lw_scene *scene, const struct lw_pose *pose, uint32_t first_object,
                         const uint32_t *next, struct lw_seam_edges *edges, struct sides *still,
                         float *largest) {
    const struct lw_mesh *mesh = mesh_of(scene, first_object);
    struct sides sides = {0}, open = {0};
    const size_t first = edges->count;
    bool ok = list_sides(mesh, first_object, &sides) && match(scene, pose, &sides, &open, edges);
    const size_t count = edges->count - first;
    for (uint32_t o = first_object; ok && o != LW_SCENE_NONE; o = next[o]) {
        if (o != first_object) ok = copy_edges(edges, first, count, o);
        if (lw_pose_object_moves(pose, scene, o)) continue;
        for (size_t i = 0; ok && i < open.count; i++) {
            struct side side = open.side[i];
            side.object = o;
            ok = push(still, side);
            struct lw_vec3 p =
                lw_affine_point(&pose->object_to_world[o], mesh->position[mesh->triangle[side.triangle][0]]);
            *largest = fmaxf(*largest, fmaxf(fabsf(p.x), fmaxf(fabsf(p.y), fabsf(p.z))));
        }
    }
    free(sides.side);
    free(open.side);
    return ok;
}

static bool find_all(const struct lw_scene *scene, const struct lw_pose *pose, struct lw_seam_edges *edges,
                     struct sides *still) {
    uint32_t *head = malloc(((size_t)scene->mesh_count + 1) * sizeof *head),
             *next = malloc(((size_t)scene->object_count + 1) * sizeof *next);
    bool ok = head && next;
    float largest = 0;
    for (uint32_t m = 0; ok && m < scene->mesh_count; m++) head[m] = LW_SCENE_NONE;
    for (uint32_t o = ok ? scene->object_count : 0; o-- > 0;) {
        next[o] = head[scene->object[o].mesh];
        head[scene->object[o].mesh] = o;
    }
    for (uint32_t m = 0; ok && m < scene->mesh_count; m++)
        if (head[m] != LW_SCENE_NONE && scene->mesh[m].lightmap_uv)
            ok = find_in_mesh(scene, pose, head[m], next, edges, still, &largest);
    free(head);
    free(next);
    const double step = (double)largest * 64 * 0x1p-23 + 1e-30;
    return ok && rename_in_world(scene, pose, still, step) && match(scene, pose, still, NULL, edges);
}

enum lw_status lw_seam_edges_find(const struct lw_scene *scene, const struct lw_pose *pose,
                                  struct lw_seam_edges *out_edges) {
    struct lw_seam_edges edges = {0};
    struct sides still = {0};
    bool ok = find_all(scene, pose, &edges, &still);
    free(still.side);
    if (!ok) {
        lw_seam_edges_finish(&edges);
        return LW_NO_MEMORY;
    }
    *out_edges = edges;
    return LW_OK;
}

void lw_seam_edges_finish(struct lw_seam_edges *edges) {
    free(edges->edge);
    *edges = (struct lw_seam_edges){0};
}
