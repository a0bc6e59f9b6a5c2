#include "tests/support/support.h"

#include "common/base/random.h"
#include "common/image/image.h"

#include <OpenEXR/openexr.h>
#include <dirent.h>
#include <math.h>
#include <png.h>
#include <signal.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/resource.h>
#include <sys/stat.h>
#include <unistd.h>

static char folder[] = "/tmp/lw-image-XXXXXX";
static char path[sizeof folder + 32];

static int make_folder(void **state) {
    (void)state;
    if (!mkdtemp(folder)) return -1;
    snprintf(path, sizeof path, "%s/image", folder);
    return 0;
}

static unsigned files_in_folder(bool delete) {
    unsigned count = 0;
    DIR *dir = opendir(folder);
    assert_non_null(dir);
    for (struct dirent *entry; (entry = readdir(dir));) {
        if (entry->d_name[0] == '.') continue;
        count++;
        if (delete) unlinkat(dirfd(dir), entry->d_name, 0);
    }
    closedir(dir);
    return count;
}

static int empty_folder(void **state) {
    (void)state;
    files_in_folder(true);
    return 0;
}

static int remove_folder(void **state) {
    empty_folder(state);
    return rmdir(folder);
}

/* Values that a half float would spoil and that no neighbour shares. */
static float *make_pixels(uint32_t width, uint32_t height) {
    float *rgb = malloc((size_t)width * height * 3 * sizeof *rgb);
    assert_non_null(rgb);
    for (size_t i = 0; i < (size_t)width * height * 3; i++) rgb[i] = 1e5f / 3 + (float)i * 0.37f;
    return rgb;
}

static void exr_keeps_every_float(void **state) {
    (void)state;
    /* one pixel; less than, exactly and more than a ZIP block of 16 lines */
    static const uint32_t sizes[][2] = {{1, 1}, {7, 5}, {3, 16}, {65, 37}};
    for (size_t s = 0; s < sizeof sizes / sizeof *sizes; s++) {
        uint32_t width = sizes[s][0], height = sizes[s][1], read_width = 0, read_height = 0;
        float *rgb = make_pixels(width, height), *read = NULL;
        rgb[0] = 0x1p-140f; /* a denormal, and what no picture should hold but a debugging one does */
        rgb[1] = INFINITY;
        struct lw_error err = {0};
        lw_support_ok(lw_image_write_exr(path, rgb, width, height, "W/(m^2 sr)", &err), &err);
        lw_support_ok(lw_image_read_exr(path, &read, &read_width, &read_height, &err), &err);
        assert_int_equal(read_width, width);
        assert_int_equal(read_height, height);
        assert_memory_equal(read, rgb, (size_t)width * height * 3 * sizeof *rgb);
        free(rgb);
        free(read);
    }
    assert_int_equal(files_in_folder(false), 1); /* overwritten each time, no leftovers */
}

/* Noise that ZIP makes a little shorter or longer, or leaves as long as it is. */
static void exr_keeps_what_compression_makes_no_shorter(void **state) {
    (void)state;
    enum { WIDTH = 64, PICTURES = 600 };
    float rgb[3 * WIDTH];
    for (uint32_t p = 0; p < PICTURES; p++) {
        for (uint32_t i = 0; i < 3 * WIDTH; i++) {
            const uint32_t noise = lw_random_hash3(p, i, 0);
            rgb[i] = i < p % WIDTH ? 0.5f : ldexpf(1 + (float)(noise >> 8) * 0x1p-24f, (int)(noise & 7));
        }
        struct lw_error err = {0};
        float *read = NULL;
        uint32_t width, height;
        lw_support_ok(lw_image_write_exr(path, rgb, WIDTH, 1, NULL, &err), &err);
        lw_support_ok(lw_image_read_exr(path, &read, &width, &height, &err), &err);
        assert_memory_equal(read, rgb, sizeof rgb);
        free(read);
    }
}

static void string_attribute_is(exr_context_t context, const char *name, const char *text) {
    int32_t length;
    const char *found;
    assert_int_equal(exr_attr_get_string(context, 0, name, &length, &found), EXR_ERR_SUCCESS);
    assert_string_equal(found, text);
}

/* Opens the file at `path` by the letter of the standard: it has these channels of one type, no others. */
static exr_context_t open_strictly(const char *channel_letters, exr_pixel_type_t type) {
    exr_context_t context;
    exr_context_initializer_t initializer = EXR_DEFAULT_CONTEXT_INITIALIZER;
    initializer.flags = EXR_CONTEXT_FLAG_STRICT_HEADER;
    assert_int_equal(exr_start_read(&context, path, &initializer), EXR_ERR_SUCCESS);
    const exr_attr_chlist_t *channels;
    assert_int_equal(exr_get_channels(context, 0, &channels), EXR_ERR_SUCCESS);
    assert_int_equal(channels->num_channels, strlen(channel_letters));
    for (int i = 0; i < channels->num_channels; i++) {
        assert_int_equal(channels->entries[i].name.str[0], channel_letters[i]);
        assert_int_equal(channels->entries[i].pixel_type, type);
    }
    return context;
}

static void exr_header_says_what_it_holds(void **state) {
    (void)state;
    float *rgb = make_pixels(5, 3);
    struct lw_error err = {0};
    lw_support_ok(lw_image_write_exr(path, rgb, 5, 3, "W/(m^2 sr)", &err), &err);
    free(rgb);
    exr_context_t context = open_strictly("BGR", EXR_PIXEL_FLOAT);
    exr_compression_t compression;
    assert_int_equal(exr_get_compression(context, 0, &compression), EXR_ERR_SUCCESS);
    assert_int_equal(compression, EXR_COMPRESSION_ZIP);
    string_attribute_is(context, "units", "W/(m^2 sr)");
    exr_attr_chromaticities_t chroma;
    assert_int_equal(exr_attr_get_chromaticities(context, 0, "chromaticities", &chroma), EXR_ERR_SUCCESS);
    assert_true(chroma.red_x == 0.64f && chroma.green_y == 0.60f && chroma.white_x == 0.3127f);
    exr_finish(&context);
}

static void exr_maps_have_coverage_attributes_and_halves(void **state) {
    (void)state;
    enum { WIDTH = 7, HEIGHT = 19 };
    static float rgba[WIDTH * HEIGHT * 4];
    for (size_t i = 0; i < WIDTH * HEIGHT * 4; i++)
        rgba[i] = i % 4 == 3 ? (float)(i / 4 % 2) : (float)(i % 1000); /* exact in a half */
    rgba[0] = 65504;                                                   /* the largest */
    const struct lw_image_attribute attribute[] = {{"units", "W/m^2"}, {"object", "\xe5\xba\x8a/\xc3\xa9"}};
    struct lw_image_exr image = {.pixel = rgba,
                                 .width = WIDTH,
                                 .height = HEIGHT,
                                 .channels = 4,
                                 .attribute = attribute,
                                 .attribute_count = 2};
    for (int half = 0; half < 2; half++) {
        struct lw_error err = {0};
        image.half = half;
        lw_support_ok(lw_image_write_exr_with(path, &image, &err), &err);
        float *read;
        uint32_t width, height;
        lw_support_ok(lw_image_read_exr_rgba(path, &read, &width, &height, &err), &err);
        assert_int_equal(width, WIDTH);
        assert_int_equal(height, HEIGHT);
        assert_memory_equal(read, rgba, sizeof rgba);
        free(read);
        exr_context_t context = open_strictly("ABGR", half ? EXR_PIXEL_HALF : EXR_PIXEL_FLOAT);
        string_attribute_is(context, "units", "W/m^2");
        string_attribute_is(context, "object", "\xe5\xba\x8a/\xc3\xa9");
        exr_finish(&context);
    }
    /* half rounds to nearest: 11 bits */
    struct lw_error err = {0};
    float *read, third[3] = {1.0f / 3, 1e-3f, 1234.5678f};
    uint32_t width, height;
    image = (struct lw_image_exr){.pixel = third, .width = 1, .height = 1, .channels = 3, .half = true};
    lw_support_ok(lw_image_write_exr_with(path, &image, &err), &err);
    lw_support_ok(lw_image_read_exr_rgba(path, &read, &width, &height, &err), &err);
    for (int c = 0; c < 3; c++) assert_true(fabsf(read[c] / third[c] - 1) <= 0x1p-11f);
    assert_true(read[3] == 1); /* no A in the file */
    free(read);
}

/* ---- files of others: half floats, more channels, tiles, an origin elsewhere ---- */

struct foreign {
    bool tiled;
    exr_pixel_type_t type;
    const char *const *channels; /* alphabetical */
    int channel_count;
    int32_t x, y, width, height;       /* the data window */
    int32_t shown_width, shown_height; /* the display window, from (0, 0) on; 0: like the data */
};

static void must(exr_result_t result) { assert_int_equal(result, EXR_ERR_SUCCESS); }

static uint16_t half_of_small_integer(unsigned value) {
    if (!value) return 0;
    unsigned exponent = 31 - (unsigned)__builtin_clz(value);
    return (uint16_t)((exponent + 15) << 10 | ((value << (10 - exponent)) & 0x3ff));
}

/* A pixel's value: whole numbers below 1024, exact in a half. */
static unsigned foreign_value(int channel, int32_t x, int32_t y) {
    return (unsigned)(channel * 300 + y * 16 + x) % 1024;
}

static int32_t shown(int32_t stated, int32_t data) { return stated ? stated : data; }

static void write_foreign(const struct foreign *f) {
    exr_context_t context;
    exr_context_initializer_t initializer = EXR_DEFAULT_CONTEXT_INITIALIZER;
    int part;
    must(exr_start_write(&context, path, EXR_WRITE_FILE_DIRECTLY, &initializer));
    must(exr_add_part(context, NULL, f->tiled ? EXR_STORAGE_TILED : EXR_STORAGE_SCANLINE, &part));
    must(exr_initialize_required_attr_simple(context, part, shown(f->shown_width, f->width),
                                             shown(f->shown_height, f->height), EXR_COMPRESSION_ZIP));
    exr_attr_box2i_t window;
    window.min.x = f->x, window.min.y = f->y;
    window.max.x = f->x + f->width - 1, window.max.y = f->y + f->height - 1;
    must(exr_set_data_window(context, part, &window));
    if (f->tiled) must(exr_set_tile_descriptor(context, part, 8, 8, EXR_TILE_ONE_LEVEL, EXR_TILE_ROUND_DOWN));
    for (int i = 0; i < f->channel_count; i++)
        must(exr_add_channel(context, part, f->channels[i], f->type, EXR_PERCEPTUALLY_LOGARITHMIC, 1, 1));
    must(exr_write_header(context));
    int32_t step_y = f->tiled ? 8 : 16, step_x = f->tiled ? 8 : f->width;
    exr_encode_pipeline_t pipeline = EXR_ENCODE_PIPELINE_INITIALIZER;
    for (int32_t y = 0; y < f->height; y += step_y)
        for (int32_t x = 0; x < f->width; x += step_x) {
            exr_chunk_info_t chunk;
            if (f->tiled)
                must(exr_write_tile_chunk_info(context, part, x / 8, y / 8, 0, 0, &chunk));
            else
                must(exr_write_scanline_chunk_info(context, part, f->y + y, &chunk));
            bool first = !x && !y;
            must(first ? exr_encoding_initialize(context, part, &chunk, &pipeline)
                       : exr_encoding_update(context, part, &chunk, &pipeline));
            unsigned char *planes[8] = {0};
            int bytes = f->type == EXR_PIXEL_HALF ? 2 : 4;
            for (int i = 0; i < f->channel_count; i++) {
                planes[i] = malloc((size_t)(chunk.width * chunk.height * bytes));
                assert_non_null(planes[i]);
                for (int32_t n = 0; n < chunk.width * chunk.height; n++) {
                    unsigned value = foreign_value(i, x + n % chunk.width, y + n / chunk.width);
                    uint16_t half = half_of_small_integer(value);
                    float real = (float)value;
                    if (f->type == EXR_PIXEL_HALF)
                        memcpy(planes[i] + n * bytes, &half, sizeof half);
                    else if (f->type == EXR_PIXEL_FLOAT)
                        memcpy(planes[i] + n * bytes, &real, sizeof real);
                    else
                        memcpy(planes[i] + n * bytes, &value, sizeof value);
                }
                pipeline.channels[i].encode_from_ptr = planes[i];
                pipeline.channels[i].user_data_type = (uint16_t)f->type;
                pipeline.channels[i].user_bytes_per_element = (int16_t)bytes;
                pipeline.channels[i].user_pixel_stride = bytes;
                pipeline.channels[i].user_line_stride = chunk.width * bytes;
            }
            if (first) must(exr_encoding_choose_default_routines(context, part, &pipeline));
            must(exr_encoding_run(context, part, &pipeline));
            for (int i = 0; i < f->channel_count; i++) free(planes[i]);
        }
    must(exr_encoding_destroy(context, &pipeline));
    must(exr_finish(&context));
}

static const char *const abgr[] = {"A", "B", "G", "R"}, *const many[] = {"A", "B", "G", "R", "S", "Z"},
                         *const grey[] = {"Y"};

/* What a pixel of the display window must be: the data that lies there, else 0. */
static unsigned expected_value(const struct foreign *f, int channel, int32_t x, int32_t y) {
    int written = 0;
    while (f->channels[written][0] != "RGB"[channel]) written++;
    const int32_t data_x = x - f->x, data_y = y - f->y;
    if (data_x < 0 || data_x >= f->width || data_y < 0 || data_y >= f->height) return 0;
    return foreign_value(written, data_x, data_y);
}

static void exr_reads_halves_tiles_and_windows(void **state) {
    (void)state;
    static const struct foreign files[] = {
        {false, EXR_PIXEL_HALF, abgr, 4, 0, 0, 13, 19, 0, 0},
        {true, EXR_PIXEL_HALF, abgr, 4, 0, 0, 21, 10, 0, 0},
        {false, EXR_PIXEL_FLOAT, abgr + 1, 3, 0, 0, 1, 1, 0, 0},
        /* data that reach over the edges, that lie within them, and that do both */
        {false, EXR_PIXEL_FLOAT, many, 6, -3, 5, 13, 40, 0, 0},
        {true, EXR_PIXEL_FLOAT, many, 6, 7, -2, 16, 17, 0, 0},
        {false, EXR_PIXEL_HALF, abgr, 4, 4, 3, 9, 5, 32, 16},
        {true, EXR_PIXEL_HALF, abgr, 4, -8, -4, 48, 24, 32, 16},
        {false, EXR_PIXEL_FLOAT, abgr + 1, 3, -5, 12, 20, 20, 32, 16},
        {false, EXR_PIXEL_FLOAT, abgr + 1, 3, 100, -90, 8, 8, 32, 16},
    };
    for (size_t n = 0; n < sizeof files / sizeof *files; n++) {
        const struct foreign *f = &files[n];
        write_foreign(f);
        float *rgb;
        uint32_t width, height;
        struct lw_error err = {0};
        lw_support_ok(lw_image_read_exr(path, &rgb, &width, &height, &err), &err);
        assert_int_equal(width, shown(f->shown_width, f->width));
        assert_int_equal(height, shown(f->shown_height, f->height));
        for (uint32_t i = 0; i < width * height * 3; i++)
            assert_int_equal((unsigned)rgb[i], expected_value(f, (int)(i % 3), (int32_t)(i / 3 % width),
                                                              (int32_t)(i / 3 / width)));
        free(rgb);
    }
}

static enum lw_status read_status(struct lw_error *err) {
    float *rgb = NULL;
    uint32_t width, height;
    *err = (struct lw_error){0};
    enum lw_status status = lw_image_read_exr(path, &rgb, &width, &height, err);
    if (status == LW_OK) free(rgb);
    return status;
}

static void exr_refuses_what_is_none(void **state) {
    (void)state;
    struct lw_error err;
    assert_int_equal(read_status(&err), LW_NO_INPUT);
    assert_non_null(strstr(err.text, path));
    lw_support_write_file(path, "hello", 5);
    assert_int_equal(read_status(&err), LW_BAD_DATA);
    assert_non_null(strstr(err.text, path));
    write_foreign(&(struct foreign){false, EXR_PIXEL_HALF, grey, 1, 0, 0, 4, 4, 0, 0});
    assert_int_equal(read_status(&err), LW_BAD_DATA);
    assert_non_null(strstr(err.text, "R, G and B"));
    write_foreign(&(struct foreign){false, EXR_PIXEL_UINT, abgr, 4, 0, 0, 4, 4, 0, 0});
    assert_int_equal(read_status(&err), LW_BAD_DATA);
    assert_non_null(strstr(err.text, "half or float"));
}

static void exr_survives_every_truncation_and_many_flips(void **state) {
    (void)state;
    float *rgb = make_pixels(9, 18);
    struct lw_error err = {0};
    lw_support_ok(lw_image_write_exr(path, rgb, 9, 18, NULL, &err), &err);
    free(rgb);
    size_t size;
    unsigned char *bytes = lw_support_read_file(path, &size);
    for (size_t cut = 0; cut < size; cut++) {
        lw_support_write_file(path, bytes, cut);
        assert_int_equal(read_status(&err), LW_BAD_DATA);
    }
    unsigned refused = 0;
    for (size_t i = 0; i < size; i++) {
        bytes[i] ^= 0x80;
        lw_support_write_file(path, bytes, size);
        refused += read_status(&err) != LW_OK;
        bytes[i] ^= 0x80;
    }
    assert_true(refused > 0); /* some flips change pixels only */
    free(bytes);
}

/* ---- PNG ---- */

static void png_keeps_every_byte_and_says_srgb(void **state) {
    (void)state;
    enum { WIDTH = 11, HEIGHT = 6 };
    uint8_t pixels[WIDTH * HEIGHT * 3], read[sizeof pixels];
    for (size_t i = 0; i < sizeof pixels; i++) pixels[i] = (uint8_t)(i * 37);
    struct lw_error err = {0};
    lw_support_ok(lw_image_write_png(path, pixels, WIDTH, HEIGHT, &err), &err);
    png_image image = {.version = PNG_IMAGE_VERSION};
    assert_true(png_image_begin_read_from_file(&image, path));
    assert_int_equal(image.width, WIDTH);
    assert_int_equal(image.height, HEIGHT);
    assert_int_equal(image.format, PNG_FORMAT_RGB); /* 8 bit, no alpha, no palette */
    assert_true(png_image_finish_read(&image, NULL, read, 0, NULL));
    assert_memory_equal(read, pixels, sizeof pixels);
    size_t size;
    unsigned char *bytes = lw_support_read_file(path, &size);
    assert_non_null(memmem(bytes, size, "sRGB", 4));
    free(bytes);
}

static void png_in_memory_keeps_every_byte(void **state) {
    (void)state;
    enum { WIDTH = 301, HEIGHT = 77 };
    static uint8_t pixels[WIDTH * HEIGHT * 4], read[sizeof pixels];
    for (size_t i = 0; i < sizeof pixels; i++) pixels[i] = (uint8_t)lw_random_hash((uint32_t)i);
    for (unsigned channels = 3; channels <= 4; channels++) {
        struct lw_error err = {0};
        uint8_t *png;
        size_t size;
        lw_support_ok(lw_image_encode_png(pixels, WIDTH, HEIGHT, channels, &png, &size, &err), &err);
        png_image image = {.version = PNG_IMAGE_VERSION};
        assert_true(png_image_begin_read_from_memory(&image, png, size));
        assert_int_equal(image.width, WIDTH);
        assert_int_equal(image.height, HEIGHT);
        assert_int_equal(image.format, channels == 4 ? PNG_FORMAT_RGBA : PNG_FORMAT_RGB);
        assert_true(png_image_finish_read(&image, NULL, read, 0, NULL));
        assert_memory_equal(read, pixels, (size_t)WIDTH * HEIGHT * channels);
        assert_null(memmem(png, size, "gAMA", 4));
        free(png);
        assert_int_equal(lw_image_encode_png(pixels, 0, HEIGHT, channels, &png, &size, &err), LW_USAGE);
    }
}

/* ---- where it cannot be written ---- */

static enum lw_status write_either(bool exr, const char *to, uint32_t width, uint32_t height,
                                   struct lw_error *err) {
    static float rgb[3 * 300 * 300];
    static uint8_t srgb[3 * 300 * 300];
    for (size_t i = 0; i < sizeof srgb; i++) { /* noise: nothing that compresses */
        srgb[i] = (uint8_t)lw_random_hash((uint32_t)i);
        rgb[i] = lw_random_unit(lw_random_hash((uint32_t)i));
    }
    *err = (struct lw_error){0};
    return exr ? lw_image_write_exr(to, rgb, width, height, "W/m^2", err)
               : lw_image_write_png(to, srgb, width, height, err);
}

static void unwritable_places_are_named(void **state) {
    (void)state;
    for (int exr = 0; exr < 2; exr++) {
        struct lw_error err;
        assert_int_equal(write_either(exr, "/no/such/folder/a.img", 4, 4, &err), LW_CANNOT_CREATE);
        assert_non_null(strstr(err.text, "/no/such/folder/a.img: there is no folder /no/such/folder"));
        assert_int_equal(write_either(exr, folder, 4, 4, &err), LW_CANNOT_CREATE);
        assert_non_null(strstr(err.text, "is a folder"));
        assert_int_equal(write_either(exr, path, 0, 4, &err), LW_USAGE);
        assert_int_equal(write_either(exr, path, 4, LW_IMAGE_SIDE_MAX + 1, &err), LW_USAGE);
        assert_int_equal(files_in_folder(false), 0);
    }
}

static void a_full_disk_is_reported_and_leaves_nothing(void **state) {
    (void)state;
    struct lw_error err;
    for (int exr = 0; exr < 2; exr++) {
        /* a device is written, never replaced */
        assert_int_equal(write_either(exr, "/dev/full", 300, 300, &err), LW_IO);
        assert_non_null(strstr(err.text, "/dev/full: No space left"));
        struct stat st;
        assert_int_equal(stat("/dev/full", &st), 0);
        assert_true(S_ISCHR(st.st_mode));
    }
    /* the disk fills in the middle of the file: with the header, among the pixels */
    static const rlim_t limits[] = {0, 100, 40000};
    for (size_t i = 0; i < sizeof limits / sizeof *limits; i++)
        for (int exr = 0; exr < 2; exr++) {
            lw_support_write_file(path, "old", 3);
            struct rlimit before, small;
            assert_int_equal(getrlimit(RLIMIT_FSIZE, &before), 0);
            small = before;
            small.rlim_cur = limits[i];
            assert_int_equal(setrlimit(RLIMIT_FSIZE, &small), 0);
            enum lw_status status = write_either(exr, path, 300, 300, &err);
            assert_int_equal(setrlimit(RLIMIT_FSIZE, &before), 0);
            assert_int_equal(status, LW_IO);
            assert_non_null(strstr(err.text, "File too large"));
            /* the old file is whole, and alone */
            size_t size;
            unsigned char *bytes = lw_support_read_file(path, &size);
            assert_int_equal(size, 3);
            free(bytes);
            assert_int_equal(files_in_folder(false), 1);
        }
}

static void a_link_stays_a_link(void **state) {
    (void)state;
    char target[sizeof path + 8], line[64];
    snprintf(target, sizeof target, "%s.target", path);
    lw_support_write_file(target, "", 0);
    assert_int_equal(symlink(target, path), 0);
    struct lw_error err;
    lw_support_ok(write_either(false, path, 4, 4, &err), &err);
    struct stat st;
    assert_int_equal(lstat(path, &st), 0);
    assert_true(S_ISLNK(st.st_mode));
    FILE *file = fopen(target, "r");
    assert_non_null(file);
    assert_int_equal(fread(line, 1, 8, file), 8);
    fclose(file);
    assert_memory_equal(line, "\x89PNG", 4);
}

int main(void) {
    signal(SIGXFSZ, SIG_IGN); /* so that a file limit shows as a failing write */
    const struct CMUnitTest tests[] = {
#define T(name) cmocka_unit_test_teardown(name, empty_folder)
        T(exr_keeps_every_float),
        T(exr_keeps_what_compression_makes_no_shorter),
        T(exr_header_says_what_it_holds),
        T(exr_maps_have_coverage_attributes_and_halves),
        T(png_in_memory_keeps_every_byte),
        T(exr_reads_halves_tiles_and_windows),
        T(exr_refuses_what_is_none),
        T(exr_survives_every_truncation_and_many_flips),
        T(png_keeps_every_byte_and_says_srgb),
        T(unwritable_places_are_named),
        T(a_full_disk_is_reported_and_leaves_nothing),
        T(a_link_stays_a_link),
#undef T
    };
    return cmocka_run_group_tests(tests, make_folder, remove_folder);
}
