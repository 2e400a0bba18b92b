// Small stores of Zarr 2 and 3: texts of metadata and chunks, as objects.

#ifndef ISOSCOPE_TESTS_UNIT_CORE_FORMATS_ZARR_ZARR_FILES_H_
#define ISOSCOPE_TESTS_UNIT_CORE_FORMATS_ZARR_ZARR_FILES_H_

#include <cstring>
#include <map>
#include <memory>
#include <set>
#include <string>
#include <vector>

#include "absl/strings/match.h"
#include "absl/strings/str_cat.h"
#include "absl/strings/str_join.h"

#include "core/base/coding.h"
#include "core/formats/zarr/zarr_metadata.h"
#include "core/formats/zarr/zarr_series.h"
#include "core/formats/zarr/zarr_store.h"
#include "tests/support/chunk_writer.h"
#include "tests/support/memory_store.h"
#include "tests/support/volume_files.h"

namespace isoscope::testing {

using Objects = std::map<std::string, std::string>;

inline std::string Sizes(const source::ChunkIndex& sizes) {
  return absl::StrCat("[", absl::StrJoin(sizes, ", "), "]");
}

// `more` are further members, with a comma in front.
inline std::string Zarr2Text(const source::ChunkIndex& shape, const source::ChunkIndex& chunks,
                             const std::string& dtype, const std::string& more = "") {
  return absl::StrCat("{\"zarr_format\": 2, \"shape\": ", Sizes(shape),
                      ", \"chunks\": ", Sizes(chunks), ", \"dtype\": \"", dtype, "\"",
                      absl::StrContains(more, "\"order\"") ? "" : ", \"order\": \"C\"",
                      absl::StrContains(more, "\"compressor\"") ? "" : ", \"compressor\": null",
                      absl::StrContains(more, "\"fill_value\"") ? "" : ", \"fill_value\": 0",
                      absl::StrContains(more, "\"filters\"") ? "" : ", \"filters\": null", more,
                      "}");
}
inline std::string Zarr3Text(
    const source::ChunkIndex& shape, const source::ChunkIndex& chunks, const std::string& type,
    const std::string& more = "",
    const std::string& codecs = R"([{"name": "bytes", "configuration": {"endian": "little"}}])") {
  return absl::StrCat("{\"zarr_format\": 3, \"node_type\": \"array\", \"shape\": ", Sizes(shape),
                      R"(, "chunk_grid": {"name": "regular", "configuration": {"chunk_shape": )",
                      Sizes(chunks), "}}, \"data_type\": \"", type, "\", \"codecs\": ", codecs,
                      absl::StrContains(more, "chunk_key_encoding")
                          ? ""
                          : R"(, "chunk_key_encoding": {"name": "default"})",
                      absl::StrContains(more, "\"fill_value\"") ? "" : ", \"fill_value\": 0", more,
                      "}");
}
inline std::string Zarr3Group(const std::string& attributes = "{}") {
  return absl::StrCat(R"({"zarr_format": 3, "node_type": "group", "attributes": )", attributes,
                      "}");
}

// The chunks of an array by keys of Zarr 2, or of Zarr 3 ("c/...").
inline void AddChunks(const std::string& path, const PlainArray& array,
                      const WrittenChunks& written, bool is_v3, Objects* objects) {
  source::ZarrArray keys;
  keys.path = path;
  keys.has_key_prefix = is_v3;
  keys.separator = is_v3 ? '/' : '.';
  for (auto& [key, bytes] :
       WriteChunks(array, written, [&](const source::ChunkIndex& i) { return keys.KeyOf(i); })) {
    (*objects)[key] = bytes;
  }
}

template <typename T>
std::string NumberText(const std::vector<T>& values) {
  std::string bytes;
  for (const T value : values) {
    base::AppendLittleEndian(value, &bytes);
  }
  return bytes;
}

// A store that can be listed.
inline absl::StatusOr<std::unique_ptr<source::ZarrStore>> OpenObjects(const Objects& objects,
                                                                      bool is_listed = true) {
  source::ZarrStore::List list;
  if (is_listed) {
    list = [objects](const std::string& path) -> absl::StatusOr<std::vector<std::string>> {
      const std::string prefix = path.empty() ? "" : absl::StrCat(path, "/");
      std::set<std::string> names;
      for (const auto& [key, bytes] : objects) {
        if (absl::StartsWith(key, prefix)) {
          names.insert(key.substr(prefix.size(), key.find('/', prefix.size()) - prefix.size()));
        }
      }
      return std::vector<std::string>(names.begin(), names.end());
    };
  }
  return source::ZarrStore::Open(std::make_shared<const MemoryStore>(objects), std::move(list));
}

inline absl::StatusOr<std::unique_ptr<source::VolumeSeries>> OpenSeries(
    const Objects& objects, const std::string& part = "", const std::string& axes = "",
    const source::GridRules& rules = {}) {
  auto store = OpenObjects(objects);
  return store.ok() ? source::OpenZarrSeries(*std::move(store), part, axes, rules) : store.status();
}

template <typename T>
std::vector<T> NumbersIn(const std::string& bytes) {
  std::vector<T> values(bytes.size() / sizeof(T));
  std::memcpy(values.data(), bytes.data(), values.size() * sizeof(T));
  return values;
}

}  // namespace isoscope::testing

#endif  // ISOSCOPE_TESTS_UNIT_CORE_FORMATS_ZARR_ZARR_FILES_H_
