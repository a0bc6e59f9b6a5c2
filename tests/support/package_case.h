/* package_case.h: what the tests of packages share: scenes, their bytes, and comparisons. */
#ifndef LW_TESTS_PACKAGE_CASE_H
#define LW_TESTS_PACKAGE_CASE_H

#include "tests/support/support.h"

/** The package of a scene; the caller frees. */
uint8_t *package_case_write(const struct lw_scene *scene, size_t *out_size);
/** The same with a checksum of each block. */
uint8_t *package_case_write_sealed(const struct lw_scene *scene, size_t *out_size);
/** The package of lw_support_everything(). */
uint8_t *package_case_write_everything(size_t *out_size);

/** Ends the test unless all values of both scenes are equal. */
void package_case_expect_same_scene(const struct lw_scene *a, const struct lw_scene *b);

/** Reads from a block of exactly that size, so that a sanitizer sees every byte too many. */
enum lw_status package_case_read_exactly(const uint8_t *bytes, size_t size, struct lw_error *err);

/** Overwrites bytes at p. */
void package_case_set_u32(uint8_t *p, uint32_t value);
void package_case_set_u64(uint8_t *p, uint64_t value);

#define HEADER_SIZE 32u
#define ENTRY(n)    (HEADER_SIZE + 24u * ((n)-1)) /* offset of section id n */
enum {
    SCENE = 1,
    MESHES,
    MATERIALS,
    TEXTURES,
    NODES,
    OBJECTS,
    LIGHTS,
    CAMERAS,
    CHANNELS,
    STRINGS,
    POSITIONS
};

/** Where a section begins, by the table of a package. */
uint64_t package_case_section_offset(const uint8_t *bytes, unsigned id);

#endif
