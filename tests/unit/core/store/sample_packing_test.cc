#include "core/store/sample_packing.h"

#include <cmath>
#include <cstdint>
#include <optional>
#include <string>
#include <vector>

#include "gtest/gtest.h"

#include "core/base/random.h"

namespace isoscope::store {
namespace {

constexpr std::size_t kWidths[] = {1, 2, 4};

std::size_t CountOf(const math::Index3& dims) {
  return static_cast<std::size_t>(math::Volume(dims));
}

// Samples value(x, y, z) modulo 2^bits.
template <typename Value>
std::string Samples(std::size_t width, const math::Index3& dims, const Value& value) {
  std::string samples;
  for (std::int64_t z = 0; z < dims.z; ++z) {
    for (std::int64_t y = 0; y < dims.y; ++y) {
      for (std::int64_t x = 0; x < dims.x; ++x) {
        auto bits = static_cast<std::uint64_t>(static_cast<std::int64_t>(value(x, y, z)));
        for (std::size_t byte = 0; byte < width; ++byte, bits >>= 8) {
          samples += static_cast<char>(bits & 0xff);
        }
      }
    }
  }
  return samples;
}

double Wave(std::int64_t x, std::int64_t y, std::int64_t z) {
  const auto xf = static_cast<double>(x);
  return 100 + 90 * std::sin(0.2 * xf + 0.1 * static_cast<double>(y)) *
                   std::cos(0.15 * static_cast<double>(z));
}

// From and into buffers of exactly the right size, so that a sanitizer sees reads and writes beyond
// them.
std::optional<std::string> Unpack(std::size_t width, const math::Index3& dims,
                                  const std::string& packed) {
  const std::vector<char> in(packed.begin(), packed.end());
  std::vector<char> out(CountOf(dims) * width);
  std::string scratch = "what was there before";
  if (!UnpackSamples(width, dims, {in.data(), in.size()}, &scratch, out.data())) {
    return std::nullopt;
  }
  return std::string(out.begin(), out.end());
}

TEST(SamplePackingTest, BlocksOfEveryShapeComeBack) {
  for (const std::size_t width : kWidths) {
    for (const math::Index3 dims : {math::Index3{19, 19, 19},
                                    {18, 19, 18},
                                    {11, 11, 11},
                                    {1, 19, 19},
                                    {19, 1, 19},
                                    {19, 19, 1},
                                    {2, 2, 40},
                                    {3, 50, 2},
                                    {7, 1, 40},
                                    {131, 3, 5},
                                    {16, 16, 4},
                                    {5, 13, 1}}) {
      SCOPED_TRACE(testing::Message()
                   << width << ": " << dims.x << " x " << dims.y << " x " << dims.z);
      const std::string samples = Samples(width, dims, Wave);
      std::string packed = "what was there before";
      if (!PackSamples(width, dims, samples, &packed)) {
        EXPECT_EQ(width, 1U) << "only bytes of few rows have too little to save";
        continue;
      }
      EXPECT_LT(packed.size(), samples.size());
      EXPECT_TRUE(Unpack(width, dims, packed) == samples);
    }
  }
}

// Each number of bits has an unpacking function of its own.
TEST(SamplePackingTest, DifferencesOfEveryNumberOfBitsComeBack) {
  const math::Index3 dims{16, 40, 3};
  for (const std::size_t width : kWidths) {
    for (std::size_t bits = 0; bits < 8 * width; ++bits) {
      SCOPED_TRACE(testing::Message() << width << ": " << bits);
      // Noise in the first plane; the others are the same but for one sample.
      std::vector<std::int64_t> noise;
      for (std::uint64_t i = 0; i < 640; ++i) {
        const std::uint64_t random = base::RandomBits(5, i);
        noise.push_back(bits == 0 ? 0 : static_cast<std::int64_t>(random >> (64 - bits)));
      }
      const std::string samples =
          Samples(width, dims, [&](std::int64_t x, std::int64_t y, std::int64_t z) {
            return noise[static_cast<std::size_t>(x + 16 * y)] - (x == 3 && y == 2 ? z : 0);
          });
      std::string packed;
      ASSERT_TRUE(PackSamples(width, dims, samples, &packed));
      EXPECT_LE(packed.size(), 30 + std::size_t{8} * 13 * (bits + 2));
      EXPECT_TRUE(Unpack(width, dims, packed) == samples);
    }
  }
}

TEST(SamplePackingTest, DifferencesWrapAround) {
  const math::Index3 dims{32, 32, 4};
  for (const std::size_t width : kWidths) {
    const std::int64_t top = (std::int64_t{1} << (8 * width)) - 1;
    const std::string samples =
        Samples(width, dims, [&](std::int64_t, std::int64_t y, std::int64_t z) {
          return (y + z) % 2 == 0 ? std::int64_t{0} : top;
        });
    std::string packed;
    ASSERT_TRUE(PackSamples(width, dims, samples, &packed));
    EXPECT_LT(packed.size(), samples.size() / 2) << "0 and the largest value are one apart";
    EXPECT_TRUE(Unpack(width, dims, packed) == samples);
  }
}

// On disk for ever: docs/format/shard.md has this example.
TEST(SamplePackingTest, BytesAreThoseOfTheFormat) {
  const std::string samples = Samples(2, {4, 2, 2}, [](auto x, auto y, auto z) {
    return 1000 + (x == 3 && y == 1 && z == 1 ? 2 : 0);
  });
  std::string packed;
  // The first row needs 11 bits, so that 16 samples do not get smaller.
  EXPECT_FALSE(PackSamples(2, {4, 2, 2}, samples, &packed));
  const std::string small = Samples(2, {4, 8, 4}, [](auto x, auto y, auto z) {
    return 1 + (x == 3 && y == 7 && z == 3 ? 2 : 0);
  });
  ASSERT_TRUE(PackSamples(2, {4, 8, 4}, small, &packed));
  // Widths 2 and 3. First row: +1, zigzag 2, in the lowest lanes' first word. Last sample: +2,
  // zigzag 4, the 16th of its lane: bits 45 to 47, in the third word.
  const std::string expected(
      "\2\3"
      "\2\0\2\0\2\0\2\0"
      "\0\0\0\0\0\0\0\0"
      "\0\0\0\0\0\0\0\0"
      "\0\0\0\0\0\0\0\0"
      "\0\0\0\0\0\0\0\x80",
      2 + 5 * 8);
  EXPECT_EQ(packed, expected);
  EXPECT_TRUE(Unpack(2, {4, 8, 4}, expected) == small);
}

TEST(SamplePackingTest, NoiseIsNotPacked) {
  std::string packed;
  for (const std::size_t width : kWidths) {
    const std::string noise =
        Samples(width, {19, 19, 19}, [](std::int64_t x, std::int64_t y, std::int64_t z) {
          return base::RandomBits(7, static_cast<std::uint64_t>(x + 19 * (y + 19 * z)));
        });
    EXPECT_FALSE(PackSamples(width, {19, 19, 19}, noise, &packed));
  }
}

TEST(SamplePackingTest, LengthsAndWidthsThatLieAreRefused) {
  const math::Index3 dims{19, 19, 19};  // 108 groups
  for (const std::size_t width : kWidths) {
    SCOPED_TRACE(width);
    const std::string samples = Samples(width, dims, Wave);
    std::string packed;
    ASSERT_TRUE(PackSamples(width, dims, samples, &packed));
    for (std::size_t size = 0; size < packed.size(); ++size) {
      EXPECT_FALSE(Unpack(width, dims, packed.substr(0, size))) << size;
    }
    EXPECT_FALSE(Unpack(width, dims, packed + '\0'));
    EXPECT_FALSE(Unpack(width, dims, packed + std::string(8, '\0')));
    for (std::size_t group = 0; group < 108; ++group) {
      for (const int bits : {packed[group] + 1, packed[group] - 1, 33, 127, 128, 255}) {
        std::string damaged = packed;
        damaged[group] = static_cast<char>(bits);
        EXPECT_FALSE(Unpack(width, dims, damaged)) << group << ": " << bits;
      }
    }
    // Too wide, with as many words as that asks for.
    const auto bits = static_cast<char>(8 * width + 1);
    EXPECT_FALSE(
        Unpack(width, dims,
               std::string(108, bits) +
                   std::string(std::size_t{108} * 8 * static_cast<std::size_t>(bits), '\0')));
    // Widest: larger than the samples, yet nothing is written beyond them.
    EXPECT_TRUE(Unpack(width, dims,
                       std::string(108, static_cast<char>(8 * width)) +
                           std::string(std::size_t{108} * 64 * width, '\x5a')));
  }
}

}  // namespace
}  // namespace isoscope::store
