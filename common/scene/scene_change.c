#include "common/scene/scene_change.h"

#include <math.h>

static const struct rule {
    const char *name;
    enum lw_scene_change_of of;
    uint32_t values;
} rule[] = {
#define X(name, number, of, values) [number] = {#name, LW_SCENE_CHANGE_OF_##of, values},
    LW_SCENE_CHANGE_MAP(X)
#undef X
};

const char *lw_scene_change_text(uint32_t code) {
    switch (code) {
#define X(name, number, text)                                                                                \
    case number:                                                                                             \
        return text;
        LW_SCENE_CHANGE_CODE_MAP(X)
#undef X
    default:
        return "an unknown code";
    }
}

static enum lw_scene_change_code refuse(struct lw_error *err, enum lw_scene_change_code code,
                                        const struct lw_scene_change *change, const char *why) {
    lw_status_fail(err, LW_BAD_DATA, "%s %u: %s", rule[change->kind].name, change->target, why);
    return code;
}

uint32_t lw_scene_change_targets(const struct lw_scene *scene, enum lw_scene_change_of of) {
    switch (of) {
    case LW_SCENE_CHANGE_OF_OBJECT:
        return scene->object_count;
    case LW_SCENE_CHANGE_OF_LIGHT:
        return scene->light_count;
    case LW_SCENE_CHANGE_OF_MATERIAL:
        return scene->material_count;
    case LW_SCENE_CHANGE_OF_MESH:
        return scene->mesh_count;
    case LW_SCENE_CHANGE_OF_SCENE:
        return 1;
    }
    return 0;
}

static bool within(const float *value, uint32_t count, float low, float high) {
    for (uint32_t i = 0; i < count; i++)
        if (!(value[i] >= low && value[i] <= high)) return false;
    return true;
}

static enum lw_scene_change_code check_transform(const struct lw_scene_change *c, struct lw_error *err) {
    struct lw_vec3 axis[3];
    for (int j = 0; j < 3; j++) {
        axis[j] = lw_vec3(c->value[j], c->value[4 + j], c->value[8 + j]);
        float length = lw_vec3_length(axis[j]);
        if (!(fabsf(c->value[4 * j + 3]) <= LW_SCENE_CHANGE_POSITION_MAX))
            return refuse(err, LW_SCENE_CHANGE_OUT_OF_RANGE, c, "over 1e8 m from the origin");
        if (!(length >= LW_SCENE_CHANGE_SCALE_MIN))
            return refuse(err, LW_SCENE_CHANGE_DEGENERATE, c, "scaled to under 1e-6");
        if (!(length <= LW_SCENE_CHANGE_SCALE_MAX))
            return refuse(err, LW_SCENE_CHANGE_OUT_OF_RANGE, c, "scaled to over 1e6");
        axis[j] = lw_vec3_scale(axis[j], 1 / length);
    }
    if (!(fabsf(lw_vec3_dot(lw_vec3_cross(axis[0], axis[1]), axis[2])) >= LW_SCENE_CHANGE_VOLUME_MIN))
        return refuse(err, LW_SCENE_CHANGE_DEGENERATE, c, "a transform without volume");
    return LW_SCENE_CHANGE_OK;
}

static enum lw_scene_change_code check_values(const struct lw_scene_change *c, struct lw_error *err) {
    const float *v = c->value;
    switch ((enum lw_scene_change_kind)c->kind) {
    case LW_SCENE_CHANGE_OBJECT_TRANSFORM:
    case LW_SCENE_CHANGE_OBJECT_ADD:
        return check_transform(c, err);
    case LW_SCENE_CHANGE_LIGHT_POSITION:
        if (!within(v, 3, -LW_SCENE_CHANGE_POSITION_MAX, LW_SCENE_CHANGE_POSITION_MAX))
            return refuse(err, LW_SCENE_CHANGE_OUT_OF_RANGE, c, "over 1e8 m from the origin");
        return LW_SCENE_CHANGE_OK;
    case LW_SCENE_CHANGE_LIGHT_DIRECTION: {
        float length = lw_vec3_length(lw_vec3(v[0], v[1], v[2]));
        if (!(length >= LW_SCENE_CHANGE_SCALE_MIN))
            return refuse(err, LW_SCENE_CHANGE_DEGENERATE, c, "a direction without length");
        if (!(length <= LW_SCENE_CHANGE_SCALE_MAX))
            return refuse(err, LW_SCENE_CHANGE_OUT_OF_RANGE, c, "a direction longer than 1e6");
        return LW_SCENE_CHANGE_OK;
    }
    case LW_SCENE_CHANGE_LIGHT_INTENSITY:
    case LW_SCENE_CHANGE_MATERIAL_EMISSION:
    case LW_SCENE_CHANGE_SKY:
        if (!within(v, 3, 0, LW_SCENE_RADIANCE_MAX))
            return refuse(err, LW_SCENE_CHANGE_OUT_OF_RANGE, c, "a value is not from 0 to 1e12");
        return LW_SCENE_CHANGE_OK;
    case LW_SCENE_CHANGE_MATERIAL_BASE_COLOUR:
        if (!within(v, 3, 0, 1))
            return refuse(err, LW_SCENE_CHANGE_OUT_OF_RANGE, c, "a value is not from 0 to 1");
        return LW_SCENE_CHANGE_OK;
    case LW_SCENE_CHANGE_CLOCK_SEEK:
        if (!within(v, 1, 0, LW_SCENE_DURATION_MAX))
            return refuse(err, LW_SCENE_CHANGE_OUT_OF_RANGE, c, "not from 0 to 1e9 s");
        return LW_SCENE_CHANGE_OK;
    case LW_SCENE_CHANGE_CLOCK_RATE:
        if (!within(v, 1, -LW_SCENE_CHANGE_RATE_MAX, LW_SCENE_CHANGE_RATE_MAX))
            return refuse(err, LW_SCENE_CHANGE_OUT_OF_RANGE, c, "not from -1000 to 1000");
        return LW_SCENE_CHANGE_OK;
    case LW_SCENE_CHANGE_OBJECT_RESTORE:
    case LW_SCENE_CHANGE_OBJECT_HIDE:
    case LW_SCENE_CHANGE_OBJECT_SHOW:
    case LW_SCENE_CHANGE_OBJECT_REMOVE:
    case LW_SCENE_CHANGE_LIGHT_RESTORE:
    case LW_SCENE_CHANGE_MATERIAL_RESTORE:
    case LW_SCENE_CHANGE_SKY_RESTORE:
    case LW_SCENE_CHANGE_CLOCK_PAUSE:
    case LW_SCENE_CHANGE_CLOCK_PLAY:
    case LW_SCENE_CHANGE_RESET:
        return LW_SCENE_CHANGE_OK;
    }
    return LW_SCENE_CHANGE_UNKNOWN_KIND;
}

enum lw_scene_change_code lw_scene_change_check(const struct lw_scene *scene, const struct lw_scene_change *c,
                                                struct lw_error *err) {
    if (c->kind >= sizeof rule / sizeof *rule || !rule[c->kind].name) {
        lw_status_fail(err, LW_BAD_DATA, "there is no change of kind %u", c->kind);
        return LW_SCENE_CHANGE_UNKNOWN_KIND;
    }
    const struct rule *r = &rule[c->kind];
    if (c->target >= lw_scene_change_targets(scene, r->of))
        return refuse(err, LW_SCENE_CHANGE_UNKNOWN_TARGET, c, "the scene does not have it");
    if (c->value_count != r->values)
        return refuse(err, LW_SCENE_CHANGE_VALUE_COUNT, c, "another number of values belongs to it");
    for (uint32_t i = 0; i < c->value_count; i++)
        if (!isfinite(c->value[i]))
            return refuse(err, LW_SCENE_CHANGE_NOT_FINITE, c, "a value is not finite");
    if (c->kind == LW_SCENE_CHANGE_MATERIAL_EMISSION && scene->material[c->target].unlit &&
        (c->value[0] != 0 || c->value[1] != 0 || c->value[2] != 0))
        return refuse(err, LW_SCENE_CHANGE_OUT_OF_RANGE, c, "it is unlit: it shows its base colour alone");
    return check_values(c, err);
}
