#include "core/formats/hdf5/hdf5_dataset.h"

#include <string>
#include <vector>

#include "gmock/gmock.h"
#include "gtest/gtest.h"

#include "core/source/hdf5/hdf5_file.h"
#include "hdf5.h"
#include "tests/support/hdf5_file.h"
#include "tests/support/status_matchers.h"
#include "tests/support/temp_dir.h"

namespace isoscope::source {
namespace {

using ::isoscope::testing::StatusIs;
using ::isoscope::testing::TempDir;
using ::isoscope::testing::WriteHdf5Dataset;
using ::isoscope::testing::WriteHdf5Texts;
using ::testing::ElementsAre;
using ::testing::HasSubstr;

constexpr auto kInvalid = absl::StatusCode::kInvalidArgument;

class Hdf5DatasetTest : public ::testing::Test {
 protected:
  void Create() {
    file_ = Hdf5Handle(H5Fcreate(path_.c_str(), H5F_ACC_TRUNC, H5P_DEFAULT, H5P_DEFAULT), H5Fclose);
  }
  TempDir dir_;
  const std::string path_ = dir_.Sub("a.h5");
  Hdf5Handle file_;
  const std::vector<float> zeros_ = std::vector<float>(1000, 0);
};

TEST_F(Hdf5DatasetTest, PathWithoutANameMeansTheOnlyOne) {
  Create();
  WriteHdf5Dataset(file_.get(), "u", {2, 3, 4, 5}, H5T_IEEE_F32LE, zeros_.data());
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(const auto u, OpenHdf5ByName(path_));
  EXPECT_EQ(u.parts.name(), path_ + ":/u");
  EXPECT_THAT(Hdf5DimsOf(u.dataset.get()), ElementsAre(2, 3, 4, 5));
  WriteHdf5Dataset(file_.get(), "volume", {2, 3, 4}, H5T_IEEE_F32LE, zeros_.data());
  WriteHdf5Dataset(file_.get(), "wide", {2, 3, 4}, H5T_STD_I64LE, zeros_.data());
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(const auto volume, OpenHdf5ByName(path_));
  EXPECT_EQ(volume.parts.dataset, "/volume") << "what has always been opened";
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(const auto four, OpenHdf5ByName(path_, 4));
  EXPECT_EQ(four.parts.dataset, "/u");
  WriteHdf5Dataset(file_.get(), "v", {2, 3, 4, 5}, H5T_IEEE_F32LE, zeros_.data());
  EXPECT_THAT(OpenHdf5ByName(path_, 4),
              StatusIs(kInvalid, HasSubstr("say which dataset, as in " + path_ +
                                           ":/u (--field chooses none of them); it holds")));
  EXPECT_THAT(OpenHdf5ByName(path_, 5),
              StatusIs(kInvalid, HasSubstr("no dataset of 5 axes; it holds /u")));
  EXPECT_THAT(OpenHdf5ByName(path_ + ":/w", 4),
              StatusIs(absl::StatusCode::kNotFound, HasSubstr("no dataset /w; it holds /u")));
}

TEST_F(Hdf5DatasetTest, OfSeveralAllAreListed) {
  Create();
  WriteHdf5Dataset(file_.get(), "a", {2, 3, 4}, H5T_STD_U8LE, zeros_.data());
  WriteHdf5Dataset(file_.get(), "b", {2, 3, 4}, H5T_STD_U8LE, zeros_.data());
  WriteHdf5Dataset(file_.get(), "wide", {2, 3, 4}, H5T_STD_U64LE, zeros_.data());
  EXPECT_THAT(OpenHdf5ByName(path_),
              StatusIs(kInvalid, HasSubstr("it holds /a (2 x 3 x 4 uint8), /b (2 x 3 x 4 uint8), "
                                           "/wide (2 x 3 x 4 uint64)")));
}

// What a message advises can be pasted into a shell.
TEST_F(Hdf5DatasetTest, NamesWithSpacesAreAdvisedInQuotationMarks) {
  Create();
  WriteHdf5Dataset(file_.get(), "c d", {2, 3, 4}, H5T_STD_U8LE, zeros_.data());
  WriteHdf5Dataset(file_.get(), "e f", {2, 3, 4}, H5T_STD_U8LE, zeros_.data());
  EXPECT_THAT(OpenHdf5ByName(path_),
              StatusIs(kInvalid, HasSubstr("as in '" + path_ + ":/c d' (--field")));
}

TEST_F(Hdf5DatasetTest, PlotOfNexusIsMeantByItsGroupAndByItsFile) {
  Create();
  for (const char* group : {"entry", "entry/plot", "entry/other"}) {
    H5Gclose(H5Gcreate2(file_.get(), group, H5P_DEFAULT, H5P_DEFAULT, H5P_DEFAULT));
  }
  WriteHdf5Dataset(file_.get(), "entry/plot/counts", {2, 3, 4}, H5T_STD_I64LE, zeros_.data());
  WriteHdf5Dataset(file_.get(), "entry/other/a", {2, 3, 4}, H5T_STD_U8LE, zeros_.data());
  WriteHdf5Texts(file_.get(), "entry", "NX_class", {"NXentry"});
  WriteHdf5Texts(file_.get(), "entry/plot", "NX_class", {"NXdata"});
  WriteHdf5Texts(file_.get(), "entry/plot", "signal", {"counts"});
  for (const std::string part : {"", ":/entry/plot", ":/entry/plot/"}) {
    ISOSCOPE_ASSERT_OK_AND_ASSIGN(const auto named, OpenHdf5ByName(path_ + part));
    EXPECT_EQ(named.parts.dataset, "/entry/plot/counts");
  }
  // A plot that is no volume says nothing.
  WriteHdf5Dataset(file_.get(), "entry/plot/line", {20}, H5T_STD_U8LE, zeros_.data());
  const Hdf5Handle plot(H5Gopen2(file_.get(), "entry/plot", H5P_DEFAULT), H5Gclose);
  H5Adelete(plot.get(), "signal");
  WriteHdf5Texts(file_.get(), "entry/plot", "signal", {"line"});
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(const auto named, OpenHdf5ByName(path_));
  EXPECT_EQ(named.parts.dataset, "/entry/other/a");
}

TEST_F(Hdf5DatasetTest, MissingFilterIsNamedBeforeASampleIsRead) {
  // Whatever plugins this machine has: the library would load each, and some leak as they go.
  PrepareHdf5();
  unsigned int folders = 0;
  while (H5PLsize(&folders) >= 0 && folders > 0) {
    ASSERT_GE(H5PLremove(folders - 1), 0);
  }
  Create();
  const hsize_t dims[] = {2, 3, 4};
  const Hdf5Handle space(H5Screate_simple(3, dims, nullptr), H5Sclose);
  const Hdf5Handle properties(H5Pcreate(H5P_DATASET_CREATE), H5Pclose);
  H5Pset_chunk(properties.get(), 3, dims);
  H5Pset_filter(properties.get(), 32026, H5Z_FLAG_OPTIONAL, 0, nullptr);
  H5Dclose(H5Dcreate2(file_.get(), "v", H5T_STD_U8LE, space.get(), H5P_DEFAULT, properties.get(),
                      H5P_DEFAULT));
  EXPECT_THAT(OpenHdf5ByName(path_),
              StatusIs(kInvalid, HasSubstr(path_ + ":/v: compressed by filter 32026 (Blosc2)")));
}

}  // namespace
}  // namespace isoscope::source
