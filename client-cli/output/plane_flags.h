// The flags that choose what `render` writes: the picture's format, and planes beside it.

#ifndef ISOSCOPE_CLIENT_CLI_OUTPUT_PLANE_FLAGS_H_
#define ISOSCOPE_CLIENT_CLI_OUTPUT_PLANE_FLAGS_H_

#include <cstddef>
#include <cstdint>
#include <optional>
#include <string>

#include "absl/status/status.h"

#include "core/cli/flag_set.h"
#include "isoscope/v1/isosurface_service.pb.h"

namespace isoscope::cli {

struct PlaneFlags {
  std::optional<std::string> depth = std::nullopt;
  std::optional<std::string> surface_index = std::nullopt;
  std::optional<std::string> position = std::nullopt;
  std::optional<std::string> normal = std::nullopt;
  std::optional<std::int64_t> jpeg_quality = std::nullopt;

  // Bytes of a pixel in all planes asked for.
  [[nodiscard]] std::size_t bytes_per_pixel() const;
  // Whether any plane is asked for.
  [[nodiscard]] bool any_plane() const { return depth || surface_index || position || normal; }
};

// `flags` must outlive the parsing.
void AddPlaneFlags(FlagSet* set, PlaneFlags* flags);

// Whether the suffix of the picture's name is that of a JPEG: .jpg or .jpeg, in letters of any
// case.
bool IsJpegName(const std::string& path);

// UsageError if the flags do not fit each other or the picture's name; `output` is not set if no
// picture is asked for.
absl::Status CheckUsage(const PlaneFlags& flags, const std::optional<std::string>& output);

// OK if all planes can be written.
absl::Status CheckWritable(const PlaneFlags& flags);

// The options of a request that give what the flags ask for. Empty for a PNG alone.
isoscope::v1::OutputOptions MakeOutputOptions(const PlaneFlags& flags,
                                              const std::optional<std::string>& output);

// Writes the planes of a response, as NumPy arrays of shape height, width and, for vectors, 3.
absl::Status WritePlanes(const PlaneFlags& flags,
                         const isoscope::v1::RenderIsosurfaceResponse& response);

}  // namespace isoscope::cli

#endif  // ISOSCOPE_CLIENT_CLI_OUTPUT_PLANE_FLAGS_H_
