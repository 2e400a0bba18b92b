#include "client-cli/output/source_json.h"

#include <memory>
#include <optional>
#include <string>
#include <vector>

#include "absl/strings/str_cat.h"
#include "gmock/gmock.h"
#include "gtest/gtest.h"
#include <nlohmann/json.hpp>

#include "core/base/shell_word.h"
#include "core/formats/open_volume.h"
#include "core/source/volume_series.h"
#include "core/source/volume_source.h"
#include "tests/support/status_matchers.h"
#include "tests/support/temp_dir.h"
#include "tests/support/volume_files.h"
#include "tests/unit/core/partition/series_fixture.h"

namespace isoscope::cli {
namespace {

using ::testing::HasSubstr;
using ::testing::Not;

class SourceJsonTest : public ::testing::Test {
 protected:
  // A series of 4 x 3 x 2 samples.
  Json Describe(const std::string& name, const std::string& bytes) {
    const std::string path = dir_.Write(name, bytes);
    const auto series = source::OpenVolumeSeries(path).value();
    const auto first = series->Open(0, 0, 0).value();
    Json volume = VolumeToJson(*first, source::ValueRange{{-1, 4}, 0});
    AddSource(*series, *first, {.steps = 1, .ranges = {{{{-1, 4}, 0}}}}, base::ShellWord(path),
              base::ShellWord(path), &volume);
    return volume;
  }
  testing::TempDir dir_;
};

TEST_F(SourceJsonTest, OneVolumeIsDrawnAtOnce) {
  const Json volume =
      Describe("a b.nii", testing::NiftiHeaderBytes({.dims = {4, 3, 2}}) + std::string(48, 'x'));
  EXPECT_EQ(volume.at("fields").size(), 1U);
  EXPECT_EQ(volume.at("fields").at(0).at("name"), "a b");
  EXPECT_TRUE(volume.at("time_steps").empty());
  EXPECT_EQ(volume.at("commands"),
            Json::array({"isoscope render '" + dir_.Sub("a b.nii") + "' --isovalue 1.5"}));
  const std::string text = DescribeSource(volume);
  EXPECT_THAT(text, HasSubstr("fields        a b\n"));
  EXPECT_THAT(text, HasSubstr("steps         1, without a time\n"));
  EXPECT_THAT(text, HasSubstr("partition     about "));
  EXPECT_THAT(text, HasSubstr("draw          isoscope render '"));
}

TEST_F(SourceJsonTest, SeveralArePartitionedFirst) {
  const Json volume = Describe(
      "run.nii", testing::NiftiHeaderBytes({.dims = {4, 3, 2}, .dim_count = 4, .dim4 = 3}) +
                     std::string(144, 'x'));
  EXPECT_EQ(volume.at("time_steps"), Json::array({0, 1, 2}));
  EXPECT_EQ(volume.at("length_unit"), "mm");
  EXPECT_EQ(volume.at("commands").at(0),
            "isoscope partition " + dir_.Sub("run.nii") + " --output DIR");
  EXPECT_EQ(volume.at("commands").at(1), "isoscope render DIR --isovalue 1.5");
  EXPECT_THAT(DescribeSource(volume), HasSubstr("steps         3, from 0 to 2 s\n"));
  EXPECT_THAT(DescribeSource(volume), HasSubstr("mm of spacing and origin"));
}

// Symptom: nothing told of what lies on another grid than the fields that are read.
TEST_F(SourceJsonTest, PathsOfWhatLiesOnOtherGridsAreTold) {
  partition::MemorySeries flow(partition::FlowFields(), {});
  const auto describe = [&](int count) {
    source::SeriesInfo info = flow.info();
    info.name = "a run.npz";
    for (int i = 0; i < count; ++i) {
      info.fields_elsewhere.push_back(absl::StrCat("q", i));
    }
    partition::MemorySeries series(info);
    const auto first = series.Open(0, 0, 0).value();
    Json volume = VolumeToJson(*first, std::nullopt);
    AddSource(series, *first, {}, "'a run.npz'", "'a run.npz'", &volume);
    return volume;
  };
  EXPECT_EQ(describe(2).at("elsewhere"), Json::array({"a run.npz:q0", "a run.npz:q1"}));
  EXPECT_THAT(DescribeSource(describe(2)),
              HasSubstr("\nelsewhere     'a run.npz:q0', 'a run.npz:q1'\n"));
  EXPECT_THAT(DescribeSource(describe(30)), HasSubstr("'a run.npz:q9', and 20 more: --json"));
  EXPECT_THAT(DescribeSource(describe(0)), Not(HasSubstr("elsewhere")));
}

TEST_F(SourceJsonTest, RangesHaveALineForEachComponent) {
  const std::string path =
      dir_.Write("v.nrrd",
                 "NRRD0004\ntype: short\ndimension: 4\nsizes: 2 4 3 2\nspace dimension: 3\n"
                 "kinds: vector domain domain domain\nspace directions: none (1,0,0) (0,1,0) "
                 "(0,0,1)\nspace origin: (0,0,0)\nendian: little\nencoding: raw\n\n" +
                     std::string(96, 'x'));
  const auto series = source::OpenVolumeSeries(path).value();
  const auto first = series->Open(0, 0, 0).value();
  const auto describe = [&](const SourceRanges& ranges) {
    Json volume = VolumeToJson(*first, std::nullopt);
    AddSource(*series, *first, ranges, base::ShellWord(path), base::ShellWord(path), &volume);
    return volume;
  };
  const Json volume = describe({.steps = 1, .ranges = {{{{-1, 4}, 0}, {{}, 3}}}});
  EXPECT_EQ(volume.at("fields").at(0).at("value_ranges"),
            Json::array({Json::array({-1, 4}), nullptr}));
  EXPECT_EQ(volume.at("fields").at(0).at("infinite_counts"), Json::array({0, 3}));
  EXPECT_EQ(volume.at("commands").at(1), "isoscope render DIR --field v:0 --isovalue 1.5");
  EXPECT_THAT(DescribeSource(volume),
              HasSubstr("values        v:0  -1.0 to 4.0\n              v:1  none that is finite, "
                        "and 3 infinite samples\n"));
  EXPECT_THAT(DescribeSource(describe({})), HasSubstr("values        not read"));
  EXPECT_EQ(describe({}).at("commands").at(1), "isoscope render DIR --isovalue VALUE");
  const Json second = describe({.steps = 1, .ranges = {{{{7, 7}, 0}, {{0, 3}, 0}}}});
  EXPECT_EQ(second.at("commands").at(1), "isoscope render DIR --field v:1 --isovalue 1.5")
      << "the first has no surface";
  EXPECT_EQ(describe({.steps = 1, .ranges = {{{{7, 7}, 0}, {{}, 9}}}}).at("commands").size(), 1U);
}

TEST_F(SourceJsonTest, InfiniteSamplesAreNoPartOfRangeAndIsovalue) {
  const std::string path =
      dir_.Write("a.nii", testing::NiftiHeaderBytes({.dims = {4, 3, 2}}) + std::string(48, 'x'));
  const auto series = source::OpenVolumeSeries(path).value();
  const auto first = series->Open(0, 0, 0).value();
  const auto describe = [&](const source::ValueRange& range) {
    Json volume = VolumeToJson(*first, range);
    AddSource(*series, *first, {}, "a.nii", "a.nii", &volume);
    return volume;
  };
  const Json some = describe({{-1, 4}, 1'200});
  EXPECT_EQ(some.at("value_range"), Json::array({-1, 4}));
  EXPECT_EQ(some.at("infinite_count"), 1'200);
  EXPECT_THAT(DescribeValueRange(some), HasSubstr("-1.0 to 4.0, and 1,200 infinite samples\n"));
  EXPECT_EQ(some.at("commands"), Json::array({"isoscope render a.nii --isovalue 1.5"}));
  const Json none = describe({{}, 1});
  EXPECT_THAT(DescribeValueRange(none), HasSubstr("none that is finite, and 1 infinite sample\n"));
  EXPECT_TRUE(none.at("commands").empty());
  EXPECT_THAT(DescribeSource(describe({{7, 7}, 0})), HasSubstr("draw          nothing: "));
}

// Measured: 86 342 659 and 444 215 820 bytes.
TEST(EstimatePartitionTest, IsNearWhatPartitionMakes) {
  const PartitionNeeds small = EstimatePartition({256, 256, 256}, volume::ScalarType::kInt16, 1);
  EXPECT_NEAR(static_cast<double>(small.disk_bytes), 86.3e6, 2e6);
  const PartitionNeeds large = EstimatePartition({512, 512, 512}, volume::ScalarType::kInt16, 1);
  EXPECT_NEAR(static_cast<double>(large.disk_bytes), 444.2e6, 9e6);
  EXPECT_EQ(EstimatePartition({512, 512, 512}, volume::ScalarType::kInt16, 3).disk_bytes,
            3 * large.disk_bytes);
  EXPECT_GT(large.memory_bytes, small.memory_bytes);
  EXPECT_LE(EstimatePartition({16000000, 16000000, 16000}, volume::ScalarType::kFloat64, 100000)
                .memory_bytes,
            std::int64_t{1} << 30);
}

TEST(DicomSeriesTextTest, ListsWhatCanBeChosen) {
  const Json json = SeriesEntriesToJson({{.uid = "1.2.3",
                                          .number = 4,
                                          .description = "T1 \033 axial",
                                          .width = 512,
                                          .height = 256,
                                          .images = 30,
                                          .first_file = "d/a.dcm"}});
  const std::string text = DescribeSeriesEntries(json, "d");
  EXPECT_THAT(text, HasSubstr("T1 ? axial"));
  EXPECT_THAT(text, HasSubstr("1.2.3"));
  EXPECT_THAT(text, HasSubstr("isoscope info d --series 4"));
  EXPECT_THAT(text, Not(HasSubstr("\033")));
}

TEST(DicomSeriesTextTest, AdvisesTheUidOfSeriesThatShareTheirNumber) {
  const std::string text = DescribeSeriesEntries(
      SeriesEntriesToJson({{.uid = "1.2.3", .number = 4}, {.uid = "1.2.4", .number = 4}}), "d");
  EXPECT_THAT(text, HasSubstr("--series 1.2.3"));
  EXPECT_THAT(text, Not(HasSubstr("folder")));
}

TEST(DicomSeriesTextTest, SeriesInFoldersBelowAreListedWithTheirFolders) {
  const std::string text =
      DescribeSeriesEntries(SeriesEntriesToJson({{.uid = "1.2.3", .number = 4, .folder = "a/\033b"},
                                                 {.uid = "1.2.4", .number = 5}}),
                            "d");
  EXPECT_THAT(text, HasSubstr("folder"));
  EXPECT_THAT(text, HasSubstr("a/?b"));
}

}  // namespace
}  // namespace isoscope::cli
