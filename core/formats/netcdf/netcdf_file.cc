// The library gives groups, variables, dimensions and attributes numbers. A coordinate variable has
// the name of a dimension and that dimension alone; it stands in the group of the variable that
// uses it, or in one around it. Variables of other names are coordinates, too, of a variable that
// names them: t:coordinates = "depth", depth(k). Source: CF Metadata Conventions 1.10, chapter 5,
// and the NetCDF Users Guide, "Attribute Conventions", for packing.

#include "core/formats/netcdf/netcdf_file.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <cstddef>
#include <utility>

#include "absl/strings/str_cat.h"
#include "absl/strings/str_format.h"
#include "absl/strings/str_join.h"
#include "absl/strings/str_split.h"

#include "core/base/printable.h"
#include "core/base/status_macros.h"
#include "core/formats/netcdf/netcdf_classic.h"
#include "core/io/file.h"
#include "core/io/mounted_file.h"
#include "core/source/grid/cf_words.h"
#include "core/source/hdf5/hdf5_far_file.h"
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
    std::string first = texts[0] == nullptr ? "" : std::string(texts[0]).substr(0, kMaxNetcdfText);
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

// A number of an attribute as the stored type compares it. `range`: UnsignedRange.
double AsStored(const NetcdfVariable& variable, double range, double number) {
  return variable.stored == volume::ScalarType::kFloat32
             ? static_cast<double>(static_cast<float>(number))
             : number + (number < 0 ? range : 0);
}

// The variable of that name in the group, or in the nearest one around it; false if there is none.
bool FindNetcdfVariable(int group, const std::string& name, int* owner, int* variable) {
  while (nc_inq_varid(group, name.c_str(), variable) != NC_NOERR) {
    if (nc_inq_grp_parent(group, &group) != NC_NOERR) {
      return false;
    }
  }
  *owner = group;
  return true;
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

// Returns the values that stand for no coordinate, as they are stored: those of the variable, and
// the library's fill value of floats.
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

// Takes the attributes and the numbers of a variable with the coordinates of an axis.
absl::Status TakeCoordinates(int group, int variable, CfAxis* axis) {
  axis->axis = NetcdfText(group, variable, "axis");
  axis->positive = NetcdfText(group, variable, "positive");
  axis->standard_name = NetcdfText(group, variable, "standard_name");
  axis->units = NetcdfText(group, variable, "units");
  return ReadCoordinates(group, variable, axis);
}

// Returns true if coordinates that a variable names are those of an axis, by what both say they
// mean.
bool AreCoordinatesOf(const CfAxis& axis, const CfAxis& coordinates) {
  const char own = CfLetterOf(axis);
  const char other = CfLetterOf(coordinates);
  if (axis.size < 2 && other != 'T') {
    return false;
  }
  return other != '?' ? own == '?' || own == other
                      : own != '?' || MetresOfCfUnit(coordinates.units) != 0;
}

// ---- Packing. -----------------------------------------------------------------------------------

struct PackingNumbers {
  std::vector<double> values{};  // none if there is no such attribute
  nc_type type = NC_NAT;
};

// INVALID_ARGUMENT: not `count` numbers.
absl::StatusOr<PackingNumbers> ReadPacking(const NetcdfVariable& variable, const char* name,
                                           std::size_t count) {
  PackingNumbers numbers;
  std::size_t size = 0;
  if (nc_inq_att(variable.group, variable.id, name, &numbers.type, &size) != NC_NOERR ||
      size == 0) {
    return PackingNumbers{};
  }
  numbers.values = NetcdfNumbers(variable.group, variable.id, name);
  const bool is_good = numbers.values.size() == count &&
                       std::none_of(numbers.values.begin(), numbers.values.end(),
                                    [](double value) { return std::isnan(value); });
  if (is_good) {
    return numbers;
  }
  const std::string text = NetcdfText(variable.group, variable.id, name);
  return absl::InvalidArgumentError(absl::StrFormat(
      "its attribute %s is %s; expected %s: correct it (ncatted), or remove it", name,
      numbers.values.empty()
          ? absl::StrCat("the text \"", base::Printable(text.substr(0, 40)), "\"")
          : absl::StrJoin(numbers.values, ", "),
      count == 1 ? "one number" : "two numbers, the least valid one and the largest"));
}

// Ranks types by the values that they hold; floats are wider than all integers.
int WidthOf(nc_type type) {
  switch (type) {
    case NC_BYTE:
    case NC_UBYTE:
      return 0;
    case NC_SHORT:
    case NC_USHORT:
      return 1;
    case NC_INT:
    case NC_UINT:
      return 2;
    case NC_INT64:
    case NC_UINT64:
      return 3;
    case NC_FLOAT:
      return 4;
    case NC_DOUBLE:
      return 5;
    default:
      return -1;
  }
}

// Sets slope and intercept; the type of scaled values is the wider one of both attributes.
absl::StatusOr<nc_type> ReadScale(const NetcdfVariable& variable, NetcdfPacking* packing) {
  ISOSCOPE_ASSIGN_OR_RETURN(const PackingNumbers scale, ReadPacking(variable, "scale_factor", 1));
  ISOSCOPE_ASSIGN_OR_RETURN(const PackingNumbers offset, ReadPacking(variable, "add_offset", 1));
  packing->slope = scale.values.empty() ? 1 : scale.values[0];
  packing->intercept = offset.values.empty() ? 0 : offset.values[0];
  if (!std::isfinite(packing->slope) || packing->slope == 0) {
    return absl::InvalidArgumentError(
        absl::StrFormat("its attribute scale_factor is %g; expected a finite number other than 0: "
                        "correct it (ncatted), or remove it",
                        packing->slope));
  }
  if (!std::isfinite(packing->intercept)) {
    return absl::InvalidArgumentError(
        absl::StrFormat("its attribute add_offset is %g; expected a finite number: correct it "
                        "(ncatted), or remove it",
                        packing->intercept));
  }
  return WidthOf(offset.type) > WidthOf(scale.type) ? offset.type : scale.type;
}

// Sets valid_min and valid_max. `scaled`: the type of scaled values, NC_NAT if there are none.
absl::Status ReadLimits(const NetcdfVariable& variable, nc_type scaled, double unsigned_range,
                        NetcdfPacking* packing) {
  ISOSCOPE_ASSIGN_OR_RETURN(const PackingNumbers range, ReadPacking(variable, "valid_range", 2));
  ISOSCOPE_ASSIGN_OR_RETURN(const PackingNumbers least, ReadPacking(variable, "valid_min", 1));
  ISOSCOPE_ASSIGN_OR_RETURN(const PackingNumbers most, ReadPacking(variable, "valid_max", 1));
  if (!range.values.empty() && !(least.values.empty() && most.values.empty())) {
    return absl::InvalidArgumentError(absl::StrFormat(
        "it has the attribute valid_range beside %s; expected one of them: remove the other "
        "(ncatted)",
        least.values.empty() ? "valid_max" : "valid_min"));
  }
  nc_type stored = NC_NAT;
  nc_inq_vartype(variable.group, variable.id, &stored);
  const auto limit = [&](const PackingNumbers& numbers,
                         std::size_t index) -> std::optional<double> {
    if (numbers.values.empty()) {
      return std::nullopt;
    }
    const double number = numbers.values[index];
    if (numbers.type != scaled || WidthOf(scaled) <= WidthOf(stored)) {
      return AsStored(variable, unsigned_range, number);
    }
    const double packed = (number - packing->intercept) / packing->slope;
    constexpr double kRounding = 1e-3;  // of a stored integer that the limit means
    return WidthOf(stored) < WidthOf(NC_FLOAT) &&
                   std::abs(packed - std::nearbyint(packed)) < kRounding
               ? std::nearbyint(packed)
               : packed;
  };
  packing->valid_min = range.values.empty() ? limit(least, 0) : limit(range, 0);
  packing->valid_max = range.values.empty() ? limit(most, 0) : limit(range, 1);
  const PackingNumbers& any = !range.values.empty() ? range : !least.values.empty() ? least : most;
  if (packing->slope < 0 && any.type == scaled && WidthOf(scaled) > WidthOf(stored)) {
    std::swap(packing->valid_min, packing->valid_max);
  }
  if (packing->valid_min.has_value() && packing->valid_max.has_value() &&
      *packing->valid_min > *packing->valid_max) {
    return absl::InvalidArgumentError(absl::StrFormat(
        "no sample is valid by its %s, from %g to %g; expected the least valid number before the "
        "largest: correct it (ncatted), or remove it",
        range.values.empty() ? "valid_min and valid_max" : "valid_range",
        range.values.empty() ? least.values[0] : range.values[0],
        range.values.empty() ? most.values[0] : range.values[1]));
  }
  return absl::OkStatus();
}

// Returns the value that the library writes where nobody did. Not set for bytes, whose values are
// all data, and for integers of 64 bits, where it is no double: WideSource refuses it.
std::optional<double> DefaultFillOf(nc_type type) {
  switch (type) {
    case NC_SHORT:
      return NC_FILL_SHORT;
    case NC_USHORT:
      return NC_FILL_USHORT;
    case NC_INT:
      return NC_FILL_INT;
    case NC_UINT:
      return NC_FILL_UINT;
    case NC_FLOAT:
      return static_cast<double>(NC_FILL_FLOAT);
    case NC_DOUBLE:
      return NC_FILL_DOUBLE;
    default:
      return std::nullopt;
  }
}

// Returns the values that stand for no sample, as they are stored.
std::vector<double> MissingValues(const NetcdfVariable& variable, double unsigned_range) {
  std::vector<double> missing = NetcdfNumbers(variable.group, variable.id, "_FillValue");
  nc_type stored = NC_NAT;
  nc_inq_vartype(variable.group, variable.id, &stored);
  const bool is_float = stored == NC_FLOAT || stored == NC_DOUBLE;
  int is_unfilled = 0;  // netCDF-4 says of a variable that nothing was written but its values
  nc_inq_var_fill(variable.group, variable.id, &is_unfilled, nullptr);
  const std::optional<double> fill = DefaultFillOf(stored);
  if (missing.empty() && fill.has_value() && (is_float || is_unfilled == 0)) {
    missing.push_back(*fill);
  }
  const std::vector<double> others = NetcdfNumbers(variable.group, variable.id, "missing_value");
  missing.insert(missing.end(), others.begin(), others.end());
  for (double& number : missing) {
    number = AsStored(variable, unsigned_range, number);
  }
  missing.erase(std::remove_if(missing.begin(), missing.end(),
                               [](double number) { return std::isnan(number); }),
                missing.end());
  return missing;
}

}  // namespace

absl::StatusOr<std::unique_ptr<NetcdfFile>> NetcdfFile::Open(const std::string& path) {
  if (!io::PathExists(path)) {
    return absl::NotFoundError(absl::StrCat(path, ": no such file"));
  }
  ISOSCOPE_RETURN_IF_ERROR(CheckClassicNetcdfLength(path));
  const bool is_far = io::IsMounted(path);
  if (IsHdf5File(path)) {
    ISOSCOPE_ASSIGN_OR_RETURN(const Hdf5Handle file,
                              OpenHdf5File(path));  // says more than netCDF of a lock or a cut
    ISOSCOPE_RETURN_IF_ERROR(CheckFarHdf5Objects(file.get(), path));
  } else if (is_far) {
    return absl::InvalidArgumentError(
        absl::StrCat(path,
                     ": a classic file of netCDF at an address needs the whole file; bring it "
                     "with: isoscope copy ",
                     path));
  }
  int id = 0;
  // With "./" no path looks like an address, which the library would fetch.
  std::string local = path.front() == '/' ? path : absl::StrCat("./", path);
  if (is_far) {
    ISOSCOPE_ASSIGN_OR_RETURN(local, StandInForFarHdf5(path));
  }
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
      ISOSCOPE_RETURN_IF_ERROR(TakeCoordinates(owner, variable, &axis));
    }
    axes.push_back(axes_.emplace(dimension, std::move(axis)).first->second);
  }
  return axes;
}

absl::Status NetcdfFile::TakeAuxiliary(NetcdfVariable* variable) {
  const std::string list = NetcdfText(variable->group, variable->id, "coordinates");
  const std::vector<std::string> names =
      absl::StrSplit(list, absl::ByAnyChar(" \t\n"), absl::SkipEmpty());
  // Coordinates of one dimension go before those of several.
  for (const bool is_straight : {true, false}) {
    for (const std::string& name : names) {
      int group = 0;
      int id = 0;
      int rank = 0;
      if (!FindNetcdfVariable(variable->group, name, &group, &id) ||
          nc_inq_varndims(group, id, &rank) != NC_NOERR || rank < 1 || (rank == 1) != is_straight) {
        continue;
      }
      std::vector<int> dimensions(static_cast<std::size_t>(rank));
      nc_inq_vardimid(group, id, dimensions.data());
      ISOSCOPE_RETURN_IF_ERROR(TakeAuxiliaryAxis(group, id, dimensions, variable));
    }
  }
  return absl::OkStatus();
}

absl::Status NetcdfFile::TakeAuxiliaryAxis(int group, int id, const std::vector<int>& dimensions,
                                           NetcdfVariable* variable) {
  std::vector<std::size_t> places;  // of the dimensions, in the variable
  for (const int dimension : dimensions) {
    const auto found =
        std::find(variable->dimensions.begin(), variable->dimensions.end(), dimension);
    if (found == variable->dimensions.end()) {
      return absl::OkStatus();
    }
    places.push_back(static_cast<std::size_t>(found - variable->dimensions.begin()));
  }
  std::array<char, NC_MAX_NAME + 1> name{};
  nc_inq_varname(group, id, name.data());
  CfAxis& first = variable->axes[places[0]];
  if (places.size() == 1) {
    if (!first.values.empty() || first.size < 1 ||
        first.size > static_cast<std::int64_t>(kMaxNetcdfAxis)) {
      return absl::OkStatus();
    }
    auto known = auxiliary_.find({group, id});
    if (known == auxiliary_.end()) {
      CfAxis read{.name = name.data(), .size = first.size};
      ISOSCOPE_RETURN_IF_ERROR(TakeCoordinates(group, id, &read));
      known = auxiliary_.emplace(std::pair{group, id}, std::move(read)).first;
    }
    if (!known->second.values.empty() && AreCoordinatesOf(first, known->second)) {
      const char own = CfLetterOf(first);
      first = known->second;
      if (CfLetterOf(first) == '?' && (own == 'T' || (own >= 'X' && own <= 'Z'))) {
        first.axis = std::string(1, own);  // by the name of the dimension
      }
    }
    return absl::OkStatus();
  }
  const CfAxis meaning{.name = name.data(),
                       .axis = NetcdfText(group, id, "axis"),
                       .positive = NetcdfText(group, id, "positive"),
                       .standard_name = NetcdfText(group, id, "standard_name"),
                       .units = NetcdfText(group, id, "units")};
  const char letter = CfLetterOf(meaning);
  for (const std::size_t place : places) {
    CfAxis& axis = variable->axes[place];
    if (letter >= 'X' && letter <= 'Z' && axis.values.empty() && axis.size > 1) {
      axis.fault = absl::StrFormat(
          "its coordinates \"%s\" depend on %d axes, among them \"%s\", which has none of its own: "
          "the grid is curved; expected coordinates of one axis each: regrid it (cdo remapbil), or "
          "take it by its indices, which --spacing X,Y,Z and --origin X,Y,Z place",
          base::Printable(meaning.name), places.size(), base::Printable(axis.name));
    }
  }
  return absl::OkStatus();
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
  ISOSCOPE_RETURN_IF_ERROR(TakeAuxiliary(&variable));
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

absl::StatusOr<NetcdfPacking> NetcdfFile::PackingOf(const NetcdfVariable& variable) {
  NetcdfPacking packing;
  const double unsigned_range = UnsignedRange(variable.group, variable.id, variable.stored);
  ISOSCOPE_ASSIGN_OR_RETURN(const nc_type scaled, ReadScale(variable, &packing));
  ISOSCOPE_RETURN_IF_ERROR(ReadLimits(variable, scaled, unsigned_range, &packing));
  packing.missing = MissingValues(variable, unsigned_range);
  return packing;
}

}  // namespace isoscope::source
