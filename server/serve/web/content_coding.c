#include "server/serve/web/content_coding.h"

#include <assert.h>
#include <stdbool.h>
#include <stddef.h>
#include <string.h>
#include <strings.h>

#define WEIGHT_MAX 1000 /* for q=1: three decimals at most */
#define UNSAID     (-1)

/* RFC 9110, 5.6.2 */
#define TOKEN_CHARACTERS "abcdefghijklmnopqrstuvwxyzABCDEFGHIJKLMNOPQRSTUVWXYZ0123456789!#$%&'*+-.^_`|~"
#define DIGITS           "0123456789"

static const struct {
    const char *name, *ending;
} codings[LW_CONTENT_CODING_COUNT] = {{"br", ".br"}, {"gzip", ".gz"}};

const char *lw_content_coding_name(enum lw_content_coding coding) {
    return coding < LW_CONTENT_CODING_COUNT ? codings[coding].name : NULL;
}

const char *lw_content_coding_ending(enum lw_content_coding coding) {
    return coding < LW_CONTENT_CODING_COUNT ? codings[coding].ending : NULL;
}

static const char *skip_blanks(const char *at) { return at + strspn(at, " \t"); }

/* Reads 0, 0.123, 1 or 1.000. Returns where it ends; NULL: it is no weight. */
static const char *read_weight(const char *at, int *out_weight) {
    if (*at != '0' && *at != '1') return NULL;
    int weight = (*at++ - '0') * WEIGHT_MAX;
    if (*at == '.') {
        at++;
        for (int unit = WEIGHT_MAX / 10; unit && *at >= '0' && *at <= '9'; unit /= 10)
            weight += unit * (*at++ - '0');
    }
    if (strspn(at, DIGITS) || weight > WEIGHT_MAX) return NULL;
    *out_weight = weight;
    return at;
}

/* Reads a coding and its weight, 1 unless said. Returns where it ends, at a comma or the end; NULL: it is
 * malformed. An empty element is a coding of no characters. */
static const char *read_element(const char *at, const char **out_name, size_t *out_size, int *out_weight) {
    *out_name = at = skip_blanks(at);
    *out_size = strspn(at, TOKEN_CHARACTERS);
    *out_weight = WEIGHT_MAX;
    at = skip_blanks(at + *out_size);
    if (*at == ';') {
        if (!*out_size) return NULL;
        at = skip_blanks(at + 1);
        if (strncasecmp(at, "q=", 2) != 0) return NULL;
        at = read_weight(at + 2, out_weight);
        if (!at) return NULL;
        at = skip_blanks(at);
    }
    return *at == ',' || !*at ? at : NULL;
}

static bool is_named(const char *name, size_t size, const char *wanted) {
    return size == strlen(wanted) && strncasecmp(name, wanted, size) == 0;
}

/* The weights that a header gives; the last one of a coding counts. False: it is malformed. */
static bool read_weights(const char *accept, int weight[LW_CONTENT_CODING_IDENTITY + 1], int *out_others) {
    for (const char *at = accept;; at++) {
        const char *name;
        size_t size;
        int said;
        at = read_element(at, &name, &size, &said);
        if (!at) return false;
        for (unsigned i = 0; i < LW_CONTENT_CODING_COUNT; i++)
            if (is_named(name, size, codings[i].name)) weight[i] = said;
        if (is_named(name, size, "x-gzip")) weight[LW_CONTENT_CODING_GZIP] = said; /* RFC 9110, 8.4.1.3 */
        if (is_named(name, size, "identity")) weight[LW_CONTENT_CODING_IDENTITY] = said;
        if (is_named(name, size, "*")) *out_others = said;
        if (!*at) return true;
    }
}

enum lw_content_coding lw_content_coding_choose(const char *accept, unsigned available) {
    int weight[LW_CONTENT_CODING_IDENTITY + 1] = {UNSAID, UNSAID, UNSAID}, others = UNSAID;
    static_assert(LW_CONTENT_CODING_IDENTITY == 2, "a weight for each coding");
    if (!accept || !read_weights(accept, weight, &others)) return LW_CONTENT_CODING_IDENTITY;
    enum lw_content_coding best = LW_CONTENT_CODING_NONE;
    int best_weight = 0;
    for (unsigned i = 0; i < LW_CONTENT_CODING_COUNT; i++) {
        const int own = weight[i] == UNSAID ? others : weight[i];
        if (!(available >> i & 1) || own <= best_weight) continue;
        best = (enum lw_content_coding)i;
        best_weight = own;
    }
    /* identity is acceptable unless it is excluded, and the last choice unless it has a weight */
    const int own =
        weight[LW_CONTENT_CODING_IDENTITY] == UNSAID ? others : weight[LW_CONTENT_CODING_IDENTITY];
    if (own > best_weight || (own == UNSAID && best == LW_CONTENT_CODING_NONE))
        best = LW_CONTENT_CODING_IDENTITY;
    return best;
}
