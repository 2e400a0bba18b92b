// Variables of a netCDF file, classic or netCDF-4. Calls the library: for the process that it runs
// in (walled_source.h).

#ifndef ISOSCOPE_CORE_FORMATS_NETCDF_NETCDF_FILE_H_
#define ISOSCOPE_CORE_FORMATS_NETCDF_NETCDF_FILE_H_

#include <cstdint>
#include <map>
#include <memory>
#include <optional>
#include <string>
#include <utility>
#include <vector>

#include "absl/status/statusor.h"

#include "core/source/adapt/wide_source.h"
#include "core/source/grid/cf_grid.h"
#include "core/volume/scalar_type.h"

namespace isoscope::source {

// The rule that turns stored values into samples. Missing values become NaN: those of _FillValue
// and missing_value, and those outside valid_min, valid_max or valid_range. Without a _FillValue,
// so does the library's own fill value, unless the type is bytes or integers of 64 bits. Other
// values become scale_factor * stored + add_offset. All members are as values are stored, also
// limits that the file gives as they are scaled.
struct NetcdfPacking {
  double slope = 1;
  double intercept = 0;
  std::vector<double> missing{};  // as they are stored
  std::optional<double> valid_min = std::nullopt;
  std::optional<double> valid_max = std::nullopt;

  // Returns true if samples are the stored values.
  [[nodiscard]] bool is_plain() const {
    return slope == 1 && intercept == 0 && missing.empty() && !valid_min.has_value() &&
           !valid_max.has_value();
  }
};

struct NetcdfVariable {
  int group = 0;  // the library's ids
  int id = 0;
  std::string name;  // "group/u" within a group
  std::vector<int> dimensions{};
  // The axis of each dimension. Without a coordinate variable the attribute "coordinates" decides,
  // which names variables along one dimension. Those along several are the fault of the axis.
  std::vector<CfAxis> axes{};
  CfRoles roles{};
  volume::ScalarType stored{};
  std::optional<WideType> wide{};
};

// Thread-compatible.
class NetcdfFile {
 public:
  // NOT_FOUND: no such file. INVALID_ARGUMENT: no netCDF file, or damaged.
  static absl::StatusOr<std::unique_ptr<NetcdfFile>> Open(const std::string& path);
  ~NetcdfFile();
  NetcdfFile(const NetcdfFile&) = delete;
  NetcdfFile& operator=(const NetcdfFile&) = delete;

  [[nodiscard]] const std::string& path() const { return path_; }
  // The variables of numbers with three dimensions or more, in all groups, in the file's order,
  // without roles. INVALID_ARGUMENT: more than 10 000 variables; a coordinate that can't be read.
  absl::StatusOr<std::vector<NetcdfVariable>> Arrays();
  // The variable of that name outside groups, without roles; of any rank. Not set if there is none
  // of numbers. DATA_LOSS: a coordinate that can't be read.
  absl::StatusOr<std::optional<NetcdfVariable>> Find(const std::string& name);
  // The first of several attributes of a variable that is a text and not empty; else "".
  [[nodiscard]] std::string Text(const NetcdfVariable& variable,
                                 const std::vector<const char*>& names) const;
  // An attribute of at most 64 numbers; none if there is no such one.
  [[nodiscard]] std::vector<double> Numbers(const NetcdfVariable& variable, const char* name) const;
  // All elements of a variable. INVALID_ARGUMENT: more than 2^24 of them. DATA_LOSS: can't be read.
  [[nodiscard]] absl::StatusOr<std::vector<double>> Values(const NetcdfVariable& variable) const;
  // INVALID_ARGUMENT: an attribute of packing that is a text, no number, or of another count; a
  // scale_factor of 0; valid_range beside another limit; limits that leave no value. The message is
  // to follow a name and a colon.
  [[nodiscard]] static absl::StatusOr<NetcdfPacking> PackingOf(const NetcdfVariable& variable);

 private:
  NetcdfFile(std::string path, int id) : path_(std::move(path)), id_(id) {}

  // Not set if the library does not know it, or it is not of numbers, or has fewer dimensions.
  absl::StatusOr<std::optional<NetcdfVariable>> Describe(int group, int id,
                                                         const std::string& prefix, int least_rank);
  absl::Status Visit(int group, const std::string& prefix, int depth,
                     std::vector<NetcdfVariable>* arrays);
  absl::StatusOr<std::vector<CfAxis>> AxesOf(int group, const std::vector<int>& dimensions);
  // Completes the axes by the attribute "coordinates".
  absl::Status TakeAuxiliary(NetcdfVariable* variable);
  absl::Status TakeAuxiliaryAxis(int group, int id, const std::vector<int>& dimensions,
                                 NetcdfVariable* variable);

  const std::string path_;
  const int id_;
  std::map<int, CfAxis> axes_;                       // by dimension
  std::map<std::pair<int, int>, CfAxis> auxiliary_;  // by group and variable
  int visited_ = 0;                                  // variables
};

// Calls visitor.operator()<T>() with the C++ type of the stored bits.
template <typename Visitor>
decltype(auto) VisitNetcdfType(const NetcdfVariable& variable, Visitor&& visitor) {
  if (variable.wide == WideType::kInt64) {
    return visitor.template operator()<std::int64_t>();
  }
  if (variable.wide == WideType::kUint64) {
    return visitor.template operator()<std::uint64_t>();
  }
  return volume::VisitScalarType(variable.stored, std::forward<Visitor>(visitor));
}

}  // namespace isoscope::source

#endif  // ISOSCOPE_CORE_FORMATS_NETCDF_NETCDF_FILE_H_
