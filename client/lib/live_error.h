/* live_error.h: the answers of liblightwell, and structs of several versions, which are told apart by their
 * size.
 * Flow:    lw_error -> [live_error] -> lw_live_error -> engine
 * Threads: [any]. */
#ifndef LIGHTWELL_LIVE_ERROR_H
#define LIGHTWELL_LIVE_ERROR_H

#include "client/include/lightwell/lightwell.h"
#include "common/base/status.h"

/** Fills in an error; err may be NULL. */
enum lw_live_status lw_live_fail(struct lw_live_error *err, enum lw_live_status status, const char *format,
                                 ...) LW_PRINTF(3, 4);
/** The same of an error of ours. */
enum lw_live_status lw_live_pass(struct lw_live_error *err, enum lw_status status,
                                 const struct lw_error *cause);

/** The size that a struct from outside says it has; 0 if it is NULL. */
size_t lw_live_struct_size(const void *outside);

/** Takes over a struct from outside: what its version lacks is zero. false: no version has its size. */
bool lw_live_read_struct(void *dst, size_t dst_size, const void *src);
/** Hands out what the caller's version has of a struct; src's own struct_size is not read. false:
 * likewise. */
bool lw_live_write_struct(void *dst, void *src, size_t src_size);

#endif
