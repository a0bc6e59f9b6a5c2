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

#endif
