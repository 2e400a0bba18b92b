#include "core/formats/medical/nrrd_layout.h"

#include <cstdint>
#include <string>
#include <vector>

#include "absl/strings/str_cat.h"
#include "gmock/gmock.h"
#include "gtest/gtest.h"
#include "itkNrrdImageIO.h"

#include "tests/support/status_matchers.h"
#include "tests/support/temp_dir.h"
#include "tests/support/volume_files.h"

namespace isoscope::source {
namespace {

using ::isoscope::testing::StatusIs;
using ::testing::AllOf;
using ::testing::ElementsAre;
using ::testing::HasSubstr;
using ::testing::IsEmpty;
using volume::ScalarType;

constexpr auto kInvalid = absl::StatusCode::kInvalidArgument;

class NrrdLayoutTest : public ::testing::Test {
 protected:
  std::string Write(const std::string& lines) {
    return dir_.Write("a.nrrd",
                      absl::StrCat("NRRD0005\ntype: short\nencoding: raw\nendian: little\n", lines,
                                   "\n", std::string(4096, 'x')));
  }
  testing::TempDir dir_;
};

TEST_F(NrrdLayoutTest, TypesByAllTheirNames) {
  struct Row {
    ScalarType type;
    std::vector<const char*> names;
  };
  for (const Row& row : std::vector<Row>{
           {ScalarType::kInt8, {"signed char", "int8", "int8_t"}},
           {ScalarType::kUint8, {"uchar", "unsigned char", "uint8", "uint8_t"}},
           {ScalarType::kInt16,
            {"short", "short int", "signed short", "signed short int", "int16", "int16_t"}},
           {ScalarType::kUint16,
            {"ushort", "unsigned short", "unsigned short int", "uint16", "uint16_t"}},
           {ScalarType::kInt32, {"int", "signed int", "int32", "int32_t"}},
           {ScalarType::kUint32, {"uint", "unsigned int", "uint32", "uint32_t"}},
           {ScalarType::kFloat32, {"float"}},
           {ScalarType::kFloat64, {"double"}}}) {
    for (const char* name : row.names) {
      const auto type = NrrdTypeFromName(name);
      ASSERT_TRUE(type.has_value()) << name;
      EXPECT_EQ(type->scalar, row.type) << name;
      EXPECT_FALSE(type->wide.has_value()) << name;
    }
  }
  for (const char* name : {"longlong", "long long", "long long int", "signed long long",
                           "signed long long int", "int64", "int64_t"}) {
    ASSERT_TRUE(NrrdTypeFromName(name).has_value()) << name;
    EXPECT_EQ(NrrdTypeFromName(name)->wide, WideType::kInt64) << name;
  }
  for (const char* name :
       {"ulonglong", "unsigned long long", "unsigned long long int", "uint64", "uint64_t"}) {
    ASSERT_TRUE(NrrdTypeFromName(name).has_value()) << name;
    EXPECT_EQ(NrrdTypeFromName(name)->wide, WideType::kUint64) << name;
  }
  for (const char* name : {"", "block", "float16", "unsigned", "long", "u"}) {
    EXPECT_FALSE(NrrdTypeFromName(name).has_value()) << name;
  }
}

TEST_F(NrrdLayoutTest, ListsKeepParenthesesAndTexts) {
  EXPECT_THAT(SplitNrrdList("(1, 0,0) none  (0,0,2)"), ElementsAre("(1, 0,0)", "none", "(0,0,2)"));
  EXPECT_THAT(SplitNrrdList("\"\" \"a b\" mm"), ElementsAre("", "a b", "mm"));
  EXPECT_THAT(SplitNrrdList(" "), IsEmpty());
  EXPECT_THAT(SplitNrrdList("(1,0"), ElementsAre("(1,0"));
  EXPECT_THAT(SplitNrrdList("\"a"), ElementsAre("a"));
}

// Vectors are what ITK reads, too: the same grid.
TEST_F(NrrdLayoutTest, VectorsHaveTheGridThatItkReads) {
  for (const char* space : {"left-posterior-superior", "right-anterior-superior", "RAS"}) {
    const std::string path = Write(absl::StrCat(
        "dimension: 4\nsizes: 3 7 6 5\nkinds: vector domain domain domain\nspace: ", space,
        "\nspace directions: none (0.1,1.5,0.3) (-2,0.2,0) (0,0.7,3)\nspace origin: (10,20,30)\n"));
    ISOSCOPE_ASSERT_OK_AND_ASSIGN(const NrrdLayout layout, ReadNrrdLayout(path));
    const auto itk = itk::NrrdImageIO::New();
    itk->SetFileName(path);
    itk->ReadImageInformation();
    volume::GridGeometry geometry;
    for (unsigned axis = 0; axis < 3; ++axis) {
      const int index = static_cast<int>(axis);
      geometry.sample_dims[index] = static_cast<std::int64_t>(itk->GetDimensions(axis));
      geometry.spacing[index] = itk->GetSpacing(axis);
      geometry.origin[index] = itk->GetOrigin(axis);
      const std::vector<double> direction = itk->GetDirection(axis);
      geometry.direction.columns[axis] = {direction[0], direction[1], direction[2]};
    }
    EXPECT_EQ(layout.grid.geometry, geometry) << space;
    EXPECT_TRUE(layout.grid.patient_frame.has_value());
    EXPECT_EQ(layout.tuples, 3);
    EXPECT_EQ(layout.volumes, 1);
    EXPECT_FALSE(layout.is_time);
    EXPECT_EQ(layout.type.scalar, ScalarType::kInt16);
  }
}

TEST_F(NrrdLayoutTest, TimeHasItsIntervalAndUnits) {
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(
      const NrrdLayout layout,
      ReadNrrdLayout(Write("dimension: 4\nsizes: 7 6 5 9\nkinds: domain domain domain time\n"
                           "spacings: 1 2 3 0.25\nunits: \"mm\" \"mm\" \"mm\" \"ms\"\n"
                           "sample units: \"K\"\n")));
  EXPECT_EQ(layout.grid.geometry.sample_dims, (math::Index3{7, 6, 5}));
  EXPECT_EQ(layout.grid.geometry.spacing, (math::Vec3d{1, 2, 3}));
  EXPECT_TRUE(layout.is_time);
  EXPECT_EQ(layout.volumes, 9);
  EXPECT_EQ(layout.interval, 0.25);
  EXPECT_EQ(layout.time_unit, "ms");
  EXPECT_EQ(layout.grid.length_unit, "mm");
  EXPECT_EQ(layout.sample_unit, "K");
}

TEST_F(NrrdLayoutTest, TimeMayBeAnAxisOfTheSpace) {
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(
      const NrrdLayout layout,
      ReadNrrdLayout(Write("dimension: 4\nsizes: 7 6 5 9\nspace: RAS-time\nspace directions: "
                           "(1,0,0,0) (0,1,0,0) (0,0,3,0) (0,0,0,0.5)\n")));
  EXPECT_TRUE(layout.is_time);
  EXPECT_EQ(layout.volumes, 9);
  EXPECT_EQ(layout.interval, 0.5);
  EXPECT_EQ(layout.grid.geometry.spacing, (math::Vec3d{1, 1, 3}));
}

// Steps that were 0, negative or unknown apart became 1 apart, with the unit of the header.
TEST_F(NrrdLayoutTest, DistancesOfStepsAreAboveZeroOrNotKnown) {
  const auto read = [&](const std::string& spacing, const std::string& more = "") {
    return ReadNrrdLayout(
        Write(absl::StrCat("dimension: 4\nsizes: 7 6 5 4\nkinds: domain domain domain time\n"
                           "spacings: 1 2 3 ",
                           spacing, "\nunits: \"mm\" \"mm\" \"mm\" \"s\"\n", more)));
  };
  for (const char* bad : {"0", "-2", "inf", "-inf"}) {
    EXPECT_THAT(read(bad), StatusIs(kInvalid, AllOf(HasSubstr(bad), HasSubstr("axis 3, of time"))));
  }
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(NrrdLayout layout, read("nan"));
  EXPECT_EQ(layout.interval, 1);
  EXPECT_EQ(layout.time_unit, "");
  // The bounds of the axis.
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(layout, read("2", "axis mins: 0 0 0 10\n"));
  EXPECT_EQ(layout.first_time, 10);
  EXPECT_EQ(layout.interval, 2);
  EXPECT_EQ(layout.time_unit, "s");
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(layout,
                                read("2", "axis mins: 0 0 0 10\ncenters: cell cell cell cell\n"));
  EXPECT_EQ(layout.first_time, 11);
  for (const char* maxs : {"16", "18"}) {  // of samples, of cells
    ISOSCOPE_ASSERT_OK_AND_ASSIGN(
        layout,
        read("2", absl::StrCat("axis mins: nan nan nan 10\naxis maxs: nan nan nan ", maxs, "\n")));
    EXPECT_EQ(layout.first_time, maxs[1] == '6' ? 10 : 11);
  }
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(layout,
                                read("nan",
                                     "axis mins: nan nan nan 10\naxis maxs: nan nan nan 16\n"
                                     "centers: ??? ??? ??? node\n"));
  EXPECT_EQ(layout.first_time, 10);
  EXPECT_EQ(layout.interval, 2);
  for (const char* bad : {"axis mins: nan nan nan 10\n", "axis maxs: nan nan nan 16\n",
                          "axis mins: nan nan nan 10\naxis maxs: nan nan nan 16\n"}) {
    EXPECT_THAT(read("nan", bad), StatusIs(kInvalid, HasSubstr("of time"))) << bad;
  }
  EXPECT_THAT(read("2", "axis mins: nan nan nan 10\naxis maxs: nan nan nan 30\n"),
              StatusIs(kInvalid, HasSubstr("from 10 to 30")));
  EXPECT_THAT(read("2", "axis mins: nan nan nan inf\n"), StatusIs(kInvalid, HasSubstr("inf")));
}

TEST_F(NrrdLayoutTest, TimeOfASpaceBeginsAtItsOrigin) {
  const auto read = [&](const std::string& origin, const std::string& step = "2",
                        const std::string& more = "") {
    return ReadNrrdLayout(
        Write(absl::StrCat("dimension: 4\nsizes: 7 6 5 4\nspace: LPST\n"
                           "space directions: (1,0,0,0) (0,1,0,0) (0,0,1,0) (0,0,0,",
                           step, ")\nspace origin: (0,0,0,", origin, ")\n", more)));
  };
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(NrrdLayout layout,
                                read("10", "2", "space units: \"mm\" \"mm\" \"mm\" \"s\"\n"));
  EXPECT_EQ(layout.first_time, 10);
  EXPECT_EQ(layout.interval, 2);
  EXPECT_EQ(layout.time_unit, "s");
  EXPECT_EQ(layout.grid.length_unit, "mm");
  EXPECT_THAT(read("nan"), StatusIs(kInvalid, HasSubstr("the time of the space origin is nan")));
  for (const char* bad : {"-2", "nan", "inf"}) {
    EXPECT_THAT(read("10", bad), StatusIs(kInvalid, HasSubstr("of time"))) << bad;
  }
  EXPECT_THAT(read("10", "2", "spacings: nan nan nan 2\n"),
              StatusIs(kInvalid, HasSubstr("expected one of both")));
  EXPECT_THAT(read("10", "2", "space units: \"mm\" \"mm\" \"mm\"\n"),
              StatusIs(kInvalid, HasSubstr("expected 4 units")));
}

TEST_F(NrrdLayoutTest, HeadersThatDoNotSayItAreRefused) {
  const std::string head = "dimension: 4\nsizes: 7 6 5 9\nspacings: 1 1 1 1\n";
  for (const char* lines :
       {"", "kinds: domain domain domain domain\n", "kinds: list domain domain time\n",
        "kinds: domain list domain domain\n"}) {
    EXPECT_THAT(ReadNrrdLayout(Write(head + lines)), StatusIs(kInvalid, HasSubstr("not of space")))
        << lines;
  }
  const std::string kinds = "kinds: domain domain domain list\n";
  EXPECT_THAT(ReadNrrdLayout(Write(head + kinds + "axis mins: 1 1 1\n")),
              StatusIs(kInvalid, HasSubstr("3 axis mins for 4 axes")));
  EXPECT_THAT(ReadNrrdLayout(Write("sizes: 7 6 5\n" + kinds)),
              StatusIs(kInvalid, HasSubstr("for 3 axes")));
  EXPECT_THAT(ReadNrrdLayout(Write("sizes: 7 6 5 -9\n" + kinds)),
              StatusIs(kInvalid, HasSubstr("-9")));
  EXPECT_THAT(ReadNrrdLayout(Write(head + "kinds: domain list\n")),
              StatusIs(kInvalid, HasSubstr("2 kinds for 4 axes")));
  const std::string directions = "sizes: 7 6 5 9\nspace: LPS\nspace directions: (1,0,0) (0,1,0) ";
  for (const char* last :
       {"(0,0) none\n", "(0,0,x) none\n", "(0,0,0) none\n", "(0,0,nan) none\n"}) {
    const std::string path = Write(directions + last);
    const auto layout = ReadNrrdLayout(path);
    EXPECT_THAT(layout.ok() ? layout->grid.faults.Check({}, path) : layout.status(),
                StatusIs(kInvalid, HasSubstr("a.nrrd")))
        << last;
  }
}

}  // namespace
}  // namespace isoscope::source
