#include "client/gl/gl_program.h"

#include <string.h>

#define COMPLAINT 400 /* characters of a driver's log that are reported */

static enum lw_status fail(const char *what, char *log, struct lw_error *err) {
    log[strcspn(log, "\n")] = '\0';
    return lw_status_fail(err, LW_UNAVAILABLE, "the OpenGL driver does not take a %s: %.200s", what, log);
}

static enum lw_status compile(GLenum kind, const char *defines, const char *text, GLuint *out,
                              struct lw_error *err) {
    const char *part[] = {"#version 330 core\n", defines, text};
    char log[COMPLAINT] = "";
    GLint good = 0;
    const GLuint shader = glCreateShader(kind);
    glShaderSource(shader, 3, part, NULL);
    glCompileShader(shader);
    glGetShaderiv(shader, GL_COMPILE_STATUS, &good);
    if (!good) {
        glGetShaderInfoLog(shader, sizeof log, NULL, log);
        glDeleteShader(shader);
        return fail(kind == GL_VERTEX_SHADER ? "vertex shader" : "fragment shader", log, err);
    }
    *out = shader;
    return LW_OK;
}

enum lw_status lw_gl_program_create(const char *defines, const char *vertex, const char *fragment,
                                    GLuint *out_program, struct lw_error *err) {
    GLuint v = 0, f = 0;
    enum lw_status status = compile(GL_VERTEX_SHADER, defines, vertex, &v, err);
    if (status == LW_OK) status = compile(GL_FRAGMENT_SHADER, defines, fragment, &f, err);
    if (status != LW_OK) {
        glDeleteShader(v);
        return status;
    }
    const GLuint program = glCreateProgram();
    char log[COMPLAINT] = "";
    GLint good = 0;
    glAttachShader(program, v);
    glAttachShader(program, f);
    glLinkProgram(program);
    glDeleteShader(v);
    glDeleteShader(f);
    glGetProgramiv(program, GL_LINK_STATUS, &good);
    if (!good) {
        glGetProgramInfoLog(program, sizeof log, NULL, log);
        glDeleteProgram(program);
        return fail("shader program", log, err);
    }
    *out_program = program;
    return LW_OK;
}

enum lw_status lw_gl_program_check(const char *what, struct lw_error *err) {
    const GLenum first = glGetError();
    if (first == GL_NO_ERROR) return LW_OK;
    for (int i = 0; i < 16 && glGetError() != GL_NO_ERROR; i++) {
    } /* a lost context gives errors for ever */
    if (first == GL_OUT_OF_MEMORY)
        return lw_status_fail(err, LW_NO_MEMORY, "the GPU has no memory for %s; --renderer cpu needs none",
                              what);
    return lw_status_fail(err, LW_UNAVAILABLE,
                          "OpenGL failed at %s (error 0x%x); --renderer cpu does without", what, first);
}
