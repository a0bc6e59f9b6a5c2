#include "server/serve/server_packages.h"

#include "common/base/invariant.h"

#include <stdlib.h>
#include <zstd.h>

#define COMPRESSION_LEVEL 3

/* One of them on its way into messages. */
struct packing {
    enum lw_message_type type; /* its chunks' */
    struct lw_session_package *to;
    struct lw_message_package *announced; /* its lists are allocated */
    uint32_t capacity;                    /* chunks */
    ZSTD_CCtx *zstd;
    uint8_t *piece; /* LW_SESSION_CHUNK bytes */
};

static enum lw_status add_chunk(struct packing *p, uint32_t part, size_t size) {
    struct lw_session_package *to = p->to;
    if (to->chunk_count == p->capacity) {
        uint32_t grown_capacity = p->capacity ? p->capacity * 2 : 64;
        struct lw_session_chunk *grown = realloc(to->chunk, grown_capacity * sizeof *grown);
        if (!grown) return LW_NO_MEMORY;
        to->chunk = grown;
        p->capacity = grown_capacity;
    }
    uint64_t *compressed_size = &p->announced->compressed_size;
    struct lw_session_chunk *chunk = &to->chunk[to->chunk_count];
    struct lw_message message = {.type = p->type, .package_chunk = {*compressed_size, p->piece, size}};
    enum lw_status status = lw_blob_from_message(&message, &chunk->blob);
    if (status == LW_OK) {
        *compressed_size += size;
        chunk->end = *compressed_size;
        LW_INVARIANT(to->chunk_count < p->capacity && size <= LW_SESSION_CHUNK);
        chunk->part = part;
        to->chunk_count++;
    }
    return status;
}

/* Straight into messages that all sessions share; the compressed whole never exists in one piece. */
static enum lw_status compress_part(struct packing *p, uint32_t part, const uint8_t *bytes, size_t size) {
    ZSTD_inBuffer in = {bytes, size, 0};
    if (ZSTD_isError(ZSTD_CCtx_setPledgedSrcSize(p->zstd, size))) return LW_INTERNAL;
    enum lw_status status = LW_OK;
    for (size_t left = 1; status == LW_OK && left;) {
        ZSTD_outBuffer out = {p->piece, LW_SESSION_CHUNK, 0};
        do {
            left = ZSTD_compressStream2(p->zstd, &out, &in, ZSTD_e_end);
        } while (!ZSTD_isError(left) && left && out.pos < out.size);
        status = ZSTD_isError(left) ? LW_NO_MEMORY : add_chunk(p, part, out.pos);
    }
    return status;
}

/* The lists of parts; free_parts() frees them. */
static enum lw_status list_parts(struct lw_message_package *announced, const uint8_t *package,
                                 const uint64_t *end, size_t count) {
    uint64_t *size = malloc(2 * count * sizeof *size);
    struct lw_package_hash *hash = malloc(count * sizeof *hash);
    announced->part_size = size;
    announced->part_hash = hash;
    if (!size || !hash) return LW_NO_MEMORY;
    announced->part_compressed_size = size + count;
    for (size_t i = 0; i < count; i++) {
        const uint64_t begin = i ? end[i - 1] : 0;
        LW_INVARIANT(end[i] > begin);
        size[i] = end[i] - begin;
        size[count + i] = 0;
        lw_package_hash(package + begin, (size_t)size[i], &hash[i]);
    }
    announced->part_count = count;
    return LW_OK;
}

static void free_parts(struct lw_message_package *announced) {
    free((void *)announced->part_size); /* and part_compressed_size */
    free((void *)announced->part_hash);
}

/* A package that ends as its parts do. */
static enum lw_status compress(struct packing *p, const uint8_t *bytes, const uint64_t *end, size_t count) {
    const size_t size = (size_t)end[count - 1];
    p->piece = malloc(LW_SESSION_CHUNK);
    p->zstd = ZSTD_createCCtx();
    enum lw_status status = p->piece && p->zstd ? list_parts(p->announced, bytes, end, count) : LW_NO_MEMORY;
    if (status == LW_OK &&
        ZSTD_isError(ZSTD_CCtx_setParameter(p->zstd, ZSTD_c_compressionLevel, COMPRESSION_LEVEL)))
        status = LW_INTERNAL;
    p->announced->size = size;
    lw_package_hash(bytes, size, &p->announced->hash);
    for (size_t i = 0; status == LW_OK && i < count; i++) {
        const uint64_t begin = i ? end[i - 1] : 0, compressed = p->announced->compressed_size;
        status = compress_part(p, (uint32_t)i, bytes + begin, (size_t)(end[i] - begin));
        ((uint64_t *)p->announced->part_compressed_size)[i] = p->announced->compressed_size - compressed;
    }
    ZSTD_freeCCtx(p->zstd);
    free(p->piece);
    LW_INVARIANT(status != LW_OK ||
                 p->to->chunk[p->to->chunk_count - 1].end == p->announced->compressed_size);
    return status;
}

static enum lw_status compress_package(struct lw_session_shared *shared, const uint8_t *bytes, size_t size) {
    struct lw_message_welcome *w = &shared->welcome;
    struct lw_message_package announced = {0};
    uint64_t *end = NULL;
    size_t count = 0;
    enum lw_status status = lw_package_cut(bytes, size, &end, &count);
    if (status == LW_OK)
        status = compress(&(struct packing){.type = LW_MESSAGE_PACKAGE_CHUNK,
                                            .to = &shared->package,
                                            .announced = &announced},
                          bytes, end, count);
    free(end);
    w->package_hash = announced.hash;
    w->package_size = announced.size;
    w->package_compressed_size = announced.compressed_size;
    if (status != LW_OK || count == 1) { /* a package of one part: nothing more is announced */
        free_parts(&announced);
        return status;
    }
    w->part_size = announced.part_size;
    w->part_compressed_size = announced.part_compressed_size;
    w->part_hash = announced.part_hash;
    w->part_count = count;
    w->features |= LW_FEATURE_PARTS;
    return status;
}

/* Textures beyond the limit of parts are in the last one. */
static enum lw_status compress_finishes(struct lw_session_shared *shared, const uint8_t *bytes, size_t size) {
    uint64_t *end = NULL;
    size_t count = 0;
    if (!size) return LW_OK;
    enum lw_status status = lw_finish_package_cut(bytes, size, &end, &count);
    if (status == LW_OK && count > LW_MESSAGE_FINISH_PARTS_MAX) {
        LW_INVARIANT(end[count - 1] == size);
        count = LW_MESSAGE_FINISH_PARTS_MAX;
        end[count - 1] = size;
    }
    if (status == LW_OK)
        status = compress(&(struct packing){.type = LW_MESSAGE_FINISH_CHUNK,
                                            .to = &shared->finishes,
                                            .announced = &shared->welcome.finish},
                          bytes, end, count);
    free(end);
    return status;
}

static void free_chunks(struct lw_session_package *package) {
    for (uint32_t i = 0; i < package->chunk_count; i++) lw_blob_unref(package->chunk[i].blob);
    free(package->chunk);
}

static void compress_packages(void *user) {
    struct lw_server *server = user;
    struct lw_server_packer *p = &server->packer;
    p->status = compress_package(&server->shared, p->package, p->package_size);
    if (p->status == LW_OK) p->status = compress_finishes(&server->shared, p->finishes, p->finishes_size);
    if (!p->takes_packages) return;
    free((void *)p->package);
    free((void *)p->finishes);
}

void lw_server_packages_start(struct lw_server *server, const struct lw_server_desc *desc) {
    server->packer = (struct lw_server_packer){.package = desc->package,
                                               .package_size = desc->package_size,
                                               .finishes = desc->finishes,
                                               .finishes_size = desc->finishes_size,
                                               .takes_packages = desc->takes_packages};
    server->packer.runs = uv_thread_create(&server->packer.thread, compress_packages, server) == 0;
    if (!server->packer.runs) compress_packages(server);
}

enum lw_status lw_server_packages_await(struct lw_server *server) {
    if (server->packer.runs) uv_thread_join(&server->packer.thread);
    server->packer.runs = false;
    return server->packer.status;
}

void lw_server_packages_finish(struct lw_session_shared *shared) {
    struct lw_message_package package = lw_message_welcome_package(&shared->welcome);
    free_chunks(&shared->package);
    free_chunks(&shared->finishes);
    free_parts(&package);
    free_parts(&shared->welcome.finish);
}
