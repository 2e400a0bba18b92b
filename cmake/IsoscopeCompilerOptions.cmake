# Language level, warnings and sanitizers, as INTERFACE targets that IsoscopeTargets.cmake links.

set(CMAKE_CXX_STANDARD 20)
set(CMAKE_CXX_STANDARD_REQUIRED ON)
set(CMAKE_CXX_EXTENSIONS OFF)
set(CMAKE_EXPORT_COMPILE_COMMANDS ON)
set(CMAKE_POSITION_INDEPENDENT_CODE ON)

if(NOT CMAKE_BUILD_TYPE)
  set(CMAKE_BUILD_TYPE Release CACHE STRING "Build type" FORCE)
endif()

# Debug builds are for editing, and clang's for tools: one source a unit.
set(batch_size 6)
if(CMAKE_BUILD_TYPE STREQUAL Debug OR CMAKE_CXX_COMPILER_ID MATCHES Clang)
  set(batch_size 1)
endif()
set(ISOSCOPE_BATCH_SIZE ${batch_size} CACHE STRING "Compile so many sources of a library as one")

# Some 500 static programs of tests with AddressSanitizer fill a disk, and take 3.5 s each to link.
set(is_shared OFF)
if(ISOSCOPE_SANITIZE AND NOT ISOSCOPE_BUILD_FUZZERS)
  set(is_shared ON)
endif()
option(ISOSCOPE_SHARED_LIBRARIES "Link the product's libraries into programs when these start" ${is_shared})
set(ISOSCOPE_TESTS_DIR "${PROJECT_SOURCE_DIR}/tests")
set(ISOSCOPE_LIBRARY_KIND STATIC)  # of the product
if(ISOSCOPE_SHARED_LIBRARIES)
  set(ISOSCOPE_LIBRARY_KIND SHARED)
endif()

option(ISOSCOPE_PRECOMPILED_HEADERS "Compile what most tests include once" ON)

find_program(ISOSCOPE_CCACHE ccache)
if(ISOSCOPE_CCACHE AND NOT CMAKE_CXX_COMPILER_LAUNCHER)
  # The sloppiness that ccache asks for with precompiled headers.
  set(CMAKE_CXX_COMPILER_LAUNCHER env CCACHE_SLOPPINESS=pch_defines,time_macros "${ISOSCOPE_CCACHE}")
endif()

# A faster linker for some 500 programs of tests (docs/lab/compile_time.md). lld 14 is the fastest, but not for code of
# -O2 and above, where functions may be empty: the next one at the same address loses its unwind information, and an
# exception in it ends the program. What is shipped takes the compiler's own.
set(linker gold)
if(ISOSCOPE_SANITIZE)
  set(linker lld)
endif()
find_program(ISOSCOPE_TEST_LINKER ld.${linker})
add_library(isoscope_test_linker INTERFACE)
add_library(isoscope::test_linker ALIAS isoscope_test_linker)
if(ISOSCOPE_TEST_LINKER)
  target_link_options(isoscope_test_linker INTERFACE -fuse-ld=${linker})
endif()

add_library(isoscope_warnings INTERFACE)
add_library(isoscope::warnings ALIAS isoscope_warnings)
target_compile_options(isoscope_warnings INTERFACE
  -Wall -Wextra -Wpedantic -Wshadow -Wconversion -Wsign-conversion -Wold-style-cast
  -Wnon-virtual-dtor -Woverloaded-virtual -Wdouble-promotion -Wformat=2 -Wimplicit-fallthrough
  -Wundef
  # GCC 12 warns of overlaps in std::string's own operator+ (GCC bug 105651).
  $<$<CXX_COMPILER_ID:GNU>:-Wno-restrict>
  $<$<CXX_COMPILER_ID:GNU>:-Wduplicated-cond -Wduplicated-branches -Wlogical-op>
  $<$<CXX_COMPILER_ID:Clang>:-Wthread-safety>)

# Reproducible floating point: two compilers and two blocks must compute the same vertex
# (docs/numerics.md), so contraction into fused multiply-add is off everywhere.
add_library(isoscope_fp_strict INTERFACE)
add_library(isoscope::fp_strict ALIAS isoscope_fp_strict)
target_compile_options(isoscope_fp_strict INTERFACE -ffp-contract=off -fno-fast-math)

add_library(isoscope_sanitizers INTERFACE)
add_library(isoscope::sanitizers ALIAS isoscope_sanitizers)
if(ISOSCOPE_SANITIZE)
  target_compile_options(isoscope_sanitizers INTERFACE
    -fsanitize=${ISOSCOPE_SANITIZE} -fno-sanitize-recover=all -fno-omit-frame-pointer
    # Reports need only line numbers; -O2 -g takes twice as long to compile.
    -O1 -g1)
  target_link_options(isoscope_sanitizers INTERFACE -fsanitize=${ISOSCOPE_SANITIZE})
  # The kernels are one source for all instruction sets. Some of the sets reveal all that sanitizers can find, and
  # compile in a fraction of the time.
  target_compile_definitions(isoscope_sanitizers INTERFACE
    "HWY_DISABLED_TARGETS=(HWY_SSSE3|HWY_SSE4|HWY_AVX3)")
elseif(CMAKE_SYSTEM_PROCESSOR MATCHES "^(aarch64|arm64)$")
  # Vectors of SVE have no size at compile time, so they can't be members, as kernels need. NEON is used instead.
  target_compile_definitions(isoscope_sanitizers INTERFACE
    "HWY_DISABLED_TARGETS=(HWY_SVE|HWY_SVE2|HWY_SVE_256|HWY_SVE2_128)")
endif()

if(ISOSCOPE_SANITIZE MATCHES thread AND CMAKE_CXX_COMPILER_ID STREQUAL GNU)
  # With -fsanitize=thread, GCC 12 regards the content of an empty std::optional as uninitialised.
  target_compile_options(isoscope_sanitizers INTERFACE -Wno-maybe-uninitialized)
endif()

# Sanitizer options that the tests' own files omit as well.
add_library(isoscope_test_sanitizers INTERFACE)
add_library(isoscope::test_sanitizers ALIAS isoscope_test_sanitizers)
target_link_libraries(isoscope_test_sanitizers INTERFACE isoscope::sanitizers)
if(ISOSCOPE_SANITIZE)
  # About two thirds of the time to compile; the product, which does the work, is optimised.
  target_compile_options(isoscope_test_sanitizers INTERFACE -O0)
endif()
if(ISOSCOPE_SANITIZE MATCHES undefined)
  # AddressSanitizer finds nearly all errors of these checks: null, freed and foreign objects trap or are reported when
  # they are used. Without these and the one below, six files of all kinds took 0.79 of the time to compile.
  target_compile_options(isoscope_sanitizers INTERFACE -fno-sanitize=null,object-size,vptr)
  # The product reads the bytes of files, where alignment errors occur.
  target_compile_options(isoscope_test_sanitizers INTERFACE -fno-sanitize=alignment)
endif()
