// Datasets in several files, in which one is missing, cut or wrong:
//
// - external storage, virtual datasets, numbered sources, external links;
// - the list of files, which must be complete;
// - a virtual dataset that is made of itself.

#include "core/formats/hdf5/hdf5_storage.h"

#include <filesystem>
#include <string>
#include <utility>
#include <vector>

#include "absl/strings/str_cat.h"
#include "gmock/gmock.h"
#include "gtest/gtest.h"

#include "core/formats/hdf5/hdf5_source.h"
#include "core/source/hdf5/hdf5_handle.h"
#include "hdf5.h"
#include "tests/support/only_volume.h"
#include "tests/support/status_matchers.h"
#include "tests/support/temp_dir.h"
#include "tests/support/volume_files.h"

namespace isoscope::source {
namespace {

using ::isoscope::testing::Noise;
using ::isoscope::testing::ReadAll;
using ::isoscope::testing::StatusIs;
using ::isoscope::testing::TempDir;
using ::isoscope::testing::WriteFile;
using ::testing::AllOf;
using ::testing::ElementsAre;
using ::testing::HasSubstr;
using volume::ScalarType;

constexpr math::Index3 kDims{7, 5, 6};
constexpr std::size_t kPlaneBytes = std::size_t{7} * 5;
const std::vector<hsize_t> kShape{6, 5, 7};
const std::vector<hsize_t> kPlane{1, 5, 7};

class Hdf5StorageTest : public ::testing::Test {
 protected:
  // Writes a dataset of `shape`, created with `properties`, into a new or an existing file.
  void Write(const std::string& file_name, const std::string& name,
             const std::vector<hsize_t>& shape, const std::string& samples,
             hid_t properties = H5P_DEFAULT, bool can_grow = false) {
    const std::string path = dir_.Sub(file_name);
    const Hdf5Handle file(std::filesystem::exists(path)
                              ? H5Fopen(path.c_str(), H5F_ACC_RDWR, H5P_DEFAULT)
                              : H5Fcreate(path.c_str(), H5F_ACC_TRUNC, H5P_DEFAULT, H5P_DEFAULT),
                          H5Fclose);
    std::vector<hsize_t> max_shape = shape;
    max_shape[0] = can_grow ? H5S_UNLIMITED : shape[0];
    const Hdf5Handle space(
        H5Screate_simple(static_cast<int>(shape.size()), shape.data(), max_shape.data()), H5Sclose);
    const Hdf5Handle dataset(H5Dcreate2(file.get(), name.c_str(), H5T_STD_U8LE, space.get(),
                                        H5P_DEFAULT, properties, H5P_DEFAULT),
                             H5Dclose);
    ASSERT_TRUE(dataset.is_valid()) << LastHdf5Error();
    if (!samples.empty()) {
      ASSERT_GE(
          H5Dwrite(dataset.get(), H5T_STD_U8LE, H5S_ALL, H5S_ALL, H5P_DEFAULT, samples.data()), 0);
    }
  }

  // A virtual dataset, plane z of which is dataset `sources[z].second` of file `sources[z].first`.
  void WriteVirtual(const std::string& file_name, const std::string& name,
                    const std::vector<std::pair<std::string, std::string>>& sources) {
    const std::vector<hsize_t> shape{sources.size(), 5, 7};
    const Hdf5Handle properties(H5Pcreate(H5P_DATASET_CREATE), H5Pclose);
    const Hdf5Handle source_space(H5Screate_simple(3, kPlane.data(), nullptr), H5Sclose);
    for (std::size_t z = 0; z < sources.size(); ++z) {
      const Hdf5Handle space(H5Screate_simple(3, shape.data(), nullptr), H5Sclose);
      const std::vector<hsize_t> start{z, 0, 0};
      H5Sselect_hyperslab(space.get(), H5S_SELECT_SET, start.data(), nullptr, kPlane.data(),
                          nullptr);
      ASSERT_GE(H5Pset_virtual(properties.get(), space.get(), sources[z].first.c_str(),
                               sources[z].second.c_str(), source_space.get()),
                0);
    }
    Write(file_name, name, shape, "", properties.get());
  }

  // Expects that exactly `samples` are read.
  void ExpectReads(const std::string& path, const std::string& samples) {
    ISOSCOPE_ASSERT_OK_AND_ASSIGN(const auto source, OpenVolumeFile(path));
    ISOSCOPE_ASSERT_OK_AND_ASSIGN(const std::string read, ReadAll(*source, 3));
    EXPECT_TRUE(read == samples);
  }

  [[nodiscard]] std::string Path(const std::string& file, const std::string& dataset) const {
    return dir_.Sub(file) + ":" + dataset;
  }

  TempDir dir_;
};

TEST_F(Hdf5StorageTest, ADatasetInOneFileHasOneFile) {
  Write("v.h5", "v", kShape, Noise(kDims, ScalarType::kUint8));
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(const auto files, FilesOfHdf5Dataset(Path("v.h5", "/v")));
  EXPECT_THAT(files, ElementsAre(dir_.Sub("v.h5")));
}

TEST_F(Hdf5StorageTest, ExternalFilesThatAreMissingOrCutAreNotReadAsFillValues) {
  const std::string samples = Noise(kDims, ScalarType::kUint8);
  WriteFile(dir_.Sub("low.raw"), std::string(10, 'x') + samples.substr(0, 4 * kPlaneBytes));
  WriteFile(dir_.Sub("high.raw"), samples.substr(4 * kPlaneBytes));
  const Hdf5Handle properties(H5Pcreate(H5P_DATASET_CREATE), H5Pclose);
  H5Pset_external(properties.get(), dir_.Sub("low.raw").c_str(), 10, 4 * kPlaneBytes);
  H5Pset_external(properties.get(), dir_.Sub("high.raw").c_str(), 0, H5F_UNLIMITED);
  Write("v.h5", "v", kShape, "", properties.get());
  const std::string path = Path("v.h5", "/v");
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(const auto files, FilesOfHdf5Dataset(path));
  EXPECT_THAT(files, ElementsAre(dir_.Sub("v.h5"), dir_.Sub("low.raw"), dir_.Sub("high.raw")));
  ExpectReads(path, samples);
  WriteFile(dir_.Sub("high.raw"), samples.substr(4 * kPlaneBytes, 2 * kPlaneBytes - 1));
  EXPECT_THAT(
      OpenVolumeFile(path).status(),
      StatusIs(absl::StatusCode::kDataLoss,
               AllOf(HasSubstr("high.raw"), HasSubstr("has 69 bytes"), HasSubstr("at least 70"))));
  std::filesystem::remove(dir_.Sub("high.raw"));
  EXPECT_THAT(OpenVolumeFile(path).status(),
              StatusIs(absl::StatusCode::kNotFound, HasSubstr("high.raw")));
  EXPECT_THAT(FilesOfHdf5Dataset(path).status(),
              StatusIs(absl::StatusCode::kNotFound, HasSubstr("high.raw")));
}

TEST_F(Hdf5StorageTest, SourcesOfVirtualDatasetsThatAreMissingAreNotReadAsFillValues) {
  const std::string samples = Noise({7, 5, 4}, ScalarType::kUint8);
  const auto plane = [&](std::size_t z) { return samples.substr(z * kPlaneBytes, kPlaneBytes); };
  Write("a.h5", "p", kPlane, plane(0));
  Write("a.h5", "q", kPlane, plane(1));
  Write("v.h5", "own", kPlane, plane(2));
  Write("c.h5", "p", kPlane, plane(3));
  WriteVirtual("b.h5", "p", {{dir_.Sub("c.h5"), "/p"}});  // virtual in itself
  WriteVirtual("v.h5", "v", {{"a.h5", "/p"}, {"a.h5", "/q"}, {".", "/own"}, {"b.h5", "/p"}});
  const std::string path = Path("v.h5", "/v");
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(const auto files, FilesOfHdf5Dataset(path));
  EXPECT_THAT(files,
              ElementsAre(dir_.Sub("v.h5"), dir_.Sub("a.h5"), dir_.Sub("b.h5"), dir_.Sub("c.h5")));
  ExpectReads(path, samples);
  std::filesystem::remove(dir_.Sub("c.h5"));
  EXPECT_THAT(OpenVolumeFile(path).status(),
              StatusIs(absl::StatusCode::kNotFound, HasSubstr("c.h5")));
  Write("c.h5", "other", kPlane, plane(3));
  EXPECT_THAT(
      OpenVolumeFile(path).status(),
      StatusIs(absl::StatusCode::kNotFound, AllOf(HasSubstr("dataset /p of"), HasSubstr("c.h5"))));
  WriteFile(dir_.Sub("c.h5"), "no HDF5");
  EXPECT_THAT(OpenVolumeFile(path).status(),
              StatusIs(absl::StatusCode::kDataLoss, HasSubstr("c.h5")));
}

TEST_F(Hdf5StorageTest, NumberedSourcesEndWhereTheFirstIsMissing) {
  const std::string samples = Noise({7, 5, 3}, ScalarType::kUint8);
  for (std::size_t z = 0; z < 3; ++z) {
    Write(absl::StrCat("part%", z, ".h5"), "p", kPlane,
          samples.substr(z * kPlaneBytes, kPlaneBytes));
  }
  const Hdf5Handle properties(H5Pcreate(H5P_DATASET_CREATE), H5Pclose);
  const std::vector<hsize_t> shape{3, 5, 7};
  const std::vector<hsize_t> max_shape{H5S_UNLIMITED, 5, 7};
  const std::vector<hsize_t> start{0, 0, 0};
  const std::vector<hsize_t> count{H5S_UNLIMITED, 1, 1};
  const Hdf5Handle space(H5Screate_simple(3, shape.data(), max_shape.data()), H5Sclose);
  H5Sselect_hyperslab(space.get(), H5S_SELECT_SET, start.data(), kPlane.data(), count.data(),
                      kPlane.data());
  const Hdf5Handle source_space(H5Screate_simple(3, kPlane.data(), nullptr), H5Sclose);
  ASSERT_GE(H5Pset_virtual(properties.get(), space.get(), "part%%%b.h5", "/p", source_space.get()),
            0);
  Write("v.h5", "v", shape, "", properties.get(), /*can_grow=*/true);
  const std::string path = Path("v.h5", "/v");
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(const auto files, FilesOfHdf5Dataset(path));
  EXPECT_THAT(files, ElementsAre(dir_.Sub("v.h5"), dir_.Sub("part%0.h5"), dir_.Sub("part%1.h5"),
                                 dir_.Sub("part%2.h5")));
  ExpectReads(path, samples);
  std::filesystem::remove(dir_.Sub("part%0.h5"));
  EXPECT_THAT(OpenVolumeFile(path).status(),
              StatusIs(absl::StatusCode::kNotFound, HasSubstr("part%0.h5")));
}

TEST_F(Hdf5StorageTest, AnExternalLinkLeadsToTheLinkedFile) {
  const std::string samples = Noise(kDims, ScalarType::kUint8);
  Write("linked.h5", "v", kShape, samples);
  {
    const Hdf5Handle file(
        H5Fcreate(dir_.Sub("v.h5").c_str(), H5F_ACC_TRUNC, H5P_DEFAULT, H5P_DEFAULT), H5Fclose);
    ASSERT_GE(H5Lcreate_external("linked.h5", "/v", file.get(), "w", H5P_DEFAULT, H5P_DEFAULT), 0);
  }
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(const auto files, FilesOfHdf5Dataset(Path("v.h5", "/w")));
  EXPECT_THAT(files, ElementsAre(dir_.Sub("v.h5"), dir_.Sub("linked.h5")));
  ExpectReads(Path("v.h5", "/w"), samples);
}

TEST_F(Hdf5StorageTest, AVirtualDatasetMadeOfItselfIsRefused) {
  WriteVirtual("v.h5", "v", {{".", "/v"}});
  EXPECT_THAT(OpenVolumeFile(Path("v.h5", "/v")).status(),
              StatusIs(absl::StatusCode::kInvalidArgument, HasSubstr("made of itself")));
  WriteVirtual("a.h5", "v", {{"b.h5", "/v"}});
  WriteVirtual("b.h5", "v", {{"a.h5", "/v"}});
  EXPECT_THAT(OpenVolumeFile(Path("a.h5", "/v")).status(),
              StatusIs(absl::StatusCode::kInvalidArgument, HasSubstr("made of itself")));
}

}  // namespace
}  // namespace isoscope::source
