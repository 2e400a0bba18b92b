#include "core/source/hdf5/hdf5_driver.h"

#include <cstddef>
#include <cstdint>
#include <string>
#include <vector>

#include "gtest/gtest.h"

#include "core/source/hdf5/hdf5_file.h"
#include "core/source/hdf5/hdf5_handle.h"
#include "tests/support/folder_test.h"
#include "tests/support/hdf5_file.h"
#include "tests/support/volume_files.h"

namespace isoscope::source {
namespace {

class Hdf5DriverTest : public testing::FolderTest {
 protected:
  Hdf5DriverTest() : path_(dir_.Sub("a.h5")) {
    PrepareHdf5();
    for (std::size_t i = 0; i < values_.size(); ++i) {
      values_[i] = static_cast<std::uint16_t>(i * 7);
    }
    const Hdf5Handle file(H5Fcreate(path_.c_str(), H5F_ACC_TRUNC, H5P_DEFAULT, H5P_DEFAULT),
                          H5Fclose);
    testing::WriteHdf5Dataset(file.get(), "d", {values_.size()}, H5T_NATIVE_UINT16, values_.data(),
                              {2'500});
  }

  [[nodiscard]] Hdf5Handle Open(Hdf5DriverFiles files, unsigned flags = H5F_ACC_RDONLY) const {
    return {H5Fopen(path_.c_str(), flags, Hdf5DriverAccess(files)), H5Fclose};
  }

  const std::string path_;
  std::vector<std::uint16_t> values_ = std::vector<std::uint16_t>(10'000);
};

TEST_F(Hdf5DriverTest, ReadsWhatTheLibraryWrote) {
  const Hdf5Handle file = Open(Hdf5DriverFiles::kAll);
  const Hdf5Handle dataset(H5Dopen2(file.get(), "d", H5P_DEFAULT), H5Dclose);
  ASSERT_TRUE(dataset.is_valid()) << LastHdf5Error();
  std::vector<std::uint16_t> read(values_.size());
  EXPECT_GE(H5Dread(dataset.get(), H5T_NATIVE_UINT16, H5S_ALL, H5S_ALL, H5P_DEFAULT, read.data()),
            0);
  EXPECT_EQ(read, values_);
}

TEST_F(Hdf5DriverTest, ChunksThatAreNotedAreNotRead) {
  const Hdf5Handle file = Open(Hdf5DriverFiles::kAll);
  const Hdf5Handle dataset(H5Dopen2(file.get(), "d", H5P_DEFAULT), H5Dclose);
  ASSERT_TRUE(dataset.is_valid()) << LastHdf5Error();
  const hsize_t first = 2'500;
  hsize_t size = 0;
  ASSERT_GE(H5Dget_chunk_storage_size(dataset.get(), &first, &size), 0);
  std::uint32_t filters = 0;
  std::string room(size, 'x');
  const auto read_chunk = [&] {
    EXPECT_GE(H5Dread_chunk(dataset.get(), H5P_DEFAULT, &first, &filters, room.data()), 0);
  };
  const std::vector<io::FileRange> noted = NoteRawReads(read_chunk);
  EXPECT_EQ(room, std::string(size, 'x'));
  read_chunk();
  ASSERT_EQ(noted.size(), 1U);
  EXPECT_EQ(
      testing::ReadFile(path_).substr(static_cast<std::size_t>(noted[0].offset), noted[0].size),
      room);
  std::vector<std::uint16_t> read(values_.size());
  EXPECT_GE(H5Dread(dataset.get(), H5T_NATIVE_UINT16, H5S_ALL, H5S_ALL, H5P_DEFAULT, read.data()),
            0);
  EXPECT_EQ(read, values_);
}

TEST_F(Hdf5DriverTest, OpensNoFileOfTheDiskForMountedOnesAndNoneForWriting) {
  EXPECT_FALSE(Open(Hdf5DriverFiles::kMounted).is_valid());
  EXPECT_FALSE(Open(Hdf5DriverFiles::kAll, H5F_ACC_RDWR).is_valid());
}

}  // namespace
}  // namespace isoscope::source
