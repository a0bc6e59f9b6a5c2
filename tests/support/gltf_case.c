#include "tests/support/gltf_case.h"

#include "common/base/log.h"
#include "server/import/gltf/gltf.h"
#include "tests/support/glb.h"

#include <fcntl.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <unistd.h>

const struct gltf_case_base_data gltf_case_base_data = {
    .position = {{0, 0, 0}, {1, 0, 0}, {0, 1, 0}, {1, 1, 0}},
    .normal = {{0, 0, 1}, {0, 0, 1}, {0, 0, 2}, {0, 0, 1}},
    .uv = {{0, 1}, {1, 1}, {0, 0}, {1, 0}},
    .index = {0, 1, 2, 2, 1, 3},
    .time = {0, 2},
    .value = {{0, 1, 0}, {0, 3, 0}},
};

/* ' stands for " */
const char gltf_case_base_json[] =
    "{'asset':{'version':'2.0'},"
    "'extensionsUsed':['KHR_lights_punctual','KHR_materials_emissive_strength','KHR_texture_transform'],"
    "'extensions':{'KHR_lights_punctual':{'lights':[{'type':'spot','color':[1,0.5,0.25],'intensity':8,'spot':"
    "{}}]}},"
    "'scene':0,'scenes':[{'name':'base','nodes':[0,2]}],"
    "'nodes':[{'name':'top','children':[1],'translation':[0,1,0]},{'mesh':0},"
    "{'name':'lamp','camera':0,'extensions':{'KHR_lights_punctual':{'light':0}}}],"
    "'cameras':[{'type':'perspective','perspective':{'yfov':0.75}}],"
    "'meshes':[{'name':'square','primitives':[{'attributes':{'POSITION':0,'NORMAL':1,'TEXCOORD_0':2},'"
    "indices':3,"
    "'material':0}]}],"
    "'materials':[{'name':'paint','pbrMetallicRoughness':{'baseColorFactor':[0.5,0.25,0.125,1],"
    "'baseColorTexture':{'index':0}},'emissiveFactor':[1,0.5,0],"
    "'extensions':{'KHR_materials_emissive_strength':{'emissiveStrength':4}},"
    "'alphaMode':'MASK','alphaCutoff':0.25,'doubleSided':true}],"
    "'textures':[{'source':0,'sampler':0}],'samplers':[{'wrapS':33071,'wrapT':33648}],"
    "'images':[{'uri':'data:image/png;base64," GLTF_CASE_PNG "'}],"
    "'animations':[{'channels':[{'sampler':0,'target':{'node':0,'path':'translation'}}],"
    "'samplers':[{'input':4,'output':5}]}],"
    "'accessors':[{'bufferView':0,'componentType':5126,'count':4,'type':'VEC3'},"
    "{'bufferView':1,'componentType':5126,'count':4,'type':'VEC3'},"
    "{'bufferView':2,'componentType':5126,'count':4,'type':'VEC2'},"
    "{'bufferView':3,'componentType':5123,'count':6,'type':'SCALAR'},"
    "{'bufferView':4,'componentType':5126,'count':2,'type':'SCALAR'},"
    "{'bufferView':5,'componentType':5126,'count':2,'type':'VEC3'}],"
    "'bufferViews':[{'buffer':0,'byteLength':48},{'buffer':0,'byteOffset':48,'byteLength':48},"
    "{'buffer':0,'byteOffset':96,'byteLength':32},{'buffer':0,'byteOffset':128,'byteLength':12},"
    "{'buffer':0,'byteOffset':140,'byteLength':8},{'buffer':0,'byteOffset':148,'byteLength':24}],"
    "'buffers':[{'byteLength':172}]}";

static char *replace(char *text, const struct gltf_case_change *change) {
    char *at = strstr(text, change->old);
    if (!at) fail_msg("the base scene has no %s", change->old);
    char *out = malloc(strlen(text) + strlen(change->new) + 1);
    sprintf(out, "%.*s%s%s", (int)(at - text), text, change->new, at + strlen(change->old));
    free(text);
    return out;
}

bool gltf_case_matt; /* the next load takes no finishes */

static enum lw_status load_json(const char *json, const void *data, size_t size, struct lw_scene **out,
                                struct lw_error *err) {
    size_t packed_size;
    uint8_t *packed = lw_glb_pack(json, data, size, &packed_size);
    const struct lw_gltf_options options = {.matt = gltf_case_matt};
    enum lw_status status = lw_gltf_load_bytes(packed, packed_size, "base.glb", &options, out, err);
    free(packed);
    return status;
}

enum lw_status gltf_case_load_changed(const struct gltf_case_change *changes, size_t count, const void *data,
                                      size_t size, struct lw_scene **out, struct lw_error *err) {
    char *json = strdup(gltf_case_base_json);
    for (size_t i = 0; i < count; i++) json = replace(json, &changes[i]);
    enum lw_status status = load_json(json, data, size, out, err);
    free(json);
    return status;
}

void gltf_case_expect_refusal(const struct gltf_case_change *changes, size_t count, const void *data,
                              size_t size, const char *text) {
    struct lw_scene *scene = NULL;
    struct lw_error err = {0};
    enum lw_status status = gltf_case_load_changed(changes, count, data, size, &scene, &err);
    if (status != LW_BAD_DATA)
        fail_msg("%s: status is \"%s\", text \"%s\"", text, lw_status_text(status), err.text);
    assert_null(scene);
    if (strncmp(err.text, "base.glb: ", 10) != 0 || !strstr(err.text, text))
        fail_msg("\"%s\" does not hold \"%s\"", err.text, text);
}

const struct gltf_case_change gltf_case_no_change = {"'asset'", "'asset'"};

struct lw_scene *gltf_case_load_and_listen(const struct gltf_case_change *changes, size_t count,
                                           const void *data, size_t size, char *talk, size_t talk_size) {
    struct lw_scene *scene;
    struct lw_error err = {0};
    fflush(stderr);
    int saved = dup(STDERR_FILENO),
        file = open(lw_support_temporary("talk"), O_RDWR | O_CREAT | O_TRUNC, 0600);
    assert_true(saved >= 0 && file >= 0 && dup2(file, STDERR_FILENO) >= 0);
    lw_log_init("test_gltf", LW_LOG_WARNING);
    enum lw_status status = gltf_case_load_changed(changes, count, data, size, &scene, &err);
    lw_log_init("test_gltf", LW_LOG_ERROR);
    fflush(stderr);
    dup2(saved, STDERR_FILENO);
    ssize_t length = pread(file, talk, talk_size - 1, 0);
    talk[length > 0 ? length : 0] = 0;
    close(saved);
    close(file);
    lw_support_ok(status, &err);
    return scene;
}

unsigned gltf_case_count_lines(const char *text) {
    unsigned lines = 0;
    for (; *text; text++) lines += *text == '\n';
    return lines;
}
