/* message_case.h: messages of tests: decoded from memory of exactly their size, compared field by field. */
#ifndef LW_TESTS_MESSAGE_CASE_H
#define LW_TESTS_MESSAGE_CASE_H

#include "tests/support/support.h"

#include "proto/message.h"

/** Ends the test unless each field of both messages is equal. */
void message_case_expect_equal(const struct lw_message *a, const struct lw_message *b);

/** Decodes from memory of exactly that size, so that ASan sees a read past the end. */
enum lw_status message_case_decode(enum lw_message_type type, const uint8_t *body, size_t size,
                                   struct lw_message *out, struct lw_error *err);

struct message_case_body {
    uint8_t *bytes;
    size_t size;
};

/** Decodes and frees the body. text NULL: it must decode. */
void message_case_expect(enum lw_message_type type, struct message_case_body *b, const char *text);

/** Through our own encoder too: a number that clients would refuse must not leave the server. */
void message_case_expect_invalid(const struct lw_message *message, const char *text);

#endif
