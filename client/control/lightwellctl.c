/* lightwellctl.c: changes the scene of a running lightwelld. */
#include "client/control/ctl_command.h"
#include "client/control/ctl_figures.h"
#include "client/control/ctl_names.h"
#include "client/control/ctl_tree.h"
#include "client/lib/package_cache.h"
#include "common/base/clock.h"
#include "common/base/folders.h"
#include "common/base/log.h"
#include "common/base/options.h"
#include "proto/message.h"

#include <inttypes.h>
#include <jansson.h>
#include <limits.h>
#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#define POLL_MS 50u

struct ctl {
    const char *address, *cache_folder; /* "": none */
    struct lw_access_options access_options;
    struct lw_access access;
    char host[256];
    uint16_t port;
    bool json, batch, watch;
    char default_cache_folder[PATH_MAX];
    double timeout_s;
    uint64_t deadline_ns;
    const char **word; /* the commands', "--" between them */
    size_t word_count;
    struct lw_client *client;
    struct lw_ctl_command_state state;
    struct lw_scene_change *change; /* LW_CLIENT_CHANGES_MAX */
    size_t change_count;
};

/* ---- the command line ---- */

/* Whether it can be no command: HOST:PORT, or a PORT alone. */
static bool is_address(const char *text) {
    return strchr(text, ':') || strspn(text, "0123456789") == strlen(text);
}

static bool takes_value(const char *option) {
    return strcmp(option, "--timeout") == 0 || strcmp(option, "--cache") == 0 ||
           strcmp(option, "--token-file") == 0 || strcmp(option, "--ca") == 0;
}

/* Options may stand anywhere, negative numbers and "--" belong to the commands: these are taken out before
 * the table sees the rest, which is options and the address. */
static enum lw_status parse(struct ctl *c, int argc, char **argv, bool *out_done, struct lw_error *err) {
    const char *address[1] = {LW_OPTIONS_ADDRESS};
    char **rest = calloc((size_t)argc + 1, sizeof *rest);
    c->word = calloc((size_t)argc + 1, sizeof *c->word);
    if (!rest || !c->word) {
        free(rest);
        return lw_status_fail(err, LW_NO_MEMORY, "the command line");
    }
    int rest_count = 0;
    bool addressed = false;
    for (int i = 0; i < argc; i++) {
        const bool option = strncmp(argv[i], "--", 2) == 0 && argv[i][2];
        if (i > 0 && !option && (addressed || lw_ctl_command_is(argv[i]))) {
            c->word[c->word_count++] = argv[i];
            addressed = true; /* or meant for the default */
        } else {
            rest[rest_count++] = argv[i];
            addressed |= i > 0 && !option;
        }
        if (option && takes_value(argv[i]) && i + 1 < argc) rest[rest_count++] = argv[++i];
    }
    char about[4096];
    snprintf(
        about, sizeof about,
        "Changes the scene of a lightwelld on this machine while it runs, for all who look at it, and prints "
        "the frame that shows it first. Several commands with -- between them are one change: all of it in "
        "one frame, or nothing.\n%s",
        lw_ctl_command_help());
    const struct lw_option table[] = {
        {"batch", NULL, "read the commands from stdin, one a line; all of them are one change",
         LW_OPTION_FLAG, &c->batch, 0, 0, NULL},
        {"cache", "FOLDER",
         "keep scene packages there, so that none is downloaded twice; \"\": nowhere (default "
         "$XDG_CACHE_HOME/lightwell or ~/.cache/lightwell)",
         LW_OPTION_STRING, &c->cache_folder, 0, 0, NULL},
        {"json", NULL, "print one JSON object", LW_OPTION_FLAG, &c->json, 0, 0, NULL},
        {"watch", NULL, "stats: a line a second, until Ctrl-C or the server's end", LW_OPTION_FLAG, &c->watch,
         0, 0, NULL},
        LW_ACCESS_OPTIONS(&c->access_options),
        {"timeout", "SECONDS", "give up after that time (default {})", LW_OPTION_REAL, &c->timeout_s, 0.001,
         1e6, NULL},
    };
    const struct lw_options options = {
        .program = "lightwellctl",
        .synopsis = "[HOST:PORT | HOST | PORT | unix:PATH] COMMAND [-- COMMAND]... [OPTIONS]",
        .about = about,
        .table = table,
        .count = sizeof table / sizeof *table,
        .positional = address,
        .positional_max = 1};
    enum lw_status status = lw_options_parse(&options, rest_count, rest, NULL, out_done, err);
    free(rest);
    if (status != LW_OK || *out_done) return status;
    if (c->batch && c->word_count)
        return lw_status_fail(err, LW_USAGE,
                              "--batch takes its commands from stdin, not from the command line");
    c->address = address[0];
    if (!c->batch && (!c->word_count || !lw_ctl_command_is(c->word[0]))) {
        /* "lihgt lamp off" misspells its first word, "HOST lsit" its second */
        const bool first = !is_address(c->address) && (!c->word_count || lw_ctl_command_near(c->address));
        if (first || c->word_count) return lw_ctl_command_fail_unknown(first ? c->address : c->word[0], err);
    }
    status = lw_access_address(c->address, c->host, sizeof c->host, &c->port, err);
    if (status == LW_OK && !c->batch && !c->word_count)
        return lw_status_fail(err, LW_USAGE, "a command is missing: lightwellctl --help lists them");
    return status == LW_OK ? lw_access_read(&c->access_options, &c->access, err) : status;
}

/* ---- the server ---- */

static enum lw_status poll_until_deadline(struct ctl *c, const char *what, struct lw_error *err) {
    if (lw_clock_ns() > c->deadline_ns)
        return lw_status_fail(err, LW_TIMED_OUT, "%s: %s has not come within %g s (--timeout)", c->address,
                              what, c->timeout_s);
    return lw_client_poll(c->client, POLL_MS, err);
}

/* Until the server has welcomed us. */
static enum lw_status connect_to_server(struct ctl *c, bool operate, struct lw_error *err) {
    const double connect_s = c->timeout_s < 5 ? c->timeout_s : 5;
    return lw_client_create(
        &(struct lw_client_desc){
            .host = c->host,
            .port = c->port,
            .access = &c->access,
            .name = "lightwellctl",
            .timeout_ms = (unsigned)(connect_s * 1e3) + 1,
            .cache_folder = *c->cache_folder ? c->cache_folder : NULL,
            .wants_nothing = true,
            .control = true,
            .watch = {.damaged = lw_package_cache_warn, .unkept = lw_package_cache_warn_unkept},
            .operate = operate},
        &c->client, err);
}

/* Until it is known what there is, and where it is now. */
static enum lw_status await_scene(struct ctl *c, struct lw_error *err) {
    enum lw_status status = LW_OK;
    struct lw_client_stats stats = {0};
    while (status == LW_OK && (!lw_client_scene(c->client) || !stats.frame)) {
        status = poll_until_deadline(c, lw_client_scene(c->client) ? "the first frame" : "the scene", err);
        lw_client_get_stats(c->client, &stats);
    }
    if (status == LW_OK && lw_ctl_command_state_init(&c->state, c->client) != LW_OK)
        status = lw_status_fail(err, LW_NO_MEMORY, "the scene");
    return status;
}

/* ---- list ---- */

static json_t *vector_of(struct lw_vec3 v) {
    return json_pack("[f, f, f]", (double)v.x, (double)v.y, (double)v.z);
}

static struct lw_vec3 rgb_of(const float *rgb) { return lw_vec3(rgb[0], rgb[1], rgb[2]); }

static const char *const kind_of_light[] = {
    [LW_LIGHT_POINT] = "point", [LW_LIGHT_SPOT] = "spot", [LW_LIGHT_DIRECTIONAL] = "directional"};

static bool is_spare(const struct ctl *c, uint32_t object) {
    return lw_client_object_state(c->client, object) == LW_CLIENT_OBJECT_SPARE;
}

/* A mesh's objects that are there, and the spares that may be added. */
struct count {
    uint32_t objects, spares;
};

/* Per mesh; the caller frees. NULL: no memory. */
static struct count *count_objects(const struct ctl *c) {
    const struct lw_scene *scene = c->state.scene;
    struct count *count = calloc(scene->mesh_count + 1ul, sizeof *count);
    for (uint32_t i = 0; count && i < scene->object_count; i++) {
        struct count *of_mesh = &count[scene->object[i].mesh];
        *(is_spare(c, i) ? &of_mesh->spares : &of_mesh->objects) += 1;
    }
    return count;
}

/* NULL: no memory. */
static json_t *list_json(const struct ctl *c) {
    struct count *count = count_objects(c);
    if (!count) return NULL;
    const struct lw_scene *scene = c->state.scene;
    struct lw_client_stats stats;
    lw_client_get_stats(c->client, &stats);
    json_t *objects = json_array(), *meshes = json_array(), *lights = json_array(), *materials = json_array(),
           *cameras = json_array();
    for (uint32_t i = 0; i < scene->object_count; i++) {
        const struct lw_affine *t = &c->state.object_to_world[i];
        json_t *transform = json_array();
        for (int k = 0; k < 12; k++) json_array_append_new(transform, json_real((double)t->m[k / 4][k % 4]));
        json_array_append_new(objects,
                              json_pack("{s:i, s:s, s:i, s:o, s:b, s:b, s:o}", "number", (int)i, "name",
                                        scene->object[i].name, "mesh", (int)scene->object[i].mesh, "middle",
                                        vector_of(lw_ctl_command_middle(scene, i, t)), "hidden",
                                        lw_client_object_state(c->client, i) == LW_CLIENT_OBJECT_HIDDEN,
                                        "spare", is_spare(c, i), "object_to_world", transform));
    }
    for (uint32_t i = 0; i < scene->mesh_count; i++)
        json_array_append_new(meshes,
                              json_pack("{s:i, s:s, s:i, s:i}", "number", (int)i, "name", scene->mesh[i].name,
                                        "objects", (int)count[i].objects, "spares", (int)count[i].spares));
    free(count);
    for (uint32_t i = 0; i < scene->light_count; i++) {
        const struct lw_client_light *l = &c->state.light[i];
        json_array_append_new(lights,
                              json_pack("{s:i, s:s, s:s, s:o, s:o, s:o}", "number", (int)i, "name",
                                        scene->light[i].name, "kind", kind_of_light[scene->light[i].kind],
                                        "intensity", vector_of(l->intensity), "position",
                                        vector_of(l->position_ws), "direction", vector_of(l->direction_ws)));
    }
    for (uint32_t i = 0; i < scene->material_count; i++)
        json_array_append_new(
            materials, json_pack("{s:i, s:s, s:o, s:o}", "number", (int)i, "name", scene->material[i].name,
                                 "albedo", vector_of(rgb_of(scene->material[i].base_colour)), "emission",
                                 vector_of(rgb_of(scene->material[i].emission))));
    for (uint32_t i = 0; i < scene->camera_count; i++)
        json_array_append_new(cameras,
                              json_pack("{s:i, s:s}", "number", (int)i, "name", scene->camera[i].name));
    return json_pack("{s:I, s:f, s:o, s:o, s:o, s:o, s:o, s:o}", "frame", (json_int_t)stats.frame, "time_s",
                     stats.time_s, "sky", vector_of(rgb_of(scene->sky)), "objects", objects, "meshes", meshes,
                     "lights", lights, "materials", materials, "cameras", cameras);
}

static void list_text(const struct ctl *c, const struct count *count) {
    const struct lw_scene *scene = c->state.scene;
    for (uint32_t i = 0; i < scene->object_count; i++) {
        if (is_spare(c, i)) continue;
        const struct lw_vec3 p = lw_ctl_command_middle(scene, i, &c->state.object_to_world[i]);
        printf("object   #%-5u %-24s at %.3f %.3f %.3f%s\n", i, scene->object[i].name, (double)p.x,
               (double)p.y, (double)p.z,
               lw_client_object_state(c->client, i) == LW_CLIENT_OBJECT_HIDDEN ? ", hidden" : "");
    }
    for (uint32_t i = 0; i < scene->mesh_count; i++)
        printf("mesh     #%-5u %-24s objects %u, spares %u\n", i, scene->mesh[i].name, count[i].objects,
               count[i].spares);
    for (uint32_t i = 0; i < scene->light_count; i++) {
        const struct lw_client_light *l = &c->state.light[i];
        printf("light    #%-5u %-24s %s, intensity %g %g %g", i, scene->light[i].name,
               kind_of_light[scene->light[i].kind], (double)l->intensity.x, (double)l->intensity.y,
               (double)l->intensity.z);
        if (scene->light[i].kind != LW_LIGHT_DIRECTIONAL)
            printf(", at %.3f %.3f %.3f", (double)l->position_ws.x, (double)l->position_ws.y,
                   (double)l->position_ws.z);
        printf("\n");
    }
    for (uint32_t i = 0; i < scene->material_count; i++) {
        const struct lw_material *m = &scene->material[i];
        printf("material #%-5u %-24s albedo %g %g %g, emission %g %g %g\n", i, m->name,
               (double)m->base_colour[0], (double)m->base_colour[1], (double)m->base_colour[2],
               (double)m->emission[0], (double)m->emission[1], (double)m->emission[2]);
    }
    for (uint32_t i = 0; i < scene->camera_count; i++)
        printf("camera   #%-5u %s\n", i, scene->camera[i].name);
}

/* ---- changes ---- */

static enum lw_status add_command(struct ctl *c, const char *const *word, size_t count,
                                  struct lw_error *err) {
    if (c->change_count == LW_CLIENT_CHANGES_MAX)
        return lw_status_fail(err, LW_USAGE, "over %u commands: no update holds more", LW_CLIENT_CHANGES_MAX);
    return lw_ctl_command_parse(&c->state, word, count, &c->change[c->change_count++], err);
}

static enum lw_status read_command_line(struct ctl *c, struct lw_error *err) {
    enum lw_status status = LW_OK;
    for (size_t first = 0, i = 0; i <= c->word_count && status == LW_OK; i++) {
        if (i < c->word_count && strcmp(c->word[i], "--") != 0) continue;
        status = add_command(c, c->word + first, i - first, err);
        first = i + 1;
    }
    return status;
}

static enum lw_status read_batch(struct ctl *c, struct lw_error *err) {
    char *line = NULL;
    size_t capacity = 0;
    enum lw_status status = LW_OK;
    for (unsigned number = 1; status == LW_OK && getline(&line, &capacity, stdin) >= 0; number++) {
        const char *word[LW_CTL_COMMAND_WORDS_MAX];
        size_t count;
        status = lw_ctl_command_split(line, word, &count, err);
        if (status == LW_OK && count) status = add_command(c, word, count, err);
        if (status != LW_OK) lw_status_context(err, "line %u", number);
    }
    if (status == LW_OK && ferror(stdin)) status = lw_status_fail(err, LW_IO, "cannot read stdin");
    free(line);
    return status;
}

static enum lw_status await_answer(struct ctl *c, struct lw_client_answer *out, struct lw_error *err) {
    enum lw_status status = lw_client_update(c->client, c->change, c->change_count, NULL, err);
    while (status == LW_OK && !lw_client_next_answer(c->client, out))
        status = poll_until_deadline(c, "the answer", err);
    return status;
}

static enum lw_status print_json(json_t *json, struct lw_error *err) {
    int failed = json ? json_dumpf(json, stdout, JSON_REAL_PRECISION(9)) : -1;
    json_decref(json);
    if (failed || putchar('\n') == EOF || fflush(stdout))
        return lw_status_fail(err, LW_IO, "cannot write to stdout");
    return LW_OK;
}

static json_t *answer_json(const struct ctl *c, const struct lw_client_answer *answer) {
    json_t *added = json_array();
    for (size_t i = 0; i < answer->added_count; i++)
        json_array_append_new(added, json_integer((json_int_t)answer->added[i]));
    return json_pack("{s:i, s:I, s:i, s:i, s:o, s:s}", "code", (int)answer->code, "frame",
                     (json_int_t)answer->frame, "changes", (int)c->change_count, "change",
                     (int)answer->change, "added", added, "text", answer->text);
}

static void print_answer(const struct ctl *c, const struct lw_client_answer *answer) {
    printf("frame %" PRIu64 ": %zu change%s\n", answer->frame, c->change_count,
           c->change_count == 1 ? "" : "s");
    for (size_t i = 0; i < answer->added_count; i++) {
        const uint32_t o = answer->added[i];
        printf("added    #%-5u %s\n", o,
               o < c->state.scene->object_count ? c->state.scene->object[o].name : "");
    }
}

static enum lw_status change_scene(struct ctl *c, struct lw_error *err) {
    struct lw_client_answer answer;
    enum lw_status status = c->batch ? read_batch(c, err) : read_command_line(c, err);
    if (status == LW_OK) status = await_answer(c, &answer, err);
    if (status != LW_OK) return status;
    if (c->json) status = print_json(answer_json(c, &answer), err);
    if (status == LW_OK && answer.code)
        return lw_status_fail(err, answer.code == LW_SCENE_CHANGE_BUSY ? LW_UNAVAILABLE : LW_BAD_DATA,
                              "command %u: %s: nothing was changed", answer.change + 1, answer.text);
    if (status == LW_OK && !c->json) print_answer(c, &answer);
    return status;
}

/* Whether the command line is this question and nothing else. */
static bool asks(const struct ctl *c, const char *question) {
    return !c->batch && c->word_count == 1 && strcmp(c->word[0], question) == 0;
}

/* A line for lightwelld's --tokens. */
static enum lw_status print_token(const struct ctl *c, struct lw_error *err) {
    const char *role = c->word_count == 2 ? c->word[1] : "";
    if (strcmp(role, "view") != 0 && strcmp(role, "control") != 0)
        return lw_status_fail(err, LW_USAGE, "token: say of which role: token view, or token control");
    struct lw_token token;
    char text[LW_TOKEN_TEXT_SIZE];
    const enum lw_status status = lw_token_make(&token, err);
    if (status != LW_OK) return status;
    lw_token_format(&token, text);
    printf("%s %s\n", role, text);
    return fflush(stdout) ? lw_status_fail(err, LW_IO, "cannot write to stdout") : LW_OK;
}

static enum lw_status print_status(const struct ctl *c, struct lw_error *err) {
    if (c->json) return print_json(json_pack("{s:s, s:b}", "address", c->address, "serving", true), err);
    printf("%s: serving\n", c->address);
    return fflush(stdout) ? lw_status_fail(err, LW_IO, "cannot write to stdout") : LW_OK;
}

/* ---- as an operator ---- */

static enum lw_status fail_unknown(const struct ctl *c, struct lw_error *err) {
    return lw_status_fail(err, LW_UNAVAILABLE, "%s does not know that question: is it an older lightwelld?",
                          c->address);
}

static enum lw_status ask_figures(struct ctl *c, struct lw_ctl_figures *out, struct lw_error *err) {
    uint32_t code = 0;
    char *text = NULL;
    c->deadline_ns = lw_clock_ns() + (uint64_t)(c->timeout_s * 1e9);
    enum lw_status status = lw_client_ask(c->client, LW_ASK_STATS, 0, err);
    while (status == LW_OK && !lw_client_take_report(c->client, &code, &text))
        status = poll_until_deadline(c, "the answer", err);
    if (status == LW_OK && !code) return lw_ctl_figures_read(out, text, lw_clock_ns(), err);
    free(text);
    return status == LW_OK ? fail_unknown(c, err) : status;
}

static enum lw_status print_figures(const struct ctl *c, const struct lw_ctl_figures *before,
                                    const struct lw_ctl_figures *now, struct lw_error *err) {
    char text[2048];
    if (c->json) {
        json_t *object = json_object();
        for (size_t i = 0; object && i < now->count; i++)
            if (isfinite(now->figure[i].value)) /* JSON has no other numbers */
                json_object_set_new(object, now->figure[i].name, json_real(now->figure[i].value));
        return print_json(object, err);
    }
    if (before)
        lw_ctl_figures_line(before, now, text, sizeof text);
    else
        lw_ctl_figures_table(now, text, sizeof text);
    const bool failed = printf("%s%s", text, before ? "\n" : "") < 0 || fflush(stdout);
    return failed ? lw_status_fail(err, LW_IO, "cannot write to stdout") : LW_OK;
}

static json_t *tree_json(const struct lw_ctl_tree *tree) {
    json_t *servers = json_array();
    for (uint32_t i = 0; i < tree->count; i++) {
        const struct lw_ctl_tree_node *n = &tree->node[i];
        json_array_append_new(servers, json_pack("{s:s, s:i, s:f, s:f, s:f}", "name", n->name, "fed_by",
                                                 n->parent, "clients", n->clients, "light_age_s",
                                                 n->light_age_s, "sent_bytes_per_s", n->sent_bytes_hz));
    }
    return json_pack("{s:s?, s:f, s:o}", "above", tree->above, "frame", tree->frame, "servers", servers);
}

/* The readings are a second apart: what the server itself sends is their difference. */
static enum lw_status print_tree(struct ctl *c, struct lw_error *err) {
    struct lw_ctl_figures before = {0}, now = {0};
    enum lw_status status = ask_figures(c, &before, err);
    while (status == LW_OK && lw_clock_ns() < before.as_of_ns + 1000000000u)
        status = lw_client_poll(c->client, POLL_MS, err);
    if (status == LW_OK) status = ask_figures(c, &now, err);
    struct lw_ctl_tree tree = {0};
    if (status == LW_OK) status = lw_ctl_tree_read(&tree, c->address, &before, &now, err);
    if (status == LW_OK && c->json)
        status = print_json(tree_json(&tree), err);
    else if (status == LW_OK && (lw_ctl_tree_write(&tree, stdout) != LW_OK || fflush(stdout)))
        status = lw_status_fail(err, LW_IO, "cannot write to stdout");
    lw_ctl_tree_finish(&tree);
    lw_ctl_figures_finish(&before);
    lw_ctl_figures_finish(&now);
    return status;
}

/* Once, or each second until the server ends. */
static enum lw_status print_stats(struct ctl *c, struct lw_error *err) {
    struct lw_ctl_figures before = {0}, now = {0};
    enum lw_status status = ask_figures(c, &now, err);
    if (status == LW_OK && (!c->watch || c->json)) status = print_figures(c, NULL, &now, err);
    while (status == LW_OK && c->watch) {
        const uint64_t next_ns = now.as_of_ns + 1000000000u;
        lw_ctl_figures_finish(&before);
        before = now;
        now = (struct lw_ctl_figures){0};
        while (status == LW_OK && lw_clock_ns() < next_ns) status = lw_client_poll(c->client, POLL_MS, err);
        if (status == LW_OK) status = ask_figures(c, &now, err);
        if (status == LW_OK) status = print_figures(c, &before, &now, err);
    }
    lw_ctl_figures_finish(&before);
    lw_ctl_figures_finish(&now);
    return status;
}

/* drain, drain SECONDS */
static enum lw_status read_drain(const struct ctl *c, uint32_t *out_return_after_ms, struct lw_error *err) {
    char *end = NULL;
    const double after_s = c->word_count == 2 ? strtod(c->word[1], &end) : 0;
    if (c->word_count > 2 || (end && (*end || end == c->word[1])) || !(after_s >= 0 && after_s <= 3600))
        return lw_status_fail(
            err, LW_USAGE,
            "drain: say nothing more, or in how many seconds (0 to 3600) clients are to come back");
    *out_return_after_ms = (uint32_t)lround(1e3 * after_s);
    return LW_OK;
}

/* Until the server has ended our session, as it does all others. */
static enum lw_status drain(struct ctl *c, uint32_t return_after_ms, struct lw_error *err) {
    uint32_t code = 0;
    char *text = NULL;
    struct lw_error end_of_session = {0};
    enum lw_status status = lw_client_ask(c->client, LW_ASK_DRAIN, return_after_ms, err), end = LW_OK;
    while (status == LW_OK && end == LW_OK && !code) {
        if (lw_clock_ns() > c->deadline_ns)
            return lw_status_fail(err, LW_TIMED_OUT, "%s: it has not ended within %g s (--timeout)",
                                  c->address, c->timeout_s);
        end = lw_client_poll(c->client, POLL_MS, &end_of_session);
        if (lw_client_take_report(c->client, &code, &text)) free(text);
    }
    if (status != LW_OK) return status;
    if (code) return fail_unknown(c, err);
    if (end != LW_CLOSED) return lw_status_fail(err, end, "%s", end_of_session.text);
    if (c->json) return print_json(json_pack("{s:s, s:b}", "address", c->address, "drained", true), err);
    printf("%s: drained\n", c->address);
    return fflush(stdout) ? lw_status_fail(err, LW_IO, "cannot write to stdout") : LW_OK;
}

static enum lw_status run(struct ctl *c, struct lw_error *err) {
    c->deadline_ns = lw_clock_ns() + (uint64_t)(c->timeout_s * 1e9);
    c->change = calloc(LW_CLIENT_CHANGES_MAX, sizeof *c->change);
    if (!c->change) return lw_status_fail(err, LW_NO_MEMORY, "changes");
    const bool drains = !c->batch && c->word_count && strcmp(c->word[0], "drain") == 0;
    uint32_t return_after_ms = 0;
    if (drains && read_drain(c, &return_after_ms, err) != LW_OK) return err->status;
    if (c->watch && !asks(c, "stats")) return lw_status_fail(err, LW_USAGE, "--watch is for stats alone");
    const bool operates = drains || asks(c, "stats") || asks(c, "tree");
    enum lw_status status = connect_to_server(c, operates, err);
    if (status == LW_OK && drains) return drain(c, return_after_ms, err);
    if (status == LW_OK && asks(c, "stats")) return print_stats(c, err);
    if (status == LW_OK && asks(c, "tree")) return print_tree(c, err);
    if (status == LW_OK && asks(c, "status")) return print_status(c, err);
    if (status == LW_OK) status = await_scene(c, err);
    if (status != LW_OK) return status;
    if (!asks(c, "list")) return change_scene(c, err);
    if (c->json) return print_json(list_json(c), err);
    struct count *count = count_objects(c);
    if (!count) return lw_status_fail(err, LW_NO_MEMORY, "the list");
    list_text(c, count);
    free(count);
    return fflush(stdout) ? lw_status_fail(err, LW_IO, "cannot write to stdout") : LW_OK;
}

int main(int argc, char **argv) {
    struct ctl c = {.timeout_s = 30};
    struct lw_error err = {0};
    bool done = false;
    lw_log_init("lightwellctl", LW_LOG_INFO);
    (void)lw_folders_cache(c.default_cache_folder, sizeof c.default_cache_folder);
    c.cache_folder = c.default_cache_folder;
    enum lw_status status = parse(&c, argc, argv, &done, &err);
    const bool makes_token = c.word_count && strcmp(c.word[0], "token") == 0;
    if (status == LW_OK && !done) status = makes_token ? print_token(&c, &err) : run(&c, &err);
    lw_ctl_command_state_finish(&c.state);
    lw_client_destroy(c.client);
    free(c.change);
    free(c.word);
    return status == LW_OK ? 0 : lw_log_failure(&err);
}
