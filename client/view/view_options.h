/* view_options.h: the command line of lightwell-view.
 * Threads: main() only. */
#ifndef LW_CLIENT_VIEW_VIEW_OPTIONS_H
#define LW_CLIENT_VIEW_VIEW_OPTIONS_H

#include "client/camera/camera.h"
#include "client/lib/access.h"
#include "client/paths/path_trace.h"
#include "client/view/compose/show.h"
#include "client/view/tonemap.h"
#include "common/base/status.h"
#include "common/open/scene_open.h"
#include "common/tile/atlas.h"

#include <stdint.h>

#define LW_VIEW_SIDE_MAX 16384u /* pixels */

enum lw_view_wait {
    LW_VIEW_WAIT_FIRST,     /* every object's coarsest light is there */
    LW_VIEW_WAIT_COMPLETE,  /* every tile that the view needs is there with all bounces */
    LW_VIEW_WAIT_GOOD,      /* and little of their error is to be seen, or it falls no more (lw_plateau) */
    LW_VIEW_WAIT_CONVERGED, /* and all of their errors are below the server's target */
    LW_VIEW_WAIT_SECONDS    /* so long after connecting, and the first light is there */
};

/* Default samples of a headless picture's pixels. */
#define LW_VIEW_SAMPLES_PER_PIXEL 16

enum lw_view_format { LW_VIEW_NO_FILE, LW_VIEW_EXR, LW_VIEW_PNG };

/* Default samples of a pixel by --path-trace. */
#define LW_VIEW_SPP           64
#define LW_VIEW_PIXEL_CHOICES "box|centre" /* in the order of enum lw_path_pixel */

#define LW_VIEW_DIRECT_CHOICES "auto|tiles"

/* Renderer. AUTO is OpenGL in a window where the system has it, and rays elsewhere. */
enum lw_view_renderer { LW_VIEW_RENDERER_AUTO, LW_VIEW_RENDERER_GL, LW_VIEW_RENDERER_CPU };
#define LW_VIEW_RENDERER_CHOICES "auto|gl|cpu" /* in the order of enum lw_view_renderer */

/* Whether smooth surfaces mirror the room where rays draw (mirror.h); auto: in pictures of --headless. */
enum lw_view_mirrors { LW_VIEW_MIRRORS_AUTO, LW_VIEW_MIRRORS_ON, LW_VIEW_MIRRORS_OFF };
#define LW_VIEW_MIRRORS_CHOICES "auto|on|off" /* in the order of enum lw_view_mirrors */

/* Guide of bounce rays of --path-trace. */
enum lw_view_guide { LW_VIEW_GUIDE_OFF, LW_VIEW_GUIDE_LEARNED };
#define LW_VIEW_GUIDE_CHOICES "off|learned" /* in the order of enum lw_view_guide */

/** Limits of --path-trace. */
struct lw_view_path {
    struct lw_scene_open open; /* open.path is the scene; NULL: no path tracing */
    uint32_t samples;          /* per pixel, at most */
    double error;              /* relative, at which to stop; 0: none */
    uint32_t bounces, seed;
    enum lw_path_pixel pixel;
    enum lw_path_part part;
    enum lw_view_guide guide;
    double time_s; /* time in the scene's animation */
};

struct lw_view_options {
    const char
        *scene; /* to light by a server of our own; NULL: there is one, at host and port. Points into argv */
    struct lw_scene_open own; /* how to open `scene`, if it is not NULL */
    char host[256];
    struct lw_access access;
    uint16_t port; /* 0 with a scene, until its server listens */
    bool headless, json;
    bool camera_given;
    struct lw_camera_view camera; /* if camera_given */
    const char *camera_name;      /* NULL: none; points into argv */
    uint32_t width, height;
    enum lw_view_wait wait;
    double wait_s;              /* for LW_VIEW_WAIT_SECONDS */
    uint32_t samples_per_pixel; /* for --headless; 1: what its centre sees */
    const char *out;            /* NULL: none; points into argv */
    enum lw_view_format format;
    enum lw_tonemap_curve curve;
    bool auto_exposure;
    float stops;      /* unless auto_exposure */
    unsigned threads; /* 0: all */
    double timeout_s;
    const char *cache_folder; /* for scene packages, or NULL; points into argv */
    enum lw_view_renderer renderer;
    bool mirrors;      /* views have mirrors (compose.h) */
    enum lw_show show; /* the part of light to show; --path-trace has the first three */
    bool draws_direct; /* the direct light of the server's client lights is drawn here */
    struct lw_view_path path;
};

/** Reads the command line. --help and --version print and set *out_done.
 * Errors: LW_USAGE naming the option and what it accepts. */
LW_MUST_CHECK enum lw_status lw_view_options_parse(int argc, char **argv, struct lw_view_options *out_options,
                                                   bool *out_done, struct lw_error *err);

/** The camera that the options name, else the scene's first, else one that shows the scene.
 * Errors: LW_USAGE for a name that the scene does not have. */
LW_MUST_CHECK enum lw_status lw_view_options_camera(const struct lw_view_options *options,
                                                    const struct lw_scene *scene, const struct lw_pose *pose,
                                                    const struct lw_trace *trace,
                                                    struct lw_camera_view *out_camera, struct lw_error *err);

#endif
