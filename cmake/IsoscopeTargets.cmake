# The only way to make a target in this project. Every helper adds the include root (the top of the
# repository), the warnings, strict floating point and the sanitizers.

# Sets `compiled` to sources that include those of `target` by some, and to those that are compiled alone. What a unit
# includes takes half of its time to compile (docs/lab/compile_time.md). The includes are relative to the repository,
# so that compiler caches know them in another folder.
#
# Alone are kernels, which include themselves for each instruction set, what the build generates, and `apart`.
function(isoscope_batches compiled target sources apart)
  set(units ${sources})
  if(ISOSCOPE_BATCH_SIZE GREATER 1)
    set(units "")
    set(batch "")
    set(index 0)
    list(LENGTH sources left)
    foreach(source IN LISTS sources)
      math(EXPR left "${left} - 1")
      cmake_path(ABSOLUTE_PATH source OUTPUT_VARIABLE path)
      cmake_path(IS_PREFIX CMAKE_BINARY_DIR "${path}" NORMALIZE is_generated)
      set(kernel "")
      if(NOT is_generated)
        file(STRINGS "${path}" kernel REGEX "foreach_target\\.h" LIMIT_COUNT 1)
      endif()
      if(is_generated OR kernel OR source IN_LIST apart)
        list(APPEND units "${source}")
      else()
        cmake_path(RELATIVE_PATH path BASE_DIRECTORY "${PROJECT_SOURCE_DIR}")
        string(APPEND batch "#include \"${path}\"\n")
        math(EXPR index "${index} + 1")
      endif()
      math(EXPR rest "${index} % ${ISOSCOPE_BATCH_SIZE}")
      if(batch AND (rest EQUAL 0 OR left EQUAL 0))
        math(EXPR number "(${index} + ${ISOSCOPE_BATCH_SIZE} - 1) / ${ISOSCOPE_BATCH_SIZE}")
        set(unit "${CMAKE_CURRENT_BINARY_DIR}/${target}_${number}.cc")
        file(CONFIGURE OUTPUT "${unit}" CONTENT "${batch}" @ONLY)
        # A class in an included file may have members of types that only that file knows.
        set_source_files_properties("${unit}" PROPERTIES
          COMPILE_OPTIONS "$<$<CXX_COMPILER_ID:GNU>:-Wno-subobject-linkage>")
        list(APPEND units "${unit}")
        set(batch "")
      endif()
    endforeach()
  endif()
  set(${compiled} ${units} PARENT_SCOPE)
endfunction()

# isoscope_library(NAME store SRCS a.cc b.cc c.cc APART c.cc HDRS a.h DEPS isoscope::base PRIVATE_DEPS PkgConfig::ZSTD)
#
# Makes the library isoscope_store with the alias isoscope::store: static, or shared where ISOSCOPE_SHARED_LIBRARIES says
# so and it is no library of tests, which hold GoogleTest.
function(isoscope_library)
  cmake_parse_arguments(ARG "" "NAME" "SRCS;APART;HDRS;DEPS;PRIVATE_DEPS" ${ARGN})
  set(target isoscope_${ARG_NAME})
  if(ARG_SRCS)
    isoscope_batches(units ${target} "${ARG_SRCS}" "${ARG_APART}")
    set(kind ${ISOSCOPE_LIBRARY_KIND})
    cmake_path(IS_PREFIX ISOSCOPE_TESTS_DIR "${CMAKE_CURRENT_SOURCE_DIR}" NORMALIZE is_for_tests)
    if(is_for_tests)
      set(kind STATIC)
    endif()
    add_library(${target} ${kind} ${units} ${ARG_HDRS})
    if(kind STREQUAL SHARED)
      # The product calls its own inline functions, not the copies of a test.
      target_link_options(${target} PRIVATE LINKER:-Bsymbolic-functions)
    endif()
    set(scope PUBLIC)
    target_link_libraries(${target}
      PUBLIC ${ARG_DEPS} isoscope::fp_strict isoscope::sanitizers
      PRIVATE ${ARG_PRIVATE_DEPS} isoscope::warnings)
  else()
    add_library(${target} INTERFACE ${ARG_HDRS})
    set(scope INTERFACE)
    target_link_libraries(${target} INTERFACE ${ARG_DEPS} isoscope::fp_strict isoscope::sanitizers)
  endif()
  target_include_directories(${target} ${scope} "${PROJECT_SOURCE_DIR}")
  add_library(isoscope::${ARG_NAME} ALIAS ${target})
endfunction()

# isoscope_module(NAME isoscope_dicom SRCS entry.cc DEPS isoscope::dicom_child)
#
# Makes lib/isoscope/NAME.so, beside the folder of the programs, where core/source/child/decoder_module.cc looks for it.
function(isoscope_module)
  cmake_parse_arguments(ARG "" "NAME" "SRCS;DEPS" ${ARGN})
  add_library(${ARG_NAME} MODULE ${ARG_SRCS})
  target_link_libraries(${ARG_NAME} PRIVATE
    ${ARG_DEPS} isoscope::warnings isoscope::fp_strict isoscope::sanitizers)
  set_target_properties(${ARG_NAME} PROPERTIES
    PREFIX "" LIBRARY_OUTPUT_DIRECTORY "${CMAKE_BINARY_DIR}/lib/isoscope")
endfunction()

# isoscope_executable(NAME isoscope-agent SRCS main.cc DEPS isoscope::agent)
function(isoscope_executable)
  cmake_parse_arguments(ARG "" "NAME" "SRCS;DEPS" ${ARGN})
  add_executable(${ARG_NAME} ${ARG_SRCS} $<TARGET_OBJECTS:isoscope_program_version>)
  target_include_directories(${ARG_NAME} PRIVATE "${PROJECT_SOURCE_DIR}")
  target_link_libraries(${ARG_NAME} PRIVATE
    ${ARG_DEPS} isoscope::warnings isoscope::fp_strict isoscope::sanitizers)
endfunction()

# Makes the target LABEL_tests build NAME.
function(isoscope_test_of_label label name)
  if(NOT TARGET ${label}_tests)
    add_custom_target(${label}_tests)
  endif()
  add_dependencies(${label}_tests ${name})
endfunction()

# isoscope_test(NAME foo_test SRCS foo_test.cc DEPS isoscope::store LABELS unit)
#
# Registers one CTest entry for the whole binary. Labels: unit, integration, golden, slow; guard, for a test of programs
# that scripts/test.sh always runs; both, for one that it runs in release and with AddressSanitizer; and threads, for one
# that it runs with ThreadSanitizer, too. The target LABEL_tests builds those of a label.
function(isoscope_test)
  cmake_parse_arguments(ARG "" "NAME;TIMEOUT" "SRCS;DEPS;LABELS" ${ARGN})
  if(NOT ARG_LABELS)
    set(ARG_LABELS unit)
  endif()
  # Against a hang: more than ten times what a test takes on an idle machine.
  if(NOT ARG_TIMEOUT)
    set(ARG_TIMEOUT 1200)
    set(cost 300)
  else()
    set(cost ${ARG_TIMEOUT})
  endif()
  if(ISOSCOPE_SANITIZE)
    math(EXPR ARG_TIMEOUT "3 * ${ARG_TIMEOUT}")
  endif()
  add_executable(${ARG_NAME} ${ARG_SRCS})
  target_include_directories(${ARG_NAME} PRIVATE "${PROJECT_SOURCE_DIR}")
  target_link_libraries(${ARG_NAME} PRIVATE
    ${ARG_DEPS} isoscope::test_support GTest::gmock GTest::gtest_main
    isoscope::warnings isoscope::fp_strict isoscope::test_sanitizers isoscope::test_linker)
  if(ISOSCOPE_PRECOMPILED_HEADERS)
    target_precompile_headers(${ARG_NAME} REUSE_FROM isoscope_test_headers)
  endif()
  foreach(label IN LISTS ARG_LABELS)
    isoscope_test_of_label(${label} ${ARG_NAME})
  endforeach()
  set_target_properties(${ARG_NAME} PROPERTIES RUNTIME_OUTPUT_DIRECTORY "${CMAKE_BINARY_DIR}/tests")
  add_test(NAME ${ARG_NAME} COMMAND ${ARG_NAME})
  # CTest starts those of the highest cost first, so that no long one runs alone at the end.
  set_tests_properties(${ARG_NAME} PROPERTIES LABELS "${ARG_LABELS}" TIMEOUT ${ARG_TIMEOUT} COST ${cost})
  if(ISOSCOPE_SANITIZE MATCHES address)
    # The programs that a test runs inherit it.
    set(leaks "${PROJECT_SOURCE_DIR}/tests/support/leaks_of_libraries.supp")
    set_tests_properties(${ARG_NAME} PROPERTIES
      ENVIRONMENT "LSAN_OPTIONS=suppressions=${leaks}:print_suppressions=0")
  endif()
endfunction()

# isoscope_room_tests(NAME formats_vtk_tests DEPS isoscope::formats PkgConfig::EXPAT)
#
# Makes one program of all sources FOO_test.cc of the folder, and one CTest entry FOO_test for each: it runs the suites of
# that source alone, in a process of its own. Label: unit. Sources of APART are programs of their own. An entry that does
# not begin with PREFIX gets it. Sources of THREADS have the label threads, too: with ThreadSanitizer, the program has no
# others.
function(isoscope_room_tests)
  cmake_parse_arguments(ARG "" "NAME;PREFIX" "DEPS;APART;THREADS" ${ARGN})
  file(GLOB sources CONFIGURE_DEPENDS *_test.cc)
  if(ISOSCOPE_SANITIZE MATCHES thread)
    if(NOT ARG_THREADS)
      return()
    endif()
    list(TRANSFORM ARG_THREADS PREPEND "${CMAKE_CURRENT_SOURCE_DIR}/" OUTPUT_VARIABLE sources)
  endif()
  foreach(apart IN LISTS ARG_APART)
    list(REMOVE_ITEM sources "${CMAKE_CURRENT_SOURCE_DIR}/${apart}")
  endforeach()
  add_executable(${ARG_NAME} ${sources})
  target_include_directories(${ARG_NAME} PRIVATE "${PROJECT_SOURCE_DIR}")
  target_link_libraries(${ARG_NAME} PRIVATE
    ${ARG_DEPS} isoscope::test_support GTest::gmock GTest::gtest_main
    isoscope::warnings isoscope::fp_strict isoscope::test_sanitizers isoscope::test_linker)
  if(ISOSCOPE_PRECOMPILED_HEADERS)
    target_precompile_headers(${ARG_NAME} REUSE_FROM isoscope_test_headers)
  endif()
  isoscope_test_of_label(unit ${ARG_NAME})
  if(ARG_THREADS)
    isoscope_test_of_label(threads ${ARG_NAME})
  endif()
  set_target_properties(${ARG_NAME} PROPERTIES RUNTIME_OUTPUT_DIRECTORY "${CMAKE_BINARY_DIR}/tests")
  set(timeout 1200)
  set(environment "")
  if(ISOSCOPE_SANITIZE)
    set(timeout 3600)
  endif()
  if(ISOSCOPE_SANITIZE MATCHES address)
    set(environment
      "LSAN_OPTIONS=suppressions=${PROJECT_SOURCE_DIR}/tests/support/leaks_of_libraries.supp:print_suppressions=0")
  endif()
  foreach(source IN LISTS sources)
    # The suites: TEST(Suite, ...), TEST_F, TEST_P, TYPED_TEST.
    set_property(DIRECTORY APPEND PROPERTY CMAKE_CONFIGURE_DEPENDS "${source}")
    file(STRINGS "${source}" lines REGEX "^(TYPED_)?TEST(_F|_P)?\\([A-Za-z0-9_]+,")
    set(filter "")
    foreach(line IN LISTS lines)
      string(REGEX REPLACE "^[A-Z_]+\\(([A-Za-z0-9_]+),.*" "\\1" suite "${line}")
      list(APPEND filter "${suite}.*" "*/${suite}.*" "${suite}/*")
    endforeach()
    list(REMOVE_DUPLICATES filter)
    list(JOIN filter ":" filter)
    cmake_path(GET source STEM name)
    if(ARG_PREFIX AND NOT name MATCHES "^${ARG_PREFIX}")
      string(PREPEND name "${ARG_PREFIX}")
    endif()
    add_test(NAME ${name} COMMAND ${ARG_NAME} "--gtest_filter=${filter}")
    set(labels unit)
    cmake_path(GET source FILENAME file)
    if(file IN_LIST ARG_THREADS)
      list(APPEND labels threads)
    endif()
    set_tests_properties(${name} PROPERTIES
      LABELS "${labels}" TIMEOUT ${timeout} COST 300 ENVIRONMENT "${environment}")
  endforeach()
endfunction()

# isoscope_benchmark(NAME extract_benchmark SRCS extract_benchmark.cc DEPS isoscope::extract [TESTED REGEX])
#
# CTest runs one short iteration of it, so that it never rots; of those named by REGEX, if it is given.
function(isoscope_benchmark)
  cmake_parse_arguments(ARG "" "NAME;TESTED" "SRCS;DEPS" ${ARGN})
  if(NOT ARG_TESTED)
    set(ARG_TESTED ".")
  endif()
  add_executable(${ARG_NAME} ${ARG_SRCS})
  target_include_directories(${ARG_NAME} PRIVATE "${PROJECT_SOURCE_DIR}")
  target_link_libraries(${ARG_NAME} PRIVATE
    ${ARG_DEPS} isoscope::test_support benchmark::benchmark benchmark::benchmark_main
    isoscope::warnings isoscope::fp_strict isoscope::sanitizers isoscope::test_linker)
  set_target_properties(${ARG_NAME} PROPERTIES
    RUNTIME_OUTPUT_DIRECTORY "${CMAKE_BINARY_DIR}/benchmarks")
  add_test(NAME ${ARG_NAME} COMMAND ${ARG_NAME} --benchmark_min_time=0.01 "--benchmark_filter=${ARG_TESTED}")
  set_tests_properties(${ARG_NAME} PROPERTIES LABELS benchmark TIMEOUT 300)
  isoscope_test_of_label(benchmark ${ARG_NAME})
endfunction()

# isoscope_fuzzer(NAME manifest_fuzz SRCS manifest_fuzz.cc DEPS isoscope::store
#                 [DICTIONARY json.dict] [MUTATIONS 5000] [MAX_BYTES 4096] [HAS_THREADS])
#
# The driver as a libFuzzer program with ISOSCOPE_BUILD_FUZZERS (clang), and otherwise as a test of
# its seeds and of MUTATIONS changes of them. HAS_THREADS: libFuzzer can't tell its leaks apart.
# scripts/fuzz.sh reads the list that this makes: name, dictionary, longest input, threads.
function(isoscope_fuzzer)
  cmake_parse_arguments(ARG "HAS_THREADS" "NAME;DICTIONARY;MUTATIONS;MAX_BYTES" "SRCS;DEPS" ${ARGN})
  if(NOT ARG_MUTATIONS)
    set(ARG_MUTATIONS 2000)
  endif()
  if(NOT ARG_MAX_BYTES)
    set(ARG_MAX_BYTES 4096)
  endif()
  if(NOT ARG_DICTIONARY)
    set(ARG_DICTIONARY "-")
  endif()
  add_executable(${ARG_NAME} ${ARG_SRCS} $<TARGET_OBJECTS:isoscope_fuzz_main>)
  target_include_directories(${ARG_NAME} PRIVATE "${PROJECT_SOURCE_DIR}")
  target_link_libraries(${ARG_NAME} PRIVATE
    isoscope::fuzz_input ${ARG_DEPS} isoscope::warnings isoscope::fp_strict isoscope::sanitizers
    isoscope::test_linker)
  if(ISOSCOPE_BUILD_FUZZERS)
    target_link_options(${ARG_NAME} PRIVATE -fsanitize=fuzzer)
    set_target_properties(${ARG_NAME} PROPERTIES RUNTIME_OUTPUT_DIRECTORY "${CMAKE_BINARY_DIR}/fuzzers")
    set_property(GLOBAL APPEND_STRING PROPERTY ISOSCOPE_FUZZERS
      "${ARG_NAME} ${ARG_DICTIONARY} ${ARG_MAX_BYTES} ${ARG_HAS_THREADS}\n")
    set_property(GLOBAL APPEND PROPERTY ISOSCOPE_FUZZER_TARGETS ${ARG_NAME})
  else()
    set_target_properties(${ARG_NAME} PROPERTIES RUNTIME_OUTPUT_DIRECTORY "${CMAKE_BINARY_DIR}/tests")
    isoscope_test_of_label(unit ${ARG_NAME})
    add_test(NAME ${ARG_NAME} COMMAND ${ARG_NAME} --mutations ${ARG_MUTATIONS})
    set_tests_properties(${ARG_NAME} PROPERTIES LABELS unit TIMEOUT 300)
  endif()
endfunction()
