#include "common/light/light_tree.h"

#include <stdlib.h>

/* Angles, rad, and cosines are rounded; what is this near to the edge of a cone counts as within. */
#define SLACK        1e-3f
#define COSINE_SLACK 2e-3f

struct lw_light_node {
    struct lw_light_bounds bounds;
    float cos_spread, sin_spread, cos_reach;
    uint32_t parent;
    uint32_t right; /* of an inner node; the left child is the next node */
    uint32_t light; /* of a leaf; UINT32_MAX: an inner node */
};

static struct lw_vec3 least(struct lw_vec3 a, struct lw_vec3 b) {
    return lw_vec3(fminf(a.x, b.x), fminf(a.y, b.y), fminf(a.z, b.z));
}
static struct lw_vec3 most(struct lw_vec3 a, struct lw_vec3 b) {
    return lw_vec3(fmaxf(a.x, b.x), fmaxf(a.y, b.y), fmaxf(a.z, b.z));
}
static float angle(struct lw_vec3 a, struct lw_vec3 b) {
    return acosf(fminf(fmaxf(lw_vec3_dot(a, b), -1), 1));
}

/* The cone about both cones, where that is less than all directions. */
static void join_cones(const struct lw_light_bounds *a, const struct lw_light_bounds *b,
                       struct lw_light_bounds *out) {
    if (b->spread > a->spread) {
        const struct lw_light_bounds *wider = b;
        b = a;
        a = wider;
    }
    out->reach = fmaxf(a->reach, b->reach);
    out->axis = a->axis;
    out->spread = a->spread;
    float between = angle(a->axis, b->axis);
    if (fminf(between + b->spread, LW_PI) <= a->spread) return;
    out->spread = 0.5f * (a->spread + between + b->spread) + SLACK;
    struct lw_vec3 aside = lw_vec3_mad(b->axis, a->axis, -lw_vec3_dot(a->axis, b->axis));
    if (out->spread >= LW_PI || lw_vec3_dot(aside, aside) < 1e-8f) {
        out->spread = LW_PI;
        return;
    }
    float turn = out->spread - a->spread;
    out->axis = lw_vec3_normalize(
        lw_vec3_mad(lw_vec3_scale(a->axis, cosf(turn)), lw_vec3_normalize(aside), sinf(turn)));
    out->spread += SLACK;
}

static struct lw_light_bounds join(const struct lw_light_bounds *a, const struct lw_light_bounds *b) {
    if (!(a->power > 0)) return *b;
    if (!(b->power > 0)) return *a;
    struct lw_light_bounds both = {.low = least(a->low, b->low), .high = most(a->high, b->high)};
    join_cones(a, b, &both);
    both.power = a->power + b->power;
    return both;
}

struct build {
    struct lw_light_tree *tree;
    const struct lw_light_bounds *light;
    uint32_t *order, next;
};

struct key {
    const struct lw_light_bounds *light;
    int axis;
};

static float middle(const struct lw_light_bounds *l, int axis) {
    struct lw_vec3 m = lw_vec3_add(l->low, l->high);
    return axis == 0 ? m.x : axis == 1 ? m.y : m.z;
}

static int by_middle(const void *a, const void *b, void *context) {
    const struct key *key = context;
    const uint32_t i = *(const uint32_t *)a, j = *(const uint32_t *)b;
    float x = middle(&key->light[i], key->axis), y = middle(&key->light[j], key->axis);
    return x < y ? -1 : x > y ? 1 : i < j ? -1 : i > j; /* the same order on every machine */
}

/* Halves along the longest side of the middles' box. */
static uint32_t build(struct build *b, uint32_t first, uint32_t count, uint32_t parent) {
    const uint32_t index = b->next++;
    struct lw_light_node *node = &b->tree->node[index];
    *node = (struct lw_light_node){.parent = parent, .light = UINT32_MAX};
    if (count == 1) {
        node->light = b->order[first];
        b->tree->leaf[node->light] = index;
        return index;
    }
    struct lw_vec3 low = lw_vec3(INFINITY, INFINITY, INFINITY),
                   high = lw_vec3(-INFINITY, -INFINITY, -INFINITY);
    for (uint32_t i = first; i < first + count; i++) {
        const struct lw_light_bounds *l = &b->light[b->order[i]];
        struct lw_vec3 m = lw_vec3_add(l->low, l->high);
        low = least(low, m), high = most(high, m);
    }
    struct lw_vec3 side = lw_vec3_sub(high, low);
    struct key key = {b->light, side.x >= side.y && side.x >= side.z ? 0 : side.y >= side.z ? 1 : 2};
    qsort_r(b->order + first, count, sizeof *b->order, by_middle, &key);
    build(b, first, count / 2, index);
    node->right = build(b, first + count / 2, count - count / 2, index);
    return index;
}

void lw_light_tree_refit(struct lw_light_tree *tree, const struct lw_light_bounds *light) {
    for (uint32_t i = 2 * tree->count - 1; i-- > 0;) {
        struct lw_light_node *node = &tree->node[i];
        node->bounds = node->light != UINT32_MAX ? light[node->light]
                                                 : join(&node[1].bounds, &tree->node[node->right].bounds);
        node->cos_spread = cosf(node->bounds.spread);
        node->sin_spread = sinf(node->bounds.spread);
        node->cos_reach = cosf(node->bounds.reach);
    }
}

enum lw_status lw_light_tree_init(struct lw_light_tree *tree, const struct lw_light_bounds *light,
                                  uint32_t count) {
    *tree = (struct lw_light_tree){.count = count};
    uint32_t *order = malloc(count * sizeof *order);
    tree->node = calloc(2ul * count, sizeof *tree->node);
    tree->leaf = calloc(count, sizeof *tree->leaf);
    if (!order || !tree->node || !tree->leaf) {
        free(order);
        lw_light_tree_finish(tree);
        return LW_NO_MEMORY;
    }
    for (uint32_t i = 0; i < count; i++) order[i] = i;
    build(&(struct build){.tree = tree, .light = light, .order = order}, 0, count, UINT32_MAX);
    free(order);
    lw_light_tree_refit(tree, light);
    return LW_OK;
}

void lw_light_tree_finish(struct lw_light_tree *tree) {
    free(tree->leaf);
    free(tree->node);
    *tree = (struct lw_light_tree){0};
}

/* Cosine of max(0, a - b), for a and b within [0, pi]. */
static float cos_of_rest(float cos_a, float sin_a, float cos_b, float sin_b) {
    return cos_a >= cos_b ? 1 : cos_a * cos_b + sin_a * sin_b;
}
static float sine_of(float cosine) { return sqrtf(fmaxf(0, 1 - cosine * cosine)); }

/* What a group may give: power x cos x cos' / d^2, with the angles that favour it most. 0 only where it gives nothing. */
static float importance(const struct lw_light_node *node, struct lw_vec3 point, struct lw_vec3 normal) {
    const struct lw_light_bounds *b = &node->bounds;
    if (!(b->power > 0)) return 0;
    struct lw_vec3 to = lw_vec3_sub(lw_vec3_scale(lw_vec3_add(b->low, b->high), 0.5f), point);
    struct lw_vec3 half = lw_vec3_scale(lw_vec3_sub(b->high, b->low), 0.5f);
    float radius2 = lw_vec3_dot(half, half), distance2 = lw_vec3_dot(to, to);
    float floored = fmaxf(distance2, fmaxf(radius2, 1e-12f));
    if (distance2 <= radius2 * 1.0001f + 1e-12f) return b->power / floored; /* within: all directions */
    /* the angle that the group's ball fills, seen from the point, is taken off both */
    float sin_seen2 = radius2 / distance2, sin_seen = sqrtf(sin_seen2),
          cos_seen = sqrtf(fmaxf(0, 1 - sin_seen2));
    struct lw_vec3 direction = lw_vec3_scale(to, 1 / sqrtf(distance2));
    float cosine = lw_vec3_dot(direction, normal);
    float at_point = cos_of_rest(cosine, sine_of(cosine), cos_seen, sin_seen);
    cosine = -lw_vec3_dot(direction, b->axis);
    cosine = cos_of_rest(cosine, sine_of(cosine), node->cos_spread, node->sin_spread);
    float at_light = cos_of_rest(cosine, sine_of(cosine), cos_seen, sin_seen);
    if (at_point < -COSINE_SLACK || at_light < node->cos_reach - COSINE_SLACK) return 0;
    /* a cone narrower than a half space is a spot's: it does not dim by the cosine */
    float facing = b->reach < 0.5f * LW_PI ? 1 : at_light;
    return b->power * fmaxf(at_point, 1e-3f) * fmaxf(facing, 1e-3f) / floored;
}

float lw_light_tree_promise(const struct lw_light_tree *tree, struct lw_vec3 point_ws,
                            struct lw_vec3 normal_ws) {
    return importance(&tree->node[0], point_ws, normal_ws);
}

/* Probability of the left one of a node's children; below 0: neither can give anything. */
static float probability_of_left(const struct lw_light_tree *tree, uint32_t index, struct lw_vec3 point,
                                 struct lw_vec3 normal) {
    float left = importance(&tree->node[index + 1], point, normal);
    float right = importance(&tree->node[tree->node[index].right], point, normal);
    return left + right > 0 ? left / (left + right) : -1;
}

uint32_t lw_light_tree_choose(const struct lw_light_tree *tree, struct lw_vec3 point_ws,
                              struct lw_vec3 normal_ws, float pick, float *out_probability) {
    float probability = 1;
    uint32_t i = 0;
    while (tree->node[i].light == UINT32_MAX) {
        float left = probability_of_left(tree, i, point_ws, normal_ws);
        if (left < 0) return UINT32_MAX;
        if (pick < left) {
            pick = fminf(pick / left, 0x1.fffffep-1f);
            probability *= left;
            i = i + 1;
        } else {
            pick = fminf((pick - left) / (1 - left), 0x1.fffffep-1f);
            probability *= 1 - left;
            i = tree->node[i].right;
        }
    }
    *out_probability = probability;
    return tree->node[i].light;
}

float lw_light_tree_probability(const struct lw_light_tree *tree, struct lw_vec3 point_ws,
                                struct lw_vec3 normal_ws, uint32_t light) {
    float probability = 1;
    for (uint32_t i = tree->leaf[light]; i != 0; i = tree->node[i].parent) {
        uint32_t parent = tree->node[i].parent;
        float left = probability_of_left(tree, parent, point_ws, normal_ws);
        if (left < 0) return 0;
        probability *= i == parent + 1 ? left : 1 - left;
    }
    return probability;
}
