#include "core/source/hdf5/hdf5_far_file.h"

#include <cstddef>
#include <cstdint>
#include <memory>
#include <string>
#include <utility>
#include <vector>

#include "gmock/gmock.h"
#include "gtest/gtest.h"

#include "core/io/file.h"
#include "core/io/mounted_file.h"
#include "core/source/hdf5/hdf5_file.h"
#include "tests/support/folder_test.h"
#include "tests/support/hdf5_file.h"
#include "tests/support/memory_file.h"
#include "tests/support/status_matchers.h"
#include "tests/support/volume_files.h"

namespace isoscope::source {
namespace {

using ::testing::HasSubstr;

// Fails from a byte on.
class FarTestFile final : public io::RandomAccessFile {
 public:
  FarTestFile(std::string path, const std::string& bytes, std::int64_t end)
      : path_(std::move(path)), bytes_(bytes), end_(end) {}
  [[nodiscard]] absl::Status ReadAt(std::int64_t offset, std::size_t size,
                                    char* out) const override {
    return offset + static_cast<std::int64_t>(size) > end_
               ? absl::UnavailableError("the server is busy")
               : bytes_.ReadAt(offset, size, out);
  }
  [[nodiscard]] std::int64_t size_bytes() const override { return bytes_.size_bytes(); }
  [[nodiscard]] const std::string& path() const override { return path_; }

 private:
  const std::string path_;
  const testing::MemoryReadFile bytes_;
  const std::int64_t end_;
};

class Hdf5FarFileTest : public testing::FolderTest {
 protected:
  Hdf5FarFileTest() {
    PrepareHdf5();
    for (std::size_t i = 0; i < values_.size(); ++i) {
      values_[i] = static_cast<std::uint16_t>(i * 7);
    }
    const std::string path = dir_.Sub("a.h5");
    const hid_t file = H5Fcreate(path.c_str(), H5F_ACC_TRUNC, H5P_DEFAULT, H5P_DEFAULT);
    testing::WriteHdf5Dataset(file, "d", {values_.size()}, H5T_NATIVE_UINT16, values_.data());
    H5Fclose(file);
    bytes_ = testing::ReadFile(path);
  }

  // Mounts the file, opens it and reads its dataset.
  std::string ReadOf(const std::string& path, std::int64_t end) {
    io::MountFile({.file = std::make_shared<FarTestFile>(path, bytes_, end)});
    const Hdf5Handle file = OpenHdf5ToRead(path);
    if (!file.is_valid()) {
      return LastHdf5Error();
    }
    const Hdf5Handle dataset(H5Dopen2(file.get(), "d", H5P_DEFAULT), H5Dclose);
    std::vector<std::uint16_t> read(values_.size());
    if (H5Dread(dataset.get(), H5T_NATIVE_UINT16, H5S_ALL, H5S_ALL, H5P_DEFAULT, read.data()) < 0) {
      return LastHdf5Error();
    }
    return read == values_ ? "the values" : "other values";
  }

  std::vector<std::uint16_t> values_ = std::vector<std::uint16_t>(10'000);
  std::string bytes_;
};

TEST_F(Hdf5FarFileTest, ReadsAMountedFile) {
  EXPECT_EQ(ReadOf("https://h/hdf5/a.h5", 1 << 20), "the values");
  EXPECT_FALSE(OpenHdf5ToRead("https://h/hdf5/none.h5").is_valid());
  EXPECT_TRUE(OpenHdf5ToRead(dir_.Sub("a.h5")).is_valid());
}

TEST_F(Hdf5FarFileTest, AReadThatFailsSaysWhy) {
  EXPECT_THAT(ReadOf("https://h/hdf5/b.h5", 0), HasSubstr("the server is busy"));
  EXPECT_THAT(ReadOf("https://h/hdf5/c.h5", 4000), HasSubstr("the server is busy"));
}

TEST_F(Hdf5FarFileTest, OtherLibrariesOpenItByAName) {
  const std::string path = "https://h/hdf5/d.h5";
  io::MountFile({.file = std::make_shared<FarTestFile>(path, bytes_, 1 << 20)});
  const auto name = StandInForFarHdf5(path);
  ASSERT_THAT(name.status(), testing::IsOk());
  EXPECT_EQ(*StandInForFarHdf5(path), *name);
  const Hdf5Handle file(H5Fopen(name->c_str(), H5F_ACC_RDONLY, H5P_DEFAULT), H5Fclose);
  ASSERT_TRUE(file.is_valid()) << LastHdf5Error();
  EXPECT_GT(H5Lexists(file.get(), "d", H5P_DEFAULT), 0);
}

// Names of files of this machine, in a file that somebody else's server sent.
TEST_F(Hdf5FarFileTest, ADatasetInOtherFilesIsNotRead) {
  const std::string path = dir_.Sub("e.h5");
  dir_.Write("secret", "0123456789");
  hid_t file = H5Fcreate(path.c_str(), H5F_ACC_TRUNC, H5P_DEFAULT, H5P_DEFAULT);
  const hid_t properties = H5Pcreate(H5P_DATASET_CREATE);
  H5Pset_external(properties, dir_.Sub("secret").c_str(), 0, 10);
  const hsize_t dims[1] = {10};
  const hid_t space = H5Screate_simple(1, dims, nullptr);
  H5Dclose(H5Dcreate2(file, "s", H5T_NATIVE_UINT8, space, H5P_DEFAULT, properties, H5P_DEFAULT));
  H5Sclose(space);
  H5Pclose(properties);
  H5Fclose(file);
  std::vector<std::uint8_t> read(10);
  const Hdf5Handle local = OpenHdf5ToRead(path);
  const Hdf5Handle of_disk(H5Dopen2(local.get(), "s", H5P_DEFAULT), H5Dclose);
  EXPECT_GE(ReadWholeHdf5(of_disk.get(), H5T_NATIVE_UINT8, read.data()), 0);
  EXPECT_THAT(CheckFarHdf5Objects(local.get(), path), testing::IsOk());
  EXPECT_EQ(read[3], '3');

  read.assign(10, 0);
  const std::string far_path = "https://h/hdf5/e.h5";
  io::MountFile(
      {.file = std::make_shared<FarTestFile>(far_path, testing::ReadFile(path), 1 << 20)});
  const Hdf5Handle far = OpenHdf5ToRead(far_path);
  const Hdf5Handle dataset(H5Dopen2(far.get(), "s", H5P_DEFAULT), H5Dclose);
  EXPECT_LT(ReadWholeHdf5(dataset.get(), H5T_NATIVE_UINT8, read.data()), 0);
  EXPECT_EQ(read, std::vector<std::uint8_t>(10));
  EXPECT_THAT(
      CheckFarHdf5Objects(far.get(), far_path),
      testing::StatusIs(absl::StatusCode::kInvalidArgument, HasSubstr("\"s\" are in other")));
}

}  // namespace
}  // namespace isoscope::source
