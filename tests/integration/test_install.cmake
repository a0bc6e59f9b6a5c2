# Installs into new folders and uses what is there:
# * liblightwell, moved: its symbols are those of its header; header, docs/client_guide.md's example and examples/ are
#   built in C and in C++, shared and static, by pkg-config and by find_package();
# * the examples run on a real lightwelld, shared and static;
# * everything, below a DESTDIR: lightwelld lights a scene file, manual pages and completion are there.
# Given: SOURCE_DIR, BINARY_DIR, COMPILER_C, COMPILER_CXX, FLAGS (of sanitizers), BINDIR, LIBDIR, DOCDIR, MANDIR,
# PKG_CONFIG, NM

cmake_minimum_required(VERSION 3.25)
set(work ${BINARY_DIR}/tests/integration/install)
file(REMOVE_RECURSE ${work})

# run(WHAT COMMAND...): ends the test with what it said unless it succeeds; out: its output
function(run what)
  execute_process(COMMAND ${ARGN} RESULT_VARIABLE code OUTPUT_VARIABLE told ERROR_VARIABLE told TIMEOUT 500)
  if(NOT code EQUAL 0)
    message(FATAL_ERROR "${what} ended with ${code}: ${told}")
  endif()
  set(out "${told}" PARENT_SCOPE)
endfunction()

# ---- the library: what is there ----

run("the installation" ${CMAKE_COMMAND} -E env DESTDIR=${work}/first
  ${CMAKE_COMMAND} --install ${BINARY_DIR} --component client --prefix /opt/lightwell)
file(RENAME ${work}/first/opt/lightwell ${work}/moved)
set(moved ${work}/moved)

file(GLOB_RECURSE headers RELATIVE ${moved}/include ${moved}/include/*)
if(NOT headers STREQUAL "lightwell/lightwell.h")
  message(FATAL_ERROR "the headers that are installed are ${headers}, not lightwell/lightwell.h alone")
endif()

# Functions that the header declares, against the names that each library lets others see.
file(READ ${moved}/include/lightwell/lightwell.h header)
string(REGEX REPLACE "/\\*[^*]*\\*+([^/*][^*]*\\*+)*/" "" header "${header}")
string(REGEX MATCHALL "LW_LIVE_API[^(]*" declarations "${header}")
foreach(declaration IN LISTS declarations)
  if(declaration MATCHES "(lw_live_[a-z0-9_]+)$")
    list(APPEND declared ${CMAKE_MATCH_1})
  endif()
endforeach()
list(REMOVE_DUPLICATES declared)
list(SORT declared)
list(LENGTH declared count)
if(count LESS 20)
  message(FATAL_ERROR "only ${count} functions are found in lightwell.h: ${declared}")
endif()
foreach(library "-D;${moved}/${LIBDIR}/liblightwell.so" "${moved}/${LIBDIR}/liblightwell.a")
  run(nm ${NM} -g --defined-only --format=posix ${library})
  string(REGEX MATCHALL "(^|\n)[^ \n]+ [A-Z]" rows "${out}")
  set(seen "")
  foreach(row IN LISTS rows)
    string(REGEX REPLACE "^\n|\\[.*|@.*| .*" "" name "${row}")
    if(name AND NOT name MATCHES "^(__asan|__odr_asan|__ubsan|__tsan|__gcov|__sanitizer|_init$|_fini$)")
      list(APPEND seen ${name})
    endif()
  endforeach()
  list(SORT seen)
  if(NOT seen STREQUAL declared)
    message(FATAL_ERROR "${library} shows\n${seen}\nand its header declares\n${declared}")
  endif()
endforeach()
foreach(link liblightwell.so liblightwell.so.1)
  if(NOT IS_SYMLINK ${moved}/${LIBDIR}/${link})
    message(FATAL_ERROR "${link} is no link to a library with a version")
  endif()
endforeach()

# ---- the library: by pkg-config ----

set(ENV{PKG_CONFIG_PATH} ${moved}/${LIBDIR}/pkgconfig)
foreach(what cflags libs static)
  set(ask --${what})
  if(what STREQUAL "static")
    set(ask --static --libs)
  endif()
  run(pkg-config ${PKG_CONFIG} ${ask} lightwell)
  string(STRIP "${out}" ${what})
  separate_arguments(${what} UNIX_COMMAND "${${what}}")
endforeach()
list(TRANSFORM static REPLACE "^-llightwell$" "-l:liblightwell.a")
list(APPEND libs -Wl,-rpath,${moved}/${LIBDIR})

# The example is a function's body after its include; nobody serves at port 1.
file(READ ${SOURCE_DIR}/docs/client_guide.md guide)
string(FIND "${guide}" "```c\n" begin)
string(SUBSTRING "${guide}" ${begin} -1 guide)
string(SUBSTRING "${guide}" 5 -1 guide)
string(FIND "${guide}" "```" end)
string(SUBSTRING "${guide}" 0 ${end} example)
string(REPLACE "#include <lightwell/lightwell.h>" "" body "${example}")
string(REPLACE "desc.port = 7780;" "desc.port = 1;" body "${body}")
if(body STREQUAL example OR NOT body MATCHES "desc.port = 1;")
  message(FATAL_ERROR "docs/client_guide.md: its first example has no include, or connects to another port than 7780")
endif()
set(program "#include <lightwell/lightwell.h>

#include <stdio.h>
#include <stdlib.h>

static void die(const char *text) {
    fprintf(stderr, \"%s\\n\", text);
    exit(7);
}

static void upload(uint32_t object, uint32_t x, uint32_t y, uint32_t width, uint32_t height, const void *texels) {
    (void)object, (void)x, (void)y, (void)width, (void)height, (void)texels;
}

int main(void) {
${body}
    lw_live_close(live);
}
")

set(standard_C c11)
set(suffix_C c)
set(standard_CXX c++11)
set(suffix_CXX cpp)
# that it has variables for the reader alone, and {0}, of which some compilers warn
set(example_may -Wno-unused-variable -Wno-unused-but-set-variable -Wno-missing-field-initializers)
foreach(language C CXX)
  set(compile ${COMPILER_${language}} -std=${standard_${language}} -Wall -Wextra -pedantic -Werror
    ${FLAGS} ${cflags})
  set(source ${work}/alone.${suffix_${language}})
  file(WRITE ${source} "#include <lightwell/lightwell.h>\n#include <lightwell/lightwell.h>\n")
  run("the header alone, as ${language}," ${compile} -fsyntax-only ${source})

  set(source ${work}/example.${suffix_${language}})
  file(WRITE ${source} "${program}")
  foreach(kind libs static)
    set(example ${work}/example_${language}_${kind})
    run("building the guide's example" ${compile} ${example_may} ${source} -o ${example} ${${kind}})
    execute_process(COMMAND ${example} RESULT_VARIABLE code ERROR_VARIABLE told)
    if(NOT code EQUAL 7 OR NOT told MATCHES "127.0.0.1")
      message(FATAL_ERROR "the example, as ${language}, ${kind}, ended with ${code}: ${told}")
    endif()
  endforeach()
endforeach()

# ---- the examples: by find_package(), with warnings as errors ----

file(WRITE ${work}/examples/CMakeLists.txt "cmake_minimum_required(VERSION 3.25)
project(examples C CXX)
set(CMAKE_CXX_STANDARD 17)
find_package(lightwell 0.1 REQUIRED)
find_package(PkgConfig REQUIRED)
pkg_check_modules(gl REQUIRED IMPORTED_TARGET epoxy egl)
add_compile_options(-Wall -Wextra -Werror ${FLAGS})
add_link_options(${FLAGS})
foreach(kind lightwell lightwell_static)
  add_executable(minimal_\${kind} ${SOURCE_DIR}/examples/minimal.c)
  add_executable(finer_\${kind} ${SOURCE_DIR}/examples/finer.c)
  add_executable(gl_lightmap_\${kind} ${SOURCE_DIR}/examples/gl_lightmap.cpp)
  target_link_libraries(minimal_\${kind} lightwell::\${kind})
  target_link_libraries(finer_\${kind} lightwell::\${kind} m)
  target_link_libraries(gl_lightmap_\${kind} lightwell::\${kind} PkgConfig::gl)
endforeach()
")
run("find_package(lightwell)" ${CMAKE_COMMAND} -S ${work}/examples -B ${work}/examples/build -G Ninja
  -DCMAKE_PREFIX_PATH=${moved} -DCMAKE_C_COMPILER=${COMPILER_C} -DCMAKE_CXX_COMPILER=${COMPILER_CXX})
run("building examples/" ${CMAKE_COMMAND} --build ${work}/examples/build)
foreach(limit "minimal.c;60" "finer.c;120" "gl_lightmap.cpp;300")
  list(GET limit 0 name)
  list(GET limit 1 most)
  file(STRINGS ${SOURCE_DIR}/examples/${name} lines)
  file(READ ${SOURCE_DIR}/examples/${name} text)
  string(REGEX MATCHALL "\n" lines "${text}")
  list(LENGTH lines count)
  if(count GREATER most)
    message(FATAL_ERROR "examples/${name} has ${count} lines, over ${most}")
  endif()
endforeach()

# The guide's example of finer levels is a part of examples/finer.c, line by line.
file(READ ${SOURCE_DIR}/docs/client_guide.md guide)
file(READ ${SOURCE_DIR}/examples/finer.c finer)
string(REGEX REPLACE ".*\n## Finer levels\n" "" guide "${guide}")
string(REGEX REPLACE "^[^`]*(`[^`]+`[^`]*)*```c\n" "" guide "${guide}")
string(REGEX REPLACE "```.*" "" guide "${guide}")
string(REPLACE ";" "\\;" guide "${guide}")
string(REPLACE "\n" ";" guide "${guide}")
list(LENGTH guide count)
foreach(line IN LISTS guide)
  string(STRIP "${line}" line)
  string(FIND "${finer}" "${line}" at)
  if(at EQUAL -1 OR count LESS 10)
    message(FATAL_ERROR "docs/client_guide.md, Finer levels: examples/finer.c has no line \"${line}\"")
  endif()
endforeach()

# ---- everything ----

run("the installation" ${CMAKE_COMMAND} -E env DESTDIR=${work}/root
  ${CMAKE_COMMAND} --install ${BINARY_DIR} --prefix /opt/lightwell)
set(prefix ${work}/root/opt/lightwell)
set(programs lightwelld lightwell-relay lightwellctl lightwell-view lightwell-bake lightwell-import lightwell-load)
foreach(program IN LISTS programs)
  run(${program} ${prefix}/${BINDIR}/${program} --version)
  list(APPEND manuals ${MANDIR}/man1/${program}.1)
endforeach()
foreach(file ${LIBDIR}/liblightwell.a ${LIBDIR}/liblightwell.so ${DOCDIR}/LICENSE ${DOCDIR}/README.md
    lib/systemd/system/lightwelld.service ${DOCDIR}/systemd/lightwelld.conf lib/systemd/system/lightwell-relay@.service ${DOCDIR}/systemd/lightwell-relay.conf ${DOCDIR}/docs/running.md ${DOCDIR}/examples/minimal.c ${manuals}
    ${MANDIR}/man1/lightwell-load-scaling.1 ${MANDIR}/man1/lightwell-load-crossover.1
    share/bash-completion/completions/lightwelld share/bash-completion/completions/lightwell-load)
  if(NOT EXISTS ${prefix}/${file})
    message(FATAL_ERROR "${prefix}/${file} is not installed")
  endif()
endforeach()

# The browser client, where it was built: its page, and the npm package.
if(EXISTS ${BINARY_DIR}/web/index.html)
  foreach(file web/index.html web/lightwell.css web/lightwell.js web/worker.js web/lightwell_tiles.wasm web/zstd.wasm
      lightwell-three/package.json lightwell-three/lightwell.js lightwell-three/lightwell.d.ts lightwell-three/worker.js
      lightwell-three/inline.js lightwell-three/inline.d.ts lightwell-three/lightwell_tiles.wasm
      lightwell-three/zstd.wasm lightwell-three/example.html lightwell-three/README.md lightwell-three/LICENSE
      lightwell-three/NOTICE)
    if(NOT EXISTS ${prefix}/share/lightwell/${file})
      message(FATAL_ERROR "${prefix}/share/lightwell/${file} is not installed")
    endif()
  endforeach()
endif()

# Bash completes options, their choices, and files.
function(completes line expected)
  execute_process(COMMAND bash -c "source ${prefix}/share/bash-completion/completions/$1
COMP_WORDS=($2 \"$3\") COMP_CWORD=$((\${#COMP_WORDS[@]} - 1))
_$(echo $1 | tr - _)
echo \"\${COMPREPLY[*]}\"" _ ${line} OUTPUT_VARIABLE told ERROR_VARIABLE told OUTPUT_STRIP_TRAILING_WHITESPACE)
  if(NOT told STREQUAL expected)
    message(FATAL_ERROR "bash completes ${line} to \"${told}\" instead of \"${expected}\"")
  endif()
endfunction()
completes("lightwelld;lightwelld;--frame-" "--frame-rate --frame-budget-ms --frame-budget-units")
completes("lightwelld;lightwelld --light;s" "seen")
completes("lightwell-load;lightwell-load;sc" "scaling")

# The daemon has nothing but its own folder to find the importer in.
set(path $ENV{PATH})
set(ENV{PATH} ${work}/moved)
run("the installed lightwelld" ${prefix}/${BINDIR}/lightwelld ${SOURCE_DIR}/tests/fuzz/corpus/fuzz_gltf/base.gltf
  --sky 1,1,1 --light whole --clock step --frames 1 --listen 127.0.0.1:0 --threads 2)
set(ENV{PATH} ${path})

# ---- the examples on it ----

foreach(kind lightwell lightwell_static)
  list(APPEND examples ${work}/examples/build/minimal_${kind} ${work}/examples/build/finer_${kind}
    ${work}/examples/build/gl_lightmap_${kind})
endforeach()
run("examples/ on lightwelld" bash ${SOURCE_DIR}/tests/integration/examples.sh ${prefix}/${BINDIR}/lightwelld
  ${work}/run ${examples})
message(STATUS "${out}")
