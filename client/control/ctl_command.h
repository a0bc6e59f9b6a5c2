/* ctl_command.h: the commands of lightwellctl: words to a change of the scene.
 * Flow:    argv or lines -> [words -> change] -> lw_client_update()
 * Threads: one thread at a time. */
#ifndef LW_CLIENT_CTL_COMMAND_H
#define LW_CLIENT_CTL_COMMAND_H

#include "client/lib/client.h"

#define LW_CTL_COMMAND_WORDS_MAX 16u

/** What a material shines by, W/(m^2 sr) per channel: now, and as the scene has it. */
struct lw_ctl_emission {
    struct lw_vec3 now, own;
};

/** The scene as the commands so far leave it: a second command goes on from where the first one ends. */
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

/** The command that begins like a word, or is a slip or two away from it; NULL: none. */
const char *lw_ctl_command_near(const char *word);

/** Says that there is no such command, and which is near. Returns LW_USAGE. */
enum lw_status lw_ctl_command_fail_unknown(const char *word, struct lw_error *err);

/** What --help says of the commands: a line each. */
const char *lw_ctl_command_help(void);

/** Reads a command. Errors: LW_USAGE, in one line that names what is wrong and what would be right. What only
 * the server can judge, such as ranges, is left to it. */
LW_MUST_CHECK enum lw_status lw_ctl_command_parse(struct lw_ctl_command_state *state, const char *const *word,
                                                  size_t count, struct lw_scene_change *out_change,
                                                  struct lw_error *err);

/** Cuts a line into words, in place: at blanks, but not between double quotes. A line that is empty, or that
 * begins with # and a blank or nothing, has none. Errors: LW_USAGE for over LW_CTL_COMMAND_WORDS_MAX or a
 * quote that does not end. */
LW_MUST_CHECK enum lw_status lw_ctl_command_split(char *line, const char *out_word[LW_CTL_COMMAND_WORDS_MAX],
                                                  size_t *out_count, struct lw_error *err);

/** The middle of an object's box, in world space, if it stands there. */
struct lw_vec3 lw_ctl_command_middle(const struct lw_scene *scene, uint32_t object,
                                     const struct lw_affine *object_to_world);

#endif
