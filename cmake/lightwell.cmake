# How the project builds its own targets: warnings, sanitizers, and one function per kind of target.

option(LW_WERROR "Treat warnings as errors" OFF)
set(LW_SANITIZE "" CACHE STRING "Sanitizers for all of our code, e.g. address,undefined or thread")
option(LW_FUZZ "Build the fuzzers with libFuzzer (clang); otherwise they replay their corpus" OFF)
option(LW_COMPILE_ONLY "No program is run while others are built: for the warnings of one more compiler" OFF)
option(LW_COVERAGE "Instrument for gcov" OFF)
set(LW_INVARIANTS AUTO CACHE STRING "Checks of our own state (common/base/invariant.h): OFF, CHEAP, ALL, or AUTO: by the build type")
set_property(CACHE LW_INVARIANTS PROPERTY STRINGS AUTO OFF CHEAP ALL)

if(NOT CMAKE_BUILD_TYPE)
  set(CMAKE_BUILD_TYPE Release)
endif()

add_library(lw_flags INTERFACE)
target_compile_options(lw_flags INTERFACE
  -Wall -Wextra -Wshadow -Wpointer-arith $<$<COMPILE_LANGUAGE:C>:-Wstrict-prototypes -Wmissing-prototypes>
  -Wvla -Wundef -Wwrite-strings -Wdouble-promotion -Wformat=2
  $<$<C_COMPILER_ID:GNU>:-Wno-format-truncation> # snprintf cuts on purpose: texts for people have a bound
  # nobody reads errno or traps, which would keep loops from becoming vectors; the numbers stay the same
  -fno-math-errno -fno-trapping-math -ffp-contract=off -fno-strict-aliasing)
target_compile_definitions(lw_flags INTERFACE _GNU_SOURCE LW_VERSION="${PROJECT_VERSION}")
target_include_directories(lw_flags INTERFACE ${PROJECT_SOURCE_DIR})
set(invariants "${LW_INVARIANTS}")
if(invariants STREQUAL AUTO AND CMAKE_BUILD_TYPE STREQUAL Debug)
  set(invariants ALL)
elseif(invariants STREQUAL AUTO)
  set(invariants CHEAP)
endif()
set(levels OFF CHEAP ALL)
list(FIND levels "${invariants}" level)
if(level LESS 0)
  message(FATAL_ERROR "LW_INVARIANTS is ${LW_INVARIANTS}; it may be AUTO, OFF, CHEAP or ALL")
endif()
target_compile_definitions(lw_flags INTERFACE LW_INVARIANT_LEVEL=${level})
if(LW_WERROR)
  target_compile_options(lw_flags INTERFACE -Werror)
endif()
if(LW_SANITIZE)
  target_compile_options(lw_flags INTERFACE -fsanitize=${LW_SANITIZE} -fno-omit-frame-pointer -fno-sanitize-recover=all)
  target_link_options(lw_flags INTERFACE -fsanitize=${LW_SANITIZE})
endif()
if(LW_FUZZ)
  if(NOT CMAKE_C_COMPILER_ID MATCHES Clang)
    message(FATAL_ERROR "LW_FUZZ needs clang (it brings libFuzzer): use the preset `fuzz`, or -DCMAKE_C_COMPILER=clang")
  endif()
  target_compile_options(lw_flags INTERFACE -fsanitize=fuzzer-no-link)
  target_link_options(lw_flags INTERFACE -fsanitize=fuzzer-no-link)
endif()
if(LW_COVERAGE)
  target_compile_options(lw_flags INTERFACE --coverage)
  target_compile_definitions(lw_flags INTERFACE LW_COVERAGE)
  target_link_options(lw_flags INTERFACE --coverage)
endif()

# lw_library(NAME SOURCES ... [PUBLIC libs] [PRIVATE libs]): one static library per folder.
function(lw_library name)
  cmake_parse_arguments(arg "" "" "SOURCES;PUBLIC;PRIVATE" ${ARGN})
  add_library(${name} STATIC ${arg_SOURCES})
  target_link_libraries(${name} PUBLIC lw_flags ${arg_PUBLIC} PRIVATE ${arg_PRIVATE})
endfunction()

# lw_program(NAME SOURCES ... LIBS ... [COMMANDS ...]); the target `programs` is all of them. Manual pages (one for each of
# COMMANDS, the program's first word, too) and completion for bash are what the program prints of its own options.
add_custom_target(programs)
function(lw_program name)
  cmake_parse_arguments(arg "" "" "SOURCES;LIBS;COMMANDS" ${ARGN})
  add_executable(${name} ${arg_SOURCES})
  target_link_libraries(${name} PRIVATE lw_flags ${arg_LIBS})
  add_dependencies(programs ${name})
  install(TARGETS ${name})
  if(CMAKE_CROSSCOMPILING)
    return()
  endif()
  set(completion ${CMAKE_BINARY_DIR}/completions/${name})
  set(pages ${CMAKE_BINARY_DIR}/man/${name}.1)
  set(print COMMAND ${name} --help=man > ${CMAKE_BINARY_DIR}/man/${name}.1 COMMAND ${name} --help=bash > ${completion})
  foreach(command IN LISTS arg_COMMANDS)
    list(APPEND pages ${CMAKE_BINARY_DIR}/man/${name}-${command}.1)
    list(APPEND print COMMAND ${name} ${command} --help=man > ${CMAKE_BINARY_DIR}/man/${name}-${command}.1
      COMMAND ${name} ${command} --help=bash >> ${completion})
  endforeach()
  add_custom_command(OUTPUT ${completion} ${pages}
    COMMAND ${CMAKE_COMMAND} -E make_directory ${CMAKE_BINARY_DIR}/man ${CMAKE_BINARY_DIR}/completions
    ${print} DEPENDS ${name} VERBATIM)
  add_custom_target(${name}-manual ALL DEPENDS ${completion} ${pages})
  add_dependencies(programs ${name}-manual)
  install(FILES ${pages} DESTINATION ${CMAKE_INSTALL_MANDIR}/man1)
  install(FILES ${completion} DESTINATION ${CMAKE_INSTALL_DATADIR}/bash-completion/completions)
endfunction()

# What every test's process finds in its environment.
function(lw_test_environment name)
  # tests run beside each other: threads that have nothing to do should not spin
  set_property(TEST ${name} APPEND PROPERTY ENVIRONMENT "OMP_WAIT_POLICY=passive")
  # scripts read what lightwelld says
  set_property(TEST ${name} APPEND PROPERTY ENVIRONMENT "LIGHTWELL_LOG_FORMAT=text")
  if(LW_SANITIZE MATCHES "thread")
    # libomp, Embree and TBB are not instrumented: archer (part of libomp) tells TSan of OpenMP's barriers, and memory
    # that only those libraries touch is not looked at; threads are joined before the end, so nothing is waited for
    # there: a test that starts a hundred programs would wait a second for each
    set_property(TEST ${name} APPEND PROPERTY ENVIRONMENT
      "TSAN_OPTIONS=ignore_noninstrumented_modules=1:atexit_sleep_ms=0:suppressions=${PROJECT_SOURCE_DIR}/tests/tsan.supp")
  endif()
  if(LW_SANITIZE MATCHES "undefined")
    set_property(TEST ${name} APPEND PROPERTY ENVIRONMENT "UBSAN_OPTIONS=print_stacktrace=1")
  endif()
endfunction()

# The time limit of every test, seconds: it ends what hangs and judges nothing. Thirty times what the longest takes on two quiet
# cores, so that a slow machine on which a test gets a tenth of a core does not reach it.
set(LW_TEST_TIMEOUT 1800)
if(LW_SANITIZE)
  math(EXPR LW_TEST_TIMEOUT "4 * ${LW_TEST_TIMEOUT}") # instrumented code is slower
endif()

# The tests of one label, as targets.
foreach(label unit golden reference integration threaded)
  add_custom_target(${label}_tests)
endforeach()

# lw_test(LABEL NAME LIBS ... [WRAP symbols] [COST seconds] [THREADED] [LONG]): tests/LABEL/NAME.c with cmocka, one process,
# a ctest entry with a time limit. WRAP names functions that the test replaces (__wrap_x, __real_x). COST says about how long
# it takes if that is long: such tests start first. THREADED also runs it under ThreadSanitizer (label `threaded`). LONG: with
# an argument it runs other tests, NAME_long (label `long`).
function(lw_test label name)
  cmake_parse_arguments(arg "THREADED;LONG" "COST" "LIBS;WRAP" ${ARGN})
  set(labels ${label})
  if(arg_THREADED)
    list(APPEND labels threaded)
  endif()
  add_executable(${name} ${name}.c)
  target_link_libraries(${name} PRIVATE lw_flags lw_test_support ${arg_LIBS} cmocka::cmocka)
  foreach(each IN LISTS labels)
    add_dependencies(${each}_tests ${name})
  endforeach()
  foreach(symbol IN LISTS arg_WRAP)
    target_link_options(${name} PRIVATE -Wl,--wrap=${symbol})
  endforeach()
  add_test(NAME ${name} COMMAND ${name})
  set_tests_properties(${name} PROPERTIES LABELS "${labels}" TIMEOUT ${LW_TEST_TIMEOUT})
  if(arg_COST)
    set_tests_properties(${name} PROPERTIES COST ${arg_COST})
  endif()
  lw_test_environment(${name})
  if(arg_LONG)
    add_test(NAME ${name}_long COMMAND ${name} long)
    set_tests_properties(${name}_long PROPERTIES LABELS long TIMEOUT ${LW_TEST_TIMEOUT})
    lw_test_environment(${name}_long)
  endif()
endfunction()

# lw_fuzzer(NAME LIBS ...): tests/fuzz/NAME.c defines LLVMFuzzerTestOneInput. In ctest its corpus,
# tests/fuzz/corpus/NAME, is replayed: by libFuzzer with LW_FUZZ, otherwise by a plain driver.
function(lw_fuzzer name)
  cmake_parse_arguments(arg "" "" "LIBS" ${ARGN})
  set(corpus ${PROJECT_SOURCE_DIR}/tests/fuzz/corpus/${name})
  add_executable(${name} ${name}.c)
  target_link_libraries(${name} PRIVATE lw_flags ${arg_LIBS})
  target_compile_options(${name} PRIVATE -Wno-missing-prototypes) # the entry point has no header
  if(LW_FUZZ)
    target_compile_definitions(${name} PRIVATE LW_FUZZ)
    target_link_options(${name} PRIVATE -fsanitize=fuzzer)
    add_test(NAME ${name} COMMAND ${name} -runs=0 ${corpus})
  else()
    target_sources(${name} PRIVATE ${PROJECT_SOURCE_DIR}/tests/fuzz/replay.c)
    add_test(NAME ${name} COMMAND ${name} ${corpus})
  endif()
  set_tests_properties(${name} PROPERTIES LABELS unit TIMEOUT ${LW_TEST_TIMEOUT})
  add_dependencies(unit_tests ${name})
  lw_test_environment(${name})
endfunction()
