#include "core/synthetic/generated_file.h"

#include <algorithm>
#include <atomic>
#include <cstddef>
#include <filesystem>
#include <system_error>
#include <vector>

#include "absl/strings/str_cat.h"
#include "absl/strings/str_format.h"
#include "oneapi/tbb/parallel_pipeline.h"
#include "oneapi/tbb/task_arena.h"

#include "core/base/status_macros.h"
#include "core/base/units.h"
#include "core/io/file.h"

namespace isoscope::source {
namespace {

constexpr std::int64_t kChunkBytes = 2 * base::kMiB;

}  // namespace

absl::Status AppendRows(const RowSource& rows,
                        absl::FunctionRef<absl::Status(absl::string_view)> append,
                        const base::Cancellation& cancellation) {
  const std::int64_t chunk_rows = std::max<std::int64_t>(kChunkBytes / rows.row_bytes / 4 * 4, 4);
  const auto tokens = 2 * static_cast<std::size_t>(tbb::this_task_arena::max_concurrency());

  struct Chunk {
    std::int64_t begin = 0;
    std::int64_t end = 0;
    std::string bytes;
  };
  // As many as are under way at once: a chunk's buffer is free again when it was written.
  std::vector<Chunk> chunks(tokens);
  std::size_t next_chunk = 0;
  std::int64_t next_row = 0;
  absl::Status status;  // the reading filter's and the writing filter's, which exclude each other
  std::atomic<bool> is_stopped{false};

  const auto take = [&](tbb::flow_control& control) -> Chunk* {
    if (next_row >= rows.row_count || is_stopped || cancellation.is_cancelled()) {
      control.stop();
      return nullptr;
    }
    Chunk& chunk = chunks[next_chunk];
    next_chunk = (next_chunk + 1) % chunks.size();
    chunk.begin = next_row;
    chunk.end = next_row = std::min(next_row + chunk_rows, rows.row_count);
    return &chunk;
  };
  const auto fill = [&](Chunk* chunk) {
    chunk->bytes.resize(static_cast<std::size_t>((chunk->end - chunk->begin) * rows.row_bytes));
    rows.fill(chunk->begin, chunk->end, chunk->bytes.data());
    return chunk;
  };
  const auto write = [&](const Chunk* chunk) {
    if (!is_stopped) {
      status = append(chunk->bytes);
      is_stopped = !status.ok();
    }
  };
  tbb::parallel_pipeline(
      tokens, tbb::make_filter<void, Chunk*>(tbb::filter_mode::serial_in_order, take) &
                  tbb::make_filter<Chunk*, Chunk*>(tbb::filter_mode::parallel, fill) &
                  tbb::make_filter<Chunk*, void>(tbb::filter_mode::serial_in_order, write));
  ISOSCOPE_RETURN_IF_ERROR(status);
  return cancellation.Check();
}

absl::Status CheckFreeSpace(const std::string& path, std::int64_t bytes,
                            const std::string& advice) {
  std::filesystem::path parent = std::filesystem::path(path).parent_path();
  std::error_code error;
  const std::filesystem::space_info space =
      std::filesystem::space(parent.empty() ? "." : parent, error);
  if (!error && space.available < static_cast<std::uintmax_t>(bytes)) {
    return absl::ResourceExhaustedError(
        absl::StrFormat("%s: needs %d bytes, its file system has %d left: %s", path, bytes,
                        space.available, advice));
  }
  return absl::OkStatus();
}

absl::Status CheckNoFolder(const std::string& path) {
  return io::IsDirectory(path) ? absl::FailedPreconditionError(absl::StrCat(
                                     path, ": is a folder; expected the name of a file"))
                               : absl::OkStatus();
}

}  // namespace isoscope::source
