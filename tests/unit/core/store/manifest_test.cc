// The text of a small manifest, and its changes:
//
// - the documented bytes, and the round trip of every double and name;
// - every truncation and flipped bit is DATA_LOSS;
// - wrong members behind a right seal are refused, one by one;
// - optional members, later members, and later versions.

#include "core/store/manifest.h"

#include <cmath>
#include <limits>
#include <string>
#include <utility>
#include <vector>

#include "gmock/gmock.h"
#include "gtest/gtest.h"

#include "core/base/crc32c.h"
#include "core/store/sealed_json.h"
#include "core/store/shard_writer.h"
#include "tests/support/status_matchers.h"

namespace isoscope::store {
namespace {

using ::isoscope::testing::StatusIs;
using ::testing::_;
using ::testing::HasSubstr;

constexpr double kInfinity = std::numeric_limits<double>::infinity();

Manifest MakeManifest() {
  Manifest manifest;
  manifest.dataset_id = "00112233445566778899aabbccddeeff";
  manifest.name = "head";
  manifest.source = "head.nii";
  manifest.geometry.sample_dims = {5, 5, 3};
  manifest.geometry.spacing = {0.5, 0.5, 2};
  manifest.geometry.origin = {-1, 0, 10.25};
  manifest.scalar_type = volume::ScalarType::kInt16;
  manifest.value_range = {.min = -1000, .max = 3071};
  manifest.block_cells = {4, 2, 2};
  manifest.seed = 1;
  manifest.range_table_crc32c = 0x0badcafe;
  manifest.shards = {{.block_count = 2, .block_bytes = 240, .block_index_crc32c = 0x89abcdef}};
  return manifest;
}

// The manifest of docs/format/dataset.md, letter by letter.
constexpr char kText[] = R"({
  "format": "isoscope-dataset",
  "format_version": 1,
  "crc32c": "@@@@@@@@",
  "dataset_id": "00112233445566778899aabbccddeeff",
  "name": "head",
  "source": "head.nii",
  "sample_dims": [
    5,
    5,
    3
  ],
  "scalar_type": "int16",
  "value_range": {
    "min": -1000.0,
    "max": 3071.0
  },
  "spacing": [
    0.5,
    0.5,
    2.0
  ],
  "origin": [
    -1.0,
    0.0,
    10.25
  ],
  "direction": {
    "x": [
      1.0,
      0.0,
      0.0
    ],
    "y": [
      0.0,
      1.0,
      0.0
    ],
    "z": [
      0.0,
      0.0,
      1.0
    ]
  },
  "block_cells": [
    4,
    2,
    2
  ],
  "distribution": "random",
  "seed": 1,
  "range_table_crc32c": "0badcafe",
  "shards": [
    {
      "block_count": 2,
      "block_bytes": 240,
      "block_index_crc32c": "89abcdef"
    }
  ]
}
)";

std::string Replaced(std::string text, const std::string& from, const std::string& to) {
  const std::size_t at = text.find(from);
  EXPECT_NE(at, std::string::npos) << from;
  return text.replace(at, from.size(), to);
}

std::string Sealed(const std::string& text) {
  return SealJson(Replaced(text, "@@@@@@@@", "00000000"));
}

TEST(ManifestTest, BytesStayAsDocumented) {
  // Written out, not computed: a change of it makes datasets on disk unreadable.
  const std::string expected = Replaced(kText, "@@@@@@@@", "68bd3698");
  EXPECT_EQ(EncodeManifest(MakeManifest()), expected);
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(const Manifest decoded, DecodeManifest(expected, "m"));
  EXPECT_EQ(decoded, MakeManifest());
}

TEST(ManifestTest, LabelsAreOptionalAndChecked) {
  Manifest manifest = MakeManifest();
  manifest.labels = {{.value = -2.5},
                     {.value = 3, .name = "left \"lung\"", .color = volume::LabelColor{1, 2, 255}}};
  const std::string bytes = EncodeManifest(manifest);
  EXPECT_THAT(bytes, HasSubstr("\"color\": \"#0102ff\""));
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(const Manifest decoded, DecodeManifest(bytes, "m"));
  EXPECT_EQ(decoded, manifest);
  const std::string seal = "\"crc32c\": \"";
  std::string unsealed = bytes;
  unsealed.replace(unsealed.find(seal) + seal.size(), 8, "00000000");
  const auto refuses = [&](const char* from, const char* to, const char* what) {
    EXPECT_THAT(DecodeManifest(SealJson(Replaced(unsealed, from, to)), "m"),
                StatusIs(absl::StatusCode::kDataLoss, HasSubstr(what)))
        << to;
  };
  refuses("#0102ff", "#0102fg", "color");
  refuses("\"value\": 3.0", "\"value\": -2.5", "after");
  refuses("\"value\": 3.0", "\"value\": \"inf\"", "finite");
  refuses("\"value\": 3.0", "\"value\": true", "value");
  refuses("left ", "left\\u001b", "control");
  refuses("\"name\": \"left", "\"name\": 1, \"x\": \"left", "name");
}

TEST(ManifestTest, NamesOfLabelsMakeAnotherDatasetAndNoneTheSameAsBefore) {
  Manifest manifest = MakeManifest();
  const std::string id = ComputeDatasetId(manifest);
  manifest.labels = {{.value = 3, .name = "lung"}};
  const std::string named = ComputeDatasetId(manifest);
  EXPECT_NE(named, id);
  manifest.labels[0].color = volume::LabelColor{1, 2, 3};
  EXPECT_NE(ComputeDatasetId(manifest), named);
  manifest.labels.clear();
  EXPECT_EQ(ComputeDatasetId(manifest), id);
  EXPECT_EQ(EncodeManifest(manifest).find("labels"), std::string::npos);
}

TEST(ManifestTest, SamplesDigestIsOptionalAndChecked) {
  Manifest manifest = MakeManifest();
  manifest.samples_digest = std::string(32, 'a');
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(const Manifest decoded,
                                DecodeManifest(EncodeManifest(manifest), "m"));
  EXPECT_EQ(decoded, manifest);
  for (const char* wrong : {"a", "AAAAAAAAAAAAAAAAAAAAAAAAAAAAAAAA"}) {
    manifest.samples_digest = wrong;
    EXPECT_THAT(DecodeManifest(EncodeManifest(manifest), "m"),
                StatusIs(absl::StatusCode::kDataLoss, HasSubstr("samples_digest")));
  }
}

TEST(ManifestTest, EveryDoubleRoundTripsExactly) {
  const double values[] = {0.1,
                           1.0 / 3,
                           5e-324,
                           1.7976931348623157e308,
                           -0.0,
                           123456789.123456789,
                           std::nextafter(1.0, 2.0),
                           2.2250738585072011e-308};
  for (const double value : values) {
    Manifest manifest = MakeManifest();
    // Positions end at 1e30: the same digits, in reach.
    const double origin = std::abs(value) < 1e30 ? value : std::ldexp(value, -930);
    manifest.geometry.origin = {origin, -origin, origin};
    manifest.value_range = {.min = -std::abs(value), .max = std::abs(value)};
    ISOSCOPE_ASSERT_OK_AND_ASSIGN(const Manifest decoded,
                                  DecodeManifest(EncodeManifest(manifest), "m"));
    EXPECT_EQ(decoded, manifest);
    EXPECT_EQ(std::signbit(decoded.geometry.origin.x), std::signbit(value));
  }
  Manifest manifest = MakeManifest();
  manifest.value_range = {};  // a volume of NaN: empty, +inf to -inf
  manifest.seed = std::numeric_limits<std::uint64_t>::max();
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(const Manifest decoded,
                                DecodeManifest(EncodeManifest(manifest), "m"));
  EXPECT_EQ(decoded, manifest);
  EXPECT_EQ(decoded.value_range.min, kInfinity);
}

TEST(ManifestTest, NamesThatLookLikeASealOrAreNoUtf8DoNoHarm) {
  Manifest manifest = MakeManifest();
  manifest.name = "a\"crc32c\": \"00000000\"\n\\";
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(const Manifest decoded,
                                DecodeManifest(EncodeManifest(manifest), "m"));
  EXPECT_EQ(decoded, manifest);
  manifest.name = "bad \xff\xfe bytes";
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(const Manifest replaced,
                                DecodeManifest(EncodeManifest(manifest), "m"));
  EXPECT_EQ(replaced.name, "bad \xef\xbf\xbd\xef\xbf\xbd bytes");
}

TEST(ManifestTest, EveryTruncationAndFlippedBitIsDataLoss) {
  const std::string text = EncodeManifest(MakeManifest());
  for (std::size_t size = 0; size < text.size(); ++size) {
    const std::vector<char> exact(text.begin(), text.begin() + static_cast<std::ptrdiff_t>(size));
    ASSERT_THAT(DecodeManifest({exact.data(), exact.size()}, "m"),
                StatusIs(absl::StatusCode::kDataLoss, _));
  }
  for (std::size_t bit = 0; bit < 8 * text.size(); ++bit) {
    std::string damaged = text;
    damaged[bit / 8] =
        static_cast<char>(static_cast<unsigned char>(damaged[bit / 8]) ^ (1u << (bit % 8)));
    ASSERT_THAT(DecodeManifest(damaged, "m"), StatusIs(absl::StatusCode::kDataLoss, _)) << bit;
  }
}

TEST(ManifestTest, WrongMembersAreRefusedEvenWithARightSeal) {
  const std::pair<const char*, const char*> edits[] = {
      {"isoscope-dataset", "isoscope-shard"},
      {"\"format_version\": 1,", ""},
      {"\"format_version\": 1", "\"format_version\": \"1\""},
      {"00112233", "0011223"},
      {"00112233", "0011223X"},
      {"\"name\": \"head\"", "\"name\": 5"},
      {"\"source\": \"head.nii\",", ""},
      {"    5,\n    5", "    5"},
      {"    5,\n    5", "    5,\n    1"},
      {"    5,\n    5", "    5,\n    9223372036854775808"},
      {"    5,\n    5", "    9223372036854775807,\n    9223372036854775807"},
      {"    5,\n    5", "    5,\n    5.0"},
      {"\"int16\"", "\"int64\""},
      {"\"min\": -1000.0", "\"min\": \"nan\""},
      {"\"min\": -1000.0", "\"min\": null"},
      {"\"value_range\": {", "\"value_range\": 1, \"x\": {"},
      {"    0.5,\n    0.5", "    0,\n    0.5"},
      {"    0.5,\n    0.5", "    -0.5,\n    0.5"},
      {"    0.5,\n    0.5", "    \"inf\",\n    0.5"},
      {"      0.0,\n      0.0,\n      1.0", "      0.0,\n      0.0,\n      0.0"},
      {"    4,\n    2,", "    129,\n    2,"},
      {"    4,\n    2,", "    0,\n    2,"},
      {"    4,\n    2,", "    4,\n    1,"},  // then 4 blocks
      {"\"random\"", "\"fair\""},
      {"\"seed\": 1", "\"seed\": -1"},
      {"0badcafe", "0BADCAFE"},
      {"0badcafe", "badcafe"},
      {"\"block_count\": 2", "\"block_count\": 3"},
      {"\"block_count\": 2", "\"block_count\": -2"},
      {"\"shards\": [", "\"shards\": [], \"x\": ["},
      {"\"shards\": [", "\"shards\": [7,"},
      {"{\n  \"format\"", "[{\n  \"format\""},
  };
  for (const auto& [from, to] : edits) {
    EXPECT_THAT(DecodeManifest(Sealed(Replaced(kText, from, to)), "/d/manifest.json"),
                StatusIs(absl::StatusCode::kDataLoss, HasSubstr("/d/manifest.json")))
        << from << " -> " << to;
  }
}

TEST(ManifestTest, LaterMembersAreIgnoredAndLaterVersionsRefused) {
  EXPECT_THAT(
      DecodeManifest(Sealed(Replaced(kText, "\"name\"", "\"later\": {\"a\": [1]}, \"name\"")), "m"),
      ::isoscope::testing::IsOk());
  EXPECT_THAT(DecodeManifest(
                  Sealed(Replaced(kText, "\"format_version\": 1", "\"format_version\": 4")), "m"),
              StatusIs(absl::StatusCode::kFailedPrecondition,
                       "m: format version 4, this program reads up to 3; use a newer program"));
  EXPECT_THAT(DecodeManifest(
                  Sealed(Replaced(kText, "\"format_version\": 1", "\"format_version\": 2")), "m"),
              StatusIs(absl::StatusCode::kFailedPrecondition, HasSubstr("a series")));
}

// 9 x 8 x 5 samples and one level.
Manifest WithLevel() {
  Manifest manifest = MakeManifest();
  manifest.geometry.sample_dims = {9, 8, 5};
  manifest.scalar_type = volume::ScalarType::kUint8;
  manifest.shards = {{.block_count = 16, .block_bytes = 240, .block_index_crc32c = 0x89abcdef}};
  manifest.levels = {{.dataset_id = std::string(32, 'a'), .manifest_crc32c = 0x01020304}};
  return manifest;
}

std::string Unsealed(std::string text) {
  const std::string seal = "\"crc32c\": \"";
  text.replace(text.find(seal) + seal.size(), 8, "00000000");
  return text;
}

TEST(ManifestTest, LevelsMakeVersion3AndKeepTheCrcThatOthersName) {
  const Manifest manifest = WithLevel();
  const std::string bytes = EncodeManifest(manifest);
  EXPECT_THAT(bytes, ::testing::StartsWith("{\n  \"format\": \"isoscope-dataset\",\n"
                                           "  \"format_version\": 3,\n  \"crc32c\": \""));
  EXPECT_THAT(bytes, HasSubstr("\"kind\": \"volume\",\n  \"requires\": [\n    \"levels\"\n  ]"));
  EXPECT_THAT(bytes, HasSubstr("\"value_scale\": 256.0"));
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(const Manifest decoded, DecodeManifest(bytes, "m"));
  EXPECT_EQ(decoded, manifest);
  EXPECT_EQ(decoded.Level(1).grid.sample_dims, (math::Index3{4, 4, 2}));
  EXPECT_EQ(decoded.Level(1).type, volume::ScalarType::kUint16);
  Manifest base = manifest;
  base.levels.clear();
  const std::string base_bytes = EncodeManifest(base);
  EXPECT_THAT(base_bytes, HasSubstr("\"format_version\": 1"));
  EXPECT_EQ(ManifestCrc32c(bytes, "m").value(), ManifestCrc32c(base_bytes, "m").value());
  EXPECT_EQ(ManifestCrc32c(base_bytes, "m").value(), VerifySeal(base_bytes, "m").value());
  EXPECT_NE(VerifySeal(bytes, "m").value(), VerifySeal(base_bytes, "m").value());
  EXPECT_EQ(ComputeDatasetId(manifest), ComputeDatasetId(base));
  std::string damaged = bytes;
  damaged[damaged.size() / 2] ^= 1;
  EXPECT_THAT(ManifestCrc32c(damaged, "m"), StatusIs(absl::StatusCode::kDataLoss));
}

TEST(ManifestTest, LevelsThatCannotBeAreRefused) {
  const std::string text = Unsealed(EncodeManifest(WithLevel()));
  ISOSCOPE_ASSERT_OK(DecodeManifest(SealJson(text), "m").status());
  const auto refuses = [&](const char* from, const char* to, const char* what) {
    EXPECT_THAT(DecodeManifest(SealJson(Replaced(text, from, to)), "m"),
                StatusIs(absl::StatusCode::kDataLoss, HasSubstr(what)))
        << to;
  };
  refuses("\"value_scale\": 256.0", "\"value_scale\": 1.0", "value_scale 1, expected 256");
  refuses("\"level_filter\": \"mean\"", "\"level_filter\": \"median\"", "median");
  refuses("\"level_filter\": \"mean\"", "\"level_filter\": \"majority\"", "value_scale 256");
  refuses("\"levels\": [", "\"levels\": [], \"x\": [", "0 levels, expected 1");
  refuses("\"levels\": [",
          "\"levels\": [{\"dataset_id\": \"\", \"value_scale\": 256, \"manifest_crc32c\": "
          "\"00000001\"},",
          "2 levels, at most 1");
  refuses("\"dataset_id\": \"aaaa", "\"dataset_id\": \"gaaa", "level 1");
  refuses("\"kind\"", "\"sort\"", "kind");
  refuses("\"scalar_type\": \"uint8\"", "\"scalar_type\": \"uint16\"", "expected 1");
  Manifest many = WithLevel();
  many.shards.assign(16, {.block_count = 1, .block_bytes = 15, .block_index_crc32c = 1});
  EXPECT_THAT(DecodeManifest(EncodeManifest(many), "m"),
              StatusIs(absl::StatusCode::kDataLoss, HasSubstr("blocks for 16 shards")));
}

TEST(ManifestTest, WhatAReaderMustKnowIsNamed) {
  const std::string text = Unsealed(EncodeManifest(WithLevel()));
  EXPECT_THAT(
      DecodeManifest(SealJson(Replaced(text, "\"levels\"\n", "\"levels\", \"parts\"\n")), "m"),
      StatusIs(absl::StatusCode::kFailedPrecondition,
               HasSubstr("requires \"parts\", which this program does not know")));
  EXPECT_THAT(DecodeManifest(SealJson(Replaced(text, "\"volume\"", "\"series\"")), "m"),
              StatusIs(absl::StatusCode::kFailedPrecondition, HasSubstr("a series")));
  EXPECT_THAT(DecodeManifest(SealJson(Replaced(text, "\"volume\"", "\"index\"")), "m"),
              StatusIs(absl::StatusCode::kFailedPrecondition,
                       HasSubstr("kind \"index\", which this program does not know")));
}

Manifest IndexOnly() {
  Manifest manifest = MakeManifest();
  manifest.in_source = {.request = {{"path", "/data/head.zarr"}, {"stride", "2"}},
                        .unit_origin = {-1, 0, 0},
                        .unit_dims = {4, 4, 2}};
  return manifest;
}

TEST(ManifestTest, SamplesInTheSourceMakeVersion3) {
  const Manifest manifest = IndexOnly();
  const std::string bytes = EncodeManifest(manifest);
  EXPECT_THAT(bytes, HasSubstr("\"format_version\": 3"));
  EXPECT_THAT(bytes,
              HasSubstr("\"kind\": \"volume\",\n  \"requires\": [\n    \"index_only\"\n  ],\n"
                        "  \"in_source\": {\n    \"request\": {\n      \"path\": "
                        "\"/data/head.zarr\",\n      \"stride\": \"2\"\n    },\n"
                        "    \"unit_origin\": [\n      -1,\n      0,\n      0\n    ],"));
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(const Manifest decoded, DecodeManifest(bytes, "m"));
  EXPECT_EQ(decoded, manifest);
  EXPECT_EQ(ManifestCrc32c(bytes, "m").value(), VerifySeal(bytes, "m").value());
  EXPECT_NE(ComputeDatasetId(manifest), ComputeDatasetId(MakeManifest()));
  Manifest elsewhere = manifest;
  elsewhere.in_source->request["path"] = "/data/foot.zarr";
  EXPECT_NE(ComputeDatasetId(manifest), ComputeDatasetId(elsewhere));
  // Levels come and go without a change of the checksum that others name.
  Manifest with = WithLevel();
  Manifest without = with;
  without.levels.clear();
  with.in_source = without.in_source = manifest.in_source;
  const std::string with_bytes = EncodeManifest(with);
  EXPECT_EQ(DecodeManifest(with_bytes, "m").value(), with);
  EXPECT_EQ(ManifestCrc32c(with_bytes, "m").value(),
            ManifestCrc32c(EncodeManifest(without), "m").value());
}

TEST(ManifestTest, SamplesInASourceThatCannotBeAreRefused) {
  const std::string text = Unsealed(EncodeManifest(IndexOnly()));
  ISOSCOPE_ASSERT_OK(DecodeManifest(SealJson(text), "m").status());
  const auto refuses = [&](const char* from, const char* to, const char* what) {
    EXPECT_THAT(DecodeManifest(SealJson(Replaced(text, from, to)), "m"),
                StatusIs(absl::StatusCode::kDataLoss, HasSubstr(what)))
        << to;
  };
  refuses("\"path\"", "\"pathos\"", "path");
  refuses("\"stride\": \"2\"", "\"stride\": 2", "stride");
  refuses("\"unit_origin\": [\n      -1", "\"unit_origin\": [\n      1", "unit_origin");
  refuses("\"unit_origin\": [\n      -1", "\"unit_origin\": [\n      -4", "units of 4 x 4 x 2");
  refuses("\"unit_dims\": [\n      4", "\"unit_dims\": [\n      0", "unit_dims");
  refuses("\"unit_dims\": [\n      4", "\"unit_dims\": [\n      5000000", "units of 5000000");
  refuses("\"in_source\"", "\"at_source\"", "level_filter");
  refuses("\"request\": {", "\"request\": [], \"x\": {", "request");
  Manifest many = IndexOnly();
  for (int i = 0; i < 64; ++i) {
    many.in_source->request[std::to_string(i)] = "";
  }
  EXPECT_THAT(DecodeManifest(EncodeManifest(many), "m"),
              StatusIs(absl::StatusCode::kDataLoss, HasSubstr("66 members")));
  Manifest long_text = IndexOnly();
  long_text.in_source->request["path"] = std::string(kMaxRequestBytes + 1, 'a');
  EXPECT_THAT(DecodeManifest(EncodeManifest(long_text), "m"),
              StatusIs(absl::StatusCode::kDataLoss, HasSubstr("65537 bytes")));
}

TEST(ManifestTest, DeepNestingNeitherCrashesNorThrows) {
  const std::string deep(100000, '[');
  EXPECT_THAT(DecodeManifest(SealJson("{\"crc32c\": \"00000000\", \"a\": " + deep), "m"),
              StatusIs(absl::StatusCode::kDataLoss, _));
}

TEST(ManifestTest, DistributionNamesRoundTrip) {
  for (const Distribution distribution : {Distribution::kRandom, Distribution::kGreedy}) {
    ISOSCOPE_ASSERT_OK_AND_ASSIGN(const Distribution named,
                                  DistributionFromName(NameOf(distribution)));
    EXPECT_EQ(named, distribution);
  }
  EXPECT_THAT(DistributionFromName("fair"),
              StatusIs(absl::StatusCode::kInvalidArgument, HasSubstr("random or greedy")));
}

// A manifest with a patient frame, sealed anew.
std::string TextWithFrame(const Manifest& manifest, const std::string& value) {
  Manifest with = manifest;
  with.patient_frame.emplace();
  std::string text = EncodeManifest(with);
  const std::size_t digits = text.find("\"crc32c\": \"") + 11;
  text.replace(digits, 8, "00000000");
  return SealJson(Replaced(text, "\"LPS\"", value));
}

TEST(ManifestTest, APatientFrameIsOptionalAndKept) {
  Manifest manifest =
      DecodeManifest(SealJson(Replaced(kText, "@@@@@@@@", "00000000")), "m").value();
  EXPECT_FALSE(manifest.patient_frame.has_value());
  const std::string id_without = ComputeDatasetId(manifest);
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(manifest.patient_frame, volume::PatientFrame::FromName("RAS"));
  const std::string bytes = EncodeManifest(manifest);
  EXPECT_NE(bytes.find("\"patient_frame\": \"RAS\""), std::string::npos);
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(const Manifest decoded, DecodeManifest(bytes, "m"));
  EXPECT_EQ(decoded, manifest);
  EXPECT_NE(ComputeDatasetId(manifest), id_without) << "another world is another dataset";
}

TEST(ManifestTest, APatientFrameThatIsNoneIsDamage) {
  const Manifest manifest =
      DecodeManifest(SealJson(Replaced(kText, "@@@@@@@@", "00000000")), "m").value();
  ISOSCOPE_EXPECT_OK(DecodeManifest(TextWithFrame(manifest, "\"RAS\""), "m").status());
  for (const char* value : {"\"XYZ\"", "\"LP\"", "7", "null", "[\"L\", \"P\", \"S\"]"}) {
    EXPECT_THAT(DecodeManifest(TextWithFrame(manifest, value), "m"),
                StatusIs(absl::StatusCode::kDataLoss, HasSubstr("patient")))
        << value;
  }
}

TEST(ManifestTest, TheRangeOfFiniteSamplesIsOptionalAndKept) {
  Manifest manifest = MakeManifest();
  const std::string id_without = ComputeDatasetId(manifest);
  EXPECT_FALSE(DecodeManifest(EncodeManifest(manifest), "m")->finite_range.has_value());
  manifest.value_range = {-kInfinity, 9};
  const std::string id_of_infinite = ComputeDatasetId(manifest);
  EXPECT_NE(id_of_infinite, id_without);
  for (const volume::ScalarSpan& range :
       {volume::ScalarSpan{-1.0 / 3, 9}, {7, 7}, {kInfinity, -kInfinity}}) {
    manifest.finite_range = range;
    ISOSCOPE_ASSERT_OK_AND_ASSIGN(const Manifest decoded,
                                  DecodeManifest(EncodeManifest(manifest), "m"));
    EXPECT_EQ(decoded, manifest);
  }
  EXPECT_EQ(ComputeDatasetId(manifest), id_of_infinite) << "it follows from the samples";
}

TEST(ManifestTest, ARangeOfFiniteSamplesThatIsNoneIsDamage) {
  Manifest manifest = MakeManifest();
  const auto expect_damage = [&](const volume::ScalarSpan& all, const volume::ScalarSpan& finite) {
    manifest.value_range = all;
    manifest.finite_range = finite;
    EXPECT_THAT(DecodeManifest(EncodeManifest(manifest), "m"),
                StatusIs(absl::StatusCode::kDataLoss, HasSubstr("finite_range")))
        << finite.min << ", " << finite.max;
  };
  expect_damage({-kInfinity, 9}, {-kInfinity, 9});
  expect_damage({-kInfinity, 9}, {0, 10});
  expect_damage({-2, kInfinity}, {-3, 10});
  expect_damage({-kInfinity, kInfinity}, {5, 4});
  expect_damage({-kInfinity, kInfinity}, {5, kInfinity});
  expect_damage({0, 9}, {0, 9});
}

// A manifest with a bound of the gradient, sealed anew.
std::string TextWithBound(const Manifest& manifest, const std::string& value) {
  Manifest with = manifest;
  with.max_gradient_magnitude = 7777;
  std::string text = EncodeManifest(with);
  const std::size_t digits = text.find("\"crc32c\": \"") + 11;
  text.replace(digits, 8, "00000000");
  return SealJson(Replaced(text, "7777.0", value));
}

TEST(ManifestTest, ABoundOfTheGradientIsOptionalAndKept) {
  Manifest manifest =
      DecodeManifest(SealJson(Replaced(kText, "@@@@@@@@", "00000000")), "m").value();
  EXPECT_FALSE(manifest.max_gradient_magnitude.has_value());
  const std::string id_without = ComputeDatasetId(manifest);
  for (const double bound : {0.0, 1.0 / 3, 1.7976931348623157e308}) {
    manifest.max_gradient_magnitude = bound;
    ISOSCOPE_ASSERT_OK_AND_ASSIGN(const Manifest decoded,
                                  DecodeManifest(EncodeManifest(manifest), "m"));
    EXPECT_EQ(decoded, manifest);
  }
  EXPECT_EQ(ComputeDatasetId(manifest), id_without) << "it follows from the samples";
}

TEST(ManifestTest, ABoundOfTheGradientThatIsNoneIsDamage) {
  const Manifest manifest =
      DecodeManifest(SealJson(Replaced(kText, "@@@@@@@@", "00000000")), "m").value();
  ISOSCOPE_EXPECT_OK(DecodeManifest(TextWithBound(manifest, "2"), "m").status());
  for (const char* value : {"-1", "\"inf\"", "\"-inf\"", "\"nan\"", "null", "[1]", "1e999"}) {
    EXPECT_THAT(DecodeManifest(TextWithBound(manifest, value), "m"),
                StatusIs(absl::StatusCode::kDataLoss, _))
        << value;
  }
}

}  // namespace
}  // namespace isoscope::store
