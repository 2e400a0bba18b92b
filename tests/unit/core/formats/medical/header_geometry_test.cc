// Each field of the headers of volumes that decides where samples lie, with the values that it can
// have: negative, 0, no number, infinite, missing. None of them may become 1 in silence.

#include <algorithm>
#include <cmath>
#include <cstddef>
#include <cstdint>
#include <cstring>
#include <limits>
#include <memory>
#include <string>
#include <utility>
#include <vector>

#include "absl/strings/str_cat.h"
#include "absl/strings/str_replace.h"
#include "gmock/gmock.h"
#include "gtest/gtest.h"

#include "core/source/volume_source.h"
#include "tests/support/medical_files.h"
#include "tests/support/only_volume.h"
#include "tests/support/status_matchers.h"
#include "tests/support/temp_dir.h"
#include "tests/support/volume_files.h"
#include "tests/unit/core/formats/maps/mrc_bytes.h"

namespace isoscope::source {
namespace {

using ::isoscope::testing::StatusIs;
using ::testing::AllOf;
using ::testing::HasSubstr;

constexpr auto kInvalid = absl::StatusCode::kInvalidArgument;
constexpr float kNan = std::numeric_limits<float>::quiet_NaN();
constexpr float kInfinity = std::numeric_limits<float>::infinity();
constexpr float kNoDistances[] = {0, -1.5F, kNan, kInfinity, -kInfinity};

template <typename T>
std::string With(std::string bytes, std::size_t offset, T value, bool is_big_endian = false) {
  std::memcpy(bytes.data() + offset, &value, sizeof(value));
  if (is_big_endian) {
    std::reverse(bytes.begin() + static_cast<std::ptrdiff_t>(offset),
                 bytes.begin() + static_cast<std::ptrdiff_t>(offset + sizeof(value)));
  }
  return bytes;
}

class HeaderGeometryTest : public ::testing::Test {
 protected:
  absl::StatusOr<volume::GridGeometry> Open(const std::string& name, const std::string& bytes,
                                            const GridRules& rules = {}) {
    testing::WriteFile(dir_.Sub(name), bytes);
    const auto source = OpenVolumeFile(dir_.Sub(name), "", rules);
    return source.ok() ? absl::StatusOr<volume::GridGeometry>((*source)->info().geometry)
                       : source.status();
  }
  // Each value that is no distance is refused by the field's name, and taken where one is given.
  void ExpectRefused(const std::string& name, const std::string& bytes, const std::string& field) {
    EXPECT_THAT(Open(name, bytes), StatusIs(kInvalid, AllOf(HasSubstr(name), HasSubstr(field),
                                                            HasSubstr("--spacing X,Y,Z"))));
    EXPECT_TRUE(Open(name, bytes, {.has_spacing = true}).ok())
        << field << Open(name, bytes, {.has_spacing = true}).status();
  }
  // What is refused with a flag in the message, and taken where that is given.
  void ExpectGiven(const std::string& name, const std::string& bytes, const std::string& flag) {
    EXPECT_THAT(Open(name, bytes), StatusIs(kInvalid, AllOf(HasSubstr(name), HasSubstr(flag))));
    const GridRules rules{.has_spacing = flag.starts_with("--spacing"),
                          .has_origin = flag.starts_with("--origin"),
                          .has_direction = flag.starts_with("--direction")};
    EXPECT_TRUE(Open(name, bytes, rules).ok()) << flag << " " << Open(name, bytes, rules).status();
  }
  testing::TempDir dir_;
  const std::string samples_ = std::string(48, '\1');  // 4 x 3 x 2 of 16 bits
};

math::Vec3d At(const volume::GridGeometry& geometry, const math::Vec3d& index) {
  return math::TransformPoint(geometry.world_from_index(), index);
}

// By its qform, or by its distances alone.
std::string Nifti1(std::int16_t qform_code, std::int16_t sform_code) {
  std::string bytes = testing::NiftiHeaderBytes({.dims = {4, 3, 2}});
  bytes = With(With(bytes, 252, qform_code), 254, sform_code);
  return With(With(With(bytes, 268, 10.0F), 272, 20.0F), 276, 30.0F);
}

TEST_F(HeaderGeometryTest, NiftiDistancesThatAreUsedMustBeDistances) {
  for (std::size_t axis = 0; axis < 3; ++axis) {
    const std::string field = absl::StrCat("pixdim[", axis + 1, "]");
    for (const float bad : kNoDistances) {
      for (const std::int16_t qform : {std::int16_t{0}, std::int16_t{1}}) {
        SCOPED_TRACE(absl::StrCat(field, " ", bad, " ", qform));
        ExpectRefused("a.nii", With(Nifti1(qform, 0), 80 + 4 * axis, bad) + samples_, field);
        const std::string second = testing::Nifti2Bytes({.qform_code = qform, .sform_code = 0});
        ExpectRefused("b.nii", With(second, 112 + 8 * axis, static_cast<double>(bad)) + samples_,
                      field);
      }
      // An sform needs none.
      ISOSCOPE_ASSERT_OK_AND_ASSIGN(
          const auto grid, Open("a.nii", With(Nifti1(1, 1), 80 + 4 * axis, bad) + samples_));
      EXPECT_EQ(grid.spacing, (math::Vec3d{1.5, 2, 3}));
    }
  }
}

TEST_F(HeaderGeometryTest, NiftiTransformsInTheOrderOfTheStandard) {
  // Neither code: the distances, without a patient.
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(auto grid, Open("a.nii", Nifti1(0, 0) + samples_));
  EXPECT_EQ(At(grid, {1, 1, 1}), (math::Vec3d{-1.5, -2, 3}));
  // A qform without rotation, and with z turned around; a qfac of 0 means 1.
  for (const float qfac : {1.0F, 0.0F, -1.0F}) {
    ISOSCOPE_ASSERT_OK_AND_ASSIGN(grid, Open("a.nii", With(Nifti1(2, 0), 76, qfac) + samples_));
    EXPECT_EQ(At(grid, {0, 0, 0}), (math::Vec3d{-10, -20, 30}));
    EXPECT_EQ(At(grid, {1, 1, 1}), (math::Vec3d{-11.5, -22, qfac < 0 ? 27.0 : 33.0}));
  }
  EXPECT_THAT(Open("a.nii", With(Nifti1(1, 0), 76, kNan) + samples_),
              StatusIs(kInvalid, HasSubstr("qfac")));
  ExpectGiven("a.nii", With(Nifti1(1, 0), 76, kNan) + samples_, "--direction");
  // A negative code is none.
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(grid, Open("a.nii", Nifti1(-1, -1) + samples_));
  EXPECT_EQ(At(grid, {0, 0, 0}), (math::Vec3d{0, 0, 0}));
  // A quaternion of more than a turn.
  for (const float b : {1.2F, kNan}) {
    EXPECT_THAT(Open("a.nii", With(Nifti1(1, 0), 256, b) + samples_),
                StatusIs(kInvalid, HasSubstr("quaternion")));
  }
  EXPECT_TRUE(Open("a.nii", With(Nifti1(1, 0), 256, 1.0002F) + samples_).ok());
  // Offsets of the qform and of the sform, and a sform of no numbers.
  for (const float bad : {kNan, kInfinity}) {
    ExpectGiven("a.nii", With(Nifti1(1, 0), 268, bad) + samples_, "--origin X,Y,Z");
    ExpectGiven("a.nii", With(Nifti1(0, 1), 292, bad) + samples_, "--origin X,Y,Z");
    const std::string bytes = With(Nifti1(0, 1), 280, bad) + samples_;
    EXPECT_THAT(Open("a.nii", bytes), StatusIs(kInvalid, AllOf(HasSubstr("--spacing X,Y,Z"),
                                                               HasSubstr("--direction XX"))));
    EXPECT_FALSE(Open("a.nii", bytes, {.has_spacing = true}).ok());
    EXPECT_TRUE(Open("a.nii", bytes, {.has_spacing = true, .has_direction = true}).ok());
  }
  // An sform without a length along z gives way to the qform.
  const std::string flat = With(Nifti1(1, 1), 320, 0.0F);
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(grid, Open("a.nii", flat + samples_));
  EXPECT_EQ(At(grid, {1, 1, 1}), (math::Vec3d{-11.5, -22, 33}));
  // Metres and micrometres.
  for (const auto& [unit, factor] :
       {std::pair{1, 1000.0}, std::pair{2, 1.0}, std::pair{3, 0.001}, std::pair{0, 1.0}}) {
    ISOSCOPE_ASSERT_OK_AND_ASSIGN(
        grid, Open("a.nii", With(Nifti1(0, 0), 123, static_cast<char>(unit)) + samples_));
    EXPECT_DOUBLE_EQ(grid.spacing.z, 3 * factor);
  }
}

// ITK refused those whose pixdim is 1 % off: "only supports orthonormal direction cosines".
TEST_F(HeaderGeometryTest, NiftiSformHoldsWhateverTheDistancesAre) {
  const std::vector<float> distances = {1.5075F, 1.01F, 3, 0.5F, -1, 0, kNan};
  for (const float distance : distances) {
    SCOPED_TRACE(distance);
    for (const std::int16_t qform : {std::int16_t{0}, std::int16_t{1}}) {
      std::string head = Nifti1(qform, 1);
      for (std::size_t axis = 0; axis < 3; ++axis) {
        head = With(head, 80 + 4 * axis, distance);
      }
      std::string pair = head;
      std::memcpy(pair.data() + 344, "ni1", 4);
      testing::WriteFile(dir_.Sub("p.img"), samples_);
      const std::pair<const char*, std::string> files[] = {
          {"a.nii", head + samples_},
          {"a.nii.gz", testing::Gzip(head + samples_)},
          {"a.foo", head + samples_},
          {"p.hdr", With(pair, 108, 0.0F)}};
      for (const auto& [name, bytes] : files) {
        SCOPED_TRACE(name);
        ISOSCOPE_ASSERT_OK_AND_ASSIGN(const auto grid, Open(name, bytes));
        EXPECT_EQ(grid.spacing, (math::Vec3d{1.5, 2, 3}));
        EXPECT_EQ(At(grid, {1, 1, 1}), (math::Vec3d{-8, -21.5, 33}));
      }
    }
  }
}

TEST_F(HeaderGeometryTest, NiftiScalesAreFiniteOrNone) {
  const std::string head = testing::NiftiHeaderBytes({.dims = {4, 3, 2}, .intercept = 5});
  for (const float none : {0.0F, kNan}) {
    EXPECT_TRUE(Open("a.nii", With(head, 112, none) + samples_).ok()) << none;
  }
  EXPECT_THAT(Open("a.nii", With(head, 112, kInfinity) + samples_),
              StatusIs(kInvalid, HasSubstr("inf")));
  EXPECT_THAT(Open("a.nii", With(With(head, 112, 2.0F), 116, kNan) + samples_),
              StatusIs(kInvalid, HasSubstr("nan")));
}

TEST_F(HeaderGeometryTest, AnalyzeDistances) {
  testing::WriteFile(dir_.Sub("a.img"), samples_);
  for (std::size_t axis = 0; axis < 3; ++axis) {
    for (const float bad : kNoDistances) {
      ExpectRefused("a.hdr", With(testing::AnalyzeBytes({}), 80 + 4 * axis, bad),
                    absl::StrCat("pixdim[", axis + 1, "]"));
    }
  }
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(const auto grid, Open("a.hdr", testing::AnalyzeBytes({})));
  EXPECT_EQ(grid.spacing, (math::Vec3d{1.5, 2, 3}));
}

TEST_F(HeaderGeometryTest, MghDistancesCountWhereTheyAreSet) {
  for (std::size_t axis = 0; axis < 3; ++axis) {
    for (const float bad : kNoDistances) {
      const std::string bytes = With(testing::MghBytes({}), 30 + 4 * axis, bad, true);
      ExpectRefused("a.mgh", bytes + samples_, absl::StrCat("distance ", axis + 1));
      // Without the mark the standard's own grid counts.
      ISOSCOPE_ASSERT_OK_AND_ASSIGN(const auto grid,
                                    Open("a.mgh", With(bytes, 28, std::int16_t{0}) + samples_));
      EXPECT_EQ(grid.spacing, (math::Vec3d{1, 1, 1}));
    }
  }
  // Any mark above 0 counts, as in FreeSurfer.
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(
      const auto grid,
      Open("a.mgh", With(testing::MghBytes({}), 28, std::int16_t{2}, true) + samples_));
  EXPECT_EQ(grid.spacing, (math::Vec3d{1.5, 2, 3}));
  ExpectGiven("a.mgh", With(testing::MghBytes({}), 78, kNan, true) + samples_, "--origin X,Y,Z");
}

TEST_F(HeaderGeometryTest, AfniTransformsAreWholeOrNone) {
  testing::WriteFile(dir_.Sub("a+orig.BRIK"), samples_);
  const std::string head = testing::AfniBytes(1, "1", "0");
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(auto grid, Open("a+orig.HEAD", head));
  EXPECT_EQ(At(grid, {1, 1, 1}), (math::Vec3d{8, 21.5, 33}));
  const auto with_real = [&](const std::string& real) {
    return absl::StrReplaceAll(
        head,
        {{testing::AfniNumbers("IJK_TO_DICOM_REAL", "0 -2 0 10 1.5 0 0 20 0 0 3 30", 12), real}});
  };
  EXPECT_THAT(Open("a+orig.HEAD", with_real(testing::AfniNumbers("IJK_TO_DICOM_REAL", "1 2", 2))),
              StatusIs(kInvalid, HasSubstr("IJK_TO_DICOM_REAL has 2 numbers")));
  // The signs of DELTA are those of the directions.
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(
      grid, Open("a+orig.HEAD", with_real(testing::AfniNumbers("ORIGIN", "10 20 30", 3) +
                                          testing::AfniNumbers("DELTA", "-1.5 2 -3", 3) +
                                          testing::AfniNumbers("ORIENT_SPECIFIC", "1 2 5", 3))));
  EXPECT_EQ(At(grid, {1, 1, 1}), (math::Vec3d{8.5, 22, 27}));
  EXPECT_THAT(Open("a+orig.HEAD", with_real(testing::AfniNumbers("ORIGIN", "10 20 30", 3) +
                                            testing::AfniNumbers("DELTA", "-1.5 2 0", 3) +
                                            testing::AfniNumbers("ORIENT_SPECIFIC", "1 2 5", 3))),
              StatusIs(kInvalid, AllOf(HasSubstr("spacing 1.5, 2, 0"), HasSubstr("--spacing X"),
                                       HasSubstr("--direction XX"))));
  ExpectGiven("a+orig.HEAD",
              with_real(testing::AfniNumbers("ORIGIN", "10 20 nan", 3) +
                        testing::AfniNumbers("DELTA", "-1.5 2 -3", 3) +
                        testing::AfniNumbers("ORIENT_SPECIFIC", "1 2 5", 3)),
              "--origin X,Y,Z");
  EXPECT_THAT(Open("a+orig.HEAD", testing::AfniBytes(1, "1", "inf")),
              StatusIs(kInvalid, HasSubstr("BRICK_FLOAT_FACS has inf")));
}

TEST_F(HeaderGeometryTest, ParDistances) {
  testing::WriteFile(dir_.Sub("a.REC"), samples_);
  const auto par = [](double gap, const std::string& pixels) {
    return absl::StrReplaceAll(
        testing::ParBytes(testing::ParImage({.slice = 1, .gap = gap}) +
                          testing::ParImage({.slice = 2, .index = 1, .gap = gap})),
        {{"  1.5 2  ", pixels}});
  };
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(auto grid, Open("a.PAR", par(1, "  1.5 2  ")));
  EXPECT_EQ(grid.spacing, (math::Vec3d{1.5, 2, 3}));
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(grid, Open("a.PAR", par(-0.5, "  1.5 2  ")));  // slices overlap
  EXPECT_EQ(grid.spacing.z, 1.5);
  for (const double gap : {-2.0, -3.0}) {
    ExpectRefused("a.PAR", par(gap, "  1.5 2  "), "slice gap");
  }
  for (const char* bad : {"  0 2  ", "  -1.5 2  ", "  nan 2  "}) {
    ExpectRefused("a.PAR", par(1, bad), "pixel spacing x");
  }
}

TEST_F(HeaderGeometryTest, ParaVisionExtents) {
  std::string samples(3 * 24, '\1');
  testing::WriteFile(dir_.Sub("2dseq"), samples);
  for (const char* bad : {"0 4.5", "-8 4.5"}) {
    const std::string text = absl::StrReplaceAll(testing::BrukerText({}), {{"8 4.5", bad}});
    ExpectRefused("visu_pars", text, "number 1 of VisuCoreExtent");
  }
}

TEST_F(HeaderGeometryTest, MrcCells) {
  const std::string samples(96, '\0');
  for (std::size_t axis = 0; axis < 3; ++axis) {
    for (const float bad : kNoDistances) {
      testing::MrcWords words;
      words.cell.at(axis) = bad;
      EXPECT_THAT(Open("a.mrc", testing::MrcBytes(words, samples)),
                  StatusIs(kInvalid, HasSubstr("a cell of")));
      ExpectGiven("a.mrc", testing::MrcBytes(words, samples), "--spacing X,Y,Z");
      words.cell = {8, 9, 10};
      words.angles.at(axis) = bad;
      EXPECT_THAT(Open("a.mrc", testing::MrcBytes(words, samples)),
                  StatusIs(kInvalid, HasSubstr("cell angles")));
      ExpectGiven("a.mrc", testing::MrcBytes(words, samples), "--direction XX");
      if (!std::isfinite(bad)) {
        words.angles = {90, 90, 90};
        words.origin.at(axis) = bad;
        ExpectGiven("a.mrc", testing::MrcBytes(words, samples), "--origin X,Y,Z");
      }
    }
    for (const int bad : {0, -4}) {
      testing::MrcWords words;
      words.grid.at(axis) = bad;
      EXPECT_THAT(Open("a.mrc", testing::MrcBytes(words, samples)),
                  StatusIs(kInvalid, HasSubstr(absl::StrCat(bad))));
      ExpectGiven("a.mrc", testing::MrcBytes(words, samples), "--spacing X,Y,Z");
    }
  }
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(
      auto grid, Open("a.mrc", testing::MrcBytes({.cell = {0, 0, 0}, .grid = {0, 0, 0}}, samples)));
  EXPECT_EQ(grid.spacing, (math::Vec3d{1, 1, 1}));
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(grid, Open("a.mrc", testing::MrcBytes({}, samples)));
  EXPECT_EQ(grid.spacing, (math::Vec3d{2, 3, 5}));
}

TEST_F(HeaderGeometryTest, CubeSigns) {
  const auto cube = [](const std::string& counts) {
    std::string text = "title\ncomment\n 1 0 0 0\n";
    int axis = 0;
    for (const char* vector : {" 0.5 0 0\n", " 0 2 0\n", " 0 0 -4\n"}) {
      absl::StrAppend(&text, counts.substr(static_cast<std::size_t>(2 * axis++), 2), vector);
    }
    absl::StrAppend(&text, " 8 8.0 0.1 0.2 0.3\n");
    for (int i = 0; i < 24; ++i) {
      absl::StrAppend(&text, i, "\n");
    }
    return text;
  };
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(const auto grid, Open("a.cube", cube("-4-3-2")));
  EXPECT_EQ(At(grid, {1, 1, 1}), (math::Vec3d{0.5, 2, -4}));
  EXPECT_TRUE(Open("a.cube", cube(" 4 3 2")).ok());
  for (const char* mixed : {"-4 3 2", " 4-3 2", " 4 3-2", "-4-3 2"}) {
    EXPECT_THAT(Open("a.cube", cube(mixed)), StatusIs(kInvalid, HasSubstr("one sign")));
  }
  EXPECT_THAT(Open("a.cube", cube(" 4 0 2")), StatusIs(kInvalid, HasSubstr("0 voxels")));
}

TEST_F(HeaderGeometryTest, VtkSpacingsMayBeNegativeAndNotZero) {
  const auto vti = [](const std::string& attributes) {
    return absl::StrCat(
        "<VTKFile type=\"ImageData\"><ImageData WholeExtent=\"2 3 0 1 0 1\" ", attributes,
        "><Piece Extent=\"2 3 0 1 0 1\"><PointData><DataArray type=\"UInt8\" Name=\"p\" "
        "format=\"ascii\">1 2 3 4 5 6 7 8</DataArray></PointData></Piece></ImageData></VTKFile>");
  };
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(auto grid,
                                Open("a.vti", vti("Origin=\"10 20 30\" Spacing=\"-0.5 1 -2\"")));
  EXPECT_EQ(At(grid, {0, 0, 0}), (math::Vec3d{9, 20, 30}));
  EXPECT_EQ(At(grid, {1, 1, 1}), (math::Vec3d{8.5, 21, 28}));
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(
      grid, Open("a.vti", vti("Spacing=\"-1 1 1\" Direction=\"0 -1 0 1 0 0 0 0 1\"")));
  EXPECT_EQ(At(grid, {1, 0, 0}), (math::Vec3d{0, -3, 0}));
  for (const char* bad :
       {"Spacing=\"0 1 1\"", "Spacing=\"nan 1 1\"", "Spacing=\"1 1\"", "Origin=\"nan 0 0\"",
        "Direction=\"1 0 0 0 1 0 0 0\"", "Direction=\"1 0 0 1 0 0 0 0 1\""}) {
    EXPECT_FALSE(Open("a.vti", vti(bad)).ok()) << bad;
  }
  for (const char* bad : {"0 1 1", "1 nan 1", "1 1 inf"}) {
    const std::string bytes = vti(
        absl::StrCat("Origin=\"10 20 30\" Direction=\"0 -1 0 1 0 0 0 0 1\" Spacing=\"", bad, "\""));
    ExpectGiven("a.vti", bytes, "--spacing X,Y,Z");
    ISOSCOPE_ASSERT_OK_AND_ASSIGN(grid, Open("a.vti", bytes, {.has_spacing = true}));
    EXPECT_EQ(grid.direction.columns[0], (math::Vec3d{0, 1, 0}));
    // The extent begins at 2, which moves the origin if there is a distance.
    EXPECT_EQ(grid.origin, (math::Vec3d{10, bad[0] == '0' ? 20.0 : 22.0, 30}));
  }
  ExpectGiven("a.vti", vti("Origin=\"0 nan 0\""), "--origin X,Y,Z");
  for (const char* bad : {"1 0 0 1 0 0 0 0 1", "nan 0 0 0 1 0 0 0 1"}) {
    ExpectGiven("a.vti", vti(absl::StrCat("Direction=\"", bad, "\"")), "--direction XX");
  }
  const auto legacy = [](const std::string& lines) {
    return absl::StrCat(
        "# vtk DataFile Version 3.0\nt\nASCII\nDATASET STRUCTURED_POINTS\n"
        "DIMENSIONS 3 2 2\nORIGIN 10 20 30\n",
        lines, "POINT_DATA 12\nSCALARS p int 1\nLOOKUP_TABLE default\n",
        "1 2 3 4 5 6 7 8 9 10 11 12\n");
  };
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(grid, Open("a.vtk", legacy("SPACING -0.5 1 -2\n")));
  EXPECT_EQ(At(grid, {2, 1, 1}), (math::Vec3d{9, 21, 28}));
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(grid, Open("a.vtk", legacy("ASPECT_RATIO 3 2 1\n")));
  EXPECT_EQ(grid.spacing, (math::Vec3d{3, 2, 1}));
  for (const char* bad : {"SPACING 0 1 1\n", "SPACING nan 1 1\n"}) {
    ExpectGiven("a.vtk", legacy(bad), "--spacing X,Y,Z");
  }
  ExpectGiven("a.vtk", absl::StrReplaceAll(legacy(""), {{"10 20 30", "10 inf 30"}}),
              "--origin X,Y,Z");
}

}  // namespace
}  // namespace isoscope::source
