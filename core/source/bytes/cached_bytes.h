// A file over bytes that are far away: small reads, as headers and directories need them, are served
// from blocks that are kept.
//
//   read of 256 KiB or more   straight from the bytes, pieces at once
//   smaller                   from a block of 64 KiB, which is read once; of all files of the
//                             process together, the 256 that were used last are kept
//   block behind block        more and more blocks with each request, up to 4 MiB: read-ahead; steps of
//                             up to 4 blocks count, too, as those of directories between samples

#ifndef ISOSCOPE_CORE_SOURCE_BYTES_CACHED_BYTES_H_
#define ISOSCOPE_CORE_SOURCE_BYTES_CACHED_BYTES_H_

#include <cstdint>
#include <memory>
#include <string>

#include "core/base/units.h"
#include "core/io/file.h"
#include "core/source/bytes/byte_source.h"

namespace isoscope::source {

inline constexpr std::int64_t kCachedBlockBytes = 64 * base::kKiB;
inline constexpr std::int64_t kMaxCachedBlocks = 256;  // 16 MiB, of all files
inline constexpr std::int64_t kMaxAheadBlocks = 64;    // 4 MiB
inline constexpr std::int64_t kMaxStepBlocks = 4;      // that a reader may leave out
inline constexpr std::int64_t kDirectReadBytes = 256 * base::kKiB;

// A file of that path with the bytes of `bytes`, of which the caller has `start`, the first block or
// none. Thread-safe; small reads of one block wait for each
// other, and others go on. Reads, and waits for them, end with the process's interrupt
// (base::ProcessInterrupt). Errors are those of `bytes`; DATA_LOSS for a range outside of it.
std::unique_ptr<io::RandomAccessFile> MakeCachedFile(std::shared_ptr<const ByteSource> bytes,
                                                     std::string path, std::string start = "");

// Returns the number of blocks that are kept, of all files.
std::int64_t CachedBlockCount();

}  // namespace isoscope::source

#endif  // ISOSCOPE_CORE_SOURCE_BYTES_CACHED_BYTES_H_
