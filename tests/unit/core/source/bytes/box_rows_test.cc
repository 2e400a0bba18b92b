#include "core/source/bytes/box_rows.h"

#include <cstring>
#include <string>
#include <utility>
#include <vector>

#include "gmock/gmock.h"
#include "gtest/gtest.h"

#include "tests/support/draws.h"
#include "tests/support/status_matchers.h"
#include "tests/support/volume_files.h"

namespace isoscope::source {
namespace {

// Any box is what brute force cuts, and runs are within 4 times the samples of the box.
TEST(BoxRowsTest, BoxesAreThoseOfBruteForce) {
  testing::Dice dice(testing::DrawSeed());
  for (int i = 0; i < 500; ++i) {
    const math::Index3 whole{dice.Whole(1, 30), dice.Whole(1, 9), dice.Whole(1, 9)};
    const auto size = static_cast<std::size_t>(dice.Whole(1, 8));
    std::string samples(static_cast<std::size_t>(math::Volume(whole)) * size, '\0');
    for (char& byte : samples) {
      byte = static_cast<char>(dice.Bits());
    }
    math::IndexBox box;
    for (int axis = 0; axis < 3; ++axis) {
      box.begin[axis] = dice.Whole(0, whole[axis] - 1);
      box.end[axis] = dice.Whole(box.begin[axis] + 1, whole[axis]);
    }
    std::string expected;
    for (std::int64_t z = box.begin.z; z < box.end.z; ++z) {
      for (std::int64_t y = box.begin.y; y < box.end.y; ++y) {
        for (std::int64_t x = box.begin.x; x < box.end.x; ++x) {
          const auto at = static_cast<std::size_t>((z * whole.y + y) * whole.x + x);
          expected += samples.substr(at * size, size);
        }
      }
    }
    std::string found(expected.size(), '\0');
    std::size_t read = 0;
    ISOSCOPE_ASSERT_OK(ReadBoxRows(whole, box, size, found.data(),
                                   [&](std::int64_t first, std::size_t count, char* out) {
                                     const auto at = static_cast<std::size_t>(first) * size;
                                     EXPECT_LE(at + count * size, samples.size());
                                     std::memcpy(out, samples.data() + at, count * size);
                                     read += count * size;
                                     return absl::OkStatus();
                                   }));
    ASSERT_EQ(found, expected);
    ASSERT_LE(read, 4 * expected.size());
  }
}

TEST(BoxRowsTest, TellsTheErrorOfARead) {
  std::vector<char> out(64);
  EXPECT_THAT(ReadBoxRows({4, 4, 4}, {{0, 0, 0}, {4, 4, 4}}, 1, out.data(),
                          [](std::int64_t first, std::size_t, char*) {
                            return first == 16 ? absl::DataLossError("cut") : absl::OkStatus();
                          }),
              testing::StatusIs(absl::StatusCode::kDataLoss));
}

}  // namespace
}  // namespace isoscope::source
