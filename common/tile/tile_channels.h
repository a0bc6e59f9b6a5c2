/* tile_channels.h: what a tile holds, as data: groups of planes, and how each is coded, kept and asked for.
 * Flow:    the table -> solver, publisher, codecs, sessions, replica: each loops over it (docs/channels.md)
 * Threads: constants, [any]. */
#ifndef LW_COMMON_TILE_CHANNELS_H
#define LW_COMMON_TILE_CHANNELS_H

#include <stdbool.h>
#include <stdint.h>

/* Bits of features (message.h), for ever. */
#define LW_TILE_CHANNELS_DRAWS     64u   /* LW_FEATURE_DRAWS */
#define LW_TILE_CHANNELS_DIRECTION 2048u /* LW_FEATURE_DIRECTION */

#define LW_TILE_CHANNELS_MAX       8u
#define LW_TILE_CHANNEL_PLANES_MAX 3u /* planes of a channel */

/** Numbers of channels. FULL = SPLIT + the direct light of client lights (client_lights.h). */
enum {
    LW_TILE_CHANNEL_FULL = 0,    /* irradiance: all light */
    LW_TILE_CHANNEL_SPLIT = 1,   /* without the direct light of client lights, which a client draws itself */
    LW_TILE_CHANNEL_IRRADIANCES, /* how many channels are irradiance: the first ones */
    LW_TILE_CHANNEL_DIRECTION = LW_TILE_CHANNEL_IRRADIANCES, /* the direction of full irradiance */
    LW_TILE_CHANNEL_DIRECTION_SPLIT                          /* the direction of split irradiance */
};
#define LW_TILE_CHANNELS_FULL (1u << LW_TILE_CHANNEL_FULL)

/** Scale of values in the lossy codec. */
enum lw_tile_coding {
    LW_TILE_CODING_LIGHT, /* by ratio: three colours, >= 0, as logarithms of brightness and colour */
    LW_TILE_CODING_PLAIN  /* by difference: each plane by itself */
};

struct lw_tile_channel {
    const char *name, *unit, *meaning;
    uint32_t planes;
    bool is_signed; /* values may be below 0; only with LW_TILE_CODING_PLAIN */
    enum lw_tile_coding coding;
    float step; /* the lossy codec's, as a multiple of all light's */
    bool kept;  /* the saved light has it */
    /* A session whose features, masked by `asked`, are `asks` gets this channel (LW_FEATURE_*). */
    uint64_t asked, asks;
    uint32_t slot; /* where a client keeps it: channels of one slot exclude each other; 0: irradiance */
    /* Only where the light of client lights is kept apart (client_lights.h). */
    bool parted;
    /* The cosine moment of the irradiance that it follows (direction_form.h): three planes, W/m^2, in world
     * space. Only where the solver is asked for directions. Coded over the luminance of that irradiance. */
    bool moment;
    uint32_t follows; /* the irradiance whose edges and noise the filter goes by; of irradiance: itself */
};

/** The number of a channel is its bit in sets of channels and, on the wire, Tile.layer: forever. The first
 * LW_TILE_CHANNEL_IRRADIANCES are irradiance. */
struct lw_tile_channels {
    uint32_t count;
    struct lw_tile_channel channel[LW_TILE_CHANNELS_MAX];
};

const struct lw_tile_channels *lw_tile_channels(void);

static inline const struct lw_tile_channel *lw_tile_channel_at(uint32_t number) {
    return &lw_tile_channels()->channel[number];
}

static inline uint32_t lw_tile_channel_bit(uint32_t number) { return 1u << number; }

/** The channels of a set, a bit each, in the order of their numbers. */
#define LW_TILE_CHANNELS_EACH(channel, set)                                                                  \
    for (uint32_t channel = 0; channel < lw_tile_channels()->count; channel++)                               \
        if ((set)&lw_tile_channel_bit(channel))

/** The channels that a solver holds.
 * parts       it keeps the light of client lights apart
 * directions  it keeps cosine moments */
static inline uint32_t lw_tile_channels_held(bool parts, bool directions) {
    uint32_t held = 0;
    for (uint32_t i = 0; i < lw_tile_channels()->count; i++)
        if ((parts || !lw_tile_channel_at(i)->parted) && (directions || !lw_tile_channel_at(i)->moment))
            held |= lw_tile_channel_bit(i);
    return held;
}

/** The served channels that a session with these features gets. */
static inline uint32_t lw_tile_channels_for(uint64_t features, uint32_t served) {
    const struct lw_tile_channels *all = lw_tile_channels();
    uint32_t channels = 0;
    for (uint32_t i = 0; i < all->count; i++)
        if ((features & all->channel[i].asked) == all->channel[i].asks) channels |= lw_tile_channel_bit(i);
    return channels & served;
}

/** The features that ask for any of a set of channels. */
static inline uint64_t lw_tile_channels_features(uint32_t channels) {
    uint64_t features = 0;
    for (uint32_t i = 0; i < lw_tile_channels()->count; i++)
        if (channels & lw_tile_channel_bit(i)) features |= lw_tile_channel_at(i)->asks;
    return features;
}

#endif
