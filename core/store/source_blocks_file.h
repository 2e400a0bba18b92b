// The blocks.bin of a shard whose samples lie in the source: nothing is on the disk, and blocks are
// read when their bytes are asked for. Internal to core/store.

#ifndef ISOSCOPE_CORE_STORE_SOURCE_BLOCKS_FILE_H_
#define ISOSCOPE_CORE_STORE_SOURCE_BLOCKS_FILE_H_

#include <cstdint>
#include <functional>
#include <memory>
#include <string>

#include "core/base/cancellation.h"
#include "core/io/file.h"
#include "core/store/sample_reader.h"
#include "core/volume/block_layout.h"

namespace isoscope::store {

// The place of a block in the file.
struct BlockPlace {
  volume::BlockId block_id = 0;
  std::int64_t offset = 0;
  std::int64_t size = 0;
};

// find:         returns the block that has the byte at an offset in [0, size_bytes); thread-safe
// cancellation: ends reads; outlives the file. Null: nothing does
std::unique_ptr<io::RandomAccessFile> MakeSourceBlocksFile(
    std::string path, std::int64_t size_bytes, std::shared_ptr<const SampleReader> samples,
    std::function<BlockPlace(std::int64_t offset)> find,
    const base::Cancellation* cancellation = nullptr);

}  // namespace isoscope::store

#endif  // ISOSCOPE_CORE_STORE_SOURCE_BLOCKS_FILE_H_
