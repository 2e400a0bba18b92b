// MINC 1 is a netCDF file with a variable "image", whose dimensions are its axes, slowest first:
//
//   image(zspace, yspace, xspace)   signtype = "unsigned"   valid_range = 0, 4095
//   image-max(zspace)               the real value of the sample 4095, slice by slice
//   image-min(zspace)               the real value of the sample 0
//   xspace                          start = -90   step = 1   direction_cosines = 1, 0, 0
//
// A sample lies at the sum of (start + index * step) * direction_cosines over its axes, in RAS. Its
// real value is
//
//   image-min + (sample - valid_range[0]) * (image-max - image-min) / valid_width
//   valid_width = valid_range[1] - valid_range[0]
//
// also outside valid_range, as libminc computes it for MINC 2. Floats are real values already.
// Source: https://en.wikibooks.org/wiki/MINC/Reference/MINC1-programmers-guide.

#include "core/formats/netcdf/minc1_series.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <cstddef>
#include <cstdint>
#include <limits>
#include <optional>
#include <type_traits>
#include <utility>
#include <vector>

#include "absl/strings/match.h"
#include "absl/strings/str_cat.h"
#include "absl/strings/str_format.h"
#include "absl/strings/str_join.h"

#include "core/base/status_macros.h"
#include "core/formats/netcdf/minc_axis.h"
#include "core/formats/netcdf/netcdf_file.h"
#include "core/formats/netcdf/netcdf_source.h"
#include "core/source/adapt/rescale.h"
#include "core/source/child/walled_series.h"
#include "core/source/child/walled_source.h"
#include "core/source/grid/affine_grid.h"

namespace isoscope::source {
namespace {

using volume::ScalarType;

constexpr std::int64_t kMaxMinc1Steps = 100'000;

// A limit of the real values: one number, or one for each step, slice, or both.
struct Minc1Limits {
  std::vector<double> values;
  std::size_t step_stride = 0;
  std::size_t slice_stride = 0;

  [[nodiscard]] double At(std::int64_t step, std::int64_t slice) const {
    return values[static_cast<std::size_t>(step) * step_stride +
                  static_cast<std::size_t>(slice) * slice_stride];
  }
};

struct Minc1File {
  std::unique_ptr<NetcdfFile> file;
  NetcdfVariable image{};
  volume::GridGeometry geometry{};
  SeriesInfo info{};       // but its name and field
  bool is_scaled = false;  // else the members below are not set
  std::array<double, 2> valid{};
  Minc1Limits least{};
  Minc1Limits most{};

  [[nodiscard]] std::int64_t step_count() const {
    return image.roles.time.has_value() ? image.axes[*image.roles.time].size : 1;
  }
  [[nodiscard]] Rescaling ScaleOf(std::int64_t step, std::int64_t slice) const {
    const double from = least.At(step, slice);
    const double width = valid[1] - valid[0];
    const double slope = width > 0 ? (most.At(step, slice) - from) / width : 0;
    return {.slope = slope, .intercept = from - valid[0] * slope};
  }
};

absl::Status Minc1Error(const Minc1File& minc, const std::string& what) {
  return absl::InvalidArgumentError(absl::StrCat(minc.file->path(), ": MINC 1: ", what));
}

absl::Status SetMinc1Roles(Minc1File* minc) {
  CfRoles& roles = minc->image.roles;
  std::size_t found = 0;
  std::string letters;
  std::vector<std::string> names;
  for (std::size_t i = 0; i < minc->image.axes.size(); ++i) {
    const std::string& name = minc->image.axes[i].name;
    names.push_back(name);
    if (name == "time") {
      roles.time = i;
    } else if (found < 3 && (name == "xspace" || name == "yspace" || name == "zspace")) {
      roles.space[found] = i;
      letters.push_back(static_cast<char>(name[0] - 'x' + 'X'));
      roles.letters[found++] = letters.back();
    }
  }
  std::sort(letters.begin(), letters.end());
  if (letters != "XYZ" || names.size() != (roles.time.has_value() ? 4 : 3)) {
    return Minc1Error(
        *minc, absl::StrFormat("its image has the axes \"%s\"; expected xspace, yspace, zspace "
                               "and perhaps time: extract one volume (mincreshape)",
                               absl::StrJoin(names, ", ")));
  }
  const std::int64_t steps = minc->step_count();
  if (steps < 1 || steps > kMaxMinc1Steps) {
    return Minc1Error(*minc,
                      absl::StrFormat("%d steps of time; expected 1 to %d", steps, kMaxMinc1Steps));
  }
  return absl::OkStatus();
}

// Bytes are unsigned unless the file says otherwise, other integers are signed.
absl::Status SetMinc1Type(Minc1File* minc) {
  const std::string sign = minc->file->Text(minc->image, {"signtype"});
  const bool is_unsigned = absl::StartsWith(sign, "unsigned");
  ScalarType& type = minc->image.stored;
  if (minc->image.wide.has_value()) {
    return Minc1Error(*minc, "samples of 64 bits; expected at most 32");
  }
  if (type == ScalarType::kInt8 || type == ScalarType::kUint8) {
    type = absl::StartsWith(sign, "signed") ? ScalarType::kInt8 : ScalarType::kUint8;
  } else if (type == ScalarType::kInt16 || type == ScalarType::kUint16) {
    type = is_unsigned ? ScalarType::kUint16 : ScalarType::kInt16;
  } else if (type == ScalarType::kInt32 || type == ScalarType::kUint32) {
    type = is_unsigned ? ScalarType::kUint32 : ScalarType::kInt32;
  }
  return absl::OkStatus();
}

// Puts the name of the file in front of an error.
absl::Status NamedMinc1(const Minc1File& minc, const absl::Status& status) {
  return status.ok() ? status : Minc1Error(minc, std::string(status.message()));
}

// Reads the variable of an axis.
absl::StatusOr<MincAxis> ReadMinc1Axis(const Minc1File& minc, std::size_t index) {
  MincAxis axis{.name = minc.image.axes[index].name};
  ISOSCOPE_ASSIGN_OR_RETURN(const std::optional<NetcdfVariable> variable,
                            minc.file->Find(axis.name));
  if (!variable.has_value()) {
    return axis;
  }
  const auto number = [&](const char* attribute, double* value) {
    const std::vector<double> numbers = minc.file->Numbers(*variable, attribute);
    if (!numbers.empty()) {
      *value = numbers[0];
    }
    return !numbers.empty();
  };
  number("start", &axis.start);
  axis.has_step = number("step", &axis.step);
  axis.spacing = minc.file->Text(*variable, {"spacing"});
  axis.cosines = minc.file->Numbers(*variable, "direction_cosines");
  axis.unit = minc.file->Text(*variable, {"units"});
  ISOSCOPE_RETURN_IF_ERROR(NamedMinc1(minc, CheckMincSpacing(axis)));
  return axis;
}

absl::Status SetMinc1Grid(Minc1File* minc) {
  const CfRoles& roles = minc->image.roles;
  AffineRows rows{};
  math::Index3 dims;
  std::array<MincAxis, 3> axes;
  std::vector<std::string> units;
  for (std::size_t i = 0; i < 3; ++i) {
    const std::size_t index = 2 - i;  // the last axis of space is index x
    ISOSCOPE_ASSIGN_OR_RETURN(const MincAxis axis, ReadMinc1Axis(*minc, roles.space[i]));
    ISOSCOPE_RETURN_IF_ERROR(NamedMinc1(*minc, CheckMincAxis(axis)));
    dims[static_cast<int>(index)] = minc->image.axes[roles.space[i]].size;
    axes.at(index) = axis;
    units.push_back(MincUnitOf(axis));
  }
  minc->info.length_unit = units[0];
  for (std::size_t index = 0; index < 3; ++index) {
    const auto factor = MincUnitFactor(units.at(2 - index), units[0]);
    ISOSCOPE_RETURN_IF_ERROR(NamedMinc1(*minc, factor.status()));
    const MincAxis& axis = axes.at(index);
    const math::Vec3d direction = MincDirectionOf(axis);
    for (std::size_t r = 0; r < 3; ++r) {
      const double cosine = direction[static_cast<int>(r)];
      rows.at(r).at(index) = cosine * axis.step * *factor;
      rows.at(r).at(3) += cosine * axis.start * *factor;
    }
  }
  ISOSCOPE_ASSIGN_OR_RETURN(minc->geometry,
                            GridFromAffine(dims, rows, PatientWorld::kRas, minc->file->path()));
  if (minc->step_count() > 1) {
    ISOSCOPE_ASSIGN_OR_RETURN(const MincAxis time, ReadMinc1Axis(*minc, *roles.time));
    const bool has_times =
        time.has_step && time.step > 0 && std::isfinite(time.step) && std::isfinite(time.start);
    for (std::int64_t i = 0; i < minc->step_count(); ++i) {
      const auto step = static_cast<double>(i);
      minc->info.times.push_back(has_times ? time.start + step * time.step : step);
    }
    minc->info.time_unit = has_times ? time.unit : "";
  }
  return absl::OkStatus();
}

absl::StatusOr<Minc1Limits> ReadMinc1Limits(const Minc1File& minc, const char* name,
                                            double fallback) {
  ISOSCOPE_ASSIGN_OR_RETURN(const std::optional<NetcdfVariable> variable, minc.file->Find(name));
  Minc1Limits limits;
  if (!variable.has_value()) {
    limits.values = {fallback};
    return limits;
  }
  std::size_t stride = 1;
  for (std::size_t i = variable->dimensions.size(); i-- > 0;) {
    const int dimension = variable->dimensions[i];
    const CfRoles& roles = minc.image.roles;
    const bool is_slice = dimension == minc.image.dimensions[roles.space[0]];
    const bool is_step = roles.time.has_value() && dimension == minc.image.dimensions[*roles.time];
    std::size_t& own = is_slice ? limits.slice_stride : limits.step_stride;
    if ((!is_slice && !is_step) || own != 0) {
      return Minc1Error(minc, absl::StrFormat("its %s varies along %s; expected along %s and time "
                                              "at most",
                                              name, variable->axes[i].name,
                                              minc.image.axes[roles.space[0]].name));
    }
    own = stride;
    stride *= static_cast<std::size_t>(variable->axes[i].size);
  }
  ISOSCOPE_ASSIGN_OR_RETURN(limits.values, minc.file->Values(*variable));
  ISOSCOPE_RETURN_IF_ERROR(NamedMinc1(minc, CheckMincNumbers(name, limits.values)));
  return limits;
}

// The samples that stand for image-min and image-max.
std::array<double, 2> Minc1ValidRange(const Minc1File& minc) {
  std::array<double, 2> valid{};
  volume::VisitScalarType(minc.image.stored, [&]<typename T>() {
    valid = {static_cast<double>(std::numeric_limits<T>::lowest()),
             static_cast<double>(std::numeric_limits<T>::max())};
    std::vector<double> range = minc.file->Numbers(minc.image, "valid_range");
    for (const std::size_t i : {std::size_t{0}, std::size_t{1}}) {
      const std::vector<double> one =
          minc.file->Numbers(minc.image, i == 0 ? "valid_min" : "valid_max");
      double& limit = valid.at(i);
      limit = range.size() == 2 ? range[i] : !one.empty() ? one[0] : limit;
      // netCDF stores it in its signed type.
      if (std::is_unsigned_v<T> && limit < 0) {
        limit += std::ldexp(1.0, std::numeric_limits<T>::digits);
      }
    }
  });
  if (valid[0] > valid[1]) {
    std::swap(valid[0], valid[1]);
  }
  return valid;
}

absl::Status SetMinc1Scales(Minc1File* minc) {
  const ScalarType type = minc->image.stored;
  if (type == ScalarType::kFloat32 || type == ScalarType::kFloat64) {
    return absl::OkStatus();
  }
  minc->valid = Minc1ValidRange(*minc);
  ISOSCOPE_RETURN_IF_ERROR(
      NamedMinc1(*minc, CheckMincNumbers("valid_range", {minc->valid[0], minc->valid[1]})));
  ISOSCOPE_ASSIGN_OR_RETURN(minc->least, ReadMinc1Limits(*minc, "image-min", 0));
  ISOSCOPE_ASSIGN_OR_RETURN(minc->most, ReadMinc1Limits(*minc, "image-max", 1));
  const std::int64_t steps =
      minc->least.step_stride + minc->most.step_stride > 0 ? minc->step_count() : 1;
  const std::int64_t slices =
      minc->least.slice_stride + minc->most.slice_stride > 0 ? minc->geometry.sample_dims.z : 1;
  constexpr std::int64_t kMaxScales = std::int64_t{1} << 24;
  if (slices > kMaxScales / steps) {
    return Minc1Error(*minc, absl::StrFormat("%d steps of %d slices, each with real values of its "
                                             "own; expected at most %d in all",
                                             steps, slices, kMaxScales));
  }
  for (std::int64_t step = 0; step < steps; ++step) {
    for (std::int64_t slice = 0; slice < slices; ++slice) {
      minc->is_scaled = minc->is_scaled || minc->ScaleOf(step, slice) != Rescaling();
    }
  }
  return absl::OkStatus();
}

absl::StatusOr<Minc1File> ReadMinc1(const std::string& path) {
  Minc1File minc;
  ISOSCOPE_ASSIGN_OR_RETURN(minc.file, NetcdfFile::Open(path));
  ISOSCOPE_ASSIGN_OR_RETURN(std::optional<NetcdfVariable> image, minc.file->Find("image"));
  if (!image.has_value()) {
    return Minc1Error(minc,
                      "no variable \"image\" of numbers: a netCDF file of another kind, which "
                      "opens with the ending .nc, or --format netcdf");
  }
  minc.image = *std::move(image);
  ISOSCOPE_RETURN_IF_ERROR(SetMinc1Roles(&minc));
  ISOSCOPE_RETURN_IF_ERROR(SetMinc1Type(&minc));
  ISOSCOPE_RETURN_IF_ERROR(SetMinc1Grid(&minc));
  ISOSCOPE_RETURN_IF_ERROR(SetMinc1Scales(&minc));
  return minc;
}

// The stored samples of a step as real values.
class Minc1Source final : public VolumeSource {
 public:
  // `scales`: by slice; none if samples are real values.
  Minc1Source(std::unique_ptr<VolumeSource> stored, std::vector<Rescaling> scales,
              const std::string& path)
      : VolumeSource(InfoOf(stored->info(), scales, path)),
        stored_(std::move(stored)),
        scales_(std::move(scales)) {}

  absl::Status ReadRows(std::int64_t begin_row, std::int64_t end_row, char* out) override {
    if (scales_.empty()) {
      return stored_->ReadRows(begin_row, end_row, out);
    }
    const ScalarType type = stored_->info().type;
    const math::Index3& dims = info().geometry.sample_dims;
    const std::int64_t stored_bytes = stored_->info().row_bytes();
    const std::int64_t bytes = info().row_bytes();
    char* stored = out + (end_row - begin_row) * (bytes - stored_bytes);
    ISOSCOPE_RETURN_IF_ERROR(stored_->ReadRows(begin_row, end_row, stored));
    while (begin_row < end_row) {
      const std::int64_t slice = begin_row / dims.y;
      const std::int64_t rows = std::min(end_row, (slice + 1) * dims.y) - begin_row;
      const Rescaling& scale = scales_[static_cast<std::size_t>(slice)];
      Rescale(type, static_cast<std::size_t>(rows * dims.x), scale.slope, scale.intercept, stored,
              out);
      begin_row += rows;
      stored += rows * stored_bytes;
      out += rows * bytes;
    }
    return absl::OkStatus();
  }

 private:
  static SourceInfo InfoOf(SourceInfo info, const std::vector<Rescaling>& scales,
                           const std::string& path) {
    info.name = path;
    info.type = scales.empty() ? info.type : RescaledType(info.type);
    info.patient_frame = volume::PatientFrame();
    return info;
  }

  const std::unique_ptr<VolumeSource> stored_;
  const std::vector<Rescaling> scales_;
};

// `part` is the name of the field.
absl::StatusOr<std::vector<std::string>> DescribeMinc1(const std::string& path,
                                                       const std::string& part) {
  ISOSCOPE_ASSIGN_OR_RETURN(const Minc1File minc, ReadMinc1(path));
  WalledFile described{.info = minc.info};
  described.Add({.name = part}, 0);
  return WalledTexts(described);
}

absl::StatusOr<std::unique_ptr<VolumeSource>> OpenMinc1Part(const std::string& path,
                                                            const std::string& part) {
  const std::int64_t step = ParseWalledPart(part)[1];
  ISOSCOPE_ASSIGN_OR_RETURN(Minc1File minc, ReadMinc1(path));
  if (step >= minc.step_count()) {
    return Minc1Error(minc, absl::StrFormat("no step %d: it has changed", step));
  }
  std::vector<Rescaling> scales;
  for (std::int64_t slice = 0; minc.is_scaled && slice < minc.geometry.sample_dims.z; ++slice) {
    scales.push_back(minc.ScaleOf(step, slice));
  }
  ISOSCOPE_ASSIGN_OR_RETURN(
      std::unique_ptr<VolumeSource> stored,
      OpenStoredNetcdf(std::move(minc.file), minc.image, minc.geometry, step));
  return std::make_unique<Minc1Source>(std::move(stored), std::move(scales), path);
}

constexpr WalledLibrary kMinc1 = {
    .name = "netCDF", .open = OpenMinc1Part, .find_files = nullptr, .describe = DescribeMinc1};

}  // namespace

bool IsMinc1(absl::string_view head) { return absl::StartsWith(head, "CDF"); }

absl::StatusOr<std::unique_ptr<VolumeSeries>> OpenMinc1Series(const std::string& path,
                                                              const std::string& field) {
  return OpenWalledSeries(kMinc1, path, field);
}

}  // namespace isoscope::source
