#include "server/solve/shown.h"

#include "common/base/invariant.h"
#include "server/solve/filter/moment_bounds.h"

/* Seams that hold an object which has begun to move may do so a little longer, if they are sought later. */
static enum lw_status find_seams(struct lw_shown *s, struct lw_error *err) {
    enum lw_status status = lw_geometry_find_seams(s->geometry, s->tiles, s->seams_later);
    if (status == LW_OK && s->seams_found != s->geometry->seams_found) {
        s->seams_found = s->geometry->seams_found;
        status = lw_seams_welds_init(&s->welds, &s->geometry->seams, s->tiles->channels);
    }
    return status == LW_OK ? LW_OK : lw_status_fail(err, status, "seams of %u texels", s->tiles->texel_count);
}

static enum lw_status set_up_denoise(struct lw_shown *s, struct lw_error *err) {
    if (s->denoise.pairs) return LW_OK;
    enum lw_status status = lw_geometry_weigh_pairs(s->geometry);
    if (status == LW_OK)
        status = lw_denoise_init(&s->denoise, &s->geometry->pairs, s->map, s->tiles, s->geometry->threads);
    return status == LW_OK ? LW_OK
                           : lw_status_fail(err, status, "denoiser of %u texels", s->tiles->texel_count);
}

enum lw_status lw_shown_init(struct lw_shown *s, struct lw_error *err) {
    s->channels = LW_TILE_CHANNELS_FULL;
    enum lw_status status = find_seams(s, err);
    return status == LW_OK && s->filters ? set_up_denoise(s, err) : status;
}

void lw_shown_finish(struct lw_shown *s) {
    lw_denoise_finish(&s->denoise);
    lw_seams_welds_finish(&s->welds);
}

bool lw_shown_choose(struct lw_shown *s, uint32_t channels) {
    channels = lw_tiles_can_show(s->tiles, channels);
    s->all |= (channels & ~s->channels) != 0;
    s->channels = channels;
    return lw_tiles_judge_channels(s->tiles, channels, s->threads);
}

void lw_shown_filter(struct lw_shown *s, uint64_t frame) {
    if (s->filters)
        lw_denoise_run(&s->denoise, frame, s->channels, s->threads);
    else
        lw_tiles_show(s->tiles, frame, s->channels, s->threads);
}

enum lw_status lw_shown_weld(struct lw_shown *s, uint64_t frame, struct lw_error *err) {
    const struct lw_seams *seams = &s->geometry->seams;
    enum lw_status status = find_seams(s, err);
    if (status != LW_OK) return status;
    lw_seams_weld(seams, &s->welds, s->channels, s->tiles, frame, s->threads);
    lw_moment_bounds_keep(s->tiles, &s->geometry->pose, frame, s->channels, s->threads);
    lw_seam_gutters_fill(&seams->gutters, s->tiles, frame, s->channels, s->threads);
    return LW_OK;
}

enum lw_status lw_shown_filter_once(struct lw_shown *s, uint64_t frame, struct lw_error *err) {
    enum lw_status status = set_up_denoise(s, err);
    if (status != LW_OK) return status;
    lw_denoise_run(&s->denoise, frame, s->channels, s->threads);
    return lw_shown_weld(s, frame, err);
}

void lw_shown_read_tile(const struct lw_shown *s, lw_tile_id id, uint32_t bounces,
                        struct lw_solver_tile *out_tile) {
    const struct lw_tiles *tiles = s->tiles;
    LW_INVARIANT(id.v < tiles->id_count && tiles->slot_of_id[id.v] < tiles->count);
    const struct lw_solve_tile *tile = lw_tiles_at(tiles, id);
    *out_tile = (struct lw_solver_tile){.covered = tiles->covered + tile->first,
                                        .filled = s->geometry->texels.filled + tile->first,
                                        .chart = tile->mesh->chart + tile->local,
                                        .width = tile->width,
                                        .height = tile->height,
                                        .bounces = bounces,
                                        .sample_count = tile->light.sample_count,
                                        .error = tile->covered_count ? tile->light.error : 0,
                                        .solved_frame = tile->light.solved_frame,
                                        .converged = tile->light.state == LW_BLOCK_CONVERGED,
                                        .has_surface = tile->covered_count > 0};
    for (int c = 0; c < 3; c++) {
        out_tile->direct[c] = tiles->direct[c] + tile->first;
        out_tile->indirect[c] = tiles->indirect[c] + tile->first;
    }
    out_tile->albedo = tile->mesh->albedo ? tile->mesh->albedo + tile->local : NULL;
    LW_TILE_CHANNELS_EACH (channel, s->channels | LW_TILE_CHANNELS_FULL)
        for (uint32_t p = 0; p < lw_tile_channel_at(channel)->planes; p++)
            out_tile->shown[channel][p] = tiles->shown[channel][p] + tile->first;
}

size_t lw_shown_memory_bytes(const struct lw_shown *s) {
    return lw_denoise_memory_bytes(&s->denoise) + lw_seams_welds_memory_bytes(&s->welds);
}
