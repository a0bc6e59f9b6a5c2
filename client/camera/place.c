#include "client/camera/place.h"

#include "common/shading/shading_bend.h"

struct lw_place lw_place_of(const struct lw_affine *to_world) {
    struct lw_place place = {.to_world = *to_world};
    for (int column = 0; column < 3; column++) {
        struct lw_vec3 axis = lw_vec3(column == 0, column == 1, column == 2);
        struct lw_vec3 n = lw_affine_cofactor_normal(to_world, axis);
        place.to_normal.m[0][column] = n.x;
        place.to_normal.m[1][column] = n.y;
        place.to_normal.m[2][column] = n.z;
    }
    for (int row = 0; row < 3; row++) {
        const float *m = to_world->m[row];
        place.growth = fmaxf(place.growth, fabsf(m[0]) + fabsf(m[1]) + fabsf(m[2]));
        place.shift_m = fmaxf(place.shift_m, fabsf(m[3]));
    }
    return place;
}

struct lw_place_point lw_place_point(const struct lw_place *place, const struct lw_mesh *mesh,
                                     const struct lw_hit16 *hits, unsigned i,
                                     const struct lw_surface *surface) {
    const uint32_t triangle = hits->triangle[i], *vertex = mesh->triangle[triangle];
    const bool back = hits->back[i];
    const float side = back ? -1.0f : 1.0f;
    struct lw_vec3 face = surface->geometric_normal, shading = lw_scene_light_normal(surface->normal, face);
    struct lw_place_point point;
    point.normal = lw_vec3_scale(lw_vec3_normalize(lw_affine_vector(&place->to_normal, shading)), side);
    point.face = lw_vec3_scale(lw_vec3_normalize(lw_affine_vector(&place->to_normal, face)), side);
    const float largest =
        fmaxf(lw_vec3_max_abs(mesh->position[vertex[0]]),
              fmaxf(lw_vec3_max_abs(mesh->position[vertex[1]]), lw_vec3_max_abs(mesh->position[vertex[2]])));
    const struct lw_vec3 start = lw_scene_shadow_origin(mesh, triangle, hits->u[i], hits->v[i], back);
    point.origin = lw_trace_lift(lw_affine_point(&place->to_world, start), point.face,
                                 place->growth * largest + place->shift_m);
    return point;
}

/* Bumps are those of the object at rest: a stretched one stretches them, a mirrored one mirrors them. */
static struct lw_vec3 bumped(const struct lw_place *place, const struct lw_finish_point *finish, bool back,
                             const struct lw_surface *surface) {
    const struct lw_vec3 plain = lw_scene_light_normal(surface->normal, surface->geometric_normal);
    const struct lw_vec3 tangent = lw_vec3(finish->tangent.x, finish->tangent.y, finish->tangent.z);
    const struct lw_vec3 normal = lw_scene_bump(finish, plain, tangent);
    return lw_vec3_scale(lw_vec3_normalize(lw_affine_vector(&place->to_normal, normal)), back ? -1.0f : 1.0f);
}

bool lw_place_gloss(const struct lw_place *place, const struct lw_scene *scene, const struct lw_mesh *mesh,
                    const struct lw_hit16 *hits, unsigned i, const struct lw_surface *surface,
                    const struct lw_place_point *point, struct lw_vec3 to_eye, struct lw_place_gloss *out) {
    if (!surface->material->finish || surface->material->unlit) return false;
    struct lw_finish_point finish;
    lw_scene_finish(scene, mesh, hits->triangle[i], hits->u[i], hits->v[i], surface, &finish);
    if (!finish.bumpy && !lw_lobes_mirror(&finish.lobes)) return false;
    out->plain = out->normal = point->normal;
    if (finish.bumpy)
        out->normal = lw_shading_bend(bumped(place, &finish, hits->back[i], surface), point->normal, to_eye);
    lw_vec3_frame(out->normal, &out->across, &out->along);
    out->seen = lw_lobes_see(&finish.lobes, lw_place_gloss_to_local(out, to_eye));
    return true;
}
