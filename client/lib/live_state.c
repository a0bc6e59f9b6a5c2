#include "client/lib/live_state.h"

void lw_live_lock(const struct lw_live *live) {
    struct lw_live *l = (struct lw_live *)live;
    if (!l->has_thread) return;
    pthread_mutex_lock(&l->turn);
    pthread_mutex_lock(&l->data);
    pthread_mutex_unlock(&l->turn);
}

void lw_live_unlock(const struct lw_live *live) {
    struct lw_live *l = (struct lw_live *)live;
    if (l->has_thread) pthread_mutex_unlock(&l->data);
}
