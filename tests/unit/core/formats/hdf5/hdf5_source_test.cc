// Datasets written by the library itself, and damaged ones:
//
// - every type, byte order and layout, with rows that begin and end within planes;
// - axes, spacing, names, and files beyond 32-bit sizes;
// - files and datasets that are no volume, with the message;
// - cut and flipped files, which must never crash this process.

#include "core/formats/hdf5/hdf5_source.h"

#include <malloc.h>

#include <cmath>
#include <cstddef>
#include <cstdint>
#include <filesystem>
#include <memory>
#include <string>
#include <utility>
#include <vector>

#include "absl/strings/str_cat.h"
#include "gmock/gmock.h"
#include "gtest/gtest.h"

#include "core/formats/hdf5/hdf5_dataset.h"
#include "core/formats/hdf5/hdf5_types.h"
#include "hdf5.h"
#include "tests/support/only_volume.h"
#include "tests/support/status_matchers.h"
#include "tests/support/temp_dir.h"
#include "tests/support/volume_files.h"

namespace isoscope::source {
namespace {

using ::isoscope::testing::Noise;
using ::isoscope::testing::ReadAll;
using ::isoscope::testing::ReadFile;
using ::isoscope::testing::StatusIs;
using ::isoscope::testing::TempDir;
using ::isoscope::testing::WriteFile;
using ::testing::_;
using ::testing::AllOf;
using ::testing::HasSubstr;
using volume::ScalarType;

constexpr math::Index3 kDims{13, 11, 17};

struct TypeRow {
  ScalarType type;
  hid_t little;
  hid_t big;
};
std::vector<TypeRow> Types() {
  return {{ScalarType::kUint8, H5T_STD_U8LE, H5T_STD_U8BE},
          {ScalarType::kInt8, H5T_STD_I8LE, H5T_STD_I8BE},
          {ScalarType::kUint16, H5T_STD_U16LE, H5T_STD_U16BE},
          {ScalarType::kInt16, H5T_STD_I16LE, H5T_STD_I16BE},
          {ScalarType::kUint32, H5T_STD_U32LE, H5T_STD_U32BE},
          {ScalarType::kInt32, H5T_STD_I32LE, H5T_STD_I32BE},
          {ScalarType::kFloat32, H5T_IEEE_F32LE, H5T_IEEE_F32BE},
          {ScalarType::kFloat64, H5T_IEEE_F64LE, H5T_IEEE_F64BE}};
}

// Writes `samples`, of `memory_type`, as a dataset of `file_type`. Chunked and deflated if `chunk`
// is not empty.
void WriteDataset(hid_t file, const std::string& name, const std::vector<hsize_t>& dims,
                  hid_t file_type, hid_t memory_type, const std::vector<hsize_t>& chunk,
                  const void* samples) {
  const hid_t space = H5Screate_simple(static_cast<int>(dims.size()), dims.data(), nullptr);
  const hid_t links = H5Pcreate(H5P_LINK_CREATE);
  H5Pset_create_intermediate_group(links, 1);
  const hid_t properties = H5Pcreate(H5P_DATASET_CREATE);
  if (!chunk.empty()) {
    H5Pset_chunk(properties, static_cast<int>(chunk.size()), chunk.data());
    H5Pset_shuffle(properties);
    H5Pset_deflate(properties, 4);
  }
  const hid_t dataset =
      H5Dcreate2(file, name.c_str(), file_type, space, links, properties, H5P_DEFAULT);
  ASSERT_GE(dataset, 0);
  if (samples != nullptr) {
    ASSERT_GE(H5Dwrite(dataset, memory_type, H5S_ALL, H5S_ALL, H5P_DEFAULT, samples), 0);
  }
  H5Dclose(dataset);
  H5Pclose(properties);
  H5Pclose(links);
  H5Sclose(space);
}

class Hdf5SourceTest : public ::testing::Test {
 protected:
  hid_t Create(const std::string& name) {
    return H5Fcreate(dir_.Sub(name).c_str(), H5F_ACC_TRUNC, H5P_DEFAULT, H5P_DEFAULT);
  }
  TempDir dir_;
};

TEST_F(Hdf5SourceTest, SamplesThatNobodyWroteAreZeroAndNotWhatMemoryHeld) {
  // Found by hdf5_fuzz: without a fill value the library does not write to the buffer.
  const hid_t file = Create("v.h5");
  const hsize_t dims[] = {4, 5, 6};
  const hsize_t chunk[] = {2, 5, 6};
  const hid_t space = H5Screate_simple(3, dims, nullptr);
  const hid_t properties = H5Pcreate(H5P_DATASET_CREATE);
  H5Pset_chunk(properties, 3, chunk);
  H5Pset_fill_value(properties, H5T_STD_U8LE, nullptr);  // undefined
  H5Pset_fill_time(properties, H5D_FILL_TIME_NEVER);
  H5Dclose(H5Dcreate2(file, "v", H5T_STD_U8LE, space, H5P_DEFAULT, properties, H5P_DEFAULT));
  H5Pclose(properties);
  H5Sclose(space);
  H5Fclose(file);
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(const auto source, OpenVolumeFile(dir_.Sub("v.h5")));
  std::string samples(120, 'x');
  ISOSCOPE_ASSERT_OK(source->ReadSlab(0, 4, samples.data()));
  EXPECT_EQ(samples, std::string(120, '\0'));
}

TEST_F(Hdf5SourceTest, FloatsOfAnotherLayoutThanIeeeAreRefused) {
  // Found by hdf5_fuzz: the library's conversion of such types depends on how much is read at once.
  const hid_t type = H5Tcopy(H5T_IEEE_F32LE);
  ASSERT_GE(H5Tset_ebias(type, 100), 0);
  const hid_t file = Create("v.h5");
  const std::string samples(480, 'a');
  WriteDataset(file, "v", {4, 5, 6}, type, type, {}, samples.data());
  H5Fclose(file);
  H5Tclose(type);
  EXPECT_THAT(OpenVolumeFile(dir_.Sub("v.h5") + ":/v").status(),
              StatusIs(absl::StatusCode::kInvalidArgument, HasSubstr("IEEE floats")));
}

TEST_F(Hdf5SourceTest, EveryTypeByteOrderAndLayoutComesBackExactly) {
  for (const TypeRow& row : Types()) {
    const std::string samples = Noise(kDims, row.type);
    for (const bool is_big : {false, true}) {
      for (const bool is_chunked : {false, true}) {
        SCOPED_TRACE(absl::StrCat(std::string(volume::NameOf(row.type)), is_big, is_chunked));
        const hid_t file = Create("v.h5");
        WriteDataset(
            file, "/a/deep/volume", {17, 11, 13}, is_big ? row.big : row.little, row.little,
            is_chunked ? std::vector<hsize_t>{4, 5, 6} : std::vector<hsize_t>{}, samples.data());
        H5Fclose(file);
        ISOSCOPE_ASSERT_OK_AND_ASSIGN(const auto source,
                                      OpenVolumeFile(dir_.Sub("v.h5") + ":/a/deep/volume"));
        EXPECT_EQ(source->info().geometry.sample_dims, kDims);
        EXPECT_EQ(source->info().type, row.type);
        for (const std::int64_t planes : {1, 5, 17}) {
          ISOSCOPE_ASSERT_OK_AND_ASSIGN(const std::string read, ReadAll(*source, planes));
          EXPECT_TRUE(read == samples);
        }
        // Runs of rows that begin and end within planes.
        const std::size_t row_bytes = 13 * volume::SizeOf(row.type);
        for (std::int64_t begin : {0, 3, 10, 11, 30}) {
          for (std::int64_t count : {1, 8, 12, 40, 60}) {
            std::string rows(static_cast<std::size_t>(count) * row_bytes, '\0');
            ISOSCOPE_ASSERT_OK(source->ReadRows(begin, begin + count, rows.data()));
            EXPECT_TRUE(rows == samples.substr(static_cast<std::size_t>(begin) * row_bytes,
                                               static_cast<std::size_t>(count) * row_bytes));
          }
        }
      }
    }
  }
}

TEST_F(Hdf5SourceTest, AxesOfOneElementAreLeftOutAndTheElementSizeIsTheSpacing) {
  const std::string samples = Noise(kDims, ScalarType::kUint8);
  const hid_t file = Create("v.hdf5");
  WriteDataset(file, "v", {1, 17, 11, 1, 13}, H5T_STD_U8LE, H5T_STD_U8LE, {}, samples.data());
  const hid_t dataset = H5Dopen2(file, "v", H5P_DEFAULT);
  const hsize_t three = 3;
  const hid_t space = H5Screate_simple(1, &three, nullptr);
  const hid_t attribute =
      H5Acreate2(dataset, "element_size_um", H5T_IEEE_F32BE, space, H5P_DEFAULT, H5P_DEFAULT);
  const double zyx[] = {4, 2, 0.5};
  H5Awrite(attribute, H5T_NATIVE_DOUBLE, zyx);
  H5Aclose(attribute);
  H5Sclose(space);
  H5Dclose(dataset);
  H5Fclose(file);
  // The only volume of the file need not be named.
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(const auto source, OpenVolumeFile(dir_.Sub("v.hdf5")));
  EXPECT_EQ(source->info().geometry.sample_dims, kDims);
  EXPECT_EQ(source->info().geometry.spacing, (math::Vec3d{0.5, 2, 4}));
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(const std::string read, ReadAll(*source, 4));
  EXPECT_TRUE(read == samples);
}

TEST_F(Hdf5SourceTest, ElementSizesAreThreeDistances) {
  const std::string samples = Noise(kDims, ScalarType::kUint8);
  for (const std::vector<double>& bad :
       {std::vector<double>{4, 2}, {4, 2, 0}, {4, -2, 1}, {std::nan(""), 2, 1}, {4, 2, 1, 1}}) {
    const hid_t file = Create("v.h5");
    WriteDataset(file, "v", {17, 11, 13}, H5T_STD_U8LE, H5T_STD_U8LE, {}, samples.data());
    const hid_t dataset = H5Dopen2(file, "v", H5P_DEFAULT);
    const hsize_t count = bad.size();
    const hid_t space = H5Screate_simple(1, &count, nullptr);
    const hid_t attribute =
        H5Acreate2(dataset, "element_size_um", H5T_IEEE_F64LE, space, H5P_DEFAULT, H5P_DEFAULT);
    H5Awrite(attribute, H5T_NATIVE_DOUBLE, bad.data());
    H5Aclose(attribute);
    H5Sclose(space);
    H5Dclose(dataset);
    H5Fclose(file);
    EXPECT_THAT(OpenVolumeFile(dir_.Sub("v.h5")),
                StatusIs(absl::StatusCode::kInvalidArgument,
                         AllOf(HasSubstr("element_size_um has"), HasSubstr("--spacing X,Y,Z"))))
        << bad.size() << " " << bad[0];
    ISOSCOPE_ASSERT_OK_AND_ASSIGN(const auto source,
                                  OpenVolumeFile(dir_.Sub("v.h5"), "", {.has_spacing = true}));
    EXPECT_EQ(source->info().geometry.spacing, (math::Vec3d{1, 1, 1}));
  }
}

TEST_F(Hdf5SourceTest, RowsBeyond32BitIndicesAndBytesAreFound) {
  // 5 G samples of which one chunk, near the end, is stored.
  const hid_t file = Create("big.h5");
  const hsize_t dims[] = {1200, 2048, 2048};
  const hsize_t chunk[] = {1, 64, 2048};
  const hid_t space = H5Screate_simple(3, dims, nullptr);
  const hid_t properties = H5Pcreate(H5P_DATASET_CREATE);
  H5Pset_chunk(properties, 3, chunk);
  const hid_t dataset =
      H5Dcreate2(file, "v", H5T_STD_U8LE, space, H5P_DEFAULT, properties, H5P_DEFAULT);
  const hsize_t start[] = {1199, 1984, 0};
  H5Sselect_hyperslab(space, H5S_SELECT_SET, start, nullptr, chunk, nullptr);
  const hid_t memory = H5Screate_simple(3, chunk, nullptr);
  const std::string samples = Noise({2048, 64, 1}, ScalarType::kUint8);
  ASSERT_GE(H5Dwrite(dataset, H5T_STD_U8LE, memory, space, H5P_DEFAULT, samples.data()), 0);
  for (const hid_t id : {memory, space}) {
    H5Sclose(id);
  }
  H5Pclose(properties);
  H5Dclose(dataset);
  H5Fclose(file);
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(const auto source, OpenVolumeFile(dir_.Sub("big.h5") + ":/v"));
  EXPECT_EQ(math::Volume(source->info().geometry.sample_dims), std::int64_t{1200} * 2048 * 2048);
  const std::int64_t rows = std::int64_t{1200} * 2048;
  std::string read(samples.size(), '\0');
  ISOSCOPE_ASSERT_OK(source->ReadRows(rows - 64, rows, read.data()));
  EXPECT_TRUE(read == samples);
}

TEST_F(Hdf5SourceTest, WhatIsNoVolumeIsRefusedWithTheNamesOfThoseThatAre) {
  const hid_t file = Create("v.h5");
  const std::string samples = Noise(kDims, ScalarType::kFloat64);
  WriteDataset(file, "a", {17, 11, 13}, H5T_STD_U8LE, H5T_STD_U8LE, {}, samples.data());
  WriteDataset(file, "g/b", {17, 11, 13}, H5T_STD_U8LE, H5T_STD_U8LE, {}, samples.data());
  WriteDataset(file, "flat", {17, 11}, H5T_STD_U8LE, H5T_STD_U8LE, {}, samples.data());
  WriteDataset(file, "four", {2, 7, 11, 13}, H5T_STD_U8LE, H5T_STD_U8LE, {}, samples.data());
  WriteDataset(file, "long", {17, 11, 13}, H5T_STD_I64LE, H5T_STD_I64LE, {}, samples.data());
  H5Fclose(file);
  const auto status_of = [&](const std::string& suffix) {
    return OpenVolumeFile(dir_.Sub("v.h5") + suffix).status();
  };
  constexpr auto kInvalid = absl::StatusCode::kInvalidArgument;
  const std::string list =
      "it holds /a (17 x 11 x 13 uint8), /four (2 x 7 x 11 x 13 uint8), /g/b (17 x 11 x 13 uint8), "
      "/long (17 x 11 x 13 int64)";
  EXPECT_THAT(status_of(""),
              StatusIs(kInvalid, HasSubstr("say which dataset, as in " + dir_.Sub("v.h5") +
                                           ":/a (--field chooses none of them); " + list)));
  EXPECT_THAT(status_of(":/absent"),
              StatusIs(absl::StatusCode::kNotFound, HasSubstr("no dataset /absent; " + list)));
  EXPECT_THAT(status_of(":/g"), StatusIs(absl::StatusCode::kNotFound,
                                         HasSubstr("a group, not a dataset, /g; " + list)));
  EXPECT_THAT(status_of(":/flat"), StatusIs(kInvalid, HasSubstr("2 axes")));
  EXPECT_THAT(status_of(":/four"), StatusIs(kInvalid, HasSubstr("4 axes (2 x 7 x 11 x 13")));
  ISOSCOPE_EXPECT_OK(status_of(":/long"));  // as float64
  EXPECT_THAT(OpenVolumeFile(dir_.Sub("no.h5") + ":/a").status(),
              StatusIs(absl::StatusCode::kNotFound, _));
  WriteFile(dir_.Sub("text.h5"), "no HDF5");
  EXPECT_THAT(OpenVolumeFile(dir_.Sub("text.h5") + ":/a").status(), StatusIs(kInvalid, _));
}

TEST_F(Hdf5SourceTest, CutAndFlippedFilesNeverCrash) {
  const std::string samples = Noise(kDims, ScalarType::kUint16);
  const hid_t file = Create("v.h5");
  WriteDataset(file, "v", {17, 11, 13}, H5T_STD_U16LE, H5T_STD_U16LE, {8, 11, 13}, samples.data());
  H5Fclose(file);
  const std::string whole = ReadFile(dir_.Sub("v.h5"));
  int refused = 0;
  for (std::size_t size = 0; size < whole.size(); size += 211) {
    WriteFile(dir_.Sub("cut.h5"), whole.substr(0, size));
    const auto source = OpenVolumeFile(dir_.Sub("cut.h5") + ":/v");
    refused += !source.ok() || !ReadAll(**source, 17).ok() ? 1 : 0;
  }
  EXPECT_EQ(refused, static_cast<int>((whole.size() + 210) / 211));
  for (std::size_t at = 0; at < whole.size(); at += 37) {
    std::string flipped = whole;
    flipped[at] = static_cast<char>(flipped[at] ^ 0x41);
    WriteFile(dir_.Sub("cut.h5"), flipped);
    const auto source = OpenVolumeFile(dir_.Sub("cut.h5") + ":/v");
    if (source.ok() &&
        math::Volume((*source)->info().geometry.sample_dims) <= math::Volume(kDims)) {
      // The library's cache must not turn a failed read into a good one.
      const bool is_read = ReadAll(**source, 17).ok();
      EXPECT_EQ(ReadAll(**source, 17).ok(), is_read) << "byte " << at;
    }
  }
}

// Symptom: parts of planes that overlap, as a small memory limit has them, kept every chunk of the file.
TEST_F(Hdf5SourceTest, TheCacheKeepsItsBoundWhateverRowsAreRead) {
  constexpr math::Index3 kLarge{64, 64, 128};
  const std::string samples = Noise(kLarge, ScalarType::kUint8);
  const hid_t created = Create("a.h5");
  WriteDataset(created, "v", {128, 64, 64}, H5T_STD_U8LE, H5T_NATIVE_UINT8, {8, 32, 32},
               samples.data());
  H5Fclose(created);
  volume::GridGeometry geometry;
  geometry.sample_dims = kLarge;
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(NamedHdf5Dataset named, OpenHdf5ByName(dir_.Sub("a.h5")));
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(Hdf5SampleType type, Hdf5SampleTypeOf(named.dataset.get()));
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(
      const std::unique_ptr<VolumeSource> source,
      OpenHdf5Volume(std::move(named), std::move(type), {.z = 0, .y = 1, .x = 2}, 0, 0, geometry));
  std::string rows(std::size_t{24} * 64, '\0');
  const std::size_t before = mallinfo2().uordblks;
  for (std::int64_t first = 0; first + 11 <= kLarge.z; first += 9) {
    for (std::int64_t y = 0; y + 24 <= kLarge.y; y += 20) {
      for (std::int64_t z = first; z < first + 11; ++z) {
        const std::int64_t row = z * kLarge.y + y;
        ISOSCOPE_ASSERT_OK(source->ReadRows(row, row + 24, rows.data()));
        ASSERT_EQ(rows, samples.substr(static_cast<std::size_t>(row) * 64, rows.size()));
      }
    }
  }
  // The cache has a layer of chunks, 32 KiB of the 512. Allocators with sanitizers tell nothing.
  EXPECT_LT(mallinfo2().uordblks, before + (std::size_t{128} << 10));
}

}  // namespace
}  // namespace isoscope::source
