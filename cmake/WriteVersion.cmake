# Writes the version of scripts/version.sh as a C++ source, if it is another one than the source has. Run by cmake -P at
# each build:
#
#   cmake -DOUTPUT=program_version.cc -DVERSION= -P WriteVersion.cmake
#
# VERSION is the version if it is not empty.
if(VERSION)
  set(ENV{ISOSCOPE_VERSION} "${VERSION}")
endif()
execute_process(COMMAND bash "${CMAKE_CURRENT_LIST_DIR}/../scripts/version.sh"
  OUTPUT_VARIABLE version OUTPUT_STRIP_TRAILING_WHITESPACE COMMAND_ERROR_IS_FATAL ANY)
file(CONFIGURE OUTPUT "${OUTPUT}" @ONLY CONTENT [[
// Written by cmake/WriteVersion.cmake.

#include "core/base/version.h"

namespace isoscope::base {

absl::string_view Version() { return "@version@"; }

}  // namespace isoscope::base
]])
