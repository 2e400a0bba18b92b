// Sources that are made of others hand a cancellation on to them.

#include <algorithm>
#include <cstddef>
#include <cstdint>
#include <memory>
#include <string>
#include <utility>
#include <vector>

#include "gmock/gmock.h"
#include "gtest/gtest.h"

#include "core/source/adapt/adjusted_source.h"
#include "core/source/adapt/magnitude_source.h"
#include "core/source/adapt/pieces_source.h"
#include "core/source/adapt/placed_source.h"
#include "core/source/adapt/resampled_source.h"
#include "core/source/adapt/value_range.h"
#include "core/source/adapt/wide_source.h"
#include "core/source/volume_source.h"
#include "tests/support/memory_source.h"
#include "tests/support/status_matchers.h"

namespace isoscope::source {
namespace {

using ::isoscope::testing::StatusIs;
using ::testing::_;

constexpr math::Index3 kDims{4, 3, 3};

// 4 x 3 x 3 samples that are 0. Each read checks what is heeded, and nothing else does.
class WaitingSource final : public VolumeSource {
 public:
  explicit WaitingSource(volume::ScalarType type) : VolumeSource(InfoOf(type)) {}
  absl::Status ReadRows(std::int64_t begin_row, std::int64_t end_row, char* out) override {
    std::fill_n(out, (end_row - begin_row) * info().row_bytes(), '\0');
    return heeded_ == nullptr ? absl::OkStatus() : heeded_->Check();
  }
  void HeedCancellation(const base::Cancellation* cancellation) override { heeded_ = cancellation; }

 private:
  static SourceInfo InfoOf(volume::ScalarType type) {
    volume::GridGeometry geometry;
    geometry.sample_dims = kDims;
    return {.name = "waiting", .geometry = geometry, .type = type};
  }

  const base::Cancellation* heeded_ = nullptr;
};

std::unique_ptr<VolumeSource> Waiting(volume::ScalarType type = volume::ScalarType::kUint16) {
  return std::make_unique<WaitingSource>(type);
}

struct Adapted {
  std::string name;
  std::unique_ptr<VolumeSource> source;
};
std::vector<Adapted> AllAdapted() {
  std::vector<Adapted> all;
  all.push_back({"wide", MakeWideSource(Waiting(), WideType::kFloat16)});
  all.push_back({"placed", *PlaceSource(Waiting(), {.spacing = math::Vec3d{1, 2, 3}})});
  all.push_back({"adjusted", *AdjustSource(Waiting(), {.stride = 2})});
  std::vector<std::unique_ptr<VolumeSource>> components;
  components.push_back(Waiting());
  components.push_back(Waiting());
  all.push_back({"magnitude", MakeMagnitudeSource(std::move(components))});
  all.push_back(
      {"resampled", *ResampleSource(Waiting(), {std::vector<double>{0, 1, 2, 4}, {}, {}}, {})});
  all.push_back(
      {"pieces",
       MakePiecesSource(Waiting()->info(), {{.begin = {0, 0, 0}, .end = kDims, .first = {0, 0, 0}}},
                        1000, [](std::size_t) { return Waiting(); })});
  return all;
}

TEST(HeededCancellationTest, AdaptersHandItOn) {
  base::Cancellation cancelled;
  cancelled.Cancel();
  for (const Adapted& adapted : AllAdapted()) {
    SCOPED_TRACE(adapted.name);
    VolumeSource& source = *adapted.source;
    std::string rows(static_cast<std::size_t>(2 * source.info().row_bytes()), '?');
    ISOSCOPE_EXPECT_OK(source.ReadRows(0, 1, rows.data()));
    {
      const CancellableReads reads(&source, cancelled);
      EXPECT_THAT(source.ReadRows(2, 4, rows.data()), StatusIs(absl::StatusCode::kCancelled, _));
      EXPECT_THAT(source.ReadBand(1, 2, 0, 1, rows.data()),
                  StatusIs(absl::StatusCode::kCancelled, _));
    }
    ISOSCOPE_EXPECT_OK(source.ReadRows(2, 4, rows.data()));
  }
  // A piece that is opened later heeds it, too.
  const auto pieces =
      MakePiecesSource(Waiting()->info(), {{.begin = {0, 0, 0}, .end = kDims, .first = {0, 0, 0}}},
                       1000, [](std::size_t) { return Waiting(); });
  const CancellableReads reads(pieces.get(), cancelled);
  std::string row(8, '?');
  EXPECT_THAT(pieces->ReadRows(0, 1, row.data()), StatusIs(absl::StatusCode::kCancelled, _));
}

TEST(HeededCancellationTest, LayersAreThoseOfTheSourceThatIsRead) {
  volume::GridGeometry geometry;
  geometry.sample_dims = kDims;
  const auto layered = [&] {
    return testing::MakeMemorySource({.name = "a",
                                      .geometry = geometry,
                                      .type = volume::ScalarType::kUint16,
                                      .planes_at_once = 3},
                                     std::string(4 * 3 * 3 * 2, '\0'));
  };
  EXPECT_EQ(MakeWideSource(layered(), WideType::kFloat16)->info().planes_at_once, 3);
  EXPECT_EQ((*PlaceSource(layered(), {.spacing = math::Vec3d{1, 2, 3}}))->info().planes_at_once, 3);
  EXPECT_EQ((*AdjustSource(layered(), {.stride = 2}))->info().planes_at_once, 1);
}

}  // namespace
}  // namespace isoscope::source
