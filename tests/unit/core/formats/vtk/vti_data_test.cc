#include "core/formats/vtk/vti_data.h"

#include <lz4.h>
#include <lzma.h>

#include <algorithm>
#include <cstdint>
#include <memory>
#include <string>
#include <utility>
#include <vector>

#include "absl/strings/escaping.h"
#include "absl/strings/str_cat.h"
#include "gmock/gmock.h"
#include "gtest/gtest.h"

#include "core/base/coding.h"
#include "tests/support/status_matchers.h"
#include "tests/support/temp_dir.h"
#include "tests/support/volume_files.h"

namespace isoscope::source {
namespace {

using ::isoscope::testing::Deflate;
using ::isoscope::testing::Noise;
using ::isoscope::testing::StatusIs;
using ::isoscope::testing::TempDir;
using ::isoscope::testing::WriteFile;
using ::testing::AllOf;
using ::testing::HasSubstr;

std::string Sizes(const std::vector<std::uint32_t>& values) {
  std::string bytes;
  for (const std::uint32_t value : values) {
    base::AppendLittleEndian(value, &bytes);
  }
  return bytes;
}

class VtiDataTest : public ::testing::Test {
 protected:
  // An inline array of such text, with line feeds before and a tag behind it.
  absl::StatusOr<std::unique_ptr<VtiData>> OpenText(const std::string& text, std::size_t size) {
    WriteFile(dir_.Sub("v.vti"), absl::StrCat("head\n  ", text, "\n</DataArray>"));
    auto file = io::OpenRandomAccessFile(dir_.Sub("v.vti"));
    if (!file.ok()) {
      return file.status();
    }
    file_ = *std::move(file);
    array_.name = "a";
    array_.format = "binary";
    array_.inline_start = 4;
    return OpenVtiData(*file_, header_, array_, static_cast<std::int64_t>(size));
  }
  static std::string ReadOf(VtiData& data, std::size_t offset, std::size_t size) {
    std::string bytes(size, '\0');
    const absl::Status status = data.ReadAt(static_cast<std::int64_t>(offset), size, bytes.data());
    return status.ok() ? bytes : status.ToString();
  }

  TempDir dir_;
  std::unique_ptr<io::RandomAccessFile> file_;
  VtiHeader header_;
  VtiArray array_;
  const std::string samples_ = Noise({50, 41, 20}, volume::ScalarType::kUint8);  // 41 000
};

TEST_F(VtiDataTest, KnownText) {
  // Size 5, "abcde".
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(const auto data, OpenText("BQAAAGFiY2Rl", 5));
  EXPECT_EQ(ReadOf(*data, 0, 5), "abcde");
  EXPECT_EQ(ReadOf(*data, 3, 2), "de");
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(const auto padded, OpenText("BAAAAGFiY2Q=", 4));
  EXPECT_EQ(ReadOf(*padded, 0, 4), "abcd");
}

TEST_F(VtiDataTest, AnyPartOfLongTextIsTheSame) {
  const std::string plain =
      absl::Base64Escape(Sizes({static_cast<std::uint32_t>(samples_.size())}) + samples_);
  std::string blocks;
  std::vector<std::uint32_t> sizes{5, 9000, 5000};
  for (std::size_t at = 0; at < samples_.size(); at += 9000) {
    const std::string block = Deflate(samples_.substr(at, 9000), 15);
    sizes.push_back(static_cast<std::uint32_t>(block.size()));
    blocks += block;
  }
  const std::string packed = absl::Base64Escape(Sizes(sizes)) + absl::Base64Escape(blocks);
  for (const bool is_packed : {false, true}) {
    header_.compressor = is_packed ? "vtkZLibDataCompressor" : "";
    ISOSCOPE_ASSERT_OK_AND_ASSIGN(const auto data,
                                  OpenText(is_packed ? packed : plain, samples_.size()));
    EXPECT_LT(data->memory_bytes(), 64 << 10);
    // Around the portions that are decoded at once, 12 KiB, and the blocks.
    for (const std::size_t offset :
         {0u, 1u, 2u, 3u, 8999u, 9000u, 12283u, 12284u, 12285u, 24575u, 36000u}) {
      for (const std::size_t size : {1u, 2u, 3u, 4u, 5u, 100u, 12288u, 12289u, 40999u}) {
        const std::size_t count = std::min(size, samples_.size() - offset);
        EXPECT_TRUE(ReadOf(*data, offset, count) == samples_.substr(offset, count))
            << offset << " " << count;
      }
    }
  }
}

TEST_F(VtiDataTest, WhatIsNoBase64IsDataLoss) {
  const std::string text =
      absl::Base64Escape(Sizes({static_cast<std::uint32_t>(samples_.size())}) + samples_);
  for (const char bad : {'\n', ' ', '=', '-', '!', '<', '\0'}) {
    for (const std::size_t at : {20u, 16383u, 16384u, 30000u}) {
      std::string damaged = text;
      damaged[at] = bad;
      ISOSCOPE_ASSERT_OK_AND_ASSIGN(const auto data, OpenText(damaged, samples_.size()));
      EXPECT_THAT(ReadOf(*data, 0, samples_.size()),
                  AllOf(HasSubstr("DATA_LOSS"), HasSubstr("no base64 text")))
          << at;
    }
  }
}

TEST_F(VtiDataTest, SizesThatDoNotFitNameTheArray) {
  const std::string text = absl::Base64Escape(Sizes({5}) + "abcde");
  EXPECT_THAT(
      OpenText(text, 6).status(),
      StatusIs(absl::StatusCode::kInvalidArgument,
               AllOf(HasSubstr("array \"a\""), HasSubstr("need 6 bytes, the array says 5"))));
  header_.compressor = "vtkFooDataCompressor";
  EXPECT_THAT(OpenText(text, 5).status(),
              StatusIs(absl::StatusCode::kInvalidArgument, HasSubstr("vtkFooDataCompressor")));
  header_.compressor = "vtkZLibDataCompressor";
  for (const std::vector<std::uint32_t>& sizes : {std::vector<std::uint32_t>{0, 5, 0, 5},
                                                  {0xffffffff, 5, 0, 5},
                                                  {1, 0, 0, 5},
                                                  {1, 5, 6, 5},
                                                  {1, 5, 0, 0},
                                                  {1, 5, 0, 0xffffffff},
                                                  {1, 6, 0, 5}}) {
    EXPECT_THAT(OpenText(absl::Base64Escape(Sizes(sizes)) + "YWJjZGU=", 5).status(),
                StatusIs(absl::StatusCode::kInvalidArgument, HasSubstr("array \"a\"")));
  }
}

std::string Lz4(const std::string& bytes) {
  std::string out(static_cast<std::size_t>(LZ4_compressBound(static_cast<int>(bytes.size()))),
                  '\0');
  out.resize(static_cast<std::size_t>(LZ4_compress_default(
      bytes.data(), out.data(), static_cast<int>(bytes.size()), static_cast<int>(out.size()))));
  return out;
}

std::string Lzma(const std::string& bytes, std::uint32_t preset = 5) {
  std::string out(lzma_stream_buffer_bound(bytes.size()), '\0');
  std::size_t size = 0;
  EXPECT_EQ(
      lzma_easy_buffer_encode(preset, LZMA_CHECK_CRC32, nullptr,
                              reinterpret_cast<const std::uint8_t*>(bytes.data()), bytes.size(),
                              reinterpret_cast<std::uint8_t*>(out.data()), &size, out.size()),
      LZMA_OK);
  out.resize(size);
  return out;
}

TEST_F(VtiDataTest, EachCompressorGivesTheSameBytesOrAnError) {
  const std::string samples = samples_.substr(0, 20'000) + std::string(21'000, 'z');
  const std::vector<std::pair<const char*, std::string (*)(const std::string&)>> compressors = {
      {"vtkZLibDataCompressor", [](const std::string& b) { return Deflate(b, 15); }},
      {"vtkLZ4DataCompressor", Lz4},
      {"vtkLZMADataCompressor", [](const std::string& b) { return Lzma(b); }},
      {"vtkLZMADataCompressor", [](const std::string& b) { return Lzma(b, 9); }}};
  for (const auto& [name, compress] : compressors) {
    header_.compressor = name;
    std::vector<std::string> blocks;
    for (std::size_t at = 0; at < samples.size(); at += 9000) {
      blocks.push_back(compress(samples.substr(at, 9000)));
    }
    const auto text_of = [&](const std::vector<std::string>& all) {
      std::vector<std::uint32_t> sizes{5, 9000, 5000};
      std::string bytes;
      for (const std::string& block : all) {
        sizes.push_back(static_cast<std::uint32_t>(block.size()));
        bytes += block;
      }
      return absl::Base64Escape(Sizes(sizes)) + absl::Base64Escape(bytes);
    };
    ISOSCOPE_ASSERT_OK_AND_ASSIGN(const auto data, OpenText(text_of(blocks), samples.size()));
    EXPECT_TRUE(ReadOf(*data, 0, samples.size()) == samples) << name;
    EXPECT_TRUE(ReadOf(*data, 17'990, 50) == samples.substr(17'990, 50)) << name;
    // A block of fewer bytes, of more, cut, and of another compressor.
    const std::string whole = blocks[1];
    for (const std::string& bad :
         {compress(samples.substr(9000, 8999)), compress(samples.substr(9000, 9001)),
          whole.substr(0, whole.size() / 2), std::string(100, '\xff'), std::string("x")}) {
      blocks[1] = bad;
      ISOSCOPE_ASSERT_OK_AND_ASSIGN(const auto damaged, OpenText(text_of(blocks), samples.size()));
      EXPECT_THAT(ReadOf(*damaged, 9000, 1),
                  AllOf(HasSubstr("DATA_LOSS"), HasSubstr("block 1 of 5 is damaged")))
          << name;
      EXPECT_TRUE(ReadOf(*damaged, 0, 9000) == samples.substr(0, 9000)) << name;
    }
  }
}

}  // namespace
}  // namespace isoscope::source
