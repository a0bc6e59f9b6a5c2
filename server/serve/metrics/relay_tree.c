#include "server/serve/metrics/relay_tree.h"

#include "common/base/invariant.h"
#include "server/serve/metrics/exposition.h"

#include <inttypes.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#define HEX    "0123456789abcdef"
#define DIGITS "0123456789"
/* Names have no blank, and nothing that a metric's label would escape. */
#define LETTERS "abcdefghijklmnopqrstuvwxyzABCDEFGHIJKLMNOPQRSTUVWXYZ" DIGITS ".:-_[]/%"

enum lw_status lw_relay_tree_init(struct lw_relay_tree *tree) {
    *tree = (struct lw_relay_tree){.node = calloc(2 * LW_RELAY_TREE_MAX, sizeof *tree->node)};
    if (!tree->node) return LW_NO_MEMORY;
    tree->outside = tree->node + LW_RELAY_TREE_MAX;
    uv_mutex_init(&tree->mutex); /* glibc's initialisers cannot fail */
    return LW_OK;
}

void lw_relay_tree_finish(struct lw_relay_tree *tree) {
    if (tree->node) uv_mutex_destroy(&tree->mutex);
    free(tree->node);
    *tree = (struct lw_relay_tree){0};
}

/* ---- reports ---- */

void lw_relay_tree_name(char dst[LW_MESSAGE_NAME_MAX + 1], const char *text) {
    snprintf(dst, LW_MESSAGE_NAME_MAX + 1, "%s", *text ? text : "_");
    for (char *c = dst; *(c += strspn(c, LETTERS));) *c = '_';
}

/* The next word of a line: of these characters, `most` at most, ended by `end`. NULL: there is none. */
static const char *read_word(const char **at, const char *of, size_t most, char end) {
    const char *word = *at;
    const size_t length = strspn(word, of);
    if (!length || length > most || word[length] != end) return NULL;
    *at = word + length + 1;
    return word;
}

static bool read_number(const char **at, uint64_t *out) {
    const char *word = read_word(at, DIGITS, 18, ' ');
    if (word) *out = strtoull(word, NULL, 10);
    return word;
}

static bool read_line(const char **at, struct lw_relay_tree_node *out) {
    struct lw_relay_tree_node node = {0};
    const char *relay = read_word(at, HEX, 16, ' '), *above = relay ? read_word(at, HEX, 16, ' ') : NULL;
    if (!above || !read_number(at, &node.sessions) || !read_number(at, &node.light_age_ms) ||
        !read_number(at, &node.sent_bytes_hz))
        return false;
    const char *name = read_word(at, LETTERS, LW_MESSAGE_NAME_MAX, '\n');
    if (!name) return false;
    node.relay = strtoull(relay, NULL, 16);
    node.above = strtoull(above, NULL, 16);
    memcpy(node.name, name, (size_t)(*at - 1 - name));
    *out = node;
    return node.relay;
}

enum lw_status lw_relay_tree_read(const uint8_t *data, size_t size, struct lw_relay_tree_node *out_node,
                                  uint32_t capacity, uint32_t *out_count, struct lw_error *err) {
    if (size > LW_RELAY_TREE_TEXT_MAX || (size && memchr(data, '\0', size)))
        return lw_status_fail(err, LW_PROTOCOL, "message REPORT: it is no list of relays");
    char *text = malloc(size + 1);
    if (!text) return lw_status_fail(err, LW_NO_MEMORY, "message REPORT: out of memory");
    if (size) memcpy(text, data, size);
    text[size] = '\0';
    uint32_t count = 0;
    enum lw_status status = LW_OK;
    for (const char *at = text; *at && status == LW_OK; count += status == LW_OK)
        if (count == capacity || !read_line(&at, &out_node[count]))
            status =
                lw_status_fail(err, LW_PROTOCOL, "message REPORT: line %u is none of a relay", count + 1);
    free(text);
    if (status == LW_OK) *out_count = count;
    return status;
}

size_t lw_relay_tree_write(const struct lw_relay_tree_node *node, uint32_t count, char *dst,
                           size_t dst_size) {
    size_t size = 0;
    for (uint32_t i = 0; i < count; i++) {
        const struct lw_relay_tree_node *n = &node[i];
        const int length = snprintf(
            dst + size, dst_size - size, "%" PRIx64 " %" PRIx64 " %" PRIu64 " %" PRIu64 " %" PRIu64 " %s\n",
            n->relay, n->above, n->sessions, n->light_age_ms, n->sent_bytes_hz, n->name);
        if (length < 0 || (size_t)length >= dst_size - size) break;
        size += (size_t)length;
    }
    return size;
}

/* ---- of a server ---- */

uint32_t lw_relay_tree_join(struct lw_relay_tree_node *node, uint32_t count, uint32_t capacity,
                            const struct lw_relay_tree_node *more, uint32_t more_count) {
    LW_INVARIANT(count <= capacity);
    for (uint32_t i = 0; i < more_count && count < capacity; i++) {
        uint32_t same = 0;
        while (same < count && node[same].relay != more[i].relay) same++;
        if (same == count) node[count++] = more[i];
    }
    return count;
}

void lw_relay_tree_set_outside(struct lw_relay_tree *tree, const struct lw_relay_tree_node *node,
                               uint32_t count) {
    LW_INVARIANT(count <= LW_RELAY_TREE_MAX);
    uv_mutex_lock(&tree->mutex);
    if (count) memcpy(tree->outside, node, count * sizeof *node);
    tree->outside_count = count;
    uv_mutex_unlock(&tree->mutex);
}

uint32_t lw_relay_tree_get(struct lw_relay_tree *tree, struct lw_relay_tree_node *out_node,
                           uint32_t capacity) {
    uv_mutex_lock(&tree->mutex);
    uint32_t count = lw_relay_tree_join(out_node, 0, capacity, tree->node, tree->count);
    count = lw_relay_tree_join(out_node, count, capacity, tree->outside, tree->outside_count);
    uv_mutex_unlock(&tree->mutex);
    return count;
}

static void write_metric(struct lw_exposition *e, const struct lw_relay_tree_node *node, uint32_t count,
                         const char *name, const char *help,
                         double (*value)(const struct lw_relay_tree_node *node)) {
    lw_exposition_metric(e, name, "gauge", help);
    for (uint32_t i = 0; i < count; i++) {
        const struct lw_relay_tree_node *n = &node[i];
        char labels[200];
        snprintf(labels, sizeof labels, "relay=\"%" PRIx64 "\",above=\"%" PRIx64 "\",name=\"%s\"", n->relay,
                 n->above, n->name);
        lw_exposition_sample(e, name, labels, value(n));
    }
}

static double sessions_of(const struct lw_relay_tree_node *n) { return (double)n->sessions; }
static double age_of(const struct lw_relay_tree_node *n) { return 1e-3 * (double)n->light_age_ms; }
static double sent_of(const struct lw_relay_tree_node *n) { return (double)n->sent_bytes_hz; }

void lw_relay_tree_add_metrics(struct lw_relay_tree *tree, struct lw_server_page *page) {
    struct lw_exposition e;
    char *text;
    size_t size;
    struct lw_relay_tree_node *node = malloc(LW_RELAY_TREE_MAX * sizeof *node);
    const uint32_t count = node ? lw_relay_tree_get(tree, node, LW_RELAY_TREE_MAX) : 0;
    if (!count || lw_exposition_begin(&e) != LW_OK) {
        free(node);
        return;
    }
    write_metric(&e, node, count, "lightwell_below_sessions",
                 "Sessions of each relay below this server, by their number; above: the relay that feeds it.",
                 sessions_of);
    write_metric(&e, node, count, "lightwell_below_light_age_seconds",
                 "How long that relay has had no server above: its clients have the light of then.", age_of);
    write_metric(&e, node, count, "lightwell_below_sent_bytes_per_second",
                 "What that relay sent to its clients lately.", sent_of);
    free(node);
    if (lw_exposition_end(&e, &text, &size) != LW_OK) return;
    char *grown = realloc(page->text, page->size + size + 1);
    if (grown) {
        memcpy(grown + page->size, text, size + 1);
        page->text = grown;
        page->size += size;
    }
    free(text);
}
