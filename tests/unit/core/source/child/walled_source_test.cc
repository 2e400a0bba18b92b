// A library in the child process that crashes, hangs, throws or lies gives an error. A library that
// works gives its samples.

#include "core/source/child/walled_source.h"

#include <algorithm>
#include <csignal>
#include <cstdlib>
#include <memory>
#include <stdexcept>
#include <string>
#include <utility>
#include <vector>

#include "absl/strings/match.h"
#include "gmock/gmock.h"
#include "gtest/gtest.h"

#include "tests/support/status_matchers.h"

namespace isoscope::source {
namespace {

using ::isoscope::testing::StatusIs;
using ::testing::AllOf;
using ::testing::ElementsAre;
using ::testing::HasSubstr;

// Rows that hold their own indices. The path selects the fault.
class FakeSource final : public VolumeSource {
 public:
  explicit FakeSource(const std::string& path) : VolumeSource(InfoOf(path)) {}
  absl::Status ReadRows(std::int64_t begin, std::int64_t end, char* out) override {
    if (info().name == "dies later" && begin > 0) {
      std::raise(SIGSEGV);
    }
    if (info().name == "fails once" && !std::exchange(has_failed_, true)) {
      return absl::DataLossError("fails once: row 0 is damaged");
    }
    for (std::int64_t row = begin; row < end; ++row) {
      std::fill_n(out + ((row - begin) << 20), 1 << 20, static_cast<char>(row));
    }
    return absl::OkStatus();
  }

 private:
  static SourceInfo InfoOf(const std::string& path) {
    SourceInfo info{.name = path, .is_seekable = false, .memory_bytes = 1000};
    info.geometry.sample_dims = {1 << 20, path == "lies" ? -1 : 5, 7};  // rows of 1 MiB
    info.geometry.spacing = {1, 2, 3};
    return info;
  }

  bool has_failed_ = false;
};

absl::StatusOr<std::unique_ptr<VolumeSource>> Open(const std::string& path,
                                                   const std::string& part) {
  if (path == "dies") {
    std::abort();
  }
  if (path == "throws") {
    throw std::runtime_error("no one catches it");
  }
  if (path == "missing") {
    return absl::NotFoundError("missing: no such\x1b[2J file");
  }
  return std::make_unique<FakeSource>(path + part);
}

absl::StatusOr<std::vector<std::string>> FindFiles(const std::string& path) {
  if (path == "dies") {
    std::abort();
  }
  return std::vector<std::string>{path, "another one"};
}

absl::StatusOr<std::vector<std::string>> Describe(const std::string& path,
                                                  const std::string& part) {
  return std::vector<std::string>{path, "part \x1b" + part};
}

constexpr WalledLibrary kLibrary = {
    .name = "libfake", .open = Open, .find_files = FindFiles, .describe = Describe};

TEST(WalledSourceTest, WhatTheLibraryReadsComesThrough) {
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(const auto source, OpenWalled(kLibrary, "good"));
  EXPECT_EQ(source->info().geometry, FakeSource("good").info().geometry);
  EXPECT_EQ(source->info().type, volume::ScalarType::kUint8);
  EXPECT_EQ(source->info().name, "good");
  EXPECT_FALSE(source->info().is_seekable);
  EXPECT_GE(source->info().memory_bytes, 1000);
  // Parts of planes, whole planes, and more than is shared at a time.
  for (const auto& [begin, end] : {std::pair{0, 1}, {3, 4}, {3, 22}, {0, 35}, {34, 35}}) {
    std::vector<char> rows(static_cast<std::size_t>(end - begin) << 20);
    ISOSCOPE_ASSERT_OK(source->ReadRows(begin, end, rows.data()));
    for (int row = begin; row < end; ++row) {
      const char* const first = rows.data() + (static_cast<std::size_t>(row - begin) << 20);
      ASSERT_EQ(std::count(first, first + (1 << 20), static_cast<char>(row)), 1 << 20) << row;
    }
  }
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(const auto files, FindFilesWalled(kLibrary, {"good"}));
  EXPECT_THAT(files, ElementsAre("good", "another one"));
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(const auto of_two, FindFilesWalled(kLibrary, {"good", "better"}));
  EXPECT_THAT(of_two, ElementsAre("good", "another one", "better", "another one"));
}

TEST(WalledSourceTest, PartsArePassedOnAndDescribed) {
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(const auto source, OpenWalled(kLibrary, "good", ":3"));
  EXPECT_EQ(source->info().name, "good:3");
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(const auto texts, DescribeWalled(kLibrary, "good", "7"));
  EXPECT_THAT(texts, ElementsAre("good", "part ?7"));
  EXPECT_THAT(DescribeWalled(kLibrary, "good", std::string(300, 'p')),
              StatusIs(absl::StatusCode::kInvalidArgument, HasSubstr("too long")));
}

TEST(WalledSourceTest, ErrorsComeThroughWithoutWhatATerminalObeys) {
  EXPECT_THAT(OpenWalled(kLibrary, "missing"),
              StatusIs(absl::StatusCode::kNotFound, "missing: no such?[2J file"));
  EXPECT_THAT(OpenWalled(kLibrary, std::string(5000, 'p')),
              StatusIs(absl::StatusCode::kInvalidArgument, HasSubstr("too long")));
}

TEST(WalledSourceTest, ALibraryThatEndsItsProcessIsDataLoss) {
  for (const char* path : {"dies", "throws"}) {
    EXPECT_THAT(OpenWalled(kLibrary, path),
                StatusIs(absl::StatusCode::kDataLoss,
                         AllOf(HasSubstr(path), HasSubstr("libfake"), HasSubstr("SIGABRT"))));
  }
  EXPECT_THAT(FindFilesWalled(kLibrary, {"dies"}),
              StatusIs(absl::StatusCode::kDataLoss, ::testing::_));
  ISOSCOPE_EXPECT_OK(OpenWalled(kLibrary, "good").status());
}

TEST(WalledSourceTest, AfterAnErrorNoRowsAreGiven) {
  for (const char* path : {"dies later", "fails once"}) {
    ISOSCOPE_ASSERT_OK_AND_ASSIGN(const auto source, OpenWalled(kLibrary, path));
    std::vector<char> rows(std::size_t{35} << 20);
    const absl::Status first = source->ReadRows(0, 35, rows.data());
    EXPECT_THAT(first, StatusIs(absl::StatusCode::kDataLoss, HasSubstr(path)));
    EXPECT_EQ(source->ReadRows(0, 1, rows.data()), first);
  }
}

TEST(WalledSourceTest, AGridThatCannotBeIsNotBelieved) {
  EXPECT_THAT(OpenWalled(kLibrary, "lies"),
              StatusIs(absl::StatusCode::kDataLoss, HasSubstr("lies")));
}

}  // namespace
}  // namespace isoscope::source
