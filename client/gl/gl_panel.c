#include "client/gl/gl_panel.h"

#include "client/gl/gl_program.h"

static const char vertex[] = "uniform vec4 u_place;\n" /* left, top, right, bottom; -1 to 1 */
                             "out vec2 v_at;\n"
                             "void main() {\n"
                             "    v_at = vec2(gl_VertexID & 1, gl_VertexID >> 1);\n"
                             "    gl_Position = vec4(mix(u_place.xy, u_place.zw, v_at), 0.0, 1.0);\n"
                             "}\n";
static const char fragment[] = "uniform sampler2D u_pixels;\n"
                               "in vec2 v_at;\n"
                               "layout(location = 0) out vec4 o_colour;\n"
                               "void main() { o_colour = texture(u_pixels, v_at); }\n";

enum lw_status lw_gl_panel_init(struct lw_gl_panel *panel, struct lw_error *err) {
    *panel = (struct lw_gl_panel){0};
    enum lw_status status = lw_gl_program_create("", vertex, fragment, &panel->program, err);
    if (status != LW_OK) return status;
    panel->place = glGetUniformLocation(panel->program, "u_place");
    glGenVertexArrays(1, &panel->array);
    glGenTextures(1, &panel->texture);
    glBindTexture(GL_TEXTURE_2D, panel->texture);
    glTexParameteri(GL_TEXTURE_2D, GL_TEXTURE_MIN_FILTER, GL_NEAREST);
    glTexParameteri(GL_TEXTURE_2D, GL_TEXTURE_MAG_FILTER, GL_NEAREST);
    return LW_OK;
}

void lw_gl_panel_finish(struct lw_gl_panel *panel) {
    if (panel->program) glDeleteProgram(panel->program);
    if (panel->texture) glDeleteTextures(1, &panel->texture);
    if (panel->array) glDeleteVertexArrays(1, &panel->array);
    *panel = (struct lw_gl_panel){0};
}

void lw_gl_panel_draw(struct lw_gl_panel *panel, const uint32_t *argb, int width, int height, int x, int y,
                      int frame_width, int frame_height) {
    const float across = 2.0f / (float)frame_width, down = 2.0f / (float)frame_height;
    glActiveTexture(GL_TEXTURE0);
    glBindTexture(GL_TEXTURE_2D, panel->texture);
    glPixelStorei(GL_UNPACK_ALIGNMENT, 4);
    glTexImage2D(GL_TEXTURE_2D, 0, GL_RGBA8, width, height, 0, GL_BGRA, GL_UNSIGNED_INT_8_8_8_8_REV, argb);
    glViewport(0, 0, frame_width, frame_height);
    glUseProgram(panel->program);
    glUniform4f(panel->place, (float)x * across - 1, 1 - (float)y * down, (float)(x + width) * across - 1,
                1 - (float)(y + height) * down);
    glEnable(GL_BLEND);
    glBlendFunc(GL_SRC_ALPHA, GL_ONE_MINUS_SRC_ALPHA);
    glDisable(GL_CULL_FACE);
    glBindVertexArray(panel->array);
    glDrawArrays(GL_TRIANGLE_STRIP, 0, 4);
    glBindVertexArray(0);
    glDisable(GL_BLEND);
    glUseProgram(0);
}
