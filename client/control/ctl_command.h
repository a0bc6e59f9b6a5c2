/* ctl_command.h: the commands of lightwellctl: words to a change of the scene.
 * Flow:    argv or lines -> [words -> change] -> lw_client_update()
 * Threads: one thread at a time. */
#ifndef LW_CLIENT_CTL_COMMAND_H
#define LW_CLIENT_CTL_COMMAND_H

#include "client/lib/client.h"

#define LW_CTL_COMMAND_WORDS_MAX 16u

/** A material's emission, W/(m^2 sr) per channel: now, and as in the scene file. */
struct lw_ctl_emission {
    struct lw_vec3 now, own;
};

/** The scene after the commands so far: the next command continues from there. */
struct lw_ctl_command_state {
    const struct lw_scene *scene;
    struct lw_affine *object_to_world; /* per object */
    struct lw_affine *mesh_to_world;   /* per mesh: as its first object stands when the scene begins */
    struct lw_client_light *light;     /* per light */
    struct lw_ctl_emission *emission;  /* per material */
};

/** Takes over what a client has received; its scene must be there. Errors: LW_NO_MEMORY. */
LW_MUST_CHECK enum lw_status lw_ctl_command_state_init(struct lw_ctl_command_state *state,
                                                       const struct lw_client *client);
/** A zeroed state is fine. */
void lw_ctl_command_state_finish(struct lw_ctl_command_state *state);

/** Whether a word names a command. */
bool lw_ctl_command_is(const char *word);

/** The command that begins like a word, or is one or two edits away from it; NULL: none. */
const char *lw_ctl_command_near(const char *word);

/** Fails with LW_USAGE: there is no such command, and a similar one is named. */
enum lw_status lw_ctl_command_fail_unknown(const char *word, struct lw_error *err);

/** The text of --help for the commands: a line each. */
const char *lw_ctl_command_help(void);

/** Reads a command. Only the server checks ranges and the like.
 * Errors: LW_USAGE, in one line that names the mistake and the right form. */
LW_MUST_CHECK enum lw_status lw_ctl_command_parse(struct lw_ctl_command_state *state, const char *const *word,
                                                  size_t count, struct lw_scene_change *out_change,
                                                  struct lw_error *err);

/** Splits a line into words, in place, at blanks outside of double quotes. An empty line has none, nor has
 * a line that begins with # and a blank or nothing.
 * Errors: LW_USAGE for over LW_CTL_COMMAND_WORDS_MAX words or an open quote. */
LW_MUST_CHECK enum lw_status lw_ctl_command_split(char *line, const char *out_word[LW_CTL_COMMAND_WORDS_MAX],
                                                  size_t *out_count, struct lw_error *err);

/** The centre of an object's box in world space, with the object at this place. */
struct lw_vec3 lw_ctl_command_middle(const struct lw_scene *scene, uint32_t object,
                                     const struct lw_affine *object_to_world);

#endif
