/* gl_program.h: shader programs from their texts, and the first error of OpenGL as a line.
 * Threads: that of the context. */
#ifndef LW_CLIENT_GL_PROGRAM_H
#define LW_CLIENT_GL_PROGRAM_H

#include "common/base/status.h"

#include <epoxy/gl.h>

/** Compiles and links. defines: lines that stand before both texts, behind "#version 330 core".
 * Errors: LW_UNAVAILABLE with the driver's first complaint, where it does not take the texts. */
LW_MUST_CHECK enum lw_status lw_gl_program_create(const char *defines, const char *vertex,
                                                  const char *fragment, GLuint *out_program,
                                                  struct lw_error *err);

/** Whether OpenGL has met an error since the last call; `what` was done when it did.
 * Errors: LW_NO_MEMORY; LW_UNAVAILABLE. */
LW_MUST_CHECK enum lw_status lw_gl_program_check(const char *what, struct lw_error *err);

#endif
