// Sources: the specifications of Zarr 2 and Zarr 3 (core protocol 3.1), https://zarr-specs.readthedocs.io.
//
// An array of Zarr 2 is one of Zarr 3 with these codecs, in this order:
//
//   "order": "F"       transpose, all axes the other way round
//   "dtype": ">u2"     bytes, with that byte order
//   "filters"          in their order; they see bytes
//   "compressor"       the last one

#include "core/formats/zarr/zarr_metadata.h"

#include <algorithm>
#include <array>
#include <cstddef>
#include <cstdint>
#include <limits>
#include <utility>

#include "absl/strings/match.h"
#include "absl/strings/numbers.h"
#include "absl/strings/str_cat.h"
#include "absl/strings/str_format.h"
#include "absl/strings/str_join.h"
#include "absl/strings/strip.h"

#include "core/base/check.h"
#include "core/base/coding.h"
#include "core/base/printable.h"
#include "core/base/status_macros.h"

namespace isoscope::source {
namespace {

absl::Status BadMember(const std::string& name, const char* member, const ZarrJson* value,
                       absl::string_view expected) {
  return absl::InvalidArgumentError(
      absl::StrFormat("%s: its %s is %s; expected %s", name, member,
                      value == nullptr ? "missing" : ShownJson(*value), expected));
}

absl::Status CheckZarrVersion(const ZarrJson& metadata, int version, const std::string& name) {
  const ZarrJson* const format = MemberOf(metadata, "zarr_format");
  return format != nullptr && *format == version
             ? absl::OkStatus()
             : BadMember(name, "zarr_format", format, absl::StrCat(version));
}

absl::StatusOr<ChunkIndex> SizesIn(const ZarrJson& object, const char* member,
                                   const std::string& name) {
  const ZarrJson* const list = MemberOf(object, member);
  ChunkIndex sizes;
  if (list != nullptr && list->is_array() && list->size() <= kMaxChunkAxes) {
    for (const ZarrJson& size : *list) {
      if (!size.is_number_integer() || size < 0 ||
          size > std::numeric_limits<std::int64_t>::max()) {
        break;
      }
      sizes.push_back(size.get<std::int64_t>());
    }
    if (sizes.size() == list->size()) {
      return sizes;
    }
  }
  return BadMember(name, member, list,
                   absl::StrFormat("a list of at most %d sizes from 0 on", kMaxChunkAxes));
}

// ---- Times: "<M8[ns]" of Zarr 2, "numpy.datetime64" of Zarr 3. ----------------------------------

// Times below a second are seconds, which a double has as exactly as their own unit.
absl::StatusOr<ZarrTime> TimeOfUnit(absl::string_view unit, std::int64_t count, bool is_date) {
  struct Unit {
    absl::string_view name;
    absl::string_view of_cf;
    double multiple;
    double divisor;
  };
  constexpr std::array<Unit, 12> kUnits = {{{"W", "days", 7, 1},
                                            {"D", "days", 1, 1},
                                            {"h", "hours", 1, 1},
                                            {"m", "minutes", 1, 1},
                                            {"s", "seconds", 1, 1},
                                            {"ms", "seconds", 1, 1e3},
                                            {"us", "seconds", 1, 1e6},
                                            {"\xce\xbcs", "seconds", 1, 1e6},
                                            {"ns", "seconds", 1, 1e9},
                                            {"ps", "seconds", 1, 1e12},
                                            {"fs", "seconds", 1, 1e15},
                                            {"as", "seconds", 1, 1e18}}};
  for (const Unit& known : kUnits) {
    if (known.name == unit && count >= 1) {
      return ZarrTime{.units = absl::StrCat(known.of_cf, is_date ? " since 1970-01-01" : ""),
                      .multiple = known.multiple * static_cast<double>(count),
                      .divisor = known.divisor};
    }
  }
  return absl::InvalidArgumentError(absl::StrFormat(
      "times of %d \"%s\"; expected weeks (W) or less, down to as: years and months "
      "differ in length",
      count, base::Printable(unit.substr(0, 20))));
}

// "<M8[ns]" and "<m8[25s]"; not set for other types.
absl::StatusOr<std::optional<ZarrTime>> NumpyTimeOf(absl::string_view dtype) {
  absl::string_view text = dtype;
  if (!text.empty() && absl::StrContains("<>|=", text.substr(0, 1))) {
    text.remove_prefix(1);
  }
  const bool is_date = absl::ConsumePrefix(&text, "M8");
  if (!is_date && !absl::ConsumePrefix(&text, "m8")) {
    return std::nullopt;
  }
  std::int64_t count = 1;
  if (absl::ConsumePrefix(&text, "[") && absl::ConsumeSuffix(&text, "]")) {
    const std::size_t digits = text.find_first_not_of("0123456789");
    if (digits > 0 && digits != absl::string_view::npos && digits < 10) {
      ISOSCOPE_CHECK(absl::SimpleAtoi(text.substr(0, digits), &count));
      text.remove_prefix(digits);
    }
  } else {
    text = "";
  }
  ISOSCOPE_ASSIGN_OR_RETURN(ZarrTime time, TimeOfUnit(text, count, is_date));
  return std::optional<ZarrTime>(std::move(time));
}

absl::StatusOr<ZarrTime> Zarr3TimeOf(const ZarrJson& configuration, bool is_date) {
  const ZarrJson* const factor = MemberOf(configuration, "scale_factor");
  const std::int64_t count = factor == nullptr             ? 1
                             : factor->is_number_integer() ? factor->get<std::int64_t>()
                                                           : 0;
  return TimeOfUnit(TextOf(configuration, "unit"), count, is_date);
}

absl::Status TakeFill(const ZarrJson* value, const std::string& name, ZarrArray* array) {
  array->has_fill = value != nullptr && !value->is_null();
  if (!array->has_fill) {
    array->fill = std::string(SizeOf(array->type), '\0');
    return absl::OkStatus();
  }
  if (array->time.has_value() && *value == "NaT") {
    base::AppendLittleEndian(std::numeric_limits<std::int64_t>::min(), &array->fill);
    return absl::OkStatus();
  }
  auto fill = NumberBytes(*value, array->type);
  if (!fill.ok()) {
    return absl::InvalidArgumentError(
        absl::StrFormat("%s: its fill_value: %s", name, fill.status().message()));
  }
  array->fill = *std::move(fill);
  return absl::OkStatus();
}

// n5-zarr and jzarr write the fill value of Zarr 2 as text, "0", which zarr-python and GDAL take for
// the number. Returns the number of such a text, other values as they are, null for none.
ZarrJson Zarr2Fill(const ZarrJson* value) {
  constexpr std::size_t kMaxNumberText = 40;
  if (value == nullptr) {
    return {};
  }
  if (value->is_string() && value->get_ref<const std::string&>().size() <= kMaxNumberText) {
    ZarrJson number = ZarrJson::parse(value->get_ref<const std::string&>(), /*cb=*/nullptr,
                                      /*allow_exceptions=*/false);
    return number.is_number() ? number : *value;
  }
  return *value;
}

absl::StatusOr<char> SeparatorIn(const ZarrJson& object, const char* member, char otherwise,
                                 const std::string& name) {
  const ZarrJson* const separator = MemberOf(object, member);
  if (separator == nullptr || separator->is_null()) {
    return otherwise;
  }
  if (*separator != "." && *separator != "/") {
    return BadMember(name, member, separator, "\".\" or \"/\"");
  }
  return *separator == "." ? '.' : '/';
}

// The names of a list, one for each axis; none if the list does not have them.
std::vector<std::string> NamesOfAxes(const ZarrJson* list, std::size_t rank) {
  std::vector<std::string> names;
  if (list != nullptr && list->is_array() && list->size() == rank) {
    for (const ZarrJson& item : *list) {
      names.push_back(item.is_string() ? item.get<std::string>() : "");
    }
  }
  return std::all_of(names.begin(), names.end(), [](const std::string& n) { return n.empty(); })
             ? std::vector<std::string>()
             : names;
}

// A codec of Zarr 2: an object with an "id".
absl::StatusOr<CodecSpec> Zarr2Codec(const ZarrJson& codec, const char* member,
                                     const std::string& name) {
  const std::string id = TextOf(codec, "id");
  if (id.empty()) {
    return BadMember(name, member, &codec, "objects with an id");
  }
  CodecSpec spec{.name = id, .configuration = codec};
  spec.configuration.erase("id");
  return spec;
}

// An extension of Zarr 3: a name, or an object with a name and a configuration.
struct ZarrExtension {
  std::string name;
  ZarrJson configuration = ZarrJson::object();
};
absl::StatusOr<ZarrExtension> ExtensionIn(const ZarrJson& metadata, const char* member,
                                          const std::string& name) {
  const ZarrJson* const value = MemberOf(metadata, member);
  ZarrExtension extension;
  if (value != nullptr && value->is_string()) {
    extension.name = value->get<std::string>();
  } else if (value != nullptr) {
    extension.name = TextOf(*value, "name");
    const ZarrJson* const configuration = MemberOf(*value, "configuration");
    if (configuration != nullptr && configuration->is_object()) {
      extension.configuration = *configuration;
    }
  }
  return extension.name.empty()
             ? absl::StatusOr<ZarrExtension>(BadMember(name, member, value, "one with a name"))
             : extension;
}

// Members that Zarr 3 does not know are refused, unless they say that they need not be understood.
absl::Status CheckZarr3Members(const ZarrJson& metadata, const std::string& name) {
  constexpr std::array<absl::string_view, 12> kKnown = {"zarr_format",
                                                        "node_type",
                                                        "shape",
                                                        "data_type",
                                                        "chunk_grid",
                                                        "chunk_key_encoding",
                                                        "fill_value",
                                                        "codecs",
                                                        "attributes",
                                                        "dimension_names",
                                                        "storage_transformers",
                                                        "consolidated_metadata"};
  for (const auto& item : metadata.items()) {
    const bool is_known =
        std::find(kKnown.begin(), kKnown.end(), absl::string_view(item.key())) != kKnown.end();
    const ZarrJson* const must = MemberOf(item.value(), "must_understand");
    if (!is_known && (must == nullptr || *must != false)) {
      return absl::InvalidArgumentError(
          absl::StrFormat("%s: the extension %s is unknown: write the array without it", name,
                          ShownJson(item.key())));
    }
  }
  const ZarrJson* const transformers = MemberOf(metadata, "storage_transformers");
  return transformers == nullptr || transformers->empty()
             ? absl::OkStatus()
             : BadMember(name, "storage_transformers", transformers, "none");
}

}  // namespace

std::string ZarrArray::KeyOf(const ChunkIndex& chunk) const {
  const std::string separator_text(1, separator);
  std::string key = absl::StrJoin(chunk, separator_text);
  if (has_key_prefix) {
    key = key.empty() ? "c" : absl::StrCat("c", separator_text, key);
  } else if (key.empty()) {
    key = "0";
  }
  return path.empty() ? key : absl::StrCat(path, "/", key);
}

StoredArraySpec ZarrArray::SpecOf(const std::string& name) const {
  return {.name = name,
          .dims = dims,
          .chunk_dims = chunk_dims,
          .type = type,
          .fill = fill,
          .codecs = codecs,
          .key_of = [keys = ZarrArray{.path = path,
                                      .has_key_prefix = has_key_prefix,
                                      .separator = separator}](const ChunkIndex& chunk) {
            return keys.KeyOf(chunk);
          }};
}

absl::StatusOr<ZarrArray> ParseZarr2Array(const ZarrJson& metadata, const ZarrJson& attributes,
                                          const std::string& path, const std::string& name) {
  ISOSCOPE_RETURN_IF_ERROR(CheckZarrVersion(metadata, 2, name));
  ZarrArray array{.path = path};
  if (attributes.is_object()) {
    array.attributes = attributes;
  }
  ISOSCOPE_ASSIGN_OR_RETURN(array.dims, SizesIn(metadata, "shape", name));
  ISOSCOPE_ASSIGN_OR_RETURN(array.chunk_dims, SizesIn(metadata, "chunks", name));
  const ZarrJson* const dtype = MemberOf(metadata, "dtype");
  if (dtype == nullptr || !dtype->is_string()) {
    return BadMember(name, "dtype", dtype, "one type of numbers, such as \"<u2\"");
  }
  const std::string& type_text = dtype->get_ref<const std::string&>();
  auto time = NumpyTimeOf(type_text);
  if (!time.ok()) {
    return absl::InvalidArgumentError(absl::StrCat(name, ": ", time.status().message()));
  }
  array.time = *std::move(time);
  const auto number = array.time.has_value() ? StoredNumber{.type = NumberType::kInt64,
                                                            .is_big_endian = type_text[0] == '>'}
                                             : ParseNumpyType(type_text);
  if (!number.ok()) {
    return absl::InvalidArgumentError(absl::StrCat(name, ": ", number.status().message()));
  }
  array.type = number->type;
  const ZarrJson fill = Zarr2Fill(MemberOf(metadata, "fill_value"));
  ISOSCOPE_RETURN_IF_ERROR(TakeFill(&fill, name, &array));
  ISOSCOPE_ASSIGN_OR_RETURN(array.separator,
                            SeparatorIn(metadata, "dimension_separator", '.', name));
  const ZarrJson* const order = MemberOf(metadata, "order");
  if (order == nullptr || (*order != "C" && *order != "F")) {
    return BadMember(name, "order", order, "\"C\" or \"F\"");
  }
  if (*order == "F") {
    array.codecs.push_back({.name = "transpose", .configuration = {{"order", "F"}}});
  }
  array.codecs.push_back(
      {.name = "bytes", .configuration = {{"endian", number->is_big_endian ? "big" : "little"}}});
  const ZarrJson* const filters = MemberOf(metadata, "filters");
  if (filters != nullptr && !filters->is_null() && !filters->is_array()) {
    return BadMember(name, "filters", filters, "a list");
  }
  for (std::size_t i = 0; filters != nullptr && filters->is_array() && i < filters->size(); ++i) {
    ISOSCOPE_ASSIGN_OR_RETURN(CodecSpec spec, Zarr2Codec((*filters)[i], "filters", name));
    array.codecs.push_back(std::move(spec));
  }
  if (const ZarrJson* const compressor = MemberOf(metadata, "compressor");
      compressor != nullptr && !compressor->is_null()) {
    ISOSCOPE_ASSIGN_OR_RETURN(CodecSpec spec, Zarr2Codec(*compressor, "compressor", name));
    array.codecs.push_back(std::move(spec));
  }
  array.dimension_names =
      NamesOfAxes(MemberOf(array.attributes, "_ARRAY_DIMENSIONS"), array.dims.size());
  return array;
}

absl::StatusOr<ZarrArray> ParseZarr3Array(const ZarrJson& metadata, const std::string& path,
                                          const std::string& name) {
  ISOSCOPE_RETURN_IF_ERROR(CheckZarrVersion(metadata, 3, name));
  ISOSCOPE_RETURN_IF_ERROR(CheckZarr3Members(metadata, name));
  ZarrArray array{.path = path};
  if (const ZarrJson* const attributes = MemberOf(metadata, "attributes");
      attributes != nullptr && attributes->is_object()) {
    array.attributes = *attributes;
  }
  ISOSCOPE_ASSIGN_OR_RETURN(array.dims, SizesIn(metadata, "shape", name));
  // 1. The type.
  ISOSCOPE_ASSIGN_OR_RETURN(const ZarrExtension type, ExtensionIn(metadata, "data_type", name));
  const bool is_date = type.name == "numpy.datetime64";
  if (is_date || type.name == "numpy.timedelta64") {
    auto time = Zarr3TimeOf(type.configuration, is_date);
    if (!time.ok()) {
      return absl::InvalidArgumentError(absl::StrCat(name, ": ", time.status().message()));
    }
    array.time = *std::move(time);
  }
  const auto number = array.time.has_value() ? NumberType::kInt64 : NumberTypeFromName(type.name);
  if (!number.has_value()) {
    return BadMember(name, "data_type", MemberOf(metadata, "data_type"),
                     "bool, integers of 8 to 64 bits or floats of 16 to 64 bits");
  }
  array.type = *number;
  const ZarrJson* const fill = MemberOf(metadata, "fill_value");
  if (fill == nullptr) {
    return BadMember(name, "fill_value", fill, "a number");
  }
  ISOSCOPE_RETURN_IF_ERROR(TakeFill(fill, name, &array));
  // 2. The chunks and their keys.
  ISOSCOPE_ASSIGN_OR_RETURN(const ZarrExtension grid, ExtensionIn(metadata, "chunk_grid", name));
  if (grid.name != "regular") {
    return BadMember(name, "chunk_grid", MemberOf(metadata, "chunk_grid"), "\"regular\"");
  }
  ISOSCOPE_ASSIGN_OR_RETURN(array.chunk_dims, SizesIn(grid.configuration, "chunk_shape", name));
  ISOSCOPE_ASSIGN_OR_RETURN(const ZarrExtension keys,
                            ExtensionIn(metadata, "chunk_key_encoding", name));
  if (keys.name != "default" && keys.name != "v2") {
    return BadMember(name, "chunk_key_encoding", MemberOf(metadata, "chunk_key_encoding"),
                     "\"default\" or \"v2\"");
  }
  array.has_key_prefix = keys.name == "default";
  ISOSCOPE_ASSIGN_OR_RETURN(array.separator, SeparatorIn(keys.configuration, "separator",
                                                         array.has_key_prefix ? '/' : '.', name));
  // 3. The codecs.
  const ZarrJson* const codecs = MemberOf(metadata, "codecs");
  auto specs = codecs == nullptr
                   ? absl::InvalidArgumentError(
                         "its codecs are missing: it is a draft of Zarr 3; write it again")
                   : CodecSpecsFrom(*codecs);
  if (!specs.ok()) {
    return absl::InvalidArgumentError(absl::StrCat(name, ": ", specs.status().message()));
  }
  array.codecs = *std::move(specs);
  array.dimension_names = NamesOfAxes(MemberOf(metadata, "dimension_names"), array.dims.size());
  return array;
}

}  // namespace isoscope::source
