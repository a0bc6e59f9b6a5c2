/* content_coding.h: which coding of a file a client gets, by its Accept-Encoding.
 * Flow:    header Accept-Encoding, codings of a file -> [content_coding] -> coding -> web_server
 * Threads: pure functions, [any].
 * After:   RFC 9110, 12.4.2 (weights) and 12.5.3 (Accept-Encoding). */
#ifndef LW_SERVE_WEB_CONTENT_CODING_H
#define LW_SERVE_WEB_CONTENT_CODING_H

/* The smallest first: of equal weights the first one is chosen. */
enum lw_content_coding {
    LW_CONTENT_CODING_BR,
    LW_CONTENT_CODING_GZIP,
    LW_CONTENT_CODING_IDENTITY,
    LW_CONTENT_CODING_NONE /* the client accepts nothing of what there is */
};

#define LW_CONTENT_CODING_COUNT      LW_CONTENT_CODING_IDENTITY /* codings beside the file itself */
#define LW_CONTENT_CODING_ACCEPT_MAX 512u /* characters of a header that is looked at, terminator included */

/** Name in Content-Encoding: "br", "gzip"; NULL for the others. */
const char *lw_content_coding_name(enum lw_content_coding coding);
/** Ending of the names of files of it: ".br", ".gz"; NULL for the others. */
const char *lw_content_coding_ending(enum lw_content_coding coding);

/** Chooses a coding.
 *
 * accept     value of the header, all lines of it by commas; NULL: there is none
 * available  bit 1 << coding for br and gzip; identity is always there
 * Returns    the available coding of the largest weight; identity if the header is absent or malformed */
enum lw_content_coding lw_content_coding_choose(const char *accept, unsigned available);

#endif
