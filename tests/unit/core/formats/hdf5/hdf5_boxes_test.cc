// Boxes of datasets that the library wrote are the samples that were written: of each type, byte
// order, layout, index and set of filters. Damaged files are errors by name, or what the library
// reads.

#include "core/formats/hdf5/hdf5_boxes.h"

#include <algorithm>
#include <filesystem>
#include <memory>
#include <string>
#include <thread>
#include <vector>

#include "absl/strings/str_cat.h"
#include "gmock/gmock.h"
#include "gtest/gtest.h"

#include "core/base/cancellation.h"
#include "core/base/coding.h"
#include "tests/support/hdf5_file.h"
#include "tests/support/hdf5_mesh_file.h"
#include "tests/support/hdf5_volume_file.h"
#include "tests/support/only_volume.h"
#include "tests/support/status_matchers.h"
#include "tests/support/temp_dir.h"
#include "tests/support/volume_files.h"

namespace isoscope::source {
namespace {

using ::isoscope::testing::Hdf5VolumeFile;
using ::isoscope::testing::Noise;
using ::isoscope::testing::StatusIs;
using ::isoscope::testing::TempDir;
using ::isoscope::testing::WriteHdf5Volume;
using ::testing::AllOf;
using ::testing::HasSubstr;
using volume::ScalarType;

constexpr math::Index3 kDims{23, 19, 17};

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

std::string BoxOfSamples(const std::string& samples, std::size_t size, const math::Index3& dims,
                         const math::IndexBox& box) {
  std::string out;
  for (std::int64_t z = box.begin.z; z < box.end.z; ++z) {
    for (std::int64_t y = box.begin.y; y < box.end.y; ++y) {
      out +=
          samples.substr(static_cast<std::size_t>((z * dims.y + y) * dims.x + box.begin.x) * size,
                         static_cast<std::size_t>(box.dims().x) * size);
    }
  }
  return out;
}

const std::vector<math::IndexBox>& Boxes() {
  static const auto* const boxes = new std::vector<math::IndexBox>{
      {.begin = {0, 0, 0}, .end = kDims},       {.begin = {0, 0, 0}, .end = {1, 1, 1}},
      {.begin = {22, 18, 16}, .end = kDims},    {.begin = {8, 8, 8}, .end = {16, 16, 16}},
      {.begin = {7, 3, 5}, .end = {9, 12, 11}}, {.begin = {0, 18, 0}, .end = {23, 19, 17}}};
  return *boxes;
}

void ExpectBoxes(const VolumeSource& source, const std::string& samples) {
  const std::size_t size = volume::SizeOf(source.info().type);
  for (const math::IndexBox& box : Boxes()) {
    std::string read(static_cast<std::size_t>(math::Volume(box.dims())) * size, '?');
    ISOSCOPE_ASSERT_OK(source.ReadBox(box, read.data(), base::Cancellation()));
    EXPECT_TRUE(read == BoxOfSamples(samples, size, kDims, box))
        << box.begin.x << ", " << box.begin.y << ", " << box.begin.z;
  }
}

class Hdf5BoxesTest : public ::testing::Test {
 protected:
  // Expects what was written, in rows and in boxes.
  void Check(const Hdf5VolumeFile& volume, ScalarType type, const math::Index3& box_dims) {
    const std::string samples = WriteHdf5Volume(path_, volume, Noise(kDims, type));
    ISOSCOPE_ASSERT_OK_AND_ASSIGN(const auto source, OpenVolumeFile(path_));
    EXPECT_EQ(source->box_grid(), (BoxGrid{.origin = {0, 0, 0}, .box_dims = box_dims}));
    ISOSCOPE_ASSERT_OK_AND_ASSIGN(const std::string read, testing::ReadAll(*source, 5));
    EXPECT_TRUE(read == samples);
    const bool is_own = !volume.chunk.empty() && !volume.has_scale_offset;
    if (is_own) {
      std::filesystem::remove(path_);  // the library would open it again
    }
    ExpectBoxes(*source, samples);
  }

  TempDir dir_;
  const std::string path_ = dir_.Sub("v.h5");
};

TEST_F(Hdf5BoxesTest, EachTypeAndByteOrder) {
  for (const TypeRow& row : Types()) {
    for (const bool is_big : {false, true}) {
      SCOPED_TRACE(absl::StrCat(std::string(volume::NameOf(row.type)), is_big ? ", big" : ""));
      Hdf5VolumeFile volume{.dims = kDims,
                            .file_type = is_big ? row.big : row.little,
                            .memory_type = row.little,
                            .chunk = {5, 8, 7},
                            .has_shuffle = true,
                            .has_gzip = true};
      Check(volume, row.type, {7, 8, 5});
      volume.chunk = {};
      Check(volume, row.type, {128, 32, 32});  // as a raw file
    }
  }
}

TEST_F(Hdf5BoxesTest, EachSetOfFiltersAndIndex) {
  const std::string fill = "\x12\x34";
  const Hdf5VolumeFile plain{.dims = kDims, .chunk = {5, 8, 7}};
  std::vector<Hdf5VolumeFile> volumes(12, plain);
  volumes[1].has_gzip = true;
  volumes[2].has_checksum = true;
  volumes[3].has_shuffle = volumes[3].has_checksum = true;
  volumes[4].has_shuffle = volumes[4].has_gzip = volumes[4].has_checksum = true;
  volumes[5].has_gzip = true;
  volumes[5].skipped_every = 2;
  volumes[6].has_gzip = true;
  volumes[6].missing_every = 2;
  volumes[7] = volumes[6];
  volumes[7].fill = fill;
  volumes[7].skipped_every = 3;
  volumes[8] = volumes[7];
  volumes[8].file_type = H5T_STD_U16BE;
  volumes[8].user_block = 1024;
  volumes[9].is_last_only = true;
  volumes[10].has_gzip = true;
  volumes[10].is_latest = volumes[10].has_plain_edges = true;
  volumes[11].chunk = {17, 19, 23};
  volumes[11].is_latest = true;
  for (std::size_t i = 0; i < volumes.size(); ++i) {
    SCOPED_TRACE(i);
    const source::ChunkIndex& chunk = volumes[i].chunk;
    Check(volumes[i], ScalarType::kUint16, {chunk[2], chunk[1], chunk[0]});
  }
  Hdf5VolumeFile behind_user_block{.dims = kDims, .user_block = 512};
  Check(behind_user_block, ScalarType::kUint16, {128, 32, 32});
}

TEST_F(Hdf5BoxesTest, TheLibraryReadsBoxesOfFiltersThatItAloneKnows) {
  Check({.dims = kDims, .chunk = {5, 8, 7}, .has_scale_offset = true}, ScalarType::kUint16,
        {23, 8, 5});  // whole rows
}

TEST_F(Hdf5BoxesTest, TheLibraryReadsBoxesOfTypesThatItConverts) {
  // Integers of 12 bits in 16.
  const hid_t type = H5Tcopy(H5T_STD_U16LE);
  H5Tset_precision(type, 12);
  std::string samples = Noise(kDims, ScalarType::kUint16);
  for (std::size_t i = 1; i < samples.size(); i += 2) {
    samples[i] = static_cast<char>(samples[i] & 0x0f);
  }
  const hid_t file = H5Fcreate(path_.c_str(), H5F_ACC_TRUNC, H5P_DEFAULT, H5P_DEFAULT);
  testing::WriteHdf5Dataset(file, "v", {17, 19, 23}, type, samples.data(), {5, 8, 7});
  testing::WriteHdf5Dataset(file, "w", {17, 19, 23}, type, samples.data());
  H5Fclose(file);
  H5Tclose(type);
  for (const char* const name : {":/v", ":/w"}) {
    ISOSCOPE_ASSERT_OK_AND_ASSIGN(const auto source, OpenVolumeFile(path_ + name));
    ExpectBoxes(*source, samples);
  }
}

TEST_F(Hdf5BoxesTest, WideTypesAreThoseOfRows) {
  const std::size_t count = 17 * 19 * 23;
  std::string integers;
  for (std::size_t i = 0; i < count; ++i) {
    base::AppendLittleEndian(static_cast<std::int64_t>(i * 1000003) - 5, &integers);
  }
  const hid_t file = H5Fcreate(path_.c_str(), H5F_ACC_TRUNC, H5P_DEFAULT, H5P_DEFAULT);
  testing::WriteHdf5Dataset(file, "v", {17, 19, 23}, H5T_STD_I64LE, integers.data(), {5, 8, 7});
  testing::WriteHdf5Dataset(file, "w", {17, 19, 23}, H5T_STD_I64LE, integers.data());
  H5Fclose(file);
  for (const char* const name : {":/v", ":/w"}) {
    ISOSCOPE_ASSERT_OK_AND_ASSIGN(const auto source, OpenVolumeFile(path_ + name));
    EXPECT_EQ(source->info().type, ScalarType::kFloat64);
    ISOSCOPE_ASSERT_OK_AND_ASSIGN(const std::string rows, testing::ReadAll(*source, 17));
    ExpectBoxes(*source, rows);
  }
}

TEST_F(Hdf5BoxesTest, StepsAndComponentsAreTheirOwn) {
  const std::size_t size = std::size_t{17} * 19 * 23 * 2;
  const std::string samples =
      Noise({23, 19, 17 * 6}, ScalarType::kUint16);  // 3 steps, 2 components
  const hid_t file = H5Fcreate(path_.c_str(), H5F_ACC_TRUNC, H5P_DEFAULT, H5P_DEFAULT);
  testing::WriteHdf5Dataset(file, "v", {3, 2, 17, 19, 23}, H5T_STD_U16LE, samples.data(),
                            {1, 1, 5, 8, 7});
  testing::WriteHdf5Dataset(file, "w", {3, 2, 17, 19, 23}, H5T_STD_U16LE, samples.data());
  testing::WriteHdf5Dataset(file, "x", {3, 2, 17, 19, 23}, H5T_STD_U16LE, samples.data(),
                            {2, 2, 5, 8, 7});
  H5Fclose(file);
  for (const char* const name : {":/v", ":/w", ":/x"}) {
    SCOPED_TRACE(name);
    ISOSCOPE_ASSERT_OK_AND_ASSIGN(const auto series,
                                  OpenVolumeSeries(path_ + name, {.axes = "TCZYX"}));
    for (const int step : {0, 2}) {
      for (const int component : {0, 1}) {
        ISOSCOPE_ASSERT_OK_AND_ASSIGN(const auto source, series->Open(0, component, step));
        EXPECT_EQ(source->decoding_factor(), name[2] == 'x' ? 4 : 1);
        ExpectBoxes(*source,
                    samples.substr(static_cast<std::size_t>(step * 2 + component) * size, size));
      }
    }
  }
}

TEST_F(Hdf5BoxesTest, ComponentsBehindXAreTakenApart) {
  const std::string samples = Noise({23 * 3, 19, 17}, ScalarType::kUint16);
  const hid_t file = H5Fcreate(path_.c_str(), H5F_ACC_TRUNC, H5P_DEFAULT, H5P_DEFAULT);
  testing::WriteHdf5Dataset(file, "v", {17, 19, 23, 3}, H5T_STD_U16LE, samples.data());
  H5Fclose(file);
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(const auto series,
                                OpenVolumeSeries(path_ + ":/v", {.axes = "ZYXC"}));
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(const auto source, series->Open(0, 1, 0));
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(const std::string rows, testing::ReadAll(*source, 17));
  EXPECT_EQ(rows.substr(0, 4), samples.substr(2, 2) + samples.substr(8, 2));
  ExpectBoxes(*source, rows);
}

TEST_F(Hdf5BoxesTest, MeshesHaveTheirChunks) {
  const std::string samples = Noise(kDims, ScalarType::kUint16);
  {
    testing::Hdf5MeshWriter writer(path_);
    writer.Group("/VTKHDF");
    writer.Texts("/VTKHDF", "Type", {"ImageData"});
    writer.Numbers("/VTKHDF", "WholeExtent", {0, 22, 0, 18, 0, 16});
    writer.Numbers("/VTKHDF", "Origin", {0, 0, 0});
    writer.Numbers("/VTKHDF", "Spacing", {1, 2, 3});
    writer.Numbers("/VTKHDF", "Direction", {1, 0, 0, 0, 1, 0, 0, 0, 1});
    writer.Group("/VTKHDF/PointData");
    testing::WriteHdf5Dataset(writer.file(), "/VTKHDF/PointData/p", {17, 19, 23}, H5T_STD_U16LE,
                              samples.data(), {5, 8, 7});
  }
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(const auto source, OpenVolumeFile(path_ + ":p"));
  EXPECT_EQ(source->info().geometry.spacing, (math::Vec3d{1, 2, 3}));
  EXPECT_EQ(source->box_grid()->box_dims, (math::Index3{7, 8, 5}));
  ExpectBoxes(*source, samples);
}

TEST_F(Hdf5BoxesTest, DatasetsThatNobodyWroteToAreFilled) {
  const hid_t file = H5Fcreate(path_.c_str(), H5F_ACC_TRUNC, H5P_DEFAULT, H5P_DEFAULT);
  const hsize_t dims[] = {17, 19, 23};
  const hsize_t chunk[] = {5, 8, 7};
  const hid_t space = H5Screate_simple(3, dims, nullptr);
  const hid_t properties = H5Pcreate(H5P_DATASET_CREATE);
  const std::uint8_t seven = 7;
  H5Pset_fill_value(properties, H5T_STD_U8LE, &seven);
  H5Dclose(H5Dcreate2(file, "w", H5T_STD_U8LE, space, H5P_DEFAULT, properties, H5P_DEFAULT));
  H5Pset_chunk(properties, 3, chunk);
  H5Dclose(H5Dcreate2(file, "v", H5T_STD_U8LE, space, H5P_DEFAULT, properties, H5P_DEFAULT));
  H5Pset_fill_time(properties, H5D_FILL_TIME_NEVER);  // then zeros are read
  H5Dclose(H5Dcreate2(file, "x", H5T_STD_U8LE, space, H5P_DEFAULT, properties, H5P_DEFAULT));
  H5Pclose(properties);
  H5Sclose(space);
  H5Fclose(file);
  for (const char* const name : {":/v", ":/w", ":/x"}) {
    SCOPED_TRACE(name);
    ISOSCOPE_ASSERT_OK_AND_ASSIGN(const auto source, OpenVolumeFile(path_ + name));
    ISOSCOPE_ASSERT_OK_AND_ASSIGN(const std::string rows, testing::ReadAll(*source, 17));
    ExpectBoxes(*source, rows);
  }
}

TEST_F(Hdf5BoxesTest, ManyThreadsReadAtOnce) {
  for (const bool has_scale_offset : {false, true}) {
    const std::string samples = WriteHdf5Volume(path_,
                                                {.dims = kDims,
                                                 .chunk = {5, 8, 7},
                                                 .has_gzip = !has_scale_offset,
                                                 .has_scale_offset = has_scale_offset},
                                                Noise(kDims, ScalarType::kUint16));
    ISOSCOPE_ASSERT_OK_AND_ASSIGN(const auto source, OpenVolumeFile(path_));
    std::vector<std::thread> threads;
    for (int i = 0; i < 4; ++i) {
      threads.emplace_back([&] { ExpectBoxes(*source, samples); });
    }
    for (std::thread& thread : threads) {
      thread.join();
    }
  }
}

// ---- Damage. ------------------------------------------------------------------------------------

// Replaces the only place that has those bytes.
void Replace(const std::string& path, const std::string& from, const std::string& to) {
  std::string bytes = testing::ReadFile(path);
  const std::size_t at = bytes.find(from);
  ASSERT_NE(at, std::string::npos);
  bytes.replace(at, from.size(), to);
  testing::WriteFile(path, bytes);
}

// A key of a B-tree of chunks, as the file has it, and the chunk's address: size, filters, first
// element, element size (0), address.
std::string KeyOf(std::uint32_t size, const std::vector<std::uint64_t>& first,
                  std::uint64_t address) {
  std::string key;
  base::AppendLittleEndian(size, &key);
  base::AppendLittleEndian(std::uint32_t{0}, &key);
  for (const std::uint64_t index : first) {
    base::AppendLittleEndian(index, &key);
  }
  base::AppendLittleEndian(std::uint64_t{0}, &key);
  base::AppendLittleEndian(address, &key);
  return key;
}

// Where the library finds the chunk at the first element.
haddr_t FirstAddress(const std::string& path, hsize_t* size) {
  const hid_t file = H5Fopen(path.c_str(), H5F_ACC_RDONLY, H5P_DEFAULT);
  const hid_t dataset = H5Dopen2(file, "v", H5P_DEFAULT);
  const hsize_t first[] = {0, 0, 0};
  unsigned filters = 0;
  haddr_t address = 0;
  EXPECT_GE(H5Dget_chunk_info_by_coord(dataset, first, &filters, &address, size), 0);
  H5Dclose(dataset);
  H5Fclose(file);
  return address;
}

class DamagedHdf5BoxesTest : public Hdf5BoxesTest {
 protected:
  void Write(bool has_gzip) {
    WriteHdf5Volume(path_, {.dims = kDims, .chunk = {5, 8, 7}, .has_gzip = has_gzip},
                    Noise(kDims, ScalarType::kUint16));
    address_ = FirstAddress(path_, &size_);
  }
  void PutKey(std::uint32_t size, std::uint64_t address) {
    Replace(path_, KeyOf(static_cast<std::uint32_t>(size_), {0, 0, 0}, address_),
            KeyOf(size, {0, 0, 0}, address));
  }
  // The error of a box of the first chunk; rows have one, too.
  absl::Status ErrorOfBox() {
    const auto source = OpenVolumeFile(path_);
    if (!source.ok()) {
      return source.status();
    }
    EXPECT_TRUE((*source)->box_grid().has_value());
    std::string row(static_cast<std::size_t>((*source)->info().row_bytes()), '\0');
    EXPECT_FALSE((*source)->ReadRows(0, 1, row.data()).ok());
    return (*source)->ReadBox({.begin = {0, 0, 0}, .end = {1, 1, 1}}, row.data(),
                              base::Cancellation());
  }

  haddr_t address_ = 0;
  hsize_t size_ = 0;
};

TEST_F(Hdf5BoxesTest, TooManyChunksAreRefusedByName) {
  const hid_t file = H5Fcreate(path_.c_str(), H5F_ACC_TRUNC, H5P_DEFAULT, H5P_DEFAULT);
  const hsize_t dims[] = {200, 200, 200};
  const hsize_t chunk[] = {1, 1, 1};
  const hid_t space = H5Screate_simple(3, dims, nullptr);
  const hid_t properties = H5Pcreate(H5P_DATASET_CREATE);
  H5Pset_chunk(properties, 3, chunk);
  H5Dclose(H5Dcreate2(file, "v", H5T_STD_U8LE, space, H5P_DEFAULT, properties, H5P_DEFAULT));
  H5Pclose(properties);
  H5Sclose(space);
  H5Fclose(file);
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(const auto source, OpenVolumeFile(path_));
  char sample = 0;
  EXPECT_THAT(
      source->ReadBox({.begin = {0, 0, 0}, .end = {1, 1, 1}}, &sample, base::Cancellation()),
      StatusIs(absl::StatusCode::kInvalidArgument,
               AllOf(HasSubstr("200 x 200 x 200 chunks; expected at most 4194304"),
                     HasSubstr("h5repack -l /v:CHUNK=64x64x64"))));
}

TEST_F(DamagedHdf5BoxesTest, AChunkOutsideOfTheFile) {
  for (const std::uint64_t address :
       {std::uint64_t{1} << 20, std::uint64_t{1} << 62, ~std::uint64_t{0} - 1}) {
    Write(true);
    PutKey(static_cast<std::uint32_t>(size_), address);
    EXPECT_THAT(ErrorOfBox(), StatusIs(absl::StatusCode::kDataLoss,
                                       AllOf(HasSubstr("v.h5:/v"), HasSubstr("damaged"))));
  }
}

TEST_F(DamagedHdf5BoxesTest, AChunkOfAnotherSize) {
  for (const bool has_gzip : {false, true}) {
    for (const std::uint32_t size : {1U, 17U, 1U << 30, 0xffffffffU}) {
      SCOPED_TRACE(absl::StrCat(has_gzip, " ", size));
      Write(has_gzip);
      PutKey(size, address_);
      if (has_gzip) {  // without filters the library takes no size from the index
        EXPECT_THAT(ErrorOfBox(), StatusIs(absl::StatusCode::kDataLoss, HasSubstr("v.h5:/v")));
      }
    }
  }
}

TEST_F(DamagedHdf5BoxesTest, BytesThatAreNoStream) {
  Write(true);
  std::string bytes = testing::ReadFile(path_);
  bytes.replace(address_ + 2, 8, "isoscope");
  testing::WriteFile(path_, bytes);
  EXPECT_THAT(ErrorOfBox(), StatusIs(absl::StatusCode::kDataLoss,
                                     AllOf(HasSubstr("v.h5:/v"), HasSubstr("chunk (0, 0, 0)"))));
}

TEST_F(DamagedHdf5BoxesTest, ChunksThatShareBytesAreWhatTheLibraryReads) {
  Write(false);
  // The second chunk gets the address of the first one.
  const std::string second = KeyOf(static_cast<std::uint32_t>(size_), {0, 0, 7}, address_ + size_);
  Replace(path_, second, KeyOf(static_cast<std::uint32_t>(size_), {0, 0, 7}, address_));
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(const auto source, OpenVolumeFile(path_));
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(const std::string rows, testing::ReadAll(*source, 17));
  EXPECT_EQ(rows.substr(0, 14), rows.substr(14, 14));
  ExpectBoxes(*source, rows);
}

TEST_F(DamagedHdf5BoxesTest, FlippedBytesAreErrorsOrTheRowsOfTheLibrary) {
  Write(true);
  const std::string whole = testing::ReadFile(path_);
  std::uint32_t state = 7;
  int errors = 0;
  for (int i = 0; i < 60; ++i) {
    std::string bytes = whole;
    for (int flips = 0; flips < 3; ++flips) {
      state = state * 1664525U + 1013904223U;
      bytes[(state >> 8) % bytes.size()] ^= static_cast<char>(1U << (state & 7U));
    }
    testing::WriteFile(path_, bytes);
    const auto source = OpenVolumeFile(path_);
    if (!source.ok()) {
      continue;
    }
    const auto& dims = (*source)->info().geometry.sample_dims;
    if (math::Volume(dims) > (1 << 20) || !(*source)->box_grid().has_value()) {
      continue;
    }
    const auto rows = testing::ReadAll(**source, dims.z);
    std::string box(static_cast<std::size_t>(dims.z * dims.y * (*source)->info().row_bytes()), '?');
    const absl::Status status =
        (*source)->ReadBox({.begin = {0, 0, 0}, .end = dims}, box.data(), base::Cancellation());
    if (rows.ok() && status.ok()) {
      EXPECT_TRUE(box == *rows);
    } else {
      EXPECT_FALSE(status.ok());  // what rows can't read, boxes can't
      ++errors;
    }
  }
  EXPECT_GT(errors, 0);
}

}  // namespace
}  // namespace isoscope::source
