#include "server/import/text/obj_materials.h"

#include "common/base/file_read.h"
#include "common/base/log.h"
#include "server/import/beside.h"
#include "server/import/mesh/mesh_builder.h"
#include "server/import/tally.h"
#include "server/import/text_lines.h"

#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <strings.h>

struct lw_obj_materials_library {
    char *path;   /* from the scene's folder on */
    char *folder; /* the path's; "": the scene's */
    struct lw_mtl_file file;
};

struct loading {
    struct lw_obj_materials *materials;
    const struct lw_obj_materials_desc *desc;
    struct lw_tally lost; /* libraries that are not there */
    uint32_t name_count;  /* names looked for */
    bool is_full;
};

static enum lw_status no_memory(struct lw_error *err) {
    return lw_status_fail(err, LW_NO_MEMORY, "out of memory for material libraries");
}

static void report(const struct loading *loading, const struct lw_obj_materials_library *library) {
    char name[600];
    snprintf(name, sizeof name, "%.300s: %.250s", loading->desc->path, library->path);
    lw_skipped_report(&library->file.skipped, name);
}

static bool is_loaded(const struct lw_obj_materials *materials, const char *path) {
    for (uint32_t i = 0; i < materials->library_count; i++)
        if (strcmp(materials->library[i].path, path) == 0) return true;
    return false;
}

static enum lw_status parse(struct loading *loading, struct lw_obj_materials_library *library,
                            struct lw_error *err) {
    struct lw_error own = {0};
    uint8_t *bytes = NULL;
    size_t size = 0;
    enum lw_status status = lw_file_read_beneath(loading->desc->folder, library->path,
                                                 LW_OBJ_MATERIALS_SIZE_MAX, true, &bytes, &size, &own);
    if (!status) status = lw_mtl_file_read(&library->file, bytes, size, &own);
    free(bytes);
    report(loading, library);
    if (status == LW_NO_MEMORY) return lw_status_fail(err, status, "%s", own.text);
    if (status)
        lw_log(LW_LOG_WARNING, "%s: the material library \"%s\" %s: what needs it is grey",
               loading->desc->path, library->path, own.text);
    return LW_OK;
}

/* Takes over the path. */
static enum lw_status add(struct loading *loading, char *path, struct lw_error *err) {
    struct lw_obj_materials *materials = loading->materials;
    const char *slash = strrchr(path, '/');
    char *folder = slash ? strndup(path, (size_t)(slash - path)) : strdup("");
    if (!folder || !lw_mesh_builder_reserve((void **)&materials->library, &materials->capacity,
                                            materials->library_count + 1ul, sizeof *materials->library)) {
        free(folder);
        free(path);
        return no_memory(err);
    }
    struct lw_obj_materials_library *library = &materials->library[materials->library_count++];
    *library = (struct lw_obj_materials_library){.path = path, .folder = folder};
    return parse(loading, library, err);
}

/* Whether another name may be looked for. */
static bool has_room(struct loading *loading) {
    const bool is_full = loading->name_count++ >= LW_OBJ_MATERIALS_NAMES_MAX ||
                         loading->materials->library_count >= LW_OBJ_MATERIALS_LIBRARIES_MAX;
    if (is_full && !loading->is_full)
        lw_log(LW_LOG_WARNING,
               "%s: more than %u material libraries, or %u names of them: the rest is not read",
               loading->desc->path, LW_OBJ_MATERIALS_LIBRARIES_MAX, LW_OBJ_MATERIALS_NAMES_MAX);
    loading->is_full |= is_full;
    return !is_full;
}

/* *out_found: there is such a file, or it is one too many, which is reported. */
static enum lw_status load_named(struct loading *loading, const char *name, bool *out_found,
                                 struct lw_error *err) {
    char *path = NULL;
    *out_found =
        !has_room(loading) || lw_beside_find(loading->desc->folder, loading->desc->name, name, &path);
    if (!*out_found || loading->is_full) return LW_OK;
    if (!path) return no_memory(err);
    if (is_loaded(loading->materials, path)) {
        free(path);
        return LW_OK;
    }
    return add(loading, path, err);
}

/* ---- names ---- */

static bool ends_name(const char *end) {
    return strncasecmp(end - 4, ".mtl", 4) == 0 && (*end == 0 || *end == ' ' || *end == '\t');
}

/* Loads a name, or where there is no such file, each of its words. */
static enum lw_status load_name(struct loading *loading, char *name, struct lw_error *err) {
    bool found;
    if (load_named(loading, name, &found, err) || found) return err->status;
    if (!strpbrk(name, " \t") || ends_name(name + strlen(name))) {
        lw_tally_add(&loading->lost, name);
        return LW_OK;
    }
    for (char *at = name, *word; (word = lw_text_lines_word(&at));) {
        if (load_named(loading, word, &found, err)) return err->status;
        if (!found) lw_tally_add(&loading->lost, word);
    }
    return LW_OK;
}

/* Names may hold blanks, and one line may name several libraries: a name ends with .mtl. */
static enum lw_status load_each(struct loading *loading, char *names, struct lw_error *err) {
    for (char *name = names; *name;) {
        char *end = name;
        while (*end && !(end - name >= 4 && ends_name(end))) end++;
        const bool more = *end != 0;
        *end = 0;
        if (load_name(loading, name, err)) return err->status;
        name = end + more;
        name += strspn(name, " \t");
    }
    return LW_OK;
}

static enum lw_status load_line(struct loading *loading, const char *line, struct lw_error *err) {
    char *names = strdup(line);
    if (!names) return no_memory(err);
    const size_t length = strlen(names);
    const bool quoted = length >= 2 && names[0] == '"' && names[length - 1] == '"';
    if (quoted) names[length - 1] = 0;
    (void)load_each(loading, names + quoted, err);
    free(names);
    return err->status;
}

/* Viewers take a library of the scene's own name where the one that it names is not there. */
static enum lw_status replace_lost(struct loading *loading, struct lw_error *err) {
    const char *name = loading->desc->name, *dot = strrchr(name, '.');
    char own[400], more[32] = "";
    bool found;
    if (loading->lost.count == 0) return LW_OK;
    snprintf(own, sizeof own, "%.*s.mtl", dot ? (int)(dot - name) : (int)strlen(name), name);
    if (load_named(loading, own, &found, err) || found) return err->status;
    if (loading->lost.count > 1)
        snprintf(more, sizeof more, " (and %llu more)", (unsigned long long)(loading->lost.count - 1));
    lw_log(LW_LOG_WARNING,
           "%s: the material library \"%s\"%s is not there: what needs it is grey; put it beside the scene",
           loading->desc->path, loading->lost.first, more);
    return LW_OK;
}

/* ---- materials ---- */

static enum lw_status resolve(struct loading *loading, const struct lw_obj_text *obj, struct lw_error *err) {
    struct lw_obj_materials *materials = loading->materials;
    struct lw_tally unknown = {0};
    materials->use_count = obj->material.count;
    materials->use = calloc(materials->use_count + 1ul, sizeof *materials->use);
    if (!materials->use) return no_memory(err);
    for (uint32_t i = 0; i < materials->use_count; i++) {
        for (uint32_t l = 0; l < materials->library_count && !materials->use[i].material; l++) {
            const struct lw_obj_materials_library *library = &materials->library[l];
            const uint32_t number = lw_name_table_find(&library->file.name, obj->material.name[i]);
            if (number == LW_NAME_TABLE_NONE) continue;
            materials->use[i] = (struct lw_obj_materials_use){.material = &library->file.material[number],
                                                              .folder = library->folder};
        }
        if (!materials->use[i].material) lw_tally_add(&unknown, obj->material.name[i]);
    }
    lw_tally_warn(&unknown, loading->desc->path, "materials that no library has are grey");
    return LW_OK;
}

enum lw_status lw_obj_materials_load(struct lw_obj_materials *materials, const struct lw_obj_text *obj,
                                     const struct lw_obj_materials_desc *desc, struct lw_error *err) {
    struct loading loading = {.materials = materials, .desc = desc};
    *materials = (struct lw_obj_materials){0};
    for (uint32_t i = 0; i < obj->library_count && !err->status; i++)
        (void)load_line(&loading, obj->library[i].names, err);
    if (err->status || replace_lost(&loading, err)) return err->status;
    return resolve(&loading, obj, err);
}

void lw_obj_materials_finish(struct lw_obj_materials *materials) {
    for (uint32_t i = 0; i < materials->library_count; i++) {
        free(materials->library[i].path);
        free(materials->library[i].folder);
        lw_mtl_file_finish(&materials->library[i].file);
    }
    free(materials->library);
    free(materials->use);
    *materials = (struct lw_obj_materials){0};
}
