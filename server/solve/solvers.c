#include "server/solve/solvers.h"

#include "server/solve/cell_layer.h"
#include "server/solve/light_layers.h"
#include "server/solve/radiosity_solver.h"
#include "server/solve/vpl_solver.h"

#include <stdio.h>
#include <string.h>

static enum lw_status check_cells(const struct lw_solver_desc *desc, struct lw_error *err) {
    return lw_combinations_check(LW_CHOICE_CELLS | lw_combinations_of(desc), err);
}

static enum lw_status create_cells(const struct lw_solver_desc *desc, const struct lw_pose *pose,
                                   struct lw_solver **out_solver, struct lw_error *err) {
    enum lw_status status = check_cells(desc, err);
    if (status != LW_OK) return status;
    return desc->light_groups ? lw_light_layers_create(desc, pose, out_solver, err)
                              : lw_cell_layer_create(NULL, desc, pose, out_solver, err);
}

#define BOTH_FORMS (1u << LW_TILE_CHANNEL_FULL | 1u << LW_TILE_CHANNEL_SPLIT)
#define DIRECTIONS (1u << LW_TILE_CHANNEL_DIRECTION | 1u << LW_TILE_CHANNEL_DIRECTION_SPLIT)

static const struct lw_solvers_entry table[] = {
    {"cells", "radiance cells, by blocks of texels (Vandersanden 2023)", LW_CHOICE_CELLS,
     BOTH_FORMS | DIRECTIONS, check_cells, create_cells},
    {"radiosity", "every texel shoots at every other; for bakes (Kahl 2023)", LW_CHOICE_RADIOSITY, BOTH_FORMS,
     lw_radiosity_solver_check, lw_radiosity_solver_create},
    {"vpl", "virtual point lights, in sets; for bakes (Tonna 2019)", LW_CHOICE_VPL, BOTH_FORMS,
     lw_vpl_solver_check, lw_vpl_solver_create},
};

const struct lw_solvers_entry *lw_solvers_at(unsigned index) {
    return index < sizeof table / sizeof *table ? &table[index] : NULL;
}

void lw_solvers_list(char *out_text, size_t size) {
    const struct lw_solvers_entry *entry;
    size_t length = 0;
    if (size) *out_text = '\0';
    for (unsigned i = 0; (entry = lw_solvers_at(i)) && length < size; i++)
        length += (size_t)snprintf(out_text + length, size - length, "%s%s%s", i ? ", " : "", entry->name,
                                   i ? "" : " (default)");
}

enum lw_status lw_solvers_find(const char *name, const struct lw_solvers_entry **out_entry,
                               struct lw_error *err) {
    const struct lw_solvers_entry *entry;
    char names[256];
    for (unsigned i = 0; (entry = lw_solvers_at(i)); i++)
        if (!name || strcmp(name, entry->name) == 0) {
            *out_entry = entry;
            return LW_OK;
        }
    lw_solvers_list(names, sizeof names);
    return lw_status_fail(err, LW_USAGE, "there is no solver \"%s\"; there are: %s", name, names);
}

enum lw_status lw_solvers_create(const char *name, const struct lw_solver_desc *desc,
                                 const struct lw_pose *pose, struct lw_solver **out_solver,
                                 struct lw_error *err) {
    const struct lw_solvers_entry *entry;
    enum lw_status status = lw_solvers_find(name, &entry, err);
    return status == LW_OK ? entry->create(desc, pose, out_solver, err) : status;
}
