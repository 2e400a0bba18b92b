#include "core/partition/series_partitioner.h"

#include <cstdint>
#include <filesystem>
#include <map>
#include <memory>
#include <optional>
#include <string>
#include <utility>
#include <vector>

#include "absl/strings/match.h"
#include "absl/strings/str_cat.h"
#include "gmock/gmock.h"
#include "gtest/gtest.h"

#include "core/io/file.h"
#include "core/io/file_lock.h"
#include "core/source/adapt/magnitude_source.h"
#include "core/store/series_manifest.h"
#include "core/store/shard_format.h"
#include "core/store/shard_reader.h"
#include "tests/support/status_matchers.h"
#include "tests/support/temp_dir.h"
#include "tests/unit/core/partition/partitioner_fixture.h"
#include "tests/unit/core/partition/series_fixture.h"

namespace isoscope::partition {
namespace {

namespace fs = std::filesystem;

using ::isoscope::testing::StatusIs;
using ::testing::_;
using ::testing::AllOf;
using ::testing::ElementsAre;
using ::testing::HasSubstr;

using Files = std::map<std::string, std::string>;

class SeriesPartitionerTest : public ::testing::Test {
 protected:
  SeriesPartitionOptions Options(const std::string& name) const {
    SeriesPartitionOptions options;
    options.volume.output_directory = dir_.Sub(name);
    options.volume.block_cells = math::Index3{4, 4, 4};
    options.volume.shard_count = 2;
    return options;
  }
  // To append to `name`.
  SeriesPartitionOptions Appending(const std::string& name) const {
    SeriesPartitionOptions options;
    options.volume.output_directory = dir_.Sub(name);
    return options;
  }
  store::SeriesManifest Make(MemorySeries source, const std::string& name) {
    auto series = PartitionSeries(source, Options(name), never_);
    ISOSCOPE_EXPECT_OK(series.status());
    return series.ok() ? *std::move(series) : store::SeriesManifest{};
  }
  absl::Status Append(MemorySeries source, const std::string& name, bool resumes = false) {
    SeriesPartitionOptions options = Appending(name);
    options.resumes = resumes;
    return AppendToSeries(source, options, never_).status();
  }
  Files FilesOf(const std::string& name) const { return FilesBelow(dir_.Sub(name)); }

  testing::TempDir dir_;
  base::Cancellation never_;
};

std::vector<source::SourceField> Pressure() { return {FlowFields()[0]}; }

// Fails, or cancels, when the source is opened for the `count`-th time.
std::function<absl::Status(int, int, int)> FailAt(int count, const absl::Status& status) {
  auto left = std::make_shared<int>(count);
  return [left, status](int, int, int) { return --*left == 0 ? status : absl::OkStatus(); };
}

TEST_F(SeriesPartitionerTest, KnowsWhatNeedsASeries) {
  const std::vector<source::SourceField> one = {
      {.name = "a", .long_name = "", .unit = "Pa", .components = {""}}};
  const std::vector<source::SourceField> vector = {
      {.name = "a", .long_name = "", .unit = "", .components = {"x", "y"}}};
  EXPECT_FALSE(NeedsSeries(MemorySeries(one, {})));
  EXPECT_TRUE(NeedsSeries(MemorySeries(one, {0})));
  EXPECT_TRUE(NeedsSeries(MemorySeries(vector, {})));
  EXPECT_TRUE(NeedsSeries(MemorySeries(FlowFields(), {})));
}

TEST_F(SeriesPartitionerTest, EveryVolumeHasTheBytesOfADatasetOfItsOwn) {
  MemorySeries source(FlowFields(), {0, 0.5});
  const store::SeriesManifest series = Make(source, "flow");
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(const auto opened, store::OpenSeries(dir_.Sub("flow")));
  EXPECT_EQ(opened.manifest, series);
  EXPECT_EQ(series.name, "flow");
  EXPECT_EQ(series.source, "flow.pvd");
  EXPECT_EQ(series.geometry, source.geometry);
  EXPECT_EQ(series.length_unit, "m");
  EXPECT_EQ(series.time_unit, "s");
  EXPECT_THAT(series.times, ElementsAre(0, 0.5));
  ASSERT_EQ(series.fields.size(), 2);
  EXPECT_EQ(series.fields[0].long_name, "pressure");
  EXPECT_EQ(series.fields[0].unit, "Pa");
  ASSERT_EQ(series.fields[1].components.size(), 4);
  EXPECT_EQ(series.fields[1].components[3].name, "magnitude");
  ASSERT_EQ(series.volumes.size(), 2 * 5);
  for (const store::ScalarVolume& volume : series.volumes) {
    const store::ScalarVolumeKey& key = volume.key;
    const std::string name = store::ScalarVolumeDirectoryName(key);
    std::unique_ptr<source::VolumeSource> samples;
    if (key.field == 1 && key.component == 3) {
      std::vector<std::unique_ptr<source::VolumeSource>> components;
      for (int component = 0; component < 3; ++component) {
        components.push_back(source.Open(1, component, key.step).value());
      }
      samples = source::MakeMagnitudeSource(std::move(components));
    } else {
      samples = source.Open(key.field, key.component, key.step).value();
    }
    PartitionOptions options = Options(name).volume;
    options.name = "flow";
    ISOSCOPE_ASSERT_OK_AND_ASSIGN(const store::Manifest expected,
                                  Partition(*samples, options, never_));
    EXPECT_EQ(volume.dataset_id, expected.dataset_id);
    EXPECT_EQ(volume.value_range, expected.value_range);
    EXPECT_EQ(volume.max_gradient_magnitude, expected.max_gradient_magnitude);
    for (int shard = 0; shard < 2; ++shard) {
      const std::string shard_name = store::ShardDirectoryName(shard, 2);
      const std::string& shard_path = opened.shard_directories[static_cast<std::size_t>(shard)];
      EXPECT_EQ(FilesOf(absl::StrCat("flow/", shard_name, "/", name)),
                FilesOf(absl::StrCat(name, "/", shard_name)))
          << name;
      ISOSCOPE_ASSERT_OK_AND_ASSIGN(const auto reader,
                                    store::ShardReader::Open(absl::StrCat(shard_path, "/", name)));
      EXPECT_EQ(reader->manifest_crc32c(), volume.manifest_crc32c);
      ISOSCOPE_ASSERT_OK_AND_ASSIGN(const auto series_shard, store::OpenSeriesShard(shard_path));
      EXPECT_EQ(series_shard.manifest, series);
      EXPECT_EQ(series_shard.shard_index, shard);
    }
  }
  EXPECT_THAT(EntriesOf(dir_.Sub("flow")),
              ::testing::UnorderedElementsAre("manifest.json", "shard-00000-of-00002",
                                              "shard-00001-of-00002"));
  EXPECT_EQ(EntriesOf(dir_.Sub("flow/shard-00000-of-00002")).size(), 10 + 2);
}

TEST_F(SeriesPartitionerTest, TheIdNamesGridCutFieldsAndFirstStepAlone) {
  const std::string id = Make(MemorySeries(Pressure(), {1}), "a").dataset_id;
  EXPECT_EQ(Make(MemorySeries(Pressure(), {1}), "other_name").dataset_id, id);
  EXPECT_EQ(Make(MemorySeries(Pressure(), {1, 2}), "b").dataset_id, id);
  EXPECT_NE(Make(MemorySeries(Pressure(), {2}), "c").dataset_id, id);
  source::SeriesInfo other_unit = MemorySeries::InfoOf(Pressure(), {1});
  other_unit.time_unit = "ms";
  EXPECT_NE(Make(MemorySeries(other_unit), "d").dataset_id, id);
  MemorySeries other_grid(Pressure(), {1});
  other_grid.geometry.origin = {1, 2, 3};
  EXPECT_NE(Make(other_grid, "e").dataset_id, id);
  SeriesPartitionOptions other_seed = Options("f");
  other_seed.volume.seed = 2;
  MemorySeries source(Pressure(), {1});
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(const auto series, PartitionSeries(source, other_seed, never_));
  EXPECT_NE(series.dataset_id, id);
}

TEST_F(SeriesPartitionerTest, ProgressIsOfAllVolumes) {
  MemorySeries source(FlowFields(), {0, 1});
  SeriesPartitionOptions options = Options("flow");
  std::int64_t last = 0;
  options.volume.progress = [&](const PartitionProgress& progress) {
    EXPECT_EQ(progress.total_bytes, 10 * 13 * 11 * 9 * 4);
    EXPECT_GE(progress.done_bytes, last);
    last = progress.done_bytes;
    EXPECT_THAT(progress.phase, HasSubstr(" of 10"));
  };
  ISOSCOPE_ASSERT_OK(PartitionSeries(source, options, never_).status());
  EXPECT_EQ(last, 10 * 13 * 11 * 9 * 4);
}

TEST_F(SeriesPartitionerTest, VolumesThatDifferAreToldBeforeAnythingIsWritten) {
  const auto expect_error = [&](const char* what, const char* found, auto change) {
    MemorySeries source(FlowFields(), {0, 0.25});
    change(&source);
    EXPECT_THAT(PartitionSeries(source, Options("flow"), never_),
                StatusIs(absl::StatusCode::kInvalidArgument,
                         AllOf(HasSubstr("field \"u\""), HasSubstr("step 1 (time 0.25)"),
                               HasSubstr(what), HasSubstr(found), HasSubstr("/data/flow.pvd"))));
    EXPECT_THAT(EntriesOf(dir_.path()), ElementsAre());
  };
  const auto grid = [](auto change) {
    return [change](MemorySeries* source) {
      source->geometry_of = [change, plain = source->geometry](int field, int, int step) {
        volume::GridGeometry geometry = plain;
        if (field == 1 && step == 1) {
          change(&geometry);
        }
        return geometry;
      };
    };
  };
  expect_error("dimensions 13, 11, 8", "has 13, 11, 9",
               grid([](volume::GridGeometry* g) { g->sample_dims.z = 8; }));
  expect_error("spacing 0.5", "has 0.5, 1, 2",
               grid([](volume::GridGeometry* g) { g->spacing.y = 1.5; }));
  expect_error("origin 0, 0, 1", "has 0, 0, 0",
               grid([](volume::GridGeometry* g) { g->origin.z = 1; }));
  expect_error("directions 0, 1, 0; ", "has 1, 0, 0; ", grid([](volume::GridGeometry* g) {
                 g->direction.columns[0] = {0, 1, 0};
                 g->direction.columns[1] = {1, 0, 0};
               }));
  expect_error("samples of int32", "float32", [](MemorySeries* source) {
    source->type_of = [](int field, int, int step) {
      return field == 1 && step == 1 ? volume::ScalarType::kInt32 : volume::ScalarType::kFloat32;
    };
  });
}

TEST_F(SeriesPartitionerTest, BadOptionsAndSourcesAreRefused) {
  MemorySeries source(FlowFields(), {0});
  SeriesPartitionOptions greedy = Options("flow");
  greedy.volume.distribution = store::Distribution::kGreedy;
  EXPECT_THAT(PartitionSeries(source, greedy, never_),
              StatusIs(absl::StatusCode::kInvalidArgument, HasSubstr("at random")));
  SeriesPartitionOptions many = Options("flow");
  many.volume.shard_count = 1000;
  EXPECT_THAT(PartitionSeries(source, many, never_),
              StatusIs(absl::StatusCode::kInvalidArgument, HasSubstr("1000 shards for")));
  ISOSCOPE_ASSERT_OK(io::CreateDirectory(dir_.Sub("there")));
  EXPECT_THAT(PartitionSeries(source, Options("there"), never_),
              StatusIs(absl::StatusCode::kAlreadyExists, _));
  EXPECT_THAT(PartitionSeries(source, Options("no/parent"), never_),
              StatusIs(absl::StatusCode::kNotFound, _));
  MemorySeries twice({{.name = "a", .long_name = "", .unit = "", .components = {""}},
                      {.name = "a", .long_name = "", .unit = "", .components = {""}}},
                     {0});
  EXPECT_THAT(PartitionSeries(twice, Options("flow"), never_),
              StatusIs(absl::StatusCode::kInvalidArgument, HasSubstr("field \"a\"")));
  MemorySeries disorder(FlowFields(), {1, 0});
  EXPECT_THAT(PartitionSeries(disorder, Options("flow"), never_),
              StatusIs(absl::StatusCode::kInvalidArgument, HasSubstr("time 0 of step 1")));
  EXPECT_THAT(EntriesOf(dir_.path()), ElementsAre("there"));
}

TEST_F(SeriesPartitionerTest, AnInterruptedRunIsResumed) {
  const Files expected = [&] {
    Make(MemorySeries(FlowFields(), {0, 1}), "flow");
    Files files = FilesOf("flow");
    fs::remove_all(dir_.Sub("flow"));
    return files;
  }();
  // A run without an end opens each volume once, or all components for the magnitude.
  MemorySeries counted(FlowFields(), {0, 1});
  ISOSCOPE_ASSERT_OK(PartitionSeries(counted, Options("counted"), never_).status());
  fs::remove_all(dir_.Sub("counted"));
  std::vector<int> kept;
  for (int at = 1; at <= counted.open_count; at += 7) {
    MemorySeries source(FlowFields(), {0, 1});
    source.before_open = FailAt(at, absl::CancelledError("stop"));
    const absl::Status status = PartitionSeries(source, Options("flow"), never_).status();
    ASSERT_THAT(status, StatusIs(absl::StatusCode::kCancelled, HasSubstr("stop")));
    EXPECT_FALSE(io::PathExists(dir_.Sub("flow")));
    const bool is_kept = io::PathExists(dir_.Sub("flow.partial"));
    EXPECT_EQ(absl::StrContains(status.message(), "--resume goes on"), is_kept);
    if (is_kept) {
      kept.push_back(at);
    }
    SeriesPartitionOptions options = Options("flow");
    options.resumes = true;
    MemorySeries whole(FlowFields(), {0, 1});
    ISOSCOPE_ASSERT_OK(PartitionSeries(whole, options, never_).status());
    ASSERT_EQ(FilesOf("flow"), expected) << at;
    EXPECT_THAT(EntriesOf(dir_.path()), ElementsAre("flow"));
    fs::remove_all(dir_.Sub("flow"));
  }
  // The first volume is finished between the 8th and the 15th time that a source is opened.
  EXPECT_THAT(kept, ElementsAre(15, 22));
}

// The rows that are read tell which volumes are made again.
TEST_F(SeriesPartitionerTest, ResumingKeepsWhatMatchesAndNothingElse) {
  const auto interrupt = [&] {
    MemorySeries source(FlowFields(), {0, 1});
    source.before_open = [](int, int, int step) {
      static int count = 0;
      count = step == 0 ? 0 : count + 1;
      return step == 1 && count > 3 ? absl::CancelledError("stop") : absl::OkStatus();
    };
    EXPECT_FALSE(PartitionSeries(source, Options("flow"), never_).ok());
    EXPECT_TRUE(io::PathExists(dir_.Sub("flow.partial")));
  };
  // Runs 10 volumes; a volume that is kept reports its end alone.
  const auto made_by_resuming = [&](MemorySeries source, SeriesPartitionOptions options) {
    options.resumes = true;
    std::map<std::string, int> reports;
    options.volume.progress = [&](const PartitionProgress& progress) { ++reports[progress.phase]; };
    EXPECT_THAT(PartitionSeries(source, options, never_), testing::IsOk());
    fs::remove_all(dir_.Sub("flow"));
    int made = 0;
    for (const auto& [phase, count] : reports) {
      made += count > 1 ? 1 : 0;
    }
    return made;
  };
  interrupt();
  const int kept = 10 - made_by_resuming(MemorySeries(FlowFields(), {0, 1}), Options("flow"));
  EXPECT_GT(kept, 4);
  EXPECT_LT(kept, 10);
  // Nothing of a run with other parameters, of another source, or that was not asked for.
  interrupt();
  SeriesPartitionOptions other = Options("flow");
  other.volume.seed = 99;
  EXPECT_EQ(made_by_resuming(MemorySeries(FlowFields(), {0, 1}), other), 10);
  interrupt();
  SeriesPartitionOptions compressed = Options("flow");
  compressed.volume.compression = store::BlockEncoding::kLz4;
  EXPECT_EQ(made_by_resuming(MemorySeries(FlowFields(), {0, 1}), compressed), 10);
  interrupt();
  source::SeriesInfo moved = MemorySeries::InfoOf(FlowFields(), {0, 1});
  moved.name = "/data/other.pvd";
  EXPECT_EQ(made_by_resuming(MemorySeries(moved), Options("flow")), 10);
  // Symptom: a run with another --crop of equal size, or with --fill, went on with the volumes of
  // the command before.
  interrupt();
  MemorySeries cropped(FlowFields(), {0, 1});
  cropped.identity = "another crop";
  EXPECT_EQ(made_by_resuming(cropped, Options("flow")), 10);
  // Of the second step alone, of which all volumes were finished but the last or so.
  interrupt();
  MemorySeries changed(FlowFields(), {0, 1});
  changed.identity_of = [identity = changed.identity](int step) {
    return step == 1 ? "its file has changed" : identity;
  };
  EXPECT_EQ(made_by_resuming(changed, Options("flow")), 5);
  interrupt();
  Make(MemorySeries(FlowFields(), {5}), "flow");
  EXPECT_FALSE(io::PathExists(dir_.Sub("flow.partial")));
  EXPECT_EQ(EntriesOf(dir_.Sub("flow/shard-00001-of-00002")).size(), 5 + 2);
}

// What a volume is made of, as far as the identity of the source does not have it.
TEST_F(SeriesPartitionerTest, ResumingMakesAllAgainWhereAParameterOfTheCutIsAnother) {
  const auto interrupt = [&] {
    MemorySeries source(Pressure(), {0, 1});
    source.before_open = [opened = 0](int, int, int step) mutable {
      opened += step == 1 ? 1 : 0;
      return opened == 2 ? absl::CancelledError("stop") : absl::OkStatus();
    };
    EXPECT_FALSE(PartitionSeries(source, Options("flow"), never_).ok());
  };
  // Whether the volume that was finished is kept.
  const auto keeps =
      [&](const std::function<void(MemorySeries*, SeriesPartitionOptions*)>& change) {
        interrupt();
        MemorySeries source(Pressure(), {0, 1});
        SeriesPartitionOptions options = Options("flow");
        change(&source, &options);
        options.resumes = true;
        int reports = 0;
        options.volume.progress = [&](const PartitionProgress& progress) {
          reports += absl::string_view(progress.phase) == "volume 1 of 2" ? 1 : 0;
        };
        EXPECT_THAT(PartitionSeries(source, options, never_), testing::IsOk());
        fs::remove_all(dir_.Sub("flow"));
        return reports == 1;  // a volume that is kept reports its end alone
      };
  EXPECT_TRUE(keeps([](MemorySeries*, SeriesPartitionOptions*) {}));
  EXPECT_FALSE(keeps([](auto*, auto* options) { options->volume.name = "other"; }));
  EXPECT_FALSE(keeps([](auto*, auto* options) { options->volume.source_name = "other"; }));
  EXPECT_FALSE(keeps([](auto*, auto* options) { options->volume.seed = 99; }));
  EXPECT_FALSE(keeps([](auto*, auto* options) { options->volume.shard_count = 3; }));
  EXPECT_FALSE(keeps([](auto*, auto* options) { options->volume.block_cells = {{5, 4, 4}}; }));
  EXPECT_FALSE(keeps(
      [](auto*, auto* options) { options->volume.compression = store::BlockEncoding::kZstd; }));
  EXPECT_FALSE(keeps([](auto* source, auto*) { source->geometry.sample_dims.z = 8; }));
  EXPECT_FALSE(keeps([](auto* source, auto*) { source->geometry.spacing.z = 8; }));
  EXPECT_FALSE(keeps([](auto* source, auto*) { source->geometry.origin.z = 8; }));
  EXPECT_FALSE(keeps([](auto* source, auto*) {
    source->geometry.direction.columns[2] = {0, 0, -1};
  }));
  EXPECT_FALSE(keeps([](auto* source, auto*) {
    source->type_of = [](int, int, int) { return volume::ScalarType::kInt32; };
  }));
  EXPECT_FALSE(keeps([](auto* source, auto*) { source->identity += "more"; }));
  EXPECT_FALSE(keeps([](auto* source, auto*) { *source = MemorySeries(Pressure(), {0.5, 1}); }));
}

// Symptom: a file that was written while it was read gave a volume of both.
TEST_F(SeriesPartitionerTest, ASourceThatChangesWhileItIsReadIsAnErrorAndItsVolumeIsNotKept) {
  MemorySeries source(Pressure(), {0, 1});
  int asked = 0;
  source.identity_error = [&](int step) {
    asked += step == 1 ? 1 : 0;
    return asked == 2 ? absl::AbortedError("a file has changed") : absl::OkStatus();
  };
  EXPECT_THAT(PartitionSeries(source, Options("flow"), never_),
              StatusIs(absl::StatusCode::kAborted,
                       AllOf(HasSubstr("has changed"), HasSubstr("1 of 2 volumes are finished"))));
  EXPECT_FALSE(io::PathExists(dir_.Sub("flow")));
  EXPECT_THAT(EntriesOf(dir_.Sub("flow.partial/finished")).size(), 1u);
}

// A volume that was finished is read before it is kept: every file of every shard.
TEST_F(SeriesPartitionerTest, ResumingMakesADamagedVolumeAgain) {
  Make(MemorySeries(Pressure(), {0, 1}), "flow");
  const Files expected = FilesOf("flow");
  fs::remove_all(dir_.Sub("flow"));
  const auto resume_after = [&](const std::function<void(const std::string& folder)>& damage) {
    MemorySeries source(Pressure(), {0, 1});
    source.before_open = [opened = 0](int, int, int step) mutable {
      opened += step == 1 ? 1 : 0;
      return opened == 2 ? absl::CancelledError("stop") : absl::OkStatus();
    };
    EXPECT_FALSE(PartitionSeries(source, Options("flow"), never_).ok());
    damage(dir_.Sub("flow.partial/"));
    SeriesPartitionOptions options = Options("flow");
    options.resumes = true;
    int reports = 0;
    options.volume.progress = [&](const PartitionProgress& progress) {
      reports += absl::string_view(progress.phase) == "volume 1 of 2" ? 1 : 0;
    };
    MemorySeries whole(Pressure(), {0, 1});
    EXPECT_THAT(PartitionSeries(whole, options, never_), testing::IsOk());
    EXPECT_EQ(FilesOf("flow"), expected);
    fs::remove_all(dir_.Sub("flow"));
    return reports > 1;  // a volume that is kept reports its end alone
  };
  EXPECT_FALSE(resume_after([](const std::string&) {}));
  int damaged = 0;
  for (const auto& [path, bytes] : expected) {
    if (!absl::StrContains(path, "step-00000/")) {
      continue;
    }
    SCOPED_TRACE(path);
    ++damaged;
    EXPECT_TRUE(resume_after([&, name = path](const std::string& folder) {
      std::string flipped = expected.at(name);
      flipped[flipped.size() / 2] ^= 0x10;
      fs::remove(folder + name);
      ISOSCOPE_ASSERT_OK(io::WriteWholeFile(folder + name, flipped));
    }));
    EXPECT_TRUE(resume_after(
        [name = path](const std::string& folder) { EXPECT_TRUE(fs::remove(folder + name)); }));
  }
  EXPECT_EQ(damaged, 2 * 7);  // shards and their files
  // A whole volume, but another one.
  EXPECT_TRUE(resume_after([&](const std::string& folder) {
    Make(MemorySeries(Pressure(), {1}), "other");
    for (const char* const shard : {"shard-00000-of-00002/", "shard-00001-of-00002/"}) {
      const std::string name = absl::StrCat(shard, "field-000-component-0-step-00000");
      fs::remove_all(folder + name);
      fs::rename(dir_.Sub("other/" + name), folder + name);
    }
    fs::remove_all(dir_.Sub("other"));
  }));
}

TEST_F(SeriesPartitionerTest, OnlyOneProcessWrites) {
  ISOSCOPE_ASSERT_OK(io::CreateDirectory(dir_.Sub("flow.partial")));
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(const auto lock, io::FileLock::Take(dir_.Sub("flow.partial/lock")));
  MemorySeries source(FlowFields(), {0});
  EXPECT_THAT(PartitionSeries(source, Options("flow"), never_),
              StatusIs(absl::StatusCode::kFailedPrecondition, HasSubstr("another process")));
  EXPECT_TRUE(io::PathExists(dir_.Sub("flow.partial/lock")));
}

TEST_F(SeriesPartitionerTest, AppendingGivesTheBytesOfOneRun) {
  Make(MemorySeries(FlowFields(), {0, 1, 2.5, 3}), "flow");
  const Files expected = FilesOf("flow");
  fs::remove_all(dir_.Sub("flow"));
  Make(MemorySeries(FlowFields(), {0}), "flow");
  const Files before = FilesOf("flow");
  ISOSCOPE_ASSERT_OK(Append(MemorySeries(FlowFields(), {1}), "flow"));
  ISOSCOPE_ASSERT_OK(Append(MemorySeries(FlowFields(), {2.5, 3}), "flow"));
  const Files after = FilesOf("flow");
  EXPECT_EQ(after, expected);
  for (const auto& [path, bytes] : before) {
    if (!absl::EndsWith(path, "manifest.json") || absl::StrContains(path, "field-")) {
      EXPECT_EQ(after.at(path), bytes) << path;
    }
  }
}

TEST_F(SeriesPartitionerTest, SomeFieldsMayFollowLater) {
  Make(MemorySeries(FlowFields(), {0}), "flow");
  const std::vector<source::SourceField> pressure = {FlowFields()[0]};
  std::vector<source::SourceField> velocity = {FlowFields()[1]};
  velocity[0].unit.clear();  // not known
  ISOSCOPE_ASSERT_OK(Append(MemorySeries(pressure, {1}), "flow"));
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(const auto partial, store::OpenSeries(dir_.Sub("flow")));
  EXPECT_NE(partial.manifest.Find({0, 0, 1}), nullptr);
  EXPECT_EQ(partial.manifest.Find({1, 0, 1}), nullptr);
  EXPECT_THAT(Append(MemorySeries(FlowFields(), {1}), "flow"),
              StatusIs(absl::StatusCode::kAlreadyExists, HasSubstr("field \"p\"")));
  ISOSCOPE_ASSERT_OK(Append(MemorySeries(velocity, {1}), "flow"));
  ISOSCOPE_ASSERT_OK(Append(MemorySeries(FlowFields(), {0, 1}), "flow", /*resumes=*/true));
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(const auto whole, store::OpenSeries(dir_.Sub("flow")));
  EXPECT_EQ(whole.manifest.volumes.size(), 10);
  EXPECT_THAT(whole.manifest.times, ElementsAre(0, 1));
  EXPECT_FALSE(io::PathExists(dir_.Sub("flow/append.partial")));
}

TEST_F(SeriesPartitionerTest, WhatDoesNotFitIsNotAppended) {
  Make(MemorySeries(FlowFields(), {0, 1}), "flow");
  const Files before = FilesOf("flow");
  const auto expect_refused = [&](const char* message, auto change,
                                  absl::StatusCode code = absl::StatusCode::kInvalidArgument) {
    std::vector<source::SourceField> fields = FlowFields();
    std::vector<double> times = {2};
    change(&fields, &times);
    EXPECT_THAT(Append(MemorySeries(fields, times), "flow"), StatusIs(code, HasSubstr(message)));
    EXPECT_EQ(FilesOf("flow"), before) << message;
    EXPECT_FALSE(io::PathExists(dir_.Sub("flow/append.partial"))) << message;
  };
  expect_refused("the series has the fields \"p\", \"u\"",
                 [](auto* fields, auto*) { (*fields)[0].name = "q"; });
  expect_refused("unit \"bar\", the series has \"Pa\"",
                 [](auto* fields, auto*) { (*fields)[0].unit = "bar"; });
  expect_refused("components [x, y], in the series [x, y, z]", [](auto* fields, auto*) {
    (*fields)[1].components = {"x", "y"};
  });
  expect_refused("expected a later time", [](auto*, auto* times) { *times = {0.5}; });
  expect_refused("expected a later time", [](auto*, auto* times) { *times = {-1, 5}; });
  expect_refused("has no time", [](auto*, auto* times) { times->clear(); });
  expect_refused(
      "at time 1 already",
      [](auto*, auto* times) {
        *times = {1, 2};
      },
      absl::StatusCode::kAlreadyExists);
  MemorySeries other_grid(FlowFields(), {2});
  other_grid.geometry.origin = {0, 1, 0};
  EXPECT_THAT(Append(other_grid, "flow"),
              StatusIs(absl::StatusCode::kInvalidArgument, HasSubstr("origin 0, 1, 0")));
  source::SeriesInfo other_unit = MemorySeries::InfoOf(FlowFields(), {2});
  other_unit.time_unit = "h";
  EXPECT_THAT(Append(MemorySeries(other_unit), "flow"),
              StatusIs(absl::StatusCode::kInvalidArgument, HasSubstr("unit of time \"h\"")));
  MemorySeries other_type(FlowFields(), {2});
  other_type.type_of = [](int, int, int) { return volume::ScalarType::kFloat64; };
  EXPECT_THAT(Append(other_type, "flow"),
              StatusIs(absl::StatusCode::kInvalidArgument, HasSubstr("samples of float64")));
  EXPECT_EQ(FilesOf("flow"), before);
}

TEST_F(SeriesPartitionerTest, OnlyAWholeSeriesWithTimesIsAppendedTo) {
  EXPECT_THAT(Append(MemorySeries(FlowFields(), {1}), "nothing"),
              StatusIs(absl::StatusCode::kNotFound, _));
  Make(MemorySeries(FlowFields(), {}), "timeless");
  EXPECT_THAT(Append(MemorySeries(FlowFields(), {1}), "timeless"),
              StatusIs(absl::StatusCode::kFailedPrecondition, HasSubstr("has no times")));
  MemorySeries source(FlowFields(), {});
  ISOSCOPE_ASSERT_OK(
      Partition(*source.Open(0, 0, 0).value(), Options("single").volume, never_).status());
  EXPECT_THAT(Append(MemorySeries(FlowFields(), {1}), "single"),
              StatusIs(absl::StatusCode::kFailedPrecondition, HasSubstr("one field and step")));
  Make(MemorySeries(Pressure(), {0}), "flow");
  fs::remove_all(dir_.Sub("flow/shard-00001-of-00002"));
  EXPECT_THAT(Append(MemorySeries(FlowFields(), {1}), "flow"),
              StatusIs(absl::StatusCode::kFailedPrecondition, HasSubstr("shard 1 of 2")));
}

// Every moment at which a process that appends may be killed, made by hand: after `moved` folders
// have moved and `manifests` manifests were replaced.
TEST_F(SeriesPartitionerTest, TheNextOneEndsWhatAKilledProcessBegan) {
  Make(MemorySeries(Pressure(), {0}), "flow");
  fs::copy(dir_.Sub("flow"), dir_.Sub("before"), fs::copy_options::recursive);
  ISOSCOPE_ASSERT_OK(Append(MemorySeries(Pressure(), {1}), "flow"));
  fs::rename(dir_.Sub("flow"), dir_.Sub("after"));
  const Files after = FilesOf("after");
  fs::copy(dir_.Sub("after"), dir_.Sub("flow"), fs::copy_options::recursive);
  ISOSCOPE_ASSERT_OK(Append(MemorySeries(Pressure(), {2}), "flow"));
  const Files appended_twice = FilesOf("flow");
  fs::remove_all(dir_.Sub("flow"));
  std::vector<std::string> folders;
  for (int shard = 0; shard < 2; ++shard) {
    folders.push_back(absl::StrCat(store::ShardDirectoryName(shard, 2), "/",
                                   store::ScalarVolumeDirectoryName({0, 0, 1})));
  }
  const std::vector<std::string> manifests = {
      "shard-00000-of-00002/manifest.json", "shard-00001-of-00002/manifest.json", "manifest.json"};
  for (std::size_t done = 0; done <= folders.size() + manifests.size(); ++done) {
    const std::string flow = dir_.Sub("flow");
    fs::copy(dir_.Sub("before"), flow, fs::copy_options::recursive);
    fs::create_directories(flow + "/append.partial/finished");
    testing::WriteFile(flow + "/append.partial/lock", "");
    fs::copy(dir_.Sub("after/manifest.json"), flow + "/append.partial/manifest.json");
    for (std::size_t i = 0; i < folders.size(); ++i) {
      const std::string to = flow + (i < done ? "/" : "/append.partial/") + folders[i];
      fs::create_directories(fs::path(to).parent_path());
      fs::copy(dir_.Sub("after/" + folders[i]), to, fs::copy_options::recursive);
    }
    for (std::size_t i = 0; i < manifests.size() && folders.size() + i < done; ++i) {
      fs::copy(dir_.Sub("after/" + manifests[i]), flow + "/" + manifests[i],
               fs::copy_options::overwrite_existing);
    }
    // Readers see the series as it was, or whole.
    ISOSCOPE_ASSERT_OK_AND_ASSIGN(const auto seen, store::OpenSeries(flow));
    EXPECT_EQ(seen.manifest.volumes.size(), done < folders.size() + 3 ? 1 : 2);
    ISOSCOPE_ASSERT_OK(Append(MemorySeries(Pressure(), {2}), "flow")) << done;
    EXPECT_EQ(FilesOf("flow"), appended_twice) << done;
    fs::remove_all(flow);
    // One that only repeats the killed command finds that its work is done.
    if (done == 1) {
      fs::copy(dir_.Sub("before"), flow, fs::copy_options::recursive);
      fs::copy(dir_.Sub("after"), flow + "/append.partial", fs::copy_options::recursive);
      ISOSCOPE_ASSERT_OK(Append(MemorySeries(Pressure(), {1}), "flow", /*resumes=*/true));
      EXPECT_EQ(FilesOf("flow"), after);
      fs::remove_all(flow);
    }
  }
}

TEST_F(SeriesPartitionerTest, AppendingThatWasInterruptedIsResumedOrBegunAnew) {
  Make(MemorySeries(FlowFields(), {0, 1, 2}), "flow");
  const Files expected = FilesOf("flow");
  for (const bool resumes : {true, false}) {
    fs::remove_all(dir_.Sub("flow"));
    Make(MemorySeries(FlowFields(), {0}), "flow");
    const Files before = FilesOf("flow");
    MemorySeries source(FlowFields(), {1, 2});
    source.before_open = FailAt(9, absl::CancelledError("stop"));
    EXPECT_THAT(Append(source, "flow"),
                StatusIs(absl::StatusCode::kCancelled, HasSubstr("--resume goes on")));
    // Killed while it wrote a volume.
    fs::create_directories(dir_.Sub("flow/append.partial/volume.partial-77/shard-00000-of-00002"));
    Files left = FilesOf("flow");
    for (const auto& [path, bytes] : before) {
      EXPECT_EQ(left.at(path), bytes) << path;
    }
    ISOSCOPE_ASSERT_OK(Append(MemorySeries(FlowFields(), {1, 2}), "flow", resumes));
    EXPECT_EQ(FilesOf("flow"), expected);
  }
}

}  // namespace
}  // namespace isoscope::partition
