// A series that lies in memory, for the tests of the series partitioner.

#ifndef ISOSCOPE_TESTS_UNIT_CORE_PARTITION_SERIES_FIXTURE_H_
#define ISOSCOPE_TESTS_UNIT_CORE_PARTITION_SERIES_FIXTURE_H_

#include <cstddef>
#include <cstdint>
#include <functional>
#include <memory>
#include <string>
#include <utility>
#include <vector>

#include "absl/status/status.h"
#include "absl/status/statusor.h"
#include "absl/strings/str_cat.h"

#include "core/base/coding.h"
#include "core/base/random.h"
#include "core/source/volume_series.h"
#include "tests/support/memory_source.h"

namespace isoscope::partition {

// Noise that depends on all three numbers. `geometry`, `type` and `open` may be changed by a test.
class MemorySeries final : public source::VolumeSeries {
 public:
  MemorySeries(std::vector<source::SourceField> fields, std::vector<double> times)
      : MemorySeries(InfoOf(std::move(fields), std::move(times))) {}
  explicit MemorySeries(source::SeriesInfo info) : VolumeSeries(std::move(info)) {
    geometry.sample_dims = {13, 11, 9};
    geometry.spacing = {0.5, 1, 2};
  }

  static source::SeriesInfo InfoOf(std::vector<source::SourceField> fields,
                                   std::vector<double> times) {
    return {.name = "/data/flow.pvd",
            .fields = std::move(fields),
            .times = std::move(times),
            .time_unit = "s",
            .length_unit = "m"};
  }

  absl::StatusOr<std::unique_ptr<source::VolumeSource>> Open(int field, int component,
                                                             int step) override {
    ++open_count;
    if (before_open) {
      if (absl::Status status = before_open(field, component, step); !status.ok()) {
        return status;
      }
    }
    const std::vector<double>& times = info().times;
    const double time = times.empty() ? 0 : times[static_cast<std::size_t>(step)];
    const volume::GridGeometry grid = geometry_of ? geometry_of(field, component, step) : geometry;
    const volume::ScalarType type =
        type_of ? type_of(field, component, step) : volume::ScalarType::kFloat32;
    return testing::MakeMemorySource(grid, type, SamplesOf(grid, type, field, component, time),
                                     info().name);
  }

  absl::StatusOr<std::string> IdentityOfStep(int step) override {
    if (identity_error) {
      if (absl::Status status = identity_error(step); !status.ok()) {
        return status;
      }
    }
    return identity_of ? identity_of(step) : identity;
  }

  // Multiples of 1/8 as float32, whose bytes are those of other types, too.
  static std::string SamplesOf(const volume::GridGeometry& grid, volume::ScalarType type, int field,
                               int component, double time) {
    const std::size_t size =
        static_cast<std::size_t>(math::Volume(grid.sample_dims)) * volume::SizeOf(type);
    const auto seed = static_cast<std::uint64_t>(field * 10 + component + 1000 * time);
    std::string bytes;
    for (std::uint64_t i = 0; bytes.size() < size; ++i) {
      base::AppendLittleEndian(static_cast<float>(base::RandomBits(seed, i) % 1000) / 8, &bytes);
    }
    bytes.resize(size);
    return bytes;
  }

  std::string identity = "a request, and the stamps of its files\n";
  std::function<std::string(int)> identity_of;
  std::function<absl::Status(int)> identity_error;
  volume::GridGeometry geometry;
  std::function<volume::GridGeometry(int, int, int)> geometry_of;
  std::function<volume::ScalarType(int, int, int)> type_of;
  std::function<absl::Status(int, int, int)> before_open;
  int open_count = 0;
};

// Pressure, and velocity with three components.
inline std::vector<source::SourceField> FlowFields() {
  return {{.name = "p", .long_name = "pressure", .unit = "Pa", .components = {""}},
          {.name = "u", .long_name = "", .unit = "m/s", .components = {"x", "y", "z"}}};
}

}  // namespace isoscope::partition

#endif  // ISOSCOPE_TESTS_UNIT_CORE_PARTITION_SERIES_FIXTURE_H_
