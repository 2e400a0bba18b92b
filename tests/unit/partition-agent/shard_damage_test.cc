// Errors of files of shards, as callers get them, and what the agent keeps of them.

#include "partition-agent/shard_damage.h"

#include <string>
#include <vector>

#include "absl/strings/str_cat.h"
#include "absl/strings/str_split.h"
#include "gmock/gmock.h"
#include "gtest/gtest.h"

#include "core/base/error_reason.h"
#include "core/base/retry_delay.h"
#include "tests/support/status_matchers.h"

namespace isoscope::agent {
namespace {

using ::isoscope::testing::StatusIs;
using ::testing::AllOf;
using ::testing::HasSubstr;
using ::testing::Not;

constexpr char kFolder[] = "/data/flow/shard-00001-of-00002";

class ShardDamagesTest : public ::testing::Test {
 protected:
  void SetUp() override {
    damages_.AddShard("/data/flow/shard-00000-of-00002", "flow", 0);
    damages_.AddShard(kFolder, "flow", 1);
  }

  ShardDamages damages_{/*hides_paths=*/true};
};

// Symptom: the folder of a step that was served vanished, and clients read DATASET_UNKNOWN with the
// path of the agent's machine.
TEST_F(ShardDamagesTest, AnErrorOfAFileOfAShardIsDamageWithoutTheAgentsPath) {
  using Code = absl::StatusCode;
  for (const Code code : {Code::kNotFound, Code::kPermissionDenied, Code::kFailedPrecondition,
                          Code::kInternal, Code::kDataLoss, Code::kInvalidArgument}) {
    const absl::Status told = damages_.ForCaller(
        absl::Status(code, "/data/flow/shard-00001-of-00002/step-2/manifest.json: no such file"));
    EXPECT_THAT(told, StatusIs(Code::kDataLoss,
                               AllOf(HasSubstr("\"flow\", shard 1: step-2/manifest.json: no such"),
                                     Not(HasSubstr("/data")))));
    EXPECT_EQ(base::ReasonOf(told), base::ErrorReason::kShardDamaged);
  }
  ASSERT_EQ(damages_.damages().size(), 1U);
  EXPECT_EQ(damages_.damages()[0].dataset, "flow");
  EXPECT_EQ(damages_.damages()[0].shard_index, 1);
  EXPECT_EQ(damages_.damages()[0].message, "step-2/manifest.json: no such file");
}

TEST_F(ShardDamagesTest, TheFolderItselfIsNoPathForCallersEither) {
  const absl::Status told =
      damages_.ForCaller(absl::NotFoundError("/data/flow/shard-00001-of-00002: is gone"));
  EXPECT_THAT(told,
              StatusIs(absl::StatusCode::kDataLoss,
                       AllOf(HasSubstr("the shard's folder: is gone"), Not(HasSubstr("/data")))));
}

TEST_F(ShardDamagesTest, OtherErrorsStayAsTheyAre) {
  EXPECT_EQ(damages_.ForCaller(absl::OkStatus()), absl::OkStatus());
  const absl::Status other = absl::NotFoundError("/data/flow: neither");
  EXPECT_EQ(damages_.ForCaller(other), other);
  EXPECT_TRUE(damages_.damages().empty());
}

TEST_F(ShardDamagesTest, EndsOfCallsAndFullTablesSayNothingOfTheFile) {
  const char* const text = "open /data/flow/shard-00001-of-00002/ranges.bin: Too many open files";
  const absl::Status full = damages_.ForCaller(absl::ResourceExhaustedError(text));
  EXPECT_THAT(full, StatusIs(absl::StatusCode::kResourceExhausted, Not(HasSubstr("/data"))));
  EXPECT_TRUE(base::RetryDelayOf(full).has_value());
  EXPECT_EQ(base::ReasonOf(full), base::ErrorReason::kTooBusy);
  EXPECT_THAT(damages_.ForCaller(absl::CancelledError(text)),
              StatusIs(absl::StatusCode::kCancelled));
  EXPECT_THAT(damages_.ForCaller(absl::DeadlineExceededError(text)),
              StatusIs(absl::StatusCode::kDeadlineExceeded));
  EXPECT_TRUE(damages_.damages().empty());
}

// Breaks if callers are told to try a chunk again that no waiting makes fit: `isoscope render` did so
// for five minutes.
TEST_F(ShardDamagesTest, WhatNeverFitsHasNoRetryDelay) {
  const absl::Status never = damages_.ForCaller(base::WithReason(
      absl::ResourceExhaustedError("block 0 of /data/flow/shard-00001-of-00002/blocks.bin: chunks "
                                   "of 14.6 MiB need 44 MiB while they are decoded"),
      base::ErrorReason::kTooLarge));
  EXPECT_THAT(never, StatusIs(absl::StatusCode::kResourceExhausted, HasSubstr("14.6 MiB")));
  EXPECT_FALSE(base::RetryDelayOf(never).has_value());
  EXPECT_EQ(base::ReasonOf(never), base::ErrorReason::kTooLarge);
  EXPECT_TRUE(damages_.damages().empty());
}

TEST_F(ShardDamagesTest, EachDamageIsLoggedOnceWithItsPath) {
  const absl::Status status =
      absl::DataLossError("/data/flow/shard-00001-of-00002/blocks.bin: ends after 3 bytes");
  ::testing::internal::CaptureStderr();
  damages_.ForCaller(status).IgnoreError();
  damages_.ForCaller(status).IgnoreError();
  const std::string log = ::testing::internal::GetCapturedStderr();
  EXPECT_THAT(log, AllOf(HasSubstr("shard_damaged"),
                         HasSubstr("path=/data/flow/shard-00001-of-00002/blocks.bin")));
  EXPECT_EQ(log.find("shard_damaged"), log.rfind("shard_damaged")) << log;
}

// Paths may come without end, as a disk fails; a log line each would fill another disk.
TEST_F(ShardDamagesTest, TheErrorsOf64FilesAreKeptAndLogged) {
  ::testing::internal::CaptureStderr();
  for (int i = 0; i < 70; ++i) {
    const absl::Status told =
        damages_.ForCaller(absl::NotFoundError(absl::StrCat(kFolder, "/step-", i, ": gone")));
    EXPECT_THAT(told, StatusIs(absl::StatusCode::kDataLoss)) << i;
  }
  const std::string log = ::testing::internal::GetCapturedStderr();
  const std::vector<absl::string_view> parts = absl::StrSplit(log, "shard_damaged");
  EXPECT_EQ(parts.size() - 1, 64U);
}

TEST_F(ShardDamagesTest, AFolderThatIsThereAgainIsNotDamaged) {
  damages_.ForCaller(absl::NotFoundError("/data/flow/shard-00001-of-00002/step-2/ranges.bin: gone"))
      .IgnoreError();
  damages_.Forget("/data/flow/shard-00001-of-00002/step-1");
  EXPECT_EQ(damages_.damages().size(), 1U);
  damages_.Forget("/data/flow/shard-00001-of-00002/step-2");
  EXPECT_TRUE(damages_.damages().empty());
}

TEST(ShardDamagesOfASourceTest, FoldersOfTheSourceAreNotTold) {
  ShardDamages damages(/*hides_paths=*/true);
  damages.AddShard(kFolder, "flow", 1, "/data/run/a.zarr");
  const absl::Status told = damages.ForCaller(absl::PermissionDeniedError(
      absl::StrCat(kFolder,
                   "/step-1: its samples are in /data/run/a.zarr (/mnt/disk/a.zarr), 1/2: allow it "
                   "with --allow-source /data/run/a.zarr=/mnt/b or https://host/a")));
  EXPECT_THAT(told, StatusIs(absl::StatusCode::kDataLoss));
  EXPECT_EQ(told.message(),
            "dataset \"flow\", shard 1: step-1: its samples are in a.zarr (a.zarr), 1/2: allow it "
            "with --allow-source a.zarr=b or https://host/a");
}

// Symptom: a source that had vanished was told as a damaged shard, with "No such file".
TEST(ShardDamagesOfASourceTest, ASourceThatCannotBeReadIsNoDamage) {
  ShardDamages damages(/*hides_paths=*/true);
  damages.AddShard(kFolder, "flow", 1, "/data/run/a.raw");
  const auto told = [&](absl::StatusCode code) {
    return damages.ForCaller(base::WithReason(
        absl::Status(code, absl::StrCat("block 7 of ", kFolder,
                                        "/blocks.bin: its samples are in "
                                        "/data/run/a.raw: no such file; bring it back")),
        base::ErrorReason::kSourceUnreadable));
  };
  ::testing::internal::CaptureStderr();
  const absl::Status gone = told(absl::StatusCode::kNotFound);
  EXPECT_THAT(gone, StatusIs(absl::StatusCode::kNotFound,
                             AllOf(HasSubstr("\"flow\", shard 1: block 7 of blocks.bin: its "
                                             "samples are in a.raw: no such file; bring it back"),
                                   Not(HasSubstr("/data")))));
  EXPECT_EQ(base::ReasonOf(gone), base::ErrorReason::kSourceUnreadable);
  EXPECT_THAT(told(absl::StatusCode::kPermissionDenied),
              StatusIs(absl::StatusCode::kPermissionDenied));
  // Callers have credentials of their own.
  EXPECT_THAT(told(absl::StatusCode::kUnauthenticated),
              StatusIs(absl::StatusCode::kPermissionDenied));
  EXPECT_THAT(told(absl::StatusCode::kUnavailable), StatusIs(absl::StatusCode::kUnavailable));
  EXPECT_TRUE(damages.damages().empty());
  const std::string log = ::testing::internal::GetCapturedStderr();
  EXPECT_THAT(log, HasSubstr("source_unreadable"));
  EXPECT_EQ(log.find("source_unreadable"), log.rfind("source_unreadable")) << log;
}

TEST(ShardDamagesOfOneProcessTest, APersonOfThisMachineReadsThePath) {
  ShardDamages damages(/*hides_paths=*/false);
  damages.AddShard(kFolder, "flow", 1);
  EXPECT_THAT(
      damages.ForCaller(absl::NotFoundError("/data/flow/shard-00001-of-00002/ranges.bin: gone")),
      StatusIs(absl::StatusCode::kDataLoss, HasSubstr("/data/flow/shard-00001-of-00002/ranges")));
}

}  // namespace
}  // namespace isoscope::agent
