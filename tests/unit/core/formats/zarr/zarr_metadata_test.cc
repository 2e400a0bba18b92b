#include "core/formats/zarr/zarr_metadata.h"

#include <string>

#include "absl/strings/escaping.h"
#include "absl/strings/str_replace.h"
#include "gmock/gmock.h"
#include "gtest/gtest.h"

#include "tests/support/status_matchers.h"
#include "tests/unit/core/formats/zarr/zarr_files.h"

namespace isoscope::source {
namespace {

using ::isoscope::testing::StatusIs;
using ::isoscope::testing::Zarr2Text;
using ::isoscope::testing::Zarr3Text;
using ::testing::ElementsAre;
using ::testing::HasSubstr;
using ::testing::IsEmpty;

constexpr auto kInvalid = absl::StatusCode::kInvalidArgument;

absl::StatusOr<ZarrArray> Parse2(const std::string& text, const std::string& attributes = "{}") {
  return ParseZarr2Array(ZarrJson::parse(text), ZarrJson::parse(attributes), "a/b", "f:a/b");
}
absl::StatusOr<ZarrArray> Parse3(const std::string& text) {
  return ParseZarr3Array(ZarrJson::parse(text), "a/b", "f:a/b");
}
std::string Codecs(const ZarrArray& array) {
  std::string names;
  for (const CodecSpec& codec : array.codecs) {
    absl::StrAppend(&names, codec.name, codec.configuration.dump(), " ");
  }
  return names;
}

// As zarr-python 2.13 writes it.
TEST(ZarrMetadataTest, ReadsZarr2) {
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(
      const ZarrArray array,
      Parse2(R"({"chunks": [2, 3, 4], "compressor": {"blocksize": 0, "clevel": 5, "cname": "lz4",
                 "id": "blosc", "shuffle": 1}, "dimension_separator": "/", "dtype": ">i2",
                 "fill_value": -3, "filters": [{"dtype": ">i2", "astype": ">i2", "id": "delta"}],
                 "order": "F", "shape": [5, 6, 7], "zarr_format": 2})",
             R"({"_ARRAY_DIMENSIONS": ["z", "y", "x"], "units": "K"})"));
  EXPECT_THAT(array.dims, ElementsAre(5, 6, 7));
  EXPECT_THAT(array.chunk_dims, ElementsAre(2, 3, 4));
  EXPECT_EQ(array.type, NumberType::kInt16);
  EXPECT_EQ(absl::BytesToHexString(array.fill), "fdff");
  EXPECT_TRUE(array.has_fill);
  EXPECT_THAT(Codecs(array), HasSubstr("transpose{\"order\":\"F\"} bytes{\"endian\":\"big\"} "
                                       "delta{\"astype\":\">i2\",\"dtype\":\">i2\"} blosc{"));
  EXPECT_THAT(array.dimension_names, ElementsAre("z", "y", "x"));
  EXPECT_EQ(array.KeyOf({1, 0, 2}), "a/b/1/0/2");
  EXPECT_EQ(array.SpecOf("n").key_of({1, 0, 2}), "a/b/1/0/2");
}

TEST(ZarrMetadataTest, ReadsKeysAndFills) {
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(const ZarrArray plain, Parse2(Zarr2Text({4}, {2}, "<f4")));
  EXPECT_EQ(plain.KeyOf({1}), "a/b/1");
  EXPECT_THAT(plain.dimension_names, IsEmpty());
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(const ZarrArray open,
                                Parse2(Zarr2Text({4, 4}, {2, 2}, "<f4", ", \"fill_value\": null")));
  EXPECT_FALSE(open.has_fill);
  EXPECT_EQ(open.fill, std::string(4, '\0'));
  EXPECT_EQ(open.KeyOf({1, 0}), "a/b/1.0");
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(const ZarrArray nan,
                                Parse2(Zarr2Text({4}, {2}, "<f8", ", \"fill_value\": \"NaN\"")));
  EXPECT_EQ(absl::BytesToHexString(nan.fill), "000000000000f87f");
  // As n5-zarr and jzarr (bioformats2raw) write it.
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(const ZarrArray text,
                                Parse2(Zarr2Text({4}, {2}, "<i2", ", \"fill_value\": \"-3\"")));
  EXPECT_TRUE(text.has_fill);
  EXPECT_EQ(absl::BytesToHexString(text.fill), "fdff");
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(const ZarrArray real,
                                Parse2(Zarr2Text({4}, {2}, "<f4", ", \"fill_value\": \"0.5\"")));
  EXPECT_EQ(absl::BytesToHexString(real.fill), "0000003f");
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(
      const ZarrArray v2,
      Parse3(Zarr3Text({4, 4}, {2, 2}, "uint8", R"(, "chunk_key_encoding": {"name": "v2"})")));
  EXPECT_EQ(v2.KeyOf({1, 0}), "a/b/1.0");
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(const ZarrArray dots,
                                Parse3(Zarr3Text({4, 4}, {2, 2}, "uint8",
                                                 R"(, "chunk_key_encoding": {"name": "default",
                              "configuration": {"separator": "."}})")));
  EXPECT_EQ(dots.KeyOf({1, 0}), "a/b/c.1.0");
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(
      const ZarrArray v3,
      Parse3(Zarr3Text({4, 4}, {2, 2}, "float32",
                       R"(, "fill_value": "0x7fc00001", "dimension_names": ["y", null],
                          "storage_transformers": [], "later": {"must_understand": false},
                          "attributes": {"a": 1})")));
  EXPECT_EQ(v3.KeyOf({1, 0}), "a/b/c/1/0");
  EXPECT_EQ(absl::BytesToHexString(v3.fill), "0100c07f");
  EXPECT_THAT(v3.dimension_names, ElementsAre("y", ""));
  EXPECT_EQ(v3.attributes["a"], 1);
}

TEST(ZarrMetadataTest, ReadsTimesOfNumpy) {
  const std::string text = absl::StrReplaceAll(
      Zarr3Text({4}, {2}, "TYPE", ", \"fill_value\": \"NaT\""),
      {{"\"TYPE\"", R"({"name": "numpy.datetime64", "configuration": {"unit": "ms",
                        "scale_factor": 10}})"}});
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(const ZarrArray array, Parse3(text));
  ASSERT_TRUE(array.time.has_value());
  EXPECT_EQ(array.type, NumberType::kInt64);
  EXPECT_EQ(array.time->units, "seconds since 1970-01-01");
  EXPECT_EQ(array.time->multiple, 10);
  EXPECT_EQ(array.time->divisor, 1000);
  EXPECT_EQ(absl::BytesToHexString(array.fill), "0000000000000080");
  EXPECT_THAT(Parse3(absl::StrReplaceAll(text, {{"\"ms\"", "\"generic\""}})),
              StatusIs(kInvalid, HasSubstr("f:a/b: times of 10 \"generic\"")));
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(const ZarrArray numbers, Parse2(Zarr2Text({4}, {2}, "<u2")));
  EXPECT_FALSE(numbers.time.has_value());
}

TEST(ZarrMetadataTest, RefusesByName) {
  const std::string good2 = Zarr2Text({4, 4}, {2, 2}, "<u2");
  const struct {
    const char* from;
    const char* to;
    const char* said;
  } kZarr2[] = {{"\"zarr_format\": 2", "\"zarr_format\": 1", "zarr_format"},
                {"[4, 4]", "[4, -4]", "shape"},
                {"[4, 4]", "[4, 4.5]", "shape"},
                {"[4, 4]", "[4, 18446744073709551615]", "shape"},
                {"[4, 4]", "\"4\"", "shape"},
                {"\"chunks\"", "\"junks\"", "chunks is missing"},
                {"\"<u2\"", "\"<c8\"", "<c8"},
                {"\"<u2\"", "[[\"a\", \"<u2\"]]", "dtype"},
                {"\"<u2\"", "\"<M8[Y]\"", "years and months"},
                {"\"<u2\"", "\"<M8\"", "years and months"},
                {"\"<u2\"", "\"<m8[0s]\"", "times of 0"},
                {"\"<u2\"", "\"<m8[99999999999s]\"", "times of 1"},
                {"\"fill_value\": 0", "\"fill_value\": 70000", "70000"},
                {"\"fill_value\": 0", "\"fill_value\": \"AAA=\"", "fill_value"},
                {"\"fill_value\": 0", "\"fill_value\": \"70000\"", "70000"},
                {"\"fill_value\": 0", "\"fill_value\": \"[0]\"", "fill_value"},
                {"\"order\": \"C\"", "\"order\": \"K\"", "order"},
                {"\"filters\": null", "\"filters\": {}", "filters"},
                {"\"filters\": null", "\"filters\": [3]", "filters"},
                {"\"compressor\": null", "\"compressor\": {\"name\": \"gzip\"}", "compressor"}};
  for (const auto& change : kZarr2) {
    const std::string text = absl::StrReplaceAll(good2, {{change.from, change.to}});
    ASSERT_NE(text, good2) << change.from;
    EXPECT_THAT(Parse2(text), StatusIs(kInvalid, HasSubstr(change.said))) << text;
    EXPECT_THAT(Parse2(text), StatusIs(kInvalid, HasSubstr("f:a/b: "))) << text;
  }
  const std::string good3 = Zarr3Text({4, 4}, {2, 2}, "uint16");
  const struct {
    const char* from;
    const char* to;
    const char* said;
  } kZarr3[] = {{"\"zarr_format\": 3", "\"zarr_format\": 4", "zarr_format"},
                {"\"uint16\"", "\"complex64\"", "complex64"},
                {"\"uint16\"", R"({"name": "numpy.datetime64", "configuration": {"unit": "Y"}})",
                 "years and months"},
                {"\"regular\"", "\"rectilinear\"", "rectilinear"},
                {"\"default\"", "\"suffix\"", "suffix"},
                {", \"fill_value\": 0", "", "fill_value"},
                {"\"codecs\"", "\"kodecs\"", "kodecs"},
                {"\"fill_value\": 0", "\"fill_value\": 0, \"sharding\": {\"a\": 1}", "sharding"},
                {"\"fill_value\": 0", "\"fill_value\": 0, \"storage_transformers\": [{}]",
                 "storage_transformers"},
                {"\"fill_value\": 0", "\"fill_value\": null, \"x\": 3", "\"x\""}};
  for (const auto& change : kZarr3) {
    const std::string text = absl::StrReplaceAll(good3, {{change.from, change.to}});
    ASSERT_NE(text, good3) << change.from;
    EXPECT_THAT(Parse3(text), StatusIs(kInvalid, HasSubstr(change.said))) << text;
  }
}

}  // namespace
}  // namespace isoscope::source
