#include "common/image/image.h"

#include "common/base/atomic_file.h"

#include <OpenEXR/openexr.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/stat.h>

#define CHANNELS_MAX 4
#define ALPHA        3 /* its place among them */
static const char *const channel_names[CHANNELS_MAX] = {"R", "G", "B", "A"};

/* One pixel of ours: its channels' floats side by side. */
static int32_t pixel_bytes(unsigned channels) { return (int32_t)(channels * sizeof(float)); }

static int channel_of(const char *name, unsigned channels) {
    for (unsigned i = 0; i < channels; i++)
        if (!strcmp(name, channel_names[i])) return (int)i;
    return -1;
}

/* A file that claims more pixels than this (1.6 GB of floats) is taken for damage. */
#define READ_PIXELS_MAX (1u << 27)

/* Context of OpenEXR's callbacks. */
struct stream {
    const char *path;
    struct lw_atomic_file *file; /* NULL: reading */
    struct lw_error *err;
    enum lw_status status; /* a failure of our own callbacks */
    char message[256];     /* OpenEXR's first complaint */
};

static void on_error(exr_const_context_t context, exr_result_t code, const char *message) {
    (void)code;
    void *user = NULL;
    if (exr_get_user_data(context, &user) != EXR_ERR_SUCCESS || !user) return;
    struct stream *stream = user;
    if (!stream->message[0]) snprintf(stream->message, sizeof stream->message, "%s", message);
}

static int64_t on_write(exr_const_context_t context, void *user, const void *bytes, uint64_t size,
                        uint64_t offset, exr_stream_error_func_ptr_t error_cb) {
    (void)context;
    (void)error_cb;
    struct stream *stream = user;
    if (stream->status) return -1; /* the disk is full: no more attempts */
    stream->status = lw_atomic_file_write_at(stream->file, bytes, size, offset, stream->err);
    return stream->status ? -1 : (int64_t)size;
}

/* Turns OpenEXR's result into ours; doing: "write", "read". */
static enum lw_status check(struct stream *stream, exr_result_t result, enum lw_status status,
                            const char *doing) {
    if (stream->status) return stream->status;
    if (result == EXR_ERR_SUCCESS) return LW_OK;
    if (result == EXR_ERR_OUT_OF_MEMORY) status = LW_NO_MEMORY;
    return stream->status =
               lw_status_fail(stream->err, status, "%s: cannot %s the EXR: %s", stream->path, doing,
                              stream->message[0] ? stream->message : exr_get_default_error_message(result));
}

/* ---- writing ---- */

static exr_result_t write_header(exr_context_t context, int part, const struct lw_image_exr *image) {
    exr_result_t result = exr_initialize_required_attr_simple(context, part, (int32_t)image->width,
                                                              (int32_t)image->height, EXR_COMPRESSION_ZIP);
    static const char *const alphabetical[CHANNELS_MAX] = {"A", "B", "G",
                                                           "R"}; /* the order the format asks for */
    const exr_pixel_type_t type = image->half ? EXR_PIXEL_HALF : EXR_PIXEL_FLOAT;
    for (unsigned i = CHANNELS_MAX - image->channels; i < CHANNELS_MAX && !result; i++)
        result = exr_add_channel(
            context, part, alphabetical[i], type,
            *alphabetical[i] == 'A' ? EXR_PERCEPTUALLY_LINEAR : EXR_PERCEPTUALLY_LOGARITHMIC, 1, 1);
    /* Rec. 709 primaries and D65, which sRGB shares (IEC 61966-2-1, table 1) */
    static const exr_attr_chromaticities_t rec709 = {0.64f, 0.33f, 0.30f,   0.60f,
                                                     0.15f, 0.06f, 0.3127f, 0.3290f};
    if (!result) result = exr_attr_set_chromaticities(context, part, "chromaticities", &rec709);
    for (size_t i = 0; i < image->attribute_count && !result; i++)
        result = exr_attr_set_string(context, part, image->attribute[i].name, image->attribute[i].text);
    if (!result) result = exr_write_header(context);
    return result;
}

/* OpenEXR's own way to compress a chunk. */
struct compression {
    exr_result_t (*compress)(exr_encode_pipeline_t *pipeline);
};

/* Compresses a chunk. A reader takes a chunk that is as long as its pixels for pixels, so pixels are stored
 * where the compressed ones are just as long (OpenEXR up to 3.4.7 stores these, its issue 2306). */
static exr_result_t compress(exr_encode_pipeline_t *pipeline) {
    const struct compression *compression = pipeline->encoding_user_data;
    const exr_result_t result = compression->compress(pipeline);
    if (!result && pipeline->compressed_bytes == pipeline->packed_bytes)
        memcpy(pipeline->compressed_buffer, pipeline->packed_buffer, pipeline->packed_bytes);
    return result;
}

static exr_result_t write_pixels(exr_context_t context, int part, const struct lw_image_exr *image) {
    int32_t lines = 1;
    exr_result_t result = exr_get_scanlines_per_chunk(context, part, &lines);
    exr_encode_pipeline_t pipeline = EXR_ENCODE_PIPELINE_INITIALIZER;
    struct compression compression;
    for (int32_t y = 0; y < (int32_t)image->height && !result; y += lines) {
        exr_chunk_info_t chunk = {0};
        result = exr_write_scanline_chunk_info(context, part, y, &chunk);
        if (result) break;
        result = y ? exr_encoding_update(context, part, &chunk, &pipeline)
                   : exr_encoding_initialize(context, part, &chunk, &pipeline);
        if (result) break;
        for (int i = 0; i < pipeline.channel_count; i++) {
            exr_coding_channel_info_t *channel = &pipeline.channels[i];
            const float *from = image->pixel + (size_t)y * image->width * image->channels +
                                channel_of(channel->channel_name, image->channels);
            channel->encode_from_ptr = (const uint8_t *)from;
            channel->user_data_type = EXR_PIXEL_FLOAT;
            channel->user_bytes_per_element = sizeof(float);
            channel->user_pixel_stride = pixel_bytes(image->channels);
            channel->user_line_stride = (int32_t)image->width * pixel_bytes(image->channels);
        }
        if (!y) {
            result = exr_encoding_choose_default_routines(context, part, &pipeline);
            compression.compress = pipeline.compress_fn;
            pipeline.encoding_user_data = &compression;
            pipeline.compress_fn = compress;
        }
        if (!result) result = exr_encoding_run(context, part, &pipeline);
    }
    exr_encoding_destroy(context, &pipeline);
    return result;
}

enum lw_status lw_image_write_exr(const char *path, const float *rgb, uint32_t width, uint32_t height,
                                  const char *units, struct lw_error *err) {
    const struct lw_image_attribute attribute = {"units", units};
    return lw_image_write_exr_with(path,
                                   &(struct lw_image_exr){.pixel = rgb,
                                                          .width = width,
                                                          .height = height,
                                                          .channels = 3,
                                                          .attribute = &attribute,
                                                          .attribute_count = units ? 1 : 0},
                                   err);
}

enum lw_status lw_image_write_exr_with(const char *path, const struct lw_image_exr *image,
                                       struct lw_error *err) {
    if (!image->width || !image->height || image->width > LW_IMAGE_SIDE_MAX ||
        image->height > LW_IMAGE_SIDE_MAX)
        return lw_status_fail(err, LW_USAGE, "%s: an image of %u x %u pixels; each side is from 1 to %u",
                              path, image->width, image->height, LW_IMAGE_SIDE_MAX);
    struct lw_atomic_file file;
    enum lw_status status = lw_atomic_file_open(&file, path, err);
    if (status) return status;

    struct stream stream = {.path = path, .file = &file, .err = err};
    exr_context_initializer_t initializer = EXR_DEFAULT_CONTEXT_INITIALIZER;
    initializer.error_handler_fn = on_error;
    initializer.user_data = &stream;
    initializer.write_fn = on_write;
    exr_context_t context = NULL;
    exr_result_t result = exr_start_write(&context, path, EXR_WRITE_FILE_DIRECTLY, &initializer);
    int part = 0;
    if (!result) result = exr_add_part(context, NULL, EXR_STORAGE_SCANLINE, &part);
    if (!result) result = write_header(context, part, image);
    if (!result) result = write_pixels(context, part, image);
    status = check(&stream, result, LW_IO, "write");
    /* finishing writes the table of chunks: it can fail as well */
    if (context) result = exr_finish(&context);
    if (!status) status = check(&stream, result, LW_IO, "write");

    if (status) {
        lw_atomic_file_abandon(&file);
        return status;
    }
    return lw_atomic_file_commit(&file, err);
}

/* ---- reading ---- */

struct reader {
    struct stream *stream;
    exr_context_t context;
    exr_attr_box2i_t window, display; /* the pixels with data; the pixels shown */
    uint32_t width, height;           /* the data's */
    unsigned channels;                /* 3: R, G, B; 4: A too, where the file has it */
    float *pixel;
    /* A apart: OpenEXR 3.1.5 mixes up the channels of four halves that it turns into one run of floats */
    float *alpha;
    exr_decode_pipeline_t pipeline;
    bool started; /* the pipeline holds something to destroy */
};

static enum lw_status refuse(struct reader *reader, const char *what) {
    return lw_status_fail(reader->stream->err, LW_BAD_DATA, "%s: %s", reader->stream->path, what);
}

static enum lw_status check_channels(struct reader *reader) {
    const exr_attr_chlist_t *channels = NULL;
    exr_result_t result = exr_get_channels(reader->context, 0, &channels);
    if (result) return check(reader->stream, result, LW_BAD_DATA, "read");
    bool found[CHANNELS_MAX] = {false};
    for (int i = 0; i < channels->num_channels; i++) {
        const exr_attr_chlist_entry_t *entry = &channels->entries[i];
        int channel = channel_of(entry->name.str, reader->channels);
        if (channel < 0) continue;
        if (entry->pixel_type != EXR_PIXEL_FLOAT && entry->pixel_type != EXR_PIXEL_HALF)
            return refuse(reader, "channels R, G, B and A must be half or float");
        if (entry->x_sampling != 1 || entry->y_sampling != 1)
            return refuse(reader, "subsampled channels are not supported");
        found[channel] = true;
    }
    for (int i = 0; i < 3; i++)
        if (!found[i]) return refuse(reader, "the EXR has no channels R, G and B");
    return LW_OK;
}

static enum lw_status measure(struct reader *reader, const exr_attr_box2i_t *window, const char *name,
                              uint32_t *out_width, uint32_t *out_height) {
    int64_t width = (int64_t)window->max.x - window->min.x + 1,
            height = (int64_t)window->max.y - window->min.y + 1;
    if (width < 1 || height < 1 || width > LW_IMAGE_SIDE_MAX || height > LW_IMAGE_SIDE_MAX ||
        (uint64_t)width * (uint64_t)height > READ_PIXELS_MAX)
        return lw_status_fail(
            reader->stream->err, LW_BAD_DATA,
            "%s: the EXR has %lld x %lld pixels in its %s window; the limit is %u a side and %u in all",
            reader->stream->path, (long long)width, (long long)height, name, LW_IMAGE_SIDE_MAX,
            READ_PIXELS_MAX);
    *out_width = (uint32_t)width;
    *out_height = (uint32_t)height;
    return LW_OK;
}

static enum lw_status read_size(struct reader *reader) {
    exr_result_t result = exr_get_data_window(reader->context, 0, &reader->window);
    if (!result) result = exr_get_display_window(reader->context, 0, &reader->display);
    if (result) return check(reader->stream, result, LW_BAD_DATA, "read");
    return measure(reader, &reader->window, "data", &reader->width, &reader->height);
}

/* Decodes one chunk whose upper left pixel is (x, y) of our image. */
static exr_result_t read_chunk(struct reader *reader, const exr_chunk_info_t *chunk, uint32_t x, uint32_t y) {
    exr_decode_pipeline_t *pipeline = &reader->pipeline;
    exr_result_t result = reader->started ? exr_decoding_update(reader->context, 0, chunk, pipeline)
                                          : exr_decoding_initialize(reader->context, 0, chunk, pipeline);
    if (result) return result;
    bool first = !reader->started;
    reader->started = true;
    if (x >= reader->width || y >= reader->height || (uint32_t)chunk->width > reader->width - x ||
        (uint32_t)chunk->height > reader->height - y)
        return EXR_ERR_BAD_CHUNK_LEADER;
    for (int i = 0; i < pipeline->channel_count; i++) {
        exr_coding_channel_info_t *channel = &pipeline->channels[i];
        const int target = channel_of(channel->channel_name, reader->channels);
        const bool apart = target == ALPHA;
        const size_t at = (size_t)y * reader->width + x;
        channel->decode_to_ptr = NULL;
        if (apart)
            channel->decode_to_ptr = (uint8_t *)(reader->alpha + at);
        else if (target >= 0)
            channel->decode_to_ptr = (uint8_t *)(reader->pixel + at * reader->channels + (size_t)target);
        channel->user_data_type = EXR_PIXEL_FLOAT;
        channel->user_bytes_per_element = sizeof(float);
        channel->user_pixel_stride = pixel_bytes(apart ? 1 : reader->channels);
        channel->user_line_stride = (int32_t)reader->width * pixel_bytes(apart ? 1 : reader->channels);
    }
    if (first) result = exr_decoding_choose_default_routines(reader->context, 0, pipeline);
    return result ? result : exr_decoding_run(reader->context, 0, pipeline);
}

static exr_result_t read_scanlines(struct reader *reader) {
    int32_t lines = 1;
    exr_result_t result = exr_get_scanlines_per_chunk(reader->context, 0, &lines);
    for (uint32_t y = 0; y < reader->height && !result; y += (uint32_t)lines) {
        exr_chunk_info_t chunk = {0};
        result = exr_read_scanline_chunk_info(reader->context, 0, reader->window.min.y + (int32_t)y, &chunk);
        if (!result) result = read_chunk(reader, &chunk, 0, y);
    }
    return result;
}

static exr_result_t read_tiles(struct reader *reader) {
    int32_t tile_width = 0, tile_height = 0;
    exr_result_t result = exr_get_tile_sizes(reader->context, 0, 0, 0, &tile_width, &tile_height);
    if (!result && (tile_width < 1 || tile_height < 1)) result = EXR_ERR_INVALID_ATTR;
    for (uint32_t y = 0, row = 0; !result && y < reader->height; y += (uint32_t)tile_height, row++)
        for (uint32_t x = 0, column = 0; !result && x < reader->width; x += (uint32_t)tile_width, column++) {
            exr_chunk_info_t chunk = {0};
            result = exr_read_tile_chunk_info(reader->context, 0, (int)column, (int)row, 0, 0, &chunk);
            if (!result) result = read_chunk(reader, &chunk, x, y);
        }
    return result;
}

static enum lw_status read_pixels(struct reader *reader) {
    exr_storage_t storage;
    exr_result_t result = exr_get_storage(reader->context, 0, &storage);
    if (result) return check(reader->stream, result, LW_BAD_DATA, "read");
    if (storage != EXR_STORAGE_SCANLINE && storage != EXR_STORAGE_TILED)
        return refuse(reader, "deep EXR files are not supported");
    enum lw_status status = check_channels(reader);
    if (!status) status = read_size(reader);
    if (status) return status;
    const size_t pixels = (size_t)reader->width * reader->height;
    reader->pixel = malloc(pixels * (size_t)pixel_bytes(reader->channels));
    if (reader->channels > ALPHA) reader->alpha = malloc(pixels * sizeof *reader->alpha);
    if (!reader->pixel || (reader->channels > ALPHA && !reader->alpha))
        return lw_status_fail(reader->stream->err, LW_NO_MEMORY, "%s: out of memory", reader->stream->path);
    for (size_t i = 0; reader->alpha && i < pixels; i++) reader->alpha[i] = 1; /* a file without A */
    result = storage == EXR_STORAGE_TILED ? read_tiles(reader) : read_scanlines(reader);
    for (size_t i = 0; reader->alpha && i < pixels; i++)
        reader->pixel[i * CHANNELS_MAX + ALPHA] = reader->alpha[i];
    return check(reader->stream, result, LW_BAD_DATA, "read");
}

/* The part of one shown row that has data. y: in the display window, from 0. */
static void place_row(const struct reader *reader, int64_t y, uint32_t width, float *out) {
    const int64_t left = (int64_t)reader->window.min.x - reader->display.min.x,
                  row = y + reader->display.min.y - reader->window.min.y;
    const int64_t from = left > 0 ? left : 0,
                  to = left + reader->width < width ? left + reader->width : (int64_t)width;
    if (row < 0 || row >= reader->height || from >= to) return;
    const float *data =
        reader->pixel + ((size_t)row * reader->width + (size_t)(from - left)) * reader->channels;
    memcpy(out + (size_t)from * reader->channels, data,
           (size_t)(to - from) * (size_t)pixel_bytes(reader->channels));
}

/* Puts the data where it is shown: 0 where there is none, nothing of what lies outside. */
static enum lw_status place_in_display(struct reader *reader) {
    uint32_t width = 0, height = 0;
    if (memcmp(&reader->window, &reader->display, sizeof reader->window) == 0) return LW_OK;
    enum lw_status status = measure(reader, &reader->display, "display", &width, &height);
    if (status) return status;
    float *shown = calloc((size_t)width * height, (size_t)pixel_bytes(reader->channels));
    if (!shown)
        return lw_status_fail(reader->stream->err, LW_NO_MEMORY, "%s: out of memory", reader->stream->path);
    for (uint32_t y = 0; y < height; y++)
        place_row(reader, y, width, shown + (size_t)y * width * reader->channels);
    free(reader->pixel);
    reader->pixel = shown;
    reader->width = width;
    reader->height = height;
    return LW_OK;
}

static enum lw_status read_exr(const char *path, unsigned channels, float **out_pixel, uint32_t *out_width,
                               uint32_t *out_height, struct lw_error *err) {
    struct stat st;
    if (stat(path, &st) || !S_ISREG(st.st_mode)) /* a pipe would block, a folder confuse */
        return lw_status_fail(err, LW_NO_INPUT, "%s: no such file", path);
    struct stream stream = {.path = path, .err = err};
    struct reader reader = {
        .stream = &stream, .channels = channels, .pipeline = EXR_DECODE_PIPELINE_INITIALIZER};
    exr_context_initializer_t initializer = EXR_DEFAULT_CONTEXT_INITIALIZER;
    initializer.error_handler_fn = on_error;
    initializer.user_data = &stream;
    initializer.max_image_width = initializer.max_image_height = LW_IMAGE_SIDE_MAX;
    initializer.max_tile_width = initializer.max_tile_height = LW_IMAGE_SIDE_MAX;
    initializer.flags =
        EXR_CONTEXT_FLAG_DISABLE_CHUNK_RECONSTRUCTION; /* damage is reported, not guessed around */
    exr_result_t result = exr_start_read(&reader.context, path, &initializer);
    enum lw_status status =
        check(&stream, result, result == EXR_ERR_FILE_ACCESS ? LW_NO_INPUT : LW_BAD_DATA, "read");
    if (!status) status = read_pixels(&reader);
    if (!status) status = place_in_display(&reader);
    if (reader.started) exr_decoding_destroy(reader.context, &reader.pipeline);
    if (reader.context) exr_finish(&reader.context);
    free(reader.alpha);
    if (status) {
        free(reader.pixel);
        return status;
    }
    *out_pixel = reader.pixel;
    *out_width = reader.width;
    *out_height = reader.height;
    return LW_OK;
}

enum lw_status lw_image_read_exr(const char *path, float **out_rgb, uint32_t *out_width, uint32_t *out_height,
                                 struct lw_error *err) {
    return read_exr(path, 3, out_rgb, out_width, out_height, err);
}

enum lw_status lw_image_read_exr_rgba(const char *path, float **out_rgba, uint32_t *out_width,
                                      uint32_t *out_height, struct lw_error *err) {
    return read_exr(path, 4, out_rgba, out_width, out_height, err);
}
