#include "client-cli/session/dataset_cache.h"

#include <fcntl.h>
#include <unistd.h>

#include <atomic>
#include <chrono>
#include <cstddef>
#include <cstdint>
#include <cstdlib>
#include <filesystem>
#include <fstream>
#include <latch>
#include <map>
#include <optional>
#include <set>
#include <sstream>
#include <string>
#include <thread>
#include <vector>

#include "absl/strings/str_cat.h"
#include "gmock/gmock.h"
#include "gtest/gtest.h"
#include <sys/file.h>
#include <sys/stat.h>

#include "core/base/units.h"
#include "core/cli/usage.h"
#include "core/formats/open_request.h"
#include "core/io/file.h"
#include "core/io/work_folder.h"
#include "tests/support/status_matchers.h"
#include "tests/support/temp_dir.h"

namespace isoscope::cli {
namespace {

namespace fs = std::filesystem;

using ::isoscope::testing::StatusIs;
using ::isoscope::testing::TempDir;
using ::testing::ElementsAre;
using ::testing::HasSubstr;
using ::testing::Not;

constexpr char kKey[] = "v-0123456789abcdef";

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

absl::StatusOr<std::string> KeyOf(const std::string& path, const std::vector<std::string>& files,
                                  absl::string_view parameters = "") {
  return CacheKey(source::OpenRequest{.path = path}, files, parameters);
}

TEST(CacheKeyTest, ChangesWithEverythingTheDatasetDependsOn) {
  const TempDir folder;
  const std::string path = folder.Sub("head ct.nii.gz");
  const auto key_of = [](const std::string& file, const char* parameters) {
    return *KeyOf(file, {file}, parameters);
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
  EXPECT_NE(key_of(path, "1 shard"), key) << "the status has changed: a time can be set back";
  WriteText(path, "abcd");
  fs::last_write_time(path, time);
  EXPECT_NE(key_of(path, "1 shard"), key);

  fs::copy(path, folder.Sub("other.nii.gz"));
  EXPECT_NE(key_of(folder.Sub("other.nii.gz"), "1 shard"), key_of(path, "1 shard"));
}

TEST(CacheKeyTest, BeginsWithANameThatADatasetMayHave) {
  const TempDir folder;
  for (const auto& [file, name] : std::map<std::string, std::string>{
           {"-x.nrrd", "_-x"}, {"a.b.c", "a"}, {".hidden.mha", "_hidden"}, {"é", "__"}}) {
    WriteText(folder.Sub(file), "x");
    const std::string key = *KeyOf(folder.Sub(file), {folder.Sub(file)});
    EXPECT_EQ(key.substr(0, key.rfind('-')), name) << file;
  }
}

TEST(CacheKeyTest, ChangesWithEveryFileOfTheSource) {
  const TempDir folder;
  std::vector<std::string> slices;
  for (const char* name : {"a.tif", "b.tif", "c.tif"}) {
    slices.push_back(folder.Sub(name));
    WriteText(slices.back(), name);
  }
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(const std::string key, KeyOf(folder.path(), slices));
  EXPECT_EQ(*KeyOf(folder.path() + "/", slices), key);
  EXPECT_EQ(*KeyOf(folder.path() + "/.", slices), key);
  EXPECT_NE(*KeyOf(folder.Sub("*.tif"), slices), key);
  for (const std::string& slice : slices) {
    const auto time = fs::last_write_time(slice);
    fs::last_write_time(slice, time + std::chrono::seconds(2));
    EXPECT_NE(*KeyOf(folder.path(), slices), key) << slice;
    fs::last_write_time(slice, time);
    const std::string content = fs::path(slice).filename().string();
    WriteText(slice, content + "more");
    fs::last_write_time(slice, time);
    EXPECT_NE(*KeyOf(folder.path(), slices), key) << slice;
  }
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(const std::string last, KeyOf(folder.path(), slices));
  EXPECT_EQ(*KeyOf(folder.path(), slices), last);
  slices.pop_back();
  EXPECT_NE(*KeyOf(folder.path(), slices), last) << "a slice less";
  fs::rename(folder.Sub("c.tif"), folder.Sub("d.tif"));
  slices.push_back(folder.Sub("d.tif"));
  EXPECT_NE(*KeyOf(folder.path(), slices), last) << "another name";
}

TEST(CacheKeyTest, DatasetsOfOneFileAreTold) {
  const TempDir folder;
  const std::string file = folder.Sub("run.h5");
  WriteText(file, "abc");
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(const std::string key, KeyOf(file + ":/fields/a", {file}));
  EXPECT_EQ(key.substr(0, 2), "a-");
  EXPECT_EQ(*KeyOf(folder.Sub("./run.h5:/fields/a"), {file}), key);
  EXPECT_NE(*KeyOf(file + ":/fields/b", {file}), key);
  EXPECT_NE(*KeyOf(file, {file}), key);
}

TEST(CacheKeyTest, ChangesWithEachMemberOfTheRequest) {
  const TempDir folder;
  const std::string file = folder.Sub("v.raw");
  WriteText(file, "abc");
  const auto key_of = [&](const source::OpenRequest& request) {
    return CacheKey(request, {file}, "").value();
  };
  const std::string key = key_of({.path = file});
  EXPECT_NE(key_of({.path = file, .stride = 2}), key);
  EXPECT_NE(key_of({.path = file, .fill = 0.0}), key);
  EXPECT_NE(key_of({.path = file, .grid = {.spacing = math::Vec3d{1, 1, 2}}}), key);
}

TEST(CacheKeyTest, AbsentFileIsNotFound) {
  EXPECT_THAT(KeyOf("/absent/volume.nrrd", {"/absent/volume.nrrd"}),
              StatusIs(absl::StatusCode::kNotFound));
}

TEST(DatasetCacheTest, IsMadeOnceThenFound) {
  const TempDir cache;
  int made_count = 0;
  const auto make = [&](const std::string& directory) {
    ++made_count;
    EXPECT_EQ(fs::path(directory).filename(), kKey);  // the dataset's name comes from it
    return Make(directory);
  };
  for (int i = 0; i < 2; ++i) {
    ISOSCOPE_ASSERT_OK_AND_ASSIGN(const CachedDataset found,
                                  FindOrMakeDataset(cache.path(), kKey, "/v.nrrd", make, Verify));
    EXPECT_EQ(found.directory, cache.Sub(kKey));
    EXPECT_EQ(found.was_made, i == 0);
  }
  EXPECT_EQ(made_count, 1);
  EXPECT_THAT(Entries(cache.path()), ElementsAre(kKey));
}

TEST(DatasetCacheTest, DamagedCopyIsMadeAnew) {
  const TempDir cache;
  fs::create_directory(cache.Sub(kKey));
  WriteText(cache.Sub(std::string(kKey) + "/rubble"), "");
  ISOSCOPE_ASSERT_OK(FindOrMakeDataset(cache.path(), kKey, "/v.nrrd", Make, Verify));
  EXPECT_THAT(Entries(cache.Sub(kKey)), ElementsAre(".cache-entry", "whole"));
  EXPECT_THAT(Entries(cache.path()), ElementsAre(kKey));
}

TEST(DatasetCacheTest, FailedMakingLeavesNothing) {
  const TempDir cache;
  const auto fail = [](const std::string& directory) {
    WriteText(directory, "half");
    return absl::CancelledError("interrupted");
  };
  EXPECT_THAT(FindOrMakeDataset(cache.path(), kKey, "/v.nrrd", fail, Verify),
              StatusIs(absl::StatusCode::kCancelled));
  EXPECT_TRUE(fs::is_empty(cache.path()));
}

TEST(DatasetCacheTest, SecondOfTwoMakersUsesWhatTheFirstFinished) {
  const TempDir cache;
  const auto overtaken = [&](const std::string& directory) {
    // While this one works, another process starts and finishes.
    ISOSCOPE_EXPECT_OK(FindOrMakeDataset(cache.path(), kKey, "/v.nrrd", Make, Verify));
    WriteText(cache.Sub(std::string(kKey) + "/first"), "");
    return Make(directory);
  };
  ISOSCOPE_ASSERT_OK(FindOrMakeDataset(cache.path(), kKey, "/v.nrrd", overtaken, Verify));
  EXPECT_THAT(Entries(cache.Sub(kKey)), ElementsAre(".cache-entry", "first", "whole"));
  EXPECT_THAT(Entries(cache.path()), ElementsAre(kKey));
}

TEST(DatasetCacheTest, ManyMakersAtOnceAllGetAWholeDataset) {
  // Often: a maker may meet another's work folder at any moment of its making.
  for (int repeat = 0; repeat < 500 && !HasFailure(); ++repeat) {
    const TempDir cache;
    std::vector<std::thread> makers;
    std::latch start(8);
    for (int i = 0; i < 8; ++i) {
      makers.emplace_back([&] {
        start.arrive_and_wait();
        const auto found = FindOrMakeDataset(cache.path(), kKey, "/v.nrrd", Make, Verify);
        ISOSCOPE_EXPECT_OK(found);
        ISOSCOPE_EXPECT_OK(Verify(cache.Sub(kKey)));
      });
    }
    for (std::thread& maker : makers) {
      maker.join();
    }
    EXPECT_THAT(Entries(cache.path()), ElementsAre(kKey));
  }
}

TEST(DatasetCacheTest, WhatACrashLeftIsRemovedAndWhatIsInWorkIsNot) {
  const TempDir cache;
  for (const char* name : {".making-dead", ".making-alive"}) {
    fs::create_directory(cache.Sub(name));
    WriteText(cache.Sub(name) + "/lock", "boot " + io::ThisMachine().boot + "\n");
  }
  const int lock = open((cache.Sub(".making-alive") + "/lock").c_str(), O_RDWR | O_CLOEXEC);
  ASSERT_GE(lock, 0);
  ASSERT_EQ(flock(lock, LOCK_EX | LOCK_NB), 0);
  ISOSCOPE_ASSERT_OK(FindOrMakeDataset(cache.path(), kKey, "/v.nrrd", Make, Verify));
  EXPECT_THAT(Entries(cache.path()), ElementsAre(".making-alive", kKey));
  close(lock);
}

TEST(DatasetCacheTest, OneThatIsRemovedMeanwhileIsMadeAnew) {
  const TempDir cache;
  int made_count = 0;
  const auto make = [&](const std::string& directory) {
    ++made_count;
    return Make(directory);
  };
  ISOSCOPE_ASSERT_OK(FindOrMakeDataset(cache.path(), kKey, "/v.nrrd", make, Verify));
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(const bool is_gone, RemoveEntry(cache.path(), kKey));
  EXPECT_TRUE(is_gone);
  ISOSCOPE_ASSERT_OK(FindOrMakeDataset(cache.path(), kKey, "/v.nrrd", make, Verify));
  EXPECT_EQ(made_count, 2);
}

// Concurrent users and removers: a dataset in use stays complete until its user is done.
TEST(DatasetCacheTest, AnEntryInUseIsNeverRemoved) {
  const TempDir cache;
  std::atomic<bool> is_over{false};
  std::thread remover([&] {
    while (!is_over) {
      ISOSCOPE_EXPECT_OK(TrimCache(cache.path(), 0));
    }
  });
  std::vector<std::thread> users;
  for (int user = 0; user < 4; ++user) {
    users.emplace_back([&] {
      for (int i = 0; i < 200; ++i) {
        const auto found = FindOrMakeDataset(cache.path(), kKey, "/v.nrrd", Make, Verify);
        ISOSCOPE_ASSERT_OK(found);
        std::this_thread::yield();
        ISOSCOPE_ASSERT_OK(Verify(found->directory));
      }
    });
  }
  for (std::thread& user : users) {
    user.join();
  }
  is_over = true;
  remover.join();
}

// Puts a dataset of `size_bytes` there that was last used `age` ago.
void Put(const TempDir& cache, const std::string& key, std::size_t size_bytes,
         std::chrono::seconds age) {
  const auto make = [&](const std::string& directory) {
    ISOSCOPE_EXPECT_OK(io::CreateDirectory(directory));
    WriteText(directory + "/whole", std::string(size_bytes, 'x'));
    return absl::OkStatus();
  };
  ISOSCOPE_ASSERT_OK(FindOrMakeDataset(cache.path(), key, "/v", make, Verify));
  fs::last_write_time(cache.Sub(key) + "/.cache-entry", fs::file_time_type::clock::now() - age);
}

constexpr char kOld[] = "a-0000000000000001";
constexpr char kMiddle[] = "b-0000000000000002";
constexpr char kNew[] = "c-0000000000000003";

class TrimCacheTest : public ::testing::Test {
 protected:
  TrimCacheTest() {
    // Made in another order than used.
    Put(cache_, kNew, 1000, std::chrono::seconds(10));
    Put(cache_, kOld, 1000, std::chrono::seconds(30));
    Put(cache_, kMiddle, 1000, std::chrono::seconds(20));
  }

  TempDir cache_;
};

TEST_F(TrimCacheTest, TheLeastRecentlyUsedGoFirst) {
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(std::vector<CacheEntry> removed, TrimCache(cache_.path(), 1 << 20));
  EXPECT_TRUE(removed.empty());
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(removed, TrimCache(cache_.path(), 2500));
  ASSERT_EQ(removed.size(), 1);
  EXPECT_EQ(removed[0].name, kOld);
  EXPECT_THAT(Entries(cache_.path()), ElementsAre(kMiddle, kNew));
  // Using it makes it the newest.
  ISOSCOPE_ASSERT_OK(FindOrMakeDataset(cache_.path(), kMiddle, "/v", Make, Verify));
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(removed, TrimCache(cache_.path(), 1100));
  ASSERT_EQ(removed.size(), 1);
  EXPECT_EQ(removed[0].name, kNew);
}

TEST_F(TrimCacheTest, WhatIsInUseStaysAndCounts) {
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(CachedDataset used,
                                FindOrMakeDataset(cache_.path(), kOld, "/v", Make, Verify));
  // As if its user had started long ago.
  fs::last_write_time(cache_.Sub(kOld) + "/.cache-entry",
                      fs::file_time_type::clock::now() - std::chrono::hours(1));
  ISOSCOPE_ASSERT_OK(TrimCache(cache_.path(), 2500));
  EXPECT_THAT(Entries(cache_.path()), ElementsAre(kOld, kNew));
  ISOSCOPE_ASSERT_OK(TrimCache(cache_.path(), 1));
  EXPECT_THAT(Entries(cache_.path()), ElementsAre(kOld));
  used.lock = EntryLock();
  ISOSCOPE_ASSERT_OK(TrimCache(cache_.path(), 1));
  EXPECT_TRUE(fs::is_empty(cache_.path()));
}

TEST_F(TrimCacheTest, OnlyWhatTheCacheHasMadeIsTouched) {
  fs::create_directory(cache_.Sub("mine"));
  WriteText(cache_.Sub("mine/big"), std::string(100000, 'x'));
  WriteText(cache_.Sub("note-0123456789abcdef"), "a file");
  fs::create_directory_symlink(cache_.Sub("mine"), cache_.Sub("link-0123456789abcdef"));
  ISOSCOPE_ASSERT_OK(TrimCache(cache_.path(), 0));
  EXPECT_THAT(Entries(cache_.path()),
              ElementsAre("link-0123456789abcdef", "mine", "note-0123456789abcdef"));
  EXPECT_TRUE(fs::exists(cache_.Sub("mine/big")));
}

TEST_F(TrimCacheTest, AFolderThatCantBeReadIsAnError) {
  EXPECT_THAT(TrimCache(cache_.Sub("absent"), 0), StatusIs(absl::StatusCode::kNotFound));
  EXPECT_THAT(TrimCache(cache_.Sub(kOld) + "/whole", 0), Not(::isoscope::testing::IsOk()));
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

TEST(CacheLimitTest, FlagThenEnvironmentThenAShareOfTheFileSystem) {
  const TempDir cache;
  const ScopedEnvironment none("ISOSCOPE_CACHE_LIMIT", "");
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(const std::int64_t by_default,
                                CacheLimitBytes(std::nullopt, cache.path()));
  EXPECT_GT(by_default, 0);
  EXPECT_LE(by_default, 20 * base::kGiB);
  EXPECT_LE(by_default, static_cast<std::int64_t>(fs::space(cache.path()).capacity / 10));
  const ScopedEnvironment variable("ISOSCOPE_CACHE_LIMIT", "3MiB");
  EXPECT_EQ(*CacheLimitBytes(std::nullopt, cache.path()), 3 * base::kMiB);
  EXPECT_EQ(*CacheLimitBytes(7, cache.path()), 7);
  const ScopedEnvironment wrong("ISOSCOPE_CACHE_LIMIT", "much");
  const absl::Status status = CacheLimitBytes(std::nullopt, cache.path()).status();
  EXPECT_TRUE(IsUsageError(status));
  EXPECT_THAT(std::string(status.message()), HasSubstr("ISOSCOPE_CACHE_LIMIT: 'much'"));
}

TEST(DescribeLargeEntryTest, OnlyLargeOnesAreSpokenOf) {
  const std::vector<CacheEntry> entries = {{.name = kOld, .size_bytes = base::kGiB},
                                           {.name = kNew, .size_bytes = 3 * base::kGiB}};
  EXPECT_EQ(DescribeLargeEntry("/c", 20 * base::kGiB, entries, absl::StrCat("/c/", kOld)), "");
  EXPECT_EQ(DescribeLargeEntry("/c", 20 * base::kGiB, entries, absl::StrCat("/c/", kNew)),
            "the partitioned volume, 3,072.0 MiB, is kept in the cache, /c, which now has 4,096.0 "
            "MiB of at most 20,480.0 MiB; 'isoscope cache clear c-0000000000000003' removes it");
  EXPECT_THAT(DescribeLargeEntry("/c", base::kGiB, entries, absl::StrCat("/c/", kNew)),
              HasSubstr("4,096.0 MiB, more than its limit of 1,024.0 MiB"));
}

TEST(CacheDirectoryTest, FollowsTheEnvironmentInOrder) {
  const TempDir folder;
  const ScopedEnvironment home("HOME", folder.Sub("home"));
  const ScopedEnvironment temporary("TMPDIR", folder.path());
  {
    const ScopedEnvironment xdg("XDG_CACHE_HOME", folder.Sub("xdg"));
    EXPECT_EQ(FindCacheFolder()->path, folder.Sub("xdg/isoscope"));
  }
  const ScopedEnvironment no_xdg("XDG_CACHE_HOME", "relative");
  EXPECT_EQ(FindCacheFolder()->path, folder.Sub("home/.cache/isoscope"));
  struct stat info {};
  ASSERT_EQ(stat(folder.Sub("home/.cache/isoscope").c_str(), &info), 0);
  EXPECT_EQ(info.st_mode & 0777U, 0700U);
  const ScopedEnvironment no_home("HOME", "");
  EXPECT_EQ(FindCacheFolder()->path, folder.Sub("isoscope-" + std::to_string(geteuid())));
}

TEST(CacheDirectoryTest, UnusableHomeFallsBackToTheTemporaryFolder) {
  const TempDir folder;
  WriteText(folder.Sub("file"), "");
  const ScopedEnvironment xdg("XDG_CACHE_HOME", folder.Sub("file"));
  const ScopedEnvironment temporary("TMPDIR", folder.path());
  EXPECT_EQ(FindCacheFolder()->path, folder.Sub("isoscope-" + std::to_string(geteuid())));
  // A link in the temporary folder may lead to another user's folder.
  fs::remove(folder.Sub("isoscope-" + std::to_string(geteuid())));
  fs::create_directory_symlink("/", folder.Sub("isoscope-" + std::to_string(geteuid())));
  EXPECT_THAT(FindCacheFolder(), StatusIs(absl::StatusCode::kFailedPrecondition));
}

// Symptom: with ~/.cache/isoscope as a link to a larger disk, the cache went to /tmp without a
// word.
TEST(CacheDirectoryTest, ALinkUnderTheUsersHomeIsTaken) {
  const TempDir folder;
  const ScopedEnvironment xdg("XDG_CACHE_HOME", folder.Sub("xdg"));
  const ScopedEnvironment temporary("TMPDIR", folder.path());
  fs::create_directories(folder.Sub("xdg"));
  fs::create_directory(folder.Sub("disk"));
  fs::create_directory_symlink("../disk", folder.Sub("xdg/isoscope"));
  std::ostringstream err;
  EXPECT_EQ(*CacheDirectory(&err), folder.Sub("xdg/isoscope"));
  EXPECT_EQ(err.str(), "");
  fs::remove(folder.Sub("disk"));
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(const CacheFolder other, FindCacheFolder());
  EXPECT_EQ(other.path, folder.Sub("isoscope-" + std::to_string(geteuid())));
  EXPECT_THAT(other.passed_over, HasSubstr("can't follow the link"));
  EXPECT_EQ(*CacheDirectory(&err), other.path);
  EXPECT_THAT(err.str(), HasSubstr("because can't follow the link"));
  EXPECT_THAT(err.str(), HasSubstr(folder.Sub("xdg/isoscope")));
}

}  // namespace
}  // namespace isoscope::cli
