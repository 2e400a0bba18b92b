// Each case of each element: given, missing, broken, zero, negative, at the edge of a tolerance.

#include "core/formats/dicom/dicom_geometry.h"

#include <array>
#include <cmath>
#include <cstddef>
#include <cstdint>
#include <string>
#include <vector>

#include "gmock/gmock.h"
#include "gtest/gtest.h"

#include "tests/support/status_matchers.h"

namespace isoscope::source {
namespace {

using ::isoscope::testing::StatusIs;
using ::testing::AllOf;
using ::testing::DoubleNear;
using ::testing::ElementsAre;
using ::testing::HasSubstr;
using ::testing::IsEmpty;

constexpr auto kInvalid = absl::StatusCode::kInvalidArgument;
constexpr char kNuclear[] = "1.2.840.10008.5.1.4.1.1.20";
constexpr char kDose[] = "1.2.840.10008.5.1.4.1.1.481.2";
constexpr char kMagnetic[] = "1.2.840.10008.5.1.4.1.1.4";
constexpr char kCapture[] = "1.2.840.10008.5.1.4.1.1.7.3";
constexpr std::uint32_t kSliceVector = 0x00540080;
constexpr std::uint32_t kEnergyVector = 0x00540010;

template <std::size_t kCount>
DicomNumbers<kCount> Given(const std::array<double, kCount>& values) {
  return {.values = values, .given = DicomGiven::kGiven};
}
template <std::size_t kCount>
DicomNumbers<kCount> Broken() {
  return {.given = DicomGiven::kBroken};
}

// An axial frame at (10, 20, 30), whose pixels lie 0.5 apart on x and 2 on y.
DicomFrame Frame() {
  return {.position = Given<3>({10, 20, 30}),
          .orientation = Given<6>({1, 0, 0, 0, 1, 0}),
          .pixel_spacing = Given<2>({2, 0.5})};
}

DicomFrames File(std::size_t count, const DicomFrame& frame = Frame()) {
  return {.frames = std::vector<DicomFrame>(count, frame)};
}

// A file of nuclear medicine, whose frame i is of slice `slices[i]`.
DicomFrames Nuclear(const std::vector<std::uint32_t>& slices, double distance) {
  DicomFrame frame = Frame();
  frame.slice_spacing = Given<1>({distance});
  DicomFrames file = File(slices.size(), frame);
  file.dimensions = {kSliceVector};
  file.increments = {kSliceVector};
  for (std::size_t i = 0; i < slices.size(); ++i) {
    file.frames[i].indices = {slices[i]};
  }
  return file;
}

DicomFrames Dose(const std::vector<double>& offsets) {
  DicomFrames file = File(offsets.size());
  file.offsets = DicomGiven::kGiven;
  file.increments = {0x3004000c};
  for (std::size_t i = 0; i < offsets.size(); ++i) {
    file.frames[i].offset = offsets[i];
  }
  return file;
}

absl::StatusOr<std::vector<double>> Places(const DicomFrames& file, const char* storage_class) {
  const auto planes = PlanesOfDicomFrames(file, storage_class, "a.dcm");
  if (!planes.ok()) {
    return planes.status();
  }
  std::vector<double> places;
  for (const DicomPlane& plane : *planes) {
    places.push_back(plane.position);
  }
  return places;
}

TEST(DicomGeometryTest, PlaneIsWhatTheFrameNames) {
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(const DicomPlane plane, PlaneOfDicomFrame(Frame(), "a"));
  EXPECT_EQ(plane.origin, (math::Vec3d{10, 20, 30}));
  EXPECT_EQ(plane.spacing, (math::Vec3d{0.5, 2, 1})) << "rows are named first";
  EXPECT_EQ(plane.direction, math::Mat3d());
  EXPECT_EQ(plane.position, 30);
  DicomFrame sagittal = Frame();
  sagittal.orientation = Given<6>({0, 1, 0, 0, 0, -1});
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(const DicomPlane turned, PlaneOfDicomFrame(sagittal, "a"));
  EXPECT_EQ(turned.direction.columns[2], (math::Vec3d{-1, 0, 0}));
  EXPECT_EQ(turned.position, -10);
}

TEST(DicomGeometryTest, ElementsThatAreMissingOrBrokenAreNamed) {
  struct Case {
    const char* tag;
    void (*make_missing)(DicomFrame*);
    void (*make_broken)(DicomFrame*);
  };
  for (const Case& c : {Case{"(0020,0032)", [](DicomFrame* f) { f->position = {}; },
                             [](DicomFrame* f) { f->position = Broken<3>(); }},
                        Case{"(0020,0037)", [](DicomFrame* f) { f->orientation = {}; },
                             [](DicomFrame* f) { f->orientation = Broken<6>(); }},
                        Case{"(0028,0030)", [](DicomFrame* f) { f->pixel_spacing = {}; },
                             [](DicomFrame* f) { f->pixel_spacing = Broken<2>(); }}}) {
    DicomFrame frame = Frame();
    c.make_missing(&frame);
    EXPECT_THAT(PlaneOfDicomFrame(frame, "a: the image"),
                StatusIs(kInvalid, AllOf(HasSubstr("a: the image has no "), HasSubstr(c.tag),
                                         HasSubstr("dcmodify -i"))));
    c.make_broken(&frame);
    EXPECT_THAT(PlaneOfDicomFrame(frame, "a"),
                StatusIs(kInvalid, AllOf(HasSubstr("is there, but not as"), HasSubstr(c.tag))));
  }
}

TEST(DicomGeometryTest, DirectionsMustHaveLength1AndRightAngles) {
  const auto with = [](const std::array<double, 6>& orientation) {
    DicomFrame frame = Frame();
    frame.orientation = Given<6>(orientation);
    return PlaneOfDicomFrame(frame, "a");
  };
  for (const std::array<double, 6>& bad : {std::array<double, 6>{0, 0, 0, 0, 1, 0},
                                           {1, 0, 0, 0, 0, 0},
                                           {2, 0, 0, 0, 1, 0},
                                           {1, 0, 0, 0, 2, 0},
                                           {1, 0, 0, 1, 0, 0},
                                           {1.011, 0, 0, 0, 1, 0},
                                           {1, 0, 0, 0, 0.989, 0},
                                           {1, 0, 0, 0.011, 1, 0},
                                           {1, 0, 0, -0.011, 1, 0}}) {
    EXPECT_THAT(with(bad), StatusIs(kInvalid, HasSubstr("orientation (0020,0037)")));
  }
  // Texts of two digits.
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(const DicomPlane near, with({0.71, 0.71, 0, -0.7, 0.71, 0.01}));
  for (const math::Vec3d& column : near.direction.columns) {
    EXPECT_NEAR(math::Length(column), 1, 1e-15);
  }
  EXPECT_NEAR(math::Dot(near.direction.columns[0], near.direction.columns[1]), 0, 1e-15);
  EXPECT_NEAR(near.direction.columns[0].x, std::sqrt(0.5), 1e-15);
  // Those that are nearer stay as they are.
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(const DicomPlane as_it_is, with({1.0009, 0, 0, 0, 1, 0}));
  EXPECT_EQ(as_it_is.direction.columns[0].x, 1.0009);
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(const DicomPlane straight, with({1.0011, 0, 0, 0, 1, 0}));
  EXPECT_EQ(straight.direction.columns[0].x, 1);
}

TEST(DicomGeometryTest, DistancesOfPixelsMustBeAbove0) {
  for (const std::array<double, 2>& bad :
       {std::array<double, 2>{0, 1}, {1, 0}, {-1, 1}, {1, -0.5}}) {
    DicomFrame frame = Frame();
    frame.pixel_spacing = Given<2>(bad);
    EXPECT_THAT(PlaneOfDicomFrame(frame, "a"),
                StatusIs(kInvalid, AllOf(HasSubstr("pixel spacing (0028,0030)"),
                                         HasSubstr("--spacing X,Y,Z"))));
    ISOSCOPE_ASSERT_OK_AND_ASSIGN(const DicomPlane plane, PlaneOfDicomFrame(frame, "a", {}, true));
    EXPECT_EQ(plane.spacing, (math::Vec3d{1, 1, 1}));
    EXPECT_FALSE(plane.has_spacing);
  }
}

TEST(DicomGeometryTest, OnlyScannedImagesHaveTheirDistanceOfPixelsElsewhere) {
  DicomFrames file = File(1);
  file.frames[0].pixel_spacing = {};
  file.scanned_spacing = Given<2>({3, 4});
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(const auto planes, PlanesOfDicomFrames(file, kCapture, "a"));
  EXPECT_EQ(planes[0].spacing, (math::Vec3d{4, 3, 1}));
  EXPECT_THAT(PlanesOfDicomFrames(file, kMagnetic, "a"),
              StatusIs(kInvalid, HasSubstr("0028,0030")));
  file.scanned_spacing = Given<2>({3, 0});
  EXPECT_THAT(PlanesOfDicomFrames(file, kCapture, "a"), StatusIs(kInvalid, HasSubstr("above 0")));
  file.frames[0].pixel_spacing = Given<2>({2, 0.5});
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(const auto both, PlanesOfDicomFrames(file, kCapture, "a"));
  EXPECT_EQ(both[0].spacing.x, 0.5) << "the distance on the patient counts";
  // That of a detector is none on the patient.
  file.frames[0].pixel_spacing = {};
  file.imager_spacing = Given<2>({1, 1});
  EXPECT_THAT(PlanesOfDicomFrames(file, kMagnetic, "a"),
              StatusIs(kInvalid, AllOf(HasSubstr("(0028,0030)"), HasSubstr("(0018,1164)"))));
}

TEST(DicomGeometryTest, DistancesThatAreMissingAre1IfTheUserGivesThem) {
  DicomFrames file = Nuclear({1, 2}, 3);
  for (DicomFrame& frame : file.frames) {
    frame.slice_spacing = {};
    frame.pixel_spacing = {};
  }
  EXPECT_THAT(PlanesOfDicomFrames(file, kNuclear, "a"),
              StatusIs(kInvalid, HasSubstr("or give --spacing X,Y,Z")));
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(const auto planes, PlanesOfDicomFrames(file, kNuclear, "a", true));
  EXPECT_EQ(planes[1].spacing, (math::Vec3d{1, 1, 1}));
  EXPECT_EQ(planes[1].position, 31);
  for (const double bad : {0.0, std::nan("")}) {
    file.frames[0].slice_spacing = Given<1>({bad});
    EXPECT_THAT(PlanesOfDicomFrames(file, kNuclear, "a"), StatusIs(kInvalid));
    ISOSCOPE_ASSERT_OK_AND_ASSIGN(const auto given, PlanesOfDicomFrames(file, kNuclear, "a", true));
    EXPECT_EQ(given[1].position, 31);
  }
  file.frames[0].slice_spacing = Broken<1>();
  EXPECT_TRUE(PlanesOfDicomFrames(file, kNuclear, "a", true).ok());
}

TEST(DicomGeometryTest, SlicesOfNuclearMedicineGoAlongOrAgainstTheNormal) {
  EXPECT_THAT(Places(Nuclear({1, 2, 3}, 3), kNuclear).value(), ElementsAre(30, 33, 36));
  EXPECT_THAT(Places(Nuclear({1, 2, 3}, -3), kNuclear).value(), ElementsAre(30, 27, 24));
  EXPECT_THAT(Places(Nuclear({3, 1, 2}, -3), kNuclear).value(), ElementsAre(24, 30, 27))
      << "by the slice vector";
  DicomFrames bare = Nuclear({9, 9, 9}, -3);
  bare.dimensions.clear();
  bare.increments.clear();
  for (DicomFrame& frame : bare.frames) {
    frame.indices.clear();
  }
  EXPECT_THAT(Places(bare, kNuclear).value(), ElementsAre(30, 27, 24)) << "in their order";
  EXPECT_THAT(Places(Nuclear({1, 0, 2}, 3), kNuclear),
              StatusIs(kInvalid, AllOf(HasSubstr("frame 1"), HasSubstr("(0054,0080)"))));
  EXPECT_THAT(
      Places(Nuclear({1, 2}, 0), kNuclear),
      StatusIs(kInvalid, AllOf(HasSubstr("(0018,0088) is 0"), HasSubstr("--spacing X,Y,Z"))));
}

TEST(DicomGeometryTest, ProjectionsAndMomentsAreNoSlices) {
  DicomFrames file = Nuclear({1, 2}, 3);
  file.dimensions = {kEnergyVector};
  file.increments = {kEnergyVector, 0x00540020};
  EXPECT_THAT(Places(file, kNuclear),
              StatusIs(kInvalid, AllOf(HasSubstr("2 frames are no slices"),
                                       HasSubstr("(0054,0010), (0054,0020) tells them apart"))));
  file.increments = {0x00181063};  // the time of frames
  EXPECT_THAT(Places(file, kMagnetic), StatusIs(kInvalid, HasSubstr("(0018,1063)")));
  // Also if nothing else places them.
  file.frames[0].position = {};
  EXPECT_THAT(Places(file, kMagnetic), StatusIs(kInvalid, HasSubstr("no slices")));
}

TEST(DicomGeometryTest, SpacingBetweenSlicesHasNoSignOutsideNuclearMedicine) {
  const auto at = [](const DicomNumbers<1>& spacing) {
    DicomFrame frame = Frame();
    frame.slice_spacing = spacing;
    return Places(File(3, frame), kMagnetic);
  };
  EXPECT_THAT(at(Given<1>({1.5})).value(), ElementsAre(30, 31.5, 33));
  EXPECT_THAT(at(Given<1>({-1.5})),
              StatusIs(kInvalid, AllOf(HasSubstr("(0018,0088) is -1.5"), HasSubstr("above 0"))));
  EXPECT_THAT(at(Given<1>({0})), StatusIs(kInvalid, HasSubstr("is 0")));
  EXPECT_THAT(at({}),
              StatusIs(kInvalid, HasSubstr("a.dcm: the file has no spacing between slices")));
  EXPECT_THAT(at(Broken<1>()), StatusIs(kInvalid, HasSubstr("not as a number")));
}

TEST(DicomGeometryTest, OffsetsOfDosesCountFromTheFirstFrameOrAreZ) {
  EXPECT_THAT(Places(Dose({0, 3, 6}), kDose).value(), ElementsAre(30, 33, 36));
  EXPECT_THAT(Places(Dose({0, -3, -6}), kDose).value(), ElementsAre(30, 27, 24));
  EXPECT_THAT(Places(Dose({30, 33, 36}), kDose).value(), ElementsAre(30, 33, 36));
  EXPECT_THAT(Places(Dose({30, 27, 24}), kDose).value(), ElementsAre(30, 27, 24));
  EXPECT_THAT(Places(Dose({0, 3, 7}), kDose).value(), ElementsAre(30, 33, 37)) << "uneven ones";
  // Along the normal, which points down here.
  DicomFrames down = Dose({0, 3});
  for (DicomFrame& frame : down.frames) {
    frame.orientation = Given<6>({1, 0, 0, 0, -1, 0});
  }
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(const auto planes, PlanesOfDicomFrames(down, kDose, "a"));
  EXPECT_EQ(planes[1].origin.z, 27);
  for (DicomFrame& frame : down.frames) {
    frame.offset += 30;
  }
  EXPECT_THAT(Places(down, kDose), StatusIs(kInvalid, HasSubstr("begin with 30")))
      << "z has no meaning in a plane that is turned";
  EXPECT_THAT(Places(Dose({5, 8, 11}), kDose),
              StatusIs(kInvalid, AllOf(HasSubstr("begin with 5"), HasSubstr("expected 0, or 30"))));
  EXPECT_THAT(Places(Dose({30.004, 33, 36}), kDose), StatusIs(kInvalid));
  EXPECT_THAT(Places(Dose({30.002, 33, 36}), kDose).value(),
              ElementsAre(30, DoubleNear(32.998, 1e-12), DoubleNear(35.998, 1e-12)));
}

TEST(DicomGeometryTest, OffsetsOfDosesThatAreMissingBrokenOrOutOfOrderAreRefused) {
  DicomFrames file = Dose({0, 3, 6});
  file.offsets = DicomGiven::kMissing;
  for (DicomFrame& frame : file.frames) {
    frame.slice_spacing = Given<1>({3});  // no class of doses has it
  }
  EXPECT_THAT(Places(file, kDose), StatusIs(kInvalid, HasSubstr("no grid frame offsets")));
  file.offsets = DicomGiven::kBroken;
  EXPECT_THAT(Places(file, kDose), StatusIs(kInvalid, HasSubstr("(3004,000c) is there, but not")));
  EXPECT_THAT(Places(Dose({0, 6, 3}), kDose),
              StatusIs(kInvalid, AllOf(HasSubstr("from 6 to 3 at frame 2"))));
  EXPECT_THAT(Places(Dose({0, 3, 3}), kDose), StatusIs(kInvalid, HasSubstr("order")));
  EXPECT_THAT(Places(Dose({0, 0, 3}), kDose), StatusIs(kInvalid));
}

TEST(DicomGeometryTest, FramesWithFunctionalGroupsHavePlacesOfTheirOwn) {
  DicomFrames file = File(2);
  file.group_items = 2;
  file.frames[1].position = Given<3>({10, 20, 35});
  file.frames[1].slice_spacing = Given<1>({-7});  // says nothing of positions
  EXPECT_THAT(Places(file, kMagnetic).value(), ElementsAre(30, 35));
  file.increments = {0x00181063};  // nor does this
  EXPECT_THAT(Places(file, kMagnetic).value(), ElementsAre(30, 35));
  file.frames[1].position = {};
  EXPECT_THAT(Places(file, kMagnetic),
              StatusIs(kInvalid, HasSubstr("a.dcm: frame 1 of 2 has no position (0020,0032)")));
  file.group_items = 1;
  EXPECT_THAT(Places(file, kMagnetic), StatusIs(kInvalid, HasSubstr("of 1 frames, but 2 frames")));
}

TEST(DicomGeometryTest, NumbersInAStackGoUpOrDownWithThePlaces) {
  const auto places = [](const std::vector<std::uint32_t>& numbers, std::uint32_t last_stack = 1) {
    DicomFrames file = File(numbers.size());
    file.group_items = static_cast<std::int64_t>(numbers.size());
    file.dimensions = {0x00209056, 0x00209057};
    for (std::size_t i = 0; i < numbers.size(); ++i) {
      file.frames[i].position = Given<3>({10, 20, 3.0 * static_cast<double>(i / 2)});
      file.frames[i].indices = {i < 4 ? 1 : last_stack, numbers[i]};
    }
    return Places(file, kMagnetic);
  };
  ISOSCOPE_EXPECT_OK(places({1, 1, 2, 2, 3, 3}).status());
  ISOSCOPE_EXPECT_OK(places({7, 7, 5, 5, 4, 4}).status());
  EXPECT_THAT(places({2, 2, 3, 3, 1, 1}),
              StatusIs(kInvalid, AllOf(HasSubstr("is number 3"), HasSubstr("(0020,9057)"))));
  ISOSCOPE_EXPECT_OK(places({2, 2, 3, 3, 1, 1}, 2).status());  // of another stack
  EXPECT_THAT(places({1, 2, 2, 2, 3, 3}),
              StatusIs(kInvalid, AllOf(HasSubstr("frames 1 and 2"), HasSubstr("lie 3 apart"))));
  ISOSCOPE_EXPECT_OK(places({0, 0, 3, 3, 1, 1}).status());  // a frame without a number
}

TEST(DicomGeometryTest, RanksFollowTheDimensionsThatAreNotOfSpace) {
  DicomFrames file = File(4);
  file.dimensions = {0x00209056, 0x00209057, 0x00189087, 0x00209128};  // stack, b value, time
  file.frames[0].indices = {1, 1, 2, 1};
  file.frames[1].indices = {1, 2, 1, 2};
  file.frames[2].indices = {1, 1, 1, 2};
  file.frames[3].indices = {1, 1, 1, 1};
  EXPECT_THAT(RanksOfDicomFrames(file), ElementsAre(2, 1, 1, 0));
  file.frames[3].indices = {0, 0, 0, 0};
  EXPECT_THAT(RanksOfDicomFrames(file), IsEmpty()) << "a frame without indices";
  file.dimensions = {0x00209056, 0x00209057};
  EXPECT_THAT(RanksOfDicomFrames(file), IsEmpty());
  EXPECT_THAT(RanksOfDicomFrames(Nuclear({1, 2}, 3)), IsEmpty());
}

}  // namespace
}  // namespace isoscope::source
