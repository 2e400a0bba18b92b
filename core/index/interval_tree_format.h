// The interval tree file: sizes, field offsets, and the records that several sources encode or
// decode. The layout is described in docs/format/interval_tree.md, with the same names.

#ifndef ISOSCOPE_CORE_INDEX_INTERVAL_TREE_FORMAT_H_
#define ISOSCOPE_CORE_INDEX_INTERVAL_TREE_FORMAT_H_

#include <algorithm>
#include <cstddef>
#include <cstdint>

#include "core/base/coding.h"
#include "core/index/interval_tree.h"
#include "core/io/page_file.h"

namespace isoscope::index::format {

inline constexpr char kMagic[] = "ISOTREE1";  // 8 bytes on disk, without the zero
inline constexpr std::size_t kMagicBytes = 8;
inline constexpr std::uint32_t kVersion = 1;
inline constexpr std::size_t kHeaderBytes = 40;

// Values of the u16 that node and entry pages begin with. On disk: never change them.
inline constexpr std::uint16_t kNodeKind = 1;
inline constexpr std::uint16_t kEntryPageKind = 2;

inline constexpr std::size_t kEntryBytes = 24;
inline constexpr std::size_t kEntryPageHeaderBytes = 4;
// B: entries in a page.
inline constexpr std::int64_t kEntriesPerPage =
    (io::kPagePayloadBytes - kEntryPageHeaderBytes) / kEntryBytes;
static_assert(kEntriesPerPage == 170);

inline constexpr std::size_t kNodeHeaderBytes = 52;
inline constexpr std::size_t kSlabRecordBytes = 32;
inline constexpr std::int64_t kMaxSlabs =
    (io::kPagePayloadBytes - kNodeHeaderBytes) / kSlabRecordBytes;
static_assert(kMaxSlabs == 126);

// 2^32 intervals make at most 5 levels.
inline constexpr int kMaxTreeLevels = 8;
// A node's entry run has at most 7 entries an interval and is counted in 32 bits.
inline constexpr std::int64_t kMaxIntervalCount = std::int64_t{1} << 29;

struct Header {
  std::uint32_t version = kVersion;
  std::uint32_t page_bytes = io::kPageBytes;
  std::uint64_t interval_count = 0;
  std::uint32_t page_count = 0;
  std::uint32_t root_page = 0;
  std::uint32_t entry_bytes = kEntryBytes;
  std::uint32_t max_slabs = kMaxSlabs;
};

struct NodeHeader {
  std::uint16_t slab_count = 0;
  std::uint32_t left_end = 0;
  std::uint32_t right_end = 0;
  std::uint32_t window_end = 0;
  std::uint32_t leaf_end = 0;  // entries in the entry run
};

struct SlabRecord {
  double lower = 0.0;
  std::uint32_t left_begin = 0;
  std::uint32_t right_begin = 0;
  std::uint32_t leaf_begin = 0;
  std::uint32_t window_begin = 0;
  std::uint32_t window_size = 0;
  io::PageNumber child_page = 0;
};

// Each Encode writes all bytes of its record to `out`; each Decode reads them from `in`.

inline void EncodeEntry(const BlockInterval& interval, char* out) {
  base::StoreLittleEndian(interval.span.min, out);
  base::StoreLittleEndian(interval.span.max, out + 8);
  base::StoreLittleEndian(interval.block_id, out + 16);
  base::StoreLittleEndian(interval.ordinal, out + 20);
}

inline BlockInterval DecodeEntry(const char* in) {
  return {.span = {.min = base::LoadLittleEndian<double>(in),
                   .max = base::LoadLittleEndian<double>(in + 8)},
          .block_id = base::LoadLittleEndian<volume::BlockId>(in + 16),
          .ordinal = base::LoadLittleEndian<std::uint32_t>(in + 20)};
}

inline void EncodeHeader(const Header& header, char* out) {
  std::copy(kMagic, kMagic + kMagicBytes, out);
  base::StoreLittleEndian(header.version, out + 8);
  base::StoreLittleEndian(header.page_bytes, out + 12);
  base::StoreLittleEndian(header.interval_count, out + 16);
  base::StoreLittleEndian(header.page_count, out + 24);
  base::StoreLittleEndian(header.root_page, out + 28);
  base::StoreLittleEndian(header.entry_bytes, out + 32);
  base::StoreLittleEndian(header.max_slabs, out + 36);
}

// Decodes everything but the magic.
inline Header DecodeHeader(const char* in) {
  return {.version = base::LoadLittleEndian<std::uint32_t>(in + 8),
          .page_bytes = base::LoadLittleEndian<std::uint32_t>(in + 12),
          .interval_count = base::LoadLittleEndian<std::uint64_t>(in + 16),
          .page_count = base::LoadLittleEndian<std::uint32_t>(in + 24),
          .root_page = base::LoadLittleEndian<std::uint32_t>(in + 28),
          .entry_bytes = base::LoadLittleEndian<std::uint32_t>(in + 32),
          .max_slabs = base::LoadLittleEndian<std::uint32_t>(in + 36)};
}

inline void EncodeNodeHeader(const NodeHeader& header, char* out) {
  base::StoreLittleEndian(kNodeKind, out);
  base::StoreLittleEndian(header.slab_count, out + 2);
  base::StoreLittleEndian(header.left_end, out + 4);
  base::StoreLittleEndian(header.right_end, out + 8);
  base::StoreLittleEndian(header.window_end, out + 12);
  base::StoreLittleEndian(header.leaf_end, out + 16);
}

// Decodes everything but the kind.
inline NodeHeader DecodeNodeHeader(const char* in) {
  return {.slab_count = base::LoadLittleEndian<std::uint16_t>(in + 2),
          .left_end = base::LoadLittleEndian<std::uint32_t>(in + 4),
          .right_end = base::LoadLittleEndian<std::uint32_t>(in + 8),
          .window_end = base::LoadLittleEndian<std::uint32_t>(in + 12),
          .leaf_end = base::LoadLittleEndian<std::uint32_t>(in + 16)};
}

inline void EncodeSlabRecord(const SlabRecord& slab, char* out) {
  base::StoreLittleEndian(slab.lower, out);
  base::StoreLittleEndian(slab.left_begin, out + 8);
  base::StoreLittleEndian(slab.right_begin, out + 12);
  base::StoreLittleEndian(slab.leaf_begin, out + 16);
  base::StoreLittleEndian(slab.window_begin, out + 20);
  base::StoreLittleEndian(slab.window_size, out + 24);
  base::StoreLittleEndian(slab.child_page, out + 28);
}

inline SlabRecord DecodeSlabRecord(const char* in) {
  return {.lower = base::LoadLittleEndian<double>(in),
          .left_begin = base::LoadLittleEndian<std::uint32_t>(in + 8),
          .right_begin = base::LoadLittleEndian<std::uint32_t>(in + 12),
          .leaf_begin = base::LoadLittleEndian<std::uint32_t>(in + 16),
          .window_begin = base::LoadLittleEndian<std::uint32_t>(in + 20),
          .window_size = base::LoadLittleEndian<std::uint32_t>(in + 24),
          .child_page = base::LoadLittleEndian<io::PageNumber>(in + 28)};
}

// Offset of the record of slab `slab_index` in a node's payload.
inline std::size_t SlabRecordOffset(std::int64_t slab_index) {
  return kNodeHeaderBytes + static_cast<std::size_t>(slab_index) * kSlabRecordBytes;
}

}  // namespace isoscope::index::format

#endif  // ISOSCOPE_CORE_INDEX_INTERVAL_TREE_FORMAT_H_
