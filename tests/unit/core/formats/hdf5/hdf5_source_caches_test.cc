// Chunks under a virtual dataset are decoded once while the bound of all caches allows that, and the
// bound holds. Breaks if the library forgets a chunk between two reads of its rows, or if caches of
// sources that were read before add up.

#include "core/formats/hdf5/hdf5_source_caches.h"

#include <malloc.h>

#include <cstdlib>
#include <cstring>
#include <memory>
#include <optional>
#include <string>
#include <utility>
#include <vector>

#include "absl/strings/str_cat.h"
#include "gmock/gmock.h"
#include "gtest/gtest.h"

#include "core/base/units.h"
#include "core/formats/hdf5/hdf5_dataset.h"
#include "core/formats/hdf5/hdf5_types.h"
#include "core/source/hdf5/hdf5_handle.h"
#include "hdf5.h"
#include "tests/support/status_matchers.h"
#include "tests/support/temp_dir.h"

namespace isoscope::source {
namespace {

using ::isoscope::testing::TempDir;
using Mapping = Hdf5SourceCaches::Mapping;
using base::kMiB;

Hdf5SourceCaches::Chunks ChunksOf(std::int64_t chunk_mib, std::int64_t plane_mib) {
  return {.chunk_bytes = static_cast<double>(chunk_mib * kMiB),
          .plane_bytes = static_cast<double>(plane_mib * kMiB)};
}

// Sources of `depth` planes each, one below the other; `count` of them.
std::vector<Mapping> Slabs(std::size_t count, std::int64_t depth) {
  std::vector<Mapping> mappings;
  for (std::size_t i = 0; i < count; ++i) {
    const auto z = static_cast<std::int64_t>(i) * depth;
    mappings.push_back({.source = i, .begin_z = z, .end_z = z + depth, .begin_y = 0, .end_y = 100});
  }
  return mappings;
}

TEST(Hdf5SourceCachesTest, ACacheHoldsAPlaneOfItsSourceIfAllOfAPlaneFit) {
  // As many as the bound has room for.
  auto slabs = Hdf5SourceCaches::Plan(Slabs(5, 10), ChunksOf(4, 8), 32 * kMiB);
  ASSERT_TRUE(slabs.has_value());
  EXPECT_EQ(slabs->cache_bytes(), 8 * kMiB);
  EXPECT_EQ(slabs->max_bytes(), 32 * kMiB);
  slabs = Hdf5SourceCaches::Plan(Slabs(2, 10), ChunksOf(4, 8), 32 * kMiB);
  ASSERT_TRUE(slabs.has_value());
  EXPECT_EQ(slabs->max_bytes(), 16 * kMiB) << "there are but two sources";
  // A plane of four sources shares the bound; chunks go before planes.
  std::vector<Mapping> four = Slabs(4, 10);
  for (Mapping& mapping : four) {
    mapping.begin_z = 0;
    mapping.end_z = 10;
  }
  auto shared = Hdf5SourceCaches::Plan(four, ChunksOf(4, 16), 32 * kMiB);
  ASSERT_TRUE(shared.has_value());
  EXPECT_EQ(shared->cache_bytes(), 8 * kMiB);
  shared = Hdf5SourceCaches::Plan(four, ChunksOf(32, 32), 32 * kMiB);
  ASSERT_TRUE(shared.has_value()) << "128 MiB are the most";
  EXPECT_EQ(shared->max_bytes(), 128 * kMiB);
  EXPECT_FALSE(Hdf5SourceCaches::Plan(four, ChunksOf(33, 33), 32 * kMiB).has_value());
  EXPECT_FALSE(Hdf5SourceCaches::Plan(four, ChunksOf(0, 0), 32 * kMiB).has_value());
  EXPECT_FALSE(Hdf5SourceCaches::Plan({}, ChunksOf(4, 8), 32 * kMiB).has_value());
}

TEST(Hdf5SourceCachesTest, ReadsEndWhereTheBoundIsReached) {
  auto caches = Hdf5SourceCaches::Plan(Slabs(5, 10), ChunksOf(16, 16), 32 * kMiB);
  ASSERT_TRUE(caches.has_value());
  const auto expect_next = [&](std::int64_t begin_z, std::int64_t end_z, std::int64_t expected_end,
                               bool must_reopen) {
    const Hdf5SourceCaches::Step step = caches->Next(begin_z, end_z, 0, 100);
    EXPECT_EQ(step.end_z, expected_end) << begin_z;
    EXPECT_EQ(step.must_reopen, must_reopen) << begin_z;
  };
  expect_next(0, 50, 20, false);
  expect_next(3, 18, 18, false);
  expect_next(20, 50, 40, true);
  expect_next(39, 50, 40, false);
  expect_next(40, 50, 50, true);
  expect_next(45, 50, 50, false);
  expect_next(0, 1, 1, false);
  expect_next(10, 11, 11, true);
}

TEST(Hdf5SourceCachesTest, OnlySourcesOfTheRowsThatAreReadCount) {
  std::vector<Mapping> mappings;
  for (std::size_t i = 0; i < 4; ++i) {
    const auto y = static_cast<std::int64_t>(i) * 10;
    mappings.push_back({.source = i, .begin_z = 0, .end_z = 7, .begin_y = y, .end_y = y + 10});
    mappings.push_back({.source = i + 4, .begin_z = 7, .end_z = 9, .begin_y = y, .end_y = y + 10});
  }
  auto caches = Hdf5SourceCaches::Plan(mappings, ChunksOf(8, 8), 32 * kMiB);
  ASSERT_TRUE(caches.has_value());
  EXPECT_EQ(caches->Next(0, 9, 0, 20).end_z, 9) << "two sources of each";
  EXPECT_EQ(caches->Next(0, 9, 10, 20).end_z, 9);
  const Hdf5SourceCaches::Step step = caches->Next(0, 9, 20, 30);
  EXPECT_TRUE(step.must_reopen) << "no room for a fifth";
  EXPECT_EQ(step.end_z, 9) << "the caches are empty";
}

// ---- With the library. --------------------------------------------------------------------------

constexpr H5Z_filter_t kFilter = 400;  // a number for tests
int decoded_count = 0;

// A chunk of one value is one byte, and its size is the parameter.
std::size_t FilterOneValue(unsigned flags, std::size_t /*count*/, const unsigned* values,
                           std::size_t /*bytes*/, std::size_t* buffer_bytes, void** buffer) {
  const bool is_decoding = (flags & H5Z_FLAG_REVERSE) != 0;
  const std::size_t size = is_decoding ? values[0] : 1;
  void* const out = std::malloc(size);
  std::memset(out, *static_cast<const char*>(*buffer), size);
  std::free(*buffer);
  *buffer = out;
  *buffer_bytes = size;
  decoded_count += is_decoding ? 1 : 0;
  return size;
}

class Hdf5VirtualReadTest : public ::testing::Test {
 protected:
  void SetUp() override {
    const H5Z_class2_t filter{.version = H5Z_CLASS_T_VERS,
                              .id = kFilter,
                              .encoder_present = 1,
                              .decoder_present = 1,
                              .name = "one value",
                              .can_apply = nullptr,
                              .set_local = nullptr,
                              .filter = FilterOneValue};
    ASSERT_GE(H5Zregister(&filter), 0);
  }

  // A file with a dataset of one chunk and one value.
  void WriteSource(const std::string& name, const std::vector<hsize_t>& shape, char value) {
    const Hdf5Handle file(
        H5Fcreate(dir_.Sub(name).c_str(), H5F_ACC_TRUNC, H5P_DEFAULT, H5P_DEFAULT), H5Fclose);
    const auto rank = static_cast<int>(shape.size());
    const Hdf5Handle properties(H5Pcreate(H5P_DATASET_CREATE), H5Pclose);
    H5Pset_chunk(properties.get(), rank, shape.data());
    std::size_t size = 1;
    for (const hsize_t length : shape) {
      size *= length;
    }
    const auto parameter = static_cast<unsigned>(size);
    H5Pset_filter(properties.get(), kFilter, H5Z_FLAG_MANDATORY, 1, &parameter);
    const Hdf5Handle space(H5Screate_simple(rank, shape.data(), nullptr), H5Sclose);
    const Hdf5Handle dataset(H5Dcreate2(file.get(), "v", H5T_STD_U8LE, space.get(), H5P_DEFAULT,
                                        properties.get(), H5P_DEFAULT),
                             H5Dclose);
    const std::string samples(size, value);
    ASSERT_GE(H5Dwrite(dataset.get(), H5T_STD_U8LE, H5S_ALL, H5S_ALL, H5P_DEFAULT, samples.data()),
              0);
  }

  struct Part {
    std::string file;
    std::vector<hsize_t> start;
    std::vector<hsize_t> shape;
  };
  void WriteVirtual(const std::vector<hsize_t>& shape, const std::vector<Part>& parts) {
    const Hdf5Handle file(
        H5Fcreate(dir_.Sub("v.h5").c_str(), H5F_ACC_TRUNC, H5P_DEFAULT, H5P_DEFAULT), H5Fclose);
    const Hdf5Handle properties(H5Pcreate(H5P_DATASET_CREATE), H5Pclose);
    const Hdf5Handle space(H5Screate_simple(3, shape.data(), nullptr), H5Sclose);
    for (const Part& part : parts) {
      const Hdf5Handle source(H5Screate_simple(3, part.shape.data(), nullptr), H5Sclose);
      H5Sselect_hyperslab(space.get(), H5S_SELECT_SET, part.start.data(), nullptr,
                          part.shape.data(), nullptr);
      ASSERT_GE(H5Pset_virtual(properties.get(), space.get(), part.file.c_str(), "v", source.get()),
                0);
    }
    const Hdf5Handle whole(H5Screate_simple(3, shape.data(), nullptr), H5Sclose);
    const Hdf5Handle dataset(H5Dcreate2(file.get(), "v", H5T_STD_U8LE, whole.get(), H5P_DEFAULT,
                                        properties.get(), H5P_DEFAULT),
                             H5Dclose);
    ASSERT_TRUE(dataset.is_valid()) << LastHdf5Error();
  }
  void Open(const math::Index3& dims) {
    volume::GridGeometry geometry;
    geometry.sample_dims = dims;
    ISOSCOPE_ASSERT_OK_AND_ASSIGN(NamedHdf5Dataset named, OpenHdf5ByName(dir_.Sub("v.h5")));
    ISOSCOPE_ASSERT_OK_AND_ASSIGN(Hdf5SampleType type, Hdf5SampleTypeOf(named.dataset.get()));
    ISOSCOPE_ASSERT_OK_AND_ASSIGN(
        source_, OpenHdf5Volume(std::move(named), std::move(type), {.z = 0, .y = 1, .x = 2}, 0, 0,
                                geometry));
    decoded_count = 0;
  }
  // Reads some rows of a plane, and returns the values at both ends.
  std::string Ends(std::int64_t z, std::int64_t begin_y, std::int64_t end_y) {
    const math::Index3& dims = source_->info().geometry.sample_dims;
    std::string rows(static_cast<std::size_t>((end_y - begin_y) * dims.x), '\0');
    EXPECT_THAT(source_->ReadRows(z * dims.y + begin_y, z * dims.y + end_y, rows.data()),
                isoscope::testing::IsOk());
    return {rows.front(), rows.back()};
  }

  TempDir dir_;
  std::unique_ptr<VolumeSource> source_;
};

// Symptom: a volume over one large chunk took as many times the decoding of it as it had reads.
TEST_F(Hdf5VirtualReadTest, ChunksUnderAVirtualDatasetAreDecodedOnce) {
  constexpr hsize_t kEdge = 128;  // a chunk has 2 MiB, more than the library keeps by default
  const std::vector<hsize_t> shape{kEdge, kEdge, kEdge};
  std::vector<Part> parts;
  for (const hsize_t y : {0U, 1U}) {
    for (const hsize_t x : {0U, 1U}) {
      const std::string file = absl::StrCat(y, x, ".h5");
      WriteSource(file, shape, static_cast<char>('a' + 2 * y + x));
      parts.push_back({.file = file, .start = {0, y * kEdge, x * kEdge}, .shape = shape});
    }
  }
  WriteVirtual({kEdge, 2 * kEdge, 2 * kEdge}, parts);
  Open({2 * kEdge, 2 * kEdge, kEdge});
  EXPECT_GE(source_->info().memory_bytes, static_cast<std::int64_t>(4 * 2 * kMiB));
  for (const int z : {0, 1, 2, 127, 64, 0}) {
    EXPECT_EQ(Ends(z, 0, 256), "ad");
    EXPECT_EQ(Ends(z, 100, 120), "ab");
    EXPECT_EQ(Ends(z, 120, 150), "ad");
  }
  EXPECT_EQ(decoded_count, 4);
}

TEST_F(Hdf5VirtualReadTest, CachesOfSourcesThatWereReadBeforeAreGivenUp) {
  constexpr hsize_t kDepth = 20;
  constexpr hsize_t kEdge = 1024;  // a chunk has 20 MiB: two are more than 32
  const std::vector<hsize_t> shape{kDepth, kEdge, kEdge};
  std::vector<Part> parts;
  for (hsize_t i = 0; i < 6; ++i) {
    const std::string file = absl::StrCat(i, ".h5");
    WriteSource(file, shape, static_cast<char>('a' + i));
    parts.push_back({.file = file, .start = {i * kDepth, 0, 0}, .shape = shape});
  }
  WriteVirtual({6 * kDepth, kEdge, kEdge}, parts);
  Open({kEdge, kEdge, 6 * kDepth});
  EXPECT_LT(source_->info().memory_bytes, static_cast<std::int64_t>(40 * kMiB));
  const auto held_bytes = [] { return mallinfo2().uordblks + mallinfo2().hblkhd; };
  const std::size_t before = held_bytes();
  for (std::int64_t z = 0; z < static_cast<std::int64_t>(6 * kDepth); ++z) {
    const auto value = static_cast<char>('a' + z / static_cast<std::int64_t>(kDepth));
    EXPECT_EQ(Ends(z, 3, 5), std::string(2, value));
    EXPECT_EQ(Ends(z, 900, 905), std::string(2, value));
    // Allocators with sanitizers tell nothing.
    ASSERT_LT(held_bytes(), before + std::size_t{32} * kMiB) << z;
  }
  EXPECT_EQ(decoded_count, 6);
  EXPECT_EQ(Ends(0, 0, 1), "aa");
  EXPECT_EQ(decoded_count, 7) << "kept beyond the bound";
  // Rows of several sources at once.
  std::string rows(6 * kDepth * kEdge * kEdge, '\0');
  ISOSCOPE_ASSERT_OK(
      source_->ReadRows(0, static_cast<std::int64_t>(6 * kDepth * kEdge), rows.data()));
  for (std::size_t i = 0; i < 6; ++i) {
    EXPECT_EQ(rows[i * kDepth * kEdge * kEdge], static_cast<char>('a' + i));
    EXPECT_EQ(rows[(i + 1) * kDepth * kEdge * kEdge - 1], static_cast<char>('a' + i));
  }
  EXPECT_EQ(decoded_count, 12);
}

}  // namespace
}  // namespace isoscope::source
