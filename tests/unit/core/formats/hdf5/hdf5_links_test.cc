// All ways in which one HDF5 file leads to another. Symptom: after a file behind an external link
// had changed, the cache gave the picture of the old one.

#include "core/formats/hdf5/hdf5_links.h"

#include <filesystem>
#include <string>
#include <vector>

#include "absl/strings/str_cat.h"
#include "gmock/gmock.h"
#include "gtest/gtest.h"

#include "core/source/hdf5/hdf5_handle.h"
#include "hdf5.h"
#include "tests/support/hdf5_file.h"
#include "tests/support/status_matchers.h"
#include "tests/support/temp_dir.h"
#include "tests/support/volume_files.h"

namespace isoscope::source {
namespace {

namespace fs = std::filesystem;

using ::testing::ElementsAre;

class Hdf5LinksTest : public ::testing::Test {
 protected:
  // A new file with the groups.
  Hdf5Handle Make(const std::string& name, const std::vector<std::string>& groups = {}) {
    Hdf5Handle file(H5Fcreate(dir_.Sub(name).c_str(), H5F_ACC_TRUNC, H5P_DEFAULT, H5P_DEFAULT),
                    H5Fclose);
    EXPECT_TRUE(file.is_valid());
    for (const std::string& group : groups) {
      const Hdf5Handle made(
          H5Gcreate2(file.get(), group.c_str(), H5P_DEFAULT, H5P_DEFAULT, H5P_DEFAULT), H5Gclose);
    }
    return file;
  }
  static void LinkOut(const Hdf5Handle& file, const std::string& name, const std::string& to,
                      const std::string& object) {
    ASSERT_GE(H5Lcreate_external(to.c_str(), object.c_str(), file.get(), name.c_str(), H5P_DEFAULT,
                                 H5P_DEFAULT),
              0);
  }
  static void LinkSoftly(const Hdf5Handle& file, const std::string& name, const std::string& to) {
    ASSERT_GE(H5Lcreate_soft(to.c_str(), file.get(), name.c_str(), H5P_DEFAULT, H5P_DEFAULT), 0);
  }
  static void Dataset(const Hdf5Handle& file, const std::string& name) {
    const std::vector<unsigned char> samples(8, 1);
    testing::WriteHdf5Dataset(file.get(), name, {2, 2, 2}, H5T_STD_U8LE, samples.data());
  }
  // A virtual dataset of one source.
  static void Virtual(const Hdf5Handle& file, const std::string& name, const std::string& of_file,
                      const std::string& of_dataset) {
    const Hdf5Handle properties(H5Pcreate(H5P_DATASET_CREATE), H5Pclose);
    const hsize_t dims[] = {2, 2, 2};
    const Hdf5Handle space(H5Screate_simple(3, dims, nullptr), H5Sclose);
    ASSERT_GE(H5Pset_virtual(properties.get(), space.get(), of_file.c_str(), of_dataset.c_str(),
                             space.get()),
              0);
    const Hdf5Handle dataset(H5Dcreate2(file.get(), name.c_str(), H5T_STD_U8LE, space.get(),
                                        H5P_DEFAULT, properties.get(), H5P_DEFAULT),
                             H5Dclose);
    ASSERT_TRUE(dataset.is_valid());
  }

  // Names of the files without their folder.
  std::vector<std::string> Found(const std::string& file, const std::string& object = "/") {
    std::vector<std::string> names;
    for (const std::string& path : FindHdf5LinkedFiles(dir_.Sub(file), object)) {
      names.push_back(fs::path(path).lexically_relative(dir_.path()).string());
    }
    return names;
  }

  testing::TempDir dir_;
};

TEST_F(Hdf5LinksTest, AChainOfExternalLinksHasAllFilesOnTheWay) {
  Dataset(Make("c.h5", {"/deep"}), "/deep/d");
  LinkOut(Make("b.h5", {"/group"}), "/group/on", "c.h5", "/deep");
  LinkOut(Make("a.h5"), "data", "b.h5", "/group/on/d");
  EXPECT_THAT(Found("a.h5", "/data"), ElementsAre("a.h5", "b.h5", "c.h5"));
  EXPECT_THAT(Found("a.h5"), ElementsAre("a.h5", "b.h5", "c.h5"));
}

TEST_F(Hdf5LinksTest, ASoftLinkThatPassesThroughAnExternalOneCounts) {
  Dataset(Make("b.h5", {"/group", "/group/inner"}), "/group/inner/d");
  const Hdf5Handle file = Make("a.h5", {"/entry", "/raw"});
  LinkOut(file, "/raw/run", "b.h5", "/group");
  LinkSoftly(file, "/entry/frames", "/raw/run/inner");
  LinkSoftly(file, "/entry/data", "frames/d");  // from its own group
  EXPECT_THAT(Found("a.h5", "/entry/data"), ElementsAre("a.h5", "b.h5"));
  EXPECT_THAT(Found("a.h5", "entry/./data"), ElementsAre("a.h5", "b.h5"));
}

TEST_F(Hdf5LinksTest, OnlyWhatTheNameLeadsToCounts) {
  Dataset(Make("b.h5"), "/d");
  Dataset(Make("c.h5"), "/d");
  const Hdf5Handle file = Make("a.h5", {"/one", "/two"});
  LinkOut(file, "/one/d", "b.h5", "/d");
  LinkOut(file, "/two/d", "c.h5", "/d");
  Dataset(file, "/own");
  EXPECT_THAT(Found("a.h5", "/one/d"), ElementsAre("a.h5", "b.h5"));
  EXPECT_THAT(Found("a.h5", "/two"), ElementsAre("a.h5", "c.h5"));
  EXPECT_THAT(Found("a.h5", "/own"), ElementsAre("a.h5"));
  EXPECT_THAT(Found("a.h5", "/none"), ElementsAre("a.h5"));
  EXPECT_THAT(Found("a.h5"), ElementsAre("a.h5", "b.h5", "c.h5"));
}

TEST_F(Hdf5LinksTest, GroupsBehindLinksHaveTheirLinksTold) {
  Dataset(Make("d.h5"), "/d");
  {
    const Hdf5Handle file = Make("c.h5", {"/steps", "/other"});
    LinkOut(file, "/other/d", "d.h5", "/d");
    LinkSoftly(file, "/steps/soft", "/other");  // outside of the group that is linked to
  }
  LinkOut(Make("a.h5"), "data", "c.h5", "/steps");
  EXPECT_THAT(Found("a.h5"), ElementsAre("a.h5", "c.h5", "d.h5"));
}

TEST_F(Hdf5LinksTest, VirtualDatasetsAndRawFilesAreFoundBehindLinks) {
  testing::WriteFile(dir_.Sub("samples.raw"), std::string(8, 'x'));
  {
    const Hdf5Handle properties(H5Pcreate(H5P_DATASET_CREATE), H5Pclose);
    H5Pset_external(properties.get(), dir_.Sub("samples.raw").c_str(), 0, 8);
    const hsize_t dims[] = {2, 2, 2};
    const Hdf5Handle space(H5Screate_simple(3, dims, nullptr), H5Sclose);
    const Hdf5Handle file = Make("raw.h5");
    const Hdf5Handle dataset(H5Dcreate2(file.get(), "/d", H5T_STD_U8LE, space.get(), H5P_DEFAULT,
                                        properties.get(), H5P_DEFAULT),
                             H5Dclose);
  }
  // The source of the virtual dataset is a link itself.
  LinkOut(Make("on.h5"), "d", "raw.h5", "/d");
  Virtual(Make("virtual.h5", {"/g"}), "/g/v", "on.h5", "/d");
  LinkOut(Make("a.h5"), "data", "virtual.h5", "/g");
  const std::vector<std::string> all{"a.h5", "virtual.h5", "on.h5", "raw.h5", "samples.raw"};
  EXPECT_EQ(Found("a.h5", "/data/v"), all);
  EXPECT_EQ(Found("a.h5"), all);
  fs::remove(dir_.Sub("samples.raw"));
  fs::remove(dir_.Sub("on.h5"));
  EXPECT_THAT(Found("a.h5"), ElementsAre("a.h5", "virtual.h5")) << "whoever opens it reports it";
}

TEST_F(Hdf5LinksTest, AFileThatWouldBeFoundFirstCounts) {
  fs::create_directory(dir_.Sub("far"));
  Dataset(Make("far/b.h5"), "/d");
  const std::string far = dir_.Sub("far/b.h5");
  LinkOut(Make("a.h5"), "data", far, "/d");
  EXPECT_THAT(Found("a.h5", "/data"), ElementsAre("a.h5", "far/b.h5"));
  // The library looks beside the file, too, if there is none at the place that is named.
  Dataset(Make("b.h5"), "/d");
  EXPECT_THAT(Found("a.h5", "/data"), ElementsAre("a.h5", "far/b.h5", "b.h5"));
  fs::remove(far);
  EXPECT_THAT(Found("a.h5", "/data"), ElementsAre("a.h5", "b.h5"));
}

TEST_F(Hdf5LinksTest, CirclesEnd) {
  {
    const Hdf5Handle a = Make("a.h5", {"/g"});
    LinkOut(a, "/g/b", "b.h5", "/g");
    LinkSoftly(a, "/g/self", "/g/self");
    LinkOut(Make("b.h5", {"/g"}), "/g/a", "a.h5", "/g");
  }
  EXPECT_THAT(Found("a.h5"), ElementsAre("a.h5", "b.h5"));
  EXPECT_THAT(Found("a.h5", "/g/self"), ElementsAre("a.h5"));
}

TEST_F(Hdf5LinksTest, ScalesOfAxesCount) {
  const std::vector<double> times{0, 1};
  testing::WriteFile(dir_.Sub("times.raw"), std::string(16, '\0'));
  {
    const Hdf5Handle file = Make("a.h5");
    Dataset(file, "/d");
    const Hdf5Handle properties(H5Pcreate(H5P_DATASET_CREATE), H5Pclose);
    H5Pset_external(properties.get(), dir_.Sub("times.raw").c_str(), 0, 16);
    const hsize_t count = 2;
    const Hdf5Handle space(H5Screate_simple(1, &count, nullptr), H5Sclose);
    const Hdf5Handle scale(H5Dcreate2(file.get(), "/t", H5T_NATIVE_DOUBLE, space.get(), H5P_DEFAULT,
                                      properties.get(), H5P_DEFAULT),
                           H5Dclose);
    testing::WriteHdf5Scales(file.get(), "/d", {"/t", "", ""});
  }
  EXPECT_THAT(Found("a.h5", "/d"), ElementsAre("a.h5", "times.raw"));
}

TEST_F(Hdf5LinksTest, AFileOfAnotherKindIsAlone) {
  testing::WriteFile(dir_.Sub("a.h5"), "CDF\1 is no HDF5");
  EXPECT_THAT(Found("a.h5"), ElementsAre("a.h5"));
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(const auto files, FilesOfHdf5Trees({dir_.Sub("a.h5")}));
  EXPECT_THAT(files, ElementsAre(dir_.Sub("a.h5")));
}

TEST_F(Hdf5LinksTest, SeveralFilesAreLookedAtByOneChild) {
  Dataset(Make("c.h5"), "/d");
  LinkOut(Make("a.h5"), "data", "c.h5", "/d");
  Dataset(Make("b.h5"), "/d");
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(const auto files,
                                FilesOfHdf5Trees({dir_.Sub("a.h5"), dir_.Sub("b.h5")}));
  EXPECT_THAT(files, ElementsAre(dir_.Sub("a.h5"), dir_.Sub("c.h5"), dir_.Sub("b.h5")));
}

}  // namespace
}  // namespace isoscope::source
