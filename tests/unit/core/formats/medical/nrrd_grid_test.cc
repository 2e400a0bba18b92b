#include "core/formats/medical/nrrd_grid.h"

#include <string>
#include <utility>
#include <vector>

#include "absl/strings/str_cat.h"
#include "gmock/gmock.h"
#include "gtest/gtest.h"

#include "core/source/volume_source.h"
#include "tests/support/only_volume.h"
#include "tests/support/status_matchers.h"
#include "tests/support/temp_dir.h"
#include "tests/support/volume_files.h"

namespace isoscope::source {
namespace {

using ::isoscope::testing::StatusIs;
using ::testing::AllOf;
using ::testing::HasSubstr;

constexpr auto kInvalid = absl::StatusCode::kInvalidArgument;

// Three axes of 4, 3 and 2 samples.
absl::StatusOr<NrrdGrid> Read(const std::vector<std::pair<std::string, std::string>>& lines) {
  HeaderFields fields("a.nrrd");
  fields.Set("sizes", "4 3 2");
  for (const auto& [key, value] : lines) {
    fields.Set(key, value);
  }
  const auto lists = ReadNrrdLists(fields, "a.nrrd");
  return lists.ok() ? ReadNrrdGrid(fields, *lists, 0, "a.nrrd") : lists.status();
}

// The same without faults.
absl::StatusOr<NrrdGrid> Whole(const std::vector<std::pair<std::string, std::string>>& lines) {
  auto grid = Read(lines);
  const absl::Status status = grid.ok() ? grid->faults.Check({}, "a.nrrd") : grid.status();
  if (!status.ok()) {
    return status;
  }
  return grid;
}

math::Vec3d At(const NrrdGrid& grid, const math::Vec3d& index) {
  return math::TransformPoint(grid.geometry.world_from_index(), index);
}

TEST(NrrdGridTest, SpacesOfThePatientAreTurnedToLps) {
  struct Case {
    const char* space;
    math::Vec3d origin;
    bool has_frame;
  };
  for (const Case& c :
       {Case{"left-posterior-superior", {10, 20, 30}, true}, Case{"LPS", {10, 20, 30}, true},
        Case{"right-anterior-superior", {-10, -20, 30}, true},
        Case{"right anterior superior", {-10, -20, 30}, true}, Case{"RAS", {-10, -20, 30}, true},
        Case{"left-anterior-superior", {10, -20, 30}, true}, Case{"las", {10, -20, 30}, true},
        Case{"scanner-xyz", {10, 20, 30}, false}, Case{"3D-right-handed", {10, 20, 30}, false}}) {
    SCOPED_TRACE(c.space);
    ISOSCOPE_ASSERT_OK_AND_ASSIGN(const NrrdGrid grid,
                                  Read({{"space", c.space},
                                        {"space directions", "(0,1.5,0) (-2,0,0) (0,0,3)"},
                                        {"space origin", "(10,20,30)"}}));
    EXPECT_EQ(At(grid, {0, 0, 0}), c.origin);
    const math::Vec3d turn{c.origin.x / 10, c.origin.y / 20, 1};
    EXPECT_EQ(At(grid, {1, 1, 1}) - c.origin, (math::Vec3d{-2 * turn.x, 1.5 * turn.y, 3}));
    EXPECT_EQ(grid.patient_frame.has_value(), c.has_frame);
  }
  for (const char* space : {"3D-left-handed", "right-up", "nowhere"}) {
    EXPECT_THAT(Read({{"space", space}, {"space directions", "(1,0,0) (0,1,0) (0,0,1)"}}),
                StatusIs(kInvalid, HasSubstr(space)));
  }
  EXPECT_THAT(Read({{"space dimension", "2"}}), StatusIs(kInvalid, HasSubstr("dimension 2")));
  // With time, vectors have a fourth number.
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(const NrrdGrid timed,
                                Read({{"space", "RAST"},
                                      {"space directions", "(1,0,0,0) (0,2,0,0) (0,0,3,0)"},
                                      {"space origin", "(10,20,30,7)"}}));
  EXPECT_EQ(At(timed, {1, 1, 1}), (math::Vec3d{-11, -22, 33}));
  EXPECT_THAT(Read({{"space", "LPS-time"}, {"space directions", "(1,0,0,5) (0,2,0,0) (0,0,3,0)"}}),
              StatusIs(kInvalid, HasSubstr("the last one 0")));
}

TEST(NrrdGridTest, VectorsHaveThreeFiniteNumbersAndALength) {
  for (const char* bad :
       {"(0,1,0) (1,0) (0,0,1)", "(0,1,0) (1,nan,0) (0,0,1)", "(0,1,0) (inf,0,0) (0,0,1)",
        "(0,1,0) (0,0,0) (0,0,1)", "(0,1,0) (1,x,0) (0,0,1)"}) {
    EXPECT_THAT(Whole({{"space", "LPS"}, {"space directions", bad}}),
                StatusIs(kInvalid, HasSubstr("space directions")))
        << bad;
  }
  EXPECT_THAT(Whole({{"space", "LPS"},
                     {"space directions", "(1,0,0) (0,1,0) (0,0,1)"},
                     {"space origin", "(nan,0,0)"}}),
              StatusIs(kInvalid, HasSubstr("origin nan, 0, 0")));
  // Left-handed axes stay so.
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(
      const NrrdGrid grid,
      Read({{"space", "LPS"}, {"space directions", "(1,0,0) (0,1,0) (0,0,-2)"}}));
  EXPECT_EQ(At(grid, {0, 0, 1}), (math::Vec3d{0, 0, -2}));
}

TEST(NrrdGridTest, SpacingsAreNegativeOrNotKnownAndNotZero) {
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(NrrdGrid grid, Read({{"spacings", "1.5 -2 3"}}));
  EXPECT_EQ(At(grid, {1, 1, 1}), (math::Vec3d{1.5, -2, 3}));
  EXPECT_EQ(grid.geometry.spacing, (math::Vec3d{1.5, 2, 3}));
  // Nothing is known: 1 a sample, without a unit.
  for (const char* none : {"", "nan nan nan", "NaN nan NAN"}) {
    ISOSCOPE_ASSERT_OK_AND_ASSIGN(grid, Read({{"spacings", none}}));
    EXPECT_TRUE(grid.faults.distances.ok());
    EXPECT_EQ(grid.geometry.spacing, (math::Vec3d{1, 1, 1}));
  }
  for (const char* bad : {"1 nan 3", "1 2 0", "inf 1 1", "nan nan 1"}) {
    ISOSCOPE_ASSERT_OK_AND_ASSIGN(grid, Read({{"spacings", bad}}));
    EXPECT_THAT(grid.faults.distances,
                StatusIs(kInvalid, AllOf(HasSubstr(bad), HasSubstr("--spacing X,Y,Z"))));
  }
  EXPECT_THAT(Read({{"spacings", "1 2"}}), StatusIs(kInvalid, HasSubstr("2 spacings for 3 axes")));
  EXPECT_THAT(Read({{"spacings", "1 2 x"}}), StatusIs(kInvalid, HasSubstr("\"x\"")));
}

TEST(NrrdGridTest, BoundsOfAxesAreThoseOfCellsOrOfSamples) {
  const std::pair<std::string, std::string> mins{"axis mins", "10 20 30"};
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(NrrdGrid grid, Read({{"spacings", "1 2 4"}, mins}));
  EXPECT_EQ(At(grid, {0, 0, 0}), (math::Vec3d{10.5, 21, 32}));  // cells, as in ITK
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(grid,
                                Read({{"spacings", "1 2 4"}, mins, {"centers", "node cell node"}}));
  EXPECT_EQ(At(grid, {0, 0, 0}), (math::Vec3d{10, 21, 30}));
  // Without spacings the bounds give the distances.
  const std::pair<std::string, std::string> maxs{"axismaxs", "18 14 34"};
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(grid, Read({mins, maxs, {"centerings", "cell cell node"}}));
  EXPECT_EQ(At(grid, {0, 0, 0}), (math::Vec3d{11, 19, 30}));
  EXPECT_EQ(At(grid, {3, 2, 1}), (math::Vec3d{17, 15, 34}));
  // Both: they must agree, and then tell samples from cells.
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(grid, Read({mins, maxs, {"spacings", "2 -3 4"}}));
  EXPECT_EQ(At(grid, {0, 0, 0}), (math::Vec3d{11, 20, 30}));
  EXPECT_THAT(Read({mins, maxs, {"spacings", "2 3 4"}}),
              StatusIs(kInvalid, AllOf(HasSubstr("axis 1"), HasSubstr("spacing 3"))));
  EXPECT_THAT(Read({{"spacings", "1 1 1"}, {"axis mins", "10 nan 30"}}),
              StatusIs(kInvalid, HasSubstr("axis mins")));
  EXPECT_THAT(Read({{"spacings", "1 1 1"}, {"axis maxs", "1 1 1"}}),
              StatusIs(kInvalid, HasSubstr("axis maxs")));
}

TEST(NrrdGridTest, TwoSourcesOfOneThingAreRefused) {
  const std::pair<std::string, std::string> directions{"space directions",
                                                       "(1,0,0) (0,1,0) (0,0,1)"};
  EXPECT_THAT(Read({{"space", "LPS"}, directions, {"spacings", "nan 2 nan"}}),
              StatusIs(kInvalid, HasSubstr("axis 1 has the direction")));
  EXPECT_THAT(Read({{"space", "LPS"}, directions, {"axis mins", "0 0 0"}}),
              StatusIs(kInvalid, HasSubstr("bounds")));
  EXPECT_TRUE(Read({{"space", "LPS"}, directions, {"spacings", "nan nan nan"}}).ok());
  EXPECT_THAT(Read({{"space", "LPS"}, {"spacings", "1 1 1"}}),
              StatusIs(kInvalid, HasSubstr("expected space directions")));
}

TEST(NrrdGridTest, UnitsOfOneLength) {
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(NrrdGrid grid,
                                Read({{"spacings", "1 2 3"}, {"units", "\"mm\" \"mm\" \"mm\""}}));
  EXPECT_EQ(grid.length_unit, "mm");
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(grid,
                                Read({{"spacings", "1 2 3"}, {"units", "\"mm\" \"cm\" \"um\""}}));
  EXPECT_EQ(grid.length_unit, "mm");
  EXPECT_DOUBLE_EQ(grid.geometry.spacing.y, 20);
  EXPECT_DOUBLE_EQ(grid.geometry.spacing.z, 0.003);
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(grid, Read({{"space dimension", "3"},
                                            {"space directions", "(0,1,0) (1,0,0) (0,0,1)"},
                                            {"space origin", "(1,1,1)"},
                                            {"space units", "\"mm\" \"m\" \"mm\""}}));
  EXPECT_EQ(At(grid, {1, 0, 0}), (math::Vec3d{1, 2000, 1}));
  EXPECT_THAT(Read({{"spacings", "1 2 3"}, {"units", "\"mm\" \"s\" \"mm\""}}),
              StatusIs(kInvalid, HasSubstr("\"s\"")));
  EXPECT_TRUE(Read({{"spacings", "1 2 3"}, {"units", "\"mm\" \"\" \"mm\""}}).ok());
  // Lengths of two units and of none.
  const std::string mixed = "\"mm\" \"um\" \"\"";
  EXPECT_THAT(Read({{"spacings", "1 2 3"}, {"units", mixed}}),
              StatusIs(kInvalid, HasSubstr("expected one unit")));
  const auto of_space = [](const std::string& units) {
    return Read({{"space", "LPS"},
                 {"space directions", "(1,0,0) (0,1,0) (0,0,1)"},
                 {"space units", units}});
  };
  EXPECT_THAT(of_space(mixed), StatusIs(kInvalid, HasSubstr("expected one unit")));
  EXPECT_THAT(of_space("\"mm\" \"um\""), StatusIs(kInvalid, HasSubstr("expected 3 units")));
}

TEST(NrrdGridTest, FilesOfOneVolumeAreReadByTheSameRules) {
  const testing::TempDir dir;
  const std::string path = dir.Sub("a.nrrd");
  const auto write = [&](const std::string& lines) {
    testing::WriteFile(path, absl::StrCat("NRRD0004\ntype: uchar\ndimension: 3\nsizes: 4 3 2\n",
                                          lines, "encoding: raw\n\n", std::string(24, 'x')));
  };
  write("spacings: 1 -2 3\n");
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(auto source, OpenVolumeFile(path));
  EXPECT_EQ(math::TransformPoint(source->info().geometry.world_from_index(), {1, 1, 1}),
            (math::Vec3d{1, -2, 3}));
  write("spacings: 1 nan 3\n");
  EXPECT_THAT(OpenVolumeFile(path), StatusIs(kInvalid, HasSubstr("--spacing")));
  EXPECT_TRUE(OpenVolumeFile(path, "", {.has_spacing = true}).ok());
  for (const char* bad : {"spacings: 0 1 -3\n", "spacings: 1 inf -3\n"}) {
    write(bad);
    EXPECT_THAT(OpenVolumeFile(path), StatusIs(kInvalid, HasSubstr("--spacing"))) << bad;
    ISOSCOPE_ASSERT_OK_AND_ASSIGN(source, OpenVolumeFile(path, "", {.has_spacing = true}));
    EXPECT_EQ(source->info().geometry.direction.columns[2], (math::Vec3d{0, 0, -1})) << bad;
  }
  for (const char* bad : {"(1,0,0) (0,0,0) (0,0,2)", "(1,0,0) (0,nan,0) (0,0,2)"}) {
    write(absl::StrCat("space: LPS\nspace directions: ", bad, "\n"));
    EXPECT_THAT(OpenVolumeFile(path),
                StatusIs(kInvalid, AllOf(HasSubstr("of axis 1 has"), HasSubstr("--spacing X,Y,Z"),
                                         HasSubstr("--direction XX"))));
    EXPECT_THAT(OpenVolumeFile(path, "", {.has_spacing = true}),
                StatusIs(kInvalid, HasSubstr("--direction XX")));
    EXPECT_TRUE(OpenVolumeFile(path, "", {.has_spacing = true, .has_direction = true}).ok());
  }
  write("space: LPS\nspace directions: (1,0,0) (0,1,0) (1,1,0)\n");
  EXPECT_THAT(OpenVolumeFile(path), StatusIs(kInvalid, HasSubstr("--direction XX")));
  EXPECT_TRUE(OpenVolumeFile(path, "", {.has_direction = true}).ok());
  write("space: LPS\nspace directions: (1,0,0) (0,1,0) (0,0,2)\nspace origin: (0,nan,0)\n");
  EXPECT_THAT(OpenVolumeFile(path), StatusIs(kInvalid, HasSubstr("--origin X,Y,Z")));
  EXPECT_TRUE(OpenVolumeFile(path, "", {.has_origin = true}).ok());
  write("");
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(source, OpenVolumeFile(path));
  EXPECT_EQ(source->info().geometry.spacing, (math::Vec3d{1, 1, 1}));
}

}  // namespace
}  // namespace isoscope::source
