// A sample of the level belongs to the portion in which the first of its eight samples below lies
// in a cell. The other seven are at most one further on each axis, so the slab has them.
//
// Example: blocks of 5 cells, one layer a portion. Portion 0 has cells 0 to 4 and makes planes 0,
// 1, 2 of the level, from planes 0 to 5 below; portion 1 has cells 5 to 9, and makes 3 and 4.
//
// Rows are made in pieces that fit the buffer, in parallel, and each piece is written at once.

#include "core/partition/level_spool.h"

#include <algorithm>
#include <array>
#include <cstddef>
#include <utility>

#include "oneapi/tbb/parallel_for.h"

#include "core/base/status_macros.h"
#include "core/base/units.h"

namespace isoscope::partition {
namespace {

constexpr std::int64_t kMaxBufferBytes = base::kMiB;

std::int64_t SampleBytes(const volume::VolumeLevel& level) {
  return static_cast<std::int64_t>(volume::SizeOf(level.type));
}

// The samples whose first one below lies in cells [begin, end) below: at even positions.
struct Range {
  std::int64_t begin = 0;
  std::int64_t end = 0;
};
Range Halved(std::int64_t begin, std::int64_t end, std::int64_t size) {
  return {.begin = std::min((begin + 1) / 2, size), .end = std::min((end + 1) / 2, size)};
}

// The scratch file of a level.
class SpoolSource : public source::VolumeSource {
 public:
  SpoolSource(source::SourceInfo info, const io::ScratchFile* file)
      : VolumeSource(std::move(info)), file_(*file) {}

  absl::Status ReadRows(std::int64_t begin_row, std::int64_t end_row, char* out) override {
    const std::int64_t row_bytes = info().row_bytes();
    return file_.ReadAt(begin_row * row_bytes,
                        static_cast<std::size_t>((end_row - begin_row) * row_bytes), out);
  }

 private:
  const io::ScratchFile& file_;
};

}  // namespace

absl::StatusOr<std::unique_ptr<LevelSpool>> LevelSpool::Create(const std::string& directory,
                                                               const volume::VolumeLevel& level,
                                                               volume::ScalarType below_type,
                                                               volume::LevelFilter filter) {
  ISOSCOPE_ASSIGN_OR_RETURN(std::unique_ptr<io::ScratchFile> file,
                            io::ScratchFile::Create(directory));
  return std::unique_ptr<LevelSpool>(new LevelSpool(level, below_type, filter, std::move(file)));
}

LevelSpool::LevelSpool(const volume::VolumeLevel& level, volume::ScalarType below_type,
                       volume::LevelFilter filter, std::unique_ptr<io::ScratchFile> file)
    : level_(level),
      below_type_(below_type),
      filter_(filter),
      file_(std::move(file)),
      buffer_(static_cast<std::size_t>(MemoryBytes(level))) {}

std::int64_t LevelSpool::MemoryBytes(const volume::VolumeLevel& level) {
  const math::Index3& dims = level.grid.sample_dims;
  return std::min(kMaxBufferBytes, dims.x * dims.y * SampleBytes(level));
}

absl::Status LevelSpool::Add(const volume::BlockLayout& layout, const Slab& slab,
                             const Portion& portion) {
  const math::Index3& dims = level_.grid.sample_dims;
  const math::Index3& cells = layout.block_cells();
  const math::Index3& below_dims = layout.sample_dims();
  const Range planes = Halved(portion.begin_layer * cells.z, portion.end_layer * cells.z, dims.z);
  const Range rows = Halved(portion.begin_row * cells.y, portion.end_row * cells.y, dims.y);
  const Below below{
      .slab = slab, .width = below_dims.x, .rows = slab.rows == 0 ? below_dims.y : slab.rows};
  const std::int64_t buffer_samples =
      static_cast<std::int64_t>(buffer_.size()) / SampleBytes(level_);
  const std::int64_t piece_rows = std::max<std::int64_t>(buffer_samples / dims.x, 1);
  const std::int64_t piece_width = std::min(buffer_samples, dims.x);
  for (std::int64_t z = planes.begin; z < planes.end; ++z) {
    for (std::int64_t y = rows.begin; y < rows.end; y += piece_rows) {
      for (std::int64_t x = 0; x < dims.x; x += piece_width) {
        ISOSCOPE_RETURN_IF_ERROR(AddPiece(below, {.z = z,
                                                  .begin_y = y,
                                                  .end_y = std::min(y + piece_rows, rows.end),
                                                  .begin_x = x,
                                                  .end_x = std::min(x + piece_width, dims.x)}));
      }
    }
  }
  return absl::OkStatus();
}

absl::Status LevelSpool::AddPiece(const Below& below, const Piece& piece) {
  const auto below_size = static_cast<std::int64_t>(volume::SizeOf(below_type_));
  const std::int64_t width = piece.end_x - piece.begin_x;
  const std::int64_t row_bytes = width * SampleBytes(level_);
  const auto row_below = [&](std::int64_t y, std::int64_t z) {
    const std::int64_t row = (z - below.slab.begin_z) * below.rows + y - below.slab.begin_y;
    return below.slab.samples + (row * below.width + 2 * piece.begin_x) * below_size;
  };
  tbb::parallel_for(piece.begin_y, piece.end_y, [&](std::int64_t y) {
    const std::array<const char*, 4> rows = {
        row_below(2 * y, 2 * piece.z), row_below(2 * y + 1, 2 * piece.z),
        row_below(2 * y, 2 * piece.z + 1), row_below(2 * y + 1, 2 * piece.z + 1)};
    volume::ReduceRows(below_type_, level_.type, filter_, rows, static_cast<std::size_t>(width),
                       buffer_.data() + (y - piece.begin_y) * row_bytes);
  });
  const math::Index3& dims = level_.grid.sample_dims;
  const std::int64_t first = (piece.z * dims.y + piece.begin_y) * dims.x + piece.begin_x;
  return file_->WriteAt(first * SampleBytes(level_), buffer_.data(),
                        static_cast<std::size_t>((piece.end_y - piece.begin_y) * row_bytes));
}

absl::Status LevelSpool::AddRows(std::int64_t begin_row, const char* samples,
                                 std::int64_t row_count) {
  const std::int64_t row_bytes = level_.grid.sample_dims.x * SampleBytes(level_);
  return file_->WriteAt(begin_row * row_bytes, samples,
                        static_cast<std::size_t>(row_count * row_bytes));
}

LayerRange LevelSpool::PlanesOf(const volume::BlockLayout& layout, const LayerRange& layers) const {
  const Range planes = Halved(layers.begin * layout.block_cells().z,
                              layers.end * layout.block_cells().z, level_.grid.sample_dims.z);
  return {.begin = planes.begin, .end = planes.end};
}

std::unique_ptr<source::VolumeSource> LevelSpool::MakeSource(const std::string& name) const {
  source::SourceInfo info;
  info.name = name;
  info.geometry = level_.grid;
  info.type = level_.type;
  return std::make_unique<SpoolSource>(std::move(info), file_.get());
}

}  // namespace isoscope::partition
