// Most tests use keys of one hash (OneListCacheTest), which fall into one part of the cache:
//
// - the order of eviction, within a round and across rounds;
// - the bound in bytes, for one large entry and for many small ones;
// - random use, compared with a model that follows the definition literally;
// - threads that share a cache.

#include "core/base/lru_cache.h"

#include <algorithm>
#include <atomic>
#include <cstddef>
#include <cstdint>
#include <memory>
#include <string>
#include <thread>
#include <utility>
#include <vector>

#include "gtest/gtest.h"

#include "core/base/random.h"

namespace isoscope::base {
namespace {

// Keys of one hash fall into one part of the cache, whose order is then that of the whole.
struct SameHashKey {
  int value = 0;

  friend bool operator==(const SameHashKey&, const SameHashKey&) = default;
  template <typename H>
  friend H AbslHashValue(H h, const SameHashKey& /*key*/) {
    return H::combine(std::move(h), 0);
  }
};

using OneListCache = LruCache<SameHashKey, int>;
constexpr std::size_t kMaxBytes = std::size_t{64} * 1024;

std::shared_ptr<const int> Value(int value) { return std::make_shared<const int>(value); }

// Returns the bytes of an entry without its value.
std::size_t EntryBytes() {
  OneListCache cache(kMaxBytes);
  cache.Insert({0}, Value(0), 0);
  return cache.size_bytes();
}

// Returns the bytes that fit into one list, values and entries together.
std::size_t ListBytes(std::size_t max_bytes) {
  const std::size_t entry_bytes = EntryBytes();
  std::size_t fits = 0;
  std::size_t too_much = max_bytes + 1;
  while (too_much - fits > 1) {
    const std::size_t size = fits + (too_much - fits) / 2;
    OneListCache cache(max_bytes);
    cache.Insert({0}, Value(0), size);
    (cache.Find({0}) != nullptr ? fits : too_much) = size;
  }
  return fits + entry_bytes;
}

constexpr std::uint64_t kFirstRound = 2;
// The round from which every entry of the first round is old enough to be evicted.
constexpr std::uint64_t kLaterRound = kFirstRound + 2;

class OneListCacheTest : public ::testing::Test {
 protected:
  // A size of which exactly four entries fit.
  const std::size_t quarter_ = ListBytes(kMaxBytes) / 4 - EntryBytes();
  OneListCache cache_{kMaxBytes};
};

TEST_F(OneListCacheTest, FindsWhatWasInsertedAndNothingElse) {
  EXPECT_EQ(cache_.Find({1}), nullptr);
  const auto value = Value(5);
  cache_.Insert({1}, value, 10);
  EXPECT_EQ(cache_.Find({1}), value);
  EXPECT_EQ(cache_.Find({2}), nullptr);
  EXPECT_EQ(cache_.size_bytes(), EntryBytes() + 10);
}

TEST_F(OneListCacheTest, KeyThatIsThereKeepsItsValue) {
  const auto value = Value(5);
  cache_.Insert({1}, value, 10);
  cache_.Insert({1}, Value(6), 1000);
  EXPECT_EQ(cache_.Find({1}), value);
  EXPECT_EQ(cache_.size_bytes(), EntryBytes() + 10);
}

TEST_F(OneListCacheTest, LeastRecentlyUsedIsForgottenFirst) {
  for (int key = 0; key < 4; ++key) {
    cache_.Insert({key}, Value(key), quarter_);
  }
  ASSERT_NE(cache_.Find({0}), nullptr);  // now 1 is the oldest
  cache_.SetRound(kLaterRound);
  cache_.Insert({4}, Value(4), quarter_);
  EXPECT_EQ(cache_.Find({1}), nullptr);
  for (const int key : {0, 2, 3, 4}) {
    EXPECT_NE(cache_.Find({key}), nullptr) << key;
  }
}

TEST_F(OneListCacheTest, OneLargeEntryTakesThePlaceOfSeveral) {
  for (int key = 0; key < 4; ++key) {
    cache_.Insert({key}, Value(key), quarter_);
  }
  cache_.SetRound(kLaterRound);
  cache_.Insert({4}, Value(4), 2 * quarter_ + EntryBytes());
  EXPECT_EQ(cache_.Find({0}), nullptr);
  EXPECT_EQ(cache_.Find({1}), nullptr);
  EXPECT_NE(cache_.Find({2}), nullptr);
  EXPECT_NE(cache_.Find({3}), nullptr);
  EXPECT_NE(cache_.Find({4}), nullptr);
}

TEST_F(OneListCacheTest, WhatWasUsedInThisOrTheLastRoundIsNotForgotten) {
  for (int key = 0; key < 4; ++key) {
    cache_.Insert({key}, Value(key), quarter_);
  }
  cache_.Insert({4}, Value(4), quarter_);
  EXPECT_EQ(cache_.Find({4}), nullptr) << "something of this round was forgotten";
  cache_.SetRound(kFirstRound + 1);
  cache_.Insert({4}, Value(4), quarter_);
  EXPECT_EQ(cache_.Find({4}), nullptr) << "something of the last round was forgotten";
  ASSERT_NE(cache_.Find({0}), nullptr);  // used again: kept for one more round
  cache_.SetRound(kFirstRound + 2);
  for (int key = 4; key < 8; ++key) {
    cache_.Insert({key}, Value(key), quarter_);
  }
  EXPECT_NE(cache_.Find({0}), nullptr);
  for (const int key : {1, 2, 3, 7}) {
    EXPECT_EQ(cache_.Find({key}), nullptr) << key;
  }
  for (const int key : {4, 5, 6}) {
    EXPECT_NE(cache_.Find({key}), nullptr) << key;
  }
}

// A working set larger than the cache, read in the same order each round: plain LRU would never
// hit.
TEST_F(OneListCacheTest, RoundsOverMoreThanFitsHitOnAPart) {
  for (std::uint64_t round = 0; round < 6; ++round) {
    cache_.SetRound(kFirstRound + round);
    int hits = 0;
    for (int key = 0; key < 12; ++key) {
      if (cache_.Find({key}) != nullptr) {
        ++hits;
      } else {
        cache_.Insert({key}, Value(key), quarter_);
      }
    }
    EXPECT_EQ(hits, round == 0 ? 0 : 4) << "round " << round;
  }
}

TEST_F(OneListCacheTest, WhatIsForgottenLivesOnWithThoseWhoHoldIt) {
  auto value = Value(7);
  const std::weak_ptr<const int> life = value;
  cache_.Insert({0}, std::move(value), 4 * quarter_);
  auto held = cache_.Find({0});
  ASSERT_NE(held, nullptr);
  cache_.SetRound(kLaterRound);
  cache_.Insert({1}, Value(1), 4 * quarter_);
  ASSERT_EQ(cache_.Find({0}), nullptr);
  EXPECT_EQ(*held, 7);
  held.reset();
  EXPECT_TRUE(life.expired()) << "the cache still holds what it forgot";
}

TEST_F(OneListCacheTest, AnotherLimitHoldsFromTheNextInsertionOn) {
  for (int key = 0; key < 4; ++key) {
    cache_.Insert({key}, Value(key), quarter_);
  }
  cache_.SetMaxBytes(kMaxBytes / 2);
  EXPECT_NE(cache_.Find({0}), nullptr) << "nothing was inserted yet";
  cache_.SetRound(kLaterRound);
  cache_.Insert({4}, Value(4), quarter_ - EntryBytes());
  for (const int key : {1, 2, 3}) {
    EXPECT_EQ(cache_.Find({key}), nullptr) << key;
  }
  EXPECT_NE(cache_.Find({0}), nullptr);
  EXPECT_NE(cache_.Find({4}), nullptr);
  cache_.SetMaxBytes(kMaxBytes);
  cache_.Insert({5}, Value(5), quarter_);
  cache_.Insert({6}, Value(6), quarter_);
  for (const int key : {0, 4, 5, 6}) {
    EXPECT_NE(cache_.Find({key}), nullptr) << key;
  }
}

// A cache of one part keeps a value as large as the whole; keys of any hash share the bound.
TEST(LruCacheTest, OnePartHoldsWhatAllPartsTogetherHold) {
  LruCache<int, int, 1> cache(kMaxBytes);
  const std::size_t large = kMaxBytes - EntryBytes() - 100;
  cache.Insert(1, Value(1), large);
  EXPECT_NE(cache.Find(1), nullptr);
  EXPECT_GT(cache.size_bytes(), large);
  EXPECT_LE(cache.size_bytes(), kMaxBytes);
  cache.SetRound(kLaterRound);
  for (int key = 2; key < 200; ++key) {
    cache.Insert(key, Value(key), 100);
    EXPECT_NE(cache.Find(key), nullptr) << key;
    EXPECT_LE(cache.size_bytes(), kMaxBytes);
  }
  EXPECT_EQ(cache.Find(1), nullptr);
  LruCache<int, int> parted(kMaxBytes);
  parted.Insert(1, Value(1), large);
  EXPECT_EQ(parted.Find(1), nullptr);
}

// Keys spread over the parts: many small values reach the whole bound, not that of one part.
TEST(LruCacheTest, KeysSpreadOverAllParts) {
  LruCache<int, int> cache(kMaxBytes);
  for (int key = 0; key < 20'000; ++key) {
    cache.Insert(key, Value(key), 0);
  }
  EXPECT_GT(cache.size_bytes(), kMaxBytes / 16 * 15);
}

TEST(LruCacheTest, NothingIsKeptWithoutRoom) {
  OneListCache cache(0);
  cache.Insert({1}, Value(1), 0);
  EXPECT_EQ(cache.Find({1}), nullptr);
  EXPECT_EQ(cache.size_bytes(), 0U);

  OneListCache small(kMaxBytes);
  small.Insert({1}, Value(1), kMaxBytes);
  EXPECT_EQ(small.Find({1}), nullptr);
  EXPECT_EQ(small.size_bytes(), 0U);
}

TEST(LruCacheTest, BytesOfManyKeysStayBoundedAndUseMostOfTheRoom) {
  LruCache<int, int> cache(kMaxBytes);
  for (int key = 0; key < 20'000; ++key) {
    cache.SetRound(kFirstRound + static_cast<std::uint64_t>(key / 100));
    cache.Insert(key, Value(key), static_cast<std::size_t>(key % 61));
    ASSERT_LE(cache.size_bytes(), kMaxBytes) << key;
  }
  EXPECT_GT(cache.size_bytes(), kMaxBytes / 2);
}

// A model that follows the definition of the cache literally.
class Model {
 public:
  Model(std::size_t max_bytes, std::size_t entry_bytes)
      : max_bytes_(max_bytes), entry_bytes_(entry_bytes) {}

  void SetMaxBytes(std::size_t max_bytes) { max_bytes_ = max_bytes; }
  void SetRound(std::uint64_t round) { round_ = round; }
  int Find(int key) {
    const auto found = Place(key);
    if (found == entries_.end()) {
      return -1;
    }
    found->round = round_;
    const int value = found->value;
    std::rotate(found, found + 1, entries_.end());
    return value;
  }
  void Insert(int key, int value, std::size_t size) {
    size += entry_bytes_;
    if (size > max_bytes_ || Place(key) != entries_.end()) {
      return;
    }
    while (size_bytes() + size > max_bytes_) {
      if (entries_.front().round + 1 >= round_) {
        return;
      }
      entries_.erase(entries_.begin());
    }
    entries_.push_back({key, value, size, round_});
  }
  [[nodiscard]] std::size_t size_bytes() const {
    std::size_t sum = 0;
    for (const Entry& entry : entries_) {
      sum += entry.size;
    }
    return sum;
  }

 private:
  struct Entry {
    int key;
    int value;
    std::size_t size;
    std::uint64_t round;
  };
  std::vector<Entry>::iterator Place(int key) {
    return std::find_if(entries_.begin(), entries_.end(),
                        [key](const Entry& entry) { return entry.key == key; });
  }

  std::size_t max_bytes_;
  const std::size_t entry_bytes_;
  std::uint64_t round_ = kFirstRound;
  std::vector<Entry> entries_;  // the last used last
};

TEST(LruCacheTest, RandomUseIsThatOfTheModel) {
  const std::size_t entry_bytes = EntryBytes();
  const std::size_t list_bytes = ListBytes(kMaxBytes);
  for (std::uint64_t seed = 0; seed < 40; ++seed) {
    OneListCache cache(kMaxBytes);
    Model model(list_bytes, entry_bytes);
    std::uint64_t round = kFirstRound;
    int hits = 0;
    for (std::uint64_t step = 0; step < 1500; ++step) {
      const double what = RandomUnit(seed, 3 * step);
      const int key = static_cast<int>(30 * RandomUnit(seed, 3 * step + 1));
      if (what < 0.03) {
        // Rounds may overlap: sometimes the next one is an earlier one.
        round = what < 0.005 && round > kFirstRound ? round - 1 : round + 1;
        cache.SetRound(round);
        model.SetRound(round);
      } else if (what < 0.5) {
        const auto found = cache.Find({key});
        const int value = found == nullptr ? -1 : *found;
        ASSERT_EQ(value, model.Find(key)) << "seed " << seed << ", step " << step;
        hits += value >= 0 ? 1 : 0;
      } else {
        const int value = static_cast<int>(step);
        // Some do not fit at all.
        const double share = RandomUnit(seed, 3 * step + 2);
        const auto size =
            static_cast<std::size_t>(1.02 * share * share * static_cast<double>(list_bytes));
        cache.Insert({key}, Value(value), size);
        model.Insert(key, value, size);
      }
      ASSERT_EQ(cache.size_bytes(), model.size_bytes()) << "seed " << seed << ", step " << step;
    }
    EXPECT_GT(hits, 20) << "seed " << seed;
  }
}

TEST(LruCacheTest, ThreadsFindOnlyWhatBelongsToTheirKey) {
  LruCache<int, std::string> cache(kMaxBytes);
  std::atomic<int> hits{0};
  const auto use = [&](std::uint64_t seed) {
    for (std::uint64_t step = 0; step < 5000; ++step) {
      const int key = static_cast<int>(400 * RandomUnit(seed, step));
      cache.SetRound(kFirstRound + step / 50);
      if (const auto found = cache.Find(key); found != nullptr) {
        EXPECT_EQ(*found, std::to_string(key));
        ++hits;
      } else {
        cache.Insert(key, std::make_shared<const std::string>(std::to_string(key)),
                     static_cast<std::size_t>(key));
      }
      if (step % 500 == 0) {
        EXPECT_LE(cache.size_bytes(), kMaxBytes);
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
  EXPECT_GT(hits, 0);
}

}  // namespace
}  // namespace isoscope::base
