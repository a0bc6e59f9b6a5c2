#include "tests/bench/bench_runner.h"

#include "common/tile/tile_codec.h"
#include "server/solve/filter/denoise.h"
#include "server/solve/solvers.h"

enum lw_status bench_runner_init(struct bench_runner *runner, const struct lw_solver_desc *desc,
                                 const struct lw_pose *pose, struct lw_error *err) {
    enum lw_status status = lw_solvers_create(NULL, desc, pose, &runner->solver, err);
    if (status != LW_OK) return status;
    status = lw_publisher_create(&(struct lw_publisher_desc){.scene = desc->scene,
                                                             .atlas_map = desc->atlas_map,
                                                             .solver = runner->solver,
                                                             .target_error = 0.02f,
                                                             .noise_shown = LW_SOLVER_NOISE_SHOWN,
                                                             .codec = LW_TILE_CODEC_DCT,
                                                             .threads = desc->threads},
                                 &runner->publisher);
    return status == LW_OK ? LW_OK : lw_status_fail(err, status, "publisher");
}

void bench_runner_finish(struct bench_runner *runner) {
    lw_publisher_destroy(runner->publisher);
    if (runner->solver) runner->solver->ops->destroy(runner->solver);
}

enum lw_status bench_runner_frame(struct bench_runner *runner, const struct lw_pose *pose,
                                  const struct bench_meter_desc *meter, struct bench_meter_frame *out_cost,
                                  struct lw_error *err) {
    struct lw_publisher_stats published;
    struct lw_snapshot *snapshot = NULL;
    bench_meter_begin(meter);
    enum lw_status status =
        runner->solver->ops->frame(runner->solver, pose, ++runner->frames, &runner->solved, err);
    if (status == LW_OK)
        status = lw_publisher_publish(runner->publisher, pose, runner->frames, 0, 0,
                                      runner->solved.tiles_solved, &snapshot, &published);
    bench_meter_end(out_cost);
    lw_snapshot_unref(snapshot);
    return status;
}
