#include "client/control/ctl_tree.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>

#define SESSIONS  "lightwell_below_sessions"
#define AGE       "lightwell_below_light_age_seconds"
#define SENT      "lightwell_below_sent_bytes_per_second"
#define ABOVE     "lightwell_upstream_connected{address=\""
#define DEPTH_MAX 17u /* relays between a server and a client, and the server asked */
#define NAME_SIZE 40  /* columns of a name with its indent */

/* A copy of a label's value; NULL: there is no such label, or no memory. */
static char *label_of(const char *figure, const char *label) {
    char text[40];
    snprintf(text, sizeof text, "%s=\"", label);
    const char *at = strstr(figure, text), *end = at ? strchr(at + strlen(text), '"') : NULL;
    return end ? strndup(at + strlen(text), (size_t)(end - at) - strlen(text)) : NULL;
}

static uint64_t number_of(const char *figure, const char *label) {
    char *text = label_of(figure, label);
    const uint64_t number = text ? strtoull(text, NULL, 16) : 0;
    free(text);
    return number;
}

/* Another figure with the same labels. */
static double figure_of(const struct lw_ctl_figures *f, const char *name, const char *labels) {
    char text[300];
    snprintf(text, sizeof text, "%s%s", name, labels);
    return lw_ctl_figures_get(f, text);
}

static enum lw_status add(struct lw_ctl_tree *tree, const struct lw_ctl_figures *f,
                          const struct lw_ctl_figure *sessions, struct lw_error *err) {
    const char *labels = sessions->name + strlen(SESSIONS);
    struct lw_ctl_tree_node node = {.name = label_of(labels, "name"),
                                    .relay = number_of(labels, "relay"),
                                    .above = number_of(labels, "above"),
                                    .clients = sessions->value,
                                    .light_age_s = figure_of(f, AGE, labels),
                                    .sent_bytes_hz = figure_of(f, SENT, labels)};
    if (!node.name || !node.relay) {
        free(node.name);
        return lw_status_fail(err, LW_PROTOCOL, "no relay: %.100s", sessions->name);
    }
    tree->node[tree->count++] = node;
    return LW_OK;
}

/* A relay whose feeder is not listed is fed by the server asked, which does not list itself. Light is
 * at least as old as the feeder's. */
static void find_parents(struct lw_ctl_tree *tree) {
    for (uint32_t i = 1; i < tree->count; i++)
        for (uint32_t k = 1; k < tree->count; k++)
            if (k != i && tree->node[k].relay == tree->node[i].above) tree->node[i].parent = (int)k;
    for (uint32_t i = 1; i < tree->count; i++) {
        struct lw_ctl_tree_node *node = &tree->node[i];
        int at = (int)i;
        for (node->depth = 0; at && node->depth < DEPTH_MAX; node->depth++) {
            at = tree->node[at].parent;
            node->light_age_s = fmax(node->light_age_s, tree->node[at].light_age_s);
        }
        if (!at) continue;
        node->parent = 0; /* they say that they feed each other */
        node->depth = 1;
    }
    for (uint32_t i = 1; i < tree->count; i++) {
        struct lw_ctl_tree_node *parent = &tree->node[tree->node[i].parent];
        parent->clients = fmax(parent->clients - 1, 0);
    }
}

enum lw_status lw_ctl_tree_read(struct lw_ctl_tree *tree, const char *address,
                                const struct lw_ctl_figures *before, const struct lw_ctl_figures *now,
                                struct lw_error *err) {
    const double elapsed_s = fmax(1e-9 * (double)(now->as_of_ns - before->as_of_ns), 1e-3),
                 sent = lw_ctl_figures_get(now, "lightwell_sent_bytes_total") -
                        lw_ctl_figures_get(before, "lightwell_sent_bytes_total");
    *tree = (struct lw_ctl_tree){.node = calloc(now->count + 1, sizeof *tree->node),
                                 .frame = lw_ctl_figures_get(now, "lightwell_frame")};
    if (!tree->node || !(tree->node->name = strdup(address)))
        return lw_status_fail(err, LW_NO_MEMORY, "the tree of relays");
    tree->count = 1;
    tree->node->parent = -1;
    tree->node->clients = fmax(lw_ctl_figures_get(now, "lightwell_sessions") - 1, 0);
    tree->node->light_age_s = lw_ctl_figures_get(now, "lightwell_upstream_lost_seconds");
    tree->node->sent_bytes_hz = fmax(sent, 0) / elapsed_s;
    enum lw_status status = LW_OK;
    for (size_t i = 0; i < now->count && status == LW_OK; i++) {
        const struct lw_ctl_figure *figure = &now->figure[i];
        if (!tree->above && !strncmp(figure->name, ABOVE, strlen(ABOVE)))
            tree->above = label_of(figure->name, "address");
        if (!strncmp(figure->name, SESSIONS "{", strlen(SESSIONS) + 1)) status = add(tree, now, figure, err);
    }
    if (status == LW_OK) find_parents(tree);
    return status;
}

void lw_ctl_tree_finish(struct lw_ctl_tree *tree) {
    for (uint32_t i = 0; i < tree->count; i++) free(tree->node[i].name);
    free(tree->node);
    free(tree->above);
    *tree = (struct lw_ctl_tree){0};
}

static void write_line(const struct lw_ctl_tree_node *node, unsigned indent, FILE *stream) {
    const int room = NAME_SIZE - 2 * (int)indent;
    fprintf(stream, "%*s%-*s  clients %-6.0f %8.2f Mbit/s  ", 2 * (int)indent, "", room > 0 ? room : 0,
            node->name, node->clients, 8e-6 * node->sent_bytes_hz);
    if (node->light_age_s > 0)
        fprintf(stream, "light %.0f s old\n", node->light_age_s);
    else
        fprintf(stream, "light current\n");
}

static void write_below(struct lw_ctl_tree *tree, int parent, unsigned indent, FILE *stream) {
    for (uint32_t i = 1; i < tree->count; i++) {
        struct lw_ctl_tree_node *node = &tree->node[i];
        if (node->parent != parent || node->is_written) continue;
        node->is_written = true;
        write_line(node, indent, stream);
        write_below(tree, (int)i, indent + 1, stream);
    }
}

enum lw_status lw_ctl_tree_write(struct lw_ctl_tree *tree, FILE *stream) {
    if (tree->above) fprintf(stream, "%s\n", tree->above);
    write_line(tree->node, tree->above ? 1 : 0, stream);
    write_below(tree, 0, tree->above ? 2 : 1, stream);
    return ferror(stream) ? LW_IO : LW_OK;
}
