#include "client/gl/gl_target.h"

#include "client/gl/gl_program.h"

static GLuint make_buffer(GLenum format, const struct lw_gl_target *t) {
    GLuint buffer;
    glGenRenderbuffers(1, &buffer);
    glBindRenderbuffer(GL_RENDERBUFFER, buffer);
    if (t->samples > 1)
        glRenderbufferStorageMultisample(GL_RENDERBUFFER, (GLsizei)t->samples, format, (GLsizei)t->width,
                                         (GLsizei)t->height);
    else
        glRenderbufferStorage(GL_RENDERBUFFER, format, (GLsizei)t->width, (GLsizei)t->height);
    return buffer;
}

static void make_texture(struct lw_gl_target *t) {
    glGenTextures(1, &t->texture);
    glBindTexture(GL_TEXTURE_2D, t->texture);
    const bool whole = t->format == GL_RG32UI;
    glTexImage2D(GL_TEXTURE_2D, 0, (GLint)t->format, (GLsizei)t->width, (GLsizei)t->height, 0,
                 whole ? GL_RG_INTEGER : GL_RGBA, whole ? GL_UNSIGNED_INT : GL_FLOAT, NULL);
    glTexParameteri(GL_TEXTURE_2D, GL_TEXTURE_MIN_FILTER, whole ? GL_NEAREST : GL_LINEAR);
    glTexParameteri(GL_TEXTURE_2D, GL_TEXTURE_MAG_FILTER, whole ? GL_NEAREST : GL_LINEAR);
    glTexParameteri(GL_TEXTURE_2D, GL_TEXTURE_WRAP_S, GL_CLAMP_TO_EDGE);
    glTexParameteri(GL_TEXTURE_2D, GL_TEXTURE_WRAP_T, GL_CLAMP_TO_EDGE);
}

static void attach(struct lw_gl_target *t) {
    glGenFramebuffers(1, &t->frame);
    glBindFramebuffer(GL_FRAMEBUFFER, t->frame);
    glFramebufferTexture2D(GL_FRAMEBUFFER, GL_COLOR_ATTACHMENT0, GL_TEXTURE_2D, t->texture, 0);
    t->depth_buffer = make_buffer(GL_DEPTH_COMPONENT32F, t);
    if (t->samples > 1) {
        t->colour_buffer = make_buffer(t->format, t);
        glGenFramebuffers(1, &t->many);
        glBindFramebuffer(GL_FRAMEBUFFER, t->many);
        glFramebufferRenderbuffer(GL_FRAMEBUFFER, GL_COLOR_ATTACHMENT0, GL_RENDERBUFFER, t->colour_buffer);
    }
    glFramebufferRenderbuffer(GL_FRAMEBUFFER, GL_DEPTH_ATTACHMENT, GL_RENDERBUFFER, t->depth_buffer);
}

enum lw_status lw_gl_target_resize(struct lw_gl_target *t, uint32_t width, uint32_t height, unsigned samples,
                                   struct lw_error *err) {
    GLint side_max = 0, samples_max = 1;
    glGetIntegerv(GL_MAX_RENDERBUFFER_SIZE, &side_max);
    glGetIntegerv(GL_MAX_SAMPLES, &samples_max);
    if (samples > (unsigned)samples_max) samples = samples_max > 0 ? (unsigned)samples_max : 1;
    if (t->texture && t->width == width && t->height == height && t->samples == samples) return LW_OK;
    lw_gl_target_finish(t);
    if (width == 0 || height == 0 || width > (uint32_t)side_max || height > (uint32_t)side_max)
        return lw_status_fail(err, LW_UNAVAILABLE,
                              "a picture of %ux%u pixels: the GPU draws from 1 to %d a side; --renderer cpu "
                              "has no such limit",
                              width, height, side_max);
    t->width = width, t->height = height, t->samples = samples;
    make_texture(t);
    attach(t);
    const GLenum state = glCheckFramebufferStatus(GL_FRAMEBUFFER);
    enum lw_status status = lw_gl_program_check("the picture", err);
    if (status == LW_OK && state != GL_FRAMEBUFFER_COMPLETE)
        status = lw_status_fail(err, LW_UNAVAILABLE, "the GPU does not draw into pictures of %ux%u (0x%x)",
                                width, height, state);
    if (status != LW_OK) lw_gl_target_finish(t);
    return status;
}

void lw_gl_target_finish(struct lw_gl_target *t) {
    if (t->many) glDeleteFramebuffers(1, &t->many);
    if (t->frame) glDeleteFramebuffers(1, &t->frame);
    if (t->colour_buffer) glDeleteRenderbuffers(1, &t->colour_buffer);
    if (t->depth_buffer) glDeleteRenderbuffers(1, &t->depth_buffer);
    if (t->texture) glDeleteTextures(1, &t->texture);
    *t = (struct lw_gl_target){.format = t->format};
}

void lw_gl_target_bind(const struct lw_gl_target *t) {
    glBindFramebuffer(GL_FRAMEBUFFER, t->samples > 1 ? t->many : t->frame);
    glViewport(0, 0, (GLsizei)t->width, (GLsizei)t->height);
}

void lw_gl_target_resolve(const struct lw_gl_target *t) {
    if (t->samples <= 1) return;
    const GLint width = (GLint)t->width, height = (GLint)t->height;
    glBindFramebuffer(GL_READ_FRAMEBUFFER, t->many);
    glBindFramebuffer(GL_DRAW_FRAMEBUFFER, t->frame);
    glBlitFramebuffer(0, 0, width, height, 0, 0, width, height, GL_COLOR_BUFFER_BIT, GL_NEAREST);
}
