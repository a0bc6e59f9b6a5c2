#include "server/import/images/image_tga.h"

#include <string.h>

#define HEADER_SIZE 18
#define RUN_MAX     128 /* texels of a run or of a raw packet */

enum { TYPE_PALETTE = 1, TYPE_COLOUR = 2, TYPE_GREY = 3, TYPE_RUNS = 8 };

struct tga {
    const uint8_t *bytes;
    size_t size, at;
    unsigned type; /* without TYPE_RUNS */
    bool runs;
    unsigned texel_bytes; /* 1 to 4 */
    uint32_t width, height;
    bool has_alpha;
    bool from_top, from_right;
    const uint8_t *palette;
    unsigned palette_bytes; /* per entry */
    uint32_t palette_first, palette_count;
};

static unsigned load_word(const uint8_t *at) { return at[0] | (unsigned)at[1] << 8; }

/* Bytes of a colour by its bits; 0: none that is read. */
static unsigned colour_bytes(unsigned bits) {
    return bits == 15 || bits == 16 ? 2 : bits == 24 ? 3 : bits == 32 ? 4 : 0;
}

static bool read_header(const uint8_t *bytes, size_t size, struct tga *out) {
    if (size < HEADER_SIZE) return false;
    const unsigned bits = bytes[16], descriptor = bytes[17], palette_bits = bytes[7];
    *out = (struct tga){.bytes = bytes,
                        .size = size,
                        .type = bytes[2] & ~(unsigned)TYPE_RUNS,
                        .runs = bytes[2] & TYPE_RUNS,
                        .width = load_word(bytes + 12),
                        .height = load_word(bytes + 14),
                        .from_right = descriptor & 0x10,
                        .from_top = descriptor & 0x20};
    if (bytes[1] > 1 || out->type < TYPE_PALETTE || out->type > TYPE_GREY || bytes[2] > 11 ||
        out->width == 0 || out->height == 0 || descriptor & 0xC0)
        return false;
    out->at = HEADER_SIZE + (size_t)bytes[0]; /* the image's own text */
    if (bytes[1] == 1) {
        out->palette_first = load_word(bytes + 3);
        out->palette_count = load_word(bytes + 5);
        out->palette_bytes = colour_bytes(palette_bits);
        if (!out->palette_bytes) return false;
        out->palette = bytes + out->at; /* within the file: check_size() */
        out->at += (size_t)out->palette_count * out->palette_bytes;
    }
    if (out->type == TYPE_PALETTE) {
        out->texel_bytes = bits == 8 ? 1 : bits == 16 ? 2 : 0;
        out->has_alpha = out->palette_bytes == 4;
        return out->palette && out->texel_bytes;
    }
    if (out->type == TYPE_GREY) {
        out->texel_bytes = bits == 8 ? 1 : bits == 16 ? 2 : 0; /* 16: grey and alpha */
        out->has_alpha = bits == 16;
        return out->texel_bytes;
    }
    out->texel_bytes = colour_bytes(bits);
    out->has_alpha = bits == 32 || (bits == 16 && (descriptor & 15) == 1);
    return out->texel_bytes;
}

bool lw_image_tga_is(const uint8_t *bytes, size_t size) {
    struct tga tga;
    return read_header(bytes, size, &tga);
}

static enum lw_status fail_short(struct lw_error *err) {
    return lw_status_fail(err, LW_BAD_DATA, "it is truncated");
}

/* The fewest bytes that the texels can take. */
static enum lw_status check_size(const struct tga *tga, struct lw_error *err) {
    const uint64_t texels = (uint64_t)tga->width * tga->height;
    const uint64_t least =
        tga->runs ? (texels + RUN_MAX - 1) / RUN_MAX * (1 + tga->texel_bytes) : texels * tga->texel_bytes;
    if (tga->at > tga->size || tga->size - tga->at < least) return fail_short(err);
    return LW_OK;
}

enum lw_status lw_image_tga_size(const uint8_t *bytes, size_t size, uint32_t *out_width, uint32_t *out_height,
                                 struct lw_error *err) {
    struct tga tga;
    if (!read_header(bytes, size, &tga))
        return lw_status_fail(err, LW_BAD_DATA, "its header is not one that is read");
    if (check_size(&tga, err)) return err ? err->status : LW_BAD_DATA;
    *out_width = tga.width;
    *out_height = tga.height;
    return LW_OK;
}

static uint8_t widen(unsigned five_bits) { return (uint8_t)(five_bits << 3 | five_bits >> 2); }

/* Blue comes first. */
static void load_colour(const uint8_t *at, unsigned bytes, uint8_t out[4]) {
    if (bytes == 2) {
        const unsigned word = load_word(at);
        out[0] = widen(word >> 10 & 31);
        out[1] = widen(word >> 5 & 31);
        out[2] = widen(word & 31);
        out[3] = word & 0x8000 ? 255 : 0;
        return;
    }
    out[0] = at[2];
    out[1] = at[1];
    out[2] = at[0];
    out[3] = bytes == 4 ? at[3] : 255;
}

static bool load_texel(const struct tga *tga, const uint8_t *at, uint8_t out[4]) {
    if (tga->type == TYPE_GREY) {
        out[0] = out[1] = out[2] = at[0];
        out[3] = tga->texel_bytes == 2 ? at[1] : 255;
        return true;
    }
    if (tga->type == TYPE_COLOUR) {
        load_colour(at, tga->texel_bytes, out);
        return true;
    }
    const uint32_t index = tga->texel_bytes == 2 ? load_word(at) : at[0];
    if (index < tga->palette_first || index - tga->palette_first >= tga->palette_count) return false;
    load_colour(tga->palette + (size_t)(index - tga->palette_first) * tga->palette_bytes, tga->palette_bytes,
                out);
    return true;
}

/* Texel number `index` in the order of the file. */
static uint8_t *texel_at(const struct tga *tga, uint64_t index, uint8_t *rgba) {
    uint64_t x = index % tga->width, y = index / tga->width;
    if (tga->from_right) x = tga->width - 1 - x;
    if (!tga->from_top) y = tga->height - 1 - y;
    return rgba + (y * tga->width + x) * 4;
}

/* Runs may cross rows, though newer files should not let them. */
static enum lw_status decode(struct tga *tga, uint8_t *rgba, struct lw_error *err) {
    const uint64_t texels = (uint64_t)tga->width * tga->height;
    for (uint64_t done = 0; done < texels;) {
        uint64_t count = texels;
        bool repeat = false;
        if (tga->runs) {
            if (tga->at >= tga->size) return fail_short(err);
            repeat = tga->bytes[tga->at] & 0x80;
            count = (tga->bytes[tga->at++] & 0x7Fu) + 1u;
        }
        if (count > texels - done) count = texels - done;
        const uint64_t read = repeat ? 1 : count;
        if ((tga->size - tga->at) / tga->texel_bytes < read) return fail_short(err);
        for (uint64_t i = 0; i < count; i++) {
            const uint8_t *at = tga->bytes + tga->at + (repeat ? 0 : i * tga->texel_bytes);
            if (!load_texel(tga, at, texel_at(tga, done + i, rgba)))
                return lw_status_fail(err, LW_BAD_DATA, "texel %llu is past its palette",
                                      (unsigned long long)(done + i));
        }
        tga->at += read * tga->texel_bytes;
        done += count;
    }
    return LW_OK;
}

static void mend_alpha(const struct tga *tga, uint8_t *rgba) {
    const size_t texels = (size_t)tga->width * tga->height;
    bool means = false;
    for (size_t i = 0; tga->has_alpha && !means && i < texels; i++) means = rgba[4 * i + 3] != 0;
    for (size_t i = 0; !means && i < texels; i++) rgba[4 * i + 3] = 255;
}

enum lw_status lw_image_tga_decode(const uint8_t *bytes, size_t size, uint8_t *out_rgba,
                                   struct lw_error *err) {
    struct tga tga;
    if (!read_header(bytes, size, &tga))
        return lw_status_fail(err, LW_BAD_DATA, "its header is not one that is read");
    enum lw_status status = check_size(&tga, err);
    if (status == LW_OK) status = decode(&tga, out_rgba, err);
    if (status == LW_OK) mend_alpha(&tga, out_rgba);
    return status;
}
