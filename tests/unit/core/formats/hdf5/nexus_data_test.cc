#include "core/formats/hdf5/nexus_data.h"

#include <string>
#include <vector>

#include "gmock/gmock.h"
#include "gtest/gtest.h"

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
using ::testing::ElementsAre;
using ::testing::HasSubstr;
using ::testing::IsEmpty;

constexpr auto kInvalid = absl::StatusCode::kInvalidArgument;

class NexusDataTest : public ::testing::Test {
 protected:
  NexusDataTest() { H5Eset_auto2(H5E_DEFAULT, nullptr, nullptr); }
  void Group(const std::string& name, const std::string& group_class) {
    H5Gclose(H5Gcreate2(file_.get(), name.c_str(), H5P_DEFAULT, H5P_DEFAULT, H5P_DEFAULT));
    WriteHdf5Texts(file_.get(), name, "NX_class", {group_class});
  }
  void Plot(const std::string& name, const std::string& signal) {
    Group(name, "NXdata");
    WriteHdf5Texts(file_.get(), name, "signal", {signal});
    Dataset(name + "/" + signal, {2, 3, 4});
  }
  void Dataset(const std::string& name, const std::vector<hsize_t>& dims) {
    const std::vector<double> zeros(200, 0);
    WriteHdf5Dataset(file_.get(), name, dims, H5T_IEEE_F64LE, zeros.data());
  }
  [[nodiscard]] Hdf5Handle Open(const std::string& name) const {
    return {H5Gopen2(file_.get(), name.c_str(), H5P_DEFAULT), H5Gclose};
  }
  const TempDir dir_;
  const Hdf5Handle file_{
      H5Fcreate(dir_.Sub("a.nxs").c_str(), H5F_ACC_TRUNC, H5P_DEFAULT, H5P_DEFAULT), H5Fclose};
};

TEST_F(NexusDataTest, AttributesLeadFromTheRootToTheSignal) {
  EXPECT_EQ(FindNexusDefault(file_.get()), "");
  Group("one", "NXentry");
  Group("two", "NXentry");
  Plot("two/first", "a");
  Plot("two/second", "b");
  EXPECT_EQ(FindNexusDefault(file_.get()), "") << "two entries, none by default";
  WriteHdf5Texts(file_.get(), "/", "default", {"two"});
  EXPECT_EQ(FindNexusDefault(file_.get()), "") << "two plots, none by default";
  WriteHdf5Texts(file_.get(), "two", "default", {"second"});
  EXPECT_EQ(FindNexusDefault(file_.get()), "/two/second/b");
}

TEST_F(NexusDataTest, OnlyEntryAndOnlyPlotAreTheDefault) {
  Group("entry", "NXentry");
  Group("entry/instrument", "NXinstrument");
  Plot("entry/data", "counts");
  EXPECT_EQ(FindNexusDefault(file_.get()), "/entry/data/counts");
}

TEST_F(NexusDataTest, DefaultThatIsNotThereIsNone) {
  Group("entry", "NXentry");
  Plot("entry/data", "counts");
  WriteHdf5Texts(file_.get(), "/", "default", {"lost"});
  EXPECT_EQ(FindNexusDefault(file_.get()), "");
}

TEST_F(NexusDataTest, SignalOfOlderFilesIsMarkedItself) {
  Group("g", "NXdata");
  Dataset("g/x", {4});
  Dataset("g/counts", {2, 3, 4});
  EXPECT_EQ(FindNexusSignal(Open("g").get()), "");
  WriteHdf5Numbers(file_.get(), "g/counts", "signal", {1});
  EXPECT_EQ(FindNexusSignal(Open("g").get()), "counts");
  WriteHdf5Texts(file_.get(), "g/counts", "axes", {"[z:.:x]"});
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(const auto axes, FindNexusAxes(Open("g").get(), "counts", 3));
  EXPECT_THAT(axes, ElementsAre("z", "", "x"));
  Group("other", "NXcollection");
  Dataset("other/counts", {2, 3, 4});
  WriteHdf5Numbers(file_.get(), "other/counts", "signal", {1});
  EXPECT_EQ(FindNexusSignal(Open("other").get()), "");
}

TEST_F(NexusDataTest, AxesOfTheGroupByTheirPlaceOrTheirIndices) {
  Plot("g", "v");
  WriteHdf5Texts(file_.get(), "g", "axes", {"z", ".", "x"});
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(const auto axes, FindNexusAxes(Open("g").get(), "v", 3));
  EXPECT_THAT(axes, ElementsAre("z", "", "x"));
  WriteHdf5Numbers(file_.get(), "g", "z_indices", {2});
  WriteHdf5Numbers(file_.get(), "g", "x_indices", {0});
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(const auto turned, FindNexusAxes(Open("g").get(), "v", 3));
  EXPECT_THAT(turned, ElementsAre("x", "", "z"));
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(const auto none, FindNexusAxes(Open("g").get(), "errors", 3));
  EXPECT_THAT(none, IsEmpty()) << "no signal";
  WriteHdf5Texts(file_.get(), "g", "auxiliary_signals", {"errors"});
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(const auto more, FindNexusAxes(Open("g").get(), "errors", 3));
  EXPECT_THAT(more, ElementsAre("x", "", "z"));
}

TEST_F(NexusDataTest, FieldsMayHaveAScaleInTheGroup) {
  Plot("g", "v");
  Dataset("g/x", {4});
  const auto number = [&](const std::string& name, std::vector<double> values) {
    WriteHdf5Dataset(file_.get(), name, {values.size()}, H5T_IEEE_F64LE, values.data());
  };
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(const NexusScale none, FindNexusScale(Open("g").get(), "x"));
  EXPECT_EQ(none, NexusScale());
  number("g/x_scaling_factor", {0.5});
  number("g/x_offset", {10});
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(const NexusScale scale, FindNexusScale(Open("g").get(), "x"));
  EXPECT_EQ(scale.Apply(2), 6);
  number("g/offset", {3});  // older files: of the signal
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(const NexusScale signal,
                                FindNexusSignalScale(Open("g").get(), "v"));
  EXPECT_EQ(signal.offset, 3);
  number("g/v_scaling_factor", {0});
  EXPECT_THAT(FindNexusSignalScale(Open("g").get(), "v"),
              StatusIs(kInvalid, HasSubstr("\"v_scaling_factor\" of 0")));
  number("g/y_offset", {1, 2});
  EXPECT_THAT(FindNexusScale(Open("g").get(), "y"),
              StatusIs(kInvalid, HasSubstr("\"y_offset\", which is not one finite number")));
}

TEST_F(NexusDataTest, CurvedGridsAndWrongAxesAreRefusedByName) {
  Plot("curved", "v");
  WriteHdf5Texts(file_.get(), "curved", "axes", {"z", "y", "x"});
  WriteHdf5Numbers(file_.get(), "curved", "x_indices", {1, 2});
  EXPECT_THAT(FindNexusAxes(Open("curved").get(), "v", 3),
              StatusIs(kInvalid, HasSubstr("\"x\" depend on 2 axes")));
  Plot("few", "v");
  WriteHdf5Texts(file_.get(), "few", "axes", {"x"});
  EXPECT_THAT(FindNexusAxes(Open("few").get(), "v", 3),
              StatusIs(kInvalid, HasSubstr("names 1 axes (x), but it has 3")));
  Plot("far", "v");
  WriteHdf5Texts(file_.get(), "far", "axes", {"x"});
  WriteHdf5Numbers(file_.get(), "far", "x_indices", {3});
  EXPECT_THAT(FindNexusAxes(Open("far").get(), "v", 3),
              StatusIs(kInvalid, HasSubstr("of axis 3; expected 0 to 2")));
}

}  // namespace
}  // namespace isoscope::source
