// Enums of core and of the protos, as one table that both directions read.

#ifndef ISOSCOPE_WIRE_ENUM_TABLE_H_
#define ISOSCOPE_WIRE_ENUM_TABLE_H_

#include <cstddef>
#include <utility>

#include "absl/status/status.h"
#include "absl/status/statusor.h"
#include "absl/strings/str_cat.h"
#include "absl/strings/string_view.h"

namespace isoscope::wire {

// A member of core and the member of the protos. If several members of the protos mean one of core,
// the first row gives the conversion to the proto.
template <typename Core, typename Wire>
using EnumRow = std::pair<Core, Wire>;

// INVALID_ARGUMENT "PATH is NUMBER: ALLOWED" for a number that has no row.
template <typename Core, typename Wire, std::size_t kCount>
absl::StatusOr<Core> EnumFromProto(const EnumRow<Core, Wire> (&rows)[kCount], Wire wire,
                                   absl::string_view path, absl::string_view allowed) {
  for (const auto& [core, row_wire] : rows) {
    if (row_wire == wire) {
      return core;
    }
  }
  return absl::InvalidArgumentError(
      absl::StrCat(path, " is ", static_cast<int>(wire), ": ", allowed));
}

// The first member of the protos, 0, for a value that has no row.
template <typename Core, typename Wire, std::size_t kCount>
Wire EnumToProto(const EnumRow<Core, Wire> (&rows)[kCount], Core core) {
  for (const auto& [row_core, wire] : rows) {
    if (row_core == core) {
      return wire;
    }
  }
  return Wire{};
}

}  // namespace isoscope::wire

#endif  // ISOSCOPE_WIRE_ENUM_TABLE_H_
