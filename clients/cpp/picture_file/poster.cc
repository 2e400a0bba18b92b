#include "clients/cpp/picture_file/poster.h"

#include <algorithm>
#include <cstddef>
#include <memory>
#include <vector>

#include "absl/status/status.h"
#include "absl/strings/str_cat.h"

#include "core/base/monotonic_time.h"
#include "core/base/status_macros.h"
#include "core/cli/format.h"
#include "core/io/atomic_file.h"

namespace isoscope::client {
namespace {

constexpr std::int64_t kRegionPixels =
    std::int64_t{view::kCommonViewport.width_px} * view::kCommonViewport.height_px;

int DivideUp(int value, int divisor) { return (value + divisor - 1) / divisor; }

std::string DescribeProgress(std::int64_t done, std::int64_t total, absl::Duration elapsed) {
  std::string text = absl::StrCat("rendering  region ", done, " of ", total);
  if (done > 0) {
    absl::StrAppend(&text, ", ",
                    cli::FormatElapsed(
                        elapsed * (static_cast<double>(total - done) / static_cast<double>(done))),
                    " left");
  }
  return text;
}

}  // namespace

bool NeedsRegions(const view::Viewport& viewport) {
  return std::max(viewport.width_px, viewport.height_px) > view::kMaxViewportPx ||
         std::int64_t{viewport.width_px} * viewport.height_px > kMaxSinglePixels;
}

view::Viewport RegionSizeOf(const view::Viewport& viewport, int max_side_px,
                            std::int64_t max_strip_bytes) {
  const int stripe_rows = image::PngRowWriter::RowsPerStripe(viewport.width_px);
  const std::int64_t row_bytes = std::int64_t{viewport.width_px} * 4;  // RGBA
  const auto most_rows = static_cast<int>(std::min<std::int64_t>(
      {view::kCommonViewport.height_px, max_strip_bytes / row_bytes, viewport.height_px}));
  // Whole stripes of the PNG, so that the bytes do not depend on the strips.
  const int rows = std::max(most_rows / stripe_rows * stripe_rows, stripe_rows);
  const auto columns = static_cast<int>(kRegionPixels / std::min(rows, viewport.height_px));
  return {std::min({columns, viewport.width_px, max_side_px}), rows};
}

absl::StatusOr<std::int64_t> WritePoster(
    const view::Viewport& viewport, const view::Viewport& region_size, bool is_opaque,
    const std::string& path,
    absl::FunctionRef<absl::StatusOr<image::RgbaImage>(const view::Region& region)> render,
    absl::FunctionRef<void(absl::string_view)> progress) {
  const base::MonotonicTime start = base::MonotonicNow();
  const std::int64_t region_count =
      std::int64_t{DivideUp(viewport.width_px, region_size.width_px)} *
      DivideUp(viewport.height_px, region_size.height_px);
  std::int64_t done_count = 0;
  const auto width = static_cast<std::size_t>(viewport.width_px);
  image::PngRowWriter writer(viewport.width_px, viewport.height_px, is_opaque);
  ISOSCOPE_ASSIGN_OR_RETURN(const std::unique_ptr<io::AtomicFile> file,
                            io::AtomicFile::Create(path));
  ISOSCOPE_RETURN_IF_ERROR(file->Append(writer.Begin()));
  std::vector<image::Rgba8> strip;
  for (int y = 0; y < viewport.height_px; y += region_size.height_px) {
    const int rows = std::min(region_size.height_px, viewport.height_px - y);
    strip.resize(width * static_cast<std::size_t>(rows));
    for (int x = 0; x < viewport.width_px; x += region_size.width_px) {
      progress(DescribeProgress(done_count++, region_count, base::MonotonicNow() - start));
      const view::Region region{x, y, std::min(region_size.width_px, viewport.width_px - x), rows};
      ISOSCOPE_ASSIGN_OR_RETURN(const image::RgbaImage image, render(region));
      if (image.width != region.width_px || image.height != rows) {
        return absl::DataLossError(
            absl::StrCat("the server sent a picture of ", image.width, " x ", image.height,
                         " pixels for a region of ", region.width_px, " x ", rows,
                         ": it may be older than this program, and not know regions"));
      }
      for (int row = 0; row < rows; ++row) {
        const auto from = image.pixels.begin() + std::ptrdiff_t{row} * region.width_px;
        std::copy(from, from + region.width_px,
                  strip.begin() + static_cast<std::ptrdiff_t>(width) * row + x);
      }
    }
    ISOSCOPE_RETURN_IF_ERROR(file->Append(writer.Append(strip)));
  }
  ISOSCOPE_RETURN_IF_ERROR(file->Append(writer.End()));
  ISOSCOPE_RETURN_IF_ERROR(file->Commit());
  return file->size_bytes();
}

}  // namespace isoscope::client
