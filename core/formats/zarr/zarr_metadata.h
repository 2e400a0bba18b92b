// The metadata of one array of Zarr 2 (.zarray, .zattrs) or Zarr 3 (zarr.json).

#ifndef ISOSCOPE_CORE_FORMATS_ZARR_ZARR_METADATA_H_
#define ISOSCOPE_CORE_FORMATS_ZARR_ZARR_METADATA_H_

#include <optional>
#include <string>
#include <vector>

#include "absl/status/statusor.h"

#include "core/formats/zarr/zarr_json.h"
#include "core/source/chunks/chunk_box.h"
#include "core/source/chunks/chunk_codec.h"
#include "core/source/chunks/number_type.h"
#include "core/source/chunks/stored_array.h"

namespace isoscope::source {

// Times of NumPy (datetime64, timedelta64): times are stored * multiple / divisor, the least int64
// is none.
struct ZarrTime {
  std::string units{};  // of CF: "seconds since 1970-01-01", "days"
  double multiple = 1;
  double divisor = 1;
};

struct ZarrArray {
  std::string path{};  // in its store; "" if the store is the array
  ChunkIndex dims{};
  ChunkIndex chunk_dims{};  // of an object
  NumberType type = NumberType::kUint8;
  std::optional<ZarrTime> time{};  // of an array of times, whose type is kInt64: no volume
  std::string fill{};              // the bytes of one number
  bool has_fill = false;           // else the file leaves it open: zeros
  std::vector<CodecSpec> codecs{};
  bool has_key_prefix = false;  // "c/0/0", else "0/0"
  char separator = '/';
  std::vector<std::string> dimension_names{};  // one for each axis, "" without a name; or none
  ZarrJson attributes = ZarrJson::object();

  // The key of a chunk in the store.
  [[nodiscard]] std::string KeyOf(const ChunkIndex& chunk) const;
  // What reads it; `name` is for messages.
  [[nodiscard]] StoredArraySpec SpecOf(const std::string& name) const;
};

// `name` is for messages. INVALID_ARGUMENT, by name: whatever is missing, makes no sense or is
// unknown: types, kinds of chunks, keys and other extensions. Codecs are checked when the array is
// opened, and sizes, too.
absl::StatusOr<ZarrArray> ParseZarr2Array(const ZarrJson& metadata, const ZarrJson& attributes,
                                          const std::string& path, const std::string& name);
absl::StatusOr<ZarrArray> ParseZarr3Array(const ZarrJson& metadata, const std::string& path,
                                          const std::string& name);

}  // namespace isoscope::source

#endif  // ISOSCOPE_CORE_FORMATS_ZARR_ZARR_METADATA_H_
