// The library gives groups, variables, dimensions and attributes numbers. A coordinate variable has
// the name of a dimension and that dimension alone; it stands in the group of the variable that
// uses it, or in one around it.

#include "core/formats/netcdf/netcdf_file.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <cstddef>
#include <limits>
#include <type_traits>
#include <utility>

#include "absl/strings/str_cat.h"
#include "absl/strings/str_format.h"

#include "core/base/status_macros.h"
#include "core/formats/netcdf/netcdf_classic.h"
#include "core/io/file.h"
#include "core/source/hdf5/hdf5_file.h"
#include "core/source/hdf5/hdf5_path.h"
#include "netcdf.h"

namespace isoscope::source {
namespace {

constexpr int kMaxNetcdfVariables = 10'000;
constexpr int kMaxNetcdfGroups = 32;  // within each other
constexpr std::size_t kMaxNetcdfAxis = std::size_t{1} << 24;
constexpr std::size_t kMaxNetcdfNumbers = 64;
constexpr std::size_t kMaxNetcdfText = 65'536;

// "" if there is no such attribute of text.
std::string NetcdfText(int group, int variable, const char* name) {
  nc_type type = NC_NAT;
  std::size_t size = 0;
  if (nc_inq_att(group, variable, name, &type, &size) != NC_NOERR || size == 0 ||
      size > kMaxNetcdfText) {
    return "";
  }
  if (type == NC_STRING) {
    std::vector<char*> texts(size, nullptr);
    if (size > kMaxNetcdfNumbers ||
        nc_get_att_string(group, variable, name, texts.data()) != NC_NOERR) {
      return "";
    }
    const std::string first =
        texts[0] == nullptr ? "" : std::string(texts[0]).substr(0, kMaxNetcdfText);
    nc_free_string(size, texts.data());
    return first;
  }
  std::string text(size, '\0');
  if (type != NC_CHAR || nc_get_att_text(group, variable, name, text.data()) != NC_NOERR) {
    return "";
  }
  return text.substr(0, std::min(text.find('\0'), size));
}

// None if there is no such attribute of numbers.
std::vector<double> NetcdfNumbers(int group, int variable, const char* name) {
  nc_type type = NC_NAT;
  std::size_t size = 0;
  if (nc_inq_att(group, variable, name, &type, &size) != NC_NOERR || size == 0 ||
      size > kMaxNetcdfNumbers || type == NC_CHAR || type == NC_STRING || type > NC_STRING) {
    return {};
  }
  std::vector<double> numbers(size);
  const int status = nc_get_att_double(group, variable, name, numbers.data());
  return status == NC_NOERR || status == NC_ERANGE ? numbers : std::vector<double>();
}

bool NetcdfTypeOf(int group, int variable, volume::ScalarType* stored,
                  std::optional<WideType>* wide) {
  using volume::ScalarType;
  nc_type type = NC_NAT;
  if (nc_inq_vartype(group, variable, &type) != NC_NOERR) {
    return false;
  }
  const std::string is_unsigned = NetcdfText(group, variable, "_Unsigned");
  const bool flips = is_unsigned == "true" || is_unsigned == "True";
  *wide = std::nullopt;
  switch (type) {
    case NC_BYTE:
      *stored = flips ? ScalarType::kUint8 : ScalarType::kInt8;
      return true;
    case NC_UBYTE:
      *stored = ScalarType::kUint8;
      return true;
    case NC_SHORT:
      *stored = flips ? ScalarType::kUint16 : ScalarType::kInt16;
      return true;
    case NC_USHORT:
      *stored = ScalarType::kUint16;
      return true;
    case NC_INT:
      *stored = flips ? ScalarType::kUint32 : ScalarType::kInt32;
      return true;
    case NC_UINT:
      *stored = ScalarType::kUint32;
      return true;
    case NC_FLOAT:
      *stored = ScalarType::kFloat32;
      return true;
    case NC_DOUBLE:
      *stored = ScalarType::kFloat64;
      return true;
    case NC_INT64:
    case NC_UINT64:
      *wide = type == NC_INT64 ? WideType::kInt64 : WideType::kUint64;
      *stored = CarrierType(**wide);
      return true;
    default:
      return false;
  }
}

// A number of an attribute as the stored type has it; not set if that can't hold it. An unsigned
// type takes the bits of a negative one (_Unsigned).
template <typename T>
std::optional<double> AsStored(double number) {
  if constexpr (std::is_same_v<T, float>) {
    return static_cast<double>(static_cast<float>(number));
  } else if constexpr (std::is_integral_v<T>) {
    const double range = std::ldexp(1.0, std::numeric_limits<T>::digits);
    if (std::is_unsigned_v<T> && number < 0) {
      number += range;
    }
    const double least = std::is_signed_v<T> ? -range : 0;
    return number >= least && number < range && number == std::floor(number)
               ? std::optional<double>(number)
               : std::nullopt;
  } else {
    return number;
  }
}

// The coordinate variable of a dimension; false if there is none.
bool FindCoordinate(int group, int dimension, const char* name, int* owner, int* variable) {
  while (true) {
    int rank = 0;
    int only = -1;
    if (nc_inq_varid(group, name, variable) == NC_NOERR &&
        nc_inq_varndims(group, *variable, &rank) == NC_NOERR && rank == 1 &&
        nc_inq_vardimid(group, *variable, &only) == NC_NOERR && only == dimension) {
      *owner = group;
      return true;
    }
    if (nc_inq_grp_parent(group, &group) != NC_NOERR) {
      return false;
    }
  }
}

// What stands for no coordinate: its own values, and the library's fill value of floats, as they
// are stored.
std::vector<double> MissingCoordinates(int group, int variable, volume::ScalarType type) {
  std::vector<double> missing = NetcdfNumbers(group, variable, "_FillValue");
  const std::vector<double> others = NetcdfNumbers(group, variable, "missing_value");
  missing.insert(missing.end(), others.begin(), others.end());
  if (type == volume::ScalarType::kFloat32) {
    for (double& value : missing) {
      value = static_cast<double>(static_cast<float>(value));
    }
    missing.push_back(static_cast<double>(NC_FILL_FLOAT));
  } else if (type == volume::ScalarType::kFloat64) {
    missing.push_back(NC_FILL_DOUBLE);
  }
  return missing;
}

// 2^bits for an integer whose sign is a bit of the number (_Unsigned), else 0.
double UnsignedRange(int group, int variable, volume::ScalarType type) {
  nc_type stored = NC_NAT;
  nc_inq_vartype(group, variable, &stored);
  const bool flips = (stored == NC_BYTE && type == volume::ScalarType::kUint8) ||
                     (stored == NC_SHORT && type == volume::ScalarType::kUint16) ||
                     (stored == NC_INT && type == volume::ScalarType::kUint32);
  return flips ? std::ldexp(1.0, static_cast<int>(8 * volume::SizeOf(type))) : 0;
}

absl::Status ReadCoordinates(int group, int variable, CfAxis* axis) {
  volume::ScalarType type{};
  std::optional<WideType> wide;
  if (!NetcdfTypeOf(group, variable, &type, &wide)) {
    return absl::OkStatus();  // names, as of months
  }
  axis->values.resize(static_cast<std::size_t>(axis->size));
  const int status = nc_get_var_double(group, variable, axis->values.data());
  if (status != NC_NOERR) {
    return absl::DataLossError(absl::StrFormat("its coordinate \"%s\" can't be read: %s",
                                               axis->name, nc_strerror(status)));
  }
  axis->is_single = type == volume::ScalarType::kFloat32;
  const std::vector<double> scale = NetcdfNumbers(group, variable, "scale_factor");
  const std::vector<double> offset = NetcdfNumbers(group, variable, "add_offset");
  const std::vector<double> missing = MissingCoordinates(group, variable, type);
  const double wrap = UnsignedRange(group, variable, type);
  for (double& value : axis->values) {
    const bool is_missing = std::find(missing.begin(), missing.end(), value) != missing.end();
    value += value < 0 ? wrap : 0;
    value = value * (scale.empty() ? 1 : scale[0]) + (offset.empty() ? 0 : offset[0]);
    value = is_missing ? std::nan("") : value;
  }
  return absl::OkStatus();
}

}  // namespace

absl::StatusOr<std::unique_ptr<NetcdfFile>> NetcdfFile::Open(const std::string& path) {
  if (!io::PathExists(path)) {
    return absl::NotFoundError(absl::StrCat(path, ": no such file"));
  }
  ISOSCOPE_RETURN_IF_ERROR(CheckClassicNetcdfLength(path));
  if (IsHdf5File(path)) {
    ISOSCOPE_RETURN_IF_ERROR(
        OpenHdf5File(path).status());  // says more than netCDF of a lock or a cut
  }
  int id = 0;
  // With "./" no path looks like an address, which the library would fetch.
  const std::string local = path.front() == '/' ? path : absl::StrCat("./", path);
  const int status = nc_open(local.c_str(), NC_NOWRITE, &id);
  if (status != NC_NOERR) {
    return absl::InvalidArgumentError(absl::StrCat(
        path, ": can't be opened as netCDF: ", nc_strerror(status), ": no netCDF file, or cut"));
  }
  return std::unique_ptr<NetcdfFile>(new NetcdfFile(path, id));
}

NetcdfFile::~NetcdfFile() { nc_close(id_); }

absl::StatusOr<std::vector<CfAxis>> NetcdfFile::AxesOf(int group,
                                                       const std::vector<int>& dimensions) {
  std::vector<CfAxis> axes;
  for (const int dimension : dimensions) {
    if (const auto known = axes_.find(dimension); known != axes_.end()) {
      axes.push_back(known->second);
      continue;
    }
    std::array<char, NC_MAX_NAME + 1> name{};
    std::size_t length = 0;
    if (nc_inq_dim(group, dimension, name.data(), &length) != NC_NOERR) {
      return absl::DataLossError(absl::StrCat("dimension ", dimension, " can't be read"));
    }
    CfAxis axis{.name = name.data(), .size = static_cast<std::int64_t>(length)};
    int owner = 0;
    int variable = 0;
    if (length > 0 && length <= kMaxNetcdfAxis &&
        FindCoordinate(group, dimension, name.data(), &owner, &variable)) {
      axis.axis = NetcdfText(owner, variable, "axis");
      axis.positive = NetcdfText(owner, variable, "positive");
      axis.standard_name = NetcdfText(owner, variable, "standard_name");
      axis.units = NetcdfText(owner, variable, "units");
      ISOSCOPE_RETURN_IF_ERROR(ReadCoordinates(owner, variable, &axis));
    }
    axes.push_back(axes_.emplace(dimension, std::move(axis)).first->second);
  }
  return axes;
}

absl::StatusOr<std::optional<NetcdfVariable>> NetcdfFile::Describe(int group, int id,
                                                                   const std::string& prefix,
                                                                   int least_rank) {
  constexpr int kMaxRank = 32;
  NetcdfVariable variable{.group = group, .id = id, .name = ""};
  std::array<char, NC_MAX_NAME + 1> name{};
  int rank = 0;
  if (nc_inq_varname(group, id, name.data()) != NC_NOERR ||
      nc_inq_varndims(group, id, &rank) != NC_NOERR || rank < least_rank || rank > kMaxRank ||
      !NetcdfTypeOf(group, id, &variable.stored, &variable.wide)) {
    return std::nullopt;
  }
  variable.name = absl::StrCat(prefix, name.data());
  variable.dimensions.resize(static_cast<std::size_t>(rank));
  nc_inq_vardimid(group, id, variable.dimensions.data());
  ISOSCOPE_ASSIGN_OR_RETURN(variable.axes, AxesOf(group, variable.dimensions));
  return variable;
}

absl::Status NetcdfFile::Visit(int group, const std::string& prefix, int depth,
                               std::vector<NetcdfVariable>* arrays) {
  int count = 0;
  nc_inq_nvars(group, &count);
  visited_ += count;
  if (visited_ > kMaxNetcdfVariables || depth > kMaxNetcdfGroups) {
    return absl::InvalidArgumentError(
        absl::StrFormat("more than %d variables, or %d groups within each other",
                        kMaxNetcdfVariables, kMaxNetcdfGroups));
  }
  for (int id = 0; id < count; ++id) {
    ISOSCOPE_ASSIGN_OR_RETURN(std::optional<NetcdfVariable> variable,
                              Describe(group, id, prefix, 3));
    if (variable.has_value()) {
      arrays->push_back(*std::move(variable));
    }
  }
  int group_count = 0;
  if (nc_inq_grps(group, &group_count, nullptr) != NC_NOERR || group_count <= 0) {
    return absl::OkStatus();
  }
  std::vector<int> groups(static_cast<std::size_t>(group_count));
  nc_inq_grps(group, nullptr, groups.data());
  for (const int inner : groups) {
    std::array<char, NC_MAX_NAME + 1> name{};
    if (nc_inq_grpname(inner, name.data()) == NC_NOERR) {
      ISOSCOPE_RETURN_IF_ERROR(
          Visit(inner, absl::StrCat(prefix, name.data(), "/"), depth + 1, arrays));
    }
  }
  return absl::OkStatus();
}

absl::StatusOr<std::vector<NetcdfVariable>> NetcdfFile::Arrays() {
  std::vector<NetcdfVariable> arrays;
  visited_ = 0;
  const absl::Status status = Visit(id_, "", 0, &arrays);
  if (!status.ok()) {
    return absl::Status(status.code(), absl::StrCat(path_, ": ", status.message()));
  }
  return arrays;
}

absl::StatusOr<std::optional<NetcdfVariable>> NetcdfFile::Find(const std::string& name) {
  int id = 0;
  if (nc_inq_varid(id_, name.c_str(), &id) != NC_NOERR) {
    return std::nullopt;
  }
  auto variable = Describe(id_, id, "", 0);
  if (!variable.ok()) {
    return absl::Status(variable.status().code(),
                        absl::StrCat(path_, ": ", variable.status().message()));
  }
  return variable;
}

std::vector<double> NetcdfFile::Numbers(const NetcdfVariable& variable, const char* name) const {
  return NetcdfNumbers(variable.group, variable.id, name);
}

absl::StatusOr<std::vector<double>> NetcdfFile::Values(const NetcdfVariable& variable) const {
  std::int64_t count = 1;
  for (const CfAxis& axis : variable.axes) {
    if (axis.size > static_cast<std::int64_t>(kMaxNetcdfAxis) / std::max<std::int64_t>(count, 1)) {
      return absl::InvalidArgumentError(
          absl::StrFormat("%s:%s: more than %d elements", path_, variable.name, kMaxNetcdfAxis));
    }
    count *= axis.size;
  }
  std::vector<double> values(static_cast<std::size_t>(count));
  const int status = nc_get_var_double(variable.group, variable.id, values.data());
  if (status != NC_NOERR) {
    return absl::DataLossError(absl::StrCat(path_, ":", variable.name, ": can't be read: ",
                                            nc_strerror(status), ": the file is damaged or cut"));
  }
  return values;
}

std::string NetcdfFile::Text(const NetcdfVariable& variable,
                             const std::vector<const char*>& names) const {
  for (const char* name : names) {
    std::string text = NetcdfText(variable.group, variable.id, name);
    if (!text.empty()) {
      return text;
    }
  }
  return "";
}

NetcdfPacking NetcdfFile::PackingOf(const NetcdfVariable& variable) const {
  const auto numbers = [&](const char* name) {
    return NetcdfNumbers(variable.group, variable.id, name);
  };
  NetcdfPacking packing;
  VisitNetcdfType(variable, [&]<typename T>() {
    const auto add_missing = [&](double number) {
      const std::optional<double> stored = AsStored<T>(number);
      if (stored.has_value() && !std::isnan(*stored)) {
        packing.missing.push_back(*stored);
      }
    };
    const std::vector<double> fill = numbers("_FillValue");
    std::for_each(fill.begin(), fill.end(), add_missing);
    const std::vector<double> missing = numbers("missing_value");
    std::for_each(missing.begin(), missing.end(), add_missing);
    if (fill.empty() && std::is_floating_point_v<T> && !variable.wide.has_value()) {
      add_missing(NC_FILL_DOUBLE);
    }
    const auto limit = [&](const std::vector<double>& values, std::size_t index) {
      return index < values.size() ? AsStored<T>(values[index]) : std::nullopt;
    };
    const std::vector<double> range = numbers("valid_range");
    packing.valid_min = range.size() == 2 ? limit(range, 0) : limit(numbers("valid_min"), 0);
    packing.valid_max = range.size() == 2 ? limit(range, 1) : limit(numbers("valid_max"), 0);
  });
  const std::vector<double> scale = numbers("scale_factor");
  const std::vector<double> offset = numbers("add_offset");
  packing.slope = scale.empty() ? 1 : scale[0];
  packing.intercept = offset.empty() ? 0 : offset[0];
  return packing;
}

}  // namespace isoscope::source
