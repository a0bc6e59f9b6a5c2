#include "client/measure/sides/renderer.h"

static const struct {
    const char *name;
    bool per_user;
} stages[LW_STAGE_COUNT] = {
#define X(tag, name, per_user) {name, per_user},
    LW_STAGE_MAP(X)
#undef X
};

const char *lw_stage_name(enum lw_stage stage) { return stages[stage].name; }

bool lw_stage_is_per_user(enum lw_stage stage) { return stages[stage].per_user; }

void lw_cost_add(struct lw_cost *sum, const struct lw_cost *cost, double times) {
    for (int s = 0; s < LW_STAGE_COUNT; s++) sum->cpu_s[s] += cost->cpu_s[s] * times;
    sum->rays += cost->rays * times;
    sum->bytes += cost->bytes * times;
}

double lw_cost_total(const struct lw_cost *cost) {
    double total = 0;
    for (int s = 0; s < LW_STAGE_COUNT; s++) total += cost->cpu_s[s];
    return total;
}
