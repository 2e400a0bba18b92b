// A picture that is too large for one frame: regions of its viewport are written into a PNG as soon
// as a strip of them is complete. Memory holds one strip.

#ifndef ISOSCOPE_CLIENTS_CPP_PICTURE_FILE_POSTER_H_
#define ISOSCOPE_CLIENTS_CPP_PICTURE_FILE_POSTER_H_

#include <cstdint>
#include <string>

#include "absl/functional/function_ref.h"
#include "absl/status/statusor.h"
#include "absl/strings/string_view.h"

#include "core/image/png_codec.h"
#include "core/view/camera.h"

namespace isoscope::client {

// A picture of more pixels is drawn region by region.
inline constexpr std::int64_t kMaxSinglePixels = std::int64_t{4096} * 4096;
// A strip of regions takes at most this many bytes, or the bytes of one stripe of a PNG.
inline constexpr std::int64_t kMaxStripBytes = std::int64_t{64} * 1024 * 1024;

bool NeedsRegions(const view::Viewport& viewport);

// Returns the size of a region; those at the right and at the bottom may be smaller. It has about
// as many pixels as view::kCommonViewport, and at most `max_side_px` >=
// view::kCommonViewport.height_px a side. `max_strip_bytes` is in [1, kMaxStripBytes].
view::Viewport RegionSizeOf(const view::Viewport& viewport, int max_side_px = view::kMaxViewportPx,
                            std::int64_t max_strip_bytes = kMaxStripBytes);

// Calls `render` for the regions, row by row from the top left, and writes the picture to `path`,
// which appears complete or not at all. The pixels are those of image::EncodePng for the whole, and
// so are the bytes if the picture is opaque. `progress` is called for each region.
//
// region_size: RegionSizeOf(viewport, ...)
// is_opaque:   true if all alphas are 1
//
// Returns the size of the file in bytes. Errors of `render`, and as io::CreateWritableFile.
absl::StatusOr<std::int64_t> WritePoster(
    const view::Viewport& viewport, const view::Viewport& region_size, bool is_opaque,
    const std::string& path,
    absl::FunctionRef<absl::StatusOr<image::RgbaImage>(const view::Region& region)> render,
    absl::FunctionRef<void(absl::string_view)> progress);

}  // namespace isoscope::client

#endif  // ISOSCOPE_CLIENTS_CPP_PICTURE_FILE_POSTER_H_
