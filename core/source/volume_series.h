// A source with several fields or time steps on one grid.

#ifndef ISOSCOPE_CORE_SOURCE_VOLUME_SERIES_H_
#define ISOSCOPE_CORE_SOURCE_VOLUME_SERIES_H_

#include <cstddef>
#include <memory>
#include <optional>
#include <string>
#include <utility>
#include <vector>

#include "absl/status/status.h"
#include "absl/status/statusor.h"
#include "absl/strings/str_cat.h"

#include "core/source/volume_source.h"

namespace isoscope::source {

struct SourceField {
  std::string name;         // unique in the source; never empty
  std::string long_name{};  // may be empty
  std::string unit{};       // may be empty
  // Names of its components, without a magnitude: one "" for a scalar field; x, y, z for three that
  // the file does not name; else 0, 1, ...
  std::vector<std::string> components = {""};

  friend bool operator==(const SourceField&, const SourceField&) = default;
};

// All that a series says of its volumes. A series that is made of another copies the info of the
// inner series, and changes what it changes.
struct SeriesInfo {
  std::string name{};                 // path or name, for messages
  std::vector<SourceField> fields{};  // at least one
  // Names of fields that the file has on another grid: "b", if the path name + ":b" opens it.
  std::vector<std::string> fields_elsewhere{};
  // By step, strictly ascending, finite; empty: one step without a time.
  std::vector<double> times{};
  std::string time_unit{};    // may be empty
  std::string length_unit{};  // may be empty

  [[nodiscard]] int step_count() const {
    return times.empty() ? 1 : static_cast<int>(times.size());
  }
  [[nodiscard]] const SourceField& field(int index) const {
    return fields[static_cast<std::size_t>(index)];
  }

  friend bool operator==(const SeriesInfo&, const SeriesInfo&) = default;
};

// Thread-compatible.
class VolumeSeries {
 public:
  virtual ~VolumeSeries() = default;

  [[nodiscard]] const SeriesInfo& info() const { return info_; }

  // Opens one component of one field at one step. All have the grid of the first: INVALID_ARGUMENT
  // names file, field, step and what differs. Otherwise errors of the format.
  // REQUIRES: indices in range.
  virtual absl::StatusOr<std::unique_ptr<VolumeSource>> Open(int field, int component,
                                                             int step) = 0;

  // The files that alone decide the samples of a step, if the other files of the source do not
  // matter to it; not set: all of them do. Errors as FilesOf (open_request.h).
  virtual absl::StatusOr<std::optional<std::vector<std::string>>> FilesOfStep(int /*step*/) {
    return std::nullopt;
  }
  // A text for fingerprints, which differs wherever a volume of the step could have other samples:
  // the request, and the stamps of the files. UNIMPLEMENTED: the series was not opened by
  // OpenIdentified (open_request.h), which alone knows both. ABORTED: a file has changed since.
  virtual absl::StatusOr<std::string> IdentityOfStep(int /*step*/) {
    return absl::UnimplementedError(
        absl::StrCat(info_.name, ": nothing tells what decides its samples"));
  }

 protected:
  explicit VolumeSeries(SeriesInfo info) : info_(std::move(info)) {}

 private:
  SeriesInfo info_;
};

}  // namespace isoscope::source

#endif  // ISOSCOPE_CORE_SOURCE_VOLUME_SERIES_H_
