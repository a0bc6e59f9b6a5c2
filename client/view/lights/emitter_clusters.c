#include "client/view/lights/emitter_clusters.h"

#include "client/view/lights/emitter_triangle.h"
#include "common/base/box.h"
#include "common/base/cdf.h"
#include "common/base/colour.h"
#include "common/base/random.h"
#include "common/base/wide.h"
#include "common/light/light_kernels.h"

#include <stdlib.h>
#include <string.h>

#define LANES  16
#define FACETS LW_EMITTER_CLUSTERS_FACETS_MAX
#define MAP    LW_EMITTER_CLUSTERS_MAP

/* Pieces of an object that share a box of this side are one lamp. */
#define TOGETHER_M 0.4f
/* From FAR radii on a cluster is a point; nearer it is its facets or triangles, and from NEAR_SHARE of that
 * distance on it fades over to a point. Triangles know which part of them is above a surface's horizon, so
 * they go farther. */
#define FAR_RADII           5.0f
#define FAR_RADII_TRIANGLES 10.0f
#define NEAR_SHARE          0.6f
/* From afar, what stands within this many radii of a cluster's centre is part of it. */
#define REACH_RADII 1.5f

#define POINTS     LW_EMITTER_CLUSTERS_POINTS
#define DIRECTIONS ((MAP + 1) * (MAP + 1))

/* ---- finding clusters ---- */

/* A corner of an emitter, to find those that share it. */
struct corner {
    uint32_t object, material, emitter;
    float x, y, z; /* object space */
};

struct search {
    const struct lw_lights *lights;
    uint32_t *emitter, count; /* all, to be sorted by their roots */
    uint32_t *parent;         /* per emitter: of a forest whose trees are clusters */
    struct corner *corner;
};

static const struct lw_mesh *mesh_of(const struct lw_lights *lights, uint32_t emitter) {
    const struct lw_scene *scene = lights->scene;
    return &scene->mesh[scene->object[lights->emitter[emitter].object].mesh];
}

static uint32_t material_of(const struct lw_lights *lights, uint32_t emitter) {
    return mesh_of(lights, emitter)->material[lights->emitter[emitter].triangle];
}

static uint32_t root_of(uint32_t *parent, uint32_t i) {
    while (parent[i] != i) i = parent[i] = parent[parent[i]];
    return i;
}

static void unite(uint32_t *parent, uint32_t a, uint32_t b) {
    a = root_of(parent, a), b = root_of(parent, b);
    if (a < b)
        parent[b] = a;
    else
        parent[a] = b;
}

#define ORDER(a, b) ((a) < (b) ? -1 : (a) > (b))

static int by_place(const void *left, const void *right) {
    const struct corner *a = left, *b = right;
    int order = ORDER(a->object, b->object);
    if (!order) order = ORDER(a->material, b->material);
    if (!order) order = ORDER(a->x, b->x);
    if (!order) order = ORDER(a->y, b->y);
    if (!order) order = ORDER(a->z, b->z);
    return order ? order : ORDER(a->emitter, b->emitter);
}

static bool is_one_place(const struct corner *a, const struct corner *b) {
    return a->object == b->object && a->material == b->material && a->x == b->x && a->y == b->y &&
           a->z == b->z;
}

static void join_neighbours(struct search *s, size_t corners) {
    qsort(s->corner, corners, sizeof *s->corner, by_place);
    for (size_t i = 1; i < corners; i++)
        if (is_one_place(&s->corner[i - 1], &s->corner[i]))
            unite(s->parent, s->corner[i - 1].emitter, s->corner[i].emitter);
}

/* Triangles that touch. */
static void join_touching(struct search *s) {
    size_t n = 0;
    for (uint32_t i = 0; i < s->count; i++) {
        const uint32_t e = s->emitter[i];
        const struct lw_mesh *mesh = mesh_of(s->lights, e);
        for (int k = 0; k < 3; k++) {
            const struct lw_vec3 p = mesh->position[mesh->triangle[s->lights->emitter[e].triangle][k]];
            s->corner[n++] =
                (struct corner){s->lights->emitter[e].object, material_of(s->lights, e), e, p.x, p.y, p.z};
        }
    }
    join_neighbours(s, n);
}

static struct lw_vec3 emitter_corner(const struct lw_emitter *e, int k) {
    return k == 0 ? e->corner : lw_vec3_add(e->corner, k == 1 ? e->edge_u : e->edge_v);
}

/* Small pieces that share a cell of a grid. */
static void join_close(struct search *s, struct lw_box *box) {
    const struct lw_lights *lights = s->lights;
    size_t n = 0;
    for (uint32_t i = 0; i < s->count; i++) box[root_of(s->parent, s->emitter[i])] = LW_BOX_EMPTY;
    for (uint32_t i = 0; i < s->count; i++)
        for (int k = 0; k < 3; k++)
            lw_box_add_point(&box[root_of(s->parent, s->emitter[i])],
                             emitter_corner(&lights->emitter[s->emitter[i]], k));
    for (uint32_t i = 0; i < s->count; i++) {
        const uint32_t e = s->emitter[i];
        const struct lw_vec3 side = lw_box_size(&box[e]), middle = lw_box_middle(&box[e]);
        if (s->parent[e] != e || !(lw_vec3_max_abs(side) <= TOGETHER_M)) continue;
        s->corner[n++] = (struct corner){
            lights->emitter[e].object,     material_of(lights, e),        e,
            floorf(middle.x / TOGETHER_M), floorf(middle.y / TOGETHER_M), floorf(middle.z / TOGETHER_M)};
    }
    join_neighbours(s, n);
}

/* ---- facets ---- */

static struct lw_vec3 normal_of(const struct lw_emitter_clusters *c, const struct lw_emitter_side *side) {
    return lw_vec3_scale(c->lights->emitter[side->emitter].normal, side->flipped ? -1.0f : 1.0f);
}

static struct lw_vec3 middle_of(const struct lw_emitter *e) {
    return lw_vec3_mad(e->corner, lw_vec3_add(e->edge_u, e->edge_v), 1.0f / 3);
}

static float luminance_of(const struct lw_lights *lights, uint32_t emitter) {
    const float l = lw_colour_luminance(lights->radiance[emitter]);
    return lights->emitter[emitter].power > 0 && l > 0 && l < INFINITY ? l : 0;
}

/* Sides to be divided: by where they lie and where they face, whichever differs most. */
struct key {
    const struct lw_emitter_clusters *clusters;
    float place_weight;
    int axis;
};

static float key_of(const struct key *key, const struct lw_emitter_side *side) {
    const struct lw_vec3 v =
        key->axis < 3
            ? lw_vec3_scale(middle_of(&key->clusters->lights->emitter[side->emitter]), key->place_weight)
            : normal_of(key->clusters, side);
    const int axis = key->axis % 3;
    return axis == 0 ? v.x : axis == 1 ? v.y : v.z;
}

static int by_key(const void *left, const void *right, void *context) {
    const struct lw_emitter_side *a = left, *b = right;
    const float x = key_of(context, a), y = key_of(context, b);
    const int order = ORDER(x, y);
    if (order) return order;
    return a->emitter != b->emitter ? ORDER(a->emitter, b->emitter) : (int)a->flipped - (int)b->flipped;
}

/* Distance of a facet's sides along an axis. */
static float spread_of(struct key *key, const struct lw_emitter_facet *facet, int axis) {
    float low = INFINITY, high = -INFINITY;
    key->axis = axis;
    for (uint32_t i = facet->first; i < facet->first + facet->count; i++) {
        const float k = key_of(key, &key->clusters->side[i]);
        low = fminf(low, k), high = fmaxf(high, k);
    }
    return high - low;
}

/* The facet and axis with the widest spread; false: all are single sides. */
static bool find_widest(struct key *key, const struct lw_emitter_cluster *cluster, uint32_t *out_facet,
                        int *out_axis) {
    float widest = 0;
    bool found = false;
    for (uint32_t f = 0; f < cluster->facet_count; f++) {
        if (cluster->facet[f].count < 2) continue;
        for (int axis = 0; axis < 6; axis++) {
            const float spread = spread_of(key, &cluster->facet[f], axis);
            if (found && !(spread > widest)) continue;
            found = true;
            widest = spread;
            *out_facet = f;
            *out_axis = axis;
        }
    }
    return found;
}

static void divide(struct lw_emitter_clusters *clusters, struct lw_emitter_cluster *cluster) {
    struct key key = {.clusters = clusters, .place_weight = 1 / fmaxf(cluster->radius_m, 1e-6f)};
    cluster->facet[0] = (struct lw_emitter_facet){.first = cluster->first, .count = cluster->count};
    cluster->facet_count = 1;
    while (cluster->facet_count < FACETS) {
        uint32_t f = 0;
        int axis = 0;
        if (!find_widest(&key, cluster, &f, &axis)) return;
        struct lw_emitter_facet *left = &cluster->facet[f], *right = &cluster->facet[cluster->facet_count++];
        key.axis = axis;
        qsort_r(clusters->side + left->first, left->count, sizeof *clusters->side, by_key, &key);
        const uint32_t half = left->count / 2;
        *right = (struct lw_emitter_facet){.first = left->first + half, .count = left->count - half};
        left->count = half;
    }
}

static struct lw_vec2 between(struct lw_vec2 a, struct lw_vec2 b) {
    return (struct lw_vec2){0.5f * (a.x + b.x), 0.5f * (a.y + b.y)};
}

/* Puts four quarters of a side's part in place of it. */
static void quarter(struct lw_emitter_cluster *cluster, uint32_t f) {
    const struct lw_emitter_facet whole = cluster->facet[f];
    const struct lw_vec2 *c = whole.corner, ab = between(c[0], c[1]), bc = between(c[1], c[2]),
                         ca = between(c[2], c[0]);
    const struct lw_vec2 part[4][3] = {{c[0], ab, ca}, {ab, c[1], bc}, {ca, bc, c[2]}, {ab, bc, ca}};
    for (int k = 0; k < 4; k++) {
        struct lw_emitter_facet *facet = &cluster->facet[k ? cluster->facet_count++ : f];
        *facet = whole;
        memcpy(facet->corner, part[k], sizeof part[k]);
    }
}

/* A panel of few triangles is more than a few points, from nearby: quarters single sides while all of them
 * have room. */
static void quarter_all(struct lw_emitter_cluster *cluster) {
    static const struct lw_vec2 whole[3] = {{0, 0}, {1, 0}, {0, 1}};
    for (uint32_t f = 0; f < cluster->facet_count; f++) memcpy(cluster->facet[f].corner, whole, sizeof whole);
    for (;;) {
        uint32_t singles = 0;
        const uint32_t facets = cluster->facet_count;
        for (uint32_t f = 0; f < facets; f++) singles += cluster->facet[f].count == 1;
        if (!singles || facets + 3 * singles > FACETS) return;
        for (uint32_t f = 0; f < facets; f++)
            if (cluster->facet[f].count == 1) quarter(cluster, f);
    }
}

/* Its share of a side that it is only a part of. */
static float part_area(const struct lw_emitter_facet *facet) {
    const struct lw_vec2 *c = facet->corner;
    return fabsf(lw_vec2_twice_area(c[0], c[1], c[2]));
}

static struct lw_vec2 within_part(const struct lw_emitter_facet *facet, struct lw_vec2 b) {
    const struct lw_vec2 *c = facet->corner;
    return (struct lw_vec2){c[0].x + (c[1].x - c[0].x) * b.x + (c[2].x - c[0].x) * b.y,
                            c[0].y + (c[1].y - c[0].y) * b.x + (c[2].y - c[0].y) * b.y};
}

static void place_facet(struct lw_emitter_clusters *clusters, struct lw_emitter_facet *facet) {
    const float part = part_area(facet);
    const struct lw_vec2 middle = within_part(facet, (struct lw_vec2){1.0f / 3, 1.0f / 3});
    struct lw_vec3 centre = {0}, normal = {0};
    float power = 0, area = 0;
    for (uint32_t i = facet->first; i < facet->first + facet->count; i++) {
        struct lw_emitter_side *side = &clusters->side[i];
        const struct lw_emitter *e = &clusters->lights->emitter[side->emitter];
        const float luminance = luminance_of(clusters->lights, side->emitter), p = luminance * e->area_m2;
        if (p > 0 && p < INFINITY) {
            power += p;
            area += e->area_m2;
            centre = lw_vec3_mad(centre, lw_light_to_emitter(e, lw_vec3(0, 0, 0), middle), p);
            normal = lw_vec3_mad(normal, normal_of(clusters, side), p);
        }
        side->cumulative = power;
    }
    const bool shines = power > 0 && power < INFINITY;
    facet->power = shines ? power * part : 0;
    facet->soft_m2 = shines ? area * part / LW_PI : 1;
    facet->centre = shines ? lw_vec3_scale(centre, 1 / power) : lw_vec3(0, 0, 0);
    facet->normal = lw_vec3_normalize(normal);
}

static void place_triangles(const struct lw_emitter_clusters *clusters, struct lw_emitter_cluster *cluster) {
    cluster->triangle_count = cluster->count <= FACETS ? cluster->count : 0;
    for (uint32_t i = 0; i < cluster->triangle_count; i++) {
        const struct lw_emitter_side *side = &clusters->side[cluster->first + i];
        const struct lw_emitter *e = &clusters->lights->emitter[side->emitter];
        struct lw_emitter_triangle *t = &cluster->triangle[i];
        const bool turned = lw_vec3_dot(lw_vec3_cross(e->edge_u, e->edge_v), normal_of(clusters, side)) < 0;
        for (int k = 0; k < 3; k++) t->corner[k] = emitter_corner(e, turned ? 2 - k : k);
        t->luminance = luminance_of(clusters->lights, side->emitter);
    }
}

/* ---- the map of intensity ---- */

/* Where a direction lies in the map, in steps. */
LW_WIDE_INLINE void map_place(struct lw_vec3 d, float *x, float *y) {
    const float scale = 1 / (fabsf(d.x) + fabsf(d.y) + fabsf(d.z) + 1e-30f);
    const float a = d.x * scale, b = d.y * scale;
    const float fold_a = copysignf(1 - fabsf(b), a), fold_b = copysignf(1 - fabsf(a), b);
    *x = (0.5f + 0.5f * (d.z < 0 ? fold_a : a)) * MAP;
    *y = (0.5f + 0.5f * (d.z < 0 ? fold_b : b)) * MAP;
}

static struct lw_vec3 map_direction(float x, float y) {
    const float a = 2 * x / MAP - 1, b = 2 * y / MAP - 1;
    struct lw_vec3 d = lw_vec3(a, b, 1 - fabsf(a) - fabsf(b));
    if (d.z < 0) {
        d.x = (1 - fabsf(b)) * (a < 0 ? -1.0f : 1.0f);
        d.y = (1 - fabsf(a)) * (b < 0 ? -1.0f : 1.0f);
    }
    return lw_vec3_normalize(d);
}

static float side_power(const struct lw_emitter_clusters *clusters, const struct lw_emitter_side *side) {
    const float power =
        luminance_of(clusters->lights, side->emitter) * clusters->lights->emitter[side->emitter].area_m2;
    return power > 0 && power < INFINITY ? power : 0;
}

/* Directions in rows: of the map's steps, or of the middles of its cells. */
static void list_directions(uint32_t side, float first, struct lw_vec3 *out) {
    for (uint32_t k = 0; k < side * side; k++)
        out[k] = map_direction((float)(k % side) + first, (float)(k / side) + first);
}

/* n: the normal of a side, as long as its power */
static void add_side(struct lw_vec3 n, const struct lw_vec3 *direction, uint32_t count, float *shine) {
    for (uint32_t k = 0; k < count; k++) {
        const float cosine = lw_vec3_dot(n, direction[k]);
        shine[k] += cosine > 0 ? cosine : 0;
    }
}

/* The map is bilinear, but intensity is curved: a panel's is 1 % higher in the middle of a cell than the mean
 * of its corners. Returns the factor by which the mean over the whole map is right, by Simpson's rule in each
 * cell.
 * step    intensity at the steps
 * middle  in the middles of cells */
static float find_gain(const float step[DIRECTIONS], const float middle[MAP * MAP]) {
    double between = 0, mean = 0;
    for (uint32_t k = 0; k < MAP * MAP; k++) {
        const float *at = &step[k / MAP * (MAP + 1) + k % MAP];
        between += (double)middle[k];
        mean += 0.25 * (double)(at[0] + at[1] + at[MAP + 1] + at[MAP + 2]);
    }
    return mean > 0 ? (float)((1 + 2 * between / mean) / 3) : 1;
}

static void fill_map(const struct lw_emitter_clusters *clusters, struct lw_emitter_cluster *cluster) {
    struct lw_vec3 direction[DIRECTIONS], middle[MAP * MAP];
    float of_middle[MAP * MAP] = {0};
    memset(cluster->map, 0, sizeof cluster->map);
    list_directions(MAP + 1, 0, direction);
    list_directions(MAP, 0.5f, middle);
    for (uint32_t i = cluster->first; i < cluster->first + cluster->count; i++) {
        const struct lw_emitter_side *side = &clusters->side[i];
        const struct lw_vec3 n = lw_vec3_scale(normal_of(clusters, side), side_power(clusters, side));
        add_side(n, direction, DIRECTIONS, cluster->map);
        add_side(n, middle, MAP * MAP, of_middle);
    }
    const float gain = find_gain(cluster->map, of_middle);
    for (uint32_t k = 0; k < DIRECTIONS; k++) cluster->map[k] *= gain;
    cluster->intensity = 0;
    for (uint32_t k = 0; k < DIRECTIONS; k++) cluster->intensity = fmaxf(cluster->intensity, cluster->map[k]);
    if (!(cluster->intensity < INFINITY)) cluster->intensity = 0;
}

/* Places on the cluster, each for as much power: sides follow each other facet by facet, so that neighbours
 * in this list are neighbours on the cluster. */
static void spread_points(const struct lw_emitter_clusters *clusters, struct lw_emitter_cluster *cluster) {
    float power = 0, running = 0;
    for (uint32_t i = cluster->first; i < cluster->first + cluster->count; i++)
        power += side_power(clusters, &clusters->side[i]);
    uint32_t n = 0;
    for (uint32_t i = cluster->first; i < cluster->first + cluster->count; i++) {
        const struct lw_emitter_side *side = &clusters->side[i];
        running += side_power(clusters, side);
        while (n < POINTS && ((float)n + 0.5f) / POINTS * power <= running) {
            float at[2];
            lw_random_sobol2(n, cluster->first, at);
            cluster->normal[n] = normal_of(clusters, side);
            cluster->point[n++] = lw_light_to_emitter(&clusters->lights->emitter[side->emitter],
                                                      lw_vec3(0, 0, 0), lw_light_by_area(at[0], at[1]));
        }
    }
    for (; n < POINTS; n++) { /* for a cluster that does not shine, and past the end by rounding */
        cluster->point[n] = n ? cluster->point[n - 1] : cluster->centre;
        cluster->normal[n] = n ? cluster->normal[n - 1] : lw_vec3(0, 0, 1);
    }
}

/* Where a ray from a point within a ball around the origin leaves it; unit direction. */
static float way_out(struct lw_vec3 from, struct lw_vec3 direction, float radius) {
    const float along = lw_vec3_dot(from, direction);
    const float left = along * along - lw_vec3_dot(from, from) + radius * radius;
    return left > 0 ? sqrtf(left) - along : 0;
}

/* Takes out of the map what the cluster's surroundings keep back. */
static void shade_map(struct lw_emitter_cluster *cluster, const struct lw_trace *trace) {
    const float largest = lw_vec3_max_abs(cluster->centre) + cluster->radius_m;
    struct lw_ray16 rays = {.salt = 0};
    for (uint32_t k = 0; k < DIRECTIONS; k++) {
        const struct lw_vec3 direction = map_direction((float)(k % (MAP + 1)), (float)(k / (MAP + 1)));
        float all = 0, seen = 0;
        for (uint32_t first = 0; first < POINTS && cluster->map[k] > 0; first += LANES) {
            float cosine[LANES];
            uint16_t active = 0;
            for (uint32_t i = 0; i < LANES; i++) {
                const struct lw_vec3 normal = cluster->normal[first + i];
                const struct lw_vec3 from = lw_trace_lift(cluster->point[first + i], normal, largest);
                cosine[i] = lw_vec3_dot(normal, direction);
                if (!(cosine[i] > 0)) continue;
                all += cosine[i];
                lw_trace_set_ray(&rays, i, from, direction,
                                 way_out(lw_vec3_sub(from, cluster->centre), direction, cluster->reach_m));
                active |= (uint16_t)(1u << i);
            }
            if (!active) continue;
            rays.salt = first;
            const uint16_t occluded = lw_trace_occluded16(trace, LW_TRACE_COHERENT, active, &rays);
            for (uint32_t i = 0; i < LANES; i++)
                if ((active & ~occluded) >> i & 1u) seen += cosine[i];
        }
        if (all > 0) cluster->map[k] *= seen / all;
    }
}

/* ---- a cluster ---- */

static void enclose(const struct lw_emitter_clusters *clusters, struct lw_emitter_cluster *cluster) {
    struct lw_box box = LW_BOX_EMPTY;
    const struct lw_lights *lights = clusters->lights;
    for (uint32_t i = cluster->first; i < cluster->first + cluster->count; i++)
        for (int k = 0; k < 3; k++)
            lw_box_add_point(&box, emitter_corner(&lights->emitter[clusters->side[i].emitter], k));
    cluster->centre = lw_box_middle(&box);
    cluster->radius_m = lw_box_radius(&box);
}

static void colour_cluster(const struct lw_emitter_clusters *clusters, struct lw_emitter_cluster *cluster) {
    struct lw_vec3 sum = {0};
    for (uint32_t i = cluster->first; i < cluster->first + cluster->count; i++) {
        const uint32_t e = clusters->side[i].emitter;
        if (luminance_of(clusters->lights, e) > 0)
            sum = lw_vec3_mad(sum, clusters->lights->radiance[e], clusters->lights->emitter[e].area_m2);
    }
    const float luminance = lw_colour_luminance(sum);
    cluster->colour =
        luminance > 0 && luminance < INFINITY ? lw_vec3_scale(sum, 1 / luminance) : lw_vec3(0, 0, 0);
}

void lw_emitter_clusters_place(struct lw_emitter_clusters *clusters, uint32_t index,
                               const struct lw_trace *trace) {
    struct lw_emitter_cluster *cluster = &clusters->cluster[index];
    enclose(clusters, cluster);
    cluster->reach_m = REACH_RADII * cluster->radius_m;
    colour_cluster(clusters, cluster);
    for (uint32_t f = 0; f < cluster->facet_count; f++) place_facet(clusters, &cluster->facet[f]);
    place_triangles(clusters, cluster);
    spread_points(clusters, cluster);
    fill_map(clusters, cluster);
    memcpy(cluster->open, cluster->map, sizeof cluster->open);
    if (cluster->intensity > 0) shade_map(cluster, trace);
}

static int by_root(const void *left, const void *right, void *context) {
    const uint32_t a = *(const uint32_t *)left, b = *(const uint32_t *)right, *parent = context;
    const int order = ORDER(parent[a], parent[b]);
    return order ? order : ORDER(a, b);
}

/* Cuts the emitters, sorted by their roots, into clusters. */
static void cut(struct lw_emitter_clusters *clusters, const struct search *s) {
    uint32_t n = 0;
    for (uint32_t i = 0; i < s->count; i++) {
        const uint32_t e = s->emitter[i];
        if (i == 0 || s->parent[e] != s->parent[s->emitter[i - 1]])
            clusters->cluster[clusters->count++] = (struct lw_emitter_cluster){.first = n};
        for (int k = 0; k < (clusters->lights->emitter[e].both_sides ? 2 : 1); k++)
            clusters->side[n++] = (struct lw_emitter_side){.emitter = e, .flipped = k == 1};
        struct lw_emitter_cluster *last = &clusters->cluster[clusters->count - 1];
        last->count = n - last->first;
    }
    for (uint32_t i = 0; i < clusters->count; i++) {
        enclose(clusters, &clusters->cluster[i]);
        divide(clusters, &clusters->cluster[i]);
        quarter_all(&clusters->cluster[i]);
    }
}

enum lw_status lw_emitter_clusters_init(struct lw_emitter_clusters *clusters,
                                        const struct lw_lights *lights) {
    *clusters = (struct lw_emitter_clusters){.lights = lights};
    const size_t count = lights->emitter_count + 1ul;
    enum lw_status status = LW_NO_MEMORY;
    struct search s = {.lights = lights, .count = lights->emitter_count};
    struct lw_box *box = malloc(count * sizeof *box);
    s.emitter = malloc(count * sizeof *s.emitter);
    s.parent = malloc(count * sizeof *s.parent);
    s.corner = malloc(3 * count * sizeof *s.corner);
    clusters->side = malloc(2 * count * sizeof *clusters->side);
    if (box && s.emitter && s.parent && s.corner && clusters->side) {
        for (uint32_t e = 0; e < s.count; e++) s.parent[e] = s.emitter[e] = e;
        join_touching(&s);
        join_close(&s, box);
        uint32_t roots = 0;
        for (uint32_t i = 0; i < s.count; i++) {
            s.parent[s.emitter[i]] = root_of(s.parent, s.emitter[i]);
            roots += s.parent[s.emitter[i]] == s.emitter[i];
        }
        qsort_r(s.emitter, s.count, sizeof *s.emitter, by_root, s.parent);
        clusters->cluster = malloc((roots + 1ul) * sizeof *clusters->cluster);
        if (clusters->cluster) {
            cut(clusters, &s);
            status = LW_OK;
        }
    }
    free(s.corner);
    free(s.parent);
    free(s.emitter);
    free(box);
    if (status != LW_OK) lw_emitter_clusters_finish(clusters);
    return status;
}

void lw_emitter_clusters_finish(struct lw_emitter_clusters *clusters) {
    free(clusters->cluster);
    free(clusters->side);
    *clusters = (struct lw_emitter_clusters){0};
}

/* ---- its light ---- */

LW_WIDE_INLINE float far_m2(const struct lw_emitter_cluster *cluster) {
    const float m = (cluster->triangle_count ? FAR_RADII_TRIANGLES : FAR_RADII) * cluster->radius_m;
    return m * m > 1e-12f ? m * m : 1e-12f;
}

/* Where sixteen directions lie in the map: whole steps, below the last, and the fractions beyond
 * them; and E over the intensity. A loop by itself: with the reads in it, it is no vectors. */
LW_WIDE static void aim_map(struct lw_vec3 centre, const struct lw_points16 *restrict at, float *restrict u,
                            float *restrict v, int *restrict cell, float *restrict scale) {
    for (int i = 0; i < LANES; i++) {
        const struct lw_vec3 from = lw_vec3(at->x[i] - centre.x, at->y[i] - centre.y, at->z[i] - centre.z);
        const float d2 = lw_vec3_dot(from, from) + 1e-20f;
        const float facing = -(from.x * at->nx[i] + from.y * at->ny[i] + from.z * at->nz[i]);
        float x, y;
        map_place(from, &x, &y);
        /* not negative, and no more than MAP */
        const int last = (int)MAP - 1, a = (int)x < last ? (int)x : last, b = (int)y < last ? (int)y : last;
        u[i] = x - (float)a, v[i] = y - (float)b;
        cell[i] = b * ((int)MAP + 1) + a;
        scale[i] = facing > 0 ? facing / (d2 * sqrtf(d2)) : 0;
    }
}

/* Bilinear, from one cell of the map for all. */
LW_WIDE static void read_cell(const float *restrict at, const float *restrict u, const float *restrict v,
                              const float *restrict scale, float *restrict out) {
    const float a = at[0], b = at[1], c = at[MAP + 1], d = at[MAP + 2];
    for (int i = 0; i < LANES; i++)
        out[i] = ((1 - v[i]) * ((1 - u[i]) * a + u[i] * b) + v[i] * ((1 - u[i]) * c + u[i] * d)) * scale[i];
}

LW_WIDE static void read_cells(const float *restrict map, const int *restrict cell, const float *restrict u,
                               const float *restrict v, const float *restrict scale, float *restrict out) {
    for (int i = 0; i < LANES; i++) {
        const float *at = map + cell[i];
        out[i] = ((1 - v[i]) * ((1 - u[i]) * at[0] + u[i] * at[1]) +
                  v[i] * ((1 - u[i]) * at[MAP + 1] + u[i] * at[MAP + 2])) *
                 scale[i];
    }
}

static void light_far(const struct lw_emitter_cluster *cluster, const float *map,
                      const struct lw_points16 *at, float *out) {
    float u[LANES], v[LANES], scale[LANES];
    int cell[LANES], differ = 0;
    aim_map(cluster->centre, at, u, v, cell, scale);
    for (int i = 1; i < LANES; i++) differ |= cell[i] ^ cell[0];
    if (differ)
        read_cells(map, cell, u, v, scale, out);
    else
        read_cell(map + cell[0], u, v, scale, out);
}

/* A facet is as bright as a disc of its area that faces the point: E = L A cos cos' / (d^2 + A / pi), at
 * most pi L. */
LW_WIDE_INLINE float facet_light(const struct lw_emitter_facet *f, struct lw_vec3 point,
                                 struct lw_vec3 normal) {
    const struct lw_vec3 to = lw_vec3_sub(f->centre, point);
    const float d2 = lw_vec3_dot(to, to) + 1e-20f;
    const float facing = lw_vec3_dot(to, normal), shining = -lw_vec3_dot(to, f->normal);
    const float e = f->power * facing * shining / (d2 * (d2 + f->soft_m2));
    return facing > 0 && shining > 0 ? e : 0;
}

LW_WIDE static void light_by_triangles(const struct lw_emitter_cluster *cluster,
                                       const struct lw_points16 *restrict at, float *restrict out) {
    for (int i = 0; i < LANES; i++) out[i] = 0;
    for (uint32_t k = 0; k < cluster->triangle_count; k++) {
        const struct lw_emitter_triangle t = cluster->triangle[k];
        for (int i = 0; i < LANES; i++)
            out[i] += t.luminance * lw_emitter_triangle_light(t.corner, lw_vec3(at->x[i], at->y[i], at->z[i]),
                                                              lw_vec3(at->nx[i], at->ny[i], at->nz[i]));
    }
}

LW_WIDE static void light_by_facets(const struct lw_emitter_cluster *cluster,
                                    const struct lw_points16 *restrict at, float *restrict out) {
    for (int i = 0; i < LANES; i++) out[i] = 0;
    for (uint32_t k = 0; k < cluster->facet_count; k++) {
        const struct lw_emitter_facet f = cluster->facet[k];
        for (int i = 0; i < LANES; i++)
            out[i] += facet_light(&f, lw_vec3(at->x[i], at->y[i], at->z[i]),
                                  lw_vec3(at->nx[i], at->ny[i], at->nz[i]));
    }
}

/* Squares of distances from the centre over that from which on the cluster is a point; returns how many
 * are that far. */
LW_WIDE static uint32_t measure_far(const struct lw_emitter_cluster *cluster,
                                    const struct lw_points16 *restrict at, float *restrict far) {
    const struct lw_vec3 c = cluster->centre;
    const float scale = 1 / far_m2(cluster);
    uint32_t count = 0;
    for (int i = 0; i < LANES; i++) {
        const struct lw_vec3 d = lw_vec3(at->x[i] - c.x, at->y[i] - c.y, at->z[i] - c.z);
        far[i] = lw_vec3_dot(d, d) * scale;
        count += far[i] >= 1 ? 1u : 0u;
    }
    return count;
}

LW_WIDE static void mix_near(const float *restrict far, const float *restrict near,
                             const float *restrict open, float *restrict out) {
    for (int i = 0; i < LANES; i++) {
        const float s = (sqrtf(far[i]) - NEAR_SHARE) * (1 / (1 - NEAR_SHARE));
        const float mixed = near[i] + (s > 0 ? s : 0) * (open[i] - near[i]);
        out[i] = far[i] >= 1 ? out[i] : mixed;
    }
}

LW_WIDE static void clean(float *restrict e) {
    for (int i = 0; i < LANES; i++) e[i] = e[i] > 0 && e[i] < FLT_MAX ? e[i] : 0;
}

void lw_emitter_clusters_light16(const struct lw_emitter_cluster *cluster, const struct lw_points16 *points,
                                 float out[16]) {
    float far[LANES], near[LANES], open[LANES];
    const uint32_t count = measure_far(cluster, points, far);
    if (count > 0) light_far(cluster, cluster->map, points, out);
    if (count < LANES) {
        (cluster->triangle_count ? light_by_triangles : light_by_facets)(cluster, points, near);
        light_far(cluster, cluster->open, points, open);
        mix_near(far, near, open, out);
    }
    clean(out);
}

/* A side of a facet that faces the point, by power, from the chosen one on. The rest of u is even in
 * [0, 1). */
static const struct lw_emitter_side *pick_side(const struct lw_emitter_clusters *clusters,
                                               const struct lw_emitter_facet *facet, struct lw_vec3 point,
                                               float *u) {
    const struct lw_emitter_side *side = clusters->side + facet->first;
    const float pick = *u * side[facet->count - 1].cumulative;
    uint32_t low = 0, high = facet->count - 1;
    while (low < high) {
        const uint32_t middle = (low + high) / 2;
        if (side[middle].cumulative > pick)
            high = middle;
        else
            low = middle + 1;
    }
    const float below = low ? side[low - 1].cumulative : 0;
    *u = fminf(fmaxf((pick - below) / (side[low].cumulative - below), 0), LW_LIGHT_BELOW_ONE);
    for (uint32_t i = 0; i < facet->count; i++, low = low + 1 < facet->count ? low + 1 : 0) {
        const struct lw_vec3 to = lw_vec3_sub(clusters->lights->emitter[side[low].emitter].corner, point);
        if (lw_vec3_dot(to, normal_of(clusters, &side[low])) < 0) return &side[low];
    }
    return NULL;
}

static bool aim_near(const struct lw_emitter_clusters *clusters, const struct lw_emitter_cluster *cluster,
                     struct lw_vec3 point, struct lw_vec3 normal, float u, float v, struct lw_vec3 *out) {
    float weight[FACETS], sum = 0;
    for (uint32_t f = 0; f < cluster->facet_count; f++)
        sum += weight[f] = facet_light(&cluster->facet[f], point, normal);
    if (!(sum > 0 && sum < INFINITY)) return false;
    float pick = u * sum;
    uint32_t f = 0;
    while (f + 1 < cluster->facet_count && pick >= weight[f]) pick -= weight[f++];
    while (!(weight[f] > 0)) f--; /* rounding led past the last one that shines */
    u = fminf(pick / weight[f], LW_LIGHT_BELOW_ONE);
    const struct lw_emitter_side *side = pick_side(clusters, &cluster->facet[f], point, &u);
    if (!side) return false;
    const struct lw_vec2 b = within_part(&cluster->facet[f], lw_light_by_area(u, v));
    *out = lw_light_to_emitter(&clusters->lights->emitter[side->emitter], point, b);
    return true;
}

LW_WIDE static void weigh_points(const struct lw_emitter_cluster *cluster, struct lw_vec3 back,
                                 float *restrict out) {
    for (uint32_t k = 0; k < POINTS; k++) {
        const float cosine = lw_vec3_dot(cluster->normal[k], back);
        out[k] = cosine > 0 ? cosine : 0;
    }
}

void lw_emitter_clusters_share(const struct lw_emitter_cluster *cluster, struct lw_vec3 from,
                               float out_share[LW_EMITTER_CLUSTERS_POINTS]) {
    float weight[POINTS], sum = 0;
    weigh_points(cluster, lw_vec3_sub(from, cluster->centre), weight);
    for (uint32_t k = 0; k < POINTS; k++) out_share[k] = sum += weight[k];
    const float scale = sum > 0 && sum < INFINITY ? 1 / sum : 0;
    for (uint32_t k = 0; k < POINTS; k++) out_share[k] *= scale;
    if (scale > 0) out_share[POINTS - 1] = 1;
}

bool lw_emitter_clusters_aim(const struct lw_emitter_clusters *clusters,
                             const struct lw_emitter_cluster *cluster,
                             const float share[LW_EMITTER_CLUSTERS_POINTS], struct lw_vec3 point,
                             struct lw_vec3 normal, float u, float v, struct lw_vec3 *out_way,
                             float *out_end) {
    const struct lw_vec3 from = lw_vec3_sub(point, cluster->centre);
    *out_end = LW_TRACE_SHORT;
    if (lw_vec3_dot(from, from) < far_m2(cluster))
        return aim_near(clusters, cluster, point, normal, u, v, out_way);
    if (!(share[POINTS - 1] > 0)) return false;
    *out_way = lw_vec3_sub(cluster->point[lw_cdf_choose(share, POINTS, u)], point);
    /* where it enters the ball: |from + t way| = reach */
    const float a = lw_vec3_dot(*out_way, *out_way), b = -lw_vec3_dot(from, *out_way),
                c = lw_vec3_dot(from, from) - cluster->reach_m * cluster->reach_m, left = b * b - a * c;
    *out_end = left > 0 ? fminf((b - sqrtf(left)) / a, LW_TRACE_SHORT) : LW_TRACE_SHORT;
    return true;
}
