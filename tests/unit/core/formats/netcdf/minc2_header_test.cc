#include "core/formats/netcdf/minc2_header.h"

#include <array>
#include <cmath>
#include <string>
#include <vector>

#include "gmock/gmock.h"
#include "gtest/gtest.h"

#include "core/source/hdf5/hdf5_file.h"
#include "core/source/hdf5/hdf5_handle.h"
#include "hdf5.h"
#include "tests/support/hdf5_file.h"
#include "tests/support/status_matchers.h"
#include "tests/support/temp_dir.h"

namespace isoscope::source {
namespace {

using ::isoscope::testing::StatusIs;
using ::isoscope::testing::TempDir;
using ::isoscope::testing::WriteHdf5Dataset;
using ::isoscope::testing::WriteHdf5Numbers;
using ::isoscope::testing::WriteHdf5Texts;
using ::testing::AllOf;
using ::testing::ElementsAre;
using ::testing::HasSubstr;

constexpr auto kInvalid = absl::StatusCode::kInvalidArgument;
constexpr char kImage[] = "/minc-2.0/image/0/image";

// What the tests change of a header; that of yspace and zspace is good.
struct Minc2 {
  std::vector<double> step{-1.5};
  std::vector<double> start{10};
  std::vector<double> cosines{0, 1, 0};
  std::string unit = "mm";
  std::string spacing = "regular__";
  std::vector<double> valid{0, 255};
  std::vector<double> most{1, 2};
  std::vector<double> least{0, 0};
  hid_t type = H5T_STD_U8LE;
};

class Minc2HeaderTest : public ::testing::Test {
 protected:
  Minc2HeaderTest() { PrepareHdf5(); }
  absl::StatusOr<std::array<double, 3>> Check(const Minc2& minc) {
    Hdf5Handle file(H5Fcreate(path_.c_str(), H5F_ACC_TRUNC, H5P_DEFAULT, H5P_DEFAULT), H5Fclose);
    for (const char* group :
         {"/minc-2.0", "/minc-2.0/dimensions", "/minc-2.0/image", "/minc-2.0/image/0"}) {
      H5Gclose(H5Gcreate2(file.get(), group, H5P_DEFAULT, H5P_DEFAULT, H5P_DEFAULT));
    }
    const std::vector<double> zeros(2, 0);
    for (const char axis : {'x', 'y', 'z'}) {
      const std::string name = std::string("/minc-2.0/dimensions/") + axis + "space";
      const bool is_good = axis != 'x';
      WriteHdf5Dataset(file.get(), name, {1}, H5T_IEEE_F64LE, zeros.data());
      WriteHdf5Numbers(file.get(), name, "step", is_good ? std::vector<double>{2} : minc.step);
      WriteHdf5Numbers(file.get(), name, "start", is_good ? std::vector<double>{5} : minc.start);
      WriteHdf5Texts(file.get(), name, "units", {is_good ? "mm" : minc.unit}, axis != 'y');
      WriteHdf5Texts(file.get(), name, "spacing", {is_good ? "regular__" : minc.spacing}, true);
      if (!is_good) {
        WriteHdf5Numbers(file.get(), name, "direction_cosines", minc.cosines);
      }
    }
    const std::vector<double> samples(2, 0);
    WriteHdf5Dataset(file.get(), kImage, {2}, minc.type, samples.data());
    WriteHdf5Numbers(file.get(), kImage, "valid_range", minc.valid);
    WriteHdf5Dataset(file.get(), "/minc-2.0/image/0/image-max", {2}, H5T_IEEE_F64LE,
                     minc.most.data());
    WriteHdf5Dataset(file.get(), "/minc-2.0/image/0/image-min", {2}, H5T_IEEE_F64LE,
                     minc.least.data());
    file = Hdf5Handle();
    return CheckMinc2Header(path_);
  }
  const TempDir dir_;
  const std::string path_ = dir_.Sub("a.mnc");
};

TEST_F(Minc2HeaderTest, AxesThatAreNoneAreRefusedByName) {
  EXPECT_THAT(Check({.step = {0}}),
              StatusIs(kInvalid, AllOf(HasSubstr("a.mnc: MINC 2: the step of xspace is 0"))));
  EXPECT_THAT(Check({.step = {NAN}}), StatusIs(kInvalid, HasSubstr("the step of xspace is nan")));
  EXPECT_THAT(Check({.start = {INFINITY}}),
              StatusIs(kInvalid, HasSubstr("the start of xspace is inf")));
  for (const std::vector<double>& cosines :
       {std::vector<double>{2, 0, 0}, {0, 0, 0}, {NAN, 0, 0}, {1, 0}}) {
    EXPECT_THAT(Check({.cosines = cosines}),
                StatusIs(kInvalid, HasSubstr("the direction_cosines of xspace are")));
  }
  EXPECT_THAT(Check({.spacing = "irregular"}),
              StatusIs(kInvalid, HasSubstr("xspace lie at uneven distances")));
  EXPECT_THAT(Check({.unit = "s"}), StatusIs(kInvalid, HasSubstr("the units of xspace are \"s\"")));
}

TEST_F(Minc2HeaderTest, UnitsBecomeMillimetres) {
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(const auto same, Check({}));
  EXPECT_THAT(same, ElementsAre(1, 1, 1));
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(const auto missing, Check({.unit = " "}));
  EXPECT_THAT(missing, ElementsAre(1, 1, 1));
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(const auto mixed, Check({.unit = "cm"}));
  EXPECT_THAT(mixed, ElementsAre(::testing::DoubleEq(10), 1, 1));
}

TEST_F(Minc2HeaderTest, ScaleOfIntegersIsFinite) {
  EXPECT_THAT(Check({.valid = {NAN, 255}}),
              StatusIs(kInvalid, HasSubstr("its valid_range has nan at index 0")));
  EXPECT_THAT(Check({.most = {1, NAN}}),
              StatusIs(kInvalid, HasSubstr("its image-max has nan at index 1")));
  EXPECT_THAT(Check({.least = {-INFINITY, 0}}),
              StatusIs(kInvalid, HasSubstr("its image-min has -inf at index 0")));
  // Floats are real values, whose limits are not used.
  EXPECT_TRUE(Check({.most = {1, NAN}, .type = H5T_IEEE_F64LE}).ok());
}

TEST_F(Minc2HeaderTest, OtherLayoutsAreLeftToTheLibraries) {
  H5Fclose(H5Fcreate(path_.c_str(), H5F_ACC_TRUNC, H5P_DEFAULT, H5P_DEFAULT));
  EXPECT_TRUE(CheckMinc2Header(path_).ok());
}

}  // namespace
}  // namespace isoscope::source
