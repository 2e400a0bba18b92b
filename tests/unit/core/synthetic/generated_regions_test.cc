#include "core/synthetic/generated_regions.h"

#include <cstddef>
#include <set>
#include <string>
#include <vector>

#include "gmock/gmock.h"
#include "gtest/gtest.h"

#include "tests/support/status_matchers.h"

namespace isoscope::source {
namespace {

constexpr int kSide = 48;

double CoordinateAt(int i) { return (2.0 * i - (kSide - 1)) / (kSide - 1); }

// The labels of a cube of samples, x fastest.
std::vector<int> LabelsOf(const GeneratedRegions& regions) {
  std::vector<int> labels;
  for (int z = 0; z < kSide; ++z) {
    for (int y = 0; y < kSide; ++y) {
      for (int x = 0; x < kSide; ++x) {
        labels.push_back(regions.At({CoordinateAt(x), CoordinateAt(y), CoordinateAt(z)}));
      }
    }
  }
  return labels;
}

TEST(GeneratedRegionsTest, EveryRegionHasItsShareOfTheBallForManySeeds) {
  for (std::uint64_t seed = 0; seed < 20; ++seed) {
    const GeneratedRegions regions(seed, 12);
    std::vector<int> counts(13);
    for (const int label : LabelsOf(regions)) {
      ASSERT_GE(label, 0);
      ASSERT_LE(label, 12);
      ++counts[static_cast<std::size_t>(label)];
    }
    // The ball has some 40000 samples, so an eleventh of what is around the core has some 3400.
    for (std::size_t label = 1; label <= 12; ++label) {
      EXPECT_GT(counts[label], 500) << "label " << label << ", seed " << seed;
    }
  }
}

TEST(GeneratedRegionsTest, CoreIsABallWithinTheCellsAndTheOutsideIsZero) {
  const GeneratedRegions regions(1, 12);
  for (const math::Vec3d& along : {math::Vec3d{1, 0, 0}, {0, -1, 0}, {0, 0, 1}, {0.6, 0, -0.8}}) {
    EXPECT_EQ(regions.At(along * 0.0), 1);
    EXPECT_EQ(regions.At(along * 0.3499), 1);
    EXPECT_GE(regions.At(along * 0.3501), 2);
    EXPECT_GE(regions.At(along * 0.8999), 2);
    EXPECT_EQ(regions.At(along * 0.9001), 0);
  }
}

TEST(GeneratedRegionsTest, ThreeAndFourRegionsMeetInCells) {
  const std::vector<int> labels = LabelsOf(GeneratedRegions(1, 12));
  std::vector<int> cells(9);  // by their number of regions
  for (int z = 0; z + 1 < kSide; ++z) {
    for (int y = 0; y + 1 < kSide; ++y) {
      for (int x = 0; x + 1 < kSide; ++x) {
        std::set<int> found;
        for (int corner = 0; corner < 8; ++corner) {
          const int at = ((z + corner / 4) * kSide + y + corner / 2 % 2) * kSide + x + corner % 2;
          found.insert(labels[static_cast<std::size_t>(at)]);
        }
        found.erase(0);
        ++cells[found.size()];
      }
    }
  }
  EXPECT_GT(cells[2], 1000);
  EXPECT_GT(cells[3], 100);
  EXPECT_GT(cells[4], 5);
}

TEST(GeneratedRegionsTest, SeedsAndCountsDecideTheRegionsAndNothingElseDoes) {
  EXPECT_EQ(LabelsOf(GeneratedRegions(7, 12)), LabelsOf(GeneratedRegions(7, 12)));
  EXPECT_NE(LabelsOf(GeneratedRegions(7, 12)), LabelsOf(GeneratedRegions(8, 12)));
  EXPECT_NE(LabelsOf(GeneratedRegions(7, 12)), LabelsOf(GeneratedRegions(7, 11)));
  EXPECT_EQ(GeneratedRegions(7, 2).At({0.5, 0, 0}), 2);
  EXPECT_EQ(GeneratedRegions(7, GeneratedRegions::kMaxRegions).count(), 100);
}

TEST(GeneratedRegionsTest, LabelsAreWhatADatasetMayHaveEachWithItsColour) {
  const std::vector<volume::Label> labels = GeneratedRegions(1, 16).Labels();
  ISOSCOPE_EXPECT_OK(volume::ValidateLabels(labels));
  ASSERT_EQ(labels.size(), 16u);
  EXPECT_EQ(labels[0].name, "core");
  EXPECT_EQ(labels[15].name, "cell 16");
  std::set<std::string> colors;
  for (const volume::Label& label : labels) {
    colors.insert(volume::ToHex(*label.color));
  }
  EXPECT_EQ(colors.size(), 16u);
}

}  // namespace
}  // namespace isoscope::source
