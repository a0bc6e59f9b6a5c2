/* light_form.h: the two forms in which the server's light is shown, encoded and sent. */
#ifndef LW_COMMON_LIGHT_FORM_H
#define LW_COMMON_LIGHT_FORM_H

/** full = split + the direct light of client lights (client_lights.h). On the wire: Tile.layer. */
enum lw_light_form {
    LW_LIGHT_FORM_FULL = 0,  /* all light */
    LW_LIGHT_FORM_SPLIT = 1, /* without the direct light of client lights, which a client draws itself */
    LW_LIGHT_FORM_COUNT
};

/* Sets of forms: a bit for each. */
static inline unsigned lw_light_form_bit(enum lw_light_form form) { return 1u << form; }
#define LW_LIGHT_FORMS_FULL (1u << LW_LIGHT_FORM_FULL)

#endif
