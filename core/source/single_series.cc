#include "core/source/single_series.h"

#include <utility>

#include "core/base/check.h"

namespace isoscope::source {
namespace {

class SingleSeries final : public VolumeSeries {
 public:
  explicit SingleSeries(SingleVolume single)
      : VolumeSeries({.name = single.path,
                      .fields = {{.name = single.field}},
                      .length_unit = single.length_unit}),
        single_(std::move(single)) {}

  absl::StatusOr<std::unique_ptr<VolumeSource>> Open(int field, int component, int step) override {
    ISOSCOPE_CHECK(field == 0 && component == 0 && step == 0);
    return single_.volume != nullptr ? std::move(single_.volume) : single_.open();
  }

 private:
  SingleVolume single_;
};

}  // namespace

std::unique_ptr<VolumeSeries> MakeSingleSeries(SingleVolume single) {
  ISOSCOPE_CHECK(single.volume != nullptr && single.open != nullptr);
  return std::make_unique<SingleSeries>(std::move(single));
}

}  // namespace isoscope::source
