// The file:
//
//   head   a header (shard_format.h), then an entry for each page: min and max of its spans, and the
//          CRC-32C of its bytes; filled up with zeros to a multiple of 4096 bytes
//   pages  one after another: volume::SpanPageLayout
//
// The head is small, 1 / 2048 of the file for 16-bit samples: 0.5 MB for 2.4 x 10^8 blocks. It is read
// when the file is opened, and verified as a whole. A page is verified by its own checksum each time
// it is read from the disk. The header names the checksum of ranges.bin, so that files of different
// volumes can't be mixed.
//
// The writer goes through ranges.bin in slabs of 16 layers of blocks, which are a layer of pages. The
// head comes last: a file that was not finished has no magic.

#include "core/store/span_tree_file.h"

#include <algorithm>
#include <atomic>
#include <memory>
#include <utility>
#include <vector>

#include "absl/strings/str_format.h"

#include "core/base/check.h"
#include "core/base/coding.h"
#include "core/base/crc32c.h"
#include "core/base/lru_cache.h"
#include "core/base/status_macros.h"
#include "core/io/file.h"
#include "core/store/shard_format.h"
#include "core/volume/range_table.h"

namespace isoscope::store {
namespace {

constexpr std::int64_t kPageAlignment = 4096;

std::size_t EntryBytes(volume::ScalarType type) {
  return 2 * volume::SizeOf(type) + sizeof(std::uint32_t);
}

std::int64_t HeadBytes(volume::ScalarType type, std::int64_t page_count) {
  return static_cast<std::int64_t>(kBinaryHeaderBytes) +
         static_cast<std::int64_t>(EntryBytes(type)) * page_count;
}

// Returns the offset of page 0.
std::int64_t PagesOffset(volume::ScalarType type, std::int64_t page_count) {
  return (HeadBytes(type, page_count) + kPageAlignment - 1) / kPageAlignment * kPageAlignment;
}

// Pages of a file, of which the last used ones are kept.
class FilePages final : public volume::SpanPages {
 public:
  FilePages(std::unique_ptr<io::RandomAccessFile> file, volume::ScalarType type,
            std::vector<std::uint32_t> crc32cs)
      : file_(std::move(file)),
        page_bytes_(volume::SpanPageLayout::PageBytes(type)),
        offset_(PagesOffset(type, static_cast<std::int64_t>(crc32cs.size()))),
        crc32cs_(std::move(crc32cs)),
        cache_(kSpanPageCacheBytes) {
    file_->ExpectScatteredReads();
  }

  absl::StatusOr<std::shared_ptr<const std::string>> Load(std::int64_t page) override {
    // A round for each page: the least recently used ones go.
    cache_.SetRound(round_.fetch_add(1, std::memory_order_relaxed));
    if (std::shared_ptr<const std::string> kept = cache_.Find(page); kept != nullptr) {
      return kept;
    }
    auto bytes = std::make_shared<std::string>(page_bytes_, '\0');
    const std::int64_t offset = offset_ + page * static_cast<std::int64_t>(page_bytes_);
    ISOSCOPE_RETURN_IF_ERROR(file_->ReadAt(offset, bytes->size(), bytes->data()));
    const std::uint32_t expected = crc32cs_[static_cast<std::size_t>(page)];
    if (const std::uint32_t computed = base::Crc32c(*bytes); computed != expected) {
      return absl::DataLossError(absl::StrFormat(
          "%s: page %d at offset %d: crc32c 0x%08x stored, 0x%08x computed; copy the shard again",
          file_->path(), page, offset, expected, computed));
    }
    cache_.Insert(page, bytes, page_bytes_);
    return bytes;
  }
  [[nodiscard]] std::size_t size_bytes() const override {
    return kSpanPageCacheBytes + crc32cs_.capacity() * sizeof(crc32cs_[0]);
  }

 private:
  const std::unique_ptr<io::RandomAccessFile> file_;
  const std::size_t page_bytes_;
  const std::int64_t offset_;
  const std::vector<std::uint32_t> crc32cs_;
  std::atomic<std::uint64_t> round_{2};
  base::LruCache<std::int64_t, std::string> cache_;
};

// Reads the blocks of `layers` layers from layer `z` on.
absl::StatusOr<volume::RangeTable> ReadSlab(const io::RandomAccessFile& ranges,
                                            volume::ScalarType type, const math::Index3& dims,
                                            std::int64_t z, std::int64_t layers) {
  const auto layer_bytes = static_cast<std::int64_t>(2 * volume::SizeOf(type)) * dims.x * dims.y;
  std::string bytes(static_cast<std::size_t>(layers * layer_bytes), '\0');
  ISOSCOPE_RETURN_IF_ERROR(ranges.ReadAt(
      static_cast<std::int64_t>(kBinaryHeaderBytes) + z * layer_bytes, bytes.size(), bytes.data()));
  return volume::RangeTable::FromBytes(type, dims.x * dims.y * layers, std::move(bytes));
}

absl::Status WritePages(const io::RandomAccessFile& ranges, const Manifest& manifest,
                        const volume::BlockLayout& layout, io::WritableFile* file) {
  const volume::ScalarType type = manifest.scalar_type;
  const math::Index3& dims = layout.block_dims();
  const std::int64_t page_count = volume::SpanPageLayout(dims).page_count();
  std::string entries;
  std::int64_t offset = PagesOffset(type, page_count);
  constexpr std::int64_t kSide = volume::SpanPageLayout::kPageSide;
  for (std::int64_t z = 0; z < dims.z; z += kSide) {
    const std::int64_t layers = std::min(kSide, dims.z - z);
    ISOSCOPE_ASSIGN_OR_RETURN(const volume::RangeTable slab,
                              ReadSlab(ranges, type, dims, z, layers));
    const math::Index3 slab_dims{dims.x, dims.y, layers};
    const volume::SpanPageLayout pages(slab_dims);
    const volume::SpanOctree octree = volume::SpanOctree::OfTable(slab_dims, slab);
    for (std::int64_t page = 0; page < pages.page_count(); ++page) {
      const std::string bytes = volume::SpanPageOf(slab, pages, page);
      const std::size_t span_bytes = 2 * volume::SizeOf(type);
      entries.append(octree.page_spans().bytes(), static_cast<std::size_t>(page) * span_bytes,
                     span_bytes);
      base::AppendLittleEndian(base::Crc32c(bytes), &entries);
      ISOSCOPE_RETURN_IF_ERROR(file->WriteAt(offset, bytes));
      offset += static_cast<std::int64_t>(bytes.size());
    }
  }
  const BinaryHeader header{.scalar_type = static_cast<std::uint32_t>(type),
                            .entry_size = static_cast<std::uint32_t>(EntryBytes(type)),
                            .count = page_count,
                            .payload_crc32c = base::Crc32c(entries),
                            .data_size = std::int64_t{manifest.range_table_crc32c}};
  return file->WriteAt(0, EncodeBinaryHeader(kSpanTreeMagic, header) + entries);
}

}  // namespace

std::int64_t TableBytes(const Manifest& manifest, const volume::BlockLayout& layout) {
  return static_cast<std::int64_t>(2 * volume::SizeOf(manifest.scalar_type)) * layout.block_count();
}

bool NeedsSpanTree(const Manifest& manifest, const volume::BlockLayout& layout) {
  return layout.block_count() > volume::kMaxDenseBlocks &&
         TableBytes(manifest, layout) > kMaxTableBytes;
}

absl::Status WriteSpanTree(const std::string& directory, const Manifest& manifest,
                           const volume::BlockLayout& layout) {
  ISOSCOPE_ASSIGN_OR_RETURN(const auto ranges,
                            io::OpenRandomAccessFile(PathIn(directory, kRangeTableFileName)));
  const std::int64_t expected =
      static_cast<std::int64_t>(kBinaryHeaderBytes) + TableBytes(manifest, layout);
  if (ranges->size_bytes() != expected) {
    return absl::DataLossError(absl::StrFormat("%s: %d bytes, expected %d", ranges->path(),
                                               ranges->size_bytes(), expected));
  }
  ISOSCOPE_ASSIGN_OR_RETURN(const auto file,
                            io::CreateWritableFile(PathIn(directory, kSpanTreeFileName)));
  ISOSCOPE_RETURN_IF_ERROR(WritePages(*ranges, manifest, layout, file.get()));
  return file->Close();
}

absl::StatusOr<volume::SpanOctree> OpenSpanTree(const std::string& directory,
                                                const Manifest& manifest,
                                                const volume::BlockLayout& layout,
                                                const OpenFile& open_file) {
  const std::string path = PathIn(directory, kSpanTreeFileName);
  const volume::ScalarType type = manifest.scalar_type;
  const std::int64_t page_count = volume::SpanPageLayout(layout.block_dims()).page_count();
  const std::int64_t size =
      PagesOffset(type, page_count) +
      page_count * static_cast<std::int64_t>(volume::SpanPageLayout::PageBytes(type));
  ISOSCOPE_ASSIGN_OR_RETURN(std::unique_ptr<io::RandomAccessFile> file,
                            OpenRequired(path, open_file));
  if (file->size_bytes() != size) {
    return absl::DataLossError(
        absl::StrFormat("%s: %d bytes, expected %d", path, file->size_bytes(), size));
  }
  std::string head(static_cast<std::size_t>(HeadBytes(type, page_count)), '\0');
  ISOSCOPE_RETURN_IF_ERROR(file->ReadAt(0, head.size(), head.data()));
  ISOSCOPE_ASSIGN_OR_RETURN(const BinaryHeader header,
                            DecodeBinaryFile(kSpanTreeMagic, head, path));
  if (header.scalar_type != static_cast<std::uint32_t>(type) ||
      header.entry_size != EntryBytes(type) ||
      header.data_size != std::int64_t{manifest.range_table_crc32c}) {
    return absl::DataLossError(absl::StrFormat(
        "%s: of sample type %d, entries of %d bytes and a range table with crc32c 0x%08x; the "
        "manifest expects %d, %d and 0x%08x: it is of another dataset",
        path, header.scalar_type, header.entry_size, header.data_size, static_cast<int>(type),
        EntryBytes(type), manifest.range_table_crc32c));
  }
  const std::size_t span_bytes = 2 * volume::SizeOf(type);
  std::string spans;
  std::vector<std::uint32_t> crc32cs;
  for (std::size_t at = kBinaryHeaderBytes; at < head.size(); at += EntryBytes(type)) {
    spans.append(head, at, span_bytes);
    crc32cs.push_back(base::LoadLittleEndian<std::uint32_t>(head.data() + at + span_bytes));
  }
  return volume::SpanOctree(layout.block_dims(),
                            volume::RangeTable::FromBytes(type, page_count, std::move(spans)),
                            std::make_shared<FilePages>(std::move(file), type, std::move(crc32cs)));
}

absl::Status VerifySpanTree(const volume::SpanOctree& octree, absl::string_view where) {
  const volume::RangeTable& page_spans = octree.page_spans();
  for (std::int64_t page = 0; page < page_spans.block_count(); ++page) {
    ISOSCOPE_ASSIGN_OR_RETURN(const std::shared_ptr<const std::string> bytes,
                              octree.LoadPage(page));
    const volume::ScalarSpan actual =
        volume::RangeTable::FromBytes(page_spans.type(), volume::SpanPageLayout::kPageSpans, *bytes)
            .Total();
    const volume::ScalarSpan stated = page_spans.Get(static_cast<volume::BlockId>(page));
    const bool are_empty = actual.min > actual.max && stated.min > stated.max;
    if (!are_empty && actual != stated) {
      return absl::DataLossError(absl::StrFormat(
          "%s: page %d: spans from %g to %g, the head states %g to %g; copy the shard again", where,
          page, actual.min, actual.max, stated.min, stated.max));
    }
  }
  return absl::OkStatus();
}

}  // namespace isoscope::store
