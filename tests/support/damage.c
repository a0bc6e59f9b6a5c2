#include "tests/support/damage.h"

#include "tests/support/support.h"

#include <string.h>

#define SIZE_OFFSET 16 /* a header has the size here */

static bool is_refused(const uint8_t *bytes, size_t size, damage_reader *read) {
    struct lw_error err = {0};
    const enum lw_status status = read(bytes, size, &err);
    assert_true(status == LW_OK || (status == LW_BAD_DATA && *err.text));
    return status != LW_OK;
}

void damage_cut(uint8_t *bytes, size_t size, damage_reader *read) {
    uint8_t kept[8];
    for (size_t cut = 0; cut < size; cut++) {
        const uint64_t cut_size = cut;
        assert_true(is_refused(bytes, cut, read));
        if (cut < SIZE_OFFSET + sizeof kept) continue;
        memcpy(kept, bytes + SIZE_OFFSET, sizeof kept);
        memcpy(bytes + SIZE_OFFSET, &cut_size, sizeof kept);
        assert_int_equal(read(bytes, cut, NULL), LW_BAD_DATA);
        memcpy(bytes + SIZE_OFFSET, kept, sizeof kept);
    }
}

size_t damage_flip(uint8_t *bytes, size_t size, damage_reader *read) {
    size_t refused = 0;
    for (size_t bit = 0; bit < 8 * size; bit++) {
        bytes[bit / 8] ^= (uint8_t)(1u << bit % 8);
        refused += is_refused(bytes, size, read);
        bytes[bit / 8] ^= (uint8_t)(1u << bit % 8);
    }
    return refused;
}

void damage_words(uint8_t *bytes, size_t size, damage_reader *read) {
    static const uint32_t extremes[] = {
        0,          1,          3,          4,          0x7F,       0x100,      0x7FFFFFFF, 0x80000000,
        0xFFFFFFFE, 0xFFFFFFFF, 0x7F800000, 0xFF800000, 0x7FC00000, 0x7F7FFFFF, 0x00000001, 0x40000000};
    for (size_t word = 0; word + 4 <= size; word += 4) {
        uint8_t kept[4];
        memcpy(kept, bytes + word, 4);
        for (size_t i = 0; i < sizeof extremes / sizeof *extremes; i++) {
            memcpy(bytes + word, &extremes[i], 4);
            (void)is_refused(bytes, size, read);
        }
        memcpy(bytes + word, kept, 4);
    }
}
