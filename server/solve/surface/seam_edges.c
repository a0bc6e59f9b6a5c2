#include "server/solve/surface/seam_edges.h"

#include "common/base/invariant.h"
#include "common/base/random.h"

#include <stdlib.h>
#include <string.h>

/* Two places closer than this in the atlas, in texels, are one: no seam. */
#define SAME_PLACE 1e-3f
/* Edges that more sides share than this are no surface that goes on. */
#define SIDES_MAX 8u
/* At most this many ends of others count along one side; any more make no seam. */
#define ENDS_MAX 4096u
/* Ends that a leaf of their tree holds. */
#define LEAF 8u

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
        LW_INVARIANT_DEAR(names->count < names->capacity);
        memcpy(names->key[names->count], key, sizeof key);
        names->slot[i] = ++names->count;
        return names->count - 1;
    }
}

/* A list with room for one more; NULL: there is no memory, and the list is as it was. */
static void *grow(void *list, size_t count, size_t *capacity, size_t size) {
    const size_t more = *capacity ? 2 * *capacity : 256;
    if (count < *capacity) return list;
    list = realloc(list, more * size);
    if (list) *capacity = more;
    return list;
}

static bool push(struct sides *sides, struct side side) {
    struct side *list = grow(sides->side, sides->count, &sides->capacity, sizeof side);
    if (!list) return false;
    sides->side = list;
    list[sides->count++] = side;
    return true;
}

static bool push_edge(struct lw_seam_edges *edges, struct lw_seam_edge edge) {
    struct lw_seam_edge *list = grow(edges->edge, edges->count, &edges->capacity, sizeof edge);
    if (!list) return false;
    edges->edge = list;
    list[edges->count++] = edge;
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

static bool make_side(uint32_t object, uint32_t triangle, int corner, uint32_t from, uint32_t to,
                      struct side *out) {
    LW_INVARIANT_DEAR(corner >= 0 && corner < 3);
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
    return fabsf(lw_vec2_twice_area(a, b, c)) > 1e-6f;
}

/* A stretch of a side, as fractions of the way from its corner to the next. */
struct stretch {
    const struct side *side;
    float at[2];
};

static struct stretch whole(const struct side *side) {
    return (struct stretch){side, {side->reversed, !side->reversed}};
}

static uint32_t corner_of(const struct lw_mesh *mesh, const struct side *side, unsigned next) {
    return mesh->triangle[side->triangle][(side->corner + next) % 3];
}

/* The side's corners in triangle order, the third one last. pose: NULL in object space. */
static struct lw_vec3 place_of(const struct lw_scene *scene, const struct lw_pose *pose,
                               const struct side *side, unsigned next) {
    const struct lw_mesh *mesh = mesh_of(scene, side->object);
    const struct lw_vec3 p = mesh->position[corner_of(mesh, side, next)];
    return pose ? lw_affine_point(&pose->object_to_world[side->object], p) : p;
}

static struct lw_vec3 face_of(const struct lw_scene *scene, const struct lw_pose *pose,
                              const struct side *side) {
    struct lw_vec3 face;
    (void)lw_scene_normal(mesh_of(scene, side->object), side->triangle, 0.3f, 0.3f, &face);
    return pose ? lw_affine_normal(&pose->object_to_world[side->object], face) : face;
}

static struct lw_vec3 normal_at(const struct lw_scene *scene, const struct lw_pose *pose,
                                const struct side *side, float t) {
    const struct lw_mesh *mesh = mesh_of(scene, side->object);
    const struct lw_vec3 n = lw_vec3_add(lw_vec3_scale(mesh->normal[corner_of(mesh, side, 0)], 1 - t),
                                         lw_vec3_scale(mesh->normal[corner_of(mesh, side, 1)], t));
    return lw_vec3_normalize(pose ? lw_affine_normal(&pose->object_to_world[side->object], n) : n);
}

/* From the edge into the triangle, perpendicular to the edge; unit. */
static struct lw_vec3 inward(const struct lw_scene *scene, const struct lw_pose *pose,
                             const struct side *side) {
    const struct lw_vec3 from = place_of(scene, pose, side, 0),
                         along = lw_vec3_normalize(lw_vec3_sub(place_of(scene, pose, side, 1), from)),
                         third = lw_vec3_sub(place_of(scene, pose, side, 2), from);
    return lw_vec3_normalize(lw_vec3_mad(third, along, -lw_vec3_dot(third, along)));
}

/* Whether the surface goes on smoothly across the two sides. */
static bool goes_on(const struct lw_scene *scene, const struct lw_pose *pose, const struct stretch *a,
                    const struct stretch *b) {
    for (int end = 0; end < 2; end++)
        if (lw_vec3_dot(normal_at(scene, pose, a->side, a->at[end]),
                        normal_at(scene, pose, b->side, b->at[end])) < LW_SEAM_EDGES_COSINE)
            return false;
    return lw_vec3_dot(face_of(scene, pose, a->side), face_of(scene, pose, b->side)) > 0 &&
           lw_vec3_dot(inward(scene, pose, a->side), inward(scene, pose, b->side)) < 0;
}

static bool apart(struct lw_vec2 a, struct lw_vec2 b) {
    return fabsf(a.x - b.x) > SAME_PLACE || fabsf(a.y - b.y) > SAME_PLACE;
}

static struct lw_vec2 lightmap_at(const struct lw_mesh *mesh, const struct side *side, float t) {
    const struct lw_vec2 a = mesh->lightmap_uv[corner_of(mesh, side, 0)],
                         b = mesh->lightmap_uv[corner_of(mesh, side, 1)];
    return (struct lw_vec2){(1 - t) * a.x + t * b.x, (1 - t) * a.y + t * b.y};
}

/* Notes the seam of two sides where their surface goes on and their lightmap does
 * not, and that of their backs. */
static bool join(const struct lw_scene *scene, const struct lw_pose *pose, const struct stretch *a,
                 const struct stretch *b, struct lw_seam_edges *edges) {
    const struct stretch *stretch[2] = {a, b};
    struct lw_seam_edge edge;
    float back[2];
    for (int s = 0; s < 2; s++) {
        const struct side *side = stretch[s]->side;
        const struct lw_mesh *mesh = mesh_of(scene, side->object);
        edge.object[s] = side->object;
        edge.triangle[s] = side->triangle;
        edge.from[s] = lightmap_at(mesh, side, stretch[s]->at[0]);
        edge.to[s] = lightmap_at(mesh, side, stretch[s]->at[1]);
        back[s] = (float)mesh->back_offset;
    }
    if (edge.object[0] == edge.object[1] && !apart(edge.from[0], edge.from[1]) &&
        !apart(edge.to[0], edge.to[1]))
        return true;
    if (!goes_on(scene, pose, a, b)) return true;
    if (!push_edge(edges, edge)) return false;
    if (!double_sided(scene, a->side) || !double_sided(scene, b->side)) return true;
    for (int s = 0; s < 2; s++) edge.from[s].y += back[s], edge.to[s].y += back[s];
    return push_edge(edges, edge);
}

/* Sorts the sides of a mesh and notes the seams among those of one edge. Sides
 * that stay alone go to `open`. */
static bool match(const struct lw_scene *scene, struct sides *sides, struct sides *open,
                  struct lw_seam_edges *edges) {
    if (sides->count) qsort(sides->side, sides->count, sizeof *sides->side, by_edge);
    for (size_t first = 0, end; first < sides->count; first = end) {
        for (end = first + 1; end < sides->count && sides->side[end].edge == sides->side[first].edge;) end++;
        if (end - first == 1 && !push(open, sides->side[first])) return false;
        if (end - first > SIDES_MAX) continue;
        for (size_t i = first; i < end; i++)
            for (size_t j = i + 1; j < end; j++) {
                const struct stretch a = whole(&sides->side[i]), b = whole(&sides->side[j]);
                if (!join(scene, NULL, &a, &b, edges)) return false;
            }
    }
    return true;
}

/* ---- open sides that run along one another ---- */

struct end {
    struct lw_vec3 at;
    uint32_t side, object;
    uint32_t only; /* if it is the middle of a range: the object of all its ends; LW_SCENE_NONE: several */
};

static float coordinate(struct lw_vec3 p, int axis) { return axis == 0 ? p.x : axis == 1 ? p.y : p.z; }

/* Puts the middle one of some ends, by one coordinate, into the middle, smaller
 * ones before it (Hoare 1961). */
static void part_ends(struct end *end, size_t count, int axis) {
    size_t lo = 0, hi = count - 1;
    const size_t middle = count / 2;
    while (lo < hi) {
        const float pivot = coordinate(end[lo + (hi - lo) / 2].at, axis);
        size_t i = lo, j = hi;
        for (;; i++, j--) {
            while (coordinate(end[i].at, axis) < pivot) i++;
            while (coordinate(end[j].at, axis) > pivot) j--;
            if (i >= j) break;
            const struct end swapped = end[i];
            end[i] = end[j], end[j] = swapped;
        }
        if (middle <= j)
            hi = j;
        else
            lo = j + 1;
    }
}

static bool are_parted(const struct end *end, size_t count, int axis) {
    const float middle = coordinate(end[count / 2].at, axis);
    for (size_t i = 0; i < count; i++)
        if (i < count / 2 ? coordinate(end[i].at, axis) > middle : coordinate(end[i].at, axis) < middle)
            return false;
    return true;
}

/* A k-d tree (Bentley 1975) without nodes: the middle end of each range splits it, by the three axes in turn.
 * Returns the object of all ends in the range; LW_SCENE_NONE: of several. */
static uint32_t sort_ends(struct end *end, size_t count, int axis) {
    const size_t middle = count / 2;
    uint32_t only = count ? end[middle].object : LW_SCENE_NONE;
    if (count <= LEAF) {
        for (size_t i = 0; i < count; i++)
            if (end[i].object != only) return LW_SCENE_NONE;
        return only;
    }
    part_ends(end, count, axis);
    LW_INVARIANT_DEAR(are_parted(end, count, axis));
    only = end[middle].object;
    if (sort_ends(end, middle, (axis + 1) % 3) != only) only = LW_SCENE_NONE;
    if (sort_ends(end + middle + 1, count - middle - 1, (axis + 1) % 3) != only) only = LW_SCENE_NONE;
    return end[middle].only = only;
}

/* A search for ends within `reach` of a segment. */
struct segment {
    struct lw_vec3 from, along; /* to - from */
    float reach, length2;
    uint32_t skip;                         /* an object whose ends do not count; LW_SCENE_NONE: all do */
    uint32_t found_count, found[ENDS_MAX]; /* sides */
};

static void try_end(struct segment *s, const struct end *end) {
    if (end->object == s->skip || s->found_count == ENDS_MAX) return;
    const struct lw_vec3 d = lw_vec3_sub(end->at, s->from);
    const float t = lw_vec3_dot(d, s->along) / s->length2;
    const struct lw_vec3 off = lw_vec3_mad(d, s->along, t < 0 ? -0.0f : t > 1 ? -1 : -t);
    if (lw_vec3_dot(off, off) <= s->reach * s->reach) s->found[s->found_count++] = end->side;
}

/* lo, hi: the part of the segment that comes near the range. */
static void search(struct segment *s, const struct end *end, size_t count, int axis, float lo, float hi) {
    while (count > LEAF) {
        const struct end *middle = &end[count / 2];
        if (middle->only == s->skip && s->skip != LW_SCENE_NONE) return;
        const float from = coordinate(s->from, axis), along = coordinate(s->along, axis),
                    at = coordinate(middle->at, axis);
        /* the stretch of the segment that smaller ends reach, and the larger ends' */
        float lo_small = lo, hi_small = hi, lo_large = lo, hi_large = hi;
        const float leave = (at + s->reach - from) / along, enter = (at - s->reach - from) / along;
        if (along > 0) {
            hi_small = fminf(hi, leave), lo_large = fmaxf(lo, enter);
        } else if (along < 0) {
            lo_small = fmaxf(lo, leave), hi_large = fminf(hi, enter);
        } else {
            if (from > at + s->reach) hi_small = -1;
            if (from < at - s->reach) hi_large = -1;
        }
        axis = (axis + 1) % 3;
        try_end(s, middle);
        if (lo_small <= hi_small) search(s, end, count / 2, axis, lo_small, hi_small);
        if (!(lo_large <= hi_large)) return;
        count -= count / 2 + 1, end = middle + 1, lo = lo_large, hi = hi_large;
    }
    for (size_t i = 0; i < count; i++) try_end(s, &end[i]);
}

/* The stretch that two sides run along one another, to within `reach`; false if there is none. */
static bool overlap(const struct lw_scene *scene, const struct lw_pose *pose, float reach, struct stretch *a,
                    struct stretch *b) {
    const struct lw_vec3 a0 = place_of(scene, pose, a->side, 0), b0 = place_of(scene, pose, b->side, 0),
                         da = lw_vec3_sub(place_of(scene, pose, a->side, 1), a0),
                         db = lw_vec3_sub(place_of(scene, pose, b->side, 1), b0);
    const float aa = lw_vec3_dot(da, da), bb = lw_vec3_dot(db, db), least = 2 * reach / sqrtf(aa);
    if (!(aa > 4 * reach * reach && bb > 4 * reach * reach)) return false;
    const float t0 = lw_vec3_dot(lw_vec3_sub(b0, a0), da) / aa, t1 = t0 + lw_vec3_dot(db, da) / aa;
    a->at[0] = fmaxf(fminf(t0, t1), 0), a->at[1] = fminf(fmaxf(t0, t1), 1);
    if (!(a->at[1] - a->at[0] > least)) return false;
    for (int end = 0; end < 2; end++) {
        const struct lw_vec3 d = lw_vec3_sub(lw_vec3_mad(a0, da, a->at[end]), b0);
        b->at[end] = fminf(fmaxf(lw_vec3_dot(d, db) / bb, 0), 1);
        if (lw_vec3_length(lw_vec3_mad(d, db, -b->at[end])) > reach) return false;
    }
    LW_INVARIANT_DEAR(a->at[0] >= 0 && a->at[0] < a->at[1] && a->at[1] <= 1);
    return true;
}

static int by_number(const void *a, const void *b) {
    const uint64_t x = *(const uint64_t *)a, y = *(const uint64_t *)b;
    return x < y ? -1 : x > y;
}

struct pairs {
    uint64_t *pair; /* numbers of two sides, the smaller one in the upper half */
    size_t count, capacity;
};

static bool push_pair(struct pairs *pairs, uint32_t a, uint32_t b) {
    uint64_t *list = grow(pairs->pair, pairs->count, &pairs->capacity, sizeof *list);
    if (!list) return false;
    pairs->pair = list;
    list[pairs->count++] = a < b ? (uint64_t)a << 32 | b : (uint64_t)b << 32 | a;
    return true;
}

/* Lists pairs of open sides that run along one another: if two sides overlap, at least one
 * end of either lies on its partner. */
static bool list_pairs(const struct lw_scene *scene, const struct lw_pose *pose, const struct sides *open,
                       struct pairs *out, float *out_reach) {
    float largest = 0;
    LW_INVARIANT(open->count <= UINT32_MAX); /* a pair's numbers have 32 bits each */
    struct end *end = malloc((2 * open->count + 1) * sizeof *end);
    struct segment *segment = malloc(sizeof *segment);
    bool ok = end && segment;
    if (ok) {
        for (size_t i = 0; i < 2 * open->count; i++) {
            const struct lw_vec3 p = place_of(scene, pose, &open->side[i / 2], (unsigned)i % 2);
            largest = fmaxf(largest, fmaxf(fabsf(p.x), fmaxf(fabsf(p.y), fabsf(p.z))));
            end[i] = (struct end){p, (uint32_t)(i / 2), open->side[i / 2].object, LW_SCENE_NONE};
        }
        (void)sort_ends(end, 2 * open->count, 0);
    }
    const float reach = largest * 64 * 0x1p-23f;
    for (uint32_t i = 0; ok && i < open->count; i++) {
        struct stretch a = {.side = &open->side[i]};
        segment->from = place_of(scene, pose, a.side, 0);
        segment->along = lw_vec3_sub(place_of(scene, pose, a.side, 1), segment->from);
        segment->reach = reach;
        segment->length2 = lw_vec3_dot(segment->along, segment->along);
        segment->skip = pose ? a.side->object : LW_SCENE_NONE;
        segment->found_count = 0;
        if (!(segment->length2 > 0)) continue;
        search(segment, end, 2 * open->count, 0, 0, 1);
        for (uint32_t k = 0; ok && k < segment->found_count; k++) {
            struct stretch b = {.side = &open->side[segment->found[k]]};
            if (segment->found[k] != i && overlap(scene, pose, reach, &a, &b))
                ok = push_pair(out, i, segment->found[k]);
        }
    }
    free(segment);
    free(end);
    *out_reach = reach;
    return ok;
}

/* Notes the seams of open sides that run along one another. pose: NULL for those of one mesh, in object
 * space; else of different objects, in the world. */
static bool match_along(const struct lw_scene *scene, const struct lw_pose *pose, const struct sides *open,
                        struct lw_seam_edges *edges) {
    struct pairs pairs = {0};
    float reach;
    bool ok = list_pairs(scene, pose, open, &pairs, &reach);
    if (pairs.count) qsort(pairs.pair, pairs.count, sizeof *pairs.pair, by_number);
    for (size_t i = 0; ok && i < pairs.count; i++) {
        if (i > 0 && pairs.pair[i] == pairs.pair[i - 1]) continue;
        struct stretch a = {.side = &open->side[pairs.pair[i] >> 32]},
                       b = {.side = &open->side[(uint32_t)pairs.pair[i]]};
        if (overlap(scene, pose, reach, &a, &b)) ok = join(scene, pose, &a, &b, edges);
    }
    free(pairs.pair);
    return ok;
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

/* Copies the seams that the first object of a mesh has, from index `first` on, to another one. */
static bool copy_edges(struct lw_seam_edges *edges, size_t first, size_t count, uint32_t object) {
    for (size_t i = 0; i < count; i++) {
        struct lw_seam_edge edge = edges->edge[first + i];
        edge.object[0] = edge.object[1] = object;
        if (!push_edge(edges, edge)) return false;
    }
    return true;
}

/* The seams of one mesh, for all its objects; its open sides in the name of those that
 * never move. next: links them. */
static bool find_in_mesh(const struct lw_scene *scene, const struct lw_pose *pose, uint32_t first_object,
                         const uint32_t *next, struct lw_seam_edges *edges, struct sides *still) {
    const struct lw_mesh *mesh = mesh_of(scene, first_object);
    struct sides sides = {0}, open = {0};
    const size_t first = edges->count;
    bool ok = list_sides(mesh, first_object, &sides) && match(scene, &sides, &open, edges) &&
              match_along(scene, NULL, &open, edges);
    const size_t count = edges->count - first;
    for (uint32_t o = first_object; ok && o != LW_SCENE_NONE; o = next[o]) {
        if (o != first_object) ok = copy_edges(edges, first, count, o);
        if (lw_pose_object_moves(pose, scene, o)) continue;
        for (size_t i = 0; ok && i < open.count; i++) {
            struct side side = open.side[i];
            side.object = o;
            ok = push(still, side);
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
    for (uint32_t m = 0; ok && m < scene->mesh_count; m++) head[m] = LW_SCENE_NONE;
    for (uint32_t o = ok ? scene->object_count : 0; o-- > 0;) {
        next[o] = head[scene->object[o].mesh];
        head[scene->object[o].mesh] = o;
    }
    for (uint32_t m = 0; ok && m < scene->mesh_count; m++)
        if (head[m] != LW_SCENE_NONE && scene->mesh[m].lightmap_uv)
            ok = find_in_mesh(scene, pose, head[m], next, edges, still);
    free(head);
    free(next);
    return ok && match_along(scene, pose, still, edges);
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
