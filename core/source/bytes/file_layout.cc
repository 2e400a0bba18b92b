// Volume v = (field * components + component) * steps + step of a layout is one of these:
//
//   planes with offsets (`slices`)   OpenSlices: the planes v * dims.z and those after it
//   tuples                           MakeFileSource, component v of each tuple
//   volumes one behind the other     MakeFileSource, volume v
//
// If one volume or plane is rescaled, all are, so that the volumes of a series have one type.
// StoredSliceReader reads a plane into the tail of the output and rescales it from front to back:
// the result of a sample never overwrites a stored one that is still to come.
//
// MakeLayoutSeries checks the limits of fields, components and steps, and that times ascend.

#include "core/source/bytes/file_layout.h"

#include <algorithm>
#include <cmath>
#include <cstddef>
#include <functional>
#include <utility>

#include "absl/strings/str_cat.h"
#include "absl/strings/str_format.h"

#include "core/base/check.h"
#include "core/base/status_macros.h"
#include "core/io/file.h"
#include "core/source/adapt/rescale.h"
#include "core/source/adapt/slice_source.h"
#include "core/source/bytes/byte_order.h"
#include "core/source/bytes/file_source.h"
#include "core/source/series_parts.h"

namespace isoscope::source {
namespace {

constexpr std::int64_t kMaxFileSteps = 100'000;
constexpr std::size_t kMaxFileFields = 1000;
constexpr std::int64_t kMaxFileComponents = 4096;

// Returns the times of the steps; none for a single step.
std::vector<double> TimesOf(const FileLayout& layout) {
  std::vector<double> times = layout.times;
  const bool has_interval = times.empty() && layout.steps > 1;
  for (std::int64_t i = 0; has_interval && i < layout.steps; ++i) {
    times.push_back(layout.first_time + static_cast<double>(i) * layout.interval);
  }
  return times;
}

class LayoutSeries final : public VolumeSeries {
 public:
  LayoutSeries(const std::string& path, const std::string& field, FileLayout layout)
      : VolumeSeries(InfoOf(path, field, layout)), layout_(std::move(layout)) {}

  absl::StatusOr<std::unique_ptr<VolumeSource>> Open(int field, int component, int step) override {
    return OpenLayoutVolume(
        layout_, (field * layout_.components + component) * layout_.steps + step, info().name);
  }

 private:
  static SeriesInfo InfoOf(const std::string& path, const std::string& field,
                           const FileLayout& layout) {
    SeriesInfo info{.name = path,
                    .times = TimesOf(layout),
                    .time_unit = layout.time_unit,
                    .length_unit = layout.length_unit};
    for (const std::string& name :
         layout.fields.empty() ? std::vector<std::string>{field} : layout.fields) {
      info.fields.push_back({.name = name,
                             .unit = layout.sample_unit,
                             .components = ComponentNames(layout.components)});
    }
    return info;
  }

  const FileLayout layout_;
};

// The planes of one volume.
class StoredSliceReader final : public SliceReader {
 public:
  StoredSliceReader(std::unique_ptr<io::RandomAccessFile> file, const SampleLocation& location,
                    std::vector<StoredSlice> slices, std::size_t sample_count, bool is_rescaled)
      : file_(std::move(file)),
        type_(location.stored_type),
        is_big_endian_(location.is_big_endian),
        slices_(std::move(slices)),
        sample_count_(sample_count),
        is_rescaled_(is_rescaled) {}

  absl::Status ReadSlice(std::int64_t z, char* out) override {
    const StoredSlice& slice = slices_[static_cast<std::size_t>(z)];
    const std::size_t stored_size = volume::SizeOf(type_);
    const std::size_t size = volume::SizeOf(is_rescaled_ ? RescaledType(type_) : type_);
    char* const stored = out + sample_count_ * (size - stored_size);
    ISOSCOPE_RETURN_IF_ERROR(file_->ReadAt(slice.offset, sample_count_ * stored_size, stored));
    if (is_big_endian_) {
      SwapBytes(stored_size, sample_count_, stored);
    }
    if (is_rescaled_) {
      Rescale(type_, sample_count_, slice.rescaling.slope, slice.rescaling.intercept, stored, out);
    }
    return absl::OkStatus();
  }

 private:
  const std::unique_ptr<io::RandomAccessFile> file_;
  const volume::ScalarType type_;
  const bool is_big_endian_;
  const std::vector<StoredSlice> slices_;
  const std::size_t sample_count_;  // of a slice
  const bool is_rescaled_;
};

absl::StatusOr<std::unique_ptr<VolumeSource>> OpenSlices(const FileLayout& layout,
                                                         std::int64_t volume,
                                                         const std::string& path) {
  const math::Index3& dims = layout.geometry.sample_dims;
  const volume::ScalarType type = layout.location.stored_type;
  const bool is_rescaled =
      std::any_of(layout.slices.begin(), layout.slices.end(),
                  [](const StoredSlice& s) { return s.rescaling != Rescaling(); });
  const auto first = layout.slices.begin() + volume * dims.z;
  std::vector<StoredSlice> slices(first, first + dims.z);
  ISOSCOPE_ASSIGN_OR_RETURN(std::unique_ptr<io::RandomAccessFile> file,
                            io::OpenRandomAccessFile(layout.location.files.front()));
  const std::int64_t bytes = dims.x * dims.y * static_cast<std::int64_t>(volume::SizeOf(type));
  for (const StoredSlice& slice : slices) {
    if (slice.offset < 0 || bytes > file->size_bytes() ||
        slice.offset > file->size_bytes() - bytes) {
      return absl::InvalidArgumentError(
          absl::StrFormat("%s: a slice of %d x %d samples of %s at byte %d needs %d bytes, the "
                          "file has %d: it is cut; copy it again",
                          file->path(), dims.x, dims.y, volume::NameOf(type), slice.offset,
                          slice.offset + bytes, file->size_bytes()));
    }
  }
  return MakeSliceSource(
      {.name = path,
       .geometry = layout.geometry,
       .type = is_rescaled ? RescaledType(type) : type,
       .patient_frame = layout.patient_frame},
      std::make_unique<StoredSliceReader>(std::move(file), layout.location, std::move(slices),
                                          static_cast<std::size_t>(dims.x * dims.y), is_rescaled));
}

}  // namespace

absl::StatusOr<std::unique_ptr<VolumeSeries>> MakeLayoutSeries(const std::string& path,
                                                               const std::string& field,
                                                               FileLayout layout,
                                                               const GridRules& rules) {
  if (layout.shear.has_value() && !rules.ignores_shear) {
    return ShearError(*layout.shear, path);
  }
  ISOSCOPE_RETURN_IF_ERROR(layout.faults.Check(rules, path));
  if (layout.steps > kMaxFileSteps) {
    return absl::InvalidArgumentError(absl::StrFormat("%s: %d steps of time; expected at most %d",
                                                      path, layout.steps, kMaxFileSteps));
  }
  if (layout.fields.size() > kMaxFileFields) {
    return absl::InvalidArgumentError(absl::StrFormat("%s: %d fields; expected at most %d", path,
                                                      layout.fields.size(), kMaxFileFields));
  }
  if (layout.components > kMaxFileComponents) {
    return absl::InvalidArgumentError(absl::StrFormat("%s: %d components; expected at most %d",
                                                      path, layout.components, kMaxFileComponents));
  }
  const std::vector<double> times = TimesOf(layout);
  if (!std::all_of(times.begin(), times.end(), [](double time) { return std::isfinite(time); }) ||
      std::adjacent_find(times.begin(), times.end(), std::greater_equal<>()) != times.end()) {
    return absl::InvalidArgumentError(absl::StrFormat(
        "%s: %d steps from the time %g on, %g apart; expected finite times, each above the one "
        "before",
        path, layout.steps, times.front(), layout.interval));
  }
  return std::make_unique<LayoutSeries>(path, field, std::move(layout));
}

absl::StatusOr<std::unique_ptr<VolumeSource>> OpenLayoutVolume(const FileLayout& layout,
                                                               std::int64_t volume,
                                                               const std::string& path) {
  ISOSCOPE_CHECK(volume >= 0 && volume < layout.volume_count());
  if (!layout.slices.empty()) {
    return OpenSlices(layout, volume, path);
  }
  SampleLocation location = layout.location;
  (location.components > 1 ? location.component : location.volume) = volume;
  if (!layout.rescalings.empty()) {
    const Rescaling& rescaling = layout.rescalings[static_cast<std::size_t>(volume)];
    location.slope = rescaling.slope;
    location.intercept = rescaling.intercept;
    location.is_always_rescaled =
        std::any_of(layout.rescalings.begin(), layout.rescalings.end(),
                    [](const Rescaling& each) { return each != Rescaling(); });
  }
  ISOSCOPE_ASSIGN_OR_RETURN(std::unique_ptr<VolumeSource> source,
                            MakeFileSource(layout.geometry, location, path, layout.patient_frame));
  if (layout.wide.has_value()) {
    return MakeWideSource(std::move(source), *layout.wide);
  }
  return source;
}

}  // namespace isoscope::source
