#include "client/view/window/window_panels.h"

#include <stdarg.h>
#include <stdio.h>
#include <string.h>

#define NOTICE_SHOWN_NS 4000000000u
#define PANEL_LINES     4

void lw_window_panels_notify(struct lw_window *w, const char *format, ...) {
    va_list arguments;
    va_start(arguments, format);
    vsnprintf(w->notice, sizeof w->notice, format, arguments);
    va_end(arguments);
    snprintf(w->says, sizeof w->says, "%s", w->notice);
    w->notice_until_ns = lw_clock_ns() + NOTICE_SHOWN_NS;
    w->redraw = true;
}

void lw_window_panels_set_keys(struct lw_window *w, bool on) {
    w->show_keys = on;
    w->keys_until_ns = 0;
    w->redraw = true;
}

void lw_window_panels_show(struct lw_window *w, int x, int y, const char *const *line, int count,
                           float fraction, uint32_t colour) {
    struct lw_error err = {0};
    if (lw_panel_draw(&w->panel, line, count, fraction, colour, &err) != LW_OK)
        return; /* a picture without text */
    if (x == LW_WINDOW_PANELS_MIDDLE) x = ((int)w->width - w->panel.width) / 2;
    if (x == LW_WINDOW_PANELS_RIGHT) x = (int)w->width - w->panel.width - LW_WINDOW_PANELS_INSET;
    if (y == LW_WINDOW_PANELS_MIDDLE)
        y = ((int)w->height - w->panel.height) / 2;
    else if (y == LW_WINDOW_PANELS_LOW)
        y = (int)w->height - w->panel.height - LW_WINDOW_PANELS_INSET;
    lw_screen_draw_panel(&w->screen, w->panel.pixel, w->panel.width, w->panel.height, x, y);
}

void lw_window_panels_keys(struct lw_window *w) {
    if (w->show_keys)
        lw_window_panels_show(w, LW_WINDOW_PANELS_INSET, LW_WINDOW_PANELS_LOW, lw_overlay_keys,
                              LW_OVERLAY_KEYS, -1, LW_PANEL_TEXT);
}

void lw_window_panels_notice(struct lw_window *w) {
    if (w->notice_until_ns != 0)
        lw_window_panels_show(w, LW_WINDOW_PANELS_MIDDLE, LW_WINDOW_PANELS_LOW,
                              (const char *const[]){w->notice}, 1, -1, LW_PANEL_TEXT);
}

void lw_window_panels_message(struct lw_window *w, const char *text, float fraction) {
    snprintf(w->says, sizeof w->says, "%s", text);
    lw_screen_clear(&w->screen);
    lw_window_panels_keys(w);
    lw_window_panels_show(w, LW_WINDOW_PANELS_MIDDLE, LW_WINDOW_PANELS_MIDDLE, (const char *const[]){text}, 1,
                          fraction, LW_PANEL_TEXT);
    lw_screen_present(&w->screen);
}

static const char *file_of(const char *path) {
    const char *slash = strrchr(path, '/');
    return slash ? slash + 1 : path;
}

void lw_window_panels_waiting(struct lw_window *w) {
    char text[96];
    if (w->importing_ns != 0) {
        snprintf(text, sizeof text, "importing %.60s, %.0f s", file_of(w->options->scene),
                 (double)(lw_clock_ns() - w->importing_ns) * 1e-9);
        lw_window_panels_message(w, text, -1);
        return;
    }
    if (w->incoming == NULL) {
        snprintf(text, sizeof text, "looking for %.60s", w->address);
        lw_window_panels_message(w, text, -1);
        return;
    }
    float fraction = lw_client_package_progress(w->incoming);
    snprintf(text, sizeof text, "receiving the scene %.0f %%", (double)fraction * 100.0);
    lw_window_panels_message(w, text, fraction);
}

static void take_figures(struct lw_window *w, const struct lw_client_stats *stats, uint64_t now_ns) {
    struct lw_window_figures *f = &w->figures;
    if (now_ns - f->since_ns < LW_WINDOW_FIGURES_EVERY_NS) return;
    double seconds = (double)(now_ns - f->since_ns) * 1e-9;
    f->pictures_per_s = f->pictures / seconds;
    f->kbit_per_s =
        stats->bytes >= f->bytes && f->bytes > 0 ? (double)(stats->bytes - f->bytes) * 8e-3 / seconds : 0;
    f->bytes = stats->bytes;
    f->pictures = 0;
    f->since_ns = now_ns;
}

void lw_window_panels_figures(struct lw_window *w) {
    struct lw_client_stats stats;
    lw_client_get_stats(w->client, &stats);
    take_figures(w, &stats, lw_clock_ns());
    char line[PANEL_LINES][LW_OVERLAY_LINE_SIZE];
    snprintf(line[0], sizeof line[0], "%3.0f frames/s  %ux%u  %s", w->figures.pictures_per_s,
             w->picture.width, w->picture.height, lw_steering_names[w->steering.mode]);
    snprintf(line[1], sizeof line[1], "%.0f kbit/s", w->figures.kbit_per_s);
    const struct lw_overlay_state state = {.lost = w->lost,
                                           .receiving = w->incoming != NULL,
                                           .lit = stats.first_ns != 0,
                                           .waiting = lw_client_waiting(w->client),
                                           .report = w->picture.report};
    if (state.lit)
        snprintf(line[2], sizeof line[2], "light %.0f ms old", (double)stats.light_age_ns * 1e-6);
    else
        snprintf(line[2], sizeof line[2], "no light yet");
    lw_overlay_state(&state, line[3]);
    bool hint = state.lost || !state.lit;
    if (!w->hide_figures)
        lw_window_panels_show(w, LW_WINDOW_PANELS_INSET, LW_WINDOW_PANELS_INSET,
                              (const char *const[]){line[0], line[1], line[2], line[3]}, PANEL_LINES, -1,
                              hint ? LW_PANEL_HINT : LW_PANEL_TEXT);
    else if (hint)
        lw_window_panels_show(w, LW_WINDOW_PANELS_INSET, LW_WINDOW_PANELS_INSET,
                              (const char *const[]){line[3]}, 1, -1, LW_PANEL_HINT);
}
