/* gl_texture.h: textures as the renderer makes them.
 * Threads: that of the context. */
#ifndef LW_CLIENT_GL_TEXTURE_H
#define LW_CLIENT_GL_TEXTURE_H

#include <epoxy/gl.h>
#include <stddef.h>

/** Makes a texture that holds a table of texels, unfiltered: a GL_TEXTURE_BUFFER over a buffer of its own.
 * Both are bound. OpenGL's errors wait for lw_gl_program_check().
 * format      of a texel: GL_R32UI, GL_RGBA32F, ...
 * size_bytes  of the table
 * data        that many bytes, which do not change; NULL: texels are written later, often */
void lw_gl_texture_table(GLenum format, size_t size_bytes, const void *data, GLuint *out_buffer,
                         GLuint *out_texture);

/** Makes a texture without texels that is filtered bilinearly and clamped at its edges. It is bound to
 * `kind`, GL_TEXTURE_2D or GL_TEXTURE_2D_ARRAY; the caller gives it texels. */
void lw_gl_texture_smooth(GLenum kind, GLuint *out_texture);

/** Formats of texels in a texture, and as they are uploaded. */
struct lw_gl_texels {
    GLint kept;
    GLenum format, type;
};
static const struct lw_gl_texels lw_gl_texels_light = {GL_RGB9_E5, GL_RGB, GL_UNSIGNED_INT_5_9_9_9_REV};
static const struct lw_gl_texels lw_gl_texels_directions = {GL_RGB10_A2, GL_RGBA,
                                                            GL_UNSIGNED_INT_2_10_10_10_REV};

#endif
