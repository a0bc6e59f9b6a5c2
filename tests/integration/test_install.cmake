# Installs into new folders and uses what is there:
# * liblightwell, moved, by what pkg-config says alone: each header by itself, and the example of
#   docs/client_guide.md, in C and in C++;
# * everything, below a DESTDIR: lightwelld lights a scene file.
# Given: SOURCE_DIR, BINARY_DIR, COMPILER_C, COMPILER_CXX, FLAGS (of sanitizers), BINDIR, LIBDIR, DOCDIR,
# PKG_CONFIG

cmake_minimum_required(VERSION 3.25)
set(work ${BINARY_DIR}/tests/integration/install)
file(REMOVE_RECURSE ${work})

# ---- the library ----

execute_process(COMMAND ${CMAKE_COMMAND} --install ${BINARY_DIR} --component client --prefix ${work}/first
  OUTPUT_QUIET COMMAND_ERROR_IS_FATAL ANY)
file(RENAME ${work}/first ${work}/moved)

set(ENV{PKG_CONFIG_PATH} ${work}/moved/${LIBDIR}/pkgconfig)
foreach(what cflags libs)
  execute_process(COMMAND ${PKG_CONFIG} --${what} lightwell
    OUTPUT_VARIABLE ${what} OUTPUT_STRIP_TRAILING_WHITESPACE COMMAND_ERROR_IS_FATAL ANY)
  separate_arguments(${what} UNIX_COMMAND "${${what}}")
endforeach()

file(GLOB include_dir ${work}/moved/include/lightwell-*)
file(GLOB_RECURSE headers RELATIVE ${include_dir} ${include_dir}/*.h)
if(NOT "lightwell/client.h" IN_LIST headers)
  message(FATAL_ERROR "lightwell/client.h is not installed in ${include_dir}")
endif()

# The example is a function's body after its include; nobody serves at port 1.
file(READ ${SOURCE_DIR}/docs/client_guide.md guide)
string(FIND "${guide}" "```c\n" begin)
string(SUBSTRING "${guide}" ${begin} -1 guide)
string(SUBSTRING "${guide}" 5 -1 guide)
string(FIND "${guide}" "```" end)
string(SUBSTRING "${guide}" 0 ${end} example)
string(REPLACE "#include <lightwell/client.h>" "" body "${example}")
string(REPLACE "desc.port = 7780;" "desc.port = 1;" body "${body}")
if(body STREQUAL example OR NOT body MATCHES "desc.port = 1;")
  message(FATAL_ERROR "docs/client_guide.md: its first example has no include, or connects to another port than 7780")
endif()
set(program "#include <lightwell/client.h>

#include <common/clock.h>
#include <stdio.h>
#include <stdlib.h>

static void die(const char *text) {
    fprintf(stderr, \"%s\\n\", text);
    exit(7);
}

/* Something of each of the headers that client.h brings, and of clock.h. */
static void use_each_header(void) {
    const struct lw_affine place = LW_AFFINE_IDENTITY;
    struct lw_atlas atlas;
    struct lw_scene *empty;
    if (lw_scene_create(&empty) != LW_OK) die(lw_status_text(LW_NO_MEMORY));
    lw_atlas_init(&atlas, 64, 64);
    if (lw_scene_change_targets(empty, LW_SCENE_CHANGE_OF_MESH) != 0 || atlas.level_count != 3 ||
        lw_affine_determinant(&place) < 0.5f || lw_clock_ns() == 0)
        die(\"the library is another one than its headers say\");
    lw_scene_destroy(empty);
}

int main(void) {
    use_each_header();
${body}
    lw_client_destroy(client);
}
")

set(standard_C gnu17)
set(suffix_C c)
set(standard_CXX c++17)
set(suffix_CXX cpp)
# that it has variables for the reader alone, and {0}, of which some compilers warn
set(example_may -Wno-unused-variable -Wno-unused-but-set-variable -Wno-missing-field-initializers)
foreach(language C CXX)
  set(compile ${COMPILER_${language}} -std=${standard_${language}} -Wall -Wextra -pedantic -Werror
    ${FLAGS} ${cflags})
  set(source ${work}/alone.${suffix_${language}})
  foreach(header IN LISTS headers)
    file(WRITE ${source} "#include <${header}>\n#include <${header}>\n")
    execute_process(COMMAND ${compile} -fsyntax-only ${source} COMMAND_ERROR_IS_FATAL ANY)
  endforeach()

  set(source ${work}/example.${suffix_${language}})
  set(example ${work}/example_${language})
  file(WRITE ${source} "${program}")
  execute_process(COMMAND ${compile} ${example_may} ${source} -o ${example} ${libs}
    COMMAND_ERROR_IS_FATAL ANY)
  execute_process(COMMAND ${example} RESULT_VARIABLE code ERROR_VARIABLE told)
  if(NOT code EQUAL 7 OR NOT told MATCHES "127.0.0.1")
    message(FATAL_ERROR "the example, as ${language}, ended with ${code}: ${told}")
  endif()
endforeach()

# ---- everything ----

execute_process(COMMAND ${CMAKE_COMMAND} -E env DESTDIR=${work}/root
  ${CMAKE_COMMAND} --install ${BINARY_DIR} --prefix /opt/lightwell
  OUTPUT_QUIET COMMAND_ERROR_IS_FATAL ANY)
set(prefix ${work}/root/opt/lightwell)
foreach(program lightwelld lightwellctl lightwell-view lightwell-bake lightwell-import lightwell-load)
  execute_process(COMMAND ${prefix}/${BINDIR}/${program} --version OUTPUT_QUIET COMMAND_ERROR_IS_FATAL ANY)
endforeach()
foreach(file ${LIBDIR}/liblightwell.a ${DOCDIR}/LICENSE ${DOCDIR}/README.md ${DOCDIR}/docs/operations.md)
  if(NOT EXISTS ${prefix}/${file})
    message(FATAL_ERROR "${prefix}/${file} is not installed")
  endif()
endforeach()

# The daemon has nothing but its own folder to find the importer in.
set(ENV{PATH} ${work}/moved)
execute_process(COMMAND ${prefix}/${BINDIR}/lightwelld ${SOURCE_DIR}/tests/fuzz/corpus/fuzz_gltf/base.gltf
  --sky 1,1,1 --light whole --clock step --frames 1 --listen 127.0.0.1:0 --threads 2
  TIMEOUT 120 RESULT_VARIABLE code ERROR_VARIABLE told)
if(NOT code EQUAL 0)
  message(FATAL_ERROR "the installed lightwelld ended with ${code}: ${told}")
endif()
