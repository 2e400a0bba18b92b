#include "core/source/chunks/number_type.h"

#include <string>

#include "absl/strings/escaping.h"
#include "gmock/gmock.h"
#include "gtest/gtest.h"
#include <nlohmann/json.hpp>

#include "tests/support/status_matchers.h"

namespace isoscope::source {
namespace {

using ::isoscope::testing::IsOk;
using ::isoscope::testing::StatusIs;
using ::testing::HasSubstr;

constexpr auto kInvalid = absl::StatusCode::kInvalidArgument;

std::string Hex(const std::string& value, NumberType type) {
  const auto bytes = NumberBytes(nlohmann::json::parse(value), type);
  return bytes.ok() ? absl::BytesToHexString(*bytes) : std::string(bytes.status().message());
}

TEST(NumberTypeTest, NamesTypes) {
  for (int i = 0; i <= static_cast<int>(NumberType::kFloat64); ++i) {
    const auto type = static_cast<NumberType>(i);
    EXPECT_EQ(NumberTypeFromName(NameOf(type)), type);
    ISOSCOPE_ASSERT_OK_AND_ASSIGN(const StoredNumber named,
                                  ParseNumpyType(std::string(NameOf(type))));
    EXPECT_EQ(named.type, type);
  }
  EXPECT_EQ(NumberTypeFromName("complex64"), std::nullopt);
  EXPECT_EQ(SizeOf(NumberType::kBool), 1U);
  EXPECT_EQ(SizeOf(NumberType::kFloat16), 2U);
  EXPECT_EQ(SizeOf(NumberType::kInt64), 8U);
}

TEST(NumberTypeTest, ReadsTypesOfNumpy) {
  const struct {
    const char* text;
    NumberType type;
    bool is_big;
  } kCases[] = {{"|b1", NumberType::kBool, false},   {"<u2", NumberType::kUint16, false},
                {">u2", NumberType::kUint16, true},  {"|i1", NumberType::kInt8, false},
                {">f4", NumberType::kFloat32, true}, {"<f2", NumberType::kFloat16, false},
                {"u1", NumberType::kUint8, false},   {"=i8", NumberType::kInt64, false}};
  for (const auto& expected : kCases) {
    SCOPED_TRACE(expected.text);
    ISOSCOPE_ASSERT_OK_AND_ASSIGN(const StoredNumber number, ParseNumpyType(expected.text));
    EXPECT_EQ(number.type, expected.type);
    EXPECT_EQ(number.is_big_endian, expected.is_big);
  }
  for (const char* text : {"", "<", "<c8", "|S3", "<M8[ns]", "|O", "<u3", "<<u2", "<f16", "|V8"}) {
    EXPECT_THAT(ParseNumpyType(text), StatusIs(kInvalid, HasSubstr(text))) << text;
  }
}

TEST(NumberTypeTest, WritesNumbersOfJson) {
  EXPECT_EQ(Hex("258", NumberType::kUint16), "0201");
  EXPECT_EQ(Hex("-2", NumberType::kInt32), "feffffff");
  EXPECT_EQ(Hex("7.0", NumberType::kUint8), "07");
  EXPECT_EQ(Hex("true", NumberType::kBool), "01");
  EXPECT_EQ(Hex("false", NumberType::kUint16), "0000");
  EXPECT_EQ(Hex("18446744073709551615", NumberType::kUint64), "ffffffffffffffff");
  EXPECT_EQ(Hex("-9223372036854775808", NumberType::kInt64), "0000000000000080");
  EXPECT_EQ(Hex("1.5", NumberType::kFloat32), "0000c03f");
  EXPECT_EQ(Hex("3", NumberType::kFloat64), "0000000000000840");
  EXPECT_EQ(Hex("\"NaN\"", NumberType::kFloat32), "0000c07f");
  EXPECT_EQ(Hex("\"Infinity\"", NumberType::kFloat64), "000000000000f07f");
  EXPECT_EQ(Hex("\"-Infinity\"", NumberType::kFloat16), "00fc");
  EXPECT_EQ(Hex("\"0x7fc00001\"", NumberType::kFloat32), "0100c07f");
  EXPECT_EQ(Hex("\"0x3c00\"", NumberType::kFloat16), "003c");
}

// Values of IEEE 754 binary16: 1, 65504 (the largest), 2^-24 (the smallest), ties to even.
TEST(NumberTypeTest, WritesHalves) {
  EXPECT_EQ(Hex("1", NumberType::kFloat16), "003c");
  EXPECT_EQ(Hex("-2.5", NumberType::kFloat16), "00c1");
  EXPECT_EQ(Hex("65504", NumberType::kFloat16), "ff7b");
  EXPECT_EQ(Hex("65519", NumberType::kFloat16), "ff7b");
  EXPECT_EQ(Hex("65520", NumberType::kFloat16), "007c");
  EXPECT_EQ(Hex("5.960464477539063e-08", NumberType::kFloat16), "0100");
  EXPECT_EQ(Hex("6.103515625e-05", NumberType::kFloat16), "0004");
  EXPECT_EQ(Hex("2049", NumberType::kFloat16), "0068");
  EXPECT_EQ(Hex("2051", NumberType::kFloat16), "0268");
  EXPECT_EQ(Hex("0.1", NumberType::kFloat16), "662e");
}

TEST(NumberTypeTest, RefusesOtherValues) {
  for (const char* value : {"256", "-1", "1.5", "\"1\"", "null", "[]", "{}", "1e300", "\"NaN\""}) {
    EXPECT_THAT(NumberBytes(nlohmann::json::parse(value), NumberType::kUint8), StatusIs(kInvalid))
        << value;
  }
  EXPECT_THAT(NumberBytes(2, NumberType::kBool), StatusIs(kInvalid, HasSubstr("true or false")));
  EXPECT_THAT(NumberBytes(-1, NumberType::kUint8),
              StatusIs(kInvalid, HasSubstr("expected an integer from 0 to 255")));
  EXPECT_THAT(NumberBytes(std::uint64_t{1} << 63, NumberType::kInt64), StatusIs(kInvalid));
  for (const char* value : {"\"0x7fc0\"", "\"0x7fc000001\"", "\"0x7fc0000g\"", "\"nan\"", "null"}) {
    EXPECT_THAT(NumberBytes(nlohmann::json::parse(value), NumberType::kFloat32),
                StatusIs(kInvalid, HasSubstr("\"NaN\", \"Infinity\", \"-Infinity\", or its bits: "
                                             "\"0x\" and 8 digits")))
        << value;
  }
}

TEST(NumberTypeTest, TellsTheTypeOfSamples) {
  EXPECT_EQ(SampleTypeOf(NumberType::kBool).stored, volume::ScalarType::kUint8);
  EXPECT_EQ(SampleTypeOf(NumberType::kUint64).wide, WideType::kUint64);
  EXPECT_EQ(SampleTypeOf(NumberType::kFloat16).stored, volume::ScalarType::kUint16);
  EXPECT_EQ(SampleTypeOf(NumberType::kInt16).wide, std::nullopt);
}

}  // namespace
}  // namespace isoscope::source
