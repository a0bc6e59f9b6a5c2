/* compose.h: the picture: one primary ray per pixel, albedo/pi * irradiance + emission of the surface that it
 * meets.
 * Flow:    replica (levels, tiles), trace, pose, camera -> [compose] -> linear radiance, needed tiles.
 *          direct_tile adds the direct light of the lights that the client draws.
 * Threads: one thread at a time per lw_compose; renders on several threads inside. Same inputs, same bytes,
 *          at any number of threads. */
#ifndef LW_CLIENT_VIEW_COMPOSE_COMPOSE_H
#define LW_CLIENT_VIEW_COMPOSE_COMPOSE_H

#include "client/camera/camera.h"
#include "client/lib/client.h"
#include "client/view/compose/show.h"
#include "common/light/client_lights.h"
#include "common/tile/atlas.h"
#include "common/trace/trace.h"

#define LW_COMPOSE_LAYERS_MAX 16u /* BLEND surfaces along one ray; the last one counts as opaque */

/** Sources of light. The pointers that `level` gives must stay good during a render. */
struct lw_compose_source {
    const void *context;
    struct lw_client_level (*level)(const void *context, uint32_t object, uint32_t level);
    struct lw_client_tile (*tile)(const void *context, lw_tile_id tile);
    struct lw_vec3 sky; /* W/(m^2 sr): seen by a ray that meets nothing; the scene's environment is added */
    uint32_t bounces;   /* a complete tile's */
    float target_error; /* a converged tile's */
    /* Share of a tile's error that is left in its texels. Noisy tiles are read at a coarser level. */
    float noise_shown;
};

/** The light that a client has received so far; good until its next poll. */
struct lw_compose_source lw_compose_source_of(const struct lw_client *client);

struct lw_compose_desc {
    const struct lw_scene *scene;
    const struct lw_atlas_map *map;
    const struct lw_trace *trace; /* the same scene's; at the pose of each render */
    unsigned threads;             /* 0: all */
    bool unfiltered;              /* reads noisy tiles, too, at the level that a pixel needs */
    /* Lights whose direct light is computed at the pixels, since tiles lack it (direct_tile.h). NULL: none.
     * Its arrays must outlive the composer, the struct need not. pose: the scene's, read at creation; only
     * with client-drawn lights. */
    const struct lw_client_lights *drawn;
    const struct lw_pose *pose;
};

struct lw_compose;

/** The objects that desc points to must outlive it. Errors: LW_NO_MEMORY. */
LW_MUST_CHECK enum lw_status lw_compose_create(const struct lw_compose_desc *desc,
                                               struct lw_compose **out_compose, struct lw_error *err);
void lw_compose_destroy(struct lw_compose *compose);

struct lw_compose_view {
    struct lw_camera_view camera;
    uint32_t width, height;   /* pixels */
    float offset_x, offset_y; /* where in the pixel its ray goes, from the centre; pixels */
    uint32_t sample;          /* index among the pictures that are averaged; shadow rays differ by it */
    uint32_t samples;         /* how many these are; 0: one. The more, the sharper are highlights of bumps */
    enum lw_show show;        /* LW_SHOW_ALL: the light */
    bool mirrors; /* smooth surfaces mirror the room by a ray each (mirror.h); LW_SHOW_ALL alone */
    const struct lw_vec3 *tile_colour; /* per tile, where lw_show_is_of_tiles() */
};

/* A picture that shows less error is good to look at (docs/lab/look.md). */
#define LW_COMPOSE_GOOD_ERROR 0.026f

/** Quality of the arrived light for a view. */
struct lw_compose_report {
    uint32_t tiles_needed;
    uint32_t tiles_missing;    /* needed, and not there at all, nor level 0 below a finer tile */
    uint32_t tiles_unfinished; /* there, with fewer bounces than a complete tile has */
    uint32_t tiles_noisy;      /* there, with more error than the target */
    float max_error;           /* largest of the needed tiles that are there */
    /* Relative; the mean over the pixels of what the filter leaves of their tiles' errors, weighted by the
     * tile's share of the pixel's light; 1 where the tile is missing. */
    float shown_error;
    bool complete;        /* nothing missing or unfinished */
    bool good;            /* complete, and shown_error is at most LW_COMPOSE_GOOD_ERROR; or converged */
    bool converged;       /* complete, and nothing noisy */
    uint64_t shadow_rays; /* towards client-drawn lights; by a render alone */
};

/** Renders a view.
 *
 * pose      object_to_world is read; with client-drawn lights, also the lights and the hidden objects
 * out_rgb   width * height * 3 floats, row 0 on top: W/(m^2 sr) per linear-sRGB channel, finite
 * Errors    none: where light has not arrived, coarser light stands in, then the scene's average */
void lw_compose_render(struct lw_compose *compose, const struct lw_compose_source *source,
                       const struct lw_pose *pose, const struct lw_compose_view *view, float *out_rgb,
                       struct lw_compose_report *out_report);

/** Renders listed pixels once more, with the pose and the light of the last lw_compose_render(), whose
 * pointers must still be good. The tiles that they need are added to lw_compose_needed().
 *
 * view      of that render, perhaps with another offset
 * pixel     row * width + column; neighbours next to each other are the quickest
 * out_rgb   pixel_count * 3 floats, in the order of the list */
void lw_compose_render_more(struct lw_compose *compose, const struct lw_compose_view *view,
                            const uint32_t *pixel, size_t pixel_count, float *out_rgb);

/** Finds the tiles that a view and its surroundings would need, with few rays; lw_compose_needed() stays. */
void lw_compose_survey(struct lw_compose *compose, const struct lw_compose_source *source,
                       const struct lw_pose *pose, const struct lw_compose_view *view);

/** Takes over the tiles that a picture of another renderer needed, as if it were the last render.
 *
 * needed        as of lw_compose_needed()
 * shown         for each tile: its share of a pixel's light, 256 a pixel, summed over them
 * pixel_count   of that sum */
void lw_compose_note(struct lw_compose *compose, const uint8_t *needed, const uint64_t *shown,
                     uint64_t pixel_count);

/** Reports on the tiles that the last render needed, as they are now, without a ray. */
void lw_compose_check(const struct lw_compose *compose, const struct lw_compose_source *source,
                      struct lw_compose_report *out_report);

/** One byte per tile id: whether the last render read that tile, at that level. */
const uint8_t *lw_compose_needed(const struct lw_compose *compose);
/** The same for the last survey. */
const uint8_t *lw_compose_around(const struct lw_compose *compose);

#endif
