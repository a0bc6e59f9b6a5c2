#include "server/import/images/image_bmp.h"

#include <string.h>

#define FILE_HEADER_SIZE 14

enum { CORE_HEADER = 12, INFO_HEADER = 40, HEADER_MAX = 124 };
enum { PLAIN = 0, BIT_FIELDS = 3, ALPHA_BIT_FIELDS = 6 };

struct bmp {
    const uint8_t *texels; /* the first row of the file */
    size_t row_size;       /* bytes, a multiple of 4 */
    uint32_t width, height;
    bool from_top;
    unsigned bits;
    const uint8_t *palette;
    unsigned palette_stride; /* 3 or 4 bytes: blue, green, red */
    uint32_t palette_count;
    uint32_t mask[4]; /* red, green, blue, alpha; 0: absent */
};

static uint32_t load_word(const uint8_t *at) { return at[0] | (uint32_t)at[1] << 8; }
static uint32_t load_long(const uint8_t *at) { return load_word(at) | load_word(at + 2) << 16; }

static enum lw_status fail(struct lw_error *err, const char *text) {
    return lw_status_fail(err, LW_BAD_DATA, "%s", text);
}

/* 1 to 32 bits side by side, or none. */
static bool is_mask(uint32_t mask) {
    if (mask == 0) return true;
    mask >>= __builtin_ctz(mask);
    return (mask & (mask + 1)) == 0;
}

static enum lw_status read_masks(struct bmp *bmp, const uint8_t *bytes, size_t size, uint32_t header,
                                 uint32_t compression, struct lw_error *err) {
    static const uint32_t plain[2][4] = {{0x7C00, 0x3E0, 0x1F, 0}, {0xFF0000, 0xFF00, 0xFF, 0}};
    memcpy(bmp->mask, plain[bmp->bits == 32], sizeof bmp->mask);
    if (compression == PLAIN) return LW_OK;
    const bool alpha = compression == ALPHA_BIT_FIELDS || header >= 56;
    if (size < FILE_HEADER_SIZE + INFO_HEADER + 16u) return fail(err, "it is truncated");
    for (int c = 0; c < 4; c++) {
        bmp->mask[c] = c < 3 || alpha ? load_long(bytes + FILE_HEADER_SIZE + INFO_HEADER + 4 * c) : 0;
        if (!is_mask(bmp->mask[c])) return fail(err, "its bit fields have gaps");
    }
    return LW_OK;
}

static enum lw_status read_palette(struct bmp *bmp, const uint8_t *bytes, size_t size, uint32_t header,
                                   uint32_t used, struct lw_error *err) {
    const size_t start = FILE_HEADER_SIZE + (size_t)header;
    bmp->palette = bytes + start;
    bmp->palette_stride = header == CORE_HEADER ? 3 : 4;
    bmp->palette_count = used && used < 1u << bmp->bits ? used : 1u << bmp->bits;
    if (start > size || (size - start) / bmp->palette_stride < bmp->palette_count)
        return fail(err, "its palette is truncated");
    return LW_OK;
}

static enum lw_status read_header(const uint8_t *bytes, size_t size, struct bmp *out, struct lw_error *err) {
    if (!lw_image_bmp_is(bytes, size)) return fail(err, "its header is not one that is read");
    struct bmp bmp = {0};
    const size_t offset = load_long(bytes + 10);
    const uint32_t header = load_long(bytes + FILE_HEADER_SIZE);
    const bool core = header == CORE_HEADER;
    uint32_t compression = PLAIN, used = 0;
    if (size < FILE_HEADER_SIZE + (size_t)header) return fail(err, "it is truncated");
    int64_t height = (int32_t)load_long(bytes + 22);
    bmp.width = core ? load_word(bytes + 18) : load_long(bytes + 18);
    if (core) height = load_word(bytes + 20);
    bmp.bits = load_word(bytes + (core ? 24 : 28));
    if (!core) {
        compression = load_long(bytes + 30);
        used = load_long(bytes + 46);
    }
    bmp.from_top = height < 0;
    bmp.height = (uint32_t)(height < 0 ? -height : height);
    const bool deep = bmp.bits == 16 || bmp.bits == 32;
    if (compression != PLAIN && !(deep && (compression == BIT_FIELDS || compression == ALPHA_BIT_FIELDS)))
        return lw_status_fail(err, LW_BAD_DATA, "its compression %u is not read", compression);
    if (bmp.bits != 1 && bmp.bits != 4 && bmp.bits != 8 && bmp.bits != 24 && !deep)
        return lw_status_fail(err, LW_BAD_DATA, "it has %u bits a texel", bmp.bits);
    if (bmp.width == 0 || bmp.height == 0 || bmp.width > INT32_MAX) return fail(err, "it has no texels");
    bmp.row_size = ((size_t)bmp.width * bmp.bits + 31) / 32 * 4;
    if (offset > size || (size - offset) / bmp.row_size < bmp.height) return fail(err, "it is truncated");
    bmp.texels = bytes + offset;
    enum lw_status status = LW_OK;
    if (deep) status = read_masks(&bmp, bytes, size, header, compression, err);
    if (bmp.bits <= 8) status = read_palette(&bmp, bytes, size, header, used, err);
    if (status == LW_OK) *out = bmp;
    return status;
}

bool lw_image_bmp_is(const uint8_t *bytes, size_t size) {
    if (size < FILE_HEADER_SIZE + (size_t)CORE_HEADER || bytes[0] != 'B' || bytes[1] != 'M') return false;
    const uint32_t header = load_long(bytes + FILE_HEADER_SIZE);
    return header == CORE_HEADER || (header >= INFO_HEADER && header <= HEADER_MAX);
}

enum lw_status lw_image_bmp_size(const uint8_t *bytes, size_t size, uint32_t *out_width, uint32_t *out_height,
                                 struct lw_error *err) {
    struct bmp bmp;
    const enum lw_status status = read_header(bytes, size, &bmp, err);
    if (status) return status;
    *out_width = bmp.width;
    *out_height = bmp.height;
    return LW_OK;
}

static uint8_t field(uint32_t word, uint32_t mask) {
    if (mask == 0) return 0;
    const unsigned shift = (unsigned)__builtin_ctz(mask);
    const uint64_t top = mask >> shift;
    return (uint8_t)(((word & mask) >> shift) * UINT64_C(255) / top);
}

static enum lw_status decode_row(const struct bmp *bmp, const uint8_t *row, uint8_t *out,
                                 struct lw_error *err) {
    for (uint32_t x = 0; x < bmp->width; x++, out += 4) {
        out[3] = 255;
        if (bmp->bits <= 8) {
            const size_t bit = (size_t)x * bmp->bits;
            const uint32_t index = row[bit / 8] >> (8 - bmp->bits - bit % 8) & ((1u << bmp->bits) - 1);
            if (index >= bmp->palette_count)
                return lw_status_fail(err, LW_BAD_DATA, "colour %u is past its palette", index);
            const uint8_t *colour = bmp->palette + (size_t)index * bmp->palette_stride;
            for (int c = 0; c < 3; c++) out[c] = colour[2 - c];
        } else if (bmp->bits == 24) {
            for (int c = 0; c < 3; c++) out[c] = row[3 * (size_t)x + 2 - (size_t)c];
        } else {
            const uint32_t word =
                bmp->bits == 16 ? load_word(row + 2 * (size_t)x) : load_long(row + 4 * (size_t)x);
            for (int c = 0; c < 4; c++) out[c] = field(word, bmp->mask[c]);
        }
    }
    return LW_OK;
}

static void mend_alpha(const struct bmp *bmp, uint8_t *rgba) {
    const size_t texels = (size_t)bmp->width * bmp->height;
    bool means = false;
    for (size_t i = 0; !means && i < texels; i++) means = rgba[4 * i + 3] != 0;
    for (size_t i = 0; !means && i < texels; i++) rgba[4 * i + 3] = 255;
}

enum lw_status lw_image_bmp_decode(const uint8_t *bytes, size_t size, uint8_t *out_rgba,
                                   struct lw_error *err) {
    struct bmp bmp;
    enum lw_status status = read_header(bytes, size, &bmp, err);
    for (uint32_t y = 0; status == LW_OK && y < bmp.height; y++) {
        const uint32_t row = bmp.from_top ? y : bmp.height - 1 - y;
        status = decode_row(&bmp, bmp.texels + (size_t)y * bmp.row_size,
                            out_rgba + (size_t)row * bmp.width * 4, err);
    }
    if (status == LW_OK) mend_alpha(&bmp, out_rgba);
    return status;
}
