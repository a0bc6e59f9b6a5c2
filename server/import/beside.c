#include "server/import/beside.h"

#include <dirent.h>
#include <limits.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <strings.h>
#include <sys/stat.h>

/* Where exporters and people put textures. "": beside the scene. */
static const char *const subfolders[] = {"", "textures", "texture", "tex", "maps", "images", "materials"};

#define ENTRIES_MAX 100000 /* entries of a folder, compared without regard to case */

static bool is_file(const char *path) {
    struct stat info;
    return stat(path, &info) == 0 && S_ISREG(info.st_mode);
}

static bool is_folder(const char *path) {
    struct stat info;
    return stat(path, &info) == 0 && S_ISDIR(info.st_mode);
}

/* Replaces the name at the end of `path` (from `name` on) by one of the folder's that differs in case
 * only. */
static bool mend_case(char *path, char *name, bool folder_wanted) {
    char saved = name[-1];
    name[-1] = 0;
    DIR *folder = opendir(path);
    name[-1] = saved;
    bool found = false;
    unsigned seen = 0;
    for (struct dirent *entry; !found && folder && seen < ENTRIES_MAX && (entry = readdir(folder)); seen++) {
        if (strcasecmp(entry->d_name, name) != 0) continue;
        memcpy(name, entry->d_name, strlen(name)); /* it has the same length */
        found = folder_wanted ? is_folder(path) : is_file(path);
    }
    if (folder) closedir(folder);
    return found;
}

/* folder/relative as a file, each part in other letters if need be. The relative path has no "..". */
static bool try_path(const char *folder, const char *relative, char out[PATH_MAX]) {
    int length = snprintf(out, PATH_MAX, "%s/%s", folder, relative);
    if (length < 0 || length >= PATH_MAX) return false;
    if (is_file(out)) return true;
    for (char *part = out + strlen(folder) + 1; *part;) {
        char *slash = strchr(part, '/');
        if (slash) *slash = 0;
        bool there = slash ? is_folder(out) : is_file(out);
        if (!there && (!*part || !mend_case(out, part, slash != NULL))) return false;
        if (!slash) return true;
        *slash = '/';
        part = slash + 1;
    }
    return false;
}

/* Resolves empty parts, "." and "..". A path that leaves the folder starts at it again. */
static void normalise(const char *path, char *out) {
    char *end = out;
    while (*path) {
        size_t length = strcspn(path, "/\\");
        if (length == 2 && path[0] == '.' && path[1] == '.') {
            while (end > out && *--end != '/') {
            }
        } else if (length > 0 && !(length == 1 && path[0] == '.')) {
            if (end > out) *end++ = '/';
            memcpy(end, path, length);
            end += length;
        }
        path += length;
        path += *path != 0;
    }
    *end = 0;
}

static int hex_digit(char c) {
    return c >= '0' && c <= '9'   ? c - '0'
           : c >= 'a' && c <= 'f' ? c - 'a' + 10
           : c >= 'A' && c <= 'F' ? c - 'A' + 10
                                  : -1;
}

static void decode_percent(char *text) {
    char *out = text;
    for (; *text; text++) {
        int high = *text == '%' ? hex_digit(text[1]) : -1, low = high < 0 ? -1 : hex_digit(text[2]);
        if (low < 0 || high * 16 + low == 0) {
            *out++ = *text;
            continue;
        }
        *out++ = (char)(high * 16 + low);
        text += 2;
    }
    *out = 0;
}

static bool try_everywhere(const char *folder, const char *scene, const char *path, char out[PATH_MAX]) {
    for (const char *rest = path; rest; rest = strchr(rest, '/'), rest = rest ? rest + 1 : NULL)
        if (*rest && try_path(folder, rest, out)) return true;
    const char *slash = strrchr(path, '/'), *name = slash ? slash + 1 : path;
    char relative[PATH_MAX];
    if (!*name) return false;
    for (size_t i = 0; i < sizeof subfolders / sizeof *subfolders; i++) {
        int length = snprintf(relative, sizeof relative, "%s%s%s", subfolders[i], i ? "/" : "", name);
        if (length < PATH_MAX && try_path(folder, relative, out)) return true;
    }
    int length = snprintf(relative, sizeof relative, "%.*s.fbm/%s", (int)strcspn(scene, "."), scene, name);
    return length < PATH_MAX && try_path(folder, relative, out);
}

bool lw_beside_find(const char *folder, const char *scene, const char *wanted, char **out_path) {
    char path[PATH_MAX], clean[PATH_MAX], found[PATH_MAX];
    if (strncasecmp(wanted, "file://", 7) == 0) wanted += 7;
    if (snprintf(path, sizeof path, "%s", wanted) >= PATH_MAX) return false;
    normalise(path, clean);
    bool good = try_everywhere(folder, scene, clean, found);
    if (!good && strchr(path, '%')) {
        decode_percent(path);
        normalise(path, clean);
        good = try_everywhere(folder, scene, clean, found);
    }
    if (good) *out_path = strdup(found + strlen(folder) + 1);
    return good;
}
