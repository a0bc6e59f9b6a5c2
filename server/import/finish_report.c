#include "server/import/finish_report.h"

#include "common/base/log.h"

/* Bytes of a texel in a package: normals have x and y, surfaces R, G, B, colours all four. */
static unsigned texel_bytes(uint8_t content) {
    return content == LW_CONTENT_NORMAL ? 2 : content == LW_CONTENT_SURFACE ? 3 : 4;
}

void lw_finish_report_measure(const struct lw_scene *scene, struct lw_finish_report *out) {
    *out = (struct lw_finish_report){0};
    for (uint32_t i = 0; i < scene->material_count; i++) out->materials += scene->material[i].finish != NULL;
    for (uint32_t i = 0; i < scene->finish_texture_count; i++) {
        const struct lw_texture *texture = &scene->finish_texture[i];
        const uint64_t texels = (uint64_t)texture->width * texture->height;
        const bool normal = texture->content == LW_CONTENT_NORMAL;
        *(normal ? &out->normal_maps : &out->other_maps) += 1;
        *(normal ? &out->normal_texels : &out->other_texels) += texels;
        *(normal ? &out->normal_bytes : &out->other_bytes) += texels * texel_bytes(texture->content);
    }
    for (uint32_t i = 0; i < scene->mesh_count; i++)
        if (scene->mesh[i].tangent) out->tangents += 3 * (uint64_t)scene->mesh[i].triangle_count;
    out->normal_bytes += out->tangents * sizeof *scene->mesh->tangent;
}

void lw_finish_report_log(const struct lw_finish_report *report, const char *scene) {
    if (!report->materials) return;
    lw_log(
        LW_LOG_INFO,
        "%s: the finishes of %u materials add %u normal maps (%.2f M texels, with tangents %.2f MB) and %u "
        "other textures (%.2f M texels, %.2f MB); --materials matt leaves them out",
        scene, report->materials, report->normal_maps, (double)report->normal_texels * 1e-6,
        (double)report->normal_bytes * 1e-6, report->other_maps, (double)report->other_texels * 1e-6,
        (double)report->other_bytes * 1e-6);
}
