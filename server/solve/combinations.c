#include "server/solve/combinations.h"

#include "common/light/client_lights.h"

#include <math.h>

#define C(name) LW_CHOICE_##name
#define SHOTS   (C(UNDERSAMPLE) | C(WINDOW) | C(SUBDIVIDE) | C(DIRECTIONS) | C(VISIBILITY))

/* None of a row's first choices works with any of its second ones. */
static const struct {
    uint32_t these, those;
    const char *why;
} excluded[] = {
    {C(RADIOSITY) | C(VPL), C(SERVED), "it follows no changes, and is for lightwell-bake alone"},
    {C(RADIOSITY) | C(VPL), C(GROUPS), "it has one layer of light"},
    {C(RADIOSITY) | C(VPL), C(DIRECTIONAL), "it does not keep where light comes from"},
    {C(RADIOSITY) | C(VPL), C(TRACING_RANGE), "it has no probes"},
    {C(RADIOSITY) | C(VPL), C(BUDGET) | C(UNITS), "each of its frames lights all texels"},
    {C(RADIOSITY), C(DRAWN_SURFACES), "in it those shoot"},
    {C(CELLS) | C(VPL), SHOTS, "it has no patches that shoot: that is for \"radiosity\""},
    {C(CELLS) | C(RADIOSITY), C(VPL_TERMS), "it has no virtual point lights: that is for \"vpl\""},
    {C(SUBDIVIDE), C(UNDERSAMPLE) | C(DIRECTIONS) | C(VISIBILITY),
     "it has shooters of its own for each bounce"},
    {C(DIRECTIONS), C(UNDERSAMPLE), "it looks at no shooters"},
    {C(DIRECTIONS), C(VISIBILITY), "it knows no pairs"},
    {C(HALF), C(STEP_WIDEST), "it has no steps"},
    {C(STEP) | C(MANUAL), C(BUDGET), "--frame-budget-units is theirs, so that runs are repeatable"},
    {C(REAL), C(UNITS), "the real clock has --frame-budget-ms"},
    {C(BUDGET), C(UNITS), "a frame has one budget"},
    {C(RADIOSITY) | C(VPL) | C(GROUPS) | C(TRACING_RANGE) | C(BUDGET), C(RANKS),
     "solvers that share a scene exchange no light of it"},
    {C(ANIMATE), C(FREEZE), "the scene moves or does not"},
};

#define NAME(name, text) text,
static const char *const names[LW_CHOICE_COUNT] = {LW_CHOICES(NAME)};

const char *lw_combinations_name(enum lw_choice_index choice) { return names[choice]; }

uint32_t lw_combinations_of(const struct lw_solver_desc *desc) {
    const struct lw_radiosity_terms *terms = &desc->radiosity;
    const struct lw_client_lights *drawn = desc->client_lights;
    const struct {
        bool is;
        uint32_t choice;
    } list[] = {
        {lw_client_lights_any(drawn), C(SPLIT)},
        {drawn && drawn->drawn_materials, C(DRAWN_SURFACES)},
        {desc->light_groups != NULL, C(GROUPS)},
        {desc->directions, C(DIRECTIONAL)},
        {isfinite(desc->tracing_range_m) && desc->tracing_range_m > 0, C(TRACING_RANGE)},
        {desc->frame_budget_s > 0, C(BUDGET)},
        {desc->frame_budget_units > 0, C(UNITS)},
        {desc->ranks != NULL, C(RANKS)},
        {terms->undersample != LW_UNDERSAMPLE_NONE, C(UNDERSAMPLE)},
        {terms->window != 0, C(WINDOW)},
        {terms->subdivide > 0, C(SUBDIVIDE)},
        {terms->directions != 0, C(DIRECTIONS)},
        {terms->keeps_visibility, C(VISIBILITY)},
        {lw_vpl_terms_any(&desc->vpl), C(VPL_TERMS)},
    };
    uint32_t choices = 0;
    for (size_t i = 0; i < sizeof list / sizeof *list; i++)
        if (list[i].is) choices |= list[i].choice;
    return choices;
}

static const char *first_of(uint32_t choices) { return names[__builtin_ctz(choices)]; }

enum lw_status lw_combinations_check(uint32_t choices, struct lw_error *err) {
    for (size_t i = 0; i < sizeof excluded / sizeof *excluded; i++) {
        const uint32_t these = choices & excluded[i].these, those = choices & excluded[i].those;
        if (these && those)
            return lw_status_fail(err, LW_USAGE, "%s does not work with %s: %s", first_of(these),
                                  first_of(those), excluded[i].why);
    }
    return LW_OK;
}
