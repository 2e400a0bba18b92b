#include "client-cli/dataset_cache.h"

#include <fcntl.h>
#include <unistd.h>

#include <chrono>
#include <cstdlib>
#include <filesystem>
#include <fstream>
#include <latch>
#include <set>
#include <string>
#include <thread>
#include <vector>

#include "gmock/gmock.h"
#include "gtest/gtest.h"
#include <sys/file.h>
#include <sys/stat.h>

#include "core/io/file.h"
#include "tests/support/status_matchers.h"
#include "tests/support/temp_dir.h"

namespace isoscope::cli {
namespace {

namespace fs = std::filesystem;

using ::isoscope::testing::StatusIs;
using ::isoscope::testing::TempDir;
using ::testing::ElementsAre;

void WriteText(const std::string& path, const std::string& text) { std::ofstream(path) << text; }

std::vector<std::string> Entries(const std::string& directory) {
  std::set<std::string> names;
  for (const auto& entry : fs::directory_iterator(directory)) {
    names.insert(entry.path().filename().string());
  }
  return {names.begin(), names.end()};
}

// A dataset for these tests is a folder with a file "whole".
absl::Status Make(const std::string& directory) {
  ISOSCOPE_EXPECT_OK(io::CreateDirectory(directory));
  WriteText(directory + "/whole", "");
  return absl::OkStatus();
}
absl::Status Verify(const std::string& directory) {
  return io::PathExists(directory + "/whole") ? absl::OkStatus() : absl::DataLossError("damaged");
}

TEST(CacheKeyTest, ChangesWithEverythingTheDatasetDependsOn) {
  const TempDir folder;
  const std::string path = folder.Sub("head ct.nii.gz");
  const auto key_of = [](const std::string& file, const char* parameters) {
    return *CacheKey(file, {file}, parameters);
  };
  WriteText(path, "abc");
  const std::string key = key_of(path, "1 shard");
  EXPECT_EQ(key.substr(0, 8), "head_ct-");
  EXPECT_EQ(key.size(), 8U + 16U);
  EXPECT_EQ(key_of(path, "1 shard"), key);
  EXPECT_EQ(key_of(folder.Sub("./head ct.nii.gz"), "1 shard"), key);
  EXPECT_NE(key_of(path, "2 shards"), key);

  const auto time = fs::last_write_time(path);
  fs::last_write_time(path, time + std::chrono::milliseconds(1));
  EXPECT_NE(key_of(path, "1 shard"), key);
  fs::last_write_time(path, time);
  EXPECT_EQ(key_of(path, "1 shard"), key);
  WriteText(path, "abcd");
  fs::last_write_time(path, time);
  EXPECT_NE(key_of(path, "1 shard"), key);

  fs::copy(path, folder.Sub("other.nii.gz"));
  EXPECT_NE(key_of(folder.Sub("other.nii.gz"), "1 shard"), key_of(path, "1 shard"));
}

TEST(CacheKeyTest, ChangesWithEveryFileOfTheSource) {
  const TempDir folder;
  std::vector<std::string> slices;
  for (const char* name : {"a.tif", "b.tif", "c.tif"}) {
    slices.push_back(folder.Sub(name));
    WriteText(slices.back(), name);
  }
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(const std::string key, CacheKey(folder.path(), slices, ""));
  EXPECT_EQ(*CacheKey(folder.path() + "/", slices, ""), key);
  EXPECT_EQ(*CacheKey(folder.path() + "/.", slices, ""), key);
  EXPECT_NE(*CacheKey(folder.Sub("*.tif"), slices, ""), key);
  for (const std::string& slice : slices) {
    const auto time = fs::last_write_time(slice);
    fs::last_write_time(slice, time + std::chrono::seconds(2));
    EXPECT_NE(*CacheKey(folder.path(), slices, ""), key) << slice;
    fs::last_write_time(slice, time);
    const std::string content = fs::path(slice).filename().string();
    WriteText(slice, content + "more");
    fs::last_write_time(slice, time);
    EXPECT_NE(*CacheKey(folder.path(), slices, ""), key) << slice;
    WriteText(slice, content);
    fs::last_write_time(slice, time);
  }
  EXPECT_EQ(*CacheKey(folder.path(), slices, ""), key);
  slices.pop_back();
  EXPECT_NE(*CacheKey(folder.path(), slices, ""), key) << "a slice less";
  fs::rename(folder.Sub("c.tif"), folder.Sub("d.tif"));
  slices.push_back(folder.Sub("d.tif"));
  EXPECT_NE(*CacheKey(folder.path(), slices, ""), key) << "another name";
}

TEST(CacheKeyTest, DatasetsOfOneFileAreTold) {
  const TempDir folder;
  const std::string file = folder.Sub("run.h5");
  WriteText(file, "abc");
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(const std::string key, CacheKey(file + ":/fields/a", {file}, ""));
  EXPECT_EQ(key.substr(0, 2), "a-");
  EXPECT_EQ(*CacheKey(folder.Sub("./run.h5:/fields/a"), {file}, ""), key);
  EXPECT_NE(*CacheKey(file + ":/fields/b", {file}, ""), key);
  EXPECT_NE(*CacheKey(file, {file}, ""), key);
}

TEST(CacheKeyTest, AbsentFileIsNotFound) {
  EXPECT_THAT(CacheKey("/absent/volume.nrrd", {"/absent/volume.nrrd"}, ""),
              StatusIs(absl::StatusCode::kNotFound));
}

TEST(DatasetCacheTest, IsMadeOnceThenFound) {
  const TempDir cache;
  int made_count = 0;
  const auto make = [&](const std::string& directory) {
    ++made_count;
    EXPECT_EQ(fs::path(directory).filename(), "key");  // the dataset's name comes from it
    return Make(directory);
  };
  for (int i = 0; i < 2; ++i) {
    ISOSCOPE_ASSERT_OK_AND_ASSIGN(const std::string found,
                                  FindOrMakeDataset(cache.path(), "key", make, Verify));
    EXPECT_EQ(found, cache.Sub("key"));
  }
  EXPECT_EQ(made_count, 1);
  EXPECT_THAT(Entries(cache.path()), ElementsAre("key"));
}

TEST(DatasetCacheTest, DamagedCopyIsMadeAnew) {
  const TempDir cache;
  fs::create_directory(cache.Sub("key"));
  WriteText(cache.Sub("key/rubble"), "");
  ISOSCOPE_ASSERT_OK(FindOrMakeDataset(cache.path(), "key", Make, Verify));
  EXPECT_THAT(Entries(cache.Sub("key")), ElementsAre("whole"));
  EXPECT_THAT(Entries(cache.path()), ElementsAre("key"));
}

TEST(DatasetCacheTest, FailedMakingLeavesNothing) {
  const TempDir cache;
  const auto fail = [](const std::string& directory) {
    WriteText(directory, "half");
    return absl::CancelledError("interrupted");
  };
  EXPECT_THAT(FindOrMakeDataset(cache.path(), "key", fail, Verify),
              StatusIs(absl::StatusCode::kCancelled));
  EXPECT_TRUE(fs::is_empty(cache.path()));
}

TEST(DatasetCacheTest, SecondOfTwoMakersUsesWhatTheFirstFinished) {
  const TempDir cache;
  const auto overtaken = [&](const std::string& directory) {
    // While this one works, another process starts and finishes.
    ISOSCOPE_EXPECT_OK(FindOrMakeDataset(cache.path(), "key", Make, Verify));
    WriteText(cache.Sub("key/first"), "");
    return Make(directory);
  };
  ISOSCOPE_ASSERT_OK(FindOrMakeDataset(cache.path(), "key", overtaken, Verify));
  EXPECT_THAT(Entries(cache.Sub("key")), ElementsAre("first", "whole"));
  EXPECT_THAT(Entries(cache.path()), ElementsAre("key"));
}

TEST(DatasetCacheTest, ManyMakersAtOnceAllGetAWholeDataset) {
  // Often: a maker may meet another's work folder at any moment of its making.
  for (int round = 0; round < 500 && !HasFailure(); ++round) {
    const TempDir cache;
    std::vector<std::thread> makers;
    std::latch start(8);
    for (int i = 0; i < 8; ++i) {
      makers.emplace_back([&] {
        start.arrive_and_wait();
        const auto found = FindOrMakeDataset(cache.path(), "key", Make, Verify);
        ISOSCOPE_EXPECT_OK(found);
        ISOSCOPE_EXPECT_OK(Verify(cache.Sub("key")));
      });
    }
    for (std::thread& maker : makers) {
      maker.join();
    }
    EXPECT_THAT(Entries(cache.path()), ElementsAre("key"));
  }
}

TEST(DatasetCacheTest, WhatACrashLeftIsRemovedAndWhatIsInWorkIsNot) {
  const TempDir cache;
  for (const char* name : {".making-dead", ".making-alive"}) {
    fs::create_directory(cache.Sub(name));
    WriteText(cache.Sub(name) + "/lock", "");
  }
  const int lock = open((cache.Sub(".making-alive") + "/lock").c_str(), O_RDWR | O_CLOEXEC);
  ASSERT_GE(lock, 0);
  ASSERT_EQ(flock(lock, LOCK_EX | LOCK_NB), 0);
  ISOSCOPE_ASSERT_OK(FindOrMakeDataset(cache.path(), "key", Make, Verify));
  EXPECT_THAT(Entries(cache.path()), ElementsAre(".making-alive", "key"));
  close(lock);
}

// Sets an environment variable for one test.
class ScopedEnvironment {
 public:
  ScopedEnvironment(const char* name, const std::string& value) : name_(name) {
    const char* old = std::getenv(name);  // NOLINT(concurrency-mt-unsafe): one thread
    was_set_ = old != nullptr;
    old_ = was_set_ ? old : "";
    setenv(name, value.c_str(), 1);  // NOLINT(concurrency-mt-unsafe): one thread
  }
  ~ScopedEnvironment() {
    if (was_set_) {
      setenv(name_, old_.c_str(), 1);  // NOLINT(concurrency-mt-unsafe): one thread
    } else {
      unsetenv(name_);  // NOLINT(concurrency-mt-unsafe): one thread
    }
  }
  ScopedEnvironment(const ScopedEnvironment&) = delete;
  ScopedEnvironment& operator=(const ScopedEnvironment&) = delete;

 private:
  const char* const name_;
  bool was_set_ = false;
  std::string old_;
};

TEST(CacheDirectoryTest, FollowsTheEnvironmentInOrder) {
  const TempDir folder;
  const ScopedEnvironment home("HOME", folder.Sub("home"));
  const ScopedEnvironment temporary("TMPDIR", folder.path());
  {
    const ScopedEnvironment xdg("XDG_CACHE_HOME", folder.Sub("xdg"));
    EXPECT_EQ(*CacheDirectory(), folder.Sub("xdg/isoscope"));
  }
  const ScopedEnvironment no_xdg("XDG_CACHE_HOME", "relative");
  EXPECT_EQ(*CacheDirectory(), folder.Sub("home/.cache/isoscope"));
  struct stat info {};
  ASSERT_EQ(stat(folder.Sub("home/.cache/isoscope").c_str(), &info), 0);
  EXPECT_EQ(info.st_mode & 0777U, 0700U);
  const ScopedEnvironment no_home("HOME", "");
  EXPECT_EQ(*CacheDirectory(), folder.Sub("isoscope-" + std::to_string(geteuid())));
}

TEST(CacheDirectoryTest, UnusableHomeFallsBackToTheTemporaryFolder) {
  const TempDir folder;
  WriteText(folder.Sub("file"), "");
  const ScopedEnvironment xdg("XDG_CACHE_HOME", folder.Sub("file"));
  const ScopedEnvironment temporary("TMPDIR", folder.path());
  EXPECT_EQ(*CacheDirectory(), folder.Sub("isoscope-" + std::to_string(geteuid())));
  // A link in the temporary folder may lead to somebody else's.
  fs::remove(folder.Sub("isoscope-" + std::to_string(geteuid())));
  fs::create_directory_symlink("/", folder.Sub("isoscope-" + std::to_string(geteuid())));
  EXPECT_THAT(CacheDirectory(), StatusIs(absl::StatusCode::kFailedPrecondition));
}

}  // namespace
}  // namespace isoscope::cli
