#include "core/formats/hdf5/hdf5_attributes.h"

#include <string>
#include <vector>

#include "gmock/gmock.h"
#include "gtest/gtest.h"

#include "hdf5.h"
#include "tests/support/hdf5_file.h"
#include "tests/support/status_matchers.h"
#include "tests/support/temp_dir.h"

namespace isoscope::source {
namespace {

using ::isoscope::testing::StatusIs;
using ::isoscope::testing::TempDir;
using ::isoscope::testing::WriteHdf5Dataset;
using ::isoscope::testing::WriteHdf5Scales;
using ::isoscope::testing::WriteHdf5Texts;
using ::testing::AllOf;
using ::testing::ElementsAre;
using ::testing::HasSubstr;
using ::testing::IsEmpty;

class Hdf5AttributesTest : public ::testing::Test {
 protected:
  Hdf5AttributesTest()
      : file_(H5Fcreate(dir_.Sub("a.h5").c_str(), H5F_ACC_TRUNC, H5P_DEFAULT, H5P_DEFAULT),
              H5Fclose) {
    H5Eset_auto2(H5E_DEFAULT, nullptr, nullptr);
    const std::vector<float> samples(2 * 2 * 2 * 3, 0);
    WriteHdf5Dataset(file_.get(), "u", {2, 2, 2, 3}, H5T_IEEE_F32LE, samples.data());
  }
  [[nodiscard]] Hdf5Handle Dataset(const std::string& name = "u") const {
    return {H5Dopen2(file_.get(), name.c_str(), H5P_DEFAULT), H5Dclose};
  }
  TempDir dir_;
  Hdf5Handle file_;
};

TEST_F(Hdf5AttributesTest, TextsOfBothKinds) {
  WriteHdf5Texts(file_.get(), "u", "any", {"t", "", "a long one, longer than sixteen"});
  WriteHdf5Texts(file_.get(), "u", "fixed", {"one", "sixteen bytes 16"}, true);
  const Hdf5Handle u = Dataset();
  EXPECT_THAT(Hdf5Texts(u.get(), "any"), ElementsAre("t", "", "a long one, longer than sixteen"));
  EXPECT_THAT(Hdf5Texts(u.get(), "fixed"), ElementsAre("one", "sixteen bytes 16"));
  EXPECT_THAT(Hdf5Texts(u.get(), "none"), IsEmpty());
  EXPECT_EQ(Hdf5Text(u.get(), {"none", "fixed", "any"}), "one");
  EXPECT_EQ(Hdf5Text(u.get(), {"none"}), "");
}

TEST_F(Hdf5AttributesTest, NumbersAreNoTexts) {
  const double number = 3;
  const Hdf5Handle u = Dataset();
  const Hdf5Handle space(H5Screate(H5S_SCALAR), H5Sclose);
  const Hdf5Handle attribute(
      H5Acreate2(u.get(), "axes", H5T_IEEE_F64LE, space.get(), H5P_DEFAULT, H5P_DEFAULT), H5Aclose);
  H5Awrite(attribute.get(), H5T_IEEE_F64LE, &number);
  EXPECT_THAT(Hdf5Texts(u.get(), "axes"), IsEmpty());
}

TEST_F(Hdf5AttributesTest, ScaleOfEachAxis) {
  const std::vector<double> times{0.5, 2};
  WriteHdf5Dataset(file_.get(), "time", {2}, H5T_IEEE_F64LE, times.data());
  WriteHdf5Scales(file_.get(), "u", {"/time", "", "", ""});
  const Hdf5Handle u = Dataset();
  EXPECT_FALSE(Hdf5ScaleOf(u.get(), 1, 4).is_valid());
  EXPECT_FALSE(Hdf5ScaleOf(u.get(), 0, 3).is_valid());
  const Hdf5Handle scale = Hdf5ScaleOf(u.get(), 0, 4);
  ASSERT_TRUE(scale.is_valid());
  EXPECT_EQ(Hdf5ScaleName(scale.get()), "time");
}

TEST_F(Hdf5AttributesTest, ScaleMustAscend) {
  const std::vector<double> falling{0, 2, 2};
  const std::vector<std::int32_t> rising{-1, 2, 7};
  WriteHdf5Dataset(file_.get(), "falling", {3}, H5T_IEEE_F64LE, falling.data());
  WriteHdf5Dataset(file_.get(), "rising", {3}, H5T_STD_I32LE, rising.data());
  WriteHdf5Dataset(file_.get(), "empty", {3}, H5T_STD_I32LE, rising.data());
  WriteHdf5Texts(file_.get(), "empty", "NAME",
                 {"This is a netCDF dimension but not a netCDF variable.        3"});
  EXPECT_THAT(Hdf5ScaleValues(Dataset("falling").get(), 3),
              StatusIs(absl::StatusCode::kInvalidArgument,
                       AllOf(HasSubstr("\"falling\" has 2 at index 2"), HasSubstr("behind 2"))));
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(const auto values, Hdf5ScaleValues(Dataset("rising").get(), 3));
  EXPECT_THAT(values, ElementsAre(-1, 2, 7));
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(const auto none, Hdf5ScaleValues(Dataset("empty").get(), 3));
  EXPECT_THAT(none, IsEmpty());
}

}  // namespace
}  // namespace isoscope::source
