#include "client/view/camera.h"

#include <errno.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#define DEFAULT_FOV_Y (50.0f / 180.0f * LW_PI)
#define EYE_HEIGHT_M  1.6f
/* A scene is an interior if this share of directions from its middle meets a surface. */
#define INTERIOR_SHARE   0.6f
#define PROBE_DIRECTIONS 64

struct lw_camera_view lw_camera_look_at(struct lw_vec3 position, struct lw_vec3 target, float fov_y) {
    struct lw_vec3 forward = lw_vec3_normalize(lw_vec3_sub(target, position));
    struct lw_vec3 upright =
        fabsf(forward.y) < 0.9999f ? lw_vec3(0, 1, 0) : lw_vec3(0, 0, copysignf(1, forward.y));
    struct lw_vec3 right = lw_vec3_normalize(lw_vec3_cross(forward, upright));
    return (struct lw_camera_view){.position = position,
                                   .right = right,
                                   .up = lw_vec3_cross(right, forward),
                                   .forward = forward,
                                   .fov_y = fov_y};
}

/* Reads `count` comma-separated finite numbers and the character after them. */
static enum lw_status parse_numbers(const char **text, const char *part, int count, char after, float *out,
                                    struct lw_error *err) {
    const char *at = *text;
    for (int i = 0; i < count; i++) {
        char *end;
        double value = strtod(at, &end);
        if (end == at || !isfinite(value) || fabs(value) > 1e9)
            return lw_status_fail(err, LW_USAGE, "%s: expected %s at \"%s\" (px,py,pz:tx,ty,tz:fov_y_deg)",
                                  part, count == 1 ? "a number" : "three numbers", at);
        out[i] = (float)value;
        char expected = i + 1 < count ? ',' : after;
        if (*end != expected) {
            if (expected == '\0')
                return lw_status_fail(err, LW_USAGE, "%s: \"%s\" is too much (px,py,pz:tx,ty,tz:fov_y_deg)",
                                      part, end);
            return lw_status_fail(err, LW_USAGE, "%s: expected '%c' at \"%s\" (px,py,pz:tx,ty,tz:fov_y_deg)",
                                  part, expected, end);
        }
        at = end + (expected != '\0');
    }
    *text = at;
    return LW_OK;
}

enum lw_status lw_camera_parse(const char *text, struct lw_camera_view *out_view, struct lw_error *err) {
    float position[3], target[3], fov_deg = 0;
    enum lw_status status = parse_numbers(&text, "position", 3, ':', position, err);
    if (status == LW_OK) status = parse_numbers(&text, "target", 3, ':', target, err);
    if (status == LW_OK) status = parse_numbers(&text, "field of view", 1, '\0', &fov_deg, err);
    if (status != LW_OK) return status;
    if (!(fov_deg >= 1.0f && fov_deg <= 179.0f))
        return lw_status_fail(err, LW_USAGE, "field of view: %g is not within 1..179 degrees",
                              (double)fov_deg);
    struct lw_vec3 from = lw_vec3(position[0], position[1], position[2]);
    struct lw_vec3 to = lw_vec3(target[0], target[1], target[2]);
    if (!(lw_vec3_length(lw_vec3_sub(to, from)) > 1e-6f))
        return lw_status_fail(err, LW_USAGE, "target: is where the camera is; it must be another point");
    *out_view = lw_camera_look_at(from, to, fov_deg / 180.0f * LW_PI);
    return LW_OK;
}

struct lw_camera_view lw_camera_of_scene(const struct lw_scene *scene, const struct lw_pose *pose,
                                         uint32_t camera) {
    const struct lw_affine *to_world = &pose->node_to_world[scene->camera[camera].node];
    struct lw_camera_view view = {.position = lw_affine_point(to_world, lw_vec3(0, 0, 0)),
                                  .forward = lw_vec3_normalize(lw_affine_vector(to_world, lw_vec3(0, 0, -1))),
                                  .fov_y = scene->camera[camera].fov_y};
    /* A node may be sheared or mirrored; the picture must be neither. */
    struct lw_vec3 right = lw_vec3_cross(view.forward, lw_affine_vector(to_world, lw_vec3(0, 1, 0)));
    if (!(lw_vec3_length(right) > 1e-12f))
        return lw_camera_look_at(view.position, lw_vec3_add(view.position, view.forward), view.fov_y);
    view.right = lw_vec3_normalize(right);
    view.up = lw_vec3_cross(view.right, view.forward);
    return view;
}

enum lw_status lw_camera_find(const struct lw_scene *scene, const char *name, uint32_t *out_camera,
                              struct lw_error *err) {
    for (uint32_t i = 0; i < scene->camera_count; i++)
        if (strcmp(scene->camera[i].name, name) == 0) {
            *out_camera = i;
            return LW_OK;
        }
    if (scene->camera_count == 0)
        return lw_status_fail(err, LW_USAGE, "no camera \"%s\": the scene has none; use --camera", name);
    char names[320];
    size_t length = 0;
    for (uint32_t i = 0; i < scene->camera_count; i++) {
        size_t room = sizeof names - length;
        int size = snprintf(names + length, room, "%s\"%s\"", i ? ", " : "", scene->camera[i].name);
        if (size < 0 || (size_t)size + 24 > room) { /* keep room to say how many are left out */
            snprintf(names + length, room, "%s%u more", i ? ", and " : "", scene->camera_count - i);
            break;
        }
        length += (size_t)size;
    }
    return lw_status_fail(err, LW_USAGE, "no camera \"%.80s\"; the scene has %s", name, names);
}

/* Direction i of a Fibonacci lattice on the sphere. */
static struct lw_vec3 lattice_direction(unsigned i, unsigned count) {
    float y = 1.0f - (2.0f * (float)i + 1.0f) / (float)count, r = sqrtf(1.0f - y * y);
    float phi = 2.39996323f * (float)i; /* the golden angle */
    return lw_vec3(r * cosf(phi), y, r * sinf(phi));
}

/* Free distances from a point: 16 at a time; infinite where nothing is met. */
static void free_distances(const struct lw_trace *trace, struct lw_vec3 from, const struct lw_vec3 *dir,
                           unsigned count, float *out) {
    for (unsigned first = 0; first < count; first += LW_TRACE_WIDTH) {
        struct lw_ray16 rays = {.salt = 0};
        struct lw_hit16 hits;
        unsigned lanes = count - first < LW_TRACE_WIDTH ? count - first : LW_TRACE_WIDTH;
        for (unsigned i = 0; i < LW_TRACE_WIDTH; i++)
            lw_trace_set_ray(&rays, i, from, dir[first + (i < lanes ? i : 0)], INFINITY);
        lw_trace_closest16(trace, LW_TRACE_LIGHT, (uint16_t)((1u << lanes) - 1u), &rays, &hits);
        for (unsigned i = 0; i < lanes; i++)
            out[first + i] = hits.object[i] == LW_TRACE_MISS ? INFINITY : hits.t[i];
    }
}

/* How good a place inside is: how far one sees, on average and at most `far_m`; 0 where too few directions are
 * closed for an interior. */
static float interior_merit(const struct lw_trace *trace, struct lw_vec3 from, float far_m) {
    struct lw_vec3 dir[PROBE_DIRECTIONS];
    float free_m[PROBE_DIRECTIONS], sum = 0;
    unsigned closed = 0;
    for (unsigned i = 0; i < PROBE_DIRECTIONS; i++) dir[i] = lattice_direction(i, PROBE_DIRECTIONS);
    free_distances(trace, from, dir, PROBE_DIRECTIONS, free_m);
    for (unsigned i = 0; i < PROBE_DIRECTIONS; i++) {
        closed += isfinite(free_m[i]);
        sum += fminf(free_m[i], far_m);
    }
    return (float)closed >= INTERIOR_SHARE * PROBE_DIRECTIONS ? sum / PROBE_DIRECTIONS : 0;
}

static struct lw_camera_view look_along_longest(const struct lw_trace *trace, struct lw_vec3 from,
                                                float far_m) {
    enum { COUNT = 64 };
    struct lw_vec3 dir[COUNT];
    float free_m[COUNT];
    for (unsigned i = 0; i < COUNT; i++) {
        float phi = 2 * LW_PI * (float)i / COUNT;
        dir[i] = lw_vec3(cosf(phi), 0, sinf(phi));
    }
    free_distances(trace, from, dir, COUNT, free_m);
    unsigned best = 0;
    for (unsigned i = 1; i < COUNT; i++) {
        float there = fminf(free_m[i], far_m) + 0.5f * fminf(free_m[(i + COUNT / 2) % COUNT], far_m);
        float so_far = fminf(free_m[best], far_m) + 0.5f * fminf(free_m[(best + COUNT / 2) % COUNT], far_m);
        if (there > so_far) best = i;
    }
    /* Step back towards the wall behind: more of the room comes into the picture. */
    float behind_m = fminf(free_m[(best + COUNT / 2) % COUNT], far_m);
    struct lw_vec3 position = lw_vec3_mad(from, dir[best], -0.8f * behind_m);
    struct lw_vec3 target = lw_vec3_add(position, dir[best]);
    return lw_camera_look_at(position, target, DEFAULT_FOV_Y);
}

struct lw_camera_view lw_camera_default(const struct lw_scene *scene, const struct lw_pose *pose,
                                        const struct lw_trace *trace, float aspect) {
    struct lw_vec3 low, high;
    if (!lw_pose_bounds(pose, scene, &low, &high))
        return lw_camera_look_at(lw_vec3(0, 0, 1), lw_vec3(0, 0, 0), DEFAULT_FOV_Y);
    struct lw_vec3 size = lw_vec3_sub(high, low), centre = lw_vec3_mad(low, size, 0.5f);
    float diagonal_m = fmaxf(lw_vec3_length(size), 1e-3f);

    /* Files in centimetres make people of two storeys' height: the eye then goes by the scene, not by the metre. */
    float eye_height_m = fmaxf(EYE_HEIGHT_M, 0.15f * size.y);
    /* The middle may be inside a column: try places around it. */
    struct lw_vec3 best = centre;
    float best_merit = 0;
    for (int i = 0; i < 25; i++) {
        struct lw_vec3 place = lw_vec3(low.x + size.x * (0.3f + 0.1f * (float)(i % 5)),
                                       low.y + fminf(eye_height_m, 0.5f * size.y),
                                       low.z + size.z * (0.3f + 0.1f * (float)(i / 5)));
        float merit = interior_merit(trace, place, diagonal_m);
        if (merit > best_merit) best_merit = merit, best = place;
    }
    if (best_merit > 0.02f * diagonal_m) return look_along_longest(trace, best, diagonal_m);

    float half_y = 0.5f * DEFAULT_FOV_Y, half_x = atanf(tanf(half_y) * aspect);
    float distance_m = 0.5f * diagonal_m / sinf(fminf(half_x, half_y));
    struct lw_vec3 away = lw_vec3_normalize(lw_vec3(0.6f, 0.45f, 1.0f));
    return lw_camera_look_at(lw_vec3_mad(centre, away, distance_m), centre, DEFAULT_FOV_Y);
}

struct lw_camera_plane lw_camera_plane(const struct lw_camera_view *view, uint32_t width, uint32_t height) {
    float pixel = 2.0f * tanf(0.5f * view->fov_y) / (float)height;
    return (struct lw_camera_plane){.middle = view->forward,
                                    .right = lw_vec3_scale(view->right, pixel),
                                    .up = lw_vec3_scale(view->up, pixel),
                                    .half_width = 0.5f * (float)width,
                                    .half_height = 0.5f * (float)height,
                                    .pixel = pixel};
}
