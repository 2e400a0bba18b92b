#include "core/source/bytes/file_source.h"

#include <algorithm>
#include <array>
#include <cstddef>
#include <cstdint>
#include <memory>
#include <optional>
#include <string>
#include <vector>

#include "absl/strings/str_cat.h"
#include "absl/types/span.h"
#include "gmock/gmock.h"
#include "gtest/gtest.h"

#include "core/base/cancellation.h"
#include "core/io/mounted_file.h"
#include "core/math/box.h"
#include "core/source/bytes/cached_bytes.h"
#include "tests/support/draws.h"
#include "tests/support/memory_store.h"
#include "tests/support/status_matchers.h"
#include "tests/support/synthetic_fields.h"
#include "tests/support/temp_dir.h"
#include "tests/support/volume_files.h"

namespace isoscope::source {
namespace {

using testing::StatusIs;

constexpr std::array kTypes = {volume::ScalarType::kUint8, volume::ScalarType::kInt16,
                               volume::ScalarType::kUint32, volume::ScalarType::kFloat64};

// Counts the calls of ReadRanges.
class CountedBytes final : public ByteSource {
 public:
  explicit CountedBytes(const std::string& bytes) : bytes_(bytes) {}

  [[nodiscard]] absl::Status ReadRanges(absl::Span<const ByteRange> ranges,
                                        const base::Cancellation& cancellation) const override {
    ++call_count_;
    return bytes_.ReadRanges(ranges, cancellation);
  }
  [[nodiscard]] std::int64_t size_bytes() const override { return bytes_.size_bytes(); }
  [[nodiscard]] const std::string& name() const override { return bytes_.name(); }
  [[nodiscard]] std::string version() const override { return ""; }
  [[nodiscard]] int call_count() const { return call_count_; }

 private:
  const testing::MemoryBytes bytes_;
  mutable int call_count_ = 0;
};

// Mounts the bytes as a file at an address, and returns its path.
std::string Mount(const std::shared_ptr<const ByteSource>& bytes) {
  static int number = 0;
  const std::string path = absl::StrCat("http://localhost/", ++number, ".raw");
  io::MountFile({.file = MakeCachedFile(bytes, path),
                 .version = "1",
                 .read_pieces = [bytes](absl::Span<const io::FilePiece> pieces,
                                        const base::Cancellation& cancellation) {
                   std::vector<ByteRange> ranges;
                   for (const io::FilePiece& piece : pieces) {
                     ranges.push_back({piece.range.offset, piece.range.size, piece.out});
                   }
                   return bytes->ReadRanges(ranges, cancellation);
                 }});
  return path;
}

volume::GridGeometry GeometryOf(const math::Index3& dims) {
  volume::GridGeometry geometry;
  geometry.sample_dims = dims;
  return geometry;
}

SampleLocation LocationOf(const std::string& file, volume::ScalarType type) {
  SampleLocation location;
  location.files = {file};
  location.stored_type = type;
  return location;
}

math::IndexBox DrawBox(testing::Dice* dice, const math::Index3& dims) {
  math::IndexBox box;
  for (int axis = 0; axis < 3; ++axis) {
    box.begin[axis] = dice->Whole(0, dims[axis] - 1);
    box.end[axis] = dice->Whole(box.begin[axis] + 1, dims[axis]);
  }
  return box;
}

// Any type, order of bytes, components, volumes, slope and number of files: a box has the samples
// that rows have, in a file of this machine and at an address.
TEST(FileSourceTest, BoxesHaveTheSamplesOfTheirRows) {
  const testing::TempDir dir;
  testing::Dice dice(testing::DrawSeed());
  for (int i = 0; i < 60; ++i) {
    SCOPED_TRACE(i);
    const math::Index3 dims{dice.Whole(1, 300), dice.Whole(2, 20), 2 * dice.Whole(1, 6)};
    SampleLocation location;
    location.offset = dice.Whole(0, 40);
    location.has_more_behind = true;
    location.is_big_endian = dice.OneIn(2);
    location.stored_type = dice.OneOf(kTypes);
    location.slope = dice.OneIn(3) ? 2 : 1;
    location.components = dice.OneIn(3) ? 3 : 1;
    location.component = location.components - 1;
    const std::int64_t file_count = dice.OneIn(3) ? 2 : 1;
    location.volume_count = file_count == 1 && dice.OneIn(3) ? 2 : 1;
    location.volume = location.volume_count - 1;
    const math::Index3 stored{dims.x * location.components, dims.y,
                              dims.z / file_count * location.volume_count};
    SampleLocation at_address = location;
    for (std::int64_t file = 0; file < file_count; ++file) {
      const std::string bytes = std::string(static_cast<std::size_t>(location.offset), 'h') +
                                testing::SampleNoise(static_cast<std::uint64_t>(100 * i + file),
                                                     stored, location.stored_type, 200) +
                                "behind";
      location.files.push_back(dir.Sub(absl::StrCat(i, "_", file)));
      testing::WriteFile(location.files.back(), bytes);
      at_address.files.push_back(Mount(std::make_shared<testing::MemoryBytes>(bytes)));
    }
    const volume::GridGeometry geometry = GeometryOf(dims);
    ISOSCOPE_ASSERT_OK_AND_ASSIGN(const auto local, MakeFileSource(geometry, location, "local"));
    ISOSCOPE_ASSERT_OK_AND_ASSIGN(const auto far, MakeFileSource(geometry, at_address, "far"));
    const auto size = static_cast<std::int64_t>(volume::SizeOf(local->info().type));
    std::string rows(static_cast<std::size_t>(math::Volume(dims) * size), '\0');
    ISOSCOPE_ASSERT_OK(local->ReadRows(0, dims.y * dims.z, rows.data()));
    for (int j = 0; j < 5; ++j) {
      const math::IndexBox box = DrawBox(&dice, dims);
      std::string expected;
      for (std::int64_t z = box.begin.z; z < box.end.z; ++z) {
        for (std::int64_t y = box.begin.y; y < box.end.y; ++y) {
          expected += rows.substr(
              static_cast<std::size_t>(((z * dims.y + y) * dims.x + box.begin.x) * size),
              static_cast<std::size_t>(box.dims().x * size));
        }
      }
      for (const auto& source : {local.get(), far.get()}) {
        std::string samples(expected.size(), '\0');
        ISOSCOPE_ASSERT_OK(source->ReadBox(box, samples.data(), base::Cancellation()));
        EXPECT_EQ(samples, expected) << source->info().name;
      }
    }
  }
}

TEST(FileSourceTest, ABoxAtAnAddressIsFetchedInFewCalls) {
  const math::Index3 dims{600, 40, 40};
  const auto bytes = std::make_shared<const CountedBytes>(
      testing::SampleNoise(1, dims, volume::ScalarType::kUint16, 200));
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(
      const auto source,
      MakeFileSource(GeometryOf(dims), LocationOf(Mount(bytes), volume::ScalarType::kUint16),
                     "far"));
  EXPECT_EQ(source->box_grid()->box_dims, (math::Index3{600, 64, 16}));  // stretches of 75 KiB
  const int before = bytes->call_count();
  std::string samples(std::size_t{600} * 40 * 20 * 2, '\0');
  ISOSCOPE_ASSERT_OK(source->ReadBox({.begin = {0, 0, 10}, .end = {600, 40, 30}}, samples.data(),
                                     base::Cancellation()));
  EXPECT_EQ(bytes->call_count() - before, 1);
  // Short pieces of rows: of each row one stretch, all together.
  samples.resize(std::size_t{10} * 40 * 40 * 2);
  ISOSCOPE_ASSERT_OK(source->ReadBox({.begin = {5, 0, 0}, .end = {15, 40, 40}}, samples.data(),
                                     base::Cancellation()));
  EXPECT_EQ(bytes->call_count() - before, 2);
  base::Cancellation cancelled;
  cancelled.Cancel();
  EXPECT_THAT(source->ReadBox({.begin = {5, 0, 0}, .end = {15, 40, 40}}, samples.data(), cancelled),
              StatusIs(absl::StatusCode::kCancelled));
}

TEST(FileSourceTest, BoxesOfThisMachineAreSmall) {
  const testing::TempDir dir;
  testing::WriteFile(dir.Sub("a"), std::string(std::size_t{600} * 4 * 4, 'a'));
  ISOSCOPE_ASSERT_OK_AND_ASSIGN(
      const auto source,
      MakeFileSource(GeometryOf({600, 4, 4}), LocationOf(dir.Sub("a"), volume::ScalarType::kUint8),
                     "local"));
  EXPECT_EQ(source->box_grid()->box_dims, (math::Index3{128, 32, 32}));
}

}  // namespace
}  // namespace isoscope::source
