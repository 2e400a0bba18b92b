// Each even sample lies between two of the source, a share of the way from the lower one to the
// upper one. These shares are computed once for each axis. Example, slices at 0, 2, 3 and 6:
//
//   source   0       1   2           3      at 0, 2, 3, 6
//   even     0   1   2   3   4   5   6      at 0, 1, 2, ... (the smallest distance is 1)
//   lower    0   0   1   2   2   2   3
//   share    0  1/2  0   0  1/3 2/3  0
//
// A row of the result needs up to four rows of the source, from two planes. These are kept as they
// are read, so that each plane is read once where planes are asked for in ascending order.

#include "core/source/adapt/resampled_source.h"

#include <algorithm>
#include <cmath>
#include <cstddef>
#include <limits>
#include <string>
#include <type_traits>
#include <utility>

#include "absl/strings/str_cat.h"
#include "absl/strings/str_format.h"

#include "core/base/check.h"
#include "core/base/coding.h"
#include "core/base/status_macros.h"
#include "core/volume/scalar_type.h"

namespace isoscope::source {
namespace {

constexpr std::int64_t kMaxStepsForOne = 4;
// A sample so near to one of the source, in gaps, is that one.
constexpr double kSamePlace = 1e-6;

struct Between {
  std::int64_t lower = 0;  // sample of the source
  double share = 0;        // of the next sample; below 1, and 0 for the last one
};

volume::ScalarType ResampledType(volume::ScalarType type) {
  switch (type) {
    case volume::ScalarType::kUint32:
    case volume::ScalarType::kInt32:
    case volume::ScalarType::kFloat64:
      return volume::ScalarType::kFloat64;
    default:
      return volume::ScalarType::kFloat32;
  }
}

// Returns the place of each sample of the result. An even axis has each sample of the source.
std::vector<Between> PlacesOf(const std::vector<double>& distances, const EvenSamples& even) {
  std::vector<Between> places(static_cast<std::size_t>(even.count));
  std::size_t lower = 0;
  for (std::size_t i = 0; i < places.size(); ++i) {
    if (distances.empty()) {
      places[i].lower = static_cast<std::int64_t>(i);
      continue;
    }
    const bool is_last = i + 1 == places.size();
    const double at = is_last ? distances.back() : static_cast<double>(i) * even.step;
    while (lower + 1 < distances.size() && distances[lower + 1] <= at) {
      ++lower;
    }
    double share = lower + 1 < distances.size()
                       ? (at - distances[lower]) / (distances[lower + 1] - distances[lower])
                       : 0;
    std::size_t from = lower;
    if (share > 1 - kSamePlace) {
      ++from;
      share = 0;
    }
    places[i] = {static_cast<std::int64_t>(from), share < kSamePlace ? 0 : share};
  }
  return places;
}

// Exact where both are equal, infinities included.
double Mixed(double lower, double upper, double share) {
  return lower == upper ? lower : (1 - share) * lower + share * upper;
}

std::int64_t PlaneBytes(const SourceInfo& info) {
  return info.row_bytes() * info.geometry.sample_dims.y;
}

class ResampledSource final : public VolumeSource {
 public:
  ResampledSource(SourceInfo info, std::unique_ptr<VolumeSource> source,
                  std::array<std::vector<Between>, 3> places, std::optional<double> fill)
      : VolumeSource(std::move(info)),
        source_(std::move(source)),
        places_(std::move(places)),
        fill_(fill) {}

  absl::Status ReadRows(std::int64_t begin_row, std::int64_t end_row, char* out) override {
    const std::int64_t plane_rows = info().geometry.sample_dims.y;
    ISOSCOPE_CHECK(begin_row >= 0 && begin_row < end_row &&
                   end_row <= plane_rows * info().geometry.sample_dims.z);
    for (std::int64_t row = begin_row; row < end_row; ++row) {
      const Between& z = places_[2][static_cast<std::size_t>(row / plane_rows)];
      const Between& y = places_[1][static_cast<std::size_t>(row % plane_rows)];
      ISOSCOPE_RETURN_IF_ERROR(ReadPlane(z.lower));
      MixRow(z.lower, y, &row_);
      if (z.share > 0) {
        ISOSCOPE_RETURN_IF_ERROR(ReadPlane(z.lower + 1));
        MixRow(z.lower + 1, y, &next_row_);
        for (std::size_t x = 0; x < row_.size(); ++x) {
          row_[x] = Mixed(row_[x], next_row_[x], z.share);
        }
      }
      StoreRow(out);
      out += info().row_bytes();
    }
    return absl::OkStatus();
  }

  void HeedCancellation(const base::Cancellation* cancellation) override {
    source_->HeedCancellation(cancellation);
  }

 private:
  struct Plane {
    std::int64_t z = -1;
    std::vector<char> bytes{};
  };

  // Two planes that follow each other never share a place.
  Plane& PlaceOf(std::int64_t z) { return planes_[static_cast<std::size_t>(z % 2)]; }

  absl::Status ReadPlane(std::int64_t z) {
    Plane& plane = PlaceOf(z);
    if (plane.z == z) {
      return absl::OkStatus();
    }
    plane.z = -1;
    plane.bytes.resize(static_cast<std::size_t>(PlaneBytes(source_->info())));
    ISOSCOPE_RETURN_IF_ERROR(source_->ReadSlab(z, z + 1, plane.bytes.data()));
    plane.z = z;
    return absl::OkStatus();
  }

  void MixRow(std::int64_t z, const Between& y, std::vector<double>* row) {
    MixLine(z, y.lower, row);
    if (y.share > 0) {
      MixLine(z, y.lower + 1, &line_);
      for (std::size_t x = 0; x < row->size(); ++x) {
        (*row)[x] = Mixed((*row)[x], line_[x], y.share);
      }
    }
  }

  // A row of the source, at the even places of x.
  void MixLine(std::int64_t z, std::int64_t y, std::vector<double>* row) {
    row->resize(places_[0].size());
    volume::VisitScalarType(source_->info().type, [&]<typename In>() {
      const char* const line = PlaceOf(z).bytes.data() + y * source_->info().row_bytes();
      const auto value = [&](std::int64_t x) {
        return Filled(base::LoadLittleEndian<In>(line + x * static_cast<std::int64_t>(sizeof(In))));
      };
      for (std::size_t i = 0; i < places_[0].size(); ++i) {
        const Between& x = places_[0][i];
        const double lower = value(x.lower);
        (*row)[i] = x.share > 0 ? Mixed(lower, value(x.lower + 1), x.share) : lower;
      }
    });
  }

  // As float32 the fill value of the file may differ from the decimal number that was given.
  template <typename In>
  [[nodiscard]] double Filled(In value) const {
    if (fill_.has_value()) {
      const bool is_fill = std::is_same_v<In, float>
                               ? static_cast<float>(value) == static_cast<float>(*fill_)
                               : static_cast<double>(value) == *fill_;
      if (is_fill) {
        return std::numeric_limits<double>::quiet_NaN();
      }
    }
    return static_cast<double>(value);
  }

  void StoreRow(char* out) const {
    for (const double value : row_) {
      if (info().type == volume::ScalarType::kFloat32) {
        base::StoreLittleEndian(static_cast<float>(value), out);
      } else {
        base::StoreLittleEndian(value, out);
      }
      out += volume::SizeOf(info().type);
    }
  }

  const std::unique_ptr<VolumeSource> source_;
  const std::array<std::vector<Between>, 3> places_;  // by axis
  const std::optional<double> fill_;
  std::array<Plane, 2> planes_;
  std::vector<double> row_, next_row_, line_;
};

absl::Status CheckDistances(const std::vector<double>& distances, std::int64_t size, int axis,
                            const std::string& name) {
  if (static_cast<std::int64_t>(distances.size()) != size || size < 2 || distances.front() != 0) {
    return absl::InvalidArgumentError(
        absl::StrFormat("%s: %d places of samples on axis %c, which has %d samples: expected one "
                        "for each, the first 0",
                        name, distances.size(), "xyz"[axis], size));
  }
  for (std::size_t i = 1; i < distances.size(); ++i) {
    if (!(distances[i] > distances[i - 1]) || !std::isfinite(distances[i])) {
      return absl::InvalidArgumentError(
          absl::StrFormat("%s: sample %d of axis %c lies at %g, behind one at %g: expected places "
                          "that ascend, each once",
                          name, i, "xyz"[axis], distances[i], distances[i - 1]));
    }
  }
  return absl::OkStatus();
}

// "axis z was resampled: 5 samples, 2 to 4 apart, became 9, 2 apart".
std::string DescribeResampling(const std::vector<double>& distances, const EvenSamples& even,
                               int axis) {
  double smallest = distances[1];
  double largest = distances[1];
  for (std::size_t i = 1; i < distances.size(); ++i) {
    smallest = std::min(smallest, distances[i] - distances[i - 1]);
    largest = std::max(largest, distances[i] - distances[i - 1]);
  }
  return absl::StrFormat(
      "axis %c was resampled: %d samples, %.4g to %.4g apart, became %d, %.4g "
      "apart",
      "xyz"[axis], distances.size(), smallest, largest, even.count, even.step);
}

}  // namespace

EvenSamples EvenSamplesFor(const std::vector<double>& distances) {
  double smallest = distances.back();
  for (std::size_t i = 1; i < distances.size(); ++i) {
    smallest = std::min(smallest, distances[i] - distances[i - 1]);
  }
  const auto gaps = static_cast<double>(distances.size() - 1);
  // Distances that differ in their last digits only make no further step.
  const double steps = std::ceil(distances.back() / smallest - 1e-3);
  EvenSamples even;
  even.count = static_cast<std::int64_t>(std::min(steps, kMaxStepsForOne * gaps)) + 1;
  even.step = distances.back() / static_cast<double>(even.count - 1);
  return even;
}

absl::StatusOr<std::unique_ptr<VolumeSource>> ResampleSource(std::unique_ptr<VolumeSource> source,
                                                             AxisDistances distances,
                                                             std::optional<double> fill) {
  SourceInfo info = source->info();
  volume::GridGeometry& geometry = info.geometry;
  std::array<std::vector<Between>, 3> places;
  bool is_even = true;
  for (std::size_t i = 0; i < 3; ++i) {
    const auto axis = static_cast<int>(i);
    EvenSamples even{.count = geometry.sample_dims[axis]};
    if (!distances[i].empty()) {
      is_even = false;
      ISOSCOPE_RETURN_IF_ERROR(CheckDistances(distances[i], even.count, axis, info.name));
      even = EvenSamplesFor(distances[i]);
      absl::StrAppend(&info.note, info.note.empty() ? "" : "; ",
                      DescribeResampling(distances[i], even, axis));
      geometry.sample_dims[axis] = even.count;
      geometry.spacing[axis] = even.step;
    }
    places[i] = PlacesOf(distances[i], even);
  }
  if (is_even) {
    return source;
  }
  if (const absl::Status valid = volume::Validate(geometry); !valid.ok()) {
    return absl::Status(valid.code(),
                        absl::StrCat(info.name, ": after --resample: ", valid.message()));
  }
  info.type = ResampledType(info.type);
  info.is_resampled = true;
  info.memory_bytes += 2 * PlaneBytes(source->info());
  info.planes_at_once = 1;
  return std::make_unique<ResampledSource>(std::move(info), std::move(source), std::move(places),
                                           fill);
}

}  // namespace isoscope::source
