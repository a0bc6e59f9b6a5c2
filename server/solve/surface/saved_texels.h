/* saved_texels.h: which texels and sample points light reaches, in a file: the next start need not look
 * inside objects again.
 * Flow:    texels, searched -> [saved_texels] -> file -> [saved_texels] -> texels of the next start
 * Threads: one call at a time.
 *
 * The file (common/base/checked_file.h): a header, then what invalid_texels.h finds of each texel, plane by
 * plane, each compressed by zstd. It is for the texels, objects and instruction set that it was made of
 * alone; the header holds a hash of them. Each value is checked before it is used: a hostile file
 * gives wrong light, and nothing else. */
#ifndef LW_SURFACE_SAVED_TEXELS_H
#define LW_SURFACE_SAVED_TEXELS_H

#include "common/scene/pose.h"
#include "common/trace/trace.h"
#include "server/solve/surface/invalid_texels.h"

#define LW_SAVED_TEXELS_VERSION  3u
#define LW_SAVED_TEXELS_KEY_SIZE 16u /* bytes */
#define LW_SAVED_TEXELS_SUFFIX   ".lwtexels"
/* Most bytes of all such files in a folder. The newest file stays even if it is larger. */
#define LW_SAVED_TEXELS_BYTES_MAX (1ull << 28)

/** Where a scene's texels are saved: in FOLDER/KEY and the suffix. */
struct lw_saved_texels {
    const char *folder;
    /* Hash of the scene's package, and of the program that finds them. */
    uint8_t key[LW_SAVED_TEXELS_KEY_SIZE];
};

/** Takes from the file what lw_invalid_texels_find() would find, and sets texels->stands. Texels stay as they
 * were where it fails.
 * stands     per object (standing.h); outlives the texels
 * out_count  how many texels are gone
 * Errors     LW_NO_INPUT: no such file; LW_BAD_DATA naming the path: damaged, of another version, of other
 *            texels, or of what cannot be; LW_IO, LW_NO_MEMORY */
LW_MUST_CHECK enum lw_status lw_saved_texels_load(const struct lw_saved_texels *saved,
                                                  struct lw_texels *texels, const struct lw_pose *pose,
                                                  const bool *stands, const struct lw_trace *trace,
                                                  uint64_t *out_count, struct lw_error *err);

/** Saves the findings; the file appears whole or not at all. Makes the folder, and removes the files used
 * longest ago beyond LW_SAVED_TEXELS_BYTES_MAX.
 * Errors: LW_CANNOT_CREATE, LW_IO naming the path; LW_NO_MEMORY. */
LW_MUST_CHECK enum lw_status lw_saved_texels_save(const struct lw_saved_texels *saved,
                                                  const struct lw_invalid_texels_found *found,
                                                  const struct lw_trace *trace, struct lw_error *err);

#endif
