#include "client/control/ctl_names.h"

#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#define NEAR_MAX   5u  /* names that an error lists */
#define LENGTH_MAX 64u /* characters of a name; a longer one has no distance */

static const char *const one[] = {[LW_SCENE_CHANGE_OF_SCENE] = "scene",
                                  [LW_SCENE_CHANGE_OF_OBJECT] = "object",
                                  [LW_SCENE_CHANGE_OF_LIGHT] = "light",
                                  [LW_SCENE_CHANGE_OF_MATERIAL] = "material",
                                  [LW_SCENE_CHANGE_OF_MESH] = "mesh"};

static const char *const many[] = {[LW_SCENE_CHANGE_OF_SCENE] = "scenes",
                                   [LW_SCENE_CHANGE_OF_OBJECT] = "objects",
                                   [LW_SCENE_CHANGE_OF_LIGHT] = "lights",
                                   [LW_SCENE_CHANGE_OF_MATERIAL] = "materials",
                                   [LW_SCENE_CHANGE_OF_MESH] = "meshes"};

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

unsigned lw_ctl_names_distance(const char *a, const char *b) {
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

/* Edit distance of a name from the text; 1 for a name that contains it. */
static unsigned apart(const char *name, const char *text) {
    if (*text && strcasestr(name, text)) return 1;
    return lw_ctl_names_distance(name, text);
}

/* Where a name is looked for: among all of a kind, or among the lights and those materials that shine. */
struct among {
    const struct lw_scene *scene;
    const char *one, *many;
    enum lw_scene_change_of of[2];
    unsigned kinds;
    const bool *shines; /* per material; NULL: all of them */
};

static struct among among_all(const struct lw_scene *scene, enum lw_scene_change_of of) {
    return (struct among){scene, one[of], many[of], {of}, 1, NULL};
}

static bool is_among(const struct among *a, enum lw_scene_change_of of, uint32_t i) {
    return of != LW_SCENE_CHANGE_OF_MATERIAL || !a->shines || a->shines[i];
}

/* One of what an error lists: its name if that is not NULL, its kind where there are several, its number. */
static void append(char *text, size_t capacity, const struct among *a, enum lw_scene_change_of of, uint32_t i,
                   const char *name) {
    size_t length = strlen(text);
    const char *kind = a->kinds > 1 ? one[of] : "", *blank = a->kinds > 1 ? " " : "";
    length += (size_t)snprintf(text + length, capacity - length, "%s", length ? ", " : "");
    if (name)
        snprintf(text + length, capacity - length, "\"%.40s\" (%s%s#%u)", name, kind, blank, i);
    else
        snprintf(text + length, capacity - length, "%s%s#%u", kind, blank, i);
}

struct near {
    enum lw_scene_change_of of;
    uint32_t i;
    unsigned how_far;
};

/* Returns how many there are now. */
static uint32_t insert(struct near *best, uint32_t count, struct near next) {
    uint32_t at = count < NEAR_MAX ? count++ : NEAR_MAX;
    for (; at > 0 && best[at - 1].how_far > next.how_far; at--)
        if (at < NEAR_MAX) best[at] = best[at - 1];
    if (at < NEAR_MAX) best[at] = next;
    return count;
}

/* Lists the near names, or all names if they are few. */
static enum lw_status fail_unknown(const struct among *a, const char *text, struct lw_error *err) {
    const unsigned far = 2 + (unsigned)strlen(text) / 3;
    struct near best[NEAR_MAX];
    uint32_t count = 0, all = 0, near = 0;
    for (unsigned k = 0; k < a->kinds; k++)
        for (uint32_t i = 0; i < lw_ctl_names_count(a->scene, a->of[k]); i++) {
            if (!is_among(a, a->of[k], i)) continue;
            const unsigned d = apart(lw_ctl_names_of(a->scene, a->of[k], i), text);
            count = insert(best, count, (struct near){a->of[k], i, d});
            all++;
        }
    while (near < count && best[near].how_far <= far) near++;
    if (near) count = near;
    char names[400] = "";
    for (uint32_t k = 0; k < count; k++)
        append(names, sizeof names, a, best[k].of, best[k].i,
               lw_ctl_names_of(a->scene, best[k].of, best[k].i));
    if (near || all <= NEAR_MAX)
        return lw_status_fail(err, LW_USAGE, "no %s is called \"%.60s\": %s %s", a->one, text,
                              near ? "near are" : "the scene has", all ? names : "none");
    return lw_status_fail(err, LW_USAGE, "no %s is called \"%.60s\": lightwellctl list names them all",
                          a->one, text);
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

static enum lw_status find(const struct among *a, const char *text, enum lw_scene_change_of *out_of,
                           uint32_t *out_index, struct lw_error *err) {
    uint32_t found = 0, count = 0;
    enum lw_scene_change_of of = a->of[0];
    char numbers[200] = "";
    for (unsigned k = 0; k < a->kinds; k++)
        for (uint32_t i = 0; i < lw_ctl_names_count(a->scene, a->of[k]); i++) {
            if (!is_among(a, a->of[k], i) || strcmp(lw_ctl_names_of(a->scene, a->of[k], i), text) != 0)
                continue;
            found = i, of = a->of[k];
            if (count++ < NEAR_MAX) append(numbers, sizeof numbers, a, of, i, NULL);
        }
    if (count == 0) return fail_unknown(a, text, err);
    if (count > 1)
        return lw_status_fail(err, LW_USAGE, "%u %s are called \"%.60s\": say which by number: %s%s%s", count,
                              a->many, text, numbers, count > NEAR_MAX ? ", ..." : "",
                              a->kinds > 1 ? " (of a material: material #NUMBER emission R G B)" : "");
    *out_of = of;
    *out_index = found;
    return LW_OK;
}

enum lw_status lw_ctl_names_find(const struct lw_scene *scene, enum lw_scene_change_of of, const char *text,
                                 uint32_t *out_index, struct lw_error *err) {
    if (text[0] == '#') return find_number(scene, of, text, out_index, err);
    const struct among all = among_all(scene, of);
    return find(&all, text, &of, out_index, err);
}

enum lw_status lw_ctl_names_find_shining(const struct lw_scene *scene, const bool *shines, const char *text,
                                         enum lw_scene_change_of *out_of, uint32_t *out_index,
                                         struct lw_error *err) {
    const struct among shining = {scene,
                                  "light or emissive material",
                                  "lights or emissive materials",
                                  {LW_SCENE_CHANGE_OF_LIGHT, LW_SCENE_CHANGE_OF_MATERIAL},
                                  2,
                                  shines};
    if (text[0] != '#') return find(&shining, text, out_of, out_index, err);
    enum lw_status status = find_number(scene, LW_SCENE_CHANGE_OF_LIGHT, text, out_index, err);
    if (status == LW_OK) *out_of = LW_SCENE_CHANGE_OF_LIGHT;
    return status;
}
