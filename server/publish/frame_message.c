#include "server/publish/frame_message.h"

#include "common/base/invariant.h"

#include <stdlib.h>
#include <string.h>

/* The pose in a frame message: all of it, or the changes since the previous frame. */
struct pose_change {
    struct lw_message_transform *transform;
    struct lw_message_light *light;
    struct lw_message_material *material;
    uint32_t *hidden, *shown; /* objects; hidden spares come first */
    size_t transform_count, light_count, material_count, hidden_count, spare_count, shown_count;
};

static void list_state(const struct lw_scene *scene, const struct lw_pose *pose, const struct lw_pose *since,
                       struct pose_change *change) {
    change->hidden_count = change->spare_count = change->shown_count = change->material_count = 0;
    for (uint32_t o = 0; o < scene->object_count; o++)
        if (pose->object_spare[o] && (!since || !since->object_spare[o]))
            change->hidden[change->spare_count++] = o;
    change->hidden_count = change->spare_count;
    for (uint32_t o = 0; o < scene->object_count; o++) {
        if (since && pose->object_hidden[o] == since->object_hidden[o] &&
            pose->object_spare[o] == since->object_spare[o])
            continue;
        if (!pose->object_hidden[o])
            change->shown[change->shown_count++] = o;
        else if (!pose->object_spare[o])
            change->hidden[change->hidden_count++] = o;
    }
    LW_INVARIANT(change->spare_count <= change->hidden_count);
    LW_INVARIANT(change->hidden_count + change->shown_count <= scene->object_count); /* each once */
    for (uint32_t m = 0; m < scene->material_count; m++) {
        const struct lw_material_state *now = &pose->material[m];
        if (since && !memcmp(now, &since->material[m], sizeof *now)) continue;
        struct lw_message_material *material = &change->material[change->material_count++];
        material->material = m;
        memcpy(material->base_colour, now->base_colour, sizeof now->base_colour);
        memcpy(material->emission, now->emission, sizeof now->emission);
    }
}

static void list_change(const struct lw_scene *scene, const struct lw_pose *pose, const struct lw_pose *since,
                        struct pose_change *change) {
    change->transform_count = change->light_count = 0;
    for (uint32_t o = 0; o < scene->object_count; o++)
        if (!since || memcmp(&pose->object_to_world[o], &since->object_to_world[o], sizeof(struct lw_affine)))
            change->transform[change->transform_count++] =
                (struct lw_message_transform){.object = o, .object_to_world = pose->object_to_world[o]};
    for (uint32_t l = 0; l < scene->light_count; l++)
        if (!since || memcmp(&pose->light[l], &since->light[l], sizeof pose->light[l]))
            change->light[change->light_count++] =
                (struct lw_message_light){.light = l,
                                          .position_ws = pose->light[l].position_ws,
                                          .direction_ws = pose->light[l].direction_ws,
                                          .intensity = pose->light[l].intensity};
}

static size_t smaller(size_t a, size_t b) { return a < b ? a : b; }

/* The part of a change that message number `part` carries; a frame with more than one message holds
 * several. */
static struct lw_message frame_part(const struct lw_message_frame *frame, const struct pose_change *change,
                                    size_t part) {
    struct lw_message message = {.type = LW_MESSAGE_FRAME, .frame = *frame};
    size_t transforms = smaller(part * LW_MESSAGE_TRANSFORMS_MAX, change->transform_count);
    size_t lights = smaller(part * LW_MESSAGE_LIGHTS_MAX, change->light_count);
    message.frame.transform = change->transform + transforms;
    message.frame.transform_count = smaller(change->transform_count - transforms, LW_MESSAGE_TRANSFORMS_MAX);
    message.frame.light = change->light + lights;
    message.frame.light_count = smaller(change->light_count - lights, LW_MESSAGE_LIGHTS_MAX);
    size_t materials = smaller(part * LW_MESSAGE_MATERIALS_MAX, change->material_count);
    size_t hidden = smaller(part * LW_MESSAGE_VISIBLE_MAX, change->hidden_count);
    size_t shown = smaller(part * LW_MESSAGE_VISIBLE_MAX, change->shown_count);
    message.frame.material = change->material + materials;
    message.frame.material_count = smaller(change->material_count - materials, LW_MESSAGE_MATERIALS_MAX);
    message.frame.hidden = change->hidden + hidden;
    message.frame.hidden_count = smaller(change->hidden_count - hidden, LW_MESSAGE_VISIBLE_MAX);
    message.frame.spare_count =
        hidden < change->spare_count ? smaller(change->spare_count - hidden, LW_MESSAGE_VISIBLE_MAX) : 0;
    message.frame.shown = change->shown + shown;
    message.frame.shown_count = smaller(change->shown_count - shown, LW_MESSAGE_VISIBLE_MAX);
    return message;
}

static enum lw_status encode_change(const struct lw_message_frame *frame, const struct pose_change *change,
                                    struct lw_blob **out_blob) {
    size_t parts = 1, size = 0;
    while (parts * LW_MESSAGE_TRANSFORMS_MAX < change->transform_count ||
           parts * LW_MESSAGE_LIGHTS_MAX < change->light_count ||
           parts * LW_MESSAGE_MATERIALS_MAX < change->material_count ||
           parts * LW_MESSAGE_VISIBLE_MAX < change->hidden_count ||
           parts * LW_MESSAGE_VISIBLE_MAX < change->shown_count)
        parts++;
    for (size_t i = 0; i < parts; i++) {
        struct lw_message message = frame_part(frame, change, i);
        size += lw_message_size(&message);
    }
    struct lw_blob *blob;
    enum lw_status status = lw_blob_create(size, &blob);
    if (status != LW_OK) return status;
    size_t at = 0;
    for (size_t i = 0; i < parts; i++) {
        struct lw_message message = frame_part(frame, change, i);
        size_t written;
        status = lw_message_encode(&message, blob->bytes + at, size - at, &written);
        if (status != LW_OK) {
            lw_blob_unref(blob);
            return status;
        }
        at += written;
    }
    LW_INVARIANT(at == size);
    *out_blob = blob;
    return LW_OK;
}

enum lw_status lw_frame_message_encode(const struct lw_scene *scene, const struct lw_pose *pose,
                                       const struct lw_pose *since, const struct lw_message_frame *header,
                                       struct lw_blob **out_blob) {
    struct pose_change change = {0};
    change.transform = calloc((size_t)scene->object_count + 1, sizeof *change.transform);
    change.light = calloc((size_t)scene->light_count + 1, sizeof *change.light);
    change.material = calloc((size_t)scene->material_count + 1, sizeof *change.material);
    change.hidden = calloc((size_t)scene->object_count + 1, sizeof *change.hidden);
    change.shown = calloc((size_t)scene->object_count + 1, sizeof *change.shown);
    enum lw_status status = LW_NO_MEMORY;
    if (change.transform && change.light && change.material && change.hidden && change.shown) {
        list_change(scene, pose, since, &change);
        list_state(scene, pose, since, &change);
        status = encode_change(header, &change, out_blob);
    }
    free(change.shown);
    free(change.hidden);
    free(change.material);
    free(change.light);
    free(change.transform);
    return status;
}
