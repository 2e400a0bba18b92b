// The raw blocks of a shard whose samples lie in the source, one behind the other, as a file. They are
// made when their bytes are asked for. Internal to core/store.

#ifndef ISOSCOPE_CORE_STORE_SOURCE_BLOCKS_FILE_H_
#define ISOSCOPE_CORE_STORE_SOURCE_BLOCKS_FILE_H_

#include <cstdint>
#include <functional>
#include <memory>
#include <string>

#include "absl/status/status.h"

#include "core/base/cancellation.h"
#include "core/io/file.h"

namespace isoscope::store {

// The place of a block in the file.
struct BlockPlace {
  std::uint32_t ordinal = 0;
  std::int64_t offset = 0;
  std::int64_t size = 0;
};

// What a file of blocks is made of. Both are thread-safe.
struct SourceBlocks {
  // Returns the block that has the byte at an offset in [0, size_bytes).
  std::function<BlockPlace(std::int64_t offset)> find;
  // Writes the samples of a block. Its errors say which block.
  std::function<absl::Status(std::uint32_t ordinal, const base::Cancellation&, char* out)> read;
  // Whether a thread that computes may read.
  bool is_local = false;
};

// cancellation: ends reads; outlives the file. Null: the process's interrupt does
std::unique_ptr<io::RandomAccessFile> MakeSourceBlocksFile(
    std::string path, std::int64_t size_bytes, SourceBlocks blocks,
    const base::Cancellation* cancellation = nullptr);

}  // namespace isoscope::store

#endif  // ISOSCOPE_CORE_STORE_SOURCE_BLOCKS_FILE_H_
