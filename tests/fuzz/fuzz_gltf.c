/* The glTF reader on any bytes: a scene that validates, or an error with a text; never a crash. No file is
 * opened. */
#include "common/log.h"
#include "server/import/gltf.h"

#include <stdlib.h>

int LLVMFuzzerInitialize(int *argc, char ***argv);
int LLVMFuzzerTestOneInput(const uint8_t *bytes, size_t size);

int LLVMFuzzerInitialize(int *argc, char ***argv) {
    (void)argc, (void)argv;
    lw_log_init("fuzz_gltf", LW_LOG_ERROR);
    return 0;
}

int LLVMFuzzerTestOneInput(const uint8_t *bytes, size_t size) {
    struct lw_scene *scene = NULL;
    struct lw_error err = {0};
    enum lw_status status = lw_gltf_load_memory(bytes, size, "fuzz", &scene, &err);
    if (status == LW_OK ? lw_scene_validate(scene, &err) != LW_OK : scene || !err.text[0]) abort();
    lw_scene_destroy(scene);
    return 0;
}
