#include "partition-agent/cache/mesh_cache.h"

#include <algorithm>
#include <map>
#include <set>
#include <string>
#include <thread>

#include "gtest/gtest.h"

#include "core/base/random.h"

namespace isoscope::agent {
namespace {

using MeshPtr = std::shared_ptr<const mesh::CompactMesh>;
constexpr std::size_t kChunkBytes = base::MemoryPool::kChunkBytes;
constexpr std::size_t kPlaceCount = 64;

// A mesh whose content tells its id.
mesh::BlockMesh MakeMesh(volume::BlockId id, std::size_t vertex_count, std::size_t index_count) {
  mesh::BlockMesh mesh;
  mesh.block_id = id;
  mesh.owned_vertex_count = static_cast<std::int64_t>(id) + 3;
  for (std::size_t i = 0; i < vertex_count; ++i) {
    const auto value = static_cast<float>(i % 1000);
    mesh.positions.push_back({static_cast<float>(id), value, value + 0.5F});
    mesh.normals.push_back({value / 1000, static_cast<float>(id % 1000) / 1000, -value / 1000});
  }
  for (std::size_t i = 0; i < index_count; ++i) {
    mesh.indices.push_back(static_cast<std::uint32_t>((i * 7 + id) % vertex_count));
  }
  return mesh;
}

// Four of these fill a chunk to its last byte.
mesh::BlockMesh QuarterMesh(volume::BlockId id) {
  const std::size_t vertex_count = 8192;
  const std::size_t other = mesh::CompactSizeBytes(MakeMesh(id, vertex_count, 0));
  mesh::BlockMesh mesh =
      MakeMesh(id, vertex_count, (kChunkBytes / 4 - other) / (3 * sizeof(std::uint16_t)) * 3);
  EXPECT_EQ(mesh::CompactSizeBytes(mesh), kChunkBytes / 4);
  return mesh;
}

bool IsMesh(const mesh::CompactMesh& stored, const mesh::BlockMesh& mesh) {
  const std::shared_ptr<const mesh::CompactMesh> expected = mesh::Compact(mesh);
  bool is_same = stored.block_id == mesh.block_id &&
                 stored.owned_vertex_count == mesh.owned_vertex_count &&
                 std::equal(stored.positions.begin(), stored.positions.end(),
                            expected->positions.begin(), expected->positions.end()) &&
                 std::equal(stored.normals.begin(), stored.normals.end(), expected->normals.begin(),
                            expected->normals.end()) &&
                 stored.triangles.size() == expected->triangles.size();
  for (std::size_t i = 0; is_same && i < stored.triangles.size(); ++i) {
    is_same = stored.triangles[i] == expected->triangles[i];
  }
  return is_same;
}

// Returns a limit with room for this many chunks besides the tables.
std::size_t LimitOf(std::size_t chunk_count) {
  return (kChunkBytes * chunk_count + kChunkBytes / 2) / 7 * 8;
}

class MeshCacheTest : public ::testing::Test {
 protected:
  void SetMaxChunks(std::size_t chunk_count) { cache_->SetMaxBytes(LimitOf(chunk_count)); }
  std::uint64_t NextRound(std::int64_t count = 1) {
    std::uint64_t round = 0;
    for (; count > 0; --count) {
      round = cache_->BeginRound(++frame_number_);
    }
    return round;
  }
  std::shared_ptr<MeshTable> Table(double isovalue = 1) {
    return cache_->TableOf(0, {.isovalue = isovalue}, kPlaceCount);
  }
  // Stores quarter meshes at [begin, end), ids as places, one writer.
  void Fill(MeshTable* table, std::size_t begin, std::size_t end, std::uint64_t round) {
    MeshCache::Writer writer(cache_.get(), round);
    for (std::size_t place = begin; place < end; ++place) {
      writer.Store(QuarterMesh(static_cast<volume::BlockId>(place)), table, place);
    }
  }
  // Stores one mesh, by a writer of its own.
  MeshPtr Store(const mesh::BlockMesh& mesh, MeshTable* table, std::size_t place,
                std::uint64_t round) {
    return MeshCache::Writer(cache_.get(), round).Store(mesh, table, place);
  }
  // Which of the first places are there; '1' or '0' each. As a use in `round`.
  static std::string Present(MeshTable* table, std::size_t count, std::uint64_t round) {
    std::string present;
    for (std::size_t place = 0; place < count; ++place) {
      present += table->Find(place, round) != nullptr ? '1' : '0';
    }
    return present;
  }

  std::shared_ptr<base::MemoryPool> pool_ = base::MemoryPool::Make();
  std::unique_ptr<MeshCache> cache_ = std::make_unique<MeshCache>(pool_);
  std::int64_t frame_number_ = 0;
};

TEST_F(MeshCacheTest, FindsWhatWasStoredAtItsPlaceAndNothingElse) {
  SetMaxChunks(4);
  const std::uint64_t round = NextRound();
  const auto table = Table();
  const mesh::BlockMesh empty = MakeMesh(9, 0, 0);
  const mesh::BlockMesh small = MakeMesh(10, 5, 9);
  const mesh::BlockMesh odd = MakeMesh(11, 1001, 3003);
  MeshPtr stored;
  {
    MeshCache::Writer writer(cache_.get(), round);
    EXPECT_TRUE(IsMesh(*writer.Store(empty, table.get(), 0), empty));
    stored = writer.Store(small, table.get(), 7);
    writer.Store(odd, table.get(), kPlaceCount - 1);
  }
  EXPECT_TRUE(IsMesh(*stored, small));
  EXPECT_EQ(table->Find(7, round), stored);
  ASSERT_NE(table->Find(0, round), nullptr);
  EXPECT_TRUE(IsMesh(*table->Find(0, round), empty));
  ASSERT_NE(table->Find(kPlaceCount - 1, round), nullptr);
  EXPECT_TRUE(IsMesh(*table->Find(kPlaceCount - 1, round), odd));
  for (const std::size_t place : {1U, 6U, 8U, 62U}) {
    EXPECT_EQ(table->Find(place, round), nullptr) << place;
  }
}

TEST_F(MeshCacheTest, TablesAreThoseOfAShardAndAnIsovalue) {
  SetMaxChunks(4);
  const std::uint64_t round = NextRound();
  const auto table = cache_->TableOf(3, {.isovalue = 0.0}, kPlaceCount);
  Fill(table.get(), 0, 1, round);
  EXPECT_EQ(cache_->TableOf(3, {.isovalue = 0.0}, kPlaceCount), table);
  EXPECT_EQ(cache_->TableOf(3, {.isovalue = -0.0}, kPlaceCount), table) << "-0 is the isovalue 0";
  using volume::InsideRule;
  for (const auto& other :
       {cache_->TableOf(3, InsideRule::OfLabels({0}), kPlaceCount),
        cache_->TableOf(3, InsideRule::OfLabels({0, 1}), kPlaceCount),
        cache_->TableOf(4, {.isovalue = 0.0}, kPlaceCount),
        cache_->TableOf(3, {.isovalue = 1e-300}, kPlaceCount),
        cache_->TableOf(3, {.isovalue = 0.0}, kPlaceCount,
                        {.of = MeshValues::Of::kGradientMagnitude}),
        cache_->TableOf(3, {.isovalue = 0.0}, kPlaceCount,
                        {.of = MeshValues::Of::kField, .field_shard_number = 3}),
        cache_->TableOf(3, {.isovalue = 0.0}, kPlaceCount,
                        {.of = MeshValues::Of::kField, .field_shard_number = 4})}) {
    ASSERT_NE(other, table);
    EXPECT_EQ(other->Find(0, round), nullptr);
  }
  EXPECT_NE(cache_->TableOf(3, {.isovalue = 0.0}, kPlaceCount)->Find(0, round), nullptr);
}

TEST_F(MeshCacheTest, RoundsCountFramesNotAgents) {
  const std::uint64_t first = cache_->BeginRound(17);
  EXPECT_EQ(cache_->BeginRound(17), first) << "another agent of the same frame";
  const std::uint64_t second = cache_->BeginRound(18);
  EXPECT_EQ(second, first + 1);
  EXPECT_EQ(cache_->BeginRound(18), second);
}

TEST_F(MeshCacheTest, BytesAreThoseOfSegmentsAndTablesAndStayBounded) {
  constexpr std::size_t kChunks = 5;
  SetMaxChunks(kChunks);
  EXPECT_EQ(cache_->size_bytes(), 0U);
  const auto table = Table();
  const std::size_t table_bytes = cache_->size_bytes();
  EXPECT_EQ(table_bytes, table->size_bytes());
  EXPECT_GT(table_bytes, kPlaceCount * sizeof(void*));
  for (int frame = 0; frame < 40; ++frame) {
    const std::uint64_t round = NextRound();
    const auto begin = static_cast<std::size_t>(frame * 5) % (kPlaceCount - 5);
    Fill(table.get(), begin, begin + 5, round);
    EXPECT_LE(cache_->size_bytes(), LimitOf(kChunks));
    EXPECT_EQ((cache_->size_bytes() - table_bytes) % kChunkBytes, 0U);
    if (frame == 0) {
      // The second one has room for three more.
      EXPECT_EQ(cache_->size_bytes(), table_bytes + 2 * kChunkBytes);
    }
  }
  EXPECT_EQ(cache_->size_bytes(), table_bytes + kChunks * kChunkBytes) << "room is not used";
}

TEST_F(MeshCacheTest, LeastRecentlyUsedSegmentIsForgottenAsAWhole) {
  SetMaxChunks(3);
  const auto table = Table();
  for (std::size_t segment = 0; segment < 3; ++segment) {
    Fill(table.get(), 4 * segment, 4 * segment + 4, NextRound());
  }
  EXPECT_EQ(Present(table.get(), 12, NextRound()), "111111111111");
  // In the next rounds one mesh of the first and one of the last are used: the second one is older.
  for (int i = 0; i < 2; ++i) {
    const std::uint64_t round = NextRound();
    EXPECT_NE(table->Find(1, round), nullptr);
    EXPECT_NE(table->Find(11, round), nullptr);
  }
  const std::uint64_t round = NextRound();
  Fill(table.get(), 12, 13, round);
  EXPECT_EQ(Present(table.get(), 13, round), "1111000011111");
}

TEST_F(MeshCacheTest, WhatThisOrTheLastRoundUsedIsNotForgottenForSomethingNew) {
  SetMaxChunks(2);
  const auto table = Table();
  std::uint64_t round = NextRound();
  Fill(table.get(), 0, 12, round);  // a third segment has no room: it is gone with its writer
  EXPECT_EQ(Present(table.get(), 12, round), "111111110000");
  round = NextRound();
  Fill(table.get(), 8, 12, round);
  EXPECT_EQ(Present(table.get(), 4, round), "1111");  // the first one is used again
  EXPECT_EQ(table->Find(8, round), nullptr) << "something of the last round was forgotten";
  round = NextRound();
  Fill(table.get(), 8, 16, round);  // the second one was last used two rounds ago
  EXPECT_EQ(Present(table.get(), 16, round), "1111000011110000");
}

// Frames over more than fits, in the same order again and again: plain LRU would never hit.
// Work ahead of frames stores in the round before that of the last frame.
TEST_F(MeshCacheTest, MeshesMadeAheadTakeNoRoomFromFrames) {
  SetMaxChunks(3);
  const auto table = Table();
  const std::uint64_t first = NextRound();
  Fill(table.get(), 0, 4, first);
  const std::uint64_t second = NextRound();
  Fill(table.get(), 4, 8, second);
  Fill(table.get(), 8, 12, second - 1);  // ahead
  EXPECT_TRUE(table->Has(8));
  EXPECT_EQ(cache_->unkept_count(), 0U);

  const std::uint64_t third = NextRound();
  Fill(table.get(), 12, 20, third);
  EXPECT_FALSE(table->Has(8)) << "the frame needed its room";
  EXPECT_TRUE(table->Has(4)) << "of the last frame";
  Fill(table.get(), 20, 24, third - 1);  // ahead
  EXPECT_FALSE(table->Has(20));
  EXPECT_EQ(cache_->unkept_count(), 1U);
  EXPECT_TRUE(table->Has(4) && table->Has(12) && table->Has(16));

  // A use in an earlier round than the last use changes nothing.
  EXPECT_NE(table->Find(12, first), nullptr);
  Fill(table.get(), 24, 28, NextRound());
  EXPECT_FALSE(table->Has(4));
  EXPECT_TRUE(table->Has(12) && table->Has(24));
}

TEST_F(MeshCacheTest, FramesOverMoreThanFitsHitOnAPart) {
  SetMaxChunks(3);
  const auto table = Table();
  for (int frame = 0; frame < 6; ++frame) {
    const std::uint64_t round = NextRound();
    MeshCache::Writer writer(cache_.get(), round);
    int hits = 0;
    for (std::size_t place = 0; place < 40; ++place) {
      const MeshPtr found = table->Find(place, round);
      if (found != nullptr) {
        EXPECT_EQ(found->block_id, place);
        ++hits;
      } else {
        writer.Store(QuarterMesh(static_cast<volume::BlockId>(place)), table.get(), place);
      }
    }
    EXPECT_EQ(hits, frame == 0 ? 0 : 12) << "frame " << frame;
  }
}

TEST_F(MeshCacheTest, ValuesLiveOnWithThoseWhoHoldThem) {
  SetMaxChunks(1);
  auto table = Table();
  std::uint64_t round = NextRound();
  Fill(table.get(), 0, 4, round);
  MeshPtr kept = table->Find(2, round);
  ASSERT_NE(kept, nullptr);
  MeshPtr never_kept = Store(QuarterMesh(20), table.get(), 20, round);
  round = NextRound(3);
  Fill(table.get(), 4, 8, round);  // in its place
  EXPECT_EQ(cache_->size_bytes(), table->size_bytes() + kChunkBytes);
  EXPECT_EQ(Present(table.get(), 21, round).substr(20), "0");
  // Others use up the pool's memory.
  std::vector<std::shared_ptr<char[]>> chunks;
  for (int i = 0; i < 40; ++i) {
    chunks.push_back(pool_->Take());
    std::fill_n(chunks.back().get(), kChunkBytes, 'x');
  }
  EXPECT_TRUE(IsMesh(*kept, QuarterMesh(2)));
  EXPECT_TRUE(IsMesh(*never_kept, QuarterMesh(20)));
  // And beyond the cache, its tables and its pool.
  const std::weak_ptr<base::MemoryPool> pool = pool_;
  chunks.clear();
  table.reset();
  cache_.reset();
  pool_.reset();
  EXPECT_TRUE(IsMesh(*kept, QuarterMesh(2)));
  EXPECT_TRUE(IsMesh(*never_kept, QuarterMesh(20)));
  kept.reset();
  EXPECT_FALSE(pool.expired());
  never_kept.reset();
  EXPECT_TRUE(pool.expired()) << "memory is lost";
}

TEST_F(MeshCacheTest, ForgottenMeshIsGoneOnceNobodyHoldsIt) {
  SetMaxChunks(1);
  const auto table = Table();
  std::uint64_t round = NextRound();
  Fill(table.get(), 0, 4, round);
  MeshPtr held = table->Find(0, round);
  round = NextRound(2);
  Fill(table.get(), 4, 8, round);
  if (const MeshPtr found = table->Find(0, round); found != nullptr) {
    EXPECT_EQ(found, held);
  }
  held.reset();
  EXPECT_EQ(Present(table.get(), 8, round), "00001111");
}

TEST_F(MeshCacheTest, MeshLargerThanAChunkIsASegmentOfItsOwn) {
  SetMaxChunks(6);
  const auto table = Table();
  const mesh::BlockMesh large = MakeMesh(1, 120'000, 360'003);
  ASSERT_GT(mesh::CompactSizeBytes(large), 3 * kChunkBytes);
  std::uint64_t round = NextRound();
  {
    MeshCache::Writer writer(cache_.get(), round);
    writer.Store(QuarterMesh(0), table.get(), 0);
    EXPECT_TRUE(IsMesh(*writer.Store(large, table.get(), 1), large));
    writer.Store(QuarterMesh(2), table.get(), 2);
  }
  const std::size_t size = cache_->size_bytes() - table->size_bytes();
  EXPECT_EQ(size, mesh::CompactSizeBytes(large) + 2 * kChunkBytes);
  ASSERT_NE(table->Find(1, round), nullptr);
  EXPECT_TRUE(IsMesh(*table->Find(1, round), large));
  // A mesh larger than the limit: drawn, but not kept, and it evicts nothing in its round.
  const mesh::BlockMesh too_large = MakeMesh(3, 300'000, 900'000);
  ASSERT_GT(mesh::CompactSizeBytes(too_large), LimitOf(6));
  EXPECT_TRUE(IsMesh(*Store(too_large, table.get(), 3, round), too_large));
  EXPECT_EQ(Present(table.get(), 4, round), "1110");
  // Nor for nothing in a later one.
  round = NextRound(3);
  Store(too_large, table.get(), 3, round);
  EXPECT_EQ(Present(table.get(), 4, round), "1110");
  EXPECT_LE(cache_->size_bytes(), LimitOf(6));
  // One that does not fit beside the old ones takes their place.
  round = NextRound(2);
  EXPECT_NE(table->Find(0, round), nullptr);
  Store(MakeMesh(4, 100'000, 300'003), table.get(), 4, round);
  EXPECT_NE(table->Find(4, round), nullptr);
  EXPECT_EQ(table->Find(1, round), nullptr);
  EXPECT_NE(table->Find(0, round), nullptr);
  EXPECT_LE(cache_->size_bytes(), LimitOf(6));
}

TEST_F(MeshCacheTest, WritersOneAfterTheOtherShareASegmentAndSideBySideDoNot) {
  SetMaxChunks(8);
  const auto table = Table();
  const std::uint64_t round = NextRound();
  for (std::size_t place = 0; place < kPlaceCount; ++place) {
    Store(MakeMesh(static_cast<volume::BlockId>(place), 20, 60), table.get(), place, round);
  }
  EXPECT_EQ(cache_->size_bytes(), table->size_bytes() + kChunkBytes);
  {
    MeshCache::Writer a(cache_.get(), round);
    MeshCache::Writer b(cache_.get(), round);
    a.Store(MakeMesh(100, 20, 60), table.get(), 0);
    b.Store(MakeMesh(101, 20, 60), table.get(), 1);
    MeshCache::Writer moved(std::move(b));
    moved.Store(MakeMesh(102, 20, 60), table.get(), 2);
  }
  EXPECT_EQ(cache_->size_bytes(), table->size_bytes() + 2 * kChunkBytes);
  for (std::size_t place = 0; place < kPlaceCount; ++place) {
    const auto id = static_cast<volume::BlockId>(place < 3 ? 100 + place : place);
    EXPECT_TRUE(IsMesh(*table->Find(place, round), MakeMesh(id, 20, 60))) << place;
  }
}

TEST_F(MeshCacheTest, NothingIsKeptWithoutBytes) {
  const auto table = Table();
  EXPECT_EQ(cache_->size_bytes(), 0U) << "not even a table";
  const std::uint64_t round = NextRound();
  {
    MeshCache::Writer writer(cache_.get(), round);
    for (std::size_t place = 0; place < 10; ++place) {
      const auto id = static_cast<volume::BlockId>(place);
      EXPECT_TRUE(IsMesh(*writer.Store(QuarterMesh(id), table.get(), place), QuarterMesh(id)));
    }
  }
  EXPECT_EQ(Present(table.get(), 10, round), "0000000000");
  EXPECT_EQ(cache_->size_bytes(), 0U);
}

TEST_F(MeshCacheTest, LowerLimitTakesEffectWithTheNextSegments) {
  SetMaxChunks(4);
  const auto table = Table();
  Fill(table.get(), 0, 16, NextRound());
  SetMaxChunks(2);
  const std::uint64_t round = NextRound(3);
  Fill(table.get(), 16, 20, round);
  EXPECT_LE(cache_->size_bytes(), LimitOf(2));
  EXPECT_EQ(Present(table.get(), 20, round).substr(16), "1111");
}

TEST_F(MeshCacheTest, TablesAreBoundedAndTheLeastRecentlyUsedForgotten) {
  const std::size_t table_bytes = MeshTable(kPlaceCount).size_bytes();
  // An eighth of it: five tables and a bit.
  const std::size_t max_bytes = 8 * (5 * table_bytes + 10);
  cache_->SetMaxBytes(max_bytes);
  std::vector<std::shared_ptr<MeshTable>> first;
  for (int i = 0; i < 5; ++i) {
    first.push_back(Table(i));
  }
  EXPECT_EQ(cache_->size_bytes(), 5 * table_bytes);
  EXPECT_EQ(Table(0), first[0]);  // 1 is the oldest now
  const auto sixth = Table(5);
  EXPECT_EQ(cache_->size_bytes(), 5 * table_bytes);
  for (const int kept : {0, 2, 3, 4}) {
    EXPECT_EQ(Table(kept), first[static_cast<std::size_t>(kept)]) << kept;
  }
  EXPECT_EQ(Table(5), sixth);
  EXPECT_NE(Table(1), first[1]);
  for (int i = 0; i < 1000; ++i) {
    Table(100 + i);
    ASSERT_LE(cache_->size_bytes(), max_bytes / 8);
  }
  // The holder of an evicted mesh can still use it.
  SetMaxChunks(2);
  const std::uint64_t round = NextRound();
  Fill(first[1].get(), 0, 4, round);
  EXPECT_EQ(Present(first[1].get(), 4, round), "1111");
}

TEST_F(MeshCacheTest, TableTooLargeForTheLimitIsMadeButNotKept) {
  const std::size_t table_bytes = MeshTable(100'000).size_bytes();
  cache_->SetMaxBytes(8 * table_bytes - 8);
  const auto table = cache_->TableOf(0, {.isovalue = 1}, 100'000);
  ASSERT_NE(table, nullptr);
  EXPECT_LE(cache_->size_bytes(), table_bytes - 1);
  const std::uint64_t round = NextRound();
  Store(QuarterMesh(5), table.get(), 99'999, round);
  EXPECT_NE(table->Find(99'999, round), nullptr);
  EXPECT_LE(cache_->size_bytes(), 8 * table_bytes);
}

// Any use, against the rules: what is found is what was stored last; segments come and go as wholes
// (meshes of one chunk of memory are one); nothing goes that this or the last round used, nothing
// while there is room, and the oldest first; what is new is kept if that makes room for it.
class Model {
 public:
  explicit Model(std::size_t max_bytes) : max_segment_bytes_(max_bytes - max_bytes / 8) {}

  struct Segment {
    std::uint64_t round = 0;
    std::size_t size_bytes = 0;
    std::map<std::size_t, volume::BlockId> meshes;  // by place
  };

  // `view`: of a mesh that was just stored and is kept.
  Segment& SegmentOf(const mesh::CompactMesh* view, std::size_t size_bytes) {
    const auto address = reinterpret_cast<std::uintptr_t>(view);
    Segment& segment = segments_[size_bytes > kChunkBytes ? address : address / kChunkBytes];
    segment.size_bytes = std::max(size_bytes, kChunkBytes);
    return segment;
  }

  // Each segment is there as a whole or not at all; drops those that are not and checks that they
  // had to go for something new of `new_bytes`.
  void DropForgotten(MeshTable* table, std::uint64_t round, std::size_t new_bytes) {
    std::uint64_t youngest_dropped = 0;
    for (auto it = segments_.begin(); it != segments_.end();) {
      Segment& segment = it->second;
      std::size_t present = 0;
      for (const auto& [place, id] : segment.meshes) {
        const MeshPtr found = table->Find(place, segment.round);  // no use: its own round
        present += found != nullptr && found->block_id == id ? 1U : 0U;
      }
      if (present == segment.meshes.size() && present > 0) {
        ++it;
        continue;
      }
      EXPECT_EQ(present, 0U) << "a part of a segment was forgotten";
      EXPECT_LT(segment.round + 1, round) << "what was just used was forgotten";
      EXPECT_GT(bytes() + new_bytes, max_segment_bytes_) << "there was room";
      youngest_dropped = std::max(youngest_dropped, segment.round);
      it = segments_.erase(it);
    }
    for (const auto& [key, segment] : segments_) {
      EXPECT_LE(youngest_dropped, segment.round) << "not the oldest was forgotten";
    }
  }

  // Returns true if a new mesh of this many bytes has to be refused.
  [[nodiscard]] bool IsFull(std::size_t new_bytes, std::uint64_t round) const {
    return bytes() + new_bytes > max_segment_bytes_ &&
           std::all_of(segments_.begin(), segments_.end(),
                       [round](const auto& entry) { return entry.second.round + 1 >= round; });
  }

  [[nodiscard]] std::size_t bytes() const {
    std::size_t sum = 0;
    for (const auto& [key, segment] : segments_) {
      sum += segment.size_bytes;
    }
    return sum;
  }

  void Use(std::size_t place, std::uint64_t round) {
    for (auto& [key, segment] : segments_) {
      if (segment.meshes.contains(place)) {
        segment.round = round;
      }
    }
  }

 private:
  const std::size_t max_segment_bytes_;
  std::map<std::uintptr_t, Segment> segments_;
};

TEST_F(MeshCacheTest, RandomUseFollowsTheRules) {
  int kept_count = 0;
  int refused_count = 0;
  int hit_count = 0;
  for (std::uint64_t seed = 0; seed < 6; ++seed) {
    const std::size_t max_bytes = LimitOf(2 + seed);
    cache_ = std::make_unique<MeshCache>(pool_);
    cache_->SetMaxBytes(max_bytes);
    Model model(max_bytes);
    // A place is stored once only: overwritten places would leave segments without a witness.
    constexpr std::size_t kPlaces = 4000;
    const auto table = cache_->TableOf(0, {.isovalue = 1}, kPlaces);
    const std::size_t table_bytes = table->size_bytes();
    ASSERT_EQ(cache_->size_bytes(), table_bytes);
    std::uint64_t round = NextRound();
    auto writer = std::make_unique<MeshCache::Writer>(cache_.get(), round);
    std::size_t next_place = 0;
    std::uint64_t counter = 0;
    const auto unit = [&] { return base::RandomUnit(seed, counter++); };
    for (int step = 0; step < 500; ++step) {
      SCOPED_TRACE(::testing::Message() << "seed " << seed << ", step " << step);
      const double what = unit();
      if (what < 0.08) {
        writer.reset();
        round = NextRound();
        writer = std::make_unique<MeshCache::Writer>(cache_.get(), round);
      } else if (what < 0.15) {
        writer = std::make_unique<MeshCache::Writer>(cache_.get(), round);
      } else if (what < 0.4 && next_place > 0) {
        // Recent ones more often.
        const double back = unit() * unit();
        const auto place =
            next_place - 1 - static_cast<std::size_t>(back * static_cast<double>(next_place));
        if (const MeshPtr found = table->Find(place, round); found != nullptr) {
          EXPECT_EQ(found->block_id, place);
          model.Use(place, round);
          ++hit_count;
        }
      } else {
        const bool is_large = unit() < 0.03;
        const auto count = static_cast<std::size_t>(is_large ? 56'000 + 28'000 * unit()
                                                             : 12'000 * unit() * unit());
        const std::size_t place = next_place++;
        const mesh::BlockMesh mesh = MakeMesh(static_cast<volume::BlockId>(place), count, count);
        const std::size_t before = cache_->size_bytes();
        MeshPtr stored = writer->Store(mesh, table.get(), place);
        ASSERT_TRUE(IsMesh(*stored, mesh));
        const mesh::CompactMesh* const view = stored.get();
        stored.reset();
        // The size of a segment for a mesh larger than a chunk.
        const std::size_t large_bytes = std::max(mesh::CompactSizeBytes(mesh), kChunkBytes);
        const bool is_kept = table->Find(place, round) != nullptr;
        model.DropForgotten(table.get(), round, large_bytes);
        if (is_kept) {
          ++kept_count;
          Model::Segment& segment = model.SegmentOf(view, large_bytes);
          segment.round = round;
          segment.meshes[place] = static_cast<volume::BlockId>(place);
        } else {
          ++refused_count;
          EXPECT_TRUE(model.IsFull(large_bytes, round) || before == cache_->size_bytes());
        }
      }
      ASSERT_EQ(cache_->size_bytes(), table_bytes + model.bytes());
      ASSERT_LE(cache_->size_bytes(), max_bytes);
      if (HasFailure()) {
        return;
      }
    }
  }
  // The use was not too simple.
  EXPECT_GT(kept_count, 200);
  EXPECT_GT(refused_count, 100);
  EXPECT_GT(hit_count, 100);
}

TEST_F(MeshCacheTest, ThreadsFindOnlyWhatBelongsToTheirPlace) {
  constexpr std::size_t kPlaces = 600;
  constexpr std::size_t kChunks = 6;
  SetMaxChunks(kChunks);
  std::atomic<int> hits{0};
  std::atomic<int> stores{0};
  const auto vertex_count_of = [](std::size_t place, double isovalue) {
    return place * 7 % 900 + static_cast<std::size_t>(isovalue);
  };
  const auto use = [&](std::uint64_t seed) {
    for (std::int64_t frame = 0; frame < 20; ++frame) {
      const double isovalue = static_cast<double>(frame / 3 % 4);
      const std::uint64_t round = cache_->BeginRound(frame);
      const auto table = cache_->TableOf(0, {.isovalue = isovalue}, kPlaces);
      std::vector<MeshCache::Writer> writers;
      writers.emplace_back(cache_.get(), round);
      writers.emplace_back(cache_.get(), round);
      std::vector<MeshPtr> held;
      for (std::uint64_t step = 0; step < 150; ++step) {
        const double dice = base::RandomUnit(seed, static_cast<std::uint64_t>(frame) * 1000 + step);
        const auto place = static_cast<std::size_t>(dice * kPlaces);
        const mesh::BlockMesh mesh = MakeMesh(static_cast<volume::BlockId>(place),
                                              vertex_count_of(place, isovalue), 3 * place);
        MeshPtr found = table->Find(place, round);
        (found != nullptr ? hits : stores).fetch_add(1);
        if (found == nullptr) {
          found = writers[step % 2].Store(mesh, table.get(), place);
        }
        ASSERT_TRUE(IsMesh(*found, mesh)) << place;
        if (step % 10 == 0) {
          held.push_back(std::move(found));
        }
      }
      EXPECT_LE(cache_->size_bytes(), LimitOf(kChunks));
      for (const MeshPtr& mesh : held) {
        ASSERT_EQ(mesh->positions.size(), vertex_count_of(mesh->block_id, isovalue));
      }
    }
  };
  std::vector<std::thread> threads;
  for (std::uint64_t seed = 0; seed < 4; ++seed) {
    threads.emplace_back(use, seed);
  }
  for (std::thread& thread : threads) {
    thread.join();
  }
  EXPECT_GT(hits.load(), 200);
  EXPECT_GT(stores.load(), 200);
  EXPECT_LE(cache_->size_bytes(), LimitOf(kChunks));
}

// The slider fills two chunks at each isovalue, and comes back over the same ones.
TEST_F(MeshCacheTest, AMovingSliderTouchesNoFreshMemory) {
  SetMaxChunks(1000);
  pool_->Populate(6 * kChunkBytes);
  std::set<const void*> places;
  for (int step = 0; step < 30; ++step) {
    const std::uint64_t round = NextRound();
    const auto table = Table(step % 15);
    Fill(table.get(), 0, 8, round);
    EXPECT_EQ(Present(table.get(), 8, round), "11111111") << step;
    for (std::size_t place = 0; place < 8; ++place) {
      places.insert(table->Find(place, round).get());
    }
  }
  EXPECT_LE(places.size(), 4 * 6U) << "four places to a chunk";
}

TEST_F(MeshCacheTest, AMovingSliderKeepsTheMeshesOfTheLastFrame) {
  SetMaxChunks(1000);
  std::shared_ptr<MeshTable> last;
  for (int step = 0; step < 10; ++step) {
    const std::uint64_t round = NextRound();
    const auto table = Table(step);
    Fill(table.get(), 0, 8, round);
    if (last != nullptr) {
      EXPECT_EQ(Present(last.get(), 8, round - 1), "11111111") << step;
    }
    last = table;
  }
}

TEST_F(MeshCacheTest, ASliderMovesWhileEachFrameHasAnotherIsovalue) {
  SetMaxChunks(4);
  const auto moves = [&](double isovalue) {
    NextRound();
    Table(isovalue);
    return cache_->is_slider_moving();
  };
  EXPECT_FALSE(moves(1)) << "the first frame";
  EXPECT_TRUE(moves(2));
  EXPECT_TRUE(moves(1)) << "backwards";
  EXPECT_FALSE(moves(1)) << "only the view moves";
  EXPECT_FALSE(moves(2));
  EXPECT_TRUE(moves(3));
}

// Users at isovalues of their own, whose views show other blocks in each frame.
TEST_F(MeshCacheTest, UsersWhoTakeTurnsKeepAllThatThereIsRoomFor) {
  for (const std::size_t user_count : {2U, 3U, 4U}) {
    pool_ = base::MemoryPool::Make();
    cache_ = std::make_unique<MeshCache>(pool_);
    SetMaxChunks(1000);
    for (std::size_t user = 0; user < user_count && user_count > 2; ++user) {
      NextRound();
      Table(static_cast<double>(user));  // three in a row look like a slider at first
    }
    for (std::size_t place = 0; place < kPlaceCount; place += 4) {
      for (std::size_t user = 0; user < user_count; ++user) {
        const std::uint64_t round = NextRound();
        Fill(Table(static_cast<double>(user)).get(), place, place + 4, round);
      }
    }
    for (std::size_t user = 0; user < user_count; ++user) {
      EXPECT_EQ(Present(Table(static_cast<double>(user)).get(), kPlaceCount, NextRound()),
                std::string(kPlaceCount, '1'))
          << "user " << user << " of " << user_count;
    }
  }
}

TEST_F(MeshCacheTest, UsersWhoTakeTurnsAreNoSlider) {
  SetMaxChunks(4);
  for (const int user_count : {2, 3, 4}) {
    const auto moves = [&](int frame) {
      NextRound();
      Table(100 * user_count + frame % user_count);
      return cache_->is_slider_moving();
    };
    for (int frame = 0; frame <= user_count; ++frame) {
      moves(frame);  // they look like one until they have come back
    }
    for (int frame = user_count + 1; frame < 20; ++frame) {
      EXPECT_FALSE(moves(frame)) << user_count << " users, frame " << frame;
    }
  }
}

TEST_F(MeshCacheTest, AUserWhoStaysDoesNotHideASlider) {
  SetMaxChunks(4);
  for (int step = 0; step < 10; ++step) {
    NextRound();
    Table(-1);
    NextRound();
    Table(step);
    EXPECT_TRUE(step == 0 || cache_->is_slider_moving()) << step;
  }
}

// The slider goes to and fro between the same isovalues. Meshes that are kept are found again.
TEST_F(MeshCacheTest, ASliderThatTurnsBackTakesLittleFreshMemory) {
  SetMaxChunks(1000);
  pool_->Populate(6 * kChunkBytes);
  std::set<const void*> places;
  for (int step = 0; step < 100; ++step) {
    const int at = step % 28;
    const std::uint64_t round = NextRound();
    const auto table = Table(at < 15 ? at : 28 - at);
    if (Present(table.get(), 8, round) != "11111111") {
      Fill(table.get(), 0, 8, round);
    }
    for (std::size_t place = 0; place < 8; ++place) {
      places.insert(table->Find(place, round).get());
    }
  }
  EXPECT_LE(places.size(), 4 * (6U + 2U)) << "more than one isovalue beyond what was touched";
}

TEST_F(MeshCacheTest, WithoutASliderTheCacheGrowsToItsBound) {
  SetMaxChunks(40);
  const auto table = Table(1);
  for (std::size_t place = 0; place < 16; ++place) {
    Fill(table.get(), place, place + 1, NextRound());  // a view that shows more and more
    NextRound();
  }
  EXPECT_EQ(Present(table.get(), 16, NextRound()), "1111111111111111");
}

TEST_F(MeshCacheTest, AnIsovalueNowAndThenIsNoSlider) {
  SetMaxChunks(40);
  std::vector<std::shared_ptr<MeshTable>> tables;
  for (int step = 0; step < 6; ++step) {
    tables.push_back(Table(step));
    Fill(tables.back().get(), 0, 8, NextRound());
    NextRound();  // the same isovalues once more
  }
  for (const auto& table : tables) {
    EXPECT_EQ(Present(table.get(), 8, NextRound()), "11111111");
  }
}

}  // namespace
}  // namespace isoscope::agent
