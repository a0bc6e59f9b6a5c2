/* records.h: the shape that our packages share: a header, a table of sections, records and arrays, without a
 * gap. One description of each record measures, writes and reads, so that writer and reader cannot disagree.
 * Flow:    package, finish_package -> [records] -> bytes, and back
 * Threads: pure functions, [any]. Format: docs/scene_package.md. */
#ifndef LW_COMMON_RECORDS_H
#define LW_COMMON_RECORDS_H

#include "common/base/status.h"
#include "common/scene/scene.h"

#include <stddef.h>
#include <stdint.h>
#include <string.h>

#define LW_RECORDS_SECTIONS_MAX 32u
#define LW_RECORDS_NO_LIMIT     UINT32_MAX
#define LW_RECORDS_MAGIC        8u
#define LW_RECORDS_HEADER       32u
#define LW_RECORDS_ENTRY        24u /* bytes; of the section table */

struct lw_records_kind {
    const char *name;
    uint32_t element_size, limit; /* bytes; most elements */
};

struct lw_records_format {
    const char *magic, *what; /* LW_RECORDS_MAGIC bytes; what messages call it */
    const struct lw_records_kind *kind;
    unsigned strings; /* the section of names */
    uint64_t size_max;
};

enum lw_records_mode {
    LW_RECORDS_MEASURE, /* counts elements per section */
    LW_RECORDS_WRITE,
    LW_RECORDS_READ
};

struct lw_records_section {
    uint8_t *bytes;
    uint64_t count;  /* elements */
    uint64_t cursor; /* elements used so far: each array lies right behind the one before */
};

struct lw_records {
    const struct lw_records_format *format;
    enum lw_records_mode mode;
    uint32_t version, section_count;
    struct lw_records_section section[LW_RECORDS_SECTIONS_MAX];
    uint8_t *at; /* in the record */
    unsigned record_section;
    uint32_t record;
    enum lw_status status; /* the first failure's; later fields are then read as zero */
    struct lw_error *err;
};

/** Notes a failure at the record; the first one counts. */
void LW_PRINTF(2, 3) lw_record_fail(struct lw_records *c, const char *format, ...);
/** Begins record number `record` of a section; its fields follow in order. */
void lw_record_begin(struct lw_records *c, unsigned id, uint32_t record);
/** Fields of 4 bytes: numbers and floats, `count` in a row. */
void lw_record_words(struct lw_records *c, void *words, size_t count);
/** A small number that takes a word in the file and a byte in memory. */
void lw_record_choice(struct lw_records *c, uint8_t *value, uint32_t max, const char *field);
/** A word that is 0. */
void lw_record_reserved(struct lw_records *c);
/** Takes `count` elements of a section, from element `first` on; returns where they begin, or NULL. */
uint8_t *lw_record_take(struct lw_records *c, unsigned id, uint64_t count, uint32_t first, const char *field);
/** An array as the scene holds it, written or found; NULL if it is absent. */
const void *lw_record_array(struct lw_records *c, unsigned id, const void *elements, uint64_t count,
                            const char *field);
/** A texture as a material uses it. */
void lw_record_texture_use(struct lw_records *c, struct lw_texture_use *use);
/** A name. It ends with a NUL that its length does not count, so that the reader can point at it. */
const char *lw_record_string(struct lw_records *c, const char *text);

/** After all records were measured: where each section begins, and the size of the whole. Errors: LW_BAD_DATA
 * past the format's largest size. */
LW_MUST_CHECK enum lw_status lw_records_measure(struct lw_records *c,
                                                uint64_t offset[LW_RECORDS_SECTIONS_MAX], uint64_t *out_size);
/** Writes header and table into zeroed bytes; all records go through it once more. */
void lw_records_start_writing(struct lw_records *c, const uint64_t offset[LW_RECORDS_SECTIONS_MAX],
                              uint8_t *bytes, uint64_t size);

/** Finds the sections of bytes whose header was checked. Sections follow one another in order with nothing
 * between them but zeros up to the next multiple of 16. Errors: LW_BAD_DATA naming the section. */
LW_MUST_CHECK enum lw_status lw_records_read_table(struct lw_records *c, uint8_t *bytes, size_t size);
/** After all records were read: whether each element is in use. Errors: LW_BAD_DATA. */
LW_MUST_CHECK enum lw_status lw_records_check_used(const struct lw_records *c);

static inline void lw_records_put_u32(uint8_t *p, uint32_t value) { memcpy(p, &value, sizeof value); }
static inline void lw_records_put_u64(uint8_t *p, uint64_t value) { memcpy(p, &value, sizeof value); }
static inline uint32_t lw_records_get_u32(const uint8_t *p) {
    uint32_t value;
    memcpy(&value, p, sizeof value);
    return value;
}
static inline uint64_t lw_records_get_u64(const uint8_t *p) {
    uint64_t value;
    memcpy(&value, p, sizeof value);
    return value;
}

/* Calls `call`, which describes the record `element`, for each of a section's. Only a reader may store into
 * the scene: while it is written, others may read it. */
#define LW_RECORDS_EACH(c, id, elements, element_count, call)                                                \
    for (uint32_t i = 0; !(c)->status && i < (element_count); i++) {                                         \
        typeof(*(elements)) element = (elements)[i];                                                         \
        lw_record_begin(c, id, i);                                                                           \
        call;                                                                                                \
        if ((c)->mode == LW_RECORDS_READ) (elements)[i] = element;                                           \
    }

#endif
