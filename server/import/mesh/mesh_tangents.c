#include "server/import/mesh/mesh_tangents.h"

#include "common/shading/tangent.h"

#include <float.h>
#include <stdlib.h>
#include <string.h>
#include <xxhash.h>

#define NONE           UINT32_MAX
#define TABLE_SIZE_MIN 1024u
#define W_SLACK        0.1f /* for the file's w, which may be a byte */

/* Properties that corners with one tangent share. All members have 4 bytes: equal bytes are equal keys. */
struct key {
    struct lw_vec3 position, normal;
    struct lw_vec2 uv; /* the normal map's, v up */
    uint32_t material;
};

struct edge_slot {
    uint32_t any;        /* an edge of these two ends; NONE: the slot is free */
    uint32_t head, tail; /* edges that have no neighbour yet, all of one direction; NONE: none */
};

struct face {
    struct lw_vec3 along_u; /* unit; or 0 */
    bool preserves;         /* u to v is counter-clockwise in the picture as on the surface */
    bool any;               /* it has no area in the picture: it goes with any group */
};

/* The triangles with a normal map ("faces"), and their corners: 3 face + corner. Edge e goes from corner e to
 * the next one of its face. */
struct rule {
    const struct lw_scene *scene;
    const struct lw_mesh *mesh;
    uint32_t face_count;
    uint32_t *triangle; /* per face */
    struct face *face;
    uint32_t *point;     /* per corner: its key */
    uint32_t *neighbour; /* per edge: the edge on the other side, or NONE */
    uint32_t *next;      /* per edge: the one that waits behind it */
    uint8_t *grouped;    /* per corner */
    uint32_t *member;    /* corners of the group */
    uint32_t member_count;

    struct key *key;
    uint32_t key_count, key_capacity;
    uint32_t *table; /* keys by hash, open addressing */
    size_t table_size;
    uint32_t *recent_material, *recent_key; /* per vertex: the last answer */
};

static enum lw_status no_memory(struct lw_error *err) {
    return lw_status_fail(err, LW_NO_MEMORY, "out of memory for tangents");
}

/* ---- which triangles ---- */

static const struct lw_texture_use *normal_map(const struct lw_scene *scene, const struct lw_mesh *mesh,
                                               uint32_t triangle) {
    const struct lw_finish *finish = scene->material[mesh->material[triangle]].finish;
    const struct lw_texture_use *use = finish ? &finish->normal_texture : NULL;
    return use && use->texture != LW_SCENE_NONE && mesh->uv[use->uv_set] ? use : NULL;
}

static uint32_t count_faces(const struct lw_scene *scene, const struct lw_mesh *mesh) {
    uint32_t count = 0;
    for (uint32_t t = 0; t < mesh->triangle_count; t++) count += normal_map(scene, mesh, t) != NULL;
    return count;
}

static enum lw_status init(struct rule *r, const struct lw_scene *scene, const struct lw_mesh *mesh,
                           uint32_t face_count, struct lw_error *err) {
    const size_t corners = 3 * (size_t)face_count, vertices = mesh->vertex_count;
    *r = (struct rule){.scene = scene, .mesh = mesh, .face_count = face_count, .table_size = TABLE_SIZE_MIN};
    r->triangle = malloc(face_count * sizeof *r->triangle);
    r->face = malloc(face_count * sizeof *r->face);
    r->point = malloc(corners * sizeof *r->point);
    r->neighbour = malloc(corners * sizeof *r->neighbour);
    r->next = malloc(corners * sizeof *r->next);
    r->grouped = calloc(corners, 1);
    r->member = malloc(corners * sizeof *r->member);
    r->table = malloc(r->table_size * sizeof *r->table);
    r->recent_material = malloc(vertices * sizeof *r->recent_material);
    r->recent_key = malloc(vertices * sizeof *r->recent_key);
    if (!r->triangle || !r->face || !r->point || !r->neighbour || !r->next || !r->grouped || !r->member ||
        !r->table || !r->recent_material || !r->recent_key)
        return no_memory(err);
    memset(r->neighbour, 0xff, corners * sizeof *r->neighbour);
    memset(r->table, 0xff, r->table_size * sizeof *r->table);
    memset(r->recent_material, 0xff, vertices * sizeof *r->recent_material);
    for (uint32_t t = 0, f = 0; t < mesh->triangle_count; t++)
        if (normal_map(scene, mesh, t)) r->triangle[f++] = t;
    return LW_OK;
}

static void free_rule(struct rule *r) {
    free(r->recent_key);
    free(r->recent_material);
    free(r->table);
    free(r->key);
    free(r->member);
    free(r->grouped);
    free(r->next);
    free(r->neighbour);
    free(r->point);
    free(r->face);
    free(r->triangle);
}

/* ---- points: corners that may share a tangent ---- */

/* -0 is 0. */
static struct lw_vec3 plain(struct lw_vec3 v) { return lw_vec3(v.x + 0.0f, v.y + 0.0f, v.z + 0.0f); }

static struct key key_of(const struct rule *r, uint32_t vertex, uint32_t triangle) {
    const struct lw_mesh *mesh = r->mesh;
    const struct lw_texture_use *use = normal_map(r->scene, mesh, triangle);
    const float *m = use->transform;
    const struct lw_vec2 uv = mesh->uv[use->uv_set][vertex];
    return (struct key){
        .position = plain(mesh->position[vertex]),
        .normal = plain(mesh->normal[vertex]),
        .uv = {m[0] * uv.x + m[1] * uv.y + m[2] + 0.0f, 1 - (m[3] * uv.x + m[4] * uv.y + m[5])},
        .material = mesh->material[triangle]};
}

static uint32_t *slot_of(const struct rule *r, const struct key *key) {
    size_t mask = r->table_size - 1, slot = XXH3_64bits(key, sizeof *key) & mask;
    while (r->table[slot] != NONE && memcmp(&r->key[r->table[slot]], key, sizeof *key) != 0)
        slot = (slot + 1) & mask;
    return &r->table[slot];
}

static enum lw_status grow_keys(struct rule *r, struct lw_error *err) {
    const uint32_t capacity = r->key_capacity ? 2 * r->key_capacity : TABLE_SIZE_MIN / 2;
    struct key *key = reallocarray(r->key, capacity, sizeof *key);
    if (!key) return no_memory(err);
    r->key = key;
    r->key_capacity = capacity;
    uint32_t *table = malloc(2 * (size_t)capacity * sizeof *table);
    if (!table) return no_memory(err);
    free(r->table);
    r->table = table;
    r->table_size = 2 * (size_t)capacity;
    memset(table, 0xff, r->table_size * sizeof *table);
    for (uint32_t i = 0; i < r->key_count; i++) *slot_of(r, &r->key[i]) = i;
    return LW_OK;
}

static enum lw_status find_point(struct rule *r, uint32_t vertex, uint32_t triangle, uint32_t *out,
                                 struct lw_error *err) {
    const uint32_t material = r->mesh->material[triangle];
    if (r->recent_material[vertex] != material) {
        const struct key key = key_of(r, vertex, triangle);
        if (r->key_count == r->key_capacity && grow_keys(r, err)) return err->status;
        uint32_t *slot = slot_of(r, &key);
        if (*slot == NONE) {
            *slot = r->key_count;
            r->key[r->key_count++] = key;
        }
        r->recent_material[vertex] = material;
        r->recent_key[vertex] = *slot;
    }
    *out = r->recent_key[vertex];
    return LW_OK;
}

static enum lw_status find_points(struct rule *r, struct lw_error *err) {
    for (uint32_t f = 0; f < r->face_count; f++)
        for (uint32_t k = 0; k < 3; k++)
            if (find_point(r, r->mesh->triangle[r->triangle[f]][k], r->triangle[f],
                           &r->point[3 * (size_t)f + k], err))
                return err->status;
    return LW_OK;
}

/* ---- faces ---- */

static void measure_faces(struct rule *r) {
    for (uint32_t f = 0; f < r->face_count; f++) {
        const uint32_t *p = r->point + 3 * (size_t)f;
        const struct key *a = &r->key[p[0]], *b = &r->key[p[1]], *c = &r->key[p[2]];
        const float bu = b->uv.x - a->uv.x, bv = b->uv.y - a->uv.y, cu = c->uv.x - a->uv.x,
                    cv = c->uv.y - a->uv.y, area = bu * cv - bv * cu;
        const struct lw_vec3 ab = lw_vec3_sub(b->position, a->position),
                             ac = lw_vec3_sub(c->position, a->position);
        const struct lw_vec3 s = lw_vec3_mad(lw_vec3_scale(ab, cv), ac, -bv),
                             t = lw_vec3_mad(lw_vec3_scale(ab, -cu), ac, bu);
        const float s_length = lw_vec3_length(s), t_length = lw_vec3_length(t);
        struct face *face = &r->face[f];
        *face = (struct face){.preserves = area > 0};
        face->any = !(fabsf(area) > FLT_MIN && s_length > FLT_MIN && t_length > FLT_MIN) || !isfinite(area) ||
                    !isfinite(s_length);
        if (!face->any) face->along_u = lw_vec3_scale(s, (area > 0 ? 1 : -1) / s_length);
    }
}

/* ---- edges ---- */

static uint32_t after(uint32_t corner) { return corner % 3 == 2 ? corner - 2 : corner + 1; }
static uint32_t before(uint32_t corner) { return corner % 3 == 0 ? corner + 2 : corner - 1; }

static uint64_t edge_key(const struct rule *r, uint32_t edge) {
    const uint64_t a = r->point[edge], b = r->point[after(edge)];
    return a < b ? a << 32 | b : b << 32 | a;
}

static struct edge_slot *edge_slot(const struct rule *r, struct edge_slot *table, size_t size,
                                   uint32_t edge) {
    const uint64_t key = edge_key(r, edge);
    size_t slot = (key * 0x9e3779b97f4a7c15ull >> 20) & (size - 1);
    while (table[slot].any != NONE && edge_key(r, table[slot].any) != key) slot = (slot + 1) & (size - 1);
    return &table[slot];
}

/* Edges that pass the same two points in opposite directions are neighbours, in the order of their faces. */
static void join_edge(struct rule *r, struct edge_slot *slot, uint32_t edge) {
    const bool waits = slot->any != NONE && slot->head != NONE;
    if (slot->any == NONE) slot->any = edge;
    r->next[edge] = NONE;
    if (waits && r->point[slot->head] != r->point[edge]) {
        r->neighbour[edge] = slot->head;
        r->neighbour[slot->head] = edge;
        slot->head = r->next[slot->head];
        return;
    }
    if (waits)
        r->next[slot->tail] = edge;
    else
        slot->head = edge;
    slot->tail = edge;
}

static enum lw_status find_neighbours(struct rule *r, struct lw_error *err) {
    const uint32_t edges = 3 * r->face_count;
    size_t size = TABLE_SIZE_MIN;
    while (size < 2 * (size_t)edges) size *= 2;
    struct edge_slot *table = malloc(size * sizeof *table);
    if (!table) return no_memory(err);
    memset(table, 0xff, size * sizeof *table);
    for (uint32_t e = 0; e < edges; e++) join_edge(r, edge_slot(r, table, size, e), e);
    free(table);
    return LW_OK;
}

/* ---- groups ---- */

static void add_member(struct rule *r, uint32_t corner) {
    r->grouped[corner] = true;
    r->member[r->member_count++] = corner;
}

/* Whether a face's corner joins. A face without area in the picture becomes as its first group is. */
static bool joins(struct rule *r, uint32_t corner, bool preserves) {
    const uint32_t f = corner / 3, first = 3 * f;
    if (r->grouped[corner]) return false;
    if (r->face[f].any && !r->grouped[first] && !r->grouped[first + 1] && !r->grouped[first + 2])
        r->face[f].preserves = preserves;
    return r->face[f].preserves == preserves;
}

/* The corners about the point of a corner that hang together, to both sides of it. */
static void collect(struct rule *r, uint32_t corner) {
    const bool preserves = r->face[corner / 3].preserves;
    r->member_count = 0;
    add_member(r, corner);
    for (uint32_t c = corner, other; (other = r->neighbour[c]) != NONE; c = after(other)) {
        if (!joins(r, after(other), preserves)) break;
        add_member(r, after(other));
    }
    for (uint32_t c = corner, other; (other = r->neighbour[before(c)]) != NONE; c = other) {
        if (!joins(r, other, preserves)) break;
        add_member(r, other);
    }
}

static struct lw_vec3 flattened(struct lw_vec3 v, struct lw_vec3 normal) {
    v = lw_vec3_mad(v, normal, -lw_vec3_dot(v, normal));
    const float length = lw_vec3_length(v);
    return length > FLT_MIN ? lw_vec3_scale(v, 1 / length) : lw_vec3(0, 0, 0);
}

static float angle_at(const struct rule *r, uint32_t corner, struct lw_vec3 normal) {
    const struct lw_vec3 at = r->key[r->point[corner]].position;
    const struct lw_vec3 a = lw_vec3_sub(r->key[r->point[before(corner)]].position, at),
                         b = lw_vec3_sub(r->key[r->point[after(corner)]].position, at);
    const float cosine = lw_vec3_dot(flattened(a, normal), flattened(b, normal));
    return acosf(fminf(fmaxf(cosine, -1), 1));
}

static struct lw_vec3 mean_of_group(const struct rule *r) {
    const struct lw_vec3 normal = r->key[r->point[r->member[0]]].normal;
    struct lw_vec3 sum = lw_vec3(0, 0, 0);
    for (uint32_t i = 0; i < r->member_count; i++) {
        const struct face *face = &r->face[r->member[i] / 3];
        if (!face->any)
            sum = lw_vec3_mad(sum, flattened(face->along_u, normal), angle_at(r, r->member[i], normal));
    }
    return lw_vec3_is_finite(sum) ? sum : lw_vec3(0, 0, 0);
}

static uint16_t *place_of(const struct rule *r, uint16_t *out, uint32_t corner) {
    return out + 3 * (size_t)r->triangle[corner / 3] + corner % 3;
}

static void fill_groups(struct rule *r, uint16_t *out) {
    for (uint32_t corner = 0; corner < 3 * r->face_count; corner++) {
        if (r->face[corner / 3].any || r->grouped[corner]) continue;
        collect(r, corner);
        const struct lw_vec3 mean = mean_of_group(r);
        const bool mirrored = !r->face[corner / 3].preserves;
        for (uint32_t i = 0; i < r->member_count; i++) {
            const uint32_t m = r->member[i];
            const uint32_t vertex = r->mesh->triangle[r->triangle[m / 3]][m % 3];
            *place_of(r, out, m) = lw_tangent_encode(r->mesh->normal[vertex], mean, mirrored);
        }
    }
}

static enum lw_status compute(const struct lw_scene *scene, const struct lw_mesh *mesh, uint32_t face_count,
                              uint16_t *out, struct lw_error *err) {
    struct rule rule;
    if (!init(&rule, scene, mesh, face_count, err) && !find_points(&rule, err) &&
        !find_neighbours(&rule, err)) {
        measure_faces(&rule);
        fill_groups(&rule, out);
    }
    free_rule(&rule);
    return err->status;
}

/* ---- tangents of the file ---- */

static bool is_tangent(struct lw_vec4 t, struct lw_vec3 normal) {
    const struct lw_vec3 v = lw_vec3(t.x, t.y, t.z);
    const float length = lw_vec3_length(v);
    if (!(length > 1e-6f) || !isfinite(length) || !(fabsf(fabsf(t.w) - 1) <= W_SLACK)) return false;
    return fabsf(lw_vec3_dot(v, normal)) < 0.999f * length;
}

static bool is_given(const struct lw_vec4 *given, uint32_t vertex) {
    return given && given[vertex].w != 0; /* NaN is given, and none */
}

/* Whether all corners that need a tangent have one from the file. Counts vertices whose own is none. */
static enum lw_status check_given(const struct lw_scene *scene, const struct lw_mesh *mesh,
                                  struct lw_vec4 *given, bool *out_whole, uint64_t *out_bad,
                                  struct lw_error *err) {
    uint8_t *needed = calloc(mesh->vertex_count + 1ul, 1);
    if (!needed) return no_memory(err);
    for (uint32_t t = 0; t < mesh->triangle_count; t++)
        for (int k = 0; normal_map(scene, mesh, t) && k < 3; k++) needed[mesh->triangle[t][k]] = 1;
    *out_whole = true;
    for (uint32_t v = 0; v < mesh->vertex_count; v++) {
        if (!needed[v]) continue;
        if (is_given(given, v) && !is_tangent(given[v], mesh->normal[v])) {
            given[v].w = 0;
            ++*out_bad;
        }
        *out_whole &= is_given(given, v);
    }
    free(needed);
    return LW_OK;
}

static void take_given(const struct lw_scene *scene, const struct lw_mesh *mesh, const struct lw_vec4 *given,
                       uint16_t *out) {
    for (uint32_t t = 0; t < mesh->triangle_count; t++)
        for (int k = 0; normal_map(scene, mesh, t) && k < 3; k++) {
            const uint32_t v = mesh->triangle[t][k];
            if (!is_given(given, v)) continue;
            const struct lw_vec4 own = given[v];
            out[3 * (size_t)t + (size_t)k] =
                lw_tangent_encode(mesh->normal[v], lw_vec3(own.x, own.y, own.z), own.w < 0);
        }
}

enum lw_status lw_mesh_tangents_build(struct lw_scene *scene, struct lw_mesh *mesh, struct lw_vec4 *given,
                                      uint64_t *out_bad, struct lw_error *err) {
    const uint32_t faces = count_faces(scene, mesh);
    bool whole = false;
    mesh->tangent = NULL;
    if (!faces) return LW_OK;
    uint16_t *tangent = lw_scene_alloc(scene, 3 * (size_t)mesh->triangle_count, sizeof *tangent);
    if (!tangent) return no_memory(err);
    if (given && check_given(scene, mesh, given, &whole, out_bad, err)) return err->status;
    if (!whole && compute(scene, mesh, faces, tangent, err)) return err->status;
    take_given(scene, mesh, given, tangent);
    mesh->tangent = tangent;
    return LW_OK;
}
