/* frame_message.h: where everything is in a frame, as FRAME messages.
 * Flow:    pose -> [frame message] -> blob -> snapshot
 * Threads: pure function, [any]. */
#ifndef LW_PUBLISH_FRAME_MESSAGE_H
#define LW_PUBLISH_FRAME_MESSAGE_H

#include "common/scene/pose.h"
#include "server/publish/snapshot.h"

/** Encodes a frame: one message, or several where a list is longer than a message holds.
 * since    the pose that the receiver has; only what differs is listed. NULL: everything is
 * header   the numbers of the frame; its lists mean nothing
 * Errors: LW_NO_MEMORY. */
LW_MUST_CHECK enum lw_status lw_frame_message_encode(const struct lw_scene *scene, const struct lw_pose *pose,
                                                     const struct lw_pose *since,
                                                     const struct lw_message_frame *header,
                                                     struct lw_blob **out_blob);

#endif
