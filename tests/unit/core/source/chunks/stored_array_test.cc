#include "core/source/chunks/stored_array.h"

#include <algorithm>
#include <atomic>
#include <cstdint>
#include <functional>
#include <map>
#include <memory>
#include <string>
#include <thread>
#include <utility>
#include <vector>

#include "absl/strings/str_join.h"
#include "absl/time/clock.h"
#include "absl/time/time.h"
#include "absl/types/span.h"
#include "gmock/gmock.h"
#include "gtest/gtest.h"

#include "core/source/chunks/shard_indexes.h"
#include "tests/support/chunk_writer.h"
#include "tests/support/memory_store.h"
#include "tests/support/status_matchers.h"
#include "tests/support/volume_files.h"

namespace isoscope::source {
namespace {

using ::isoscope::testing::IsOk;
using ::isoscope::testing::MemoryStore;
using ::isoscope::testing::PlainArray;
using ::isoscope::testing::StatusIs;
using ::isoscope::testing::WithCrc32c;
using ::isoscope::testing::WriteChunks;
using ::isoscope::testing::WrittenChunks;
using ::testing::AllOf;
using ::testing::HasSubstr;

constexpr auto kInvalid = absl::StatusCode::kInvalidArgument;
constexpr auto kDataLoss = absl::StatusCode::kDataLoss;

std::string KeyOf(const ChunkIndex& index) { return absl::StrCat("c/", absl::StrJoin(index, "/")); }

const base::Cancellation& Never() {
  static const base::Cancellation never;
  return never;
}

std::vector<CodecSpec> Codecs(const std::string& list) {
  return *CodecSpecsFrom(ChunkJson::parse(list));
}

struct OpenedArray {
  std::shared_ptr<const MemoryStore> store;
  std::unique_ptr<ChunkedArray> array;
};

// An array of 4 axes, as it is written.
struct Case {
  const char* name;
  ChunkIndex chunk_dims;
  ChunkIndex shard_dims;
  bool is_compressed;
  bool is_index_at_end = true;
};
const Case kCases[] = {
    {"chunks", {1, 4, 3, 5}, {}, false},
    {"compressed", {2, 2, 4, 4}, {}, true},
    {"one chunk", {9, 9, 9, 9}, {}, true},
    {"shards", {1, 2, 2, 3}, {2, 4, 4, 6}, false},
    {"compressed shards, index at the start", {1, 2, 4, 2}, {1, 4, 8, 6}, true, false},
    {"one shard", {1, 2, 2, 3}, {3, 8, 8, 9}, true},
};

using Wrap = std::function<std::shared_ptr<const ObjectStore>(std::shared_ptr<const MemoryStore>)>;

// wrap: what the array reads, around its store; null: the store
absl::StatusOr<OpenedArray> OpenCase(const Case& written_case, const PlainArray& array,
                                     std::size_t gap = 0, const Wrap& wrap = nullptr) {
  const std::string fill("\x07\x08", 2);
  WrittenChunks written{.chunk_dims = written_case.chunk_dims,
                        .shard_dims = written_case.shard_dims,
                        .fill = fill,
                        .is_missing = [](std::int64_t number) { return number % 5 == 3; }};
  written.shard.is_index_at_end = written_case.is_index_at_end;
  written.shard.gap = gap;
  std::string codecs = R"([{"name": "bytes", "configuration": {"endian": "little"}}, "crc32c"])";
  if (written_case.is_compressed) {
    codecs = R"([{"name": "bytes", "configuration": {"endian": "little"}}, "gzip"])";
    written.encode = testing::Gzip;
  } else {
    written.encode = WithCrc32c;
  }
  ChunkIndex object_dims = written.chunk_dims;
  if (!written.shard_dims.empty()) {
    codecs = absl::StrCat(R"([{"name": "sharding_indexed", "configuration": {"chunk_shape": [)",
                          absl::StrJoin(written.chunk_dims, ", "), "], \"codecs\": ", codecs,
                          R"(, "index_codecs": ["bytes", "crc32c"], "index_location": ")",
                          written_case.is_index_at_end ? "end" : "start", "\"}}]");
    object_dims = written.shard_dims;
  }
  OpenedArray opened;
  opened.store = std::make_shared<const MemoryStore>(WriteChunks(array, written, KeyOf));
  StoredArraySpec spec{.name = "array",
                       .dims = array.dims,
                       .chunk_dims = object_dims,
                       .type = NumberType::kUint16,
                       .fill = fill,
                       .codecs = Codecs(codecs),
                       .key_of = KeyOf};
  std::shared_ptr<const ObjectStore> read = opened.store;
  auto made = OpenStoredArray(wrap == nullptr ? read : wrap(opened.store), std::move(spec));
  if (!made.ok()) {
    return made.status();
  }
  opened.array = *std::move(made);
  return opened;
}

// The array with fills where chunks are missing.
PlainArray WithMissing(const PlainArray& array, const ChunkIndex& chunk_dims) {
  PlainArray expected = array;
  const ChunkGrid grid(array.dims, chunk_dims);
  ChunkIndex chunk(array.dims.size(), 0);
  do {
    if (grid.NumberOf(chunk) % 5 == 3) {
      const ChunkBox part = IntersectionOf(grid.ElementsOf(chunk), BoxOf(array.dims));
      FillPart(part, "\x07\x08", BoxOf(array.dims), expected.bytes.data());
    }
  } while (NextIndex(BoxOf(grid.counts()), &chunk));
  return expected;
}

// Boxes of every kind, with and without a cache, compared with element after element.
TEST(StoredArrayTest, ReadsBoxes) {
  const ChunkIndex dims = {3, 7, 6, 8};
  const PlainArray array = PlainArray::Counting(dims, 2);
  for (const Case& written_case : kCases) {
    SCOPED_TRACE(written_case.name);
    ISOSCOPE_ASSERT_OK_AND_ASSIGN(const OpenedArray opened, OpenCase(written_case, array));
    EXPECT_EQ(opened.array->info().chunk_dims, written_case.chunk_dims);
    const PlainArray expected = WithMissing(array, written_case.chunk_dims);
    ChunkCache cache(1, 100'000);
    std::uint32_t state = 1;
    const auto draw = [&](std::int64_t below) {
      state = state * 1664525U + 1013904223U;
      return static_cast<std::int64_t>(state >> 8) % below;
    };
    for (int i = 0; i < 300; ++i) {
      ChunkBox box{.begin = dims, .end = dims};
      for (std::size_t axis = 0; axis < dims.size(); ++axis) {
        box.begin[axis] = draw(dims[axis]);
        box.end[axis] = box.begin[axis] + 1 + draw(dims[axis] - box.begin[axis]);
      }
      if (i == 0) {
        box = BoxOf(dims);
      }
      const std::string cut = expected.Cut(box, "");
      std::string out(cut.size(), '?');
      ISOSCOPE_ASSERT_OK(
          opened.array->ReadBox(box, out.data(), i % 2 == 0 ? &cache : nullptr, Never()));
      ASSERT_EQ(out, cut) << DescribeIndex(box.begin) << DescribeIndex(box.end);
    }
  }
}

// Plane after plane, each object is asked for once.
TEST(StoredArrayTest, ReadsEachChunkOnceAPass) {
  const PlainArray array = PlainArray::Counting({1, 8, 6, 8}, 2);
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(const OpenedArray opened, OpenCase(kCases[1], array));
  ChunkCache cache(1, 100'000);
  std::map<std::string, int> reads;
  for (std::int64_t z = 0; z < 8; ++z) {
    const ChunkBox box{.begin = {0, z, 0, 0}, .end = {1, z + 1, 6, 8}};
    std::string out(96, '\0');
    ISOSCOPE_ASSERT_OK(opened.array->ReadBox(box, out.data(), &cache, Never()));
  }
  for (const ObjectRead& read : opened.store->TakeReads()) {
    ++reads[read.key];
  }
  EXPECT_EQ(reads.size(), 16U);
  for (const auto& [key, count] : reads) {
    // A missing chunk costs nothing to ask for again.
    EXPECT_TRUE(count == 1 || !opened.store->Open(key, Never()).ok()) << key;
  }
}

// One inner chunk is a read of the index and one of its range. A whole shard is two reads, too.
TEST(StoredArrayTest, ReadsRangesOfShards) {
  const Case shard{"shard", {8, 8}, {64, 64}, false};
  const PlainArray array = PlainArray::Counting({64, 64}, 2);
  for (const std::size_t gap : {std::size_t{0}, std::size_t{100'000}}) {
    ISOSCOPE_ASSERT_OK_AND_ASSIGN(const OpenedArray opened, OpenCase(shard, array, gap));
    std::string one(128, '\0');
    const ChunkBox box{.begin = {8, 16}, .end = {16, 24}};
    ISOSCOPE_ASSERT_OK(opened.array->ReadBox(box, one.data(), nullptr, Never()));
    EXPECT_EQ(one, array.Cut(box, ""));
    const auto reads = opened.store->TakeReads();
    ASSERT_EQ(reads.size(), 2U);
    EXPECT_EQ(reads[0].size, 64 * 16 + 4);
    EXPECT_EQ(reads[0].offset, -reads[0].size);
    EXPECT_EQ(reads[1].size, 128 + 4);
    std::string all(array.bytes.size(), '\0');
    ISOSCOPE_ASSERT_OK(opened.array->ReadBox(BoxOf(array.dims), all.data(), nullptr, Never()));
    // The index is known by now. Chunks that lie far apart are not joined.
    EXPECT_EQ(opened.store->TakeReads().size(), gap == 0 ? 1U : 51U);
  }
}

// An agent's limit counts what readers of many shards keep, and nothing is left behind.
TEST(StoredArrayTest, IndexesOfManyShardsStayWithinTheBoundOfTheProcess) {
  constexpr std::int64_t kMaxBytes = 8 << 10;
  ShardIndexes& indexes = ShardIndexes::OfProcess();
  ASSERT_EQ(indexes.kept_bytes(), 0);
  indexes.SetMaxBytes(kMaxBytes);
  {
    const PlainArray array = PlainArray::Counting({64, 64}, 2);
    ISOSCOPE_ASSERT_OK_AND_ASSIGN(const OpenedArray opened,
                                  OpenCase({"shards", {2, 2}, {16, 16}, false}, array));
    for (std::int64_t row = 0; row < 64; row += 2) {
      const ChunkBox box{.begin = {row, 0}, .end = {row + 2, 64}};
      std::string out(64 * 2 * 2, '\0');
      ISOSCOPE_ASSERT_OK(opened.array->ReadBox(box, out.data(), nullptr, Never()));
      EXPECT_EQ(out, WithMissing(array, {2, 2}).Cut(box, ""));
      EXPECT_LE(indexes.kept_bytes(), kMaxBytes);
      EXPECT_GT(indexes.kept_bytes(), 0);
    }
  }
  EXPECT_EQ(indexes.kept_bytes(), 0);
  indexes.SetMaxBytes(ShardIndexes::kDefaultMaxBytes);
}

// Asks slowly; fails the first `failures` reads of an index.
class SlowStore final : public ObjectStore {
 public:
  SlowStore(std::shared_ptr<const MemoryStore> store, int failures)
      : store_(std::move(store)), failures_(failures) {}

  [[nodiscard]] std::vector<absl::StatusOr<std::string>> Read(
      absl::Span<const ObjectRead> reads, const base::Cancellation& cancellation) const override {
    absl::SleepFor(absl::Milliseconds(20));
    auto answers = store_->Read(reads, cancellation);
    if (!reads.empty() && reads[0].offset < 0 && failures_-- > 0) {
      answers[0] = absl::UnavailableError("away");
    }
    return answers;
  }
  [[nodiscard]] absl::StatusOr<std::unique_ptr<ByteSource>> Open(
      const std::string& key, const base::Cancellation& cancellation) const override {
    return store_->Open(key, cancellation);
  }
  [[nodiscard]] const std::string& name() const override { return store_->name(); }

 private:
  const std::shared_ptr<const MemoryStore> store_;
  mutable std::atomic<int> failures_;
};

TEST(StoredArrayTest, ReadersOfAShardAskForItsIndexOnce) {
  const Case shard{"shard", {8, 8}, {64, 64}, false};
  const PlainArray array = PlainArray::Counting({64, 64}, 2);
  const PlainArray expected = WithMissing(array, shard.chunk_dims);
  for (const int failures : {0, 1}) {
    SCOPED_TRACE(failures);
    std::shared_ptr<const MemoryStore> store;
    ISOSCOPE_ASSERT_OK_AND_ASSIGN(
        const OpenedArray opened,
        OpenCase(shard, array, 0, [&](std::shared_ptr<const MemoryStore> plain) {
          store = plain;
          return std::make_shared<const SlowStore>(std::move(plain), failures);
        }));
    std::atomic<int> error_count{0};
    std::vector<std::thread> readers;
    for (std::int64_t i = 0; i < 8; ++i) {
      readers.emplace_back([&, i] {
        std::string one(128, '\0');
        const ChunkBox box{.begin = {8 * i, 16}, .end = {8 * i + 8, 24}};
        const absl::Status status = opened.array->ReadBox(box, one.data(), nullptr, Never());
        error_count += status.ok() ? 0 : 1;
        EXPECT_TRUE(!status.ok() || one == expected.Cut(box, ""));
      });
    }
    for (std::thread& reader : readers) {
      reader.join();
    }
    EXPECT_EQ(error_count, failures);  // whoever asked knows why; the others ask again
    const auto reads = store->TakeReads();
    EXPECT_EQ(std::count_if(reads.begin(), reads.end(),
                            [](const ObjectRead& read) { return read.offset < 0; }),
              1 + failures);
  }
}

TEST(StoredArrayTest, SaysWhichChunkIsDamaged) {
  const PlainArray array = PlainArray::Counting({4, 4}, 2);
  const auto read = [&](std::map<std::string, std::string> objects, const std::string& codecs) {
    auto store = std::make_shared<const MemoryStore>(std::move(objects));
    StoredArraySpec spec{.name = "a.zarr:v",
                         .dims = {4, 4},
                         .chunk_dims = {2, 4},
                         .type = NumberType::kUint16,
                         .fill = std::string(2, '\0'),
                         .codecs = Codecs(codecs),
                         .key_of = KeyOf};
    auto opened = OpenStoredArray(store, std::move(spec));
    if (!opened.ok()) {
      return opened.status();
    }
    std::string out(32, '\0');
    return (*opened)->ReadBox(BoxOf({4, 4}), out.data(), nullptr, Never());
  };
  ISOSCOPE_EXPECT_OK(read({{"c/0/0", std::string(16, 'a')}}, R"(["bytes"])"));
  EXPECT_THAT(read({{"c/1/0", std::string(15, 'a')}}, R"(["bytes"])"),
              StatusIs(kDataLoss, AllOf(HasSubstr("a.zarr:v: c/1/0: chunk (1, 0): 15 bytes"),
                                        HasSubstr("expected 16"))));
  EXPECT_THAT(read({{"c/1/0", std::string(17, 'a')}}, R"(["bytes"])"),
              StatusIs(kDataLoss, HasSubstr("more than 16 bytes")));
  EXPECT_THAT(read({{"c/0/0", std::string(17, 'a')}}, R"(["bytes", "zstd"])"),
              StatusIs(kDataLoss, HasSubstr("codec \"zstd\"")));
  const std::string shards =
      R"([{"name": "sharding_indexed", "configuration": {"chunk_shape": [1, 4],
           "codecs": ["bytes"], "index_codecs": ["bytes"]}}])";
  EXPECT_THAT(read({{"c/0/0", std::string(31, 'a')}}, shards),
              StatusIs(kDataLoss, AllOf(HasSubstr("c/0/0"), HasSubstr("cut"))));
  std::string index;  // the first chunk lies behind the end
  for (const std::uint64_t number :
       {std::uint64_t{1000}, std::uint64_t{8}, ~std::uint64_t{0}, ~std::uint64_t{0}}) {
    base::AppendLittleEndian(number, &index);
  }
  EXPECT_THAT(read({{"c/0/0", index}}, shards), StatusIs(kDataLoss, HasSubstr("c/0/0")));
}

// Whatever the codecs: as samples of just its size, too large, too small, and in place of a shard.
TEST(StoredArrayTest, NamesAPointerOfGitLfsInPlaceOfAChunk) {
  const std::string pointer =
      absl::StrCat("version https://git-lfs.github.com/spec/v1\noid sha256:", std::string(64, '0'),
                   "\nsize 12345\n");
  const auto size = static_cast<std::int64_t>(pointer.size());
  const std::string plain = R"(["bytes"])";
  const auto sharded = [](const char* location) {
    return absl::StrCat(R"([{"name": "sharding_indexed", "configuration": {"chunk_shape": [1],
                             "codecs": ["bytes"], "index_codecs": ["bytes"],
                             "index_location": ")",
                        location, R"("}}])");
  };
  struct Array {
    std::int64_t samples;
    std::string codecs;
  };
  for (const Array& array : {Array{size, plain}, Array{10, plain}, Array{4000, plain},
                             Array{size, R"(["bytes", "gzip"])"}, Array{7, sharded("start")},
                             Array{4000, sharded("start")}, Array{4000, sharded("end")}}) {
    SCOPED_TRACE(absl::StrCat(array.samples, " ", array.codecs));
    auto store =
        std::make_shared<const MemoryStore>(std::map<std::string, std::string>{{"c/0", pointer}});
    ISOSCOPE_ASSERT_OK_AND_ASSIGN(const auto opened,
                                  OpenStoredArray(store, {.name = "a.zarr",
                                                          .dims = {array.samples},
                                                          .chunk_dims = {array.samples},
                                                          .type = NumberType::kUint8,
                                                          .fill = std::string(1, '\0'),
                                                          .codecs = Codecs(array.codecs),
                                                          .key_of = KeyOf}));
    std::string out(static_cast<std::size_t>(array.samples), '\0');
    EXPECT_THAT(opened->ReadBox(BoxOf({array.samples}), out.data(), nullptr, Never()),
                StatusIs(kInvalid, AllOf(HasSubstr("a.zarr: c/0: a Git LFS pointer"),
                                         HasSubstr("git lfs pull"))));
  }
}

TEST(StoredArrayTest, RefusesSizesThatMakeNoSense) {
  const auto open = [](ChunkIndex dims, ChunkIndex chunk_dims, const std::string& codecs) {
    return OpenStoredArray(
               std::make_shared<const MemoryStore>(std::map<std::string, std::string>()),
               {.name = "a",
                .dims = std::move(dims),
                .chunk_dims = std::move(chunk_dims),
                .type = NumberType::kUint16,
                .fill = std::string(2, '\0'),
                .codecs = Codecs(codecs),
                .key_of = KeyOf})
        .status();
  };
  const std::string bytes = R"(["bytes"])";
  constexpr std::int64_t kMax = std::numeric_limits<std::int64_t>::max();
  ISOSCOPE_EXPECT_OK(open({4, 4}, {2, 2}, bytes));
  ISOSCOPE_EXPECT_OK(open({kMax / 4, 1}, {1, 1}, bytes));
  ISOSCOPE_EXPECT_OK(open({kMax, 0}, {1, 1}, bytes));
  EXPECT_THAT(open({}, {}, bytes), StatusIs(kInvalid));
  EXPECT_THAT(open(ChunkIndex(33, 1), ChunkIndex(33, 1), bytes), StatusIs(kInvalid));
  EXPECT_THAT(open({4, 4}, {2}, bytes), StatusIs(kInvalid));
  EXPECT_THAT(open({4, -4}, {2, 2}, bytes), StatusIs(kInvalid, HasSubstr("(4, -4)")));
  EXPECT_THAT(open({4, 4}, {2, 0}, bytes), StatusIs(kInvalid));
  EXPECT_THAT(open({kMax, kMax}, {1, 1}, bytes), StatusIs(kInvalid, HasSubstr("2^62")));
  EXPECT_THAT(open({4, 4}, {1 << 15, 1 << 15}, bytes), StatusIs(kInvalid, HasSubstr("smaller")));
  EXPECT_THAT(open({4, 4}, {kMax, kMax}, bytes), StatusIs(kInvalid, HasSubstr("smaller")));
  const std::string shards = R"([{"name": "sharding_indexed", "configuration": {
      "chunk_shape": [1048576, 1048576], "codecs": ["bytes"], "index_codecs": ["bytes"]}}])";
  EXPECT_THAT(open({4, 4}, {1 << 20, 1 << 20}, shards), StatusIs(kInvalid, HasSubstr("smaller")));
}

TEST(StoredArrayTest, HeedsCancellation) {
  const PlainArray array = PlainArray::Counting({3, 7, 6, 8}, 2);
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(const OpenedArray opened, OpenCase(kCases[0], array));
  base::Cancellation cancellation;
  cancellation.Cancel();
  std::string out(array.bytes.size(), '\0');
  EXPECT_THAT(opened.array->ReadBox(BoxOf(array.dims), out.data(), nullptr, cancellation),
              StatusIs(absl::StatusCode::kCancelled));
}

}  // namespace
}  // namespace isoscope::source
