#include "server/solve/geometry.h"

#include "common/base/invariant.h"
#include "common/base/log.h"
#include "server/solve/surface/invalid_texels.h"

#include <pthread.h>
#include <stdatomic.h>
#include <stdlib.h>
#include <string.h>

/* Work in a thread of its own. */
struct beside {
    pthread_t thread;
    bool runs;
};

static bool beside_start(struct beside *beside, void *(*work)(void *), void *argument) {
    return beside->runs = pthread_create(&beside->thread, NULL, work, argument) == 0;
}

static void beside_end(struct beside *beside) {
    if (beside->runs) pthread_join(beside->thread, NULL);
    beside->runs = false;
}

/* The rays' structure, which one thread builds. */
struct structure {
    struct beside beside;
    const struct lw_scene *scene;
    const struct lw_pose *pose;
    struct lw_trace *trace;
    enum lw_status status;
    struct lw_error err;
};

/* A search for the edges of the first seams. It reads nothing of the geometry, so others may build that. */
struct lw_geometry_edges {
    struct beside beside;
    const struct lw_scene *scene;
    struct lw_pose pose;
    struct lw_seam_edges found;
    enum lw_status status;
};

/* A search for seams. Its texels and objects do not change while it lasts. */
struct lw_geometry_search {
    struct beside beside;
    const struct lw_scene *scene;
    const struct lw_texels *texels;
    const struct lw_tiles *tiles;
    struct lw_pose pose;
    struct lw_seams seams;
    enum lw_status status;
    atomic_bool ended;
};

static void log_invalid(const struct lw_geometry *geometry, uint64_t invalid) {
    if (invalid)
        lw_log(LW_LOG_INFO, "%llu of %u texels lie inside or behind other objects and are left out",
               (unsigned long long)invalid, geometry->texels.count);
}

static void save_invalid(const struct lw_saved_texels *saved, const struct lw_invalid_texels_found *found,
                         const struct lw_trace *trace) {
    struct lw_error err = {0};
    if (lw_saved_texels_save(saved, found, trace, &err) != LW_OK)
        lw_log(LW_LOG_WARNING, "the next start looks inside objects again: %s", err.text);
}

/* Which texels light reaches: as an earlier start has found it, or found now. */
static enum lw_status find_invalid(struct lw_geometry *geometry, const struct lw_geometry_terms *terms,
                                   const _Atomic bool *cancel, struct lw_waiting *waiting) {
    const bool *stands = geometry->standing.stands;
    struct lw_invalid_texels_found found = {.texels = &geometry->texels, .pose = &geometry->pose};
    struct lw_error err = {0};
    enum lw_status status = terms->saved
                                ? lw_saved_texels_load(terms->saved, &geometry->texels, &geometry->pose,
                                                       stands, geometry->trace, &found.count, &err)
                                : LW_NO_INPUT;
    if (status == LW_OK) {
        lw_log(LW_LOG_INFO, "which texels light reaches is known from an earlier start");
    } else {
        if (status != LW_NO_INPUT) lw_log(LW_LOG_WARNING, "%s; looking again", err.text);
        status = lw_invalid_texels_find(&geometry->texels, &geometry->pose, stands, geometry->trace,
                                        geometry->threads, cancel, waiting, &found.count);
        if (status == LW_OK && terms->saved) save_invalid(terms->saved, &found, geometry->trace);
    }
    if (status == LW_OK) log_invalid(geometry, found.count);
    return status;
}

static enum lw_status init_fine(struct lw_geometry *geometry, const struct lw_geometry_terms *terms,
                                struct lw_error *err) {
    const uint32_t tiles = terms->map->finer_count ? terms->fine_tiles : 0;
    if (!tiles) return LW_OK;
    enum lw_status status = lw_texels_reserve(&geometry->texels, tiles * LW_TILE_TEXELS_MAX);
    if (status == LW_OK)
        status = lw_fine_tiles_init(&geometry->fine, &geometry->texels, terms->map, terms->fine_when,
                                    geometry->threads);
    return status == LW_OK ? LW_OK : lw_status_fail(err, status, "%u tiles of finer levels", tiles);
}

static void *build_structure(void *argument) {
    struct structure *s = argument;
    s->status = lw_trace_create(s->scene, s->pose, &s->trace, &s->err);
    return NULL;
}

static void *find_edges(void *argument) {
    struct lw_geometry_edges *edges = argument;
    edges->status = lw_seam_edges_find(edges->scene, &edges->pose, &edges->found);
    return NULL;
}

static void edges_destroy(struct lw_geometry_edges *edges) {
    if (!edges) return;
    beside_end(&edges->beside);
    lw_seam_edges_finish(&edges->found);
    lw_pose_finish(&edges->pose);
    free(edges);
}

/* NULL: there is no memory, or no thread. */
static struct lw_geometry_edges *edges_start(const struct lw_geometry *geometry) {
    struct lw_geometry_edges *edges = calloc(1, sizeof *edges);
    if (!edges) return NULL;
    edges->scene = geometry->scene;
    if (lw_pose_init_copy(&edges->pose, &geometry->pose, geometry->scene) == LW_OK &&
        beside_start(&edges->beside, find_edges, edges))
        return edges;
    edges_destroy(edges);
    return NULL;
}

/* Builds the rays' structure and places texels at the same time. The search for the edges of seams begins as
 * well: it takes one thread about as long as the structure. */
static enum lw_status build_rays_and_texels(struct lw_geometry *geometry, const _Atomic bool *cancel,
                                            struct lw_waiting *waiting, struct lw_error *err) {
    struct structure structure = {.scene = geometry->scene, .pose = &geometry->pose};
    const bool alone = geometry->threads == 1;
    if (!alone) geometry->edges = edges_start(geometry);
    if (alone || !beside_start(&structure.beside, build_structure, &structure)) build_structure(&structure);
    enum lw_status status = structure.beside.runs || structure.status == LW_OK
                                ? lw_texels_init(&geometry->texels, geometry->scene,
                                                 (unsigned)geometry->threads, cancel, waiting, err)
                                : LW_OK;
    beside_end(&structure.beside);
    geometry->trace = structure.trace;
    if (status != LW_OK || structure.status == LW_OK) return status;
    if (err && err->status == LW_OK) *err = structure.err;
    return structure.status;
}

enum lw_status lw_geometry_init(struct lw_geometry *geometry, const struct lw_scene *scene,
                                const struct lw_pose *pose, const struct lw_geometry_terms *terms,
                                int threads, const _Atomic bool *cancel, struct lw_waiting *waiting,
                                struct lw_error *err) {
    *geometry = (struct lw_geometry){.scene = scene, .threads = threads};
    enum lw_status status = lw_pose_init_copy(&geometry->pose, pose, scene);
    if (status != LW_OK) return lw_status_fail(err, status, "poses");
    if ((status = build_rays_and_texels(geometry, cancel, waiting, err)) != LW_OK) return status;
    const struct lw_geometry_terms at_once = {.saved = NULL};
    if ((status = lw_standing_init(&geometry->standing, scene, pose)) == LW_OK)
        status = find_invalid(geometry, terms ? terms : &at_once, cancel, waiting);
    if (status == LW_CLOSED) return status;
    if (status != LW_OK) return lw_status_fail(err, status, "%u texels", geometry->texels.count);
    return terms && terms->map ? init_fine(geometry, terms, err) : LW_OK;
}

static void *search_in_thread(void *argument) {
    struct lw_geometry_search *search = argument;
    struct lw_seam_edges edges;
    search->status = lw_seam_edges_find(search->scene, &search->pose, &edges);
    if (search->status == LW_OK) {
        search->status = lw_seams_init(&search->seams, search->scene, &edges, search->texels, search->tiles);
        lw_seam_edges_finish(&edges);
    }
    search->ended = true;
    return NULL;
}

static void search_destroy(struct lw_geometry_search *search) {
    if (!search) return;
    lw_seams_finish(&search->seams);
    lw_pose_finish(&search->pose);
    free(search);
}

/* NULL: there is no memory, or no thread. */
static struct lw_geometry_search *search_start(const struct lw_geometry *geometry,
                                               const struct lw_tiles *tiles) {
    struct lw_geometry_search *search = calloc(1, sizeof *search);
    if (!search) return NULL;
    *search = (struct lw_geometry_search){
        .scene = geometry->scene, .texels = &geometry->texels, .tiles = tiles, .ended = false};
    if (lw_pose_init_copy(&search->pose, &geometry->pose, geometry->scene) == LW_OK &&
        beside_start(&search->beside, search_in_thread, search))
        return search;
    search_destroy(search);
    return NULL;
}

static void take_seams(struct lw_geometry *geometry, struct lw_seams *seams) {
    lw_seams_finish(&geometry->seams);
    geometry->seams = *seams;
    *seams = (struct lw_seams){0};
    geometry->seams_found++;
    geometry->seams_outdated = false;
}

/* Waits for the search, if there is one, and takes what it has found, if it is to be kept. */
static enum lw_status end_search(struct lw_geometry *geometry, bool keep) {
    struct lw_geometry_search *search = geometry->search;
    enum lw_status status = LW_OK;
    if (!search) return LW_OK;
    geometry->search = NULL;
    beside_end(&search->beside);
    if (keep && (status = search->status) == LW_OK) take_seams(geometry, &search->seams);
    search_destroy(search);
    return status;
}

static void forget_edges(struct lw_geometry *geometry) {
    edges_destroy(geometry->edges);
    geometry->edges = NULL;
}

/* The edges of seams, by the search that has begun, or found now. The caller finishes them. */
static enum lw_status take_edges(struct lw_geometry *geometry, struct lw_seam_edges *out_edges) {
    struct lw_geometry_edges *edges = geometry->edges;
    if (!edges) return lw_seam_edges_find(geometry->scene, &geometry->pose, out_edges);
    beside_end(&edges->beside);
    const enum lw_status status = edges->status;
    if (status == LW_OK) {
        *out_edges = edges->found;
        edges->found = (struct lw_seam_edges){0};
    }
    forget_edges(geometry);
    return status;
}

void lw_geometry_finish(struct lw_geometry *geometry) {
    (void)end_search(geometry, false);
    forget_edges(geometry);
    lw_seams_finish(&geometry->seams);
    lw_denoise_pairs_finish(&geometry->pairs);
    lw_fine_tiles_finish(&geometry->fine);
    if (geometry->texels.scene) lw_texels_finish(&geometry->texels);
    lw_standing_finish(&geometry->standing);
    lw_trace_destroy(geometry->trace);
    lw_pose_finish(&geometry->pose);
    *geometry = (struct lw_geometry){0};
}

static bool is_recoloured(const struct lw_geometry *geometry, const struct lw_pose *pose) {
    bool other = false;
    for (uint32_t m = 0; m < geometry->scene->material_count; m++)
        other |= memcmp(pose->material[m].base_colour, geometry->pose.material[m].base_colour,
                        sizeof pose->material[m].base_colour) != 0;
    return other;
}

/* Marks tiles and seams as out of date after a change of texels, and parts the filter's pairs again. others:
 * other texels are covered than before. status: that of the change, returned if it failed. */
static enum lw_status note_texels(struct lw_geometry *geometry, bool others, enum lw_status status) {
    geometry->seams_outdated |= others;
    geometry->changes++;
    if (status != LW_OK || !geometry->pairs.pair) return status;
    return lw_denoise_pairs_review(&geometry->pairs, geometry->threads);
}

/* Takes over what stands at a pose and a frame. Nobody looks for seams while texels change. */
static enum lw_status review(struct lw_geometry *geometry, const struct lw_pose *pose, uint64_t frame) {
    bool others = false;
    if (!lw_standing_take(&geometry->standing, &geometry->pose, pose, frame)) return LW_OK;
    (void)end_search(geometry, false);
    enum lw_status status =
        lw_invalid_texels_review(&geometry->texels, &geometry->pose, geometry->standing.stood, pose,
                                 geometry->trace, geometry->threads, &others);
    return note_texels(geometry, others, status);
}

enum lw_status lw_geometry_rest(struct lw_geometry *geometry, uint64_t frame, struct lw_error *err) {
    enum lw_status status = review(geometry, &geometry->pose, frame);
    return status == LW_OK ? LW_OK : lw_status_fail(err, status, "taking over what has come to rest");
}

enum lw_status lw_geometry_set_pose(struct lw_geometry *geometry, const struct lw_pose *pose, bool later,
                                    uint64_t frame, struct lw_error *err) {
    const unsigned moved = lw_pose_difference(pose, &geometry->pose, geometry->scene);
    const bool recoloured = is_recoloured(geometry, pose);
    enum lw_status status = LW_OK;
    if (moved & LW_POSE_DYNAMIC) {
        (void)end_search(geometry, false);
        forget_edges(geometry);
        geometry->seams_outdated = true;
    }
    if (moved & (LW_POSE_OBJECTS | LW_POSE_DYNAMIC))
        status = later ? lw_trace_set_pose_soon(geometry->trace, pose, err)
                       : lw_trace_set_pose(geometry->trace, pose, err);
    if (status == LW_OK && (moved & (LW_POSE_OBJECTS | LW_POSE_DYNAMIC)))
        status = review(geometry, pose, frame);
    lw_pose_copy(&geometry->pose, pose, geometry->scene);
    if (status == LW_OK && recoloured) status = lw_texels_set_albedo(&geometry->texels, geometry->threads);
    return status == LW_OK ? LW_OK : lw_status_fail(err, status, "taking over what has changed");
}

enum lw_status lw_geometry_weigh_pairs(struct lw_geometry *geometry) {
    if (geometry->pairs.pair) return LW_OK;
    return lw_denoise_pairs_init(&geometry->pairs, geometry->scene, &geometry->texels, geometry->threads);
}

enum lw_status lw_geometry_find_seams(struct lw_geometry *geometry, const struct lw_tiles *tiles,
                                      bool later) {
    const bool none = !geometry->seams_found;
    if (geometry->search) {
        if (later && !geometry->search->ended) return LW_OK;
        return end_search(geometry, true);
    }
    if (!none && !geometry->seams_outdated) return LW_OK;
    if (later && !none && (geometry->search = search_start(geometry, tiles))) return LW_OK;
    struct lw_seam_edges edges;
    struct lw_seams seams;
    enum lw_status status = take_edges(geometry, &edges);
    if (status != LW_OK) return status;
    status = lw_seams_init(&seams, geometry->scene, &edges, &geometry->texels, tiles);
    lw_seam_edges_finish(&edges);
    if (status == LW_OK) take_seams(geometry, &seams);
    return status;
}

void lw_geometry_forget_tiles(struct lw_geometry *geometry) { (void)end_search(geometry, false); }

size_t lw_geometry_memory_bytes(const struct lw_geometry *geometry) {
    return lw_texels_memory_bytes(&geometry->texels) + lw_fine_tiles_memory_bytes(&geometry->fine) +
           lw_denoise_pairs_memory_bytes(&geometry->pairs) + lw_seams_memory_bytes(&geometry->seams) +
           lw_trace_memory_bytes(geometry->trace);
}
