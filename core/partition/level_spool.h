// The samples of a level while they are made: a scratch file that the volume below fills on its way
// through memory, and that is then partitioned as a volume of its own.

#ifndef ISOSCOPE_CORE_PARTITION_LEVEL_SPOOL_H_
#define ISOSCOPE_CORE_PARTITION_LEVEL_SPOOL_H_

#include <cstdint>
#include <memory>
#include <string>
#include <vector>

#include "absl/status/status.h"
#include "absl/status/statusor.h"

#include "core/io/scratch_file.h"
#include "core/partition/block_cutter.h"
#include "core/partition/partition_plan.h"
#include "core/source/volume_source.h"
#include "core/volume/block_layout.h"
#include "core/volume/scalar_type.h"
#include "core/volume/volume_level.h"

namespace isoscope::partition {

// Thread-compatible; works on many threads.
class LevelSpool {
 public:
  // Creates the scratch file in `directory`, which exists.
  //
  // level:      what is made; index >= 1
  // below_type: sample type of the level below
  static absl::StatusOr<std::unique_ptr<LevelSpool>> Create(const std::string& directory,
                                                            const volume::VolumeLevel& level,
                                                            volume::ScalarType below_type,
                                                            volume::LevelFilter filter);
  // Returns the memory that a spool of this level takes.
  static std::int64_t MemoryBytes(const volume::VolumeLevel& level);

  // Makes the samples that begin in a portion of the level below, whose layout is given. Each is
  // made in one portion alone, whose slab has all samples that it needs: blocks store ghosts.
  absl::Status Add(const volume::BlockLayout& layout, const Slab& slab, const Portion& portion);

  // Takes whole rows as they are, row = z * ny + y: those that another process has made of its part
  // of the level below (part_writer.h).
  absl::Status AddRows(std::int64_t begin_row, const char* samples, std::int64_t row_count);
  // Returns the planes that Add makes of these layers of the level below.
  [[nodiscard]] LayerRange PlanesOf(const volume::BlockLayout& layout,
                                    const LayerRange& layers) const;

  // Returns the samples as a source, once all portions were added. The spool must outlive it.
  // name: for messages
  [[nodiscard]] std::unique_ptr<source::VolumeSource> MakeSource(const std::string& name) const;

  [[nodiscard]] const volume::VolumeLevel& level() const { return level_; }

 private:
  LevelSpool(const volume::VolumeLevel& level, volume::ScalarType below_type,
             volume::LevelFilter filter, std::unique_ptr<io::ScratchFile> file);

  // A slab of the level below, and its rows.
  struct Below {
    const Slab& slab;
    std::int64_t width = 0;  // samples of a row
    std::int64_t rows = 0;   // of each plane in the slab
  };
  // Samples [begin, end) of a row, of rows [begin_y, end_y) of plane z of the level.
  struct Piece {
    std::int64_t z = 0;
    std::int64_t begin_y = 0;
    std::int64_t end_y = 0;
    std::int64_t begin_x = 0;
    std::int64_t end_x = 0;
  };
  // Makes a piece that fits the buffer, and writes it. A piece of several rows has whole ones.
  absl::Status AddPiece(const Below& below, const Piece& piece);

  const volume::VolumeLevel level_;
  const volume::ScalarType below_type_;
  const volume::LevelFilter filter_;
  const std::unique_ptr<io::ScratchFile> file_;
  std::vector<char> buffer_;
};

}  // namespace isoscope::partition

#endif  // ISOSCOPE_CORE_PARTITION_LEVEL_SPOOL_H_
