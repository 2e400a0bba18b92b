#include "core/formats/stacks/image_slices.h"

#include <algorithm>
#include <array>
#include <cstdint>
#include <utility>

#include "absl/strings/match.h"
#include "absl/strings/str_cat.h"
#include "absl/strings/str_format.h"

#include "core/base/status_macros.h"
#include "core/formats/stacks/png_slice.h"
#include "core/io/file.h"
#include "core/source/adapt/slice_source.h"
#include "core/source/bytes/jpeg_slice.h"
#include "core/source/bytes/named_files.h"
#include "core/source/bytes/slice_image.h"
#include "core/source/bytes/stack_names.h"
#include "core/source/child/silent_libraries.h"
#include "core/source/child/walled_source.h"

namespace isoscope::source {
namespace {

// Those of the first kind in a folder make the volume.
enum class SliceKind { kLossless, kJpeg2000, kJpeg };

struct SliceFormat {
  const char* ending;
  SliceKind kind;
  absl::StatusOr<SliceImage> (*read)(const std::string& path, SlicePart part);
};

constexpr std::array<SliceFormat, 7> kFormats{{{".png", SliceKind::kLossless, ReadPngSlice},
                                               {".jp2", SliceKind::kJpeg2000, ReadJpeg2000Slice},
                                               {".j2k", SliceKind::kJpeg2000, ReadJpeg2000Slice},
                                               {".j2c", SliceKind::kJpeg2000, ReadJpeg2000Slice},
                                               {".jpc", SliceKind::kJpeg2000, ReadJpeg2000Slice},
                                               {".jpg", SliceKind::kJpeg, ReadJpegSlice},
                                               {".jpeg", SliceKind::kJpeg, ReadJpegSlice}}};

const SliceFormat* FormatOf(const std::string& path) {
  const auto found = std::find_if(kFormats.begin(), kFormats.end(), [&](const SliceFormat& format) {
    return absl::EndsWithIgnoreCase(path, format.ending);
  });
  return found == kFormats.end() ? nullptr : found;
}

absl::StatusOr<SliceImage> ReadSliceImage(const std::string& path, SlicePart part) {
  ISOSCOPE_RETURN_IF_ERROR(io::CheckIsRegularFile(path));  // libraries would wait for a writer
  return FormatOf(path)->read(path, part);
}

class ImageSliceReader final : public SliceReader {
 public:
  // `first`: the header of the first file.
  ImageSliceReader(std::vector<std::string> files, SliceImage first)
      : files_(std::move(files)), first_(std::move(first)) {}

  absl::Status ReadSlice(std::int64_t z, char* out) override {
    const std::string& path = files_[static_cast<std::size_t>(z)];
    ISOSCOPE_ASSIGN_OR_RETURN(const SliceImage slice, ReadSliceImage(path, SlicePart::kAll));
    if (slice.width != first_.width || slice.height != first_.height || slice.type != first_.type) {
      return absl::InvalidArgumentError(absl::StrFormat(
          "%s: %d x %d samples of %s, but %s has %d x %d of %s: expected slices of one size and "
          "type",
          path, slice.width, slice.height, volume::NameOf(slice.type), files_[0], first_.width,
          first_.height, volume::NameOf(first_.type)));
    }
    std::copy(slice.samples.begin(), slice.samples.end(), out);
    return absl::OkStatus();
  }
  [[nodiscard]] std::int64_t memory_bytes() const override {  // JPEG takes less
    return FormatOf(files_[0])->kind == SliceKind::kLossless
               ? 0
               : kJpeg2000BytesPerSample * first_.width * first_.height;
  }

 private:
  const std::vector<std::string> files_;
  const SliceImage first_;
};

constexpr char kAsNeighbours[] = "neighbours";

// Runs in the child. `part`: kAsNeighbours, or "".
absl::StatusOr<std::unique_ptr<VolumeSource>> OpenSlices(const std::string& path,
                                                         const std::string& part) {
  std::vector<std::string> files = ImageSlicesNamed(path);
  if (files.empty()) {
    return absl::InvalidArgumentError(absl::StrCat(path, ": no slices (", kImageSliceEndings, ")"));
  }
  if (files.size() == 1) {
    return absl::InvalidArgumentError(
        absl::StrCat(path, ": one slice", files[0] == path ? "" : absl::StrCat(" (", files[0], ")"),
                     "; a volume has two or more: give their folder, or a pattern such as "
                     "'slices/*.png'"));
  }
  if (part != kAsNeighbours) {
    ISOSCOPE_RETURN_IF_ERROR(CheckStackNames(path, files));
  }
  ISOSCOPE_ASSIGN_OR_RETURN(SliceImage first, ReadSliceImage(files.front(), SlicePart::kHeader));
  volume::GridGeometry geometry;
  geometry.sample_dims = {first.width, first.height, static_cast<std::int64_t>(files.size())};
  const absl::Status valid = volume::Validate(geometry);
  if (!valid.ok()) {
    return absl::Status(valid.code(), absl::StrCat(path, ": ", valid.message()));
  }
  const volume::ScalarType type = first.type;
  return MakeSliceSource({.name = path, .geometry = geometry, .type = type},
                         std::make_unique<ImageSliceReader>(std::move(files), std::move(first)));
}

}  // namespace

bool IsImageSliceName(const std::string& path) { return FormatOf(path) != nullptr; }

std::vector<std::string> ImageSlicesNamed(const std::string& path) {
  std::vector<std::string> files = FilesNamed(path, IsImageSliceName);
  SliceKind kind = SliceKind::kJpeg;
  for (const std::string& file : files) {
    kind = std::min(kind, FormatOf(file)->kind);
  }
  std::erase_if(files, [kind](const std::string& file) { return FormatOf(file)->kind != kind; });
  return files;
}

absl::StatusOr<std::unique_ptr<VolumeSource>> OpenImageSlices(const std::string& path,
                                                              bool as_neighbours) {
  SilenceImageLibraries();  // first, so that its lock is free when the process forks
  return OpenWalled({.name = "the decoder of images", .open = OpenSlices}, path,
                    as_neighbours ? kAsNeighbours : "");
}

}  // namespace isoscope::source
