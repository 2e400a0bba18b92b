#include "core/source/chunks/shard_layout.h"

#include <cstddef>
#include <limits>
#include <utility>

#include "absl/strings/str_cat.h"
#include "absl/strings/str_format.h"

#include "core/base/coding.h"
#include "core/base/status_macros.h"

namespace isoscope::source {
namespace {

constexpr std::int64_t kMaxChunksOfShard = std::int64_t{4} << 20;
constexpr std::int64_t kMaxOffset = std::int64_t{1} << 60;

absl::Status InShard(absl::string_view what, const absl::Status& status) {
  return absl::Status(status.code(), absl::StrCat(what, ": ", status.message()));
}

absl::StatusOr<CodecChain> ChainIn(const ChunkJson& configuration, const char* name,
                                   const ChunkData& data) {
  const auto found = configuration.find(name);
  if (found == configuration.end()) {
    return absl::InvalidArgumentError(absl::StrCat("it has no ", name));
  }
  auto specs = CodecSpecsFrom(*found);
  auto chain = specs.ok() ? CodecChain::Make(*specs, data) : specs.status();
  return chain.ok() ? std::move(chain) : InShard(name, chain.status());
}

// Decodes the chunks of a shard that is in memory as a whole.
class ShardCodec final : public ChunkCodec {
 public:
  ShardCodec(std::shared_ptr<const ShardLayout> layout, ChunkData shard)
      : layout_(std::move(layout)), shard_(std::move(shard)) {}

  [[nodiscard]] absl::StatusOr<std::string> Decode(std::string encoded) const override {
    const auto size = static_cast<std::int64_t>(encoded.size());
    if (size < layout_->index_bytes()) {
      return absl::DataLossError(absl::StrFormat("%d bytes, fewer than the %d of its index", size,
                                                 layout_->index_bytes()));
    }
    ISOSCOPE_ASSIGN_OR_RETURN(
        const std::vector<ShardEntry> entries,
        layout_->DecodeIndex(absl::string_view(encoded).substr(
            static_cast<std::size_t>(layout_->is_index_at_end() ? size - layout_->index_bytes()
                                                                : 0),
            static_cast<std::size_t>(layout_->index_bytes()))));
    const ChunkGrid& grid = layout_->grid();
    const ChunkBox shard = BoxOf(grid.dims());
    const std::size_t element_size = SizeOf(shard_.type);
    std::string out(static_cast<std::size_t>(shard_.size_bytes), '\0');
    const ChunkBox chunks = BoxOf(grid.counts());
    ChunkIndex index = chunks.begin;
    std::size_t number = 0;
    do {
      const ShardEntry& entry = entries[number++];
      const ChunkBox box = grid.ElementsOf(index);
      if (!entry.is_there()) {
        FillPart(box, shard_.fill, shard, out.data());
        continue;
      }
      if (entry.offset > size || entry.size > size - entry.offset) {
        return absl::DataLossError(absl::StrFormat(
            "chunk %d of the shard has %d bytes from %d on, and the shard ends at %d", number - 1,
            entry.size, entry.offset, size));
      }
      auto chunk = layout_->chunk_codecs().Decode(absl::string_view(encoded).substr(
          static_cast<std::size_t>(entry.offset), static_cast<std::size_t>(entry.size)));
      if (!chunk.ok()) {
        return InShard(absl::StrFormat("chunk %d of the shard", number - 1), chunk.status());
      }
      CopyPart(box, element_size, box, chunk->data(), shard, out.data());
    } while (NextIndex(chunks, &index));
    return out;
  }

 private:
  const std::shared_ptr<const ShardLayout> layout_;
  const ChunkData shard_;
};

absl::StatusOr<std::unique_ptr<ChunkCodec>> MakeShardCodec(const ChunkJson& configuration,
                                                           ChunkData* data) {
  ISOSCOPE_ASSIGN_OR_RETURN(std::shared_ptr<const ShardLayout> layout,
                            ShardLayout::Make(configuration, *data));
  ChunkData shard = *data;
  data->is_array = false;
  data->is_exact = false;
  // Between chunks there may be unused bytes, as where one was written anew behind the others.
  // Chunks that are compressed leave room for them.
  data->size_bytes = layout->chunk_codecs().encoded().is_exact
                         ? MaxCompressedBytes(layout->max_bytes())
                         : layout->max_bytes();
  return std::make_unique<ShardCodec>(std::move(layout), std::move(shard));
}

}  // namespace

ShardLayout::ShardLayout(ChunkGrid grid, CodecChain chunk_codecs, CodecChain index_codecs,
                         bool is_index_at_end)
    : grid_(std::move(grid)),
      chunk_codecs_(std::move(chunk_codecs)),
      index_codecs_(std::move(index_codecs)),
      is_index_at_end_(is_index_at_end) {}

absl::StatusOr<std::shared_ptr<const ShardLayout>> ShardLayout::Make(const ChunkJson& configuration,
                                                                     const ChunkData& shard) {
  if (!shard.is_array) {
    return absl::InvalidArgumentError("it encodes numbers, and is given bytes");
  }
  if (shard.fill.empty()) {
    return absl::InvalidArgumentError(
        "a codec in front of it changes numbers, so that those of missing chunks are not known");
  }
  // 1. The chunks of a shard.
  const auto shape = configuration.find("chunk_shape");
  if (shape == configuration.end() || !shape->is_array() || shape->size() != shard.dims.size()) {
    return absl::InvalidArgumentError(
        absl::StrFormat("its chunk_shape is no list of %d sizes", shard.dims.size()));
  }
  ChunkIndex chunk_dims;
  for (std::size_t axis = 0; axis < shard.dims.size(); ++axis) {
    const ChunkJson& size = (*shape)[axis];
    const std::int64_t whole = shard.dims[axis];
    if (!size.is_number_integer() || size < 1 || size > whole ||
        whole % size.get<std::int64_t>() != 0) {
      return absl::InvalidArgumentError(
          absl::StrFormat("its chunks do not fill shards of %s; expected sizes that divide these",
                          DescribeIndex(shard.dims)));
    }
    chunk_dims.push_back(size.get<std::int64_t>());
  }
  ChunkGrid grid(shard.dims, chunk_dims);
  const std::int64_t count = CheckedVolume(grid.counts(), 1, kMaxChunksOfShard);
  if (count < 0) {
    return absl::InvalidArgumentError(
        absl::StrFormat("a shard has more than %d chunks", kMaxChunksOfShard));
  }
  // 2. Their codecs, and those of the index.
  ISOSCOPE_ASSIGN_OR_RETURN(
      CodecChain chunk_codecs,
      ChainIn(configuration, "codecs", ArrayData(chunk_dims, shard.type, shard.fill)));
  ChunkIndex index_dims = grid.counts();
  index_dims.push_back(2);
  ISOSCOPE_ASSIGN_OR_RETURN(
      CodecChain index_codecs,
      ChainIn(configuration, "index_codecs",
              ArrayData(index_dims, NumberType::kUint64, std::string(8, '\0'))));
  if (!index_codecs.encoded().is_exact) {
    return absl::InvalidArgumentError(
        "its index_codecs compress, so that nothing tells where the index begins");
  }
  const auto location = configuration.find("index_location");
  const bool is_given = location != configuration.end();
  if (is_given && *location != "start" && *location != "end") {
    return absl::InvalidArgumentError("its index_location is neither \"start\" nor \"end\"");
  }
  const bool is_at_end = !is_given || *location == "end";
  return std::shared_ptr<const ShardLayout>(new ShardLayout(
      std::move(grid), std::move(chunk_codecs), std::move(index_codecs), is_at_end));
}

std::int64_t ShardLayout::max_bytes() const {
  const std::int64_t count =
      CheckedVolume(grid_.counts(), chunk_codecs_.encoded().size_bytes, kMaxOffset);
  return count < 0 ? kMaxOffset : count * chunk_codecs_.encoded().size_bytes + index_bytes();
}

absl::StatusOr<std::vector<ShardEntry>> ShardLayout::DecodeIndex(absl::string_view encoded) const {
  auto decoded = index_codecs_.Decode(encoded);
  if (!decoded.ok()) {
    return InShard("the index of the shard", decoded.status());
  }
  constexpr std::uint64_t kMissing = std::numeric_limits<std::uint64_t>::max();
  constexpr std::size_t kEntryBytes = 16;
  std::vector<ShardEntry> entries(decoded->size() / kEntryBytes);
  for (std::size_t i = 0; i < entries.size(); ++i) {
    const char* const entry = decoded->data() + i * kEntryBytes;
    const auto offset = base::LoadLittleEndian<std::uint64_t>(entry);
    const auto size = base::LoadLittleEndian<std::uint64_t>(entry + kEntryBytes / 2);
    if (offset == kMissing && size == kMissing) {
      continue;
    }
    if (offset > static_cast<std::uint64_t>(kMaxOffset) ||
        size > static_cast<std::uint64_t>(chunk_codecs_.encoded().size_bytes)) {
      return absl::DataLossError(absl::StrFormat(
          "the index of the shard puts %d bytes of chunk %d at %d; expected at most %d bytes", size,
          i, offset, chunk_codecs_.encoded().size_bytes));
    }
    entries[i] = {.offset = static_cast<std::int64_t>(offset),
                  .size = static_cast<std::int64_t>(size)};
  }
  return entries;
}

absl::Span<const CodecRow> ShardCodecs() {
  static constexpr CodecRow kRows[] = {{"sharding_indexed", MakeShardCodec}};
  return kRows;
}

}  // namespace isoscope::source
