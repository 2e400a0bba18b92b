// Symptom: info of a file with a link to a named pipe waited for its writer for ever.

#include "core/source/hdf5/hdf5_external_links.h"

#include <unistd.h>

#include <string>
#include <vector>

#include "gmock/gmock.h"
#include "gtest/gtest.h"
#include <sys/stat.h>

#include "core/formats/hdf5/hdf5_dataset.h"
#include "core/formats/hdf5/hdf5_links.h"
#include "core/formats/hdf5/hdf5_listing.h"
#include "core/formats/hdf5/hdf5_mesh.h"
#include "core/formats/hdf5/nexus_data.h"
#include "core/formats/open_volume.h"
#include "core/source/hdf5/hdf5_file.h"
#include "core/source/hdf5/hdf5_handle.h"
#include "core/source/volume_series.h"
#include "tests/support/hdf5_file.h"
#include "tests/support/status_matchers.h"
#include "tests/support/temp_dir.h"

namespace isoscope::source {
namespace {

using ::isoscope::testing::WriteHdf5Dataset;
using ::isoscope::testing::WriteHdf5Texts;
using ::testing::AllOf;
using ::testing::ElementsAre;
using ::testing::HasSubstr;

class Hdf5ExternalLinksTest : public ::testing::Test {
 public:
  ~Hdf5ExternalLinksTest() override { alarm(0); }

 protected:
  // A wait for the pipe ends the test, and does not hang it.
  Hdf5ExternalLinksTest() {
    alarm(60);
    PrepareHdf5();
    EXPECT_EQ(mkfifo(dir_.Sub("pipe.h5").c_str(), 0600), 0);
  }

  Hdf5Handle Create(const std::string& name) {
    return {H5Fcreate(dir_.Sub(name).c_str(), H5F_ACC_TRUNC, H5P_DEFAULT, H5P_DEFAULT), H5Fclose};
  }
  static void Link(const Hdf5Handle& file, const std::string& name,
                   const std::string& to = "pipe.h5") {
    EXPECT_GE(
        H5Lcreate_external(to.c_str(), "/v", file.get(), name.c_str(), H5P_DEFAULT, H5P_DEFAULT),
        0);
  }
  static void Group(const Hdf5Handle& file, const std::string& name,
                    const std::string& nexus_class) {
    H5Gclose(H5Gcreate2(file.get(), name.c_str(), H5P_DEFAULT, H5P_DEFAULT, H5P_DEFAULT));
    WriteHdf5Texts(file.get(), name, "NX_class", {nexus_class});
  }
  static void Samples(const Hdf5Handle& file, const std::string& name) {
    const std::vector<unsigned char> samples(24, 1);
    WriteHdf5Dataset(file.get(), name, {2, 3, 4}, H5T_STD_U8LE, samples.data());
  }
  const testing::TempDir dir_;
};

TEST_F(Hdf5ExternalLinksTest, LinksToFilesLeadOnAsTheLibraryFollowsThem) {
  {
    const Hdf5Handle far = Create("far.h5");
    Samples(far, "v");
    const Hdf5Handle near = Create("near.h5");
    Link(near, "v", "far.h5");
    const Hdf5Handle start = Create("start.h5");
    Link(start, "v", "near.h5");
    Link(start, "self", "start.h5");
  }
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(const Hdf5Handle file, OpenHdf5File(dir_.Sub("start.h5")));
  const Hdf5Handle dataset(H5Dopen2(file.get(), "v", H5P_DEFAULT), H5Dclose);
  ASSERT_TRUE(dataset.is_valid());
  std::vector<char> name(1000, '\0');
  H5Fget_name(dataset.get(), name.data(), name.size());
  EXPECT_EQ(std::string(name.data()), dir_.Sub("far.h5"));
  const Hdf5Handle self(H5Dopen2(file.get(), "self", H5P_DEFAULT), H5Dclose);
  EXPECT_TRUE(self.is_valid());
  EXPECT_THAT(Hdf5DimsOf(dataset.get()), ElementsAre(2, 3, 4));
}

TEST_F(Hdf5ExternalLinksTest, WhyALinkIsBroken) {
  const Hdf5Handle file = Create("a.h5");
  Link(file, "pipe");
  Link(file, "lost", "lost.h5");
  Samples(file, "v");
  EXPECT_FALSE(Hdf5Handle(H5Oopen(file.get(), "pipe", H5P_DEFAULT), H5Oclose).is_valid());
  EXPECT_THAT(WhyLinkIsBroken(file.get(), "pipe"),
              HasSubstr("pipe.h5: is a pipe (FIFO), expected a regular file"));
  EXPECT_EQ(WhyLinkIsBroken(file.get(), "lost"), "in lost.h5, which is missing");
  EXPECT_EQ(WhyLinkIsBroken(file.get(), "v"), "");
}

TEST_F(Hdf5ExternalLinksTest, NoWalkerWaitsForAPipe) {
  {
    const Hdf5Handle file = Create("a.h5");
    Samples(file, "v");
    Link(file, "pipe");
    Group(file, "entry", "NXentry");
    Link(file, "entry/first");
    Group(file, "entry/plot", "NXdata");
    Link(file, "entry/plot/a");
    Samples(file, "entry/plot/b");
    // Where meshes would be.
    Link(file, "VTKHDF");
    Link(file, "ITKImage");
  }
  const std::string path = dir_.Sub("a.h5");
  {
    ISOSCOPE_ASSERT_OK_AND_ASSIGN(const Hdf5Handle file, OpenHdf5File(path));
    const std::string listed = DescribeHdf5Entries(ListHdf5Entries(file.get()));
    EXPECT_THAT(listed, AllOf(HasSubstr("/pipe (" + dir_.Sub("pipe.h5") + ": is a pipe (FIFO)"),
                              HasSubstr("/v (2 x 3 x 4 uint8)")));
    EXPECT_EQ(FindNexusDefault(file.get()), "");
    const Hdf5Handle plot(H5Gopen2(file.get(), "entry/plot", H5P_DEFAULT), H5Gclose);
    EXPECT_EQ(FindNexusSignal(plot.get()), "");
    EXPECT_FALSE(FindHdf5Meshes(file.get()).ok());
    EXPECT_THAT(FindHdf5LinkedFiles(path, "/"), ElementsAre(path));
  }
  // The same in the children of the program: writers, meshes, datasets.
  for (const std::string part : {"", ":/v", ":/pipe", ":/pipe/below", ":/entry/plot"}) {
    const auto series = OpenVolumeSeries(path + part, {});
    EXPECT_EQ(series.ok(), part == ":/v") << part;
    if (part.find("pipe") != std::string::npos) {
      EXPECT_THAT(series.status().message(), HasSubstr("pipe.h5: is a pipe (FIFO), expected"));
    }
  }
}

TEST_F(Hdf5ExternalLinksTest, ExtentOfAVirtualDatasetDoesNotWaitForItsSources) {
  EXPECT_EQ(mkfifo(dir_.Sub("part-0.h5").c_str(), 0600), 0);
  {
    // [planes in part-0.h5, part-1.h5, ...][3][4]
    const hsize_t all[] = {0, 3, 4};
    const hsize_t most[] = {H5S_UNLIMITED, 3, 4};
    const hsize_t one[] = {1, 3, 4};
    const hsize_t start[] = {0, 0, 0};
    const hsize_t step[] = {1, 1, 1};
    const hsize_t count[] = {H5S_UNLIMITED, 1, 1};
    const Hdf5Handle space(H5Screate_simple(3, all, most), H5Sclose);
    const Hdf5Handle plane(H5Screate_simple(3, one, nullptr), H5Sclose);
    H5Sselect_hyperslab(space.get(), H5S_SELECT_SET, start, step, count, one);
    const Hdf5Handle properties(H5Pcreate(H5P_DATASET_CREATE), H5Pclose);
    ASSERT_GE(H5Pset_virtual(properties.get(), space.get(), "part-%b.h5", "/v", plane.get()), 0);
    const Hdf5Handle file = Create("a.h5");
    const Hdf5Handle dataset(H5Dcreate2(file.get(), "v", H5T_STD_U8LE, space.get(), H5P_DEFAULT,
                                        properties.get(), H5P_DEFAULT),
                             H5Dclose);
    ASSERT_TRUE(dataset.is_valid());
  }
  const std::string path = dir_.Sub("a.h5");
  EXPECT_THAT(FindHdf5LinkedFiles(path, "/"), ElementsAre(path));
  EXPECT_THAT(OpenVolumeSeries(path, {}).status().message(), HasSubstr("part-0.h5: is a pipe"));
  EXPECT_THAT(OpenVolumeSeries(path + ":/v", {}).status().message(),
              HasSubstr("/v: " + dir_.Sub("part-0.h5") + ": is a pipe (FIFO), expected"));
}

TEST_F(Hdf5ExternalLinksTest, NetcdfDoesNotWaitEither) {
  {
    const Hdf5Handle file = Create("a.nc");
    Samples(file, "v");
    Link(file, "pipe");
  }
  const auto series = OpenVolumeSeries(dir_.Sub("a.nc"), {});
  EXPECT_NE(series.status().code(), absl::StatusCode::kDeadlineExceeded) << series.status();
}

}  // namespace
}  // namespace isoscope::source
