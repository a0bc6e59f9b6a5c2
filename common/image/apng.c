#include "common/image/apng.h"

#include "common/base/atomic_file.h"
#include "common/image/image.h"

#include <stdlib.h>
#include <string.h>

#define SIGNATURE   8u
#define CHUNK_FRAME 12u /* length, type, checksum */

/* PNG, annex D: the polynomial of ISO 3309, reflected. */
static uint32_t checksum(const uint8_t *bytes, size_t size, uint32_t crc) {
    crc = ~crc;
    for (size_t i = 0; i < size; i++) {
        crc ^= bytes[i];
        for (int bit = 0; bit < 8; bit++) crc = crc >> 1 ^ (crc & 1 ? 0xedb88320u : 0);
    }
    return ~crc;
}

static void put32(uint8_t *out, uint32_t v) {
    out[0] = (uint8_t)(v >> 24), out[1] = (uint8_t)(v >> 16), out[2] = (uint8_t)(v >> 8), out[3] = (uint8_t)v;
}

static uint32_t get32(const uint8_t *in) {
    return (uint32_t)in[0] << 24 | (uint32_t)in[1] << 16 | (uint32_t)in[2] << 8 | in[3];
}

/* A chunk whose data come in two pieces. */
static enum lw_status put_chunk(struct lw_atomic_file *file, const char type[4], const uint8_t *head,
                                uint32_t head_size, const uint8_t *data, uint32_t data_size,
                                struct lw_error *err) {
    uint8_t start[8], end[4];
    put32(start, head_size + data_size);
    memcpy(start + 4, type, 4);
    uint32_t crc = checksum(start + 4, 4, 0);
    crc = checksum(head, head_size, crc);
    put32(end, checksum(data, data_size, crc));
    enum lw_status status = lw_atomic_file_write(file, start, sizeof start, err);
    if (status == LW_OK && head_size) status = lw_atomic_file_write(file, head, head_size, err);
    if (status == LW_OK && data_size) status = lw_atomic_file_write(file, data, data_size, err);
    return status == LW_OK ? lw_atomic_file_write(file, end, sizeof end, err) : status;
}

struct movie {
    struct lw_atomic_file *file;
    uint32_t frame_count, width, height, frame_ms, sequence;
};

static enum lw_status put_frame_control(struct movie *m, struct lw_error *err) {
    uint8_t control[26] = {0};
    put32(control, m->sequence++);
    put32(control + 4, m->width);
    put32(control + 8, m->height);
    control[20] = (uint8_t)(m->frame_ms >> 8), control[21] = (uint8_t)m->frame_ms;
    control[22] = 1000 >> 8, control[23] = 1000 & 255; /* thousandths of a second */
    return put_chunk(m->file, "fcTL", control, sizeof control, NULL, 0, err);
}

/* The chunks of a frame's own PNG, as those of the movie. */
static enum lw_status put_frame(struct movie *m, const uint8_t *png, size_t size, bool first,
                                struct lw_error *err) {
    bool begun = false;
    enum lw_status status = LW_OK;
    for (size_t at = SIGNATURE; status == LW_OK && at + CHUNK_FRAME <= size;) {
        const uint32_t length = get32(png + at);
        const uint8_t *type = png + at + 4, *data = png + at + 8;
        if (first && memcmp(type, "IHDR", 4) == 0) {
            uint8_t control[8];
            put32(control, m->frame_count);
            put32(control + 4, 0); /* for ever */
            status = lw_atomic_file_write(m->file, png, SIGNATURE, err);
            if (status == LW_OK) status = put_chunk(m->file, "IHDR", data, length, NULL, 0, err);
            if (status == LW_OK) status = put_chunk(m->file, "acTL", control, sizeof control, NULL, 0, err);
        } else if (memcmp(type, "IDAT", 4) == 0) {
            if (!begun) status = put_frame_control(m, err);
            begun = true;
            uint8_t number[4];
            if (!first) put32(number, m->sequence++);
            if (status == LW_OK)
                status = first ? put_chunk(m->file, "IDAT", data, length, NULL, 0, err)
                               : put_chunk(m->file, "fdAT", number, sizeof number, data, length, err);
        }
        at += CHUNK_FRAME + (size_t)length;
    }
    return status;
}

enum lw_status lw_apng_write(const char *path, const uint8_t *const *frame, uint32_t frame_count,
                             uint32_t width, uint32_t height, uint32_t frame_ms, struct lw_error *err) {
    struct lw_atomic_file file;
    if (!frame_count || !frame_ms || frame_ms > 65535)
        return lw_status_fail(err, LW_USAGE, "%s: %u frames of %u ms", path, frame_count, frame_ms);
    enum lw_status status = lw_atomic_file_open(&file, path, err);
    if (status != LW_OK) return status;
    struct movie movie = {
        .file = &file, .frame_count = frame_count, .width = width, .height = height, .frame_ms = frame_ms};
    for (uint32_t f = 0; status == LW_OK && f < frame_count; f++) {
        uint8_t *png = NULL;
        size_t size = 0;
        status = lw_image_encode_png(frame[f], width, height, 3, &png, &size, err);
        if (status == LW_OK) status = put_frame(&movie, png, size, f == 0, err);
        free(png);
    }
    if (status == LW_OK) status = put_chunk(&file, "IEND", NULL, 0, NULL, 0, err);
    if (status == LW_OK) return lw_atomic_file_commit(&file, err);
    lw_atomic_file_abandon(&file);
    return status;
}
