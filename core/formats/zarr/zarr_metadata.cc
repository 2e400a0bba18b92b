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
#include <utility>

#include "absl/strings/str_cat.h"
#include "absl/strings/str_format.h"
#include "absl/strings/str_join.h"

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

absl::Status TakeFill(const ZarrJson* value, const std::string& name, ZarrArray* array) {
  array->has_fill = value != nullptr && !value->is_null();
  if (!array->has_fill) {
    array->fill = std::string(SizeOf(array->type), '\0');
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
  const auto number = ParseNumpyType(dtype->get_ref<const std::string&>());
  if (!number.ok()) {
    return absl::InvalidArgumentError(absl::StrCat(name, ": ", number.status().message()));
  }
  array.type = number->type;
  ISOSCOPE_RETURN_IF_ERROR(TakeFill(MemberOf(metadata, "fill_value"), name, &array));
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
  const auto number = NumberTypeFromName(type.name);
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
  auto specs = codecs == nullptr ? absl::InvalidArgumentError("its codecs are missing")
                                 : CodecSpecsFrom(*codecs);
  if (!specs.ok()) {
    return absl::InvalidArgumentError(absl::StrCat(name, ": ", specs.status().message()));
  }
  array.codecs = *std::move(specs);
  array.dimension_names = NamesOfAxes(MemberOf(metadata, "dimension_names"), array.dims.size());
  return array;
}

}  // namespace isoscope::source
