#include "core/source/hdf5/hdf5_read_ahead.h"

#include <algorithm>
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
#include "core/source/hdf5/hdf5_far_file.h"
#include "core/source/hdf5/hdf5_file.h"
#include "core/source/hdf5/hdf5_handle.h"
#include "tests/support/folder_test.h"
#include "tests/support/hdf5_file.h"
#include "tests/support/memory_file.h"
#include "tests/support/volume_files.h"

namespace isoscope::source {
namespace {

using Range = std::pair<std::int64_t, std::size_t>;

// Records all reads.
class RecordingFile final : public io::RandomAccessFile {
 public:
  RecordingFile(std::string path, const std::string& bytes, std::vector<Range>* reads)
      : path_(std::move(path)), bytes_(bytes), reads_(reads) {}
  [[nodiscard]] absl::Status ReadAt(std::int64_t offset, std::size_t size,
                                    char* out) const override {
    reads_->emplace_back(offset, size);
    return bytes_.ReadAt(offset, size, out);
  }
  [[nodiscard]] std::int64_t size_bytes() const override { return bytes_.size_bytes(); }
  [[nodiscard]] const std::string& path() const override { return path_; }

 private:
  const std::string path_;
  const testing::MemoryReadFile bytes_;
  std::vector<Range>* const reads_;
};

class Hdf5ReadAheadTest : public testing::FolderTest {
 protected:
  Hdf5ReadAheadTest() {
    PrepareHdf5();
    std::vector<std::uint16_t> values(20 * 12 * 10);
    for (std::size_t i = 0; i < values.size(); ++i) {
      values[i] = static_cast<std::uint16_t>(i * i);
    }
    const std::string path = dir_.Sub("a.h5");
    const hid_t file = H5Fcreate(path.c_str(), H5F_ACC_TRUNC, H5P_DEFAULT, H5P_DEFAULT);
    testing::WriteHdf5Dataset(file, "chunked", {20, 12, 10}, H5T_NATIVE_UINT16, values.data(),
                              {4, 5, 7});
    testing::WriteHdf5Dataset(file, "whole", {20, 12, 10}, H5T_NATIVE_UINT16, values.data());
    H5Fclose(file);
    const std::string name = "https://h/ahead/" + std::to_string(++count_) + ".h5";
    io::MountFile({.file = std::make_shared<RecordingFile>(name, testing::ReadFile(path), &reads_),
                   .expect_reads = [this](absl::Span<const io::FileRange> ranges) {
                     for (const io::FileRange& range : ranges) {
                       expected_.emplace_back(range.offset, range.size);
                     }
                   }});
    file_ = OpenHdf5ToRead(name);
  }

  Hdf5Handle Open(const char* dataset) {
    return Hdf5Handle(H5Dopen2(file_.get(), dataset, H5P_DEFAULT), H5Dclose);
  }
  // The reads of planes [begin, end) of a dataset.
  std::vector<Range> ReadsOf(hid_t dataset, hsize_t begin, hsize_t end) {
    const std::vector<hsize_t> start{begin, 0, 0};
    const std::vector<hsize_t> count{end - begin, 12, 10};
    const Hdf5Handle space(H5Dget_space(dataset), H5Sclose);
    H5Sselect_hyperslab(space.get(), H5S_SELECT_SET, start.data(), nullptr, count.data(), nullptr);
    const Hdf5Handle memory(H5Screate_simple(3, count.data(), nullptr), H5Sclose);
    std::vector<std::uint16_t> out((end - begin) * 120);
    reads_.clear();
    EXPECT_GE(
        H5Dread(dataset, H5T_NATIVE_UINT16, memory.get(), space.get(), H5P_DEFAULT, out.data()), 0);
    return reads_;
  }

  static inline int count_ = 0;
  std::vector<Range> reads_;
  std::vector<Range> expected_;
  Hdf5Handle file_;
};

// Five layers of 3 x 2 chunks. A read is what the library then reads, in its order.
TEST_F(Hdf5ReadAheadTest, ExpectsWhatTheLibraryReads) {
  const Hdf5Handle dataset = Open("chunked");
  Hdf5ReadAhead ahead(dataset.get(), {0, 0, 0}, {20, 12, 10}, 0, 1 << 20);
  ahead.BeforePlanes(0, 3);
  ASSERT_EQ(expected_.size(), 12);  // with one layer ahead
  const std::vector<Range> first(expected_.begin(), expected_.begin() + 6);
  EXPECT_EQ(ReadsOf(dataset.get(), 0, 3), first);
  ahead.BeforePlanes(3, 4);
  EXPECT_EQ(expected_.size(), 12);
  ahead.BeforePlanes(4, 9);  // layers 1 and 2, and 3 ahead
  EXPECT_EQ(expected_.size(), 24);
  const std::vector<Range> second(expected_.begin() + 6, expected_.begin() + 18);
  EXPECT_EQ(ReadsOf(dataset.get(), 4, 9), second);
  ahead.BeforePlanes(12, 20);
  EXPECT_EQ(expected_.size(), 30);  // there are no more
  ahead.BeforePlanes(0, 1);         // back again
  EXPECT_EQ(expected_.size(), 36);  // and nothing ahead: planes were left out
}

TEST_F(Hdf5ReadAheadTest, ExpectsALayerThatIsNotKeptForEachRead) {
  const Hdf5Handle dataset = Open("chunked");
  Hdf5ReadAhead ahead(dataset.get(), {0, 0, 0}, {20, 12, 10}, 0, 100);
  ahead.BeforePlanes(0, 1);
  ahead.BeforePlanes(1, 2);
  EXPECT_EQ(expected_.size(), 12);
  EXPECT_TRUE(std::equal(expected_.begin(), expected_.begin() + 6, expected_.begin() + 6));
}

TEST_F(Hdf5ReadAheadTest, ExpectsNothingOfOtherDatasets) {
  const Hdf5Handle whole = Open("whole");
  Hdf5ReadAhead(whole.get(), {0, 0, 0}, {20, 12, 10}, 0, 1 << 20).BeforePlanes(0, 20);
  const Hdf5Handle local = OpenHdf5ToRead(dir_.Sub("a.h5"));
  const Hdf5Handle chunked(H5Dopen2(local.get(), "chunked", H5P_DEFAULT), H5Dclose);
  Hdf5ReadAhead(chunked.get(), {0, 0, 0}, {20, 12, 10}, 0, 1 << 20).BeforePlanes(0, 20);
  EXPECT_THAT(expected_, ::testing::IsEmpty());
}

}  // namespace
}  // namespace isoscope::source
