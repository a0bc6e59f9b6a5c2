# Installs liblightwell into a new folder, moves it, and builds and runs the example of docs/client_guide.md there, with
# what pkg-config says alone.
# Given: SOURCE_DIR, BINARY_DIR, COMPILER, FLAGS (of sanitizers), LIBDIR, PKG_CONFIG

set(work ${BINARY_DIR}/tests/integration/install)
file(REMOVE_RECURSE ${work})
execute_process(COMMAND ${CMAKE_COMMAND} --install ${BINARY_DIR} --component client --prefix ${work}/first
  OUTPUT_QUIET COMMAND_ERROR_IS_FATAL ANY)
file(RENAME ${work}/first ${work}/moved)

set(ENV{PKG_CONFIG_PATH} ${work}/moved/${LIBDIR}/pkgconfig)
execute_process(COMMAND ${PKG_CONFIG} --cflags --libs lightwell
  OUTPUT_VARIABLE said OUTPUT_STRIP_TRAILING_WHITESPACE COMMAND_ERROR_IS_FATAL ANY)
separate_arguments(said UNIX_COMMAND "${said}")

# The example is a function's body after its include; nobody serves at port 1.
file(READ ${SOURCE_DIR}/docs/client_guide.md guide)
string(FIND "${guide}" "```c\n" begin)
string(SUBSTRING "${guide}" ${begin} -1 guide)
string(SUBSTRING "${guide}" 5 -1 guide)
string(FIND "${guide}" "```" end)
string(SUBSTRING "${guide}" 0 ${end} example)
string(REPLACE "#include <lightwell/client.h>" "" body "${example}")
string(REPLACE ".port = 7780" ".port = 1" body "${body}")
if(body STREQUAL example OR NOT body MATCHES "port = 1}")
  message(FATAL_ERROR "docs/client_guide.md: its first example has no include, or connects to another port than 7780")
endif()
file(WRITE ${work}/example.c "#include <lightwell/client.h>

#include <stdio.h>
#include <stdlib.h>

static void die(const char *text) {
    fprintf(stderr, \"%s\\n\", text);
    exit(7);
}

int main(void) {
${body}
    lw_client_destroy(client);
}
")
execute_process(COMMAND ${COMPILER} ${FLAGS} ${work}/example.c -o ${work}/example ${said}
  COMMAND_ERROR_IS_FATAL ANY)
execute_process(COMMAND ${work}/example RESULT_VARIABLE code ERROR_VARIABLE told)
if(NOT code EQUAL 7 OR NOT told MATCHES "127.0.0.1")
  message(FATAL_ERROR "the example ended with ${code}: ${told}")
endif()
