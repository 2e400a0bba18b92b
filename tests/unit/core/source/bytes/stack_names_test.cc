#include "core/source/bytes/stack_names.h"

#include <algorithm>
#include <string>
#include <vector>

#include "gmock/gmock.h"
#include "gtest/gtest.h"

#include "core/source/bytes/named_files.h"
#include "tests/support/status_matchers.h"
#include "tests/support/temp_dir.h"
#include "tests/support/volume_files.h"

namespace isoscope::source {
namespace {

using ::isoscope::testing::StatusIs;
using ::testing::AllOf;
using ::testing::HasSubstr;

constexpr auto kInvalid = absl::StatusCode::kInvalidArgument;

bool IsAny(const std::string& /*path*/) { return true; }

class StackNamesTest : public ::testing::Test {
 protected:
  // The check of a folder with these files.
  absl::Status Check(const std::vector<std::string>& names) {
    for (const std::string& name : names) {
      testing::WriteFile(dir_.Sub(name), "");
    }
    return CheckStackNames("d", FilesNamed(dir_.Sub(""), IsAny));
  }
  const testing::TempDir dir_;
};

class SoundStackNamesTest : public StackNamesTest,
                            public ::testing::WithParamInterface<std::vector<std::string>> {};

TEST_P(SoundStackNamesTest, AreTaken) { ISOSCOPE_EXPECT_OK(Check(GetParam())); }

INSTANTIATE_TEST_SUITE_P(
    Names, SoundStackNamesTest,
    ::testing::Values(std::vector<std::string>{"a1.png", "a2.png", "a10.png", "a9.png", "a8.png",
                                               "a7.png", "a6.png", "a5.png", "a4.png", "a3.png"},
                      std::vector<std::string>{"007.tif", "008.tif"},
                      std::vector<std::string>{"z0.tif", "z5.tif", "z10.tif"},
                      std::vector<std::string>{"s2_z1_c3.tif", "s2_z2_c3.tif", "s2_z3_c3.tif"},
                      std::vector<std::string>{"a1.tif", "a2.TIFF", "a3.TIF", "a4.tiff"},
                      // A time that goes up with the number, unevenly.
                      std::vector<std::string>{"101500_1.tif", "101507_2.tif", "101509_3.tif"},
                      std::vector<std::string>{"1_101500.tif", "2_101507.tif", "3_101509.tif"}));

TEST_F(StackNamesTest, MissingSlicesAreNamed) {
  EXPECT_THAT(
      Check({"a1.png", "a2.png", "a4.png", "a8.png", "a9.png"}),
      StatusIs(
          kInvalid,
          AllOf(HasSubstr("d: slices are missing between a2.png and a4.png: "
                          "3, 5 to 7;"),
                HasSubstr("--axes Z (of render: --input-axes Z) takes the files as neighbours"))));
}

TEST_F(StackNamesTest, MissingSlicesOfWiderSteps) {
  EXPECT_THAT(Check({"z0.tif", "z5.tif", "z15.tif"}),
              StatusIs(kInvalid, HasSubstr("between z5.tif and z15.tif: 10;")));
}

TEST_F(StackNamesTest, NumbersThatAreNotEvenAreNamed) {
  EXPECT_THAT(
      Check({"a10.png", "a12.png", "a17.png"}),
      StatusIs(kInvalid, HasSubstr("of a12.png and a17.png are 5 apart, those of others 2")));
}

TEST_F(StackNamesTest, SameNumberTwiceIsNamed) {
  EXPECT_THAT(Check({"a1.png", "a01.png"}),
              StatusIs(kInvalid, AllOf(HasSubstr("a01.png and a1.png have the same number"),
                                       HasSubstr("--axes Z"))));
}

TEST_F(StackNamesTest, SameNumberTwiceAmongOthers) {
  EXPECT_THAT(Check({"a1.png", "a01.png", "a2.png", "a3.png"}),
              StatusIs(kInvalid, HasSubstr("a01.png and a1.png have the same number")));
}

TEST_F(StackNamesTest, SeveralStacksAreNamedWithAPatternThatGivesOneOfThem) {
  EXPECT_THAT(
      Check({"ct1.png", "ct2.png", "ct3.png", "mask1.png", "mask2.png"}),
      StatusIs(kInvalid, AllOf(HasSubstr("d: files of several stacks: ct[0-9]*.png (3 files), "
                                         "mask[0-9]*.png (2 files); choose one, as in '" +
                                         dir_.Sub("") + "ct[0-9]*.png'"))));
}

TEST_F(StackNamesTest, FileWithoutANumberIsOfAnotherStack) {
  EXPECT_THAT(Check({"overview.png", "s1.png", "s2.png"}),
              StatusIs(kInvalid, HasSubstr("s[0-9]*.png (2 files), overview.png; choose one")));
}

TEST_F(StackNamesTest, TwoNumbersThatVaryAreSeveralStacks) {
  EXPECT_THAT(Check({"z1_c1.tif", "z1_c2.tif", "z2_c1.tif", "z2_c2.tif"}),
              StatusIs(kInvalid, AllOf(HasSubstr("several stacks: z[0-9]*_c1.tif (2 files), "
                                                 "z[0-9]*_c2.tif (2 files)"))));
}

// A pattern of one of them would take each second slice.
TEST_F(StackNamesTest, DecimalsAreHeightsOrSeveralStacks) {
  EXPECT_THAT(
      Check({"z0.5.png", "z1.0.png", "z1.5.png", "z2.0.png"}),
      StatusIs(kInvalid, AllOf(HasSubstr("d: the numbers of z0.5.png to z2.0.png read as "
                                         "decimals, heights of one stack"),
                               HasSubstr("--axes Z"), ::testing::Not(HasSubstr("[0-9]*")))));
}

TEST_F(StackNamesTest, NumbersBesideAPointThatDoNotAscendAreSeveralStacks) {
  EXPECT_THAT(Check({"z1.9.png", "z1.10.png", "z2.9.png", "z2.10.png"}),
              StatusIs(kInvalid, HasSubstr("several stacks: z[0-9]*.9.png (2 files)")));
}

TEST_F(StackNamesTest, FilesWithoutNumbersHaveNoOrder) {
  EXPECT_THAT(Check({"a.png", "b.png", "c.png", "d.png", "e.png"}),
              StatusIs(kInvalid, HasSubstr("no number says in which order the files lie: a.png, "
                                           "b.png, c.png, 2 more; number them, as in z1.png, "
                                           "z2.png, ...; or --axes Z")));
}

TEST_F(StackNamesTest, ManyStacksAreCounted) {
  EXPECT_THAT(
      Check({"a1.png", "a2.png", "b1.png", "b2.png", "c1.png", "d1.png", "e1.png"}),
      StatusIs(kInvalid, AllOf(HasSubstr("several stacks: a[0-9]*.png (2 files), b[0-9]*.png "
                                         "(2 files), c1.png, 2 more; choose one, as in"),
                               HasSubstr("or --axes Z"))));
}

TEST_F(StackNamesTest, NumbersBeyond64BitsAreNotMixedUp) {
  EXPECT_THAT(Check({"99999999999999999991.png", "99999999999999999992.png"}),
              StatusIs(kInvalid, HasSubstr("have the same number")));
}

// What a series of steps lacks, where its names tell.
TEST(NamesMissingBetweenTest, NamesThoseBetweenTheirNeighbours) {
  using ::testing::ElementsAre;
  using ::testing::IsEmpty;
  EXPECT_THAT(NamesMissingBetween({"d3/run_0.vti", "d3/run_1.vti", "d3/run_3.vti"}, 4),
              ElementsAre("run_2.vti"));
  EXPECT_THAT(NamesMissingBetween({"run_0.vti", "run_2.vti"}, 3), ElementsAre("run_1.vti"));
  EXPECT_THAT(NamesMissingBetween({"r008.vti", "r009.vti", "r012.vti"}, 4),
              ElementsAre("r010.vti", "r011.vti"));
  EXPECT_THAT(NamesMissingBetween({"r2_0.vti", "r2_10.vti", "r2_30.vti"}, 4),
              ElementsAre("r2_20.vti"));
  EXPECT_THAT(NamesMissingBetween({"r1.vti", "r2.vti", "r100.vti"}, 4),
              ElementsAre("r3.vti", "r4.vti", "r5.vti", "r6.vti", "r7.vti"));
  // The first or the last one; distances that are several; names that are not of one series.
  for (const std::vector<std::string>& files : {std::vector<std::string>{},
                                                {"r1.vti"},
                                                {"r1.vti", "r2.vti"},
                                                {"r0.vti", "r20.vti"},
                                                {"a.vti", "b.vti"},
                                                {"a1.vti", "b3.vti"},
                                                {"a1_1.vti", "a2_3.vti"},
                                                {"a1.vti", "a01.vti"}}) {
    EXPECT_THAT(NamesMissingBetween(files, 3), IsEmpty());
  }
}

}  // namespace
}  // namespace isoscope::source
