// VTK ImageData files, written here in every way that VTK has:
//
// - appended and inline data, raw and base64, plain and in zlib blocks, both sizes of headers;
// - points and cells, components, choice of an array, geometry;
// - sizes beyond 4 GiB, and long tuples in bounded memory;
// - cut and flipped files, and everything that is not supported.

#include "core/formats/vtk/vti_source.h"

#include <filesystem>
#include <fstream>
#include <memory>
#include <string>

#include "absl/strings/escaping.h"
#include "absl/strings/str_cat.h"
#include "gmock/gmock.h"
#include "gtest/gtest.h"

#include "core/base/cancellation.h"
#include "core/base/coding.h"
#include "core/formats/open_volume.h"
#include "tests/support/only_volume.h"
#include "tests/support/status_matchers.h"
#include "tests/support/temp_dir.h"
#include "tests/support/volume_files.h"

namespace isoscope::source {
namespace {

using ::isoscope::testing::Deflate;
using ::isoscope::testing::Noise;
using ::isoscope::testing::ReadAll;
using ::isoscope::testing::StatusIs;
using ::isoscope::testing::Swapped;
using ::isoscope::testing::TempDir;
using ::isoscope::testing::WriteFile;
using ::testing::_;
using ::testing::HasSubstr;
using volume::ScalarType;

constexpr math::Index3 kDims{13, 7, 9};

struct Vti {
  std::string type = "Int16";
  std::size_t sample_size = 2;
  bool is_appended = true;
  bool is_base64 = false;  // of appended data; inline data always is
  bool is_compressed = false;
  bool is_big_endian = false;
  bool has_long_header = false;  // UInt64
  std::size_t block_bytes = 500;
  std::string image = "WholeExtent=\"0 12 0 6 0 8\"";
  std::string extent = "0 12 0 6 0 8";
};

std::string Lengths(const Vti& vti, const std::vector<std::uint64_t>& values) {
  std::string bytes;
  for (const std::uint64_t value : values) {
    if (vti.has_long_header) {
      base::AppendLittleEndian(value, &bytes);
    } else {
      base::AppendLittleEndian(static_cast<std::uint32_t>(value), &bytes);
    }
  }
  return vti.is_big_endian ? Swapped(bytes, vti.has_long_header ? 8 : 4) : bytes;
}

// An array as it stands in the file.
std::string Encoded(const Vti& vti, const std::string& little) {
  const bool is_text = !vti.is_appended || vti.is_base64;
  const auto encode = [&](const std::string& bytes) {
    return is_text ? absl::Base64Escape(bytes) : bytes;
  };
  const std::string samples = vti.is_big_endian ? Swapped(little, vti.sample_size) : little;
  if (!vti.is_compressed) {
    return encode(Lengths(vti, {samples.size()}) + samples);
  }
  std::string blocks;
  std::vector<std::uint64_t> lengths = {(samples.size() + vti.block_bytes - 1) / vti.block_bytes,
                                        vti.block_bytes, samples.size() % vti.block_bytes};
  for (std::size_t at = 0; at < samples.size(); at += vti.block_bytes) {
    const std::string block = Deflate(samples.substr(at, vti.block_bytes), 15);
    lengths.push_back(block.size());
    blocks += block;
  }
  return encode(Lengths(vti, lengths)) + encode(blocks);
}

std::string Head(const Vti& vti) {
  return absl::StrCat(
      "<?xml version=\"1.0\"?>\n<VTKFile type=\"ImageData\" version=\"1.0\" byte_order=\"",
      vti.is_big_endian ? "BigEndian" : "LittleEndian", "\"",
      vti.has_long_header ? " header_type=\"UInt64\"" : "",
      vti.is_compressed ? " compressor=\"vtkZLibDataCompressor\"" : "", ">\n<ImageData ", vti.image,
      ">\n<Piece Extent=\"", vti.extent, "\">\n<PointData Scalars=\"density\">\n");
}

// Two arrays, of which "density" is the one; the other comes first.
std::string FileBytes(const Vti& vti, const std::string& samples) {
  const std::string other = Encoded(vti, std::string(40, 'x'));
  const std::string data = Encoded(vti, samples);
  const auto array = [&](const char* name, std::size_t offset, const std::string& text) {
    return absl::StrCat("<DataArray type=\"", vti.type, "\" Name=\"", name, "\" format=\"",
                        vti.is_appended ? "appended" : "binary", "\"",
                        vti.is_appended ? absl::StrCat(" offset=\"", offset, "\"") : "", ">\n  ",
                        vti.is_appended ? "" : text, "\n</DataArray>\n");
  };
  return absl::StrCat(
      Head(vti), array("other", 0, other), array("density", other.size(), data),
      "</PointData><CellData/></Piece></ImageData>\n",
      vti.is_appended ? absl::StrCat("<AppendedData encoding=\"", vti.is_base64 ? "base64" : "raw",
                                     "\">\n   _", other, data, "\n</AppendedData>\n")
                      : "",
      "</VTKFile>\n");
}

// A box of [z][y][x] samples.
std::string CutOf(const std::string& samples, const math::Index3& dims, std::size_t size,
                  const math::IndexBox& box) {
  std::string cut;
  for (std::int64_t z = box.begin.z; z < box.end.z; ++z) {
    for (std::int64_t y = box.begin.y; y < box.end.y; ++y) {
      const auto at = static_cast<std::size_t>((z * dims.y + y) * dims.x + box.begin.x);
      cut += samples.substr(at * size, static_cast<std::size_t>(box.dims().x) * size);
    }
  }
  return cut;
}

// Boxes of a source of int16 are those of its samples, and its grid has some.
void ExpectBoxesOf(const VolumeSource& source, const std::string& samples) {
  const math::Index3& dims = source.info().geometry.sample_dims;
  ASSERT_TRUE(source.box_grid().has_value());
  for (const math::IndexBox& box :
       {math::IndexBox{{0, 0, 0}, dims}, math::IndexBox{{2, 1, 3}, {3, 5, 7}},
        math::IndexBox{{0, 2, 1}, {dims.x, 4, 3}}, math::IndexBox{{5, 0, 7}, {11, 6, 8}}}) {
    const std::string expected = CutOf(samples, dims, 2, box);
    std::string found(expected.size(), '\0');
    ISOSCOPE_ASSERT_OK(source.ReadBox(box, found.data(), base::Cancellation()));
    EXPECT_TRUE(found == expected) << box.begin.x;
  }
}

class VtiSourceTest : public ::testing::Test {
 protected:
  absl::StatusOr<std::unique_ptr<VolumeSource>> Open(const std::string& bytes) {
    WriteFile(dir_.Sub("v.vti"), bytes);
    return OpenVolumeFile(dir_.Sub("v.vti") + ":density");
  }
  TempDir dir_;
};

TEST_F(VtiSourceTest, EveryWayToStoreAnArrayComesBackExactly) {
  const std::string samples = Noise(kDims, ScalarType::kInt16);
  for (int mask = 0; mask < 32; ++mask) {
    Vti vti;
    vti.is_appended = (mask & 1) != 0;
    vti.is_base64 = (mask & 2) != 0;
    vti.is_compressed = (mask & 4) != 0;
    vti.is_big_endian = (mask & 8) != 0;
    vti.has_long_header = (mask & 16) != 0;
    SCOPED_TRACE(mask);
    ISOSCOPE_ASSERT_OK_AND_ASSIGN(const auto source, Open(FileBytes(vti, samples)));
    EXPECT_EQ(source->info().geometry.sample_dims, kDims);
    EXPECT_EQ(source->info().type, ScalarType::kInt16);
    for (const std::int64_t planes : {1, 2, 9}) {
      ISOSCOPE_ASSERT_OK_AND_ASSIGN(const std::string read, ReadAll(*source, planes));
      EXPECT_TRUE(read == samples);
    }
    for (std::int64_t begin = 60; begin >= 0; begin -= 7) {  // backwards, within planes
      std::string rows(3 * 26, '\0');
      ISOSCOPE_ASSERT_OK(source->ReadRows(begin, begin + 3, rows.data()));
      EXPECT_TRUE(rows == samples.substr(static_cast<std::size_t>(begin) * 26, 3 * 26));
    }
    ExpectBoxesOf(*source, samples);
  }
}

TEST_F(VtiSourceTest, EveryTypeIsKnownAndOthersAreRefused) {
  const struct {
    const char* name;
    ScalarType type;
  } rows[] = {{"UInt8", ScalarType::kUint8},     {"Int8", ScalarType::kInt8},
              {"UInt16", ScalarType::kUint16},   {"Int16", ScalarType::kInt16},
              {"UInt32", ScalarType::kUint32},   {"Int32", ScalarType::kInt32},
              {"Float32", ScalarType::kFloat32}, {"Float64", ScalarType::kFloat64}};
  for (const auto& row : rows) {
    Vti vti;
    vti.type = row.name;
    vti.sample_size = volume::SizeOf(row.type);
    vti.is_big_endian = true;
    vti.is_compressed = true;
    const std::string samples = Noise(kDims, row.type);
    ISOSCOPE_ASSERT_OK_AND_ASSIGN(const auto source, Open(FileBytes(vti, samples)));
    EXPECT_EQ(source->info().type, row.type);
    ISOSCOPE_ASSERT_OK_AND_ASSIGN(const std::string read, ReadAll(*source, 4));
    EXPECT_TRUE(read == samples) << row.name;
  }
  Vti vti;
  vti.type = "Int64";
  std::string wide(static_cast<std::size_t>(math::Volume(kDims)) * 8, '\0');
  wide[8] = '\x2a';
  WriteFile(dir_.Sub("w.vti"), FileBytes(vti, wide));
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(const auto integers,
                                OpenVolumeFile(dir_.Sub("w.vti") + ":density"));
  EXPECT_EQ(integers->info().type, ScalarType::kFloat64);
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(const std::string values, ReadAll(*integers, 4));
  EXPECT_EQ(values.substr(8, 8), std::string("\0\0\0\0\0\0\x45\x40", 8));  // 42.0
  vti.type = "Int128";
  EXPECT_THAT(Open(FileBytes(vti, "")).status(),
              StatusIs(absl::StatusCode::kInvalidArgument, HasSubstr("\"Int128\"")));
}

TEST_F(VtiSourceTest, GeometryIsThatOfTheFile) {
  Vti vti;
  vti.extent = "2 14 -1 5 0 8";
  vti.image =
      "WholeExtent=\"2 14 -1 5 0 8\" Origin=\"10 20 30\" Spacing=\"0.5 2 4\" Direction=\"0 -1 0 1 "
      "0 "
      "0 0 0 1\"";
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(const auto source,
                                Open(FileBytes(vti, Noise(kDims, ScalarType::kInt16))));
  const volume::GridGeometry& geometry = source->info().geometry;
  EXPECT_EQ(geometry.sample_dims, kDims);
  EXPECT_EQ(geometry.spacing, (math::Vec3d{0.5, 2, 4}));
  EXPECT_EQ(geometry.direction.columns[0], (math::Vec3d{0, 1, 0}));
  EXPECT_EQ(geometry.direction.columns[1], (math::Vec3d{-1, 0, 0}));
  // Index (2, -1, 0): 10 - (-1) * 2 along -x, 20 + 2 * 0.5 along y.
  EXPECT_EQ(geometry.origin, (math::Vec3d{12, 21, 30}));
}

TEST_F(VtiSourceTest, CellsAndComponentsComeBackExactly) {
  // 12 x 6 x 8 cells, and tuples of three: the sizes of the points' array do not fit.
  const math::Index3 cells{12, 6, 8};
  const std::string samples[3] = {Noise(cells, ScalarType::kInt16),
                                  Swapped(Noise(cells, ScalarType::kInt16), 2),
                                  Swapped(Noise(cells, ScalarType::kInt16), 4)};
  std::string tuples;
  for (std::size_t at = 0; at < samples[0].size(); at += 2) {
    for (const std::string& component : samples) {
      tuples += component.substr(at, 2);
    }
  }
  for (int mask = 0; mask < 16; ++mask) {
    Vti vti;
    vti.is_appended = (mask & 1) != 0;
    vti.is_base64 = (mask & 2) != 0;
    vti.is_compressed = (mask & 4) != 0;
    vti.is_big_endian = (mask & 8) != 0;
    SCOPED_TRACE(mask);
    std::string bytes = FileBytes(vti, tuples);
    bytes.replace(bytes.find("<PointData Scalars=\"density\">"), 30, "<CellData>");
    bytes.replace(bytes.find("</PointData><CellData/>"), 23, "</CellData><PointData/>");
    bytes.replace(bytes.find("Name=\"density\""), 14, "Name=\"u\" NumberOfComponents=\"3\"");
    WriteFile(dir_.Sub("v.vti"), bytes);
    for (int component = 0; component < 3; ++component) {
      const std::string path = absl::StrCat(dir_.Sub("v.vti"), ":u:", component);
      ISOSCOPE_ASSERT_OK_AND_ASSIGN(const auto source, OpenVolumeFile(path));
      ExpectBoxesOf(*source, samples[component]);
      EXPECT_EQ(source->info().name, path);
      EXPECT_EQ(source->info().geometry.sample_dims, cells);
      EXPECT_EQ(source->info().geometry.origin, (math::Vec3d{0.5, 0.5, 0.5}));
      for (const std::int64_t planes : {1, 3, 8}) {
        ISOSCOPE_ASSERT_OK_AND_ASSIGN(const std::string read, ReadAll(*source, planes));
        EXPECT_TRUE(read == samples[component]);
      }
      ISOSCOPE_ASSERT_OK_AND_ASSIGN(const auto files, FilesOfVolume(path));
      EXPECT_EQ(files, std::vector<std::string>{dir_.Sub("v.vti")});
    }
    EXPECT_THAT(OpenVolumeFile(dir_.Sub("v.vti:u")).status(),
                StatusIs(absl::StatusCode::kInvalidArgument, HasSubstr("u (x, y, z)")));
  }
}

TEST_F(VtiSourceTest, LongTuplesAreReadInBoundedMemory) {
  // 4096 components of 8 bytes: 32 KiB a tuple, of 27 tuples.
  constexpr std::size_t kComponents = 4096;
  std::string tuples(27 * kComponents * 8, '\0');
  std::string expected;
  for (std::size_t i = 0; i < 27; ++i) {
    const std::string value = absl::StrCat("value", 100 + i);
    tuples.replace((i * kComponents + 4095) * 8, 8, value);
    expected += value;
  }
  Vti vti;
  vti.type = "Float64";
  vti.sample_size = 8;
  vti.image = "WholeExtent=\"0 2 0 2 0 2\"";
  vti.extent = "0 2 0 2 0 2";
  std::string bytes = FileBytes(vti, tuples);
  bytes.replace(bytes.find("Name=\"density\""), 14, "Name=\"u\" NumberOfComponents=\"4096\"");
  WriteFile(dir_.Sub("v.vti"), bytes);
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(const auto source, OpenVolumeFile(dir_.Sub("v.vti:u:4095")));
  EXPECT_LT(source->info().memory_bytes, 128 << 10);
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(const std::string read, ReadAll(*source, 3));
  EXPECT_TRUE(read == expected);
}

TEST_F(VtiSourceTest, AnArrayIsChosenByItsName) {
  const std::string samples = Noise(kDims, ScalarType::kInt16);
  std::string bytes = FileBytes(Vti{}, samples);
  WriteFile(dir_.Sub("v.vti"), bytes);
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(const auto source, OpenVolumeFile(dir_.Sub("v.vti:density")));
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(const std::string read, ReadAll(*source, 2));
  EXPECT_TRUE(read == samples);
  EXPECT_THAT(OpenVolumeFile(dir_.Sub("v.vti:other")).status(),
              StatusIs(absl::StatusCode::kInvalidArgument, HasSubstr("array \"other\"")));
  EXPECT_THAT(OpenVolumeFile(dir_.Sub("v.vti:none")).status(),
              StatusIs(absl::StatusCode::kNotFound, HasSubstr("\"density\"")));
  EXPECT_THAT(OpenVolumeFile(dir_.Sub("none.vti:density")).status(),
              StatusIs(absl::StatusCode::kNotFound, HasSubstr("none.vti: no such file")));
}

TEST_F(VtiSourceTest, SamplesBeyond4GiBAreFound) {
  // 5 G samples of a sparse file; its 32-bit header wraps as VTK's does.
  Vti vti;
  vti.type = "UInt8";
  vti.sample_size = 1;
  vti.image = "WholeExtent=\"0 2047 0 2047 0 1249\"";
  vti.extent = "0 2047 0 2047 0 1249";
  const std::int64_t count = std::int64_t{2048} * 2048 * 1250;
  const std::string head =
      absl::StrCat(Head(vti),
                   "<DataArray type=\"UInt8\" Name=\"density\" format=\"appended\" offset=\"0\"/>"
                   "</PointData></Piece></ImageData><AppendedData encoding=\"raw\">_") +
      Lengths(vti, {static_cast<std::uint64_t>(count)});
  WriteFile(dir_.Sub("v.vti"), head);
  std::filesystem::resize_file(dir_.Sub("v.vti"), head.size() + static_cast<std::uintmax_t>(count));
  {
    std::fstream file(dir_.Sub("v.vti"), std::ios::in | std::ios::out | std::ios::binary);
    file.seekp(static_cast<std::streamoff>(head.size()) + count - 4);
    file << "last";
  }
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(const auto source, OpenVolumeFile(dir_.Sub("v.vti")));
  std::string row(2048, '\0');
  ISOSCOPE_ASSERT_OK(source->ReadRows(2048 * 1250 - 1, 2048 * 1250, row.data()));
  EXPECT_EQ(row.substr(2044), "last");
}

TEST_F(VtiSourceTest, CutFilesAreRefusedAtEveryLength) {
  const std::string samples = Noise({4, 3, 2}, ScalarType::kInt16);
  for (int mask = 0; mask < 8; ++mask) {
    Vti vti;
    vti.is_appended = (mask & 1) != 0;
    vti.is_base64 = (mask & 2) != 0;
    vti.is_compressed = (mask & 4) != 0;
    vti.block_bytes = 20;
    vti.image = "WholeExtent=\"0 3 0 2 0 1\"";
    vti.extent = "0 3 0 2 0 1";
    const std::string whole = FileBytes(vti, samples);
    const std::size_t end = whole.find(Encoded(vti, samples)) + Encoded(vti, samples).size();
    const auto is_read = [&](std::size_t size) {
      const auto source = Open(whole.substr(0, size));
      return source.ok() && ReadAll(**source, 1).ok();
    };
    EXPECT_TRUE(is_read(whole.size())) << mask;
    // The tags behind inline samples are read, too.
    const std::size_t first_whole = vti.is_appended ? end : whole.size();
    for (std::size_t size = 0; size < end; ++size) {
      EXPECT_FALSE(is_read(size)) << mask << ": " << size << " of " << whole.size();
    }
    EXPECT_TRUE(is_read(first_whole)) << mask;
  }
}

TEST_F(VtiSourceTest, FlippedBitsNeverCrash) {
  const std::string samples = Noise({4, 3, 2}, ScalarType::kInt16);
  for (const bool is_base64 : {false, true}) {
    Vti vti;
    vti.is_base64 = is_base64;
    vti.is_compressed = true;
    vti.block_bytes = 20;
    vti.image = "WholeExtent=\"0 3 0 2 0 1\"";
    vti.extent = "0 3 0 2 0 1";
    const std::string whole = FileBytes(vti, samples);
    for (std::size_t at = 0; at < whole.size(); ++at) {
      std::string flipped = whole;
      flipped[at] = static_cast<char>(flipped[at] ^ (1 << at % 8));
      const auto source = Open(flipped);
      if (source.ok()) {
        ReadAll(**source, 1).status().IgnoreError();
      }
    }
  }
}

TEST_F(VtiSourceTest, TextIsReadAsTheTypeThatTheTagSays) {
  Vti vti{.type = "UInt8", .image = "WholeExtent=\"0 1 0 1 0 1\"", .extent = "0 1 0 1 0 1"};
  const auto bytes = [&](const char* format, const char* text) {
    return absl::StrCat(Head(vti), "<DataArray type=\"", vti.type, "\" Name=\"density\" format=\"",
                        format, "\">", text,
                        "</DataArray></PointData></Piece></ImageData></VTKFile>");
  };
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(const auto source, Open(bytes("ascii", "\n 1 2 3 4 5 6 7 255")));
  EXPECT_EQ(source->info().type, ScalarType::kUint8);
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(const std::string read, ReadAll(*source, 1));
  EXPECT_EQ(read, "\1\2\3\4\5\6\7\xff");
  for (const char* text : {"1 2 3 4 5 6 7", "1 2 3 4 5 6 7 256", "1 2 3 4 5 6 7 a", ""}) {
    const auto bad = Open(bytes("ascii", text));
    EXPECT_FALSE(bad.ok() && ReadAll(**bad, 1).ok()) << text;
  }
}

TEST_F(VtiSourceTest, WhatIsNotSupportedIsRefusedWithASentence) {
  const std::string samples = Noise(kDims, ScalarType::kInt16);
  const auto expect = [&](const std::string& from, const std::string& to, const char* what) {
    std::string bytes = FileBytes(Vti{}, samples);
    const std::size_t at = bytes.find(from);
    ASSERT_NE(at, std::string::npos) << from;
    bytes.replace(at, from.size(), to);
    EXPECT_THAT(Open(bytes).status(),
                StatusIs(absl::StatusCode::kInvalidArgument, HasSubstr(what)));
  };
  expect("Name=\"density\" format=\"appended\"", "Name=\"density\" format=\"hex\"", "hex");
  expect("byte_order", "compressor=\"vtkBloscDataCompressor\" byte_order",
         "vtkBloscDataCompressor");
  expect("Piece Extent=\"0 12 0 6 0 8\"", "Piece Extent=\"0 12 0 6 0 4\"", "one piece");
  expect("WholeExtent=\"0 12", "WholeExtent=\"0 x", "6 numbers");
  expect("ImageData ", "RectilinearGrid ", "line");
  expect("encoding=\"raw\"", "encoding=\"hex\"", "hex");
  EXPECT_THAT(Open("no xml").status(), StatusIs(absl::StatusCode::kInvalidArgument, _));
}

}  // namespace
}  // namespace isoscope::source
