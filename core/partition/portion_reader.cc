// Neighbouring portions store three planes in common: the shared layer, and a ghost on each side of
// it.
//
// Example: blocks of 8 cells, one layer a portion. Portion 0 stores planes 0 to 9, portion 1 planes
// 7 to 17: planes 7 to 9 are moved to the front, 10 to 17 are read. Staged bands of the same layers
// need a ring of 8 + 3 = 11 planes: planes 11 to 17 replace 0 to 6 in it, and 7 to 10 stay.

#include "core/partition/portion_reader.h"

#include <algorithm>
#include <array>
#include <cstddef>
#include <cstring>
#include <utility>
#include <vector>

#include "oneapi/tbb/task_group.h"

#include "core/base/status_macros.h"
#include "core/base/units.h"

namespace isoscope::partition {
namespace {

// Bytes read between two checks of the cancellation.
constexpr std::int64_t kReadBytes = 8 * base::kMiB;
// Bytes in memory at a time on the way to the scratch file.
constexpr std::int64_t kStageBytes = base::kMiB;

}  // namespace

PortionReader::PortionReader(source::VolumeSource* source, const volume::BlockLayout& layout,
                             const PartitionPlan& plan, std::string directory,
                             const base::Cancellation* cancellation)
    : source_(*source),
      layout_(layout),
      plan_(plan),
      directory_(std::move(directory)),
      cancellation_(*cancellation),
      reads_(source, *cancellation),
      row_bytes_(source->info().row_bytes()) {}

std::int64_t PortionReader::StagingBytes(const source::VolumeSource& source) {
  const std::int64_t row_bytes = source.info().row_bytes();
  return std::min(std::max(kStageBytes, row_bytes),
                  row_bytes * source.info().geometry.sample_dims.y);
}

absl::Status PortionReader::Read(std::int64_t i, const char* previous, char* out) {
  const math::IndexBox box = SamplesOfPortion(layout_, PortionAt(layout_, plan_, i));
  if (!plan_.has_whole_planes(layout_)) {
    return ReadBand(box, out);
  }
  const std::int64_t plane_bytes = row_bytes_ * layout_.sample_dims().y;
  std::int64_t begin = box.begin.z;
  if (previous != nullptr) {
    const math::IndexBox before = SamplesOfPortion(layout_, PortionAt(layout_, plan_, i - 1));
    const std::int64_t kept = std::max<std::int64_t>(before.end.z - begin, 0);
    std::memmove(out, previous + (before.end.z - kept - before.begin.z) * plane_bytes,
                 static_cast<std::size_t>(kept * plane_bytes));
    begin += kept;
  }
  return ReadPlanes(begin, box.end.z, out + (begin - box.begin.z) * plane_bytes);
}

absl::Status PortionReader::ForEachPortion(
    const PortionRange& portions,
    absl::FunctionRef<absl::Status(const Slab&, const Portion&)> visit,
    absl::FunctionRef<void(double)> report) {
  if (portions.begin == portions.end) {
    return absl::OkStatus();
  }
  const std::size_t buffer_count = plan_.is_double_buffered ? 2 : 1;
  std::array<std::vector<char>, 2> buffers;
  for (std::size_t buffer = 0; buffer < buffer_count; ++buffer) {
    buffers[buffer].resize(static_cast<std::size_t>(plan_.portion_bytes));
  }
  // Planes before the first portion are not staged.
  staged_end_ = SamplesOfPortion(layout_, PortionAt(layout_, plan_, portions.begin)).begin.z;
  ISOSCOPE_RETURN_IF_ERROR(
      Read(portions.begin, nullptr,
           buffers[static_cast<std::size_t>(portions.begin) % buffer_count].data()));
  for (std::int64_t i = portions.begin; i < portions.end; ++i) {
    const char* current = buffers[static_cast<std::size_t>(i) % buffer_count].data();
    char* next = buffers[static_cast<std::size_t>(i + 1) % buffer_count].data();
    absl::Status read;
    const auto read_next = [&] { read = Read(i + 1, current, next); };
    const Portion portion = PortionAt(layout_, plan_, i);
    const math::IndexBox box = SamplesOfPortion(layout_, portion);
    const Slab slab{.samples = current,
                    .begin_z = box.begin.z,
                    .begin_y = box.begin.y,
                    .rows = box.end.y - box.begin.y};
    absl::Status visited;
    {
      tbb::task_group ahead;
      if (buffer_count > 1 && i + 1 < portions.end) {
        ahead.run(read_next);
      }
      visited = visit(slab, portion);
      ahead.wait();
    }
    ISOSCOPE_RETURN_IF_ERROR(visited);
    if (buffer_count == 1 && i + 1 < portions.end) {
      read_next();
    }
    ISOSCOPE_RETURN_IF_ERROR(read);
    ISOSCOPE_RETURN_IF_ERROR(cancellation_.Check());
    report(static_cast<double>(i + 1 - portions.begin) /
           static_cast<double>(portions.end - portions.begin));
  }
  return absl::OkStatus();
}

std::int64_t PortionReader::LayerEnd(std::int64_t z) const {
  const std::int64_t at_once = source_.info().planes_at_once;
  return (z / at_once + 1) * at_once;
}

absl::Status PortionReader::ReadPlanes(std::int64_t begin, std::int64_t end, char* out) {
  const std::int64_t rows = layout_.sample_dims().y;
  const std::int64_t step = std::max<std::int64_t>(kReadBytes / (row_bytes_ * rows), 1);
  for (std::int64_t z = begin; z < end;) {
    ISOSCOPE_RETURN_IF_ERROR(cancellation_.Check());
    const std::int64_t next = std::min(LayerEnd(z + step - 1), end);
    ISOSCOPE_RETURN_IF_ERROR(source_.ReadRows(z * rows, next * rows, out));
    out += (next - z) * rows * row_bytes_;
    z = next;
  }
  return absl::OkStatus();
}

absl::Status PortionReader::ReadBand(const math::IndexBox& box, char* out) {
  const std::int64_t rows = layout_.sample_dims().y;
  const std::int64_t band_bytes = (box.end.y - box.begin.y) * row_bytes_;
  const bool is_staged = !source_.info().is_seekable;
  if (is_staged) {
    ISOSCOPE_RETURN_IF_ERROR(StageUpTo(box.end.z));
  }
  std::int64_t count = 1;
  for (std::int64_t z = box.begin.z; z < box.end.z; z += count, out += count * band_bytes) {
    ISOSCOPE_RETURN_IF_ERROR(cancellation_.Check());
    if (is_staged) {
      ISOSCOPE_RETURN_IF_ERROR(
          scratch_->ReadAt((z % ring_planes_ * rows + box.begin.y) * row_bytes_,
                           static_cast<std::size_t>(band_bytes), out));
    } else {
      count = std::min(LayerEnd(z), box.end.z) - z;
      ISOSCOPE_RETURN_IF_ERROR(source_.ReadBand(z, z + count, box.begin.y, box.end.y, out));
    }
  }
  return absl::OkStatus();
}

absl::Status PortionReader::StageUpTo(std::int64_t end_plane) {
  if (scratch_ == nullptr) {
    ISOSCOPE_ASSIGN_OR_RETURN(scratch_, io::ScratchFile::Create(directory_));
    ring_planes_ = plan_.layers_per_portion * layout_.block_cells().z + 3;
  }
  if (staged_end_ > end_plane) {
    staged_end_ = 0;  // another pass begins
  }
  const std::int64_t rows = layout_.sample_dims().y;
  const std::int64_t step = std::max<std::int64_t>(kStageBytes / row_bytes_, 1);
  std::vector<char> bytes;
  for (; staged_end_ < end_plane; ++staged_end_) {
    for (std::int64_t y = 0; y < rows; y += step) {
      ISOSCOPE_RETURN_IF_ERROR(cancellation_.Check());
      const std::int64_t count = std::min(step, rows - y);
      bytes.resize(static_cast<std::size_t>(count * row_bytes_));
      ISOSCOPE_RETURN_IF_ERROR(
          source_.ReadRows(staged_end_ * rows + y, staged_end_ * rows + y + count, bytes.data()));
      ISOSCOPE_RETURN_IF_ERROR(scratch_->WriteAt(
          (staged_end_ % ring_planes_ * rows + y) * row_bytes_, bytes.data(), bytes.size()));
    }
  }
  return absl::OkStatus();
}

}  // namespace isoscope::partition
