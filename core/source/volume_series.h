// A source with several fields or time steps on one grid.

#ifndef ISOSCOPE_CORE_SOURCE_VOLUME_SERIES_H_
#define ISOSCOPE_CORE_SOURCE_VOLUME_SERIES_H_

#include <memory>
#include <optional>
#include <string>
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
};

// Thread-compatible.
class VolumeSeries {
 public:
  virtual ~VolumeSeries() = default;

  // Path or name, for messages.
  [[nodiscard]] virtual const std::string& name() const = 0;
  // At least one.
  [[nodiscard]] virtual const std::vector<SourceField>& fields() const = 0;
  // By step, strictly ascending, finite; empty: one step without a time.
  [[nodiscard]] virtual const std::vector<double>& times() const = 0;
  [[nodiscard]] virtual const std::string& time_unit() const = 0;    // may be empty
  [[nodiscard]] virtual const std::string& length_unit() const = 0;  // may be empty

  // Names of fields that the file has on another grid: "b", if the path name() + ":b" opens it.
  [[nodiscard]] virtual std::vector<std::string> FieldsElsewhere() const { return {}; }

  [[nodiscard]] int step_count() const {
    return times().empty() ? 1 : static_cast<int>(times().size());
  }

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
        absl::StrCat(name(), ": nothing tells what decides its samples"));
  }
};

}  // namespace isoscope::source

#endif  // ISOSCOPE_CORE_SOURCE_VOLUME_SERIES_H_
