#include "server/bake/bake_memory.h"

#include "common/base/log.h"
#include "server/solve/coarse_scene.h"
#include "server/solve/memory_forecast.h"

enum lw_status lw_bake_memory_choose(const struct lw_solvers_entry *entry, const struct lw_solver_desc *desc,
                                     uint64_t memory_bytes, bool *out_by_tile, struct lw_error *err) {
    const uint64_t memory = memory_bytes ? memory_bytes : lw_memory_forecast_machine() / 4 * 3,
                   whole = lw_memory_forecast_whole(desc, 1), by_tile = lw_tile_by_tile_forecast(desc),
                   least = by_tile < whole ? by_tile : whole;
    *out_by_tile = whole > memory;
    if (whole <= memory) return LW_OK;
    if (!(entry->choice & LW_CHOICE_CELLS))
        return lw_memory_forecast_refuse(err, desc, whole, "", memory,
                                         "--solver %s holds all of them; cells lights them tile by tile",
                                         entry->name);
    if (least > memory)
        return lw_memory_forecast_refuse(err, desc, least, by_tile < whole ? " even tile by tile" : "",
                                         memory, "--texels-per-metre gives fewer");
    lw_log(LW_LOG_INFO, "%.2g M texels at once would take %.0f MB: tile by tile it is %.0f (--memory)",
           (double)lw_coarse_scene_count_texels(desc->scene) * 1e-6, (double)whole * 1e-6,
           (double)by_tile * 1e-6);
    return LW_OK;
}
