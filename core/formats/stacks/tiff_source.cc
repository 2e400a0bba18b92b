// A volume is the planes of one channel and step (tiff_stack.h). A plane is decoded when its rows
// are read; in a stack that ImageJ wrote raw behind one directory, it is read from the file
// directly.

#include "core/formats/stacks/tiff_source.h"

#include <bit>
#include <cstddef>
#include <cstdint>
#include <utility>

#include "absl/strings/str_cat.h"
#include "absl/strings/str_format.h"

#include "core/base/check.h"
#include "core/base/status_macros.h"
#include "core/formats/stacks/tiff_file.h"
#include "core/formats/stacks/tiff_stack.h"
#include "core/io/file.h"
#include "core/source/adapt/slice_source.h"
#include "core/source/adapt/wide_source.h"
#include "core/source/bytes/byte_order.h"
#include "core/source/grid/sample_distance.h"
#include "core/source/grid/stack_layout.h"

namespace isoscope::source {
namespace {

// The planes of one channel and step.
class TiffReader final : public SliceReader {
 public:
  TiffReader(std::shared_ptr<const TiffStack> stack, int channel, int step)
      : stack_(std::move(stack)), channel_(channel), step_(step) {}

  absl::Status ReadSlice(std::int64_t z, char* out) override {
    const StackPlane& plane = stack_->layout.PlaneOf(step_, channel_, z);
    const std::string& path = stack_->files[static_cast<std::size_t>(plane.file)];
    if (stack_->raw_offset.has_value()) {
      return ReadRaw(plane.index, path, out);
    }
    const std::int64_t planes = stack_->format.planes;
    ISOSCOPE_RETURN_IF_ERROR(Seek(plane.file, plane.index / planes, path));
    ISOSCOPE_ASSIGN_OR_RETURN(const PageFormat format,
                              FormatOfPage(tiff_.get(), path, stack_->colours));
    const PageFormat& expected = stack_->format;
    if (!(format == expected)) {
      return absl::InvalidArgumentError(absl::StrFormat(
          "%s: slice %d has %d x %d samples of %s, the first %d x %d of %s: expected slices of one "
          "size and type",
          path, z, format.width, format.height, format.type_name(), expected.width, expected.height,
          expected.type_name()));
    }
    return ReadTiffPlane(tiff_.get(), format, static_cast<std::uint16_t>(plane.index % planes),
                         path, out);
  }

 private:
  absl::Status ReadRaw(std::int64_t index, const std::string& path, char* out) {
    if (raw_ == nullptr) {
      ISOSCOPE_ASSIGN_OR_RETURN(raw_, io::OpenRandomAccessFile(path));
    }
    const std::int64_t bytes = stack_->format.plane_bytes();
    ISOSCOPE_RETURN_IF_ERROR(
        raw_->ReadAt(*stack_->raw_offset + index * bytes, static_cast<std::size_t>(bytes), out));
    if (stack_->is_big_endian != (std::endian::native == std::endian::big)) {
      const std::size_t size = volume::SizeOf(stack_->format.type);
      SwapBytes(size, static_cast<std::size_t>(bytes) / size, out);
    }
    return absl::OkStatus();
  }

  // Makes the page the current one of tiff_. The pages of the scanned file are found at once, those
  // of others are a linked list: forwards is cheap.
  absl::Status Seek(std::int32_t file, std::int64_t page, const std::string& path) {
    const bool is_scanned = file == stack_->scanned_file;
    if (tiff_ == nullptr || file != file_ || (!is_scanned && page < page_)) {
      tiff_ = nullptr;
      ISOSCOPE_ASSIGN_OR_RETURN(tiff_, OpenTiff(path));
      file_ = file;
      page_ = 0;
    }
    const std::vector<std::uint64_t>& offsets = stack_->pages.offsets;
    bool is_found = true;
    if (is_scanned && page < static_cast<std::int64_t>(offsets.size())) {
      is_found = page == page_ ||
                 TIFFSetSubDirectory(tiff_.get(), offsets[static_cast<std::size_t>(page)]) != 0;
      page_ = page;
    }
    while (is_found && page_ < page) {
      is_found = TIFFReadDirectory(tiff_.get()) != 0;
      ++page_;
    }
    if (!is_found) {
      tiff_ = nullptr;
      const absl::Status damage = TiffDamage(path);
      return absl::Status(damage.code(),
                          absl::StrFormat("%s: page %d: %s", path, page + 1, damage.message()));
    }
    return absl::OkStatus();
  }

  const std::shared_ptr<const TiffStack> stack_;
  const int channel_;
  const int step_;
  TiffFile tiff_;
  std::int32_t file_ = -1;  // of tiff_
  std::int64_t page_ = 0;   // the current one of tiff_
  std::unique_ptr<io::RandomAccessFile> raw_;
};

class TiffSeries final : public VolumeSeries {
 public:
  TiffSeries(std::shared_ptr<const TiffStack> stack, const std::string& field)
      : VolumeSeries(InfoOf(*stack, field)), stack_(std::move(stack)) {}

  absl::StatusOr<std::unique_ptr<VolumeSource>> Open(int field, int component, int step) override {
    ISOSCOPE_CHECK(component == 0);
    volume::GridGeometry geometry;
    geometry.sample_dims = {std::int64_t{stack_->format.width}, std::int64_t{stack_->format.height},
                            stack_->layout.slices};
    geometry.spacing = stack_->layout.spacing;
    geometry.origin = stack_->layout.origin;
    TurnPages(stack_->format.orientation, &geometry);
    const std::string name = info().fields.size() > 1
                                 ? absl::StrCat(stack_->name, ":", info().field(field).name)
                                 : stack_->name;
    const absl::Status valid = volume::Validate(geometry);
    if (!valid.ok()) {
      const StackLayout& layout = stack_->layout;
      return absl::Status(
          valid.code(),
          absl::StrCat(
              name, ": ", valid.message(),
              layout.slices == 1 && layout.planes.size() > 1
                  ? absl::StrFormat("; the file has %d channels and %d steps of one slice:"
                                    " if they are slices, %s",
                                    layout.channels, layout.steps, PagesAdvice(stack_->name))
                  : ""));
    }
    std::unique_ptr<VolumeSource> source =
        MakeSliceSource({.name = name, .geometry = geometry, .type = stack_->format.type},
                        std::make_unique<TiffReader>(stack_, field, step));
    if (stack_->format.wide.has_value()) {
      return MakeWideSource(std::move(source), *stack_->format.wide);
    }
    return source;
  }

 private:
  static SeriesInfo InfoOf(const TiffStack& stack, const std::string& field) {
    const StackLayout& layout = stack.layout;
    SeriesInfo info{.name = stack.name,
                    .times = layout.times,
                    .time_unit = layout.time_unit,
                    .length_unit = layout.length_unit};
    for (std::string& name : NamesOfChannels(layout, field)) {
      info.fields.push_back({.name = std::move(name)});
    }
    for (std::int64_t i = 0; layout.times.empty() && layout.steps > 1 && i < layout.steps; ++i) {
      info.times.push_back(static_cast<double>(i));
    }
    return info;
  }

  const std::shared_ptr<const TiffStack> stack_;
};

}  // namespace

absl::StatusOr<std::unique_ptr<VolumeSeries>> OpenTiffSeries(const std::vector<std::string>& files,
                                                             const std::string& name,
                                                             const std::string& field,
                                                             const std::string& axes,
                                                             const GridRules& rules) {
  ISOSCOPE_ASSIGN_OR_RETURN(TiffStack stack, FindTiffStack(files, name, axes));
  if (!stack.layout.distances.empty() && stack.layout.slices > 1 && !rules.has_spacing) {
    return NoSampleDistance(name, stack.layout.distances);
  }
  return std::make_unique<TiffSeries>(std::make_shared<const TiffStack>(std::move(stack)), field);
}

absl::StatusOr<std::vector<std::string>> FilesOfTiff(const std::string& file) {
  std::vector<std::string> files{file};
  auto stack = FindTiffStack({file}, file, "");
  if (!stack.ok()) {
    stack = FindTiffStack({file}, file, "Z");  // without what its head says, as with --axes
  }
  if (!stack.ok()) {
    return files;  // opening it says why
  }
  for (std::string& other : stack->files) {
    if (other != file) {
      files.push_back(std::move(other));
    }
  }
  if (!stack->companion.empty()) {
    files.push_back(std::move(stack->companion));
  }
  return files;
}

}  // namespace isoscope::source
