// Where the samples of a dataset lie in its file, so that they can be read without the library. The
// child process lists it in texts, and the parent checks the texts.

#ifndef ISOSCOPE_CORE_FORMATS_HDF5_HDF5_CHUNK_TABLE_H_
#define ISOSCOPE_CORE_FORMATS_HDF5_HDF5_CHUNK_TABLE_H_

#include <array>
#include <cstddef>
#include <cstdint>
#include <string>
#include <vector>

#include "absl/status/status.h"
#include "absl/status/statusor.h"
#include "absl/strings/string_view.h"

#include "core/formats/hdf5/hdf5_dataset.h"
#include "core/formats/hdf5/hdf5_types.h"
#include "core/math/vec.h"
#include "core/source/chunks/chunk_box.h"
#include "core/source/chunks/number_type.h"
#include "core/source/grid/axis_order.h"

namespace isoscope::source {

// A table takes 16 bytes a chunk.
inline constexpr std::int64_t kMaxHdf5Chunks = std::int64_t{1} << 22;

enum class Hdf5Storage {
  kChunks,  // as the members of a table say
  kPlain,   // all elements of the dataset, from plain_offset on
  kOther,   // only the library can read it
};

// The bytes of a chunk; size 0: it was never written.
struct Hdf5TableChunk {
  std::int64_t offset = 0;
  std::uint32_t size = 0;
  std::uint32_t skipped_filters = 0;  // bit i: the i-th filter was left out

  friend bool operator==(const Hdf5TableChunk&, const Hdf5TableChunk&) = default;
};

// A filter of chunks, in the order of writing.
struct Hdf5TableFilter {
  std::int64_t id = 0;
  std::vector<std::int64_t> values{};  // its parameters

  friend bool operator==(const Hdf5TableFilter&, const Hdf5TableFilter&) = default;
};

struct Hdf5ChunkTable {
  Hdf5Storage layout = Hdf5Storage::kOther;
  std::string file{};                  // that has the bytes
  ChunkIndex dims{};                   // of the dataset, slowest first
  ChunkIndex chunk_dims{};             // of kChunks, and of kOther if it has chunks; else empty
  std::array<std::size_t, 3> space{};  // its axes z, y and x
  ChunkIndex start{};                  // the index on all other axes; 0 on those of space
  StoredNumber type{};
  std::string fill{};  // little-endian: what chunks have that were never written
  std::int64_t plain_offset = 0;
  std::vector<Hdf5TableFilter> filters{};
  // Of the volume alone, in C order: z slowest.
  std::vector<Hdf5TableChunk> chunks{};

  // Chunks along z, y and x.
  [[nodiscard]] std::array<std::int64_t, 3> counts() const;
};

// For the child: texts of the volume at a step and a component, none of them empty, from chunk
// number `first` on; the first ones have all else, too. INVALID_ARGUMENT: more than kMaxHdf5Chunks.
// DATA_LOSS: as Hdf5ChunkFinder. REQUIRES: as OpenHdf5Volume.
absl::StatusOr<std::vector<std::string>> ListHdf5Chunks(const NamedHdf5Dataset& named,
                                                        const Hdf5SampleType& type,
                                                        const AxisOrder& axes, std::int64_t step,
                                                        std::int64_t component, std::int64_t first);

// For the parent: adds such texts to `table`, which has what texts before them say. Returns false if
// they make no sense. Bounded in memory by what the texts have. `*is_complete`: no chunk is missing.
bool AddHdf5Chunks(const std::vector<std::string>& texts, Hdf5ChunkTable* table, bool* is_complete);

}  // namespace isoscope::source

#endif  // ISOSCOPE_CORE_FORMATS_HDF5_HDF5_CHUNK_TABLE_H_
