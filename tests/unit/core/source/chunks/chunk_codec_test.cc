// Known answers are bytes that numcodecs 0.11 wrote. CompareWithNumcodecs in
// tests/unit/core/formats/zarr/zarr_python_test.cc writes others where it is installed.

#include "core/source/chunks/chunk_codec.h"

#include <zstd.h>

#include <cstring>
#include <string>
#include <vector>

#include "absl/strings/escaping.h"
#include "gmock/gmock.h"
#include "gtest/gtest.h"

#include "core/base/coding.h"
#include "tests/support/chunk_writer.h"
#include "tests/support/status_matchers.h"
#include "tests/support/volume_files.h"

namespace isoscope::source {
namespace {

using ::isoscope::testing::IsOk;
using ::isoscope::testing::StatusIs;
using ::isoscope::testing::WithCrc32c;
using ::testing::AllOf;
using ::testing::HasSubstr;

constexpr auto kInvalid = absl::StatusCode::kInvalidArgument;
constexpr auto kDataLoss = absl::StatusCode::kDataLoss;

CodecSpec Codec(const std::string& name, const std::string& configuration = "{}") {
  return {.name = name, .configuration = ChunkJson::parse(configuration)};
}

template <typename T>
std::string BytesOf(const std::vector<T>& values) {
  std::string bytes;
  for (const T value : values) {
    base::AppendLittleEndian(value, &bytes);
  }
  return bytes;
}

// 0, 1000, 2000, ..., 23000.
std::string Thousands() {
  std::vector<std::uint16_t> values;
  for (int i = 0; i < 24; ++i) {
    values.push_back(static_cast<std::uint16_t>(1000 * i));
  }
  return BytesOf(values);
}

// Behind "bytes", of `count` numbers.
absl::StatusOr<std::string> Decode(const CodecSpec& codec, const std::string& encoded,
                                   NumberType type = NumberType::kUint16, std::int64_t count = 24) {
  const std::vector<CodecSpec> codecs = {Codec("bytes"), codec};
  auto chain = CodecChain::Make(codecs, ArrayData({count}, type, "\0\0"));
  return chain.ok() ? chain->Decode(encoded) : chain.status();
}
// In front of "bytes".
absl::StatusOr<std::string> DecodeNumbers(const CodecSpec& codec, const std::string& encoded,
                                          NumberType type, std::int64_t count) {
  const std::vector<CodecSpec> codecs = {codec, Codec("bytes")};
  auto chain = CodecChain::Make(codecs, ArrayData({count}, type, ""));
  return chain.ok() ? chain->Decode(encoded) : chain.status();
}

struct KnownAnswer {
  const char* name;
  const char* configuration;
  const char* hex;
};
const KnownAnswer kOfThousands[] = {
    {"gzip", "{}",
     "1f8b080074cd0b6b04ff636078c17c817d07f702fe0ee102f1086907790d6501f51f5a0ff44e186d309b61d56097e"
     "1"
     "14e066e1a5e0c711f421f4462400711ba1cc30000000"},
    {"zlib", "{}",
     "7801636078c17c817d07f702fe0ee102f1086907790d6501f51f5a0ff44e186d309b61d56097e114e066e1a5e0c71"
     "1"
     "f421f446240075d1104b"},
    {"bz2", "{}",
     "425a6831314159265359ff2a870e0000007fffc8c8c888c8d11151511152600040400040400040400040400040"
     "40404040404020002300000000680c993f54f50c00346868c232683469a030cc05689f2941fb371855717c01c0"
     "d4291c28c5d103840f02428bef48bf177245385090ff2a870e"},
    {"zstd", "{}",
     "28b52ffd20308101000000e803d007b80ba00f88137017581b401f28231027f82ae02ec832b036983a803e6842504"
     "63"
     "84a204e0852f055d859"},
    {"lz4", "{}",
     "30000000f0210000e803d007b80ba00f88137017581b401f28231027f82ae02ec832b036983a803e68425046384a2"
     "04"
     "e0852f055d859"},
    {"shuffle", "{\"elementsize\": 2}",
     "00e8d0b8a0887058402810f8e0c8b098806850382008f0d80003070b0f13171b1f23272a2e32363a3e42464a4e525"
     "5"
     "59"},
    {"crc32", "{}",
     "711ba1cc0000e803d007b80ba00f88137017581b401f28231027f82ae02ec832b036983a803e68425046384a204e0"
     "85"
     "2f055d859"},
    {"adler32", "{}",
     "4b10d1750000e803d007b80ba00f88137017581b401f28231027f82ae02ec832b036983a803e68425046384a204e0"
     "85"
     "2f055d859"},
    {"lzma", "{\"format\": 1}",
     "fd377a585a000004e6d6b4460200210116000000742fe5a301002f0000e803d007b80ba00f88137017581b401f28"
     "231027f82ae02ec832b036983a803e68425046384a204e0852f055d85900dbcc535534aaaa3d000148308a40ff3e"
     "1fb6f37d010000000004595a"},
    {"lzma", "{\"format\": 2}",
     "5d00008000ffffffffffffffff0000639e784f74520616ccc5e038f5c6367f52e68c35af1e18294819d7bd64399a"
     "5ad42fbc09ce946a4b29d1c8971f843fdd8275a45f47d60ffffbeea000"},
    {"delta", "{\"dtype\": \"<u2\"}",
     "0000e803e803e803e803e803e803e803e803e803e803e803e803e803e803e803e803e803e803e803e803e803e803e"
     "8"
     "03"},
};
// The thousands 20 times, by blosc's compressors and shuffles.
const KnownAnswer kOfBlosc[] = {
    {"blosc", "lz4, bytes shuffled",
     "02012102c0030000c0030000640000001400000024000000ff0900e8d0b8a0887058402810f8e0c8b098806850382"
     "0"
     "08f0d81800ffb150382008f0d824000000ff090003070b0f13171b1f23272a2e32363a3e42464a4e5255591800ffb"
     "1"
     "504a4e525559"},
    {"blosc", "blosclz, bits shuffled",
     "02010402c0030000c00300008b000000140000002e0000002300000000e0a6030100aae0310001aacce0310001cc5"
     "ae"
     "03100035ac639c6e02f0203c63ef8c1e02d02023ef8c14100000025fe07c0fe07c0e02d0502feff3fe02f02033f54"
     "55"
     "55e02f020355989999e02f020399e0e1e1e02f0203e100fe01e03002020000fee031020000e02e0002000000"},
    {"blosc", "zlib, not shuffled",
     "02016002c0030000c00300009a000000140000003f000000785e636078c17c817d07f702fe0ee102f1086907790d6"
     "50"
     "1f51f5a0ff44e186d309b61d56097e114e066e1a5e0c711f421f44624c3a8fa21a51e0012dca2e53f000000785e63"
     "60"
     "78c17c817d07f702fe0ee102f1086907790d6501f51f5a0ff44e186d309b61d56097e114e066e1a5e0c711f421f44"
     "62"
     "4c3a8fa21a51e0012dca2e5"},
    {"blosc", "zstd, bits shuffled",
     "02019402c0030000c00300005d000000140000004500000028b52ffd60c002dd0100f00000aacc5ac639c63ef8c1f"
     "e0"
     "7c0ff3f545555989999e0e1e100fe0100fe0ea83010faf0c510feffffb39d03073aee9d7fae96104040bd525801"},
};

TEST(ChunkCodecTest, DecodesKnownAnswers) {
  for (const KnownAnswer& known : kOfThousands) {
    for (const char* prefix : {"", "numcodecs."}) {
      SCOPED_TRACE(std::string(prefix) + known.name);
      ISOSCOPE_ASSERT_OK_AND_ASSIGN(
          const std::string bytes,
          Decode(Codec(absl::StrCat(prefix, known.name), known.configuration),
                 absl::HexStringToBytes(known.hex)));
      EXPECT_EQ(bytes, Thousands());
    }
  }
  std::string thousands;
  for (int i = 0; i < 20; ++i) {
    thousands += Thousands();
  }
  for (const KnownAnswer& known : kOfBlosc) {
    SCOPED_TRACE(known.configuration);
    ISOSCOPE_ASSERT_OK_AND_ASSIGN(
        const std::string bytes,
        Decode(Codec("blosc"), absl::HexStringToBytes(known.hex), NumberType::kUint16, 480));
    EXPECT_EQ(bytes, thousands);
  }
}

// Each prefix, each changed byte: an error, or as many bytes as the chunk has; never a crash.
TEST(ChunkCodecTest, SurvivesDamage) {
  for (const KnownAnswer& known : kOfThousands) {
    const CodecSpec codec = Codec(known.name, known.configuration);
    const std::string good = absl::HexStringToBytes(known.hex);
    for (std::size_t size = 0; size < good.size(); ++size) {
      EXPECT_THAT(Decode(codec, std::string(good.data(), size)), StatusIs(kDataLoss))
          << known.name << " " << size;
    }
    EXPECT_THAT(Decode(codec, good + "x"), ::testing::AnyOf(StatusIs(kDataLoss), IsOk()))
        << known.name;
    for (std::size_t i = 0; i < good.size(); ++i) {
      for (const int bit : {0, 3, 7}) {
        std::string bad = good;
        bad[i] = static_cast<char>(bad[i] ^ (1 << bit));
        const auto bytes = Decode(codec, bad);
        if (bytes.ok()) {
          EXPECT_EQ(bytes->size(), 48U);
        } else {
          EXPECT_THAT(bytes, StatusIs(kDataLoss)) << known.name;
        }
      }
    }
  }
  for (const KnownAnswer& known : kOfBlosc) {
    const std::string good = absl::HexStringToBytes(known.hex);
    for (std::size_t i = 0; i < good.size(); ++i) {
      EXPECT_THAT(Decode(Codec("blosc"), std::string(good.data(), i), NumberType::kUint16, 480),
                  StatusIs(kDataLoss));
      std::string bad = good;
      bad[i] = static_cast<char>(bad[i] ^ 0x55);
      const auto bytes = Decode(Codec("blosc"), bad, NumberType::kUint16, 480);
      EXPECT_TRUE(bytes.ok() || absl::IsDataLoss(bytes.status()));
    }
  }
}

// A stream that holds more than the chunk is not decoded further.
TEST(ChunkCodecTest, RefusesStreamsOfOtherLengths) {
  const std::string zeros(1 << 20, '\0');
  const std::string gzip = testing::Gzip(zeros);
  EXPECT_THAT(Decode(Codec("gzip"), gzip), StatusIs(kDataLoss, HasSubstr("more than 48 bytes")));
  EXPECT_THAT(Decode(Codec("zlib"), testing::Deflate(zeros, 15)), StatusIs(kDataLoss));
  EXPECT_THAT(Decode(Codec("gzip"), testing::Gzip(Thousands().substr(2))),
              StatusIs(kDataLoss, HasSubstr("46 bytes")));
  for (const KnownAnswer& known : kOfThousands) {
    for (const std::int64_t count : {23, 25}) {
      EXPECT_THAT(Decode(Codec(known.name, known.configuration), absl::HexStringToBytes(known.hex),
                         NumberType::kUint16, count),
                  StatusIs(kDataLoss))
          << known.name;
    }
  }
  // LZ4 with a length of 2 GiB, which is not allocated.
  EXPECT_THAT(Decode(Codec("lz4"), absl::HexStringToBytes("ffffff7f00000000")),
              StatusIs(kDataLoss, HasSubstr("a length of 2147483647")));
}

// TensorStore writes frames that do not say how long they are.
TEST(ChunkCodecTest, DecodesZstdWithoutASizeAndSeveralFrames) {
  const std::string bytes = Thousands();
  ZSTD_CCtx* const context = ZSTD_createCCtx();
  ZSTD_CCtx_setParameter(context, ZSTD_c_contentSizeFlag, 0);
  ZSTD_CCtx_setParameter(context, ZSTD_c_checksumFlag, 1);
  std::string frame(256, '\0');
  ZSTD_inBuffer in{bytes.data(), bytes.size(), 0};
  ZSTD_outBuffer out{frame.data(), frame.size(), 0};
  ASSERT_EQ(ZSTD_compressStream2(context, &out, &in, ZSTD_e_end), 0U);
  ZSTD_freeCCtx(context);
  frame.resize(out.pos);
  ASSERT_EQ(ZSTD_getFrameContentSize(frame.data(), frame.size()), ZSTD_CONTENTSIZE_UNKNOWN);
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(const std::string decoded, Decode(Codec("zstd"), frame));
  EXPECT_EQ(decoded, bytes);
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(const std::string twice,
                                Decode(Codec("zstd"), frame + frame, NumberType::kUint16, 48));
  EXPECT_EQ(twice, bytes + bytes);
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(
      const std::string members,
      Decode(Codec("gzip"), testing::Gzip(bytes.substr(0, 7)) + testing::Gzip(bytes.substr(7))));
  EXPECT_EQ(members, bytes);
}

TEST(ChunkCodecTest, UnpacksBitsAsNumcodecs) {
  const auto decode = [](const std::string& hex, std::int64_t count) {
    return Decode(Codec("packbits"), absl::HexStringToBytes(hex), NumberType::kBool, count);
  };
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(const std::string bits, decode("06b1c0", 10));
  EXPECT_EQ(absl::BytesToHexString(bits), "01000101000000010101");
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(const std::string whole, decode("00b1", 8));
  EXPECT_EQ(absl::BytesToHexString(whole), "0100010100000001");
  EXPECT_THAT(decode("05b1c0", 10), StatusIs(kDataLoss, HasSubstr("5 bits are unused")));
  for (const char* bad : {"", "06b1", "06b1c000"}) {
    EXPECT_THAT(decode(bad, 10), StatusIs(kDataLoss)) << bad;
  }
  EXPECT_THAT(Decode(Codec("packbits"), "", NumberType::kUint8, 8), StatusIs(kInvalid));
  // A stream of LZMA whose head asks for a dictionary of 4 GiB.
  EXPECT_THAT(Decode(Codec("lzma"), absl::HexStringToBytes("5dffffffffffffffffffffffff00")),
              StatusIs(kDataLoss));
  EXPECT_THAT(Decode(Codec("lzma", "{\"format\": 3}"), ""), StatusIs(kInvalid, HasSubstr("xz")));
}

// A buffer of another size, with other bytes, changes nothing.
TEST(ChunkCodecTest, DecodesIntoABufferThatWasUsed) {
  for (const KnownAnswer& known : kOfThousands) {
    SCOPED_TRACE(known.name);
    const std::vector<CodecSpec> specs = {Codec("bytes"), Codec(known.name, known.configuration)};
    const auto chain =
        CodecChain::Make(specs, ArrayData({24}, NumberType::kUint16, std::string(2, '\0')));
    if (!chain.ok()) {
      continue;  // one of numbers
    }
    const std::string encoded = absl::HexStringToBytes(known.hex);
    std::string out;
    for (const std::size_t size : {0U, 3U, 48U, 1000U}) {
      out.assign(size, '\x55');
      ISOSCOPE_ASSERT_OK(chain->DecodeInto(encoded, &out));
      EXPECT_EQ(out, Thousands());
    }
    EXPECT_THAT(chain->DecodeInto(absl::string_view(encoded).substr(1), &out), StatusIs(kDataLoss));
    ISOSCOPE_EXPECT_OK(chain->DecodeInto(encoded, &out));
    EXPECT_EQ(out, Thousands());
  }
}

TEST(ChunkCodecTest, ChecksCrc32c) {
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(const std::string bytes,
                                Decode(Codec("crc32c"), WithCrc32c(Thousands())));
  EXPECT_EQ(bytes, Thousands());
  std::string bad = WithCrc32c(Thousands());
  bad[3] ^= 1;
  EXPECT_THAT(Decode(Codec("crc32c"), bad), StatusIs(kDataLoss, HasSubstr("checksum")));
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(const std::string in_front,
                                Decode(Codec("numcodecs.crc32c", "{\"location\": \"start\"}"),
                                       WithCrc32c(Thousands()).substr(48) + Thousands()));
  EXPECT_EQ(in_front, Thousands());
  // HDF5's Fletcher32 of "abcd": words 0x6162 and 0x6364; sums 0xc4c6 and 0x12628 = 0x2629.
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(
      const std::string fletcher,
      Decode(Codec("fletcher32"), std::string("abcd\xc6\xc4\x29\x26", 8), NumberType::kUint8, 4));
  EXPECT_EQ(fletcher, "abcd");
}

TEST(ChunkCodecTest, SwapsAndTransposes) {
  const std::vector<CodecSpec> codecs = {Codec("transpose", "{\"order\": [2, 0, 1]}"),
                                         Codec("bytes", "{\"endian\": \"big\"}")};
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(
      const CodecChain chain,
      CodecChain::Make(codecs, ArrayData({2, 3, 4}, NumberType::kUint16, "")));
  // Stored are axes 2, 0, 1: the element of (k, i, j) is that of (i, j, k), 12 i + 4 j + k.
  std::string stored;
  for (std::uint16_t k = 0; k < 4; ++k) {
    for (std::uint16_t i = 0; i < 2; ++i) {
      for (std::uint16_t j = 0; j < 3; ++j) {
        base::AppendLittleEndian(static_cast<std::uint16_t>(12 * i + 4 * j + k), &stored);
      }
    }
  }
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(const std::string bytes, chain.Decode(testing::Swapped(stored, 2)));
  std::vector<std::uint16_t> expected;
  for (std::uint16_t i = 0; i < 24; ++i) {
    expected.push_back(i);
  }
  EXPECT_EQ(bytes, BytesOf(expected));
  for (const char* order :
       {"[0, 1]", "[0, 1, 1]", "[0, 1, 3]", "[0, 1, -1]", "\"G\"", "[0, 1, 2.5]", "null", "7"}) {
    EXPECT_THAT(CodecChain::Make(std::vector<CodecSpec>{Codec(
                                     "transpose", absl::StrCat("{\"order\": ", order, "}"))},
                                 ArrayData({2, 3, 4}, NumberType::kUint16, "")),
                StatusIs(kInvalid, HasSubstr("order")))
        << order;
  }
}

// Values that numcodecs gave: 0.5 i - 3 by (offset -3, scale 10, uint8), 0 to 4 by (-3, 3, >i2).
TEST(ChunkCodecTest, ComputesAsNumcodecs) {
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(
      const std::string doubles,
      DecodeNumbers(Codec("numcodecs.fixedscaleoffset",
                          R"({"offset": -3, "scale": 10, "dtype": "<f8", "astype": "|u1"})"),
                    absl::HexStringToBytes("00050a0f14"), NumberType::kFloat64, 5));
  EXPECT_EQ(doubles, BytesOf<double>({-3, -2.5, -2, -1.5, -1}));
  // As a filter of Zarr 2, which encodes bytes.
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(
      const std::string integers,
      Decode(Codec("fixedscaleoffset",
                   R"({"offset": -3, "scale": 3, "dtype": "<i4", "astype": ">i2"})"),
             absl::HexStringToBytes("0009000c000f00120015"), NumberType::kInt32, 5));
  EXPECT_EQ(integers, BytesOf<std::int32_t>({0, 1, 2, 3, 4}));
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(
      const std::string floats,
      DecodeNumbers(Codec("fixedscaleoffset",
                          R"({"offset": 0.1, "scale": 3, "dtype": "<f4", "astype": "<f4"})"),
                    absl::HexStringToBytes("00000080000000000000803f"), NumberType::kFloat32, 3));
  EXPECT_EQ(absl::BytesToHexString(floats), "cdcccc3dcdcccc3ddedddd3e");
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(const std::string narrow,
                                Decode(Codec("delta", R"({"dtype": "<i2", "astype": "|i1"})"),
                                       absl::HexStringToBytes("05fe06f3"), NumberType::kInt16, 4));
  EXPECT_EQ(narrow, BytesOf<std::int16_t>({5, 3, 9, -4}));
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(
      const std::string big,
      Decode(Codec("delta", R"({"dtype": ">f4"})"),
             absl::HexStringToBytes("40a00000bfc0000040b00000c1500000"), NumberType::kFloat32, 4));
  EXPECT_EQ(absl::BytesToHexString(big), "40a000004060000041100000c0800000");
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(
      const std::string cast,
      Decode(Codec("astype", R"({"encode_dtype": "<f4", "decode_dtype": "<f8"})"),
             BytesOf<float>({1.5F, -2}), NumberType::kFloat64, 2));
  EXPECT_EQ(cast, BytesOf<double>({1.5, -2}));
}

TEST(ChunkCodecTest, CastsAndScales) {
  // Sentinel-2 writes reflectances so: a float32 is (stored / 10000) - 0.1.
  const std::vector<CodecSpec> codecs = {
      Codec("scale_offset", R"({"offset": -0.1, "scale": 10000})"),
      Codec("cast_value", R"({"data_type": "uint16", "rounding": "nearest-even",
                              "out_of_range": "clamp",
                              "scalar_map": {"encode": [["NaN", 0]], "decode": [[0, "NaN"]]}})"),
      Codec("bytes", "{\"endian\": \"little\"}")};
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(const CodecChain chain,
                                CodecChain::Make(codecs, ArrayData({3}, NumberType::kFloat32, "")));
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(const std::string bytes,
                                chain.Decode(BytesOf<std::uint16_t>({0, 1000, 65535})));
  std::vector<float> values(3);
  ASSERT_EQ(bytes.size(), 12U);
  std::memcpy(values.data(), bytes.data(), bytes.size());
  EXPECT_TRUE(std::isnan(values[0]));
  EXPECT_EQ(values[1], 1000.0F / 10000.0F + -0.1F);
  EXPECT_EQ(values[2], 65535.0F / 10000.0F + -0.1F);

  const auto cast = [](const std::string& out_of_range) {
    return DecodeNumbers(
        Codec("cast_value",
              absl::StrCat(R"({"data_type": "float64", "out_of_range": ")", out_of_range, R"("})")),
        BytesOf<double>({2.5, 300, -1}), NumberType::kUint8, 3);
  };
  EXPECT_THAT(cast("error"), StatusIs(kDataLoss, HasSubstr("300, number 1 of the chunk")));
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(const std::string clamped, cast("clamp"));
  EXPECT_EQ(clamped, std::string("\x02\xff\x00", 3));
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(const std::string wrapped, cast("wrap"));
  EXPECT_EQ(wrapped, std::string("\x02\x2c\xff", 3));
  EXPECT_THAT(DecodeNumbers(Codec("cast_value", R"({"data_type": "float32"})"),
                            BytesOf<float>({std::nanf("")}), NumberType::kInt16, 1),
              StatusIs(kDataLoss));
  EXPECT_THAT(DecodeNumbers(Codec("cast_value", R"({"data_type": "int16"})"),
                            BytesOf<std::int16_t>({-1}), NumberType::kUint16, 1),
              StatusIs(kDataLoss));
  // Integers that do not divide were not written by this codec.
  const CodecSpec thirds = Codec("scale_offset", R"({"offset": 5, "scale": 3})");
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(
      const std::string exact,
      DecodeNumbers(thirds, BytesOf<std::int16_t>({-9, 6}), NumberType::kInt16, 2));
  EXPECT_EQ(exact, BytesOf<std::int16_t>({2, 7}));
  EXPECT_THAT(DecodeNumbers(thirds, BytesOf<std::int16_t>({4}), NumberType::kInt16, 1),
              StatusIs(kDataLoss));
  EXPECT_THAT(DecodeNumbers(Codec("scale_offset", R"({"offset": 0, "scale": -1})"),
                            BytesOf<std::int16_t>({-32768}), NumberType::kInt16, 1),
              StatusIs(kDataLoss));
}

TEST(ChunkCodecTest, RefusesChainsThatMakeNoSense) {
  const auto make = [](std::vector<CodecSpec> codecs, NumberType type = NumberType::kUint16) {
    return CodecChain::Make(codecs, ArrayData({24}, type, std::string(2, '\0')));
  };
  EXPECT_THAT(make({}), StatusIs(kInvalid, HasSubstr("no codec makes bytes")));
  EXPECT_THAT(make({Codec("bytes"), Codec("blosc2")}),
              StatusIs(kInvalid, AllOf(HasSubstr("\"blosc2\""), HasSubstr("sharding_indexed"))));
  EXPECT_THAT(make({Codec("zfpy")}), StatusIs(kInvalid, HasSubstr("\"zfpy\"")));
  EXPECT_THAT(make({Codec("\x1b[2J")}), StatusIs(kInvalid, ::testing::Not(HasSubstr("\x1b"))));
  EXPECT_THAT(make({Codec("gzip"), Codec("bytes")}), StatusIs(kInvalid, HasSubstr("gzip")));
  EXPECT_THAT(make({Codec("bytes"), Codec("bytes")}), StatusIs(kInvalid));
  EXPECT_THAT(make({Codec("bytes"), Codec("transpose", "{\"order\": [0]}")}), StatusIs(kInvalid));
  EXPECT_THAT(make({Codec("bytes", "{\"endian\": \"middle\"}")}), StatusIs(kInvalid));
  EXPECT_THAT(make({Codec("bytes"), Codec("shuffle", "{\"elementsize\": 0}")}), StatusIs(kInvalid));
  EXPECT_THAT(make({Codec("delta", "{\"dtype\": \"<f4\"}"), Codec("bytes")}),
              StatusIs(kInvalid, HasSubstr("float32")));
  EXPECT_THAT(make({Codec("delta"), Codec("bytes")}), StatusIs(kInvalid, HasSubstr("dtype")));
  EXPECT_THAT(make({Codec("bytes"), Codec("gzip"), Codec("delta", "{\"dtype\": \"<u2\"}")}),
              StatusIs(kInvalid));
  EXPECT_THAT(make({Codec("bytes"), Codec("delta", "{\"dtype\": \"<f8\", \"astype\": 3}")}),
              StatusIs(kInvalid));
  EXPECT_THAT(make({Codec("fixedscaleoffset", R"({"offset": 0, "scale": 0, "dtype": "<u2"})"),
                    Codec("bytes")}),
              StatusIs(kInvalid, HasSubstr("scale is 0")));
  EXPECT_THAT(make({Codec("scale_offset", R"({"offset": 0, "scale": 0})"), Codec("bytes")}),
              StatusIs(kInvalid));
  EXPECT_THAT(make({Codec("scale_offset", R"({"offset": 0, "scale": 1, "more": 1})")}),
              StatusIs(kInvalid, HasSubstr("\"more\"")));
  EXPECT_THAT(make({Codec("cast_value", R"({"data_type": "float16"})"), Codec("bytes")}),
              StatusIs(kInvalid, HasSubstr("float16")));
  EXPECT_THAT(make(std::vector<CodecSpec>(33, Codec("transpose", "{\"order\": [0]}"))),
              StatusIs(kInvalid, HasSubstr("33 codecs")));
}

TEST(ChunkCodecTest, ReadsListsOfCodecs) {
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(
      const auto specs,
      CodecSpecsFrom(ChunkJson::parse(R"(["bytes", {"name": "gzip", "configuration": {"level": 5}},
                                          {"name": "zstd", "configuration": null}])")));
  ASSERT_EQ(specs.size(), 3U);
  EXPECT_EQ(specs[0].name, "bytes");
  EXPECT_EQ(specs[1].configuration["level"], 5);
  for (const char* bad :
       {"{}", "[3]", "[{}]", "[{\"name\": 3}]", "[{\"name\": \"gzip\", \"configuration\": []}]"}) {
    EXPECT_THAT(CodecSpecsFrom(ChunkJson::parse(bad)), StatusIs(kInvalid)) << bad;
  }
}

}  // namespace
}  // namespace isoscope::source
