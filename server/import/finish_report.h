/* finish_report.h: the textures, bytes and tangents that finishes add to a scene.
 * Threads: [any]. */
#ifndef LW_IMPORT_FINISH_REPORT_H
#define LW_IMPORT_FINISH_REPORT_H

#include "common/scene/scene.h"

struct lw_finish_report {
    uint32_t materials;                   /* materials that have a finish */
    uint32_t normal_maps, other_maps;     /* textures of finishes */
    uint64_t normal_texels, other_texels; /* these maps' */
    uint64_t tangents;                    /* corners that have one */
    uint64_t normal_bytes, other_bytes;   /* in the package (finish_package.h): with tangents; the rest */
};

void lw_finish_report_measure(const struct lw_scene *scene, struct lw_finish_report *out);

/** One line, if there is any finish. scene: its path. [any] */
void lw_finish_report_log(const struct lw_finish_report *report, const char *scene);

#endif
