// Symptom: parts that were cut of copies of a source in other folders were refused, or parts of two
// sources were joined.

#include "core/formats/source_members.h"

#include <chrono>
#include <filesystem>
#include <string>
#include <utility>
#include <vector>

#include "gmock/gmock.h"
#include "gtest/gtest.h"

#include "core/source/bytes/raw_file.h"
#include "tests/support/status_matchers.h"
#include "tests/support/temp_dir.h"
#include "tests/support/volume_files.h"

namespace isoscope::source {
namespace {

namespace fs = std::filesystem;

using ::isoscope::testing::WriteFile;
using ::testing::Contains;
using ::testing::Pair;
using Members = std::vector<std::pair<std::string, std::string>>;

class SourceMembersTest : public ::testing::Test {
 protected:
  // A raw volume in a folder of its own.
  OpenRequest RequestIn(const std::string& folder) {
    fs::create_directories(dir_.Sub(folder));
    const std::string path = dir_.Sub(folder + "/v.raw");
    if (!fs::exists(path)) {
      WriteFile(path, std::string(24, 'a'));
    }
    OpenRequest request;
    request.path = path;
    request.raw = RawFormat{.dims = {4, 3, 2}};
    return request;
  }
  static Members MembersOf(const OpenRequest& request) {
    auto members = SourceMembers(request);
    EXPECT_EQ(members.status(), absl::OkStatus());
    return members.ok() ? *std::move(members) : Members();
  }

  testing::TempDir dir_;
};

TEST_F(SourceMembersTest, ACopyWithItsTimesHasTheSameMembersInAnotherFolder) {
  const OpenRequest request = RequestIn("a");
  const OpenRequest copy = RequestIn("b");
  fs::last_write_time(copy.path, fs::last_write_time(request.path));
  const Members members = MembersOf(request);
  EXPECT_EQ(MembersOf(copy), members);
  EXPECT_THAT(members, Contains(Pair("the source", "v.raw")));
  for (const auto& [name, value] : members) {
    EXPECT_EQ(value.find(dir_.Sub("")), std::string::npos) << name;
  }
}

TEST_F(SourceMembersTest, AnotherTimeSizeNameOrRequestDiffers) {
  const OpenRequest request = RequestIn("a");
  const Members members = MembersOf(request);
  OpenRequest strided = request;
  strided.stride = 2;
  EXPECT_NE(MembersOf(strided), members);
  OpenRequest cropped = request;
  cropped.crop = SampleBox{{0, 0, 0}, {2, 2, 2}};
  EXPECT_NE(MembersOf(cropped), members);
  OpenRequest signed_type = request;
  signed_type.raw->type = volume::ScalarType::kInt8;
  EXPECT_NE(MembersOf(signed_type), members);
  OpenRequest renamed = request;
  renamed.path = dir_.Sub("a/w.raw");
  fs::copy_file(request.path, renamed.path);
  fs::last_write_time(renamed.path, fs::last_write_time(request.path));
  EXPECT_NE(MembersOf(renamed), members);
  const auto time = fs::last_write_time(request.path);
  fs::last_write_time(request.path, time + std::chrono::seconds(1));
  EXPECT_NE(MembersOf(request), members);
  WriteFile(request.path, std::string(25, 'a'));
  fs::last_write_time(request.path, time);
  EXPECT_NE(MembersOf(request), members);
}

}  // namespace
}  // namespace isoscope::source
