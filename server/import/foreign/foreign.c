#include "server/import/foreign/foreign.h"

#include "common/base/log.h"
#include "server/import/foreign/foreign_animation.h"
#include "server/import/foreign/foreign_text.h"
#include "server/import/guard.h"
#include "server/import/new_root.h"

#include <assimp/cimport.h>
#include <assimp/config.h>
#include <assimp/postprocess.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

/* Limit of a file's memory, by its size: text of a few bytes becomes a vertex of many, and Assimp holds it
 * several times. */
#define MEMORY_BASE     (2ull << 30) /* bytes */
#define MEMORY_PER_BYTE 100ull
#define SECONDS_BASE    20.0
#define SECONDS_PER_MIB 10.0

/* Where an OBJ asks for smooth surfaces and gives no normals: edges sharper than this stay. */
#define CREASE_DEG 60.0f

/* ---- Assimp ---- */

/* Assimp's messages are English for its developers, of several lines at worst. They follow our own text. */
static enum lw_status fail_by_assimp(const struct lw_foreign_import *import, struct lw_error *err) {
    char text[300];
    const char *said = aiGetErrorString();
    if (strstr(said, "bad_alloc") || strstr(said, "length_error"))
        return lw_status_fail(
            err, LW_BAD_DATA, "needs more memory than a file of %zu bytes should (%llu MiB): it is broken",
            import->files->file_size,
            (unsigned long long)((MEMORY_BASE + MEMORY_PER_BYTE * import->files->file_size) >> 20));
    snprintf(text, sizeof text, "%s", *said ? said : "no reason is given");
    return lw_status_fail(err, LW_BAD_DATA, "is no %s file that can be read: %s",
                          lw_scene_format_name(import->desc->format), text);
}

static struct aiPropertyStore *create_properties(void) {
    struct aiPropertyStore *store = aiCreatePropertyStore();
    if (!store) return NULL;
    aiSetImportPropertyInteger(store, AI_CONFIG_PP_SBP_REMOVE, aiPrimitiveType_POINT | aiPrimitiveType_LINE);
    aiSetImportPropertyFloat(store, AI_CONFIG_PP_GSN_MAX_SMOOTHING_ANGLE, CREASE_DEG);
    /* a file without meshes would get triangles where its nodes are */
    aiSetImportPropertyInteger(store, AI_CONFIG_IMPORT_NO_SKELETON_MESHES, 1);
    aiSetImportPropertyInteger(store, AI_CONFIG_IMPORT_FBX_PRESERVE_PIVOTS, 0);
    return store;
}

/* First without post-processing, so that we check the indices before Assimp follows them. */
static enum lw_status read_file(struct lw_foreign_import *import, struct lw_foreign_files *files,
                                struct lw_error *err) {
    struct aiPropertyStore *store = create_properties();
    if (!store) return lw_status_fail(err, LW_NO_MEMORY, "out of memory");
    const struct aiScene *ai = aiImportFileExWithProperties(files->name, 0, &files->io, store);
    import->ai = ai;
    if (!ai)
        (void)fail_by_assimp(import, err);
    else if (!ai->mRootNode)
        lw_status_fail(err, LW_BAD_DATA, "holds no scene");
    else if (!lw_foreign_meshes_check(import, err)) {
        unsigned steps = aiProcess_Triangulate | aiProcess_SortByPType;
        if (files->obj.smooth) steps |= aiProcess_GenSmoothNormals;
        import->ai = aiApplyPostProcessing(ai, steps);
        if (!import->ai) (void)fail_by_assimp(import, err); /* it has freed the scene */
    }
    aiReleasePropertyStore(store);
    return err->status;
}

/* ---- conversion ---- */

static void report(const struct lw_foreign_import *import, const struct lw_foreign_materials *materials,
                   const struct lw_foreign_meshes *meshes) {
    const char *path = import->desc->path;
    lw_foreign_materials_report(materials);
    lw_tally_warn(&meshes->bright, path, "vertex colours above 1 are lowered to 1");
    if (meshes->builder.degenerate_count)
        lw_log(LW_LOG_WARNING, "%s: %llu triangles without area are left out", path,
               (unsigned long long)meshes->builder.degenerate_count);
    if (meshes->turned_count)
        lw_log(LW_LOG_WARNING,
               "%s: %llu triangles are wound against their normals: the normals say what is front", path,
               (unsigned long long)meshes->turned_count);
}

/* ---- units and axes ---- */

static bool metadata(const struct aiMetadata *data, const char *key, enum aiMetadataType type, void *out) {
    for (unsigned i = 0; data && i < data->mNumProperties; i++)
        if (strcmp(data->mKeys[i].data, key) == 0 && data->mValues[i].mType == type) {
            memcpy(out, data->mValues[i].mData, 4); /* a float or an int */
            return true;
        }
    return false;
}

/* Row of the axis that `name` and nameSign describe; false if the file has none. */
static bool axis(const struct aiMetadata *data, const char *name, float unit, float row[4]) {
    char sign_key[32];
    int32_t index = -1, sign = 1;
    snprintf(sign_key, sizeof sign_key, "%sSign", name);
    if (!metadata(data, name, AI_INT32, &index) || index < 0 || index > 2) return false;
    if (metadata(data, sign_key, AI_INT32, &sign) && sign < 0) unit = -unit;
    memset(row, 0, 4 * sizeof *row);
    row[index] = unit;
    return true;
}

/* FBX says how many centimetres its unit is, and which of its axes point right, up and towards the viewer.
 * Assimp returns unit and axes. It has applied the ones of Collada. */
static enum lw_status apply_fbx_axes(struct lw_foreign_import *import, struct lw_error *err) {
    const struct aiMetadata *data = import->ai->mMetaData;
    float centimetres = 1;
    struct lw_affine place = LW_AFFINE_IDENTITY;
    if (!metadata(data, "UnitScaleFactor", AI_FLOAT, &centimetres) || !(centimetres > 0) ||
        !(centimetres <= 1e9f))
        centimetres = 1;
    float unit = 0.01f * centimetres;
    bool known = axis(data, "CoordAxis", unit, place.m[0]) && axis(data, "UpAxis", unit, place.m[1]) &&
                 axis(data, "FrontAxis", unit, place.m[2]);
    if (!known || lw_affine_determinant(&place) == 0)
        place = (struct lw_affine){{{unit, 0, 0, 0}, {0, unit, 0, 0}, {0, 0, unit, 0}}};
    return lw_new_root_add(import->scene, "FBX", &place, err);
}

static enum lw_status convert(struct lw_foreign_import *import, struct lw_error *err) {
    struct lw_foreign_materials materials;
    struct lw_foreign_meshes meshes;
    struct lw_foreign_nodes nodes = {0};
    lw_foreign_meshes_init(&meshes, &materials);
    if (!lw_foreign_materials_init(&materials, import, err) &&
        !lw_foreign_nodes_convert(&nodes, import, &meshes, err) &&
        !lw_foreign_animation_convert(import, &nodes, err) &&
        (import->desc->format != LW_SCENE_FORMAT_FBX || !apply_fbx_axes(import, err))) {
        report(import, &materials, &meshes);
        if (import->scene->object_count == 0)
            lw_status_fail(err, LW_BAD_DATA, "has no triangles: there is nothing to light");
        else if (lw_scene_validate(import->scene, err))
            lw_status_context(err, "as it was read");
    }
    lw_foreign_nodes_finish(&nodes);
    lw_foreign_meshes_finish(&meshes);
    lw_foreign_materials_finish(&materials);
    return err->status;
}

static enum lw_status load(const struct lw_foreign_desc *desc, struct lw_foreign_files *files,
                           struct lw_scene *scene, struct lw_error *err) {
    struct lw_foreign_import import = {.desc = desc, .files = files, .scene = scene};
    char reader[64];
    snprintf(reader, sizeof reader, "Assimp, which reads %s,", lw_scene_format_name(desc->format));
    const double mib = (double)files->size / (1 << 20);
    const struct lw_guard_desc guard = {
        .scene = desc->path,
        .reader = reader,
        .failure_fd = desc->failure_fd,
        .processor_s = desc->read_seconds > 0 ? desc->read_seconds : SECONDS_BASE + SECONDS_PER_MIB * mib,
        .memory_bytes = MEMORY_BASE + MEMORY_PER_BYTE * files->size};
    enum lw_status status = lw_foreign_text_mend(files, err);
    if (status) return status;
    lw_guard_enter(&guard);
    status = read_file(&import, files, err);
    lw_guard_lift(); /* pictures and lists of ours may take what they need */
    if (status == LW_OK) status = convert(&import, err);
    if (import.ai) aiReleaseImport(import.ai);
    lw_guard_leave();
    return status;
}

enum lw_status lw_foreign_load(const struct lw_foreign_desc *desc, struct lw_scene **out_scene,
                               struct lw_error *err) {
    struct lw_error own = {0};
    struct lw_foreign_files files;
    struct lw_scene *scene = NULL;
    enum lw_status status = lw_foreign_files_init(&files, desc->path, desc->format, &own);
    if (status == LW_OK && (status = lw_scene_create(&scene)) != LW_OK)
        lw_status_fail(&own, status, "out of memory");
    if (status == LW_OK) status = load(desc, &files, scene, &own);
    lw_foreign_files_finish(&files);
    if (status) {
        lw_scene_destroy(scene);
        return lw_status_fail(err, status, "%s: %s", desc->path, own.text);
    }
    *out_scene = scene;
    return LW_OK;
}
