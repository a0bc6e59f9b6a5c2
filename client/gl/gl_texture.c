#include "client/gl/gl_texture.h"

void lw_gl_texture_table(GLenum format, size_t size_bytes, const void *data, GLuint *out_buffer,
                         GLuint *out_texture) {
    glGenBuffers(1, out_buffer);
    glBindBuffer(GL_TEXTURE_BUFFER, *out_buffer);
    glBufferData(GL_TEXTURE_BUFFER, (GLsizeiptr)size_bytes, data, data ? GL_STATIC_DRAW : GL_DYNAMIC_DRAW);
    glGenTextures(1, out_texture);
    glBindTexture(GL_TEXTURE_BUFFER, *out_texture);
    glTexBuffer(GL_TEXTURE_BUFFER, format, *out_buffer);
}

void lw_gl_texture_smooth(GLenum kind, GLuint *out_texture) {
    glGenTextures(1, out_texture);
    glBindTexture(kind, *out_texture);
    glTexParameteri(kind, GL_TEXTURE_MIN_FILTER, GL_LINEAR);
    glTexParameteri(kind, GL_TEXTURE_MAG_FILTER, GL_LINEAR);
    glTexParameteri(kind, GL_TEXTURE_WRAP_S, GL_CLAMP_TO_EDGE);
    glTexParameteri(kind, GL_TEXTURE_WRAP_T, GL_CLAMP_TO_EDGE);
}
