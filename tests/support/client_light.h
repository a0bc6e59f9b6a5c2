/* client_light.h: the light that a client of liblightwell has, as a whole. */
#ifndef LW_TESTS_CLIENT_LIGHT_H
#define LW_TESTS_CLIENT_LIGHT_H

#include "client/lib/client.h"

/** The client knows the scene and has every tile of visible objects, with at most that error. */
bool client_light_is_whole(const struct lw_client *client, float error_max);

/** Sum over all texels of the finest levels, and over their channels. */
double client_light_total(const struct lw_client *client);

#endif
