#include "core/formats/vtk/vti_data.h"

#include <algorithm>
#include <memory>
#include <string>
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
  header_.compressor = "vtkLZ4DataCompressor";
  EXPECT_THAT(OpenText(text, 5).status(),
              StatusIs(absl::StatusCode::kInvalidArgument, HasSubstr("vtkLZ4DataCompressor")));
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

}  // namespace
}  // namespace isoscope::source
