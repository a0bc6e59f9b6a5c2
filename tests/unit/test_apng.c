#include "tests/support/support.h"

#include "common/image/apng.h"

#include <png.h>
#include <stdlib.h>
#include <string.h>

#define SIDE 8u

static uint32_t get32(const uint8_t *in) {
    return (uint32_t)in[0] << 24 | (uint32_t)in[1] << 16 | (uint32_t)in[2] << 8 | in[3];
}

/* Frames of one colour each: chunks come in order, numbers follow each other, and a reader of PNG sees the
 * first. */
static void frames_follow_each_other(void **state) {
    (void)state;
    const char *path = lw_support_temporary("movie.png");
    uint8_t pixel[3][3 * SIDE * SIDE];
    const uint8_t *frame[3] = {pixel[0], pixel[1], pixel[2]};
    struct lw_error err = {0};
    for (int f = 0; f < 3; f++) memset(pixel[f], 50 + 50 * f, sizeof pixel[f]);
    lw_support_ok(lw_apng_write(path, frame, 3, SIDE, SIDE, 33, &err), &err);

    size_t size;
    uint8_t *bytes = lw_support_read_file(path, &size);
    char order[200] = "";
    uint32_t sequence = 0;
    for (size_t at = 8; at + 12 <= size; at += 12 + get32(bytes + at)) {
        const uint8_t *data = bytes + at + 8;
        char type[6] = "";
        memcpy(type, bytes + at + 4, 4);
        strcat(strcat(order, type), " ");
        if (strcmp(type, "acTL") == 0) assert_true(get32(data) == 3 && get32(data + 4) == 0);
        if (strcmp(type, "fcTL") == 0 || strcmp(type, "fdAT") == 0) assert_int_equal(get32(data), sequence++);
    }
    assert_string_equal(order, "IHDR acTL fcTL IDAT fcTL fdAT fcTL fdAT IEND ");
    free(bytes);

    png_image image = {.version = PNG_IMAGE_VERSION};
    uint8_t read[3 * SIDE * SIDE];
    assert_true(png_image_begin_read_from_file(&image, path)); /* checks every checksum up to the picture */
    image.format = PNG_FORMAT_RGB;
    assert_true(png_image_finish_read(&image, NULL, read, 0, NULL));
    assert_memory_equal(read, pixel[0], sizeof read);
}

static void bad_arguments_are_named(void **state) {
    (void)state;
    struct lw_error err = {0};
    const uint8_t *none[1] = {NULL};
    lw_support_fails(lw_apng_write("a.png", none, 0, 1, 1, 1, &err), LW_USAGE, &err, "a.png: 0 frames");
    err = (struct lw_error){0};
    const uint8_t black[3] = {0};
    none[0] = black;
    lw_support_fails(lw_apng_write("/nowhere/a.png", none, 1, 1, 1, 33, &err), LW_CANNOT_CREATE, &err,
                     "/nowhere/a.png");
}

int main(void) {
    const struct CMUnitTest tests[] = {cmocka_unit_test(frames_follow_each_other),
                                       cmocka_unit_test(bad_arguments_are_named)};
    return cmocka_run_group_tests(tests, NULL, NULL);
}
