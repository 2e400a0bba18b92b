// Symptom: what a killed `isoscope partition` had left stayed for good.

#include "core/io/work_folder.h"

#include <signal.h>
#include <unistd.h>

#include <chrono>
#include <filesystem>
#include <fstream>
#include <optional>
#include <set>
#include <string>
#include <utility>

#include "absl/strings/match.h"
#include "gmock/gmock.h"
#include "gtest/gtest.h"
#include <sys/file.h>
#include <sys/stat.h>
#include <sys/wait.h>

#include "tests/support/status_matchers.h"
#include "tests/support/temp_dir.h"

namespace isoscope::io {
namespace {

namespace fs = std::filesystem;

using ::isoscope::testing::TempDir;
using ::testing::ElementsAre;
using ::testing::IsEmpty;

constexpr char kPrefix[] = "flow.partial-";

std::set<std::string> EntriesOf(const std::string& path) {
  std::set<std::string> names;
  for (const auto& entry : fs::directory_iterator(path)) {
    names.insert(entry.path().filename().string());
  }
  return names;
}

// What a killed process leaves: the folder, with a record and a free lock.
std::string Abandon(const TempDir& dir) {
  int pipe_ends[2];
  EXPECT_EQ(pipe(pipe_ends), 0);
  const pid_t child = fork();
  if (child == 0) {
    const auto folder = WorkFolder::Make(dir.path(), kPrefix);
    std::ofstream(folder->path() + "/blocks.bin") << "half";
    const std::string path = folder->path();
    [[maybe_unused]] const ssize_t written = write(pipe_ends[1], path.data(), path.size());
    kill(getpid(), SIGKILL);
  }
  waitpid(child, nullptr, 0);
  std::string path(4096, '\0');
  const ssize_t size = read(pipe_ends[0], path.data(), path.size());
  path.resize(static_cast<std::size_t>(size));
  close(pipe_ends[0]);
  close(pipe_ends[1]);
  EXPECT_TRUE(fs::exists(path + "/blocks.bin"));
  return path;
}

TEST(WorkFolderTest, EndsWithItsObject) {
  const TempDir dir;
  {
    ISOSCOPE_ASSERT_OK_AND_ASSIGN(const WorkFolder folder, WorkFolder::Make(dir.path(), kPrefix));
    EXPECT_TRUE(absl::StartsWith(folder.path(), dir.Sub(kPrefix)));
    EXPECT_THAT(EntriesOf(folder.path()), ElementsAre("lock"));
    struct stat info {};
    ASSERT_EQ(stat(folder.path().c_str(), &info), 0);
    const mode_t mask = umask(022);
    umask(mask);
    EXPECT_EQ(info.st_mode & 0777, 0777 & ~mask) << "a dataset has the rights of other folders";
  }
  EXPECT_THAT(EntriesOf(dir.path()), IsEmpty());
}

TEST(WorkFolderTest, OneThatIsMovedStaysWithoutItsLock) {
  const TempDir dir;
  {
    ISOSCOPE_ASSERT_OK_AND_ASSIGN(WorkFolder folder, WorkFolder::Make(dir.path(), kPrefix));
    std::ofstream(folder.path() + "/blocks.bin") << "whole";
    ISOSCOPE_ASSERT_OK(folder.MoveTo(dir.Sub("flow")));
  }
  EXPECT_THAT(EntriesOf(dir.path()), ElementsAre("flow"));
  EXPECT_THAT(EntriesOf(dir.Sub("flow")), ElementsAre("blocks.bin"));
}

TEST(WorkFolderTest, TheLockOfAKilledProcessLeavesANamedFolderAndAHeldOneStays) {
  const TempDir dir;
  ASSERT_TRUE(fs::create_directory(dir.Sub("named")));
  RemoveLeftLock(dir.Sub("named"));  // there is none
  std::ofstream(dir.Sub("named/lock")) << "boot 1\n";
  std::ofstream(dir.Sub("named/blocks.bin")) << "whole";
  RemoveLeftLock(dir.Sub("named"));
  EXPECT_THAT(EntriesOf(dir.Sub("named")), ElementsAre("blocks.bin"));
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(const WorkFolder held, WorkFolder::Make(dir.path(), kPrefix));
  RemoveLeftLock(held.path());
  EXPECT_THAT(EntriesOf(held.path()), ElementsAre("lock"));
}

TEST(WorkFolderTest, WhatAKilledProcessLeftIsRemovedAndWhatALivingOneHasIsNot) {
  const TempDir dir;
  const std::string left = Abandon(dir);
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(const WorkFolder alive, WorkFolder::Make(dir.path(), kPrefix));
  RemoveLeftovers(dir.path(), "other.partial-");
  EXPECT_TRUE(fs::exists(left)) << "of another output";
  RemoveLeftovers(dir.path(), kPrefix);
  EXPECT_FALSE(fs::exists(left));
  EXPECT_TRUE(fs::exists(alive.path()));
}

// Locks of a network disk may be known on one machine only.
TEST(WorkFolderTest, AnotherMachinesFolderStaysThoughItsLockIsFree) {
  const TempDir dir;
  const std::string left = Abandon(dir);
  MachineRecord other = ThisMachine();
  other.boot = "another";
  other.machine = "another";
  RemoveLeftovers(dir.path(), kPrefix, other);
  EXPECT_TRUE(fs::exists(left));
  // One with the same /etc/machine-id, as copies of a virtual machine have.
  other = ThisMachine();
  other.boot = "another";
  other.host = "another";
  RemoveLeftovers(dir.path(), kPrefix, other);
  EXPECT_TRUE(fs::exists(left));
  // The same machine after a new start: but this folder has changed since.
  other = ThisMachine();
  other.boot = "another";
  RemoveLeftovers(dir.path(), kPrefix, other);
  EXPECT_TRUE(fs::exists(left));
  RemoveLeftovers(dir.path(), kPrefix);
  EXPECT_FALSE(fs::exists(left));
}

TEST(WorkFolderTest, FoldersOfNobodyStay) {
  const TempDir dir;
  const std::string path = dir.Sub("flow.partial-4711");
  fs::create_directory(path);
  RemoveLeftovers(dir.path(), kPrefix);
  EXPECT_TRUE(fs::exists(path)) << "perhaps it is being made at this moment";
  std::ofstream(path + "/blocks.bin") << "of an earlier program, without a lock";
  RemoveLeftovers(dir.path(), kPrefix);
  EXPECT_TRUE(fs::exists(path));
  std::ofstream(path + "/lock") << "";
  RemoveLeftovers(dir.path(), kPrefix);
  EXPECT_TRUE(fs::exists(path)) << "a lock without a record, as of an earlier program";
  fs::create_directory_symlink(path, dir.Sub("flow.partial-link"));
  RemoveLeftovers(dir.path(), kPrefix);
  EXPECT_TRUE(fs::exists(path));
}

TEST(WorkFolderTest, ALockTooLongForARecordIsNobodys) {
  const TempDir dir;
  const std::string path = Abandon(dir);
  std::ofstream(path + "/lock", std::ios::app) << std::string(5000, 'x');
  RemoveLeftovers(dir.path(), kPrefix);
  EXPECT_TRUE(fs::exists(path));
}

TEST(WorkFolderTest, TheRecordNamesTheMachine) {
  const TempDir dir;
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(const WorkFolder folder, WorkFolder::Make(dir.path(), kPrefix));
  std::ifstream lock(folder.path() + "/lock");
  const std::string text{std::istreambuf_iterator<char>(lock), std::istreambuf_iterator<char>()};
  const MachineRecord machine = ThisMachine();
  EXPECT_EQ(text, "boot " + machine.boot + "\nmachine " + machine.machine + "\nhost " +
                      machine.host + "\n");
  EXPECT_FALSE(machine.host.empty());
}

// Symptom: the kernel's file has no size, and the boot was unknown: nothing was ever removed.
TEST(WorkFolderTest, TheMachineKnowsItsBoot) {
  const bool is_told = std::filesystem::exists("/proc/sys/kernel/random/boot_id");
  EXPECT_EQ(ThisMachine().boot.size(), is_told ? 36U : 0U) << "a UUID";
}

}  // namespace
}  // namespace isoscope::io
