// The cache holds what a frame needs, whatever happens to its files. Symptom: a step's folder was
// removed from the cache, and the step before was drawn in its place; other missing files gave an
// error at every call.

#include <cstdlib>
#include <filesystem>
#include <fstream>
#include <map>
#include <memory>
#include <ostream>
#include <sstream>
#include <string>
#include <vector>

#include "absl/strings/match.h"
#include "absl/strings/str_cat.h"
#include "gmock/gmock.h"
#include "gtest/gtest.h"

#include "client-cli/session/cache_entry.h"
#include "client-cli/session/session.h"
#include "core/cli/interrupt.h"
#include "core/formats/address_opening.h"
#include "core/store/series_manifest.h"
#include "tests/support/status_matchers.h"
#include "tests/support/temp_dir.h"
#include "tests/support/volume_files.h"
#include "tests/unit/core/formats/vtk/vti_bytes.h"

namespace isoscope::cli {
namespace {

namespace fs = std::filesystem;

using ::isoscope::testing::StatusIs;
using ::isoscope::testing::TempDir;
using ::isoscope::testing::VtiBytes;
using ::isoscope::testing::WriteFile;
using ::testing::ElementsAre;
using ::testing::HasSubstr;
using ::testing::IsEmpty;

using Files = std::map<std::string, std::string>;  // bytes by path

Files FilesBelow(const std::string& directory) {
  Files files;
  for (const auto& entry : fs::recursive_directory_iterator(directory)) {
    const std::string name = entry.path().lexically_relative(directory).string();
    if (entry.is_regular_file() && !absl::StartsWith(name, ".cache-")) {
      files[name] = testing::ReadFile(entry.path().string());
    }
  }
  return files;
}

class PrepareInputTest : public ::testing::Test {
 protected:
  PrepareInputTest() {
    setenv("XDG_CACHE_HOME", dir_.Sub("cache").c_str(), 1);
    context_.out = &out_;
    context_.err = &err_;
    context_.interrupt = &interrupt_;
    WriteFile(dir_.Sub("v.raw"), testing::Noise({12, 11, 10}, volume::ScalarType::kUint8));
    std::string steps;
    for (int step = 0; step < 3; ++step) {
      const auto bytes = [&](char c) {
        return std::string(5 * 4 * 3, static_cast<char>(c + step));
      };
      WriteFile(dir_.Sub(absl::StrCat("s", step, ".vti")),
                VtiBytes({.extent = "0 4 0 3 0 2",
                          .fields = {{"p", "UInt8", bytes('a')}, {"t:x", "UInt8", bytes('k')}}}));
      absl::StrAppend(&steps, "<DataSet timestep=\"", step, "\" file=\"s", step, ".vti\"/>");
    }
    WriteFile(dir_.Sub("run.pvd"), "<VTKFile><Collection>" + steps + "</Collection></VTKFile>");
  }
  ~PrepareInputTest() override { unsetenv("XDG_CACHE_HOME"); }

  absl::StatusOr<CachedDataset> Prepare(const std::string& input,
                                        const WantedVolumes* wanted = nullptr) {
    SessionFlags flags;
    flags.input = dir_.Sub(input);
    flags.shard_count = input == "v.raw" ? 2 : 1;
    if (input == "v.raw") {
      flags.source.dims = math::Index3{12, 11, 10};
      flags.source.type = volume::ScalarType::kUint8;
    }
    err_.str("");
    return PrepareInput(flags, wanted, context_);
  }

  // Damages the entry in one way; it must be made anew, with the same bytes.
  void ExpectMadeAnew(const std::string& input, const std::string& directory, const Files& whole,
                      const std::string& what) {
    SCOPED_TRACE(what);
    ISOSCOPE_ASSERT_OK_AND_ASSIGN(const CachedDataset again, Prepare(input));
    EXPECT_TRUE(again.was_made);
    EXPECT_EQ(again.directory, directory);
    EXPECT_EQ(FilesBelow(directory), whole);
  }

  const TempDir dir_;
  std::ostringstream out_;
  std::ostringstream err_;
  Interrupt interrupt_;
  Context context_;
};

// Notes for each text that is written whether this thread has an opening.
class OpeningWatch final : public std::stringbuf {
 public:
  [[nodiscard]] const std::map<std::string, bool>& has_opening() const { return has_opening_; }

 protected:
  std::streamsize xsputn(const char* text, std::streamsize size) override {
    has_opening_[std::string(text, static_cast<std::size_t>(size))] =
        source::KeptAnswers::OfThread() != nullptr;
    return std::stringbuf::xsputn(text, size);
  }

 private:
  std::map<std::string, bool> has_opening_;
};

// Symptom: small answers of a server were kept until the dataset was cut, for hours.
TEST_F(PrepareInputTest, AnOpeningEndsBeforeSamplesAreRead) {
  std::string header;
  for (const char* const card :
       {"SIMPLE  =                    T", "BITPIX  =                    8", "NAXIS   = 3",
        "NAXIS1  = 8", "NAXIS2  = 9", "NAXIS3  = 10", "CTYPE1  = 'RA---TAN'", "END"}) {
    header += card + std::string(80 - std::string(card).size(), ' ');
  }
  header.resize(2880, ' ');
  WriteFile(dir_.Sub("sky.fits"),
            header + testing::Noise({8, 9, 10}, volume::ScalarType::kUint8) + std::string(2160, 0));
  OpeningWatch watch;
  std::ostream err(&watch);
  context_.err = &err;
  context_.err_is_terminal = true;
  const auto prepared = Prepare("sky.fits");
  context_.err = &err_;
  ISOSCOPE_ASSERT_OK(prepared);
  int notes = 0;
  for (const auto& [text, has_opening] : watch.has_opening()) {
    // The first is written before the source is opened, the second with the volume.
    const bool is_first = absl::StrContains(text, "into the cache");
    const bool is_note = absl::StrContains(text, "samples are 1 apart");
    notes += is_first || is_note ? 1 : 0;
    EXPECT_TRUE(!is_first || has_opening) << text;
    EXPECT_TRUE(!is_note || !has_opening) << text;
  }
  EXPECT_EQ(notes, 2);
}

TEST_F(PrepareInputTest, WhateverIsMissingOrCutOfAnEntryIsMadeAnew) {
  for (const std::string input : {"v.raw", "run.pvd"}) {
    SCOPED_TRACE(input);
    std::string directory;
    {
      ISOSCOPE_ASSERT_OK_AND_ASSIGN(const CachedDataset made, Prepare(input));
      EXPECT_TRUE(made.was_made);
      EXPECT_TRUE(made.is_cached);
      EXPECT_EQ(made.is_only_volume, input == "v.raw");
      directory = made.directory;
    }
    {
      ISOSCOPE_ASSERT_OK_AND_ASSIGN(const CachedDataset found, Prepare(input));
      EXPECT_FALSE(found.was_made);
    }
    const Files whole = FilesBelow(directory);
    EXPECT_GT(whole.size(), 8u);
    for (const auto& [name, bytes] : whole) {
      const std::string path = directory + "/" + name;
      fs::remove(path);
      ExpectMadeAnew(input, directory, whole, name + " is missing");
      fs::resize_file(path, 0);
      ExpectMadeAnew(input, directory, whole, name + " is empty");
      fs::resize_file(path, bytes.size() / 2);
      ExpectMadeAnew(input, directory, whole, name + " is cut");
      // Blocks and pages of the index are verified as they are read.
      if (!absl::EndsWith(name, "blocks.bin") && !absl::EndsWith(name, "tree.bin")) {
        std::string flipped = bytes;
        flipped[flipped.size() / 2] ^= 0x10;
        WriteFile(path, flipped);
        ExpectMadeAnew(input, directory, whole, name + " has a flipped bit");
      }
    }
    std::vector<std::string> folders;
    for (const auto& entry : fs::recursive_directory_iterator(directory)) {
      if (entry.is_directory()) {
        folders.push_back(entry.path().string());
      }
    }
    for (const std::string& folder : folders) {
      fs::remove_all(folder);
      ExpectMadeAnew(input, directory, whole, folder + " is missing");
    }
  }
}

TEST_F(PrepareInputTest, AVolumeOfAnotherStepIsNotTaken) {
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(const CachedDataset made, Prepare("run.pvd"));
  const Files whole = FilesBelow(made.directory);
  const std::string shard = made.directory + "/shard-00000-of-00001/";
  fs::remove_all(shard + "field-000-component-0-step-00002");
  fs::copy(shard + "field-000-component-0-step-00001", shard + "field-000-component-0-step-00002",
           fs::copy_options::recursive);
  ExpectMadeAnew("run.pvd", made.directory, whole, "a step lies in the place of another");
}

TEST_F(PrepareInputTest, AnEntryWhoseBlocksWereFoundDamagedIsMadeAnew) {
  std::string directory;
  {
    ISOSCOPE_ASSERT_OK_AND_ASSIGN(const CachedDataset made, Prepare("v.raw"));
    directory = made.directory;
  }
  const Files whole = FilesBelow(directory);
  MarkDamaged(directory);
  ExpectMadeAnew("v.raw", directory, whole, "marked");
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(const CachedDataset found, Prepare("v.raw"));
  EXPECT_FALSE(found.was_made);
}

std::vector<std::string> VolumesOf(const CachedDataset& dataset) {
  std::vector<std::string> names;
  const auto series = store::OpenSeries(dataset.directory);
  EXPECT_THAT(series, testing::IsOk());
  for (const store::ScalarVolume& volume : series->manifest.volumes) {
    names.push_back(
        absl::StrCat(series->manifest.fields[static_cast<std::size_t>(volume.key.field)].name, "@",
                     volume.key.step));
  }
  EXPECT_EQ(series->manifest.times.size(), 3u) << "steps keep their numbers";
  return names;
}

// One picture of a long series must not cut all of it.
TEST_F(PrepareInputTest, OnlyTheVolumesThatAreWantedAreCut) {
  WantedVolumes wanted;
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(const CachedDataset first, Prepare("run.pvd", &wanted));
  EXPECT_THAT(VolumesOf(first), ElementsAre("p@2"));
  EXPECT_THAT(err_.str(), HasSubstr("takes field \"p\" of p, t:x, step 2 of 0 to 2; --field and "
                                    "--step choose"));
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(const CachedDataset again, Prepare("run.pvd", &wanted));
  EXPECT_FALSE(again.was_made);
  EXPECT_THAT(err_.str(), HasSubstr("takes field \"p\"")) << "each time";
  wanted.selection.step = 2;
  wanted.selection.field = client::FieldValue{"p"};
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(const CachedDataset same, Prepare("run.pvd", &wanted));
  EXPECT_EQ(same.directory, first.directory) << "the same volumes by other flags";
  wanted.selection.step = 1;
  wanted.selection.field = client::FieldValue{"t:x"};
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(const CachedDataset second, Prepare("run.pvd", &wanted));
  EXPECT_THAT(VolumesOf(second), ElementsAre("t:x@1"));
  EXPECT_EQ(err_.str(), "") << "all is chosen";
  wanted.colors = {{.text = "p", .needs_all_steps = true}};
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(const CachedDataset coloured, Prepare("run.pvd", &wanted));
  EXPECT_THAT(VolumesOf(coloured), ElementsAre("p@0", "p@1", "t:x@1", "p@2"));
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(const CachedDataset all, Prepare("run.pvd"));
  EXPECT_EQ(VolumesOf(all).size(), 6u);
  EXPECT_EQ(err_.str(), "");
  EXPECT_NE(all.directory, first.directory);
}

TEST_F(PrepareInputTest, OneVolumeHasOneEntryHoweverItIsNamed) {
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(const CachedDataset all, Prepare("v.raw"));
  WantedVolumes wanted;
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(const CachedDataset plain, Prepare("v.raw", &wanted));
  EXPECT_EQ(plain.directory, all.directory);
  wanted.selection.step = 0;
  wanted.selection.field = client::FieldValue{"v"};
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(const CachedDataset named, Prepare("v.raw", &wanted));
  EXPECT_EQ(named.directory, all.directory);
  EXPECT_TRUE(named.is_only_volume);
  EXPECT_EQ(err_.str(), "");
  wanted.selection.step = 1;
  EXPECT_THAT(Prepare("v.raw", &wanted),
              StatusIs(absl::StatusCode::kNotFound, HasSubstr("it has step 0 alone")));
  wanted.selection.step.reset();
  wanted.selection.time = 0;
  EXPECT_THAT(Prepare("v.raw", &wanted),
              StatusIs(absl::StatusCode::kInvalidArgument, HasSubstr("without a time")));
  wanted.selection = {.field = client::FieldValue{"w"}};
  EXPECT_THAT(Prepare("v.raw", &wanted),
              StatusIs(absl::StatusCode::kInvalidArgument, HasSubstr("no field \"w\"; it has v")));
}

TEST_F(PrepareInputTest, ADatasetFolderThatLacksVolumesSaysSo) {
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(const CachedDataset made, Prepare("run.pvd"));
  fs::copy(made.directory, dir_.Sub("flow"), fs::copy_options::recursive);
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(const CachedDataset whole, Prepare("flow"));
  EXPECT_EQ(err_.str(), "");
  EXPECT_FALSE(whole.is_cached);
  for (const char* volume :
       {"field-000-component-0-step-00002", "field-001-component-0-step-00001"}) {
    fs::remove_all(dir_.Sub("flow/shard-00000-of-00001/") + volume);
  }
  ISOSCOPE_ASSERT_OK(Prepare("flow"));
  EXPECT_THAT(err_.str(), HasSubstr("lacks volumes that its manifest names: field \"t:x\", step 1, "
                                    "in shard 0; and 1 more volume; "));
  EXPECT_THAT(err_.str(), HasSubstr("the last step is the last that is whole"));
}

}  // namespace
}  // namespace isoscope::cli
