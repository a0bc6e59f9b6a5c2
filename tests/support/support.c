#include "tests/support/support.h"

#include <ctype.h>
#include <dirent.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <unistd.h>

void lw_support_ok(enum lw_status status, const struct lw_error *err) {
    if (status != LW_OK) fail_msg("%s: %s", lw_status_text(status), err ? err->text : "");
}

void lw_support_fails(enum lw_status status, enum lw_status expected, const struct lw_error *err,
                      const char *text) {
    if (status != expected)
        fail_msg("\"%s\" instead of \"%s\"; error: %s", lw_status_text(status), lw_status_text(expected),
                 err->text);
    if (!strstr(err->text, text)) fail_msg("error \"%s\" does not say \"%s\"", err->text, text);
    assert_int_equal(err->status, expected);
}

/* The program's folder for files that it leaves behind, made at its first use. */
static char temporary_folder[64];
static pid_t temporary_owner;

static void remove_folder(void) {
    if (getpid() != temporary_owner) return; /* a forked child ends before its parent is done */
    char command[128];
    snprintf(command, sizeof command, "rm -rf '%s'", temporary_folder);
    if (system(command) != 0) fprintf(stderr, "cannot remove %s\n", temporary_folder);
}

const char *lw_support_temporary(const char *name) {
    static char paths[LW_SUPPORT_PATHS][128];
    static unsigned next;
    if (!*temporary_folder) {
        strcpy(temporary_folder, "/tmp/lightwell-test-XXXXXX");
        assert_non_null(mkdtemp(temporary_folder));
        temporary_owner = getpid();
        assert_int_equal(atexit(remove_folder), 0);
    }
    char *path = paths[next++ % LW_SUPPORT_PATHS];
    int length = snprintf(path, sizeof paths[0], "%s/%s", temporary_folder, name);
    assert_true(length > 0 && (size_t)length < sizeof paths[0]);
    return path;
}

const char *lw_support_source(const char *relative) {
    static char path[4096];
    int length = snprintf(path, sizeof path, "%s/%s", LW_SOURCE_DIR, relative);
    assert_true(length > 0 && (size_t)length < sizeof path);
    return path;
}

size_t lw_support_files_in(const char *folder) {
    DIR *open = opendir(folder);
    assert_non_null(open);
    size_t files = 0;
    for (struct dirent *entry; (entry = readdir(open));) files += entry->d_name[0] != '.';
    closedir(open);
    return files;
}

size_t lw_support_count_files(const char *relative) {
    return lw_support_files_in(lw_support_source(relative));
}

uint32_t lw_support_object(const struct lw_scene *scene, const char *name) {
    for (uint32_t o = 0; o < scene->object_count; o++)
        if (strcmp(scene->object[o].name, name) == 0) return o;
    fail_msg("no object %s", name);
    return 0;
}

struct lw_material *lw_support_material(const struct lw_scene *scene, const char *name) {
    for (uint32_t m = 0; m < scene->material_count; m++)
        if (strcmp(scene->material[m].name, name) == 0) return &scene->material[m];
    fail_msg("no material %s", name);
    return NULL;
}

const struct lw_light *lw_support_light(const struct lw_scene *scene, const char *name) {
    for (uint32_t i = 0; i < scene->light_count; i++)
        if (strcmp(scene->light[i].name, name) == 0) return &scene->light[i];
    fail_msg("no light %s", name);
    return NULL;
}

uint64_t lw_support_triangles(const struct lw_scene *scene) {
    uint64_t count = 0;
    for (uint32_t o = 0; o < scene->object_count; o++)
        count += scene->mesh[scene->object[o].mesh].triangle_count;
    return count;
}

const char *lw_support_scene(const char *relative) {
    static char path[4096];
    const char *folder = getenv("LW_TEST_SCENES");
    int length =
        snprintf(path, sizeof path, "%s/%s", folder ? folder : LW_SOURCE_DIR "/../shared/scenes", relative);
    assert_true(length > 0 && (size_t)length < sizeof path);
    if (access(path, R_OK) != 0) {
        print_message("skipped: no %s (set LW_TEST_SCENES)\n", path);
        skip();
    }
    return path;
}

uint8_t *lw_support_read_file(const char *path, size_t *out_size) {
    FILE *file = fopen(path, "rb");
    if (!file) fail_msg("cannot open %s", path);
    assert_int_equal(fseek(file, 0, SEEK_END), 0);
    long size = ftell(file);
    assert_true(size >= 0);
    rewind(file);
    uint8_t *bytes = malloc((size_t)size + 1);
    assert_non_null(bytes);
    assert_int_equal(fread(bytes, 1, (size_t)size, file), (size_t)size);
    bytes[size] = 0;
    fclose(file);
    *out_size = (size_t)size;
    return bytes;
}

char *lw_support_read_text(const char *folder, const char *name) {
    char path[300];
    size_t size;
    snprintf(path, sizeof path, "%s/%s", folder, name);
    return (char *)lw_support_read_file(path, &size);
}

size_t lw_support_document_bytes(const char **text, uint8_t *out, size_t capacity) {
    const char *line = strstr(*text, "```hex\n");
    assert_non_null(line);
    size_t count = 0;
    for (line = strchr(line, '\n') + 1; strncmp(line, "```", 3) != 0; line = strchr(line, '\n') + 1) {
        char *end;
        assert_int_equal(strtoul(line, &end, 16), count); /* the offset */
        while (true) {
            const char *start = end + strspn(end, " ");
            if (!isxdigit((unsigned char)*start)) break; /* strtoul would go on to the next line */
            unsigned long byte = strtoul(start, &end, 16);
            assert_true(byte < 256 && count < capacity);
            out[count++] = (uint8_t)byte;
        }
        assert_true(end[strspn(end, " ")] == ';' || *end == '\n');
    }
    *text = line;
    return count;
}

char *lw_support_replaced(const char *text, const char *old, const char *new) {
    const char *at = strstr(text, old);
    if (!at) fail_msg("there is no %s", old);
    char *out = malloc(strlen(text) + strlen(new) + 1);
    assert_non_null(out);
    sprintf(out, "%.*s%s%s", (int)(at - text), text, new, at + strlen(old));
    return out;
}

int lw_support_command_line(char *argv[LW_SUPPORT_WORDS_MAX], const char *command, const char *option,
                            const char *value) {
    const char *const words[LW_SUPPORT_WORDS_MAX] = {command, "builtin:cornell", "-o", "out", option, value,
                                                     NULL};
    for (int i = 0; i < LW_SUPPORT_WORDS_MAX; i++) argv[i] = (char *)words[i];
    return option ? 6 : 4;
}

void lw_support_pause(void) { usleep(1000); }

void lw_support_write_file(const char *path, const void *bytes, size_t size) {
    FILE *file = fopen(path, "wb");
    if (!file || fwrite(bytes, 1, size, file) != size || fclose(file)) fail_msg("cannot write %s", path);
}

struct lw_finish *lw_support_finish(struct lw_scene *scene, uint32_t material, float metalness,
                                    float roughness) {
    const struct lw_texture_use none = {.texture = LW_SCENE_NONE, .transform = {1, 0, 0, 0, 1, 0}};
    struct lw_finish *finish = lw_scene_alloc(scene, 1, sizeof *finish);
    assert_non_null(finish);
    *finish = (struct lw_finish){.metalness = metalness,
                                 .roughness = roughness,
                                 .surface_texture = none,
                                 .specular = 1,
                                 .specular_colour = {1, 1, 1},
                                 .specular_texture = none,
                                 .ior = 1.5f,
                                 .occlusion_texture = none,
                                 .normal_scale = 1,
                                 .normal_texture = none};
    scene->material[material].finish = finish;
    return finish;
}

struct lw_scene *lw_support_squares(unsigned count, float side_m) {
    struct lw_scene *scene;
    lw_support_ok(lw_scene_create(&scene), NULL);
    scene->name = lw_scene_string(scene, "squares");
    struct lw_vec3 *position = lw_scene_alloc(scene, 4, sizeof *position),
                   *normal = lw_scene_alloc(scene, 4, sizeof *normal);
    struct lw_vec2 *uv = lw_scene_alloc(scene, 4, sizeof *uv);
    uint32_t(*triangle)[3] = lw_scene_alloc(scene, 2, sizeof *triangle);
    uint32_t *material = lw_scene_alloc(scene, 2, sizeof *material);
    for (uint32_t i = 0; i < 4; i++) {
        uv[i] = (struct lw_vec2){(float)(i & 1), (float)(i >> 1)};
        position[i] = lw_vec3((uv[i].x - 0.5f) * side_m, 0, (uv[i].y - 0.5f) * side_m);
        normal[i] = lw_vec3(0, 1, 0);
    }
    const uint32_t corners[2][3] = {{0, 2, 1}, {1, 2, 3}};
    for (int t = 0; t < 2; t++)
        for (int c = 0; c < 3; c++) triangle[t][c] = corners[t][c];
    scene->mesh = lw_scene_alloc(scene, 1, sizeof *scene->mesh);
    scene->mesh[0] = (struct lw_mesh){.name = "square",
                                      .vertex_count = 4,
                                      .triangle_count = 2,
                                      .position = position,
                                      .normal = normal,
                                      .uv = {uv},
                                      .triangle = triangle,
                                      .material = material};
    scene->mesh_count = 1;
    const float identity[6] = {1, 0, 0, 0, 1, 0};
    scene->material = lw_scene_alloc(scene, 1, sizeof *scene->material);
    scene->material[0] = (struct lw_material){.name = "grey",
                                              .base_colour = {0.5f, 0.5f, 0.5f, 1},
                                              .base_colour_texture.texture = LW_SCENE_NONE,
                                              .emission_texture.texture = LW_SCENE_NONE,
                                              .alpha_cutoff = 0.5f};
    for (int i = 0; i < 6; i++)
        scene->material[0].base_colour_texture.transform[i] =
            scene->material[0].emission_texture.transform[i] = identity[i];
    scene->material_count = 1;
    scene->node = lw_scene_alloc(scene, count + 1, sizeof *scene->node);
    scene->object = lw_scene_alloc(scene, count, sizeof *scene->object);
    for (uint32_t i = 0; i <= count; i++)
        scene->node[i] =
            (struct lw_node){.name = "",
                             .parent = LW_SCENE_NONE,
                             .rotation = {0, 0, 0, 1},
                             .scale = {1, 1, 1},
                             .translation = {i < count ? 2 * side_m * (float)i : 0, i < count ? 0 : 2.0f, 0}};
    for (uint32_t i = 0; i < count; i++) {
        char name[32];
        snprintf(name, sizeof name, "square %u", i);
        scene->object[i] = (struct lw_object){.name = lw_scene_string(scene, name), .mesh = 0, .node = i};
    }
    scene->node_count = count + 1;
    scene->object_count = count;
    scene->light = lw_scene_alloc(scene, 1, sizeof *scene->light);
    scene->light[0] =
        (struct lw_light){.name = "lamp", .node = count, .kind = LW_LIGHT_POINT, .intensity = {10, 10, 10}};
    scene->light_count = 1;
    return scene;
}

double lw_support_relmse(const float *rgb, const float *reference, size_t values) {
    double square = 0, sum = 0;
    for (size_t i = 0; i < values; i++) square += (double)reference[i] * (double)reference[i];
    const double eps = 0.01 * square / (double)values;
    for (size_t i = 0; i < values; i++) {
        const double t = (double)reference[i], off = (double)rgb[i] - t;
        sum += off * off / (t * t + eps);
    }
    return sum / (double)values;
}
