// Opening a stack has four steps:
//
// 1. Walk through the pages of the first file, for their offsets, and read its head (tiff_file.h).
// 2. Find out which plane holds which slice, channel and step (stack_layout.h): from OME-XML, from
//    ImageJ's description, from LSM's tag, from --axes, else every page is a slice.
// 3. Check that each plane is on a page that exists. Pages of other files are checked when they are
//    read.
// 4. A volume is then the planes of one channel and step. A plane is decoded when its rows are
// read.
//
// ImageJ writes large stacks with the directory of the first page only; the samples of all follow
// each other raw. Their planes are read from the file directly.

#include "core/source/tiff_source.h"

#include <algorithm>
#include <bit>
#include <cstddef>
#include <cstdint>
#include <optional>
#include <utility>

#include "absl/strings/ascii.h"
#include "absl/strings/match.h"
#include "absl/strings/str_cat.h"
#include "absl/strings/str_format.h"

#include "core/base/check.h"
#include "core/base/status_macros.h"
#include "core/base/units.h"
#include "core/io/file.h"
#include "core/source/byte_order.h"
#include "core/source/imagej_stack.h"
#include "core/source/lsm_stack.h"
#include "core/source/ome_stack.h"
#include "core/source/slice_source.h"
#include "core/source/stack_layout.h"
#include "core/source/tiff_file.h"

namespace isoscope::source {
namespace {

constexpr std::int64_t kMaxCompanionBytes = 64 * base::kMiB;

// All that the volumes of a stack share.
struct TiffStack {
  std::string name;
  std::vector<std::string> files;  // by StackPlane::file
  TiffPages pages{};               // of files[scanned_file]
  std::int32_t scanned_file = 0;   // below 0: none
  PageFormat format{};
  TiffColours colours = TiffColours::kRefused;
  // Set if the planes of the only file lie raw behind each other: the first byte of the first.
  std::optional<std::int64_t> raw_offset{};
  bool is_big_endian = false;
  StackLayout layout{};
};

std::string BaseNameOf(const std::string& path) { return path.substr(path.rfind('/') + 1); }

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
          path, z, format.width, format.height, volume::NameOf(format.type), expected.width,
          expected.height, volume::NameOf(expected.type)));
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
      : stack_(std::move(stack)), times_(stack_->layout.times) {
    for (std::string& name : NamesOfChannels(stack_->layout, field)) {
      fields_.push_back({.name = std::move(name)});
    }
    for (std::int64_t i = 0; times_.empty() && stack_->layout.steps > 1 && i < stack_->layout.steps;
         ++i) {
      numbers_.push_back(static_cast<double>(i));
    }
  }

  [[nodiscard]] const std::string& name() const override { return stack_->name; }
  [[nodiscard]] const std::vector<SourceField>& fields() const override { return fields_; }
  [[nodiscard]] const std::vector<double>& times() const override {
    return times_.empty() ? numbers_ : times_;
  }
  [[nodiscard]] const std::string& time_unit() const override { return stack_->layout.time_unit; }
  [[nodiscard]] const std::string& length_unit() const override {
    return stack_->layout.length_unit;
  }

  absl::StatusOr<std::unique_ptr<VolumeSource>> Open(int field, int component, int step) override {
    ISOSCOPE_CHECK(component == 0);
    volume::GridGeometry geometry;
    geometry.sample_dims = {std::int64_t{stack_->format.width}, std::int64_t{stack_->format.height},
                            stack_->layout.slices};
    geometry.spacing = stack_->layout.spacing;
    const std::string name =
        fields_.size() > 1
            ? absl::StrCat(stack_->name, ":", fields_[static_cast<std::size_t>(field)].name)
            : stack_->name;
    const absl::Status valid = volume::Validate(geometry);
    if (!valid.ok()) {
      const StackLayout& layout = stack_->layout;
      return absl::Status(
          valid.code(),
          absl::StrCat(name, ": ", valid.message(),
                       layout.slices == 1 && layout.planes.size() > 1
                           ? absl::StrFormat("; the file has %d channels and %d steps of one slice:"
                                             " if they are slices, say so with --axes Z",
                                             layout.channels, layout.steps)
                           : ""));
    }
    return MakeSliceSource(geometry, stack_->format.type, name,
                           std::make_unique<TiffReader>(stack_, field, step));
  }

 private:
  const std::shared_ptr<const TiffStack> stack_;
  const std::vector<double> times_;
  std::vector<double> numbers_;  // in place of times
  std::vector<SourceField> fields_;
};

absl::Status NamedStatus(const std::string& name, const absl::Status& status) {
  return status.ok() ? status
                     : absl::Status(status.code(), absl::StrCat(name, ": ", status.message()));
}

// The layout that OME-XML describes, in the file itself or in its companion.
absl::StatusOr<StackLayout> LayoutOfOme(const TiffStack& stack, const std::string& path) {
  const std::string own_name = BaseNameOf(path);
  const auto planes = static_cast<std::int64_t>(stack.pages.offsets.size());
  ISOSCOPE_ASSIGN_OR_RETURN(OmeStack ome,
                            ParseOmeXml(stack.pages.description, path, own_name, planes));
  if (!ome.companion.empty()) {
    const std::string companion = path.substr(0, path.rfind('/') + 1) + ome.companion;
    ISOSCOPE_ASSIGN_OR_RETURN(const std::string xml,
                              io::ReadWholeFile(companion, kMaxCompanionBytes));
    ISOSCOPE_ASSIGN_OR_RETURN(ome, ParseOmeXml(xml, companion, own_name, planes));
    if (!ome.companion.empty()) {
      return absl::InvalidArgumentError(
          absl::StrCat(companion, ": OME-XML that names another file, ", ome.companion,
                       ", in its place; expected the tags of an image"));
    }
  }
  if (ome.size_x != stack.format.width || ome.size_y != stack.format.height) {
    return absl::InvalidArgumentError(
        absl::StrFormat("%s: OME-XML says %d x %d samples, but its first page has %d x %d", path,
                        ome.size_x, ome.size_y, stack.format.width, stack.format.height));
  }
  return std::move(ome.layout);
}

// The layout as the head of the first file says it; not set if it says nothing.
absl::StatusOr<std::optional<StackLayout>> LayoutOfHead(const TiffStack& stack,
                                                        const std::string& path) {
  const TiffPages& pages = stack.pages;
  if (IsOmeXml(pages.description)) {
    ISOSCOPE_ASSIGN_OR_RETURN(StackLayout layout, LayoutOfOme(stack, path));
    return layout;
  }
  if (IsImageJDescription(pages.description)) {
    const bool is_of_print =
        pages.resolution_unit != RESUNIT_NONE && !absl::StrContains(pages.description, "\nunit=");
    auto layout =
        ParseImageJ(pages.description,
                    is_of_print ? PixelDensity()
                                : PixelDensity{.x = pages.x_resolution, .y = pages.y_resolution});
    ISOSCOPE_RETURN_IF_ERROR(NamedStatus(path, layout.status()));
    return *std::move(layout);
  }
  if (!pages.lsm.empty()) {
    auto layout = ParseLsm(pages.lsm);
    ISOSCOPE_RETURN_IF_ERROR(NamedStatus(path, layout.status()));
    return *std::move(layout);
  }
  return std::nullopt;
}

// Opens the first file and reads its head.
absl::StatusOr<TiffStack> ScanStack(const std::string& path, const std::string& name) {
  TiffStack stack{.name = name, .files = {path}};
  ISOSCOPE_ASSIGN_OR_RETURN(const TiffFile first, OpenTiff(path));
  const TiffFile& tiff = first;
  ISOSCOPE_ASSIGN_OR_RETURN(stack.pages, ScanTiffPages(tiff.get(), path));
  const bool shows_colours =
      IsImageJDescription(stack.pages.description) || !stack.pages.lsm.empty();
  stack.colours = shows_colours ? TiffColours::kForDisplay : TiffColours::kRefused;
  if (TIFFSetSubDirectory(tiff.get(), stack.pages.offsets.front()) == 0) {
    return TiffDamage(path);
  }
  ISOSCOPE_ASSIGN_OR_RETURN(stack.format, FormatOfPage(tiff.get(), path, stack.colours));
  stack.is_big_endian = TIFFIsBigEndian(tiff.get()) != 0;
  return stack;
}

// All pages of the files are planes in a row.
absl::Status CheckSliceFiles(const std::vector<std::string>& files, const TiffStack& stack) {
  if (stack.pages.offsets.size() > 1) {
    return absl::InvalidArgumentError(
        absl::StrFormat("%s: %d pages in one of %d files; expected one file of many pages, or many "
                        "files of one page",
                        files[0], stack.pages.offsets.size(), files.size()));
  }
  const PageFormat& format = stack.format;
  for (const std::string& path : files) {
    ISOSCOPE_ASSIGN_OR_RETURN(const TiffFile tiff, OpenTiff(path));
    ISOSCOPE_ASSIGN_OR_RETURN(const PageFormat other,
                              FormatOfPage(tiff.get(), path, stack.colours));
    if (!(other == format)) {
      return absl::InvalidArgumentError(absl::StrFormat(
          "%s: %d x %d samples of %s, but %s has %d x %d of %s: expected slices of one size and "
          "type",
          path, other.width, other.height, volume::NameOf(other.type), files[0], format.width,
          format.height, volume::NameOf(format.type)));
    }
  }
  return absl::OkStatus();
}

// The planes that a file of ImageJ holds behind its only directory; else those of its pages.
absl::StatusOr<std::int64_t> CountPlanes(std::int64_t described, TiffStack* stack) {
  const auto planes = static_cast<std::int64_t>(stack->pages.offsets.size()) * stack->format.planes;
  if (described <= planes || stack->pages.offsets.size() > 1 || stack->pages.raw_offset == 0 ||
      stack->format.planes != 1) {
    return planes;
  }
  ISOSCOPE_ASSIGN_OR_RETURN(const auto file, io::OpenRandomAccessFile(stack->files.front()));
  stack->raw_offset = static_cast<std::int64_t>(stack->pages.raw_offset);
  const std::int64_t behind = file->size_bytes() - *stack->raw_offset;
  return std::min(described, behind / std::max<std::int64_t>(stack->format.plane_bytes(), 1));
}

// Checks that the planes are there, and gives the files of the layout their paths.
absl::Status CheckPlanes(const std::string& path, std::int64_t planes, TiffStack* stack) {
  StackLayout& layout = stack->layout;
  const std::string own_name = BaseNameOf(path);
  if (!layout.files.empty()) {
    const std::string folder = path.substr(0, path.rfind('/') + 1);
    stack->files.clear();
    stack->scanned_file = -1;
    for (const std::string& name : layout.files) {
      if (name == own_name) {
        stack->scanned_file = static_cast<std::int32_t>(stack->files.size());
      }
      stack->files.push_back(name == own_name ? path : folder + name);
      if (!io::PathExists(stack->files.back())) {
        return absl::NotFoundError(absl::StrFormat(
            "%s: no such file; %s names it: the files of a set must lie in one folder",
            stack->files.back(), path));
      }
    }
  }
  const auto unnamed = std::count_if(layout.planes.begin(), layout.planes.end(),
                                     [](const StackPlane& plane) { return plane.file < 0; });
  if (unnamed > 0) {
    return absl::InvalidArgumentError(absl::StrFormat(
        "%s: OME-XML: no TiffData names %d of the %d planes of %d slices, %d channels and %d steps",
        path, unnamed, layout.planes.size(), layout.slices, layout.channels, layout.steps));
  }
  for (const StackPlane& plane : layout.planes) {
    if (plane.file == stack->scanned_file && plane.index >= planes) {
      return absl::DataLossError(absl::StrFormat(
          "%s: %d planes, but its head says %d: %d channels, %d slices, %d frames: the file is cut,"
          " or say what its pages are, as with --axes Z",
          path, planes, layout.planes.size(), layout.channels, layout.slices, layout.steps));
    }
  }
  return absl::OkStatus();
}

// Lays the planes out; `described`: as the head of the first file says.
absl::Status LayOut(const std::vector<std::string>& files, const std::string& axes,
                    TiffStack* stack) {
  const std::string& path = files.front();
  std::optional<StackLayout> described;
  if (files.size() == 1) {
    ISOSCOPE_ASSIGN_OR_RETURN(described, LayoutOfHead(*stack, path));
  } else {
    ISOSCOPE_RETURN_IF_ERROR(CheckSliceFiles(files, *stack));
  }
  const bool is_known = described.has_value();
  if (is_known) {
    stack->layout = *std::move(described);
  }
  std::int64_t planes = static_cast<std::int64_t>(files.size());
  if (files.size() == 1) {
    ISOSCOPE_ASSIGN_OR_RETURN(
        planes, CountPlanes(IsImageJDescription(stack->pages.description)
                                ? static_cast<std::int64_t>(stack->layout.planes.size())
                                : 0,
                            stack));
  }
  if (!axes.empty()) {
    ISOSCOPE_RETURN_IF_ERROR(
        NamedStatus(stack->name, ApplyPageAxes(axes, planes, is_known, &stack->layout)));
  } else if (!is_known) {
    stack->layout.slices = planes;
    LayPlanes("Z", &stack->layout);
  }
  if (files.size() > 1) {
    for (StackPlane& plane : stack->layout.planes) {
      plane = {.file = static_cast<std::int32_t>(plane.index), .index = 0};
    }
    stack->files = files;
    return absl::OkStatus();
  }
  return CheckPlanes(path, planes, stack);
}

}  // namespace

bool NaturalLess(const std::string& a, const std::string& b) {
  const auto is_digit = [](char c) { return absl::ascii_isdigit(static_cast<unsigned char>(c)); };
  std::size_t i = 0;
  std::size_t j = 0;
  while (i < a.size() && j < b.size()) {
    if (is_digit(a[i]) && is_digit(b[j])) {
      const auto end_of = [&](const std::string& text, std::size_t at) {
        while (at < text.size() && is_digit(text[at])) {
          ++at;
        }
        return at;
      };
      const std::size_t a_end = end_of(a, i);
      const std::size_t b_end = end_of(b, j);
      const std::size_t a_first = std::min(a.find_first_not_of('0', i), a_end);
      const std::size_t b_first = std::min(b.find_first_not_of('0', j), b_end);
      if (a_end - a_first != b_end - b_first) {
        return a_end - a_first < b_end - b_first;
      }
      const int order = a.compare(a_first, a_end - a_first, b, b_first, b_end - b_first);
      if (order != 0) {
        return order < 0;
      }
      i = a_end;
      j = b_end;
    } else if (a[i] != b[j]) {
      return a[i] < b[j];
    } else {
      ++i;
      ++j;
    }
  }
  if ((i < a.size()) != (j < b.size())) {
    return j < b.size();
  }
  return a < b;  // equal but for zeros in front
}

absl::StatusOr<std::unique_ptr<VolumeSeries>> OpenTiffSeries(const std::vector<std::string>& files,
                                                             const std::string& name,
                                                             const std::string& field,
                                                             const std::string& axes) {
  if (files.empty()) {
    return absl::InvalidArgumentError(absl::StrCat(name, ": no TIFF files"));
  }
  ISOSCOPE_ASSIGN_OR_RETURN(TiffStack stack, ScanStack(files.front(), name));
  ISOSCOPE_RETURN_IF_ERROR(LayOut(files, axes, &stack));
  return std::make_unique<TiffSeries>(std::make_shared<const TiffStack>(std::move(stack)), field);
}

absl::StatusOr<std::vector<std::string>> FilesOfTiff(const std::string& file) {
  std::vector<std::string> files{file};
  auto stack = ScanStack(file, file);
  if (!stack.ok() || !LayOut({file}, "", &*stack).ok()) {
    return files;  // opening it says why
  }
  for (std::string& other : stack->files) {
    if (other != file) {
      files.push_back(std::move(other));
    }
  }
  return files;
}

}  // namespace isoscope::source
