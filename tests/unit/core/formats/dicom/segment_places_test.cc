#include "core/formats/dicom/segment_places.h"

#include <vector>

#include "gmock/gmock.h"
#include "gtest/gtest.h"

#include "tests/support/status_matchers.h"

namespace isoscope::source {
namespace {

using ::isoscope::testing::StatusIs;
using ::testing::AllOf;
using ::testing::ElementsAre;
using ::testing::HasSubstr;

constexpr auto kInvalid = absl::StatusCode::kInvalidArgument;

DicomSlice At(double z, std::int64_t frame, double x = 0) {
  DicomSlice slice;
  slice.path = "s.dcm";
  slice.frame = frame;
  slice.origin = {x, 0, z};
  slice.spacing = {1, 1, 1};
  slice.direction.columns = {math::Vec3d{1, 0, 0}, math::Vec3d{0, 1, 0}, math::Vec3d{0, 0, 1}};
  slice.position = z;
  return slice;
}

std::vector<DicomSlice> AtAll(const std::vector<double>& places) {
  std::vector<DicomSlice> slices;
  for (const double z : places) {
    slices.push_back(At(z, static_cast<std::int64_t>(slices.size())));
  }
  return slices;
}

std::vector<std::int64_t> FramesOf(const std::vector<DicomSlice>& slices) {
  std::vector<std::int64_t> frames;
  for (const DicomSlice& slice : slices) {
    frames.push_back(slice.frame);
  }
  return frames;
}

TEST(SegmentPlacesTest, FramesOfOnePlaceStandTogether) {
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(
      const SegmentPlaces places,
      PlacesOfFrames({At(4, 0), At(2, 1), At(4.0009, 2, 0.0005), At(3, 3), At(2, 4)}));
  EXPECT_THAT(places.frames, ElementsAre(ElementsAre(1, 4), ElementsAre(3), ElementsAre(0, 2)));
  EXPECT_THAT(FramesOf(places.slices), ElementsAre(0, 1, 2));
  EXPECT_EQ(places.slices[1].position, 3);
}

TEST(SegmentPlacesTest, TilesAreRefused) {
  EXPECT_THAT(PlacesOfFrames({At(2, 0), At(3, 1), At(2, 2, 10)}),
              StatusIs(kInvalid, AllOf(HasSubstr("frames 0 and 2"), HasSubstr("10 apart"),
                                       HasSubstr("tiles"))));
  DicomSlice turned = At(2, 1);
  std::swap(turned.direction.columns[0], turned.direction.columns[1]);
  EXPECT_THAT(PlacesOfFrames({At(2, 0), turned}), StatusIs(kInvalid, HasSubstr("turned")));
}

TEST(SegmentPlacesTest, PlacesThatAreLeftOutAreEmpty) {
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(const auto smallest, WithEmptyPlaces(AtAll({1, 3, 9, 11}), 0));
  EXPECT_THAT(FramesOf(smallest), ElementsAre(0, 1, -1, -1, 2, 3));
  EXPECT_EQ(smallest[2].origin, (math::Vec3d{0, 0, 5}));
  EXPECT_EQ(smallest[3].position, 7);
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(const auto named, WithEmptyPlaces(AtAll({1, 3}), 1));
  EXPECT_THAT(FramesOf(named), ElementsAre(0, -1, 1));
  // A named distance that is larger than that of planes can't be theirs.
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(const auto wrong, WithEmptyPlaces(AtAll({1, 3}), 5));
  EXPECT_THAT(FramesOf(wrong), ElementsAre(0, 1));
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(const auto one, WithEmptyPlaces(AtAll({1}), 5));
  EXPECT_THAT(FramesOf(one), ElementsAre(0));
}

TEST(SegmentPlacesTest, UnevenAndEndlessPlacesAreRefusedWithTheirNumbers) {
  EXPECT_THAT(WithEmptyPlaces(AtAll({1, 3, 8}), 0),
              StatusIs(kInvalid, AllOf(HasSubstr("5 apart"), HasSubstr("distance 2"))));
  EXPECT_THAT(WithEmptyPlaces(AtAll({0, 1, 70000}), 0),
              StatusIs(kInvalid, HasSubstr("more than 65536")));
  EXPECT_THAT(WithEmptyPlaces(AtAll({0, 1e-300, 1}), 0), StatusIs(kInvalid, HasSubstr("planes")));
}

}  // namespace
}  // namespace isoscope::source
