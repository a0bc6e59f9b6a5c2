#include "common/scene/records.h"

#include <stdarg.h>
#include <stdio.h>

_Static_assert(__BYTE_ORDER__ == __ORDER_LITTLE_ENDIAN__,
               "packages are little-endian, and so are their readers");

#define ALIGNMENT 16u
#define ABSENT    UINT32_MAX /* first element of an array that is not there */

void lw_record_fail(struct lw_records *c, const char *format, ...) {
    if (c->status) return;
    char text[256];
    va_list args;
    va_start(args, format);
    vsnprintf(text, sizeof text, format, args);
    va_end(args);
    c->status = lw_status_fail(c->err, LW_BAD_DATA, "section %s, record %u: %s",
                               c->format->kind[c->record_section].name, c->record, text);
}

void lw_record_words(struct lw_records *c, void *words, size_t count) {
    size_t size = 4 * count;
    if (c->mode == LW_RECORDS_WRITE) memcpy(c->at, words, size);
    if (c->mode == LW_RECORDS_READ) memcpy(words, c->at, size);
    if (c->mode != LW_RECORDS_MEASURE) c->at += size;
}

void lw_record_choice(struct lw_records *c, uint8_t *value, uint32_t max, const char *field) {
    uint32_t word = *value;
    lw_record_words(c, &word, 1);
    if (c->mode != LW_RECORDS_READ) return;
    if (word > max)
        lw_record_fail(c, "%s is %u; the largest is %u", field, word, max);
    else
        *value = (uint8_t)word;
}

void lw_record_reserved(struct lw_records *c) {
    uint32_t word = 0;
    lw_record_words(c, &word, 1);
    if (word != 0) lw_record_fail(c, "a reserved field is %u, not 0", word);
}

uint8_t *lw_record_take(struct lw_records *c, unsigned id, uint64_t count, uint32_t first,
                        const char *field) {
    struct lw_records_section *section = &c->section[id];
    if (c->mode == LW_RECORDS_READ) {
        if (first != section->cursor) {
            lw_record_fail(c, "%s starts at %u of %s; the next free element is %llu", field, first,
                           c->format->kind[id].name, (unsigned long long)section->cursor);
            return NULL;
        }
        if (count > section->count - section->cursor) {
            lw_record_fail(c, "%s takes %llu %s from %u on; there are %llu", field, (unsigned long long)count,
                           c->format->kind[id].name, first, (unsigned long long)section->count);
            return NULL;
        }
    }
    uint8_t *start =
        section->bytes ? section->bytes + section->cursor * c->format->kind[id].element_size : NULL;
    section->cursor += count;
    return start;
}

const void *lw_record_array(struct lw_records *c, unsigned id, const void *elements, uint64_t count,
                            const char *field) {
    uint32_t first = elements ? (uint32_t)c->section[id].cursor : ABSENT;
    lw_record_words(c, &first, 1);
    if (first == ABSENT || c->status) return NULL;
    uint8_t *start = lw_record_take(c, id, count, first, field);
    if (c->mode == LW_RECORDS_READ) return start;
    if (c->mode == LW_RECORDS_WRITE && count > 0)
        memcpy(start, elements, count * c->format->kind[id].element_size);
    return elements;
}

void lw_record_texture_use(struct lw_records *c, struct lw_texture_use *use) {
    lw_record_words(c, &use->texture, 1);
    lw_record_words(c, &use->uv_set, 1);
    lw_record_words(c, use->transform, 6);
}

const char *lw_record_string(struct lw_records *c, const char *text) {
    uint64_t length = text ? strlen(text) : 0;
    /* a place past 32 bits is cut here; the whole then exceeds the size limit */
    uint32_t place[2] = {(uint32_t)c->section[c->format->strings].cursor, (uint32_t)length};
    lw_record_words(c, place, 2);
    if (c->status) return text;
    uint64_t size = (c->mode == LW_RECORDS_READ ? place[1] : length) + 1;
    uint8_t *start = lw_record_take(c, c->format->strings, size, place[0], "name");
    if (c->mode == LW_RECORDS_WRITE) memcpy(start, text, size);
    if (c->mode != LW_RECORDS_READ || !start) return text;
    if (memchr(start, 0, size) != start + place[1]) {
        lw_record_fail(c, "name of %u bytes does not end where its NUL is", place[1]);
        return NULL;
    }
    return (const char *)start;
}

void lw_record_begin(struct lw_records *c, unsigned id, uint32_t record) {
    c->record_section = id;
    c->record = record;
    c->at = lw_record_take(c, id, 1, (uint32_t)c->section[id].cursor, "record");
}

static uint64_t align(uint64_t offset) { return (offset + ALIGNMENT - 1) / ALIGNMENT * ALIGNMENT; }

static uint64_t lay_out(const struct lw_records *c, uint64_t offset[LW_RECORDS_SECTIONS_MAX]) {
    uint64_t end = LW_RECORDS_HEADER + c->section_count * LW_RECORDS_ENTRY;
    for (uint32_t i = 0; i < c->section_count; i++) {
        offset[i] = align(end);
        end = offset[i] + c->section[i].count * c->format->kind[i].element_size;
    }
    return end;
}

static void write_header(const struct lw_records *c, const uint64_t offset[LW_RECORDS_SECTIONS_MAX],
                         uint8_t *bytes, uint64_t size) {
    memcpy(bytes, c->format->magic, LW_RECORDS_MAGIC);
    lw_records_put_u32(bytes + 8, c->version);
    lw_records_put_u32(bytes + 12, c->section_count);
    lw_records_put_u64(bytes + 16, size);
    for (uint32_t i = 0; i < c->section_count; i++) {
        uint8_t *entry = bytes + LW_RECORDS_HEADER + i * LW_RECORDS_ENTRY;
        lw_records_put_u32(entry, i + 1);
        lw_records_put_u32(entry + 4, c->format->kind[i].element_size);
        lw_records_put_u64(entry + 8, offset[i]);
        lw_records_put_u64(entry + 16, c->section[i].count);
    }
}

/* One entry of the table. Sections follow one another in order with nothing between them but zeros up to the
 * next multiple of 16, so there is one right offset for each: that rules out overlaps, gaps, duplicates and
 * omissions. */
static enum lw_status read_entry(struct lw_records *c, uint32_t i, uint8_t *bytes, size_t size,
                                 uint64_t *end) {
    const uint8_t *entry = bytes + LW_RECORDS_HEADER + i * LW_RECORDS_ENTRY;
    const char *name = c->format->kind[i].name;
    uint64_t offset = lw_records_get_u64(entry + 8), count = lw_records_get_u64(entry + 16);
    if (lw_records_get_u32(entry) != i + 1)
        return lw_status_fail(c->err, LW_BAD_DATA, "entry %u of the section table has id %u, not %u (%s)", i,
                              lw_records_get_u32(entry), i + 1, name);
    if (lw_records_get_u32(entry + 4) != c->format->kind[i].element_size)
        return lw_status_fail(c->err, LW_BAD_DATA, "section %s has elements of %u bytes, not %u", name,
                              lw_records_get_u32(entry + 4), c->format->kind[i].element_size);
    if (offset != align(*end) || offset > size)
        return lw_status_fail(c->err, LW_BAD_DATA, "section %s starts at byte %llu, not %llu of %zu", name,
                              (unsigned long long)offset, (unsigned long long)align(*end), size);
    if (count > (size - offset) / c->format->kind[i].element_size)
        return lw_status_fail(c->err, LW_BAD_DATA, "section %s has %llu elements, more than the file holds",
                              name, (unsigned long long)count);
    if (count > c->format->kind[i].limit)
        return lw_status_fail(c->err, LW_BAD_DATA, "section %s has %llu elements; the limit is %u", name,
                              (unsigned long long)count, c->format->kind[i].limit);
    for (uint64_t p = *end; p < offset; p++)
        if (bytes[p] != 0)
            return lw_status_fail(c->err, LW_BAD_DATA, "byte %llu before section %s is padding, but not 0",
                                  (unsigned long long)p, name);
    c->section[i].bytes = bytes + offset;
    c->section[i].count = count;
    *end = offset + count * c->format->kind[i].element_size;
    return LW_OK;
}

enum lw_status lw_records_read_table(struct lw_records *c, uint8_t *bytes, size_t size) {
    uint64_t end = LW_RECORDS_HEADER + c->section_count * LW_RECORDS_ENTRY;
    for (uint32_t i = 0; i < c->section_count; i++) {
        enum lw_status status = read_entry(c, i, bytes, size, &end);
        if (status) return status;
    }
    if (end != size)
        return lw_status_fail(c->err, LW_BAD_DATA, "%s ends at byte %llu, but there are %zu", c->format->what,
                              (unsigned long long)end, size);
    return LW_OK;
}

enum lw_status lw_records_check_used(const struct lw_records *c) {
    for (uint32_t i = 0; i < c->section_count; i++)
        if (c->section[i].cursor != c->section[i].count)
            return lw_status_fail(c->err, LW_BAD_DATA, "section %s has %llu elements, but %llu are in use",
                                  c->format->kind[i].name, (unsigned long long)c->section[i].count,
                                  (unsigned long long)c->section[i].cursor);
    return LW_OK;
}

enum lw_status lw_records_measure(struct lw_records *c, uint64_t offset[LW_RECORDS_SECTIONS_MAX],
                                  uint64_t *out_size) {
    if (c->status) return c->status;
    for (uint32_t i = 0; i < c->section_count; i++) {
        c->section[i].count = c->section[i].cursor;
        c->section[i].cursor = 0;
    }
    const uint64_t size = lay_out(c, offset);
    if (size > c->format->size_max)
        return lw_status_fail(c->err, LW_BAD_DATA, "the %s would take %llu bytes; the limit is %llu",
                              c->format->what, (unsigned long long)size,
                              (unsigned long long)c->format->size_max);
    *out_size = size;
    return LW_OK;
}

void lw_records_start_writing(struct lw_records *c, const uint64_t offset[LW_RECORDS_SECTIONS_MAX],
                              uint8_t *bytes, uint64_t size) {
    write_header(c, offset, bytes, size);
    for (uint32_t i = 0; i < c->section_count; i++) c->section[i].bytes = bytes + offset[i];
    c->mode = LW_RECORDS_WRITE;
}
