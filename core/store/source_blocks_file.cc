#include "core/store/source_blocks_file.h"

#include <algorithm>
#include <cstddef>
#include <utility>

#include "absl/strings/str_cat.h"

#include "core/base/status_macros.h"

namespace isoscope::store {
namespace {

class SourceBlocksFile final : public io::RandomAccessFile {
 public:
  SourceBlocksFile(std::string path, std::int64_t size_bytes,
                   std::shared_ptr<const SampleReader> samples,
                   std::function<BlockPlace(std::int64_t)> find,
                   const base::Cancellation* cancellation)
      : path_(std::move(path)),
        size_bytes_(size_bytes),
        samples_(std::move(samples)),
        find_(std::move(find)),
        cancellation_(cancellation == nullptr ? never_ : *cancellation) {}

  [[nodiscard]] absl::Status ReadAt(std::int64_t offset, std::size_t size,
                                    char* out) const override {
    ISOSCOPE_RETURN_IF_ERROR(io::CheckRange(*this, offset, size));
    const std::int64_t end = offset + static_cast<std::int64_t>(size);
    std::string whole;  // of a block of which a part is wanted
    while (offset < end) {
      const BlockPlace block = find_(offset);
      const std::int64_t begin = offset - block.offset;
      const std::int64_t count = std::min(end - offset, block.size - begin);
      const bool is_whole = count == block.size;
      if (!is_whole) {
        whole.resize(static_cast<std::size_t>(block.size));
      }
      absl::Status status =
          samples_->ReadBlock(block.block_id, cancellation_, is_whole ? out : whole.data());
      if (!status.ok()) {
        return {status.code(),
                absl::StrCat("block ", block.block_id, " of ", path_, ": ", status.message())};
      }
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
    return samples_->is_local() && ReadAt(offset, size, out).ok() ? size : 0;
  }
  [[nodiscard]] std::int64_t size_bytes() const override { return size_bytes_; }
  [[nodiscard]] const std::string& path() const override { return path_; }

 private:
  const std::string path_;
  const std::int64_t size_bytes_;
  const std::shared_ptr<const SampleReader> samples_;
  const std::function<BlockPlace(std::int64_t)> find_;
  const base::Cancellation never_;
  const base::Cancellation& cancellation_;
};

}  // namespace

std::unique_ptr<io::RandomAccessFile> MakeSourceBlocksFile(
    std::string path, std::int64_t size_bytes, std::shared_ptr<const SampleReader> samples,
    std::function<BlockPlace(std::int64_t offset)> find, const base::Cancellation* cancellation) {
  return std::make_unique<SourceBlocksFile>(std::move(path), size_bytes, std::move(samples),
                                            std::move(find), cancellation);
}

}  // namespace isoscope::store
