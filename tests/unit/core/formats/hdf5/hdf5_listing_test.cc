#include "core/formats/hdf5/hdf5_listing.h"

#include <string>
#include <vector>

#include "gmock/gmock.h"
#include "gtest/gtest.h"

#include "core/source/hdf5/hdf5_handle.h"
#include "hdf5.h"
#include "tests/support/hdf5_file.h"
#include "tests/support/temp_dir.h"

namespace isoscope::source {
namespace {

using ::isoscope::testing::TempDir;
using ::isoscope::testing::WriteHdf5Dataset;
using ::isoscope::testing::WriteHdf5Numbers;
using ::isoscope::testing::WriteHdf5Texts;
using ::testing::ElementsAre;
using ::testing::HasSubstr;

class Hdf5ListingTest : public ::testing::Test {
 protected:
  Hdf5ListingTest() : file_(Create("a.h5")) { H5Eset_auto2(H5E_DEFAULT, nullptr, nullptr); }
  Hdf5Handle Create(const std::string& name) {
    return {H5Fcreate(dir_.Sub(name).c_str(), H5F_ACC_TRUNC, H5P_DEFAULT, H5P_DEFAULT), H5Fclose};
  }
  void Write(const std::string& name, const std::vector<hsize_t>& dims, hid_t type = H5T_STD_U8LE,
             const std::vector<hsize_t>& chunk = {}) {
    WriteHdf5Dataset(file_.get(), name, dims, type, zeros_.data(), chunk);
  }
  [[nodiscard]] std::vector<std::string> Names() const {
    std::vector<std::string> names;
    for (const Hdf5Entry& entry : ListHdf5Entries(file_.get())) {
      names.push_back(entry.name);
    }
    return names;
  }
  [[nodiscard]] std::string List() const {
    return DescribeHdf5Entries(ListHdf5Entries(file_.get()));
  }
  const TempDir dir_;
  const Hdf5Handle file_;
  const std::vector<double> zeros_ = std::vector<double>(4000, 0);
};

TEST_F(Hdf5ListingTest, VolumesAreListedWithShapeTypeAndFilters) {
  Write("float", {5, 6, 7}, H5T_IEEE_F32LE, {5, 6, 7});
  Write("ids", {5, 6, 7}, H5T_STD_I64LE);
  Write("series", {2, 5, 6, 7}, H5T_STD_U16LE);
  Write("plane", {5, 6});
  EXPECT_EQ(
      List(),
      "/float (5 x 6 x 7 float32, gzip), /ids (5 x 6 x 7 int64), /series (2 x 5 x 6 x 7 uint16)");
}

TEST_F(Hdf5ListingTest, WithoutVolumesItSaysWhatThereIsInstead) {
  Write("plane", {5, 6});
  Write("text", {2}, H5T_C_S1);
  EXPECT_EQ(
      List(),
      "no dataset of numbers with three axes or more, but /plane (5 x 6 uint8), /text (2 texts)");
  for (char name = 'a'; name < 'h'; ++name) {
    Write(std::string(1, name), {3});
  }
  EXPECT_THAT(List(), HasSubstr("/f (3 uint8), and 3 more"));
  EXPECT_EQ(DescribeHdf5Entries({}), "no dataset of numbers with three axes or more");
}

TEST_F(Hdf5ListingTest, LinksAreFollowedOnceAndCirclesEnd) {
  H5Gclose(H5Gcreate2(file_.get(), "g", H5P_DEFAULT, H5P_DEFAULT, H5P_DEFAULT));
  Write("g/v", {2, 3, 4});
  H5Lcreate_hard(file_.get(), "g/v", file_.get(), "same", H5P_DEFAULT, H5P_DEFAULT);
  H5Lcreate_soft("/g/v", file_.get(), "soft", H5P_DEFAULT, H5P_DEFAULT);
  H5Lcreate_hard(file_.get(), "/", file_.get(), "g/root", H5P_DEFAULT, H5P_DEFAULT);
  H5Lcreate_soft("/nowhere", file_.get(), "broken", H5P_DEFAULT, H5P_DEFAULT);
  EXPECT_THAT(Names(), ElementsAre("/g/v"));
}

TEST_F(Hdf5ListingTest, DatasetsOfOtherFilesAreListedAndMissingFilesNamed) {
  {
    const Hdf5Handle other = Create("other.h5");
    WriteHdf5Dataset(other.get(), "v", {2, 3, 4}, H5T_STD_U8LE, zeros_.data());
  }
  H5Lcreate_external("other.h5", "/v", file_.get(), "data_1", H5P_DEFAULT, H5P_DEFAULT);
  H5Lcreate_external("lost.h5", "/v", file_.get(), "data_2", H5P_DEFAULT, H5P_DEFAULT);
  EXPECT_EQ(List(), "/data_1 (2 x 3 x 4 uint8), /data_2 (in lost.h5, which is missing)");
}

TEST_F(Hdf5ListingTest, MatlabsTextsEmptyArraysAndInternalGroupsAreLeftOut) {
  H5Gclose(H5Gcreate2(file_.get(), "#refs#", H5P_DEFAULT, H5P_DEFAULT, H5P_DEFAULT));
  Write("#refs#/a", {2, 3, 4});
  Write("text", {2, 3, 4}, H5T_STD_U16LE);
  WriteHdf5Texts(file_.get(), "text", "MATLAB_class", {"char"});
  Write("nothing", {3, 3, 3}, H5T_STD_U64LE);
  WriteHdf5Texts(file_.get(), "nothing", "MATLAB_class", {"double"});
  WriteHdf5Numbers(file_.get(), "nothing", "MATLAB_empty", {1});
  Write("V", {2, 3, 4}, H5T_IEEE_F64LE);
  WriteHdf5Texts(file_.get(), "V", "MATLAB_class", {"double"});
  EXPECT_THAT(Names(), ElementsAre("/V"));
}

TEST_F(Hdf5ListingTest, VolumeHasThreeAxesOrMoreAndIsNotEmpty) {
  Hdf5Entry entry{.name = "/v", .dims = {2, 3, 4}, .is_samples = true};
  EXPECT_TRUE(IsHdf5Volume(entry));
  EXPECT_TRUE(IsHdf5Volume(entry, 3));
  EXPECT_FALSE(IsHdf5Volume(entry, 4));
  entry.is_samples = false;
  EXPECT_FALSE(IsHdf5Volume(entry));
  entry = {.name = "/v", .dims = {2, 0, 4}, .is_samples = true};
  EXPECT_FALSE(IsHdf5Volume(entry));
  entry.dims = {2, 3};
  EXPECT_FALSE(IsHdf5Volume(entry));
}

TEST_F(Hdf5ListingTest, LongListsAreCut) {
  std::vector<Hdf5Entry> entries(
      53, {.name = "/v", .dims = {2, 3, 4}, .type = "uint8", .is_samples = true});
  EXPECT_THAT(DescribeHdf5Entries(entries), ::testing::EndsWith("uint8), and 3 more"));
}

}  // namespace
}  // namespace isoscope::source
