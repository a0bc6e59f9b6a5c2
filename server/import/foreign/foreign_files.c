#include "server/import/foreign/foreign_files.h"

#include "common/base/file_read.h"
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

/* One open file. */
struct reader {
    struct aiFile file;   /* first: Assimp hands it back */
    const uint8_t *bytes; /* the scene's */
    size_t size, at;
};

static size_t read_bytes(struct aiFile *file, char *out, size_t size, size_t count) {
    struct reader *reader = (struct reader *)file;
    if (size == 0) return 0;
    size_t there = (reader->size - reader->at) / size;
    if (count > there) count = there;
    memcpy(out, reader->bytes + reader->at, size * count);
    reader->at += size * count;
    return count;
}

static size_t write_bytes(struct aiFile *file, const char *bytes, size_t size, size_t count) {
    (void)file, (void)bytes, (void)size, (void)count;
    return 0;
}

static size_t tell(struct aiFile *file) { return ((struct reader *)file)->at; }
static size_t size_of(struct aiFile *file) { return ((struct reader *)file)->size; }
static void flush(struct aiFile *file) { (void)file; }

static enum aiReturn seek(struct aiFile *file, size_t offset, enum aiOrigin origin) {
    struct reader *reader = (struct reader *)file;
    size_t base = origin == aiOrigin_SET ? 0 : origin == aiOrigin_CUR ? reader->at : reader->size;
    size_t to = base + offset; /* unsigned, so that a step back is a wrap */
    if (to > reader->size) return aiReturn_FAILURE;
    reader->at = to;
    return aiReturn_SUCCESS;
}

static struct reader *create_reader(const uint8_t *bytes, size_t size) {
    struct reader *reader = malloc(sizeof *reader);
    if (!reader) return NULL;
    *reader = (struct reader){.file = {.ReadProc = read_bytes,
                                       .WriteProc = write_bytes,
                                       .TellProc = tell,
                                       .FileSizeProc = size_of,
                                       .SeekProc = seek,
                                       .FlushProc = flush},
                              .bytes = bytes,
                              .size = size};
    return reader;
}

static struct aiFile *open_file(struct aiFileIO *io, const char *name, const char *mode) {
    struct lw_foreign_files *files = (struct lw_foreign_files *)io;
    if (strpbrk(mode, "wa+")) return NULL;
    if (strcmp(name, files->name) != 0) return NULL;
    return (struct aiFile *)create_reader(files->bytes, files->size);
}

static void close_file(struct aiFileIO *io, struct aiFile *file) {
    (void)io;
    free(file);
}

enum lw_status lw_foreign_files_init(struct lw_foreign_files *files, const char *path,
                                     enum lw_scene_format format, struct lw_error *err) {
    const char *slash = strrchr(path, '/'), *base = slash ? slash + 1 : path;
    const char *dot = strrchr(base, '.');
    *files = (struct lw_foreign_files){
        .io = {.OpenProc = open_file, .CloseProc = close_file}, .format = format, .path = path};
    files->folder = !slash          ? strdup(".")
                    : slash == path ? strdup("/")
                                    : strndup(path, (size_t)(slash - path));
    if (!files->folder) return lw_status_fail(err, LW_NO_MEMORY, "out of memory");
    snprintf(files->name, sizeof files->name, "%.*s%s", dot ? (int)(dot - base) : (int)strlen(base), base,
             lw_scene_format_ending(format));
    const enum lw_status status =
        lw_file_read(path, LW_FOREIGN_FILE_SIZE_MAX, true, &files->bytes, &files->size, err);
    files->file_size = files->size;
    return status;
}

void lw_foreign_files_finish(struct lw_foreign_files *files) {
    lw_obj_materials_finish(&files->materials);
    lw_obj_text_finish(&files->obj);
    free(files->bytes);
    free(files->folder);
    *files = (struct lw_foreign_files){0};
}
