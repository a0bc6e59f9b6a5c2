/* Runs a fuzzer over every file of the folders named, in plain builds: what once crashed stays a test.
 * A replay of nothing cannot fail, so a missing or empty folder is an error. */
#include <dirent.h>
#include <errno.h>
#include <stdint.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/stat.h>

int LLVMFuzzerTestOneInput(const uint8_t *bytes, size_t size);

/* Exact-size heap memory, so that ASan sees a read past the end. */
static uint8_t *read_file(const char *path, size_t *out_size) {
    FILE *file = fopen(path, "rb");
    struct stat st;
    if (!file || fstat(fileno(file), &st)) goto fail;
    uint8_t *bytes = malloc(st.st_size ? (size_t)st.st_size : 1);
    if (!bytes) goto fail;
    if (fread(bytes, 1, (size_t)st.st_size, file) != (size_t)st.st_size) {
        free(bytes);
        goto fail;
    }
    fclose(file);
    *out_size = (size_t)st.st_size;
    return bytes;
fail:
    fprintf(stderr, "replay: cannot read %s: %s\n", path, strerror(errno));
    if (file) fclose(file);
    return NULL;
}

static int is_visible(const struct dirent *entry) { return entry->d_name[0] != '.'; }

static int replay_folder(const char *folder) {
    struct dirent **entries;
    int count = scandir(folder, &entries, is_visible, alphasort);
    if (count < 0) {
        fprintf(stderr, "replay: cannot open the corpus %s: %s\n", folder, strerror(errno));
        return EXIT_FAILURE;
    }
    int result = EXIT_SUCCESS;
    for (int i = 0; i < count; i++) {
        char path[4096];
        snprintf(path, sizeof path, "%s/%s", folder, entries[i]->d_name);
        free(entries[i]);
        size_t size;
        uint8_t *bytes = read_file(path, &size);
        if (!bytes) {
            result = EXIT_FAILURE;
            continue;
        }
        fprintf(stderr, "replay: %s\n", path); /* before the run: the last line names what crashed */
        LLVMFuzzerTestOneInput(bytes, size);
        free(bytes);
    }
    free(entries);
    if (!count) {
        fprintf(stderr, "replay: the corpus %s is empty: nothing was tested\n", folder);
        return EXIT_FAILURE;
    }
    fprintf(stderr, "replay: %d files of %s\n", count, folder);
    return result;
}

int main(int argc, char **argv) {
    if (argc < 2) {
        fprintf(stderr, "usage: %s CORPUS-FOLDER...\n", argv[0]);
        return EXIT_FAILURE;
    }
    int result = EXIT_SUCCESS;
    for (int i = 1; i < argc; i++)
        if (replay_folder(argv[i]) != EXIT_SUCCESS) result = EXIT_FAILURE;
    return result;
}
