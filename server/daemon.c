#include "server/daemon.h"

#include "common/base/clock.h"
#include "common/base/log.h"
#include "common/scene/finish_package.h"
#include "common/scene/scene_spares.h"
#include "common/tile/tile_codec.h"
#include "server/solve/coarse_first.h"
#include "server/solve/sparse_solver.h"
#include "server/solve/surface/saved_texels.h"

#include <errno.h>
#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/resource.h>
#include <unistd.h>

#define SOLVER_NICE 5 /* lower priority than the loop */

/* ---- the scene ---- */

static enum lw_status choose_client_lights(struct lw_daemon *d, struct lw_error *err) {
    const struct lw_scene *scene = d->scene;
    struct lw_client_lights *client = &d->client_lights;
    enum lw_status status = lw_client_lights_init(client, scene, &d->pose, d->settings.client_lights, err);
    if (status != LW_OK) return status;
    d->light_bits = calloc(lw_client_lights_bytes(scene->light_count) + 1, 1);
    d->material_bits = calloc(lw_client_lights_bytes(scene->material_count) + 1, 1);
    if (!d->light_bits || !d->material_bits) return lw_status_fail(err, LW_NO_MEMORY, "client lights");
    lw_client_lights_write(client, d->light_bits, d->material_bits);
    return LW_OK;
}

/* Objects whose tiles have directions of light. */
static enum lw_status choose_directional(struct lw_daemon *d, struct lw_error *err) {
    const struct lw_scene *scene = d->scene;
    uint32_t count = 0;
    d->directional = calloc(scene->object_count + 1ul, sizeof *d->directional);
    if (!d->directional) return lw_status_fail(err, LW_NO_MEMORY, "directional objects");
    for (uint32_t o = 0; d->settings.directional != LW_DAEMON_DIRECTIONAL_OFF && o < scene->object_count; o++)
        count += d->directional[o] =
            d->settings.directional == LW_DAEMON_DIRECTIONAL_ON || lw_scene_object_has_bumps(scene, o);
    d->has_directions = count > 0;
    if (count) lw_log(LW_LOG_INFO, "light has a direction on %u of %u objects", count, scene->object_count);
    return LW_OK;
}

/* Number of tiles of finer levels that clients may list, or the solver hold, at a time. Every session with
 * finer levels holds a version of each. */
#define FINE_IDS_MIN 4096u

static enum lw_status name_tiles(struct lw_daemon *d, struct lw_error *err) {
    const uint32_t tiles = d->memory.fine_tiles, ids = 2 * tiles > FINE_IDS_MIN ? 2 * tiles : FINE_IDS_MIN;
    const uint32_t finer = tiles ? (uint32_t)d->settings.detail : 0;
    const enum lw_status status = lw_atlas_map_init_finer(&d->atlas_map, d->scene, finer, finer ? ids : 0);
    return status == LW_OK ? LW_OK : lw_status_fail(err, status, "tiles");
}

static enum lw_status choose_memory(struct lw_daemon *d, struct lw_error *err) {
    const struct lw_solver_desc desc = {.scene = d->scene,
                                        .client_lights = &d->client_lights,
                                        .bounces = (uint32_t)d->settings.bounces,
                                        .directions = d->has_directions};
    return lw_daemon_memory_choose(&d->settings, &desc, d->light_groups.count, &d->memory, err);
}

enum lw_status lw_daemon_read_scene(struct lw_daemon *d, struct lw_error *err) {
    const struct lw_daemon_settings *s = &d->settings;
    d->scene_stamp = lw_file_stamp(s->scene.path); /* before it is read: a change meanwhile is seen */
    d->environment_stamp = lw_file_stamp(s->scene.environment);
    enum lw_status status = lw_scene_open(&s->scene, &d->scene, err);
    if (status != LW_OK) return status;
    if (s->spares && (status = lw_scene_spares_add(d->scene, s->spares, err)) != LW_OK) {
        lw_status_context(err, "--spares");
        return status;
    }
    status = lw_package_write(d->scene, &d->package, &d->package_size, err);
    if (status == LW_OK && lw_scene_has_finishes(d->scene))
        status = lw_finish_package_write(d->scene, &d->finishes, &d->finishes_size, err);
    if (status != LW_OK) return status;
    lw_package_hash(d->package, d->package_size, &d->package_hash);
    if (d->finishes) lw_package_hash(d->finishes, d->finishes_size, &d->finishes_hash);
    if ((status = lw_scene_state_init(&d->state, d->scene, s->freeze ? s->freeze_s : 0, s->freeze)) !=
            LW_OK ||
        (status = lw_pose_init(&d->pose, d->scene)) != LW_OK)
        return lw_status_fail(err, status, "poses");
    lw_scene_state_pose(&d->state, 0, &d->pose);
    status = lw_light_groups_init(&d->light_groups, d->scene, &d->pose, s->light_groups, err);
    if (status != LW_OK) {
        lw_status_context(err, "--light-groups");
        return status;
    }
    status = choose_client_lights(d, err);
    if (status == LW_OK) status = choose_directional(d, err);
    if (status == LW_OK) status = choose_memory(d, err);
    return status == LW_OK ? name_tiles(d, err) : status;
}

/* Share of a tile's noise that the solver's filter leaves. */
static float noise_shown(const struct lw_daemon_settings *s) {
    return s->denoise == 1 ? LW_SOLVER_NOISE_SHOWN : 1;
}

enum lw_status lw_daemon_solve_nothing(struct lw_daemon *d, struct lw_error *err) {
    uint8_t *nothing = calloc((size_t)d->atlas_map.tile_count + 1, 1);
    if (!nothing) return lw_status_fail(err, LW_NO_MEMORY, "tiles");
    enum lw_status status = d->solver->ops->set_interest(d->solver, nothing, err);
    free(nothing);
    return status;
}

/* In hex; returns how many characters. */
static int print_hash(char *dst, const struct lw_package_hash *hash) {
    int length = 0;
    for (size_t i = 0; i < sizeof hash->bytes; i++)
        length += snprintf(dst + length, 3, "%02x", hash->bytes[i]);
    return length;
}

static int print_hash_of(char *dst, const void *bytes, size_t size) {
    struct lw_package_hash hash;
    lw_package_hash(bytes, size, &hash);
    return print_hash(dst, &hash);
}

/* Under a hash of all that decides which texels light reaches: the scene, when, and this very program.
 * Another build of it may find others. */
static struct lw_saved_texels saved_texels(const struct lw_daemon *d) {
    const struct lw_daemon_settings *s = &d->settings;
    const struct lw_file_stamp program = lw_file_stamp("/proc/self/exe");
    struct lw_saved_texels saved = {.folder = s->cache};
    struct lw_package_hash hash;
    char text[256];
    int length = print_hash(text, &d->package_hash);
    length += snprintf(text + length, sizeof text - (size_t)length,
                       " " LW_VERSION " program %llu %llu freeze %d %a real %d",
                       (unsigned long long)program.size_bytes, (unsigned long long)program.modified_ns,
                       s->freeze, s->freeze ? s->freeze_s : 0, s->clock == LW_DAEMON_CLOCK_REAL);
    lw_package_hash((const uint8_t *)text, (size_t)length, &hash);
    memcpy(saved.key, hash.bytes, sizeof saved.key);
    return saved;
}

/* Runs that are to be repeatable, or have frames counted, light the whole density at once. So do those that
 * have light to show from the last run. */
static bool is_coarse_first(const struct lw_daemon *d) {
    const struct lw_daemon_settings *s = &d->settings;
    return s->first == LW_DAEMON_FIRST_COARSE && s->clock == LW_DAEMON_CLOCK_REAL && !s->frames &&
           !d->channels_kept && s->entry->choice == LW_CHOICE_CELLS && lw_coarse_first_pays(d->scene);
}

enum lw_status lw_daemon_set_up_solver(struct lw_daemon *d, struct lw_error *err) {
    const struct lw_daemon_settings *s = &d->settings;
    const struct lw_saved_texels saved = saved_texels(d);
    const struct lw_solver_desc desc = {
        .scene = &d->state.scene,
        .atlas_map = &d->atlas_map,
        .client_lights = &d->client_lights,
        .light_groups = &d->light_groups,
        .directions = d->has_directions,
        .directional = d->directional,
        .bounces = (uint32_t)s->bounces,
        LW_PROBE_OPTIONS_DESC(&s->probes),
        .denoise = s->denoise == 1,
        .direct_samples = (uint32_t)s->direct_samples,
        .indirect_samples = (uint32_t)s->indirect_samples,
        .target_error = (float)s->error,
        .threads = (unsigned)s->scene.threads,
        .seed = (uint32_t)s->seed,
        .frame_budget_s =
            s->clock == LW_DAEMON_CLOCK_REAL && isfinite(s->frame_budget_ms) ? s->frame_budget_ms * 1e-3 : 0,
        .plan_log = s->plan_log,
        .frame_budget_units = isfinite(s->frame_budget_units) ? s->frame_budget_units : 0,
        .fine_tiles = d->memory.fine_tiles,
        .saved_texels = *s->cache ? &saved : NULL,
        .cancel = &d->cancel,
        .waiting = &d->first_light,
        .awaited = s->clock == LW_DAEMON_CLOCK_REAL ? lw_server_updates_wait(d->server) : NULL};
    enum lw_status status =
        d->memory.is_sparse  ? lw_sparse_solver_create(s->entry, &desc, &d->pose, &d->solver, err)
        : is_coarse_first(d) ? lw_coarse_first_create(s->entry, &desc, &d->pose, &d->solver, err)
                             : s->entry->create(&desc, &d->pose, &d->solver, err);
    if (status != LW_OK) return status;
    if (s->light == LW_DAEMON_LIGHT_SEEN) { /* by nobody, to begin with */
        status = lw_daemon_solve_nothing(d, err);
        if (status != LW_OK) return status;
    }
    status = lw_publisher_create(&(struct lw_publisher_desc){.scene = &d->state.scene,
                                                             .atlas_map = &d->atlas_map,
                                                             .solver = d->solver,
                                                             .target_error = (float)s->error,
                                                             .noise_shown = noise_shown(s),
                                                             .codec = s->codec == LW_DAEMON_CODEC_DCT
                                                                          ? LW_TILE_CODEC_DCT
                                                                          : LW_TILE_CODEC_HALF_ZSTD,
                                                             .step_widest = (float)s->tile_step,
                                                             .directional = d->directional,
                                                             .threads = (unsigned)s->scene.threads},
                                 &d->publisher);
    if (status != LW_OK) return lw_status_fail(err, status, "publisher");
    if (s->light != LW_DAEMON_LIGHT_SEEN) lw_publisher_want(d->publisher, NULL);
    return LW_OK;
}

uint64_t lw_daemon_memory_bytes(const struct lw_daemon *d) {
    return d->solver->ops->memory_bytes(d->solver) + lw_publisher_memory_bytes(d->publisher);
}

/* ---- the server ---- */

/* sockets: of the server before; NULL: there was none */
enum lw_status lw_daemon_create_server(struct lw_daemon *d, struct lw_server_sockets *sockets,
                                       struct lw_error *err) {
    struct lw_daemon_settings *s = &d->settings;
    struct lw_server_desc desc = {.sockets = sockets,
                                  .atlas_map = &d->atlas_map,
                                  .package = d->package,
                                  .package_size = d->package_size,
                                  .finishes = d->finishes,
                                  .finishes_size = d->finishes_size,
                                  .takes_packages = true,
                                  .bounces = (uint32_t)s->bounces,
                                  .channels =
                                      s->entry->channels & lw_tile_channels_held(false, d->has_directions),
                                  .target_error = (float)s->error,
                                  .noise_shown = noise_shown(s),
                                  .first_light = &d->first_light,
                                  .client_lights = d->light_bits,
                                  .client_lights_size = lw_client_lights_bytes(d->scene->light_count),
                                  .client_materials = d->material_bits,
                                  .client_materials_size = lw_client_lights_bytes(d->scene->material_count),
                                  .scene = d->scene,
                                  .hooks = d->hooks,
                                  .features = s->codec == LW_DAEMON_CODEC_DCT ? LW_FEATURE_DCT : 0};
    lw_serve_options_fill(&s->serve, &desc);
    const enum lw_status status = lw_server_create(&desc, &d->server, err);
    if (status == LW_OK) d->package = d->finishes = NULL;
    return status;
}

/* ---- the light of the last run ---- */

/* A hash of all that the shown light depends on: the scene before updates, and options. Options of
 * convergence, network and speed are not part of it. */
static void make_key(const struct lw_daemon *d, uint8_t out_key[LW_SAVED_LIGHT_KEY_SIZE]) {
    const struct lw_daemon_settings *s = &d->settings;
    struct lw_package_hash hash;
    char text[640];
    const char *groups = s->light_groups ? s->light_groups : "";
    int length = print_hash(text, &d->package_hash);
    if (d->finishes_size) length += print_hash(text + length, &d->finishes_hash);
    length += print_hash_of(text + length, groups, strlen(groups));
    length += print_hash_of(text + length, d->light_bits, lw_client_lights_bytes(d->scene->light_count));
    length +=
        print_hash_of(text + length, d->material_bits, lw_client_lights_bytes(d->scene->material_count));
    length += snprintf(
        text + length, sizeof text - (size_t)length,
        " " LW_VERSION " solver %s bounces %lld samples %lld %lld seed %lld range %a cell %a probes %d %a "
        "denoise %d codec %d freeze %d %a directions %d",
        s->entry->name, (long long)s->bounces, (long long)s->direct_samples, (long long)s->indirect_samples,
        (long long)s->seed, s->probes.tracing_range_m, s->probes.cell_size_m, s->probes.form,
        s->probes.probe_spacing_m, s->denoise, s->codec, s->freeze, s->freeze_s, d->has_directions);
    lw_package_hash((const uint8_t *)text, (size_t)length, &hash);
    memcpy(out_key, hash.bytes, LW_SAVED_LIGHT_KEY_SIZE);
}

/* Changes name objects, lights and materials by number, so the key is the package. */
static enum lw_status restore_changes(struct lw_daemon *d, struct lw_error *err) {
    size_t count;
    enum lw_status status = lw_change_store_open(&d->change_store, d->settings.keep, d->package_hash.bytes,
                                                 &d->restored, &count, err);
    if (status != LW_OK) return status;
    d->restored_count = lw_server_begin_with_changes(d->server, d->restored, count);
    if (d->restored_count < count)
        lw_log(LW_LOG_WARNING, "%s: change %zu of %zu cannot be made: it and later ones are left out",
               d->change_store.path, d->restored_count + 1, count);
    if (d->restored_count < count) lw_change_store_discard(&d->change_store);
    if (d->restored_count)
        lw_log(LW_LOG_INFO,
               "going on with the scene as clients have changed it: lightwellctl reset takes it back");
    return LW_OK;
}

/* Clients get it as soon as the server runs, seconds before the solver has texels to light. */
enum lw_status lw_daemon_restore_light(struct lw_daemon *d, struct lw_error *err) {
    uint8_t key[LW_SAVED_LIGHT_KEY_SIZE];
    make_key(d, key);
    enum lw_status status = lw_light_store_init(&d->light_store, d->settings.keep, key, err);
    if (status != LW_OK) {
        lw_status_context(err, "--keep");
        return status;
    }
    if (d->settings.keep_changes && (status = restore_changes(d, err)) != LW_OK) {
        lw_status_context(err, "--keep-changes");
        return status;
    }
    struct lw_snapshot *snapshot =
        lw_light_store_load(&d->light_store, &d->atlas_map, (float)d->settings.error);
    if (!snapshot) return LW_OK;
    lw_server_publish(d->server, snapshot);
    if (d->nats) lw_nats_publisher_publish(d->nats, snapshot);
    d->published = snapshot->frame;
    d->channels_kept = snapshot->channels;
    lw_snapshot_unref(snapshot);
    return LW_OK;
}

/* ---- threads ---- */

/* Lowers the priority of the solver's thread; its workers inherit that. The loop's thread needs a core for
 * short moments only, but a new client waits for it. Linux has a priority for each thread; on systems with
 * one for the process, it stays. */
void lw_daemon_give_way(void) {
#if defined(__linux__)
    errno = 0;
    const int priority = getpriority(PRIO_PROCESS, 0);
    if (errno == 0) (void)setpriority(PRIO_PROCESS, 0, priority + SOLVER_NICE);
#endif
}

/* CLOCK_REALTIME, as pthread_timedjoin_np() has it. */
struct timespec lw_daemon_in_seconds(unsigned seconds) {
    return (struct timespec){.tv_sec = (time_t)(lw_clock_read_ns(CLOCK_REALTIME) / 1000000000u) + seconds};
}

/* ---- the whole ---- */

void lw_daemon_init(struct lw_daemon *d, int argc, char **argv, _Atomic bool *signalled) {
    *d = (struct lw_daemon){.argc = argc,
                            .argv = argv,
                            .signalled = signalled,
                            .channels = 1u << LW_TILE_CHANNEL_FULL,
                            .succession = {.sockets = {-1, -1, -1}}};
    lw_daemon_settings_init(&d->settings, signalled);
}

void lw_daemon_finish(struct lw_daemon *d) {
    lw_nats_publisher_destroy(d->nats); /* it uses the server */
    lw_server_destroy(d->server);
    lw_daemon_metrics_finish(&d->metrics);
    lw_change_store_finish(&d->change_store);
    free(d->restored);
    lw_light_store_finish(&d->light_store);
    lw_publisher_destroy(d->publisher);
    d->cancel = true; /* the solver of the whole density may still be built */
    if (d->solver) d->solver->ops->destroy(d->solver);
    lw_light_groups_finish(&d->light_groups);
    lw_client_lights_finish(&d->client_lights);
    free(d->light_bits);
    free(d->material_bits);
    free(d->directional);
    lw_pose_finish(&d->pose);
    lw_scene_state_finish(&d->state);
    lw_atlas_map_finish(&d->atlas_map);
    free(d->package);
    free(d->finishes);
    lw_scene_destroy(d->scene);
    lw_daemon_settings_finish(&d->settings);
}
