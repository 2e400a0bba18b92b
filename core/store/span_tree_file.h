// span_tree.bin: the range table of a volume in pages, with the span of each page, for volumes whose
// table is too large to be held by every agent (docs/format/span_tree.md). Written beside ranges.bin,
// which has the same spans and stays the one that older programs read.

#ifndef ISOSCOPE_CORE_STORE_SPAN_TREE_FILE_H_
#define ISOSCOPE_CORE_STORE_SPAN_TREE_FILE_H_

#include <cstddef>
#include <cstdint>
#include <string>

#include "absl/status/status.h"
#include "absl/status/statusor.h"
#include "absl/strings/string_view.h"

#include "core/base/units.h"
#include "core/store/directory_files.h"
#include "core/store/manifest.h"
#include "core/volume/block_layout.h"
#include "core/volume/span_octree.h"

namespace isoscope::store {

inline constexpr char kSpanTreeFileName[] = "span_tree.bin";
inline constexpr absl::string_view kSpanTreeMagic = "ISOSPANT";

// Range tables up to this size are held in memory.
inline constexpr std::int64_t kMaxTableBytes = 32 * base::kMiB;
// Pages that an open file keeps at most, those that were used last.
inline constexpr std::size_t kSpanPageCacheBytes = std::size_t{16} * base::kMiB;

// Returns the bytes of the range table of a volume.
std::int64_t TableBytes(const Manifest& manifest, const volume::BlockLayout& layout);

// Returns true if the shards of a volume get a span_tree.bin: its table is large, and its active
// blocks are kept as trees (volume::kMaxDenseBlocks).
bool NeedsSpanTree(const Manifest& manifest, const volume::BlockLayout& layout);

// Writes the span_tree.bin of a directory from its ranges.bin. Holds 16 layers of blocks at a time.
// REQUIRES: manifest and layout are those of ranges.bin. ALREADY_EXISTS if it is there; DATA_LOSS if
// ranges.bin has another size.
absl::Status WriteSpanTree(const std::string& directory, const Manifest& manifest,
                           const volume::BlockLayout& layout);

// Opens the span_tree.bin of a directory: verifies its head. Pages are read and verified when they
// are needed; their errors are DATA_LOSS naming file and offset. DATA_LOSS if the head is damaged, or
// the file belongs to another volume; FAILED_PRECONDITION if it has a newer version.
absl::StatusOr<volume::SpanOctree> OpenSpanTree(const std::string& directory,
                                                const Manifest& manifest,
                                                const volume::BlockLayout& layout,
                                                const OpenFile& open_file);

// Reads all pages, and compares their spans with those of the head. DATA_LOSS if one is wrong.
absl::Status VerifySpanTree(const volume::SpanOctree& octree, absl::string_view where);

}  // namespace isoscope::store

#endif  // ISOSCOPE_CORE_STORE_SPAN_TREE_FILE_H_
