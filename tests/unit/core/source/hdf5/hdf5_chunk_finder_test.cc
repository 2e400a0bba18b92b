// What is found is what the library says of all chunks, for each kind of index that it writes:
//
//   version 1.8     a B-tree
//   latest          one chunk, implicit, a fixed array, an extensible array, a B-tree of version 2

#include "core/source/hdf5/hdf5_chunk_finder.h"

#include <filesystem>
#include <map>
#include <string>
#include <vector>

#include "absl/strings/str_cat.h"
#include "gmock/gmock.h"
#include "gtest/gtest.h"

#include "tests/support/status_matchers.h"
#include "tests/support/temp_dir.h"
#include "tests/support/volume_files.h"

namespace isoscope::source {
namespace {

using ::isoscope::testing::StatusIs;
using ::isoscope::testing::TempDir;
using ::testing::HasSubstr;

struct Layout {
  std::string name;
  bool is_latest = false;
  hsize_t user_block = 0;
  std::vector<hsize_t> chunk{4, 5, 6};
  std::vector<hsize_t> max_dims{17, 11, 13};
  bool is_filtered = true;
  bool is_early = false;  // space for all chunks at once
};

constexpr hsize_t kDims[] = {17, 11, 13};

std::vector<Layout> Layouts() {
  const hsize_t any = H5S_UNLIMITED;
  return {{.name = "tree"},
          {.name = "tree behind a user block", .user_block = 512},
          {.name = "tree without filters", .is_filtered = false},
          {.name = "one chunk", .is_latest = true, .chunk = {17, 11, 13}},
          {.name = "implicit", .is_latest = true, .is_filtered = false, .is_early = true},
          {.name = "fixed array", .is_latest = true},
          {.name = "extensible array", .is_latest = true, .max_dims = {any, 11, 13}},
          {.name = "tree of version 2", .is_latest = true, .max_dims = {any, any, 13}}};
}

// Writes all chunks, or those that have the first element alone. The first chunk leaves out the
// filter.
void WriteFileOf(const Layout& layout, bool is_whole, const std::string& path) {
  const hid_t creation = H5Pcreate(H5P_FILE_CREATE);
  H5Pset_userblock(creation, layout.user_block);
  const hid_t access = H5Pcreate(H5P_FILE_ACCESS);
  if (layout.is_latest) {
    H5Pset_libver_bounds(access, H5F_LIBVER_LATEST, H5F_LIBVER_LATEST);
  }
  const hid_t file = H5Fcreate(path.c_str(), H5F_ACC_TRUNC, creation, access);
  const hid_t space = H5Screate_simple(3, kDims, layout.max_dims.data());
  const hid_t properties = H5Pcreate(H5P_DATASET_CREATE);
  H5Pset_chunk(properties, 3, layout.chunk.data());
  if (layout.is_filtered) {
    H5Pset_deflate(properties, 1);
  }
  if (layout.is_early) {
    H5Pset_alloc_time(properties, H5D_ALLOC_TIME_EARLY);
  }
  const hid_t dataset =
      H5Dcreate2(file, "v", H5T_STD_U8LE, space, H5P_DEFAULT, properties, H5P_DEFAULT);
  ASSERT_GE(dataset, 0);
  std::string samples = testing::Noise({13, 11, 17}, volume::ScalarType::kUint8);
  std::fill_n(samples.begin(), samples.size() / 2, 'a');
  const hsize_t start[] = {0, 0, 0};
  const hsize_t one[] = {1, 1, 1};
  H5Sselect_hyperslab(space, H5S_SELECT_SET, start, nullptr, is_whole ? kDims : one, nullptr);
  const hid_t memory = H5Screate_simple(3, kDims, nullptr);
  H5Sselect_hyperslab(memory, H5S_SELECT_SET, start, nullptr, is_whole ? kDims : one, nullptr);
  ASSERT_GE(H5Dwrite(dataset, H5T_STD_U8LE, memory, space, H5P_DEFAULT, samples.data()), 0);
  if (layout.is_filtered) {
    const hsize_t size = layout.chunk[0] * layout.chunk[1] * layout.chunk[2];
    ASSERT_GE(H5Dwrite_chunk(dataset, H5P_DEFAULT, 1, start, size, samples.data()), 0);
  }
  H5Sclose(memory);
  H5Dclose(dataset);
  H5Pclose(properties);
  H5Sclose(space);
  H5Fclose(file);
  H5Pclose(access);
  H5Pclose(creation);
}

using Chunks = std::map<std::vector<hsize_t>, Hdf5Chunk>;

// The library's offsets begin behind the user block.
Chunks ChunksOf(hid_t dataset, hsize_t user_block) {
  Chunks chunks;
  hsize_t count = 0;
  const Hdf5Handle space(H5Dget_space(dataset), H5Sclose);
  H5Dget_num_chunks(dataset, space.get(), &count);
  for (hsize_t i = 0; i < count; ++i) {
    std::vector<hsize_t> first(3);
    unsigned filters = 0;
    haddr_t address = 0;
    hsize_t size = 0;
    EXPECT_GE(H5Dget_chunk_info(dataset, space.get(), i, first.data(), &filters, &address, &size),
              0);
    chunks[first] = {.offset = static_cast<std::int64_t>(address + user_block),
                     .size = static_cast<std::int64_t>(size),
                     .skipped_filters = filters};
  }
  return chunks;
}

TEST(Hdf5ChunkFinderTest, ChunksAreThoseOfTheLibraryForEachKindOfIndex) {
  const TempDir dir;
  const std::string path = dir.Sub("v.h5");
  bool is_filter_skipped = false;
  for (const Layout& layout : Layouts()) {
    for (const bool is_whole : {true, false}) {
      SCOPED_TRACE(absl::StrCat(layout.name, is_whole ? "" : ", of one chunk"));
      WriteFileOf(layout, is_whole, path);
      const Hdf5Handle file(H5Fopen(path.c_str(), H5F_ACC_RDONLY, H5P_DEFAULT), H5Fclose);
      const Hdf5Handle dataset(H5Dopen2(file.get(), "v", H5P_DEFAULT), H5Dclose);
      const Chunks expected = ChunksOf(dataset.get(), layout.user_block);
      ISOSCOPE_ASSERT_OK_AND_ASSIGN(Hdf5ChunkFinder finder,
                                    Hdf5ChunkFinder::Open(dataset.get(), "v"));
      Chunks found;
      std::vector<hsize_t> first(3);
      for (first[0] = 0; first[0] < kDims[0]; first[0] += layout.chunk[0]) {
        for (first[1] = 0; first[1] < kDims[1]; first[1] += layout.chunk[1]) {
          for (first[2] = 0; first[2] < kDims[2]; first[2] += layout.chunk[2]) {
            ISOSCOPE_ASSERT_OK_AND_ASSIGN(const auto chunk, finder.Find(first));
            if (chunk.has_value()) {
              found[first] = *chunk;
              is_filter_skipped = is_filter_skipped || chunk->skipped_filters != 0;
            }
          }
        }
      }
      EXPECT_TRUE(found == expected) << found.size() << " of " << expected.size();
      EXPECT_GT(expected.size(), 0U);
    }
  }
  EXPECT_TRUE(is_filter_skipped);
}

TEST(Hdf5ChunkFinderTest, NothingIsFoundInADatasetThatNobodyWroteTo) {
  const TempDir dir;
  const hid_t created = H5Fcreate(dir.Sub("v.h5").c_str(), H5F_ACC_TRUNC, H5P_DEFAULT, H5P_DEFAULT);
  const Hdf5Handle space(H5Screate_simple(3, kDims, nullptr), H5Sclose);
  const Hdf5Handle properties(H5Pcreate(H5P_DATASET_CREATE), H5Pclose);
  const hsize_t chunk[] = {4, 5, 6};
  H5Pset_chunk(properties.get(), 3, chunk);
  H5Dclose(H5Dcreate2(created, "v", H5T_STD_U8LE, space.get(), H5P_DEFAULT, properties.get(),
                      H5P_DEFAULT));
  H5Fclose(created);
  const Hdf5Handle file(H5Fopen(dir.Sub("v.h5").c_str(), H5F_ACC_RDONLY, H5P_DEFAULT), H5Fclose);
  const Hdf5Handle dataset(H5Dopen2(file.get(), "v", H5P_DEFAULT), H5Dclose);
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(Hdf5ChunkFinder finder, Hdf5ChunkFinder::Open(dataset.get(), "v"));
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(const auto found, finder.Find({0, 0, 0}));
  EXPECT_FALSE(found.has_value());
}

TEST(Hdf5ChunkFinderTest, ADamagedIndexIsAnErrorByName) {
  const TempDir dir;
  const std::string path = dir.Sub("v.h5");
  WriteFileOf(Layouts().front(), true, path);
  std::string bytes = testing::ReadFile(path);
  // The nodes of the tree of chunks, whose kind is 1.
  for (std::size_t at = bytes.find("TREE\x01"); at != std::string::npos;
       at = bytes.find("TREE\x01", at + 1)) {
    bytes[at] = 'x';
  }
  testing::WriteFile(path, bytes);
  const Hdf5Handle file(H5Fopen(path.c_str(), H5F_ACC_RDONLY, H5P_DEFAULT), H5Fclose);
  const Hdf5Handle dataset(H5Dopen2(file.get(), "v", H5P_DEFAULT), H5Dclose);
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(Hdf5ChunkFinder finder,
                                Hdf5ChunkFinder::Open(dataset.get(), "run.h5:/v"));
  EXPECT_THAT(finder.Find({0, 0, 0}).status(),
              StatusIs(absl::StatusCode::kDataLoss, HasSubstr("run.h5:/v: chunk at (0, 0, 0)")));
}

}  // namespace
}  // namespace isoscope::source
