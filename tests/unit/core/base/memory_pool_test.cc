#include "core/base/memory_pool.h"

#include <algorithm>
#include <cstddef>
#include <cstdint>
#include <cstring>
#include <memory>
#include <set>
#include <thread>
#include <utility>
#include <vector>

#include "gtest/gtest.h"

#include "core/base/memory_info.h"

namespace isoscope::base {
namespace {

constexpr std::size_t kChunkBytes = MemoryPool::kChunkBytes;
using Chunk = std::shared_ptr<char[]>;

bool IsFilledWith(const Chunk& chunk, char value) {
  return std::all_of(chunk.get(), chunk.get() + kChunkBytes,
                     [value](char byte) { return byte == value; });
}

std::set<const char*> PlacesOf(const std::vector<Chunk>& chunks) {
  std::set<const char*> places;
  for (const Chunk& chunk : chunks) {
    places.insert(chunk.get());
  }
  return places;
}

TEST(MemoryPoolTest, ChunksAreAlignedWholeAndApart) {
  const auto pool = MemoryPool::Make();
  std::vector<Chunk> chunks;
  // More than the kernel is asked for at a time.
  for (int i = 0; i < 70; ++i) {
    chunks.push_back(pool->Take());
    ASSERT_NE(chunks.back(), nullptr);
    EXPECT_EQ(reinterpret_cast<std::uintptr_t>(chunks.back().get()) % 64, 0U);
    std::memset(chunks.back().get(), i, kChunkBytes);
  }
  EXPECT_EQ(PlacesOf(chunks).size(), chunks.size());
  for (std::size_t i = 0; i < chunks.size(); ++i) {
    EXPECT_TRUE(IsFilledWith(chunks[i], static_cast<char>(i))) << i;
  }
}

TEST(MemoryPoolTest, ChunksThatCameBackAreTakenBeforeTheKernelsMemory) {
  const auto pool = MemoryPool::Make();
  std::vector<Chunk> first;
  for (int i = 0; i < 40; ++i) {
    first.push_back(pool->Take());
  }
  std::set<const char*> returned;
  for (std::size_t i = 0; i < first.size(); i += 2) {
    returned.insert(first[i].get());
    first[i].reset();
  }
  std::vector<Chunk> second;
  for (std::size_t i = 0; i < returned.size(); ++i) {
    second.push_back(pool->Take());
  }
  EXPECT_EQ(PlacesOf(second), returned);
}

TEST(MemoryPoolTest, ChunkComesBackWithItsLastReference) {
  const auto pool = MemoryPool::Make();
  Chunk chunk = pool->Take();
  const char* const place = chunk.get();
  // Some holders keep a part of a chunk only.
  std::shared_ptr<const char> part(chunk, chunk.get() + 100);
  chunk.reset();
  EXPECT_NE(pool->Take().get(), place) << "somebody still holds a part of it";
  part.reset();
  EXPECT_EQ(pool->Take().get(), place);
}

TEST(MemoryPoolTest, ChunksKeepTheirPoolAlive) {
  auto pool = MemoryPool::Make();
  const std::weak_ptr<MemoryPool> life = pool;
  Chunk chunk = pool->Take();
  pool.reset();
  std::memset(chunk.get(), 7, kChunkBytes);
  EXPECT_TRUE(IsFilledWith(chunk, 7));
  EXPECT_FALSE(life.expired());
  chunk.reset();
  EXPECT_TRUE(life.expired()) << "the memory is never given back";
}

// ThreadSanitizer keeps several bytes for each that is written.
#if !defined(__SANITIZE_THREAD__)
TEST(MemoryPoolTest, PopulatedMemoryIsResidentBeforeItIsTaken) {
  constexpr std::size_t kBytes = 64 * kChunkBytes;
  constexpr std::size_t kSlack = kBytes / 4;  // for other memory of the process
  auto pool = MemoryPool::Make();
  const std::size_t before = ResidentBytes();
  pool->Populate(kBytes);
  const std::size_t populated = ResidentBytes();
  EXPECT_GE(populated + kSlack, before + kBytes);
  std::vector<Chunk> chunks;
  for (std::size_t i = 0; i < kBytes / kChunkBytes; ++i) {
    chunks.push_back(pool->Take());
    std::memset(chunks.back().get(), 1, kChunkBytes);
  }
  EXPECT_LE(ResidentBytes(), populated + kSlack) << "chunks were not taken from what is there";
  chunks.clear();
  pool.reset();
  EXPECT_LE(ResidentBytes(), before + kSlack) << "the end of the pool did not unmap it";
}
#endif

TEST(MemoryPoolTest, TellsHowMuchCanBeTakenWithoutFreshMemory) {
  const auto pool = MemoryPool::Make();
  EXPECT_EQ(pool->touched_free_bytes(), 0U);
  pool->Populate(3 * kChunkBytes);
  EXPECT_EQ(pool->touched_free_bytes(), 4 * kChunkBytes) << "a large page is two chunks";
  std::vector<Chunk> chunks;
  for (int i = 0; i < 4; ++i) {
    chunks.push_back(pool->Take());
  }
  EXPECT_EQ(pool->touched_free_bytes(), 0U);
  chunks.push_back(pool->Take());
  EXPECT_EQ(pool->touched_free_bytes(), kChunkBytes) << "whoever fills it touches both";
  chunks.clear();
  EXPECT_EQ(pool->touched_free_bytes(), 6 * kChunkBytes);
}

// Breaks if a page is always taken as chunks of one size.
TEST(MemoryPoolTest, SmallerChunksDivideALargePage) {
  constexpr std::size_t kSmallBytes = kChunkBytes / 16;
  const auto pool = MemoryPool::Make(kSmallBytes);
  EXPECT_EQ(pool->chunk_bytes(), kSmallBytes);
  std::vector<Chunk> chunks;
  chunks.push_back(pool->Take());
  EXPECT_EQ(pool->touched_free_bytes(), 31 * kSmallBytes) << "a large page is 32 chunks";
  // More than the kernel is asked for at a time.
  for (int i = 1; i < 1000; ++i) {
    chunks.push_back(pool->Take());
  }
  for (std::size_t i = 0; i < chunks.size(); ++i) {
    std::memset(chunks[i].get(), static_cast<int>(i % 100), kSmallBytes);
  }
  EXPECT_EQ(PlacesOf(chunks).size(), chunks.size());
  for (std::size_t i = 0; i < chunks.size(); ++i) {
    const char value = static_cast<char>(i % 100);
    ASSERT_TRUE(std::all_of(chunks[i].get(), chunks[i].get() + kSmallBytes, [value](char byte) {
      return byte == value;
    })) << i;
  }
  const std::size_t free_bytes = pool->touched_free_bytes();
  pool->Populate(1);
  EXPECT_EQ(pool->touched_free_bytes(), free_bytes + 32 * kSmallBytes);
  chunks.clear();
  EXPECT_EQ(pool->touched_free_bytes(), free_bytes + 1032 * kSmallBytes);
}

TEST(MemoryPoolTest, PopulatingNothingTakesNothing) {
  const auto pool = MemoryPool::Make();
  pool->Populate(0);
  EXPECT_NE(pool->Take(), nullptr);
}

TEST(MemoryPoolTest, ThreadsNeverShareAChunk) {
  const auto pool = MemoryPool::Make();
  const auto use = [&pool](int thread) {
    std::vector<Chunk> held;
    for (int step = 0; step < 200; ++step) {
      const char mark = static_cast<char>(16 * thread + step % 16);
      held.push_back(pool->Take());
      Chunk& chunk = held.back();
      // Both ends and the middle: enough to see another thread's marks.
      for (const std::size_t at : {std::size_t{0}, kChunkBytes / 2, kChunkBytes - 1}) {
        chunk[static_cast<std::ptrdiff_t>(at)] = mark;
      }
      std::this_thread::yield();
      for (const std::size_t at : {std::size_t{0}, kChunkBytes / 2, kChunkBytes - 1}) {
        ASSERT_EQ(chunk[static_cast<std::ptrdiff_t>(at)], mark);
      }
      if (held.size() == 5) {
        held.clear();
      }
    }
  };
  std::vector<std::thread> threads;
  for (int thread = 0; thread < 4; ++thread) {
    threads.emplace_back(use, thread);
  }
  for (std::thread& thread : threads) {
    thread.join();
  }
}

}  // namespace
}  // namespace isoscope::base
