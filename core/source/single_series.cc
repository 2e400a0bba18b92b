#include "core/source/single_series.h"

#include <utility>
#include <vector>

#include "core/base/check.h"

namespace isoscope::source {
namespace {

class SingleSeries final : public VolumeSeries {
 public:
  explicit SingleSeries(SingleVolume single)
      : single_(std::move(single)), fields_{{.name = single_.field}} {}

  [[nodiscard]] const std::string& name() const override { return single_.path; }
  [[nodiscard]] const std::vector<SourceField>& fields() const override { return fields_; }
  [[nodiscard]] const std::vector<double>& times() const override { return times_; }
  [[nodiscard]] const std::string& time_unit() const override { return time_unit_; }
  [[nodiscard]] const std::string& length_unit() const override { return single_.length_unit; }

  absl::StatusOr<std::unique_ptr<VolumeSource>> Open(int field, int component, int step) override {
    ISOSCOPE_CHECK(field == 0 && component == 0 && step == 0);
    return single_.volume != nullptr ? std::move(single_.volume) : single_.open();
  }

 private:
  SingleVolume single_;
  const std::vector<SourceField> fields_;
  const std::vector<double> times_;
  const std::string time_unit_;
};

}  // namespace

std::unique_ptr<VolumeSeries> MakeSingleSeries(SingleVolume single) {
  ISOSCOPE_CHECK(single.volume != nullptr && single.open != nullptr);
  return std::make_unique<SingleSeries>(std::move(single));
}

}  // namespace isoscope::source
