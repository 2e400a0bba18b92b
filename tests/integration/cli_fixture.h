// Runs the command line as its users type it, for the tests of this folder.

#ifndef ISOSCOPE_TESTS_INTEGRATION_CLI_FIXTURE_H_
#define ISOSCOPE_TESTS_INTEGRATION_CLI_FIXTURE_H_

#include <cstdint>
#include <string>
#include <vector>

#include "absl/status/statusor.h"
#include "absl/strings/str_cat.h"
#include "gtest/gtest.h"
#include <nlohmann/json.hpp>

#include "core/base/units.h"
#include "core/io/file.h"
#include "tests/support/process.h"
#include "tests/support/process_cluster.h"
#include "tests/support/status_matchers.h"
#include "tests/support/temp_dir.h"

namespace isoscope {

inline constexpr std::int64_t kMaxFileBytes = 64 * base::kMiB;
// As --isovalue, and what the reference takes.
inline constexpr char kIsovalue[] = "128";

using testing::Join;

inline std::string ReadFile(const std::string& path) {
  absl::StatusOr<std::string> bytes = io::ReadWholeFile(path, kMaxFileBytes);
  EXPECT_THAT(bytes, testing::IsOk());
  return bytes.value_or("");
}

// Runs a command that must succeed and returns its standard output.
inline std::string MustRun(const std::vector<std::string>& arguments,
                           const testing::ProcessOptions& options = {}) {
  const testing::CommandResult result = testing::RunIsoscope(arguments, options);
  EXPECT_EQ(result.exit_code, 0) << result.err;
  return result.out;
}

inline nlohmann::json ParseJson(const std::string& text) {
  nlohmann::json parsed = nlohmann::json::parse(text, nullptr, /*allow_exceptions=*/false);
  EXPECT_FALSE(parsed.is_discarded()) << text;
  return parsed;
}

// Runs with a cache of its own, so that nothing is shared with the user's or another test.
class CliTest : public ::testing::Test {
 protected:
  [[nodiscard]] testing::ProcessOptions Options() const {
    return {.environment = {"XDG_CACHE_HOME=" + directory_.Sub("cache")}};
  }
  [[nodiscard]] std::string Path(const std::string& name) const { return directory_.Sub(name); }

  // Writes the volume and partitions it with the command line.
  void Partition(const testing::TestVolume& volume, const std::string& name, int shard_count) {
    const std::string raw = Path("volume.raw");
    if (!io::PathExists(raw)) {
      ISOSCOPE_ASSERT_OK(testing::WriteRawFile(volume, raw));
    }
    MustRun(Join({"partition", raw, "--output", Path(name), "--shards", absl::StrCat(shard_count),
                  "--block-cells", "8"},
                 testing::RawFlags(volume)));
  }

  // Renders and returns the PNG's bytes; the statistics go to `stats`.
  std::string Render(const std::vector<std::string>& arguments, nlohmann::json* stats = nullptr) {
    const std::string png = Path("picture.png");
    const std::string stats_path = Path("stats.json");
    MustRun(Join({"render", "--isovalue", kIsovalue, "--width", "160", "--height", "120",
                  "--output", png, "--stats", stats_path},
                 arguments),
            Options());
    if (stats != nullptr) {
      *stats = ParseJson(ReadFile(stats_path));
    }
    return ReadFile(png);
  }

  testing::TempDir directory_;
  // Blocks of 8 do not divide it, on any axis.
  const testing::TestVolume gyroid_ = testing::GyroidVolume({43, 37, 29});
};

}  // namespace isoscope

#endif  // ISOSCOPE_TESTS_INTEGRATION_CLI_FIXTURE_H_
