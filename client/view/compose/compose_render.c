#include "client/view/compose/compose_render.h"

#include "client/view/compose/compose_hits.h"
#include "common/base/colour.h"

#include <omp.h>

#define SCREEN_TILE 32u   /* pixels; the unit that a thread takes */
#define LISTED      1024u /* the same, of pixels in a list */
#define BLOCK       4u    /* pixels; one packet is BLOCK x BLOCK */

_Static_assert(BLOCK *BLOCK == LW_TRACE_WIDTH, "a packet is one block of pixels");
_Static_assert(SCREEN_TILE == BLOCK * LW_DIRECT_TILE_SIDE, "direct light is worked out for one screen tile");
_Static_assert(LISTED == LW_DIRECT_TILE_BLOCKS * LW_TRACE_WIDTH, "or for as many pixels of a list");

/* A packet whose rays have met nothing yet. */
static void begin_rays(struct lw_compose_packet *p) {
    lw_compose_fill(0, p->rays.t_near);
    lw_compose_fill(INFINITY, p->rays.t_far);
    lw_compose_fill(1, p->transmittance);
    lw_compose_fill(0, p->reflected);
}

/* The ray through each pixel of a block, of lw_camera_origin() and lw_camera_direction(), an axis at a
 * time. */
static void aim_axis(float middle, float right, float up, const float across[16], const float upward[16],
                     float out[16]) {
    for (unsigned i = 0; i < LW_TRACE_WIDTH; i++) out[i] = middle + right * across[i] + up * upward[i];
}

static void aim(struct lw_compose_packet *p, const struct lw_compose_view *view,
                const struct lw_camera_plane *plane, const struct lw_compose_pixels *at) {
    float across[LW_TRACE_WIDTH], upward[LW_TRACE_WIDTH];
    const struct lw_vec3 eye = plane->eye, across_m = plane->across, along_m = plane->along,
                         middle = plane->middle, right = plane->right, up = plane->up;
    for (unsigned i = 0; i < LW_TRACE_WIDTH; i++) {
        across[i] = (float)(int32_t)at->x[i] + 0.5f + view->offset_x - plane->half_width;
        upward[i] = plane->half_height - ((float)(int32_t)at->y[i] + 0.5f + view->offset_y);
    }
    aim_axis(middle.x, right.x, up.x, across, upward, p->rays.dir_x);
    aim_axis(middle.y, right.y, up.y, across, upward, p->rays.dir_y);
    aim_axis(middle.z, right.z, up.z, across, upward, p->rays.dir_z);
    aim_axis(eye.x, across_m.x, along_m.x, across, upward, p->rays.org_x);
    aim_axis(eye.y, across_m.y, along_m.y, across, upward, p->rays.org_y);
    aim_axis(eye.z, across_m.z, along_m.z, across, upward, p->rays.org_z);
    begin_rays(p);
    p->rays.salt = 0;
    p->plane = plane;
    p->listed = at->listed;
    p->mirrored.lanes = 0;
    p->is_mirrored = false;
    for (unsigned i = 0; i < LW_TRACE_WIDTH; i++) p->radiance[i] = lw_vec3(0, 0, 0);
    for (unsigned i = 0; i < LW_TRACE_WIDTH; i++) p->tint[i] = lw_vec3(1, 1, 1);
}

/* Adds what each pixel shows of a tile's light; neighbours mostly show the same one. */
static void note_shown(struct lw_compose *compose, const struct lw_compose_packet *p, uint16_t active) {
    uint64_t sum = 0;
    uint32_t tile = 0;
    for (unsigned i = 0; i < LW_TRACE_WIDTH; i++) {
        if (!(active >> i & 1u) || !(p->reflected[i] > 0)) continue;
        const float all = lw_colour_luminance(p->radiance[i]);
        const uint64_t light =
            (uint64_t)((float)LW_COMPOSE_PIXEL_LIGHT * fminf(1, p->reflected[i] / all) + 0.5f);
        if (p->tile[i] != tile && sum > 0) {
            __atomic_fetch_add(&compose->shown[tile], sum, __ATOMIC_RELAXED);
            sum = 0;
        }
        tile = p->tile[i];
        sum += light;
    }
    if (sum > 0) __atomic_fetch_add(&compose->shown[tile], sum, __ATOMIC_RELAXED);
}

/* The packet of the rays that another one mirrors. */
static void aim_mirrored(const struct lw_compose_packet *p, struct lw_compose_packet *out) {
    const struct lw_compose_mirrored *m = &p->mirrored;
    begin_rays(out);
    out->rays.salt = 1;
    out->plane = p->plane;
    out->listed = out->is_mirrored = true;
    out->mirrored = *m;
    for (unsigned i = 0; i < LW_TRACE_WIDTH; i++) {
        const bool goes = m->lanes >> i & 1u;
        const struct lw_vec3 from = goes ? m->origin[i] : lw_vec3(0, 0, 0),
                             to = goes ? m->direction[i] : lw_vec3(0, 0, 1);
        out->rays.org_x[i] = from.x, out->rays.org_y[i] = from.y, out->rays.org_z[i] = from.z;
        out->rays.dir_x[i] = to.x, out->rays.dir_y[i] = to.y, out->rays.dir_z[i] = to.z;
        out->radiance[i] = lw_vec3(0, 0, 0);
        out->tint[i] = goes ? m->tint[i] : lw_vec3(0, 0, 0);
    }
}

static void add_mirrored(struct lw_compose_packet *p, const struct lw_compose_packet *second) {
    for (uint32_t left = p->mirrored.lanes; left; left &= left - 1) {
        const unsigned i = (unsigned)__builtin_ctz(left);
        p->radiance[i] = lw_vec3_add(p->radiance[i], second->radiance[i]);
    }
}

static void render_layers(struct lw_compose *compose, uint16_t going, struct lw_compose_patches *patches,
                          struct lw_compose_packet *p) {
    struct lw_compose_look look[LW_TRACE_WIDTH];
    struct lw_hit16 hits;
    struct lw_compose_finished finished;
    for (unsigned layer = 1; going && layer <= LW_COMPOSE_LAYERS_MAX; layer++)
        going = lw_compose_hits_meet(compose, p, going, layer == LW_COMPOSE_LAYERS_MAX, patches, look, &hits,
                                     &finished);
}

/* All that a packet sees, of light that tiles hold. */
static void render_packet(struct lw_compose *compose, const struct lw_compose_view *view,
                          const struct lw_camera_plane *plane, const struct lw_compose_pixels *at,
                          struct lw_compose_patches *patches, struct lw_compose_packet *p) {
    struct lw_compose_packet second;
    aim(p, view, plane, at);
    render_layers(compose, at->active, patches, p);
    if (!p->mirrored.lanes) return;
    aim_mirrored(p, &second);
    render_layers(compose, p->mirrored.lanes, patches, &second);
    add_mirrored(p, &second);
}

static void place_block(const struct lw_compose_view *view, uint32_t x, uint32_t y,
                        struct lw_compose_pixels *out) {
    out->active = 0;
    out->listed = false;
    for (unsigned i = 0; i < LW_TRACE_WIDTH; i++) {
        out->x[i] = x + i % BLOCK, out->y[i] = y + i / BLOCK;
        if (out->x[i] < view->width && out->y[i] < view->height) out->active |= (uint16_t)(1u << i);
    }
}

/* Puts a packet into the picture. */
static void write_packet(struct lw_compose *compose, const struct lw_compose_view *view,
                         const struct lw_compose_packet *p, const struct lw_compose_pixels *at,
                         float *out_rgb) {
    if (!compose->surveys) note_shown(compose, p, at->active);
    for (unsigned i = 0; i < LW_TRACE_WIDTH; i++) {
        if (!(at->active >> i & 1u)) continue;
        float *pixel = out_rgb + 3 * ((size_t)at->y[i] * view->width + at->x[i]);
        pixel[0] = p->radiance[i].x, pixel[1] = p->radiance[i].y, pixel[2] = p->radiance[i].z;
    }
}

static void render_block(struct lw_compose *compose, const struct lw_compose_view *view,
                         const struct lw_camera_plane *plane, uint32_t x, uint32_t y,
                         struct lw_compose_patches *patches, float *out_rgb) {
    struct lw_compose_packet p;
    struct lw_compose_pixels at;
    place_block(view, x, y, &at);
    render_packet(compose, view, plane, &at, patches, &p);
    write_packet(compose, view, &p, &at, out_rgb);
}

static bool is_any(struct lw_vec3 v) { return v.x + v.y + v.z > 0; }

static void note_points(const struct lw_compose *compose, const struct lw_compose_packet *p, uint16_t going,
                        const struct lw_compose_look look[LW_TRACE_WIDTH], const struct lw_hit16 *hits,
                        const struct lw_compose_finished *f, struct lw_direct_block *out) {
    struct lw_points16 *at = &out->points;
    for (unsigned i = 0; i < LW_TRACE_WIDTH; i++) {
        if (!(going >> i & 1u) || !look[i].patch) continue;
        const bool finished = f->lanes >> i & 1u;
        if (!is_any(p->reflects[i]) && !(finished && is_any(p->mirrors[i]))) continue;
        const struct lw_place_point point =
            finished ? f->point[i] : lw_compose_look_point(compose, &look[i], hits, i);
        at->x[i] = point.origin.x, at->y[i] = point.origin.y, at->z[i] = point.origin.z;
        at->nx[i] = point.normal.x, at->ny[i] = point.normal.y, at->nz[i] = point.normal.z;
        out->base[i] = p->base[i];
        out->active |= (uint16_t)(1u << i);
    }
    out->finished = f->lanes & out->active;
    if (out->finished) out->seen = f->seen;
}

static void add_direct(struct lw_compose_packet *p, const struct lw_direct_block *block) {
    for (unsigned i = 0; i < LW_TRACE_WIDTH; i++) {
        if (!(block->active >> i & 1u)) continue;
        const struct lw_vec3 e = lw_compose_lane(block->e, i);
        p->radiance[i] = lw_vec3_add(p->radiance[i], lw_vec3_mul(p->reflects[i], e));
        if (!(block->finished >> i & 1u)) continue;
        const struct lw_vec3 mirrored = lw_compose_lane(block->mirrored, i);
        p->radiance[i] = lw_vec3_add(p->radiance[i], lw_vec3_mul(p->mirrors[i], mirrored));
    }
}

/* Packets with direct light, layer by layer. w->going: the rays of each that go */
static void light_layers(struct lw_compose *compose, struct lw_compose_patches *patches,
                         struct lw_compose_worker *w, struct lw_compose_packet *packet) {
    struct lw_compose_look look[LW_TRACE_WIDTH];
    struct lw_compose_finished finished;
    bool any = true;
    for (unsigned layer = 1; any && layer <= LW_COMPOSE_LAYERS_MAX; layer++) {
        any = false;
        for (uint32_t b = 0; b < LW_DIRECT_TILE_BLOCKS; b++) {
            struct lw_hit16 hits;
            w->tile->block[b].active = w->tile->block[b].finished = 0;
            if (!w->going[b]) continue;
            const uint16_t met = w->going[b];
            w->going[b] = lw_compose_hits_meet(compose, &packet[b], met, layer == LW_COMPOSE_LAYERS_MAX,
                                               patches, look, &hits, &finished);
            note_points(compose, &packet[b], met, look, &hits, &finished, &w->tile->block[b]);
            any |= w->going[b] != 0;
        }
        lw_direct_tile_light(compose->direct, w->tile);
        for (uint32_t b = 0; b < LW_DIRECT_TILE_BLOCKS; b++) add_direct(&packet[b], &w->tile->block[b]);
    }
}

/* The packets at w->at with direct light, and what they mirror. */
static void render_lit(struct lw_compose *compose, const struct lw_compose_view *view,
                       const struct lw_camera_plane *plane, struct lw_compose_patches *patches,
                       struct lw_compose_worker *w) {
    bool any = false;
    for (uint32_t b = 0; b < LW_DIRECT_TILE_BLOCKS; b++) {
        w->going[b] = w->at[b].active;
        w->packet[b].mirrored.lanes = 0;
        if (!w->going[b]) continue;
        aim(&w->packet[b], view, plane, &w->at[b]);
        any = true;
    }
    if (any) light_layers(compose, patches, w, w->packet);
    if (!compose->mirrors) return;
    any = false;
    for (uint32_t b = 0; b < LW_DIRECT_TILE_BLOCKS; b++) {
        w->going[b] = w->packet[b].mirrored.lanes;
        if (!w->going[b]) continue;
        aim_mirrored(&w->packet[b], &w->second[b]);
        any = true;
    }
    if (!any) return;
    w->tile->listed = true;
    light_layers(compose, patches, w, w->second);
    for (uint32_t b = 0; b < LW_DIRECT_TILE_BLOCKS; b++) add_mirrored(&w->packet[b], &w->second[b]);
}

static void render_lit_tile(struct lw_compose *compose, const struct lw_compose_view *view,
                            const struct lw_camera_plane *plane, uint32_t left, uint32_t top,
                            struct lw_compose_patches *patches, struct lw_compose_worker *w, float *out_rgb) {
    w->tile->x = left, w->tile->y = top;
    w->tile->listed = false;
    for (uint32_t b = 0; b < LW_DIRECT_TILE_BLOCKS; b++)
        place_block(view, left + b % LW_DIRECT_TILE_SIDE * BLOCK, top + b / LW_DIRECT_TILE_SIDE * BLOCK,
                    &w->at[b]);
    render_lit(compose, view, plane, patches, w);
    for (uint32_t b = 0; b < LW_DIRECT_TILE_BLOCKS; b++)
        if (w->at[b].active) write_packet(compose, view, &w->packet[b], &w->at[b], out_rgb);
}

void lw_compose_render_tiles(struct lw_compose *compose, const struct lw_compose_view *view,
                             const struct lw_camera_plane *plane, bool direct, float *out_rgb) {
    uint32_t columns = (view->width + SCREEN_TILE - 1) / SCREEN_TILE;
    uint32_t rows = (view->height + SCREEN_TILE - 1) / SCREEN_TILE;
#pragma omp parallel for schedule(dynamic) num_threads(compose->threads)
    for (uint32_t t = 0; t < columns * rows; t++) {
        uint32_t left = t % columns * SCREEN_TILE, top = t / columns * SCREEN_TILE;
        struct lw_compose_patches patches;
        lw_compose_patch_forget(&patches);
        if (direct) {
            render_lit_tile(compose, view, plane, left, top, &patches, &compose->worker[omp_get_thread_num()],
                            out_rgb);
            continue;
        }
        for (uint32_t y = top; y < top + SCREEN_TILE && y < view->height; y += BLOCK)
            for (uint32_t x = left; x < left + SCREEN_TILE && x < view->width; x += BLOCK)
                render_block(compose, view, plane, x, y, &patches, out_rgb);
    }
}

/* The packet of the pixels of a list from `first` to `end`. */
static void place_listed(const struct lw_compose_view *view, const uint32_t *pixel, size_t first, size_t end,
                         struct lw_compose_pixels *out) {
    out->active = 0;
    out->listed = true;
    for (unsigned i = 0; i < LW_TRACE_WIDTH; i++) {
        const uint32_t place = pixel[first + i < end ? first + i : end - 1];
        out->x[i] = place % view->width, out->y[i] = place / view->width;
        if (first + i < end) out->active |= (uint16_t)(1u << i);
    }
}

static void list(const struct lw_compose_packet *p, uint16_t active, float *out_rgb) {
    for (unsigned i = 0; i < LW_TRACE_WIDTH; i++) {
        if (!(active >> i & 1u)) continue;
        float *pixel = out_rgb + 3 * (size_t)i;
        pixel[0] = p->radiance[i].x, pixel[1] = p->radiance[i].y, pixel[2] = p->radiance[i].z;
    }
}

static void render_lit_list(struct lw_compose *compose, const struct lw_compose_view *view,
                            const struct lw_camera_plane *plane, const uint32_t *pixel, size_t first,
                            size_t end, struct lw_compose_patches *patches, struct lw_compose_worker *w,
                            float *out_rgb) {
    w->tile->x = (uint32_t)first, w->tile->y = UINT32_MAX; /* no place of a screen tile */
    w->tile->listed = true;
    for (uint32_t b = 0; b < LW_DIRECT_TILE_BLOCKS; b++) {
        const size_t at = first + b * LW_TRACE_WIDTH;
        w->at[b].active = 0;
        if (at < end) place_listed(view, pixel, at, end, &w->at[b]);
    }
    render_lit(compose, view, plane, patches, w);
    for (uint32_t b = 0; b < LW_DIRECT_TILE_BLOCKS; b++)
        if (w->at[b].active) list(&w->packet[b], w->at[b].active, out_rgb + 3 * (first + b * LW_TRACE_WIDTH));
}

void lw_compose_render_list(struct lw_compose *compose, const struct lw_compose_view *view,
                            const struct lw_camera_plane *plane, const uint32_t *pixel, size_t pixel_count,
                            float *out_rgb) {
    const size_t chunks = (pixel_count + LISTED - 1) / LISTED;
#pragma omp parallel for schedule(dynamic) num_threads(compose->threads)
    for (size_t chunk = 0; chunk < chunks; chunk++) {
        struct lw_compose_patches patches;
        lw_compose_patch_forget(&patches);
        const size_t end = (chunk + 1) * LISTED < pixel_count ? (chunk + 1) * LISTED : pixel_count;
        if (compose->direct) {
            render_lit_list(compose, view, plane, pixel, chunk * LISTED, end, &patches,
                            &compose->worker[omp_get_thread_num()], out_rgb);
            continue;
        }
        for (size_t first = chunk * LISTED; first < end; first += LW_TRACE_WIDTH) {
            struct lw_compose_packet p;
            struct lw_compose_pixels at;
            place_listed(view, pixel, first, end, &at);
            render_packet(compose, view, plane, &at, &patches, &p);
            list(&p, at.active, out_rgb + 3 * first);
        }
    }
}
