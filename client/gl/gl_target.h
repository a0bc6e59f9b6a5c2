/* gl_target.h: what a picture is drawn into: a texture, a depth buffer, and for MSAA a second pair.
 * Threads: that of the context. */
#ifndef LW_CLIENT_GL_TARGET_H
#define LW_CLIENT_GL_TARGET_H

#include "common/base/status.h"

#include <epoxy/gl.h>

struct lw_gl_target {
    GLenum format; /* the texture's */
    uint32_t width, height;
    unsigned samples;                         /* 1: no MSAA */
    GLuint texture, frame;                    /* to read from */
    GLuint colour_buffer, depth_buffer, many; /* with MSAA, `many` is drawn to */
};

/** Makes it so large, if it is not. A zeroed one with a format is fine.
 * Errors: LW_NO_MEMORY; LW_UNAVAILABLE for what the GPU does not take. */
LW_MUST_CHECK enum lw_status lw_gl_target_resize(struct lw_gl_target *target, uint32_t width, uint32_t height,
                                                 unsigned samples, struct lw_error *err);
void lw_gl_target_finish(struct lw_gl_target *target);

/** Binds it for drawing, its whole as the viewport. */
void lw_gl_target_bind(const struct lw_gl_target *target);
/** Averages the samples into the texture. */
void lw_gl_target_resolve(const struct lw_gl_target *target);

#endif
