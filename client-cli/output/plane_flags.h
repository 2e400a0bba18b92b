// The flags for the output of `render`: the picture's format, and planes.

#ifndef ISOSCOPE_CLIENT_CLI_OUTPUT_PLANE_FLAGS_H_
#define ISOSCOPE_CLIENT_CLI_OUTPUT_PLANE_FLAGS_H_

#include <cstdint>
#include <optional>
#include <string>

#include "absl/status/status.h"

#include "clients/cpp/connection/render_frame.h"
#include "core/cli/flag_set.h"
#include "isoscope/v1/isosurface_service.pb.h"

namespace isoscope::cli {

struct PlaneFlags {
  client::PlaneFiles files = {};
  std::optional<std::int64_t> jpeg_quality = std::nullopt;
};

// `flags` must outlive the parsing.
void AddPlaneFlags(FlagSet* set, PlaneFlags* flags);

// Returns true if the suffix of the picture's name is that of a JPEG: .jpg or .jpeg, in any case.
bool IsJpegName(const std::string& path);

// UsageError if the flags do not fit each other or the picture's name; `output` is not set if no
// picture is asked for.
absl::Status CheckUsage(const PlaneFlags& flags, const std::optional<std::string>& output);

// OK if all planes can be written.
absl::Status CheckWritable(const PlaneFlags& flags);

// Returns the options of a request for the output that the flags ask for. Empty for a PNG alone.
isoscope::v1::OutputOptions MakeOutputOptions(const PlaneFlags& flags,
                                              const std::optional<std::string>& output);

}  // namespace isoscope::cli

#endif  // ISOSCOPE_CLIENT_CLI_OUTPUT_PLANE_FLAGS_H_
