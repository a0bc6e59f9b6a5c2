#include "tests/support/failing_memory.h"
#include "tests/support/support.h"

#include "proto/message_reader.h"

#include <stdlib.h>
#include <string.h>

#define MESSAGES 40u
#define BODY_MAX 1000u

static uint8_t stream[MESSAGES * (LW_FRAMING_HEADER_SIZE + BODY_MAX)];
static size_t stream_size;

static size_t body_size(unsigned i) { return i % 7 == 3 ? 0 : i * 97 % (BODY_MAX + 1); }

static void write_stream(void) {
    stream_size = 0;
    for (unsigned i = 0; i < MESSAGES; i++) {
        lw_framing_write_header(
            stream + stream_size,
            (struct lw_framing_header){.body_size = (uint32_t)body_size(i), .type = (uint16_t)(i + 1)});
        stream_size += LW_FRAMING_HEADER_SIZE;
        memset(stream + stream_size, (int)i, body_size(i));
        stream_size += body_size(i);
    }
}

/* Takes what there is, at most `most` messages, from number *i on. */
static void take_messages(struct lw_message_reader *reader, unsigned *i, unsigned most) {
    struct lw_framing_header header;
    const uint8_t *body;
    for (unsigned taken = 0; taken < most; taken++) {
        lw_support_ok(lw_message_reader_take(reader, &header, &body, NULL), NULL);
        if (!body) return;
        assert_int_equal(header.type, *i + 1);
        assert_int_equal(header.body_size, body_size(*i));
        for (size_t b = 0; b < header.body_size; b++) assert_int_equal(body[b], *i);
        ++*i;
    }
}

/* The same messages come out, however the stream is cut and however many are left for later. */
static void test_pieces(void **state) {
    (void)state;
    static const size_t pieces[] = {1, 2, 7, 8, 9, 100, 1007, 1008, 1009, 5000, sizeof stream};
    static const unsigned mosts[] = {1, 2, MESSAGES};
    write_stream();
    for (size_t p = 0; p < sizeof pieces / sizeof *pieces; p++)
        for (size_t m = 0; m < sizeof mosts / sizeof *mosts; m++) {
            struct lw_message_reader reader = {.body_max = BODY_MAX};
            unsigned i = 0;
            for (size_t at = 0; at < stream_size; at += pieces[p]) {
                const size_t left = stream_size - at, size = left < pieces[p] ? left : pieces[p];
                uint8_t *piece = malloc(size); /* so that a sanitizer sees late reads */
                assert_non_null(piece);
                memcpy(piece, stream + at, size);
                lw_message_reader_lend(&reader, piece, size);
                take_messages(&reader, &i, mosts[m]);
                lw_support_ok(lw_message_reader_keep(&reader), NULL);
                free(piece);
            }
            take_messages(&reader, &i, MESSAGES);
            assert_int_equal(i, MESSAGES);
            lw_support_ok(lw_message_reader_keep(&reader), NULL);
            assert_null(reader.kept); /* nobody who is silent takes memory */
        }
}

/* What lies in one piece is read where it lies. */
static void test_no_copy(void **state) {
    (void)state;
    struct lw_message_reader reader = {.body_max = BODY_MAX};
    unsigned i = 0;
    write_stream();
    lw_message_reader_lend(&reader, stream, stream_size);
    failing_memory_all(0);
    take_messages(&reader, &i, MESSAGES);
    lw_support_ok(lw_message_reader_keep(&reader), NULL);
    (void)failing_memory_end();
    assert_int_equal(i, MESSAGES);
}

static void test_bad_header(void **state) {
    (void)state;
    uint8_t bytes[LW_FRAMING_HEADER_SIZE];
    struct lw_message_reader reader = {.body_max = BODY_MAX};
    struct lw_framing_header header;
    const uint8_t *body;
    lw_framing_write_header(bytes, (struct lw_framing_header){.body_size = BODY_MAX + 1, .type = 1});
    for (size_t kept = 0; kept < LW_FRAMING_HEADER_SIZE; kept += 7) {
        lw_message_reader_lend(&reader, bytes, kept);
        lw_support_ok(lw_message_reader_keep(&reader), NULL);
        lw_message_reader_lend(&reader, bytes + kept, sizeof bytes - kept);
        for (int again = 0; again < 2; again++) {
            struct lw_error err = {0};
            lw_support_fails(lw_message_reader_take(&reader, &header, &body, &err), LW_PROTOCOL, &err,
                             "1001 bytes");
            assert_null(body);
        }
        lw_message_reader_clear(&reader);
    }
}

static void test_no_memory(void **state) {
    (void)state;
    struct lw_message_reader reader = {.body_max = BODY_MAX};
    struct lw_framing_header header;
    const uint8_t *body;
    write_stream();
    lw_message_reader_lend(&reader, stream, 5);
    failing_memory_all(0);
    assert_int_equal(lw_message_reader_keep(&reader), LW_NO_MEMORY);
    (void)failing_memory_end();
    lw_support_ok(lw_message_reader_keep(&reader), NULL);
    lw_message_reader_lend(&reader, stream + 5, stream_size - 5);
    failing_memory_all(0);
    assert_int_equal(lw_message_reader_take(&reader, &header, &body, NULL), LW_NO_MEMORY);
    (void)failing_memory_end();
    unsigned i = 0; /* nothing of it is lost */
    take_messages(&reader, &i, MESSAGES);
    assert_int_equal(i, MESSAGES);
    lw_message_reader_clear(&reader);
}

int main(void) {
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(test_pieces),
        cmocka_unit_test(test_no_copy),
        cmocka_unit_test(test_bad_header),
        cmocka_unit_test(test_no_memory),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
