#include "server/serve/web/web_files.h"

#include "common/base/file_read.h"
#include "common/base/invariant.h"
#include "common/scene/package.h"

#include <dirent.h>
#include <errno.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <strings.h>
#include <sys/stat.h>

#define PATH_SIZE 1024u

static const struct {
    const char *ending, *type;
} types[] = {{".html", "text/html; charset=utf-8"},
             {".js", "text/javascript; charset=utf-8"},
             {".mjs", "text/javascript; charset=utf-8"},
             {".css", "text/css; charset=utf-8"},
             {".json", "application/json"},
             {".map", "application/json"},
             {".wasm", "application/wasm"},
             {".svg", "image/svg+xml"},
             {".png", "image/png"},
             {".jpg", "image/jpeg"},
             {".ico", "image/x-icon"},
             {".webp", "image/webp"},
             {".woff2", "font/woff2"},
             {".txt", "text/plain; charset=utf-8"},
             {".md", "text/plain; charset=utf-8"},
             {".glb", "model/gltf-binary"},
             {".gltf", "model/gltf+json"}};

static const char *type_of(const char *path) {
    const char *ending = strrchr(path, '.');
    for (size_t i = 0; ending && i < sizeof types / sizeof *types; i++)
        if (strcasecmp(ending, types[i].ending) == 0) return types[i].type;
    return "application/octet-stream";
}

static enum lw_status add(struct lw_web_files *files, const char *name, const char *path, int64_t modified_s,
                          struct lw_error *err) {
    if (files->count == LW_WEB_FILES_MAX)
        return lw_status_fail(err, LW_BAD_DATA, "%s: a web root has at most %u files", name,
                              LW_WEB_FILES_MAX);
    struct lw_web_file *grown = realloc(files->file, (files->count + 1) * sizeof *grown);
    if (!grown) return lw_status_fail(err, LW_NO_MEMORY, "%s: out of memory", name);
    files->file = grown;
    struct lw_web_file *file = &grown[files->count];
    *file = (struct lw_web_file){.type = type_of(path), .path = strdup(path), .modified_s = modified_s};
    if (!file->path) return lw_status_fail(err, LW_NO_MEMORY, "%s: out of memory", name);
    enum lw_status status =
        lw_file_read(name, LW_WEB_FILES_BYTES_MAX - files->bytes, true, &file->bytes, &file->size, err);
    if (status != LW_OK) {
        lw_status_context(err, "%s", name);
        free(file->path);
        return status;
    }
    struct lw_package_hash hash;
    lw_package_hash(file->bytes, file->size, &hash);
    char *at = file->tag;
    *at++ = '"';
    for (size_t i = 0; i < sizeof hash.bytes; i++) at += sprintf(at, "%02x", hash.bytes[i]);
    *at++ = '"';
    *at = '\0';
    LW_INVARIANT(file->size <= LW_WEB_FILES_BYTES_MAX - files->bytes && at < file->tag + sizeof file->tag);
    files->bytes += file->size;
    files->count++;
    return LW_OK;
}

/* folder, path: of the same, for us and in a URL, without a slash at the end. */
static enum lw_status read_folder(struct lw_web_files *files, const char *folder, const char *path,
                                  unsigned depth, struct lw_error *err) {
    LW_INVARIANT(depth <= LW_WEB_FILES_DEPTH_MAX);
    DIR *directory = opendir(folder);
    if (!directory)
        return lw_status_fail(err, errno == ENOENT || errno == ENOTDIR ? LW_NO_INPUT : LW_IO, "%s: %s",
                              folder, strerror(errno));
    enum lw_status status = LW_OK;
    for (struct dirent *entry; status == LW_OK && (entry = readdir(directory));) {
        char inner_folder[PATH_SIZE], inner_path[PATH_SIZE];
        struct stat st;
        if (*entry->d_name == '.') continue;
        const int length = snprintf(inner_folder, PATH_SIZE, "%s/%s", folder, entry->d_name);
        if (length < 0 || (size_t)length >= PATH_SIZE)
            status = lw_status_fail(err, LW_BAD_DATA, "%s: the name of a file in it is too long", folder);
        else if (lstat(inner_folder, &st) != 0)
            status = lw_status_fail(err, LW_IO, "%s: %s", inner_folder, strerror(errno));
        if (status != LW_OK) break;
        snprintf(inner_path, PATH_SIZE, "%s/%s", path, entry->d_name);
        if (S_ISREG(st.st_mode))
            status = add(files, inner_folder, inner_path, (int64_t)st.st_mtim.tv_sec, err);
        else if (S_ISDIR(st.st_mode) && depth == LW_WEB_FILES_DEPTH_MAX)
            status = lw_status_fail(err, LW_BAD_DATA, "%s: folders lie at most %u deep in a web root",
                                    inner_folder, LW_WEB_FILES_DEPTH_MAX);
        else if (S_ISDIR(st.st_mode))
            status = read_folder(files, inner_folder, inner_path, depth + 1, err);
    }
    closedir(directory);
    return status;
}

static int compare(const void *a, const void *b) {
    const struct lw_web_file *of_a = a, *of_b = b;
    return strcmp(of_a->path, of_b->path);
}

static const struct lw_web_file *find(const struct lw_web_files *files, char *path) {
    const struct lw_web_file wanted = {.path = path};
    return files->count ? bsearch(&wanted, files->file, files->count, sizeof wanted, compare) : NULL;
}

/* By path, each once. */
static bool is_in_order(const struct lw_web_files *files) {
    for (size_t i = 1; i < files->count; i++)
        if (compare(&files->file[i - 1], &files->file[i]) >= 0) return false;
    return true;
}

/* Finds what codings each file has. The files are in order, and stay where they are. */
static void find_codings(struct lw_web_files *files) {
    for (size_t i = 0; i < files->count; i++)
        for (unsigned coding = 0; coding < LW_CONTENT_CODING_COUNT; coding++) {
            struct lw_web_file *file = &files->file[i];
            char path[PATH_SIZE];
            const int size = snprintf(path, sizeof path, "%s%s", file->path,
                                      lw_content_coding_ending((enum lw_content_coding)coding));
            const struct lw_web_file *coded = (size_t)size < sizeof path ? find(files, path) : NULL;
            if (coded && coded->size && coded->size < file->size && coded->modified_s >= file->modified_s)
                file->coded[coding] = coded;
        }
}

enum lw_status lw_web_files_read(const char *folder, struct lw_web_files *out_files, struct lw_error *err) {
    struct lw_web_files files = {0};
    const enum lw_status status = read_folder(&files, folder, "", 0, err);
    if (status != LW_OK) {
        lw_web_files_finish(&files);
        return status;
    }
    if (files.count) qsort(files.file, files.count, sizeof *files.file, compare);
    LW_INVARIANT_DEAR(is_in_order(&files));
    find_codings(&files);
    *out_files = files;
    return LW_OK;
}

void lw_web_files_finish(struct lw_web_files *files) {
    for (size_t i = 0; i < files->count; i++) {
        free(files->file[i].path);
        free(files->file[i].bytes);
    }
    free(files->file);
    *files = (struct lw_web_files){0};
}

const struct lw_web_file *lw_web_files_find(const struct lw_web_files *files, const char *path) {
    char whole[PATH_SIZE];
    const size_t length = strlen(path);
    const bool is_folder = length && path[length - 1] == '/';
    const int size = snprintf(whole, sizeof whole, "%s%s", path, is_folder ? "index.html" : "");
    return size < 0 || (size_t)size >= sizeof whole ? NULL : find(files, whole);
}

unsigned lw_web_files_codings(const struct lw_web_file *file) {
    unsigned codings = 0;
    for (unsigned coding = 0; coding < LW_CONTENT_CODING_COUNT; coding++)
        if (file->coded[coding]) codings |= 1u << coding;
    return codings;
}
