#include "common/light/light_tree.h"

#include "common/light/light_kernels.h"

#include <assert.h>
#include <stdlib.h>

/* Angles, rad, are rounded: a direction this near to the edge of a cone counts as within. */
#define SLACK 1e-3f

static float angle(struct lw_vec3 a, struct lw_vec3 b) {
    return acosf(fminf(fmaxf(lw_vec3_dot(a, b), -1), 1));
}

/* The cone about both cones, where that is less than all directions. */
static void unite_cones(const struct lw_light_bounds *a, const struct lw_light_bounds *b,
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

static struct lw_light_bounds unite_bounds(const struct lw_light_bounds *a, const struct lw_light_bounds *b) {
    if (!(a->power > 0)) return *b;
    if (!(b->power > 0)) return *a;
    struct lw_light_bounds both = {.low = lw_vec3_min(a->low, b->low), .high = lw_vec3_max(a->high, b->high)};
    unite_cones(a, b, &both);
    both.power = a->power + b->power;
    return both;
}

struct build {
    struct lw_light_tree *tree;
    const struct lw_light_bounds *light;
    uint32_t *order, next;
    uint32_t first_count; /* lights below the root's left child, if there are other lights */
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
    if (index == 0 && b->first_count > 0 && b->first_count < count) {
        build(b, 0, b->first_count, index);
        node->right = build(b, b->first_count, count - b->first_count, index);
        return index;
    }
    struct lw_vec3 low = lw_vec3(INFINITY, INFINITY, INFINITY),
                   high = lw_vec3(-INFINITY, -INFINITY, -INFINITY);
    for (uint32_t i = first; i < first + count; i++) {
        const struct lw_light_bounds *l = &b->light[b->order[i]];
        struct lw_vec3 m = lw_vec3_add(l->low, l->high);
        low = lw_vec3_min(low, m), high = lw_vec3_max(high, m);
    }
    struct lw_vec3 side = lw_vec3_sub(high, low);
    struct key key = {b->light, side.x >= side.y && side.x >= side.z ? 0 : side.y >= side.z ? 1 : 2};
    qsort_r(b->order + first, count, sizeof *b->order, by_middle, &key);
    build(b, first, count / 2, index);
    node->right = build(b, first + count / 2, count - count / 2, index);
    return index;
}

static void summarise(struct lw_light_node *node, const struct lw_light_bounds *b) {
    node->centre = lw_vec3_scale(lw_vec3_add(b->low, b->high), 0.5f);
    node->radius = 0.5f * lw_vec3_length(lw_vec3_sub(b->high, b->low));
    node->power = b->power;
    node->axis = b->axis;
    node->cos_spread = cosf(b->spread);
    node->sin_spread = sinf(b->spread);
    node->cos_reach = cosf(b->reach);
    node->dims = b->reach >= 0.5f * LW_PI;
}

void lw_light_tree_refit(struct lw_light_tree *tree, const struct lw_light_bounds *light) {
    for (uint32_t i = 2 * tree->count - 1; i-- > 0;) {
        struct lw_light_node *node = &tree->node[i];
        tree->bounds[i] = node->light != UINT32_MAX
                              ? light[node->light]
                              : unite_bounds(&tree->bounds[i + 1], &tree->bounds[node->right]);
        summarise(node, &tree->bounds[i]);
    }
}

enum lw_status lw_light_tree_init(struct lw_light_tree *tree, const struct lw_light_bounds *light,
                                  uint32_t count, uint32_t first_count) {
    *tree = (struct lw_light_tree){.count = count};
    uint32_t *order = malloc(count * sizeof *order);
    tree->node = calloc(2ul * count, sizeof *tree->node);
    tree->bounds = calloc(2ul * count, sizeof *tree->bounds);
    tree->leaf = calloc(count, sizeof *tree->leaf);
    if (!order || !tree->node || !tree->bounds || !tree->leaf) {
        free(order);
        lw_light_tree_finish(tree);
        return LW_NO_MEMORY;
    }
    for (uint32_t i = 0; i < count; i++) order[i] = i;
    build(&(struct build){.tree = tree, .light = light, .order = order, .first_count = first_count}, 0, count,
          UINT32_MAX);
    free(order);
    lw_light_tree_refit(tree, light);
    return LW_OK;
}

void lw_light_tree_finish(struct lw_light_tree *tree) {
    free(tree->leaf);
    free(tree->bounds);
    free(tree->node);
    *tree = (struct lw_light_tree){0};
}

static float importance(const struct lw_light_node *node, const struct lw_light_place *place) {
    return lw_light_importance(node, *place);
}

float lw_light_tree_promise(const struct lw_light_tree *tree, struct lw_vec3 point_ws,
                            struct lw_vec3 normal_ws) {
    const struct lw_light_place place =
        lw_light_place_of(&(struct lw_light_region){point_ws, normal_ws, 0, 1});
    return importance(&tree->node[0], &place);
}

/* Groups of a split under way. */
struct split {
    const struct lw_light_tree *tree;
    struct lw_light_place place;
    uint32_t count, *group;
    float promise[LW_LIGHT_TREE_GROUPS_MAX]; /* 0: a group of one light, which cannot be split */
};

static void put_node(struct split *s, uint32_t at, uint32_t node, float promise) {
    s->group[at] = node;
    s->promise[at] = s->tree->node[node].light == UINT32_MAX ? promise : 0;
}

/* Puts the children of a group in its place, those that can give anything; false where there is no room for
 * both. */
static bool split_group(struct split *s, uint32_t at, uint32_t most) {
    const struct lw_light_node *parent = &s->tree->node[s->group[at]];
    const uint32_t left = s->group[at] + 1, right = parent->right;
    const float gives_left = importance(&s->tree->node[left], &s->place),
                gives_right = importance(&s->tree->node[right], &s->place);
    if (gives_left > 0 && gives_right > 0) {
        if (s->count == most) return false;
        put_node(s, at, left, gives_left);
        put_node(s, s->count++, right, gives_right);
    } else if (gives_left > 0) {
        put_node(s, at, left, gives_left);
    } else if (gives_right > 0) {
        put_node(s, at, right, gives_right);
    } else {
        s->count--;
        s->group[at] = s->group[s->count];
        s->promise[at] = s->promise[s->count];
    }
    return true;
}

uint32_t lw_light_tree_split(const struct lw_light_tree *tree, uint32_t group,
                             const struct lw_light_region *region, uint32_t most, uint32_t *out_group) {
    struct split s = {.tree = tree, .place = lw_light_place_of(region), .group = out_group};
    assert(most > 0 && most <= LW_LIGHT_TREE_GROUPS_MAX);
    const float promise = importance(&tree->node[group], &s.place);
    if (!(promise > 0)) return 0;
    put_node(&s, s.count++, group, promise);
    for (;;) {
        uint32_t best = 0;
        for (uint32_t i = 1; i < s.count; i++)
            if (s.promise[i] > s.promise[best]) best = i;
        if (!s.count || !(s.promise[best] > 0) || !split_group(&s, best, most)) return s.count;
    }
}

bool lw_light_tree_is_far(const struct lw_light_tree *tree, uint32_t group,
                          const struct lw_light_region *region) {
    const struct lw_light_bounds *b = &tree->bounds[group];
    const struct lw_vec3 c = region->centre_ws;
    const struct lw_vec3 d = lw_vec3(fmaxf(0, fmaxf(b->low.x - c.x, c.x - b->high.x)),
                                     fmaxf(0, fmaxf(b->low.y - c.y, c.y - b->high.y)),
                                     fmaxf(0, fmaxf(b->low.z - c.z, c.z - b->high.z)));
    return lw_vec3_dot(d, d) > region->radius_m * region->radius_m;
}

/* Probability of the left one of a node's children; below 0: neither can give anything. */
static float probability_of_left(const struct lw_light_tree *tree, uint32_t index,
                                 const struct lw_light_place *place) {
    float left = importance(&tree->node[index + 1], place);
    float right = importance(&tree->node[tree->node[index].right], place);
    return left + right > 0 ? left / (left + right) : -1;
}

uint32_t lw_light_tree_choose(const struct lw_light_tree *tree, uint32_t group,
                              const struct lw_light_region *region, float pick, float *out_probability) {
    const struct lw_light_place place = lw_light_place_of(region);
    float probability = 1;
    uint32_t i = group;
    while (tree->node[i].light == UINT32_MAX) {
        const struct lw_light_node *node = &tree->node[i];
        i = lw_light_go_down(node, i, importance(node + 1, &place),
                             importance(&tree->node[node->right], &place), &pick, &probability);
        if (i == UINT32_MAX) return UINT32_MAX;
    }
    *out_probability = probability;
    return tree->node[i].light;
}

float lw_light_tree_probability(const struct lw_light_tree *tree, struct lw_vec3 point_ws,
                                struct lw_vec3 normal_ws, uint32_t light) {
    const struct lw_light_place place =
        lw_light_place_of(&(struct lw_light_region){point_ws, normal_ws, 0, 1});
    float probability = 1;
    for (uint32_t i = tree->leaf[light]; i != 0; i = tree->node[i].parent) {
        uint32_t parent = tree->node[i].parent;
        float left = probability_of_left(tree, parent, &place);
        if (left < 0) return 0;
        probability *= i == parent + 1 ? left : 1 - left;
    }
    return probability;
}
