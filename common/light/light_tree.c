#include "common/light/light_tree.h"

#include "common/light/light_kernels.h"

#include <assert.h>
#include <stdlib.h>
#include <string.h>

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
    uint32_t *order, *spare, next;
    uint32_t first_count; /* lights below the root's left child, if there are other lights */
};

static float middle(const struct lw_light_bounds *l, int axis) {
    struct lw_vec3 m = lw_vec3_add(l->low, l->high);
    return axis == 0 ? m.x : axis == 1 ? m.y : m.z;
}

/* How wide the directions are that a group shines into, sr, weighted by the cosine with its normals (Conty
 * Estevez and Kulla 2018, eq. 1). */
static float directions_of(const struct lw_light_bounds *b) {
    const float o = b->spread, w = fminf(o + b->reach, LW_PI);
    return 2 * LW_PI * (1 - cosf(o)) +
           0.5f * LW_PI * (2 * w * sinf(o) - cosf(o - 2 * w) - 2 * o * sinf(o) + cosf(o));
}

/* How badly a group's bound stands for its lights: by its power, the square of its extent and its directions.
 * The paper has the surface of the box, which is 0 for lights in a row. */
static float cost_of(const struct lw_light_bounds *b) {
    const struct lw_vec3 side = lw_vec3_sub(b->high, b->low);
    return b->power > 0 ? b->power * lw_vec3_dot(side, side) * directions_of(b) : 0;
}

#define BINS 16
/* Deeper, groups are halved, and so the tree is not deeper than LW_LIGHT_TREE_DEPTH_MAX. */
#define DEPTH_BY_COST (LW_LIGHT_TREE_DEPTH_MAX - 32)

/* A group's lights in slices along an axis. */
struct slices {
    struct lw_light_bounds bounds[BINS];
    uint32_t count[BINS];
};

struct cut {
    int axis;       /* below 0: there is none */
    uint32_t slice; /* the first one of the right side */
    float low, per_m, cost;
};

static uint32_t slice_of(const struct cut *cut, const struct lw_light_bounds *l) {
    const float slice = (middle(l, cut->axis) - cut->low) * cut->per_m;
    return slice < BINS - 1 ? (uint32_t)slice : BINS - 1;
}

/* Tries all cuts between slices of one axis. */
static void try_axis(const struct build *b, const uint32_t *order, uint32_t count, struct cut cut,
                     struct cut *best) {
    struct slices s = {.count = {0}};
    struct lw_light_bounds after[BINS], before = {.power = 0};
    uint32_t lights = 0;
    for (uint32_t i = 0; i < count; i++) {
        const uint32_t slice = slice_of(&cut, &b->light[order[i]]);
        s.bounds[slice] = unite_bounds(&s.bounds[slice], &b->light[order[i]]);
        s.count[slice]++;
    }
    after[BINS - 1] = s.bounds[BINS - 1];
    for (int i = BINS - 1; i-- > 0;) after[i] = unite_bounds(&s.bounds[i], &after[i + 1]);
    for (uint32_t i = 1; i < BINS; i++) {
        before = unite_bounds(&before, &s.bounds[i - 1]);
        lights += s.count[i - 1];
        cut.slice = i;
        cut.cost = cost_of(&before) + cost_of(&after[i]);
        if (lights > 0 && lights < count && (best->axis < 0 || cut.cost < best->cost)) *best = cut;
    }
}

static struct cut find_cut(const struct build *b, const uint32_t *order, uint32_t count) {
    struct cut best = {.axis = -1};
    for (int axis = 0; axis < 3; axis++) {
        float low = INFINITY, high = -INFINITY;
        for (uint32_t i = 0; i < count; i++) {
            const float m = middle(&b->light[order[i]], axis);
            low = fminf(low, m);
            high = fmaxf(high, m);
        }
        const float per_m = BINS / (high - low);
        if (high > low && per_m < INFINITY)
            try_axis(b, order, count, (struct cut){.axis = axis, .low = low, .per_m = per_m}, &best);
    }
    return best;
}

/* Puts the lights of the best cut's left side first; how many there are. */
static uint32_t part_lights(struct build *b, uint32_t *order, uint32_t count) {
    const struct cut cut = find_cut(b, order, count);
    uint32_t left = 0, right = 0;
    if (cut.axis < 0) return count / 2; /* in one place */
    for (uint32_t i = 0; i < count; i++) {
        const uint32_t light = order[i];
        if (slice_of(&cut, &b->light[light]) < cut.slice)
            order[left++] = light;
        else
            b->spare[right++] = light;
    }
    memcpy(order + left, b->spare, right * sizeof *order);
    return left;
}

static uint32_t build(struct build *b, uint32_t first, uint32_t count, uint32_t parent, uint32_t depth) {
    const uint32_t index = b->next++;
    struct lw_light_node *node = &b->tree->node[index];
    *node = (struct lw_light_node){.parent = parent, .light = UINT32_MAX};
    if (count == 1) {
        node->light = b->order[first];
        b->tree->leaf[node->light] = index;
        return index;
    }
    const bool is_root = index == 0 && b->first_count > 0 && b->first_count < count;
    const uint32_t left = is_root                 ? b->first_count
                          : depth < DEPTH_BY_COST ? part_lights(b, b->order + first, count)
                                                  : count / 2;
    build(b, first, left, index, depth + 1);
    node->right = build(b, first + left, count - left, index, depth + 1);
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
    uint32_t *order = malloc(2ul * count * sizeof *order);
    tree->node = calloc(2ul * count, sizeof *tree->node);
    tree->bounds = calloc(2ul * count, sizeof *tree->bounds);
    tree->leaf = calloc(count, sizeof *tree->leaf);
    if (!order || !tree->node || !tree->bounds || !tree->leaf) {
        free(order);
        lw_light_tree_finish(tree);
        return LW_NO_MEMORY;
    }
    for (uint32_t i = 0; i < count; i++) order[i] = i;
    build(&(struct build){tree, light, order, order + count, 0, first_count}, 0, count, UINT32_MAX, 0);
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
    uint32_t count;
    struct lw_light_group *group;
    float parts[LW_LIGHT_TREE_GROUPS_MAX]; /* the promise of a group that can be split, else 0 */
};

static void put_group(struct split *s, uint32_t at, uint32_t node, float promise) {
    s->group[at] = (struct lw_light_group){node, promise};
    s->parts[at] = s->tree->node[node].light == UINT32_MAX ? promise : 0;
}

/* Puts the children of a group in its place, those that can give anything; false where there is no room for
 * both. */
static bool split_group(struct split *s, uint32_t at, uint32_t most) {
    const uint32_t left = s->group[at].node + 1, right = s->tree->node[s->group[at].node].right;
    const float gives_left = importance(&s->tree->node[left], &s->place),
                gives_right = importance(&s->tree->node[right], &s->place);
    if (gives_left > 0 && gives_right > 0) {
        if (s->count == most) return false;
        put_group(s, at, left, gives_left);
        put_group(s, s->count++, right, gives_right);
    } else if (gives_left > 0) {
        put_group(s, at, left, gives_left);
    } else if (gives_right > 0) {
        put_group(s, at, right, gives_right);
    } else {
        s->count--;
        s->group[at] = s->group[s->count];
        s->parts[at] = s->parts[s->count];
    }
    return true;
}

uint32_t lw_light_tree_split(const struct lw_light_tree *tree, uint32_t node,
                             const struct lw_light_region *region, uint32_t most,
                             struct lw_light_group *out_group) {
    struct split s = {.tree = tree, .place = lw_light_place_of(region), .group = out_group};
    assert(most > 0 && most <= LW_LIGHT_TREE_GROUPS_MAX);
    const float promise = importance(&tree->node[node], &s.place);
    if (!(promise > 0)) return 0;
    put_group(&s, s.count++, node, promise);
    for (;;) {
        uint32_t best = 0;
        for (uint32_t i = 1; i < s.count; i++)
            if (s.parts[i] > s.parts[best]) best = i;
        if (!s.count || !(s.parts[best] > 0) || !split_group(&s, best, most)) return s.count;
    }
}

/* Probabilities in proportion to promises, with a sum of `most`. A group that would have 1 or more is sampled
 * always, and the others share the rest. */
static void find_probabilities(const struct lw_light_group *group, uint32_t count, uint32_t most,
                               float *out_probability) {
    uint32_t left = most, sure = most;
    memset(out_probability, 0, count * sizeof *out_probability);
    while (sure > 0 && left > 0) {
        float rest = 0;
        for (uint32_t i = 0; i < count; i++) rest += out_probability[i] < 1 ? group[i].promise : 0;
        sure = 0;
        for (uint32_t i = 0; i < count; i++) {
            if (out_probability[i] == 1) continue;
            out_probability[i] = fminf(group[i].promise * (float)left / rest, 1);
            sure += out_probability[i] == 1;
        }
        left -= sure < left ? sure : left;
    }
}

uint32_t lw_light_tree_sample(const struct lw_light_group *group, uint32_t count, uint32_t most, float pick,
                              struct lw_light_group_sample *out_sampled) {
    float probability[LW_LIGHT_TREE_GROUPS_MAX], before = 0, next = pick;
    uint32_t sampled = 0;
    assert(count <= LW_LIGHT_TREE_GROUPS_MAX);
    find_probabilities(group, count, most, probability);
    for (uint32_t i = 0; i < count && sampled < most; before += probability[i++]) {
        if (!(next < before + probability[i])) continue;
        const float within = fminf(fmaxf((next - before) / probability[i], 0), LW_LIGHT_BELOW_ONE);
        out_sampled[sampled] = (struct lw_light_group_sample){group[i].node, probability[i], within, sampled};
        next += 1;
        sampled++;
    }
    return sampled;
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
