#include "core/indexed/unit_cache.h"

#include <atomic>
#include <cstring>
#include <memory>
#include <string>
#include <thread>
#include <vector>

#include "absl/time/clock.h"
#include "gmock/gmock.h"
#include "gtest/gtest.h"
#include "oneapi/tbb/parallel_for.h"

#include "core/base/cancellation.h"
#include "core/base/random.h"
#include "tests/support/status_matchers.h"

namespace isoscope::indexed {
namespace {

using ::isoscope::testing::StatusIs;

const base::Cancellation kNever;

absl::Status Fill(std::int64_t unit, std::size_t size, char* out) {
  std::memset(out, static_cast<int>(unit % 251), size);
  return absl::OkStatus();
}

TEST(UnitCacheTest, MakesAUnitOnceAndDropsTheOldest) {
  UnitCache cache(7000);  // 4000 are kept beside one in the making
  const auto get = [&](std::int64_t unit) {
    return cache.Get({1, unit}, 1000, 0, kNever,
                     [unit](char* out) { return Fill(unit, 1000, out); });
  };
  for (const std::int64_t unit : {0, 1, 2, 3, 0, 1, 2, 3}) {
    ISOSCOPE_ASSERT_OK_AND_ASSIGN(const auto bytes, get(unit));
    EXPECT_EQ(*bytes, std::string(1000, static_cast<char>(unit)));
  }
  EXPECT_EQ(cache.made_count(), 4);
  EXPECT_EQ(cache.kept_bytes(), 4000U);
  ISOSCOPE_ASSERT_OK(get(0).status());  // 1 is the oldest now
  ISOSCOPE_ASSERT_OK(get(4).status());
  EXPECT_EQ(cache.made_count(), 5);
  EXPECT_EQ(cache.kept_bytes(), 4000U);
  ISOSCOPE_ASSERT_OK(get(0).status());
  EXPECT_EQ(cache.made_count(), 5);
  ISOSCOPE_ASSERT_OK(get(1).status());
  EXPECT_EQ(cache.made_count(), 6);
}

// Symptom: a source that was back as it was stayed DATA_LOSS, because its unit was kept.
TEST(UnitCacheTest, ADoubtfulUnitIsMadeAgainButNotAtOnce) {
  UnitCache cache(8000);
  const auto get = [&](std::int64_t unit) {
    return cache.Get({1, unit}, 10, 0, kNever, [](char* out) { return Fill(1, 10, out); }).status();
  };
  cache.Doubt({1, 1});  // is not kept
  ISOSCOPE_ASSERT_OK(get(1));
  ISOSCOPE_ASSERT_OK(get(2));
  cache.Doubt({1, 1});
  absl::SleepFor(UnitCache::kDoubtfulLife);
  ISOSCOPE_ASSERT_OK(get(2));
  EXPECT_EQ(cache.made_count(), 2);
  ISOSCOPE_ASSERT_OK(get(1));
  EXPECT_EQ(cache.made_count(), 3);
  EXPECT_EQ(cache.kept_bytes(), 20U);
  for (int i = 0; i < 100; ++i) {  // each of its blocks
    cache.Doubt({1, 2});
  }
  cache.Doubt({1, 1});
  ISOSCOPE_ASSERT_OK(get(1));
  EXPECT_LE(cache.made_count(), 4);
}

TEST(UnitCacheTest, AnErrorIsNotKept) {
  UnitCache cache(8000);
  const auto fail = [](char*) { return absl::UnavailableError("now"); };
  EXPECT_THAT(cache.Get({1, 1}, 10, 0, kNever, fail), StatusIs(absl::StatusCode::kUnavailable));
  ISOSCOPE_EXPECT_OK(
      cache.Get({1, 1}, 10, 0, kNever, [](char* out) { return Fill(1, 10, out); }).status());
}

TEST(UnitCacheTest, RefusesWhatItHasNoRoomFor) {
  UnitCache cache(8000);
  const auto make = [](char* out) { return Fill(1, 10, out); };
  ISOSCOPE_EXPECT_OK(cache.Get({1, 1}, 10, 1333, kNever, make).status());
  EXPECT_THAT(cache.Get({1, 2}, 1334, 0, kNever, make),
              StatusIs(absl::StatusCode::kResourceExhausted));
}

// A thread that waits for the unit of another one: it learns of an error, makes the unit itself if
// the other one was cancelled, and can be cancelled.
TEST(UnitCacheTest, WhoWaitsGetsWhatTheMakerGot) {
  UnitCache cache(8000);
  base::Cancellation given_up;
  for (const absl::Status& end : {absl::OkStatus(), absl::UnavailableError("no answer"),
                                  absl::CancelledError("the frame"), absl::OkStatus()}) {
    static std::int64_t unit = 0;
    ++unit;
    const bool is_last = unit == 4;
    std::atomic<int> made{0};
    std::atomic<bool> may_end{false};
    std::atomic<bool> has_begun{false};
    const auto make = [&](char* out) {
      if (++made > 1) {
        return Fill(unit, 10, out);
      }
      has_begun = true;
      may_end.wait(false);
      return end.ok() ? Fill(unit, 10, out) : end;
    };
    std::thread maker([&] { EXPECT_EQ(cache.Get({1, unit}, 10, 0, kNever, make).status(), end); });
    while (!has_begun) {
      std::this_thread::yield();
    }
    EXPECT_TRUE(cache.Has({1, unit}));
    absl::StatusOr<std::shared_ptr<const std::string>> got;
    std::thread waiter([&] {
      got = cache.Get({1, unit}, 10, 0, is_last ? given_up : kNever, make);
    });
    if (is_last) {
      given_up.Cancel();
      waiter.join();  // before the maker has ended
      EXPECT_THAT(got, StatusIs(absl::StatusCode::kCancelled));
    }
    may_end = true;
    may_end.notify_all();
    maker.join();
    if (is_last) {
      continue;
    }
    waiter.join();
    if (absl::IsUnavailable(end) && made == 1) {
      EXPECT_EQ(got.status(), end);
    } else {
      ISOSCOPE_ASSERT_OK(got.status());
      EXPECT_EQ(**got, std::string(10, static_cast<char>(unit)));
    }
    EXPECT_EQ(cache.Has({1, unit}), got.ok());
  }
}

// Many threads, which compute in parallel while they make units, and little room.
TEST(UnitCacheTest, ThreadsMakeEachUnitOnce) {
  UnitCache ample(1 << 20);
  UnitCache scarce(3 * 2 * 1000);
  for (UnitCache* cache : {&ample, &scarce}) {
    std::atomic<int> wrong{0};
    std::atomic<int> under_way{0};
    std::atomic<int> most{0};
    const auto read = [&](std::int64_t i) {
      const auto unit =
          static_cast<std::int64_t>(base::RandomBits(3, static_cast<std::uint64_t>(i)) % 20);
      const auto bytes = cache->Get({1, unit}, 1000, 0, kNever, [&](char* out) {
        const int now = ++under_way;
        for (int before = most; before < now && !most.compare_exchange_weak(before, now);) {
        }
        tbb::parallel_for(
            0, 10, [&](int part) { std::memset(out + 100 * part, static_cast<int>(unit), 100); });
        --under_way;
        return absl::OkStatus();
      });
      wrong += bytes.ok() && **bytes == std::string(1000, static_cast<char>(unit)) ? 0 : 1;
    };
    std::vector<std::thread> threads;
    for (std::int64_t thread = 0; thread < 4; ++thread) {
      threads.emplace_back([&, thread] {
        tbb::parallel_for(std::int64_t{0}, std::int64_t{500},
                          [&](std::int64_t i) { read(1000 * thread + i); });
      });
    }
    for (std::thread& thread : threads) {
      thread.join();
    }
    EXPECT_EQ(wrong, 0);
    if (cache == &ample) {
      EXPECT_EQ(cache->made_count(), 20);
    } else {
      EXPECT_EQ(most, 1);  // room for one in the making
      EXPECT_LE(cache->kept_bytes(), 3000U);
    }
  }
}

}  // namespace
}  // namespace isoscope::indexed
