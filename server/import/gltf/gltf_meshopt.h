/* gltf_meshopt.h: EXT_meshopt_compression: the bytes of one buffer view from a compressed stream.
 * Flow:    buffer -> [gltf_meshopt] -> bytes of a buffer view -> accessors
 * Threads: [any].
 * libmeshoptimizer 0.18 is safe for untrusted streams: at worst its numbers are wrong, and accessors check
 * them. It asserts its arguments, which are checked here. */
#ifndef LW_IMPORT_GLTF_GLTF_MESHOPT_H
#define LW_IMPORT_GLTF_GLTF_MESHOPT_H

#include "server/import/gltf/gltf_json.h"

/** Decodes the stream that an extension object of a buffer view describes.
 * data         data_size bytes: the stream
 * size         bytes of the view: the output
 * out_storage  malloc'ed, size bytes
 * out_stride   of its elements, or 0 for indices, which are tightly packed
 * Errors: LW_BAD_DATA that starts with the field; LW_NO_MEMORY. */
LW_MUST_CHECK enum lw_status lw_gltf_meshopt_decode(const json_t *extension, const uint8_t *data,
                                                    size_t data_size, uint64_t size, uint8_t **out_storage,
                                                    size_t *out_stride, struct lw_error *err);

#endif
