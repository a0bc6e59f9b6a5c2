#include "server/bake/map_names.h"

#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <xxhash.h>

#define SUFFIX_MAX 16u /* "-4294967295.exr" and the terminator */

/* Names that are taken, compared without case, each with the number that its next twin should try. */
struct slot {
    const char *name; /* in lower case, ours to free; NULL: a free slot */
    uint32_t next;
};
struct taken {
    struct slot *slot;
    uint32_t capacity; /* a power of two above the number of names that can come */
};

static bool is_safe(char c) {
    return (c >= 'a' && c <= 'z') || (c >= 'A' && c <= 'Z') || (c >= '0' && c <= '9') || c == '.' ||
           c == '_' || c == '-';
}

/* Names of devices, with or without an extension, whatever their case. */
static bool is_device(const char *stem) {
    static const char *const plain[] = {"con", "prn", "aux", "nul", "conin$", "conout$"};
    const size_t length = strcspn(stem, ".");
    for (size_t i = 0; i < sizeof plain / sizeof *plain; i++)
        if (strlen(plain[i]) == length && strncasecmp(stem, plain[i], length) == 0) return true;
    return length == 4 && (strncasecmp(stem, "com", 3) == 0 || strncasecmp(stem, "lpt", 3) == 0) &&
           stem[3] >= '0' && stem[3] <= '9';
}

static void make_stem(const char *name, char out[LW_MAP_NAMES_STEM_MAX + 2]) {
    size_t n = 0;
    for (; *name && n < LW_MAP_NAMES_STEM_MAX; name++) {
        const char c = is_safe(*name) ? *name : '_';
        if (n == 0 && (c == '.' || c == '-')) continue;
        if (c == '_' && !is_safe(*name) && n && out[n - 1] == '_') continue;
        out[n++] = c;
    }
    out[n] = 0;
    if (n == 0) strcpy(out, "object");
    if (!is_device(out)) return;
    /* the device is what stands before the first dot */
    const size_t device = strcspn(out, ".");
    memmove(out + device + 1, out + device, strlen(out + device) + 1);
    out[device] = '_';
}

static void lower(const char *text, char *out) {
    for (; *text; text++) *out++ = *text >= 'A' && *text <= 'Z' ? (char)(*text + ('a' - 'A')) : *text;
    *out = 0;
}

static struct slot *find(const struct taken *taken, const char *name) {
    uint32_t i = (uint32_t)XXH3_64bits(name, strlen(name)) & (taken->capacity - 1);
    while (taken->slot[i].name && strcmp(taken->slot[i].name, name) != 0) i = (i + 1) & (taken->capacity - 1);
    return &taken->slot[i];
}

/* Takes a name; false if it is taken already, or out of memory. */
static bool reserve(const struct taken *taken, const char *name, bool *out_no_memory) {
    char folded[LW_MAP_NAMES_STEM_MAX + 2 + SUFFIX_MAX];
    lower(name, folded);
    struct slot *slot = find(taken, folded);
    if (slot->name) return false;
    slot->name = strdup(folded);
    slot->next = 2;
    *out_no_memory = !slot->name;
    return slot->name != NULL;
}

static char *name_object(const struct taken *taken, const char *name) {
    char stem[LW_MAP_NAMES_STEM_MAX + 2], folded[sizeof stem], candidate[sizeof stem + SUFFIX_MAX];
    bool no_memory = false;
    make_stem(name, stem);
    lower(stem, folded);
    snprintf(candidate, sizeof candidate, "%s", stem);
    while (!reserve(taken, candidate, &no_memory)) {
        if (no_memory) return NULL;
        snprintf(candidate, sizeof candidate, "%s-%u", stem, find(taken, folded)->next++);
    }
    char *file = malloc(strlen(candidate) + sizeof ".exr");
    if (file) sprintf(file, "%s.exr", candidate);
    return file;
}

enum lw_status lw_map_names_init(struct lw_map_names *names, const struct lw_scene *scene) {
    struct taken taken = {.capacity = 16};
    while (taken.capacity < 2 * (uint64_t)scene->object_count) taken.capacity *= 2;
    taken.slot = calloc(taken.capacity, sizeof *taken.slot);
    *names = (struct lw_map_names){.file = calloc((size_t)scene->object_count + 1, sizeof *names->file)};
    bool ok = taken.slot && names->file;
    for (uint32_t o = 0; ok && o < scene->object_count; o++) {
        names->file[o] = name_object(&taken, scene->object[o].name);
        ok = names->file[o] != NULL;
        names->count += ok;
    }
    for (uint32_t i = 0; taken.slot && i < taken.capacity; i++) free((char *)taken.slot[i].name);
    free(taken.slot);
    if (ok) return LW_OK;
    lw_map_names_finish(names);
    return LW_NO_MEMORY;
}

void lw_map_names_finish(struct lw_map_names *names) {
    for (uint32_t i = 0; i < names->count; i++) free(names->file[i]);
    free(names->file);
    *names = (struct lw_map_names){0};
}
