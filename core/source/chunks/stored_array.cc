// A box is read in batches of chunks, in C order:
//
//   1. List      the next chunks of the box, up to 32 MiB of decoded bytes
//   2. Fetch     their bytes: an object each; of shards first the indexes, then the ranges of the
//                chunks, near ones joined
//   3. Decode    on all threads, and copy into the output
//
// The next batch is fetched while this one is decoded. So memory holds two batches of encoded
// chunks, and on each thread a chunk that is decoded. Fewer threads decode if chunks are large.
//
// A shard's index is kept for the next batches, with those of other shards (shard_indexes.h).

#include "core/source/chunks/stored_array.h"

#include <algorithm>
#include <atomic>
#include <cstddef>
#include <map>
#include <optional>
#include <set>
#include <utility>

#include "absl/base/thread_annotations.h"
#include "absl/strings/match.h"
#include "absl/strings/str_cat.h"
#include "absl/strings/str_format.h"
#include "absl/strings/string_view.h"
#include "oneapi/tbb/info.h"
#include "oneapi/tbb/parallel_for.h"
#include "oneapi/tbb/task_group.h"

#include "core/base/cancellation.h"
#include "core/base/check.h"
#include "core/base/first_error.h"
#include "core/base/mutex.h"
#include "core/base/status_macros.h"
#include "core/base/units.h"
#include "core/source/bytes/file_content.h"
#include "core/source/chunks/shard_indexes.h"
#include "core/source/chunks/shard_layout.h"

namespace isoscope::source {
namespace {

constexpr std::int64_t kBatchBytes = 32 * base::kMiB;
constexpr std::size_t kBatchChunks = 256;
// Ranges of a shard with fewer bytes between them are read as one: less than a request costs.
constexpr std::int64_t kJoinGapBytes = 64 * base::kKiB;
constexpr std::int64_t kMaxJoinedBytes = 16 * base::kMiB;
constexpr std::int64_t kMaxDecodingBytes = 256 * base::kMiB;  // on all threads
constexpr std::int64_t kMaxChainBytes = 4 * base::kGiB;       // of one chunk

using ShardIndex = ShardIndexes::Index;

// A chunk on its way.
struct BatchChunk {
  ChunkIndex index{};
  ChunkBox part{};  // its elements in the box
  std::string key{};
  bool is_there = false;
  std::shared_ptr<const std::string> bytes{};  // that have the encoded chunk in them
  absl::string_view encoded{};
  ChunkCache::Chunk decoded{};  // from the cache
};

class StoredArray final : public ChunkedArray {
 public:
  StoredArray(ChunkedArrayInfo info, std::shared_ptr<const ObjectStore> store, StoredArraySpec spec,
              CodecChain chain, std::shared_ptr<const ShardLayout> shards, std::int64_t lanes)
      : ChunkedArray(std::move(info)),
        store_(std::move(store)),
        spec_(std::move(spec)),
        chain_(std::move(chain)),
        shards_(std::move(shards)),
        objects_(spec_.dims, spec_.chunk_dims),
        chunks_(spec_.dims, this->info().chunk_dims),
        lanes_(lanes),
        number_(indexes_.NumberArray()) {}
  ~StoredArray() override { indexes_.Forget(number_); }

  [[nodiscard]] absl::Status ReadBox(const ChunkBox& box, char* out, ChunkCache* cache,
                                     const base::Cancellation& cancellation) const override {
    ISOSCOPE_CHECK_EQ(box.begin.size(), spec_.dims.size());
    ISOSCOPE_CHECK(!box.is_empty() && IntersectionOf(box, BoxOf(spec_.dims)) == box);
    if (cache != nullptr) {
      cache->KeepPlanesOf(box);
    }
    const ChunkBox wanted = chunks_.ChunksOf(box);
    std::optional<ChunkIndex> next = wanted.begin;
    std::vector<BatchChunk> batch = List(box, wanted, cache, &next);
    ISOSCOPE_RETURN_IF_ERROR(Fetch(cancellation, &batch));
    while (!batch.empty()) {
      std::vector<BatchChunk> following = List(box, wanted, cache, &next);
      absl::Status fetched;
      absl::Status decoded;
      {
        tbb::task_group ahead;
        if (!following.empty()) {
          ahead.run([&] { fetched = Fetch(cancellation, &following); });
        }
        decoded = Decode(box, cache, cancellation, &batch, out);
        ahead.wait();
      }
      ISOSCOPE_RETURN_IF_ERROR(decoded);
      ISOSCOPE_RETURN_IF_ERROR(fetched);
      batch = std::move(following);
    }
    return absl::OkStatus();
  }

 private:
  [[nodiscard]] const CodecChain& chunk_codecs() const {
    return shards_ == nullptr ? chain_ : shards_->chunk_codecs();
  }

  // ---- 1. List. ----

  std::vector<BatchChunk> List(const ChunkBox& box, const ChunkBox& wanted, const ChunkCache* cache,
                               std::optional<ChunkIndex>* next) const {
    std::vector<BatchChunk> batch;
    std::int64_t bytes = 0;
    const std::int64_t chunk_bytes = chunk_codecs().decoded().size_bytes;
    while (next->has_value() && batch.size() < kBatchChunks &&
           (batch.empty() || bytes + chunk_bytes <= kBatchBytes)) {
      BatchChunk& chunk = batch.emplace_back();
      chunk.index = **next;
      chunk.part = IntersectionOf(chunks_.ElementsOf(chunk.index), box);
      if (cache != nullptr) {
        chunk.decoded = cache->Find(chunks_.NumberOf(chunk.index));
      }
      bytes += chunk_bytes;
      if (!NextIndex(wanted, &**next)) {
        next->reset();
      }
    }
    return batch;
  }

  // ---- 2. Fetch. ----

  [[nodiscard]] absl::Status Named(absl::string_view key, const absl::Status& status) const {
    // The store names the object.
    return absl::Status(absl::IsOutOfRange(status) ? absl::StatusCode::kDataLoss : status.code(),
                        absl::StrCat(spec_.name, ": ", key, ": ", status.message(),
                                     absl::IsOutOfRange(status) ? ": it is cut" : ""));
  }

  // The same error; of a pointer that Git LFS left in place of the object, that it is one.
  [[nodiscard]] absl::Status Explained(const std::string& key, const absl::Status& status,
                                       const base::Cancellation& cancellation) const {
    if (absl::IsCancelled(status) || absl::IsDeadlineExceeded(status) ||
        absl::IsUnavailable(status)) {
      return status;
    }
    constexpr auto kSize = static_cast<std::int64_t>(sizeof(kLfsPointerMark)) - 1;
    const ObjectRead start{.key = key, .size = kSize, .max_size = kSize};
    const absl::StatusOr<std::string> bytes =
        std::move(store_->Read({&start, 1}, cancellation).front());
    return bytes.ok() && *bytes == kLfsPointerMark ? PointerError(key) : status;
  }
  [[nodiscard]] absl::Status PointerError(absl::string_view key) const {
    return LfsPointerError(absl::StrCat(spec_.name, ": ", key));
  }

  [[nodiscard]] absl::Status Fetch(const base::Cancellation& cancellation,
                                   std::vector<BatchChunk>* batch) const {
    ISOSCOPE_RETURN_IF_ERROR(cancellation.Check());
    std::vector<BatchChunk*> wanted;
    for (BatchChunk& chunk : *batch) {
      if (chunk.decoded == nullptr) {
        wanted.push_back(&chunk);
      }
    }
    return shards_ == nullptr ? FetchObjects(wanted, cancellation)
                              : FetchFromShards(wanted, cancellation);
  }

  [[nodiscard]] absl::Status FetchObjects(const std::vector<BatchChunk*>& wanted,
                                          const base::Cancellation& cancellation) const {
    std::vector<ObjectRead> reads;
    for (BatchChunk* const chunk : wanted) {
      chunk->key = spec_.key_of(chunk->index);
      reads.push_back({.key = chunk->key, .max_size = chain_.encoded().size_bytes});
    }
    std::vector<absl::StatusOr<std::string>> objects = store_->Read(reads, cancellation);
    for (std::size_t i = 0; i < wanted.size(); ++i) {
      if (objects[i].ok()) {
        // Without a codec, and of the same size, it would be taken for samples.
        if (absl::StartsWith(*objects[i], kLfsPointerMark)) {
          return PointerError(wanted[i]->key);
        }
        wanted[i]->bytes = std::make_shared<const std::string>(*std::move(objects[i]));
        wanted[i]->encoded = *wanted[i]->bytes;
        wanted[i]->is_there = true;
      } else if (absl::IsResourceExhausted(objects[i].status())) {
        return Explained(
            wanted[i]->key,
            absl::DataLossError(absl::StrFormat(
                "%s: %s: more than %d bytes, the most that its chunk of %d bytes can have: it is "
                "damaged%s",
                spec_.name, wanted[i]->key, chain_.encoded().size_bytes,
                chain_.decoded().size_bytes,
                HasShards() ? ", or a shard with many unused bytes: write it again" : "")),
            cancellation);
      } else if (!absl::IsNotFound(objects[i].status())) {
        return Named(wanted[i]->key, objects[i].status());
      }
    }
    return absl::OkStatus();
  }

  // Among other codecs: whole objects are read and decoded.
  [[nodiscard]] bool HasShards() const {
    return std::any_of(spec_.codecs.begin(), spec_.codecs.end(),
                       [](const CodecSpec& codec) { return codec.name == "sharding_indexed"; });
  }

  // The chunks of a shard lie in it, by its own index.
  [[nodiscard]] ChunkIndex ShardOf(const ChunkIndex& chunk) const {
    ChunkIndex shard = chunk;
    for (std::size_t axis = 0; axis < shard.size(); ++axis) {
      shard[axis] /= shards_->grid().counts()[axis];
    }
    return shard;
  }
  [[nodiscard]] std::size_t EntryOf(const ChunkIndex& chunk) const {
    ChunkIndex inner = chunk;
    for (std::size_t axis = 0; axis < inner.size(); ++axis) {
      inner[axis] %= shards_->grid().counts()[axis];
    }
    return static_cast<std::size_t>(shards_->grid().NumberOf(inner));
  }

  // A chunk that a shard has.
  struct ShardChunk {
    BatchChunk* chunk = nullptr;
    ShardEntry entry{};
  };
  // A part of a shard that is read as one.
  struct JoinedRange {
    std::int64_t begin = 0;
    std::int64_t end = 0;
    std::vector<ShardChunk> chunks{};
  };

  [[nodiscard]] absl::Status FetchFromShards(const std::vector<BatchChunk*>& wanted,
                                             const base::Cancellation& cancellation) const {
    std::map<std::string, std::vector<BatchChunk*>> by_key;
    for (BatchChunk* const chunk : wanted) {
      chunk->key = spec_.key_of(ShardOf(chunk->index));
      by_key[chunk->key].push_back(chunk);
    }
    std::map<std::string, ShardIndex> indexes;
    ISOSCOPE_RETURN_IF_ERROR(FetchIndexes(by_key, cancellation, &indexes));
    std::vector<JoinedRange> ranges;
    std::vector<ObjectRead> reads;
    for (const auto& [key, chunks] : by_key) {
      const ShardIndex& index = indexes[key];
      if (index == nullptr) {
        continue;  // no such shard
      }
      std::vector<ShardChunk> there;
      for (BatchChunk* const chunk : chunks) {
        const ShardEntry& entry = (*index)[EntryOf(chunk->index)];
        if (entry.is_there()) {
          there.push_back({.chunk = chunk, .entry = entry});
        }
      }
      for (JoinedRange& range : Join(std::move(there))) {
        reads.push_back({.key = key,
                         .offset = range.begin,
                         .size = range.end - range.begin,
                         .max_size = range.end - range.begin});
        ranges.push_back(std::move(range));
      }
    }
    std::vector<absl::StatusOr<std::string>> parts = store_->Read(reads, cancellation);
    for (std::size_t i = 0; i < ranges.size(); ++i) {
      if (!parts[i].ok()) {
        // Its index was there before.
        const absl::Status status =
            absl::IsNotFound(parts[i].status())
                ? absl::DataLossError("the shard has vanished while it was read")
                : parts[i].status();
        return Named(reads[i].key, status);
      }
      const auto bytes = std::make_shared<const std::string>(*std::move(parts[i]));
      for (const ShardChunk& chunk : ranges[i].chunks) {
        chunk.chunk->bytes = bytes;
        chunk.chunk->encoded = absl::string_view(*bytes).substr(
            static_cast<std::size_t>(chunk.entry.offset - ranges[i].begin),
            static_cast<std::size_t>(chunk.entry.size));
        chunk.chunk->is_there = true;
      }
    }
    return absl::OkStatus();
  }

  [[nodiscard]] static std::vector<JoinedRange> Join(std::vector<ShardChunk> chunks) {
    std::sort(chunks.begin(), chunks.end(), [](const ShardChunk& a, const ShardChunk& b) {
      return a.entry.offset < b.entry.offset;
    });
    std::vector<JoinedRange> ranges;
    for (const ShardChunk& chunk : chunks) {
      const std::int64_t end = chunk.entry.offset + chunk.entry.size;
      if (!ranges.empty() && chunk.entry.offset - ranges.back().end <= kJoinGapBytes &&
          end - ranges.back().begin <= kMaxJoinedBytes) {
        ranges.back().end = std::max(ranges.back().end, end);
      } else {
        ranges.push_back({.begin = chunk.entry.offset, .end = end});
      }
      ranges.back().chunks.push_back(chunk);
    }
    return ranges;
  }

  // The indexes of those shards; null for one that is not there. Readers of one shard's chunks wait
  // for the one that asks for its index; if that fails, each asks by itself.
  [[nodiscard]] absl::Status FetchIndexes(
      const std::map<std::string, std::vector<BatchChunk*>>& by_key,
      const base::Cancellation& cancellation, std::map<std::string, ShardIndex>* indexes) const {
    while (indexes->size() < by_key.size()) {
      IndexClaim claim(this);
      std::set<std::string> of_others;
      {
        const base::MutexLock lock(&mutex_);
        for (const auto& [key, chunks] : by_key) {
          if (indexes->contains(key)) {
            continue;
          }
          if (std::optional<ShardIndex> known = indexes_.Find(number_, key); known.has_value()) {
            (*indexes)[key] = *std::move(known);
          } else if (claim.keys.insert(key); !in_flight_.insert(key).second) {
            claim.keys.erase(key);
            of_others.insert(key);
          }
        }
      }
      ISOSCOPE_RETURN_IF_ERROR(AskForIndexes(claim.keys, cancellation, indexes));
      claim.Release();
      if (of_others.empty()) {
        return absl::OkStatus();
      }
      ISOSCOPE_RETURN_IF_ERROR(base::AwaitOrCancelled(cancellation, &mutex_, &landed_,
                                                      [&]() ABSL_EXCLUSIVE_LOCKS_REQUIRED(mutex_) {
                                                        for (const std::string& key : of_others) {
                                                          if (in_flight_.contains(key)) {
                                                            return false;
                                                          }
                                                        }
                                                        return true;
                                                      }));
    }
    return absl::OkStatus();
  }

  // Keys whose indexes nobody else asks for until it goes out of scope.
  struct IndexClaim {
    explicit IndexClaim(const StoredArray* claims) : array(claims) {}
    ~IndexClaim() { Release(); }
    IndexClaim(const IndexClaim&) = delete;
    IndexClaim& operator=(const IndexClaim&) = delete;

    void Release() {
      const base::MutexLock lock(&array->mutex_);
      for (const std::string& key : keys) {
        array->in_flight_.erase(key);
      }
      keys.clear();
      array->landed_.SignalAll();
    }

    const StoredArray* array;
    std::set<std::string> keys{};
  };

  [[nodiscard]] absl::Status AskForIndexes(const std::set<std::string>& keys,
                                           const base::Cancellation& cancellation,
                                           std::map<std::string, ShardIndex>* indexes) const {
    std::vector<ObjectRead> reads;
    reads.reserve(keys.size());
    const std::int64_t size = shards_->index_bytes();
    for (const std::string& key : keys) {
      reads.push_back({.key = key,
                       .offset = shards_->is_index_at_end() ? -size : 0,
                       .size = size,
                       .max_size = size});
    }
    std::vector<absl::StatusOr<std::string>> parts = store_->Read(reads, cancellation);
    for (std::size_t i = 0; i < reads.size(); ++i) {
      const std::string& key = reads[i].key;
      if (absl::IsNotFound(parts[i].status())) {
        Keep(key, nullptr, indexes);
        continue;
      }
      auto entries = parts[i].ok() ? shards_->DecodeIndex(*parts[i]) : parts[i].status();
      if (!entries.ok()) {
        return Explained(key, Named(key, entries.status()), cancellation);
      }
      Keep(key, std::make_shared<const std::vector<ShardEntry>>(*std::move(entries)), indexes);
    }
    return absl::OkStatus();
  }

  void Keep(const std::string& key, ShardIndex index,
            std::map<std::string, ShardIndex>* indexes) const {
    indexes_.Keep(number_, key, index);
    (*indexes)[key] = std::move(index);
  }

  // ---- 3. Decode. ----

  [[nodiscard]] absl::Status Decode(const ChunkBox& box, ChunkCache* cache,
                                    const base::Cancellation& cancellation,
                                    std::vector<BatchChunk>* batch, char* out) const {
    base::FirstError error;
    std::atomic<std::size_t> next{0};
    const std::int64_t lanes = std::min(lanes_, static_cast<std::int64_t>(batch->size()));
    tbb::parallel_for(std::int64_t{0}, lanes, [&](std::int64_t /*lane*/) {
      std::string numbers;  // of chunk after chunk
      for (std::size_t i = next++; i < batch->size() && !error.has_error(); i = next++) {
        absl::Status status = cancellation.Check();
        error.Set(status.ok() ? DecodeChunk(box, cache, &(*batch)[i], &numbers, out) : status);
      }
    });
    return error.status();
  }

  [[nodiscard]] absl::Status DecodeChunk(const ChunkBox& box, ChunkCache* cache, BatchChunk* chunk,
                                         std::string* numbers, char* out) const {
    const ChunkBox elements = chunks_.ElementsOf(chunk->index);
    ChunkCache::Chunk decoded = std::move(chunk->decoded);
    if (decoded == nullptr && !chunk->is_there) {
      FillPart(chunk->part, spec_.fill, box, out);
      return absl::OkStatus();
    }
    if (decoded == nullptr) {
      const absl::Status status = chunk_codecs().DecodeInto(chunk->encoded, numbers);
      chunk->bytes = nullptr;
      if (!status.ok()) {
        return absl::Status(status.code(),
                            absl::StrFormat("%s: %s: chunk %s: %s", spec_.name, chunk->key,
                                            DescribeIndex(chunk->index), status.message()));
      }
      const bool is_whole = chunk->part == IntersectionOf(elements, BoxOf(spec_.dims));
      if (cache != nullptr && !is_whole) {
        decoded = std::make_shared<const std::string>(std::move(*numbers));
        numbers->clear();
        cache->Insert(chunks_.NumberOf(chunk->index), elements, decoded);
      }
    }
    const std::string& bytes = decoded == nullptr ? *numbers : *decoded;
    CopyPart(chunk->part, SizeOf(spec_.type), elements, bytes.data(), box, out);
    return absl::OkStatus();
  }

  const std::shared_ptr<const ObjectStore> store_;
  const StoredArraySpec spec_;
  const CodecChain chain_;                           // of an object
  const std::shared_ptr<const ShardLayout> shards_;  // null: an object is a chunk
  const ChunkGrid objects_;
  const ChunkGrid chunks_;
  const std::int64_t lanes_;  // chunks that are decoded at a time
  ShardIndexes& indexes_ = ShardIndexes::OfProcess();
  const std::int64_t number_;  // of this array there

  mutable base::Mutex mutex_;
  mutable base::CondVar landed_;
  mutable std::set<std::string> in_flight_ ABSL_GUARDED_BY(mutex_);  // keys that a reader asks for
};

absl::Status InArray(const StoredArraySpec& spec, const absl::Status& status) {
  return absl::Status(status.code(), absl::StrCat(spec.name, ": ", status.message()));
}

absl::Status CheckSizes(const StoredArraySpec& spec) {
  if (spec.dims.empty() || spec.dims.size() > kMaxChunkAxes) {
    return absl::InvalidArgumentError(
        absl::StrFormat("%d axes; expected 1 to %d", spec.dims.size(), kMaxChunkAxes));
  }
  if (spec.chunk_dims.size() != spec.dims.size()) {
    return absl::InvalidArgumentError(
        absl::StrFormat("%d axes, and chunks of %d", spec.dims.size(), spec.chunk_dims.size()));
  }
  for (std::size_t axis = 0; axis < spec.dims.size(); ++axis) {
    if (spec.dims[axis] < 0 || spec.chunk_dims[axis] < 1) {
      return absl::InvalidArgumentError(absl::StrFormat(
          "sizes %s in chunks of %s; expected sizes from 0 on, and chunks from 1 on",
          DescribeIndex(spec.dims), DescribeIndex(spec.chunk_dims)));
    }
  }
  const auto size = static_cast<std::int64_t>(SizeOf(spec.type));
  if (CheckedVolume(spec.dims, size, kMaxArrayNumbers) < 0) {
    return absl::InvalidArgumentError(
        absl::StrFormat("sizes %s; expected at most 2^62 bytes", DescribeIndex(spec.dims)));
  }
  return absl::OkStatus();
}

absl::Status ChunkTooLarge(const ChunkIndex& dims, std::int64_t limit) {
  return absl::InvalidArgumentError(absl::StrFormat(
      "chunks of %s; expected at most %d bytes to decode one: write it with smaller "
      "chunks",
      DescribeIndex(dims), limit));
}

}  // namespace

absl::StatusOr<std::unique_ptr<ChunkedArray>> OpenStoredArray(
    std::shared_ptr<const ObjectStore> store, StoredArraySpec spec) {
  if (absl::Status status = CheckSizes(spec); !status.ok()) {
    return InArray(spec, status);
  }
  const auto size = static_cast<std::int64_t>(SizeOf(spec.type));
  // An object may be a shard that is too large to be decoded as a whole.
  const bool has_shards = spec.codecs.size() == 1 && spec.codecs[0].name == "sharding_indexed";
  const std::int64_t limit = has_shards ? kMaxArrayNumbers : kMaxChunkBytes;
  if (CheckedVolume(spec.chunk_dims, size, limit) < 0) {
    return InArray(spec, ChunkTooLarge(spec.chunk_dims, limit));
  }
  const ChunkData object = ArrayData(spec.chunk_dims, spec.type, spec.fill);
  CodecChain chain;
  std::shared_ptr<const ShardLayout> shards;
  ChunkIndex chunk_dims = spec.chunk_dims;
  if (has_shards) {
    auto layout = ShardLayout::Make(spec.codecs[0].configuration, object);
    if (!layout.ok()) {
      return InArray(
          spec, absl::Status(layout.status().code(), absl::StrCat("codec \"sharding_indexed\": ",
                                                                  layout.status().message())));
    }
    shards = *std::move(layout);
    chunk_dims = shards->grid().chunk_dims();
    if (CheckedVolume(chunk_dims, size, kMaxChunkBytes) < 0) {
      return InArray(spec, ChunkTooLarge(chunk_dims, kMaxChunkBytes));
    }
  } else {
    auto made = CodecChain::Make(spec.codecs, object);
    if (!made.ok()) {
      return InArray(spec, made.status());
    }
    chain = *std::move(made);
  }
  const CodecChain& chunk_codecs = has_shards ? shards->chunk_codecs() : chain;
  if (chunk_codecs.memory_bytes() > kMaxChainBytes) {
    return InArray(spec, ChunkTooLarge(chunk_dims, kMaxChainBytes));
  }
  // Two batches, and what is decoded; one chunk may be more than either.
  const std::int64_t batch =
      std::max(MaxCompressedBytes(kBatchBytes), chunk_codecs.encoded().size_bytes);
  const std::int64_t chunk = std::max<std::int64_t>(chunk_codecs.memory_bytes(), 1);
  const std::int64_t threads = std::max(tbb::info::default_concurrency(), 1);
  const std::int64_t lanes = std::clamp<std::int64_t>(kMaxDecodingBytes / chunk, 1, threads);
  const std::int64_t memory_bytes =
      2 * batch + lanes * chunk +
      (has_shards ? std::max(ShardIndexes::kDefaultMaxBytes, shards->index_bytes()) : 0);
  ChunkedArrayInfo info{.name = spec.name,
                        .dims = spec.dims,
                        .chunk_dims = std::move(chunk_dims),
                        .type = spec.type,
                        .memory_bytes = memory_bytes};
  return std::make_unique<StoredArray>(std::move(info), std::move(store), std::move(spec),
                                       std::move(chain), std::move(shards), lanes);
}

}  // namespace isoscope::source
