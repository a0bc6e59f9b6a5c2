/* gltf_case.h: a base scene of glTF that holds one of everything, and what becomes of it when one place in it
 * is changed. In its JSON ' stands for ". */
#ifndef LW_TESTS_GLTF_CASE_H
#define LW_TESTS_GLTF_CASE_H

#include "server/import/gltf/gltf.h"
#include "tests/support/support.h"

/* 2 x 1 texels: (255, 0, 0, 255), (0, 128, 255, 64) */
#define GLTF_CASE_PNG                                                                                        \
    "iVBORw0KGgoAAAANSUhEUgAAAAIAAAABCAYAAAD0In+KAAAAEUlEQVR4nGP4z8Dwn6HhvwMAELoDvkeWIKAAAAAASU"             \
    "VORK5CYII="

/** The binary part of the base scene: a square in the x-y plane, and a path of two keys. */
struct gltf_case_base_data {
    float position[4][3], normal[4][3], uv[4][2];
    uint16_t index[6];
    float time[2], value[2][3];
};

extern const struct gltf_case_base_data gltf_case_base_data;

extern const char gltf_case_base_json[];

struct gltf_case_change {
    const char *old, *new;
};

extern bool gltf_case_matt;

enum lw_status gltf_case_load_changed(const struct gltf_case_change *changes, size_t count, const void *data,
                                      size_t size, struct lw_scene **out, struct lw_error *err);

/* The base scene with changes; it must load. */
#define GLTF_CASE_LOAD(scene, data, ...)                                                                     \
    do {                                                                                                     \
        const struct gltf_case_change changes_[] = {__VA_ARGS__};                                            \
        struct lw_error err_ = {0};                                                                          \
        lw_support_ok(gltf_case_load_changed(changes_, sizeof changes_ / sizeof *changes_, &(data),          \
                                             sizeof(data), &(scene), &err_),                                 \
                      &err_);                                                                                \
    } while (0)

/* The base scene with changes; it must be refused with a line that holds `text`. */
#define GLTF_CASE_REFUSE(text, data, ...)                                                                    \
    do {                                                                                                     \
        const struct gltf_case_change changes_[] = {__VA_ARGS__};                                            \
        gltf_case_expect_refusal(changes_, sizeof changes_ / sizeof *changes_, &(data), sizeof(data), text); \
    } while (0)

void gltf_case_expect_refusal(const struct gltf_case_change *changes, size_t count, const void *data,
                              size_t size, const char *text);

extern const struct gltf_case_change gltf_case_no_change;

/** Loads with `changes`; talk gets the lines that the load logs. The scene must load. */
struct lw_scene *gltf_case_load_and_listen(const struct gltf_case_change *changes, size_t count,
                                           const void *data, size_t size, char *talk, size_t talk_size);

unsigned gltf_case_count_lines(const char *text);

#endif
