#include "client/camera/camera.h"

#include <errno.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

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

void lw_camera_format(const struct lw_camera_view *view, char out[LW_CAMERA_TEXT_SIZE]) {
    const struct lw_vec3 p = view->position;
    /* as far away as the eye is from the origin: else the direction is lost in the digits of the place */
    const float away = fmaxf(1, lw_vec3_max_abs(p));
    const struct lw_vec3 t = lw_vec3_mad(p, view->forward, away);
    const bool parallel = view->height_m > 0;
    snprintf(out, LW_CAMERA_TEXT_SIZE, "%.7g,%.7g,%.7g:%.7g,%.7g,%.7g:%.5g%s", (double)p.x, (double)p.y,
             (double)p.z, (double)t.x, (double)t.y, (double)t.z,
             (double)(parallel ? view->height_m : view->fov_y / LW_PI * 180), parallel ? "m" : "");
}

#define FORM "(px,py,pz:tx,ty,tz:fov_y_deg, or :heightm for an orthographic view)"

/* Reads `count` comma-separated finite numbers and the character after them. */
static enum lw_status parse_numbers(const char **text, const char *part, int count, char after, float *out,
                                    struct lw_error *err) {
    const char *at = *text;
    for (int i = 0; i < count; i++) {
        char *end;
        double value = strtod(at, &end);
        if (end == at || !isfinite(value) || fabs(value) > 1e9)
            return lw_status_fail(err, LW_USAGE, "%s: expected %s at \"%s\" " FORM, part,
                                  count == 1 ? "a number" : "three numbers", at);
        out[i] = (float)value;
        char expected = i + 1 < count ? ',' : after;
        if (*end != expected) {
            if (expected == '\0')
                return lw_status_fail(err, LW_USAGE, "%s: \"%s\" is too much " FORM, part, end);
            return lw_status_fail(err, LW_USAGE, "%s: expected '%c' at \"%s\" " FORM, part, expected, end);
        }
        at = end + (expected != '\0');
    }
    *text = at;
    return LW_OK;
}

/* "50": degrees; "10m": the height of an orthographic view. */
static enum lw_status parse_frame(const char *text, float *out_fov_y, float *out_height_m,
                                  struct lw_error *err) {
    float value = 0;
    const size_t length = strlen(text);
    const bool parallel = length > 0 && text[length - 1] == 'm';
    enum lw_status status =
        parse_numbers(&text, parallel ? "height" : "field of view", 1, parallel ? 'm' : '\0', &value, err);
    if (status != LW_OK) return status;
    if (parallel && *text) return lw_status_fail(err, LW_USAGE, "height: \"%s\" is too much " FORM, text);
    if (parallel && !(value > 0)) return lw_status_fail(err, LW_USAGE, "height: must be above 0 m");
    if (!parallel && !(value >= 1.0f && value <= 179.0f))
        return lw_status_fail(err, LW_USAGE, "field of view: %g is not within 1..179 degrees", (double)value);
    *out_height_m = parallel ? value : 0;
    if (!parallel) *out_fov_y = value / 180.0f * LW_PI;
    return LW_OK;
}

enum lw_status lw_camera_parse(const char *text, struct lw_camera_view *out_view, struct lw_error *err) {
    float position[3], target[3], fov_y = LW_PI / 4, height_m = 0;
    enum lw_status status = parse_numbers(&text, "position", 3, ':', position, err);
    if (status == LW_OK) status = parse_numbers(&text, "target", 3, ':', target, err);
    if (status == LW_OK) status = parse_frame(text, &fov_y, &height_m, err);
    if (status != LW_OK) return status;
    struct lw_vec3 from = lw_vec3(position[0], position[1], position[2]);
    struct lw_vec3 to = lw_vec3(target[0], target[1], target[2]);
    if (!(lw_vec3_length(lw_vec3_sub(to, from)) > 1e-6f))
        return lw_status_fail(err, LW_USAGE, "target: is where the camera is; it must be another point");
    *out_view = lw_camera_look_at(from, to, fov_y);
    out_view->height_m = height_m;
    return LW_OK;
}

struct lw_camera_view lw_camera_of_scene(const struct lw_scene *scene, const struct lw_pose *pose,
                                         uint32_t camera) {
    const struct lw_affine *to_world = &pose->node_to_world[scene->camera[camera].node];
    struct lw_camera_view view = {.position = lw_affine_point(to_world, lw_vec3(0, 0, 0)),
                                  .forward = lw_vec3_normalize(lw_affine_vector(to_world, lw_vec3(0, 0, -1))),
                                  .fov_y = scene->camera[camera].fov_y,
                                  .height_m = scene->camera[camera].height_m};
    /* A node may be sheared or mirrored; the picture must be neither. */
    struct lw_vec3 right = lw_vec3_cross(view.forward, lw_affine_vector(to_world, lw_vec3(0, 1, 0)));
    if (!(lw_vec3_length(right) > 1e-12f)) {
        struct lw_camera_view upright =
            lw_camera_look_at(view.position, lw_vec3_add(view.position, view.forward), view.fov_y);
        upright.height_m = view.height_m;
        return upright;
    }
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

struct lw_camera_plane lw_camera_plane(const struct lw_camera_view *view, uint32_t width, uint32_t height) {
    const bool parallel = view->height_m > 0;
    const float pixel = (parallel ? view->height_m : 2.0f * tanf(0.5f * view->fov_y)) / (float)height;
    const struct lw_vec3 none = {0, 0, 0}, right = lw_vec3_scale(view->right, pixel),
                         up = lw_vec3_scale(view->up, pixel);
    return (struct lw_camera_plane){.middle = view->forward,
                                    .right = parallel ? none : right,
                                    .up = parallel ? none : up,
                                    .eye = view->position,
                                    .across = parallel ? right : none,
                                    .along = parallel ? up : none,
                                    .half_width = 0.5f * (float)width,
                                    .half_height = 0.5f * (float)height,
                                    .pixel = pixel,
                                    .parallel = parallel};
}
