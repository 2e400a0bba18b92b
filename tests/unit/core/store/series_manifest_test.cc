#include "core/store/series_manifest.h"

#include <cmath>
#include <limits>
#include <string>
#include <utility>
#include <vector>

#include "gmock/gmock.h"
#include "gtest/gtest.h"

#include "core/io/file.h"
#include "core/store/manifest.h"
#include "core/store/sealed_json.h"
#include "core/store/shard_format.h"
#include "core/store/shard_reader.h"
#include "tests/support/status_matchers.h"
#include "tests/support/temp_dir.h"
#include "tests/support/volume_files.h"

namespace isoscope::store {
namespace {

using ::isoscope::testing::StatusIs;
using ::testing::_;
using ::testing::HasSubstr;

constexpr double kInfinity = std::numeric_limits<double>::infinity();

// Pressure and velocity (two components) at two times; the second step has no velocity.
SeriesManifest MakeSeries() {
  SeriesManifest series;
  series.dataset_id = "00112233445566778899aabbccddeeff";
  series.name = "flow";
  series.source = "flow.pvd";
  series.geometry.sample_dims = {5, 5, 3};
  series.geometry.spacing = {0.5, 0.5, 2};
  series.geometry.origin = {-1, 0, 10.25};
  series.length_unit = "m";
  series.block_cells = {4, 2, 2};
  series.seed = 1;
  series.shard_count = 2;
  series.fields = {
      {.name = "p",
       .long_name = "pressure",
       .unit = "Pa",
       .components = {{.name = "", .scalar_type = volume::ScalarType::kFloat32}}},
      {.name = "u",
       .long_name = "",
       .unit = "",
       .components = {{.name = "x", .scalar_type = volume::ScalarType::kInt16},
                      {.name = "y", .scalar_type = volume::ScalarType::kInt16},
                      {.name = "magnitude", .scalar_type = volume::ScalarType::kFloat32}}}};
  series.times = {0, 0.25};
  series.time_unit = "s";
  series.volumes = {{.key = {0, 0, 0},
                     .dataset_id = std::string(32, '0'),
                     .manifest_crc32c = 0x0badcafe,
                     .value_range = {-1, 2.5},
                     .max_gradient_magnitude = 0.75},
                    {.key = {1, 0, 0},
                     .dataset_id = std::string(32, '1'),
                     .manifest_crc32c = 1,
                     .value_range = {kInfinity, -kInfinity}},
                    {.key = {1, 1, 0},
                     .dataset_id = std::string(32, '2'),
                     .manifest_crc32c = 2,
                     .value_range = {0, 1}},
                    {.key = {1, 2, 0},
                     .dataset_id = std::string(32, '3'),
                     .manifest_crc32c = 3,
                     .value_range = {0, 1}},
                    {.key = {0, 0, 1},
                     .dataset_id = std::string(32, '4'),
                     .manifest_crc32c = 4,
                     .value_range = {0, 1}}};
  return series;
}

// The manifest of docs/format/dataset.md, letter by letter.
constexpr char kText[] = R"({
  "format": "isoscope-dataset",
  "format_version": 2,
  "crc32c": "@@@@@@@@",
  "dataset_id": "00112233445566778899aabbccddeeff",
  "name": "flow",
  "source": "flow.pvd",
  "sample_dims": [
    5,
    5,
    3
  ],
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
  "length_unit": "m",
  "block_cells": [
    4,
    2,
    2
  ],
  "distribution": "random",
  "seed": 1,
  "shard_count": 2,
  "fields": [
    {
      "name": "p",
      "long_name": "pressure",
      "unit": "Pa",
      "components": [
        {
          "name": "",
          "scalar_type": "float32"
        }
      ]
    },
    {
      "name": "u",
      "components": [
        {
          "name": "x",
          "scalar_type": "int16"
        },
        {
          "name": "y",
          "scalar_type": "int16"
        },
        {
          "name": "magnitude",
          "scalar_type": "float32"
        }
      ]
    }
  ],
  "times": [
    0.0,
    0.25
  ],
  "time_unit": "s",
  "volumes": [
    {"field":0,"component":0,"step":0,"dataset_id":"00000000000000000000000000000000","manifest_crc32c":"0badcafe","min":-1.0,"max":2.5,"max_gradient_magnitude":0.75},
    {"field":1,"component":0,"step":0,"dataset_id":"11111111111111111111111111111111","manifest_crc32c":"00000001","min":"inf","max":"-inf"},
    {"field":1,"component":1,"step":0,"dataset_id":"22222222222222222222222222222222","manifest_crc32c":"00000002","min":0.0,"max":1.0},
    {"field":1,"component":2,"step":0,"dataset_id":"33333333333333333333333333333333","manifest_crc32c":"00000003","min":0.0,"max":1.0},
    {"field":0,"component":0,"step":1,"dataset_id":"44444444444444444444444444444444","manifest_crc32c":"00000004","min":0.0,"max":1.0}
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

TEST(SeriesManifestTest, BytesStayAsDocumented) {
  // Written out, not computed: a change of it makes datasets on disk unreadable.
  const std::string expected = Replaced(kText, "@@@@@@@@", "ef40aa1e");
  EXPECT_EQ(EncodeSeriesManifest(MakeSeries()), expected);
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(const SeriesManifest decoded, DecodeSeriesManifest(expected, "m"));
  EXPECT_EQ(decoded, MakeSeries());
}

TEST(SeriesManifestTest, MembersThatMayBeEmptyRoundTrip) {
  SeriesManifest series = MakeSeries();
  series.patient_frame = volume::PatientFrame();
  series.length_unit.clear();
  series.time_unit.clear();
  series.times.clear();
  series.fields.resize(1);
  series.fields[0].long_name.clear();
  series.fields[0].unit.clear();
  series.volumes.resize(1);
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(const SeriesManifest decoded,
                                DecodeSeriesManifest(EncodeSeriesManifest(series), "m"));
  EXPECT_EQ(decoded, series);
  EXPECT_EQ(decoded.step_count(), 1);
}

TEST(SeriesManifestTest, DoublesAndOddNamesRoundTrip) {
  SeriesManifest series = MakeSeries();
  series.times = {-1e300, std::nextafter(-0.1, 0)};
  series.volumes[0].value_range = {5e-324, 1.0 / 3};
  series.name = "a\"crc32c\": \"00000000\"\n\\";
  series.fields[0].name = "\"format_version\": 1,\n\"crc32c\": \"00000000\"";
  series.fields[0].unit = "\xc2\xb5m/s\xc2\xb2";
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(const SeriesManifest decoded,
                                DecodeSeriesManifest(EncodeSeriesManifest(series), "m"));
  EXPECT_EQ(decoded, series);
}

TEST(SeriesManifestTest, TheRangeOfFiniteSamplesIsKeptAndChecked) {
  SeriesManifest series = MakeSeries();
  series.volumes[0].value_range = {-1, kInfinity};
  series.volumes[0].finite_range = volume::ScalarSpan{-1, 2.5};
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(const SeriesManifest decoded,
                                DecodeSeriesManifest(EncodeSeriesManifest(series), "m"));
  EXPECT_EQ(decoded, series);
  series.volumes[0].finite_range->max = kInfinity;
  EXPECT_THAT(DecodeSeriesManifest(EncodeSeriesManifest(series), "m"),
              StatusIs(absl::StatusCode::kDataLoss, HasSubstr("finite_range")));
}

TEST(SeriesManifestTest, FindsWhatIsThere) {
  const SeriesManifest series = MakeSeries();
  for (const ScalarVolume& volume : series.volumes) {
    EXPECT_EQ(series.Find(volume.key), &volume);
  }
  for (const ScalarVolumeKey missing :
       {ScalarVolumeKey{1, 0, 1}, ScalarVolumeKey{0, 0, 2}, ScalarVolumeKey{0, 1, 0}}) {
    EXPECT_EQ(series.Find(missing), nullptr);
  }
  EXPECT_EQ(ScalarVolumeDirectoryName({.field = 12, .component = 3, .step = 45}),
            "field-012-component-3-step-00045");
  EXPECT_EQ(ScalarVolumeDirectoryName({.field = 0, .component = 0, .step = 99'999}),
            "field-000-component-0-step-99999");
}

TEST(SeriesManifestTest, EveryTruncationAndFlippedBitIsDataLoss) {
  const std::string text = EncodeSeriesManifest(MakeSeries());
  for (std::size_t size = 0; size < text.size(); ++size) {
    const std::vector<char> exact(text.begin(), text.begin() + static_cast<std::ptrdiff_t>(size));
    ASSERT_THAT(DecodeSeriesManifest({exact.data(), exact.size()}, "m"),
                StatusIs(absl::StatusCode::kDataLoss, _));
  }
  for (std::size_t bit = 0; bit < 8 * text.size(); ++bit) {
    std::string damaged = text;
    damaged[bit / 8] =
        static_cast<char>(static_cast<unsigned char>(damaged[bit / 8]) ^ (1u << (bit % 8)));
    ASSERT_THAT(DecodeSeriesManifest(damaged, "m"), StatusIs(absl::StatusCode::kDataLoss, _))
        << bit;
  }
}

TEST(SeriesManifestTest, ContradictionsAreRefusedEvenWithARightSeal) {
  const std::pair<const char*, const char*> edits[] = {
      {"isoscope-dataset", "isoscope-shard"},
      {"\"format_version\": 2,", ""},
      {"00112233", "0011223"},
      {"\"name\": \"flow\"", "\"name\": 5"},
      {"\"source\": \"flow.pvd\",", ""},
      {"    5,\n    5", "    5"},
      {"    5,\n    5", "    5,\n    1"},
      {"    0.5,\n    0.5", "    0,\n    0.5"},
      {"      0.0,\n      0.0,\n      1.0", "      0.0,\n      0.0,\n      0.0"},
      {"\"length_unit\": \"m\"", "\"length_unit\": 1"},
      {"    4,\n    2,", "    129,\n    2,"},
      {"\"random\"", "\"greedy\""},
      {"\"seed\": 1", "\"seed\": -1"},
      {"\"shard_count\": 2", "\"shard_count\": 0"},
      {"\"shard_count\": 2", "\"shard_count\": 3"},  // two blocks
      {"\"shard_count\": 2", "\"shard_count\": 65537"},
      {"\"fields\": [", "\"fields\": [], \"x\": ["},
      {"\"fields\": [", "\"fields\": [1,"},
      {"\"name\": \"p\"", "\"name\": \"\""},
      {"\"name\": \"p\"", "\"name\": \"u\""},
      {"\"unit\": \"Pa\"", "\"unit\": []"},
      {"\"name\": \"\"", "\"name\": \"x\""},
      {"\"name\": \"x\"", "\"name\": \"\""},
      {"\"name\": \"x\"", "\"name\": \"y\""},
      {"\"name\": \"x\"", "\"name\": \"magnitude\""},
      {"\"magnitude\"", "\"z\""},
      {"\"int16\"", "\"int12\""},
      {"    0.0,\n    0.25", "    0.25,\n    0.25"},
      {"    0.0,\n    0.25", "    1.0,\n    0.25"},
      {"    0.0,\n    0.25", "    0.0,\n    \"inf\""},
      {"    0.0,\n    0.25", "    0.0"},
      {"    0.0,\n    0.25", "    0.0,\n    null"},
      {"\"times\": [", "\"times\": [], \"x\": ["},
      {"\"times\": [", "\"times\": 3, \"x\": ["},
      {"\"time_unit\": \"s\"", "\"time_unit\": {}"},
      {"\"volumes\": [", "\"volumes\": [], \"x\": ["},
      {"\"volumes\": [", "\"volumes\": {}, \"x\": ["},
      {"\"volumes\": [", "\"volumes\": [[],"},
      {"{\"field\":0", "{\"field\":2"},
      {"{\"field\":0", "{\"field\":-1"},
      {"{\"field\":0", "{\"field\":0.5"},
      {"{\"field\":0", "{\"field\":1"},  // twice
      {"\"component\":1,\"step\":0", "\"component\":0,\"step\":0"},
      {"\"component\":0,\"step\":1", "\"component\":1,\"step\":1"},
      {"\"component\":2,\"step\":0", "\"component\":3,\"step\":0"},
      {"\"component\":0,\"step\":1", "\"component\":0,\"step\":2"},
      {"\"component\":0,\"step\":0", "\"component\":0,\"step\":1"},  // not ascending
      {"\"component\":0,\"step\":1", "\"component\":0,\"step\":4294967297"},
      {"3333333333", "333333333"},
      {"3333333333", "333333333G"},
      {"\"0badcafe\"", "\"0BADCAFE\""},
      {"\"min\":-1.0", "\"min\":\"nan\""},
      {"\"min\":-1.0", "\"min\":null"},
      {":0.75", ":-0.75"},
      {":0.75", ":\"inf\""},
      {":0.75", ":1e999"}};
  for (const auto& [from, to] : edits) {
    EXPECT_THAT(DecodeSeriesManifest(Sealed(Replaced(kText, from, to)), "the file"),
                StatusIs(absl::StatusCode::kDataLoss, HasSubstr("the file")))
        << from << " -> " << to;
  }
  // The edits are what is refused.
  ISOSCOPE_EXPECT_OK(DecodeSeriesManifest(Sealed(kText), "m").status());
}

TEST(SeriesManifestTest, VersionsDoNotMix) {
  EXPECT_THAT(DecodeSeriesManifest(Sealed(Replaced(kText, "version\": 2", "version\": 4")), "m"),
              StatusIs(absl::StatusCode::kFailedPrecondition,
                       HasSubstr("format version 4, this program reads up to 3")));
  EXPECT_THAT(DecodeSeriesManifest(Sealed(Replaced(kText, "version\": 2", "version\": 1")), "m"),
              StatusIs(absl::StatusCode::kFailedPrecondition, HasSubstr("no series")));
  EXPECT_THAT(DecodeManifest(Sealed(kText), "m"),
              StatusIs(absl::StatusCode::kFailedPrecondition,
                       "m: format version 2, a series, expected a dataset of one field and step"));
  ISOSCOPE_EXPECT_OK(
      DecodeSeriesManifest(Sealed(Replaced(kText, "\"seed\"", "\"later\": [{}], \"seed\"")), "m")
          .status());
}

TEST(SeriesManifestTest, LevelsMakeVersion3) {
  SeriesManifest series = MakeSeries();
  series.geometry.sample_dims = {8, 8, 8};
  EXPECT_EQ(series.highest_level(), 0);
  series.volumes[0].highest_level = 2;
  series.volumes[1].highest_level = 1;
  series.volumes[1].level_filter = volume::LevelFilter::kMajority;
  EXPECT_EQ(series.highest_level(), 2);
  const std::string bytes = EncodeSeriesManifest(series);
  EXPECT_THAT(bytes, HasSubstr("\"format_version\": 3,"));
  EXPECT_THAT(bytes, HasSubstr("\"kind\": \"series\""));
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(const SeriesManifest decoded, DecodeSeriesManifest(bytes, "m"));
  EXPECT_EQ(decoded, series);
  EXPECT_THAT(DecodeManifest(bytes, "m"),
              StatusIs(absl::StatusCode::kFailedPrecondition, HasSubstr("a series")));
  series.volumes[0].highest_level = 3;
  EXPECT_THAT(
      DecodeSeriesManifest(EncodeSeriesManifest(series), "m"),
      StatusIs(absl::StatusCode::kDataLoss, HasSubstr("highest_level\" is 3: expected at most 2")));
}

class SeriesDirectoryTest : public ::testing::Test {
 protected:
  SeriesDirectoryTest() : directory_(temp_.Sub("flow")) {
    ISOSCOPE_EXPECT_OK(io::CreateDirectory(directory_));
  }
  // The folders and descriptions, without volumes.
  void Write(const SeriesManifest& series) {
    for (int shard = 0; shard < series.shard_count; ++shard) {
      const std::string path = ShardPath(shard);
      if (!io::IsDirectory(path)) {
        ISOSCOPE_ASSERT_OK(io::CreateDirectory(path));
      }
      ISOSCOPE_ASSERT_OK(WriteSeriesManifest(path, series, shard));
    }
    ISOSCOPE_ASSERT_OK(WriteSeriesManifest(directory_, series, -1));
  }
  std::string ShardPath(int shard) const { return directory_ + "/" + ShardDirectoryName(shard, 2); }

  testing::TempDir temp_;
  const std::string directory_;
};

TEST_F(SeriesDirectoryTest, OpensWhatWasWrittenAndReplaced) {
  SeriesManifest series = MakeSeries();
  Write(series);
  series.times.push_back(3);
  series.volumes.push_back(
      {.key = {0, 0, 2}, .dataset_id = std::string(32, '9'), .value_range = {0, 1}});
  Write(series);
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(const SeriesDescription opened, OpenSeries(directory_));
  EXPECT_EQ(opened.manifest, series);
  EXPECT_THAT(opened.shard_directories, ::testing::ElementsAre(ShardPath(0), ShardPath(1)));
  for (int i = 0; i < 2; ++i) {
    ISOSCOPE_ASSERT_OK_AND_ASSIGN(const SeriesShard shard, OpenSeriesShard(ShardPath(i)));
    EXPECT_EQ(shard.manifest, series);
    EXPECT_EQ(shard.shard_index, i);
    ISOSCOPE_ASSERT_OK_AND_ASSIGN(const std::uint32_t crc32c,
                                  VerifySeal(EncodeSeriesManifest(series), "m"));
    EXPECT_EQ(shard.manifest_crc32c, crc32c);
  }
  ISOSCOPE_ASSERT_OK(io::RemoveRecursively(ShardPath(0)));
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(const SeriesDescription partial, OpenSeries(directory_));
  EXPECT_THAT(partial.shard_directories, ::testing::ElementsAre("", ShardPath(1)));
}

TEST_F(SeriesDirectoryTest, FoldersAreTold) {
  Write(MakeSeries());
  EXPECT_TRUE(IsSeriesDirectory(directory_));
  EXPECT_TRUE(IsSeriesDirectory(ShardPath(0)));
  EXPECT_FALSE(IsSeriesDirectory(temp_.path()));
  EXPECT_TRUE(IsDatasetDirectory(directory_));
  EXPECT_FALSE(IsShardDirectory(directory_));
  EXPECT_FALSE(IsDatasetDirectory(ShardPath(0)));
  EXPECT_TRUE(IsShardDirectory(ShardPath(0)));
  EXPECT_THAT(OpenDataset(directory_), StatusIs(absl::StatusCode::kFailedPrecondition,
                                                HasSubstr("is a series, a dataset with fields")));
  EXPECT_THAT(OpenDataset(ShardPath(0)),
              StatusIs(absl::StatusCode::kFailedPrecondition, HasSubstr("is one shard")));
  EXPECT_THAT(ShardReader::Open(ShardPath(0)), StatusIs(absl::StatusCode::kFailedPrecondition, _));
  EXPECT_THAT(OpenSeries(ShardPath(0)),
              StatusIs(absl::StatusCode::kFailedPrecondition, HasSubstr("is one shard")));
  EXPECT_THAT(OpenSeries(temp_.path()), StatusIs(absl::StatusCode::kNotFound, _));
  EXPECT_THAT(OpenSeriesShard(temp_.path()), StatusIs(absl::StatusCode::kNotFound, _));
  EXPECT_THAT(OpenSeriesShard(directory_),
              StatusIs(absl::StatusCode::kNotFound, HasSubstr("series_shard.json")));
}

TEST_F(SeriesDirectoryTest, MixedAndMissingFilesAreToldApart) {
  Write(MakeSeries());
  SeriesManifest other = MakeSeries();
  other.dataset_id = std::string(32, 'f');
  ISOSCOPE_ASSERT_OK(WriteSeriesManifest(ShardPath(0), other, -1));
  EXPECT_THAT(OpenSeriesShard(ShardPath(0)),
              StatusIs(absl::StatusCode::kDataLoss, HasSubstr("different datasets are mixed")));
  ISOSCOPE_ASSERT_OK(io::RemoveRecursively(ShardPath(0) + "/" + kManifestFileName));
  EXPECT_THAT(OpenSeriesShard(ShardPath(0)),
              StatusIs(absl::StatusCode::kFailedPrecondition, HasSubstr("did not finish")));
  const std::string shard_file = ShardPath(1) + "/" + kSeriesShardFileName;
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(const std::string bytes, io::ReadWholeFile(shard_file, 1000));
  for (std::size_t bit = 0; bit < 8 * bytes.size(); ++bit) {
    std::string damaged = bytes;
    damaged[bit / 8] =
        static_cast<char>(static_cast<unsigned char>(damaged[bit / 8]) ^ (1u << (bit % 8)));
    testing::WriteFile(shard_file, damaged);
    ASSERT_THAT(OpenSeriesShard(ShardPath(1)), StatusIs(absl::StatusCode::kDataLoss, _)) << bit;
  }
}

TEST_F(SeriesDirectoryTest, WhatCannotBeReadIsNotWritten) {
  SeriesManifest series = MakeSeries();
  series.times = {1, 1};
  EXPECT_THAT(WriteSeriesManifest(directory_, series, -1),
              StatusIs(absl::StatusCode::kInvalidArgument, HasSubstr("later than")));
  EXPECT_FALSE(io::PathExists(directory_ + "/" + kManifestFileName));
}

}  // namespace
}  // namespace isoscope::store
