#include "core/store/source_blocks_file.h"

#include <algorithm>
#include <cstddef>
#include <utility>

#include "core/base/process_interrupt.h"
#include "core/base/status_macros.h"

namespace isoscope::store {
namespace {

class SourceBlocksFile final : public io::RandomAccessFile {
 public:
  SourceBlocksFile(std::string path, std::int64_t size_bytes, SourceBlocks blocks,
                   const base::Cancellation* cancellation)
      : path_(std::move(path)),
        size_bytes_(size_bytes),
        blocks_(std::move(blocks)),
        cancellation_(cancellation) {}

  [[nodiscard]] absl::Status ReadAt(std::int64_t offset, std::size_t size,
                                    char* out) const override {
    ISOSCOPE_RETURN_IF_ERROR(io::CheckRange(*this, offset, size));
    const std::int64_t end = offset + static_cast<std::int64_t>(size);
    std::string whole;  // of a block of which a part is wanted
    const base::Cancellation& ends =
        cancellation_ == nullptr ? base::ProcessInterrupt() : *cancellation_;
    while (offset < end) {
      const BlockPlace block = blocks_.find(offset);
      const std::int64_t begin = offset - block.offset;
      const std::int64_t count = std::min(end - offset, block.size - begin);
      const bool is_whole = count == block.size;
      if (!is_whole) {
        whole.resize(static_cast<std::size_t>(block.size));
      }
      ISOSCOPE_RETURN_IF_ERROR(blocks_.read(block.ordinal, ends, is_whole ? out : whole.data()));
      if (!is_whole) {
        std::copy_n(whole.data() + begin, count, out);
      }
      out += count;
      offset += count;
    }
    return absl::OkStatus();
  }
  // A near source is read by the threads that compute, because decoding is most of the work.
  [[nodiscard]] std::size_t ReadCached(std::int64_t offset, std::size_t size,
                                       char* out) const override {
    return blocks_.is_local && ReadAt(offset, size, out).ok() ? size : 0;
  }
  [[nodiscard]] std::int64_t size_bytes() const override { return size_bytes_; }
  [[nodiscard]] const std::string& path() const override { return path_; }

 private:
  const std::string path_;
  const std::int64_t size_bytes_;
  const SourceBlocks blocks_;
  const base::Cancellation* const cancellation_;
};

}  // namespace

std::unique_ptr<io::RandomAccessFile> MakeSourceBlocksFile(std::string path,
                                                           std::int64_t size_bytes,
                                                           SourceBlocks blocks,
                                                           const base::Cancellation* cancellation) {
  return std::make_unique<SourceBlocksFile>(std::move(path), size_bytes, std::move(blocks),
                                            cancellation);
}

}  // namespace isoscope::store
