#include "server/daemon_memory.h"

#include "common/base/log.h"
#include "common/tile/atlas.h"
#include "server/solve/coarse_scene.h"
#include "server/solve/memory_forecast.h"

/* Where no --memory is given: the most that level 0 may take to be whole. More of it makes light late, and a
 * minute later no better (docs/lab/big_scenes.md). */
#define WHOLE_MAX 2000000000u
/* Shares of the machine's memory: for light, and for finer tiles if level 0 is whole. */
#define SHARE      2
#define FINE_SHARE 32
#define FINE_MAX   (768ull << 20)

/* Memory of such a tile, with its share of the publisher's, and of each layer of light. */
#define FINE_TILE_BYTES  (128ull << 10)
#define FINE_LAYER_BYTES (1ull << 20)
#define FINE_TILES_MAX   4096u /* a session remembers what it has of each */

/* Where level 0 is sparse, each of its texels takes bytes: whether it has surface, and as it was sent; more
 * where somebody looks. */
#define READ_BYTES 8u
/* With fewer tiles a single view would lack some of its own. */
#define SPARSE_TILES_MIN 64u

static double mb(uint64_t bytes) { return (double)bytes * 1e-6; }

static uint32_t count_fine(uint64_t bytes, uint64_t tile_bytes) {
    const uint64_t count = bytes / tile_bytes;
    return count < FINE_TILES_MAX ? (uint32_t)count : FINE_TILES_MAX;
}

/* Memory of a scene. */
struct need {
    double texels_m;    /* millions */
    uint64_t whole;     /* bytes of the light of all texels */
    uint64_t sparse;    /* bytes of the light of the coarse scene, and of what clients read of it */
    uint64_t least;     /* the least with which there is light */
    uint64_t fine_tile; /* bytes of a tile of a finer level */
};

static struct need find_need(const struct lw_solver_desc *desc, uint32_t layers) {
    const uint64_t texels = lw_coarse_scene_count_texels(desc->scene);
    struct need need = {.texels_m = (double)texels * 1e-6,
                        .whole = lw_memory_forecast_whole(desc, layers),
                        .sparse = lw_memory_forecast_coarse(desc, layers) + texels * READ_BYTES,
                        .fine_tile = FINE_TILE_BYTES + layers * FINE_LAYER_BYTES};
    need.least = need.sparse + SPARSE_TILES_MIN * need.fine_tile;
    if (need.least > need.whole) need.least = need.whole;
    return need;
}

/* The option without which all of the light has to be whole; NULL: it need not. */
static const char *find_hindrance(const struct lw_daemon_settings *s, const struct need *need) {
    if (need->least == need->whole) return NULL;
    if (!(s->entry->choice & LW_CHOICE_CELLS)) return "--solver cells";
    return s->light == LW_DAEMON_LIGHT_SEEN ? NULL : "--light seen";
}

/* Whether the budget of --memory is enough. */
static enum lw_status check_budget(const struct lw_solver_desc *desc, const struct need *need,
                                   const char *hindrance, uint64_t memory, struct lw_error *err) {
    if (need->whole <= memory) return LW_OK;
    if (hindrance)
        return lw_memory_forecast_refuse(err, desc, need->whole, " for their light", memory,
                                         "%s needs less, and --texels-per-metre gives fewer", hindrance);
    if (need->least <= memory) return LW_OK;
    return lw_memory_forecast_refuse(err, desc, need->least,
                                     need->least < need->whole ? " for their light even where it is coarse"
                                                               : " for their light",
                                     memory, "--texels-per-metre gives fewer");
}

/* Whether level 0 is whole. memory: what light may take */
static bool is_whole(const struct need *need, const char *hindrance, bool is_default, uint64_t memory) {
    if (hindrance || need->least == need->whole) return true;
    return need->whole <= (is_default && memory > WHOLE_MAX ? WHOLE_MAX : memory);
}

/* The default refuses nothing. */
static uint64_t default_budget(const struct need *need, const char *hindrance) {
    const uint64_t share = lw_memory_forecast_machine() / SHARE,
                   least = hindrance ? need->whole : need->least;
    return share > least ? share : least;
}

/* Bytes for finer tiles where no --memory is given. */
static uint64_t default_fine(bool whole, uint64_t left) {
    const uint64_t share = lw_memory_forecast_machine() / FINE_SHARE,
                   most = whole && share < FINE_MAX ? share : FINE_MAX;
    return left < most ? left : most;
}

enum lw_status lw_daemon_memory_choose(const struct lw_daemon_settings *settings,
                                       const struct lw_solver_desc *desc, uint32_t layers,
                                       struct lw_daemon_memory *out_memory, struct lw_error *err) {
    const bool is_default = settings->memory_mb == 0;
    const struct need need = find_need(desc, layers);
    const char *hindrance = find_hindrance(settings, &need);
    const uint64_t memory =
        is_default ? default_budget(&need, hindrance) : (uint64_t)settings->memory_mb * 1000000;
    const enum lw_status status = check_budget(desc, &need, hindrance, memory, err);
    if (status != LW_OK) return status;
    const bool whole = is_whole(&need, hindrance, is_default, memory);
    const uint64_t left = memory - (whole ? need.whole : need.sparse),
                   fine = is_default ? default_fine(whole, left) : left;
    /* else nobody asks for tiles */
    const bool is_followed = settings->light == LW_DAEMON_LIGHT_SEEN && (!whole || settings->detail);
    const uint64_t base = memory - left;
    *out_memory = (struct lw_daemon_memory){.is_sparse = !whole,
                                            .fine_tiles = is_followed ? count_fine(fine, need.fine_tile) : 0,
                                            .base_bytes = base,
                                            .tile_bytes = need.fine_tile,
                                            .limit_bytes = is_default ? base + fine : memory};
    if (!whole)
        lw_log(LW_LOG_INFO,
               "the light of %.2g M texels would take %.0f MB: where nobody looks it is a quarter as dense, "
               "and takes %.0f (--memory)",
               need.texels_m, mb(need.whole), mb(need.sparse + out_memory->fine_tiles * need.fine_tile));
    else if (is_followed && !out_memory->fine_tiles)
        lw_log(LW_LOG_WARNING, "%.0f MB leave no room for finer lightmaps (--memory)", mb(memory));
    return LW_OK;
}
