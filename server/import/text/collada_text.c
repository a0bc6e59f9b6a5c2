#include "server/import/text/collada_text.h"

#include "server/import/mesh/mesh_builder.h"

#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

/* Assimp takes no exponent for one that is soft. This one gives it an edge of width 0. */
#define HARD "<falloff_exponent>1e9</falloff_exponent>"
/* It has no valid field of view, which is reported. */
#define NO_CAMERA   "<perspective><xfov>0</xfov></perspective>"
#define NAME        " name=\"camera\""
#define HALF_DEGREE 0.008726646259971648 /* radians */

struct span {
    const char *from, *to;
};

/* An element: `all` from its first tag up to behind its last, `inner` between the two. */
struct element {
    struct span all, inner;
    bool is_empty; /* <spot/> */
};

enum { MENDED = 3 }; /* kinds of elements */

struct writer {
    char *text;
    size_t size, capacity;
    bool is_over[MENDED]; /* no more of a kind has an end */
};

static bool write(struct writer *writer, const char *from, const char *to) {
    const size_t length = (size_t)(to - from);
    if (!lw_mesh_builder_reserve((void **)&writer->text, &writer->capacity, writer->size + length + 1, 1))
        return false;
    if (length) memcpy(writer->text + writer->size, from, length);
    writer->size += length;
    return true;
}

static bool write_text(struct writer *writer, const char *text) {
    return write(writer, text, text + strlen(text));
}

static const char *find(struct span in, const char *what) {
    return memmem(in.from, (size_t)(in.to - in.from), what, strlen(what));
}

static bool begins(struct span in, const char *what) {
    const size_t length = strlen(what);
    return (size_t)(in.to - in.from) >= length && memcmp(in.from, what, length) == 0;
}

/* Past a comment, or to behind the '<' of anything else. */
static const char *next_place(struct span rest) {
    if (begins(rest, "<!--") || begins(rest, "<![CDATA[")) {
        const char *end = find(rest, rest.from[2] == '-' ? "-->" : "]]>");
        return end ? end + 3 : rest.to;
    }
    return rest.from + 1;
}

enum match { NONE, UNCLOSED, FOUND };

/* Whether a tag of this name begins at rest.from; *out_end: behind it, NULL if it has no end. */
static bool tag_at(struct span rest, const char *name, const char **out_end) {
    const size_t length = strlen(name);
    if (!begins((struct span){rest.from + 1, rest.to}, name)) return false;
    const char *end = rest.from + 1 + length;
    if (end == rest.to || !*end || !strchr(" \t\r\n/>", *end)) return false;
    const char *tag = memchr(end, '>', (size_t)(rest.to - end));
    *out_end = tag ? tag + 1 : NULL;
    return true;
}

/* Whether an element of this name begins at rest.from. One that has no end is the last that need be looked
 * for: its end was searched for in all of the rest. */
static enum match element_at(struct span rest, const char *name, struct element *out) {
    char close[40];
    const char *end;
    if (!tag_at(rest, name, &end)) return NONE;
    if (!end) return UNCLOSED;
    *out = (struct element){.all = {rest.from, end}, .is_empty = end[-2] == '/'};
    if (out->is_empty) return FOUND;
    snprintf(close, sizeof close, "</%s", name);
    const char *last = find((struct span){end, rest.to}, close);
    const char *last_end = last ? memchr(last, '>', (size_t)(rest.to - last)) : NULL;
    if (!last_end) return UNCLOSED;
    out->inner = (struct span){end, last};
    out->all.to = last_end + 1;
    return FOUND;
}

/* The first element of a name within another, comments left out. */
static bool find_element(struct span in, const char *name, struct element *out) {
    for (struct span rest = in; rest.from < in.to;) {
        rest.from = memchr(rest.from, '<', (size_t)(in.to - rest.from));
        if (!rest.from) return false;
        const enum match match = element_at(rest, name, out);
        if (match != NONE) return match == FOUND;
        rest.from = next_place(rest);
    }
    return false;
}

static double number_in(struct span span) {
    char text[64];
    const size_t length = (size_t)(span.to - span.from);
    if (length >= sizeof text) return (double)NAN;
    if (length) memcpy(text, span.from, length);
    text[length] = 0;
    return strtod(text, NULL);
}

static bool write_spot(struct writer *writer, const struct element *spot) {
    struct element exponent;
    if (spot->is_empty) return write_text(writer, "<spot>" HARD "</spot>");
    if (!find_element(spot->inner, "falloff_exponent", &exponent))
        return write(writer, spot->all.from, spot->inner.to) && write_text(writer, HARD) &&
               write(writer, spot->inner.to, spot->all.to);
    if (!exponent.is_empty && number_in(exponent.inner) != 0)
        return write(writer, spot->all.from, spot->all.to);
    return write(writer, spot->all.from, exponent.all.from) && write_text(writer, HARD) &&
           write(writer, exponent.all.to, spot->all.to);
}

/* Without an aspect Assimp takes degrees for the height, and divides tangents of whole angles. */
static bool write_perspective(struct writer *writer, const struct element *camera) {
    struct element x, y, aspect;
    char text[80];
    if (camera->is_empty || find_element(camera->inner, "aspect_ratio", &aspect) ||
        !find_element(camera->inner, "yfov", &y))
        return write(writer, camera->all.from, camera->all.to);
    double ratio = 1;
    if (find_element(camera->inner, "xfov", &x))
        ratio = tan(number_in(x.inner) * HALF_DEGREE) / tan(number_in(y.inner) * HALF_DEGREE);
    if (!(ratio > 0) || !isfinite(ratio)) ratio = 1;
    snprintf(text, sizeof text, "<aspect_ratio>%.9g</aspect_ratio>", ratio);
    return write(writer, camera->all.from, camera->inner.to) && write_text(writer, text) &&
           write(writer, camera->inner.to, camera->all.to);
}

static bool write_orthographic(struct writer *writer, const struct element *camera) {
    (void)camera;
    return write_text(writer, NO_CAMERA);
}

static const struct {
    const char *name;
    bool (*write)(struct writer *, const struct element *);
} mended[MENDED] = {
    {"spot", write_spot}, {"perspective", write_perspective}, {"orthographic", write_orthographic}};

/* Writes a camera's first tag as far as its attributes: Assimp reads no camera that has no name. Returns
 * the text behind that; NULL: out of memory. */
static const char *write_camera(struct writer *writer, struct span rest, const char *end) {
    const char *attributes = rest.from + strlen("<camera");
    const bool is_named = find((struct span){attributes, end}, "name") != NULL;
    const bool good = write(writer, rest.from, attributes) && (is_named || write_text(writer, NAME));
    return good ? attributes : NULL;
}

/* Writes the piece at rest.from, a '<', and returns the text behind it; NULL: out of memory. */
static const char *write_place(struct writer *writer, struct span rest) {
    const char *end;
    for (size_t i = 0; i < MENDED; i++) {
        struct element element;
        if (writer->is_over[i]) continue;
        const enum match match = element_at(rest, mended[i].name, &element);
        if (match == FOUND) return mended[i].write(writer, &element) ? element.all.to : NULL;
        writer->is_over[i] = match == UNCLOSED;
    }
    if (tag_at(rest, "camera", &end) && end) return write_camera(writer, rest, end);
    const char *next = next_place(rest);
    return write(writer, rest.from, next) ? next : NULL;
}

enum lw_status lw_collada_text_mend(const uint8_t *bytes, size_t size, uint8_t **out_text, size_t *out_size,
                                    struct lw_error *err) {
    struct writer writer = {0};
    struct span rest = {(const char *)bytes, (const char *)bytes + size};
    bool good = write(&writer, rest.from, rest.from);
    while (good && rest.from < rest.to) {
        const char *place = memchr(rest.from, '<', (size_t)(rest.to - rest.from));
        if (!place) place = rest.to;
        good = write(&writer, rest.from, place);
        rest.from = place;
        if (good && place < rest.to) good = (rest.from = write_place(&writer, rest)) != NULL;
    }
    if (!good) {
        free(writer.text);
        return lw_status_fail(err, LW_NO_MEMORY, "out of memory for its text");
    }
    *out_text = (uint8_t *)writer.text;
    *out_size = writer.size;
    return LW_OK;
}
