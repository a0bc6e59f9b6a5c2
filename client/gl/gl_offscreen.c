#include "client/gl/gl_offscreen.h"

#include <epoxy/egl.h>
#include <stdlib.h>

struct lw_gl_offscreen {
    EGLDisplay display;
    EGLContext context;
    EGLSurface surface; /* EGL_NO_SURFACE where contexts need none */
};

/* A display of its own, that no window system has: the program may run beside one or without any. */
static EGLDisplay open_display(void) {
    if (epoxy_has_egl_extension(EGL_NO_DISPLAY, "EGL_MESA_platform_surfaceless") &&
        epoxy_has_egl_extension(EGL_NO_DISPLAY, "EGL_EXT_platform_base"))
        return eglGetPlatformDisplayEXT(EGL_PLATFORM_SURFACELESS_MESA, EGL_DEFAULT_DISPLAY, NULL);
    return eglGetDisplay(EGL_DEFAULT_DISPLAY);
}

static enum lw_status make_current(struct lw_gl_offscreen *o, struct lw_error *err) {
    static const EGLint wanted[] = {EGL_SURFACE_TYPE, EGL_PBUFFER_BIT, EGL_RENDERABLE_TYPE, EGL_OPENGL_BIT,
                                    EGL_NONE};
    static const EGLint version[] = {EGL_CONTEXT_MAJOR_VERSION,
                                     3,
                                     EGL_CONTEXT_MINOR_VERSION,
                                     3,
                                     EGL_CONTEXT_OPENGL_PROFILE_MASK,
                                     EGL_CONTEXT_OPENGL_CORE_PROFILE_BIT,
                                     EGL_NONE};
    EGLConfig config;
    EGLint count = 0;
    if (!eglBindAPI(EGL_OPENGL_API) || !eglChooseConfig(o->display, wanted, &config, 1, &count) || count == 0)
        return lw_status_fail(err, LW_UNAVAILABLE, "EGL has no OpenGL here (error 0x%x)",
                              (unsigned)eglGetError());
    o->context = eglCreateContext(o->display, config, EGL_NO_CONTEXT, version);
    if (o->context == EGL_NO_CONTEXT)
        return lw_status_fail(err, LW_UNAVAILABLE, "there is no OpenGL 3.3 here (EGL error 0x%x)",
                              (unsigned)eglGetError());
    if (!epoxy_has_egl_extension(o->display, "EGL_KHR_surfaceless_context")) {
        static const EGLint size[] = {EGL_WIDTH, 1, EGL_HEIGHT, 1, EGL_NONE};
        o->surface = eglCreatePbufferSurface(o->display, config, size);
    }
    if (!eglMakeCurrent(o->display, o->surface, o->surface, o->context))
        return lw_status_fail(err, LW_UNAVAILABLE, "the OpenGL context cannot be used (EGL error 0x%x)",
                              (unsigned)eglGetError());
    return LW_OK;
}

enum lw_status lw_gl_offscreen_create(struct lw_gl_offscreen **out_offscreen, struct lw_error *err) {
    struct lw_gl_offscreen *o = calloc(1, sizeof *o);
    if (o == NULL) return lw_status_fail(err, LW_NO_MEMORY, "no memory for an OpenGL context");
    o->display = open_display();
    o->context = EGL_NO_CONTEXT;
    o->surface = EGL_NO_SURFACE;
    EGLint major, minor;
    enum lw_status status = LW_OK;
    if (o->display == EGL_NO_DISPLAY || !eglInitialize(o->display, &major, &minor)) {
        o->display = EGL_NO_DISPLAY;
        status = lw_status_fail(err, LW_UNAVAILABLE, "there is no EGL display (error 0x%x)",
                                (unsigned)eglGetError());
    }
    if (status == LW_OK) status = make_current(o, err);
    if (status != LW_OK) {
        lw_gl_offscreen_destroy(o);
        return status;
    }
    *out_offscreen = o;
    return LW_OK;
}

void lw_gl_offscreen_destroy(struct lw_gl_offscreen *o) {
    if (o == NULL) return;
    if (o->display != EGL_NO_DISPLAY) {
        eglMakeCurrent(o->display, EGL_NO_SURFACE, EGL_NO_SURFACE, EGL_NO_CONTEXT);
        if (o->surface != EGL_NO_SURFACE) eglDestroySurface(o->display, o->surface);
        if (o->context != EGL_NO_CONTEXT) eglDestroyContext(o->display, o->context);
        eglTerminate(o->display);
    }
    free(o);
}
