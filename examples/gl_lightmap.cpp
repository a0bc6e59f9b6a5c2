// Draws a lit scene with OpenGL 3.3, without a window, and writes a picture:
//     gl_lightmap [PORT [OUT.ppm [SECONDS]]]
// from the scene's first camera, SECONDS (default 5) after all of the first light has come. As an engine would, each
// frame it says what it draws, uploads some of what has changed, and draws. It leaves out blending and environments.
//     c++ gl_lightmap.cpp -o gl_lightmap $(pkg-config --cflags --libs lightwell epoxy egl)
#include <epoxy/egl.h>
#include <epoxy/gl.h>
#include <lightwell/lightwell.h>

#include <cmath>
#include <cstdio>
#include <cstdlib>
#include <ctime>
#include <fstream>
#include <vector>

constexpr unsigned width = 1280, height = 720;
constexpr uint64_t texels_per_frame = 256 * 1024; // uploaded at most: a megabyte
static lw_live_error err;

[[noreturn]] static void die(const char *text) {
    std::fprintf(stderr, "gl_lightmap: %s\n", text);
    std::exit(EXIT_FAILURE);
}

static void check(lw_live_status status) {
    if (status != LW_LIVE_OK) die(err.text);
}

// The structs of liblightwell begin with their size.
template <class T> T sized() {
    T t = {};
    t.struct_size = sizeof t;
    return t;
}

static const char *const vertex_source = R"(#version 330 core
layout(location = 0) in vec3 position;
layout(location = 1) in vec2 uv0; layout(location = 2) in vec2 uv1; layout(location = 3) in vec2 lightmap_uv;
layout(location = 4) in vec4 colour;
uniform mat4 view_projection; uniform mat4x3 object_to_world;
out vec2 uv[2], lightmap;
out vec4 tint;
void main() {
    uv[0] = uv0, uv[1] = uv1, lightmap = lightmap_uv, tint = colour;
    gl_Position = view_projection * vec4(object_to_world * vec4(position, 1), 1);
})";

static const char *const fragment_source = R"(#version 330 core
in vec2 uv[2], lightmap;
in vec4 tint;
uniform sampler2D base_texture, irradiance_over_pi;
uniform mat3x2 base_transform; uniform int base_set;
uniform vec4 base_colour; uniform vec3 emission; uniform float back_offset; uniform vec2 cutoff_unlit;
out vec4 pixel;
void main() {
    vec4 base = base_colour * tint * texture(base_texture, base_transform * vec3(uv[base_set], 1));
    if (base.a < cutoff_unlit.x) discard;
    vec2 at = lightmap + vec2(0, gl_FrontFacing ? 0 : back_offset);
    vec3 light = texture(irradiance_over_pi, at / vec2(textureSize(irradiance_over_pi, 0))).rgb;
    vec3 radiance = 0.25 * (base.rgb * mix(light, vec3(1), cutoff_unlit.y) + emission);
    pixel = vec4(radiance / (1 + radiance), 1); // Reinhard; the framebuffer is sRGB
})";

// The getters, one like the other.
template <class T>
static T get(lw_live_status (*getter)(const lw_live *, uint32_t, T *, lw_live_error *), const lw_live *live,
             uint32_t index) {
    T t = sized<T>();
    check(getter(live, index, &t, &err));
    return t;
}

static GLuint compile(GLenum kind, const char *source) {
    const GLuint shader = glCreateShader(kind);
    glShaderSource(shader, 1, &source, nullptr);
    glCompileShader(shader);
    return shader;
}

// A context without a window, and a framebuffer to draw into.
static void begin_gl() {
    EGLDisplay display = eglGetPlatformDisplayEXT(EGL_PLATFORM_SURFACELESS_MESA, nullptr, nullptr);
    if (!display || !eglInitialize(display, nullptr, nullptr)) die("EGL has no display without a window");
    const EGLint version[] = {EGL_CONTEXT_MAJOR_VERSION, 3, EGL_CONTEXT_MINOR_VERSION, 3, EGL_NONE};
    eglBindAPI(EGL_OPENGL_API);
    EGLContext context = eglCreateContext(display, EGL_NO_CONFIG_KHR, EGL_NO_CONTEXT, version);
    if (!context || !eglMakeCurrent(display, EGL_NO_SURFACE, EGL_NO_SURFACE, context))
        die("there is no OpenGL 3.3");
    GLuint framebuffer, buffer[2];
    glGenFramebuffers(1, &framebuffer);
    glGenRenderbuffers(2, buffer);
    glBindFramebuffer(GL_FRAMEBUFFER, framebuffer);
    for (int i = 0; i < 2; i++) {
        glBindRenderbuffer(GL_RENDERBUFFER, buffer[i]);
        glRenderbufferStorage(GL_RENDERBUFFER, i ? GL_DEPTH_COMPONENT24 : GL_SRGB8_ALPHA8, width, height);
        glFramebufferRenderbuffer(GL_FRAMEBUFFER, i ? GL_DEPTH_ATTACHMENT : GL_COLOR_ATTACHMENT0,
                                  GL_RENDERBUFFER, buffer[i]);
    }
    glViewport(0, 0, width, height);
    glEnable(GL_DEPTH_TEST);
    glEnable(GL_FRAMEBUFFER_SRGB);
    glVertexAttrib4f(4, 1, 1, 1, 1); // meshes without colours are white
}

struct Run { // of triangles of one material
    uint32_t material;
    size_t first_byte;
    GLsizei index_count;
};
struct Mesh {
    GLuint vertices = 0;
    float back_offset = 0;
    std::vector<Run> runs;
};

static Mesh upload_mesh(const lw_live_mesh &m) {
    Mesh mesh;
    for (uint32_t t = 0; t < m.triangle_count; t++) {
        if (t == 0 || m.material[t] != m.material[t - 1])
            mesh.runs.push_back({m.material[t], 3 * sizeof(uint32_t) * t, 0});
        mesh.runs.back().index_count += 3;
    }
    mesh.back_offset = float(m.back_offset);
    GLuint buffer[6];
    glGenVertexArrays(1, &mesh.vertices);
    glBindVertexArray(mesh.vertices);
    glGenBuffers(6, buffer);
    const float *const source[] = {m.position, m.uv[0], m.uv[1], m.lightmap_uv, m.colour};
    const GLint components[] = {3, 2, 2, 2, 4};
    for (GLuint a = 0; a < 5; a++) {
        if (!source[a]) continue; // then all vertices have the same: glVertexAttrib4f()
        glBindBuffer(GL_ARRAY_BUFFER, buffer[a]);
        glBufferData(GL_ARRAY_BUFFER, GLsizeiptr(sizeof(float)) * components[a] * m.vertex_count, source[a],
                     GL_STATIC_DRAW);
        glVertexAttribPointer(a, components[a], GL_FLOAT, GL_FALSE, 0, nullptr);
        glEnableVertexAttribArray(a);
    }
    glBindBuffer(GL_ELEMENT_ARRAY_BUFFER, buffer[5]);
    glBufferData(GL_ELEMENT_ARRAY_BUFFER, GLsizeiptr(12) * m.triangle_count, m.triangle, GL_STATIC_DRAW);
    return mesh;
}

static GLuint make_texture(GLint format, GLsizei w, GLsizei h, GLenum layout, GLenum type, const void *data) {
    GLuint texture;
    glGenTextures(1, &texture);
    glBindTexture(GL_TEXTURE_2D, texture);
    glTexImage2D(GL_TEXTURE_2D, 0, format, w, h, 0, layout, type, data);
    glTexParameteri(GL_TEXTURE_2D, GL_TEXTURE_MIN_FILTER, GL_LINEAR);
    return texture;
}

static GLuint upload_texture(const lw_live_texture &t) {
    const GLint wrap[] = {GL_REPEAT, GL_CLAMP_TO_EDGE, GL_MIRRORED_REPEAT};
    const GLuint texture =
        make_texture(GL_SRGB8_ALPHA8, GLsizei(t.width), GLsizei(t.height), GL_RGBA, GL_UNSIGNED_BYTE, t.rgba);
    glGenerateMipmap(GL_TEXTURE_2D);
    glTexParameteri(GL_TEXTURE_2D, GL_TEXTURE_MIN_FILTER, GL_LINEAR_MIPMAP_LINEAR);
    glTexParameteri(GL_TEXTURE_2D, GL_TEXTURE_WRAP_S, wrap[t.wrap_s]);
    glTexParameteri(GL_TEXTURE_2D, GL_TEXTURE_WRAP_T, wrap[t.wrap_t]);
    return texture;
}

// World to clip space, column by column.
static lw_live_view look_through(const lw_live_camera &c) {
    lw_live_view view = sized<lw_live_view>();
    view.width = width;
    view.height = height;
    const float near = 0.05f, up = 1 / std::tan(c.fov_y / 2), right = up * height / width;
    const float *axis[] = {c.right_ws, c.up_ws, c.forward_ws, c.forward_ws}, scale[] = {right, up, 1, 1};
    for (int row = 0; row < 4; row++) {
        float to_eye = 0;
        for (int k = 0; k < 3; k++) {
            view.view_projection[4 * k + row] = scale[row] * axis[row][k];
            to_eye -= axis[row][k] * c.position_ws[k];
        }
        view.view_projection[12 + row] = scale[row] * to_eye - (row == 2 ? 2 * near : 0); // far plane: none
    }
    return view;
}

struct Renderer {
    lw_live *live;
    lw_live_scene scene = sized<lw_live_scene>();
    GLuint program = glCreateProgram(), white = 0;
    std::vector<Mesh> meshes;
    std::vector<GLuint> textures, lightmaps; // lightmaps: per object, level 0

    explicit Renderer(lw_live *of) : live(of) {
        glAttachShader(program, compile(GL_VERTEX_SHADER, vertex_source));
        glAttachShader(program, compile(GL_FRAGMENT_SHADER, fragment_source));
        glLinkProgram(program);
        GLint is_good;
        glGetProgramiv(program, GL_LINK_STATUS, &is_good);
        if (!is_good) die("the shaders do not compile");
        glUseProgram(program);
        glUniform1i(at("irradiance_over_pi"), 1);
        const uint32_t one = UINT32_MAX;
        white = make_texture(GL_RGBA8, 1, 1, GL_RGBA, GL_UNSIGNED_BYTE, &one);
        check(lw_live_get_scene(live, &scene, &err));
        for (uint32_t i = 0; i < scene.mesh_count; i++)
            meshes.push_back(upload_mesh(get(lw_live_get_mesh, live, i)));
        for (uint32_t i = 0; i < scene.texture_count; i++)
            textures.push_back(upload_texture(get(lw_live_get_texture, live, i)));
        for (uint32_t i = 0; i < scene.object_count; i++) {
            lw_live_rect r = {};
            (void)!lw_live_get_level(live, i, 0, &r, nullptr); // an object without lightmap: 0 x 0
            lightmaps.push_back(make_texture(GL_RGB9_E5, GLsizei(r.width), GLsizei(r.height), GL_RGB,
                                             GL_UNSIGNED_INT_5_9_9_9_REV, nullptr));
        }
    }

    GLint at(const char *uniform) const { return glGetUniformLocation(program, uniform); }

    // Some of what has changed; of level 0 alone, in which coarser light stands in for what is not there yet.
    void upload_light() {
        lw_live_rect rects[64];
        const size_t count = lw_live_take_dirty(live, LW_LIVE_NONE, 0, texels_per_frame, rects, 64);
        for (size_t i = 0; i < count; i++) {
            const lw_live_rect &r = rects[i];
            std::vector<uint32_t> texels(size_t(r.width) * r.height);
            lw_live_texels to = sized<lw_live_texels>();
            to.quantity = LW_LIVE_IRRADIANCE_OVER_PI;
            to.dst = texels.data();
            to.dst_size = texels.size() * sizeof(uint32_t);
            check(lw_live_read(live, &r, &to, &err));
            glBindTexture(GL_TEXTURE_2D, lightmaps[r.object]);
            glTexSubImage2D(GL_TEXTURE_2D, 0, GLint(r.x), GLint(r.y), GLsizei(r.width), GLsizei(r.height),
                            GL_RGB, GL_UNSIGNED_INT_5_9_9_9_REV, texels.data());
        }
    }

    void draw(const lw_live_view &view) {
        check(lw_live_get_scene(live, &scene, &err));
        glClearColor(scene.sky[0] / (4 + scene.sky[0]), scene.sky[1] / (4 + scene.sky[1]),
                     scene.sky[2] / (4 + scene.sky[2]), 1);
        glClear(GL_COLOR_BUFFER_BIT | GL_DEPTH_BUFFER_BIT);
        glUniformMatrix4fv(at("view_projection"), 1, GL_FALSE, view.view_projection);
        for (uint32_t i = 0; i < scene.object_count; i++) {
            const lw_live_object object = get(lw_live_get_object, live, i);
            if (!object.is_drawn) continue;
            const Mesh &mesh = meshes[object.mesh];
            const float *m = object.object_to_world;
            const float volume = m[0] * (m[5] * m[10] - m[6] * m[9]) + m[1] * (m[6] * m[8] - m[4] * m[10]) +
                                 m[2] * (m[4] * m[9] - m[5] * m[8]);
            glFrontFace(volume < 0 ? GL_CW : GL_CCW); // it may be mirrored
            glUniformMatrix4x3fv(at("object_to_world"), 1, GL_TRUE, m);
            glUniform1f(at("back_offset"), mesh.back_offset);
            glBindVertexArray(mesh.vertices);
            for (const Run &run : mesh.runs) {
                const lw_live_material material = get(lw_live_get_material, live, run.material);
                (material.is_double_sided ? glDisable : glEnable)(GL_CULL_FACE);
                const lw_live_texture_use &base = material.base_colour_texture;
                glActiveTexture(GL_TEXTURE0);
                glBindTexture(GL_TEXTURE_2D, base.texture == LW_LIVE_NONE ? white : textures[base.texture]);
                glUniformMatrix3x2fv(at("base_transform"), 1, GL_TRUE, base.transform);
                glUniform1i(at("base_set"), GLint(base.uv_set));
                glActiveTexture(GL_TEXTURE1);
                glBindTexture(GL_TEXTURE_2D, lightmaps[i]);
                glUniform4fv(at("base_colour"), 1, material.base_colour);
                glUniform3fv(at("emission"), 1, material.emission);
                glUniform2f(at("cutoff_unlit"), material.alpha ? material.alpha_cutoff : 0, material.is_unlit);
                glDrawElements(GL_TRIANGLES, run.index_count, GL_UNSIGNED_INT, (const void *)run.first_byte);
            }
        }
    }
};

int main(int argc, char **argv) {
    lw_live_desc desc = sized<lw_live_desc>();
    desc.port = uint16_t(argc > 1 ? std::atoi(argv[1]) : 7780);
    desc.flags = LW_LIVE_THREAD | LW_LIVE_WANTS_NOTHING;
    const char *const path = argc > 2 ? argv[2] : "lightmap.ppm";
    const double wait_s = argc > 3 ? std::atof(argv[3]) : 5;
    lw_live *live;
    lw_live_stats stats = sized<lw_live_stats>();
    check(lw_live_open(&desc, &live, &err));
    while (!stats.has_light) {
        check(lw_live_poll(live, 100, &err));
        check(lw_live_get_stats(live, &stats, &err));
    }
    begin_gl();
    Renderer renderer(live);
    const std::time_t began = std::time(nullptr);
    do {
        const lw_live_view view = look_through(get(lw_live_get_camera, live, 0)); // an engine has its own
        check(lw_live_want_views(live, &view, 1, &err));
        check(lw_live_poll(live, 0, &err));
        renderer.upload_light();
        renderer.draw(view);
        glFinish(); // as a window's swap: no frame waits behind another
    } while (std::difftime(std::time(nullptr), began) < wait_s);
    std::vector<char> rgb(width * height * 3);
    glReadPixels(0, 0, width, height, GL_RGB, GL_UNSIGNED_BYTE, rgb.data());
    std::ofstream file(path, std::ios::binary);
    file << "P6\n" << width << " " << height << "\n255\n";
    for (unsigned row = height; row-- > 0;) file.write(&rgb[row * width * 3], width * 3);
    if (!file.flush()) die("cannot write the picture");
    lw_live_close(live);
}
