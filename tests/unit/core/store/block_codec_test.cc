#include "core/store/block_codec.h"

#include <zstd.h>

#include <cmath>
#include <cstdint>
#include <string>
#include <vector>

#include "gmock/gmock.h"
#include "gtest/gtest.h"

#include "core/base/random.h"
#include "tests/support/status_matchers.h"

namespace isoscope::store {
namespace {

using ::isoscope::testing::StatusIs;
using ::testing::HasSubstr;

constexpr BlockEncoding kCompressed[] = {BlockEncoding::kLz4, BlockEncoding::kZstd,
                                         BlockEncoding::kPacked};

// One row.
math::Index3 RowOf(std::size_t count) { return {static_cast<std::int64_t>(count), 1, 1}; }

bool MayBe(BlockEncoding encoding, BlockEncoding wanted) {
  return encoding == wanted || encoding == BlockEncoding::kRaw ||
         (wanted == BlockEncoding::kPacked && encoding == BlockEncoding::kLz4);
}

// A smooth field in `count` samples of `type`.
std::string SmoothSamples(volume::ScalarType type, std::size_t count) {
  const std::size_t width = volume::SizeOf(type);
  std::string bytes(count * width, '\0');
  for (std::size_t i = 0; i < count; ++i) {
    const double wave = 1.0 + std::sin(0.01 * static_cast<double>(i));
    auto value = static_cast<std::uint64_t>((width == 1 ? 20.0 : 900.0) * wave);
    for (std::size_t byte = 0; byte < width; ++byte, value >>= 8) {
      bytes[i * width + byte] = static_cast<char>(value & 0xff);
    }
  }
  return bytes;
}

std::string NoiseSamples(std::size_t size) {
  std::string bytes(size, '\0');
  for (std::size_t i = 0; i < size; ++i) {
    bytes[i] = static_cast<char>(base::RandomBits(3, i));
  }
  return bytes;
}

// Decodes from and into buffers of exactly the right size, so that a sanitizer sees reads and
// writes beyond them.
absl::StatusOr<std::string> Decode(BlockEncoding encoding, volume::ScalarType type,
                                   const math::Index3& dims, const std::string& stored) {
  const std::vector<char> in(stored.begin(), stored.end());
  std::vector<char> out(static_cast<std::size_t>(math::Volume(dims)) * volume::SizeOf(type));
  std::string scratch;
  const absl::Status status =
      DecodeBlock(encoding, type, dims, {in.data(), in.size()}, &scratch, out.data());
  if (!status.ok()) {
    return status;
  }
  return std::string(out.begin(), out.end());
}

TEST(BlockCodecTest, EveryTypeSizeAndContentComesBack) {
  for (int type_number = 1; type_number <= 8; ++type_number) {
    const auto type = static_cast<volume::ScalarType>(type_number);
    for (const BlockEncoding wanted :
         {BlockEncoding::kRaw, BlockEncoding::kLz4, BlockEncoding::kZstd, BlockEncoding::kPacked}) {
      for (const std::size_t count : {std::size_t{1}, std::size_t{2}, std::size_t{27},
                                      std::size_t{1331}, std::size_t{40'000}}) {
        for (const std::string& samples :
             {SmoothSamples(type, count), NoiseSamples(count * volume::SizeOf(type)),
              std::string(count * volume::SizeOf(type), '\x7f')}) {
          std::string stored = "what was there before";
          const BlockEncoding encoding = EncodeBlock(wanted, type, RowOf(count), samples, &stored);
          if (encoding == BlockEncoding::kRaw) {
            EXPECT_EQ(stored, samples);
          } else {
            EXPECT_TRUE(MayBe(encoding, wanted)) << NameOf(encoding) << " for " << NameOf(wanted);
            EXPECT_LT(stored.size(), samples.size());
          }
          ISOSCOPE_ASSERT_OK_AND_ASSIGN(const std::string decoded,
                                        Decode(encoding, type, RowOf(count), stored));
          EXPECT_TRUE(decoded == samples)
              << volume::NameOf(type) << " " << NameOf(wanted) << " " << count;
        }
      }
    }
  }
}

TEST(BlockCodecTest, SmoothBlocksShrinkAndNoiseStaysRaw) {
  for (const BlockEncoding wanted : kCompressed) {
    std::string stored;
    for (const volume::ScalarType type :
         {volume::ScalarType::kUint8, volume::ScalarType::kUint16, volume::ScalarType::kFloat32}) {
      const std::string samples = SmoothSamples(type, 1331);
      const BlockEncoding encoding = EncodeBlock(wanted, type, {11, 11, 11}, samples, &stored);
      EXPECT_TRUE(MayBe(encoding, wanted)) << NameOf(encoding) << " for " << NameOf(wanted);
      EXPECT_LT(stored.size(), samples.size() * 3 / 4) << NameOf(wanted) << volume::NameOf(type);
      EXPECT_EQ(EncodeBlock(wanted, type, RowOf(1328 / volume::SizeOf(type)), NoiseSamples(1328),
                            &stored),
                BlockEncoding::kRaw);
      EXPECT_EQ(stored, NoiseSamples(1328));
    }
  }
}

TEST(BlockCodecTest, DamageIsDataLossOrOtherSamplesAndNeverMore) {
  const volume::ScalarType type = volume::ScalarType::kUint16;
  const math::Index3 dims{7, 7, 7};
  const std::string samples = SmoothSamples(type, 343);
  for (const BlockEncoding encoding : kCompressed) {
    std::string stored;
    ASSERT_EQ(EncodeBlock(encoding, type, dims, samples, &stored), encoding);
    int refused_count = 0;
    const auto expect_no_harm = [&](const std::string& damaged) {
      const auto decoded = Decode(encoding, type, dims, damaged);
      if (!decoded.ok()) {
        EXPECT_EQ(decoded.status().code(), absl::StatusCode::kDataLoss);
        ++refused_count;
      }
    };
    for (std::size_t bit = 0; bit < 8 * stored.size(); ++bit) {
      std::string damaged = stored;
      damaged[bit / 8] =
          static_cast<char>(static_cast<unsigned char>(damaged[bit / 8]) ^ (1u << (bit % 8)));
      expect_no_harm(damaged);
    }
    EXPECT_GT(refused_count, 20);
    for (std::size_t size = 0; size < stored.size(); ++size) {
      EXPECT_THAT(Decode(encoding, type, dims, stored.substr(0, size)),
                  StatusIs(absl::StatusCode::kDataLoss, HasSubstr(std::string(NameOf(encoding)))))
          << "cut to " << size;
    }
    for (std::uint64_t seed = 0; seed < 2000; ++seed) {
      std::string damaged = stored;
      for (std::uint64_t i = 0; i < 4; ++i) {
        damaged[base::RandomBits(seed, 2 * i) % damaged.size()] =
            static_cast<char>(base::RandomBits(seed, 2 * i + 1));
      }
      expect_no_harm(damaged);
      expect_no_harm(NoiseSamples(1 + seed % 600));
    }
    EXPECT_THAT(Decode(encoding, type, dims, stored + '\0'),
                StatusIs(absl::StatusCode::kDataLoss, HasSubstr("encoding of")));
    // Another size than was encoded.
    for (const std::size_t count : {1u, 2u, 64u, 341u, 342u, 344u, 345u, 1372u}) {
      if (encoding == BlockEncoding::kPacked && (count + 63) / 64 == (343 + 63) / 64) {
        continue;  // has as many groups
      }
      EXPECT_THAT(Decode(encoding, type, RowOf(count), stored),
                  StatusIs(absl::StatusCode::kDataLoss, HasSubstr("encoding of")))
          << count;
    }
  }
}

// The writer keeps such a block raw. So a reader's bound on the stored size holds.
TEST(BlockCodecTest, AnEncodingThatIsNoSmallerThanItsBlockIsDataLoss) {
  const std::string noise = NoiseSamples(1328);
  std::string larger(ZSTD_compressBound(noise.size()), '\0');
  larger.resize(ZSTD_compress(larger.data(), larger.size(), noise.data(), noise.size(), 1));
  ASSERT_GE(larger.size(), noise.size());
  EXPECT_THAT(Decode(BlockEncoding::kZstd, volume::ScalarType::kUint8, RowOf(noise.size()), larger),
              StatusIs(absl::StatusCode::kDataLoss, ::testing::_));
}

// Single samples among zeros repeat, but each gives its whole group all bits.
TEST(BlockCodecTest, PackingGivesWayToLz4WhereThatIsMuchSmaller) {
  const math::Index3 dims{19, 19, 19};
  std::string points;
  for (int i = 0; i < 19 * 19 * 19; ++i) {
    points.append(2, i % 41 == 0 ? '\x7f' : '\0');
  }
  std::string stored;
  EXPECT_EQ(EncodeBlock(BlockEncoding::kPacked, volume::ScalarType::kUint16, dims, points, &stored),
            BlockEncoding::kLz4);
  EXPECT_LT(stored.size(), points.size() / 8);
  const std::string smooth = SmoothSamples(volume::ScalarType::kFloat64, 6859);
  EXPECT_EQ(
      EncodeBlock(BlockEncoding::kPacked, volume::ScalarType::kFloat64, dims, smooth, &stored),
      BlockEncoding::kLz4)
      << "samples of 8 bytes are not packed";
  EXPECT_THAT(Decode(BlockEncoding::kPacked, volume::ScalarType::kFloat64, {2, 2, 2}, "x"),
              StatusIs(absl::StatusCode::kDataLoss, HasSubstr("no packed encoding of 64 bytes")));
}

TEST(BlockCodecTest, NamesGoBothWays) {
  for (const BlockEncoding encoding :
       {BlockEncoding::kRaw, BlockEncoding::kLz4, BlockEncoding::kZstd, BlockEncoding::kPacked}) {
    ISOSCOPE_ASSERT_OK_AND_ASSIGN(const BlockEncoding parsed, ParseBlockEncoding(NameOf(encoding)));
    EXPECT_EQ(parsed, encoding);
  }
  EXPECT_THAT(ParseBlockEncoding("gzip"),
              StatusIs(absl::StatusCode::kInvalidArgument, HasSubstr("none, lz4, zstd or packed")));
}

}  // namespace
}  // namespace isoscope::store
