/* tile_file.h: finished tiles in a file, for a solve whose tiles do not fit into memory together.
 * Flow:    a tile that has converged -> [tile_file] -> the same tile, in any order, in a later run too
 * Threads: one.
 *
 * The file belongs to one machine and one build: numbers lie as in memory. A header holds a version, the
 * caller's key and the sizes; then comes a byte for each tile, which says whether the tile is there, and then
 * a record for each. A tile's byte is written after its record. Each record has a checksum. */
#ifndef LW_STATE_TILE_FILE_H
#define LW_STATE_TILE_FILE_H

#include "common/tile/atlas.h"

#define LW_TILE_FILE_KEY_SIZE   16u
#define LW_TILE_FILE_PLANES_MAX 16u

/** A tile, row by row, planes of width * height floats. */
struct lw_tile_file_tile {
    uint32_t texels; /* width * height */
    uint32_t sample_count, bounces;
    float error;
    /* The aim of its solve: a number of frames, or, where that is 0, an error. */
    uint32_t aim_frames;
    float aim_error;
    uint8_t covered[LW_TILE_TEXELS_MAX], filled[LW_TILE_TEXELS_MAX];
    float plane[LW_TILE_FILE_PLANES_MAX][LW_TILE_TEXELS_MAX];
};

struct lw_tile_file {
    int descriptor;
    char *path;
    uint32_t tiles, planes;
    uint8_t *has; /* per tile */
    uint32_t count;
};

/** Opens the file of a path, or begins it: so too if it is of another key, of other sizes or of another
 * version. planes: of each tile, at most LW_TILE_FILE_PLANES_MAX.
 * Errors: LW_CANNOT_CREATE, LW_IO naming the path; LW_NO_MEMORY. *file is closed then. */
LW_MUST_CHECK enum lw_status lw_tile_file_open(struct lw_tile_file *file, const char *path,
                                               const uint8_t key[LW_TILE_FILE_KEY_SIZE], uint32_t tiles,
                                               uint32_t planes, struct lw_error *err);
/** A zeroed one is fine. The file stays. */
void lw_tile_file_close(struct lw_tile_file *file);

/** Writes a tile. Errors: LW_IO naming the path. */
LW_MUST_CHECK enum lw_status lw_tile_file_put(struct lw_tile_file *file, uint32_t tile,
                                              struct lw_tile_file_tile *from, struct lw_error *err);
/** Reads a tile that is there. Errors: LW_IO; LW_BAD_DATA: it is damaged. */
LW_MUST_CHECK enum lw_status lw_tile_file_get(const struct lw_tile_file *file, uint32_t tile,
                                              struct lw_tile_file_tile *out, struct lw_error *err);
/** Forgets a tile, in this run. */
void lw_tile_file_forget(struct lw_tile_file *file, uint32_t tile);

#endif
