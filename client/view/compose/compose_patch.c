#include "client/view/compose/compose_patch.h"

#include "common/shading/tangent.h"
#include "common/tile/fine_choice.h"

/* Seen at a grazing angle a pixel covers a long strip; past this its level would only blur. */
#define COSINE_MIN 0.05f

/* Whether corners' normals are the face's, but for rounding. */
static bool is_flat(const struct lw_mesh *mesh, const uint32_t vertex[3], struct lw_vec3 face) {
    for (int k = 0; k < 3; k++)
        if (!(lw_vec3_dot(mesh->normal[vertex[k]], face) > 0.99999f)) return false;
    return true;
}

/* Part of a triangle that points for direct light are made of. */
static void place_patch(const struct lw_compose *compose, uint32_t o, const struct lw_mesh *mesh,
                        struct lw_vec3 normal_os, struct lw_compose_patch *out) {
    const struct lw_place *place = &compose->place[o];
    const uint32_t *vertex = out->facet.vertex;
    float largest = 0;
    out->flat = is_flat(mesh, vertex, lw_vec3_normalize(normal_os));
    out->face = lw_vec3_normalize(out->normal);
    for (int k = 0; k < 3; k++) {
        out->corner[k] = lw_affine_point(&place->to_world, mesh->position[vertex[k]]);
        largest = fmaxf(largest, lw_vec3_max_abs(mesh->position[vertex[k]]));
    }
    out->largest_m = place->growth * largest + place->shift_m;
}

static void turn_patch(const struct lw_affine *to_world, const struct lw_mesh *mesh,
                       struct lw_compose_patch *out) {
    const uint16_t *code = mesh->tangent + 3 * (size_t)out->triangle;
    float turn = 1;
    for (int k = 0; k < 3; k++) {
        const struct lw_vec4 t = lw_tangent_decode(code[k], mesh->normal[out->facet.vertex[k]]);
        const struct lw_vec3 tangent = lw_affine_vector(to_world, lw_vec3(t.x, t.y, t.z));
        out->finish[k].tangent += (lw_gloss_float4){tangent.x, tangent.y, tangent.z, 0};
        turn = t.w;
    }
    out->turn = lw_affine_determinant(to_world) < 0 ? -turn : turn;
}

/* Whether its base colour is factor and texture alone, and its emission the same everywhere. */
static bool is_simple(const struct lw_mesh *mesh, const struct lw_material *material) {
    return lw_compose_is_finished(material) && material->alpha_mode == LW_ALPHA_OPAQUE && !mesh->colour &&
           (material->emission_texture.texture == LW_SCENE_NONE || !lw_material_shines(material));
}

/* lw_scene_light_normal() takes the face where a shading normal's cosine with it is not above 0.01. */
#define SOUND_MIN 0.011f

/* Part of a triangle that finishes of its points are made of. */
static void finish_patch(const struct lw_compose *compose, uint32_t o, const struct lw_mesh *mesh,
                         struct lw_vec3 normal_os, struct lw_compose_patch *out) {
    const struct lw_place *place = &compose->place[o];
    const struct lw_vec3 face = lw_vec3_normalize(normal_os);
    const struct lw_material *material = out->facet.material;
    out->simple = is_simple(mesh, material);
    out->bumpy = mesh->tangent && lw_compose_is_finished(material) &&
                 material->finish->normal_texture.texture != LW_SCENE_NONE;
    out->face = lw_vec3_normalize(out->normal);
    out->sound = true;
    for (int k = 0; k < 3; k++) {
        const uint32_t v = out->facet.vertex[k];
        const struct lw_vec2 none = {0, 0}, first = mesh->uv[0] ? mesh->uv[0][v] : none,
                             second = mesh->uv[1] ? mesh->uv[1][v] : none;
        const struct lw_vec3 normal = lw_affine_vector(&place->to_normal, mesh->normal[v]);
        out->sound &= lw_vec3_dot(mesh->normal[v], face) > SOUND_MIN;
        out->finish[k].normal = (lw_gloss_float4){normal.x, normal.y, normal.z, first.x};
        out->finish[k].tangent = (lw_gloss_float4){0, 0, 0, first.y};
        out->finish[k].second = (lw_gloss_float4){second.x, second.y, 0, 0};
    }
    out->turn = 1;
    if (out->bumpy) turn_patch(&place->to_world, mesh, out);
}

void lw_compose_patch_init(const struct lw_compose *compose, uint32_t o, uint32_t triangle,
                           struct lw_compose_patch *out) {
    const uint32_t m = compose->scene->object[o].mesh;
    const struct lw_mesh *mesh = &compose->scene->mesh[m];
    out->object = o;
    out->triangle = triangle;
    lw_scene_facet(compose->scene, mesh, triangle, &out->facet);
    const uint32_t *vertex = out->facet.vertex;
    const struct lw_vec2 *uv = out->facet.lightmap_uv;
    struct lw_vec3 a = lw_vec3_sub(mesh->position[vertex[1]], mesh->position[vertex[0]]);
    struct lw_vec3 b = lw_vec3_sub(mesh->position[vertex[2]], mesh->position[vertex[0]]);
    struct lw_vec3 normal_os = lw_vec3_cross(a, b);
    out->normal = lw_affine_cofactor_normal(&compose->pose->object_to_world[o], normal_os);
    out->grazing = COSINE_MIN * lw_vec3_length(out->normal);
    out->texels = fabsf(lw_vec2_twice_area(uv[0], uv[1], uv[2]));
    out->coarsest =
        compose->coarsest[m] && lw_vec3_length(normal_os) > 1e-30f ? compose->coarsest[m][triangle] : 0;
    const bool finished = lw_compose_shades_finish(compose, out->facet.material);
    if (compose->direct || (compose->mirrors && finished)) place_patch(compose, o, mesh, normal_os, out);
    if (finished) finish_patch(compose, o, mesh, normal_os, out);
}

int lw_compose_patch_level(const struct lw_compose_patch *patch, int finer, struct lw_vec3 dir,
                           float pixel_m) {
    const float length = lw_vec3_length(dir), slanted = fabsf(lw_vec3_dot(patch->normal, dir));
    const float least = patch->grazing * length, area = slanted > least ? slanted : least;
    float texels = pixel_m * pixel_m * patch->texels * length;
    int level = 0;
    for (; level < patch->coarsest && texels >= 4 * area && texels > 0; level++) texels *= 0.25f;
    return level ? level : -lw_fine_choice(texels, area, finer);
}

void lw_compose_patch_forget(struct lw_compose_patches *patches) {
    patches->packet = 0;
    for (unsigned i = 0; i < LW_COMPOSE_PATCHES; i++)
        patches->patch[i].object = LW_TRACE_MISS, patches->patch[i].packet = 0;
    patches->fine = (struct lw_compose_fine_ids){0};
}
