#include "client/control/ctl_names.h"

#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#define NEAR_MAX   5u  /* names that an error lists */
#define LENGTH_MAX 64u /* of names between which a distance is looked for */

static const char *const one[] = {[LW_SCENE_CHANGE_OF_SCENE] = "scene",
                                  [LW_SCENE_CHANGE_OF_OBJECT] = "object",
                                  [LW_SCENE_CHANGE_OF_LIGHT] = "light",
                                  [LW_SCENE_CHANGE_OF_MATERIAL] = "material",
                                  [LW_SCENE_CHANGE_OF_MESH] = "mesh"};

uint32_t lw_ctl_names_count(const struct lw_scene *scene, enum lw_scene_change_of of) {
    return of == LW_SCENE_CHANGE_OF_SCENE ? 0 : lw_scene_change_targets(scene, of);
}

const char *lw_ctl_names_of(const struct lw_scene *scene, enum lw_scene_change_of of, uint32_t i) {
    switch (of) {
    case LW_SCENE_CHANGE_OF_OBJECT:
        return scene->object[i].name;
    case LW_SCENE_CHANGE_OF_LIGHT:
        return scene->light[i].name;
    case LW_SCENE_CHANGE_OF_MATERIAL:
        return scene->material[i].name;
    case LW_SCENE_CHANGE_OF_MESH:
        return scene->mesh[i].name;
    case LW_SCENE_CHANGE_OF_SCENE:
        break;
    }
    return "";
}

/* Edits from one to the other: characters put in, left out, exchanged (Levenshtein 1965). */
static unsigned distance(const char *a, const char *b) {
    const size_t na = strlen(a), nb = strlen(b);
    unsigned row[LENGTH_MAX + 1];
    if (na > LENGTH_MAX || nb > LENGTH_MAX) return UINT32_MAX;
    for (size_t j = 0; j <= nb; j++) row[j] = (unsigned)j;
    for (size_t i = 1; i <= na; i++) {
        unsigned corner = row[0];
        row[0] = (unsigned)i;
        for (size_t j = 1; j <= nb; j++) {
            unsigned best = corner + (a[i - 1] != b[j - 1]);
            if (row[j] + 1 < best) best = row[j] + 1;
            if (row[j - 1] + 1 < best) best = row[j - 1] + 1;
            corner = row[j];
            row[j] = best;
        }
    }
    return row[nb];
}

/* How far a name is from what was asked for; 1 for one that contains it. */
static unsigned apart(const char *name, const char *text) {
    if (*text && strcasestr(name, text)) return 1;
    return distance(name, text);
}

/* name NULL: the number alone. */
static void append(char *text, size_t capacity, const char *name, uint32_t i) {
    const size_t length = strlen(text);
    const char *comma = length ? ", " : "";
    if (name)
        snprintf(text + length, capacity - length, "%s\"%.40s\" (#%u)", comma, name, i);
    else
        snprintf(text + length, capacity - length, "%s#%u", comma, i);
}

static enum lw_status fail_unknown(const struct lw_scene *scene, enum lw_scene_change_of of, const char *text,
                                   struct lw_error *err) {
    const unsigned far = 2 + (unsigned)strlen(text) / 3;
    uint32_t best[NEAR_MAX], count = 0;
    unsigned how_far[NEAR_MAX];
    for (uint32_t i = 0; i < lw_ctl_names_count(scene, of); i++) {
        const unsigned d = apart(lw_ctl_names_of(scene, of, i), text);
        if (d > far) continue;
        uint32_t at = count < NEAR_MAX ? count++ : NEAR_MAX;
        for (; at > 0 && how_far[at - 1] > d; at--)
            if (at < NEAR_MAX) best[at] = best[at - 1], how_far[at] = how_far[at - 1];
        if (at < NEAR_MAX) best[at] = i, how_far[at] = d;
    }
    char near[300] = "";
    for (uint32_t k = 0; k < count; k++)
        append(near, sizeof near, lw_ctl_names_of(scene, of, best[k]), best[k]);
    if (count)
        return lw_status_fail(err, LW_USAGE, "no %s is called \"%.60s\": near are %s", one[of], text, near);
    return lw_status_fail(err, LW_USAGE, "no %s is called \"%.60s\": lightwellctl list names them all",
                          one[of], text);
}

static enum lw_status find_number(const struct lw_scene *scene, enum lw_scene_change_of of, const char *text,
                                  uint32_t *out_index, struct lw_error *err) {
    const uint32_t count = lw_ctl_names_count(scene, of);
    char *end;
    unsigned long long number = text[1] >= '0' && text[1] <= '9' ? strtoull(text + 1, &end, 10) : UINT64_MAX;
    if (number == UINT64_MAX || *end)
        return lw_status_fail(err, LW_USAGE, "\"%.60s\" is not a number behind #", text);
    if (number >= count)
        return lw_status_fail(err, LW_USAGE, "there is no %s %s: the scene has %u", one[of], text, count);
    *out_index = (uint32_t)number;
    return LW_OK;
}

enum lw_status lw_ctl_names_find(const struct lw_scene *scene, enum lw_scene_change_of of, const char *text,
                                 uint32_t *out_index, struct lw_error *err) {
    if (text[0] == '#') return find_number(scene, of, text, out_index, err);
    uint32_t found = 0, count = 0;
    char numbers[200] = "";
    for (uint32_t i = 0; i < lw_ctl_names_count(scene, of); i++) {
        if (strcmp(lw_ctl_names_of(scene, of, i), text) != 0) continue;
        found = i;
        if (count++ < NEAR_MAX) append(numbers, sizeof numbers, NULL, i);
    }
    if (count == 0) return fail_unknown(scene, of, text, err);
    if (count > 1)
        return lw_status_fail(err, LW_USAGE, "%u %s%s are called \"%.60s\": say which by number: %s%s", count,
                              one[of], of == LW_SCENE_CHANGE_OF_MESH ? "es" : "s", text, numbers,
                              count > NEAR_MAX ? ", ..." : "");
    *out_index = found;
    return LW_OK;
}
