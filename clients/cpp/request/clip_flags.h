// The flags of a clip region, for frames and for meshes.

#ifndef ISOSCOPE_CLIENTS_CPP_REQUEST_CLIP_FLAGS_H_
#define ISOSCOPE_CLIENTS_CPP_REQUEST_CLIP_FLAGS_H_

#include <optional>
#include <string>
#include <vector>

#include "absl/status/status.h"

#include "clients/cpp/request/parse_value.h"
#include "core/cli/flag_set.h"
#include "core/math/box.h"
#include "isoscope/v1/isosurface_service.pb.h"

namespace isoscope::client {

struct ClipFlags {
  std::vector<PlaneValue> planes = {};
  std::optional<math::Box3d> box = std::nullopt;

  [[nodiscard]] bool empty() const { return planes.empty() && !box; }
};

// `flags` must outlive the parsing. verb: action on the part that is kept, for --help.
void AddClipFlags(cli::FlagSet* set, ClipFlags* flags, const std::string& verb = "show");

// UsageError if there are too many planes.
absl::Status CheckUsage(const ClipFlags& flags);

isoscope::v1::ClipRegion ToProto(const ClipFlags& flags);

}  // namespace isoscope::client

#endif  // ISOSCOPE_CLIENTS_CPP_REQUEST_CLIP_FLAGS_H_
