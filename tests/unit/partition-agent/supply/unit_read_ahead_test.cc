#include "partition-agent/supply/unit_read_ahead.h"

#include <cstddef>
#include <cstdint>
#include <optional>
#include <string>
#include <vector>

#include "absl/status/status.h"
#include "gmock/gmock.h"
#include "gtest/gtest.h"

#include "core/base/cancellation.h"
#include "core/base/mutex.h"
#include "core/store/sample_reader.h"

namespace isoscope::agent {
namespace {

using ::testing::UnorderedElementsAre;

// Writes down which units are read, by x. Unit 7 can't be read; reads of unit 8 wait for their end.
class Notes final : public store::SampleReader {
 public:
  explicit Notes(std::size_t max_ahead) : max_ahead_(max_ahead) {}

  [[nodiscard]] absl::Status ReadUnit(const math::Index3& unit,
                                      const base::Cancellation& cancellation) const override {
    {
      const base::MutexLock lock(&mutex_);
      read_.push_back(unit.x);
      changed_.SignalAll();
    }
    if (unit.x == 7) {
      return absl::UnavailableError("no answer");
    }
    return unit.x == 8
               ? base::AwaitOrCancelled(cancellation, &mutex_, &changed_, [] { return false; })
               : absl::OkStatus();
  }
  // Waits until so many reads have begun.
  std::vector<std::int64_t> AwaitReads(std::size_t count) const {
    const base::MutexLock lock(&mutex_);
    changed_.Await(&mutex_,
                   [&]() ABSL_SHARED_LOCKS_REQUIRED(mutex_) { return read_.size() >= count; });
    return read_;
  }
  std::vector<std::int64_t> reads() const {
    const base::MutexLock lock(&mutex_);
    return read_;
  }

  [[nodiscard]] absl::Status ReadBlock(volume::BlockId /*id*/,
                                       const base::Cancellation& /*cancellation*/,
                                       char* /*out*/) const override {
    return absl::OkStatus();
  }
  [[nodiscard]] math::Index3 UnitOf(volume::BlockId /*id*/) const override { return {0, 0, 0}; }
  [[nodiscard]] absl::Status Doubt(volume::BlockId /*id*/) const override {
    return absl::OkStatus();
  }
  [[nodiscard]] bool HasUnit(const math::Index3& /*unit*/) const override { return false; }
  [[nodiscard]] std::size_t max_units_ahead() const override { return max_ahead_; }
  [[nodiscard]] const std::string& name() const override { return name_; }
  [[nodiscard]] bool is_local() const override { return false; }

 private:
  const std::string name_ = "http://localhost/a.zarr";
  const std::size_t max_ahead_;
  mutable base::Mutex mutex_;
  mutable base::CondVar changed_;
  mutable std::vector<std::int64_t> read_ ABSL_GUARDED_BY(mutex_);
};

std::vector<UnitReadAhead::Unit> UnitsOf(const Notes& notes,
                                         const std::vector<std::int64_t>& numbers) {
  std::vector<UnitReadAhead::Unit> units;
  for (const std::int64_t number : numbers) {
    units.push_back({.reader = &notes, .index = {number, 0, 0}});
  }
  return units;
}

TEST(UnitReadAheadTest, StaysWithinItsBoundAheadOfTheirUse) {
  const Notes notes(3);
  const base::Cancellation never;
  {
    UnitReadAhead ahead(UnitsOf(notes, {0, 1, 2, 3, 4, 5}), never);
    EXPECT_THAT(notes.AwaitReads(3), UnorderedElementsAre(0, 1, 2));
    ahead.HasUsed(2);
    EXPECT_THAT(notes.AwaitReads(5), UnorderedElementsAre(0, 1, 2, 3, 4));
    ahead.HasUsed(1);  // an arrival of before
    ahead.HasUsed(2);
  }
  EXPECT_EQ(notes.reads().size(), 5U);
}

TEST(UnitReadAheadTest, ReadsAllWhenAllAreUsed) {
  const Notes notes(1);
  const base::Cancellation never;
  UnitReadAhead ahead(UnitsOf(notes, {0, 1, 2, 3, 4, 5}), never);
  ahead.HasUsed(6);
  EXPECT_THAT(notes.AwaitReads(6), UnorderedElementsAre(0, 1, 2, 3, 4, 5));
}

TEST(UnitReadAheadTest, ReadsNothingWithoutRoomOrUnits) {
  const Notes notes(0);
  const base::Cancellation never;
  UnitReadAhead(UnitsOf(notes, {0, 1}), never).HasUsed(1);
  UnitReadAhead({}, never).HasUsed(1);
  EXPECT_TRUE(notes.reads().empty());
}

TEST(UnitReadAheadTest, StopsAfterAnError) {
  const Notes notes(1);  // one thread
  const base::Cancellation never;
  {
    UnitReadAhead ahead(UnitsOf(notes, {0, 7, 1, 2}), never);
    ahead.HasUsed(1);
    notes.AwaitReads(2);
    ahead.HasUsed(4);
  }
  EXPECT_THAT(notes.reads(), ::testing::ElementsAre(0, 7));
}

TEST(UnitReadAheadTest, EndsReadsUnderWay) {
  const Notes notes(2);
  base::Cancellation cancellation;
  {
    const UnitReadAhead ahead(UnitsOf(notes, {8, 0}), cancellation);
    notes.AwaitReads(2);
  }  // or the test hangs
  {
    std::optional<UnitReadAhead> ahead(std::in_place, UnitsOf(notes, {8, 8, 0}), cancellation);
    notes.AwaitReads(4);
    cancellation.Cancel();
    ahead->HasUsed(3);
  }
  EXPECT_EQ(notes.reads().size(), 4U);
}

}  // namespace
}  // namespace isoscope::agent
